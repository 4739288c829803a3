"""A robot that lives on its buses: tools come and go, several at once, and it changes while it runs."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import can
import numpy as np
import pytest

from terrapin_hil.errors import UserError
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import LinkName
from terrapin_hil.links.slcan import SlcanPort
from terrapin_hil.messages import Sender, interface
from terrapin_hil.run.boot_loader import BootLoader
from terrapin_hil.run.changes_live import change
from terrapin_hil.run.control import Control
from terrapin_hil.run.living import Living
from terrapin_hil.run.ports import BusPort, PtyPort, open_port
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.commands.sim import _words
from tests.living import at_work
from tests.waiting import wait_for

PROGRAM = "from terrapin_tools.cli import main; main()"


def terrapin(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "TMPDIR": str(folder)}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def living(*ports: PtyPort | BusPort, scenario: str = "steady_sand") -> Living:
    return Living(load_scenario(find_scenario(scenario)), ports, told=lambda _: None)


def ticks_of(frames: list[tuple[int, bytes]]) -> list[int]:
    actuate = interface().messages["ACTUATE"]
    return [actuate.decode(data)["tick"] for identifier, data in frames if identifier == actuate.id]


def test_who_does_not_read_costs_the_others_no_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two attached; one never reads. The other has every tick, in order; the first one's frames are counted as lost."""
    monkeypatch.setattr("terrapin_hil.run.ports.DEAF", 600.0)  # however slow this machine is
    slow, good = PtyPort(), PtyPort()
    robot = living(slow, good)
    with closing(robot), closing(SlcanPort(slow.path)) as sleeper:
        with closing(SlcanPort(good.path)) as reader:
            for port, client in ((slow, sleeper), (good, reader)):
                client.send(b"O\r")
                port.read(robot._heard)
            seen: list[int] = []
            for _ in range(8000):
                robot.tick()
                if robot.simulation.ticks % 20 == 0:
                    reader._read(time.monotonic() + 1.0)
            seen = ticks_of(reader._frames)
            assert good.lost == 0
        assert len(seen) > 7900
        assert np.all(np.diff(seen) == 1)
        assert slow._untaken > 1000  # of whom it is not known yet whether it is gone


def test_frames_that_a_slow_tool_did_not_get_are_counted_once() -> None:
    """It reads now and then: what it got, what it lost and what still waits for it are all that was sent."""
    port = PtyPort()
    with closing(port), closing(SlcanPort(port.path)) as tool:
        tool.send(b"O\r")
        port.read(lambda *_: None)
        total = 0
        for _ in range(4):
            port.send([(0x180, bytes(8))] * 5000)  # more than waits for anybody
            total += 5000
            for _ in range(40):
                tool._read(time.monotonic() + 1.0)
                port.send([(0x180, bytes(8))])
                total += 1
        left = total - len(tool._frames) - port.lost - port._untaken - port._waiting.count(b"\r")
        assert port.lost > 1000
        assert 0 <= left < 1000  # in the terminal itself, and in the tool


@pytest.mark.parametrize("counted", [True, False])
def test_who_was_stopped_goes_on_and_who_is_gone_leaves_nothing(monkeypatch: pytest.MonkeyPatch, counted: bool) -> None:
    """A tool that stands still for long (a debugger, a lid that was shut) has frames again when it reads again, and
    what it missed is counted; a tool that was killed leaves no frame to the next, and none is counted.
    So it is where a busy kernel has not counted what is unread."""
    monkeypatch.setattr("terrapin_hil.run.ports.DEAF", 0.05)
    if not counted:
        monkeypatch.setattr(PtyPort, "_before_it", lambda _: 0)
    port = PtyPort()

    def flood(tool: SlcanPort) -> None:
        tool.send(b"C\rO\r")
        port.read(lambda *_: None)
        for _ in range(3):
            port.send([(0x180, bytes(8))] * 5000)
            time.sleep(0.1)

    with closing(port):
        with closing(SlcanPort(port.path)) as tool:
            flood(tool)
            for _ in range(200):
                port.send([(0x181, bytes(8))])
                tool._read(time.monotonic() + 1.0)
            seen = [identifier for identifier, _ in tool._frames]
            assert seen.count(0x181) > 100
            assert seen == sorted(seen)
            assert len(seen) + port.lost == 15200
            flood(tool)
        lost = port.lost
        with closing(SlcanPort(port.path)) as tool:
            tool.send(b"C\rO\r")
            port.read(lambda *_: None)
            port.send([(0x182, bytes(8))])

            def came() -> bool:  # a busy kernel brings the answer to O first, alone
                tool._read(time.monotonic() + 1.0)
                return bool(tool._frames) or port.lost > lost

            wait_for(came, "a frame, seen or counted as lost")
            assert [identifier for identifier, _ in tool._frames] == [0x182]
            assert port.lost == lost


