"""A robot in lockstep with its controller, moved on by a program, tick by tick, as long as it likes.

with Session("steady_sand", "pty", seed=3) as s:
    s.until("GROUND.valid", timeout=20.0)
    s["GROUND.torque"], s.truth["contact_torque"]      # SI, as of the last tick
    s.inject("stuck", "motor")
    s.step(0.5)
    s.faults, s.state
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from terrapin_hil.errors import UserError
from terrapin_hil.links import LinkName, open_link
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import Link, LinkError
from terrapin_hil.links.wire import write_parameters
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.reading import Section
from terrapin_hil.robot.truth import TRUTH
from terrapin_hil.robots import select
from terrapin_hil.run.endless import Endless, OwnPlant, Plant
from terrapin_hil.run.lockstep import Lockstep, Observer
from terrapin_hil.scenario.faults import Fault, read_fault
from terrapin_hil.scenario.scenario import (
    CONTROLS,
    LIMITS,
    REQUESTS,
    Scenario,
    find_scenario,
    load_scenario,
    take_scenario,
)
from terrapin_hil.simulation import TICK
from terrapin_hil.telemetry import si_factor, signals

__all__ = ["LateError", "Plant", "Session", "chosen_scenario"]

CHUNK = 500  # ticks between looks at log and Ctrl-C
SETTLED = 100  # the same where a condition is looked at in each tick
FEW = 8  # ticks that are looked at one by one
LONGEST = 1e6  # s of one step
ATTEMPTS = 3  # a question to the controller may be lost


class LateError(UserError, TimeoutError):
    """What a session waited for did not come."""

    def __str__(self) -> str:
        return str(self.args[0])


def chosen_scenario(
    scenario: str | Path | Scenario, robot: str = "", changes: Mapping[str, Any] | None = None
) -> Scenario:
    """The scenario that a program means, see `Session`. `robot`, or the one it is for, becomes that of this process."""
    if isinstance(scenario, Scenario):
        return scenario
    if robot:
        select(robot)
    return load_scenario(take_scenario(str(scenario), robot), dict(changes or {}))


class Session:
    """A scenario without its end. Closed at the end of a with-block, whatever happens in it."""

    def __init__(
        self,
        scenario: str | Path | Scenario,
        link: str | LinkName | Link = "inprocess",
        *,
        seed: int | None = None,
        robot: str = "",
        parameters: Mapping[str, float] | None = None,
        changes: Mapping[str, Any] | None = None,
        plant: Plant | None = None,
        observers: Iterable[Observer] = (),
    ) -> None:
        """
        Parameters
        ----------
        scenario : the name of a shipped one, a file, or one that was made.
        link : where the controller is (terrapin_hil.links.names); an open link is left open.
        seed : in place of the scenario's.
        robot : a shipped one or a file; it becomes that of this process.
        parameters : of the controller, in their units, over the scenario's.
        changes : fields of the scenario in place of the file's, {"path.1.slope": "3deg"}.
        plant : of one's own in the place of ours, see `own_plant`.
        observers : get each tick's record.

        Raises
        ------
        UserError : the scenario, a change or a parameter is wrong; LinkError : the controller cannot be had.
        """
        chosen = chosen_scenario(scenario, robot, changes)
        if seed is not None:
            if seed < 0:
                raise UserError(f"seed: found {seed}, expected 0 or more")
            chosen = replace(chosen, seed=seed)
        self.scenario = chosen
        self._interface = interface()
        self._signals = signals(self._interface)
        self._simulation = Endless(chosen)
        self._plant = OwnPlant(plant, self._simulation) if plant is not None else None
        self._faults = list(chosen.faults)
        self._sender = Sender(self._interface)
        self._latest: dict[int, tuple[float, bytes]] = {}  # identifier -> when it was sent [s], data
        self._seen = 0
        self._own = not isinstance(link, Link)
        self._link = link if isinstance(link, Link) else open_link(link)
        try:
            self._link.start({**chosen.firmware, **(parameters or {})})
        except BaseException:
            self.close()
            raise
        self._lockstep: Lockstep | None = Lockstep(self._simulation, self._link, observers)

    # -- time ----------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._simulation.time

    @property
    def ticks(self) -> int:
        """Of 1 ms, done since the start."""
        return self._simulation.ticks

    def step(self, seconds: float = TICK) -> Self:
        """So much further. UserError for no whole number of ticks; LinkError, DivergedError."""
        ticks = round(seconds / TICK) if 0.0 < seconds <= LONGEST else 0
        if not ticks or abs(ticks * TICK - seconds) > 1e-6 * TICK * ticks:
            raise UserError(f"step: found {seconds!r} s, expected whole milliseconds, up to {LONGEST:g} s")
        self._advance(ticks)
        return self

    def until(self, condition: str | Callable[[Self], object], timeout: float) -> Self:
        """Tick by tick, until a signal is there and not 0, or a function of this session is true.

        LateError when that is not so within `timeout` [s of the simulation].
        """
        if isinstance(condition, str):
            self._require(condition)
        end = self.ticks + max(0, round(timeout / TICK))
        while not (self._there(condition) if isinstance(condition, str) else condition(self)):
            if self.ticks >= end:
                name = condition if isinstance(condition, str) else getattr(condition, "__name__", "the condition")
                found = f"it is {self.get(condition):g}" if isinstance(condition, str) else "it is not so"
                raise LateError(f"until: {name} did not come within {timeout:g} s: at {self.time:.3f} s {found}", 1)
            self._advance(1, settled=self.ticks % SETTLED == 0)
        return self

    def _there(self, name: str) -> bool:
        value = self.get(name)
        return value == value and value != 0.0

    def _advance(self, ticks: int, settled: bool = True) -> None:
        if self._lockstep is None:
            raise UserError("session: found it closed, expected an open one")
        end = self.ticks + ticks
        try:
            while self.ticks < end:
                self._lockstep.advance(min(CHUNK, end - self.ticks))
                if self._plant is not None:
                    self._plant.check()
                self._look()
                if settled:
                    self._lockstep.settle(whole=False)
        except BaseException:
            with suppress(LinkError):
                self._lockstep.flush()
            raise

    def _look(self) -> None:
        """The last frame of each kind. The last row is looked at again: on a bus its telemetry may come late."""
        simulation = self._simulation
        begin = max(self._seen, simulation.gone)
        if simulation.ticks - begin < FEW:
            for tick in range(begin, simulation.ticks):
                for identifier, data in simulation.answers(tick):
                    self._latest[identifier] = tick * TICK, data
        else:
            frames, counts = (simulation.rows(begin, simulation.ticks)[name] for name in ("answer", "answer_count"))
            at, place = np.nonzero(np.arange(frames.shape[1]) < counts[:, None])
            found, last = np.unique(frames["id"][at, place][::-1], return_index=True)
            for identifier, back in zip(found.tolist(), last.tolist(), strict=True):
                frame = frames[at[-1 - back], place[-1 - back]]
                data = bytes(frame["data"][: int(frame["length"])])
                self._latest[identifier] = (begin + int(at[-1 - back])) * TICK, data
        self._seen = max(0, simulation.ticks - 1)

    # -- what is known -------------------------------------------------------------------------------------------------

    @property
    def truth(self) -> dict[str, float]:
        """The plant's true state at the last tick by name, SI; empty before the first."""
        simulation = self._simulation
        if not simulation.done:
            return {}
        return dict(zip(TRUTH, simulation.records["truth"][simulation.done - 1].tolist(), strict=True))

    @property
    def signals(self) -> dict[str, float]:
        """Every signal that the controller has sent by now, MESSAGE.signal -> its last value, SI."""
        return {name: self.get(name) for name, (message, _) in self._signals.items() if self._frame(message)}

    def __getitem__(self, name: str) -> float:
        """The last value of MESSAGE.signal, SI. UserError when there is none of that name, or it has not come yet."""
        value = self.get(name)
        if value != value:
            raise UserError(f"{name}: the controller has not sent it yet, expected a few ticks more")
        return value

    def get(self, name: str) -> float:
        """The same; NaN for one that has not come yet."""
        self._require(name)
        message, signal = self._signals[name]
        data = self._frame(message)
        if data is None:
            return float("nan")
        found = self._interface.messages[message]
        one = next(each for each in found.signals if each.name == signal)
        return float(found.decode(data)[signal] * (one.scale * si_factor(one.unit)))

    def word(self, name: str) -> str:
        """The last value of a signal whose values have names. UserError as for a signal."""
        value = self[name]
        message, signal = self._signals[name]
        enum = next(one.enum for one in self._interface.messages[message].signals if one.name == signal)
        words = {number: word for word, number in self._interface.enums[enum].items()} if enum else {}
        return words.get(round(value), f"{value:g}")

    @property
    def state(self) -> str:
        """Of the controller: idle, run, safe, ..."""
        return self.word("STATUS.state")

    @property
    def faults(self) -> frozenset[str]:
        """Names of the faults that the controller reports."""
        bits = round(self["STATUS.faults"])
        return frozenset(fault["name"] for fault in self._interface.json["faults"] if bits >> fault["number"] & 1)

    def _require(self, name: str) -> None:
        if name not in self._signals:
            near = [known for known in self._signals if known.partition(".")[0] == name.partition(".")[0]]
            expected = ", ".join(near or sorted({known.partition(".")[0] for known in self._signals}))
            raise UserError(f"{name}: no such signal, expected one of {expected}")

    def _frame(self, message: str) -> bytes | None:
        found = self._latest.get(self._interface.messages[message].id)
        return found[1] if found else None

    # -- what is done to it --------------------------------------------------------------------------------------------

    def inject(self, kind: str, channel: str = "", value: float | None = None, *, lasting: float | None = None) -> Self:
        """A fault from the next tick on, one more; `lasting` [s], for good without it.

        `kind` is one of docs/scenarios.md, with the `channel` and `value` that it has, or the name of a shipped
        scenario, whose faults then all begin. UserError for another.
        """
        if any(path.stem == kind for path in find_scenario("steady_sand").parent.glob("*.toml")):
            found = list(load_scenario(find_scenario(kind)).faults)
            if not found:
                raise UserError(f"inject: scenario {kind} has no fault, expected one with")
        else:
            table = {"kind": kind, **({"channel": channel} if channel else {})}
            found = [read_fault(Section(table | ({} if value is None else {"value": value}), "inject", ""))]
        begin = self.time
        end = begin + lasting if lasting is not None else Fault("stuck").end
        return self._set([*self._faults, *(replace(fault, begin=begin, end=end) for fault in found)])

    def clear(self) -> Self:
        """No fault any more, those of the scenario included."""
        return self._set([])

    def _set(self, faults: list[Fault]) -> Self:
        try:
            self._simulation.set_faults(faults)
        except ValueError as error:
            raise UserError(f"inject: {error}") from None
        self._faults = faults
        return self

    def order(self, request: str, setpoint: float = 0.0, control: str = "voltage", limiter: bool | None = None) -> Self:
        """What the operator asks for from now on, in place of the scenario's: run at so many V, or m/s of the rim."""
        for name, known, given in (("request", REQUESTS, request), ("control", CONTROLS, control)):
            if given not in known:
                raise UserError(f"{name}: found {given!r}, expected one of {', '.join(known)}")
        unit, limit = LIMITS[control]
        if not -limit <= setpoint <= limit:
            raise UserError(f"setpoint: found {setpoint:g}, expected {-limit:g} to {limit:g} {unit}")
        self._simulation.order(request, control, setpoint, limiter)
        return self

    def read(self, parameter: str) -> float:
        """A parameter of the controller, in its unit. ParameterError for one that it does not know."""
        known = self._interface.parameter(parameter)
        answer = self._interface.messages["PARAMETER_VALUE"]
        for _ in range(ATTEMPTS):
            frame = self._sender.frame("PARAMETER_READ", {"index": known.index})
            found = self._link.ask(frame, lambda one: one[0] == answer.id and len(one[1]) == answer.length)
            if found is not None and answer.decode(found[1])["index"] == known.index:
                return float(answer.decode(found[1])["value"] * known.scale)
        raise LinkError(f"{self._link.name}: the controller does not say {parameter}")

    def write(self, parameter: str, value: float | str) -> Self:
        """Sets a parameter, in its unit or as "500 ms". ParameterError when it is none, or the controller refuses: out
        of range, or bridge on."""
        number = self._interface.parameter(parameter).number(value)
        answer = self._interface.messages["PARAMETER_VALUE"].id

        def asked(frames: Any) -> list[Frame]:
            found = [self._link.ask(frame, lambda one: one[0] == answer) for frame in frames]
            return [one for one in found if one is not None]

        for attempt in range(ATTEMPTS):
            try:
                write_parameters(self._sender, self._interface, {parameter: number}, asked)
                break
            except LinkError:
                if attempt == ATTEMPTS - 1:
                    raise
        return self

    # -- there and back ------------------------------------------------------------------------------------------------

    def checkpoint(self) -> Any:
        """The state of plant and controller, for `restore` of this session: what comes then is the same, bit for bit.

        UserError over a link whose controller's memory is its own, with an observer, which cannot forget, and with a
        plant of one's own without `checkpoint` and `restore`.
        """
        if not isinstance(self._link, InProcess):
            raise UserError(f"checkpoint: the link is {self._link.name}, expected inprocess: others keep their memory")
        if self._lockstep is None or self._lockstep.observers:
            raise UserError("checkpoint: found a session with a log, or a closed one, expected one without")
        plant = self._plant.checkpoint() if self._plant else None
        return (
            self,
            self._simulation.checkpoint(),
            self._link.checkpoint(),
            plant,
            dict(self._latest),
            list(self._faults),
        )

    def restore(self, kept: Any) -> Self:
        """Back to a `checkpoint` of this session. UserError for one of another."""
        if (
            not isinstance(kept, tuple)
            or len(kept) != 6
            or kept[0] is not self
            or not isinstance(self._link, InProcess)
        ):
            raise UserError("restore: found no checkpoint of this session, expected what its checkpoint() gave")
        _, simulation, controller, plant, self._latest, self._faults = kept
        self._latest, self._faults = dict(self._latest), list(self._faults)
        self._link.restore(controller)
        self._simulation.restore(simulation)
        if self._plant:
            self._plant.restore(plant)
        self._seen = max(0, self.ticks - 1)
        self._lockstep = Lockstep(self._simulation, self._link)
        return self

    def close(self) -> None:
        """Lets go of the controller; its bridge is off then. Closing twice is allowed."""
        lockstep, self._lockstep = getattr(self, "_lockstep", None), None
        try:
            if lockstep is not None:
                lockstep.flush()
        finally:
            if self._own:
                self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
