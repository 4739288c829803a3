"""`terrapin demo`: the whole circle once, with a page to look at."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[float], None]]:
    """A bar on standard error when that is a terminal; otherwise nothing."""
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn

    with Progress(BarColumn(), TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("demo", total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _say(line: str) -> None:
    if sys.stdout.isatty() and line.lstrip("\n")[:1].isdigit() and "/" in line[:4]:
        print(f"\033[1;36m{line}\033[0m", flush=True)
    else:
        print(line, flush=True)


def demo(
    out: Annotated[Path, typer.Option("--out", help="folder for logs, pictures and the page")] = Path("out"),
) -> None:
    """Run the main job once: firmware, simulated robot, link, log, comparison, and the way back to the controller.

    Example: terrapin demo --out out
    """
    from host_tools.demo.stage import Stage
    from host_tools.demo.story import Demo

    out.mkdir(parents=True, exist_ok=True)
    with _progress() as progress:
        page = Demo(Stage(out.resolve(), _say, progress)).play()
    print(f"\n{page}")


def register(app: typer.Typer) -> None:
    app.command("demo")(demo)
