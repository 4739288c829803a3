"""What a sensor or a gear does to a signal over time: delay, and play (backlash).

>>> t = np.arange(5.0)
>>> print(delayed(t, t * 10.0, 0.5))
[ 0.  5. 15. 25. 35.]
>>> print(play(t, np.array([0.0, 2.0, 3.0, 2.5, 0.0]), 2.0))
[0. 1. 2. 2. 1.]
"""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask

__all__ = ["delayed", "derivative", "integral", "lagged", "play", "played", "row_scatter", "row_steps"]


def delayed(time: Array, values: Array, delay: float) -> Array:
    """`values` over `time` [s], linear between samples, `delay` [s] late; before the first sample its value holds."""
    return np.asarray(np.interp(time - delay, time, values))


def integral(time: Array, values: Array) -> Array:
    """Integral (rows,) of `values` over `time` [s] from the first sample on, by trapezoids; 0 at the first sample."""
    steps = 0.5 * np.diff(time) * (values[1:] + values[:-1])
    return np.concatenate([np.zeros(1), np.cumsum(steps)])


def derivative(time: Array, values: Array) -> Array:
    """Derivative (rows,) of `values` by `time` [s], second order inside; 0 of a single sample."""
    if len(time) < 2:
        return np.zeros(len(time))
    return np.asarray(np.gradient(values, time))


def row_steps(values: Array, run: Index) -> Array:
    """What `values` (rows,) change from each row to the next of its run; runs may come in turn.

    >>> row_steps(np.array([1.0, 7.0, 3.0, 9.5]), np.array([0, 1, 0, 1]))
    array([2. , 2.5])
    """
    order = np.argsort(run, kind="stable")
    return np.asarray(np.diff(values[order])[np.diff(run[order]) == 0])


def row_scatter(values: Array, run: Index) -> float:
    """Sd of white noise in `values` (rows,) as second differences within a run show it: 1.4826 times their median, over
    the root of 6. Slow signals and slow noise add little to it; 0 where no run has three rows."""
    order = np.argsort(run, kind="stable")
    same = np.diff(run[order]) == 0
    inner = same[1:] & same[:-1]
    if not inner.any():
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values[order], n=2)[inner])) / np.sqrt(6.0))


def lagged(time: Array, values: Array, constant: Array, first: Mask) -> Array:
    """What a low-pass of first order makes of signals that are straight between samples, exactly.

    Parameters
    ----------
    time : (rows,), rising within each run; any unit.
    values : (sets, rows); the rows of a run stand together.
    constant : (sets,), time constants in that unit, 0 for none.
    first : (rows,), the first row of each run, where the low-pass is settled.
    """
    longest = int(np.diff(np.append(np.flatnonzero(first), values.shape[1])).max(initial=0))
    with np.errstate(all="ignore"):  # a time constant below 0 has no numbers; a fit turns away from it
        step = np.where(first, 1.0, np.diff(time, prepend=time[:1]))
        before = np.concatenate([values[:, :1], values[:, :-1]], axis=1)
        behind = constant[:, None] * np.where(first, 0.0, values - before) / step
        kept = np.where(first, 0.0, np.exp(-step / constant[:, None]))
        found = values - behind + kept * (behind - before)
        # a row is `kept` of the one before it, and what is found already: it is joined to those 1, 2, 4, ... before it
        reach = 1
        while reach < longest:
            found[:, reach:] = found[:, reach:] + kept[:, reach:] * found[:, :-reach]
            kept[:, reach:] = kept[:, reach:] * kept[:, :-reach]
            reach *= 2
    return np.asarray(found)


def play(time: Array, values: Array, gap: float, rate: bool = False) -> Array:
    """The angle (rows,) that follows an angle through a gap: it moves only while pushed by either side of the gap.

    Parameters
    ----------
    time : (rows,), s, rising.
    values : (rows,), the angle [rad], or with `rate` its rate [rad/s].
    gap : rad, from side to side.
    rate : integrates the values (trapezoids) and differentiates what follows.
    """
    if not rate:
        return _follow(values, gap)
    step = np.diff(time)
    angle = integral(time, values)
    # Only what the gap swallows is differentiated: without a reversal the rate is left as it is.
    lost = np.diff(_follow(angle, gap) - angle, prepend=0.0)
    result = values.copy()
    result[1:] += lost[1:] / step
    return np.asarray(result)


def _follow(angle: Array, gap: float) -> Array:
    half = 0.5 * abs(gap)
    followed = np.empty_like(angle)
    place = angle[0]
    for i, value in enumerate(angle.tolist()):
        place = min(max(place, value - half), value + half)
        followed[i] = place
    return followed


def played(values: Array, gaps: Array, first: Mask) -> Array:
    """What follows a position through each of several gaps (gaps, rows): many rows at once, and exactly as `play` does.

    Parameters
    ----------
    values : (rows,), the position; runs one after the other.
    gaps : (gaps,), from side to side, in the unit of the position.
    first : (rows,), where a run begins, in the middle of the gap. The first row is one.

    >>> played(np.array([0.0, 2.0, 3.0, 2.5, 0.0]), np.array([2.0]), np.arange(5) == 0)
    array([[0., 1., 2., 2., 1.]])
    """
    half = np.where(first, 0.0, 0.5 * np.abs(gaps)[:, None])
    low, high = values - half, values + half
    reach = 1
    # Each row keeps what came before it within its own two ends. Two such rows are one with other ends, so the rows are
    # joined to those 1, 2, 4, ... before them; a run's first row has one end only, and so have then all behind it.
    while reach < len(values) and (low < high).any():
        low_after, high_after = low[:, reach:], high[:, reach:]
        ends = [np.clip(end[:, :-reach], low_after, high_after) for end in (low, high)]
        low, high = (np.hstack([old[:, :reach], new]) for old, new in zip((low, high), ends, strict=True))
        reach *= 2
    return low
