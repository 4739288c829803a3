"""A fitted case's model on rows that it never saw, with the sd of what it says."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import tomlkit

from terrapin_hil.arrays import Array
from terrapin_hil.physics.expression import parse
from terrapin_hil.units import behind
from terrapin_tools.errors import UserError, about
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.bases.kinds.algebraic import Algebraic
from terrapin_tools.workbench.case.case import Case, parse_case
from terrapin_tools.workbench.case.groups import LEAST
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.files.arrow_tables import labelled
from terrapin_tools.workbench.files.format import meant, parted
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.units import convert, spelling
from terrapin_tools.workbench.model.fitting import covariance

__all__ = ["noise_sd", "parameter_covariance", "predicted"]

FILE = "new.parquet"
RUN = "__run__"  # of a table whose case has each run in a file of its own
BESIDE = 0.1  # of a column's range, by which new rows may lie beside it unsaid
STACK = 5  # calls from a warning to the caller of `Case.predict`


def parameter_covariance(analysis: Analysis) -> Array:
    """Covariance of the fitted parameters (parameters, parameters): what goes with what as the noise has it, and each
    one's sd as the answer tells it."""
    found = covariance(analysis.fit, analysis.case.run[analysis.case.train], analysis.told.node)
    size = np.sqrt(np.maximum(np.diag(found[0]), 1e-300))
    return np.asarray(found[0] / np.outer(size, size) * np.outer(analysis.sd, analysis.sd))


def noise_sd(analysis: Analysis, channel: int, predicted: Array) -> Array:
    """Sd (rows,) of one measurement in a run of its own around what a channel is predicted to be: of its row, which may
    grow with the reading, and of what differs from run to run (noise/covariance.py)."""
    node, stated = analysis.told.node.of(channel), bool(analysis.told.known[channel])
    rms = float(np.sqrt(np.mean(analysis.prediction[channel] ** 2)))
    reading = (predicted / rms if rms > 0.0 else np.ones(len(predicted))) ** 2
    row = 1.0 - node.grow + node.grow * reading
    both = float(analysis.told.sigma[channel]) ** 2  # where it is not stated: of a row, and between runs
    own = both if stated else both / node.floor**2
    beside = max(float(np.mean(analysis.residual[channel] ** 2)), both) - own if stated else both - own
    return np.asarray(
        np.sqrt(own * row + (beside / node.between(1.0) * node.between(reading) if node.floor > 1.0 else 0.0))
    )


def predicted(analysis: Analysis, table: Table, units: dict[str, str]) -> Any:
    """A row for each of `table`, which has the columns of the case by their headings or bare names there, or by their
    names in the model, in the units of the case where `units` or the heading does not tell others; channels may be
    absent.

    Returns a pyarrow.Table: of each channel NAME what the model says, NAME_sd its sd from the sds of the parameters,
    and NAME_noise_sd, that of one measurement in a run of its own. UserError when a column is missing or its unit is of
    another kind.
    """
    case = analysis.case
    new = _rows(case, _with_every_group(case, table), units)
    model = replace(analysis.fit.model, case=new)
    _warn_outside(case, new, table.rows)
    values, slopes = model.bind(new.inputs, np.ones(new.rows, dtype=bool)).jacobian(analysis.fit.theta)
    values, slopes = values[:, : table.rows], slopes[:, : table.rows]
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=0))[0])
        raise UserError(f"{new.place(row)}: the model gives no number for this row")
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    variance = np.einsum("crp,pq,crq->cr", slopes, parameter_covariance(analysis), slopes)
    columns: dict[str, Array] = {}
    for i, name in enumerate(model.channels):
        columns[name] = values[i]
        columns[f"{name}_sd"] = np.sqrt(np.maximum(variance[i], 0.0))
        columns[f"{name}_noise_sd"] = noise_sd(analysis, i, values[i])
    return labelled(columns, {name: case.units[name.removesuffix("_sd").removesuffix("_noise")] for name in columns})


def _with_every_group(case: Case, table: Table) -> Table:
    """The rows, and behind them a run of each group, as a case has them. Without a column for it each group is a run.
    UserError for a group that no parameter was fitted for."""
    document: Any = tomlkit.parse(case.text)
    columns = {name: str(entry["column"]) for name, entry in document.get("groups", {}).items()}
    if not columns:
        return table
    mine: dict[str, list[str]] = {}
    for name, column in columns.items():
        told, known = meant(column, table.columns), case.groups[name].names
        if told is None:
            raise UserError(f"column {column}: is missing, expected it: the model has a value for each of its groups")
        mine[column] = table.text(told)
        if unknown := [one for one in mine[column] if one not in known]:
            raise UserError(f"column {column}: found {unknown[0]!r}, expected one of {', '.join(known)}")
    run = str(document["data"].get("run", RUN))
    runs = table.text(run) if run in table.columns else [" ".join(one) for one in zip(*mine.values(), strict=True)]
    first = np.flatnonzero(np.array(runs) == runs[0])
    first = np.resize(first, max(len(first), LEAST) if case.base.whole_runs else LEAST)
    each = [(column, group) for name, column in columns.items() for group in case.groups[name].names]
    joined = {name: np.concatenate([values, *[values[first]] * len(each)]) for name, values in table.columns.items()}
    for column, said in mine.items():
        others = (group if own == column else said[0] for own, group in each)
        joined[column] = np.array([*said, *(one for one in others for _ in first)])
    joined[run] = np.array([*runs, *(f"{column} {group}" for column, group in each for _ in first)])
    return replace(table, columns=joined)


