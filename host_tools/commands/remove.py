"""`terrapin remove CASE EFFECT`: take an effect out of a case's model again."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer

from host_tools.errors import UserError
from host_tools.workbench.commandline import CaseFolder, Jobs, Json, Seed, check_options, deliver, step
from host_tools.workbench.edit import remove_effect, write_whole

__all__ = ["register"]


def remove(
    case: CaseFolder,
    effect: Annotated[str, typer.Argument(help="name of an effect in the model")],
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
) -> None:
    """Take an effect out of case.toml (comments and order kept) and print the errors before and after.

    Example: terrapin remove CASE motor_heating
    """
    from host_tools.workbench import memory
    from host_tools.workbench.analysis import analyse
    from host_tools.workbench.answer import compare_answer
    from host_tools.workbench.case import load_case, parse_case
    from host_tools.workbench.show import describe, number

    check_options(seed, jobs)
    begin = time.monotonic()
    present = load_case(case)
    if effect not in present.effects:
        found = ", ".join(present.effects) or "none"
        raise UserError(f"{case / 'case.toml'}: model.effects: {effect} is not in the model, expected one of {found}")
    text = remove_effect(present.text, effect)
    reduced = parse_case(case, text)
    with step("fit"):
        before = analyse(present, seed)
        after = analyse(reduced, seed)
    write_whole(case / "case.toml", text)
    old, new = before.ladder[-1], after.ladder[-1]
    answer: dict[str, Any] = compare_answer(after, time.monotonic() - begin)
    answer["removed"] = effect
    answer["before"] = {"train_error": old.train_error, "heldout_error": old.heldout_error}
    answer["after"] = {"train_error": new.train_error, "heldout_error": new.heldout_error}
    memory.remember(case, "removed", [effect], answer)
    words = (
        f"Removed {effect} from {case / 'case.toml'}.\n"
        f"Error in noise sd, before -> after: training {number(old.train_error)} -> {number(new.train_error)}, "
        f"held out {number(old.heldout_error)} -> {number(new.heldout_error)}\n\n{describe(after)}"
    )
    deliver(answer, words, json)


def register(app: typer.Typer) -> None:
    app.command("remove")(remove)
