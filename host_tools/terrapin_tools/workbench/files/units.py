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
    "check",
    "convert",
    "convert_difference",
    "in_si",
    "quantity",
    "same_kind",
    "shifted",
    "si_factor",
    "spelling",
    "turns",
]

Numbers = TypeVar("Numbers", float, npt.NDArray[np.float64])


CELSIUS = ("degC", "celsius", "degree_Celsius")
LARGEST = 1e100  # of a number in a case: its square is still a number


# As instruments and spreadsheets write them -> as pint reads them.
_SPELLINGS = {
    "": "1", "-": "1", "%": "percent", "\u00b0": "deg", "\u00b0C": "degC", "\u2103": "degC", "\u00b0F": "degF",
    "Nm": "N m", "mNm": "mN m", "kNm": "kN m", "Nmm": "N mm", "Ncm": "N cm", "U/min": "rpm", "min-1": "1/min",
    "s-1": "1/s", "Ohm": "ohm", "\u03a9": "ohm", "\u2126": "ohm",
}  # fmt: skip


def spelling(unit: str) -> str:
    """A unit as people write it, as pint reads it.

    >>> spelling("mN\u00b7m"), spelling("Nm"), spelling("%"), spelling("rad/s")
    ('mN m', 'N m', 'percent', 'rad/s')
    """
    unit = re.sub("[\u00b7\u22c5*](?!\\*)", " ", unit.strip()) if "**" not in unit else unit.strip()
    return _SPELLINGS.get(unit, unit)


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
    """The coherent SI unit of the same kind; degC stays, for formulas know it.

    >>> in_si("rpm"), in_si("degC"), in_si("")
    ('rad/s', 'degC', '')
    """
    if unit.strip() in ("", *CELSIUS):
        return unit.strip() and "degC"
    if si_factor(unit) == 1.0 and not shifted(unit):
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
