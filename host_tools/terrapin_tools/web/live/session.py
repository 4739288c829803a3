"""What the Live tab shows: one source that every browser watches, its log, and pictures of it 30 times a second.

A thread takes frames from the source, writes them to the log, decodes them and makes one packet a picture. Packets hold
few points of each signal (lowest and highest of each 60th of a second) and say which frames they stand for, so that a
browser that was too slow for some can tell which pictures it missed. The log never waits for a browser.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.links.seal import LinkKey
from terrapin_hil.messages import Interface
from terrapin_hil.nodes import Node
from terrapin_hil.scenario.faults import FOREVER
from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import Decoded, Decoder
from terrapin_tools.logs.writing import LogWriter
from terrapin_tools.monitor.controls import LIMITS, Controls, reach
from terrapin_tools.monitor.live import Event, Live
from terrapin_tools.monitor.sources import Bus, LogFile, Simulator, Source
from terrapin_tools.web.live.picture import PAST, Picture, Ring, reduced
from terrapin_tools.web.live.robot import SimulatedRobot
from terrapin_tools.web.service.workspace import Taken

__all__ = ["Recording", "Session"]

PICTURES = 30  # a second
STATUS_EVERY = 0.1  # s
FLUSH = 0.5  # s: what a crash may cost the log
# Columns of a simulator's truth that are shown beside what the controller says: signal, column, unit
TRUE = (
    ("TRUTH.torque", "contact_torque", "N m"),
    ("TRUTH.slip", "slip", ""),
    ("TRUTH.ground_speed", "speed", "m/s"),
)


class Recording:
    """A log that grows. UserError when the file exists or cannot be written."""

    def __init__(self, path: Path, decoder: Decoder | None) -> None:
        if path.exists():
            raise UserError(f"{path.name}: exists already, expected a new name")
        self.path = path
        self.frames = 0
        self._begin = self._flushed = time.monotonic()
        self._writer = LogWriter(path, decoder, growing=True)

    def write(self, block: Any) -> None:
        self._writer.write(block)
        self.frames += len(block)
        if time.monotonic() - self._flushed > FLUSH:
            self._writer.flush()
            self._flushed = time.monotonic()

    def event(self, event: Event) -> None:
        self._writer.event(event.time if np.isfinite(event.time) else 0.0, f"{event.kind}: {event.text}")

    def close(self) -> None:
        self._writer.close()

    def answer(self) -> dict[str, Any]:
        """For the page."""
        size = self.path.stat().st_size if self.path.is_file() else 0
        return {
            "name": self.path.name,
            "frames": self.frames,
            "bytes": size,
            "seconds": time.monotonic() - self._begin,
        }


class Session:
    """One source being watched. `tell(picture, status)` is called in its thread: a Picture or None, a dict or None."""

    def __init__(
        self,
        source: Source,
        decoder: Decoder,
        interface: Interface | None,
        bitrate: int,
        command: str,
        tell: Callable[[Picture | None, dict[str, Any] | None], None],
        node: int = 0,
        watch: Mapping[str, Any] | None = None,
        key: LinkKey | None = None,
    ) -> None:
        self.source = source
        self.command = command
        self.watch = watch  # as it was asked for: another browser changes a part of it
        self.decoder = decoder
        self.live = Live(decoder, interface, bitrate, node)
        self.kind = _kind(source)
        if self.kind in ("robot", "simulator"):
            self.live.units.update({name: unit for name, _, unit in TRUE})
        asked = {name for name, one in interface.messages.items() if one.sender == "host"} if interface else set()
        self.names = sorted(self.live.units, key=lambda name: name.split(".")[0] in asked)  # what it says comes first
        self.state = "live"  # live, over, gone
        self.note = ""
        self.stop_held = False
        self.last_log: dict[str, Any] | None = None
        self._interface = interface
        self._tell = tell
        self._index = {name: number for number, name in enumerate(self.names)}
        self._rings: dict[int, Ring] = {}
        self._recording: Recording | None = None
        self._lock = threading.RLock()
        self._pictures = 0
        self._told = 0  # events
        self._turns = 1  # of a log
        self._heard = time.monotonic()
        self._stop = threading.Event()
        self.controls = (
            Controls(source, interface, Node(node), self._note, self._bridge_on, key)
            if isinstance(source, Bus) and interface is not None
            else None
        )
        self._asked_past: list[tuple[Collection[int], Callable[[bytes], object]]] = []
        self._faults = _injections(source) if isinstance(source, Simulator) else []
        self._thread = threading.Thread(target=self._work, name="live", daemon=True)
        self._thread.start()
        if isinstance(source, LogFile):
            threading.Thread(target=source.measure, name="length", daemon=True).start()

    # ---------------------------------------------------------------- the thread

    def _work(self) -> None:
        due, status_due = time.monotonic(), 0.0
        while not self._stop.is_set():
            picture = None
            with self._lock:
                try:
                    picture = self._look()
                except UserError as error:
                    self.state, self.note = "gone", str(error)
                except Exception as error:  # a fault of ours ends the view and is told, here and in the page
                    traceback.print_exception(error)
                    self.state, self.note = "gone", f"internal error: {type(error).__name__}: {error}"
                if self.state == "gone":
                    self._end_recording()
                if self.state != "live" and self.stop_held:
                    self.stop_held = False
                    self.live.tell(self.live.time, "bus", "the stop button holds nothing: the source has ended")
                if self.state != "live" and self.controls is not None:
                    self.controls.end()
                now = time.monotonic()
                status = None
                if now >= status_due or self.state == "gone":
                    status, status_due = self.status(), now + STATUS_EVERY
                asked, self._asked_past = self._asked_past, []
            if picture is not None or status is not None:
                self._tell(picture, status)
            for wanted, give in asked:
                give(self._past(wanted))
            if self.state == "gone":
                return
            due = max(due + 1.0 / PICTURES, time.monotonic())
            self._stop.wait(due - time.monotonic())

    def _look(self) -> Picture | None:
        if isinstance(self.source, LogFile) and self.source.turns != self._turns:
            self._turns = self.source.turns
            self.live.begin_again()
        over = self.source.over  # looked at first: the last block may come just before it
        block = self.source.poll()
        if over and self.state == "live" and not len(block):
            self.state, self.note = "over", self.source.note
            self._end_recording()
        if self.controls is not None and self.controls.failed is not None:
            raise self.controls.failed
        if not len(block):
            return None
        self._heard = time.monotonic()
        self._record(block)
        self._inject(float(block.times[-1]))
        first = self.live.total
        epoch = self.live.epoch
        decoded = self.live.take(block)
        if self.live.epoch != epoch:
            self._rings.clear()
            back = np.flatnonzero(np.diff(block.times) < 0)  # points of the epoch before are not drawn
            row = int(back[-1]) if back.size else -1
            decoded = {message: _after(table, row) for message, table in decoded.items()}
        self._pictures += 1
        picture = Picture(self._pictures, self.live.epoch, first, len(block), float(block.times[-1]))
        for message, table in decoded.items():
            for name, values in table.signals.items():
                number = self._index.get(f"{message}.{name}")
                times, points = reduced(table.times, values)
                if number is not None and len(times):
                    self._rings.setdefault(number, Ring()).add(times, points)
                    picture.add(number, times, points)
        self._add_truth(picture)
        return picture

    def _add_truth(self, picture: Picture) -> None:
        """What a simulated robot truly did, as signals of their own."""
        if not isinstance(self.source, (Simulator, SimulatedRobot)):
            return
        points = self.source.truth()
        times = np.array([time for time, _ in points])
        for name, column, _ in TRUE if points else ():
            values = np.array([truth[column] for _, truth in points])
            self.live.values[name] = float(values[-1])
            number = self._index[name]
            self._rings.setdefault(number, Ring()).add(times, values)
            picture.add(number, *reduced(times, values))

    def _record(self, block: Any) -> None:
        if self._recording is None:
            return
        try:
            self._recording.write(block)
        except UserError as error:  # a full disk ends the log, not the view
            self.live.tell(self.live.time, "bus", str(error))
            self._end_recording()

    def _inject(self, now: float) -> None:
        """Faults of the simulator's scenario, as they begin and end."""
        while self._faults and self._faults[0][0] <= now:
            self.live.tell(self._faults[0][0], "injected", self._faults.pop(0)[1])

    def _note(self, text: str) -> None:
        """Something that the controls did, as an event."""
        with self._lock:
            self.live.tell(self.live.time, "mark", text)

    def _bridge_on(self) -> bool:
        return self.live.values.get("ACTUATE.enable") == 1.0

    # ---------------------------------------------------------------- what browsers ask for

    def hello(self) -> dict[str, Any]:
        """What a browser needs to know of the source before pictures of it."""
        words: Mapping[str, Mapping[str, int]] = {}
        if self._interface is not None:
            from terrapin_hil.telemetry import words as words_of

            words = words_of(self._interface)
        signals = [{"name": n, "unit": self.live.units[n], "words": words.get(n)} for n in self.names]
        limit = self._interface.parameter("slip_limit") if self._interface is not None else None
        radius = self._interface.parameter("radius") if self._interface is not None else None
        return {
            "type": "hello",
            "name": self.source.name,
            "kind": self.kind,
            "drive": {name: {"unit": LIMITS[name][0], "limit": most} for name, most in reach(self._interface).items()}
            if self.controls is not None and self._interface is not None
            else None,
            "command": self.command,
            "watch": self.watch,
            "dbc": self.decoder.path.name,
            "signals": signals,
            "stop": self.can_stop,
            "slip_limit": limit.default * limit.scale if limit is not None else None,
            "speeds": self._interface.parameter("calibrate_steps").default if self._interface is not None else None,
            "radius": radius.default * radius.scale if radius is not None else None,
        }

    def status(self) -> dict[str, Any]:
        """How it stands now, with the events since the last status."""
        new = [e for e in self.live.events if e.number > self._told]
        self._told = self.live.event_count
        if self._recording is not None:
            for event in new:
                self._recording.event(event)
        return {**self._snapshot(), "events": [_plain(e) for e in new]}

    def so_far(self) -> dict[str, Any]:
        """How it stands now, with all events that are kept and were told: for a browser that begins to look."""
        with self._lock:
            return {**self._snapshot(), "events": [_plain(e) for e in self.live.events if e.number <= self._told]}

    def _snapshot(self) -> dict[str, Any]:
        live = self.live
        waited = 0.0 if self.state != "live" else time.monotonic() - self._heard
        return {
            "type": "status",
            "state": self.state,
            "note": self.note,
            "time": _number(live.time),
            "begin": _number(live.begin),
            "epoch": live.epoch,
            "total": live.total,
            "rate": live.rate,
            "load": live.load,
            "health": live.health(waited),
            "silent": waited > 2.0,
            "fit": live.fit,
            "errors": dict(live.errors),
            "bus_off": live.errors.get("bus off", 0),
            "counters": live.counters,
            "lost": self.source.lost,
            "damaged": self.source.damaged if isinstance(self.source, Bus) else 0,
            "faults": [dict(f) for f in live.faults],
            "nodes": live.nodes,
            "values": [_number(live.values.get(name, float("nan"))) for name in self.names],
            "unknown": [
                [f"{i:08X}" if extended else f"{i:03X}", count]
                for (i, extended), count in list(live.unknown.items())[:64]
            ],
            "recording": self._recording.answer() if self._recording is not None else None,
            "last_log": self.last_log,
            "stop_held": self.stop_held,
            "drive": self.controls.answer() if self.controls is not None else None,
            "replay": self._replay(),
        }

    def _replay(self) -> dict[str, Any] | None:
        log = self.source
        if not isinstance(log, LogFile):
            return None
        return {"position": log.position, "length": log.length, "speed": log.speed, "loop": log.loop}

    def replay(self, position: float | None = None, speed: float | None = None, loop: bool | None = None) -> None:
        """Moves in a log, or changes how it is played. Taken where the source is none."""
        with self._lock:
            if not isinstance(self.source, LogFile) or self.state == "gone":
                raise Taken("what is watched is no log, expected one to move in")
            if speed is not None:
                self.source.set_speed(speed)
            if loop is not None:
                self.source.set_loop(loop)
            if position is not None:
                self.source.seek(position)
            if not self.source.over:
                self.state = "live"

    @property
    def can_stop(self) -> str:
        """How it is stopped: bus, simulator, or "" where nothing can be."""
        if self._interface is None or self.kind == "log":
            return ""
        return "simulator" if isinstance(self.source, Simulator) else "bus"

    @property
    def driven(self) -> Controls:
        """What sends to the bus. Taken where the source has no controller to drive."""
        if self.controls is None:
            raise Taken("what is watched cannot be driven, expected a bus with a controller, or the simulated robot")
        if self.state != "live":
            raise Taken("the source has ended, expected one that is live")
        return self.controls

    def past(self, wanted: Collection[int], give: Callable[[bytes], object]) -> None:
        """Gives the points of these signals that are kept as one packet, in its place between the pictures."""
        with self._lock:
            if self.state == "gone":
                give(self._past(wanted))
            else:
                self._asked_past.append((wanted, give))

    def _past(self, wanted: Collection[int]) -> bytes:
        base = self.live.time if self.live.total else 0.0
        picture = Picture(0, self.live.epoch, 0, 0, base)
        for number in wanted:
            if number in self._rings:
                picture.add(number, *self._rings[number].points())
        return picture.packet(frozenset(wanted), PAST)

    def recording(self) -> dict[str, Any] | None:
        """The log that is being written."""
        with self._lock:
            return self._recording.answer() if self._recording is not None else None

    def mark(self, text: str) -> None:
        """Notes an event."""
        with self._lock:
            self.live.mark(text)

    def record(self, path: Path) -> None:
        """Begins a log. Taken when there is one already, UserError when it cannot be written."""
        with self._lock:
            if self.state != "live":
                raise Taken("the source has ended, expected one that is live")
            if self._recording is not None:
                raise Taken(f"{self._recording.path.name} is being recorded, expected to end it first")
            self._recording = Recording(path, self.decoder)

    def stop_recording(self) -> dict[str, Any] | None:
        """Ends the log; what it holds."""
        with self._lock:
            return self._end_recording()

    def _end_recording(self) -> dict[str, Any] | None:
        if self._recording is None:
            return None
        recording, self._recording = self._recording, None
        try:
            recording.close()
        except UserError as error:
            self.live.tell(self.live.time, "bus", str(error))
        self.last_log = recording.answer()
        return self.last_log

    def hold_stop(self, held: bool) -> None:
        """Holds the stop button in, or lets it go. Taken when the source has no controller to stop."""
        with self._lock:
            if not isinstance(self.source, Simulator) and self.controls is None:
                raise Taken("a log has nothing to stop, expected a bus or the simulator")
            if self.state != "live":
                raise Taken("the source has ended, expected one that is live")
            if isinstance(self.source, Simulator):
                self.source.press_stop(held)
            elif self.controls is not None:
                self.controls.hold_stop(held)
            if held != self.stop_held:
                text = "stop button held in" if held else "stop button released"
                self.live.tell(self.live.time, "injected" if isinstance(self.source, Simulator) else "mark", text)
            self.stop_held = held

    def close(self) -> None:
        """Ends the log and lets go of the source."""
        self._stop.set()
        if self.controls is not None:
            self.controls.close()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)
        self.stop_recording()
        self.source.close()


def _kind(source: Source) -> str:
    """Of a source, for the page."""
    if isinstance(source, SimulatedRobot):
        return "robot"
    return "bus" if isinstance(source, Bus) else "simulator" if isinstance(source, Simulator) else "log"


def _injections(source: Simulator) -> list[tuple[float, str]]:
    """Time and words of each fault that the scenario begins or ends."""
    found = []
    for fault in source.scenario.faults:
        words = f"{fault.kind} {fault.channel}".strip()
        found.append((fault.begin, f"{words} injected"))
        if fault.end < FOREVER:
            found.append((fault.end, f"{words} over"))
    return sorted(found)


def _after(table: Decoded, row: int) -> Decoded:
    keep = table.rows > row
    return Decoded(table.rows[keep], table.times[keep], {n: v[keep] for n, v in table.signals.items()})


def _plain(event: Event) -> dict[str, Any]:
    return {**vars(event), "time": _number(event.time)}  # no time before the first frame


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
