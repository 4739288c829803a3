"""Routes of the Simulate tab: scenarios and what can be changed in them, runs as jobs, what a run did, a case of it.

A changed scenario is an ordinary scenario file in the run's folder, so that the command line shown does the same.
"""

from __future__ import annotations

import asyncio
import re
import shutil
import tomllib
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import tomlkit
from fastapi import APIRouter
from pydantic import BaseModel, Field, FiniteFloat

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import WHOLE, EffectName, Line, Name, Named, Request, problems
from terrapin_tools.web.service.workspace import NotThere, Taken

__all__ = ["Simulate", "Started", "begin", "changed_scenario", "new_folder", "router"]

router = APIRouter(prefix="/api", tags=["simulate"])
Word = Annotated[str, Field(pattern=r"^[a-z_]{0,40}$", max_length=40)]
LARGEST = {  # ends of sliders for parameters without bounds, by unit: about what changes a run of this robot much
    "N m": 0.05,
    "N m s/rad": 5e-3,
    "m^2": 0.2,
    "s^2/rad^2": 1e-3,
    "Pa": 5e3,
    "s": 0.1,
    "rad": 0.5,
    "1": 1.0,
}
MOST_RUNS = 500


class Segment(Request):
    """Changes of one [[path]]."""

    terrain: Word | None = None
    slope: Annotated[float, Field(ge=-1.2, le=1.2, description="rad, uphill positive")] | None = None


class FaultAt(Request):
    """One [[fault]]; times in s."""

    kind: Word
    channel: Word = ""
    value: FiniteFloat | None = None
    begin: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    end: Annotated[float, Field(ge=0.0, le=3600.0)] | None = None


class Simulate(Request):
    """A run of a shipped scenario with changes; what is left out stays as the scenario has it."""

    scenario: Name
    seed: Annotated[int, Field(ge=0, le=2**53 - 1), WHOLE] | None = None
    link: Literal["inprocess", "pty"] = "inprocess"
    duration: Annotated[float, Field(ge=0.1, le=3600.0, description="s")] | None = None
    supply: Annotated[float, Field(ge=0.0, le=60.0, description="V")] | None = None
    soil: Word | None = None
    ground: Annotated[list[Segment], Field(max_length=16, description="one for each [[path]]")] | None = None
    setpoints: (
        Annotated[list[FiniteFloat | None], Field(max_length=64, description="V or m/s, one an order")] | None
    ) = None
    limiter: bool | None = None
    effects: Annotated[dict[EffectName, dict[EffectName, FiniteFloat]], Field(max_length=20)] | None = None
    faults: Annotated[list[FaultAt], Field(max_length=16)] | None = None


class Started(BaseModel):
    """A run has been queued as the job `id`; its folder is `run`."""

    id: str
    run: str
    command: str


class RunLine(BaseModel):
    """A run in the workspace."""

    name: str
    scenario: str
    title: str
    seed: int
    duration: str
    complete: bool
    passed: bool | None
    changed: float


class KeepCase(Request):
    """A case of this run and others. With no others the scenario is run once more with the next seed, as the held-out
    run."""

    name: Name
    title: Line = ""
    others: Annotated[list[Name], Field(default_factory=list, max_length=50)]
    effects: Annotated[list[EffectName], Field(default_factory=list, max_length=20)]
    span: Annotated[float, Field(ge=0.02, le=10.0, description="s; rows of this length, steady or not")] | None = None


async def begin(context: Context) -> None:
    """Remove the folders of runs that a server before this one never began: no list shows them, yet they count."""
    for path in context.workspace.folder("runs").iterdir():
        if _never_begun(path):
            shutil.rmtree(path)


def _never_begun(run: Path) -> bool:
    """Whether it is the folder of a run that was cancelled while it waited: our name, and a scenario at most."""
    if re.fullmatch(r"[a-z0-9_.-]+-\d+", run.name) is None or not run.is_dir():
        return False
    return {file.name for file in run.iterdir()} <= {re.sub(r"-\d+\Z", ".toml", run.name)}


