"""The robot of this process: its file, and that the controller which was built is for that very file.

    select("sphere")            # for this process and those that it starts; the cylinder where nobody asks
    selected().plant["radius"]

Simulator, interface and controller follow: one process knows one robot.
"""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.errors import UserError
from terrapin_interface.robot import DEFAULT, Robot, RobotError, find_robot, load_robot

__all__ = ["DEFAULT", "Robot", "cylinder", "select", "selected"]


@lru_cache(maxsize=16)
def _load(path: Path, stamp: tuple[int, int]) -> Robot:
    return load_robot(path)


def _robot(name: str) -> Robot:
    try:
        path = find_robot(name)
        status = path.stat()
        return _load(path, (status.st_mtime_ns, status.st_size))
    except RobotError as error:
        raise UserError(str(error)) from None


def cylinder() -> Robot:
    """The robot of a build that names no other."""
    return _robot(DEFAULT)


def selected() -> Robot:
    """The robot of this process. UserError when its file is wrong."""
    return _robot(os.environ.get(paths.ROBOT_VARIABLE, DEFAULT))


def select(name: str) -> Robot:
    """Makes a shipped robot, or that of a file, the one of this process.

    UserError when it is none, when no controller is built for it, or when one was built from another text of its file.
    """
    robot = _robot(name)
    os.environ[paths.ROBOT_VARIABLE] = str(Path(name).resolve()) if name.endswith(".toml") else name
    built = paths.build() / "generated"
    target = paths.make("setup" if robot.name == DEFAULT else f"firmware ROBOT={name}")
    for part, wanted, file in (
        ("robot", robot.text, f"{robot.name}.toml"),
        ("board", robot.board.text, f"{robot.board.name}.toml"),
    ):
        try:
            text = (built / f"{part}.toml").read_text(encoding="utf-8")
        except OSError:
            raise UserError(f"{robot.name}: no controller is built for this robot; run {target}") from None
        if text != wanted:
            raise UserError(f"{robot.name}: the controller was built from another {file}; run {target}")
    return robot
