"""Signals of a log on a grid of time, the last value held."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.reading import LogReader

__all__ = ["as_arrow", "signals_on_grid"]


DISORDER = 1.0  # s by which frames of several channels may be out of order
MOST_ROWS = 1e7  # that a log may give


def signals_on_grid(
    path: Path, decoder: Decoder, period: float, needed: Collection[str] = (), notes: list[str] | None = None
) -> dict[str, Array]:
    """`time` and every MESSAGE.SIGNAL of the log at 0, period, 2 period ... [s] from the first known frame on.

    A message that came on several buses gives BUS:MESSAGE.SIGNAL for each. Rows before the first in which all `needed`
    signals have come are dropped; other signals are NaN until they come. `notes` gets what the reader tells.

    UserError when times run backwards or there are none, when the DBC knows no frame, when it is open which bus is
    needed, or when the grid had too many rows.
    """
    times: dict[tuple[int, str], list[Array]] = {}
    values: dict[tuple[int, str], list[Array]] = {}
    latest, row = -np.inf, 0
    log = LogReader(path)
    for block in log.blocks():
        running = np.maximum.accumulate(np.concatenate([[latest], block.times]))
        behind = np.flatnonzero(block.times < running[:-1] - DISORDER)
        if behind.size:
            number = row + int(behind[0]) + 1
            place = f"{path.name}:{number}" if log.kind == ".log" else f"{path.name}: frame {number}"
            found = f"found time {block.times[behind[0]]:.6f} s after {running[behind[0]]:.6f} s"
            raise UserError(f"{place}: {found}, expected times that rise")
        latest, row = float(running[-1]), row + len(block)
        for message, table in decoder.decode(block).items():
            buses = block.bus[table.rows]
            for number in np.unique(buses).tolist():
                for name, column in table.signals.items():
                    there = (buses == number) & ~np.isnan(column)
                    times.setdefault((number, f"{message}.{name}"), []).append(table.times[there])
                    values.setdefault((number, f"{message}.{name}"), []).append(column[there])
    if notes is not None:
        notes += [text for text in (log.lost, log.cut and f"read up to where it was cut off: {log.cut}") if text]
        notes += log.assumed
    if not log.timed and len(times):
        raise UserError(f"{path.name}: found no time stamps, expected a log with them (candump -ta, or -l)")
    whole = {key: np.concatenate(parts) for key, parts in times.items()}
    names = _names([key for key, stamp in whole.items() if stamp.size], log.buses, needed, path)
    stamps = {name: whole[key] for name, key in names.items()}
    if not stamps:
        raise UserError(f"{path.name}: found no frame that the DBC knows")
    first = min(float(stamp.min()) for stamp in stamps.values())
    last = max(float(stamp.max()) for stamp in stamps.values())
    steps = (last - first) / period
    if not steps < MOST_ROWS:
        raise UserError(
            f"{path.name}: found {last - first:g} s of log, {steps:.3g} rows with data.period {period:g} s, "
            f"expected at most {MOST_ROWS:g}"
        )
    grid: Array = np.arange(int(steps + 1e-9) + 1) * np.float64(period)
    columns: dict[str, Array] = {}
    start = 0.0
    for name, raw in stamps.items():
        order = np.argsort(raw, kind="stable")
        stamp, column = raw[order] - first, np.concatenate(values[names[name]])[order]
        index = np.searchsorted(stamp, grid + 1e-9 * period, side="right") - 1
        columns[name] = np.where(index >= 0, column[np.maximum(index, 0)], np.nan)
        if name in needed:
            start = max(start, float(stamp[0]))
    keep = grid + 1e-9 * period >= start
    return {"time": grid[keep], **{name: column[keep] for name, column in columns.items()}}


def _names(
    keys: Collection[tuple[int, str]], buses: Sequence[str], needed: Collection[str], path: Path
) -> dict[str, tuple[int, str]]:
    """Columns' names: the bus stands before what came on several."""
    on: dict[str, list[int]] = {}
    for number, name in keys:
        on.setdefault(name, []).append(number)
    for name, numbers in on.items():
        if len(numbers) > 1 and name in needed:
            raise UserError(
                f"{path.name}: column {name}: found it on the buses {' and '.join(buses[i] for i in sorted(numbers))}, "
                f"expected one of them: {buses[min(numbers)]}:{name}"
            )
    return {
        f"{buses[number]}:{name}" if len(numbers) > 1 else name: (number, name)
        for name, numbers in on.items()
        for number in numbers
    }


def as_arrow(columns: dict[str, Array], decoder: Decoder) -> Any:
    """The columns of `signals_on_grid` as a pyarrow.Table with the description in its metadata (`dbc`). Metadata of a
    column: `unit`, `description`. A signal with words for its values has a column NAME_word beside its numbers."""
    import pyarrow

    fields, arrays = [pyarrow.field("time", pyarrow.float64(), metadata={"unit": "s"})], [columns["time"]]
    known = {message: {one.name: one for one in decoder.described(message)} for message in _messages(columns)}
    for name, values in columns.items():
        message, _, signal = name.partition(".")
        if not signal:
            continue
        one = known[message.rpartition(":")[2]][signal]
        said = {"unit": one.unit, "description": one.comment}
        metadata = {key: text for key, text in said.items() if text}
        fields.append(pyarrow.field(name, pyarrow.float64(), metadata=metadata or None))
        arrays.append(values)
        if one.words:
            index = {value: place for place, value in enumerate(sorted(one.words))}
            places = [index.get(int(value)) if value == value else None for value in values.tolist()]
            texts = pyarrow.array([one.words[value] for value in sorted(one.words)])
            column = pyarrow.DictionaryArray.from_arrays(pyarrow.array(places, pyarrow.int32()), texts)
            fields.append(pyarrow.field(f"{name}_word", column.type, metadata=metadata or None))
            arrays.append(column)
    schema = pyarrow.schema(fields, {"dbc": decoder.path.read_bytes()})
    return pyarrow.Table.from_arrays(
        [pyarrow.array(a) if isinstance(a, np.ndarray) else a for a in arrays], schema=schema
    )


def _messages(columns: Collection[str]) -> set[str]:
    """Without the bus before them: `can1:GROUND.torque`."""
    return {name.partition(".")[0].rpartition(":")[2] for name in columns if "." in name}
