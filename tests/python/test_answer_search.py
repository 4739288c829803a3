"""The search for answers, with fits and evidence that are given: what lies next to the best ones, which pairs and
formulas are refitted, faults of the table, runs drawn anew, and what of it is said."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.discover import closure, expression_answers, ranking, resampled, suspect_answers
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.formulas.expressions import Sketch
from terrapin_tools.workbench.formulas.vocabulary import Scale
from terrapin_tools.workbench.model.linearised import Linear
from terrapin_tools.workbench.model.table_faults import Fault
from terrapin_tools.workbench.model.usual_sizes import MOST_TAX
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, considered
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

EVERY = np.ones(3, dtype=bool)
SCALE = Scale(1.0, 0.1, 9.0)


def _answer(effects: str, weight: float, kind: str = "catalogue", **fit: Any) -> Hypothesis:
    of: Any = SimpleNamespace(theta=np.zeros(1), effects=effects, **fit)
    return Hypothesis(tuple(effects.split()), kind, weight, of)


def _sketch(text: str, column: str = "oil", target: str = "y", prior: float = 0.1) -> Sketch:
    scales = {name: SCALE for name in ("w", "x0", "tau") if name in text}
    return Sketch(text, target, column, scales, prior)


class Bench:
    """A ranker whose sets weigh what `weights` says, -50 otherwise; `refitted` are those that it was asked for."""

    def __init__(self, weights: dict[str, float] | None = None, formulas: Collection[str] = (), **more: Any) -> None:
        self.weights = weights or {}
        self.refitted: list[str] = []
        self.sketches: dict[str, Any] = {name: _sketch(f"k*{name}") for name in formulas}
        self.case = SimpleNamespace(dynamics=None, base=SimpleNamespace(whole_runs=False))
        self.impossible: set[str] = set()
        self.unsound: set[str] = set()
        self.faults: dict[str, Any] = {}
        self.flat: list[Any] = []
        self.shapes: dict[str, Any] = {}
        self.kinds: list[str] = []
        self.said: list[str] = []
        vars(self).update(more)

    def report(self, text: str) -> None:
        self.said.append(text)

    def together_possible(self, names: Sequence[str]) -> bool:
        return self.impossible.isdisjoint(names)

    def sound(self, fit: Any, names: Collection[str]) -> bool:
        return self.unsound.isdisjoint(names)

    def fit(self, names: Sequence[str]) -> Any:
        return SimpleNamespace(effects=" ".join(names), theta=np.zeros(1))

    def log_prior(self, names: Collection[str]) -> float:
        return -2.0 * len(names)

    def beyond(self, fit: Any, without: Collection[str] = ()) -> Any:
        return SimpleNamespace(of=(fit.effects, " ".join(without)), nothing=-7.0)

    def expression(self, sketch: Sketch) -> str:
        return f"[{sketch.text}]"

    def weighed(self, names: tuple[str, ...], otherwise: float = -np.inf) -> Hypothesis:
        self.refitted.append(" ".join(names))
        weight = self.weights.get(" ".join(sorted(names)), -50.0)
        own = [name in self.sketches for name in names]
        kind = "expression" if all(own) else "mixed" if any(own) else "catalogue"
        fit = SimpleNamespace(theta=np.zeros(1), effects=" ".join(names))
        return Hypothesis(names, kind, weight, fit)  # type: ignore[arg-type]


class Nearby:
    """What lies next to each answer, and of which it was asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, near: dict[str, str] | None = None) -> None:
        self.near, self.asked, self.pairs = near or {}, list[str](), list[tuple[str, int]]()
        monkeypatch.setattr(closure, "_next_to", self._next_to)
        monkeypatch.setattr(closure, "pairs_beside", self._pairs)
        monkeypatch.setattr(closure, "absent", lambda fit, effects: "gone" in effects)

    def _next_to(self, ranker: Any, centre: Hypothesis) -> list[tuple[str, ...]]:
        own = " ".join(centre.effects)
        self.asked.append(own)
        return [tuple(one.split()) for one in self.near.get(own, "").split(",")]

    def _pairs(self, ranker: Any, name: str, most: int) -> list[tuple[str, str]]:
        self.pairs.append((name, most))
        return [(f"{name}1", f"{name}2")]


def _near(ranker: Bench, *found: Hypothesis) -> list[str]:
    return [" ".join(h.effects) for h in closure.neighbours(ranker, found)]  # type: ignore[arg-type]


def test_the_neighbours_of_each_answer_that_leads_are_refitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """And theirs, as long as each of them leads, twelve at most; nothing is refitted twice."""
    near = {f"n{i}": f"n{i + 1},n0,n{i}" for i in range(30)}
    nearby = Nearby(monkeypatch, near)
    ranker = Bench({f"n{i}": float(i) for i in range(30)})
    assert _near(ranker, _answer("n0", 0.0)) == [f"n{i}" for i in range(1, 13)]
    assert nearby.asked == [f"n{i}" for i in range(12)]
    assert ranker.refitted == [f"n{i}" for i in range(1, 13)]


def test_of_answers_that_do_not_lead_six_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Likeliest first, where they come within a factor of 20; none without a fit, or of size 0, or without effects."""
    nearby = Nearby(monkeypatch)
    found = [_answer(f"n{i}", 10.0 - 0.1 * i) for i in range(9)]
    assert _near(Bench(), *found[::-1]) == []
    assert nearby.asked == [f"n{i}" for i in range(6)]
    nearby.asked.clear()
    no_fit = replace(_answer("unfitted", 11.0), fit=None)
    nothing = replace(_answer("a", 9.5, "nothing"), effects=())
    others = [_answer("gone", 9.0), no_fit, nothing, _answer("near", 7.1), _answer("far", 7.0)]
    _near(Bench(), _answer("best", 10.0), *others)
    assert nearby.asked == ["best", "near"]


def test_a_neighbour_is_possible_and_short_enough_to_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three formulas at most, no two forms of one law, and not nothing."""
    Nearby(monkeypatch, {"best": "e f g,e f g h,best a,law b,,a best,other,best other"})
    ranker = Bench(formulas="efgh")
    ranker.impossible = {"law"}
    assert _near(ranker, _answer("best", 10.0), _answer("other", 1.0)) == ["e f g", "best a", "best other"]


