"""A case with base "vehicle": runs of a car on soft soil, for `terrapin soil vehicle`.

    [model]
    base = "vehicle"
    [parameters]            # any field of the car and the tyre (tyre_radius, ...), and soil parameters that are known
    mass = "1797 kg"
    [fit]                   # k_s, n, cohesion, friction_angle, shear_modulus, as far as they are not known
    k_s = { value = "535.3 kN/m^2.71", min = "289 kN/m^2.71", max = "782 kN/m^2.71" }
    [data]
    files = ["runs.csv"]
    run = "run"
    train = ["r1", "r2"]
    test = ["r3"]
    [data.columns]
    time = { column = "t", unit = "s" }
    drive_torque = { column = "T_dR", unit = "N m" }     # of one rear half shaft
    omega_fl = { column = "w_fl", unit = "rad/s" }       # and omega_fr, omega_rl, omega_rr: at least one of the four

k_s is in Pa/m^n, with n as its start value has it. Everything wrong is a UserError of one line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.soils import Footing
from terrapin_hil.physics.tyre import Tyre
from terrapin_hil.physics.vehicle import Vehicle
from terrapin_tools.errors import UserError, about
from terrapin_tools.soil.vehicle import MASK, PARAMETERS, WHEELS, Drive
from terrapin_tools.workbench.bases.vehicle import BASE
from terrapin_tools.workbench.case.columns import mapped_column, run_of_rows, split_runs
from terrapin_tools.workbench.files.tables import Table, read
from terrapin_tools.workbench.files.toml_tables import Tables, case_tables, read_case_text, read_estimate

__all__ = ["VehicleCase", "load_vehicle_case"]


SOIL_UNITS = {"k_s": "Pa/m^n", "n": "1", "cohesion": "Pa", "friction_angle": "rad", "shear_modulus": "m"}
VEHICLE_UNITS = {
    "mass": "kg",
    "gravity": "m/s^2",
    "drag": "N s^2/m^2",
    "front_distance": "m",
    "rear_distance": "m",
    "height": "m",
    "wheel_inertia": "kg m^2",
    "relaxation_length": "m",
    "speed_floor": "m/s",
    "load_floor": "N",
}
TYRE_UNITS = {"radius": "m", "width": "m", "stiffness": "N/m", "angle_share": "1", "angle_slip": "1"}
COLUMNS = {"time": "s", "drive_torque": "N m", **{f"omega_{wheel}": "rad/s" for wheel in WHEELS}}


@dataclass(frozen=True)
class VehicleCase:
    title: str
    vehicle: Vehicle
    tyre: Tyre
    assumed: tuple[str, ...]  # parameters of car and tyre that the case does not state
    start: Footing
    bounds: tuple[Footing, Footing]  # equal where a parameter is known
    mask: float  # [rad/s]
    train: tuple[Drive, ...]
    test: tuple[Drive, ...]


def load_vehicle_case(folder: Path) -> VehicleCase:
    """Read a case folder. UserError when anything in it is wrong."""
    tables = case_tables(folder, read_case_text(folder))
    complain = tables.complain
    tables.allow((), "case", "model", "parameters", "fit", "data")
    tables.allow(("case",), "title", "notes", "source", "comment", "license", "date")
    tables.allow(("model",), "base", "effects")
    if tables.text("model", "base") != BASE.name:
        raise complain(f"found {tables.text('model', 'base')!r}, expected {BASE.name}", "model", "base")
    if tables.texts("model", "effects", default=[]):
        raise complain("found effects, expected none: this estimator takes the car as it is", "model", "effects")
    tyre_units = {f"tyre_{name}": unit for name, unit in TYRE_UNITS.items()}
    tables.allow(("parameters",), *VEHICLE_UNITS, *tyre_units, *SOIL_UNITS, "mask")
    known = tables.table("parameters")
    car = {name: tables.number(unit, "parameters", name) for name, unit in VEHICLE_UNITS.items() if name in known}
    rubber = {name: tables.number(unit, "parameters", name) for name, unit in tyre_units.items() if name in known}
    with about(f"{folder / 'case.toml'}: parameters"):
        vehicle = Vehicle(**car)
        tyre = Tyre(**{name.removeprefix("tyre_"): value for name, value in rubber.items()})
    mask = tables.number("rad/s", "parameters", "mask") if "mask" in known else MASK
    if mask < 0.0:
        raise complain(f"found {mask:g} rad/s, expected at least 0 rad/s", "parameters", "mask")
    start, bounds = _soil(tables)
    drives = _drives(folder, tables, mask)
    runs = sorted(drives)
    train, test = split_runs(tables, runs, runs[-1:] if len(runs) > 1 else ())
    stated = {*car, *rubber}
    return VehicleCase(
        title=tables.text("case", "title", default=folder.resolve().name),
        vehicle=vehicle,
        tyre=tyre,
        assumed=tuple(name for name in (*[f.name for f in fields(Vehicle)], *tyre_units) if name not in stated),
        start=start,
        bounds=bounds,
        mask=mask,
        train=tuple(drives[name] for name in train),
        test=tuple(drives[name] for name in test),
    )


def _soil(tables: Tables) -> tuple[Footing, tuple[Footing, Footing]]:
    tables.allow(("fit",), *PARAMETERS)
    value: dict[str, float] = {}
    low: dict[str, float] = {}
    high: dict[str, float] = {}
    exponent = 1.0
    for name in ("n", *(p for p in PARAMETERS if p != "n")):  # the unit of k_s needs n
        unit = SOIL_UNITS[name].replace("^n", f"^{exponent:.12g}")
        fitted = tables.get("fit", name) is not None
        if fitted and tables.get("parameters", name) is not None:
            raise tables.complain("stands in [parameters] too, expected in one of the two", "fit", name)
        if fitted:
            tables.allow(("fit", name), "value", "min", "max")
            entry = read_estimate(tables, ("fit", name), unit)
            for key, limit in (("min", entry.minimum), ("max", entry.maximum)):
                if not np.isfinite(limit):
                    raise tables.complain("missing, expected a bound: the fit is bounded", "fit", name, key)
            value[name], low[name], high[name] = entry.value, entry.minimum, entry.maximum
        elif tables.get("parameters", name) is not None:
            value[name] = low[name] = high[name] = tables.number(unit, "parameters", name)
        else:
            raise tables.complain(f"{name} is missing, expected it here or in [parameters]", "fit")
        least = 0.0 if name in ("cohesion", "friction_angle") else 1e-300
        if low[name] < least:
            where = ("fit", name, "min") if fitted else ("parameters", name)
            expected = "at least 0" if least == 0.0 else "more than 0"
            raise tables.complain(f"found {low[name]:g}, expected {expected}", *where)
        if name == "n":
            exponent = value[name]
    start, least_soil, most_soil = (Footing(*(side[name] for name in PARAMETERS)) for side in (value, low, high))
    return start, (least_soil, most_soil)


def _drives(folder: Path, tables: Tables, mask: float) -> dict[str, Drive]:
    """Every run of the files, checked: even sampling from standstill."""
    tables.allow(("data",), "files", "run", "train", "test", "columns")
    mapped = tables.table("data", "columns")
    tables.allow(("data", "columns"), *COLUMNS)
    for name in ("time", "drive_torque"):
        if name not in mapped:
            raise tables.complain(f"{name} is not mapped, expected its column", "data", "columns")
    wheels = tuple(wheel for wheel in WHEELS if f"omega_{wheel}" in mapped)
    if not wheels:
        raise tables.complain("no wheel speed is mapped, expected one of omega_fl, fr, rl, rr", "data", "columns")
    drives: dict[str, Drive] = {}
    for name in tables.files():
        table = read(folder / name)
        if table.rows == 0:
            raise tables.complain(f"{name} has no rows, expected at least one", "data", "files")
        values = {role: mapped_column(tables, table, role, COLUMNS[role]) for role in COLUMNS if role in mapped}
        names = np.array(run_of_rows(tables, [table], tables.text("data", "run", default="")))
        for run in dict.fromkeys(names.tolist()):
            rows = np.flatnonzero(names == run)
            if run in drives:
                raise tables.complain(f"run {run!r} is in two files, expected in one", "data", "files")
            parts = {role: column[rows] for role, column in values.items()}
            drives[run] = _drive(run, parts, wheels, table, rows, mask)
    return drives


def _drive(
    run: str,
    values: Mapping[str, Array],
    wheels: tuple[str, ...],
    table: Table,
    rows: Index,
    mask: float,
) -> Drive:
    time = values["time"]
    if time.size < 3:
        raise UserError(f"{table.place(int(rows[0]))}: run {run} has {time.size} rows, expected at least 3")
    period = float((time[-1] - time[0]) / (time.size - 1))
    uneven = np.flatnonzero(np.abs(np.diff(time) - period) > 0.01 * abs(period))
    if period <= 0.0 or uneven.size:
        row = int(rows[uneven[0] + 1]) if uneven.size else int(rows[1])
        step = float(np.diff(time)[uneven[0]]) if uneven.size else period
        raise UserError(
            f"{table.place(row)}: time: found a step of {step:g} s in run {run}, "
            f"expected even steps of {abs(period):g} s: resample it"
        )
    omega = np.stack([values[f"omega_{wheel}"] for wheel in wheels], axis=1)
    if (omega[0] > max(mask, MASK)).any():
        raise UserError(
            f"{table.place(int(rows[0]))}: run {run} starts at {omega[0].max():g} rad/s, expected standstill: "
            "the car is simulated from there"
        )
    return Drive(run, period, values["drive_torque"], omega, wheels)
