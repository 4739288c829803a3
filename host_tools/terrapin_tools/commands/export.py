"""`terrapin export CASE --to firmware.toml`: what was found in a case, as parameters of the controller."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from terrapin_tools.command_options import CaseFolder, Jobs, Json, Seed, check_options, deliver
from terrapin_tools.progress import step
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["export"]


def export(
    case: CaseFolder,
    to: Annotated[Path, typer.Option("--to", metavar="FILE.toml", help="for terrapin run --parameters")],
    json: Json = "",
    seed: Seed = 0,
    jobs: Jobs = 1,
) -> None:
    """Write the effects that the controller can compensate as its parameters, rounded to its fixed-point formats.

    Example: terrapin export CASE --to firmware.toml
    """
    from terrapin_tools.workbench.case.case import load_case
    from terrapin_tools.workbench.compare.comparison import analyse
    from terrapin_tools.workbench.robot.firmware_parameters import (
        export_parameters,
        parameters_toml,
        torque_cost,
        why_not,
    )
    from terrapin_tools.workbench.story.sentences import number

    check_options(seed, jobs)
    begin = time.monotonic()
    with step("fit"):
        analysis = analyse(load_case(case), seed)
    exported, refused = export_parameters(analysis)
    cost = torque_cost(analysis, exported)
    write_whole(to, parameters_toml(analysis, exported, refused))
    lines = [f"{to}: {len(exported)} parameters of the controller"]
    for entry in exported:
        origin = f"{entry.effect}; rounding {entry.rounding:+.2g}, raw {entry.raw}"
        lines.append(f"  {entry.name} = {entry.held:.9g} {entry.unit} ({origin})")
    reasons = {effect.name: why_not(effect) for effect in analysis.model.effects if effect.name in refused}
    lines += [f"  {name}: not compensated: {reason}" for name, reason in reasons.items()]
    lines.append(f"Rounding costs at most {number(cost * 1e6)} uN m of the torque on the shell.")
    answer: dict[str, Any] = {
        "parameters": {e.name: {"value": e.held, "raw": e.raw, "fit": e.value, "unit": e.unit} for e in exported},
        "not_compensated": refused,
        "reasons": reasons,
        "rounding_torque": cost,
        "seconds": time.monotonic() - begin,
    }
    deliver(answer, "\n".join(lines), json)
