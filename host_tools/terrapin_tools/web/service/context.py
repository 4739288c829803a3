"""What every route may use, as `request.app.state.terrapin` (or `websocket.app.state.terrapin`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import Depends
from fastapi.requests import HTTPConnection

from terrapin_hil.links.seal import LinkKey
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.jobs import Jobs
from terrapin_tools.web.service.warm import Warm
from terrapin_tools.web.service.workspace import Workspace

__all__ = ["Context", "NamedBus", "Terrapin", "context_of"]


@dataclass(frozen=True)
class NamedBus:
    """What `terrapin web --link --link-key` named: a link, "" for none, and the key of its controller."""

    link: str = ""
    key: LinkKey | None = None  # never leaves this process
    key_file: Path | None = None  # that it was read from


@dataclass(frozen=True)
class Context:
    """The parts of a running server."""

    workspace: Workspace
    jobs: Jobs
    events: Events
    warm: Warm  # runs functions of this program in a process of their own: await warm.call("module:function", ...)
    bus: NamedBus

    @property
    def link(self) -> str:
        """That `terrapin web --link` named, "" for none."""
        return self.bus.link


def context_of(connection: HTTPConnection) -> Context:
    """The server's parts, for a route or a websocket."""
    context = connection.app.state.terrapin
    assert isinstance(context, Context)
    return context


Terrapin = Annotated[Context, Depends(context_of)]
