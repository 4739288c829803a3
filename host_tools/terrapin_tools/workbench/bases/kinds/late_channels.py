"""Channels that come late: what each was some time before its rows, within the stretch of a solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from terrapin_hil.arrays import Array, Index

__all__ = ["Shift", "shift_of"]

NEIGHBOURS = 4  # samples between which a channel that comes late is a cubic


@dataclass(frozen=True)
class Shift:
    """A channel as it was some time before each sample, within its stretch: the samples (samples, NEIGHBOURS) near that
    time, what each counts, and what each counts in the derivative by time. `place`: of the delay among the fitted."""

    channel: int
    place: int
    at: Index
    weight: Array
    rise: Array

    def of(self, values: Array, wanted: Index | slice = slice(None)) -> Array:
        """Values (samples, ...) at the wanted samples, late."""
        return np.asarray(np.einsum("sn,sn...->s...", self.weight[wanted], values[self.at[wanted]]))

    def rising(self, values: Array, wanted: Index) -> Array:
        """Their derivative by time there."""
        return np.asarray(np.einsum("sn,sn...->s...", self.rise[wanted], values[self.at[wanted]]))


def shift_of(channel: int, place: int, late: float, time: Array, begin: Sequence[int]) -> Shift:
    """A channel that is `late` [s]: `time` (samples,) of stretches, `begin` (stretches + 1,) of their samples."""
    each = [_neighbours(time[a:b], time[a:b] - late) for a, b in pairwise(begin)]
    at = np.concatenate([near + a for a, (near, _, _) in zip(begin[:-1], each, strict=True)])
    return Shift(channel, place, at, np.concatenate([w for _, w, _ in each]), np.concatenate([r for *_, r in each]))


def _neighbours(time: Array, wanted: Array) -> tuple[Index, Array, Array]:
    """Of each wanted time the samples (wanted, NEIGHBOURS) next to it, and what they count in the polynomial through
    them and in its derivative; beyond the ends it goes on."""
    count = min(NEIGHBOURS, len(time))
    first = np.clip(np.searchsorted(time, wanted) - count // 2, 0, len(time) - count)
    at = first[:, None] + np.arange(count)
    apart = time[at][:, :, None] - time[at][:, None, :] + np.eye(count)
    own = np.eye(count, dtype=bool)
    gap = wanted[:, None] - time[at]
    weight = np.where(own, 1.0, gap[:, None, :] / apart).prod(axis=2)
    rise = np.zeros_like(weight)
    for other in range(count):  # the product rule: each factor once in the place of its derivative
        without = np.where(own | (np.arange(count) == other), 1.0, gap[:, None, :] / apart).prod(axis=2)
        rise += np.where(np.arange(count) == other, 0.0, without / apart[:, :, other])
    missing = ((0, 0), (0, NEIGHBOURS - count))  # of a short stretch: samples that count nothing
    return np.pad(at, missing, mode="edge"), np.pad(weight, missing), np.pad(rise, missing)
