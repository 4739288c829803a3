"""What of all that was weighed is told, and which formulas are refitted: on sets, masses and errors that are given."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare import comparison, together
from terrapin_tools.workbench.compare.comparison import analyse, free_slopes
from terrapin_tools.workbench.compare.input_noise import input_noise
from terrapin_tools.workbench.discover import decide, discovery, expression_answers, leftover, ranker
from terrapin_tools.workbench.discover.decide import Class, weights
from terrapin_tools.workbench.discover.misfit import explained
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker
from terrapin_tools.workbench.formulas.expressions import FOUND
from terrapin_tools.workbench.formulas.vocabulary import shapes


def _set(*effects: str, kind: str = "catalogue", parameters: int = 1, weight: float = 0.0, left: float = 0.0) -> Any:
    """A set; `left`: the error that its fit leaves."""
    return Hypothesis(effects, kind, weight, SimpleNamespace(theta=np.zeros(parameters), left=left))  # type: ignore[arg-type]


def _ranking(*hypotheses: Hypothesis | None, expressions: dict[str, str] | None = None) -> Any:
    texts = {name: SimpleNamespace(expression=text) for name, text in (expressions or {}).items()}
    return SimpleNamespace(hypotheses=hypotheses, expressions=texts)


def _classes(*sets: tuple[str, float]) -> list[Class]:
    return [Class(((_set(*names.split(), parameters=i), mass),)) for i, (names, mass) in enumerate(sets)]


@pytest.mark.parametrize(
    ("sets", "told"),
    [
        ((("a", 0.7), ("b", 0.2)), "a"),  # most of the mass: alone
        ((("a", 0.69), ("b", 0.21), ("c", 0.1)), "a, b"),  # nine tenths together
        ((("a", 0.6), ("b", 0.2), ("c", 0.15), ("d", 0.05)), "a, b, c"),
        ((("a", 0.3), ("b", 0.2), ("c", 0.1), ("d", 0.1), ("e", 0.1), ("f", 0.2)), "a, b, c, d"),  # four names at most
        ((("a", 0.5), ("a b", 0.2), ("c", 0.3)), "a, c"),  # what is told already, and more
        ((("a b", 0.5), ("a", 0.3), ("c", 0.2)), "a b, a, c"),  # less is a rival
        ((("a", 0.4), ("a", 0.3), ("c", 0.3)), "a, c"),
    ],
)
def test_the_fewest_names_that_have_the_mass_are_told(sets: tuple[tuple[str, float], ...], told: str) -> None:
    mass = sum(share for _, share in sets)
    found = [" ".join(h.effects) for h, _ in decide._told(_ranking(), _classes(*sets), mass)]
    assert ", ".join(found) == told


def test_a_formula_that_acts_as_another_is_no_rival() -> None:
    every = _classes(("expression_1", 0.5), ("expression_2", 0.3), ("c", 0.2))
    ranking = _ranking(expressions={"expression_1": "k*x", "expression_2": "k*x"})
    assert [h.effects[0] for h, _ in decide._told(ranking, every, 1.0)] == ["expression_1", "c"]


@pytest.fixture
def given_errors(monkeypatch: pytest.MonkeyPatch) -> Any:
    """An analysis whose plain fit leaves 1, and each set what stands in it."""
    monkeypatch.setattr(decide, "error", lambda fit, rows, sigma: fit.left)
    monkeypatch.setattr(decide, "absent", lambda fit, effects: "absent" in effects)
    rows = np.ones(3, dtype=bool)
    case = SimpleNamespace(test=rows, train=rows)
    return SimpleNamespace(fit=SimpleNamespace(left=1.0), rows=rows, noise=SimpleNamespace(sigma=1.0), case=case)


def _left(taken: float) -> float:
    return float(np.sqrt(1.0 - taken))


def test_beside_a_curve_a_part_that_takes_nearly_as_much_is_told(
    given_errors: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_curve: list[object] = []
    monkeypatch.setattr(decide, "curved", lambda fit: fit in with_curve)
    top = _set("a", "b", parameters=4, left=_left(0.8))
    small, less, other, formula, gone, same = (
        _set("a", parameters=2, left=_left(0.71)), _set("b", parameters=3, left=_left(0.69)),
        _set("c", parameters=1, left=_left(0.8)), _set("a", kind="expression", parameters=1, left=_left(0.8)),
        _set("a", "absent", parameters=1, left=_left(0.8)), _set("a", parameters=4, left=_left(0.8)),
    )  # fmt: skip
    nothing = Hypothesis((), "nothing", 0.0)
    assert decide._worth(given_errors, _ranking(top, small, less, other, formula, gone, same, nothing), top) is small
    assert decide._worth(given_errors, _ranking(top, less, other, formula, gone, same, nothing), top) is top
    likelier = _set("b", parameters=2, weight=1.0, left=_left(0.75))
    assert decide._worth(given_errors, _ranking(top, small, likelier), top) is likelier
    of_formulas = _set("expression_1", kind="expression", parameters=2, left=_left(0.8))
    texts = {"expression_1": "k*x"}
    assert decide._worth(given_errors, _ranking(of_formulas, other, expressions=texts), of_formulas) is other
    with_curve.append(of_formulas.fit)  # what it takes is taken with the curve
    assert decide._worth(given_errors, _ranking(of_formulas, other, expressions=texts), of_formulas) is of_formulas


def test_what_is_known_is_told_where_it_halves_the_heldout_error(given_errors: Any) -> None:
    half, more, formula, gone = (
        _set("a", parameters=2, left=0.5), _set("b", parameters=1, left=0.51),
        _set("c", kind="expression", parameters=1, left=0.1), _set("absent", parameters=1, left=0.1),
    )  # fmt: skip
    assert decide._halving(given_errors, _ranking(more, formula, gone, half)) is half
    assert decide._halving(given_errors, _ranking(more, formula, gone)) is None
    short = _set("d", parameters=1, left=0.2)
    assert decide._halving(given_errors, _ranking(half, short)) is short


def test_all_that_was_weighed_sums_to_one_likeliest_first() -> None:
    every = [Class(((_set("a"), 0.2),)), Class(((_set("b"), 0.5),), ((_set("b", kind="part"), 0.1),))]
    pairs = [(Hypothesis((), "nothing", 0.0), 0.15), (_set("a"), 0.2), (Hypothesis((), "unknown", 0.0), 5e-7)]
    found = weights(SimpleNamespace(pairs=lambda: pairs), every)  # type: ignore[arg-type]
    assert [one.kind for one in found] == ["set", "set", "nothing", "part", "rest"]
    assert [one.probability for one in found] == pytest.approx([0.5, 0.2, 0.15, 0.1, 0.05], abs=1e-6)
    assert found[0].sets == (("b",),)


def _expressions(monkeypatch: pytest.MonkeyPatch, columns: str, missing: bool = True) -> list[Hypothesis]:
    """Of sketches of these columns, a letter each, likeliest first."""
    sketches = [SimpleNamespace(target="y", text=f"{c}{i}", column=c) for i, c in enumerate(columns)]
    promise = -np.arange(len(sketches), dtype=float)
    listed = SimpleNamespace(sketches=sketches, promise=lambda _: promise)
    monkeypatch.setattr(expression_answers, "library", lambda *_: listed)
    monkeypatch.setattr(expression_answers, "doubts", lambda *_: False)
    ranker: Any = SimpleNamespace(
        base=np.zeros((1, 4, 1)), values=np.zeros((1, 4)), effects={}, model=None, rows=None, sigma=np.ones(1),
        columns_without=lambda names: None, misfit=1.0, kinds=[], evidence=None,
        case=SimpleNamespace(base=SimpleNamespace(whole_runs=False), dynamics=None),
        analysis=SimpleNamespace(fit=SimpleNamespace(theta=None), residual=np.zeros((1, 4)), missing=missing),
        expression=lambda chosen: chosen.text, log_prior=lambda names: 0.0,
        weighed=lambda names, weight: Hypothesis(names, "expression", weight, SimpleNamespace(theta=np.zeros(1))),  # type: ignore[arg-type]
    )  # fmt: skip
    return expression_answers.expressions(ranker)


def test_two_formulas_of_a_column_are_refitted_and_six_altogether(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _expressions(monkeypatch, "aaaabbbccccdddee")
    refitted = [h for h in found if h.fit is not None]
    assert [h.effects[0] for h in refitted] == ["a0", "a1", "b4", "b5", "c7", "c8"]
    grouped = {h.column: h.log_weight for h in found if h.fit is None}
    assert Counter(grouped).keys() == Counter("abcde").keys()
    share = refitted[0].log_weight
    for column, places in {"a": (2, 3), "b": (6,), "c": (9, 10), "d": (11, 12, 13), "e": (14, 15)}.items():
        mass = np.log(sum(np.exp(-float(place)) for place in places))
        assert grouped[column] - share == pytest.approx(mass, abs=1e-9)


def test_where_nothing_is_missing_no_formula_is_refitted(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _expressions(monkeypatch, "aab", missing=False)
    assert [(h.fit, h.column) for h in found] == [(None, "a"), (None, "b")]


def test_each_effect_has_its_own_probability_and_what_is_out_of_the_question_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = {"sure": 0.5, "likely": 0.9, "never": 1e-10, "hardly": 1e-8}
    singles = {name: _set(name) for name in given}

    def candidate(_: object, hypothesis: Hypothesis, *rest: Any) -> Any:
        return SimpleNamespace(effect=SimpleNamespace(name=hypothesis.effects[0]), probability=rest[2], column=rest[3])

    monkeypatch.setattr(discovery, "_candidate", candidate)
    monkeypatch.setattr(discovery, "calibrated", lambda p: p)
    monkeypatch.setattr(discovery, "sd_of", lambda *_: None)
    monkeypatch.setattr(discovery, "inclusion", lambda _, sets, name: given[name])
    ranking: Any = SimpleNamespace(
        singles=singles, alone={}, columns={"likely": "oil", "never": "load"},
        column_inclusion={"oil": 0.95, "load": 1e-12}.__getitem__, hypotheses=list(singles.values()),
    )  # fmt: skip
    found = discovery._candidates(None, ranking, None, None, (), {"sure": 0.99, "likely": 0.1})  # type: ignore[arg-type]
    told = {one.effect.name: (one.probability, vars(one)["column"]) for one in found}
    assert told == {"sure": (0.99, None), "likely": (0.9, 0.95), "hardly": (1e-8, None), "never": (0.0, 0.0)}
    assert list(told) == ["sure", "likely", "hardly", "never"]


@pytest.mark.parametrize("grow", [False, True])
@pytest.mark.parametrize("grouped", [False, True])
@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("above", [False, True])
def test_where_nothing_is_missing_what_looks_like_a_misfit_takes_of_its_certainty(
    monkeypatch: pytest.MonkeyPatch, grow: bool, grouped: bool, known: bool, above: bool
) -> None:
    """Noise that was found, not stated, to grow with the reading; and far more of it than was stated."""
    monkeypatch.setattr(decide, "far_above_stated", lambda _: above)
    monkeypatch.setattr(decide, "calibrated", lambda p, what: p)
    noise = SimpleNamespace(
        node=SimpleNamespace(grow=grow), groups=object() if grouped else None, known=np.array([known, True])
    )
    ranking: Any = SimpleNamespace(probability=lambda *kinds: 0.99, blind=False)
    found = decide.decide(SimpleNamespace(missing=False, noise=noise), ranking, 0.05)  # type: ignore[arg-type]
    most = min(0.3 if above else 1.0, 0.8 if grow and not grouped and not known else 1.0)
    assert (found.verdict, found.probability) == ("adequate", min(0.99, most))


def test_what_a_column_explains_is_what_differs_between_its_values() -> None:
    two = np.repeat([0.0, 1.0], 10)
    assert explained(3.0 * two, two) == pytest.approx(1.0)
    assert explained(np.tile([-1.0, 1.0], 10), two) == 0.0
    assert explained(two, np.ones(20)) == 0.0  # a column that does not vary
    assert explained(np.ones(20), two) == 0.0
    draw = np.random.default_rng(3)
    slope = np.linspace(-1.0, 1.0, 2000)
    half = explained(slope + draw.normal(0.0, np.sqrt((slope * slope).mean()), 2000), slope)
    assert half == pytest.approx(0.5, abs=0.05)
    assert np.mean([explained(draw.normal(size=60), draw.normal(size=60)) for _ in range(200)]) < 0.05


def test_a_reference_is_looked_for_from_the_lowest_reading_on() -> None:
    found = [term for term in shapes("oil", np.array([20.0, 40.0, 60.0]), "degC") if term.text == "(oil - x0)"]
    assert [term.scales["x0"].start for term in found] == [20.0, 30.0, 40.0, 50.0]
    assert {(term.scales["x0"].low, term.scales["x0"].high) for term in found} == {(-40.0, 120.0)}


@pytest.mark.parametrize(
    ("values", "one_sign"),
    [((0.0, 0.5, 0.8), True), ((-0.8, -0.5, 0.0), True), ((0.1, 3.0, 8.0), True), ((-0.1, 3.0, 8.0), False),
     ((-8.0, -3.0, 0.1), False), ((-8.0, -3.0, 0.9), False)],
)  # fmt: skip
def test_a_column_of_one_sign_has_roots_and_one_of_both_has_sizes(values: tuple[float, ...], one_sign: bool) -> None:
    found = {term.text for term in shapes("oil", np.array(values), "1")}
    assert ("sign(oil)" in found) != one_sign
    assert ("oil*abs(oil)" in found) != one_sign
    magnitude = "oil" if values[0] >= 0.0 else "abs(oil)"
    assert (f"sqrt({magnitude})" in found) == (one_sign or magnitude == "abs(oil)")
    assert ("(oil - x0)" in found) == (values[0] >= 0.0)


@pytest.mark.parametrize(
    ("unit", "free", "low", "sees"),
    [("1", False, 1.0, True), ("", False, 1.0, True), ("degC", False, 1.0, False), ("degC", True, 1.0, True),
     ("1", False, 90.0, False), ("1", False, 0.0, False)],
)  # fmt: skip
def test_a_logarithm_of_a_share_of_the_middle_needs_a_plain_number(
    unit: str, free: bool, low: float, sees: bool
) -> None:
    """Over a wide range above 0: `free` formulas take the numbers as they are."""
    found = shapes("oil", np.array([low, 60.0, 100.0]), unit, free=free)
    assert any(term.centred and term.text.startswith("log(oil/") for term in found) == sees


def _names(whole_runs: bool, taken: tuple[str, ...] = ()) -> Any:
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=whole_runs, own_dynamics=None), library=dict.fromkeys(taken))
    return SimpleNamespace(case=case, sketches={}, effects={}, fits={})


def test_a_formula_has_the_first_name_that_is_free_and_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranker, "as_effect", lambda sketch, case, name: name)
    one, same, other = (SimpleNamespace(target="y", text=text) for text in ("k*x", "k*x", "k*z"))
    of: Any = _names(whole_runs=False)
    assert [Ranker.expression(of, sketch) for sketch in (one, other, same, one)] == [  # type: ignore[arg-type]
        "expression_1", "expression_2", "expression_3", "expression_1",
    ]  # fmt: skip
    of = _names(whole_runs=True, taken=("expression_1",))
    assert [Ranker.expression(of, sketch) for sketch in (one, same, other)] == [  # type: ignore[arg-type]
        "expression_2", "expression_2", "expression_3",
    ]  # fmt: skip


def test_what_a_search_found_is_kept_by_what_it_says() -> None:
    found = SimpleNamespace(name="expression_7", target="y", expression="k*x", source=FOUND)
    known = SimpleNamespace(name="drag", target="y", expression="c*v", source="catalogue")
    fitted = [SimpleNamespace(effect=e, name=n, key=n) for e, n in ((None, "a"), ("drag", "c"), ("expression_7", "k"))]
    model = SimpleNamespace(effects=(known, found), fitted=fitted)
    of = _names(whole_runs=True)
    of.fits = {
        frozenset(): None,
        frozenset(("drag", "expression_7")): SimpleNamespace(model=model, theta=np.arange(3.0)),
    }
    kept = {("", "a"): 0.0, ("drag", "c"): 1.0, ("y: k*x", "k"): 2.0}
    assert Ranker.found(of) == {frozenset(("drag", "y: k*x")): kept}
    of.case.base.whole_runs = False
    assert Ranker.found(of) == {}


@pytest.mark.parametrize(
    ("before", "after", "explains"),
    [(3.0, 1.0, 1.0), (3.0, 2.0, 0.625), (3.0, 3.0, 0.0), (3.0, 4.0, -0.875), (3.0, 9.0, -1.0), (1.0, 0.5, 0.0),
     (0.8, 0.5, 0.0), (2.0, 0.5, 1.0), (3.0, np.inf, -1.0)],
)  # fmt: skip
def test_an_effect_explains_its_share_of_what_is_above_the_noise(
    monkeypatch: pytest.MonkeyPatch, before: float, after: float, explains: float
) -> None:
    rows = np.ones(4, dtype=bool)
    fit: Any = SimpleNamespace(left=after, model=SimpleNamespace(effects=("a", "b"), channels=("f", "g")))
    monkeypatch.setattr(discovery, "error", lambda fit, rows, sigma: fit.left)
    monkeypatch.setattr(discovery, "measured", lambda model, rows: np.full((2, 4), 3.0))
    monkeypatch.setattr(discovery, "predict", lambda fit, rows: np.array([[1.0] * 4, [-1.0] * 4]))
    monkeypatch.setattr(discovery, "_kind", lambda *_: "effect")
    case = SimpleNamespace(test=rows, train=rows)
    analysis: Any = SimpleNamespace(case=case, fit=SimpleNamespace(left=before))
    noise: Any = SimpleNamespace(sigma=np.ones(2))
    found = discovery._candidate(analysis, Hypothesis(("b",), "catalogue", 0.0, fit), noise, np.ones(1), 0.7, 0.8)
    assert found.explains == pytest.approx(explains)
    assert str(found.effect) == "b"
    assert (found.probability, found.column_probability) == (0.7, 0.8)
    assert found.heldout_rmse == {"f": 2.0, "g": 4.0}
    assert found.noise_ratio == (after if np.isfinite(after) else None)


@pytest.mark.parametrize(
    ("longer", "shorter", "train", "known", "pays"),
    [
        (None, 2.0, 2.0, True, True),  # nothing is held out
        (1.0, None, 2.0, True, True),
        (2.0, 2.0, 2.0, True, False),  # the error must fall
        (2.1, 2.0, 2.0, True, False),
        (1.9, 2.0, 2.0, True, True),  # far above the noise any fall does
        (1.0, 1.05, 1.5, True, True),  # on the training rows alone
        (1.0, 1.05, 1.0, True, False),  # within the noise it must be significant: 0.05 of 0.06 that 50 rows ask
        (1.0, 1.06, 1.0, True, True),
        (0.5, 1.05, 1.0, True, False),  # below the noise is luck,
        (0.5, 1.05, 1.0, False, True),  # or a noise that was estimated too large: half of it is left
        (0.96, 1.05, 1.0, False, False),
    ],
)
def test_a_further_formula_pays_by_the_heldout_error(
    monkeypatch: pytest.MonkeyPatch, longer: float | None, shorter: float | None, train: float, known: bool, pays: bool
) -> None:
    held, trained = np.zeros(100, dtype=bool), np.zeros(100, dtype=bool)
    held[:50], trained[50:] = True, True
    case = SimpleNamespace(test=held, train=trained, base=SimpleNamespace(whole_runs=False), dynamics=None)
    monkeypatch.setattr(leftover, "error", lambda fit, rows, _: fit.held if rows is held else fit.train)
    monkeypatch.setattr(leftover, "allowed", lambda count, node: 1.2)
    noise = SimpleNamespace(sigma=np.ones(1), node=SimpleNamespace(share=0.0, rho=0.0), known=np.array([known]))
    analysis: Any = SimpleNamespace(case=case, noise=noise, level=0.05)
    long, short = (SimpleNamespace(held=error, train=train) for error in (longer, shorter))
    assert leftover.pays(analysis, long, short) == pays  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "trouble", "told"),
    [
        (
            np.nan,
            "run r1: the motion has no number",
            "here/case.toml: run r1: the motion has no number (after the fit)",
        ),
        (np.inf, "", "runs.csv:7: the model gives inf for f after the fit, expected a number"),
        (1e150, "unasked", "runs.csv:7: the model gives 1e+150 for f after the fit, expected a number"),
        (1e10, "unasked", ""),
    ],
)
def test_a_model_without_numbers_says_why_or_where(value: float, trouble: str, told: str) -> None:
    rows = np.array([False, True, True])
    bound = SimpleNamespace(trouble=lambda theta: trouble)
    model: Any = SimpleNamespace(bind=lambda inputs, rows: bound, channels=("f",))
    case: Any = SimpleNamespace(folder=Path("here"), inputs={}, place=lambda row: f"runs.csv:{row + 5}")
    given = (case, model, np.array([[1.0, value]]), np.zeros(1), rows, "after the fit")
    if told:
        with pytest.raises(UserError) as refused:
            comparison.require_numbers(*given)
        assert str(refused.value) == told
    else:
        comparison.require_numbers(*given)


@pytest.mark.parametrize("value", [100.0, -0.02, 1.0, 0.0])
def test_a_parameter_is_moved_by_a_share_of_itself(value: float) -> None:
    """By so much of 1 where it is 0, and others follow by their slope at first."""
    bound = SimpleNamespace(predict=lambda theta: np.zeros((1, 3)), jacobian=lambda theta: (np.zeros((1, 3)), None))
    analysis: Any = SimpleNamespace(
        fit=SimpleNamespace(theta=np.array([7.0, value]), bound=bound), noise=SimpleNamespace(sigma=np.ones(1))
    )
    nobody = np.zeros(0, dtype=np.int64)
    found = together._moved(analysis, np.array([1]), 0, nobody, np.zeros(0))
    assert found == pytest.approx([value + together.WAY * (abs(value) or 1.0)])
    assert analysis.fit.theta[1] == value


@pytest.mark.parametrize(
    ("value", "slope", "moved", "amount", "gradient", "near"),
    [
        ([2.0, 3.0], -1.5, [2.2, 6.0 / 2.2], 6.0, [3.0, 2.0], False),  # a product stays
        ([2.0, 3.0], -2.0, [2.2, 2.6], 7.0, [2.0, 1.0], False),  # a sum with a whole share
        ([2.0, 3.0], -2.3, [2.2, 2.54], 7.6, [2.3, 1.0], False),  # and with another
        ([0.0, 3.0], -2.0, [0.1, 2.8], 3.0, [2.0, 1.0], False),  # none of them may be 0 in a product
        ([1.0, 3.0], -3.0, [1.1, 3.0 / 1.1], 3.0, [3.0, 1.0], False),
        ([2.0, 3.0], -2.0, [2.2, 2.0], 7.0, [2.0, 1.0], True),  # near by only
    ],
)
def test_what_stays_of_two_parameters_is_a_product_or_a_sum(
    value: list[float], slope: float, moved: list[float], amount: float, gradient: list[float], near: bool
) -> None:
    pivots, slopes = np.array([0]), np.array([slope])
    found = together._combination(["a", "b"], np.array(value), [np.array(moved)], 1, pivots, slopes)
    assert found[1] == pytest.approx(amount)
    assert found[2] == pytest.approx(gradient)
    assert found[3] == near


def test_noise_of_an_input_is_that_of_what_no_parameter_takes(tmp_path: Path) -> None:
    """A brake whose load is read with noise, and steady in each run: its noise shows in what is left, however far the
    parameter lies beside its optimum."""
    random = np.random.default_rng(3)
    load = np.repeat(random.uniform(20.0, 60.0, 12), 20)
    torque = 0.02 * load + 0.002 * random.standard_normal(load.size)
    read = load + 0.5 * random.standard_normal(load.size)
    lines = [f"{row // 20},{one:.9g},{two:.9g}" for row, (one, two) in enumerate(zip(read, torque, strict=True))]
    (tmp_path / "runs.csv").write_text("\n".join(["run,load,torque", *lines]) + "\n")
    (tmp_path / "case.toml").write_text(
        '[model]\nbase = "equation"\n[model.equation]\ntorque = "a*load"\n[fit]\na = { value = 0.01 }\n'
        '[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\n'
        'load = { column = "load", unit = "N" }\ntorque = { column = "torque", unit = "N m", sigma = 0.002 }\n'
    )
    found = analyse(load_case(tmp_path))
    rows, sigma = found.rows, found.noise.sigma
    _, residual, slopes = free_slopes(found.fit, sigma, rows)
    beside = residual + 1e4 * sigma * slopes[..., 0] / np.sqrt(np.mean(slopes[..., 0] ** 2))
    for left in (residual, beside):
        columns = input_noise(found.fit, rows, left, slopes, sigma, found.noise.node, ~found.noise.known)
        assert columns.shape == (1, int(rows.sum()), 1)
