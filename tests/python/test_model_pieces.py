"""Pieces of a fit on models of one line: shapes and directions of what could be missing, starts of a larger model,
whole numbers, and the covariance of a mean."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.units import units
from terrapin_tools.workbench.bases.kinds.base import Fitted
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.model import (
    data_columns,
    effect_columns,
    fitting,
    grouped,
    linearised,
    table_faults,
    usual_sizes,
)
from terrapin_tools.workbench.model.constants import error_tax, value_of
from terrapin_tools.workbench.model.data_columns import candidates, catalogue_directions, column_shapes, is_phase
from terrapin_tools.workbench.model.effect_columns import loudness, shapes_of, varying_parameters
from terrapin_tools.workbench.model.fitting import covariance, extend, fit_model
from terrapin_tools.workbench.model.linearised import following, linearise
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.kinds import Node
from tests.python.casekit import rolling

TURN = 2.0 * np.pi
WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("low", "high", "reverses", "columns"),
    [(-2.0, 0.5, False, 5), (0.5, 2.0, False, 3), (-2.0, -0.5, False, 3), (0.0, 2.0, False, 3), (0.5, 2.0, True, 6)],
)
def test_a_column_of_both_signs_may_act_by_its_sign(low: float, high: float, reverses: bool, columns: int) -> None:
    """And all stand times the direction of motion, too, where that reverses."""
    x = np.linspace(low, high, 41)
    omega = np.where(np.arange(41) % 3 == 0, -1.0, 1.0) if reverses else np.ones(41)
    case: Any = SimpleNamespace(roles={"omega": omega}, extra={"q": x, "still": np.full(41, 7.0)})
    found = column_shapes(case, np.ones(41, dtype=bool))
    assert sorted(found) == sorted({"", "q", *(["omega"] if reverses else [])})
    assert len(found["q"].together) == columns
    assert len(found["q"].singly) == (4 if reverses else 2)
    assert len(found[""].singly) == (2 if reverses else 1)
    for one in [*found["q"].together, *found["q"].singly, *found[""].singly]:
        assert np.sqrt(np.mean(one**2)) == pytest.approx(1.0)
    if low < 0.0 < high:
        np.testing.assert_allclose(found["q"].together[-2:], [np.sign(x) / np.sqrt(np.mean(np.sign(x) ** 2)),
            np.abs(x) / np.sqrt(np.mean(x**2))])  # fmt: skip


def test_a_direction_is_the_change_by_a_small_amount_of_the_effect(tmp_path: Path) -> None:
    """Of unit length and of its sign."""
    case = load_case(rolling(tmp_path, 1, runs=6, rows=12))
    model, rows, theta = Model.of(case), np.ones(case.rows, dtype=bool), np.array([0.09])
    plain = model.bind(case.inputs, rows).predict(theta)
    found = catalogue_directions(model, theta, rows)
    assert len({one.effect for one in found}) > 7
    effects = {effect.name: effect for effect in candidates(model)}
    for one in found:
        effect = effects[one.effect]
        assert np.sqrt((one.change**2).sum()) == pytest.approx(1.0)
        bound, best = model.having(effect).bind(case.inputs, rows), 0.0
        shapes = [(p.start,) if not p.grid else p.grid for p in effect.parameters[1:]]
        shapes = [(-0.5 * np.pi, 0.0) if is_phase(p) else s for p, s in zip(effect.parameters[1:], shapes, strict=True)]
        size = 1e-4 * min(1.0, effect.parameters[0].maximum)
        for values in np.array(np.meshgrid(*shapes)).reshape(len(shapes), -1).T if shapes else [()]:
            change = bound.predict(np.array([*theta, size, *values])) - plain
            best = max(best, float((change * one.change).sum() / max(np.sqrt((change**2).sum()), 1e-300)))
        assert best > 0.999, one.effect


def _wave(phase_first: bool) -> Effect:
    phase = Parameter("p", "rad", 0.0, -TURN, TURN)
    order = Parameter("n", "1", 1.0, 1.0, 9.0, whole=True, grid=(1.0, 2.0, 3.0))
    shape = (phase, order) if phase_first else (order, phase)
    size = Parameter("a", "N", 0.0)
    return Effect("wave", "", "", "", ("equation",), (size, *shape), (), "a*sin(n*x + p)", "y")


X = np.linspace(0.0, TURN, 60, endpoint=False)


def _waves(effect: Effect, sets: Array) -> Array:
    """(sets, 1, rows) of the wave, for its parameters (sets, 3)."""
    place = {p.name: i for i, p in enumerate(effect.parameters)}
    size, order, phase = (sets[:, place[name], None] for name in ("a", "n", "p"))
    return np.asarray(size * np.sin(order * X + phase))[:, None, :]


@pytest.mark.parametrize("phase_first", [True, False])
def test_a_wave_is_a_sine_and_a_cosine_at_each_of_its_orders(
    monkeypatch: pytest.MonkeyPatch, phase_first: bool
) -> None:
    effect = _wave(phase_first)
    monkeypatch.setattr(effect_columns, "beside", lambda model, theta, asked, rows: [_waves(effect, asked[0][1])])
    model: Any = None
    found = shapes_of(model, np.zeros(0), effect, np.ones(60, dtype=bool), np.array([2.0]))
    assert len(found) == 3
    for order, shape in enumerate(found, start=1):
        assert (shape.lower, shape.upper) == (-np.inf, np.inf)
        assert not shape.one_sided
        assert shape.scale == pytest.approx(2.0 / np.sqrt(0.5), rel=1e-6)  # of a size in sds of 2
        expected = np.stack([np.sin(order * X), np.cos(order * X)], axis=1) / np.sqrt(0.5)
        np.testing.assert_allclose(shape.columns, expected, atol=1e-6)


def test_directions_of_a_wave_are_a_quarter_of_a_turn_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    effect = _wave(False)
    monkeypatch.setattr(data_columns, "candidates", lambda _: [effect])
    monkeypatch.setattr(data_columns, "beside", lambda model, theta, asked, rows: [_waves(effect, asked[0][1])])
    model: Any = None
    found = np.array([one.change[0] for one in catalogue_directions(model, np.zeros(0), np.ones(60, dtype=bool))])
    np.testing.assert_allclose(found @ found.T, np.eye(6), atol=1e-9)


@pytest.mark.parametrize(
    ("low", "high", "start", "lower", "upper", "one_sided"),
    [(0.0, np.inf, 0.0, 0.0, np.inf, True), (-np.inf, 0.0, 0.0, -np.inf, 0.0, True), (-3.0, 5.0, 0.0, -3.0, 5.0, False),
     (2.0, 5.0, 3.0, -1.0, 2.0, False), (0.5, 2.0, 2.0, -1.5, 0.0, True)],
)  # fmt: skip
def test_a_shape_knows_how_far_its_size_may_go(
    monkeypatch: pytest.MonkeyPatch, low: float, high: float, start: float, lower: float, upper: float, one_sided: bool
) -> None:
    """From none, or from where it starts when it cannot be absent; in noise sds of the loudest channel."""
    effect = Effect("push", "", "", "", ("equation",), (Parameter("a", "N", start, low, high),), (), "a*x", "y")
    change = np.stack([3.0 * np.cos(X), np.sin(X)])

    def predicted(sets: Array) -> Array:
        assert (low <= sets[:, -1]).all()
        assert (sets[:, -1] <= high).all()
        return sets[:, -1, None, None] * change

    monkeypatch.setattr(effect_columns, "beside", lambda model, theta, asked, rows: [predicted(o) for _, o in asked])
    bound = SimpleNamespace(near=predicted)
    model: Any = SimpleNamespace(case=SimpleNamespace(inputs={}))
    model.having = lambda effect: SimpleNamespace(bind=lambda inputs, rows: bound)
    (shape,) = shapes_of(model, np.zeros(1), effect, np.ones(60, dtype=bool), np.array([1.0, 0.1]))
    loud = np.sqrt(0.5) / 0.1  # the second channel, whose noise is small
    assert shape.scale == pytest.approx(1.0 / loud)
    assert (shape.lower, shape.upper) == (pytest.approx(lower * loud), pytest.approx(upper * loud))
    assert shape.one_sided == one_sided
    np.testing.assert_allclose(
        shape.columns[:, 0], np.concatenate([3.0 * np.cos(X), np.sin(X) / 0.1]) / loud, atol=1e-6
    )


def test_loudness_is_that_of_the_loudest_channel() -> None:
    assert loudness(np.array([[3.0, -4.0], [1.0, 1.0]])) == pytest.approx(np.sqrt(12.5))


def test_a_parameter_may_go_with_a_column_up_or_down() -> None:
    x = np.array([1.0, 2.0, 6.0, 9.0])
    case: Any = SimpleNamespace(roles={"x": np.append(x, 50.0)}, extra={"still": np.ones(5)})
    slopes = np.stack([np.array([[1.0, 2.0, 3.0, 4.0]]), np.zeros((1, 4))], axis=-1)
    (column,) = varying_parameters(case, slopes, np.array([True, True, True, True, False]))
    expected = slopes[0, :, 0] * (x - 4.5)
    np.testing.assert_allclose(column[:, 0], expected / np.sqrt(np.mean(expected**2)))


def _fitted(effect: Effect | None, parameter: Parameter) -> Any:
    p = parameter
    return SimpleNamespace(
        key=p.name, name=p.name, effect=effect and effect.name, unit=p.unit, start=p.start, lower=p.minimum,
        upper=p.maximum, whole=p.whole, grid=p.grid,
    )  # fmt: skip


def _bound(predict: Any, effect: Effect | None, own: Parameter) -> Any:
    fitted = [_fitted(None, own), *(_fitted(effect, p) for p in (effect.parameters if effect else ()))]
    base = SimpleNamespace(whole_runs=False, own_dynamics=None)
    model = SimpleNamespace(
        fitted=fitted, case=SimpleNamespace(base=base), start=np.array([f.start for f in fitted]),
        lower=np.array([f.lower for f in fitted]), upper=np.array([f.upper for f in fitted]),
    )  # fmt: skip

    def jacobian(theta: Array) -> tuple[Array, Array]:
        steps = 1e-6 * np.eye(len(theta))
        slopes = [(predict((theta + s)[None])[0] - predict((theta - s)[None])[0]) / 2e-6 for s in steps]
        return predict(theta[None])[0], np.stack(slopes, axis=-1)

    return SimpleNamespace(model=model, near=predict, predict=lambda theta: predict(theta[None])[0], jacobian=jacobian)


@pytest.mark.parametrize("phase_first", [True, False])
@pytest.mark.parametrize(("size", "order", "phase"), [(2.0, 3.0, 0.4), (-0.7, 2.0, 1.5), (1.2, 1.0, -2.0)])
def test_a_wave_is_found_from_its_grid(size: float, order: float, phase: float, phase_first: bool) -> None:
    """Beside a slope that takes a part of it."""
    effect = _wave(phase_first)
    slope = Parameter("k", "N", 1.0)
    measured = 0.5 * X + size * np.sin(order * X + phase)
    parent = fit_model(_bound(lambda sets: (sets[:, :1] * X)[:, None], None, slope), measured[None], np.array([0.1]),
        [np.array([1.0])])  # fmt: skip

    def predict(sets: Array) -> Array:
        return (sets[:, :1] * X)[:, None] + _waves(effect, sets[:, 1:])

    fit = extend(parent, "wave", _bound(predict, effect, slope), measured[None], np.array([0.1]))
    found = dict(zip([p.name for p in effect.parameters], fit.theta[1:], strict=True))
    assert fit.cost < 1e-6 * parent.cost
    assert fit.theta[0] == pytest.approx(0.5, abs=1e-4)
    assert found["n"] == order
    assert -np.pi < found["p"] <= np.pi
    assert found["a"] * np.exp(1j * found["p"]) == pytest.approx(size * np.exp(1j * phase), abs=1e-3)
    np.testing.assert_allclose(fit.residual, 0.0, atol=0.01)
    assert fit.at_bound == ()


@pytest.mark.parametrize("whole_runs", [False, True])
@pytest.mark.parametrize("order", [3.0, 4.0, 5.0])
def test_the_order_beside_a_start_is_tried_with_all_else_free(order: float, whole_runs: bool) -> None:
    effect, slope = _wave(False), Parameter("k", "N", 1.0)
    measured = 0.5 * X + 1.2 * np.sin(order * X + 0.7)

    def predict(sets: Array) -> Array:
        return (sets[:, :1] * X)[:, None] + _waves(effect, sets[:, 1:])

    bound = _bound(predict, effect, slope)
    bound.model.case.base.whole_runs = whole_runs
    fit = fit_model(bound, measured[None], np.full(1, 0.01), [np.array([1.0, 0.5, 4.0, 0.3])])
    assert fit.theta == pytest.approx([0.5, 1.2, order, 0.7], abs=1e-3)
    assert fit.cost < (0.01 if whole_runs else 1e-6)  # of a body over time a hundredth of a square is none


def test_the_grid_s_best_comes_first_with_the_size_that_fits() -> None:
    """Four starts at most, each with the size that a linear fit beside the parent gives, within its bounds."""
    order = Parameter("n", "1", 1.0, 1.0, 9.0, grid=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    effect = Effect("bump", "", "", "", ("equation",), (Parameter("a", "N", 0.0, 0.0, 3.0), order), (), "a*x**n", "y")
    offset = Parameter("k", "N", 1.0)
    measured = 1.0 + 2.0 * np.cos(3.0 * X) + 7.0 * np.cos(5.0 * X) - 4.0 * np.cos(6.0 * X)
    parent = fit_model(_bound(lambda sets: np.repeat(sets[:, :1], 60, axis=1)[:, None], None, offset), measured[None],
        np.ones(1), [np.array([0.0])])  # fmt: skip
    assert parent.theta[0] == pytest.approx(1.0)

    def predict(sets: Array) -> Array:
        return np.asarray(sets[:, :1] + sets[:, 1:2] * np.cos(sets[:, 2:] * X))[:, None]

    bound = _bound(predict, effect, offset)
    starts = fitting._screened(parent, bound, np.array([parent.theta[0], 0.0, 1.0]), measured[None], np.ones(1))
    assert len(starts) == 4
    assert starts[0] == pytest.approx([1.0, 3.0, 5.0])  # 7, but for its bound
    assert starts[1] == pytest.approx([1.0, 2.0, 3.0])
    assert [start[1] for start in starts[2:]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert starts[0][0] == parent.theta[0]


def test_phases_are_told_within_half_a_turn_either_side() -> None:
    phase, angle = Parameter("p", "rad", 0.0, -TURN, TURN), Parameter("a", "rad", 0.0, -9.0, 9.0)
    fitted = [_fitted(None, phase), _fitted(None, angle)]
    model: Any = SimpleNamespace(fitted=fitted)
    for given, told in ((3.5, 3.5 - TURN), (-3.5, TURN - 3.5), (1.0, 1.0), (-np.pi, np.pi), (np.pi, np.pi)):
        assert fitting._wrapped(model, np.array([given, 5.0])) == pytest.approx([told, 5.0])


def test_turns_by_a_half_are_looked_at_once() -> None:
    """Their sign is turned round, also where both the phase and another value differ."""
    grid = [(0.0, n, p) for n in (1.0, 2.0) for p in (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi, -0.5 * np.pi)]
    apart, which, sign = fitting._half_turns(grid, [False, False, True])
    assert apart.tolist() == [0, 1, 5, 6]
    assert which.tolist() == [0, 1, 0, 1, 1, 2, 3, 2, 3, 3]
    assert sign.tolist() == [1.0, 1.0, -1.0, -1.0, -1.0] * 2


@pytest.mark.parametrize(("start", "found"), [(3.0, 4.0), (6.0, 5.0), (8.0, 6.0)])
def test_a_whole_number_goes_to_the_better_one_beside_it(start: float, found: float) -> None:
    whole = Parameter("n", "1", start, 1.0, 7.0, whole=True)
    fit = fit_model(_bound(lambda sets: np.repeat(sets[:, :1], 4, axis=1)[:, None], None, whole), np.full((1, 4), 4.9),
        np.ones(1), [np.array([start])])  # fmt: skip
    assert fit.theta[0] == found
    assert fit.at_bound == ()  # a count has no room beyond


def test_the_covariance_of_a_mean() -> None:
    """The plain one is that of independent rows of the sds given; the robust one that of the means of the runs."""
    random = np.random.default_rng(4)
    run = np.repeat([2, 0, 1, 3], 5)
    residual = random.standard_normal((1, 20)) + random.standard_normal(4)[run]
    fit: Any = SimpleNamespace(jacobian=np.full((1, 20, 1), 0.5), residual=residual, theta=np.zeros(1))
    plain, robust = covariance(fit, run, WHITE)
    means = np.array([residual[0, run == one].mean() for one in range(4)]) / 0.5
    assert plain[0, 0] == pytest.approx(1.0 / (20 * 0.25))
    assert robust[0, 0] == pytest.approx((means**2).sum() / (4 * 3))
    larger, same = covariance(fit, run, WHITE, np.array([3.0]))
    assert larger[0, 0] == pytest.approx(9.0 * plain[0, 0])
    assert same[0, 0] == pytest.approx(robust[0, 0])
    alone = covariance(fit, np.zeros(20, dtype=int), WHITE)[1]  # one run says as much as its mean
    assert alone[0, 0] == pytest.approx(residual.mean() ** 2 / 0.25)


def test_the_covariance_of_two_parameters_of_two_channels() -> None:
    random = np.random.default_rng(5)
    run = np.repeat(np.arange(6), 4)
    jacobian, residual = random.standard_normal((2, 24, 2)) * [1.0, 1e3], random.standard_normal((2, 24))
    fit: Any = SimpleNamespace(jacobian=jacobian, residual=residual, theta=np.zeros(2))
    sd = np.array([1.0, 2.0])
    flat = jacobian.reshape(48, 2)
    inverse = np.linalg.inv(flat.T @ flat)
    noisy = flat * np.repeat(sd, 24)[:, None]
    plain, robust = covariance(fit, run, WHITE, sd)
    np.testing.assert_allclose(plain, inverse @ noisy.T @ noisy @ inverse, rtol=1e-6)
    score = np.array([np.einsum("cr,crp->p", residual[:, run == g], jacobian[:, run == g]) for g in range(6)])
    np.testing.assert_allclose(robust, 1.2 * inverse @ score.T @ score @ inverse, rtol=1e-6)


def test_a_column_reverses_when_it_moves_either_way() -> None:
    """Not one that stands still at times, or that noise turns round once in a hundred rows: those may lack a sign."""
    still, once = np.repeat([0.0, 3.0], 50), np.append(-0.1, np.ones(99))
    for values, reverses in ((still, False), (-still, False), (once, False), (-once, False), (still - 1.0, True)):
        assert table_faults._reverses(values) == reverses


PUSH = Effect("push", "", "", "", ("equation",), (Parameter("b", "N", 0.0, 0.0, 9.0),), (), "b", "y")
PULL = Effect("pull", "", "", "", ("equation",), (Parameter("c", "N", 0.0, -9.0, 0.0),), (), "c", "y")
FAULT: Any = SimpleNamespace(name="table.x.scale", parameters=())


def _around(sizes: dict[str, float], slopes: Array, at_bound: tuple[str, ...] = (), whole_runs: bool = False) -> Any:
    """A fit with the own parameters k and m, a wave, a push and a pull, at these values."""
    wave = _wave(False)
    own = [_fitted(None, Parameter(name, "N", 1.0)) for name in ("k", "m")]
    fitted = [*own, *(_fitted(e, p) for e in (wave, PUSH, PULL) for p in e.parameters)]
    theta = np.array([sizes.get(f.key, 1.0) for f in fitted])
    rows = slopes.shape[1]
    case = SimpleNamespace(
        base=SimpleNamespace(whole_runs=whole_runs), train=np.ones(rows, dtype=bool), inputs={}, parameters={"r": 2.0}
    )
    model = SimpleNamespace(fitted=fitted, effects=(wave, PUSH, FAULT, PULL), case=case)
    model.bind = lambda inputs, mask: SimpleNamespace(jacobian=lambda theta: (np.full((2, mask.sum()), 7.0), slopes))
    model.lower, model.upper = np.full(len(fitted), -9.0), np.append(3.0, np.full(len(fitted) - 1, 9.0))
    return SimpleNamespace(model=model, theta=theta, at_bound=at_bound)


def test_a_fit_is_a_linear_model_around_itself() -> None:
    """In noise sds: a wave is two columns, a size that can only push has that sign, and one that wants to leave its
    bounds is left out at a price; a fault of the table has no column."""
    random = np.random.default_rng(6)
    slopes, sigma = random.standard_normal((2, 30, 7)), np.array([1.0, 0.5])
    rows, measured = np.ones(30, dtype=bool), random.standard_normal((2, 30))
    names = ("wave", "push", "table.x.scale", "pull")
    scaled = slopes / sigma[:, None, None]

    def found(sizes: dict[str, float], at_bound: tuple[str, ...] = ()) -> Any:
        return linearise(_around(sizes, slopes, at_bound), names, measured, rows, sigma)

    one = found({"a": -2.0, "b": 3.0, "c": -4.0})
    loud = [loudness(scaled[..., i : i + 1]) for i in (2, 5, 6)]
    np.testing.assert_allclose(one.residual, (measured - 7.0) / sigma[:, None])
    np.testing.assert_allclose(one.base, scaled[..., :2])
    expected = [
        scaled[..., 2] / loud[0],
        scaled[..., 4] / -2.0 / loud[0],
        scaled[..., 5] / loud[1],
        scaled[..., 6] / loud[2],
    ]
    np.testing.assert_allclose(one.columns, np.array(expected).reshape(4, -1).T)
    np.testing.assert_allclose(one.offset, [-2.0 * loud[0], 0.0, 3.0 * loud[1], -4.0 * loud[2]])
    assert one.signs.tolist() == [0.0, 0.0, 1.0, -1.0]
    assert one.lost == 0.0
    assert one.bounds.tolist() == [0.0, 0.0]
    bounded = found({"a": 1.0, "b": 9.0, "c": 0.0, "k": 3.0, "m": -9.0}, ("b", "c", "k", "m"))
    assert bounded.bounds.tolist() == [-1.0, 1.0]
    assert bounded.columns.shape[1] == 3
    assert bounded.lost == 3.0  # not for the one that is absent
    assert bounded.base.shape[-1] == 2  # what is missing may have driven the model's own there
    with pytest.raises(ValueError, match="no phase"):
        found({"a": 0.0})
    with pytest.raises(ValueError, match="noise sd on rows"):
        found({"b": 1.01e5 / loud[1]})
    assert found({"b": 0.99e5 / loud[1]}).lost == 0.0
    slopes[..., 5] = 0.0
    with pytest.raises(ValueError, match="push has no influence"):
        found({})


@pytest.mark.parametrize("whole_runs", [True, False])
def test_of_a_motion_no_parameter_at_its_bound_follows(whole_runs: bool) -> None:
    fit = _around({}, np.ones((1, 4, 7)), ("k", "b"), whole_runs)
    assert following(fit).tolist() == [not whole_runs, True, True, True, True, False, True]


def test_on_rows_that_were_not_fitted_a_motion_is_integrated_there_alone() -> None:
    """What the fit left on its own rows is known, in the same sds; with others all is asked anew."""
    slopes = np.arange(70.0).reshape(1, 10, 7)
    fit = _around({}, slopes, (), whole_runs=True)
    case = fit.model.case
    case.train = np.arange(10) % 3 > 0
    held = ~case.train
    asked = []

    def bind(inputs: object, mask: Array) -> Any:
        asked.append(mask.tolist())
        return SimpleNamespace(jacobian=lambda theta: (np.full((1, mask.sum()), 7.0), slopes[:, mask]))

    fit.model.bind = bind
    fit.sigma = np.array([2.0])
    fit.residual, fit.jacobian = np.full((1, 6), 0.25), slopes[:, case.train] / 2.0
    measured, every = np.full((1, 10), 8.0), np.ones(10, dtype=bool)
    residual, columns = linearised._around(fit, measured, every, np.array([2.0]))
    np.testing.assert_allclose(residual, np.where(held, 0.5, 0.25)[None])
    np.testing.assert_allclose(columns, slopes / 2.0)
    assert linearised._around(fit, measured[:, case.train], case.train, np.array([2.0]))[0] is fit.residual
    residual, columns = linearised._around(fit, measured, every, np.array([4.0]))
    np.testing.assert_allclose(residual, 0.25)
    np.testing.assert_allclose(columns, slopes / 4.0)
    assert asked == [held.tolist(), every.tolist()]


def test_an_error_of_a_constant_costs_the_same_either_way() -> None:
    """Half and twice the radius are as unlikely; three tenths of its logarithm are usual; no error is free."""
    fitted = [SimpleNamespace(effect=name) for name in (None, "constant.r", "drag", "constant.s")]

    def tax(r: float, s: float, names: tuple[str, ...] = ("constant.r", "constant.s", "drag")) -> float:
        fit: Any = SimpleNamespace(model=SimpleNamespace(fitted=fitted), theta=np.array([5.0, r, 5.0, s]))
        return error_tax(fit, names)

    assert tax(0.0, 0.0) == 0.0
    assert tax(1.0, 0.0) == pytest.approx(tax(-0.5, 0.0))
    assert tax(np.expm1(0.3), 0.0) == pytest.approx(np.log(2.0))
    assert tax(0.2, 0.1) == pytest.approx(tax(0.2, 0.0) + tax(0.0, 0.1))
    assert tax(0.2, 0.1, ("constant.s",)) == tax(0.0, 0.1)
    model = SimpleNamespace(fitted=fitted, case=SimpleNamespace(parameters={"r": 2.0}))
    fit: Any = SimpleNamespace(model=model, theta=np.array([5.0, 0.25, 5.0, 0.0]))
    assert value_of(fit, "constant.r") == 2.5


def test_a_size_far_above_the_usual_costs_up_to_a_tenth(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = [SimpleNamespace(effect=name) for name in (None, "drag", "drag", "own")]
    effects = [SimpleNamespace(name="drag"), SimpleNamespace(name="own")]
    model = SimpleNamespace(fitted=fitted, effects=effects, case=None)
    monkeypatch.setattr(usual_sizes, "usual_size", lambda effect, case: 2.0 if effect.name == "drag" else None)
    for size, tax in ((0.0, 0.0), (2.0, np.log(2.0)), (-2.0, np.log(2.0)), (5.0, np.log(7.25)), (6.1, np.log(10.0)),
        (80.0, np.log(10.0))):  # fmt: skip
        fit: Any = SimpleNamespace(model=model, theta=np.array([9.0, size, 1e3, 1e3]))
        assert usual_sizes.size_tax(fit, {"drag", "own"}) == pytest.approx(tax)
        assert usual_sizes.size_tax(fit, {"own"}) == 0.0


def test_shapes_that_are_nearly_one_are_given_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where another channel hardly shows them."""
    width = Parameter("w", "1", 1.0, 0.0, 9.0, grid=(1.0, 1.01, 2.0))
    effect = Effect("bump", "", "", "", ("equation",), (Parameter("a", "N", 0.0), width), (), "a*exp(x/w)", "y")

    def predicted(sets: Array) -> Array:
        shape = sets[:, :1] * np.exp(-X / sets[:, 1:])
        return np.stack([shape, 0.1 * shape], axis=1)

    monkeypatch.setattr(effect_columns, "beside", lambda model, theta, asked, rows: [predicted(asked[0][1])])
    model: Any = None
    found = shapes_of(model, np.zeros(0), effect, np.ones(60, dtype=bool), np.ones(2))
    assert [shape.values for shape in found] == [(1.0,), (2.0,)]


