"""The terminal display: Textual, at home on 80 x 24 and over ssh."""

from __future__ import annotations

import re
import time
from collections import deque
from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import DataTable, Footer, Input, Static

from terrapin_hil.messages import interface
from terrapin_hil.telemetry import words
from terrapin_tools.errors import UserError
from terrapin_tools.monitor.driving import Driving
from terrapin_tools.monitor.live import Live
from terrapin_tools.monitor.plot import braille, sparkline
from terrapin_tools.monitor.sources import Source

__all__ = ["MonitorApp"]

REDRAW = 0.1  # s
PLOT_SECONDS = 20.0
TREND = 12  # values
DRIVING = {"a": "a", "r": "r", "plus": "+", "minus": "-", "v": "v", "l": "l", "c": "c"}
COLOURS = ("cyan", "yellow", "green", "magenta")
DEFAULT_PLOTS = ("MOTION.slip", "GROUND.torque")


class MonitorApp(App[None]):
    """Shows a source of frames until it is closed."""

    TITLE = "terrapin monitor"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #head { height: 1; background: $primary-background; }
    #top { height: 7; }
    #controller { width: 1fr; padding: 0 1; }
    #values { width: 1fr; padding: 0 1; border-left: solid $primary-background; }
    #plot { height: 1fr; min-height: 4; padding: 0 1; }
    #filter { height: 1; border: none; display: none; }
    #filter.shown { display: block; }
    #signals { height: 1fr; min-height: 4; }
    #events { height: 3; padding: 0 1; color: $text-muted; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", "Quit"),
        Binding("ctrl+c", "quit", show=False, priority=True),  # Textual says how to quit, and drives on
        Binding("space", "pause", "Pause", priority=False),
        Binding("m", "mark", "Mark"),
        Binding("slash", "filter", "Filter", key_display="/"),
        Binding("p", "pick", "Plot on/off"),
        Binding("escape", "leave", "Leave filter", show=False),
        *(Binding(key, f"drive('{name}')", name, show=False) for key, name in DRIVING.items()),
    ]

    def __init__(self, live: Live, source: Source, limit: float | None = None, driving: Driving | None = None) -> None:
        super().__init__()
        self.driving = driving
        self.live = live
        self.source = source
        self.paused = False
        self.failed: UserError | None = None
        self._limit = limit
        self._pattern = re.compile("")
        self._marks = 0
        self._heard = time.monotonic()
        self._rows: dict[str, object] = {}
        self._trends: dict[str, deque[float]] = {}
        named = words(interface()) if live.robot else {}
        self._words = {name: {float(value): word for word, value in found.items()} for name, found in named.items()}
        for name in DEFAULT_PLOTS:
            if name in live.units:
                live.plot(name, True)

    def compose(self) -> ComposeResult:
        yield Static(id="head")
        with Horizontal(id="top"):
            yield Static(id="controller")
            yield Static(id="values")
        yield Static(id="plot")
        yield Input(placeholder="regular expression over MESSAGE.signal", id="filter")
        yield DataTable[str](id="signals", cursor_type="row")
        yield Static(id="events")
        yield Footer()

    def on_mount(self) -> None:
        table = self._table
        for title, key, width in (
            ("signal", "signal", 30),
            ("value", "value", 14),
            ("unit", "unit", 10),
            ("age", "age", 8),
            ("trend", "trend", TREND),
        ):
            table.add_column(title, key=key, width=width)
        table.focus()
        self.set_interval(REDRAW, self.look)

    @property
    def _table(self) -> DataTable[str]:
        return self.query_one("#signals", DataTable)

    def look(self) -> None:
        """Take what came, and draw."""
        try:
            block = self.source.poll()
        except UserError as error:
            self.failed = error
            self.exit()
            return
        if len(block):
            self._heard = time.monotonic()
            self.live.take(block)
            for name, value in self.live.values.items():
                self._trends.setdefault(name, deque(maxlen=TREND)).append(value)
        if self.driving is not None:
            self.driving.beat()
        if not self.paused:
            self.draw()

    def draw(self) -> None:
        """Everything anew."""
        live = self.live
        state = "PAUSED" if self.paused else "over" if self.source.over else "live"
        head = f" {self.source.name}   {live.time:.2f} s   {live.rate:.0f} frames/s   load {live.load:.0%}   {state}"
        self.query_one("#head", Static).update(Text(head, style="bold"))
        self.query_one("#controller", Static).update(self._controller())
        self.query_one("#values", Static).update(self._values())
        plot = self.query_one("#plot", Static)
        plot.update(self._plot(plot.content_size.width, plot.content_size.height))
        self._signals()
        last = list(live.events)[-3:]
        if self.driving is not None:
            last = last[-2:]
        events = "\n".join(f"{e.time:9.3f} s  {e.text}" for e in last) or "no events yet"
        if self.driving is not None:
            events = f"{self.driving.said}\n{events}"
        self.query_one("#events", Static).update(events)

    def _controller(self) -> Text:
        live = self.live
        state = live.word("state", "STATUS.state")
        faults = [
            part
            for fault in live.faults[:3]
            for part in ((f"{fault['name']}: ", "bold red"), f"{fault['cause']}; {fault['reaction']}\n")
        ]
        waited = 0.0 if self.source.over else time.monotonic() - self._heard
        lost = f"{self.source.lost} frames lost: this machine is too slow; " if self.source.lost else ""
        over = f"; {self.source.note}" if self.source.over and self.source.note else ""
        return Text.assemble(
            ("state   ", "dim"),
            (f"{state}\n", "bold red" if state == "safe" else "bold"),
            *(faults or (("faults  ", "dim"), "none\n")),
            ("bus     ", "dim"),
            lost + live.health(waited) + over,
        )

    def _values(self) -> Table:
        live = self.live
        table = Table.grid(padding=(0, 1))

        def number(name: str, scale: float = 1.0, digits: int = 3) -> str:
            value = live.values.get(name)
            return "-" if value is None or value != value else f"{value * scale:.{digits}f}"

        limit = f" of {self._limit:g}" if self._limit is not None else ""
        slip = number("MOTION.slip") + limit
        if live.values.get("MOTION.slip_valid") == 0.0:
            slip += " (not valid)"
        sign = "" if live.values.get("GROUND.valid") == 1.0 else " (not valid)"
        torque = f"{number('GROUND.torque', 1e3, 1)} +- {number('GROUND.torque_sd', 1e3, 1)} mN m{sign}"
        style = "bold red" if self._limit is not None and live.values.get("MOTION.slip", 0.0) > self._limit else ""
        volts, supply = number("ELECTRICAL.voltage", 1.0, 2), number("ELECTRICAL.supply", 1.0, 2)
        shown: dict[str, Text | str] = {
            "slip": Text(slip, style=style),
            "C_t": torque,
            "terrain": live.word("terrain", "GROUND.terrain"),
            "current": f"{number('ELECTRICAL.current')} A   {volts} V",
            "supply": f"{supply} V   winding {number('ELECTRICAL.temperature', 1.0, 1)} degC",
            "speed": f"{number('MOTION.shell_speed', 1.0, 2)} rad/s   {number('MOTION.ground_speed')} m/s",
        }
        for title, value in shown.items():
            table.add_row(Text(title, style="dim"), value)
        return table

    def _plot(self, width: int, height: int) -> Text:
        text = Text()
        traces = list(self.live.traces.items())
        if not traces or height < 2:
            return Text("p on a signal plots it", style="dim")
        shown = traces[: max(1, height // 3)]
        each = height // len(shown)
        for number, (name, trace) in enumerate(shown):
            colour = COLOURS[number % len(COLOURS)]
            lines, low, high = braille(trace.times, trace.values, width, each - 1, PLOT_SECONDS)
            unit, words = self.live.units.get(name, ""), self._words.get(name, {})
            ends = " to ".join(words.get(end, f"{end:.4g}") for end in (low, high))
            text.append(f"{name}  {ends} {unit}\n", style=f"bold {colour}")
            for line in lines:
                text.append(line + "\n", style=colour)
        return text

    def _signals(self) -> None:
        table, live = self._table, self.live
        wanted = [name for name in live.values if self._pattern.search(name)]
        wanted += [
            f"{i:08X}" if extended else f"{i:03X}" for i, extended in live.unknown if self._pattern.search(f"{i:03X}")
        ]
        if list(self._rows) != wanted:
            table.clear()
            self._rows = {name: table.add_row(name, "", live.units.get(name, ""), "", "", key=name) for name in wanted}
        for name in wanted:
            picked = "* " if name in live.traces else ""
            if name in live.values:
                table.update_cell(name, "signal", picked + name)
                table.update_cell(
                    name, "value", self._words.get(name, {}).get(live.values[name], f"{live.values[name]:.6g}")
                )
                table.update_cell(name, "trend", sparkline(self._trends.get(name, ())))
                table.update_cell(name, "age", f"{live.time - live.times[name]:.2f} s")
            else:
                table.update_cell(name, "value", "not in the DBC")

    def action_pause(self) -> None:
        """Freeze the display; frames are taken on. While the terminal drives, or holds the stop in, it is the stop."""
        if self.driving is not None and (self.driving.armed or self.driving.controls.stop_held):
            self.driving.stop()
            self.draw()
            return
        self.paused = not self.paused
        self.draw()

    def action_drive(self, key: str) -> None:
        """A key of `--drive`."""
        if self.driving is not None:
            self.driving.press(key)
            self.draw()

    def action_mark(self) -> None:
        """Note an event."""
        self._marks += 1
        self.live.mark(f"mark {self._marks}")
        self.draw()

    def action_pick(self) -> None:
        """Plot the signal under the cursor, or no longer."""
        table = self._table
        if table.row_count == 0:
            return
        name = str(table.coordinate_to_cell_key(table.cursor_coordinate).row_key.value)
        if name in self.live.values:
            self.live.plot(name, name not in self.live.traces)
            self.draw()

    def action_filter(self) -> None:
        """Type a regular expression."""
        field = self.query_one("#filter", Input)
        field.add_class("shown")
        field.focus()

    def action_leave(self) -> None:
        """Back to the signals."""
        field = self.query_one("#filter", Input)
        if not field.value:
            field.remove_class("shown")
        self._table.focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Filter as one types; what is no regular expression yet changes nothing."""
        try:
            self._pattern = re.compile(event.value, re.IGNORECASE)
        except re.error:
            return
        self.draw()

    def on_input_submitted(self) -> None:
        """Enter ends typing."""
        self.action_leave()
