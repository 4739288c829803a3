"""A column is named by its heading as it is written, or by its bare name, everywhere: `D [mm]` or `D`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from casekit import one_line, terrapin

import terrapin_tools as program
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case

DEPTH = np.tile(np.linspace(1.0, 30.0, 12), 4)
PRESSURE = 2.0 * DEPTH + np.random.default_rng(0).normal(0.0, 0.1, 48)
TABLE = {"lap [-]": np.repeat(["a", "b", "c", "d"], 12), "D [mm]": DEPTH, "p (kPa)": PRESSURE}
SAID: dict[str, Any] = {
    "run": "lap [-]", "columns": {"D": "D [mm]", "p": "p (kPa)"}, "equation": {"p": "k*D"}, "roles": {"D": "position"},
    "noise": {"p": 0.1}, "fit": {"k": (1.0, 0.0, 9.0, "kPa/mm")},
}  # fmt: skip


@pytest.fixture(scope="module")
def case() -> program.Case:
    return program.Case.from_table(TABLE, **SAID)


@pytest.mark.parametrize(
    "other",
    [
        {"run": "lap"},
        {"columns": {}},
        {"columns": {"D": "D", "p": "p [kPa]"}},
        {"columns": {}, "units": {"D [mm]": "mm", "p": "kPa"}},
        {"columns": {}, "equation": {"p (kPa)": "k*D"}, "roles": {"D [mm]": "position"}, "noise": {"p (kPa)": 0.1}},
    ],
)
def test_a_table_is_the_same_case_by_either(case: program.Case, other: dict[str, Any]) -> None:
    found = program.Case.from_table(TABLE, **SAID | other)
    assert tomllib.loads(found.text) == tomllib.loads(case.text)


def test_what_no_heading_is_called_is_refused_with_the_headings() -> None:
    for other in ({"columns": {"D": "D [cm]"}}, {"columns": {"D": "d"}}, {"run": "lap [s]"}, {"units": {"q": "mm"}}):
        with pytest.raises(UserError, match=r"found .*expected one of .*D \[mm\]"):
            program.Case.from_table(TABLE, **SAID | other)
    twice = {**TABLE, "D [cm]": 0.1 * DEPTH}
    with pytest.raises(UserError, match=r"found 'D', expected one of .*D \[mm\], .*D \[cm\]"):
        program.Case.from_table(twice, **SAID | {"columns": {"D": "D", "p": "p"}})


def test_another_base_takes_its_roles_by_their_bare_names() -> None:
    table = {"run": TABLE["lap [-]"], "omega [rpm]": DEPTH, "current [mA]": PRESSURE, "load [N]": DEPTH}
    said: dict[str, Any] = {"base": "rolling_steady", "run": "run", "fit": {"f_o": (0.05, 0.0, 0.5)}}
    said["constants"] = {"radius": 0.08, "drive_radius": 0.018, "torque_constant": 0.1, "load": 18.6, "coulomb": 0.012}
    said["constants"]["viscous"] = 1e-3
    found = program.Case.from_table(table, units={"omega": "rpm", "current": "mA"}, **said)
    assert list(tomllib.loads(found.text)["data"]["columns"]) == ["omega", "current"]


@pytest.mark.parametrize(
    ("name", "factor"), [("D [mm]", 1.0), ("D", 1.0), ("D (mm)", 1.0), ("D [cm]", 0.1), ("D [m]", 1e-3)]
)
def test_new_rows_are_predicted_by_either(case: program.Case, name: str, factor: float) -> None:
    said = case.predict({name: factor * np.array([5.0, 20.0])})
    assert said["p"].to_numpy() == pytest.approx([10.0, 40.0], rel=0.01)


def test_new_rows_in_another_kind_of_unit_are_refused(case: program.Case) -> None:
    with pytest.raises(UserError, match=r"column D \[s\].*'s' does not convert to 'mm'"):
        case.predict({"D [s]": np.array([5.0])})
    with pytest.raises(UserError, match=r"column D \[mm\]: is missing"):
        case.predict({"E [mm]": np.array([5.0])})


ROWS = [f"{'abcd'[i // 12]},{d:.6g},{p:.6g},{i % 5}" for i, (d, p) in enumerate(zip(DEPTH, PRESSURE, strict=True))]
DOCUMENT = """
[case]
title = "plates"
[model]
base = "equation"
[model.equation]
p = "k*D"
[fit]
k = { value = 1.0 }
[data]
files = ["a.csv"]
run = "lap"
ignore = ["note"]
[data.columns]
D = { column = "D", unit = "mm" }
p = { column = "p [kPa]", unit = "kPa" }
"""


def write(folder: Path, heads: str = "lap [-],D [mm],p (kPa),note [V]", document: str = DOCUMENT) -> Case:
    folder.mkdir(exist_ok=True)
    (folder / "a.csv").write_text("\n".join([heads, *ROWS]) + "\n")
    (folder / "case.toml").write_text(document)
    return load_case(folder)


def test_case_toml_names_columns_by_either(tmp_path: Path) -> None:
    found = write(tmp_path)
    assert found.run_names == ("a", "b", "c", "d")
    assert found.roles["D"] == pytest.approx(DEPTH, rel=1e-5)
    assert not found.extra
    assert write(tmp_path, "lap,D,p,note").channels["p"] == pytest.approx(PRESSURE, rel=1e-5)
    grouped = DOCUMENT.replace('files = ["a.csv"]', 'files = ["a.csv"]\ntest = []')
    grouped += '[groups]\nsoil = { column = "lap" }\n'
    assert write(tmp_path, document=grouped).groups["soil"].names == ("a", "b", "c", "d")


def test_a_derived_column_is_not_a_heading_of_the_file(tmp_path: Path) -> None:
    text = DOCUMENT.replace('D = { column = "D"', 'D = { column = "depth"') + (
        '[data.derived]\ndepth = { formula = "2*d", with = { d = { column = "D", unit = "mm" } }, unit = "mm" }\n'
    )
    assert write(tmp_path, document=text).roles["D"] == pytest.approx(2 * DEPTH, rel=1e-5)
    heads = "lap [-],D [mm],p (kPa),depth [s]"
    text = text.replace('"note"', '"depth [s]"')
    assert write(tmp_path, heads, text).roles["D"] == pytest.approx(2 * DEPTH, rel=1e-5)


def test_one_name_for_two_units_is_refused(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "b.csv").write_text("\n".join(["lap [-],D [cm],p (kPa),note [V]", *ROWS]) + "\n")
    (tmp_path / "case.toml").write_text(DOCUMENT.replace('["a.csv"]', '["a.csv", "b.csv"]'))
    with pytest.raises(UserError, match=r"column 'D' is in mm in a.csv and in cm in b.csv, expected one unit"):
        load_case(tmp_path)


def test_the_options_of_case_take_either(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["lap [-],i_left [mA],i_right [mA],w [rad/s]", *ROWS]) + "\n")
    for number, said in enumerate(("i_left", "i_left [mA]", "i_left (mA)")):
        made = tmp_path / f"case_{number}"
        words = ["--column", f"current={said}", "--read", "runs=column:lap", "--to", made]
        assert terrapin(capsys, "case", "table", path, *words)[0] == 0
        told = tomllib.loads((made / "case.toml").read_text())["data"]
        assert told["columns"]["current"]["column"] == "i_left [mA]"
        assert told["run"] == "lap [-]"
        assert len(load_case(made).run_names) == 4
    assert terrapin(capsys, "look", path, "--read", "runs=trigger:w")[0] == 0
    words = ["--base", "equation", "--run", "lap", "--column", "w=w", "--unit", "w=rad/s", "--column", "i=i_left"]
    words += ["--unit", "i=mA", "--equation", "i=k*w", "--fit", "k=1"]
    assert terrapin(capsys, "case", "map", path, *words, "--to", tmp_path / "mapped")[0] == 0
    status, _, err = terrapin(capsys, "case", "table", path, "--column", "current=i_left [A]", "--to", tmp_path / "no")
    assert status == 2
    one_line(err, ["--column: found 'i_left [A]', expected one of", "i_left [mA]"])


def test_merging_takes_either(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = 0.02 * np.arange(1500)
    wander = np.cumsum(np.random.default_rng(3).normal(0.0, 1.0, 1500))
    first, second = tmp_path / "rig.csv", tmp_path / "drive.csv"
    lines = ["stamp [s],speed [rad/s]", *(f"{t:.3f},{v:.6g}" for t, v in zip(time, wander, strict=True))]
    first.write_text("\n".join(lines) + "\n")
    lines = ["stamp [s],w [rpm],n [-]", *(f"{t + 1:.3f},{v:.6g},{t:.3f}" for t, v in zip(time, wander, strict=True))]
    second.write_text("\n".join(lines) + "\n")
    words = [first, second, "--match", "speed=w", "--time", "stamp=stamp [s]", "--hold", "n"]
    status, out, err = terrapin(capsys, "case", "merge", *words, "--to", tmp_path / "merged.csv")
    assert (status, err) == (0, "")
    assert "by correlation of speed [rad/s] and w [rpm]" in out
    assert "held: n [-]" in out
