"""The measurements of a case: files into roles and channels in canonical units, runs, and what is held out."""

from __future__ import annotations

import os
import re
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.expression import Expression, is_name, parse
from terrapin_hil.physics.mechanics import ROLES as MECHANICS
from terrapin_tools.errors import UserError
from terrapin_tools.logs.reading import is_log
from terrapin_tools.workbench.bases import CHANNELS, ROLES, Base
from terrapin_tools.workbench.bases.kinds.names import formula_name
from terrapin_tools.workbench.case.changes import MENDS
from terrapin_tools.workbench.case.groups import Groups, group_columns, membership, read_groups
from terrapin_tools.workbench.case.intake import (
    Mapped,
    again,
    assumed,
    converted,
    copied,
    echoes,
    gaps,
    headings,
    ungrouped,
    unsigned,
)
from terrapin_tools.workbench.case.mechanics import is_of, role_of_unit
from terrapin_tools.workbench.case.mends import earlier, mended, read_mend, told_mends
from terrapin_tools.workbench.derived.columns import derive, inputs
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.format import Asked, meant, parted
from terrapin_tools.workbench.files.number_marks import GAPS
from terrapin_tools.workbench.files.tables import Table, read
from terrapin_tools.workbench.files.toml_tables import Tables

__all__ = ["Measurements", "mapped_column", "read_formulas", "read_measurements", "run_of_rows", "split_runs"]


@dataclass(frozen=True)
class Places:
    """Where rows stand, as "runs.csv:17"; goes to another process as it is."""

    tables: tuple[Table, ...]  # without their columns
    starts: tuple[int, ...]  # row at which each begins, and the count of all
    kept: Index  # rows of the files that are rows of the case

    def __call__(self, row: int) -> str:
        whole = int(self.kept[row])
        index = bisect_right(self.starts, whole) - 1
        return self.tables[index].place(whole - self.starts[index])


@dataclass(frozen=True, kw_only=True)
class Measurements:
    """What the files of a case hold. Arrays have one entry a row; roles and channels are in canonical units."""

    roles: Mapping[str, Array]
    channels: Mapping[str, Array]
    sigma: Mapping[str, float | None]  # noise sd of each channel, where it is stated
    units: Mapping[str, str]  # canonical unit of each role and channel
    extra: Mapping[str, Array]  # numeric columns that are not mapped, in the file's own units
    column_of: Mapping[str, str]  # role or channel -> column of the file
    run_names: tuple[str, ...]  # sorted, numbers by their size
    run: Index  # index into run_names
    train: Mask
    test: Mask
    place: Callable[[int], str] = field(repr=False)  # row -> "runs.csv:17"
    equations: Mapping[str, Expression]  # of the user's own, by channel
    groups: Mapping[str, Groups]
    told: Mapping[str, str]  # of the user's own names: role that brings mechanics -> input
    rows_left_out: int  # for a gap in a mapped column
    remarks: tuple[str, ...]  # what was left out, converted or looks odd, in sentences


