"""What happens to measurements on their way into a case: gaps, turns, a lost sign, placeholders; and new runs."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_tools import Case
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.changes import OwnParameter, parse_parameter
from terrapin_tools.workbench.case.columns import run_of_rows
from terrapin_tools.workbench.case.intake import again, beyond
from terrapin_tools.workbench.files import csv_files


def change(folder: Path, cells: dict[tuple[int, int], str]) -> None:
    """Put text into cells of runs.csv, by line (from 1) and column (from 0)."""
    lines = [line.split(",") for line in (folder / "runs.csv").read_text().splitlines()]
    for (line, column), text in cells.items():
        lines[line - 1][column] = text
    (folder / "runs.csv").write_text("\n".join(map(",".join, lines)) + "\n")


def test_inertias_of_another_robot_beside_light_masses_are_said() -> None:
    """The sphere's own constants stand for what is not stated: 0.3 kg had 38 times the inertia that it could have."""
    named = ("time", "joint_rate", "torque", "rolling_angle", "swing_angle", "speed")
    table = {name: np.arange(40.0) / 10.0 for name in named}
    units = dict(zip(named, ("s", "rad/s", "N m", "rad", "rad", "m/s"), strict=True))
    soil = {"n": 1, "friction_angle": "35 deg", "shear_modulus": "15 mm"}
    light = {
        "shell_mass": "0.3 kg",
        "frame_mass": "1.5 kg",
        "bob_mass": "0.15 kg",
        "radius": "0.11 m",
        "length": "6 cm",
    }

    def remarks(**constants: Any) -> list[str]:
        case = Case.from_table(table, base="sphere_slip", units=units, constants=constants, fit={"k_s": 2e6})
        return [text for text in case._case.intake if "_inertia" in text]

    assert remarks(**soil, **light) == [
        "shell_inertia is 0.138 kg m^2, and 0.3 kg within the radius of 0.11 m has 0.00363 at most: state it, for what "
        "is not stated is another robot's."
    ]
    assert remarks(**soil, **light, shell_inertia="0.0038 kg m^2") == []
    assert remarks(**soil, **light, shell_inertia="0.0039 kg m^2") != []
    assert remarks(**soil) == []
    assert not any("_inertia" in text for text in Case.example("cylinder_over_time")._case.intake)
    for base in BASES.values():  # what stands for what is not stated is right in itself
        assert beyond({name: one.default for name, one in base.parameters.items() if one.default is not None}) == []


@pytest.mark.parametrize("large", [False, True])
def test_a_gap_drops_its_row_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, large: bool
) -> None:
    folder = rolling(tmp_path, 1)
    before = load_case(folder)
    change(folder, {(4, 1): "", (7, 4): "nan", (9, 4): "NaN", (9, 2): " ", (20, 5): ""})
    if large:
        monkeypatch.setattr(csv_files, "LARGE", 1)
    case = load_case(folder)
    assert case.rows == before.rows - 3
    assert case.rows_left_out == 3
    kept = np.delete(np.arange(before.rows), [2, 5, 7])
    assert case.channels["current"] == pytest.approx(before.channels["current"][kept])
    assert [case.place(row) for row in (0, 2, 5)] == ["runs.csv:2", "runs.csv:5", "runs.csv:10"]
    assert "humidity" not in case.extra
    status, out, _ = terrapin(capsys, "compare", folder)
    assert status == 0
    said = " ".join(out.split())
    assert "3 of 120 rows left out: no number in a mapped column (w 1, W 1, i 2). The first is runs.csv:4." in said
    assert "Not looked at, for gaps: humidity." in said
    answer = json.loads(terrapin(capsys, "compare", folder, "--json", "-")[1])
    assert answer["intake"]["rows_left_out"] == 3
    terrapin(capsys, "report", folder, "--no-discover", "-o", tmp_path / "page.html")
    assert "3 of 120 rows left out" in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize(
    ("column", "text", "told"),
    [
        (1, "#DIV/0!", "1 of 120 rows left out: no number in a mapped column (w 1). The first is runs.csv:9."),
        (4, "-inf", "1 of 120 rows left out: no number in a mapped column (i 1). The first is runs.csv:9."),
        (1, '"1,234.5"', "runs.csv: , parts thousands ('1,234.5')."),
    ],
)
def test_what_was_assumed_of_a_cell_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], column: int, text: str, told: str
) -> None:
    folder = rolling(tmp_path, 1)
    before = load_case(folder)
    change(folder, {(9, column): text})
    case = load_case(folder)
    gap = "," not in text
    assert case.rows == before.rows - gap
    if not gap:
        assert case.roles["omega"][7] == pytest.approx(1234.5 * np.pi / 30)
    assert told in " ".join(terrapin(capsys, "compare", folder)[1].split())


