"""[goal] of a case: for a channel the rms error that is good enough for its user, with its unit or as a share.

[goal]
current = "10 mA"
torque = "2 %"                # of the rms of what was measured of the channel
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.reading import shorten
from terrapin_tools.workbench.files.toml_tables import Tables
from terrapin_tools.workbench.files.units import convert_difference

__all__ = ["read_goal"]


def read_goal(tables: Tables, channels: Mapping[str, str], measured: Mapping[str, Array]) -> dict[str, float]:
    """The rms error that is asked for, by channel, in its canonical unit. UserError names line and field.

    `channels` gives the unit of each channel, "1" or "" for one without; `measured` its rows.
    """
    found: dict[str, float] = {}
    for name in tables.table("goal"):
        path = ("goal", name)
        if name not in channels:
            raise tables.complain(f"unknown channel, expected one of {', '.join(channels)}", *path)
        own = channels[name] or "1"
        value, unit = _read(tables, tables.get(*path), path)
        if unit == "%":
            found[name] = 0.01 * value * float(np.sqrt(np.mean(measured[name] ** 2)))
            continue
        with tables.about(*path):
            found[name] = convert_difference(value, unit or own, own)
    return found


def _read(tables: Tables, given: object, path: tuple[str, ...]) -> tuple[float, str]:
    """Number and unit of "0.05 A"; a plain number is in the channel's own."""
    text = str(given) if isinstance(given, (int, float)) and not isinstance(given, bool) else given
    number, _, unit = text.strip().partition(" ") if isinstance(text, str) else ("", "", "")
    if number.endswith("%"):
        number, unit = number[:-1], "%"
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        found = shorten(given)
        raise tables.complain(
            f'found {found}, expected a number above 0 and its unit, such as "0.05 A" or "2 %"', *path
        )
    return value, unit.strip()
