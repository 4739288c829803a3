"""Reina et al. 2006, the soil: Table 2 and the equations it rests on."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import brentq, root

from terrapin_hil.arrays import Array
from terrapin_hil.physics import wheel
from terrapin_hil.physics.contact import THETA_MAX
from terrapin_hil.robot.plant import Robot
from terrapin_tools.papers.figures import BLUE, GREY, RED
from terrapin_tools.papers.part import Figure, Part, Table
from terrapin_tools.papers.printed import numbers, printed
from terrapin_tools.papers.verdict import ranged, states, unchecked
from terrapin_tools.soil.tactile import Rig, predict

__all__ = ["parts"]

WIDTHS = (0.05, 0.08, 0.10, 0.15, 0.20, 0.30, 0.40)  # m
MODULI = (0.005, 0.010, 0.025, 0.050)  # m
OURS = (0.15, 0.025)
TOO_SENSITIVE = 1.0  # a parameter that 1 % of torque moves by more than this share cannot be read from it


def parts() -> list[Part]:
    return [_table_2()]


def _rig(width: float) -> Rig:
    sinkage = printed()["reina"]["table_2"]["sinkage"]
    k_c, k_phi, n = (float(sinkage[name]) for name in ("k_c_kn_m2", "k_phi_kn_m3", "n"))
    return Rig(Robot().radius, width, 1e3 * k_c, 1e3 * k_phi, n)


def _truth(modulus: float) -> Array:
    table = printed()["reina"]["table_2"]
    return np.array([1e3 * float(table["cohesion_kpa"]), np.radians(float(table["friction_deg"])), modulus, 1.0])


def _free_rolling(width: float, modulus: float) -> tuple[float, float, float] | None:
    """Entry angle [rad], slip and torque [N m] of the robot that pulls nothing; None where no slip up to 1 does."""
    rig, q, load = _rig(width), _truth(modulus), np.array([Robot().weight])

    def at(slip: float) -> tuple[float, Array]:
        slips = np.array([slip])
        theta = wheel.entry_angle(load, slips, rig.radius, rig.width, rig.soil(q))
        return float(theta[0]), predict(rig, q, theta, slips)[0]

    if at(1.0)[1][1] <= 0.0 or at(1.0)[0] >= THETA_MAX:
        return None
    slip = float(brentq(lambda s: float(at(s)[1][1]), 0.0, 1.0, xtol=1e-12))
    theta, forces = at(slip)
    return theta, slip, float(forces[2])


def _inverted(theta: float, slip: float, torque: float, change: float) -> Array:
    """Cohesion [Pa] and friction angle [rad] that (13) to (15) give for a torque that is off by `change`."""
    rig, modulus = _rig(OURS[0]), OURS[1]
    goal = np.array([Robot().weight, 0.0, torque * (1.0 + change)])
    scale = np.array([goal[0], goal[0], torque])
    start = _truth(modulus)

    def off(x: Array) -> Array:
        q = np.array([1e3 * x[0], x[1], modulus, 1.0])
        return np.asarray((predict(rig, q, np.array([x[2]]), np.array([slip]))[0, :3] - goal) / scale)

    found: Any = root(off, [1e-3 * start[0], start[1], theta], tol=1e-14)
    return np.array([1e3 * found.x[0], found.x[1]])


def _printed_torque(theta_1: float, slip: float, width: float, modulus: float) -> float:
    """T [N m] with Eq. (10) as printed: j = R (1 - i)(sin theta_1 - sin theta)."""
    rig, q = _rig(width), _truth(modulus)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    total = 0.0
    for low, high in ((0.0, 0.5 * theta_1), (0.5 * theta_1, theta_1)):
        theta = 0.5 * (high - low) * (nodes + 1.0) + low
        front = theta if low > 0.0 else theta_1 - theta / (0.5 * theta_1) * (theta_1 - 0.5 * theta_1)
        depth = np.maximum(np.cos(front) - np.cos(theta_1), 0.0)
        sigma = (rig.k_c + rig.k_phi * width) * (rig.radius / width) ** rig.exponent * depth**rig.exponent
        travel = rig.radius * (1.0 - slip) * (np.sin(theta_1) - np.sin(theta))
        tau = (q[0] + sigma * np.tan(q[1])) * -np.expm1(-travel / modulus)
        total += 0.5 * (high - low) * float(weights @ tau)
    return rig.radius**2 * width * total


def _table_2() -> Part:
    paper = printed()["reina"]
    table, robot = paper["table_2"], Robot()
    rolled = {setting: _free_rolling(*setting) for setting in product(WIDTHS, MODULI)}
    ratios = {
        setting: found[2] / (robot.radius * robot.weight) for setting, found in rolled.items() if found is not None
    }
    f_o, f_s = (float(text) for text in paper["table_1"]["sand"])
    fastest = 7.0  # rad/s, about the speed at 5 V
    found = rolled[OURS]
    assert found is not None
    theta, slip, torque = found
    soils = {change: _inverted(theta, slip, torque, change) for change in (-0.005, 0.0, 0.001, 0.005, 0.01)}
    cohesion = 1e3 * float(table["cohesion_kpa"])
    moved = abs(soils[0.01][0] / cohesion - 1.0)
    slips = (0.0, 0.1, 0.3, 0.6, 0.99)
    angle = np.radians(22.0)
    as_printed = [_printed_torque(angle, s, *OURS) for s in slips]
    corrected = [float(predict(_rig(OURS[0]), _truth(OURS[1]), np.array([angle]), np.array([s]))[0, 2]) for s in slips]
    low, high = numbers(table["published_cohesion_kpa"])
    least, most = numbers(table["published_friction_deg"])
    checks = (
        unchecked("cohesion 0.7 kPa, friction angle 30 deg", "measured", ("the runs", *table["not_printed"])),
        states(
            "both match the published range",
            low <= float(table["cohesion_kpa"]) <= high and least <= float(table["friction_deg"]) <= most,
            f"{low:g} to {high:g} kPa, {least:g} to {most:g} deg",
        ),
        ranged(
            "T/(R W) of steady rolling: Table 1 against (13) to (15) with Table 2's soil",
            f_o,
            f_o + f_s * fastest**2,
            min(ratios.values()),
            max(ratios.values()),
            f"widths of {1e3 * WIDTHS[0]:g} to {1e3 * WIDTHS[-1]:g} mm and shear moduli of {1e3 * MODULI[0]:g} to "
            f"{1e3 * MODULI[-1]:g} mm ({len(ratios)} of {len(rolled)} settings roll without slip above 1)",
        ),
        states(
            "(13) to (15) yield cohesion, friction angle and entry angle from W, T and slip",
            moved < TOO_SENSITIVE,
            f"0.1 % more torque gives {1e-3 * soils[0.001][0]:.2f} kPa and {np.degrees(soils[0.001][1]):.1f} deg; "
            f"1 % moves cohesion by {100 * moved:.0f} %",
            "at DP = 0 (14) and (15) are nearly one equation; one point fixes one strength, several loads are needed "
            "(terrapin soil tactile)",
        ),
        states(
            "by Eq. (10) as printed torque grows with slip",
            as_printed[-1] > as_printed[0],
            f"T at entry angle 22 deg falls from {as_printed[0]:.3f} to {as_printed[-1]:.3f} N m as slip grows from 0 "
            f"to 0.99; with (theta_1 - theta) put back it rises from {corrected[0]:.3f} to {corrected[-1]:.3f} N m",
            "the print has lost '(theta_1 - theta) -' in the exponent",
        ),
    )

    def draw(figure: Any) -> None:
        left, right = figure.subplots(1, 2)
        for modulus, style in zip(MODULI, ("-", "--", ":", "x"), strict=True):
            widths = [w for w in WIDTHS if (w, modulus) in ratios]
            rows = [ratios[w, modulus] for w in widths]
            left.plot([1e3 * w for w in widths], rows, style, color=BLUE, label=f"k = {1e3 * modulus:g} mm")
        left.axhspan(f_o, f_o + f_s * fastest**2, color=RED, alpha=0.3, lw=0, label="Table 1, sand")
        left.set(xlabel="assumed width b, mm", ylabel="T / (R W) at no drawbar pull", ylim=(0.0, None))
        left.legend(fontsize=7)
        change = np.array(list(soils))
        right.plot(100 * change, [1e-3 * s[0] for s in soils.values()], "o-", color=BLUE, label="cohesion, kPa")
        right.plot(
            100 * change, [np.degrees(s[1]) / 10 for s in soils.values()], "s-", color=GREY, label="angle, 10 deg"
        )
        right.set(xlabel="error of the torque, %", title="what one point gives")
        right.legend(fontsize=7)

    rows = tuple((f"{s:g}", f"{a:.4f}", f"{b:.4f}") for s, a, b in zip(slips, as_printed, corrected, strict=True))
    return Part(
        paper="reina",
        title="Table 2",
        about="Cohesion and internal friction angle of sand, estimated by the equilibrium (13) to (15).",
        checks=checks,
        figures=(Figure("reina_table2", "Why Table 2 does not follow from Table 1", (9.0, 3.2), draw),),
        tables=(Table("T [N m] at entry angle 22 deg", ("slip", "Eq. (10) as printed", "corrected"), rows),),
    )
