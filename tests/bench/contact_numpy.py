"""The sphere's contact in plain NumPy: what the compiled one is held against, for its numbers and for its speed.

Every step works on all rows at once, as a careful user of NumPy would write it. Kinks inside the integral (slip below
sinkage / R) are not split: there it needs many nodes.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from terrapin_hil.physics.sphere import Soil

Array = npt.NDArray[np.float64]

THETA_MAX = 1.55


@cache
def gauss(count: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def forces(
    theta: Array, slip: Array, radius: Array, soil: Soil, linear: bool = False, across: int = 12, along: int = 12
) -> Array:
    """Vertical force, traction, torque: (3, rows). `across` discs over the half width, `along` nodes a zone."""
    theta, slip, radius = (np.broadcast_to(a, theta.shape)[:, None] for a in (theta, slip, radius))
    p = {name: np.broadcast_to(np.asarray(v, float), theta.shape[:1])[:, None] for name, v in vars(soil).items()}
    u, w = gauss(across)
    half = radius * np.sin(theta)
    x = half * np.sin(0.5 * np.pi * u)
    weight = np.pi * half * w * np.cos(0.5 * np.pi * u)
    r = np.sqrt(radius * radius - x * x)
    one = np.arctan2(half * np.cos(0.5 * np.pi * u), radius * np.cos(theta))
    rolled = radius * (1.0 - slip) / r
    peak = np.clip(p["c1"] + p["c2"] * (1.0 - rolled), 1e-9, 1.0 - 1e-9) * one
    two = -p["recovery"] * one
    shape = (_linear if linear else _full)(p, r, one, peak, two, rolled, along)
    area = weight * r
    return np.stack([(area * shape[0]).sum(1), (area * shape[1]).sum(1), (area * r * shape[2]).sum(1)])


def _shear(p: dict[str, Array], sigma: Array, travel: Array, extra: int) -> Array:
    k, c, tan = (
        v.reshape(v.shape + (1,) * extra) for v in (p["shear_modulus"], p["cohesion"], np.tan(p["friction_angle"]))
    )
    return np.asarray((c + sigma * tan) * -np.expm1(-np.abs(travel) / k) * np.sign(travel))


def _full(
    p: dict[str, Array], r: Array, one: Array, peak: Array, two: Array, rolled: Array, along: int
) -> tuple[Array, Array, Array]:
    q, w = gauss(along)
    step, w = q * q, 2.0 * q * w
    front, rear, entry = (one - peak)[..., None], (peak - two)[..., None], one[..., None]
    fall = 2.0 * np.sin(entry - 0.5 * front * step) * np.sin(0.5 * front * step)
    sigma = p["stiffness"][..., None] * (r[..., None] * np.maximum(fall, 0.0)) ** p["exponent"][..., None]
    sums = [np.zeros_like(r) for _ in range(3)]
    for theta, length in ((entry - front * step, front), (two[..., None] + rear * step, rear)):
        sine, cosine = np.sin(theta), np.cos(theta)
        travel = r[..., None] * ((entry - theta) - rolled[..., None] * (np.sin(entry) - sine))
        tau = _shear(p, sigma, travel, 1)
        sums[0] += ((sigma * cosine + tau * sine) * length * w).sum(-1)
        sums[1] += ((tau * cosine - sigma * sine) * length * w).sum(-1)
        sums[2] += (tau * length * w).sum(-1)
    return sums[0], sums[1], sums[2]


def _linear(
    p: dict[str, Array], r: Array, one: Array, peak: Array, two: Array, rolled: Array, _: int
) -> tuple[Array, Array, Array]:
    front, rear = one - peak, peak - two
    fall = 2.0 * np.sin(0.5 * (one + peak)) * np.sin(0.5 * front)
    sigma = p["stiffness"] * (r * np.maximum(fall, 0.0)) ** p["exponent"]
    tau = _shear(p, sigma, r * (front - rolled * (np.sin(one) - np.sin(peak))), 0)
    before, behind = np.sinc(front / (2 * np.pi)), np.sinc(rear / (2 * np.pi))
    ahead, back = 0.5 * (one + peak), 0.5 * (peak + two)
    cosines = np.sin(ahead) * before - np.sin(back) * behind
    sines = np.cos(back) * behind - np.cos(ahead) * before
    return sigma * cosines + tau * sines, tau * cosines - sigma * sines, 0.5 * (front + rear) * tau


def entry_angle(load: Array, slip: Array, radius: Array, soil: Soil, linear: bool = False) -> Array:
    """Entry angle of each row by a secant in the logarithms inside a bracket, to 1e-12 of the load."""
    low, high = np.full(load.shape, np.log(1e-7)), np.full(load.shape, np.log(THETA_MAX))
    x = np.full(load.shape, np.log(0.4))
    power = np.full(load.shape, 2.0 * float(np.mean(soil.exponent)) + 2.0)
    last_x, last_y = np.full(load.shape, np.nan), np.full(load.shape, np.nan)
    for _ in range(80):
        y = np.log(np.maximum(forces(np.exp(x), slip, radius, soil, linear)[0], 1e-300) / load)
        with np.errstate(invalid="ignore", divide="ignore"):
            secant = (y - last_y) / (x - last_x)
        power = np.where((np.abs(x - last_x) > 1e-9) & (secant > 0.3) & (secant < 60.0), secant, power)
        done = (np.abs(y) < 1e-12) | (high - low < 1e-15)
        if done.all():
            break
        low, high = np.where(y < 0, np.maximum(low, x), low), np.where(y > 0, np.minimum(high, x), high)
        new = x - y / power
        last_x, last_y = x, y
        x = np.where(done, x, np.where((new > low) & (new < high), new, 0.5 * (low + high)))
    return np.asarray(np.exp(x))
