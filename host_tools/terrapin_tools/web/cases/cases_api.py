"""Routes about cases, examples, effects and base models."""

from __future__ import annotations

import asyncio
import re
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse

from terrapin_hil import paths
from terrapin_hil.nodes import node_count
from terrapin_tools import __version__
from terrapin_tools.web.service import models
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import Name, problems
from terrapin_tools.web.service.workspace import NAME, NotThere, Taken

__all__ = ["router"]

router = APIRouter(prefix="/api", tags=["cases"])
AT_ONCE = 100  # cases that are read with one request, whose size is bounded
REPORT_POLICY = (  # the report is one page with its scripts inside: alone in a sandbox, without a way to this server
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; font-src data:"
)


class _Index:
    """Lines of the list of cases, read again only when a file of the case has changed."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[tuple[Any, ...], dict[str, Any]]] = {}

    async def lines(self, context: Terrapin) -> list[dict[str, Any]]:
        names = context.workspace.names()
        folders = {name: context.workspace.folder("cases") / name for name in names}
        states = {name: _state(folder) for name, folder in folders.items()}
        new = [n for n in names if self._known.get(folders[n], (None,))[0] != states[n]]
        if new:
            for some in (new[i : i + AT_ONCE] for i in range(0, len(new), AT_ONCE)):
                found = await context.warm.call(
                    "terrapin_tools.web.cases.summary:summaries", [str(folders[n]) for n in some]
                )
                for name, line in zip(some, found, strict=True):
                    self._known[folders[name]] = (states[name], line)
        for gone in self._known.keys() - set(folders.values()):
            del self._known[gone]
        return [
            {"name": name, "changed": _changed(states[name]), **self._known[folders[name]][1]}
            for name in names
            if folders[name] in self._known
        ]


def _state(folder: Path) -> tuple[Any, ...]:
    """Names, sizes and times of a case's files."""
    found = []
    for path in [*folder.iterdir(), *(folder / ".terrapin").glob("*")] if folder.is_dir() else []:
        try:
            stat = path.stat()
        except OSError:  # gone meanwhile
            continue
        found.append((path.name, stat.st_size, stat.st_mtime_ns))
    return tuple(sorted(found))


def _changed(state: tuple[Any, ...]) -> float:
    return max((time for _, _, time in state), default=0) / 1e9


_index = _Index()


@router.get("/status", responses=problems())
async def status(context: Terrapin) -> models.Status:
    """The server and its workspace."""
    workspace = context.workspace
    return models.Status(
        version=__version__,
        workspace=str(workspace.root),
        cases=len(workspace.names()),
        jobs_running=context.jobs.running(),
        link=context.link,
        nodes=node_count(),
    )


@router.get("/cases", responses=problems())
async def cases(context: Terrapin) -> list[models.CaseSummary]:
    """All cases of the workspace, by name."""
    return [models.CaseSummary(**line) for line in await _index.lines(context)]


@router.get("/cases/{name}", responses=problems(404))
async def case(context: Terrapin, name: Name) -> models.CaseDetail:
    """A case in full; 422 says what is wrong with a broken one."""
    folder = context.workspace.case(name)
    found = await context.warm.call("terrapin_tools.web.cases.summary:detail", str(folder))
    return models.CaseDetail(name=name, **found)


@router.delete("/cases/{name}", responses=problems(404, 409))
async def delete_case(context: Terrapin, name: Name) -> models.Named:
    """Delete a case; 409 while a job works on it."""
    context.workspace.case(name)
    if context.jobs.busy(name):
        raise Taken(f"case: a job works on {name!r}, expected it cancelled or ended")
    await asyncio.to_thread(context.workspace.delete_case, name)
    context.jobs.forget(name)
    context.events.send({"case": name, "deleted": True})
    context.events.send({"cases": True})
    return models.Named(name=name)


def _written(context: Context, name: str, job: str, suffix: str) -> Path:
    """The file that the last such job wrote about a case."""
    context.workspace.case(name)
    path = context.workspace.folder(f"{job}s") / f"{name}{suffix}"
    if not path.is_file():
        raise NotThere(f"{job}: found none of {name!r}, expected a job {job} first")
    return path


@router.get("/cases/{name}/report", responses=problems(404), response_class=FileResponse)
async def report(context: Terrapin, name: Name) -> FileResponse:
    """The page that the last report job wrote."""
    path = _written(context, name, "report", ".html")
    return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})


