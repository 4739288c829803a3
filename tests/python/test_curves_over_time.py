"""A law of own equations that no formula holds: it is a curve of a state, and what stands beside it is known."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover import ranking
from terrapin_tools.workbench.discover.curves_over_time import LONGEST, curved, curves_over_time
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.discover.leftover import sd_of
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker
from terrapin_tools.workbench.formulas.expressions import Sketch
from terrapin_tools.workbench.formulas.free_curves import ROUGH, WAVES, Curve, Waves
from terrapin_tools.workbench.story.answer import answer, read
from terrapin_tools.workbench.story.terminal import tell
from terrapin_tools.workbench.story.told import told
from tests.python.test_ode import spring

FORMULAS = {"v": ["k*v*abs(v)"], "x": ["k*x*abs(x)", "k*x**3"]}


def searched(folder: Path, law: str) -> tuple[Ranker, Hypothesis, list[Hypothesis], dict[str, Curve]]:
    """A spring that lacks a law, the answer of all FORMULAS, what is weighed with a curve along its motion, and the
    curves."""
    ranker = Ranker(analyse(load_case(spring(folder / "case", more=f"({law})"))), lambda _: None)
    sketches = [Sketch(text, "derivative.v", c, {}, 0.01) for c, texts in FORMULAS.items() for text in texts]
    answer = ranker.weighed(tuple(map(ranker.expression, sketches)))
    found, curves = curves_over_time(ranker, [answer])
    return ranker, answer, found, dict(curves)


def found_in(folder: Path, law: str, formulas: Sequence[tuple[str, str]], patch: pytest.MonkeyPatch) -> Discovery:
    """What discover says where its search, which takes a while, comes upon these formulas: columns and texts."""

    def expressions(ranker: Ranker, absurd: Collection[str]) -> list[Hypothesis]:
        sketches = [Sketch(text, "derivative.v", c, {}, 0.01) for c, text in formulas]
        return [ranker.weighed(tuple(map(ranker.expression, sketches)))]

    patch.setattr(ranking, "expressions", expressions)
    for name in ("expression_pairs", "neighbours", "table_answers", "beside_constants"):
        patch.setattr(ranking, name, lambda *_: [])
    return discover(load_case(spring(folder / "case", more=f"({law})")))


def says(ranker: Ranker, one: Hypothesis) -> list[str]:
    return [ranker.sketches[name].text for name in one.effects]


def test_a_curve_takes_the_place_of_formulas_that_imitate_it(tmp_path: Path) -> None:
    """x*abs(x) and x**3 are pieces of a wave of the length; the drag beside it is what it is."""
    ranker, answer, found, curves = searched(tmp_path, "1.5*sin(5*x) + 0.8*v*abs(v)")
    best = max(found, key=lambda h: h.log_weight)
    assert best.log_weight > answer.log_weight + 10.0
    assert (best.kind, best.column, says(ranker, best)) == ("part", "x", FORMULAS["v"])
    assert best.fit is not None
    assert curved(best.fit)
    at = next(i for i, f in enumerate(best.fit.model.fitted) if f.effect in best.effects)
    assert best.fit.theta[at] == pytest.approx(-0.8 / 1.3, rel=0.05)
    sd = sd_of(ranker.analysis, best.fit)[at]  # with the curve free, not held
    assert abs(best.fit.theta[at] + 0.8 / 1.3) < 3.0 * sd < 0.1
    assert best.fit.cost < ranker.fits[frozenset(answer.effects)].cost
    curve = curves["x"]
    assert (curve.channel, curve.channel_unit, curve.by) == ("derivative.v", "m/s**2", "")
    x, y, width = (np.array(values) for values in (curve.x, curve.y, curve.sd))
    own = np.stack([np.ones_like(x), x], axis=1)  # what the spring may hold is no part of the picture
    truth = -1.5 / 1.3 * np.sin(5.0 * x)
    gap = y - truth - own @ np.linalg.lstsq(own, y - truth, rcond=None)[0]
    middle = np.abs(x) < 0.8 * np.abs(x).max()
    assert np.sqrt(np.mean(gap[middle] ** 2)) < 0.2 * np.std(truth)
    assert np.median(width) < 0.2 * np.std(truth)


def test_it_is_told_with_what_stands_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    formulas = [("v", "k*v*abs(v)"), ("x", "k*x*abs(x)"), ("x", "k*x**3")]
    found = found_in(tmp_path, "1.5*sin(5*x) + 0.8*v*abs(v)", formulas, monkeypatch)
    assert (found.verdict, len(found.missing)) == ("partial", 1)
    assert found.answer_probability > 0.9
    story = told(found.analysis, found)
    said = " ".join(tell(story).split())
    assert "the model lacks k*v*abs(v) in derivative.v, and lacks something that depends on x, and no formula" in said
    assert "in derivative.v it makes" in said
    assert "Together they take 100 % of the misfit and leave 1." in said or "leave 0.9" in said
    assert "k*v*abs(v) in derivative.v + a curve in x" in said
    assert found.part is not None
    assert found.part.left == pytest.approx(1.0, abs=0.1)
    kept = read(json.loads(json.dumps(answer(story))))
    assert kept.part is not None
    assert kept.part.together
    assert kept.unknown == found.unknown


def test_a_curve_alone_is_unexplained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = found_in(tmp_path, "1.5*sin(5*x)", [("x", "k*x*abs(x)"), ("x", "k*x**3")], monkeypatch)
    assert (found.verdict, found.missing) == ("unexplained", ())
    assert found.unknown is not None
    assert (found.unknown.column, found.unknown.channel) == ("x", "derivative.v")
    said = " ".join(tell(told(found.analysis, found)).split())
    assert "the model lacks something that depends on x, and no formula is known for it: in derivative.v" in said


def test_a_law_that_is_a_formula_has_no_curve_beside_it(tmp_path: Path) -> None:
    _, answer, found, _ = searched(tmp_path, "2*x*abs(x) + 3*x**3 + 0.8*v*abs(v)")
    assert max((h.log_weight for h in found), default=-np.inf) < answer.log_weight


def test_a_curve_is_a_formula_whatever_its_column_is_called() -> None:
    """Nine waves of a long name are within what a formula may have, and are the curve's."""
    random = np.random.default_rng(4)
    names = [f"c{i}" for i in range(WAVES)]
    for power in ROUGH:
        values = random.uniform(-12345.678, -12000.0, 60)
        waves = Waves("a" * LONGEST, "", values, np.ones(60), power)
        sizes = random.standard_normal(WAVES)
        given = {"a" * LONGEST: values, **dict(zip(names, waves.cosines(sizes), strict=True))}
        found = parse(waves.formula(names)).evaluate(given)
        np.testing.assert_allclose(found, waves.at(values) @ sizes, atol=1e-3)


def test_where_nothing_is_missing_no_curve_is_weighed(tmp_path: Path) -> None:
    ranker = Ranker(analyse(load_case(spring(tmp_path / "case"))), lambda _: None)
    assert curves_over_time(ranker, []) == ([], {})
