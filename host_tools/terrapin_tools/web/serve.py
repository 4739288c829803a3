"""uvicorn around the application, on a socket that is bound already."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from pathlib import Path

import uvicorn

from terrapin_tools.errors import UserError
from terrapin_tools.web.server import application
from terrapin_tools.web.service.bounds import MOST_CONNECTIONS, Http, Websocket
from terrapin_tools.web.service.context import NamedBus
from terrapin_tools.web.service.workspace import Workspace

__all__ = ["NamedBus", "serve"]

MAX_MESSAGE = 64 << 10  # bytes of a websocket message
# Connections that asyncio accepts at a time: it reads what came with them before MOST_OWING more of them are there.
ACCEPTED = 32
WAITING = 2048  # connections that the kernel keeps until they are accepted


async def serve(
    listening: socket.socket, workspace: Path, token: str, bus: NamedBus, ready: Callable[[], None]
) -> None:
    """Serve until interrupted. `ready` is called once requests are answered."""
    place = Workspace(workspace)
    try:
        config = uvicorn.Config(
            application(place, token, bus, listening.getsockname()[1]),
            log_level="error",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            http=Http,
            ws=Websocket,
            ws_max_size=MAX_MESSAGE,
            ws_per_message_deflate=False,
            h11_max_incomplete_event_size=64 << 10,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=3,
            limit_concurrency=MOST_CONNECTIONS,
            backlog=ACCEPTED,
            lifespan="on",
        )
        server = uvicorn.Server(config)
        task = asyncio.create_task(server.serve([listening]))
        while not server.started and not task.done():
            await asyncio.sleep(0.01)
        if not task.done():
            listening.listen(WAITING)
            ready()
        await task
        if not server.started:
            raise UserError("the server did not start; the lines above say why", 1)
    finally:
        place.release()
