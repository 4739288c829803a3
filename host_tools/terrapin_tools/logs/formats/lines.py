"""Text logs, a line a frame, read line by line; what gives no frame is counted with its place."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.source import Source, brief, no_frame, sound
from terrapin_tools.logs.frames import Frames

__all__ = ["Parse", "by_python_can", "numbered", "rows"]

LONGEST = 1 << 12  # bytes of a line
MOST_HEAD = 1000  # lines above the first frame
MOST_DAMAGED = 1000  # lines that a library fails on, before the rest counts as unreadable

Parse = Callable[[str, bool], tuple[float, int, bytes, int, str] | None]
"""A line, and whether its end is there -> time [s], identifier, data, flags, bus; None: no frame."""


def numbered(source: Source) -> Iterator[tuple[int, str, bool]]:
    """Number, text and whether it is whole, of each line that is not empty. UserError for a line that is too long."""
    with source.path.open("rb") as file:
        number = done = 0
        while line := file.readline(LONGEST):
            number += 1
            done += len(line)
            if len(line) >= LONGEST and not line.endswith(b"\n"):
                raise UserError(f"{source.path}:{number}: found {line[:40]!r}, expected lines below {LONGEST} bytes")
            if number % 10_000 == 0:
                source.told(done)
            if line.strip():
                yield number, line.decode("utf-8-sig" if number == 1 else "utf-8", "replace"), line.endswith(b"\n")
        source.told(source.size)


def rows(source: Source, parse: Parse, lines: Iterator[tuple[int, str, bool]], expected: str) -> Iterator[Frames]:
    """Frames of the lines. What gives none is counted; a last line without its end is one that was cut off.

    UserError if none gives a frame; `expected` says what a line is."""
    first = ""
    for number, line, whole in lines:
        try:
            found = parse(line, whole)
        except (ValueError, IndexError):
            found = None
        if found is not None:
            source.add(*found)
            if source.full:
                yield source.take()
        elif not whole:
            source.cut = "the last line has no end"
        else:
            first = first or f"{source.path}:{number}: found {line.strip()[:40]!r}, expected {expected}"
            source.passed(number, line)
    if first and not source.total:
        raise UserError(first)
    yield source.take()


class _Lines(io.TextIOBase):
    """What python-can takes for the file: the head, an empty line, the rows. python-can 4.6 loses the line behind an
    ASC header, whatever it is: it gets the empty one. The head comes again after a row on which python-can failed."""

    def __init__(self, source: Source, row: re.Pattern[str], change: Callable[[str], str]) -> None:
        self._lines = numbered(source)
        self._source, self._row, self._change = source, row, change
        self._head: list[str] = []
        self._next: list[str] = []
        self._begun = False
        self._open: tuple[int, str, bool] | None = None
        self.damaged = 0

    def __next__(self) -> str:  # type: ignore[override]  # as io.TextIOBase does
        if self._next:
            return self._next.pop(0)
        self.settle()
        number, line, whole = next(self._lines)
        changed = self._change(line)
        if not self._row.match(line):
            if not self._begun:
                self._head.append(changed)
                if len(self._head) > MOST_HEAD:
                    raise UserError(f"{self._source.path}: found no frame in {MOST_HEAD} lines, expected a CAN log")
            return changed
        self._open = number, line, whole
        if self._begun:
            return changed
        self._begun = True
        self._next = [changed]
        return "\n"

    def framed(self) -> None:
        """The last row gave a frame."""
        self._open = None

    def settle(self, failed: bool = False) -> None:
        """The last row gave none."""
        if self._open is not None:
            number, line, whole = self._open
            if whole:
                self._source.passed(number, line)
            else:
                self._source.cut = "the last line has no end"
        self._open = None
        if failed:
            self.damaged += 1
            self._next = [*self._head, "\n"]


def by_python_can(
    source: Source, reader: Callable[[Any], Any], row: re.Pattern[str], change: Callable[[str], str] = lambda line: line
) -> Iterator[Frames]:
    """Frames by one of python-can's readers of text. `row`: what a line that may hold a frame begins with.

    UserError for a file without any frame of which python-can says what is wrong."""
    lines = _Lines(source, row, change)
    while True:
        try:
            for message in reader(lines):
                if sound(message):
                    source.add_message(message)
                    lines.framed()
                else:
                    lines.settle()
                if source.full:
                    yield source.take()
        except UserError:
            raise
        except Exception as error:  # each reader of python-can has its own way of failing on a damaged line
            lines.settle(failed=True)
            if lines.damaged > MOST_DAMAGED:
                if not source.total:
                    kind = source.path.suffix[1:].upper()
                    raise no_frame(source.path, f"a {kind} bus log") from None
                source.cut = f"more than {MOST_DAMAGED} rows could not be read ({brief(error)})"
                break
            continue
        break
    lines.settle()
    yield source.take()
