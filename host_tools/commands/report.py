"""`terrapin report CASE -o FILE.html`: one self-contained page about a case."""

from __future__ import annotations

import json as jsonlib
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from host_tools.workbench.commandline import CaseFolder, Jobs, Json, Level, Seed, check_options, deliver, step
from host_tools.workbench.edit import write_whole

__all__ = ["register"]


def report(
    case: CaseFolder,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.html", help="the page; works offline")],
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
    level: Level = 0.05,
) -> None:
    """Write one HTML page: verdict, overlay, residuals where the model fails, error ladder, parameters, notes.

    Example: terrapin report cases/forced_slip_sand -o forced_slip.html
    """
    from host_tools.workbench.analysis import analyse
    from host_tools.workbench.answer import compare_answer
    from host_tools.workbench.case import load_case
    from host_tools.workbench.report import render

    check_options(seed, jobs, level)
    begin = time.monotonic()
    loaded = load_case(case)
    with step("compare"):
        analysis = analyse(loaded, seed, level)
    write_whole(output, render(analysis, _discovered(case, list(loaded.effects))))
    deliver(compare_answer(analysis, time.monotonic() - begin), str(output), json)


def _discovered(case: Path, effects: list[str]) -> dict[str, Any] | None:
    """The last answer of discover, if it was about the model as it stands; a broken file is as good as none."""
    try:
        answer = jsonlib.loads((case / ".terrapin" / "discover.json").read_text(encoding="utf-8"))
        return answer if answer["model"]["effects"] == effects else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def register(app: typer.Typer) -> None:
    app.command("report")(report)
