"""A process that has everything imported and forks for each piece of work, so that nobody waits for imports.

    warm = Warm(); await warm.start()
    process = await warm.run(["compare", "cases/x", "--json", "-"], out)     # the command line: terrapin_tools.cli.main
    answer = await warm.call("terrapin_tools.web.cases.summary:summaries", [folder])   # a function, its answer as JSON

What is forked is a fresh interpreter's state after imports and one comparison of a shipped case: the same functions in
the same order as `terrapin` from a shell, without its second of imports. Each piece of work leads a process group of
its own and dies with the server.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import IO, Any, Literal

from terrapin_tools.errors import UserError

__all__ = ["Busy", "Kind", "Late", "Process", "Warm"]

MAX_ANSWER = 256 << 20  # bytes of a function's answer
GRACE = 3.0  # s between SIGTERM and SIGKILL
# Calls: for a page that waits, of an upload, of a large one, of a job that has ended.
AT_ONCE = {"look": 4, "read": 2, "read large": 2, "keep": 2}
MOST_WAITING = 100  # of each kind

Kind = Literal["look", "read", "read large", "keep"]


class Busy(UserError):
    """More is asked for than can be worked off."""


class Late(UserError):
    """A call took longer than it may."""


class Line:
    """Calls of one kind: some run, some wait for their turn, the others are turned away."""

    def __init__(self, at_once: int) -> None:
        self._free = asyncio.Semaphore(at_once)
        self._waiting = 0

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait for a turn, and have it. Busy when too many wait already."""
        if self._waiting >= MOST_WAITING:
            raise Busy(f"found {MOST_WAITING} requests that wait for an answer, expected fewer: try again")
        self._waiting += 1
        try:
            await self._free.acquire()
        finally:
            self._waiting -= 1
        try:
            yield
        finally:
            self._free.release()


