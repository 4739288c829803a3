"""Routes of batches: a scenario with many seeds and values as a job, and how far it has come.

A batch is a folder of `terrapin batch`; while it fills, its progress.json says what is done.
"""

from __future__ import annotations

import asyncio
import json
import re
import shutil
from pathlib import Path as FilePath
from typing import Annotated, Any

import tomlkit
from fastapi import APIRouter, Path
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from terrapin_hil import paths
from terrapin_tools.batch.design import design, read_seeds, read_varied
from terrapin_tools.errors import UserError
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import Line, Name, Named, problems
from terrapin_tools.web.service.workspace import NotThere, Taken
from terrapin_tools.web.simulate.simulate_api import Simulate, Started, changed_scenario, new_folder

__all__ = ["router"]

router = APIRouter(prefix="/api", tags=["simulate"])
MOST_BATCHES = 200
MOST_RUNS = 100_000
REPORT_POLICY = "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'"


class Batch(Simulate):
    """A batch of a shipped scenario with changes: seeds, and fields with values as `terrapin batch` reads them."""

    seeds: Annotated[Line, Field(min_length=1, description="1:1000, or 1,5,9")] = "1:100"
    vary: Annotated[list[Line], Field(default_factory=list, max_length=8, description="path.1.slope=0deg:14deg")]
    until_failed: bool = False


class BatchStarted(BaseModel):
    """The batch `batch` has been queued as the job `id`."""

    id: str
    batch: str
    command: str


class BatchLine(BaseModel):
    """A batch in the workspace."""

    name: str
    done: int
    failed: int
    runs: int
    complete: bool
    report: bool
    changed: float


@router.post("/batches", responses=problems(404, 409), status_code=202)
async def start(context: Terrapin, body: Batch) -> BatchStarted:
    """Run a batch as a job; its folder fills as it goes on."""
    shipped = paths.SCENARIOS / f"{body.scenario}.toml"
    if not shipped.is_file():
        raise NotThere(f"scenario: found no {body.scenario!r}")
    name, step = await asyncio.to_thread(_prepare, context.workspace.folder("batches"), shipped, body)
    try:
        job = context.jobs.add("batch", None, [step])
    except (UserError, OSError):
        (context.workspace.folder("batches") / f"{name}.toml").unlink(missing_ok=True)
        raise
    return BatchStarted(id=job.id, batch=name, command=job.command)


def _prepare(folder: FilePath, shipped: FilePath, body: Batch) -> tuple[str, list[str]]:
    """The batch's name, its scenario's file beside its folder if it was changed, and the command line."""
    from terrapin_hil.scenario.scenario import load_scenario

    varied = [read_varied(text) for text in body.vary]
    seeds = read_seeds(body.seeds)
    if len(seeds) > MOST_RUNS or sum(1 for _ in design(seeds, varied)) > MOST_RUNS:
        raise UserError(f"seeds: expected at most {MOST_RUNS} runs here; `terrapin batch` takes more")
    if sum(1 for path in folder.iterdir() if path.is_dir()) >= MOST_BATCHES:
        raise Taken(f"batches: found {MOST_BATCHES}, expected some of them removed")
    number = 1
    while any((folder / f"{shipped.stem[:56]}-{number}{end}").exists() for end in ("", ".toml")):
        number += 1
    name = f"{shipped.stem[:56]}-{number}"
    source = shipped.read_text(encoding="utf-8")
    file = folder / f"{name}.toml"
    try:
        file.write_text(changed_scenario(source, body), encoding="utf-8")
        load_scenario(file)
    except UserError as error:
        file.unlink()
        raise UserError(str(error).replace(f"{folder}/", "")) from None
    except OSError:
        file.unlink(missing_ok=True)
        raise
    vary = [word for text in body.vary for word in ("--vary", text)]
    until = ["--until", "FAIL"] if body.until_failed else []
    return name, ["batch", str(file), "--seeds", body.seeds, *vary, *until, "--out", str(folder / name), "--json"]


