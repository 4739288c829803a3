"""The table of a batch: one row a run, in the order of the design, the same bytes whoever worked on it."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.messages import interface
from terrapin_hil.robot.truth import UNITS
from terrapin_hil.telemetry import si_factor
from terrapin_tools.batch.design import Row, Varied
from terrapin_tools.batch.one_run import CONTACT_ERROR, Answer

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CHECK", "Table", "table_of", "to_parquet", "unit_of"]

_OF_ONE = re.compile(r"(?:(?:max|min|mean|rms|std|first|last|abs)\()+([A-Za-z_.]+)(?:\[[^\]]*\])?\)+")
CHECK = "check "  # before the text of a check, in the name of its column


@dataclass(frozen=True)
class Table:
    """Runs as columns, each (runs,)."""

    number: np.ndarray[Any, np.dtype[np.int64]]
    seed: np.ndarray[Any, np.dtype[np.int64]]
    passed: Mask
    error: list[str]
    output: list[str]
    inputs: Mapping[str, Array | list[str]]  # numbers in `units`, or words
    units: Mapping[str, str]
    checks: Mapping[str, list[bool | None]]  # None: not held, as the run ended before
    numbers: Mapping[str, Array]  # NaN: no value

    def __len__(self) -> int:
        return len(self.number)


def table_of(rows: Iterable[Row], answers: Sequence[Answer], varied: Sequence[Varied]) -> Table:
    """The table of the answers, in order; `rows` has theirs."""
    mine = list(_of(rows, {answer.number for answer in answers}))
    values = [dict(row.values) for row in mine]
    inputs: dict[str, Array | list[str]] = {}
    for one in varied:
        column = [row[one.name] for row in values]
        unit = one.unit or _common_unit(one)
        numbers = [_number(value, unit) for value in column]
        inputs[one.name] = [_word(v) for v in column] if None in numbers else np.array(numbers, dtype=np.float64)
    checks = dict.fromkeys(text for answer in answers for text in answer.checks)
    numbers_of = dict.fromkeys(text for answer in answers for text in answer.numbers)
    return Table(
        np.array([row.number for row in mine], dtype=np.int64),
        np.array([row.seed for row in mine], dtype=np.int64),
        np.array([answer.passed for answer in answers], dtype=bool),
        [answer.error for answer in answers],
        [answer.output for answer in answers],
        inputs,
        {one.name: one.unit or _common_unit(one) for one in varied} | {text: unit_of(text) for text in numbers_of},
        {text: [answer.checks.get(text) for answer in answers] for text in checks},
        {text: np.array([answer.numbers.get(text, np.nan) for answer in answers]) for text in numbers_of},
    )


def _of(rows: Iterable[Row], numbers: set[int]) -> Iterable[Row]:
    for row in rows:
        if not numbers:
            return
        if row.number in numbers:
            numbers.discard(row.number)
            yield row


def unit_of(text: str) -> str:
    """Unit of a number of a run (SI, degC); empty where it has none, or where more than one signal makes it.

    >>> unit_of("max(abs(current[2:]))"), unit_of("max(slip)"), unit_of("max(speed) - min(speed)")
    ('A', '', '')
    """
    if text == CONTACT_ERROR:
        return "N m"
    match = _OF_ONE.fullmatch(text)
    message, _, signal = match[1].rpartition(".") if match else ("", "", "")
    units = UNITS
    if message in interface().messages:
        units = {one.name: one.unit for one in interface().messages[message].signals}
    unit = units.get(signal, "")
    return "" if unit in ("", "1") or si_factor(unit) != 1.0 else unit


def _common_unit(one: Varied) -> str:
    """The unit of levels that all have the same."""
    units = {level.partition(" ")[2] if isinstance(level, str) else "" for level in one.levels}
    return units.pop() if len(units) == 1 else ""


def _number(value: Any, unit: str) -> float | None:
    if isinstance(value, bool):
        return None
    if isinstance(value, str):
        value = value.removesuffix(f" {unit}") if unit else value
        try:
            return float(value)
        except ValueError:
            return None
    return float(value)


def _word(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def to_parquet(table: Table) -> bytes:
    """As a Parquet file. A field's metadata names its unit."""
    import pyarrow as pa
    import pyarrow.parquet

    columns: list[tuple[str, pa.Array]] = [
        ("run", pa.array(table.number)),
        ("seed", pa.array(table.seed)),
        *((name, pa.array(values)) for name, values in table.inputs.items()),
        ("passed", pa.array(table.passed)),
        ("error", pa.array(table.error, pa.string())),
        *((CHECK + text, pa.array(held, pa.bool_())) for text, held in table.checks.items()),
        *((text, pa.array(values)) for text, values in table.numbers.items()),
        ("output_sha256", pa.array(table.output, pa.string())),
    ]
    fields = [
        pa.field(name, values.type, metadata={"unit": unit} if (unit := table.units.get(name)) else None)
        for name, values in columns
    ]
    buffer = io.BytesIO()
    whole = pa.table([values for _, values in columns], schema=pa.schema(fields))
    pyarrow.parquet.write_table(whole, buffer, compression="zstd")
    return buffer.getvalue()
