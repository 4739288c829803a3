"""A rigid wheel (or cylindrical shell) on soft ground: Reina et al. 2006, Eqs. 9 to 15, corrected.

One disc of constant radius: theta_2 = 0, theta_m = theta_1 / 2, sigma = (k_c + k_phi b) (z / b)^n.

>>> soil = Soil(24e3, 1528e3, exponent=1.1, cohesion=700.0, friction_angle=np.radians(30), shear_modulus=0.025)
>>> vertical, traction, torque = forces(np.radians(10), 0.3, 0.08, 0.15, soil)
>>> print(f"{vertical[0]:.6f} {traction[0]:.8f} {torque[0]:.9f}")
1.035583 0.07638168 0.013322173
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil.physics.contact import Array, Rows, equilibrium, evaluate, points, rows
from hil.physics.sphere import bulldozing_factors

__all__ = ["Soil", "bulldozing", "entry_angle", "forces", "sinkage"]


@dataclass(frozen=True)
class Soil:
    """Properties of the ground; each a number or an array (rows,)."""

    k_c: Rows  # Pa
    k_phi: Rows  # Pa/m
    exponent: Rows  # n
    cohesion: Rows  # Pa
    friction_angle: Rows  # rad
    shear_modulus: Rows  # m
    recovery: Rows = 0.0  # exit angle = -recovery * entry angle


def _fields(slip: Rows, radius: Rows, width: Rows, soil: Soil) -> dict[str, Rows]:
    stiffness = (soil.k_c + soil.k_phi * width) / np.asarray(width) ** np.asarray(soil.exponent)
    return {
        "slip": slip,
        "radius": radius,
        "width": width,
        "stiffness": stiffness,
        "exponent": soil.exponent,
        "cohesion": soil.cohesion,
        "friction_angle": soil.friction_angle,
        "shear_modulus": soil.shear_modulus,
        "c1": 0.5,
        "c2": 0.0,
        "recovery": soil.recovery,
    }


def forces(
    theta: Rows, slip: Rows, radius: Rows, width: Rows, soil: Soil, linear: bool = False
) -> tuple[Array, Array, Array]:
    """Vertical force [N], traction [N], torque [N m] at the entry angle theta [rad]."""
    theta, slip, radius, width = rows(theta, slip, radius, width)
    value, _ = evaluate("wheel", linear, points(_fields(slip, radius, width, soil), len(theta)), theta)
    return value[:, 0], value[:, 1], value[:, 2]


def entry_angle(
    load: Rows,
    slip: Rows,
    radius: Rows,
    width: Rows,
    soil: Soil,
    linear: bool = False,
    start: Array | None = None,
) -> Array:
    """Entry angle [rad] at which the ground carries the load [N]; 1.55 where no angle does (`solve` says why)."""
    load, slip, radius, width = rows(load, slip, radius, width)
    packed = points(_fields(slip, radius, width, soil), len(load))
    return equilibrium("wheel", linear, packed, np.maximum(load, 1e-12), start)[0]


def sinkage(theta: Rows, radius: Rows) -> Array:
    """Depth [m] of the lowest point at the entry angle theta [rad]."""
    theta, radius = rows(theta, radius)
    return np.asarray(2.0 * radius * np.sin(0.5 * theta) ** 2)


def bulldozing(
    theta: Rows,
    radius: Rows,
    width: Rows,
    cohesion: Rows,
    friction_angle: Rows,
    unit_weight: Rows,
    n_c: Rows,
    n_gamma: Rows,
) -> Array:
    """Bulldozing resistance R_c = width (0.67 c z K_l + 0.5 z^2 unit_weight K_g) [N]."""
    k_l, k_g = bulldozing_factors(friction_angle, n_c, n_gamma)
    depth = sinkage(theta, radius)
    return np.asarray(width * (0.67 * cohesion * depth * k_l + 0.5 * depth * depth * unit_weight * k_g))
