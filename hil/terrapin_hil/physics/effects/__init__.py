"""The catalogue of physical effects: one file an effect, found by looking into this folder.

An effect states its equation, its source, its parameters with units and bounds, what it needs and what it changes.
The simulator (which runs `expression` inside the plant's loop), the workbench (which evaluates it over arrays) and
the export to the firmware all use that one file; nothing else in the program knows an effect's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from math import inf

from terrapin_hil.catalogues import entries

__all__ = ["Effect", "Parameter", "catalogue"]


@dataclass(frozen=True)
class Parameter:
    """One fitted parameter of an effect. `start`, `minimum` and `maximum` are in `unit` (pint's spelling).

    `grid` holds further values from which a fit starts, for a parameter that shapes the effect (a phase, a threshold):
    a fit that starts from one value only would stop in the nearest hollow.
    """

    name: str
    unit: str
    start: float
    minimum: float = -inf
    maximum: float = inf
    meaning: str = ""
    whole: bool = False  # takes whole numbers only (a harmonic's order)
    grid: tuple[float, ...] = ()


@dataclass(frozen=True)
class Effect:
    """A physical effect that a base model may lack.

    `target` says what the effect acts on: "resistance" (the expression is a torque dC [N m] added to the resisting
    side), "rolling_resistance" (the same, on the shell of a pendulum sphere instead of in its joint), "drag" (contact
    models: a force X [N] that traction - X and torque - R X feel), "axle" (there: one that
    traction - X feels alone), the name of a channel (the expression is added to it), "encoder" or "measured" (dynamic
    models: the channels that an encoder gives, or all), or the name of a model parameter or of what drives a dynamic
    model (which is multiplied by 1 + expression). Names in the expression are roles, parameters of the model, and the
    effect's own parameters; temperatures are in degC.

    The first parameter is the effect's size: where it is 0 the effect is absent, whatever the others are.
    """

    name: str
    title: str  # a few words, for people
    equation: str  # as LaTeX
    source: str  # paper and equation, or where else it comes from
    bases: tuple[str, ...]  # base models that it can be added to
    parameters: tuple[Parameter, ...]
    needs: tuple[tuple[str, ...], ...]  # each entry: roles of which one must be mapped
    expression: str
    target: str = "resistance"
    usual: str = ""  # magnitude that the size has as a rule; roles in it stand for their largest magnitudes
    laws: tuple[str, ...] = ()  # of two effects that share one, on the same target, one is true at most
    additive: bool = False  # target is a parameter: the expression is added to it, not multiplied on
    stage: str = (
        "channel"  # target is a channel: "channel" adds, then "gain" multiplies by 1 + it, then "measured" adds
    )
    constants: Mapping[str, str] = field(default_factory=dict)  # known constants of [parameters]: name -> unit
    options: Mapping[str, float] = field(default_factory=dict)  # names that [parameters] may set: name -> default
    positive: tuple[str, ...] = ()  # roles that must be above 0 in every row
    reverses: tuple[str, ...] = ()  # roles that must take both signs (physics/mechanics)
    channels: tuple[str, ...] = ("",)  # units of the channels that it may act on (physics/mechanics)
    on: Mapping[str, str] = field(default_factory=dict)  # base model -> target there, where it is another
    # dynamic models: the target as measured is late by the expression ("delay" [s]), follows it through a gap ("play"
    # [rad]), or errs by it in the angle that is measured ("angle" [rad]); equations of the user's own: the inputs act
    # later by it ("inputs" [s]); equation: the expression may name `played`, the position through a gap w ("play"), or
    # `rate`, the derivative of the speed by time ("rate"), or is the time constant of a low-pass that the channel as
    # measured has gone through ("lag", which is its stage, too)
    transform: str = ""
    sensor: Mapping[str, str] = field(default_factory=dict)  # in the plant: CHANNEL.SETTING of sensors -> own parameter
    where: str = "robot"  # in the plant: a torque inside the robot (on alpha), or "ground": on the shell, part of C_t
    passive: bool = False  # opposes motion and vanishes at rest: friction in the plant, set-valued at standstill
    plant: bool = True  # the plant can switch it on
    firmware: Mapping[str, str] = field(default_factory=dict)  # controller parameter that compensates it -> formula


@cache
def catalogue() -> dict[str, Effect]:
    """Every effect in this folder by name, sorted. Each module defines one `EFFECT`."""
    return entries(__name__, __path__, "EFFECT")
