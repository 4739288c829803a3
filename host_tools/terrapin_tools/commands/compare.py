"""`terrapin compare CASE`: is the model of a case good enough for its measurements, and where does it fail?"""

from __future__ import annotations

from typing import Annotated

import typer

from terrapin_tools.command_options import Cases, Cluster, Jobs, Json, Level, Seed, check_options, deliver
from terrapin_tools.progress import step, steps

__all__ = ["compare"]

Intervals = Annotated[
    bool, typer.Option("--intervals", help="also each parameter's 95 % profile interval and strongest correlation")
]


def compare(
    case: Cases,
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
    level: Level = 0.05,
    cluster: Cluster = "",
    intervals: Intervals = False,
) -> None:
    """Fit the model on the training runs, predict every run, say whether anything is missing and where it fails.

    A folder of cases is answered case by case, in sorted order: with --json one line each.

    Example: terrapin compare cases/forced_slip_sand --json answer.json
    """
    from terrapin_tools.workbench.fleet import fleet
    from terrapin_tools.workbench.story.answer import answer
    from terrapin_tools.workbench.story.terminal import tell

    check_options(seed, jobs, level)
    question = fleet.Question("compare", seed, level, intervals=intervals)
    folders = fleet.cases_in(case)
    if folders is not None:
        from terrapin_tools.workbench.fleet.lines import answer_all

        answer_all(folders, question, json, jobs, cluster, lambda folder, story: None)
        return
    with steps() if intervals else step("compare") as report:
        story = fleet.answer_one(case, question, cluster, report or (lambda _: None))
    deliver(answer(story), tell(story), json)
