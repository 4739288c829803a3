"""`terrapin compare CASE`: is the model of a case good enough for its measurements, and where does it fail?"""

from __future__ import annotations

import time

import typer

from host_tools.workbench.commandline import CaseFolder, Jobs, Json, Level, Seed, check_options, deliver, step

__all__ = ["register"]


def compare(case: CaseFolder, json: Json = "", seed: Seed = 0, jobs: Jobs = 1, level: Level = 0.05) -> None:
    """Fit the model on the training runs, predict every run, say whether anything is missing and where it fails.

    Example: terrapin compare cases/forced_slip_sand --json answer.json
    """
    from host_tools.workbench.analysis import analyse
    from host_tools.workbench.answer import compare_answer
    from host_tools.workbench.case import load_case
    from host_tools.workbench.show import describe

    check_options(seed, jobs, level)
    begin = time.monotonic()
    with step("compare"):
        analysis = analyse(load_case(case), seed, level)
    deliver(compare_answer(analysis, time.monotonic() - begin), describe(analysis), json)


def register(app: typer.Typer) -> None:
    app.command("compare")(compare)
