"""The boot loader's library through cffi, an emulated flash, and a host for its update messages."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import cffi
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from terrapin_hil import paths
from terrapin_hil.messages import Sender, interface
from terrapin_interface.cdef import cdef
from terrapin_tools.flash.keys import key_hash
from terrapin_tools.flash.layout import BASE, HEADER_SIZE

HEADERS = (
    "core/terrapin.h", None, "store/flash.h", "store/flash_emulated.h", "boot/sha2.h", "boot/ed25519.h", "boot/image.h",
    "boot/records.h", "boot/boot.h", "boot/update.h",
)  # fmt: skip
SIZE = 0x60000  # up to the end of slot B
SECTORS = 7
SLOT = {"a": 1, "b": 2}
START = {"a": 0x20000, "b": 0x40000}
NONE, PENDING, TRIAL = 0, 1, 2
TLVS = 144  # bytes behind what is hashed: info, SHA-256, key hash, signature
CUTS = ("before", "after", "torn", "part", "noise")


@cache
def library(path: str = "") -> tuple[cffi.FFI, Any]:
    """ffi and lib of libterrapin_boot.so, that of the build unless BOOT_LIBRARY names another."""
    generated = paths.build() / "generated" / "terrapin_interface.h"
    texts = [(paths.ROOT / "firmware" / h if h else generated).read_text(encoding="utf-8") for h in HEADERS]
    text = cdef(texts).replace("extern const uint32_t terrapin_flash_f405_sectors[TERRAPIN_FLASH_F405_SECTORS];",
                               "extern const uint32_t terrapin_flash_f405_sectors[12];")  # fmt: skip
    ffi = cffi.FFI()
    ffi.cdef(text)
    return ffi, ffi.dlopen(path or os.environ.get("BOOT_LIBRARY") or str(paths.build() / "libterrapin_boot.so"))


def key_id(key: bytes) -> int:
    """The first four bytes of the name of a public key."""
    return int.from_bytes(key_hash(Ed25519PublicKey.from_public_bytes(key))[:4], "little")


class Chip:
    """Flash, boot loader and update machine of one emulated controller."""

    def __init__(self, key: bytes, next_key: bytes = b"") -> None:
        self.ffi, self.lib = library()
        self.bytes = self.ffi.new("uint8_t[]", b"\xff" * SIZE)
        self.memory = self.ffi.new("terrapin_flash_emulated *")
        self.lib.terrapin_flash_emulated_init(self.memory, self.bytes, self.lib.terrapin_flash_f405_sectors, SECTORS, 4)
        self.flash = self.ffi.new("terrapin_flash *", self.lib.terrapin_flash_emulated_driver(self.memory))
        pair = (key, next_key or key)
        self.keys = self.ffi.new("uint8_t[64]", b"".join(pair))
        values = {"flash": self.flash, "keys": self.keys, "key_ids": [key_id(each) for each in pair]}
        self.boot = self.ffi.new("terrapin_boot *", values)
        self.update = self.ffi.new("terrapin_update *")
        self.choice = self.ffi.new("terrapin_boot_choice *")
        self._frame = self.ffi.new("terrapin_frame *")
        self._replies = self.ffi.new("terrapin_frame[2]")
        self.motor_on = False
        self.running = 0
        self._by_id = interface().by_id
        self.lib.terrapin_update_init(self.update, self.boot, 0)

    def put(self, slot: str, image: bytes) -> None:
        """Bytes into a slot, as a debug probe writes them; the rest of the slot is erased."""
        self.ffi.buffer(self.bytes)[START[slot] : START[slot] + 0x20000] = image.ljust(0x20000, b"\xff")

    def contents(self) -> bytes:
        return bytes(self.ffi.buffer(self.bytes, SIZE))

    def restore(self, contents: bytes) -> None:
        self.ffi.buffer(self.bytes)[0:SIZE] = contents
        self.lib.terrapin_flash_emulated_power_on(self.memory)

    def power_on(self) -> None:
        self.lib.terrapin_flash_emulated_power_on(self.memory)

    def start(self) -> str:
        """Reset: the slot that is started ("" when the boot loader stays)."""
        self.lib.terrapin_boot_choose(self.boot, self.choice)
        self.running = self.choice.slot
        self.lib.terrapin_update_init(self.update, self.boot, self.running)
        slot = {0: "", 1: "a", 2: "b"}[self.running]
        assert not slot or self.choice.address == BASE + START[slot] + HEADER_SIZE, "vectors of another image"
        return slot

    def check(self, slot: str) -> str:
        """The result of what a start asks of a pending image."""
        image = self.ffi.new("terrapin_image *")
        number = self.lib.terrapin_boot_check(self.boot, SLOT[slot], self.record(), True, image)
        return next(name for name, value in interface().enums["update_result"].items() if value == number)

    def confirm(self) -> bool:
        return bool(self.lib.terrapin_boot_confirm(self.boot, self.running))

    def record(self) -> Any:
        record = self.ffi.new("terrapin_record *")
        self.lib.terrapin_records_read(self.flash, record)
        return record

    def accept(self, identifier: int, data: bytes) -> list[tuple[int, bytes]]:
        """Give a frame; the replies."""
        frame = self._frame
        frame.id, frame.length = identifier, len(data)
        self.ffi.memmove(frame.data, data, len(data))
        count = self.lib.terrapin_update_accept(self.update, frame, self.motor_on, self._replies)
        return [(r.id, bytes(r.data)[: r.length]) for r in self._replies[0:count]]

    def ask(self, frame: tuple[int, bytes]) -> dict[str, int]:
        """Give a frame that is answered by one; its raw values."""
        [(identifier, data)] = self.accept(*frame)
        return self._by_id[identifier].decode(data)


def data_frames(block: bytes) -> Iterator[tuple[int, bytes]]:
    identifier = interface().messages["UPDATE_DATA"].id
    for at in range(0, len(block), 8):
        yield identifier, block[at : at + 8].ljust(8, b"\xff")


def announce(chip: Chip, image: bytes) -> None:
    """What BEGIN wants to have seen: the end of an image, its digest and signature."""
    for frame in data_frames(image[-TLVS:]):
        chip.accept(*frame)


def send(
    chip: Chip, image: bytes, slot: str, version: tuple[int, int, int] | None = None, announced: bytes = b""
) -> str:
    """The whole update up to its end; the name of the first result that is not ok, else "ok". A cut power: "cut".

    `announced`: the image whose end is shown before BEGIN, where that is another one."""
    results = {number: name for name, number in interface().enums["update_result"].items()}
    sender = Sender()
    data = image + b"\xff" * (-len(image) % 4)
    major, minor, revision = version or (image[20], image[21], int.from_bytes(image[22:24], "little"))
    chip.accept(*sender.frame("UPDATE_QUERY", {"protocol": 1}))
    chip.update.erases = 0  # the limit of erases is another test's

    def answer(frame: tuple[int, bytes]) -> int:
        return chip.ask(frame)["result"]

    begin = {"size": len(data) // 4, "slot": SLOT[slot], "major": major, "minor": minor, "revision": revision}
    announce(chip, announced or image)
    result = answer(sender.frame("UPDATE_BEGIN", begin))
    for index, at in enumerate(range(0, len(data), 256)):
        if result:
            break
        block = data[at : at + 256]
        for frame in data_frames(block):
            chip.accept(*frame)
        values = {"index": index, "size": len(block), "checksum": zlib.crc32(block)}
        result = answer(sender.frame("UPDATE_BLOCK", values))
    if not result:
        result = answer(sender.frame("UPDATE_END", {"checksum": zlib.crc32(data)}))
    return "cut" if chip.memory.off else results[result]


def image_file(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path
