"""What a robot can do of a scenario that was written for another: how soon it settles, whether its shell can be made to
slip, which faults its own numbers let the controller tell, which grounds it can tell apart.

`Unsuited` is a ValueError with the reason, in numbers of the robot.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from terrapin_hil.messages import interface
from terrapin_hil.robot.plant import TERRAINS, rolling_steady_speed
from terrapin_hil.robot.plant import Robot as Plant
from terrapin_hil.robots import Robot

__all__ = [
    "Unsuited",
    "check_encoder",
    "check_gate",
    "check_jump",
    "check_slip",
    "check_wheel_jump",
    "climbing",
    "over_current_first",
    "settling",
    "told_apart",
    "tolerance",
    "torque_per_ampere",
]

JUMP = (
    0.2,
    0.008,
)  # m/s and s: what the controller takes for the jump of a ground wheel, 25 m/s^2 in 8 ms, and two counts
ALIKE = 0.1  # of a resistance: grounds that are nearer are not told apart


class Unsuited(ValueError):
    """The scenario is not for this robot; the message says why."""

    def __init__(self, robot: Robot, why: str) -> None:
        super().__init__(f"does not suit the {robot.name}: {why}")


def torque_per_ampere(robot: Robot) -> float:
    """Of the motor at the shell, before what the gear loses; back-EMF a shell speed as well [N m/A]."""
    return robot.wheel_gear * robot.plant["torque_constant"]


def _passed(robot: Robot) -> float:
    """What of that comes through the gear."""
    return torque_per_ampere(robot) * robot.plant["gear_efficiency"]


def settling(robot: Robot) -> float:
    """Time constant [s] of the slowest mode of the robot on a floor without resistance, at constant voltage.

    The linear equations of docs/simulator.md in shell and swing angle: mass matrix, gravity of the swing, as damping
    the motor's K^2/R_e with the viscous friction, both on the drive wheel's speed. What a gear loses is
    left out: it is no linear friction, and a free swing drives the gear forth and back.
    """
    p, gear = robot.plant, robot.wheel_gear
    radius, inside = p["radius"], p["radius"] - p["drive_radius"]
    imbalance = inside * p["drive_mass"] + p["arm"] * p["body_mass"]
    shell = radius**2 * (p["shell_mass"] + p["body_mass"] + p["drive_mass"]) + p["shell_inertia"]
    swing = p["body_inertia"] + p["body_mass"] * p["arm"] ** 2 + p["drive_mass"] * inside**2
    drive = np.array([gear, gear - 1.0])  # turns of the drive wheel, for shell and swing
    mass = np.array([[shell, radius * imbalance], [radius * imbalance, swing]]) + p["drive_inertia"] * np.outer(
        drive, drive
    )
    damping = (torque_per_ampere(robot) ** 2 / p["armature_resistance"] + p["viscous"]) * np.ones((2, 2))
    stiffness = np.diag([0.0, p["gravity"] * imbalance])
    system = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
    )
    modes = np.linalg.eigvals(system)
    return float(1.0 / np.min(-modes.real[np.abs(modes) > 1e-6]))


def check_slip(robot: Robot, terrain: str, slope: float) -> None:
    """Unsuited where the ground has grip for more torque than motor (at its current limit) or body can give."""
    ground, p = TERRAINS[terrain], robot.plant
    radius, inside = p["radius"], p["radius"] - p["drive_radius"]
    imbalance = inside * p["drive_mass"] + p["arm"] * p["body_mass"]
    most = _passed(robot) * robot.limits["current"] - robot.quantity("coulomb")
    held = p["gravity"] * imbalance * math.sin(robot.limits.get("swing", math.radians(90.0)))
    needed = (ground.mu + ground.f_o) * math.cos(slope) * robot.weight * radius
    if min(most, held) < needed:
        what = f"the motor gives {most:.3g} N m at limits.current" if most < held else f"its body holds {held:.3g} N m"
        raise Unsuited(robot, f"on {terrain} its shell slips at {needed:.3g} N m, and {what}")


def tolerance() -> float:
    """encoder_tolerance of the robot of this process [V]."""
    parameter = interface().parameter("encoder_tolerance")
    return parameter.default * parameter.scale


def _needed(robot: Robot, terrain: str, speed: float) -> float:
    """Current [A] of rolling at a shell speed [rad/s]."""
    ground, p = TERRAINS[terrain], robot.plant
    rolling = (ground.f_o + ground.f_s * speed**2) * robot.weight * p["radius"]
    return (rolling + robot.quantity("coulomb") + robot.quantity("viscous") * speed) / _passed(robot)


def _left(robot: Robot, terrain: str) -> float:
    """Back-EMF [V] that the motor keeps where the current limit takes it to be none."""
    return robot.plant["armature_resistance"] * (robot.limits["current"] - _needed(robot, terrain, 0.0))


def climbing(robot: Robot, terrain: str, slope: float, volts: float) -> float:
    """Shell speed [rad/s] at which it rolls up a slope, or on the level where the ground has no grip for the slope.

    Unsuited where its current limit does not let it.
    """
    ground = TERRAINS[terrain]
    if math.tan(abs(slope)) >= ground.mu:
        slope = 0.0
    uphill = math.sin(abs(slope)) * robot.weight * robot.plant["radius"]
    needed = _needed(robot, terrain, 0.0) + uphill / _passed(robot)
    if needed > 0.95 * robot.limits["current"]:
        raise Unsuited(
            robot,
            f"{terrain} at {math.degrees(slope):.3g} deg takes {needed:.3g} A, and "
            f"limits.current is {robot.limits['current']:g} A",
        )
    steeper = replace(ground, f_o=ground.f_o + math.sin(abs(slope)))
    return rolling_steady_speed(Plant(**robot.plant), steeper, volts)


def check_encoder(robot: Robot, terrain: str, speed: float, times: float) -> None:
    """Unsuited where a motor encoder that is wrong by `times` the shell's speed [rad/s] stays nearer to the back-EMF
    than encoder_tolerance: the current limit, which believes it, soon keeps the motor slower than that."""
    emf, left = times * torque_per_ampere(robot) * speed, _left(robot, terrain)
    if min(emf, left) < 1.1 * tolerance():
        cause = f"at {speed:.3g} rad/s its back-EMF is" if emf < left else "its current limit leaves it"
        raise Unsuited(
            robot,
            f"a wrong motor encoder is told from {tolerance():.3g} V on, and "
            f"{cause} {min(emf, left):.3g} V: a smaller encoder_tolerance in [firmware] of its file tells it",
        )


def check_gate(robot: Robot, misalignment: float) -> None:
    """Unsuited where an encoder's error once a turn [rad, of the drive wheel] alone makes more change of the angular
    momentum between two windows than the gate lets through."""
    shaken = 4.0 * robot.quantity("inertia") * misalignment / robot.wheel_gear / robot.window**2
    if shaken > robot.gate:
        raise Unsuited(
            robot,
            f"with encoders of ordinary quality its momentum changes by {1e3 * shaken:.2g} mN m, "
            f"more than estimator.gate, {1e3 * robot.gate:.2g} mN m",
        )


def over_current_first(robot: Robot, speed: float, times: float) -> bool:
    """A motor encoder that is wrong by `times` the shell's speed [rad/s] makes a current above over_current at once."""
    wrong = times * torque_per_ampere(robot) * speed / robot.plant["armature_resistance"]
    return wrong - robot.limits["current"] > robot.limits["over_current"]


