"""What every wire of an update offers, sealed or not."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from terrapin_hil.links.link import Sealing
from terrapin_hil.messages import Frame, interface
from terrapin_tools.flash.layout import ANSWERS

__all__ = ["Told", "Wire", "heard"]

Told = Callable[[str, int, int], None]  # (what is being done, bytes done, bytes in all)
ASK = 0.5  # s for an answer to what is asked beside the update


def heard() -> frozenset[int]:
    """Identifiers that a wire brings: of an update, and what opening a session with a sealed controller needs."""
    messages = interface().messages
    return frozenset((*ANSWERS, messages["SESSION"].id, messages["PARAMETER_VALUE"].id))


class Wire(ABC):
    """An open link. Failures are LinkError, or UserError with status 1: one line that names the link."""

    name: str
    session: Sealing | None = None  # with an application that has a link key; its boot loader has none

    def send(self, frames: Sequence[Frame]) -> None:
        """Sends frames in order, sealed where there is a session."""
        for piece in (frames,) if self.session is None else self.session.batches(frames):
            self.send_plain(piece)

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        """Sends one frame; the first answer that is `wanted`, None when none comes in time."""
        self.send([frame])
        end = time.monotonic() + ASK
        while time.monotonic() < end:
            for answer in self.receive(max(0.0, end - time.monotonic())):
                if wanted(answer):
                    return answer
        return None

    @abstractmethod
    def send_plain(self, frames: Sequence[Frame]) -> None:
        """Sends frames in order, as they are."""

    @abstractmethod
    def receive(self, wait: float) -> list[Frame]:
        """The next frames of those `heard`, in order; none when none comes within `wait` seconds."""

    @abstractmethod
    def wake(self) -> None:
        """Opens the other side's channel again: a reset closes it."""

    @abstractmethod
    def close(self) -> None: ...
