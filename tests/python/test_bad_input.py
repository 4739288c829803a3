"""Scenarios, parameters, run folders and command lines that are wrong: one line, the right status, nothing written.

What is wrong in a case stands in test_case.py and test_bad_case.py, what goes wrong in a run in tests/links.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_hil import paths

pytestmark = pytest.mark.usefixtures("bounded")

SCENARIO = """\
duration = "0.1 s"
seed = 1
checks = ["max(abs(slip)) < 2"]
[sensors]
kit = "ideal"
[[path]]
terrain = "sand"
[[operator]]
at = "0 s"
request = "run"
setpoint = "8 V"
"""


def refused(capsys: pytest.CaptureFixture[str], expected: list[str], *command: object, status: int = 2) -> None:
    found, out, err = terrapin(capsys, *command)
    assert found == status, err
    assert out == ""
    one_line(err, expected)


def change(old: str, new: str) -> bytes:
    assert old in SCENARIO
    return SCENARIO.replace(old, new).encode()


def more(text: str) -> bytes:
    return (SCENARIO + text).encode()


def before(text: str) -> bytes:
    return (text + SCENARIO).encode()


def check(text: str) -> bytes:
    return change('"max(abs(slip)) < 2"', f"'''{text}'''")


MANY = "".join(f'[[path]]\nterrain = "sand"\nfrom = {i}\n' for i in range(1, 18))
WRONG: dict[str, tuple[bytes, list[str]]] = {
    # no TOML
    "empty": (b"", ["duration", "missing"]),
    "junk": (bytes(range(256)), ["UTF-8"]),
    "bytes 0": (bytes(100), [":1", "not TOML"]),
    "Latin-1": (b"title = '\xe9'\n" + SCENARIO.encode(), ["UTF-8"]),
    "UTF-16": (SCENARIO.encode("utf-16"), ["UTF-8"]),
    "deep lists": (before("x = " + "[" * 5000 + "]" * 5000 + "\n"), ["not TOML", "too deep"]),
    "deep tables": (before("x = " + "{a=" * 5000 + "1" + "}" * 5000 + "\n"), ["not TOML", "too deep"]),
    "a key twice": (change("seed = 1", "seed = 1\nseed = 2"), [":3", "not TOML"]),
    # names and tables
    "unknown field": (before("sneed = 3\n"), [":1: sneed", "`seed`"]),
    "a line break in a name": (
        change('kit = "ideal"', 'kit = "ideal"\n"a\\nb" = 1'),
        ["sensors.a\\nb", "no such field"],
    ),
    "an escape in a name": (change('kit = "ideal"', 'kit = "ideal"\n"\\u001b[31m" = 1'), ["no such field"]),
    "a table for a list": (change("[[path]]", "[path]"), [":6: path", "[[path]]"]),
    "a number for a list": (
        change('[[path]]\nterrain = "sand"\n', "").replace(b"seed", b"path = 3\nseed"),
        [":2: path"],
    ),
    "a list for a table": (more("[[robot]]\nradius = 1\n"), [":12: robot", "expected a table"]),
    "no path": (change('[[path]]\nterrain = "sand"\n', ""), ["path", "found 0 tables"]),
    "too many paths": (change('terrain = "sand"\n', f'terrain = "sand"\n{MANY}'), ["path", "1 to 16"]),
    "unknown terrain": (change('"sand"', '"lava"'), [":7: path[1].terrain", "'lava'", "hard_floor"]),
    "a list for a word": (change('"ideal"', '["real"]'), [":5: sensors.kit", "exact, ideal, real"]),
    "dotted field": (
        change('kit = "ideal"', 'kit = "ideal"\ncurrent.ofset = 1'),
        [":6: sensors.current.ofset", "`offset`"],
    ),
    "after a list of lines": (
        before("carriage = [\n  [0, 1],\n  [1, 2]\n]\nspeed = 1\n"),
        [":5: speed", "no such field"],
    ),
    "unknown effect": (more("[effect.warp]\na = 1\n"), [":12: effect.warp", "viscous_friction"]),
    "an effect without its size": (more("[effect.viscous_friction]\n"), [":12: effect.viscous_friction.b", "missing"]),
    "unknown fault": (more("[[fault]]\nkind = 'gremlin'\n"), [":13: fault[1].kind", "'gremlin'"]),
    "a fault on the wrong channel": (
        more("[[fault]]\nkind = 'lost_counts'\nchannel = 'current'\nvalue = 0.1\n"),
        [":14: fault[1].channel", "motor, wheel"],
    ),
    # numbers
    "NaN": (change('"0.1 s"', "nan"), [":1: duration", "finite"]),
    "infinite": (change('"8 V"', "inf"), [":11: operator[1].setpoint", "finite"]),
    "text": (change('"0.1 s"', '"long"'), [":1: duration", "'long'", "in s"]),
    "true": (change('"0.1 s"', "true"), [":1: duration", "True"]),
    "a date": (change('"0.1 s"', "2020-01-01"), [":1: duration"]),
    "thousands": (change('"0.1 s"', '"1,000 ms"'), [":1: duration", "'1,000 ms'"]),
    "400 digits": (change('"0.1 s"', "9" * 400), [":1: duration", "finite"]),
    "5000 digits": (change('"0.1 s"', "9" * 5000), ["not TOML", "digits"]),
    "wrong kind of quantity": (change('"8 V"', '"8 kg"'), [":11: operator[1].setpoint", "'8 kg'", "in V"]),
    "a tower of powers": (change('"0.1 s"', '"1 s**9**9**9"'), [":1: duration", "in s"]),
    "an endless unit": (change('"0.1 s"', '"1 ' + "s*" * 5000 + 's"'), [":1: duration", "in s"]),
    "code for a unit": (change('"0.1 s"', '"1 __import__(1)"'), [":1: duration", "in s"]),
    "out of bounds": (more("[robot]\nradius = -1\n"), [":13: robot.radius", "found -1", "1e-09 to 1e+06 m"]),
    "too long": (change('"0.1 s"', '"2 h"'), [":1: duration", "0.001 to 3600 s"]),
    "too short": (change('"0.1 s"', '"0.4 ms"'), [":1: duration", "0.001 to 3600 s"]),
    "seed of many digits": (change("seed = 1", "seed = 99999999999999999999"), [":2: seed", "9223372036854775807"]),
    "a speed beyond the rails": (before("carriage = [[0, 1e300]]\n"), [":1: carriage", "1e+300", "-32 to 32 m/s"]),
    "times that fall": (before("carriage = [[1, 1], [0, 1]]\n"), [":1: carriage", "rising"]),
    "colder than cold": (more("[winding]\nprofile = [[0, -400]]\n"), [":13: winding.profile", "-400", "-50 to 300"]),
    "beyond the earth": (before("start_position = 1e300\n"), [":1: start_position", "10000 m"]),
    # parameters of the controller
    "unknown parameter": (more("[firmware]\nradios = 1\n"), [":13: firmware.radios", "radius"]),
    "parameter out of range": (more("[firmware]\nradius = 8\n"), [":13: firmware.radius", "0.01 to 0.5 m"]),
    "parameter NaN": (more("[firmware]\nradius = nan\n"), [":13: firmware.radius", "finite"]),
    "parameter in another unit": (more("[firmware]\nradius = '80 kg'\n"), [":13: firmware.radius", "'80 kg'", "in m"]),
    # checks, found out before the run
    "no list": (change('["max(abs(slip)) < 2"]', '"max(slip) < 2"'), [":3: checks", "list of texts"]),
    "numbers for texts": (change('["max(abs(slip)) < 2"]', "[3]"), [":3: checks", "list of texts"]),
    "unknown signal": (check("max(slap) < 2"), [":3: checks", "'slap'", "slip"]),
    "the operator's signal": (check("max(COMMAND.setpoint) < 2"), [":3: checks", "COMMAND.setpoint"]),
    "unknown word": (check("any(ACTUATE.state == 'flying')"), [":3: checks", "'flying'", "stuck"]),
    "a signal, not yes or no": (check("slip < 2"), [":3: checks", "any() or all()"]),
    "signals joined": (check("slip and slip"), [":3: checks", "any() or all()"]),
    "a word in arithmetic": (check("'a' + 1 < 2"), [":3: checks", "is a word"]),
    "a word for a signal": (check("max('stuck') < 2"), [":3: checks", "is a word"]),
    "a word for a time": (check("max(slip['a':]) < 2"), [":3: checks", "is a word"]),
    "a signal for a time": (check("max(slip[slip:]) < 2"), [":3: checks", "number of seconds"]),
    "code": (check('__import__("os").system("true") < 2'), [":3: checks", "unknown function"]),
    "a call of a call": (check("max(slip)(1)"), [":3: checks", "unknown function"]),
    "an open parenthesis": (check("max(abs(slip < 2"), [":3: checks", "never closed"]),
    "an endless check": (check("1 + " * 200 + "1 < 2"), [":3: checks", "500 characters"]),
    "an empty check": (check(""), [":3: checks", "cannot be read"]),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    content, expected = WRONG[name]
    file = tmp_path / "wrong.toml"
    file.write_bytes(content)
    refused(capsys, [str(file), *expected], "run", file, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("edit", [lambda t: b"\xef\xbb\xbf" + t, lambda t: t.replace(b"\n", b"\r\n")])
def test_scenarios_as_other_editors_write_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], edit: Callable[[bytes], bytes]
) -> None:
    (tmp_path / "plain.toml").write_text(SCENARIO)
    (tmp_path / "other.toml").write_bytes(edit(SCENARIO.encode()))
    hashes = []
    for name in ("plain", "other"):
        status, out, err = terrapin(capsys, "run", tmp_path / f"{name}.toml")
        assert (status, err) == (0, "")
        hashes.append(out.partition("sha256 ")[2])
    assert hashes[0] == hashes[1] != ""


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("", ["shipped", "steady_sand"]),
        ("steady_send", ["steady_send", "shipped", "steady_sand"]),
        ("/", ["shipped", "steady_sand"]),
        ("/dev/null", ["shipped"]),
        ("/proc/self/mem", ["/proc/self/mem", "Input/output error"]),
        ("x" * 5000, ["xxx...", "name too long"]),
        ("no\nwhere", ["no such file"]),
    ],
)
def test_no_scenario(capsys: pytest.CaptureFixture[str], name: str, expected: list[str]) -> None:
    refused(capsys, expected, "run", name)


def test_a_robot_that_no_step_can_follow(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Allowed by every bound, but stiff beyond 1 ms: said, and not passed as a run whose checks hold."""
    file = tmp_path / "stiff.toml"
    file.write_text(SCENARIO.replace('"0.1 s"', '"1 s"') + "[robot]\nviscous = 1e6\n")
    refused(capsys, ["stiff: ", "no finite value at 0.1"], "run", file, "--out", tmp_path / "out", status=1)
    assert "complete = false" in (tmp_path / "out" / "run.toml").read_text()


