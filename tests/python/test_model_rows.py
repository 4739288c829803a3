"""A model on rows: groups with values of their own, faults of the table, effects that are looked at together, stated
constants as suspects, and searches within bounds, against what each is by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import Fitted, Predictor, Problem, Runs
from terrapin_tools.workbench.case.groups import Groups
from terrapin_tools.workbench.model import data_columns, effect_columns, fitting, table_faults
from terrapin_tools.workbench.model.constants import constants, named, suspected
from terrapin_tools.workbench.model.data_columns import beside, candidates, catalogue_directions, column_shapes
from terrapin_tools.workbench.model.effect_columns import acting, response, terms_of
from terrapin_tools.workbench.model.fitting import covariance, minimise
from terrapin_tools.workbench.model.grouped import Grouped
from terrapin_tools.workbench.model.model import Model, _shown
from terrapin_tools.workbench.model.table_faults import faults, read, recorded
from terrapin_tools.workbench.noise.kinds import Node
from terrapin_tools.workbench.noise.odd import gathered

X = np.array([1.0, 2.0, 4.0, 7.0, 11.0, 16.0])


def _fitted(key: str, name: str, group: str = "") -> Fitted:
    return Fitted(key, name, None, "N", 1.0, -9.0, 9.0, by="soil" if group else "", group=group)


class _Line(Predictor):
    """a + b x in one channel, and its negative in another; b alone has the motion of the rows."""

    def sets(self, sets: Array) -> Array:
        names = [one.name for one in self.problem.fitted]
        a, b = (sets[:, names.index(name), None] for name in "ab")
        x = self.problem.inputs["x"]
        line = a + b * (x if self.problem.rows is None else x[self.problem.rows])
        return np.stack([line, -line], axis=1)

    def near(self, sets: Array) -> Array:
        return self.sets(sets) + 100.0  # to be told from the other

    def motion(self, theta: Array) -> Mapping[str, Array]:
        return {"height": self.predict(theta)[0]}

    def _offset(self, theta: Array) -> float:
        return float(theta[[one.name for one in self.problem.fitted].index("a")])

    def acting(self, theta: Array, target: str) -> Any:
        if target == "none":
            return None
        return lambda features: np.stack([self._offset(theta) * features, features], axis=1)

    def trouble(self, theta: Array) -> str:
        return "too high" if self._offset(theta) > 50.0 else ""


def _grouped(rows: Mask | None, settings: bool = False) -> Grouped:
    """The offset `a` has a value for sand and one for clay; the slope is the same."""
    fitted = (_fitted("a[clay]", "a", "clay"), _fitted("b", "b"), _fitted("a[sand]", "a", "sand"))
    runs = None if settings else Runs(np.zeros(6, dtype=int), ("0",), str, {})
    problem = Problem(("f", "g"), (), fitted, {}, {}, {"x": X}, rows, runs, {}, {})
    groups = {"soil": Groups(("clay", "sand"), np.array([1, 0, 1, 1, 0, 1]))}
    base: Any = SimpleNamespace(predictor=_Line)
    return Grouped(base, problem, groups)


@pytest.mark.parametrize("rows", [None, np.array([True, True, False, True, True, True])])
def test_each_group_is_predicted_with_its_own_value(rows: Mask | None) -> None:
    wanted = slice(None) if rows is None else rows
    grouped = _grouped(rows)
    theta = np.array([10.0, 2.0, 30.0])
    line = (np.array([30.0, 10.0, 30.0, 30.0, 10.0, 30.0]) + 2.0 * X)[wanted]
    np.testing.assert_allclose(grouped.predict(theta), [line, -line])
    both = grouped.predict(np.array([theta, 2.0 * theta]))
    np.testing.assert_allclose(both, [[line, -line], [2.0 * line, -2.0 * line]])
    np.testing.assert_allclose(grouped.near(theta[None]), [[line + 100.0, 100.0 - line]])
    value, slopes = grouped.jacobian(theta)
    np.testing.assert_allclose(value, [line + 100.0, 100.0 - line])
    sand = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0])[wanted]
    expected = np.stack([1.0 - sand, X[wanted], sand], axis=-1)
    np.testing.assert_allclose(slopes, [expected, -expected], atol=1e-6)
    np.testing.assert_allclose(grouped.motion(theta)["height"], line)
    features = np.arange(2.0 * len(line)).reshape(2, -1)
    act = grouped.acting(theta, "force")
    assert act is not None
    own = np.where(sand > 0.0, 30.0, 10.0)
    np.testing.assert_allclose(act(features), np.stack([own * features, features], axis=1))
    assert grouped.acting(theta, "none") is None
    assert [grouped.trouble(np.array(one)) for one in ((10.0, 2.0, 30.0), (10.0, 60.0, 30.0), (10.0, 2.0, 60.0))] == [
        "", "", "too high"
    ]  # fmt: skip


def test_a_proposed_setting_is_of_the_group_with_most_rows() -> None:
    line = 30.0 + 2.0 * X
    np.testing.assert_allclose(_grouped(None, settings=True).predict(np.array([10.0, 2.0, 30.0])), [line, -line])


def _table(**changed: Any) -> Any:
    given = {
        "base": SimpleNamespace(name="wheel", whole_runs=False, channels=("current", "absent")),
        "roles": {"omega": np.array([1.0, -2.0, 3.0, -4.0, 5.0, 6.0]), "load": np.full(6, 7.0)},
        "channels": {"current": np.array([2.0, 3.0, 2.0, 3.0, 3.0, 2.0])},
        "units": {"omega": "rad/s", "load": "N", "current": None},
        "run": np.array([0, 0, 0, 1, 1, 1]),
        "rows": 6,
    }
    return SimpleNamespace(**{**given, **changed})


def test_every_fault_that_a_table_may_have() -> None:
    """Factors both ways and in the unit's words; a sign that a column lacks, of what reverses; a column that moves
    within its runs may be late."""
    found = faults(_table())
    kinds = [(one.column, one.name, one.factor, one.sign_of, one.late) for one in found]
    of = {column: [one for one in found if one.column == column] for column in ("omega", "load", "current")}
    assert len(kinds) == sum(map(len, of.values()))
    assert all(one.name == f"table.{one.column}.scale" for one in found if one.factor != 1.0)
    usual = 1 + 2 * 4  # the direction, and four factors both ways
    scales = {column: [one for one in many if one.factor != 1.0] for column, many in of.items()}
    assert {column: len(many) for column, many in scales.items()} == {
        "omega": usual + 4, "load": usual, "current": usual + 8
    }  # fmt: skip
    for many in scales.values():
        factors = sorted(abs(one.factor) for one in many)
        assert np.prod(factors) == pytest.approx(1.0)  # each beside its inverse
    assert [(one.name, one.sign_of, one.title) for one in found if one.sign_of] == [
        ("table.load.sign", "omega", "load lacks the sign of omega"),
        ("table.current.sign", "omega", "current lacks the sign of omega"),
    ]
    assert [(one.name, one.late, one.title) for one in found if one.late] == [
        ("table.omega.delay", 1, "omega comes 1 row late"), ("table.current.delay", 1, "current comes 1 row late")
    ]  # fmt: skip
    titles = {one.title: one for one in scales["omega"]}
    assert titles["omega has a mistaken direction"].factor == -1.0
    assert titles["omega is in turns a minute"].factor == pytest.approx(2.0 * np.pi / 60.0)
    assert titles["omega is taken for turns a minute"].factor == pytest.approx(60.0 / (2.0 * np.pi))
    assert titles["omega is in minutes"].cost == pytest.approx(np.log(20.0))  # hardly anybody does
    assert titles["omega is in turns a minute"].cost == 0.0
    assert titles["omega is wrong by a factor of 9.807"].cost == pytest.approx(np.log(20.0))  # a speed is no force
    assert {one.title: one.cost for one in scales["load"]}["load is in kilograms of force"] == 0.0
    assert faults(_table(base=SimpleNamespace(whole_runs=True))) == []


def test_what_puts_a_fault_right() -> None:
    case = _table()
    for mend in ({"factor": 0.123456789}, {"sign_of": "omega"}, {"delay": 1}, {"factor": -1.0, "delay": 2}, {}):
        fault = table_faults.fault_of(case, "table.rate.of.turn.scale", mend)
        assert fault.mend == mend
        assert (fault.column, fault.name) == ("rate.of.turn", "table.rate.of.turn.scale")
    assert table_faults.fault_of(case, "table.load.scale", {"factor": 1.0 / 3.0}).mend == {"factor": 0.333333333}


def test_a_sign_that_is_read_off_a_channel_costs_a_bit_for_each_stretch() -> None:
    case = _table(channels={"current": np.array([2.0, -3.0, -2.0, -3.0, -3.0, 2.0])})
    # of + | - - | run | - - | +
    assert table_faults._cost(case, "current") == pytest.approx(4.0 * np.log(2.0))
    assert table_faults._cost(case, "omega") == 0.0


def test_a_column_varies_where_rows_of_one_run_differ() -> None:
    run = np.array([0, 0, 1, 1])
    assert not table_faults._varies(np.array([1.0, 1.0, 2.0, 2.0]), run)
    assert table_faults._varies(np.array([1.0, 1.0, 2.0, 2.1]), run)
    assert not table_faults._varies(np.array([1.0, 1.0 + 1e-10, 2.0, 2.0]), run)  # rounding
    assert not table_faults._varies(np.arange(4.0), np.arange(4))  # runs of one row
    assert not table_faults._varies(np.full(4, 3.0), run)


def test_a_faulty_column_is_read_as_it_should_have_been() -> None:
    """Rows come earlier within their run, whose last row stays; a sign is that of what was measured."""
    case = _table(roles={"omega": np.array([1.0, -2.0, 3.0, -4.0, 5.0, 6.0]), "pass": np.arange(6.0), "load": X})
    inputs = {"omega": case.roles["omega"], "pass_": np.arange(6.0), "load": X, "other": X}

    def fault(column: str, **mend: Any) -> Any:
        return table_faults.fault_of(case, f"table.{column}.x", mend)

    found = read([fault("load", delay=1, factor=2.0), fault("pass", sign_of="omega")], inputs, case)
    assert found["load"].tolist() == [4.0, 8.0, 8.0, 22.0, 32.0, 32.0]
    assert found["pass_"].tolist() == [0.0, -1.0, 2.0, -3.0, 4.0, 5.0]
    assert found["other"] is X
    assert inputs["load"] is X  # unchanged
    assert read([fault("load", sign_of="current")], inputs, case)["load"].tolist() == X.tolist()
    assert read([fault("absent", factor=2.0), fault("current", factor=2.0)], inputs, case) == inputs
    proposed = {"load": np.array([3.0, 4.0])}
    assert read([fault("load", factor=2.0)], proposed, case)["load"].tolist() == [3.0, 4.0]


@pytest.mark.parametrize("rows", [None, np.array([True, True, False, True, True, True])])
def test_a_record_shows_a_prediction_with_its_faults(rows: Mask | None) -> None:
    """Late within its run, without its sign, in another unit; derivatives as the prediction."""
    case = _table()

    def fault(column: str, **mend: Any) -> Any:
        return table_faults.fault_of(case, f"table.{column}.x", mend)

    assert recorded([fault("omega", factor=2.0)], ("current", "voltage"), case, rows) is None
    wanted = np.ones(6, dtype=bool) if rows is None else rows
    several = [fault("voltage", delay=1), fault("voltage", sign_of="omega", factor=4.0)]
    change = recorded(several, ("current", "voltage"), case, rows)
    assert change is not None
    count = int(wanted.sum())
    predicted = np.random.default_rng(1).standard_normal((3, 2, count))
    shown = change(predicted)
    run, sign = case.run[wanted], np.sign(case.roles["omega"])[wanted]
    for row in range(count):
        before = row - 1 if row and run[row - 1] == run[row] else row
        np.testing.assert_allclose(shown[:, 1, row], predicted[:, 1, before] * sign[row] / 4.0)
    np.testing.assert_array_equal(shown[:, 0], predicted[:, 0])

    class Own(_Line):
        def jacobian(self, theta: Array) -> tuple[Array, Array]:
            return theta[0] * predicted[0], predicted[1:].transpose(1, 2, 0)

    problem: Any = SimpleNamespace(fitted=[])
    predict, near, jacobian = _shown(Own(problem), change)
    value, slopes = jacobian(np.array([2.0]))
    np.testing.assert_allclose(value, 2.0 * shown[0])
    np.testing.assert_allclose(slopes, shown[1:].transpose(1, 2, 0))
    own: Any = SimpleNamespace(predict=lambda theta: predicted, near=lambda sets: 2.0 * predicted)
    predict, near, _ = _shown(own, change)
    np.testing.assert_allclose(predict(np.zeros(1)), shown)
    np.testing.assert_allclose(near(np.zeros(1)), 2.0 * shown)


def _effect(name: str, size: Parameter, *shape: Parameter) -> Effect:
    return Effect(name, "", "", "", ("wheel",), (size, *shape), (), "0", "y")


def _bound(model: Model, rows: Mask, limit: int, spoiled: tuple[str, ...]) -> Any:
    """Of each parameter its own share, by its name; without numbers where some effects stand together."""
    names = [one.key for one in model.fitted]
    pattern = {name: (1.0 + sum(map(ord, name))) * X[rows] for name in names}
    if len(model.effects) > limit:
        raise ValueError("no room")

    def near(sets: Array) -> Array:
        total = sum(
            (sets[:, i, None] * pattern[name] for i, name in enumerate(names)), np.zeros((len(sets), rows.sum()))
        )
        together_ = len(model.effects) > 1 and any(one.name in spoiled for one in model.effects)
        return np.asarray(np.where(together_, np.nan, total))[:, None]

    return SimpleNamespace(near=near, predict=near)


@pytest.mark.parametrize(
    ("whole_runs", "own_dynamics", "limit", "spoiled", "most"),
    [(True, None, 99, (), 10), (True, None, 9, (), 10), (True, None, 99, ("e3",), 10), (True, {}, 99, (), 10),
     (False, None, 99, (), 1), (True, {"v": 1}, 99, (), 1)],
)  # fmt: skip
def test_effects_that_are_looked_at_together_are_each_as_alone(
    monkeypatch: pytest.MonkeyPatch,
    whole_runs: bool,
    own_dynamics: Any,
    limit: int,
    spoiled: tuple[str, ...],
    most: int,
) -> None:
    """Ten at once of a body over time; one by one where they have no room together, or no numbers."""
    base = SimpleNamespace(whole_runs=whole_runs, own_dynamics=own_dynamics)
    case: Any = SimpleNamespace(base=base, inputs={}, rows=6)
    model = Model(case, (), (_fitted("k", "k"),))
    asked, seen = [], []
    for number in range(12):
        shape = [Parameter(f"s{i}", "1", 1.0) for i in range(number % 3)]
        effect = _effect(f"e{number}", Parameter("a", "N", 0.0), *shape)
        sets = np.random.default_rng(number).standard_normal((2 + number % 4, 1 + len(shape)))
        sets[0, 0] = 0.0
        asked.append((effect, sets))

    def bind(self: Model, inputs: object, rows: Mask) -> Any:
        seen.append(len(self.effects))
        return _bound(self, rows, limit, spoiled)

    monkeypatch.setattr(Model, "bind", bind)
    rows, theta = np.array([True, True, True, False, True, False]), np.array([3.0])
    found = beside(model, theta, asked, rows)
    assert max(seen) == most
    assert len(found) == 12
    for (effect, sets), values in zip(asked, found, strict=True):
        # what others that are absent add by their shapes is in each of a batch: only the change counts
        alone = _bound(model.having(effect), rows, 99, ()).near(np.hstack([np.full((len(sets), 1), 3.0), sets]))
        np.testing.assert_allclose(values[1:] - values[0], alone[1:] - alone[0], rtol=1e-9, atol=1e-6)
    with pytest.raises(ValueError, match="no room"):
        _limited(monkeypatch, model, asked[:1], rows)


def _limited(monkeypatch: pytest.MonkeyPatch, model: Model, asked: Any, rows: Mask) -> None:
    monkeypatch.setattr(Model, "bind", lambda self, inputs, rows: _bound(self, rows, 0, ()))
    beside(model, np.array([3.0]), asked, rows)


def test_a_candidate_is_what_the_case_has_all_for_and_the_model_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    def require(case: Any, name: str, complain: Any) -> str:
        if name == "lacking":
            raise complain("no column", "effects")
        return name.upper()

    monkeypatch.setattr(data_columns, "require_effect", require)
    case = SimpleNamespace(library={"present": 0, "drag": 0, "lacking": 0, "gear": 0})
    model: Any = SimpleNamespace(case=case, effects=[SimpleNamespace(name="present")])
    assert candidates(model) == ["DRAG", "GEAR"]
    monkeypatch.setattr(data_columns, "require_effect", lambda *_: (_ for _ in ()).throw(UserError("none")))
    assert candidates(model) == []


@pytest.mark.parametrize(("start", "maximum", "step"), [(0.0, np.inf, 1e-3), (0.0, 0.2, 2e-4), (0.0, 8.0, 1e-3),
    (0.0, -0.5, 5e-4), (-3.0, np.inf, 3e-3)])  # fmt: skip
def test_a_direction_is_looked_along_a_thousandth(
    monkeypatch: pytest.MonkeyPatch, start: float, maximum: float, step: float
) -> None:
    """Of the size's bound, of one, or of a first value that is no size; in the order of the catalogue."""
    size = Parameter("a", "N", start, -np.inf, maximum)
    effects = [_effect("bent", size), _effect("none", Parameter("b", "N", 0.0)), _effect("bare", size)]
    effects[2] = Effect("bare", "", "", "", ("wheel",), (), (), "0", "y")
    steps: list[float] = []

    def change(a: Array) -> Array:
        steps.extend(np.abs(a[a != 0.0]).tolist())
        return (a[:, None] * np.array([3.0, -4.0]))[:, None]

    def near(model: Any, theta: Array, asked: Any, rows: Mask) -> list[Array]:
        return [change(sets[:, 0]) if one.name == "bent" else np.zeros((2, 1, 2)) for one, sets in asked]

    plain = SimpleNamespace(predict=lambda theta: np.zeros((1, 2)))
    having = SimpleNamespace(bind=lambda *_: SimpleNamespace(predict=lambda sets: change(sets[:, -1])))
    case = SimpleNamespace(inputs={})
    model: Any = SimpleNamespace(case=case, having=lambda effect: having, bind=lambda *_: plain)
    monkeypatch.setattr(data_columns, "candidates", lambda _: effects)
    monkeypatch.setattr(data_columns, "beside", near)
    (found,) = catalogue_directions(model, np.array([1.0]), np.ones(2, dtype=bool))
    assert found.effect == "bent"
    np.testing.assert_allclose(found.change, [[0.6, -0.8]])
    assert steps == [pytest.approx(step)]


