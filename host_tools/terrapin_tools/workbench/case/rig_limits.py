"""[limits] of a case: what the rig can set, so that a proposed experiment stays within it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from terrapin_tools.workbench.bases import ROLES, Base
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.toml_tables import Tables

__all__ = ["read_limits"]


def read_limits(
    tables: Tables,
    base: Base,
    mapped: Mapping[str, str],
    extra: Collection[str],
    column_of: Mapping[str, str],
) -> dict[str, tuple[float, float]]:
    """Lowest and highest setting by role (canonical unit) or unmapped column (the file's own).

    UserError names line and field. `mapped` gives the unit of each mapped role and channel, `extra` the unmapped
    numeric columns.
    """
    known = dict(mapped) if base.own_names else dict(ROLES)
    known = {name: unit for name, unit in known.items() if name not in base.channels}
    limits = {}
    for name in tables.table("limits"):
        path = ("limits", name)
        if name not in known and name not in extra:
            role = next((role for role, column in column_of.items() if column == name), None)
            expected = f"its role {role}" if role in known else f"one of {', '.join([*known, *extra])}"
            raise tables.complain(f"no role or unmapped column, expected {expected}", *path)
        tables.entry(path, "min", "max", "unit")
        canonical = known.get(name, "1") or "1"
        unit = tables.text(*path, "unit", default=canonical)
        if name not in known and unit != "1":
            raise tables.complain("found a unit, expected none: the column is not mapped and has none", *path, "unit")
        with tables.about(*path, "unit"):
            units.convert(1.0, unit, canonical)
        ends = []
        for key in ("min", "max"):
            if tables.get(*path, key) is None:
                raise tables.complain("missing, expected a number", *path, key)
            ends.append(float(units.convert(tables.number(unit, *path, key), unit, canonical)))
        if not ends[0] < ends[1]:
            shown = [tables.get(*path, key) for key in ("min", "max")]
            raise tables.complain(f"found min {shown[0]} and max {shown[1]}, expected min below max", *path)
        limits[name] = (ends[0], ends[1])
    return limits
