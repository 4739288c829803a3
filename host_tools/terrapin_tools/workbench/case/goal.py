"""[goal] of a case: the error that is good enough for its user, in the unit of a channel.

[goal]
error = "0.05 A"              # of each channel in such a unit; or a list, ["0.05 A", "2 deg"]
"""

from __future__ import annotations

from collections.abc import Mapping

from terrapin_hil.reading import shorten
from terrapin_tools.workbench.files.toml_tables import Tables
from terrapin_tools.workbench.files.units import convert_difference, same_kind

__all__ = ["read_goal"]


def read_goal(tables: Tables, channels: Mapping[str, str]) -> dict[str, float]:
    """The rms error that is asked for, by channel, in its canonical unit. UserError names line and field.

    `channels` gives the unit of each channel; "1" or "" for one without.
    """
    tables.allow(("goal",), "error")
    path = ("goal", "error")
    given = tables.get(*path)
    if given is None:
        if tables.table("goal"):
            return {}
        if tables.get("goal") is not None:
            raise tables.complain('missing, expected an error with its unit, such as "0.05 A"', *path)
        return {}
    found: dict[str, float] = {}
    for one in given if isinstance(given, list) else [given]:
        value, unit = _read(tables, one)
        units = {name: own or "1" for name, own in channels.items()}
        mine = [name for name, own in units.items() if _kind(unit, own)]
        if not mine:
            listed = ", ".join(f"{name} in {own}" for name, own in units.items())
            raise tables.complain(f"found {one!r}, expected the unit of a channel: {listed}", *path)
        for name in mine:
            if name in found:
                raise tables.complain(f"found a second error of {name}, expected one", *path)
            found[name] = convert_difference(value, unit, units[name])
    return found


def _read(tables: Tables, given: object) -> tuple[float, str]:
    """Number and unit of "0.05 A"; a plain number has none."""
    text = str(given) if isinstance(given, (int, float)) and not isinstance(given, bool) else given
    number, _, unit = text.strip().partition(" ") if isinstance(text, str) else ("", "", "")
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        shown = shorten(given)
        raise tables.complain(
            f'found {shown}, expected a number above 0 and its unit, such as "0.05 A"', "goal", "error"
        )
    return value, unit.strip() or "1"


def _kind(unit: str, own: str) -> bool:
    try:
        return same_kind(unit, own)
    except ValueError:
        return False
