"""`terrapin robot`: the robots that are shipped, and files of your own."""

from __future__ import annotations

import math
import sys
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from terrapin_tools.errors import UserError, about
from terrapin_tools.sheet.figures import FIGURES, option

if TYPE_CHECKING:
    from terrapin_interface.robot import Robot

__all__ = ["SUBCOMMANDS"]

Named = Annotated[str, typer.Argument(metavar="ROBOT", help="a shipped robot, or the file of one")]


def _load(name: str) -> Robot:
    """The robot, and its description of the controller made once, which refuses what its formats do not hold."""
    from terrapin_interface.description import load
    from terrapin_interface.robot import RobotError, find_robot, load_robot

    try:
        robot = load_robot(find_robot(name))
        load(robot=robot)
    except RobotError as error:
        raise UserError(str(error)) from None
    return robot


def list_() -> None:
    """List the shipped robots.

    Example: terrapin robot list
    """
    from terrapin_interface.robot import robots

    for name in robots():
        robot = _load(name)
        print(f"{name:12} {robot.title}; {robot.kind}, {robot.weight:.3g} N, board {robot.board.name}")


def show(name: Named) -> None:
    """What a robot is, and what follows from its file.

    Example: terrapin robot show sphere
    """
    robot = _load(name)
    plant, full = robot.plant, robot.full_scale
    reach = robot.wheel_gear * plant["torque_constant"] * plant["gear_efficiency"] * robot.limits["current"]
    driven = plant["gear_efficiency"] * plant["driven_ratio"]
    before = f"; before the gear {plant['motor_coulomb']:g} N m, {plant['motor_viscous']:g} N m s/rad"
    lossy = f", gear passes on {plant['gear_efficiency']:g}, driven back {driven:g}" if driven < 1.0 else ""
    rows = [
        ("body", f"{robot.kind}, R = {plant['radius']:g} m, R/r = {robot.wheel_gear:.5g}, W = {robot.weight:.5g} N"),
        ("drive", f"K_t = {plant['torque_constant']:.5g} N m/A, R_e = {plant['armature_resistance']:g} ohm, "
                  f"{robot.counts} counts a turn"
                  f"{f' (1 of {robot.encoder_divider} of the encoder)' if robot.encoder_divider > 1 else ''}, "
                  f"{robot.idle_speed:.4g} rad/s without load ({robot.free_speed:.4g} without friction){lossy}"),
        ("friction", f"A = {plant['coulomb']:g} N m, B = {plant['viscous']:g} N m s/rad"
                     f"{before if plant['motor_coulomb'] or plant['motor_viscous'] else ''}"),
        ("shell", f"{reach:.3g} N m at {robot.limits['current']:g} A; C_t up to {full['torque']:g} N m "
                  f"in steps of {1e-6 * robot.ratio('torque'):.2g} N m"),
        ("current", f"{robot.current_code * 1e3:.4g} mA a code, {2047 * robot.current_code:.4g} A at the end"),
        ("supply", f"{robot.supply:g} V, {robot.supply_code * 1e3:.4g} mV a code"),
        ("estimator", f"window {robot.window:g} s, a record every {10 * robot.record_slots} ms"),
        ("sensors", ", ".join(what for what in ("swing", "pitch", "ground_speed") if getattr(robot, what)) or "none"),
        ("board", f"{robot.board.name}: {robot.board.title}"),
        ("bus", f"{robot.bit_rate / 1e3:g} kbit/s"),
    ]  # fmt: skip
    print(f"{robot.name}: {robot.title}")
    for what, text in rows:
        print(f"  {what:10} {text}")
    for note in _notes(robot):
        print(f"  note       {note}")


