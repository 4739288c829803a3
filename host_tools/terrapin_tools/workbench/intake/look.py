"""What a file holds, on one screen: columns, clock, what is odd in them, and where runs and steady states may be.

    look(Path("day_1.csv"))         the answer, as JSON has it
    describe(answer)                the same for people

The file is only read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_tools.errors import UserError
from terrapin_tools.logs.reading import LogReader, is_log
from terrapin_tools.workbench.files.format import Asked
from terrapin_tools.workbench.files.tables import PLAIN, Table, read
from terrapin_tools.workbench.intake.look_columns import clock, facts, steady
from terrapin_tools.workbench.new_case.from_tables import guess_columns, guess_run, split_unit

__all__ = ["describe", "look", "look_at", "table_of"]

MOST_SHOWN = 40  # columns on the screen
MOST_PAIRS = 500  # columns that are compared with each other
MOST_STEADY = 20  # stretches that are told
RESTART = 0.5  # share of the span so far by which a clock that steps back begins a new run
FINEST, SELDOM = 1e-4, 1e-2  # s of a log's grid: the least, and where each message came once


def look_at(file: str, dbc: str, said: dict[str, str] | None = None) -> dict[str, Any]:
    """`look`, with the words for people as `lines`; for the page. `said`: how a table is to be read."""
    answer = look(Path(file), Path(dbc) if dbc else None, Asked.of(said or {}, "read"))
    return {**answer, "lines": describe(answer).splitlines()}


def look(path: Path, dbc: Path | None = None, asked: Asked = PLAIN) -> dict[str, Any]:
    """The answer for one table or log. UserError for a file that cannot be read."""
    table, more = table_of(path, dbc, asked)
    return {"file": str(path), **more, **_of_table(table)} if table is not None else {"file": str(path), **more}


def table_of(path: Path, dbc: Path | None = None, asked: Asked = PLAIN) -> tuple[Table | None, dict[str, Any]]:
    """The file's table, of a log its signals on a grid of the fastest message's period; and what is said beside it.

    None in place of the table for a log of which the description knows no frame."""
    if not is_log(path):
        table = read(path, asked=asked)
        return table, {"kind": path.suffix[1:].lower(), "units": {}, "notes": list(table.notes)}
    from terrapin_tools.logs.decoding import Decoder, description_of, in_steps_of
    from terrapin_tools.logs.info import Summary

    found, own = (dbc, True) if dbc else description_of(path)
    decoder = Decoder(found)
    log, summary = LogReader(path), Summary(decoder)
    known = False
    for block in log.blocks():
        summary.take(block)
        known = known or bool(decoder.decode(block))
    told = summary.answer()
    periods = [m["period"] for m in told["messages"] if m["name"] and m["period"]]
    guessed = known and log.timed and not own
    whose = f"{in_steps_of()}: nothing says whose log it is, and no terrapin.dbc is beside it" if guessed else ""
    more = {
        "kind": "log",
        "frames": told,
        "buses": log.buses,
        "notes": [t for t in (log.lost, log.cut, whose) if t] + log.assumed,
    }
    units = {f"{m.name}.{s}": u for m in decoder.messages.values() for s, u in decoder.units(str(m.name))}
    if not known or not log.timed:
        return None, {**more, "units": {}, "columns": [], "rows": told["frames"]}
    return read(path, decoder.path, max(FINEST, min(periods, default=SELDOM))), {**more, "units": units}


def _of_table(table: Table) -> dict[str, Any]:
    numbers: dict[str, Array] = {}
    text: list[str] = []
    for name in table.columns:
        try:
            numbers[name] = table.numbers(name, gaps=True)
        except UserError:
            text.append(name)
    time = next((guess.column for guess in guess_columns(list(numbers), text) if guess.name == "time"), None)
    run, by = _runs(table, numbers.get(time) if time else None)
    columns = []
    for name in table.columns:
        entry = {"name": split_unit(name)[0], "column": name, "unit": split_unit(name)[1], "text": name in text}
        if name in text:
            entry["values"] = len(set(table.text(name)))
        columns.append(entry | (facts(numbers[name], run) if name in numbers else {}))
    stretches = steady([v for n, v in numbers.items() if n != time and n != by.get("column")], run)
    times = numbers.get(time) if time else None
    return {
        "rows": table.rows,
        "columns": columns,
        "time": _clock(time, times, run) if time is not None and times is not None and table.rows else None,
        "same": _same(numbers),
        "runs": by,
        "steady": [
            {
                "rows": [int(a), int(b)],
                "begin": float(times[a]) if times is not None else None,
                "end": float(times[b - 1]) if times is not None else None,
            }
            for a, b in stretches[:MOST_STEADY]
        ],
        "steady_count": len(stretches),
    }


def _clock(column: str, times: Array, run: Index) -> dict[str, Any]:
    return {"column": column, "unit": split_unit(column)[1] or "s", **clock(times, run)}


def _runs(table: Table, times: Array | None) -> tuple[Index, dict[str, Any]]:
    """The run of each row, and by what: a column of that name, or a clock that begins again."""
    column = guess_run(list(table.columns))
    if column is not None and table.rows:
        names, run = np.unique(table.text(column), return_inverse=True)
        if 1 < len(names) <= max(2, table.rows // 2):
            return run.astype(np.int64), {"by": "column", "column": column, "count": len(names)}
    if times is not None and len(times) > 1:
        back = np.flatnonzero(np.diff(times) < -RESTART * (np.maximum.accumulate(times)[:-1] - times[0]))
        back = back[np.diff(times)[back] < 0]
        run = np.zeros(len(times), np.int64)
        run[back + 1] = 1
        if back.size:
            return np.cumsum(run), {"by": "a clock that begins again", "count": int(back.size) + 1}
    return np.zeros(table.rows, np.int64), {"by": "", "count": 1}


def _same(numbers: dict[str, Array]) -> list[list[str]]:
    """Columns that hold the same numbers."""
    groups: dict[bytes, list[str]] = {}
    for name, values in list(numbers.items())[:MOST_PAIRS]:
        if values.size > 1 and np.nanmin(values, initial=np.inf) < np.nanmax(values, initial=-np.inf):
            groups.setdefault(values.tobytes(), []).append(name)
    return [names for names in groups.values() if len(names) > 1]


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _clock_words(answer: dict[str, Any]) -> list[str]:
    time = answer["time"]
    if not time:
        return ["no column of time was found"]
    unit, words = time["unit"], []
    line = f"{time['column']}: {time['begin']:.6g} to {time['end']:.6g} {unit}"
    if time["period"]:
        rate = f", {1 / time['period']:.4g} Hz" if unit == "s" else ""
        line += f", every {time['period']:.4g} {unit}{rate}, sd {time['jitter']:.2g} {unit}"
    words.append(line)
    if time["gap_count"]:
        first = time["gaps"][0]
        gaps, place = _count(time["gap_count"], "gap"), f"from {first['begin']:.6g} {unit} on"
        words.append(f"{gaps}, the first of {first['lasts']:.4g} {unit} {place}")
    if time["steps_back"]:
        words.append(
            f"the clock steps back {_count(time['steps_back'], 'time')} in a run, first at row {time['first_back'] + 1}"
        )
    if time["repeated"]:
        words.append(f"{_count(time['repeated'], 'row')} with the time of the row before")
    return words


def _column_words(column: dict[str, Any]) -> str:
    if column["text"]:
        return f"text, {column['values']} different"
    said = [f"{column['missing']} missing"] if column["missing"] else []
    if column["constant"]:
        said.append("constant")
    if column["step"] is not None:
        said.append(f"steps of {column['step']:.4g}")
    said += [f"saturates at {at['at']:.6g} ({at['rows']} rows)" for at in column["saturated"]]
    if column["stuck"]:
        said.append(f"sticks in {column['stuck']['rows']} rows, from row {column['stuck']['first'] + 1} on")
    return ", ".join(said)


def describe(answer: dict[str, Any]) -> str:
    """The answer for people."""
    name = Path(answer["file"]).name
    lines = [f"{name}: {answer['rows']} {'rows' if 'time' in answer else 'frames'}, {len(answer['columns'])} columns"]
    lines += [f"  {note}" for note in answer["notes"]]
    if "frames" in answer:
        told = answer["frames"]
        lines.append(
            f"  {told['frames']} frames of {len(told['messages'])} messages on {max(1, len(answer['buses']))} bus(es)"
        )
        if "time" not in answer:
            return "\n".join([*lines, "  no frame with a time that the description of the bus knows: --dbc FILE"])
    lines += [f"  {words}" for words in _clock_words(answer)]
    width = min(32, max(len(c["column"]) for c in answer["columns"]))
    lines.append(f"  {'column':<{width}}  {'unit':<8} {'least':>11} {'greatest':>11}")
    for column in answer["columns"][:MOST_SHOWN]:
        unit = answer["units"].get(column["column"], column["unit"]) or "-"
        low, high = (f"{v:>11.5g}" if (v := column.get(key)) is not None else f"{'':>11}" for key in ("min", "max"))
        lines.append(f"  {column['column'][:width]:<{width}}  {unit:<8} {low} {high}  {_column_words(column)}".rstrip())
    if len(answer["columns"]) > MOST_SHOWN:
        lines.append(f"  and {len(answer['columns']) - MOST_SHOWN} columns more (--json -)")
    lines += [f"  the same numbers: {' = '.join(names)}" for names in answer["same"]]
    runs = answer["runs"]
    if runs["by"]:
        lines.append(f"  {runs['count']} runs, by {runs.get('column') or runs['by']}")
    if answer["steady_count"]:
        first = answer["steady"][0]
        place = f"{first['begin']:.6g} to {first['end']:.6g}" if first["begin"] is not None else "rows {} to {}".format(
            first["rows"][0] + 1, first["rows"][1]
        )  # fmt: skip
        count = answer["steady_count"]
        many = f"{count} stretches may be steady states, the first"
        lines.append(f"  {many if count > 1 else '1 stretch may be a steady state'}: {place}")
    return "\n".join(lines)
