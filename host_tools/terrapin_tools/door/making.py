"""Cases of what a program holds: a table in memory becomes a case.toml and a table that it names."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tomlkit

from terrapin_hil.physics.expression import is_name, parse
from terrapin_hil.physics.mechanics import ROLES
from terrapin_hil.reading import shorten
from terrapin_hil.robots import select
from terrapin_tools.door.effect import numbers, plain
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES
from terrapin_tools.workbench.bases import ROLES as BASE_ROLES
from terrapin_tools.workbench.bases.kinds.names import formula_name, in_letters
from terrapin_tools.workbench.case.case import Case, load_case, parse_case
from terrapin_tools.workbench.files.arrow_tables import from_arrow
from terrapin_tools.workbench.files.format import Ambiguous, meant, parted
from terrapin_tools.workbench.files.tables import Table, read
from terrapin_tools.workbench.files.times import clock_name
from terrapin_tools.workbench.files.units import spelling
from terrapin_tools.workbench.new_case.from_columns import document_of
from terrapin_tools.workbench.new_case.from_tables import split_unit
from terrapin_tools.workbench.new_case.reading import files_of
from terrapin_tools.workbench.robot.runs import check_asked, read_run, write_case

__all__ = ["Motion", "case_of", "case_of_runs", "table_of"]

Given = TypeVar("Given")
FILE = "table.parquet"  # in which the table stands when the case is saved


@dataclass(frozen=True)
class Motion:
    """Differential equations of the user's own, as `terrapin_tools.Case.from_table` takes them."""

    states: Mapping[str, Any]
    derivative: Mapping[str, str]
    measured: Mapping[str, str]
    held: bool

    def __post_init__(self) -> None:
        _check_shapes(derivative=self.derivative, measured=self.measured)
        _check_shapes(states=self.states, each=object)

    @property
    def entries(self) -> dict[str, Any]:
        """What an order holds of them; nothing where there are none."""
        if not self.derivative and not self.states:
            return {"states": {}, "derivative": {}, "measured": {}}
        states = {name: _state(name, value) for name, value in self.states.items()}
        found = {"states": states, "derivative": dict(self.derivative), "measured": dict(self.measured)}
        return {**found, "held": self.held}


def table_of(source: object) -> tuple[Table, dict[str, str]]:
    """A table with the units that it tells; a text or Path is the name of a file with one. Several are one below the
    other."""
    tables, told = _tables_of(source)
    return _joined(tables), told


def _tables_of(source: object) -> tuple[list[Table], dict[str, str]]:
    """The tables of a list of files, or of a folder: more than one only of these."""
    listed = [source] if isinstance(source, str | Path) else source
    if isinstance(listed, list | tuple) and listed and all(isinstance(one, str | Path) for one in listed):
        return [_read(file) for file in files_of([Path(one) for one in listed])], {}
    table, told = from_arrow(source, "table")
    return [table], told


def _read(file: Path) -> Table:
    try:
        return read(file)
    except Ambiguous as error:
        raise UserError(f"{error.found}; read it as it is meant (pandas.read_csv), and give the table") from None


def _joined(tables: Sequence[Table]) -> Table:
    """UserError where two tables have not the same columns, or one name."""
    first, *others = tables
    if not others:
        return first
    for other in others:
        if other.columns.keys() != first.columns.keys():
            raise UserError(
                f"{other.path}: found the columns {', '.join(other.columns)}, expected those of {first.path}: "
                f"{', '.join(first.columns)}"
            )
    twice = next((name for name, count in Counter(one.path.stem for one in tables).items() if count > 1), None)
    if twice is not None:
        raise UserError(f"table: two files are called {twice}, expected a name for each: it is the run's")
    columns = {name: np.concatenate([table.columns[name] for table in tables]) for name in first.columns}
    return Table(first.path.parent, columns, 0)