@pytest.mark.parametrize(("values", "degree"), [((1.0, 2.0), 1), ((1.0, 2.0, 4.0), 2), ((1.0, 2.0, 4.0, 8.0, 9.0), 3)])
def test_a_column_of_few_values_has_as_many_shapes_less_one(values: tuple[float, ...], degree: int) -> None:
    """Legendre's polynomials over its range, of unit rms; monomials through zero, and none of what is still."""
    x = np.repeat(values, 3)
    case: Any = SimpleNamespace(roles={}, extra={"q": x, "still": np.full(len(x), 3.0) + 1e-13 * np.arange(len(x))})
    found = column_shapes(case, np.ones(len(x), dtype=bool))
    assert set(found) == {"", "q"}
    u = 2.0 * (x - min(values)) / (max(values) - min(values)) - 1.0
    shapes = np.array([u, 1.5 * u**2 - 0.5, 2.5 * u**3 - 1.5 * u])[:degree]

    def unit(many: Array) -> Array:
        return np.asarray(many / np.sqrt(np.mean(many**2, axis=1, keepdims=True)))

    np.testing.assert_allclose(found["q"].together, unit(shapes), atol=1e-12)
    np.testing.assert_allclose(found["q"].singly, unit(np.array([x, x**2])))
    np.testing.assert_array_equal(found[""].singly, np.ones((1, len(x))))
    assert found[""].together.shape == (0, len(x))