def test_who_was_killed_a_moment_ago_leaves_nothing() -> None:
    """Nobody knows yet that there is no reader: what the kernel and the port hold is not the next one's."""
    port = PtyPort()
    with closing(port):
        for _ in range(20):
            with closing(SlcanPort(port.path)) as tool:
                tool.send(b"C\rO\r")
                port.read(lambda *_: None)
                port.send([(0x182, bytes(8))])
                wait_for(lambda tool=tool: tool._read(time.monotonic() + 1.0) or tool._frames, "a frame")
                assert [identifier for identifier, _ in tool._frames] == [0x182]
                port.send([(0x180, bytes(8))] * 1000)
        assert port.lost == 0


def test_a_pseudo_terminal_outlives_its_clients() -> None:
    port = PtyPort()
    asked = Sender().frame("IDENTITY_READ", {})
    with at_work(living(port)) as robot:
        for _ in range(3):
            with SlcanPort.open(port.path) as client:
                answers = client.exchange_frames([asked])
                assert interface().messages["IDENTITY"].id in [identifier for identifier, _ in answers]
        before = robot.simulation.time
        time.sleep(0.3)
        assert robot.simulation.time > before


def test_two_ports_are_one_bus() -> None:
    """What one tool sends the other hears; the controller's answer both."""
    first, second = PtyPort(), PtyPort()
    with at_work(living(first, second)), SlcanPort.open(first.path) as one, SlcanPort.open(second.path) as other:
        foreign = (0x7DF, b"\x01\x02")
        one.exchange_frames([foreign])
        assert foreign in other.exchange(b"F\r")


def test_it_keeps_to_the_clock_or_says_by_how_much_it_does_not() -> None:
    with at_work(living(PtyPort())) as robot:
        began = time.monotonic()
        time.sleep(1.0)
        lived, passed = robot.simulation.time, time.monotonic() - began
    assert abs(lived + robot.lag - passed) < 0.25
    assert robot.latest >= 0.0
    assert robot.punctual <= robot.latest + 1e-4


def test_it_changes_while_it_lives() -> None:
    robot = living(scenario="steady_sand")

    def after(seconds: float) -> dict[str, float]:
        for _ in range(round(seconds * 1000)):
            robot.tick()
        return dict(robot.state()["truth"])

    on_sand = after(6.0)
    assert change(robot, "ground = hard_floor") == "ground is hard_floor"
    on_floor = after(6.0)
    assert on_floor["contact_torque"] < 0.3 * on_sand["contact_torque"]
    assert on_floor["speed"] > on_sand["speed"]
    change(robot, "voltage = 4 V")
    assert after(6.0)["speed"] < 0.6 * on_floor["speed"]
    change(robot, "slope = 5deg")
    assert after(4.0)["contact_torque"] > 0.0
    change(robot, "estop = pressed")
    after(2.0)
    assert not robot.state()["bridge_on"]
    change(robot, "estop = released")
    change(robot, "slope = 0deg")
    change(robot, "request = clear")
    after(1.0)
    change(robot, "speed = 0.5 m/s")
    after(1.0)
    assert not robot.state()["bridge_on"]  # a clear starts nothing
    change(robot, "request = idle")
    after(0.1)
    change(robot, "speed = 0.5 m/s")
    assert after(4.0)["speed"] == pytest.approx(0.5, abs=0.05)
    change(robot, 'fault = {kind = "stuck", channel = "motor"}')
    assert [fault.kind for fault in robot.faults] == ["stuck"]
    change(robot, "fault = none")
    assert robot.faults == []
    robot.close()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ground = lava", "expected one of hard_floor"),
        ("ground", "expected NAME = VALUE"),
        ("weather = fine", "expected NAME = VALUE with one of ground"),
        ("slope = 90deg", "expected -1.2 to 1.2 rad"),
        ("voltage = 8 m", "expected a number in V"),
        ("fault = {kind = 'tired'}", "expected one of stuck"),
        ("fault = {kind = ", "not TOML"),
        ("estop = maybe", "expected one of pressed"),
    ],
)
def test_a_change_that_is_none_is_one_line_and_changes_nothing(text: str, words: str) -> None:
    robot = living()
    with pytest.raises(UserError) as found:
        change(robot, text)
    assert words in str(found.value)
    assert "\n" not in str(found.value)
    robot.tick()
    robot.close()


