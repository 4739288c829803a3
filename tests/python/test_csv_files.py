"""CSV files as laboratories write them: the same numbers from every spelling, and one line for what is no number."""

from __future__ import annotations

import contextlib
import resource
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from casekit import ROLLING, one_line, rolling, terrapin
from drawn_tables import DAMAGES, damaged, draw

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.files import csv_files, number_marks
from terrapin_tools.workbench.files.tables import read

SPELLINGS: dict[str, Callable[[str], bytes]] = {
    "byte order mark": lambda t: b"\xef\xbb\xbf" + t.encode(),
    "Windows": lambda t: t.replace("\n", "\r\n").encode(),
    "old Macintosh": lambda t: t.replace("\n", "\r").encode(),
    "semicolons": lambda t: t.replace(",", ";").encode(),
    "semicolons and decimal commas": lambda t: t.replace(",", ";").replace(".", ",").encode(),
    "tabs": lambda t: t.replace(",", "\t").encode(),
    "tabs and decimal commas": lambda t: t.replace(",", "\t").replace(".", ",").encode(),
    "comments": lambda t: ("# rig 3\n# 2026-02-03, wet\n" + t).encode(),
    "quotes": lambda t: t.replace("r00", '"r00"').replace("run", '"run"').encode(),
    "comma at the end": lambda t: t.replace("\n", ",\n").encode(),
    "no line end": lambda t: t.rstrip("\n").encode(),
    "blanks": lambda t: t.replace(",", " , ").encode(),
    "all at once": lambda t: (
        b"\xef\xbb\xbf" + ("# x\n" + t.replace(",", ";").replace(".", ",").replace("\n", ";\n")).encode()
    ),
}


@pytest.mark.parametrize("large", [False, True], ids=["small", "large"])
@pytest.mark.parametrize("name", SPELLINGS)
def test_the_same_case_from_every_spelling(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, large: bool
) -> None:
    plain = load_case(rolling(tmp_path, 1, runs=3, rows=4))
    if large:
        monkeypatch.setattr(csv_files, "LARGE", 1)
    file = tmp_path / "runs.csv"
    file.write_bytes(SPELLINGS[name](file.read_text()))
    found = load_case(tmp_path)
    assert found.run_names == plain.run_names
    assert list(found.extra) == list(plain.extra)
    for role, values in {**plain.roles, **plain.channels, **plain.extra}.items():
        np.testing.assert_array_equal({**found.roles, **found.channels, **found.extra}[role], values)
    line = 5 if name == "comments" else 4 if name == "all at once" else 3
    assert found.place(1) == f"runs.csv:{line}"


@pytest.mark.parametrize("large", [False, True], ids=["small", "large"])
@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ('"3,5"', ["runs.csv:4", "column w", "'3,5'", "decimal point"]),
        ("3,5", ["runs.csv:4", "found 7 fields, expected 6", "decimal comma?"]),
        ("none of it", ["runs.csv:4", "text 'none of it'"]),
        ("1_0", ["runs.csv:4", "text '1_0'"]),
        ("0x10", ["runs.csv:4", "text '0x10'"]),
        ("1e400", ["runs.csv:4", "infinity"]),
        ("\u0663", ["runs.csv:4", "text '\u0663'"]),
        ("\u22125", ["runs.csv:4", "text '\u22125'"]),
        ("5%", ["runs.csv:4", "text '5%'"]),
    ],
)
def test_a_cell_that_is_no_number(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    cell: str,
    expected: list[str],
    large: bool,
) -> None:
    folder = rolling(tmp_path, 1, runs=3, rows=2)
    lines = (folder / "runs.csv").read_text().splitlines()
    fields = lines[3].split(",")
    lines[3] = ",".join([fields[0], cell, *fields[2:]])
    (folder / "runs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if large:
        monkeypatch.setattr(csv_files, "LARGE", 1)
    status, out, err = terrapin(capsys, "compare", folder)
    assert (status, out) == (2, "")
    one_line(err, expected)


def test_run_names_stay_as_they_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_files, "LARGE", 1)
    (tmp_path / "a.csv").write_text("run,x\n007,1\n1e3,2\n08.50,3\n")
    table = read(tmp_path / "a.csv", texts={"run"})
    assert table.text("run") == ["007", "1e3", "08.50"]
    assert table.numbers("x").tolist() == [1.0, 2.0, 3.0]


