"""[data.derived] of case.toml: each entry is a column more in every file, with its unit.

[data.derived]
torque = { formula = "k*i", unit = "N m", with = { i = { column = "i_mA", unit = "mA" }, k = "31 mN m/A" } }
omega = { counts = "enc", counts_per_turn = 4096, wrap = 65536, time = {...}, window = "50 ms", unit = "rad/s" }
smooth = { mean = { column = "f", unit = "N" }, time = { column = "t", unit = "s" }, window = "1 s", unit = "N" }
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.derived.windows import COUNT_NOISE, mean, slope, unwrapped
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.toml_tables import Tables

__all__ = ["derive", "inputs"]

Path = tuple[str, ...]
KINDS = {  # what an entry has, by what it is
    "formula": ("formula", "with", "unit"),
    "counts": ("counts", "counts_per_turn", "wrap", "reverse", "time", "window", "unit"),
    "mean": ("mean", "time", "window", "unit"),
}


@dataclass(frozen=True)
class _Made:
    values: Array
    words: str
    noise: float | None = None  # sd of a row, in the entry's unit, where it is known
    odd: int = 0  # rows without a number though their inputs have one


def inputs(tables: Tables, wanted: Sequence[str]) -> set[str]:
    """The columns of the files that stand behind `wanted`, derived ones replaced by theirs."""
    entries = tables.table("data", "derived")
    found: set[str] = set()
    waiting, seen = list(wanted), set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if name not in entries:
            found.add(name)
            continue
        entry = tables.table("data", "derived", name)
        parts = [entry.get("mean"), entry.get("time"), *tables.table("data", "derived", name, "with").values()]
        waiting += [str(part["column"]) for part in parts if isinstance(part, dict) and "column" in part]
        waiting += [entry["counts"]] if isinstance(entry.get("counts"), str) else []
    return found


def derive(tables: Tables, loaded: Sequence[Table], runs: Sequence[str]) -> tuple[list[Table], list[str]]:
    """The files with the derived columns, and a sentence about each. `runs`: of all rows, in the files' order.

    Later entries may use earlier ones. UserError for an entry that cannot be computed, with its place in case.toml."""
    found, remarks = list(loaded), []
    numbers = np.unique(np.asarray(runs, dtype=str), return_inverse=True)[1] if runs else np.zeros(0, np.int64)
    starts = np.cumsum([0, *(table.rows for table in loaded)])
    for name in tables.table("data", "derived"):
        path = ("data", "derived", name)
        kind = _kind(tables, path)
        if any(name in table.columns for table in found):
            raise tables.complain("found a column of the files, expected a name that none has", *path)
        unit = tables.unit(*path, "unit")
        made = [
            {"formula": _formula, "counts": _counts, "mean": _mean}[kind](tables, path, table, numbers[a:b], unit)
            for table, a, b in zip(found, starts, starts[1:], strict=False)
        ]
        found = [replace(t, columns={**t.columns, name: m.values}) for t, m in zip(found, made, strict=True)]
        noise = [m.noise for m in made if m.noise is not None]
        odd = sum(m.odd for m in made)
        said = f"{name} [{unit}] is derived: {made[0].words}" if made else ""
        said += f"; sd of its noise {np.median(noise):.3g} {unit}" if noise else ""
        said += f"; no number in {odd} row{'s' * (odd != 1)} (a division by 0, or the like)" if odd else ""
        remarks += [said + "."] if said else []
    return found, remarks


def _kind(tables: Tables, path: Path) -> str:
    entry = tables.get(*path)
    kinds = [kind for kind in KINDS if isinstance(entry, dict) and kind in entry]
    if len(kinds) != 1:
        raise tables.complain(f"found {', '.join(kinds) or 'none'} of formula, counts and mean, expected one", *path)
    tables.allow(path, *KINDS[kinds[0]])
    return kinds[0]


def _column(tables: Tables, path: Path, table: Table, to: str | None) -> tuple[Array, str]:
    """Numbers of `{ column = , unit = }` in `to` (None: in SI), and the unit that they then have."""
    tables.entry(path, "column", "unit")
    column, unit = tables.text(*path, "column"), tables.unit(*path, "unit", default="1")
    if column not in table.columns:
        expected = ", ".join(table.columns)
        raise tables.complain(f"column {column!r} is not in {table.path.name}, expected one of {expected}", *path)
    target = units.in_si(unit) if to is None else to
    with tables.about(*path, "unit"):
        return units.convert(table.numbers(column, gaps=True), unit, target), target


def _formula(tables: Tables, path: Path, table: Table, run: Index, unit: str) -> _Made:
    del run
    with tables.about(*path, "formula"):
        formula = parse(tables.text(*path, "formula"))
    values: dict[str, Array | float] = {}
    known: dict[str, str] = {}
    for name, given in tables.table(*path, "with").items():
        place = (*path, "with", name)
        if isinstance(given, dict):
            values[name], known[name] = _column(tables, place, table, None)
        else:
            said = str(given).split(maxsplit=1)
            known[name] = units.in_si(said[1]) if isinstance(given, str) and len(said) > 1 else "1"
            values[name] = tables.number(known[name], *place)
    missing = sorted(formula.names - values.keys())
    if missing:
        raise tables.complain(
            f"{missing[0]} is not given, expected with = {{ {missing[0]} = {{ column =, unit = }} }}", *path
        )
    with tables.about(*path, "unit"):
        given_unit = {name: text or "1" for name, text in known.items()}
        yields = f"{formula.unit(given_unit):~}".replace("**", "^") or "1"
        if not units.same_kind(yields, unit):
            raise ValueError(f"found {unit!r}, but {formula} gives {yields!r}")
        raw = np.broadcast_to(formula.evaluate(values), (table.rows,)).astype(np.float64)
        found = units.convert(raw, units.in_si(unit) or "1", unit)
    whole = np.all([np.isfinite(np.broadcast_to(v, raw.shape)) for v in values.values()], axis=0)
    odd = int((whole & ~np.isfinite(found)).sum())
    return _Made(np.where(np.isfinite(found), found, np.nan), str(formula), odd=odd)


def _times(tables: Tables, path: Path, table: Table, run: Index) -> tuple[Array, float, str]:
    """Times [s], which rise in each run, the window [s], and the window in words."""
    times, _ = _column(tables, (*path, "time"), table, "s")
    window = tables.number("s", *path, "window")
    if not 0 < window < math.inf:
        raise tables.complain(f"found {window:g} s, expected more than 0", *path, "window")
    order = np.argsort(run, kind="stable")
    back = np.flatnonzero((np.diff(run[order]) == 0) & (np.diff(times[order]) <= 0))
    if back.size:
        place = table.place(int(order[back + 1].min()))
        raise tables.complain(f"{place} is not later than the row before, expected times that rise", *path, "time")
    return times, window, str(tables.get(*path, "window"))


def _positive(tables: Tables, path: Path, key: str) -> float:
    value = tables.number("1", *path, key)
    if not 0 < value < math.inf:
        raise tables.complain(f"found {value:g}, expected more than 0", *path, key)
    return value


def _counts(tables: Tables, path: Path, table: Table, run: Index, unit: str) -> _Made:
    column, per_turn = tables.text(*path, "counts"), _positive(tables, path, "counts_per_turn")
    if column not in table.columns:
        expected = ", ".join(table.columns)
        raise tables.complain(f"column {column!r} is not in {table.path.name}, expected one of {expected}", *path)
    counts = table.numbers(column, gaps=True)
    wrap = _positive(tables, path, "wrap") if tables.get(*path, "wrap") is not None else None
    sign = -1.0 if tables.get(*path, "reverse") is not None and tables.truth(*path, "reverse") else 1.0
    times, window, said = _times(tables, path, table, run)
    rate, gain = slope(counts if wrap is None else unwrapped(counts, run, wrap), times, run, window)
    turn = sign * 2 * math.pi / per_turn
    with tables.about(*path, "unit"):
        values = units.convert(rate * turn, "rad/s", unit)
        known = gain[np.isfinite(gain)]
        sd = float(np.median(known)) * COUNT_NOISE * abs(turn) if known.size else math.nan
        noise = units.convert_difference(sd, "rad/s", unit) if math.isfinite(sd) else None
    words = f"the speed of {column}, {per_turn:g} counts a turn"
    words += f", which begin again after {wrap:g}" if wrap is not None else ""
    words += ", reversed" if sign < 0 else ""
    return _Made(values, f"{words}, the slope over {said}", noise)


def _mean(tables: Tables, path: Path, table: Table, run: Index, unit: str) -> _Made:
    values, _ = _column(tables, (*path, "mean"), table, unit)
    times, window, said = _times(tables, path, table, run)
    smooth, gain = mean(values, times, run, window)
    rows = 1.0 / np.nanmedian(gain) ** 2 if np.isfinite(gain).any() else 1.0
    column = tables.text(*path, "mean", "column")
    return _Made(smooth, f"the mean of {column} over {said} ({rows:.0f} rows; neighbours share them)")
