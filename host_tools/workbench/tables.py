"""Measurements from files: CSV, Parquet, and bus logs with a DBC, as columns of text or numbers with their place.

A table keeps for each row where it stands, so that a complaint about a value names the file and the line.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.reading import shorten
from host_tools.errors import UserError
from host_tools.workbench.units import LARGEST

__all__ = ["LOG_SUFFIXES", "Table", "log_frames", "read", "resample"]

LOG_SUFFIXES = (".log", ".blf", ".asc", ".mf4")
DISORDER = 1.0  # s by which frames of several channels may be out of order
MOST_ROWS = 1e7  # that a log may give
Column = npt.NDArray[Any]  # float64, or str where the file holds text


@dataclass(frozen=True)
class Table:
    """One file's rows. `columns` all have the same length; `first_line` is the line of row 0 (0: rows are counted)."""

    path: Path
    columns: dict[str, Column]
    first_line: int

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def place(self, row: int) -> str:
        """Where a row stands, for a message."""
        return f"{self.path.name}:{row + self.first_line}" if self.first_line else f"{self.path.name}: row {row + 1}"

    def numbers(self, name: str) -> npt.NDArray[np.float64]:
        """A column as finite numbers. UserError with file, line and field where it is not."""
        column = self.columns[name]
        if column.dtype.kind not in "fiub":
            texts = column.tolist()
            row = next((i for i, text in enumerate(texts) if not _is_number(text)), None)
            if row is not None:
                found = f"text {shorten(texts[row])}" if str(texts[row]).strip() else "an empty cell"
                raise UserError(f"{self.place(row)}: column {name}: found {found}, expected a number")
        values = column.astype(np.float64)
        bad = np.flatnonzero(~(np.abs(values) <= LARGEST))
        if bad.size:
            row = int(bad[0])
            found = "NaN" if np.isnan(values[row]) else "infinity" if np.isinf(values[row]) else f"{values[row]:g}"
            raise UserError(
                f"{self.place(row)}: column {name}: found {found}, expected a finite number below {LARGEST:g}"
            )
        return values

    def text(self, name: str) -> list[str]:
        """A column as text; whole numbers without a decimal point, so that run 3.0 of a Parquet file is "3"."""
        column = self.columns[name]
        if column.dtype.kind == "f":
            return ["" if np.isnan(v) else str(int(v)) if float(v).is_integer() else str(v) for v in column]
        return [str(v).strip() for v in column]


def _is_number(text: object) -> bool:
    """As people write numbers in tables: Python's 1_000 and digits of other scripts are text."""
    spelling = str(text)
    try:
        float(spelling)
    except ValueError:
        return False
    return spelling.isascii() and "_" not in spelling


def read(path: Path, dbc: Path | None = None, period: float | None = None, needed: Collection[str] = ()) -> Table:
    """Read one file by its suffix. UserError names what is wrong.

    Logs need `dbc` and `period` [s]; they give columns MESSAGE.SIGNAL and `time` [s], from the first row on in which
    all the `needed` signals have come.
    """
    suffix = path.suffix.lower()
    try:
        if path.is_dir():
            raise UserError(f"{path}: is a folder, expected a file (data.files)")
        if not path.is_file():
            raise UserError(f"{path}: no such file (data.files)")
        return _read(path, suffix, dbc, period, needed)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}, expected a readable file (data.files)") from None


def _read(path: Path, suffix: str, dbc: Path | None, period: float | None, needed: Collection[str]) -> Table:
    if suffix == ".csv":
        return _read_csv(path)
    if suffix == ".parquet":
        return _read_parquet(path)
    if suffix in LOG_SUFFIXES:
        if dbc is None or period is None:
            raise UserError(f"{path.name}: a log needs data.dbc and data.period in case.toml")
        return resample(path, log_frames(path, dbc), period, needed)
    raise UserError(f"{path.name}: unknown kind of file {suffix!r}, expected .csv .parquet {' '.join(LOG_SUFFIXES)}")


def _read_csv(path: Path) -> Table:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            header = [name.strip() for name in next(reader, [])]
            if not any(header):
                raise UserError(f"{path.name}:1: found nothing, expected a line of column names")
            if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
                raise UserError(f"{path.name}:1: found {shorten(header[0])}, expected names separated by commas")
            if any("\0" in name for name in header):
                raise UserError(f"{path.name}:1: found a byte 0, expected text")
            twice = {name for name in header if header.count(name) > 1}
            if twice:
                raise UserError(f"{path.name}:1: column {sorted(twice)[0]!r} stands twice, expected once")
            rows = []
            for row in reader:
                if not row:
                    continue
                if len(row) != len(header):
                    raise UserError(f"{path.name}:{reader.line_num}: found {len(row)} fields, expected {len(header)}")
                if any("\0" in cell for cell in row):
                    raise UserError(f"{path.name}:{reader.line_num}: found a byte 0, expected text")
                rows.append(row)
                if len(rows) + 1 != reader.line_num:
                    raise UserError(f"{path.name}:{reader.line_num}: found an empty or broken line before this one")
    except UnicodeDecodeError as error:
        raise UserError(f"{path.name}: byte {error.start} is not UTF-8 text, expected a CSV file") from None
    except csv.Error as error:
        raise UserError(f"{path.name}: {error}, expected a CSV file") from None
    return Table(path, {name: np.array([row[i] for row in rows], dtype=str) for i, name in enumerate(header)}, 2)