@router.get("/cases/{name}/export", responses=problems(404), response_class=FileResponse)
async def export(context: Terrapin, name: Name) -> FileResponse:
    """The controller's parameters that the last export job wrote, as TOML."""
    path = _written(context, name, "export", ".toml")
    return FileResponse(path, media_type="text/plain", filename=path.name)


@router.get("/examples", responses=problems())
async def list_examples() -> list[models.Example]:
    """Cases that ship with the project and that the workbench can open."""
    return [models.Example(name=name, title=title, about=about) for name, (title, about) in _titles().items()]


@router.get("/examples/{name}/picture", responses=problems(404))
async def example_picture(context: Terrapin, name: Name) -> dict[str, Any]:
    """A small picture of an example: measured and predicted values of its first channel."""
    if name not in _titles():
        raise NotThere(f"example: found no {name!r}, expected one of {', '.join(_titles())}")
    if name not in _pictures:
        folder = str(paths.examples()[name])
        _pictures[name] = await context.warm.call("terrapin_tools.web.cases.view:thumbnail", folder, seconds=60.0)
    return _pictures[name]


@router.post("/examples/{name}", responses=problems(404, 409))
async def open_example(context: Terrapin, name: Name) -> models.Named:
    """Copy an example into the workspace, if it is not there yet."""
    if name not in _titles():
        raise NotThere(f"example: found no {name!r}, expected one of {', '.join(_titles())}")
    if context.jobs.busy(name):
        raise Taken(f"case: a job works on {name!r}, expected it cancelled or ended")
    if await asyncio.to_thread(context.workspace.open_example, name):
        context.events.send({"cases": True})
    return models.Named(name=name)


_pictures: dict[str, dict[str, Any]] = {}  # of the examples, which do not change


def _titles() -> dict[str, tuple[str, str]]:
    """Name -> title, and the sentence with which case.toml begins."""
    import tomllib

    found = {}
    for name, folder in paths.examples().items():
        text = (folder / "case.toml").read_text(encoding="utf-8")
        document = tomllib.loads(text)
        if document["model"]["base"] != "driven_wheel":  # terrapin soil tactile reads it
            found[name] = document["case"]["title"], _about(text)
    return found


def _about(text: str) -> str:
    """The first sentence of the comment at the top of a case.toml.

    >>> _about("# A motor that warms. Try\\n#   this\\n[case]"), _about("# By Li et al. in Eqs. (1).\\n[case]")
    ('A motor that warms.', 'By Li et al. in Eqs. (1).')
    """
    lines = list(takewhile(lambda line: line.startswith("# "), text.splitlines()))
    text = " ".join(line[2:].strip() for line in lines)
    return f"{re.split(r'(?<! al)(?<!Eqs)(?<!Fig)[.](?: |$)', text)[0]}." if lines else ""


@router.get("/bases", responses=problems())
async def bases(context: Terrapin) -> list[models.Base]:
    """The base models: what the mapper can map, and what it has to ask for."""
    return [models.Base(**one) for one in await context.warm.call("terrapin_tools.web.cases.summary:bases")]


@router.get("/effects", responses=problems(404))
async def effects(
    context: Terrapin,
    base: Annotated[str, Query(max_length=64, description="only what acts on this base model")] = "",
    case: Annotated[
        str, Query(max_length=64, pattern=f"^$|{NAME}", description="also the effects that this case brings")
    ] = "",
) -> list[models.Effect]:
    """The catalogue of effects and one's own, with equations as MathML."""
    folder = str(context.workspace.case(case)) if case else ""
    return [
        models.Effect(**one)
        for one in await context.warm.call("terrapin_tools.web.cases.summary:effects", base, folder)
    ]


@router.post("/expression", responses=problems(404))
async def expression(context: Terrapin, body: models.ExpressionRequest) -> models.ExpressionAnswer:
    """Whether an expression of one's own could be added to a case: names, units, target. Nothing is written."""
    folder = context.workspace.case(body.case)
    parameters = {name: entry.model_dump() for name, entry in body.parameters.items()}
    found = await context.warm.call(
        "terrapin_tools.web.cases.summary:check_expression",
        str(folder),
        body.expression,
        body.target,
        parameters,
        seconds=20.0,
    )
    return models.ExpressionAnswer(**found)
