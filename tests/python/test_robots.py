"""Files of robots: what is contradictory is refused with both places, what is consistent is taken."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robot_files import Change, set_fields
from typer.testing import CliRunner

from terrapin_hil.errors import UserError
from terrapin_hil.paths import ROBOT_VARIABLE, SCENARIOS
from terrapin_hil.reading import ReadingError
from terrapin_hil.robot.plant import Robot as Plant
from terrapin_hil.robots import Robot, _build, _changed_since, cylinder, select, selected
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario, load_scenario
from terrapin_interface.description import load
from terrapin_interface.quantity import QuantityError, parse_quantity
from terrapin_interface.robot import RobotError, find_robot, load_robot, robots
from terrapin_tools.commands import robot as command
from tests.own_robot import taken

ROOT = Path(__file__).resolve().parents[2]


def changed(folder: Path, name: str, changes: Change) -> Path:
    """A copy of a shipped robot's file with fields set, or taken out (None)."""
    return set_fields(folder / f"{name}.toml", find_robot(name), changes)


def made(path: Path) -> None:
    """All that a build makes of a file before it writes anything."""
    load(robot=load_robot(path))


# robot, what is set, the two places that the message must name
CONTRADICTIONS: list[tuple[str, Change, str, str]] = [
    ("cylinder", {"body.drive_radius": "80 mm"}, "body.drive_radius", "body.radius"),
    ("cylinder", {"body.radius": "15 mm", "body.arm": "5 mm"}, "body.drive_radius", "body.radius"),
    ("cylinder", {"body.arm": "90 mm"}, "body.arm", "body.radius"),
    ("sphere", {"body.arm": "0.3 m"}, "body.arm", "body.radius"),
    ("cylinder", {"body.shell_inertia": 0.01}, "body.shell_inertia", "body.shell_mass"),
    ("cylinder", {"body.body_inertia": 0.02}, "body.body_inertia", "body.body_mass"),
    ("cylinder", {"body.drive_inertia": "80 kg cm^2"}, "body.drive_inertia", "body.drive_mass"),
    ("sphere", {"body.frame_inertia": 0.2}, "body.frame_inertia", "body.frame_mass"),
    ("sphere", {"body.bob_inertia": 1.0}, "body.bob_inertia", "body.bob_mass"),
    ("sphere", {"body.shell_inertia": "0.5 kg m^2"}, "body.shell_inertia", "body.shell_mass"),
    ("cylinder", {"estimator.window": "1.5 s"}, "estimator.window", "body.arm"),
    ("sphere", {"estimator.window": "0.2 s"}, "estimator.window", "body.arm"),
    ("cylinder", {"limits.current": "2.0 A"}, "limits.current", "limits.over_current"),
    ("roller", {"limits.over_current": "4.5 A"}, "limits.current", "limits.over_current"),
    ("cylinder", {"limits.supply_low": "12.5 V"}, "limits.supply_low", "supply.voltage"),
    ("sphere", {"limits.supply_high": "22 V"}, "limits.supply_high", "supply.voltage"),
    ("cylinder", {"limits.voltage": "13 V"}, "limits.voltage", "supply.voltage"),
    ("sphere", {"supply.voltage": "16 V"}, "limits.voltage", "supply.voltage"),
    ("cylinder", {"friction.coulomb": "0.9 N m"}, "friction.coulomb", "limits.current"),
    ("roller", {"limits.current": "50 mA"}, "friction.coulomb", "limits.current"),
    ("cylinder", {"limits.over_current": "2.04 A", "sensors.current.code": "0.99 mA"},
     "limits.over_current", "sensors.current.code"),
    ("roller", {"sensors.current.shunt": "20 mohm"}, "limits.over_current", "sensors.current.shunt"),
    ("cylinder", {"sensors.current.code": "2 mA"}, "sensors.current.code", "board f405_h_bridge"),
    ("sphere", {"sensors.current.code": "4 mA"}, "sensors.current.code", "sensors.current.shunt"),
    ("sphere", {"sensors.supply.code": "5 mV"}, "sensors.supply.code", "sensors.supply.upper"),
    ("cylinder", {"limits.supply_high": "17 V"}, "limits.supply_high", "sensors.supply.code"),
    ("sphere", {"sensors.supply.upper": "60 kohm"}, "limits.supply_high", "sensors.supply.upper"),
    ("cylinder", {"motor.torque_constant": 0.004}, "sensors.motor_encoder.counts", "motor.torque_constant"),
    ("sphere", {"sensors.motor_encoder.counts": 1000}, "sensors.motor_encoder.counts", "body.kind"),
    ("roller", {"motor.gear": 18.2}, "sensors.motor_encoder.counts", "motor.gear"),
    ("roller", {"sensors.motor_encoder.counts": 48}, "sensors.motor_encoder.counts", "motor.gear"),
    ("sphere", {"sensors.swing": False}, "limits.swing", "sensors.swing"),
    ("cylinder", {"sensors.ground_wheel.counts": 100}, "sensors.ground_wheel.counts", "sensors.motor_encoder.counts"),
    ("cylinder", {"motor.torque_constant": "0.2 N m/A"}, "full_scale.torque", "limits.current"),
    ("sphere", {"full_scale.torque": "20 N m"}, "full_scale.torque", "limits.current"),
    ("roller", {"full_scale.current": "4 A"}, "full_scale.current", "limits.over_current"),
    ("sphere", {"full_scale.voltage": "16 V"}, "full_scale.voltage", "limits.voltage"),
    ("cylinder", {"bridge.off": "brake"}, "bridge.off", "board f405_h_bridge"),
    ("cylinder", {"can.bit_rate": "250 kbit/s"}, "can.bit_rate", "can.nodes"),
    ("cylinder", {"can.nodes": 2}, "can.bit_rate", "can.nodes"),
    ("roller", {"motor.inductance": "1 uH"}, "motor.inductance", "limits.over_current"),
    ("roller", {"motor.inductance": "50 mH"}, "motor.inductance", "motor.armature_resistance"),
    ("cylinder", {"firmware.coulomb": "10 mN m"}, "firmware.coulomb", "friction.coulomb"),
]  # fmt: skip


