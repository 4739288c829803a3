"""Vector's text logs, of CANoe, CANalyzer, BusMaster and python-can."""

from __future__ import annotations

import re
from collections.abc import Iterator

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.lines import by_python_can
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".asc",)
ROW = re.compile(r"[ \t]*(\d+\.\d+)[ \t]+(?!Start of measurement)", re.IGNORECASE)
_STAMP = re.compile(r"[ \t]*(\d+\.\d+)")
_HEADER = re.compile(
    rb"^[ \t]*(date|base|//|begin[ \t]+triggerblock)|^[ \t]*\d+\.\d+[ \t]", re.IGNORECASE | re.MULTILINE
)


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


class _Summed:
    """Times since the row before (`timestamps relative`), summed. python-can takes them for absolute."""

    def __init__(self, source: Source) -> None:
        self._source, self._relative, self._time = source, False, 0.0

    def __call__(self, line: str) -> str:
        if re.match(r"\s*base\s+\w+\s+timestamps\s+relative", line, re.IGNORECASE):
            self._relative = True
            self._source.assumed.append("times are those between rows (timestamps relative): summed")
        found = _STAMP.match(line) if self._relative else None
        if found is None:
            return line
        self._time += float(found[1])
        return f"{self._time:.9f}{line[found.end() :]}"


def blocks(source: Source) -> Iterator[Frames]:
    """Frames; times count from the begin of the measurement."""
    import can

    with source.path.open("rb") as file:
        head = file.read(1 << 16)
    if head.strip() and not _HEADER.search(head):
        raise UserError(f"{source.path}: begins with {head[:20]!r}, expected an ASC bus log")
    source.first_bus = 1
    yield from by_python_can(source, can.ASCReader, ROW, _Summed(source))
