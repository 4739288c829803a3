"""The library of formulas: which shapes a column has, with their priors, starts and bounds, and which are kept."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_hil.units import read_unit
from terrapin_tools.workbench.formulas import expressions, vocabulary
from terrapin_tools.workbench.formulas.expressions import Library, Sketch, as_effect
from terrapin_tools.workbench.formulas.periods import waves
from terrapin_tools.workbench.formulas.vocabulary import Scale, Term, shapes

S = 0.35  # of a shape other than the column itself
Told = list[tuple[str, float, tuple[float, ...]]]


def _told(low: float, high: float, unit: str = "m", **more: Any) -> Told:
    """Shapes but steps: text, prior, and start, lowest and highest value of the scale."""
    found: Told = []
    for term in shapes("oil", np.linspace(low, high, 5), unit, **more):
        if ">" not in term.text:
            scales = [number for one in term.scales.values() for number in (one.start, one.low, one.high)]
            assert all(one.unit == unit for one in term.scales.values())
            assert term.starts == {name: one.start for name, one in term.scales.items()}
            assert term.plain
            found.append((term.text, term.prior, tuple(scales)))
    return found


def _same(found: Told, expected: Told) -> None:
    assert [text for text, *_ in found] == [text for text, *_ in expected]
    for (text, prior, scales), (_, other, numbers) in zip(found, expected, strict=True):
        assert prior == pytest.approx(other), text
        assert scales == pytest.approx(numbers), text


def _scaled(text: str, prior: float, starts: Sequence[float], low: float, high: float) -> Told:
    return [(text, prior, (start, low, high)) for start in starts]


def _powers(magnitude: str) -> Told:
    return [("oil", 1.0, ()), ("oil**2", S, ()), ("oil**3", S**1.5, ()), ("oil**4", S**2.5, ()),
        (f"{magnitude}**1.5", S**2, ())]  # fmt: skip


def _bends(magnitude: str, starts: Sequence[float], low: float, high: float) -> Told:
    each = [(f"tanh(oil/{'w'})", start) for start in starts]
    return [
        (text, 0.5 * S**1.5, (start, low, high))
        for tanh, start in each
        for text in (tanh, f"oil/({magnitude} + x0)")
    ]  # fmt: skip


def test_shapes_of_a_column_above_0() -> None:
    """Of 1 to 9: a reference anywhere near, a threshold inside, a bend from 2 % of the largest value on."""
    _same(_told(1.0, 9.0), [
        *_powers("oil"), ("(oil - 5)", 1.0, ()), ("sqrt(oil)", S, ()),
        *_scaled("(oil - x0)", 0.3 * S, (1.0, 3.0, 5.0, 7.0), -8.0, 18.0),
        *_scaled("max(oil - w, 0)", S**3, (4.6, 6.6), 3.4, 7.8), *_bends("oil", (0.9, 2.7), 0.18, 10.8),
        ("log(oil/x0)", S, (5.0, 1.0, 9.0)), ("1/oil", S, ()), ("1/oil**2", S**1.5, ()),
        *_scaled("exp(-oil/tau)", 0.25 * S, (0.54, 1.35, 3.6, 9.0), 0.18, 10.8),
    ])  # fmt: skip


def test_shapes_of_a_column_of_both_signs() -> None:
    signed = "sign(oil)*max(abs(oil) - w, 0)"
    _same(_told(-4.0, 8.0, "rad"), [
        *_powers("abs(oil)"), ("sin(oil)", S, ()), ("cos(oil)", S, ()), ("abs(oil)", S, ()), ("oil*abs(oil)", S, ()),
        ("sign(oil)", S, ()), ("abs(oil)**3", S**2, ()), ("sqrt(abs(oil))", S**1.5, ()),
        ("sign(oil)*sqrt(abs(oil))", S**1.5, ()),
        ("max(abs(oil) - w, 0)", S**3, (3.6, 2.4, 6.8)), (signed, S**3, (3.6, 2.4, 6.8)),
        ("max(abs(oil) - w, 0)", S**3, (5.6, 2.4, 6.8)), (signed, S**3, (5.6, 2.4, 6.8)),
        *_bends("abs(oil)", (0.8, 2.4), 0.16, 9.6),
        *_scaled("exp(-abs(oil)/tau)", 0.5 * S**1.5, (1.2, 4.0), 0.16, 9.6),
    ])  # fmt: skip


def test_shapes_of_a_column_below_0() -> None:
    _same(_told(-9.0, -1.0), [
        *_powers("abs(oil)"), ("(oil + 5)", 1.0, ()), ("sqrt(abs(oil))", S, ()),
        *_scaled("max(abs(oil) - w, 0)", S**3, (4.05, 6.3), 2.7, 7.65), *_bends("abs(oil)", (0.9, 2.7), 0.18, 10.8),
        *_scaled("exp(-abs(oil)/tau)", 0.5 * S**1.5, (1.35, 4.5), 0.18, 10.8),
    ])  # fmt: skip


def test_shapes_that_a_column_has_by_its_unit_and_range() -> None:
    def has(text: str, low: float, high: float, unit: str = "m", **more: Any) -> bool:
        return any(one == text for one, *_ in _told(low, high, unit, **more))

    assert shapes("oil", np.array([0.0, 1.0, 1.0, 0.0]), "1") == [Term("oil", {}, 1.0)]  # in a group or not
    assert len(shapes("oil", np.array([0.0, 1.0, 2.0]), "1")) > 9
    for low, wave in ((-0.5, False), (-0.51, True)):
        assert has("sin(oil)", low, 0.5, "rad") == has("cos(oil)", low, 0.5, "rad") == wave
    assert not has("sin(oil)", -4.0, 4.0)
    plain = [one for one in _told(1.0, 9.0, "1") if "log" in one[0]]
    assert plain == [("log(oil/5)", S, ()), ("log(oil)", S, ())]
    assert not has("log(oil/6)", 3.0, 9.0, "1")  # of less than three times there is hardly a bend
    assert has("log(oil/6.05)", 3.0, 9.1, "")
    assert has("tanh(oil/w)", 4.4, 9.0)
    assert not has("tanh(oil/w)", 4.5, 9.0)
    assert has("1/oil", 0.19, 9.0)
    assert not has("1/oil", 0.18, 9.0)
    for shape in ("1/oil", "log(oil/x0)"):
        assert not has(shape, 0.0, 9.0)
    assert has("exp(-oil/tau)", 0.0, 9.0)
    assert has("(oil - x0)", 0.0, 9.0)
    lower = [numbers for text, _, numbers in _told(1.0, 9.0, lowest=0.1) if text == "max(oil - w, 0)"]
    assert lower == [pytest.approx((start, 1.8, 7.8)) for start in (3.0, 4.6, 6.6)]
    named = {text for text, *_ in _told(1.0, 9.0, taken=("x0", "w", "tau"))}
    assert not named & {"(oil - x0)", "tanh(oil/w)", "exp(-oil/tau)"}
    centred = {term.text for term in shapes("oil", np.linspace(1.0, 9.0, 5), "1") if term.centred}
    assert centred == {"(oil - 5)", "log(oil/5)"}


def _edges(name: str, values: Array) -> list[tuple[float, float, float, float]]:
    found = [term for term in shapes("oil", values, "m") if term.text == f"({name} > w)"]
    assert not any(term.plain for term in found)
    assert len({term.scales["w"].grid for term in found}) <= 1
    return [(t.scales["w"].start, t.scales["w"].low, t.scales["w"].high, t.prior) for t in found]


def test_a_step_lies_between_two_values_that_occur() -> None:
    """Inside the middle nine tenths of the rows, at seven places; its refit begins at sixty."""
    values = np.arange(101.0)
    found = _edges("oil", values)
    grid = next(term.scales["w"].grid for term in shapes("oil", values, "m") if not term.plain)
    assert len(grid) == 60
    assert (grid[0], grid[-1]) == (5.5, 94.5)
    assert {one % 1.0 for one in grid} == {0.5}
    assert [start for start, *_ in found] == [grid[i] for i in (0, 9, 19, 29, 39, 49, 59)]
    assert {one[1:3] for one in found} == {(0.0, 100.0)}
    assert [prior for *_, prior in found] == pytest.approx([S**2 / 7.0] * 7)
    three = _edges("oil", np.array([2.0, 4.0, 8.0]))
    assert [start for start, *_ in three] == [3.0, 6.0]
    assert three[0][3] == pytest.approx(S**2 / 2.0)
    assert _edges("oil", np.array([2.0, 4.0, 4.0])) == []
    assert _edges("oil", np.array([0.0] * 100 + [1.0, 2.0])) == []  # of hardly any rows
    assert _edges("abs(oil)", values) == []
    both = _edges("abs(oil)", np.array([-8.0, 2.0, 4.0, 4.0]))
    assert [one[:3] for one in both] == [(3.0, 2.0, 8.0), (6.0, 2.0, 8.0)]


def test_formulas_act_on_channels_that_are_measured() -> None:
    base = SimpleNamespace(
        channels={"torque": None, "current": None}, targets=lambda: [("torque", 1.0), ("current", 0.5), ("drag", 0.2)]
    )
    case: Any = SimpleNamespace(base=base, channels={"torque": None})
    assert vocabulary.targets(case) == [("torque", 1.0), ("drag", 0.2)]


def _sketch(text: str, target: str = "y", scales: dict[str, Scale] | None = None, prior: float = 0.1) -> Sketch:
    return Sketch(text, target, "oil", scales or {}, prior)


def test_of_a_long_list_the_likeliest_are_weighed_in_every_kind_of_noise() -> None:
    """Each with its prior; of three hundred all."""

    def promised(count: int) -> tuple[Array, list[int]]:
        weighed: list[int] = []

        def of(columns: Array, more: float) -> Array:
            weighed.append(columns.shape[1])
            return np.asarray(columns[0] + more)

        evidence: Any = SimpleNamespace(
            single=lambda columns: of(columns, 1000.0), of_few=lambda: SimpleNamespace(single=lambda c: of(c, 0.0))
        )
        sketches = tuple(_sketch("k*oil", prior=0.1 if i % 2 else 0.1 * np.exp(-700.0)) for i in range(count))
        found = Library(sketches, np.arange(float(count))[None, :], np.ones(count)).promise(evidence)
        return found - np.log([one.prior for one in sketches]), weighed

    found, weighed = promised(300)
    assert weighed == [300]
    np.testing.assert_allclose(found, np.arange(300.0) + 1000.0)
    found, weighed = promised(700)
    assert weighed == [700, 300]
    every = np.flatnonzero(found > 900.0)
    assert len(every) == 300
    assert set(every) == set(range(101, 700, 2))  # those of a prior that is not tiny
    np.testing.assert_allclose(found[every], every + 1000.0)


def test_what_hardly_varies_is_nearly_a_constant() -> None:
    values = np.array([-1.0, 1.0])
    assert expressions._hardly(6.7 + values)
    assert not expressions._hardly(6.6 + values)
    assert expressions._hardly(-6.7 + values)
    assert not expressions._hardly(values)
    assert not expressions._hardly(0.0)
    assert expressions._hardly(1.0)


ONES, E = np.full((4, 1), 0.5), np.eye(4)


def test_columns_are_compared_beside_what_the_model_can_hold() -> None:
    beyond = expressions._beyond(np.stack([2.0 * E[0], np.ones(4), E[1] + E[2]], axis=1), ONES)
    assert beyond.shape == (4, 2)  # a constant is nothing more
    np.testing.assert_allclose(beyond[:, 0], (E[0] - 0.25) / np.sqrt(0.75))
    np.testing.assert_allclose(beyond[:, 1], np.array([-0.5, 0.5, 0.5, -0.5]))
    known = beyond[:, :1]
    columns = np.stack([E[0] + 9.0, -3.0 * E[0], E[1], np.ones(4)], axis=1)
    assert expressions._like_any(columns[:, :3], ONES, known).tolist() == [True, True, False]
    assert expressions._like_any(columns, ONES, known[:, :0]).tolist() == [False] * 4
    assert expressions._like_any(columns[:, 2:3], ONES, beyond).tolist() == [False]
    # of two columns at an angle, to a correlation of 0.9995
    for angle, same in ((0.0316, True), (0.0317, False)):
        turned = (np.cos(angle) * E[0] + np.sin(angle) * E[1])[:, None]
        assert expressions._like_any(turned, np.zeros((4, 0)), E[:, :1]).tolist() == [same]


def test_a_shorter_formula_does_where_nobody_could_see_the_difference() -> None:
    """By less than 2 of the squares that either may explain."""
    angle = 0.1
    columns = np.stack([E[0], np.cos(angle) * E[0] + np.sin(angle) * E[1], E[2]], axis=1)
    least = 2.0 / np.sin(angle) ** 2
    none = np.zeros((4, 0))
    for misfit, unseen in ((0.99 * least, {0}), (1.01 * least, set())):
        assert expressions._unseen(columns, none, {0: 1}, misfit) == unseen
        assert expressions._unseen(5.0 * columns, none, {0: 1}, misfit) == unseen
    assert expressions._unseen(columns, none, {0: 2, 1: 0}, 10.0) == {1}
    assert expressions._unseen(columns, E[:, 1:2], {0: 1}, 1e9) == {0}
    assert expressions._unseen(columns, none, {}, 1.0) == set()


def _distinct(columns: Array, basis: Array | None = None, taken: Sequence[int] = (), prior: Sequence[float] = (),
    reads: str = "") -> list[int]:  # fmt: skip
    count = columns.shape[1]
    mask = np.isin(np.arange(count), taken)
    priors = np.array(prior or [1.0] * count)
    each = [frozenset(one) for one in (reads or "a" * count)]
    none = np.zeros((len(columns), 0))
    return expressions._distinct(columns, none if basis is None else basis, mask, priors, each)


def test_of_columns_that_are_alike_the_likeliest_is_kept() -> None:
    random = np.random.default_rng(3).standard_normal((60, 6))
    a, b, c = random[:, :3].T
    columns = np.stack([a, b, -2.0 * a, c], axis=1)
    assert _distinct(columns) == [0, 1, 3]
    assert _distinct(columns, prior=[0.1, 0.2, 0.3, 0.05]) == [2, 1, 3]
    assert _distinct(columns, taken=[0]) == [1, 2, 3]
    basis = np.linalg.qr(random[:, :1])[0]
    assert _distinct(np.stack([a, a + 1e-4 * b, a + b, b + 3.0 * a], axis=1), basis) == [2]
    # to a correlation of 0.9999
    unit, across = np.linalg.qr(random[:, :2])[0].T
    for angle, kept in ((0.0141, [0]), (0.0142, [0, 1])):
        assert _distinct(np.stack([unit, np.cos(angle) * unit + np.sin(angle) * across], axis=1)) == kept


def test_columns_of_the_data_that_go_together_keep_a_formula_each() -> None:
    """Three at most, and none of a formula that reads what another one does, or nothing."""
    a = np.random.default_rng(3).standard_normal(60)
    four = np.stack([a, 2.0 * a, -a, 3.0 * a], axis=1)
    assert _distinct(four, reads="abcd") == [0, 1, 2]
    assert _distinct(four, reads="aabc") == [0, 2, 3]
    assert expressions._distinct(
        four, np.zeros((60, 0)), np.zeros(4, dtype=bool), np.ones(4), [frozenset("a"), frozenset(), frozenset("ab"),
        frozenset("c")]) == [0, 3]  # fmt: skip


def test_blocks_of_formulas_are_compared_with_those_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expressions, "BLOCK", 2)
    random = np.random.default_rng(4).standard_normal((40, 5))
    columns = random[:, [0, 1, 2, 0, 3, 2, 1, 4]]
    assert _distinct(columns) == [0, 1, 2, 4, 7]
    assert _distinct(columns, reads="abcdefgh") == list(range(8))


def test_a_scale_is_tried_from_several_starts_inside_its_bounds() -> None:
    def grid(scale: Scale) -> tuple[float, ...]:
        found = expressions._scale_parameter("w", scale)
        assert (found.name, found.unit, found.start) == ("w", "m", scale.start)
        assert (found.minimum, found.maximum) == (scale.low, scale.high)
        return found.grid

    assert grid(Scale(2.0, 0.5, 9.0, "m")) == (1.0, 4.0, 2.0)
    assert grid(Scale(2.0, 1.0, 4.0, "m")) == (1.0, 4.0, 2.0)
    assert grid(Scale(2.0, 1.1, 3.9, "m")) == (2.0,)
    assert grid(Scale(2.0, 0.0, 9.0, "m", (3.0, 2.0, 10.0))) == (3.0, 2.0)


def test_the_unit_of_a_formulas_size_makes_it_sound() -> None:
    def unit(text: str, target: str, own_names: bool = False, **units: str) -> str:
        case: Any = SimpleNamespace(base=SimpleNamespace(own_names=own_names, name="base"), units=units)
        scales = {"w": Scale(1.0, 0.1, 9.0, "m/s")} if "w" in text else {}
        effect = as_effect(_sketch(text, target, scales), case, "found")
        assert (effect.name, effect.expression, effect.target, effect.bases) == ("found", text, target, ("base",))
        assert (effect.parameters[0].name, effect.parameters[0].start) == ("k", 0.0)
        assert [one.name for one in effect.parameters[1:]] == list(scales)
        return effect.parameters[0].unit

    def sound(text: str, target: str, expected: str, own_names: bool = False, **units: str) -> bool:
        return bool(read_unit(unit(text, target, own_names, **units)) == read_unit(expected))

    assert sound("k*omega", "resistance", "N m s/rad")
    assert sound("k*load", "resistance", "m")
    assert sound("k", "drag", "N")
    assert sound("k", "axle", "N")
    assert sound("k*oil", "current", "A/m", oil="m", current="A")
    assert sound("k*oil**2", "y", "1/m^2", oil="m")
    assert sound("k*tanh(oil/w)", "y", "V", oil="m/s", y="V")
    assert sound("k*oil", "y", "1/s", own_names=True, oil="s")
    plain = [
        unit("k*omega", "y", own_names=True),  # a name of its own, whose unit nobody told
        unit("k*foreign", "resistance"), unit("k*oil", "y", oil="blub"), unit("k*oil", "y", oil="m", y="m"),
    ]  # fmt: skip
    assert plain == ["1"] * 4


def _drawn(values: dict[str, Array], terms: dict[str, list[Term]], own: set[str], target: str = "y",
    beside: Sequence[tuple[str, float, bool]] = (("", 1.0, True),), fit: Sequence[str] = ()) -> Any:  # fmt: skip
    case: Any = SimpleNamespace(
        inputs=values, fit=dict.fromkeys(fit), roles={},
        base=SimpleNamespace(own_names=bool(fit), further=(), factors=lambda *_: list(beside)),
    )  # fmt: skip
    found = expressions._Drawn(case, 4, values, terms, own)
    found.add(target, 0.5, lambda shapes_: np.stack([2.0 * shapes_, 0.0 * shapes_], axis=1))
    return found


OIL, ROOM = np.array([1.0, 2.0, 4.0, 8.0]), np.array([20.0, 22.0, 24.0, 20.0])


def test_a_sketch_is_a_shape_times_a_factor_with_its_prior() -> None:
    """Less of a column that the case does not map, and still less where that hardly varies; scaled to rms 1."""
    terms = {"oil": [Term("oil", {}, 1.0), Term("oil**2", {}, 0.35)], "room": [Term("room", {}, 1.0)],
        "mine": [Term("mine", {}, 1.0)], "": [Term("", {}, 1.0)]}  # fmt: skip
    values = {"oil": OIL, "room": ROOM, "mine": OIL}
    beside = [("", 1.0, True), ("mine", 0.5, False)]
    found = _drawn(values, terms, {"mine"}, beside=beside)
    told = {(one.text, one.column): one.prior for one in found.sketches}
    assert told == {
        ("k*oil", "oil"): 0.25, ("k*oil*mine", "oil"): 0.125, ("k*oil**2", "oil"): 0.25 * 0.35,
        ("k*oil**2*mine", "oil"): 0.125 * 0.35, ("k*room", "room"): 0.025, ("k*room*mine", "room"): 0.0125,
        ("k*mine", "mine"): 0.5, ("k*mine**2", "mine"): 0.25, ("k", ""): 0.5, ("k*mine", ""): 0.25,
    }  # fmt: skip
    assert {one.target for one in found.sketches} == {"y"}
    first = found.columns[0].reshape(2, 4)
    np.testing.assert_allclose(first[0], OIL / np.sqrt(np.mean(OIL**2)))
    assert not first[1].any()
    assert found.scales[0] == pytest.approx(1.0 / (2.0 * np.sqrt(np.mean(OIL**2))))
    idle = {found.sketches[i].text: set(keys) & found.places.keys() for i, keys in found.shorter.items()}
    assert idle == {"k*room": {("y", "", 0, "")}, "k*room*mine": {("y", "", 0, "mine"), ("y", "mine", 0, "")}}


def test_a_step_stands_beside_a_direction_alone_and_what_has_no_size_is_none() -> None:
    step = Term("(oil > w)", {"w": Scale(3.0, 1.0, 8.0)}, 0.1, plain=False)
    beside = [("", 1.0, True), ("mine", 0.5, False), ("sign(mine)", 0.5, True)]
    found = _drawn({"oil": OIL, "mine": OIL}, {"oil": [step, Term("0*oil", {}, 1.0)]}, set(), beside=beside)
    assert [one.text for one in found.sketches] == ["k*(oil > w)", "k*(oil > w)*sign(mine)"]
    assert dict(found.sketches[0].scales) == dict(step.scales)


def test_how_a_parameter_goes_with_a_column_is_simple() -> None:
    """Its own constant keeps its meaning: about the middle of the column, and without a scale."""
    terms = {"oil": [Term("oil", {}, 1.0), Term("(oil - 4)", {}, 1.0, centred=True),
        Term("tanh(oil/w)", {"w": Scale(1.0, 0.1, 9.0)}, 0.1), Term("oil**2", {}, 0.3)]}  # fmt: skip
    parameter = _drawn({"oil": OIL}, terms, {"oil"}, target="c", fit=["c"])
    assert [one.text for one in parameter.sketches] == ["k*(oil - 4)", "k*oil**2"]
    channel = _drawn({"oil": OIL}, terms, {"oil"}, target="y", fit=["c"])
    assert [one.text for one in channel.sketches] == ["k*oil", "k*tanh(oil/w)", "k*oil**2"]
    assert parameter.size == channel.size == "k"
    assert _drawn({"k": OIL}, {"k": [Term("k", {}, 1.0)]}, {"k"}).sketches[0].size != "k"


def test_what_is_kept_is_new_and_its_priors_sum_to_one() -> None:
    oil = [Term("oil", {}, 1.0), Term("oil**2", {}, 0.5), Term("2*oil", {}, 0.1)]
    terms = {"oil": oil, "room": [Term("room", {}, 1.0)], "": [Term("", {}, 1.0)]}
    found = _drawn({"oil": OIL, "room": ROOM}, terms, {"oil", "room"})
    none = np.zeros((8, 0))

    def kept(basis: Array = none, known: Array = none, zeros: Array = none, misfit: float = np.inf) -> list[str]:
        listed = found.kept(basis, known, zeros, misfit)
        if listed.sketches:
            assert sum(one.prior for one in listed.sketches) == pytest.approx(1.0)
        assert listed.columns.shape == (8, len(listed.sketches))
        assert len(listed.scales) == len(listed.sketches)
        return [one.text for one in listed.sketches]

    def column(values: Array) -> Array:
        return np.concatenate([values, 0.0 * values])[:, None]

    assert kept() == ["k*oil", "k*room", "k", "k*oil**2"]
    assert kept(misfit=10.0) == ["k*oil", "k", "k*oil**2"]  # nobody could see that it is the room
    assert kept(known=column(OIL)) == ["k*room", "k", "k*oil**2"]
    assert kept(basis=column(OIL / np.linalg.norm(OIL))) == ["k*room", "k", "k*oil**2"]
    # a wrong zero point does what a constant does, which is listed all the same; not what reads a column
    assert kept(zeros=column(np.ones(4))) == ["k*oil", "k*room", "k", "k*oil**2"]
    assert kept(zeros=column(ROOM)) == ["k*oil", "k", "k*oil**2"]
    empty = _drawn({"oil": OIL}, {"oil": [Term("0*oil", {}, 1.0)]}, set()).kept(none, none, none, 1.0)
    assert (empty.sketches, empty.columns.shape, empty.scales.shape) == ((), (8, 0), (0,))


def test_columns_are_read_that_vary_those_of_the_model_first() -> None:
    """Of equations over time the states along the motion, and no clock; 24 at most."""
    inputs = {"time": np.arange(5.0), "steady": np.full(5, 3.0), "room": np.arange(5.0), "omega": np.arange(5.0) ** 2}
    case = SimpleNamespace(inputs=inputs, roles={"omega": None}, dynamics=None)
    rows = np.arange(5) > 0
    model: Any = SimpleNamespace(case=case)
    values, own, lowest = expressions.readable(model, np.zeros(1), rows)
    assert (list(values), own, lowest) == (["omega", "time", "room"], {"omega"}, 0.3)
    assert values["omega"].tolist() == [1.0, 4.0, 9.0, 16.0]
    case.dynamics = object()
    motion = {"v": np.arange(4.0), "room": np.arange(4.0) + 7.0}
    model.bind = lambda given, mask: SimpleNamespace(motion=lambda theta: motion)
    values, own, lowest = expressions.readable(model, np.zeros(1), rows)
    assert (list(values), own, lowest) == (["v", "room", "omega"], {"omega", "v", "room"}, 0.1)
    assert values["room"].tolist() == [7.0, 8.0, 9.0, 10.0]
    case.dynamics = None
    case.inputs = {f"c{i}": np.arange(5.0) + i for i in range(30)}
    assert list(expressions.readable(model, np.zeros(1), rows)[0]) == [f"c{i}" for i in range(24)]
    case.inputs = {
        "large": np.array([0.0, 1e9, 1e9, 1e9, 1e9 + 0.9]),
        "seen": np.array([0.0, 1e9, 1e9, 1e9, 1e9 + 1.1]),
    }
    assert list(expressions.readable(model, np.zeros(1), rows)[0]) == ["seen"]


@pytest.mark.parametrize(("unit", "step"), [("rad", 0.1), ("turn", 0.1), ("mm", 0.1)])
def test_a_wave_has_its_rate_and_phase_with_bounds_around_them(unit: str, step: float) -> None:
    """Between the two next independent rates, and half a turn of the phase; it pays for all that it was chosen from."""
    place = 5.0 + step * np.arange(400.0)
    span = float(np.ptp(place))
    rate = 2.0 * np.pi / span * 10.25  # one of those that are looked at: four between two that are independent
    left = np.stack([0.1 * np.cos(7.0 * place), 2.0 + 3.0 * np.sin(rate * place + 0.4)])
    (one,) = waves("x", place, unit, left)
    assert one.prior == pytest.approx(S / (100.0 - 2.0 + 1.0))  # of 400 values a quarter, from 2 waves on
    phase = one.scales["phase"]
    assert phase.start == pytest.approx(0.4, abs=1e-6)
    assert (phase.low, phase.high) == pytest.approx((phase.start - np.pi / 2.0, phase.start + np.pi / 2.0))
    assert (phase.unit, phase.grid) == ("rad", (phase.start,))
    wide = 2.0 * np.pi / span
    if unit == "rad":
        assert one.text == "sin(n*x + phase)"
        found, expected, own = one.scales["n"], (rate, rate - wide, rate + wide), "1"
    else:
        assert one.text == "sin(6.2832*x/p + phase)"
        found, own = one.scales["p"], unit
        expected = 2.0 * np.pi / rate, 2.0 * np.pi / (rate + wide), 2.0 * np.pi / (rate - wide)
    assert (found.start, found.low, found.high) == pytest.approx(expected)
    assert (found.unit, found.grid) == (own, (found.start,))


def test_a_wave_is_looked_for_from_two_over_the_range_to_four_values_each() -> None:
    def found(values: Array, rate: float, unit: str = "m") -> list[Term]:
        return waves("x", values, unit, np.sin(rate * values)[None, :])

    assert found(np.linspace(0.0, 1.0, 8), 9.0) == []  # of eight values two waves at most: a bend
    assert found(np.linspace(0.0, 1.0, 9), 13.0) != []
    assert found(np.linspace(0.0, 1.0, 90), 40.0, "s") == []
    steps = np.linspace(0.0, 1.0, 9001)
    (one,) = found(steps, 2.0 * np.pi * 500.0)  # on a part of the rows
    assert one.scales["p"].start == pytest.approx(1.0 / 500.0, rel=1e-3)
    assert one.prior == pytest.approx(S / (1000.0 - 2.0 + 1.0))
    (slow,) = found(np.linspace(0.0, 1.0, 200), 2.0 * np.pi * 2.0)
    assert slow.scales["p"].start == pytest.approx(0.5)


def test_the_library_of_a_case_is_drawn_for_each_target(monkeypatch: pytest.MonkeyPatch) -> None:
    """That is measured, and of the base's parameters those that are not 0; waves in what is left, of no motion."""
    case = SimpleNamespace(
        units={"oil": "degC"}, inputs={"oil": OIL}, dynamics=None,
        base=SimpleNamespace(own_names=True, parameters=("r", "gone", "free")),
        parameters={"r": 2.0, "gone": 0.0},
    )  # fmt: skip
    model: Any = SimpleNamespace(case=case)
    added: list[Any] = []
    looked: list[Any] = []

    class Drawn:
        def __init__(self, case: Any, rows: int, values: Any, terms: Any, own: Any) -> None:
            self.sketches: list[Any] = []
            looked.append((rows, {name: [term.text for term in listed] for name, listed in terms.items()}))

        def add(self, target: str, prior: float, act: Any) -> None:
            added.append((target, prior, act))
            self.sketches += [None] * many[0]

        def kept(self, *given: Any) -> Any:
            return given

    many = [1]
    patches: dict[str, Any] = {
        "_Drawn": Drawn, "readable": lambda *_: ({"oil": OIL, "omega": OIL}, {"omega"}, 0.3),
        "targets": lambda case: [("y", 1.0), ("gone", 0.5), ("r", 0.25), ("free", 0.1)],
        "acting": lambda model, theta, target, rows, sigma: f"act on {target}",
        "orthonormal": lambda base: f"q of {base}",
        "shapes": lambda name, values, unit, taken, lowest, free: [Term(f"{name} {unit} {lowest} {free}", {}, 1.0)],
        "waves": lambda name, values, unit, left, taken: [Term(f"wave {name} {unit}", {}, 1.0)],
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(expressions, name, does)
    known, rows, none = np.zeros((4, 3)), np.ones(4, dtype=bool), np.zeros(0)

    def drawn(**more: Any) -> Any:
        added.clear()
        looked.clear()
        return expressions.library(model, none, rows, none, known, "base", 7.0, **more)  # type: ignore[arg-type]

    basis, same, zeros, misfit = drawn()
    assert (basis, same is known, zeros.shape, misfit) == ("q of base", True, (4, 0), 7.0)
    assert added == [(t, p, f"act on {t}") for t, p in (("y", 1.0), ("r", 0.25), ("free", 0.1))]
    assert looked == [(4, {"oil": ["oil degC 0.3 True"], "omega": ["omega rad/s 0.3 True"], "": [""]})]
    assert drawn(zeros="zeros")[2] == "zeros"
    drawn(left=np.zeros((1, 4)))
    assert looked[0][1]["oil"] == ["oil degC 0.3 True", "wave oil degC"]
    case.dynamics = object()
    drawn(left=np.zeros((1, 4)))
    assert looked[0][1]["oil"] == ["oil degC 0.3 False"]
    many[0] = 6001  # beyond what is looked at no further target is
    drawn()
    assert [target for target, *_ in added] == ["y"]
    many[0] = 6000
    drawn()
    assert [target for target, *_ in added] == ["y", "r"]
