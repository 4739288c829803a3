"""A case into a folder, as it was when it was read."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.files.arrow_tables import to_arrow
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.times import has_times
from terrapin_tools.workbench.files.writing import copy_folder, write_whole

__all__ = ["same_rows", "write_folder"]


def same_rows(one: Case, other: Case) -> bool:
    """Whether two cases hold the same measurements, number for number."""
    if one is other:
        return True
    columns = [{**case.roles, **case.channels, **case.extra} for case in (one, other)]
    return (
        one.run_names == other.run_names
        and one.rows == other.rows
        and bool((one.run == other.run).all())
        and columns[0].keys() == columns[1].keys()
        and all(np.array_equal(values, columns[1][name], equal_nan=True) for name, values in columns[0].items())
    )


def write_folder(case: Case, folder: Path) -> None:
    """Fills the empty folder. UserError when what stands there then is another case than this: a file has changed."""
    text = case.text
    if not case.held:
        copy_folder(case.folder, folder, without=".terrapin")
        text = _bring(case, folder)
    for name, table in case.held.items():
        import pyarrow.parquet

        pyarrow.parquet.write_table(to_arrow(_as_read(case, table)), folder / name)
    write_whole(folder / "case.toml", text)
    if not same_rows(case, load_case(folder)):
        raise UserError(f"{case.folder}: a file of the case has changed since it was read, expected it as it was")


def _as_read(case: Case, table: Table) -> Table:
    """Without texts that a reader would take for times or switches: what they say stands beside them, or the case
    does not know it."""
    document: Any = tomlkit.parse(case.text)
    named = {document["data"].get("run"), *(one["column"] for one in document.get("groups", {}).values())}
    kept = {name: one for name, one in table.columns.items() if name in named or not has_times({name: one})}
    return replace(table, columns=kept)


def _bring(case: Case, folder: Path) -> str:
    """Files of data from outside the folder come into it; the text that names them so."""
    document: Any = tomlkit.parse(case.text)
    data, names = document["data"], []
    for name in data["files"]:
        inside = not os.path.relpath(case.folder / name, case.folder).startswith("..")
        place, number = Path(name) if inside else Path(Path(name).name), 1
        while not inside and (folder / place).exists():
            number += 1
            place = Path(f"{Path(name).stem}_{number}{Path(name).suffix}")
        if not inside:
            shutil.copyfile(case.folder / name, folder / place)
        names.append(str(place))
    if names == list(data["files"]):
        return case.text
    data["files"] = names
    return tomlkit.dumps(document)
