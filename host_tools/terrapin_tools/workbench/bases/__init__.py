"""The catalogue of base models: one file a base, found by looking into this folder, and those that installed packages
name as entry points of the group `terrapin.bases`. docs/bases.md says how to add one.

A base is a plain object that says what it predicts, what it needs and how it is computed (kinds/base.py). Nothing else
in the program knows its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points

from terrapin_hil.catalogues import entries
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import Base
from terrapin_tools.workbench.bases.kinds.names import ROLES, RUNNING, formula_name, free_name

__all__ = ["BASES", "CHANNELS", "ELSEWHERE", "ROLES", "RUNNING", "Base", "formula_name", "free_name"]


def _installed(taken: Mapping[str, Base]) -> dict[str, Base]:
    """Bases of other packages of this environment. UserError, which names the package, where one is none."""
    found: dict[str, Base] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda each: each.name):
        place = f"{point.dist.name if point.dist else 'a package'}: {GROUP}: {point.name} = {point.value}"
        try:
            base = point.load()
        except Exception as error:  # whatever another package does when it is imported
            raise UserError(f"{place}: {type(error).__name__}: {error}, expected a base model") from None
        if not isinstance(base, Base):
            raise UserError(f"{place}: found {type(base).__name__}, expected a base model such as Algebraic")
        if base.name in taken or base.name in found:
            raise UserError(f"{place}: the name {base.name} is in use, expected another")
        found[base.name] = base
    return found


GROUP = "terrapin.bases"
_OURS: Mapping[str, Base] = entries(__name__, __path__, "BASE")
_FOUND: Mapping[str, Base] = {**_OURS, **_installed(_OURS)}
BASES = {name: base for name, base in _FOUND.items() if not base.reader}
ELSEWHERE = {name: base.reader for name, base in _FOUND.items() if base.reader}  # which command reads such a case

CHANNELS: Mapping[str, str] = {
    name: unit for base in BASES.values() for name, unit in base.channels.items() if name not in ROLES
}
