"""Two tables or logs of one test as one table, on the grid and the clock of the slower one.

What the slower one has stays as it was measured. Numbers of the faster one become means over the slower one's period
around each of its times; states (few different numbers), and what is asked to be held, take the last value instead.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.intake import MARK
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.format import meant
from terrapin_tools.workbench.intake.clock_offset import Offset, averaged, clock_offset
from terrapin_tools.workbench.intake.look import table_of
from terrapin_tools.workbench.intake.look_columns import noise_of
from terrapin_tools.workbench.new_case.from_tables import guess_columns, split_unit

__all__ = ["Merged", "merge", "write"]

STATES = 8  # different numbers up to which a column is a state, and is held


@dataclass(frozen=True)
class _Recording:
    path: Path
    times: Array  # s
    clock: str  # column
    match: str  # column
    numbers: dict[str, Array]
    text: dict[str, Any]


@dataclass(frozen=True)
class Merged:
    """`columns` by name, on the slower recording's grid; `told` and `answer` say how."""

    columns: dict[str, Any]
    offset: Offset
    told: str
    answer: dict[str, Any]
    overlay: tuple[Array, Array, Array]  # times [s], the two matched columns on the grid


def _recording(path: Path, dbc: Path | None, clock: str, match: str) -> _Recording:
    table, _ = table_of(path, dbc)
    if table is None:
        raise UserError(f"{path.name}: found no signal, expected a description of its bus (--dbc)")
    numbers, text = {}, {}
    for name in table.columns:
        try:
            numbers[name] = table.numbers(name, gaps=True)
        except UserError:
            text[name] = table.columns[name]
    clock = clock or next((guess.column for guess in guess_columns(list(numbers), text) if guess.name == "time"), "")
    clock, match = (_meant(path, what, name, numbers) for what, name in (("--time", clock), ("--match", match)))
    try:
        times = units.convert(numbers[clock], split_unit(clock)[1] or "s", "s")
    except ValueError as error:
        raise UserError(f"{path.name}: column {clock}: {error}") from None
    wrong = np.flatnonzero(~(np.diff(times) > 0))
    if len(times) < 2 or wrong.size:
        place = table.place(int(wrong[0]) + 1) if wrong.size else path.name
        raise UserError(f"{place}: column {clock}: expected times that rise: a file of one run")
    return _Recording(path, times, clock, match, numbers, text)


def _meant(path: Path, option: str, said: str, numbers: Mapping[str, Array]) -> str:
    found = meant(said, numbers)
    if found is None:
        raise UserError(f"{path.name}: {option}: found {said!r}, expected one of {', '.join(numbers)}")
    return found


