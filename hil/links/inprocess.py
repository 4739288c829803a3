"""The controller in this process: the same C step, called from the simulator's C loop."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import Self

from hil.firmware import Firmware
from hil.simulation import Simulation

__all__ = ["InProcess"]


class InProcess:
    """Link to the step in libterrapin.so."""

    name = "inprocess"

    def __init__(self, firmware: Firmware | None = None) -> None:
        self.firmware = firmware or Firmware.open()
        self._state = self.firmware.new_state()

    def start(self, parameters: Mapping[str, float]) -> None:
        self._state = self.firmware.new_state()
        for name, value in parameters.items():
            self.firmware.set_parameter(self._state, name, value)

    def advance(self, simulation: Simulation, ticks: int) -> None:
        simulation.run(self.firmware.step, self.firmware.address(self._state), ticks)

    def close(self) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