def test_what_acts_on_a_target_shows_in_units_of_noise() -> None:
    """By the derivative to what is added there, or as a base that integrates says itself."""
    slopes = np.arange(24.0).reshape(2, 4, 3)
    seen: list[Any] = []

    def having(effect: Effect) -> Any:
        seen.append((effect.target, effect.expression, effect.parameters[0].name, effect.bases))

        def jacobian(theta: Array) -> tuple[Array, Array]:
            seen.append(theta.tolist())
            return np.zeros((2, 4)), slopes

        return SimpleNamespace(bind=lambda inputs, rows: SimpleNamespace(jacobian=jacobian))

    own: list[Any] = [None]
    case = SimpleNamespace(base=SimpleNamespace(name="wheel"), inputs={})
    bound = SimpleNamespace(acting=lambda theta, target: own[0])
    model: Any = SimpleNamespace(case=case, having=having, bind=lambda inputs, rows: bound)
    rows, sigma, theta = np.ones(4, dtype=bool), np.array([2.0, 0.5]), np.array([7.0, 8.0])
    expected = slopes[..., 2] / sigma[:, None]
    np.testing.assert_allclose(response(model, theta, "torque", rows, sigma), expected)
    assert seen == [("torque", "probe_", "probe_", ("wheel",)), [7.0, 8.0, 0.0]]
    features = np.array([[1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 0.0, -1.0]])
    found = acting(model, theta, "torque", rows, sigma)(features)
    np.testing.assert_allclose(found, expected * features[:, None, :])
    own[0] = lambda features: np.stack([features, 3.0 * features], axis=1)
    found = acting(model, theta, "torque", rows, sigma)(features)
    np.testing.assert_allclose(found, np.stack([features / 2.0, 6.0 * features], axis=1))


