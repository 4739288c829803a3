"""Tables of any size: CSV and Parquet files a piece at a time, with progress on standard error; others as a whole."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_tools.errors import UserError
from terrapin_tools.parquet_files import batches, opened
from terrapin_tools.progress import bar
from terrapin_tools.workbench.files.csv_files import LARGE, layout_of
from terrapin_tools.workbench.files.csv_layout import Layout
from terrapin_tools.workbench.files.format import Asked, arrow_texts, text_cells
from terrapin_tools.workbench.files.formats.csv_text import FORMAT as CSV
from terrapin_tools.workbench.files.tables import Table, read
from terrapin_tools.workbench.files.times import has_times

__all__ = ["stream"]

PLAIN = Asked()
TEXT = CSV.suffixes
BLOCK = 8 << 20  # bytes of CSV at once


def stream(path: Path, texts: Collection[str] = (), asked: Asked = PLAIN) -> Iterator[Table]:
    """A file as tables, some megabytes of it at a time where it is plain; columns in `texts` stay text.

    UserError where the file is broken.
    """
    pieces: Iterator[Table] | None = None
    suffix = path.suffix.lower()
    if not path.is_dir() and not asked.said():
        if suffix == ".parquet":
            pieces = _stream_parquet(path)
        elif suffix in TEXT and path.stat().st_size >= LARGE:
            layout = layout_of(path)
            if not layout.notes and layout.delimiter == ",":  # else the decimal mark is found over the whole file
                pieces = _stream_csv(path, layout, texts)
    first = next(pieces, None) if pieces is not None else None
    if pieces is None or first is None or has_times(first.columns):
        yield read(path, texts=texts, asked=asked)  # what is not plain is looked at as a whole
        return
    yield first
    yield from pieces


def _stream_csv(path: Path, layout: Layout, texts: Collection[str]) -> Iterator[Table]:
    import pyarrow.csv

    header, delimiter, line = list(layout.names), layout.delimiter, layout.first
    names = [str(i) for i in range(len(header))]
    size, done = path.stat().st_size, 0
    read_options = pyarrow.csv.ReadOptions(column_names=names, skip_rows=line - 1, use_threads=False, block_size=BLOCK)
    parse_options = pyarrow.csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=False)
    convert_options = pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(names, pyarrow.string()))
    try:
        with (
            bar(path.name, size) as shown,
            pyarrow.csv.open_csv(path, read_options, parse_options, convert_options) as reader,
        ):
            for batch in reader:
                columns: dict[str, npt.NDArray[Any]] = {}
                for name, number in zip(header, names, strict=True):
                    cells = batch.column(int(number))
                    columns[name] = arrow_texts(cells) if name in texts else _cells(cells)
                columns.pop("", None)
                yield Table(path, columns, line)
                line += batch.num_rows
                done += batch.nbytes
                shown(completed=min(done, size))  # in memory it may be more
    except pyarrow.ArrowException as error:
        reason = str(error).splitlines()[0][:200]
        hint = " (a decimal comma?)" if delimiter == "," and "columns" in reason else ""
        raise UserError(f"{path.name}: from line {line} on: {reason}{hint}, expected a CSV file") from None


def _cells(column: Any) -> npt.NDArray[Any]:
    """Numbers if all cells are, else text."""
    import pyarrow.compute

    try:
        return np.asarray(pyarrow.compute.cast(column, pyarrow.float64()).to_numpy(zero_copy_only=False))
    except pyarrow.ArrowException:
        return arrow_texts(column)


def _stream_parquet(path: Path) -> Iterator[Table]:
    with opened(path) as file:
        if any((field.metadata or {}).keys() & {b"unit", b"units"} for field in file.schema_arrow):
            return  # names with units: read() makes them
        for batch in batches(path, file):
            columns = {}
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                values = column.to_numpy(zero_copy_only=False)
                numeric = values.dtype.kind in "fiub"
                texts = ["" if cell is None else str(cell) for cell in values] if not numeric else []
                columns[name] = values.astype(np.float64) if numeric else text_cells(texts)
            yield Table(path, columns, 0)
