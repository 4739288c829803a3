"""A CAN bus in time: bits with stuffing, arbitration, a queue at each station.

    bus = BusModel(500_000)
    bus.send("node 0", frame, time)
    bus.run(time + 0.001)              # what arrived: (time, station, frame)
    bus.load, bus.stations["node 0"].sent

Classic CAN with 11-bit identifiers (ISO 11898-1), without errors. Of all stations that have a frame when the bus gets
free the one with the lowest identifier sends; a frame that has begun is not interrupted. A station's own frames leave
in the order of their identifiers, as firmware/ports/stm32f405/can.h has it.
"""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass, field
from functools import lru_cache

from terrapin_hil.links.link import LinkError
from terrapin_hil.messages import Frame

__all__ = ["Arrival", "BusModel", "Station", "frame_bits"]

POLYNOMIAL = 0x4599  # of the CRC-15
AFTER_CRC = 1 + 2 + 7 + 3  # delimiter, acknowledgement, end of frame, space before the next: none is stuffed
QUEUE = 32  # frames of a station that may wait (CAN_OUT_SIZE)

Arrival = tuple[float, str, Frame]  # (s at which its last bit was sent, station, frame)


@lru_cache(maxsize=65536)
def frame_bits(identifier: int, data: bytes) -> int:
    """Bits that a frame takes on the bus, stuffing and the space before the next one included.

    >>> frame_bits(0, bytes(8)) - 47 - 64
    16
    """
    length = 1 + 11 + 3 + 4 + 8 * len(data)  # start, identifier, three dominant bits, length, data
    bits = (identifier << 7 | len(data)) << 8 * len(data) | int.from_bytes(data)
    crc = 0
    for i in range(length - 1, -1, -1):
        carry = (crc >> 14 ^ bits >> i) & 1
        crc = crc << 1 & 0x7FFF ^ (POLYNOMIAL if carry else 0)
    bits, length = bits << 15 | crc, length + 15
    stuffed, run, last = 0, 0, -1
    for i in range(length - 1, -1, -1):
        bit = bits >> i & 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:  # a bit of the other kind follows, and counts itself
            stuffed, run, last = stuffed + 1, 1, 1 - bit
    return length + stuffed + AFTER_CRC


@dataclass
class Station:
    """What one station has sent. `waiting` by identifier, then by age: (identifier, number, s of its sending, data)."""

    waiting: list[tuple[int, int, float, bytes]] = field(default_factory=list)
    sent: int = 0
    replaced: int = 0  # a newer frame of the same identifier came while it waited
    lost: int = 0  # its queue was full
    latest: dict[int, float] = field(default_factory=dict)  # identifier -> longest time from sending to arrival [s]


class BusModel:
    """The bus at `bit_rate` [bit/s]. Times rise from call to call [s]."""

    def __init__(self, bit_rate: float) -> None:
        self.bit_rate = bit_rate
        self.stations: dict[str, Station] = {}
        self.busy = 0.0  # s in which a frame was under way
        self._free = 0.0  # when the last one has left
        self._under_way: tuple[str, int, float, bytes] | None = None  # it then arrives: station, identifier, sent, data
        self._number = 0

    def send(self, name: str, frame: Frame, time: float, replace: bool = False) -> None:
        """A station wants to send from `time` on. `replace`: in the place of an older one that still waits."""
        station = self.stations.setdefault(name, Station())
        self._number += 1
        identifier, data = frame
        entry = identifier, self._number, time, data
        if replace:
            for i, old in enumerate(station.waiting):
                if old[0] == identifier:
                    station.waiting[i] = entry
                    station.replaced += 1
                    return
        insort(station.waiting, entry)
        if len(station.waiting) > QUEUE:
            station.waiting.pop()
            station.lost += 1

    def _next(self, time: float) -> tuple[str, tuple[int, int, float, bytes]] | None:
        """Who wins the arbitration at `time`. LinkError when two stations send the same identifier."""
        found: list[tuple[int, str, tuple[int, int, float, bytes]]] = []
        for name, station in self.stations.items():
            ready = next((entry for entry in station.waiting if entry[2] <= time), None)
            if ready is not None:
                found.append((ready[0], name, ready))
        if not found:
            return None
        found.sort(key=lambda each: each[0])
        if len(found) > 1 and found[0][0] == found[1][0]:
            raise LinkError(
                f"bus: {found[0][1]} and {found[1][1]} both send 0x{found[0][0]:03X}: two nodes with one number"
            )
        return found[0][1], found[0][2]

    def run(self, until: float) -> list[Arrival]:
        """What arrives up to `until`; every station hears it."""
        arrived: list[Arrival] = []
        while True:
            if self._under_way is not None:
                if self._free > until:
                    return arrived
                name, identifier, sent, data = self._under_way
                station = self.stations[name]
                station.sent += 1
                station.latest[identifier] = max(station.latest.get(identifier, 0.0), self._free - sent)
                arrived.append((self._free, name, (identifier, data)))
                self._under_way = None
            wanted = min((e[2] for s in self.stations.values() for e in s.waiting), default=until)
            begin = max(self._free, wanted)
            winner = self._next(begin) if begin < until else None
            if winner is None:
                return arrived
            name, entry = winner
            self.stations[name].waiting.remove(entry)
            identifier, _, sent, data = entry
            seconds = frame_bits(identifier, data) / self.bit_rate
            self._free = begin + seconds
            self.busy += seconds
            self._under_way = name, identifier, sent, data

    def load(self, seconds: float) -> float:
        """Share of `seconds` in which the bus was busy."""
        return self.busy / seconds
