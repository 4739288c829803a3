"""The next experiment: settings at which sets of effects that are the same on the present data come apart.

For two refitted models A and B, a design is worth D, the weighted sum of squares of f_A - f_B that is left over old and
new rows together when B's parameters may follow (Atkinson and Fedorov 1975, linearised). With D known the wrong one
of the two is preferred with probability Phi(-sqrt(D)/2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from host_tools.workbench.analysis import Analysis
from host_tools.workbench.bases import BASES, RUNNING, formula_name
from host_tools.workbench.fit import Fit
from host_tools.workbench.noise import orthonormal

__all__ = ["Experiment", "propose"]

Array = npt.NDArray[np.float64]

EXTENSION = 0.25  # of the observed span, to either side; a constant role is taken to half and to one and a half of it
ENOUGH = 16.0  # D at which the wrong one is preferred in 2 of 100
RUNS_LIMIT = 64
SETTLED = 12  # rows of one run that count, where runs are longer
PLAIN = 16  # runs up to which a design that varies one role is preferred to one that varies two
LOWEST = {"speed": 1e-3, "pass": 1.0, "moisture": 0.0, "load": 1e-3, "slip": -0.9}
HIGHEST = {"slip": 0.95}
NOT_SET = (*RUNNING, "temperature", "voltage")  # what follows from a run rather than being chosen for it


@dataclass(frozen=True)
class Experiment:
    """Roles to vary, settings (one run each, canonical units), what to hold, and how many runs in all."""

    vary: tuple[str, ...]
    settings: tuple[Mapping[str, float], ...]
    hold: Mapping[str, float]
    separates: tuple[str, ...]
    runs: int
    error_rate: float  # probability that the wrong one is preferred afterwards
    reason: str


def propose(analysis: Analysis, rivals: Sequence[tuple[tuple[str, ...], Fit]]) -> Experiment | None:
    """The design that separates the first rival from the others best; None when no design does."""
    case = analysis.case
    if len(rivals) < 2:
        return None
    ranges = _ranges(analysis)
    hold = {role: float(np.median(case.roles[role][analysis.rows])) for role in case.roles if role not in RUNNING}
    hold.update({role: 0.0 for role in case.roles if role in RUNNING})
    if "pass" in hold:
        hold["pass"] = float(round(hold["pass"]))
    hold.update({role: case.parameters[role] for role in ranges if role not in hold})
    first = rivals[0][1]
    old = [
        (_rows(first, case.inputs, analysis, True), _rows(other, case.inputs, analysis, True))
        for _, other in rivals[1:]
    ]
    plans: list[tuple[int, float, tuple[str, ...], list[dict[str, float]]]] = []
    for count in (1, 2):
        for roles in combinations(ranges, count):
            settings = [dict(zip(roles, v, strict=True)) for v in product(*(ranges[role] for role in roles))]
            inputs = _inputs(analysis, settings, hold)
            new = [(_rows(first, inputs, analysis), _rows(other, inputs, analysis)) for _, other in rivals[1:]]
            repeats, worth = 1, 0.0
            while repeats * len(settings) <= RUNS_LIMIT:
                worth = min(_worth(analysis, o, n, float(repeats)) for o, n in zip(old, new, strict=True))
                if (
                    worth >= ENOUGH
                    or not np.isfinite(worth)
                    or worth < ENOUGH * repeats * len(settings) / RUNS_LIMIT / 2
                ):
                    break
                repeats += 1
            if np.isfinite(worth):
                plans.append((repeats * len(settings), worth, roles, settings))
        if any(runs <= PLAIN and worth >= ENOUGH for runs, worth, _, _ in plans):
            break  # one role does: simpler to run, and to explain
    good = [plan for plan in plans if plan[1] >= ENOUGH]
    if good:
        runs, worth, roles, settings = min(good, key=lambda plan: (plan[0], -plan[1]))
    elif plans and max(plan[1] for plan in plans) > 1.0:
        runs, worth, roles, settings = max(plans, key=lambda plan: plan[1])
    else:
        return None
    names = [_name(effects, [r[0] for r in rivals]) for effects, _ in rivals]
    others = " and ".join(names[1:])
    held = "constant" if all(np.ptp(case.roles[r][analysis.rows]) == 0.0 for r in roles if r in case.roles) else "tied"
    if any(role not in case.roles for role in roles):
        held = "constant"
    why = "stays constant in these runs" if held == "constant" else "never varies by itself in these runs"
    reason = (
        f"{names[0]} and {others} predict the same here because {' and '.join(roles)} {why}; "
        f"over these settings they differ by {np.sqrt(worth):.1f} noise sd in all."
    )
    return Experiment(
        vary=tuple(roles),
        settings=tuple({role: float(value) for role, value in s.items()} for s in settings),
        hold={role: value for role, value in hold.items() if role not in roles and role not in RUNNING},
        separates=tuple(dict.fromkeys(name for effects, _ in rivals for name in effects)),
        runs=runs,
        error_rate=float(ndtr(-0.5 * np.sqrt(worth))),
        reason=reason,
    )


def _name(effects: tuple[str, ...], sets: Sequence[tuple[str, ...]]) -> str:
    """What distinguishes a set from the others."""
    shared = set.intersection(*(set(s) for s in sets))
    return " + ".join(e for e in effects if e not in shared) or " + ".join(effects)


def _ranges(analysis: Analysis) -> dict[str, list[float]]:
    """Levels of every role that can be set: the ends of the observed range, extended, and between them."""
    case = analysis.case
    found: dict[str, list[float]] = {}
    constants = [r for r in BASES[case.base.name].needs if r in case.parameters] if case.base.name in BASES else []
    values = {
        **{r: v[analysis.rows] for r, v in case.roles.items()},
        **{r: np.array([case.parameters[r]]) for r in constants},
    }
    for role, observed in values.items():
        if role in NOT_SET:
            continue
        low, high = float(observed.min()), float(observed.max())
        span = high - low
        if span <= 0.02 * max(abs(low), abs(high)):  # constant: to half of it and half as much again
            centre = 0.5 * (low + high)
            if centre == 0.0:
                continue
            low, high = sorted((0.5 * centre, 1.5 * centre))
        else:
            low, high = low - EXTENSION * span, high + EXTENSION * span
            if float(observed.min()) >= 0.0:
                low = max(low, 0.5 * float(observed.min()))
        low, high = max(low, LOWEST.get(role, -np.inf)), min(high, HIGHEST.get(role, np.inf))
        levels = [low + share * (high - low) for share in (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)]
        if role == "pass":
            levels = sorted({float(round(v)) for v in levels})
        if role == "omega" and low > 0.0:
            levels = [-high, -low, low, high]
        found[role] = [float(f"{v:.4g}") for v in levels if role != "omega" or abs(v) > 1e-6]
    return found


Rows = tuple[Array, Array]  # prediction (channels, rows) and its derivatives, in noise sd


def _rows(fit: Fit, inputs: Mapping[str, Array], analysis: Analysis, present: bool = False) -> Rows:
    sigma = analysis.noise.sigma
    prediction, slopes = fit.model.bind(inputs, analysis.rows if present else None).jacobian(fit.theta)
    return prediction / sigma[:, None], slopes / sigma[:, None, None]


def _worth(analysis: Analysis, old: tuple[Rows, Rows], new: tuple[Rows, Rows], repeats: float) -> float:
    """D of a design: each setting run `repeats` times, beside all the rows there are."""
    rho = analysis.noise.rho
    lengths = np.bincount(analysis.case.run[analysis.rows])
    count = min(float(np.median(lengths[lengths > 0])), SETTLED)
    thin = (1.0 - rho) / (1.0 + rho)  # rows count for less where they are correlated
    weights = (thin, repeats * max(1.0, count * thin))
    gaps, slopes = [], []
    for (first, other), weight in zip((old, new), weights, strict=True):
        gaps.append(((first[0] - other[0]) * np.sqrt(weight)).reshape(-1))
        slopes.append((other[1] * np.sqrt(weight)).reshape(-1, other[1].shape[-1]))
    gap, slope = np.concatenate(gaps), np.concatenate(slopes)
    if not (np.isfinite(gap).all() and np.isfinite(slope).all()):
        return -np.inf
    basis = orthonormal(slope)
    left = gap - basis @ (basis.T @ gap)
    return float(left @ left)


def _inputs(analysis: Analysis, settings: Sequence[Mapping[str, float]], hold: Mapping[str, float]) -> dict[str, Array]:
    """Inputs of new rows: one a setting. The axle's speed follows omega unless it is what is varied."""
    case = analysis.case
    inputs = {formula_name(role): np.array([s.get(role, hold[role]) for s in settings]) for role in hold}
    if case.base.name == "rolling_steady" and "speed" in hold and not any("speed" in s for s in settings):
        omega, speed = case.roles["omega"][analysis.rows], case.roles["speed"][analysis.rows]
        turning = np.abs(omega) > 1e-9
        inputs["speed"] = inputs["omega"] * float(np.median(speed[turning] / omega[turning]))
    for name, values in case.inputs.items():
        if name not in inputs:
            inputs[name] = np.full(len(settings), float(np.median(values[analysis.rows])))
    return inputs
