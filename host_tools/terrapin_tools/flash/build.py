"""Builds the images of a robot from the sources, with CMake and the cross compiler of this machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from terrapin_hil import paths
from terrapin_interface.board_header import board_header
from terrapin_interface.description import load
from terrapin_interface.robot import Robot, RobotError, find_robot, load_robot
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["build_images", "choose"]

PROGRAMS = ("cmake", "ninja", "arm-none-eabi-gcc")
LONGEST = 1800  # s of one program


def choose(name: str, board: str, folder: Path) -> tuple[Robot, Path]:
    """The robot, and its file; with another board than its own a copy in `folder` that names it.

    UserError when there is no such robot or board, or when they contradict each other.
    """
    try:
        path = find_robot(name)
        robot = load_robot(path)
        board_header(robot, load(robot=robot))
        if not board or board == robot.board.name:
            return robot, path.resolve()
        if board.endswith(".toml"):
            board = str(Path(board).resolve())
        own = str(robot.table.values["board"])
        lines = [
            f'board = "{board}"' if line.partition("=")[0].strip() == "board" else line
            for line in robot.text.splitlines()
        ]
        folder.mkdir(parents=True, exist_ok=True)
        copy = folder / f"{robot.name}.toml"
        write_whole(copy, "\n".join(lines) + "\n")
        robot = load_robot(copy)
        board_header(robot, load(robot=robot))
    except RobotError as error:
        raise UserError(str(error)) from None
    if robot.table.values["board"] == own:
        raise UserError(f"{name}: --board {board}: expected a line `board = ...` in its file to put it in")
    return robot, copy


def _environment() -> dict[str, str]:
    """With the programs of this Python's environment first: Ninja may be one of them."""
    return {**os.environ, "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))}


def _run(sources: Path, log: Path, *words: str) -> None:
    try:
        done = subprocess.run(
            words, cwd=sources, env=_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace", check=False, timeout=LONGEST,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise UserError(f"{words[0]}: not done after {LONGEST} s", status=1) from None
    if done.returncode:
        write_whole(log, done.stdout)
        lines = [line.strip() for line in done.stdout.splitlines() if line.strip()] or ["it says nothing"]
        first = next((line for line in lines if "error" in line.lower()), lines[-1])
        raise UserError(f"{words[0]} failed: {first}; all that it says: {log}", status=1)


def build_images(name: str, board: str, to: Path) -> list[Path]:
    """Builds boot loader and images of a robot, and copies them to a folder; the files there.

    UserError, one line, where the sources, CMake or the compiler are not, or when the robot's file is wrong.
    """
    sources = paths.sources()
    if sources is None:
        raise UserError("image build: a wheel has no sources of the firmware; run it in the sources")
    missing = [program for program in PROGRAMS if shutil.which(program, path=_environment()["PATH"]) is None]
    if missing:
        raise UserError(f"image build: {', '.join(missing)} not found on PATH; `make setup` says what to install")
    robots = sources / "build" / "robots"
    robot, file = choose(name, board, robots / "on-board" / Path(board).stem)
    place = robots / (robot.name if file == find_robot(name).resolve() else f"{robot.name}-{robot.board.name}")
    place /= "cortex-m4"
    place.mkdir(parents=True, exist_ok=True)
    log = place / "failed.log"
    _run(sources, log, "cmake", "--preset", "cortex-m4", "-B", str(place), f"-DPython3_EXECUTABLE={sys.executable}",
         f"-DTERRAPIN_ROBOT={file}")  # fmt: skip
    _run(sources, log, "cmake", "--build", str(place), "--target", f"images-{robot.board.name}")
    stem = robot.board.name.replace("_", "-")
    built = sorted((*place.glob(f"terrapin-{stem}-*.bin"), *place.glob(f"terrapin-boot-{stem}.bin")))
    to.mkdir(parents=True, exist_ok=True)
    return [Path(shutil.copy2(path, to)) for path in built]
