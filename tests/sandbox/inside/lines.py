"""E-stop, enable line, LED and encoders of the Linux controller on simulated GPIO."""

from __future__ import annotations

import os
import re
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from kit import Controller, Lines, Peer, codes, count, lines, run_shell, vcan, wait_for, wired

from terrapin_hil import paths
from terrapin_hil.run.rig import Rig, RigConfig, parse_line

NAMES = ("ESTOP", "ENABLE", "LED", "MA", "MB", "PRESS", "WATCH", "RESET")
LINES = ["--estop", "ESTOP", "--enable", "ENABLE", "--led", "LED"]
EDGE = 0.015  # s: gpio-sim tells of edges at the kernel's tick of 10 ms, and of the last one only
TERRAPIN = str(paths.ROOT / ".venv/bin/terrapin")

if not (version := run_shell([str(paths.build() / "terrapin-controller"), "--version"]).stdout).count("libgpiod"):
    raise RuntimeError(f"no controller: {version}")
pytestmark = pytest.mark.skipif("without libgpiod" in version, reason="terrapin-controller was built without libgpiod")


@pytest.fixture
def chip() -> Iterator[Lines]:
    with vcan(), lines(*NAMES) as made:
        made.pull("ESTOP", True)  # the closed circuit of an e-stop that is not pressed
        yield made


@pytest.fixture
def options() -> Iterator[list[str]]:
    with tempfile.TemporaryDirectory() as folder:
        yield ["--can", "vcan0", *LINES, *codes(Path(folder))]


def enabled(chip: Lines, peer: Peer) -> None:
    peer.keep("clear", lambda: peer.last.get("STATUS", {}).get("ready") == 1, "ready")
    peer.command("idle")  # a clear starts nothing: this permits it
    peer.keep("run", lambda: chip.value("ENABLE"), "the enable line on")


def faults(peer: Peer) -> int:
    peer.listen()
    return peer.last["STATUS"]["faults"]


def estop_words(text: str) -> tuple[int, int, int]:
    """What a report says of the e-stop: presses, those that were timed, the slowest of them in us."""
    presses, timed, within = re.findall(
        r"e-stop (\d+) times, (\d+) timed from the edge(?:, enable off within (\d+) us of it)?;", text
    )[-1]
    assert bool(within) == (int(timed) > 0)
    return int(presses), int(timed), int(within or 0)


def test_estop_puts_the_bridge_off(chip: Lines, options: list[str]) -> None:
    with Controller(*options) as controller, Peer() as peer:
        assert not chip.value("ENABLE")
        enabled(chip, peer)
        chip.pull("ESTOP", False)
        wait_for(lambda: not chip.value("ENABLE"), "enable off")
        peer.keep("run", lambda: faults(peer) & 1 == 1, "fault estop")
        for _ in range(10):  # pressed, it stays off whatever is asked
            peer.command("clear")
            peer.command("run")
            time.sleep(0.01)
            assert not chip.value("ENABLE")
        assert faults(peer) & 1 == 1
        chip.pull("ESTOP", True)
        time.sleep(0.1)
        peer.keep("run", lambda: peer.last["STATUS"]["state"] == 8, "safe until cleared")
        assert not chip.value("ENABLE")
        enabled(chip, peer)
        assert controller.stop() == 0
    assert not chip.value("ENABLE")
    presses, timed, within = estop_words(controller.text)
    assert presses == 1
    if timed:
        print(f"enable off within {within} us of the e-stop's edge")
    else:
        print("enable off by the e-stop's level: the edge was told later")


def test_a_bounce_is_a_press(chip: Lines, options: list[str]) -> None:
    """The line comes back at once: the edge counts, and holds for the whole debouncing time."""
    with Controller(*options, "--debounce", "200") as controller, Peer() as peer:
        enabled(chip, peer)
        chip.pull("ESTOP", False)
        time.sleep(EDGE)
        chip.pull("ESTOP", True)
        begin = time.monotonic()
        wait_for(lambda: not chip.value("ENABLE"), "enable off")
        while time.monotonic() < begin + 0.15:
            peer.command("clear")
            peer.command("run")
            time.sleep(0.005)
            assert not chip.value("ENABLE")
        enabled(chip, peer)
        assert controller.stop() == 0


