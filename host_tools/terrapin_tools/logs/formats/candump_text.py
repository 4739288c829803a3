"""What candump keeps in a file or prints on a screen: terrapin_tools.logs.candump reads it."""

from __future__ import annotations

from collections.abc import Iterator

from terrapin_tools.logs import candump
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".log",)


def recognises(head: bytes) -> bool | None:
    """What no other kind of this suffix recognises."""
    del head
    return None


def blocks(source: Source) -> Iterator[Frames]:
    """Frames; a last line without its end is left out."""
    form = candump.Form(bus=source.bus)
    yield from candump.blocks(source.path, source.told, form)
    source.timed = not form.untimed
    source.assumed += form.assumed
    with source.path.open("rb") as file:
        file.seek(max(0, source.size - 1))
        if source.size and file.read(1) != b"\n":
            source.cut = "the last line has no end"
