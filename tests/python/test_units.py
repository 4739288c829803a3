"""The units that need no pint: its own numbers, to the last bit."""

from __future__ import annotations

import random
import re
from contextlib import nullcontext
from typing import Any

import pytest

from terrapin_hil.messages import interface
from terrapin_hil.reading import parse_quantity
from terrapin_hil.units import _BASE, _FACTORS, _TO_BASE, base_factor, factor, read_unit, same_kind, units
from terrapin_tools.workbench.files.units import (
    LARGEST,
    check,
    convert,
    convert_difference,
    in_si,
    in_words,
    quantity,
    shifted,
    si_factor,
    turns,
)
from terrapin_tools.workbench.new_case.from_tables import split_unit


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
    given = ("m", "N m", "mm", "rpm", "kPa", "degC", "celsius", "", " ")
    assert [in_si(unit) for unit in given] == ["m", "N m", "m", "rad/s", "kg/m/s^2", "degC", "degC", "", ""]


@pytest.mark.parametrize("text", ["m**2**2", "s^9^9^9", "m^x", "(((m^2)^2)^2)^2"])
def test_powers_of_powers_are_no_unit(text: str) -> None:
    with pytest.raises(ValueError, match="expected powers such as"):
        read_unit(text)


@pytest.mark.parametrize("text", ["blub", "m blub^2"])
def test_what_pint_does_not_know_is_told_in_its_words(text: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(repr(text))} is not a unit: 'blub' is not defined"):
        read_unit(text)


@pytest.mark.parametrize("unit", ["degC", "celsius", " degC "])
def test_a_formula_knows_degrees_as_they_are(unit: str) -> None:
    assert si_factor(unit) == 1.0
    assert not shifted(unit)


def test_a_difference_is_scaled_and_never_shifted() -> None:
    assert convert_difference(9.0, "degF", "degC") == pytest.approx(5.0, rel=1e-12)
    assert convert_difference(3.0, "mm", "m") == pytest.approx(3e-3, rel=1e-12)


@pytest.mark.parametrize(("unit", "to"), [("m", "s"), ("degC", "m"), ("dBm", "m"), ("delta_degF", "degC"), ("1", "m")])
def test_another_kind_does_not_convert(unit: str, to: str) -> None:
    with pytest.raises(ValueError, match=f"'{unit}' does not convert to '{to}'"):
        convert(1.0, unit, to)


def test_the_largest_number_is_one() -> None:
    assert quantity(LARGEST, "m") == quantity(f"{LARGEST} m", "m") == LARGEST


@pytest.mark.parametrize("text", ["fast m", "", "1,5 m", "m"])
def test_what_begins_with_no_number_is_told(text: str) -> None:
    with pytest.raises(ValueError, match="expected a number, a space and a unit"):
        quantity(text, "m")


def test_a_number_alone_has_the_unit_1() -> None:
    assert quantity("3", "1") == 3.0
    with pytest.raises(ValueError, match="'1' does not convert to 'm'"):
        quantity("3", "m")


@pytest.mark.parametrize(
    ("unit", "factor"), [("degF", 5 / 9), ("degRe", 1.25), ("degreeC", 1.0), ("delta_degF", 5 / 9), ("degR", 5 / 9)]
)
def test_a_temperature_scale_is_scaled_as_a_difference_and_its_zero_is_told(unit: str, factor: float) -> None:
    """By whichever of its names, degC is what formulas know, and a scale with another zero is taken to it."""
    assert si_factor(unit) == pytest.approx(factor, rel=1e-12)
    assert in_si(unit) == ("degC" if unit in ("degF", "degRe", "degreeC") else "K")
    assert shifted(unit) == (unit in ("degF", "degRe"))


@pytest.mark.parametrize(
    ("unit", "known"), [("mN m", True), ("1/min", True), ("", True), ("furlongz", False), ("N*", False)]
)
def test_a_unit_is_checked_before_anything_is_made_of_it(unit: str, known: bool) -> None:
    with nullcontext() if known else pytest.raises(ValueError, match=re.escape(unit)):
        check(unit)


@pytest.mark.parametrize(
    ("raised", "plain"),
    [("m\u00b2", "m**2"), ("s\u207b\u00b9", "1/s"), ("kg m\u00b2/s\u00b3", "kg*m**2/s**3"), ("m\u00b9\u00b2", "m**12"),
     ("N m^2", "N*m**2")],
)  # fmt: skip
def test_raised_digits_are_powers(raised: str, plain: str) -> None:
    assert read_unit(raised) == read_unit(plain)


def test_two_groups_have_powers_and_no_third() -> None:
    """Each of them multiplies all that it holds: groups in groups would be worked out for ever."""
    assert read_unit("(m/s)^2*(kg/m)^2") == read_unit("kg**2/s**2")
    with pytest.raises(ValueError, match="expected powers"):
        read_unit("(m/s)^2*(kg/m)^2*(A)^2")


@pytest.mark.parametrize("value", [True, False])
def test_yes_and_no_are_no_numbers(value: bool) -> None:
    with pytest.raises(ValueError, match="expected a number, or text with a unit"):
        quantity(value, "m")


