"""Tables drawn at random: dialects, encodings, marks, headings, units and dates of labs; with the numbers in them.

.venv/bin/python tests/python/drawn_tables.py 400 [FIRST]    draws as many, reads them, and with one damage each
"""

from __future__ import annotations

import datetime
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.tables import read
from terrapin_tools.workbench.new_case.from_tables import split_unit, write_table_case

SPELT = {  # as people write them -> as pint does
    "speed": (("1/min", "U/min", "rpm", "min-1"), "1/min"),
    "torque": (("mN\u00b7m", "mNm", "mN m"), "mN m"),
    "temp": (("\u00b0C", "degC"), "degC"),
}
MARKS = ("", "NA", "#N/A", "-", "nan", "---", "NaN", "N/A")
CLOCKS = ("", "iso", "iso zone", "german", "american", "clock", "clock midnight", "date and clock", "seconds")
DAMAGES = ("cut row", "mixed mark", "copied row", "two units")


@dataclass
class Drawn:
    """A file, and what it holds: numbers by column (NaN for a gap), seconds of its clock, how it was drawn."""

    content: bytes
    numbers: dict[str, list[float]]
    seconds: list[float] | None
    how: str
    lines: list[str]
    first: int  # line of the first row, from 1
    encoding: str
    end: str
    delimiter: str
    fields: list[list[str]] = field(default_factory=list)


def draw(seed: int) -> Drawn:
    random = np.random.default_rng([3800, seed])
    rows = int(random.integers(6, 30))
    digits = int(random.integers(1, 5))
    numbers = {
        "speed": np.round(random.uniform(-3000, 3000, rows), digits),
        "torque": np.round(random.uniform(0.01, 90, rows), 4),
        "temp": np.round(random.uniform(15, 40, rows), 1),
    }
    comma = bool(random.integers(2))
    delimiter = str(random.choice([";", "\t", "|"] if comma else [",", ";", "\t", "|"]))
    thousands = bool(random.integers(2)) and (comma or delimiter != ",")
    quotes = random.random() < 0.2
    encoding = str(random.choice(["utf-8", "utf-8-sig", "utf-16", "cp1252"]))
    heading = str(random.choice(["brackets", "parentheses", "row"]))
    above = int(random.choice([0, 0, 0, 1, 2, 4]))
    sep, end = random.random() < 0.15, str(random.choice(["\n", "\r\n"]))
    trailing, fortran = random.random() < 0.15, not thousands and random.random() < 0.15
    mark = str(random.choice(MARKS))
    clock = str(random.choice(CLOCKS))
    spelt = {name: str(random.choice(spellings)) for name, (spellings, _) in SPELT.items()}

    def text(value: float) -> str:
        if np.isnan(value):
            return mark
        plain = f"{value:.6e}".replace("e", "D") if fortran else f"{value:,}" if thousands else repr(value)
        return plain.translate({44: 46, 46: 44}) if comma else plain

    if fortran:
        numbers = {name: np.array([float(f"{v:.6e}") for v in column]) for name, column in numbers.items()}
    if random.random() < 0.5:
        numbers["torque"][random.integers(0, rows)] = np.nan
    columns = {"run": [f"V{i // 3}" for i in range(rows)]}
    seconds = None
    if clock:
        seconds, clocks = _clock(random, clock, rows, comma, text)
        columns |= clocks
    columns |= {name: [text(float(v)) for v in column] for name, column in numbers.items()}
    named = list(columns)
    if heading != "row":
        left, right = "[]" if heading == "brackets" else "()"
        named = [f"{name} {left}{spelt[name]}{right}" if name in spelt else name for name in named]
    lines = [f"Rig{' ' * i} {i}" for i in range(above)]
    if sep:
        lines.insert(0, f"sep={delimiter}")
    lines.append(delimiter.join(named))
    if heading == "row":
        lines.append(delimiter.join(spelt.get(name, "") for name in columns))
    first = len(lines) + 1
    cells = [[f'"{cell}"' if quotes else cell for cell in row] for row in zip(*columns.values(), strict=True)]
    lines += [delimiter.join(row) + (delimiter if trailing else "") for row in cells]
    how = f"{seed}: {encoding} {delimiter!r} comma={comma} thousands={thousands} {heading} {above} {clock} {mark!r}"
    truth = {name: column.tolist() for name, column in numbers.items()}
    content = (end.join(lines) + end).encode(encoding)
    return Drawn(content, truth, seconds, how, lines, first, encoding, end, delimiter, cells)