def test_there_are_40_contradictions() -> None:
    assert len(CONTRADICTIONS) >= 40
    assert len({(first, second, name) for name, _, first, second in CONTRADICTIONS}) >= 35


@pytest.mark.parametrize("number", range(len(CONTRADICTIONS)))
def test_a_contradiction_is_refused_with_both_places(number: int, tmp_path: Path) -> None:
    name, changes, first, second = CONTRADICTIONS[number]
    path = changed(tmp_path, name, changes)
    with pytest.raises(RobotError) as found:
        made(path)
    message = str(found.value)
    assert "\n" not in message
    assert message.startswith(str(path)), message
    assert first in message, message
    assert second in message, message
    assert "found" in message, message
    assert "expected" in message, message
    if not second.startswith("board"):  # with the line of the second place, where that field stands in the file
        line = next((n for n, text in enumerate(path.read_text().splitlines(), 1) if _is(text, second, path, n)), None)
        assert line is not None, second
        assert f"(line {line})" in message or f":{line}:" in message, message


def _is(text: str, key: str, path: Path, number: int) -> bool:
    table, _, last = key.rpartition(".")
    before = [line.strip() for line in path.read_text().splitlines()[: number - 1]]
    header = next((line for line in reversed(before) if line.startswith("[")), "")
    return text.split("=")[0].strip() == last and header.partition("]")[0] == f"[{table}"


