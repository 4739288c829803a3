"""What can be watched, by its name: a bus, a log, the simulator, a robot that the server lets live; and opening it."""

from __future__ import annotations

import re
import shlex
import stat
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from terrapin_hil import paths
from terrapin_hil.links.names import BIT_RATE, LinkName, able
from terrapin_hil.nodes import node_count
from terrapin_tools.errors import UserError
from terrapin_tools.web.live.robot import SimulatedRobot
from terrapin_tools.web.live.session import Session
from terrapin_tools.web.service.context import Context
from terrapin_tools.web.service.models import WHOLE, Request
from terrapin_tools.web.service.uploads import upload_file
from terrapin_tools.web.service.workspace import NotThere, is_name

__all__ = ["DEVICE", "UPLOAD", "Watch", "opened"]

_BUSES = "|".join(kind.name for kind in able("listen"))
SOURCE = rf"^(simulator|robot|log|upload|{_BUSES}):[A-Za-z0-9_./:@+?=&,%-]{{1,200}}$"
_OURS = re.compile(r"(simulator|robot|log|upload):(.*)")  # what is no bus
DEVICE = re.compile(r"/dev/[A-Za-z0-9_./-]+\Z", re.ASCII)
_CHANNEL = re.compile(r"[A-Za-z0-9_.-]{1,32}\Z", re.ASCII)
UPLOAD = re.compile(r"[0-9a-f]{12}\Z")


class Watch(Request):
    """What to watch. `dbc`: an uploaded DBC's id, or a file in the workspace's logs folder; empty: the controller's."""

    source: Annotated[str, StringConstraints(pattern=SOURCE, max_length=220)]
    dbc: Annotated[str, StringConstraints(pattern=r"^([A-Za-z0-9][A-Za-z0-9_.-]{0,63})?$")] = ""
    speed: Annotated[float, Field(gt=0.0, le=1000.0, description="of a log: times its own pace")] = 1.0
    bitrate: Annotated[int, Field(ge=1, le=10_000_000, description="bit/s"), WHOLE] = 500_000
    controller: Literal["inprocess", "pty", "qemu"] = "inprocess"
    node: Annotated[int, Field(ge=0, lt=node_count()), WHOLE] | None = None  # of several; else the link's


def opened(context: Context, body: Watch, tell: Any) -> Session:
    """The session of what is to be watched. UserError when source or DBC cannot be opened."""
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
    rate, node, key = body.bitrate, body.node or 0, None
    if kind == "simulator":
        if at_node:
            raise UserError("node: a scenario has one controller, expected a bus or a log")
        if not is_name(where):
            raise UserError(f"source: found {where!r}, expected a scenario's name")
        source = Simulator(where, LinkName(body.controller))
        controller = ["--controller", body.controller] if body.controller != "inprocess" else []
        arguments = ["monitor", where, *controller, *dbc]
    elif kind == "robot":
        if at_node or given is not None:
            raise UserError("source: a simulated robot is node 0 and has its own DBC, expected neither node nor dbc")
        if where not in ("floor", *(path.stem for path in paths.SCENARIOS.glob("*.toml"))):
            raise UserError(f"source: found {where!r}, expected robot:floor, or robot: and a scenario's name")
        words = [where] if where != "floor" else []
        robot = SimulatedRobot([*words, *robot_words()])
        source, rate = robot, BIT_RATE
        arguments = ["sim", *words]
    elif kind:
        log = _stored(context, where)
        source = LogFile(log, body.speed)
        speed = ["--speed", f"{body.speed:g}"] if body.speed != 1.0 else []
        arguments = ["monitor", str(log), *speed, *at_node, *dbc]
    else:
        link = _bus(body.source, context.link).at_node(body.node)
        rate, node = link.bit_rate(body.bitrate), link.node
        source = Bus(link, rate)
        key = context.bus.key if body.source == context.link else None
        bitrate = ["--bitrate", str(body.bitrate)] if body.bitrate != 500_000 else []
        arguments = ["monitor", "--link", body.source, *bitrate, *at_node, *dbc]
    command = shlex.join(["terrapin", *arguments, *robot_words()])
    watch = body.model_dump(exclude_none=True)
    return Session(source, decoder, None if body.dbc else interface(), rate, command, tell, node, watch, key)


def _stored(context: Context, name: str) -> Path:
    """An upload by its id, or a file of the folder logs by its name."""
    if UPLOAD.match(name):
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
        if not DEVICE.match(link.channel) or ".." in device.parts:
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
