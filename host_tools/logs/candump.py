"""CAN logs as candump text: `(12.345000) can0 182#0011223344556677`, one frame a line.

>>> line(12.345, 0x182, bytes([0, 0xFF]))
'(12.345000) can0 182#00FF'
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.messages import Interface
from hil.telemetry import decode
from host_tools.errors import UserError

__all__ = ["Frames", "line", "lines", "read", "telemetry"]

Array = npt.NDArray[np.float64]

_LINE = re.compile(r"\((\d+(?:\.\d+)?)\) (\S+) ([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#([0-9A-Fa-f]*|R\d?)(?: [RT])?\s*")


@dataclass(frozen=True)
class Frames:
    """Frames of a log in order: times [s], identifiers, lengths, and data padded with zeros to 8 bytes."""

    path: Path
    times: Array
    identifiers: npt.NDArray[np.int64]
    lengths: npt.NDArray[np.int64]
    data: npt.NDArray[np.uint8]  # (frames, 8)


def line(time: float, identifier: int, data: bytes, channel: str = "can0") -> str:
    """One frame with an 11-bit identifier, without the end of line."""
    return f"({time:.6f}) {channel} {identifier:03X}#{data.hex().upper()}"


def lines(records: npt.NDArray[Any], first_tick: int, channel: str = "can0") -> str:
    """Rows of a simulator's log (see hil.simulation) as text: per tick what the host sent, then the answers."""
    out = []
    columns = zip(
        records["host_count"].tolist(),
        records["answer_count"].tolist(),
        records["host"].tolist(),
        records["answer"].tolist(),
        strict=True,
    )
    for tick, (sent, answered, host, answer) in enumerate(columns, first_tick):
        stamp = f"({tick / 1000:.6f}) {channel} "
        for identifier, length, data in (*host[:sent], *answer[:answered]):
            out.append(f"{stamp}{identifier:03X}#{bytes(data[:length]).hex().upper()}\n")
    return "".join(out)


def read(path: Path) -> Frames:
    """All data frames of a log; error and remote frames are left out. A last line without its end is one that a crash
    cut off and is left out as well. UserError names file and line of what is no candump text."""
    times, identifiers, lengths, data = [], [], [], []
    text = path.read_text(encoding="ascii", errors="replace")
    whole = text[: text.rfind("\n") + 1]
    for number, row in enumerate(whole.splitlines(), 1):
        if not row.strip():
            continue
        match = _LINE.fullmatch(row)
        if match is None or (match[4][:1] != "R" and (len(match[4]) % 2 or len(match[4]) > 16)):
            found = row[:60]
            raise UserError(
                f"{path}:{number}: found {found!r}, expected candump text, such as (1.000000) can0 182#00FF"
            )
        if match[4][:1] == "R":
            continue
        payload = bytes.fromhex(match[4])
        times.append(float(match[1]))
        identifiers.append(int(match[3], 16))
        lengths.append(len(payload))
        data.append(payload.ljust(8, b"\0"))
    return Frames(
        path,
        np.array(times, dtype=np.float64),
        np.array(identifiers, dtype=np.int64),
        np.array(lengths, dtype=np.int64),
        np.frombuffer(b"".join(data), dtype=np.uint8).reshape(-1, 8),
    )


def telemetry(frames: Frames, interface: Interface) -> Mapping[str, dict[str, Array]]:
    """Message -> signal (and "time") -> array in SI units, for the frames that the controller's interface knows.

    UserError when one of them has another length than its message: it is damaged, or another version's.
    """
    for message in interface.messages.values():
        wrong = np.flatnonzero((frames.identifiers == message.id) & (frames.lengths != message.length))
        if wrong.size:
            raise UserError(
                f"{frames.path}: {message.name} at {frames.times[wrong[0]]:.6f} s: "
                f"found {frames.lengths[wrong[0]]} bytes, expected {message.length}"
            )
    return decode(interface, frames.times, frames.identifiers, frames.data)
