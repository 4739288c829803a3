"""Lockstep over a CAN bus, whatever brings its frames (raw SocketCAN, python-can)."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from terrapin_hil.links.link import Link, LinkError, refuse_production
from terrapin_hil.links.wire import BY_ITSELF, write_parameters
from terrapin_hil.messages import AnswerError, Frame, Sender, interface

if TYPE_CHECKING:
    from terrapin_hil.simulation import Simulation

__all__ = ["Bus", "BusLink"]

MOST_OLD = 10_000  # frames that may wait in a bus's queue
QUIET = 0.03  # s after an answer in which nothing more may come from a controller in test mode


class Bus(Protocol):
    """An open bus. Failures are LinkError: one line that names the bus."""

    name: str

    def send(self, frames: Sequence[Frame]) -> None: ...

    def receive(self, wait: float) -> list[Frame]:
        """The frames with identifiers of the controller that are there; it waits `wait` seconds for the first."""

    def close(self) -> None: ...


class BusLink(Link):
    """Link over a bus. A bus gives no sign that an answer is complete, so a telemetry frame that follows ACTUATE is
    taken in with the next tick and logged with its own."""

    def __init__(self, bus: Bus, timeout: float = 2.0) -> None:
        self.name = bus.name
        self._bus = bus
        self._timeout = timeout
        self._interface = interface()
        self._actuate = self._interface.messages["ACTUATE"].id
        self._sender = Sender(self._interface)
        self._waiting: deque[Frame] = deque()  # received, not yet asked for
        self._lockstep = False  # what comes is of a tick and kept, whoever asks for something else

    def _send(self, frames: Sequence[Frame]) -> None:
        for piece in self.outgoing(frames):
            self._bus.send(piece)

    def _receive(self, until: int) -> list[Frame]:
        """The controller's frames up to the first with identifier `until`, that one included."""
        end = 0.0
        frames: list[Frame] = []
        while True:
            while self._waiting:
                frames.append(self._waiting.popleft())
                if frames[-1][0] == until:
                    return frames
            # The clock is asked only when more than one call is needed: in lockstep each call of the system counts.
            wait = max(0.0, end - time.monotonic()) if end else self._timeout
            self._waiting += self._bus.receive(wait)
            if not self._waiting:
                raise LinkError(f"{self.name}: no answer within {self._timeout:g} s")
            end = end or time.monotonic() + self._timeout

    def _drain(self, wait: float = 0.05) -> list[Frame]:
        while heard := self._bus.receive(wait):
            self._waiting += heard
        frames = list(self._waiting)
        self._waiting.clear()
        return frames

    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        """Sends the frames of one tick; its ACTUATE, after the telemetry of the tick before that had not come yet."""
        self._send(frames)
        return self._receive(self._actuate)

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        end = time.monotonic() + self._timeout
        self._send([frame])
        while (left := end - time.monotonic()) > 0:
            heard = self._bus.receive(left)
            found = next((answer for answer in heard if wanted(answer)), None)
            if self._lockstep:
                self._waiting += (answer for answer in heard if answer is not found)
            if found is not None:
                return found
        return None

    def start(self, parameters: Mapping[str, float]) -> None:
        reply = self._interface.messages["PARAMETER_VALUE"].id

        def asked(frames: Sequence[Frame]) -> list[Frame]:
            self._send(frames)
            return self._receive(reply)

        for _ in range(MOST_OLD):  # a full queue would have no place for the answer
            if not self._bus.receive(0.0):
                break
        self._waiting.clear()
        # What comes before the answer is of the time before test mode, when the controller may step by itself.
        question = self._sender.frame("PARAMETER_READ", {"index": 0})
        asked([*self._sender.test_mode(False), *self._sender.test_mode(), question])
        self._require_quiet(reply)
        write_parameters(self._sender, self._interface, parameters, asked)
        self._lockstep = True

    def _require_quiet(self, reply: int) -> None:
        """LinkError when more comes than the one answer (`reply`) to the one question."""
        heard = [*self._waiting, *self._bus.receive(QUIET)]

        def listen(seconds: float) -> list[Frame]:
            heard.extend(more := self.talk((), seconds))
            return more

        def second() -> bool:
            return any(identifier == reply for identifier, _ in heard)

        if heard and not second():
            refuse_production(self.name, listen)  # meanwhile a second one that is slow may have answered, too
        if second():
            raise LinkError(f"{self.name}: found more than one controller with this node number, expected one")
        if heard:
            raise LinkError(f"{self.name}: {BY_ITSELF}")

    def advance(self, simulation: Simulation, ticks: int) -> None:
        try:
            for _ in range(ticks):
                frames = simulation.sense()
                if not frames:
                    simulation.answer(())
                    continue
                *late, actuate = self.exchange(frames)
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
        self._send(frames)
        end = time.monotonic() + wait
        heard: list[Frame] = []
        while (left := end - time.monotonic()) > 0:
            heard += self._bus.receive(left)
        return self.incoming(heard)

    def close(self) -> None:
        self._bus.close()
