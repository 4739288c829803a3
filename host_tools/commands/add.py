"""`terrapin add CASE EFFECT...`: put effects into a case's model and show what that does to the errors."""

from __future__ import annotations

import json as jsonlib
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from host_tools.errors import UserError
from host_tools.workbench.commandline import CaseFolder, Jobs, Json, Seed, check_options, deliver, step
from host_tools.workbench.edit import OwnEffect, OwnParameter, add_effects, parse_parameter, write_whole

__all__ = ["register"]


def add(
    case: CaseFolder,
    effects: Annotated[list[str], typer.Argument(metavar="EFFECT...", help="names of effects (see terrapin effects)")],
    expression: Annotated[str, typer.Option("--expression", metavar="EXPR", help="a formula of your own")] = "",
    target: Annotated[str, typer.Option("--target", help="what it acts on: a channel, resistance, a parameter")] = "",
    parameter: Annotated[
        list[str] | None, typer.Option("--parameter", metavar="NAME=START:MIN:MAX[:UNIT]", help="of the formula")
    ] = None,
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
) -> None:
    """Write effects into case.toml (comments and order kept), refit, and print the errors before and after.

    Examples: terrapin add CASE motor_heating

    terrapin add CASE my_drag --expression "k * omega**3" --parameter "k=0:-1:1:N m s^3/rad^3"
    """
    from host_tools.workbench import memory
    from host_tools.workbench.analysis import analyse
    from host_tools.workbench.answer import compare_answer
    from host_tools.workbench.case import load_case, parse_case
    from host_tools.workbench.show import describe, number

    check_options(seed, jobs)
    begin = time.monotonic()
    present = load_case(case)
    for name in effects:
        if name in present.effects or effects.count(name) > 1:
            raise UserError(f"{case / 'case.toml'}: model.effects: {name} is in the model already")
    own = _own_effects(case, effects, expression, target, parameter or [], set(present.library))
    _check_expressions(own, present)
    text = add_effects(present.text, effects, own)
    extended = parse_case(case, text)
    with step("fit"):
        before = analyse(present, seed)
        after = analyse(extended, seed)
    write_whole(case / "case.toml", text)
    old, new = before.ladder[-1], after.ladder[-1]
    answer: dict[str, Any] = compare_answer(after, time.monotonic() - begin)
    answer["added"] = list(effects)
    answer["before"] = {"train_error": old.train_error, "heldout_error": old.heldout_error}
    answer["after"] = {"train_error": new.train_error, "heldout_error": new.heldout_error}
    memory.remember(case, "added", list(effects), answer)
    words = (
        f"Added {', '.join(effects)} to {case / 'case.toml'}.\n"
        f"Error in noise sd, before -> after: training {number(old.train_error)} -> {number(new.train_error)}, "
        f"held out {number(old.heldout_error)} -> {number(new.heldout_error)}\n\n{describe(after)}"
    )
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
    """An expression that the last `discover` of this case proposed under that name."""
    file = case / ".terrapin" / "discover.json"
    if not file.is_file():
        return None
    try:
        answer = jsonlib.loads(file.read_text(encoding="utf-8"))
        for candidate in answer["candidates"]:
            if candidate["effect"] == name and candidate["kind"] == "expression":
                found = {
                    key: OwnParameter(float(entry["value"]), entry.get("min"), entry.get("max"), entry.get("unit", "1"))
                    for key, entry in candidate["parameters"].items()
                }
                return OwnEffect(candidate["expression"], candidate.get("target"), found)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{file}: {type(error).__name__} {error}, expected the last answer of terrapin discover"
        ) from None
    return None


def _check_expressions(own: dict[str, OwnEffect], case: Any) -> None:
    """Complaints about a formula name the option, not a line of a file that is not written."""
    from hil.physics.expression import parse
    from host_tools.workbench.bases import formula_name
    from host_tools.workbench.user_effects import targets

    for effect in own.values():
        try:
            names = parse(effect.expression).names
        except ValueError as error:
            raise UserError(f"--expression: {error}") from None
        known = {*case.inputs, *case.parameters, *case.fit, *effect.parameters, "speed", "bulldozing_resistance"}
        known |= {formula_name(name) for name in case.base.provides}
        unknown = sorted(names - known)
        if unknown:
            expected = ", ".join(sorted(known))
            raise UserError(f"--expression: {unknown[0]} is no role, column or parameter, expected one of {expected}")
        unused = sorted(set(effect.parameters) - names)
        if unused:
            raise UserError(f"--parameter: {unused[0]} does not occur in the expression {effect.expression}")
        if effect.target is not None and effect.target not in targets(case.base):
            raise UserError(f"--target: found {effect.target!r}, expected one of {', '.join(targets(case.base))}")


def register(app: typer.Typer) -> None:
    app.command("add")(add)
