"""Runs over every link that this machine has, the command line, and what happens when something goes wrong."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import ParameterError
from terrapin_hil.links import LinkNameError, open_link
from terrapin_hil.links.bus import BusLink
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.slcan import ControllerProcess
from terrapin_hil.links.wire import SlcanLink
from terrapin_hil.messages import interface
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.checks import CheckError
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_hil.simulation import Simulation
from terrapin_tools.cli import main
from terrapin_tools.errors import UserError
from terrapin_tools.logs.candump import line, read, telemetry
from terrapin_tools.logs.folder import RunFolder
from tests.campaigns import must_hold
from tests.waiting import wait_for

TERRAPIN = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]


def short(name: str = "steady_sand", seconds: float = 1.0, **changes: object) -> Scenario:
    return replace(load_scenario(find_scenario(name)), duration=seconds, checks=(), **changes)  # type: ignore[arg-type]


@dataclass
class Done:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def terrapin(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """The command line, called in this process."""

    def call(*arguments: str) -> Done:
        monkeypatch.setattr(sys, "argv", ["terrapin", *arguments])
        capfd.readouterr()
        with pytest.raises(SystemExit) as left:
            main()
        out, error = capfd.readouterr()
        return Done(int(left.value.code or 0), out, error)

    return call


# ------------------------------------------------------------------ the same bits on every link


def by_hand(result: Result) -> str:
    digest = hashlib.sha256()
    for row in result.records:
        for frame in row["answer"][: row["answer_count"]]:
            digest.update(int(frame["id"]).to_bytes(2, "little") + bytes([int(frame["length"])]))
            digest.update(bytes(frame["data"][: frame["length"]]))
    return digest.hexdigest()


@pytest.mark.parametrize("name", ["steady_sand", "estop", "link_silence", "floor_calibration"])
def test_in_process_and_over_a_pty_give_the_same_hash(name: str) -> None:
    scenario = short(name, 4.5)
    here, there = run(scenario), run(scenario, "pty")
    assert here.output_hash == there.output_hash == by_hand(here)
    assert np.array_equal(here.records["truth"], there.records["truth"])
    assert run(replace(scenario, seed=99)).output_hash != here.output_hash


@pytest.mark.parametrize(
    ("preset", "flag"), [("coverage", "-O0"), ("m32", "-m32"), ("asan", "-fsanitize=address,undefined")]
)
def test_other_builds_give_the_same_hash(preset: str, flag: str) -> None:
    """Not optimised, 32 bit, with sanitizers: the same controller. These builds come from `cmake --preset m32` and its
    like. Each scenario's beginning; whole ones are in tests/campaigns/must_hold.py."""
    program = paths.ROOT / "build" / preset / "terrapin-controller"
    firmware = paths.ROOT / "firmware"
    sources = [path for kind in ("*.c", "*.h", "*.toml") for path in firmware.rglob(kind)]
    if not program.is_file() or program.stat().st_mtime < max(path.stat().st_mtime for path in sources):
        pytest.skip(f"build/{preset} is not built, or older than the firmware's sources")
    commands = json.loads((paths.ROOT / "build" / preset / "compile_commands.json").read_text())
    words = next(c["command"].split() for c in commands if c["file"].endswith("/core/step.c"))
    assert flag in words
    assert "-O2" not in words or preset == "m32"  # a setting that another one overrides is none
    assert must_hold.differing(preset, 1.0) == []
    for name in ("floor_calibration", "slope_limiter"):
        scenario = short(name, 5.0)
        with SlcanLink.of_process(program) as link:
            assert run(scenario, link).output_hash == run(scenario).output_hash


def test_python_can_gives_the_same_hash() -> None:
    scenario = short(seconds=0.5)
    with ControllerProcess() as path, open_link(f"can:slcan:{path}") as link:
        assert isinstance(link, BusLink)
        assert run(scenario, link).output_hash == run(scenario).output_hash


def test_a_serial_port_that_is_used_twice_gives_the_same_hash() -> None:
    scenario = short(seconds=0.5)
    with ControllerProcess() as path, open_link(f"serial:{path}") as link:
        first, second = run(scenario, link), run(scenario, link)
    assert first.output_hash == second.output_hash == run(scenario).output_hash


