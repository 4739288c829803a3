"""Which answers have neighbours that are refitted (discover/closure.py), and which stand (expression_answers.py)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_tools.workbench.discover import closure, expression_answers
from terrapin_tools.workbench.discover.ranker import Hypothesis


def _answer(name: str, weight: float, predicted: float) -> Hypothesis:
    bound = SimpleNamespace(predict=lambda theta: np.full((1, 2), predicted))
    fit: Any = SimpleNamespace(model=SimpleNamespace(bind=lambda inputs, rows: bound, fitted=()), theta=np.zeros(0))
    return Hypothesis((*name,), "catalogue", weight, fit)


@pytest.mark.parametrize(
    ("whole_runs", "dynamics", "looked_at"),
    [
        # of a body over time: not ab, which held-out runs do not let stand, nor b, which predicts what a does
        (True, None, ["a", "c"]),
        (True, "x' = x", ["ab"]),  # equations of the user's own
        (False, None, ["ab"]),
    ],
)
def test_what_stands_and_is_no_twin_of_another_has_neighbours(
    monkeypatch: pytest.MonkeyPatch, whole_runs: bool, dynamics: str | None, looked_at: list[str]
) -> None:
    found = [_answer("ab", 5.0, 9.0), _answer("a", 0.0, 1.0), _answer("b", -1.0, 1.9), _answer("c", -2.5, 2.1)]
    found.append(Hypothesis((), "nothing", -50.0, None))
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=whole_runs), dynamics=dynamics, inputs={})
    ranker: Any = SimpleNamespace(
        case=case, rows=np.ones(2, dtype=bool), sigma=np.ones(1), sketches={}, faults={}, report=lambda _: None
    )
    centres: list[str] = []

    def next_to(_: object, centre: Hypothesis) -> list[tuple[str, ...]]:
        centres.append("".join(centre.effects))
        return []

    monkeypatch.setattr(closure, "_next_to", next_to)
    monkeypatch.setattr(closure, "paying", lambda _, known: [h for h in known if h.effects != ("a", "b")])
    assert closure.neighbours(ranker, found) == []
    assert centres == looked_at


@pytest.mark.parametrize(
    ("whole_runs", "numbers", "paid", "kept"),
    [
        (True, 3, False, ["gear"]),  # a size and a reference beside an effect that has a size alone
        (True, 3, True, ["line", "gear"]),
        (True, 2, False, ["line", "gear"]),  # no more numbers than the effect
        (False, 3, False, ["line", "gear"]),
    ],
)
def test_a_formula_of_a_body_with_a_number_more_pays_beside_the_best_effect(
    monkeypatch: pytest.MonkeyPatch, whole_runs: bool, numbers: int, paid: bool, kept: list[str]
) -> None:
    line, gear = (SimpleNamespace(theta=np.zeros(count)) for count in (numbers, 2))
    found: Any = [Hypothesis(("gear",), "catalogue", -9.0, gear), Hypothesis(("line",), "expression", 0.0, line)]  # type: ignore[arg-type]
    asked: list[object] = []

    def pays(_: object, longer: object, shorter: object) -> bool:
        asked.append((longer, shorter))
        return paid

    monkeypatch.setattr(expression_answers, "_best_heldout", lambda *_: [gear])
    monkeypatch.setattr(expression_answers, "pays", pays)
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=whole_runs), dynamics=None)
    analysis = SimpleNamespace(noise=SimpleNamespace(known=np.ones(1, dtype=bool)))
    ranker: Any = SimpleNamespace(case=case, analysis=analysis, sketches={"line": None})
    assert [h.effects[0] for h in expression_answers.paying(ranker, found)] == kept
    assert asked == ([(line, gear)] if whole_runs and numbers == 3 else [])
