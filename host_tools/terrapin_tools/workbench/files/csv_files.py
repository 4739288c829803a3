"""CSV as laboratories write it: commas, semicolons or tabs between the fields, decimal commas where those do not stand
between them, a byte order mark, comment lines at the top. A large file without quotes goes through Arrow.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError

__all__ = ["read_csv", "read_header"]

Columns = dict[str, npt.NDArray[Any]]
LARGE = 1_000_000  # bytes from which Arrow reads the file, if it can
MAX_TOP = 1000  # comment lines
_NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?")
_COMMA = re.compile(r"\s*[-+]?(?:\d+,?\d*|,\d+)(?:[eE][-+]?\d+)?\s*")


def read_csv(path: Path, texts: Collection[str] = ()) -> tuple[Columns, int]:
    """The columns of a CSV file by name, and the line of its first row.

    Columns are text, or numbers where Arrow has read them (large files); those in `texts` stay text.

    Raises
    ------
    UserError : names the file and line.
    OSError : the file cannot be read.
    """
    try:
        header, delimiter, first = read_header(path)
        columns = _read_large(path, header, delimiter, first, texts) if path.stat().st_size >= LARGE else None
        if columns is None:
            columns = _read_any(path, header, delimiter, first)
    except UnicodeDecodeError as error:
        raise UserError(f"{path.name}: byte {error.start} is not UTF-8 text, expected a CSV file in UTF-8") from None
    except csv.Error as error:
        raise UserError(f"{path.name}: {error}, expected a CSV file") from None
    columns.pop("", None)  # a comma at the end of every line
    return columns, first


def read_header(path: Path) -> tuple[list[str], str, int]:
    """Names of the columns, the delimiter, and the number of the line after them.

    Raises
    ------
    UserError, UnicodeDecodeError, csv.Error : the file has no header.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        number = 1
        for line in file:
            if not line.startswith("#") or number > MAX_TOP:
                break
            number += 1
        else:
            line = ""
    if len(line) > csv.field_size_limit():
        raise UserError(f"{path.name}:{number}: a line of {len(line)} characters, expected a line of column names")
    delimiter = next((mark for mark in ",;\t" if mark in line), ",")
    header = [name.strip() for name in next(csv.reader([line], delimiter=delimiter), [])]
    if not any(header):
        raise UserError(f"{path.name}:{number}: found nothing, expected a line of column names")
    if any("\0" in name for name in header):
        raise UserError(f"{path.name}:{number}: found a byte 0, expected text")
    if all(_NUMBER.fullmatch(name) for name in header if name):
        raise UserError(f"{path.name}:{number}: found numbers only, expected a line of column names")
    twice = {name for name in header if name and header.count(name) > 1}
    if twice:
        raise UserError(f"{path.name}:{number}: column {shorten(sorted(twice)[0])} stands twice, expected once")
    return header, delimiter, number + 1


def _read_any(path: Path, header: list[str], delimiter: str, first: int) -> Columns:
    rows = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        for _ in range(first - 1):
            file.readline()
        reader = csv.reader(file, delimiter=delimiter)
        for row in reader:
            if not row:
                continue
            line = reader.line_num + first - 1
            if len(row) != len(header):
                hint = " (a decimal comma?)" if delimiter == "," and len(row) > len(header) else ""
                raise UserError(f"{path.name}:{line}: found {len(row)} fields, expected {len(header)}{hint}")
            if any("\0" in cell for cell in row):
                raise UserError(f"{path.name}:{line}: found a byte 0, expected text")
            rows.append(row)
            if len(rows) != reader.line_num:
                raise UserError(f"{path.name}:{line}: found an empty or broken line before this one")
    columns: Columns = {}
    for i, name in enumerate(header):
        cells = [row[i] for row in rows]
        columns[name] = np.array(_with_points(cells) if delimiter != "," else cells, dtype=str)
    return columns


def _with_points(cells: list[str]) -> list[str]:
    """A column whose numbers all have decimal commas (or none), with points."""
    if not any("," in cell for cell in cells) or not all(not cell.strip() or _COMMA.fullmatch(cell) for cell in cells):
        return cells
    return [cell.replace(",", ".") for cell in cells]


def _read_large(path: Path, header: list[str], delimiter: str, first: int, texts: Collection[str]) -> Columns | None:
    """The same, fifty times as fast; None for whatever needs a second look."""
    import pyarrow.compute
    import pyarrow.csv

    content = path.read_bytes()
    if b"\0" in content or b'"' in content or content.count(b"\r") != content.count(b"\r\n"):
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
                columns[name] = pyarrow.compute.cast(column, pyarrow.float64()).to_numpy()
                continue
            except pyarrow.ArrowException:  # text, or numbers in another spelling
                if delimiter != ",":
                    return None
        columns[name] = column.to_numpy(zero_copy_only=False).astype(str)
    return columns
