"""Differential equations of the user's own: solution and derivatives, cases with them, and what is wrong there."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.equations import ode as equations
from terrapin_hil.physics.equations.ode import Ode, OdeDrive, OdeError, OdeRun
from terrapin_hil.physics.expression import parse
from terrapin_hil.physics.program import instructions
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import analyse, error, fitted_on
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.discover.ranker import Ranker
from terrapin_tools.workbench.formulas import expressions
from terrapin_tools.workbench.model.fitting import covariance, minimise
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.model.table_faults import Fault
from terrapin_tools.workbench.noise.kinds import NODES
from tests.campaigns.ode_systems import SYSTEMS, draw, right
from tests.python.casekit import one_line, terrapin

# f = (x + y)*... of every operation; corners (abs, min) are away from the points
FORMULAS = (
    "x*y - x/y + 3",
    "-x**3 + y**x + x**0.5",
    "abs(x - 5)*sign(y) + min(x, y)*max(x, 2*y)",
    "sqrt(x)*exp(-y) + log(x*y)",
    "sin(x)*cos(y) + tan(x/3) + tanh(y - 1)",
    "(x > y)*x + (x <= y)*y",
)
SLOTS = {"time": 0, "x": 1, "v": 2, "force": 3, "k": 4, "d": 5}
OSCILLATOR = ("v", "force - d*v - k*x")


@pytest.mark.parametrize("text", FORMULAS)
def test_gradient_is_that_of_the_formula(text: str) -> None:
    code = instructions(text, {"x": 0, "y": 1}, {})
    native = ffi().new("hil_instruction[]", code)
    for point in ((1.3, 0.7), (0.4, 2.2)):
        at, gradient = np.array(point), np.zeros(2)
        value = library().hil_program_gradient(native, len(code), 0.1, pointer(at), pointer(gradient))
        assert value == library().hil_program_run(native, len(code), 0.1, pointer(at))
        for i in range(2):
            step = np.zeros(2)
            step[i] = 1e-6
            ends = [library().hil_program_run(native, len(code), 0.1, pointer(at + s)) for s in (step, -step)]
            assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-7, abs=1e-8)


def oscillator(held: bool = False, formulas: tuple[str, str] = OSCILLATOR) -> Ode:
    code = [instructions(text, SLOTS, {}) for text in formulas]
    measured = [instructions(text, SLOTS, {}) for text in ("x", "x*v + k")]
    return Ode(code, measured, len(SLOTS), [SLOTS["k"], SLOTS["d"]], np.ones(2), held=held)


def driven(rows: int = 60, force: Callable[[Array], Array] = np.sin) -> OdeDrive:
    time = np.linspace(0.0, 6.0, rows)
    return OdeDrive(time, force(time)[:, None].copy(), (SLOTS["force"],))


def values(k: float, d: float) -> Array:
    table = np.zeros(len(SLOTS))
    table[[SLOTS["k"], SLOTS["d"]]] = k, d
    return table


def test_solution_is_the_closed_one() -> None:
    drive = driven(force=np.zeros_like)
    run = oscillator().run(values(9.0, 0.0), drive, np.array([0.5, 1.2]), False)
    t = drive.time
    np.testing.assert_allclose(run.states[:, 0], 0.5 * np.cos(3 * t) + 0.4 * np.sin(3 * t), atol=2e-6)


def test_derivatives_are_those_of_the_solution() -> None:
    ode, drive, start = oscillator(), driven(), np.array([0.5, 1.2])
    slopes = ode.run(values(9.0, 0.4), drive, start, True).slopes
    assert slopes is not None
    for column in range(4):
        ends = []
        for sign in (1.0, -1.0):
            moved, other = start.copy(), np.array([9.0, 0.4])
            (moved if column < 2 else other)[column % 2] += sign * 1e-4
            ends.append(ode.run(values(*other), drive, moved, False).channels)
        np.testing.assert_allclose(slopes[:, :, column], (ends[0] - ends[1]) / 2e-4, atol=2e-4)


@pytest.mark.parametrize("rate", [3.0, 300.0])
def test_derivatives_of_what_is_faster_than_the_samples(rate: float) -> None:
    """x' = rate (u - x) with u = t, 100 ms a sample: x lags by 1/rate, x(t) = t - (1 - exp(-rate t))/rate."""
    slots = {"time": 0, "x": 1, "rate": 2}
    ode = Ode([instructions("rate*(time - x)", slots, {})], [instructions("x", slots, {})], 3, [2], np.ones(1))
    t = np.linspace(0.0, 3.0, 31)
    slopes = ode.run(np.array([0.0, 0.0, rate]), OdeDrive(t, np.zeros((31, 0)), ()), np.zeros(1), True).slopes
    assert slopes is not None
    decay = np.exp(-rate * t)
    np.testing.assert_allclose(slopes[:, 0, 0], decay, atol=1e-4)
    np.testing.assert_allclose(slopes[:, 0, 1] * rate**2, 1.0 - decay * (1.0 + rate * t), atol=1e-3)


