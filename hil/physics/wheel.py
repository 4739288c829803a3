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

from hil.physics.contact import NODES, Array, Discs, integrate, solve_entry_angle
from hil.physics.sphere import Rows, _rows, bulldozing_factors

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


def forces(
    theta: Rows, slip: Rows, radius: Rows, width: Rows, soil: Soil, linear: bool = False, nodes: int = 2 * NODES
) -> tuple[Array, Array, Array]:
    """Vertical force [N], traction [N], torque [N m] at the entry angle theta [rad]."""
    theta, slip, radius, width = (a[:, None] for a in _rows(theta, slip, radius, width))
    rows = {name: np.broadcast_to(np.asarray(v, float), theta.shape[:1])[:, None] for name, v in vars(soil).items()}
    discs = Discs(
        radius=radius,
        weight=width,
        theta_1=theta,
        theta_m=0.5 * theta,
        theta_2=-rows["recovery"] * theta,
        rolled=1.0 - slip,
        stiffness=(rows["k_c"] + rows["k_phi"] * width) * (radius / width) ** rows["exponent"],
        exponent=rows["exponent"],
        cohesion=rows["cohesion"],
        tan_phi=np.tan(rows["friction_angle"]),
        shear_modulus=rows["shear_modulus"],
    )
    return integrate(discs, linear, nodes)


def entry_angle(
    load: Rows,
    slip: Rows,
    radius: Rows,
    width: Rows,
    soil: Soil,
    linear: bool = False,
    nodes: int = 2 * NODES,
    start: Array | None = None,
) -> Array:
    """Entry angle [rad] at which the ground carries the load [N]; 1.55 where no angle does."""
    load, slip, radius, width = _rows(load, slip, radius, width)
    exponent = float(np.mean(soil.exponent))

    def vertical(theta: Array) -> Array:
        return forces(theta, slip, radius, width, soil, linear, nodes)[0]

    return solve_entry_angle(vertical, load, 2.0 * exponent + 1.0, start)


def sinkage(theta: Rows, radius: Rows) -> Array:
    """Depth [m] of the lowest point at the entry angle theta [rad]."""
    theta, radius = _rows(theta, radius)
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
