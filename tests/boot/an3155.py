"""ST's system boot loader (AN3155) over a flash in memory, behind a pty: what `terrapin flash --via stm32` talks to."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from functools import reduce

BASE = 0x0800_0000
ACK, NACK = b"\x79", b"\x1f"
SECTORS = [16, 16, 16, 16, 64, *[128] * 7]  # kB


class Emulator:
    """`with Emulator() as path:` a pty's path. `damage`: an address whose lowest bit does not take a write."""

    def __init__(self, identifier: int = 0x413, protected: bool = False, damage: int | None = None) -> None:
        self.flash = bytearray(os.urandom(16)) + bytearray(b"\x5a") * (0x10_0000 - 16)  # never erased
        self.identifier = identifier
        self.protected = protected
        self.damage = damage
        self.started: int | None = None
        self.commands: list[int] = []
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self._stop, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> str:
        self._thread.start()
        return os.ttyname(self._slave)

    def __exit__(self, *_: object) -> None:
        os.write(self._wake, b"x")
        self._thread.join(5)
        for descriptor in (self._master, self._slave, self._stop, self._wake):
            os.close(descriptor)

    def _take(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            ready, _, _ = select.select([self._master, self._stop], [], [])
            if self._stop in ready:
                raise SystemExit
            data += os.read(self._master, count - len(data))
        return data

    def _give(self, data: bytes) -> None:
        os.write(self._master, data)

    def _checked(self, count: int) -> bytes | None:
        """Bytes and their checksum; None, and refused, when it does not fit."""
        data = self._take(count + 1)
        if reduce(lambda a, b: a ^ b, data, 0) != 0:
            self._give(NACK)
            return None
        return data[:-1]

    def _address(self) -> int | None:
        data = self._checked(4)
        if data is None:
            return None
        address = int.from_bytes(data, "big")
        if not BASE <= address < BASE + len(self.flash):
            self._give(NACK)
            return None
        self._give(ACK)
        return address - BASE

    def _run(self) -> None:
        try:
            while self._take(1) != b"\x7f":
                pass
            self._give(ACK)
            while True:
                self._serve(self._take(1)[0])
        except SystemExit:
            return

    def _serve(self, command: int) -> None:
        if command == 0x7F:  # synchronised already
            self._give(NACK)
            return
        if self._take(1)[0] != command ^ 0xFF:
            self._give(NACK)
            return
        self.commands.append(command)
        known = {
            0x00: self._get,
            0x01: self._version,
            0x02: self._id,
            0x11: self._read,
            0x21: self._go,
            0x31: self._write,
            0x44: self._erase,
        }
        if command not in known or (self.protected and command in (0x11, 0x21, 0x31, 0x44)):
            self._give(NACK)
            return
        self._give(ACK)
        known[command]()

    def _get(self) -> None:
        self._give(bytes([11, 0x31, 0x00, 0x01, 0x02, 0x11, 0x21, 0x31, 0x44, 0x63, 0x73, 0x82, 0x92]) + ACK)

    def _version(self) -> None:
        self._give(b"\x31\x00\x00" + ACK)

    def _id(self) -> None:
        self._give(b"\x01" + self.identifier.to_bytes(2, "big") + ACK)

    def _read(self) -> None:
        address = self._address()
        if address is None:
            return
        count, complement = self._take(2)
        if complement != count ^ 0xFF:
            self._give(NACK)
            return
        self._give(ACK + bytes(self.flash[address : address + count + 1]))

    def _go(self) -> None:
        self.started = self._address()

    def _write(self) -> None:
        address = self._address()
        if address is None:
            return
        count = self._take(1)[0] + 1
        data = self._take(count + 1)
        if reduce(lambda a, b: a ^ b, data, count - 1) != 0 or count % 4 or address % 4:
            self._give(NACK)
            return
        for i in range(count):
            bad = self.damage == BASE + address + i
            self.flash[address + i] &= data[i] & (0xFE if bad else 0xFF)
        self._give(ACK)

    def _erase(self) -> None:
        """Extended erase: a list of sectors."""
        head = self._take(2)
        count = int.from_bytes(head, "big") + 1
        if count > 0xFFF0:
            self._take(1)
            self.flash[:] = b"\xff" * len(self.flash)
            self._give(ACK)
            return
        body = self._take(2 * count + 1)
        if reduce(lambda a, b: a ^ b, head + body, 0) != 0:
            self._give(NACK)
            return
        for at in range(0, 2 * count, 2):
            number = int.from_bytes(body[at : at + 2], "big")
            start = sum(SECTORS[:number]) * 1024
            size = SECTORS[number] * 1024
            self.flash[start : start + size] = b"\xff" * size
        self._give(ACK)
