"""python-can's own CSV: timestamp, arbitration_id, extended, remote, error, dlc, data in base64."""

from __future__ import annotations

import base64
from collections.abc import Iterator

from terrapin_tools.logs.formats.lines import numbered, rows
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".csv",)


def recognises(head: bytes) -> bool | None:
    """By the line of names."""
    return head.startswith(b"timestamp,arbitration_id,extended,remote,error,dlc,data")


def _parse(line: str, whole: bool) -> tuple[float, int, bytes, int, str] | None:
    time, name, extended, remote, error, length, text = line.strip().split(",")
    data = base64.b64decode(text, validate=True)
    flags = (EXTENDED if extended == "1" else 0) | (REMOTE if remote == "1" else 0) | (ERROR if error == "1" else 0)
    if not flags & (REMOTE | ERROR) and len(data) != int(length):
        return None
    flags |= FD if len(data) > 8 else 0  # the file does not say it of shorter ones
    return float(time), int(name, 16), data, flags, ""


def blocks(source: Source) -> Iterator[Frames]:
    """Frames."""
    lines = numbered(source)
    next(lines)
    yield from rows(source, _parse, lines, "a row of python-can: time, ID, extended, remote, error, length, base64")
