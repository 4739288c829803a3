"""Recorded steps, again: on this machine through libterrapin.so, and on the emulated Cortex-M4 with their instructions
counted (firmware/ports/replay).

    recording = record(load_scenario(find_scenario("steady_sand")))
    counted = count(recording)                 # "drive" and "think": instructions of the two halves of each tick
    (counted["outputs"] == on_host(recording)).all()

Inputs and outputs are the C structs as bytes: they have no pointers, and the same layout on both machines.
"""

from __future__ import annotations

import struct
import subprocess
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.qemu import MACHINE
from terrapin_hil.messages import Frame
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario

Bytes = npt.NDArray[np.uint8]
Counts = npt.NDArray[Any]

RESET, TICK, FRAME, NODE, KEY = 1, 2, 3, 4, 5  # kinds of a record, as firmware/ports/replay/main.c has them
# Raw values with which every compensation works, none so large that C_t leaves its range.
COMPENSATIONS = {
    "comp_speed_squared": 20_000, "comp_viscous": 20_000, "comp_coulomb": 2_000, "comp_stribeck": 3_000,
    "comp_stribeck_speed": 3_000, "comp_heating": 2_000, "comp_current_offset": 5_000, "comp_slope": 10_000,
    "comp_inertia": 5_000, "comp_imbalance": 4_000, "comp_imbalance_phase": 10_000,
}  # fmt: skip
LIMIT = 600.0  # s that the emulator may take for one file


@dataclass(frozen=True)
class Recording:
    """What a controller was given: raw values of its parameters, and one row of bytes of terrapin_inputs a tick."""

    values: tuple[int, ...]
    inputs: Bytes


class _Recorder(InProcess):
    """The controller in this process, which keeps the inputs of every step."""

    def __init__(self, firmware: Firmware) -> None:
        super().__init__(firmware)
        self.seen: list[bytes] = []

        def step(state: Any, inputs: Any, outputs: Any) -> None:
            self.seen.append(bytes(self._ffi.buffer(inputs)))
            self._lib.terrapin_step(state, inputs, outputs)

        kind = "void(terrapin_state *, const terrapin_inputs *, terrapin_outputs *)"
        self._callback = self._ffi.callback(kind, step)

    def advance(self, simulation: Any, ticks: int) -> None:
        if simulation.disturbed:
            super(InProcess, self).advance(simulation, ticks)
        else:
            step = int(self._ffi.cast("uintptr_t", self._callback))
            simulation.run(step, self.firmware.address(self._state), ticks)

    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        answers: list[Frame] = []
        for frame in frames:
            before = self._outputs.frame_count
            self._outputs.frame_count = 0
            here = super().exchange([frame])
            if self._outputs.frame_count:  # a tick was taken; the command was fresh when it was
                self.seen.append(self._last)
            else:
                self._outputs.frame_count = before
                self._last = bytes(self._ffi.buffer(self._inputs))
            answers += here
        return answers


def raw_values(firmware: Firmware, parameters: Mapping[str, float]) -> tuple[int, ...]:
    """All parameters as raw integers, in file order; those that are not named at their defaults."""
    given = {name: firmware.interface.parameter(name).raw(value) for name, value in parameters.items()}
    return tuple(given.get(name, p.default) for name, p in firmware.interface.parameters.items())


def compensated(recording: Recording, firmware: Firmware) -> Recording:
    """The same inputs for a controller with every compensation set."""
    values = list(recording.values)
    for name, value in COMPENSATIONS.items():
        values[firmware.interface.parameters[name].index] = value
    return Recording(tuple(values), recording.inputs)


def whole(counted: Counts) -> npt.NDArray[np.int64]:
    """Instructions of each tick, both halves."""
    return counted["drive"].astype(np.int64) + counted["think"]


def record(
    scenario: Scenario, parameters: Mapping[str, float] | None = None, firmware: Firmware | None = None
) -> Recording:
    """The inputs of a run of `scenario`, with these parameters over its own [their units]."""
    firmware = firmware or Firmware.open()
    recorder = _Recorder(firmware)
    with recorder:
        run(replace(scenario, checks=(), provokes=None), recorder, parameters=parameters)
    rows = np.frombuffer(b"".join(recorder.seen), np.uint8).reshape(len(recorder.seen), -1)
    return Recording(raw_values(firmware, {**scenario.firmware, **(parameters or {})}), rows)


