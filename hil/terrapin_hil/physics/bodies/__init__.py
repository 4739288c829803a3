"""The catalogue of bodies that are simulated over time: one file a body, found by looking into this folder.

A body states its parameters, what drives it, its channels and how it is integrated. Nothing else knows its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.catalogues import entries
from terrapin_hil.physics.compiled import pointer
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.program import FIRST, ROLES

__all__ = ["Body", "Drive", "bodies", "wheel_slip"]

SLOWEST = 0.3  # m/s of a wheel, below which its slip is told as there


@dataclass(frozen=True)
class Body:
    """A body that is integrated over the samples of a run.

    `parameters`: name -> unit and default (None: must be given), in the order of its C structs. `follow` integrates: it
    returns a record (samples, numbers) and what each neighbour changes in it (neighbours, samples, numbers), to first
    order; not finite from where there is no solution. `motion` (roles and whatever else formulas may name) and `read`
    (the channels) say what a record means at a table of values (slots,), by name, as arrays over the samples.
    """

    name: str
    parameters: Mapping[str, tuple[str, float | None]]
    inputs: tuple[str, ...]  # roles that drive it
    channels: Mapping[str, str]  # name -> unit
    follow: Callable[[Drive], tuple[Array, Array]]
    motion: Callable[[Drive, Array, Array], dict[str, Array]]
    read: Callable[[Drive, Array, Array], dict[str, Array]]
    aliases: Mapping[str, str] = field(default_factory=dict)  # further names of parameters in formulas
    swings: str = ""  # the parameter that is the arm of what swings in it
    encoder: tuple[str, ...] = ()  # channels that an encoder gives
    kin: str = ""  # another body, whose effects it takes as well, but
    holds: tuple[str, ...] = ()  # those that its own equations hold
    tabulated: tuple[str, ...] = ()  # parameters that a whole run has one value of: no effect may change them in it
    # roles that it computes itself
    states: tuple[str, ...] = ("omega", "angle", "acceleration", "slip", "speed", "load")

    def takes(self, effect: Effect) -> bool:
        """Whether the effect acts on this body."""
        return self.name in effect.bases or (self.kin in effect.bases and effect.name not in self.holds)

    def target(self, effect: Effect) -> str:
        """What it acts on here."""
        return effect.on.get(self.name, effect.on.get(self.kin, effect.target))

    def slots(self) -> dict[str, int]:
        """Slots of everything that formulas may name, but for the effects' own."""
        found = {**ROLES, **{name: FIRST + i for i, name in enumerate(self.parameters)}}
        return {**found, **{alias: found[name] for alias, name in self.aliases.items()}}


@dataclass(frozen=True)
class Drive:
    """One run to integrate: values at their slots, inputs over time, and the effects that act inside. The first row of
    `tables` is the run's own, further ones are its neighbours'."""

    body: Body
    slots: Mapping[str, int]
    tables: Array  # (1 + neighbours, slots)
    time: Array  # (samples,) [s], rising
    columns: Mapping[str, Array]  # by name, each (samples,)
    start: float  # rate at the first sample [rad/s], 0 for rest
    effects: Any  # hil_additions *, NULL for none
    shapes: Array | None = None  # (samples, count): for one neighbour, how many times as much it differs, over time

    def changes(self, numbers: int) -> tuple[Array, Any]:
        """An empty array for what neighbours, or shapes of one, change (count, samples, numbers), and the shapes."""
        count = len(self.tables) - 1 if self.shapes is None else self.shapes.shape[1]
        return np.full((count, len(self.time), numbers), np.nan), pointer(self.shapes)

    def inputs(self, *without: str) -> tuple[Array, list[int]]:
        """Columns that the body does not compute itself, (samples, columns), and their slots."""
        taken = {n: c for n, c in self.columns.items() if n not in self.body.states and n not in without}
        stacked = np.column_stack(list(taken.values())) if taken else np.zeros((len(self.time), 0))
        return np.ascontiguousarray(stacked), [self.slots[name] for name in taken]


def wheel_slip(speed: Array | float, omega: Array, radius: Array | float) -> Array:
    """Slip of a wheel [1] that turns with omega [rad/s] under a body with a speed [m/s]; below SLOWEST as if it went
    around so fast (the tyre's speed_floor)."""
    return np.asarray(1.0 - speed / np.maximum(omega * radius, SLOWEST))


@cache
def bodies() -> dict[str, Body]:
    """Every body in this folder by name, sorted. Each module defines one `BODY`."""
    return entries(__name__, __path__, "BODY")
