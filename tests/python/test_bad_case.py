"""Cases as a hostile or unlucky user writes them: one line, exit status 2, nothing written. Beyond test_case.py."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pyarrow
import pyarrow.parquet
import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_hil import paths

Change = Callable[[Path], None]

pytestmark = pytest.mark.usefixtures("bounded")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(capsys: pytest.CaptureFixture[str], folder: Path, expected: list[str], *command: object) -> None:
    """The command says what is wrong in one line with all of `expected`, and touches nothing in the case."""
    before = contents(folder)
    status, out, err = terrapin(capsys, *(command or ("compare", folder)))
    assert status == 2, err
    assert out == ""
    one_line(err, expected)
    assert len(err) < 1000
    assert contents(folder) == before


def toml(old: str, new: str) -> Change:
    assert old in ROLLING

    def change(folder: Path) -> None:
        (folder / "case.toml").write_text(ROLLING.replace(old, new))

    return change


def effect(expression: str, parameters: str = "k = { value = 1 }") -> Change:
    """An effect of the user's own in the model."""
    table = f'\n[effect.mine]\nexpression = "{expression}"\n{parameters}\n'

    def change(folder: Path) -> None:
        text = ROLLING.replace("effects = []", 'effects = ["mine"]')
        (folder / "case.toml").write_text(text + table)

    return change


def raw(name: str, content: bytes) -> Change:
    return lambda folder: (folder / name).write_bytes(content) and None


def csv(edit: Callable[[str], str]) -> Change:
    return lambda folder: (folder / "runs.csv").write_text(edit((folder / "runs.csv").read_text())) and None


def cell(text: str) -> Change:
    """`text` as the speed in line 4."""

    def edit(content: str) -> str:
        lines = content.splitlines()
        fields = lines[3].split(",")
        fields[1] = text
        return "\n".join([*lines[:3], ",".join(fields), *lines[4:]]) + "\n"

    return csv(edit)


def folder_for(name: str) -> Change:
    def change(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).mkdir()

    return change


def unreadable(name: str) -> Change:
    """A file that opens and then fails on reading, for root too."""

    def change(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).symlink_to("/proc/self/mem")

    return change


