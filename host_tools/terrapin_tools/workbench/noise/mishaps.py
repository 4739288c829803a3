"""What goes wrong on a rig beside the physics: one odd run, one run on a slope, a change between two runs, a test or
runs that begin unsettled, an instrument that lags.

Most of them are an offset of one channel, or a factor on what the model predicts there, of rows that the order of the
test names; a slope is a constant torque on what rolls over time; a lagging instrument shows a part of the row before.
None is a term of the model; each competes with those that are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.workbench.noise.covariance import Runs, carried, doublings

__all__ = ["KINDS", "Mishap", "in_most_runs", "mishaps", "within_runs"]

KINDS = ("run", "slope", "change", "warming", "start", "lag")
# Runs from which it is looked for; by hand, that on a slope as an odd run.
FEWEST = {"run": 3, "slope": 3, "change": 6, "warming": 4, "start": 3, "lag": 1}
ASIDE = 2  # runs on the shorter side of a change at least: fewer are odd runs; chosen by hand
CHANGES = 60  # between runs that are looked at, evenly over the test; chosen by hand, for time and memory
LENGTH = 5  # rows of the middle run from which its beginning differs from the rest, and a lag shows; chosen by hand
LAGS = (0.3, 0.6, 0.85)  # share of the row before that an instrument still shows; chosen by hand
SETTLING = (0.05, 0.15)  # of a run's length, within which it settles (time constant); chosen by hand
WARMING = (0.03, 0.1, 0.25)  # the same of the test's

# What a change (rows,) of a channel, by its number, in noise sd, does to all of them (channels, rows): starts that are
# fitted follow it.
Act = Callable[[int, Array], Array]


@dataclass(frozen=True)
class Mishap:
    """What is off in one channel, and where that begins."""

    kind: str  # of KINDS
    run: int | None  # the odd run, that on a slope, or the first one after the change; of the others none
    columns: Array  # (channels * rows, count), in file order: of each channel an offset and a factor; its lag; a slope


def mishaps(runs: Runs, act: Act, whole_runs: bool, slopes: Array | None = None) -> list[Mishap]:
    """What may have gone wrong on these rows; where the model follows runs over time, how they begin is its own.
    `slopes` (runs, channels, rows): what a slope of the ground would change in each, in their order."""
    numbers = np.unique(runs.run)
    found = [Mishap("run", int(one), _off(runs, act, runs.run == one)) for one in numbers]
    if slopes is not None:
        each = zip(numbers, slopes.reshape(len(numbers), -1, 1), strict=True)
        found += [Mishap("slope", int(one), column) for one, column in each if np.isfinite(column).all()]
    after = numbers[ASIDE : len(numbers) - ASIDE + 1]
    after = after[np.unique(np.linspace(0, len(after) - 1, CHANGES).astype(int))] if len(after) > CHANGES else after
    found += [Mishap("change", int(one), _off(runs, act, runs.run >= one)) for one in after]
    place = np.empty(runs.rows)
    place[runs.order] = np.arange(runs.rows) / runs.rows
    found += [Mishap("warming", None, _off(runs, act, np.exp(-place / share))) for share in WARMING]
    length = runs.length[: runs.runs]
    if np.median(length) >= LENGTH:
        whole = np.empty(runs.rows)
        whole[runs.order] = np.repeat(length, length)
        settled = [np.exp(-runs.position / (share * whole)) for share in SETTLING if not whole_runs]
        found += [Mishap("start", None, _off(runs, act, rows)) for rows in settled]
        found += [Mishap("lag", None, _lagging(runs, act, share)) for share in LAGS]
    return [one for one in found if len(numbers) >= FEWEST[one.kind]]


def in_most_runs(run: Index, before: Array, after: Array) -> bool:
    """Whether what is left (channels, rows), in noise sd and without each run's mean, is less in half of the runs.

    An instrument that comes late does so in all of them. Some rows that no model explains ask for it, too: a supply at
    its limit in 5 of 104 runs had a voltage that comes late at 0.99, while 93 of them say that it is in time.
    """
    place = np.unique(run, return_inverse=True)[1]
    was, is_now = (np.bincount(place, (within_runs(run, left) ** 2).sum(axis=0)) for left in (before, after))
    return bool(np.mean(is_now < was) >= 0.5)


def within_runs(run: Index, values: Array) -> Array:
    """Values (..., rows) less their mean in each run.

    >>> within_runs(np.array([0, 0, 4]), np.array([[1.0, 3.0, 7.0]])).tolist()
    [[-1.0, 1.0, 0.0]]
    """
    _, place, count = np.unique(run, return_inverse=True, return_counts=True)
    mean = np.array([np.bincount(place, one) for one in values.reshape(-1, len(run))]).reshape(-1, len(count)) / count
    return np.asarray(values - mean[:, place].reshape(values.shape))


def _off(runs: Runs, act: Act, rows: Array | Mask) -> Array:
    """An offset of these rows, and a factor on what is predicted for them, in each channel."""
    each = [
        act(c, feature)
        for c in range(runs.channels)
        for feature in (np.asarray(1.0 * rows), np.asarray(rows * runs.level[c]))
    ]
    return np.stack([one.reshape(-1) for one in each], axis=1)


def _lagging(runs: Runs, act: Act, share: float) -> Array:
    """What a lag of first order changes in each channel, a row being its unit of time: (channels * rows, channels)."""
    late = np.zeros((runs.channels, runs.rows))
    place = runs.position[runs.order]
    own = runs.reading[:, runs.order].T
    # each run begins settled: its first row is shown as it is
    shown = np.where(place[:, None] > 0, (1.0 - share) * own, own)
    late[:, runs.order] = (carried(shown, doublings(np.where(place > 0, share, 0.0))) - own).T
    return np.stack([act(c, one).reshape(-1) for c, one in enumerate(late)], axis=1)
