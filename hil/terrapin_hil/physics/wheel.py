"""A rigid wheel (or cylindrical shell) on soft ground: Reina et al. 2006, Eqs. 9 to 15, corrected.

One disc of constant radius: theta_2 = 0, theta_m = theta_1 / 2, sigma = (k_c + k_phi b) (z / b)^n.

>>> soil = Soil(24e3, 1528e3, exponent=1.1, cohesion=700.0, friction_angle=np.radians(30), shear_modulus=0.025)
>>> vertical, traction, torque = forces(np.radians(10), 0.3, 0.08, 0.15, soil)
>>> print(f"{vertical[0]:.6f} {traction[0]:.8f} {torque[0]:.9f}")
1.035583 0.07638168 0.013322173
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.physics import soils
from terrapin_hil.physics.contact import COLUMNS as ALL
from terrapin_hil.physics.contact import Array, Contact, Rows, contact, equilibrium, evaluate, points, rows
from terrapin_hil.physics.sphere import bulldozing_factors, sinkage

__all__ = ["COLUMNS", "Soil", "at", "bulldozing", "entry_angle", "forces", "sinkage", "slopes", "soil_of", "solve"]

# of the derivatives; "entry" is the load where a load was given
COLUMNS = (
    "entry",
    "slip",
    "radius",
    "width",
    "k_c",
    "k_phi",
    "exponent",
    "cohesion",
    "friction_angle",
    "shear_modulus",
    "recovery",
)


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


def soil_of(soil: soils.Soil, width: float) -> Soil:
    """A soil of the library as a wheel of `width` [m] feels it, from either form. ValueError without shear modulus.

    >>> soil_of(replace(soils.library()["dry_sand_lll"], shear_modulus=0.025), 0.15).k_phi.__round__()
    1264313
    """
    footing = soil.footing(width)
    reece = soil.converted("reece", width)
    return Soil(reece.k_c, reece.k_phi, soil.exponent, soil.cohesion, soil.friction_angle, footing.shear_modulus)


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


def slopes(theta: Rows, slip: Rows, radius: Rows, width: Rows, soil: Soil, linear: bool = False) -> tuple[Array, Array]:
    """As `forces`, (3, rows), with derivatives (3, rows, 11) at fixed theta by COLUMNS. Nothing is checked."""
    theta, slip, radius, width = rows(theta, slip, radius, width)
    packed = points(_fields(slip, radius, width, soil), len(theta))
    value, by = evaluate("wheel", linear, packed, theta, derivatives=True)
    assert by is not None
    return value.T, np.stack([_by_soil(by[:, output], width, soil) for output in range(3)])


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


def at(
    theta: Rows, slip: Rows, radius: Rows, width: Rows, soil: Soil, linear: bool = False, derivatives: bool = False
) -> Contact:
    """Contacts at the entry angles [rad]; derivatives by COLUMNS. ContactError for a value out of range."""
    fields = _fields(slip, radius, width, soil)
    return _named(contact("wheel", linear, fields, derivatives, entry=theta), width, soil)


def solve(
    load: Rows,
    slip: Rows,
    radius: Rows,
    width: Rows,
    soil: Soil,
    linear: bool = False,
    derivatives: bool = False,
    start: Rows | None = None,
) -> Contact:
    """Contacts of wheels that carry the loads within 1e-9 of them; derivatives by COLUMNS.

    Parameters
    ----------
    load : N; `slip` : 1; `radius`, `width` : m. Numbers, or arrays (rows,).
    linear : straight stress distributions instead of the full ones.
    start : entry angles [rad] to start from.

    Raises
    ------
    ContactError : no contact carries a load, or a value is out of range; it names the row.
    """
    fields = _fields(slip, radius, width, soil)
    return _named(contact("wheel", linear, fields, derivatives, load=load, start=start), width, soil)


def _named(found: Contact, width: Rows, soil: Soil) -> Contact:
    if found.derivative is None:
        return found
    return replace(found, derivative={o: _by_soil(old, width, soil) for o, old in found.derivative.items()})


def _by_soil(old: Array, width: Rows, soil: Soil) -> Array:
    """From columns by the stiffness [Pa/m^n] to those by k_c and k_phi, of which it is (k_c + k_phi b) b^-n."""
    b, n, k_phi, k_c = (np.asarray(v, dtype=np.float64) for v in (width, soil.exponent, soil.k_phi, soil.k_c))
    stiffness = (k_c + k_phi * b) * b**-n
    given = {name: old[:, i] for i, name in enumerate(ALL)}
    rigid = given["stiffness"]
    given["k_c"], given["k_phi"] = rigid * b**-n, rigid * b ** (1.0 - n)
    given["width"] = given["width"] + rigid * (k_phi * b**-n - n * stiffness / b)
    given["exponent"] = given["exponent"] - rigid * stiffness * np.log(b)
    return np.stack([given[name] for name in COLUMNS], axis=1)


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
