"""NumPy's .npz and .npy. A pickle is never opened."""

from __future__ import annotations

import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.bounded import refuse_beyond
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Format, Part
from terrapin_tools.workbench.files.trees.arrays import parts_of_tree

PICKLE = (
    "holds Python objects (a pickle), which may run a program and is never opened; expected arrays of numbers or text"
)


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """Arrays of one length are columns; a structured array is a part of its own."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as packed:
            refuse_beyond(path, sum(info.file_size for info in packed.infolist()))
    try:
        found: Any = np.load(path, allow_pickle=False)
        arrays = {path.stem: found} if isinstance(found, np.ndarray) else {name: found[name] for name in found.files}
    except ValueError as error:
        if "pickle" in str(error):
            raise UserError(f"{path.name}: {PICKLE}") from None
        raise
    if any(not isinstance(array, np.ndarray) for array in arrays.values()):
        raise UserError(f"{path.name}: holds a file that is no array, expected arrays only")
    tree = {name: {n: a[n] for n in a.dtype.names} if a.dtype.names else a for name, a in arrays.items()}
    return parts_of_tree(
        {name: a if isinstance(a, dict) or a.size != 1 or a.ndim else a.reshape(1) for name, a in tree.items()}
    )


FORMAT = Format("a NumPy file", (".npz", ".npy"), read, part="variable")
