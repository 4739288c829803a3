"""Equations of the user's own whose input is not linear between rows: held by a controller, or jumping at any time; and
clocks that are apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases.kinds.equations_of_motion import Stretches
from terrapin_tools.workbench.bases.kinds.late_channels import shift_of
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.case.changes import OwnEffect, extended
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.model.table_faults import Fault, faults_over_time
from tests.python.test_ode import TEXT

ROWS, FINE, STEP = 150, 40, 0.05


SPEED = 'speed = { column = "v", unit = "m/s", sigma = 0.01 }'


def record(
    folder: Path, forces: Array, cubic: float = 0.0, recorded: Array | None = None, late: int | None = None
) -> Case:
    """The spring of test_ode driven by `forces` (runs, ROWS * FINE), each constant for a step of STEP / FINE, by the
    classical method of Runge and Kutta: no part of the project. A row has the force as it is right then; the rows of
    the runs come in turn, as of rigs that are read together. `recorded`: what is told of the forces instead. `late`:
    steps by which a channel of the speed, which there is then, comes after the others."""
    random, step = np.random.default_rng(5), STEP / FINE

    def rate(state: Array, force: Array) -> Array:
        x, v = state
        return np.array([v, (force - 0.5 * v - 8.0 * x - cubic * x**3) / 1.3])

    state, lines, speeds = random.uniform(-0.5, 0.5, (2, len(forces))), ["run,t,f,x,first,v"], list[Array]()
    first = state[0].copy()
    told = forces if recorded is None else recorded
    for i, force in enumerate(forces.T):
        speeds.append(state[1])
        if i % FINE == 0:
            shown = 1000.0 * state[0] + 5.0 * random.standard_normal(len(forces))
            speed = speeds[max(i - (late or 0), 0)] + 0.01 * np.random.default_rng(i).standard_normal(len(forces))
            lines += [
                f"r{run},{1000 * step * i:.9g},{told[run, i]:.9g},{x:.9g},{first[run]:.9g},{speed[run]:.9g}"
                for run, x in enumerate(shown)
            ]
        slopes = [rate(state, force)]
        for share in (0.5, 0.5, 1.0):
            slopes.append(rate(state + share * step * slopes[-1], force))
        state = state + step / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
    folder.mkdir(parents=True)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    text = TEXT if late is None else TEXT.replace('position = "x"', 'position = "x"\nspeed = "v"') + SPEED
    (folder / "case.toml").write_text(text)
    return load_case(folder)


def held() -> Array:
    """Another force each row, as a digital controller sends it."""
    return np.repeat(np.random.default_rng(3).uniform(-5.0, 5.0, (4, ROWS)), FINE, axis=1)


def jumping() -> Array:
    """A force that jumps to the other side about every second, between two rows."""
    random, found = np.random.default_rng(4), np.zeros((4, ROWS * FINE))
    for run in found:
        side = 1.0
        for at in np.cumsum(random.integers(8 * FINE, 32 * FINE, 40)):
            run[at:] = side * random.uniform(2.0, 5.0)
            side = -side
    return found


def test_an_input_that_a_controller_holds_is_told_as_such(tmp_path: Path) -> None:
    """Beside the law that is missing, and not as a term of the model (k*v in position). Put right, it is no fault."""
    case = record(tmp_path / "case", held(), 12.0)
    found = discover(case)
    effects = {one.effect.name: one.effect for one in found.candidates}
    assert all("table.force.held" in one for one in found.rivals)  # whatever law of x stands beside it
    said = {name if isinstance(effects[name], Fault) else effects[name].expression for name in found.missing}
    assert said == {"table.force.held", "k_*x**3"}
    fault = effects["table.force.held"]
    assert isinstance(fault, Fault)
    right = extended(case.text, case.stated, [fault.name], {fault.name: OwnEffect("", None, {}, fault.mend)})
    assert 'inputs = "held"' in right
    assert not [one for one in faults_over_time(case.changed(right), lambda fault: 1.0) if one.held]


def smooth(late: float) -> Array:
    """A force of two waves, which acts `late` [s] after what is recorded of it."""
    time = np.arange(ROWS * FINE) * STEP / FINE - late
    return np.array([3.0 * np.sin(1.1 * time + run) + 1.5 * np.sin(2.7 * time) for run in range(4)])


@pytest.mark.parametrize("late", [-0.07])
def test_an_input_by_another_clock_is_told_as_such(tmp_path: Path, late: float) -> None:
    """Beside the law that is missing. It was 'k*x**3 + k*force in derivative.x, and m would be 1.6 kg' at 0.99."""
    case = record(tmp_path / "case", smooth(late), 12.0, recorded=smooth(0.0))
    found = discover(case)
    assert found.verdict == "missing"
    effects = {one.effect.name: one.effect.expression for one in found.candidates}
    assert {effects[name] for name in found.missing} == {"delay", "k_*x**3"}
    answer = next(h.fit for h in found.ranking.hypotheses if h.effects == found.missing)
    assert answer is not None
    place = [one.key for one in answer.model.fitted].index("input_delay.delay")
    assert abs(answer.theta[place] - late) < 0.02


@pytest.mark.parametrize("cubic", [0.0, 12.0])
def test_a_channel_by_another_clock_is_told_as_such(tmp_path: Path, cubic: float) -> None:
    """By 0.4 of a row, and beside the law that is missing. A speed that came late was 'k*v in position, and force keeps
    its value until the next row' at 0.98, for there the other channel, and what drives both, come early."""
    case = record(tmp_path / "case", smooth(0.0), cubic, late=16)
    found = discover(case)
    assert found.verdict == "missing"
    effects = {one.effect.name: one.effect.expression for one in found.candidates}
    assert {effects[name] for name in found.missing} == {"delay", *(["k_*x**3"] if cubic else [])}
    assert "delay_of_speed" in found.missing
    answer = next(h.fit for h in found.ranking.hypotheses if {*h.effects} == {*found.missing})
    assert answer is not None
    place = [one.key for one in answer.model.fitted].index("delay_of_speed.delay")
    assert abs(answer.theta[place] - 0.02) < 0.003


