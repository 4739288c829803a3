"""What a fit and the shapes of an effect do step by step, on models of one line: which start is kept, when a search
ends, how far a shape is looked at."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.model import effect_columns, fitting
from terrapin_tools.workbench.model.fitting import minimise
from terrapin_tools.workbench.model.usual_sizes import usual_size

ROWS = np.linspace(0.1, 1.0, 7)


class _Found:
    """In place of a search: each start ends where it began, at the cost that stands in it."""

    asks = False
    aim = floor = np.inf

    def __init__(self, *_: object) -> None:
        pass

    def minimum(self, start: Array, _: Array) -> tuple[Array, float]:
        return start, float(start[1])

    def evaluate(self, theta: Array) -> tuple[Array, Array]:
        return np.zeros(6), np.zeros((6, len(theta)))


@pytest.mark.parametrize(
    ("costs", "best"),
    [
        ((4.0, 5.0, 7.0), 0),
        ((5.0, 4.0, 7.0), 1),
        ((7.0, 5.0, 4.0), 2),
        ((5.0, 5.0, 5.0), 0),
        ((5.0, 5.0 - 1e-13, 6.0), 0),
    ],
)  # fmt: skip
def test_of_several_starts_the_least_cost_is_kept_of_equals_the_first(
    monkeypatch: pytest.MonkeyPatch, costs: tuple[float, ...], best: int
) -> None:
    monkeypatch.setattr(fitting, "_Problem", _Found)
    fitted = [SimpleNamespace(whole=False, key=name, unit="1", lower=-9.0, upper=9.0) for name in ("place", "cost")]
    wide = np.full(2, 9.0)
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=False))
    model = SimpleNamespace(fitted=fitted, start=np.zeros(2), lower=-wide, upper=wide, case=case)
    starts = [np.array([float(place), cost]) for place, cost in enumerate(costs)]
    bound: Any = SimpleNamespace(model=model)
    monkeypatch.setattr(fitting, "is_phase", lambda _: False)
    fit = fitting.fit_model(bound, np.zeros((2, 3)), np.ones(2), starts)
    assert fit.theta[0] == best
    assert fit.jacobian.shape == (2, 3, 2)


@pytest.mark.parametrize(
    ("costs", "followed"),
    [
        ((4.0, 9.0, 5.0), [0, 2]),  # the second sends the body off, and the first led below the cost without it
        ((9.0, 4.0, 5.0), [0, 1, 2]),  # before any start has led somewhere each is followed
        ((7.0, 9.0, 5.0), [0, 1, 2]),
    ],
)
def test_a_start_that_sends_a_body_off_is_left_where_another_leads_somewhere(
    monkeypatch: pytest.MonkeyPatch, costs: tuple[float, ...], followed: list[int]
) -> None:
    seen: list[int] = []

    class Far(_Found):
        def nearer(self, start: Array, size: int, cost: float) -> tuple[Array, bool]:
            assert (size, cost) == (1, 6.0)
            return start, start[1] != 9.0

        def minimum(self, start: Array, free: Array) -> tuple[Array, float]:
            seen.append(int(start[0]))
            return super().minimum(start, free)

    monkeypatch.setattr(fitting, "_Problem", Far)
    monkeypatch.setattr(fitting, "is_phase", lambda _: False)
    fitted = [SimpleNamespace(whole=False, key=name, unit="1", lower=-9.0, upper=9.0) for name in ("place", "cost")]
    wide = np.full(2, 9.0)
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=False))
    bound: Any = SimpleNamespace(model=SimpleNamespace(fitted=fitted, start=np.zeros(2), lower=-wide, upper=wide,
        case=case))  # fmt: skip
    starts = [np.array([float(place), cost]) for place, cost in enumerate(costs)]
    fitting.fit_model(bound, np.zeros((2, 3)), np.ones(2), starts, absent=(1, 6.0))
    assert seen == followed


def test_three_steps_that_gain_next_to_nothing_end_a_search() -> None:
    """A valley that promises all and falls by 2e-7 of the cost at each step: more than is enough, less than 1e-6."""
    points: list[float] = []

    def residual(theta: Array) -> Array:
        return np.array([1.0 + 1e-7 * theta[0]])

    def evaluate(theta: Array) -> tuple[Array, Array]:
        points.append(theta[0])
        return residual(theta), np.array([[1.0]])

    wide, free = np.full(1, 1e6), np.ones(1, dtype=bool)
    theta, _ = minimise(evaluate, residual, np.array([0.0]), -wide, wide, free)
    assert points == pytest.approx([0.0, -1.0, -2.0], abs=0.01)
    assert theta[0] == pytest.approx(-3.0, abs=0.01)


@pytest.mark.parametrize("maximum", [1e-6, 0.5, 1.0, 400.0, 1e6, np.inf])
def test_a_shape_is_what_a_small_size_does_within_its_range(monkeypatch: pytest.MonkeyPatch, maximum: float) -> None:
    """Of an addition exp(size) - 1, which is a line near 0 alone."""
    sizes: list[float] = []

    def beside(_: object, theta: Array, asked: list[tuple[Any, Array]], rows: Array) -> list[Array]:
        [(_, sets)] = asked
        sizes.extend(sets[:, 0])
        return [np.expm1(sets[:, 0])[:, None, None] * ROWS[None, None, :]]

    monkeypatch.setattr(effect_columns, "beside", beside)
    monkeypatch.setattr(effect_columns, "is_phase", lambda _: False)
    size = SimpleNamespace(minimum=0.0, maximum=maximum, start=0.0, unit="1", lower=0.0, upper=maximum, grid=())
    effect: Any = SimpleNamespace(name="bent", parameters=(size,))
    model: Any = None
    rows = np.ones(len(ROWS), dtype=bool)
    [shape] = effect_columns.shapes_of(model, np.zeros(0), effect, rows, np.ones(1))
    assert all(0.0 <= size <= maximum for size in sizes)
    assert shape.scale == pytest.approx(1.0 / np.sqrt((ROWS * ROWS).mean()), rel=1e-3)
    assert shape.upper == pytest.approx(maximum / shape.scale)


@pytest.mark.parametrize(
    ("usual", "size"),
    [
        ("0.1*k*w", 8.0),
        ("-0.1*k*w", 8.0),
        ("f/k", 1.5),
        ("", None),
        ("0.1*other", None),
        ("k*0", None),
        ("w/zero", None),
    ],
)
def test_a_usual_size_is_that_of_the_case_s_largest_numbers(usual: str, size: float | None) -> None:
    case: Any = SimpleNamespace(
        fit={"k": SimpleNamespace(value=2.0)}, parameters={"zero": 0.0}, roles={"w": np.array([10.0, -40.0])},
        channels={"f": np.array([-3.0, 1.0])},
    )  # fmt: skip
    effect: Any = SimpleNamespace(usual=usual)
    found = usual_size(effect, case)
    assert found == (None if size is None else pytest.approx(size))
