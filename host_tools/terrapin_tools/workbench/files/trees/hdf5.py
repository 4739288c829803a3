"""An HDF5 file as a tree of arrays (arrays.py), of any maker: h5py, MATLAB 7.3, NetCDF 4, pandas.

Nothing outside the file is read: links to other files, virtual and external data sets are left out or refused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import refuse_beyond, survived
from terrapin_tools.errors import UserError
from terrapin_tools.extras import need
from terrapin_tools.workbench.files.trees.mat5 import OBJECT

__all__ = ["hdf5_tree"]

DEEPEST = 20
MOST = 10_000  # groups and data sets
_MATLAB = (b"double", b"single", b"logical", b"char", b"cell", b"struct", b"canonical empty", b"int", b"uint")


def hdf5_tree(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The tree and the units of its arrays, by their place.

    UserError for MATLAB's objects, for data of other files, for more than it may stand for, and for a damaged file in
    which the library is lost (a heap of lengths 0 has no end).
    """
    need(f"{path.name}: {path.suffix}", "h5py", "hdf5")
    survived(path, lambda: _tree(path))
    return _tree(path)


def _tree(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    import h5py

    with h5py.File(path, "r") as file:
        return _Walk(path).tree(file)


class _Walk:
    """Goes through the groups once, each within the bounds."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.bytes = 0
        self.seen = 0
        self.units: dict[str, str] = {}

    def tree(self, file: Any) -> tuple[dict[str, Any], dict[str, str]]:
        return self._group(file, "", 0, file), self.units

    def _group(self, group: Any, place: str, depth: int, file: Any) -> dict[str, Any]:
        import h5py

        if depth > DEEPEST:
            raise UserError(f"{self.path.name}: groups are nested more than {DEEPEST} deep, expected fewer")
        found: dict[str, Any] = {}
        for name in group:
            if name.startswith("#") or isinstance(group.get(name, getlink=True), h5py.ExternalLink):
                continue
            self.seen += 1
            if self.seen > MOST:
                raise UserError(f"{self.path.name}: holds more than {MOST} groups and data sets, expected fewer")
            item = group.get(name)
            inner = f"{place}/{name}".lstrip("/")
            if isinstance(item, h5py.Group):
                self._check_class(item, inner)
                found[name] = self._group(item, inner, depth + 1, file)
            elif isinstance(item, h5py.Dataset):
                value = self._array(item, inner, depth, file)
                if value is not None:
                    found[name] = value
        kind = group.attrs.get("MATLAB_class")
        rows = [value for value in found.values() if isinstance(value, list)]
        if kind == b"struct" and found and len(rows) == len(found):  # an array of structs: each field a list of values
            count = min(map(len, rows))
            return {"": [{name: value[i] for name, value in found.items()} for i in range(count)]} if count else {}
        return found

    def _check_class(self, item: Any, place: str) -> None:
        kind = item.attrs.get("MATLAB_class", b"")
        plain = not kind or any(bytes(kind).startswith(known) for known in _MATLAB)
        if not plain or (item.attrs.get("MATLAB_object_decode", 0) == 3):
            raise UserError(f"{self.path.name}: {shorten(place)} {OBJECT}")

    def _array(self, item: Any, place: str, depth: int, file: Any) -> Any:
        import h5py

        self._check_class(item, place)
        if item.is_virtual or item.external:
            raise UserError(
                f"{self.path.name}: {shorten(place)}: its data stand in another file, expected them in this one"
            )
        if item.shape is None or item.attrs.get("MATLAB_empty", 0):
            return None
        self.bytes += item.size * max(item.dtype.itemsize, 8)
        refuse_beyond(self.path, self.bytes)
        unit = next((item.attrs[key] for key in ("units", "unit", "Units", "Unit") if key in item.attrs), "")
        self.units[place] = unit.decode("utf-8", errors="replace") if isinstance(unit, bytes) else str(unit)
        matlab = bytes(item.attrs.get("MATLAB_class", b""))
        if item.dtype.kind == "O" and h5py.check_ref_dtype(item.dtype) is not None:
            return self._references(item, place, depth, file) if matlab in (b"cell", b"") else None
        value = item.asstr(errors="replace")[()] if h5py.check_string_dtype(item.dtype) is not None else item[()]
        if matlab == b"char":
            return "".join(map(chr, np.ravel(value, order="F" if np.ndim(value) < 2 else "C").tolist()))
        if matlab:
            return np.asarray(value).T
        if item.dtype.names:
            return {name: value[name] for name in item.dtype.names}
        return _scaled(item, np.asarray(value))

    def _references(self, item: Any, place: str, depth: int, file: Any) -> Any:
        """A cell array, or a field of an array of structs: what each of its references stands for."""
        import h5py

        if depth >= DEEPEST or item.size > MOST:
            return None
        found: list[Any] = []
        for reference in item[()].ravel(order="F"):
            target = file[reference] if isinstance(reference, h5py.Reference) and reference else None
            self.seen += 1
            if self.seen > MOST:
                raise UserError(f"{self.path.name}: holds more than {MOST} groups and data sets, expected fewer")
            if isinstance(target, h5py.Group):
                found.append(self._group(target, place, depth + 1, file))
            else:
                found.append(None if target is None else self._array(target, place, depth + 1, file))
        return found


def _scaled(item: Any, value: Any) -> Any:
    """Values as NetCDF means them: what was not measured is NaN, then factor and offset."""
    if value.dtype.kind not in "fiu":
        return value
    marks = [item.attrs[key] for key in ("_FillValue", "missing_value") if key in item.attrs]
    factor, offset = (item.attrs.get(key) for key in ("scale_factor", "add_offset"))
    if not marks and factor is None and offset is None:
        return value
    found = value.astype(np.float64)
    for mark in marks:
        found[np.isin(value, np.ravel(mark))] = np.nan
    return found * float(np.ravel(1.0 if factor is None else factor)[0]) + float(
        np.ravel(0.0 if offset is None else offset)[0]
    )