def test_status_says_which_fault_it_is_safe_for() -> None:
    """It said safe, and not why; after a reset it is safe for none."""
    robot = living()
    for _ in range(600):
        robot.tick()
    assert "fault" not in _words(robot.state())
    change(robot, "estop = pressed")
    for _ in range(200):
        robot.tick()
    said = _words(robot.state())
    assert "state safe, bridge off\n  fault estop: emergency stop pressed, or its wire broken\n" in said
    change(robot, "estop = released")
    change(robot, "reset = now")
    assert robot.state()["faults"] == {}
    robot.close()


def test_a_bus_that_vanishes_ends_it_with_one_line() -> None:
    port = BusPort(LinkName.parse("can:virtual:vanishing", "listen"))
    robot = living(port)
    for _ in range(5):
        robot.tick()
    port._bus.shutdown()
    with pytest.raises(LinkError, match=r"^can:virtual:vanishing: the bus is gone: "):
        robot.run(lambda: False)
    robot.close()


def test_tools_of_python_can_attach() -> None:
    port = open_port("can:virtual:living")
    robot = living(port)
    with closing(robot), can.Bus(interface="virtual", channel="living") as bus:
        for _ in range(50):
            robot.tick()
        heard = []
        while (message := bus.recv(0)) is not None:
            heard.append((message.arbitration_id, bytes(message.data)))
        assert len(ticks_of(heard)) == 50


def test_frames_of_sensors_from_outside_are_not_taken() -> None:
    port = PtyPort()
    robot = living(port)
    before = robot._link.dropped
    for name in ("TEST_MODE", "SENSORS_FAST", "SENSORS_SLOW"):
        robot._heard(port, [(interface().messages[name].id, bytes(8))])
    assert robot._link.dropped == before
    robot.close()


def test_a_reader_that_goes_ends_no_robot(tmp_path: Path) -> None:
    """As `terrapin sim --detach | head -1`: who started it may be cut off, the robot lives."""
    begun = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "sim", "--on", "pty:bus", "--detach"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
    )
    assert begun.stdout is not None
    begun.stdout.close()
    begun.wait()
    asked = terrapin("sim", "--do", "status", folder=tmp_path)
    ended = terrapin("sim", "--do", "stop", folder=tmp_path)
    assert (asked.returncode, ended.returncode) == (0, 0), asked.stderr


