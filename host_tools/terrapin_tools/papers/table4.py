"""Table 4 of Li et al. 2024: every reading of the theory, what no reading can change, and the radius as a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from scipy.optimize import brentq, linprog, minimize_scalar

from terrapin_hil.arrays import Array
from terrapin_hil.physics import sphere
from terrapin_hil.physics.soils import library
from terrapin_tools.papers.printed import numbers, printed

__all__ = [
    "GRAVITY",
    "Measured",
    "Reading",
    "Theory",
    "best_radius",
    "ceiling",
    "measured",
    "needed_friction",
    "readings",
    "self_propelled",
    "soil",
    "theory",
]

GRAVITY = 9.8  # m/s^2, with which the paper's kilograms become newtons (found from its own DP and T)


@dataclass(frozen=True)
class Measured:
    """Table 4 and its setting. Slip as the paper names it, and as its discs make it."""

    radius: float
    load: float
    nominal: Array
    actual: Array  # 1 - r/R
    disc: Array  # r [m]
    f1: Array  # kg
    f2: Array
    drawbar: Array  # N
    torque: Array  # N m


@dataclass(frozen=True)
class Theory:
    """Theory 1 (Eqs. 4 to 6) and Theory 2 (with R_c and R_f, Eqs. 8 to 10); arrays over slip."""

    entry: Array
    drawbar: Array
    torque: Array
    bulldozing: Array  # R_c [N]
    extra: Array  # R_f [N]
    drawbar_2: Array
    torque_2: Array


@dataclass(frozen=True)
class Reading:
    """One way to read the paper, and its mean absolute percentage errors of Theory 1 and 2."""

    stress: str
    slip: str
    extra: str
    drawbar: tuple[float, float]
    torque: tuple[float, float]


@cache
def measured() -> Measured:
    paper = printed()["li"]
    table = paper["table_4"]
    radius = float(paper["table_1"]["radius_mm"]) * 1e-3
    disc = np.array(numbers(table["disc_radius_m"]))
    return Measured(
        radius=radius,
        load=float(paper["table_1"]["load_n"]),
        nominal=np.array(numbers(table["slip"])),
        actual=1.0 - disc / radius,
        disc=disc,
        f1=np.array(numbers(table["f1_kg"])),
        f2=np.array(numbers(table["f2_kg"])),
        drawbar=np.array(numbers(table["drawbar_n"])),
        torque=np.array(numbers(table["torque_nm"])),
    )


@cache
def soil() -> sphere.Soil:
    """Table 1, with its friction angle in degrees."""
    ground = library()["dry_sand_li"]
    assert ground.shear_modulus is not None
    return sphere.Soil(
        stiffness=ground.k_phi,
        exponent=ground.exponent,
        cohesion=ground.cohesion,
        friction_angle=ground.friction_angle,
        shear_modulus=ground.shear_modulus,
        c1=ground.c1 or 0.0,
        c2=ground.c2 or 0.0,
    )


def theory(slip: Array, radius: float, load: float, linear: bool = False, clip: bool = False) -> Theory:
    """Both theories at slips; `clip`: no R_f below xi_2 (as printed it is symmetric there)."""
    ground, entry_soil = library()["dry_sand_li"], soil()
    contact = sphere.solve(load, slip, radius, entry_soil, linear)
    bulldozing = sphere.bulldozing(
        contact.entry,
        radius,
        entry_soil.cohesion,
        entry_soil.friction_angle,
        ground.unit_weight or 0.0,
        ground.n_c or 0.0,
        ground.n_gamma or 0.0,
    )
    xi_1, xi_2, xi_3 = numbers(printed()["li"]["table_1"]["extra_resistance"])
    above = slip - xi_2
    extra = xi_1 * load * (np.maximum(above, 0.0) if clip else np.abs(above)) ** xi_3
    lost = bulldozing + extra
    return Theory(
        entry=contact.entry,
        drawbar=contact.traction,
        torque=contact.torque,
        bulldozing=bulldozing,
        extra=extra,
        drawbar_2=contact.traction - lost,
        torque_2=contact.torque - radius * lost,
    )


def _error(model: Array, data: Array) -> float:
    return float(100.0 * np.mean(np.abs(model / data - 1.0)))


@cache
def readings() -> tuple[Reading, ...]:
    """Both stress forms, both slips, both R_f, at the printed radius and soil."""
    table = measured()
    found = []
    for linear, (slip_name, slip), clip in product(
        (False, True), (("nominal", table.nominal), ("1 - r/R", table.actual)), (False, True)
    ):
        t = theory(slip, table.radius, table.load, linear, clip)
        found.append(
            Reading(
                "linear (Eq. 7)" if linear else "full (Eq. 3)",
                slip_name,
                "clipped below 0.45" if clip else "as printed",
                (_error(t.drawbar, table.drawbar), _error(t.drawbar_2, table.drawbar)),
                (_error(t.torque, table.torque), _error(t.torque_2, table.torque)),
            )
        )
    return tuple(found)


def needed_friction() -> Array:
    """Least friction angle [rad] of each row: the resultant of W, DP and T/R concentrated in one point of contact."""
    table = measured()
    shear = table.torque / table.radius
    normal = np.sqrt(table.load**2 + table.drawbar**2 - shear**2)
    return np.asarray(np.arctan2(shear, normal))


def ceiling(most_entry: float, points: int = 120) -> Array:
    """Greatest T/R [N] of each row for any stresses with tau <= sigma tan(phi) on 0 to `most_entry` [rad].

    A linear programme: elements of normal and shear force, W and the measured DP given.
    """
    table = measured()
    angle = np.linspace(0.0, most_entry, points)
    cosine, sine = np.cos(angle), np.sin(angle)
    slope = np.tan(float(np.asarray(soil().friction_angle)))
    balance = np.block([[cosine, sine], [-sine, cosine]])  # of (normal, shear): vertical, along
    coulomb = np.hstack([-slope * np.eye(points), np.eye(points)])
    found = []
    for drawbar in table.drawbar:
        answer = linprog(
            np.concatenate([np.zeros(points), -np.ones(points)]),
            A_ub=coulomb,
            b_ub=np.zeros(points),
            A_eq=balance,
            b_eq=[table.load, drawbar],
            bounds=(0.0, None),
            method="highs",
        )
        found.append(-float(answer.fun) if answer.success else float("nan"))
    return np.array(found)


def best_radius(slip: Array) -> tuple[float, float, Theory]:
    """Radius [m] that fits best with everything else as printed (full stress, R_f as printed), its rms [%], theory."""
    table = measured()

    def rms(radius: float) -> float:
        t = theory(slip, radius, table.load)
        off = np.concatenate([t.drawbar_2 / table.drawbar - 1.0, t.torque_2 / table.torque - 1.0])
        return float(100.0 * np.sqrt(np.mean(off**2)))

    found = minimize_scalar(rms, bounds=(0.2, 0.45), method="bounded", options={"xatol": 1e-7})
    radius = float(found.x)
    return radius, rms(radius), theory(slip, radius, table.load)


@cache
def self_propelled(load: float, linear: bool = False) -> tuple[float, float]:
    """Slip and torque [N m] of a sphere of Table 1 that pulls nothing (DP = 0) at the load [N]."""
    radius = measured().radius

    def pull(slip: float) -> float:
        return float(sphere.solve(load, slip, radius, soil(), linear).traction[0])

    slip = float(brentq(pull, 0.0, 0.5, xtol=1e-12))
    return slip, float(sphere.solve(load, slip, radius, soil(), linear).torque[0])
