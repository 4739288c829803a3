"""The websocket of the Live tab: pictures of the one source to every browser, each as fast as it can take them.

To the browser: text {"type": "hello"...} when the source changes, {"type": "status"...} ten times a second, and binary
pictures (terrapin_tools/web/live/picture.py says how they are laid out). From the browser: {"want": [signal, ...]},
{"seen": number of the last picture}, and from the page that drives, ten times a second, {"beat": {"request": "run",
"control": "speed", "setpoint": 0.3, "limiter": true}}.

A browser that is behind by WINDOW pictures gets no more until it catches up; the numbers of the pictures and of the
frames in them tell it what it missed.
"""

from __future__ import annotations

import asyncio
import json
import math
import secrets
from collections import deque
from contextlib import suppress
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from terrapin_tools.monitor.controls import LIMITS, Order
from terrapin_tools.web.live.picture import Picture
from terrapin_tools.web.live.session import Session

__all__ = ["Audience"]

WINDOW = 45  # pictures on their way to a browser: 1.5 s
MOST_WANTED = 64
MOST_CLIENTS = 32
MOST_EVENTS = 1000


class _Client:
    def __init__(self) -> None:
        self.page = secrets.token_hex(8)  # by which it is armed
        self.asked: frozenset[int] = frozenset()  # what it wants
        self.wanted: frozenset[int] = frozenset()  # what its pictures hold: what it wants, once their past was given
        self.past: bytes | None = None  # of these packets
        self.waits_for_past = False  # until it was sent: a browser that asks and does not read costs one, not many
        self.packets: deque[bytes] = deque()
        self.sent = self.seen = 0  # number of the last picture
        self.hello: dict[str, Any] | None = None
        self.status: dict[str, Any] | None = None
        self.events: deque[dict[str, Any]] = deque(maxlen=MOST_EVENTS)
        self.told = 0  # number of the last of them
        self.news = asyncio.Event()
        self.in_flight: deque[int] = deque()


