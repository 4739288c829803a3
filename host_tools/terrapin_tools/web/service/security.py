"""The door of the server: who may speak to it, from where, and how much they may say. See docs/web.md.

Everything is checked before a route sees it: the Host header (a foreign name that resolves to this machine is refused),
the Origin, the token below /api/, the size and the shape of the body. Every answer carries the headers that keep the
page to itself.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import re
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["COOKIE", "MAX_BODY", "Door", "loopback"]

COOKIE = "terrapin_token"  # with the port behind it: a browser gives cookies of one port to all
MAX_BODY = 1 << 20  # bytes; uploads have their own bound
BODY_SECONDS = 10.0  # in which a small body has to arrive
ALL_BODIES = (
    8 << 20
)  # bytes of small bodies on their way, of all browsers: beyond it the one that began first is cut off
_LOOPBACK = re.compile(r"(?:localhost|127\.0\.0\.1|\[::1\])(?::\d{1,5})?", re.ASCII | re.IGNORECASE)
_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": _POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}


def loopback(host: str) -> bool:
    """Whether a Host header names this machine.

    >>> loopback("127.0.0.1:8765"), loopback("localhost"), loopback("127.0.0.1.example.org"), loopback("example.org")
    (True, True, False, False)
    """
    return _LOOPBACK.fullmatch(host) is not None


class _Refused(Exception):
    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status = status


class Door:
    """ASGI middleware around the whole application. `streamed` are paths whose route reads and bounds its own body."""

    def __init__(self, app: ASGIApp, token: str, streamed: Iterable[str] = (), cookie: str = COOKIE) -> None:
        self.app = app
        self._cookie = cookie
        self._token = token.encode()
        self._streamed = frozenset(streamed)
        self._bodies = _Bodies()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        try:
            self._check(scope)
            if scope["type"] == "http" and scope["path"] not in self._streamed:
                receive = _replay(await self._bodies.read(scope, receive), receive)
        except _Refused as refused:
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008, "reason": str(refused)})  # answered with 403
            else:
                await _refuse(send, refused, scope["method"])
            return
        await self.app(scope, receive, _with_headers(scope, send) if scope["type"] == "http" else send)

    def _check(self, scope: Scope) -> None:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        if len(hosts) != 1:
            raise _Refused(400, f"Host: found {len(hosts)} headers, expected one")
        if not loopback(hosts[0]):
            raise _Refused(421, "Host: found another machine's name, expected 127.0.0.1 or localhost")
        for origin in headers.getlist("origin"):
            if origin.lower() != f"http://{hosts[0].lower()}":
                raise _Refused(403, "Origin: found another page's, expected this server's own")
        path = scope["path"]
        if path != "/api" and not path.startswith("/api/"):
            return
        if any(site in ("cross-site", "same-site") for site in headers.getlist("sec-fetch-site")):
            raise _Refused(403, "Sec-Fetch-Site: found another page's request, expected this server's own page")
        if not self.knows(scope):
            raise _Refused(401, "found no valid token, expected Authorization: Bearer TOKEN (terrapin web prints it)")

    def knows(self, scope: Scope) -> bool:
        """Whether the request carries the token: in a header, in the cookie or (websockets, the page) in the query."""
        headers = Headers(scope=scope)
        found = [value[7:] for value in headers.getlist("authorization") if value[:7].lower() == "bearer "]
        for text in headers.getlist("cookie"):
            try:
                cookie = SimpleCookie(text).get(self._cookie)
            except CookieError:
                continue
            found += [cookie.value] if cookie is not None else []
        if scope["type"] == "websocket" or scope["path"] == "/":
            query = scope.get("query_string", b"").decode("latin-1")
            found += parse_qs(query, max_num_fields=20).get("token", []) if query.count("&") < 20 else []
        return any(hmac.compare_digest(text.strip().encode(), self._token) for text in found)


class _Bodies:
    """Reads whole bodies, bounded in size, time and (JSON) depth, and in what all of them hold together."""

    def __init__(self) -> None:
        self._held: dict[asyncio.Timeout, bytearray] = {}  # by the deadline of each, the first to begin first

    async def read(self, scope: Scope, receive: Receive) -> bytes:
        """One body. _Refused for one that is too large, too slow, cut off, or no JSON where it says so."""
        headers = Headers(scope=scope)
        too_large = _Refused(413, f"body: found more, expected at most {MAX_BODY} bytes")
        for length in headers.getlist("content-length"):
            if not (length.isascii() and length.isdigit()) or int(length[:20]) > MAX_BODY:
                raise too_large
        body = bytearray()
        try:
            async with asyncio.timeout(BODY_SECONDS) as deadline:
                self._held[deadline] = body
                try:
                    while True:
                        message = await receive()
                        if message["type"] != "http.request":
                            raise _Refused(400, "body: the connection ended before it")
                        body += message.get("body", b"")
                        if len(body) > MAX_BODY:
                            raise too_large
                        if not message.get("more_body", False):
                            break
                        self._make_room()
                finally:
                    del self._held[deadline]
        except TimeoutError:
            raise _Refused(
                408, f"body: found no end after {BODY_SECONDS:g} s, or too many others on their way"
            ) from None
        if body and any("json" in kind for kind in headers.getlist("content-type")):
            _check_json(bytes(body))
        return bytes(body)

    def _make_room(self) -> None:
        over = sum(map(len, self._held.values())) - ALL_BODIES
        for deadline, body in self._held.items():
            if over <= 0:
                break
            if not deadline.expired():
                deadline.reschedule(0.0)
                over -= len(body)


def _check_json(body: bytes) -> None:
    """Refuses what Python's own reader stumbles over: other encodings, depth, NaN, endless numbers, half characters."""

    def no_number(text: str) -> None:
        raise ValueError(f"found {text}, which is no JSON")

    try:
        value = json.loads(body.decode("utf-8"), parse_constant=no_number)
        json.dumps(value, ensure_ascii=False).encode()
    except RecursionError:
        raise _Refused(400, "body: JSON nested too deeply") from None
    except ValueError as error:
        reason = str(error).encode("ascii", "backslashreplace").decode()
        raise _Refused(400, f"body: {reason[:200]}, expected JSON in UTF-8") from None


def _replay(body: bytes, receive: Receive) -> Receive:
    told = False

    async def again() -> Message:
        nonlocal told
        if told:
            return await receive()  # the disconnect
        told = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


def _with_headers(scope: Scope, send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            have = {name.lower() for name, _ in message["headers"]}
            wanted = {**HEADERS, "cache-control": "no-store" if scope["path"].startswith("/api") else "no-cache"}
            added = [(k.encode(), v.encode()) for k, v in wanted.items() if k.encode() not in have]
            message = {**message, "headers": [*message["headers"], *added]}
        await send(message)

    return sending


async def _refuse(send: Send, refused: _Refused, method: str) -> None:
    body = json.dumps({"detail": str(refused)}).encode()
    headers = {**HEADERS, "content-type": "application/json", "content-length": str(len(body)), "connection": "close"}
    if refused.status == 401:
        headers["www-authenticate"] = "Bearer"
    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    await send({"type": "http.response.start", "status": refused.status, "headers": pairs})
    await send({"type": "http.response.body", "body": b"" if method == "HEAD" else body})
