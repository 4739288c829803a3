"""`terrapin case`: make a case of logged runs, of tables, of columns that you map, or of an example; append to one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_tools.command_options import Json, Picture, Reading, ThisRobot, deliver
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_tools.workbench.new_case.reading import Ask

__all__ = ["SUBCOMMANDS", "implied"]

Texts = list[str] | None
To = Annotated[Path, typer.Option("--to", metavar="CASE", help="the case's folder; made if it is not there")]
Title = Annotated[str, typer.Option("--title", help="of the case")]
Effects = Annotated[Texts, typer.Option("--effect", metavar="EFFECT", help="already in the model; repeat for more")]


def runs(
    folders: Annotated[list[Path], typer.Argument(metavar="RUN_DIR...", help="folders of `terrapin run --out`")],
    to: To,
    title: Title = "Logged runs",
    effect: Effects = None,
    after: Annotated[float, typer.Option("--after", metavar="SECONDS", help="leave out windows before")] = 0.0,
    before: Annotated[float, typer.Option("--before", metavar="SECONDS", help="leave out windows from here")] = 1e18,
    span: Annotated[
        float | None,
        typer.Option("--span", metavar="SECONDS", help="rows of this length, steady or not, in place of the windows"),
    ] = None,
    soil: Annotated[
        str, typer.Option("--soil", metavar="NAME", help="under a sphere; dry_sand_li where not given")
    ] = "",
    pitch_error: Annotated[
        float | None,
        typer.Option("--pitch-error", metavar="RAD", help="sd of a sphere's pitch zero; else an ordinary sensor's"),
    ] = None,
    robot: ThisRobot = "",
) -> None:
    """Turn logged runs into a case of rolling_steady: one row for each steady window that the controller called valid.

    Example: terrapin case runs out/runs/* --to out/case --effect speed_squared --after 2

    With --span 0.2 the rows show what goes with the shell's angle; inertia then belongs to the model:

    terrapin case runs out/runs/* --to out/case --effect speed_squared --effect inertia --span 0.2

    Runs of a sphere become a case of rolling_sphere, one row for each steady state:

    terrapin case runs out/runs/* --to out/case --robot sphere --soil dry_sand_li --effect bulldozing --after 15
    """
    from terrapin_tools.workbench.robot.runs import check_asked, read_run, write_case
    from terrapin_tools.workbench.robot.steady_states import PITCH_ERROR

    check_asked(effect or [], span, soil)
    zero = PITCH_ERROR if pitch_error is None else pitch_error
    if not 0.0 < zero <= 0.1:
        raise UserError(f"--pitch-error: found {zero:g}, expected more than 0, up to 0.1 rad")
    read = [read_run(folder, after, before, span, zero) for folder in folders]
    print(write_case(to, read, title, effect or [], soil))


def table(
    tables: Annotated[
        list[Path], typer.Argument(metavar="TABLE...", help="CSV, .xlsx, .mat, HDF5, Parquet, ...; a folder of such")
    ],
    to: To,
    title: Title = "",
    column: Annotated[
        Texts, typer.Option("--column", metavar="NAME=COLUMN", help="where the names leave it open")
    ] = None,
    unit: Annotated[Texts, typer.Option("--unit", metavar="NAME=UNIT", help="where the names leave it open")] = None,
    read: Reading = None,
    base: Annotated[str, typer.Option("--base", help="base model; else the best of those that suit")] = "",
    robot: Annotated[
        str, typer.Option("--robot", metavar="NAME|FILE", help="whose constants are known: a shipped one, or your file")
    ] = "",
) -> None:
    """Make a case of tables of your own: roles and units are guessed from the columns' names, for you to correct.

    Example: terrapin case table day_1.csv day_2.csv --to my_case

    Base models that the columns suit are fitted briefly and shown with what each leaves; the best is taken, or --base:

    terrapin case table log.csv --base cmr --to my_case

    With the robot's file its constants are stated, and only the ground is left to be fitted:

    terrapin case table log.csv --robot my_robot.toml --to my_case

    What was assumed of the files is shown first. --read says otherwise:

    terrapin case table book.xlsx --read sheet=Tests --read range=A3:F90 --to my_case
    """
    from terrapin_hil.robots import constants_of
    from terrapin_tools.workbench.files.format import Asked
    from terrapin_tools.workbench.new_case.from_tables import write_table_case
    from terrapin_tools.workbench.new_case.options import pairs
    from terrapin_tools.workbench.new_case.reading import files_of

    tables = files_of(tables)
    other = next((path for path in tables if not _is_table(path)), None)
    if other is not None:
        raise UserError(f"{other}: found beside tables, expected tables only, or folders of runs only")
    said = pairs("--column", column or []), pairs("--unit", unit or [])
    asked = Asked.of(pairs("--read", read or []), "--read")
    constants = constants_of(robot) if robot else None
    words = write_table_case(to, tables, title or to.resolve().name, *said, _ask(), asked, chosen=base, robot=constants)
    print(words)


def map_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="tables, or logs of a bus")],
    to: To,
    base: Annotated[str, typer.Option("--base", help="base model")],
    title: Title = "",
    effect: Effects = None,
    column: Annotated[Texts, typer.Option("--column", metavar="NAME=COLUMN", help="what a column is")] = None,
    unit: Annotated[Texts, typer.Option("--unit", metavar="NAME=UNIT", help="of a column")] = None,
    noise: Annotated[
        Texts, typer.Option("--noise", metavar="NAME=SD", help="of a row, in the column's unit or its own: '5 mA'")
    ] = None,
    constant: Annotated[Texts, typer.Option("--constant", metavar="NAME=VALUE", help="known parameter")] = None,
    fit: Annotated[Texts, typer.Option("--fit", metavar="NAME=START[:MIN:MAX[:UNIT]]", help="to be fitted")] = None,
    equation: Annotated[Texts, typer.Option("--equation", metavar="NAME=FORMULA", help="of base equation")] = None,
    state: Annotated[
        Texts,
        typer.Option("--state", metavar="NAME=INITIAL[:UNIT]", help="of base ode, from fit, a number or a column"),
    ] = None,
    derivative: Annotated[Texts, typer.Option("--derivative", metavar="STATE=FORMULA", help="of base ode")] = None,
    measured: Annotated[Texts, typer.Option("--measured", metavar="NAME=FORMULA", help="of base ode")] = None,
    limit: Annotated[Texts, typer.Option("--limit", metavar="NAME=MIN:MAX[:UNIT]", help="what the rig can set")] = None,
    run: Annotated[str, typer.Option("--run", metavar="COLUMN", help="that names the run; none: a file each")] = "",
    train: Annotated[Texts, typer.Option("--train", metavar="RUN", help="a training run; repeat for more")] = None,
    test: Annotated[Texts, typer.Option("--test", metavar="RUN", help="a held-out run; repeat for more")] = None,
    every: Annotated[int, typer.Option("--every", metavar="N", help="take every n-th row of a table")] = 1,
    dbc: Annotated[Path | None, typer.Option("--dbc", metavar="FILE", help="of a log; else the controller's")] = None,
    period: Annotated[str, typer.Option("--period", help="of the grid that a log is sampled on")] = "10 ms",
    read: Reading = None,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Make a case of tables or logs whose columns you map: nothing is guessed, and the files are copied into the case.

    Example: terrapin case map day_1.csv --to my_case --base equation --column "f=force" --unit f=N
    --column "x=way [mm]" --unit x=mm --equation "f=k*x" --fit k=1:0:9

    Differential equations of your own (docs/ode.md):

    terrapin case map day_1.csv --to my_case --base ode --column time=t --unit time=s --column x=way --unit x=mm
    --state x=fit:m --state v=fit:m/s --derivative x=v --derivative "v=-k*x-d*v" --measured x=x --fit k=7 --fit d=0.4
    """
    from terrapin_tools.workbench.files.writing import whole_folder
    from terrapin_tools.workbench.new_case import options
    from terrapin_tools.workbench.new_case.from_columns import make

    for path in [*files, *([dbc] if dbc else [])]:
        if not path.is_file():
            raise UserError(f"{path}: no such file")
    asked = options.read(
        title=title or to.resolve().name, base=base, effects=effect or [],
        columns=column or [], units=unit or [], noises=noise or [],
        constants=constant or [], fits=fit or [], equations=equation or [], limits=limit or [],
        states=state or [], derivatives=derivative or [], measured=measured or [],
        run=run, train=train or [], test=test or [], every=every, period=period, readings=read or [],
    )  # fmt: skip
    with whole_folder(to) as scratch:
        made = make(str(scratch), list(map(str, files)), str(dbc or ""), asked)
    words = [f"{to / 'case.toml'}: {base}, {made['rows']} rows of {made['runs']} runs", *made["warnings"]]
    deliver(made, "\n".join(words), json)


def merge(
    files: Annotated[tuple[Path, Path], typer.Argument(metavar="FIRST SECOND", help="recordings of one test")],
    match: Annotated[str, typer.Option("--match", metavar="COLUMN=COLUMN", help="of each: one quantity in both")],
    to: Annotated[Path, typer.Option("--to", metavar="FILE.csv", help="a new table")],
    clock: Annotated[str, typer.Option("--time", metavar="COLUMN=COLUMN", help="where the names leave it open")] = "",
    within: Annotated[float, typer.Option("--within", metavar="SECONDS", help="look so far, first rows at 0")] = 10.0,
    hold: Annotated[Texts, typer.Option("--hold", metavar="COLUMN", help="take its last value, not its mean")] = None,
    dbc: Annotated[Path | None, typer.Option("--dbc", metavar="FILE", help="of a log; else the controller's")] = None,
    plot: Picture = None,
    json: Json = "",
) -> None:
    """Bring two recordings of one test, each with its own clock, into one table: their offset is found by correlation.

    Example: terrapin case merge rig.csv drive.csv --match "speed [rad/s]=w" --to merged.csv --plot merged.png
    """
    from terrapin_tools.workbench.intake import merging
    from terrapin_tools.workbench.new_case.options import halves

    if to.suffix.lower() != ".csv" or to.exists():
        raise UserError(f"{to}: {'exists already' if to.exists() else 'found'}, expected the name of a new .csv")
    if not 0.0 < within <= 3600.0:
        raise UserError(f"--within: found {within:g} s, expected more than 0, up to 3600")
    pairs = halves("--match", match), halves("--time", clock) if clock else ("", "")
    made = merging.merge(files, pairs[0], pairs[1], within, hold or [], dbc)
    merging.write(made, to)
    if plot is not None:
        from terrapin_tools.workbench.intake.merge_picture import draw

        draw(made, plot)
    noise = {name: column["noise_sd"] for name, column in made.answer["columns"].items() if column["noise_sd"]}
    words = [f"{to}: {made.answer['rows']} rows; {made.told}", "sd of a row's noise, as it was left:"]
    words += [f"  {name}: {sd:.3g}" for name, sd in noise.items()]
    deliver(made.answer, "\n".join(words), json)


def example(name: Annotated[str, typer.Argument(metavar="NAME", help="of a shipped case")], to: To) -> None:
    """Copy a case that ships with Terrapin.

    Example: terrapin case example heated_motor --to my_case
    """
    from terrapin_tools.workbench.files.writing import copy_example

    copy_example(name, to)
    print(f"{to / 'case.toml'}: a copy of {name}")


def append(
    case: Annotated[Path, typer.Argument(metavar="CASE", help="that is there")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="table of new runs, with the columns of the case")],
    json: Json = "",
) -> None:
    """Bring new runs into a case; it says first how well the model as it was predicts them.

    Example: terrapin case append my_case day_3.csv
    """
    from terrapin_tools.workbench.intake.append import append as bring

    answer, words = bring(case, file)
    deliver(answer, words, json)


CaseThere = Annotated[Path, typer.Argument(metavar="CASE", help="that is there")]


def hold(
    case: CaseThere,
    runs: Annotated[
        list[str] | None, typer.Argument(metavar="RUN...", help="held out; all others are trained on")
    ] = None,
    json: Json = "",
) -> None:
    """Say which runs are held out; prints the errors before and after.

    Example: terrapin case hold my_case day_3 day_4
    """
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.case.changes import hold_out
    from terrapin_tools.workbench.story.change import carry_out

    present = load_case(case)
    held = list(dict.fromkeys(runs or []))
    answer, words = carry_out(present, hold_out(present.text, held, present.run_names), "held out", held, 0)
    deliver(answer, words, json)


def set_(
    case: CaseThere,
    constant: Annotated[str, typer.Argument(metavar="NAME=VALUE", help="of [parameters]: radius=80mm")],
    json: Json = "",
) -> None:
    """Give a known constant another value; prints the errors before and after.

    Example: terrapin case set my_case "radius=81 mm"
    """
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.case.changes import set_constant
    from terrapin_tools.workbench.story.change import carry_out

    present = load_case(case)
    name, equals, value = constant.partition("=")
    if not equals or not value.strip():
        raise UserError(f"found {constant!r}, expected NAME=VALUE")
    text = set_constant(present.text, name.strip(), value.strip())
    answer, words = carry_out(present, text, "set", [f"{name.strip()} = {value.strip()}"], 0)
    deliver(answer, words, json)


def undo(case: CaseThere, json: Json = "") -> None:
    """Take the last change of case.toml by a command back, byte for byte.

    Example: terrapin case undo my_case
    """
    _step(case, "undo", json)


def redo(case: CaseThere, json: Json = "") -> None:
    """Do a change again that was undone.

    Example: terrapin case redo my_case
    """
    _step(case, "redo", json)


def _step(case: Path, way: str, json: str) -> None:
    from terrapin_tools.workbench.case import history
    from terrapin_tools.workbench.case.case import load_case

    if not (case / "case.toml").is_file():
        load_case(case)  # one line where there is none; one that is damaged is what to step back from
    history.step(case, way)
    left = history.steps(case)
    words = f"{case / 'case.toml'}: {way} done; {left['undo']} more to undo, {left['redo']} to redo"
    deliver({"case": str(case), **left}, words, json)


def _ask() -> Ask:
    """Asks who sits at the terminal; where nobody does, the error names the option."""
    from terrapin_tools.workbench.new_case.reading import refuse

    def prompt(question: str, choices: Sequence[str], option: str) -> str:
        if len(choices) == 1:
            return str(typer.prompt(question, default=choices[0], err=True)).strip()
        while (answer := str(typer.prompt(f"{question} {' or '.join(choices)}", err=True)).strip()) not in choices:
            pass
        return answer

    return prompt if sys.stdin.isatty() and sys.stderr.isatty() else refuse


def _is_table(path: Path) -> bool:
    from terrapin_tools.logs.reading import is_log
    from terrapin_tools.workbench.files.formats import PACKED, format_of

    if path.suffix.lower() == ".mcap" and is_log(path):
        return False
    return format_of(path) is not None or (path.suffix.lower() in PACKED and not path.is_dir())


def implied(words: list[str]) -> list[str]:
    """A line without a sub-command, with the one that it means: `terrapin case day_1.csv --to my_case`."""
    if words[0] == "--example":
        return ["example", *words[1:]]
    if any(word.partition("=")[0] == "--base" for word in words):
        return ["map", *words]
    return ["table" if any(_is_table(Path(word)) for word in words) else "runs", *words]


SUBCOMMANDS = (runs, table, map_, merge, example, append, hold, set_, undo, redo)