def check_jump(robot: Robot, terrain: str, speed: float, pause: float) -> None:
    """Unsuited where an encoder that stands still for `pause` [s] at a shell speed [rad/s] then makes no jump:
    meanwhile the current limit, which believes it, may slow the motor."""
    slowed = min(speed, _left(robot, terrain) / torque_per_ampere(robot))
    counts = slowed * robot.wheel_gear * robot.counts / (2.0 * math.pi) * pause
    if counts < 1.2 * robot.jump:
        raise Unsuited(robot, f"in {pause:g} s it counts {counts:.0f}, and a jump is more than {robot.jump}")


def check_wheel_jump(robot: Robot, speed: float) -> None:
    """Unsuited where a ground wheel that sticks at this speed [m/s] of the robot does not jump."""
    least = JUMP[0] + 2.0 * 2.0 * math.pi * robot.wheel_radius / robot.wheel_counts / JUMP[1]
    if speed < 1.2 * least:
        raise Unsuited(
            robot, f"it rolls at {speed:.3g} m/s, and a ground wheel that stops makes no jump of {least:.3g} m/s"
        )


def told_apart(terrain: str, speed: float) -> bool:
    """Whether the resistance of a terrain at a shell speed [rad/s] is that of no other."""

    def resistance(name: str) -> float:
        return TERRAINS[name].f_o + TERRAINS[name].f_s * speed**2

    own = resistance(terrain)
    return all(abs(resistance(other) - own) > ALIKE * own for other in TERRAINS if other != terrain)