def test_an_estop_that_vanishes_stops_for_good(chip: Lines, options: list[str]) -> None:
    """Its chip is unplugged: stopped, said, the loop goes on at its pace, and no new chip lets it run again."""
    options[options.index("--estop") + 1] = "PLUGGED"
    other = Lines("PLUGGED", label="plugged")
    other.pull("PLUGGED", True)
    with Controller(*options) as controller, Peer() as peer:
        enabled(chip, peer)
        other.close()
        wait_for(lambda: not chip.value("ENABLE"), "enable off")
        wait_for(lambda: "the e-stop's line is gone" in controller.said(), "it says so")
        peer.keep("run", lambda: faults(peer) & 1 == 1, "fault estop")
        other = Lines("PLUGGED", label="plugged")
        other.pull("PLUGGED", True)
        before, steps = cpu_seconds(controller.process.pid), count(controller.report(), "steps")
        wait_for(lambda: count(controller.report(), "steps") > steps + 1000, "it goes on stepping")
        print(
            f"{cpu_seconds(controller.process.pid) - before:.2f} s of the processor in 1,000 ticks without its e-stop"
        )
        for _ in range(10):
            peer.command("clear")
            peer.command("run")
            time.sleep(0.01)
            assert not chip.value("ENABLE")
        assert faults(peer) & 1 == 1
        assert controller.said().count("the e-stop's line is gone") == 1
        assert controller.stop() == 0
    other.close()


def cpu_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("wiring", ["ESTOP,pull-down", "ESTOP,active-low,pull-up"])
def test_broken_wire_never_runs(chip: Lines, options: list[str], wiring: str) -> None:
    """Without its wire the line goes where its pull takes it, and that is `pressed`: the program asks for that pull,
    since before it started the line stood the other way."""
    options[options.index("--estop") + 1] = wiring
    chip.pull("ESTOP", "active-low" not in wiring)
    with Controller(*options) as controller, Peer() as peer:
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            peer.command("clear")
            peer.command("run")
            time.sleep(0.01)
            assert not chip.value("ENABLE")
        assert faults(peer) & 1 == 1
        chip.pull("ESTOP", "active-low" not in wiring)
        enabled(chip, peer)
        assert controller.stop() == 0


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "SIGHUP", "SIGQUIT", "SIGSEGV", "SIGABRT", "SIGKILL"])
def test_every_end_puts_the_bridge_off(chip: Lines, options: list[str], name: str) -> None:
    """Also a kill -9, here: gpio-sim gives a line back to its pull when its process is gone. What real chips do is
    their drivers' affair (docs/linux.md)."""
    chip.pull("ENABLE", False)
    with Controller(*options) as controller, Peer() as peer:
        enabled(chip, peer)
        status = controller.stop(getattr(signal, name))
        wait_for(lambda: not chip.value("ENABLE"), "enable off")
    orderly = name in ("SIGTERM", "SIGINT", "SIGHUP", "SIGQUIT")
    assert status == (0 if orderly else -getattr(signal, name))
    assert ("outputs off" in controller.text) == orderly


def test_off_puts_outputs_off(chip: Lines) -> None:
    """What systemd runs after the controller, however that ended."""
    with tempfile.TemporaryDirectory() as folder:
        for attribute, text in (("period", "50000\n"), ("duty_cycle", "20000\n"), ("enable", "0\n")):
            (Path(folder) / attribute).write_text(text)
        with Controller("--off", "--enable", "ENABLE", "--pwm", folder) as controller:
            assert controller.process.wait(10) == 0
        assert int((Path(folder) / "duty_cycle").read_text().split()[0]) == 0
    assert not chip.value("ENABLE")
    with Controller("--off", "--enable", "NOPE") as controller:
        assert controller.process.wait(10) == 1
    assert controller.text.startswith("terrapin-controller: line NOPE: no such line")


def test_command_silence_puts_the_bridge_off(chip: Lines, options: list[str]) -> None:
    with Controller(*options) as controller, Peer() as peer:
        enabled(chip, peer)
        begin = time.monotonic()
        wait_for(lambda: not chip.value("ENABLE"), "enable off")
        assert time.monotonic() - begin > 0.1  # command_timeout is 200 ms, less the age of the last command
        wait_for(lambda: faults(peer) & 2 == 2, "fault command_timeout")
        assert controller.stop() == 0


def test_test_mode_keeps_the_line_off(chip: Lines, options: list[str]) -> None:
    from dataclasses import replace

    from terrapin_hil.run.run import run
    from terrapin_hil.scenario.scenario import find_scenario, load_scenario

    scenario = replace(load_scenario(find_scenario("steady_sand")), duration=1.0, checks=())
    with Controller(*options) as controller, Peer() as peer:
        enabled(chip, peer)
        for frame in peer.sender.test_mode():  # not while the bridge is on
            peer.send(frame)
        peer.keep("run", lambda: peer.last["STATUS"]["state"] == 4, "still running")
        assert chip.value("ENABLE")
        peer.command("idle")
        wait_for(lambda: not chip.value("ENABLE"), "enable off")
        result = run(scenario, "socketcan:vcan0")
        assert max(result.held("ACTUATE", "enable")) == 1  # the firmware would
        assert not chip.value("ENABLE")  # the line does not
        assert result.output_hash == run(scenario).output_hash
        assert controller.stop() == 0