@router.get("/scenarios", responses=problems())
@cache
def scenarios() -> dict[str, Any]:
    """The shipped scenarios, and what can be changed: terrains, soils, effects and faults with their bounds."""
    from terrapin_hil.effect_files import known_effects
    from terrapin_hil.physics import soils
    from terrapin_hil.robot.compiled_effects import in_plant
    from terrapin_hil.robot.plant import TERRAINS
    from terrapin_hil.robot.soft_ground import affects_soil
    from terrapin_hil.scenario.faults import KINDS
    from terrapin_hil.scenario.scenario import load_scenario
    from terrapin_tools.web.simulate.told import described

    found = [described(load_scenario(path), path.stem) for path in sorted(paths.SCENARIOS.glob("*.toml"))]
    effects = [
        {
            "name": effect.name,
            "title": effect.title,
            "soil": not in_plant(effect),
            "parameters": [
                {
                    "name": p.name,
                    "unit": p.unit,
                    "start": p.start,
                    "meaning": p.meaning,
                    "low": p.minimum if p.minimum > -1e6 else -LARGEST.get(p.unit, max(1.0, 4 * abs(p.start))),
                    "high": p.maximum if p.maximum < 1e6 else LARGEST.get(p.unit, max(1.0, 4 * abs(p.start))),
                }
                for p in effect.parameters
            ],
        }
        for effect in known_effects().values()
        if in_plant(effect) or affects_soil(effect)
    ]
    high = {"forced": 4095.0, "lost_counts": 1.0, "supply": 20.0, "babble": 40.0}
    faults = {
        kind: {"channels": list(channels), "unit": unit, "high": high.get(kind, 1.0) if unit else None}
        for kind, (_, channels, unit) in KINDS.items()
    }
    return {
        "scenarios": found,
        "terrains": list(TERRAINS),
        "soils": list(soils.library()),
        "effects": effects,
        "faults": faults,
    }


def changed_scenario(source: str, body: Simulate) -> str:
    """The scenario's text with the changes; the same text when there are none. UserError for what does not fit it."""
    document: Any = tomlkit.parse(source)
    if body.duration is not None:
        document["duration"] = body.duration
    if body.supply is not None:
        document.setdefault("supply", tomlkit.table())["voltage"] = body.supply
    if body.soil is not None:
        if "soil" not in document:
            raise UserError("soil: this scenario's ground is a terrain, expected no soil")
        if body.soil != document["soil"].get("name"):
            document["soil"] = {"name": body.soil, "width": document["soil"].get("width", 0.15)}
    for number, change in enumerate(body.ground or []):
        if number >= len(document["path"]):
            raise UserError(f"ground: found {number + 1} segments, expected at most {len(document['path'])}")
        table = document["path"][number]
        if change.terrain is not None and change.terrain != table.get("terrain"):
            for key in ("f_o", "f_s", "mu", "s_k", "softness"):
                table.pop(key, None)
            table["terrain"] = change.terrain
        if change.slope is not None:
            table["slope"] = change.slope
    for number, setpoint in enumerate(body.setpoints or []):
        if number >= len(document["operator"]):
            raise UserError(f"setpoints: found {number + 1}, expected at most {len(document['operator'])}")
        if setpoint is not None:
            document["operator"][number]["setpoint"] = setpoint
    if body.limiter is not None:
        for order in document["operator"]:
            order["limiter"] = body.limiter
    if body.effects is not None:
        document.pop("effect", None)
        if body.effects:
            document["effect"] = body.effects
    if body.faults is not None:
        document.pop("fault", None)
        faults = tomlkit.aot()
        for fault in body.faults:
            entries = {"kind": fault.kind, "channel": fault.channel or None, "value": fault.value}
            entries |= {"from": fault.begin, "to": fault.end}
            faults.append(tomlkit.item({key: value for key, value in entries.items() if value is not None}))
        if body.faults:
            document["fault"] = faults
    return tomlkit.dumps(document)


@router.post("/simulate", responses=problems(404, 409), status_code=202)
async def simulate(context: Terrapin, body: Simulate) -> Started:
    """Run a scenario as a job; the run's folder then holds its log."""
    if body.scenario not in {one["name"] for one in (await asyncio.to_thread(scenarios))["scenarios"]}:
        raise NotThere(f"scenario: found no {body.scenario!r}")
    name, step = await asyncio.to_thread(_prepare, context.workspace.folder("runs"), body)
    try:
        job = context.jobs.add("simulate", None, [step])
    except (UserError, OSError):
        shutil.rmtree(context.workspace.folder("runs") / name, ignore_errors=True)
        raise
    return Started(id=job.id, run=name, command=job.command)


