"""CSV files as columns. csv_layout.py finds how they are laid out; a large one without quotes goes through Arrow."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.csv_layout import Layout, called, find_layout
from terrapin_tools.workbench.files.format import Asked, arrow_texts, text_cells
from terrapin_tools.workbench.files.number_marks import GAPS, plain_numbers

__all__ = ["layout_of", "read_csv"]

Columns = dict[str, npt.NDArray[Any]]
Found = tuple[Columns, list[str]]
PLAIN = Asked()
LARGE = 1_000_000  # bytes from which Arrow reads the file, if it can
TRIAL = 1000  # rows by which text is told
# Cells that only a decimal mark explains: not three digits behind one to three, of which the first is no 0.
DECIMAL = r"^\s*[-+]?(0|\d{{4,}})?{0}\d*\s*$|{0}\d{{0,2}}\s*$|{0}\d{{4,}}\s*$|{0}\d*[eE]"


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
        large = _read_large(path, layout, asked, texts) if path.stat().st_size >= LARGE else None
        if large is not None:
            columns, notes = large
            columns.pop("", None)
            return columns, layout.first, (*layout.notes, *notes)
        cells = _read_any(path, layout)
    except csv.Error as error:
        raise UserError(f"{path.name}: {error}, expected a CSV file") from None
    cells.pop("", None)  # a comma at the end of every line
    told, notes = plain_numbers(cells, layout.delimiter, path.name, layout.first, asked.decimal)
    found = {name: text_cells(column) for name, column in told.items()}
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
        for row in _whole(reader, path, first):
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
                raise UserError(
                    f"{path.name}:{line}: found an empty or broken line before this one, expected a row on each line"
                )
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _whole(reader: Any, path: Path, first: int) -> Iterator[list[str]]:
    """The rows of a csv.reader. UserError with the line on which one begins that it cannot take."""
    begun = first
    try:
        for row in reader:
            yield row
            begun = first + reader.line_num
    except csv.Error as error:
        raise UserError(f"{path.name}:{begun}: {error}, expected a CSV file (a quote that does not end?)") from None


def _read_large(path: Path, layout: Layout, asked: Asked, texts: Collection[str]) -> Found | None:
    """The columns and what was assumed of their marks, fifty times as fast; None for whatever needs a second look."""
    content = path.read_bytes()
    if layout.encoding != "utf-8-sig":
        try:
            content = content.decode(layout.encoding).encode()
        except UnicodeDecodeError:
            return None
    begin = 0
    for _ in range(layout.first - 1):
        begin = content.find(b"\n", begin) + 1
    quotes = content.find(b'"', begin) >= 0
    if b"\0" in content or content.count(b"\r") != content.count(b"\r\n"):
        return None
    if quotes and not _plain_quotes(content[begin:], layout.delimiter.encode()):
        return None
    cells = _cells(content, layout)
    del content
    if cells is None:
        return None
    columns: Columns = {}
    odd: dict[str, Any] = {}
    marks: dict[str, str] = {}
    for name, column in cells.items():
        found = _numbers(column) if name not in texts else None
        if found is None:
            odd[name] = column
        else:
            columns[name], marks[name] = found
    marked = {name for name, column in odd.items() if name not in texts and _mostly_marked(column)}
    if marked and (quotes or layout.delimiter != ","):
        return None
    mark = _one_mark({name: cells[name] for name in marks}, marks, layout, asked)
    if mark is None:
        some = {name: column.slice(0, TRIAL).to_pylist() for name, column in cells.items() if name in marks}
        plain_numbers(some, layout.delimiter, path.name, layout.first, asked.decimal)  # says what is in doubt
        return None
    notes = []
    if mark.startswith(","):
        notes.append(f"decimal comma ({shorten(mark.partition(' ')[2])})")
        if not layout.notes and layout.delimiter != ",":
            notes.insert(0, f"separator {called(layout.delimiter)}")
    for name, column in odd.items():
        if name in marked:
            plain, more = plain_numbers({name: column.to_pylist()}, ",", path.name, layout.first, asked.decimal)
            columns[name] = text_cells(plain[name])
            notes += more
        else:
            columns[name] = arrow_texts(column)
    return {name: columns[name] for name in cells}, notes


def _plain_quotes(body: bytes, delimiter: bytes) -> bool:
    """Whether each quote begins or ends a field, so that every reader takes them alike."""
    quote = b'"'
    edges = (delimiter + quote, b"\n" + quote, quote + delimiter, quote + b"\n", quote + b"\r\n")
    return sum(map(body.count, edges)) + body.startswith(quote) + body.endswith(quote) == body.count(quote)


def _cells(content: bytes, layout: Layout) -> dict[str, Any] | None:
    """The cells as Arrow's columns of text; rows may end with a delimiter more. None if a row has another length."""
    import pyarrow
    import pyarrow.compute
    import pyarrow.csv

    for more in (0, 1):
        names = [str(i) for i in range(len(layout.names) + more)]
        try:
            table = pyarrow.csv.read_csv(
                pyarrow.BufferReader(content),
                read_options=pyarrow.csv.ReadOptions(column_names=names, skip_rows=layout.first - 1, use_threads=False),
                parse_options=pyarrow.csv.ParseOptions(delimiter=layout.delimiter, ignore_empty_lines=False),
                convert_options=pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(names, pyarrow.string())),
            )
        except pyarrow.ArrowException:
            continue
        if more and pyarrow.compute.any(pyarrow.compute.not_equal(_trimmed(table.column(names[-1])), "")).as_py():
            return None
        return {name: table.column(number) for name, number in zip(layout.names, names, strict=False)}
    return None