def test_a_table_in_utf_16_is_the_same_case(tmp_path: Path) -> None:
    folder = rolling(tmp_path, 1)
    before = load_case(folder)
    (folder / "runs.csv").write_bytes((folder / "runs.csv").read_text().encode("utf-16"))
    case = load_case(folder)
    np.testing.assert_array_equal(case.channels["current"], before.channels["current"])
    assert case.remarks == ("runs.csv: UTF-16.",)


def test_text_that_could_tell_groups_apart_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 1)
    lines = (folder / "runs.csv").read_text().splitlines()
    by_run = {name: "clay" if k % 2 else "sand" for k, name in enumerate(load_case(folder).run_names)}
    rows = [line.split(",") for line in lines[1:]]
    more = [f"{line},{by_run[cells[0]]},row {k}" for k, (line, cells) in enumerate(zip(lines[1:], rows, strict=True))]
    (folder / "runs.csv").write_text("\n".join([f"{lines[0]},surface,note", *more]) + "\n")
    said = " ".join(terrapin(capsys, "compare", folder)[1].split())
    assert "Not looked at, for text: surface (what differs between groups of runs is for [groups])." in said
    case = folder / "case.toml"
    case.write_text(case.read_text() + '\n[groups]\nsurface = { column = "surface" }\n')
    assert "Not looked at" not in terrapin(capsys, "compare", folder)[1]


def test_a_case_without_gaps_says_nothing_of_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = json.loads(terrapin(capsys, "compare", rolling(tmp_path, 1), "--json", "-")[1])
    assert "intake" not in answer


def test_every_row_with_a_gap_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 1, runs=2, rows=2)
    change(folder, {(line, 1 if line % 2 else 4): "" for line in range(2, 6)})
    status, _, err = terrapin(capsys, "compare", folder)
    assert status == 2
    one_line(err, ["runs.csv:2: column w: every row has a gap"])


@pytest.mark.parametrize(("unit", "factor"), [("1/min", 1.0), ("rpm", 1.0), ("rad/min", 0.5 / np.pi), ("1/s", 60.0)])
def test_so_many_a_minute_are_turns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str, factor: float
) -> None:
    turning = load_case(rolling(tmp_path / "rpm", 1))
    text = ROLLING.replace('unit = "rpm"', f'unit = "{unit}"')
    folder = rolling(tmp_path / "other", 1, text=text)
    case = load_case(folder)
    assert case.roles["omega"] == pytest.approx(factor * turning.roles["omega"])
    _, out, _ = terrapin(capsys, "compare", folder)
    shown = f"omega: {unit} is read as turns, so 1000 of them are {1000 * factor * np.pi / 30:.5g} rad/s"
    assert (shown in " ".join(out.split())) == unit.startswith("1/")


def test_a_limit_in_so_many_a_minute_is_turns_too(tmp_path: Path) -> None:
    text = ROLLING.replace("[data]", '[limits]\nomega = { min = 0, max = 60, unit = "1/min" }\n[data]')
    assert load_case(rolling(tmp_path, 1, text=text)).limits["omega"] == pytest.approx((0.0, 2.0 * np.pi))


def test_a_current_that_lost_its_sign_is_noticed(tmp_path: Path) -> None:
    folder = rolling(tmp_path, 1)
    assert not load_case(folder).remarks
    lines = [line.split(",") for line in (folder / "runs.csv").read_text().splitlines()]
    change(folder, {(n, 4): line[4].lstrip("-") for n, line in enumerate(lines, 1)})
    (remark,) = load_case(folder).remarks
    assert "current has one sign only although omega takes both" in remark