def test_simple_terms_of_equations_of_the_user_s_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each column and state that they read, and of pairs; time alone is none."""
    rows = np.array([True, True, True, False])
    columns = {"u": np.array([1.0, -2.0, 0.5, 9.0]), "w": np.ones(4), "time": np.arange(4.0)}
    formulas = {"v": SimpleNamespace(names={"u", "v", "time", "k"})}
    case = SimpleNamespace(inputs=columns, dynamics=SimpleNamespace(derivative=formulas))
    case.base = SimpleNamespace(forces=("d_v", "dead"))
    v = np.array([2.0, 3.0, -1.0])
    motion: list[dict[str, Array]] = [{"v": v}]
    model: Any = SimpleNamespace(case=case)
    model.bind = lambda inputs, mask: SimpleNamespace(motion=lambda theta: motion[0])
    factor = {"d_v": np.array([1.0, -4.0]) / 8.0, "dead": np.zeros(2)}  # below a noise sd, and nothing

    def act(model: Any, theta: Array, target: str, rows: Mask, sigma: Array) -> Any:
        return lambda features: factor[target][:, None] * features[:, None]

    monkeypatch.setattr(effect_columns, "acting", act)
    found = terms_of(model, np.zeros(1), rows, np.ones(2))
    u, one = columns["u"][:3], np.ones(3)
    expected = {
        "1": one, "u": u, "u*abs(u)": u * abs(u), "u**2": u**2, "u**3": u**3, "sign(u)": np.sign(u),
        "v": v, "v*abs(v)": v * abs(v), "v**2": v**2, "v**3": v**3, "sign(v)": np.sign(v), "u*v": u * v,
    }  # fmt: skip
    assert list(found) == [f"d_v: {name}" for name in expected]
    for name, feature in expected.items():
        (shape,) = found[f"d_v: {name}"]
        loud = 4.0 * np.sqrt(np.mean(feature**2))
        assert (shape.lower, shape.upper, shape.values) == (-np.inf, np.inf, ())
        assert shape.scale == pytest.approx(8.0 / loud)
        np.testing.assert_allclose(shape.columns[:, 0], np.concatenate([feature, -4.0 * feature]) / loud)
    motion[0] = {}
    assert terms_of(model, np.zeros(1), rows, np.ones(2)) == {}


def test_a_constant_is_suspected_where_it_is_stated_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not what is fitted, 0, what the base takes anyway, or what nothing reads."""
    quantity = {name: SimpleNamespace(default=1.0) for name in ("radius", "gear", "mass", "play", "usual")}
    base = SimpleNamespace(name="wheel", parameters=quantity)
    parameters = {
        "radius": 2.0, "gear": 1.0, "mass": 3.0, "play": 0.0, "own_k": 4.0, "unread": 5.0, "rate": 1.0
    }  # fmt: skip
    reads = SimpleNamespace(names={"own_k"})
    over_time = SimpleNamespace(derivative={"v": SimpleNamespace(names={"rate"})})
    case = SimpleNamespace(base=base, parameters=parameters, fit={"mass": 0}, equations={"y": reads}, dynamics=None)
    model: Any = SimpleNamespace(case=case)
    found = constants(model)
    assert [one.name for one in found] == ["constant.radius", "constant.own_k"]
    case.dynamics = over_time
    assert [one.target for one in constants(model)] == ["radius", "own_k", "rate"]
    one = found[1]
    assert (one.title, one.target, one.bases, one.expression) == (
        "own k is not what is stated", "own_k", ("wheel",), "relative_error"
    )  # fmt: skip
    (parameter,) = one.parameters
    assert (parameter.name, parameter.unit, parameter.start) == ("relative_error", "1", 0.0)
    assert (parameter.minimum, parameter.maximum) == (-0.8, 4.0)
    assert [named(name) for name in ("constant.radius", "stribeck")] == ["radius", ""]
    monkeypatch.setattr("terrapin_tools.workbench.model.constants.candidates", lambda _: ["drag"])
    assert suspected(model)[0] == "drag"
    assert len(suspected(model)) == 4


