"""The catalogue of base models: one file a base, found by looking into this folder. docs/bases.md says how to add one.

A base is a plain object that says what it predicts, what it needs and how it is computed (kinds/base.py). Nothing else
in the program knows its name.
"""

from __future__ import annotations

from collections.abc import Mapping

from terrapin_hil.catalogues import entries
from terrapin_tools.workbench.bases.kinds.base import Base
from terrapin_tools.workbench.bases.kinds.names import ROLES, RUNNING, formula_name, free_name

__all__ = ["BASES", "CHANNELS", "ELSEWHERE", "ROLES", "RUNNING", "Base", "formula_name", "free_name"]

_FOUND: Mapping[str, Base] = entries(__name__, __path__, "BASE")
BASES = {name: base for name, base in _FOUND.items() if not base.reader}
ELSEWHERE = {name: base.reader for name, base in _FOUND.items() if base.reader}  # which command reads such a case

CHANNELS: Mapping[str, str] = {
    name: unit for base in BASES.values() for name, unit in base.channels.items() if name not in ROLES
}
