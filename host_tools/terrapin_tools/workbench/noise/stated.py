"""A stated noise sd against what is found: whether it is off, and by what factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtr, chdtrc

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.noise.estimate import Noise
from terrapin_tools.workbench.noise.marginal_likelihood import STATED

__all__ = ["FAR", "chances", "followed", "is_off"]

SURE = 0.9  # probability from which a stated sd is said to be off; chosen by hand
FAR = 3.0  # factor on the stated sd that no user is wrong by; chosen by hand
OFF = 1.1  # factor on the stated sd from which it is worth a word: a user knows it to 15 or 20 %


def chances(noise: Noise) -> tuple[Array, Array]:
    """By channel, the probability that the noise is more than OFF times the stated sd, and less than one OFF-th of it;
    0 where none is stated."""
    freedom = STATED + noise.ratio_freedom
    square = STATED + noise.ratio_freedom * noise.ratio**2  # over chi-square(freedom): the true over the stated
    return chdtr(freedom, square / OFF**2) * noise.known, chdtrc(freedom, square * OFF**2) * noise.known


def is_off(noise: Noise) -> Mask:
    """Channels (channels,) of which the noise surely is not as stated."""
    return np.asarray(np.maximum(*chances(noise)) > SURE)


def followed(noise: Noise) -> Noise:
    """The noise with the sd that was found wherever the stated one surely is off, as if none had been stated there."""
    off = is_off(noise)
    if not off.any():
        return noise
    floor = np.array([noise.node.of(channel).floor for channel in range(len(off))])
    return replace(
        noise,
        sigma=np.where(off, noise.sigma * noise.ratio * floor, noise.sigma),
        known=noise.known & ~off,
        freedom=np.where(off, noise.ratio_freedom, noise.freedom),
        source="noise sd as found, for it is not as stated",
    )
