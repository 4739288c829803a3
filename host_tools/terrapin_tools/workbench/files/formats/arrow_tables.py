"""Parquet, Feather and Arrow files. A unit may stand in a field's metadata, as `unit` or `units`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import refuse_beyond, refuse_columns
from terrapin_tools.errors import UserError
from terrapin_tools.parquet_files import batches, opened
from terrapin_tools.workbench.files.format import Asked, Column, Format, Part, arrow_texts, cells


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """One table. UserError for a column that stands twice, and for more than it may stand for."""
    import pyarrow.ipc

    if path.suffix.lower() == ".parquet":
        with opened(path) as file:
            refuse_columns(path, len(file.schema_arrow))
            parts = list(batches(path, file))
            return [_part(path, pyarrow.Table.from_batches(parts) if parts else file.schema_arrow.empty_table())]
    with path.open("rb") as stream:
        stream.seek(0)
        old = stream.read(4) == b"FEA1"
        stream.seek(0)
        if old:
            raise UserError(f"{path.name}: is a Feather file of version 1, expected version 2")
        try:
            reader = pyarrow.ipc.open_file(stream)
            pieces = (reader.get_batch(i) for i in range(reader.num_record_batches))
        except pyarrow.ArrowInvalid:
            stream.seek(0)
            pieces = reader = pyarrow.ipc.open_stream(stream)
        refuse_columns(path, len(reader.schema))
        taken, size = [], 0
        for batch in pieces:
            taken.append(batch)
            size += batch.nbytes
            refuse_beyond(path, size)
            batch.validate(full=True)  # pyarrow follows damaged offsets out of its memory
        return [_part(path, pyarrow.Table.from_batches(taken, reader.schema))]


def _part(path: Path, table: Any) -> Part:
    names = table.column_names
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"{path.name}: column {shorten(twice)} stands twice, expected once")
    columns = {name: _column(table.column(name)) for name in names}
    units = {}
    for name in names:
        about = table.schema.field(name).metadata or {}
        unit = about.get(b"unit", about.get(b"units", b""))
        units[name] = unit.decode("utf-8", errors="replace")
    return Part("", columns, units)


def _column(column: Any) -> Column:
    import pyarrow.types

    if pyarrow.types.is_string(column.type) or pyarrow.types.is_large_string(column.type):
        return arrow_texts(column)
    values = column.to_numpy()
    if values.dtype.kind in "fiub":
        return np.asarray(values.astype(np.float64, copy=False))
    if values.dtype.kind == "M":
        return np.where(np.isnat(values), "", values.astype(str))
    return cells(values.tolist())


FORMAT = Format("an Arrow, Feather or Parquet file", (".parquet", ".feather", ".arrow", ".ipc"), read)
