"""Soils: pressure against sinkage and shear strength, with units that follow the sinkage exponent, and published ones.

Two forms of the pressure p [Pa] under a plate of width b [m] sunk by z [m] are in use, and their numbers differ:

    bekker   p = (k_c / b + k_phi) z^n         k_c [Pa m / m^n]   k_phi [Pa / m^n]
    reece    p = (k_c + k_phi b) (z / b)^n     k_c [Pa]           k_phi [Pa / m]

At one width the one is the other times b^(n-1), so a conversion needs the width; moving numbers over without it is the
error that Reina et al. made. Shear strength is Mohr-Coulomb, c + p tan(phi), reached over the shear modulus K (Janosi).

>>> lete = library()["lete_sand"]
>>> f"{lete.stiffness(0.235):.0f} {lete.unit('k_phi')}"
'535300 Pa/m^0.71'
>>> reece = lete.converted("reece", 0.235)
>>> f"{reece.k_phi:.0f} {reece.unit('k_phi')}, {reece.pressure(0.05, 0.235):.0f} Pa as before"
'814681 Pa/m, 63807 Pa as before'
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, NamedTuple

from terrapin_hil.units import read_unit, same_kind, units

__all__ = ["Footing", "Form", "Soil", "library", "number"]

Form = Literal["bekker", "reece"]


class Footing(NamedTuple):
    """A soil as a contact of one width feels it: p = stiffness z^n. Numbers, or arrays of equal shape."""

    stiffness: float  # k_s [Pa/m^n]
    exponent: float  # n
    cohesion: float  # [Pa]
    friction_angle: float  # [rad]
    shear_modulus: float  # K [m]


@dataclass(frozen=True)
class Soil:
    """A soil in SI units, angles in rad; None where its source says nothing. ValueError for a value out of range."""

    name: str
    source: str
    form: Form
    exponent: float
    k_c: float
    k_phi: float
    cohesion: float
    friction_angle: float
    shear_modulus: float | None = None
    unit_weight: float | None = None  # [N/m^3]
    c1: float | None = None  # theta_m = (c1 + c2 slip) theta_1
    c2: float | None = None
    n_c: float | None = None  # bearing capacity factors, for bulldozing
    n_gamma: float | None = None
    width: float | None = None  # the only width [m] for which the stiffness was stated, if k_c was not

    def __post_init__(self) -> None:
        if self.form not in ("bekker", "reece"):
            raise ValueError(f"form: found {self.form!r}, expected bekker or reece")
        _within("exponent", self.exponent, 0.0, 3.0, "", open_low=True)
        _within("k_c", self.k_c, -math.inf, math.inf, self.unit("k_c"))
        _within("k_phi", self.k_phi, 0.0, math.inf, self.unit("k_phi"), open_low=self.k_c <= 0.0)
        _within("cohesion", self.cohesion, 0.0, math.inf, "Pa")
        _within("friction_angle", self.friction_angle, 0.0, 0.5 * math.pi, "rad", open_high=True)
        for name in ("shear_modulus", "unit_weight", "width"):
            value = getattr(self, name)
            if value is not None:
                _within(name, value, 0.0, math.inf, self.unit(name), open_low=True)

    def unit(self, name: str) -> str:
        """SI unit of a field, as pint reads it.

        >>> library()["dry_sand_lll"].unit("k_c")
        'Pa/m^0.1'
        """
        if name in ("k_c", "k_phi"):
            power = self.exponent if self.form == "bekker" else 1.0
            power -= name == "k_c"
            if abs(power) < 1e-12:
                return "Pa"
            return f"Pa/m^{power:.12g}" if power != 1.0 else "Pa/m"
        return {
            "cohesion": "Pa",
            "friction_angle": "rad",
            "shear_modulus": "m",
            "unit_weight": "N/m^3",
            "width": "m",
        }.get(name, "1")

    def stiffness(self, width: float) -> float:
        """k_s [Pa/m^n] of p = k_s z^n under a contact of `width` [m]. ValueError where it is not positive."""
        _within("width", width, 0.0, math.inf, "m", open_low=True)
        if self.form == "bekker":
            found = self.k_c / width + self.k_phi
        else:
            found = (self.k_c + self.k_phi * width) * width**-self.exponent
        _within("stiffness", found, 0.0, math.inf, f"Pa/m^{self.exponent:.12g}", open_low=True)
        return found

    def pressure(self, sinkage: float, width: float) -> float:
        """p [Pa] at the sinkage [m] under a contact of `width` [m]."""
        _within("sinkage", sinkage, 0.0, math.inf, "m")
        return float(self.stiffness(width) * sinkage**self.exponent)

    def converted(self, form: Form, width: float) -> Soil:
        """The same soil in the other form: equal pressure at every sinkage under a contact of `width` [m]."""
        _within("width", width, 0.0, math.inf, "m", open_low=True)
        if form == self.form:
            return self
        factor = width ** (self.exponent - 1.0)
        if form == "bekker":
            factor = 1.0 / factor
        return replace(self, form=form, k_c=self.k_c * factor, k_phi=self.k_phi * factor, width=width)

    def footing(self, width: float) -> Footing:
        """The five numbers that a contact of `width` [m] needs. ValueError where the source lacks the shear modulus."""
        if self.shear_modulus is None:
            raise ValueError(f"shear_modulus: {self.source} states none for {self.name}, expected a length in m")
        return Footing(self.stiffness(width), self.exponent, self.cohesion, self.friction_angle, self.shear_modulus)


def number(text: str, unit: str) -> float:
    """The quantity `text` in `unit`. ValueError where it is of another kind: 0.71 written for 0.7 is refused.

    >>> number("505.8 kN/m^2.7", "Pa/m^0.7")
    505800.0
    """
    head, _, tail = text.strip().partition(" ")
    try:
        given: Any = units().Quantity(float(head), read_unit(tail))
        fits = same_kind(tail, unit)
    except ValueError:
        fits = False
    if not fits:
        raise ValueError(f"found {text!r}, expected a quantity that converts to {unit}")
    goal: Any = units().Quantity(1.0, read_unit(unit)).to_base_units()
    return float(given.to_base_units().magnitude / goal.magnitude)


def _within(
    name: str, value: float, low: float, high: float, unit: str, open_low: bool = False, open_high: bool = False
) -> None:
    fits = (low < value if open_low else low <= value) and (value < high if open_high else value <= high)
    if fits and math.isfinite(value):
        return
    start = "more than" if open_low else "at least"
    end = "less than" if open_high else "at most"
    limits = [f"{start} {low:g}"] if low > -math.inf else []
    limits += [f"{end} {high:.6g}"] if high < math.inf else []
    tail = f" {unit}" if unit not in ("", "1") else ""
    raise ValueError(f"{name}: found {value:g}{tail}, expected {' and '.join(limits) or 'a finite number'}{tail}")


VELLA = "Vella et al. (2024), doi:10.1007/978-3-031-64569-3_25, Table 1"
# The three rows of Wong's table are as other papers reprint them; the book itself was not at hand.
WONG = "J. Y. Wong, Theory of Ground Vehicles, 3rd ed. (2001), Table 2.3"


@cache
def library() -> dict[str, Soil]:
    """Published soils by name."""
    angle = math.radians
    wong = f"{WONG}, {{}}".format
    soils = [
        # K_s is printed in kN/m; sigma = K_s z^n makes it kN/m^(n+2). 535.3 is Wong's 6.94 / b + 505.8 at b = 0.235 m,
        # so it holds for that width.
        Soil("lete_sand", f"{VELLA}, nominal", "bekker", 0.71, 0.0, 535.3e3, 1150.0, angle(31.5), 0.036, width=0.235),
        Soil("sand_vella", f"{VELLA}, fitted", "bekker", 0.71, 0.0, 357.6e3, 1150.0, angle(31.5), 0.036, width=0.235),
        Soil(
            "dry_sand_li",
            # The print says 42.2 rad and calls the unit weight a density.
            "Li et al. (2024), doi:10.3390/act13080289, Table 1",
            "bekker",
            exponent=0.97,
            k_c=0.0,
            k_phi=1945e3,
            cohesion=0.0,
            friction_angle=angle(42.2),
            shear_modulus=0.01778,
            unit_weight=19600.0,
            c1=0.18,
            c2=0.32,
            n_c=20.0,
            n_gamma=6.0,
        ),
        # Which form its numbers belong to is doubtful: 1528 is that of the next soil, in the other form.
        Soil("sand_reina", "Reina et al. (2006), Eq. 9 and Table 2", "reece", 1.1, 24e3, 1528e3, 700.0, angle(30.0)),
        Soil("dry_sand_lll", wong("dry sand, LLL"), "bekker", 1.1, 990.0, 1528.43e3, 1040.0, angle(28.0)),
        Soil(
            "sandy_loam_lll", wong("sandy loam, 15 % water, LLL"), "bekker", 0.7, 5270.0, 1515.04e3, 1720.0, angle(29.0)
        ),
        Soil("clay_thailand", wong("clayey soil, 38 % water"), "bekker", 0.5, 13190.0, 692.15e3, 4140.0, angle(13.0)),
    ]
    return {soil.name: soil for soil in soils}
