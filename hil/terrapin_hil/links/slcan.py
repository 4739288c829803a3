"""SLCAN over a pty or serial port, read by our own code: fast enough for lockstep.

The controller acknowledges each line after everything that the line caused (for SENSORS_FAST: the tick's ACTUATE and
telemetry), so `exchange` knows from counting acknowledgements, not from waiting, that an answer is complete.
"""

from __future__ import annotations

import errno
import os
import re
import select
import signal
import subprocess
import tempfile
import termios
import time
import tty
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.links.link import LinkError, not_there
from terrapin_hil.links.names import BIT_RATE
from terrapin_hil.messages import Frame

__all__ = ["BIT_RATES", "ControllerProcess", "SlcanPort", "slcan_line", "slcan_parse"]

BIT_RATES = {  # bit/s -> the command that sets them
    10_000: b"S0",
    20_000: b"S1",
    50_000: b"S2",
    100_000: b"S3",
    125_000: b"S4",
    250_000: b"S5",
    500_000: b"S6",
    750_000: b"S7",
    1_000_000: b"S8",
}

_FRAME = re.compile(rb"t[0-7][0-9A-Fa-f]{2}[0-8][0-9A-Fa-f]{0,16}").fullmatch
_SERIAL_NUMBER = re.compile(rb"N[^\r\a]{4}\r").search
CHUNK = 65536  # bytes asked of one read
GONE = {errno.EIO, errno.ENXIO, errno.ENODEV, errno.EPIPE, errno.EBADF, errno.ECONNRESET}


def slcan_line(frame: Frame) -> bytes:
    """A frame as SLCAN text.

    >>> slcan_line((0x100, bytes([1, 0xAB])))
    b't100201ab\\r'
    """
    identifier, data = frame
    return b"t%03X%d%s\r" % (identifier, len(data), data.hex().encode())


def slcan_parse(line: bytes) -> Frame:
    """The frame in a line (without its end). ValueError when it is none.

    >>> slcan_parse(b"t100201AB")
    (256, b'\\x01\\xab')
    """
    if not _FRAME(line) or len(line) != 5 + 2 * (line[4] - 48):
        raise ValueError(f"no SLCAN frame: {line[:40]!r}")
    return int(line[1:4], 16), bytes.fromhex(line[5:].decode("ascii"))


