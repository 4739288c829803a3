"""Reading cases: units, runs, files of every kind, and one clear line for everything that can be wrong."""

from __future__ import annotations

import doctest
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from casekit import ROLLING, rolling, terrapin

from terrapin_hil import reading
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds import names
from terrapin_tools.workbench.case import changes
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.files import format, times, units
from terrapin_tools.workbench.story import notes


def test_docstring_examples() -> None:
    for module in (reading, format, times, units, changes, names, notes):
        assert doctest.testmod(module).failed == 0


def test_everything_arrives_in_canonical_units(tmp_path: Path) -> None:
    case = load_case(rolling(tmp_path, 1))
    raw = np.genfromtxt(tmp_path / "runs.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    np.testing.assert_allclose(case.roles["omega"], raw["w"] * np.pi / 30, rtol=1e-12)
    np.testing.assert_allclose(case.roles["temperature"], (raw["temp"] - 32) / 1.8, rtol=1e-9)
    np.testing.assert_allclose(case.channels["current"], raw["i"] / 1000, rtol=1e-12)
    assert case.sigma == {"current": pytest.approx(0.004)}
    assert case.parameters["radius"] == pytest.approx(0.08)
    assert case.parameters["coulomb"] == pytest.approx(0.012)
    assert list(case.extra) == ["humidity"]
    assert case.place(0) == "runs.csv:2"
    assert case.place(119) == "runs.csv:121"


def test_columns_can_be_ignored(tmp_path: Path) -> None:
    text = ROLLING.replace('run = "run"', 'run = "run"\nignore = ["humidity"]')
    assert list(load_case(rolling(tmp_path, 1, text=text)).extra) == []
    for name, why in (("w", "is mapped"), ("dust", "is not in the files")):
        wrong = text.replace('ignore = ["humidity"]', f'ignore = ["{name}"]')
        with pytest.raises(UserError, match=rf"case.toml:\d+: data.ignore: column '{name}' {why}, expected one of "):
            load_case(rolling(tmp_path / name, 1, text=wrong))


def test_a_column_that_one_file_alone_has_is_not_looked_at(tmp_path: Path) -> None:
    text = ROLLING.replace('files = ["runs.csv"]', 'files = ["runs.csv", "more.csv"]')
    case = rolling(tmp_path, 1, text=text)
    head, _, rows = (case / "runs.csv").read_text().partition("\n")
    for kept in ("runs.csv", "more.csv"):
        other = "runs.csv" if kept == "more.csv" else "more.csv"
        (case / kept).write_text(f"{head}\n{rows}")
        (case / other).write_text(f"{head.replace('humidity', 'other')}\n{rows}")
        assert load_case(case).extra == {}
        assert load_case(case).rows == 2 * 120


def test_an_effect_of_ones_own_is_written_with_its_bounds_and_units() -> None:
    """The bounds are what the user knows of a parameter: without them a fit would leave what is possible."""
    parameters = {
        "k": changes.OwnParameter(0.5, 0.0, 2.0, "N m"),
        "c": changes.OwnParameter(1.0, minimum=-1.0),
        "d": changes.OwnParameter(3.0, maximum=0.0),
    }
    own = {
        "drag": changes.OwnEffect("k * tanh(c * omega) + d", "torque", parameters),
        "plain": changes.OwnEffect("0*omega", None),
    }
    text = changes.add_effects(ROLLING, ["drag", "plain"], own)
    written = tomllib.loads(text)
    assert written["model"]["effects"] == ["drag", "plain"]
    assert written["effect"] == {
        "drag": {
            "expression": "k * tanh(c * omega) + d",
            "target": "torque",
            "k": {"value": 0.5, "min": 0.0, "max": 2.0, "unit": "N m"},
            "c": {"value": 1.0, "min": -1.0},
            "d": {"value": 3.0, "max": 0.0},
        },
        "plain": {"expression": "0*omega"},
    }
    assert all(line in text for line in ROLLING.splitlines() if "#" in line and "effects" not in line)


def test_every_fifth_run_is_held_out_unless_the_case_says_otherwise(tmp_path: Path) -> None:
    case = load_case(rolling(tmp_path, 1, runs=11))
    assert {case.run_names[i] for i in case.run[case.test]} == {"r04", "r09"}
    assert not (case.train & case.test).any()
    few = load_case(rolling(tmp_path / "few", 1, runs=3))
    assert {few.run_names[i] for i in few.run[few.test]} == {"r02"}
    chosen = ROLLING.replace('run = "run"', 'run = "run"\ntrain = ["r00", "r01"]\ntest = ["r03"]')
    case = load_case(rolling(tmp_path / "chosen", 1, text=chosen))
    assert {case.run_names[i] for i in case.run[case.train]} == {"r00", "r01"}
    assert {case.run_names[i] for i in case.run[case.test]} == {"r03"}


def test_several_files_and_parquet(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    folder = rolling(tmp_path, 1, runs=4)
    whole = load_case(folder)
    lines = (folder / "runs.csv").read_text().splitlines()
    (folder / "a.csv").write_text("\n".join(lines[:20]) + "\n")
    rest = [line.split(",") for line in lines[20:]]
    names = lines[0].split(",")
    table = {n: [r[i] if n == "run" else float(r[i]) for r in rest] for i, n in enumerate(names)}
    pyarrow.parquet.write_table(pyarrow.table(table), folder / "b.parquet")
    (folder / "case.toml").write_text(ROLLING.replace('["runs.csv"]', '["a.csv", "b.parquet"]'))
    split = load_case(folder)
    assert split.run_names == whole.run_names
    np.testing.assert_allclose(split.channels["current"], whole.channels["current"])
    assert split.place(19) == "b.parquet: row 1"


DBC = """VERSION "1"
NS_ :
BS_:
BU_: A
BO_ 16 MOTION: 8 A
 SG_ omega : 0|16@1- (0.001,0) [-32|32] "rad/s" A
BO_ 17 MOTOR: 8 A
 SG_ current : 0|16@1- (0.1,0) [-3000|3000] "mA" A
 SG_ load : 16|16@1- (0.01,0) [0|300] "N" A
"""


def _log_case(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    for name, speed in (("slow", 2000), ("fast", 5000)):
        frames = [(0.000, 0x10, speed.to_bytes(2, "little")), (0.015, 0x11, b"\x10\x27\x40\x06")]
        frames += [
            (0.031, 0x10, (speed + 7).to_bytes(2, "little")),
            (0.032, 0x55, b"\1"),
            (0.050, 0x11, b"\x11\x27\x41\x06"),
        ]
        text = "".join(f"({100 + t:.6f}) can0 {i:03X}#{d.hex().upper()}\n" for t, i, d in frames)
        (folder / f"{name}.log").write_text(text)
    (folder / "x.dbc").write_text(DBC)
    head, _, _ = ROLLING.partition("[data]")
    (folder / "case.toml").write_text(
        head
        + '[data]\nfiles = ["slow.log", "fast.log"]\ndbc = "x.dbc"\nperiod = "10 ms"\n[data.columns]\n'
        + 'omega = { column = "MOTION.omega", unit = "rad/s" }\nload = { column = "MOTOR.load", unit = "N" }\n'
        + 'time = { column = "time", unit = "s" }\ncurrent = { column = "MOTOR.current", unit = "mA", sigma = 1 }\n'
    )
    return folder


def test_logs_are_sampled_on_a_grid_with_the_last_value_held(tmp_path: Path) -> None:
    case = load_case(_log_case(tmp_path))
    assert case.run_names == ("fast", "slow")
    slow = case.run == 1
    np.testing.assert_allclose(case.roles["time"][slow], [0.02, 0.03, 0.04, 0.05])
    np.testing.assert_allclose(case.roles["omega"][slow], [2.0, 2.0, 2.007, 2.007])
    np.testing.assert_allclose(case.channels["current"][slow], [1.0, 1.0, 1.0, 1.0001])


def _text(old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / "case.toml").read_text()
        assert old in text
        (folder / "case.toml").write_text(text.replace(old, new))

    return change


def _cell(line: int, column: int, value: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        lines = (folder / "runs.csv").read_text().splitlines()
        cells = lines[line - 1].split(",")
        cells[column] = value
        lines[line - 1] = ",".join(cells)
        (folder / "runs.csv").write_text("\n".join(lines) + "\n")

    return change


def _file(name: str, content: bytes | None) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        if content is None:
            (folder / name).unlink()
        else:
            (folder / name).write_bytes(content)

    return change


SPLIT = 'run = "run"'
WRONG = [
    (_file("case.toml", None), ["case.toml", "no such file"]),
    (_file("case.toml", b"\xff\xfe"), ["case.toml", "UTF-8"]),
    (_text("[case]", "[case"), ["case.toml", "not TOML"]),
    (
        _text('base = "rolling_steady"', 'base = "rolling"'),
        ["case.toml:6", "model.base", "'rolling'", "rolling_steady"],
    ),
    (_text("effects = []", 'effects = ["warp"]'), ["case.toml:7", "model.effects", "warp", "motor_heating"]),
    (_text("effects = []", 'effects = ["bulldozing"]'), ["case.toml:7", "bulldozing", "sphere_contact"]),
    (_text("effects = []", 'effects = ["slope"]'), ["case.toml:7", "needs the role slope"]),
    (_text("effects = []", 'effects = ["motor_heating", "motor_heating"]'), ["case.toml:7", "twice"]),
    (_text("effects = []", "effects = 3"), ["case.toml:7", "list of names"]),
    (_text('radius = "80 mm"', 'radius = "80 kg"'), ["case.toml:10", "parameters.radius", "'kg'", "'m'"]),
    (_text('radius = "80 mm"', 'radius = "eighty mm"'), ["case.toml:10", "eighty"]),
    (_text('radius = "80 mm"', "radius = true"), ["case.toml:10", "True"]),
    (_text('radius = "80 mm"', "radius = -1"), ["case.toml:10", "more than 0"]),
    (_text('radius = "80 mm"', "radius = inf"), ["case.toml:10", "finite"]),
    (_text('radius = "80 mm"\n', ""), ["case.toml:9", "radius is missing"]),
    (
        _text('radius = "80 mm"', 'radius = "80 mm"\ndensity = 3'),
        ["case.toml:11", "parameters.density", "unknown name"],
    ),
    (_text("min = 0.0", "min = 0.2"), ["case.toml:17", "fit.f_o", "0.05", "between min 0.2"]),
    (_text("max = 0.5", "max = -0.5"), ["case.toml:17", "min below max"]),
    (_text("value = 0.05", 'value = "x"'), ["case.toml:17", "fit.f_o.value"]),
    (_text("value = 0.05, ", ""), ["case.toml:17", "start value"]),
    (_text("max = 0.5", "top = 0.5"), ["case.toml:17", "fit.f_o.top", "unknown name"]),
    (_text("f_o = {", "f_p = {"), ["case.toml:17", "fit.f_p", "unknown name"]),
    (_text("f_o = {", "radius = {"), ["case.toml:17", "fit.radius", "[parameters] too"]),
    (_text('files = ["runs.csv"]', 'files = ["run.csv"]'), ["run.csv", "no such file"]),
    (_text('files = ["runs.csv"]', 'files = ["runs.xls"]'), ["runs.xls", "no such file"]),
    (_text('files = ["runs.csv"]', "files = []"), ["case.toml:20", "data.files", "file names"]),
    (_text('files = ["runs.csv"]', 'files = ["case.toml"]'), ["case.toml", "unknown kind of file"]),
    (_text(SPLIT, 'run = "ran"'), ["case.toml:21", "data.run", "'ran'", "humidity"]),
    (_text(SPLIT, SPLIT + '\ntrain = ["r77"]'), ["case.toml:22", "data.train", "'r77'"]),
    (_text(SPLIT, SPLIT + "\ntrain = []"), ["case.toml:22", "data.train", "at least one run"]),
    (
        _text(SPLIT, SPLIT + '\ntrain = ["r01"]\ntest = ["r01"]'),
        ["case.toml:23", "data.test", "r01", "in train and in test"],
    ),
    (_text('column = "w"', 'column = "q"'), ["case.toml:24", "data.columns.omega.column", "'q'", "runs.csv"]),
    (
        _text('column = "W"', 'column = "w"'),
        ["case.toml:25", "data.columns.load.column", "is mapped as omega in rpm too"],
    ),
    (
        _text('unit = "rpm"', 'unit = "kg"'),
        ["case.toml:24", "data.columns.omega.unit", "found 'kg', which does not convert to 'rad/s'"],
    ),
    (_text('unit = "rpm"', 'unit = "wobbles"'), ["case.toml:24", "wobbles"]),
    (
        _text("[data.columns]\n", '[data.columns]\ndrive_torque = { column = "humidity", unit = "Nm" }\n'),
        ["data.columns.drive_torque.unit", "'Nm', which does not convert to 'N m' (is 'N m' meant?)"],
    ),
    (_text(', unit = "rpm"', ""), ["case.toml:24", "data.columns.omega.unit", "missing"]),
    (_text("omega = {", "omegga = {"), ["case.toml:24", "data.columns.omegga", "unknown role"]),
    (_text('omega = { column = "w", unit = "rpm" }\n', ""), ["case.toml:23", "omega is not mapped"]),
    (_text('current = { column = "i", unit = "mA", sigma = 4.0 }\n', ""), ["case.toml:23", "no channel"]),
    (_text("sigma = 4.0", "sigma = 0.0"), ["case.toml:27", "sigma", "more than 0"]),
    (_text('unit = "N" }', 'unit = "N", sigma = 1 }'), ["case.toml:25", "data.columns.load.sigma", "unknown name"]),
    (_text("[data]", "[dada]\n[data]"), ["case.toml:19", "dada", "unknown name"]),
    (_cell(7, 1, "fast"), ["runs.csv:7", "column w", "'fast'", "number"]),
    (_cell(9, 4, "1e999"), ["runs.csv:9", "column i", "infinity"]),
    (_cell(4, 0, ""), ["runs.csv:4", "column run"]),
    (_cell(5, 0, "r00,3"), ["runs.csv:5", "7 fields", "6"]),
    (_cell(1, 1, "W"), ["case.toml:24", "column 'w' is not in runs.csv", "run, W, W 2, temp"]),
    (_file("runs.csv", b""), ["runs.csv:1", "column names"]),
    (_file("runs.csv", b"run,w,W,temp,i,humidity\n"), ["case.toml:20", "no rows"]),
    (_file("runs.csv", b"run,w\xff\n"), ["case.toml:24", "column 'w' is not in runs.csv", "one of run, w\u00ff\n"]),
    (_file("runs.csv", b"run,w\x81\n"), ["runs.csv", "UTF-8"]),
]


@pytest.mark.parametrize(("change", "expected"), WRONG, ids=range(len(WRONG)))
def test_wrong_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Callable[[Path], None], expected: list[str]
) -> None:
    folder = rolling(tmp_path / "case", 1, runs=4, rows=4)
    change(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    status, out, err = terrapin(capsys, "compare", folder, "--json", tmp_path / "answer.json")
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1, err
    assert err.startswith("terrapin: ")
    for text in expected:
        assert text in err, err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert not (tmp_path / "answer.json").exists()


def test_wrong_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 1, runs=4, rows=4)
    for option, value in (("--level", "1.5"), ("--jobs", "0"), ("--seed", "-1")):
        status, _, err = terrapin(capsys, "compare", folder, option, value)
        assert status == 2
        assert option in err


def test_wrong_logs(tmp_path: Path) -> None:
    folder = _log_case(tmp_path)
    text = (folder / "case.toml").read_text()
    for old, new, expected in (
        ('dbc = "x.dbc"\n', "", "data.dbc"),
        ('period = "10 ms"\n', "", "data.period"),
        ('"10 ms"', '"10 kg"', "data.period"),
        ('"10 ms"', '"0 ms"', "more than 0"),
        ("x.dbc", "y.dbc", "y.dbc"),
        ("MOTOR.load", "MOTOR.weight", "MOTOR.weight"),
    ):
        (folder / "case.toml").write_text(text.replace(old, new))
        with pytest.raises(UserError, match=expected):
            load_case(folder)
    (folder / "case.toml").write_text(text)
    log = (folder / "slow.log").read_text()
    (folder / "slow.log").write_text(log + "(100.06) can0 zz#\n")
    with pytest.raises(UserError, match=r"slow\.log:6.*expected candump text: \(seconds\) channel ID#DATA"):
        load_case(folder)
    (folder / "slow.log").write_text("")
    with pytest.raises(UserError, match="no frame that the DBC knows"):
        load_case(folder)
    (folder / "slow.log").write_text(log)
    (folder / "x.dbc").write_text("nonsense")
    with pytest.raises(UserError, match=r"x\.dbc.*expected a DBC file"):
        load_case(folder)


EQUATION = """[case]
title = "Pipe"
[model]
base = "equation"
[model.equation]
dp = "rl * flow + rho0 * g"
[parameters]
g = "9.81 m/s^2"
[fit]
rl = { value = 1.0, unit = "Pa s/m^3" }
rho0 = { value = 0.0, unit = "kg/m^2" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
flow = { column = "q", unit = "m^3/s" }
dp = { column = "p", unit = "Pa" }
"""


def _equation(folder: Path, text: str) -> Path:
    random = np.random.default_rng(3)
    lines = ["run,q,p,t"]
    for run in range(5):
        for _ in range(8):
            q = random.uniform(-2, 2)
            lines.append(
                f"m{run},{q:.6f},{3.0 * q + 9.81 * 0.5 + 0.1 * random.standard_normal():.6f},{random.uniform():.4f}"
            )
    folder.mkdir(exist_ok=True)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


def test_equation_with_names_of_its_own(tmp_path: Path) -> None:
    case = load_case(_equation(tmp_path, EQUATION))
    assert list(case.roles) == ["flow"]
    assert list(case.channels) == ["dp"]
    assert case.units["dp"] == "Pa"
    assert case.parameters["g"] == pytest.approx(9.81)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("rl * flow", "rl * flaw", r"case\.toml:6: model\.equation\.dp: flaw"),
        ("rl * flow", "rl ^ flow", r"case\.toml:6: model\.equation\.dp: .*\*\*"),
        ("rl * flow", "__import__('os')", r"case\.toml:6: model\.equation\.dp: column 1"),
        ("dp = { column", "dq = { column", "dp is missing"),
        ('unit = "Pa s/m^3"', 'unit = "wobble"', r"case\.toml:10: fit\.rl\.unit"),
        ('"Pa s/m^3"', '"Pa s"', r"case\.toml:6: model\.equation\.dp: .*between"),
        ('"kg/m^2"', '"kg/m"', r"case\.toml:6: model\.equation\.dp"),
        ('unit = "Pa" }', 'unit = "N" }', r"case\.toml:6: model\.equation\.dp"),
        ('[model.equation]\ndp = "rl * flow + rho0 * g"\n', "", "model.equation: missing"),
    ],
)
def test_wrong_equations(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in EQUATION
    with pytest.raises(UserError, match=expected):
        load_case(_equation(tmp_path, EQUATION.replace(old, new)))


def test_units_of_an_equation_need_not_be_coherent(tmp_path: Path) -> None:
    """With every unit given, kPa and L/min do what Pa and m^3/s do."""
    from terrapin_tools.workbench.model.model import Model

    text = EQUATION.replace('"m^3/s"', '"L/min"').replace('unit = "Pa" }', 'unit = "kPa" }')
    case = load_case(_equation(tmp_path, text))
    prediction = Model.of(case).bind(case.inputs).predict(np.array([2.0, 0.5]))
    expected = (2.0 * case.roles["flow"] / 60000.0 + 0.5 * 9.81) / 1000.0
    np.testing.assert_allclose(prediction[0], expected, rtol=1e-12)


def test_speed_of_zero_under_the_rate_effect_names_the_row(tmp_path: Path) -> None:
    text = """[case]
title = "s"
[model]
base = "sphere_contact"
effects = ["rate_effect"]
[parameters]
radius = 0.2
n = 1.0
cohesion = 0
friction_angle = "40 deg"
shear_modulus = "18 mm"
c1 = 0.2
c2 = 0.3
load = 100
[fit]
k_s = { value = 1e6, min = 1e4, max = 1e8 }
[data]
files = ["d.csv"]
run = "run"
[data.columns]
slip = { column = "s", unit = "1" }
speed = { column = "v", unit = "mm/s" }
traction = { column = "F", unit = "N" }
"""
    (tmp_path / "case.toml").write_text(text)
    (tmp_path / "d.csv").write_text("run,s,v,F\na,0.2,10,3\na,0.3,0,4\nb,0.3,20,4\n")
    with pytest.raises(UserError, match=r"d\.csv:3: column v: found speed 0, expected more than 0 \(rate_effect"):
        load_case(tmp_path)


@pytest.mark.parametrize("factor", [2.5, -0.4])
def test_the_sd_of_a_mended_column_is_mended_too(tmp_path: Path, factor: float) -> None:
    """A sigma is stated of the table's numbers; a factor that puts them right widens their noise as much."""
    case = rolling(tmp_path, 1)
    plain = load_case(case)
    path = case / "case.toml"
    path.write_text(path.read_text().replace("sigma = 4.0", f"sigma = 4.0, factor = {factor}"))
    sd = [one.sigma["current"] for one in (plain, load_case(case))]
    assert sd == pytest.approx([4e-3, 4e-3 * abs(factor)])


def test_two_that_append_at_once_take_two_names(tmp_path: Path) -> None:
    """The one that is refused then takes its own file away, and not the other's."""
    from terrapin_tools.workbench.intake.append import _free_name

    folder = tmp_path / "case"
    folder.mkdir()
    names = [_free_name(folder, tmp_path / "day.csv") for _ in range(3)]
    assert names == ["day.csv", "day_2.csv", "day_3.csv"]
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
