"""Routes of the Live tab: what there is to watch, watching it, recording it, stopping the robot."""

from __future__ import annotations

import asyncio
import re
import shlex
import stat
import threading
from pathlib import Path
from typing import Annotated, Any, Literal
from weakref import WeakKeyDictionary

from fastapi import APIRouter, Request, WebSocket
from pydantic import BaseModel, Field, StringConstraints

from terrapin_hil import paths
from terrapin_hil.links.names import LinkName, able
from terrapin_hil.nodes import node_count
from terrapin_tools.errors import UserError
from terrapin_tools.web.live.session import Picture, Session
from terrapin_tools.web.live.socket import Audience
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import WHOLE, Line, problems
from terrapin_tools.web.service.models import Request as Body
from terrapin_tools.web.service.uploads import upload_file, upload_view
from terrapin_tools.web.service.workspace import NotThere, Taken, is_name

__all__ = ["begin", "end", "router"]

router = APIRouter(prefix="/api", tags=["live"])
_BUSES = "|".join(kind.name for kind in able("listen"))
SOURCE = rf"^(simulator|log|upload|{_BUSES}):[A-Za-z0-9_./:@+?=&,%-]{{1,200}}$"
_OURS = re.compile(r"(simulator|log|upload):(.*)")  # what is no bus
LOG = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,58}\.(log|blf|mf4|mcap)$"
_DEVICE = re.compile(r"/dev/[A-Za-z0-9_./-]+\Z", re.ASCII)
_CHANNEL = re.compile(r"[A-Za-z0-9_.-]{1,32}\Z", re.ASCII)
_UPLOAD = re.compile(r"[0-9a-f]{12}\Z")
CAN_DEVICES = "280"  # ARPHRD_CAN


class Link(BaseModel):
    """Something to watch: `source` is what POST /api/live takes (of kind dbc: as `dbc`)."""

    source: str
    title: str
    kind: Literal["bus", "log", "simulator", "dbc"]


class Watch(Body):
    """What to watch. `dbc`: an uploaded DBC's id, or a file in the workspace's logs folder; empty: the controller's."""

    source: Annotated[str, StringConstraints(pattern=SOURCE, max_length=220)]
    dbc: Annotated[str, StringConstraints(pattern=r"^([A-Za-z0-9][A-Za-z0-9_.-]{0,63})?$")] = ""
    speed: Annotated[float, Field(gt=0.0, le=1000.0, description="of a log: times its own pace")] = 1.0
    bitrate: Annotated[int, Field(ge=1, le=10_000_000, description="bit/s"), WHOLE] = 500_000
    controller: Literal["inprocess", "pty", "qemu"] = "inprocess"
    node: Annotated[int, Field(ge=0, lt=node_count()), WHOLE] | None = None  # of several; else the link's


class Watched(BaseModel):
    """What is being watched, if anything."""

    name: str | None
    state: str | None
    command: str | None
    recording: dict[str, Any] | None = None


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


class Command(Body):
    """`idle`: hold the stop button in; `release`: let it go; `mark`: note an event."""

    request: Literal["idle", "release", "mark"]
    text: Line = "mark"


class Done(BaseModel):
    """What was done, in words, and the command line that does the same."""

    done: str
    command: str


class _Hub:
    """The session of a server and those who watch it."""

    def __init__(self) -> None:
        self.audience = Audience()
        self.session: Session | None = None
        self.changing = asyncio.Lock()
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
                    self._loop.call_soon_threadsafe(self.audience.show, session, picture, status)

            try:
                session = await asyncio.to_thread(_open, context, body, tell)
                self.session = session
                self.audience.change(session)
            finally:
                ready.set()
            return session

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
        async with self.changing:
            await self._close()

    def _free(self) -> None:
        if self.session is not None and self.session.stop_held:
            raise Taken(f"live: the stop button of {self.session.source.name} is held in, expected it released first")

    async def _close(self) -> None:
        session, self.session = self.session, None
        if session is not None:
            self.audience.change(None)
            await asyncio.to_thread(session.close)

    def watched(self) -> Session:
        """The session; NotThere when nothing is watched."""
        if self.session is None:
            raise NotThere("live: nothing is watched, expected POST /api/live first")
        return self.session


_hubs: WeakKeyDictionary[Context, _Hub] = WeakKeyDictionary()


async def begin(context: Context) -> None:
    """When the server starts."""
    _hubs[context] = _Hub()


async def end(context: Context) -> None:
    """When it ends: the log is closed."""
    hub = _hubs.pop(context)
    await hub.close()
    hub.audience.close()


def _open(context: Context, body: Watch, tell: Any) -> Session:
    """Opens source and DBC. UserError when one of them cannot be."""
    from terrapin_hil.messages import interface
    from terrapin_hil.robots import robot_words
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.monitor.sources import Bus, LogFile, Simulator, Source

    own = paths.dbc()
    given = _stored(context, body.dbc) if body.dbc else None
    decoder = Decoder(given or own)
    ours = _OURS.fullmatch(body.source)
    kind, where = ours.groups() if ours else ("", "")
    dbc = ["--dbc", str(given)] if given is not None else []
    at_node = ["--node", str(body.node)] if body.node is not None else []
    if at_node and given is not None:
        raise UserError("node: the identifiers of a DBC are its own, expected it without dbc")
    source: Source
    rate, node = body.bitrate, body.node or 0
    if kind == "simulator":
        if at_node:
            raise UserError("node: a scenario has one controller, expected a bus or a log")
        if not is_name(where):
            raise UserError(f"source: found {where!r}, expected a scenario's name")
        source = Simulator(where, LinkName(body.controller))
        controller = ["--controller", body.controller] if body.controller != "inprocess" else []
        arguments = ["monitor", where, *controller, *dbc]
    elif kind:
        log = _stored(context, where)
        source = LogFile(log, body.speed)
        speed = ["--speed", f"{body.speed:g}"] if body.speed != 1.0 else []
        arguments = ["monitor", str(log), *speed, *at_node, *dbc]
    else:
        link = _bus(body.source, context.link).at_node(body.node)
        rate, node = link.bit_rate(body.bitrate), link.node
        source = Bus(link, rate)
        bitrate = ["--bitrate", str(body.bitrate)] if body.bitrate != 500_000 else []
        arguments = ["monitor", "--link", body.source, *bitrate, *at_node, *dbc]
    command = shlex.join(["terrapin", *arguments, *robot_words()])
    watch = body.model_dump(exclude_none=True)
    return Session(source, decoder, None if body.dbc else interface(), rate, command, tell, node, watch)


