"""Bodies that roll on ground that slips, integrated by slipping.c."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Drive
from terrapin_hil.physics.compiled import ffi, library, pointer

__all__ = ["follow_slipping", "motion_of_slipping"]

Grip = Callable[[Drive, Array], Array | None]  # a table of values (slots,) -> (1, slips, VALUES, 2), None for no ground


def follow_slipping(
    body: str, load: Callable[[Drive, Array], float], grip: Grip | None = None
) -> Callable[[Drive], tuple[Array, Array]]:
    """What integrates the `body` of slipping.h: its record (samples, 10), and what neighbours change in it.

    `load` [N] is that of the tables that `grip` makes, the same for all slips.
    """

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
                row = grip(drive, table)
                if row is None:
                    return record, change
                kept.append(row)
                head = (1, row.shape[1], load(drive, table), 1.0, pointer(row), (0.0, 0.0, 0.0, 0.0))
                kept.append(f.new("hil_grip_table *", head))
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


def motion_of_slipping(drive: Drive, table: Array, record: Array, load: float) -> dict[str, Array]:
    """The motion by name; `load` [N] on level ground."""
    rim = table[drive.slots["radius"]] * record[:, 4]
    floor = table[drive.slots["radius"]] * table[drive.slots["smoothing"]]
    faster = np.maximum(np.maximum(np.abs(rim), np.abs(record[:, 5])), floor)
    return {
        "omega": record[:, 3],
        "angle": record[:, 0],
        "acceleration": record[:, 6],
        "shell_rate": record[:, 4],
        "shell_angle": record[:, 1],
        "swing_angle": record[:, 0] - record[:, 1],
        "swing_rate": record[:, 3] - record[:, 4],
        "speed": record[:, 5],
        "slip": (rim - record[:, 5]) / faster,
        "load": np.full(len(record), load),
    }
