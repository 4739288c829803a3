"""Units as people write them, through pint, and bounded: no text can keep the program busy."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pint

__all__ = ["behind", "read_unit", "units"]

MAX_LENGTH = 100
_RAISED = re.compile(r"([⁺⁻]?)([⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
_PLAIN = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
# A power is one number of at most two digits before the point, perhaps a fraction, with no further power on top of it.
_NUMBER = r"[-+]?\d{1,2}(?:\.\d{1,17}|\s*/\s*\d{1,2})?(?![\d.eE])"
_POWER = re.compile(rf"\*\*\s*(?:{_NUMBER}|\(\s*{_NUMBER}\s*\))(?!\s*\*\*)")
_POWER_OF_GROUP = re.compile(r"\)\s*\*\*")


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
    """
    spelling = _RAISED.sub(lambda m: "**" + (m[1] + m[2]).translate(_PLAIN), text.strip().replace("^", "**"))
    if spelling in ("", "1"):
        return units().Unit("dimensionless")
    if len(spelling) > MAX_LENGTH:
        raise ValueError(f"{text[:40] + '...'!r} is not a unit: longer than {MAX_LENGTH} characters")
    if spelling.count("**") != len(_POWER.findall(spelling)) or len(_POWER_OF_GROUP.findall(spelling)) > 2:
        raise ValueError(f"{text!r} is not a unit: expected powers such as m^2 or m^0.97")
    try:
        return units().Unit(spelling)
    except Exception as error:  # pint's parser lets Python's tokenizer errors and its own assertions through
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{text!r} is not a unit: {reason}") from None


def behind(unit: str) -> str:
    """A unit to stand behind a number; nothing for a plain number.

    >>> behind("N m"), behind("1")
    (' N m', '')
    """
    return "" if unit in ("", "1") else f" {unit}"
