"""Quantities with units in files of robots and boards, by the standard library alone: the build reads these files.

A number is in the field's own unit; a text carries its unit, a product of prefixed units with powers after `^` and one
slash: "80 mm", "12 mN m", "0.1 N m/A", "181 g cm^2", "500 kbit/s".
"""

from __future__ import annotations

import math
import re

__all__ = ["QuantityError", "parse_quantity"]

Dimension = tuple[int, int, int, int, int, int]  # powers of kg, m, s, A, K, bit

_PREFIXES = {"": 1.0, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "n": 1e-9}
_UNITS: dict[str, tuple[float, Dimension]] = {
    "1": (1.0, (0, 0, 0, 0, 0, 0)),
    "rad": (1.0, (0, 0, 0, 0, 0, 0)),
    "deg": (math.pi / 180.0, (0, 0, 0, 0, 0, 0)),
    "turn": (2.0 * math.pi, (0, 0, 0, 0, 0, 0)),
    "g": (1e-3, (1, 0, 0, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0, 0, 0)),
    "s": (1.0, (0, 0, 1, 0, 0, 0)),
    "min": (60.0, (0, 0, 1, 0, 0, 0)),
    "Hz": (1.0, (0, 0, -1, 0, 0, 0)),
    "rpm": (math.pi / 30.0, (0, 0, -1, 0, 0, 0)),
    "A": (1.0, (0, 0, 0, 1, 0, 0)),
    "K": (1.0, (0, 0, 0, 0, 1, 0)),
    "degC": (1.0, (0, 0, 0, 0, 1, 0)),  # a temperature, or a difference where K is expected
    "N": (1.0, (1, 1, -2, 0, 0, 0)),
    "kgf": (9.80665, (1, 1, -2, 0, 0, 0)),  # as sheets of small gear motors give torques: kgf cm
    "V": (1.0, (1, 2, -3, -1, 0, 0)),
    "ohm": (1.0, (1, 2, -3, -2, 0, 0)),
    "H": (1.0, (1, 2, -2, -2, 0, 0)),
    "W": (1.0, (1, 2, -3, 0, 0, 0)),
    "bit": (1.0, (0, 0, 0, 0, 0, 1)),
}
_FACTOR = re.compile(r"([A-Za-z1]+)(?:\^(-?\d))?")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)
FREEZING = 273.15  # K, of water: 0 degC
LONGEST = 60  # characters of a value in a message


class QuantityError(ValueError):
    """No quantity in the unit that is expected; the message says what was found and expected."""


def _one(name: str) -> tuple[float, Dimension]:
    if name in _UNITS:
        return _UNITS[name]
    if len(name) > 1 and name[0] in _PREFIXES and name[1:] in _UNITS:
        factor, dimension = _UNITS[name[1:]]
        return _PREFIXES[name[0]] * factor, dimension
    raise KeyError(name)


def _read(unit: str) -> tuple[float, Dimension]:
    """Factor to SI and dimension. KeyError when `unit` is none."""
    factor, powers = 1.0, [0, 0, 0, 0, 0, 0]
    above, slash, below = unit.partition("/")
    if slash and not below.split():
        raise KeyError(unit)
    for text, side in ((above, 1), (below, -1)):
        for word in text.split():
            match = _FACTOR.fullmatch(word)
            if match is None:
                raise KeyError(word)
            one, dimension = _one(match[1])
            power = side * int(match[2] or 1)
            factor *= one**power
            powers = [total + power * part for total, part in zip(powers, dimension, strict=True)]
    a, b, c, d, e, f = powers
    return factor, (a, b, c, d, e, f)


def parse_quantity(value: object, unit: str) -> float:
    """`value` in `unit`: a number as it is, a text converted. QuantityError says what was found and expected.

    >>> parse_quantity("80 mm", "m"), parse_quantity("181 g cm^2", "kg m^2"), parse_quantity(5, "ohm")
    (0.08, 1.81e-05, 5.0)
    >>> parse_quantity("373.15 K", "degC"), parse_quantity("2 degC", "K")
    (100.0, 2.0)
    """
    shown = repr(value) if len(repr(value)) <= LONGEST else repr(value)[:LONGEST] + "..."
    plain = unit in ("", "1")
    expected = "a number" if plain else f"a number in {unit} or a text with a unit that converts to it"
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise QuantityError(f"found {shown}, expected {expected}")
    if not isinstance(value, str):
        number = float(value) if abs(value) <= 1e300 else math.inf
    else:
        match = _QUANTITY.fullmatch(value)
        try:
            if match is None or len(value) > 100:
                raise KeyError(value)
            given, wanted = _read(match[2] or "1"), _read(unit or "1")
            if given[1] != wanted[1]:
                raise KeyError(match[2])
        except (KeyError, OverflowError, ZeroDivisionError):
            raise QuantityError(f"found {shown}, expected {expected}") from None
        ratio = given[0] / wanted[0]
        inverse = wanted[0] / given[0]
        whole = inverse > 1.0 and abs(inverse - round(inverse)) < 1e-9 * inverse  # 80 mm is 80/1000 m, to the last bit
        number = float(match[1]) / round(inverse) if whole else float(match[1]) * ratio
        if unit == "degC" and "degC" not in match[2]:
            number -= FREEZING
    if not math.isfinite(number):
        raise QuantityError(f"found {shown}, expected a finite number")
    return number