def _clock(
    random: np.random.Generator, kind: str, rows: int, comma: bool, text: object
) -> tuple[list[float], dict[str, list[str]]]:
    """Seconds since the first row, and the columns that tell them."""
    begin = datetime.datetime(2026, int(random.integers(1, 13)), int(random.integers(1, 29)), 8, 15)
    if kind == "clock midnight":
        begin = begin.replace(hour=23, minute=58)
    steps = np.cumsum([0, *random.integers(1, 500, rows - 1)]).tolist()
    if kind != "clock midnight":
        steps = [step / 4 for step in steps]
    moments = [begin + datetime.timedelta(seconds=step) for step in steps]
    if kind == "seconds":
        return steps, {"time": [text(float(step)) for step in steps]}  # type: ignore[operator]
    point = "," if comma else "."
    part = [f"{m:%H:%M:%S}{point}{m.microsecond // 1000:03d}" for m in moments]
    spelt = {
        "iso": [m.isoformat(sep=" ") for m in moments],
        "iso zone": [f"{m.isoformat()}+02:00" for m in moments],
        "german": [f"{m:%d.%m.%Y} {c}" for m, c in zip(moments, part, strict=True)],
        "american": [f"{m:%m/%d/%Y %I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}" for m in moments],
    }
    if kind == "date and clock":
        return steps, {"date": [f"{m:%Y-%m-%d}" for m in moments], "clock": part}
    return steps, {"clock": spelt.get(kind, part)}


def judge(path: Path, drawn: Drawn) -> str:
    """ "read", "asked" or what is wrong."""
    path.write_bytes(drawn.content)
    try:
        table = read(path)
    except UserError as error:
        return f"asked: {error}"
    found = {split_unit(name)[0]: name for name in table.columns}
    for name, values in drawn.numbers.items():
        column = found.get(name, found.get(f"{name} [{name}]", ""))
        if not column:
            return f"wrong: no column {name} in {list(table.columns)}"
        unit = split_unit(column)[1]
        try:
            same = np.array_equal(table.numbers(column, gaps=True), values, equal_nan=True)
        except UserError as error:
            return f"asked: {error}"
        if not same:
            return f"wrong: numbers of {name}"
        if units.spelling(unit) not in (SPELT[name][1], "rpm") or not unit:
            return f"wrong: unit of {name}: {unit!r}"
    if drawn.seconds is not None:
        clock = next((n for n in table.columns if n in ("clock [s]", "time")), "")
        if not clock or not np.allclose(table.numbers(clock), drawn.seconds, rtol=0, atol=1e-6):
            return f"wrong: clock {clock!r}"
    return "read"


def damaged(drawn: Drawn, kind: str, seed: int) -> tuple[bytes, int]:
    """The file with one damage, and the line of it."""
    random = np.random.default_rng([3801, seed])
    rows = [list(row) for row in drawn.fields]
    at = int(random.integers(1, len(rows) - 1))
    row = rows[at]
    number = max(range(len(row)), key=lambda i: (i < len(row) - 1, i))  # the torque
    plain = row[number].strip('"')
    while kind in ("mixed mark", "two units") and ("," not in plain and "." not in plain):
        at = at % (len(rows) - 2) + 1
        row = rows[at]
        plain = row[number].strip('"')
    line = drawn.first + at
    if kind == "cut row":
        del row[-2:]
    elif kind == "mixed mark":
        row[number] = f'"{plain.translate({44: 46, 46: 44})}"'
    elif kind == "copied row":
        rows.insert(at + 1, list(row))
        line += 1
    else:
        row[number] = f"{plain} N m"
    body = [drawn.delimiter.join(row) for row in rows]
    lines = [*drawn.lines[: drawn.first - 1], *body]
    return (drawn.end.join(lines) + drawn.end).encode(drawn.encoding), line


def named(path: Path, folder: Path, content: bytes, line: int) -> str:
    """ "named" where what `case table` says holds the line, else what it said."""
    path.write_bytes(content)
    said: list[str] = []
    try:
        words = write_table_case(folder, [path], "a", told={}, ask=_first, show=said.append)
    except UserError as error:
        words = str(error)
    told = "\n".join([*said, words])
    return "named" if f"{path.name}:{line}" in told else f"not named (line {line}): {told}"


def _first(question: str, choices: object, option: str) -> str:
    raise UserError(f"{question} {option}")


def main(count: int, begin: int = 0) -> int:
    wrong = asked = missed = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for seed in range(begin, begin + count):
            drawn = draw(seed)
            found = judge(folder / "a.csv", drawn)
            wrong += found.startswith("wrong")
            asked += found.startswith("asked")
            if found != "read":
                print(f"{drawn.how}\n    {found}")
            kind = DAMAGES[seed % len(DAMAGES)]
            content, line = damaged(drawn, kind, seed)
            found = named(folder / "b.csv", folder / f"case_{seed}", content, line)
            missed += found != "named"
            if found != "named":
                print(f"{kind}: {drawn.how}\n    {found}")
    print(f"{count} tables: {wrong} wrong, {asked} asked; with one damage each {missed} not named with the row")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])) if len(sys.argv) > 1 else main(400))
