"""What has changed, told to every browser that is open: the websocket /api/events."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

__all__ = ["Events", "router"]

WAITING = 1000  # events that a browser may be behind before it is let go

router = APIRouter()


class Events:
    """Passes what is sent to everybody who listens; nobody waits for a slow listener."""

    def __init__(self) -> None:
        self._queues: set[asyncio.Queue[dict[str, Any] | None]] = set()

    def send(self, event: dict[str, Any]) -> None:
        """Tell all listeners. {"case": NAME} or {"cases": true} when one changed, {"job": ID, ...} for a job."""
        for queue in list(self._queues):
            if queue.qsize() >= WAITING:
                self._queues.discard(queue)
                queue.put_nowait(None)
            else:
                queue.put_nowait(event)

    @contextmanager
    def listen(self) -> Iterator[asyncio.Queue[dict[str, Any] | None]]:
        """A queue of events from now on; None ends it."""
        queue: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue()
        self._queues.add(queue)
        try:
            yield queue
        finally:
            self._queues.discard(queue)

    async def cases(self, _: object = None) -> None:
        """Tell all listeners that the list of cases has changed; for a job that has ended well, too."""
        self.send({"cases": True})

    def close(self) -> None:
        """Let all listeners go."""
        for queue in self._queues:
            queue.put_nowait(None)


@router.websocket("/api/events")
async def events(socket: WebSocket) -> None:
    """Pushes events as JSON; what the browser sends is read and dropped."""
    hub: Events = socket.app.state.terrapin.events
    await socket.accept()
    with hub.listen() as queue:
        ended = asyncio.create_task(_until_closed(socket))
        waiting = asyncio.create_task(queue.get())
        try:
            while True:
                await asyncio.wait((ended, waiting), return_when=asyncio.FIRST_COMPLETED)
                if ended.done():
                    return
                event = waiting.result()
                if event is None:
                    await socket.close(1013)  # try again later
                    return
                await socket.send_json(event)
                waiting = asyncio.create_task(queue.get())
        except (WebSocketDisconnect, RuntimeError):  # it went away while something was sent to it
            return
        finally:
            for task in (ended, waiting):
                task.cancel()
            with suppress(asyncio.CancelledError):
                await ended


async def _until_closed(socket: WebSocket) -> None:
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