def output_type(firmware: Firmware) -> np.dtype[Any]:
    """terrapin_outputs as a NumPy structure."""
    frame = np.dtype([("id", "<u2"), ("length", "u1"), ("data", "u1", (8,))], align=True)
    kind = np.dtype(
        [("duty", "<i2"), ("enable", "?"), ("faults", "<u4"), ("count", "u1"), ("frames", frame, (2,))], align=True
    )
    if kind.itemsize != firmware.ffi.sizeof("terrapin_outputs"):
        raise AssertionError("terrapin_outputs and its NumPy structure differ")
    return kind


def on_host(recording: Recording, firmware: Firmware | None = None) -> Counts:
    """The outputs of each tick (`output_type`), from libterrapin.so."""
    firmware = firmware or Firmware.open()
    ffi, lib = firmware.ffi, firmware.lib
    state, outputs = firmware.new_state(), ffi.new("terrapin_outputs *")
    values = ffi.new("int32_t[]", list(recording.values))
    if lib.terrapin_parameter_set_all(state, values) != lib.TERRAPIN_PARAMETER_OK:
        raise ValueError("a parameter is out of its range")
    data = np.ascontiguousarray(recording.inputs)
    inputs = ffi.from_buffer("terrapin_inputs[]", data)
    result = bytearray()
    for i in range(len(data)):
        lib.terrapin_step(state, inputs + i, outputs)
        result += ffi.buffer(outputs)
    return np.frombuffer(bytes(result), output_type(firmware))


def image() -> Path:
    """The image that counts."""
    return paths.images() / "step-replay.elf"


def emulate(records: bytes, program: Path | None = None) -> bytes:
    """What the image answers to a file of records. RuntimeError when it does not take them."""
    with tempfile.TemporaryDirectory(prefix="terrapin-replay-") as folder:
        source, sink = Path(folder) / "in", Path(folder) / "out"
        source.write_bytes(records)
        command = ["qemu-system-arm", "-M", MACHINE, "-nodefaults", "-display", "none", "-serial", "none"]
        command += ["-monitor", "none", "-icount", "shift=7,sleep=off", "-kernel", str(program or image())]
        command += ["-semihosting-config", f"enable=on,target=native,arg=replay,arg={source},arg={sink}"]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LIMIT)
        if done.returncode:
            raise RuntimeError(f"the image that counts ended with status {done.returncode}: {done.stderr.strip()}")
        return sink.read_bytes()


def ticks(recording: Recording) -> bytes:
    """The records of a reset with its parameters and of all ticks."""
    n, width = recording.inputs.shape
    rows = np.empty((n, 4 + width), np.uint8)
    rows[:, :4] = np.frombuffer(struct.pack("<I", TICK), np.uint8)
    rows[:, 4:] = recording.inputs
    return struct.pack(f"<I{len(recording.values)}i", RESET, *recording.values) + rows.tobytes()


def count(recording: Recording, firmware: Firmware | None = None, program: Path | None = None) -> Counts:
    """Of each tick: `drive`, `think` and `intake` [instructions], `taken` (frames), `mode` (as the image's source has
    it), `outputs`."""
    return count_all([recording], firmware, program)[0]


def count_all(
    recordings: Iterable[Recording], firmware: Firmware | None = None, program: Path | None = None
) -> list[Counts]:
    """The same of several, each from a reset, in one run of the emulator."""
    firmware, recordings = firmware or Firmware.open(), list(recordings)
    words = [(name, "<u4") for name in ("drive", "think", "intake", "taken", "mode")]
    kind = np.dtype([*words, ("outputs", output_type(firmware))], align=True)
    answer = emulate(b"".join(map(ticks, recordings)), program)
    found, at = [], 0
    for recording in recordings:
        if struct.unpack_from("<I", answer, at)[0]:
            raise ValueError("a parameter is out of its range")
        found.append(np.frombuffer(answer, kind, len(recording.inputs), at + 4))
        at += 4 + kind.itemsize * len(recording.inputs)
    if at != len(answer):
        raise RuntimeError(f"the image that counts answered {len(answer)} bytes, expected {at}")
    return found
