"""Posterior probabilities as rates of being right."""

from __future__ import annotations

from itertools import pairwise

import pytest

from terrapin_tools.workbench.discover.certainty import CEILING, MAP, OUTSIDE, calibrated


@pytest.mark.parametrize("what", MAP)
def test_the_likelier_is_never_said_to_be_the_less_likely(what: str) -> None:
    told = [calibrated(n / 1000.0, what) for n in range(1001)]
    most = OUTSIDE if what == "unexplained" else CEILING
    assert all(0.0 <= first <= other <= most for first, other in pairwise(told))
    assert told[-1] == most


def test_a_claim_has_one_probability_alone_among_others_and_as_a_part() -> None:
    """An effect that is part of what is missing is at least as probable as the answer that is this effect alone."""
    for n in range(1, 100):
        alone, tied, part = (calibrated(n / 100.0, what) for what in ("missing", "ambiguous", "effect"))
        assert alone == tied == part


def test_the_map_as_it_is_fitted() -> None:
    """Answers that it was fitted to said 0.85 on average and were right in 92 %, or 0.35, and 44 %."""
    assert calibrated(0.85) == pytest.approx(0.94, abs=0.01)
    assert calibrated(0.35) == pytest.approx(0.42, abs=0.01)
    assert calibrated(0.85, "mishap") == pytest.approx(0.85)
