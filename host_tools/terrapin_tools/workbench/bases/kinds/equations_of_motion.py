"""Differential equations of the user's own on the runs of a case.

A state that starts at a number or a column's value starts there. One whose start is to be fitted takes, at any values
of the parameters, the start at which the run fits its measurements best (least squares, each channel weighted by the
scatter from row to row). Predictions and derivatives are those beyond such starts (variable projection: Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432), so a fit sees the parameters alone. All stretches are solved at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.equations.ode import Linear, Ode, OdeDrive, OdeEnds, OdeError, OdeRun
from terrapin_hil.physics.expression import Name, Node, Operation, parse
from terrapin_hil.physics.program import Instruction, instructions
from terrapin_hil.physics.signals import delayed, row_scatter
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import GAIN, Act, Dynamics, Predictor, Problem, Runs
from terrapin_tools.workbench.bases.kinds.late_channels import Shift, shift_of
from terrapin_tools.workbench.bases.kinds.starts import ABSURD, Near

__all__ = ["Stretches"]

FIRST_ROWS = 9  # from which a start is guessed
SMOOTH = 0.001  # of a state's size: where sign() turns in a solution; 0.01 showed as a missing term in noise of 1 %
ADD, MULTIPLY = (2, 0, 0.0), (4, 0, 0.0)  # HIL_OP_ADD, HIL_OP_MULTIPLY
PARTS = 8  # stretches of a run at least, where its rows allow
ITERATIONS = 30  # of the search for a start
ENOUGH = 1e-6  # of the sum of squares: a start that gains less is found, but for a step that is linear
REMEMBERED = 200  # sets of parameters whose starts are kept
SAMPLES = 200  # of a proposed setting
EASY, STIFFER = 30, 4  # steps a row that a solution may always take, and times those of the first solution
DELAYED = 1e-2  # of a row: the step of a derivative by a delay
JUMP = 0.1  # of its largest step: more an input does where it jumps, ten times what it does in the rows beside that
STRETCH = (25, 400)  # rows of a stretch: fewer tell little beside its start, in more a lacking term leads far away


@dataclass(frozen=True)
class _Layout:
    """Samples in stretches: what drives them, where each run begins among them and the last one ends, what was
    measured (samples, channels), a first guess of the states where each stretch begins (stretches, states), which of
    these are fitted, the names of the runs, the first row of each stretch, and which of the samples are wanted, at
    which of the rows."""

    drive: OdeDrive
    runs: list[int]
    measured: Array
    guess: Array
    free: Mask
    names: list[str]
    first: list[int]
    samples: Index
    rows: Index


@dataclass(frozen=True)
class _Solved:
    """At `theta`: the run from the best starts (stretches, states), and how these follow the parameters (stretches,
    states, parameters). `channels` (samples, channels) are those of the very best starts, `basis` (stretches, padded
    samples * channels, states) is orthonormal, of what the starts can do, weighted."""

    theta: Array
    run: OdeRun
    channels: Array
    start: Array
    follows: Array
    basis: Array


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
        stated = set().union(*(formula.names for formula in formulas))
        self.inputs = [n for n in problem.inputs if n in used and n not in names and n != "time"]
        self.drives = [n for n in self.inputs if n in stated]  # of the case's own equations, whatever an effect reads
        listed = ["time", *names, *self.inputs, *(n for n in problem.constants if n not in self.inputs)]
        listed += [f.key for f in problem.fitted if f.effect is None or f.key in own]
        self.slots = {name: slot for slot, name in enumerate(listed)}
        self.table = np.zeros(len(listed))
        for name, value in problem.constants.items():
            self.table[self.slots[name]] = value
        self.places = np.array([self.slots[f.key] for f in problem.fitted], dtype=np.int64)
        weight, self.size = _sizes(problem, self.dynamics)
        self.weight = np.asarray(weight)
        self.changed = self._changed()
        derivatives = [
            self._formula(self.dynamics.derivative[name].text, f"derivative.{name}") for name in self.dynamics.states
        ]
        channels = [self._formula(problem.formulas[name].text, name) for name in problem.channels]
        turning = {name for formula in (*formulas, *added) for name in _inside_sign(formula.tree)} & set(names)
        smoothing = SMOOTH * min((float(self.size[names.index(name)]) for name in turning), default=1.0)
        held = self.dynamics.held
        try:
            self.ode = Ode(derivatives, channels, len(listed), self.places.tolist(), self.size, smoothing, held)
        except ValueError as error:
            raise UserError(f"model.derivative: {error}") from None
        self.layout = self._of_runs() if problem.runs else self._settings()
        begin, count = np.asarray(self.layout.drive.begin), len(self.layout.drive.time)
        places = begin[:-1, None] + np.arange(np.diff(begin).max(initial=1))
        self.padded = np.where(places < begin[1:, None], places, count)  # (stretches, samples), `count` for none
        self.unpadded = np.flatnonzero(self.padded < count)  # places of the samples among the padded ones
        wanted = np.zeros((count, 1, 1))  # rows that are left out (a sensor that stuck) tell nothing of a start
        wanted[self.layout.samples] = 1.0
        self.weights = self.weight[:, None] * wanted  # of each sample (samples, channels, 1)
        late = {effect.name: effect for effect in problem.effects if effect.transform in ("inputs", "late")}
        clocks = [
            (i, late[f.effect]) for i, f in enumerate(problem.fitted) if f.effect is not None and f.effect in late
        ]
        self.delays = [i for i, effect in clocks if effect.transform == "inputs"]  # among the fitted
        self.lates = [(i, problem.channels.index(e.target)) for i, e in clocks if e.transform == "late"]
        self.shifts: list[Shift] = []  # of the channels that come late
        self.drive = self.layout.drive  # as the inputs act
        self.solved: _Solved | None = None  # as last found
        codes = (tuple(map(tuple, derivatives)), tuple(map(tuple, channels)))
        self.equations = hash((codes, self.table.tobytes(), self.places.tobytes()))

    def _changed(self) -> dict[str, list[Instruction]]:
        """What computes each constant that effects multiply by 1 and their expressions."""
        found: dict[str, list[Instruction]] = {}
        for effect in self.problem.effects:
            if effect.target in self.problem.constants:
                mine = {p.name: self.slots[f"{effect.name}.{p.name}"] for p in effect.parameters}
                factor = instructions(f"1 + ({effect.expression})", {**self.slots, **mine}, {})
                before = found.get(effect.target, instructions(effect.target, self.slots, {}))
                found[effect.target] = [*before, *factor, MULTIPLY]
        return found

    def _formula(self, text: str, target: str) -> list[tuple[int, int, float]]:
        """A formula with what effects multiply its constants and it with and add to it; their own parameters hide equal
        names."""
        code = instructions(text, self.slots, self.changed)
        gain = GAIN + target.removeprefix("derivative.")
        for effect in sorted(self.problem.effects, key=lambda effect: effect.target != gain):
            if effect.transform:
                continue
            mine = {p.name: self.slots[f"{effect.name}.{p.name}"] for p in effect.parameters}
            if effect.target == gain:
                code = [*code, *instructions(f"1 + ({effect.expression})", {**self.slots, **mine}, {}), MULTIPLY]
            elif effect.target == target:
                code = [*code, *instructions(effect.expression, {**self.slots, **mine}, {}), ADD]
        return code

    # -- rows --------------------------------------------------------------------------------------------------------

    def _of_runs(self) -> _Layout:
        """Each run that has a wanted row."""
        problem, runs = self.problem, self.problem.runs
        assert runs is not None
        time = problem.inputs["time"]
        wanted = np.arange(len(runs.index)) if problem.rows is None else np.flatnonzero(problem.rows)
        longest = _half_period(problem, runs)
        parts: list[Index] = []
        first: list[bool] = []
        for run in np.unique(runs.index[wanted]):
            mine = np.flatnonzero(runs.index == run)
            _check_times(runs, mine, time[mine])
            begun = len(parts)
            for piece in np.split(mine, self._jumps(mine)):
                count = max(1, round(len(piece) / max(min(longest, len(mine) // PARTS), STRETCH[0])))
                parts += np.array_split(piece, count)
            first += [True] + [False] * (len(parts) - begun - 1)
        every = np.concatenate(parts)
        begin = np.cumsum([0, *map(len, parts)])
        place = np.full(len(runs.index), -1)
        place[wanted] = np.arange(len(wanted))
        samples = np.flatnonzero(place[every] >= 0)
        measured = np.column_stack([runs.measured[c][every] for c in problem.channels])
        states = self.dynamics.states
        each = zip(parts, first, strict=True)
        known = np.array([[self._known(n, part) if at_first else np.nan for n in states] for part, at_first in each])
        guess = np.where(np.isnan(known), _guess(problem, self.dynamics, time[every], measured, begin), known)
        drive = self._drive(time[every], {name: problem.inputs[name][every] for name in self.inputs}, begin)
        names = [runs.names[runs.index[part[0]]] for part in parts]
        at = [int(part[0]) for part in parts]
        begins = [*begin[:-1][first].tolist(), len(every)]
        return _Layout(drive, begins, measured, guess, np.isnan(known), names, at, samples, place[every[samples]])

    def _jumps(self, rows: Index) -> list[int]:
        """Places in the rows of a run at which an input has jumped since the row before: when it did nobody knows, so
        no stretch goes over it, where two rows are left for each start that is fitted."""
        if self.dynamics.stated_held:
            return []
        known = all(state.initial is not None for state in self.dynamics.states.values())
        found: list[int] = []
        for name in self.drives:
            steps = np.abs(np.diff(self.problem.inputs[name][rows]))
            around = np.maximum(np.append(steps[1:], 0.0), np.insert(steps[:-1], 0, 0.0))
            found += (np.flatnonzero((steps > JUMP * steps.max(initial=0.0)) & (around < JUMP * steps)) + 1).tolist()
        kept, least = [0], 2 * len(self.dynamics.states)
        for place in sorted(set(found)):
            enough = place - kept[-1] >= least or (known and len(kept) == 1)
            if enough and len(rows) - place >= least:
                kept.append(place)
        return kept[1:]

    def _known(self, state: str, rows: Index) -> float:
        initial = self.dynamics.states[state].initial
        if isinstance(initial, str):
            runs = self.problem.runs
            assert runs is not None
            column = runs.measured[initial] if initial in runs.measured else self.problem.inputs[initial]
            return float(column[rows[0]])
        return np.nan if initial is None else initial

    def _drive(self, time: Array, inputs: Mapping[str, Array], begin: Index) -> OdeDrive:
        stacked = np.column_stack([inputs[n] for n in self.inputs]) if self.inputs else np.zeros((len(time), 0))
        slots = tuple(self.slots[name] for name in self.inputs)
        contiguous = np.ascontiguousarray(stacked, dtype=np.float64)
        return OdeDrive(np.ascontiguousarray(time), contiguous, slots, begin.tolist())

    def _settings(self) -> _Layout:
        """Proposed settings: inputs held from the start on, for the time that each says; what counts is the end."""
        problem, count = self.problem, self.problem.count
        states = self.dynamics.states.values()
        start = np.array([s.initial if isinstance(s.initial, float) else 0.0 for s in states])
        lasting = np.maximum(problem.inputs["time"], 1e-9)
        time = (lasting[:, None] * np.linspace(0.0, 1.0, SAMPLES)).reshape(-1)
        drive = self._drive(
            time, {n: np.repeat(problem.inputs[n], SAMPLES) for n in self.inputs}, SAMPLES * np.arange(count + 1)
        )
        none, guess = np.zeros((len(time), len(problem.channels))), np.tile(start, (count, 1))
        ends = SAMPLES * np.arange(1, count + 1) - 1
        fixed, rows = np.zeros(guess.shape, dtype=bool), np.arange(count)
        return _Layout(drive, list(drive.begin), none, guess, fixed, [""] * count, [-1] * count, ends, rows)

    # -- solutions ---------------------------------------------------------------------------------------------------

    def _solve(self, theta: Array) -> _Solved:
        """All stretches from where each fits best, with derivatives by the parameters. OdeError."""
        if self.solved is not None and np.array_equal(self.solved.theta, theta):
            return self.solved
        table = self.table.copy()
        table[self.places] = theta
        states = len(self.size)
        self.drive = self._delayed(theta)
        self.shifts = [
            shift_of(channel, place, float(theta[place]), self.layout.drive.time, self.layout.drive.begin)
            for place, channel in self.lates
        ]
        start, run = self._first(theta, table)
        assert run.slopes is not None
        damping = np.zeros(len(start))
        near = self._near(run)
        stuck = np.zeros(len(start), dtype=bool)
        for _ in range(ITERATIONS):
            active = ~stuck & (near.gain > ENOUGH * near.cost)
            if not active.any():
                break
            new = np.where(active[:, None], start + near.step(damping), start)
            other = OdeRun(np.zeros_like(run.states), np.zeros_like(run.channels), np.zeros_like(run.slopes))
            ends = self._run(table, self.drive, new, active, other)
            there = self._near(other)
            better = active & ~ends.failed & (there.cost < near.cost)
            near.take(there, better)
            start = np.where(better[:, None], new, start)
            self._take(run, other, better)
            damping = np.where(better, 0.1 * damping, np.where(active, np.maximum(10.0 * damping, 1e-3), damping))
            stuck |= damping > 1e6
        for place in self.delays:
            run.slopes[:, :, states + place] = self._by_delay(theta, table, place, start, run)
        basis = near.basis()
        # what is left of the way to the best start is so short that the channels are linear on it
        found = near.gain <= ENOUGH * near.cost
        left = np.einsum("sij,sj->si", basis, np.where(found[:, None], near.scores, 0.0))
        channels = run.channels + self._unpadded(left[..., None])[..., 0] / self.weight
        by = self._weighted(run.slopes[:, :, states:])
        self.solved = _Solved(theta.copy(), run, channels, start, near.follows(by), basis)
        self._remember(theta, start)
        return self.solved

    def _delayed(self, theta: Array) -> OdeDrive:
        """The inputs, later by the delay that is fitted: linear between rows, and before a run's first row as there."""
        late, drive = float(theta[self.delays].sum()), self.layout.drive
        if late == 0.0 or not self.inputs:
            return drive
        moved = np.empty_like(drive.inputs)
        for begin, end in pairwise(self.layout.runs):
            mine = slice(begin, end)
            for moving, values in zip(moved.T, drive.inputs.T, strict=True):
                moving[mine] = delayed(drive.time[mine], values[mine], late)
        return replace(drive, inputs=moved)

    def _run(self, table: Array, drive: OdeDrive, start: Array, which: Mask, run: OdeRun) -> OdeEnds:
        """The stretches `which` from their starts, put into `run`, channels that come late as they are recorded."""
        ends = self.ode.run_some(table, drive, start, which, run)
        mine = self.padded[which].reshape(-1)
        mine = mine[mine < len(run.states)]
        for shift in self.shifts:
            at, by = run.channels[:, shift.channel], None if run.slopes is None else run.slopes[:, shift.channel]
            recorded, rising = shift.of(at, mine), shift.rising(at, mine)
            if by is not None:
                by[mine] = shift.of(by, mine)
                by[mine, len(self.size) + shift.place] = -rising
            at[mine] = recorded
        return ends

    def _by_delay(self, theta: Array, table: Array, place: int, start: Array, run: OdeRun) -> Array:
        """Derivative of the channels (samples, channels) by a delay, from the same starts; 0 where there is none."""
        step = DELAYED * float(np.median(np.diff(self.layout.drive.time)))
        moved = theta + step * (np.arange(len(theta)) == place)
        other = OdeRun(np.zeros_like(run.states), np.zeros_like(run.channels), None)
        every = np.ones(len(start), dtype=bool)
        ends = self._run(table, self._delayed(moved), start, every, other)
        return np.zeros_like(run.channels) if ends.failed.any() else (other.channels - run.channels) / step

    def _remember(self, theta: Array, start: Array) -> None:
        """Keeps the starts, by their first rows, for another predictor of the same equations on these rows, or more."""
        if not self.layout.free.any():
            return
        kept = self.dynamics.starts
        known = kept.pop((self.equations, theta.tobytes()), {})
        kept[self.equations, theta.tobytes()] = {**known, **dict(zip(self.layout.first, start, strict=True))}
        while len(kept) > REMEMBERED:
            kept.pop(next(iter(kept)))

    def _first(self, theta: Array, table: Array) -> tuple[Array, OdeRun]:
        """Starts to search from, with their run: where the last ones lead, else the last ones, else the guess. OdeError
        of the first stretch that none of them takes to its end."""
        layout, last = self.layout, self.solved
        count, states = len(layout.drive.time), len(self.size)
        known = self.dynamics.starts.get((self.equations, theta.tobytes()), {})
        tried = [np.array([known.get(row, g) for row, g in zip(layout.first, layout.guess, strict=True)]), layout.guess]
        if last is not None and not known:
            tried = [last.start + last.follows @ (theta - last.theta), last.start, layout.guess]
        columns = states + len(self.places)
        shape = (count, len(self.problem.channels))
        run = OdeRun(np.zeros((count, states)), np.zeros(shape), np.zeros((*shape, columns)))
        assert run.slopes is not None
        start, waiting = layout.guess.copy(), np.ones(len(layout.guess), dtype=bool)
        steps = np.zeros(len(start), dtype=np.int64)
        for one in tried:
            start[waiting] = one[waiting]
            ends = self._run(table, self.drive, start, waiting, run)
            sound = np.append((np.abs(run.slopes) < ABSURD).all(axis=(1, 2)), True)[self.padded].all(axis=1)
            steps = np.where(waiting, ends.steps, steps)
            waiting &= ends.failed | ~sound
            if not waiting.any():
                self._require_ease(steps)
                return start, run
            if (ends.failed & ends.stiff).any():  # at these parameters, wherever it starts
                break
        number = int(np.flatnonzero(waiting)[0])
        if ends.failed[number]:
            raise ends.error(number)
        raise OdeError(False, 0, float(layout.drive.time[layout.drive.begin[number + 1] - 1]), number)

    def _require_ease(self, steps: Index) -> None:
        """OdeError where a solution in so many steps a stretch is far stiffer than the first one was: no row shows so
        fast a motion, and a fit that drives a time constant to zero would stay with it."""
        drive, effort = self.layout.drive, self.dynamics.effort
        begin, end = np.array(drive.begin[:-1]), np.array(drive.begin[1:]) - 1
        lasting = float((drive.time[end] - drive.time[begin]).sum())
        if not effort:
            effort.append(float(steps.sum()) / max(lasting, 1e-300))
        if steps.sum() > max(EASY * len(drive.time), STIFFER * effort[0] * lasting):
            worst = int(np.argmax(steps / (end - begin + 1)))
            raise OdeError(True, 0, float(drive.time[begin[worst]]), worst)

    def _take(self, run: OdeRun, other: OdeRun, which: Mask) -> None:
        """Puts the stretches `which` of the other run into the first."""
        assert run.slopes is not None
        assert other.slopes is not None
        taken = self.padded[which].reshape(-1)
        taken = taken[taken < len(run.states)]
        run.states[taken], run.channels[taken], run.slopes[taken] = (
            other.states[taken],
            other.channels[taken],
            other.slopes[taken],
        )

    def _near(self, run: OdeRun) -> Near:
        """What the fitted starts of each stretch can do around a run."""
        assert run.slopes is not None
        columns = self._weighted(run.slopes[:, :, : len(self.size)]) * self.layout.free[:, None, :]
        return Near(self._weighted((self.layout.measured - run.channels)[..., None])[..., 0], columns)

    def _weighted(self, change: Array) -> Array:
        """Samples (samples, channels, count) in stretches, weighted: (stretches, padded samples * channels, count)."""
        whole = np.zeros((len(change) + 1, *change.shape[1:]))
        np.multiply(change, self.weights, out=whole[:-1])
        return whole.take(self.padded, axis=0).reshape(len(self.padded), -1, change.shape[2])

    def _unpadded(self, weighted: Array) -> Array:
        """What `_weighted` gives in the order of the samples, its weights kept: (samples, channels, count)."""
        return weighted.reshape(-1, len(self.weight), weighted.shape[2]).take(self.unpadded, axis=0)

    def _beyond(self, solved: _Solved, change: Array) -> Array:
        """A change of the channels (samples, channels, ...) less what other starts would make of it."""
        flat = self._weighted(change)
        taken = solved.basis @ (np.swapaxes(solved.basis, 1, 2) @ flat)
        return np.asarray(change - self._unpadded(taken) / self.weight[:, None])

    def _placed(self, values: Array) -> Array:
        """Samples (samples, ...) at the wanted rows (rows, ...)."""
        found = np.zeros((self.problem.count, *values.shape[1:]))
        found[self.layout.rows] = values[self.layout.samples]
        return found

    def sets(self, sets: Array) -> Array:
        found = np.full((len(sets), len(self.problem.channels), self.problem.count), np.nan)
        for one, theta in zip(found, sets, strict=True):
            try:
                one[:] = self._placed(self._solve(theta).channels).T
            except OdeError:
                continue
        return found

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        channels, count = len(self.problem.channels), self.problem.count
        try:
            solved = self._solve(theta)
        except OdeError:
            return np.full((channels, count), np.nan), np.full((channels, count, len(theta)), np.nan)
        assert solved.run.slopes is not None
        by = self._beyond(solved, solved.run.slopes[:, :, len(self.size) :])
        return self._placed(solved.channels).T, np.moveaxis(self._placed(by), 0, 1)

    def motion(self, theta: Array) -> Mapping[str, Array]:
        return dict(zip(self.dynamics.states, self._placed(self._solve(theta).run.states).T, strict=True))

    def acting(self, theta: Array, target: str) -> Act:
        solved, layout = self._solve(theta), self.layout
        table = self.table.copy()
        table[self.places] = theta
        linear: Linear | None = None
        through: Array | float = 1.0  # what the feature is multiplied with on its way
        if target not in self.problem.channels:
            name = target.removeprefix(GAIN).removeprefix("derivative.")
            linear = self.ode.linear(table, self.drive, solved.run.states, list(self.dynamics.states).index(name))
            if target.startswith(GAIN):
                known: dict[str, Array | float] = {n: float(table[slot]) for n, slot in self.slots.items()}
                taken = slice(None) if self.problem.rows is None else self.problem.rows
                known |= {n: self.problem.inputs[n][taken] for n in ("time", *self.inputs)}
                through = self.dynamics.derivative[name].evaluate({**known, **self.motion(theta)})

        def one(feature: Array) -> Array:
            addition = np.zeros(len(layout.measured))
            addition[layout.samples] = (feature * through)[layout.rows]
            if linear is not None:
                change = linear.respond(addition)
            else:
                change = np.zeros_like(layout.measured)
                change[:, self.problem.channels.index(target)] = addition
            for shift in self.shifts:
                change[:, shift.channel] = shift.of(change[:, shift.channel])
            return self._placed(self._beyond(solved, change[..., None])[..., 0]).T

        return lambda features: np.array([one(feature) for feature in features])

    def trouble(self, theta: Array) -> str:
        try:
            self._solve(theta)
        except OdeError as error:
            name = list(self.dynamics.states)[error.state]
            why = "is too stiff" if error.stiff else "leaves all bounds"
            hint = "a slower derivative" if error.stiff else "start values at which it stays bounded"
            run = self.layout.names[error.stretch]
            return f"run {run}: state {name} {why} at time {error.time:.6g} s, expected {hint}"
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
    weight = []
    for channel in problem.channels:
        values = runs.measured[channel]
        scatter = row_scatter(values, runs.index)
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


