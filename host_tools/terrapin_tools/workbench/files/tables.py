"""Measurements from files: CSV, Parquet, and bus logs with a DBC, as columns of text or numbers with their place.

A table keeps for each row where it stands, so that a complaint about a value names the file and the line.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.logs.reading import is_log
from terrapin_tools.workbench.files.csv_files import read_csv
from terrapin_tools.workbench.files.csv_layout import GAPS
from terrapin_tools.workbench.files.units import LARGEST

__all__ = ["LOG_SUFFIXES", "Table", "read"]

LOG_SUFFIXES = (".log", ".blf", ".asc", ".trc", ".mf4", ".mcap")  # what else may be a log: logs.reading.is_log
Column = npt.NDArray[Any]  # float64, or str where the file holds text


@dataclass(frozen=True)
class Table:
    """One file's rows. `columns` all have the same length; `first_line` is the line of row 0 (0: rows are counted)."""

    path: Path
    columns: dict[str, Column]
    first_line: int
    notes: tuple[str, ...] = ()  # what was assumed about the file, in words

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def place(self, row: int) -> str:
        """Where a row stands, for a message."""
        return f"{self.path.name}:{row + self.first_line}" if self.first_line else f"{self.path.name}: row {row + 1}"

    def numbers(self, name: str, gaps: bool = False) -> npt.NDArray[np.float64]:
        """A column as finite numbers; with `gaps` an empty cell or NaN is NaN. UserError with file, line and field."""
        column = self.columns[name]
        if column.dtype.kind in "fiub":
            values = column.astype(np.float64)
        else:
            texts = [str(cell) for cell in column.tolist()]
            if gaps:
                texts = ["nan" if text.strip().lower() in GAPS else text for text in texts]
            wrong = next((row for row, text in enumerate(texts) if not _is_number(text)), None)
            if wrong is not None:
                text = texts[wrong]
                found = f"text {shorten(text)}" if text.strip() else "an empty cell"
                point = " with a decimal point" if "," in text else ""
                raise UserError(f"{self.place(wrong)}: column {name}: found {found}, expected a number{point}")
            # Not by NumPy's astype: a Ctrl-C that comes while it reads text is lost.
            values = np.array([float(text) for text in texts])
        bad = np.flatnonzero(~((np.abs(values) <= LARGEST) | (gaps & np.isnan(values))))
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
        return [str(v).strip() for v in column.tolist()]


def _is_number(spelling: str) -> bool:
    """As people write numbers in tables: Python's 1_000 and digits of other scripts are text."""
    try:
        float(spelling)
    except ValueError:
        return False
    return spelling.isascii() and "_" not in spelling


def read(
    path: Path,
    dbc: Path | None = None,
    period: float | None = None,
    needed: Collection[str] = (),
    texts: Collection[str] = (),
) -> Table:
    """The rows of one file, read by its suffix.

    Parameters
    ----------
    dbc, period : a log needs both; rows are `period` [s] apart, columns are MESSAGE.SIGNAL and `time` [s].
    needed : signals of a log; the first row is the first in which all of them have come.
    texts : columns of a CSV file that stay text.

    Raises
    ------
    UserError : names the file, and the line or row, and what was expected.
    """
    suffix = path.suffix.lower()
    try:
        if path.is_dir():
            raise UserError(f"{path}: is a folder, expected a file (data.files)")
        if not path.is_file():
            raise UserError(f"{path}: no such file (data.files)")
        return _read(path, suffix, dbc, period, needed, texts)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}, expected a readable file (data.files)") from None


def _read(
    path: Path, suffix: str, dbc: Path | None, period: float | None, needed: Collection[str], texts: Collection[str]
) -> Table:
    if is_log(path):
        if dbc is None or period is None:
            raise UserError(f"{path.name}: a log needs data.dbc and data.period in case.toml")
        return _read_log(path, dbc, period, needed)
    if suffix == ".csv":
        return Table(path, *read_csv(path, texts))
    if suffix == ".parquet":
        return _read_parquet(path)
    raise UserError(f"{path.name}: unknown kind of file {suffix!r}, expected .csv .parquet {' '.join(LOG_SUFFIXES)}")


def _read_parquet(path: Path) -> Table:
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            table = file.read()
    except (pyarrow.ArrowException, OSError) as error:
        raise UserError(f"{path.name}: {str(error).splitlines()[0]}, expected a Parquet file") from None
    twice = {name for name in table.column_names if table.column_names.count(name) > 1}
    if twice:
        raise UserError(f"{path.name}: column {shorten(sorted(twice)[0])} stands twice, expected once")
    columns = {}
    for name in table.column_names:
        column = table.column(name).to_numpy()
        if column.dtype.kind in "fiub":
            columns[name] = column.astype(np.float64)
        else:
            columns[name] = np.array(["" if cell is None else str(cell) for cell in column], dtype=str)
    return Table(path, columns, 0)


def _read_log(path: Path, dbc: Path, period: float, needed: Collection[str]) -> Table:
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.logs.resample import signals_on_grid

    if not dbc.is_file():
        raise UserError(f"{dbc}: no such file (data.dbc)")
    notes: list[str] = []
    columns = dict(signals_on_grid(path, Decoder(dbc), period, needed, notes))
    return Table(path, columns, 0, tuple(notes))
