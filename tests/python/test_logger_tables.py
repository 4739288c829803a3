"""Tables as data loggers write them: lines above the names that are filled up with delimiters, clocks for units."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, terrapin

from terrapin_tools.workbench.files.format import Asked
from terrapin_tools.workbench.files.tables import read
from terrapin_tools.workbench.intake.look import describe, look
from terrapin_tools.workbench.new_case.from_tables import guess_columns

ROWS = 40
SPEED = 100 + 7.5 * np.arange(ROWS) % 90
CURRENT = 0.4 + 0.002 * SPEED


def german(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def clock(row: int) -> str:
    return f"00:00:{row // 10:02d}.{row % 10}00"


def write(path: Path, top: list[str], first: list[str], end: str = "", encoding: str = "cp1252") -> Path:
    """A German logger's file: `top`, then the time as `first` has it, a speed and a current."""
    cells = zip(first, SPEED, CURRENT, strict=True)
    rows = [f"{t};{german(w, 1)};{german(i, 4)}{end}" for t, w, i in cells]
    path.write_bytes("\r\n".join([*top, *rows, ""]).encode(encoding))
    return path


CLOCKS = [clock(i) for i in range(ROWS)]
SECONDS = [german(0.1 * i, 1) for i in range(ROWS)]
# top, times, end of rows, lines above the names, line of units
FILES: dict[str, tuple[list[str], list[str], str, int, int]] = {
    "filled up": (
        ["Messgerät;DL-16;", "Prüfling;Antrieb 3;", "Datum;12.03.2025;", ";;",
         "Zeit;Drehzahl;Strom", "hh:mm:ss.mmm;1/min;A"], CLOCKS, "", 4, 6,
    ),
    "a delimiter more": (
        ["Datei;messung_07.csv;;", "Abtastrate;10;Hz;", "Zeit;Drehzahl;Strom;", "hh:mm:ss.mmm;1/min;A;"],
        CLOCKS, ";", 2, 4,
    ),
    "commas in the first line": (
        ["Bemerkung: Sand, trocken;;", "Startzeit;10:12:03;", "Zeit;Drehzahl;Strom", "[hh:mm:ss.mmm];[1/min];[A]"],
        CLOCKS, "", 2, 4,
    ),
    "not filled up": (
        ["Messgerät: DL-16", "Kanäle;2", "", "Zeit;Drehzahl;Strom", "hh:mm:ss.mmm;1/min;A"], CLOCKS, "", 3, 5,
    ),
    "partly filled up": (
        ["DL-16", "Kanäle;2;", "Zeit;Drehzahl;Strom", "hh:mm:ss.mmm;1/min;A"], CLOCKS, "", 2, 4,
    ),
    "as wide as the table": (
        ["Gerät;Nummer;Werk", "DL-16;47;3", "Zeit;Drehzahl;Strom", "s;1/min;A"], SECONDS, "", 2, 4,
    ),
    "units in the names": (["Gerät;DL-16;", "Zeit [hh:mm:ss.mmm];Drehzahl [1/min];Strom [A]"], CLOCKS, "", 1, 0),
}  # fmt: skip


@pytest.mark.parametrize("name", list(FILES))
def test_names_and_units_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    top, first, end, above, units = FILES[name]
    path = write(tmp_path / "log.csv", top, first, end)
    table = read(path)
    assert f"{above} line{'s' * (above > 1)} above the names" in table.notes
    assert (f"units from line {units}" in table.notes) == (units > 0)
    assert table.numbers("Zeit [s]") == pytest.approx(0.1 * np.arange(ROWS))
    assert table.numbers("Drehzahl [1/min]") == pytest.approx(SPEED)
    assert table.numbers("Strom [A]") == pytest.approx(CURRENT, abs=1e-4)
    assert not any("hh:mm" in column and "[s]" in column for column in table.columns)
    answer = look(path)
    assert (answer["time"]["column"], answer["time"]["period"]) == ("Zeit [s]", pytest.approx(0.1))
    assert "no column of time" not in describe(answer)
    status, _, err = terrapin(capsys, "case", "table", path, "--to", tmp_path / "case")
    assert (status, err) == (0, "")
    told = tomllib.loads((tmp_path / "case/case.toml").read_text())
    assert told["model"]["equation"] == {"strom": "offset + gradient*drehzahl"}


