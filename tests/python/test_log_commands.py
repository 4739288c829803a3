"""`terrapin log`, as a user types it."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import can
import numpy as np
import pyarrow.parquet
import pytest

from terrapin_hil import paths
from terrapin_hil.messages import interface
from terrapin_interface.robot import identity_of
from terrapin_tools import Log
from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import description_of
from terrapin_tools.logs.frames import Frames
from terrapin_tools.logs.reading import read_log
from terrapin_tools.logs.writing import LogWriter
from tests.command import terrapin
from tests.own_bus import own_multicast, unread
from tests.waiting import BOUND, wait_for

TERRAPIN = str(Path(sys.executable).parent / "terrapin")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    scenario = folder / "short.toml"
    text = (paths.SCENARIOS / "steady_sand.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("checks", "duration", '  "', "]"))]
    scenario.write_text("\n".join(['duration = "2 s"', *lines]))
    terrapin("run", scenario, "--out", folder / "out")
    return folder / "out"


def test_info(run: Path) -> None:
    answer = json.loads(terrapin("log", "info", run, "--json", "-").stdout)
    assert answer["cut"] == ""
    assert (answer["begin"], answer["end"]) == (0.0, 1.999)
    counts = {m["name"]: m["frames"] for m in answer["messages"]}
    assert counts["ACTUATE"] == counts["SENSORS_FAST"] == 2000
    assert all(m["gap"] is None for m in answer["messages"])


def test_info_of_gap_cut_and_steps_back(tmp_path: Path) -> None:
    """What is wrong with a log is said: a silence, a clock that jumps, an end without its line feed."""
    times = [*np.arange(100) * 0.01, *(5.0 + np.arange(100) * 0.01), 5.5]
    rows = "".join(f"({t:.6f}) can0 123#00\n" for t in times)
    (tmp_path / "x.log").write_text(rows + "(6.0) can0 12")
    answer = json.loads(terrapin("log", "info", tmp_path / "x.log", "--json", "-").stdout)
    assert answer["messages"][0]["gap"] == pytest.approx({"begin": 0.99, "seconds": 4.01})
    assert answer["steps_back"] == 1
    assert answer["cut"]


@pytest.mark.parametrize("kind", ["blf", "asc", "mf4", "mcap", "parquet"])
def test_convert_and_replay(run: Path, tmp_path: Path, kind: str) -> None:
    """There and back the firmware gives the same answers."""
    terrapin("log", "convert", run, tmp_path / f"x.{kind}")
    terrapin("log", "convert", tmp_path / f"x.{kind}", tmp_path / "back.log")
    assert (tmp_path / "back.log").read_text() == (run / "telemetry.log").read_text()


def test_convert_to_signals(run: Path, tmp_path: Path) -> None:
    terrapin("log", "convert", run, tmp_path / "x.parquet", "--period", "20ms")
    table = pyarrow.parquet.read_table(tmp_path / "x.parquet")
    np.testing.assert_allclose(table["time"].to_numpy(), np.arange(100) * 0.02)
    assert "GROUND.torque" in table.column_names


def test_convert_refuses(run: Path, tmp_path: Path) -> None:
    there = tmp_path / "x.log"
    there.write_text("keep")
    assert "exists already" in terrapin("log", "convert", run, there, status=2).stderr
    assert there.read_text() == "keep"
    assert "unknown kind of log '.txt'" in terrapin("log", "convert", run, tmp_path / "x.txt", status=2).stderr
    said = terrapin("log", "convert", run, tmp_path / "x.csv", "--period", "soon", status=2).stderr
    assert "--period: found 'soon', expected a time" in said
    said = terrapin("log", "convert", run, tmp_path / "no" / "x.blf", status=2).stderr
    assert f"x.blf: there is no folder {tmp_path / 'no'}" in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.log"]


def test_replay(run: Path, tmp_path: Path) -> None:
    """The same answers; with one parameter changed, others, told with message, signal and time."""
    assert "every answer is the recorded one" in terrapin("log", "replay", run).stdout
    text = (run / "run.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace('torque_constant = "0.1 N m/A"', 'torque_constant = "0.11 N m/A"'))
    done = terrapin("log", "replay", run, "--parameters", tmp_path / "p.toml", "--json", "-", status=1)
    answer = json.loads(done.stdout)
    assert 0 < answer["different_ticks"] < answer["ticks"]
    assert answer["first"][0]["message"] in ("GROUND", "STATUS", "ELECTRICAL", "ACTUATE")
    assert answer["first"][0]["recorded"] != answer["first"][0]["now"]


def test_replay_of_another_robots_run_names_the_robot(run: Path, tmp_path: Path) -> None:
    """Its frames have other steps: every tick would differ, or a parameter be out of a range that is not its own."""
    (tmp_path / "run.toml").write_text((run / "run.toml").read_text().replace('"cylinder"', '"sphere"'))
    done = terrapin("log", "replay", run, "--parameters", tmp_path / "run.toml", status=2)
    assert "run.robot: found 'sphere', expected 'cylinder': name it with --robot" in done.stderr


def test_replay_of_what_a_crash_left(run: Path, tmp_path: Path) -> None:
    """The tick in which the log ends may lack answers: no difference. Without a run.toml it says whose parameters."""
    whole = (run / "telemetry.log").read_text().splitlines(keepends=True)
    answered = [i for i, line in enumerate(whole) if " 180#" in line]  # the first answer of a tick that has two
    last = next(i for i in reversed(answered) if i + 1 < len(whole) and " 18" in whole[i + 1])
    (tmp_path / "x.log").write_text("".join(whole[: last + 1]) + whole[last + 1][:-6])
    done = terrapin("log", "replay", tmp_path / "x.log")
    assert "every answer is the recorded one" in done.stdout
    assert "no run.toml beside" in done.stdout
    assert "run.toml" not in terrapin("log", "replay", run).stdout


def test_replay_of_a_log_that_says_whose_it_is(run: Path, tmp_path: Path) -> None:
    """A log of a bus, without its run.toml, holds the controller's IDENTITY; else it says what it assumed."""
    sphere, own = identity_of("sphere"), int(interface().constants["interface_identity"])
    log = (run / "telemetry.log").read_text()
    for robot, status, words in ((sphere, 2, "that of sphere, expected cylinder; --robot says whose"),
                                 (identity_of("cylinder"), 0, "every answer is the recorded one")):  # fmt: skip
        values = {"robot": robot, "interface": own, "board": 0, "version": interface().version}
        said = bytes(interface().messages["IDENTITY"].encode(values)[0]).hex().upper()
        (tmp_path / "x.log").write_text(f"(0.000000) can0 198#{said}\n{log}")
        done = terrapin("log", "replay", tmp_path / "x.log", status=status)
        assert words in done.stdout + done.stderr
    assert "parameters at their defaults of robot cylinder" in done.stdout


