"""What an uploaded file holds, and what its columns may be: streamed, so that its size is no matter.

    look("day_1.csv", "")         {"kind": "csv", "columns": [...], "rows": ..., "warnings": [...], ...}
    look("run.log", "robot.dbc")  the same of a log's signals
    look("day_1.csv", "", {"decimal": "comma"})    the same, read as somebody says

Runs in the warm worker; progress goes to standard error. A file that is none of its kind is a UserError of one line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.info import Summary
from terrapin_tools.logs.reading import READABLE, LogReader, is_log
from terrapin_tools.progress import bar
from terrapin_tools.web.cases.clock import Clock
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.format import Asked
from terrapin_tools.workbench.files.formats import SUFFIXES as TABLES
from terrapin_tools.workbench.files.streamed_tables import stream
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.new_case.from_tables import (
    base_of,
    clock_of,
    distinct_names,
    guess_base,
    guess_columns,
    guess_run,
    split_unit,
)

__all__ = ["SUFFIXES", "look", "suits"]

DESCRIPTIONS = (".dbc", ".arxml", ".kcd", ".sym")
SUFFIXES = tuple(dict.fromkeys((*TABLES, *DESCRIPTIONS, *READABLE)))
PLAIN = (".csv", ".parquet")
SHOWN = 8  # cells of a column
MAX_COLUMNS = 1000


def look(file: str, dbc: str, said: dict[str, str] | None = None) -> dict[str, Any]:
    """Kind, columns with guesses, rows and warnings. `dbc`: for a log; "": the controller's own. `said`: how a table is
    to be read, as [data.read] of case.toml."""
    path = Path(file)
    suffix = path.suffix.lower()
    if path.stat().st_size == 0:
        raise UserError(f"{path.name}: found no bytes, expected measurements")
    if suffix in DESCRIPTIONS:
        return _look_dbc(path)
    if is_log(path):
        return _look_log(path, Path(dbc) if dbc else paths.dbc())
    return _look_table(path, suffix[1:] if suffix in PLAIN else "table", Asked.of(said or {}, "read"))


def suits(file: str, said: dict[str, str] | None = None) -> dict[str, Any]:
    """The base model for a table, each that suits its columns fitted briefly, and what is said of them; none where the
    table leaves something open, which the mapper asks for."""
    try:
        base, lines = base_of(Path(file), Asked.of(said or {}, "read"))
    except UserError:
        return {"base": "", "lines": []}
    return {"base": base.name, "lines": lines}


class _Columns:
    """What is gathered of a table while it streams by."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.rows = 0
        self.cells: dict[str, list[str]] = {}
        self.text: dict[str, str] = {}  # columns that are no numbers: the first cell that is none, and where
        self.gaps: dict[str, int] = {}  # rows without a number, of columns of numbers
        self.first_gap: dict[str, str] = {}
        self.low: dict[str, float] = {}
        self.high: dict[str, float] = {}
        self.distinct: dict[str, set[str]] = {}

    def take(self, table: Table) -> None:
        if not self.names:
            self.names = list(table.columns)
            if len(self.names) > MAX_COLUMNS:
                raise UserError(f"{table.path.name}: found {len(self.names)} columns, expected at most {MAX_COLUMNS}")
        for name in self.names:
            column = table.columns[name]
            if self.rows < SHOWN:
                self.cells.setdefault(name, []).extend(str(cell) for cell in column[: SHOWN - self.rows].tolist())
            if len(self.distinct.setdefault(name, set())) <= 1000:
                self.distinct[name].update(np.unique(column[:100_000]).astype(str).tolist()[:1001])
            if name in self.text or not table.rows:
                continue
            try:
                values = table.numbers(name, gaps=True)
            except UserError as error:
                self.text[name] = str(error)
                continue
            gap = np.isnan(values)
            if gap.any():
                self.first_gap.setdefault(name, table.place(int(np.argmax(gap))))
                self.gaps[name] = self.gaps.get(name, 0) + int(gap.sum())
            if not gap.all():
                self.low[name] = min(self.low.get(name, np.inf), float(np.nanmin(values)))
                self.high[name] = max(self.high.get(name, -np.inf), float(np.nanmax(values)))
        self.rows += table.rows

    def end(self) -> None:
        """All has been taken: a column of gaps alone holds no numbers."""
        for name, place in self.first_gap.items():
            if name not in self.low:
                self.text.setdefault(name, f"{place}: column {name}: found no number")


