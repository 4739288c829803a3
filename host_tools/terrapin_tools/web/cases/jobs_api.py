"""Routes of jobs: which command line each does."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path
from pydantic import Field

from terrapin_tools.errors import UserError
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.jobs import Job
from terrapin_tools.web.service.models import (
    CLOSED,
    WHOLE,
    EffectName,
    Formula,
    JobStarted,
    JobView,
    Line,
    Name,
    Parameter,
    Request,
    problems,
)

__all__ = ["router"]

router = APIRouter(prefix="/api", tags=["jobs"])
JobId = Annotated[str, Path(pattern="^[0-9a-f]{12}$")]
Seed = Annotated[int, Field(ge=0, le=2**31 - 1), WHOLE]
RunName = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-][^\x00-\x1f\x7f]{0,199}$")]
Level = Annotated[float, Field(gt=0.0, lt=1.0)]


class Compare(Request):
    """terrapin compare"""

    do: Literal["compare"]
    seed: Seed = 0
    level: Level = 0.05


class Discover(Request):
    """terrapin discover"""

    do: Literal["discover"]
    seed: Seed = 0
    level: Level = 0.05
    bootstrap: Annotated[int, Field(ge=0, le=1000), WHOLE] = 0


class Add(Request):
    """terrapin add: effects by name, or one with an expression of one's own"""

    do: Literal["add"]
    effects: Annotated[list[EffectName], Field(min_length=1, max_length=20)]
    expression: Formula | None = None
    target: Line = ""
    replace: Annotated[bool, Field(description="an effect of one's own of that name gives way")] = False
    parameters: dict[EffectName, Parameter] = Field(default={}, max_length=20, json_schema_extra=CLOSED)
    seed: Seed = 0


class Remove(Request):
    """terrapin remove"""

    do: Literal["remove"]
    effect: EffectName
    seed: Seed = 0


class Undo(Request):
    """terrapin case undo, or redo: case.toml as it was before the last change"""

    do: Literal["undo", "redo"]


class Hold(Request):
    """terrapin case hold: the runs that are held out; all others are trained on"""

    do: Literal["hold"]
    runs: Annotated[list[RunName], Field(max_length=1000)]


class Constant(Request):
    """terrapin case set: a known constant of the case, with its unit"""

    do: Literal["constant"]
    name: EffectName
    value: Annotated[
        str, Field(pattern=r"^[A-Za-z0-9+. -][A-Za-z0-9+.,*/^()%\u00b0\u00b2\u00b3\u00b5\u00b7\u03a9\u03bc -]{0,60}$")
    ]


class Report(Request):
    """terrapin report: the page is then at /api/cases/NAME/report"""

    do: Literal["report"]
    discover: bool = True
    seed: Seed = 0
    level: Level = 0.05


class Export(Request):
    """terrapin export, and terrapin run with the parameters when a scenario is named: C_t's error before and after"""

    do: Literal["export"]
    scenario: Name | None = None
    seed: Seed = 0


class Experiment(Request):
    """terrapin experiment run: the proposed experiment in the simulator, into the new case `to`; then discover there"""

    do: Literal["experiment"]
    to: Name
    truth: Annotated[
        list[EffectName],
        Field(default_factory=list, max_length=20, description="one of the rivals; empty: the likeliest"),
    ]
    seed: Annotated[int, Field(ge=0, le=2**31 - 1), WHOLE] = 1


Body = Annotated[
    Compare | Discover | Add | Remove | Undo | Hold | Constant | Report | Export | Experiment, Field(discriminator="do")
]


@router.post("/cases/{name}/jobs", responses=problems(404, 409), status_code=202)
async def start(context: Terrapin, name: Name, body: Body) -> JobStarted:
    """Queue a command on a case. Two on the same case run one after the other."""
    folder = context.workspace.case(name)
    steps = _steps(context, name, folder, body)

    async def keep(job: Job) -> None:
        await context.warm.call("terrapin_tools.web.cases.summary:keep", str(folder), job.result, kind="keep")

    changes = isinstance(body, Add | Remove | Undo | Hold | Constant)
    done = keep if isinstance(body, Add | Remove | Hold | Constant | Compare) else None
    job = context.jobs.add(
        body.do,
        name,
        steps,
        restore=folder if changes else None,
        done=context.events.cases if isinstance(body, Experiment) else done,
    )
    return JobStarted(id=job.id, command=job.command)


def _steps(context: Context, name: str, folder: FilePath, body: Any) -> list[list[str]]:
    """The command lines; an option that has its default is left out."""
    options = _option("--seed", getattr(body, "seed", 0), 0) + _option("--level", getattr(body, "level", 0.05), 0.05)
    answer = ["--json", "-"]
    match body:
        case Compare():
            return [["compare", str(folder), *options, *answer]]
        case Discover():
            return [["discover", str(folder), *options, *_option("--bootstrap", body.bootstrap, 0), *answer]]
        case Add():
            replace = ["--replace"] if body.replace else []
            return [["add", str(folder), *body.effects, *_own(body), *replace, *options, *answer]]
        case Remove():
            return [["remove", str(folder), body.effect, *options, *answer]]
        case Undo():
            return [["case", body.do, str(folder), *answer]]
        case Hold():
            return [["case", "hold", str(folder), *body.runs, *answer]]
        case Constant():
            return [["case", "set", str(folder), f"{body.name}={body.value}", *answer]]
        case Report():
            page = context.workspace.folder("reports") / f"{name}.html"
            look = [] if body.discover else ["--no-discover"]
            return [["report", str(folder), "-o", str(page), *look, *options, *answer]]
        case Export():
            file = str(context.workspace.folder("exports") / f"{name}.toml")
            steps = [["export", str(folder), "--to", file, *options, *answer]]
            if body.scenario is not None:
                steps.append(["run", body.scenario, "--parameters", file, "--json"])
            return steps
        case Experiment():
            to = str(context.workspace.new_case(body.to))
            chosen = [word for effect in body.truth for word in ("--truth", effect)]
            step = ["experiment", "run", str(folder), "--to", to, *chosen, *_option("--seed", body.seed, 1), *answer]
            return [step, ["discover", to, *answer]]
    raise AssertionError(body)


def _option(name: str, value: float, default: float) -> list[str]:
    return [] if value == default else [name, f"{value:.17g}"]


def _own(body: Add) -> list[str]:
    if body.expression is None:
        if body.target or body.parameters:
            raise UserError("target, parameters: expected together with an expression")
        return []
    found = [f"--expression={body.expression}", *([f"--target={body.target}"] if body.target else [])]
    for name, p in body.parameters.items():
        low, high = ("" if limit is None else f"{limit:.17g}" for limit in (p.min, p.max))
        rest = f":{low}:{high}" if low or high or p.unit else ""
        found.append(f"--parameter={name}={p.value:.17g}{rest}" + (f":{p.unit}" if p.unit else ""))
    return found


@router.get("/jobs", responses=problems())
async def jobs(context: Terrapin) -> list[JobView]:
    """All jobs, newest first, without their results."""
    return [JobView(**{**job.view(), "result": None, "progress": job.progress[-3:]}) for job in context.jobs.all()]


@router.get("/jobs/{identifier}", responses=problems(404))
async def job(context: Terrapin, identifier: JobId) -> JobView:
    """A job with its result."""
    return JobView(**context.jobs.get(identifier).view())


@router.delete("/jobs/{identifier}", responses=problems(404))
async def cancel(context: Terrapin, identifier: JobId) -> JobView:
    """Cancel a job: its processes end, its case is as it was. A job that has ended stays as it is."""
    return JobView(**(await context.jobs.cancel(identifier)).view())
