"""Runs a scenario over a link.

    from pathlib import Path
    from terrapin_hil.run.run import run
    from terrapin_hil.scenario.scenario import load_scenario

    result = run(load_scenario(Path("terrapin_hil/scenario/scenarios/steady_sand.toml")))      # in this process
    result.truth["contact_torque"], result.truth["slip"]                     # arrays, one value a tick, SI
    result.telemetry["GROUND"]["torque"], result.telemetry["GROUND"]["time"] # decoded, SI, one value a frame
    result.passed, result.outcomes, result.output_hash

`dataclasses.replace(scenario, seed=7)` and its like make variants. `run(scenario, "pty")` takes the controller's
process; `parameters={"name": value}` sets controller parameters in their units, over those of the scenario.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.links import LinkName, open_link
from terrapin_hil.links.link import Link
from terrapin_hil.messages import Interface, interface
from terrapin_hil.robot.truth import TRUTH
from terrapin_hil.run.endless import OwnPlant, Plant
from terrapin_hil.run.lockstep import DivergedError, Lockstep, Observer
from terrapin_hil.run.reaction import reaction
from terrapin_hil.scenario.checks import CheckError, Outcome
from terrapin_hil.scenario.faults import Provocation
from terrapin_hil.scenario.scenario import Scenario
from terrapin_hil.simulation import TICK, Simulation, output_hash
from terrapin_hil.telemetry import decode, signals, words

__all__ = ["DivergedError", "Observer", "Result", "Timing", "run"]


CHUNK = 500  # ticks between looks at progress, log and Ctrl-C
LIVE_CHUNK = 33  # the same in real time, where somebody may be watching


@dataclass(frozen=True)
class Timing:
    """Wall clock of a run [s]; lateness of ticks against their time, for real-time runs."""

    seconds: float = 0.0
    latest: float = 0.0
    rms: float = 0.0


@dataclass
class Result:
    """A run, or what there is of one that was cut short."""

    scenario: Scenario
    link: str
    parameters: Mapping[str, float]
    records: npt.NDArray[Any]
    interface: Interface
    outcomes: tuple[Outcome, ...] = ()
    timing: Timing = field(default_factory=Timing)

    @property
    def passed(self) -> bool:
        """Every check of the scenario held."""
        return all(outcome.passed for outcome in self.outcomes)

    @cached_property
    def output_hash(self) -> str:
        """SHA-256 over every frame that the controller sent."""
        return output_hash(self.records)

    @cached_property
    def truth(self) -> dict[str, Array]:
        """Column of the plant's truth -> one value a tick."""
        return {name: self.records["truth"][:, i] for i, name in enumerate(TRUTH)}

    @cached_property
    def time(self) -> Array:
        """Time of each tick [s]."""
        return np.arange(len(self.records), dtype=np.float64) * TICK

    @cached_property
    def telemetry(self) -> Mapping[str, dict[str, Array]]:
        """Message -> signal (and "time") -> one value a frame, SI."""
        frames = self.records["answer"]
        used = np.arange(frames.shape[1]) < self.records["answer_count"][:, None]
        times = np.broadcast_to(self.time[:, None], used.shape)[used]
        flat = frames[used]
        return decode(self.interface, times, flat["id"], flat["data"])

    def held(self, message: str, signal: str) -> Array:
        """A signal of the telemetry on the grid of ticks, last value held, NaN before the first."""
        table = self.telemetry.get(message)
        if table is None:
            return np.full(len(self.records), np.nan)
        ticks = np.round(table["time"] / TICK).astype(np.int64)
        index = np.searchsorted(ticks, np.arange(len(self.records)), side="right") - 1
        return np.where(index < 0, np.nan, table[signal][index])

    @property
    def signals(self) -> Mapping[str, Array]:
        """Truth and telemetry by name, each (ticks,): what checks speak of."""
        return _Signals(self)

    def _provoked(self) -> list[Provocation]:
        """The scenario's own provocation, and at the same time the faults whose description names the scenario too."""
        own = self.scenario.provokes
        if own is None:
            return []
        named = {fault["name"] for fault in self.interface.json["faults"] if self.scenario.name in fault["scenarios"]}
        others = sorted(named - {own.fault}) if own.fault in named else []
        return [own, *(replace(own, fault=other) for other in others)]

    def check(self) -> tuple[Outcome, ...]:
        """Holds the scenario's checks and the times of the faults that it provokes against the run, and keeps them.

        CheckError names a check that cannot be held.
        """
        found, enums = self.signals, words(self.interface)
        outcomes = []
        for check in self.scenario.checks:
            try:
                outcomes.append(check.evaluate(self.time, found, enums))
            except CheckError as error:
                raise CheckError(f"check {check.text!r}: {error}") from None
        for provoked in self._provoked():
            outcomes += reaction(provoked, self.interface, self.held)
        self.outcomes = tuple(outcomes)
        return self.outcomes


class _Signals(Mapping[str, Array]):
    """Truth and telemetry by name, each decoded when it is asked for."""

    def __init__(self, result: Result) -> None:
        self._result = result
        self._names = {**dict.fromkeys(TRUTH, ("", "")), **signals(result.interface)}

    def __getitem__(self, name: str) -> Array:
        message, signal = self._names[name]
        return self._result.held(message, signal) if message else self._result.truth[name]

    def __iter__(self) -> Any:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _real_time(run: Lockstep, ticks: int, start: float, late: list[float]) -> None:
    for _ in range(ticks):
        due = start + run.simulation.done * TICK
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        late.append(time.monotonic() - due)
        run.advance(1)


def run(
    scenario: Scenario,
    link: str | LinkName | Link = "inprocess",
    *,
    parameters: Mapping[str, float] | None = None,
    observers: Iterable[Observer] = (),
    progress: Callable[[float], None] | None = None,
    plant: Plant | None = None,
) -> Result:
    """Runs `scenario` and holds its checks against it.

    `link` is a name (see links) or an open link, which is then left open. `progress` gets the share done, 0 to 1.
    `plant` moves in the place of the simulated body (endless.py). Observers get every tick up to the moment at which a
    run fails, whatever made it fail. LinkError, ParameterError, CheckError, EffectError, DivergedError.
    """
    values = {**scenario.firmware, **(parameters or {})}
    with contextlib.ExitStack() as stack:
        opened = stack.enter_context(open_link(link)) if isinstance(link, str | LinkName) else link
        simulation = Simulation(scenario)
        own = OwnPlant(plant, simulation) if plant is not None else None
        opened.start(values)
        begin, late = time.monotonic(), list[float]()
        lockstep = Lockstep(simulation, opened, observers)
        try:
            while simulation.done < scenario.ticks:
                ticks = min(LIVE_CHUNK if scenario.real_time else CHUNK, scenario.ticks - simulation.done)
                if scenario.real_time:
                    _real_time(lockstep, ticks, begin, late)
                else:
                    lockstep.advance(ticks)
                if own is not None:
                    own.check()
                lockstep.settle(whole=simulation.done == scenario.ticks)
                if progress is not None:
                    progress(simulation.done / scenario.ticks)
        except BaseException:
            lockstep.flush()
            raise
        seconds = time.monotonic() - begin
    timing = Timing(seconds, max(late), float(np.sqrt(np.mean(np.square(late))))) if late else Timing(seconds)
    result = Result(scenario, opened.name, values, simulation.records, interface(), timing=timing)
    result.check()
    return result
