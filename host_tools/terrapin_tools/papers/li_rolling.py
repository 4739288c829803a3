"""Li et al. 2024, rolling: Fig. 4 (driving torque on board and sand), Tables 2 and 3 (orthogonal array)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.pendulum import PendulumSphere, Rolling, on_sand, ramp, roll, steady_swing
from terrapin_hil.physics.tyre import ContactError
from terrapin_tools.experiments.l9 import LI_2024, analyse
from terrapin_tools.papers import table4
from terrapin_tools.papers.figures import BLUE, GREEN, GREY, RED
from terrapin_tools.papers.part import Figure, Part, Table
from terrapin_tools.papers.printed import printed
from terrapin_tools.papers.verdict import digits, near, states, unchecked

__all__ = ["parts"]

ACCELERATION, SPEED = 0.5, 1.25  # of the joint in test 9 [rad/s^2, rad/s]: Table 2's units; the text says rot
SYMMETRIC = 0.1  # of the amplitude: the mean of a curve that counts as symmetric about 0
LATE = 6.0  # s, from when on the joint's rate is steady and the start has died away
ROBOT_LOAD = 75.5  # N, 7.7 kg


def parts() -> list[Part]:
    return [_figure_4(), _table_2(), _table_3()]


def _steady(run: Rolling) -> tuple[Array, Array]:
    late = run.time >= LATE
    return run.time[late], run.torque[late]


def _sine(time: Array, values: Array) -> float:
    """R^2 of the best sinusoid about a constant."""
    best = 0.0
    for omega in np.linspace(2.0, 14.0, 601):
        columns = np.stack([np.ones_like(time), np.cos(omega * time), np.sin(omega * time)], axis=1)
        rest = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        best = max(best, 1.0 - float(rest @ rest) / float(((values - values.mean()) ** 2).sum()))
    return best


def _figure_4() -> Part:
    paper = printed()["li"]["figure_4"]
    time = np.arange(0.0, 14.0, 0.01)
    drive = ramp(time, ACCELERATION, SPEED)
    both, printed_form = PendulumSphere(), replace(PendulumSphere(), shell_share=0.0)
    board = {"with the viscous term on the shell": roll(both, *drive), "as printed": roll(printed_form, *drive)}
    slip, torque = table4.self_propelled(ROBOT_LOAD)
    torque_linear = table4.self_propelled(ROBOT_LOAD, True)[1]
    offset = 1e-3 * float(paper["offset_sand"])
    sand = {
        "resistance 0.7 N m, as the print suggests": roll(on_sand(both, offset, slip), *drive),
        "resistance of the contact model": roll(on_sand(both, torque, slip), *drive),
    }
    means, symmetric, fits = {}, [], []
    for name, run in board.items():
        t, values = _steady(run)
        amplitude = 0.5 * float(np.ptp(values))
        means[name] = (float(values.mean()), amplitude)
        symmetric.append(abs(float(values.mean())) <= SYMMETRIC * amplitude)
        fits.append(_sine(t, values))
    turning = [_turns(sphere) for sphere in (both, printed_form)]
    limit = both.largest_torque
    checks = (
        states(
            "at constant joint speed the torque over time is a sinusoid (board)",
            [fit >= 0.9 for fit in fits],
            f"R^2 of the best sinusoid: {', '.join(f'{fit:.3f}' for fit in fits)}",
            "with the viscous term in both lines of Eq. (11), and as printed",
        ),
        states(
            "on the board it is symmetric about y = 0",
            symmetric,
            "; ".join(f"{name}: mean {mean:+.3f}, amplitude {half:.2f} N m" for name, (mean, half) in means.items()),
            "only without the viscous term on the shell, and then the bob hangs back by "
            f"{-np.degrees(steady_swing(printed_form, SPEED)):.0f} degrees while rolling steadily",
        ),
        states(
            "speeds are in rot/s (text of Sec. 3.1; the table says rad)",
            turning,
            f"at {SPEED:g} rot/s as printed the steady bob would need a sine of its angle beyond 1; with the viscous "
            f"term in both lines it rolls, but friction alone takes {both.viscous * SPEED * 2 * np.pi:.1f} N m, "
            f"against {both.viscous * SPEED:.2f} N m at {SPEED:g} rad/s",
            "here the speeds are taken as rad/s",
        ),
        near(
            "on sand it is symmetric about y = 700",
            f"{offset:g}",
            torque,
            0.1,
            "N m",
            f"torque of a shell of Table 1 at {ROBOT_LOAD:g} N that pulls nothing (slip {slip:.3f}); "
            f"{torque_linear:.3f} N m with linear stresses",
            ("the unit of the axis (taken as mN m)",),
        ),
        states(
            "the robot rolls on the sand of Table 1",
            min(torque, torque_linear) < limit,
            f"the sand asks for {torque:.3f} N m (full) or {torque_linear:.3f} N m (linear), the bob at 90 degrees "
            f"holds m3 g l = {limit:.3f} N m",
            "Table 1's soil was not checked against Sec. 3.1",
        ),
        unchecked("R^2 between calculation and measurement", paper["r_squared"], ("the measured curves",)),
    )

    def draw(figure: Any) -> None:
        left, right = figure.subplots(1, 2)
        for (name, run), color in zip(board.items(), (BLUE, GREY), strict=True):
            left.plot(run.time, run.torque, color=color, label=name)
        left.axhline(0.0, color=RED, lw=0.8, label="printed: symmetric about 0")
        left.set_title("(a) board")
        for (name, run), color in zip(sand.items(), (BLUE, GREEN), strict=True):
            shown = np.abs(run.swing) < np.pi  # a bob that goes over the top ends the comparison
            end = len(shown) if shown.all() else int(np.argmin(shown))
            right.plot(run.time[:end], run.torque[:end], color=color, label=name)
        right.axhline(offset, color=RED, lw=0.8, label="printed: symmetric about 700")
        right.set_title("(b) sand")
        for axis in (left, right):
            axis.set(xlabel="time, s", ylabel="driving torque, N m", ylim=(-0.5, 3.6))
            axis.legend(fontsize=7, loc="upper right")

    return Part(
        paper="li",
        title="Fig. 4",
        about="Driving torque over time in test 9 of Table 2: on the hardwood board and in the sand tank.",
        checks=checks,
        text=(
            "The joint gains speed at 0.5 rad/s^2 up to 1.25 rad/s. Eq. (11) as printed lacks the viscous term in its "
            "first line (Lagrange with Rayleigh's dissipation gives it in both). With the torque that Table 1's soil "
            "asks for the bob cannot hold the shell and goes over the top: that curve ends there.",
        ),
        figures=(Figure("li_fig4", "Fig. 4 regenerated, joint speeds read as rad/s", (9.5, 3.2), draw),),
    )


def _turns(sphere: PendulumSphere) -> bool:
    """Whether steady rolling at SPEED turns a second is possible."""
    try:
        steady_swing(sphere, SPEED * 2.0 * np.pi)
    except ContactError:
        return False
    return True


def _table_2() -> Part:
    table = printed()["li"]["table_2"]
    analysis = analyse(LI_2024)
    names = ("mass", "joint acceleration", "joint speed")
    checks = [
        digits(f"{key.upper()} of mass, acceleration, speed", table[key], [f.sums[i] for f in analysis.factors])
        for i, key in enumerate(("k1", "k2", "k3"))
    ]
    checks.append(
        digits("R, the range", table["range"], [f.range_of_means for f in analysis.factors], "of the means K/3")
    )
    speed = analysis.factors[2]
    checks.append(
        states(
            "the best combination has a joint speed of 1.25",
            speed.p_value < 0.05,
            f"the speed's effect: F = {speed.f_ratio:.3f} against {analysis.critical_f:.1f}, p = {speed.p_value:.2f}",
            "no level of a factor without a shown effect can be called the best",
        )
    )
    rows = tuple(
        (name, *(f"{total:.3f}" for total in factor.sums), f"{factor.range_of_means:.3f}")
        for name, factor in zip(names, analysis.factors, strict=True)
    )
    return Part(
        paper="li",
        title="Table 2",
        about="Rolling distance in nine runs of an orthogonal array: sums at each level and their range.",
        checks=tuple(checks),
        tables=(Table("Recomputed from the nine distances", ("factor", "K1", "K2", "K3", "R"), rows),),
    )


def _table_3() -> Part:
    table = printed()["li"]["table_3"]
    analysis = analyse(LI_2024)
    checks = (
        digits("sums of squares", table["squares"], [f.sum_of_squares for f in analysis.factors], shown=".4f"),
        digits("error", [table["error_squares"]], [analysis.error_squares], shown=".5f"),
        digits("F", table["f"], [f.f_ratio for f in analysis.factors], "from unrounded sums of squares", shown=".3f"),
        digits("p", table["p"], [f.p_value for f in analysis.factors], shown=".5f"),
    )
    return Part(
        paper="li",
        title="Table 3",
        about="Analysis of variance of the nine distances.",
        checks=checks,
        text=(
            f"The column headed F0.05 holds F itself; the critical value is {analysis.critical_f:.1f}.",
            *analysis.conclusions[-2:],
        ),
    )
