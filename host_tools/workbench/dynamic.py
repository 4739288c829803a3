"""Dynamic base models (cmr, pendulum_sphere, vehicle) on the rows of a case: each run is integrated over its time.

A run starts as its first rows say: at rest where what turns is slower than a twentieth of its greatest speed, else in
steady motion at the rate that a straight line through the first rows has there. Runs are whole: a model bound to some
rows of a run integrates all of it.

    bound = model.bind(case.inputs, rows)      as for every other base model
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hil.physics.dynamic import DynamicModel, Plan
from host_tools.errors import UserError
from host_tools.workbench.bases import formula_name
from host_tools.workbench.case import Case
from host_tools.workbench.models import STEP, Bound, Model

__all__ = ["DynamicBound", "bind"]

Array = npt.NDArray[np.float64]

FIRST_ROWS = 5  # from which the rate at the start is taken
AT_REST = 0.05  # of the greatest rate of the run
UNEVEN = 0.01  # of the period: how far samples of a car may be off an even grid
PROPOSED = 3.0  # s that a proposed experiment lasts
COARSE = 1e-5  # relative step of the car's difference quotients: its contact is solved to 1e-9


@dataclass(frozen=True)
class _Stretch:
    """One run: its inputs over time, where it starts, and which of its samples are wanted, at which of the rows."""

    time: Array
    inputs: Mapping[str, Array]
    start: float
    samples: npt.NDArray[np.int64]
    rows: npt.NDArray[np.int64]


class DynamicBound(Bound):
    """A dynamic model on rows."""

    def __post_init__(self) -> None:
        dynamic = self.model.case.base.dynamic
        assert dynamic is not None
        self.dynamic: DynamicModel = dynamic
        self.stretches: list[_Stretch] = []
        case, model = self.model.case, self.model
        names = [formula_name(name) for name in (*case.parameters, *self.columns)]
        self.plan = Plan(dynamic, model.effects, names)
        self.table = self.plan.values()
        for name, value in case.parameters.items():
            self.table[self.plan.slots[formula_name(name)]] = value
        self.places = np.array(
            [self.plan.slots[f.name] if f.effect is None else self.plan.own[f.effect][f.name] for f in model.fitted],
            dtype=np.int64,
        )
        for effect in model.effects:
            for option in effect.options:
                if option in case.parameters:
                    self.table[self.plan.own[effect.name][option]] = case.parameters[option]
        self._scale = np.array([_scale(f.start, f.lower, f.upper) for f in model.fitted])

    def predict(self, theta: Array) -> Array:
        """Channels (channels, rows) for parameters (parameters,); (sets, channels, rows) for (sets, parameters)."""
        sets = np.atleast_2d(theta)
        prediction = np.empty((len(sets), len(self.model.channels), self.count))
        for one, values in zip(prediction, sets, strict=True):
            table = self.table.copy()
            table[self.places] = values
            for stretch in self.stretches:
                run = self.plan.run(table, stretch.time, stretch.inputs, stretch.start)
                for row, channel in zip(one, self.model.channels, strict=True):
                    row[stretch.rows] = run.channels[channel][stretch.samples]
        return prediction[0] if theta.ndim == 1 else prediction

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        """Prediction (channels, rows) and its derivatives (channels, rows, parameters) by difference quotients."""
        relative = COARSE if self.dynamic.name == "vehicle" else STEP
        step = relative * np.maximum(np.abs(theta), self._scale)
        step = np.where(theta + step > self.model.upper, -step, step)
        sets = np.vstack([theta, theta + np.diag(step)])
        values = self.predict(sets)
        taken = sets[np.arange(1, len(sets)), np.arange(len(theta))] - theta
        slopes = (values[1:] - values[0]) / taken[:, None, None]
        return values[0], np.moveaxis(slopes, 0, -1)


def bind(model: Model, inputs: Mapping[str, Array], rows: npt.NDArray[np.bool_] | None) -> DynamicBound:
    """A dynamic model on the case's rows (all, or those of a mask), or on proposed settings, each a run from rest."""
    case = model.case
    names = {*case.base.needs, "slope", "temperature", "pass_", "moisture", "angle"}
    names |= {name for expression in model.expressions.values() for name in expression.names}
    columns = {name: values for name, values in inputs.items() if name in names}
    total = len(next(iter(inputs.values())))
    if rows is None and total != case.rows:
        bound = DynamicBound(model, columns, total)
        bound.stretches = [_setting(columns, i) for i in range(total)]
        return bound
    wanted = np.arange(case.rows) if rows is None else np.flatnonzero(rows)
    bound = DynamicBound(model, columns, len(wanted))
    for run in np.unique(case.run[wanted]):
        mine = np.flatnonzero(case.run == run)
        mine = mine[np.argsort(inputs["time"][mine], kind="stable")]
        at = np.flatnonzero(case.run[wanted] == run)
        sample_of = {row: sample for sample, row in enumerate(mine.tolist())}
        samples = np.array([sample_of[row] for row in wanted[at].tolist()], dtype=np.int64)
        time = np.ascontiguousarray(inputs["time"][mine])
        _check(case, mine, time)
        parts = {name: np.ascontiguousarray(values[mine]) for name, values in columns.items() if name != "time"}
        bound.stretches.append(_Stretch(time, parts, _start(case, mine, time), samples, at))
    return bound


def _setting(columns: Mapping[str, Array], index: int) -> _Stretch:
    """A proposed setting: its inputs held constant from rest on."""
    time = np.arange(0.0, PROPOSED, 0.01)
    inputs = {name: np.full(len(time), values[index]) for name, values in columns.items() if name != "time"}
    return _Stretch(time, inputs, 0.0, np.array([len(time) - 1]), np.array([index]))


def _check(case: Case, mine: npt.NDArray[np.int64], time: Array) -> None:
    """UserError unless the times of a run rise, for a car in even steps."""
    run = case.run_names[case.run[mine[0]]]
    if len(mine) < 3:
        raise UserError(f"{case.place(int(mine[0]))}: run {run} has {len(mine)} rows, expected at least 3")
    steps = np.diff(time)
    bad = np.flatnonzero(steps <= 0.0)
    if bad.size:
        at = int(bad[0]) + 1
        raise UserError(f"{case.place(int(mine[at]))}: time: found {time[at]:g} s twice in run {run}, expected it once")
    period = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - period) > UNEVEN * period)
    if case.base.name == "vehicle" and uneven.size:
        at = int(uneven[0])
        raise UserError(
            f"{case.place(int(mine[at + 1]))}: time: found a step of {steps[at]:g} s in run {run}, "
            f"expected even steps of {period:g} s: resample it"
        )


def _start(case: Case, mine: npt.NDArray[np.int64], time: Array) -> float:
    """The rate [rad/s] at the first sample: of the drive (cmr), of the joint, or of the wheels."""
    if case.base.name == "pendulum_sphere":
        return float(case.roles["joint_rate"][mine[0]])
    rates = [v[mine] for n, v in case.channels.items() if n.startswith("omega")]
    if not rates:
        return 0.0
    rate = np.mean(rates, axis=0)
    few = min(FIRST_ROWS, len(rate))
    if abs(rate[0]) < AT_REST * np.abs(rate).max():
        return 0.0
    return float(np.polynomial.Polynomial.fit(time[:few] - time[0], rate[:few], 1)(0.0))


def _scale(start: float, lower: float, upper: float) -> float:
    """A size against which a step in this parameter is small, where its value is 0."""
    if start:
        return abs(start)
    width = upper - lower
    return min(1.0, width) if np.isfinite(width) else 1.0
