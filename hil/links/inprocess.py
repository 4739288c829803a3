"""The controller in this process: the same C step, called from the simulator's C loop."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from hil.firmware import Firmware
from hil.messages import Frame
from hil.simulation import Simulation

__all__ = ["InProcess"]


class InProcess:
    """Link to the step in libterrapin.so."""

    name = "inprocess"

    def __init__(self, firmware: Firmware | None = None) -> None:
        self.firmware = firmware or Firmware.open()
        self._state = self.firmware.new_state()
        self._wire: Any = None

    def start(self, parameters: Mapping[str, float]) -> None:
        self._state = self.firmware.new_state()
        for name, value in parameters.items():
            self.firmware.set_parameter(self._state, name, value)

        self._wire = None

    def advance(self, simulation: Simulation, ticks: int) -> None:
        if simulation.disturbed:
            self._by_frames(simulation, ticks)
        else:
            simulation.run(self.firmware.step, self.firmware.address(self._state), ticks)

    def _by_frames(self, simulation: Simulation, ticks: int) -> None:
        """Through the dispatcher, as over a wire; the test mode of the link is armed, the state is ours."""
        ffi, lib = self.firmware.ffi, self.firmware.lib
        if self._wire is None:
            link, inputs = ffi.new("terrapin_link *"), ffi.new("terrapin_inputs *")
            lib.terrapin_link_init(link, self.firmware.new_state(), inputs)
            link.test_mode = True
            self._wire = (link, inputs, ffi.new("terrapin_outputs *"), ffi.new("terrapin_frame *"))
        link, inputs, outputs, reply = self._wire
        for _ in range(ticks):
            answer: list[Frame] = []
            for identifier, data in simulation.sense():
                frame = ffi.new("terrapin_frame *", {"id": identifier, "length": len(data), "data": data})
                result = lib.terrapin_accept(link, self._state, frame, inputs, reply)
                if result == lib.TERRAPIN_ACCEPT_STEP:
                    lib.terrapin_link_step(self._state, inputs, outputs)
                    answer += [
                        (int(f.id), bytes(f.data[0 : f.length])) for f in outputs.frames[0 : outputs.frame_count]
                    ]
            simulation.answer(answer)

    def close(self) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
