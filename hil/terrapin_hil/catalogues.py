"""Catalogues that are folders: one file an entry, found by looking into the folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable
from typing import Any

__all__ = ["entries"]


def entries(package: str, folder: Iterable[str], name: str) -> dict[str, Any]:
    """What each module of a package defines as `name`, by its own `name`, in the order of the files.

    `folder` is the package's `__path__`. Packages inside it are no entries. AttributeError names a module without one.
    """
    modules = sorted(info.name for info in pkgutil.iter_modules(folder) if not info.ispkg)
    found = [getattr(importlib.import_module(f"{package}.{module}"), name) for module in modules]
    return {entry.name: entry for entry in found}
