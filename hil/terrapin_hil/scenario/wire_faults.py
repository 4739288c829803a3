"""Faults of the bus between host and controller: damaged, repeated, foreign and absurd frames, and somebody's STOP_ALL.

A run in this process has no bus; one with such a fault goes through the firmware's dispatcher, frame by frame. The log
keeps the host's frames as they were before.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable

from terrapin_hil.messages import Frame, Interface, Message, interface, protect
from terrapin_hil.scenario.faults import WIRE, Fault

__all__ = ["Disturbance"]

TICK = 1e-3  # s
FOREIGN = (0x00F, 0x090, 0x0B0, 0x0FF, 0x17F, 0x3C0, 0x555, 0x7DF, 0x7FF)  # no message has these, at any node
OURS = ("COMMAND", "PARAMETER_WRITE", "TEST_MODE", "SENSORS_SLOW", "SENSORS_FAST")  # but damaged


class Disturbance:
    """What `faults` make of the frames of each tick; a function of the faults, the seed and the frames before."""

    def __init__(self, faults: Iterable[Fault], seed: int, description: Interface | None = None) -> None:
        self.faults = [fault for fault in faults if fault.kind in WIRE]
        self._interface = description or interface()
        self._random = random.Random(seed)
        self._counter = 0  # of the last COMMAND that passed unharmed
        assert not set(FOREIGN) & set(self._interface.by_id)

    def checkpoint(self) -> Disturbance:
        """Its state, for `restored`: apart from this object."""
        return self.restored(self)

    @classmethod
    def restored(cls, kept: Disturbance) -> Disturbance:
        """One in the state of `kept`."""
        found = cls(kept.faults, 0, kept._interface)
        found._random.setstate(kept._random.getstate())
        found._counter = kept._counter
        return found

    def apply(self, tick: int, frames: list[Frame]) -> list[Frame]:
        """The frames of `tick` as they arrive."""
        for fault in self.faults:
            if fault.begin <= tick * TICK < fault.end:
                frames = _APPLY[fault.kind](self, fault, frames)
        for identifier, data in frames:
            if identifier == self._interface.messages["COMMAND"].id and len(data) == 8:
                self._counter = data[6] & 0xF
        return frames

    def _each(self, name: str, frames: list[Frame], change: Callable[[Message, bytes], bytes]) -> list[Frame]:
        message = self._interface.messages[name]
        return [(i, change(message, data) if i == message.id else data) for i, data in frames]

    def _crc(self, fault: Fault, frames: list[Frame]) -> list[Frame]:
        flip = self._random.randint(1, 255)
        return self._each("COMMAND", frames, lambda _, data: data[:7] + bytes([data[7] ^ flip]))

    def _repeat(self, fault: Fault, frames: list[Frame]) -> list[Frame]:
        return self._each("COMMAND", frames, lambda message, data: protect(message.id, data, self._counter))

    def _extreme(self, message: Message, data: bytes, names: tuple[str, ...]) -> bytes:
        raw = message.decode(data)
        for signal in message.signals:
            if signal.name in names:
                raw[signal.name] = self._random.choice((signal.minimum, signal.maximum))
        changed, _ = message.encode(raw)
        return protect(message.id, changed, raw["counter"]) if message.e2e else changed

    def _extremes(self, fault: Fault, frames: list[Frame]) -> list[Frame]:
        outside = ("swing_angle", "swing_rate", "pitch", "ground_speed")
        frames = self._each("SENSORS_SLOW", frames, lambda m, data: self._extreme(m, data, outside))
        return self._each("COMMAND", frames, lambda m, data: self._extreme(m, data, ("setpoint",)))

    def _damaged(self, name: str) -> Frame:
        message = self._interface.messages[name]
        data = self._random.randbytes(message.length)
        if message.e2e and self._random.random() < 0.5:
            good = protect(message.id, data, data[6])
            return message.id, good[:7] + bytes([good[7] ^ self._random.randint(1, 255)])
        return message.id, data[: self._random.randrange(message.length)]

    def _babble(self, fault: Fault, frames: list[Frame]) -> list[Frame]:
        babbled = list(frames)
        for _ in range(round(fault.value)):
            foreign = (self._random.choice(FOREIGN), self._random.randbytes(self._random.randint(0, 8)))
            frame = foreign if self._random.random() < 0.7 else self._damaged(self._random.choice(OURS))
            babbled.insert(self._random.randint(0, len(babbled)), frame)
        return babbled

    def _tick_repeated(self, fault: Fault, frames: list[Frame]) -> list[Frame]:
        return [*frames, *(frame for frame in frames if frame[0] == self._interface.messages["SENSORS_FAST"].id)]

    def _stop_all(self, fault: Fault, frames: list[Frame]) -> list[Frame]:
        stop = self._interface.messages["STOP_ALL"]
        return [(stop.id, stop.encode({"request": self._interface.enums["request"]["idle"]})[0]), *frames]


_APPLY: dict[str, Callable[[Disturbance, Fault, list[Frame]], list[Frame]]] = {
    "command_crc": Disturbance._crc,
    "command_counter": Disturbance._repeat,
    "extremes": Disturbance._extremes,
    "babble": Disturbance._babble,
    "tick_repeated": Disturbance._tick_repeated,
    "stop_all": Disturbance._stop_all,
}
