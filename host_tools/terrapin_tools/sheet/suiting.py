"""The file of a robot around a drive, which the controller can be built for, or what to give instead.

    print(suiting_text(Path("mine.toml"), read(given)))

A gear that is advised was tried: the file that follows from it is taken.
"""

from __future__ import annotations

import math
from pathlib import Path

from terrapin_interface.description import load
from terrapin_interface.robot import RobotError, read_robot
from terrapin_tools.errors import UserError
from terrapin_tools.sheet.figures import FIGURES, Figures, option
from terrapin_tools.sheet.proposal import TURNS, Misfit, robot_text

__all__ = ["suiting_text"]

TRIED = {  # all of two digits, SI
    name: [digits * 10.0**power for power in powers for digits in range(10, 100)]
    for name, powers in (("gear", range(-2, 3)), ("drive_radius", range(-4, -1)))
}


def suiting_text(file: Path, figures: Figures) -> str:
    """The text of `file`. UserError where the sheet contradicts itself, or nothing can be built for what follows from
    it; where the drive does not suit the robot it says with which gear or drive wheel it would."""
    try:
        return _text(file, figures)
    except Misfit as misfit:
        *most, last = [*_advice(file, figures, misfit), *misfit.instead]
        raise UserError(f"{misfit.found} {', '.join(most)}{' or ' if most else ''}{last}") from None
    except RobotError as error:
        raise UserError(
            f"{str(error).partition(': ')[2]}; in what follows from the sheet, which was not written"
        ) from None


def _text(file: Path, figures: Figures) -> str:
    text = robot_text(file.stem.replace("_", " "), figures)
    load(robot=read_robot(text, file))
    return text


def _advice(file: Path, figures: Figures, misfit: Misfit) -> list[str]:
    """From where to where a figure may be, the rest as it is; beside a finer encoder where it is too coarse too."""
    found = [words for name in misfit.figures if (words := _range(file, figures, name))]
    if found or misfit.name == "encoder_counts" or float(figures["encoder_counts"]) >= TURNS[0]:
        return found
    finer = {**figures, "encoder_counts": float(TURNS[0])}
    beside = f" with {option('encoder_counts')} {TURNS[0]}"
    return [words + beside for name in misfit.figures if (words := _range(file, finer, name))]


def _range(file: Path, figures: Figures, name: str) -> str:
    """From where to where the figure may be, "" where no number of it is taken."""
    near = float(figures.get(name, 1.0 if name == "gear" else 0.25 * float(figures["radius"])))
    runs: list[list[float]] = [[]]
    for value in TRIED[name]:
        if _proposed(figures, name, value):
            runs[-1].append(value)
        elif runs[-1]:
            runs.append([])
    nearest = min(runs, key=lambda run: min((abs(math.log(value / near)) for value in run), default=math.inf))
    low = next((value for value in nearest if _built(file, figures, name, value)), None)
    if low is None:
        return ""
    high = next(value for value in reversed(nearest) if _built(file, figures, name, value))
    unit = "" if FIGURES[name].unit == "1" else f" {FIGURES[name].unit}"
    return f"{option(name)} {low:g}{unit}" + (f" to {high:g}{unit}" if high > low else "")


def _proposed(figures: Figures, name: str, value: float) -> bool:
    try:
        robot_text("", {**figures, name: value})
    except UserError:
        return False
    return True


def _built(file: Path, figures: Figures, name: str, value: float) -> bool:
    """Whether the controller's formats hold the robot as well: some 50 ms."""
    try:
        _text(file, {**figures, name: value})
    except (UserError, RobotError):
        return False
    return True
