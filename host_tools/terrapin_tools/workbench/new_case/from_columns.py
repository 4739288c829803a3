"""A case from files whose columns are mapped by hand: case.toml is written, and read as any other case is.

`terrapin case --base` runs it. What is wrong is the complaint of `terrapin compare` about the same case.toml.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy.typing as npt
import tomlkit

from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import description_of, in_steps_of
from terrapin_tools.logs.reading import is_log
from terrapin_tools.parquet_files import rows as parquet_rows
from terrapin_tools.progress import step
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.changes import inline_tables
from terrapin_tools.workbench.files.csv_files import LARGE
from terrapin_tools.workbench.files.format import Asked
from terrapin_tools.workbench.files.streamed_tables import stream
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.new_case.from_tables import split_unit

__all__ = ["document_of", "make"]

MAX_ROWS = 2_000_000  # of a case made here
THINNED = ".parquet"


def make(folder: str, files: list[str], dbc: str, order: dict[str, Any]) -> dict[str, Any]:
    """Write case.toml and the measurements into the (empty) folder; `order` is that of case_order.py.

    Returns {"rows", "runs", "warnings"}. UserError when the case could not be compared.
    """
    place = Path(folder)
    sources = [Path(file) for file in files]
    logs = [source for source in sources if is_log(source)]
    asked = Asked.of(order.get("read", {}), "--read")
    _check_units(sources, asked)
    _check_size(sources, order["every"])
    own = True
    names = [_bring(place, source, order["every"], order["run"], asked) for source in sources]
    if logs:
        described, own = (Path(dbc), True) if dbc else description_of(logs[0])
        name = f"bus{described.suffix.lower()}"  # by which cantools knows its kind
        shutil.copyfile(described, place / name)
    write_whole(place / "case.toml", document_of(order, names, name if logs else ""))
    with step("reading the case"):
        case = load_case(place)
    if case.rows > MAX_ROWS:
        raise UserError(f"data.files: found {case.rows} rows, expected at most {MAX_ROWS}: take every n-th")
    sets = {"training": case.train, "held-out": case.test}
    runs = {name: len({*case.run[rows].tolist()}) for name, rows in sets.items()}
    warnings = [
        *([] if own else [f"{logs[0].name}: {in_steps_of()}, as no DBC says otherwise"]),
        *case.intake,
        *(f"found no {name} run, expected at least one" for name, count in runs.items() if not count),
    ]
    return {"rows": case.rows, "runs": len(case.run_names), "warnings": warnings}


def _check_units(sources: list[Path], asked: Asked) -> None:
    """The same quantity has the same unit in all tables."""
    seen: dict[str, tuple[str, str]] = {}
    for source in sources:
        if is_log(source):
            continue
        first = next(stream(source, asked=asked))
        for column in first.columns:
            name, unit = split_unit(column)
            other, file = seen.setdefault(name.lower(), (unit, source.name))
            if unit and other and unit != other and file != source.name:
                raise UserError(
                    f"{source.name}: column {column}: found {unit}, expected {other} as in {file}: mixed units"
                )


def _check_size(sources: list[Path], every: int) -> None:
    """UserError for more rows than a case may have, before all of them are read."""
    rows = 0
    for source in sources:
        if source.suffix == ".parquet":
            rows += parquet_rows(source)
        elif source.suffix == ".csv" and source.stat().st_size >= LARGE:
            with source.open("rb") as file:
                rows += sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b""))
    if rows // every > MAX_ROWS:
        least = -(-rows // MAX_ROWS)
        raise UserError(f"found {rows} rows, expected at most {MAX_ROWS}: take one of {least} (--every {least})")


def _bring(folder: Path, source: Path, every: int, run: str, asked: Asked) -> str:
    """The file's name in the case: a copy, or every n-th row of it."""
    thin = every > 1 and not is_log(source)
    suffix = THINNED if thin else source.suffix
    name, number = f"{source.stem}{suffix}", 1
    while (folder / name).exists():
        number += 1
        name = f"{source.stem}_{number}{suffix}"
    if thin:
        _thin(source, folder / name, every, run, asked)
    else:
        shutil.copyfile(source, folder / name)
    return name


def _thin(source: Path, target: Path, every: int, run: str, asked: Asked) -> None:
    """Every n-th row, a block at a time. A column is of numbers if it is in the first block; names of runs are text."""
    import pyarrow.parquet

    writer, done = None, 0
    try:
        for table in stream(source, {run}, asked):
            first = -done % every
            done += table.rows
            columns = {name: _values(table, name, name == run)[first::every].copy() for name in table.columns}
            block = pyarrow.table(columns)
            if writer is None:
                writer = pyarrow.parquet.ParquetWriter(target, block.schema)
            try:
                writer.write_table(block.cast(writer.schema))
            except (pyarrow.ArrowException, ValueError) as error:
                raise UserError(f"{table.place(0)}: {error}, expected columns of one kind throughout") from None
    finally:
        if writer is not None:
            writer.close()


def _values(table: Table, name: str, text: bool) -> npt.NDArray[Any]:
    try:
        return table.columns[name] if text else table.numbers(name)
    except UserError:  # words or gaps
        return table.columns[name]


def document_of(
    order: dict[str, Any], files: Iterable[str], dbc: str = "", maker: str = "`terrapin case --base`"
) -> str:
    """The text of case.toml for an order (options.py); `dbc`: the name of that in the case, where there are logs."""
    document = tomlkit.document()
    document.add(tomlkit.comment(f"made by {maker}; docs/cases.md says what can stand here"))
    document["case"] = {"title": order["title"]}
    model: dict[str, Any] = {"base": order["base"], "effects": order["effects"]}
    if order["equation"]:
        model["equation"] = order["equation"]
    if order["derivative"] or order["states"] or order["measured"]:
        motion = {"states": inline_tables(order["states"]), **{key: order[key] for key in ("derivative", "measured")}}
        model |= {**({"inputs": "held"} if order.get("held") else {}), **motion}
    document["model"] = model
    if order["parameters"]:
        document["parameters"] = order["parameters"]
    if order["fit"]:
        document["fit"] = inline_tables(order["fit"])
    if order["limits"]:
        document["limits"] = inline_tables(order["limits"])
    data = tomlkit.table()
    data["files"] = list(files)
    for key in ("run", "train", "test"):
        if order[key]:
            data[key] = order[key]
    if dbc:
        data["dbc"], data["period"] = dbc, order["period"]
    if order.get("read") and order["every"] == 1:  # rows that were taken have been read so
        data["read"] = order["read"]
    data["columns"] = inline_tables(order["columns"])
    document["data"] = data
    return tomlkit.dumps(document)