def test_pairs_of_formulas_are_looked_for_beside_members_of_answers_with_formulas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside each once, beside six at most, two of each; not over time, and not where effects alone explain."""
    nearby = Nearby(monkeypatch)
    ranker = Bench(formulas="efg")
    found = [_answer("a e", 10.0), _answer("a b e", 9.9), _answer("c d f", 9.8), _answer("x y g", 9.7)]
    new = _near(ranker, *found)
    assert nearby.pairs == [(one, 2) for one in ("a", "e", "b", "c", "d", "f")]
    assert new == ["a a1 a2", "e e1 e2", "b b1 b2", "c c1 c2", "d d1 d2", "f f1 f2"]
    nearby.pairs.clear()
    assert _near(Bench(formulas="efg"), _answer("a b", 10.0)) == []
    ranker.case.dynamics = object()
    assert _near(ranker, *found) == []
    assert nearby.pairs == []


def _listed(*sketches: Sketch) -> Any:
    return SimpleNamespace(sketches=sketches)


def test_what_lies_next_to_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """One member less, one exchanged, one more; a fault of the table is taken away by a refit, anything else by its
    share in the prediction."""
    asked: list[Any] = []

    def likely(ranker: Any, beyond: Any, centre: Hypothesis, anyway: Any, best: float) -> list[str]:
        asked.append((beyond.of, centre.effects, anyway, best))
        return ["new"]

    monkeypatch.setattr(closure, "_likely", likely)
    monkeypatch.setattr(closure, "_bent_alike", lambda ranker, member: ["bent", "a"] if member == "b" else [])
    monkeypatch.setattr(closure, "_unfolded", lambda ranker, centre, member: [("line", "one")] if member == "a" else [])
    ranker: Any = Bench()

    def near(centre: Hypothesis) -> list[str]:
        asked.clear()
        return [" ".join(names) for names in closure._next_to(ranker, centre)]

    assert near(_answer("a b", 4.0)) == ["b", "a", "b new", "b line one", "a new", "a bent", "a b new"]
    both = ("a", "b")
    assert asked == [
        (("a b", "a"), both, (3, 2), 8.0), (("a b", "b"), both, (3, 2), 8.0),
        (("a b", ""), both, (1, 1), -7.0),
    ]  # fmt: skip
    assert near(_answer("c", 4.0)) == ["new", "c new"]
    ranker.faults = {"a": object()}
    assert near(_answer("a c", 4.0))[:3] == ["c", "a", "c new"]
    assert asked[0][0] == ("c", "")
    assert near(_answer("c d e", 4.0))[-1] == "c d e new"
    assert len(near(_answer("c d e f", 4.0))) == 8  # of four terms none more
    ranker.faults = {"held": object()}
    assert "held" not in " ".join(near(_answer("c", 4.0)))
    ranker.case.dynamics = object()  # there nothing is linear in a fault
    assert near(_answer("c", 4.0)) == ["new", "held", "c new", "c held"]
    assert near(_answer("held", 4.0)) == ["new", "held new"]
    ranker.unsound = {"c"}
    assert near(_answer("c d", 4.0)) == []


def test_a_bend_is_exchanged_for_other_bends_of_its_column() -> None:
    ranker: Any = Bench()
    tanh, quotient, decay = (_sketch(f"k*{one}") for one in ("tanh(oil/w)", "oil/(oil + x0)", "exp(-oil/tau)"))
    again = replace(tanh, scales={"w": Scale(2.0, 0.1, 9.0)})
    others = (
        _sketch("k*tanh(oil/w)*load"), _sketch("k*exp(-oil/tau)", target="z"), _sketch("k*exp(-load/tau)", "load"),
        _sketch("k*oil"), _sketch("k*(oil - x0)"),
    )  # fmt: skip
    ranker.listed = _listed(tanh, again, quotient, decay, *others)
    ranker.sketches = {"t": tanh, "l": others[0], "p": others[3], "r": others[4]}
    assert closure._bent_alike(ranker, "t") == ["[k*oil/(oil + x0)]", "[k*exp(-oil/tau)]"]
    for name in ("l", "p", "r", "drag"):
        assert closure._bent_alike(ranker, name) == []
    signed = [_sketch(f"k*{one}") for one in ("tanh(oil/w)", "oil/(abs(oil) + x0)", "exp(-abs(oil)/tau)")]
    ranker.listed, ranker.sketches = _listed(*signed), {"q": signed[1]}
    assert closure._bent_alike(ranker, "q") == ["[k*tanh(oil/w)]", "[k*exp(-abs(oil)/tau)]"]


def test_a_deviation_is_unfolded_into_a_line_and_a_constant(monkeypatch: pytest.MonkeyPatch) -> None:
    ranker: Any = Bench()
    asked: list[Any] = []

    def likely(ranker: Any, beyond: Any, centre: Hypothesis, anyway: Any, best: float) -> list[str]:
        asked.append((beyond.of, centre.effects, anyway, best))
        return ["offset", "drag"]

    monkeypatch.setattr(closure, "_likely", likely)
    deviation, line, elsewhere = _sketch("k*(oil - x0)*load"), _sketch("k*oil*load"), _sketch("k*oil*load", target="z")
    ranker.listed = _listed(elsewhere, deviation, line)
    ranker.sketches = {"d": deviation, "l": line}
    named = "[k*oil*load]"
    assert closure._unfolded(ranker, _answer("a d", 1.0), "d") == [(named, "offset"), (named, "drag")]
    assert asked == [((f"a {named}", ""), ("a", "d"), (1, 0), np.inf)]
    assert closure._unfolded(ranker, _answer("a d", 1.0), "l") == []
    assert closure._unfolded(ranker, _answer("a d", 1.0), "a") == []
    ranker.case.base.whole_runs = True
    assert closure._unfolded(ranker, _answer("a d", 1.0), "d") == []
    ranker.case.base.whole_runs = False
    ranker.listed = _listed(elsewhere, deviation)
    assert closure._unfolded(ranker, _answer("a d", 1.0), "d") == []


def test_effects_and_formulas_that_promise_most_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some anyway, others where they come within 8 of the best; six effects and four formulas at most."""

    def likely(scores: dict[str, float], formulas: Sequence[float] = (), anyway: tuple[int, int] = (1, 1),
        best: float = -np.inf, present: Sequence[str] = ("here",)) -> list[str]:  # fmt: skip
        monkeypatch.setattr(closure, "by_effect", lambda beyond, flat: dict(scores))
        ranker: Any = Bench()
        ranker.listed = SimpleNamespace(
            sketches=[_sketch(f"k*x{i}") for i in range(len(formulas))], promise=lambda beyond: np.array(formulas)
        )
        return closure._likely(ranker, None, _answer(" ".join(present), 0.0), anyway, best)  # type: ignore[arg-type]

    assert likely({"a": 1.0, "b": 9.0, "here": 99.0, "c": 0.9}) == ["b"]
    assert likely({"a": 1.1, "b": 9.0, "c": 1.0}) == ["b", "a"]
    assert likely({"a": 1.0, "b": 9.0, "c": 0.9}, best=20.0) == ["b"]
    assert likely({"a": 1.0, "b": 9.0, "c": 0.9}, anyway=(2, 0), best=20.0) == ["b", "a"]
    assert likely({name: 10.0 - i for i, name in enumerate("abcdefgh")}) == list("abcdef")
    assert likely({}) == []
    three = ["[k*x1]", "[k*x2]", "[k*x0]"]
    assert likely({"a": 1.0}, (1.0, 8.0, 7.0), anyway=(0, 0)) == ["a", *three]
    assert likely({}, (0.0, 8.0, 7.0)) == three[:2]
    assert likely({}, (0.0, 8.0, 7.0), anyway=(0, 3)) == three
    assert likely({}, (0.0, 8.0, 7.0), anyway=(0, 1), best=30.0) == three[:1]
    assert likely({}, (0.0, 8.0, 7.0), anyway=(0, 0), best=30.0) == []
    assert likely({}, (1.0, 8.0, 7.0), present=["[k*x1]"]) == three[1:]
    assert likely({}, [5.0 - 0.1 * i for i in range(7)]) == [f"[k*x{i}]" for i in range(4)]


