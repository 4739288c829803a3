"""Base models that integrate a body over the time of each run (terrapin_hil.physics.bodies).

A run starts as its first rows say: at rest where what turns is slower than a twentieth of its greatest speed, else in
steady motion at the rate that a straight line through the first rows has there. Runs are whole: some rows of a run take
the integration of all of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.bodies import Body
from terrapin_hil.physics.dynamic import Plan
from terrapin_hil.physics.expression import parse
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import Base, Predictor, Problem, Quantity, Runs, Target
from terrapin_tools.workbench.bases.kinds.names import formula_name

__all__ = ["Integrated", "integrated"]


FIRST_ROWS = 5  # from which the rate at the start is taken
AT_REST = 0.05  # of the greatest rate of the run
UNEVEN = 0.01  # of the period: how far samples may be off an even grid
PROPOSED = 3.0  # s that a proposed experiment lasts


@dataclass(frozen=True, kw_only=True)
class Integrated(Base):
    """A body over time."""

    body: Body
    imposed: str = ""  # role that is the rate itself, with its derivative: none that an expression could act on
    even_steps: bool = False  # samples must be evenly spaced
    step: float  # relative step of the difference quotients

    def targets(self) -> list[Target]:
        return [("resistance", 1.0), *super().targets()]

    def predictor(self, problem: Problem) -> Stretches:
        return Stretches(self, problem)

    def check_times(self, runs: Runs, rows: Index, time: Array) -> None:
        """UserError unless the `time` of a run rises, in even steps where the body needs them."""
        run, place = runs.names[runs.index[rows[0]]], runs.place
        if len(rows) < 3:
            raise UserError(f"{place(int(rows[0]))}: run {run} has {len(rows)} rows, expected at least 3")
        steps = np.diff(time)
        bad = np.flatnonzero(steps <= 0.0)
        if bad.size:
            at = int(bad[0]) + 1
            raise UserError(f"{place(int(rows[at]))}: time: found {time[at]:g} s twice in run {run}, expected it once")
        period = float(np.median(steps))
        uneven = np.flatnonzero(np.abs(steps - period) > UNEVEN * period)
        if self.even_steps and uneven.size:
            at = int(uneven[0])
            raise UserError(
                f"{place(int(rows[at + 1]))}: time: found a step of {steps[at]:g} s in run {run}, "
                f"expected even steps of {period:g} s: resample it"
            )

    def start_rate(self, runs: Runs, rows: Index, time: Array) -> float:
        """The rate [rad/s] at the first sample: of the drive, of the joint, or of the wheels."""
        if self.imposed:
            return float(runs.measured[self.imposed][rows[0]])
        rates = [v[rows] for n, v in runs.measured.items() if n in self.channels and n.startswith("omega")]
        if not rates:
            return 0.0
        rate = np.mean(rates, axis=0)
        few = min(FIRST_ROWS, len(rate))
        if abs(rate[0]) < AT_REST * np.abs(rate).max():
            return 0.0
        return float(np.polynomial.Polynomial.fit(time[:few] - time[0], rate[:few], 1)(0.0))


def integrated(
    body: Body,
    placeholders: Mapping[str, str] | None = None,
    provides: tuple[str, ...] = (),
    step: float = 1e-6,
    imposed: str = "",
    **more: Any,
) -> Integrated:
    """A body as a base model; `provides` are roles and names that it gives to effects beside its states."""
    known = placeholders or {}
    return Integrated(
        name=body.name,
        channels=body.channels,
        parameters={n: Quantity(unit, known.get(n, ""), value) for n, (unit, value) in body.parameters.items()},
        needs=dict.fromkeys(("time", *body.inputs), ""),
        provides=(*body.states, *body.aliases, "gear", *provides),
        forces={"resistance": "N m", "rolling_resistance": "N m"},
        further=tuple(role for role in body.inputs if role != imposed),
        whole_runs=True,
        body=body,
        imposed=imposed,
        step=step,
        **more,
    )


@dataclass(frozen=True)
class _Stretch:
    """One run: its inputs over time, where it starts, and which of its samples are wanted, at which of the rows."""

    time: Array
    inputs: Mapping[str, Array]
    start: float
    samples: Index
    rows: Index


class Stretches(Predictor):
    """A body on the runs of a case, or on proposed settings."""

    def __init__(self, base: Integrated, problem: Problem) -> None:
        super().__init__(problem, base.step)
        names = {*base.needs, "slope", "temperature", "pass_", "moisture", "angle"}
        names = names.union(*(parse(effect.expression).names for effect in problem.effects))
        columns = {name: values for name, values in problem.inputs.items() if name in names}
        constants = {formula_name(name): value for name, value in problem.constants.items()}
        self.plan = Plan(base.body, problem.effects, [*constants, *map(formula_name, columns)])
        self.table, slots, own = self.plan.values(), self.plan.slots, self.plan.own
        for name, value in constants.items():
            self.table[slots[name]] = value
        for effect in problem.effects:
            for option in effect.options.keys() & constants.keys():
                self.table[own[effect.name][option]] = constants[option]
        places = [slots[f.name] if f.effect is None else own[f.effect][f.name] for f in problem.fitted]
        self.places = np.array(places, dtype=np.int64)
        self.stretches = _runs(base, problem, columns) if problem.runs else _settings(columns, problem.count)

    def sets(self, sets: Array) -> Array:
        prediction = np.empty((len(sets), len(self.problem.channels), self.problem.count))
        for one, values in zip(prediction, sets, strict=True):
            table = self.table.copy()
            table[self.places] = values
            for stretch in self.stretches:
                run = self.plan.run(table, stretch.time, stretch.inputs, stretch.start)
                for row, channel in zip(one, self.problem.channels, strict=True):
                    row[stretch.rows] = run.channels[channel][stretch.samples]
        return prediction


def _settings(columns: Mapping[str, Array], count: int) -> list[_Stretch]:
    """Proposed settings: the inputs of each held constant from rest on; its last sample is what is measured."""
    time = np.arange(0.0, PROPOSED, 0.01)
    held = [{n: np.full(len(time), v[i]) for n, v in columns.items() if n != "time"} for i in range(count)]
    return [_Stretch(time, inputs, 0.0, np.array([len(time) - 1]), np.array([i])) for i, inputs in enumerate(held)]


def _runs(base: Integrated, problem: Problem, columns: Mapping[str, Array]) -> list[_Stretch]:
    """Each run that has a wanted row."""
    runs, time = problem.runs, problem.inputs["time"]
    assert runs is not None
    wanted = np.arange(len(runs.index)) if problem.rows is None else np.flatnonzero(problem.rows)
    found = []
    for run in np.unique(runs.index[wanted]):
        mine = np.flatnonzero(runs.index == run)
        mine = mine[np.argsort(time[mine], kind="stable")]
        at = np.flatnonzero(runs.index[wanted] == run)
        sample_of = {row: sample for sample, row in enumerate(mine.tolist())}
        samples = np.array([sample_of[row] for row in wanted[at].tolist()], dtype=np.int64)
        clock = np.ascontiguousarray(time[mine])
        base.check_times(runs, mine, clock)
        parts = {name: np.ascontiguousarray(values[mine]) for name, values in columns.items() if name != "time"}
        found.append(_Stretch(clock, parts, base.start_rate(runs, mine, clock), samples, at))
    return found
