"""The compiled contacts and bodies of this folder, through cffi's ABI mode: the C headers are their description."""

from __future__ import annotations

from functools import cache
from threading import RLock
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt

from terrapin_hil import paths
from terrapin_interface.cdef import cdef

__all__ = ["ffi", "library", "pointer"]

HEADERS = (
    "ground/sixteen.h",
    "ground/contact.h",
    "ground/tyre.h",
    "program.h",
    "vehicle.h",
    "robot.h",
    "rolling.h",
    "pendulum.h",
    "equations/ode.h",
    "dynamic.h",
    "ground/bulldozing.h",
    "ground/grip.h",
    "ground/ground.h",
    "slipping.h",
    "heading.h",
)
_ONE_AT_A_TIME = RLock()  # two threads that make declarations at once would get types that do not mix


def ffi() -> cffi.FFI:
    """Declarations of the headers."""
    with _ONE_AT_A_TIME:
        return _ffi()


def library() -> Any:
    """The shared library, whose calls release the interpreter's lock. OSError, naming the file, when not yet built."""
    with _ONE_AT_A_TIME:
        return _library()


@cache
def _ffi() -> cffi.FFI:
    found = cffi.FFI()
    folder = paths.PHYSICS
    found.cdef(cdef([(folder / name).read_text(encoding="utf-8") for name in HEADERS]))
    return found


@cache
def _library() -> Any:
    return _ffi().dlopen(str(paths.need(paths.simulator() / "libterrapin_hil.so")))


def pointer(array: npt.NDArray[np.float64] | None) -> Any:
    """double * into an array (C order, float64), which the caller keeps alive; NULL for None."""
    if array is None:
        return ffi().NULL
    if array.dtype != np.float64 or not array.flags.c_contiguous:
        raise TypeError(f"array: found {array.dtype} with strides {array.strides}, expected contiguous float64")
    return ffi().cast("double *", array.ctypes.data)
