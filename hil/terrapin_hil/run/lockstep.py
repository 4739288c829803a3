"""Ticks of a simulation with a controller, and who watches them: what every run is made of."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from terrapin_hil.errors import UserError
from terrapin_hil.links.link import Link
from terrapin_hil.simulation import TICK, Simulation

__all__ = ["DivergedError", "Lockstep", "Observer"]


class DivergedError(UserError):
    """The simulated robot moves in a way that the plant cannot follow."""


class Observer(Protocol):
    """Sees the log as it grows."""

    def write(self, records: npt.NDArray[Any]) -> None:
        """The next rows of the log, in order."""


class Lockstep:
    """A simulation over an open link; `observers` get every tick, whatever makes a run fail."""

    def __init__(self, simulation: Simulation, link: Link, observers: Iterable[Observer] = ()) -> None:
        self.simulation, self.link, self.observers = simulation, link, tuple(observers)
        self._written = simulation.ticks

    def advance(self, ticks: int) -> None:
        """So many ticks more, fewer than the log holds. LinkError, DivergedError."""
        self.link.advance(self.simulation, ticks)

    def settle(self, whole: bool) -> None:
        """Hands on what was logged; not `whole`: on a bus a tick's telemetry may come with the next tick's answer, so
        its row is kept back until then. DivergedError once the plant's numbers have run away."""
        self.flush(whole)
        self._require_motion()

    def flush(self, whole: bool = True) -> None:
        """Hands on what was logged."""
        simulation, first = self.simulation, self._written
        end = simulation.ticks if whole else max(first, simulation.ticks - 1)
        if self.observers:
            simulation.write_frames(first)
            rows = simulation.rows(first, end)
            self._written = simulation.ticks  # an observer that fails is not asked again
            for observer in self.observers:
                observer.write(rows)
        self._written = end

    def _require_motion(self) -> None:
        simulation = self.simulation
        truth = simulation.records["truth"]
        if simulation.done == 0 or np.all(np.isfinite(truth[simulation.done - 1])):
            return
        row = int(np.flatnonzero(~np.isfinite(truth[: simulation.done]).all(axis=1))[0])
        tick = row + simulation.ticks - simulation.done
        raise DivergedError(
            f"{simulation.scenario.name}: the simulated motion has no finite value at {tick * TICK:.3f} s: "
            "robot or effects are beyond what steps of 1 ms can follow",
            status=1,
        )
