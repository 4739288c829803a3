"""The simulated robot: its constants, the ground under it, and the reference dynamics of pure rolling.

The work is done in C (physics, robot/native); here stand the numbers that go in. The constants are those of Reina et
al. 2006, and our assumptions where the paper prints none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.library import ffi, library
from terrapin_hil.messages import interface
from terrapin_hil.physics import soils
from terrapin_hil.physics.contact import Shape
from terrapin_hil.robots import cylinder

__all__ = [
    "TERRAINS",
    "Ground",
    "Robot",
    "Segment",
    "SoftGround",
    "Terrain",
    "Winding",
    "rolling",
    "rolling_steady_speed",
]


def _q(default: float, unit: str, low: float = 1e-9, high: float = 1e6) -> Any:
    return field(default=default, metadata={"unit": unit, "low": low, "high": high})


def _p(name: str, unit: str, low: float = 1e-9, high: float = 1e6) -> Any:
    """A constant of the cylinder's file by default."""
    metadata = {"unit": unit, "low": low, "high": high}
    return field(default_factory=lambda: cylinder().plant[name], metadata=metadata)


@dataclass(frozen=True)
class Robot:
    """Constants of a robot, SI; see terrapin_hil/physics/robot.h. Those of the cylinder by default."""

    bases: ClassVar = ("rolling_steady", "cmr")  # base models whose effects it can have

    radius: float = _p("radius", "m")
    drive_radius: float = _p("drive_radius", "m")
    arm: float = _p("arm", "m")
    shell_mass: float = _p("shell_mass", "kg")
    body_mass: float = _p("body_mass", "kg")
    drive_mass: float = _p("drive_mass", "kg")
    shell_inertia: float = _p("shell_inertia", "kg m^2")
    body_inertia: float = _p("body_inertia", "kg m^2")
    drive_inertia: float = _p("drive_inertia", "kg m^2")
    gravity: float = _p("gravity", "m/s^2", 0.0)
    torque_constant: float = _p("torque_constant", "N m/A", 0.0)
    armature_resistance: float = _p("armature_resistance", "ohm")
    resistance_slope: float = _p("resistance_slope", "1/K", 0.0, 0.1)
    coulomb: float = _p("coulomb", "N m", 0.0)
    viscous: float = _p("viscous", "N m s/rad", 0.0)
    gear_efficiency: float = _p("gear_efficiency", "1", 1e-3, 1.0)
    driven_ratio: float = _p("driven_ratio", "1", 1e-3, 20.0)
    motor_coulomb: float = _p("motor_coulomb", "N m", 0.0)
    motor_viscous: float = _p("motor_viscous", "N m s/rad", 0.0)

    @property
    def weight(self) -> float:
        """W [N].

        >>> round(Robot().weight, 3)
        18.639
        """
        return (self.shell_mass + self.body_mass + self.drive_mass) * self.gravity


@dataclass(frozen=True)
class Terrain:
    """One kind of ground; see terrapin_hil/physics/ground/ground.h. f_s in s^2/rad^2, the rest dimensionless."""

    f_o: float = _q(0.0, "1", 0.0, 1.0)
    f_s: float = _q(0.0, "s^2/rad^2", 0.0, 1.0)
    mu: float = _q(0.5, "1", 0.0, 5.0)
    s_k: float = _q(0.1, "1", 1e-3, 10.0)
    softness: float = _q(0.0, "1", 0.0, 1.0)


# Resistance: Reina et al. 2006, Table 1. Traction and the hard floor: our assumption.
TERRAINS: Mapping[str, Terrain] = {
    "hard_floor": Terrain(0.010, 0.0, 0.70, 0.02, 0.0),
    "agricultural": Terrain(0.028, 0.098e-3, 0.40, 0.08, 0.5),
    "red_terrain": Terrain(0.037, 0.15e-3, 0.35, 0.10, 0.5),
    "dry_peat": Terrain(0.045, 0.12e-3, 0.25, 0.15, 1.0),
    "sand": Terrain(0.092, 0.28e-3, 0.20, 0.20, 1.0),
}


@dataclass(frozen=True)
class Segment:
    """From `start` on [m] the ground is `terrain` at `slope` [rad]; it passes over smoothly within `transition` [m]."""

    terrain: Terrain
    start: float = 0.0
    slope: float = 0.0
    transition: float = 0.05
    contact: SoftGround | None = None  # another soil than the ground's, where that is a contact model;
    firm: bool = False  # or the terrain there as well