def merge(
    paths: tuple[Path, Path],
    match: tuple[str, str],
    clocks: tuple[str, str] = ("", ""),
    within: float = 10.0,
    hold: Collection[str] = (),
    dbc: Path | None = None,
) -> Merged:
    """Merge; `match`: the column of each that measures one quantity.

    UserError when it cannot be told how far the clocks are apart, or a file cannot be read."""
    one, two = (_recording(p, dbc, c, m) for p, c, m in zip(paths, clocks, match, strict=True))
    steps = [float(np.median(np.diff(r.times))) for r in (one, two)]
    swapped = steps[1] > steps[0]
    slow, fast = (two, one) if swapped else (one, two)
    match = one.match, two.match
    of_slow, of_fast = slow.match, fast.match
    period, fine = max(steps), min(steps)
    # each clock from its own first row on: one may count from 1970
    begins = float(slow.times[0]), float(fast.times[0])

    def ahead(offset: float) -> float:
        return (offset + begins[1] - begins[0]) * (-1 if swapped else 1)

    found = clock_offset(
        slow.times - begins[0], slow.numbers[of_slow], fast.times - begins[1], fast.numbers[of_fast], within, ahead
    )
    if found.refused:
        columns_of = f"{one.match} and {two.match}: {found.refused}"
        raise UserError(
            f"{one.path.name}, {two.path.name}: the offset of their clocks cannot be told from {columns_of}; "
            "expected columns that measure one quantity that changes"
        )
    at = found.to_fast(slow.times - begins[0]) + begins[1]
    rows = np.flatnonzero((at >= fast.times[0]) & (at <= fast.times[-1]))
    for name in hold:
        if meant(name, fast.numbers) is None and (own := meant(name, slow.numbers)):
            kept = f"{own} of {slow.path.name}, the slower one, whose numbers stay as they are"
            raise UserError(f"{fast.path.name}: --hold: found {kept}; expected one of {', '.join(fast.numbers)}")
    hold = [_meant(fast.path, "--hold", name, fast.numbers) for name in hold]
    held = [n for n, v in fast.numbers.items() if n in hold or len(np.unique(v[np.isfinite(v)])) <= STATES]
    whole: dict[str, Any] = {**slow.numbers, **slow.text}
    columns: dict[str, Any] = {name: whole[name][rows] for name in _names(slow)}
    noise = {name: noise_of(v[rows]) for name, v in slow.numbers.items() if name != slow.clock}
    means: dict[str, Array] = {}
    for name, values in fast.numbers.items():
        if name == fast.clock:
            continue
        free = name if name not in columns else f"{name} ({fast.path.stem})"
        columns[free] = (
            _held(fast.times, values, at[rows]) if name in held else averaged(fast.times, values, at[rows], period)[0]
        )
        if name not in held:
            means[free] = values
            slope = np.diff(columns[free]) / period
            shake = float(np.sqrt(np.nanmean(slope**2))) * found.offset_sd if np.isfinite(slope).any() else 0.0
            noise[free] = float(np.hypot(noise_of(values) / np.sqrt(max(1.0, period / fine)), shake))
    names = {"slow": slow.path.name, "fast": fast.path.name}
    offset = ahead(found.offset)
    drift = found.drift * (-1 if swapped else 1)
    told = (
        f"the clock of {two.path.name} is {offset:.6g} s (sd {found.offset_sd:.2g} s) ahead of that of {one.path.name}"
    )
    told += f" and drifts by {drift * 1e6:.4g} us a second (sd {found.drift_sd * 1e6:.2g})" if drift else ""
    told += f", by correlation of {match[0]} and {match[1]} ({found.correlation:.3f} once trends are out)"
    told += f"; the grid is that of {names['slow']}" + (
        f", means over {period:.4g} s of {names['fast']}" if means else ""
    )
    told += f"; held: {', '.join(held)}" if held else ""
    told += f"; left out, for text: {', '.join(fast.text)}" if fast.text else ""
    answer = {
        "first": str(one.path), "second": str(two.path), "match": list(match),
        "offset": offset, "offset_sd": found.offset_sd, "drift": drift,
        "drift_sd": found.drift_sd if drift else None, "correlation": found.correlation,
        "grid": names["slow"], "period": period, "filter": f"mean over {period:.6g} s" if means else None,
        "held": held, "rows": int(rows.size), "rows_outside": int(len(slow.times) - rows.size),
        "columns": {n: {"noise_sd": noise.get(n), "unit": split_unit(n)[1]} for n in columns},
    }  # fmt: skip
    matched, _ = averaged(fast.times, fast.numbers[of_fast], at[rows], period)
    overlay = slow.times[rows] - begins[0], slow.numbers[of_slow][rows], matched
    return Merged(columns, found, told, answer, overlay)


def _names(recording: _Recording) -> list[str]:
    return [recording.clock, *(n for n in (*recording.numbers, *recording.text) if n != recording.clock)]


def _held(times: Array, values: Array, at: Array) -> Array:
    """The last value at each time."""
    index: Index = np.searchsorted(times, at, "right") - 1
    return np.where(index >= 0, values[np.maximum(index, 0)], np.nan)


def write(merged: Merged, to: Path) -> None:
    """A CSV with a line above the names that says what was assumed. UserError (status 1) when it cannot be written."""
    from terrapin_tools.workbench.files.writing import write_whole

    def cell(value: Any) -> str:
        if isinstance(value, float | np.floating):
            return repr(float(value)) if np.isfinite(value) else ""
        text = str(value)
        return '"{}"'.format(text.replace('"', '""')) if set(text) & set(',"\n') else text

    lines = [MARK + " ".join(merged.told.split()), ",".join(cell(name) for name in merged.columns)]
    rows = zip(*(np.asarray(column).tolist() for column in merged.columns.values()), strict=True)
    write_whole(to, "\n".join([*lines, *(",".join(map(cell, row)) for row in rows)]) + "\n")
