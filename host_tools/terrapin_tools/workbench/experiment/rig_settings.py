"""What the rig can set: levels of every role that a run may be given, and the rows that such a run would measure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.signals import row_steps
from terrapin_tools.workbench.bases import RUNNING, formula_name
from terrapin_tools.workbench.case.case import Case

__all__ = ["SETTABLE", "held", "levels", "observed", "rows_of", "run_length"]


EXTENSION = 0.25  # of the observed span, to either side; a constant role is taken to half and to one and a half of it
SPEEDS = ("omega", "speed")  # no run is proposed faster, slower or the other way round than the rig has shown it can
SETTLED = 12  # rows of one run that count, where runs are longer
LOWEST = {"speed": 1e-3, "pass": 1.0, "moisture": 0.0, "load": 1e-3, "slip": -0.9}
HIGHEST = {"slip": 0.95}
SETTABLE = ("omega", "load", "slope", "temperature")  # what a run of the simulated robot can be given
SHARES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)  # where between the ends the levels lie


def observed(case: Case, rows: Mask, read: Collection[str] = ()) -> dict[str, Array]:
    """Roles as measured, the constants that stand for one, and unmapped columns that the rig is said to set or that
    are `read` (names as in formulas)."""
    found = {role: values[rows] for role, values in case.roles.items()}
    found.update({role: np.array([case.parameters[role]]) for role in case.base.needs if role in case.parameters})
    found.update(
        {name: values[rows] for name, values in case.extra.items() if name in case.limits or formula_name(name) in read}
    )
    return found


def levels(case: Case, rows: Mask, read: Collection[str] = ()) -> dict[str, list[float]]:
    """Levels of every role that can be set, in canonical units; `read` as of `observed`.

    What [limits] names is taken from end to end of its limits, everything else stays within what was measured. Without
    limits: the observed range, extended, but speeds and unmapped columns stay within what was measured. Without a limit
    of its own the axle's speed follows omega, and what only follows from a run (temperature, voltage, time, angle) is
    not set.
    """
    found: dict[str, list[float]] = {}
    for role, values in observed(case, rows, read).items():
        own = role in case.limits
        if role in case.base.follows and not own:
            continue
        low, high = case.limits[role] if own else _range(case, role, values)
        low, high = max(low, LOWEST.get(role, -np.inf)), min(high, HIGHEST.get(role, np.inf))
        if high <= low:
            continue
        steps = [low + share * (high - low) for share in SHARES]
        if role in case.extra and not own and len(known := np.unique(values)) <= len(SHARES):  # one of few kinds
            steps = known.tolist()
        if role == "pass":
            steps = sorted({float(np.clip(round(v), np.ceil(low), np.floor(high))) for v in steps})
        found[role] = [
            _digits(v, min(steps), max(steps)) for v in steps if role != "omega" or abs(v) > 1e-3 * (high - low)
        ]
    return found


def _range(case: Case, role: str, values: Array) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    span = high - low
    constant = span <= 0.02 * max(abs(low), abs(high))
    if case.limits or role in SPEEDS or role in case.extra:
        return (low, low) if constant else (low, high)
    if constant:
        first, last = sorted((0.5 * low, 1.5 * high))
        return first, last
    lowest = 0.5 * low if low >= 0.0 else -np.inf
    return max(low - EXTENSION * span, lowest), high + EXTENSION * span


def _digits(value: float, low: float, high: float) -> float:
    """Four digits, as one would set it, but never outside the range."""
    return float(min(max(float(f"{value:.4g}"), low), high))


def held(case: Case, rows: Mask, read: Collection[str] = ()) -> dict[str, float]:
    """Where a role stays that is not varied: the middle of what was measured, 0 for what only runs on."""
    seen = sorted(observed(case, rows, read).items(), key=lambda one: one[0] in RUNNING)
    running = () if case.base.own_names else RUNNING
    found = {role: 0.0 if role in running else float(np.median(values)) for role, values in seen}
    if "pass" in found:
        found["pass"] = float(round(found["pass"]))
    return found


def run_length(case: Case, rows: Mask) -> int:
    """Rows of a new run that count; dynamic models make a whole run of one row of settings."""
    if case.base.whole_runs:
        return 1
    lengths = np.bincount(case.run[rows])
    return int(min(np.median(lengths[lengths > 0]), SETTLED))


def rows_of(
    case: Case, rows: Mask, settings: Sequence[Mapping[str, float]], hold: Mapping[str, float], count: int
) -> dict[str, Array]:
    """Inputs of new runs by formula name: `count` rows for each setting, one after the other.

    Time runs on and the angle with it; on steady rolling the axle's speed keeps its usual ratio to omega.
    """
    names = {*hold, *(name for setting in settings for name in setting)}
    inputs = {
        formula_name(name): np.repeat([setting.get(name, hold.get(name, 0.0)) for setting in settings], count)
        for name in names
    }
    if not case.base.own_names:
        clock = np.tile(np.arange(1, count + 1) * _interval(case, rows), len(settings))
        if "time" in case.roles:
            inputs["time"] = clock
        if "angle" in case.roles and "omega" in inputs:
            inputs["angle"] = inputs["omega"] * clock
    varied = {name for setting in settings for name in setting}
    if "speed" in case.base.follows and "speed" in case.roles and "speed" not in varied:
        inputs["speed"] = inputs["omega"] * _ratio(case, rows)
    for name, values in case.inputs.items():
        if name not in inputs:
            inputs[name] = np.full(len(settings) * count, float(np.median(values[rows])))
    return inputs


def _ratio(case: Case, rows: Mask) -> float:
    """Axle speed over shell speed, as usual in the measurements [m]."""
    omega, speed = case.roles["omega"][rows], case.roles["speed"][rows]
    turning = np.abs(omega) > 1e-9
    return float(np.median(speed[turning] / omega[turning])) if turning.any() else 0.0


def _interval(case: Case, rows: Mask) -> float:
    """Time from row to row [s]."""
    if "time" not in case.roles:
        return 0.25
    gaps = row_steps(case.roles["time"][rows], case.run[rows])
    gaps = gaps[gaps > 0]
    return float(np.median(gaps)) if len(gaps) else 0.25
