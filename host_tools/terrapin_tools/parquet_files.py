"""Parquet files, a piece at a time, within stated limits: some kB of run lengths can stand for gigabytes of rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import bounded, each, refuse_beyond
from terrapin_tools.errors import UserError

__all__ = ["batches", "opened", "rows"]

PIECE = 32 << 20  # bytes of numbers that a piece has at most
NESTED = 16  # times its bytes, a list takes in Python,
LETTER = 4  # and a letter of a column of text
MOST_ROWS = 100_000  # of a piece


@contextmanager
def opened(path: Path, expected: str = "a Parquet file") -> Iterator[Any]:
    """A pyarrow.parquet.ParquetFile whose texts come as dictionaries: one that stands in every row is held once.

    UserError, in one line, when it is none, holds more than it may, or is damaged: what pyarrow raises inside the
    block, too.
    """
    import pyarrow.parquet

    try:
        with bounded(path):
            file = pyarrow.parquet.ParquetFile(path)
        with file:
            schema = file.schema
            columns = [schema.column(i) for i in range(len(schema))]
            texts = [c.path for c in columns if c.physical_type == "BYTE_ARRAY" and "." not in c.path]
            _check(path, file.metadata, [c.length if c.physical_type == "FIXED_LEN_BYTE_ARRAY" else 8 for c in columns])
        with bounded(path):
            file = pyarrow.parquet.ParquetFile(path, read_dictionary=texts)
        with file:
            names = file.schema_arrow.names
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise UserError(f"{path}: column {shorten(twice)} stands twice, expected once")
            yield file
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        known = isinstance(error, pyarrow.ArrowNotImplementedError) or getattr(error, "errno", None)
        reason = next(iter(str(error).splitlines()), "")[:200] if known else "is damaged, or none"
        raise UserError(f"{path}: {reason}, expected {expected}") from None


def rows(path: Path) -> int:
    """The number of rows that a file states. UserError as `opened`."""
    with opened(path) as file:
        return int(file.metadata.num_rows)


def batches(path: Path, file: Any, most: int = MOST_ROWS, columns: Sequence[str] | None = None) -> Iterator[Any]:
    """The pyarrow.RecordBatches of an `opened` file, `most` rows each at most, texts as texts. UserError as above."""
    count = max(1, len(columns) if columns is not None else file.metadata.num_columns)
    size = max(1, min(most, PIECE // (8 * count)))
    total = 0
    for batch in each(path, file.iter_batches(size, columns=columns)):
        with bounded(path):
            total += sum(_bytes(column) for column in batch.columns)
            refuse_beyond(path, total)
            plain = _plain(batch)
        yield plain


def _check(path: Path, metadata: Any, widths: Sequence[int]) -> None:
    """By what the file states of itself, before anything is unpacked."""
    values = packed = 0
    for group in range(metadata.num_row_groups):
        stated = metadata.row_group(group)
        for i, width in enumerate(widths):
            column = stated.column(i)
            values += max(0, column.num_values, stated.num_rows) * width
            packed += max(0, column.total_uncompressed_size)
    refuse_beyond(path, max(values, packed, metadata.num_rows * sum(widths)))


def _bytes(column: Any) -> int:
    """What a column takes once each row has its own text."""
    import pyarrow
    import pyarrow.compute

    if not pyarrow.types.is_dictionary(column.type):
        return int(column.nbytes) * (NESTED if pyarrow.types.is_nested(column.type) else 1)
    if not len(column.dictionary):
        return 0
    lengths = pyarrow.compute.binary_length(column.dictionary)
    return LETTER * int(pyarrow.compute.sum(pyarrow.compute.take(lengths, column.indices)).as_py() or 0)


def _plain(batch: Any) -> Any:
    import pyarrow

    columns = [
        column.cast(column.type.value_type) if pyarrow.types.is_dictionary(column.type) else column
        for column in batch.columns
    ]
    fields = [  # units stand in their metadata
        pyarrow.field(field.name, column.type, metadata=field.metadata)
        for field, column in zip(batch.schema, columns, strict=True)
    ]
    return pyarrow.RecordBatch.from_arrays(columns, schema=pyarrow.schema(fields))