@pytest.mark.parametrize("text", ["g # x", "m!", "g, m", "N;", "m = 1"])
def test_what_a_parser_would_pass_over_is_no_unit(text: str) -> None:
    """A mass of "90 g # x" was 90 g, and `g, m` a product."""
    with pytest.raises(ValueError, match=r"is not a unit: found [#!,;=]$"):
        read_unit(text)


def test_a_unit_that_is_none_is_refused_with_a_reason() -> None:
    """In one line that is not as long as the text was; also where pint ends without a word."""
    with pytest.raises(ValueError, match=r"^'&/' is not a unit: \w+") as refused:
        read_unit("&/")
    assert "\n" not in str(refused.value)
    with pytest.raises(ValueError, match="longer than 100 characters") as refused:
        read_unit("m*" * 50 + "m")
    assert len(str(refused.value)) < 100
    assert read_unit("m*" * 49 + "kg") == read_unit("m^9.8") ** 5 * read_unit("kg")


def test_exponents_agree_to_a_millionth() -> None:
    assert same_kind("m^0.9700009", "m^0.97")
    assert not same_kind("m^0.000001", "1")


@pytest.mark.parametrize("value", [True, None, [1.0], {"m": 1.0}])
def test_what_is_neither_a_number_nor_text_is_no_quantity(value: Any) -> None:
    with pytest.raises(ValueError, match="expected a number, or text with a unit"):
        quantity(value, "m")


@pytest.mark.parametrize("unit", ["%", "mm/m", "deg/rad"])
def test_a_share_is_one_in_si(unit: str) -> None:
    assert in_si(unit) == "1"


@pytest.mark.parametrize(("unit", "other"), [("m", "1"), ("m s", "s"), ("N m", "N"), ("m", "m^2"), ("rad m", "s")])
def test_a_dimension_more_is_another_kind(unit: str, other: str) -> None:
    assert not same_kind(unit, other)
    assert not same_kind(other, unit)


@pytest.mark.parametrize(
    ("unit", "watts"), [("PS", 735.49875), ("CV", 735.49875), ("hp", 745.69987), ("HP", 745.69987)]
)
def test_horsepower_as_sheets_print_it_is_a_power(unit: str, watts: float) -> None:
    """PS was read as petasiemens, which converts to no power."""
    assert quantity(f"2 {unit}", "W") == pytest.approx(2.0 * watts, rel=1e-8)
    assert split_unit(f"P [{unit}]") == ("P", unit)


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("Zeit in Sekunden", "Zeit", "s"),
        ("Kraft [Newton]", "Kraft", "N"),
        ("Weg (Millimeter)", "Weg", "mm"),
        ("speed, metres per second", "speed", "m/s"),
        ("a in metres per second squared", "a", "m/s^2"),
        ("M / Millinewtonmeter", "M / Millinewtonmeter", ""),
        ("Drehzahl, Umdrehungen pro Minute", "Drehzahl", "rpm"),
        ("x (joule per gram kelvin)", "x", "J/(g K)"),
        ("dM in newton metres per second", "dM", "N m/s"),
        ("Durchfluss in Liter pro Minute", "Durchfluss", "L/min"),
        ("angle in degrees", "angle in degrees", ""),  # of temperature or of angle
        ("Drehung in Umdrehungen", "Drehung in Umdrehungen", ""),
        ("torque, second", "torque, second", ""),  # the second of two
        ("speed in second", "speed in second", ""),  # a gear
        ("power, meter", "power, meter", ""),
        ("current in A", "current in A", ""),
        ("in Sekunden", "in Sekunden", ""),
        ("x, kilo", "x, kilo", ""),
    ],
)
def test_a_unit_in_words_is_read_where_it_is_one(heading: str, name: str, unit: str) -> None:
    """It was not read, and minutes were taken for seconds."""
    assert split_unit(heading) == (name, unit)
    check(unit)


@pytest.mark.parametrize("text", ["", "x per second", "newton per x", "metre per second per second", "squared", "kilo"])
def test_words_that_are_not_all_known_are_no_unit(text: str) -> None:
    assert in_words(text) == ""


def test_what_is_no_rate_is_not_counted_in_turns() -> None:
    """What has another kind stays as it is, and is refused by its own name."""
    for unit, to in (("m", "rad/s"), ("m/s", "rad/s"), ("1/min", "rad/s^2"), ("1/min^2", "rad/s"), ("1/min", "Hz")):
        assert turns(unit, to) == unit
    for unit, to in (("1/min", "rad/s"), ("1/min^2", "rad/s^2")):
        assert turns(unit, to) == f"turn*({unit})"
    with pytest.raises(ValueError, match="'m' does not convert"):
        convert(1.0, "m", "rad/s")


def test_a_factor_to_base_units_is_one_to_a_base_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not to any other unit that the table knows a factor to."""
    table = {("furlong", "mm"): 201168.0, ("furlong", "m"): 201.168, ("league", "mm"): 4.8e6}
    monkeypatch.setattr("terrapin_hil.units._FACTORS", table)
    assert {"m"} <= _BASE
    assert "mm" not in _BASE
    assert base_factor("furlong") == 201.168
    assert base_factor("league") is None
