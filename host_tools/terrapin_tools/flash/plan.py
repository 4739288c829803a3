"""What a programmer that writes the whole flash (SWD, the chip's own boot loader) has to erase and write.

The records of the project's boot loader are erased with it, and the slot that gets no image: so that what is written is
what starts, whatever was there before.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from terrapin_hil import paths
from terrapin_tools.errors import UserError, about
from terrapin_tools.flash.image import ImageError, verify
from terrapin_tools.flash.keys import key_in
from terrapin_tools.flash.layout import BASE, RAM, RECORDS, SLOT_SIZE, SLOTS
from terrapin_tools.flash.update import SignedFile
from terrapin_tools.flash.wire import Told

__all__ = [
    "BOOT_SIZE",
    "Plan",
    "Programmer",
    "begins",
    "boot_loader",
    "check_starts",
    "first_record",
    "perform",
    "plan",
    "read",
    "revoked_place",
    "with_link_key",
]

BOOT_SIZE = 0x4000  # of the sector; its end is
LINK_KEY = 0x3FC0  # the link key's:
LINK_KEY_SIZE = 28  # bytes
RECORD_MAGIC = 0x00015442
RECORD_SIZE = 32  # bytes
READ_AT_ONCE = 1024  # bytes of records


@dataclass(frozen=True)
class Plan:
    """Regions to erase, (address, bytes), whole sectors; and data to write into them, (address, data)."""

    erase: tuple[tuple[int, int], ...]
    write: tuple[tuple[int, bytes], ...]


class Programmer(Protocol):
    """A connection that can do it. Failures are UserError."""

    name: str
    chunk: int  # bytes that are read at a time

    def read(self, address: int, size: int) -> bytes: ...
    def erase(self, regions: Sequence[tuple[int, int]], told: Told) -> None: ...
    def write(self, address: int, data: bytes, told: Told) -> None: ...
    def start(self) -> None: ...


def boot_loader(path: Path) -> bytes:
    """The boot loader in a .bin. UserError when it cannot be one."""
    try:
        with path.open("rb") as file:
            data = file.read(LINK_KEY + 1)
    except OSError as error:
        hint = f"run {paths.make('firmware')}: it puts one into build/cortex-m4"
        raise UserError(f"{path}: cannot read: {error.strerror}; {hint}") from None
    if len(data) > LINK_KEY or not begins(data):
        raise UserError(f"{path}: no boot loader: expected at most {LINK_KEY} bytes linked for 0x{BASE:08x}")
    return data


def with_link_key(loader: bytes, block: bytes) -> bytes:
    """The boot loader with a link key behind it; without when the block is erased.

    >>> len(with_link_key(b"loader", b"LKEY"))
    16324
    """
    return loader.ljust(LINK_KEY, b"\xff") + block if block.strip(b"\xff") else loader


def begins(data: bytes) -> bool:
    """Whether these bytes begin with the vectors of a program at the start of flash."""
    stack, reset = int.from_bytes(data[:4], "little"), int.from_bytes(data[4:8], "little")
    return len(data) >= 8 and stack in RAM and BASE <= reset < BASE + len(data)


def check_starts(loader: bytes, where: str, files: Sequence[SignedFile]) -> None:
    """UserError unless this boot loader would start the images: nobody asks it when the whole flash is written."""
    for file in files:
        named = file.image.key_hash or b""
        key = key_in(loader, named)
        if key is None:
            raise UserError(f"{file.name}: signed with key {named[:4].hex()}, which is not in {where}")
        with about(file.name, ImageError):
            verify(file.image, key)


def first_record(node: int, robot: int, revoked: int = 0) -> bytes:
    """The boot loader's first record (firmware/boot/records.c): nothing is confirmed, node, robot and the revoked key's
    place are these."""
    record = struct.pack("<IIIIQI", RECORD_MAGIC, 1, 0, 0, 0, node | revoked << 4 | robot << 8)
    return record + zlib.crc32(record).to_bytes(4, "little")


def revoked_place(programmer: Programmer, told: Told) -> int:
    """The key that the boot loader's newest record says is revoked: 1 the first, 2 the second; 0 none."""
    newest, place = 0, 0
    for address, size in RECORDS:
        for at in range(0, size, READ_AT_ONCE):
            data = read(programmer, address + at, READ_AT_ONCE, told)
            for record in (data[i : i + RECORD_SIZE] for i in range(0, READ_AT_ONCE, RECORD_SIZE)):
                magic, sequence = struct.unpack_from("<II", record)
                good = magic == RECORD_MAGIC and zlib.crc32(record[:-4]) == int.from_bytes(record[-4:], "little")
                if good and sequence > newest:
                    newest, place = sequence, record[24] >> 4
            if not data[-RECORD_SIZE:].strip(b"\xff"):  # a page is filled in order
                break
    return place


def plan(files: Sequence[SignedFile], loader: bytes | None, node: int = 0, revoked: int = 0) -> Plan:
    """For these images, at most one a slot, and perhaps the boot loader; the controller is this node and their robot's,
    and the key in place `revoked` stays so.

    UserError when the images are made for several robots or boards.
    """
    first = files[0]
    for other in files[1:]:
        if (other.image.robot, other.image.board) != (first.image.robot, first.image.board):
            raise UserError(f"{other.name}: made for another robot or board than {first.name}, expected one of each")
    robot = first.image.robot
    erase = [*RECORDS, *((start, SLOT_SIZE) for start in SLOTS.values())]
    write = [(SLOTS[file.image.slot], file.data[: file.image.size]) for file in files]
    if loader is not None:
        erase.insert(0, (BASE, BOOT_SIZE))
        write.insert(0, (BASE, loader))
    if node or robot or revoked:
        write.append((RECORDS[0][0], first_record(node, robot, revoked)))
    return Plan(tuple(erase), tuple(write))


def read(programmer: Programmer, address: int, size: int, told: Told, doing: str = "reading") -> bytes:
    """What stands in the flash."""
    data = b""
    while len(data) < size:
        data += programmer.read(address + len(data), min(programmer.chunk, size - len(data)))
        told(doing, len(data), size)
    return data


def perform(programmer: Programmer, what: Plan, told: Told) -> None:
    """Erase, write, read back, start. UserError where something else stands than was written."""
    programmer.erase(what.erase, told)
    for address, data in what.write:
        programmer.write(address, data, told)
    for address, data in what.write:
        found = read(programmer, address, len(data), told, "verifying")
        if found != data:
            first = address + next(i for i, (a, b) in enumerate(zip(found, data, strict=True)) if a != b)
            raise UserError(
                f"{programmer.name}: verify: what was written at 0x{first:08x} does not read back", status=1
            )
    programmer.start()
