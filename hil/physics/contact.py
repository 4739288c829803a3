"""Stress under a stack of thin discs that sink into soil: what a sphere and a wheel have in common.

Every disc of radius r enters the soil at theta_1, leaves it at theta_2 = -recovery theta_1 (0: the rut stays as it
is) and carries its largest normal stress at theta_m. Front zone, theta_m to theta_1:

    sigma = stiffness (cos theta - cos theta_1)^n
    tau   = (c + sigma tan phi) (1 - exp(-|j|/k)) sgn(j)
    j     = r [(theta_1 - theta) - (1 - slip)(sin theta_1 - sin theta)]

Behind theta_m the normal stress is that in front, mapped linearly from [theta_2, theta_m]; the shear law is the same.
With linear stresses sigma and tau fall in straight lines from their values at theta_m to 0 at both ends, and the
integrals over theta are closed forms.

Sources: Li et al. 2024, Eqs. (3) to (7); Reina et al. 2006, Eqs. (9) to (15) with the shear displacement put right
(printed without "(theta_1 - theta) -", by which torque would fall with slip).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

__all__ = ["NODES", "Array", "Discs", "gauss", "integrate", "solve_entry_angle"]

Array = npt.NDArray[np.float64]

NODES = 12  # Gauss-Legendre nodes along theta a zone, and across the sphere's half width: 1e-8 of every force
THETA_MAX = 1.55  # rad; beyond it the axle would be below the ground


@cache
def gauss(count: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss-Legendre quadrature on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


@dataclass(frozen=True)
class Discs:
    """Discs under load; every field is an array that broadcasts to (rows, discs). SI units, angles in rad."""

    radius: Array
    weight: Array  # width [m] that the disc stands for
    theta_1: Array  # entry angle
    theta_m: Array  # angle of the largest normal stress
    theta_2: Array  # exit angle, 0 or negative
    rolled: Array  # 1 - slip of this disc
    stiffness: Array  # Pa; normal stress where cos theta - cos theta_1 = 1
    exponent: Array
    cohesion: Array  # Pa
    tan_phi: Array
    shear_modulus: Array  # m


def integrate(discs: Discs, linear: bool, nodes: int = NODES) -> tuple[Array, Array, Array]:
    """Vertical force [N], traction [N] and torque [N m] of each row (the sum over its discs)."""
    along, across, moment = (_linear if linear else _full)(discs, nodes)
    area = discs.weight * discs.radius
    return (area * across).sum(-1), (area * along).sum(-1), (area * discs.radius * moment).sum(-1)


def _shear(discs: Discs, sigma: Array, travel: Array, modulus: Array, cohesion: Array, tan_phi: Array) -> Array:
    return (cohesion + sigma * tan_phi) * -np.expm1(-np.abs(travel) / modulus) * np.sign(travel)


def _full(d: Discs, nodes: int) -> tuple[Array, Array, Array]:
    # theta = theta_1 - front q^2 and theta_2 + rear q^2: the square takes sigma's root-like end out of the integrand
    q, w = gauss(nodes)
    step, w = q * q, 2.0 * q * w
    front, rear = (d.theta_1 - d.theta_m)[..., None], (d.theta_m - d.theta_2)[..., None]
    one = d.theta_1[..., None]
    theta_f = one - front * step
    theta_r = d.theta_2[..., None] + rear * step
    # cos a - cos b as a product of sines keeps its digits where both angles are small
    fall = 2.0 * np.sin(0.5 * (one + theta_f)) * np.sin(0.5 * front * step)
    sigma = d.stiffness[..., None] * np.maximum(fall, 0.0) ** d.exponent[..., None]
    radius, rolled = d.radius[..., None], d.rolled[..., None]
    modulus, cohesion, tan_phi = d.shear_modulus[..., None], d.cohesion[..., None], d.tan_phi[..., None]
    along = across = moment = np.zeros(1)
    sine_1 = np.sin(one)
    for theta, length in ((theta_f, front), (theta_r, rear)):
        sine, cosine = np.sin(theta), np.cos(theta)
        travel = radius * ((one - theta) - rolled * (sine_1 - sine))
        tau = _shear(d, sigma, travel, modulus, cohesion, tan_phi)
        weight = length * w
        along = along + ((tau * cosine - sigma * sine) * weight).sum(-1)
        across = across + ((sigma * cosine + tau * sine) * weight).sum(-1)
        moment = moment + (tau * weight).sum(-1)
    return along, across, moment


def _linear(d: Discs, nodes: int) -> tuple[Array, Array, Array]:
    front, rear = d.theta_1 - d.theta_m, d.theta_m - d.theta_2
    fall = 2.0 * np.sin(0.5 * (d.theta_1 + d.theta_m)) * np.sin(0.5 * front)
    sigma = d.stiffness * np.maximum(fall, 0.0) ** d.exponent
    travel = d.radius * (front - d.rolled * (np.sin(d.theta_1) - np.sin(d.theta_m)))
    tau = _shear(d, sigma, travel, d.shear_modulus, d.cohesion, d.tan_phi)
    before, behind = np.sinc(front / (2 * np.pi)), np.sinc(rear / (2 * np.pi))  # sin(x/2)/(x/2)
    ahead, back = 0.5 * (d.theta_1 + d.theta_m), 0.5 * (d.theta_m + d.theta_2)
    cosines = np.sin(ahead) * before - np.sin(back) * behind  # integral of f cos theta
    sines = np.cos(back) * behind - np.cos(ahead) * before  # integral of f sin theta
    return tau * cosines - sigma * sines, sigma * cosines + tau * sines, 0.5 * (front + rear) * tau


def solve_entry_angle(
    vertical: Callable[[Array], Array], load: Array, slope: float, start: Array | None = None
) -> Array:
    """Entry angle [rad] at which `vertical(theta)` carries `load`, row by row.

    A secant in the logarithms (the force is nearly a power `slope` of the angle), kept inside a bracket. A row whose
    load no angle up to 1.55 rad carries gets that limit: the caller sees it by `theta >= THETA_MAX`. Convergence to
    1e-12 of the load takes 5 to 7 calls of `vertical`, 2 to 4 from a near start.
    """
    low = np.full(load.shape, np.log(1e-7))
    high = np.full(load.shape, np.log(THETA_MAX))
    x = np.full(load.shape, np.log(0.4)) if start is None else np.log(np.clip(start, 1e-7, THETA_MAX))
    power = np.full(load.shape, slope)
    target = np.log(np.maximum(load, 1e-12))
    last_x = last_y = None
    for _ in range(80):
        y = np.log(np.maximum(vertical(np.exp(x)), 1e-300)) - target
        if last_x is not None and last_y is not None:
            moved = x - last_x
            with np.errstate(divide="ignore", invalid="ignore"):
                secant = (y - last_y) / moved
            power = np.where((np.abs(moved) > 1e-9) & (secant > 0.3) & (secant < 60.0), secant, power)
        done = (np.abs(y) < 1e-12) | (high - low < 1e-15)
        if done.all():
            break
        low = np.where(y < 0, np.maximum(low, x), low)
        high = np.where(y > 0, np.minimum(high, x), high)
        new = x - y / power
        new = np.where((new > low) & (new < high), new, 0.5 * (low + high))
        last_x, last_y = x, y
        x = np.where(done, x, new)
    return np.exp(x)
