"""A stated noise sd against what is found: whether it is off, and by what factor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtr, chdtrc

from terrapin_tools.workbench.noise.estimate import Noise
from terrapin_tools.workbench.noise.marginal_likelihood import STATED

__all__ = ["FAR", "followed"]

SURE = 0.9  # probability from which a stated sd is said to be off; chosen by hand
FAR = 3.0  # factor on the stated sd that no user is wrong by; chosen by hand
OFF = 1.1  # factor on the stated sd from which it is worth a word: a user knows it to 15 or 20 %
PLAINLY = 2.0  # factor between what is found with a stated sd and without it, whatever the kind of noise; by hand

Given = Sequence[float | None]


def followed(noise: Noise, given: Given, again: Callable[[Given], Noise]) -> Noise:
    """The noise, estimated `again` as if nothing were stated of the channels of which the stated sd surely is off.

    A stated sd that is far too large also makes noise look correlated, or runs apart, in which a row's sd is as large
    as stated: so what is found without it is asked too, and not only the sd follows it.
    """
    told = noise.known & [one is not None for one in given]  # others are known by rounding alone
    if not told.any():
        return noise
    channels = range(len(noise.known))
    freedom = STATED + noise.ratio_freedom
    square = STATED + noise.ratio_freedom * noise.ratio**2  # over chi-square(freedom): the true over the stated
    wrong = np.maximum(chdtr(freedom, square / OFF**2), chdtrc(freedom, square * OFF**2))
    found = again([None] * len(given))
    whole = found.sigma / noise.sigma / [noise.node.of(c).floor for c in channels]  # of runs, which is seen best
    wrong = np.where(np.maximum(whole, 1.0 / whole) > PLAINLY, 1.0, wrong)
    off = told & (wrong > SURE)
    if not off.any():
        return noise
    if not off[told].all():
        found = again([None if bad else one for bad, one in zip(off, given, strict=True)])
    row = found.sigma / [found.node.of(c).floor for c in channels]
    ratio = [s / one if bad and one else 1.0 for s, one, bad in zip(row, given, off, strict=True)]
    return replace(
        found,
        ratio=np.array(ratio),
        wrong=np.where(off, wrong, 0.0),
        source="noise sd as found, for it is not as stated",
    )
