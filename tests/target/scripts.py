"""The build's own scripts (firmware/cmake), as modules, and what they say of an image."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

from terrapin_hil import paths

__all__ = ["HALVES", "bounds", "disassembly", "path_of", "script"]

HALVES = ("terrapin_step_drive", "terrapin_step_think")


def path_of(name: str) -> Path:
    return paths.ROOT / "firmware" / "cmake" / f"{name}.py"


def script(name: str) -> ModuleType:
    """The script of that name, imported."""
    spec = importlib.util.spec_from_file_location(name, path_of(name))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def disassembly(image: Path) -> list[str]:
    """Lines of objdump, as path_report reads them."""
    command = ["arm-none-eabi-objdump", "-d", "-z", "--no-show-raw-insn", str(image)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


def bounds(image: Path) -> dict[str, int]:
    """The most instructions that each half of a step can take, from the image."""
    report = script("path_report")
    found: dict[str, int] = report.measure(disassembly(image), list(HALVES), report.LOOPS)
    return found