UNIT = 'unit = "rpm"'
WRONG: dict[str, tuple[Change, list[str]]] = {
    # the file case.toml
    "deep lists": (raw("case.toml", b"x=" + b"[" * 5000 + b"]" * 5000), ["case.toml", "too deep"]),
    "5000 digits": (toml("sigma = 4.0", "sigma = " + "9" * 5000), ["case.toml", "not TOML", "digits"]),
    "400 digits": (toml("sigma = 4.0", "sigma = " + "9" * 400), ["case.toml:27", "current.sigma", "finite"]),
    "constant of 400 digits": (toml("torque_constant = 0.1", "torque_constant = " + "9" * 400), [":12", "finite"]),
    "a line break in a name": (toml("[parameters]", '["a\\nb"]\n[parameters]'), ["a\\nb", "unknown name"]),
    "escapes in a name": (toml("[parameters]", '["\\u001b[31m"]\n[parameters]'), ["unknown name"]),
    "case.toml is a folder": (folder_for("case.toml"), ["case.toml", "expected TOML"]),
    "case.toml fails on reading": (unreadable("case.toml"), ["case.toml", "Input/output error"]),
    "UTF-16": (raw("case.toml", ROLLING.encode("utf-16")), ["case.toml", "UTF-8"]),
    # units
    "a tower of powers": (toml(UNIT, 'unit = "rpm**9**9**9"'), ["case.toml:24", "omega.unit", "m^2"]),
    "powers of a number": (toml(UNIT, 'unit = "rpm * ((9**99)**99)**99**99"'), ["case.toml:24", "m^2"]),
    "an endless unit": (toml(UNIT, f'unit = "{"s*" * 5000}s"'), ["case.toml:24", "omega.unit", "100 characters"]),
    "a factor in a unit": (toml(UNIT, 'unit = "5 rpm"'), ["case.toml:24", "omega.unit", "not a unit"]),
    "code in a unit": (toml(UNIT, 'unit = "__import__(1)"'), ["case.toml:24", "omega.unit", "not a unit"]),
    "a difference": (toml('"degF"', '"delta_degF"'), ["case.toml:26", "temperature.unit", "degC"]),
    "a level": (toml('unit = "mA"', 'unit = "dBm"'), ["case.toml:27", "current.unit", "'A'"]),
    # numbers
    "no space before the unit": (toml('"80 mm"', '"80mm"'), ["case.toml:10", "radius", "80 mm"]),
    "decimal comma": (toml('"80 mm"', '"80,0 mm"'), ["case.toml:10", "radius"]),
    "infinite with a unit": (toml('"80 mm"', '"1e400 mm"'), ["case.toml:10", "radius", "finite"]),
    "a radius without size": (toml('"80 mm"', "1e-320"), ["case.toml:10", "radius", "more than 0"]),
    "sigma without size": (toml("sigma = 4.0", "sigma = 1e-300"), ["case.toml:27", "sigma", "more than 0"]),
    "sigma without bound": (toml("sigma = 4.0", "sigma = 1e300"), ["case.toml:27", "sigma", "finite"]),
    "start value not a number": (toml("value = 0.05", "value = nan"), ["case.toml:17", "f_o.value", "finite"]),
    # formulas
    "log of a negative number": (effect("k * log(-load / load)"), ["runs.csv:2", "nan", "current"]),
    "log of a force": (effect("k * log(load)"), ["case.toml:30", "effect.mine.expression", "log of a quantity in N"]),
    "division by zero": (effect("k / (load - load)"), ["runs.csv:2", "inf", "current"]),
    "an overflow": (effect("load * radius * exp(1e6 * k)"), ["runs.csv:2", "inf", "current"]),
    "an unknown name": (effect("k * zz"), ["case.toml:30", "effect.mine.expression", "zz"]),
    "a nest of parentheses": (effect("(" * 400 + "k" + ")" * 400), ["case.toml:30", "not a formula"]),
    "a call": (effect("__import__('os').system('true')"), ["case.toml:30", "effect.mine.expression"]),
    # file names
    "a byte 0 in a name": (toml('"runs.csv"', '"ru\\u0000ns.csv"'), ["no such file"]),
    "a line break in a file's name": (toml('"runs.csv"', '"a\\nb.csv"'), ["a\\nb.csv", "no such file"]),
    "a name too long": (toml('"runs.csv"', f'"{"a" * 300}.csv"'), ["readable file"]),
    "one file under two names": (toml('"runs.csv"', '"runs.csv", "./runs.csv"'), ["case.toml:20", "once"]),
    "a device": (toml('"runs.csv"', '"/dev/zero"'), ["/dev/zero", "no such file (data.files)"]),
    # the table
    "a folder for the table": (folder_for("runs.csv"), ["runs.csv", "is a folder"]),
    "a table that fails on reading": (unreadable("runs.csv"), ["runs.csv", "Input/output error"]),
    "bytes 0": (raw("runs.csv", bytes(100)), ["runs.csv:1", "byte 0"]),
    "byte 0 in a cell": (cell("1\x002"), ["runs.csv:4", "byte 0"]),
    "binary junk": (raw("runs.csv", bytes(range(256)) * 20), ["runs.csv", "UTF-8"]),
    "a table in UTF-16": (raw("runs.csv", "run,w\n".encode("utf-16")), ["case.toml:25", "'W'", "one of run, w\n"]),
    "blanks only": (raw("runs.csv", b"   \n"), ["runs.csv:1", "column names"]),
    "thousands of another kind": (cell('"1.234,5"'), ["runs.csv:4", "column w", "'1.234,5'", "decimal point"]),
    "thousands in groups of two": (cell('"12,34.5"'), ["runs.csv:4", "column w", "'12,34.5'", "number"]),
    "thousands of Python": (cell("1_000"), ["runs.csv:4", "column w", "'1_000'", "number"]),
    "other digits": (cell("١٢"), ["runs.csv:4", "column w", "number"]),
    "another minus": (cell("\u221212"), ["runs.csv:4", "column w", "number"]),
    "a formula's error": (cell("#REF"), ["runs.csv:4", "column w", "#REF"]),
    "an open quote": (cell('"12'), ["runs.csv:17", "fields"]),
    "a quote inside": (cell('1"2'), ["runs.csv:4", "column w"]),
    "more than a number holds": (cell("1e999"), ["runs.csv:4", "column w", "infinity"]),
    "more than its square holds": (cell("1e200"), ["runs.csv:4", "column w", "1e+200"]),
    "a blank line": (
        csv(lambda t: t.replace("\n", "\n\n", 2)),
        ["runs.csv:", "empty or broken line", "expected a row on each line"],
    ),
    "an endless cell": (cell("x" * 200_000), ["runs.csv", "field"]),
    "one row": (csv(lambda t: "\n".join(t.splitlines()[:2])), ["case.toml", "data", "1 value to train on"]),
    "every run held out": (
        toml('run = "run"', 'run = "run"\ntest = ["r00", "r01", "r02", "r03"]'),
        ["case.toml:19", "data.train", "at least one run"],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_case(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    change, expected = WRONG[name]
    folder = rolling(tmp_path / "case", 1, runs=4, rows=4)
    change(folder)
    if any((folder / file).is_symlink() for file in ("case.toml", "runs.csv")):  # contents() cannot read it either
        status, out, err = terrapin(capsys, "compare", folder)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert all(text in err for text in expected), err
    else:
        refused(capsys, folder, expected)


@pytest.mark.parametrize("command", ["discover", "report", "add", "export"])
def test_every_command_refuses_a_wrong_case(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    folder = rolling(tmp_path / "case", 1, runs=4, rows=4)
    cell("fast")(folder)
    target = tmp_path / "written"
    more = {"report": ["-o", target], "export": ["--to", target], "add": ["motor_heating"]}
    expected = ["runs.csv:4", "column w", "'fast'", "expected a number"]
    refused(capsys, folder, expected, command, folder, *more.get(command, []))
    assert not target.exists()


@pytest.mark.parametrize(
    "edit",
    [
        lambda t: b"\xef\xbb\xbf" + t,
        lambda t: t.replace(b"\n", b"\r\n"),
        lambda t: t.replace(b"\n", b"\r"),
        lambda t: t + b"\n\n",
        lambda t: t.replace(b"run,w", b" run , w"),
    ],
    ids=["byte order mark", "CRLF", "CR", "blank lines at the end", "blanks in the header"],
)
def test_tables_as_other_programs_write_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], edit: Callable[[bytes], bytes]
) -> None:
    folder = rolling(tmp_path, 1, runs=4, rows=4)
    plain = terrapin(capsys, "compare", folder)
    (folder / "runs.csv").write_bytes(edit((folder / "runs.csv").read_bytes()))
    assert terrapin(capsys, "compare", folder) == plain
    assert plain[0] == 0


def test_case_files_keep_their_line_ends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 1, runs=4, rows=4)
    (folder / "case.toml").write_bytes(b"\xef\xbb\xbf" + ROLLING.replace("\n", "\r\n").encode())
    assert terrapin(capsys, "add", folder, "motor_heating")[0] == 0
    text = (folder / "case.toml").read_bytes()
    assert b'effects = ["motor_heating"]' in text
    assert text.count(b"\r\n") == text.count(b"\n") == ROLLING.count("\n")


SOIL = {
    "load = 0": ('load = "150 N"', "load = 0", ["parameters.load", "more than 0"]),
    "degrees as radians": ('friction_angle = "42.2 deg"', "friction_angle = 42.2", ["friction_angle", "90 deg"]),
    "negative cohesion": ('cohesion = "0 kPa"', 'cohesion = "-1 kPa"', ["parameters.cohesion", "0 or more"]),
    "an exponent of text": ("n = 0.97", 'n = "much"', ["parameters.n", "number"]),
    "k_s for another exponent": ("1945 kPa/m^0.97", "1945 kPa/m^0.5", ["fit.k_s", "convert"]),
    "a shape that is none": ('"full"', '"round"', ["parameters.stress", "full, linear"]),
}


@pytest.mark.parametrize("name", SOIL)
def test_impossible_soil(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    folder = tmp_path / "case"
    shutil.copytree(paths.ROOT / "cases" / "forced_slip_sand", folder)
    old, new, expected = SOIL[name]
    text = (folder / "case.toml").read_text()
    assert old in text
    (folder / "case.toml").write_text(text.replace(old, new))
    refused(capsys, folder, ["case.toml:", *expected])


# ------------------------------------------------------------------ logs and Parquet

DBC = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 16 MOTION: 8 A
 SG_ omega : 0|16@1- (0.001,0) [-32|32] "rad/s" A
BO_ 17 MOTOR: 8 A
 SG_ current : 0|16@1- (0.1,0) [-3000|3000] "mA" A
 SG_ load : 16|16@1- (0.01,0) [0|300] "N" A
"""
LOG = """(100.000000) can0 010#D007
(100.015000) can0 011#10274006
(100.030000) can0 010#D707
(100.050000) can0 011#11274106
"""


def log_case(folder: Path, log: bytes = LOG.encode(), dbc: bytes = DBC.encode(), suffix: str = ".log") -> Path:
    folder.mkdir()
    (folder / "fast.log").write_text(LOG.replace("D007", "8813"))
    (folder / f"slow{suffix}").write_bytes(log)
    (folder / "x.dbc").write_bytes(dbc)
    head, _, _ = ROLLING.partition("[data]")
    (folder / "case.toml").write_text(
        f'{head}[data]\nfiles = ["slow{suffix}", "fast.log"]\ndbc = "x.dbc"\nperiod = "10 ms"\n[data.columns]\n'
        'omega = { column = "MOTION.omega", unit = "rad/s" }\nload = { column = "MOTOR.load", unit = "N" }\n'
        'current = { column = "MOTOR.current", unit = "mA", sigma = 1 }\n'
    )
    return folder


def test_a_log_cut_off_by_a_crash_gives_what_is_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = log_case(tmp_path / "whole")
    plain = terrapin(capsys, "compare", whole)
    assert plain[0] == 0
    last = b"(100.051000) can0 010#FF7F"
    for length in range(1, len(last) + 1):
        (whole / "slow.log").write_bytes(LOG.encode() + last[:length])
        status, out, err = terrapin(capsys, "compare", whole)
        told = "  slow.log: read up to where it was cut off: the last line has no end.\n"
        assert out.count(told) == 1
        assert (status, out.replace(told, ""), err) == plain
    crlf = log_case(tmp_path / "crlf", LOG.replace("\n", "\r\n").encode())
    (crlf / "case.toml").write_bytes((whole / "case.toml").read_bytes())
    status, out, err = terrapin(capsys, "compare", crlf)  # the next step names the folder
    assert (status, out.replace(str(crlf), str(whole)), err) == plain


@pytest.mark.parametrize(
    "line",
    [
        "(100.06) can0 010#D00",
        "(100.06) can0 010#D0 07",
        "(100.06) can0 010 #D007",
        "(100.06) can0 1_0#D007",
        "(100.06) can0 -10#D007",
        "(100.06) can0 FFFFFFFFFF#D007",
        "(nan) can0 010#D007",
        "(inf) can0 010#D007",
        "(-1.0) can0 010#D007",
        "100.06 can0 010#D007",
        "hello",
        "\0\0\0\0",
    ],
)
def test_a_damaged_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str) -> None:
    folder = log_case(tmp_path / "case", (LOG + line + "\n" + LOG).encode())
    refused(capsys, folder, ["slow.log:5", "(seconds) channel ID#DATA"])


def test_frames_of_others_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An extended identifier is not the standard one of the same number; remote frames carry nothing; FD does."""
    folder = log_case(tmp_path / "case")
    plain = terrapin(capsys, "compare", folder)
    others = "(100.05) can0 00000010#FF7F\n(100.05) can0 010#R\n(100.05) can0 7FF#\n"
    (folder / "slow.log").write_text(LOG.replace("010#D707", "010##1D707 R") + others)
    assert terrapin(capsys, "compare", folder) == plain


WRONG_LOGS: dict[str, tuple[bytes, bytes, str, list[str]]] = {
    "time jumps": (LOG.encode() + b"(1e15) can0 010#D007\n", DBC.encode(), ".log", ["slow.log:5", "ID#DATA"]),
    "years": (LOG.encode() + b"(900000000.0) can0 010#D007\n", DBC.encode(), ".log", ["slow.log", "rows"]),
    "back in time": (LOG.encode() + b"(1.0) can0 010#D007\n", DBC.encode(), ".log", ["slow.log:5", "rise"]),
    "empty log": (b"", DBC.encode(), ".log", ["slow.log", "no frame"]),
    "binary log": (bytes(range(256)) * 4, DBC.encode(), ".log", ["slow.log:1", "ID#DATA"]),
    "empty DBC": (LOG.encode(), b"", ".log", ["DBC"]),
    "binary DBC": (LOG.encode(), bytes(range(256)), ".log", ["x.dbc", "DBC"]),
    "cut DBC": (LOG.encode(), DBC[:-12].encode(), ".log", ["load.column", "MOTOR.load"]),
    "DBC of another bus": (LOG.encode(), DBC.replace("BO_ 1", "BO_ 9").encode(), ".log", ["no frame"]),
    "DBC with another signal": (LOG.encode(), DBC.replace("omega", "speed").encode(), ".log", ["MOTION.omega"]),
    "empty BLF": (b"", DBC.encode(), ".blf", ["slow.blf", "bus log"]),
    "BLF of junk": (b"junk" * 50, DBC.encode(), ".blf", ["slow.blf", "bus log"]),
    "MF4 of junk": (b"junk" * 50, DBC.encode(), ".mf4", ["slow.mf4"]),
    "ASC of junk": (bytes(range(256)) * 4, DBC.encode(), ".asc", ["slow.asc"]),
}


@pytest.mark.parametrize("name", WRONG_LOGS)
def test_wrong_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    log, dbc, suffix, expected = WRONG_LOGS[name]
    refused(capsys, log_case(tmp_path / "case", log, dbc, suffix), expected)


def parquet_case(folder: Path, **changed: list[object]) -> Path:
    rolling(folder, 1, runs=4, rows=4)
    columns: dict[str, list[object]] = {"run": [*"aabb"] * 2, **{n: [1.0, 2.0, 3.0, 4.0] * 2 for n in ("w", "W", "i")}}
    columns["temp"] = [70.0] * 8
    pyarrow.parquet.write_table(pyarrow.table({**columns, **changed}), folder / "runs.parquet")
    (folder / "case.toml").write_text(ROLLING.replace("runs.csv", "runs.parquet"))
    return folder


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"w": [None] * 8}, ["row 1", "column w", "every row has a gap"]),
        ({"w": ["x"] * 8}, ["row 1", "column w", "'x'"]),
        ({"w": [[1.0]] * 8}, ["row 1", "column w", "number"]),
        ({"w": [b"\xff"] * 8}, ["row 1", "column w", "number"]),
        ({"w": [{"a": 1}] * 8}, ["row 1", "column w", "number"]),
        ({"run": [None, "a", "b", "b"] * 2}, ["row 1", "column run", "run's name"]),
        ({"run": [1.0, float("nan"), 2.0, 2.0] * 2}, ["row 2", "column run", "run's name"]),
    ],
    ids=range(7),
)
def test_wrong_parquet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: dict[str, list[object]], expected: list[str]
) -> None:
    refused(capsys, parquet_case(tmp_path / "case", **changed), ["runs.parquet", *expected])


@pytest.mark.parametrize("content", [b"", b"junk" * 100, b"PAR1" + bytes(100)])
def test_no_parquet(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes) -> None:
    folder = parquet_case(tmp_path / "case")
    (folder / "runs.parquet").write_bytes(content)
    refused(capsys, folder, ["runs.parquet", "Parquet file"])