def test_the_command_detaches_changes_and_stops(tmp_path: Path) -> None:
    try:
        begun = terrapin("sim", "steady_sand", "--on", "pty:bus", "--on", "pty:more", "--detach", folder=tmp_path)
        assert (begun.returncode, begun.stderr) == (0, "")
        assert "terrapin monitor --link serial:bus" in begun.stdout
        twice = terrapin("sim", "--on", "pty:bus", folder=tmp_path)
        assert (twice.returncode, twice.stderr.count("\n")) == (2, 1)
        assert "a robot lives there already" in twice.stderr
        done = terrapin("sim", "--do", "ground = hard_floor", "--do", "status", folder=tmp_path)
        assert "ground is hard_floor" in done.stdout
        assert "real time: 99 % of ticks within" in done.stdout
        listed = terrapin("param", "get", "radius", "--link", "serial:bus", folder=tmp_path)
        assert listed.returncode == 0, listed.stderr
        run = terrapin("run", "steady_sand", "--link", "serial:bus", folder=tmp_path)
        assert run.returncode == 1
        assert (
            "goes on by itself, out of test mode: is its bridge on, or is it a robot of `terrapin sim`?" in run.stderr
        )
    finally:
        ended = terrapin("sim", "--do", "stop", folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
    for _ in range(100):
        if not (tmp_path / "bus").is_symlink():
            break
        time.sleep(0.05)
    assert not (tmp_path / "bus").is_symlink()
    told = terrapin("sim", "--do", "help", folder=tmp_path)  # before there is a robot, too
    assert "ground = hard_floor, agricultural" in told.stdout, told.stderr
    nobody = terrapin("sim", "--do", "status", folder=tmp_path)
    assert (nobody.returncode, nobody.stderr.count("\n")) == (2, 1)
    assert "no robot lives" in nobody.stderr


def test_it_says_how_to_attach_to_another_robot(tmp_path: Path) -> None:
    """`monitor` refuses a controller of another robot than it was told: the line that says how to attach names it."""
    name = "sphere"
    lives = terrapin("sim", name, "--on", "pty:bus", "--detach", folder=tmp_path)
    try:
        assert f"terrapin monitor --link serial:bus --robot {name}\n" in lives.stdout, lives.stderr
        status = terrapin("sim", "--do", "voltage = 9 V", "--do", "status", folder=tmp_path)
        assert "standing" not in status.stdout  # it moves
    finally:
        terrapin("sim", "--do", "stop", folder=tmp_path)


def test_a_flash_for_which_the_disk_has_no_place_leaves_no_half_of_it(tmp_path: Path) -> None:
    """It would be refused from then on: it has not the size of a chip's flash."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        with pytest.raises(UserError, match=r"chip.flash: File too large, expected a file that can be written"):
            BootLoader(tmp_path / "chip.flash")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def begun(folder: Path) -> subprocess.Popen[str]:
    """`terrapin sim --on pty:desk`, once it lives."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "sim", "--on", "pty:desk"],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert any("terrapin monitor --link serial:desk" in line for line in process.stdout)
    return process


def test_one_that_was_killed_leaves_its_name_to_the_next(tmp_path: Path) -> None:
    """Also where a client still has the terminal open, and another program has its number by then."""
    link, strangers = tmp_path / "desk", []
    first = begun(tmp_path)
    client = os.open(link, os.O_RDWR | os.O_NOCTTY)
    first.kill()
    first.communicate(timeout=30.0)
    for _ in range(20):  # of these one may have the number
        strangers += os.openpty()
    assert link.is_symlink()
    second = begun(tmp_path)
    try:
        there = os.readlink(link)
        twice = terrapin("sim", "--on", "pty:desk", folder=tmp_path)
        assert (twice.returncode, twice.stderr.count("\n")) == (2, 1)
        assert "a robot lives there already" in twice.stderr
        assert os.readlink(link) == there
    finally:
        second.terminate()
        second.communicate(timeout=30.0)
        for descriptor in (client, *strangers):
            os.close(descriptor)
    assert not link.is_symlink()


def test_a_link_of_the_living_or_of_others_is_refused_and_stays(tmp_path: Path) -> None:
    link = tmp_path / "desk"
    master, slave = os.openpty()
    with closing(PtyPort(link)):
        there = os.readlink(link)
        with pytest.raises(UserError, match="a robot lives there already"):
            PtyPort(link)
        assert os.readlink(link) == there
    assert not link.is_symlink()
    link.symlink_to(f"/dev/./{os.ttyname(slave).removeprefix('/dev/')}")  # left by one whose number another has now
    PtyPort(link).close()
    link.symlink_to(os.ttyname(slave))  # socat's, say
    with pytest.raises(UserError, match="File exists, expected a name that is free"):
        PtyPort(link)
    assert os.readlink(link) == os.ttyname(slave)
    os.close(master)
    os.close(slave)


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder for sockets, whose paths may have some hundred bytes: pytest's own is too long where it has workers."""
    with tempfile.TemporaryDirectory(prefix="sim") as folder:
        monkeypatch.setattr("tempfile.tempdir", folder)
        yield


@pytest.mark.usefixtures("short")
def test_a_socket_that_was_left_behind_is_taken_over() -> None:
    first = Control("pty:here")
    with pytest.raises(UserError, match="a robot lives there already"):
        Control("pty:here")
    first._socket.close()  # killed
    Control("pty:here").close()


@pytest.mark.parametrize("name", ["", "pty:", "udp", "bus", "serial:/dev/null"])
def test_a_bus_that_is_none(name: str) -> None:
    if name == "pty:":
        open_port(name).close()
        return
    with pytest.raises(UserError, match="expected pty, pty:PATH, socketcan"):
        open_port(name)
