"""The robot on soft soil at a constant motor voltage: its time response, with slip and sinkage from the contact model.

>>> from dataclasses import replace
>>> from terrapin_hil.physics.soils import library
>>> sand = SoftGround(replace(library()["sand_reina"], shear_modulus=0.025))
>>> run = time_response(Robot(), sand, 5.0, 20.0)
>>> f"{run['speed'][-1]:.4f} m/s, slip {run['slip'][-1]:.4f}, {1e3 * run['sinkage'][-1]:.3f} mm"
'0.1162 m/s, slip 0.4687, 7.376 mm'
"""

from __future__ import annotations

from terrapin_hil.arrays import Array
from terrapin_hil.robot.plant import Ground, Robot, Segment, SoftGround, Terrain
from terrapin_hil.robot.soft_ground import check_step
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

__all__ = ["time_response"]


COLUMNS = (
    "time",
    "position",
    "speed",
    "omega",
    "swing_angle",
    "swing_rate",
    "slip",
    "sinkage",
    "contact_torque",
    "traction",
    "motor_torque",
    "internal_friction",
    "current",
)


def time_response(
    robot: Robot, ground: SoftGround, voltage: float, duration: float, slope: float = 0.0
) -> dict[str, Array]:
    """Motion from rest at a constant motor voltage (Reina et al. 2006, Fig. 3, with slip): arrays by column, one a ms.

    Columns are those of the simulator's truth (docs/simulator.md), SI. The voltage is quantised as by the motor driver,
    to a part in 30,000.

    Parameters
    ----------
    voltage : V.
    duration : s.
    slope : rad, uphill positive.

    Raises
    ------
    ContactError : the soil cannot carry the robot, or the speed is too high.
    """
    supply = max(12.0, abs(voltage))
    check_step(ground, robot, 1e-3, supply * robot.drive_radius / max(robot.torque_constant, 1e-12))
    path = Ground((Segment(Terrain(), slope=slope),), contact=ground)
    simulation = Simulation(Scenario("response", duration, path, (Order(0.0, "idle"),), robot=robot, supply=supply))
    simulation.drive(voltage, len(simulation.records))
    truth = simulation.truth()
    return {name: truth[name].copy() for name in COLUMNS}
