"""The door of the server alone, before an application that notes what reaches it: who comes in, and with what."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterable
from typing import Any

import pytest

from terrapin_hil.paths import ROOT
from terrapin_tools.web.service import security
from terrapin_tools.web.service.security import HEADERS, Door

Pairs = Iterable[tuple[str, str]]
HOST = ("host", "127.0.0.1:8765")
TOKEN = ("authorization", "Bearer token")
JSON = ("content-type", "application/json")
MAX_BODY, ALL_BODIES = 1 << 20, 8 << 20  # bytes, as docs/web.md has them


class Visit:
    """One request through the door: what the application got of it, and what was answered."""

    def __init__(
        self,
        headers: Pairs = (HOST, TOKEN),
        path: str = "/api/x",
        query: str = "",
        kind: str = "http",
        method: str = "GET",
        body: Iterable[bytes] = (b"",),
        streamed: Iterable[str] = (),
        answers: Pairs = (),
    ) -> None:
        self.got: list[dict[str, Any]] = []
        self.sent: list[dict[str, Any]] = []
        encoded = [(name.encode(), value.encode("latin-1")) for name, value in headers]
        scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": encoded}
        if kind == "http":
            scope["method"] = method
        self._scope, self._answers = scope, answers
        parts = list(body)
        self._messages = [
            {"type": "http.request", "body": part, "more_body": i < len(parts) - 1} for i, part in enumerate(parts)
        ]
        self._door = Door(self._application, "token", streamed, "our_cookie")

    async def _application(self, scope: Any, receive: Any, send: Any) -> None:
        assert scope is self._scope
        if scope["type"] == "http":
            self.got += [await receive(), await receive()]
            added = [(name.encode(), value.encode()) for name, value in self._answers]
            await send({"type": "http.response.start", "status": 200, "headers": added})
            await send({"type": "http.response.body", "body": b"page"})
        else:
            self.got.append(await receive())
            await send({"type": "websocket.accept"})

    async def through(self) -> Visit:
        messages = iter(self._messages)

        async def receive() -> dict[str, Any]:
            return next(messages, {"type": "http.disconnect"})

        async def send(message: Any) -> None:
            self.sent.append(message)

        await self._door(self._scope, receive, send)  # type: ignore[arg-type]
        return self

    @property
    def status(self) -> int:
        return int(self.sent[0]["status"])

    @property
    def headers(self) -> dict[str, str]:
        pairs = [(name.decode(), value.decode()) for name, value in self.sent[0]["headers"]]
        assert len({name for name, _ in pairs}) == len(pairs), "a header twice"
        return dict(pairs)

    @property
    def detail(self) -> str:
        found = json.loads(self.sent[1]["body"])["detail"]
        assert isinstance(found, str)
        return found


def visit(*args: Any, **named: Any) -> Visit:
    return asyncio.run(Visit(*args, **named).through())


@pytest.mark.parametrize(
    ("hosts", "status"),
    [
        ((), 400),
        (("127.0.0.1:1", "example.org"), 400),
        (("127.0.0.1:1", "127.0.0.1:1"), 400),
        (("127.0.0.1:1",), 200),
        (("LocalHost",), 200),
        (("[::1]:65535",), 200),
        (("127.0.0.1:123456",), 421),
        (("127.0.0.1.example.org",), 421),
        (("example.org",), 421),
    ],
)
def test_one_host_that_is_this_machine(hosts: tuple[str, ...], status: int) -> None:
    """h11 refuses two before the door sees them; another server below it might not."""
    for path in ("/", "/api/x"):
        found = visit([*(("host", host) for host in hosts), TOKEN], path)
        assert found.status == status
        assert bool(found.got) == (status == 200)


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://127.0.0.1:8765", 200),
        ("HTTP://127.0.0.1:8765", 200),
        ("https://127.0.0.1:8765", 403),
        ("http://127.0.0.1:8766", 403),
        ("http://localhost:8765", 403),
        ("null", 403),
        ("", 403),
    ],
)
def test_a_page_of_ours_alone_asks(origin: str, status: int) -> None:
    for path in ("/", "/api/x"):
        found = visit([HOST, TOKEN, ("origin", origin)], path)
        assert found.status == status
        assert bool(found.got) == (status == 200)


def test_of_two_origins_each_is_asked() -> None:
    ours, other = ("origin", "http://127.0.0.1:8765"), ("origin", "http://example.org")
    assert [visit([HOST, TOKEN, *two]).status for two in ((ours, ours), (ours, other), (other, ours))] == [
        200,
        403,
        403,
    ]


@pytest.mark.parametrize(
    ("site", "status"), [("same-origin", 200), ("none", 200), ("same-site", 403), ("cross-site", 403)]
)
def test_a_token_in_another_pages_request_opens_nothing(site: str, status: int) -> None:
    assert visit([HOST, TOKEN, ("sec-fetch-site", site)]).status == status
    assert visit([HOST, ("sec-fetch-site", site)], "/").status == 200  # a link to the page may stand anywhere


@pytest.mark.parametrize(
    ("path", "open_to_all"),
    [("/", True), ("/static/app.js", True), ("/apiary", True), ("/api", False), ("/api/", False)],
)
def test_what_needs_a_token(path: str, open_to_all: bool) -> None:
    assert visit([HOST], path).status == (200 if open_to_all else 401)
    assert visit([HOST, TOKEN], path).status == 200


@pytest.mark.parametrize(
    ("headers", "known"),
    [
        ([("authorization", "Bearer token")], True),
        ([("authorization", "bEARER  token ")], True),
        ([("authorization", "Bearer tokens")], False),
        ([("authorization", "Bearer toke")], False),
        ([("authorization", "Bearer ")], False),
        ([("authorization", "token")], False),
        ([("authorization", "Basic  token")], False),
        ([("authorization", "Bearer wrong"), ("authorization", "Bearer token")], True),
        ([("cookie", "our_cookie=token")], True),
        ([("cookie", "a=1; our_cookie=token; b=2")], True),
        ([("cookie", "our_cookie=wrong")], False),
        ([("cookie", "terrapin_token=token")], False),
        ([("cookie", "a=1")], False),
        ([("cookie", "a\x7f[]=1; our_cookie=wrong"), ("cookie", "our_cookie=token")], True),
        ([("cookie", "our_cookie=")], False),
        ([("x-token", "token")], False),
    ],
)
def test_a_token_in_a_header(headers: Pairs, known: bool) -> None:
    for path, kind in (("/api/x", "http"), ("/", "http"), ("/api/x", "websocket")):
        scope: Any = {"type": kind, "path": path, "query_string": b"", "headers": []}
        scope["headers"] = [(name.encode(), value.encode()) for name, value in headers]
        assert Door(nothing, "token", (), "our_cookie").knows(scope) == known


async def nothing(scope: Any, receive: Any, send: Any) -> None:
    return


def test_a_cookie_that_cannot_be_read_does_not_hide_another(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(text: str) -> dict[str, Any]:
        if text == "bad":
            raise security.CookieError(text)
        return {"our_cookie": type("Morsel", (), {"value": text})}

    monkeypatch.setattr(security, "SimpleCookie", read)
    assert visit([HOST, ("cookie", "bad"), ("cookie", "token")]).status == 200
    assert visit([HOST, ("cookie", "bad")]).status == 401


@pytest.mark.parametrize(
    ("kind", "path", "read"),
    [("http", "/", True), ("websocket", "/api/x", True), ("http", "/api/x", False), ("http", "/static/x", False)],
)
def test_a_query_has_the_token_where_a_page_can_give_no_header(kind: str, path: str, read: bool) -> None:
    """Of an address that is kept in a history, it opens no route. No longer query than so many fields is read."""
    for query, right in (
        ("token=token", True),
        ("a=1&token=token", True),
        ("token=wrong&token=token", True),
        ("token=", False),
        ("tokens=token", False),
        ("token=token" + 19 * "&a=1", True),
        ("token=token" + 20 * "&a=1", False),
        ("token=token" + 10_000 * "&a=1", False),
    ):
        scope: Any = {"type": kind, "path": path, "query_string": query.encode(), "headers": []}
        assert Door(nothing, "token").knows(scope) == (read and right), query[:40]


@pytest.mark.parametrize("method", ["GET", "HEAD", "POST"])
def test_a_refusal_says_why_and_keeps_to_itself(method: str) -> None:
    wrong = {
        400: [TOKEN],
        421: [("host", "example.org"), TOKEN],
        403: [HOST, TOKEN, ("origin", "null")],
        401: [HOST],
        413: [HOST, TOKEN, ("content-length", "9999999")],
    }
    for status, headers in wrong.items():
        found = visit(headers, method=method)
        assert found.status == status
        assert found.got == []
        start, body = found.sent
        assert (start["type"], body["type"]) == ("http.response.start", "http.response.body")
        assert HEADERS.items() <= found.headers.items()
        assert found.headers["content-type"] == "application/json"
        assert found.headers["connection"] == "close"  # what comes behind it was not read
        assert found.headers.get("www-authenticate") == ("Bearer" if status == 401 else None)
        if method == "HEAD":
            assert body["body"] == b""
            assert int(found.headers["content-length"]) > 20
        else:
            assert int(found.headers["content-length"]) == len(body["body"])
            assert "expected" in found.detail


def test_a_websocket_is_closed_for_its_policy() -> None:
    for headers in ([], [("host", "example.org"), TOKEN], [HOST, TOKEN, ("origin", "null")], [HOST]):
        found = visit(headers, kind="websocket")
        assert found.got == []
        assert [(m["type"], m["code"]) for m in found.sent] == [("websocket.close", 1008)]  # RFC 6455: policy
        assert "expected" in found.sent[0]["reason"]


def test_what_comes_in_is_untouched() -> None:
    for kind, headers in (("websocket", (HOST, TOKEN)), ("lifespan", ())):
        found = visit(headers, kind=kind, body=[b"hello"])
        assert found.got == [{"type": "http.request", "body": b"hello", "more_body": False}]
        assert found.sent == [{"type": "websocket.accept"}]


@pytest.mark.parametrize(("path", "kept"), [("/", "no-cache"), ("/static/app.js", "no-cache"), ("/api/x", "no-store")])
def test_every_answer_keeps_the_page_to_itself(path: str, kept: str) -> None:
    found = visit(path=path)
    assert found.headers == {**HEADERS, "cache-control": kept}
    assert found.sent[1] == {"type": "http.response.body", "body": b"page"}


def test_a_routes_own_header_stays() -> None:
    own = [("Content-Security-Policy", "sandbox"), ("x-own", "1")]
    headers = visit(answers=own).headers
    assert headers.pop("Content-Security-Policy") == "sandbox"
    assert headers.pop("x-own") == "1"
    assert set(headers) == {*HEADERS, "cache-control"} - {"content-security-policy"}


def test_a_body_comes_whole_and_once() -> None:
    """Then the application hears what the client does next: that it has gone."""
    for parts in ([b""], [b"abc"], [b"a", b"", b"bc"]):
        found = visit(body=parts, method="POST")
        assert found.got[0] == {"type": "http.request", "body": b"".join(parts), "more_body": False}
        assert found.got[1] == {"type": "http.disconnect"}


def test_a_streamed_body_is_left_to_its_route() -> None:
    parts = [b"x" * MAX_BODY, b"y" * MAX_BODY]
    found = visit(body=parts, streamed=["/api/uploads"], path="/api/uploads", method="POST")
    assert [message["body"] for message in found.got] == parts
    assert visit([HOST], streamed=["/api/uploads"], path="/api/uploads").status == 401


def test_a_body_of_the_bound_and_no_more() -> None:
    half = MAX_BODY // 2
    assert visit(body=[b" " * half, b" " * half]).status == 200
    for parts in ([b" " * half, b" " * (half + 1)], [b" " * (MAX_BODY + 1)]):
        found = visit(body=parts)
        assert (found.status, found.got) == (413, [])
        assert str(MAX_BODY) in found.detail


@pytest.mark.parametrize(
    ("length", "status"),
    [
        ("0", 200),
        (str(MAX_BODY), 200),
        (str(MAX_BODY + 1), 413),
        ("9" * 25, 413),
        ("0" * 20 + "9999999", 200),  # the body itself is still counted
        ("9" * 10_000, 413),
        ("-1", 413),
        ("+5", 413),
        ("1e9", 413),
        ("", 413),
        ("\xb2", 413),
    ],
)
def test_a_length_that_is_announced(length: str, status: int) -> None:
    assert visit([HOST, TOKEN, ("content-length", length)]).status == status


def test_a_body_that_breaks_off_reaches_nobody() -> None:
    for parts in ([], [b"{"]):
        one = Visit(body=parts)
        for message in one._messages:
            message["more_body"] = True
        found = asyncio.run(one.through())
        assert (found.status, found.got) == (400, [])
        assert "ended" in found.detail


def test_the_page_states_the_bounds() -> None:
    page = (ROOT / "docs" / "web.md").read_text(encoding="utf-8")
    assert f"Bodies: {security.MAX_BODY >> 20} MiB of JSON in UTF-8" in page
    assert f"arrived within {security.BODY_SECONDS:g} s (408, 413)" in page
    assert f"hold at most {security.ALL_BODIES >> 20} MiB together" in page


def test_a_body_without_end_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(security, "BODY_SECONDS", 0.05)
    assert asyncio.run(asyncio.wait_for(_held([1000], ends=False), 60.0)) == [408]


def test_bodies_of_all_browsers_together_are_bounded() -> None:
    """That one goes which began first, and no more of them than it takes."""
    each = MAX_BODY - 1
    room = ALL_BODIES // each
    assert asyncio.run(_held([each] * room)) == [0] * room
    assert asyncio.run(_held([each] * (room + 1))) == [408] + [0] * room
    assert asyncio.run(_held([each] * (room + 2))) == [408, 408] + [0] * room
    # What one holds alone is not enough: the next goes too.
    assert asyncio.run(_held([1, each, *[each] * room])) == [408, 408] + [0] * room


async def _held(sizes: list[int], ends: bool = True) -> list[int]:
    """Bodies that come one after the other, each open until all have begun: the status of those refused, else 0."""
    bodies, all_there = security._Bodies(), asyncio.Event()

    async def one(size: int) -> int:
        parts = iter([b" " * size])

        async def receive() -> dict[str, Any]:
            part = next(parts, None)
            if part is not None:
                return {"type": "http.request", "body": part, "more_body": True}
            await (all_there.wait() if ends else asyncio.Event().wait())
            return {"type": "http.request", "body": b"", "more_body": False}

        try:
            assert len(await bodies.read({"type": "http", "headers": []}, receive)) == size  # type: ignore[arg-type]
        except security._Refused as refused:
            return refused.status
        return 0

    tasks = []
    for size in sizes:
        tasks.append(asyncio.create_task(one(size)))
        for _ in range(5):
            await asyncio.sleep(0.0)
    all_there.set()
    return list(await asyncio.gather(*tasks))


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 100_000 + b"]" * 100_000,
        b'{"a": NaN}',
        b'{"a": -Infinity}',
        b'{"a": ' + b"9" * 10_000 + b"}",
        b'{"a": "\\ud800"}',
        b'{"a": "\xff\xfe"}',
        b'{"a": 1',
        '{"a": 1}'.encode("utf-16"),
    ],
)
def test_json_that_a_route_would_stumble_over(body: bytes) -> None:
    for kind in ("application/json", "application/problem+json; charset=utf-8"):
        found = visit([HOST, TOKEN, ("content-type", kind)], body=[body])
        assert (found.status, found.got) == (400, [])
        assert found.detail.isascii()
        assert len(found.detail) < 300
    assert visit([HOST, TOKEN, ("content-type", "text/plain")], body=[body]).status == 200


@pytest.mark.parametrize("body", [b"", b"null", b'{"a": [1, 2.5, "\xc3\xa4"]}'])
def test_json_that_is_sound(body: bytes) -> None:
    """No body at all is none that is wrong."""
    assert visit([HOST, TOKEN, JSON], body=[body]).got[0]["body"] == body


@pytest.mark.parametrize(
    ("sizes", "gone", "ended"),
    [([0], [], []), ([1], [0], []), ([1, 1], [0], []), ([9, 1], [0], []), ([1, 5], [1], [0]), ([-1, 0], [], [])],
)
def test_the_oldest_bodies_give_way_by_the_byte(sizes: list[int], gone: list[int], ended: list[int]) -> None:
    """`sizes` beyond half of what all may hold together, of two at most; `ended`: bodies whose time is over already."""

    class Deadline:
        def __init__(self, is_over: bool) -> None:
            self.is_over, self.at = is_over, None

        def expired(self) -> bool:
            return self.is_over

        def reschedule(self, when: Any) -> None:
            self.at = when

    half = ALL_BODIES // len(sizes)
    deadlines = [Deadline(place in ended) for place in range(len(sizes))]
    bodies = security._Bodies()
    bodies._held = {d: bytearray(half + more) for d, more in zip(deadlines, sizes, strict=True)}  # type: ignore[misc]
    bodies._make_room()
    assert [place for place, d in enumerate(deadlines) if d.at == 0.0] == gone