def _look_table(path: Path, kind: str, asked: Asked) -> dict[str, Any]:
    gathered, clock = _Columns(), None
    time_column = run_column = None
    for table in stream(path, asked=asked):
        first = not gathered.names
        gathered.take(table)
        if first:
            numeric = [name for name in gathered.names if name not in gathered.text]
            time_column = next((g.column for g in guess_columns(numeric, gathered.text) if g.name == "time"), None)
            run_column = guess_run(gathered.names)
            clock = Clock(split_unit(time_column)[1] or "s") if time_column is not None else None
        if clock is not None and time_column not in gathered.text and time_column is not None:
            runs = table.columns.get(run_column) if run_column is not None else None
            clock.take(table.numbers(time_column, gaps=True), runs, table)
    gathered.end()
    if not gathered.rows:
        raise UserError(f"{path.name}: found a line of names and no rows, expected at least one")
    if {"id", "data", "flags"} <= set(gathered.names):
        raise UserError(f"{path.name}: holds CAN frames, expected a table (terrapin log convert makes a log of it)")
    numeric = [name for name in gathered.names if name not in gathered.text and name != run_column]
    warnings = [] if clock is None else clock.warnings(str(time_column))
    warnings += _gap_warnings(gathered, numeric) + _text_warnings(gathered, run_column) + _unit_warnings(numeric)
    return _answer(kind, gathered.rows, numeric, gathered, run_column, warnings)


def _answer(
    kind: str, rows: int, numeric: list[str], gathered: _Columns, run_column: str | None, warnings: list[str]
) -> dict[str, Any]:
    guesses = {guess.column: guess for guess in guess_columns(numeric, gathered.text)}
    names = distinct_names(gathered.names, clock_of(guesses.values()))
    columns = []
    for name in gathered.names:
        guess = guesses.get(name)
        columns.append(
            {
                "name": name,
                "numeric": name not in gathered.text,
                "unit_guess": guess.unit if guess else "",
                "role_guess": guess.name if guess else None,
                "name_guess": names[name],
                "preview": gathered.cells.get(name, []),
                "min": gathered.low.get(name) if name not in gathered.text else None,
                "max": gathered.high.get(name) if name not in gathered.text else None,
            }
        )
    if not numeric:
        warnings = [*warnings, "found no column of numbers, expected at least one"]
    run = run_column if run_column and len(gathered.distinct.get(run_column, ())) > 1 else None
    return {
        "kind": kind,
        "columns": columns,
        "rows": rows,
        "warnings": warnings[:50],
        "run_guess": run,
        "base_guess": guess_base(list(guesses.values())).name,
    }


def _gap_warnings(gathered: _Columns, numeric: list[str]) -> list[str]:
    """Which columns have rows without a number, and what becomes of these."""
    return [
        f"column {name}: found an empty cell or no number in {gathered.gaps[name]} of {gathered.rows} rows (first at "
        f"{gathered.first_gap[name]}); where it is mapped, they are left out"
        for name in numeric
        if name in gathered.gaps
    ]


def _text_warnings(gathered: _Columns, run_column: str | None) -> list[str]:
    """Why a column that begins like numbers is none: a word, a unit in its cells, a comma."""
    found = []
    for name, reason in gathered.text.items():
        cells = [cell.strip() for cell in gathered.cells.get(name, [])]
        heads = [cell.partition(" ")[0].replace(",", ".") for cell in cells]
        like = sum(_number(head) for head in heads)
        if name == run_column or like == 0:
            continue
        carried = sorted({cell.partition(" ")[2] for cell in cells if _number(cell.partition(" ")[0])} - {""})
        if carried and all(_is_unit(unit) for unit in carried):
            kinds = "mixed units " if len(carried) > 1 else "a unit "
            found.append(
                f"column {name}: found {kinds}in its cells ({', '.join(carried)}), expected plain numbers of one unit"
            )
        else:
            found.append(f"{reason}; the column is taken for text")
    return found


