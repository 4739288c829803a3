"""Pieces of an answer, on fits and evidence that are given: what is said of what was weighed, what an answer leaves,
curves without a formula, single hypotheses, and effects that are planted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Parameter
from terrapin_hil.physics.expression import parse
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.compare.adequacy import ROUNDING
from terrapin_tools.workbench.discover import (
    certainty,
    decide,
    discovery,
    leftover,
    misfit,
    planted,
    ranker,
    unexplained,
)
from terrapin_tools.workbench.discover import ranking as ranking_
from terrapin_tools.workbench.discover.decide import Decision
from terrapin_tools.workbench.discover.discovery import Weighed
from terrapin_tools.workbench.discover.leftover import Doubts, Left
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker
from terrapin_tools.workbench.discover.ranking import Blamed, Ranking
from terrapin_tools.workbench.discover.resampled import Selected
from terrapin_tools.workbench.formulas import free_curves
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.model.table_faults import Fault
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, STATED, Evidence

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)
EVERY = np.ones(4, dtype=bool)


def _answer(effects: str, weight: float = 0.0, kind: str = "catalogue", column: str = "", **fit: Any) -> Hypothesis:
    of: Any = SimpleNamespace(theta=np.zeros(1), of=effects, **fit)
    return Hypothesis(tuple(effects.split()), kind, weight, of, column)


@dataclass(frozen=True)
class Ranked:
    """Of a ranking what is read."""

    name: str = "ranking"
    expressions: Any = None
    evidence: Any = None
    curves: Any = None


class Saying:
    """`decided` with all that it asks replaced; `asked` is what each was given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *said: Decision, doubted: Doubts | None = None) -> None:
        self.asked: dict[str, list[Any]] = {}
        self.said = list(said)
        self.analysis: Any = SimpleNamespace(
            name="analysis",
            told=SimpleNamespace(sigma="sigma as told"), noise=SimpleNamespace(sigma="sigma"), case="case",
            fit=SimpleNamespace(of="present"),
        )  # fmt: skip
        self.ranking: Any = Ranked(expressions={"e": SimpleNamespace(expression="k*x")})
        whole: Any = SimpleNamespace(
            name="whole",
            told=SimpleNamespace(sigma=""),
            noise=SimpleNamespace(sigma=""),
            case="",
            fit=None,
        )
        self.whole: tuple[Any, Any] = (whole, Ranked("whole", {}))
        told: dict[str, Any] = {
            "decide": lambda *given: self.said.pop(0), "doubts": lambda analysis, fit: doubted or Doubts(),
            "propose": lambda *_: "experiment", "noise_left": lambda *_: ("node", 1.0),
            "noise_around": lambda *_, again: SimpleNamespace(sigma="sigma around"),
            "_with_each_alone": lambda analysis, ranking, told: ranking, "_candidates": lambda *_: ("candidates",),
            "aliases": lambda *_: ("aliases",), "_where": lambda *_: ("where",), "_ladder": lambda *_: ("rung", "last"),
            "part_of": lambda *_: "part", "front": lambda *_: ("front",),
            "_ahead": lambda case, ranking, said, *_: said,
            "_whole": lambda *_: {"whole": 1.0}, "_called": lambda _: {"called": 1}, "weights": lambda *_: ("weights",),
            "classes": lambda *_: ("classes",), "_curve": lambda *_: "curve", "_operating": lambda *_: ("operating",),
            "selection": lambda *_: (Selected(("a",), "catalogue", 1.0),),
        }  # fmt: skip
        for name, does in told.items():
            monkeypatch.setattr(discovery, name, self._noted(name, does))

    def _noted(self, name: str, does: Any) -> Any:
        def call(*given: Any, **more: Any) -> Any:
            self.asked.setdefault(name, []).append(given)
            return does(*given, **more)

        return call

    def __call__(self, bootstrap: int = 0, left_out: bool = False) -> Any:
        whole = self.whole if left_out else (self.analysis, self.ranking)
        return discovery.decided(Weighed(self.analysis, self.ranking, whole), 7, 0.05, bootstrap=bootstrap)


def test_one_answer_is_said_with_its_noise_and_its_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    top = _answer("a b")
    said = Saying(monkeypatch, Decision("missing", 0.9, (top,), classes=("every",)))  # type: ignore[arg-type]
    found = said()
    assert (found.verdict, found.missing, found.answer_probability) == ("missing", ("a", "b"), 0.9)
    assert (found.rivals, found.experiment, found.part, found.selected) == ((), None, None, ())
    assert found.around.sigma == "sigma around"
    assert (found.best, found.ladder, found.where) == ("last", ("rung", "last"), ("where",))
    assert not {"propose", "part_of", "selection", "classes"} & said.asked.keys()
    assert said.asked["doubts"] == [(said.analysis, top.fit)]
    assert said.asked["noise_around"][0][1] is top.fit
    assert [given[1] for given in said.asked["_ladder"]] == [top, top]
    assert said.asked["_candidates"][0][2:] == (found.around, top.fit, ("every",), {})
    assert said.asked["_where"][0][2:] == (top, "")
    assert said.asked["_curve"][0][3] is top.fit
    assert said.asked["_operating"][0][1] is top
    assert said.asked["weights"][0][1] == ("every",)
    assert said.asked["_whole"][0] == (("every",), Decision("missing", 0.9, (top,), classes=("every",)), 0.9)  # type: ignore[arg-type]
    assert said.asked["_called"] == [(("every",),)]
    assert said.asked["front"][0][3:] == ({"called": 1}, {"whole": 1.0})
    assert said.asked["_with_each_alone"][0][2] == [("a", "b")]
    assert Saying(monkeypatch, Decision("missing", 0.9, (top,)))(bootstrap=30).selected[0].frequency == 1.0


def test_rivals_are_said_with_what_tells_them_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    top, other, unfitted = _answer("a"), _answer("e"), replace(_answer("c"), fit=None)
    said = Saying(monkeypatch, Decision("ambiguous", 0.6, (top, other, unfitted)))
    found = said(bootstrap=9)
    assert (found.verdict, found.missing, found.experiment) == ("ambiguous", ("a",), "experiment")
    assert found.rivals == (("a",), ("e",), ("c",))
    [(_, apart, node, formulas)] = said.asked["propose"]
    assert (apart, node, formulas) == ([(("a",), top.fit), (("e",), other.fit)], "node", {"e": "k*x"})
    assert said.asked["noise_left"] == [(said.analysis, top.fit)]
    assert said.asked["selection"][0][2:] == (9, 7)
    assert said.asked["weights"][0][1] == ("classes",)


def test_an_answer_in_doubt_is_at_most_likely(monkeypatch: pytest.MonkeyPatch) -> None:
    top, doubts = _answer("a"), Doubts(("k",))
    for given, probability in ((0.9, 0.8), (0.7, 0.7)):
        found = Saying(monkeypatch, Decision("missing", given, (top,)), doubted=doubts)()
        assert (found.answer_probability, found.doubts) == (probability, doubts)


def test_a_part_is_said_with_what_it_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    top = _answer("a b")
    said = Saying(monkeypatch, Decision("partial", 0.7, (top,), "load"))
    found = said()
    assert (found.part, found.missing) == ("part", ("a", "b"))
    assert said.asked["part_of"][0] == (said.analysis, top.fit, "load", "sigma around")
    assert said.asked["_candidates"][0][5] == {"a": 0.7, "b": 0.7}
    assert said.asked["_where"][0][3] == ""


def test_where_nothing_is_named_the_present_fit_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    said = Saying(monkeypatch, Decision("unexplained", 0.7, (), "load"))
    found = said()
    assert (found.missing, found.best, found.around, found.part) == ((), None, None, None)
    assert said.asked["doubts"] == [(said.analysis, said.analysis.fit)]
    assert [given[1:] for given in said.asked["_ladder"]] == [(None, said.analysis.told)]
    assert said.asked["_where"][0][2:] == (None, "load")
    assert said.asked["_curve"][0][3] is None
    assert said.asked["_operating"][0][1] is None
    assert "noise_around" not in said.asked


def test_rows_that_were_left_out_beside_no_answer_are_looked_at_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """They may be what is not understood; not where something went wrong on the rig, or an answer is found."""
    top = _answer("a")
    first, second = Decision("unexplained", 0.7), Decision("partial", 0.6, (top,))
    for verdict in ("unexplained", "partial"):
        said = Saying(monkeypatch, replace(first, verdict=verdict), second)
        found = said(left_out=True)
        assert (found.analysis, found.ranking) == said.whole
        assert (found.verdict, found.answer_probability) == ("partial", 0.6)
        assert [given[:2] for given in said.asked["decide"]] == [(said.analysis, said.ranking), said.whole]
    said = Saying(monkeypatch, first, Decision("missing", 0.9, (top,)))
    found = said(left_out=True)
    assert (found.analysis, found.verdict) == (said.analysis, "unexplained")
    for one in (replace(first, blamed=Blamed("run", ("seven",))), Decision("missing", 0.9, (top,))):
        found = Saying(monkeypatch, one)(left_out=True)
        assert found.verdict == one.verdict
    assert Saying(monkeypatch, first)().verdict == "unexplained"


def test_what_these_runs_could_show_is_told_of_a_catalogued_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def operating(ranking: Any, name: str, size: float, node: Any, rivals: Any, seed: int) -> Any:
        asked.append((name, size, node, rivals, seed))
        return None if size == 1.0 else (name, size)

    monkeypatch.setattr(discovery, "operating_characteristic", operating)
    monkeypatch.setattr(discovery, "_size", lambda analysis, fit, name: 2.5)
    analysis: Any = SimpleNamespace(noise=SimpleNamespace(node="node"))
    ranked: Any = None
    top, rivals = _answer("a b"), [_answer("a b"), _answer("c"), _answer("d")]
    found: Any = discovery._operating(ranked, top, rivals, analysis, 3)
    assert found == (("a", 2.5),)
    assert asked == [("a", size, "node", {"c": "a", "d": "a"}, 3) for size in (2.5, 1.0)]
    for none in (None, _answer("a", kind="mixed"), replace(top, fit=None), _answer("a table.load.scale")):
        assert discovery._operating(ranked, none, rivals, analysis, 3) == ()


