"""`terrapin experiment`: designed experiments, their plan, what their results allow one to conclude, simulated runs."""

from __future__ import annotations

import sys
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.command_options import CaseFolder, Json, Level, Picture, deliver
from terrapin_tools.errors import UserError, about

__all__ = ["SUBCOMMANDS"]


def l9(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.csv]", help="nine rows: three factors, and last the response")
    ] = None,
    factor: Annotated[
        list[str] | None, typer.Option("--factor", help="NAME=LEVEL,LEVEL,LEVEL, three times: prints the plan as CSV")
    ] = None,
    simulate: Annotated[
        bool,
        typer.Option("--simulate", help="roll the paper's nine runs in the simulator, under the sphere's controller"),
    ] = False,
    torque: Annotated[
        list[float] | None,
        typer.Option("--torque", help="simulated: greatest torque at the joint [N m]; repeat for more"),
    ] = None,
    run_up: Annotated[
        list[float] | None, typer.Option("--run-up", help="simulated: way on the board [m]; repeat for more")
    ] = None,
    ramp: Annotated[
        list[float] | None,
        typer.Option("--ramp", help="simulated: share of the paper's accelerations; repeat for more"),
    ] = None,
    json: Json = "",
    level: Level = 0.05,
) -> None:
    """Range analysis and analysis of variance of three factors at three levels in nine runs (orthogonal array L9).

    Without FILE.csv it takes the rolling distances of Li et al. 2024 and gives their Tables 2 and 3. With --simulate
    the sphere rolls the nine runs anew under its controller, at each torque and run-up.

    Example: terrapin experiment l9 --factor "mass [kg]=7.7,8.0,8.3" --factor "a=0.3,0.4,0.5" --factor "w=1,1.125,1.25"
    """
    from terrapin_tools.experiments.l9 import LI_2024, analyse, describe, plan_text, read_design

    if not 0.0 < level < 1.0:
        raise UserError(f"--level: found {level:g}, expected between 0 and 1")
    if simulate:
        if factor or file is not None:
            raise UserError("--simulate rolls the paper's runs, expected neither --factor nor FILE.csv beside it")
        torques, run_ups = _numbers("--torque", torque, 1.4, 1.7), _numbers("--run-up", run_up, 1.0, 1.4)
        _simulate(list(product(torques, run_ups, _numbers("--ramp", ramp, 1.0))), json)
        return
    if torque or run_up or ramp:
        raise UserError("--torque, --run-up and --ramp: expected together with --simulate")
    if factor:
        if file is not None:
            raise UserError("--factor makes a plan and FILE.csv is analysed, expected one of the two")
        print(plan_text(factor))
        return
    with about(file or "Li et al. 2024"):
        analysis = analyse(LI_2024 if file is None else read_design(file), level)
    deliver({"schema": "terrapin.l9/1", **asdict(analysis)}, describe(analysis), json)


def slip_limit(
    limit: Annotated[
        list[float] | None, typer.Option("--limit", help="a slip limit to try; repeat for more [default: 0.2 to 0.9]")
    ] = None,
    case: Annotated[
        list[str] | None,
        typer.Option("--ground", help="a robot or ground of the study; repeat for more [default: all]"),
    ] = None,
    plot: Picture = None,
    json: Json = "",
) -> None:
    """Which slip limit carries most, climbs furthest, digs least, costs least: the sphere on a rig and rolling freely.

    Some 200 runs under the sphere's controller, in about a minute.

    Example: terrapin experiment slip_limit --limit 0.5 --limit 0.7 --ground "weak sand"
    """
    from terrapin_hil.robots import select
    from terrapin_tools.experiments import slip_limit as study

    for name in case or ():
        if name not in study.CASES:
            raise UserError(f"--ground: found {name!r}, expected one of {', '.join(study.CASES)}")
    for value in limit or ():
        if not 0.05 <= value <= 0.9:
            raise UserError(f"--limit: found {value:g}, expected 0.05 to 0.9")
    select(study.ROBOT)
    found = study.study(tuple(sorted(set(limit or study.LIMITS))), tuple(case or study.CASES), _told)
    if plot is not None:
        study.plot(found, plot)
    deliver({"schema": "terrapin.slip_limit/1", **study.as_json(found)}, study.describe(found), json)


def _told(done: int, of: int) -> None:
    if done % 20 == 0:
        print(f"run {done + 1} of {of}", file=sys.stderr, flush=True)


def _numbers(option: str, given: list[float] | None, *usual: float) -> list[float]:
    for value in given or ():
        if not 0.0 < value <= 10.0:
            raise UserError(f"{option}: found {value:g}, expected more than 0 and at most 10")
    return given or list(usual)


def _simulate(settings: list[tuple[float, float, float]], json: str) -> None:
    from terrapin_hil.robots import select
    from terrapin_tools.experiments import l9_runs

    select(l9_runs.ROBOT)
    found = []
    for number, setting in enumerate(settings):
        print(f"nine runs, setting {number + 1} of {len(settings)}", file=sys.stderr, flush=True)
        with about("simulated runs"):
            found.append(l9_runs.nine(*setting))
    deliver(l9_runs.as_json(found), l9_runs.describe(found), json)


def run(
    case: CaseFolder,
    to: Annotated[Path, typer.Option("--to", metavar="NEW_CASE", help="the case with the new runs; a new folder")],
    truth: Annotated[
        list[str] | None,
        typer.Option("--truth", metavar="EFFECT", help="what the simulated robot has; repeat for more"),
    ] = None,
    json: Json = "",
    seed: Annotated[int, typer.Option("--seed", min=0, help="of the simulated sensors' noise")] = 1,
) -> None:
    """Run the experiment that the last `discover` proposes in the simulator, as if one of the rivals were true.

    The new case holds the old rows and those of the simulated runs; discover on it shows whether they decide.

    Example: terrapin experiment run my_case --to my_case_more --truth aerodynamic_drag
    """
    from terrapin_tools.workbench.case import history
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.robot.simulated_experiment import carry_out, write_larger

    loaded = load_case(case)
    if to.exists():
        raise UserError(f"--to: {to} exists, expected a new folder for the case")
    answer = history.recall(case)
    if answer is None:
        raise UserError(f"{case}: has no answer of discover as it stands, expected terrapin discover first")

    def told(done: int, of: int) -> None:
        print(f"run {done + 1} of {of}", file=sys.stderr, flush=True)

    carried = carry_out(loaded, answer, tuple(truth or ()), seed, told)
    rows = write_larger(loaded, carried, to)
    found = {
        "case": str(to),
        "truth": list(carried.truth),
        "settings": [dict(setting) for setting in carried.settings],
        "runs": len(carried.runs),
        "rows": rows,
    }
    words = f"{to}: {rows} rows of {len(carried.runs)} simulated runs with {' + '.join(carried.truth)} added"
    deliver(found, words, json)


SUBCOMMANDS = (l9, run, slip_limit)
