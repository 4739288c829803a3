"""`terrapin fmu`: robot and controller as FMUs (FMI 3.0) for other simulators."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.command_options import ThisRobot
from terrapin_tools.errors import UserError

__all__ = ["SUBCOMMANDS"]


class What(StrEnum):
    CONTROLLER = "controller"
    PLANT = "plant"
    BOTH = "both"


def export(
    what: Annotated[What, typer.Argument(help="the firmware, the robot on its ground, or both in one")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="the FMU, FILE.fmu")],
    scenario: Annotated[str, typer.Option(help="scenario of the plant: a file, or a shipped one")] = "steady_sand",
    robot: ThisRobot = "",
) -> int:
    """Write a co-simulation FMU with its sources and a binary for this platform. It takes some seconds of the compiler.

    Example: terrapin fmu export controller -o controller.fmu

    terrapin fmu export both --scenario slope_limiter -o robot.fmu
    """
    from terrapin_hil.fmi.export import export as write
    from terrapin_hil.scenario.scenario import load_scenario, take_scenario

    if out.suffix.lower() != ".fmu":
        raise UserError(f"-o: found {out.name!r}, expected a name that ends in .fmu")
    if not out.parent.is_dir():
        raise UserError(f"-o: {out.parent}: no such folder")
    chosen = load_scenario(take_scenario(scenario, robot)) if what is not What.CONTROLLER else None
    model = write(what.value, out, chosen)
    counts = {kind: sum(v.causality == kind for v in model.variables) for kind in ("parameter", "input", "output")}
    print(f"{out}: {model.name}, {', '.join(f'{n} {kind}s' for kind, n in counts.items())}, steps of whole ms")
    return 0


SUBCOMMANDS = (export,)
