"""A sphere that rolls on sand (Li et al., Actuators 2024, 13(8), 289, Eqs. 1 to 10).

The sphere is a stack of discs of radius r_x = sqrt(R^2 - x^2), all with the same forward speed, so the slip of a disc
is 1 - s_x = R (1 - s) / r_x. Every function works on rows: arrays of one shape (rows,), or scalars.

Accuracy of the default quadrature: 1e-8 of every force where slip > sinkage / R. Below that the rim's discs skid while
the middle slips, the shear stress has a kink inside the integral, and 12 nodes give 2e-5, 96 nodes 1e-8.

>>> soil = Soil(stiffness=1.945e6, exponent=0.97, cohesion=0.0, friction_angle=np.radians(42.2), shear_modulus=0.01778)
>>> theta = entry_angle(150.0, 0.5, 0.22, soil)
>>> traction, torque = forces(theta, 0.5, 0.22, soil)[1:]
>>> print(f"{theta[0]:.6f} {traction[0]:.4f} {torque[0]:.4f}")
0.376190 59.9775 18.0067
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil.physics.contact import NODES, Array, Discs, gauss, integrate, solve_entry_angle

__all__ = ["Soil", "bulldozing", "bulldozing_factors", "entry_angle", "forces", "sinkage"]

Rows = Array | float


@dataclass(frozen=True)
class Soil:
    """Properties of the ground; each a number or an array (rows,)."""

    stiffness: Rows  # k_s [Pa/m^n]
    exponent: Rows  # n
    cohesion: Rows  # Pa
    friction_angle: Rows  # rad
    shear_modulus: Rows  # m, the paper's j0
    c1: Rows = 0.18
    c2: Rows = 0.32
    recovery: Rows = 0.0  # exit angle = -recovery * entry angle


def _discs(theta: Array, slip: Array, radius: Array, soil: Soil, nodes: int) -> Discs:
    u, w = gauss(nodes)
    column = (theta.shape[0], 1)
    rows = {name: np.broadcast_to(np.asarray(value, float), theta.shape)[:, None] for name, value in vars(soil).items()}
    theta, slip, radius = theta.reshape(column), slip.reshape(column), radius.reshape(column)
    half = radius * np.sin(theta)  # x = half sin(angle): the root at the rim is gone
    x = half * np.sin(0.5 * np.pi * u)
    weight = 2.0 * half * (0.5 * np.pi) * w * np.cos(0.5 * np.pi * u)  # both halves of the sphere
    r = np.sqrt(radius * radius - x * x)
    theta_1 = np.arctan2(np.sqrt(np.maximum(half * half - x * x, 0.0)), radius * np.cos(theta))
    rolled = radius * (1.0 - slip) / r
    theta_2 = -rows["recovery"] * theta_1
    share = np.clip(rows["c1"] + rows["c2"] * (1.0 - rolled), 1e-9, 1.0 - 1e-9)
    return Discs(
        radius=r,
        weight=weight,
        theta_1=theta_1,
        theta_m=share * theta_1,
        theta_2=theta_2,
        rolled=rolled,
        stiffness=rows["stiffness"] * r ** rows["exponent"],
        exponent=rows["exponent"],
        cohesion=rows["cohesion"],
        tan_phi=np.tan(rows["friction_angle"]),
        shear_modulus=rows["shear_modulus"],
    )


def _rows(*values: Rows) -> tuple[Array, ...]:
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in values))
    return tuple(np.ascontiguousarray(a) for a in arrays)


def forces(
    theta: Rows, slip: Rows, radius: Rows, soil: Soil, linear: bool = False, nodes: int = NODES
) -> tuple[Array, Array, Array]:
    """Vertical force [N], traction [N], torque [N m] at the mid plane's entry angle theta [rad] (Eqs. 4 to 6)."""
    theta, slip, radius = _rows(theta, slip, radius)
    return integrate(_discs(theta, slip, radius, soil, nodes), linear, nodes)


def entry_angle(
    load: Rows,
    slip: Rows,
    radius: Rows,
    soil: Soil,
    linear: bool = False,
    nodes: int = NODES,
    start: Array | None = None,
) -> Array:
    """Entry angle [rad] at which the ground carries the load [N]; 1.55 where no angle does."""
    load, slip, radius = _rows(load, slip, radius)
    exponent = float(np.mean(soil.exponent))

    def vertical(theta: Array) -> Array:
        return forces(theta, slip, radius, soil, linear, nodes)[0]

    return solve_entry_angle(vertical, load, 2.0 * exponent + 2.0, start)


def sinkage(theta: Rows, radius: Rows) -> Array:
    """Depth [m] of the lowest point at the entry angle theta [rad]."""
    theta, radius = _rows(theta, radius)
    return np.asarray(2.0 * radius * np.sin(0.5 * theta) ** 2)


def bulldozing_factors(friction_angle: Rows, n_c: Rows, n_gamma: Rows) -> tuple[Array, Array]:
    """K_l and K_g of Eq. (8); the printed tan(delta) = 2/3 tan(phi)."""
    tangent = 2.0 / 3.0 * np.tan(np.asarray(friction_angle, dtype=np.float64))
    cosine_squared = 1.0 / (1.0 + tangent * tangent)
    return (n_c - tangent) * cosine_squared, (2.0 * np.asarray(n_gamma) / tangent + 1.0) * cosine_squared


def bulldozing(
    theta: Rows, radius: Rows, cohesion: Rows, friction_angle: Rows, unit_weight: Rows, n_c: Rows, n_gamma: Rows
) -> Array:
    """Bulldozing resistance R_c [N] (Eq. 8, in closed form); unit_weight in N/m^3."""
    k_l, k_g = bulldozing_factors(friction_angle, n_c, n_gamma)
    theta, radius = _rows(theta, radius)
    h, a = radius * np.sin(theta), radius * np.cos(theta)
    first = radius * radius * theta - a * h  # 2 * integral of z_x over the half width
    second = radius * radius * h - h**3 / 3.0 - a * radius * radius * theta  # integral of z_x^2 over the full width / 2
    return np.asarray(0.67 * cohesion * k_l * first + unit_weight * k_g * second)