def read_measurements(folder: Path, tables: Tables, base: Base, held: Mapping[str, Table]) -> Measurements:
    """Read the files that [data] names, but those that are `held`. UserError when anything is wrong."""
    tables.allow(("data",), "files", "run", "train", "test", "columns", "dbc", "period", "ignore", "derived", "read")
    equations = _equations(tables, base)
    mapped = _columns(tables, base, equations)
    files = tables.files()
    loaded = _read_files(folder, tables, files, mapped, held)
    other = headings(mapped, loaded)
    loaded = _called(tables, loaded, mapped)
    run_column = tables.text("data", "run", default="")
    derived: list[str] = []
    if tables.table("data", "derived"):
        loaded, derived = derive(tables, loaded, run_of_rows(tables, loaded, run_column))
    starts = np.cumsum([0, *(table.rows for table in loaded)]).tolist()
    places = tuple(replace(table, columns={}) for table in loaded), tuple(starts)
    place = Places(*places, np.arange(starts[-1]))
    for entry in mapped:
        for table in loaded:
            _check_there(tables, table, entry.column, "data", "columns", entry.name, "column")
    if starts[-1] == 0:
        raise tables.complain(f"{files[0]} has no rows, expected at least one", "data", "files")
    columns = {entry.column: np.concatenate([t.numbers(entry.column, gaps=True) for t in loaded]) for entry in mapped}
    names = run_of_rows(tables, loaded, run_column)
    number = np.unique(names, return_inverse=True)[1]
    late = {entry.column: entry.mend.delay for entry in mapped if entry.mend.delay}
    columns |= {name: earlier(columns[name], number, delay) for name, delay in late.items()}
    whole: Mask = ~np.any([np.isnan(values) for values in columns.values()], axis=0)
    rows: slice | Index = slice(None) if whole.all() else np.flatnonzero(whole)
    kept = np.arange(starts[-1])[rows]
    if not kept.size:
        first = next(name for name, values in columns.items() if np.isnan(values).any())
        raise UserError(f"{place(0)}: column {first}: every row has a gap, expected at least one without")
    run_text = [name for name, keep in zip(names, whole, strict=True) if keep]
    run_names = tuple(sorted(set(run_text), key=_in_order))
    index = {name: i for i, name in enumerate(run_names)}
    run = np.array([index[name] for name in run_text], dtype=np.int64)
    by_name = tuple(sorted(run_names))
    held_out = by_name[4::5] if len(by_name) >= 5 else by_name[1:][-1:]
    train_runs, test_runs = split_runs(tables, run_names, held_out)
    values = {e.name: units.convert(columns[e.column][rows], e.unit, e.canonical) for e in mapped}
    mends = {e.name: e.mend for e in mapped}
    values = mended(tables, values, mends)
    used = {entry.column for entry in mapped} | {run_column, *group_columns(tables).values()}
    train = np.isin(run, [index[name] for name in train_runs])
    extra, sparse, text = _extra(loaded, used | set(values) | _ignored(tables, loaded, used))
    groups = read_groups(tables, loaded, kept, run, run_names, train)
    kinds = [name for name, count in text.items() if 1 < count < len(run_names)]
    left_out = gaps(columns, whole, sparse, place, {*names} - {*run_names})
    remarks = [*assumed(loaded), *derived, *left_out, *told_mends(mends), *converted(mapped)]
    channels = {e.name: values[e.name] for e in mapped if e.channel}
    causes = {name for formula in equations.values() for name in formula.names} if equations else values
    beside = {e.name: values[e.name] for e in mapped if not e.channel and formula_name(e.name) not in causes}
    beside |= {name: column[rows] for name, column in extra.items()}
    remarks += [*other, *unsigned(values, _told(mapped)), *copied(list(values.values()), run, run_names)]
    remarks += again(run, run_names, Places(*places, kept))
    remarks += [*echoes(channels, beside), *ungrouped(kinds)]
    return Measurements(
        roles={e.name: values[e.name] for e in mapped if not e.channel},
        channels=channels,
        sigma={e.name: e.sigma for e in mapped if e.channel},
        units={e.name: e.canonical for e in mapped},
        extra={name: column[rows] for name, column in extra.items()} | membership(groups, {*values, *extra}),
        column_of={e.name: e.column for e in mapped},
        run_names=run_names,
        run=run,
        train=train,
        test=np.isin(run, [index[name] for name in test_runs]),
        place=Places(*places, kept),
        equations=equations,
        groups=groups,
        told=_told(mapped),
        rows_left_out=int((~whole).sum()),
        remarks=tuple(remarks),
    )