def test_response_is_that_of_an_addition() -> None:
    """An addition to a derivative, linear between rows, is what an input would do."""
    ode, start, size = oscillator(), np.array([0.5, 1.2]), 1e-4
    shape = np.sign(np.sin(3.0 * driven().time))
    table = values(9.0, 0.4)
    plain = ode.run(table, driven(), start, False)
    more = ode.run(table, driven(force=lambda t: np.sin(t) + size * shape), start, False)
    found = ode.linear(table, driven(), plain.states, 1).respond(shape)
    np.testing.assert_allclose(found, (more.channels - plain.channels) / size, atol=1e-3)


@pytest.mark.parametrize("threads", ["1", "2", "3"])
def test_stretches_are_runs_of_their_own(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each from its own start, in one thread or several; one that is not wanted stays as it was."""
    monkeypatch.setattr(equations, "WORTH_A_THREAD", 10)
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    ode, whole = oscillator(), driven()
    cut, starts = [0, 25, 60], np.array([[0.5, 1.2], [-0.3, 0.1]])
    drive = OdeDrive(whole.time, whole.inputs, whole.slots, cut)
    both = ode.run(values(9.0, 0.4), drive, starts, True)
    addition = np.cos(2.0 * whole.time)
    response = ode.linear(values(9.0, 0.4), drive, both.states, 1).respond(addition)
    for i, part in enumerate((slice(0, 25), slice(25, 60))):
        one = OdeDrive(whole.time[part].copy(), whole.inputs[part].copy(), whole.slots)
        alone = ode.run(values(9.0, 0.4), one, starts[i], True)
        assert alone.slopes is not None
        assert both.slopes is not None
        np.testing.assert_array_equal(both.states[part], alone.states)
        np.testing.assert_array_equal(both.slopes[part], alone.slopes)
        linear = ode.linear(values(9.0, 0.4), one, alone.states, 1)
        np.testing.assert_array_equal(response[part], linear.respond(addition[part]))
    before = both.states.copy()
    ends = ode.run_some(values(4.0, 0.4), drive, starts, np.array([False, True]), both)
    assert not ends.failed.any()
    np.testing.assert_array_equal(both.states[:25], before[:25])
    assert (both.states[30:] != before[30:]).all()


def test_a_stretch_that_fails_is_named() -> None:
    """x' = x^2 runs off from 1 within the stretch, and from 0.01 does not."""
    whole = driven()
    drive = OdeDrive(whole.time, whole.inputs, whole.slots, [0, 20, 60])
    with pytest.raises(OdeError) as found:
        oscillator(formulas=("x*x", "0*v")).run(values(1, 1), drive, np.array([[0.01, 0.0], [1.0, 0.0]]), False)
    assert found.value.stretch == 1
    assert found.value.time == pytest.approx(whole.time[20] + 1.0, abs=1e-6)


def test_inputs_hold_or_run() -> None:
    """x' = force: the integral of steps, and of straight lines."""
    time = np.array([0.0, 1.0, 2.0])
    drive = OdeDrive(time, np.array([[0.0], [2.0], [4.0]]), (SLOTS["force"],))
    for held, end in ((True, 2.0), (False, 4.0)):
        ode = oscillator(held, ("force", "0*v"))
        assert ode.run(values(1, 1), drive, np.zeros(2), False).states[-1, 0] == pytest.approx(end)


@pytest.mark.parametrize(("formula", "stiff"), [("x*x", False), ("log(-1 - x*x)", False), ("-1e9*(x - v)", True)])
def test_what_cannot_be_solved_says_where(formula: str, stiff: bool) -> None:
    with pytest.raises(OdeError) as found:
        oscillator(formulas=(formula, "cos(20*time)")).run(values(1, 1), driven(), np.array([1.0, 1.0]), False)
    assert found.value.stiff == stiff
    assert found.value.state == 0
    if formula == "x*x":  # 1 / (1 - t)
        assert found.value.time == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("until", "failed"), [(0.1, False), (9.0, True)])