def _trimmed(column: Any) -> Any:
    import pyarrow.compute

    return pyarrow.compute.utf8_trim_whitespace(column)


def _numbers(column: Any) -> tuple[npt.NDArray[np.float64], str] | None:
    """A column as numbers, gaps as NaN, and its decimal mark ("" for none); None for text, or marks of both kinds."""
    import pyarrow
    import pyarrow.compute as compute

    trial = column.slice(0, TRIAL)
    mark = ""
    try:
        commas = compute.any(compute.match_substring(column, ",")).as_py()
        points = compute.any(compute.match_substring(column, ".")).as_py()
        if commas and points:
            return None
        mark = "," if commas else "." if points else ""
        for cells in (trial, column):  # text is told by its first rows
            try:
                values = compute.cast(_dotted(cells, mark), pyarrow.float64())
            except pyarrow.ArrowInvalid:
                plain = _trimmed(cells)
                gaps = compute.is_in(compute.utf8_lower(plain), pyarrow.array(GAPS))
                plain = compute.if_else(gaps, pyarrow.scalar(None, pyarrow.string()), plain)
                values = compute.cast(_dotted(plain, mark), pyarrow.float64())
    except pyarrow.ArrowException:  # text, or numbers in another spelling
        return None
    found = np.asarray(compute.fill_null(values, np.nan).to_numpy())
    return None if np.isinf(found).any() else (found, mark)  # 1e400 is no gap


def _dotted(cells: Any, mark: str) -> Any:
    import pyarrow.compute

    return pyarrow.compute.replace_substring(cells, ",", ".") if mark == "," else cells


def _one_mark(cells: dict[str, Any], marks: dict[str, str], layout: Layout, asked: Asked) -> str | None:
    """The decimal mark of the file (a comma: and the first cell that proves it); None where it is in doubt."""
    import pyarrow.compute as compute

    there = sorted({*marks.values()} - {""})
    if len(there) > 1:
        return None
    if not there:
        return ""
    mark = there[0]
    if asked.decimal and asked.decimal != {",": "comma", ".": "point"}[mark]:
        return None
    if mark == "." and layout.delimiter != ";":
        return mark
    proof = DECIMAL.format(re.escape(mark))
    rows = max(map(len, cells.values()))
    for size in (TRIAL, rows) if rows > TRIAL else (rows,):
        for name, column in cells.items():
            if marks[name] == mark:
                some = column.slice(0, size)
                if asked.decimal:
                    hits = compute.match_substring(some, mark)
                else:
                    hits = compute.match_substring_regex(some, proof)
                at = compute.index(hits, True).as_py()
                if at >= 0:
                    return f"{mark} {some[at].as_py()}"
    return None


def _mostly_marked(column: Any) -> bool:
    """Whether most cells are numbers in some spelling, so that their marks count: text has them by chance."""
    import pyarrow.compute as compute

    hits = compute.match_substring_regex(column, r"^\s*[-+]?(\d[\d.,' ]*|[.,]\d+)([eEdD][-+]?\d+)?\s*$")
    return bool(2 * int(compute.sum(hits).as_py() or 0) > len(column))
