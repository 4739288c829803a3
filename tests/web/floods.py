"""Browsers that ask for far too much at a server of one's own, and one that only wants its page meanwhile.

Used by tests/web/test_web_floods.py, for a few seconds, and by tests/bench/bench_flood.py, for a minute.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from pathlib import Path

from serving import Server

__all__ = ["Flood", "flood"]

WEBSOCKETS, HALF_OPEN, SLOW_BODIES = 2000, 600, 100  # asked for
ASKING = 50  # websockets that are asked for at a time
HELD_SECONDS = 6.0  # after which none of the half-open requests may be left
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@dataclass
class Flood:
    """What came of it. Times in s, memory in bytes."""

    seconds: list[float] = field(default_factory=list)  # of each request of the browser that wants its page
    refused: list[int] = field(default_factory=list)  # their statuses that are not 200; 0: no answer
    opened: int = 0  # websockets that were opened
    most_sockets: int = 0  # of them at a time
    longest_half_open: float = 0.0
    bodies_cut: int = 0
    memory: int = 0  # the most above the memory before

    def p95(self) -> float:
        return sorted(self.seconds)[int(0.95 * len(self.seconds))]


def memory(pid: int) -> int:
    """Bytes of a process that are in memory."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


def flood(server: Server, seconds: float) -> Flood:
    """All floods at once, for so long."""
    found = Flood()
    asyncio.run(_all(server, seconds, found))
    return found


async def _all(server: Server, seconds: float, found: Flood) -> None:
    before, end = memory(server.process.pid), time.monotonic() + seconds
    places = asyncio.Semaphore(ASKING)
    sockets: set[Streams] = set()
    tasks = [asyncio.create_task(_half_open(server, end, found)) for _ in range(HALF_OPEN)]
    tasks += [asyncio.create_task(_socket(server, end, found, places, sockets)) for _ in range(WEBSOCKETS)]
    tasks += [asyncio.create_task(_body(server, path, found)) for path in _slow_paths() for _ in range(SLOW_BODIES)]
    await asyncio.to_thread(_want_the_page, server, end, found, before)
    for task in tasks:
        task.cancel()
    for error in await asyncio.gather(*tasks, return_exceptions=True):
        if error is not None and not isinstance(error, asyncio.CancelledError):
            raise error


def _slow_paths() -> tuple[str, ...]:
    return ("/api/uploads?name=slow.csv", "/api/expression")


def _head(server: Server, method: str, path: str, *more: str) -> bytes:
    lines = [f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{server.port}", f"Authorization: Bearer {server.token}"]
    return "\r\n".join([*lines, *more, "", ""]).encode()


def _want_the_page(server: Server, end: float, found: Flood, before: int) -> None:
    """Requests one after the other, each over a connection of its own."""
    while time.monotonic() < end:
        begin, status = time.monotonic(), 0
        with suppress(OSError, HTTPException):
            connection = HTTPConnection("127.0.0.1", server.port, timeout=60.0)
            try:
                connection.request("GET", "/api/status", headers={"Authorization": f"Bearer {server.token}"})
                status = connection.getresponse().status
            finally:
                connection.close()
        found.seconds.append(time.monotonic() - begin)
        if status != 200:
            found.refused.append(status)
        found.memory = max(found.memory, memory(server.process.pid) - before)
        time.sleep(0.05)


async def _half_open(server: Server, end: float, found: Flood) -> None:
    """A byte of a head each second; cut off, it begins anew."""
    while time.monotonic() < end:
        with suppress(OSError):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            begin = time.monotonic()
            ended = asyncio.create_task(reader.read(1))
            try:
                while not ended.done():
                    writer.write(b"G")
                    await asyncio.wait((ended,), timeout=1.0)
                found.longest_half_open = max(found.longest_half_open, time.monotonic() - begin)
                with suppress(OSError):
                    await ended
            finally:
                ended.cancel()
                writer.close()
        await asyncio.sleep(1.0)


async def _socket(server: Server, end: float, found: Flood, places: asyncio.Semaphore, sockets: set[Streams]) -> None:
    """A websocket, held to the end if it is opened."""
    upgrade = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13")
    with suppress(OSError):
        async with places:
            streams = await asyncio.open_connection("127.0.0.1", server.port)
            streams[1].write(_head(server, "GET", "/api/events", *upgrade, "Sec-WebSocket-Key: " + "A" * 22 + "=="))
            answer = await streams[0].read(4096)
        try:
            if b" 101 " in answer[:20]:
                found.opened += 1
                sockets.add(streams)
                found.most_sockets = max(found.most_sockets, len(sockets))
                while await streams[0].read(4096):
                    pass
                sockets.discard(streams)
        finally:
            streams[1].close()


async def _body(server: Server, path: str, found: Flood) -> None:
    """A body, a byte each second."""
    with suppress(OSError):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(_head(server, "POST", path, "Content-Type: application/json", "Content-Length: 100000"))
        ended = asyncio.create_task(reader.read())
        try:
            while not ended.done():
                writer.write(b" ")
                await asyncio.wait((ended,), timeout=1.0)
            found.bodies_cut += 1
            with suppress(OSError):
                await ended
        finally:
            ended.cancel()
            writer.close()
