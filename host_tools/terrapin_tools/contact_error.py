"""How far the controller's C_t is from the simulated robot's: the number that a compensation is to bring down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terrapin_hil.run.run import Result
from terrapin_hil.telemetry import si_factor

__all__ = ["ContactError", "contact_error"]

SETTLED = 1.0  # s after the start until which no unsteady window counts
TICKS = 1000  # a second


@dataclass(frozen=True)
class ContactError:
    """Rms error of C_t [N m] over `windows` windows; `valid`: those that the controller declared valid, else all."""

    rms: float
    windows: int
    valid: bool


def contact_error(result: Result) -> ContactError | None:
    """C_t against the mean of the true contact torque over the same window; None when the robot never ran for one.

    Where no window is valid (an imbalance keeps the robot from being steady) all those of a running robot count, but
    for the first second.
    """
    tables, interface = result.telemetry, result.interface
    ground, status = tables["GROUND"], tables["STATUS"]
    window = interface.parameters["window"]
    value = result.parameters.get("window", result.scenario.firmware.get("window", window.default * window.scale))
    length = max(1, round(value * si_factor(window.unit) * TICKS))
    ends = np.round(ground["time"] * TICKS).astype(np.int64)
    state = status["state"][np.clip(np.searchsorted(status["time"], ground["time"], side="right") - 1, 0, None)]
    use = (ends >= length) & (ends < len(result.records)) & (state == interface.enums["state"]["run"])
    valid = use & (ground["valid"] > 0)
    steady = bool(valid.any())
    if not steady:
        valid = use & (ground["time"] > result.scenario.operator[0].time + SETTLED + length / TICKS)
    if not valid.any():
        return None
    sums = np.concatenate(([0.0], np.cumsum(result.truth["contact_torque"])))
    at = ends[valid] + 1
    truth = (sums[at] - sums[at - length]) / length
    error = ground["torque"][valid] - truth
    return ContactError(float(np.sqrt(np.mean(error * error))), int(valid.sum()), steady)
