"""The boot loader in the STM32's system memory, over its USART (ST's AN3155), 8 data bits, even parity, one stop bit.

The chip runs it when BOOT0 is high at a reset. Each command is the byte and its complement; each part is acknowledged.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import reduce

from terrapin_tools.errors import UserError
from terrapin_tools.flash.wire import Told
from terrapin_tools.flash.wires import open_serial

__all__ = ["Stm32", "sectors_of"]

ACK, NACK = 0x79, 0x1F
SYNC = 0x7F
GET, GET_ID, READ, GO, WRITE, ERASE_EXTENDED = 0x00, 0x02, 0x11, 0x21, 0x31, 0x44
F405 = 0x413  # product identifier of STM32F405/407/415/417 (AN2606)
ANSWER = 2.0  # s
POLL = 0.05  # s of one read; never changed, since a pseudo-terminal refuses to be set to even parity twice
SECTOR_ERASE = 4.0  # s, 128 kB at 8 bits a time (DS8626)
BASE = 0x0800_0000
SECTORS = [16, 16, 16, 16, 64, 128, 128, 128, 128, 128, 128, 128]  # kB


def sectors_of(address: int, size: int) -> list[int]:
    """The F405's sectors that hold `size` bytes from `address` on.

    >>> sectors_of(0x08000000, 16), sectors_of(0x0800C000, 0x14000)
    ([0], [3, 4])
    """
    found, start = [], BASE
    for number, kilobytes in enumerate(SECTORS):
        end = start + kilobytes * 1024
        if address < end and start < address + size:
            found.append(number)
        start = end
    return found


def _checksum(data: bytes) -> bytes:
    return bytes([reduce(lambda a, b: a ^ b, data, 0)])


class Stm32:
    """An open connection. UserError, status 1, when the chip does not answer as it should; 2 for a wrong chip."""

    chunk = 256  # bytes of one read or write

    def __init__(self, port: str, baud: int = 115_200) -> None:
        self.name = port
        self._port = open_serial(port, baud, parity="E", timeout=POLL)

    def close(self) -> None:
        self._port.close()

    def _fail(self, text: str) -> UserError:
        return UserError(f"{self.name}: {text}", status=1)

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise self._fail(f"the serial port disappeared ({error.strerror or error})") from None

    def _take(self, count: int, seconds: float) -> bytes:
        """Bytes, fewer when not all come in time."""
        data, end = b"", time.monotonic() + seconds
        while len(data) < count and time.monotonic() < end:
            try:
                data += self._port.read(count - len(data))
            except OSError as error:
                raise self._fail(f"the serial port disappeared ({error.strerror or error})") from None
        return data

    def _read(self, count: int, seconds: float = ANSWER) -> bytes:
        data = self._take(count, seconds)
        if len(data) < count:
            raise self._fail("the chip stopped answering")
        return data

    def _acknowledged(self, what: str, seconds: float = ANSWER) -> None:
        answer = self._read(1, seconds)[0]
        if answer == NACK:
            raise self._fail(f"the chip refuses {what} (is it read or write protected?)")
        if answer != ACK:
            raise self._fail(f"expected an acknowledgement of {what}, found 0x{answer:02x}")

    def _command(self, command: int, what: str) -> None:
        self._write(bytes([command, command ^ 0xFF]))
        self._acknowledged(what)

    def _send(self, data: bytes, what: str, seconds: float = ANSWER) -> None:
        self._write(data + _checksum(data))
        self._acknowledged(what, seconds)

    def connect(self) -> None:
        """Synchronise, and see that it is the right chip."""
        for _ in range(3):
            self._port.reset_input_buffer()
            self._write(bytes([SYNC]))
            answer = self._take(1, 0.5)
            if answer and answer[0] in (ACK, NACK):  # not acknowledged: it was synchronised before
                break
        else:
            raise self._fail(
                "no STM32 boot loader answers; expected the chip reset with BOOT0 high, and the port on its USART"
            )
        self._command(GET_ID, "to say its identifier")
        count = self._read(1)[0] + 1
        identifier = int.from_bytes(self._read(count), "big")
        self._acknowledged("to say its identifier")
        if identifier != F405:
            raise UserError(
                f"{self.name}: wrong chip: identifier 0x{identifier:03x}, expected 0x{F405:03x} (STM32F405)"
            )

    def erase(self, regions: Sequence[tuple[int, int]], told: Told) -> None:
        """Erase the sectors of regions, (address, bytes), one at a time so that its progress can be told."""
        sectors = [number for address, size in regions for number in sectors_of(address, size)]
        for done, sector in enumerate(sectors):
            told("erasing", done, len(sectors))
            self._command(ERASE_EXTENDED, "to erase")
            self._send(b"\x00\x00" + sector.to_bytes(2, "big"), f"to erase sector {sector}", 2 * SECTOR_ERASE)

    def write(self, address: int, data: bytes, told: Told) -> None:
        """Write into erased flash; filled up with 0xFF to a multiple of four."""
        data += b"\xff" * (-len(data) % 4)
        for at in range(0, len(data), self.chunk):
            chunk = data[at : at + self.chunk]
            self._command(WRITE, "to write")
            self._send((address + at).to_bytes(4, "big"), f"to write at 0x{address + at:08x}")
            self._send(bytes([len(chunk) - 1]) + chunk, f"to write at 0x{address + at:08x}")
            told("writing", at + len(chunk), len(data))

    def read(self, address: int, size: int) -> bytes:
        """At most `chunk` bytes of the flash."""
        self._command(READ, "to read")
        self._send(address.to_bytes(4, "big"), f"to read at 0x{address:08x}")
        count = size - 1
        self._write(bytes([count, count ^ 0xFF]))
        self._acknowledged("to read")
        return self._read(size)

    def start(self, address: int = BASE) -> None:
        """Leave for the code whose vectors stand at an address."""
        self._command(GO, "to start the image")
        self._send(address.to_bytes(4, "big"), "to start the image")
        time.sleep(0.01)