def bench(copies: int = 1, twice: bool = False) -> dict[str, object]:
    """Six runs on a bench; then the first `copies` - 1 of them under other names, or all rows once more."""
    draw = np.random.default_rng(3)
    run, w = np.repeat(np.arange(6), 20), draw.uniform(1.0, 9.0, 120)
    found = {"run": run, "w": w, "M": 2.0 + 0.5 * w + draw.normal(0.0, 0.1, 120)}
    again = [np.flatnonzero(run == k) for k in range(copies - 1)] + [np.arange(120)] * twice
    for k, rows in enumerate(again):
        more = {"run": np.full(len(rows), 10 + k) if not twice else run[rows], "w": w[rows], "M": found["M"][rows]}
        found = {name: np.concatenate([values, more[name]]) for name, values in found.items()}
    return dict(found)


def on_bench(columns: dict[str, object], **more: str) -> Case:
    units = {"w": "rad/s", "M": "N m", **more}
    fit = {"a": (0.0, -9.0, 9.0, "N m"), "b": (1.0, -9.0, 9.0, "N m s/rad")}
    return Case.from_table(columns, run="run", units=units, equation={"M": "a + b*w"}, fit=fit)


def test_a_run_that_comes_back_is_told() -> None:
    """Two files that each begin with run 1 are merged, and say so; rows in no order of runs say nothing."""

    def place(row: int) -> str:
        return f"rows.csv:{row + 2}"

    names = ("1", "2", "3")
    whole, twice = np.repeat([0, 1, 2], 4), np.tile(np.repeat([0, 1], 4), 2)
    assert again(whole, names, place) == []
    assert again(twice, names[:2], place) == [
        "Run 1 begins at rows.csv:2 and again at rows.csv:10, and so does 1 more: it is one run here. "
        "If these are several measurements, call them otherwise."
    ]
    (one,) = again(np.array([0, 0, 1, 1, 0, 2]), names, place)
    assert one.startswith("Run 1 begins at rows.csv:2 and again at rows.csv:6: it is one run")
    assert again(np.arange(12) % 3, names, place) == []


def test_a_run_that_was_copied_is_told() -> None:
    """All runs twice under other names: sds a million times too small, held-out errors of 12000 noise sd, no word."""
    said = on_bench(bench(copies=3)).compare().as_dict()["intake"]["remarks"]
    assert said[0].startswith(
        "The numbers of run 10 are those of run 0, row by row, and 1 more run holds copies: leave"
    )
    said = on_bench(bench(twice=True)).compare().as_dict()["intake"]["remarks"]
    assert said[0].startswith("The numbers of run 0 are its first 20 rows twice, and 5 more runs hold copies: leave")
    assert "intake" not in on_bench(bench()).compare().as_dict()
    coarse = bench()  # an instrument's steps: equal rows, of which none tells anything
    coarse |= {"w": np.ones(120), "M": np.tile([2.0, 2.5], 60)}
    assert "intake" not in on_bench(coarse).compare().as_dict()


@pytest.mark.parametrize("mapped", [True, False])
def test_a_column_that_was_computed_from_the_answer_is_told(mapped: bool) -> None:
    """k*F, found with probability 0.99 and 5e-11 noise sd left: rounded as a file has it, with a unit and without."""
    columns = bench()
    columns["F"] = np.round(np.asarray(columns["M"]) / 0.15, 3)
    (said,) = on_bench(columns, **({"F": "N"} if mapped else {})).compare().as_dict()["intake"]["remarks"]
    assert said.startswith("F is M over again, times a number")
    columns["F"] = np.asarray(columns["F"]) + np.random.default_rng(1).normal(0.0, 0.02, 120)
    assert "intake" not in on_bench(columns).compare().as_dict()


def table(folder: Path, seed: int = 1, names: str = "abcdef") -> Path:
    """A table of rolling with a run for each letter."""
    made = rolling(folder / f"made_{seed}", seed, runs=len(names), rows=8)
    text = (made / "runs.csv").read_text().splitlines()[1:]
    rows = [f"{names[int(line[1:3])]}{line[3:]}" for line in text]
    (folder / f"day_{seed}.csv").write_text(
        "run,omega_rpm,W [N],temp_degF,i_motor_mA,humidity\n" + "\n".join(rows) + "\n"
    )
    return folder / f"day_{seed}.csv"


