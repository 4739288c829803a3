"""`terrapin case RUN_DIR... --to CASE`: turn logged runs, or tables of your own, into a case."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from terrapin_tools.command_options import Json
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_tools.workbench.new_case.from_tables import Ask

__all__ = ["register"]

TABLES = (".csv", ".parquet")
Texts = list[str] | None


def case(
    to: Annotated[
        Path | None, typer.Option("--to", metavar="CASE", help="the case's folder; made if it is not there")
    ] = None,
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
    sources: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RUN_DIR...|TABLE...", help="folders of `terrapin run --out`, or tables; or append"),
    ] = None,
    example: Annotated[str, typer.Option("--example", metavar="NAME", help="copy a case that ships with this")] = "",
    base: Annotated[str, typer.Option("--base", help="base model of tables whose columns you map yourself")] = "",
    column: Annotated[Texts, typer.Option("--column", metavar="NAME=COLUMN", help="what a column is")] = None,
    unit: Annotated[Texts, typer.Option("--unit", metavar="NAME=UNIT", help="of a column")] = None,
    noise: Annotated[Texts, typer.Option("--noise", metavar="NAME=SD", help="of a row, in the column's unit")] = None,
    constant: Annotated[Texts, typer.Option("--constant", metavar="NAME=VALUE", help="known parameter")] = None,
    fit: Annotated[Texts, typer.Option("--fit", metavar="NAME=START[:MIN:MAX[:UNIT]]", help="to be fitted")] = None,
    equation: Annotated[Texts, typer.Option("--equation", metavar="NAME=FORMULA", help="of base equation")] = None,
    limit: Annotated[Texts, typer.Option("--limit", metavar="NAME=MIN:MAX[:UNIT]", help="what the rig can set")] = None,
    run: Annotated[str, typer.Option("--run", metavar="COLUMN", help="that names the run; none: a file each")] = "",
    train: Annotated[Texts, typer.Option("--train", metavar="RUN", help="a training run; repeat for more")] = None,
    test: Annotated[Texts, typer.Option("--test", metavar="RUN", help="a held-out run; repeat for more")] = None,
    every: Annotated[int, typer.Option("--every", metavar="N", help="take every n-th row of a table")] = 1,
    dbc: Annotated[Path | None, typer.Option("--dbc", metavar="FILE", help="of a log; else the controller's")] = None,
    period: Annotated[str, typer.Option("--period", help="of the grid that a log is sampled on")] = "10 ms",
    json: Json = "",
) -> None:
    """Turn logged runs into a case of rolling_steady: one row for each steady window that the controller called valid.

    Example: terrapin case out/runs/* --to out/case --effect speed_squared --after 2

    With --span 0.2 the rows show what goes with the shell's angle; inertia then belongs to the model:

    terrapin case out/runs/* --to out/case --effect speed_squared --effect inertia --span 0.2

    Tables (CSV, Parquet) of your own: roles and units are guessed from the columns' names, for you to correct.

    terrapin case day_1.csv day_2.csv --to my_case

    With --base nothing is guessed: you say what the columns are, and the tables (or logs) are copied into the case.

    terrapin case day_1.csv --to my_case --base equation --column "f=force" --unit f=N --column "x=way [mm]" --unit x=mm
    --equation "f=k*x" --fit k=1:0:9

    terrapin case --example heated_motor --to my_case

    New runs for a case that is there: it says first how well the model as it was predicts them.

    terrapin case append my_case day_3.csv
    """
    from terrapin_hil.physics.effects import catalogue
    from terrapin_tools.workbench.bases.rolling_steady import BASE
    from terrapin_tools.workbench.new_case.from_tables import write_table_case
    from terrapin_tools.workbench.new_case.options import pairs
    from terrapin_tools.workbench.robot.runs import read_run, write_case

    sources = sources or []
    if to is None:
        if sources[:1] == [Path("append")]:
            _append(sources[1:], json)
            return
        raise UserError("--to: found none, expected the case's folder")
    if example:
        if sources or base or effect:
            raise UserError("--example: found with other sources or options, expected it alone with --to")
        print(_copy_example(example, to))
        return
    if not sources:
        raise UserError("found no RUN_DIR and no TABLE, expected at least one, or --example")
    if base:
        if span is not None or after > 0.0 or before < 1e18:
            raise UserError("--after, --before and --span: expected with folders of runs, found --base")
        given = {
            "title": title or to.resolve().name, "base": base, "effects": effect or [],
            "columns": column or [], "units": unit or [], "noises": noise or [],
            "constants": constant or [], "fits": fit or [], "equations": equation or [], "limits": limit or [],
            "run": run, "train": train or [], "test": test or [], "every": every, "period": period,
        }  # fmt: skip
        _map(sources, to, dbc, given, json)
        return
    tables = [path for path in sources if path.suffix.lower() in TABLES and not path.is_dir()]
    if (
        any((*(() if tables else (column, unit)), noise, constant, fit, equation, limit, run, train, test, dbc, json))
        or every != 1
    ):
        raise UserError("--base: found none, expected one with --column and what belongs to it")
    if tables:
        if len(tables) < len(sources):
            other = next(path for path in sources if path not in tables)
            raise UserError(f"{other}: found beside tables, expected tables only, or folders of runs only")
        if effect or span is not None or after > 0.0 or before < 1e18:
            raise UserError("--effect, --after, --before and --span: expected with folders of runs, found tables")
        said = pairs("--column", column or []), pairs("--unit", unit or [])
        print(write_table_case(to, tables, title or to.resolve().name, *said, _ask()))
        return
    if span is not None and not 0.02 <= span <= 10.0:
        raise UserError(f"--span: found {span:g}, expected 0.02 to 10 s")
    for name in effect or []:
        if name not in catalogue() or not BASE.takes(catalogue()[name]):
            known = ", ".join(n for n, e in catalogue().items() if BASE.takes(e))
            raise UserError(f"--effect: found {name!r}, expected one of {known}")
    runs = [read_run(folder, after, before, span) for folder in sources]
    print(write_case(to, runs, title or "Logged runs", effect or []))


def _ask() -> Ask:
    """Asks who sits at the terminal; where nobody does, the error names the option."""
    from terrapin_tools.workbench.new_case.from_tables import refuse

    def prompt(question: str, choices: Sequence[str], option: str) -> str:
        if len(choices) == 1:
            return str(typer.prompt(question, default=choices[0], err=True)).strip()
        while (answer := str(typer.prompt(f"{question} {' or '.join(choices)}", err=True)).strip()) not in choices:
            pass
        return answer

    return prompt if sys.stdin.isatty() and sys.stderr.isatty() else refuse


def _append(sources: list[Path], json: str) -> None:
    """`terrapin case append CASE FILE`."""
    from terrapin_tools.command_options import deliver
    from terrapin_tools.workbench.intake.append import append

    if len(sources) != 2:
        raise UserError(f"append: found {len(sources)} names, expected CASE and FILE")
    answer, words = append(sources[0], sources[1])
    deliver(answer, words, json)


def _copy_example(name: str, to: Path) -> str:
    import shutil

    from terrapin_hil.paths import examples
    from terrapin_tools.workbench.files.writing import whole_folder

    if name not in examples():
        raise UserError(f"--example: found {name!r}, expected one of {', '.join(examples())}")
    with whole_folder(to) as scratch:
        shutil.copytree(examples()[name], scratch, dirs_exist_ok=True, ignore=shutil.ignore_patterns(".terrapin"))
    return f"{to / 'case.toml'}: a copy of {name}"


def _map(sources: list[Path], to: Path, dbc: Path | None, given: dict[str, Any], json: str) -> None:
    """A case of tables or logs whose columns are mapped by hand."""
    from terrapin_tools.command_options import deliver
    from terrapin_tools.workbench.files.writing import whole_folder
    from terrapin_tools.workbench.new_case import options
    from terrapin_tools.workbench.new_case.from_columns import make

    for path in [*sources, *([dbc] if dbc else [])]:
        if not path.is_file():
            raise UserError(f"{path}: no such file")
    asked = options.read(**given)
    with whole_folder(to) as scratch:
        made = make(str(scratch), list(map(str, sources)), str(dbc or ""), asked)
    words = [f"{to / 'case.toml'}: {given['base']}, {made['rows']} rows of {made['runs']} runs", *made["warnings"]]
    deliver(made, "\n".join(words), json)


def register(app: typer.Typer) -> None:
    app.command("case")(case)
