"""A robot around each of ten real drives, as a user makes it: from the sheet to a file, all scenarios, images, and an
update of the robot that lives, without a file that is edited by hand.

Each takes some 60 s of the processor: two builds of its controller, the host's and the chip's, in build/robots.
"""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest
from test_flash import terrapin

from terrapin_hil import paths
from terrapin_hil.reading import ReadingError
from terrapin_hil.robots import select
from terrapin_hil.run.boot_loader import BootLoader
from terrapin_hil.run.living import Living
from terrapin_hil.run.ports import PtyPort
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.drives import DRIVES, Drive
from tests.living import at_work

SCENARIOS = sorted(path.stem for path in paths.SCENARIOS.glob("*.toml"))
FEWEST = 25  # of the shipped scenarios, that a robot has to run with every check that is left


def test_there_are_ten_drives() -> None:
    assert len(DRIVES) == 10
    assert all(drive.source for drive in DRIVES.values())


@pytest.mark.parametrize("name", DRIVES)
def test_from_the_sheet_to_a_robot_that_is_flashed(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(paths.ROBOT_VARIABLE, "")  # so that the end undoes what select sets
    file = _made(DRIVES[name], tmp_path / f"{name}.toml")
    robot = select(str(file))
    ran, refused = 0, list[str]()
    for scenario in SCENARIOS:
        try:
            loaded = load_scenario(find_scenario(scenario))
        except ReadingError as error:
            refused.append(str(error))
            continue
        failed = [f"{outcome.text}: {outcome.found}" for outcome in run(loaded).outcomes if not outcome.passed]
        assert failed == [], scenario
        ran += 1
    assert ran >= FEWEST
    assert all(re.match(rf"\w+: (does not suit the {name}|is for the cylinder): ", line) for line in refused)

    done = terrapin("image", "build", "--robot", file, "--out", tmp_path / "images")
    assert done.returncode == 0, done.stderr
    stem = robot.board.name.replace("_", "-")
    code, image = tmp_path / "images" / f"terrapin-{stem}-slot-a.bin", tmp_path / "a.bin"
    assert terrapin("image", "sign", code, image, "--version", "1.0.0").returncode == 0

    port, told = PtyPort(), list[str]()
    standing = load_scenario(find_scenario("steady_red_terrain"), {"operator.1.request": "idle"})
    with at_work(Living(standing, [port], loader=BootLoader(tmp_path / "flash.bin"), told=told.append)):
        time.sleep(1.0)
        done = terrapin("flash", image, "--robot", file, "--link", port.attach)
    assert done.returncode == 0, done.stderr
    assert told[-1] == "started slot A, version 1.0.0"


def _made(drive: Drive, file: Path) -> Path:
    done = terrapin("robot", "new", file, "--from-sheet", *drive.words)
    assert done.returncode == 0, done.stderr
    assert f"{file}: good, " in done.stdout
    return file
