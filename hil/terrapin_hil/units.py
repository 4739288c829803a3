"""Units as people write them, through pint, and bounded: no text can keep the program busy."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pint

__all__ = ["base_factor", "behind", "factor", "read_unit", "same_kind", "unit_in_formula", "units"]

MAX_LENGTH = 100
_RAISED = re.compile(r"([⁺⁻]?)([⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
_PLAIN = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
# A power is one number of at most two digits before the point, perhaps a fraction, with no further power on top of it.
_NUMBER = r"[-+]?\d{1,2}(?:\.\d{1,17}|\s*/\s*\d{1,2})?(?![\d.eE])"
_NO_UNIT = re.compile("[!#,;='\"]")
_POWER = re.compile(rf"\*\*\s*(?:{_NUMBER}|\(\s*{_NUMBER}\s*\))(?!\s*\*\*)")
_POWER_OF_GROUP = re.compile(r"\)\s*\*\*")

# What scenarios are mostly written in. To load pint and build its registry takes most of a second, which a run without
# other units does not pay. Each is pint's own factor to the last bit (tests/python/test_units.py).
_FACTORS: Mapping[tuple[str, str], float] = {
    ("ms", "s"): 1e-3,
    ("us", "s"): 1e-6,
    ("min", "s"): 60.0,
    ("s", "ms"): 1e3,
    ("mm", "m"): 1e-3,
    ("cm", "m"): 1e-2,
    ("km", "m"): 1e3,
    ("mm/s", "m/s"): 1e-3,
    ("cm/s", "m/s"): 1e-2,
    ("deg", "rad"): 0.017453292519943295,
    ("mrad", "rad"): 1e-3,
    ("deg/s", "rad/s"): 0.017453292519943295,
    ("rpm", "rad/s"): 0.10471975511965977,
    ("mV", "V"): 1e-3,
    ("mA", "A"): 1e-3,
    ("mohm", "ohm"): 1e-3,
    ("g", "kg"): 1e-3,
    ("mN m", "N m"): 1e-3,
    ("mN m s/rad", "N m s/rad"): 1e-3,
    ("kPa", "Pa"): 1e3,
}
# Units whose base is themselves.
_BASE = frozenset(
    ("s", "m", "m/s", "rad", "rad/s", "rad/s^2", "s^2/rad^2", "V", "A", "ohm", "kg", "kg m^2", "N", "N m", "N m s/rad")
)
_TO_BASE: Mapping[str, float] = {"MHz": 1e6, "B": 8.0, "kPa": 1e3}


def factor(given: str, unit: str) -> float | None:
    """What a number in `given` is multiplied by to be in `unit`; None where one has to ask pint.

    >>> factor("mm", "m"), factor("V", "V"), factor("furlong", "m")
    (0.001, 1.0, None)
    """
    return 1.0 if given == unit else _FACTORS.get((given, unit))


def base_factor(unit: str) -> float | None:
    """The same to base units.

    >>> base_factor("us"), base_factor("N m"), base_factor("furlong")
    (1e-06, 1.0, None)
    """
    if unit in _BASE:
        return 1.0
    found = (factor for (given, base), factor in _FACTORS.items() if given == unit and base in _BASE)
    return _TO_BASE.get(unit) or next(found, None)


# As sheets print horsepower; PS is petasiemens to pint, and the others nothing.
_HORSEPOWER = {"PS": "metric_horsepower", "CV": "metric_horsepower", "HP": "horsepower", "bhp": "horsepower"}

# Whose zero is not that of the kind -> a unit as large, whose is.
_WITHOUT_OFFSET = {
    "degree_Celsius": "kelvin",
    "degree_Fahrenheit": "degree_Rankine",
    "degree_Reaumur": "delta_degree_Reaumur",
}


@lru_cache(maxsize=1)
def units() -> pint.UnitRegistry[Any]:
    """The one registry of units of the whole program (a second one could not compare with it)."""
    import pint  # takes a quarter of a second: only those who need units pay

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(cache_folder=None)
    return registry


@lru_cache(maxsize=512)
def read_unit(text: str) -> pint.Unit:
    """The unit that `text` names, in pint's spelling with ^ or **; "" and "1" are none. ValueError when it names none.

    pint works out powers of plain numbers at once, so that `s^9^9^9` would never come back: powers are small here.

    >>> str(read_unit("kPa/m^0.97"))
    'kilopascal / meter ** 0.97'
    >>> str(read_unit("PS"))
    'metric_horsepower'
    """
    spelling = _RAISED.sub(lambda m: "**" + (m[1] + m[2]).translate(_PLAIN), text.strip().replace("^", "**"))
    if spelling in ("", "1"):
        return units().Unit("dimensionless")
    if len(spelling) > MAX_LENGTH:
        raise ValueError(f"{text[:40] + '...'!r} is not a unit: longer than {MAX_LENGTH} characters")
    if spelling.count("**") != len(_POWER.findall(spelling)) or len(_POWER_OF_GROUP.findall(spelling)) > 2:
        raise ValueError(f"{text!r} is not a unit: expected powers such as m^2 or m^0.97")
    if sign := _NO_UNIT.search(spelling):  # pint takes `m!` and `m # x` for a metre, and `m, s` for their product
        raise ValueError(f"{text!r} is not a unit: found {sign[0]}")
    try:
        return units().Unit(_HORSEPOWER.get(spelling, spelling))
    except Exception as error:  # pint's parser lets Python's tokenizer errors and its own assertions through
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{text!r} is not a unit: {reason}") from None


@lru_cache(maxsize=256)
def unit_in_formula(text: str) -> pint.Unit:
    """The unit that `text` names, as products know it: of temperatures only differences mean anything in a formula.

    >>> str(unit_in_formula("degC")), str(unit_in_formula("degF")), str(unit_in_formula("mN m"))
    ('kelvin', 'degree_Rankine', 'meter * millinewton')
    """
    unit = read_unit(text)
    return units().Unit(_WITHOUT_OFFSET.get(str(unit), unit))


def same_kind(unit: str, other: str) -> bool:
    """Whether values in the one convert to the other (exponents agree to 1e-6, so m^0.97 works)."""
    left: dict[Any, Any] = dict(read_unit(unit).dimensionality)
    right: dict[Any, Any] = dict(read_unit(other).dimensionality)
    return all(abs(float(left.get(d, 0)) - float(right.get(d, 0))) < 1e-6 for d in {*left, *right})


def behind(unit: str) -> str:
    """A unit to stand behind a number; nothing for a plain number.

    >>> behind("N m"), behind("1")
    (' N m', '')
    """
    return "" if unit in ("", "1") else f" {unit}"