@dataclass(frozen=True)
class SoftGround:
    """Soil whose contact model carries and drives the shell; see ground/grip.h.

    A wheel is Reina et al. 2006, Eqs. 9-15, a sphere Li et al. 2024, Eqs. 1-6. A sphere takes the soil's stiffness at
    `width`, which counts only where that depends on one.
    """

    soil: soils.Soil
    width: float = 0.15  # of the shell [m]; the paper does not print it
    recovery: float = 0.0  # exit angle over entry angle
    shape: Shape = "wheel"

    @property
    def base(self) -> str:
        """The base model whose effects on the soil it can have."""
        return self.base_of(self.shape)

    @staticmethod
    def base_of(shape: Shape) -> str:
        """That of the contact of a shell of this shape."""
        return f"{shape}_contact"


@dataclass(frozen=True)
class Ground:
    """The path, and how a slipping shell digs in (our assumption; see terrapin_hil/physics/ground/ground.h).

    With `contact` the soil replaces terrains and their rut; of the segments slope and, where it has one, soil count.
    """

    segments: tuple[Segment, ...]
    dig_length: float = _q(0.30, "m")
    leave_length: float = _q(0.10, "m")
    rut_friction: float = _q(1.0, "1", 0.0, 10.0)
    dig_slip: float = _q(0.5, "1", 0.0, 1.0)
    slip_depth: float = _q(0.0, "m", 0.0, 1.0)
    contact: SoftGround | None = None

    @property
    def soils(self) -> tuple[SoftGround, ...]:
        """The soils of the segments, of all but firm ones; none without contact model."""
        found = [None if segment.firm else segment.contact or self.contact for segment in self.segments]
        return tuple(soil for soil in found if soil is not None)


def _reference() -> float:
    return interface().constants["reference_temperature"]


@dataclass(frozen=True)
class Winding:
    """Temperature of the motor winding. With a `profile` of (time, degC) it follows that, else it heats by its loss."""

    start: float = field(default_factory=_reference, metadata={"unit": "degC", "low": -50.0, "high": 300.0})
    ambient: float = field(default_factory=_reference, metadata={"unit": "degC", "low": -50.0, "high": 100.0})
    to_ambient: float = _q(12.0, "K/W", 1e-3)
    heat_capacity: float = _q(40.0, "J/K", 1e-3)
    profile: tuple[tuple[float, float], ...] = ()


def rolling_steady_speed(robot: Robot, terrain: Terrain, voltage: float) -> float:
    """Shell speed [rad/s] of steady pure rolling forward; Reina et al. 2006, Eq. (12). 0 below the starting voltage.

    >>> round(rolling_steady_speed(Robot(), TERRAINS["sand"], 5.0), 5)
    6.81112
    """
    gear = robot.radius / robot.drive_radius
    a = terrain.f_s * robot.radius * robot.weight
    eta = robot.gear_efficiency
    b = eta * (gear**2 * robot.torque_constant**2 / robot.armature_resistance + robot.motor_viscous) + robot.viscous
    c = terrain.f_o * robot.radius * robot.weight + robot.coulomb
    c -= eta * (gear * robot.torque_constant * voltage / robot.armature_resistance - robot.motor_coulomb)
    if c >= 0:
        return 0.0
    return float(-2 * c / (b + np.sqrt(b * b - 4 * a * c)))


def rolling(
    robot: Robot,
    terrain: Terrain,
    voltage: float,
    times: Array,
    *,
    start: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    smoothing: float = 0.05,
    dt: float = 1e-3,
) -> dict[str, Array]:
    """Pure rolling with tanh friction, RK4 with step `dt` [s]: state and torques at `times` (rising, whole steps).

    `start` is (beta, alpha, beta_dot, alpha_dot). Reina et al. 2006, Eqs. 3-8 as corrected in physics/rolling.h.
    """
    f, lib = ffi(), library()
    body = f.new("hil_robot *", asdict(robot))
    load = f.new("hil_rolling_load *", (voltage, terrain.f_o, terrain.f_s, smoothing))
    state = f.new("hil_rolling_state *", start)
    rows = []
    done = 0
    for time in times:
        steps = round(float(time) / dt)
        lib.hil_rolling_run(body, load, dt, steps - done, state)
        done = steps
        torque = lib.hil_rolling_evaluate(body, load, state)
        energy = lib.hil_rolling_energy(body, state)
        motion = (state.beta, state.alpha, state.beta_rate, state.alpha_rate)
        rows.append((*motion, torque.motor, torque.internal_friction, torque.resistance, energy))
    names = ("beta", "alpha", "beta_dot", "alpha_dot", "C_m", "C_o", "C_r", "energy")
    return dict(zip(names, np.array(rows).T, strict=True))
