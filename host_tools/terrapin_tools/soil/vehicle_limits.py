"""What runs of a car say about the soil, and what they cannot: intervals, correlations, combinations.

Stiffness and exponent act almost only through the pressure k_s z^n at one depth, cohesion and friction angle through
the strength c + p tan(phi) at one normal stress. Both are found here as the combination with the least variance.
Intervals come from profile likelihoods: one parameter is held, the others are fitted again, until the sum of squares
has risen by the 95 % point of chi squared with one degree of freedom.

The noise of the torque enters through the simulation, so residuals are correlated in time: the variance of the fit is
multiplied by the residuals' integrated correlation time. What the model gets wrong (a torque gain of 3 % moves k_s by
7 %) is in none of these numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.soils import Footing
from terrapin_hil.physics.tyre import ContactError
from terrapin_tools.soil.vehicle import PARAMETERS, Fit, Objective, optimum

__all__ = ["Combination", "Interval", "Limits", "analyse"]

LEVEL = 0.95
FIXED = 0.1  # the data fix a parameter when its interval is at most this share of the range that the bounds allow


@dataclass(frozen=True)
class Interval:
    """A parameter's fit: standard deviation with all others free, profile interval, and whether a bound cut an end."""

    value: float
    sd: float
    low: float
    high: float
    low_open: bool
    high_open: bool


@dataclass(frozen=True)
class Combination:
    """Two parameters through the one number of them that the data fix."""

    parameters: tuple[str, str]
    correlation: float
    quantity: str  # what is fixed
    at: float  # depth [m], or normal stress [Pa]
    value: float  # [Pa]
    sd: float


@dataclass(frozen=True)
class Limits:
    noise: float  # rms of the residuals [rad/s]
    correlation_samples: float  # integrated correlation time of the residuals
    intervals: dict[str, Interval]
    correlation: dict[str, dict[str, float]]
    combinations: tuple[Combination, ...]
    fixed: tuple[str, ...]  # parameters whose interval is at most FIXED of their range, and not cut by a bound
    not_fixed: tuple[str, ...]