def _prepare(folder: Path, body: Simulate) -> tuple[str, list[str]]:
    """The run's folder with the scenario as changed, and the command line."""
    from terrapin_hil.reading import ReadingError
    from terrapin_hil.scenario.scenario import load_scenario

    source = (paths.SCENARIOS / f"{body.scenario}.toml").read_text(encoding="utf-8")
    text = changed_scenario(source, body)
    run = new_folder(folder, body.scenario[:56])
    scenario = body.scenario
    if tomllib.loads(text) != tomllib.loads(source):
        file = run / f"{body.scenario}.toml"
        scenario = str(file)
        try:
            file.write_text(text, encoding="utf-8")
            load_scenario(file)
        except ReadingError as error:
            shutil.rmtree(run)
            raise UserError(str(error).replace(f"{run}/", "")) from None
        except OSError:
            shutil.rmtree(run)
            raise
    seed = ["--seed", str(body.seed)] if body.seed is not None else []
    link = ["--link", body.link] if body.link != "inprocess" else []
    return run.name, ["run", scenario, *link, *seed, "--out", str(run), "--json"]


def new_folder(folder: Path, base: str) -> Path:
    """Makes the next folder of that name. Taken when there are as many runs as are kept."""
    if sum(1 for _ in folder.iterdir()) >= MOST_RUNS:
        raise Taken(f"runs: found {MOST_RUNS}, expected some of them removed")
    number = 1
    while True:
        try:
            (folder / f"{base}-{number}").mkdir()
            return folder / f"{base}-{number}"
        except FileExistsError:
            number += 1


def _run(context: Context, name: str) -> Path:
    return context.workspace.result("runs", "run", name)


@router.get("/simulate", responses=problems())
def runs(context: Terrapin) -> list[RunLine]:
    """The runs of the workspace, newest first."""
    found = []
    for path in context.workspace.folder("runs").iterdir():
        try:
            document = tomllib.loads((path / "run.toml").read_text(encoding="utf-8"))
            run = document["run"]
            line = RunLine(
                name=path.name,
                changed=(path / "run.toml").stat().st_mtime,
                passed=run.get("passed"),
                **{key: run[key] for key in ("scenario", "title", "seed", "duration", "complete")},
            )
        except (OSError, ValueError, KeyError):  # not begun, or going away
            continue
        found.append(line)
    return sorted(found, key=lambda line: -line.changed)


@router.get("/simulate/{name}/signals", responses=problems(404))
async def signals(context: Terrapin, name: Name) -> dict[str, Any]:
    """What the robot did: columns of the truth, what the controller said beside them, the ground's height."""
    run = _run(context, name)  # read in a process of its own: a long run takes many seconds, and the live view goes on
    found: dict[str, Any] = await context.warm.call("terrapin_tools.web.simulate.simulate_data:run_signals", str(run))
    return found


@router.delete("/simulate/{name}", responses=problems(404, 409))
async def remove(context: Terrapin, name: Name) -> Named:
    """Remove a run; 409 while it goes on."""
    run = _run(context, name)
    context.jobs.require_ended(run, "run")
    await asyncio.to_thread(shutil.rmtree, run)
    return Named(name=name)


@router.post("/simulate/{name}/case", responses=problems(404, 409), status_code=202)
async def case(context: Terrapin, name: Name, body: KeepCase) -> Started:
    """Make a case of this run and others; at least two runs, as one is held out."""
    run = _run(context, name)
    target = context.workspace.new_case(body.name)
    steps: list[list[str]] = []
    folders = [run, *(_run(context, other) for other in body.others)]
    if not body.others:
        again = await asyncio.to_thread(_again, context.workspace.folder("runs"), run)
        steps.append(again)
        folders.append(Path(again[again.index("--out") + 1]))
    options = [*(word for effect in body.effects for word in ("--effect", effect))]
    options += ["--span", f"{body.span:.9g}"] if body.span is not None else []
    options += ["--title", body.title] if body.title else []
    steps.append(["case", "runs", *map(str, folders), "--to", str(target), *options])

    try:
        job = context.jobs.add("case", None, steps, done=context.events.cases, fresh=target)
    except (UserError, OSError):
        if not body.others:
            shutil.rmtree(folders[-1], ignore_errors=True)
        raise
    return Started(id=job.id, run=name, command=job.command)


def _again(folder: Path, run: Path) -> list[str]:
    """The command line of the same run with the next seed."""
    try:
        document = tomllib.loads((run / "run.toml").read_text(encoding="utf-8"))["run"]
        scenario, seed, link = str(document["scenario"]), int(document["seed"]), str(document["link"])
    except (OSError, ValueError, KeyError):
        raise UserError(f"{run.name}: the run has not begun, expected one that is complete") from None
    own = run / f"{scenario}.toml"
    out = new_folder(folder, re.sub(r"-\d+\Z", "", run.name))
    if own.is_file():
        shutil.copyfile(own, out / own.name)
    given = str(out / own.name) if own.is_file() else scenario
    options = ["--link", link] if link != "inprocess" else []
    return ["run", given, *options, "--seed", str(seed + 1), "--out", str(out), "--json"]
