"""`terrapin discover CASE`: name the physical effect that a case's model lacks, and how sure that is."""

from __future__ import annotations

import sys
import time
from typing import Annotated

import typer

from terrapin_tools.command_options import Cases, Cluster, Jobs, Json, Level, Seed, check_options, deliver
from terrapin_tools.errors import UserError
from terrapin_tools.progress import progress_lines

__all__ = ["discover"]


MOST_DRAWS = 100_000

Bootstrap = Annotated[
    int,
    typer.Option("--bootstrap", metavar="N", help="ask again of N resampled sets of runs: how often each answer wins"),
]


def discover(
    case: Cases,
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
    level: Level = 0.05,
    cluster: Cluster = "",
    bootstrap: Bootstrap = 0,
) -> None:
    """Say whether anything is missing from the model, where it fails, what is missing, how sure, and what to do next.

    A folder of cases is answered case by case, in sorted order: with --json one line each.

    Examples: terrapin discover cases/forced_slip_sand --json answer.json

    terrapin discover fleet --json answers.jsonl --jobs 8

    terrapin discover cases/heated_motor --bootstrap 200
    """
    from terrapin_tools.workbench.fleet import fleet
    from terrapin_tools.workbench.story.answer import answer, keep
    from terrapin_tools.workbench.story.terminal import tell

    check_options(seed, jobs, level)
    if not 0 <= bootstrap <= MOST_DRAWS:
        raise UserError(f"--bootstrap: found {bootstrap}, expected 0 to {MOST_DRAWS}")
    begin = time.monotonic()

    def report(text: str) -> None:
        if sys.stderr.isatty() or progress_lines():
            print(f"{time.monotonic() - begin:5.1f} s  {text} ...", file=sys.stderr, flush=True)

    question = fleet.Question("discover", seed, level, bootstrap)
    folders = fleet.cases_in(case)
    if folders is not None:
        from terrapin_tools.workbench.fleet.lines import answer_all

        answer_all(folders, question, json, jobs, cluster, keep)
        return
    story = fleet.answer_one(case, question, cluster, report)
    keep(case, story)  # `add` knows the expressions that it proposed, `report` and the page show it
    deliver(answer(story), tell(story), json)
