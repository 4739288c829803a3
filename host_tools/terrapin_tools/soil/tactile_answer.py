"""The answer of `terrapin soil tactile`: as a dictionary for programs, as words for people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from terrapin_hil.physics import wheel
from terrapin_tools.figure_style import PANELS, picture
from terrapin_tools.soil.region import LEVEL, explore, single, strengths
from terrapin_tools.soil.tactile import Fit, Unsolved, fit, predict
from terrapin_tools.soil.tactile_case import MOST_SLIP, TactileCase

__all__ = ["answer", "describe", "plot"]

UNITS = {"cohesion": "Pa", "friction_angle": "rad", "shear_modulus": "m", "stiffness_factor": "1"}
SHOWN = {
    "cohesion": (1e-3, "kPa"),
    "friction_angle": (57.29577951308232, "deg"),
    "shear_modulus": (1e3, "mm"),
    "stiffness_factor": (1.0, ""),
}
GROSS = 5.0  # sd (rms) of residuals beyond which no region has a meaning
STARTS = ((500.0, 0.5), (5e3, 0.3), (100.0, 0.7))  # cohesion [Pa], friction angle [rad]
ONE_POINT = (
    "one operating point cannot tell cohesion from friction angle: drawbar pull and torque are nearly one equation "
    "there; measure at other loads"
)
ONE_LOAD = (
    "these points do not tell cohesion from friction angle: the interval of one of them is all that physics allows; "
    "measure at loads that differ more"
)


def answer(read: TactileCase, least_margin: float) -> dict[str, Any]:
    """Cohesion and friction angle with their region, or the reason why not and tau_max. Unsolved names what failed."""
    points = read.points
    result: dict[str, Any] = {
        "schema": "terrapin.soil_tactile/1",
        "case": read.title,
        "points": int(points.load.size),
        "noise": "stated" if read.noise_stated else "assumed proportions, size from the scatter",
        "stress": "linear" if read.rig.linear else "full",
        "identified": False,
        "reason": None,
        "parameters": None,
        "region": None,
        "tau_max": None,
    }
    start = np.array([STARTS[0][0], STARTS[0][1], read.modulus, 1.0])
    if points.load.size == 1:
        return _only_strength(read, start, result, ONE_POINT, least_margin)
    best = _best(read)
    if read.noise_stated and best.squares > GROSS**2 * max(1, best.degrees):
        rms = float(np.sqrt(best.squares / max(1, best.degrees)))
        raise Unsolved(
            f"residuals: found {rms:.3g} sd (rms), expected about 1: no soil comes near these points; check units, "
            "constants and noise"
        )
    region = explore(read.rig, points, best, read.noise_stated, read.stiffness_sd)
    result["fit"] = {
        "squares": best.squares,
        "degrees": best.degrees,
        "p_value": float(stats.chi2.sf(best.squares, best.degrees)) if read.noise_stated else None,
    }
    result["intervals"] = {
        name: {
            "value": i.value,
            "unit": UNITS[name],
            "sd": i.sd,
            "interval": [i.low, i.high],
            "cut_by_bound": [i.low_open, i.high_open],
        }
        for name, i in region.intervals.items()
    }
    if not region.identified:
        return _only_strength(read, best.q, result, ONE_LOAD, least_margin)
    result["identified"] = True
    result["parameters"] = result.pop("intervals")
    correlation = best.covariance[0, 1] / np.sqrt(best.covariance[0, 0] * best.covariance[1, 1])
    result["region"] = {
        "level": LEVEL,
        "kind": "profile likelihood" if region.kind == "likelihood" else "F",
        "limit": region.limit,
        "correlation": float(correlation),
        "outline": {"cohesion": region.outline[:, 0].tolist(), "friction_angle": region.outline[:, 1].tolist()},
    }
    seen = strengths(read.rig, points, best)
    result["traversability"] = {
        "criterion": "tau < tau_max = c + sigma_max tan(phi), at the angle of the greatest normal stress (Eq. 11)",
        "least_margin": least_margin,
        "points": [
            {
                "place": place,
                "load": float(points.load[i]),
                "slip": float(best.slip[i]),
                "sigma_max": float(seen.sigma[i]),
                "tau": float(seen.tau[i]),
                "tau_max": float(seen.tau_max[i]),
                "tau_max_sd": float(seen.tau_max_sd[i]),
                "margin": float(seen.margin[i]),
                "margin_sd": float(seen.margin_sd[i]),
                "verdict": _verdict(float(seen.margin[i]), float(seen.margin_sd[i]), least_margin),
            }
            for i, place in enumerate(read.places)
        ],
        "most_drawbar_pull": _reserve(read, best),
    }
    return result


def _best(read: TactileCase) -> Fit:
    """The best of fits from several soils."""
    found: list[Fit] = []
    reason: Unsolved | None = None
    for cohesion, friction in STARTS:
        free = (True, True, read.modulus_free, read.stiffness_sd > 0.0)
        try:
            found.append(fit(read.rig, read.points, (cohesion, friction, read.modulus, 1.0), free, read.stiffness_sd))
        except Unsolved as error:
            reason = reason or error
    if not found:
        assert reason is not None
        raise reason
    return min(found, key=lambda one: one.squares)


def _verdict(margin: float, sd: float, least: float) -> str:
    """holds: at least `least` with 95 % on both sides; fails: less; open: the noise leaves it open."""
    if margin - 1.96 * sd >= least:
        return "holds"
    return "fails" if margin + 1.96 * sd < least else "open"


def _reserve(read: TactileCase, best: Fit) -> list[dict[str, float]]:
    """What the ground pulls at the greatest slip that this model is good for, at each load level."""
    rig = read.rig
    ordered = np.sort(read.points.load)
    levels = np.split(ordered, np.flatnonzero(np.diff(ordered) > 0.05 * ordered[1:]) + 1)
    loads = np.array([float(level.mean()) for level in levels])
    theta = wheel.entry_angle(loads, MOST_SLIP, rig.radius, rig.width, rig.soil(best.q), rig.linear)
    pulled = predict(rig, best.q, theta, np.full(loads.size, MOST_SLIP))
    return [
        {"load": float(load), "slip": MOST_SLIP, "drawbar_pull": float(row[1]), "torque": float(row[2])}
        for load, row in zip(loads, pulled, strict=True)
    ]


def _only_strength(
    read: TactileCase, start: np.ndarray, result: dict[str, Any], reason: str, least_margin: float
) -> dict[str, Any]:
    one = single(read.rig, read.points, start)
    result["reason"] = reason
    result["tau_max"] = {
        "value": one.tau_max,
        "range": [one.low, one.high],
        "unit": "Pa",
        "fixed": None
        if one.shear_strength is None or one.normal_stress is None
        else {
            "normal_stress": one.normal_stress,
            "shear_strength": one.shear_strength,
            "sd": one.shear_strength_sd,
            "unit": "Pa",
        },
    }
    result["traversability"] = {
        "criterion": "tau < tau_max = c + sigma_max tan(phi), at the angle of the greatest normal stress (Eq. 11)",
        "least_margin": least_margin,
        "margin": one.margin,
        "margin_sd": one.margin_sd,
        "verdict": _verdict(one.margin, one.margin_sd, least_margin),
    }
    return result


def describe(result: dict[str, Any]) -> str:
    """The answer in words."""
    count = result["points"]
    lines = [f"{result['case']}: {count} operating point{'s' if count != 1 else ''}, noise {result['noise']}"]
    if result["identified"]:
        lines += _identified(result)
    else:
        lines += _unidentified(result)
    return "\n".join(lines)


def _row(name: str, entry: dict[str, Any]) -> str:
    factor, unit = SHOWN[name]
    low, high = (factor * end for end in entry["interval"])
    cut = " (a bound ends it)" if any(entry["cut_by_bound"]) else ""
    return f"  {name:<17}{factor * entry['value']:9.4g} {unit:<4} 95 % {low:.4g} to {high:.4g}{cut}"


def _identified(result: dict[str, Any]) -> list[str]:
    lines = [_row(name, entry) for name, entry in result["parameters"].items()]
    region, fitted = result["region"], result["fit"]
    lines.append(f"  joint 95 % region of both: {region['kind']}, correlation {region['correlation']:+.3f}")
    if fitted["p_value"] is not None:
        words = "as the noise has it" if fitted["p_value"] >= 0.01 else "MORE than the noise has: the model is wrong"
        lines.append(
            f"  sum of squares {fitted['squares']:.1f} at {fitted['degrees']} degrees of freedom "
            f"(p = {fitted['p_value']:.2g}): {words}"
        )
    ways = result["traversability"]
    least = ways["least_margin"]
    lines.append(f"  Coulomb-Mohr (Eq. 11), margin 1 - tau/tau_max against {least:g}:")
    lines.append("    load N   slip   sigma_max kPa   tau kPa   tau_max kPa     margin")
    for point in ways["points"]:
        lines.append(
            f"  {point['load']:8.2f} {point['slip']:6.3f} {1e-3 * point['sigma_max']:15.3f} {1e-3 * point['tau']:9.3f} "
            f"{1e-3 * point['tau_max']:9.3f} +- {1e-3 * point['tau_max_sd']:.2f} {point['margin']:6.3f} +- "
            f"{point['margin_sd']:.3f} {point['verdict']}"
        )
    for pull in ways["most_drawbar_pull"]:
        lines.append(
            f"  at {pull['load']:.3g} N the ground pulls at most {pull['drawbar_pull']:.3g} N "
            f"(slip {pull['slip']:g}, torque {pull['torque']:.3g} N m)"
        )
    return lines


def _unidentified(result: dict[str, Any]) -> list[str]:
    lines = [f"  refused: {result['reason']}"]
    lines += [_row(name, entry) for name, entry in result.get("intervals", {}).items()]
    tau = result["tau_max"]
    low, high = (1e-3 * end for end in tau["range"])
    lines.append(
        f"  tau_max {1e-3 * tau['value']:.3g} kPa with stresses in straight lines; {low:.3g} to {high:.3g} kPa over "
        "all soils that explain this"
    )
    if tau["fixed"] is not None:
        fixed = tau["fixed"]
        lines.append(
            f"  fixed is the strength c + p tan(phi) at p = {1e-3 * fixed['normal_stress']:.3g} kPa: "
            f"{1e-3 * fixed['shear_strength']:.4g} +- {1e-3 * fixed['sd']:.2g} kPa"
        )
    ways = result["traversability"]
    lines.append(
        f"  Coulomb-Mohr (Eq. 11): margin 1 - tau/tau_max = {ways['margin']:.3f} +- {ways['margin_sd']:.3f} at the "
        f"heaviest load, against {ways['least_margin']:g}: {ways['verdict']}"
    )
    return lines


def plot(result: dict[str, Any], file: Path) -> None:
    """The joint region of cohesion and friction angle, and the margin of each point; only of an identified answer."""
    outline = result["region"]["outline"]
    cohesion, friction = (result["parameters"][name] for name in ("cohesion", "friction_angle"))
    closed = [*range(len(outline["cohesion"])), 0]
    points = result["traversability"]["points"]
    with picture(file, (10.0, 4.0), PANELS) as figure:
        left, right = figure.subplots(1, 2)
        left.fill(
            [1e-3 * outline["cohesion"][i] for i in closed],
            [float(np.degrees(outline["friction_angle"][i])) for i in closed],
            color="#2f6fdb",
            alpha=0.2,
            label=f"joint 95 % region ({result['region']['kind']})",
        )
        left.errorbar(
            1e-3 * cohesion["value"],
            np.degrees(friction["value"]),
            xerr=[[1e-3 * abs(end - cohesion["value"])] for end in cohesion["interval"]],
            yerr=[[float(np.degrees(abs(end - friction["value"])))] for end in friction["interval"]],
            fmt="o",
            color="#2f6fdb",
            label="95 % intervals of one",
        )
        left.set(xlabel="cohesion, kPa", ylabel="friction angle, deg")
        left.legend()
        right.errorbar(
            [p["slip"] for p in points],
            [p["margin"] for p in points],
            yerr=[1.96 * p["margin_sd"] for p in points],
            fmt="o",
            ms=4,
            color="#158a74",
        )
        for p in points:
            right.annotate(f" {p['load']:.3g} N", (p["slip"], p["margin"]), fontsize=7)
        right.axhline(result["traversability"]["least_margin"], color="#d0405a", lw=1, ls="--", label="least margin")
        right.set(xlabel="slip", ylabel="margin 1 - tau / tau_max (Eq. 11)", ylim=(0.0, 1.0))
        right.legend()
