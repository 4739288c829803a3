"""Coverage of the regions of `terrapin soil tactile`: `python -m tests.campaigns.tactile` prints a row for each design.

A driven rig on the sand of Reina et al., 3 loads x 4 drawbar levels with slip below 0.9, noise: load 0.2 %, drawbar
pull 0.5 % of the load, torque 1 %, slip 0.01. Each campaign draws its noise anew; the truth is covered when its
deviance lies within the limit of the joint 95 % region. A short form runs in tests/python/test_tactile.py.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terrapin_hil.physics import wheel
from terrapin_tools.soil.region import deviance, limit
from terrapin_tools.soil.tactile import Noise, Points, Rig, fit, predict

Array = npt.NDArray[np.float64]

RIG = Rig(radius=0.08, width=0.15, k_c=24e3, k_phi=1528e3, exponent=1.1)
TRUTH = np.array([700.0, np.radians(30.0), 0.025, 1.0])
WEIGHT = 18.639  # N
LOADS = (1.0, 2.0, 4.0)  # of the weight
LEVELS = (-0.10, -0.05, 0.0, 0.025)  # drawbar pull in parts of the load; slip is then 0.20 to 0.83
NOISE = Noise()


@dataclass(frozen=True)
class Coverage:
    design: str
    campaigns: int
    share: float  # of the campaigns whose region covers the truth
    cohesion_sd: float  # relative scatter of the estimates
    friction_sd: float


def settings(rig: Rig = RIG, truth: Array = TRUTH, loads: tuple[float, ...] = LOADS) -> Array:
    """True W, DP, T, slip (points, 4): the slip at which each load pulls each level, by bisection."""
    load, level = (a.ravel() for a in np.meshgrid(WEIGHT * np.array(loads), np.array(LEVELS), indexing="ij"))
    low, high = np.zeros(load.size), np.full(load.size, 0.9)
    for _ in range(50):
        slip = 0.5 * (low + high)
        theta = wheel.entry_angle(load, slip, rig.radius, rig.width, rig.soil(truth), rig.linear)
        more = predict(rig, truth, theta, slip)[:, 1] < level * load
        low, high = np.where(more, slip, low), np.where(more, high, slip)
    return predict(rig, truth, theta, slip)


def measured(true: Array, noise: Noise, generator: np.random.Generator, scale: float = 1.0) -> Points:
    """One campaign's measurements; `scale` multiplies the noise behind the back of what is stated."""
    exact = Points.of(*true.T, noise)
    values = true + scale * exact.sd * generator.standard_normal(true.shape)
    return Points.of(*values.T, noise)


def coverage(campaigns: int, modulus_free: bool, stated: bool, seed: int = 0, rig: Rig = RIG) -> Coverage:
    """Share of campaigns whose joint region covers the truth. Where the noise is not stated it is twice the assumed."""
    true = settings(rig)
    free = (True, True, modulus_free, False)
    covered, found = 0, []
    for number in range(campaigns):
        points = measured(true, NOISE, np.random.default_rng([seed, number]), 1.0 if stated else 2.0)
        best = fit(rig, points, (1000.0, np.radians(35.0), 0.025, 1.0), free)
        rise = deviance(rig, points, best, (float(TRUTH[0]), float(TRUTH[1])), 0.0)
        covered += rise <= limit(best, 2, stated)
        found.append(best.q)
    spread = np.std(np.array(found), axis=0) / TRUTH
    words = f"shear modulus {'fitted' if modulus_free else 'known'}, noise {'stated' if stated else 'from the scatter'}"
    return Coverage(words, campaigns, covered / campaigns, float(spread[0]), float(spread[1]))


def main() -> int:
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    failed = 0
    for modulus_free in (False, True):
        for stated in (True, False):
            row = coverage(campaigns, modulus_free, stated)
            met = 0.935 <= row.share <= 0.965
            failed += not met
            print(
                f"{'met    ' if met else 'NOT MET'} {row.campaigns} campaigns, {row.design}: 95 % region covers in "
                f"{100 * row.share:.1f} % (93.5 to 96.5); scatter of cohesion {100 * row.cohesion_sd:.1f} %, "
                f"of the friction angle {100 * row.friction_sd:.1f} %",
                flush=True,
            )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
