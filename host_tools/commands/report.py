"""`terrapin report CASE -o FILE.html`: one self-contained page about a case."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from host_tools.workbench.commandline import CaseFolder, Jobs, Json, Level, Seed, check_options, deliver, step
from host_tools.workbench.edit import write_whole

__all__ = ["register"]


def report(
    case: CaseFolder,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.html", help="the page; works offline")],
    discover: Annotated[
        bool, typer.Option("--discover/--no-discover", help="look for what is missing, if the case has no answer yet")
    ] = True,
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
    level: Level = 0.05,
) -> None:
    """Write one HTML page: verdict, overlay, residuals where the model fails, ranking, ladder, next experiment, notes.

    It shows the last answer of `terrapin discover` if the case is as it was then, and else finds one.

    Example: terrapin report cases/forced_slip_sand -o forced_slip.html
    """
    from host_tools.workbench import memory
    from host_tools.workbench.analysis import analyse
    from host_tools.workbench.answer import compare_answer
    from host_tools.workbench.case import load_case
    from host_tools.workbench.discovery import discover as find
    from host_tools.workbench.discovery import discover_answer
    from host_tools.workbench.report import render

    check_options(seed, jobs, level)
    begin = time.monotonic()
    loaded = load_case(case)
    answer = memory.recall(case)
    if answer is not None and answer["adequacy"]["false_alarm_rate"] != level:
        answer = None
    new = answer is None and discover
    if new:
        with step("discover"):
            found = find(loaded, seed, level)
        analysis = found.analysis
        answer = discover_answer(found, time.monotonic() - begin)
    else:
        with step("compare"):
            analysis = analyse(loaded, seed, level)
    with step("page"):
        page = render(analysis, answer, memory.history(case))
    write_whole(output, page)
    if new and answer is not None:
        memory.keep(case, answer)
    deliver(answer or compare_answer(analysis, time.monotonic() - begin), str(output), json)


def register(app: typer.Typer) -> None:
    app.command("report")(report)
