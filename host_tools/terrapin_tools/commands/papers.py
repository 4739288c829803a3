"""`terrapin papers`: what three papers print, regenerated and judged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.progress import say

__all__ = ["papers"]


def papers(
    out: Annotated[Path, typer.Option("-o", "--out", help="folder for figures, papers.json and papers.html")] = Path(
        "out/papers"
    ),
) -> None:
    """Regenerate figures and tables of the three papers behind the models, each with a verdict, as one page.

    Example: terrapin papers -o papers
    """
    from terrapin_tools.errors import UserError
    from terrapin_tools.figure_style import need_pictures
    from terrapin_tools.papers.build import build
    from terrapin_tools.papers.verdict import worst

    if out.exists() and not out.is_dir():
        raise UserError(f"--out: found the file {out}, expected a folder")
    need_pictures("the papers' page")
    page, parts = build(out, say)
    for part in parts:
        numbers, statements = (worst(part.checks, which) or "-" for which in (False, True))
        print(f"{part.paper:<6} {part.title:<8} numbers {numbers:<17} statements {statements}")
    print(f"\n{page}")
