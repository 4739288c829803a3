"""A case from tables: what is guessed from the columns' names, and that a guess is never more than that."""

from __future__ import annotations

import signal
import tomllib
from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, rolling, terrapin

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.new_case.from_tables import guess_columns, split_unit


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("w_shell [rad/s]", "w_shell", "rad/s"),
        ("i_motor_mA", "i_motor", "mA"),
        ("Fz (N)", "Fz", "N"),
        ("slip [-]", "slip", "1"),
        ("torque [Nm]", "torque", "N m"),
        ("travel_speed_mm_s", "travel_speed", "mm/s"),
        ("T_winding_degC", "T_winding", "degC"),
        ("voltage", "voltage", ""),
        ("note [see page 3]", "note [see page 3]", ""),
        ("v", "v", ""),
    ],
)
def test_units_in_names(column: str, name: str, unit: str) -> None:
    assert split_unit(column) == (name, unit)


def test_roles_are_guessed_by_words_and_never_against_the_unit() -> None:
    names = ["clock_s", "slip_angle_deg", "slip", "travel_speed_mm_s", "rim_speed_mm_s", "drawbar_N", "load_N",
             "sinkage_mm", "winding [degC]", "room [degC]", "current [rad/s]", "humidity"]  # fmt: skip
    found = {guess.column: guess.name for guess in guess_columns(names)}
    assert found == {
        "clock_s": "time", "slip_angle_deg": None, "slip": "slip", "travel_speed_mm_s": "speed",
        "rim_speed_mm_s": None, "drawbar_N": "traction", "load_N": "load", "sinkage_mm": "sinkage",
        "winding [degC]": "temperature", "room [degC]": None, "current [rad/s]": None, "humidity": None,
    }  # fmt: skip


HEADINGS = "Versuch;Drehzahl [1/min];\u00d6ltemperatur [\u00b0C];Verlust\u00b2 [Nm];\u03b1 [deg];lambda [1]\n"


def bench(file: Path) -> Path:
    """Losses that fall with the oil's temperature, as a German laboratory writes them."""
    rng = np.random.default_rng(7)
    lines = []
    for run in range(24):
        speed, oil = rng.uniform(10.0, 90.0, 2)
        for _ in range(6):
            drag = 4.0 + 0.02 * speed - 0.03 * oil + rng.normal(0.0, 0.02)
            lines.append(f"V{run};{speed:.2f};{oil:.2f};{drag:.3f};{rng.normal():.3f};{rng.normal():.3f}\n")
    file.write_text(HEADINGS + "".join(lines).replace(".", ","), "utf-8")
    return file


def test_headings_of_any_alphabet_get_names_that_formulas_can_use(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = tmp_path / "case"
    status, _, err = terrapin(capsys, "case", "table", bench(tmp_path / "bench.csv"), "--to", case)
    assert (status, err) == (0, "")
    columns = tomllib.loads((case / "case.toml").read_text("utf-8"))["data"]["columns"]
    assert {name: entry["column"] for name, entry in columns.items()} == {
        "drehzahl": "Drehzahl [1/min]",
        "oeltemperatur": "\u00d6ltemperatur [\u00b0C]",
        "verlust2": "Verlust\u00b2 [Nm]",
        "alpha": "\u03b1 [deg]",
        "c_lambda": "lambda [1]",
    }
    text = (case / "case.toml").read_text("utf-8")
    (case / "case.toml").write_text(text.replace("\noeltemperatur", '\n"\u00f6ltemperatur"'), "utf-8")
    status, _, err = terrapin(capsys, "discover", case)
    assert status == 2
    one_line(err, ["data.columns.\u00f6ltemperatur: found a name that formulas cannot use, expected letters a to z"])


@pytest.mark.parametrize(("run", "told"), [("r1", True), ("r2", False)])
def test_a_jump_of_the_time_is_told_within_a_run_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], run: str, told: bool
) -> None:
    lines = [f"{'r1' if i < 30 else run},{i + (500 if i >= 30 else 0)},{i % 7},{i % 5}" for i in range(60)]
    (tmp_path / "t.csv").write_text("run,time_s,speed_m_s,force_N\n" + "\n".join(lines) + "\n")
    status, out, err = terrapin(capsys, "case", "table", tmp_path / "t.csv", "--to", tmp_path / "case")
    assert (status, err) == (0, "")
    assert ("t.csv:32: time_s jumps by 501: several runs? --read runs=gap parts them." in out) == told


