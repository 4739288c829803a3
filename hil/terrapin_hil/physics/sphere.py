"""A sphere that rolls on sand (Li et al., Actuators 2024, 13(8), 289, Eqs. 1 to 10).

The sphere is a stack of discs of radius r_x = sqrt(R^2 - x^2), all with the same forward speed, so the slip of a disc
is 1 - s_x = R (1 - s) / r_x. Every function works on rows: arrays of one shape (rows,), or scalars.

Compiled (contact.h); with derivatives by load, slip, radius and every property of the soil where asked for.

>>> soil = Soil(stiffness=1.945e6, exponent=0.97, cohesion=0.0, friction_angle=np.radians(42.2), shear_modulus=0.01778)
>>> theta = entry_angle(150.0, 0.5, 0.22, soil)
>>> traction, torque = forces(theta, 0.5, 0.22, soil)[1:]
>>> print(f"{theta[0]:.6f} {traction[0]:.4f} {torque[0]:.4f}")
0.376190 59.9775 18.0067
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terrapin_hil.physics.contact import Array, Contact, Rows, contact, equilibrium, evaluate, points, rows

__all__ = [
    "Soil",
    "at",
    "bulldozing",
    "bulldozing_factors",
    "entry_angle",
    "forces",
    "sinkage",
    "slopes",
    "solve",
]


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


def _fields(slip: Rows, radius: Rows, soil: Soil) -> dict[str, Rows]:
    return {"slip": slip, "radius": radius, "width": 0.0, **vars(soil)}


def forces(theta: Rows, slip: Rows, radius: Rows, soil: Soil, linear: bool = False) -> tuple[Array, Array, Array]:
    """Vertical force [N], traction [N], torque [N m] at the mid plane's entry angle theta [rad] (Eqs. 4 to 6)."""
    theta, slip, radius = rows(theta, slip, radius)
    value, _ = evaluate("sphere", linear, points(_fields(slip, radius, soil), len(theta)), theta)
    return value[:, 0], value[:, 1], value[:, 2]


def slopes(theta: Rows, slip: Rows, radius: Rows, soil: Soil, linear: bool = False) -> tuple[Array, Array]:
    """As `forces`, (3, rows), with derivatives (3, rows, 12) at fixed theta by contact.COLUMNS. Nothing is checked."""
    theta, slip, radius = rows(theta, slip, radius)
    value, by = evaluate("sphere", linear, points(_fields(slip, radius, soil), len(theta)), theta, derivatives=True)
    assert by is not None
    return value.T, np.moveaxis(by, 1, 0)


def entry_angle(
    load: Rows, slip: Rows, radius: Rows, soil: Soil, linear: bool = False, start: Array | None = None
) -> Array:
    """Entry angle [rad] at which the ground carries the load [N], row by row; 1.55 where no angle does.

    For fits, which pass through hopeless parameters: `solve` instead says what is wrong. `start` is a near guess.
    """
    load, slip, radius = rows(load, slip, radius)
    packed = points(_fields(slip, radius, soil), len(load))
    return equilibrium("sphere", linear, packed, np.maximum(load, 1e-12), start)[0]


def at(theta: Rows, slip: Rows, radius: Rows, soil: Soil, linear: bool = False, derivatives: bool = False) -> Contact:
    """Contacts at the entry angles [rad]. ContactError for a value out of range."""
    return contact("sphere", linear, _fields(slip, radius, soil), derivatives, entry=theta)


def solve(
    load: Rows,
    slip: Rows,
    radius: Rows,
    soil: Soil,
    linear: bool = False,
    derivatives: bool = False,
    start: Rows | None = None,
) -> Contact:
    """Contacts of spheres that carry the loads within 1e-9 of them.

    Parameters
    ----------
    load : N; `slip` : 1; `radius` : m. Numbers, or arrays (rows,).
    linear : straight stress distributions instead of the full ones.
    derivatives : by contact.COLUMNS, too.
    start : entry angles [rad] to start from.

    Raises
    ------
    ContactError : no contact carries a load, or a value is out of range; it names the row.
    """
    return contact("sphere", linear, _fields(slip, radius, soil), derivatives, load=load, start=start)


def sinkage(theta: Rows, radius: Rows) -> Array:
    """Depth [m] of the lowest point at the entry angle theta [rad]."""
    theta, radius = rows(theta, radius)
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
    theta, radius = rows(theta, radius)
    h, a = radius * np.sin(theta), radius * np.cos(theta)
    first = radius * radius * theta - a * h  # 2 * integral of z_x over the half width
    second = radius * radius * h - h**3 / 3.0 - a * radius * radius * theta  # integral of z_x^2 over the full width / 2
    return np.asarray(0.67 * cohesion * k_l * first + unit_weight * k_g * second)