def _in_order(name: str) -> list[str | int]:
    """So that run 2 comes before run 10: what wanders over the test, or changes in it, goes by this order."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def _told(mapped: list[Mapped]) -> dict[str, str]:
    """Role -> input. Without a column that tells its role, units tell none either: a case without `is` has no roles."""
    told = {entry.role: entry.name for entry in mapped if entry.role}
    if not told:
        return {}
    return {**told, **role_of_unit({e.name: e.unit for e in mapped if not (e.channel or e.role)}, told)}


def _equations(tables: Tables, base: Base) -> dict[str, Expression]:
    found = tables.table("model", "equation")
    key = "measured" if base.own_dynamics else "equation"
    if found and (base.own_dynamics or not base.own_names):
        raise tables.complain(f'expected only with base = "equation", found base {base.name}', "model", "equation")
    return read_formulas(tables, "model", key, expected="CHANNEL = FORMULA for each channel") if base.own_names else {}


def read_formulas(tables: Tables, *path: str, expected: str) -> dict[str, Expression]:
    """A table of formulas, with at least one."""
    formulas = {}
    for name in tables.table(*path):
        with tables.about(*path, name):
            formulas[name] = parse(tables.text(*path, name))
    if not formulas:
        raise tables.complain(f"missing, expected one line {expected}", *path)
    return formulas


def _columns(tables: Tables, base: Base, equations: Mapping[str, Expression]) -> list[Mapped]:
    mapped: list[Mapped] = []
    for predicted in equations:  # before the columns: without its channel a column may have no sigma
        if predicted not in tables.table("data", "columns"):
            raise tables.complain(f"{predicted} is missing, expected the column that measures it", "data", "columns")
    for name in tables.table("data", "columns"):
        path = ("data", "columns", name)
        free = base.own_names
        channel = name in (equations if free else base.channels)
        if free and not is_name(formula_name(name)):
            raise tables.complain("found a name that formulas cannot use, expected letters a to z, digits and _", *path)
        if not free and not channel and name not in ROLES:
            expected = ", ".join([*base.channels, *ROLES])
            raise tables.complain(f"unknown role or channel, expected one of {expected}", *path)
        also = (*MENDS, *(("sigma",) if channel else ("is",) if free else ()))
        tables.entry(path, "column", "unit", also=also)
        unit = tables.text(*path, "unit", default="1" if free else None)
        with tables.about(*path, "unit"):
            units.check(unit)
            canonical = _canonical(base, name, unit)
            if not units.same_kind(unit, canonical):
                spelt = units.spelling(unit)  # Nm is a yarn's number to pint
                meant = f" (is {spelt!r} meant?)" if spelt != unit and units.same_kind(spelt, canonical) else ""
                raise ValueError(f"found {unit!r}, which does not convert to {canonical!r}{meant}")
            units.convert(1.0, unit, canonical)
            sigma, mend = None, read_mend(tables, path)
            if tables.get(*path, "sigma") is not None:
                sigma = units.convert_difference(tables.number(unit, *path, "sigma"), unit, canonical)
                sigma *= abs(mend.factor)
        if sigma is not None and sigma * units.LARGEST < 1.0:
            raise tables.complain(f"found {sigma:g} {canonical}, expected more than 0", *path, "sigma")
        role = _role(tables, path, mapped)
        column = tables.text(*path, "column")
        mapped.append(Mapped(name, column, unit, canonical, sigma, channel, role, mend))
    for i, entry in enumerate(mapped):
        other = next((e for e in mapped[:i] if e.column == entry.column and e.unit != entry.unit), None)
        if other is not None:
            raise tables.complain(
                f"column {entry.column!r} is mapped as {other.name} in {other.unit} too, expected another column",
                *("data", "columns", entry.name, "column"),
            )
        twin = next((e for e in mapped[:i] if e.column == entry.column and e.channel != entry.channel), None)
        if twin is not None and equations and not base.own_dynamics:
            seen, own = (twin, entry) if twin.channel else (entry, twin)
            raise tables.complain(
                f"column {entry.column!r} is {seen.name}, which is predicted: as input {own.name} it would explain "
                f"itself. Expected another column, or a case of its own for what {seen.name} drives",
                *("data", "columns", own.name, "column"),
            )
    return mapped


def _canonical(base: Base, name: str, unit: str) -> str:
    """The unit in which a column's numbers are held; those of an `equation` stay as the file has them."""
    if not base.own_names:
        return CHANNELS.get(name) or ROLES[name]
    return units.in_si(unit) if base.own_dynamics or unit in units.CELSIUS else unit


def _role(tables: Tables, path: tuple[str, ...], before: list[Mapped]) -> str:
    """What an input is told to be, "" for nothing."""
    role = tables.text(*path, "is", default="")
    if not role:
        return role
    if role not in MECHANICS:
        raise tables.complain(f"found {role!r}, expected one of {', '.join(MECHANICS)}", *path, "is")
    other = next((entry.name for entry in before if entry.role == role), None)
    if other is not None:
        hint = "expected one column: that of the part which the channels measure (make a case for each part)"
        raise tables.complain(f"{other} is told to be the {role} too, {hint}", *path, "is")
    unit = tables.text(*path, "unit", default="")
    if unit and not is_of(unit, role):
        raise tables.complain(f"found {unit!r} for a {role}, expected {' or '.join(MECHANICS[role])}", *path, "unit")
    return role


def mapped_column(tables: Tables, table: Table, role: str, canonical: str) -> Array:
    """The column that [data.columns] maps to a role, in its canonical unit. UserError when the entry is wrong."""
    path = ("data", "columns", role)
    tables.entry(path, "column", "unit")
    column, unit = tables.text(*path, "column"), tables.text(*path, "unit")
    column = _check_there(tables, table, column, *path)
    with tables.about(*path, "unit"):
        return units.convert(table.numbers(column), unit, canonical)


def _check_there(tables: Tables, table: Table, column: str, *path: str) -> str:
    found = meant(column, table.columns)
    if found is None:
        expected = ", ".join(table.columns)
        raise tables.complain(f"column {column!r} is not in {table.path.name}, expected one of {expected}", *path)
    return found


def _called(tables: Tables, loaded: list[Table], mapped: list[Mapped]) -> list[Table]:
    """The tables with their columns called as case.toml calls them: by their headings, or by the bare names of these.

    UserError where one name means headings of several units."""
    derived = tables.table("data", "derived")
    said = {*inputs(tables, [entry.column for entry in mapped]), *group_columns(tables).values()}
    said |= {tables.text("data", "run", default=""), *tables.texts("data", "ignore", default=[])}
    said -= {"", *derived}
    for name in sorted(said):
        headings = {table.path.name: meant(name, table.columns) for table in loaded}
        own = {units.spelling(unit): file for file, one in headings.items() if one and (unit := parted(one)[1])}
        if len(own) > 1:
            (unit, file), (other, elsewhere) = list(own.items())[:2]
            words = f"column {name!r} is in {unit} in {file} and in {other} in {elsewhere}, expected one unit"
            raise tables.complain(words, "data", "files")
    return [table.called(said) for table in loaded]