def _notes(robot: Robot) -> list[str]:
    """What is no contradiction, but worth knowing."""
    from terrapin_interface.description import load

    missing = [
        what for what in ("swing", "pitch", "ground_speed") if getattr(robot, what) and not getattr(robot.board, what)
    ]
    board = robot.board.name
    notes = [f"board {board} has no sensor for {', '.join(missing)}"] if missing else []
    if robot.board.swing < ("swing" in robot.limits):
        notes.append(f"on board {board} the guard of the swing keeps the bridge off")
    (parameter,) = (each for each in load(robot=robot).parameters if each.name == "encoder_tolerance")
    tolerance, reach = parameter.default * parameter.scale, robot.plant["armature_resistance"] * robot.limits["current"]
    if reach < tolerance:
        notes.append(
            "a motor encoder that sticks or counts backwards is told by over_current at most: limits.current leaves it "
            f"{reach:.3g} V, encoder_tolerance is {tolerance:.3g} V; a smaller one in [firmware] tells it"
        )
    if not robot.board.ground_wheel:
        notes.append(f"on board {board}, which has no ground wheel, a run with the slip limiter is refused")
    return notes


def new(to: Path, like: str, from_sheet: bool, **sheet: str) -> None:
    """Begin the file of a robot of your own: with that of another, or from the data sheet of its drive.

    Example: terrapin robot new mine.toml --like roller

    With --from-sheet it asks for what the sheet says, or takes it as options, and writes from what each value follows.
    """
    from terrapin_tools.workbench.files.writing import write_new

    if to.suffix != ".toml" or not to.stem.replace("_", "").isalnum() or not to.stem[0].isalpha():
        raise UserError(f"{to}: expected letters, digits and _ before .toml: the file's name is the robot's")
    taken = UserError(f"{to}: is there already, expected a new file")
    if to.exists():
        raise taken
    given = {name: text for name, text in sheet.items() if text}
    if given and not from_sheet:
        raise UserError(f"{option(next(iter(given)))}: is of a data sheet, expected --from-sheet beside it")
    if from_sheet and like:
        raise UserError("--like: found it beside --from-sheet, expected one of the two")
    text = _from_sheet(to, given) if from_sheet else _load(like or "cylinder").text
    with about(to, OSError):
        try:
            write_new(to, text)
        except FileExistsError:
            raise taken from None
    if from_sheet:
        check(str(to))
        print(f"{to}: each line says from what it follows; look at what is assumed, then: terrapin robot show {to}")
    else:
        print(f"{to}: as {like or 'cylinder'}; put your numbers in, then: terrapin robot check {to}")


def _from_sheet(to: Path, given: dict[str, str]) -> str:
    """The text of the file, which is then one that the controller can be built for."""
    from terrapin_tools.sheet.asking import asked
    from terrapin_tools.sheet.figures import read
    from terrapin_tools.sheet.suiting import suiting_text

    if sys.stdin.isatty():
        given = asked(given, input)
    return suiting_text(to, read(given))


def _with_figures() -> None:
    """The options of `new`: its own, and one for each figure of a data sheet."""
    own: list[tuple[str, Any, Any]] = [
        (
            "to",
            Annotated[Path, typer.Argument(metavar="FILE", help="the file to make; never replaced")],
            Parameter.empty,
        ),
        ("like", Annotated[str, typer.Option("--like", metavar="ROBOT", help="whose file to begin with")], ""),
        (
            "from_sheet",
            Annotated[bool, typer.Option("--from-sheet", help="from what the drive's data sheet says")],
            False,
        ),
    ]
    for name, figure in FIGURES.items():
        about_it = (
            f"{figure.meaning}: {', '.join(figure.words)}"
            if figure.words
            else f"{figure.meaning}, like {figure.example!r}"
        )
        shown = typer.Option(option(name), metavar="TEXT", help=about_it, rich_help_panel="From a data sheet")
        own.append((name, Annotated[str, shown], ""))
    parameters = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind) for name, kind, default in own
    ]
    setattr(new, "__signature__", Signature(parameters))  # noqa: B010  of a function: mypy knows no such attribute
    new.__annotations__ = {name: kind for name, kind, _ in own}


_with_figures()


def check(name: Named) -> None:
    """Look for contradictions. Status 2 and one line with file, field and what it follows from when there is one.

    Example: terrapin robot check roller
    """
    robot = _load(name)
    swing = f", guard at {math.degrees(robot.limits['swing']):.3g} deg" if "swing" in robot.limits else ""
    print(
        f"{name}: good, {robot.kind} on board {robot.board.name}, C_t up to {robot.full_scale['torque']:g} N m{swing}"
    )
    for note in _notes(robot):
        print(f"note: {note}")


SUBCOMMANDS = (list_, show, new, check)
