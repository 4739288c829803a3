"""Tables for a new case: folders of them, what they leave open asked, their runs and groups told apart."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Ambiguous, Asked
from terrapin_tools.workbench.files.formats import SUFFIXES, format_of
from terrapin_tools.workbench.files.split_runs import WIDE, clock_column, restarts
from terrapin_tools.workbench.files.tables import Table, read

__all__ = [
    "Ask", "assumptions", "files_of", "first_gap", "guess_groups", "read_all", "refuse", "told_gaps",
    "told_others", "told_repeats", "with_runs",
]  # fmt: skip

Ask = Callable[[str, Sequence[str], str], str]  # a question, likely answers, the option that answers it
QUESTIONS = 10  # that one set of files may raise
MOST_ROWS = 200_000  # in which copies are looked for
MOST_GROUPS = 6  # values of a column that groups runs


def refuse(question: str, choices: Sequence[str], option: str) -> str:
    """Nobody is there to answer: UserError that names the option."""
    raise UserError(f"{question} {' or '.join(choices)}? Say it with {option}")


def files_of(paths: Sequence[Path]) -> list[Path]:
    """The files, and for a folder the tables in it, each a run. UserError for a folder without one."""
    found: list[Path] = []
    for path in paths:
        if not path.is_dir() or format_of(path) is not None:
            found.append(path)
            continue
        inner = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))
        if not inner:
            raise UserError(f"{path}: found no table in the folder, expected files that end in {' '.join(SUFFIXES)}")
        found += inner
    return found


def read_all(files: Sequence[Path], asked: Asked, ask: Ask) -> tuple[list[Table], Asked]:
    """The tables, and `asked` with the answers to what they leave open. UserError where nobody answers."""
    for _ in range(QUESTIONS):
        try:
            return [read(file, asked=asked) for file in files], asked
        except Ambiguous as open_:
            if ask is refuse:
                raise
            answer = ask(f"{open_.found}.", open_.choices, f"--read {open_.key}=...")
            asked = asked.also(open_.key, answer)
    raise UserError(f"{files[0].name}: leaves more than {QUESTIONS} things open, expected --read to say them")


def with_runs(tables: list[Table], run: str | None, asked: Asked) -> tuple[list[Table], Asked]:
    """The tables, read again with a run wherever a time begins again, if nothing else tells the runs apart."""
    if run is not None or asked.runs:
        return tables, asked
    if not any(_begins(table).size for table in tables):
        return tables, asked
    again = asked.also("runs", "repeat")
    return [read(table.path, asked=again) for table in tables], again


def _times(table: Table) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    name = clock_column(table.columns)
    try:
        return np.array([]) if name is None else table.numbers(name, gaps=True)
    except UserError:
        return np.array([])


def _begins(table: Table) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return restarts(_times(table))


def told_gaps(tables: Sequence[Table], asked: Asked, run: str | None) -> list[str]:
    """Where a time jumps within a run, which may part two experiments; a line for the first."""
    if asked.runs:
        return []
    for table in tables:
        steps = np.diff(_times(table))
        if run in table.columns and steps.size:
            names = np.array(table.text(run))
            steps = np.where(names[1:] == names[:-1], steps, 0.0)
        forward = steps[steps > 0.0]
        if forward.size > WIDE and steps.max() > WIDE * float(np.median(forward)):
            row = int(np.argmax(steps)) + 1
            name = clock_column(table.columns)
            return [f"{table.place(row)}: {name} jumps by {steps.max():.4g}: several runs? --read runs=gap parts them."]
    return []


def first_gap(tables: Sequence[Table], names: Sequence[str]) -> str:
    """Where the first row stands that has no number in one of these columns; "" for none."""
    for table in tables:
        gaps = np.any([np.isnan(table.numbers(name, gaps=True)) for name in names], axis=0)
        if gaps.any():
            return table.place(int(np.argmax(gaps)))
    return ""


def told_repeats(tables: Sequence[Table]) -> list[str]:
    """Rows that are another's copy, where they are few: a coarse sensor repeats many."""
    found = []
    for table in tables:
        if table.rows > MOST_ROWS or len(table.columns) < 2:
            continue
        kind = np.zeros(table.rows, dtype=np.int64)  # equal where rows are equal in the columns so far
        for column in map(np.asarray, table.columns.values()):
            values = column if column.dtype.kind in "fiub" else column.astype(str)
            own = np.unique(values, return_inverse=True)[1].reshape(-1)
            kind = np.unique(kind * table.rows + own, return_inverse=True)[1].reshape(-1)
        _, begins, kind = np.unique(kind, return_index=True, return_inverse=True)
        first = begins[kind.reshape(-1)]
        copies = np.flatnonzero(first != np.arange(table.rows))
        if 0 < len(copies) <= max(1, table.rows // 20):
            row, other = int(copies[0]), int(first[copies[0]])
            more = f", and {len(copies) - 1} more" if len(copies) > 1 else ""
            found.append(f"{table.place(row)}: the same in every column as {table.place(other)}{more}: read twice?")
    return found


def told_others(tables: Sequence[Table], common: Sequence[str]) -> list[str]:
    """Columns that not all files have. UserError where only their unit differs."""
    found: dict[str, None] = {}
    for table in tables:
        for name in table.columns:
            if name in common:
                continue
            plain, unit = _parted(name)
            for other in tables:
                for twin in other.columns:
                    same, differs = _parted(twin)
                    if same == plain and unit and differs and unit != differs and twin not in table.columns:
                        raise UserError(
                            f"{other.path.name}: column {twin}: found {differs}, expected {unit} as in "
                            f"{table.path.name}: mixed units"
                        )
            found[name] = None
    return [f"Not in every file, so left out: {', '.join(found)}"] if found else []


def _parted(name: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*", name)
    return (match[1].lower(), match[2]) if match else (name.lower(), "")


def guess_groups(tables: Sequence[Table], run: str | None, texts: Sequence[str]) -> dict[str, list[str]]:
    """Columns of text that have one value a run, and several runs to train on for each: name -> values."""
    if run is None:
        return {}
    found = {}
    rows = [name for table in tables for name in table.text(run)]
    names = sorted(set(rows))
    held = {*(names[4::5] if len(names) >= 5 else names[-1:])}
    for column in texts:
        cells = [cell for table in tables for cell in table.text(column)]
        values = sorted(set(cells))
        if not 2 <= len(values) <= MOST_GROUPS or "" in values or not any(re.search(r"[^\W\d]", v) for v in values):
            continue
        pairs = set(zip(rows, cells, strict=True))
        training = [sum(value == mine and name not in held for name, value in pairs) for mine in values]
        if len(pairs) == len(names) and min(training) >= 2:
            found[column] = values
    return found


def assumptions(tables: Sequence[Table]) -> str:
    """What was assumed about the files, a line for each thing, files of the same kind together; "" for nothing."""
    kinds: dict[tuple[str, ...], list[str]] = {}
    for table in tables:
        kinds.setdefault(table.notes, []).append(table.path.name)
    lines = []
    for notes, (first, *more) in kinds.items():
        if notes:
            lines.append(
                f"{first}{f' and {len(more)} more' if more else ''}, as read (--read KEY=VALUE says otherwise):"
            )
            lines += [f"  {note}" for note in notes]
    return "\n".join(lines)
