"""The 150 N sphere of the tests: the robot of Li et al. 2024 with a bob of 9 kg, and the laws of its ground.

The drive is typical of a 70 W, 24 V flat motor with a planetary gear of 66:1 [our assumption; the paper names none].
"""

from __future__ import annotations

from collections.abc import Mapping

from terrapin_hil.physics import soils
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.robot.compiled_effects import ActiveEffect
from terrapin_hil.robot.plant import Ground, Robot, Segment, SoftGround, Terrain
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

__all__ = ["LAWS", "SAND", "SPHERE", "SUPPLY", "active", "rolling"]

SPHERE = Robot(
    radius=0.22,
    drive_radius=0.22 / 66.0,
    arm=0.13,
    shell_mass=4.29 + 2.0,
    body_mass=9.0,
    drive_mass=1e-9,
    shell_inertia=0.133,
    body_inertia=0.013,
    drive_inertia=1.81e-5,
    torque_constant=0.0369,
    armature_resistance=0.608,
    coulomb=0.6,
    viscous=0.05,
)
SAND = SoftGround(soils.library()["dry_sand_li"], shape="sphere")
SUPPLY = 32.0  # V: 4, 8, 12 and 16 V are whole steps of the duty


def active(name: str, **values: float) -> ActiveEffect:
    return ActiveEffect(catalogue()[name], values)


PUSHED = active("bulldozing", scale=1.0)
# law -> effects, slip_depth [m]: Eqs. 1 to 6 alone, with Eqs. 8 and 9, with the rut that slipping digs
LAWS: Mapping[str, tuple[tuple[ActiveEffect, ...], float]] = {
    "T1": ((), 0.0),
    "T2": ((PUSHED, active("slip_sinkage", xi1=2.0, xi2=0.45, xi3=2.0)), 0.0),
    "C": ((PUSHED,), 7e-3),
}


def rolling(
    law: str,
    duration: float,
    slope: float = 0.0,
    tow: float = 0.0,
    robot: Robot = SPHERE,
    substeps: tuple[int, int] = (1, 8),
) -> Simulation:
    """A run of `duration` [s] that is to be driven, on a `slope` [rad] and with a load [N] to tow."""
    effects, slip_depth = LAWS[law]
    ground = Ground((Segment(Terrain(), slope=slope),), contact=SAND, slip_depth=slip_depth)
    towed = ((0.0, tow),) if tow else ()
    idle = (Order(0.0, "idle"),)
    scenario = Scenario("sphere", duration, ground, idle, robot=robot, supply=SUPPLY, effects=effects, tow=towed)
    return Simulation(scenario, *substeps)
