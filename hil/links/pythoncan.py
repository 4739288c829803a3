"""The controller on any bus that python-can knows: SocketCAN, slcan on a port, vendors' adapters."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import can

from hil.links.slcan import LinkError
from hil.links.wire import write_parameters
from hil.messages import Frame, Sender, interface
from hil.simulation import AnswerError, Simulation

__all__ = ["PythonCan"]


logging.getLogger("can").addHandler(logging.NullHandler())  # what matters of its words comes as an error


def _reason(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__


class PythonCan:
    """Lockstep over a CAN bus. A bus gives no sign that an answer is complete, so a telemetry frame that follows
    ACTUATE is taken in with the next tick and logged with its own."""

    def __init__(self, kind: str, channel: str, timeout: float = 2.0) -> None:
        self.name = f"{kind}:{channel}"
        self._timeout = timeout
        options: dict[str, Any] = {"sleep_after_open": 0.0} if kind == "slcan" else {}
        try:
            self._bus = can.Bus(interface=kind, channel=channel, bitrate=500_000, **options)
        except Exception as error:  # each adapter's driver has its own way of not being there
            raise LinkError(f"{self.name}: cannot open the link: {_reason(error)}") from None
        self._interface = interface()
        self._own = {m.id for m in self._interface.messages.values() if m.sender == "controller"}
        self._actuate = self._interface.messages["ACTUATE"].id
        self._sender = Sender(self._interface)

    def _send(self, frames: Sequence[Frame]) -> None:
        for identifier, data in frames:
            try:
                self._bus.send(
                    can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=self._timeout
                )
            except (can.CanError, OSError) as error:
                raise LinkError(f"{self.name}: {_reason(error)}") from None

    def _receive(self, until: int) -> list[Frame]:
        """The controller's frames up to the first with identifier `until`, that one included."""
        end = time.monotonic() + self._timeout
        frames: list[Frame] = []
        while True:
            try:
                message = self._bus.recv(max(0.0, end - time.monotonic()))
            except (can.CanError, OSError, ValueError, TypeError) as error:
                raise LinkError(f"{self.name}: the link disappeared ({error})") from None
            if message is None:
                raise LinkError(f"{self.name}: no answer within {self._timeout:g} s")
            if message.arbitration_id in self._own and not message.is_extended_id:
                frames.append((message.arbitration_id, bytes(message.data)))
                if message.arbitration_id == until:
                    return frames

    def _drain(self, wait: float = 0.05) -> list[Frame]:
        frames: list[Frame] = []
        while (message := self._bus.recv(wait)) is not None:
            if message.arbitration_id in self._own:
                frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def start(self, parameters: Mapping[str, float]) -> None:
        self._send([*self._sender.test_mode(False), *self._sender.test_mode()])
        self._drain()
        reply = self._interface.messages["PARAMETER_VALUE"].id

        def exchange(frames: Sequence[Frame]) -> list[Frame]:
            self._send(frames)
            return self._receive(reply)

        write_parameters(self._sender, self._interface, parameters, exchange)

    def advance(self, simulation: Simulation, ticks: int) -> None:
        try:
            for _ in range(ticks):
                frames = simulation.sense()
                if not frames:
                    simulation.answer(())
                    continue
                self._send(frames)
                *late, actuate = self._receive(self._actuate)
                for frame in late:
                    simulation.append(simulation.done - 1, frame)
                simulation.answer([actuate])
            if simulation.done == len(simulation.records):
                for frame in self._drain():
                    simulation.append(simulation.done - 1, frame)
        except AnswerError as error:
            raise LinkError(f"{self.name}: {error}") from None

    def close(self) -> None:
        self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
