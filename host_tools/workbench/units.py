"""Units at the program's edge: text and numbers in any unit to canonical ones, through pint.

>>> round(convert(25.0, "degF", "degC"), 9)
-3.888888889
>>> round(convert_difference(9.0, "degF", "degC"), 9)
5.0
>>> quantity("80 mm", "m")
0.08
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from hil.physics.expression import units as registry

__all__ = ["check", "convert", "convert_difference", "quantity", "same_kind", "si_factor"]

Numbers = TypeVar("Numbers", float, npt.NDArray[np.float64])


def _spelling(unit: str) -> str:
    return "dimensionless" if unit.strip() in ("1", "") else unit


@lru_cache(maxsize=512)
def _parse(unit: str) -> Any:
    import pint

    try:
        parsed = registry().parse_units(_spelling(unit))
    except (pint.errors.UndefinedUnitError, pint.errors.DefinitionSyntaxError) as error:
        raise ValueError(f"{unit!r} is not a unit: {error}") from None
    except Exception as error:  # pint's parser lets Python's tokenizer errors and its own assertions through
        raise ValueError(f"{unit!r} is not a unit ({type(error).__name__})") from None
    return parsed


def check(unit: str) -> None:
    """ValueError unless pint reads `unit`."""
    _parse(unit)


def same_kind(unit: str, other: str) -> bool:
    """Whether values in the one convert to the other (exponents agree to 1e-6, so m^0.97 works)."""
    left, right = dict(_parse(unit).dimensionality), dict(_parse(other).dimensionality)
    return all(abs(float(left.get(d, 0)) - float(right.get(d, 0))) < 1e-6 for d in {*left, *right})


def convert(values: Numbers, unit: str, to: str) -> Numbers:
    """Values in `unit` as values in `to`; offsets (degC, degF, K) are right. ValueError when the kinds differ."""
    if unit == to:
        return values
    source, target = _parse(unit), _parse(to)
    if not same_kind(unit, to):
        raise ValueError(f"{unit!r} does not convert to {to!r}")
    if source == target:
        return values
    converted: Numbers = registry().Quantity(values, source).to(target).magnitude
    return converted


def si_factor(unit: str) -> float:
    """What takes a difference in `unit` to coherent SI units; temperatures stay in degrees.

    >>> round(si_factor("kPa min/L"))
    60000000
    """
    if unit.strip() in ("degC", "celsius", "degree_Celsius"):
        return 1.0
    return float(registry().Quantity(1.0, _parse(unit)).to_base_units().magnitude)


def convert_difference(value: float, unit: str, to: str) -> float:
    """A difference (a standard deviation) in `unit` as one in `to`: scaled, never shifted."""
    return float(abs(convert(1.0, unit, to) - convert(0.0, unit, to)) * value)


def quantity(value: float | str, unit: str) -> float:
    """A number (already in `unit`, which is SI) or text with its own unit, in `unit`. ValueError with the reason.

    >>> quantity("1945 kPa/m^0.97", "Pa/m^0.97")
    1945000.0
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"found {value!r}, expected a number, or text with a unit such as '80 mm'")
    if not isinstance(value, str):
        number = float(value)
    else:
        head, _, tail = value.strip().partition(" ")
        try:
            number = float(head)
        except ValueError:
            raise ValueError(f"found {value!r}, expected a number, a space and a unit such as '80 mm'") from None
        number = convert(number, tail.strip() or "1", unit)
    if not np.isfinite(number):
        raise ValueError(f"found {value!r}, expected a finite number")
    return float(number)
