"""Routes of uploads: measurements and DBCs on their way into a case. Streamed to disk, bounded, looked at, listed."""

from __future__ import annotations

import asyncio
import json
import secrets
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request
from pydantic import BaseModel, Field, StringConstraints
from starlette.requests import ClientDisconnect

from terrapin_tools.errors import UserError
from terrapin_tools.logs.reading import READABLE
from terrapin_tools.web.service import models
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import problems
from terrapin_tools.web.service.warm import Kind, Late
from terrapin_tools.web.service.workspace import NotThere, Workspace
from terrapin_tools.workbench.bases.kinds.names import in_letters
from terrapin_tools.workbench.files.formats import SUFFIXES as TABLES
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.new_case.options import pairs

__all__ = [
    "STREAMED", "Identifier", "NoSpace", "TooLarge", "UploadId", "keep_draft", "router",
    "upload_dbc", "upload_file", "upload_view",
]  # fmt: skip

STREAMED = ("/api/uploads",)  # the body is read, and bounded, here
MAX_UPLOAD = 2 << 30  # bytes
SPARE = 100 << 20  # bytes of the disk that stay free
PIECE = 64 << 10  # bytes that are written at a time
PIECE_SECONDS = 10.0  # in which each has to arrive: from this machine itself
LOOK_SECONDS, LOOK_PACE = 30.0, 0.5e6  # to read a file: so long, and for each LOOK_PACE bytes of it a second more
DBC_SECONDS = 10.0  # a description of a bus, whatever its size: what takes longer would stop others' work, too
SMALL = 8 << 20  # bytes; files above it wait for each other, and others do not wait for them
MOST = 1000  # uploads that are kept
PREVIEW, LOOK = "terrapin_tools.web.cases.preview:look", "terrapin_tools.workbench.intake.look:look_at"
SUITS = "terrapin_tools.web.cases.preview:suits"
BASES_SECONDS = 20.0
EVERY = 0.25  # s between events of progress
DESCRIPTIONS = (".dbc", ".arxml", ".kcd", ".sym")
SUFFIXES = tuple(dict.fromkeys((*TABLES, *DESCRIPTIONS, *READABLE)))

Identifier = Annotated[str, StringConstraints(pattern="^[0-9a-f]{12}$")]
Typed = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=2000)]
UploadId = Annotated[str, Path(pattern="^[0-9a-f]{12}$")]
Readings = Annotated[
    Sequence[Annotated[str, StringConstraints(pattern=r"^[a-z]{1,20}=[^\x00-\x1f\x7f]{1,200}$")]],
    Query(max_length=10, description="KEY=VALUE: how a table is read, as [data.read] of case.toml; repeat for more"),
]
router = APIRouter(prefix="/api", tags=["uploads"])


class TooLarge(UserError):
    """More bytes than an upload may have."""


class NoSpace(UserError):
    """The disk is full."""


class UploadColumn(BaseModel):
    """A column of a table, or MESSAGE.SIGNAL of a log, with what its name says of it."""

    name: str
    numeric: bool
    unit_guess: str = Field(description="empty when the name tells none")
    role_guess: str | None = Field(description="role or channel")
    name_guess: str = Field(default="", description="of a model with the user's own names")
    preview: list[str]
    min: float | None
    max: float | None


class DraftColumn(models.Request):
    """What is typed beside a column."""

    column: Typed
    name: Typed = Field(default="", description="role, channel or name; empty: not mapped")
    unit: Typed = ""
    sigma: Typed = ""


class Draft(models.Request):
    """A mapping that is half done, as it is typed: a reload or another browser goes on with it."""

    uploads: Annotated[list[Identifier], Field(min_length=1, max_length=100)]
    base: Typed = ""
    fields: dict[models.EffectName, Typed] = Field(default={}, max_length=20, json_schema_extra=models.CLOSED)
    columns: Annotated[list[DraftColumn], Field(default_factory=list, max_length=1000)]
    constants: dict[models.EffectName, Typed] = Field(default={}, max_length=300, json_schema_extra=models.CLOSED)


