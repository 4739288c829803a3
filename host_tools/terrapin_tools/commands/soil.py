"""`terrapin soil`: the properties of the ground from what a machine measured on it."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from terrapin_tools.command_options import CaseFolder, Json, Picture, Seed, check_options, deliver
from terrapin_tools.errors import UserError, about
from terrapin_tools.progress import say

if TYPE_CHECKING:
    from terrapin_tools.soil.vehicle import Cost, Fit, Objective
    from terrapin_tools.soil.vehicle_case import VehicleCase
    from terrapin_tools.soil.vehicle_limits import Limits

__all__ = ["SUBCOMMANDS"]

SHOWN = {  # parameter: factor to the unit that people read, that unit (of k_s its prefix, since it follows n)
    "k_s": (1e-3, "k"),
    "n": (1.0, ""),
    "cohesion": (1e-3, "kPa"),
    "friction_angle": (57.29577951308232, "deg"),
    "shear_modulus": (1e3, "mm"),
}


def vehicle(
    case: CaseFolder,
    cost: Annotated[str, typer.Option("--cost", help="least_squares, or eq5: the paper's cost")] = "least_squares",
    starts: Annotated[int, typer.Option("--starts", help="optimisations from different soils")] = 3,
    profiles: Annotated[
        bool, typer.Option("--profiles/--no-profiles", help="intervals from profile likelihoods")
    ] = True,
    json: Json = "",
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option("--jobs", help="threads to use at most; 0: one a core")] = 0,
) -> None:
    """Estimate the soil under a car from wheel torque and wheel speeds, and say what the runs cannot tell.

    The case has base = "vehicle". Runs held out validate the fit.

    Example: terrapin soil vehicle my_car_on_sand --json soil.json
    """
    from terrapin_hil.physics.tyre import ContactError
    from terrapin_tools.soil.vehicle import Objective, estimate
    from terrapin_tools.soil.vehicle_case import load_vehicle_case
    from terrapin_tools.soil.vehicle_limits import analyse

    check_options(seed, jobs or 1)
    if cost not in ("least_squares", "eq5"):
        raise UserError(f"--cost: found {cost!r}, expected least_squares or eq5")
    if not 1 <= starts <= 64:
        raise UserError(f"--starts: found {starts}, expected 1 to 64")
    begin = time.monotonic()
    read = load_vehicle_case(case)
    threads = jobs or os.cpu_count() or 1
    with about(case, ContactError):
        train = Objective(read.vehicle, read.tyre, read.train, read.mask, threads)
        test = Objective(read.vehicle, read.tyre, read.test, read.mask, threads) if read.test else None
        fit = estimate(train, read.start, read.bounds, cast("Cost", cost), starts, seed, say)
        limits = analyse(train, fit, read.bounds, profiles, say)
        answer = _answer(read, train, test, fit, limits, cost, time.monotonic() - begin)
    deliver(answer, _describe(answer), json)


def _answer(
    read: VehicleCase, train: Objective, test: Objective | None, fit: Fit, limits: Limits, cost: str, seconds: float
) -> dict[str, Any]:
    import numpy as np

    from terrapin_tools.soil.vehicle import PARAMETERS

    start, found = np.array(read.start), np.array(fit.footing)
    parameters = {}
    for name, value in zip(PARAMETERS, fit.footing, strict=True):
        entry: dict[str, Any] = {
            "value": value,
            "unit": SI_UNITS[name].replace("^n", f"^{fit.footing.exponent:.6g}"),
            "at_bound": name in fit.at_bound,
        }
        interval = limits.intervals.get(name)
        entry["known"] = interval is None
        if interval is not None:
            entry.update(
                sd=interval.sd,
                interval=[interval.low, interval.high],
                cut_by_bound=[interval.low_open, interval.high_open],
                fixed_by_data=name in limits.fixed,
            )
        parameters[name] = entry
    return {
        "schema": "terrapin.soil_vehicle/1",
        "case": read.title,
        "cost": cost,
        "parameters": parameters,
        "combinations": [
            {
                "parameters": list(c.parameters),
                "correlation": c.correlation,
                "quantity": c.quantity,
                "at": c.at,
                "at_unit": "m" if c.parameters[0] == "k_s" else "Pa",
                "value": c.value,
                "sd": c.sd,
                "unit": "Pa",
            }
            for c in limits.combinations
        ],
        "eq5_percent": {
            "train": {"start": train.cost(start), "fit": fit.cost},
            "validation": None if test is None else {"start": test.cost(start), "fit": test.cost(found)},
            "wheels": len(read.train[0].wheels),
            "mask_rad_s": read.mask,
        },
        "noise_rad_s": limits.noise,
        "noise_correlation_samples": limits.correlation_samples,
        "starts": [{"soil": list(soil), "objective": value} for soil, value in fit.starts],
        "assumed": list(read.assumed),
        "seconds": seconds,
    }


SI_UNITS = {"k_s": "Pa/m^n", "n": "1", "cohesion": "Pa", "friction_angle": "rad", "shear_modulus": "m"}


def _describe(answer: dict[str, Any]) -> str:
    errors = answer["eq5_percent"]
    wheels = errors["wheels"]
    lines = [f"{answer['case']}: soil by {answer['cost']}"]
    for name, entry in answer["parameters"].items():
        factor, unit = SHOWN[name]
        if name == "k_s":
            unit += entry["unit"]
        text = f"  {name:<15}{entry['value'] * factor:10.4g} {unit:<14}"
        if entry["known"]:
            lines.append(f"{text} known")
            continue
        low, high = (end * factor for end in entry["interval"])
        cut = " (a bound ends it)" if any(entry["cut_by_bound"]) else ""
        verdict = "fixed by the data" if entry["fixed_by_data"] else "NOT fixed by the data"
        lines.append(f"{text} 95 % {low:.4g} to {high:.4g}{cut}; {verdict}")
    for c in answer["combinations"]:
        if c["parameters"][0] == "k_s":
            where = f"at z = {1e3 * c['at']:.1f} mm"
        else:
            where = f"at p = {1e-3 * c['at']:.3g} kPa"
        lines.append(
            f"  {c['parameters'][0]} and {c['parameters'][1]} correlate {c['correlation']:+.4f}; fixed is the "
            f"{c['quantity']} {where}: {1e-3 * c['value']:.4g} +- {1e-3 * c['sd']:.2g} kPa"
        )
    starts = answer["starts"]
    same = sum(s["objective"] <= starts[0]["objective"] * (1.0 + 1e-3) for s in starts)
    lines.append(f"  {same} of {len(starts)} starts end at this optimum (objective within 0.1 %)")
    train, test = errors["train"], errors["validation"]
    lines.append(
        f"  cost of Eq. 5 over {wheels} wheels, speeds above {errors['mask_rad_s']:g} rad/s: "
        f"start {train['start']:.2f} %, fit {train['fit']:.2f} % ({train['fit'] / wheels:.2f} % a wheel)"
    )
    if test is not None:
        lines.append(f"  validation runs: start {test['start']:.2f} %, fit {test['fit']:.2f} %")
    lines.append(
        f"  residuals {answer['noise_rad_s']:.3g} rad/s rms, correlated over {answer['noise_correlation_samples']:.1f} "
        "samples; what the model gets wrong is in no interval"
    )
    if answer["assumed"]:
        lines.append(f"  assumed, since the case does not state it: {', '.join(answer['assumed'])}")
    return "\n".join(lines)


def tactile(
    case: CaseFolder,
    margin: Annotated[float, typer.Option("--margin", help="least margin 1 - tau/tau_max that counts as safe")] = 0.1,
    plot: Picture = None,
    json: Json = "",
) -> None:
    """Cohesion and friction angle from a driven wheel at several loads and drawbar levels, with confidence regions.

    The case has base = "driven_wheel". One operating point cannot tell the two apart: it gives tau_max instead.

    Example: terrapin soil tactile cases/driven_rig_sand --json soil.json
    """
    from terrapin_tools.soil import tactile_answer
    from terrapin_tools.soil.tactile import Unsolved
    from terrapin_tools.soil.tactile_case import load_tactile_case

    if not 0.0 <= margin < 1.0:
        raise UserError(f"--margin: found {margin:g}, expected 0 to less than 1")
    read = load_tactile_case(case)
    with about(case, Unsolved):
        found = tactile_answer.answer(read, margin)
    if plot is not None and found["identified"]:
        tactile_answer.plot(found, plot)
    elif plot is not None:
        print(f"terrapin: --plot: nothing to draw: {found['reason']}", file=sys.stderr)
    deliver(found, tactile_answer.describe(found), json)


def plates(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv", help="rows of plate tests of at least three sizes")],
    size: Annotated[str, typer.Option("--size", metavar="COLUMN [UNIT]", help="plate size")] = "plate_mm [mm]",
    depth: Annotated[str, typer.Option("--depth", metavar="COLUMN [UNIT]", help="sinkage")] = "z_m [m]",
    pressure: Annotated[str, typer.Option("--pressure", metavar="COLUMN [UNIT]", help="pressure")] = "p_kPa [kPa]",
    test: Annotated[str, typer.Option("--test", metavar="COLUMN", help="which test a row belongs to")] = "test",
    plot: Picture = None,
    json: Json = "",
) -> None:
    """Fit pressure-sinkage laws to plates of several sizes, and test each on a size that it has not seen.

    Example: terrapin soil plates plates.csv --plot plates.png
    """
    from terrapin_tools.soil import plates_answer
    from terrapin_tools.soil.plates import read_plates

    read = read_plates(file, size, depth, pressure, test)
    found, fits = plates_answer.answer(file.name, read)
    if plot is not None:
        plates_answer.plot(found, fits, read, plot)
    deliver(found, plates_answer.describe(found), json)


SUBCOMMANDS = (vehicle, tactile, plates)
