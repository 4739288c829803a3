"""POST /api/cases: a case from uploads, columns mapped, constants given."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, Field, FiniteFloat, StringConstraints

from terrapin_tools.errors import UserError
from terrapin_tools.web.cases.mapping import keep_mapping, mapping_of
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.jobs import Job, for_a_shell
from terrapin_tools.web.service.models import (
    CLOSED,
    WHOLE,
    EffectName,
    Formula,
    JobStarted,
    Line,
    Name,
    Named,
    Parameter,
    Request,
    problems,
)
from terrapin_tools.web.service.uploads import Identifier, keep_draft, upload_dbc, upload_file, upload_view
from terrapin_tools.web.service.workspace import Taken
from terrapin_tools.workbench.new_case.options import arguments

__all__ = ["router"]

router = APIRouter(prefix="/api", tags=["cases"])
Words = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]+$", max_length=100)]
Quantity = FiniteFloat | Words
Key = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$")]


class MappedColumn(Request):
    """One line of [data.columns]."""

    column: Line
    unit: Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=100)] = ""
    sigma: Annotated[FiniteFloat, Field(gt=0)] | Words | None = Field(
        default=None, description="sd of a row, in `unit` or with its own"
    )


class Limit(Request):
    """What the rig can set."""

    min: Quantity
    max: Quantity
    unit: Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=100)] = ""


class State(Request):
    """One line of [model.states]."""

    initial: FiniteFloat | Key = Field(default="fit", description="a number in `unit`, `fit` or the name of a column")
    unit: Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=100)] = ""


class NewCase(Request):
    """What case.toml says (docs/cases.md), with uploads for files."""

    name: Name
    title: Line = ""
    base: Key
    effects: Annotated[list[EffectName], Field(default_factory=list, max_length=20)]
    uploads: Annotated[list[Identifier], Field(min_length=1, max_length=100)]
    dbc: Identifier | None = Field(
        default=None, description="upload of a DBC; a log without one takes the controller's"
    )
    period: Quantity = Field(default="10 ms", description="of the grid that a log is sampled on")
    every: Annotated[int, Field(ge=1, le=1_000_000, description="take every n-th row of a table"), WHOLE] = 1
    run: Line = Field(default="", description="column that names the run; empty: each file is one")
    train: Annotated[list[Line], Field(default_factory=list, max_length=10_000)]
    test: Annotated[list[Line], Field(default_factory=list, max_length=10_000)]
    read: dict[Key, Line] = Field(
        default={}, max_length=10, json_schema_extra=CLOSED, description="how the files are read: [data.read]"
    )
    columns: dict[Key, MappedColumn] = Field(min_length=1, max_length=200, json_schema_extra=CLOSED)
    equation: dict[Key, Formula] = Field(default={}, max_length=20, json_schema_extra=CLOSED)
    states: dict[Key, State] = Field(
        default={}, max_length=8, json_schema_extra=CLOSED, description="of the base model ode, as are the next two"
    )
    derivative: dict[Key, Formula] = Field(default={}, max_length=8, json_schema_extra=CLOSED)
    measured: dict[Key, Formula] = Field(default={}, max_length=20, json_schema_extra=CLOSED)
    parameters: dict[Key, Quantity | bool] = Field(default={}, max_length=200, json_schema_extra=CLOSED)
    fit: dict[Key, Parameter] = Field(
        default={}, max_length=100, json_schema_extra=CLOSED, description="`unit` for equation and ode only"
    )
    limits: dict[Key, Limit] = Field(default={}, max_length=50, json_schema_extra=CLOSED)


class CommandLine(BaseModel):
    """What to type in a shell."""

    command: str


@router.post("/command", responses=problems(404))
async def command(context: Terrapin, body: NewCase) -> CommandLine:
    """The command line that would make the case of POST /api/cases. Nothing is written."""
    return CommandLine(command=for_a_shell(_step(context, body)))


@router.post("/cases", responses=problems(404, 409), status_code=202)
async def new_case(context: Terrapin, body: NewCase) -> JobStarted:
    """Make a case of uploaded files, as a job. It is read before it is kept: what is wrong is the job's error."""
    target = context.workspace.new_case(body.name)
    if context.jobs.busy(body.name):
        raise Taken(f"case: {body.name!r} is being made, expected a new name")

    async def made(job: Job) -> None:
        keep_mapping(target, body.uploads, upload_view(context.workspace, body.uploads[0]).get("draft"))
        for identifier in body.uploads:
            keep_draft(context, identifier, None)
        context.events.send({"cases": True})

    job = context.jobs.add("make", body.name, [_step(context, body)], done=made, fresh=target)
    return JobStarted(id=job.id, command=job.command)


@router.post("/cases/{name}/unmap", responses=problems(404, 409))
async def unmap(context: Terrapin, name: Name) -> Named:
    """Take back the making of a case whose other changes are undone: it goes, and its mapping is half done again, as it
    was typed. 409 where nothing is kept of the mapping, or a change stands."""
    folder = context.workspace.case(name)
    if context.jobs.busy(name):
        raise Taken(f"case: a job works on {name!r}, expected it cancelled or ended")
    mapping = await asyncio.to_thread(mapping_of, context, folder)
    if mapping is None:
        raise Taken(f"case: {name!r} has changes or was not mapped here, expected one as it was made of uploads")
    await asyncio.to_thread(context.workspace.delete_case, name)
    context.jobs.forget(name)
    keep_draft(context, mapping.uploads[0], mapping)
    context.events.send({"case": name, "deleted": True})
    context.events.send({"cases": True})
    return Named(name=name)


def _step(context: Context, body: NewCase) -> list[str]:
    """The command line, without `terrapin`."""
    workspace = context.workspace
    kinds = {identifier: upload_view(workspace, identifier)["kind"] for identifier in body.uploads}
    if "dbc" in kinds.values():
        raise UserError("uploads: found a DBC, expected it as dbc")
    dbc = str(upload_dbc(workspace, body.dbc)) if body.dbc is not None else ""
    if len(kinds) < len(body.uploads):
        raise UserError("uploads: found one twice, expected each once")
    files = [str(upload_file(workspace, identifier)) for identifier in body.uploads]
    order = {**body.model_dump(), "title": body.title or body.name}
    target = workspace.folder("cases") / body.name
    command, *words = arguments(order, files, dbc, str(target))
    return [command, "map", *words, "--json", "-"]
