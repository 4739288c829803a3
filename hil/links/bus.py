"""Lockstep over a CAN bus, whatever brings its frames (raw SocketCAN, python-can)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Protocol, Self

from hil.links.slcan import LinkError
from hil.links.wire import write_parameters
from hil.messages import Frame, Sender, interface
from hil.simulation import AnswerError, Simulation

__all__ = ["Bus", "BusLink"]

MOST_OLD = 10_000  # frames that may wait in a bus's queue


class Bus(Protocol):
    """An open bus. Failures are LinkError: one line that names the bus."""

    name: str

    def send(self, frames: Sequence[Frame]) -> None: ...

    def receive(self, wait: float) -> Frame | None:
        """The next frame with an identifier of the controller; None when none comes within `wait` seconds."""

    def close(self) -> None: ...


class BusLink:
    """Link over a bus. A bus gives no sign that an answer is complete, so a telemetry frame that follows ACTUATE is
    taken in with the next tick and logged with its own."""

    def __init__(self, bus: Bus, timeout: float = 2.0) -> None:
        self.name = bus.name
        self._bus = bus
        self._timeout = timeout
        self._interface = interface()
        self._actuate = self._interface.messages["ACTUATE"].id
        self._sender = Sender(self._interface)

    def _receive(self, until: int) -> list[Frame]:
        """The controller's frames up to the first with identifier `until`, that one included."""
        end = 0.0
        frames: list[Frame] = []
        while True:
            # The clock is asked only when other frames come first: two calls of the system less a tick.
            wait = self._timeout if not frames else max(0.0, end - time.monotonic())
            frame = self._bus.receive(wait)
            if frame is None:
                raise LinkError(f"{self.name}: no answer within {self._timeout:g} s")
            frames.append(frame)
            if frame[0] == until:
                return frames
            if len(frames) == 1:
                end = time.monotonic() + self._timeout

    def _drain(self, wait: float = 0.05) -> list[Frame]:
        frames: list[Frame] = []
        while (frame := self._bus.receive(wait)) is not None:
            frames.append(frame)
        return frames

    def start(self, parameters: Mapping[str, float]) -> None:
        reply = self._interface.messages["PARAMETER_VALUE"].id

        def exchange(frames: Sequence[Frame]) -> list[Frame]:
            self._bus.send(frames)
            return self._receive(reply)

        for _ in range(MOST_OLD):  # a full queue would have no place for the answer
            if self._bus.receive(0.0) is None:
                break
        # What comes before the answer is of the time before test mode, when the controller may step by itself.
        question = self._sender.frame("PARAMETER_READ", {"index": 0})
        exchange([*self._sender.test_mode(False), *self._sender.test_mode(), question])

        write_parameters(self._sender, self._interface, parameters, exchange)

    def advance(self, simulation: Simulation, ticks: int) -> None:
        try:
            for _ in range(ticks):
                frames = simulation.sense()
                if not frames:
                    simulation.answer(())
                    continue
                self._bus.send(frames)
                *late, actuate = self._receive(self._actuate)
                for frame in late:
                    simulation.append(simulation.done - 1, frame)
                simulation.answer([actuate])
            if simulation.done == len(simulation.records):
                for frame in self._drain():
                    simulation.append(simulation.done - 1, frame)
        except AnswerError as error:
            raise LinkError(f"{self.name}: {error}") from None

    def talk(self, frames: Sequence[Frame], wait: float) -> list[Frame]:
        """Sends frames to a controller that steps by itself; what it sends within `wait` seconds."""
        self._bus.send(frames)
        end = time.monotonic() + wait
        heard: list[Frame] = []
        while (left := end - time.monotonic()) > 0:
            if (frame := self._bus.receive(left)) is not None:
                heard.append(frame)
        return heard

    def close(self) -> None:
        self._bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
