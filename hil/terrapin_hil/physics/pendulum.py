"""A sphere driven by a pendulum: joint trajectory in, driving torque, swing and rolling distance out (Li et al. 2024).

Eq. 11 as reconstructed in pendulum.h: with the viscous term that the print lacks on the shell (`shell_share` = 1; 0 is
as printed), I1 of a thin shell. The joint is commanded, as in the paper's experiments: it gains speed at a constant
acceleration up to a greatest speed. The board is rolling friction; on sand the shell rolls at the slip and with the
torque that the contact model gives to a self-propelled sphere (no traction left over, quasi-steady).

>>> board = PendulumSphere()
>>> run = roll(board, *ramp(np.arange(0.0, 6.0, 0.005), acceleration=1.0, speed=2.0))
>>> late = run.torque[run.time > 3.0]  # nothing damps the bob while the joint keeps its rate
>>> print(f"{late.min():.2f} to {late.max():.2f} N m about {steady_torque(board, 2.0):.2f}; {run.distance[-1]:.2f} m")
0.54 to 2.28 N m about 1.41; 2.24 m
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies.pendulum_sphere import BODY
from terrapin_hil.physics.dynamic import Plan
from terrapin_hil.physics.tyre import ContactError

__all__ = ["PendulumSphere", "Rolling", "on_sand", "ramp", "roll", "steady_swing", "steady_torque"]


@dataclass(frozen=True)
class PendulumSphere:
    """Constants of Li et al. 2024, Table 1, SI; on the board by default. See pendulum.h."""

    radius: float = 0.220
    shell_mass: float = 4.29
    frame_mass: float = 2.0
    bob_mass: float = 1.5
    length: float = 0.130
    shell_inertia: float = 2.0 / 3.0 * 4.29 * 0.22**2  # of a thin shell, as Eq. 11 has it; Table 1 prints 0.133
    frame_inertia: float = 0.012
    bob_inertia: float = 0.001
    gravity: float = 9.81
    viscous: float = 0.7  # of the joint [N m s]
    shell_share: float = 1.0  # of that friction on the shell: 0 as printed
    f_o: float = 5e-4  # rolling friction, a number; where the printed 5e-4 is a length [m], that over the radius
    rolling_slip: float = 0.0
    incline: float = 0.0  # [rad]
    smoothing: float = 0.05  # [rad/s], of the sign of the rolling friction

    @property
    def mass(self) -> float:
        return self.shell_mass + self.frame_mass + self.bob_mass

    @property
    def largest_torque(self) -> float:
        """What the hanging bob can hold at most [N m]: m3 g l."""
        return self.bob_mass * self.gravity * self.length

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            free = name == "incline"
            above = name in ("radius", "shell_mass", "bob_mass", "length", "smoothing")
            if not np.isfinite(value) or (value < 0.0 and not free) or (value == 0.0 and above):
                expected = "a finite number" if free else "more than 0" if above else "at least 0"
                raise ContactError(f"pendulum sphere {name}: found {value:g}, expected {expected}")


@dataclass(frozen=True)
class Rolling:
    """A simulated run; arrays over time."""

    time: Array  # [s]
    joint_angle: Array  # psi = theta + phi [rad]
    joint_rate: Array  # [rad/s]
    shell_angle: Array  # theta [rad]
    shell_rate: Array
    swing: Array  # phi [rad] of the bob from the vertical, forward positive
    swing_rate: Array
    torque: Array  # T at the joint [N m]
    distance: Array  # [m]


def ramp(times: npt.ArrayLike, acceleration: float, speed: float, stop: float | None = None) -> tuple[Array, Array]:
    """(times, joint rate [rad/s]): from rest at `acceleration` [rad/s^2] to `speed`; from `stop` [s] on back to rest.

    Corners between samples are cut: sample finely, or so that they fall on samples.
    """
    t = np.asarray(times, dtype=np.float64)
    if not acceleration > 0.0 or not speed > 0.0:
        name, value = ("acceleration", acceleration) if not acceleration > 0.0 else ("speed", speed)
        raise ContactError(f"joint {name}: found {value:g}, expected more than 0")
    rate = np.clip(acceleration * t, 0.0, speed)
    if stop is not None:
        reached = min(acceleration * stop, speed)
        rate = np.where(t > stop, np.maximum(reached - acceleration * (t - stop), 0.0), rate)
    return t, rate


def roll(sphere: PendulumSphere, times: npt.ArrayLike, joint_rate: npt.ArrayLike) -> Rolling:
    """Roll from rest while the joint follows `joint_rate` [rad/s] (linear between samples); see dynamic.h."""
    t, rate = np.asarray(times, dtype=np.float64), np.asarray(joint_rate, dtype=np.float64)
    if t.ndim != 1 or t.shape != rate.shape or t.size < 2:
        raise ContactError(f"joint rate: found shapes {t.shape} and {rate.shape}, expected two equal rows of 2 or more")
    if not (np.diff(t) > 0.0).all() or not np.isfinite(t).all() or not np.isfinite(rate).all():
        raise ContactError("joint rate: found times that do not rise or numbers that are not finite")
    plan = Plan(BODY, [])
    values = plan.values()
    for name, value in asdict(sphere).items():
        values[plan.slots[name]] = value
    run = plan.run(values, t, {"joint_rate": rate}, float(rate[0]))
    m = run.motion
    return Rolling(
        time=t,
        joint_angle=m["angle"],
        joint_rate=m["omega"],
        shell_angle=m["shell_angle"],
        shell_rate=m["shell_rate"],
        swing=m["swing_angle"],
        swing_rate=m["swing_rate"],
        torque=run.channels["torque"],
        distance=sphere.radius * (1.0 - sphere.rolling_slip) * m["shell_angle"],
    )


def steady_torque(sphere: PendulumSphere, rate: float) -> float:
    """T [N m] of steady rolling at the joint's (and shell's) `rate` [rad/s] forward; Eq. 11 with all derivatives 0."""
    weight = sphere.mass * sphere.gravity
    uphill = sphere.radius * weight * (np.sin(sphere.incline) + sphere.f_o * np.cos(sphere.incline))
    return float(uphill + sphere.shell_share * sphere.viscous * rate)


def steady_swing(sphere: PendulumSphere, rate: float) -> float:
    """phi [rad] of steady rolling. ContactError where the bob would have to stand beyond the horizontal.

    >>> round(float(np.degrees(steady_swing(PendulumSphere(), 6.283))), 3)  # one turn a second
    0.252
    """
    sine = (steady_torque(sphere, rate) - sphere.viscous * rate) / sphere.largest_torque
    if abs(sine) > 1.0:
        raise ContactError(f"steady swing: found a sine of {sine:.3g} at {rate:g} rad/s, expected -1 to 1")
    return float(np.arcsin(sine))


def on_sand(sphere: PendulumSphere, torque: float, slip: float) -> PendulumSphere:
    """The same sphere on ground that takes `torque` [N m] at `slip` to roll (both at no traction, from the contact)."""
    if not -1.0 < slip < 1.0:
        raise ContactError(f"slip: found {slip:g}, expected between -1 and 1")
    return replace(sphere, f_o=torque / (sphere.radius * sphere.mass * sphere.gravity), rolling_slip=slip)
