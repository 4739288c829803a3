"""A file with several experiments: what tells its runs apart, as [data.read] runs says it, as the column `run`."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Column, meant
from terrapin_tools.workbench.files.number_marks import GAPS

__all__ = ["TIMES", "clock_column", "restarts", "split"]

TIMES = ("zeit", "uhrzeit", "zeitstempel", "temps", "elapsed")  # other words for time
WORDS = ("time", "t", "clock", "timestamp", *TIMES)
WIDE = 20.0  # times the usual step, from which a gap parts runs
MOST = 10_000  # runs of a file
SOME = 100  # rows by which a column is known for one of numbers


def clock_column(columns: Mapping[str, Column]) -> str | None:
    """The first column of numbers whose name says time."""
    for name, column in columns.items():
        words = re.split(r"[^a-z]+", re.sub(r"\[.*", "", name).lower())
        if any(word in WORDS for word in words) and _as_numbers(column[:SOME]) is not None:
            return name
    return None


def restarts(times: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Rows at which a time begins again: it goes back by more than half of what the run before it took."""
    found = []
    begin = 0
    for row in np.flatnonzero(np.diff(times) < 0.0) + 1:
        if times[row - 1] - times[row] > 0.5 * (times[row - 1] - times[begin]):
            found.append(int(row))
            begin = int(row)
    return np.array(found, dtype=np.int64)


def split(columns: Mapping[str, Column], asked: Asked, stem: str) -> tuple[dict[str, Column], list[str]]:
    """The columns with `run`, `stem 1`, `stem 2`, ...; and how. UserError where the file has no such column."""
    kind, _, rest = asked.runs.partition(":")
    if kind in ("", "column"):
        return dict(columns), []
    if kind == "trigger":
        level = _numbers(columns, rest, "runs=trigger")
        middle = 0.5 * (np.nanmin(level) + np.nanmax(level))
        begins = np.flatnonzero((level[1:] > middle) & ~(level[:-1] > middle)) + 1
        how = f"a new run where {rest} rises above {middle:.6g}"
    else:
        name = clock_column(columns)
        if name is None:
            raise UserError(f"runs: found {asked.runs}, expected a column of time, which {stem} does not have")
        times = _numbers(columns, name, "runs")
        if kind == "repeat":
            begins = restarts(times)
            how = f"a new run where {name} begins again"
        else:
            steps = np.diff(times)
            usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
            least = _seconds(rest) if rest else WIDE * usual
            begins = np.flatnonzero((steps > least) | (steps < 0.0)) + 1
            how = f"a new run where {name} jumps by more than {least:.6g}"
    if len(begins) >= MOST:
        raise UserError(f"runs: found {len(begins) + 1} of them by {asked.runs}, expected at most {MOST}")
    number = np.zeros(len(next(iter(columns.values()))), dtype=np.int64)
    number[begins] = 1
    names = np.array([f"{stem} {i}" for i in range(1, len(begins) + 2)], dtype=str)
    label = "run" if "run" not in columns else "run in file"
    return {label: names[np.cumsum(number)], **columns}, [f"{how}: {len(begins) + 1} runs, in column {label!r}"]


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e12:
        raise UserError(f"runs: found gap:{text}, expected gap:SECONDS above 0")
    return value


def _numbers(columns: Mapping[str, Column], name: str, where: str) -> npt.NDArray[np.float64]:
    column = meant(name, columns)
    if column is None:
        raise UserError(f"{where}: found {shorten(name)}, expected one of {', '.join(columns)}")
    found = _as_numbers(columns[column])
    if found is None:
        raise UserError(f"{where}: column {shorten(name)} holds text, expected numbers")
    return found


def _as_numbers(column: Column) -> npt.NDArray[np.float64] | None:
    """A column as numbers, gaps NaN; None for one of text."""
    if column.dtype.kind == "f":
        return np.asarray(column)
    try:
        return np.array([np.nan if cell.strip().lower() in GAPS else float(cell) for cell in map(str, column.tolist())])
    except ValueError:
        return None