def test_text_with_commas_between_semicolons_stays_text(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("run;note;date;x\na,b;1,5 mm;12.03.2026;1,5\nc;2;13.03.2026;,5e1\n")
    table = read(tmp_path / "a.csv")
    assert table.text("run") == ["a,b", "c"]
    assert table.text("note") == ["1,5 mm", "2"]
    assert table.text("date") == ["12.03.2026", "13.03.2026"]
    assert table.numbers("x").tolist() == [1.5, 5.0]


# Text of a file -> its columns as numbers, and words of what was assumed.
LAYOUTS: dict[str, tuple[bytes, dict[str, list[float]], str]] = {
    "a row of units": (b"w,M\nrpm,mN m\n1.5,2\n3,4\n", {"w [rpm]": [1.5, 3], "M [mN m]": [2, 4]}, "units from line 2"),
    "Windows-1252": ("w;M\n1/min;mN\u00b7m\n1,5;2\n3;4\n".encode("cp1252"), {"M [mN m]": [2, 4]}, "Windows-1252"),
    "UTF-16": ("w;T\n1,5;2\n3;4\n".encode("utf-16"), {"w": [1.5, 3], "T": [2, 4]}, "UTF-16"),
    "thousands": (b"w;M\n1.302,5;2\n2.000;4\n", {"w": [1302.5, 2000]}, "parts thousands"),
    "thousands in quotes": (b'w,M\n"1,302.5",2\n"12,345,678",4\n', {"w": [1302.5, 12345678]}, "parts thousands"),
    "spaces part thousands": ("w;M\n1\u00a0302,5;2\n3;4\n".encode(), {"w": [1302.5, 3]}, "decimal comma"),
    "lines above": (
        b"Rig\t3\nRate\t9 Hz\nDone\n\nt\tw\tM\n1\t2\t3\n4\t5\t6\n",
        {"t": [1, 4]},
        "4 lines above the names",
    ),
    "sep": (b"sep=|\nw|M\n1|2\n", {"w": [1], "M": [2]}, "by its first line"),
    "a name twice": (b"M [N m],M [N m],M\n1,2,3\n", {"M [N m]": [1], "M 2 [N m]": [2], "M": [3]}, "more than once"),
    "exponents of Fortran": (b"w,M\n1.5D-02,2\n2.5d+1,4\n", {"w": [0.015, 25]}, ""),
    "delimiters at the end of rows": (b"w,M\n1,2,\n3,4,\n", {"w": [1, 3], "M": [2, 4]}, ""),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts(tmp_path: Path, name: str) -> None:
    content, expected, words = LAYOUTS[name]
    (tmp_path / "a.csv").write_bytes(content)
    table = read(tmp_path / "a.csv")
    for column, values in expected.items():
        assert table.numbers(column).tolist() == values, column
    told = "; ".join(table.notes)
    assert words in told
    assert words or not told


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("w;M\n1,5;2\n1,75;2\n1.5;3\n", 4),  # one decimal point among commas
        ('w,M\n1.5,2\n2.75,1\n"1,5",3\n', 4),
        ("w;M\n1,5;2\n1.302,75;2\n1,302.5;3\n", 4),
        ('w,M\n"1,302",2\n3,4\n', 2),  # 1.302 or 1302
    ],
)
def test_what_may_be_read_in_two_ways_is_refused(tmp_path: Path, text: str, line: int) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(UserError, match=rf"a\.csv:{line}: column w: found '1.*expected a decimal"):
        read(tmp_path / "a.csv")


@pytest.mark.parametrize("mark", ["#N/A", "NA", "n/a", "-", "---", "NaN", "inf", "-inf", "", "NULL"])
@pytest.mark.parametrize("large", [False, True], ids=["small", "large"])
def test_marks_of_what_was_not_measured_are_gaps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mark: str, large: bool
) -> None:
    if large:
        monkeypatch.setattr(csv_files, "LARGE", 1)
    (tmp_path / "a.csv").write_text(f"w,M\n1.5,2\n{mark},4\n")
    np.testing.assert_array_equal(read(tmp_path / "a.csv").numbers("w", gaps=True), [1.5, np.nan])


def written(random: np.random.Generator) -> tuple[bytes, dict[str, list[float]], list[str]]:
    """A table in a spelling drawn at random, with its numbers; and how it was drawn."""
    rows = int(random.integers(4, 12))
    numbers = {
        "speed": np.round(random.uniform(-3000, 3000, rows), int(random.integers(1, 5))),
        "torque": np.round(random.uniform(0.01, 90, rows), 4),
        "temp": np.round(random.uniform(15, 40, rows), 1),
    }
    unit = {"speed": "1/min", "torque": "mN\u00b7m", "temp": "\u00b0C"}
    comma = bool(random.integers(2))
    delimiter = str(random.choice([";", "\t", "|"] if comma else [",", ";", "\t", "|"]))
    thousands = bool(random.integers(2)) and delimiter != ("," if not comma else "")
    encoding = str(random.choice(["utf-8", "utf-8-sig", "utf-16", "cp1252"]))
    heading = str(random.choice(["names", "brackets", "row"]))
    above = int(random.integers(0, 4))
    end = str(random.choice(["\n", "\r\n"]))
    fortran = not thousands and random.random() < 0.2

    def spelt(value: float) -> str:
        text = f"{value:.5e}".replace("e", "D") if fortran else f"{value:,}" if thousands else f"{value!r}"
        swap = {",": ".", ".": ","}
        return "".join(swap.get(c, c) for c in text) if comma else text

    names = [f"{name} [{unit[name]}]" if heading == "brackets" else name for name in numbers]
    lines = [f"Rig{' ' * i} {i}" for i in range(above)] + [delimiter.join(["run", *names])]
    if heading == "row":
        lines.append(delimiter.join(["", *unit.values()]))
    for i in range(rows):
        lines.append(delimiter.join([f"V{i // 3}", *(spelt(float(values[i])) for values in numbers.values())]))
    content = (end.join(lines) + end).encode(encoding)
    values = {name: [float(f"{v:.5e}") if fortran else float(v) for v in column] for name, column in numbers.items()}
    return content, values, [f"{encoding} {delimiter!r} comma={comma} thousands={thousands} {heading} above={above}"]


