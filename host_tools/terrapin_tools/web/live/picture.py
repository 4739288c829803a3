"""Pictures of what is watched: binary packets with few points of each signal, and the frames that they stand for."""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array

__all__ = ["HEADER", "PAST", "Picture", "Ring", "reduced"]

HISTORY = 8192  # points of each signal that are kept for a browser that begins to look
HEADER = struct.Struct("<BBHIIIdd")  # version, kind, columns, number, epoch, frames, first frame, base time [s]
COLUMN = struct.Struct("<HH")  # signal, points; then float32 pairs (s after the base, value)
SAMPLES, PAST = 1, 2  # kinds of packets


def reduced(times: Array, values: Array, most: int = 4) -> tuple[Array, Array]:
    """At most `most` points that keep lowest and highest, in order of time; NaN is left out.

    >>> t, v = reduced(np.arange(100.0), np.where(np.arange(100) == 70, 9.0, 0.0))
    >>> len(t), float(v.max())
    (4, 9.0)
    """
    there = ~np.isnan(values)
    if not there.all():
        times, values = times[there], values[there]
    if len(values) <= most:
        return times, values
    chosen: list[int] = []
    pieces = most // 2
    for piece in range(pieces):
        a, b = len(values) * piece // pieces, len(values) * (piece + 1) // pieces
        chosen += sorted((a + int(values[a:b].argmin()), a + int(values[a:b].argmax())))
    return times[chosen], values[chosen]


class Ring:
    """The latest points of one signal."""

    def __init__(self) -> None:
        self._times = np.zeros(HISTORY)
        self._values = np.zeros(HISTORY, dtype=np.float32)
        self._count = 0

    def add(self, times: Array, values: Array) -> None:
        place = (self._count + np.arange(len(times))) % HISTORY
        self._times[place], self._values[place] = times, values
        self._count += len(times)

    def points(self) -> tuple[Array, npt.NDArray[np.float32]]:
        begin = max(0, self._count - HISTORY)
        place = np.arange(begin, self._count) % HISTORY
        return self._times[place], self._values[place]


class Picture:
    """What one packet may say: few points of every signal that came, and the frames that they stand for."""

    def __init__(self, number: int, epoch: int, first: int, frames: int, base: float) -> None:
        self.number = number
        self._head = (epoch, frames, float(first), base)
        self._columns: dict[int, bytes] = {}
        self._packets: dict[frozenset[int], bytes] = {}

    def add(self, signal: int, times: Array, values: Array | npt.NDArray[np.float32]) -> None:
        pairs = np.empty((len(times), 2), dtype="<f4")
        with np.errstate(over="ignore"):  # beyond float32: infinite, and not drawn
            pairs[:, 0], pairs[:, 1] = times - self._head[3], values
        self._columns[signal] = COLUMN.pack(signal, len(times)) + pairs.tobytes()

    def packet(self, wanted: frozenset[int], kind: int = SAMPLES) -> bytes:
        """For a browser that looks at these signals."""
        if wanted not in self._packets:
            epoch, frames, first, base = self._head
            columns = [self._columns[s] for s in sorted(wanted & self._columns.keys())]
            head = HEADER.pack(1, kind, len(columns), self.number, epoch, frames, first, base)
            self._packets[wanted] = head + b"".join(columns)
        return self._packets[wanted]
