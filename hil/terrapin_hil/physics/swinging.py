"""Two bodies that turn about one axis, a rolling shell and what swings in it, integrated by dynamic.c."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Drive
from terrapin_hil.physics.compiled import ffi, library, pointer

__all__ = ["SMOOTHING", "integrate_swinging"]

SMOOTHING: tuple[str, float | None] = ("rad/s", 0.05)  # of the sign of friction: sign(x) is tanh(x / smoothing)


def integrate_swinging(drive: Drive, base: str, masses: Sequence[str], slip: float) -> tuple[dict[str, Array], Array]:
    """The motion by name, and the channel that dynamic.h gives to `base` (samples,): a current or a torque.

    `masses` names the parameters that sum to the whole mass [kg]; `slip` is that of the shell on the ground.
    """
    f, lib = ffi(), library()
    stacked, slots = drive.inputs()
    clock = np.ascontiguousarray(drive.time, dtype=np.float64)
    numbers = f.new("int[]", slots or [0])
    record_in = f.new("hil_drive_record *", (len(clock), pointer(clock), len(slots), numbers, pointer(stacked)))
    angle = float(drive.columns["angle"][0]) if "angle" in drive.columns else 0.0
    state = np.array([angle, angle, drive.start, drive.start])
    count, table = len(drive.table), pointer(drive.table)
    common = (getattr(lib, base), drive.effects, record_in, count, table, pointer(state))
    if drive.start != 0.0:
        state[0] += lib.hil_dynamic_steady_swing(*common)
    record = np.empty((len(clock), lib.HIL_DYNAMIC_RECORD))
    lib.hil_dynamic_run(*common, drive.body.longest_step, pointer(record))
    motion = {
        "omega": record[:, 2],
        "angle": record[:, 0],
        "acceleration": record[:, 4],
        "shell_rate": record[:, 3],
        "shell_angle": record[:, 1],
        "swing_angle": record[:, 0] - record[:, 1],
        "swing_rate": record[:, 2] - record[:, 3],
        "speed": drive.value("radius") * record[:, 3] * (1.0 - slip),
        "slip": np.full(len(clock), slip),
        "load": np.full(len(clock), sum(drive.value(name) for name in masses) * drive.value("gravity")),
    }
    return motion, record[:, 6]
