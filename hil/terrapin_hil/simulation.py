"""The compiled simulator, filled from a scenario: one object per run, one record per tick.

simulation = Simulation(scenario)
simulation.run(step, state, 1000)               # 1000 ticks with a controller in this process, or, tick by tick:
frames = simulation.sense()                     # what the controller is to receive
simulation.answer(controller_frames)            # what it said; moves the robot by 1 ms
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.library import ffi, library
from terrapin_hil.messages import AnswerError, Frame
from terrapin_hil.robot.compiled_effects import compile_effects
from terrapin_hil.robot.plant import Ground
from terrapin_hil.robot.sensors import ADCS, CHANNELS, DIGITALS, ENCODERS, Sensors
from terrapin_hil.robot.soft_ground import affected, grip_tables
from terrapin_hil.robot.truth import TRUTH
from terrapin_hil.scenario.faults import KINDS, Fault
from terrapin_hil.scenario.scenario import CONTROLS, REQUESTS, Scenario
from terrapin_hil.scenario.wire_faults import Disturbance

__all__ = ["TICK", "Simulation", "output_hash", "record_type"]

TICK = 1e-3  # s
SUBSTEPS, FINE_SUBSTEPS, FINE_BELOW = 1, 8, 0.05  # of a tick; finer while axle and rim are slower [m/s]


@cache
def record_type() -> np.dtype[Any]:
    """hil_record as a NumPy structure."""
    frame = np.dtype([("id", "<u2"), ("length", "u1"), ("data", "u1", (8,))], align=True)
    inputs = ffi().sizeof("terrapin_inputs")
    record = np.dtype(
        [
            ("truth", "<f8", (len(TRUTH),)),
            ("inputs", "<u4", (inputs // 4,)),  # terrapin_inputs, opaque here: its numbers are in the host's frames
            ("commands", "<u4"),
            ("silent", "?"),
            ("host_count", "u1"),
            ("answer_count", "u1"),
            ("host", frame, (3,)),
            ("answer", frame, (2,)),
        ],
        align=True,
    )
    if record.itemsize != ffi().sizeof("hil_record"):
        raise AssertionError("hil_record and its NumPy structure differ")
    return record


def _sensors(sensors: Sensors) -> dict[str, Any]:
    def channel(name: str) -> dict[str, Any]:
        values = asdict(getattr(sensors, name))
        values.pop("delay")
        return values

    return {
        "adc": [channel(name) for name in ADCS],
        "encoder": [channel(name) for name in ENCODERS],
        "digital": [channel(name) for name in DIGITALS],
        "delay": [round(getattr(sensors, name).delay / TICK) for name in CHANNELS],
    }


def _path(ground: Ground) -> dict[str, Any]:
    return {
        "count": len(ground.segments),
        "segment": [
            {"start": s.start, "transition": s.transition, "slope": s.slope, "terrain": asdict(s.terrain)}
            for s in ground.segments
        ],
        "dig_length": ground.dig_length,
        "leave_length": ground.leave_length,
        "rut_friction": ground.rut_friction,
        "dig_slip": ground.dig_slip,
        "slip_depth": ground.slip_depth,
    }


def _profile(points: Sequence[tuple[float, float]]) -> dict[str, Any]:
    return {"count": len(points), "time": [t for t, _ in points], "value": [v for _, v in points]}


def _fault(fault: Fault) -> dict[str, Any]:
    return {
        "kind": KINDS[fault.kind][0],
        "channel": CHANNELS.index(fault.channel) if fault.channel else -1,
        "value": fault.value,
        "begin": fault.begin,
        "end": fault.end,
    }


def _config(scenario: Scenario) -> dict[str, Any]:
    winding = asdict(scenario.winding)
    winding["profile"] = _profile(scenario.winding.profile)
    orders = [
        {
            "time": order.time,
            "request": REQUESTS[order.request],
            "control": CONTROLS[order.control],
            "limiter": order.limiter,
            "setpoint": max(-32768, min(32767, round(order.setpoint * 1000))),
        }
        for order in scenario.operator
    ]
    return {
        "robot": asdict(scenario.robot),
        "path": _path(scenario.ground),
        "winding": winding,
        "sensors": _sensors(scenario.sensors),
        "faults": {"count": len(scenario.faults), "fault": [_fault(fault) for fault in scenario.faults]},
        "tow": _profile(scenario.tow),
        "carriage": _profile(scenario.carriage),
        "steering": _profile(scenario.steering),
        "wheel_radius": scenario.design.wheel_radius,
        "supply": scenario.supply,
        "supply_resistance": scenario.supply_resistance,
        "start_position": scenario.start_position,
        "pass": scenario.pass_number,
        "moisture": scenario.moisture,
        "order_count": len(orders),
        "order": orders,
        "substeps": SUBSTEPS,
        "fine_substeps": FINE_SUBSTEPS,
        "fine_below": FINE_BELOW,
        "seed": scenario.seed,
    }


class Simulation:
    """State and log of one run. `records` has one row a tick; rows up to `done` are filled.

    `substeps` of a tick are taken by the plant, `fine_substeps` while axle and rim are slower than 0.05 m/s.
    """

    def __init__(self, scenario: Scenario, substeps: int = SUBSTEPS, fine_substeps: int = FINE_SUBSTEPS) -> None:
        self.scenario = scenario
        self._ffi, self._lib = ffi(), library()
        constants = {
            "radius": scenario.robot.radius,
            "drive_radius": scenario.robot.drive_radius,
            "torque_constant": scenario.robot.torque_constant,
            "coulomb": scenario.robot.coulomb,
            "viscous": scenario.robot.viscous,
        }
        ground, effects = affected(scenario.ground, scenario.effects, scenario.pass_number, scenario.moisture)
        self._effects = compile_effects(effects, constants)
        self._simulator = self._ffi.new("hil_simulator *")
        self._simulator.config = self._ffi.new("hil_config *", _config(scenario))[0]
        config = self._simulator.config
        config.substeps, config.fine_substeps = substeps, fine_substeps
        self._grip: list[Any] = []
        if ground.contact is not None:
            # kept alive: the C side holds their addresses only
            tables = grip_tables(ground, scenario.robot)
            self._grip = [(table, table.native()) if table else None for table in tables]
            for segment, kept in zip(config.path.segment, self._grip, strict=False):
                segment.contact = kept[1] if kept else self._ffi.NULL
        config.effects = self._effects.native
        self._lib.hil_start(self._simulator)
        self.records = np.zeros(scenario.ticks, record_type())
        self._rows = self._ffi.from_buffer("hil_record[]", self.records)
        self.done = 0
        self._disturbance = Disturbance(scenario.faults, scenario.seed)

    @property
    def config(self) -> Any:
        """hil_config, as the compiled simulator reads it at each tick."""
        return self._simulator.config

    @property
    def duty(self) -> int:
        """What the bridge was told for this tick, 32768 for the whole supply."""
        return int(self._simulator.duty)

    def tables(self) -> list[tuple[Any, Any, int]]:
        """What the configuration points to: pointer, C array and its length, each before what points to it."""
        native = self._effects.native
        effect, code = self._effects.kept
        found = [(native.effect, effect, len(effect)), (native.code, code, len(code))]
        for kept in self._grip:
            if kept is not None:
                table = kept[1]
                count = kept[0].row.size
                found.append((table.row, self._ffi.cast(f"double(*)[{count}]", table.row)[0], count))
                found.append((table, self._ffi.cast("hil_grip_table(*)[1]", table)[0], 1))
        return found

    def set_plant(self, move: Callable[..., None], failed: Callable[..., None]) -> Any:
        """Moves the body by `move(context, voltage, enabled, hil_body)` from now on; `failed` gets what it raises. What
        comes back has to live as long."""
        native = self._ffi.callback("void(void *, double, bool, hil_body *)", move, onerror=failed)
        self._simulator.plant = native
        return native

    @property
    def ticks(self) -> int:
        """Done since the start."""
        return self.done

    def rows(self, begin: int, end: int) -> npt.NDArray[Any]:
        """Records of the ticks from `begin` up to `end`."""
        return self.records[begin:end]

    def run(self, step: int, state: int, ticks: int) -> None:
        """`ticks` ticks with the controller at the address `step` and its state at `state`."""
        function = self._ffi.cast("hil_step", step)
        memory = self._ffi.cast("void *", state)
        ticks = min(ticks, len(self.records) - self.done)
        self._lib.hil_run(self._simulator, function, memory, ticks, self._rows + self.done)
        self.done += ticks

    def drive(self, voltage: float | None, ticks: int) -> None:
        """`ticks` ticks of the robot alone at a motor voltage [V], or with the bridge open (None)."""
        duty = 0 if voltage is None else round(voltage / self.scenario.supply * 32768)
        duty = max(-32768, min(32767, duty))
        ticks = min(ticks, len(self.records) - self.done)
        self._lib.hil_move(self._simulator, duty, voltage is not None, ticks, self._rows + self.done)
        self.done += ticks

    def set_fault(self, fault: Fault, slot: int | None = None) -> int:
        """From the next tick on: one fault more, or another in `slot`; its slot. ValueError when there is no room."""
        faults = self._simulator.config.faults
        if slot is None:
            if faults.count == len(faults.fault):
                raise ValueError(f"found {faults.count} faults, expected at most {len(faults.fault)}")
            slot, faults.count = int(faults.count), faults.count + 1
        faults.fault[slot] = _fault(fault)
        return slot

    def truth(self) -> dict[str, npt.NDArray[np.float64]]:
        """Column of the truth -> one value for each tick that was done."""
        return {name: self.records["truth"][: self.done, i] for i, name in enumerate(TRUTH)}

    def answers(self, tick: int) -> list[Frame]:
        """What the controller said in a tick that the records hold."""
        row = self._rows[tick - (self.ticks - self.done)]
        return [(f.id, self._ffi.buffer(f.data, f.length)[:]) for f in row.answer[0 : row.answer_count]]

    def sense(self) -> list[Frame]:
        """Frames for the controller at this tick; none while a fault silences the link."""
        row = self._rows[self.done]
        self._lib.hil_sense(self._simulator, self._ffi.addressof(row))
        self._lib.hil_frames(self._ffi.addressof(row), 1)
        frames = []
        for i in range(row.host_count):
            frame = row.host[i]
            frames.append((frame.id, bytes(frame.data[0 : frame.length])))
        return self._disturbance.apply(self.ticks, frames) if self.disturbed else frames

    @property
    def disturbed(self) -> bool:
        """Something is wrong on the bus in this run: what the controller gets is `sense`, not the inputs."""
        return bool(self._disturbance.faults)

    def write_frames(self, first: int) -> None:
        """Fills the host's frames in the records from `first` on; runs in this process leave them out until then."""
        self._lib.hil_frames(self._rows + first, self.done - first)

    def answer(self, frames: Iterable[Frame]) -> None:
        """The controller's frames of this tick, ACTUATE first. AnswerError when that is missing, damaged or late."""
        row = self._rows[self.done]
        count = 0
        for identifier, data in frames:
            if count == len(row.answer):
                raise AnswerError(f"tick {self.done}: the controller sent more than {count} frames")
            row.answer[count].id = identifier
            row.answer[count].length = len(data)
            self._ffi.memmove(row.answer[count].data, data, len(data))
            count += 1
        row.answer_count = count
        result = self._lib.hil_answer(self._simulator, self._ffi.addressof(row))
        if result != self._lib.HIL_ANSWERED:
            reason = {
                self._lib.HIL_NO_ACTUATE: "without ACTUATE as its first frame",
                self._lib.HIL_WRONG_TICK: "for another tick",
                self._lib.HIL_BAD_CRC: "with a bad CRC",
            }[result]
            raise AnswerError(f"tick {self.done}: the controller answered {reason}")
        self.done += 1

    def append(self, tick: int, frame: Frame) -> None:
        """Adds a frame that arrived late to the record of an earlier tick. AnswerError when it is full or not there."""
        if tick < 0:
            raise AnswerError(f"the controller sent {frame[0]:#05x} before the first tick")
        row = self._rows[tick]
        if row.answer_count == len(row.answer):
            raise AnswerError(f"tick {tick}: the controller sent more than {row.answer_count} frames")
        row.answer[row.answer_count].id = frame[0]
        row.answer[row.answer_count].length = len(frame[1])
        self._ffi.memmove(row.answer[row.answer_count].data, frame[1], len(frame[1]))
        row.answer_count += 1


def output_hash(records: npt.NDArray[Any]) -> str:
    """SHA-256 over every frame of the controller in order: id (16 bit, little-endian), length, data."""
    frames = records["answer"]
    used = np.arange(frames.shape[1]) < records["answer_count"][:, None]
    flat = frames[used]
    raw = flat.view(np.uint8).reshape(len(flat), -1)
    digest = hashlib.sha256()
    if np.all(flat["length"] == 8):
        digest.update(np.ascontiguousarray(raw[:, :11]).tobytes())
    else:
        for row, length in zip(raw, flat["length"], strict=True):
            digest.update(row[: 3 + int(length)].tobytes())
    return digest.hexdigest()
