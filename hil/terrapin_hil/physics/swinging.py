"""Two bodies that turn about one axis, a rolling shell and what swings in it, integrated by dynamic.c."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Drive
from terrapin_hil.physics.compiled import ffi, library, pointer

__all__ = ["SMOOTHING", "follow_swinging", "motion_of_swinging", "weight_of"]

SMOOTHING: tuple[str, float | None] = ("rad/s", 0.05)  # of the sign of friction: sign(x) is tanh(x / smoothing)


def follow_swinging(base: str) -> Callable[[Drive], tuple[Array, Array]]:
    """What integrates the `base` of dynamic.h: its record (samples, 7), and what neighbours change in it."""

    def follow(drive: Drive) -> tuple[Array, Array]:
        f, lib = ffi(), library()
        stacked, slots = drive.inputs()
        clock = np.ascontiguousarray(drive.time, dtype=np.float64)
        numbers = f.new("int[]", slots or [0])
        record_in = f.new("hil_drive_record *", (len(clock), pointer(clock), len(slots), numbers, pointer(stacked)))
        angle = float(drive.columns["angle"][0]) if "angle" in drive.columns else 0.0
        state = np.tile([angle, angle, drive.start, drive.start], (len(drive.tables), 1))
        kind, count = getattr(lib, base), drive.tables.shape[1]
        for row, table in zip(state, drive.tables, strict=True) if drive.start != 0.0 else ():
            common = (kind, drive.effects, record_in, count, pointer(table), pointer(row))
            row[0] += lib.hil_dynamic_steady_swing(*common)
        record = np.full((len(clock), lib.HIL_DYNAMIC_RECORD), np.nan)
        change, shapes = drive.changes(record.shape[1])
        run = (kind, drive.effects, record_in, count, pointer(drive.tables), pointer(state))
        lib.hil_dynamic_follow(*run, len(change), shapes, pointer(record), pointer(change))
        return record, change

    return follow


def motion_of_swinging(
    drive: Drive, table: Array, record: Array, masses: Sequence[str], slip: float
) -> dict[str, Array]:
    """The motion by name; `masses` names the parameters that sum to the whole mass [kg], `slip` is that of the shell on
    the ground."""
    count = len(record)
    return {
        "omega": record[:, 2],
        "angle": record[:, 0],
        "acceleration": record[:, 4],
        "shell_rate": record[:, 3],
        "shell_angle": record[:, 1],
        "swing_angle": record[:, 0] - record[:, 1],
        "swing_rate": record[:, 2] - record[:, 3],
        "speed": table[drive.slots["radius"]] * record[:, 3] * (1.0 - slip),
        "slip": np.full(count, slip),
        "load": np.full(count, weight_of(drive, table, masses)),
    }


def weight_of(drive: Drive, table: Array, masses: Sequence[str]) -> float:
    """The weight [N] of what the `masses` of a table of values sum to."""
    return float(sum(table[drive.slots[name]] for name in masses) * table[drive.slots["gravity"]])
