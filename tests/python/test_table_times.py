"""Dates and clock times as seconds, runs told apart, what may be read in two ways, drawn tables of every dialect."""

from __future__ import annotations

import tomllib
from pathlib import Path

import drawn_tables
import numpy as np
import pytest
from casekit import one_line, terrapin

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Ambiguous, Asked
from terrapin_tools.workbench.files.tables import read


def table(path: Path, head: str, cells: list[str]) -> Path:
    path.write_text("\n".join([f"{head};x", *(f"{cell};{i}.5" for i, cell in enumerate(cells))]) + "\n")
    return path


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["12:00:00", "12:00:01.5", "13:00:00"], [0, 1.5, 3600]),
        (["23:59:59", "00:00:01", "00:00:02"], [0, 2, 3]),
        (["2026-12-31 23:59:59", "2027-01-01 00:00:01", "2027-01-02T00:00:01"], [0, 2, 86402]),
        (["31.12.2026 23:59:59,5", "1.1.2027 00:00:00,5", "1.1.2027 0:00:01"], [0, 1, 1.5]),
        (["3/13/2026 11:59:59 AM", "3/13/2026 12:00:00 PM", "3/13/2026 1:00:00 PM"], [0, 1, 3601]),
        (["2026-03-29T01:59:59+01:00", "2026-03-29T03:00:00+02:00", "2026-03-29T01:00:02Z"], [0, 1, 3]),
        (["03-Feb-2026 12:00:00", "", "03-Feb-2026 12:00:02"], [0, np.nan, 2]),
        (["59:59.5", "60:00.5", "60:01.0"], [0, 1, 1.5]),
    ],
)
def test_times_are_seconds(tmp_path: Path, cells: list[str], seconds: list[float]) -> None:
    found = read(table(tmp_path / "a.csv", "clock", cells))
    np.testing.assert_allclose(found.numbers("clock [s]", gaps=True), seconds, atol=1e-9)
    assert found.text("clock") == [cell.strip() for cell in cells]
    assert any("clock as time" in note for note in found.notes)


@pytest.mark.parametrize(
    ("cells", "key", "readings"),
    [
        (
            ["3/4/2026 12:00:00", "4/4/2026 12:00:00"],
            "dates",
            {"day first": 86400.0, "month first": 30 * 86400.0 + 86400.0},
        ),
        (["12:05", "12:06"], "clock", {"h:m": 60.0, "m:s": 1.0}),
    ],
)
def test_a_time_with_two_readings_is_asked_for(
    tmp_path: Path, cells: list[str], key: str, readings: dict[str, float]
) -> None:
    file = table(tmp_path / "a.csv", "clock", cells)
    with pytest.raises(Ambiguous) as error:
        read(file)
    assert error.value.key == key
    assert error.value.choices == tuple(readings)
    assert "a.csv:2: column clock" in str(error.value)
    for choice, seconds in readings.items():
        assert read(file, asked=Asked(**{key: choice})).numbers("clock [s]")[1] == seconds


def test_a_time_that_is_none_is_told_with_its_row(tmp_path: Path) -> None:
    found = read(table(tmp_path / "a.csv", "clock", ["12:00:00", "12:00:01", "12:00:6x", "12:00:03"]))
    assert "clock [s]" not in found.columns
    assert "clock stays text, as a.csv:4 has no time in it: '12:00:6x'" in found.notes


def test_true_and_false_are_numbers_unless_they_name_groups(tmp_path: Path) -> None:
    file = table(tmp_path / "a.csv", "wet", ["TRUE", "false", "", "true"])
    np.testing.assert_array_equal(read(file).numbers("wet", gaps=True), [1, 0, np.nan, 1])
    assert read(file, texts={"wet"}).text("wet") == ["TRUE", "false", "", "true"]


def test_what_may_be_read_in_two_ways_is_refused_with_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("run;x\na;1,302\nb;2,105\nc;3,111\nd;1,000\ne;2,000\n")
    status, out, err = terrapin(capsys, "case", "table", tmp_path / "a.csv", "--to", tmp_path / "case")
    assert (status, out) == (2, "")
    one_line(err, ["a.csv:2", "which is 1.302 or 1302", "--read decimal=point or decimal=comma"])
    for choice, first in (("point", 1302.0), ("comma", 1.302)):
        case = tmp_path / choice
        words = ["--read", f"decimal={choice}", "--to", case]
        assert terrapin(capsys, "case", "table", tmp_path / "a.csv", *words)[0] == 0
        assert tomllib.loads((case / "case.toml").read_text())["data"]["read"] == {"decimal": choice}
        assert read(tmp_path / "a.csv", asked=Asked(decimal=choice)).numbers("x")[0] == first


def experiments(path: Path) -> Path:
    """Three runs in one file: the time begins again, and a trigger rises where it does."""
    lines = ["t [s],trigger,force [N]"]
    for run in range(3):
        lines += [f"{0.1 * i:.1f},{int(i < 5)},{run + i}" for i in range(20)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_runs_of_one_file_are_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = experiments(tmp_path / "a.csv")
    status, out, _ = terrapin(capsys, "case", "table", file, "--to", tmp_path / "case")
    assert status == 0
    assert "a new run where t [s] begins again: 3 runs, in column 'run'" in out
    data = tomllib.loads((tmp_path / "case" / "case.toml").read_text())["data"]
    assert (data["run"], data["read"]) == ("run", {"runs": "repeat"})
    assert terrapin(capsys, "compare", tmp_path / "case")[0] == 0
    for how in ("repeat", "gap", "gap:5", "trigger:trigger"):
        names = read(file, asked=Asked(runs=how)).text("run")
        assert names == [f"a {run}" for run in (1, 2, 3) for _ in range(20)], how
    with pytest.raises(UserError, match=r"runs=trigger: found 'no', expected one of t \[s\], trigger, force"):
        read(file, asked=Asked(runs="trigger:no"))


def test_columns_of_text_become_groups(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = ["run,surface,x,y"]
    lines += [f"r{run},{'sand' if run % 2 else 'clay'},{i},{run * i}.5" for run in range(8) for i in range(4)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    status, out, _ = terrapin(capsys, "case", "table", tmp_path / "a.csv", "--to", tmp_path / "case")
    assert status == 0
    assert "Groups of runs by surface: clay, sand" in out
    assert tomllib.loads((tmp_path / "case" / "case.toml").read_text())["groups"] == {"surface": {"column": "surface"}}
    assert terrapin(capsys, "compare", tmp_path / "case")[0] == 0


@pytest.mark.parametrize("seed", range(24))
def test_drawn_tables(tmp_path: Path, seed: int) -> None:
    drawn = drawn_tables.draw(seed)
    assert drawn_tables.judge(tmp_path / "a.csv", drawn) == "read", drawn.how
    for number, kind in enumerate(drawn_tables.DAMAGES):
        content, line = drawn_tables.damaged(drawn, kind, seed)
        said = drawn_tables.named(tmp_path / "b.csv", tmp_path / f"case_{number}", content, line)
        assert said == "named", f"{kind}: {drawn.how}"
