"""`terrapin discover CASE`: name the physical effect that a case's model lacks, and how sure that is."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import typer

from host_tools.workbench.commandline import CaseFolder, Jobs, Json, Level, Seed, check_options, deliver

__all__ = ["register"]


def discover(case: CaseFolder, json: Json = "", seed: Seed = 0, jobs: Jobs = 1, level: Level = 0.05) -> None:
    """Say whether anything is missing from the model, where it fails, what is missing, how sure, and what to do next.

    Example: terrapin discover cases/forced_slip_sand --json answer.json
    """
    from host_tools.workbench.answer import to_json
    from host_tools.workbench.case import load_case
    from host_tools.workbench.discovery import discover as find
    from host_tools.workbench.discovery import discover_answer
    from host_tools.workbench.words import tell

    check_options(seed, jobs, level)
    begin = time.monotonic()

    def report(text: str) -> None:
        if sys.stderr.isatty():
            print(f"{time.monotonic() - begin:5.1f} s  {text} ...", file=sys.stderr, flush=True)

    found = find(load_case(case), seed, level, report)
    answer = discover_answer(found, time.monotonic() - begin)
    _keep(case, to_json(answer))
    deliver(answer, tell(found), json)


def _keep(case: Path, text: str) -> None:
    """The last answer stays in the case, so that `terrapin add` knows the expressions that it proposed."""
    from host_tools.workbench.edit import write_whole

    folder = case / ".terrapin"
    try:
        folder.mkdir(exist_ok=True)
        write_whole(folder / "discover.json", text)
    except OSError as error:  # a case on read-only media can still be looked at
        reason = error.strerror or str(error)
        print(f"terrapin: {folder}: {reason}; terrapin add will not know this answer", file=sys.stderr)


def register(app: typer.Typer) -> None:
    app.command("discover")(discover)
