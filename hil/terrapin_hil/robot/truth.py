"""The names of the simulated robot's true state, in the order of its records."""

from __future__ import annotations

from terrapin_hil.library import ffi

__all__ = ["TRUTH", "UNITS"]

UNITS = {"time": "s", "position": "m", "speed": "m/s", "omega": "rad/s", "alpha_rate": "rad/s", "swing_angle": "rad",
         "swing_rate": "rad/s", "slip": "1", "contact_torque": "N m", "resistance": "N m", "traction": "N",
         "motor_torque": "N m", "internal_friction": "N m", "current": "A", "voltage": "V", "supply": "V",
         "winding_temperature": "degC", "slope": "rad", "load": "N", "rut": "1", "carriage_force": "N", "segment": "1",
         "sinkage": "m", "dug": "m", "heading": "rad", "path_x": "m", "path_y": "m"}  # fmt: skip


def _truth_names() -> tuple[str, ...]:
    elements: dict[int, str] = ffi().typeof("enum hil_truth").elements
    return tuple(elements[i].removeprefix("HIL_TRUTH_").lower() for i in range(len(elements) - 1))


TRUTH = _truth_names()
