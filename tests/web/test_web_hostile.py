"""Requests that nobody should send: the right status, nothing written, and the server goes on."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from serving import Server
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import connect

from tests.waiting import wait_for


@pytest.fixture(autouse=True)
def unharmed(server: Server) -> Iterator[None]:
    """Nothing is written, nothing runs, and the server answers as before."""
    before, jobs = server.files(), server.get("/api/jobs")
    yield
    assert server.files() == before
    assert server.get("/api/jobs") == jobs
    assert server.get("/api/status")["jobs_running"] == 0
    assert server.process.poll() is None


ROUTES = [
    ("GET", "/api/status"),
    ("GET", "/api/cases"),
    ("POST", "/api/cases"),
    ("GET", "/api/cases/x"),
    ("DELETE", "/api/cases/x"),
    ("POST", "/api/cases/x/jobs"),
    ("GET", "/api/examples"),
    ("POST", "/api/examples/heated_motor"),
    ("GET", "/api/jobs"),
    ("DELETE", "/api/jobs/0123456789ab"),
    ("POST", "/api/uploads?name=a.csv"),
    ("GET", "/api/cases/x/steps"),
    ("POST", "/api/cases/x/unmap"),
    ("POST", "/api/cases/x/draw"),
    ("POST", "/api/batches/x/runs/1"),
    ("GET", "/api/examples/heated_motor/picture"),
    ("GET", "/api/live/parameters"),
    ("POST", "/api/live/parameters"),
    ("POST", "/api/live/command"),
    ("POST", "/api/live/replay"),
    ("POST", "/api/live/robot"),
    ("GET", "/api/openapi.json"),
    ("GET", "/api/nothing"),
    ("GET", "/api"),
]


@pytest.mark.parametrize(("method", "path"), ROUTES)
def test_without_the_token_nothing_is_answered(server: Server, method: str, path: str) -> None:
    wrong = [
        {},
        {"Authorization": "Bearer "},
        {"Authorization": f"Bearer {server.token}x"},
        {"Authorization": f"Bearer {server.token[:-1]}"},
        {"Authorization": f"Basic {server.token}"},
        {"Authorization": "Bearer \xff\xfe"},
        {"Cookie": f"terrapin_token_{server.port}=; other=1"},
        {"Cookie": f"terrapin={server.token}"},
        {"Cookie": "\x7f=;;;=,=" * 50},
        {"X-Token": server.token},
    ]
    for headers in wrong:
        answer = server.ask(method, path, b"{}" if method == "POST" else None, headers, token=False)
        assert answer.status == 401, headers
        assert "token" in answer.detail
        assert answer.headers["www-authenticate"] == "Bearer"
    assert server.ask(method, f"{path}{'&' if '?' in path else '?'}token={server.token}", token=False).status == 401


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/static/../server.py",
        "/static/..%2fserver.py",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/static/%2e%2e/%2e%2e/cli.py",
        "/static//etc/passwd",
        "/..\\..\\windows",
        "/static/%00",
        "/server.py",
        "/api/cases/..%2f..%2f..%2fetc",
        "/api/cases/%2e%2e",
        "/api/cases/..",
        "/api/cases/.new-0",
        "/api/cases/a%00b",
        "/api/cases/a%0ab",
        "/api/cases/a%20b",
        "/api/cases/%c3%a4",
        "/api/cases/" + "a" * 65,
        "/api/cases/../jobs/../../x/report",
        "/api/cases/..%5c..%5cx/report",
        "/api/cases/%252e%252e/export",
        "/api/jobs/../../x",
        "/api/jobs/ABCDEF012345",
        "/api/jobs/..%2f0123456789ab",
        "/api/uploads/..%2fx/preview",
        "/api/uploads/0123456789ab/preview",
        "/api/uploads/0123456789ab/preview?dbc=../../x",
        "/api/examples/..%2f..",
    ],
)
def test_paths_that_lead_elsewhere(server: Server, path: str) -> None:
    answer = server.ask("GET", path)
    assert answer.status in (404, 405, 422), answer.body
    assert b"root:" not in answer.body
    if "/api/" in path:
        assert answer.detail
        assert server.ask("DELETE", path).status in (404, 405, 422)


@pytest.mark.parametrize(
    "name", ["../x.csv", "..\\x.csv", "/etc/passwd", "a.exe", "x", "a.csv/", "%00.sh", ".csv%2f.."]
)
def test_names_of_uploads_never_become_paths(server: Server, name: str) -> None:
    answer = server.ask("POST", f"/api/uploads?name={name}", b"time\n")
    assert answer.status == 422, answer.body


@pytest.mark.parametrize(
    "host", ["example.org", "127.0.0.1.example.org", "localhost.evil", "10.0.0.1", "[::2]", "127.0.0.1:99999999", ""]
)
def test_another_machines_name(server: Server, host: str) -> None:
    for path in ("/", "/api/status"):
        answer = server.ask("GET", path, headers={"Host": host} if not host else None, host=host or None)
        assert answer.status in (400, 421), host


def test_host_must_be_there_once(server: Server) -> None:
    start = f"GET /api/status HTTP/1.1\r\nAuthorization: Bearer {server.token}\r\n"
    assert b" 400 " in server.raw(f"{start}\r\n".encode()).splitlines()[0]
    both = f"{start}Host: 127.0.0.1:{server.port}\r\nHost: example.org\r\n\r\n"
    assert b" 400 " in server.raw(both.encode()).splitlines()[0]
    old = f"GET /api/status HTTP/1.0\r\nAuthorization: Bearer {server.token}\r\n\r\n"
    assert b" 400 " in server.raw(old.encode()).splitlines()[0]


@pytest.mark.parametrize(
    "origin",
    ["http://example.org", "null", "https://127.0.0.1:{}", "http://127.0.0.1:1", "http://localhost:{}", "file://"],
)
def test_another_page(server: Server, origin: str) -> None:
    headers = {"Origin": origin.format(server.port)}
    for method, path in (
        ("GET", "/api/status"),
        ("POST", "/api/examples/heated_motor"),
        ("OPTIONS", "/api/cases"),
        ("GET", "/"),
    ):
        answer = server.ask(method, path, headers=headers)
        assert answer.status == 403
        assert not any(name.startswith("access-control") for name in answer.headers)
    cookie = {"Cookie": f"terrapin_token_{server.port}={server.token}", "Sec-Fetch-Site": "same-site"}
    assert server.ask("GET", "/api/status", headers=cookie, token=False).status == 403
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{server.port}/api/events?token={server.token}", additional_headers=headers)
    assert refused.value.response.status_code == 403


def test_our_own_page(server: Server) -> None:
    headers = {"Origin": f"http://127.0.0.1:{server.port}", "Sec-Fetch-Site": "same-origin"}
    assert server.ask("GET", "/api/status", headers=headers).status == 200


def test_bodies_that_are_too_large(server: Server) -> None:
    large = b'{"do": "' + b"x" * (2 << 20) + b'"}'
    assert server.ask("POST", "/api/cases/x/jobs", large).status == 413
    start = (
        f"POST /api/expression HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nAuthorization: Bearer {server.token}\r\n"
    )
    for length in ("3000000", "99999999999999999999999", "-1", "+5", "1e9"):
        first = server.raw(f"{start}Content-Length: {length}\r\n\r\n".encode()).splitlines()[0]
        assert b" 413 " in first or b" 400 " in first, length
    chunk = b"10000\r\n" + b" " * 65536 + b"\r\n"
    chunked = (
        f"{start}Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n".encode()
        + chunk * 20
        + b"0\r\n\r\n"
    )
    assert b" 413 " in server.raw(chunked).splitlines()[0]
    both = f"{start}Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
    assert b" 4" in server.raw(both.encode()).splitlines()[0]
    announced = server.raw(
        start.replace("expression", "uploads?name=a.csv").encode() + b"Content-Length: 2147483649\r\n\r\n"
    )
    assert b" 413 " in announced.splitlines()[0]
    header = server.raw(f"{start}X-Large: {'x' * 200_000}\r\n\r\n".encode())
    assert header == b"" or b" 4" in header.splitlines()[0]


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 10_000 + b"]" * 10_000,
        b'{"a":' * 10_000 + b"1" + b"}" * 10_000,
        b'{"do": "compare", "seed": NaN}',
        b'{"do": "compare", "level": Infinity}',
        b'{"do": "compare", "seed": ' + b"9" * 10_000 + b"}",
        b'{"do": "add", "effects": ["\\ud800"]}',
        b'{"do": "\xff\xfe"}',
        b'{"do": "compare"',
        b"\x00",
        '{"do": "compare"}'.encode("utf-16"),
        b"",
        b"null",
        b"[]",
        b'"compare"',
        b'{"do": "compare", "unknown": 1}',
        b'{"do": "compare", "seed": "1"}',
        b'{"do": "compare", "seed": -1}',
        b'{"do": "compare", "seed": 1e300}',
        b'{"do": "compare", "level": 0}',
        b'{"do": "shell", "command": "id"}',
        b'{"do": "add", "effects": []}',
        b'{"do": "add", "effects": ["--help"]}',
        b'{"do": "add", "effects": ["a b"]}',
        b'{"do": "add", "effects": ["a\\n"]}',
        b'{"do": "add", "effects": ["x"], "expression": "a\\u0000b"}',
        b'{"do": "add", "effects": ["x"], "parameters": {"k=1:0:1": {"value": 1}}}',
        b'{"do": "add", "effects": ["x"], "target": "y"}',
        b'{"do": "remove", "effect": "../../x"}',
        b'{"do": "undo", "steps": 3}',
        b'{"do": "hold", "runs": ["--json"]}',
        b'{"do": "hold", "runs": ["a\\u0000"]}',
        b'{"do": "constant", "name": "radius", "value": "$(id)"}',
        b'{"do": "constant", "name": "--to", "value": "1 m"}',
        b'{"do": "export", "scenario": "/etc/passwd"}',
    ],
)
def test_bodies_that_are_wrong(server: Server, body: bytes) -> None:
    """On a case that is there, so that only the body is to blame."""
    assert (server.workspace / "cases" / "forced_slip_sand" / "case.toml").is_file()
    answer = server.ask("POST", "/api/cases/forced_slip_sand/jobs", body, {"Content-Type": "application/json"})
    assert answer.status in (400, 422), answer.body
    assert len(answer.detail) < 2100


@pytest.mark.parametrize(
    ("route", "body"),
    [
        ("command", b'{"request": "run"}'),
        ("command", b'{"request": "arm", "page": "../../x"}'),
        ("command", b'{"request": "arm", "page": "0123456789abcdef0"}'),
        ("robot", b'{"change": "request = run"}'),
        ("robot", b'{"change": "ground = sand\\nvoltage = 8 V"}'),
        ("robot", b'{"change": "tow = $(id)"}'),
        ("replay", b'{"position": NaN}'),
        ("replay", b'{"speed": 1e300}'),
        ("parameters", b'{"name": "../x", "value": 1}'),
        ("parameters", b'{"name": "window", "value": 1e999}'),
        ("parameters", b'{"do": "erase"}'),
    ],
)
def test_what_nobody_may_ask_of_a_robot(server: Server, route: str, body: bytes) -> None:
    answer = server.ask("POST", f"/api/live/{route}", body, {"Content-Type": "application/json"})
    assert answer.status in (400, 422), answer.body
    assert len(answer.detail) < 2100


def test_another_page_drives_nothing(server: Server) -> None:
    """Another origin opens no socket of the Live tab, on which beats go."""
    for query, origin in (("", f"http://127.0.0.1:{server.port}"), (f"?token={server.token}", "http://example.org")):
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://127.0.0.1:{server.port}/api/live/socket{query}", additional_headers={"Origin": origin})
        assert refused.value.response.status_code == 403


def test_methods_and_routes_that_are_not_there(server: Server) -> None:
    for method in ("PUT", "PATCH", "TRACE", "CONNECT", "OPTIONS", "PROPFIND"):
        assert server.ask(method, "/api/cases").status in (400, 405), method
    assert server.ask("GET", "/api/nothing").status == 404
    assert server.ask("GET", "/docs").status == 404
    assert b" 4" in server.raw(b"\x16\x03\x01\x02\x00garbage\r\n\r\n").splitlines()[0]


def test_an_upload_that_is_broken_off_leaves_nothing(server: Server) -> None:
    before = server.files()
    start = f"POST /api/uploads?name=a.csv HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
    start += f"Authorization: Bearer {server.token}\r\n"
    with socket.create_connection(("127.0.0.1", server.port)) as line:
        line.sendall(f"{start}Content-Length: 100000000\r\n\r\n".encode() + b"time\n" * 200_000)
        wait_for(lambda: any(name.endswith(".part") for name in server.files()), "its begin")
    wait_for(lambda: server.files() == before, "nothing to be left")


def websocket(server: Server) -> Any:
    return connect(f"ws://127.0.0.1:{server.port}/api/events?token={server.token}")


def test_websockets_without_a_token(server: Server) -> None:
    for query in ("", "?token=", "?token=wrong", f"?token={server.token}x", "?token=" + "&token=" * 100):
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://127.0.0.1:{server.port}/api/events{query}")
        assert refused.value.response.status_code == 403


@pytest.mark.parametrize(
    "message", ["not json", "[" * 10_000, b"\x00\xff" * 1000, json.dumps({"case": "x"}), "x" * (3 << 20)]
)
def test_websocket_messages_are_no_orders(server: Server, message: str | bytes) -> None:
    with websocket(server) as line:
        try:
            line.send(message)
            line.recv(timeout=0.2)
        except (TimeoutError, WebSocketException):
            pass


@pytest.mark.parametrize(
    "frames",
    [
        b"\x81\x05hello",  # not masked
        b"\xff\x80\x00\x00\x00\x00",  # reserved bits and code
        b"\x81\xff\xff\xff\xff\xff\xff\xff\xff\xff\x00\x00\x00\x00",  # 2^64 bytes announced
        b"\x89\xfe\x04\x00\x00\x00\x00\x00" + b"x" * 1024,  # a ping that is too long
        b"\x81\x82\x00\x00\x00\x00\xff\xfe",  # text that is not UTF-8
        b"\x00\x81\x00\x00\x00\x00x",  # goes on with nothing
    ],
)
def test_malformed_websocket_frames(server: Server, frames: bytes) -> None:
    hello = (
        f"GET /api/events?token={server.token} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", server.port), timeout=300) as line:
        line.sendall(hello.encode())
        assert b" 101 " in line.recv(4096)
        line.sendall(frames)
        answer = line.recv(4096)  # a close frame, or the end
        assert answer == b"" or answer[0] == 0x88