# Consistent changes: each alone makes another good robot.
CONSISTENT: list[tuple[str, Change]] = [
    *(("cylinder", {"body.radius": f"{r} mm"}) for r in (82, 85, 90)),
    *(("cylinder", {"body.drive_radius": f"{r} mm"}) for r in (17, 20, 24)),
    *(("cylinder", {"body.arm": f"{h} mm"}) for h in (50, 70)),
    ("cylinder", {"body.shell_inertia": None}),
    ("cylinder", {"body.body_inertia": None}),
    ("cylinder", {"body.gravity": 9.78}),
    ("cylinder", {"motor.resistance_slope": "0.0039 1/K"}),
    ("cylinder", {"motor.gear": 2, "motor.torque_constant": "50 mN m/A", "sensors.motor_encoder.counts": 1024}),
    ("cylinder", {"sensors.motor_encoder.counts": 4096}),
    ("cylinder", {"sensors.ground_wheel.counts": 1024}),
    ("cylinder", {"sensors.current.code": None}),
    ("cylinder", {"sensors.supply.code": None}),
    ("cylinder", {"sensors.swing": False}),
    ("cylinder", {"limits.swing": "60 deg"}),
    ("cylinder", {"limits.slip": 0.3}),
    ("cylinder", {"limits.temperature": "80 degC"}),
    ("cylinder", {"can.bit_rate": "1 Mbit/s"}),
    ("cylinder", {"estimator.window": "0.5 s"}),
    ("cylinder", {"firmware.slip_kp": "2 V s/rad"}),
    ("cylinder", {"full_scale.torque": "2 N m"}),
    ("cylinder", {"full_scale.voltage": "32 V"}),
    ("cylinder", {"body.radius": "0.15 m", "body.drive_radius": "0.03 m", "motor.torque_constant": 0.25,
                  "sensors.motor_encoder.counts": 4096, "full_scale.torque": "3 N m"}),
    *(("sphere", {"body.bob_mass": f"{m} kg"}) for m in (8, 9.5)),
    ("sphere", {"body.shell_inertia": None}),
    ("sphere", {"motor.gear": 50, "limits.current": "12 A"}),
    ("sphere", {"sensors.motor_encoder.counts": 1200}),
    ("sphere", {"estimator.window": "1.7 s"}),
    ("sphere", {"limits.swing": "60 deg"}),
    ("sphere", {"limits.swing": None, "sensors.swing": False}),
    ("sphere", {"full_scale.torque": "60 N m"}),
    ("sphere", {"full_scale.current": "20 A"}),
    ("roller", {"body.shell_mass": "900 g"}),
    ("roller", {"motor.inductance": None}),
    ("roller", {"motor.rotor_inertia": "10 g cm^2"}),
    ("roller", {"supply.voltage": "14 V", "limits.voltage": "12 V"}),
    ("roller", {"friction.viscous": "10 mN m s/rad"}),
    ("roller", {"sensors.ground_wheel.radius": "20 mm"}),
]  # fmt: skip


def test_there_are_40_consistent_files() -> None:
    assert len(CONSISTENT) >= 40


@pytest.mark.parametrize("number", range(len(CONSISTENT)))
def test_a_consistent_file_is_taken(number: int, tmp_path: Path) -> None:
    name, changes = CONSISTENT[number]
    made(changed(tmp_path, name, changes))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"body.radius": None}, "body.radius: is missing"),
        ({"body.shell_mass": None, "body.shel_mass": "1 kg"}, "body.shell_mass: is missing; is body.shel_mass (line "),
        ({"body.radius": "80 kg"}, "expected a number in m or a text with a unit that converts to it"),
        ({"body.radius": True}, "expected a number in m"),
        ({"body.radius": "3 m"}, "expected 0.01 to 0.5 m"),
        ({"body.kind": "cube"}, "expected one of cylinder, sphere"),
        ({"board": "arduino"}, "expected a file beside this one, or one of f405_h_bridge"),
        ({"motor.torqe": 1}, "no such field"),
        ({"firmware.torqe": 1}, "found no parameter of the controller of that name"),
        ({"firmware.slip_kp": "5 m"}, "expected a number in V s/rad"),
        ({"firmware.slip_kp": 500}, "expected 0 to 20 V s/rad"),
        ({"full_scale.torque": "1.5 N m"}, "expected a multiple of 1 N m"),
        ({"sensors.motor_encoder.counts": 2048.5}, "expected a whole number from 1 to 1000000"),
        (
            {
                "body.radius": "0.5 m",
                "body.arm": "0.4 m",
                "body.drive_mass": "9 kg",
                "estimator.window": "1 s",
                "full_scale.torque": "5 N m",
            },
            "makes the controller's inertia",
        ),
        ({"motor.gear_efficiency": 1.2}, "motor.gear_efficiency: found 1.2, expected more than 0, at most 1"),
        ({"motor.gear_efficiency": 0}, "motor.gear_efficiency: found 0, expected more than 0, at most 1"),
        ({"motor.driven_efficiency": "120 %"}, "motor.driven_efficiency: found"),
        ({"motor.driven_efficiency": 0.05}, "found 0.05, expected at least 0.1: the drive would lock itself"),
    ],
)
def test_bad_input_is_one_line(changes: Change, expected: str, tmp_path: Path) -> None:
    path = changed(tmp_path, "cylinder", changes)
    with pytest.raises(RobotError) as found:
        made(path)
    assert "\n" not in str(found.value)
    assert str(found.value).startswith(str(path))
    assert expected in str(found.value)


