"""A column that the table has wrong, put right as it is read: factor, the sign of another column, rows that it is late.

[data.columns] omega = { column = "speed", unit = "rad/s", factor = 0.10472 }
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.files.toml_tables import Tables

__all__ = ["Mend", "earlier", "mended", "read_mend", "told_mends"]

LATEST = 1000  # rows


@dataclass(frozen=True)
class Mend:
    """What is done to a column: taken `delay` rows later in its run, given a sign, multiplied."""

    factor: float = 1.0
    sign_of: str = ""
    delay: int = 0


def read_mend(tables: Tables, path: tuple[str, ...]) -> Mend:
    """factor, sign_of and delay of an entry. UserError when one is nothing that a column can be mended with."""
    factor = 1.0 if tables.get(*path, "factor") is None else tables.number("1", *path, "factor")
    if factor == 0.0:
        raise tables.complain("found 0, expected a factor other than 0", *path, "factor")
    delay = tables.get(*path, "delay", default=0)
    if isinstance(delay, bool) or not isinstance(delay, int) or not 0 <= delay <= LATEST:
        raise tables.complain(f"found {delay!r}, expected a whole number of rows, 0 to {LATEST}", *path, "delay")
    return Mend(factor, tables.text(*path, "sign_of", default=""), int(delay))


def earlier(values: Array, run: Index, delay: int) -> Array:
    """A column that comes `delay` rows late, one or more, in its place; NaN where a run ends before its value came."""
    order = np.argsort(run, kind="stable")
    values, run, moved = values[order], run[order], np.full(len(values), np.nan)
    if delay < len(values):
        moved[order[:-delay]] = np.where(run[delay:] == run[:-delay], values[delay:], np.nan)
    return moved


def mended(tables: Tables, values: Mapping[str, Array], mends: Mapping[str, Mend]) -> dict[str, Array]:
    """Roles and channels (rows,) with their signs and factors. UserError when a sign is that of no column."""
    found = dict(values)
    for name, mend in mends.items():
        if mend.sign_of:
            if mend.sign_of not in values or mend.sign_of == name:
                others = ", ".join(other for other in values if other != name)
                raise tables.complain(
                    f"found {mend.sign_of!r}, expected one of {others}", "data", "columns", name, "sign_of"
                )
            found[name] = np.abs(values[name]) * np.sign(values[mend.sign_of])
        if mend.factor != 1.0:
            found[name] = found[name] * mend.factor
    return found


def told_mends(mends: Mapping[str, Mend]) -> Sequence[str]:
    """What was done, in sentences."""
    found = []
    for name, mend in mends.items():
        did = [f"multiplied by {mend.factor:.6g}"] if mend.factor != 1.0 else []
        did += [f"given the sign of {mend.sign_of}"] if mend.sign_of else []
        did += [f"taken {mend.delay} row{'s' if mend.delay > 1 else ''} later"] if mend.delay else []
        if did:
            found.append(f"{name} is {' and '.join(did)}, as case.toml asks.")
    return found
