"""`terrapin remove CASE EFFECT`: take an effect out of a case's model again."""

from __future__ import annotations

from typing import Annotated

import typer

from terrapin_tools.command_options import CaseFolder, Jobs, Json, Seed, check_options, deliver

__all__ = ["remove"]


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
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.story.change import carry_out, without_effect

    check_options(seed, jobs)
    present = load_case(case)
    answer, words = carry_out(present, without_effect(present, effect), "removed", [effect], seed)
    answer["removed"] = effect
    deliver(answer, words, json)
