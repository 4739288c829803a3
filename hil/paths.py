"""Where the repository and its build stand."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["ROOT", "build", "cache", "dbc", "examples"]

ROOT = Path(__file__).resolve().parent.parent


def build() -> Path:
    """Folder of the host build; the environment variable TERRAPIN_BUILD overrides it."""
    return Path(os.environ.get("TERRAPIN_BUILD", ROOT / "build" / "host"))


def dbc() -> Path:
    """The controller's own DBC, for logs of this project's robots."""
    return build() / "generated" / "terrapin.dbc"


def examples() -> dict[str, Path]:
    """The repository's cases by name."""
    return {path.parent.name: path.parent for path in sorted((ROOT / "cases").glob("*/case.toml"))}


def cache() -> Path:
    """Folder for what can be made again: XDG_CACHE_HOME/terrapin, else ~/.cache/terrapin. Made if absent."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "terrapin"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
