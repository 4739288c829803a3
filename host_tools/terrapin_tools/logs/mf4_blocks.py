"""The blocks of an MF4 file, counted before asammdf reads them: sizes that are stated, and links that go in a circle.

ASAM MDF 4.1: a block begins with its name, its length, the number of its links and the links. HD names the first DG
(data group), DG its CGs (channel groups) and their data, CG its CNs (channels) and the number of records, DL and LD
list pieces of data, DZ is a piece that is packed.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from terrapin_tools.bounded import check, most
from terrapin_tools.errors import UserError
from terrapin_tools.logs.packed import unpacked

__all__ = ["check_mf4"]

_HEAD = struct.Struct("<4s4xQQ")
FIRST = 64  # where HD stands
TIMES = 250  # records stand column by column: an idle controller's log has 145 times the size of the file
MOST_BLOCKS = 1_000_000
MOST_RECORD = 24  # bytes that a record counts for at least: what is made of it has as many
_PACKED = {0: "deflate", 1: "deflate", 2: "zstd", 3: "zstd", 4: "lz4", 5: "lz4"}  # zip type of DZ; odd: transposed
_PLAIN = (b"##DT", b"##DV", b"##RD", b"##RV", b"##SD", b"##DI", b"##RI")
# What of a block's links leads to blocks that are read with it: (next, below, data).
_TREE = {b"##HD": (0,), b"##DG": (0, 1), b"##CG": (0, 1), b"##CN": (0, 1), b"##CA": (0,)}
VIRTUAL = (3, 6)  # kinds of channels that are not in the record
_DATA = {b"##DG": 2, b"##CN": 5}


def check_mf4(path: Path) -> None:
    """UserError when it is no MF4, unpacks to more than it may, or its blocks go in a circle."""
    with path.open("rb") as file:
        begin = file.read(FIRST)
        if begin[:3] not in (b"MDF", b"UnF") or begin[8:10] != b"4.":  # UnFinMF: unfinished
            raise UserError(f"{path}: begins with {begin[:12]!r}, expected an MF4 bus log")
        _Blocks(path, file).count()


class _Blocks:
    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path, self.file = path, file
        self.size = path.stat().st_size
        self.limit = most(self.size, TIMES)
        self.seen: set[int] = set()
        self.held: dict[int, int] = {}  # bytes of each piece of data

    def block(self, at: int) -> tuple[bytes, tuple[int, ...], bytes] | None:
        """Name, links and the first bytes of the data of a block; None where none stands."""
        self.file.seek(at)
        head = self.file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        name, length, count = _HEAD.unpack(head)
        if name[:2] != b"##" or count > min(length, self.size) // 8:
            return None
        links = self.file.read(8 * count)
        if len(links) < 8 * count:
            return None
        return name, struct.unpack(f"<{count}Q", links), self.file.read(40)

    def once(self, at: int) -> None:
        if at in self.seen:
            raise UserError(f"{self.path}: its blocks go in a circle at byte {at}, expected an MF4 bus log")
        self.seen.add(at)
        if len(self.seen) > MOST_BLOCKS:
            raise UserError(f"{self.path}: has more than {MOST_BLOCKS} blocks, expected an MF4 bus log")

    def count(self) -> None:
        records = data = 0
        waiting = [(FIRST, 0)]  # and the bytes of a record, for channels
        while waiting:
            at, record = waiting.pop()
            if (found := self.block(at)) is None or found[0] not in _TREE:
                continue
            self.once(at)
            name, links, rest = found
            below = record
            if name == b"##CG" and len(rest) >= 32:
                _, cycles, flags, width, other = struct.unpack("<QQH6xII", rest[:32])
                of_any_length = flags & 1
                records += width + (other << 32) if of_any_length else cycles * max(MOST_RECORD, width + other)
                below = width + other
            if name == b"##CN" and len(rest) >= 12:
                self.within(record, rest)
            waiting += [(links[i], below) for i in _TREE[name] if i < len(links) and links[i]]
            place = _DATA.get(name)
            if place is not None and place < len(links) and links[place]:
                data += self.data(links[place])
            check(self.path, max(records, data), TIMES)

    def within(self, record: int, channel: bytes) -> None:
        """UserError for a channel that stands beyond its record: asammdf reads and writes there (8.8)."""
        kind, _, _, first, at, bits = struct.unpack("<BBBBII", channel[:12])
        if kind not in VIRTUAL and at + (first + bits + 7) // 8 > record:
            raise UserError(f"{self.path}: a channel reaches beyond its record of {record} bytes")

    def data(self, at: int) -> int:
        """The bytes that a link to data stands for, unpacked, as often as each piece is named."""
        total, listed, lists = 0, [at], 0
        while listed and total <= self.limit:
            at = listed.pop()
            if at in self.held:
                total += self.held[at]
                continue
            if (found := self.block(at)) is None:
                continue
            name, links, rest = found
            if name in (b"##DL", b"##LD", b"##HL"):
                lists += 1
                if lists > self.size // _HEAD.size:  # more than there is room for
                    raise UserError(f"{self.path}: its lists of data go in a circle, expected an MF4 bus log")
                listed += [link for link in links if link]
            elif name == b"##DZ":
                self.held[at] = self.packed(at, rest)
                total += self.held[at]
            elif name in _PLAIN:
                self.file.seek(at + 8)
                self.held[at] = min(self.size, int.from_bytes(self.file.read(8), "little"))
                total += self.held[at]
        return total

    def packed(self, at: int, rest: bytes) -> int:
        """Bytes of a DZ. UserError when there are more than it states, or than there may be."""
        if len(rest) < 24:
            return 0
        kind, stated, size = rest[2], *struct.unpack("<QQ", rest[8:24])
        check(self.path, stated, TIMES)
        self.file.seek(at + _HEAD.size + 24)
        try:
            found = unpacked(_PACKED.get(kind, ""), self.file.read(min(size, self.size)), stated)
        except ValueError:
            return int(stated)  # its reader says so
        if len(found) > stated:
            raise UserError(
                f"{self.path}: a block of more than the {stated} bytes that it states, expected an MF4 bus log"
            )
        return int(stated)