def test_over_time_formulas_are_listed_along_the_motion_of_the_centre(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drag beside a hard spring was tanh and a dead zone at 0.98: along the present fit's motion none.
    Each formula is tried once, at its likeliest scale."""
    monkeypatch.setattr(closure, "by_effect", lambda beyond, flat: {})
    sketches = [_sketch("k*tanh(v/w)"), _sketch("k*tanh(v/w)"), _sketch("k*v**3"), _sketch("k*v*abs(v)")]
    logs = np.array([9.0, 8.0, 7.0, 6.0])
    centre = _answer("here", 0.0)

    def along(ranker: Any, fit: Any, beyond: Any) -> Any:
        assert fit is centre.fit
        return SimpleNamespace(sketches=sketches, promise=lambda beyond: logs)

    monkeypatch.setattr(closure, "along", along)
    ranker: Any = Bench(listed=_listed())
    ranker.case = SimpleNamespace(dynamics=object(), base=SimpleNamespace(whole_runs=True))
    named = [f"[{one}]" for one in ("k*tanh(v/w)", "k*v**3", "k*v*abs(v)")]
    assert closure._likely(ranker, None, centre, (0, 1), -np.inf) == named  # type: ignore[arg-type]


def test_beside_a_unit_that_was_mistaken_the_search_goes_on() -> None:
    ranker: Any = Bench(faults={"scale": SimpleNamespace(factor=9.8), "late": SimpleNamespace(factor=1.0)})
    found = [_answer("a b", 50.0), _answer("scale", 3.0), _answer("scale a", 9.0), _answer("late", 20.0)]
    assert closure._hides(ranker, found) is None
    ranker.case.dynamics = object()
    assert closure._hides(ranker, found) is found[2]
    assert closure._hides(ranker, [found[0], found[3]]) is None


def test_a_wave_is_weighed_by_both_of_its_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(closure, "by_effect", lambda beyond, flat: {"a": 1.0, "tooth": -20.0})

    def shape(effect: str, first: float, count: int) -> Any:
        return SimpleNamespace(effect=effect, columns=np.full((5, count), first))

    def blocks(gram: Array, picks: Array, offset: Array) -> Array:
        assert picks.tolist() == [[0, 1]]
        assert offset.tolist() == [[0.0, 0.0]]
        return np.array([gram[0, 0]])

    beyond: Any = SimpleNamespace(gram=lambda columns: columns, blocks=blocks)
    ranker: Any = Bench(flat=[shape("tooth", 3.0, 2), shape("tooth", 2.0, 2), shape("a", 50.0, 1),
        shape("pole", -9.0, 2), shape("here", 60.0, 2)], listed=_listed())  # fmt: skip
    assert closure._likely(ranker, beyond, _answer("here", 0.0), (1, 1), -np.inf) == ["tooth", "a"]
    assert closure._likely(ranker, beyond, _answer("here", 0.0), (3, 1), -np.inf) == ["tooth", "a", "pole"]


class Formulas:
    """Sketches with their log evidence, and that of pairs of columns by what stands in them."""

    def __init__(self, pairs: dict[tuple[float, float], float], evidence: Sequence[float], columns: str = "") -> None:
        self.sketches = [_sketch(f"k*x{i}", column=c) for i, c in enumerate(columns or "q" * len(evidence))]
        self.columns = np.arange(float(len(evidence)))[None, :]
        self.pairs_of, self.logs = pairs, np.array(evidence)

    def promise(self, evidence: Any) -> Array:
        return self.logs

    def gram(self, columns: Array) -> Array:
        return np.asarray(columns[0])

    def pairs(self, gram: Array, first: Array, second: Array) -> Array:
        return np.array([self.pairs_of.get((gram[i], gram[k]), -9.0) for i, k in zip(first, second, strict=True)])


def test_pairs_of_formulas_and_of_one_with_an_effect_are_refitted() -> None:
    """Six and four, likeliest first by evidence and prior; each effect beside the formula that suits it best."""
    listed = Formulas({(0.0, 1.0): 5.0, (1.0, 2.0): 6.0, (0.0, 3.0): 7.0}, [4.0, 3.0, 2.0, 1.0])
    listed.sketches[3] = replace(listed.sketches[3], prior=0.1 * np.exp(-3.0))
    shape = SimpleNamespace(effect="drag", columns=np.array([[50.0]]))
    steep = SimpleNamespace(effect="drag", columns=np.array([[51.0]]))
    other = SimpleNamespace(effect="gear", columns=np.array([[60.0]]))
    wave = SimpleNamespace(effect="tooth", columns=np.array([[70.0, 71.0]]))
    listed.pairs_of |= {(2.0, 51.0): 8.0, (1.0, 50.0): 7.5, (0.0, 60.0): 7.7}
    ranker: Any = Bench(listed=listed, promised=listed.logs, flat=[wave, shape, steep, other], evidence=listed)
    found = expression_answers.expression_pairs(ranker)
    told = [" ".join(h.effects).replace("[k*", "").replace("]", "") for h in found]
    assert told == ["x1 x2", "x0 x1", "x0 x3", "x0 x2", "x1 x3", "x2 x3", "drag x2", "gear x0"]
    many = [SimpleNamespace(effect=f"e{i}", columns=np.array([[100.0 + i]])) for i in range(6)]
    listed.pairs_of = {(0.0, 100.0 + i): float(i) for i in range(6)}
    ranker.flat = many
    found = expression_answers.expression_pairs(ranker)
    assert [h.effects[0] for h in found[-5:]] == ["[k*x2]", "e5", "e4", "e3", "e2"]
    ranker.flat = [wave]
    assert len(expression_answers.expression_pairs(ranker)) == 6
    more = Formulas({}, [0.0] * 5)
    ranker.listed, ranker.promised, ranker.evidence = more, more.logs, more
    assert len(expression_answers.expression_pairs(ranker)) == 6
    ranker.listed = _listed()
    assert expression_answers.expression_pairs(ranker) == []


def test_a_formula_at_two_starts_makes_no_pair_with_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = Formulas({(0.0, 1.0): 5.0}, [4.0, 3.0, 2.0])
    listed.sketches[1] = replace(listed.sketches[0], scales={"w": SCALE})
    ranker = Bench(listed=listed, promised=listed.logs, evidence=listed)
    found = expression_answers.expression_pairs(ranker)  # type: ignore[arg-type]
    assert [h.effects for h in found] == [("[k*x0]", "[k*x2]")]


def test_pairs_beside_a_term_are_weighed_around_it(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = Formulas({(0.0, 1.0): 5.0, (1.0, 2.0): 6.0, (0.0, 3.0): 7.0}, [4.0, 3.0, 2.0, 1.0])
    listed.sketches[3] = replace(listed.sketches[3], prior=0.1 * np.exp(-3.0))
    ranker = Bench(listed=listed)
    asked: list[str] = []

    def beyond(fit: Any) -> Formulas:
        asked.append(fit.effects)
        return listed

    monkeypatch.setattr(ranker, "beyond", beyond)
    of: Any = ranker
    assert expression_answers.pairs_beside(of, "a", 1) == [("[k*x1]", "[k*x2]")]
    assert expression_answers.pairs_beside(of, "a", 3)[1:] == [("[k*x0]", "[k*x1]"), ("[k*x0]", "[k*x3]")]
    assert expression_answers.pairs_beside(of, "[k*x1]", 3) == [("[k*x0]", "[k*x3]")]
    assert asked == ["a", "a", "[k*x1]"]
    ranker.unsound = {"a"}
    assert expression_answers.pairs_beside(of, "a", 1) == []


def test_of_every_column_some_formulas_are_among_those_that_are_paired(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight of each in the order of their evidence; then the likeliest of all, to as many as are paired."""
    columns = "a" * 300 + "b" * 3 + "c" * 12
    ranker: Any = Bench(listed=Formulas({}, [0.0] * 315, columns))
    logs = -np.arange(315.0)
    found = expression_answers._pool(ranker, logs)
    assert found == [*range(8), 300, 301, 302, *range(303, 311), *range(8, 209)]
    assert len(found) == expression_answers.POOL
    monkeypatch.setattr(expression_answers, "POOL", 5)
    assert expression_answers._pool(ranker, logs) == [*range(8), 300, 301, 302, *range(303, 311)]
    assert expression_answers._pool(ranker, logs[::-1])[:2] == [314, 313]


def _along(monkeypatch: pytest.MonkeyPatch, texts: str, tried: set[tuple[str, str]]) -> tuple[list[str], Any]:
    """Sketches along a motion, of these texts, likeliest last; and what the library was asked for."""
    sketches = [_sketch(one) for one in texts.split()]
    asked: list[Any] = []

    def library(*given: Any) -> Any:
        asked.extend(given)
        return SimpleNamespace(sketches=sketches, promise=lambda beyond: np.arange(float(len(sketches))))

    monkeypatch.setattr(expression_answers, "library", library)
    ranker: Any = Bench(values=np.zeros((2, 3)), rows=EVERY, sigma=np.ones(2), misfit=4.0)
    fit: Any = SimpleNamespace(model="model", theta="theta")
    found = expression_answers._along(ranker, fit, SimpleNamespace(flat="flat"), tried)  # type: ignore[arg-type]
    return [one.text for one in found], asked


def test_the_four_likeliest_formulas_along_a_motion_are_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = {("y", "f"), ("z", "e")}
    found, asked = _along(monkeypatch, "a b c d e f", tried)
    assert found == ["e", "d", "c"]  # of the four likeliest: one was tried, another on another target only
    assert tried == {("y", one) for one in "cdef"} | {("z", "e")}
    assert (asked[0], asked[1], asked[4].shape, asked[5], asked[6]) == ("model", "theta", (6, 0), "flat", 4.0)
    assert _along(monkeypatch, "a b b c c", set())[0] == ["c", "b"]


def test_formulas_are_looked_for_along_the_best_motion_and_the_stated_one(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(expression_answers, "_along", lambda ranker, fit, beyond, tried: asked.append((fit, beyond.of)))
    ranker: Any = Bench(rows=EVERY, model=SimpleNamespace(start="stated"))
    expression_answers._instead(ranker, _answer("one", 3.0), set())
    (fit, of), *_ = asked
    assert (fit.effects, of) == ("one", ("one", "one"))

    @dataclass(frozen=True)
    class Fit:
        theta: Any
        at_bound: tuple[str, ...]
        model: Any
        effects: str = "none"

    numbers = np.zeros((1, 3))
    bound = SimpleNamespace(predict=lambda theta: numbers)
    ranker.case.inputs = {}
    ranker.analysis = SimpleNamespace(fit=Fit("fitted", ("k",), SimpleNamespace(bind=lambda inputs, rows: bound)))
    asked.clear()
    assert expression_answers._as_stated(ranker, set()) is None  # of _along
    (fit, of), *_ = asked
    assert (fit.theta, fit.at_bound, of) == ("stated", (), ("none", ""))
    numbers[0, 1] = np.inf
    assert expression_answers._as_stated(ranker, set()) == []
    assert len(asked) == 1


def _kept(monkeypatch: pytest.MonkeyPatch, found: Sequence[Hypothesis], pays: Collection[tuple[str, str]],
    formulas: str = "", known: bool = True, **more: Any) -> tuple[list[str], list[tuple[str, str]]]:  # fmt: skip
    """Answers that are kept where a longer set pays against a shorter one; and what was asked, longer and shorter."""
    asked: list[tuple[str, str]] = []

    def paying(analysis: Any, longer: Any, shorter: Any) -> bool:
        asked.append((longer.effects, shorter.effects))
        return (longer.effects, shorter.effects) in pays

    monkeypatch.setattr(expression_answers, "pays", paying)
    monkeypatch.setattr(expression_answers, "absent", lambda fit, effects: "gone" in effects)
    ranker: Any = Bench(formulas=formulas, analysis=SimpleNamespace(noise=SimpleNamespace(
        known=np.array([known, True]), sigma=1.0)))  # fmt: skip
    ranker.case = SimpleNamespace(dynamics=None, base=SimpleNamespace(whole_runs=False), test="held out")
    vars(ranker.case).update(more)
    return [" ".join(h.effects) for h in expression_answers.paying(ranker, found)], asked


def test_a_formula_beside_others_has_to_pay(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect has not, where the noise is stated; what is alone has not either."""
    found = [_answer("a", 1.0), _answer("e", 2.0), _answer("a e", 4.0), _answer("a b", 3.0), _answer("gone e", 5.0)]
    kept, asked = _kept(monkeypatch, found, [], formulas="e")
    assert (kept, asked) == (["a b", "e", "a"], [("a e", "a")])
    kept, asked = _kept(monkeypatch, found, [("a e", "a")], formulas="e")
    assert kept == ["a e", "a b", "e", "a"]
    two = [_answer("e f", 4.0), _answer("e", 1.0)]
    for pays, one in (([("e f", "f")], ["e"]), ([("e f", "f"), ("e f", "e")], ["e f", "e"])):
        assert _kept(monkeypatch, two, pays, formulas="ef")[0] == one
    unfitted = replace(_answer("a e", 4.0), fit=None)
    assert _kept(monkeypatch, [unfitted], [], formulas="e") == (["a e"], [])


def test_what_is_far_behind_is_asked_only_of_sets_that_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    lead = _answer("a", 20.0)
    for weight, asked in ((8.1, [("b e", "b")]), (8.0, [])):
        far = _answer("b e", weight)
        assert _kept(monkeypatch, [lead, far], [], formulas="e") == (["a"] if asked else ["a", "b e"], asked)
    kept, asked = _kept(monkeypatch, [lead, _answer("b e", 1.0), _answer("b", 0.0)], [], formulas="e")
    assert (kept, asked) == (["a", "b"], [("b e", "b")])


@pytest.mark.parametrize(
    ("known", "whole_runs", "own_equations", "every"),
    [(True, False, False, False), (False, False, False, True), (True, True, False, True), (True, True, True, False)],
)
def test_where_the_noise_is_an_estimate_every_effect_has_to_pay(
    monkeypatch: pytest.MonkeyPatch, known: bool, whole_runs: bool, own_equations: bool, every: bool
) -> None:
    """And over time, of a body of the program's; also beside the shorter set that predicts the held-out runs best."""
    left = {"b": 1.1, "a": 1.2, "c": 0.9, "a b": 1.0, "a b c": 0.8}
    monkeypatch.setattr(expression_answers, "error", lambda fit, rows, sigma: left.get(fit.effects))
    found = [_answer("a b", 4.0), _answer("a", 3.0), _answer("b", 2.0), _answer("c", 1.0, "expression"),
        _answer("a b c", 5.0)]  # fmt: skip
    more: dict[str, Any] = {
        "base": SimpleNamespace(whole_runs=whole_runs),
        "dynamics": object() if own_equations else None,
    }
    pays = [("a b", "b"), ("a b", "a"), ("a b c", "b c"), ("a b c", "a c"), ("a b c", "a b")]
    kept, asked = _kept(monkeypatch, found, pays, known=known, **more)
    assert kept == ["a b c", "a b", "a", "b", "c"]
    three = {("a b c", one) for one in ("b c", "a c", "a b")}  # of two "a b" predicts best, of one "b"
    assert set(asked) == (three | {("a b", "b"), ("a b", "a")} if every else set())
    alone = [("a b c", "b c"), ("a b c", "a c"), ("a b c", "a b"), ("a b", "a")]
    if every:  # beside the best of one effect it does not pay, whatever it is made of
        assert "a b" not in _kept(monkeypatch, found, alone, known=known, **more)[0]


def test_the_best_of_each_length_is_by_held_out_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    left = {"a": 1.2, "b": 1.1, "a b": 1.3, "c d e": 0.9, "gone": 0.1, "f": 0.1}
    monkeypatch.setattr(expression_answers, "error", lambda fit, rows, sigma: left.get(fit.effects))
    monkeypatch.setattr(expression_answers, "absent", lambda fit, effects: "gone" in effects)
    ranker: Any = Bench(analysis=SimpleNamespace(noise=SimpleNamespace(sigma=1.0)))
    ranker.case.test = "held out"
    found = [_answer("a", 9.0), _answer("a b", 9.0), _answer("b", 0.0), _answer("c d e", 0.0), _answer("gone", 9.0),
        _answer("f", 9.0, "expression"), replace(_answer("f", 9.0), fit=None), _answer("without", 9.0)]  # fmt: skip
    best = expression_answers._best_heldout(ranker, found)
    assert [fit.effects for fit in best] == ["b", "b", "c d e"]  # type: ignore[attr-defined]
    assert expression_answers._best_heldout(ranker, found[3:4])[0].effects == "c d e"  # type: ignore[attr-defined]
    assert expression_answers._best_heldout(ranker, []) == []


def _selected(monkeypatch: pytest.MonkeyPatch, answers: Sequence[tuple[Hypothesis, float]], evidence: dict[str, Any],
    draws: int = 4000, seed: int = 1, nodes: Sequence[int] | None = None) -> tuple[list[Any], list[Any]]:  # fmt: skip
    """Of three runs of other lengths; `evidence` of how often each run was drawn, of each answer."""
    made: list[Any] = []

    class Sums:
        def __init__(self, runs: Any, linear: Any, behind: float, nodes: Any) -> None:
            made.append((runs, linear, behind, nodes))
            self.of = evidence[linear.name]

        def evidence(self, weight: Array) -> Array:
            assert weight.shape[1] == 3
            assert (weight.sum(axis=1) == 3).all()
            return np.asarray(self.of(weight.T), dtype=float)

    @dataclass(frozen=True)
    class Given:
        name: str
        base: Array

    def linearise(fit: Any, effects: Any, *given: Any) -> Given:
        if fit.effects == "nowhere":
            raise ValueError
        return Given(fit.effects, np.zeros((2, 6, 1)))

    monkeypatch.setattr(resampled, "Sums", Sums)
    monkeypatch.setattr(resampled, "linearise", linearise)
    monkeypatch.setattr(resampled, "measured", lambda model, rows: None)
    noise = SimpleNamespace(sigma=None, known=np.array([True, False]), behind=3.0)
    analysis: Any = SimpleNamespace(
        case=SimpleNamespace(run=np.array([9, 0, 0, 0, 2, 2, 1])), rows=np.arange(7) > 0, noise=noise, felt=None,
        fit=SimpleNamespace(effects="present"), model=SimpleNamespace(channels=("f", "g")),
        nuisance=np.ones((2, 6, 3)), prediction=np.ones((2, 6)),
    )  # fmt: skip
    ranked: Any = SimpleNamespace(
        hypotheses=[h for h, _ in answers], posterior=[p for _, p in answers],
        evidence=None if nodes is None else SimpleNamespace(nodes=nodes),
    )  # fmt: skip
    return list(resampled.selection(analysis, ranked, draws, seed)), made


def test_an_answer_wins_in_the_share_of_draws_in_which_it_is_likelier(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of three runs is drawn at least twice in 7 of 27 draws; what each wins against is as it was."""
    nothing = Hypothesis((), "nothing", 0.5)
    evidence = {"a": lambda run: 5.0 + run[0], "present": lambda run: 0.0 * run[0] + 70.0}
    found, made = _selected(monkeypatch, [(_answer("a", 0.0), 0.4), (nothing, 0.6)], evidence)
    assert [(one.effects, one.kind) for one in found] == [((), "nothing"), (("a",), "catalogue")]
    assert found[1].frequency == pytest.approx(7.0 / 27.0, abs=0.03)
    assert sum(one.frequency for one in found) == pytest.approx(1.0)
    assert made[0][1].base.shape == (2, 6, 4)
    assert made[0][1].base[..., 1:].all()
    assert made[0][2] == 3.0
    again = _selected(monkeypatch, [(_answer("a", 0.0), 0.4), (nothing, 0.6)], evidence)[0]
    assert found == again
    other = _selected(monkeypatch, [(_answer("a", 0.0), 0.4), (nothing, 0.6)], evidence, seed=2)[0]
    assert found != other


def test_what_never_wins_is_not_told_and_what_is_out_of_the_question_takes_no_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flat = dict.fromkeys(("a", "b", "c", "present", *(f"n{i}" for i in range(30))), lambda run: 0.0 * run[0])
    nothing = Hypothesis((), "nothing", -1.0)
    unfitted, part = replace(_answer("c", 9.0), fit=None), _answer("c", 9.0, "part")
    rare, chance = (_answer("c", 9.0), 9e-7), (_answer("b", 2.0), 1e-6)
    given = [(part, 0.1), (unfitted, 0.1), (_answer("nowhere", 9.0), 0.1), rare, (_answer("a", 1.0), 0.2), chance]
    found, made = _selected(monkeypatch, given, flat, draws=5)
    assert [(one.effects, one.frequency) for one in found] == [(("b",), 1.0)]
    assert len(made) == 2
    found, made = _selected(monkeypatch, [(nothing, 1e-9)], flat, draws=5)
    assert [one.kind for one in found] == ["nothing"]
    many = [(_answer(f"n{i}", float(i)), 0.03) for i in range(30)]
    found, made = _selected(monkeypatch, many, flat, draws=5)
    assert (found[0].effects, len(made)) == (("n23",), 24)


def test_noise_that_walks_over_the_test_has_no_meaning_among_runs_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    flat = {"a": lambda run: 0.0 * run[0]}
    walks = [i for i, node in enumerate(NODES) if node.walk]
    stays = [i for i, node in enumerate(NODES) if not node.walk]
    assert walks
    _, made = _selected(monkeypatch, [(_answer("a", 0.0), 0.4)], flat, nodes=[stays[0], walks[0], stays[-1]], draws=2)
    assert made[0][3] == [stays[0], stays[-1]]
    _, made = _selected(monkeypatch, [(_answer("a", 0.0), 0.4)], flat, draws=2)
    assert made[0][3] == [i for i in range(considered(2)) if not NODES[i].walk]


def _fault(title: str = "", cost: float = 0.0, late: int = 0, column: str = "load", factor: float = 1.0) -> Fault:
    return Fault(f"table.{column}", title, "", "", (), (), (), "0", column, column=column, factor=factor, late=late,
        cost=cost)  # fmt: skip


class Looked:
    """A fault around its refit: the prediction on the changed table, what the refit predicts, and log evidence."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, changed: float, after: float = 2.0, nothing: float = -3.0,
        total: float = 1.0, averages: dict[str, float] | None = None) -> None:  # fmt: skip
        @dataclass(frozen=True)
        class Fit:
            theta: str
            bound: Any = None

        self.asked: list[Any] = []
        self.in_most = True
        self.present = Fit("fitted")
        bound = SimpleNamespace(predict=lambda theta: np.full((1, 3), changed))
        faulty = SimpleNamespace(bind=lambda inputs, rows: bound if rows is EVERY else "on the training rows")
        own = SimpleNamespace(nothing=-6.0, total=np.zeros(1))
        self.ranker: Any = Bench(
            rows=EVERY, evidence=own, train="train", sigma="sigma", analysis=SimpleNamespace(fit=self.present),
            model=SimpleNamespace(having=lambda fault: faulty, start="stated"),
        )  # fmt: skip
        self.ranker.case.inputs, self.ranker.case.train = {}, EVERY.copy()
        around = SimpleNamespace(nothing=nothing, total=np.array([1.0, total]))
        monkeypatch.setattr(self.ranker, "beyond", lambda fit: around)

        def predict(fit: Any, rows: Array) -> Array:
            return np.full((1, 3), 1.0 if fit is self.present else after)

        def extend(*given: Any) -> Fit:
            self.asked.append(given)
            return Fit("refitted")

        def shapes(ranker: Any, fault: Fault, fit: Any, others: bool) -> str:
            self.asked.append((fit.theta, others))
            return "shapes"

        def by_effect(beyond: Any, shapes: Any) -> dict[str, float]:
            self.asked.append(beyond is own)
            return averages if averages is not None else {}

        for name, value in (("predict", predict), ("extend", extend), ("_shapes", shapes), ("by_effect", by_effect),
            ("_in_most_runs", lambda *given: self.in_most)):  # fmt: skip
            monkeypatch.setattr(suspect_answers, name, value)

    def __call__(self, fault: Fault) -> Any:
        self.asked.clear()
        return suspect_answers._look(self.ranker, fault)


def test_a_fault_is_weighed_alone_and_with_the_effect_that_suits_it_best(monkeypatch: pytest.MonkeyPatch) -> None:
    look = Looked(monkeypatch, changed=4.0, averages={"drag": 2.0, "gear": 5.0})
    found = look(_fault(cost=1.5))
    assert (found.alone, found.beside, found.effect) == (-4.5, 3.5, "gear")
    assert found.best == 3.5
    parent, name, train, values, sigma, starts = look.asked[0]
    assert (parent, name, train) == (look.present, "table.load", "on the training rows")
    assert (values, sigma, starts) == ("train", "sigma", ["stated"])
    assert look.asked[1:] == [("refitted", True), False]
    alone = Looked(monkeypatch, changed=4.0)(_fault(cost=1.5))
    assert (alone.alone, alone.beside, alone.effect, alone.best) == (-4.5, -np.inf, "", -4.5)


def test_a_fault_that_the_model_does_not_read_is_seen_with_an_effect_that_does(monkeypatch: pytest.MonkeyPatch) -> None:
    look = Looked(monkeypatch, changed=1.0, averages={"drag": 2.0})
    found = look(_fault())
    assert (found.alone, found.beside, found.effect) == (-6.0, 2.0, "drag")
    assert look.asked == [("fitted", False), True]
    assert Looked(monkeypatch, changed=1.0)(_fault()) is None


def test_a_fault_that_leaves_no_fit_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor is a reading that comes late in few of the runs."""
    given: dict[str, Any] = {"changed": 4.0, "averages": {"drag": 2.0}}
    assert Looked(monkeypatch, **given, after=np.inf)(_fault()) is None
    assert Looked(monkeypatch, **given, total=np.inf)(_fault()) is None
    assert Looked(monkeypatch, **given, nothing=np.nan)(_fault()) is None
    look = Looked(monkeypatch, **given)
    assert look(_fault(late=2)) is not None
    look.in_most = False
    assert look(_fault(late=2)) is None
    assert look(_fault()) is not None


def test_a_late_reading_is_better_without_its_delay_in_half_of_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """In noise sd: the channel with less noise counts more."""
    before = np.array([[0.0, 2.0, 0.0, 2.0], [0.0, 1.0, 0.0, 1.0]])
    monkeypatch.setattr(suspect_answers, "measured", lambda model, rows: np.zeros((2, 4)))
    monkeypatch.setattr(suspect_answers, "predict", lambda fit, rows: fit)
    ranker: Any = SimpleNamespace(
        model=None, rows=np.arange(5) > 0, case=SimpleNamespace(run=np.array([7, 0, 0, 1, 1])),
        sigma=np.array([1.0, 0.1]),
    )  # fmt: skip
    one_better, none_better = before.copy(), before.copy()
    one_better[1, 1] = 0.9
    none_better[0] = 0.0
    none_better[1] = 1.1 * before[1]
    assert suspect_answers._in_most_runs(ranker, before, one_better)  # type: ignore[arg-type]
    assert not suspect_answers._in_most_runs(ranker, before, none_better)  # type: ignore[arg-type]
    assert not suspect_answers._in_most_runs(ranker, one_better, before)  # type: ignore[arg-type]


def test_effects_that_read_a_column_at_fault_are_looked_at_on_the_changed_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Others as they are; none whose sizes follow the column's own range, where its scale is at fault."""
    texts = {"drag": ("k*load", ()), "range": ("k*load/w", ("equation",)), "gear": ("k*omega", ())}
    effects = {name: SimpleNamespace(expression=text, bases=bases) for name, (text, bases) in texts.items()}
    ranker: Any = Bench(
        shapes={name: [name] for name in texts}, effects=effects, rows=EVERY, sigma=None,
        model=SimpleNamespace(channels=("torque",)),
    )  # fmt: skip
    monkeypatch.setattr(
        suspect_answers, "shapes_of", lambda model, theta, effect, rows, sigma: [f"{model} {effect.expression}"]
    )
    fit: Any = SimpleNamespace(model="changed", theta=None)

    def found(fault: Fault, others: bool) -> list[Any]:
        return list(suspect_answers._shapes(ranker, fault, fit, others))

    assert found(_fault(factor=1e-3), others=True) == ["changed k*load", "gear"]
    assert found(_fault(factor=1e-3), others=False) == ["changed k*load"]
    assert found(_fault(late=1), others=False) == ["changed k*load", "changed k*load/w"]
    effects["drag"] = SimpleNamespace(expression="k*torque", bases=())  # a channel is not what the model predicts
    assert found(_fault(column="torque"), others=True) == ["drag", "range", "gear"]
    assert found(_fault(column="torque"), others=False) == []


def test_the_likeliest_faults_are_refitted_alone_and_with_their_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four each; of one name the likeliest."""
    looked = [suspect_answers._Looked(_fault(f"c{i} one", column=f"c{i}"), float(i), 9.0 - i, f"e{i}" if i else "")
        for i in range(6)]  # fmt: skip
    looked.append(suspect_answers._Looked(_fault("c1 two", column="c1"), 20.0, -np.inf, ""))
    possible = [SimpleNamespace(name=one.fault.name, looked=one) for one in looked]
    monkeypatch.setattr(suspect_answers, "_look", lambda ranker, one: one.looked)
    ranker: Any = Bench(possible=[*possible, SimpleNamespace(name="none", looked=None)], effects={"drag": "drag"})
    found = [" ".join(h.effects) for h in suspect_answers.table_answers(ranker)]
    assert found == [*(f"table.c{i}" for i in (1, 5, 4, 3)), "table.c2 e2", "table.c3 e3", "table.c4 e4"]
    assert ranker.faults.keys() == {f"table.c{i}" for i in range(6)}
    assert ranker.faults["table.c1"].title == "c1 two"
    assert ranker.effects == {"drag": "drag", **ranker.faults}


def test_constants_that_may_be_wrong_are_weighed_with_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """The six likeliest of all; no constant beside another one, none that has no size."""
    logs = {"c1": {"drag": 5.0, "gear": 1.0, "oil": 0.5}, "c2": {"drag": 4.0, "gear": 3.0, "oil": 2.0},
        "c3": {"drag": 9.0}, "c4": {"drag": 0.0}}  # fmt: skip
    asked: list[list[str]] = []

    def by_effect(beyond: Any, shapes: Sequence[Any]) -> dict[str, float]:
        asked.append([shape.effect for shape in shapes])
        return logs[beyond.of[0]]

    monkeypatch.setattr(suspect_answers, "by_effect", by_effect)
    flat = [SimpleNamespace(effect=name) for name in ("drag", "c1", "gear")]
    ranker: Any = Bench(suspects=logs, flat=flat, unsound={"c3"})
    found = [" ".join(h.effects) for h in suspect_answers.beside_constants(ranker)]
    assert found == ["c1 drag", "c2 drag", "c2 gear", "c2 oil", "c1 gear", "c1 oil"]
    assert asked == [["drag", "gear"]] * 3


def _paired(singles: dict[str, float], average: dict[str, float],
    weights: dict[str, float] | None = None) -> tuple[list[Hypothesis], list[str]]:  # fmt: skip
    """Pairs of effects (prior -2 each): their hypotheses, and which of them were refitted."""
    ranker: Any = Bench(weights)
    own = {name: replace(_answer(name, weight), effects=(name,)) for name, weight in singles.items()}
    logs = {tuple(names.split()): value for names, value in average.items()}
    found = ranking._pairs(ranker, own, logs, max(singles.values()))
    return found, ranker.refitted


def test_a_pair_whose_second_effect_adds_nothing_is_not_refitted() -> None:
    """It weighs what its better member does, by the prior of two, and stays behind the best."""
    singles = {"a": 10.0, "b": 4.0, "c": 3.0}
    average = {"a": 12.0, "b": 6.0, "c": 5.0, "a b": 11.5, "a c": 12.0, "b c": 7.0}
    found, refitted = _paired(singles, average)
    told = {" ".join(h.effects): h for h in found}
    assert refitted == ["a c", "b c"]
    assert told["a b"].log_weight == pytest.approx(10.0 + 2.0 - 0.5 - 4.0)
    assert told["a b"].fit is None
    assert told["a c"].log_weight == told["b c"].log_weight == -50.0
    found, refitted = _paired({"b": 10.0, "a": 4.0}, {"a": 6.0, "b": 12.0, "a b": 13.0})
    assert refitted == ["b a"]  # likeliest first, where the search for a start begins


def test_pairs_that_promise_too_little_are_left_out() -> None:
    """By what they promise, 12 behind the best."""
    near = {"a": 10.0, "b": 1.0}
    for gain, pair in ((-9.9, True), (-10.1, False)):
        found, _ = _paired(near, {"a": 12.0, "b": -50.0, "a b": gain + 12.0 - 0.0})
        assert bool(found) == pair


def test_twelve_pairs_are_refitted() -> None:
    names = [f"e{i:02}" for i in range(12)]
    singles = dict.fromkeys(names, 5.0)
    pairs = {f"{a} {b}": 9.0 - 0.01 * i - 0.02 * k for i, a in enumerate(names) for k, b in enumerate(names[i + 1 :])}
    found, refitted = _paired(singles, dict.fromkeys(names, 7.0) | pairs)
    best = sorted(pairs, key=lambda pair: -pairs[pair])
    assert refitted == best[:12]
    assert [" ".join(h.effects) for h in found] == best
    np.testing.assert_allclose([h.log_weight for h in found[12:]], 4.0)  # behind the best, whatever was promised


def _grown(monkeypatch: pytest.MonkeyPatch, missing: bool, singles: dict[str, float], more: dict[str, list[Hypothesis]],
    average: dict[str, float] | None = None) -> tuple[Any, list[Any]]:  # fmt: skip
    """A ranking whose steps give what `more` says, by their names; and what the steps were asked."""
    asked: list[Any] = []

    def step(name: str) -> Any:
        def does(ranker: Any, *given: Any) -> list[Hypothesis]:
            asked.append((name, *given))
            return list(more.get(name, []))

        monkeypatch.setattr(ranking, name, does)

    for name in ("_pairs", "_mishaps", "table_answers", "beside_constants", "expressions", "expression_pairs",
        "neighbours"):  # fmt: skip
        step(name)
    monkeypatch.setattr(ranking, "paying", lambda ranker, found: [h for h in found if "free" not in h.effects])
    monkeypatch.setattr(ranking, "_merged", lambda ranker, found: sorted(found, key=lambda h: -h.log_weight))
    monkeypatch.setattr(ranking, "_largest_first", lambda one: one)
    logs = average or singles
    analysis: Any = SimpleNamespace(missing=missing, fit=SimpleNamespace(effects="present"))
    own = Bench(singles, formulas=["e", "f"], analysis=analysis, screen=lambda: {tuple(n.split()): v for n, v in
        logs.items()}, evidence=SimpleNamespace(nothing=-3.0), catalogue=2, renamed=lambda every: (every, {"E": 1}, {}),
        found=lambda: "found")  # fmt: skip
    monkeypatch.setattr(ranking, "Ranker", lambda analysis, report, before: own if before is None else None)
    found = ranking.rank(analysis)
    return found, asked


def test_everything_that_may_be_missing_is_ranked(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a posterior that sums to one; what pays for nothing is left out, what is twice is once."""
    more = {"_pairs": [_answer("a b", 1.0)], "_mishaps": [Hypothesis((), "run", 0.5, column="seven")],
        "table_answers": [_answer("table", 0.0), _answer("table a", 3.0)], "beside_constants": [_answer("c a", -1.0)],
        "expressions": [_answer("e", 2.0, "expression"), Hypothesis((), "expression", -4.0, column="oil")],
        "expression_pairs": [_answer("e f", -2.0, "expression")],
        "neighbours": [_answer("b a", 4.0), _answer("free", 9.0)]}  # fmt: skip
    found, asked = _grown(monkeypatch, True, {"a": 1.5, "b": 0.25, "a b": 7.0}, more)
    told = [(" ".join(h.effects) or h.kind, h.log_weight) for h in found.hypotheses]
    assert told == [
        ("b a", 4.0), ("table a", 3.0), ("e", 2.0), ("a", 1.5), ("run", 0.5), ("b", 0.25), ("table", 0.0),
        ("c a", -1.0), ("e f", -2.0), ("expression", -4.0), ("nothing", pytest.approx(-3.0 + np.log(0.2))),
    ]  # fmt: skip
    weights = np.exp([h.log_weight for h in found.hypotheses])
    np.testing.assert_allclose(found.posterior, weights / weights.sum())
    assert found.singles.keys() == {"a", "b", "table"}
    assert found.alone.keys() == {"e", "f"}  # what the likeliest hold is fitted alone, too: formulas
    assert (found.expressions, found.found) == ({"E": 1}, "found")
    steps = [name for name, *_ in asked]
    assert steps == ["_pairs", "_mishaps", "table_answers", "beside_constants", "expressions", "expression_pairs",
        "neighbours"]  # fmt: skip
    assert asked[0][3] == 1.5  # the best so far
    assert asked[0][1] is found.singles


def test_where_nothing_is_missing_only_what_is_simple_is_ranked(monkeypatch: pytest.MonkeyPatch) -> None:
    found, asked = _grown(monkeypatch, False, {"a": 1.5}, {"table_answers": [_answer("table", 99.0)]})
    assert [name for name, *_ in asked] == ["_pairs", "_mishaps", "expressions"]
    assert [h.effects for h in found.hypotheses] == [("a",), ()]


def test_an_absurd_effect_hides_no_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    taxed = replace(_answer("huge", 1.0), taxed=MOST_TAX)
    more = {"table_answers": [taxed, replace(_answer("a", 1.0), taxed=MOST_TAX - 0.1)]}
    _, asked = _grown(monkeypatch, True, {"a": 1.5}, more)
    assert {name: given for name, *given in asked}["expressions"] == [["huge"]]


def test_what_takes_most_is_named_first() -> None:
    """Beyond what all other parameters could take: of two that do nearly the same, little; a table's fault first."""
    slopes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.1]])
    fitted = [SimpleNamespace(effect=name) for name in (None, "large", "small", "large")]

    def order(values: list[float], *effects: str) -> tuple[str, ...]:
        own: Any = SimpleNamespace(theta=np.array(values), jacobian=slopes[None], model=SimpleNamespace(fitted=fitted))
        return ranking._largest_first(Hypothesis(effects, "catalogue", 0.0, own)).effects

    assert order([99.0, 90.0, 3.0, 0.0], "small", "large") == ("large", "small")  # 8 and 3 sd are taken
    assert order([99.0, 20.0, 3.0, 0.0], "large", "small") == ("small", "large")  # 2 sd: its other parameter follows
    assert order([99.0, 20.0, 3.0, 0.0], "large", "small", "table.x.sign") == ("table.x.sign", "small", "large")
    assert order([99.0, 20.0, 0.0, 0.0], "large") == ("large",)
    slopes[2, 2] = np.inf  # without a derivative it takes nothing that can be told
    assert order([99.0, 20.0, 3.0, 0.0], "small", "large") == ("large", "small")


