"""Where the repository and its build stand."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["ROOT", "build", "cache"]

ROOT = Path(__file__).resolve().parent.parent


def build() -> Path:
    """Folder of the host build; the environment variable TERRAPIN_BUILD overrides it."""
    return Path(os.environ.get("TERRAPIN_BUILD", ROOT / "build" / "host"))


def cache() -> Path:
    """Folder for what can be made again: XDG_CACHE_HOME/terrapin, else ~/.cache/terrapin. Made if absent."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "terrapin"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