def _linear(matrix: Array, wanted: Array) -> tuple[Any, Any]:
    def residual(theta: Array) -> Array:
        return np.asarray(matrix @ theta - wanted)

    return (lambda theta: (residual(theta), matrix)), residual


@pytest.mark.parametrize("seed", range(6))
def test_a_search_ends_at_the_least_squares_within_its_box(seed: int) -> None:
    """Also from outside of it; what is held stays where it starts."""
    random = np.random.default_rng(seed)
    matrix, wanted = random.standard_normal((20, 4)) * [1.0, 100.0, 0.01, 1.0], random.standard_normal(20)
    evaluate, residual = _linear(matrix, wanted)
    lower, upper = np.array([-0.05, -1e-3, -5.0, -0.02]), np.array([0.05, 1e-3, 5.0, 0.4])
    expected = lsq_linear(matrix, wanted, (lower, upper), tol=1e-13)
    theta, cost = minimise(evaluate, residual, np.array([9.0, 0.0, -9.0, 0.1]), lower, upper, np.ones(4, dtype=bool))
    assert cost == pytest.approx(2.0 * expected.cost, rel=1e-7)
    np.testing.assert_allclose(theta * [1.0, 100.0, 0.01, 1.0], expected.x * [1.0, 100.0, 0.01, 1.0], atol=1e-4)
    free = np.array([True, False, True, False])
    theta, cost = minimise(evaluate, residual, np.array([0.0, 5e-4, 0.0, 0.3]), lower, upper, free)
    rest = wanted - matrix[:, ~free] @ [5e-4, 0.3]
    part = lsq_linear(matrix[:, free], rest, (lower[free], upper[free]), tol=1e-13)
    assert theta[~free].tolist() == [5e-4, 0.3]
    assert cost == pytest.approx(2.0 * part.cost, rel=1e-7)