def test_led_says_what_it_does(chip: Lines, options: list[str]) -> None:
    def changes(seconds: float) -> int:
        last, seen, end = chip.value("LED"), 0, time.monotonic() + seconds
        while time.monotonic() < end:
            now = chip.value("LED")
            seen += now is not last
            last = now
            peer.command("idle")
            time.sleep(0.01)
        return seen

    with Controller(*options) as controller, Peer() as peer:
        peer.keep("clear", lambda: peer.last.get("STATUS", {}).get("ready") == 1, "ready")
        assert 2 <= changes(2.0) <= 5  # idle: once a second
        chip.pull("ESTOP", False)
        assert changes(2.0) >= 12  # fault: five times a second
        assert controller.stop() == 0
    assert not chip.value("LED")


def test_encoder_counts(chip: Lines, options: list[str]) -> None:
    """10 periods forward, 2 back, seen in the shell's angle: each of 48 counts of 2048, and the gear between."""
    with Controller(*options, "--motor-encoder", "MA+MB") as controller, Peer() as peer:
        wait_for(lambda: (peer.listen(), "ATTITUDE" in peer.last)[1], "telemetry")
        parameters = peer.interface.parameters
        unit = 32 * parameters["drive_radius"].default / parameters["radius"].default
        start = peer.last["ATTITUDE"]["angle"]

        def counted(counts: int) -> bool:
            peer.listen()
            moved = (peer.last["ATTITUDE"]["angle"] - start + 32768) % 65536 - 32768
            return abs(moved - counts * unit) <= 0.25 * unit  # the angle is whole

        phases = [(True, False), (True, True), (False, True), (False, False)]
        for at, step in enumerate([1] * 40 + [-1] * 8):  # gpio-sim tells of a line's last edge only: one at a time
            total = at + 1 if step > 0 else 79 - at
            a, b = phases[(total - 1) % 4]
            chip.pull("MA", a)
            chip.pull("MB", b)
            wait_for(lambda total=total: counted(total), f"count {total}")
        assert controller.stop() == 0
    assert controller.text.rstrip().endswith("encoders skipped 0")


def test_lines_that_are_not_there(chip: Lines) -> None:
    for line, words in (("NOPE", "no such line"), ("nochip:3", "no such chip"), (f"{chip.chip}:99", "no such line")):
        with Controller("--can", "vcan0", "--estop", line) as controller:
            assert controller.process.wait(10) == 1
        assert controller.text.startswith(f"terrapin-controller: line {line}: {words}"), controller.text
        assert controller.text.count("\n") == 1


def test_rig_measures_the_estop(chip: Lines, options: list[str]) -> None:
    """A run in a rig. The wires between its lines and the board's are a thread here, so the limit is wide."""
    rig = Path(os.environ["TMPDIR"]) / "rig.toml"
    rig.write_text('estop = "PRESS"\nenable = "WATCH"\nreset = "RESET"\nstart_time = "50 ms"\nestop_limit = "100 ms"\n')
    wires = {
        lambda: chip.value("PRESS"): lambda pressed: chip.pull("ESTOP", not pressed),
        lambda: chip.value("ENABLE"): lambda on: chip.pull("WATCH", on),
    }
    scenario = rig.with_name("short.toml")
    scenario.write_text(
        'duration = "1 s"\nseed = 1\nchecks = []\n[[path]]\nterrain = "sand"\n'
        '[[operator]]\nat = "0 s"\nrequest = "run"\nsetpoint = "6 V"\n'
    )
    command = [TERRAPIN, "run", str(scenario), "--link", "socketcan:vcan0", "--rig", str(rig)]
    with Controller(*options) as controller, wired(wires):
        done = run_shell(command, 120.0)
        assert controller.stop() == 0
    assert done.returncode == 0, done.stdout + done.stderr
    assert "ok    e-stop to enable line off <= 100 ms" in done.stdout
    assert "ok    enable line off in test mode" in done.stdout
    print(next(row.strip() for row in done.stdout.splitlines() if "e-stop" in row))
    # Without the wire of the e-stop the measurement fails, and says so.
    with Controller(*options) as controller, wired(dict([list(wires.items())[1]])):
        done = run_shell(command, 120.0)
        assert controller.stop() == 0
    assert done.returncode == 1
    assert done.stderr == "terrapin: the enable line is still on 0.1 s after the e-stop was pressed\n"


def test_a_rig_asks_for_the_pulls_of_its_lines(chip: Lines) -> None:
    """The watched enable line of a board without supply must read as off."""
    for option, expected in (("pull-down", False), ("pull-up", True), ("active-low,pull-up", False)):
        chip.pull("WATCH", option != "pull-up")
        with Rig(RigConfig(enable=parse_line(f"WATCH,{option}"))) as rig:
            assert rig.enabled() is expected


def test_rig_that_is_not_there(chip: Lines) -> None:
    rig = Path(os.environ["TMPDIR"]) / "rig.toml"
    rig.write_text('enable = "NOPE"\n')
    done = run_shell([TERRAPIN, "run", "steady_sand", "--link", "socketcan:vcan0", "--rig", str(rig)])
    assert (done.returncode, done.stderr) == (1, "terrapin: no such line: NOPE\n")
