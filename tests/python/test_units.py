"""The units that need no pint: its own numbers, to the last bit."""

from __future__ import annotations

import random

import pytest

from terrapin_hil.messages import interface
from terrapin_hil.reading import parse_quantity
from terrapin_hil.units import _BASE, _FACTORS, _TO_BASE, base_factor, factor, read_unit, units
from terrapin_tools.workbench.files.units import LARGEST, in_si, quantity, shifted, si_factor


@pytest.mark.parametrize(("given", "unit"), [*_FACTORS, *((unit, unit) for unit in sorted(_BASE))])
def test_a_factor_is_pints(given: str, unit: str) -> None:
    known = factor(given, unit)
    assert known is not None
    draw = random.Random(1)
    for number in [0.0, 1.0, -1.0, 80.0, 14.0, 1e-300, *(draw.uniform(-100.0, 100.0) for _ in range(2000))]:
        pints = float(units().Quantity(number, read_unit(given)).to(read_unit(unit)).magnitude)
        assert pints == number * known
        assert parse_quantity(f"{number!r} {given}", unit) == pints


def test_base_units_are_pints() -> None:
    signals = {signal.unit for message in interface().messages.values() for signal in message.signals}
    for unit in {*signals, *_BASE, *_TO_BASE, *(given for given, _ in _FACTORS)} - {"", "1", "degC"}:
        known = base_factor(unit)
        if known is not None:
            assert known == float(units().Quantity(1.0, read_unit(unit)).to_base_units().magnitude), unit
    assert all(base_factor(unit) is not None for unit in signals - {"", "1", "degC"})


@pytest.mark.parametrize("text", ["1 V", "1 furlong", "1", "1 m m", "1 mm^2"])
def test_what_is_not_in_the_table_is_asked_of_pint(text: str) -> None:
    """A kind of quantity that differs is refused as before; a rarer unit converts."""
    if text == "1 furlong":
        assert parse_quantity(text, "m") == pytest.approx(201.168, rel=1e-5)
    else:
        with pytest.raises(ValueError, match="converts to it"):
            parse_quantity(text, "m")


@pytest.mark.parametrize("text", ["m!", "3!", "N m!!", "kg/m!"])
def test_a_factorial_is_no_unit(text: str) -> None:
    with pytest.raises(ValueError, match="found !"):
        read_unit(text)


@pytest.mark.parametrize("value", [10**400, -(10**400), float("nan"), float("inf"), 2.0 * LARGEST, "nan m", "1e999 m"])
def test_what_is_no_finite_number_is_refused(value: float | str) -> None:
    with pytest.raises(ValueError, match="expected a finite number below"):
        quantity(value, "m")


def test_the_coherent_unit_of_the_same_kind() -> None:
    given = ("m", "mm", "rpm", "kPa", "degC", "celsius", "", " ")
    assert [in_si(unit) for unit in given] == ["m", "m", "rad/s", "kg/m/s^2", "degC", "degC", "", ""]


@pytest.mark.parametrize(
    ("unit", "factor"), [("degF", 5 / 9), ("degreeC", 1.0), ("delta_degF", 5 / 9), ("degR", 5 / 9)]
)
def test_a_temperature_scale_is_scaled_as_a_difference_and_its_zero_is_told(unit: str, factor: float) -> None:
    """A scale in kelvin steps with another zero is no SI unit, though its factor is 1."""
    assert si_factor(unit) == pytest.approx(factor, rel=1e-12)
    assert in_si(unit) == "K"
    assert shifted(unit) == (unit in ("degF", "degreeC"))