def case_of(
    source: object,
    *,
    base: str,
    run: str,
    columns: Mapping[str, str],
    roles: Mapping[str, str],
    units: Mapping[str, str],
    noise: Mapping[str, float],
    equation: Mapping[str, str],
    constants: Mapping[str, Any],
    fit: Mapping[str, Any],
    effects: Sequence[str],
    limits: Mapping[str, Any],
    train: Iterable[object],
    test: Iterable[object],
    title: str,
    groups: Mapping[str, str],
    motion: Motion,
) -> Case:
    """See `terrapin_tools.Case.from_table`. UserError names the argument that is wrong."""
    _check_shapes(columns=columns, roles=roles, units=units, equation=equation, groups=groups)
    _check_shapes(noise=noise, constants=constants, fit=fit, limits=limits, each=object)
    effects = [effects] if isinstance(effects, str) else effects
    train, test = ([one] if isinstance(one, str) else one for one in (train, test))
    tables, told = _tables_of(source)
    table = _joined(tables)
    channels = equation or motion.measured
    if base not in BASES:
        raise UserError(f"base: found {base!r}, expected one of {', '.join(BASES)}")
    if motion.derivative and not equation and BASES[base].own_names:  # equations of one's own, of motion
        base = next(name for name, one in BASES.items() if one.own_names and one.own_dynamics)
    run_column = meant(run, table.columns) if run else ""
    if run_column is None:
        raise UserError(f"run: found {run!r}, expected one of {', '.join(table.columns)}")
    own = {*fit, *constants, *motion.states}
    every = [*channels.values(), *motion.derivative.values()]
    formulas = {name for formula in every for name in _names_in(formula)} - own
    measured = {column for column in table.columns if column != run_column and _is_whole(table, column)}
    own_units = [column for column in _with_units(table) if column in measured and _bare(column) not in own]
    said = (one for one in units if one not in motion.states)
    clock = ["time"] if motion.derivative else []
    columns = _by_headings(table, base, columns, (*channels, *clock, *roles, *said, *sorted(formulas), *own_units))
    channels, roles = _by_names(table, columns, channels), _by_names(table, columns, roles)
    units, noise = _by_names(table, columns, units), _by_names(table, columns, noise)
    names = _columns(table, base, columns, {**dict.fromkeys(roles, ""), **told, **units}, channels)
    _check_roles(roles, base, names, channels)
    for option, given, known in (("units", units, {**names, **table.columns}), ("noise", noise, channels)):
        unknown = next((name for name in given if name not in known), None)
        if unknown is not None:
            kind = "" if option == "units" else "a channel: "
            raise UserError(f"{option}: found {unknown}, expected {kind}one of {', '.join(known)}")
    mapped = {}
    for name, column in names.items():
        unit = units.get(name) or units.get(column) or told.get(column) or split_unit(column)[1]
        if not unit:
            raise UserError(f"column {column}: found no unit, expected one: units={{{name!r}: 'mm'}}; '1' for none")
        mapped[name] = {
            "column": column,
            "unit": spelling(unit),
            "is": roles.get(name),
            "sigma": plain(noise.get(name)),
        }
    order = {
        "title": title,
        "base": base,
        "effects": [str(one) for one in effects],
        "columns": mapped,
        "equation": dict(channels) if equation else {},
        **motion.entries,
        "parameters": {name: _constant(name, value) for name, value in constants.items()},
        "fit": {
            name: dict(zip(("value", "min", "max", "unit"), numbers(f"fit: {name}", value), strict=True))
            for name, value in fit.items()
        },
        "limits": {name: _limit(name, value) for name, value in limits.items()},
        "run": run_column,
        "train": [_run(one) for one in train],
        "test": [_run(one) for one in test],
    }
    notes = _not_taken(measured - {*names.values()}, base)
    # Without a column for it, a file's name is that of the run.
    held = {f"{one.path.stem}.parquet": replace(one, notes=(*one.notes, *notes)) for one in tables}
    text = _with_more(document_of(order, [*held], maker="terrapin_tools.Case"), table, groups)
    try:
        return parse_case(Path(), text, held)
    except UserError as error:  # the line of a file that is not there says nothing
        place, _, rest = str(error).partition(": ")
        raise UserError(rest if place.startswith("case.toml:") else str(error), error.status) from None