def test_a_factor_of_a_mistaken_unit_is_what_that_unit_is() -> None:
    factors = {about: factor for about, (factor, _) in {**table_faults.FACTORS, **table_faults.OF_UNIT}.items()}
    quantity = units().Quantity
    assert factors.pop("a mistaken direction") == -1.0
    for about, unit, to in (
        ("turns a minute", "rpm", "rad/s"), ("degrees", "deg", "rad"), ("kilograms of force", "kgf", "N"),
        ("thousandths", "mm", "m"), ("turns", "turn", "rad"), ("minutes", "min", "s"), ("km/h", "km/h", "m/s"),
        ("hundredths", "cm", "m"), ("tenths", "dm", "m"),
        ("metric horsepower", "metric_horsepower", "W"), ("horsepower", "horsepower", "W"),
    ):  # fmt: skip
        assert factors.pop(about) == pytest.approx(float(quantity(1.0, unit).to(to).magnitude))
    assert not factors


def test_a_value_of_a_group_is_the_parameter_in_its_part() -> None:
    own = Fitted("drag.c", "c", "drag", "N", 1.0, 0.0, 9.0)
    grouped_ = replace(own, key="f[sand]", name="f", effect=None, by="soil", group="sand")
    assert grouped._plain(own) is own
    assert grouped._plain(grouped_) == replace(grouped_, key="f", by="", group="")


@pytest.mark.parametrize("grid", [(1.0, 2.0), (1.0, 2.0, 3.0)])
def test_what_has_shapes_and_cannot_be_absent_is_for_a_refit(grid: tuple[float, ...]) -> None:
    """As what has no parameter at all: there is no line of its size to look along."""
    size, shape = Parameter("a", "N", 1.0, 0.5, 2.0), Parameter("w", "1", 1.0, 0.0, 9.0, grid=grid)
    base = SimpleNamespace(whole_runs=False, own_dynamics=None)
    model: Any = SimpleNamespace(case=SimpleNamespace(base=base, inputs={}))
    for parameters in ((size, shape), ()):
        effect = Effect("own", "", "", "", ("equation",), parameters, (), "a*exp(x/w)", "y")
        assert shapes_of(model, np.zeros(0), effect, np.ones(60, dtype=bool), np.ones(1)) == []