def test_the_formulas_of_ten_answers_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    many = [*(_answer(f"s{i}", 20.0 - i) for i in range(9)), _answer("a e", 3.0), _answer("f", 2.0)]
    found, _ = _grown(monkeypatch, True, {}, {"neighbours": many})
    assert list(found.alone) == ["e"]


def _over_time(monkeypatch: pytest.MonkeyPatch, sketches: Sequence[Sketch], doubted: bool = False, dynamics: Any = None,
    whole_runs: bool = False, unsound: str = "") -> list[str]:  # fmt: skip
    """Formulas that are refitted, those of the best motion and of the stated one among them."""
    listed = SimpleNamespace(sketches=sketches, promise=lambda _: -np.arange(float(len(sketches))))
    monkeypatch.setattr(expression_answers, "library", lambda *_: listed)
    monkeypatch.setattr(expression_answers, "doubts", lambda *_: doubted)
    monkeypatch.setattr(expression_answers, "_as_stated", lambda ranker, texts: [_sketch("k*stated")])
    monkeypatch.setattr(
        expression_answers, "_instead", lambda ranker, best, texts: [_sketch(f"k*beside_{best.effects[0][3:-1]}")]
    )
    weights = {f"[{one.text}]": float(i) for i, one in enumerate(sketches)}
    own: Any = Bench(
        weights, base=np.zeros((1, 4, 1)), values=np.zeros((1, 4)), effects={}, model=None, rows=None,
        sigma=np.ones(1), columns_without=lambda names: None, misfit=1.0, catalogue=2, evidence=None,
        analysis=SimpleNamespace(fit=SimpleNamespace(theta=None), residual=np.zeros((1, 4)), missing=True),
        unsound={unsound},
    )  # fmt: skip
    own.case.dynamics, own.case.base.whole_runs = dynamics, whole_runs
    return [h.effects[0] for h in expression_answers.expressions(own) if h.fit is not None]


