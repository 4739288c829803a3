"""What the commands on cases share: options and the way the answer goes out."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from host_tools.errors import UserError

__all__ = [
    "CaseFolder",
    "Cases",
    "Cluster",
    "Jobs",
    "Json",
    "Level",
    "Seed",
    "check_options",
    "deliver",
    "progress_lines",
    "step",
]

CaseFolder = Annotated[Path, typer.Argument(metavar="CASE", help="folder that holds case.toml and measurements")]
Cases = Annotated[
    Path,
    typer.Argument(metavar="CASE", help="folder that holds case.toml and measurements, or a folder of such folders"),
]
Json = Annotated[str, typer.Option("--json", metavar="FILE", help="write the answer as JSON; - for standard output")]
Seed = Annotated[int, typer.Option("--seed", help="of everything drawn at random; same seed, same answer")]
Jobs = Annotated[int, typer.Option("--jobs", help="processes to use at most")]
Level = Annotated[float, typer.Option("--level", help="false alarm rate of the verdict")]
Cluster = Annotated[
    str, typer.Option("--cluster", metavar="ADDRESS", help="of a Dask scheduler that does the work, tcp://host:8786")
]


def check_options(seed: int, jobs: int, level: float = 0.05) -> None:
    """UserError when an option is out of range."""
    if seed < 0:
        raise UserError(f"--seed: found {seed}, expected 0 or more")
    if jobs < 1:
        raise UserError(f"--jobs: found {jobs}, expected 1 or more")
    if not 0.0 < level < 1.0:
        raise UserError(f"--level: found {level:g}, expected between 0 and 1")


def progress_lines() -> bool:
    """Whether progress goes to standard error line by line, for a program that reads it."""
    return os.environ.get("TERRAPIN_PROGRESS") == "lines"


@contextmanager
def step(text: str) -> Iterator[None]:
    """Progress on standard error, on a terminal or where lines are asked for: the step, then its time."""
    shown, lines = sys.stderr.isatty(), progress_lines()
    if shown or lines:
        print(f"{text} ...", end="\n" if lines else "", file=sys.stderr, flush=True)
    begin = time.monotonic()
    try:
        yield
    finally:
        if shown or lines:
            print(f"{'' if lines else chr(13)}{text}: {time.monotonic() - begin:.1f} s", file=sys.stderr, flush=True)


def deliver(answer: dict[str, Any], words: str, target: str) -> None:
    """Words to standard output; JSON to a file, or, for -, to standard output in their place."""
    from host_tools.workbench.answer import to_json
    from host_tools.workbench.edit import write_whole

    if target == "-":
        sys.stdout.write(to_json(answer))
        return
    if target:
        write_whole(Path(target), to_json(answer))
    print(words)
