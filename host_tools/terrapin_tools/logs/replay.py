"""A recorded run against the firmware once more: the host's frames are sent, the answers compared with the recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from terrapin_hil.links.link import Link
from terrapin_hil.messages import Interface
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import Frames

__all__ = ["Difference", "Replay", "replay"]

SHOWN = 10  # differences that are kept


@dataclass(frozen=True)
class Difference:
    """The first that differs in one frame: what the log has, what came now (None: no such frame)."""

    time: float
    message: str
    signal: str
    recorded: float | None
    now: float | None


@dataclass(frozen=True)
class Replay:
    """What came of a replay."""

    ticks: int
    frames: int  # answers compared
    different: int  # ticks whose answers differ
    differences: tuple[Difference, ...]  # the first ones
    seconds: float


def replay(
    log: Frames,
    link: Link,
    parameters: Mapping[str, float],
    interface: Interface,
    real_time: bool = False,
    report: Callable[[float], None] = lambda _: None,
    *,
    cut: bool = False,
) -> Replay:
    """Send the host's frames of a log of lockstep (SENSORS_FAST ends a tick) over a link, and compare.

    `real_time` keeps the log's times instead of going as fast as it can. Of a log that was `cut` off the last tick
    may lack answers, and is left out. UserError when the log holds no ticks.
    """
    ends = np.flatnonzero(log.identifiers == interface.messages["SENSORS_FAST"].id)
    if not len(ends):
        raise UserError(f"{log.path}: holds no SENSORS_FAST frame, expected the log of a simulated run")
    host = {m.id for m in interface.messages.values() if m.sender == "host"}
    rows = [(int(i), log.payload(r)) for r, i in enumerate(log.identifiers)]
    link.start(parameters)
    begin = time.monotonic()
    compared = different = first = 0
    differences: list[Difference] = []
    limits = [*ends.tolist()[1:], len(rows)]
    if cut and len(ends) > 1:
        ends, limits = ends[:-1], limits[:-1]
    for tick, (end, following) in enumerate(zip(ends.tolist(), limits, strict=True)):
        sent = [frame for frame in rows[first : end + 1] if frame[0] in host]
        recorded = []
        first = end + 1
        while first < following and rows[first][0] not in host:
            if rows[first][0] in interface.by_id:
                recorded.append(rows[first])
            first += 1
        if real_time:
            ahead = log.times[end] - log.times[0] - (time.monotonic() - begin)
            if ahead > 0:
                time.sleep(min(ahead, 60.0))
        answers = link.exchange(sent)
        compared += len(recorded)
        if answers != recorded:
            different += 1
            if len(differences) < SHOWN:
                differences.append(_first(float(log.times[end]), recorded, answers, interface))
        if tick % 1000 == 0:
            report(tick / len(ends))
    return Replay(len(ends), compared, different, tuple(differences), time.monotonic() - begin)


def _first(
    at: float, recorded: list[tuple[int, bytes]], now: list[tuple[int, bytes]], interface: Interface
) -> Difference:
    for old, new in zip(recorded, now, strict=False):
        if old == new:
            continue
        message = interface.by_id[old[0]]
        if old[0] != new[0] or len(old[1]) != message.length or len(new[1]) != message.length:
            return Difference(at, message.name, "", None, None)
        before, after = message.physical(old[1]), message.physical(new[1])
        name = next(n for n in before if before[n] != after[n])
        return Difference(at, message.name, name, before[name], after[name])
    longer = recorded if len(recorded) > len(now) else now
    return Difference(at, interface.by_id[longer[min(len(recorded), len(now))][0]].name, "", None, None)
