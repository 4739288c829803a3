"""The build's own scripts (firmware/cmake), as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from terrapin_hil import paths

__all__ = ["path_of", "script"]


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
