"""The route that puts a signed image on the controller that is watched, as a job that has its link meanwhile."""

from __future__ import annotations

import asyncio
import base64
import binascii
import shlex
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter
from pydantic import Field, StringConstraints

from terrapin_hil.links.names import LinkName
from terrapin_tools.errors import UserError
from terrapin_tools.web.live.hub import hubs
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import JobStarted, problems
from terrapin_tools.web.service.models import Request as Body
from terrapin_tools.web.service.workspace import Taken

__all__ = ["router"]

router = APIRouter(prefix="/api", tags=["live"])
IMAGE = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,58}\.bin$"
MOST = 240_000  # characters: a slot has 128 kB, four characters stand for three bytes


class Image(Body):
    """A signed image (`terrapin image sign`): the file's name, and its bytes as base64."""

    name: Annotated[str, StringConstraints(pattern=IMAGE)]
    data: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9+/]*={0,2}$", max_length=MOST)]


class Flash(Body):
    """Images for the slots of one controller; that of the slot that is not in use is taken."""

    images: Annotated[list[Image], Field(min_length=1, max_length=2)]


@router.post("/live/flash", responses=problems(404, 409, 500), status_code=202)
async def flash(context: Terrapin, body: Flash) -> JobStarted:
    """Put an image on the controller that is watched, as `terrapin flash` does. 409 while a page drives it or holds its
    stop in. Nothing is watched until the job has ended, whatever its end; then the same is again."""
    hub = hubs[context]
    session = hub.watched()
    if session.kind != "bus" or session.controls is None:
        raise Taken("what is watched has no boot loader to flash, expected a bus with a controller")
    paths = await asyncio.to_thread(_keep, context.workspace.folder("images"), body.images)
    step = ["flash", *map(str, paths), *_link(context, session.command)]
    job = await hub.lend(context, lambda: context.jobs.add("flash", None, [step]))
    return JobStarted(id=job.id, command=job.command)


def _keep(folder: Path, images: list[Image]) -> list[Path]:
    """Their files. UserError for what is no base64."""
    found = []
    for image in images:
        path = folder / image.name
        try:
            path.write_bytes(base64.b64decode(image.data, validate=True))
        except binascii.Error as error:
            raise UserError(f"{image.name}: {error}, expected base64") from None
        found.append(path)
    return list(dict.fromkeys(found))


def _link(context: Context, command: str) -> list[str]:
    """The options of `terrapin flash` for the link that `terrapin monitor` named."""
    words = shlex.split(command)
    given: dict[str, str] = {
        name: words[words.index(name) + 1] for name in ("--link", "--bitrate", "--node") if name in words
    }
    if LinkName.parse(given["--link"], "update").kind != "can":  # a port has its own, a system's bus too
        given.pop("--bitrate", None)
    if context.bus.key_file is not None and given["--link"] == context.link:
        given["--link-key"] = str(context.bus.key_file)
    return [word for option in given.items() for word in option]