def _with_more(text: str, table: Table, groups: Mapping[str, str]) -> str:
    """The text of a case with parameters that have a value for each group."""
    document: Any = tomlkit.parse(text)
    for name, said in groups.items():
        column = meant(said, table.columns)
        if column is None:
            raise UserError(f"groups: {name}: found {said!r}, expected one of {', '.join(table.columns)}")
        if name not in document.get("fit", {}):
            fitted = ", ".join(document.get("fit", {})) or "(none)"
            raise UserError(f"groups: found {name}, expected a fitted parameter: one of {fitted}")
        document.setdefault("groups", {})[_bare(column)] = {"column": column}
        document["fit"][name]["by"] = _bare(column)
    return tomlkit.dumps(document)


def _state(name: str, value: Any) -> dict[str, Any]:
    value = plain(value)
    start, unit = value if isinstance(value, list) and len(value) == 2 else (value, "")
    if not isinstance(start, float | int | str) or not isinstance(unit, str):
        raise UserError(f"states: {name}: found {shorten(value)}, expected START or (START, UNIT): 'fit' or a number")
    return {"initial": start, **({"unit": spelling(unit)} if unit else {})}


def _check_shapes(each: type = str, **given: object) -> None:
    """UserError unless each argument maps names to what is `each`."""
    for option, value in given.items():
        if not isinstance(value, Mapping):
            raise UserError(f"{option}: found {shorten(value)}, expected a mapping: {option}={{NAME: ...}}")
        for name, one in value.items():
            if not isinstance(name, str) or not isinstance(one, each):
                raise UserError(f"{option}: {name}: found {shorten(one)}, expected texts: {{'NAME': '...'}}")


def _names_in(formula: str) -> Collection[str]:
    try:
        return parse(formula).names
    except ValueError:  # which is told where the case is read
        return ()


def _by_headings(table: Table, base: str, columns: Mapping[str, str], said: Iterable[str]) -> dict[str, str]:
    """Name in the model -> column: `columns`, and what is said of others by their headings, or these without unit."""
    found = {}
    for name, column in columns.items():
        heading = _clock(table, meant(column, table.columns))
        if heading is None:
            raise UserError(f"columns: {name}: found {column!r}, expected one of {', '.join(table.columns)}")
        found[name] = heading
    allowed = {*BASES[base].channels, *BASE_ROLES}
    for one in said:
        heading, bare = _clock(table, meant(one, table.columns)), _bare(one)
        if heading in (None, parted(one)[0]) or heading in found.values() or not is_name(bare):
            continue
        if BASES[base].own_names or bare in allowed:
            found.setdefault(bare, str(heading))
    return found


def _clock(table: Table, heading: str | None) -> str | None:
    """The seconds beside a column of times, which is text."""
    if heading is None or table.columns[heading].dtype.kind != "U":
        return heading
    return clock_name(heading) if clock_name(heading) in table.columns else heading


def _bare(heading: str) -> str:
    """The name that a heading has in formulas, as far as letters can write it."""
    bare = parted(heading)[0]
    return bare if is_name(bare) else in_letters(bare)


def _is_whole(table: Table, column: str) -> bool:
    """Whether a column is of numbers, without gaps."""
    try:
        return not np.isnan(table.numbers(column, gaps=True)).any()
    except UserError:
        return False


def _with_units(table: Table) -> list[str]:
    """The headings with a unit that can be read, whose bare name no other one has."""
    bares = Counter(map(_bare, table.columns))
    return [one for one in table.columns if parted(one)[1] and split_unit(one)[1] and bares[_bare(one)] == 1]


def _not_taken(columns: Collection[str], base: str) -> list[str]:
    """What to say of columns of numbers that no name in the model means, though one could."""
    own, roles = BASES[base].own_names, {*BASES[base].channels, *BASE_ROLES}
    left = sorted(one for one in columns if (not is_name(formula_name(one)) if own else _bare(one) in roles))
    if not left:
        return []
    name = _bare(left[0])
    how = f"columns={{{name!r}: {left[0]!r}}}, " * (name != left[0]) + f"units={{{name!r}: UNIT}}"
    return [f"in no formula, as no name or no unit tells what they are: {', '.join(left)} ({how} takes one)"]


