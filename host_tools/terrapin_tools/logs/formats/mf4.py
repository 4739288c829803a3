"""ASAM MDF 4 with bus logging, of loggers and of ours."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

from terrapin_tools.extras import need
from terrapin_tools.logs.formats.binary import by_python_can
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".mf4",)


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


def blocks(source: Source) -> Iterator[Frames]:
    """Frames of all groups in order of time; records that python-can passes over (LIN, signals) are counted."""
    need(f"{source.path.name}: .mf4", "asammdf", "mf4")
    import asammdf  # noqa: F401  # sets up its log, which prints tracebacks of damaged files
    import can

    from terrapin_tools.logs.mf4_blocks import check_mf4

    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)
    check_mf4(source.path)
    records = [0]

    def opened() -> Any:
        reader = can.LogReader(source.path)
        mdf = getattr(reader, "_mdf", None)
        records[0] = sum(int(group.channel_group.cycles_nr) for group in mdf.groups) if mdf is not None else 0
        return reader

    yield from by_python_can(source, opened)
    left = records[0] - source.total
    if left > 0 and not source.cut:
        source.passed(0, "records of other kinds than CAN frames", left)
