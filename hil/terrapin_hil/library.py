"""The compiled part of the simulator, and the names of its C declarations, through cffi's ABI mode.

The C headers are the only description of structs and functions; they are read when the library is opened.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cffi

from terrapin_hil import paths
from terrapin_interface.cdef import cdef

__all__ = ["ffi", "library"]

PHYSICS = (
    "robot.h",
    "rolling.h",
    "ground/bulldozing.h",
    "ground/grip.h",
    "ground/ground.h",
    "program.h",
    "effects.h",
    "body.h",
)
NATIVE = ("random.h", "sensors.h", "faults.h", "simulator.h")


@cache
def ffi() -> cffi.FFI:
    """Declarations of physics and robot/native, with the controller's frames and inputs that they use."""
    headers = [paths.header()]
    headers += [paths.PHYSICS / name for name in PHYSICS]
    headers += [paths.NATIVE / name for name in NATIVE]
    found = cffi.FFI()
    found.cdef(cdef([path.read_text(encoding="utf-8") for path in headers]))
    return found


@cache
def library() -> Any:
    """The shared library. OSError, naming the file, when it has not been built or is out of date."""
    path = paths.need(paths.simulator() / "libterrapin_hil.so")
    lib = ffi().dlopen(str(path))
    layout = ffi().sizeof("hil_simulator") << 32 | ffi().sizeof("hil_record")
    if getattr(lib, "hil_layout", lambda: 0)() != layout:
        raise OSError(8, f"built from other sources; run {paths.make('setup')}", str(path))
    return lib