def test_each_step_that_holds_lets_the_next_be_bolder() -> None:
    """Of a line, a step leaves d / (1 + d) of the way: d falls twentyfold with each, and grows eightfold where there
    are no numbers."""
    points: list[float] = []
    tried: list[float] = []

    def residual(theta: Array) -> Array:
        tried.append(theta[0])
        return np.array([np.nan if len(tried) in (3, 4) else theta[0]])

    def evaluate(theta: Array) -> tuple[Array, Array]:
        points.append(theta[0])
        return np.array([theta[0]]), np.ones((1, 1))

    wide = np.full(1, 9.0)
    minimise(evaluate, residual, np.ones(1), -wide, wide, np.ones(1, dtype=bool), enough=(0.0, 0.0))
    expected = [1.0]
    for damping in (1e-4, 5e-6, 64.0 * 2.5e-7, 8e-7):
        expected.append(expected[-1] * damping / (1.0 + damping))
    assert points[:4] == pytest.approx(expected[:4], rel=1e-5)


def test_a_search_that_cannot_come_near_another_ends() -> None:
    """A step of a line promises twice what it gains; five times that is not enough to come below the floor."""
    evaluate, residual = _linear(np.array([[1.0], [0.0]]), np.array([0.0, 100.0]))
    wide, free = np.full(1, 99.0), np.ones(1, dtype=bool)

    def found(floor: float) -> float:
        return float(minimise(evaluate, residual, np.array([10.0]), -wide, wide, free, floor=floor)[1])

    # at 10: cost 10100, the step promises 100
    assert found(10100.0 - 5.0 * 100.0 + 1.0) == pytest.approx(10000.0)
    assert found(10100.0 - 5.0 * 100.0 - 1.0) == pytest.approx(10100.0)


