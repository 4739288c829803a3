"""What speaks against an answer about differential equations of the user's own."""

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
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.model import Bound
from terrapin_tools.workbench.story.told import found_by
from tests.python.test_ode import CUBIC, TEXT, spring

FREE = TEXT.replace(", sigma = 5.0", "")


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
