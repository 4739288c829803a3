"""Differential equations of the user's own on the runs of a case.

A state that starts at a number or a column's value starts there. One whose start is to be fitted takes, at any values
of the parameters, the start at which the run fits its measurements best (least squares, each channel weighted by the
scatter from row to row). Predictions and derivatives are those beyond such starts (variable projection: Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432), so a fit sees the parameters alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.equations.ode import Linear, Ode, OdeDrive, OdeError, OdeRun
from terrapin_hil.physics.expression import Name, Node, Operation, parse
from terrapin_hil.physics.program import instructions
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import Act, Dynamics, Predictor, Problem, Runs

__all__ = ["Stretches"]

FIRST_ROWS = 9  # from which a start is guessed
SMOOTH = 0.01  # of a state's size: where sign() turns in a solution
ADD = (2, 0, 0.0)  # HIL_OP_ADD
PARTS = 8  # stretches of a run at least, where its rows allow
ITERATIONS = 30  # of the search for a start
ENOUGH = 1e-6  # of the sum of squares: a start that gains less is found, but for a step that is linear
ABSURD = 1e50  # derivative by a start: the solution runs off
STRETCH = (25, 400)  # rows of a stretch: fewer tell little beside its start, in more a lacking term leads far away


@dataclass(frozen=True)
class _Stretch:
    """Some rows of a run: what drives them, what was measured (samples, channels), a first guess of the states at the
    first, which of these are fitted, and which of the samples are wanted, at which of the rows."""

    name: str
    drive: OdeDrive
    measured: Array
    guess: Array
    free: Index
    samples: Index
    rows: Index


@dataclass(frozen=True)
class _Start:
    """Where a stretch began at `theta`, and how that follows the parameters (states, parameters), where known."""

    theta: Array
    start: Array
    follows: Array | None


@dataclass(frozen=True)
class _Solved:
    run: OdeRun
    channels: Array  # (samples, channels), from the best start
    start: Array
    basis: Array  # (samples * channels, free starts), orthonormal, of what the starts can do, weighted


class Stretches(Predictor):
    """The equations, with effects, on the runs of a case or on proposed settings."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        assert problem.dynamics is not None
        self.dynamics: Dynamics = problem.dynamics
        names = list(self.dynamics.states)
        formulas = [*self.dynamics.derivative.values(), *problem.formulas.values()]
        added = [parse(effect.expression) for effect in problem.effects]
        used = set().union(*(formula.names for formula in (*formulas, *added)))
        own = {f"{effect.name}.{p.name}" for effect in problem.effects for p in effect.parameters}
        self.inputs = [n for n in problem.inputs if n in used and n not in names and n != "time"]
        listed = ["time", *names, *self.inputs, *(n for n in problem.constants if n not in self.inputs)]
        listed += [f.key for f in problem.fitted if f.effect is None or f.key in own]
        self.slots = {name: slot for slot, name in enumerate(listed)}
        self.table = np.zeros(len(listed))
        for name, value in problem.constants.items():
            self.table[self.slots[name]] = value
        self.places = np.array([self.slots[f.key] for f in problem.fitted], dtype=np.int64)
        weight, self.size = _sizes(problem, self.dynamics)
        self.weight = np.asarray(weight)
        derivatives = [
            self._formula(self.dynamics.derivative[name].text, f"derivative.{name}") for name in self.dynamics.states
        ]
        channels = [self._formula(problem.formulas[name].text, name) for name in problem.channels]
        turning = {name for formula in (*formulas, *added) for name in _inside_sign(formula.tree)} & set(names)
        smoothing = SMOOTH * min((float(self.size[names.index(name)]) for name in turning), default=1.0)
        common = (len(listed), self.size, smoothing, self.dynamics.held)
        try:
            self.plain = Ode(derivatives, channels, common[0], [], *common[1:])
            self.free = Ode(derivatives, channels, common[0], self.places.tolist(), *common[1:])
        except ValueError as error:
            raise UserError(f"model.derivative: {error}") from None
        self.stretches = self._of_runs() if problem.runs else self._settings()
        self.starts: dict[int, _Start] = {}  # of each stretch, as last found

    def _formula(self, text: str, target: str) -> list[tuple[int, int, float]]:
        """A formula with what effects add to it; their own parameters hide equal names."""
        code = instructions(text, self.slots, {})
        for effect in self.problem.effects:
            if effect.target == target:
                mine = {p.name: self.slots[f"{effect.name}.{p.name}"] for p in effect.parameters}
                code = [*code, *instructions(effect.expression, {**self.slots, **mine}, {}), ADD]
        return code

    # -- rows --------------------------------------------------------------------------------------------------------

    def _of_runs(self) -> list[_Stretch]:
        """Each run that has a wanted row."""
        problem, runs = self.problem, self.problem.runs
        assert runs is not None
        time = problem.inputs["time"]
        wanted = np.arange(len(runs.index)) if problem.rows is None else np.flatnonzero(problem.rows)
        place = np.full(len(runs.index), -1)
        place[wanted] = np.arange(len(wanted))
        found = []
        longest = _half_period(problem, runs)
        for run in np.unique(runs.index[wanted]):
            mine = np.flatnonzero(runs.index == run)
            _check_times(runs, mine, time[mine])
            count = round(len(mine) / max(min(longest, len(mine) // PARTS), STRETCH[0]))
            for part in np.array_split(mine, max(1, count)):
                samples = np.flatnonzero(place[part] >= 0)
                if samples.size:
                    found.append(self._stretch(runs, part, part[0] == mine[0], samples, place[part[samples]]))
        return found

    def _stretch(self, runs: Runs, rows: Index, first: bool, samples: Index, at: Index) -> _Stretch:
        problem = self.problem
        time = problem.inputs["time"][rows]
        measured = np.column_stack([runs.measured[c][rows] for c in problem.channels])
        known = np.array([self._known(name, rows) if first else np.nan for name in self.dynamics.states])
        guess = np.where(np.isnan(known), _guess(problem, self.dynamics, time, measured), known)
        drive = self._drive(time, {name: problem.inputs[name][rows] for name in self.inputs})
        return _Stretch(
            runs.names[runs.index[rows[0]]], drive, measured, guess, np.flatnonzero(np.isnan(known)), samples, at
        )

    def _known(self, state: str, rows: Index) -> float:
        initial = self.dynamics.states[state].initial
        if isinstance(initial, str):
            runs = self.problem.runs
            assert runs is not None
            column = runs.measured[initial] if initial in runs.measured else self.problem.inputs[initial]
            return float(column[rows[0]])
        return np.nan if initial is None else initial

    def _drive(self, time: Array, inputs: Mapping[str, Array]) -> OdeDrive:
        stacked = np.column_stack([inputs[n] for n in self.inputs]) if self.inputs else np.zeros((len(time), 0))
        slots = tuple(self.slots[name] for name in self.inputs)
        return OdeDrive(np.ascontiguousarray(time), np.ascontiguousarray(stacked, dtype=np.float64), slots)

    def _settings(self) -> list[_Stretch]:
        """Proposed settings: inputs held from the start on, for the time that each says; what counts is the end."""
        problem, count = self.problem, self.problem.count
        found = []
        states = self.dynamics.states.values()
        start = np.array([s.initial if isinstance(s.initial, float) else 0.0 for s in states])
        for row in range(count):
            time = np.linspace(0.0, max(float(problem.inputs["time"][row]), 1e-9), 200)
            drive = self._drive(time, {n: np.full(len(time), problem.inputs[n][row]) for n in self.inputs})
            none = np.zeros((len(time), len(problem.channels)))
            found.append(
                _Stretch("", drive, none, start, np.zeros(0, np.int64), np.array([len(time) - 1]), np.array([row]))
            )
        return found

    # -- solutions ---------------------------------------------------------------------------------------------------

    def _solve(self, theta: Array, number: int, slopes: bool = False) -> _Solved:
        """A stretch from where it fits best; with derivatives by the parameters if asked for. OdeError."""
        stretch, table = self.stretches[number], self._at(theta)
        free = stretch.free
        ode = self.free if slopes else self.plain
        if not free.size:
            run = ode.run(table, stretch.drive, stretch.guess, slopes)
            return _Solved(run, run.channels, stretch.guess, np.zeros((stretch.measured.size, 0)))
        start, run = self._first(theta, table, number)
        damping = 0.0
        for _ in range(ITERATIONS):
            residual, columns = self._weighted(stretch, run)
            if not (np.abs(columns) < ABSURD).all():
                raise OdeError(False, int(free[0]), float(stretch.drive.time[-1]))
            basis, triangle = np.linalg.qr(columns)
            scores = basis.T @ residual
            cost = float(residual @ residual)
            if not np.isfinite(cost) or float(scores @ scores) <= ENOUGH * cost:
                break
            better = None
            while better is None and damping < 1e6:
                new = start.copy()
                new[free] += _step(triangle, scores, damping)
                better = self._better(table, stretch, new, cost)
                if better is None:
                    damping = max(10.0 * damping, 1e-3)
            if better is None:
                break
            run, start, damping = better, new, 0.1 * damping
        basis = _orthonormal(columns)
        # what is left of the way to the best start is so short that the channels are linear on it
        channels = run.channels + (basis @ (basis.T @ residual)).reshape(run.channels.shape) / self.weight
        follows = None
        if slopes:
            run = ode.run(table, stretch.drive, start, True)
            assert run.slopes is not None
            by = (run.slopes[:, :, len(self.size) :] * self.weight[:, None]).reshape(residual.size, -1)
            follows = np.zeros((len(start), len(theta)))
            follows[free] = -np.linalg.lstsq(columns, by, rcond=1e-9)[0]
        self.starts[number] = _Start(theta, start, follows)
        return _Solved(run, channels, start, basis)

    def _first(self, theta: Array, table: Array, number: int) -> tuple[Array, OdeRun]:
        """A start to search from, with its run: where the last ones lead, else the guess."""
        stretch, last = self.stretches[number], self.starts.get(number)
        tried = [stretch.guess]
        if last is not None:
            tried.insert(0, last.start)
            if last.follows is not None:
                tried.insert(0, last.start + last.follows @ (theta - last.theta))
        for start in tried[:-1]:
            try:
                return start, self.plain.run(table, stretch.drive, start, True)
            except OdeError:
                continue
        return stretch.guess, self.plain.run(table, stretch.drive, stretch.guess, True)

    def _better(self, table: Array, stretch: _Stretch, start: Array, cost: float) -> OdeRun | None:
        """The run from a start, if it fits better."""
        try:
            run = self.plain.run(table, stretch.drive, start, True)
        except OdeError:
            return None
        left = (stretch.measured - run.channels) * self.weight
        return run if float((left * left).sum()) < cost else None

    def _weighted(self, stretch: _Stretch, run: OdeRun) -> tuple[Array, Array]:
        """Residual (samples * channels,) and its derivatives by the fitted starts."""
        assert run.slopes is not None
        residual = ((stretch.measured - run.channels) * self.weight).reshape(-1)
        columns = (run.slopes[:, :, stretch.free] * self.weight[:, None]).reshape(residual.size, -1)
        return residual, columns

    def _beyond(self, solved: _Solved, change: Array) -> Array:
        """A change of the channels (samples, channels, ...) less what other starts would make of it."""
        weight = self.weight.reshape(-1, *(1,) * (change.ndim - 2))
        flat = (change * weight).reshape(solved.basis.shape[0], -1)
        flat = flat - solved.basis @ (solved.basis.T @ flat)
        return np.asarray(flat.reshape(change.shape) / weight)

    def _at(self, theta: Array) -> Array:
        table = self.table.copy()
        table[self.places] = theta
        return table

    def sets(self, sets: Array) -> Array:
        found = np.full((len(sets), len(self.problem.channels), self.problem.count), np.nan)
        for one, theta in zip(found, sets, strict=True):
            for number, stretch in enumerate(self.stretches):
                try:
                    solved = self._solve(theta, number)
                except OdeError:
                    break
                one[:, stretch.rows] = solved.channels[stretch.samples].T
        return found

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        channels, count = len(self.problem.channels), self.problem.count
        found = np.full((channels, count), np.nan)
        slopes = np.full((channels, count, len(theta)), np.nan)
        for number, stretch in enumerate(self.stretches):
            try:
                solved = self._solve(theta, number, slopes=True)
            except OdeError:
                break
            assert solved.run.slopes is not None
            by = self._beyond(solved, solved.run.slopes[:, :, len(self.size) :])
            found[:, stretch.rows] = solved.channels[stretch.samples].T
            slopes[:, stretch.rows] = np.moveaxis(by[stretch.samples], 0, 1)
        return found, slopes

    def motion(self, theta: Array) -> Mapping[str, Array]:
        found = np.zeros((len(self.size), self.problem.count))
        for number, stretch in enumerate(self.stretches):
            solved = self._solve(theta, number)
            found[:, stretch.rows] = solved.run.states[stretch.samples].T
        return dict(zip(self.dynamics.states, found, strict=True))

    def acting(self, theta: Array, target: str) -> Act:
        table = self._at(theta)
        solved = [self._solve(theta, number) for number in range(len(self.stretches))]
        linear: list[Linear] = []
        if target not in self.problem.channels:
            state = list(self.dynamics.states).index(target.removeprefix("derivative."))
            linear = [
                self.plain.linear(table, stretch.drive, one.run.states, state)
                for stretch, one in zip(self.stretches, solved, strict=True)
            ]

        def act(feature: Array) -> Array:
            found = np.zeros((len(self.problem.channels), self.problem.count))
            for number, stretch in enumerate(self.stretches):
                addition = np.zeros(len(stretch.measured))
                addition[stretch.samples] = feature[stretch.rows]
                if linear:
                    change = linear[number].respond(addition)
                else:
                    change = np.zeros_like(stretch.measured)
                    change[:, self.problem.channels.index(target)] = addition
                found[:, stretch.rows] = self._beyond(solved[number], change)[stretch.samples].T
            return found

        return act

    def trouble(self, theta: Array) -> str:
        for number, stretch in enumerate(self.stretches):
            try:
                self._solve(theta, number)
            except OdeError as error:
                name = list(self.dynamics.states)[error.state]
                why = "is too stiff" if error.stiff else "leaves all bounds"
                hint = "a slower derivative" if error.stiff else "start values at which it stays bounded"
                return f"run {stretch.name}: state {name} {why} at time {error.time:.6g} s, expected {hint}"
        return ""


def _check_times(runs: Runs, rows: Index, time: Array) -> None:
    """UserError unless the `time` of a run rises."""
    run, place = runs.names[runs.index[rows[0]]], runs.place
    if len(rows) < 3:
        raise UserError(f"{place(int(rows[0]))}: run {run} has {len(rows)} rows, expected at least 3")
    bad = np.flatnonzero(np.diff(time) <= 0.0)
    if bad.size:
        at = int(bad[0]) + 1
        raise UserError(
            f"{place(int(rows[at]))}: time: found {time[at]:g} s after {time[at - 1]:g} s in run {run}, "
            "expected it to rise from row to row"
        )


def _half_period(problem: Problem, runs: Runs) -> int:
    """Rows in which the fastest channel swings over to the other side: twice where its autocorrelation crosses zero."""
    shortest = STRETCH[1]
    for channel in problem.channels:
        total = np.zeros(STRETCH[1] // 2 + 1)
        for run in np.unique(runs.index):
            values = runs.measured[channel][runs.index == run]
            values = values - values.mean()
            spectrum = np.fft.rfft(values, 2 * len(values))
            lagged = np.fft.irfft(np.abs(spectrum) ** 2)[: min(len(total), len(values))]
            total[: len(lagged)] += lagged
        crossed = np.flatnonzero(total <= 0.0)
        if crossed.size:
            shortest = min(shortest, 2 * int(crossed[0]))
    return max(shortest, STRETCH[0])


def _sizes(problem: Problem, dynamics: Dynamics) -> tuple[Array, Array]:
    """Weight of each channel (1 over its scatter from row to row), and a size of each state, 1 where nothing tells."""
    if problem.runs is None:
        return np.ones(len(problem.channels)), np.ones(len(dynamics.states))
    runs = problem.runs
    order = np.argsort(runs.index, kind="stable")
    inner = (np.diff(runs.index[order], n=1) == 0)[1:] & (np.diff(runs.index[order], n=1) == 0)[:-1]
    weight = []
    for channel in problem.channels:
        values = runs.measured[channel][order]
        scatter = 1.4826 * np.median(np.abs(np.diff(values, n=2)[inner])) / np.sqrt(6.0) if inner.any() else 0.0
        weight.append(1.0 / max(scatter, 1e-4 * float(values.std()), 1e-300))
    size = {}
    for state, channel in _measured_as(problem).items():
        size[state] = max(float(np.abs(runs.measured[channel]).max()), 1e-300)
    time = problem.inputs["time"]
    for state, formula in dynamics.derivative.items():
        if state in size and isinstance(formula.tree, Name) and formula.tree.name not in size:
            values, clock = runs.measured[_measured_as(problem)[state]][order], time[order]
            step = np.where(np.diff(clock) > 0, np.diff(clock), np.inf)
            rate = np.abs(np.diff(values) / step)[np.diff(runs.index[order]) == 0]
            if rate.size and rate.max() > 0.0:
                size[formula.tree.name] = float(np.quantile(rate, 0.95))
    return np.array(weight), np.array([size.get(name, 1.0) for name in dynamics.states])


def _measured_as(problem: Problem) -> dict[str, str]:
    """States that a channel measures by themselves, with that channel."""
    formulas = {name: problem.formulas[name].tree for name in problem.channels}
    return {tree.name: name for name, tree in formulas.items() if isinstance(tree, Name)}


def _guess(problem: Problem, dynamics: Dynamics, time: Array, measured: Array) -> Array:
    """Starts as the first rows tell them: of what is measured, and of what is its rate; else 0."""
    few = min(FIRST_ROWS, len(time))
    found = dict.fromkeys(dynamics.states, 0.0)
    direct = _measured_as(problem)
    for state, channel in direct.items():
        column = measured[:few, problem.channels.index(channel)]
        line = np.polynomial.Polynomial.fit(time[:few] - time[0], column, min(2, few - 1)).convert()
        found[state] = float(line(0.0))
        tree = dynamics.derivative[state].tree if state in dynamics.derivative else None
        if isinstance(tree, Name) and tree.name in found and tree.name not in direct:
            found[tree.name] = float(line.deriv()(0.0))
    return np.array([found[name] for name in dynamics.states])


def _inside_sign(node: Node, inside: bool = False) -> set[str]:
    """Names in the arguments of sign()."""
    if isinstance(node, Name):
        return {node.name} if inside else set()
    if isinstance(node, Operation):
        return set().union(*(_inside_sign(a, inside or node.kind == "sign") for a in node.arguments))
    return set()


def _step(triangle: Array, scores: Array, damping: float) -> Array:
    """The step of Levenberg and Marquardt from a QR decomposition."""
    scale = np.maximum(np.abs(triangle).max(axis=0), 1e-300)
    below = np.sqrt(damping) * np.eye(len(scale))
    stacked, wanted = np.vstack([triangle / scale, below]), np.append(scores, np.zeros(len(scale)))
    return np.asarray(np.linalg.lstsq(stacked, wanted, rcond=1e-9)[0] / scale)


def _orthonormal(columns: Array) -> Array:
    """A basis of what the columns can do; what they hardly can is left out."""
    left, values, _ = np.linalg.svd(
        columns / np.maximum(np.sqrt((columns**2).sum(axis=0)), 1e-300), full_matrices=False
    )
    return np.asarray(left[:, values > 1e-9 * values.max(initial=0.0)])
