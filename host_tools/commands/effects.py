"""`terrapin effects`: the catalogue of physical effects, and each one explained."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from hil.physics.effects import Effect, catalogue
from host_tools.errors import UserError

__all__ = ["register"]


def effects(name: Annotated[str, typer.Argument(help="an effect to explain")] = "") -> None:
    """List the catalogue of effects, or explain one.

    Example: terrapin effects motor_heating
    """
    if name:
        if name not in catalogue():
            raise UserError(f"found {name!r}, expected one of {', '.join(catalogue())}")
        print(_explain(catalogue()[name]))
        return
    width = max(map(len, catalogue()))
    for base in dict.fromkeys(base for effect in catalogue().values() for base in effect.bases):
        print(f"On {base}:")
        for effect in catalogue().values():
            if base in effect.bases:
                print(f"  {effect.name.ljust(width)}  {effect.title}")


def _explain(effect: Effect) -> str:
    acts = {
        "resistance": "adds a resisting torque [N m]",
        "drag": "adds a resisting force X [N]: traction - X, torque - R X",
    }.get(effect.target)
    if acts is None:
        how = {
            "gain": "multiplies {} by 1 + it",
            "measured": "is added to the measured {}",
            "channel": "is added to {}",
        }
        channels = ("current", "traction", "torque", "sinkage")
        if effect.target in channels:
            acts = how[effect.stage].format(effect.target)
        else:
            acts = f"is added to {effect.target}" if effect.additive else f"multiplies {effect.target} by 1 + it"
    lines = [
        f"{effect.name}: {effect.title}",
        f"  equation    {effect.equation}",
        f"  source      {effect.source}",
        f"  formula     {effect.expression}",
        f"  acts        {acts}",
        f"  on          {', '.join(effect.bases)}",
    ]
    needs = [" or ".join(group) for group in effect.needs]
    lines.append(f"  needs       {', '.join([*needs, *effect.constants]) or 'nothing'}")
    for p in effect.parameters:
        bounds = f"{_bound(p.minimum)} to {_bound(p.maximum)}"
        whole = ", whole" if p.whole else ""
        lines.append(f"  parameter   {p.name} [{p.unit}]: {p.meaning} ({bounds}{whole})")
    for option, default in effect.options.items():
        lines.append(f"  option      {option} ({'true' if default else 'false'} unless [parameters] says otherwise)")
    lines.append(f"  simulator   {'can switch it on' if effect.plant else 'has no switch for it'}")
    lines.append(f"  controller  {', '.join(effect.firmware) or 'does not compensate it'}")
    return "\n".join(lines)


def _bound(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else ("-inf" if value < 0 else "inf")


def register(app: typer.Typer) -> None:
    app.command("effects")(effects)