def test_the_cylinder_is_the_simulators() -> None:
    """Every value stood in the sources before; none has changed on its way into the file."""
    robot = load_robot(find_robot("cylinder"))
    assert dict(robot.plant) == asdict(Plant())
    assert dict(robot.plant) == {
        "radius": 0.080, "drive_radius": 0.018, "arm": 0.062, "shell_mass": 0.3, "body_mass": 0.5, "drive_mass": 1.1,
        "shell_inertia": 1.92e-3, "body_inertia": 2.0e-4, "drive_inertia": 1.8e-4, "gravity": 9.81,
        "torque_constant": 0.10, "armature_resistance": 5.0, "resistance_slope": 0.0, "coulomb": 0.012,
        "viscous": 1.0e-3, "gear_efficiency": 1.0, "driven_ratio": 1.0, "motor_coulomb": 0.0, "motor_viscous": 0.0,
    }  # fmt: skip
    assert (robot.current_code, robot.supply_code, robot.supply, robot.wheel_radius) == (1e-3, 4e-3, 12.0, 0.03)
    assert {scale: robot.ratio(scale) for scale in ("torque", "current", "voltage", "speed", "records")} == {
        **dict.fromkeys(("torque", "current", "voltage", "speed", "records"), 1)
    }


def test_the_cylinders_interface_is_that_of_the_first_paper() -> None:
    d = load()
    found = {p.name: p.default for p in d.parameters}
    assert found["inertia"] == 17636
    assert (found["inertia_shell"], found["inertia_swing"], found["weight"]) == (14880, 7936, 18639)
    assert (found["current_scale"], found["supply_scale"], found["window"], found["gate"]) == (1000, 4000, 300, 400)
    signals = {(m.name, s.name): s.scale for m in d.messages for s in m.signals}
    assert signals["GROUND", "torque"] == 1e-6
    assert signals["CALIBRATION", "viscous"] == 1e-7


def test_friction_before_the_gear_is_the_controllers_behind_it(tmp_path: Path) -> None:
    """20 uN m and 2 uN m s/rad at the motor's shaft, 66 turns for one of the joint, of which 0.7 come through."""
    changes: Change = {
        "motor.gear_efficiency": 0.7,
        "motor.driven_efficiency": 0.35,
        "friction.motor_coulomb": "0.2 mN m",
        "friction.motor_viscous": "2 uN m s/rad",
    }
    robot = load_robot(changed(tmp_path, "sphere", changes))
    assert robot.plant["motor_coulomb"] == pytest.approx(0.2e-3 * 66)
    assert robot.plant["motor_viscous"] == pytest.approx(2e-6 * 66**2)
    assert robot.plant["driven_ratio"] == pytest.approx(0.5)
    assert robot.quantity("coulomb") == pytest.approx(0.6 + 0.7 * 0.2e-3 * 66)
    assert robot.quantity("viscous") == pytest.approx(0.05 + 0.7 * 2e-6 * 66**2)
    found = {p.name: p.default for p in load(robot=robot).parameters}
    assert (found["gear_efficiency"], found["driven_efficiency"]) == (700000, 350000)
    assert load_robot(find_robot("sphere")).plant["gear_efficiency"] == 0.72
    assert load_robot(find_robot("cylinder")).plant["gear_efficiency"] == 1.0  # its wheel runs in the shell