def test_a_stretch_has_steps_on_average(until: float, failed: bool) -> None:
    """More than 200 in one interval are none too many, in every interval they are."""
    drive, run = driven(), OdeRun(np.zeros((60, 2)), np.zeros((60, 2)), None)
    ode = oscillator(formulas=(f"-25000*(x - force)*(time < {until})", "0*v"))
    ends = ode.run_some(values(1, 1), drive, np.zeros((1, 2)), np.ones(1, dtype=bool), run)
    assert (bool(ends.failed[0]), bool(ends.stiff[0])) == (failed, failed)
    assert ends.steps[0] == 200 * 60 if failed else 400 < ends.steps[0] < 2000


TEXT = """[case]
title = "Mass on a spring"
[model]
base = "ode"
[model.states]
x = { initial = "fit", unit = "m" }
v = { initial = "fit", unit = "m/s" }
[model.derivative]
x = "v"
v = "(force - d*v - k*x)/m"
[model.measured]
position = "x"
[parameters]
m = "1300 g"
[fit]
d = { value = 0.3, min = 0.0, max = 5.0, unit = "N s/m" }
k = { value = 6.0, min = 0.0, max = 50.0, unit = "N/m" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "t", unit = "ms" }
force = { column = "f", unit = "N" }
position = { column = "x", unit = "mm", sigma = 5.0 }
"""
CUBIC, RUNS, ROWS = 5.0, 6, 120


