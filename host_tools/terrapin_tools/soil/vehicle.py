"""Soil parameters from wheel torque and wheel speeds of a car on soft soil (Vella et al. 2024).

The five numbers of a footing are fitted to several runs within bounds, by least squares over all wheel speeds or by the
paper's cost (Eq. 5: the sum over the wheels of the relative root mean square error, mean over the runs, in per cent).
Eq. 5 divides by the measured speed, so samples at or below `mask` are left out; the paper says nothing about its own.

Method: scaled trust region (SciPy's TRF) with the exact derivatives of the simulation, from several starts; Eq. 5 by
reweighting, each wheel's squares divided by its present error, which has the same minimum.

Not all five can be had: stiffness and exponent act through the pressure at one depth, cohesion and friction angle
through the strength at one pressure. `analysis` in soil_vehicle_limits.py says what the data fix.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.soils import Footing
from terrapin_hil.physics.tyre import ContactError, Tyre
from terrapin_hil.physics.vehicle import PERIOD, SUBSTEPS, Run, Vehicle, profile_torque, simulate
from terrapin_tools.interrupts import later

__all__ = [
    "MASK",
    "PARAMETERS",
    "TABLE_1",
    "WHEELS",
    "Cost",
    "Drive",
    "Fit",
    "Objective",
    "bounds_of",
    "estimate",
    "optimum",
    "synthetic",
]

Cost = Literal["least_squares", "eq5"]

PARAMETERS = ("k_s", "n", "cohesion", "friction_angle", "shear_modulus")  # in the order of Footing
WHEELS = ("fl", "fr", "rl", "rr")
AXLE = (0, 0, 1, 1)  # of each wheel: left and right are equal in the model
MASK = 2.0  # [rad/s]
COHESION = 1e3  # [Pa], unit in which the optimiser counts cohesion
TOLERANCE = 1e-7  # relative change of the objective at which an optimisation stops
TABLE_1 = (0.46, 0.14, 0.31, 0.22, 0.41)  # relative half ranges of the paper's Table 1


@dataclass(frozen=True)
class Drive:
    """One measured run from standstill, sampled evenly. omega has a column for each of `wheels`."""

    name: str
    period: float  # [s]
    torque: Array  # (samples,) of one rear half shaft [N m]
    omega: Array  # (samples, wheels) [rad/s]
    wheels: tuple[str, ...] = WHEELS


@dataclass(frozen=True)
class Fit:
    """An optimum. `squares` is the sum of squared residuals [(rad/s)^2] of the masked samples."""

    footing: Footing
    cost: float  # Eq. 5 [%]
    squares: float
    samples: int
    at_bound: tuple[str, ...]
    evaluations: int  # simulations of all runs, with derivatives
    starts: tuple[tuple[Footing, float], ...]  # every start's optimum and its objective, the best first


class Objective:
    """Differences between simulated and measured wheel speeds, with derivatives, for one set of runs."""

    def __init__(
        self, vehicle: Vehicle, tyre: Tyre, drives: Sequence[Drive], mask: float = MASK, jobs: int | None = None
    ) -> None:
        if not drives:
            raise ContactError("drives: found none, expected at least one run")
        self.vehicle, self.tyre, self.drives, self.mask = vehicle, tyre, tuple(drives), mask
        self.keep = [drive.omega > mask for drive in drives]
        for drive, keep in zip(drives, self.keep, strict=True):
            for wheel, count in zip(drive.wheels, keep.sum(axis=0), strict=True):
                if count == 0:
                    raise ContactError(f"run {drive.name}, wheel {wheel}: found no speed above {mask:g} rad/s (mask)")
        self.measured = [d.omega[:, w][k[:, w]] for d, k, w in self._columns()]
        self.evaluations = 0
        self._pool = ThreadPoolExecutor(jobs or os.cpu_count() or 1)
        self._last: tuple[bytes, tuple[list[Array], list[Array]]] | None = None

    def _columns(self) -> list[tuple[Drive, Mask, int]]:
        return [
            (drive, keep, wheel)
            for drive, keep in zip(self.drives, self.keep, strict=True)
            for wheel in range(len(drive.wheels))
        ]

    def _simulate(self, x: Array) -> list[Run]:
        footing = Footing(*(float(v) for v in x))

        def one(drive: Drive) -> Run:
            substeps = max(1, round(SUBSTEPS * drive.period / PERIOD))
            return simulate(self.vehicle, self.tyre, footing, drive.torque, drive.period, substeps, sensitivities=True)

        with later():  # a run takes less than a second
            return list(self._pool.map(one, self.drives))

    def __call__(self, x: Array) -> tuple[list[Array], list[Array]]:
        """Differences [rad/s] and their derivatives (samples, 5), one entry for each run's each wheel."""
        key = np.asarray(x, dtype=np.float64).tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        runs = {drive.name: run for drive, run in zip(self.drives, self._simulate(x), strict=True)}
        self.evaluations += 1
        differences, derivatives = [], []
        for drive, keep, wheel in self._columns():
            run, rows = runs[drive.name], keep[:, wheel]
            axle = AXLE[WHEELS.index(drive.wheels[wheel])]
            assert run.omega_by_soil is not None
            differences.append(run.omega[rows, axle] - drive.omega[rows, wheel])
            derivatives.append(run.omega_by_soil[rows, axle])
        self._last = (key, (differences, derivatives))
        return self._last[1]

    def errors(self, x: Array) -> Array:
        """Relative root mean square error of each run's each wheel."""
        pairs = zip(self(x)[0], self.measured, strict=True)
        return np.array([np.sqrt(np.mean((d / m) ** 2)) for d, m in pairs])

    def cost(self, x: Array) -> float:
        """Eq. 5 [%]: 100 / N times the sum over runs and wheels."""
        return float(100.0 / len(self.drives) * self.errors(x).sum())

    def squares(self, x: Array) -> float:
        """Sum of squared differences [(rad/s)^2]."""
        return float(sum(d @ d for d in self(x)[0]))

    @property
    def samples(self) -> int:
        return sum(m.size for m in self.measured)


