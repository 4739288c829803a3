"""Bodies that roll on ground that slips, integrated by slipping.c."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Drive
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.swinging import motion_of_swinging

__all__ = ["follow_slipping", "motion_of_slipping"]

Grip = Callable[
    [Drive, Array], tuple[Array, Array] | None
]  # table of values (slots,) -> loads [N] and grip.grid of them
_AS_SWINGING = [0, 1, 3, 4, 6]  # columns of a record: what those of swinging.py begin with


def follow_slipping(body: str, grip: Grip | None = None) -> Callable[[Drive], tuple[Array, Array]]:
    """What integrates the `body` of slipping.h: its record (samples, 10), and what neighbours change in it. `grip` says
    None where no sinkage carries a load."""

    def follow(drive: Drive) -> tuple[Array, Array]:
        f, lib = ffi(), library()
        stacked, slots = drive.inputs()
        clock = np.ascontiguousarray(drive.time, dtype=np.float64)
        record = np.full((len(clock), lib.HIL_SLIPPING_RECORD), np.nan)
        change, shapes = drive.changes(record.shape[1])
        tables = np.ascontiguousarray(drive.tables)
        kept: list[Any] = [f.new("int[]", slots or [0])]
        grips = f.NULL
        if grip is not None:
            for table in tables:
                found = grip(drive, table)
                if found is None:
                    return record, change
                loads, row = found
                step = float(loads[1] - loads[0]) if len(loads) > 1 else 1.0
                head = (*row.shape[:2], float(loads[0]), step, pointer(row), (0.0, 0.0, 0.0, 0.0))
                kept += [row, f.new("hil_grip_table *", head)]
            kept.append(f.new("hil_grip_table *[]", kept[2::2]))
            grips = kept[-1]
        kind = getattr(lib, body)
        inputs = (len(clock), pointer(clock), len(slots), kept[0], pointer(stacked))
        run = f.new("hil_slipping_run *", (kind, drive.effects, *inputs, tables.shape[1], pointer(tables), grips))
        angle = float(drive.columns["angle"][0]) if "angle" in drive.columns else 0.0
        start = np.tile([angle, angle, 0.0, drive.start, drive.start, 0.0], (len(tables), 1))
        for number, row in enumerate(start) if drive.start != 0.0 else ():
            lib.hil_slipping_settle(run, number, pointer(row))
        lib.hil_slipping_follow(run, pointer(start), len(change), shapes, pointer(record), pointer(change))
        return record, change

    return follow


def motion_of_slipping(drive: Drive, table: Array, record: Array, masses: Sequence[str]) -> dict[str, Array]:
    """The motion by name, as `motion_of_swinging` has it, but for speed and slip."""
    radius, speed = table[drive.slots["radius"]], record[:, 5]
    rim = radius * record[:, 4]
    faster = np.maximum(np.maximum(np.abs(rim), np.abs(speed)), radius * table[drive.slots["smoothing"]])
    rolling = motion_of_swinging(drive, table, record[:, _AS_SWINGING], masses, 0.0)
    return {**rolling, "speed": speed, "slip": (rim - speed) / faster}