def test_placeholders_are_marked_until_confirmed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = tmp_path / "case"
    assert terrapin(capsys, "case", table(tmp_path), "--to", case)[0] == 0
    text = (case / "case.toml").read_text()
    marked = tomllib.loads(text)["case"]["guessed"]
    assert marked == [
        f"parameters.{name}" for name in ("radius", "drive_radius", "torque_constant", "coulomb", "viscous")
    ]
    out = " ".join(terrapin(capsys, "compare", case)[1].split())
    assert "Guessed and not confirmed: parameters.radius, parameters.drive_radius" in out
    assert json.loads(terrapin(capsys, "compare", case, "--json", "-")[1])["intake"]["guessed"] == marked
    assert terrapin(capsys, "report", case, "--no-discover", "-o", tmp_path / "page.html")[0] == 0
    assert "Guessed and not confirmed: parameters.radius" in (tmp_path / "page.html").read_text()
    start = text.index("guessed = [")
    (case / "case.toml").write_text(text[:start] + text[text.index("\n", start) :])
    assert "Guessed" not in terrapin(capsys, "compare", case)[1]
    (case / "case.toml").write_text(text.replace("parameters.coulomb", "parameters.columb"))
    status, _, err = terrapin(capsys, "compare", case)
    assert status == 2
    one_line(err, ["case.guessed: parameters.columb is not there"])


def unclear(folder: Path) -> Path:
    """A table in which two columns may be the current, and the speed has no unit."""
    day = table(folder)
    lines = day.read_text().splitlines()
    head = "run,omega,W [N],temp_degF,i_left_mA,i_right_mA"
    day.write_text("\n".join([head, *lines[1:]]) + "\n")
    return day


def test_a_doubt_is_an_error_that_names_the_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    day, case = unclear(tmp_path), tmp_path / "case"
    for options, words in (
        ([], "Which column is the current? i_left_mA or i_right_mA? Say it with --column current=COLUMN"),
        (["--column", "current=i_left_mA"], "What is the unit of omega (omega)? rad/s? Say it with --unit omega=UNIT"),
        (["--column", "current=i_left"], "--column: found 'i_left', expected one of omega, W [N]"),
        (["--column", "amps=i_left_mA"], "--column: found 'amps', expected one of time, omega"),
        (["--column", "current=i_left_mA", "--unit", "omega=N"], "--unit: omega: 'N' does not convert to 'rad/s'"),
        (["--column", "current=i_left_mA", "--unit", "omega=rpm", "--unit", "slip=1"], "--unit: found slip, expected"),
    ):
        status, _, err = terrapin(capsys, "case", day, "--to", case, *options)
        assert status == 2
        one_line(err, [words])
        assert not case.exists()
    answers = ["--column", "current=i_right_mA", "--unit", "omega=rpm"]
    assert terrapin(capsys, "case", day, "--to", case, *answers)[0] == 0
    columns = tomllib.loads((case / "case.toml").read_text())["data"]["columns"]
    assert columns["current"]["column"] == "i_right_mA"
    assert columns["omega"] == {"column": "omega", "unit": "rpm"}


def test_a_doubt_is_asked_at_a_terminal(tmp_path: Path) -> None:
    day, case = unclear(tmp_path), tmp_path / "case"
    mine, theirs = pty.openpty()
    try:
        os.write(mine, b"neither\ni_right_mA\nrpm\n")
        start = "from terrapin_tools.cli import main; main()"
        command = [sys.executable, "-c", start, "case", str(day), "--to", str(case)]
        done = subprocess.run(command, stdin=theirs, stdout=subprocess.PIPE, stderr=theirs, timeout=60, check=False)
        said = os.read(mine, 4096).decode()
    finally:
        os.close(mine)
        os.close(theirs)
    assert done.returncode == 0, said
    assert said.count("Which column is the current? i_left_mA or i_right_mA") == 2
    assert "What is the unit of omega (omega)? [rad/s]" in said
    columns = tomllib.loads((case / "case.toml").read_text())["data"]["columns"]
    assert columns["current"]["column"] == "i_right_mA"
    assert columns["omega"]["unit"] == "rpm"