def _batch(context: Context, name: str) -> FilePath:
    return context.workspace.result("batches", "batch", name)


@router.get("/batches", responses=problems())
def batches(context: Terrapin) -> list[BatchLine]:
    """The batches of the workspace, newest first."""
    found = []
    for path in context.workspace.folder("batches").iterdir():
        try:
            state = json.loads((path / "progress.json").read_text(encoding="utf-8"))
            line = BatchLine(
                name=path.name,
                report=(path / "report.html").is_file(),
                changed=(path / "progress.json").stat().st_mtime,
                **{key: state[key] for key in ("done", "failed", "runs", "complete")},
            )
        except (OSError, ValueError, KeyError, TypeError):  # not begun, or going away
            continue
        found.append(line)
    return sorted(found, key=lambda line: -line.changed)


@router.get("/batches/{name}", responses=problems(404))
def batch(context: Terrapin, name: Name) -> dict[str, Any]:
    """How far a batch is, and the latest runs one by one: `points` are passed, seed, what was varied, as `inputs` names
    them; `outcomes` are the run's number, why it failed, and what it came to, as `results` names it."""
    return {"name": name, **_state(_batch(context, name))}


def _state(folder: FilePath) -> dict[str, Any]:
    try:
        state: dict[str, Any] = json.loads((folder / "progress.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise NotThere(f"batch: {folder.name} has not begun") from None
    return {"results": [], "outcomes": [[-1, ""] for _ in state.get("points", [])], **state}


@router.post("/batches/{name}/runs/{number}", responses=problems(404, 409), status_code=202)
async def again(context: Terrapin, name: Name, number: Annotated[int, Path(ge=0, lt=MOST_RUNS)]) -> Started:
    """Do one of its latest runs again, as a job, with its log: what Simulate opens."""
    folder = _batch(context, name)
    run, step = await asyncio.to_thread(_one, context.workspace.folder("runs"), folder, number)
    try:
        job = context.jobs.add("simulate", None, [step])
    except (UserError, OSError):
        shutil.rmtree(run, ignore_errors=True)
        raise
    return Started(id=job.id, run=run.name, command=job.command)


def _one(runs: FilePath, batch: FilePath, number: int) -> tuple[FilePath, list[str]]:
    """A new folder of a run with the scenario as the run of the batch had it, and the command line."""
    from terrapin_hil.reading import parse_toml
    from terrapin_hil.scenario.changes import changed

    state = _state(batch)
    found = [point for point, outcome in zip(state["points"], state["outcomes"], strict=True) if outcome[0] == number]
    if not found:
        raise NotThere(f"batch: {batch.name} has no run {number} among its latest")
    _, seed, *values = found[0]
    source = batch.with_name(f"{batch.name}.toml")
    tables = parse_toml(source.read_text(encoding="utf-8"), source)
    stem = re.sub(r"-\d+\Z", "", batch.name)
    run = new_folder(runs, stem)
    file = run / f"{stem}.toml"
    text = tomlkit.dumps(changed(tables, dict(zip(state["inputs"][2:], values, strict=True))))
    file.write_text(text, encoding="utf-8")
    return run, ["run", str(file), "--seed", str(seed), "--out", str(run), "--json"]


@router.get("/batches/{name}/report", responses=problems(404), response_class=FileResponse)
async def report(context: Terrapin, name: Name) -> FileResponse:
    """The report of a batch that is done."""
    path = _batch(context, name) / "report.html"
    if not path.is_file():
        raise NotThere(f"batch: {name} has no report yet")
    return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})


@router.delete("/batches/{name}", responses=problems(404, 409))
async def remove(context: Terrapin, name: Name) -> Named:
    """Remove a batch; 409 while it goes on."""
    folder = _batch(context, name)
    context.jobs.require_ended(folder, "batch")
    await asyncio.to_thread(shutil.rmtree, folder)
    folder.with_name(f"{name}.toml").unlink(missing_ok=True)
    return Named(name=name)
