"""PCAN's text logs, 1.0 to 2.1."""

from __future__ import annotations

import re
from collections.abc import Iterator

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.lines import by_python_can
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".trc",)
ROW = re.compile(r"\s*\d+\)?\s+[\d.]+\s")
_VERSION = re.compile(r"(\s*;\$FILEVERSION=1\.)2\s*$")
_TO_IDENTIFIER = re.compile(r"\s*\d+\)\s+\S+\s+\S+\s+\S+\s+\S+")


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


class _Version:
    """Version 1.2, which python-can does not know, as 1.3: that has a reserved column behind the identifier."""

    def __init__(self) -> None:
        self._older = False

    def __call__(self, line: str) -> str:
        if found := _VERSION.match(line):
            self._older = True
            return f"{found[1]}3\n"
        if self._older and (row := _TO_IDENTIFIER.match(line)):
            return f"{row[0]} - {line[row.end() :]}"
        return line


def blocks(source: Source) -> Iterator[Frames]:
    """Frames; what is none (errors, events) is counted."""
    import can

    with source.path.open("rb") as file:
        head = file.read(1 << 16)
    if head.strip() and not re.search(rb"^\s*(;|\d+\)?\s+[\d.]+\s)", head, re.MULTILINE):
        raise UserError(f"{source.path}: begins with {head[:20]!r}, expected a TRC bus log")
    yield from by_python_can(source, can.TRCReader, ROW, _Version())
