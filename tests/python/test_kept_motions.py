"""What was integrated is not integrated again, and is what would be found again."""

from __future__ import annotations

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_hil.physics import dynamic
from terrapin_hil.physics.bodies import Drive
from terrapin_tools.workbench.bases.kinds import integrations
from terrapin_tools.workbench.bases.kinds.base import Problem, Runs
from terrapin_tools.workbench.bases.kinds.integrated import Integrated, Stretches
from terrapin_tools.workbench.bases.kinds.integrations import KEPT, digest
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.model.constants import suspected
from terrapin_tools.workbench.model.data_columns import AT_ONCE, beside
from terrapin_tools.workbench.model.effect_columns import shapes_of, shapes_of_each
from terrapin_tools.workbench.model.model import Model
from tests.bench.bench_over_time import made


def forget() -> None:
    KEPT.arrays.clear()
    KEPT.size = 0


@pytest.fixture(scope="module", params=["cylinder", "sphere", "car"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    return load_case(made(request.param, tmp_path_factory.mktemp("case")))


def test_a_prediction_is_the_same_to_the_bit_whatever_was_asked_before(case: Case) -> None:
    model = Model.of(case)
    first, other = case.run == 0, case.run <= 1
    theta = model.start
    forget()
    plain = model.bind(case.inputs, other).predict(theta)
    forget()
    alone = [model.bind(case.inputs, first).jacobian(theta)]
    assert np.array_equal(plain[:, first[other]], alone[0][0])  # beside neighbours it is the run that it is without
    model.bind(case.inputs, other).predict(1.01 * theta)
    both = model.bind(case.inputs, other).jacobian(theta)
    forget()
    assert np.array_equal(both[1], model.bind(case.inputs, other).jacobian(theta)[1])
    sets = np.vstack([theta, 1.001 * theta, 0.999 * theta])
    forget()
    three = model.bind(case.inputs, first).near(sets)
    forget()
    model.bind(case.inputs, first).near(sets[[0, 2]])  # then one of two neighbours is known
    assert np.array_equal(three, model.bind(case.inputs, first).near(sets))
    own = model.bind(case.inputs, first).predict(sets[1])  # no neighbour of the first, but a run of its own
    forget()
    assert np.array_equal(own, model.bind(case.inputs, first).predict(sets[1]))


def test_the_same_is_integrated_once_and_another_law_or_run_by_itself(case: Case) -> None:
    asked: list[int] = []
    assert isinstance(case.base, Integrated)
    follow = case.base.body.follow

    def counted(drive: Drive) -> tuple[Array, Array]:
        asked.append(len(drive.tables))
        return follow(drive)

    object.__setattr__(case.base.body, "follow", counted)
    try:
        forget()
        model, rows = Model.of(case), case.run == 0
        bound = model.bind(case.inputs, rows)
        bound.predict(model.start)
        bound.predict(model.start)
        model.bind(case.inputs, rows).predict(model.start)
        assert asked == [1]
        model.bind(case.inputs, case.run == 1).predict(model.start)
        assert asked == [1, 1]
        drive = next(name for name in case.base.needs if name != "time")
        changed = {**case.inputs, drive: 1.01 * case.inputs[drive]}
        model.bind(changed, rows).predict(model.start)
        assert asked == [1, 1, 1]
        effect = next(e for e in suspected(model) if len(e.parameters) == 1)
        larger = model.having(effect)
        larger.bind(case.inputs, rows).predict(np.append(model.start, 0.01))
        assert len(asked) == 4
    finally:
        object.__setattr__(case.base.body, "follow", follow)


def test_no_more_is_kept_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrations, "MOST", 3 * 80)
    kept = integrations._Kept()
    keys = [digest(bytes([i])) for i in range(5)]
    for key in keys[:3]:
        kept.put(key, np.zeros(10))
    assert kept.get(keys[0]) is not None  # used last: it stays
    for key in keys[3:]:
        kept.put(key, np.zeros(10))
    assert [key in kept.arrays for key in keys] == [True, False, False, True, True]
    assert kept.size == 240
    assert digest(b"ab", b"c") != digest(b"a", b"bc")


def test_effects_that_are_looked_at_together_show_what_each_shows_alone(case: Case) -> None:
    model, rows = Model.of(case), case.run == 0
    theta = model.start.copy()
    effects = suspected(model)
    assert len(effects) > AT_ONCE
    sigma = np.array([case.sigma[name] or 1.0 for name in model.channels])
    together = shapes_of_each(model, theta, effects, rows, sigma)
    for effect in effects:
        alone = shapes_of(model, theta, effect, rows, sigma)
        assert [one.values for one in together[effect.name]] == [one.values for one in alone]
        for one, other in zip(together[effect.name], alone, strict=True):
            assert one.scale == pytest.approx(other.scale, rel=1e-6)
            np.testing.assert_allclose(one.columns, other.columns, atol=1e-6)


def test_one_that_gives_no_numbers_does_not_spoil_the_others(case: Case) -> None:
    model, rows = Model.of(case), case.run == 0
    good = next(e for e in suspected(model) if len(e.parameters) == 1)
    bad = next(e for e in suspected(model) if len(e.parameters) == 1 and e.name != good.name)
    asked = [(good, np.array([[0.0], [1e-3]])), (bad, np.array([[0.0], [np.nan]]))]
    values = beside(model, model.start, asked, rows)
    expected = beside(model, model.start, asked[:1], rows)[0]
    np.testing.assert_array_equal(values[0], expected)


def test_effects_that_have_no_room_beside_each_other_are_looked_at_alone(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, rows = Model.of(case), case.run == 0
    some = [e for e in suspected(model) if len(e.parameters) == 1][:2]
    asked = [(effect, np.array([[0.0], [1e-3]])) for effect in some]
    expected = beside(model, model.start, asked, rows)
    predictor = case.base.predictor(
        Problem(
            channels=model.channels,
            effects=(),
            fitted=model.fitted,
            constants=case.parameters,
            options=case.options,
            inputs=case.inputs,
            rows=rows,
            runs=Runs(case.run, case.run_names, case.place, {**case.roles, **case.channels}),
            formulas={},
            scales={},
        )
    )
    assert isinstance(predictor, Stretches)
    columns = len(predictor.table)
    monkeypatch.setattr(dynamic, "MOST_VALUES", columns + 1)  # room for one size
    for found, value in zip(beside(model, model.start, asked, rows), expected, strict=True):
        np.testing.assert_allclose(found, value, rtol=1e-12)
    monkeypatch.setattr(dynamic, "MOST_VALUES", columns - 1)
    with pytest.raises(ValueError, match="values, expected at most"):
        beside(model, model.start, asked, rows)