def _by_names(table: Table, columns: Mapping[str, str], given: Mapping[str, Given]) -> dict[str, Given]:
    """What is given of columns by the names that these have in the model, or by their headings where they have none."""
    names = {column: name for name, column in columns.items()}
    found = {}
    for said, value in given.items():
        heading = meant(said, table.columns) or said
        found[said if said in columns else names.get(heading, heading)] = value
    return found


def _columns(
    table: Table, base: str, columns: Mapping[str, str], units: Mapping[str, str], equation: Mapping[str, str]
) -> dict[str, str]:
    """Name -> column: those that are named, those of an equation, and those that have a unit and a fitting name."""
    known = dict(columns)
    own = BASES[base].own_names
    for column in table.columns:
        used = column in equation or (column in units and (own or column in {*BASES[base].channels}))
        role = not own and column in units and column not in columns.values()
        name = column if is_name(formula_name(column)) else in_letters(column)
        if (used or role) and column not in known.values() and is_name(formula_name(name)):
            known.setdefault(name, column)
    lost = next((name for name in equation if name not in known), None)
    if lost is not None:
        option = "measured" if BASES[base].own_dynamics else "equation"
        if not is_name(formula_name(lost)):
            raise UserError(
                f"{option}: found {lost!r}, expected a name that formulas know, of letters a to z, digits and _; "
                f"columns={{{in_letters(lost)!r}: {lost!r}}} gives a column one"
            )
        raise UserError(f"{option}: {lost} is no column of the table, expected one of {', '.join(table.columns)}")
    if own and not BASES[base].own_dynamics and not equation:
        raise UserError('equation: found none, expected a formula for each channel: equation={"M": "a + b*w"}')
    if not known:
        raise UserError("units: found none, expected the unit of each column that the model uses: units={'w': 'rpm'}")
    return known


def _check_roles(roles: Mapping[str, str], base: str, names: Mapping[str, str], equation: Mapping[str, str]) -> None:
    if roles and not BASES[base].own_names:
        raise UserError(f'roles: expected only with base "equation", found base {base}, whose columns have theirs')
    inputs = [name for name in names if name not in equation]
    for name, role in roles.items():
        if name not in inputs:
            raise UserError(f"roles: found {name}, expected an input of the model: one of {', '.join(inputs)}")
        if role not in ROLES:
            raise UserError(f"roles: {name}: found {role!r}, expected one of {', '.join(ROLES)}")


def _constant(name: str, value: Any) -> Any:
    value = plain(value)
    if isinstance(value, list) and len(value) == 2 and isinstance(value[1], str):
        return f"{value[0]!r} {spelling(value[1])}"
    if not isinstance(value, float | int | str):
        raise UserError(f"constants: {name}: found {value!r}, expected a number, (NUMBER, UNIT) or '80 mm'")
    return value


def _limit(name: str, value: Any) -> dict[str, Any]:
    parts = plain(value)
    if not isinstance(parts, list) or len(parts) not in (2, 3):
        raise UserError(f"limits: {name}: found {value!r}, expected (MIN, MAX) or (MIN, MAX, UNIT)")
    return {"min": parts[0], "max": parts[1], "unit": spelling(parts[2]) if len(parts) == 3 else ""}


def _run(name: object) -> str:
    """As the table's text has it: run 3.0 is "3"."""
    return str(int(name)) if isinstance(name, float) and name.is_integer() else str(name)


def case_of_runs(
    logs: Sequence[Any],
    effects: Sequence[str],
    after: float,
    before: float,
    span: float | None,
    soil: str,
    title: str,
    robot: str,
) -> Case:
    """See `terrapin_tools.Case.from_log`."""
    if robot:
        select(robot)
    check_asked(effects, span, soil)
    runs = [read_run(Path(getattr(log, "path", log)), after, before, span) for log in logs]
    with tempfile.TemporaryDirectory() as scratch:
        write_case(Path(scratch), runs, title, effects, soil)
        made = load_case(Path(scratch))
        table = read(Path(scratch, "runs.csv"), texts={"run"})
    document: Any = tomlkit.parse(made.text)
    document["data"]["files"] = [FILE]
    return parse_case(Path(), tomlkit.dumps(document), {FILE: replace(table, path=Path("runs"), first_line=0)})