# ------------------------------------------------------------------ --parameters

PARAMETERS: dict[str, tuple[bytes, list[str]]] = {
    "empty": (b"", ["found no table [parameters]"]),
    "a number": (b"parameters = 3\n", [":1: parameters", "expected a table"]),
    "a list": (b"[[parameters]]\nradius = 0.08\n", [":1: parameters", "expected a table"]),
    "unknown": (b"[parameters]\nradios = 1\n", [":2: parameters.radios", "radius"]),
    "NaN": (b"[parameters]\nradius = nan\n", [":2: parameters.radius", "finite"]),
    "another unit": (b"[parameters]\nradius = '80 kg'\n", [":2: parameters.radius", "'80 kg'"]),
    "out of range": (b"[parameters]\nradius = 1e9\n", [":2: parameters.radius", "0.01 to 0.5 m"]),
    "true": (b"[parameters]\nradius = true\n", [":2: parameters.radius", "True"]),
    "a table": (b"[parameters.radius]\nx = 1\n", [":1: parameters.radius"]),
    "twice": (b"[parameters]\nradius = 0.08\nradius = 0.09\n", [":3", "not TOML"]),
    "junk": (b"\xff\xfe", ["UTF-8"]),
    "deep": (b"x = " + b"[" * 9999, ["not TOML", "too deep"]),
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_wrong_parameters(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    content, expected = PARAMETERS[name]
    file = tmp_path / "p.toml"
    file.write_bytes(content)
    refused(capsys, ["p.toml", *expected], "run", "steady_sand", "--parameters", file, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("/nowhere.toml", "No such file"),
        ("/", "directory"),
        ("/proc/self/mem", "Input"),
        ("/dev/zero", "found more than 16 million characters"),
    ],
)
def test_no_parameters(capsys: pytest.CaptureFixture[str], file: str, words: str) -> None:
    refused(capsys, [file, words], "run", "steady_sand", "--parameters", file)


# ------------------------------------------------------------------ command lines


@pytest.mark.parametrize(
    ("arguments", "expected", "status"),
    [
        (["runn"], ["'runn'"], 2),
        (["run"], ["scenario"], 2),
        (["run", "steady_sand", "--sede", "1"], ["--sede"], 2),
        (["run", "steady_sand", "--seed", "-1"], ["--seed"], 2),
        (["run", "steady_sand", "--seed", "1.5"], ["--seed"], 2),
        (["run", "steady_sand", "--seed", "9" * 20], ["--seed"], 2),
        (["run", "steady_sand", "--link", ""], ["expected one of inprocess, pty"], 2),
        (["run", "steady_sand", "--link", "radio"], ["'radio'"], 2),
        (["run", "steady_sand", "--link", "pty:x"], ["serial:x"], 2),
        (["run", "steady_sand", "--link", "serial"], ["serial:DEVICE"], 2),
        (["run", "steady_sand", "--link", "can:radio:0"], ["radio:0: cannot open the link"], 1),
        (["run", "steady_sand", "--link", "can:kvaser:0"], ["kvaser:0: cannot open the link"], 1),
        (["run", "steady_sand", "--link", "can:pcan:PCAN_USBBUS1"], ["pcan:PCAN_USBBUS1: cannot open the link"], 1),
        (["run", "steady_sand", "--link", "can:slcan:/dev/null"], ["slcan:/dev/null: cannot open the link"], 1),
        (["run", "steady_sand", "--out", "/proc/x"], ["/proc/x: cannot write the log"], 1),
        (["run", "steady_sand", "--out", "/dev/null"], ["/dev/null: cannot write the log"], 1),
        (["run", "steady_sand", "--out", "x" * 300], ["cannot write the log: File name too long"], 1),
        (["experiment", "l9", "--factor", "a=nan,2,3"], ["--factor", "a=nan,2,3"], 2),
        (["experiment", "l9", "--level", "nan"], ["--level"], 2),
        (["experiment", "l9", "/nowhere.csv"], ["/nowhere.csv", "no such file"], 2),
        (["effects", "warp"], ["'warp'"], 2),
        (["case", "/nowhere", "--to", "/tmp/x"], ["/nowhere/telemetry.log", "no such file"], 2),
        (["soil", "vehicle", "/nowhere"], ["/nowhere/case.toml", "no such file"], 2),
        (["compare", "/nowhere\n\x1b[31m"], ["/nowhere\\n\\x1b[31m/case.toml", "no such file"], 2),
    ],
)  # fmt: skip
def test_wrong_command_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], expected: list[str], status: int
) -> None:
    refused(capsys, expected, *arguments, status=status)


