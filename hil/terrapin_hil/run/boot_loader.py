"""The boot loader of the sources over an emulated flash of the chip, frame by frame, to rehearse flashing.

loader = BootLoader(Path("flash.bin"))          # made, erased, where it is absent; None keeps it in memory
loader.start()                                  # a reset; the slot that it starts, 0 when it stays
loader.take(frame, motor_on=False, now=1.5)     # its answers to a frame of an update
"""

from __future__ import annotations

import mmap
import re
from functools import cache
from pathlib import Path
from typing import Any

import cffi

from terrapin_hil import paths
from terrapin_hil.errors import UserError
from terrapin_hil.messages import Frame, interface
from terrapin_interface.cdef import cdef

__all__ = ["BootLoader"]

HEADERS = ("core/terrapin.h", None, "store/flash.h", "store/flash_emulated.h", "boot/sha2.h", "boot/ed25519.h",
           "boot/image.h", "boot/records.h", "boot/boot.h", "boot/update.h")  # fmt: skip
SIZE, SECTORS, WORD = 0x60000, 7, 4  # of the F405's flash up to the end of slot B


@cache
def _library(folder: Path, headers: Path) -> tuple[cffi.FFI, Any]:
    generated = folder / "generated" / "terrapin_interface.h"
    texts = [(headers / h if h else generated).read_text(encoding="utf-8") for h in HEADERS]
    ffi = cffi.FFI()
    ffi.cdef(cdef(texts).replace("[TERRAPIN_FLASH_F405_SECTORS]", "[12]"))
    return ffi, ffi.dlopen(str(folder / "libterrapin_boot.so"))


def _own_keys() -> tuple[bytes, list[int]]:
    """The two public keys of this build, and their numbers. UserError where it has none."""
    file = paths.simulator() / "generated" / "boot_key.h"
    try:
        words = [int(word, 16) for word in re.findall(r"0x([0-9A-F]+)U", file.read_text(encoding="utf-8"))]
    except OSError:
        raise UserError(
            "boot loader: a wheel has no key of its own; give it yours with --key, made by `terrapin keys new KEY.pem`"
        ) from None
    return bytes(words[:64]), words[64:66]


class BootLoader:
    """Flash, boot loader and update of one emulated chip."""

    def __init__(self, file: Path | None = None, key: tuple[bytes, int] | None = None) -> None:
        """`key`: the Ed25519 public key that images must be signed with, and its number (the first 32 bits of its
        hash); without it the keys of this build.

        UserError where it is not built, where there is no key (a wheel has none), or the file is no such flash.
        """
        headers, folder = paths.boot_headers(), paths.build()
        if headers is None or not (folder / "libterrapin_boot.so").is_file():
            raise UserError(f"boot loader: not built here; run {paths.make('setup')}")
        self._ffi, self._lib = _library(folder, headers)
        known, numbers = _own_keys() if key is None else (key[0] * 2, [key[1]] * 2)
        self._keys = self._ffi.new("uint8_t[64]", known)
        memory = self._map(file)
        self._bytes = self._ffi.from_buffer("uint8_t[]", memory)
        self._memory = self._ffi.new("terrapin_flash_emulated *")
        sectors = self._lib.terrapin_flash_f405_sectors
        self._lib.terrapin_flash_emulated_init(self._memory, self._bytes, sectors, SECTORS, WORD)
        self._flash = self._ffi.new("terrapin_flash *", self._lib.terrapin_flash_emulated_driver(self._memory))
        values = {"flash": self._flash, "keys": self._keys, "key_ids": numbers}
        self._boot = self._ffi.new("terrapin_boot *", values)
        self._update = self._ffi.new("terrapin_update *")
        self._frame = self._ffi.new("terrapin_frame *")
        self._replies = self._ffi.new("terrapin_frame[2]")
        self._requests = {
            message.id
            for name, message in interface().messages.items()
            if name.startswith("UPDATE_") and message.sender == "host"
        }
        self.slot = 0
        self.version = ""

    @staticmethod
    def _map(file: Path | None) -> bytearray | mmap.mmap:
        if file is None:
            return bytearray(b"\xff" * SIZE)
        try:
            if not file.exists():
                try:
                    file.write_bytes(b"\xff" * SIZE)
                except OSError:
                    file.unlink(missing_ok=True)  # half a flash would be refused from then on
                    raise
            if file.stat().st_size != SIZE:
                raise UserError(f"{file}: found {file.stat().st_size} bytes, expected the {SIZE} of a chip's flash")
            with file.open("r+b") as opened:
                return mmap.mmap(opened.fileno(), SIZE)
        except OSError as error:
            raise UserError(f"{file}: {error.strerror}, expected a file that can be written") from None

    def start(self, stay: bool = False) -> int:
        """A reset: the slot that is started (1: A, 2: B), 0 where the boot loader stays."""
        choice = self._ffi.new("terrapin_boot_choice *")
        if not stay:
            self._lib.terrapin_boot_choose(self._boot, choice)
        self.slot, version = int(choice.slot), choice.image.version
        self.version = f"{version.major}.{version.minor}.{version.revision}" if self.slot else ""
        self._lib.terrapin_update_init(self._update, self._boot, self.slot)
        return self.slot

    def confirm(self) -> bool:
        """What was started says that it works."""
        return bool(self._lib.terrapin_boot_confirm(self._boot, self.slot))

    def wants(self, identifier: int) -> bool:
        """A frame of an update, with the identifier of node 0."""
        return identifier in self._requests

    def take(self, frame: Frame, motor_on: bool, now: float) -> list[Frame]:
        """The answers to a frame of an update; `now` [s] is any clock that does not step back."""
        self._frame.id, self._frame.length = frame[0], len(frame[1])
        self._ffi.memmove(self._frame.data, frame[1], len(frame[1]))
        self._update.now_ms = int(now * 1e3) & 0xFFFFFFFF
        count = self._lib.terrapin_update_accept(self._update, self._frame, motor_on, self._replies)
        return [(int(r.id), bytes(r.data)[: r.length]) for r in self._replies[0:count]]

    @property
    def reset(self) -> tuple[bool, bool]:
        """Whether the last frame asked for a reset, and whether the boot loader is to stay after it."""
        return bool(self._update.reset), bool(self._update.stay)
