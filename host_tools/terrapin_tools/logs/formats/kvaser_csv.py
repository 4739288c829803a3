"""Kvaser's CSV of frames (Memorator, kvlclib): settings, then Time, Channel, id, Flags, DLC, Data0 ... Counter."""

from __future__ import annotations

import re
from collections.abc import Iterator

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.lines import numbered, rows
from terrapin_tools.logs.formats.source import FD_LENGTHS, Source
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".csv",)
_NAMES = re.compile(r"time([;,\t|])channel\1(id|pgn)\1flags\1dlc\1", re.IGNORECASE)
# canlib's canstat.h
_RTR, _EXT, _ERROR, _SENT, _FD = 0x1, 0x4, 0x20, 0xC0, 0x10000
MOST_HEAD = 20  # lines


def recognises(head: bytes) -> bool | None:
    """By the line of names, which stands below the settings."""
    return _NAMES.search(head.decode("utf-8", "replace")) is not None


def blocks(source: Source) -> Iterator[Frames]:
    """Frames; times count from the begin of the log. UserError for PGNs in place of identifiers."""
    lines = numbered(source)
    bases = {"data": 16, "id": 16}
    names = None
    for number, line, _ in lines:
        if (names := _NAMES.match(line)) or number > MOST_HEAD:
            break
        if setting := re.match(r"Format of (data|id) field\W+(HEX|DEC)", line):
            bases[setting[1]] = 16 if setting[2] == "HEX" else 10
    if names is None or names[2].lower() == "pgn":
        raise UserError(f"{source.path}: found PGNs, expected identifiers: export without J1939")
    mark = names[1]

    def parse(line: str, whole: bool) -> tuple[float, int, bytes, int, str] | None:
        del whole  # the counter stands behind what we read
        cells = [cell.strip() for cell in line.split(mark)]
        time, said = float(cells[0].replace(",", ".")), int(cells[3])
        if said & _ERROR:
            return time, 0, b"", ERROR, cells[1]
        flags = (EXTENDED if said & _EXT else 0) | (REMOTE if said & _RTR else 0) | (SENT if said & _SENT else 0)
        code = int(cells[4])
        length = 0 if said & _RTR else FD_LENGTHS[code] if said & _FD else min(8, code)
        body = cells[5 : 5 + length]
        if len(cells) <= 5 + length or "" in body:
            return None
        flags |= FD if said & _FD else 0
        return time, int(cells[2], bases["id"]), bytes(int(cell, bases["data"]) for cell in body), flags, cells[1]

    yield from rows(source, parse, lines, "a row of Kvaser: time, channel, id, flags, length, bytes")