@pytest.mark.parametrize("command", ["run", "batch"])
def test_a_scenario_that_is_no_text(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    (tmp_path / "x.toml").write_bytes(SCENARIO.encode() + b"# \xff\n")
    refused(capsys, ["x.toml", "UTF-8"], command, tmp_path / "x.toml", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_wrong_link_leaves_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, ["'radio'"], "run", "steady_sand", "--link", "radio", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--level", "nan"], ["--level"]),
        (["--level", "1"], ["--level"]),
        (["--jobs", "0"], ["--jobs"]),
        (["--jobs", "1.5"], ["--jobs"]),
        (["--seed", "-1"], ["--seed"]),
    ],
)
def test_nonsense_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: list[str]
) -> None:
    refused(capsys, expected, "compare", rolling(tmp_path, 1, runs=4, rows=4), *arguments)


FORMULA = ["my", "--expression", "k * omega"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["my", "--expression", "k *"], ["--expression", "not a formula"]),
        (["my", "--expression", "\n"], ["--expression", "printable"]),
        (["my", "--expression", "omega*" * 300 + "k"], ["--expression", "1000 characters"]),
        (["my", "--expression", "k / 0", "--parameter", "k=1"], ["runs.csv:2", "inf"]),
        (FORMULA, ["k is no role"]),
        ([*FORMULA, "--parameter", "k=nan"], ["my.k.value", "finite"]),
        ([*FORMULA, "--parameter", "k=5:0:1"], ["my.k", "between min 0 and max 1"]),
        ([*FORMULA, "--parameter", "k=0:1:0"], ["my.k", "min below max"]),
        ([*FORMULA, "--parameter", "k=0:0:1:kg^9^9^9"], ["my.k.unit", "m^2"]),
        ([*FORMULA, "--parameter", "k=0", "--parameter", "k=1"], ["--parameter", "k twice"]),
        ([*FORMULA, "--parameter", "k"], ["--parameter", "NAME=START:MIN:MAX"]),
    ],
)  # fmt: skip
def test_wrong_formulas(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: list[str]
) -> None:
    folder = rolling(tmp_path, 1, runs=4, rows=4)
    refused(capsys, expected, "add", folder, *arguments)
    assert (folder / "case.toml").read_text() == ROLLING
    assert sorted(path.name for path in folder.iterdir()) == ["case.toml", "runs.csv"]


