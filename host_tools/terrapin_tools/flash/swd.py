"""A debug probe on the chip's SWD pins, by pyOCD (extra `swd`).

pyOCD knows no STM32F405 without a download; the STM32F412xG has the same flash controller and sectors (RM0090 and
RM0402), and its flash algorithm is used. That the chip is an F405 is read from its identity register.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.extras import need
from terrapin_tools.flash.wire import Told

__all__ = ["Swd", "probes"]

TARGET = "stm32f412xg"
IDENTITY = 0xE004_2000  # DBGMCU_IDCODE; device in its low 12 bits
F405 = 0x413  # STM32F405/407/415/417


def _pyocd() -> Any:
    need("--via swd", "pyocd", "swd")
    from pyocd.core import helpers

    logging.getLogger("pyocd").setLevel(logging.CRITICAL)  # what matters of its words comes as an error
    return helpers.ConnectHelper


def probes() -> list[tuple[str, str]]:
    """Debug probes that are plugged in: (unique id, what it is). UserError when pyOCD is not installed."""
    found = _pyocd().get_all_connected_probes(blocking=False, print_wait_message=False)
    return [(str(probe.unique_id), str(probe.description)) for probe in found]


class Swd:
    """An open session. UserError: no probe, several, no chip behind it, another chip."""

    chunk = 4096

    def __init__(self, unique_id: str | None = None) -> None:
        helper = _pyocd()
        found = helper.get_all_connected_probes(blocking=False, print_wait_message=False)
        chosen = [probe for probe in found if unique_id in (None, probe.unique_id)]
        if not chosen:
            what = f"no debug probe {unique_id}" if unique_id else "no debug probe"
            others = ", ".join(str(probe.unique_id) for probe in found) or "none is plugged in"
            raise UserError(f"{what}; found: {others} (`terrapin flash --list`)", status=1)
        if len(chosen) > 1:
            names = ", ".join(str(probe.unique_id) for probe in chosen)
            raise UserError(f"several debug probes: {names}; choose one with --port")
        from pyocd.core.session import Session

        options = {"target_override": TARGET, "connect_mode": "under-reset", "hide_programming_progress": True}
        self._open(Session(chosen[0], options=options), str(chosen[0].unique_id))

    def _open(self, session: Any, name: str) -> None:
        self.name = name
        self._session = session
        try:
            session.open()
            identity = session.target.read32(IDENTITY) & 0xFFF
        except Exception as error:  # pyOCD and each probe's driver have their own
            self.close()
            raise UserError(f"{name}: no chip answers behind the probe: {error}", status=1) from None
        if identity != F405:
            self.close()
            raise UserError(f"{name}: wrong chip: identifier 0x{identity:03x}, expected 0x{F405:03x} (STM32F405)")

    def close(self) -> None:
        with contextlib.suppress(Exception):  # a probe that was unplugged has nothing left to close
            self._session.close()

    @contextlib.contextmanager
    def _trying(self, what: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            raise UserError(f"{self.name}: cannot {what}: {error}", status=1) from None

    def erase(self, regions: Sequence[tuple[int, int]], told: Told) -> None:
        from pyocd.flash.eraser import FlashEraser

        for done, (address, size) in enumerate(regions):
            told("erasing", done, len(regions))
            with self._trying(f"erase 0x{address:08x}"):
                FlashEraser(self._session, FlashEraser.Mode.SECTOR).erase([(address, address + size)])

    def write(self, address: int, data: bytes, told: Told) -> None:
        from pyocd.flash.loader import FlashLoader

        def part(done: float) -> None:
            told("writing", round(done * len(data)), len(data))

        with self._trying(f"write 0x{address:08x}"):
            loader = FlashLoader(self._session, progress=part, chip_erase="sector")
            loader.add_data(address, data)
            loader.commit()

    def read(self, address: int, size: int) -> bytes:
        """At most `chunk` bytes of the flash."""
        with self._trying("read"):
            return bytes(self._session.target.read_memory_block8(address, size))

    def read32(self, address: int) -> int:
        """A word of the memory."""
        with self._trying(f"read 0x{address:08x}"):
            return int(self._session.target.read32(address))

    def write32(self, address: int, value: int) -> None:
        """A word of the memory."""
        with self._trying(f"write 0x{address:08x}"):
            self._session.target.write32(address, value)

    def start(self) -> None:
        with self._trying("reset the chip"):
            self._session.target.reset()