def test_the_curve_is_told_around_what_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "around", lambda analysis, answer, nodes: ("around", answer, nodes))
    monkeypatch.setattr(discovery, "curve", lambda analysis, evidence, column: (evidence, column))
    evidence = SimpleNamespace(nodes="nodes")
    analysis: Any = None
    ranked: Any = Ranked(evidence=evidence, curves={"x": "along the motion"})
    answer: Any = "answer"
    of = Decision("partial", 0.5, column="load")
    alone: Any = discovery._curve(analysis, ranked, of, None)
    assert alone == (evidence, "load")
    named: Any = discovery._curve(analysis, ranked, of, answer)
    assert named == (("around", "answer", "nodes"), "load")
    assert discovery._curve(analysis, ranked, replace(of, column=""), answer) is None
    moving: Any = discovery._curve(analysis, ranked, replace(of, column="x"), answer)
    assert moving == "along the motion"
    none: Any = Ranked(curves={})
    assert discovery._curve(analysis, none, of, answer) is None


def test_the_ladder_ends_with_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {"first": 3.0, "second": 2.0, "a b": 1.0}
    monkeypatch.setattr(discovery, "error", lambda fit, rows, sigma: errors[fit.of] + (0.5 if rows == "test" else 0.0))
    steps = [SimpleNamespace(added=None, fit=SimpleNamespace(of="first")),
        SimpleNamespace(added="x", fit=SimpleNamespace(of="second"))]  # fmt: skip
    analysis: Any = SimpleNamespace(ladder=steps, case=SimpleNamespace(train="train", test="test"))
    noise: Any = SimpleNamespace(sigma=1.0)

    monkeypatch.setattr(discovery, "curved", lambda fit: False)

    def told(top: Hypothesis | None) -> list[Any]:
        return [(one.added, one.train_error, one.heldout_error) for one in discovery._ladder(analysis, top, noise)]

    assert told(None) == told(replace(_answer("a b"), fit=None)) == [(None, 3.0, 3.5), ("x", 2.0, 2.5)]
    assert told(_answer("a b"))[2:] == [("a+b", 1.0, 1.5)]
    monkeypatch.setattr(discovery, "curved", lambda fit: True)
    assert told(_answer("a b", kind="part", column="x"))[2:] == [("a+b+a curve in x", 1.0, 1.5)]


def test_a_formula_that_is_told_is_fitted_alone_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "measured", lambda model, rows: "measured")
    monkeypatch.setattr(discovery, "extend", lambda fit, name, bound, values, sigma: (fit, name, bound, values, sigma))
    model = SimpleNamespace(having=lambda effect: SimpleNamespace(bind=lambda inputs, rows: f"{effect} bound"))
    case = SimpleNamespace(inputs=None, train="train")
    analysis: Any = SimpleNamespace(case=case, noise=SimpleNamespace(sigma=1.0), fit="fit", model=model)
    known = _answer("e1")
    ranking = Ranking((), np.zeros(0), {}, {"e1": known}, {"e1": "k*x", "e2": "k*y", "e3": "k*z"}, {"e2": "y"})  # type: ignore[dict-item]
    found = discovery._with_each_alone(analysis, ranking, [("a", "e2"), ("e2", "e1")]).alone
    assert found.keys() == {"e1", "e2"}
    assert found["e1"] is known
    one = found["e2"]
    assert (one.effects, one.kind, one.column, one.log_weight) == (("e2",), "expression", "y", -np.inf)
    fit: Any = one.fit
    assert fit == ("fit", "e2", "k*y bound", "measured", 1.0)


# ---- what an answer leaves


def test_a_lag_is_allowed_for_where_it_is_twenty_times_as_likely_as_none() -> None:
    def lags(*logs: float) -> bool:
        evidence: Any = SimpleNamespace(single=lambda columns: np.array(logs)[columns[0].astype(int)], nothing=-5.0)
        late = [np.arange(2.0)[None, :], np.full((1, 1), 2.0)]
        return leftover._lags(evidence, late)

    assert lags(-9.0, -9.0, -5.0 + np.log(20.1))
    assert lags(-9.0, -5.0 + np.log(20.1), -9.0)
    assert not lags(-9.0, -5.0 + np.log(19.9), -9.0)


def _restless(left: float, quiet: float, known: bool = False, dynamics: Any = True) -> dict[str, float]:
    """Of a channel whose rows scatter by `quiet` in what is measured, of which `left` is left."""
    fit: Any = SimpleNamespace(
        model=SimpleNamespace(fitted=[], effects=(), channels=("f", "g")), at_bound=(), jacobian=np.zeros((2, 4, 0)),
        residual=np.zeros((2, 4)),
    )  # fmt: skip
    case = SimpleNamespace(dynamics=dynamics if dynamics is True else None, run=None, channels={"f": 0.0, "g": quiet})
    analysis: Any = SimpleNamespace(case=case, noise=SimpleNamespace(known=np.array([False, known])))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(leftover, "row_scatter", lambda values, run: values)
        patch.setattr(leftover, "_left_of", lambda *_: np.array([[9.0] * 4, [left, -left, left, -left]]))
        return dict(leftover.doubts(analysis, fit).restless)


def test_over_time_what_is_left_is_hardly_more_than_rows_scatter() -> None:
    """Of equations of the user's own, and a channel whose noise is not stated; nothing where no row tells."""
    assert _restless(4.2, 2.0) == {"g": pytest.approx(2.1)}
    assert _restless(3.9, 2.0) == {}
    assert _restless(4.2, 2.0, known=True) == {}
    assert _restless(4.2, 2.0, dynamics=None) == {}
    assert _restless(4.2, 0.0) == {}


def test_an_answer_clearly_leaves_something_below_a_fiftieth_of_the_level() -> None:
    assert Left(1.0, 1.0, 0.00099).clearly(0.05)
    assert not Left(1.0, 1.0, 0.00101).clearly(0.05)


