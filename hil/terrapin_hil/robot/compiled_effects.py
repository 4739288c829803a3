"""Effects of a scenario for the plant: their formulas as instructions (program.h) that hold the parameters' values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from terrapin_hil.errors import UserError
from terrapin_hil.library import ffi
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.program import ROLES as SLOTS
from terrapin_hil.physics.program import Instruction, instructions
from terrapin_hil.robot.plant import Robot

__all__ = ["ROLES", "TARGETS", "ActiveEffect", "CompiledEffects", "EffectError", "compile_effects", "drags", "in_plant"]

ROLES = (
    *("time", "omega", "angle", "slip", "speed", "load", "slope", "temperature", "voltage", "moisture", "pass_"),
    "swing_angle",
)
SOFT = ("bulldozing_resistance",)  # on a contact model's ground
# as in effects.h, after passive and active resistance
TARGETS = ("torque_constant", "armature_resistance", "coulomb", "viscous", "f_o", "drag", "gear_efficiency")


def in_plant(effect: Effect) -> bool:
    """Whether the simulated robot can have the effect: in its equations, or as a setting of its sensors."""
    return effect.plant and bool(set(Robot.bases) & set(effect.bases))


def drags(effect: Effect) -> bool:
    """Whether the effect resists the axle on a contact model's ground: of the base models that is (SoftGround.base)."""
    return effect.plant and effect.target == "drag"


class EffectError(UserError, ValueError):
    """An effect cannot act in the plant; the message says which and why."""


@dataclass(frozen=True)
class ActiveEffect:
    """An effect that is switched on, with values for all its parameters."""

    effect: Effect
    values: Mapping[str, float]


@dataclass(frozen=True)
class CompiledEffects:
    """`native` is a hil_effects; `kept` holds what it points to and must live as long."""

    native: Any
    kept: tuple[Any, ...]


def _target(effect: Effect) -> int:
    if effect.target == "resistance":
        return 0 if effect.passive else 1
    if effect.target in TARGETS:
        return 2 + TARGETS.index(effect.target)
    raise EffectError(f"{effect.name}: the plant cannot take an effect on '{effect.target}'")


def _code(active: ActiveEffect, constants: Mapping[str, float]) -> list[Instruction]:
    effect = active.effect
    if not in_plant(effect) and not drags(effect):
        raise EffectError(f"{effect.name}: the plant cannot take this effect")
    numbers = {**constants, **effect.options, **active.values}
    try:
        return instructions(effect.expression, {role: SLOTS[role] for role in (*ROLES, *SOFT)}, numbers)
    except KeyError as error:
        raise EffectError(f"{effect.name}: the plant has no {error}") from None


def compile_effects(effects: Sequence[ActiveEffect], constants: Mapping[str, float]) -> CompiledEffects:
    """Effects for the plant, those of sensors apart. EffectError when one cannot act in it.

    `constants` are the model's parameters by name (radius, f_o, ...); the load is a role.
    """
    code: list[Instruction] = []
    terms = []
    for active in effects:
        if not active.effect.sensor:  # those set the sensors
            own = _code(active, constants)
            outside = active.effect.where == "ground" or drags(active.effect)
            terms.append((int(outside), _target(active.effect), len(code), len(own)))
            code += own
    f = ffi()
    kept = f.new("hil_effect[]", terms), f.new("hil_instruction[]", code)
    return CompiledEffects(f.new("hil_effects *", (len(terms), *kept))[0], kept)
