"""The Linux controller on real SocketCAN: lockstep, can-utils, error frames, a cable pulled, the kernel's SLCAN."""

from __future__ import annotations

import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from kit import Cable, Controller, Peer, count, run_shell, shell, vcan, wait_for

from terrapin_hil import paths
from terrapin_hil.links import open_link
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.slcan import ControllerProcess
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario

BOUND = 2000  # ticks a second of lockstep, two frames each way a tick
can_utils = pytest.mark.skipif(shutil.which("candump") is None, reason="can-utils is not installed")


def short(name: str, seconds: float) -> Scenario:
    return replace(load_scenario(find_scenario(name)), duration=seconds, checks=())


@pytest.fixture
def bus() -> Iterator[str]:
    with vcan() as name:
        yield name


@pytest.mark.parametrize("name", ["steady_sand", "slope_limiter", "link_silence"])
def test_lockstep_gives_the_hash_of_this_process(bus: str, name: str) -> None:
    scenario = short(name, 3.5)
    with Controller("--can", bus) as controller:
        assert run(scenario, f"socketcan:{bus}").output_hash == run(scenario).output_hash
        assert controller.stop() == 0
    assert count(controller.text, "steps") >= scenario.ticks - 300  # of which link_silence takes its part
    assert count(controller.text, "lost to a full queue") == count(controller.text, "not sent") == 0


def test_lockstep_speed(bus: str) -> None:
    """Printed for `make bench`, the best of three; here it must only stay in lockstep, at whatever speed."""
    scenario = short("steady_sand", 2.0)
    expected = run(scenario).output_hash
    rates = []
    with Controller("--can", bus), open_link(f"socketcan:{bus}") as link:
        for _ in range(3):
            result = run(scenario, link)
            assert result.output_hash == expected
            rates.append(scenario.ticks / result.timing.seconds)
    print(f"SocketCAN lockstep: {max(rates):.0f} ticks/s (bound {BOUND})")


def test_python_can_gives_the_same_hash(bus: str) -> None:
    scenario = short("steady_sand", 0.5)
    with Controller("--can", bus):
        assert run(scenario, f"can:socketcan:{bus}").output_hash == run(scenario).output_hash


@can_utils
def test_candump_writes_what_both_said(bus: str) -> None:
    from terrapin_tools.logs.candump import read

    scenario = short("steady_sand", 1.0)
    log = Path(os.environ["TMPDIR"]) / "bus.log"
    with log.open("w") as file:
        dump = subprocess.Popen(["candump", "-L", "-r", "8388608", bus], stdout=file)  # it is slower than they are
        time.sleep(0.5)
    with Controller("--can", bus) as controller:
        result = run(scenario, f"socketcan:{bus}")
        assert controller.stop() == 0
        wait_for(lambda: log.read_text().count(" 100#") == scenario.ticks, "the log")
        time.sleep(0.3)  # the last answer
        dump.terminate()
        dump.wait()
    found = read(log).identifiers
    assert (found == 0x100).sum() == scenario.ticks
    assert (found == 0x180).sum() == count(controller.text, "steps")  # before test mode it steps by its clock
    assert ((found > 0x180) & (found <= 0x18F)).sum() >= (result.records["answer_count"] - 1).sum()


@can_utils
def test_cansend_and_candump_talk_to_it(bus: str) -> None:
    with Controller("--can", bus):
        dump = subprocess.Popen(["candump", "-n", "1", "-L", f"{bus},190:7FF"], stdout=subprocess.PIPE, text=True)
        time.sleep(0.3)
        shell("cansend", bus, "082#0000")  # PARAMETER_READ of the first one: the radius, 80000 um
        answer, _ = dump.communicate(timeout=10)
        assert "190#000080380100" in answer  # index, value
        dump = subprocess.Popen(["candump", "-n", "10", "-L", f"{bus},180:7FF"], stdout=subprocess.PIPE, text=True)
        ticks, _ = dump.communicate(timeout=10)
        assert len(ticks.splitlines()) == 10


def test_frames_for_others_are_no_work(bus: str) -> None:
    """Filtered by the kernel: other identifiers, extended and remote frames do not even arrive."""
    with Controller("--can", bus) as controller, Peer(bus) as peer:
        for identifier in (0x010, 0x200, 0x7FF, 0x80000080, 0x40000080, 0x108):
            for _ in range(20):
                peer.send((identifier, bytes(8)))
        for _ in range(7):
            peer.send((0x08F, b"\x01"))  # within the filter, unknown
        wait_for(lambda: count(controller.report(), "unknown") == 7, "7 unknown frames")
        assert count(controller.said(), "frames received") == 7


def test_flood_leaves_the_step_alone(bus: str) -> None:
    """Parameter reads as fast as they go: the queue is bounded, every tick is taken or counted as missed."""
    with Controller("--can", bus) as controller, Peer(bus) as peer:
        wait_for(lambda: count(controller.report(), "steps") > 100, "it runs")
        end = time.monotonic() + 1.0
        sent = 0
        while time.monotonic() < end:
            try:
                peer.send((0x082, bytes(2)))
            except OSError:  # our own queue is full
                continue
            sent += 1
        peer.listen()
        text = controller.report()
        assert peer.last["PARAMETER_VALUE"]["value"] == 80000
        taken = count(text, "frames received") + count(text, "lost to a full queue")
        assert taken <= sent
        assert count(text, "ticks by the clock") == count(text, "steps")
        assert count(text, "ticks by the clock") + count(text, "missed") > 1000


