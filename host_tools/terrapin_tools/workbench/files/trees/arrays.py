"""Named arrays in folders of folders (MATLAB, HDF5, NetCDF, npz) as tables: arrays of one length are columns of one.

{"speed": (96,), "torque": (96,), "rig": "A"}     one table of 96 rows, `rig` the same in each
{"V1": {"speed": (12,)}, "V2": {"speed": (9,)}}   two tables, V1 and V2
{"test": [{"speed": (12,)}, {"speed": (9,)}]}     an array of structs: two tables, test(1) and test(2)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.workbench.files.format import Column, Part, cells

__all__ = ["parts_of_tree"]

DEEPEST = 20
WIDEST = 256  # columns of one array of two dimensions
SHOWN = 4
UNITS = ("units", "unit", "variableunits")  # a table of units beside the columns, or a list in their order


def parts_of_tree(tree: Mapping[str, Any], units: Mapping[str, str] | None = None, path: str = "") -> list[Part]:
    """The tables of a tree: values are arrays, texts, lists of texts, trees, or lists of trees.

    `units` are by the place of an array in the tree, V1/speed.
    """
    return list(_parts(tree, units or {}, path, 0))


def _parts(tree: Mapping[str, Any], units: Mapping[str, str], path: str, depth: int) -> Iterator[Part]:
    if depth > DEEPEST:
        return
    told = next((value for name, value in tree.items() if name.lower() in UNITS), None)
    own = {name: value for name, value in tree.items() if name.lower() not in UNITS}
    flat: dict[str, Any] = {}
    inner: list[tuple[str, Mapping[str, Any]]] = []
    for name, value in own.items():
        if isinstance(value, Mapping):
            inner.append((name, value))
        elif isinstance(value, Sequence) and not isinstance(value, str) and value and isinstance(value[0], Mapping):
            inner += [(f"{name}({i})", each) for i, each in enumerate(value, 1)]
        else:
            flat[name] = value
    part = _table(flat, path)
    if part is not None:
        spelt = {name: units.get(f"{path}/{name}".lstrip("/"), "") for name in flat}
        spelt |= _told(told, list(part.columns))
        yield Part(part.name, part.columns, {name: spelt.get(name, "") for name in part.columns}, 0, part.notes)
    for name, value in inner:
        yield from _parts(value, units, f"{path}/{name}".lstrip("/"), depth + 1)


def _told(value: Any, columns: list[str]) -> dict[str, str]:
    """Units that stand in the tree itself: {"speed": "rpm"}, or a list of as many as there are columns."""
    if isinstance(value, Mapping):
        return {name: unit for name, unit in value.items() if isinstance(unit, str)}
    texts = [str(each) for each in value] if isinstance(value, (list, tuple, np.ndarray)) else []
    return dict(zip(columns, texts, strict=True)) if len(texts) == len(columns) else {}


def _table(flat: Mapping[str, Any], path: str) -> Part | None:
    """The arrays of the length that most columns have, and what is one value, in each row."""
    arrays: dict[str, Column] = {}
    single: dict[str, Any] = {}
    left_out = []
    for name, value in flat.items():
        if isinstance(value, (list, tuple)):
            single_values = [np.ravel(each)[0] if np.size(each) == 1 else each for each in value]
            value = cells(["" if np.ndim(each) else each for each in single_values])
        array = np.asarray(value)
        if array.dtype.kind in "SO":
            array = cells(array.ravel().tolist()).reshape(array.shape)
        if array.dtype.kind == "M":
            array = np.where(np.isnat(array), "", array.astype(str))
        if array.dtype.kind not in "fiubU":
            left_out.append(f"{name} (of {array.dtype})")
            continue
        array = array.astype(np.float64) if array.dtype.kind != "U" else array
        if array.size == 1:
            single[name] = array.ravel()[0]
        elif array.ndim == 2 and 1 not in array.shape and array.shape[1] <= WIDEST:
            arrays |= {f"{name} {i + 1}": array[:, i] for i in range(array.shape[1])}
        elif array.size and max(array.shape) == array.size:
            arrays[name] = array.ravel()
        elif array.size:
            left_out.append(f"{name} ({' x '.join(map(str, array.shape))})")
    if not arrays and not any(isinstance(value, float) for value in single.values()):
        return None
    lengths = Counter(len(array) for array in arrays.values())
    rows = max(lengths, key=lambda n: (lengths[n], n)) if lengths else 1
    columns = {name: array for name, array in arrays.items() if len(array) == rows}
    left_out += [f"{name} ({len(array)} values)" for name, array in arrays.items() if len(array) != rows]
    columns |= {name: np.full(rows, value) for name, value in single.items()}
    notes = []
    if left_out:
        more = f" and {len(left_out) - SHOWN} more" if len(left_out) > SHOWN else ""
        notes.append(f"left out, as not of {rows} rows: {', '.join(map(shorten, left_out[:SHOWN]))}{more}")
    return Part(path, columns, {}, 0, tuple(notes))