def test_the_sphere_travels_at_its_own_scales() -> None:
    """The same number of steps for the full scale as the cylinder: 1e-6 of it a step of C_t."""
    robot = load_robot(find_robot("sphere"))
    signals = {(m.name, s.name): s for m in load(robot=robot).messages for s in m.signals}
    torque, current = signals["GROUND", "torque"], signals["WINDOW", "current"]
    assert torque.scale == pytest.approx(30e-6, rel=1e-12)
    assert torque.divisor == 30
    assert torque.maximum * torque.scale >= 30.0
    assert current.maximum * current.scale >= 16.0
    speed = signals["MOTION", "motor_speed"]
    assert speed.maximum * speed.scale >= 24.0 / 0.0369
    assert robot.record_slots == 3
    assert robot.jump > 24.0 / 0.0369 / (2.0 * math.pi) * 2.048
    assert robot.quantity("inertia") == pytest.approx(0.952, abs=1e-3)  # R^2 M + I1 + J_m N^2


@pytest.mark.parametrize("name", robots())
def test_the_shipped_robots_are_good(name: str) -> None:
    answer = CliRunner().invoke(_app(), ["check", name])
    assert answer.exit_code == 0
    assert f"{name}: good" in answer.output


def test_a_robot_of_ones_own_begins_with_another(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert CliRunner().invoke(_app(), ["new", str(path), "--like", "roller"]).exit_code == 0
    assert load_robot(path).name == "mine"
    assert load_robot(path).plant == load_robot(find_robot("roller")).plant
    again = CliRunner().invoke(_app(), ["new", str(path)])
    assert "is there already" in str(again.exception)


def _app() -> Any:
    import typer

    app = typer.Typer()
    for function in command.SUBCOMMANDS:
        app.command(function.__name__.rstrip("_"))(function)
    return app


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("80 mm", "m", 0.08),
        ("12 mN m", "N m", 0.012),
        ("500 kbit/s", "bit/s", 5e5),
        ("45 deg", "rad", math.pi / 4),
        ("3000 rpm", "rad/s", 100 * math.pi),
        ("181 g cm^2", "kg m^2", 1.81e-5),
        (".5", "1", 0.5),
        ("353.15 K", "degC", 353.15 - 273.15),  # was taken as 353.15 degC
        ("80 degC", "degC", 80.0),
        ("2 degC", "K", 2.0),
    ],
)
def test_quantities(text: str, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-15)


def encoder_error(tmp_path: Path, torque_constant: float, counts: int) -> str:
    """What is said of the encoder of a cylinder with such a motor; nothing when it is taken."""
    changes = {"motor.torque_constant": torque_constant, "sensors.motor_encoder.counts": counts}
    try:
        load_robot(changed(tmp_path, "cylinder", changes))
    except RobotError as error:  # what the motor is too weak for is another matter
        return str(error) if "motor_encoder" in str(error) else ""
    return ""


def test_how_fast_an_encoder_may_turn(tmp_path: Path) -> None:
    """It said of a wheel at 1301 rad/s that it expected at most 1374: what 1171 counts take, and not these 2048."""
    said = encoder_error(tmp_path, 0.012, 2048)
    words = re.search(
        r"at 1000 rad/s without load, expected at most (\S+) rad/s with these .* (\d+) to (\d+) counts", said
    )
    assert words, said
    most = float(words[1])
    assert most < 1000.0
    assert not encoder_error(tmp_path, 12.0 / most * 1.0001, 2048)
    assert encoder_error(tmp_path, 12.0 / most * 0.998, 2048)
    for counts, good in ((int(words[2]), True), (int(words[3]), True), (int(words[3]) + 1, False)):
        assert (encoder_error(tmp_path, 0.012, counts) == "") == good


@pytest.mark.parametrize("text", ["", "mm", "1 mm^2", "1 mm mm", "1e999 m", "1 m/", "5 mmm", "1 m^99", "1 m\n2 m"])
def test_no_quantity(text: str) -> None:
    with pytest.raises(QuantityError):
        parse_quantity(text, "m")


@pytest.fixture
def sphere() -> Iterator[Robot]:
    with taken("sphere") as found:
        yield found


ROLLS = """
duration = "20 s"
{extra}
[sensors]
kit = "ideal"
[[path]]
terrain = "sand"
[[operator]]
at = "0 s"
request = "run"
setpoint = "8 V"
limiter = false
"""


def scenario(folder: Path, extra: str = "") -> Scenario:
    path = folder / "rolls.toml"
    path.write_text(ROLLS.format(extra=extra), encoding="utf-8")
    return load_scenario(path)


