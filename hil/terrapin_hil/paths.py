"""Where the parts of the project stand: the package's own files, what was compiled, and what is built from the sources.

A wheel has the compiled parts and the cases inside this package, in _native and _cases. In a tree they stand in
build/host and cases. The controller of a robot other than the cylinder stands in robots/NAME beside them; the simulator
is the same for all. Nothing else in the program asks which of the two it runs from.
"""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path

from terrapin_interface.robot import DEFAULT

__all__ = [
    "NATIVE",
    "PHYSICS",
    "ROBOT_VARIABLE",
    "ROOT",
    "SCENARIOS",
    "boot_headers",
    "build",
    "dbc",
    "development_key",
    "examples",
    "firmware_sources",
    "header",
    "images",
    "make",
    "need",
    "program_hash",
    "simulator",
    "sources",
]

ROBOT_VARIABLE = "TERRAPIN_ROBOT"  # name or file of the robot of this process and those that it starts
PACKAGE = Path(__file__).resolve().parent
ROOT = PACKAGE.parent.parent  # the tree, for its tests: a wheel has none
PHYSICS = PACKAGE / "physics"
NATIVE = PACKAGE / "robot" / "native"
SCENARIOS = PACKAGE / "scenario" / "scenarios"
WHEEL = PACKAGE / "_native"


def sources() -> Path | None:
    """The tree with the sources of the firmware; None in a wheel."""
    return ROOT if (ROOT / "CMakeLists.txt").is_file() and not WHEEL.is_dir() else None


def firmware_sources() -> Path | None:
    """The tree whose host build is in use, which TERRAPIN_BUILD may name from a wheel; None where there is none."""
    tree = simulator().parent.parent
    return tree if simulator().name == "host" and (tree / "CMakeLists.txt").is_file() else None


def simulator() -> Path:
    """Folder of the compiled parts: the environment variable TERRAPIN_BUILD, else the wheel's, else the host build."""
    named = os.environ.get("TERRAPIN_BUILD")
    return Path(named) if named else WHEEL if WHEEL.is_dir() else ROOT / "build" / "host"


def build() -> Path:
    """Folder of the controller and its interface, for the robot that the environment variable TERRAPIN_ROBOT names."""
    base, name = simulator(), Path(os.environ.get(ROBOT_VARIABLE, DEFAULT)).name.removesuffix(".toml")
    if name == DEFAULT:
        return base
    return base / "robots" / name if base == WHEEL else base.parent / "robots" / name / base.name


def need(path: Path) -> Path:
    """`path` itself, a part of the build. OSError, which names it and says what to do, when it is not there."""
    if not path.is_file():
        robot = os.environ.get(ROBOT_VARIABLE, DEFAULT)
        target = f"firmware ROBOT={robot}" if "robots" in path.parts[-5:] else "setup"
        raise OSError(2, f"not built yet; run {make(target)}", str(path))
    return path


def make(target: str) -> str:
    """How a message names a target of make: whoever installed a wheel has to go to the sources for it."""
    where = "" if simulator() != WHEEL else " in the sources, and set TERRAPIN_BUILD to their build/host"
    return f"`make {target}`{where}"


def header() -> Path:
    """The controller's public C header."""
    return WHEEL / "terrapin.h" if WHEEL.is_dir() else ROOT / "firmware" / "core" / "terrapin.h"


def boot_headers() -> Path | None:
    """Folder of the firmware's headers that the boot loader's library is read by; None where there are none."""
    sources = firmware_sources()
    folder = WHEEL / "headers" if simulator() == WHEEL else sources / "firmware" if sources is not None else None
    return folder if folder is not None and folder.is_dir() else None


def images() -> Path:
    """Folder of the chip's images, beside the host build. `make firmware` fills it; a wheel has none."""
    return build().parent / "cortex-m4"


def development_key() -> Path:
    """The key that the build made for the bench, beside the host build. A wheel has none."""
    return simulator().parent / "keys" / "development.pem"


def dbc() -> Path:
    """The controller's own DBC, for logs of this project's robots."""
    return build() / "generated" / "terrapin.dbc"


def examples() -> dict[str, Path]:
    """The project's own cases by name."""
    folder = PACKAGE / "_cases" if WHEEL.is_dir() else ROOT / "cases"
    return {path.parent.name: path.parent for path in sorted(folder.glob("*/case.toml"))}


@cache
def program_hash(*folders: Path) -> str:
    """SHA-256 of the Python sources under `folders` and of the compiled parts: another program may answer otherwise.

    A wheel and a tree of the same sources, compiled alike, have the same. OSError when something is not built.
    """
    digest = hashlib.sha256()
    sources = [source for folder in folders for source in sorted(folder.rglob("*.py"))]
    compiled = (build() / "libterrapin.so", simulator() / "libterrapin_hil.so", build() / "generated/interface.json")
    for path in (*sources, *map(need, compiled)):
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