class Leaving:
    """What `left` asks of others: p-values, log factor, and whether a lag is likely."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, train: float, held: float | None, squares: float = 1.0,
        factor: float = 0.0, repeated: float = 1.0, lag: bool = False) -> None:  # fmt: skip
        rows = np.arange(6) < 4
        self.bases: list[Array] = []
        self.wrong: list[str] = []

        def bayes(runs: Any, base: Array, blocks: Any) -> Any:
            self.bases.append(base)
            return lambda columns: (np.full(columns.shape[1], factor), None)

        def blocks_of(effects: Any, columns: Any, runs: Any, wrong: Any) -> str:
            self.wrong = [one.kind for one in wrong]
            self.effects = effects
            return "blocks"

        def evidence(runs: Any, scaled: Array, base: Array, behind: float) -> Any:
            self.scaled, self.runs = scaled, runs
            return base

        patches: dict[str, Any] = {
            "error": lambda fit, mask, sigma: train if mask[0] else held, "BayesFactor": bayes, "blocks_of": blocks_of,
            "free_slopes": lambda *_: (np.ones((2, 6)), np.full((2, 6), 3.0), np.full((2, 6, 1), 8.0)),
            "Evidence": evidence, "_lags": lambda around, late: lag, "_repeated": lambda *_: repeated,
            "_squares": lambda around, behind: self.squares(around, behind), "suspected": lambda model: [],
            "shapes_of_each": lambda *_: {"drag": "shape"}, "terms_of": lambda *_: {"term": ("one",)},
            "column_shapes": lambda *_: None,
        }  # fmt: skip
        for name, does in patches.items():
            monkeypatch.setattr(leftover, name, does)
        self.p_value, self.behind = squares, 0.0
        case = SimpleNamespace(train=rows, test=~rows, run=np.arange(6) // 3)
        noise = SimpleNamespace(
            sigma=np.array([1.0, 2.0]), known=np.array([True, False]), behind=4.0, freedom=np.array([9.0, 5.0])
        )
        columns = {"run": np.ones((12, 5)), "lag": np.ones((12, 2))}
        mishaps = [SimpleNamespace(kind=kind, columns=own) for kind, own in columns.items()]
        self.analysis: Any = SimpleNamespace(case=case, rows=np.ones(6, dtype=bool), noise=noise, felt=None,
            nuisance=np.ones((2, 6, 3)), mishaps=mishaps)  # fmt: skip

    def squares(self, base: Array, behind: float) -> float:
        self.bases.append(base)
        self.behind = behind
        return self.p_value

    def __call__(self) -> Left:
        fit: Any = SimpleNamespace(model=None, theta=None)
        return leftover.left(self.analysis, fit)


def test_what_an_answer_leaves_is_tested_in_three_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    """By squares, by what else could be missing, by settings that are repeated: the least p-value counts."""
    for given, p_value in (({"squares": 0.2}, 0.2), ({"factor": 3.0}, np.exp(-3.0)), ({"factor": -3.0}, 1.0),
        ({"repeated": 0.1}, 0.1), ({"repeated": 0.1, "squares": 0.01}, 0.01)):  # fmt: skip
        more: dict[str, Any] = given
        leaving = Leaving(monkeypatch, 2.0, 1.5, **more)
        found = leaving()
        assert (found.train_error, found.heldout_error) == (2.0, 1.5)
        assert found.p_value == pytest.approx(p_value)
        np.testing.assert_allclose(leaving.scaled, [[3.0] * 6, [1.5] * 6])
        assert leaving.behind == 5.0
        assert leaving.wrong == ["run"]  # a sensor that lags is no reason to doubt
        assert leaving.effects == {"drag": "shape", "term": ["one"]}
        assert {base.shape for base in leaving.bases} == {(2, 6, 4)}
        np.testing.assert_allclose(leaving.bases[0][:, 0], [[8.0, 1.0, 1.0, 1.0], [4.0, 1.0, 1.0, 1.0]])
    lagging = Leaving(monkeypatch, 2.0, 1.5, lag=True)
    lagging()
    assert {base.shape for base in lagging.bases} == {(2, 6, 6)}


def test_an_answer_at_the_floor_needs_no_test(monkeypatch: pytest.MonkeyPatch) -> None:
    floor = float(np.sqrt(1.25))
    for train, held, tested in ((floor, floor, False), (floor, None, False), (1.0, 1.2, True), (1.2, 1.0, True),
        (1.2, None, True)):  # fmt: skip
        found = Leaving(monkeypatch, train, held, squares=0.3)()
        assert found == Left(train, held, 0.3 if tested else 1.0)


def test_a_sum_of_squares_is_judged_in_each_kind_of_noise() -> None:
    """By its F distribution, of an estimated sd with as many degrees of freedom as it has."""
    evidence: Any = SimpleNamespace(posterior=np.array([0.25, 0.75]), freedom=20.0, total=np.array([20.0, 40.0]))
    for behind, freedom in ((7.0, 7.0), (np.inf, STATED)):
        expected = 0.25 * f_distribution.sf(1.0, 20.0, freedom) + 0.75 * f_distribution.sf(2.0, 20.0, freedom)
        assert leftover._squares(evidence, behind) == pytest.approx(expected)


# ---- a curve that nobody has a name for


def _columns(roles: dict[str, Array], extra: dict[str, Array] | None = None) -> Any:
    rows = len(next(iter(roles.values())))
    case = SimpleNamespace(roles=roles, extra=extra or {}, units={})
    return SimpleNamespace(case=case, rows=np.ones(rows, dtype=bool))


def _every(roles: dict[str, Array], extra: dict[str, Array] | None = None) -> list[tuple[str, str, str]]:
    found = unexplained._every(_columns(roles, extra))
    return list(dict.fromkeys((type(one).__name__, one.column, one.by) for one in found))


def test_a_curve_is_alone_times_the_direction_or_times_a_role() -> None:
    """Of a column with 18 values at least; a bump of one with fifty; times what varies, at its rms."""
    up = np.linspace(1.0, 9.0, 60)
    both = np.where(np.arange(60) % 2, up, -up)
    few = np.repeat(np.arange(17.0), 4)[:60]
    some = np.resize(np.arange(18.0), 60)
    assert _every({"omega": up}) == [("Waves", "omega", ""), ("Waves", "omega", "omega"), ("Bump", "omega", "")]
    assert _every({"omega": both}) == [*(("Waves", "omega", by) for by in ("", "direction", "omega")),
        ("Bump", "omega", "")]  # fmt: skip
    found = _every({"omega": up, "load": 20.0 + up, "slip": up}, {"q": some, "few": few, "steady": np.ones(60)})
    assert [one for one in found if one[1] == "q"] == [("Waves", "q", by) for by in ("", "omega")]
    assert not [one for one in found if one[1] in ("few", "steady")]
    assert _every({"a": both, "b": both, "c": both, "d": both})[:4] == [
        ("Waves", "a", by) for by in ("", "a", "b", "c")
    ]
    steady = {"omega": up, "load": 100.0 + up}
    assert {by for *_, by in _every(steady)} == {"", "omega"}  # 2.3 of 105 hardly vary
    assert {by for *_, by in _every({"omega": up, "load": 3.0 + up})} == {"", "omega", "load"}
    assert {by for *_, by in _every({"load": 10.0 + up, "omega": up})} == {"", "omega", "load"}
    assert {by for *_, by in _every({"load": 11.0 + up, "omega": up})} == {"", "omega"}
    waves = {one.by: one for one in unexplained._every(_columns({"omega": both})) if one.column == "omega"}
    np.testing.assert_allclose(waves["omega"].factor, both / np.sqrt(np.mean(both**2)))
    np.testing.assert_allclose(waves["direction"].factor, np.sign(both))
    np.testing.assert_allclose(waves["direction"].values, np.abs(both))
    one_way = _every({"omega": both, "load": up}, {"one": np.where(np.arange(60) % 2, 3.0, -3.0)})
    assert not [one for one in one_way if one[1] == "one"]
    many = {f"c{i}": up + i for i in range(30)}
    assert len({column for _, column, _ in _every({"omega": up}, many)}) == 24


def test_each_curve_has_its_share_of_what_is_not_known() -> None:
    """Of a column with curves in two channels and of several kinds the sum; of one column that alone."""
    logs = {
        ("u", "waves"): [1.0, 2.0],
        ("u", "load"): [3.0, 0.0],
        ("v", "waves"): [5.0, 5.0],
        ("u", "bump"): [9.0, 9.0],
    }

    class Waves:
        def __init__(self, column: str, what: str) -> None:
            self.column, self.what = column, what

        def log_evidence(self, evidence: Any) -> list[float]:
            return logs[self.column, self.what]

    class Bump(Waves):
        pass

    listed = [Bump(*key) if key[1] == "bump" else Waves(*key) for key in logs]
    evidence: Any = SimpleNamespace(channels=2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unexplained, "_every", lambda analysis: listed)
        patch.setattr(unexplained, "Bump", Bump)

        def weights(*more: Any, **bumps: Any) -> dict[str, float]:
            none: Any = None
            return unexplained._weights(none, evidence, *more, **bumps)

        each = np.log(0.05 / 8.0)
        assert weights() == {
            "u": pytest.approx(np.log(np.exp([1.0, 2.0, 3.0, 0.0, 9.0, 9.0]).sum()) + each),
            "v": pytest.approx(np.log(2.0) + 5.0 + each),
        }
        assert weights("", bumps=False)["u"] == pytest.approx(np.log(np.exp([1.0, 2.0, 3.0, 0.0]).sum()) + each)
        assert weights("v").keys() == {"v"}


def _beside(one: Hypothesis, weights: dict[str, float], columns: dict[str, str], takes: float) -> list[Any]:
    """A set with curves beside it, whose fit takes that share of the squares."""
    beyond = SimpleNamespace(nothing=-20.0, residual=np.full(4, np.sqrt(1.0 - takes)))
    ranked: Any = SimpleNamespace(evidence=SimpleNamespace(residual=np.ones(4), nodes=None), columns=columns)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unexplained, "around", lambda *_: beyond)
        patch.setattr(unexplained, "_weights", lambda analysis, evidence, column, bumps: weights)
        none: Any = None
        found = unexplained._beside(none, ranked, one)
    return [(h.kind, h.effects, h.column, h.log_weight, h.fit is not None) for h in found]


def test_a_curve_beside_a_set_is_a_part_and_in_a_formulas_column_the_curve_itself() -> None:
    """Unless the formula takes nearly all; a set that weighs more than what it leaves would is not that of its fit."""
    columns = {"e": "load"}
    part = ("part", ("a", "e"), "speed", pytest.approx(-30.0 + 2.0 + 20.0), True)
    mixed = _answer("a e", -30.0)
    assert _beside(mixed, {"speed": 2.0, "load": 3.0}, columns, 0.5) == [part]
    both = _beside(mixed, {"speed": 2.0, "load": 3.0}, columns, 0.91)
    assert both == [part, ("part", ("a", "e"), "load", pytest.approx(-7.0), True)]
    alone = _answer("e", -30.0)
    assert _beside(alone, {"load": 3.0}, columns, 0.89) == [("unknown", (), "load", pytest.approx(-7.0), False)]
    assert _beside(alone, {"load": 3.0}, columns, 0.91)[0][:2] == ("part", ("e",))
    assert _beside(_answer("a", -30.0), {"load": 3.0}, columns, 0.1)[0][:2] == ("part", ("a",))
    assert _beside(replace(alone, log_weight=-19.9), {"load": 3.0}, columns, 0.5) == []
    assert len(_beside(replace(alone, log_weight=-20.0), {"load": 3.0}, columns, 0.5)) == 1


def _curves(hypotheses: Sequence[Hypothesis], missing: bool = True, evidence: Any = "seen",
    beside: Collection[str] = ()) -> tuple[list[Any], list[tuple[str, str]]]:  # fmt: skip
    asked: list[tuple[str, str]] = []

    def near(analysis: Any, ranking: Any, one: Hypothesis, column: str = "") -> list[Hypothesis]:
        asked.append((" ".join(one.effects), column))
        weight = float(len(asked))
        return (
            [replace(one, kind="part", log_weight=weight, column=f"c{len(asked)}")] if one.effects[0] in beside else []
        )

    ranked: Any = SimpleNamespace(hypotheses=tuple(hypotheses), evidence=evidence)
    analysis: Any = SimpleNamespace(
        missing=missing, rows=None,
        noise=SimpleNamespace(sigma=None),
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unexplained, "_beside", near)
        patch.setattr(unexplained, "_weights", lambda *_: {"load": -3.0})
        patch.setattr(unexplained, "absent", lambda fit, effects: "gone" in effects)
        patch.setattr(unexplained, "error", lambda fit, rows, sigma: getattr(fit, "left", 1.0))
        found = unexplained.curves(analysis, ranked)
    return [(h.kind, " ".join(h.effects), h.column) for h in found], asked


def test_curves_are_weighed_alone_and_beside_the_likeliest_sets() -> None:
    """Three of any column; where that finds a curve, up to forty of the likeliest one's column."""
    unknown = ("unknown", "", "load")
    sets = [_answer(f"s{i}") for i in range(50)]
    none = [Hypothesis((), "nothing", 0.0), replace(_answer("x"), fit=None), _answer("gone")]
    found, asked = _curves([*none, *sets])
    assert (found, asked) == ([unknown], [("s0", ""), ("s1", ""), ("s2", "")])
    found, asked = _curves(sets, beside=["s0", "s2", "s7"])
    assert found == [unknown, ("part", "s0", "c1"), ("part", "s2", "c3"), ("part", "s7", "c8")]
    assert asked[3:] == [(f"s{i}", "c3") for i in range(3, 40)]
    assert _curves(sets, missing=False) == ([unknown], [])
    assert _curves(sets, evidence=None) == ([], [])
    assert _curves([_answer("s", left=ROUNDING * 0.9)]) == ([], [])  # computed, not measured
    assert _curves([_answer("s", left=None)])[0] == [unknown]