def test_over_time_formulas_are_looked_for_along_other_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Along the best sound one of equations of the user's own; along the stated one where the fit is in doubt."""
    two = [_sketch("k*a", "a"), _sketch("k*b", "b")]
    both = ["[k*a]", "[k*b]"]
    assert _over_time(monkeypatch, two) == both
    assert _over_time(monkeypatch, two, doubted=True) == [*both, "[k*stated]"]
    assert _over_time(monkeypatch, two, dynamics=object()) == [*both, "[k*beside_b]"]
    assert _over_time(monkeypatch, two, dynamics=object(), unsound="[k*b]") == [*both, "[k*beside_a]"]
    again = [two[0], replace(two[0], scales={"w": SCALE}), two[1]]
    assert _over_time(monkeypatch, again) == ["[k*a]", "[k*a]", "[k*b]"]
    assert _over_time(monkeypatch, again, whole_runs=True) == both  # one start: others are tried in the refit


def test_formulas_weigh_what_they_promise_with_the_prior_of_what_no_catalogue_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[Any] = []
    listed = SimpleNamespace(sketches=[_sketch("k*a", "a")], promise=lambda _: np.array([2.0]))

    def library(*asked: Any) -> Any:
        given.append(asked)
        return listed

    monkeypatch.setattr(expression_answers, "library", library)
    residual = np.array([[2.0, 4.0]])
    own: Any = Bench(
        base=np.zeros((1, 2, 3)), values=np.zeros((1, 2)), effects=dict.fromkeys(("drag", "zero_of_load", "huge")),
        model=None, rows=None, sigma=np.array([2.0]), columns_without=set, misfit=1.0,
        kinds=["catalogue", "fault"], evidence=None,
        analysis=SimpleNamespace(fit=SimpleNamespace(theta=None), residual=residual, missing=False),
    )  # fmt: skip
    [one] = expression_answers.expressions(own, ["huge"])
    assert (one.kind, one.column, one.fit) == ("expression", "a", None)
    assert one.log_weight == pytest.approx(2.0 + np.log(0.54 * 0.35))
    asked = given[0]
    assert (asked[4], asked[7]) == ({"huge", "zero_of_load"}, {"drag", "huge"})
    assert asked[5].shape == (2, 3)
    assert asked[8].tolist() == [[1.0, 2.0]]
    own.kinds, own.case.base.whole_runs = [], True
    [one] = expression_answers.expressions(own)
    assert one.log_weight == pytest.approx(2.0 + np.log(0.54))
    assert given[1][8] is None
    listed.sketches = []
    assert expression_answers.expressions(own) == []


