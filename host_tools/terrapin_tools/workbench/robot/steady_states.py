"""A sphere's steady states in its logged windows: one row for each, with slip, load on the ground, and pull.

A level sensor's zero errs by more than its noise over a window, and by as much in every window of a run. Windows that
follow one another at one speed on one slope are therefore one row, the mean of all, and the sd of its pull is that of
the zero. Bias and noise of a row are then one thing, independent from row to row.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_tools.errors import UserError

__all__ = ["PITCH_ERROR", "on_soft_ground"]

PITCH_ERROR = 0.5e-3  # rad, sd of a pitch sensor's zero: an ordinary one, levelled before the run
SAME_SLOPE = 1e-3  # rad between neighbouring windows: some four sd of an ordinary sensor's mean
SAME_SPEED = 0.02  # share of the speed, likewise
FEWEST = 4  # windows of a state: fewer do not say how much they scatter
NO_CAUSE = ("time", "angle", "acceleration", "speed")  # means over turns of the shell; slip and omega have the speed


def on_soft_ground(
    columns: Mapping[str, Array], radius: float, span: float, pitch_error: float
) -> tuple[dict[str, Array], dict[str, float]]:
    """Rows of steady states, and the sd of a row of current [A] and traction [N].

    `columns` (SI): means over the windows of `span` [s], their load that of the robot on level ground. UserError when
    they lack speed or slope, or hold no steady state.
    """
    for name, message in (("speed", "MOTION"), ("slope", "ATTITUDE.pitch")):
        if name not in columns:
            raise UserError(f"found no {message}, expected it: a sphere's contact depends on its {name}")
    states = [state for state in _states(columns, span) if len(state) >= FEWEST]
    if not states:
        raise UserError(f"found no {FEWEST} steady windows that follow one another at one speed on one slope")
    found = {name: np.array([values[state].mean() for state in states]) for name, values in columns.items()}
    slope, weight = found["slope"], found["load"]
    found["slip"] = 1.0 - found["speed"] / (radius * found["omega"])
    found["load"] = weight * np.cos(slope)
    found["traction"] = weight * np.sin(slope) * np.sign(found["omega"])
    zero = float(weight.mean()) * pitch_error
    pull = float(weight.mean()) * _sd_of_mean(columns["slope"], states)
    found = {name: values for name, values in found.items() if name not in NO_CAUSE}
    return found, {"current": _sd_of_mean(columns["current"], states), "traction": float(np.hypot(pull, zero))}


def _states(columns: Mapping[str, Array], span: float) -> list[Index]:
    """Indices of windows that follow one another and agree."""
    end, omega, slope = (columns[name] for name in ("time", "omega", "slope"))
    apart = np.diff(end) > 1.5 * span
    apart |= np.abs(np.diff(omega)) > SAME_SPEED * np.abs(omega[1:])
    apart |= np.abs(np.diff(slope)) > SAME_SLOPE
    return np.split(np.arange(len(end)), np.flatnonzero(apart) + 1)


def _sd_of_mean(values: Array, states: list[Index]) -> float:
    """Of a state's mean, by the differences of its neighbours, which a slow drift does not enlarge."""
    squares = [np.diff(values[state]) ** 2 for state in states]
    windows = float(np.mean([len(state) for state in states]))
    return float(np.sqrt(0.5 * np.concatenate(squares).mean() / windows))
