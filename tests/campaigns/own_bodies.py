"""Bodies of the papers that move, once more in NumPy: nothing of hil.

A cylinder driven by a voltage (Lagrange's equations of docs/simulator.md), and a car on soft soil with four wheels of
its own (Vella et al. 2024, Eqs. 1 to 4, with the contact of physics/ground/tyre.h). Runge-Kutta of fourth order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RectBivariateSpline

__all__ = ["Car", "Cylinder", "car", "cylinder"]

Array = npt.NDArray[np.float64]
SMOOTH = 0.05  # rad/s, of the sign of a friction
G = 9.81


@dataclass(frozen=True)
class Cylinder:
    """What the cylinder hides: slope [rad] (of each run, or of all), friction at a swing of 90 degrees [N m], and the
    share by which the winding's resistance rises a kelvin."""

    f_o: float = 0.07
    coulomb: float = 0.012
    viscous: float = 1e-3
    slope: Array | float = 0.0
    swing_friction: float = 0.0
    copper: float = 0.0
    thermal: tuple[float, float] = (6.0, 4.0)  # K/W and s of the winding


def cylinder(body: Cylinder, time: Array, voltage: Array, step: float = 2e-3) -> dict[str, Array]:
    """Drive's rate [rad/s], current [A], swing [rad] and winding [degC], each (runs, samples), from rest.

    time (samples,), evenly spaced; voltage (runs, samples), linear between them.
    """
    radius, wheel, arm = 0.080, 0.018, 0.062
    shell, frame, drive = 0.3, 0.5, 1.1
    i_shell, i_frame, i_drive = 1.92e-3, 2.0e-4, 1.8e-4
    k_t, ohm, gear = 0.10, 5.0, radius / wheel
    ratio, mass = (radius - wheel) / wheel, shell + frame + drive
    hang = (radius - wheel) * drive + arm * frame
    swing_inertia = i_frame + frame * arm**2 + drive * (radius - wheel) ** 2
    slope = np.broadcast_to(np.asarray(body.slope, dtype=np.float64), voltage.shape[:1])

    def current(y: Array, volts: Array) -> Array:
        return np.asarray((volts - k_t * gear * y[3]) / (ohm * (1.0 + body.copper * (y[4] - 25.0))))

    def rates(y: Array, volts: Array) -> Array:
        beta, alpha, w_shell, w_drive, warm = y
        amps, phi = current(y, volts), alpha - beta
        direction = np.tanh(w_drive / SMOOTH)
        friction = (body.coulomb + body.swing_friction * np.abs(np.sin(phi))) * direction + body.viscous * w_drive
        couple = radius * hang * np.cos(phi - slope)
        m11 = radius**2 * mass + i_shell + i_drive + swing_inertia - 2.0 * couple
        m12 = i_drive * ratio + couple - swing_inertia
        m22 = swing_inertia + i_drive * ratio**2
        pull = G * hang * np.sin(phi)
        q1 = pull + radius * hang * np.sin(phi - slope) * (w_drive - w_shell) ** 2
        q1 = q1 - mass * G * radius * np.sin(slope)
        q1 = q1 - body.f_o * radius * mass * G * np.cos(slope) * np.tanh(w_shell / SMOOTH)
        q2 = gear * k_t * amps - friction - pull
        determinant = m11 * m22 - m12 * m12
        heat, slow = body.thermal
        return np.array(
            [
                w_shell,
                w_drive,
                (m22 * q1 - m12 * q2) / determinant,
                (m11 * q2 - m12 * q1) / determinant,
                (heat * amps**2 * ohm - (warm - 25.0)) / slow,
            ]
        )

    start = np.zeros((5, len(voltage)))
    start[4] = 25.0
    found = _samples(rates, start, time, voltage, step)
    amps = np.stack([current(y, volts) for y, volts in zip(found, voltage.T, strict=True)])
    return {"omega": found[:, 3].T, "current": amps.T, "swing": (found[:, 1] - found[:, 0]).T, "winding": found[:, 4].T}


@dataclass(frozen=True)
class Car:
    """Soil, and what a car hides: k_s of its rear wheels over that of the front ones, of the left ones over the mean
    (of the right ones as much less), and dry friction of each hub [N m]."""

    soil: Mapping[str, float] = field(
        default_factory=lambda: {"k_s": 5.353e5, "n": 0.71, "cohesion": 1150.0, "angle": 0.5498, "shear": 0.036}
    )
    rear: float = 1.0
    left: float = 1.0
    hub: float = 0.0


