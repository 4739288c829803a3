"""A serial SLCAN adapter, read in pieces as large as come: a full bus costs a few per cent of a core.

python-can's own SLCAN driver takes its port byte by byte, some 200,000 reads a second at 8,000 frames/s.
"""

from __future__ import annotations

import re
import time
from pathlib import Path

import serial

from terrapin_hil.links.link import not_there
from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.links.slcan import BIT_RATES
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import EXTENDED, FD, REMOTE, Frames, frames, joined

__all__ = ["SlcanBus", "parse"]

PAUSE = 4e-3  # s between reads: what comes meanwhile waits in the driver, which holds 64 kB
MOST = 100_000  # frames of a block
WAIT = 0.02  # s that a read waits for a first byte
LONGEST = 1 << 16  # bytes without an end of line: this is no SLCAN
BAUD = 115_200  # of the serial line, which adapters on USB ignore

# tIIIL... TIIIIIIIIL... rIIIL RIIIIIIIIL, d D b B with CAN FD; four digits of time may follow
_LINE = re.compile(
    rb"([trdb])([0-7][0-9A-Fa-f]{2})([0-9A-Fa-f])([0-9A-Fa-f]*)|([TRDB])([01][0-9A-Fa-f]{7})([0-9A-Fa-f])([0-9A-Fa-f]*)"
).fullmatch
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
_ANSWERS = (b"", b"z", b"Z")


def parse(lines: list[bytes], stamp: float, path: Path = Path("slcan")) -> tuple[Frames, int]:
    """The frames in lines (without their ends), all at `stamp` [s], and how many lines were neither frame nor answer.

    >>> found, damaged = parse([b"t100201AB", b"", b"t10x"], 5.0)
    >>> found.identifiers.tolist(), found.payload(0), damaged
    ([256], b'\\x01\\xab', 1)
    """
    identifiers: list[int] = []
    payloads: list[bytes] = []
    flags: list[int] = []
    damaged = 0
    for line in lines:
        if len(line) == 21 and line[:1] == b"t" and line[4:5] == b"8":  # nearly all, so the short way
            try:
                payload, identifier = bytes.fromhex(line[5:].decode("ascii")), int(line[1:4], 16)
            except ValueError:
                damaged += 1
                continue
            if len(payload) == 8 and 0 <= identifier < 0x800:
                identifiers.append(identifier)
                payloads.append(payload)
                flags.append(0)
                continue
        if line in _ANSWERS or line[:1] in (b"V", b"N", b"F", b"v"):
            continue
        found = _frame(line)
        if found is None:
            damaged += 1
            continue
        identifiers.append(found[0])
        payloads.append(found[1])
        flags.append(found[2])
    return frames(path, [stamp] * len(identifiers), identifiers, payloads, flags), damaged


def _frame(line: bytes) -> tuple[int, bytes, int] | None:
    found = _LINE(line)
    if found is None:
        return None
    kind, identifier, digit, data = found.groups()[:4] if found[1] else found.groups()[4:]
    code = int(digit, 16)
    flexible = kind in b"dDbB"
    if code > 8 and not flexible:
        return None
    flags = (EXTENDED if kind.isupper() else 0) | (FD if flexible else 0)
    size = 0 if kind in b"rR" else _FD_LENGTHS[code]
    if len(data) not in (2 * size, 2 * size + 4):
        return None
    if kind in b"rR":
        flags |= REMOTE
    return int(identifier, 16), bytes.fromhex(data[: 2 * size].decode("ascii")), flags


class SlcanBus:
    """An open channel. `damaged`: lines that were no SLCAN. UserError (status 1) when it cannot be opened."""

    def __init__(self, link: LinkName, bitrate: int = BIT_RATE) -> None:
        bitrate = link.bit_rate(bitrate)
        if bitrate not in BIT_RATES:
            known = ", ".join(map(str, BIT_RATES))
            raise UserError(f"bit rate: found {bitrate}, expected one of SLCAN's: {known}")
        self.channel_info = f"serial:{link.channel}"
        self.damaged = 0
        self.lost = 0  # a serial port does not say
        self._rest = b""
        self._first = True  # the first line may have begun before we listened
        try:
            self._port = serial.Serial(link.channel, link.baud or BAUD, timeout=WAIT, write_timeout=2.0)
            self._port.write(b"\rC\r" + BIT_RATES[bitrate] + b"\rO\r")
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise UserError(f"{link}: cannot open the link: {not_there(error)}", status=1) from None

    def receive(self, seconds: float) -> Frames:
        """What comes within `seconds`. UserError (status 1) when the port goes away; what came before is not lost."""
        end = time.monotonic() + seconds
        parts: list[Frames] = []
        total = 0
        while total < MOST:
            if time.monotonic() >= end:
                break
            try:
                data = self._port.read(max(1, self._port.in_waiting))
            except (OSError, TypeError, ValueError) as error:
                if parts:  # told by the next call
                    break
                reason = next(iter(str(error).splitlines()), "") or type(error).__name__
                raise UserError(f"{self.channel_info}: the bus went away ({reason})", status=1) from None
            if data:
                parts.append(self._take(data))
                total += len(parts[-1])
                time.sleep(min(PAUSE, max(0.0, end - time.monotonic())))
        return joined(Path("bus"), parts)

    def _take(self, data: bytes) -> Frames:
        stamp = time.time()
        *lines, self._rest = (self._rest + data.replace(b"\a", b"\r")).split(b"\r")
        if len(self._rest) > LONGEST:
            raise UserError(f"{self.channel_info}: found {self._rest[:20]!r}, expected SLCAN", status=1)
        if self._first and lines:
            self._first = False
            if _frame(lines[0]) is None:
                lines = lines[1:]
        found, damaged = parse(lines, stamp)
        self.damaged += damaged
        return found

    def send(self, identifier: int, data: bytes) -> None:
        """One frame with an 11-bit identifier. UserError (status 1) when the port does not take it."""
        try:
            self._port.write(b"t%03X%d%s\r" % (identifier, len(data), data.hex().upper().encode()))
        except OSError as error:
            raise UserError(f"{self.channel_info}: cannot send: {error}", status=1) from None

    def shutdown(self) -> None:
        """Closes channel and port, if it is still there."""
        try:
            self._port.write(b"C\r")
        except OSError:
            pass  # gone already
        finally:
            self._port.close()
