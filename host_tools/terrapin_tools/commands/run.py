"""`terrapin run`: a scenario over a link, its log and its checks."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from terrapin_hil.links.names import INPROCESS, LinkName, able
from terrapin_tools.command_options import LinkKeyFile, NodeNumber, ThisRobot, link_option
from terrapin_tools.errors import UserError

if TYPE_CHECKING:  # NumPy and the C libraries, which `terrapin run --help` does not need
    from terrapin_hil.fmi.plant import FmuPlant
    from terrapin_hil.links.link import Link
    from terrapin_hil.run.run import Result
    from terrapin_hil.run.together import BusReport
    from terrapin_hil.scenario.checks import Outcome
    from terrapin_hil.scenario.scenario import Scenario
    from terrapin_tools.contact_error import ContactError

__all__ = ["run"]


def _before(result: Result) -> ContactError | None:
    """The error of C_t without the parameters: the same run once more, in this process."""
    from terrapin_hil.run.run import run as run_scenario
    from terrapin_tools.contact_error import contact_error

    plain = replace(result.scenario, real_time=False, checks=())
    return contact_error(run_scenario(plain, "inprocess", parameters={}))


def _contact(result: Result) -> dict[str, dict[str, float | int | bool] | None]:
    from terrapin_tools.contact_error import contact_error

    found = {"after": contact_error(result), "before": _before(result)}
    return {key: vars(error) if error is not None else None for key, error in found.items()}


def _contact_words(result: Result) -> str:
    from terrapin_tools.contact_error import contact_error

    before, after = _before(result), contact_error(result)
    if before is None or after is None:
        return "  C_t error: the robot never ran for a whole window"
    kind = "valid" if after.valid else "unsteady"
    change = f"{1e3 * before.rms:.3g} -> {1e3 * after.rms:.3g} mN m"
    return f"  C_t error {change} rms with these parameters (over {after.windows} {kind} windows)"


def _fields(result: Result, folder: Path | None, written: bool) -> dict[str, Any]:
    return {
        "scenario": result.scenario.name,
        "link": result.link,
        "seed": result.scenario.seed,
        "duration": result.scenario.duration,
        "wall_seconds": result.timing.seconds,
        "passed": result.passed,
        "notes": list(result.scenario.notes),
        "checks": [{"check": o.text, "passed": o.passed, "found": o.found} for o in result.outcomes],
        "output_sha256": result.output_hash,
        "out": str(folder) if folder else None,
        **({"contact_error": _contact(result)} if written else {}),
    }


def _as_json(result: Result, folder: Path | None, written: bool) -> str:
    return json.dumps(_fields(result, folder, written), indent=2)


def _node_folder(out: Path | None, node: int) -> Path | None:
    return out / f"node-{node}" if out else None


def _together_as_json(results: dict[int, Result], report: BusReport | None, out: Path | None) -> str:
    nodes = [{"node": n, **_fields(result, _node_folder(out, n), False)} for n, result in results.items()]
    bus = asdict(report) if report is not None else None
    return json.dumps({"nodes": nodes, "bus": bus}, indent=2)


def _together_as_text(results: dict[int, Result], report: BusReport | None, out: Path | None) -> str:
    rows = [_as_text(result, _node_folder(out, n), False) for n, result in results.items()]
    return "\n".join([*rows, str(report)] if report is not None else rows)


def _as_text(result: Result, folder: Path | None, written: bool) -> str:
    scenario, timing = result.scenario, result.timing
    speed = scenario.duration / max(timing.seconds, 1e-9)
    rows = [
        f"{scenario.name}: {scenario.title}" if scenario.title else scenario.name,
        f"  {scenario.duration:g} s in {timing.seconds:.3g} s ({speed:.3g} x real time), {result.link}, "
        f"seed {scenario.seed}",
    ]
    if scenario.real_time:
        rows.append(f"  real time: ticks late by {timing.rms * 1e6:.0f} us rms, {timing.latest * 1e6:.0f} us at most")
    rows += [f"  note  {note}" for note in scenario.notes]
    rows += [f"  {'ok  ' if o.passed else 'FAIL'}  {o.text}    ({o.missed or o.found})" for o in result.outcomes]
    if written:
        rows.append(_contact_words(result))
    rows.append(f"  output sha256 {result.output_hash}")
    if folder is not None:
        rows.append(f"  log in {folder}")
    return "\n".join(rows)


def _values(changes: Iterable[str]) -> dict[str, Any]:
    """Name -> value of what `--set` says."""
    from terrapin_hil.scenario.changes import read_value

    found: dict[str, Any] = {}
    for text in changes:
        name, equals, value = text.partition("=")
        if not equals or not value or name in found:
            raise UserError(f"--set: found {text[:80]!r}, expected NAME=VALUE, each name once")
        found[name] = read_value(value)
    return found


@contextlib.contextmanager
def _opened(link: LinkName, path: Path | None, key: Path | None) -> Iterator[tuple[Link, list[Outcome]]]:
    """The link; in the rig that a file describes the board reset, its e-stop measured, its enable line watched while
    the run lasts."""
    from terrapin_hil.links import open_link
    from terrapin_hil.links.identity import require_fitting
    from terrapin_hil.run.rig import Rig, RigConfig, load_rig
    from terrapin_hil.run.rig_checks import bridge_stays_off, estop_outcome

    outcomes: list[Outcome] = []
    with contextlib.ExitStack() as stack:
        rig = stack.enter_context(Rig(load_rig(path) if path is not None else RigConfig()))
        if rig.has("reset"):
            rig.reset()
        opened = stack.enter_context(open_link(link, link_key=key))
        require_fitting(opened.name, opened.ask)
        if rig.has("estop", "enable"):
            outcomes.append(estop_outcome(rig, opened))  # type: ignore[arg-type]  # links of boards talk
        if rig.has("enable"):
            stack.enter_context(bridge_stays_off(rig, outcomes))
        yield opened, outcomes


def _plant(path: Path | None, names: Iterable[str]) -> FmuPlant | None:
    """The FMU that moves in the place of the simulated body."""
    if path is None:
        if names:
            raise UserError("--plant-name: found no --plant, expected one")
        return None
    from terrapin_hil.fmi.plant import FmuPlant

    pairs = [text.partition("=") for text in names]
    for name, equals, own in pairs:
        if not equals or not own:
            raise UserError(f"--plant-name: found {name[:80]!r}, expected NAME=VARIABLE")
    return FmuPlant(path, {name: own for name, _, own in pairs})


def _others(names: Iterable[str]) -> list[Scenario]:
    from terrapin_hil.scenario.scenario import find_scenario, load_scenario

    return [load_scenario(find_scenario(name)) for name in names]


def _run_together(
    scenarios: list[Scenario], first: int, bitrate: int | None, out: Path | None, parameters: Path | None, as_json: bool
) -> int:
    """Robots at the node numbers from `first` on; the exit status."""
    from terrapin_hil.messages import interface
    from terrapin_hil.nodes import node_count
    from terrapin_hil.run.together import run_together
    from terrapin_tools.logs.folder import RunFolder
    from terrapin_tools.param.files import read_parameters
    from terrapin_tools.progress import bar

    if first + len(scenarios) > node_count():
        raise UserError(
            f"--with: {len(scenarios)} robots from node {first} on, expected node numbers up to {node_count() - 1}"
        )
    values = read_parameters(parameters, interface()) if parameters else {}
    nodes = dict(enumerate(scenarios, first))
    folders = {
        n: RunFolder(folder, scenario, f"node {n}", values, interface())
        for n, scenario in nodes.items()
        if (folder := _node_folder(out, n)) is not None
    }
    with contextlib.ExitStack() as stack:
        for each in folders.values():
            stack.callback(each.close)
        shown = stack.enter_context(bar(", ".join(scenario.name for scenario in scenarios)))
        results, report = run_together(
            nodes,
            bitrate,
            parameters=values,
            observers={n: [each] for n, each in folders.items()},
            progress=lambda share: shown(completed=share),
        )
        for n, each in folders.items():
            each.finish(results[n])
    print((_together_as_json if as_json else _together_as_text)(results, report, out))
    return 0 if all(result.passed for result in results.values()) else 1


def run(
    scenario: Annotated[str, typer.Argument(help="scenario file, or the name of a shipped scenario")],
    link: Annotated[LinkName, link_option("lockstep", "where the controller is")] = INPROCESS,
    out: Annotated[Path | None, typer.Option(help="folder for telemetry.log, truth.csv and run.toml")] = None,
    robot: ThisRobot = "",
    seed: Annotated[int | None, typer.Option(min=0, max=2**63 - 1, help="instead of the scenario's")] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="a field in place of the file's, path.1.slope=3deg"),
    ] = None,
    parameters: Annotated[Path | None, typer.Option(help="TOML file with a table [parameters]")] = None,
    real_time: Annotated[bool, typer.Option("--real-time", help="keep to the clock; lateness is reported")] = False,
    rig: Annotated[Path | None, typer.Option(help="TOML file that names the GPIO lines around a real board")] = None,
    node: NodeNumber = None,
    link_key: LinkKeyFile = None,
    others: Annotated[
        list[str] | None,
        typer.Option("--with", metavar="SCENARIO", help="one more robot on the same bus, at the next node number"),
    ] = None,
    bitrate: Annotated[
        int | None,
        typer.Option(min=10_000, max=1_000_000, help="bit/s of the bus that robots share, whose frames then take time"),
    ] = None,
    plant: Annotated[
        Path | None, typer.Option(metavar="FMU", help="native code of FMI 3.0 in the place of the simulated body")
    ] = None,
    plant_names: Annotated[
        list[str] | None,
        typer.Option("--plant-name", metavar="NAME=VARIABLE", help="what the FMU calls voltage, omega, speed, ..."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="the result as JSON on standard output")] = False,
) -> int:
    """Run a scenario: the simulated robot against the controller, in lockstep.


    Example: terrapin run slope_limiter --link pty --out out/slope

    terrapin run slope_limiter --seed 7 --set path.2.slope=9deg --set robot.coulomb=0.015

    terrapin run steady_sand --with slope_limiter --bitrate 500000

    terrapin run steady_sand --plant robot.fmu

    SCENARIO is a TOML file, or the name of a shipped one.
    Exit status: 0 when every check of the scenario holds, 1 when one fails or the run breaks off, 2 for bad input.
    """
    from terrapin_hil.messages import interface
    from terrapin_hil.run.run import run as run_scenario
    from terrapin_hil.scenario.scenario import load_scenario, take_scenario
    from terrapin_tools.logs.folder import RunFolder
    from terrapin_tools.param.files import read_parameters
    from terrapin_tools.progress import bar

    try:
        chosen = load_scenario(take_scenario(scenario, robot), _values(changes or ()))
        if seed is not None:
            chosen = replace(chosen, seed=seed)
        if real_time:
            chosen = replace(chosen, real_time=True)
        link = link.at_node(node)
        if others or bitrate is not None:
            if link.kind != "inprocess" or rig is not None or real_time or link_key is not None:
                alone = "--link, --rig, --real-time, --link-key"
                raise UserError(f"--with, --bitrate: robots share a bus in this process, expected no {alone}")
            if plant is not None:
                raise UserError("--with, --bitrate: found --plant, expected robots with the simulated body")
            return _run_together([chosen, *_others(others or ())], link.node, bitrate, out, parameters, as_json)
        if rig is not None and "board" not in link.row.jobs:
            boards = ", ".join(kind.form for kind in able("board"))
            raise UserError(f"--rig is around a real board: found --link {link}, expected one of {boards}")
        description = interface()
        values = read_parameters(parameters, description) if parameters else {}
        folder = RunFolder(out, chosen, str(link), values, description) if out else None
        with contextlib.ExitStack() as stack:
            if folder is not None:
                stack.callback(folder.close)
            shown = stack.enter_context(bar(chosen.name))
            observers = [folder] if folder else []
            body = _plant(plant, plant_names or ())
            if body is not None:
                stack.callback(body.close)
            with _opened(link, rig, link_key) as (opened, outcomes):
                result = run_scenario(
                    chosen,
                    opened,
                    parameters=values,
                    observers=observers,
                    progress=lambda share: shown(completed=share),
                    plant=body,
                )
            result.outcomes = (*outcomes, *result.outcomes)
            if folder is not None:
                folder.finish(result)
    except KeyboardInterrupt:
        raise UserError(f"interrupted; the log up to here is in {out}" if out else "interrupted", status=130) from None
    print((_as_json if as_json else _as_text)(result, out, bool(values)))
    return 0 if result.passed else 1