class Upload(BaseModel):
    """An uploaded file. `rows` are frames of a log, messages of a DBC."""

    id: str
    name: str
    bytes: int
    kind: Literal["csv", "parquet", "table", "log", "dbc"]
    columns: list[UploadColumn]
    rows: int
    warnings: list[str]
    run_guess: str | None
    base_guess: str | None
    created: float = Field(description="s since 1970")
    draft: Draft | None = Field(default=None, description="mapping of these columns that is half done")


def _tidy(name: str) -> str:
    """A name that a file may have here, with its suffix. UserError for a kind of file that is none of ours."""
    plain = name.replace("\\", "/").rpartition("/")[2]
    stem, dot, suffix = plain.rpartition(".")
    if not dot or f".{suffix.lower()}" not in SUFFIXES:
        raise UserError(f"name: found {plain[:80]!r}, expected a file that ends in {' '.join(SUFFIXES)}")
    tidy = "-".join(map(in_letters, stem.split("-"))).lstrip("_-")[:50] or "file"
    return f"{tidy}.{suffix.lower()}"


def upload_file(workspace: Workspace, identifier: str) -> FilePath:
    """The uploaded file; NotThere for none of that id."""
    view = upload_view(workspace, identifier)
    return workspace.folder("uploads") / identifier / str(view["name"])


def upload_dbc(workspace: Workspace, identifier: str) -> FilePath:
    """The uploaded DBC; UserError for another kind of file."""
    if upload_view(workspace, identifier)["kind"] != "dbc":
        raise UserError("dbc: found an upload that is none, expected a DBC")
    return upload_file(workspace, identifier)


def upload_view(workspace: Workspace, identifier: str) -> dict[str, Any]:
    """What is known of an upload; NotThere for none of that id."""
    file = workspace.folder("uploads") / f"{identifier}.json"
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise NotThere(f"upload: found none of id {identifier}") from None
    assert isinstance(found, dict)
    return found


BODY = {"requestBody": {"required": True, "content": {"application/octet-stream": {"schema": {"type": "string"}}}}}


@router.post("/uploads", responses=problems(507), status_code=201, openapi_extra=BODY)
async def upload(
    context: Terrapin,
    request: Request,
    name: Annotated[str, Query(min_length=1, max_length=200, description="the file's, with its suffix")],
    dbc: Annotated[str, Query(pattern="^([0-9a-f]{12})?$", description="upload of a DBC, for a log")] = "",
    read: Readings = (),
) -> Upload:
    """Send a file as it is, as the body. Nothing is kept when it is broken off, too large or no file of its kind."""
    tidy, said = _tidy(name), pairs("read", read)
    bus = str(upload_dbc(context.workspace, dbc)) if dbc else ""
    announced = _announced(request)
    await _drop_oldest(context.workspace)
    identifier = secrets.token_hex(6)
    folder = context.workspace.folder("uploads")
    part = folder / f"{identifier}.part"
    try:
        size = await _receive(context, request, part, identifier, announced)
        place = folder / identifier
        place.mkdir()
        part.replace(place / tidy)
        found = await _looked_at(context, request, place / tidy, bus, said)
        view = {"id": identifier, "name": tidy, "bytes": size, "created": time.time(), **found}
        write_whole(folder / f"{identifier}.json", json.dumps(view) + "\n")
    except BaseException:
        part.unlink(missing_ok=True)
        shutil.rmtree(folder / identifier, ignore_errors=True)
        context.events.send({"upload": identifier, "state": "failed"})
        raise
    context.events.send({"upload": identifier, "state": "done"})
    return Upload(**view)


def _announced(request: Request) -> int | None:
    length = request.headers.get("content-length")
    if length is None:
        return None
    if not (length.isascii() and length.isdigit()) or int(length[:20]) > MAX_UPLOAD:
        raise TooLarge(f"body: found more, expected at most {MAX_UPLOAD} bytes")
    return int(length)


