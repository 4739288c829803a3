"""Units at the program's edge: text and numbers in any unit to canonical ones, through pint.

>>> round(convert(25.0, "degF", "degC"), 9)
-3.888888889
>>> round(convert_difference(9.0, "degF", "degC"), 9)
5.0
>>> quantity("80 mm", "m")
0.08
"""

from __future__ import annotations

import re
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_hil.units import read_unit, same_kind
from terrapin_hil.units import units as registry

__all__ = [
    "CELSIUS",
    "behind_words",
    "check",
    "convert",
    "convert_difference",
    "in_si",
    "in_words",
    "quantity",
    "same_kind",
    "shifted",
    "si_factor",
    "spelling",
    "turns",
]

Numbers = TypeVar("Numbers", float, npt.NDArray[np.float64])


CELSIUS = ("degC", "celsius", "degree_Celsius", "degreeC", "\u00b0C")
LARGEST = 1e100  # of a number in a case: its square is still a number


# As instruments and spreadsheets write them -> as pint reads them.
_SPELLINGS = {
    "": "1", "-": "1", "%": "percent", "\u00b0": "deg", "\u00b0C": "degC", "\u2103": "degC", "\u00b0F": "degF",
    "Nm": "N m", "mNm": "mN m", "kNm": "kN m", "Nmm": "N mm", "Ncm": "N cm", "U/min": "rpm", "min-1": "1/min",
    "s-1": "1/s", "Ohm": "ohm", "\u03a9": "ohm", "\u2126": "ohm",
}  # fmt: skip


_TORQUE = re.compile(r"(/ *)?\b(m?Nm|kNm|Nmm|Ncm)\b")  # to pint the Nm is a yarn's number


# Units in words, English and German; left out is what may be another thing: degrees and Grad, turns, pounds.
_UNIT_WORDS = {
    word: unit
    for unit, words in {
        "s": "second seconds sekunde sekunden", "m": "meter meters metre metres metern", "N": "newton newtons",
        "N m": "newtonmeter newtonmetern newtonmeters newtonmetre newtonmetres", "Pa": "pascal pascals", "bar": "bar",
        "V": "volt volts", "A": "ampere amperes amp amps", "W": "watt watts", "ohm": "ohm ohms", "J": "joule joules",
        "g": "gram grams gramm", "L": "liter liters litre litres litern", "Hz": "hertz",
        "rad": "radian radians radiant",
    }.items()
    for word in words.split()
}  # fmt: skip
_WHOLE_WORDS = {
    "minute": "min", "minutes": "min", "minuten": "min", "hour": "h", "hours": "h", "stunde": "h", "stunden": "h",
    "kelvin": "K", "percent": "percent", "prozent": "percent", "celsius": "degC", "grad celsius": "degC",
    "degree celsius": "degC", "degrees celsius": "degC", "fahrenheit": "degF", "degrees fahrenheit": "degF",
    "revolutions per minute": "rpm", "umdrehungen pro minute": "rpm", "umdrehungen je minute": "rpm",
}  # fmt: skip
_MULTIPLES = {
    "nano": "n", "micro": "u", "mikro": "u", "milli": "m", "centi": "c", "zenti": "c", "kilo": "k", "mega": "M",
    "giga": "G",
}  # fmt: skip
_SQUARED = ("squared", "quadrat")
_LONE = ("second", "minute", "hour", "meter", "bar", "amp")  # behind a comma they may be another thing: "power, meter"


def in_words(text: str) -> str:
    """The unit that is written in words, "" where they are not all known.

    >>> in_words("Millimeter"), in_words("metres per second squared"), in_words("Kilowatt"), in_words("degrees")
    ('mm', 'm/s^2', 'kW', '')
    """
    phrase = " ".join(text.casefold().split())
    if phrase in _WHOLE_WORDS:
        return _WHOLE_WORDS[phrase]
    top, *below = re.split(r" (?:per|pro|je) ", phrase)
    parts = [_product(part) for part in (top, *below)]
    if "" in parts or len(parts) > 2:
        return ""
    return "/".join(f"({part})" if " " in part and part is not parts[0] else part for part in parts)


def _product(words: str) -> str:
    """The unit of words beside each other, the last perhaps squared; "" for none."""
    *more, last = words.split() or [""]
    squared = last in _SQUARED and bool(more)
    units = [_word(word) for word in (more if squared else (*more, last))]
    return " ".join(units) + "^2" * squared if all(units) else ""


def _word(word: str) -> str:
    if known := _UNIT_WORDS.get(word, _WHOLE_WORDS.get(word, "")):
        return known
    multiple = next((prefix for prefix in _MULTIPLES if word.startswith(prefix)), "")
    unit = _UNIT_WORDS.get(word.removeprefix(multiple), "") if multiple else ""
    return _MULTIPLES[multiple] + unit if unit else ""