def _stored(context: Context, name: str) -> Path:
    """An upload by its id, or a file of the folder logs by its name."""
    if _UPLOAD.match(name):
        return upload_file(context.workspace, name)
    path = context.workspace.folder("logs") / name
    if not is_name(name) or not path.is_file():
        raise NotThere(f"logs: found no {name[:80]!r} in the workspace's folder logs")
    return path


def _bus(source: str, named: str) -> LinkName:
    """The bus that a source names. Devices are named, never paths to anything else; options are taken of the link that
    was `named` when the server was started, and of no other."""
    import can

    link = LinkName.parse(source, "listen")
    if link.options and source != named:
        raise UserError("source: found options, expected them in `terrapin web --link` alone; there is `bitrate`")
    if not link.interface:
        device = Path(link.channel)
        if not _DEVICE.match(link.channel) or ".." in device.parts:
            raise UserError(f"source: found {link.channel[:80]!r}, expected a serial port such as serial:/dev/ttyACM0")
        try:
            if not stat.S_ISCHR(device.stat().st_mode):
                raise UserError(f"source: {device} is no serial port", status=2)
        except OSError as error:
            raise UserError(f"source: {device}: {error.strerror}, expected a serial port") from None
    elif link.interface not in can.VALID_INTERFACES:
        raise UserError(f"source: python-can has no interface {link.interface[:40]!r}")
    elif not _CHANNEL.match(link.channel):
        raise UserError(f"source: found channel {link.channel[:80]!r}, expected a name such as can0")
    return link


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
        if _DEVICE.match(port.device):
            title = f"{port.device} {port.description if port.description != 'n/a' else ''}".strip()
            found.append(Link(source=str(LinkName("serial", channel=port.device)), title=title, kind="bus"))
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
        if not _UPLOAD.match(path.stem):
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
    return _answer(_hubs[context].session)


def _same(request: Request, body: Body | None = None) -> str:
    """The command line of the same request. TERRAPIN_TOKEN: what follows token= in the address that was printed."""
    show = '-H "Authorization: Bearer $TERRAPIN_TOKEN"'
    data = f" --json {shlex.quote(body.model_dump_json(exclude_defaults=True))}" if body is not None else ""
    return f"curl -X {request.method} {show}{data} {shlex.quote(str(request.url.replace(query='')))}"


@router.post("/live", responses=problems(404, 409, 500))
async def watch(context: Terrapin, body: Watch) -> Watched:
    """Watch something; every browser sees it. What was watched before ends, with its log; 409 while somebody holds its
    stop button in."""
    return _answer(await _hubs[context].open(context, body))


@router.delete("/live", responses=problems(409))
async def unwatch(context: Terrapin, request: Request) -> Watched:
    """Watch nothing any more; 409 while somebody holds the stop button in."""
    await _hubs[context].leave()
    return Watched(name=None, state=None, command=_same(request))


@router.post("/live/record", responses=problems(404, 409, 500))
async def record(context: Terrapin, request: Request, body: Record) -> Recorded:
    """Begin or end a log in the workspace's folder logs. It is readable up to the last half second at any moment."""
    session = _hubs[context].watched()
    if body.do == "stop":
        found = await asyncio.to_thread(session.stop_recording) or session.last_log
        if found is None:
            raise Taken("record: nothing is being recorded")
        return Recorded(**{k: found[k] for k in ("name", "frames", "bytes")}, command=_same(request, body))
    path = context.workspace.folder("logs") / body.name
    if path.exists():
        raise Taken(f"{body.name}: exists already, expected a new name")
    await asyncio.to_thread(session.record, path)
    words = shlex.split(session.command)
    link = ["--link", words[words.index("--link") + 1]] if "--link" in words else []
    command = shlex.join(["terrapin", "log", "record", str(path), *link]) if link else _same(request, body)
    return Recorded(name=body.name, frames=0, bytes=0, command=command)


@router.post("/live/command", responses=problems(404, 409, 500))
async def command(context: Terrapin, request: Request, body: Command) -> Done:
    """Stop all controllers of the bus until released, which clears the one that is watched; or note an event."""
    hub = _hubs[context]
    if body.request == "mark":
        await asyncio.to_thread(hub.watched().mark, body.text or "mark")
        done = f"marked: {body.text or 'mark'}"
    else:
        await hub.hold_stop(body.request == "idle")
        done = "stopped until released" if body.request == "idle" else "released"
    return Done(done=done, command=_same(request, body))


@router.websocket("/live/socket")
async def socket(socket: WebSocket) -> None:
    """Pictures of what is watched; see terrapin_tools/web/live/socket.py."""
    await _hubs[socket.app.state.terrapin].audience.serve(socket)
