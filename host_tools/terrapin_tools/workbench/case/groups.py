"""[groups] of a case: runs of several surfaces, robots or days, and which fitted parameters have a value for each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.expression import is_name
from terrapin_tools.workbench.bases.kinds.names import in_letters
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.toml_tables import Tables

__all__ = ["LEAST", "Groups", "group_columns", "membership", "read_groups", "read_shares"]

MOST = 6  # groups of a grouping that are looked at one by one; chosen by hand
LEAST = 2  # rows of a group: one says nothing of its noise


@dataclass(frozen=True)
class Groups:
    """One grouping: the groups' names, sorted, and the group of each row (rows,)."""

    names: tuple[str, ...]
    index: Index


def group_columns(tables: Tables) -> dict[str, str]:
    """The column of each grouping."""
    found = {}
    for name in tables.table("groups"):
        tables.entry(("groups", name), "column")
        found[name] = tables.text("groups", name, "column")
    return found


def read_groups(
    tables: Tables, loaded: Sequence[Table], kept: Index, run: Index, run_names: Sequence[str], train: Mask
) -> dict[str, Groups]:
    """Every grouping of [groups], on the rows `kept`. UserError names file, line and field."""
    found = {}
    for name, column in group_columns(tables).items():
        path = ("groups", name, "column")
        for table in loaded:
            if column not in table.columns:
                expected = ", ".join(table.columns)
                raise tables.complain(
                    f"column {column!r} is not in {table.path.name}, expected one of {expected}", *path
                )
        every = [value for table in loaded for value in table.text(column)]
        values = [every[row] for row in kept]
        names = tuple(sorted(set(values)))
        index = np.array([names.index(value) for value in values], dtype=np.int64)
        for one in np.unique(run):
            mine = [names[i] for i in np.unique(index[run == one])]
            if len(mine) > 1:
                told = " and ".join(repr(value) for value in mine[:2])
                raise tables.complain(f"found {told} in run {run_names[one]}, expected one value a run", *path)
        if "" in names:
            where = run_names[run[int(np.argmax(index == names.index("")))]]
            raise tables.complain(f"found nothing in run {where}, expected a group's name", *path)
        for i, group in enumerate(names):
            rows = int((index[train] == i).sum())
            if rows < LEAST:
                what = f"{rows} row{'' if rows == 1 else 's'} to train on"
                raise tables.complain(f"group {group!r} has {what}, expected at least {LEAST}", *path)
        found[name] = Groups(names, index)
    return found


def read_shares(tables: Tables, groups: Mapping[str, Groups]) -> dict[str, str]:
    """The grouping of each fitted parameter that has one."""
    found = {}
    for name, entry in tables.table("fit").items():
        if isinstance(entry, dict) and "by" in entry:
            path = ("fit", name, "by")
            by = tables.text(*path)
            if by not in groups:
                expected = f"one of {', '.join(groups)}" if groups else "a name of [groups]"
                raise tables.complain(f"found {by!r}, expected {expected}", *path)
            if len(groups[by].names) < 2:
                raise tables.complain(f"{by} has the one group {groups[by].names[0]!r}, expected two or more", *path)
            found[name] = by
    return found


def membership(groups: Mapping[str, Groups], taken: Collection[str]) -> dict[str, Array]:
    """Columns (rows,) that are 1 in one group and 0 elsewhere: so discovery sees what differs between groups although
    the model knows no difference, or knows another. None has a name that is `taken`."""
    found: dict[str, Array] = {}
    for name, grouping in groups.items():
        names = grouping.names[1:] if len(grouping.names) == 2 else grouping.names
        if len(grouping.names) > MOST:
            continue
        for group in names:
            column = in_letters(f"{name}_{group}")
            if column not in taken and column not in found and is_name(column):
                found[column] = (grouping.index == grouping.names.index(group)).astype(float)
    return found