def test_replay_needs_ticks(tmp_path: Path) -> None:
    (tmp_path / "x.log").write_text("(0.0) can0 123#00\n")
    assert "no SENSORS_FAST" in terrapin("log", "replay", tmp_path / "x.log", status=2).stderr


def recorded(path: Path) -> int:
    """Frames in a log that is being written."""
    try:
        return len(read_log(path)[0])
    except UserError:  # not begun yet
        return 0


@pytest.mark.parametrize("kind", ["log", "blf", "mf4", "mcap"])
def test_record_survives_kill(tmp_path: Path, kind: str) -> None:
    """A recorder killed in the act leaves all but the last half second; nothing is lost until then."""
    group, port = own_multicast()
    path = tmp_path / f"x.{kind}"
    command = [TERRAPIN, "log", "record", str(path), "--link", f"can:udp_multicast:{group}?port={port}"]
    with (
        can.Bus(interface="udp_multicast", channel=group, port=port) as bus,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process,
    ):
        end = time.monotonic() + BOUND
        sent = 0
        while time.monotonic() < end:
            bus.send(can.Message(arbitration_id=0x123, data=sent.to_bytes(4, "big"), is_extended_id=False))
            sent += 1
            bus.recv(0)  # hears itself, too
            wait_for(lambda: unread(port) == 0, "the recorder to read")  # else the kernel drops what it has no room for
            time.sleep(0.005)
            if sent % 50 == 0 and recorded(path) > 20:
                break
        process.send_signal(signal.SIGKILL)
    frames, _ = read_log(path)
    numbers = [int.from_bytes(frames.payload(i), "big") for i in range(len(frames))]
    assert len(numbers) > 20
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_record_refuses(tmp_path: Path) -> None:
    done = terrapin("log", "record", tmp_path / "x.parquet", "--link", "can:virtual:x", status=2)
    assert "expected one of .log .blf .mf4 .mcap" in done.stderr
    done = terrapin("log", "record", tmp_path / "x.log", "--link", "nonsense", status=2)
    assert "expected one of socketcan:CHANNEL" in done.stderr
    done = terrapin("log", "record", tmp_path / "x.log", "--link", "socketcan:can9", status=1)
    assert "cannot open the link" in done.stderr
    assert not (tmp_path / "x.log").exists()


