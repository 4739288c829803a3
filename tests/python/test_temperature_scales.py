"""Temperatures of one formula on several scales: a zero that is lost is off by 273 K and no fit says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import terrapin_tools as terrapin
from terrapin_hil.arrays import Array

SCALES = {"degC": lambda t: t, "\u00b0C": lambda t: t, "degF": lambda t: 1.8 * t + 32.0, "K": lambda t: t + 273.15}
W, T = np.random.default_rng(1).uniform((1.0, 10.0), (10.0, 40.0), (120, 2)).T
TORQUE = 1.0 + 0.5 * W + 0.02 * (T - 20.0) + np.random.default_rng(2).normal(0.0, 0.05, 120)
FIT: dict[str, Any] = {"a": (0.0, -99, 99, "N m"), "b": (1.0, -9, 9, "N m s/rad"), "k": (0.0, -1, 1, "N m/K")}


def bench(scale: str, formula: str = "a + b*w + k*(T - T0)", fit: Any = FIT, **more: Any) -> terrapin.Case:
    table = {"run": np.repeat(np.arange(6), 20), "w": W, "T": SCALES[scale](T), "M": TORQUE, **more.pop("columns", {})}
    units = {"w": "rad/s", "T": scale, "M": "N m", **more.pop("units", {})}
    return terrapin.Case.from_table(table, run="run", units=units, equation={"M": formula}, fit=fit, **more)


def close(case: terrapin.Case) -> bool:
    """Whether the fit finds the constant part where the temperatures were made with it."""
    return abs(case.compare().parameters["a"].value - 1.0) < 0.1


@pytest.mark.parametrize("scale", ["degC", "K"])
@pytest.mark.parametrize("reference", ["20 degC", (20.0, "degC"), "68 degF"])
def test_a_reference_is_on_the_scale_of_what_it_is_taken_from(scale: str, reference: Any) -> None:
    assert close(bench(scale, constants={"T0": reference}))


@pytest.mark.parametrize("unit", ["degC", "degreeC", "\u00b0C"])
def test_two_columns_meet_on_one_scale(unit: str) -> None:
    case = bench("degC", columns={"T0": np.full(120, 20.0)}, units={"T0": unit})
    assert close(case)
    assert "counts as a difference" not in str(case.compare())


def test_no_factor_takes_fahrenheit_into_an_equation_in_si() -> None:
    """Its zero was lost: the constant part was off by the rest."""
    for more in ({"constants": {"T0": "68 degF"}}, {"formula": "a + b*w + k*T"}):
        with pytest.raises(terrapin.errors.InputError, match=r"T is in degF, whose zero .*, expected degC"):
            bench("degF", **more)
    plain = {"a": 0.0, "b": 1.0, "k": 0.0}  # numbers as they stand
    assert bench("degF", "a + b*w + k*T", plain).compare().parameters["k"].value == pytest.approx(0.02 / 1.8, rel=0.1)


def test_an_own_effect_takes_the_reference_on_the_scale_of_its_column() -> None:
    warm = terrapin.Effect("warm", "k*(T - T0)", k=(0.0, -1.0, 1.0, "N m/K"))
    case = bench("degC", "a + b*w", {name: FIT[name] for name in "ab"}, constants={"T0": "20 degC"})
    assert close(case.add(warm))


@pytest.mark.parametrize(
    "more",
    [
        {"constants": {"T0": "293.15 K"}},
        {"columns": {"T0": np.full(120, 293.15)}, "units": {"T0": "K"}},
        {"fit": {**FIT, "T0": (283.0, 200.0, 350.0, "K")}},
    ],
)
def test_what_is_in_kelvin_beside_degrees_is_told(more: dict[str, Any]) -> None:
    said = " ".join(str(bench("degC", **more).compare()).split())
    assert "T0 is in K and T, in the same formula, in degC: T0 counts as a difference there." in said


def test_a_width_in_kelvin_is_a_difference_and_nothing_is_said() -> None:
    fit = {"a": FIT["a"], "b": FIT["b"], "tau": (50.0, 1.0, 500.0, "K")}
    assert "counts as a difference" not in str(bench("degC", "a + b*w*exp(-T/tau)", fit).compare())


def test_no_fitted_value_and_no_effect_parameter_is_in_fahrenheit() -> None:
    with pytest.raises(terrapin.errors.InputError, match=r"fit\.T0\.unit: found 'degF', whose zero"):
        bench("degC", fit={**FIT, "T0": (68.0, 0.0, 99.0, "degF")})
    case = bench("degC", "a + b*w", {name: FIT[name] for name in "ab"})
    warm = terrapin.Effect("warm", "k*(T - t0)", k=(0.0, -1.0, 1.0, "N m/K"), t0=(68.0, 0.0, 99.0, "degF"))
    with pytest.raises(terrapin.errors.InputError, match=r"effect\.warm\.t0\.unit: found 'degF', whose zero"):
        case.add(warm)


def test_a_reference_in_degrees_is_no_divisor() -> None:
    with pytest.raises(terrapin.errors.InputError, match=r"T0 is in degC, whose zero .* expected \(T0 \+ 273.15\)"):
        bench("degC", "a + b*w*(T + 273.15)/T0", {name: FIT[name] for name in "ab"}, constants={"T0": "20 degC"})


def heated(scale: str, ambient: Any) -> dict[str, Any]:
    """A body that is heated, C dT/dt = P - h (T - Ta), measured on a scale."""
    time, random, parts = np.arange(0.0, 600.0, 5.0), np.random.default_rng(4), []
    for power in (10.0, 15.0, 20.0, 25.0, 30.0):
        rise: Array = power / 0.5 * (1.0 - np.exp(-time * 0.5 / 90.0))
        parts.append(20.0 + rise + random.normal(0.0, 0.1, time.size))
    table = {
        "run": np.repeat(np.arange(5), time.size), "time": np.tile(time, 5), "Th": SCALES[scale](np.concatenate(parts)),
        "P": np.repeat((10.0, 15.0, 20.0, 25.0, 30.0), time.size),
    }  # fmt: skip
    return terrapin.Case.from_table(
        table, run="run", units={"time": "s", "P": "W", "Th": scale}, states={"T": ("fit", scale)},
        derivative={"T": "(P - h*(T - Ta))/C"}, measured={"Th": "T"}, constants={"C": "90 J/K", "Ta": ambient},
        fit={"h": (0.3, 0.0, 10.0, "W/K")},
    ).compare().parameters  # fmt: skip


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("ambient", ["20 degC", "68 degF"])
def test_an_equation_of_motion_knows_its_surroundings(scale: str, ambient: str) -> None:
    """It was fitted best with no loss at all: 0 W/K, for the surroundings were at 293 degC."""
    assert heated(scale, ambient)["h"].value == pytest.approx(0.5, abs=0.01)


def test_a_unit_that_only_the_caller_says_differs_from_no_heading() -> None:
    """`percent` was told to differ from a heading `1` that nobody wrote."""
    case = bench("degC", "a + b*w + k*(T - T0) + d*p", {**FIT, "d": (0.0, -1, 1, "N m")},
                 constants={"T0": "20 degC"}, columns={"p": 10.0 * T**2}, units={"p": "percent"})  # fmt: skip
    assert "heading says" not in str(case.compare())
