"""`terrapin robot`: the robots that are shipped, and files of your own."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_tools.errors import UserError, about

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
    reach = robot.wheel_gear * plant["torque_constant"] * robot.limits["current"]
    rows = [
        ("body", f"{robot.kind}, R = {plant['radius']:g} m, R/r = {robot.wheel_gear:.5g}, W = {robot.weight:.5g} N"),
        ("drive", f"K_t = {plant['torque_constant']:.5g} N m/A, R_e = {plant['armature_resistance']:g} ohm, "
                  f"{robot.counts} counts a turn"
                  f"{f' (1 of {robot.encoder_divider} of the encoder)' if robot.encoder_divider > 1 else ''}, "
                  f"{robot.free_speed:.4g} rad/s without load"),
        ("friction", f"A = {plant['coulomb']:g} N m, B = {plant['viscous']:g} N m s/rad"),
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
    missing = [
        what for what in ("swing", "pitch", "ground_speed") if getattr(robot, what) and not getattr(robot.board, what)
    ]
    board = robot.board.name
    notes = [f"board {board} has no sensor for {', '.join(missing)}"] if missing else []
    if robot.board.swing < ("swing" in robot.limits):
        notes.append(f"on board {board} the guard of the swing keeps the bridge off")
    if not robot.board.ground_wheel:
        notes.append(f"on board {board}, which has no ground wheel, a run with the slip limiter is refused")
    return notes


def new(
    to: Annotated[Path, typer.Argument(metavar="FILE", help="the file to make; never replaced")],
    like: Annotated[str, typer.Option("--like", metavar="ROBOT", help="whose file to begin with")] = "cylinder",
) -> None:
    """Begin the file of a robot of your own with that of another.

    Example: terrapin robot new mine.toml --like roller
    """
    from terrapin_tools.workbench.files.writing import write_whole

    if to.suffix != ".toml" or not to.stem.replace("_", "").isalnum() or not to.stem[0].isalpha():
        raise UserError(f"{to}: expected letters, digits and _ before .toml: the file's name is the robot's")
    if to.exists():
        raise UserError(f"{to}: is there already")
    text = _load(like).text
    with about(to, OSError):
        write_whole(to, text)
    print(f"{to}: as {like}; put your numbers in, then: terrapin robot check {to}")


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
