"""HDF5 files of any maker, and NetCDF 4, which is HDF5; NetCDF 3 through SciPy. Units are the attributes `units`."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.bounded import refuse_beyond
from terrapin_tools.workbench.files.format import Asked, Format, Part
from terrapin_tools.workbench.files.trees.arrays import parts_of_tree
from terrapin_tools.workbench.files.trees.hdf5 import hdf5_tree


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """A part for each group that holds columns."""
    with path.open("rb") as file:
        classic = file.read(3) == b"CDF"
    tree, units = _classic(path) if classic else hdf5_tree(path)
    return parts_of_tree(tree, units)


def _classic(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    import scipy.io

    tree: dict[str, Any] = {}
    units = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with scipy.io.netcdf_file(path, "r", mmap=False, maskandscale=False) as file:
            for name, variable in file.variables.items():
                refuse_beyond(path, variable.data.nbytes)
                unit = getattr(variable, "units", b"")
                units[name] = unit.decode("utf-8", errors="replace") if isinstance(unit, bytes) else str(unit)
                data = np.array(variable.data)
                if data.dtype.kind == "S":
                    tree[name] = [
                        b"".join(row).decode("utf-8", errors="replace").rstrip("\0 ") for row in np.atleast_2d(data)
                    ]
                    continue
                values = data.astype(np.float64)
                for key in ("_FillValue", "missing_value"):
                    if hasattr(variable, key):
                        values[np.isin(data, np.ravel(getattr(variable, key)))] = np.nan
                factor, offset = getattr(variable, "scale_factor", 1.0), getattr(variable, "add_offset", 0.0)
                tree[name] = values * float(factor) + float(offset)
    return tree, units


FORMAT = Format("an HDF5 or NetCDF file", (".h5", ".hdf5", ".hdf", ".nc", ".nc4", ".cdf"), read, part="group")
