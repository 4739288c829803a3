"""Frames of a CAN log as arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array, Index
from terrapin_tools.errors import UserError

__all__ = ["ERROR", "EXTENDED", "FD", "REMOTE", "SENT", "Frames", "frames", "joined", "writing"]


EXTENDED, REMOTE, ERROR, FD, SENT = 1, 2, 4, 8, 16  # bits of Frames.flags; SENT: by who kept the log


@dataclass(frozen=True)
class Frames:
    """Frames of a log in order: times [s], identifiers, lengths, data padded with zeros to 8 bytes (64 with CAN FD)."""

    path: Path
    times: Array
    identifiers: Index
    lengths: Index
    data: npt.NDArray[np.uint8]  # (frames, 8 or 64)
    flags: npt.NDArray[np.uint8]
    bus: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))  # number of the bus; default: 0

    def __post_init__(self) -> None:
        if len(self.bus) != len(self.times):
            object.__setattr__(self, "bus", np.zeros(len(self.times), np.uint8))

    def __len__(self) -> int:
        return len(self.times)

    def pick(self, chosen: npt.NDArray[Any]) -> Frames:
        """Those frames that a mask (frames,) keeps, or an index names, in its order."""
        return Frames(
            self.path,
            self.times[chosen],
            self.identifiers[chosen],
            self.lengths[chosen],
            self.data[chosen],
            self.flags[chosen],
            self.bus[chosen],
        )

    @property
    def data_frames(self) -> Frames:
        """Without remote and error frames."""
        return self.pick(self.flags & (REMOTE | ERROR) == 0)

    def payload(self, row: int) -> bytes:
        """Data of one frame."""
        return self.data[row, : self.lengths[row]].tobytes()


def frames(
    path: Path,
    times: Sequence[float] | Array,
    identifiers: Sequence[int],
    payloads: Sequence[bytes],
    flags: Sequence[int],
    bus: Sequence[int] = (),
) -> Frames:
    """Frames from lists."""
    width = 8 if all(len(payload) <= 8 for payload in payloads) else 64
    data = np.frombuffer(b"".join(p.ljust(width, b"\0") for p in payloads), dtype=np.uint8).reshape(-1, width)
    return Frames(
        path,
        np.array(times, dtype=np.float64),
        np.array(identifiers, dtype=np.int64),
        np.array([len(payload) for payload in payloads], dtype=np.int64),
        data,
        np.array(flags, dtype=np.uint8),
        np.array(bus, dtype=np.uint8),
    )


def joined(path: Path, parts: Sequence[Frames]) -> Frames:
    """Frames of several pieces of one log."""
    if not parts:
        return frames(path, [], [], [], [])
    width = max(part.data.shape[1] for part in parts)
    return Frames(
        path,
        np.concatenate([part.times for part in parts]),
        np.concatenate([part.identifiers for part in parts]),
        np.concatenate([part.lengths for part in parts]),
        np.concatenate([np.pad(part.data, ((0, 0), (0, width - part.data.shape[1]))) for part in parts]),
        np.concatenate([part.flags for part in parts]),
        np.concatenate([part.bus for part in parts]),
    )


@contextmanager
def writing(log: Path) -> Iterator[None]:
    """A log that cannot be written is a UserError (status 1)."""
    try:
        yield
    except OSError as error:
        raise UserError(f"{log}: cannot write the log: {error.strerror or error}", status=1) from None
