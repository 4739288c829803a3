"""ASAM MDF 4 with bus logging, of loggers and of ours."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

from terrapin_tools.errors import printable
from terrapin_tools.extras import mf4_of_can, need
from terrapin_tools.logs.formats.binary import by_python_can
from terrapin_tools.logs.formats.source import SHOWN, Source
from terrapin_tools.logs.frames import Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".mf4",)
NAMED = 3  # groups of signals that are told by name
BUS_EVENT = 2  # flag of a group (ASAM MDF 4.1, block CG): its records are of a bus


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


def blocks(source: Source) -> Iterator[Frames]:
    """Frames of all groups in order of time. Records of other buses, which python-can passes over, are counted; groups
    of signals are told, as our own logs have them: the frames once more, decoded."""
    need(f"{source.path.name}: .mf4", "asammdf", "mf4")
    import asammdf  # noqa: F401  # sets up its log, which prints tracebacks of damaged files
    import can

    from terrapin_tools.logs.mf4_blocks import check_mf4

    mf4_of_can()
    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)
    check_mf4(source.path)
    records, signals = [0], list[str]()

    def opened() -> Any:
        reader = can.LogReader(source.path)
        mdf = getattr(reader, "_mdf", None)
        for group in mdf.groups if mdf is not None else ():
            head = group.channel_group
            if head.flags & BUS_EVENT or any(str(one.name).startswith("CAN_") for one in group.channels):
                records[0] += int(head.cycles_nr)
            else:
                signals.append(printable(str(head.acq_name or "one without a name")[:SHOWN]))
        return reader

    yield from by_python_can(source, opened)
    left = records[0] - source.total
    if left > 0 and not source.cut:
        source.passed(0, "records of a bus that python-can does not read as CAN frames", left)
    if signals:
        more = f" and {len(signals) - NAMED} more" if len(signals) > NAMED else ""
        source.assumed.append(f"groups of signals are no frames, and not read: {', '.join(signals[:NAMED])}{more}")