def spring(folder: Path, cubic: float = 0.0, text: str = TEXT, seed: int = 1, more: str = "0") -> Path:
    """m = 1.3, d = 0.5, k = 8, in steps of 40 ms, by the project's own integrator at a twentieth of the step."""
    random = np.random.default_rng(seed)
    slots = {"time": 0, "x": 1, "v": 2, "force": 3}
    code = [instructions(one, slots, {}) for one in ("v", f"(force - 0.5*v - 8*x - {cubic}*x**3 - {more})/1.3")]
    ode = Ode(code, [instructions("x", slots, {})], len(slots), [], np.ones(2))
    clock = 0.04 * np.arange(ROWS)
    lines = ["run,t,f,x,first"]
    for run in range(RUNS):
        force = np.interp(clock, np.linspace(0.0, clock[-1], 9), random.uniform(-6, 6, 9))
        start = random.uniform(-1, 1, 2)
        x = ode.run(np.zeros(4), OdeDrive(clock, force[:, None].copy(), (3,)), start, False).states[:, 0]
        noisy = 1000.0 * x + 5.0 * random.standard_normal(ROWS)
        lines += [
            f"r{run},{1000 * t:.9g},{f:.9g},{y:.9g},{start[0]:.9g}" for t, f, y in zip(clock, force, noisy, strict=True)
        ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


def test_a_channel_in_another_unit_is_told_as_such(tmp_path: Path) -> None:
    """Not as a formula that adds a share of itself to what it shows; its runs start where they then do."""
    text = TEXT.replace('unit = "mm", sigma = 5.0', 'unit = "cm", sigma = 5.0')
    found = discover(load_case(spring(tmp_path / "case", text=text)))
    assert (found.verdict, found.missing) == ("missing", ("table.position.scale",))
    fault = found.candidates[0].effect
    assert isinstance(fault, Fault)
    assert fault.factor == 0.1
    assert found.ladder[-1].heldout_error == pytest.approx(1.0, abs=0.15)


def test_of_a_spring_that_goes_the_other_way_either_column_may_be_meant(tmp_path: Path) -> None:
    """A mistaken direction of what drives it is one of what is measured, where the equations are odd."""
    text = TEXT.replace('unit = "mm", sigma = 5.0', 'unit = "mm", sigma = 5.0, factor = -1.0')
    found = discover(load_case(spring(tmp_path / "case", text=text)))
    assert found.verdict == "ambiguous"
    assert {*found.rivals} == {("table.position.scale",), ("table.force.scale",)}
    factors = {one.effect.name: one.effect.factor for one in found.candidates if isinstance(one.effect, Fault)}
    assert (factors["table.position.scale"], factors["table.force.scale"]) == (-1.0, -1.0)


@pytest.mark.parametrize("start", [6.0, 30.0])
def test_an_input_in_another_unit_is_told_as_such(tmp_path: Path, start: float) -> None:
    """A force in kilograms was 'position is in tenths, and m would be 0.26 kg' at 0.99; of a start value far off (the
    truth is 8) it was a formula of the force."""
    text = TEXT.replace('column = "f", unit = "N"', 'column = "f", unit = "N", factor = 0.101971621')
    text = text.replace("k = { value = 6.0", f"k = {{ value = {start}")
    found = discover(load_case(spring(tmp_path / "case", text=text)))
    assert (found.verdict, found.missing) == ("missing", ("table.force.scale",))
    fault = found.candidates[0].effect
    assert isinstance(fault, Fault)
    assert fault.factor == pytest.approx(9.80665)


KILOGRAMS = TEXT.replace('column = "f", unit = "N"', 'column = "f", unit = "N", factor = 0.101971621')


def said(found: Discovery) -> set[str]:
    """What an answer names: a formula by its text, what has a name by that."""
    listed = found.ranking.expressions
    return {listed[name].expression if name in listed else name for name in found.missing}


def test_a_unit_is_told_beside_a_strong_law(tmp_path: Path) -> None:
    """Along the present fit's motion, a force in kilograms beside a hard spring was k*force at 0.99."""
    found = discover(load_case(spring(tmp_path / "case", 60.0, KILOGRAMS, seed=3)))
    assert found.verdict == "missing"
    assert said(found) == {"table.force.scale", "k_*x**3"}


def test_a_stop_at_one_end_is_told(tmp_path: Path) -> None:
    found = discover(load_case(spring(tmp_path / "case", more="50*max(x - 0.3, 0)")))
    assert found.verdict == "missing"
    assert said(found) == {"k_*max(x - w, 0)"}


def test_the_truth_is_found_and_is_enough(tmp_path: Path) -> None:
    case = load_case(spring(tmp_path / "case"))
    found = analyse(case)
    assert not found.missing
    assert found.ladder[0].heldout_error == pytest.approx(1.0, abs=0.15)
    for truth, value, sd in zip((0.5, 8.0), found.fit.theta, found.sd, strict=True):
        assert abs(value - truth) < 4.0 * sd
        assert sd < 0.1 * truth


def test_the_derivatives_of_a_case_are_those_of_its_prediction(tmp_path: Path) -> None:
    """Beyond what other starts would do: residuals are at the best start, whatever the parameters."""
    case = load_case(spring(tmp_path / "case"))
    bound = Model.of(case).bind(case.inputs, case.train)
    theta = np.array([0.5, 8.0])
    prediction, slopes = bound.jacobian(theta)
    np.testing.assert_allclose(prediction, bound.predict(theta), atol=1e-7)
    measured = case.channels["position"][case.train]
    for column in range(2):
        step = np.zeros(2)
        step[column] = 1e-3
        costs = [float(((measured - bound.predict(theta + s)[0]) ** 2).sum()) for s in (step, -step)]
        gradient = -2.0 * float((measured - prediction[0]) @ slopes[0, :, column])
        assert gradient == pytest.approx((costs[0] - costs[1]) / 2e-3, rel=1e-3)


def test_what_is_far_stiffer_than_at_first_is_no_solution(tmp_path: Path) -> None:
    """But where it is so from the first, it is solved."""
    soft, stiff = np.array([0.5, 8.0]), np.array([5000.0, 8.0])
    for first, solved in ((soft, False), (stiff, True)):
        case = load_case(spring(tmp_path / str(solved)))
        bound = Model.of(case).bind(case.inputs, case.train)
        assert np.isfinite(bound.predict(first)).all()
        assert np.isfinite(bound.predict(stiff)).all() == solved


def test_starts_are_found_again(tmp_path: Path) -> None:
    """Another predictor of the same equations goes on where the first one ended, on rows that it had and others."""
    case = load_case(spring(tmp_path / "case"))
    theta, every = np.array([0.5, 8.0]), np.ones(case.rows, dtype=bool)
    first = Model.of(case).bind(case.inputs, every).predict(theta)
    assert case.dynamics is not None
    ((_, known),) = case.dynamics.starts.items()
    assert sorted(known)[:2] == [0, ROWS // 5]
    np.testing.assert_allclose(
        Model.of(case).bind(case.inputs, case.train).predict(theta), first[:, case.train], atol=1e-7
    )
    kept = {row: start.copy() for row, start in known.items()}
    for start in known.values():
        start += 0.05  # and searches there, as from any other start
    again = Model.of(case).bind(case.inputs, every).predict(theta)
    np.testing.assert_allclose(again, first, atol=1e-6)
    for row, start in case.dynamics.starts.popitem()[1].items():
        np.testing.assert_allclose(start, kept[row], atol=1e-3)


def test_what_cannot_come_near_is_not_followed() -> None:
    """A narrow curved valley: with something else far below the search ends early, with nothing there it goes on."""
    steps = []

    def residual(theta: Array) -> Array:
        return np.array([30.0 * (theta[1] - theta[0] ** 2), 1.0 - theta[0], 30.0])

    def evaluate(theta: Array) -> tuple[Array, Array]:
        steps.append(theta)
        return residual(theta), np.array([[-60.0 * theta[0], 30.0], [-1.0, 0.0], [0.0, 0.0]])

    counts, costs = [], []
    for aim in (np.inf, 100.0):
        steps.clear()
        wide, free = np.full(2, 100.0), np.ones(2, dtype=bool)
        costs.append(minimise(evaluate, residual, np.array([-6.0, 36.0]), -wide, wide, free, aim=aim)[1])
        counts.append(len(steps))
    assert costs[0] == pytest.approx(900.0)
    assert counts[1] < counts[0]
    assert costs[1] < 949.0 + 1e-9


def test_a_way_to_where_there_are_no_numbers_is_not_followed() -> None:
    """A cost that sinks by little to an edge, as that of a motor with less and less inertia."""
    steps = []

    def residual(theta: Array) -> Array:
        return np.array([10.0 + theta[0] ** 0.25, 0.0]) if theta[0] > 0.0 else np.full(2, np.nan)

    def evaluate(theta: Array) -> tuple[Array, Array]:
        steps.append(theta)
        return residual(theta), np.array([[0.25 * theta[0] ** -0.75], [0.0]])

    counts = []
    for edge in (0.0, 0.01):
        steps.clear()
        low, high, free = np.full(1, -1.0), np.ones(1), np.ones(1, dtype=bool)
        cost = minimise(evaluate, residual, np.array([1e-3]), low, high, free, edge=edge)[1]
        assert cost <= (10.0 + 1e-3**0.25) ** 2
        counts.append(len(steps))
    assert counts[1] < counts[0]


def test_a_long_list_is_weighed_as_a_short_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The leading expressions have the evidence that they have in all kinds of noise."""
    found = analyse(load_case(spring(tmp_path / "case", CUBIC)))
    ranker = Ranker(found, lambda _: None)
    base = ranker.base.reshape(ranker.values.size, -1)
    listed = expressions.library(
        found.model, found.fit.theta, ranker.rows, ranker.sigma, ranker.columns_without(()), base
    )
    every = listed.promise(ranker.evidence)
    monkeypatch.setattr(expressions, "WEIGHED", 40)
    assert len(listed.sketches) > 40
    few = listed.promise(ranker.evidence)
    leading = np.argsort(-every)[:10]
    np.testing.assert_allclose(few[leading], every[leading], rtol=1e-12)
    assert (few <= every + 1e-6).all()


def test_a_start_from_a_column_or_a_number_holds(tmp_path: Path) -> None:
    """A wrong known start cannot be mended by a fitted one: the error tells."""
    right_start = TEXT.replace('x = { initial = "fit"', 'x = { initial = "first"')
    for text, good in ((right_start, True), (right_start.replace('"first"', "0.5"), False)):
        case = load_case(spring(tmp_path / str(good), text=text))
        fit = fitted_on(case, (), case.train, np.array([0.005]))[-1]
        found = error(fit, case.train, np.array([0.005]))
        assert found is not None
        assert (found < 1.1) == good


def test_discover_add_compare(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = spring(tmp_path / "case", CUBIC)
    status, out, _ = terrapin(capsys, "discover", folder)
    assert status == 0
    assert "expression_1 = k_*x**3, added to derivative.v" in out.replace("k*x", "k_*x")
    lacks = "the model lacks k_*x**3 in derivative.v and nothing else"
    assert lacks in " ".join(out.split()).replace("k*x", "k_*x")
    assert terrapin(capsys, "add", folder, "expression_1")[0] == 0
    case = load_case(folder)
    assert case.library["expression_1"].target == "derivative.v"
    found = analyse(case)
    assert not found.missing
    size = found.fit.theta[-1]
    sd = np.sqrt(covariance(found.fit, case.run[case.train], NODES[0])[0][-1, -1])
    assert abs(size + CUBIC / 1.3) < 4.0 * sd
    assert found.fit.model.fitted[-1].unit.replace("**", "^") in ("1/m^2/s^2", "1/s^2/m^2")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("d*v", "d*w", r"case\.toml:10: model\.derivative\.v: w is no state, column, parameter or fitted name"),
        ('position = "x"', 'position = "y"', r"model\.measured\.position: y is no state"),
        ('x = "v"\n', "", r"model\.states\.x: has no line in \[model\.derivative\]"),
        ('v = { initial = "fit", unit = "m/s" }\n', "", r"model\.derivative\.v: no state has this name"),
        ('"fit", unit = "m" }', '"nowhere", unit = "m" }', r'found .nowhere., expected a number, "fit" or one of'),
        ('x = { initial = "fit", unit = "m" }', 'x = { unit = "m" }', r"states\.x\.initial: missing"),
        ('time = { column = "t", unit = "ms" }\n', "", r"data\.columns: role time is not mapped, expected it$"),
        ('unit = "N s/m"', 'unit = "N s"', r"case\.toml:10: model\.derivative\.v: .* - between"),
        ('unit = "m/s" }', 'unit = "m" }', r"model\.derivative\.x: v comes out in m, expected m/s"),
        ('"mm", sigma = 5.0', '"mm/s"', r"measured\.position: x comes out in m, expected m/s"),
        ('base = "ode"', 'base = "ode"\ninputs = "cubic"', r"inputs: found 'cubic', expected one of linear, held"),
        ('base = "ode"', 'base = "equation"', r"model\.equation: missing"),
        ("d*v", "d*v)", r"model\.derivative\.v: column"),
        ("m = ", "v = 1\nm = ", r"states\.v: stands in \[parameters\] too"),
    ],
)  # fmt: skip
def test_wrong_equations(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in TEXT
    with pytest.raises(UserError, match=expected) as found:
        load_case(spring(tmp_path / "case", text=TEXT.replace(old, new, 1)))
    assert "\n" not in str(found.value)


def test_a_time_that_stands_still_is_no_time(tmp_path: Path) -> None:
    """It was asked for as a constant, and then nothing could be integrated over it."""
    still = TEXT.replace('time = { column = "t", unit = "ms" }\n', "").replace("[parameters]", "[parameters]\ntime = 1")
    with pytest.raises(UserError, match=r"role time is not mapped, expected it$"):
        load_case(spring(tmp_path / "case", text=still))


@pytest.mark.parametrize(
    ("heading", "said", "remark"),
    [
        ("t [ms]", 'column = "t", unit = "s"', "time: read as s, and the column's heading says ms."),
        ("t [ms]", 'column = "t [ms]"', "time: read without a unit, and the column's heading says ms."),
        ("t in Millisekunden", 'column = "t", unit = "ms"', None),
        ("t [raw]", 'column = "t", unit = "ms"', None),
        ("t [g]", 'column = "t", unit = "ms"', None),
    ],
)
def test_a_heading_of_another_unit_is_said(tmp_path: Path, heading: str, said: str, remark: str | None) -> None:
    """A time in ms that was taken for seconds made a motion a thousand times slower, and nothing said so."""
    folder = spring(tmp_path / "case", text=TEXT.replace('column = "t", unit = "ms"', said))
    table = folder / "runs.csv"
    table.write_text(table.read_text().replace("run,t,", f"run,{heading},", 1))
    assert [text for text in load_case(folder).intake if "heading" in text] == ([remark] if remark else [])


def test_time_must_rise(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = spring(tmp_path / "case")
    lines = (folder / "runs.csv").read_text().splitlines()
    lines[5], lines[6] = lines[6], lines[5]
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    status, _, err = terrapin(capsys, "compare", folder)
    assert status == 2
    one_line(err, ["runs.csv:7: time: found 0.16 s after 0.2 s in run r0"])


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("(force - d*v - k*x)/m + 1e4*v*v*v", "leaves all bounds at time"),
        ("(force - d*v - k*x)/m - 1e9*(v - cos(50*time)/m)", "is too stiff at time"),
    ],
)
def test_what_cannot_be_solved_is_one_line(
    formula: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = re.sub(r', unit = "(m|m/s|N s/m|N/m)"', "", TEXT).replace("(force - d*v - k*x)/m", formula)
    text = text.replace('v = { initial = "fit" }', "v = { initial = 3.0 }")
    status, _, err = terrapin(capsys, "compare", spring(tmp_path / "case", text=text))
    assert status == 2
    one_line(err, ["case.toml: run r0: state v", expected])


def test_effects_act_where_they_say(tmp_path: Path) -> None:
    """The same force as an effect on the derivative and in the equation; an offset on the channel."""
    effects = '[effect.hard]\nexpression = "-c*x**3"\ntarget = "derivative.v"\nc = { value = 3.0 }\n'
    effects += '[effect.off]\nexpression = "o"\ntarget = "position"\no = { value = 0.01, unit = "m" }\n'
    text = TEXT.replace("[parameters]", 'EFFECTS\n[parameters]').replace("EFFECTS", "").replace(
        'base = "ode"', 'base = "ode"\neffects = ["hard", "off"]'
    )  # fmt: skip
    case = load_case(spring(tmp_path / "one", CUBIC, text + effects))
    written = TEXT.replace("(force - d*v - k*x)/m", "(force - d*v - k*x)/m - 3*x**3").replace(
        'position = "x"', 'position = "x + 0.01"'
    )
    written = re.sub(r', unit = "(m|m/s|N s/m|N/m)"', "", written)
    other = load_case(spring(tmp_path / "other", CUBIC, written))
    theta = np.array([0.5, 8.0])
    acted = predicted(case, np.append(theta, [3.0, 0.01]))
    np.testing.assert_allclose(acted, predicted(other, theta), atol=5e-6)  # a thousandth of the noise sd


def predicted(case: Case, theta: Array) -> Array:
    return Model.of(case).bind(case.inputs, case.train).predict(theta)


@pytest.mark.parametrize(("seed", "name"), [(0, ""), (11, ""), (1, "tank, overflow"), (2, "tank, overflow")])
def test_drawn_systems(seed: int, name: str, tmp_path: Path) -> None:
    """Few cases of the campaign: the term is named."""
    drawn = draw(seed, tmp_path / "case", runs=6, rows=250, alone=name)
    assert right(drawn, discover(load_case(drawn.folder)))


def test_every_drawn_system_is_one(tmp_path: Path) -> None:
    """Its case can be read, and its true term is not 0."""
    for seed, system in enumerate(SYSTEMS):
        drawn = draw(seed, tmp_path / str(seed), runs=2, rows=40)
        assert drawn.system is system
        assert load_case(drawn.folder).base.name == "ode"
        assert np.abs(drawn.term).max() > 0.0
        assert parse(system.term[1]).names & {*system.derivative, *system.inputs}


CULTURE = """[case]
title = "Culture"
[model]
base = "ode"
[model.states]
X = { initial = "fit" }
[model.derivative]
X = "mu*X*(1 - X/K)"
[model.measured]
od = "X"
[fit]
mu = { value = 0.3, min = 0.0, max = 2.0 }
K = { value = 5.0, min = 0.1, max = 50.0 }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "t_h", unit = "1" }
od = { column = "od", unit = "1", sigma = 0.05 }
"""


def culture(folder: Path, per_degree: float) -> Path:
    """Logistic growth at another temperature in each run, which the model reads as a column that it does not use."""
    random = np.random.default_rng(4)
    lines = ["run,t_h,od,broth_C"]
    for run, temperature in enumerate(np.linspace(28.0, 36.0, 7)):
        rate, start, t = 0.4 * (1 + per_degree * (temperature - 32.0)), random.uniform(0.2, 0.6), np.linspace(0, 14, 25)
        grown = 6.0 / (1 + (6.0 / start - 1) * np.exp(-rate * t))
        for time, od in zip(t, grown + 0.05 * random.standard_normal(len(t)), strict=True):
            lines.append(f"b{run},{time:.6g},{od:.6g},{temperature:.2f}")
    folder.mkdir(parents=True)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(CULTURE)
    return folder


def test_a_whole_derivative_may_go_with_a_column(tmp_path: Path) -> None:
    found = discover(load_case(culture(tmp_path / "case", 0.05)))
    terms = {c.effect.name: (c.effect.target, c.effect.expression) for c in found.candidates}
    told = [terms[name] for names in (found.missing, *found.rivals) for name in names]
    assert ("gain_of_X", "k*(broth_C - 32)") in told
    assert all(target == "gain_of_X" for target, _ in told)
    assert discover(load_case(culture(tmp_path / "null", 0.0))).verdict == "adequate"


def test_a_gain_is_added_as_it_was_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = culture(tmp_path / "case", 0.05)
    formula = ("mine", "--expression", "q*(broth_C - 32)", "--target", "gain_of_X", "--parameter", "q=0.01:-1:1")
    status, _, err = terrapin(capsys, "add", folder, *formula)
    assert status == 0, err
    fit = analyse(load_case(folder)).fit
    assert fit.theta[[f.key for f in fit.model.fitted].index("mine.q")] == pytest.approx(0.05, abs=0.005)


def test_a_small_gain_does_what_its_refit_does(tmp_path: Path) -> None:
    """Along the motion that was fitted, the response to a gain is the difference that a refit's model shows."""
    case = load_case(culture(tmp_path / "case", 0.05))
    model, theta, rows = Model.of(case), analyse(case).fit.theta, case.train | case.test
    feature = case.extra["broth_C"][rows] - 32.0
    bound = model.bind(case.inputs, rows)
    expected = bound.acting(theta, "gain_of_X")
    assert expected is not None
    term = Effect("e", "", "", "", ("ode",), (Parameter("k", "1", 0.0),), (), "k*(broth_C - 32)", target="gain_of_X")
    larger = model.having(term).bind(case.inputs, rows)
    change = (larger.predict(np.append(theta, 1e-4)) - larger.predict(np.append(theta, -1e-4))) / 2e-4
    np.testing.assert_allclose(expected(feature[None])[0], change, atol=0.02 * np.abs(change).max())  # samples apart


def test_an_addition_to_a_definition_loses_to_one_to_a_law(tmp_path: Path) -> None:
    """A rest angle that is not zero: a constant on th' = w does exactly the same as one on w', and used to be named."""
    random = np.random.default_rng(8)
    lines = ["run,t,deg"]
    for run in range(4):
        t = np.linspace(0.0, 20.0, 120)
        swing = random.uniform(5.0, 15.0) * np.exp(-0.02 * t) * np.cos(0.9 * t + random.uniform(0.0, 6.0))
        for time, angle in zip(t, 2.0 + swing + 0.1 * random.standard_normal(len(t)), strict=True):
            lines.append(f"r{run},{time:.6g},{angle:.6g}")
    folder = tmp_path / "case"
    folder.mkdir()
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(
        '[case]\ntitle = "Torsion"\n[model]\nbase = "ode"\n[model.states]\nth = { initial = "fit" }\n'
        'w = { initial = "fit" }\n[model.derivative]\nth = "w"\nw = "-c*th - b*w"\n[model.measured]\nangle = "th"\n'
        "[fit]\nc = { value = 0.7, min = 0.0, max = 9.0 }\nb = { value = 0.1, min = 0.0, max = 2.0 }\n"
        '[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\ntime = { column = "t", unit = "1" }\n'
        'angle = { column = "deg", unit = "1", sigma = 0.1 }\n'
    )
    found = discover(load_case(folder))
    terms = {c.effect.name: c.effect.target for c in found.candidates}
    assert {terms[name] for names in (found.missing, *found.rivals) for name in names} <= {"derivative.w", "angle"}
    assert found.missing


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_parameter_at_its_bound_is_held_on_either_side(side: float) -> None:
    """y = 3 u - 2 v, |a| <= 1, u and v correlated by 0.9: the data want a beyond its bound, and b alone is to move.

    A step that still moves a takes b the wrong way, and is damped until it hardly moves at all.
    """
    random = np.random.default_rng(5)
    u = random.standard_normal(200)
    v = 0.9 * u + np.sqrt(1.0 - 0.81) * random.standard_normal(200)
    design, y = np.stack([u, v], axis=1), side * (3.0 * u - 2.0 * v)
    looked = []

    def residual(theta: Array) -> Array:
        return np.asarray(design @ theta - y)

    def evaluate(theta: Array) -> tuple[Array, Array]:
        looked.append(theta)
        return residual(theta), design

    box, free = np.array([1.0, 10.0]), np.ones(2, dtype=bool)
    theta, cost = minimise(evaluate, residual, np.array([side, 0.0]), -box, box, free)
    alone = float(v @ (y - side * u) / (v @ v))
    assert theta == pytest.approx([side, alone], rel=1e-6)
    assert cost == pytest.approx(float(np.sum((y - side * u - alone * v) ** 2)), rel=1e-9)
    assert len(looked) <= 4
