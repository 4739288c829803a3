"""Robots other than the cylinder: the shipped ones, and the cylinder changed as docs/robots.md has it. Each is built
for host and chip, rolls under its controller in the simulator, and gives the same bits on an emulated Cortex-M4."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.robots import Robot
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario, load_scenario
from terrapin_interface.description import load
from terrapin_interface.robot import DEFAULT, find_robot, robots
from tests.own_robot import taken
from tests.python.robot_files import set_fields
from tests.target.replay import compensated, count_all, record, whole
from tests.target.replay import image as counting_image
from tests.target.scripts import HALVES, bounds
from tests.target.worst import bases, build, search
from tests.target.worst import load as load_found

ROOT = Path(__file__).resolve().parents[2]
BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())
RAM = 16 * 1024  # bytes, the limit of the linker script
SHIPPED = [name for name in robots() if name != DEFAULT]

pytestmark = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="no ARM cross compiler")

# At a third and at two thirds of the voltage limit on sand, without slip limiter.
ROLLS = """
duration = "24 s"
[sensors]
kit = "ideal"
[[path]]
terrain = "sand"
[[operator]]
at = "0 s"
request = "run"
setpoint = {low}
limiter = false
[[operator]]
at = "12 s"
request = "run"
setpoint = {high}
limiter = false
"""


def wide(folder: Path) -> Path:
    """The page's changes of the cylinder, as a robot of its own."""
    page = (ROOT / "docs" / "robots.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"<!-- changes: \S+cylinder\.toml -->\n```toml\n(.*?)```", page, re.DOTALL)
    document: Any = tomlkit.parse(find_robot(DEFAULT).read_text(encoding="utf-8"))
    for key, value in tomllib.loads(block).items():
        if isinstance(value, dict):
            _merge(document[key], value)
        else:
            document[key] = value
    path = folder / "wide.toml"
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path


def _merge(table: Any, changes: dict[str, Any]) -> None:
    for key, value in changes.items():
        if isinstance(value, dict):
            _merge(table[key], value)
        else:
            table[key] = value


@pytest.fixture(scope="module", params=[*SHIPPED, "wide"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    name = request.param if request.param in SHIPPED else str(wide(tmp_path_factory.mktemp("robot")))
    with taken(name, "cortex-m4") as found:
        yield found


def rolls(robot: Robot, folder: Path) -> Scenario:
    path = folder / "rolls.toml"
    most = robot.limits["voltage"]
    path.write_text(ROLLS.format(low=round(most / 3, 1), high=round(most * 2 / 3, 1)), encoding="utf-8")
    return load_scenario(path)


def test_it_rolls_under_its_controller(robot: Robot, tmp_path: Path) -> None:
    """C_t within 0.5e-3 of the full scale wherever it is valid and the speed has settled, as steady_sand asks of the
    cylinder; valid in nine tenths of that time; never clamped, no fault."""
    found = run(rolls(robot, tmp_path))
    full = robot.full_scale["torque"]
    for begin, end in ((8.0, 12.0), (20.0, 24.0)):
        settled = (found.time > begin) & (found.time < end)
        valid = settled & (found.held("GROUND", "valid") == 1)
        assert valid.sum() >= 0.9 * settled.sum()
        error = found.held("GROUND", "torque") - found.truth["contact_torque"]
        assert np.abs(error[valid]).max() < 0.5e-3 * full
        assert np.abs(found.truth["speed"][settled]).min() > 0.05
    assert found.held("STATUS", "faults")[100:].max() == 0
    assert np.nanmax(found.held("GROUND", "saturated")) == 0


@pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed")
def test_the_chip_gives_the_same_bits(robot: Robot, tmp_path: Path) -> None:
    scenario = rolls(robot, tmp_path)
    chip, host = run(scenario, "qemu"), run(scenario)
    assert len(chip.records) == scenario.ticks
    assert chip.output_hash == host.output_hash


@pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed")
def test_its_step_is_within_the_budget(robot: Robot, tmp_path: Path) -> None:
    """In its own scenarios, and with every compensation."""
    firmware = Firmware.open()
    own = sorted((paths.SCENARIOS / robot.name).glob("*.toml"))
    recordings = [record(s, firmware=firmware) for s in (rolls(robot, tmp_path), *map(load_scenario, own))]
    plain = [whole(counted) for counted in count_all(recordings, firmware)]
    assert max(steps.max() for steps in plain) <= BUDGET["step"]["worst"]
    assert max(steps.max() / np.median(steps) for steps in plain) <= BUDGET["step"]["worst_over_median"]
    everything = count_all([compensated(recording, firmware) for recording in recordings], firmware)
    assert max(whole(counted).max() for counted in everything) <= BUDGET["step"]["extreme"]
    assert sum(whole(counted).sum() for counted in everything) > sum(steps.sum() for steps in plain)


@pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed")
def test_its_longest_step_and_the_bound_from_its_image(robot: Robot) -> None:
    """A short search, from the longest known of the cylinder, and from one that ends in a fault there and not here."""
    firmware = Firmware.open()
    known = [load_found(Path(__file__).parent / name) for name in ("longest.json", "longest_sphere.json")]
    found = search(2, 11, firmware, known=known)
    assert BUDGET["step"]["worst"] < found.instructions <= BUDGET["step"]["extreme"]
    most = bounds(counting_image())
    [counted] = count_all([build(found.candidate, bases(firmware, (found.candidate.base,)), firmware)], firmware)
    for half, name in zip(("drive", "think"), HALVES, strict=True):
        assert counted[half].max() < most[name]
    assert sum(most.values()) <= BUDGET["step"]["bound_over_found"] * found.instructions


def test_its_images_fit(robot: Robot) -> None:
    """RAM with the stack that is set aside; the text of an application; a boot loader's sector."""
    images = sorted(paths.images().glob("terrapin-*f405*.elf"))
    board = robot.board.name.replace("_", "-")
    assert {f"terrapin-{board}-alone", f"terrapin-boot-{board}"} <= {image.stem for image in images}
    for image in images:
        size = subprocess.run(["arm-none-eabi-size", image], capture_output=True, text=True, check=True).stdout
        text, data, bss = map(int, size.splitlines()[1].split()[:3])
        assert data + bss <= RAM, f"{image.name}: {data + bss} bytes of RAM"
        assert text <= (16 * 1024 if "boot" in image.stem else BUDGET["stm32f405"]["text"]), (
            f"{image.name}: {text} bytes"
        )


def test_its_core_passes_the_check_of_make_firmware(robot: Robot) -> None:
    check = ["ctest", "--test-dir", str(paths.images()), "-R", "core_size", "--no-tests=error", "-V"]
    done = subprocess.run(check, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stdout


def test_a_boards_file_is_in_its_image(tmp_path: Path) -> None:
    """The page's own board: its pins, channels and scales by its file alone, none of them the shipped board's."""
    page = (ROOT / "docs" / "robots.md").read_text(encoding="utf-8").partition("## Boards")[2]
    board, change = re.findall(r"<!-- built: \S+ -->\n```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "my_board.toml").write_text(board, encoding="utf-8")
    fields = tomllib.loads(change)
    changes = {"board": fields["board"], "sensors.current.code": fields["sensors"]["current"]["code"]}
    robot = set_fields(tmp_path / "carried.toml", find_robot(DEFAULT), changes)
    build = ["tests/tools/build.sh", f"robot={robot}", "cortex-m4"]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False, timeout=1200)
    assert done.returncode == 0, done.stderr
    image = (ROOT / "build" / "robots" / "carried" / "cortex-m4" / "terrapin-my-board-alone.bin").read_bytes()
    pins = [
        *((0, 7, 2, 2, 1), (0, 8, 2, 2, 1), (1, 14, 2, 2, 1), (0, 9, 2, 2, 1), (1, 12, 2, 2, 1)),  # bridge
        *((1, 6, 2, 1, 7), (1, 7, 2, 1, 7), (1, 8, 2, 1, 9), (1, 9, 2, 0, 9)),  # USART1, CAN1
        *((2, 6, 2, 1, 2), (2, 7, 2, 1, 2), (3, 12, 2, 1, 2), (3, 13, 2, 1, 2)),  # encoders
        *((2, 0, 3, 0, 0), (0, 3, 3, 0, 0), (1, 1, 3, 0, 0)),  # converters
    ]
    assert image.count(b"".join(map(bytes, pins))) == 1
    assert bytes([10, 3, 9]) in image  # channels
    index = {p.name: p.index for p in load().parameters}
    # 3.3 V / (4096 * 10 mohm * 40) and 3.3 V / 4096 * (47 + 10) / 10
    scales = struct.pack("<HxxiHxxi", index["current_scale"], 2014, index["supply_scale"], 4592)
    assert image.count(scales) == 1
