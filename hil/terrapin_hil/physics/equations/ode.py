"""Differential equations of the user's own, integrated by ode.c with exact derivatives.

    fall = Ode([instructions("v", slots, {}), instructions("-g", slots, {})], [...], len(slots), [], np.ones(2))
    run = fall.run(values, drive, start, slopes=False)
    run.states, run.channels, run.slopes

A table of values has the time at slot 0, the states from slot 1 on, then whatever else the formulas name.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.program import Instruction

__all__ = [
    "MOST_FREE",
    "MOST_STATES",
    "MOST_VALUES",
    "Linear",
    "Ode",
    "OdeDrive",
    "OdeEnds",
    "OdeError",
    "OdeRun",
    "cores",
]

MOST_STATES, MOST_VALUES = 8, 256  # HIL_ODE_STATES, HIL_ODE_VALUES
MOST_FREE = 64 - MOST_STATES  # HIL_ODE_COLUMNS
LENGTH = 2048  # HIL_PROGRAM_LENGTH
RELATIVE = 1e-7  # tolerance of a step: far below any noise, and difference quotients of predictions stay smooth
BOUND = 1e12  # of a state


WORTH_A_THREAD = 2_000  # samples: some milliseconds
FIELDS = [("kind", np.int32), ("state", np.int32), ("time", np.float64), ("steps", np.int32)]
END = np.dtype(FIELDS, align=True)  # hil_ode_end


class OdeError(Exception):
    """The solution leaves all bounds, or is too stiff. `state` is its number, `time` [s] that of the run, `stretch` the
    number of the stretch."""

    def __init__(self, stiff: bool, state: int, time: float, stretch: int = 0) -> None:
        super().__init__("too stiff" if stiff else "leaves all bounds")
        self.stiff, self.state, self.time, self.stretch = stiff, state, time, stretch


@dataclass(frozen=True)
class OdeDrive:
    """Samples in stretches: time (samples,), rising within each; `inputs` (samples, columns) and the slot of each
    column, all contiguous; `begin` (stretches + 1,), the first sample of each, and how many there are; one if empty."""

    time: Array
    inputs: Array
    slots: tuple[int, ...]
    begin: Sequence[int] = ()

    @property
    def stretches(self) -> int:
        return max(len(self.begin) - 1, 1)


@dataclass(frozen=True)
class OdeRun:
    """states (samples, states), channels (samples, channels), slopes (samples, channels, states + free) or None."""

    states: Array
    channels: Array
    slopes: Array | None


@dataclass(frozen=True)
class OdeEnds:
    """How each stretch ended (stretches,): `failed` or not, or was not wanted; with what state, when and after how many
    steps."""

    failed: Mask
    stiff: Mask
    state: Index
    time: Array
    steps: Index

    def error(self, stretch: int) -> OdeError:
        """Why a stretch failed."""
        return OdeError(bool(self.stiff[stretch]), int(self.state[stretch]), float(self.time[stretch]), stretch)


class Linear:
    """A solution's neighbourhood: what additions to the derivative of one state change."""

    def __init__(self, ode: Ode, drive: OdeDrive, record: Array, output: Array) -> None:
        self._ode, self._record, self._output = ode, record, output
        self._drive, self._kept = _drive(drive)

    def respond(self, addition: Array) -> Array:
        """Change of the channels (samples, channels) by an addition (samples,), linear between samples."""
        found = np.empty(self._output.shape[:2])
        whole = np.ascontiguousarray(addition, dtype=np.float64)
        library().hil_ode_respond(
            self._ode.native, self._drive, pointer(self._record), pointer(self._output), pointer(whole), pointer(found)
        )
        return found


