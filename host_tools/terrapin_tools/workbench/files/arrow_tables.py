"""Tables that come from a program and go to one: whatever speaks Arrow, with units in the metadata of the columns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import text_cells
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.times import clock_name

__all__ = ["from_arrow", "labelled", "to_arrow"]

INDEX = re.compile(r"__index_level_\d+__")  # pandas' count of rows without a name
EXPECTED = "a DataFrame of pandas or polars, a pyarrow.Table, or a mapping of columns"


def from_arrow(source: object, name: str) -> tuple[Table, dict[str, str]]:
    """A table and the units that its columns' metadata tell (key `unit`).

    `source` has `__arrow_c_stream__` or `__dataframe__`, or maps names to arrays of one length; `name` is what messages
    call it. Numbers become float64, NaN where there is none, durations seconds, everything else text; instants have
    seconds beside them, as in a file. UserError for anything else, for no row, and for two columns of one name.
    """
    import pyarrow

    found = _arrow(source, name)
    found = found.select([i for i, one in enumerate(found.column_names) if not INDEX.fullmatch(one)])
    twice = next((one for one in found.column_names if found.column_names.count(one) > 1), None)
    if twice is not None:
        raise UserError(f"{name}: column {shorten(twice)} stands twice, expected once")
    if not found.num_rows or not found.num_columns:
        raise UserError(f"{name}: found {found.num_rows} rows of {found.num_columns} columns, expected at least one")
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in found.schema}
    columns: dict[str, npt.NDArray[Any]] = {}
    notes = []
    for one in found.column_names:
        columns[one] = _values(found.column(one))
        kind = found.schema.field(one).type
        if pyarrow.types.is_duration(kind):
            units[one] = "s"
        elif pyarrow.types.is_timestamp(kind) and (clock := clock_name(one)) not in found.column_names:
            columns[clock], first = _seconds(found.column(one).to_numpy())
            notes.append(f"{one} as time: [s] since {first}")
    return Table(Path(name), columns, 0, tuple(notes)), {one: unit for one, unit in units.items() if unit}


def _seconds(instants: npt.NDArray[np.datetime64]) -> tuple[npt.NDArray[np.float64], str]:
    """Since the first of them, which is given too; NaN where there is none."""
    first = next((one for one in instants if not np.isnat(one)), np.datetime64("NaT", "ns"))
    return (instants - first) / np.timedelta64(1, "s"), str(first)


def _arrow(source: object, name: str) -> Any:
    import pyarrow
    import pyarrow.interchange

    try:
        if isinstance(source, Mapping):
            for one, values in source.items():
                if isinstance(values, str) or not isinstance(values, Iterable):
                    raise UserError(f"{name}: column {one}: found {values!r}, expected an array: [{values!r}]")
        if hasattr(source, "__arrow_c_stream__") or isinstance(source, Mapping):
            return pyarrow.table(_with_text(source))
        if hasattr(source, "__dataframe__"):
            return pyarrow.interchange.from_dataframe(source)
    except (pyarrow.ArrowException, ValueError, TypeError, NotImplementedError) as error:
        why = next(iter(str(error).splitlines()), type(error).__name__)
        raise UserError(f"{name}: {why}, expected {EXPECTED}") from None
    raise UserError(f"{name}: found a {type(source).__name__}, expected {EXPECTED}")


def _with_text(source: Any) -> Any:
    """The same, with columns of Python's objects of several kinds (a word among numbers) as text: which row holds
    what is told where it is read as a number, and a column that nothing reads may hold what it likes."""
    names = [*source] if isinstance(source, Mapping) or hasattr(source, "assign") else []  # pandas' frames have it
    mixed = {name: cells for name in names if (cells := _mixed(source[name])) is not None}
    return {name: mixed.get(name, source[name]) for name in names} if mixed else source


def _mixed(values: Any) -> list[str] | None:
    if str(getattr(values, "dtype", "")) != "object":
        return None
    kinds = {type(one) for one in values if one is not None and one == one}
    return ["" if one is None or one != one else str(one) for one in values] if len(kinds) > 1 else None


def _values(column: Any) -> npt.NDArray[Any]:
    import pyarrow

    if pyarrow.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    values = column.to_numpy()
    if values.dtype.kind in "fiub":
        return np.asarray(values, dtype=np.float64)
    if values.dtype.kind == "m":
        return np.asarray(values / np.timedelta64(1, "s"), dtype=np.float64)
    return text_cells(["" if cell is None or cell != cell else str(cell) for cell in values])


def to_arrow(table: Table, units: Mapping[str, str] | None = None) -> Any:
    """The same as a pyarrow.Table."""
    return labelled(table.columns, units or {})


def labelled(columns: Mapping[str, Any], units: Mapping[str, str]) -> Any:
    """A pyarrow.Table whose columns name their units in their metadata."""
    import pyarrow

    arrays = {name: pyarrow.array(values) for name, values in columns.items()}
    fields = [
        pyarrow.field(name, array.type, metadata={"unit": units[name]} if units.get(name) else None)
        for name, array in arrays.items()
    ]
    return pyarrow.Table.from_arrays(list(arrays.values()), schema=pyarrow.schema(fields))