def _read_files(
    folder: Path, tables: Tables, files: list[str], mapped: list[Mapped], held: Mapping[str, Table]
) -> list[Table]:
    dbc = period = None
    places = [os.path.normpath(folder / name) for name in files]
    for name, place in zip(files, places, strict=True):
        if places.count(place) > 1:
            raise tables.complain(f"found {name!r} under two names, expected each file once", "data", "files")
    if any(is_log(place) for place in map(Path, places)):
        dbc = folder / tables.text("data", "dbc")
        period = tables.number("s", "data", "period")
        if period <= 0:
            raise tables.complain(f"found {period:g} s, expected more than 0", "data", "period")
    needed, run = inputs(tables, [entry.column for entry in mapped]), tables.text("data", "run", default="")
    text = {run, *group_columns(tables).values()}
    with tables.about("data", "read"):
        asked = Asked.of(tables.table("data", "read"), "data.read")
    for path in (folder / name for name in files if name not in held):
        with suppress(OSError):  # which reading it tells
            if not (path.is_file() or path.is_dir()):
                raise UserError(f"{path}: no such file (data.files)")
    return [held[name] if name in held else read(folder / name, dbc, period, needed, text, asked) for name in files]


def _blank(table: Table, row: int) -> bool:
    """Whether a row holds nothing, as those that part the runs in a spreadsheet."""
    return all(str(cells[row]).strip().lower() in GAPS for cells in table.columns.values())


def run_of_rows(tables: Tables, loaded: list[Table], column: str) -> list[str]:
    """The run of each row: of the column, or (without one, or of a log) the file's name."""
    names: list[str] = []
    for table in loaded:
        if is_log(table.path) or not column:
            names += [table.path.stem] * table.rows
            continue
        found = table.text(_check_there(tables, table, column, "data", "run"))
        for row in (row for row, name in enumerate(found) if not name):
            beside = found[row - 1] if row else next(filter(None, found), "")
            if not beside or not _blank(table, row):
                raise UserError(f"{table.place(row)}: column {column}: found nothing, expected a run's name")
            found[row] = beside  # the row is left out, for its gaps
        names += found
    return names


def split_runs(tables: Tables, names: Sequence[str], held_out: Sequence[str]) -> tuple[list[str], list[str]]:
    """Training and held-out runs, as data.train and data.test list them; `held_out` where there is neither list."""
    listed = {key: tables.texts("data", key) for key in ("train", "test") if tables.get("data", key) is not None}
    for key, runs in listed.items():
        for run in runs:
            if run not in names:
                expected = ", ".join(names)
                raise tables.complain(f"run {run!r} is not in the data, expected one of {expected}", "data", key)
    if not listed:
        listed["test"] = list(held_out)
    train = listed["train"] if "train" in listed else [name for name in names if name not in listed["test"]]
    test = listed["test"] if "test" in listed else [name for name in names if name not in train]
    both = sorted(set(train) & set(test))
    if both:
        raise tables.complain(f"run {both[0]!r} is in train and in test, expected in one of them", "data", "test")
    if not train:
        raise tables.complain("found an empty list, expected at least one run to train on", "data", "train")
    return train, test


def _ignored(tables: Tables, loaded: list[Table], used: set[str]) -> set[str]:
    """Columns that the case asks not to look at: a row's number, a sum of others."""
    names = tables.texts("data", "ignore", default=[])
    free = [name for name in loaded[0].columns if name not in used]
    for name in names:
        if name not in free:
            where = "is mapped" if name in used else "is not in the files"
            raise tables.complain(
                f"column {name!r} {where}, expected one of {', '.join(free) or 'none'}", "data", "ignore"
            )
    return set(names)


def _extra(loaded: list[Table], used: set[str]) -> tuple[dict[str, Array], list[str], dict[str, int]]:
    """Columns that are not mapped but numeric: the residual may depend on them. Apart from them, those with gaps.

    And those of text, with the count of their different values: no formula could use them.
    """
    extra: dict[str, Array] = {}
    sparse = []
    text = {}
    for name in loaded[0].columns:
        if name in used or any(name not in table.columns for table in loaded):
            continue
        try:
            column = np.concatenate([table.numbers(name, gaps=True) for table in loaded])
        except UserError:
            text[name] = len({str(cell) for table in loaded for cell in set(table.columns[name].tolist())})
            continue
        if not np.isnan(column).any():
            extra[name] = column
        elif not np.isnan(column).all():
            sparse.append(name)
    return extra, sparse, text
