"""Where things stand in the flash of the STM32F405, as firmware/boot/layout.h has it, and identifiers of an update."""

from __future__ import annotations

__all__ = ["ANSWERS", "BASE", "HEADER_SIZE", "RAM", "RECORDS", "SLOTS", "SLOT_SIZE", "slot_at"]

BASE = 0x0800_0000
HEADER_SIZE = 0x200
SLOT_SIZE = 0x2_0000
RAM = range(0x2000_0000, 0x2002_0001)  # where a stack may begin, which grows down
SLOTS = {"a": BASE + 0x2_0000, "b": BASE + 0x4_0000}  # name -> address of the image's header
RECORDS = ((BASE + 0xC000, 0x4000), (BASE + 0x1_0000, 0x1_0000))  # the boot loader's log: (address, bytes)
ANSWERS = range(0x1A0, 0x1A8)  # identifiers of what a controller says of an update, at node 0


def slot_at(address: int) -> str | None:
    """The slot that holds the address.

    >>> slot_at(0x0804_0200)
    'b'
    """
    return next((name for name, start in SLOTS.items() if start <= address < start + SLOT_SIZE), None)
