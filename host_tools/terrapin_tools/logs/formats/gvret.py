"""SavvyCAN's CSV, which GVRET, its hardware, writes too: times in microseconds."""

from __future__ import annotations

from collections.abc import Iterator

from terrapin_tools.logs.formats.lines import numbered, rows
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import EXTENDED, FD, SENT, Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".csv",)


def recognises(head: bytes) -> bool | None:
    """By the line of names; older ones have no Dir."""
    return head.removeprefix(b"\xef\xbb\xbf").replace(b" ", b"").lower().startswith(b"timestamp,id,extended,")


def blocks(source: Source) -> Iterator[Frames]:
    """Frames, by the names of the columns."""
    lines = numbered(source)
    names = [name.strip().replace(" ", "").lower() for name in next(lines)[1].split(",")]
    place = {name: names.index(name) for name in ("timestamp", "id", "extended", "bus", "len") if name in names}
    way = names.index("dir") if "dir" in names else None
    begin = place.get("len", len(names)) + 1
    in_seconds = False

    def parse(line: str, whole: bool) -> tuple[float, int, bytes, int, str] | None:
        nonlocal in_seconds
        cells = [cell.strip() for cell in line.split(",")]
        length = int(cells[place["len"]])
        body = [cell for cell in cells[begin : begin + length] if cell]
        if len(body) != length or length > 64 or any(len(cell) > 2 or not (whole or len(cell) == 2) for cell in body):
            return None
        stamp = cells[place["timestamp"]]
        if "." in stamp and not in_seconds:
            in_seconds = True
            source.assumed.append("times with a decimal point are seconds, others microseconds")
        name = int(cells[place["id"]], 16)
        extended = cells[place["extended"]].lower() in ("true", "1") or name > 0x7FF
        flags = (EXTENDED if extended else 0) | (FD if length > 8 else 0)
        if way is not None and cells[way].lower() == "tx":
            flags |= SENT
        time = float(stamp) if "." in stamp else int(stamp) * 1e-6
        return time, name & 0x1FFF_FFFF, bytes(int(cell, 16) for cell in body), flags, cells[place["bus"]]

    yield from rows(source, parse, lines, "a row of SavvyCAN: time, ID, extended, direction, bus, length, bytes")