def test_the_derivatives_by_a_channels_delay_are_those_of_the_prediction(tmp_path: Path) -> None:
    case = record(tmp_path / "case", smooth(0.0), late=16)
    bound = Model.of(case, ["delay_of_speed"]).bind(case.inputs)
    theta = np.array([0.5, 8.0, 0.03])
    slopes = bound.jacobian(theta)[1]
    for place, size in enumerate([1e-3, 1e-3, 1e-4]):
        step = size * (np.arange(3) == place)
        differences = (bound.predict(theta + step) - bound.predict(theta - step)) / (2.0 * size)
        np.testing.assert_allclose(slopes[..., place], differences, atol=0.02 * np.abs(differences).max())
    act, change = bound.acting(theta, "speed"), np.sin(case.roles["time"])
    assert act is not None
    plain = Model.of(case).bind(case.inputs).acting(theta[:2], "speed")
    assert plain is not None
    assert np.abs(act(change[None]) - plain(change[None])).max() > 0.01  # it comes late, too


def test_a_late_channel_of_short_and_long_runs_is_what_it_was_then() -> None:
    """The parabola that each row of it lies on, for runs of three rows as of more. Beside each other they ended the
    program: a run of three rows had fewer neighbours than the others."""
    for lengths in ([3], [3, 4, 10], [10, 3]):
        begin = np.cumsum([0, *lengths])
        time = np.concatenate([0.1 * np.arange(rows) ** 1.2 for rows in lengths])
        shift = shift_of(0, 0, 0.04, time, begin.tolist())
        np.testing.assert_allclose(shift.of(3.0 * time**2 - time), 3.0 * (time - 0.04) ** 2 - (time - 0.04), atol=1e-12)
        every = np.arange(len(time))
        np.testing.assert_allclose(shift.rising(3.0 * time**2 - time, every), 6.0 * (time - 0.04) - 1.0, atol=1e-11)


def test_one_channel_has_no_delay_of_its_own(tmp_path: Path) -> None:
    """It is late as the inputs are early."""
    assert not [name for name in record(tmp_path / "case", smooth(0.0)).library if name.startswith("delay_of")]


@pytest.mark.parametrize("between", ["linear", "held"])
def test_the_derivative_by_a_delay_is_that_of_the_prediction(tmp_path: Path, between: str) -> None:
    case = record(tmp_path / "case", smooth(0.1), recorded=smooth(0.0))
    case = case.changed(case.text.replace('base = "ode"', f'base = "ode"\ninputs = "{between}"'))
    bound = Model.of(case, ["input_delay"]).bind(case.inputs)
    theta = np.array([0.5, 8.0, 0.08])
    slopes = bound.jacobian(theta)[1][..., 2]
    step = np.array([0.0, 0.0, 1e-3])
    differences = (bound.predict(theta + step) - bound.predict(theta - step)) / 2e-3
    np.testing.assert_allclose(slopes, differences, atol=0.02 * np.abs(differences).max())
    proposed = {name: values[:3] for name, values in case.inputs.items()}
    steady = Model.of(case, ["input_delay"]).bind(proposed)
    np.testing.assert_array_equal(steady.predict(theta), steady.predict(theta * [1.0, 1.0, 0.0]))


def test_no_stretch_goes_over_a_jump(tmp_path: Path) -> None:
    """When an input jumped between two rows nobody knows: no term is told for what that misses. Where the case says
    that inputs are held, it is known."""
    case = record(tmp_path / "case", jumping())
    assert not analyse(case).missing
    unknown = _stretches(case)
    order = np.argsort(case.run, kind="stable")
    force, run = case.inputs["force"][order], case.run[order]
    after = np.flatnonzero((np.abs(np.diff(force)) > 1.0) & (np.diff(run) == 0)) + 1
    jumps = {*order[after].tolist()}
    assert len(jumps) > 20
    last = np.flatnonzero(np.diff(run, append=-1))  # of a run's last rows no start could be fitted
    assert {*order[[at for at in after if not np.isin(range(at, at + 3), last).any()]]} <= {*unknown.layout.first}
    known = _stretches(case.changed(case.text.replace('base = "ode"', 'base = "ode"\ninputs = "held"')))
    assert len(jumps & {*known.layout.first}) < 5


def _stretches(case: Case) -> Stretches:
    found = Model.of(case).bind(case.inputs).predict.__self__  # type: ignore[attr-defined]  # whose method it is
    assert isinstance(found, Stretches)
    return found