def test_a_column_whose_name_no_formula_can_use_is_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Unmapped, under a heading without a unit: the answer names the column instead of ending."""
    file = bench(tmp_path / "bench.csv")
    file.write_text(file.read_text("utf-8").replace(" [\u00b0C]", ""), "utf-8")
    (tmp_path / "case.toml").write_text('''
[model]
base = "equation"
[model.equation]
loss = "a + b*speed"
[fit]
a = { value = 1.0, unit = "N m" }
b = { value = 0.01, unit = "N m s" }
[data]
files = ["bench.csv"]
run = "Versuch"
ignore = ["\u03b1", "lambda"]
[data.columns]
speed = { column = "Drehzahl", unit = "1/s" }
loss = { column = "Verlust\u00b2", unit = "N m", sigma = 0.02 }
''', "utf-8")  # fmt: skip
    status, out, err = terrapin(capsys, "discover", tmp_path)
    assert (status, err) == (0, "")
    said = " ".join(out.split())
    assert "depends on \u00d6ltemperatur, and no formula was tried in it, as its heading is no name for one" in said
    assert "Next: Map \u00d6ltemperatur under a name of letters a to z, digits and _, and look again" in said


def test_case_of_a_table_loads_after_the_guess(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "made", 41, runs=6, rows=5)
    table = tmp_path / "day.csv"
    head, rows = (folder / "runs.csv").read_text().split("\n", 1)
    assert head == "run,w,W,temp,i,humidity"
    table.write_text("run,omega_rpm,W [N],temp_degF,i_motor_mA,u_V,swing_deg,humidity,who\n" + "\n".join(
        ",".join([*row.split(",")[:5], "6", "9", row.split(",")[5], "me"]) for row in rows.split()
    ) + "\n")  # fmt: skip
    case = tmp_path / "case"
    status, out, err = terrapin(capsys, "case", table, "--to", case)
    assert (status, err) == (0, "")
    assert "rolling_steady, 6 runs" in out
    assert "Not numbers: who" in out
    text = (case / "case.toml").read_text()
    assert tomllib.loads(text)["data"]["columns"] == {
        "omega": {"column": "omega_rpm", "unit": "rpm"}, "load": {"column": "W [N]", "unit": "N"},
        "temperature": {"column": "temp_degF", "unit": "degF"}, "current": {"column": "i_motor_mA", "unit": "mA"},
    }  # fmt: skip
    assert "# u_V: left out" in text
    assert "# swing_deg: left out: it follows from the torque" in text
    loaded = load_case(case)
    made = load_case(folder)
    for name, values in made.roles.items():
        assert loaded.roles[name] == pytest.approx(values, rel=1e-9)
    assert loaded.channels["current"] == pytest.approx(made.channels["current"], rel=1e-9)
    before = (case / "case.toml").read_bytes()
    status, _, err = terrapin(capsys, "case", table, "--to", case)
    assert status == 2
    one_line(err, ["case.toml", "exists"])
    assert (case / "case.toml").read_bytes() == before


def test_a_table_of_something_else_becomes_an_equation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "pump.csv"
    lines = ["terrain,run,t_s,oil_temp_C,flow [l/min],dp_kPa"]
    lines += [f"{t},{r},{f},{20 + r},{f},{3.0 * f + r}" for t in ("sand", "clay") for r in range(6) for f in (1, 2, 4)]
    table.write_text("\n".join(lines) + "\n")
    status, out, _ = terrapin(capsys, "case", table, "--to", tmp_path / "case", "--title", 'A "pump"')
    assert status == 0
    assert "flow [l/min] = flow, l/min" in out
    assert "oil_temp_C = oil_temp, degC\n" in out
    assert "terrain differs within a run" in out
    loaded = load_case(tmp_path / "case")
    assert loaded.title == 'A "pump"'
    assert list(loaded.channels) == ["dp"]
    assert 'dp = "offset + gradient*oil_temp"' in loaded.text, "a line over time says nothing"
    assert terrapin(capsys, "compare", tmp_path / "case")[0] == 0
    status, _, err = terrapin(capsys, "compare", table)
    assert status == 2
    one_line(err, ["pump.csv: is a file", "terrapin case table"])


@pytest.mark.parametrize("time", ["t", "Zeit", "elapsed [s]", "Elapsed time (s)", "Uhrzeit", "time_ms"])
@pytest.mark.parametrize("last", [True, False])
def test_time_is_never_what_is_predicted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], time: str, last: bool
) -> None:
    table = tmp_path / "rig.csv"
    names, rows = ["voltage", "speed", "current"], [[i % 7, 5 * i % 11, 3 * i % 13, 0.1 * i] for i in range(40)]
    order = [0, 1, 2, 3] if last else [3, 0, 1, 2]
    lines = [[*names, time], *rows]
    table.write_text("\n".join(",".join(str(line[i]) for i in order) for line in lines) + "\n")
    status, _, err = terrapin(capsys, "case", table, "--to", tmp_path / "case")
    assert (status, err) == (0, "")
    told = tomllib.loads((tmp_path / "case/case.toml").read_text())
    assert told["model"]["equation"] == {"current": "offset + gradient*voltage"}
    assert told["case"]["guessed"] == ["model.equation.current"]


def test_a_second_clock_is_not_predicted_either_and_times_alone_make_no_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "rig.csv"
    table.write_text("t,force,Zeit [ms]\n" + "".join(f"{i},{i * i % 7},{1000 * i}\n" for i in range(20)))
    assert terrapin(capsys, "case", table, "--to", tmp_path / "case")[0] == 0
    told = tomllib.loads((tmp_path / "case/case.toml").read_text())
    assert told["model"]["equation"] == {"force": "offset + gradient*t"}, "nothing else is there"
    assert told["data"]["columns"]["time"] == {"column": "Zeit [ms]", "unit": "ms"}
    table.write_text("t,Zeit [ms]\n" + "".join(f"{i},{1000 * i}\n" for i in range(20)))
    status, _, err = terrapin(capsys, "case", table, "--to", tmp_path / "none")
    assert status == 2
    one_line(err, ["found times only (t, Zeit [ms])", "expected a column that is predicted"])
    assert not (tmp_path / "none").exists()


def test_a_column_with_a_gap_is_mapped_and_the_gap_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "gaps.csv"
    lines = ["run,clock,x,y"] + [f"{i % 3},12:00:{i:02d},{i},{'' if i == 7 else 2 * i}" for i in range(30)]
    table.write_text("\n".join(lines) + "\n")
    status, out, _ = terrapin(capsys, "case", table, "--to", tmp_path / "case")
    assert status == 0
    assert "  clock as time: [s] since 12:00:00\n" in out
    assert "clock [s] = time, s\n" in out
    assert "Not numbers" not in out
    assert "y = y" in out
    assert "Rows with a gap in a mapped column will be left out: y 1." in out
    assert "named alike" not in out
    assert load_case(tmp_path / "case").rows == 29


def test_of_many_columns_with_text_the_first_ones_say_where(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "log.csv"
    table.write_text("time,a,b,c,d,e,f\n0,1,x,x,x,x,x\n" + "".join(f"{i},1,2,3,4,5,6\n" for i in range(1, 9)))
    status, out, _ = terrapin(capsys, "case", table, "--to", tmp_path / "case")
    assert status == 0
    assert out.count("log.csv:2") == 3
    assert "Left out, too, for text between numbers: e, f\n" in out
    assert "The one run is trained on" in out
    status, out, _ = terrapin(capsys, "compare", tmp_path / "case")
    assert status == 0
    assert "1 run, 0 held out" in out


def test_of_two_files_both_are_trained_on_and_one_alone_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each at a temperature of its own: what differs between them was never seen by the fit, and its noise was 10 x."""
    random = np.random.default_rng(5)
    for name, warm in (("cold", 20.0), ("hot", 65.0)):
        w = np.linspace(5.0, 60.0, 40)
        torque = 0.02 + 4e-4 * w * (1.0 - 0.008 * (warm - 25.0)) + 3e-4 * random.standard_normal(40)
        rows = "".join(f"{a:.4f},{warm},{b:.6f}\n" for a, b in zip(w, torque, strict=True))
        (tmp_path / f"{name}.csv").write_text("speed [rad/s],temperature [degC],torque [N m]\n" + rows)
    folder = tmp_path / "case"
    status, out, _ = terrapin(capsys, "case", tmp_path / "cold.csv", tmp_path / "hot.csv", "--to", folder)
    assert (status, "Both runs are trained on" in out) == (0, True)
    text = (folder / "case.toml").read_text()
    assert 'train = ["cold", "hot"]' in text
    _, out, _ = terrapin(capsys, "compare", folder)
    assert ("2 runs, 0 held out" in out, "is trained on:" in out) == (True, False)
    (folder / "case.toml").write_text(text.replace("\ntrain = ", "\n# "))
    _, out, _ = terrapin(capsys, "compare", folder)
    assert "2 runs, 1 held out" in out
    assert "Only cold is trained on" in out


