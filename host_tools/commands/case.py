"""`terrapin case RUN_DIR... --to CASE`: turn logged runs, or tables of your own, into a case."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from host_tools.errors import UserError

__all__ = ["register"]

TABLES = (".csv", ".parquet")


def case(
    sources: Annotated[
        list[Path], typer.Argument(metavar="RUN_DIR...|TABLE...", help="folders of `terrapin run --out`, or tables")
    ],
    to: Annotated[Path, typer.Option("--to", metavar="CASE", help="the case's folder; made if it is not there")],
    title: Annotated[str, typer.Option("--title", help="of the case")] = "",
    effect: Annotated[
        list[str] | None, typer.Option("--effect", metavar="EFFECT", help="already in the model; repeat for more")
    ] = None,
    after: Annotated[float, typer.Option("--after", metavar="SECONDS", help="leave out windows before")] = 0.0,
    before: Annotated[float, typer.Option("--before", metavar="SECONDS", help="leave out windows from here")] = 1e18,
    span: Annotated[
        float | None,
        typer.Option("--span", metavar="SECONDS", help="rows of this length, steady or not, in place of the windows"),
    ] = None,
) -> None:
    """Turn logged runs into a case of rolling_steady: one row for each steady window that the controller called valid.

    Example: terrapin case out/runs/* --to out/case --effect speed_squared --after 2

    With --span 0.2 the rows show what goes with the shell's angle; inertia then belongs to the model:

    terrapin case out/runs/* --to out/case --effect speed_squared --effect inertia --span 0.2

    Tables (CSV, Parquet) of your own: roles and units are guessed from the columns' names, for you to correct.

    terrapin case day_1.csv day_2.csv --to my_case
    """
    from hil.physics.effects import catalogue
    from host_tools.workbench.from_runs import read_run, write_case
    from host_tools.workbench.from_table import write_table_case

    tables = [path for path in sources if path.suffix.lower() in TABLES and not path.is_dir()]
    if tables:
        if len(tables) < len(sources):
            other = next(path for path in sources if path not in tables)
            raise UserError(f"{other}: found beside tables, expected tables only, or folders of runs only")
        if effect or span is not None or after > 0.0 or before < 1e18:
            raise UserError("--effect, --after, --before and --span: expected with folders of runs, found tables")
        print(write_table_case(to, tables, title or to.resolve().name))
        return
    if span is not None and not 0.02 <= span <= 10.0:
        raise UserError(f"--span: found {span:g}, expected 0.02 to 10 s")
    for name in effect or []:
        if name not in catalogue() or "rolling_steady" not in catalogue()[name].bases:
            known = ", ".join(n for n, e in catalogue().items() if "rolling_steady" in e.bases)
            raise UserError(f"--effect: found {name!r}, expected one of {known}")
    runs = [read_run(folder, after, before, span) for folder in sources]
    print(write_case(to, runs, title or "Logged runs", effect or []))


def register(app: typer.Typer) -> None:
    app.command("case")(case)
