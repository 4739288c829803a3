"""Parameters that data cannot tell apart are named, with the combinations that are determined."""

from __future__ import annotations

import doctest
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare import together as module
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.compare.together import together
from terrapin_tools.workbench.story import sentences
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.told import told
from tests.campaigns import null_directions
from tests.python.casekit import rolling

NUMBERS = list(range(len(null_directions.KNOWN)))


def test_the_examples_hold() -> None:
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize("number", NUMBERS)
def test_known_directions_are_named(tmp_path: Path, number: int) -> None:
    groups = null_directions.draw(number, 1, tmp_path / "case")
    found = together(analyse(load_case(tmp_path / "case")))
    assert sorted("".join(one.parameters) for one in found) == sorted(groups)
    for one in found:  # what is sure lies within 4 sd; how often within 95 % is a rate
        for known in one.determined:
            truth = null_directions.truth(known.formula)
            assert known.near or abs(truth - known.value) < 4.0 * known.sd, (known, truth)


def test_what_is_determined_is_not_named_and_what_is_not_is_told(tmp_path: Path) -> None:
    assert together(analyse(load_case(rolling(tmp_path / "rolling", 8)))) == []
    null_directions.draw(7, 1, tmp_path / "case")  # (a*w + b*t)/c
    story = told(analyse(load_case(tmp_path / "case")))
    (note,) = [note for note in story.notes if "apart" in note]
    assert note.startswith("These data do not tell a, b and c apart; of them they determine a/c = 0.70")
    (tied,) = answer(story)["not_apart"]
    assert list(tied["parameters"]) == ["a", "b", "c"]
    assert [known["formula"] for known in tied["determined"]] == ["a/c", "b/c"]
    assert np.isfinite(tied["determined"][0]["sd"])


def test_what_is_determined_has_its_unit() -> None:
    """`b + 46.98*f_r = 2.2499 +- 0.0018` said nothing of N s/m."""
    both = (module.Determined("b + 46.98*f_r", 2.25, 0.01, near=False), module.Determined("f_r/b", 3.0, 0.1, near=True))
    said = sentences.not_apart(module.Together(("f_r", "b"), both), {"b": "N s/m", "f_r": "1"})
    assert "b + 46.98*f_r = 2.250 ± 0.010 N s/m; f_r/b = 3.00 ± 0.10 m/N/s, near these values." in said
    assert "f_r/b = 3.00 ± 0.10, near" in sentences.not_apart(module.Together(("f_r", "b"), both), {})
    assert doctest.testmod(sentences).failed == 0


@pytest.mark.parametrize("wrong", ["prediction", "derivatives"])
def test_where_the_model_has_no_numbers_the_others_are_not_followed(wrong: str) -> None:
    """The way that was known so far is kept; least squares of no numbers would end the command."""

    class Bound:
        def predict(self, theta: Array) -> Array:
            return np.full((1, 6), theta[0] * theta[1])

        def jacobian(self, theta: Array) -> tuple[Array, Array]:
            derivatives = np.broadcast_to([theta[1], theta[0]], (1, 6, 2)).copy()
            prediction = self.predict(theta)
            if wrong == "prediction":
                prediction[0, 2] = np.nan
            else:
                derivatives[0, 2] = np.inf
            return prediction, derivatives

    fit = SimpleNamespace(theta=np.array([2.0, 3.0]), bound=Bound())
    analysis: Any = SimpleNamespace(fit=fit, noise=SimpleNamespace(sigma=np.array([0.1])))
    moved = module._moved(analysis, np.array([0, 1]), 0, np.array([1]), np.array([-1.5]))
    step = moved[0] - 2.0
    assert step > 0.0
    np.testing.assert_allclose(moved[1], 3.0 - 1.5 * step)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_one_of_the_group_that_is_0_leaves_the_others_uncertainty_as_it_is() -> None:
    """It is no part of what the others determine: no "nan" for its sake, and no warning."""
    value = np.array([2.0, 4.0, 0.0])
    moved = [value * [1.1, 1.1, 1.0]]
    found = module._combination(["a", "b", "c"], value, moved, 0, np.array([1]), np.array([0.5]))
    assert found[0] == "a/b"
    assert found[1] == 0.5
    np.testing.assert_allclose(found[2], [1.0 / 4.0, -2.0 / 16.0, 0.0])
