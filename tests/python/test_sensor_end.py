"""A sensor that stands at the end of its range in many rows: told, for a knee that it makes looks like physics."""

from __future__ import annotations

import numpy as np
import pytest

import terrapin_tools as terrapin
from terrapin_hil.arrays import Array

SAID = "stands at"


def torque(seed: int = 0) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    w = random.uniform(1.0, 10.0, 240)
    return w, 1.0 + 0.5 * w + random.normal(0.0, 0.1, 240)


def told(w: Array, measured: Array) -> str:
    table = {"run": np.repeat(np.arange(6), 40), "w [rad/s]": w, "M [N m]": measured}
    fit = {"a": (0.0, None, None, "N m"), "b": (1.0, None, None, "N m s/rad")}
    case = terrapin.Case.from_table(table, run="run", equation={"M": "a + b*w"}, fit=fit)
    return " ".join(str(case.compare()).split())


@pytest.mark.parametrize("top", [5.0, 4.5])
def test_a_ceiling_in_many_rows_is_told(top: float) -> None:
    """With more than a tenth of the rows there nothing was left out, nor said."""
    w, measured = torque()
    rows = (measured >= top).sum()
    said = told(w, np.minimum(measured, top))
    assert f"M stands at {top:g} N m, its greatest number, in {rows} of 240 rows: if its sensor ends there" in said


def test_a_floor_is_told() -> None:
    w, measured = torque()
    assert "its least number, in" in told(w, np.maximum(measured, 3.0))


def test_what_is_left_out_is_told_once() -> None:
    w, measured = torque()
    assert SAID not in told(w, np.minimum(measured, 5.9))


@pytest.mark.parametrize("kind", ["whole", "coarse", "rest", "two"])
def test_what_has_no_end_is_not_told(kind: str) -> None:
    """Not noise, not a coarse instrument, not a drive that rests at 0, not a switch."""
    w, measured = torque()
    given = {
        "whole": measured,
        "coarse": np.round(measured),
        "rest": np.where(w < 4.0, 0.0, measured),
        "two": np.where(measured > 3.5, 1.0, 2.0) + 0.0,
    }
    assert SAID not in told(w, given[kind])
