"""One value of a scenario set by name: `path.2.slope`, `robot.coulomb`, `firmware.window`.

A name is the way to a field through the tables of the file, joined by dots. A number picks one of the tables [[path]],
[[operator]], [[fault]] or an entry of a list; it counts from 1, as in the messages about a file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from terrapin_hil.errors import UserError

__all__ = ["changed", "place_of", "read_value"]

_PART = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*|[1-9][0-9]{0,4}")


def place_of(name: str) -> tuple[str | int, ...]:
    """The way to a field. UserError when `name` is no name.

    >>> place_of("path.2.slope")
    ('path', 1, 'slope')
    """
    parts = name.split(".")
    if not all(_PART.fullmatch(part) for part in parts) or parts[0].isdigit():
        raise UserError(f"{name[:80]!r}: expected the name of a field of the scenario, such as path.1.slope")
    return tuple(int(part) - 1 if part.isdigit() else part for part in parts)


def read_value(text: str) -> bool | int | float | str:
    """A value as it would stand in the file: true or false, a number, else text, which may be a number with a unit.

    >>> read_value("3"), read_value("0.5"), read_value("true"), read_value("4 V")
    (3, 0.5, True, '4 V')
    """
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def changed(root: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of a file with `values` by name; `root` stays as it is. Tables that are not there are made.

    UserError where the way to a field leads through something that is no table or list, or beyond a list's end.

    >>> changed({"path": [{"slope": 0.0}]}, {"path.1.slope": 0.1, "supply.voltage": 11.0})
    {'path': [{'slope': 0.1}], 'supply': {'voltage': 11.0}}
    """
    new = dict(root)
    for name, value in values.items():
        _set(new, name, place_of(name), value)
    return new


def _set(table: Any, name: str, place: tuple[str | int, ...], value: Any) -> None:
    """Sets one value in a copy of what lies on the way to it."""
    for here, following in pairwise(place):
        inner = _get(table, name, here, [] if isinstance(following, int) else {})
        if isinstance(following, int) != isinstance(inner, list) or not isinstance(inner, list | dict):
            expected = "a list" if isinstance(following, int) else "a table"
            raise UserError(f"{name}: found {type(inner).__name__} at {_shown(here)}, expected {expected}")
        table[here] = inner = inner.copy()
        table = inner
    _get(table, name, place[-1], None)
    table[place[-1]] = value


def _get(table: Any, name: str, here: str | int, absent: Any) -> Any:
    if isinstance(here, str):
        return table.get(here, absent)
    if here >= len(table):
        expected = f"1 to {len(table)}" if table else "none"
        raise UserError(f"{name}: found {here + 1}, expected {expected}: the scenario's file has to have it")
    return table[here]


def _shown(part: str | int) -> str:
    return str(part + 1) if isinstance(part, int) else part
