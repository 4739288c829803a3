"""The L9 experiment of Li et al. 2024 in the simulator: nine runs of the sphere under the controller (scenario l9).

From rest over a board, then on sand until the robot stands; measured is the way on the sand. The paper's factors are
the pendulum's mass (8.3, 8.0 and 7.7 kg of the whole robot), the joint's acceleration and its greatest speed, which
the controller has as speed_ramp and setpoint. A run that the guard of the swing ends has no way of its own: it is
marked, and left out of F and ranks. The text states them in turns, the table in radians; turns are taken. What the
paper does not print, and the ways depend on: the motor's greatest torque and the run-up on the board. A ramp that the
motor cannot follow has hardly an effect; `ramp` takes a share of the paper's accelerations.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.experiments.l9 import LI_2024, Analysis, Design, FactorAnalysis, analyse

__all__ = ["ROBOT", "Nine", "Rolled", "as_json", "describe", "nine", "roll"]

ROBOT = "sphere"
PRINTED_MASS = 4.29 + 2.0 + 1.5  # kg, with the bob of Table 1
TURN = 2.0 * math.pi
STOPPED = 3e-3  # m/s


@dataclass(frozen=True)
class Rolled:
    """One run: way on the sand [m], speed at its edge [m/s], greatest swing [rad], and what ended it."""

    way: float
    entered: float
    swing: float
    ended: str  # "stood", "guard", or "rolls on"


@dataclass(frozen=True)
class Nine:
    """The nine runs at one setting, and the analysis of those that came to a stop by themselves."""

    torque: float  # [N m]
    run_up: float  # [m]
    ramp: float  # share of the paper's accelerations
    runs: tuple[Rolled, ...]
    analysis: Analysis


def roll(mass: float, acceleration: float, speed: float, torque: float, run_up: float) -> Rolled:
    """One run at a mass [kg] of the whole robot, which differs by its bob. UserError as a scenario's.

    `acceleration` [turns/s^2] and `speed` [turns/s] are the joint's, `torque` [N m] is the motor's
    greatest at the joint, its friction taken off, `run_up` the way on the board [m].
    """
    file = find_scenario("l9")
    robot = load_scenario(file).robot
    gear = robot.radius / robot.drive_radius
    values = {
        "robot.body_mass": robot.body_mass + mass - PRINTED_MASS,
        "firmware.speed_ramp": TURN * acceleration,
        "firmware.current_limit": (torque + robot.coulomb) / (gear * robot.torque_constant * robot.gear_efficiency),
        "start_position": -run_up,
        "operator.1.setpoint": TURN * speed * robot.radius,
    }
    result = run(load_scenario(file, values))
    truth = result.truth
    on_sand = np.flatnonzero(truth["position"] > 0.0)
    if not on_sand.size:
        return Rolled(0.0, 0.0, float(np.abs(truth["swing_angle"]).max()), "stood")
    begin = int(on_sand[0])
    slow = np.flatnonzero(truth["speed"][begin:] < STOPPED)
    end = begin + int(slow[0]) if slow.size else len(truth["speed"]) - 1
    off = result.held("ACTUATE", "enable")[end] == 0
    return Rolled(
        way=float(truth["position"][end]),
        entered=float(truth["speed"][begin]),
        swing=float(np.abs(truth["swing_angle"][: end + 1]).max()),
        ended="rolls on" if not slow.size else "guard" if off else "stood",
    )


def nine(torque: float, run_up: float, ramp: float = 1.0) -> Nine:
    """The nine runs of the paper's Table 2. UserError as a scenario's, ValueError where their ways are no response."""
    runs = [roll(mass, ramp * acceleration, speed, torque, run_up) for mass, acceleration, speed in LI_2024.settings]
    return Nine(torque, run_up, ramp, tuple(runs), analyse(_design(runs)))


def _design(runs: list[Rolled]) -> Design:
    return replace(
        LI_2024,
        response=tuple(rolled.way for rolled in runs),
        response_name="simulated way on sand [m]",
        left_out=tuple(run for run, rolled in enumerate(runs) if rolled.ended == "guard"),
    )


def as_json(found: list[Nine]) -> dict[str, Any]:
    return {"schema": "terrapin.l9_runs/1", "settings": [asdict(each) for each in found]}


def describe(found: list[Nine]) -> str:
    """The nine ways beside the paper's, effects of the factors and their order at each setting."""
    paper = analyse(LI_2024)
    lines = [
        "Way on the sand [m], nine runs; g: the guard of the swing stopped it, and it is left out below;",
        "x: share of the paper's ramps",
    ]
    heads = [f"{n.torque:g} N m {n.run_up:g} m" + (f" x{n.ramp:g}" if n.ramp != 1.0 else "") for n in found]
    lines.append(f"  {'mass, ramp, speed':<22}{'paper':>8}{''.join(head.rjust(20) for head in heads)}")
    for i, setting in enumerate(LI_2024.settings):
        cells = "".join(f"{n.runs[i].way:18.3f}{' g' if n.runs[i].ended == 'guard' else '  '}" for n in found)
        lines.append(f"  {', '.join(f'{value:g}' for value in setting):<22}{LI_2024.response[i]:8.3f}{cells}")
    lines += ["", "From the first level to the last [m] (mass falls; ramp and speed rise), range of the means R, F"]
    lines.append(f"  {'':<32}{''.join(head.rjust(24) for head in ('paper', *heads))}")
    for column, name in enumerate(LI_2024.factors):
        said = []
        for analysis in (paper, *(n.analysis for n in found)):
            f = analysis.factors[column]
            said.append(_effect(f).rjust(24))
        lines.append(f"  {name.split(' [')[0]:<32}{''.join(said)}")
    lines.append("")
    for label, analysis in zip(("paper", *heads), (paper, *(n.analysis for n in found)), strict=True):
        names = [name.split(" [")[0] for name in analysis.order]
        open_ = [f.name.split(" [")[0] for f in analysis.factors if f.name not in analysis.order]
        told = "; ".join(
            part for part in (", ".join(names), f"not determined: {', '.join(open_)}" if open_ else "") if part
        )
        lines.append(f"  strongest first, {label}: {told}")
    return "\n".join(lines)


def _effect(factor: FactorAnalysis) -> str:
    if math.isnan(factor.range_of_means):
        return "not determined"
    ratio = "-" if math.isnan(factor.f_ratio) else f"{factor.f_ratio:.0f}"
    return f"{factor.means[-1] - factor.means[0]:+.2f} R {factor.range_of_means:.2f} F {ratio}"
