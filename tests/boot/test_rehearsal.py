"""Flashing is rehearsed on a robot that lives, with the boot loader and the command that flash a board."""

from __future__ import annotations

import time
from pathlib import Path

from test_flash import signed, terrapin

from terrapin_hil.run.boot_loader import SIZE, BootLoader
from terrapin_hil.run.changes_live import change
from terrapin_hil.run.living import Living
from terrapin_hil.run.ports import PtyPort
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.living import at_work


def robot(port: PtyPort, flash: Path, told: list[str]) -> Living:
    scenario = load_scenario(find_scenario("steady_sand"))
    return Living(scenario, [port], loader=BootLoader(flash), told=told.append)


def test_flashing_is_rehearsed(tmp_path: Path) -> None:
    """Refused while the motor runs; then written, started and confirmed; there again after a new start."""
    port, told, flash = PtyPort(), list[str](), tmp_path / "flash.bin"
    image = signed(tmp_path, "a", "1.2.0")
    with at_work(robot(port, flash, told)) as there:
        time.sleep(0.5)
        refused = terrapin("flash", image, "--link", port.attach)
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
        assert "motor" in refused.stderr
        change(there, "request = idle")
        time.sleep(2.0)
        done = terrapin("flash", image, "--link", port.attach)
        assert done.returncode == 0, done.stderr
        assert "slot a: started and confirmed" in done.stdout
    assert told == ["flash is empty: started as by a probe", "started slot A, version 1.2.0"]
    assert flash.stat().st_size == SIZE
    again: list[str] = []
    robot(PtyPort(), flash, again).close()
    assert again == ["started slot A, version 1.2.0"]


def test_a_reset_with_an_empty_flash_says_that_the_boot_loader_stays(tmp_path: Path) -> None:
    """As on a chip. The robot is silent then: who asked for the reset is told why, and the way out works."""
    one = robot(PtyPort(), tmp_path / "flash.bin", [])
    said = change(one, "reset = now")
    assert "the boot loader stays: expected `terrapin flash`" in said
    assert one.state()["state"] == "boot loader"
    assert change(one, "reset = now") == "the controller was reset"
    one.tick()
    assert one.state()["state"] != "boot loader"
    one.close()
