"""What several points of a driven wheel say about the soil, and how sure: the joint region, intervals, strength.

The joint 95 % region of cohesion and friction angle is the set of pairs whose profiled sum of squares (all else fitted
again) lies at most `limit` above the least: the 95 % point of chi squared with two degrees of freedom where the noise
was stated; 2 s^2 F(2, degrees) with s^2 = least squares / degrees where only its proportions are known. Intervals of
one parameter are the same with one degree of freedom. Neither linearises; both stay within what physics allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from terrapin_hil.arrays import Array
from terrapin_hil.physics import wheel
from terrapin_tools.soil.tactile import BOUNDS, PARAMETERS, Fit, Points, Rig, Unsolved, fit, predict, strength
from terrapin_tools.soil.vehicle_limits import Interval

__all__ = ["LEVEL", "Interval", "Region", "Single", "Strength", "deviance", "explore", "limit", "single", "strengths"]

LEVEL = 0.95
RAYS = 40  # of the outline


@dataclass(frozen=True)
class Region:
    """Outline (rays, 2) of cohesion [Pa] and friction angle [rad], and the intervals of each free parameter."""

    outline: Array
    intervals: dict[str, Interval]
    kind: str  # "likelihood" or "F"
    limit: float  # rise of the sum of squares at the outline
    identified: bool


@dataclass(frozen=True)
class Strength:
    """Coulomb-Mohr at one point: arrays of stress, shear and strength [Pa] at theta_m, margin 1 - tau/tau_max."""

    sigma: Array
    tau: Array
    tau_max: Array
    tau_max_sd: Array
    margin: Array
    margin_sd: Array


@dataclass(frozen=True)
class Single:
    """What one point fixes [Pa]: c + p tan(phi) at one normal stress p, and tau_max within a range."""

    tau_max: float
    low: float  # over all soils that explain the point, noise included
    high: float
    normal_stress: float | None  # p; None where the point excludes one end of the valley
    shear_strength: float | None  # c + p tan(phi)
    shear_strength_sd: float | None
    margin: float
    margin_sd: float


def limit(fitted: Fit, count: int, stated: bool) -> float:
    """Rise of the sum of squares at the end of the 95 % region of `count` parameters."""
    if stated:
        return float(stats.chi2.ppf(LEVEL, count))
    if fitted.degrees < 1:
        raise Unsolved("noise: not stated, and too few points to take it from their scatter")
    return float(count * fitted.squares / fitted.degrees * stats.f.ppf(LEVEL, count, fitted.degrees))


def deviance(rig: Rig, points: Points, best: Fit, soil: tuple[float, float], stiffness_sd: float) -> float:
    """Rise of the sum of squares where cohesion [Pa] and friction angle [rad] are held at `soil`."""
    start = best.q.copy()
    start[:2] = soil
    if best.covariance[1, 1] > 0.0 and best.free[2:].any():  # what is free follows along the valley
        change = start[:2] - best.q[:2]
        follow = best.covariance[2:, :2] @ np.linalg.pinv(best.covariance[:2, :2]) @ change
        start[2:] = np.where(best.free[2:], best.q[2:] + follow, best.q[2:])
    held = (False, False, bool(best.free[2]), bool(best.free[3]))
    return fit(rig, points, start, held, stiffness_sd, warm=best).squares - best.squares


def explore(rig: Rig, points: Points, best: Fit, stated: bool, stiffness_sd: float = 0.0) -> Region:
    """The joint region, the intervals, and whether the points tell cohesion and friction apart at all.

    They do where the friction angle's interval ends inside 0 to 60 degrees and that of cohesion inside 200 kPa.
    """
    names = [name for name, loose in zip(PARAMETERS, best.free, strict=True) if loose]
    rise = limit(best, 1, stated)
    intervals = {name: _interval(rig, points, best, PARAMETERS.index(name), rise, stiffness_sd) for name in names}
    friction, cohesion = intervals["friction_angle"], intervals["cohesion"]
    identified = not (friction.low_open or friction.high_open or cohesion.high_open)
    joint = limit(best, 2, stated)
    outline = _outline(rig, points, best, joint, stiffness_sd) if identified else np.zeros((0, 2))
    return Region(outline, intervals, "likelihood" if stated else "F", joint, identified)


def _crossing(function: Callable[[float], float], reach: float, goal: float, guess: float) -> tuple[float, bool]:
    """Distance at which the root of the deviance reaches `goal`; (reach, True) where it does not."""
    inside, below = 0.0, 0.0
    outside = np.inf
    distance = min(reach, guess)
    for _ in range(40):
        try:
            value = float(np.sqrt(max(0.0, function(distance))))
        except Unsolved:  # no such soil carries the rig: the end lies nearer
            value = np.inf
        if abs(value - goal) < 2e-3 * goal:
            return distance, False
        if value < goal:
            if distance >= reach:
                return reach, True
            inside, below = distance, value
        else:
            outside = distance
        if np.isfinite(outside):
            straight = distance * goal / value if np.isfinite(value) and value > 0.0 else np.inf
            middle = 0.5 * (inside + outside)
            distance = straight if inside < straight < outside else middle
            if outside - inside < 1e-6 * outside:
                return inside, False
        else:
            distance = min(reach, distance * min(4.0, max(1.1, goal / max(below, 0.2 * goal))))
    raise Unsolved("region: no end found in 40 steps")


def _interval(rig: Rig, points: Points, best: Fit, index: int, rise: float, stiffness_sd: float) -> Interval:
    value, sd = float(best.q[index]), float(np.sqrt(best.covariance[index, index]))
    path = best.covariance[:, index] / best.covariance[index, index] if sd > 0.0 else np.eye(4)[index]
    loose = best.free.copy()
    loose[index] = False
    ends, opened = [], []
    for side, bound in ((-1.0, BOUNDS[index, 0]), (1.0, BOUNDS[index, 1])):

        def rises(distance: float, side: float = side) -> float:
            start = best.q + side * distance * np.where(best.free, path, 0.0)
            start[index] = value + side * distance
            held = replace(best, q=start)
            return fit(rig, points, start, tuple(loose), stiffness_sd, warm=held).squares - best.squares

        reach = abs(float(bound) - value)
        if reach <= 0.0:
            end, open_end = 0.0, True
        else:
            guess = np.sqrt(rise) * sd if sd > 0.0 else 0.1 * reach
            end, open_end = _crossing(rises, reach, float(np.sqrt(rise)), guess)
        ends.append(float(value + side * end))
        opened.append(open_end)
    return Interval(value, sd, ends[0], ends[1], opened[0], opened[1])


def _outline(rig: Rig, points: Points, best: Fit, rise: float, stiffness_sd: float) -> Array:
    """Pairs on the edge of the joint region, one a ray from the optimum, evenly spread in the linear ellipse."""
    root = np.linalg.cholesky(best.covariance[:2, :2])
    found = []
    for angle in np.linspace(0.0, 2.0 * np.pi, RAYS, endpoint=False):
        ray = root @ np.array([np.cos(angle), np.sin(angle)])
        room = [(BOUNDS[i, int(ray[i] > 0)] - best.q[i]) / ray[i] if ray[i] else np.inf for i in range(2)]
        reach = float(min(room))

        def rises(distance: float, ray: Array = ray) -> float:
            at = best.q[:2] + distance * ray
            return deviance(rig, points, best, (float(at[0]), float(at[1])), stiffness_sd)

        end = _crossing(rises, reach, float(np.sqrt(rise)), float(np.sqrt(rise)))[0] if reach > 1e-9 else 0.0
        found.append(best.q[:2] + end * ray)
    return np.array(found)


def strengths(rig: Rig, points: Points, best: Fit) -> Strength:
    """Coulomb-Mohr at every point, with standard deviations carried over from the soil's and the slip's.

    The entry angle follows the soil so that the load stays carried; its own noise (that of the load) is left out.
    """
    sigma, tau, most = strength(rig, best.q, best.theta, best.slip)
    margin = 1.0 - tau / most
    columns_most, columns_margin = [], []
    for index in np.flatnonzero(best.free):
        step = 0.05 * float(np.sqrt(best.covariance[index, index])) or 1e-6
        q = best.q.copy()
        q[index] += step if q[index] + step < BOUNDS[index, 1] else -step
        step = float(q[index] - best.q[index])
        moved = strength(rig, q, _carried(rig, q, best), best.slip)
        columns_most.append((moved[2] - most) / step)
        columns_margin.append((1.0 - moved[1] / moved[2] - margin) / step)
    covariance = best.covariance[np.ix_(best.free, best.free)]
    rows_most, rows_margin = np.array(columns_most), np.array(columns_margin)
    by_slip = (1.0 - np.divide(*strength(rig, best.q, best.theta, best.slip + 1e-4)[1:]) - margin) / 1e-4
    variance_most = np.einsum("ap,ab,bp->p", rows_most, covariance, rows_most)
    variance_margin = np.einsum("ap,ab,bp->p", rows_margin, covariance, rows_margin)
    variance_margin += (by_slip * points.sd[:, 3]) ** 2
    return Strength(sigma, tau, most, np.sqrt(variance_most), margin, np.sqrt(variance_margin))


def _carried(rig: Rig, q: Array, best: Fit) -> Array:
    loads = predict(rig, best.q, best.theta, best.slip)[:, 0]
    return wheel.entry_angle(loads, best.slip, rig.radius, rig.width, rig.soil(q), rig.linear, start=best.theta)


def single(rig: Rig, points: Points, start: Array) -> Single:
    """What one point, or several that are as good as one, fixes.

    Both ends of the valley are fitted: friction without cohesion, and cohesion without friction. All soils between them
    have the same strength at one normal stress. tau_max is wanted at a higher one, so it ranges; its value is that of
    stresses in straight lines, where both stresses are greatest at theta_m and tau_max follows from torque alone.
    """
    friction = _end(rig, points, start, (0.0, max(float(start[1]), 0.1)), 1)
    cohesion = _end(rig, points, start, (max(float(start[0]), 1e3), 0.0), 0)
    straight = _end(replace(rig, linear=True), points, start, (0.0, max(float(start[1]), 0.1)), 1)
    ends = [(end, strengths(rig, points, end)) for end in (friction, cohesion) if end is not None]
    if not ends:
        raise Unsolved("torque and drawbar pull: found no soil that explains them; check the constants")
    at = int(np.argmax(points.load))
    low = min(float(s.tau_max[at] - 1.96 * s.tau_max_sd[at]) for _, s in ends)
    high = max(float(s.tau_max[at] + 1.96 * s.tau_max_sd[at]) for _, s in ends)
    value = 0.5 * (low + high)
    if straight is not None:
        value = float(strengths(replace(rig, linear=True), points, straight).tau_max[at])
    worst = min((s for _, s in ends), key=lambda s: float(s.margin[at]))
    stress = None
    if friction is not None and cohesion is not None and friction.q[1] > 0.0:
        stress = float(cohesion.q[0] / np.tan(friction.q[1]))
    return Single(
        tau_max=value,
        low=min(low, value),
        high=max(high, value),
        normal_stress=stress,
        shear_strength=None if cohesion is None else float(cohesion.q[0]),
        shear_strength_sd=None if cohesion is None else float(np.sqrt(cohesion.covariance[0, 0])),
        margin=float(worst.margin[at]),
        margin_sd=float(worst.margin_sd[at]),
    )


def _end(rig: Rig, points: Points, start: Array, soil: tuple[float, float], index: int) -> Fit | None:
    """The fit with one of cohesion and friction angle free, the other held; None where none is found."""
    q = np.array(start, dtype=np.float64)
    q[:2] = soil
    try:
        found = fit(rig, points, q, (index == 0, index == 1, False, False))
    except Unsolved:
        return None
    # 1e-3: a fit so bad that this end of the valley does not explain the point
    return found if found.squares < stats.chi2.ppf(0.999, max(1, found.degrees)) else None