def behind_words(heading: str) -> tuple[str, str]:
    """A heading's bare name, and the unit that stands behind it in words; "" for none.

    >>> behind_words("Zeit in Sekunden"), behind_words("speed, metres per second"), behind_words("torque, second")
    (('Zeit', 's'), ('speed', 'm/s'), ('torque, second', ''))
    """
    match = re.fullmatch(r"\s*(.*\S)(\s+in\s+|\s*,\s*)(.+?)\s*", heading)
    if match is None or match[3].casefold() in (_LONE if "," in match[2] else _LONE[:1]):
        return heading, ""
    unit = in_words(match[3])
    return (match[1], unit) if unit else (heading, "")


def spelling(unit: str) -> str:
    """A unit as people write it, as pint reads it.

    >>> spelling("mN\u00b7m"), spelling("Nm"), spelling("%"), spelling("rad/s"), spelling("Newton"), spelling("A/Nm")
    ('mN m', 'N m', 'percent', 'rad/s', 'N', 'A/(N m)')
    """
    unit = re.sub("[\u00b7\u22c5*](?!\\*)", " ", unit.strip()) if "**" not in unit else unit.strip()
    return _SPELLINGS.get(unit) or in_words(unit) or _TORQUE.sub(_in_two, unit)


def _in_two(torque: re.Match[str]) -> str:
    return f"/({_SPELLINGS[torque[2]]})" if torque[1] else _SPELLINGS[torque[2]]


def check(unit: str) -> None:
    """ValueError unless pint reads `unit`."""
    read_unit(unit)


def convert(values: Numbers, unit: str, to: str) -> Numbers:
    """Values in `unit` as values in `to`; offsets (degC, degF, K) are right. ValueError when the kinds differ."""
    if unit == to:
        return values
    source, target = read_unit(turns(unit, to)), read_unit(to)
    if source == target:
        return values
    try:
        converted: Numbers = registry().Quantity(values, source).to(target).magnitude
    except (TypeError, ValueError, ArithmeticError):  # another kind, a difference (delta_degF), a logarithm (dBm)
        raise ValueError(f"{unit!r} does not convert to {to!r}") from None
    return converted


def turns(unit: str, to: str) -> str:
    """`unit`; where `to` is the rate of an angle and `unit` only says how often a time, as turns.

    >>> turns("1/min", "rad/s"), turns("rad/min", "rad/s"), turns("1/min", "1/s")
    ('turn*(1/min)', 'rad/min', '1/min')
    """
    if to not in ("rad/s", "rad/s^2") or not same_kind(unit, to):
        return unit
    root = registry().Quantity(1.0, read_unit(unit)).to_root_units().units
    return unit if "radian" in str(root) else f"turn*({unit})"


def si_factor(unit: str) -> float:
    """What takes a difference in `unit` to coherent SI units; temperatures stay in degrees.

    >>> round(si_factor("kPa min/L")), round(si_factor("degF"), 6)
    (60000000, 0.555556)
    """
    if unit.strip() in CELSIUS:
        return 1.0
    return _in_base(1.0, unit) - _in_base(0.0, unit)


def shifted(unit: str) -> bool:
    """Whether zero in `unit` is not zero in SI units: no factor takes such a value there. Formulas know degC as it is.

    >>> shifted("degF"), shifted("delta_degF"), shifted("degC"), shifted("K")
    (True, False, False, False)
    """
    return unit.strip() not in CELSIUS and _in_base(0.0, unit) != 0.0


def _in_base(value: float, unit: str) -> float:
    scaled: Any = registry().Quantity(value, read_unit(unit)).to_base_units()
    return float(scaled.magnitude)


def in_si(unit: str) -> str:
    """The coherent SI unit of the same kind; a temperature on a scale is in degC, which formulas know.

    >>> in_si("rpm"), in_si("degC"), in_si("degF"), in_si("")
    ('rad/s', 'degC', 'degC', '')
    """
    if not unit.strip():
        return ""
    if unit.strip() in CELSIUS or shifted(unit):
        return "degC"
    if si_factor(unit) == 1.0:
        return unit
    return f"{registry().Quantity(1.0, read_unit(unit)).to_base_units().units:~C}".replace("**", "^") or "1"


def convert_difference(value: float, unit: str, to: str) -> float:
    """A difference (a standard deviation) in `unit` as one in `to`: scaled, never shifted."""
    return float(abs(convert(1.0, unit, to) - convert(0.0, unit, to)) * value)


def quantity(value: float | str, unit: str) -> float:
    """A number (already in `unit`, which is SI) or text with its own unit, in `unit`. ValueError with the reason.

    >>> quantity("1945 kPa/m^0.97", "Pa/m^0.97")
    1945000.0
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"found {shorten(value)}, expected a number, or text with a unit such as '80 mm'")
    if not isinstance(value, str):
        number = float(value) if abs(value) <= LARGEST else np.inf
    else:
        head, _, tail = value.strip().partition(" ")
        try:
            number = float(head)
        except ValueError:
            raise ValueError(f"found {shorten(value)}, expected a number, a space and a unit such as '80 mm'") from None
        number = convert(number, tail.strip() or "1", unit)
    if not abs(number) <= LARGEST:
        raise ValueError(f"found {shorten(value)}, expected a finite number below {LARGEST:g}")
    return float(number)
