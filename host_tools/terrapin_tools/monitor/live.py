"""What is known of a bus right now: latest values, rates, faults, events, health. No display, no threads."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.links.names import EMPTY_BUS
from terrapin_hil.messages import Interface
from terrapin_hil.nodes import Node
from terrapin_tools.logs.decoding import Decoded, Decoder
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, Frames
from terrapin_tools.logs.nodes import ELSEWHERE, others, renamed

__all__ = ["Event", "Live", "Trace"]


WINDOW = 1.0  # s over which rates and load are counted
EVENTS = 500  # that are kept
POINTS = 20_000  # of one plotted signal that are kept
BLOCKS = 1000  # of frames within WINDOW, more than any poll makes: a bus whose clock stands still has no end to it
IDENTIFIERS = 4096  # that are unknown and counted one by one; an extended one may be any of 2^29
SAME_NODE = 4  # controllers with one number that are told, at most
SILENT = 2.0  # s without a frame before the bus is called silent
BACK, AHEAD = 0.5, 10.0  # s that a clock may step back (frames of several channels do), or a bus be silent, untold
JUDGED = 50  # frames after which a DBC that knows few of them is told
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


# Of every controller on the bus, beside all signals of the one that is watched.
OF_EACH = ("STATUS.state", "STATUS.faults", "MOTION.slip", "GROUND.torque", "ELECTRICAL.current")


@dataclass(frozen=True)
class Event:
    """Something that happened at `time` [s] of the bus."""

    time: float
    kind: str  # state, fault, report, limiter, parameter, injected, mark, clock, bus
    text: str
    number: int = 0  # counts events


@dataclass
class Trace:
    """The latest points of a signal that is plotted."""

    times: deque[float] = field(default_factory=lambda: deque(maxlen=POINTS))
    values: deque[float] = field(default_factory=lambda: deque(maxlen=POINTS))


class Live:
    """Takes frames as they come. Values are in the units of the DBC; `interface` gives faults their words.

    With an interface the frames are those of one `node`; what others send is counted.
    """

    def __init__(
        self, decoder: Decoder | None, interface: Interface | None, bitrate: int = 500_000, node: int = 0
    ) -> None:
        self._decoder = decoder
        self._node = node if interface else None
        self.others: Counter[int] = Counter()  # node number -> frames of other controllers on the bus
        self._beside: dict[int, dict[str, float]] = {}  # node number -> OF_EACH of another controller
        self._unique: dict[int, float] = {}  # of the controllers that say they are this node -> time
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
        self._latest = 0.0
        self.total = 0
        self.errors: dict[str, int] = {}
        self.unknown: dict[tuple[int, bool], int] = {}  # frames that the DBC does not know
        self._recent: deque[tuple[float, int, int]] = deque(maxlen=BLOCKS)  # time, frames, bits of each block
        self._parameters = {p.index: p for p in interface.parameters.values()} if interface else {}
        self._data_frames = self._known = 0
        self._short: dict[str, int] = {}  # message -> frames with fewer bytes than the DBC says
        self._lengths = {str(m.name): int(m.length) for m in decoder.messages.values()} if decoder else {}
        self.counters: tuple[int, int] | None = None  # error counters of sending and receiving, once told
        self.begin = float("nan")  # of the first frame of the epoch
        self._anew = False
        self.epoch = 0  # counts steps back of the clock: times of one epoch rise
        self.event_count = 0
        if decoder is not None:
            for message in decoder.messages.values():
                self.units.update(
                    {
                        f"{message.name}.{name}": "" if unit == "1" else unit
                        for name, unit in decoder.units(message.name)
                    }
                )

    @property
    def robot(self) -> bool:
        """Whether it speaks the controller's interface."""
        return self._node is not None

    def plot(self, signal: str, shown: bool) -> None:
        """Start or stop keeping the points of a signal."""
        if shown:
            self.traces.setdefault(signal, Trace())
        else:
            self.traces.pop(signal, None)

    def mark(self, text: str) -> None:
        """Notes an event of the user's, now."""
        self.tell(self.time, "mark", text)

    def tell(self, time: float, kind: str, text: str) -> None:
        """Notes an event."""
        self.event_count += 1
        self.events.append(Event(time, kind, text, self.event_count))

    def take(self, block: Frames) -> Mapping[str, Decoded]:
        """The next frames; their messages, decoded."""
        if not len(block):
            return {}
        self._clock(block)
        self.time = float(block.times[-1])
        self.total += len(block)
        self._count(block)
        if self._decoder is None:
            return {}
        if self._node is not None:
            beside = others(block, self._node)
            self.others.update(beside)
            for number in beside:
                self._look_beside(block, number, self._decoder)
            block = renamed(block, self._node)
        seen = np.zeros(len(block), dtype=bool)
        decoded = self._decoder.decode(block)
        for message, table in decoded.items():
            seen[table.rows] = True
            self._check_length(message, block.lengths[table.rows])
            if message in ("PARAMETER_WRITE", "PARAMETER_VALUE"):
                self._parameter(message, table)
            if message in ("PORT_IDENTITY", "NODE_STATUS") and self._node is not None:
                self._identity(table)
            for name, values in table.signals.items():
                key = f"{message}.{name}"
                trace = self.traces.get(key)
                if trace is not None:
                    trace.times.extend(table.times.tolist())
                    trace.values.extend(values.tolist())
                self._watch(key, table.times, values)
                self.values[key] = float(values[-1])
                self.times[key] = float(table.times[-1])
        foreign = (block.identifiers >= ELSEWHERE) & (block.flags & EXTENDED == 0)  # another node's
        rest = block.pick(~seen & ~foreign & (block.flags & 0b110 == 0))
        for identifier, flags in zip(rest.identifiers.tolist(), rest.flags.tolist(), strict=True):
            unknown = (identifier, bool(flags & EXTENDED))
            if unknown in self.unknown or len(self.unknown) < IDENTIFIERS:
                self.unknown[unknown] = self.unknown.get(unknown, 0) + 1
        self._data_frames += int(seen.sum()) + len(rest)
        self._known += int(seen.sum())
        return decoded

    def begin_again(self) -> None:
        """What comes next is of another time, on purpose: plots begin anew, and nothing is told of the clock."""
        self._anew = True

    def _clock(self, block: Frames) -> None:
        """Steps back begin another epoch: plots begin anew. Long silences are told."""
        if not self.total:
            self._latest = self.begin = float(block.times[0])
        elif self._anew:
            self._latest = float(block.times[0])
            self._begin_epoch(self._latest)
        self._anew = False
        steps = np.diff(block.times, prepend=self._latest)
        for row in np.flatnonzero((steps < -BACK) | (steps > AHEAD)).tolist():
            step = float(steps[row])
            if step < 0:
                self.tell(float(block.times[row]), "clock", f"the clock steps back by {-step:.3f} s")
                self._begin_epoch(float(block.times[row]))
            else:
                text = f"no frame for {step:.3f} s, or the clock jumped ahead"
                self.tell(float(block.times[row]), "clock", text)
        self._latest = float(block.times[-1])

    def _begin_epoch(self, time: float) -> None:
        self.epoch += 1
        self.begin = time
        self._recent.clear()
        for trace in self.traces.values():
            trace.times.clear()
            trace.values.clear()

    def _look_beside(self, block: Frames, number: int, decoder: Decoder) -> None:
        """Notes the last values of OF_EACH of another controller."""
        node = Node(number)
        wanted = {node.identifier(name.partition(".")[0]) for name in OF_EACH}
        own = np.isin(block.identifiers, list(wanted)) & (block.flags & EXTENDED == 0)
        decoded = decoder.decode(renamed(block.pick(own), number)) if own.any() else {}
        for name in OF_EACH:
            message, _, signal = name.partition(".")
            if message in decoded and np.isfinite(value := float(decoded[message].signals[signal][-1])):
                self._beside.setdefault(number, {})[name] = value

    @property
    def said(self) -> dict[int, str]:
        """Node number -> state and faults of another controller, in words, once its STATUS has come."""
        found = {number: self._in_words(values) for number, values in self._beside.items()}
        return {number: text for number, text in found.items() if text}

    def _in_words(self, values: Mapping[str, float]) -> str:
        """State and faults; "" when no STATUS has come."""
        if "STATUS.state" not in values:
            return ""
        state, faults = int(values["STATUS.state"]), int(values.get("STATUS.faults", 0.0))
        word = self._words.get("state", {}).get(state, str(state))
        return ": ".join([word, *([", ".join(map(self._fault, _bits(faults)))] if faults else [])])

    @property
    def nodes(self) -> list[dict[str, Any]]:
        """Every controller on the bus by its number: whether it is the one that is watched, state and faults in words,
        and the other signals of OF_EACH, None while one has not come. Empty without an interface."""
        if self._node is None:
            return []
        rows = {number: self._beside.get(number, {}) for number in self.others}
        rows[self._node] = {name: v for name in OF_EACH if (v := self.values.get(name, math.nan)) == v}
        return [
            {"node": number, "watched": number == self._node, "said": self._in_words(values)}
            | {name: values.get(name) for name in OF_EACH[2:]}
            for number, values in sorted(rows.items())
        ]

    def _check_length(self, message: str, lengths: Index) -> None:
        short = int((lengths < self._lengths[message]).sum())
        if short:
            self._short[message] = self._short.get(message, 0) + short

    def _parameter(self, message: str, table: Decoded) -> None:
        """Writes, and answers that refuse one."""
        for row, time in enumerate(table.times.tolist()):
            index, value = (table.signals.get(name, np.full(row + 1, np.nan))[row] for name in ("index", "value"))
            parameter = self._parameters.get(int(index)) if index == index else None
            if parameter is None or value != value:
                continue
            status = float(table.signals["status"][row]) if message == "PARAMETER_VALUE" else -1.0
            if status == 0.0:
                continue  # the write was told
            unit = "" if parameter.unit == "1" else f" {parameter.unit}"
            text = f"{parameter.name} = {value * parameter.scale:.6g}{unit}"
            refused = self._words.get("parameter_status", {}).get(int(status), "refused") if status > 0 else ""
            self.tell(time, "parameter", f"{parameter.name} refused: {refused}" if refused else text)

    def _identity(self, table: Decoded) -> None:
        """Two controllers that are the same node are told once, and a few more."""
        for time, unique in zip(table.times.tolist(), table.signals["unique"].tolist(), strict=True):
            if unique == unique and unique and len(self._unique) < SAME_NODE:
                new = int(unique) not in self._unique
                self._unique[int(unique)] = time
                if new and len(self._unique) > 1:
                    both = ", ".join(f"{number:08x}" for number in self._unique)
                    self.tell(time, "bus", f"{len(self._unique)} controllers have node number {self._node}: {both}")

    @property
    def fit(self) -> str:
        """What speaks against the DBC, in a line; "" when nothing does."""
        if self._data_frames >= JUDGED and self._known < 0.1 * self._data_frames:
            names = ", ".join(f"{i:08X}" if extended else f"{i:03X}" for i, extended in list(self.unknown)[:4])
            return f"the DBC knows {self._known} of {self._data_frames} frames (unknown: {names}): another DBC?"
        if self._short:
            message, count = max(self._short.items(), key=lambda item: item[1])
            expected = self._lengths[message]
            return f"{count} frames of {message} have fewer than the {expected} bytes that the DBC says: another DBC?"
        return ""

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
                    if text not in self.errors or bit == 0x040:
                        self.tell(float(block.times[row]), "bus", text)
                    self.errors[text] = self.errors.get(text, 0) + 1
            if int(block.identifiers[row]) & 0x204 and block.lengths[row] >= 8:
                self.counters = int(block.data[row, 6]), int(block.data[row, 7])

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
            self.tell(float(times[row]), kind, self._say(kind, int(old or 0), int(values[row])))

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
            return f"nothing received for {waited:.0f} s: {EMPTY_BUS}"
        worst = ", ".join(f"{text} ({count})" for text, count in self.errors.items())
        if self.counters is not None:
            worst += f"; error counters: sending {self.counters[0]}, receiving {self.counters[1]}"
        if self.fit:
            return self.fit
        said = self.said
        beside = ", ".join(f"node {number} {said.get(number, '')}".strip() for number in sorted(self.others))
        return (f"error frames: {worst}" if worst else "no error frames") + (
            f"; also on it: {beside}" if beside else ""
        )


def _bits(value: int) -> list[int]:
    return [n for n in range(value.bit_length()) if value >> n & 1]
