"""A simulation without an end: of its records the last ticks stay, and it may be changed between ticks.

A plant of one's own may take the place of the simulated body: Python that moves by 1 ms a tick.

    def plant(voltage):                     # of the bridge [V]; None while it is off
        ...
        return {"omega": 1.0, "speed": 0.08, "current": 0.3}

It says the state after the tick: `omega` [rad/s] of the shell, `speed` [m/s] of the axle, `current` [A] of the motor,
and if it likes `alpha_rate` [rad/s] of the shell against the inner body (omega else: that hangs still), `position`
[m], `beta` and `alpha` [rad] (else the rates are summed), `contact_torque`, `motor_torque` [N m] and `load` [N].
Sensors with their faults, operator and the heat of the winding stay those of the scenario. A plant that is an object
may have `checkpoint()` and `restore(kept)`, and in the place of its call `drive(voltage, duty_q15, enabled)`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy.typing as npt

from terrapin_hil.errors import UserError
from terrapin_hil.scenario.faults import Fault
from terrapin_hil.scenario.scenario import CONTROLS, REQUESTS, Scenario
from terrapin_hil.scenario.wire_faults import Disturbance
from terrapin_hil.simulation import TICK, Simulation

__all__ = ["ROWS", "Endless", "OwnPlant", "Plant"]

ROWS = 1000  # ticks of the log that are kept at least
Plant = Callable[[float | None], Mapping[str, float]]
SLOWEST = 2.0  # s that a tick of it may take
NEEDED = ("omega", "speed", "current")
KNOWN = (*NEEDED, "alpha_rate", "position", "beta", "alpha", "contact_torque", "motor_torque", "load")


class Endless(Simulation):
    """`config` may be changed between ticks; `done` counts within the records, `ticks` since the start."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(replace(scenario, duration=2 * ROWS * TICK))
        self.gone = 0  # ticks whose records have gone

    @property
    def ticks(self) -> int:
        return self.gone + self.done

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self.ticks * TICK

    def rows(self, begin: int, end: int) -> npt.NDArray[Any]:
        return self.records[begin - self.gone : end - self.gone]

    def write_frames(self, first: int) -> None:
        super().write_frames(first - self.gone)

    def _slide(self) -> None:
        if self.done == len(self.records):
            self.records[:ROWS] = self.records[-ROWS:]
            self.gone += len(self.records) - ROWS
            self.done = ROWS

    def run(self, step: int, state: int, ticks: int) -> None:
        end = self.ticks + ticks
        while self.ticks < end:
            super().run(step, state, end - self.ticks)
            self._slide()

    def answer(self, frames: Any) -> None:
        super().answer(frames)
        self._slide()

    def coast(self) -> None:
        """A tick without a controller: the bridge is open."""
        self.drive(None, 1)
        self._slide()

    def set_faults(self, faults: Sequence[Fault]) -> None:
        """These in place of all others. ValueError when there are too many."""
        there = self.config.faults
        if len(faults) > len(there.fault):
            raise ValueError(f"found {len(faults)} faults, expected at most {len(there.fault)}")
        there.count = 0
        for fault in faults:
            self.set_fault(fault)
        self._disturbance = Disturbance(faults, self.scenario.seed)

    def order(self, request: str, control: str, setpoint: float, limiter: bool | None = None) -> None:
        """What the operator asks for from now on; `limiter`: as before where it is None."""
        config = self.config
        if limiter is None:
            limiter = bool(config.order[max(0, config.order_count - 1)].limiter)
        config.order_count = 1
        config.order[0] = {
            "time": 0.0,
            "request": REQUESTS[request],
            "control": CONTROLS[control],
            "limiter": limiter,
            "setpoint": max(-32768, min(32767, round(setpoint * 1000))),
        }

    def checkpoint(self) -> tuple[Any, ...]:
        """All that the ticks to come depend on; for `restore` of this object."""
        state = bytes(self._ffi.buffer(self._simulator))
        return state, self.records[: self.done].copy(), self.gone, self._disturbance.checkpoint()

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Back to a `checkpoint`."""
        state, records, self.gone, disturbance = kept
        self._ffi.memmove(self._simulator, state, len(state))
        self.records[: len(records)] = records
        self.done = len(records)
        self._disturbance = Disturbance.restored(disturbance)


class OwnPlant:
    """The caller's plant behind the compiled simulator; what it raises is kept until `check`."""

    def __init__(self, plant: Plant, simulation: Simulation) -> None:
        if not callable(plant):
            raise UserError(f"plant: found a {type(plant).__name__}, expected a function of the voltage")
        self._plant, self._simulation = plant, simulation
        self._drive: Callable[[float, int, bool], Mapping[str, float]] | None = getattr(plant, "drive", None)
        self._error: BaseException | None = None
        self._native = simulation.set_plant(self._moved, self._failed)  # kept alive: the C side holds its address

    def _moved(self, context: Any, voltage: float, enabled: bool, body: Any) -> None:
        if self._error is not None:
            return
        began = time.monotonic()
        if self._drive is not None:  # one that asks for the bridge as it is told
            said = self._drive(voltage, self._simulation.duty, enabled)
        else:
            said = self._plant(voltage if enabled else None)
        position, rate = body.position, body.rate
        omega, speed, turning = said["omega"], said["speed"], said.get("alpha_rate", said["omega"])
        position[0] = said["position"] if "position" in said else position[0] + TICK * speed
        position[1] = said["beta"] if "beta" in said else position[1] + TICK * omega
        position[2] = said["alpha"] if "alpha" in said else position[2] + TICK * turning
        rate[0], rate[1], rate[2] = speed, omega, turning
        body.current = said["current"]
        if len(said) > len(NEEDED):
            for name in said:
                if name not in KNOWN:
                    raise UserError(f"plant: found {name}, expected one of {', '.join(KNOWN)}")
            body.friction[1] = said.get("contact_torque", 0.0)
            body.motor_torque = said.get("motor_torque", 0.0)
            body.load = said.get("load", body.load)
        took = time.monotonic() - began
        if took > SLOWEST:
            raise UserError(f"plant: a tick took {took:.1f} s, expected at most {SLOWEST:g} s", status=1)

    def _failed(self, kind: type[BaseException], error: BaseException, trace: Any) -> None:
        if isinstance(error, KeyError) and error.args and error.args[0] in NEEDED:
            error = UserError(f"plant: it does not say {error.args[0]}, expected {', '.join(NEEDED)}")
        elif isinstance(error, TypeError | AttributeError) and trace.tb_next is None:
            error = UserError(f"plant: found {error}, expected numbers by name: {', '.join(KNOWN)}")
        self._error = error

    def checkpoint(self) -> Any:
        """What the plant keeps of itself. UserError when it does not."""
        if not hasattr(self._plant, "checkpoint") or not hasattr(self._plant, "restore"):
            raise UserError("checkpoint: found a plant of one's own, expected one with checkpoint() and restore(kept)")
        return self._plant.checkpoint()

    def restore(self, kept: Any) -> None:
        """Back to a `checkpoint`."""
        self._plant.restore(kept)  # type: ignore[attr-defined]  # `checkpoint` looked

    def check(self) -> None:
        """Raises what the plant raised."""
        if self._error is not None:
            raise self._error
