"""Floods of connections, slow bodies and slow files: the server lets others in, and what is cut off is told why."""

from __future__ import annotations

import asyncio
import re
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from typing import Any

import pytest
from floods import HELD_SECONDS, flood
from serving import Server
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from terrapin_tools.web.service import bounds, security
from terrapin_tools.web.service.security import Door
from terrapin_tools.web.service.uploads import DBC_SECONDS
from tests.waiting import wait_for

BUSY = 10.0  # s: how much longer than on a machine of its own something may take here; bench_flood.py has the bounds


def test_a_flood_of_every_kind_keeps_nobody_out(own_server: Server) -> None:
    found = flood(own_server, 15.0)
    assert found.refused == []
    assert 0 < found.most_sockets <= bounds.MOST_SOCKETS
    assert 0.0 < found.longest_half_open <= HELD_SECONDS + BUSY
    assert found.bodies_cut > 0
    assert found.memory <= 16 << 20
    assert own_server.ask("GET", "/api/status").status == 200


def test_a_websocket_that_ends_makes_room(own_server: Server) -> None:
    where = f"ws://127.0.0.1:{own_server.port}/api/events?token={own_server.token}"
    with ExitStack() as lines:
        for _ in range(bounds.MOST_SOCKETS - 1):
            lines.enter_context(connect(where))
        with connect(where), pytest.raises(InvalidStatus) as refused, connect(where):
            pass
        assert refused.value.response.status_code == 503
        assert b"found 64 websockets" in (refused.value.response.body or b"")

        def again() -> bool:
            try:
                lines.enter_context(connect(where))
            except InvalidStatus:
                return False
            return True

        wait_for(again, "the room of one that ended")


def test_a_head_has_seconds_and_the_next_one_has_them_anew(own_server: Server) -> None:
    connection = HTTPConnection("127.0.0.1", own_server.port, timeout=60.0)
    connection.connect()
    for _ in range(5):  # longer together than one head may take, each far shorter: a busy machine sleeps late
        time.sleep(0.25 * bounds.HEAD_SECONDS)
        connection.request("GET", "/api/status", headers={"Authorization": f"Bearer {own_server.token}"})
        assert connection.getresponse().read()
    line = connection.sock
    with line:
        begin = time.monotonic()
        line.sendall(b"GET / HTTP/1.1\r\n")
        with suppress(ConnectionResetError):
            assert line.recv(65536) == b""
        assert bounds.HEAD_SECONDS - 0.5 < time.monotonic() - begin < bounds.HEAD_SECONDS + BUSY


def test_the_rest_of_a_body_that_was_answered_already_is_not_waited_for(own_server: Server) -> None:
    head = f"POST /api/uploads?name=a.exe HTTP/1.1\r\nHost: 127.0.0.1:{own_server.port}\r\n"
    head += f"Authorization: Bearer {own_server.token}\r\nContent-Length: 1000000\r\n\r\n"
    with socket.create_connection(("127.0.0.1", own_server.port), timeout=60.0) as line:
        line.sendall(head.encode())
        assert b" 422 " in line.recv(65536)[:20]
        begin = time.monotonic()
        with suppress(OSError):  # reset, or broken pipe
            while time.monotonic() - begin < bounds.HEAD_SECONDS + BUSY:
                line.sendall(b" ")
                time.sleep(0.2)
        assert time.monotonic() - begin < bounds.HEAD_SECONDS + BUSY


def door(receive: Callable[[int], Awaitable[dict[str, Any]]], count: int) -> list[int]:
    """The statuses of `count` requests at a Door whose bodies `receive` gives by the request's number."""
    sent: list[int] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def all_of_them() -> None:
        one = Door(app, "token")
        scope = {"type": "http", "path": "/", "method": "POST", "headers": [(b"host", b"localhost")]}

        async def request(number: int) -> None:
            async def send(message: Any) -> None:
                if message["type"] == "http.response.start":
                    sent.append(message["status"])

            await one(scope, lambda: receive(number), send)  # type: ignore[arg-type, return-value]

        await asyncio.gather(*(request(i) for i in range(count)))

    asyncio.run(all_of_them())
    return sent


def test_bodies_together_have_a_bound_and_the_first_makes_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(security, "ALL_BODIES", 10_000)
    pieces = [0] * 20

    async def receive(number: int) -> dict[str, Any]:
        pieces[number] += 1
        if number == 19 and pieces[number] > 1:
            return {"type": "http.request", "body": b"", "more_body": False}
        await asyncio.sleep(0.001 * number if pieces[number] == 1 else 600.0)
        return {"type": "http.request", "body": b" " * 1000, "more_body": True}

    monkeypatch.setattr(security, "BODY_SECONDS", 5.0)
    begin = time.monotonic()
    found = door(receive, 20)
    assert found[:9].count(408) >= 8, found  # those that were there first, as soon as others came
    assert found.count(200) == 1
    assert time.monotonic() - begin < 5.0 + BUSY


def a_dbc(messages: int) -> bytes:
    """A DBC of so many messages of eight signals."""
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: A"]
    for i in range(messages):
        lines.append(f"BO_ {i % 2000 + 2147483648 + i} M{i}: 8 A")
        lines += [f' SG_ S{k} : {8 * k}|8@1+ (0.1,0) [0|25.5] "m/s" A' for k in range(8)]
    return "\n".join([*lines, ""]).encode()


def test_a_description_that_takes_too_long_is_cut_off_and_stops_nobody(own_server: Server) -> None:
    answers = []
    slow = a_dbc(20_000)
    assert 6e6 < len(slow) < 8e6
    threads = [threading.Thread(target=lambda: answers.append(own_server.upload("slow.dbc", slow))) for _ in range(2)]
    begin = time.monotonic()
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert own_server.ask("GET", "/").status == 200
        time.sleep(0.1)
    assert time.monotonic() - begin < 2 * DBC_SECONDS + 3 * BUSY
    for answer in answers:
        assert answer.status == 422
        assert re.search(r"slow\.dbc: found no end of it after 10 s of reading, expected less in it", answer.detail)
    assert own_server.get("/api/uploads") == []
    assert own_server.upload("quick.dbc", a_dbc(5)).status == 201
