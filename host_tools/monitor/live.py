"""What is known of a bus right now: latest values, rates, faults, events, health. No display, no threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hil.messages import Interface
from host_tools.logs.decoding import Decoder
from host_tools.logs.frames import ERROR, EXTENDED, FD, Frames

__all__ = ["Event", "Live", "Trace"]

Array = npt.NDArray[np.float64]

WINDOW = 1.0  # s over which rates and load are counted
EVENTS = 500  # that are kept
POINTS = 20_000  # of one plotted signal that are kept
SILENT = 2.0  # s without a frame before the bus is called silent
OVERHEAD, OVERHEAD_EXTENDED = 47, 67  # bits of a frame beside its data, gap included, before stuffing

# Error frames as SocketCAN gives them: bit of the identifier -> what it says
_ERRORS = {
    0x001: "sending timed out",
    0x004: "controller",
    0x008: "protocol violation",
    0x010: "transceiver",
    0x020: "nobody acknowledges: no other node, wrong bit rate, or a broken wire",
    0x040: "bus off",
    0x080: "bus error",
    0x100: "restarted",
}


@dataclass(frozen=True)
class Event:
    """Something that happened at `time` [s] of the bus."""

    time: float
    kind: str  # state, fault, report, limiter, mark, bus
    text: str


@dataclass
class Trace:
    """The latest points of a signal that is plotted."""

    times: deque[float] = field(default_factory=lambda: deque(maxlen=POINTS))
    values: deque[float] = field(default_factory=lambda: deque(maxlen=POINTS))


class Live:
    """Takes frames as they come. Values are in the units of the DBC; `interface` gives faults their words."""

    def __init__(self, decoder: Decoder | None, interface: Interface | None, bitrate: int = 500_000) -> None:
        self._decoder = decoder
        self._faults = {f["number"]: f for f in interface.json["faults"]} if interface else {}
        self._words = (
            {name: {v: word for word, v in values.items()} for name, values in interface.enums.items()}
            if interface
            else {}
        )
        self._bitrate = bitrate
        self.values: dict[str, float] = {}
        self.units: dict[str, str] = {}
        self.times: dict[str, float] = {}  # of the message of each signal
        self.traces: dict[str, Trace] = {}
        self.events: deque[Event] = deque(maxlen=EVENTS)
        self.time = float("nan")  # of the last frame
        self.total = 0
        self.errors: dict[str, int] = {}
        self.unknown: dict[tuple[int, bool], int] = {}  # frames that the DBC does not know
        self._recent: deque[tuple[float, int, int]] = deque()  # time, frames, bits of each block
        self._silent_since: float | None = None
        if decoder is not None:
            for message in decoder.messages.values():
                self.units.update(
                    {
                        f"{message.name}.{name}": "" if unit == "1" else unit
                        for name, unit in decoder.units(message.name)
                    }
                )

    def plot(self, signal: str, shown: bool) -> None:
        """Start or stop keeping the points of a signal."""
        if shown:
            self.traces.setdefault(signal, Trace())
        else:
            self.traces.pop(signal, None)

    def mark(self, text: str) -> None:
        """Notes an event of the user's, now."""
        self.events.append(Event(self.time, "mark", text))

    def take(self, block: Frames) -> None:
        """The next frames."""
        if not len(block):
            return
        self.time = float(block.times[-1])
        self.total += len(block)
        self._count(block)
        if self._decoder is None:
            return
        seen = np.zeros(len(block), dtype=bool)
        for message, table in self._decoder.decode(block).items():
            seen[table.rows] = True
            for name, values in table.signals.items():
                key = f"{message}.{name}"
                trace = self.traces.get(key)
                if trace is not None:
                    trace.times.extend(table.times.tolist())
                    trace.values.extend(values.tolist())
                self._watch(key, table.times, values)
                self.values[key] = float(values[-1])
                self.times[key] = float(table.times[-1])
        rest = block.pick(~seen & (block.flags & 0b110 == 0))
        for identifier, flags in zip(rest.identifiers.tolist(), rest.flags.tolist(), strict=True):
            unknown = (identifier, bool(flags & EXTENDED))
            if unknown in self.unknown or len(self.unknown) < 4096:
                self.unknown[unknown] = self.unknown.get(unknown, 0) + 1

    def _count(self, block: Frames) -> None:
        extended = (block.flags & EXTENDED) != 0
        bits = np.where(extended, OVERHEAD_EXTENDED, OVERHEAD) + 8 * block.lengths
        bits = np.where(block.flags & FD, OVERHEAD + 8 * block.lengths // 4, bits)  # data at a faster rate
        late = block.times > self.time - WINDOW
        self._recent.append((self.time, int(late.sum()), int(bits[late].sum())))
        while self._recent and self._recent[0][0] < self.time - WINDOW:
            self._recent.popleft()
        for row in np.flatnonzero(block.flags & ERROR):
            for bit, text in _ERRORS.items():
                if int(block.identifiers[row]) & bit:
                    if text not in self.errors:
                        self.events.append(Event(float(block.times[row]), "bus", text))
                    self.errors[text] = self.errors.get(text, 0) + 1

    def _watch(self, key: str, times: Array, values: Array) -> None:
        """Changes of state, faults, reports and limiter are events."""
        kinds = {
            "STATUS.state": "state",
            "STATUS.faults": "fault",
            "STATUS.report": "report",
            "ACTUATE.limiting": "limiter",
        }
        kind = kinds.get(key)
        if kind is None or not self._faults:
            return
        before = self.values.get(key)
        steps = np.flatnonzero(np.diff(values, prepend=values[0] if before is None else before))
        for row in steps.tolist():
            old = values[row - 1] if row else before
            self.events.append(Event(float(times[row]), kind, self._say(kind, int(old or 0), int(values[row]))))

    def _say(self, kind: str, old: int, new: int) -> str:
        if kind == "fault":
            gone = [f"{self._fault(n)} gone" for n in _bits(old & ~new)]
            return ", ".join([self._fault(n) for n in _bits(new & ~old)] + gone)
        if kind == "limiter":
            return "limiter holds the output" if new else "limiter lets go"
        words = self._words.get(kind, {})
        return f"{kind} {words.get(new, str(new))}"

    def _fault(self, number: int) -> str:
        return str(self._faults.get(number, {}).get("name", f"fault {number}"))

    def word(self, enum: str, signal: str) -> str:
        """A signal's value as its word; "-" while it has not come."""
        value = self.values.get(signal)
        if value is None or value != value:
            return "-"
        return self._words.get(enum, {}).get(int(value), f"{value:g}")

    @property
    def faults(self) -> list[Mapping[str, str]]:
        """Faults that are set: name, cause, reaction."""
        value = self.values.get("STATUS.faults", 0.0)
        return [self._faults.get(n, {"name": f"fault {n}", "cause": "", "reaction": ""}) for n in _bits(int(value))]

    @property
    def rate(self) -> float:
        """Frames a second."""
        return sum(count for _, count, _ in self._recent) / WINDOW

    @property
    def load(self) -> float:
        """Share of the bus in use, stuff bits (up to a fifth more) not counted."""
        return sum(bits for _, _, bits in self._recent) / WINDOW / self._bitrate

    def health(self, waited: float) -> str:
        """One line on the bus. `waited`: s since a frame came, by the clock of whoever looks."""
        if waited > SILENT:
            self._recent.clear()
            hint = "is the bus up, the bit rate right, another node there to acknowledge?"
            return f"nothing received for {waited:.0f} s: {hint}"
        worst = ", ".join(f"{text} ({count})" for text, count in self.errors.items())
        return f"error frames: {worst}" if worst else "no error frames"


def _bits(value: int) -> list[int]:
    return [n for n in range(value.bit_length()) if value >> n & 1]