# ---- single hypotheses


def _weighing(value: float | None, tax: float = 0.5, cost: float = 2.0) -> Any:
    of: Any = SimpleNamespace(
        fit=lambda names: SimpleNamespace(theta=np.zeros(3), of=names), around=lambda fit, names: value,
        lost=lambda names: -0.25 * len(names), faults={"table": SimpleNamespace(cost=cost)},
        sketches={"e": SimpleNamespace(column="load"), "f": SimpleNamespace(column="oil")},
        log_prior=lambda names: -10.0 * len(names),
    )  # fmt: skip
    return of


def test_a_set_weighs_its_evidence_less_what_its_form_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranker, "error_tax", lambda fit, names: 0.125)
    monkeypatch.setattr(ranker, "size_tax", lambda fit, names: 0.5)

    def weighed(names: str, value: float | None = 7.0, otherwise: float = -np.inf) -> Hypothesis:
        return Ranker.weighed(_weighing(value), tuple(names.split()), otherwise)

    one = weighed("a")
    assert (one.log_weight, one.kind, one.column, one.taxed) == (7.0 - 0.25 - 0.125 - 10.0 - 0.5, "catalogue", "", 0.5)
    assert one.parameters == 3
    assert weighed("a table").log_weight == 7.0 - 0.5 - 0.125 - 2.0 - 20.0 - 0.5
    assert weighed("a", None, otherwise=1.0).log_weight == 1.0 - 10.0 - 0.5
    assert weighed("a", None).log_weight == -np.inf
    assert [weighed(names).kind for names in ("e", "e f", "a e", "e a")] == ["expression"] * 2 + ["mixed"] * 2
    assert [weighed(names).column for names in ("f e", "a e")] == ["oil", "load"]


def test_two_forms_of_one_law_are_not_together() -> None:
    effects = {name: SimpleNamespace(laws=laws, target=target) for name, laws, target in
        (("dry", ("friction",), "y"), ("smooth", ("friction", "drag"), "y"), ("other", ("friction",), "z"),
         ("plain", (), "y"), ("drag", ("drag",), "y"))}  # fmt: skip
    of: Any = SimpleNamespace(effects=effects)
    together = [Ranker.together_possible(of, tuple(pair.split())) for pair in
        ("dry smooth", "dry other", "dry plain", "plain plain", "smooth drag", "dry drag", "dry")]  # fmt: skip
    assert together == [False, True, True, True, False, True, True]


def test_a_set_is_linear_around_its_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its log evidence is that of its columns at the size that was fitted, less what is lost at a bound."""
    random = np.random.default_rng(1)
    columns, residual = random.standard_normal((12, 2)), random.standard_normal((1, 12))
    linear = SimpleNamespace(residual=residual, base=np.ones((1, 12, 1)), columns=columns, offset=np.array([0.5, 1.0]),
        bounds=np.array([-1.0]), signs=np.array([1.0, 0.0]), lost=0.75)  # fmt: skip
    asked: list[list[str]] = []

    def linearise(fit: Any, names: list[str], *given: Any) -> Any:
        asked.append(names)
        if "gone" in names:
            raise ValueError("no size")
        return linear

    monkeypatch.setattr(ranker, "linearise", linearise)
    runs = Runs(np.arange(12) // 4, 1)
    of: Any = SimpleNamespace(values=None, rows=None, sigma=None, runs=runs, behind=STATED, nodes=[0, 3],
        _widened=lambda base: base)  # fmt: skip
    fit: Any = SimpleNamespace(
        model=SimpleNamespace(effects=[SimpleNamespace(name=name) for name in ("a", "b", "gone")])
    )
    evidence = Evidence(runs, residual, linear.base, STATED, [0, 3], linear.bounds)
    expected = evidence.blocks(evidence.gram(columns), np.array([[0, 1]]), linear.signs[None, :], linear.offset)
    assert Ranker.around(of, fit, ("b", "a")) == pytest.approx(float(expected[0]) - 0.75)
    assert asked == [["a", "b"]]
    assert Ranker.around(of, fit, ("gone",)) is None
    assert Ranker.sound(of, fit, ("a",))
    assert not Ranker.sound(of, fit, ("gone",))
    linear.columns = np.zeros((12, 0))
    assert Ranker.around(of, fit, ("a",)) == pytest.approx(evidence.nothing - 0.75)


def _beyond(without: str, dynamics: Any = None, lower: float = -9.0) -> tuple[Array, Array]:
    """Residual and free slopes around a fit y = 2 + 3 x + 5 z^2, in noise sd of a half, without an effect."""
    x, z = np.linspace(1.0, 2.0, 6), np.linspace(-1.0, 1.0, 6)
    made: list[Any] = []
    fitted = [SimpleNamespace(effect=None), SimpleNamespace(effect="a"), SimpleNamespace(effect="b")]

    def predict(theta: Array) -> Array:
        return np.asarray((theta[0] + theta[1] * x + theta[2] * z * z)[None, :])

    def jacobian(theta: Array) -> tuple[Array, Array]:
        return predict(theta), np.stack([np.ones(6), x, 2.0 * z * z], axis=-1)[None]

    model: Any = SimpleNamespace(fitted=fitted, lower=np.full(3, lower), upper=np.full(3, 9.0))
    model.bind = lambda inputs, rows: SimpleNamespace(predict=predict, jacobian=jacobian)
    of: Any = SimpleNamespace(
        case=SimpleNamespace(inputs=None, dynamics=dynamics), rows=None, values=np.full((1, 6), 20.0),
        sigma=np.array([0.5]), runs=None, behind=0.0, nodes=None, _widened=lambda slopes: slopes,
    )  # fmt: skip
    fit: Any = SimpleNamespace(model=model, theta=np.array([2.0, 3.0, 5.0]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranker, "Evidence", lambda runs, residual, base, *given: made.append((residual, base, given[-1])))
        patch.setattr(ranker, "bounds", lambda fit: np.array([1.0, -1.0, 0.0]))
        patch.setattr(ranker, "following", lambda fit: np.array([False, True, True]))
        Ranker.beyond(of, fit, [without] if without else [])
    [(residual, base, bounds)] = made
    assert len(bounds) == base.shape[2]
    return 20.0 - 0.5 * residual[0], base[0]


def test_an_effect_that_is_left_out_gives_its_share_back_to_the_residual() -> None:
    """All that can follow stays free but the effect; over time its share is what its slope says."""
    x, z = np.linspace(1.0, 2.0, 6), np.linspace(-1.0, 1.0, 6)
    prediction, base = _beyond("")
    np.testing.assert_allclose(prediction, 2.0 + 3.0 * x + 5.0 * z * z)
    np.testing.assert_allclose(base, np.stack([x, 2.0 * z * z], axis=-1) / 0.5)
    prediction, base = _beyond("b")
    np.testing.assert_allclose(prediction, 2.0 + 3.0 * x)
    np.testing.assert_allclose(base, x[:, None] / 0.5)
    np.testing.assert_allclose(_beyond("b", lower=1.0)[0], 2.0 + 3.0 * x + z * z)  # as near to none as it may be
    prediction, base = _beyond("b", dynamics=object())
    np.testing.assert_allclose(prediction, 2.0 + 3.0 * x + 5.0 * z * z - 2.0 * z * z * 5.0)
    np.testing.assert_allclose(base, np.stack([np.ones(6), x], axis=-1) / 0.5)


class Fitting:
    """`Ranker.fit` with what it asks replaced; `made` is what each fit began with."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, whole_runs: bool = False, dynamics: Any = None,
        at_bound: tuple[str, ...] = (), again: Any = None, together: Any = None) -> None:  # fmt: skip
        self.made: list[Any] = []

        def extend(parent: Any, name: str, bound: Any, train: Any, sigma: Any, starts: Any, aim: float) -> Any:
            self.made.append((parent.of, name, [np.asarray(one).tolist() for one in starts], aim))
            return self._fit([*parent.of, name], at_bound)

        monkeypatch.setattr(ranker, "extend", extend)
        first = self._fit([], at_bound)
        case = SimpleNamespace(inputs=None, train=None, dynamics=dynamics, base=SimpleNamespace(whole_runs=whole_runs))
        own: Any = SimpleNamespace(
            fits={frozenset(): first}, faults={"table": None}, case=case, together=together or {}, train=None,
            sigma=None, effects={name: SimpleNamespace(name=name) for name in ("a", "b", "table")},
            analysis=SimpleNamespace(fit=first),
            model=SimpleNamespace(fitted=[SimpleNamespace(key="k")]), _again=lambda bound, parent, aim: again,
            _as_stated=lambda parent, start: np.array([9.0]),
        )  # fmt: skip
        own.fit = lambda names: Ranker.fit(own, names)
        self.own = own

    def _fit(self, names: list[str], at_bound: tuple[str, ...]) -> Any:
        bound = SimpleNamespace(model=SimpleNamespace(start=np.array([4.0])))
        model = SimpleNamespace(
            effects=[SimpleNamespace(name=name) for name in names], start=np.array([5.0]),
            having=lambda effect: SimpleNamespace(bind=lambda inputs, rows: bound),
        )  # fmt: skip
        return SimpleNamespace(of=names, model=model, theta=np.array([1.0]), cost=10.0 - len(names), at_bound=at_bound)

    def __call__(self, names: str) -> list[Any]:
        self.own.fit(tuple(names.split()))
        return self.made


