"""Fits of bodies over time are ended where they cannot come near, and begin where the same set ended before."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.ranker import Ranker
from terrapin_tools.workbench.model import fitting
from terrapin_tools.workbench.model.fitting import minimise
from tests.python.test_dynamic_cases import cylinder

X = np.linspace(0.0, 1.0, 20)


def bent(theta: Array) -> tuple[Array, Array]:
    """A law that no linear step solves, around data at exp(2 x)."""
    value = np.exp(theta[0] * X)
    return value - np.exp(2.0 * X) - 0.3 * np.sin(9.0 * X), (X * value)[:, None]


@pytest.mark.parametrize(("floor", "most"), [(np.inf, 100), (0.1, 1), (5.0, 100)])
def test_a_fit_ends_where_no_step_promises_to_come_below_a_floor(floor: float, most: int) -> None:
    """What it leaves is about 0.8: out of reach of 0.1, and well below 5."""
    calls: list[Array] = []

    def evaluate(theta: Array) -> tuple[Array, Array]:
        calls.append(theta)
        return bent(theta)

    wide = np.full(1, 9.0)
    start = np.array([2.005])  # nearly there: a step promises 0.08
    free = np.ones(1, dtype=bool)
    theta, cost = minimise(evaluate, lambda t: bent(t)[0], start, -wide, wide, free, floor=floor)
    assert cost <= float((bent(start)[0] ** 2).sum()) + 1e-12
    if most == 1:
        assert len(calls) == 1
        assert theta[0] == start[0]
    else:
        assert np.abs(bent(theta)[1].T @ bent(theta)[0]).max() < 1e-3


def test_from_far_a_fit_that_may_come_below_the_floor_goes_on() -> None:
    wide, free = np.full(1, 9.0), np.ones(1, dtype=bool)
    theta, _ = minimise(bent, lambda t: bent(t)[0], np.array([0.0]), -wide, wide, free, floor=1.0)
    assert abs(theta[0] - 2.0) < 0.1


def test_half_a_turn_of_a_phase_is_the_other_sign() -> None:
    grid = list(product((0.0,), (2.0, 3.0), (-np.pi / 2, 0.0, np.pi / 2, np.pi, 1.5 * np.pi, 2.0 * np.pi)))
    apart, which, sign = fitting._half_turns(grid, (False, False, True))
    assert len(apart) == 4
    for (_, waves, phase), place, way in zip(grid, which, sign, strict=True):
        _, same, half = grid[apart[place]]
        np.testing.assert_allclose(np.sin(waves * X + phase), way * np.sin(same * X + half), atol=1e-12)


def test_a_search_begins_where_the_same_set_ended_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    analysis = analyse(load_case(cylinder(tmp_path / "case", {"speed_squared": {"f_s": 2e-3}}, 2)))
    first = Ranker(analysis, lambda _: None)
    fit = first.fit(("speed_squared",))
    counted: list[int] = []
    whole = fitting.fit_model

    def counting(*given: object) -> object:
        counted.append(len(given[3]))  # type: ignore[arg-type]
        return whole(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("terrapin_tools.workbench.discover.ranker.fit_model", counting)
    again = Ranker(analysis, lambda _: None, first.found()).fit(("speed_squared",))
    assert counted == [1]
    assert again.cost == pytest.approx(fit.cost, abs=0.02)
    np.testing.assert_allclose(again.theta, fit.theta, rtol=1e-2)
