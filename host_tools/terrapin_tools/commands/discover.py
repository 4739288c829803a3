"""`terrapin discover CASE`: name the physical effect that a case's model lacks, and how sure that is."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.command_options import Cases, Cluster, Jobs, Json, Level, Seed, check_options, deliver
from terrapin_tools.errors import UserError
from terrapin_tools.progress import steps

__all__ = ["discover"]


MOST_DRAWS = 100_000
MOST_TABLES = 10_000
TABLES = 20  # of --plant

Bootstrap = Annotated[
    int,
    typer.Option("--bootstrap", metavar="N", help="ask again of N resampled sets of runs: how often each answer wins"),
]
Plant = Annotated[
    str,
    typer.Option(
        "--plant", metavar="EFFECT=SIZE", help="hide it in tables like yours: how often is it found? SIZE: 0.3, or 2sd"
    ),
]
Explain = Annotated[
    bool, typer.Option("--explain", help="also what was weighed, what came second, and what would turn the answer")
]
Repeats = Annotated[int, typer.Option("--repeats", metavar="N", help=f"tables of --plant; {TABLES} where not given")]


def discover(
    case: Cases,
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
    level: Level = 0.05,
    cluster: Cluster = "",
    bootstrap: Bootstrap = 0,
    plant: Plant = "",
    repeats: Repeats = 0,
    explain: Explain = False,
) -> None:
    """Say whether anything is missing from the model, where it fails, what is missing, how sure, and what to do next.

    A folder of cases is answered case by case, in sorted order: with --json one line each.

    Examples: terrapin discover cases/forced_slip_sand --json answer.json

    terrapin discover fleet --json answers.jsonl --jobs 8

    terrapin discover cases/heated_motor --explain

    terrapin discover cases/heated_motor --bootstrap 200

    terrapin discover cases/heated_motor --plant viscous_friction=2sd --repeats 5
    """
    check_options(seed, jobs, level)
    if not 0 <= bootstrap <= MOST_DRAWS:
        raise UserError(f"--bootstrap: found {bootstrap}, expected 0 to {MOST_DRAWS}")
    if not 0 <= repeats <= MOST_TABLES:
        raise UserError(f"--repeats: found {repeats}, expected 1 to {MOST_TABLES}")
    if explain and (plant or json == "-"):
        raise UserError("--explain: found beside --plant or --json -, expected the answer as text")
    if plant:
        _plant(case, plant, repeats or TABLES, seed, level, json, bool(bootstrap or cluster))
        return
    if repeats:
        raise UserError("--repeats: expected together with --plant")
    with steps() as report:
        if (case / "case.toml").is_file():
            report("reading the case")  # what is imported here takes a second or two
        from terrapin_tools.workbench.fleet import fleet
        from terrapin_tools.workbench.story.answer import answer, keep
        from terrapin_tools.workbench.story.explain import explain as reasons
        from terrapin_tools.workbench.story.terminal import tell

        question = fleet.Question("discover", seed, level, bootstrap)
        found = fleet.cases_in(case) or fleet.answer_one(case, question, cluster, report)
    if isinstance(found, list):
        if explain:
            raise UserError(f"--explain: {case} is a folder of cases, expected one case")
        from terrapin_tools.workbench.fleet.lines import answer_all

        answer_all(found, question, json, jobs, cluster, keep)
        return
    keep(case, found)  # `add` knows the expressions that it proposed, `report` and the page show it
    deliver(answer(found), "\n".join([tell(found), *([reasons(found)] if explain else [])]), json)


def _plant(
    case: Path,
    wanted: str,
    repeats: int,
    seed: int,
    level: float,
    json: str,
    other: bool,
) -> None:
    """How often an effect that is hidden in the case's own table would be found."""
    from threadpoolctl import threadpool_limits

    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.discover.planted import plant
    from terrapin_tools.workbench.story.planting import answer, tell

    name, equals, size = wanted.partition("=")
    if not equals or not name.strip() or not size.strip():
        raise UserError(f"--plant: found {wanted!r}, expected EFFECT=SIZE")
    if other:
        raise UserError("--plant: found beside --bootstrap or --cluster, expected alone")
    begin = time.monotonic()
    with threadpool_limits(limits=1), steps() as report:
        planted = plant(load_case(case), name.strip(), size.strip(), repeats, seed, level, report)
    deliver({**answer(planted), "seconds": time.monotonic() - begin}, tell(planted), json)
