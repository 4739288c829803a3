"""The Linux controller where there is neither CAN nor GPIO: its command line, and its bus through an SLCAN adapter.

What needs a kernel with both is in tests/sandbox."""

from __future__ import annotations

import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.links.bus import BusLink
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.slcan import slcan_line, slcan_parse
from terrapin_hil.messages import AnswerError, Frame, Sender, interface
from terrapin_hil.nodes import Node
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_hil.simulation import Simulation
from tests.waiting import BOUND, wait_for

PROGRAM = paths.build() / "terrapin-controller"
TERRAPIN = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the Linux controller is built on Linux")


class Adapter:
    """An SLCAN adapter's side of a pty (terrapin_hil.links.bus.Bus): acknowledges each line, as adapters do."""

    def __init__(self) -> None:
        self.name = "adapter"
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(slave)
        self._slave = slave
        self._rest = b""
        self._frames: list[Frame] = []
        self.commands: list[bytes] = []
        self.bell = False

    def write(self, text: bytes) -> None:
        while text:  # whoever reads may wait long for its processor, while the line is full
            assert select.select([], [self._master], [], BOUND)[1], "the line stays full"
            text = text[os.write(self._master, text) :]

    def send(self, frames: Sequence[Frame]) -> None:
        self.write(b"".join(map(slcan_line, frames)))

    def receive(self, wait: float) -> list[Frame]:
        end = time.monotonic() + wait
        while not self._frames:
            if not select.select([self._master], [], [], max(0.0, end - time.monotonic()))[0]:
                return []
            *lines, self._rest = (self._rest + os.read(self._master, 65536)).split(b"\r")
            for line in lines:
                if line[:1] == b"t":
                    self._frames.append(slcan_parse(line))
                else:
                    self.commands.append(line)
                self.write(b"\a" if self.bell else b"z\r" if line[:1] == b"t" else b"\r")
        frames, self._frames = self._frames, []
        return frames

    def close(self) -> None:
        if self._master >= 0:
            os.close(self._master)
            os.close(self._slave)
        self._master = self._slave = -1


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    made = Adapter()
    yield made
    made.close()


@pytest.fixture
def controller(adapter: Adapter) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [PROGRAM, "--adapter", adapter.path, "--priority", "0"], stderr=subprocess.PIPE, text=True
    )
    yield process
    process.kill()
    process.communicate()


def finish(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=300)
    assert process.returncode == 0
    return said


def short(seconds: float) -> Scenario:
    return replace(load_scenario(find_scenario("steady_sand")), duration=seconds, checks=())


