"""Packages that one kind of work alone needs: not installed with the rest, and named where they are missed."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

from terrapin_tools.errors import UserError

__all__ = ["can_without_mf4", "installed", "mf4_of_can", "need"]


def installed(package: str) -> bool:
    """Whether Python finds the package; it is not imported."""
    return importlib.util.find_spec(package) is not None


def need(what: str, package: str, extra: str) -> None:
    """UserError that says which extra of pyproject.toml brings the package that `what` needs, where it is not there."""
    if not installed(package):
        raise UserError(f"{what} needs {package}, which is not installed: pip install 'terrapin-robot[{extra}]'")


class _NotYet:
    """Finds nothing; to python-can's module for MF4 files, while that is imported, asammdf is not there."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        del path, target
        asking = sys.modules.get("can.io.mf4")
        if name == "asammdf" and asking is not None and not hasattr(asking, "MF4Reader"):
            raise ModuleNotFoundError("asammdf is imported when an MF4 file is opened", name=name)
        return None


def can_without_mf4() -> None:
    """From now on python-can, and cantools, which imports it, leave asammdf to `mf4_of_can`.

    Importing asammdf, and with it pandas, is half of what `terrapin log info` computes where it is installed, and few
    commands open an MF4 file.
    """
    if _NotYet not in sys.meta_path:
        sys.meta_path.insert(0, _NotYet)


def mf4_of_can() -> None:
    """python-can reads MF4 files, whether or not it was imported without."""
    module = importlib.import_module("can.io.mf4")
    if module.asammdf is None:  # the classes that python-can has by now find asammdf among the module's names
        importlib.reload(module)
