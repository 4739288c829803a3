"""`terrapin add CASE EFFECT...`: put effects into a case's model and show what that does to the errors."""

from __future__ import annotations

import json as jsonlib
from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.command_options import CaseFolder, Jobs, Json, Seed, check_options, deliver
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.changes import OwnEffect, parse_parameter, without_own

__all__ = ["add"]


def add(
    case: CaseFolder,
    effects: Annotated[list[str], typer.Argument(metavar="EFFECT...", help="names of effects (see terrapin effects)")],
    expression: Annotated[str, typer.Option("--expression", metavar="EXPR", help="a formula of your own")] = "",
    target: Annotated[str, typer.Option("--target", help="what it acts on: a channel, resistance, a parameter")] = "",
    parameter: Annotated[
        list[str] | None, typer.Option("--parameter", metavar="NAME=START:MIN:MAX[:UNIT]", help="of the formula")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="the formula of your own of that name gives way")] = False,
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
) -> None:
    """Write effects into case.toml (comments and order kept), refit, and print the errors before and after.

    Examples: terrapin add CASE motor_heating

    terrapin add CASE my_drag --expression "k * omega**3" --parameter "k=0:-1:1:N m s^3/rad^3"
    """
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.story.change import carry_out, with_effects

    check_options(seed, jobs)
    present = load_case(case)
    if replace and not expression:
        raise UserError("--replace: expected together with --expression")
    before = present.changed(without_own(present.text, effects[0])) if replace else present
    own = _own_effects(case, effects, expression, target, parameter or [], set(before.library))
    text = with_effects(before, effects, own, "--expression", "--parameter", "--target")
    answer, words = carry_out(present, text, "added", list(effects), seed)
    deliver(answer, words, json)


def _own_effects(
    case: Path, effects: list[str], expression: str, target: str, parameters: list[str], known: set[str]
) -> dict[str, OwnEffect]:
    if expression:
        if len(effects) != 1:
            raise UserError(f"--expression: found {len(effects)} effect names, expected one")
        if not effects[0].isidentifier():
            raise UserError(f"found {effects[0]!r}, expected a name of letters, digits and _ for the expression")
        pairs = [parse_parameter(text) for text in parameters]
        found = dict(pairs)
        if len(found) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise UserError(f"--parameter: found {twice} twice, expected it once")
        return {effects[0]: OwnEffect(expression, target or None, found)}
    if target or parameters:
        raise UserError("--target and --parameter: expected together with --expression")
    proposed = [name for name in effects if name not in known]
    return {name: effect for name in proposed if (effect := _proposed(case, name)) is not None}


def _proposed(case: Path, name: str) -> OwnEffect | None:
    """An expression or a fault of the table that the last `discover` of this case proposed under that name."""
    from terrapin_tools.workbench.story.answer import proposal

    file = case / ".terrapin" / "discover.json"
    if not file.is_file():
        return None
    try:
        candidates = [proposal(one) for one in jsonlib.loads(file.read_text(encoding="utf-8"))["candidates"]]
        return next((one.own for one in candidates if one.effect == name and one.kind in ("expression", "table")), None)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{file}: {type(error).__name__} {error}, expected the last answer of terrapin discover"
        ) from None
