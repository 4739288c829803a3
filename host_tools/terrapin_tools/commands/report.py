"""`terrapin report CASE -o FILE.html`: one self-contained page about a case."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.command_options import CaseFolder, Jobs, Json, Level, Seed, check_options, deliver
from terrapin_tools.progress import step
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["report"]


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
    from terrapin_tools.workbench.case import history
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.compare.comparison import analyse
    from terrapin_tools.workbench.discover.discovery import discover as find
    from terrapin_tools.workbench.story.answer import answer, keep, recall
    from terrapin_tools.workbench.story.page import page_of
    from terrapin_tools.workbench.story.told import told

    check_options(seed, jobs, level)
    begin = time.monotonic()
    loaded = load_case(case)
    found = recall(case, level)
    new = found is None and discover
    with step("discover" if new else "compare"):
        discovery = find(loaded, seed, level) if new else None
        analysis = discovery.analysis if discovery else analyse(loaded, seed, level)
    story = replace(told(analysis, discovery or found), seconds=time.monotonic() - begin)
    with step("page"):
        page = page_of(analysis, story, history.history(case))
    write_whole(output, page)
    if new:
        keep(case, story)
    deliver(answer(story), str(output), json)
