"""The one thing that a server watches, and those who look at it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from weakref import WeakKeyDictionary

from terrapin_tools.errors import UserError
from terrapin_tools.web.live.picture import Picture
from terrapin_tools.web.live.session import Session
from terrapin_tools.web.live.socket import Audience
from terrapin_tools.web.live.watching import Watch, opened
from terrapin_tools.web.service.context import Context
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.jobs import ENDED, Job
from terrapin_tools.web.service.workspace import NotThere, Taken

__all__ = ["Hub", "hubs"]


class Hub:
    """The session of a server and those who watch it."""

    def __init__(self, events: Events) -> None:
        self._events = events
        self._announced: dict[str, Any] | None = None
        self.audience = Audience()
        self.session: Session | None = None
        self.changing = asyncio.Lock()
        self._lent: asyncio.Task[None] | None = None  # until a job has ended that has the link
        self._loop = asyncio.get_running_loop()

    async def open(self, context: Context, body: Watch) -> Session:
        async with self.changing:
            self._free()
            await self._close()
            ready = threading.Event()
            session: Session | None = None

            def tell(picture: Picture | None, status: dict[str, Any] | None) -> None:
                ready.wait(5.0)
                if session is not None and not self._loop.is_closed():
                    self._loop.call_soon_threadsafe(self._show, session, picture, status)

            try:
                session = await asyncio.to_thread(opened, context, body, tell)
                self.session = session
                self.audience.change(session)
            finally:
                ready.set()
            return session

    def _show(self, session: Session, picture: Picture | None, status: dict[str, Any] | None) -> None:
        self.audience.show(session, picture, status)
        if status is not None:
            self._announce()

    def _announce(self) -> None:
        """Tells every page, whichever part of it is looked at, whether there is something to stop."""
        now = self.stands()
        if now != self._announced:
            self._announced = now
            self._events.send({"live": now})

    def stands(self) -> dict[str, Any] | None:
        """What is watched, for pages that do not look at it; None: nothing is."""
        session = self.session
        if session is None:
            return None
        driver = session.controls.driver if session.controls is not None else ""
        return {
            "name": session.source.name,
            "stop": session.can_stop if session.state == "live" else "",
            "held": session.stop_held,
            "driven": bool(driver),
        }

    async def lend(self, context: Context, start: Callable[[], Job]) -> Job:
        """Lets go of what is watched for a job that needs its link; when that has ended, it is watched again."""
        async with self.changing:
            self._free()
            again = Watch.model_validate(self.watched().watch)
            await self._close()
            job: Job | None = None
            try:
                job = start()
            finally:  # also where it could not be queued
                self._lent = asyncio.create_task(self._again(context, again, job))
            return job

    async def _again(self, context: Context, body: Watch, job: Job | None) -> None:
        while job is not None and job.state not in ENDED:
            await asyncio.sleep(0.1)
        self._lent = None
        with suppress(UserError):  # the link is gone: the page says that nothing is watched
            await self.open(context, body)

    async def leave(self) -> None:
        """Watches nothing any more. Taken while the stop button is held in."""
        async with self.changing:
            self._free()
            await self._close()

    async def hold_stop(self, held: bool) -> None:
        """Holds the stop button of what is watched in, or lets it go; never while that is changed."""
        async with self.changing:
            await asyncio.to_thread(self.watched().hold_stop, held)

    async def close(self) -> None:
        """The server ends, and with it a stop that is held in."""
        if self._lent is not None:
            self._lent.cancel()
        async with self.changing:
            await self._close()

    def _free(self) -> None:
        if self._lent is not None:
            raise Taken("live: a job has the link of the controller, expected it ended or cancelled first")
        controls = self.session.controls if self.session is not None else None
        if controls is not None and controls.driver:
            raise Taken("live: a page drives what is watched, expected it disarmed first, or stopped")
        if self.session is not None and self.session.stop_held:
            raise Taken(f"live: the stop button of {self.session.source.name} is held in, expected it released first")

    async def _close(self) -> None:
        session, self.session = self.session, None
        if session is not None:
            self.audience.change(None)
            self._announce()
            await asyncio.to_thread(session.close)

    def watched(self) -> Session:
        """The session; NotThere when nothing is watched."""
        if self.session is None:
            raise NotThere("live: nothing is watched, expected POST /api/live first")
        return self.session


hubs: WeakKeyDictionary[Context, Hub] = WeakKeyDictionary()
