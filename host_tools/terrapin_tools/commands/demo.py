"""`terrapin demo`: the whole circle once, with a page to look at."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.progress import bar

__all__ = ["demo"]


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
    from terrapin_tools.demo.stage import Stage
    from terrapin_tools.demo.story import Demo
    from terrapin_tools.figure_style import need_pictures

    need_pictures("the demonstration")
    out.mkdir(parents=True, exist_ok=True)
    with bar("demo") as shown:
        page = Demo(Stage(out.resolve(), _say, lambda share: shown(completed=share))).play()
    print(f"\n{page}")
