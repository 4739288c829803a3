"""Vella et al. 2024: Table 1 (the estimate) and Fig. 3 (validation), on simulated runs, since none are printed."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrapin_hil.physics.soils import Footing
from terrapin_hil.physics.tyre import Tyre
from terrapin_hil.physics.vehicle import PERIOD, Vehicle, profile_torque, simulate
from terrapin_tools.papers.figures import AMBER, BLUE, GREEN, GREY
from terrapin_tools.papers.part import Figure, Part, Table
from terrapin_tools.papers.printed import half_unit, numbers, printed
from terrapin_tools.papers.verdict import digits, states, unchecked
from terrapin_tools.soil.vehicle import AXLE, Drive, Fit, Objective, bounds_of, estimate, synthetic
from terrapin_tools.soil.vehicle_limits import Limits, analyse

__all__ = ["parts"]

SEED = 1
TYRES = (150e3, 180e3, 220e3)  # N/m; the paper prints none
WONG = (6.94, 505.8, 0.235)  # k_c [kN/m^(n+1)], k_phi [kN/m^(n+2)] of LETE sand (Wong), tyre width [m]
SCALES = (1e-3, 1.0, 1.0, np.degrees(1.0), 1.0)  # of Footing to the table's units


def parts() -> list[Part]:
    paper = printed()["vella"]
    nominal, optimal = (_footing(numbers(paper["table_1"][name])) for name in ("nominal", "optimal"))
    drives = [synthetic(profile, optimal, SEED) for profile in range(3)]
    train, test = (Objective(Vehicle(), Tyre(), some) for some in (drives[:2], drives[2:]))
    return [_table_1(train, nominal, optimal), _figure_3(test, nominal, optimal)]


def _footing(row: list[float]) -> Footing:
    return Footing(*(value / scale for value, scale in zip(row, SCALES, strict=True)))


def _shown(footing: Footing) -> list[float]:
    return [value * scale for value, scale in zip(footing, SCALES, strict=True)]


def _alone(train: Objective, nominal: Footing) -> Fit:
    """Stiffness alone, the rest held at its nominal value."""
    low, high = bounds_of(nominal)
    held = {name: value for name, value in nominal._asdict().items() if name != "stiffness"}
    return estimate(train, nominal, (low._replace(**held), high._replace(**held)), "eq5", starts=1)


def _table_1(train: Objective, nominal: Footing, optimal: Footing) -> Part:
    paper = printed()["vella"]
    table = paper["table_1"]
    names = table["names"]
    every = {cost: estimate(train, nominal, None, cost, starts=1) for cost in ("least_squares", "eq5")}
    alone = _alone(train, nominal)
    limits = analyse(train, every["least_squares"], bounds_of(nominal), profiles=False)
    kept = []
    for fit in every.values():
        shown = _shown(fit.footing)
        kept.append(
            all(abs(shown[i] - float(table["optimal"][i])) <= half_unit(table["optimal"][i]) for i in range(1, 5))
        )
    moves = [_moves(optimal, Tyre(stiffness=k)) for k in TYRES]
    floor = train.cost(np.array(optimal))
    k_c, k_phi, width = WONG
    checks = (
        digits(
            "K_s of LETE sand: k_c / b + k_phi",
            [table["nominal"][0]],
            [k_c / width + k_phi],
            f"Wong's k_c = {k_c}, k_phi = {k_phi} at b = {1e3 * width:g} mm (the tyre is named 215); the unit is "
            "kN/m^(n+2) = kN/m^2.71, printed as kN/m",
            shown=".2f",
        ),
        states(
            "only K_s changes in the optimum, the other four stay to the printed digits",
            kept,
            "; ".join(
                f"{cost}: {', '.join(f'{n} {v:.4g}' for n, v in zip(names, _shown(fit.footing), strict=True))}"
                for cost, fit in every.items()
            ),
            "from the same start on runs simulated with the printed optimum (Eq. 5 costs "
            f"{every['eq5'].cost:.2f} %, the truth {floor:.2f} %). A search over K_s alone gives "
            f"{1e-3 * alone.footing.stiffness:.1f}: the print looks like that, or like a search in unscaled units that "
            "stopped early",
        ),
        states(
            "the sinkage modulus has the most effect",
            [row[0] > max(row[1:]) for row in moves],
            "5 % more of each moves Eq. (5) by "
            + ", ".join(f"{n} {m:.1f}" for n, m in zip(names, moves[1], strict=True))
            + " %",
            f"tyre stiffness of {', '.join(f'{1e-3 * k:g}' for k in TYRES)} kN/m; the numbers are of the middle one",
        ),
        unchecked(
            f"minimum of Eq. (5): {paper['errors']['optimum']} %",
            paper["errors"]["optimum"],
            paper["errors"]["not_printed"],
        ),
    )
    return Part(
        paper="vella",
        title="Table 1",
        about="Soil under a car from wheel torque and wheel speeds: nominal values, bounds, optimum.",
        checks=checks,
        text=(
            "No run is printed, so the estimator is tried on simulated runs whose truth is the printed optimum: torque "
            "profiles of ours, wheel speeds with 0.1 rad/s and torque with 5 N m of noise, start and bounds of Table "
            "1. " + _combinations(limits),
            "Eq. (3) lacks a factor 1/2 (its four loads add up to 2 m g); Eq. (5) divides by speeds that start at 0, "
            "so a mask is needed: here above 2 rad/s.",
        ),
        tables=(_estimates(every["least_squares"], alone, limits),),
    )


def _moves(optimal: Footing, tyre: Tyre) -> list[float]:
    """Change of Eq. 5 [%] on noise-free runs where one parameter is 5 % too large."""
    clean = []
    for profile in (0, 1):
        torque = profile_torque(profile)
        omega = simulate(Vehicle(), tyre, optimal, torque).omega[:, AXLE]
        clean.append(Drive(f"clean_{profile}", PERIOD, torque, omega))
    objective = Objective(Vehicle(), tyre, clean)
    found = []
    for i in range(5):
        moved = np.array(optimal)
        moved[i] *= 1.05
        found.append(objective.cost(moved))
    return found


def _combinations(limits: Limits) -> str:
    parts = [
        f"{c.parameters[0]} and {c.parameters[1]} correlate {c.correlation:+.3f}; fixed is the {c.quantity} = "
        f"{1e-3 * c.value:.2f} +- {1e-3 * c.sd:.2f} kPa at "
        + (f"z = {1e3 * c.at:.0f} mm" if c.parameters[0] == "k_s" else f"p = {1e-3 * c.at:.0f} kPa")
        for c in limits.combinations
    ]
    return "What the runs fix: " + "; ".join(parts) + "."


def _estimates(fit: Fit, alone: Fit, limits: Limits) -> Table:
    table = printed()["vella"]["table_1"]
    rows = []
    for i, (name, key) in enumerate(zip(table["names"], limits.intervals, strict=True)):
        interval = limits.intervals[key]
        least, most = (bounds[i] for bounds in bounds_of(_footing(numbers(table["nominal"]))))
        low, high = (min(max(end, least), most) * SCALES[i] for end in (interval.low, interval.high))
        cut = " (bound)" if interval.low < least or interval.high > most else ""
        rows.append(
            (
                name,
                table["nominal"][i],
                table["optimal"][i],
                f"{_shown(fit.footing)[i]:.4g}",
                f"{low:.4g} to {high:.4g}{cut}",
                "yes" if key in limits.fixed else "no",
                f"{_shown(alone.footing)[i]:.4g}",
            )
        )
    return Table(
        "Simulated runs with the printed optimum as truth; K_s in kN/m^2.71, c in Pa, phi in deg, K_t in m",
        (
            "",
            "nominal",
            "optimum printed",
            "all five fitted",
            "95 %, linearised",
            "fixed by runs",
            "K_s alone",
        ),
        tuple(rows),
    )


def _figure_3(test: Objective, nominal: Footing, optimal: Footing) -> Part:
    paper = printed()["vella"]
    drive = test.drives[0]
    runs = {
        "nominal": simulate(Vehicle(), Tyre(), nominal, drive.torque),
        "optimal": simulate(Vehicle(), Tyre(), optimal, drive.torque),
    }
    cost = {name: test.cost(np.array(soil)) for name, soil in (("nominal", nominal), ("optimal", optimal))}
    late = drive.omega[:, 0] > 2.0
    above = [float(np.mean((runs["nominal"].omega[:, axle] - drive.omega[:, 2 * axle])[late])) for axle in (0, 1)]
    missing = (*paper["errors"]["not_printed"], "the measured speeds as numbers")
    checks = (
        states(
            "nominal soil overestimates the wheel speeds",
            all(value > 0.0 for value in above),
            f"on average by {above[0]:.1f} rad/s (front) and {above[1]:.1f} rad/s (rear)",
            "validation run of ours, truth: the printed optimum",
            missing,
        ),
        states(
            "the optimum matches far better than the nominal values",
            cost["optimal"] < 0.5 * cost["nominal"],
            f"Eq. (5) on our validation run: {cost['nominal']:.0f} % nominal, {cost['optimal']:.1f} % optimum (sum of "
            f"four wheels; {cost['nominal'] / 4:.0f} and {cost['optimal'] / 4:.1f} % a wheel)",
            "true by construction here",
            ("the runs",),
        ),
        unchecked(
            f"RMSE of about {paper['errors']['validation_nominal']} % and {paper['errors']['validation_optimal']} %",
            "about 43, about 12",
            missing,
        ),
    )

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharey=True)
        for axis, wheel, axle, name in ((axes[0], 0, 0, "front left"), (axes[1], 2, 1, "rear left")):
            time = runs["nominal"].time
            axis.plot(time, drive.omega[:, wheel], color=GREY, lw=4, alpha=0.45, label="simulated measurement")
            axis.plot(time, runs["nominal"].omega[:, axle], color=AMBER, label="nominal soil")
            axis.plot(time, runs["optimal"].omega[:, axle], color=GREEN, label="optimum of Table 1")
            axis.set(title=name, xlabel="time, s")
        axes[0].set_ylabel("wheel speed, rad/s")
        twin = axes[1].twinx()
        twin.plot(runs["nominal"].time, drive.torque, color=BLUE, lw=0.6, alpha=0.5)
        twin.set_ylabel("assumed torque of a rear half shaft, N m", color=BLUE)
        twin.grid(visible=False)
        axes[0].legend()

    return Part(
        paper="vella",
        title="Fig. 3",
        about="Wheel speeds of a run that was not used for the estimate: measured, nominal soil, optimum.",
        checks=checks,
        figures=(Figure("vella_fig3", "Fig. 3 with a simulated measurement and an assumed torque", (9.5, 3.4), draw),),
    )
