"""Signals of a log on a grid of time, the last value held."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.reading import LogReader

__all__ = ["signals_on_grid"]


DISORDER = 1.0  # s by which frames of several channels may be out of order
MOST_ROWS = 1e7  # that a log may give


def signals_on_grid(path: Path, decoder: Decoder, period: float, needed: Collection[str] = ()) -> dict[str, Array]:
    """`time` and every MESSAGE.SIGNAL of the log at 0, period, 2 period ... [s] from the first known frame on.

    Rows before the first in which all `needed` signals have come are dropped; other signals are NaN until they come.
    UserError when times run backwards, when the DBC knows no frame, or when the grid had too many rows.
    """
    times: dict[str, list[Array]] = {}
    values: dict[str, list[Array]] = {}
    latest, row = -np.inf, 0
    log = LogReader(path)
    for block in log.blocks():
        running = np.maximum.accumulate(np.concatenate([[latest], block.times]))
        behind = np.flatnonzero(block.times < running[:-1] - DISORDER)
        if behind.size:
            number = row + int(behind[0]) + 1
            place = f"{path.name}:{number}" if log.kind == ".log" else f"{path.name}: frame {number}"
            found = f"found time {block.times[behind[0]]:.6f} s after {running[behind[0]]:.6f} s"
            raise UserError(f"{place}: {found}, expected times that rise")
        latest, row = float(running[-1]), row + len(block)
        for message, table in decoder.decode(block).items():
            for name, column in table.signals.items():
                there = ~np.isnan(column)
                times.setdefault(f"{message}.{name}", []).append(table.times[there])
                values.setdefault(f"{message}.{name}", []).append(column[there])
    stamps = {name: np.concatenate(parts) for name, parts in times.items()}
    stamps = {name: stamp for name, stamp in stamps.items() if stamp.size}
    if not stamps:
        raise UserError(f"{path.name}: found no frame that the DBC knows")
    first = min(float(stamp.min()) for stamp in stamps.values())
    last = max(float(stamp.max()) for stamp in stamps.values())
    steps = (last - first) / period
    if not steps < MOST_ROWS:
        raise UserError(
            f"{path.name}: found {last - first:g} s of log, {steps:.3g} rows with data.period {period:g} s, "
            f"expected at most {MOST_ROWS:g}"
        )
    grid: Array = np.arange(int(steps + 1e-9) + 1) * np.float64(period)
    columns: dict[str, Array] = {}
    start = 0.0
    for name, raw in stamps.items():
        order = np.argsort(raw, kind="stable")
        stamp, column = raw[order] - first, np.concatenate(values[name])[order]
        index = np.searchsorted(stamp, grid + 1e-9 * period, side="right") - 1
        columns[name] = np.where(index >= 0, column[np.maximum(index, 0)], np.nan)
        if name in needed:
            start = max(start, float(stamp[0]))
    keep = grid + 1e-9 * period >= start
    return {"time": grid[keep], **{name: column[keep] for name, column in columns.items()}}