def test_the_sphere_runs_under_its_controller(sphere: Robot, tmp_path: Path) -> None:
    """C_t within 0.5e-3 of the full scale, as the cylinder's in steady_sand, and it is not clamped."""
    found = run(scenario(tmp_path))
    late = found.time > 12.0
    torque, valid = found.held("GROUND", "torque")[late], found.held("GROUND", "valid")[late]
    assert found.truth["contact_torque"][late].mean() > 2.0  # far beyond the cylinder's full scale
    assert valid.mean() > 0.9
    assert np.abs(torque - found.truth["contact_torque"][late]).max() < 0.5e-3 * 30.0
    assert found.held("GROUND", "saturated")[late].max() == 0
    assert found.interface.constants["record_interval"] == 30
    ages = set(np.round(found.held("ATTITUDE", "ground_age")[late] * 100))
    assert ages == {0.0, 1.0, 2.0}  # a window every 30 ms, GROUND every 10 ms


def test_the_sphere_gives_the_same_bits_over_a_pty(sphere: Robot, tmp_path: Path) -> None:
    short = replace(scenario(tmp_path), duration=3.0)
    assert run(short).output_hash == run(short, "pty").output_hash


def test_a_process_without_a_choice_has_the_cylinder(tmp_path: Path) -> None:
    assert selected().name == "cylinder"
    assert scenario(tmp_path).robot == Plant()


def test_a_scenario_for_another_robot_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ReadingError, match="found sphere, expected cylinder, the robot of this process; --robot=sphere"
    ):
        scenario(tmp_path, '[robot]\nfile = "sphere"')