async def _receive(context: Context, request: Request, part: FilePath, identifier: str, announced: int | None) -> int:
    """The body into `part`; its size. Written by a thread in pieces, so that others are answered meanwhile."""
    if (announced or 0) + SPARE > shutil.disk_usage(part.parent).free:
        raise NoSpace("the disk has too little space for the file")
    size, told, waiting = 0, 0.0, bytearray()
    chunks = request.stream().__aiter__()
    loop = asyncio.get_running_loop()
    with part.open("wb") as file:
        until = loop.time() + PIECE_SECONDS
        while True:
            try:
                async with asyncio.timeout_at(until):
                    chunk = await anext(chunks, None)
            except TimeoutError:
                line = f"body: found less than {PIECE} bytes in {PIECE_SECONDS:g} s, expected the rest of the file"
                raise UserError(line) from None
            except ClientDisconnect:
                raise UserError("body: the other end went away, expected the rest of the file") from None
            waiting += chunk or b""
            size += len(chunk or b"")
            if size > MAX_UPLOAD:
                raise TooLarge(f"body: found more, expected at most {MAX_UPLOAD} bytes")
            if len(waiting) >= PIECE or chunk is None:
                await asyncio.to_thread(file.write, bytes(waiting))
                waiting.clear()
                until = loop.time() + PIECE_SECONDS
                if shutil.disk_usage(part.parent).free < SPARE:
                    raise NoSpace("the disk has too little space for the file")
            if chunk is None:
                return size
            if time.monotonic() - told > EVERY:
                told = time.monotonic()
                context.events.send({"upload": identifier, "state": "receiving", "bytes": size, "of": announced})


async def _looked_at(
    context: Context, request: Request, file: FilePath, bus: str, said: dict[str, str]
) -> dict[str, Any]:
    """What is in the file. The work ends when the browser goes away."""

    def told(line: str) -> None:
        context.events.send({"upload": file.parent.name, "state": "reading", "line": line})

    look = asyncio.create_task(_look(context, file, bus, told, said=said))
    gone = asyncio.create_task(_gone(request))
    try:
        await asyncio.wait((look, gone), return_when=asyncio.FIRST_COMPLETED)
        if not look.done():
            raise UserError("the browser went away before the file was read")
        try:
            return look.result()
        except UserError as error:
            raise UserError(str(error).replace(f"{file.parent}/", ""), error.status) from None
    finally:
        for task in (look, gone):
            task.cancel()
        with suppress(asyncio.CancelledError, UserError):
            await look


async def _look(
    context: Context,
    file: FilePath,
    bus: str,
    told: Callable[[str], None] | None = None,
    by: str = PREVIEW,
    said: dict[str, str] | None = None,
) -> dict[str, Any]:
    """What is in the file, read in a process of its own and cut off when that takes too long."""
    size = file.stat().st_size
    seconds = DBC_SECONDS if file.suffix in DESCRIPTIONS else LOOK_SECONDS + size / LOOK_PACE
    kind: Kind = "read" if size <= SMALL else "read large"
    call = context.warm.call(by, str(file), bus, said or {}, seconds=seconds, told=told, kind=kind)
    try:
        found = await call
    except Late:
        raise UserError(
            f"{file.name}: found no end of it after {seconds:.0f} s of reading, expected less in it"
        ) from None
    except UserError as error:
        if error.status == 1:  # a library gave up on it, or brought its process down
            raise UserError(f"{file.name}: could not be read: {error}, expected a whole file of its kind") from None
        raise
    assert isinstance(found, dict)
    return found


async def _gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _drop_oldest(workspace: Workspace) -> None:
    folder = workspace.folder("uploads")
    kept = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)
    for path in kept[: max(0, len(kept) - MOST + 1)]:
        path.unlink(missing_ok=True)
        await asyncio.to_thread(shutil.rmtree, folder / path.stem, True)


@router.get("/uploads", responses=problems())
async def uploads(
    context: Terrapin,
    drafts: Annotated[bool, Query(description="only those of mappings that are half done")] = False,
) -> list[Upload]:
    """All uploads, newest first."""
    files = context.workspace.folder("uploads").glob("*.json")
    found = [upload_view(context.workspace, path.stem) for path in files]
    if drafts:
        wanted = {identifier for one in found if one.get("draft") for identifier in one["draft"]["uploads"]}
        found = [one for one in found if one.get("draft") or one["id"] in wanted]
    return sorted((Upload(**one) for one in found), key=lambda one: -one.created)