def test_what_the_queue_loses_is_counted_to_the_frame(bus: str) -> None:
    """The controller stands still while frames come: those that have no place are told with the next that has one."""
    with Controller("--can", bus) as controller, Peer(bus) as peer:
        wait_for(lambda: count(controller.report(), "steps") > 10, "it runs")
        lost = received = sent = 0
        for turn in (1, 2):
            controller.send_signal(signal.SIGSTOP)
            for _ in range(400):
                peer.send((0x08F, b"\x01"))
                time.sleep(0.0002)
            controller.send_signal(signal.SIGCONT)
            wait_for(lambda before=received: count(controller.report(), "frames received") > before, "it goes on")
            peer.send((0x08F, b"\x01"))
            sent += 401
            wait_for(
                lambda sent=sent: (
                    count(text := controller.report(), "frames received") + count(text, "lost to a full queue") == sent
                ),
                f"each of {sent} frames is received or lost, turn {turn}",
            )
            now = count(controller.said(), "lost to a full queue")
            assert now > lost
            lost, received = now, count(controller.said(), "frames received")


def test_error_frames_are_counted_and_said(bus: str) -> None:
    with Controller("--can", bus) as controller, Peer(bus) as peer:
        wait_for(lambda: count(controller.report(), "steps") > 10, "it runs")
        steps = [
            ((0x04, 0x08), "error warning"),
            ((0x04, 0x30), "error passive"),
            ((0x20,), ""),  # no acknowledge
            ((0x40,), "bus-off"),
            ((0x100,), "error active"),
        ]
        for arguments, state in steps:
            peer.error(*arguments)
            if state:
                wait_for(lambda state=state: f"{bus}: {state}\n" in controller.said(), state)
        peer.error(0x08)  # a protocol violation
        wait_for(lambda: count(controller.report(), "other") == 1, "one other error")
        text = controller.said()
        for words in ("warning", "passive", "bus-off", "restarted", "no acknowledge"):
            assert count(text, words) == 1, words


def test_cable_pulled_and_back(bus: str) -> None:
    with Controller("--can", bus) as controller:
        with Peer(bus) as peer:
            peer.keep("idle", lambda: "STATUS" in peer.last, "a STATUS")
        shell("ip", "link", "set", bus, "down")
        wait_for(lambda: f"{bus}: down\n" in controller.said(), "it notices")
        steps = count(controller.report(), "steps")
        wait_for(lambda: count(controller.report(), "steps") > steps + 100, "it goes on stepping")
        assert count(controller.said(), "not sent") > 0
        shell("ip", "link", "set", bus, "up")
        wait_for(lambda: f"{bus}: error active\n" in controller.said(), "it is back")
        with Peer(bus) as peer:
            wait_for(lambda: (peer.listen(), "STATUS" in peer.last)[1], "a STATUS again")
        assert (
            run(short("steady_sand", 0.2), f"socketcan:{bus}").output_hash == run(short("steady_sand", 0.2)).output_hash
        )
        assert controller.stop() == 0


def test_interface_unplugged_and_back(bus: str) -> None:
    with Controller("--can", bus) as controller:
        wait_for(lambda: count(controller.report(), "sent") > 100, "it runs")
        shell("ip", "link", "del", bus)
        wait_for(lambda: f"{bus} went away" in controller.said(), "it notices")
        with vcan(bus), Peer(bus) as peer:
            wait_for(lambda: (peer.listen(), "STATUS" in peer.last)[1], "a STATUS on the new interface")
            assert controller.stop() == 0


@can_utils
def test_a_recording_has_every_frame_and_ends_with_its_bus(bus: str) -> None:
    from terrapin_tools.logs.candump import read as read_candump
    from terrapin_tools.logs.reading import read_log

    folder = Path(os.environ["TMPDIR"])
    log, dumped = folder / "recorded.blf", folder / "dumped.log"
    words = os.memfd_create("words")
    with dumped.open("w") as file:
        dump = subprocess.Popen(["candump", "-L", "-r", "8388608", bus], stdout=file)
    with Controller("--can", bus) as controller:
        command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", "log", "record", log]
        recorder = subprocess.Popen([*command, "--link", f"socketcan:{bus}"], stdout=words, stderr=words)
        wait_for(lambda: log.exists() and log.stat().st_size > 2000, "frames in the log")
        shell("ip", "link", "del", bus)
        assert recorder.wait(30) == 1
        assert controller.stop() == 0
    dump.wait(10)
    said = os.pread(words, 1 << 20, 0).decode()
    assert "the bus went away" in said
    assert "lost" not in said
    recorded, seen = (
        [(int(log.identifiers[i]), log.payload(i)) for i in range(len(log))]
        for log in (read_log(log)[0], read_candump(dumped))
    )
    assert len(recorded) > 100
    first = next(i for i in range(len(seen)) if seen[i : i + 20] == recorded[:20])  # candump began before
    assert recorded[: len(seen) - first] == seen[first:]


