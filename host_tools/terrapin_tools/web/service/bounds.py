"""How many connections the server holds, and how long it waits for what a browser owes it. See docs/web.md, Limits.

uvicorn bounds only the sum of its connections: whoever opens that many and says nothing keeps everybody else out. Here
the ones that owe something (the rest of a head or of a body, or a next request) are counted apart, and the one that has
been behind for longest makes way for a new one. The protocols extend uvicorn's, which promises no interface:
requirements.lock pins its version.
"""

from __future__ import annotations

import asyncio

import h11
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

__all__ = ["HEAD_SECONDS", "MOST_CONNECTIONS", "MOST_OWING", "MOST_SOCKETS", "Http", "Sockets", "Websocket"]

MOST_SOCKETS = 64  # websockets that are open, of all browsers
MOST_OWING = 128  # connections that owe the rest of a request, or wait for their next one
MOST_CONNECTIONS = 512  # of every kind: what owes, websockets, and requests that wait for an answer (see warm.py)
HEAD_SECONDS = 5.0  # from the connection, or the first byte after an answer, to the end of the head
STEP = 64 << 10  # bytes of a body with which a connection is no longer behind
UNREAD_SECONDS = 30.0  # for which a browser may leave an answer unread


class Sockets:
    """ASGI middleware: at most MOST_SOCKETS websockets; one more is answered with 503 before it is opened."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._open = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "websocket":
            await self.app(scope, receive, send)
            return
        if self._open >= MOST_SOCKETS:
            body = b'{"detail": "found %d websockets, expected fewer: try again"}' % MOST_SOCKETS
            headers = [(b"content-type", b"application/json"), (b"retry-after", b"1"), (b"connection", b"close")]
            headers.append((b"content-length", b"%d" % len(body)))
            await send({"type": "websocket.http.response.start", "status": 503, "headers": headers})
            await send({"type": "websocket.http.response.body", "body": body})
            return
        self._open += 1
        try:
            await self.app(scope, receive, send)
        finally:
            self._open -= 1


class Http(H11Protocol):
    """uvicorn's HTTP/1.1 connection, with a deadline for each head, and for reading an answer."""

    _behind: float | None = None  # since when it has owed us something (loop's clock, s); None: we owe an answer
    _deadline: asyncio.TimerHandle | None = None
    _unread: asyncio.TimerHandle | None = None
    _step = 0  # bytes of a body since it was last behind

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._behind = self.loop.time()
        self._deadline = self.loop.call_later(HEAD_SECONDS, self._drop)
        owing = [one for one in self.connections if isinstance(one, Http) and one._behind is not None]
        if len(owing) > MOST_OWING:
            min(owing, key=lambda one: one._behind or 0.0)._drop()

    def connection_lost(self, exc: Exception | None) -> None:
        self._forget()
        self._behind = None
        self.resume_writing()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._step += len(data)
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._unread = self._unread or self.loop.call_later(UNREAD_SECONDS, self._drop)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None

    def _watch(self) -> None:
        """What the browser owes now. The deadline of a head is not moved by its bytes, only by its end."""
        theirs, now = self.conn.their_state, self.loop.time()
        if self.transport.is_closing() or self.transport.get_protocol() is not self:  # a websocket has taken over
            self._forget()
            self._behind = None
        elif theirs is h11.IDLE and (self._deadline is not None or self.conn.trailing_data[0]):
            self._behind = now if self._behind is None else self._behind
            self._deadline = self._deadline or self.loop.call_later(HEAD_SECONDS, self._drop)
        elif theirs is h11.IDLE:  # between two requests: uvicorn's timeout_keep_alive ends it
            self._behind = now if self._behind is None else self._behind
        elif theirs is h11.SEND_BODY and self.conn.our_state is h11.DONE:  # answered already, nobody reads the rest
            self._deadline = self._deadline or self.loop.call_later(HEAD_SECONDS, self._drop)
        elif theirs is h11.SEND_BODY:  # Door and uploads.py have the deadlines of bodies
            self._forget()
            if self._behind is None or self._step >= STEP:
                self._behind, self._step = now, 0
        else:
            self._forget()
            self._behind = None

    def _forget(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _drop(self) -> None:
        self._forget()
        self._behind = None
        self.transport.abort()


class Websocket(WebSocketsSansIOProtocol):
    """uvicorn's websocket. One that answers no ping is ended at once: it would not read the farewell either."""

    def keepalive_timeout(self) -> None:
        super().keepalive_timeout()
        self.transport.abort()
