"""A log while it is read: where its frames are collected, and what is told about it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames, frames

__all__ = ["BLOCK", "FD_LENGTHS", "SHOWN", "Source", "brief", "message_flags", "no_frame"]

BLOCK = 20_000  # frames: of the slowest reader within half a second (terrapin_tools.bounded)
MOST_BUSES = 256
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # by data length code
BEGIN = 16  # bytes of a file that is none, as they are shown
SHOWN = 60  # characters of a line that gave no frame


_Columns = tuple[list[float], list[int], list[bytes], list[int], list[int]]


@dataclass
class Source:
    """One log. Readers add frames, name buses, and tell what gave no frame."""

    path: Path
    size: int
    told: Callable[[int], None]  # gets the bytes done so far
    cut: str = ""  # what is wrong with the end
    assumed: list[str] = field(default_factory=list)  # how it was read, where the file does not say
    timed: bool = True  # False: it has no times
    buses: list[str] = field(default_factory=list)  # names; Frames.bus counts them
    total: int = 0  # frames so far
    last: float = 0.0  # time of the last one [s]
    first_bus: int = 0  # the number of python-can's channel 0 in the file
    _passed: int = 0
    _first: str = ""
    _columns: _Columns = field(default_factory=lambda: ([], [], [], [], []))

    def bus(self, name: str) -> int:
        """The number of a bus. UserError for more than a log has."""
        if name not in self.buses:
            if len(self.buses) >= MOST_BUSES:
                raise UserError(f"{self.path}: found more than {MOST_BUSES} buses, expected fewer")
            self.buses.append(name)
        return self.buses.index(name)

    def add(self, time: float, identifier: int, data: bytes, flags: int, bus: str = "") -> None:
        """One frame; `bus` by its name."""
        columns = (time, identifier, data, flags, self.bus(bus))
        for column, value in zip(self._columns, columns, strict=True):
            column.append(value)  # type: ignore[attr-defined]
        self.total += 1
        self.last = time

    def add_message(self, message: Any) -> None:
        """One of python-can's messages."""
        flags = message_flags(message)
        data = b"" if flags & REMOTE else bytes(message.data)
        channel = message.channel
        name = "" if channel is None else str(channel + self.first_bus if isinstance(channel, int) else channel)
        self.add(message.timestamp, message.arbitration_id, data, flags, name)

    @property
    def full(self) -> bool:
        """Whether a block is together."""
        return len(self._columns[0]) >= BLOCK

    def take(self) -> Frames:
        """The frames since the last call."""
        block = frames(self.path, *self._columns)
        self._columns = ([], [], [], [], [])
        return block

    def passed(self, place: int, text: str, rows: int = 1) -> None:
        """Rows that gave no frame; `place`: line or number of the first."""
        if not self._passed:
            self._first = f"the first in line {place}: {text.strip()[:SHOWN]!r}" if place else text
        self._passed += rows

    @property
    def lost(self) -> str:
        """What gave no frame, in words."""
        rows = "1 row" if self._passed == 1 else f"{self._passed} rows"
        return f"{rows} gave no frame, {self._first}" if self._passed else ""


def message_flags(message: Any) -> int:
    """Frames.flags of a python-can message. CAN FD has no remote frames: python-can takes an empty one for one."""
    wide = message.is_fd or (message.data is not None and len(message.data) > 8)
    return (
        (EXTENDED if message.is_extended_id else 0)
        | (REMOTE if message.is_remote_frame and not message.is_fd else 0)
        | (ERROR if message.is_error_frame else 0)
        | (FD if wide else 0)
        | (0 if message.is_rx else SENT)
    )


def sound(message: Any) -> bool:
    """Whether a message has as many bytes as it states."""
    if message.is_remote_frame or message.is_error_frame:
        return True
    code = int(message.dlc)
    stated: Iterable[int] = (code, min(8, code), FD_LENGTHS[code] if code < len(FD_LENGTHS) else code)
    return len(message.data) in stated


def no_frame(path: Path, expected: str) -> UserError:
    """A file of whose frames none could be read."""
    with path.open("rb") as file:
        return UserError(f"{path}: begins with {file.read(BEGIN)!r}, and gives no frame; expected {expected}")


def brief(error: Exception) -> str:
    """An exception of a library in one line."""
    text = next(iter(str(error).splitlines()), "")
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
