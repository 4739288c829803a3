"""Effects of a scenario as functions for the plant: C made from their expressions, compiled once, kept in a cache."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil import paths
from hil.library import ffi
from hil.physics.effects import Effect
from hil.physics.expression import parse

__all__ = [
    "ROLES",
    "TARGETS",
    "ActiveEffect",
    "CompiledEffects",
    "EffectError",
    "compile_effects",
    "in_plant",
    "source",
]

ROLES = ("time", "omega", "angle", "slip", "speed", "load", "slope", "temperature", "voltage", "moisture")
TARGETS = ("torque_constant", "armature_resistance", "coulomb", "viscous", "f_o")
SMALLEST_RATE = "1e-9"  # friction levels are taken at the magnitude of a rate that is never 0: sign(0) = 0


def in_plant(effect: Effect) -> bool:
    """Whether the simulated robot can have the effect: in its equations, or as a setting of its sensors."""
    return effect.plant and bool({"rolling_steady", "cmr"} & set(effect.bases))


class EffectError(ValueError):
    """An effect cannot act in the plant; the message says which and why."""


@dataclass(frozen=True)
class ActiveEffect:
    """An effect that is switched on, with values for all its parameters."""

    effect: Effect
    values: Mapping[str, float]


@dataclass(frozen=True)
class CompiledEffects:
    """Addresses of the functions for hil_effects, 0 for none. `library` keeps them alive."""

    robot: int = 0
    ground: int = 0
    library: Any = None


def _statement(active: ActiveEffect, constants: Mapping[str, float]) -> str:
    effect = active.effect
    if not in_plant(effect):
        raise EffectError(f"{effect.name}: the plant cannot take this effect")
    expression = parse(effect.expression)
    names: dict[str, str] = {}
    for name in expression.names:
        if name in active.values:
            names[name] = f"({active.values[name]!r})"
        elif name in constants:
            names[name] = f"({constants[name]!r})"
        elif name in ROLES or name == "pass_":
            names[name] = "roles.pass" if name == "pass_" else f"roles.{name}"
        else:
            raise EffectError(f"{effect.name}: the plant has no '{name}'")
    text = expression.to_c(names)
    if effect.target == "resistance":
        if not effect.passive:
            return f"    terms->active += {text};"
        rates = "".join(
            f"        roles.{rate} = fmax(fabs(roles.{rate}), {SMALLEST_RATE});\n" for rate in ("omega", "speed")
        )
        return f"    {{\n{rates}        terms->passive += {text};\n        roles = *given;\n    }}"
    if effect.target in TARGETS:
        return f"    terms->{effect.target} += {text};"
    raise EffectError(f"{effect.name}: the plant cannot take an effect on '{effect.target}'")


def source(effects: Sequence[ActiveEffect], constants: Mapping[str, float]) -> str:
    """C source with `hil_effect_robot` and `hil_effect_ground`. EffectError when an effect cannot act in the plant."""
    header = (paths.ROOT / "hil" / "physics" / "effects.h").read_text(encoding="utf-8")
    parts = ["#include <math.h>", header]
    for place in ("robot", "ground"):
        body = "\n".join(_statement(active, constants) for active in effects if active.effect.where == place)
        parts.append(
            f"void hil_effect_{place}(const hil_roles *given, hil_terms *terms) {{\n"
            f"    hil_roles roles = *given;\n    (void)roles;\n    (void)terms;\n{body}\n}}"
        )
    return "\n".join(parts) + "\n"


def _build(text: str, target: Path) -> None:
    compiler = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
    if compiler is None:
        raise EffectError("effects need a C compiler (cc, gcc or clang), and none is installed")
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        code, library = Path(folder) / "effects.c", Path(folder) / "effects.so"
        code.write_text(text, encoding="utf-8")
        command = [compiler, "-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-o", str(library), str(code)]
        done = subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise EffectError(f"the effects do not compile: {done.stderr.strip().splitlines()[0]}")
        os.replace(library, target)  # whole or not at all, whoever else builds the same


def compile_effects(effects: Sequence[ActiveEffect], constants: Mapping[str, float]) -> CompiledEffects:
    """Functions for the plant. `constants` are the model's parameters by name (radius, load is a role, f_o, ...)."""
    effects = [active for active in effects if not active.effect.sensor]  # those set the sensors
    if not effects:
        return CompiledEffects()
    text = source(effects, constants)
    target = paths.cache() / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.so"
    if not target.is_file():
        _build(text, target)
    f = ffi()
    library = f.dlopen(str(target))
    address = {
        place: int(f.cast("uintptr_t", f.addressof(library, f"hil_effect_{place}")))
        for place in ("robot", "ground")
        if any(active.effect.where == place for active in effects)
    }
    return CompiledEffects(address.get("robot", 0), address.get("ground", 0), library)
