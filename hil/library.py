"""The compiled part of the simulator, and the names of its C declarations, through cffi's ABI mode.

The C headers are the only description of structs and functions; they are read from the source tree.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cffi

from firmware.interface.cdef import cdef
from hil import paths

__all__ = ["ffi", "library"]

PHYSICS = ("robot.h", "rolling.h", "grip.h", "ground.h", "effects.h", "body.h")
NATIVE = ("random.h", "sensors.h", "faults.h", "simulator.h")


@cache
def ffi() -> cffi.FFI:
    """Declarations of hil/physics and hil/native, with the controller's frames and inputs that they use."""
    headers = [paths.ROOT / "firmware" / "core" / "terrapin.h"]
    headers += [paths.ROOT / "hil" / "physics" / name for name in PHYSICS]
    headers += [paths.ROOT / "hil" / "native" / name for name in NATIVE]
    found = cffi.FFI()
    found.cdef(cdef([path.read_text(encoding="utf-8") for path in headers]))
    return found


@cache
def library() -> Any:
    """The shared library. OSError, naming the file, when it has not been built or is out of date."""
    path = paths.build() / "libterrapin_hil.so"
    if not path.is_file():
        raise OSError(2, "not built yet; run `make setup`", str(path))
    lib = ffi().dlopen(str(path))
    layout = ffi().sizeof("hil_simulator") << 32 | ffi().sizeof("hil_record")
    if getattr(lib, "hil_layout", lambda: 0)() != layout:
        raise OSError(8, "built from other sources; run `make setup`", str(path))
    return lib