@pytest.mark.parametrize("seed", range(40))
def test_drawn_spellings_give_their_numbers(tmp_path: Path, seed: int) -> None:
    content, numbers, drawn = written(np.random.default_rng([38, seed]))
    (tmp_path / "a.csv").write_bytes(content)
    table = read(tmp_path / "a.csv")
    for name, values in numbers.items():
        column = next(found for found in table.columns if found.split(" [")[0] == name)
        assert table.numbers(column).tolist() == values, drawn
    assert table.text(next(iter(table.columns)))[0] == "V0"


@pytest.mark.parametrize("seed", range(0, 60, 3))
def test_a_large_file_is_read_as_a_small_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Numbers, texts, what was assumed and what is refused; also with one damage."""
    drawn = draw(seed)
    for content in (drawn.content, *(damaged(drawn, kind, seed)[0] for kind in DAMAGES)):
        (tmp_path / "a.csv").write_bytes(content)
        told = []
        for least in (1 << 40, 1):
            monkeypatch.setattr(csv_files, "LARGE", least)
            try:
                table = read(tmp_path / "a.csv", texts={"run"})
            except UserError as error:
                told.append({"refused": str(error)})
                continue
            columns = {name: table.text(name) for name in table.columns}
            for name in columns:
                with contextlib.suppress(UserError):
                    columns[name] = [repr(value) for value in table.numbers(name, gaps=True).tolist()]
            told.append({"notes": table.notes, **columns})
        assert told[0] == told[1]


def test_one_long_text_does_not_widen_its_column(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_files, "LARGE", 1)
    rows = [f"short,{i}" for i in range(100_000)]
    rows[500], rows[700] = f"{'x' * 90_000}y,500", f"{'x' * 90_000}z,700"
    (tmp_path / "a.csv").write_text("\n".join(["note,w", *rows]) + "\n")
    column = read(tmp_path / "a.csv").columns["note"]
    assert column.nbytes < 100_000 * 200 * 4 + 1
    assert column[0] == column[-1] == "short"
    assert len({*column.tolist()}) == 3
    assert "90001 characters" in str(column[500])


def test_doubts_of_a_large_file_are_asked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_files, "LARGE", 1)
    monkeypatch.setattr(csv_files, "_read_any", pytest.fail)
    (tmp_path / "a.csv").write_text("w;M\n" + "1,302;2\n" * 3000)
    with pytest.raises(UserError, match=r"a\.csv:2: column w: found '1,302', which is 1\.302 or 1302"):
        read(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("w;M\n" + "1,302;2\n" * 3000 + "0,125;7\n")
    assert read(tmp_path / "a.csv").numbers("w")[[0, -1]].tolist() == [1.302, 0.125]


def test_a_column_cannot_be_two_things(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 1, text=ROLLING.replace('column = "W"', 'column = "w"'))
    status, _, err = terrapin(capsys, "compare", folder)
    assert status == 2
    one_line(err, ["case.toml:25", "data.columns.load.column", "omega", "rpm"])


def test_a_quote_that_does_not_end_is_found_by_its_line(tmp_path: Path) -> None:
    """It takes all rows below it for one cell."""
    rows = [f"{n},{n}.5,x" for n in range(30_000)]
    rows[998] = '998,"998.5,x'
    (tmp_path / "x.csv").write_text("\n".join(["a [s],b [m],c", *rows, ""]))
    with pytest.raises(UserError, match=r"x\.csv:1000: field larger .*\(a quote that does not end\?\)"):
        read(tmp_path / "x.csv")


def test_half_a_million_rows(tmp_path: Path) -> None:
    """250 MB here; the bound leaves room for other versions. How long it takes: tests/bench/bench_analysis.py."""
    folder = rolling(tmp_path, 1, runs=10, rows=10)
    lines = (folder / "runs.csv").read_text().splitlines(keepends=True)
    (folder / "runs.csv").write_text(lines[0] + "".join(lines[1:]) * 5000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    case = load_case(folder)
    assert case.rows == 500_000
    assert len(case.run_names) == 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 600 * 1024  # kB


def test_four_times_the_rows_are_four_times_the_work() -> None:
    """Cells like 1.302 are weighed against their column: 10,000 of them took 5 s when each went through all of it."""

    def calls(rows: int) -> int:
        cells = [f"{1 + i % 9}.{100 + i % 900}" if i % 2 else f"{i % 9}.{i % 90:02d}" for i in range(rows)]
        count = 0

        def counted(_frame: object, event: str, _arg: object) -> None:
            nonlocal count
            count += event == "call"

        sys.setprofile(counted)
        try:
            number_marks.plain_numbers({"torque": cells}, ",", "runs.csv")
        finally:
            sys.setprofile(None)
        return count

    assert calls(1_600) < 5 * calls(400)
