"""The robot of this process: its file, and that the controller which was built is for that very file.

    select("sphere")            # for this process and those that it starts; the cylinder where nobody asks
    selected().plant["radius"]

Simulator, interface and controller follow: one process knows one robot.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.errors import UserError
from terrapin_interface.robot import DEFAULT, ROBOTS, Robot, RobotError, find_robot, load_robot

__all__ = ["DEFAULT", "Robot", "constants_of", "cylinder", "robot_words", "select", "selected"]

SOURCES = {".c", ".h", ".py", ".toml", ".cmake"}
PROGRAMS = ("cmake", "ninja", "cc")  # that build a controller for this machine


@lru_cache(maxsize=16)
def _load(path: Path, stamp: tuple[int, int]) -> Robot:
    return load_robot(path)


def _robot(name: str, around: Iterable[Path] = ()) -> tuple[Robot, Path]:
    try:
        path = find_robot(name, around=around)
        status = path.stat()
        return _load(path, (status.st_mtime_ns, status.st_size)), path
    except RobotError as error:
        raise UserError(str(error)) from None


def cylinder() -> Robot:
    """The robot of a build that names no other."""
    return _robot(DEFAULT)[0]


def selected() -> Robot:
    """The robot of this process. UserError when its file is wrong."""
    return _robot(os.environ.get(paths.ROBOT_VARIABLE, DEFAULT))[0]


def constants_of(name: str, around: Iterable[Path] = ()) -> dict[str, float]:
    """Constants of a shipped robot, or of that of a file, as hil_robot has them (physics/robot.h; SI). UserError when
    there is no such robot or its file has a wrong value."""
    return dict(_robot(name, around)[0].plant)


def select(name: str, around: Iterable[Path] = ()) -> Robot:
    """Makes a shipped robot, or that of a file, the one of this process; `around`: folders to look for the file in.

    Where its controller is not built yet, or was built from another text of its file, it is built now if the sources,
    CMake and a compiler are there, with a line on standard error. UserError when there is no such robot, when its
    controller cannot be built, or when its file has a wrong value or the name of the default robot.
    """
    robot, path = _robot(name, around)
    own = path.parent != ROBOTS
    if own and robot.name == DEFAULT:
        raise UserError(f"{path}: found the name of the shipped {DEFAULT}, expected one of its own: rename the file")
    before = os.environ.get(paths.ROBOT_VARIABLE)
    os.environ[paths.ROBOT_VARIABLE] = str(path.resolve()) if own else robot.name
    try:
        _have_built(robot, path, name)
    except BaseException:  # the process keeps the robot that it had
        if before is None:
            del os.environ[paths.ROBOT_VARIABLE]
        else:
            os.environ[paths.ROBOT_VARIABLE] = before
        raise
    return robot


def _have_built(robot: Robot, path: Path, name: str) -> None:
    """The controller of this process's robot is there, or is built now. UserError as in `select`."""
    if not (lack := _lack(robot)):
        return
    target = paths.make("setup" if robot.name == DEFAULT else f"firmware ROBOT={name}")
    sources = paths.firmware_sources()
    if robot.name == DEFAULT or sources is None:
        raise UserError(f"{robot.name}: {lack}; run {target}")
    missing = [program for program in PROGRAMS if shutil.which(program, path=_environment()["PATH"]) is None]
    if missing:
        raise UserError(f"{robot.name}: {lack}, and {', '.join(missing)} to build it not found on PATH; run {target}")
    _build(robot, path, sources)
    if lack := _lack(robot):
        raise UserError(f"{robot.name}: {lack}; run {target}")


def robot_words() -> list[str]:
    """`--robot` and this process's robot for a command line; nothing where it is the default one."""
    named = os.environ.get(paths.ROBOT_VARIABLE, DEFAULT)
    return [] if named == DEFAULT else ["--robot", named]


def _lack(robot: Robot) -> str:
    """What is wrong with the controller that is built for a robot; empty where nothing is."""
    built = paths.build()
    for part, wanted, file in (
        ("robot", robot.text, f"{robot.name}.toml"),
        ("board", robot.board.text, f"{robot.board.name}.toml"),
    ):
        try:
            text = (built / "generated" / f"{part}.toml").read_text(encoding="utf-8")
        except OSError:
            return "no controller is built for this robot"
        if text != wanted:
            return f"the controller was built from another {file}"
    library = built / "libterrapin.so"
    if not library.is_file():
        return "no controller is built for this robot"
    sources = paths.firmware_sources() if robot.name != DEFAULT else None  # the default one's is `make setup`'s
    changed = sources is not None and _changed_since(library, sources / "firmware")
    return "the controller was built from older sources" if changed else ""


def _changed_since(library: Path, firmware: Path) -> bool:
    """A source of the firmware or of its interface is newer than the library."""
    built = library.stat().st_mtime_ns
    return any(
        file.suffix in SOURCES and ROBOTS.name not in file.parts and file.stat().st_mtime_ns > built
        for file in firmware.rglob("*.*")
    )


def _environment() -> dict[str, str]:
    """With the programs of this Python's environment first: CMake and Ninja may be two of them."""
    return {**os.environ, "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))}


def _build(robot: Robot, file: Path, sources: Path) -> None:
    """Builds the controller of a robot for this machine. UserError with the compiler's first complaint."""
    name = robot.name
    place = paths.build()
    place.mkdir(parents=True, exist_ok=True)
    commands = (
        ("cmake", "--preset", "host", "-B", str(place), f"-DPython3_EXECUTABLE={sys.executable}", "-DTERRAPIN_HIL=OFF",
         f"-DTERRAPIN_ROBOT={file.resolve()}"),
        ("cmake", "--build", str(place), "--target", "terrapin", "terrapin-controller", "terrapin_boot",
         "interface"),
    )  # fmt: skip
    with (place.parent / "lock").open("w") as lock:  # two commands of one robot, and build.sh, build it once
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not _lack(robot):  # another command has built it meanwhile
            return
        print(f"{name}: building its controller, once ...", end=" ", file=sys.stderr, flush=True)
        began = time.monotonic()
        (place / "libterrapin.so").unlink(missing_ok=True)  # one that is interrupted leaves none of an older file
        for words in commands:
            done = subprocess.run(
                words, cwd=sources, env=_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT, text=True, errors="replace", check=False,
            )  # fmt: skip
            if done.returncode:
                print("failed", file=sys.stderr)
                log = place / "failed.log"
                log.write_text(done.stdout, encoding="utf-8")
                lines = [line.strip() for line in done.stdout.splitlines() if line.strip()] or ["it says nothing"]
                first = next((line for line in lines if "error" in line.lower()), lines[-1])
                raise UserError(f"{name}: its controller cannot be built: {first}; all of it: {log}", status=1)
        (place / "libterrapin.so").touch()  # newer than every source, also where none of it had to be made again
        print(f"done in {time.monotonic() - began:.0f} s", file=sys.stderr)