def test_lockstep_through_an_adapter(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    with BusLink(adapter) as link:
        assert adapter.receive(BOUND)
        assert adapter.commands == [b"", b"C", b"S6", b"O"]
        result = run(short(1.0), link)
        assert result.output_hash == run(short(1.0)).output_hash
        said = finish(controller)
    assert "adapter: 0 lines refused, 0 malformed" in said
    assert "0 bad CRC, 0 repeated, 0 malformed" in said


REPLY = interface().messages["PARAMETER_VALUE"].id


class Altered:
    """A bus that loses what `lost` names on the way to the controller, and has `other` on it as well. The two give
    their replies at the same time, as two boards would: here one of them may wait long for its processor."""

    name = "altered"

    def __init__(self, adapter: Adapter, other: Adapter | None = None, lost: Sequence[str] = ()) -> None:
        self._lost = {interface().messages[name].id for name in lost}
        self._replies = {found: 0 for found in (adapter, other) if found is not None}

    def send(self, frames: Sequence[Frame]) -> None:
        for adapter in self._replies:
            adapter.send([frame for frame in frames if frame[0] not in self._lost])

    def _heard(self, adapter: Adapter, wait: float) -> list[Frame]:
        frames = adapter.receive(wait)
        self._replies[adapter] += [identifier for identifier, _ in frames].count(REPLY)
        return frames

    def receive(self, wait: float) -> list[Frame]:
        end = time.monotonic() + wait
        while True:
            both = [frame for adapter in self._replies for frame in self._heard(adapter, min(wait, 0.001))]
            for adapter in self._replies:
                while self._replies[adapter] < max(self._replies.values()):
                    late = self._heard(adapter, BOUND)
                    assert late
                    both += late
            if both or time.monotonic() > end:
                return both

    def close(self) -> None:
        pass


def test_a_second_controller_on_the_bus_is_one_line(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    """Both hear the host and both answer: neither a lockstep, nor a parameter that somebody refuses."""
    other = Adapter()
    second = subprocess.Popen([PROGRAM, "--adapter", other.path, "--priority", "0"], stderr=subprocess.DEVNULL)
    try:
        assert adapter.receive(BOUND)
        assert other.receive(BOUND)
        for parameters in ({}, {"supply_compensation": 1.0}):
            with (
                BusLink(Altered(adapter, other)) as link,
                pytest.raises(LinkError, match="altered: found more than one controller"),
            ):
                run(short(0.1), link, parameters=parameters)
    finally:
        second.kill()
        second.wait()
        other.close()


class Shared:
    """A bus with several adapters on it, as the host of one node has it: all hear what it sends, it hears all."""

    name = "shared"

    def __init__(self, adapters: Sequence[Adapter], node: int) -> None:
        self._adapters = adapters
        self._node = Node(node)
        self.others = 0  # frames of another node that came

    def send(self, frames: Sequence[Frame]) -> None:
        for adapter in self._adapters:
            adapter.send([self._node.to_bus(frame) for frame in frames])

    def receive(self, wait: float) -> list[Frame]:
        end = time.monotonic() + wait
        while True:
            heard = [frame for adapter in self._adapters for frame in adapter.receive(0.0)]
            own = [frame for each in heard if (frame := self._node.from_bus(each)) is not None]
            self.others += len(heard) - len(own)
            if own or time.monotonic() > end:
                return own
            time.sleep(0.0002)

    def close(self) -> None:
        pass


def test_two_nodes_on_one_bus(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    """Each is run in lockstep while the other steps by its own clock, and hears all of it; neither takes a frame of the
    other's."""
    other = Adapter()
    arguments = [PROGRAM, "--adapter", other.path, "--priority", "0", "--node", "3"]
    second = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
    try:
        assert adapter.receive(BOUND)
        assert other.receive(BOUND)
        for number in (0, 3):
            bus = Shared([adapter, other], number)
            with BusLink(bus) as link:
                assert run(short(1.0), link).output_hash == run(short(1.0)).output_hash
                link.talk(Sender().test_mode(False), 0.1)
                assert bus.others > 100
        for said in (finish(controller), finish(second)):
            assert "0 bad CRC, 0 repeated, 0 malformed" in said
    finally:
        second.kill()
        second.wait()
        other.close()


def test_a_controller_that_steps_by_itself_is_one_line(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    """It did not enter test mode, as one whose bridge is on."""
    assert adapter.receive(BOUND)
    with (
        BusLink(Altered(adapter, lost=["TEST_MODE"])) as link,
        pytest.raises(LinkError, match="altered: a controller goes on by itself, out of test mode"),
    ):
        run(short(0.1), link)


def test_a_frame_before_the_first_tick_is_one_line() -> None:
    simulation = Simulation(short(0.1))
    with pytest.raises(AnswerError, match="the controller sent 0x190 before the first tick"):
        simulation.append(simulation.done - 1, (0x190, bytes(8)))


def test_free_running_steps_by_the_clock(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    """Without test mode: its own ticks, without sensors faults of them, and never the bridge."""
    with BusLink(adapter) as link:
        sender = Sender()
        run_request = {"request": interface().enums["request"]["run"], "control": 0, "setpoint": 1000}
        names = interface().by_id
        heard: list[Frame] = []

        def talked() -> bool:
            heard.extend(link.talk([sender.frame("COMMAND", run_request)], 0.02))
            return sum(names[i].name == "ACTUATE" for i, _ in heard) > 100

        wait_for(talked, "a hundred ticks")
        said = finish(controller)
    actuate = [names[i].decode(data) for i, data in heard if names[i].name == "ACTUATE"]
    status = [names[i].decode(data) for i, data in heard if names[i].name == "STATUS"]
    assert all(tick["enable"] == 0 and tick["duty"] == 0 for tick in actuate)
    assert status[-1]["state"] == interface().enums["state"]["safe"]
    assert "late by" in said


def test_an_adapter_that_refuses_is_counted(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    adapter.bell = True
    for _ in range(20):
        assert adapter.receive(BOUND)
    adapter.write(b"rubbish\rt08\r")
    assert controller.stderr is not None
    refused = malformed = 0
    while malformed < 2:  # its report says how much of that it has read
        controller.send_signal(signal.SIGUSR1)
        while "adapter: " not in (line := controller.stderr.readline()):
            assert line, "it ended"
        refused, malformed = (int(line.split("adapter: ")[1].split()[i]) for i in (0, 3))
        adapter.receive(0.02)
    assert refused >= 20
    assert malformed == 2
    finish(controller)


def test_an_adapter_that_is_unplugged(adapter: Adapter, controller: subprocess.Popen[str]) -> None:
    assert adapter.receive(BOUND)
    path = adapter.path
    adapter.close()
    assert controller.stderr is not None
    while f"{path} went away" not in (line := controller.stderr.readline()):
        assert line, "it ended"
    assert controller.poll() is None
    finish(controller)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--can, --adapter: expected one of them"),
        (["--can"], "--can: needs a value"),
        (["--nope"], "--nope: unknown option"),
        (["--can", "a", "b"], "b: unexpected"),
        (["--can", "a", "--adapter", "b"], "--can, --adapter: expected one of them"),
        (["--can", "a", "--enable", "gpiochip0:1"], "--enable, --pwm: need --estop"),
        (["--can", "a", "--estop", "5"], "--estop: an offset needs its chip, as in gpiochip0:5"),
        (["--can", "a", "--estop", "x,active-high"], "--estop: 'active-high' is none of"),
        (["--can", "a", "--estop", ":3"], "--estop: expected LINE or CHIP:LINE"),
        (["--can", "a", "--estop", "x" * 300], "--estop: the name is too long"),
        (["--can", "a", "--motor-encoder", "a"], "--motor-encoder: expected two lines, A+B"),
        (["--can", "a", "--priority", "100"], "--priority: found '100', expected a number from 0 to 99"),
        (["--can", "a", "--debounce", "2x"], "--debounce: found '2x', expected a number"),
        (["--adapter", "a", "--bitrate", "123456"], "--bitrate: expected one of 10000, 20000"),
        (["--off"], "--off: needs --enable or --pwm"),
    ],
)
def test_bad_options_are_one_line(options: list[str], words: str) -> None:
    done = subprocess.run([PROGRAM, *options], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"terrapin-controller: {words}")
    assert done.stderr.count("\n") == 1


def test_help_has_an_example() -> None:
    done = subprocess.run([PROGRAM, "--help"], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Example: terrapin-controller --can can0 --estop" in done.stdout


def test_rig_files(tmp_path: Path) -> None:
    from terrapin_hil.reading import ReadingError
    from terrapin_hil.run.rig import load_rig

    good = 'reset = "gpiochip0:4,active-low"\nenable = "WATCH,pull-down"\nestop_limit = "3 ms"\n'
    (tmp_path / "rig.toml").write_text(good)
    config = load_rig(tmp_path / "rig.toml")
    assert config.reset is not None
    assert (config.reset.active_low, config.estop, config.estop_limit) == (True, None, 3e-3)
    for text, words in (
        ("", "found no line"),
        ('rset = "a"\nreset = "a"', r"rig.toml:1: rset: no such field; is `reset` meant"),
        ("reset = 4", r"rig.toml:1: reset: found 4, expected text"),
        ('reset = "4"', "an offset needs its chip"),
        ('reset = "a,b"', "expected .CHIP:.NAME_OR_OFFSET"),
        ('reset = "a"\nboot = "a"', "the same line twice"),
        ('reset = "a"\nestop_limit = "0 s"', "estop_limit: found '0 s', expected 0.0001 to 0.1 s"),
    ):
        (tmp_path / "rig.toml").write_text(text)
        with pytest.raises(ReadingError, match=words):
            load_rig(tmp_path / "rig.toml")


def test_a_rig_needs_a_board(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text('reset = "gpiochip0:4"\n')
    command = [*TERRAPIN, "run", "steady_sand", "--rig", str(tmp_path / "rig.toml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("terrapin: --rig is around a real board: found --link inprocess")


# ---- as a service


def test_the_unit_starts_again_whatever_ended_it(tmp_path: Path) -> None:
    """Also after many failed starts in a row, or an adapter that was unplugged; its end puts off the very line."""
    unit = (paths.ROOT / "firmware/ports/linux/terrapin-controller.service").read_text()
    rows = [row.split("=", 1) for row in unit.splitlines() if "=" in row and not row.startswith("#")]
    said = {row[0]: row[1] for row in rows}
    assert said["Restart"] == "always"
    assert said["StartLimitIntervalSec"] == "0"
    assert said["WatchdogSignal"] == "SIGKILL"  # a stopped process takes no other
    assert (said["WatchdogSec"], said["TimeoutAbortSec"]) == ("500ms", "1")
    assert said["BindsTo"] in said["WantedBy"].split()
    enable = said["Environment"].split("--enable ")[1].split()[0]
    assert said["ExecStopPost"].endswith(f"--off --enable {enable}")
    if (program := shutil.which("systemd-analyze")) is not None:
        file = tmp_path / "terrapin-controller.service"
        file.write_text(
            unit.replace("/usr/local/bin/terrapin-controller", "/bin/true").replace("/sbin/ip", "/bin/true")
        )
        done = subprocess.run([program, "verify", file], capture_output=True, text=True, check=False)
        assert "Unknown" not in done.stderr, done.stderr