class Audience:
    """The browsers that watch. All methods belong to the server's one thread."""

    def __init__(self) -> None:
        self._clients: set[_Client] = set()
        self._session: Session | None = None

    def change(self, session: Session | None) -> None:
        """Another source, or none."""
        self._session = session
        for client in self._clients:
            self._begin(client)

    def _begin(self, client: _Client) -> None:
        client.packets.clear()
        client.in_flight.clear()
        client.events.clear()
        client.asked = client.wanted = frozenset()
        client.past, client.waits_for_past = None, False
        hello = self._session.hello() if self._session is not None else {"type": "hello", "name": None}
        client.hello = {**hello, "page": client.page}
        client.status = self._session.so_far() if self._session is not None else None
        client.told = 0
        self._tell(client, client.status)
        client.news.set()

    def is_open(self, page: str) -> bool:
        """Whether a browser of that name looks."""
        return any(client.page == page for client in self._clients)

    def _tell(self, client: _Client, status: dict[str, Any] | None) -> None:
        """The events of a status, each once: one on its way may hold some that a browser was given as it came."""
        for event in status["events"] if status is not None else ():
            if event["number"] > client.told:
                client.told = event["number"]
                client.events.append(event)

    def show(self, session: Session, picture: Picture | None, status: dict[str, Any] | None) -> None:
        """Pass on what a session has made."""
        if session is not self._session:
            return
        for client in self._clients:
            if picture is not None and len(client.in_flight) < WINDOW:
                client.packets.append(picture.packet(client.wanted))
                client.in_flight.append(picture.number)
            if status is not None:
                client.status = status
                self._tell(client, status)
            client.news.set()

    async def serve(self, socket: WebSocket) -> None:
        """One browser, until it goes."""
        await socket.accept()
        if len(self._clients) >= MOST_CLIENTS:
            await socket.close(1013, f"found {MOST_CLIENTS} browsers, expected fewer")
            return
        client = _Client()
        self._clients.add(client)
        self._begin(client)
        tasks = [asyncio.create_task(self._send(socket, client)), asyncio.create_task(self._hear(socket, client))]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._clients.discard(client)
            if self._session is not None and self._session.controls is not None:
                self._session.controls.gone(client.page)
            for task in tasks:
                task.cancel()
            for task in tasks:
                with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):  # it went away
                    await task

    def close(self) -> None:
        """Nobody watches any more."""
        self._session = None
        self._clients.clear()

    async def _send(self, socket: WebSocket, client: _Client) -> None:
        while True:
            await client.news.wait()
            client.news.clear()
            if client.hello is not None:
                hello, client.hello = client.hello, None
                await socket.send_text(json.dumps(hello, allow_nan=False))
            while client.packets:
                packet = client.packets.popleft()
                await socket.send_bytes(packet)
                if packet is client.past:
                    client.past, client.waits_for_past = None, False
                    self._ask_past(client)
            if client.status is not None:
                status, client.status = client.status, None
                events = list(client.events)
                client.events.clear()
                await socket.send_text(json.dumps({**status, "events": events}, allow_nan=False))

    async def _hear(self, socket: WebSocket, client: _Client) -> None:
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            try:
                self._do(client, _request(message.get("text")))
            except ValueError as error:
                await socket.close(1008, str(error)[:100])
                return

    def _do(self, client: _Client, request: dict[str, Any]) -> None:
        if "seen" in request:
            while client.in_flight and client.in_flight[0] <= request["seen"]:
                client.in_flight.popleft()
        if "beat" in request and self._session is not None and self._session.controls is not None:
            self._session.controls.beat(client.page, request["beat"])
        if "want" in request and self._session is not None:
            client.asked = frozenset(request["want"]) & frozenset(range(len(self._session.names)))
            client.wanted &= client.asked
            self._ask_past(client)

    def _ask_past(self, client: _Client) -> None:
        """Asks for the past of what a browser wants and has not: pictures hold it from the moment on that it ends."""
        new = client.asked - client.wanted
        if not new or client.waits_for_past or self._session is None:
            return
        client.waits_for_past = True
        loop, session = asyncio.get_running_loop(), self._session
        session.past(new, lambda packet: loop.call_soon_threadsafe(self._begin_with, session, client, new, packet))

    def _begin_with(self, session: Session, client: _Client, signals: frozenset[int], past: bytes) -> None:
        if session is self._session:
            client.past = past
            client.packets.append(past)
            client.wanted |= signals & client.asked
            client.news.set()


def _request(text: str | None) -> dict[str, Any]:
    """What a browser asks for. ValueError for anything else."""
    if text is None or len(text) > 4096:
        raise ValueError("expected a short JSON text")
    try:
        request = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError("found no JSON") from None
    if not isinstance(request, dict) or not request.keys() <= {"want", "seen", "beat"}:
        raise ValueError('expected {"want": [...]}, {"seen": number} or {"beat": {...}}')
    seen, want = request.get("seen", 0), request.get("want", [])
    if not _whole(seen) or not isinstance(want, list) or len(want) > MOST_WANTED or not all(map(_whole, want)):
        raise ValueError(f"expected whole numbers, at most {MOST_WANTED} signals")
    if "beat" in request:
        request["beat"] = _order(request["beat"])
    return request


def _order(beat: Any) -> Order:
    """What the page that drives wants. ValueError for what is none."""
    if not isinstance(beat, dict) or beat.keys() != {"request", "control", "setpoint", "limiter"}:
        raise ValueError("expected request, control, setpoint and limiter")
    request, control, setpoint, limiter = (beat[name] for name in ("request", "control", "setpoint", "limiter"))
    if request not in ("idle", "calibrate", "run") or control not in LIMITS or not isinstance(limiter, bool):
        raise ValueError("found no request, control or limiter that there is")
    if isinstance(setpoint, bool) or not isinstance(setpoint, int | float) or not math.isfinite(setpoint):
        raise ValueError("expected a number as setpoint")
    if abs(setpoint) > LIMITS[control][1]:
        raise ValueError("found a setpoint that no robot has")
    return Order(request, control, float(setpoint), limiter)


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53