def _moving(effects: str, weight: float, curve: float) -> Hypothesis:
    bound = SimpleNamespace(predict=lambda theta: np.full((1, 4), curve))
    return _answer(effects, weight, model=SimpleNamespace(bind=lambda inputs, rows: bound))


def _body(
    monkeypatch: pytest.MonkeyPatch, *found: Hypothesis, falls: Sequence[str] = ()
) -> tuple[list[str], list[str]]:
    """Answers of a body over time whose neighbours are looked at, and those that were asked whether they stand."""
    nearby = Nearby(monkeypatch)
    ranker: Any = Bench(rows=EVERY, sigma=np.array([0.1]))
    ranker.case.base.whole_runs, ranker.case.inputs = True, None
    asked: list[str] = []

    def stand(ranker: Any, given: Sequence[Hypothesis]) -> list[Hypothesis]:
        asked[:] = [" ".join(h.effects) for h in given]
        return [h for h in given if " ".join(h.effects) not in falls]

    monkeypatch.setattr(closure, "paying", stand)
    _near(ranker, *found)
    assert [line.partition(",")[0] for line in ranker.said] == [  # what takes a while says where it is
        f"what lies next to the best answers: {i + 1}" for i in range(len(nearby.asked))
    ]
    return nearby.asked, asked


