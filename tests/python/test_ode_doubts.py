"""What speaks against an answer: parameters pulled beyond their bounds; over time, more than its rows scatter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover import discovery, expression_answers, ranker
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.discover.leftover import Doubts, doubts
from terrapin_tools.workbench.discover.ranker import Ranker
from terrapin_tools.workbench.formulas.expressions import Sketch
from terrapin_tools.workbench.formulas.vocabulary import Scale
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.model import Bound
from terrapin_tools.workbench.story.sentences import unsure
from terrapin_tools.workbench.story.told import found_by
from tests.python.test_ode import CUBIC, TEXT, spring

FREE = TEXT.replace(", sigma = 5.0", "")


def test_a_parameter_that_wants_to_leave_its_bounds_is_told_in_any_model(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    load, speed = random.uniform(20.0, 60.0, 160), random.uniform(0.2, 3.0, 160)
    pull = 0.4 * load - 1.0 * speed + 0.5 * random.standard_normal(160)
    rows = (f"r{i // 20},{a:.5g},{v:.5g},{p:.5g}" for i, (a, v, p) in enumerate(zip(load, speed, pull, strict=True)))
    (tmp_path / "runs.csv").write_text("\n".join(["run,load,speed,pull", *rows]) + "\n")
    case = """[model]
base = "equation"
[model.equation]
pull = "mu*load + drag*speed"
[fit]
mu = { value = 0.3, min = 0.0 }
drag = { value = 1.0, min = LEAST }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
load = { column = "load", unit = "N" }
speed = { column = "speed", unit = "m/s" }
pull = { column = "pull", unit = "N", sigma = 0.5 }
"""
    for least, pulled in (("0.0", ("drag",)), ("-5.0", ())):
        (tmp_path / "case.toml").write_text(case.replace("LEAST", least))
        found = analyse(load_case(tmp_path))
        said = doubts(found, found.fit)
        assert (said.at_bound, dict(said.restless)) == (pulled, {})


def test_a_law_that_is_sharper_than_any_that_was_looked_at_is_not_sure(tmp_path: Path) -> None:
    """The scale of a friction stood at its bound, and that nothing else was missing had 0.99."""
    for narrowest, sharp in ((0.3, True), (0.01, False)):
        case = load_case(spring(tmp_path / str(narrowest), more="2*tanh(v/0.1)"))
        weighing = Ranker(analyse(case), lambda _: None)
        scale = Scale(1.0, narrowest, 3.0, "m/s")
        name = weighing.expression(Sketch("k*tanh(v/w)", "derivative.v", "v", {"w": scale}, 0.01))
        fit = weighing.weighed((name,)).fit
        assert fit is not None
        said = doubts(weighing.analysis, fit)
        assert said.at_bound == ((f"{name}.w",) if sharp else ())
        assert bool(said) == sharp
        (line,) = unsure(said.at_bound, {}, {name: "k*tanh(v/w) in derivative.v"}) or ("",)
        assert line.startswith("w of k*tanh(v/w) in derivative.v stands at the end") == sharp


@pytest.mark.parametrize(
    ("text", "cubic", "at_bound", "restless"),
    [
        (FREE, 0.0, (), False),
        (FREE.replace("max = 50.0", "max = 7.0"), 0.0, ("k",), True),
        (FREE, CUBIC, (), True),
        (TEXT, CUBIC, (), False),  # the sd is stated, and an error in it says enough
    ],
)
def test_what_speaks_against_a_fit(
    text: str, cubic: float, at_bound: tuple[str, ...], restless: bool, tmp_path: Path
) -> None:
    """A parameter that the data pull beyond its bound, and far more than the scatter from row to row."""
    found = analyse(load_case(spring(tmp_path / "case", cubic=cubic, text=text)))
    said = doubts(found, found.fit)
    assert said.at_bound == at_bound
    assert list(said.restless) == ["position"] * restless


def test_a_doubted_answer_is_not_sure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And it says why; test_discover_add_compare has the same answer without a doubt."""
    monkeypatch.setattr(discovery, "doubts", lambda *_: Doubts(("k",), {"position": 4.6}))
    doubted = discover(load_case(spring(tmp_path / "case", cubic=CUBIC)))
    assert doubted.verdict == "missing"
    assert doubted.answer_probability == discovery.DOUBTED
    remarks = found_by(doubted).remarks
    assert [one.split()[0] for one in remarks[-2:]] == ["k", "position:"]
    assert "4.6 times" in remarks[-1]


def test_a_doubted_fit_is_left_for_the_stated_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Terms are weighed along the motion of these, too, and refits begin there: the fit may be no spring any more."""
    text = FREE.replace("max = 50.0", "max = 7.0")
    found = analyse(load_case(spring(tmp_path / "case", cubic=CUBIC, text=text)))
    asked: list[list[Array]] = []
    extend = ranker.extend

    def noted(
        parent: Fit, name: str, bound: Bound, values: Array, sigma: Array, starts: list[Array], aim: float
    ) -> Fit:
        asked.append(starts)
        return extend(parent, name, bound, values, sigma, starts, aim)

    monkeypatch.setattr(ranker, "extend", noted)
    ranked = Ranker(found, lambda _: None)
    tried: set[tuple[str, str]] = set()
    sketches = expression_answers._as_stated(ranked, tried)
    assert ("derivative.v", "k_*x**3") in tried
    assert not set(tried) & {(s.target, s.text) for s in expression_answers._as_stated(ranked, tried)}
    ranked.fit((ranked.expression(sketches[0]),))
    np.testing.assert_array_equal([starts[-1][:2] for starts in asked], [[0.3, 6.0]])