def test_how_a_file_is_to_be_read_is_asked_at_a_terminal(tmp_path: Path) -> None:
    """1,302 may be 1.302 or 1302: what is no answer is asked again, and the answer stands in the case."""
    (tmp_path / "a.csv").write_text("w [rpm];i [A]\n1,302;2\n1,456;3\n", encoding="ascii")
    mine, theirs = pty.openpty()
    try:
        os.write(mine, b"perhaps\ncomma\n")
        start = "from terrapin_tools.cli import main; main()"
        command = [
            sys.executable,
            "-c",
            start,
            "case",
            "table",
            str(tmp_path / "a.csv"),
            "--to",
            str(tmp_path / "case"),
        ]
        done = subprocess.run(command, stdin=theirs, stdout=subprocess.PIPE, stderr=theirs, timeout=60, check=False)
        said = os.read(mine, 4096).decode()
    finally:
        os.close(mine)
        os.close(theirs)
    assert done.returncode == 0, said
    assert said.count("which is 1.302 or 1302") == said.count("point or comma") == 2
    assert tomllib.loads((tmp_path / "case" / "case.toml").read_text())["data"]["read"] == {"decimal": "comma"}
    assert b"decimal comma ('1,302')" in done.stdout


def test_append_judges_the_old_model_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = rolling(tmp_path / "case", 1)
    rolling(tmp_path / "more", 2, runs=6, heating=0.004)
    new = tmp_path / "warm.csv"
    lines = (tmp_path / "more/runs.csv").read_text().splitlines()
    new.write_text("\n".join([lines[0], *(f"n{line[1:]}" for line in lines[1:])]) + "\n")
    before = json.loads(terrapin(capsys, "compare", case, "--json", "-")[1])
    status, out, _ = terrapin(capsys, "case", "append", case, new, "--json", "-")
    assert status == 0
    answer = json.loads(out)
    assert answer["appended"] == [f"n{i:02d}" for i in range(6)]
    f_o = before["parameters"]["f_o"]["value"]
    assert answer["before"]["heldout_error"] == before["ladder"][-1]["heldout_error"]
    # once more by hand: the old model without heating, on the new runs
    w, load, _, current = np.loadtxt(new, delimiter=",", skiprows=1, usecols=(1, 2, 3, 4)).T
    omega = w * np.pi / 30
    torque = f_o * 0.08 * load * np.sign(omega) + 0.012 * np.sign(omega) + 1e-3 * omega
    off = current / 1000 - torque * 0.018 / (0.08 * 0.1)
    assert answer["predicted"]["channels"]["current"]["rmse"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-6)
    assert answer["predicted"]["error"] == pytest.approx(np.sqrt(np.mean(off**2)) / 0.004, rel=1e-6)
    assert answer["predicted"]["runs"]["n02"] == pytest.approx(np.sqrt(np.mean(off[24:36] ** 2)) / 0.004, rel=1e-6)
    assert answer["predicted"]["error"] > 2.0 > answer["predicted"]["heldout_error"]
    assert answer["verdict"] == "missing"
    loaded = load_case(case)
    assert set(answer["appended"]) < set(loaded.run_names)
    assert "# a comment that must stay" in loaded.text
    assert terrapin(capsys, "report", case, "--no-discover", "-o", tmp_path / "page.html")[0] == 0


def test_append_says_it_in_words_and_shares_listed_runs_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ROLLING.replace('run = "run"', 'run = "run"\ntrain = ["r00", "r01", "r02"]\ntest = ["r03"]')
    case = rolling(tmp_path / "case", 1, runs=4, text=text)
    rolling(tmp_path / "more", 2, runs=5)
    new = tmp_path / "runs.csv"
    new.write_text((tmp_path / "more/runs.csv").read_text().replace("\nr", "\nn"))
    status, out, _ = terrapin(capsys, "case", "append", case, new)
    assert status == 0
    said = " ".join(out.split())
    assert "Appended 5 runs of runs.csv" in said
    assert "The model as it was predicted them to" in said
    data = tomllib.loads((case / "case.toml").read_text())["data"]
    assert data["files"] == ["runs.csv", "runs_2.csv"]
    assert data["train"] == ["r00", "r01", "r02", "n00", "n01", "n02", "n03"]
    assert data["test"] == ["r03", "n04"]
    assert (case / "runs_2.csv").read_bytes() == new.read_bytes()


