"""How long an update takes on a CAN bus of 1 Mbit/s, in the bus's own time: 64 kB in at most 10 s.

Counted are: each frame with the most stuffing bits that it can have, erase and programming times of the STM32F405
(DS8626, typical and maximum, in store/flash_emulated.c), the time that host and adapter take to answer (1 ms: USB), and
the verification: 16.0 million instructions on a Cortex-M4 (measured in QEMU, 64 kB, -Os), taken as 2 cycles each at
168 MHz.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import pytest
from bootlib import Chip
from kit import PUBLIC, image

from terrapin_hil.messages import Frame
from terrapin_tools.flash.image import parse
from terrapin_tools.flash.update import SignedFile, update

TURNAROUND = 1e-3  # s
VERIFY = 16.0e6 * 2 / 168e6  # s
LIMIT = 10.0  # s
SIZE = 65536


def frame_time(frame: Frame, bit_rate: float = 1e6) -> float:
    """Of a classic frame with an 11-bit identifier, longest case, with the 3 bits before the next (ISO 11898-1)."""
    bits = 8 * len(frame[1])
    return (47 + bits + (34 + bits - 1) // 4) / bit_rate


class Timed:
    """A wire straight into a chip, that adds up what would take time."""

    name = "timed"

    def __init__(self, longest: bool, bit_rate: float) -> None:
        self.chip = Chip(PUBLIC)
        self.chip.put("a", image("a", "1.0.0"))
        self.chip.start()
        self.chip.confirm()
        self.longest, self.bit_rate = longest, bit_rate
        self.seconds = 0.0
        self.frames = 0
        self._answers: deque[Frame] = deque()

    def _busy(self) -> float:
        memory = self.chip.memory
        return (memory.busy_longest_us if self.longest else memory.busy_us) * 1e-6

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            before = self._busy()
            answers = self.chip.accept(*frame)
            self.seconds += frame_time(frame, self.bit_rate) + self._busy() - before
            if frame[0] == 0x0A3:
                self.seconds += VERIFY
            self.seconds += sum(frame_time(answer, self.bit_rate) for answer in answers)
            self.seconds += TURNAROUND if answers else 0.0
            self.frames += 1 + len(answers)
            self._answers += answers
            if self.chip.update.reset:
                if self.chip.update.stay:
                    self.chip.lib.terrapin_update_init(self.chip.update, self.chip.boot, 0)
                else:
                    self.chip.start()
                    self.seconds += 2 * VERIFY  # of a pending image that is good only one; an upper bound
                    self.chip.confirm()

    def receive(self, wait: float) -> list[Frame]:
        return [self._answers.popleft()] if self._answers else []

    def wake(self) -> None:
        pass

    def close(self) -> None:
        pass


def image_of(size: int) -> SignedFile:
    overhead = len(image("b", "1.1.0")) - 600
    data = image("b", "1.1.0", size=size - overhead)
    assert len(data) == size
    return SignedFile("64 kB", parse(data), data)


@pytest.mark.parametrize("longest", [False, True], ids=["typical", "maximum"])
def test_64_kb_at_1_mbit(longest: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_tools.flash.update.START", 0.0)
    monkeypatch.setattr("terrapin_tools.flash.update.ASK_EVERY", 0.0)
    wire = Timed(longest, 1e6)
    assert update(wire, [image_of(SIZE)], lambda *_: None).state == "confirmed"
    print(f"64 kB, flash times {'at most' if longest else 'typical'}: {wire.seconds:.2f} s, {wire.frames} frames")
    assert wire.seconds <= LIMIT
    assert wire.seconds > 8192 * 111e-6 + 1.0  # too short would mean that something is not counted


def test_the_frames_alone() -> None:
    assert frame_time((0x0A1, bytes(8))) == pytest.approx(135e-6)  # ISO 11898-1: 135 bits at most
    assert frame_time((0x0A4, bytes(1))) == pytest.approx(65e-6)
