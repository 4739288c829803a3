"""MuJoCo in the plant's place (docs/mujoco): what the controller says of the ground, and MuJoCo's contact torque."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import terrapin_tools as terrapin
from terrapin_hil import robots
from terrapin_hil.run.session import chosen_scenario

pytest.importorskip("mujoco")
FILE = Path(__file__).resolve().parents[2] / "docs" / "mujoco" / "mujoco_plant.py"
CYLINDER = ("cylinder", "", "steady_sand", 0.3)  # shape, robot, scenario, the estimator's window [s]
SPHERE = ("sphere", "sphere", "level", 1.44)


def plant_class() -> Any:
    found = importlib.util.spec_from_file_location("mujoco_plant", FILE)
    assert found
    assert found.loader
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module.MujocoPlant


@pytest.fixture(autouse=True)
def _same_robot_after() -> Any:
    yield
    robots.select(robots.DEFAULT)


@pytest.mark.parametrize("degrees", [0.0, 2.0, 4.0])
@pytest.mark.parametrize(("shape", "robot", "name", "window"), [CYLINDER, SPHERE], ids=["cylinder", "sphere"])
def test_the_contact_torque_is_mujocos(shape: str, robot: str, name: str, window: float, degrees: float) -> None:
    """20 s with the sensors of ordinary parts: the worst within 4 stated sd, the rms of error over sd at most 1.3."""
    scenario = chosen_scenario(name, robot, {"path.1.slope": f"{degrees}deg", "sensors.kit": "real"})
    plant = plant_class()(scenario.robot, shape, math.radians(degrees))
    truth, said = [], []
    with terrapin.Session(scenario, plant=plant) as s:
        while s.ticks < 20_000:
            s.step()
            truth.append(s.truth["contact_torque"])
            if s.ticks % 10 == 0 and s.get("GROUND.valid") == 1.0:
                said.append((s.ticks, s["GROUND.torque"], s["GROUND.torque_sd"]))
        assert s.state == "run"
        assert not s.faults
    held, ticks = np.array(truth), round(1000 * window)
    error = np.array([(torque - np.mean(held[max(0, at - ticks) : at])) / sd for at, torque, sd in said])
    assert len(error) > 900  # of 2,000 messages
    assert np.max(np.abs(error)) <= 4.0
    assert np.sqrt(np.mean(error**2)) <= 1.3
    # MuJoCo's own statics: rolling friction and the slope's share, in the last two seconds
    expected = 0.05 * scenario.robot.radius * scenario.robot.weight * math.cos(math.radians(degrees))
    expected += scenario.robot.radius * scenario.robot.weight * math.sin(math.radians(degrees))
    assert abs(np.mean(held[-2000:]) - expected) < 0.02 * expected


def test_the_limiter_holds_the_slip_where_the_traction_rises_with_it() -> None:
    """A carriage takes the axle, as in `carriage_limiter`: within 0.03 of the limit of 0.5."""
    scenario = chosen_scenario("carriage_limiter")

    def carriage(time: float) -> float:
        return 0.36 * time if time < 1.0 else max(0.36 - 0.032 * (time - 1.0), 0.15)

    plant = plant_class()(scenario.robot, friction=1.0, impratio=0.0035, carriage=carriage)
    slip = []
    with terrapin.Session(scenario, plant=plant) as s:
        while s.ticks < 12_000:
            slip.append(s.step().truth["slip"])
        assert s.state == "limiting"
    assert np.max(np.abs(np.array(slip[8000:]) - 0.5)) < 0.03
