"""The catalogue of physical effects: one file an effect, found by looking into this folder.

An effect states its equation, its source, its parameters with units and bounds, what it needs and what it changes.
The simulator (which compiles `expression` into the plant's loop), the workbench (which evaluates it over arrays, or calls
`apply` where an expression cannot say it) and the export to the firmware all use that one file; nothing else in the
program knows an effect's name.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

__all__ = ["Effect", "Parameter", "catalogue"]


@dataclass(frozen=True)
class Parameter:
    """One fitted parameter of an effect. `start`, `minimum` and `maximum` are in `unit` (pint's spelling)."""

    name: str
    unit: str
    start: float
    minimum: float
    maximum: float
    meaning: str
    whole: bool = False  # takes whole numbers only (a harmonic's order)


@dataclass(frozen=True)
class Effect:
    """A physical effect that a base model may lack.

    `target` says what the effect acts on: "resistance" (the expression is a torque dC [N m] added to the resisting
    side), the name of a channel (the expression is added to it), or the name of a model parameter (which is multiplied by
    1 + expression). Names in the expression are roles, parameters of the model, and the effect's own parameters.
    """

    name: str
    title: str  # a few words, for people
    equation: str  # as LaTeX
    source: str  # paper and equation, or where else it comes from
    bases: tuple[str, ...]  # base models that it can be added to
    parameters: tuple[Parameter, ...]
    needs: tuple[tuple[str, ...], ...]  # each entry: roles of which one must be mapped
    target: str = "resistance"
    expression: str = ""
    constants: tuple[str, ...] = ()  # known constants that must stand in [parameters]
    where: str = "robot"  # where the torque acts in the plant: "robot" (inside, on alpha) or "ground" (on the shell, part of C_t)
    passive: bool = (
        False  # opposes motion and vanishes at rest: the plant treats it as friction, set-valued at standstill
    )
    plant: bool = True  # the plant can switch it on
    apply: Callable[..., Any] | None = (
        None  # contact effects that no expression can say; see host_tools.workbench.models
    )
    firmware: Mapping[str, str] = field(
        default_factory=dict
    )  # effect parameter -> controller parameter that compensates it


@cache
def catalogue() -> dict[str, Effect]:
    """Every effect in this folder by name, sorted. Each module defines one `EFFECT`."""
    found = {}
    for info in sorted(pkgutil.iter_modules(__path__), key=lambda m: m.name):
        effect = importlib.import_module(f"{__name__}.{info.name}").EFFECT
        found[effect.name] = effect
    return found