@pytest.mark.parametrize("target", ["/", "/nowhere/x", "/proc/x", "/dev/full"])
@pytest.mark.parametrize("command", ["compare --json", "report -o", "export --to"])
def test_answers_that_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, target: str
) -> None:
    text = ROLLING.replace("effects = []", 'effects = ["motor_heating"]')
    folder = rolling(tmp_path, 1, runs=4, rows=4, text=text)
    name, option = command.split()
    refused(capsys, [target], name, folder, option, target, status=1)
    assert sorted(path.name for path in folder.iterdir()) == ["case.toml", "runs.csv"]


# ------------------------------------------------------------------ run folders for `terrapin case`


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good runs, a and b."""
    folder = tmp_path_factory.mktemp("runs")
    for name, seed in (("a", "1"), ("b", "2")):
        command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]
        command += ["run", "steady_sand", "--seed", seed, "--out", str(folder / name)]
        subprocess.run(command, check=True, capture_output=True, cwd=paths.ROOT, timeout=300)
    return folder


def log(edit: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    return lambda run: (run / "telemetry.log").write_bytes(edit((run / "telemetry.log").read_bytes())) and None


def description(text: str) -> Callable[[Path], None]:
    return lambda run: (run / "run.toml").write_text(text) and None


def shorter(text: bytes) -> bytes:
    """The first WINDOW frame of the log without its last byte."""
    from terrapin_hil.messages import interface

    mark = b" %03X#" % interface().messages["WINDOW"].id
    at = text.index(mark)
    end = text.index(b"\n", at)
    return text[: end - 2] + text[end:]


RUNS: dict[str, tuple[Callable[[Path], None], list[str]]] = {
    "gone": (lambda run: (run / "telemetry.log").unlink(), ["telemetry.log", "no such file"]),
    "empty": (log(lambda t: b""), ["telemetry.log", "no valid steady window"]),
    "cut early": (log(lambda t: t[:500]), ["telemetry.log", "no valid steady window"]),
    "junk": (log(lambda t: bytes(range(256)) * 9), ["telemetry.log:1", "candump text"]),
    "a damaged line": (log(lambda t: t.replace(b"#", b"?", 1)), ["telemetry.log:1", "candump text"]),
    "a line run into the next": (log(lambda t: t.replace(b"\n", b"", 1)), ["telemetry.log:1", "candump text"]),
    "a frame too short": (log(shorter), ["telemetry.log", "WINDOW", "found 7 bytes, expected 8"]),
    "run.toml of junk": (lambda run: (run / "run.toml").write_bytes(b"\xff\xfe") and None, ["run.toml", "UTF-8"]),
    "run.toml cut": (description("x = ["), ["run.toml", "not TOML"]),
    "run.toml too deep": (description("x = " + "[" * 9999), ["run.toml", "too deep"]),
    "a parameter NaN": (description("[parameters]\nradius = nan\n"), ["run.toml", "parameters.radius", "finite"]),
    "a parameter in kg": (description("[parameters]\nradius = '3 kg'\n"), ["run.toml", "radius", "'kg'"]),
}


@pytest.mark.parametrize("name", RUNS)
def test_wrong_runs(tmp_path: Path, runs: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    harm, expected = RUNS[name]
    shutil.copytree(runs / "b", tmp_path / "b")
    harm(tmp_path / "b")
    refused(capsys, expected, "case", runs / "a", tmp_path / "b", "--to", tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_a_log_cut_by_a_crash_is_as_good_as_its_whole_lines(
    tmp_path: Path, runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = []
    for name, end in (("whole", b""), ("cut", b"(9.999900) can0 1")):
        shutil.copytree(runs / "b", tmp_path / name / "b")
        log(lambda t, end=end: t[: t.rindex(b"\n", 0, len(t) * 9 // 10) + 1] + end)(tmp_path / name / "b")  # type: ignore[misc]
        case = tmp_path / name / "case"
        assert terrapin(capsys, "case", runs / "a", tmp_path / name / "b", "--to", case)[0] == 0
        tables.append((case / "runs.csv").read_bytes())
    assert tables[0] == tables[1]


# ------------------------------------------------------------------ where the output goes


def shell(line: str) -> subprocess.CompletedProcess[str]:
    tool = f"'{sys.executable}' -c 'from terrapin_tools.cli import main; main()'"
    command = ["bash", "-c", f'set -o pipefail; terrapin() {{ {tool} "$@"; }}; {line}']
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    return subprocess.run(command, capture_output=True, text=True, cwd=paths.ROOT, timeout=300, env=environment)


def test_a_reader_that_goes_away() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", "effects"]
    try:
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=300)
    finally:
        os.close(writing)
    assert done.returncode in (1, 141)  # the tool's own end, or that of a write
    assert done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_standard_output_on_a_full_disk() -> None:
    done = shell("terrapin effects > /dev/full")
    assert (done.returncode, done.stderr) == (1, "terrapin: No space left on device\n")


def test_words_that_the_terminal_cannot_show(tmp_path: Path) -> None:
    rolling(tmp_path, 1, runs=4, rows=4, text=ROLLING.replace('"Rolling"', '"Rollen über Sand ✓"'))
    done = shell(f"terrapin compare '{tmp_path}'")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Rollen \\xfcber Sand \\u2713: 4 runs")