def _rows(case: Case, table: Table, units: dict[str, str]) -> Case:
    """The case with other rows; what it says of files, runs and noise goes. What is not needed is 0."""
    document: Any = tomlkit.parse(case.text)
    data = document["data"]
    columns = dict(table.columns)
    needed, derived = _needed(case), data.get("derived", {})
    read = {str(entry["column"]) for name, entry in data["columns"].items() if name in needed}
    for name, entry in data["columns"].items():
        column, unit = str(entry["column"]), str(entry.get("unit", ""))
        told = next((one for said in (column, parted(column)[0], name) if (one := meant(said, columns))), None)
        if told is not None:
            own = units.get(told) or (parted(told)[1] if told != column else "") or unit
            with about(f"column {told}"):
                other = spelling(own) != spelling(unit)
                columns[column] = convert(table.numbers(told), spelling(own), unit) if other else columns[told]
            if told not in (column, name):
                del columns[told]
        if column in derived:
            continue
        if name not in needed and (column not in columns or not (derived or column in read)):  # or it has gaps
            columns[column] = np.zeros(table.rows)
        if column not in columns:
            why = f"a run starts where it fits {name}" if name in case.channels else f"the model needs {name}"
            raise UserError(f"column {column}: is missing, expected it: {why}")
    for name in sorted(_read_by_formulas(case)):
        if name not in columns:
            raise UserError(f"column {name}: is missing, expected it: the model needs {name}")
        if np.isnan(table.numbers(name, gaps=True)).any():
            raise UserError(f"column {name}: has a gap, expected a number in every row: the model needs {name}")
    run = str(data.get("run", RUN if RUN in columns else ""))
    if run and run not in columns:
        columns[run] = np.full(table.rows, "new")
    rows = Table(table.path, columns, table.first_line)
    data["files"], data["test"] = [FILE], []
    if run:
        data["run"] = run
    data["train"] = list(dict.fromkeys(rows.text(run))) if run else [table.path.stem]  # none of them is fitted
    new = parse_case(case.folder, tomlkit.dumps(document), {FILE: rows})
    if new.rows_left_out:
        raise UserError(f"table: {new.remarks[0]}")
    return new


def _needed(case: Case) -> set[str]:
    """Names of [data.columns] that the model reads: channels are read where a run's own motion starts from them."""
    effects = [case.library[name] for name in case.effects]
    if case.base.whole_runs or case.dynamics is not None:
        return {*case.roles, *case.channels}
    reads = case.base.reads() if isinstance(case.base, Algebraic) else None
    if any(one.transform for one in effects) or (reads is None and not case.base.own_names):
        return {*case.roles}  # a lag reads the time, which its formula does not name
    used = {*(reads or ())} | {name for formula in case.equations.values() for name in formula.names}
    used = used.union(*(parse(one.expression).names for one in effects))
    return {name for name in case.roles if formula_name(name) in used or name in used}


def _read_by_formulas(case: Case) -> set[str]:
    """Unmapped columns that formulas of the model name."""
    formulas = [*case.equations.values(), *(parse(case.library[name].expression) for name in case.effects)]
    return case.extra.keys() & {name for formula in formulas for name in formula.names}


def _warn_outside(case: Case, new: Case, rows: int) -> None:
    """Says where new rows lie beside those that the model was fitted on, by more than a part of their range."""
    for name in sorted({*_needed(case) - {*case.channels, "time"}, *_read_by_formulas(case)}):
        key = formula_name(name) if name in case.roles else name
        known, asked = case.inputs[key][case.train], new.inputs[key][:rows]
        low, high = float(known.min()), float(known.max())
        off = np.maximum(low - asked, asked - high)
        row = int(np.argmax(off))
        if off[row] > BESIDE * (high - low):
            unit = behind(case.units.get(name, ""))
            count = int((off > BESIDE * (high - low)).sum())
            warnings.warn(
                f"{count} of {rows} rows lie outside what the model was fitted on: {name} {asked[row]:.4g}{unit}, "
                f"fitted on {low:.4g} to {high:.4g}{unit}",
                stacklevel=STACK,
            )