def synthetic(
    profile: int, footing: Footing, seed: int, vehicle: Vehicle | None = None, tyre: Tyre | None = None
) -> Drive:
    """A run with an assumed torque as it would be measured: speeds + N(0, 0.1 rad/s), torque + N(0, 5 N m)."""
    torque = profile_torque(profile)
    run = simulate(vehicle or Vehicle(), tyre or Tyre(), footing, torque)
    noise = np.random.default_rng([seed, profile])
    omega = run.omega[:, AXLE] + noise.normal(0.0, 0.1, (torque.size, len(WHEELS)))
    return Drive(f"profile_{profile}", PERIOD, torque + noise.normal(0.0, 5.0, torque.size), omega)


def bounds_of(start: Footing, shares: Sequence[float] = TABLE_1) -> tuple[Footing, Footing]:
    """Bounds at relative distances from the start, Table 1's by default."""
    pairs = list(zip(start, shares, strict=True))
    return Footing(*(v * (1.0 - s) for v, s in pairs)), Footing(*(v * (1.0 + s) for v, s in pairs))


def estimate(
    objective: Objective,
    start: Footing,
    bounds: tuple[Footing, Footing] | None = None,
    cost: Cost = "least_squares",
    starts: int = 3,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """The soil that fits the runs best within the bounds; equal lower and upper bounds hold a parameter.

    `starts` optimisations: one from `start`, the others from a Sobol sequence within the bounds. ContactError where the
    start cannot be simulated or lies outside the bounds.
    """
    low, high = (np.array(side) for side in bounds or bounds_of(start))
    first = np.array(start)
    for name, value, least, most in zip(PARAMETERS, first, low, high, strict=True):
        if not least <= value <= most:
            raise ContactError(f"{name}: found start {value:g}, expected between {least:g} and {most:g}")
    free = high > low
    if not free.any():
        raise ContactError("bounds: every parameter is held, expected at least one that is free")
    before = objective.evaluations
    found: list[tuple[Array, float]] = []
    for number, x0 in enumerate(_starts(first, low, high, free, starts, seed)):
        try:
            x = optimum(objective, x0, low, high, free, cost)
        except ContactError:
            if number == 0:
                raise
            progress(f"start {number + 1} of {starts}: this soil does not carry the car; left out")
            continue
        found.append((x, objective.cost(x) if cost == "eq5" else objective.squares(x)))
        progress(f"start {number + 1} of {starts}: cost of Eq. 5 {objective.cost(x):.3f} %")
    found.sort(key=lambda pair: pair[1])
    best = found[0][0]
    margin = 1e-4 * (high - low)
    at_bound = free & ((best < low + margin) | (best > high - margin))
    return Fit(
        footing=Footing(*best.tolist()),
        cost=objective.cost(best),
        squares=objective.squares(best),
        samples=objective.samples,
        at_bound=tuple(name for name, hit in zip(PARAMETERS, at_bound, strict=True) if hit),
        evaluations=objective.evaluations - before,
        starts=tuple((Footing(*x.tolist()), value) for x, value in found),
    )


def _starts(first: Array, low: Array, high: Array, free: Mask, count: int, seed: int) -> list[Array]:
    points = [first]
    if count > 1:
        spread = qmc.Sobol(int(free.sum()), seed=np.random.default_rng(seed)).random(1 << (count - 1).bit_length())
        for row in spread[: count - 1]:
            x = first.copy()
            # The bounds themselves are poor starts: keep a tenth away.
            x[free] = low[free] + (0.1 + 0.8 * row) * (high - low)[free]
            points.append(x)
    return points


def optimum(
    objective: Objective,
    x0: Array,
    low: Array,
    high: Array,
    free: Mask,
    cost: Cost,
    tolerance: float = TOLERANCE,
) -> Array:
    """The local optimum reached from x0 (5,). ContactError where x0 cannot be simulated."""
    objective(x0)
    x = _trust_region(objective, x0, low, high, free, [np.ones(m.size) for m in objective.measured], tolerance)
    if cost == "least_squares":
        return x
    value = objective.cost(x)
    for _ in range(30):
        errors = np.maximum(objective.errors(x), 1e-12)
        weights = [1.0 / (m * np.sqrt(m.size * e)) for m, e in zip(objective.measured, errors, strict=True)]
        trial = _trust_region(objective, x, low, high, free, weights, 10.0 * tolerance)
        gained = value - objective.cost(trial)
        if gained <= 0.0:
            return x
        x, value = trial, value - gained
        if gained < 10.0 * tolerance * value:
            return x
    return x


def _trust_region(
    objective: Objective,
    x0: Array,
    low: Array,
    high: Array,
    free: Mask,
    weights: Sequence[Array],
    tolerance: float,
) -> Array:
    def whole(u: Array) -> Array:
        x = x0.copy()
        x[free] = np.clip(_from_straight(u, x0, free), low[free], high[free])
        return x

    def residuals(u: Array) -> Array:
        try:
            differences = objective(whole(u))[0]
        except ContactError:  # a trial soil that does not carry the car: the trust region shrinks on infinity
            return np.full(sum(w.size for w in weights), np.inf)
        return np.concatenate([w * d for w, d in zip(weights, differences, strict=True)])

    def jacobian(u: Array) -> Array:
        x = whole(u)
        rates = np.array([x[0], 1.0, COHESION, np.cos(x[3]) ** 2, x[4]])[free]
        derivatives = objective(x)[1]
        return np.concatenate([w[:, None] * d[:, free] * rates for w, d in zip(weights, derivatives, strict=True)])

    least, most = _straight(low)[free], _straight(high)[free]
    solution = least_squares(
        residuals,
        np.clip(_straight(x0)[free], least, most),
        jacobian,
        bounds=(least, most),
        method="trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=1e-7,
        gtol=1e-10,
        max_nfev=100,
    )
    return whole(solution.x)


def _straight(x: Array) -> Array:
    """(ln k_s, n, c / COHESION, tan phi, ln K): valleys of equal pressure or equal strength are straight in these."""
    return np.array([np.log(x[0]), x[1], x[2] / COHESION, np.tan(x[3]), np.log(x[4])])


def _from_straight(u: Array, x0: Array, free: Mask) -> Array:
    v = _straight(x0)
    v[free] = u
    return np.array([np.exp(v[0]), v[1], v[2] * COHESION, np.arctan(v[3]), np.exp(v[4])])[free]
