"""A MATLAB file of version 5 to 7.2 as a tree of arrays (arrays.py).

Read here and not by SciPy, whose reader of structs writes over memory where a file is damaged. The format is that of
"MAT-File Format", The MathWorks (2019), chapter 1: elements of a tag (type, bytes) and data, a matrix holds elements.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import room
from terrapin_tools.errors import UserError

__all__ = ["OBJECT", "mat5_tree"]

OBJECT = "holds an object (a table, a timetable, a class), expected arrays and structs: save table2struct(x)"
DEEPEST = 20
MOST = 100_000  # elements of cells and structs
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, OBJECT_CLASS, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17


def mat5_tree(path: Path) -> dict[str, Any]:
    """The variables: arrays, texts, lists of a cell array, trees of a struct, lists of trees.

    UserError for an object, for more than it may stand for once it is unpacked, and for what is no such file.
    """
    return _Reader(path).tree(path.read_bytes())


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.order = "<"
        self.room = room(path)
        self.left = 2 * self.room  # what is unpacked counts as matrices once more
        self.count = 0

    def tree(self, content: bytes) -> dict[str, Any]:
        self.order = "<" if content[126:128] == b"IM" else ">"
        found: dict[str, Any] = {}
        for kind, data in self._elements(memoryview(content)[128:]):
            inner = [(kind, data)] if kind != COMPRESSED else self._elements(memoryview(self._unpacked(data)))
            for each, body in inner:
                if each == MATRIX:
                    name, value = self._matrix(body, 0)
                    found[name or f"variable {len(found) + 1}"] = value
        return found

    def _unpacked(self, data: memoryview) -> bytes:
        unpack = zlib.decompressobj()
        found = unpack.decompress(data, self.left)
        self.left -= len(found)
        if self.left <= 0 or unpack.unconsumed_tail:
            raise UserError(f"{self.path.name}: unpacks to more than {self.room >> 20} MiB, expected less")
        return found

    def _elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Type and bytes of each element; four bytes may stand in the tag itself."""
        at = 0
        while at + 8 <= len(data):
            (kind,) = struct.unpack_from(f"{self.order}I", data, at)
            if kind >> 16:
                size, kind = kind >> 16, kind & 0xFFFF
                if size > 4:
                    raise self._broken()
                yield kind, data[at + 4 : at + 4 + size]
                at += 8
                continue
            (size,) = struct.unpack_from(f"{self.order}I", data, at + 4)
            if size > len(data) - at - 8:
                raise self._broken()
            yield kind, data[at + 8 : at + 8 + size]
            at += 8 + size + (0 if kind == COMPRESSED else -size % 8)

    def _broken(self) -> UserError:
        return UserError(f"{self.path.name}: is cut off or damaged, expected a MATLAB file")

    def _matrix(self, data: memoryview, depth: int) -> tuple[str, Any]:
        self.count += 1
        self.left -= len(data) if depth == 0 else 0
        if depth > DEEPEST or self.count > MOST or self.left <= 0:
            raise UserError(f"{self.path.name}: holds more than {MOST} values or {self.room >> 20} MiB, expected fewer")
        if not len(data):
            return "", np.zeros(0)
        parts = list(self._elements(data))
        flags = self._numbers(parts[0]).astype(np.int64)
        if not flags.size:
            raise self._broken()
        kind, complex_ = int(flags[0]) & 0xFF, bool(int(flags[0]) & 0x0800)
        if kind in (OBJECT_CLASS, FUNCTION, OPAQUE):
            raise UserError(f"{self.path.name}: {OBJECT}")
        if len(parts) < 3:
            raise self._broken()
        shape = tuple(int(n) for n in self._numbers(parts[1]))
        name = bytes(parts[2][1]).decode("ascii", errors="replace")
        if not shape or min(shape) < 0:
            raise self._broken()
        if kind == CELL:
            return name, [self._matrix(body, depth + 1)[1] for each, body in parts[3:] if each == MATRIX]
        if kind == STRUCT:
            return name, self._struct(parts, depth)
        if kind == SPARSE:
            return name, np.zeros(0)
        if kind == CHAR:
            return name, self._text(parts[3], shape) if len(parts) > 3 else ""
        if len(parts) < 4:
            return name, np.zeros(0)
        values = self._numbers(parts[3]).astype(np.float64)
        if values.size != math.prod(shape):
            raise self._broken()
        if complex_:
            raise UserError(f"{self.path.name}: {shorten(name)} is complex, expected real numbers")
        return name, values.reshape(shape, order="F")

    def _struct(self, parts: list[tuple[int, memoryview]], depth: int) -> Any:
        """A tree, or a list of them for an array of structs."""
        if len(parts) < 5:
            raise self._broken()
        length = int(self._numbers(parts[3])[0])
        raw = bytes(parts[4][1])
        if length < 1:
            raise self._broken()
        names = [raw[i : i + length].split(b"\0")[0].decode("latin-1") for i in range(0, len(raw), length)]
        values = [self._matrix(body, depth + 1)[1] for each, body in parts[5:] if each == MATRIX]
        if not names or len(values) % len(names):
            raise self._broken()
        rows = [values[i : i + len(names)] for i in range(0, len(values), len(names))]
        found = [dict(zip(names, row, strict=True)) for row in rows]
        return found[0] if len(found) == 1 else found

    def _numbers(self, part: tuple[int, memoryview]) -> np.ndarray[Any, Any]:
        kind, data = part
        if kind not in TYPES:
            raise self._broken()
        dtype = np.dtype(f"{self.order}{TYPES[kind]}")
        return np.frombuffer(data[: len(data) // dtype.itemsize * dtype.itemsize], dtype)

    def _text(self, part: tuple[int, memoryview], shape: tuple[int, ...]) -> Any:
        """One text, or one for each row of letters."""
        kind, data = part
        if kind not in TEXTS:
            raise self._broken()
        code = TEXTS[kind] if kind == 16 or kind == 2 else TEXTS[kind] + ("-le" if self.order == "<" else "-be")
        letters = bytes(data).decode(code, errors="replace")
        rows = shape[0]
        if rows <= 1 or not math.prod(shape):
            return letters
        if rows > len(letters):
            raise self._broken()
        return ["".join(letters[row::rows]).strip() for row in range(rows)]
