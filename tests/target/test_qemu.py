"""The ARM image on an emulated Cortex-M4: every answer of every scenario is that of the host's build, bit for bit."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.qemu import Instructions, QemuMachine, image, open_qemu
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario

BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())
SCENARIOS = sorted(path.stem for path in paths.SCENARIOS.glob("*.toml"))
COUNTED = ("floor_calibration", "slope_limiter")  # the longest steps, and the extrication

pytestmark = [
    pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed"),
    pytest.mark.skipif(not image().is_file(), reason="the ARM image is not built (no ARM cross compiler)"),
]


def shortened(name: str, seconds: float) -> Scenario:
    """The first seconds of a scenario; its checks are another test's."""
    scenario = load_scenario(find_scenario(name))
    return replace(scenario, duration=min(scenario.duration, seconds), checks=())


@pytest.mark.parametrize("name", SCENARIOS)
def test_same_bits(name: str) -> None:
    scenario = shortened(name, 10.0)
    with open_qemu() as link:
        emulated = run(scenario, link)
    assert len(emulated.records) == scenario.ticks
    assert emulated.output_hash == run(scenario).output_hash
    assert link.machine.stack is not None
    assert 100 < link.machine.stack <= BUDGET["stack"]


def test_parameters_reach_the_chip() -> None:
    """Another parameter, another hash, the same on both: the comparison can fail."""
    scenario = shortened("steady_sand", 2.0)
    plain = run(scenario, "qemu").output_hash
    changed = {"torque_constant": 0.11}
    assert (
        run(scenario, "qemu", parameters=changed).output_hash == run(scenario, parameters=changed).output_hash != plain
    )


@pytest.mark.parametrize("name", COUNTED)
def test_instructions(name: str) -> None:
    """Counted under -icount: the same in every run, within the budget."""
    counts = []
    for _ in range(2):
        link = open_qemu(count=True)
        with link:
            run(shortened(name, 4.0), link)
        counts.append(link.machine.instructions)
    assert counts[0] == counts[1]
    whole, bare = counts[0]["step"], counts[0]["step-without-telemetry"]
    assert whole.steps == bare.steps == 4000
    assert 0 < bare.minimum < whole.minimum <= whole.median <= BUDGET["step_median"]
    assert whole.maximum <= BUDGET["step_maximum"]


def frame_instructions(frames: list[Frame]) -> Instructions:
    machine = QemuMachine(count=True)
    port = machine.start()
    for i in range(0, len(frames), 10):
        port.exchange_frames(frames[i : i + 10])
    port.close()
    machine.stop()
    counted = machine.instructions["frame"]
    assert counted.steps == len(frames)
    return counted


def test_no_frame_takes_long() -> None:
    """Writes of every parameter, resets to the defaults, foreign frames: each is a bounded piece of work, so that a
    flood of them cannot starve a port that steps in between."""
    sender, description = Sender(), interface()
    frames = [(0x7DF, bytes(8)), sender.frame("COMMAND", {"request": 2})]
    for parameter in description.parameters.values():
        for raw in (parameter.minimum, parameter.maximum, parameter.default):
            frames.append(sender.frame("PARAMETER_WRITE", {"index": parameter.index, "value": raw}))
        frames.append(sender.frame("PARAMETER_READ", {"index": parameter.index}))
    frames += [sender.frame("STORE_COMMAND", {"action": action}) for action in (1, 2, 3)]
    frames += [sender.frame("STORE_READ", {"part": part}) for part in (0, 1)]
    counted = frame_instructions(frames)
    assert 0 < counted.minimum < counted.maximum <= BUDGET["frame_maximum"]
    resets = frame_instructions([*sender.test_mode(), *sender.test_mode(False)])
    assert counted.maximum < resets.maximum <= BUDGET["reset_maximum"]


def test_image_size() -> None:
    done = subprocess.run(["arm-none-eabi-size", image()], capture_output=True, text=True, check=True)
    text, data, _ = done.stdout.splitlines()[1].split()[:3]
    assert 10_000 < int(text) + int(data) <= BUDGET["text"]


def test_killed_emulator_is_one_error() -> None:
    """The emulator dies in the middle of a run: LinkError, and nothing is left behind."""
    link = open_qemu()
    with link:
        link.start({})
        assert link.machine.pid is not None
        os.kill(link.machine.pid, signal.SIGKILL)
        os.waitid(os.P_PID, link.machine.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(LinkError, match="qemu"):
            link.exchange([(0x100, bytes(8))])
    assert not link.machine.folder.exists()


def test_no_image_no_start(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="make firmware"):
        QemuMachine(tmp_path / "absent.elf")
    (tmp_path / "bad.elf").write_bytes(b"no image")
    with pytest.raises(LinkError, match="did not start"):
        QemuMachine(tmp_path / "bad.elf").start()
