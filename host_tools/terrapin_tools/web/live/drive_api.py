"""Routes that act on what is watched: stop, clear, arm; parameters; a simulated robot's ground; moving in a log."""

from __future__ import annotations

import asyncio
import shlex
from contextlib import suppress
from typing import Annotated, Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field, FiniteFloat, StringConstraints

from terrapin_hil.messages import interface
from terrapin_tools.errors import UserError
from terrapin_tools.param.files import text_of
from terrapin_tools.web.live.hub import Hub, hubs
from terrapin_tools.web.live.robot import CHANGES, SimulatedRobot
from terrapin_tools.web.service.context import Terrapin
from terrapin_tools.web.service.models import Line, problems
from terrapin_tools.web.service.models import Request as Body
from terrapin_tools.web.service.workspace import Taken

__all__ = ["router", "same"]

router = APIRouter(prefix="/api", tags=["live"])


class Command(Body):
    """`idle`: hold the stop button in; `release`: let it go; `mark`: note an event; `clear`: end latched faults whose
    cause is gone; `arm`, `disarm`: the page `page` (its websocket's hello says it) drives, or does so no more."""

    request: Literal["idle", "release", "mark", "clear", "arm", "disarm"]
    text: Line = "mark"
    page: Annotated[str, StringConstraints(pattern=r"^([0-9a-f]{16})?$")] = ""


class Done(BaseModel):
    """What was done, in words, and the command line that does the same."""

    done: str
    command: str


class Replay(Body):
    """Where in a log to go on [s], how fast, and whether it begins anew at its end; what is absent stays as it is."""

    position: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    speed: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    loop: bool | None = None


class Change(Body):
    """A change to the simulated robot, as `terrapin sim --do` takes it: `ground = sand`."""

    change: Annotated[str, StringConstraints(pattern=rf"^({'|'.join(CHANGES)}) = [A-Za-z0-9_. /+-]{{1,60}}$")]


class Setting(BaseModel):
    """A parameter as it stands in the controller, in its unit, with its range and what the firmware begins with."""

    name: str
    value: float
    text: str
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    protects: str


class Settings(BaseModel):
    """All parameters of the controller that is watched."""

    parameters: list[Setting]
    command: str


class Write(Body):
    """Write one parameter, in its unit, until the next reset; or keep what stands, or put all to their defaults."""

    do: Literal["write", "save", "defaults"] = "write"
    name: Annotated[str, StringConstraints(pattern=r"^[a-z0-9_]{0,40}$")] = ""
    value: FiniteFloat = 0.0


def same(request: Request, body: Body | None = None) -> str:
    """The command line of the same request. TERRAPIN_TOKEN: what follows token= in the address that was printed."""
    show = '-H "Authorization: Bearer $TERRAPIN_TOKEN"'
    data = f" --json {shlex.quote(body.model_dump_json(exclude_defaults=True))}" if body is not None else ""
    return f"curl -X {request.method} {show}{data} {shlex.quote(str(request.url.replace(query='')))}"


@router.post("/live/command", responses=problems(404, 409, 500))
async def command(context: Terrapin, request: Request, body: Command) -> Done:
    """Stop all controllers of the bus until released, which clears the one that is watched; clear it; note an event;
    arm a page, which then drives by the beats that it sends over its websocket, or disarm it."""
    hub = hubs[context]
    match body.request:
        case "mark":
            await asyncio.to_thread(hub.watched().mark, body.text or "mark")
            done = f"marked: {body.text or 'mark'}"
        case "idle" | "release":
            controls = hub.watched().controls
            if body.request == "release" and controls is not None and controls.keyed:
                with suppress(OSError):  # letting go needs no key, clearing does
                    await asyncio.to_thread(controls.secure)
            await hub.hold_stop(body.request == "idle")
            done = "stopped until released" if body.request == "idle" else "released"
        case "clear":
            driven = hub.watched().driven
            await asyncio.to_thread(driven.secure)
            driven.clear()
            done = "told clear"
        case _:
            done = await _arm(hub, body)
    return Done(done=done, command=same(request, body))


async def _arm(hub: Hub, body: Command) -> str:
    controls = hub.watched().driven
    if not hub.audience.is_open(body.page):
        raise Taken("arm: no page of that name looks at what is watched, expected one that does")
    if body.request == "arm":
        await asyncio.to_thread(controls.secure)
        controls.arm(body.page)
        return "armed; commands go out while this page is heard"
    controls.disarm(body.page)
    return "halting, then disarmed"


@router.post("/live/replay", responses=problems(404, 409, 500))
async def replay(context: Terrapin, request: Request, body: Replay) -> Done:
    """Move in the log that is watched, or change how it is played; every page sees the same."""
    await asyncio.to_thread(hubs[context].watched().replay, body.position, body.speed, body.loop)
    return Done(done="playing", command=same(request, body))


@router.post("/live/robot", responses=problems(404, 409, 500))
async def robot(context: Terrapin, body: Change) -> Done:
    """Change the ground, slope, supply or tow of the simulated robot that lives."""
    source = hubs[context].watched().source
    if not isinstance(source, SimulatedRobot):
        raise Taken("what is watched is no simulated robot, expected robot:floor watched first")
    done = await asyncio.to_thread(source.change, body.change)
    return Done(done=done, command=shlex.join(["terrapin", "sim", "--do", body.change, "--on", source.bus]))


def _settings(hub: Hub) -> list[Setting]:
    found = hub.watched().driven.values()
    return [
        Setting(
            name=name,
            value=raw * p.scale,
            text=text_of(p, raw),
            unit="" if p.unit == "1" else p.unit,
            low=p.minimum * p.scale,
            high=p.maximum * p.scale,
            default=p.default * p.scale,
            meaning=p.meaning,
            protects=p.protects,
        )
        for name, raw in found.items()
        for p in (interface().parameters[name],)
    ]


@router.get("/live/parameters", responses=problems(404, 409, 500))
async def parameters(context: Terrapin) -> Settings:
    """Ask the controller that is watched for all its parameters."""
    hub = hubs[context]
    found = await asyncio.to_thread(_settings, hub)
    return Settings(parameters=found, command=_words(hub, "list"))


def _words(hub: Hub, *words: str) -> str:
    link = hub.watched().source.name
    return shlex.join(["terrapin", "param", *words, "--link", link])


@router.post("/live/parameters", responses=problems(404, 409, 500))
async def write(context: Terrapin, body: Write) -> Done:
    """Write a parameter (in its unit), keep what stands, or put all to their defaults. The controller refuses it while
    its bridge is on, and says so."""
    hub = hubs[context]
    controls = hub.watched().driven
    await asyncio.to_thread(controls.secure)
    talk = controls.parameters
    if body.do == "save":
        await asyncio.to_thread(talk.save)
        return Done(done="kept in the controller's flash", command=_words(hub, "save"))
    if body.do == "defaults":
        await asyncio.to_thread(talk.defaults)
        return Done(done="all parameters are at their defaults, until saved", command=_words(hub, "defaults"))
    if not body.name:
        raise UserError("name: found nothing, expected a parameter's name")
    parameter = interface().parameter(body.name)
    raw = parameter.raw(body.value)
    await asyncio.to_thread(talk.set, parameter, raw)
    words = f"{body.name} is {text_of(parameter, raw)} {parameter.unit}".removesuffix(" 1")
    return Done(
        done=f"{words} until the next reset", command=_words(hub, "set", f"{body.name}={text_of(parameter, raw)}")
    )