def test_a_set_is_fitted_once_from_its_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    fitting = Fitting(monkeypatch)
    assert fitting("a b") == [([], "a", [], np.inf), (["a"], "b", [], np.inf)]
    assert len(fitting("b a")) == 2
    assert len(fitting("a")) == 2
    over_time = Fitting(monkeypatch, whole_runs=True)
    assert [aim for *_, aim in over_time("a b")] == [10.0, 9.0]  # what cannot come near is not followed to its end


def test_a_fault_of_the_table_comes_first_and_from_the_stated_values(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Fitting(monkeypatch)("a table")[:2] == [([], "table", [[5.0]], np.inf), (["table"], "a", [], np.inf)]


def test_a_pair_starts_where_its_columns_say(monkeypatch: pytest.MonkeyPatch) -> None:
    together = {("b", "a"): [("b", np.array([2.0])), ("a", np.array([3.0, 4.0]))]}
    assert Fitting(monkeypatch, together=together)("a b")[1][2] == [[1.0, 3.0, 4.0, 2.0]]
    assert Fitting(monkeypatch, together=together)("b a")[1][2] == [[1.0, 2.0, 3.0, 4.0]]


def test_a_parameter_that_was_driven_to_its_bound_starts_as_stated_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """In equations of the user's own, over time."""
    assert Fitting(monkeypatch, dynamics=object(), at_bound=("k",))("a")[0][2] == [[9.0]]
    assert Fitting(monkeypatch, dynamics=object(), at_bound=("other",))("a")[0][2] == []
    assert Fitting(monkeypatch, at_bound=("k",))("a")[0][2] == []
    kept = Fitting(monkeypatch, again=SimpleNamespace(of=["again"]))
    assert kept("a") == []
    assert kept.own.fit(("a",)).of == ["again"]
    own: Any = SimpleNamespace(model=SimpleNamespace(fitted=[0, 0], start=np.array([1.0, 2.0])))
    parent: Any = SimpleNamespace(theta=np.array([7.0, 8.0, 9.0]))
    assert Ranker._as_stated(own, parent, np.array([0.0, 0.0, 0.0, 5.0, 6.0])).tolist() == [1.0, 2.0, 9.0, 5.0, 6.0]


def test_single_effects_and_pairs_are_averaged_over_their_shapes() -> None:
    """Around the present fit, each block on its own columns; what the choice of a shape costs is kept."""
    random = np.random.default_rng(5)
    runs, residual = Runs(np.arange(20) // 5, 1), random.standard_normal((1, 20))
    columns = random.standard_normal((20, 5))
    shapes = [*(Shape("a", (i + 1.0,), columns[:, i : i + 1], 1.0, 0.0, np.inf) for i in range(2)),
        Shape("wave", (0.0,), columns[:, 2:4], 1.0, -np.inf, np.inf),
        Shape("zero", (), columns[:, 4:], 1.0, -np.inf, np.inf)]  # fmt: skip
    evidence = Evidence(runs, residual, np.ones((1, 20, 1)), STATED, [0])
    phase = Parameter("p", "rad", 0.0, -2.0 * np.pi, 2.0 * np.pi)
    effects = {"a": SimpleNamespace(parameters=(Parameter("k", "N", 0.0), Parameter("w", "m", 1.0))),
        "wave": SimpleNamespace(parameters=(Parameter("k", "N", 0.0), phase))}  # fmt: skip
    own: Any = SimpleNamespace(
        flat=shapes, evidence=evidence, columns=columns, suspects={"zero"}, together={}, razor={}, effects=effects,
        together_possible=lambda names: True,
    )  # fmt: skip
    own._start = lambda shape, coefficients: Ranker._start(own, shape, coefficients)
    found = Ranker.screen(own)
    assert found.keys() == {("a",), ("wave",), ("zero",), ("a", "wave")}  # a constant is looked at alone

    def blocks(picks: list[int], signs: list[float]) -> float:
        gram = evidence.gram(columns)
        return float(evidence.blocks(gram, np.array([picks]), np.array([signs]))[0])

    alone = [blocks([0], [1.0]), blocks([1], [1.0])]
    assert found["a",] == pytest.approx(np.logaddexp(alone[0], alone[1]) - np.log(2.0))
    assert found["zero",] == pytest.approx(blocks([4], [0.0]))
    assert found["wave",] == pytest.approx(blocks([2, 3], [0.0, 0.0]))
    both = [blocks([i, 2, 3], [1.0, 0.0, 0.0]) for i in (0, 1)]
    assert found["a", "wave"] == pytest.approx(np.logaddexp(both[0], both[1]) - np.log(2.0))
    assert own.razor[frozenset(["a", "wave"])] == pytest.approx(found["a", "wave"] - max(both))
    assert own.razor[frozenset(["zero"])] == pytest.approx(0.0)
    (name, start), (other, _) = own.together["a", "wave"]
    assert (name, other) == ("a", "wave")
    assert start[1] == (1.0 if both[0] > both[1] else 2.0)  # from the likelier shape
    own.together_possible = lambda names: False
    assert ("a", "wave") not in Ranker.screen(own)
    own.flat = []
    assert Ranker.screen(own) == {}


# ---- what depends on which column, and what these runs could show


def test_columns_are_told_by_the_likeliest_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight of them, by their probability; no curve beside a set, and none over time."""
    shares = {"a": {"u": 1.0}, "b": {"u": 0.5, "v": 1.0}}
    monkeypatch.setattr(misfit, "_shares", lambda analysis, one: shares.get(one.effects[0], {"w": 1.0}))
    analysis: Any = SimpleNamespace(case=SimpleNamespace(base=SimpleNamespace(whole_runs=False)))

    def told(*given: tuple[Hypothesis, float]) -> dict[str, float]:
        ranked: Any = SimpleNamespace(hypotheses=[h for h, _ in given], posterior=[p for _, p in given])
        return misfit.importance(analysis, ranked)

    nothing, unfitted = Hypothesis((), "nothing", 0.0, _answer("a").fit), replace(_answer("c"), fit=None)
    others = [(nothing, 0.3), (unfitted, 0.1), (_answer("c", kind="part"), 0.1)]
    assert told(*others, (_answer("a"), 0.3), (_answer("b"), 0.1)) == {
        "u": pytest.approx(0.75 + 0.125), "v": pytest.approx(0.25)
    }  # fmt: skip
    assert told(*others) == {}
    many = [(_answer("a"), 0.1)] * 8 + [(_answer("c"), 0.1)]
    assert told(*many) == {"u": pytest.approx(1.0)}
    analysis.case.base.whole_runs = True
    assert told((_answer("a"), 1.0)) == {}


def _operated(size: float, effect: str = "a", rivals: dict[str, str] | None = None, upper: float = np.inf,
    seed: int = 1, evidence: bool = True) -> Any:  # fmt: skip
    """Over three effects on forty rows, two of them nearly the same."""
    random = np.random.default_rng(6)
    column = random.standard_normal((40, 3))
    column[:, 1] = column[:, 0] + 0.05 * random.standard_normal(40)
    column /= np.sqrt((column**2).mean(axis=0))
    of = Evidence(Runs(np.arange(40) // 10, 1), random.standard_normal((1, 40)), np.ones((1, 40, 1)), STATED, [0])
    shapes = [Shape(name, (), column[:, i : i + 1], 1.0, -np.inf, upper) for i, name in enumerate(("a", "twin", "b"))]
    ranked: Any = SimpleNamespace(evidence=of if evidence else None, shapes=shapes)
    return certainty.operating_characteristic(ranked, effect, size, NODES[0], rivals or {}, seed)


def test_what_these_runs_could_show_is_drawn() -> None:
    """An effect of three sd is named, unless another one does the same; of none it is chance; any rival counts."""
    sure = _operated(3.0, "b")
    assert (sure.effect, sure.size) == ("b", 3.0)
    assert sure.named > 0.97
    assert 0.35 < _operated(3.0).named < 0.97
    assert _operated(3.0, rivals={"twin": "a"}).named > 0.97
    assert _operated(3.0, rivals={"a": "c", "twin": "c"}).named > 0.97
    assert _operated(3.0, "b", upper=0.0).named > 0.97  # of the sign that it can have
    assert 0.1 < _operated(1e-9, "b").named < 0.7
    assert _operated(0.3, "b").named < _operated(0.6, "b").named < 1.0
    assert _operated(0.3, "b") == _operated(0.3, "b")
    assert _operated(0.3, "b") != _operated(0.3, "b", seed=2)
    assert _operated(0.3, "c") is None
    assert _operated(0.0) is None
    assert _operated(0.3, evidence=False) is None


# ---- effects that are planted


def _planting(monkeypatch: pytest.MonkeyPatch, answers: Sequence[tuple[str, str, str]], size: str = "2",
    scales: Sequence[float] = (1.0, 4.0)) -> tuple[Any, list[Any]]:  # fmt: skip
    """Verdict, what is missing, and rivals of each draw; and what of each table was asked."""
    effect = SimpleNamespace(name="push", parameters=(Parameter("a", "N", 0.0, -99.0, 99.0),))
    asked: list[Any] = []
    listed = list(answers)
    column = np.array([[1.0], [-1.0], [1.0], [1.0]])
    shapes = [Shape("push", (), column, scale, -np.inf, np.inf) for scale in scales]
    analysis = SimpleNamespace(
        model=None, fit=SimpleNamespace(theta=None), rows=None, residual=np.zeros((1, 4)), missing=True,
        noise=SimpleNamespace(sigma=np.array([2.0])),
    )  # fmt: skip

    def discover(table: Any, seed: int, level: float) -> Any:
        verdict, missing, rivals = listed.pop(0)
        asked.append((*table, seed, level))
        return SimpleNamespace(
            verdict=verdict, missing=tuple(missing.split()),
            analysis=SimpleNamespace(missing=verdict != "adequate"),
            rivals=tuple(tuple(one.split()) for one in rivals.split(",") if one),
        )  # fmt: skip

    patches: dict[str, Any] = {
        "candidates": lambda model: [effect], "analyse": lambda case, seed, level: analysis, "discover": discover,
        "shapes_of": lambda *_: list(shapes), "free_slopes": lambda *_: (None, None, np.full((1, 4, 1), 7.0)),
        "_table": lambda case, analysis, effect, shape, value, random: (shape.scale, value),
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(planted, name, does)
    monkeypatch.setattr(
        "terrapin_tools.workbench.discover.planted.Model.of",
        lambda case: SimpleNamespace(case=SimpleNamespace(effects=("drag",))),
    )
    case: Any = SimpleNamespace(title="case", folder="here")
    return planted.plant(case, "push", size, draws=len(answers), seed=5, level=0.01), asked


def test_planted_effects_are_counted_by_what_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    drag, push, nothing = ("missing", "drag", ""), ("missing", "push", ""), ("adequate", "", "")
    answers = [push, nothing, ("ambiguous", "drag", "drag,push"), drag, push, ("missing", "push drag", ""),
        ("partial", "push", ""), drag, ("ambiguous", "drag", "drag,push drag")]  # fmt: skip
    found, asked = _planting(monkeypatch, answers, scales=[1.0])
    assert (found.draws, found.noticed, found.named, found.tied, found.fails) == (9, 8, 2, 1, True)
    assert found.others == (("drag", 3), ("adequate", 1), ("drag + push", 1), ("push and more", 1))
    assert asked == [(1.0, 2.0, 5 + i, 0.01) for i in range(9)]
    assert (found.size, found.unit, found.size_in_sd) == (2.0, "N", 2.0)
    assert found.beyond_in_sd == pytest.approx(2.0 * np.sqrt(0.75))  # less its mean, which the model can hold


def test_a_size_in_sd_is_that_of_the_shape_that_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """None that needs more than thirty times what the loudest does."""
    found, asked = _planting(monkeypatch, [("adequate", "", "")] * 12, "2sd", scales=[1.0, 4.0, 30.0, 30.1])
    assert {scale for scale, *_ in asked} == {1.0, 4.0, 30.0}
    assert all(value == 2.0 * scale for scale, value, *_ in asked)
    assert found.size_in_sd == 2.0
    plain, asked = _planting(monkeypatch, [("adequate", "", "")] * 12, "2", scales=[1.0, 4.0])
    assert {value for _, value, *_ in asked} == {2.0}
    assert {plain.size_in_sd} <= {2.0, 0.5, 1.25}
    with pytest.raises(UserError, match="push changes nothing in here"):
        _planting(monkeypatch, [("adequate", "", "")], scales=[])


def test_an_effect_that_cannot_be_planted_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        planted, "candidates", lambda model: [SimpleNamespace(name="push"), SimpleNamespace(name="pull")]
    )
    model: Any = SimpleNamespace(case=SimpleNamespace(effects=("drag",)))
    assert planted._effect(model, "pull").name == "pull"
    with pytest.raises(UserError, match="drag is in the model already, expected one of push, pull"):
        planted._effect(model, "drag")
    with pytest.raises(UserError, match="found twist, expected an effect that could be added: one of push, pull"):
        planted._effect(model, "twist")


def test_columns_that_an_answers_formulas_read() -> None:
    of: Any = SimpleNamespace(
        sketches={"e": SimpleNamespace(text="k*oil*load"), "f": SimpleNamespace(text="k*room")},
        case=SimpleNamespace(inputs={"oil": 0, "load": 0, "room": 0}),
    )  # fmt: skip
    assert ranking_._columns(of, _answer("a e f")) == {"oil", "load", "room"}
    assert ranking_._columns(of, _answer("a")) == frozenset()


# ---- around an answer


def _around(monkeypatch: pytest.MonkeyPatch, groups: int = 0) -> tuple[Any, Any]:
    """An analysis of two channels on rows 1 to 6, whose fit leaves 2 and 3 of their units."""
    noise = SimpleNamespace(sigma=np.array([0.5, 2.0]), known=np.array([True, False]), behind=4.0, kinds=[0])
    case = SimpleNamespace(run=np.array([9, 0, 0, 0, 1, 1, 1]), rows=7)
    analysis: Any = SimpleNamespace(noise=noise, case=case, rows=np.arange(7) > 0, felt=None,
        nuisance=np.full((2, 6, 2), 9.0), odd=np.zeros(7, dtype=bool))  # fmt: skip
    residual = np.stack([np.full(6, 2.0), np.full(6, 3.0)])
    slopes = np.full((2, 6, 1), 8.0)
    asked: list[bool] = []

    def free_slopes(fit: Any, sigma: Array, rows: Array, released: bool = False) -> Any:
        asked.append(released)
        return np.full((2, 6), 5.0), residual, slopes

    monkeypatch.setattr(leftover, "free_slopes", free_slopes)
    return analysis, asked


def test_what_is_missing_beside_an_answer_is_judged_in_noise_sd(monkeypatch: pytest.MonkeyPatch) -> None:
    analysis, asked = _around(monkeypatch)
    made: list[Any] = []

    def evidence(runs: Any, residual: Array, base: Array, behind: float, nodes: Any, bounds: Array) -> str:
        made.append((runs, residual, base, behind, nodes, bounds))
        return "evidence"

    monkeypatch.setattr(leftover, "Evidence", evidence)
    monkeypatch.setattr(leftover, "bounds", lambda fit: np.array([1.0, 0.0, -1.0]))
    monkeypatch.setattr(leftover, "following", lambda fit: np.array([False, True, True]))
    fit: Any = None
    found: Any = leftover.around(analysis, fit, [3])
    assert found == "evidence"
    [(runs, residual, base, behind, nodes, bounds)] = made
    assert (behind, nodes, asked, runs.runs, bounds.tolist()) == (4.0, [3], [True], 2, [0.0, -1.0])
    np.testing.assert_allclose(residual, [[4.0] * 6, [1.5] * 6])
    np.testing.assert_allclose(base[:, 0], [[16.0, 9.0, 9.0], [4.0, 9.0, 9.0]])


def test_the_sds_of_an_answer_are_in_the_noise_that_it_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True)
    class Noise:
        sigma: Array
        known: Array
        node: Any = None

    rest: float | None = None
    monkeypatch.setattr(leftover, "noise_left", lambda *_: (SimpleNamespace(rest=rest), 3.0))
    monkeypatch.setattr(leftover, "sds", lambda fit, case, sigma, noise: (sigma, noise))
    noise = Noise(np.array([0.5, 2.0]), np.array([True, False]))
    analysis: Any = SimpleNamespace(noise=noise, case=None)
    fit: Any = None
    for one, known in ((None, [True, True]), (0.5, [True, False])):
        rest = one
        found: Any = leftover.sd_of(analysis, fit)
        assert found[0] is noise.sigma
        np.testing.assert_allclose(found[1].sigma, [1.5, 6.0])
        assert found[1].known.tolist() == known


def test_few_rows_that_stand_alone_and_do_not_gather_are_accidents(monkeypatch: pytest.MonkeyPatch) -> None:
    analysis, _ = _around(monkeypatch)
    given: list[Any] = []
    most, together = [2], [False]

    def alone(runs: Any, residual: Any, bases: Any, stated: Any) -> Array:
        given.append((len(runs), [one.tolist() for one in residual], [one.shape for one in bases], stated))
        return np.array([0, 4])

    patches: dict[str, Any] = {
        "standing_alone": alone, "odd_limit": lambda rows: most[0], "numeric_columns": lambda c: {},
        "farthest": lambda residual, rows: None, "gathered": lambda *_: together[0],
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(leftover, name, does)
    fit: Any = None
    assert np.flatnonzero(leftover.stand_alone(analysis, fit)).tolist() == [1, 5]  # of all rows
    [(runs, residual, bases, stated)] = given
    assert (runs, stated) == (2, [0.5, None])
    assert residual == [[2.0] * 6, [3.0] * 6]
    assert [shape[0] for shape in bases] == [6, 6]
    together[0] = True
    assert not leftover.stand_alone(analysis, fit).any()
    together[0] = False
    analysis.odd[6] = True  # with those that were left out before there are three
    assert not leftover.stand_alone(analysis, fit).any()
    most[0] = 3
    assert leftover.stand_alone(analysis, fit).sum() == 2


def test_a_curve_has_the_size_that_its_evidence_says() -> None:
    """Of its prior sizes the one in whose covariance the residual is likeliest; its mean and sd are those of Bayes."""
    random = np.random.default_rng(2)
    u = random.permutation(np.linspace(0.0, 2.0, 60))
    for size in (0.3, 30.0):
        residual = random.standard_normal((1, 60)) + size * np.cos(np.pi * u)
        evidence = Evidence(Runs(np.zeros(60, dtype=int)), residual, np.zeros((1, 60, 0)), STATED, [0])
        case = SimpleNamespace(roles={}, extra={"u": u}, units={})
        analysis: Any = SimpleNamespace(rows=np.ones(60, dtype=bool), case=case, model=SimpleNamespace(channels=("f",)),
            noise=SimpleNamespace(sigma=np.array([2.0])))  # fmt: skip
        found = unexplained.curve(analysis, evidence, "u")
        waves = free_curves.Waves("u", "", u, np.ones(60))
        block, best = waves.block(0, 1), (-np.inf, 0.0)
        for prior in SIZES:
            covariance = np.eye(60) + prior**2 * block @ block.T
            log = -residual[0] @ np.linalg.solve(covariance, residual[0]) - np.linalg.slogdet(covariance)[1]
            best = max(best, (float(log), float(prior)))
        spread = np.linalg.inv(np.eye(9) / best[1] ** 2 + block.T @ block)
        mean = spread @ block.T @ residual[0]
        there = waves.at(np.array(found.x)) - waves.at(u).mean(axis=0)
        left = residual[0] - block @ mean
        row = left @ left / (60.0 - 9.0)
        np.testing.assert_allclose(found.y, 2.0 * there @ mean, atol=1e-9)
        np.testing.assert_allclose(found.sd, 2.0 * np.sqrt(row * np.einsum("ij,jk,ik->i", there, spread, there)))
        assert found.in_sd == pytest.approx(np.linalg.norm(block @ mean) / np.sqrt(60.0))
        assert found.rms == pytest.approx(2.0 * found.in_sd)


def _depends(text: str, monkeypatch: pytest.MonkeyPatch, base: bool = True, size: float = 2.0,
    columns: dict[str, Array] | None = None) -> dict[str, float]:  # fmt: skip
    """Of an effect k times a formula in u and v, beside a constant of the model."""
    random = np.random.default_rng(7)
    values = columns or {"u": random.uniform(1.0, 9.0, 400), "v": random.choice([-1.0, 1.0], 400)}
    formula = parse(text)

    class Bound:
        def __init__(self, inputs: dict[str, Array]) -> None:
            self.inputs = inputs

        def predict(self, theta: Array) -> Array:
            return np.asarray((theta[0] + theta[1] * formula.evaluate(self.inputs) * np.ones(400))[None, :])

        def jacobian(self, theta: Array) -> tuple[Array, Array]:
            return self.predict(theta), np.ones((1, 400, 1 if base else 0))

    effect: Any = SimpleNamespace(name="found", parameters=(SimpleNamespace(name="k"),))
    model: Any = SimpleNamespace(
        effects=[effect], expressions={"found": formula}, bind=lambda inputs, rows: Bound(inputs),
        fitted=[SimpleNamespace(key="a"), SimpleNamespace(key="found.k")],
    )  # fmt: skip
    fit: Any = SimpleNamespace(model=model, theta=np.array([3.0, size]))
    case = SimpleNamespace(inputs=values, roles={})
    monkeypatch.setattr(misfit, "numeric_columns", lambda case: values)
    analysis: Any = SimpleNamespace(case=case, rows=np.ones(400, dtype=bool), noise=SimpleNamespace(sigma=np.ones(1)),
        fit=SimpleNamespace(model=model, theta=fit.theta))  # fmt: skip
    return misfit._shares(analysis, Hypothesis(("found",), "expression", 0.0, fit))


def test_an_answer_depends_on_the_columns_without_which_it_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Held at their median, or at their median size with their sign: a tenth and nine tenths."""
    assert _depends("u", monkeypatch) == {"u": pytest.approx(1.0)}
    sign = _depends("v", monkeypatch)
    assert sign == {"v": pytest.approx(0.1, abs=0.02)}  # of a direction the size does not matter
    both = _depends("u*v", monkeypatch)
    random = np.random.default_rng(7)
    u, v = random.uniform(1.0, 9.0, 400), random.choice([-1.0, 1.0], 400)

    def visible(values: Array) -> Array:
        return np.asarray(values - values.mean())

    power = (visible(u * v) ** 2).sum()
    held = ((visible(u * v) - visible(np.median(u) * v)) ** 2).sum() / power
    assert both["u"] == pytest.approx(held)
    middle = ((visible(u * v) - visible(u * np.median(v))) ** 2).sum() / power
    assert both["v"] == pytest.approx(0.1 * min(1.0, middle), abs=1e-9)
    assert _depends("1/(u - 5)", monkeypatch, columns={"u": np.resize([5.5, 4.6, 5.0, 5.0 + 1e-12], 400) + 1e-3,
        "v": np.ones(400)}).keys() == {"u"}  # fmt: skip
    assert _depends("u", monkeypatch, size=0.0) == {}
    loud = _depends("3", monkeypatch, base=False)
    assert loud == {"u": 0.0, "v": 0.0}
    fault = Fault("t", "", "", "", (), (), (), "0", "u", column="u")
    fit: Any = SimpleNamespace(model=SimpleNamespace(effects=[fault, replace(fault, column="torque")]))
    analysis: Any = SimpleNamespace(case=None)
    monkeypatch.setattr(misfit, "numeric_columns", lambda case: {"u": 0, "v": 0})
    assert misfit._shares(analysis, Hypothesis(("t",), "catalogue", 0.0, fit)) == {"u": 1.0}


def test_a_search_on_hardly_other_rows_starts_where_the_last_one_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless that is none any more: the parent is better."""
    effect = SimpleNamespace(name="drag", source="catalogue", target="y", expression="c*v")
    fitted = [SimpleNamespace(effect=None, key="a", name="a"), SimpleNamespace(effect="drag", key="drag.c", name="c")]
    bound: Any = SimpleNamespace(model=SimpleNamespace(effects=(effect,), fitted=fitted))
    started: list[Any] = []

    def fit_model(bound: Any, train: Any, sigma: Any, starts: Any, aim: float) -> Any:
        started.append((starts[0].tolist(), aim))
        return SimpleNamespace(cost=5.0)

    monkeypatch.setattr(ranker, "fit_model", fit_model)
    before = {frozenset(["drag"]): {("", "a"): 1.0, ("drag", "c"): 2.0}}
    own: Any = SimpleNamespace(before=before, train=None, sigma=None)
    for cost, kept in ((5.0, True), (4.9, False)):
        parent: Any = SimpleNamespace(cost=cost)
        assert (Ranker._again(own, bound, parent, 9.0) is not None) == kept
    assert started == [([1.0, 2.0], 9.0)] * 2
    own.before = {}
    assert Ranker._again(own, bound, parent, 9.0) is None


def test_formulas_are_numbered_as_they_are_told() -> None:
    """In their effects, fits, keys and bounds; names of the library are left alone."""

    @dataclass(frozen=True)
    class Effect:
        name: str

    @dataclass(frozen=True)
    class Fitted:
        key: str
        effect: str | None

    @dataclass(frozen=True)
    class Model:
        effects: tuple[Effect, ...]
        fitted: tuple[Fitted, ...]

    @dataclass(frozen=True)
    class Bound:
        model: Model

    @dataclass(frozen=True)
    class Fit:
        bound: Bound
        at_bound: tuple[str, ...]

        @property
        def model(self) -> Model:
            return self.bound.model

    fitted = (Fitted("a", None), Fitted("expression_7.k", "expression_7"), Fitted("drag.c", "drag"))
    fit: Any = Fit(Bound(Model((Effect("drag"), Effect("expression_7")), fitted)), ("expression_7.w", "a"))
    effects = {name: Effect(name) for name in ("expression_7", "expression_9", "drag")}
    own: Any = SimpleNamespace(sketches={"expression_7": "seven", "expression_9": "nine"}, effects=effects,
        case=SimpleNamespace(library={"expression_1": None}))  # fmt: skip
    given = [
        Hypothesis(("drag", "expression_9"), "mixed", 0.0),
        Hypothesis(("drag", "expression_7"), "mixed", 0.0, fit),
    ]
    found, named, sketches = Ranker.renamed(own, given)
    assert [h.effects for h in found] == [("drag", "expression_2"), ("drag", "expression_3")]
    assert found[0].fit is None
    assert [*sketches, *sketches.values()] == ["expression_2", "expression_3", "nine", "seven"]
    assert {name: one.name for name, one in named.items()} == {
        "expression_2": "expression_2",
        "expression_3": "expression_3",
    }
    new: Any = found[1].fit
    assert [one.name for one in new.model.effects] == ["drag", "expression_3"]
    assert [(one.key, one.effect) for one in new.model.fitted] == [
        ("a", None), ("expression_3.k", "expression_3"), ("drag.c", "drag")
    ]  # fmt: skip
    assert new.at_bound == ("expression_3.w", "a")


# ---- the ranking with curves, and answers that are one


def test_curves_take_the_place_of_those_before(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def curves(analysis: Any, ranking: Any) -> list[Hypothesis]:
        asked.append([h.kind for h in ranking.hypotheses])
        return [Hypothesis((), "unknown", 1.0, column="load"), _answer("a", 3.0, "part", "load")]

    monkeypatch.setattr(decide, "curves", curves)
    before = (_answer("a", 2.0), Hypothesis((), "unknown", 9.0, column="old"), _answer("a", 9.0, "part", "old"),
        Hypothesis((), "nothing", 0.0))  # fmt: skip
    base = SimpleNamespace(whole_runs=False)
    analysis: Any = SimpleNamespace(case=SimpleNamespace(base=base))
    ranking = Ranking(before, np.zeros(4), {}, {}, {}, {})
    found = decide.with_curves(analysis, ranking)
    assert asked == [["catalogue", "nothing"]]
    assert [(h.kind, h.log_weight) for h in found.hypotheses] == [
        ("part", 3.0), ("catalogue", 2.0), ("unknown", 1.0), ("nothing", 0.0)
    ]  # fmt: skip
    np.testing.assert_allclose(found.posterior, np.exp([3.0, 2.0, 1.0, 0.0]) / np.exp([3.0, 2.0, 1.0, 0.0]).sum())
    base.whole_runs = True  # the search itself weighed them
    assert decide.with_curves(analysis, ranking) is ranking


def test_an_alias_is_the_answer_to_the_last_digit(monkeypatch: pytest.MonkeyPatch) -> None:
    """With as many parameters, and the same cost; not what is told already, nor beside a curve."""
    far = {("top", "far"): 2e-3, ("far", "top"): 0.0, ("top", "back"): 0.0, ("back", "top"): 2e-3}

    class Apart:
        def __init__(self, analysis: Any, ranking: Any, top: Hypothesis) -> None:
            assert top.effects == ("top",)

        def __call__(self, first: Hypothesis, other: Hypothesis) -> float:
            return far.get((first.effects[0], other.effects[0]), 9e-4)

    monkeypatch.setattr(decide, "_Apart", Apart)
    top, told = _answer("top", cost=5.0), _answer("told", cost=5.0)
    longer = _answer("longer", cost=5.0)
    assert longer.fit is not None
    longer.fit.theta = np.zeros(2)  # type: ignore[misc]
    part, rare = _answer("part", kind="part", cost=5.0), _answer("rare", cost=5.0)
    pairs = [(top, 0.4), (told, 0.1), (_answer("same", cost=5.0009), 0.1), (part, 0.1), (longer, 0.1), (rare, 1e-6),
        (_answer("other", cost=5.0011), 0.1), (_answer("far", cost=5.0), 0.1), (_answer("back", cost=5.0), 0.1),
        (_answer("less", cost=4.9991), 2e-6), (replace(_answer("unfitted"), fit=None), 0.1)]  # fmt: skip
    ranked: Any = SimpleNamespace(pairs=lambda: pairs)
    analysis: Any = None
    assert decide.aliases(analysis, ranked, Decision("ambiguous", 0.5, (top, told))) == (("same",), ("less",))
    assert decide.aliases(analysis, ranked, Decision("unexplained", 0.5)) == ()


def test_predictions_are_compared_in_the_noise_that_the_likeliest_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decide, "noise_left", lambda analysis, fit: ("node", fit.row))
    calls: list[str] = []

    def fit(name: str, row: float) -> Any:
        def jacobian(theta: Any) -> Any:
            calls.append(name)
            return np.full((2, 3), row), np.full((2, 3, 1), row)

        return SimpleNamespace(
            row=row, theta=None, model=SimpleNamespace(bind=lambda i, r: SimpleNamespace(jacobian=jacobian))
        )

    noise = SimpleNamespace(sigma=np.array([1.0, 2.0]))
    analysis: Any = SimpleNamespace(noise=noise, case=SimpleNamespace(inputs=None), rows=None)
    asked: list[Any] = []

    def distance(gap: Array, slopes: Array, node: str) -> float:
        asked.append((gap[:, 0].tolist(), slopes[:, 0, 0].tolist(), node))
        return 12.0

    ranked: Any = SimpleNamespace(evidence=SimpleNamespace(distance=distance))
    one, other = (Hypothesis((name,), "catalogue", 0.0, fit(name, row)) for name, row in (("a", 2.0), ("b", 6.0)))
    apart = decide._Apart(analysis, ranked, one)
    assert apart(one, other) == apart(one, other) == 3.0
    assert asked[0] == ([-4.0, -2.0], [6.0, 3.0], "node")
    assert calls == ["a", "b"]  # each is computed once


@pytest.mark.parametrize(
    ("name", "kind", "told"), [("constant.radius", "catalogue", "constant"), ("table.load.scale", "catalogue", "table"),
        ("drag", "catalogue", "catalogue"), ("e", "expression", "expression")],
)  # fmt: skip
def test_a_candidate_is_of_a_kind(name: str, kind: str, told: str) -> None:
    effect: Any = SimpleNamespace(name=name)
    assert discovery._kind(effect, _answer(name, kind=kind)) == told


def test_a_bump_stands_where_three_rows_are_at_least() -> None:
    """Its evidence is the mean over fifty places, where rows stand alone there is none; the likeliest is told."""
    values = np.concatenate([np.linspace(0.0, 1.0, 101), [2.0]])
    bump = free_curves.Bump("q", "", values, np.ones(102))
    seen: list[Array] = []

    def single(columns: Array) -> Array:
        seen.append(columns)
        return np.arange(50.0)

    evidence: Any = SimpleNamespace(channels=2, single=single)
    first, second = bump.log_evidence(evidence)
    total, squares = np.abs(seen[0]).sum(axis=0), (seen[0] ** 2).sum(axis=0)
    there = total**2 > 3.0 * squares
    assert not there[49]  # a single row at the far end
    assert there[:25].all()
    assert first == second == pytest.approx(np.log(np.exp(np.arange(50.0))[there].sum() / 50.0))
    assert not seen[0][102:].any()
    assert not seen[1][:102].any()
    likeliest: Any = bump.likeliest(evidence, 1)
    best = int(np.flatnonzero(there)[-1])
    assert likeliest.centres == (bump.centres[best],)
    assert likeliest.at(values).shape == (102, 1)


def test_waves_are_weighed_in_each_channel() -> None:
    values = np.linspace(0.0, 1.0, 30)
    waves = free_curves.Waves("q", "", values, np.ones(30))
    residual = np.stack([np.zeros(30), 9.0 * np.cos(np.pi * values)])
    evidence = Evidence(Runs(np.zeros(30, dtype=int), 2), residual, np.zeros((2, 30, 0)), STATED, [0])
    low, high = waves.log_evidence(evidence)
    for channel, found in ((0, low), (1, high)):
        own = waves.block(channel, 2)
        expected = evidence.blocks(evidence.gram(own), np.arange(9)[None, :], np.zeros((1, 9)))[0]
        assert found == pytest.approx(float(expected))
    assert high > low + 100.0
    assert waves.likeliest(evidence, 1) is waves


def test_what_a_ranker_begins_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """The squares beyond those of noise may be explained, or what noise has by chance; constants, zero points and a
    delay of the inputs are suspects, of the catalogue is the rest."""
    effects = [SimpleNamespace(name=name, transform="") for name in ("drag", "gear", "zero_of_load")]
    effects.append(SimpleNamespace(name="late", transform="inputs"))
    made: list[Any] = []

    class Given:
        def __init__(self, runs: Any, residual: Array, base: Array, behind: float, kinds: Any, *bounds: Any) -> None:
            made.append((residual, base, behind, kinds, *bounds))

        def among(self, columns: Array) -> list[int]:
            made.append(columns)
            return [5]

    patches: dict[str, Any] = {
        "measured": lambda model, rows: np.zeros((2, int(rows.sum()))), "candidates": lambda model: effects,
        "constants": lambda model: [SimpleNamespace(name="constant.r")], "faults": lambda case: ["fault"],
        "free_slopes": lambda fit, sigma, rows, released: (None, None, np.full((2, 4, 1), 8.0 if released else 0.0)),
        "Evidence": Given, "bounds": lambda fit: np.array([1.0]), "following": lambda fit: np.array([True]),
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(ranker, name, does)

    def begun(left: float) -> Any:
        made.clear()
        shapes = {"drag": [Shape("drag", (), np.ones((8, 1)), 1.0, 0.0, 1.0)],
            "wave": [Shape("wave", (), np.full((8, 2), 3.0), 1.0, 0.0, 1.0)]}  # fmt: skip
        noise = SimpleNamespace(sigma=np.array([0.5, 2.0]), behind=3.0, known=np.array([True, False]), kinds=[1])
        base = SimpleNamespace(whole_runs=False)
        case = SimpleNamespace(run=np.zeros(6, dtype=int), train=np.arange(6) < 3, base=base)
        analysis: Any = SimpleNamespace(
            case=case, model=SimpleNamespace(channels=("f", "g")), rows=np.arange(6) > 1, noise=noise, felt=None,
            prediction=np.ones((2, 4)), shapes=shapes, fit="fit", nuisance=np.full((2, 4, 1), 9.0),
            residual=np.stack([np.full(4, 0.5 * left), np.full(4, 2.0 * left)]),
        )  # fmt: skip
        return Ranker(analysis, lambda _: None)

    found = begun(2.0)
    assert (found.catalogue, set(found.suspects), found.possible) == (
        2,
        {"zero_of_load", "late", "constant.r"},
        ["fault"],
    )
    assert found.effects.keys() == {"drag", "gear", "zero_of_load", "late", "constant.r"}
    assert found.misfit == pytest.approx(4.0 * 8.0 - 8.0)
    assert begun(1.0).misfit == pytest.approx(4.0)  # the sd of the squares of eight rows
    residual, base, behind, kinds = made[0]
    np.testing.assert_allclose(residual, np.ones((2, 4)))
    np.testing.assert_allclose(base[:, 0], [[16.0, 9.0], [4.0, 9.0]])
    assert (behind, kinds, made[2][3], made[2][4].tolist()) == (3.0, [1], [5], [1.0])
    assert made[1].shape == (8, 3)
    assert found.columns_without({"drag"}).tolist() == [[3.0, 3.0]] * 8
    assert found.columns_without({"drag", "wave"}).shape == (8, 0)
    assert found.fits == {frozenset(): "fit"}
    assert found.train.shape == (2, 3)


def test_what_is_left_is_what_was_measured_less_what_is_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leftover, "measured", lambda model, rows: np.array([[5.0, 7.0]]))
    monkeypatch.setattr(leftover, "predict", lambda fit, rows: np.array([[2.0, 9.0]]))
    analysis: Any = SimpleNamespace(rows=None)
    fit: Any = SimpleNamespace(model=None)
    assert leftover._left_of(analysis, fit).tolist() == [[3.0, -2.0]]
