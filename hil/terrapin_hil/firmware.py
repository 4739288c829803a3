"""The controller's C step, opened from Python: libterrapin.so through cffi (ABI mode).

    firmware = Firmware.open()
    state = firmware.new_state()
    firmware.set_parameter(state, "supply_compensation", 1.0)
    firmware.lib.terrapin_step(state, inputs, outputs)

Loops that count give `firmware.step` (the address of terrapin_step) and the state's address to compiled code instead.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import cffi

from terrapin_hil import paths
from terrapin_hil.messages import Interface, ParameterError, interface

__all__ = ["Firmware", "ParameterError"]


@cache
def _ffi(text: str) -> cffi.FFI:
    ffi = cffi.FFI()
    ffi.cdef(text)
    return ffi


class Firmware:
    """The controller of one build. `ffi` and `lib` are cffi's; all functions of the C headers are in `lib`."""

    def __init__(self, folder: Path) -> None:
        library, declarations = folder / "libterrapin.so", folder / "generated" / "terrapin_cdef.h"
        self.folder = folder
        self.ffi = _ffi(paths.need(declarations).read_text(encoding="utf-8"))
        self.lib: Any = self.ffi.dlopen(str(paths.need(library)))
        self.interface: Interface = interface(folder)

    @classmethod
    def open(cls, folder: Path | None = None) -> Firmware:
        """Controller in the build folder `folder` (the host build by default). OSError when it is not built."""
        return cls(folder or paths.build())

    @property
    def state_size(self) -> int:
        """Bytes of a state."""
        return int(self.lib.terrapin_state_size())

    @property
    def step(self) -> int:
        """Address of terrapin_step, for compiled loops."""
        return self._address("terrapin_step")

    def _address(self, function: str) -> int:
        return int(self.ffi.cast("uintptr_t", self.ffi.addressof(self.lib, function)))

    def new_state(self) -> Any:
        """A controller after reset: `terrapin_state *`. It lives as long as the returned object."""
        memory = self.ffi.new("uint64_t[]", (self.state_size + 7) // 8)  # aligned to 8 bytes
        state = self.ffi.gc(self.ffi.cast("terrapin_state *", memory), lambda _: memory)  # keeps the memory alive
        self.lib.terrapin_init(state)
        return state

    def address(self, pointer: Any) -> int:
        """Address of a cffi object, for compiled loops."""
        return int(self.ffi.cast("uintptr_t", pointer))

    def set_parameter(self, state: Any, name: str, physical: float) -> None:
        """Set a parameter, in its unit. ParameterError when unknown, out of range, or locked (bridge on)."""
        parameter = self.interface.parameter(name)
        self._check(name, self.lib.terrapin_parameter_set(state, parameter.index, parameter.raw(physical)))

    def get_parameter(self, state: Any, name: str) -> float:
        """A parameter's value, in its unit. ParameterError when unknown."""
        parameter = self.interface.parameter(name)
        value = self.ffi.new("int32_t *")
        self._check(name, self.lib.terrapin_parameter_get(state, parameter.index, value))
        return float(value[0] * parameter.scale)

    def _check(self, name: str, result: int) -> None:
        reasons = {
            self.lib.TERRAPIN_PARAMETER_UNKNOWN: "the firmware does not know it (another version?)",
            self.lib.TERRAPIN_PARAMETER_RANGE: "the firmware refuses the value as out of range",
            self.lib.TERRAPIN_PARAMETER_LOCKED: "locked while the bridge is on",
        }
        if result != self.lib.TERRAPIN_PARAMETER_OK:
            raise ParameterError(f"parameter {name}: {reasons.get(result, f'refused with status {result}')}")