def test_a_robot_without_a_controller_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no compiler is."""
    monkeypatch.setenv(ROBOT_VARIABLE, "cylinder")
    monkeypatch.setattr("terrapin_hil.robots.PROGRAMS", ("cmake", "no-such-compiler"))
    path = tmp_path / "mine_without_compiler.toml"
    path.write_text(find_robot("cylinder").read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(UserError, match="no controller is built for this robot, and no-such-compiler to build it"):
        select(str(path))


COUNTED = [  # counts at the motor, gear, counts that the controller is given, encoder's counts in one of them
    (2000, 14, 14000, 2),  # a 500-line encoder of 24 V and 67 rad/s: 300 counts a millisecond are more than 255
    (64, 18.75, 1200, 1),
    (64, 46.85, 2998, 1),
    (100_000, 1, 20_000, 5),
    (100_000, 14, 23729, 59),
]


@pytest.mark.parametrize(("counts", "gear", "given", "divider"), COUNTED)
def test_fine_encoders_are_divided(counts: int, gear: float, given: int, divider: int, tmp_path: Path) -> None:
    fields = {
        "motor.torque_constant": 0.357 / gear,
        "motor.gear": gear,
        "supply.voltage": 24,
        "sensors.motor_encoder.counts": counts,
        "sensors.ground_wheel.counts": given,
        "sensors.supply.code": None,
        "sensors.supply.upper": "100 kohm",
        "sensors.supply.lower": "10 kohm",
        "limits.supply_high": 29,
        "limits.voltage": 16,
        "limits.current": "0.8 A",
        "full_scale.torque": "2 N m",
    }
    robot = load_robot(changed(tmp_path, "cylinder", fields))
    assert (robot.counts, robot.encoder_divider) == (given, divider)
    assert robot.free_speed / (2 * np.pi) * robot.counts * 128e-3 < 32768  # what 16 bits hold of 128 ticks


def command_line(*words: str, folder: Path) -> tuple[int, str]:
    environment = {key: value for key, value in os.environ.items() if key != ROBOT_VARIABLE}
    program = "from terrapin_tools.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def test_a_scenario_runs_with_the_robot_that_it_names(tmp_path: Path) -> None:
    status, said = command_line("run", "level", folder=tmp_path)  # the sphere has it alone
    assert status == 0, said
    text = (SCENARIOS / "sphere" / "level.toml").read_text(encoding="utf-8")
    assert 'file = "sphere"' in text
    (tmp_path / "named.toml").write_text(text, encoding="utf-8")
    status, said = command_line("run", "named.toml", folder=tmp_path)
    assert status == 0, said
    status, said = command_line("run", "named.toml", "--robot", "cylinder", folder=tmp_path)
    assert (status, said.count("\n")) == (2, 1)
    assert "found sphere, expected cylinder" in said


def test_a_robot_of_ones_own_is_built_when_it_is_first_used(tmp_path: Path) -> None:
    """Its file is found beside the scenario; the second run builds nothing, a changed file builds anew."""
    name = f"own_{tmp_path.name.replace('-', '_')}"
    file = tmp_path / "work" / f"{name}.toml"
    file.parent.mkdir()
    file.write_text(find_robot("roller").read_text(encoding="utf-8"), encoding="utf-8")
    scenario_file = file.parent / "drive.toml"
    scenario_file.write_text(ROLLS.format(extra=f'[robot]\nfile = "{name}"'), encoding="utf-8")
    try:
        for expected in (True, False):
            status, said = command_line("run", str(scenario_file), folder=tmp_path)
            assert status == 0, said
            assert (f"{name}: building its controller, once" in said) == expected
        file.write_text(file.read_text(encoding="utf-8").replace("gear = 18.75", "gear = 20"), encoding="utf-8")
        status, said = command_line("run", str(scenario_file), folder=tmp_path)
        assert status == 0, said
        assert "building its controller" in said
    finally:
        shutil.rmtree(ROOT / "build" / "robots" / name, ignore_errors=True)


def test_a_build_that_is_interrupted_leaves_no_library_of_an_older_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "own" / "host"
    place.mkdir(parents=True)
    (place / "libterrapin.so").write_bytes(b"of an older file")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("terrapin_hil.robots.paths.build", lambda: place)
    monkeypatch.setattr("terrapin_hil.robots.subprocess.run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _build(cylinder(), tmp_path / "own.toml", tmp_path)
    assert not (place / "libterrapin.so").exists()


def test_a_controller_of_older_sources_is_built_again(tmp_path: Path) -> None:
    firmware, library = tmp_path / "firmware", tmp_path / "libterrapin.so"
    (firmware / "core").mkdir(parents=True)
    (firmware / "robots").mkdir()
    library.write_bytes(b"")
    for name, newer in (("core/step.c", True), ("core/notes.md", False), ("robots/sphere.toml", False)):
        file = firmware / name
        file.write_text("")
        assert not _changed_since(library, firmware) or newer
        os.utime(file, ns=(library.stat().st_mtime_ns + 10**9,) * 2)
        assert _changed_since(library, firmware) == newer
        file.unlink()


def test_an_encoder_that_the_current_limit_hides_is_noted(tmp_path: Path) -> None:
    """2.2 ohm times 1 A is less than the 2.5 V at which a wrong encoder is told."""
    weak = load_robot(changed(tmp_path, "roller", {"limits.current": "1 A"}))
    (note,) = [note for note in command._notes(weak) if "motor encoder" in note]
    assert "limits.current leaves it 2.2 V, encoder_tolerance is 2.5 V" in note
    told = load_robot(changed(tmp_path, "roller", {"limits.current": "1 A", "firmware.encoder_tolerance": "1 V"}))
    assert not [note for note in command._notes(told) if "motor encoder" in note]


def test_what_the_controller_is_not_told_is_said(tmp_path: Path) -> None:
    changed_robot = '[robot]\ncoulomb = "15 mN m"'
    (note,) = scenario(tmp_path, changed_robot).notes
    assert "keeps coulomb = 0.012 (the robot has 0.015); told = true tells it" in note
    told = scenario(tmp_path, changed_robot + "\ntold = true")
    assert told.notes == ()
    assert told.firmware == {"coulomb": 0.015}
    own = scenario(tmp_path, changed_robot + "\n[firmware]\ncoulomb = 0.013")
    assert own.notes == ()
    assert own.firmware == {"coulomb": 0.013}


def test_a_folder_that_is_not_there_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from terrapin_tools.commands.robot import new

    with pytest.raises(UserError) as found:
        new(tmp_path / "nowhere" / "mine.toml", like="roller", from_sheet=False)
    assert str(found.value) == f"{tmp_path}/nowhere/mine.toml: No such file or directory"
