"""Kvaser's text: of CanKing (channel, identifier, flags, length, bytes, time, direction), of a Memorator too."""

from __future__ import annotations

import re
from collections.abc import Iterator

from terrapin_tools.logs.formats.lines import numbered, rows
from terrapin_tools.logs.formats.source import FD_LENGTHS, Source
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".txt", ".log")
_CANKING = re.compile(
    r"\s*(?P<bus>\d+)\s+(?P<id>[0-9A-Fa-f]+)\s+(?:(?P<error>ErrorFrame)|(?P<flags>[A-Za-z]{0,4})\s*\b(?P<length>\d+)"
    r"(?P<data>(?:\s+[0-9A-Fa-f]{1,3})*?|\s+RTR))\s+(?P<time>\d+[.,]\d+)\s+(?P<way>[RT])\s*$"
)
_MEMORATOR = re.compile(
    r"\s*(?P<time>-?\d+[.,]\d+)\s+(?P<bus>\d+)\s+(?:(?P<error>ErrorFrame)|(?P<id>[0-9A-Fa-f]+)(?P<extended>x?))\s+"
    r"(?P<way>Rx|TxRq|Tx)\s+(?P<flags>[EFBPRW# ]*?)\s*(?P<length>\b\d+)?\s+"
    r"(?P<data>ERROR FRAME|RTR|(?:\s*[0-9A-Fa-f]{1,3})*?)\s+(?P<counter>\d+)\s*$"
)
_HEAD = re.compile(rb"Chn\s+Identifier\s+Flg\s+DLC|Kvaser Memorator Log|Time\s+Chan\s+Identifier\s+Flags\s+DLC")
_MUTE = re.compile(r"\s*(Chn\s+Identifier|Kvaser|=+|Time\s+Chan|Settings:|Format of|Timestamp Offset|CAN channel|"
                   r"(Converted|Memorator|Logging|Log file|Created|DateTime)\b)")  # fmt: skip


def recognises(head: bytes) -> bool | None:
    """By the line of names."""
    return _HEAD.search(head) is not None


def _bases(source: Source) -> tuple[int, int]:
    """Of identifiers and data. A Memorator's log states them; in one of CanKing two digits a byte are hexadecimal."""
    with source.path.open("rb") as file:
        head = file.read(1 << 16).decode("utf-8", "replace")
    stated = {
        name: 16 if base == "HEX" else 10 for name, base in re.findall(r"Format of (data|id) field:\s+(HEX|DEC)", head)
    }
    found = [row["data"].split() for row in map(_CANKING.match, head.splitlines()) if row and row["data"]]
    decimal = any(len(cell) != 2 and cell != "RTR" for cells in found for cell in cells)
    if found:
        source.assumed.append(
            f"identifiers and bytes are {'decimal' if decimal else 'hexadecimal'}, as bytes are written"
        )
    base = 10 if decimal else 16
    return stated.get("id", base), stated.get("data", base)


def blocks(source: Source) -> Iterator[Frames]:
    """Frames; times count from the begin of the log."""
    of_name, of_data = _bases(source)

    def parse(line: str, whole: bool) -> tuple[float, int, bytes, int, str] | None:
        del whole  # what is cut misses its last cell, and matches neither
        row = _CANKING.match(line) or _MEMORATOR.match(line)
        if row is None:
            return None
        parts = row.groupdict()
        time, bus = float(parts["time"].replace(",", ".")), parts["bus"]
        if parts["error"]:
            return time, 0, b"", ERROR, bus
        said = (parts["flags"] or "").upper()
        remote = "RTR" in parts["data"] or ("R" in said and not parts["data"].split())
        code, cells = int(parts["length"]), [] if remote else parts["data"].split()
        flexible = "F" in said or len(cells) > 8
        if not remote and len(cells) not in (min(8, code), code, FD_LENGTHS[min(code, 15)]):
            return None
        name = int(parts["id"], of_name)
        extended = parts.get("extended") == "x" or "X" in said or name > 0x7FF
        flags = (EXTENDED if extended else 0) | (REMOTE if remote else 0) | (FD if flexible else 0)
        flags |= SENT if parts["way"].startswith("T") else 0
        return time, name, bytes(int(cell, of_data) for cell in cells), flags, bus

    lines = (found for found in numbered(source) if not _MUTE.match(found[1]))
    yield from rows(source, parse, lines, "a row of Kvaser: channel, identifier, flags, length, bytes, time, direction")