class Process:
    """A piece of work that runs. `lines` gives its standard error; `wait` its exit status (negative: the signal)."""

    def __init__(self, pid: int, errors: asyncio.StreamReader, status: asyncio.Future[int]) -> None:
        self.pid = pid
        self._errors = errors
        self._status = status

    async def lines(self) -> AsyncIterator[str]:
        """Lines of standard error as they come; a line too long for a terminal is cut."""
        while True:
            try:
                line = await self._errors.readline()
            except ValueError:  # more than the reader holds: it has dropped it
                continue
            if not line:
                return
            yield line.decode("utf-8", "replace").rstrip()[:2000]

    async def wait(self) -> int:
        return await asyncio.shield(self._status)

    async def stop(self) -> None:
        """SIGTERM to its process group; SIGKILL if that does not end it."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            if self._status.done():
                break
            with suppress(ProcessLookupError):
                os.killpg(self.pid, number)
            with suppress(TimeoutError):
                await asyncio.wait_for(self.wait(), GRACE)
        with suppress(ProcessLookupError, PermissionError):  # what it left behind
            os.killpg(self.pid, signal.SIGKILL)


class Warm:
    """The server's end of the process that forks."""

    def __init__(self, held: Sequence[int] = ()) -> None:
        """`held`: descriptors (the workspace's lock) that stay open until the last piece of work has ended."""
        self._held = list(held)
        self._parent: asyncio.subprocess.Process | None = None
        self._socket: socket.socket | None = None
        self._started: dict[int, asyncio.Future[int]] = {}
        self._ended: dict[int, asyncio.Future[int]] = {}
        self._number = 0
        self._starting = asyncio.Lock()
        self._lines = {kind: Line(at_once) for kind, at_once in AT_ONCE.items()}

    async def start(self) -> None:
        """Start the process; work may be asked for at once and begins when it is ready."""
        async with self._starting:
            if self._socket is not None:
                return
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            command = [sys.executable, "-m", "terrapin_tools.worker", str(theirs.fileno())]
            self._parent = await asyncio.create_subprocess_exec(
                *command,
                pass_fds=[theirs.fileno(), *self._held],
                stdin=asyncio.subprocess.DEVNULL,
                start_new_session=True,
            )
            theirs.close()
            ours.setblocking(False)
            self._socket = ours
            self._started[0] = asyncio.get_running_loop().create_future()
            asyncio.get_running_loop().add_reader(ours.fileno(), self._read, ours)

    async def ready(self) -> None:
        """Start the process and wait until it has imported everything."""
        await self.start()
        if 0 in self._started:
            await self._started[0]

    async def run(self, arguments: list[str], out: IO[bytes], environment: dict[str, str] | None = None) -> Process:
        """`terrapin ARGUMENTS` with standard output into `out`."""
        return await self._fork({"argv": arguments, "environment": environment or {}}, out.fileno())

    async def call(
        self,
        function: str,
        *arguments: Any,
        seconds: float = 120.0,
        told: Callable[[str], None] | None = None,
        kind: Kind = "look",
    ) -> Any:
        """The answer of "module:function" to JSON arguments. UserError as the function raised it; Late at `seconds`.

        `told` gets its lines of progress. Cancelling the awaiting task stops the work. Of each kind AT_ONCE run, the
        next wait for their turn; Busy when MOST_WAITING wait already.
        """
        async with self._lines[kind].turn():
            return await self._call(function, list(arguments), seconds, told)

    async def _call(
        self, function: str, arguments: list[Any], seconds: float, told: Callable[[str], None] | None
    ) -> Any:
        reading, writing = os.pipe()
        try:
            process = await self._fork({"call": function, "arguments": arguments}, writing)
        except BaseException:
            os.close(reading)
            raise
        finally:
            os.close(writing)
        stream = await _stream(reading)
        try:
            async with asyncio.timeout(seconds):
                said, answer = await asyncio.gather(_all(process.lines(), told), _whole(stream))
                status = await process.wait()
        except TimeoutError:
            raise Late(f"found no answer after {seconds:g} s") from None
        finally:
            if not process._status.done():
                await asyncio.shield(process.stop())
        if status == 2:
            raise UserError(said[-1] if said else "no reason given")
        if status != 0:
            raise UserError(f"{function} ended with status {status}: {said[-1] if said else 'no reason given'}", 1)
        return json.loads(answer)

    async def close(self) -> None:
        """End the process and with it all work."""
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket.fileno())
            self._socket.close()
            self._socket = None
        if self._parent is not None:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._parent.wait(), GRACE)
            if self._parent.returncode is None:
                self._parent.kill()
                await self._parent.wait()

    async def _fork(self, request: dict[str, Any], out: int) -> Process:
        await self.start()
        reading, writing = os.pipe()
        try:
            loop = asyncio.get_running_loop()
            self._number += 1
            number = self._number
            message = json.dumps({**request, "number": number}).encode()
            if len(message) > 100_000:
                raise UserError(f"found a command line of {len(message)} bytes, expected at most 100000")
            started, ended = loop.create_future(), loop.create_future()
            self._started[number], self._ended[number] = started, ended
            assert self._socket is not None
            socket.send_fds(self._socket, [message], [out, writing])
        except BaseException:
            os.close(reading)
            raise
        finally:
            os.close(writing)
        errors = await _stream(reading)
        try:
            pid = await asyncio.shield(started)
        except asyncio.CancelledError:  # nobody wants it any more
            pid = await started
            if pid:
                await Process(pid, errors, ended).stop()
            raise
        if not pid:
            raise UserError("the process that does the work ended; is there too little memory?", 1)
        return Process(pid, errors, ended)

    def _read(self, ours: socket.socket) -> None:
        try:
            data = ours.recv(65536)
        except BlockingIOError:
            return
        except ConnectionResetError:
            data = b""
        if not data:  # it ended: whoever waits is told, the next piece of work starts another
            asyncio.get_running_loop().remove_reader(ours.fileno())
            ours.close()
            self._socket = None
            for table, value in ((self._started, 0), (self._ended, -signal.SIGKILL)):
                for future in table.values():
                    if not future.done():
                        future.set_result(value)
                table.clear()
            return
        message = json.loads(data)
        number = message["number"]
        if "pid" in message:
            self._started.pop(number).set_result(message["pid"])
        else:
            self._ended.pop(number).set_result(message["status"])


async def _stream(reading: int) -> asyncio.StreamReader:
    reader = asyncio.StreamReader(limit=1 << 16)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(reading, "rb", 0))
    return reader


async def _whole(stream: asyncio.StreamReader) -> bytes:
    """All of it. UserError beyond MAX_ANSWER."""
    found = bytearray()
    while data := await stream.read(1 << 16):
        found += data
        if len(found) > MAX_ANSWER:
            raise UserError(f"found an answer of more than {MAX_ANSWER} bytes")
    return bytes(found)


async def _all(lines: AsyncIterator[str], told: Callable[[str], None] | None) -> list[str]:
    """The last lines."""
    kept: list[str] = []
    async for line in lines:
        kept = [*kept[-19:], line]
        if told is not None:
            told(line)
    return kept