def test_what_may_be_names_is_asked_for_with_its_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two lines of words as wide as the table, and units in words: nothing tells which line is what."""
    top = ["Messgerät;DL-16;Halle", "Ort;Werk;Platz", "Zeit;Drehzahl;Strom", "Sekunden;Umdrehungen;Ampere"]
    path = write(tmp_path / "log.csv", top, SECONDS)
    way = "--read names=3 --read units=4"
    status, _, err = terrapin(capsys, "case", "table", path, "--to", tmp_path / "case")
    assert status == 2
    one_line(
        err, ["found no column of numbers", "begin in line 5", f"line 3 holds the names and line 4 units, say {way}"]
    )
    status, out, _ = terrapin(capsys, "look", path)
    assert status == 0
    assert way in out
    status, out, err = terrapin(capsys, "look", path, *way.split())
    assert (status, err) == (0, "")
    assert "Drehzahl [Umdrehungen]" in out
    assert "Zeit [s]: 0 to 3.9 s" in out
    assert "--read" not in out
    assert terrapin(capsys, "case", "table", path, *way.split(), "--to", tmp_path / "case")[0] == 0
    status, _, err = terrapin(capsys, "look", path, "--read", "nmes=3")
    assert status == 2
    one_line(err, ["--read: found 'nmes'"])


@pytest.mark.parametrize(
    ("top", "names"),
    [
        (["Zeit;Drehzahl;Strom", "Sekunden;Umdrehungen;Ampere"], "Zeit"),  # units in words, not names
        (["Gerät;DL-16;", "Zeit;Drehzahl;Strom", "Sekunden;Umdrehungen;Ampere"], "Gerät"),
        ([";w;i", "Sekunden;Umdrehungen;Ampere"], "w"),  # a column without a name, not a line filled up
        (["Zeit;Drehzahl;Strom", ";;"], "Zeit"),
        (["Zeit;Drehzahl;Strom", "0,0;fehlt;fehlt"], "Zeit"),
    ],
)
def test_where_it_is_not_sure_the_first_line_has_the_names(tmp_path: Path, top: list[str], names: str) -> None:
    assert names in read(write(tmp_path / "log.csv", top, SECONDS)).columns


def test_a_lower_line_that_is_named_is_taken(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", FILES["filled up"][0], CLOCKS)
    plain, asked = read(path), read(path, asked=Asked(names="5", units="6"))
    assert list(asked.columns) == list(plain.columns)


def test_seconds_never_take_the_place_of_a_column(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("Zeit;Zeit [s];x\n" + "".join(f"{clock(i)};{7 + i};{i * i}\n" for i in range(9)))
    table = read(path)
    assert table.numbers("Zeit [s]").tolist() == list(range(7, 16))
    assert table.numbers("Zeit 2 [s]") == pytest.approx(0.1 * np.arange(9))


def test_seconds_beside_a_clock_are_the_time_whatever_it_is_called(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "log.csv", ["Stempel;Drehzahl;Strom", "hh:mm:ss.mmm;1/min;A"], CLOCKS)
    assert look(path)["time"]["column"] == "Stempel [s]"
    assert guess_columns(["Stempel [s]", "t"], ["Stempel"])[0].name == "time"
    assert terrapin(capsys, "case", "table", path, "--to", tmp_path / "case")[0] == 0
    told = tomllib.loads((tmp_path / "case/case.toml").read_text())
    assert list(told["model"]["equation"]) == ["strom"], "it stands last, and is not predicted"
