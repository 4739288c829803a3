"""Li et al. 2024, forced slip: Fig. 6, Fig. 8, Fig. 9 and Table 4."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrapin_tools.papers import table4
from terrapin_tools.papers.figures import AMBER, BLUE, GREEN, GREY, RED
from terrapin_tools.papers.part import Figure, Part, Table
from terrapin_tools.papers.printed import half_unit, numbers, printed
from terrapin_tools.papers.verdict import digits, states, unchecked

__all__ = ["parts"]

STABLE = 0.05  # a curve is stable beyond a slip where it changes by less than this share from there to 0.9
HALF = 0.5


def parts() -> list[Part]:
    return [_figure_6(), _figure_8(), _figure_9(), _table_4()]


def _figure_6() -> Part:
    slip = np.arange(0.0, 0.9001, 0.1)
    setups = ((0.3, 150.0, GREY), (0.3, 300.0, BLUE), (0.15, 300.0, RED))
    by = {(r, w, linear): table4.theory(slip, r, w, linear) for r, w, _ in setups for linear in (False, True)}

    def depth(r: float, w: float, linear: bool) -> Any:
        return r * (1.0 - np.cos(by[r, w, linear].entry))

    moving = slip > 0.05
    more_load, less_than_twice, more_radius, less_sinkage = [], [], [], []
    for linear in (False, True):
        light, heavy, small = by[0.3, 150.0, linear], by[0.3, 300.0, linear], by[0.15, 300.0, linear]
        more_load += [
            bool((heavy.drawbar > light.drawbar)[moving].all()),
            bool((heavy.torque > light.torque).all()),
            bool((depth(0.3, 300.0, linear) > depth(0.3, 150.0, linear)).all()),
        ]
        ratio = float((heavy.drawbar / light.drawbar)[slip > 0.45].max())
        less_than_twice.append(abs(ratio - 2.0) > 0.02)
        more_radius += [
            bool((heavy.drawbar > small.drawbar)[moving].all()),
            bool((heavy.torque > small.torque)[moving].all()),
        ]
        less_sinkage.append(bool((depth(0.3, 300.0, linear) < depth(0.15, 300.0, linear)).all()))
    at_half, end = int(np.argmin(np.abs(slip - HALF))), len(slip) - 1
    gain = float(by[0.3, 300.0, False].drawbar[at_half] / by[0.3, 150.0, False].drawbar[at_half])
    change = {}
    for name, linear, field in (
        ("full, Theory 1", False, "drawbar"),
        ("linear, Theory 1", True, "drawbar"),
        ("full, Theory 2", False, "drawbar_2"),
        ("linear, Theory 2", True, "drawbar_2"),
    ):
        curve = getattr(by[0.3, 300.0, linear], field)
        change[name] = float(curve[end] / curve[at_half] - 1.0)
    checks = (
        states(
            "increasing the load increases traction, torque and sinkage",
            all(more_load),
            "at every slip above 0.05, both stress forms",
        ),
        states(
            "these increases are not linear",
            all(less_than_twice),
            f"twice the load gives {gain:.3f} times the traction at s = 0.5 (full stress)",
        ),
        states("increasing the radius increases traction and torque", all(more_radius), "at 300 N, both stress forms"),
        states("increasing the radius decreases sinkage", all(less_sinkage), "at 300 N, both stress forms"),
        states(
            "traction and torque stabilise after s = 0.5",
            any(abs(value) < STABLE for value in change.values()),
            "; ".join(f"{name}: {100 * value:+.0f} %" for name, value in change.items()) + " from s = 0.5 to 0.9",
            f"stable would be less than {100 * STABLE:g} % in any reading; Theory 2 falls by its own R_f",
        ),
    )

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 3)
        for r, w, color in setups:
            for linear, style in ((False, "-"), (True, "--")):
                t = by[r, w, linear]
                label = f"R = {r:g} m, {w:g} N" if not linear else None
                axes[0].plot(slip, t.drawbar, style, color=color, label=label)
                axes[1].plot(slip, t.torque, style, color=color)
                axes[2].plot(slip, 1e3 * depth(r, w, linear), style, color=color)
        for axis, label in zip(axes, ("traction DP, N", "torque T, N m", "sinkage, mm"), strict=True):
            axis.set(xlabel="slip s", ylabel=label)
        axes[0].legend()

    return Part(
        paper="li",
        title="Fig. 6",
        about="Traction, torque and sinkage of a shell against slip, for two radii and two loads.",
        checks=checks,
        text=(
            "The curves are printed as a picture only, so the sentences about them are what can be checked. "
            "Lines: Theory 1 with the full stresses of Eq. (3); dashed: with the linear stresses of Eq. (7).",
        ),
        figures=(Figure("li_fig6", "Fig. 6 regenerated", (9.5, 3.0), draw),),
    )


def _figure_8() -> Part:
    table = table4.measured()
    slip = np.linspace(0.25, 0.72, 48)
    r = table.radius * (1.0 - slip)
    model = {linear: table4.theory(slip, table.radius, table.load, linear) for linear in (False, True)}
    at = table4.theory(table.actual, table.radius, table.load)
    f2 = at.torque / table.disc / table4.GRAVITY
    f1 = f2 - at.drawbar / table4.GRAVITY
    paper = printed()["li"]["table_4"]
    why = "model: full stress, Theory 1, slip 1 - r/R; the same misfit as Table 4's"
    checks = (
        unchecked(
            "tensions over time",
            "a picture",
            ("the curves as numbers", "stiffness of ropes and frame", "how deep the shell rests at the start"),
        ),
        digits("F2 at rest, kg", paper["f2_kg"], f2.tolist(), why, shown=".2f"),
        digits("F1 at rest, kg", paper["f1_kg"], f1.tolist(), why, shown=".2f"),
    )

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2)
        for axis, name, data in ((axes[0], "F1", table.f1), (axes[1], "F2", table.f2)):
            for linear, style in ((False, "-"), (True, "--")):
                t = model[linear]
                pull = t.torque / r / table4.GRAVITY
                level = pull if name == "F2" else pull - t.drawbar / table4.GRAVITY
                axis.plot(slip, level, style, color=BLUE, label=f"{'linear' if linear else 'full'} stress, Theory 1")
            axis.plot(table.actual, data, "o", color=RED, label="measured, Table 4")
            axis.set(xlabel="slip 1 - r/R", ylabel=f"{name} at rest, kg")
        axes[0].legend()

    return Part(
        paper="li",
        title="Fig. 8",
        about="Tensions of the two ropes over time; here the levels at which they settle.",
        checks=checks,
        text=(
            "The measured curves are printed as a picture without numbers. What the model can be held against are the "
            "levels: F2 = T/r, F1 = F2 - DP.",
        ),
        figures=(Figure("li_fig8", "Tensions at rest against slip", (9.0, 3.0), draw),),
    )


def _figure_9() -> Part:
    table = table4.measured()
    claims = printed()["li"]["errors"]
    slip = np.linspace(0.0, 0.9, 91)
    curves = {
        (linear, clip): table4.theory(slip, table.radius, table.load, linear, clip)
        for linear in (False, True)
        for clip in (False, True)
    }
    nearest = min(
        table4.readings(),
        key=lambda r: sum(
            abs(a - float(b))
            for a, b in zip((*r.drawbar, *r.torque), (*claims["drawbar"], *claims["torque"]), strict=True)
        ),
    )
    signed = [
        float(np.mean(getattr(table4.theory(table.actual, table.radius, table.load, linear), field) / data - 1.0))
        for linear in (False, True)
        for field, data in (("drawbar", table.drawbar), ("torque", table.torque))
    ]
    peaks = [float(slip[int(np.argmax(curves[linear, False].drawbar_2))]) for linear in (False, True)]
    torque_peaks = [float(slip[int(np.argmax(curves[linear, False].torque_2))]) for linear in (False, True)]
    found = (*nearest.drawbar, *nearest.torque)
    checks = (
        digits(
            "errors of Theory 1 and 2 in %: DP, DP', T, T'",
            (*claims["drawbar"], *claims["torque"]),
            found,
            f"nearest of 8 readings: {nearest.stress}, slip {nearest.slip}, R_f {nearest.extra}",
            shown=".1f",
        ),
        states(
            "without the resistances theory lies above the measurements",
            all(value > 0.0 for value in signed),
            f"mean signed error of Theory 1: DP {100 * signed[0]:+.0f} % and T {100 * signed[1]:+.0f} % (full), "
            f"DP {100 * signed[2]:+.0f} % and T {100 * signed[3]:+.0f} % (linear)",
            "torque is below the measured one in every reading",
        ),
        states(
            "traction and torque peak around s = 0.5 (Theory 2)",
            all(0.45 <= peak <= 0.58 for peak in (*peaks, *torque_peaks)),
            f"DP' peaks at s = {peaks[0]:.2f} (full) and {peaks[1]:.2f} (linear), T' at {torque_peaks[0]:.2f} and "
            f"{torque_peaks[1]:.2f}",
            "the peak is made by R_f, whose xi_2 = 0.45 was fitted to these data: circular",
        ),
    )

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2)
        for axis, one, two, data, label in (
            (axes[0], "drawbar", "drawbar_2", table.drawbar, "traction DP, N"),
            (axes[1], "torque", "torque_2", table.torque, "torque T, N m"),
        ):
            for linear, color, name in ((False, BLUE, "full"), (True, GREEN, "linear")):
                axis.plot(slip, getattr(curves[linear, False], one), color=color, label=f"Theory 1, {name}")
                part = slip >= 0.25  # R_f as printed is a fit on 0.3 to 0.7; below, it grows again
                axis.plot(
                    slip[part], getattr(curves[linear, False], two)[part], "--", color=color, label=f"Theory 2, {name}"
                )
                axis.plot(slip, getattr(curves[linear, True], two), ":", color=color, label="the same, R_f clipped")
            axis.plot(table.actual, data, "o", color=RED, label="measured, at 1 - r/R", zorder=5)
            axis.plot(table.nominal, data, "o", mfc="none", color=RED, label="measured, at nominal s", zorder=5)
            axis.set(xlabel="slip s", ylabel=label, ylim=(0.0, None))
        axes[0].legend(ncols=2, fontsize=7)

    return Part(
        paper="li",
        title="Fig. 9",
        about="Traction and torque against slip at R = 0.22 m and 150 N: theory beside the forced-slip measurements.",
        checks=checks,
        figures=(Figure("li_fig9", "Fig. 9 regenerated with the printed parameters", (9.5, 3.8), draw),),
    )


def _table_4() -> Part:
    table = table4.measured()
    paper = printed()["li"]
    rows = paper["table_4"]
    gravity = table4.GRAVITY
    pull = gravity * (table.f2 - table.f1)
    torque = gravity * table.f2 * table.disc
    room_pull = [gravity * (half_unit(a) + half_unit(b)) for a, b in zip(rows["f1_kg"], rows["f2_kg"], strict=True)]
    room_torque = [
        gravity * (half_unit(b) * r + half_unit(d) * f)
        for b, d, r, f in zip(rows["f2_kg"], rows["disc_radius_m"], table.disc, table.f2, strict=True)
    ]
    rest = table.torque / table.radius - table.drawbar
    models = {linear: table4.theory(table.actual, table.radius, table.load, linear) for linear in (False, True)}
    left = {
        linear: (t.torque / table.radius - t.drawbar, t.torque_2 / table.radius - t.drawbar_2)
        for linear, t in models.items()
    }
    moved = max(float(np.max(np.abs(one - two))) for one, two in left.values())
    moved_by = "less than 1e-9" if moved < 1e-9 else f"{moved:.1g}"
    short = [float(np.mean(rest / one)) for one, _ in left.values()]
    needed = np.degrees(table4.needed_friction())
    friction = float(paper["table_1"]["friction_deg"])
    wide, wider = table4.ceiling(np.radians(22.0)), table4.ceiling(np.radians(45.0))
    shear = table.torque / table.radius
    fall_pull, fall_torque = (float(-np.diff(numbers(paper["errors"][k]))[0]) for k in ("drawbar", "torque"))
    reach = _reachable(numbers(paper["errors"]["drawbar"]), table)
    swapped = _reachable(numbers(paper["errors"]["torque"]), table)
    radius_nominal, rms_nominal, with_radius = table4.best_radius(table.nominal)
    radius_actual, rms_actual, _ = table4.best_radius(table.actual)
    checks = (
        digits("DP = (F2 - F1) g", rows["drawbar_n"], pull.tolist(), f"g = {gravity} m/s^2", extra=room_pull),
        digits("T = F2 r g", rows["torque_nm"], torque.tolist(), f"g = {gravity} m/s^2", extra=room_torque),
        digits(
            "slip s = 1 - r/R (Eq. 12)",
            rows["slip"],
            table.actual.tolist(),
            f"at one digit; unrounded they differ by up to {float(np.max(np.abs(table.actual - table.nominal))):.3f} "
            "(row 0.7 would need r = 66 mm), so both are tried below",
            shown=".4f",
        ),
        states(
            "Theory 2 explains traction and torque (printed radius, soil and load)",
            max(float(np.max(np.abs(rest / one - 1.0))) for one, _ in left.values()) < 0.1,
            f"T/R - DP: measured {', '.join(f'{v:.1f}' for v in rest)} N; model "
            f"{', '.join(f'{v:.1f}' for v in left[False][0])} N (full), "
            f"{', '.join(f'{v:.1f}' for v in left[True][0])} N (linear)",
            f"R_c and R_f cancel in T/R - DP (they change it by {moved_by} N), and it misses by a factor of "
            f"{short[0]:.2f} (full) and {short[1]:.2f} (linear)",
        ),
        states(
            f"the friction angle of Table 1 ({friction:g} deg) can carry the measured torque",
            bool((shear <= wide).all()),
            f"least angle that carries each row: {', '.join(f'{v:.1f}' for v in needed)} deg",
            "Coulomb ceiling: the greatest T/R of any stresses with tau <= sigma tan(phi), given W and DP, is "
            f"{', '.join(f'{v:.1f}' for v in wide)} N for entry angles up to 22 deg and "
            f"{', '.join(f'{v:.1f}' for v in wider)} N up to 45 deg; measured "
            f"{', '.join(f'{v:.1f}' for v in shear)} N: no stiffness, n, j0, c1 or c2 can change that",
        ),
        states(
            "errors fall from 9.6 to 0.5 % in DP and from 15.7 to 3.3 % in T by Eq. (10)",
            fall_torque <= reach,
            f"T's error can fall by at most {reach:.1f} points, {fall_torque:.1f} are claimed",
            "for any resistances X >= 0 with DP' = DP - X and T' = T - R X: mean(X/DP) <= 9.6 + 0.5, and R DP/T <= "
            f"{float(np.max(table.radius * table.drawbar / table.torque)):.3f} in every row. With the two pairs "
            f"exchanged the bound is {swapped:.1f} points for {fall_pull:.1f} claimed: perhaps they were (inference)",
        ),
    )

    def draw(figure: Any) -> None:
        left_axis, right_axis = figure.subplots(1, 2)
        left_axis.bar(np.arange(5) - 0.2, shear, 0.38, color=RED, label="measured T/R")
        left_axis.bar(np.arange(5) + 0.2, models[False].torque / table.radius, 0.38, color=BLUE, label="Theory 1, full")
        left_axis.plot(np.arange(5), wide, "_", color="black", ms=26, mew=1.6, label="Coulomb ceiling, 22 deg")
        left_axis.plot(np.arange(5), wider, "_", color=AMBER, ms=26, mew=1.6, label="Coulomb ceiling, 45 deg")
        left_axis.set_xticks(np.arange(5), rows["slip"])
        left_axis.set(xlabel="row (nominal slip)", ylabel="T/R, N", ylim=(0.0, 175.0))
        left_axis.legend(ncols=2, loc="upper left", fontsize=7)
        fit = with_radius
        right_axis.plot(table.nominal, table.drawbar, "o", color=RED, label="DP measured, N")
        right_axis.plot(table.nominal, fit.drawbar_2, "--", color=BLUE, label="Theory 2, N")
        right_axis.plot(table.nominal, table.torque, "s", color=RED, label="T measured, N m")
        right_axis.plot(table.nominal, fit.torque_2, "--", color=GREEN, label="Theory 2, N m")
        right_axis.set(title=f"diagnosis only: R = {radius_nominal:.3f} m", xlabel="nominal slip")
        right_axis.legend(loc="center right", fontsize=7)

    return Part(
        paper="li",
        title="Table 4",
        about="Forces of the forced-slip experiment, and both theories' errors for every reading of the print.",
        checks=checks,
        text=(
            "Diagnosis only. With the radius as the one free number (full stress, nominal slip, R_f as printed, soil "
            f"and load of Table 1) the table is met at R = {radius_nominal:.3f} m with an rms of {rms_nominal:.2f} % "
            f"(with slip 1 - r/R: {radius_actual:.3f} m, {rms_actual:.2f} %). The stated radius is 0.220 m, and five "
            "slips cannot tell this from other changes; it is no claim about the experiment.",
        ),
        figures=(Figure("li_table4", "What no reading can change, and the radius that would fit", (9.5, 3.4), draw),),
        tables=(_errors(), _rows()),
    )


def _reachable(pair: list[float], table: table4.Measured) -> float:
    """Most points by which T's mean error can fall when DP's goes from the first to the second of `pair` [%]."""
    return float((pair[0] + pair[1]) * np.max(table.radius * table.drawbar / table.torque))


def _errors() -> Table:
    claims = printed()["li"]["errors"]
    rows = [("printed", "", "", *claims["drawbar"], *claims["torque"])]
    rows += [(r.stress, r.slip, r.extra, *(f"{v:.1f}" for v in (*r.drawbar, *r.torque))) for r in table4.readings()]
    return Table(
        "Mean absolute error in %, R = 0.22 m, 150 N, soil of Table 1",
        ("stress", "slip", "R_f", "DP, Th. 1", "DP, Th. 2", "T, Th. 1", "T, Th. 2"),
        tuple(rows),
    )


def _rows() -> Table:
    table = table4.measured()
    t = table4.theory(table.actual, table.radius, table.load)
    linear = table4.theory(table.actual, table.radius, table.load, linear=True)
    head = ("row", "1 - r/R", "DP", "Th. 1", "Th. 2", "Th. 2 lin.", "T", "Th. 1", "Th. 2", "Th. 2 lin.", "R_c", "R_f")
    rows = tuple(
        (
            f"{table.nominal[i]:g}",
            f"{table.actual[i]:.4f}",
            *(f"{v[i]:.2f}" for v in (table.drawbar, t.drawbar, t.drawbar_2, linear.drawbar_2)),
            *(f"{v[i]:.2f}" for v in (table.torque, t.torque, t.torque_2, linear.torque_2)),
            f"{t.bulldozing[i]:.2f}",
            f"{t.extra[i]:.2f}",
        )
        for i in range(5)
    )
    return Table("Measured beside full (Eq. 3) and linear (Eq. 7) stresses, R_f as printed; N and N m", head, rows)