def test_record_for_a_time(tmp_path: Path) -> None:
    terrapin("log", "record", tmp_path / "x.mcap", "--link", "can:virtual:terrapin", "--duration", 0.3)
    frames, cut = read_log(tmp_path / "x.mcap")
    assert (len(frames), cut) == (0, "")


def test_a_record_of_another_robot_has_its_dbc_beside(tmp_path: Path) -> None:
    """--robot did nothing: the log of another robot was then read in the cylinder's steps, torques a thirtieth."""
    for name in ("x.log", "y.blf"):
        terrapin("log", "record", tmp_path / name, "--link", "can:virtual:s", "--duration", "0.1", "--robot", "sphere")
    assert "Controller of robot sphere" in (tmp_path / "terrapin.dbc").read_text(encoding="cp1252")
    assert description_of(tmp_path / "x.log") == description_of(tmp_path) == (tmp_path / "terrapin.dbc", True)
    (tmp_path / "other").mkdir()
    assert description_of(tmp_path / "other" / "x.log") == (paths.dbc(), False)

    (tmp_path / "terrapin.dbc").write_text("of somebody")
    done = terrapin(
        "log", "record", tmp_path / "z.log", "--link", "can:virtual:s", "--robot", "sphere", status=2
    )  # fmt: skip
    assert "terrapin.dbc: is there and another than that of the sphere" in done.stderr
    assert not (tmp_path / "z.log").exists()


def test_whose_steps_a_log_is_read_in(run: Path, tmp_path: Path) -> None:
    """Without a DBC beside it a log is read as the cylinder's, and that was not said."""
    assert "in steps of" not in terrapin("look", run / "telemetry.log").stdout
    alone = Path(shutil.copy(run / "telemetry.log", tmp_path))
    assert "in steps of the cylinder: nothing says whose log it is" in terrapin("look", alone).stdout
    log = Log(run / "telemetry.log")
    assert log.dbc == run / "terrapin.dbc"
    columns = ("--column", "f=GROUND.torque", "--unit", "f=N m", "--column", "x=ELECTRICAL.current", "--unit", "x=A")
    made = ("--base", "equation", "--equation", "f=k*x", "--fit", "k=1", *columns)
    said = "telemetry.log: in steps of the cylinder, as no DBC says otherwise"
    assert said in terrapin("case", "map", alone, "--to", tmp_path / "a", *made).stdout
    assert said not in terrapin("case", "map", run / "telemetry.log", "--to", tmp_path / "b", *made).stdout


def test_full_disk(run: Path, tmp_path: Path) -> None:
    """A log that cannot be written is one clear error."""
    (tmp_path / "x.log").symlink_to("/dev/full")
    with pytest.raises(UserError, match="No space left"), LogWriter(tmp_path / "x.log") as writer:
        writer.write(read_log(run)[0])


def test_a_bus_is_not_called_empty_because_the_disk_is_full(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import terrapin_tools.logs.bus

    class Busy:
        lost = damaged = 0

        def receive(self, seconds: float) -> Frames:
            return read_log(run)[0]

        def shutdown(self) -> None: ...

    def full(writer: LogWriter) -> None:
        raise UserError("x.log: cannot write the log: No space left on device", status=1)

    monkeypatch.setattr(terrapin_tools.logs.bus, "open_bus", lambda *_: Busy())
    monkeypatch.setattr(LogWriter, "flush", full)
    done = terrapin("log", "record", tmp_path / "x.log", "--link", "can:virtual:busy", status=1)
    assert done.stderr == "terrapin: x.log: cannot write the log: No space left on device\n"


def test_an_empty_bus_is_called_one(tmp_path: Path) -> None:
    done = terrapin("log", "record", tmp_path / "nothing.log", "--link", "can:virtual:nobody", "--duration", "0.5")
    assert done.stdout == f"0 frames in {tmp_path / 'nothing.log'}\n"
    assert done.stderr.startswith("can:virtual:nobody: nothing received: is the bus up")