class Ode:
    """A system of equations, ready to run.

    Parameters
    ----------
    derivatives, channels : instructions of each state's derivative, and of each channel.
    values : slots in all.
    free : slots of the parameters to take derivatives by.
    scale : (states,), a size of each state: the absolute tolerance is a 1e-9 of it.
    smoothing : sign(x) is tanh(x / smoothing); 0 for the very sign.
    held : inputs hold their value until the next sample; else they are linear between samples.

    Raises
    ------
    ValueError : more states, values, free parameters or instructions than ode.h allows.
    """

    def __init__(
        self,
        derivatives: Sequence[list[Instruction]],
        channels: Sequence[list[Instruction]],
        values: int,
        free: Sequence[int],
        scale: Array,
        smoothing: float = 0.0,
        held: bool = False,
    ) -> None:
        formulas = [*derivatives, *channels]
        for name, found, most in (
            ("states", len(derivatives), MOST_STATES),
            ("values", values, MOST_VALUES),
            ("fitted parameters", len(free), MOST_FREE),
            ("operations in a formula", max(map(len, formulas)), LENGTH),
        ):
            if found > most:
                raise ValueError(f"found {found} {name}, expected at most {most}")
        f = ffi()
        self.states, self.channels, self.free = len(derivatives), len(channels), len(free)
        begin = np.cumsum([0, *map(len, formulas)])[:-1].tolist()
        self._absolute = np.ascontiguousarray(1e-2 * RELATIVE * scale)
        self._kept: list[Any] = [
            f.new("hil_instruction[]", [one for formula in formulas for one in formula]),
            f.new("int[]", begin),
            f.new("int[]", [len(formula) for formula in formulas]),
            f.new("int[]", list(free) or [0]),
        ]
        code, begins, counts, slots = self._kept
        numbers = (self.states, self.channels, values, self.free, slots, code, begins, counts)
        limits = (smoothing, RELATIVE, pointer(self._absolute), BOUND, int(held))
        self.native = f.new("hil_ode *", (*numbers, *limits))

    def run(self, values: Array, drive: OdeDrive, start: Array, slopes: bool) -> OdeRun:
        """States and channels from `start` (stretches, states) on, with their derivatives if asked for. OdeError."""
        count = len(drive.time)
        by = np.empty((count, self.channels, self.states + self.free)) if slopes else None
        found = OdeRun(np.empty((count, self.states)), np.empty((count, self.channels)), by)
        ends = self.run_some(values, drive, start, np.ones(drive.stretches, dtype=bool), found)
        if ends.failed.any():
            raise ends.error(int(np.argmax(ends.failed)))
        return found

    def run_some(self, values: Array, drive: OdeDrive, start: Array, wanted: Mask, into: OdeRun) -> OdeEnds:
        """The stretches that are `wanted` (stretches,), written into the arrays of `into`; many of them in threads, as
        many as OMP_NUM_THREADS says, else as there are cores: each stretch is the same whoever integrates it."""
        ends = np.zeros(drive.stretches, dtype=END)
        record, kept = _drive(drive)
        begin = np.ascontiguousarray(start, dtype=np.float64)

        def run(part: Mask) -> None:
            library().hil_ode_run(
                self.native,
                record,
                pointer(values),
                pointer(begin),
                ffi().from_buffer("unsigned char[]", np.ascontiguousarray(part, dtype=np.uint8)),
                pointer(into.states),
                pointer(into.channels),
                pointer(into.slopes),
                ffi().from_buffer("hil_ode_end[]", ends),
            )

        shares = _shares(drive, wanted)
        if len(shares) == 1:
            run(wanted)
        else:
            with ThreadPoolExecutor(len(shares)) as pool:
                list(pool.map(run, shares))
        del kept
        stiff = ends["kind"] == library().HIL_ODE_STIFF
        state, steps = (ends[name].astype(np.int64) for name in ("state", "steps"))
        return OdeEnds(ends["kind"] != 0, stiff, state, ends["time"], steps)

    def linear(self, values: Array, drive: OdeDrive, states: Array, target: int) -> Linear:
        """The neighbourhood of a solution for additions to the derivative of state `target`. OdeError."""
        count = len(drive.time)
        record = np.zeros((count, self.states, self.states + 2))
        output = np.empty((count, self.channels, self.states))
        native, kept = _drive(drive)
        end = library().hil_ode_linear(
            self.native, native, pointer(values), pointer(states), target, pointer(record), pointer(output)
        )
        del kept
        if end.kind:
            raise OdeError(end.kind == library().HIL_ODE_STIFF, end.state, end.time)
        return Linear(self, drive, record, output)


def cores() -> int:
    """Threads that integrate: as many as OMP_NUM_THREADS says, else as there are cores."""
    said = os.environ.get("OMP_NUM_THREADS", "")
    return int(said) if said.isdecimal() else os.cpu_count() or 1


def _shares(drive: OdeDrive, wanted: Mask) -> list[Mask]:
    """The wanted stretches in as many parts as are worth a thread each, about equal in samples."""
    lengths = np.where(wanted, np.diff(drive.begin) if len(drive.begin) else len(drive.time), 0)
    count = max(1, min(cores(), int(lengths.sum()) // WORTH_A_THREAD))
    share = (np.cumsum(lengths) - lengths) * count // max(int(lengths.sum()), 1)
    return [wanted & (share == i) for i in range(count)]


def _drive(drive: OdeDrive) -> tuple[Any, Any]:
    """hil_ode_drive *, and what must be kept alive beside it."""
    f = ffi()
    kept = f.new("int[]", list(drive.begin) or [0, len(drive.time)]), f.new("int[]", list(drive.slots) or [0])
    record = (drive.stretches, kept[0], pointer(drive.time), len(drive.slots), kept[1], pointer(drive.inputs))
    return f.new("hil_ode_drive *", record), kept
