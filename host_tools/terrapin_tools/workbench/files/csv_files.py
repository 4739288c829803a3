"""CSV files as columns. csv_layout.py finds how they are laid out; a large one without quotes goes through Arrow."""

from __future__ import annotations

import csv
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.csv_layout import Layout, called, find_layout, plain_numbers
from terrapin_tools.workbench.files.format import Asked

__all__ = ["layout_of", "read_csv"]

Columns = dict[str, npt.NDArray[Any]]
PLAIN = Asked()
LARGE = 1_000_000  # bytes from which Arrow reads the file, if it can


def read_csv(path: Path, texts: Collection[str] = (), asked: Asked = PLAIN) -> tuple[Columns, int, tuple[str, ...]]:
    """The columns of a CSV file by name, the line of its first row, and what was assumed about it, in words.

    Columns are text, or numbers where Arrow has read them (large files); those in `texts` stay text.

    Raises
    ------
    UserError : names the file and line.
    OSError : the file cannot be read.
    """
    layout = layout_of(path, asked)
    try:
        columns: Columns | None = None
        if layout.encoding == "utf-8-sig" and not asked.decimal and path.stat().st_size >= LARGE:
            columns = _read_large(path, list(layout.names), layout.delimiter, layout.first, texts)
        if columns is not None:
            columns.pop("", None)
            return columns, layout.first, layout.notes
        cells = _read_any(path, layout)
    except csv.Error as error:
        raise UserError(f"{path.name}: {error}, expected a CSV file") from None
    cells.pop("", None)  # a comma at the end of every line
    told, notes = plain_numbers(cells, layout.delimiter, path.name, layout.first, asked.decimal)
    found = {name: np.array(column, dtype=str) for name, column in told.items()}
    if notes and not layout.notes and layout.delimiter != ",":
        notes.insert(0, f"separator {called(layout.delimiter)}")
    return found, layout.first, (*layout.notes, *notes)


def layout_of(path: Path, asked: Asked = PLAIN) -> Layout:
    """`find_layout`; UserError where the file is no CSV file at all."""
    try:
        return find_layout(path, asked)
    except (csv.Error, UnicodeError) as error:
        raise UserError(f"{path.name}: {error}, expected a CSV file") from None


def _read_any(path: Path, layout: Layout) -> dict[str, list[str]]:
    rows = []
    names, first = layout.names, layout.first
    with path.open(encoding=layout.encoding, newline="") as file:
        for _ in range(first - 1):
            file.readline()
        reader = csv.reader(file, delimiter=layout.delimiter)
        for row in reader:
            if not row:
                continue
            line = reader.line_num + first - 1
            if len(row) == len(names) + 1 and not row[-1].strip():
                row.pop()  # a delimiter at the end of rows, and none behind the names
            if len(row) != len(names):
                hint = " (a decimal comma?)" if layout.delimiter == "," and len(row) > len(names) else ""
                raise UserError(f"{path.name}:{line}: found {len(row)} fields, expected {len(names)}{hint}")
            if any("\0" in cell for cell in row):
                raise UserError(f"{path.name}:{line}: found a byte 0, expected text")
            rows.append(row)
            if len(rows) != reader.line_num:
                raise UserError(f"{path.name}:{line}: found an empty or broken line before this one")
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _read_large(path: Path, header: list[str], delimiter: str, first: int, texts: Collection[str]) -> Columns | None:
    """The same, fifty times as fast; None for whatever needs a second look."""
    import pyarrow.compute
    import pyarrow.csv

    content = path.read_bytes()
    begin = 0
    for _ in range(first - 1):
        begin = content.find(b"\n", begin) + 1
    if b"\0" in content or content.find(b'"', begin) >= 0 or content.count(b"\r") != content.count(b"\r\n"):
        return None
    names = [str(i) for i in range(len(header))]
    try:
        table = pyarrow.csv.read_csv(
            pyarrow.BufferReader(content),
            read_options=pyarrow.csv.ReadOptions(column_names=names, skip_rows=first - 1, use_threads=False),
            parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=False),
            convert_options=pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(names, pyarrow.string())),
        )
    except pyarrow.ArrowException:
        return None
    columns: Columns = {}
    for name, number in zip(header, names, strict=True):
        column = table.column(number)
        if name not in texts:
            try:
                values = pyarrow.compute.cast(column, pyarrow.float64()).to_numpy()
                if not np.isinf(values).any():  # written so, it is a gap; 1e400 is none
                    columns[name] = values
                    continue
            except pyarrow.ArrowException:  # text, or numbers in another spelling
                if delimiter != ",":
                    return None
        columns[name] = column.to_numpy(zero_copy_only=False).astype(str)
    return columns
