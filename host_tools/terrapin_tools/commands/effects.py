"""`terrapin effects`: the catalogue of physical effects, and each one explained."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_tools.command_options import Picture
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_hil.physics.effects import Effect

__all__ = ["effects"]


CHANNELS = ("current", "traction", "torque", "sinkage", "channel", "encoder")  # encoder: the rates that it measures
EQUATION = ("equation",)  # the base model whose effects are those of mechanics
ACTS = {
    "gain": "multiplies {} by 1 + it",
    "measured": "is added to the measured {}",
    "channel": "is added to {}",
}
FORCES = {
    "resistance": "adds a resisting torque [N m]",
    "drag": "adds a resisting force X [N]: traction - X, torque - R X",
    "axle": "adds a force X [N] at the axle: traction - X, and no torque",
}
TRANSFORMS = {  # of bodies over time, and the lag of an equation: what is measured goes through it
    "delay": "makes every channel late by it [s]",
    "inputs": "lets the inputs act later by it [s]",
    "late": "lets this channel come later by it [s]",
    "play": "lets the encoder follow through a gap of it [rad]",
    "angle": "is the error [rad] of the angle that the encoder measures",
    "lag": "sends the channel through a low-pass of first order with it as the time constant",
}


def effects(
    name: Annotated[str, typer.Argument(help="an effect to explain")] = "",
    plot: Picture = None,
    case: Annotated[str, typer.Option("--case", metavar="CASE", help="also the effects that this case brings")] = "",
) -> None:
    """List the catalogue of effects and your own, or explain one and show its shape.

    Example: terrapin effects motor_heating --plot heating.svg
    """
    known = _known(case)
    if not name:
        if plot:
            raise UserError("--plot: expected together with the name of an effect")
        _list(known)
        return
    from terrapin_hil.physics.mechanics import mechanics
    from terrapin_tools.workbench.story.effect_picture import as_text, draw, held_text, shape_of

    chosen = [known[name]] if name in known else []
    if name in mechanics() and not any(effect.bases == ("equation",) for effect in chosen):
        chosen.append(mechanics()[name])
    if not chosen:
        raise UserError(f"found {name!r}, expected one of {', '.join(dict.fromkeys([*known, *mechanics()]))}")
    if plot:
        draw(chosen[0], shape_of(chosen[0]), plot)
    for other in chosen[1:]:
        print(_explain(other), end="\n\n")
    effect, shape = chosen[0], shape_of(chosen[0])
    print(_explain(effect))
    print(f"  shape       {effect.expression}" + (f", at {held_text(shape)}" if shape.held else ""))
    print("\n".join(as_text(shape)))


def _known(case: str) -> dict[str, Effect]:
    from terrapin_hil.effect_files import known_effects

    known = known_effects()
    if case:
        from terrapin_tools.workbench.case.case import load_case

        known.update(load_case(Path(case)).library)
    return known


def _list(known: dict[str, Effect]) -> None:
    from terrapin_hil.physics.effects import catalogue
    from terrapin_hil.physics.mechanics import mechanics

    width = max(map(len, [*known, *mechanics()]))
    for base in dict.fromkeys(base for effect in known.values() for base in effect.bases):
        print(f"On {base}:")
        for effect in known.values():
            if base in effect.bases:
                mark = "" if effect.name in {**catalogue(), **mechanics()} else "  (your own)"
                print(f"  {effect.name.ljust(width)}  {effect.title}{mark}")
    print("On equation, where columns are told what they are:")
    for effect in mechanics().values():
        print(f"  {effect.name.ljust(width)}  {effect.title}")


def _explain(effect: Effect) -> str:
    lines = [
        f"{effect.name}: {effect.title}",
        f"  equation    {effect.equation}",
        f"  source      {effect.source}",
        f"  formula     {effect.expression}",
        f"  acts        {_acts(effect)}",
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
    switch = effect.plant and effect.bases != EQUATION  # that is of a table's columns, and no robot's
    lines.append(f"  simulator   {'can switch it on' if switch else 'has no switch for it'}")
    lines.append(f"  controller  {', '.join(effect.firmware) or 'does not compensate it'}")
    return "\n".join(lines)


def _acts(effect: Effect) -> str:
    if effect.transform in TRANSFORMS and (effect.bases != EQUATION or effect.transform == "lag"):
        return TRANSFORMS[effect.transform]
    how = effect.stage if effect.target in CHANNELS else "channel" if effect.additive else "gain"
    return FORCES.get(effect.target) or ACTS[how].format(effect.target)


def _bound(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else ("-inf" if value < 0 else "inf")