def test_tables_that_cannot_be_a_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words, other, bare, names = (tmp_path / f"{name}.csv" for name in ("words", "other", "bare", "names"))
    empty = tmp_path / "empty"
    empty.mkdir()
    bare.write_text("1,0.5,-3e2\n2,0.7,1\n")
    names.write_text("a,b\n")
    words.write_text("a,b\nx,y\nz,w\n")
    other.write_text("c\n1\n2\n")
    for arguments, expected in (
        ([words], "no column of numbers (words.csv:2: column a: found text 'x', expected a number)"),
        ([bare], "bare.csv:1: found numbers only, expected a line of column names"),
        ([names], "names.csv: found no row"),
        ([words, other], "no column in common"),
        ([tmp_path / "none.csv"], "none.csv"),
        ([other, empty], "empty: found no table in the folder"),
        ([other, "--after", "3"], "--after"),
    ):
        status, _, err = terrapin(capsys, "case", *arguments, "--to", tmp_path / "case")
        assert status == 2
        one_line(err, [expected])
        assert not (tmp_path / "case").exists()


def test_an_interruption_while_text_is_read_as_numbers_is_not_lost() -> None:
    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    def read_for_long(seconds: float) -> None:
        signal.setitimer(signal.ITIMER_REAL, seconds)
        for _ in range(100):  # far longer than the alarm takes
            table.numbers("u")

    table = Table(Path("a.csv"), {"u": np.array(["0.25"] * 20_000)}, 2)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for i in range(20):
            with pytest.raises(KeyboardInterrupt):
                read_for_long(0.001 + 0.0007 * i)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
