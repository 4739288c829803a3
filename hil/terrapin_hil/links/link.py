"""What every link offers: a controller that is reset, driven tick by tick, asked, and let go again."""

from __future__ import annotations

import errno
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol, Self

from terrapin_hil.messages import AnswerError, Frame, interface

if TYPE_CHECKING:
    from terrapin_hil.simulation import Simulation

__all__ = ["Link", "LinkError", "Sealable", "Sealing", "not_there", "refuse_production"]

IDENTITY_LIMIT = 5.0  # s; a controller that goes on by itself tells each second who it is


class LinkError(OSError):
    """The link failed: it disappeared, the other side stopped answering, or it sent what is no SLCAN. One line."""

    def __str__(self) -> str:
        return str(self.args[0])


def not_there(error: BaseException) -> str:
    """Why a link does not open: of what is not there in our words, else in those of the system or the driver."""
    number = getattr(error, "errno", None) or getattr(error.__cause__ or error.__context__, "errno", None)
    if number == errno.ENOENT:
        return "no such device; `terrapin flash --list` shows what is there"
    if number == errno.EAFNOSUPPORT:
        return "this system has no SocketCAN"
    said = getattr(error, "strerror", None) or str(error)
    return next(iter(said.splitlines()), "") or type(error).__name__


def refuse_production(name: str, listen: Callable[[float], Sequence[Frame]]) -> None:
    """Listens to a controller that goes on by itself until it tells who it is. LinkError when its image has no test
    mode. `listen` gives what comes within some seconds."""
    message = interface().messages["PORT_IDENTITY"]
    production = interface().enums["image_kind"]["production"]
    end = time.monotonic() + IDENTITY_LIMIT
    while time.monotonic() < end:
        told = [message.decode(data)["kind"] for identifier, data in listen(0.005) if identifier == message.id]
        if production in told:
            raise LinkError(
                f"{name}: found a production image, which has no test mode; expected a desk image: flash one of the "
                "same version (terrapin-BOARD-slot-a, without `production` in its name)"
            )
        if told:
            return


class Sealing(Protocol):
    """What seals the frames of a link (terrapin_hil.links.seal.Session)."""

    def batches(self, frames: Sequence[Frame]) -> Iterable[Sequence[Frame]]:
        """The frames as they go out, piece by piece, each when its time has come."""

    def heard(self, frames: Iterable[Frame]) -> None:
        """What the controller said, at work."""


class Sealable(Protocol):
    """What a seal can be put on: a link, or the wire of an update."""

    name: str
    session: Sealing | None  # seals all that is sent, from when it is set

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        """Sends one frame; an answer to it that is `wanted`, None when none is."""


class Link(ABC):
    """An open controller. Failures are LinkError: one line that names the link."""

    name: str
    session: Sealing | None = None  # with a controller that has a link key (terrapin_hil.links.seal.seal_link)

    def outgoing(self, frames: Sequence[Frame]) -> Iterable[Sequence[Frame]]:
        """The frames as they go out: sealed, where the controller has a link key."""
        return (frames,) if self.session is None else self.session.batches(frames)

    def incoming(self, frames: list[Frame]) -> list[Frame]:
        """The frames that came from a controller at work: its session notes an interruption by them."""
        if self.session is not None:
            self.session.heard(frames)
        return frames

    @abstractmethod
    def start(self, parameters: Mapping[str, float]) -> None:
        """Resets the controller, arms test mode, and sets parameters, in their units. ParameterError for one that it
        refuses."""

    @abstractmethod
    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        """Sends frames; what the controller answers to them."""

    def advance(self, simulation: Simulation, ticks: int) -> None:
        """`ticks` ticks of lockstep; `simulation.done` says how far it came when it fails."""
        try:
            for _ in range(ticks):
                frames = simulation.sense()
                simulation.answer(self.exchange(frames) if frames else ())
        except AnswerError as error:
            raise LinkError(f"{self.name}: {error}") from None

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        """Sends one frame to a controller that may be at work; its last answer that is `wanted`, None when none is."""
        answers = [answer for answer in self.exchange([frame]) if wanted(answer)]
        return answers[-1] if answers else None

    @abstractmethod
    def close(self) -> None:
        """Lets go of the controller; its bridge is off then. Closing twice is allowed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
