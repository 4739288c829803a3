"""Routes of the Live tab: what there is to watch, watching it, recording it."""

from __future__ import annotations

import asyncio
import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Request, WebSocket
from pydantic import BaseModel, Field, StringConstraints

from terrapin_hil import paths
from terrapin_hil.links.names import LinkName
from terrapin_tools.web.live.drive_api import same
from terrapin_tools.web.live.hub import Hub, hubs
from terrapin_tools.web.live.session import Session
from terrapin_tools.web.live.watching import DEVICE, UPLOAD, Watch
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import Request as Body
from terrapin_tools.web.service.models import problems
from terrapin_tools.web.service.uploads import upload_view
from terrapin_tools.web.service.workspace import Taken, is_name

__all__ = ["begin", "end", "router"]

router = APIRouter(prefix="/api", tags=["live"])
LOG = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,58}\.(log|blf|mf4|mcap)$"
CAN_DEVICES = "280"  # ARPHRD_CAN


class Link(BaseModel):
    """Something to watch: `source` is what POST /api/live takes (of kind dbc: as `dbc`)."""

    source: str
    title: str
    kind: Literal["bus", "log", "robot", "simulator", "dbc"]


class Watched(BaseModel):
    """What is being watched, if anything."""

    name: str | None
    state: str | None
    command: str | None
    recording: dict[str, Any] | None = None
    stands: dict[str, Any] | None = Field(default=None, description="whether it can be stopped, is stopped, is driven")


class Record(Body):
    """Begin a log (its suffix says of which kind: .log .blf .mf4 .mcap) or end it."""

    do: Literal["start", "stop"]
    name: Annotated[str, StringConstraints(pattern=LOG)] = "live.mcap"


class Recorded(BaseModel):
    """A log: its name in the workspace's logs folder, what it holds, and the command that records as well."""

    name: str
    frames: int
    bytes: int
    command: str


async def begin(context: Context) -> None:
    """When the server starts."""
    hubs[context] = Hub(context.events)


async def end(context: Context) -> None:
    """When it ends: the log is closed."""
    hub = hubs.pop(context)
    await hub.close()
    hub.audience.close()


@router.get("/links", responses=problems())
async def links(context: Terrapin) -> list[Link]:
    """What can be watched: buses of this machine, logs of the workspace, scenarios of the simulator."""
    return await asyncio.to_thread(_links, context)


def _links(context: Context) -> list[Link]:
    import tomllib

    from serial.tools import list_ports

    found = []
    if context.link:
        found.append(Link(source=context.link, title=f"{context.link} (named by --link)", kind="bus"))
    for path in sorted(Path("/sys/class/net").glob("*/type")):
        if path.read_text(encoding="ascii").strip() == CAN_DEVICES:
            bus = LinkName("socketcan", "socketcan", path.parent.name)
            found.append(Link(source=str(bus), title=f"CAN {path.parent.name}", kind="bus"))
    for port in sorted(list_ports.comports()):
        if DEVICE.match(port.device):
            title = f"{port.device} {port.description if port.description != 'n/a' else ''}".strip()
            found.append(Link(source=str(LinkName("serial", channel=port.device)), title=title, kind="bus"))
    title = "a simulated robot that stands on the floor, to drive"
    found.append(Link(source="robot:floor", title=title, kind="robot"))
    for path in sorted(paths.SCENARIOS.glob("*.toml")):
        title = tomllib.loads(path.read_text(encoding="utf-8")).get("title", path.stem)
        found.append(Link(source=f"simulator:{path.stem}", title=title, kind="simulator"))
    from terrapin_tools.logs.reading import READABLE

    for path in sorted(context.workspace.folder("logs").iterdir()):
        if is_name(path.name) and path.suffix.lower() in READABLE:
            found.append(Link(source=f"log:{path.name}", title=path.name, kind="log"))
        elif is_name(path.name) and path.suffix.lower() == ".dbc":
            found.append(Link(source=path.name, title=path.name, kind="dbc"))
    for path in sorted(context.workspace.folder("uploads").glob("*.json")):
        if not UPLOAD.match(path.stem):
            continue
        upload = upload_view(context.workspace, path.stem)
        if upload["kind"] == "log":
            found.append(Link(source=f"upload:{path.stem}", title=f"{upload['name']} (uploaded)", kind="log"))
        elif upload["kind"] == "dbc":
            found.append(Link(source=path.stem, title=f"{upload['name']} (uploaded)", kind="dbc"))
    return found


def _answer(session: Session | None) -> Watched:
    if session is None:
        return Watched(name=None, state=None, command=None)
    return Watched(
        name=session.source.name, state=session.state, command=session.command, recording=session.recording()
    )


@router.get("/live", responses=problems())
async def live(context: Terrapin) -> Watched:
    """What is being watched."""
    hub = hubs[context]
    return _answer(hub.session).model_copy(update={"stands": hub.stands()})


@router.post("/live", responses=problems(404, 409, 500))
async def watch(context: Terrapin, body: Watch) -> Watched:
    """Watch something; every browser sees it. What was watched before ends, with its log; 409 while somebody holds its
    stop button in."""
    return _answer(await hubs[context].open(context, body))


@router.delete("/live", responses=problems(409))
async def unwatch(context: Terrapin, request: Request) -> Watched:
    """Watch nothing any more; 409 while somebody holds the stop button in."""
    await hubs[context].leave()
    return Watched(name=None, state=None, command=same(request))


@router.post("/live/record", responses=problems(404, 409, 500))
async def record(context: Terrapin, request: Request, body: Record) -> Recorded:
    """Begin or end a log in the workspace's folder logs. It is readable up to the last half second at any moment."""
    session = hubs[context].watched()
    if body.do == "stop":
        found = await asyncio.to_thread(session.stop_recording) or session.last_log
        if found is None:
            raise Taken("record: nothing is being recorded")
        return Recorded(**{k: found[k] for k in ("name", "frames", "bytes")}, command=same(request, body))
    path = context.workspace.folder("logs") / body.name
    if path.exists():
        raise Taken(f"{body.name}: exists already, expected a new name")
    await asyncio.to_thread(session.record, path)
    words = shlex.split(session.command)
    link = ["--link", words[words.index("--link") + 1]] if "--link" in words else []
    command = shlex.join(["terrapin", "log", "record", str(path), *link]) if link else same(request, body)
    return Recorded(name=body.name, frames=0, bytes=0, command=command)


@router.websocket("/live/socket")
async def socket(socket: WebSocket) -> None:
    """Pictures of what is watched; see terrapin_tools/web/live/socket.py."""
    await hubs[socket.app.state.terrapin].audience.serve(socket)
