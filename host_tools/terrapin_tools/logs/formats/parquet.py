"""Parquet with the columns time, id, data, flags (and bus) of frames."""

from __future__ import annotations

from collections.abc import Iterator

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.source import BLOCK, Source
from terrapin_tools.logs.frames import Frames, frames
from terrapin_tools.parquet_files import batches, opened

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".parquet",)
COLUMNS = ["time", "id", "data", "flags"]


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


def blocks(source: Source) -> Iterator[Frames]:
    """Frames."""
    try:
        with opened(source.path, "a Parquet file of frames") as file:
            names = file.schema_arrow.names
            missing = set(COLUMNS) - set(names)
            if missing:
                expected = "the columns time, id, data, flags of frames"
                raise UserError(f"{source.path}: found no column {sorted(missing)[0]!r}, expected {expected}")
            chosen, done = [*COLUMNS, *(["bus"] if "bus" in names else [])], 0
            for batch in batches(source.path, file, BLOCK, chosen):
                done += batch.num_rows
                times, identifiers, data, flags, *bus = (batch.column(name).to_pylist() for name in chosen)
                numbers = [source.bus(str(name)) for name in bus[0]] if bus else [source.bus("")] * len(times)
                yield frames(source.path, times, identifiers, data, flags, numbers)
                source.told(source.size * done // max(1, file.metadata.num_rows))
    except (TypeError, ValueError, OverflowError):
        raise UserError(f"{source.path}: holds values that are no frame's, expected a Parquet file of frames") from None
