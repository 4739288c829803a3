"""Requests to `terrapin web` that nobody should send: nothing without the token, no 5xx, nothing written, it lives."""

from __future__ import annotations

import http.client
import random
import tempfile
from pathlib import Path

from tests.attack import Result
from tests.web.serving import Server

COUNT, SHORT = 5000, 200
METHODS = ("GET", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "TRACE", "\x01", "GET\r\nX: y")
PATHS = (
    "/api/status",
    "/api/cases",
    "/api/cases/x",
    "/api/cases/..%2f..%2fetc",
    "/api/cases/x/jobs",
    "/api/jobs",
    "/api/uploads",
    "/api/uploads?name=../../x.csv",
    "/api/uploads?name=%00.csv",
    "/api/examples/heated_motor",
    "/api/command",
    "/api/live/command",
    "/api/live/parameters",
    "/api/live/robot",
    "/api/openapi.json",
    "/api/cases/%2e%2e",
    "//etc/passwd",
    "/../../etc/passwd",
    "/static/../../x",
    "/%ff",
    "/" + "a" * 9000,
    "/api/uploads/0123456789ab/preview",
)
BODIES = (
    b"",
    b"{",
    b"[" * 10_000,
    b"null",
    b'{"name": "../x"}',
    b'{"name": 1e999}',
    b"\xff\xfe",
    b'{"a":' * 900 + b"1" + b"}" * 900,
    b'{"name": "x", "base": "__import__(1)", "uploads": []}',
    b"\x89MCAP0\r\n" + bytes(50),
    bytes(70_000),
)


def _request(server: Server, draw: random.Random) -> tuple[bool, int]:
    """Whether somebody who may sent it, and the status (0: the server hung up)."""
    token = draw.random() < 0.4
    host = draw.choice([None, None, None, "evil.example", "127.0.0.1", f"127.0.0.1:{server.port}.evil.example"])
    origin = draw.choice([None, None, None, "http://evil.example", "null", f"http://127.0.0.1:{server.port + 1}"])
    headers = {} if origin is None else {"Origin": origin}
    if draw.random() < 0.2:
        headers["Content-Type"] = draw.choice(
            ["text/plain", "multipart/form-data", "application/json; charset=x", "\x7f"]
        )
    if not token and draw.random() < 0.5:
        headers["Authorization"] = draw.choice(
            ["Bearer ", f"Bearer {server.token}x", f"Basic {server.token}", "Bearer \xff"]
        )
    method, path = draw.choice(METHODS), draw.choice(PATHS)
    if draw.random() < 0.15:  # no HTTP at all, or half of it
        data = draw.choice(
            [
                draw.randbytes(200),
                b"GET / HTTP/9.9\r\n\r\n",
                b"POST /api/cases HTTP/1.1\r\nTransfer-Encoding: x\r\n\r\n",
            ]
        )
        answer = server.raw(data + b"\r\n\r\n")
        return False, int(answer[9:12]) if answer[:5] == b"HTTP/" else 0
    try:
        found = server.ask(method, path, draw.choice(BODIES) or None, headers, token=token, host=host)
    except (http.client.HTTPException, ValueError, OSError):
        return token, 0
    return token and host is None and origin is None, found.status


def attack(count: int, seed: int) -> Result:
    """`count` requests, with and without the token."""
    taken, first = 0, ""
    with tempfile.TemporaryDirectory() as name:
        server = Server(Path(name))
        try:
            outside = sorted(path.name for path in Path(name).iterdir())
            for number in range(count):
                draw = random.Random(f"{seed} {number}")
                may, status = _request(server, draw)
                wrong = ""
                if status >= 500 and status != 501:
                    wrong = f"status {status}"
                elif not may and 200 <= status < 300:
                    wrong = f"status {status} without the token"
                elif server.process.poll() is not None:
                    wrong = "the server ended"
                if wrong:
                    taken += 1
                    first = first or f"first: number {number} (seed {seed}): {wrong}"
            if server.ask("GET", "/api/status").status != 200 or outside != sorted(
                p.name for p in Path(name).iterdir()
            ):
                taken, first = taken + 1, first or "the server or its folder is not as it was"
        finally:
            server.process.terminate()
            server.process.wait(60)
    return Result("hostile requests", count, taken, first)