@router.get("/uploads/{identifier}/preview", responses=problems(404))
async def preview(
    context: Terrapin,
    identifier: UploadId,
    dbc: Annotated[str, Query(pattern="^([0-9a-f]{12})?$", description="upload of a DBC, for a log")] = "",
    read: Readings = (),
) -> Upload:
    """An upload as it was looked at; with `dbc` a log is looked at again, with that DBC; with `read` a table."""
    view, said = upload_view(context.workspace, identifier), pairs("read", read)
    if dbc and view["kind"] != "log":
        raise UserError(f"dbc: found with {view['name']}, expected with a log")
    if said and view["kind"] in ("log", "dbc"):
        raise UserError(f"read: found with {view['name']}, expected with a table")
    if dbc or said:
        bus = str(upload_dbc(context.workspace, dbc)) if dbc else ""
        view |= await _look(context, upload_file(context.workspace, identifier), bus, said=said)
    return Upload(**view)


class Suiting(BaseModel):
    """The base model that a table suits best, and what is said of it and of others. "": something is left open."""

    base: str
    lines: list[str]


@router.get("/uploads/{identifier}/bases", responses=problems(404))
async def bases(context: Terrapin, identifier: UploadId, read: Readings = ()) -> Suiting:
    """Base models that an uploaded table suits, each fitted briefly, as `terrapin case table` says it."""
    view, file = upload_view(context.workspace, identifier), upload_file(context.workspace, identifier)
    if view["kind"] in ("log", "dbc"):
        raise UserError(f"bases: found {view['name']}, expected a table")
    call = context.warm.call(SUITS, str(file), pairs("read", read), seconds=BASES_SECONDS, kind="read")
    try:
        found = await call
    except Late:
        raise UserError(f"{view['name']}: brief fits found no end within {BASES_SECONDS:.0f} s") from None
    return Suiting(**found)


class Looked(BaseModel):
    """What a file holds, as `terrapin look` prints it."""

    lines: list[str]


@router.get("/uploads/{identifier}/look", responses=problems(404))
async def look(
    context: Terrapin,
    identifier: UploadId,
    dbc: Annotated[str, Query(pattern="^([0-9a-f]{12})?$", description="upload of a DBC, for a log")] = "",
    read: Readings = (),
) -> Looked:
    """Columns, rate, gaps, steps, saturation, candidates for runs and steady states of an upload."""
    said = pairs("read", read)
    view = upload_view(context.workspace, identifier)
    if view["kind"] == "dbc":
        raise UserError(f"{view['name']}: describes a bus, expected measurements")
    bus = str(upload_dbc(context.workspace, dbc)) if dbc else ""
    found = await _look(context, upload_file(context.workspace, identifier), bus, by=LOOK, said=said)
    return Looked(lines=found["lines"])


def keep_draft(context: Context, identifier: str, draft: Draft | None) -> None:
    """Write a draft into the upload's record, or drop it; nothing for an upload that is gone."""
    try:
        view = upload_view(context.workspace, identifier)
    except NotThere:
        return
    if draft is None and not view.get("draft"):
        return
    view["draft"] = draft.model_dump() if draft is not None else None
    write_whole(context.workspace.folder("uploads") / f"{identifier}.json", json.dumps(view) + "\n")
    context.events.send({"upload": identifier, "state": "draft" if draft is not None else "mapped"})


@router.put("/uploads/{identifier}/draft", responses=problems(404))
async def put_draft(context: Terrapin, identifier: UploadId, body: Draft) -> Draft:
    """Keep a mapping that is half done with the (first) upload that it is about."""
    upload_view(context.workspace, identifier)
    keep_draft(context, identifier, body)
    return body


@router.delete("/uploads/{identifier}", responses=problems(404))
async def delete(context: Terrapin, identifier: UploadId) -> Upload:
    """Delete an upload; cases made of it keep their copy."""
    view = upload_view(context.workspace, identifier)
    folder = context.workspace.folder("uploads")
    (folder / f"{identifier}.json").unlink(missing_ok=True)
    await asyncio.to_thread(shutil.rmtree, folder / identifier, True)
    return Upload(**view)
