"""The calls that pages make of the worker: how many run at once, how many wait, and who is turned away."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from fastapi import FastAPI

from terrapin_tools.web.server import _complaints
from terrapin_tools.web.service import warm as worker
from terrapin_tools.web.service.warm import Busy, Warm
from tests.waiting import BOUND


class CountedWarm(Warm):
    """Calls that take until they are let go."""

    def __init__(self) -> None:
        super().__init__()
        self.running = self.most = 0
        self.let_go = asyncio.Event()

    async def _call(
        self, function: str, arguments: list[Any], seconds: float, told: Callable[[str], None] | None
    ) -> Any:
        self.running += 1
        self.most = max(self.most, self.running)
        try:
            await self.let_go.wait()
            return arguments
        finally:
            self.running -= 1


async def settled(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(BOUND):
        while not condition():
            await asyncio.sleep(0)


def test_some_run_some_wait_and_the_rest_are_turned_away() -> None:
    async def go() -> tuple[int, int, list[Any]]:
        warm = CountedWarm()
        room = worker.AT_ONCE["look"] + worker.MOST_WAITING
        calls = [asyncio.create_task(warm.call("a:b", i)) for i in range(room)]
        await settled(lambda: warm.running == worker.AT_ONCE["look"] and warm._lines["look"]._waiting == room - 4)
        with pytest.raises(Busy, match="found 100 requests that wait"):
            await warm.call("a:b")
        other = asyncio.create_task(warm.call("a:b", kind="read"))  # an upload is read all the same
        await settled(lambda: warm.running == worker.AT_ONCE["look"] + 1)
        calls[-1].cancel()  # who goes away makes room
        await settled(calls[-1].done)
        calls[-1] = asyncio.create_task(warm.call("a:b", room - 1))
        warm.let_go.set()
        answers = await asyncio.gather(*calls)
        await other
        return warm.most, warm.running, answers

    most, running, answers = asyncio.run(go())
    assert most == worker.AT_ONCE["look"] + 1
    assert running == 0
    assert answers == [[i] for i in range(len(answers))]


def test_a_call_that_fails_gives_its_turn_back() -> None:
    class Failing(CountedWarm):
        async def _call(self, *arguments: Any) -> Any:
            raise ValueError("broken")

    async def go() -> None:
        warm = Failing()
        for _ in range(3 * worker.AT_ONCE["look"]):
            with pytest.raises(ValueError, match="broken"):
                await warm.call("a:b")

    asyncio.run(asyncio.wait_for(go(), BOUND))


def test_turned_away_is_503_with_a_time_to_come_back() -> None:
    app = FastAPI()
    _complaints(app)

    @app.get("/")
    async def busy() -> None:
        raise Busy("found 100 requests that wait for an answer")

    sent: list[Any] = []

    async def receive() -> Any:
        return {"type": "http.request", "body": b""}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": "GET", "scheme": "http",
        "path": "/", "raw_path": b"/", "query_string": b"", "headers": [], "server": ("127.0.0.1", 80),
    }  # fmt: skip
    asyncio.run(app(scope, receive, send))
    assert sent[0]["status"] == 503
    assert (b"retry-after", b"1") in sent[0]["headers"]
    assert b"found 100 requests" in sent[1]["body"]