@pytest.mark.parametrize(
    ("aim", "edge", "blocked", "count"),
    [(np.inf, 0.0, False, 101), (0.0, 0.0, False, 3), (-1e9, 0.0, False, 3), (9e3, 0.0, False, 101),
     (np.inf, 0.03, True, 3), (np.inf, 0.03, False, 101), (np.inf, 0.01, True, 101), (np.inf, 0.0, True, 101)],
)  # fmt: skip
def test_three_steps_that_do_not_come_near_end_a_search(aim: float, edge: float, blocked: bool, count: int) -> None:
    """Each gains 2 % of the cost: less than a twentieth of what lies to the aim; or less than an edge asks for, where
    farther on there are no numbers."""
    steps: list[float] = []
    tried: list[float] = []

    def residual(theta: Array) -> Array:
        tried.append(theta[0])
        return np.array([np.nan if blocked and len(tried) % 2 else 100.0 - theta[0]])

    def crawling(theta: Array) -> tuple[Array, Array]:  # by its derivatives a step gets to a hundredth of the way
        steps.append(theta[0])
        return np.array([100.0 - theta[0]]), np.array([[-100.0]])

    wide, free = np.full(1, 99.0), np.ones(1, dtype=bool)
    minimise(crawling, residual, np.zeros(1), -wide, wide, free, aim=aim, edge=edge)
    assert len(steps) == count


def test_the_first_step_of_a_turn_may_be_tried_with_its_derivatives() -> None:
    """It is asked for once then; where it does not hold the next ones are tried without. The way is the same."""

    def way(ahead: bool) -> tuple[list[float], list[float]]:
        evaluated: list[float] = []
        tried: list[float] = []

        def left(x: float) -> Array:
            return np.array([np.nan if x > 5.0 else x - 2.0])

        def residual(theta: Array) -> Array:
            tried.append(float(theta[0]))
            return left(theta[0])

        def evaluate(theta: Array) -> tuple[Array, Array]:
            evaluated.append(float(theta[0]))
            return left(theta[0]), np.array([[0.3125 if theta[0] == 0.0 else 1.0]])  # at first too far, to 6.4

        wide, free = np.full(1, 99.0), np.ones(1, dtype=bool)
        minimise(evaluate, residual, np.zeros(1), -wide, wide, free, ahead=ahead)
        return evaluated, tried

    plain, tried = way(False)
    assert [x > 5.0 for x in tried[:6]] == [True] * 4 + [False] * 2
    assert plain == [0.0, *(x for x in tried if x < 4.0)]
    evaluated, alone = way(True)
    assert alone == tried[1:6]
    assert evaluated == [0.0, tried[0], *tried[5:]]
    assert evaluated[-1] == pytest.approx(2.0)


