"""MATLAB files: versions 5 to 7.2, and 7.3, which is HDF5. Objects are refused, never made."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Format, Part
from terrapin_tools.workbench.files.trees.arrays import parts_of_tree
from terrapin_tools.workbench.files.trees.hdf5 import hdf5_tree
from terrapin_tools.workbench.files.trees.mat5 import mat5_tree


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """A part for the variables of one length, and one for each struct; an array of structs is a part each."""
    with path.open("rb") as file:
        head = file.read(128)
    if head[:19] == b"MATLAB 7.3 MAT-file":
        tree, units = hdf5_tree(path)
        return parts_of_tree(tree, units)
    if head[:10] != b"MATLAB 5.0" or head[126:128] not in (b"IM", b"MI"):
        raise UserError(f"{path.name}: begins with {head[:10]!r}, expected a MATLAB file of version 5 to 7.3")
    return parts_of_tree(mat5_tree(path))


FORMAT = Format("a MATLAB file", (".mat",), read, part="variable")