def _guess(problem: Problem, dynamics: Dynamics, time: Array, measured: Array, begin: Index) -> Array:
    """Starts (stretches, states) as the first samples of each stretch tell them: of what is measured, and of what is
    its rate; else 0."""
    found = {name: np.zeros(len(begin) - 1) for name in dynamics.states}
    direct = _measured_as(problem)
    order = np.minimum(np.diff(begin) - 1, 2)
    places = np.minimum(begin[:-1, None] + np.arange(FIRST_ROWS), begin[1:, None] - 1)
    clock = time[places] - time[places[:, :1]]
    span = np.maximum(clock.max(axis=1), 1e-300)
    powers = (clock / span[:, None])[..., None] ** np.arange(3)
    inverse = np.linalg.pinv(np.where(np.arange(3) <= order[:, None, None], powers, 0.0), rcond=1e-9)
    for state, channel in direct.items():
        curve = np.einsum("sij,sj->si", inverse, measured[places, problem.channels.index(channel)])
        found[state] = curve[:, 0]
        tree = dynamics.derivative[state].tree if state in dynamics.derivative else None
        if isinstance(tree, Name) and tree.name in found and tree.name not in direct:
            found[tree.name] = curve[:, 1] / span
    return np.stack([found[name] for name in dynamics.states], axis=1)


def _inside_sign(node: Node, inside: bool = False) -> set[str]:
    """Names in the arguments of sign()."""
    if isinstance(node, Name):
        return {node.name} if inside else set()
    if isinstance(node, Operation):
        return set().union(*(_inside_sign(a, inside or node.kind == "sign") for a in node.arguments))
    return set()
