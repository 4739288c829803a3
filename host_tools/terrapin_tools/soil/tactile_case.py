"""A case with base "driven_wheel": operating points of a driven wheel on soft ground, for `terrapin soil tactile`.

    [model]
    base = "driven_wheel"
    [parameters]            # of the wheel and of the ground's sinkage (Reece form); stress = "full" or "linear"
    radius = "80 mm"
    width = "150 mm"
    k_c = "24 kN/m^2"
    k_phi = "1528 kN/m^3"
    n = 1.1
    shear_modulus = "25 mm"           # or [fit.shear_modulus] value = ...; or true
    stiffness_sd = "0 %"              # how well k_c and k_phi are known, one factor for both
    [noise]                           # left out: only the proportions below are assumed
    load = "0.2 %"                    # of the reading
    drawbar_pull = "0.5 %"            # of the load
    torque = "1 %"                    # of the reading
    slip = 0.01                       # absolute
    [data]
    files = ["points.csv"]
    [data.columns]
    load = { column = "W", unit = "N" }
    drawbar_pull = { column = "DP", unit = "N" }
    torque = { column = "T", unit = "N m" }
    slip = { column = "i", unit = "1" }

Slip above 0.9 is refused: the shear displacement is then many shear moduli, torque has no more to say about the soil,
and the stress distribution that the equilibrium takes for granted belongs to low and moderate slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.errors import UserError
from terrapin_tools.soil.tactile import Noise, Points, Rig
from terrapin_tools.workbench.bases.driven_wheel import BASE
from terrapin_tools.workbench.case.columns import mapped_column
from terrapin_tools.workbench.files.tables import read
from terrapin_tools.workbench.files.toml_tables import Tables, case_tables, read_case_text

__all__ = ["MOST_SLIP", "TactileCase", "load_tactile_case"]


MOST_SLIP = 0.9
COLUMNS = {"load": "N", "drawbar_pull": "N", "torque": "N m", "slip": "1"}
RIG = {"radius": "m", "width": "m", "k_c": "Pa", "k_phi": "Pa/m", "n": "1"}
START_MODULUS = 0.02  # m


@dataclass(frozen=True)
class TactileCase:
    title: str
    rig: Rig
    points: Points
    places: tuple[str, ...]  # of each point
    modulus: float  # [m]; a start value where it is fitted
    modulus_free: bool
    stiffness_sd: float  # relative; 0: taken as exact
    noise_stated: bool


def load_tactile_case(folder: Path) -> TactileCase:
    """Read a case folder. UserError when anything in it is wrong."""
    tables = case_tables(folder, read_case_text(folder))
    complain = tables.complain
    tables.allow((), "case", "model", "parameters", "fit", "noise", "data")
    tables.allow(("case",), "title", "notes", "source", "comment", "license", "date")
    tables.allow(("model",), "base", "effects")
    if tables.text("model", "base") != BASE.name:
        raise complain(f"found {tables.text('model', 'base')!r}, expected {BASE.name}", "model", "base")
    if tables.texts("model", "effects", default=[]):
        raise complain("found effects, expected none: the equilibrium has no place for them", "model", "effects")
    rig = _rig(tables)
    modulus, modulus_free = _modulus(tables)
    stiffness_sd = 0.0
    if tables.get("parameters", "stiffness_sd") is not None:
        stiffness_sd = _share(tables, 1.0, "parameters", "stiffness_sd")
    noise, stated = _noise(tables)
    values, places = _points(folder, tables)
    return TactileCase(
        title=tables.text("case", "title", default=folder.resolve().name),
        rig=rig,
        points=Points.of(values["load"], values["drawbar_pull"], values["torque"], values["slip"], noise),
        places=places,
        modulus=modulus,
        modulus_free=modulus_free,
        stiffness_sd=stiffness_sd,
        noise_stated=stated,
    )


def _rig(tables: Tables) -> Rig:
    tables.allow(("parameters",), *RIG, "shear_modulus", "stiffness_sd", "stress")
    found = {}
    for name, unit in RIG.items():
        if tables.get("parameters", name) is None:
            raise tables.complain(f"{name} is missing, expected it here", "parameters")
        found[name] = tables.number(unit, "parameters", name)
        least = 0.0 if name == "k_c" else 1e-9
        if found[name] < least:
            words = "0 or more" if name == "k_c" else "more than 0"
            raise tables.complain(f"found {found[name]:g} {unit}, expected {words}", "parameters", name)
    if found["n"] > 3.0:
        raise tables.complain(f"found {found['n']:g}, expected at most 3", "parameters", "n")
    stress = tables.text("parameters", "stress", default="full")
    if stress not in ("full", "linear"):
        raise tables.complain(f"found {stress!r}, expected full or linear", "parameters", "stress")
    return Rig(found["radius"], found["width"], found["k_c"], found["k_phi"], found["n"], stress == "linear")


def _modulus(tables: Tables) -> tuple[float, bool]:
    """Shear modulus [m] and whether it is fitted."""
    tables.allow(("fit",), "shear_modulus")
    known = tables.get("parameters", "shear_modulus") is not None
    asked = tables.get("fit", "shear_modulus") is not None
    if known and asked:
        raise tables.complain("stands in [parameters] too, expected in one of the two", "fit", "shear_modulus")
    if not known and not asked:
        raise tables.complain("shear_modulus is missing, expected it here or in [fit]", "parameters")
    path: tuple[str, ...] = ("parameters", "shear_modulus")
    if asked:
        if tables.get("fit", "shear_modulus") is True:
            return START_MODULUS, True
        tables.allow(("fit", "shear_modulus"), "value")
        path = ("fit", "shear_modulus", "value")
        if tables.get(*path) is None:
            raise tables.complain("missing, expected a start value", *path)
    value = tables.number("m", *path)
    if not 1e-4 <= value <= 1.0:
        raise tables.complain(f"found {value:g} m, expected 0.0001 to 1 m", *path)
    return value, asked


def _share(tables: Tables, most: float, *path: str) -> float:
    value = tables.number("1", *path)
    if not 0.0 <= value <= most:
        raise tables.complain(f"found {value:g}, expected 0 to {most:g}", *path)
    return value


def _noise(tables: Tables) -> tuple[Noise, bool]:
    tables.allow(("noise",), *COLUMNS)
    found = tables.table("noise")
    if not found:
        return Noise(), False
    shares = {}
    for name in COLUMNS:
        if name not in found:
            raise tables.complain(f"{name} is missing, expected all four or no table", "noise")
        shares[name] = _share(tables, 0.5, "noise", name)
        if shares[name] <= 0.0:
            raise tables.complain("found 0, expected more than 0", "noise", name)
    return Noise(*shares.values()), True


def _points(folder: Path, tables: Tables) -> tuple[dict[str, Array], tuple[str, ...]]:
    tables.allow(("data",), "files", "columns")
    tables.allow(("data", "columns"), *COLUMNS)
    for name in COLUMNS:
        if tables.get("data", "columns", name) is None:
            raise tables.complain(f"{name} is not mapped, expected its column", "data", "columns")
    files = tables.files()
    parts: dict[str, list[Array]] = {name: [] for name in COLUMNS}
    places: list[str] = []
    for name in files:
        table = read(folder / name)
        for role in COLUMNS:
            parts[role].append(mapped_column(tables, table, role, COLUMNS[role]))
        places += [table.place(row) for row in range(table.rows)]
    values = {role: np.concatenate(columns) for role, columns in parts.items()}
    if not places:
        raise tables.complain(f"{files[0]} has no rows, expected at least one", "data", "files")
    for row, place in enumerate(places):
        load, slip = values["load"][row], values["slip"][row]
        if load <= 0.0:
            raise UserError(f"{place}: load: found {load:g} N, expected more than 0 N")
        if not -1.0 <= slip <= 1.0:
            raise UserError(f"{place}: slip: found {slip:g}, expected -1 to 1")
        if abs(slip) > MOST_SLIP:
            raise UserError(
                f"{place}: slip: found {slip:g}, expected at most {MOST_SLIP}: beyond it the shear stress is saturated "
                "and the equilibrium's stress distribution no longer holds"
            )
    return values, tuple(places)
