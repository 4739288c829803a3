"""CSV files as laboratories write them: the same numbers from every spelling, and one line for what is no number."""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.files import csv_files
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
        ("NA", ["runs.csv:4", "text 'NA'"]),
        ("1_0", ["runs.csv:4", "text '1_0'"]),
        ("0x10", ["runs.csv:4", "text '0x10'"]),
        ("-inf", ["runs.csv:4", "infinity"]),
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
    (tmp_path / "a.csv").write_text("run;note;x;y\na,b;1,5 mm;1,5;1.5\nc;2;,5e1;1,5\n")
    table = read(tmp_path / "a.csv")
    assert table.text("run") == ["a,b", "c"]
    assert table.text("note") == ["1,5 mm", "2"]
    assert table.numbers("x").tolist() == [1.5, 5.0]
    with pytest.raises(UserError, match=r"a\.csv:3: column y: found text '1,5'"):  # points and commas in one column
        table.numbers("y")


def test_a_column_cannot_be_two_things(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 1, text=ROLLING.replace('column = "W"', 'column = "w"'))
    status, _, err = terrapin(capsys, "compare", folder)
    assert status == 2
    one_line(err, ["case.toml:25", "data.columns.load.column", "omega", "rpm"])


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