def test_parameters_reach_the_controller_on_every_link() -> None:
    scenario = short(seconds=5.0)
    parameters = {"comp_coulomb": 0.004}
    plain, here, there = (
        run(scenario),
        run(scenario, parameters=parameters),
        run(scenario, "pty", parameters=parameters),
    )
    assert here.output_hash == there.output_hash != plain.output_hash
    fall = plain.telemetry["GROUND"]["torque"][-1] - here.telemetry["GROUND"]["torque"][-1]
    assert fall == pytest.approx(0.004, abs=1e-5)
    assert run(replace(scenario, firmware=parameters)).output_hash == here.output_hash


@pytest.mark.parametrize("link", ["inprocess", "pty"])
@pytest.mark.parametrize(
    ("parameters", "message"),
    [({"radios": 0.08}, "no parameter 'radios' .*radius"), ({"radius": 8.0}, "radius: 8 m is outside 0.01 to 0.5 m")],
)
def test_wrong_parameters(link: str, parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        run(short(), link, parameters=parameters)


@pytest.mark.parametrize("name", ["", "radio", "serial", "socketcan:", "inprocess:x", "pty:/dev/null", "can"])
def test_link_names(name: str) -> None:
    with pytest.raises(LinkNameError, match="link"):
        open_link(name)


def test_real_time_keeps_to_the_clock() -> None:
    result = run(short(seconds=0.3, real_time=True))
    assert 0.29 <= result.timing.seconds < 3.0
    assert result.timing.latest >= result.timing.rms > 0.0
    assert result.output_hash == run(short(seconds=0.3)).output_hash


# ------------------------------------------------------------------ results


def test_result_holds_truth_and_telemetry_on_one_clock() -> None:
    result = run(short(seconds=5.0))
    assert result.time[-1] == pytest.approx(4.999)
    ground = result.telemetry["GROUND"]
    assert ground["torque"][-1] == pytest.approx(result.truth["contact_torque"][-1], abs=1e-3)
    held = result.held("GROUND", "torque")
    assert np.isnan(held[0])
    last = round(ground["time"][-1] * 1000)
    assert np.all(held[last:] == ground["torque"][-1])
    duty = result.telemetry["ACTUATE"]["duty"]
    assert duty[-1] * 12.0 == pytest.approx(8.0, abs=0.05)


def test_checks_decide() -> None:
    from terrapin_hil.scenario.checks import parse_check

    scenario = replace(short(), checks=(parse_check("max(speed) > 100"), parse_check("last(time) < 1")))
    result = run(scenario)
    assert [outcome.passed for outcome in result.outcomes] == [False, True]
    assert not result.passed
    with pytest.raises(CheckError, match=r"check 'max\(sped\) < 1': the run has no signal 'sped'"):
        run(replace(scenario, checks=(parse_check("max(sped) < 1"),)))


# ------------------------------------------------------------------ the folder of a run


def test_folder_holds_the_run(tmp_path: Path, terrapin: Callable[..., Done]) -> None:
    done = terrapin("run", "steady_dry_peat", "--out", str(tmp_path), "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["passed"] is True
    frames = read(tmp_path / "telemetry.log")
    assert np.all(np.diff(frames.times) >= 0)
    decoded = telemetry(frames, interface())
    result = run(load_scenario(find_scenario("steady_dry_peat")))
    assert result.output_hash == answer["output_sha256"]
    for message, table in result.telemetry.items():
        for name, values in table.items():
            assert np.allclose(decoded[message][name], values, rtol=0, atol=1e-9), f"{message}.{name}"
    assert len(decoded["SENSORS_FAST"]["time"]) == 8000
    truth = np.genfromtxt(tmp_path / "truth.csv", delimiter=",", names=True)
    assert np.allclose(truth["speed"], result.truth["speed"][::10], rtol=1e-8, atol=1e-12)


def test_dbc_of_the_folder_decodes_the_log(tmp_path: Path) -> None:
    cantools = pytest.importorskip("cantools")
    scenario = short(seconds=4.0)
    description = interface()
    folder = RunFolder(tmp_path, scenario, "inprocess", {}, description)
    result = run(scenario, observers=[folder])
    folder.finish(result)
    folder.close()
    database = cantools.database.load_file(tmp_path / "terrapin.dbc")
    frames = read(tmp_path / "telemetry.log")
    chosen = np.flatnonzero(frames.identifiers == description.messages["GROUND"].id)
    for number, index in enumerate(chosen):
        values = database.decode_message("GROUND", bytes(frames.data[index]), decode_choices=False)
        assert values["torque"] == pytest.approx(result.telemetry["GROUND"]["torque"][number], abs=1e-9)


def test_parameters_of_a_run_repeat_it(tmp_path: Path, terrapin: Callable[..., Done]) -> None:
    """run.toml is itself a file for --parameters."""
    given = tmp_path / "firmware.toml"
    given.write_text('[parameters]\ncomp_coulomb = "3 mN m"\nslip_limit = 0.4\n')
    first = terrapin("run", "carriage_limiter", "--parameters", str(given), "--out", str(tmp_path / "a"), "--json")
    second = terrapin("run", "carriage_limiter", "--parameters", str(tmp_path / "a" / "run.toml"), "--json")
    plain = terrapin("run", "carriage_limiter", "--json")
    hashes = [json.loads(done.stdout)["output_sha256"] for done in (first, second, plain)]
    assert hashes[0] == hashes[1] != hashes[2]
    assert [done.returncode for done in (first, second, plain)] == [1, 1, 0]  # slip is held at 0.4, not at 0.5


def test_candump_text() -> None:
    assert line(12.3456, 0x182, bytes(range(8))) == "(12.345600) can0 182#0001020304050607"


@pytest.mark.parametrize("text", ["nonsense\n", "(1.0) can0 18#00\n", "(1.0) can0 182#0\n", "(x) can0 182#00\n"])
def test_wrong_logs_name_the_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.log"
    path.write_text("(0.000000) can0 182#0011\n" + text)
    with pytest.raises(UserError, match=r"x\.log:2: found .*, expected candump text"):
        read(path)


def test_a_line_cut_off_by_a_crash_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_text("(0.000000) can0 182#0011\n(0.001000) can0 182#00")
    assert len(read(path).times) == 1


# ------------------------------------------------------------------ what goes wrong


def test_what_begins_after_the_end_is_said(tmp_path: Path, terrapin: Callable[..., Done]) -> None:
    """It did nothing, and no word said so. The last tick begins 1 ms before the end."""
    file, out = tmp_path / "late.toml", tmp_path / "batch"
    faults = "".join(f'[[fault]]\nkind = "command_silence"\nfrom = "{at}"\n' for at in ("1 s", "1.999 s", "2 s"))
    orders = "".join(f'[[operator]]\nat = {at}\nrequest = "{name}"\n' for at, name in ((0, "run"), (40, "idle")))
    file.write_text(f'duration = "2 s"\n[[path]]\nterrain = "sand"\n{orders}{faults}')
    expected = [
        "operator[2] (idle) begins at 40 s: the run ends before, at 2 s",
        "fault[3] (command_silence) begins at 2 s: the run ends before, at 2 s",
    ]
    assert json.loads(terrapin("run", str(file), "--json").stdout)["notes"] == expected
    for words in (terrapin("run", str(file)).stdout, terrapin("batch", str(file), "--out", str(out)).stdout):
        assert re.findall(r"(?m)^  note  (.*)$", words) == expected
    assert json.loads(terrapin("run", str(file), "--set", "duration=41", "--json").stdout)["notes"] == []
    shipped = [load_scenario(path) for path in paths.SCENARIOS.glob("*.toml")]
    assert [scenario.name for scenario in shipped if any("begins at" in note for note in scenario.notes)] == []


def test_the_command_line_says_what_is_wrong(tmp_path: Path, terrapin: Callable[..., Done]) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('duration = "1 parsec"\n')
    parameters = tmp_path / "p.toml"
    parameters.write_text('[parameters]\nradius = "8 V"\n')
    for arguments, message, status in (
        (["nowhere"], "no such file, and no scenario of that name", 2),
        ([str(wrong)], "wrong.toml:1: duration: found '1 parsec'", 2),
        (["steady_sand", "--link", "radio"], "expected one of inprocess, pty", 2),
        (["steady_sand", "--parameters", str(parameters)], "p.toml:2: parameters.radius: found '8 V'", 2),
        (["steady_sand", "--parameters", str(wrong)], "found no table [parameters]", 2),
        (["steady_sand", "--link", "serial:/dev/nothing"], "/dev/nothing: cannot open the link", 1),
        (["steady_sand", "--out", "/dev/null/x"], "/dev/null/x: cannot write the log", 1),
        (["steady_sand", "--out", str(wrong)], "wrong.toml: cannot write the log: found a file, expected a folder", 1),
    ):
        done = terrapin("run", *arguments)
        assert done.returncode == status, done.stderr
        assert message in done.stderr
        assert done.stderr.count("\n") == 1
        assert done.stdout == ""


class Stops:
    """A link that breaks after some ticks."""

    name = "stops"

    def __init__(self, inner: InProcess, ticks: int, error: BaseException) -> None:
        self.inner, self.ticks, self.error = inner, ticks, error

    def start(self, parameters: dict[str, float]) -> None:
        self.inner.start(parameters)

    def advance(self, simulation: Simulation, ticks: int) -> None:
        self.inner.advance(simulation, min(ticks, self.ticks - simulation.done))
        if simulation.done == self.ticks:
            raise self.error

    def close(self) -> None:
        self.inner.close()


@pytest.mark.parametrize("error", [LinkError("gone"), KeyboardInterrupt()])
def test_log_is_whole_up_to_the_moment_of_failure(tmp_path: Path, error: BaseException) -> None:
    scenario = short()
    folder = RunFolder(tmp_path, scenario, "stops", {}, interface())
    with pytest.raises(type(error)):
        run(scenario, Stops(InProcess(), 777, error), observers=[folder])  # type: ignore[arg-type]
    folder.close()
    frames = read(tmp_path / "telemetry.log")
    fast = frames.identifiers == interface().messages["SENSORS_FAST"].id
    assert np.sum(fast) == 777
    assert frames.times[-1] == pytest.approx(0.776)
    assert "complete = false" in (tmp_path / "run.toml").read_text()


def test_a_controller_that_is_killed(tmp_path: Path) -> None:
    process = ControllerProcess()
    path = process.start()
    link = open_link(f"serial:{path}")

    def kill(share: float) -> None:
        if share > 0.3 and process.process is not None:
            process.process.kill()

    folder = RunFolder(tmp_path, short(), "pty", {}, interface())
    with link, pytest.raises(LinkError, match=r"disappeared|no answer"):
        run(short(), link, observers=[folder], progress=kill)
    folder.close()
    process.stop()
    assert read(tmp_path / "telemetry.log").times[-1] >= 0.49


def test_a_controller_that_stops_answering() -> None:
    process = ControllerProcess()
    link = open_link(f"serial:{process.start()}")
    link._port.timeout = 0.3

    def freeze(share: float) -> None:
        if share > 0.3 and process.process is not None:
            process.process.send_signal(signal.SIGSTOP)

    with link, pytest.raises(LinkError, match=r"no answer within 0\.3 s"):
        run(short(), link, progress=freeze)
    assert process.process is not None
    process.process.send_signal(signal.SIGCONT)
    process.stop()


def test_ctrl_c(tmp_path: Path) -> None:
    scenario = tmp_path / "long.toml"
    text = find_scenario("steady_sand").read_text().replace('"10 s"', '"3000 s"')
    scenario.write_text(text)
    started = subprocess.Popen(
        [*TERRAPIN, "run", str(scenario), "--link", "pty", "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
    )
    log = tmp_path / "out" / "telemetry.log"
    wait_for(lambda: log.is_file() and log.stat().st_size > 100_000, "the log")
    started.send_signal(signal.SIGINT)
    out, error = started.communicate(timeout=300)
    assert started.returncode == 130
    assert error == f"terrapin: interrupted; the log up to here is in {tmp_path / 'out'}\n"
    assert out == ""
    frames = read(log)
    fast = np.sum(frames.identifiers == interface().messages["SENSORS_FAST"].id)
    actuate = np.sum(frames.identifiers == interface().messages["ACTUATE"].id)
    assert fast == actuate > 500


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_full_disk(tmp_path: Path, terrapin: Callable[..., Done]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in ("telemetry.log", "truth.csv"):  # the second complains when it is closed
        (out / name).symlink_to("/dev/full")
    done = terrapin("run", "steady_sand", "--out", str(out))
    assert done.returncode == 1
    assert done.stderr == f"terrapin: {out}: cannot write the log: No space left on device\n"


def test_not_built_yet(tmp_path: Path) -> None:
    done = subprocess.run(
        [*TERRAPIN, "run", "steady_sand"],
        env={**os.environ, "TERRAPIN_BUILD": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "not built yet; run `make setup`" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_library_of_other_sources_is_refused() -> None:
    code = "import terrapin_hil.library as l; print(l.library().hil_layout())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=paths.ROOT, check=True)
    assert int(done.stdout) & 0xFFFFFFFF == Simulation(short()).records.itemsize
