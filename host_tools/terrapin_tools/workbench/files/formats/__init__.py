"""The catalogue of kinds of tables: one file a kind, found by looking into this folder (docs/cases.md: a new one).

Nothing else in the program knows a format's name. A reader imports its library when it reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from terrapin_hil.catalogues import entries
from terrapin_tools.workbench.files.format import Format

__all__ = ["FORMATS", "PACKED", "SUFFIXES", "format_of"]

FORMATS: Mapping[str, Format] = entries(__name__, __path__, "FORMAT")
PACKED = (".gz", ".zip")
SUFFIXES = (*(suffix for entry in FORMATS.values() for suffix in entry.suffixes), *PACKED)


def format_of(path: Path) -> Format | None:
    """The kind of a file or folder by its name; None for no table."""
    if path.is_dir():
        return next((entry for entry in FORMATS.values() if entry.folder is not None and entry.folder(path)), None)
    suffix = path.suffix.lower()
    return next((entry for entry in FORMATS.values() if suffix in entry.suffixes), None)