def test_a_start_is_halved_until_it_is_not_far_off() -> None:
    """Six times at most, down to twice the cost without it."""
    start = np.array([5.0, 64.0])

    def nearer(cost: float) -> tuple[float, bool]:
        problem: Any = SimpleNamespace(evaluate=lambda theta: (theta[1:], None), residual=lambda theta: theta[1:])
        found, came = fitting._Problem.nearer(problem, start, 1, cost)
        return float(found[1]), came

    assert nearer(0.5 * 64.0**2) == (64.0, True)
    assert nearer(0.5 * 64.0**2 - 1.0) == (32.0, True)
    assert nearer(0.5 * 8.0**2) == (8.0, True)
    assert nearer(0.5) == (1.0, True)
    assert nearer(0.49) == (1.0, False)
    assert start.tolist() == [5.0, 64.0]


def test_what_the_data_do_not_determine_has_an_sd_a_million_times_as_large() -> None:
    """A parameter that changes nothing, or has no derivative; and two that do the same, along what turns one into the
    other."""
    white, run = Node(0.0, 0.0, 0.0, 0.0, 1.0), np.arange(8)
    one = np.full((1, 8), np.sqrt(0.125))

    def found(*columns: Array) -> Array:
        jacobian = np.stack(columns, axis=-1)
        fit: Any = SimpleNamespace(jacobian=jacobian, residual=np.zeros((1, 8)), theta=np.zeros(jacobian.shape[2]))
        return covariance(fit, run, white)[0]

    for other in (0.0 * one, np.nan * one):
        np.testing.assert_allclose(found(2.0 * one, other), [[0.25, 0.0], [0.0, 1e12]])
    same = found(2.0 * one, one)
    known, unknown = 0.25, 1.0 / (1e-12 * 2.0) / 2.0
    np.testing.assert_allclose(
        same, [[(known + unknown) / 4.0, (known - unknown) / 2.0], [(known - unknown) / 2.0, known + unknown]]
    )


@pytest.mark.parametrize(
    ("wanted", "lower", "upper", "ends", "at_bound"),
    [(9.0, -2.0, 5.0, 5.0, ("k",)), (-9.0, -2.0, 5.0, -2.0, ("k",)), (3.0, -2.0, 5.0, 3.0, ()),
     (-9.0, 0.0, 5.0, 0.0, ("k",)), (9.0, -5.0, 0.0, 0.0, ("k",)), (-5.0, -9.0, 5.0, -5.0, ()),
     (1.0, 0.0, np.inf, 1.0, ())],
)  # fmt: skip
def test_a_parameter_that_ends_at_either_bound_is_named(
    wanted: float, lower: float, upper: float, ends: float, at_bound: tuple[str, ...]
) -> None:
    fitted = [replace(_fitted("k", "k"), lower=lower, upper=upper, start=0.0)]
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=False))
    model = SimpleNamespace(
        fitted=fitted, case=case, start=np.zeros(1), lower=np.array([lower]), upper=np.array([upper])
    )  # fmt: skip
    bound: Any = SimpleNamespace(
        model=model,
        predict=lambda theta: np.full((1, 4), theta[0]),
        jacobian=lambda theta: (np.full((1, 4), theta[0]), np.ones((1, 4, 1))),
    )
    fit = fitting.fit_model(bound, np.full((1, 4), wanted), np.full(1, 2.0), [np.zeros(1)])
    assert fit.theta[0] == pytest.approx(ends)
    assert fit.at_bound == at_bound
    assert fit.cost == pytest.approx(4.0 * ((wanted - ends) / 2.0) ** 2, abs=1e-9)
    np.testing.assert_allclose(fit.residual, (wanted - ends) / 2.0, atol=1e-6)
    np.testing.assert_allclose(fit.jacobian, np.full((1, 4, 1), 0.5))


def test_of_runs_whose_rows_come_in_turn_each_is_looked_at_alone() -> None:
    """As of rigs that are read together."""
    run = np.array([0, 1, 0, 1, 0])
    np.testing.assert_array_equal(table_faults._shifted(run, 1), [0, 1, 0, 1, 2])
    np.testing.assert_array_equal(table_faults._shifted(run, -1), [2, 3, 4, 3, 4])
    assert table_faults._varies(np.array([5.0, 7.0, 6.0, 7.0, 6.0]), run)
    assert not table_faults._varies(np.array([5.0, 7.0, 5.0, 7.0, 5.0]), run)
    odd, residual = np.array([True, True, True, True, False, False]), np.ones(6)
    columns, every = {"x": np.array([0.0, 0.1, 0.2, 0.3, 5.0, 9.0])}, np.ones(6, dtype=bool)
    # two glitches that last for two rows each are two, too few to lie together
    assert not gathered(odd, residual, np.array([0, 1, 0, 1, 0, 1]), columns, every)