def test_a_run_of_which_no_row_is_left_is_named(tmp_path: Path) -> None:
    """A sensor that was off for a whole run took the run away, and rows alone were counted."""
    folder = rolling(tmp_path / "case", 1)
    lines = (folder / "runs.csv").read_text().splitlines()
    (folder / "runs.csv").write_text("\n".join([*lines, "off,1.0,18.0,20.0,,0.5", "dead,1.0,18.0,20.0,,0.5"]) + "\n")
    (remark,) = [text for text in load_case(folder).intake if "rows left out" in text]
    assert remark.startswith("2 of ")
    assert remark.endswith("No row is left of dead, off.")


def test_append_refuses_what_does_not_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = rolling(tmp_path / "case", 1)
    other, gaps, copy = tmp_path / "other.csv", tmp_path / "gaps.csv", tmp_path / "copy.csv"
    copy.write_text((case / "runs.csv").read_text().replace("\nr", "\nn"))
    other.write_text("run,w,W,temp\nn1,1,2,3\n")
    gaps.write_text("run,w,W,temp,i,humidity\nn1,,2,3,4,5\n")
    text = (case / "case.toml").read_bytes()
    for arguments, words in (
        ([case, case / "runs.csv"], "under two names"),
        ([case, rolling(tmp_path / "again", 1) / "runs.csv"], "run 'r00' is in the case already"),
        ([case, other], "column 'i' is not in other.csv"),
        ([case, gaps], "found no row without a gap"),
        ([case, copy], "copy.csv: run 'n00' has the very numbers of 'r00', expected new ones"),
        ([case, tmp_path / "none.csv"], "no such file"),
        ([tmp_path / "none", other], "no such file"),
        ([case], "FILE"),
    ):
        status, _, err = terrapin(capsys, "case", "append", *arguments)
        assert status == 2
        one_line(err, [words])
        assert (case / "case.toml").read_bytes() == text
        assert {path.name for path in case.iterdir()} <= {"case.toml", "runs.csv", ".terrapin"}


def test_a_case_needs_its_folder(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = terrapin(capsys, "case", "day.csv")
    assert status == 2
    one_line(err, ["--to"])


@pytest.mark.parametrize("text", ["k=one", "k=1:low:2", "k=1:0:high", "k=", "k=1:0", "k", "=1", "2k=1"])
def test_a_parameter_that_is_no_number_or_has_no_name_is_refused(text: str) -> None:
    with pytest.raises(UserError, match=r"^--parameter: found .*expected .*NAME=START:MIN:MAX"):
        parse_parameter(text)


def test_a_parameter_may_have_one_bound_or_none() -> None:
    assert parse_parameter(" k =2") == ("k", OwnParameter(2.0, None, None, "1"))
    assert parse_parameter("k=2::3") == ("k", OwnParameter(2.0, None, 3.0, "1"))
    assert parse_parameter("k=2:1::N m: s") == ("k", OwnParameter(2.0, 1.0, None, "N m: s"))


def test_the_run_of_rows_is_that_of_its_column_or_of_a_whole_file() -> None:
    """A log is one run, whatever column is named."""

    def table(name: str) -> Any:
        column = ["a", "a", "b"]
        return SimpleNamespace(
            path=Path(name), rows=3, columns={"run": column}, text=lambda _: column, place=str
        )  # fmt: skip

    both: Any = [table("one.csv"), table("two.mf4")]
    tables: Any = None
    assert run_of_rows(tables, both, "run") == ["a", "a", "b", "two", "two", "two"]
    assert run_of_rows(tables, both, "") == ["one"] * 3 + ["two"] * 3
