"""ASAM MDF 4 with bus logging, of loggers and of ours."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.binary import by_python_can
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".mf4",)


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


def _check(group: Any) -> None:
    """ValueError for a channel that reaches beyond its record: asammdf 8.8 would read memory that is not its own."""
    size = int(group.channel_group.samples_byte_nr) + int(group.channel_group.invalidation_bytes_nr)
    for channel in group.channels:
        if int(channel.byte_offset) + (int(channel.bit_offset) + int(channel.bit_count) + 7) // 8 > size:
            raise ValueError(f"channel {channel.name} reaches beyond its record of {size} bytes")


def blocks(source: Source) -> Iterator[Frames]:
    """Frames of all groups in order of time; records that python-can passes over (LIN, signals) are counted."""
    import asammdf  # noqa: F401  # sets up its log, which prints tracebacks of damaged files
    import can

    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)
    with source.path.open("rb") as file:
        begin = file.read(3)
    if begin not in (b"MDF", b"UnF"):  # UnFinMF: unfinished
        raise UserError(f"{source.path}: begins with {begin!r}, expected an MF4 bus log")
    records = [0]

    def opened() -> Any:
        reader = can.LogReader(source.path)
        mdf = getattr(reader, "_mdf", None)
        for group in mdf.groups if mdf is not None else ():
            _check(group)
        records[0] = sum(int(group.channel_group.cycles_nr) for group in mdf.groups) if mdf is not None else 0
        return reader

    yield from by_python_can(source, opened)
    left = records[0] - source.total
    if left > 0 and not source.cut:
        source.passed(0, "records of other kinds than CAN frames", left)