def analyse(
    objective: Objective,
    fit: Fit,
    bounds: tuple[Footing, Footing],
    profiles: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> Limits:
    """Limits of a fit by least squares; a fit by Eq. 5 is first taken to the least squares optimum beside it."""
    low, high = (np.array(side) for side in bounds)
    free = high > low
    x = optimum(objective, np.array(fit.footing), low, high, free, "least_squares")
    differences, derivatives = objective(x)
    squares = objective.squares(x)
    variance = squares / max(1, objective.samples - int(free.sum()))
    inflation = _correlation_samples(differences)
    scale = np.abs(x[free])
    jacobian = np.concatenate([d[:, free] for d in derivatives]) * scale
    whole = np.zeros((5, 5))
    whole[np.ix_(free, free)] = variance * inflation * np.linalg.pinv(jacobian.T @ jacobian) * np.outer(scale, scale)
    sd = np.sqrt(np.diag(whole))
    names = [name for name, is_free in zip(PARAMETERS, free, strict=True) if is_free]
    intervals = {}
    for index in np.flatnonzero(free):
        name = PARAMETERS[index]
        ends = [(x[index] + side * 1.96 * sd[index]) for side in (-1.0, 1.0)]
        cut = [False, False]
        if profiles:
            for k, bound in enumerate((low[index], high[index])):
                ends[k], cut[k] = _profile_end(
                    objective, x, low, high, free, int(index), bound, whole, squares, variance * inflation
                )
            progress(f"profile of {name}: {ends[0]:.5g} to {ends[1]:.5g}")
        intervals[name] = Interval(float(x[index]), float(sd[index]), float(ends[0]), float(ends[1]), cut[0], cut[1])
    correlation = {
        a: {b: float(whole[i, j] / (sd[i] * sd[j])) for j, b in enumerate(PARAMETERS) if b in names}
        for i, a in enumerate(PARAMETERS)
        if a in names
    }
    combinations = _combinations(x, whole, free)
    width = dict(zip(PARAMETERS, high - low, strict=True))
    fixed = tuple(
        name
        for name, i in intervals.items()
        if not (i.low_open or i.high_open) and i.high - i.low <= FIXED * width[name]
    )
    return Limits(
        noise=float(np.sqrt(squares / objective.samples)),
        correlation_samples=inflation,
        intervals=intervals,
        correlation=correlation,
        combinations=combinations,
        fixed=fixed,
        not_fixed=tuple(n for n in names if n not in fixed),
    )


def _correlation_samples(differences: list[Array]) -> float:
    """Integrated correlation time [samples], at least 1: the lags are summed until the correlation is below 0.05."""
    found = []
    for d in differences:
        centred = d - d.mean()
        power = float(centred @ centred)
        total = 1.0
        for lag in range(1, centred.size // 4):
            rho = float(centred[:-lag] @ centred[lag:]) / power if power > 0.0 else 0.0
            if rho < 0.05:
                break
            total += 2.0 * rho
        found.append(total)
    return float(np.mean(found))


def _combinations(x: Array, covariance: Array, free: Mask) -> tuple[Combination, ...]:
    found = []
    if free[0] and free[1]:
        # ln p = ln k_s + n ln z has least variance at ln z = -cov(ln k_s, n) / var(n)
        var_k = covariance[0, 0] / x[0] ** 2
        cov = covariance[0, 1] / x[0]
        log_depth = -cov / covariance[1, 1]
        spread = np.sqrt(max(0.0, var_k - cov**2 / covariance[1, 1]))
        depth = float(np.exp(log_depth))
        pressure = float(x[0] * depth ** x[1])
        rho = float(cov / np.sqrt(var_k * covariance[1, 1]))
        found.append(Combination(("k_s", "n"), rho, "pressure k_s z^n", depth, pressure, float(pressure * spread)))
    if free[2] and free[3]:
        rate = 1.0 + np.tan(x[3]) ** 2  # d tan(phi) / d phi
        var_t, cov = covariance[3, 3] * rate**2, covariance[2, 3] * rate
        stress = float(-cov / var_t)
        strength = float(x[2] + stress * np.tan(x[3]))
        spread = np.sqrt(max(0.0, covariance[2, 2] - cov**2 / var_t))
        rho = float(cov / np.sqrt(covariance[2, 2] * var_t))
        pair = ("cohesion", "friction_angle")
        found.append(Combination(pair, rho, "strength c + p tan(phi)", stress, strength, float(spread)))
    return tuple(found)


def _profile_end(
    objective: Objective,
    x: Array,
    low: Array,
    high: Array,
    free: Mask,
    index: int,
    bound: float,
    covariance: Array,
    squares: float,
    variance: float,
) -> tuple[float, bool]:
    """Where the profile deviance reaches its 95 % point, towards `bound`; (bound, True) where it does not."""
    goal = float(np.sqrt(chi2.ppf(LEVEL, 1)))
    reach = abs(bound - x[index])
    if reach < 1e-6 * abs(x[index]):
        return float(bound), True
    side = float(np.sign(bound - x[index]))
    others = free.copy()
    others[index] = False
    path = covariance[:, index] / covariance[index, index]  # of the others' optimum

    def root_deviance(distance: float) -> float:
        held = x + side * distance * np.where(free, path, 0.0)
        held = np.clip(held, low, high)
        held[index] = x[index] + side * distance
        if others.any():
            held = optimum(objective, held, low, high, others, "least_squares", 1e-5)
        return float(np.sqrt(max(0.0, objective.squares(held) - squares) / variance))

    inside, below = 0.0, 0.0
    distance = min(reach, goal * float(np.sqrt(covariance[index, index])))
    for _ in range(8):  # the root of the deviance is nearly straight, so a secant finds its crossing in two or three
        try:
            value = root_deviance(distance)
        except ContactError:  # this soil does not carry the car: the end lies nearer
            distance = 0.5 * (inside + distance)
            continue
        if value < goal and distance >= reach:
            return float(bound), True
        if abs(value - goal) < 0.03 * goal:
            break
        slope = (value - below) / (distance - inside) if value > below else value / distance
        if value < goal:
            inside, below = distance, value
        step = (goal - value) / slope if slope > 0.0 else reach - distance
        distance = float(np.clip(distance + step, 0.5 * inside + 1e-9 * reach, min(reach, 4.0 * distance)))
    return float(x[index] + side * distance), False