def test_of_a_body_what_would_not_stand_has_no_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of sets those that come near the best single one are asked; an answer with the motion of another has the same
    neighbours."""
    found = [_moving("a", 10.0, 0.0), _moving("b", 1.0, 1.0), _moving("a c", 7.01, 2.0), _moving("a d", 7.0, 3.0),
        _moving("e f", 12.0, 4.0)]  # fmt: skip
    looked_at, asked = _body(monkeypatch, *found, falls=["e f"])
    assert asked == ["a", "b", "a c", "e f"]
    assert looked_at == ["a", "a c"]
    assert _body(monkeypatch, *found)[0] == ["e f", "a"]
    least = 0.1 * np.sqrt(closure.SAME / 4.0)
    for apart, same in ((0.99 * least, True), (1.01 * least, False)):
        two = [_moving("a", 10.0, 5.0), _moving("b", 9.9, 5.0 + apart)]
        assert _body(monkeypatch, *two)[0] == (["a"] if same else ["a", "b"])


@pytest.mark.parametrize("signs", [(1.0, 0.0), (-1.0, 1.0)])
def test_a_size_of_one_sign_is_weighed_so_in_runs_drawn_anew(signs: tuple[float, float]) -> None:
    random = np.random.default_rng(3)
    run = np.repeat(np.arange(4), 5)
    residual, base = random.standard_normal((1, 20)), random.standard_normal((1, 20, 2))
    columns, given = random.standard_normal((20, 2)), np.array(signs)
    linear = Linear(residual, base, np.zeros(base.shape[2]), columns, np.zeros(2), given, 0.0)
    sums = resampled.Sums(Runs(run, 1), linear, 3.0, [0])
    evidence = Evidence(Runs(run, 1), residual, base, 3.0, [0])
    expected = evidence.blocks(evidence.gram(columns), np.array([[0, 1]]), given[None])
    assert sums.evidence(np.ones((1, 4)))[0] == pytest.approx(float(expected[0]), abs=1e-6)
