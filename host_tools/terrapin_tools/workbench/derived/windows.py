"""Slopes and means over a window of time, of runs of unevenly spaced rows with gaps."""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array, Index

__all__ = ["COUNT_NOISE", "mean", "slope", "unwrapped"]

COUNT_NOISE = 1.0 / np.sqrt(12.0)  # counts: sd of a rounding that is as likely anywhere


def unwrapped(counts: Array, run: Index, wrap: float) -> Array:
    """Counts of a register that begins again after `wrap`: each step is the shortest one. NaN stays.

    >>> unwrapped(np.array([65530.0, 65535.0, 4.0, 65535.0]), np.zeros(4, np.int64), 65536.0).tolist()
    [65530.0, 65535.0, 65540.0, 65535.0]
    """
    found = counts.copy()
    for number in np.unique(run):
        rows = np.flatnonzero((run == number) & np.isfinite(counts))
        if rows.size:
            steps = np.diff(counts[rows])
            short = (steps + wrap / 2) % wrap - wrap / 2
            found[rows] = counts[rows[0]] + np.concatenate([[0.0], np.cumsum(short)])
    return found


def _sums(values: Array, first: Index, last: Index) -> Array:
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(total[last] - total[first])


def _windows(times: Array, width: float) -> tuple[Index, Index]:
    """Of rows in order of time: [first, last) of those within half the width."""
    half = width / 2 * (1 + 1e-9)
    return np.searchsorted(times, times - half, "left"), np.searchsorted(times, times + half, "right")


def slope(values: Array, times: Array, run: Index, width: float) -> tuple[Array, Array]:
    """d values / d times (rows,) by a straight line through the rows within half of `width` on either side, in the run;
    and what the sd of a value's white noise is multiplied by. NaN where a value or time is missing, or alone.

    At a run's ends the window has fewer rows. The line's slope has the variance s^2 / sum (t - mean t)^2. Times rise in
    each run.
    """
    found, gain = np.full(len(values), np.nan), np.full(len(values), np.nan)
    for number in np.unique(run):
        rows = np.flatnonzero((run == number) & np.isfinite(values) & np.isfinite(times))
        if rows.size < 2:
            continue
        t, v = times[rows] - times[rows].mean(), values[rows] - values[rows].mean()
        first, last = _windows(t, width)
        first = np.where(last - first < 2, np.maximum(0, first - 1), first)  # a window narrower than a step
        last = np.where(last - first < 2, np.minimum(len(t), last + 1), last)
        count = last - first
        mean_t, mean_v = _sums(t, first, last) / count, _sums(v, first, last) / count
        spread = _sums(t * t, first, last) - count * mean_t**2
        with np.errstate(divide="ignore", invalid="ignore"):
            found[rows] = (_sums(t * v, first, last) - count * mean_t * mean_v) / spread
            gain[rows] = 1.0 / np.sqrt(spread)
    return found, gain


def mean(values: Array, times: Array, run: Index, width: float) -> tuple[Array, Array]:
    """Mean (rows,) of the rows within half of `width` on either side, in the run; and the factor of white noise."""
    found, gain = np.full(len(values), np.nan), np.full(len(values), np.nan)
    for number in np.unique(run):
        rows = np.flatnonzero((run == number) & np.isfinite(values) & np.isfinite(times))
        if rows.size:
            middle = values[rows].mean()
            first, last = _windows(times[rows] - times[rows].mean(), width)
            found[rows] = middle + _sums(values[rows] - middle, first, last) / (last - first)
            gain[rows] = 1.0 / np.sqrt(last - first)
    return found, gain
