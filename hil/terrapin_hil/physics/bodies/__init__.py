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
from terrapin_hil.physics.program import FIRST, ROLES

__all__ = ["Body", "Drive", "bodies"]


@dataclass(frozen=True)
class Body:
    """A body that is integrated over the samples of a run.

    `parameters`: name -> unit and default (None: must be given), in the order of its C structs. `integrate` returns the
    motion (roles and whatever else formulas may name) and the channels, by name, as arrays over the samples.
    """

    name: str
    parameters: Mapping[str, tuple[str, float | None]]
    inputs: tuple[str, ...]  # roles that drive it
    channels: Mapping[str, str]  # name -> unit
    integrate: Callable[[Drive], tuple[dict[str, Array], dict[str, Array]]]
    longest_step: float = 2e-3  # [s]: 1e-5 of the rates at start-up, where friction turns on
    aliases: Mapping[str, str] = field(default_factory=dict)  # further names of parameters in formulas
    encoder: tuple[str, ...] = ()  # channels that an encoder gives
    states = ("omega", "angle", "acceleration", "slip", "speed", "load")  # roles that it computes itself

    def slots(self) -> dict[str, int]:
        """Slots of everything that formulas may name, but for the effects' own."""
        found = {**ROLES, **{name: FIRST + i for i, name in enumerate(self.parameters)}}
        return {**found, **{alias: found[name] for alias, name in self.aliases.items()}}


@dataclass(frozen=True)
class Drive:
    """One run to integrate: values at their slots, inputs over time, and the effects that act inside."""

    body: Body
    slots: Mapping[str, int]
    table: Array  # (slots,)
    time: Array  # (samples,) [s], rising
    columns: Mapping[str, Array]  # by name, each (samples,)
    start: float  # rate at the first sample [rad/s], 0 for rest
    effects: Any  # hil_additions *, NULL for none

    def value(self, name: str) -> Any:
        """A parameter's number."""
        return self.table[self.slots[name]]

    def inputs(self, *without: str) -> tuple[Array, list[int]]:
        """Columns that the body does not compute itself, (samples, columns), and their slots."""
        taken = {n: c for n, c in self.columns.items() if n not in self.body.states and n not in without}
        stacked = np.column_stack(list(taken.values())) if taken else np.zeros((len(self.time), 0))
        return np.ascontiguousarray(stacked), [self.slots[name] for name in taken]


@cache
def bodies() -> dict[str, Body]:
    """Every body in this folder by name, sorted. Each module defines one `BODY`."""
    return entries(__name__, __path__, "BODY")
