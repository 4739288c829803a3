"""The controller at the other end of SLCAN: a process on a pty of its own, or a board on a serial port."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from hil.firmware import ParameterError
from hil.links.slcan import ControllerProcess, LinkError, SlcanPort, slcan_line
from hil.messages import Frame, Interface, Sender, interface
from hil.simulation import AnswerError, Simulation

__all__ = ["SlcanLink", "write_parameters"]

Exchange = Callable[[Sequence[Frame]], Sequence[Frame]]


def write_parameters(
    sender: Sender, description: Interface, parameters: Mapping[str, float], exchange: Exchange
) -> None:
    """Sets parameters by PARAMETER_WRITE, each confirmed by PARAMETER_VALUE. ParameterError when one is refused."""
    reply = description.messages["PARAMETER_VALUE"]
    for name, physical in parameters.items():
        try:
            parameter = description.parameter(name)
            raw = parameter.raw(physical)
        except (KeyError, ValueError) as error:
            raise ParameterError(error.args[0]) from None
        frame = sender.frame("PARAMETER_WRITE", {"index": parameter.index, "value": raw})
        answers = [data for identifier, data in exchange([frame]) if identifier == reply.id]
        if not answers:
            raise LinkError(f"parameter {name}: the controller does not confirm it")
        answer = reply.decode(answers[-1])
        if answer["status"] != 0 or answer["index"] != parameter.index or answer["value"] != raw:
            reasons = {1: "it does not know it", 2: "out of range", 3: "locked while the bridge is on"}
            reason = reasons.get(answer["status"], "another value came back")
            raise ParameterError(f"parameter {name}: the controller refuses {physical:g}: {reason}")


class SlcanLink:
    """Lockstep over an SLCAN port. The controller is in test mode from `start` on: its physical bridge stays off."""

    def __init__(self, name: str, port: SlcanPort, process: ControllerProcess | None = None) -> None:
        self.name = name
        self._port = port
        self._process = process
        self._interface = interface()
        self._sender = Sender(self._interface)

    @classmethod
    def of_process(cls, program: Path | None = None) -> SlcanLink:
        """Starts a controller (the host build's by default) on a pty. LinkError when it does not start."""
        process = ControllerProcess(program)
        path = process.start()
        try:
            return cls("pty", SlcanPort.open(path), process)
        except BaseException:
            process.stop()
            raise

    @classmethod
    def of_device(cls, device: str) -> SlcanLink:
        """Opens a serial port or pty that exists. LinkError when it does not answer."""
        return cls(f"serial:{device}", SlcanPort.open(device))

    def start(self, parameters: Mapping[str, float]) -> None:
        self._port.exchange_frames(self._sender.test_mode(False))
        self._port.exchange_frames(self._sender.test_mode())
        write_parameters(self._sender, self._interface, parameters, lambda frames: self._port.exchange_frames(frames))

    def advance(self, simulation: Simulation, ticks: int) -> None:
        port = self._port
        try:
            for _ in range(ticks):
                frames = simulation.sense()
                if frames:
                    simulation.answer(port.exchange(b"".join(map(slcan_line, frames))))
                else:
                    simulation.answer(())
        except AnswerError as error:
            raise LinkError(f"{self.name}: {error}") from None

    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        """Sends frames; what the controller answers to them. LinkError when it does not."""
        return self._port.exchange(b"".join(map(slcan_line, frames)))

    def talk(self, frames: Sequence[Frame], wait: float) -> list[Frame]:
        """Sends frames to a controller that steps by itself; what it sends within `wait` seconds."""
        heard = self._port.exchange_frames(frames)
        time.sleep(wait)
        return [*heard, *self._port.exchange(b"F\r")]  # all that has come stands before the answer to this

    def close(self) -> None:
        self._port.close()
        if self._process is not None:
            self._process.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