def car(body: Car, time: Array, torque: Array, step: float = 2e-3) -> dict[str, Array]:
    """Rates of the wheels [rad/s], each (runs, samples), from rest; torque (runs, samples) of a rear shaft [N m]."""
    mass, drag, front, rear, height, inertia, relax = 1797.0, 0.55, 1.10, 1.47, 0.65, 1.2, 0.30
    base, tyre, stiff, floor = front + rear, 0.35565, 180e3, 0.3
    sides = np.array([body.left, 2.0 - body.left, body.rear * body.left, body.rear * (2.0 - body.left)])  # fl fr rl rr
    tables = [_tyre({**body.soil, "k_s": body.soil["k_s"] * share}) for share in sides]

    def rates(y: Array, half: Array) -> Array:
        speed, omega, force, moment = y[0], y[1:5], y[5:9], y[9:13]
        pull = (force.sum(axis=0) - drag * speed**2) / mass
        shift = mass * height / (2.0 * base) * pull
        ahead = np.maximum(mass * G * rear / (2.0 * base) - shift, 300.0)
        behind = np.maximum(mass * G * front / (2.0 * base) + shift, 300.0)
        load = np.stack([ahead, ahead, behind, behind])
        driven = np.stack([half * ahead / behind] * 2 + [half] * 2)
        rim = (tyre - load / (3.0 * stiff)) * omega
        driving = rim >= speed
        braked = (rim - speed) / np.maximum(speed, floor)
        slip = np.where(
            driving,
            (rim - speed) / np.maximum(rim, floor),
            1.0 - np.minimum(1.0 / np.maximum(1.0 + braked + 1e-9, 1e-9), 3.0),
        )
        steady = np.array([table(load[i], slip[i]) for i, table in enumerate(tables)])  # (wheels, 2, runs)
        quick = np.maximum(np.maximum(np.abs(speed), np.abs(rim)), floor) / relax
        change = np.zeros_like(y)
        change[0] = pull
        change[1:5] = (driven - moment - body.hub * np.tanh(omega / SMOOTH)) / inertia
        change[5:9] = quick * (steady[:, 0] - force)
        change[9:13] = quick * (steady[:, 1] - moment)
        change[:5] = np.where(y[:5] <= 0.0, np.maximum(change[:5], 0.0), change[:5])
        return change

    found = _samples(rates, np.zeros((13, len(torque))), time, torque, step, held=5)
    names = ("omega_fl", "omega_fr", "omega_rl", "omega_rr")
    return {name: found[:, 1 + i].T for i, name in enumerate(names)}


def _samples(
    rates: Callable[[Array, Array], Array], start: Array, time: Array, drive: Array, step: float, held: int = 0
) -> Array:
    """States (samples, states, runs); the first `held` stay at or above 0."""
    count = max(round((time[1] - time[0]) / step), 1)
    h = (time[1] - time[0]) / count
    y, found = start, [start]
    for k in range(len(time) - 1):
        for part in range(count):
            first, mid, last = (drive[:, k] + (drive[:, k + 1] - drive[:, k]) * (part + s) / count for s in (0, 0.5, 1))
            k1 = rates(y, first)
            k2 = rates(y + 0.5 * h * k1, mid)
            k3 = rates(y + 0.5 * h * k2, mid)
            k4 = rates(y + h * k3, last)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            y[:held] = np.maximum(y[:held], 0.0)
        found.append(y)
    return np.array(found)


def _tyre(soil: Mapping[str, float]) -> Callable[[Array, Array], Array]:
    """Thrust [N] and torque [N m] of a wheel (2, points) over load and slip, by splines through its equilibria."""
    loads, slips = (
        np.linspace(250.0, 9000.0, 36),
        np.concatenate([np.linspace(-2.0, -0.3, 12), np.linspace(-0.25, 1.0, 61)]),
    )
    load, slip = (grid.reshape(-1) for grid in np.meshgrid(loads, slips, indexing="ij"))
    low, high = np.full(load.size, 1e-4), np.full(load.size, 0.33)
    for _ in range(50):
        middle = np.sqrt(low * high)
        carries = _stresses(soil, middle, load, slip)[1] > load
        low, high = np.where(carries, low, middle), np.where(carries, middle, high)
    thrust, _, torque = _stresses(soil, np.sqrt(low * high), load, slip)
    shape = (loads.size, slips.size)
    splines = [RectBivariateSpline(loads, slips, each.reshape(shape)) for each in (thrust, torque)]
    return lambda at, s: np.array([each.ev(at, s) for each in splines])


def _stresses(soil: Mapping[str, float], sink: Array, load: Array, slip: Array) -> tuple[Array, Array, Array]:
    """F_x, F_z [N] and M_y [N m] at sinkages and slips (points,), of a tyre that its load flattens."""
    outer, width, stiff = 0.35565, 0.235, 180e3
    flat = load / stiff
    big, rolling = outer * (1.0 + flat / sink), outer - flat / 3.0
    entry = np.arccos(np.clip(1.0 - sink / big, -1.0, 1.0))
    leave = -np.arcsin(np.minimum(0.9, np.sqrt(2.0 * outer * flat) / big))
    peak = np.minimum(0.95, 0.3 + 0.1 * np.abs(slip)) * entry
    node, weight = np.polynomial.legendre.leggauss(24)
    share, weight = 0.5 + 0.5 * node, 0.5 * weight
    total = np.zeros((3, len(sink)))
    for begin, end, ahead in ((peak, entry, True), (leave, peak, False)):
        angle = begin[:, None] + (end - begin)[:, None] * share
        at = angle
        if not ahead:
            at = entry[:, None] - (angle - leave[:, None]) * ((entry - peak) / (peak - leave))[:, None]
        bite = np.maximum(np.cos(at) - np.cos(entry)[:, None], 0.0)
        sigma = soil["k_s"] * (big[:, None] * bite) ** soil["n"]
        turned = (entry[:, None] - angle) - (1.0 - slip[:, None]) * (np.sin(entry)[:, None] - np.sin(angle))
        j = big[:, None] * turned
        tau = (
            np.sign(j) * (soil["cohesion"] + sigma * np.tan(soil["angle"])) * (1.0 - np.exp(-np.abs(j) / soil["shear"]))
        )
        area = width * big[:, None] * (end - begin)[:, None] * weight
        total[0] += ((tau * np.cos(angle) - sigma * np.sin(angle)) * area).sum(axis=1)
        total[1] += ((sigma * np.cos(angle) + tau * np.sin(angle)) * area).sum(axis=1)
        total[2] += (tau * rolling[:, None] * area).sum(axis=1)
    return total[0], total[1], total[2]
