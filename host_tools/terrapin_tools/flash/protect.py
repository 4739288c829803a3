"""The option bytes that keep a debug probe out: write protection of the boot loader, read protection, brown-out reset.

    protect(swd, public_key, boot_loader_on_the_chip)

RM0090, 3.6 (unlock, change, start, wait) and 3.9.10 (FLASH_OPTCR). Read protection is of level 1: going back to level 0
erases the whole chip. Level 2, which nothing takes back, is not set here.
"""

from __future__ import annotations

import time
from typing import Protocol

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from terrapin_tools.errors import UserError
from terrapin_tools.flash.keys import key_hash, key_in

__all__ = ["Registers", "protect", "protected", "refuse_bench_key"]

OPTKEYR, SR, OPTCR = 0x4002_3C08, 0x4002_3C0C, 0x4002_3C14
KEYS = (0x0819_2A3B, 0x4C5D_6E7F)
LOCK, START, BUSY = 1 << 0, 1 << 1, 1 << 16
BROWN_OUT, BROWN_OUT_2 = 3 << 2, 1 << 2  # level 2, 2.4 V: the port stops the bridge at 2.7 V before that
READ, READ_0, READ_1, READ_2 = 0xFF << 8, 0xAA << 8, 0xBB << 8, 0xCC << 8
SECTOR_0 = 1 << 16  # 0 protects it
BUSY_LIMIT = 5.0  # s


class Registers(Protocol):
    """The chip's memory, word by word. Failures are UserError."""

    name: str

    def read32(self, address: int) -> int: ...
    def write32(self, address: int, value: int) -> None: ...


def refuse_bench_key(name: str, loader: bytes, key: Ed25519PublicKey, bench: Ed25519PublicKey | None) -> None:
    """UserError unless the boot loader on the chip starts images of `key`, and none of the bench's."""
    if bench is not None and key_hash(key) == key_hash(bench):
        raise UserError("--key: the key of the bench; expected that of a release")
    if bench is not None and key_in(loader, key_hash(bench)) is not None:
        raise UserError(f"{name}: its boot loader starts images of the bench, too; expected that of a release")
    if key_in(loader, key_hash(key)) is None:
        raise UserError(
            f"{name}: its boot loader does not know the key {key_hash(key)[:4].hex()}; nothing is protected"
        )


def protected(options: int) -> int:
    """What FLASH_OPTCR shall be."""
    return options & ~(READ | BROWN_OUT | SECTOR_0 | LOCK | START) | READ_1 | BROWN_OUT_2


def protect(chip: Registers) -> bool:
    """Set and read back; False when all of it was set already. UserError when the chip refuses."""
    now = chip.read32(OPTCR)
    wanted = protected(now)
    if now & READ == READ_2:
        raise UserError(f"{chip.name}: read protection is of level 2, for ever: nothing can be set", status=1)
    if now & ~LOCK == wanted:
        return False
    for key in KEYS:
        chip.write32(OPTKEYR, key)
    if chip.read32(OPTCR) & LOCK:
        raise UserError(f"{chip.name}: the option bytes stay locked until its next reset", status=1)
    chip.write32(OPTCR, wanted)
    chip.write32(OPTCR, wanted | START)
    end = time.monotonic() + BUSY_LIMIT
    while chip.read32(SR) & BUSY:
        if time.monotonic() > end:
            raise UserError(f"{chip.name}: the option bytes are not written after {BUSY_LIMIT:g} s", status=1)
    found = chip.read32(OPTCR) & ~(LOCK | START)
    chip.write32(OPTCR, wanted | LOCK)
    if found != wanted:
        raise UserError(f"{chip.name}: option bytes: 0x{wanted:08x} was written, 0x{found:08x} stands", status=1)
    return True