def test_run_over_a_bus_that_goes_away_is_one_error(bus: str) -> None:
    with Controller("--can", bus), open_link(f"socketcan:{bus}") as link:
        run(short("steady_sand", 0.1), link)
        shell("ip", "link", "set", bus, "down")
        with pytest.raises(LinkError, match=rf"socketcan:{bus}: "):
            run(short("steady_sand", 0.1), link)


def test_two_controllers_are_one_error(bus: str) -> None:
    with Controller("--can", bus), Controller("--can", bus):
        for link in (f"socketcan:{bus}", f"can:socketcan:{bus}"):
            with pytest.raises(
                LinkError, match=rf"{link.removeprefix('can:')}: found more than one controller with this node number"
            ):
                run(short("steady_sand", 0.1), link)


def test_bus_off_ends_a_run(bus: str) -> None:
    with Peer(bus) as peer, open_link(f"socketcan:{bus}") as link:
        peer.error(0x40)
        with pytest.raises(LinkError, match=rf"socketcan:{bus}: bus-off"):
            run(short("steady_sand", 0.1), link)


def test_no_interface_no_controller() -> None:
    for options, words in (
        (["--can", "nope0"], "cannot open nope0: No such device"),
        (["--can", "vcan9"], "cannot open vcan9: Network is down"),
        (["--adapter", "/dev/nope"], "cannot open /dev/nope: No such file"),
    ):
        if "vcan9" in options:
            shell("ip", "link", "add", "dev", "vcan9", "type", "vcan")
        with Controller(*options) as controller:
            assert controller.process.wait(10) == 1
        assert controller.text.startswith(f"terrapin-controller: {words}")
        assert controller.text.count("\n") == 1
    shell("ip", "link", "del", "vcan9")
    done = run_shell([str(paths.ROOT / ".venv/bin/terrapin"), "run", "steady_sand", "--link", "socketcan:nope0"])
    assert done.returncode == 1
    assert done.stderr == "terrapin: socketcan:nope0: cannot open the link: No such device\n"


# ---- SLCAN


@can_utils
def test_lockstep_through_the_kernels_slcan() -> None:
    """Our SLCAN on a pty, the kernel's driver at its other end: an interface like any other, the same hash."""
    scenario = short("steady_sand", 1.0)
    with ControllerProcess() as path:
        daemon = subprocess.Popen(["slcand", "-F", "-o", "-c", "-s6", path])
        try:
            wait_for(lambda: Path("/sys/class/net/can0").exists(), "the interface can0")
            shell("ip", "link", "set", "can0", "up")
            result = run(scenario, "socketcan:can0")
            assert result.output_hash == run(scenario).output_hash
            print(f"through the kernel's slcan: {scenario.ticks / result.timing.seconds:.0f} ticks/s")
        finally:
            daemon.send_signal(signal.SIGTERM)
            daemon.wait(10)


@can_utils
def test_adapter_on_a_serial_port() -> None:
    """The controller behind an SLCAN adapter, which is the kernel's slcan on the other side of a pty."""
    scenario = short("steady_sand", 1.0)
    master, slave = pty.openpty()
    relay, other = pty.openpty()
    cable = Cable(master, relay)
    daemon = subprocess.Popen(["slcand", "-F", os.ttyname(other)])
    try:
        wait_for(lambda: Path("/sys/class/net/can0").exists(), "the interface can0")
        shell("ip", "link", "set", "can0", "up")
        with Controller("--adapter", os.ttyname(slave)) as controller:
            result = run(scenario, "socketcan:can0")
            assert controller.stop() == 0
        assert result.output_hash == run(scenario).output_hash
        assert count(controller.text, "malformed") == 0
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.wait(10)
        cable.close()
        for descriptor in (master, slave, relay, other):
            os.close(descriptor)


@can_utils
def test_bus_off_of_the_kernels_driver() -> None:
    """An adapter that reports its state: the kernel's driver makes the error frames, the controller reads them."""
    master, slave = pty.openpty()
    daemon = subprocess.Popen(["slcand", "-F", os.ttyname(slave)])
    try:
        wait_for(lambda: Path("/sys/class/net/can0").exists(), "the interface can0")
        shell("ip", "link", "set", "can0", "up")
        with Controller("--can", "can0") as controller:
            drain = Cable(master, None)
            wait_for(lambda: count(controller.report(), "sent") > 10, "it runs")
            os.write(master, b"sp130140\r")
            wait_for(lambda: "can0: error passive\n" in controller.said(), "error passive")
            os.write(master, b"sb000255\r")
            wait_for(lambda: "can0: bus-off\n" in controller.said(), "bus-off")
            assert count(controller.report(), "bus-off") == 1
            assert controller.stop() == 0
            drain.close()
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.wait(10)
        os.close(master)
        os.close(slave)