def _unit_warnings(numeric: list[str]) -> list[str]:
    """The same quantity twice, in different units."""
    by_name: dict[str, list[tuple[str, str]]] = {}
    for column in numeric:
        name, unit = split_unit(column)
        if unit:
            by_name.setdefault(name.lower(), []).append((column, unit))
    return [
        f"mixed units: {' and '.join(column for column, _ in same)} look like one quantity; map one of them"
        for same in by_name.values()
        if len({unit for _, unit in same}) > 1
    ]


def _is_unit(text: str) -> bool:
    try:
        units.check(text)
    except ValueError:
        return False
    return True


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _look_dbc(path: Path) -> dict[str, Any]:
    decoder = Decoder(path)
    names = [str(message.name) for message in decoder.messages.values()]
    if not names:
        raise UserError(f"{path.name}: describes no message, expected a DBC file")
    return {"kind": "dbc", "columns": [], "rows": len(names), "warnings": [], "run_guess": None, "base_guess": None}


def _look_log(path: Path, dbc: Path) -> dict[str, Any]:
    decoder = Decoder(dbc)
    summary, log = Summary(decoder), LogReader(path)
    gathered = _Columns()
    unit_of = {str(m.name): dict(decoder.units(str(m.name))) for m in decoder.messages.values()}
    known = 0
    with bar(path.name, log.size) as shown:
        for block in log.blocks(lambda done: shown(completed=done)):
            summary.take(block)
            for message, decoded in decoder.decode(block).items():
                known += len(decoded.rows)
                for signal, values in decoded.signals.items():
                    name, there = f"{message}.{signal}", values[~np.isnan(values)]
                    if not there.size:
                        continue
                    if name not in gathered.low:
                        gathered.names.append(name)
                        gathered.cells[name] = [f"{v:.9g}" for v in there[:SHOWN]]
                    gathered.low[name] = min(gathered.low.get(name, np.inf), float(there.min()))
                    gathered.high[name] = max(gathered.high.get(name, -np.inf), float(there.max()))
    answer = summary.answer()
    if not answer["frames"]:
        raise UserError(f"{path.name}: found no frame, expected a bus log")
    if not known:
        raise UserError(f"{path.name}: found no frame that {dbc.name} knows, expected the DBC of this bus")
    warnings = _log_warnings(answer, log, known, dbc)
    spelt = {f"{name} [{_spelt(unit_of, name)}]": name for name in gathered.names}
    guesses = {spelt[guess.column]: guess for guess in guess_columns(list(spelt))}
    found = _answer("log", answer["frames"], [], gathered, None, [])
    for column in found["columns"]:
        guess = guesses[column["name"]]
        column["unit_guess"], column["role_guess"] = guess.unit, guess.name
    return {**found, "warnings": warnings, "base_guess": guess_base(list(guesses.values())).name}


def _spelt(unit_of: dict[str, dict[str, str]], name: str) -> str:
    message, _, signal = name.partition(".")
    unit = unit_of[message].get(signal, "") or "1"
    return unit if _is_unit(unit) else "1"


def _log_warnings(answer: dict[str, Any], log: LogReader, known: int, dbc: Path) -> list[str]:
    warnings = [text for text in (log.lost, *log.assumed) if text]
    if log.cut:
        warnings.append(f"read up to where it was cut off: {log.cut}")
    if known < 0.9 * answer["frames"]:
        share = 100.0 * known / answer["frames"]
        warnings.append(f"{dbc.name} knows {share:.0f} % of the frames: is it the DBC of this bus?")
    if answer["steps_back"]:
        warnings.append(f"clock: {answer['steps_back']} frames have a time before the frame before them")
    for message in answer["messages"]:
        if message["gap"]:
            name = message["name"] or f"{message['id']:03X}"
            gap = message["gap"]
            warnings.append(f"clock: {name} is silent for {gap['seconds']:.3g} s from {gap['begin']:.3f} s on")
    return warnings
