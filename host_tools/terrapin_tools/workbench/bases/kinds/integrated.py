"""Base models that integrate a body over the time of each run (terrapin_hil.physics.bodies).

A run starts as its first rows say: at rest where what turns is slower than a twentieth of its greatest speed, else in
steady motion at the rate that a straight line through the first rows has there. Runs are whole: some rows of a run take
the integration of all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.bodies import Body
from terrapin_hil.physics.dynamic import Plan
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.equations.ode import cores
from terrapin_hil.physics.expression import parse
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import Act, Base, Fitted, Predictor, Problem, Quantity, Runs, Target
from terrapin_tools.workbench.bases.kinds.integrations import KEPT, digest
from terrapin_tools.workbench.bases.kinds.names import formula_name

__all__ = ["Integrated", "integrated"]


FIRST_ROWS = 5  # from which the rate at the start is taken
AT_REST = 0.05  # of the greatest rate of the run
PROPOSED = 3.0  # s that a proposed experiment lasts
PROBE, UNIT = "probe_", 1e-5  # what a small addition is told from, and its size


@dataclass(frozen=True, kw_only=True)
class Integrated(Base):
    """A body over time."""

    body: Body
    like: int = 0  # how much a table with its inputs and `sign` looks like it
    sign: frozenset[str] = frozenset()  # channels of which one tells it from other bases
    measured: frozenset[str] = frozenset()  # channels without which a table says nothing of what sets it apart
    imposed: str = ""  # role that is the rate itself, with its derivative: none that an expression could act on
    step: float  # relative, of the parameters of neighbouring runs from which derivatives come

    def targets(self) -> list[Target]:
        return [("resistance", 1.0), *super().targets()]

    def takes(self, effect: Effect) -> bool:
        return super().takes(effect) or self.body.takes(effect)

    def acts_on(self) -> tuple[str, ...]:
        return tuple(name for name in super().acts_on() if name not in self.body.tabulated)

    def suits(self, names: Collection[str | None]) -> bool:
        return super().suits(names) and self.measured <= {*names}

    def resembles(self, names: Collection[str | None], words: Collection[str]) -> int:
        driven = {"time", *self.body.inputs} <= set(names)
        told = self.measured <= {*names} and not self.sign.isdisjoint(names)
        return self.like if driven and told else 0

    def predictor(self, problem: Problem) -> Stretches:
        return Stretches(self, problem)

    def check_times(self, runs: Runs, rows: Index, time: Array) -> None:
        """UserError unless the `time` of a run rises."""
        run, place = runs.names[runs.index[rows[0]]], runs.place
        if len(rows) < 3:
            raise UserError(f"{place(int(rows[0]))}: run {run} has {len(rows)} rows, expected at least 3")
        steps = np.diff(time)
        bad = np.flatnonzero(steps <= 0.0)
        if bad.size:
            at = int(bad[0]) + 1
            raise UserError(f"{place(int(rows[at]))}: time: found {time[at]:g} s twice in run {run}, expected it once")

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
        parameters={
            n: Quantity(unit, known.get(n, "" if value is None else f"{value:.6g} {unit}".removesuffix(" 1")), value)
            for n, (unit, value) in body.parameters.items()
        },
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
    name: str = ""
    first: int = 0  # row of the case
    key: bytes = b""  # of what is integrated, but for its table of values


class Stretches(Predictor):
    """A body on the runs of a case, or on proposed settings."""

    def __init__(self, base: Integrated, problem: Problem) -> None:
        super().__init__(problem, base.step)
        self.base = base
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
        stretches = _runs(base, problem, columns) if problem.runs else _settings(columns, problem.count)
        law = repr((base.name, problem.channels, problem.effects, slots, own)).encode()
        self.stretches = [replace(one, key=_key(law, one)) for one in stretches]
        if problem.runs:
            self._check_lengths(base.body, problem.runs)

    def sets(self, sets: Array) -> Array:
        tables = self._tables(sets)
        return self._over_runs(lambda one: [self._motions(one, table[None])[0] for table in tables])

    def near(self, sets: Array) -> Array:
        tables = self._tables(sets)
        return self._over_runs(lambda one: self._motions(one, tables))

    def _motions(self, one: _Stretch, tables: Array) -> list[Array]:
        """Channels (channels, samples) of a run and its neighbours, (1 + neighbours, slots)."""

        def integrate(some: Array) -> Sequence[Mapping[str, Array]]:
            return self.plan.near(some, one.time, one.inputs, one.start)

        return KEPT.near(one.key, tables, self.problem.channels, integrate)

    def acting(self, theta: Array, target: str) -> Act | None:
        if target in self.problem.channels:
            return None
        unit = Effect(PROBE, "", "", "", (self.base.name,), (Parameter(PROBE, "1", 0.0),), (), PROBE, target)
        fitted = (*self.problem.fitted, Fitted(f"{PROBE}.{PROBE}", PROBE, PROBE, "1", 0.0, -np.inf, np.inf))
        larger = Stretches(self.base, replace(self.problem, effects=(*self.problem.effects, unit), fitted=fitted))
        tables = larger._tables(np.array([[*theta, 0.0], [*theta, UNIT]]))

        def act(features: Array) -> Array:
            def solve(one: _Stretch) -> list[Array]:
                shapes = np.zeros((len(one.time), len(features)))
                shapes[one.samples] = features[:, one.rows].T
                found = larger.plan.shaped(tables, one.time, one.inputs, one.start, shapes)
                return [np.stack([motion[name] for name in self.problem.channels]) for motion in found]

            return larger._over_runs(solve) / UNIT

        return act

    def _check_lengths(self, body: Body, runs: Runs) -> None:
        """UserError where a run is shorter than the swing that it should show."""
        arm = self.table[self.plan.slots[body.swings]] if body.swings else np.nan
        period = 2.0 * np.pi * np.sqrt(arm / self.table[self.plan.slots["gravity"]]) if arm > 0.0 else 0.0
        for one in self.stretches:
            if one.time[-1] - one.time[0] < period:
                raise UserError(
                    f"{runs.place(one.first)}: run {one.name} lasts {one.time[-1] - one.time[0]:.3g} s, "
                    f"expected at least the {period:.3g} s of a swing"
                )

    def trouble(self, theta: Array) -> str:
        for one in self.stretches:
            found = self.plan.channels(self._tables(theta[None])[0], one.time, one.inputs, one.start)
            bad = np.flatnonzero(~np.isfinite(np.stack(list(found.values()))).all(axis=0))
            if bad.size:
                return (
                    f"run {one.name}: the motion has no number from time {one.time[bad[0]]:.6g} s on: it leaves all "
                    "bounds, or no soil carries a wheel; expected parameters at which it stays bounded"
                )
        return ""

    def _over_runs(self, solve: Callable[[_Stretch], Sequence[Array]]) -> Array:
        """Channels (sets, channels, rows) of what `solve` says of each run, sets of (channels, samples); in threads, as
        many as OMP_NUM_THREADS says, else as there are cores: each run is the same whoever integrates it."""
        each = list(_pool(cores()).map(solve, self.stretches)) if cores() > 1 else list(map(solve, self.stretches))
        found = np.empty((len(each[0]), len(self.problem.channels), self.problem.count))
        for stretch, sets in zip(self.stretches, each, strict=True):
            for prediction, channels in zip(found, sets, strict=True):
                prediction[:, stretch.rows] = channels[:, stretch.samples]
        return found

    def _tables(self, sets: Array) -> Array:
        """A table of values (sets, slots) for each set of parameters."""
        tables = np.repeat(self.table[None], len(sets), axis=0)
        tables[:, self.places] = sets
        return tables


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)


def _key(law: bytes, one: _Stretch) -> bytes:
    inputs = (part for name, values in sorted(one.inputs.items()) for part in (name.encode(), values.tobytes()))
    return digest(law, one.time.tobytes(), np.float64(one.start).tobytes(), *inputs)


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
        rate = base.start_rate(runs, mine, clock)
        found.append(_Stretch(clock, parts, rate, samples, at, runs.names[run], int(mine[0])))
    return found