def _read_parquet(path: Path) -> Table:
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
    except (pyarrow.ArrowException, OSError) as error:
        raise UserError(f"{path.name}: {str(error).splitlines()[0]}, expected a Parquet file") from None
    columns = {}
    for name in table.column_names:
        column = table.column(name).to_numpy()
        if column.dtype.kind in "fiub":
            columns[name] = column.astype(np.float64)
        else:
            columns[name] = np.array(["" if cell is None else str(cell) for cell in column], dtype=str)
    return Table(path, columns, 0)


def log_frames(path: Path, dbc: Path, wanted: Collection[str] = ()) -> Iterator[tuple[float, dict[str, float]]]:
    """Time [s] and signals, named MESSAGE.SIGNAL, of every frame that the DBC knows (and `wanted` names, if any)."""
    import cantools

    if not dbc.is_file():
        raise UserError(f"{dbc}: no such file (data.dbc)")
    try:
        database: Any = cantools.database.load_file(dbc)
    except (cantools.Error, UnicodeDecodeError, ValueError) as error:
        raise UserError(f"{dbc.name}: {str(error).splitlines()[0]}, expected a DBC file") from None
    messages = {(m.frame_id, m.is_extended_frame): m for m in database.messages if not wanted or m.name in wanted}
    latest = -np.inf
    for time, identifier, data, place in _candump(path) if path.suffix.lower() == ".log" else _other_log(path):
        if time < latest - DISORDER:
            raise UserError(f"{place}: found time {time:.6f} s after {latest:.6f} s, expected times that rise")
        latest = max(latest, time)
        message = messages.get(identifier)
        if message is None:
            continue
        try:
            signals = message.decode(data, decode_choices=False, allow_truncated=True)
        except (cantools.Error, ValueError) as error:
            raise UserError(f"{place}: message {message.name}: {error}") from None
        yield time, {f"{message.name}.{name}": float(value) for name, value in signals.items()}


# ID#DATA, ID#R (remote), ID##FDATA (CAN FD, with a digit of flags); candump -x adds the direction.
_LINE = re.compile(
    r"\((\d+(?:\.\d+)?)\)\s+\S+\s+([0-9A-F]{3}|[0-9A-F]{8})#(?:(R)\d?|(?:#[0-9A-F])?((?:[0-9A-F]{2})*))(?:\s+[RT])?\s*",
    re.IGNORECASE,
)


def _candump(path: Path) -> Iterator[tuple[float, tuple[int, bool], bytes, str]]:
    """Data frames; a last line without its end is one that a crash cut off, and is left out."""
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, 1):
            if not line.strip() or not line.endswith("\n"):
                continue
            match = _LINE.fullmatch(line)
            if match is None:
                raise UserError(
                    f"{path.name}:{number}: found {shorten(line.strip())}, expected (seconds) channel ID#DATA"
                )
            if match[3] is None:
                identifier = int(match[2], 16), len(match[2]) == 8
                yield float(match[1]), identifier, bytes.fromhex(match[4]), f"{path.name}:{number}"


def _other_log(path: Path) -> Iterator[tuple[float, tuple[int, bool], bytes, str]]:
    import can

    try:
        with can.LogReader(path) as reader:
            for number, message in enumerate(reader, 1):
                if not (message.is_remote_frame or message.is_error_frame):
                    place = f"{path.name}: frame {number}"
                    identifier = message.arbitration_id, message.is_extended_id
                    yield message.timestamp, identifier, bytes(message.data), place
    except UserError:
        raise
    except Exception as error:  # each reader of python-can has its own way of failing on a broken file
        raise UserError(f"{path.name}: {type(error).__name__}: {error}, expected a bus log") from None


def resample(
    path: Path, frames: Iterator[tuple[float, dict[str, float]]], period: float, needed: Collection[str] = ()
) -> Table:
    """Signals on the grid 0, period, 2 period ... [s] from the first frame on; the last value is held.

    Rows before the first in which all `needed` signals have come are dropped; other signals are NaN until they come.
    """
    times: dict[str, list[float]] = {}
    values: dict[str, list[float]] = {}
    first = last = None
    for time, signals in frames:
        first = time if first is None else first
        last = time if last is None or time > last else last
        for name, value in signals.items():
            times.setdefault(name, []).append(time - first)
            values.setdefault(name, []).append(value)
    if first is None or last is None:
        raise UserError(f"{path.name}: found no frame that the DBC knows")
    steps = (last - first) / period
    if not steps < MOST_ROWS:
        raise UserError(
            f"{path.name}: found {last - first:g} s of log, {steps:.3g} rows with data.period {period:g} s, "
            f"expected at most {MOST_ROWS:g}"
        )
    grid = np.arange(int(steps + 1e-9) + 1) * period
    columns: dict[str, Column] = {}
    start = 0.0
    for name, stamps in times.items():
        stamp, order = np.array(stamps), np.argsort(stamps, kind="stable")
        index = np.searchsorted(stamp[order], grid + 1e-9 * period, side="right") - 1
        columns[name] = np.where(index >= 0, np.array(values[name])[order][np.maximum(index, 0)], np.nan)
        if name in needed:
            start = max(start, float(stamp.min()))
    keep = grid + 1e-9 * period >= start
    return Table(path, {"time": grid[keep], **{name: column[keep] for name, column in columns.items()}}, 0)
