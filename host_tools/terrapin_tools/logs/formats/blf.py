"""Vector's binary log."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from terrapin_tools.logs.formats.binary import by_python_can
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".blf",)
_OBJECT = struct.Struct("<4sHHLL")  # LOBJ, size of the header, its version, size, type
CONTAINER = 10
FRAMES = (1, 86, 73, 100, 101)  # types that python-can reads: messages, error frames, CAN FD
NAMES = {2: "error frames of the old form", 3: "overload frames", 11: "LIN", 65: "texts", 92: "texts", 96: "markers"}


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


def _reader(path: Path, others: Counter[int]) -> Any:
    """python-can's, which ignores other types of objects silently, and all outside of containers: they are counted."""
    from terrapin_tools.logs.packed import BoundedBLF

    class Counting(BoundedBLF):
        def _parse_data(self, data: bytes) -> Iterator[Any]:
            try:
                yield from super()._parse_data(data)
            finally:
                others.update(kind for kind in _types(data, self._pos) if kind not in FRAMES)

    with path.open("rb") as file:
        place = int.from_bytes(file.read(8)[4:8], "little")
        size = path.stat().st_size
        while 0 < place <= size - _OBJECT.size:
            file.seek(place)
            mark, _, _, length, kind = _OBJECT.unpack(file.read(_OBJECT.size))
            if mark != b"LOBJ" or length < _OBJECT.size:
                break
            if kind != CONTAINER:
                others[kind] += 1
            place += length + length % 4
    return Counting(path)


def _types(data: bytes, end: int) -> Iterator[int]:
    place = 0
    while place < end:
        place = data.find(b"LOBJ", place, place + 8)
        if place < 0 or place + _OBJECT.size > len(data):
            return
        _, _, _, size, kind = _OBJECT.unpack_from(data, place)
        yield kind
        place += max(size, _OBJECT.size)


def blocks(source: Source) -> Iterator[Frames]:
    """Frames; the header gets the file's size when it is closed, so one that was cut off says so."""
    from terrapin_tools.logs.packed import check_blf

    check_blf(source.path)
    others: Counter[int] = Counter()
    source.first_bus = 1
    yield from by_python_can(source, lambda: _reader(source.path, others), lambda reader: int(reader.file.tell()))
    if others:
        kinds = ", ".join(f"{count} {NAMES.get(kind, f'of type {kind}')}" for kind, count in sorted(others.items()))
        source.passed(0, f"objects of other kinds: {kinds}", sum(others.values()))
    if not source.cut:
        with source.path.open("rb") as file:
            stated = int.from_bytes(file.read(32)[16:24], "little")
        size = source.path.stat().st_size
        source.cut = f"the header states {stated} bytes, the file has {size}" if stated != size else ""