class SlcanPort(AbstractContextManager["SlcanPort"]):
    """One open channel. `timeout` [s] bounds every wait; all failures are LinkError."""

    def __init__(
        self, path: str | Path, timeout: float = 2.0, descriptors: tuple[int, int] | None = None, baud: int = 0
    ) -> None:
        """`path`: of a terminal, set to `baud` [bit/s], or left at its speed with 0. `descriptors`: open ones to read
        from and to write to, not blocking, instead of it."""
        self.path = str(path)
        self.timeout = timeout
        self._rest = b""
        self._frames: list[Frame] = []
        self._pending = 0  # lines sent that are not acknowledged yet
        self._from, self._to = descriptors or self._open_terminal(baud)
        self._readable = select.poll()
        self._readable.register(self._from, select.POLLIN)
        self._writable = select.poll()
        self._writable.register(self._to, select.POLLOUT)

    def _open_terminal(self, baud: int) -> tuple[int, int]:
        speed = getattr(termios, f"B{baud}", None)
        if baud and speed is None:
            raise LinkError(f"{self.path}: no serial line has {baud} bit/s; 1000000 is what the boards use")
        descriptor = -1
        try:
            descriptor = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
            tty.setraw(descriptor, termios.TCSANOW)
            if baud:
                settings = termios.tcgetattr(descriptor)
                settings[4] = settings[5] = speed  # in and out
                termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        except (OSError, termios.error) as error:
            if descriptor >= 0:
                os.close(descriptor)
            reason = not_there(error) if isinstance(error, OSError) else "not a terminal"
            raise LinkError(f"{self.path}: cannot open the link: {reason}") from None
        return descriptor, descriptor

    @classmethod
    def open(cls, path: str | Path, timeout: float = 2.0, baud: int = 0, bit_rate: int = BIT_RATE) -> SlcanPort:
        """Open the port and its CAN channel at `bit_rate` [bit/s] (which a board on USB ignores)."""
        port = cls(path, timeout, baud=baud)
        port.begin(bit_rate)
        return port

    def begin(self, bit_rate: int = BIT_RATE) -> None:
        """Open the CAN channel. The port is closed when that fails."""
        try:
            if bit_rate not in BIT_RATES:
                raise LinkError(
                    f"{self.path}: found {bit_rate} bit/s, expected one of {', '.join(map(str, BIT_RATES))}"
                )
            self._clear()
            self.exchange(b"C\r" + BIT_RATES[bit_rate] + b"\rO\r")
        except BaseException:
            self.close()
            raise

    def _clear(self) -> None:
        """End a line that an earlier host may have left unfinished, ask for the serial number, and drop all that comes
        before it: answers keep their order, so from there on each acknowledgement is for a line of ours."""
        self.send(b"\rN\r")
        end = time.monotonic() + self.timeout
        seen = b""
        while (found := _SERIAL_NUMBER(seen)) is None:
            seen = seen[-CHUNK:] + self._receive(end)
        self._rest = seen[found.end() :]
        self._pending = 0

    def close(self) -> None:
        """Close the port; the controller's process then ends. Closing twice is allowed."""
        for descriptor in {self._from, self._to} - {-1}:
            os.close(descriptor)
        self._from = self._to = -1

    def __exit__(self, *error: object) -> None:
        self.close()

    def send(self, text: bytes) -> None:
        """Write bytes that are SLCAN already (see `slcan_line`), all of them."""
        self._pending += text.count(b"\r")
        while text:
            try:
                text = text[os.write(self._to, text) :]
            except BlockingIOError:
                if not self._writable.poll(int(self.timeout * 1000)):
                    raise LinkError(f"{self.path}: the other side takes no data for {self.timeout:g} s") from None
            except OSError as error:
                raise self._lost(error) from None

    def exchange(self, text: bytes) -> list[Frame]:
        """Send lines and wait until all lines sent so far are acknowledged: the frames received, in order."""
        self.send(text)
        if self._pending > 0:
            end = time.monotonic() + self.timeout
            while self._pending > 0:
                self._read(end)
        frames, self._frames = self._frames, []
        return frames

    def exchange_frames(self, frames: Iterable[Frame]) -> list[Frame]:
        """As `exchange`, for frames."""
        return self.exchange(b"".join(map(slcan_line, frames)))

    def _receive(self, end: float) -> bytes:
        """What has come, perhaps nothing yet; LinkError when nothing comes until `end` (monotonic clock)."""
        try:
            data = os.read(self._from, CHUNK)
        except BlockingIOError:
            wait = end - time.monotonic()
            if wait <= 0 or not self._readable.poll(int(wait * 1000) + 1):
                raise LinkError(f"{self.path}: no answer within {self.timeout:g} s") from None
            return b""
        except OSError as error:
            raise self._lost(error) from None
        if not data:
            raise LinkError(f"{self.path}: the link disappeared")
        return data

    def _read(self, end: float) -> None:
        """Take the lines that have come; wait for some until `end` at most."""
        data = self._receive(end)
        if b"\a" in data:
            data = data.replace(b"\a", b"\a\r")
        *lines, self._rest = (self._rest + data).split(b"\r")
        refused = False
        for line in lines:
            if line[:1] == b"t":
                try:
                    self._frames.append(slcan_parse(line))
                except ValueError as error:
                    raise LinkError(f"{self.path}: {error}") from None
            elif line[-1:] == b"\a":
                self._pending -= 1
                refused = True  # told below: lines behind this one have been read, too
            elif not line or line[:1] in b"zZVNF":
                self._pending -= 1
            else:
                raise LinkError(f"{self.path}: no SLCAN: {line[:40]!r}")
        if refused:
            raise LinkError(f"{self.path}: the other side refused a line (wrong state, or damaged on the way)")
        if len(self._rest) > CHUNK:
            raise LinkError(f"{self.path}: no SLCAN: {self._rest[:40]!r}...")

    def _lost(self, error: OSError) -> LinkError:
        if error.errno in GONE:
            return LinkError(f"{self.path}: the link disappeared")
        return LinkError(f"{self.path}: {error.strerror}")


class ControllerProcess:
    """The firmware as a process that speaks SLCAN on a pty of its own: `with ControllerProcess() as path: ...`.

    LinkError when it does not start. It is stopped on leaving; `process` is its subprocess.Popen.
    """

    def __init__(self, program: Path | None = None, arguments: Sequence[str] = ()) -> None:
        self.program = program or paths.build() / "terrapin-controller"
        self.arguments = tuple(arguments)
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> str:
        """Start it; the path of its pty."""
        with tempfile.TemporaryFile("w+", errors="backslashreplace") as words:
            try:
                self.process = subprocess.Popen(
                    [str(self.program), *self.arguments, "--pty"],
                    stdout=subprocess.PIPE,
                    stderr=words,
                    text=True,
                    process_group=0,  # Ctrl-C in a terminal is for us; the controller ends when we let it go
                )
            except OSError as error:
                raise LinkError(f"{self.program}: cannot start the controller: {error.strerror}") from None
            assert self.process.stdout is not None
            path = self.process.stdout.readline().strip()
            if not path:
                self.stop()
                words.seek(0)
                said = (words.read().strip() or "the controller did not start").splitlines()[-1]
                raise LinkError(f"{self.program}: {said.removeprefix(f'{self.program.name}: ')}")
        return path

    def stop(self) -> int:
        """Stop it, if it still runs; its exit status."""
        if self.process is None:
            return 0
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            self.process.send_signal(signal.SIGCONT)  # a stopped process would not hear it
        try:
            status = self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            status = self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
        self.process = None
        return status

    def __enter__(self) -> str:
        return self.start()

    def __exit__(self, *error: object) -> None:
        self.stop()
