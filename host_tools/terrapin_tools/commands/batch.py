"""`terrapin batch`: a scenario with many seeds and values, on all cores; its table, its failures, what causes them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.command_options import Cluster, ThisRobot
from terrapin_tools.errors import UserError

__all__ = ["batch"]


def batch(
    scenario: Annotated[str, typer.Argument(help="scenario file, or the name of a shipped scenario")],
    out: Annotated[Path, typer.Option(help="folder of the batch: new, or that of the same command, which goes on")],
    seeds: Annotated[str, typer.Option(metavar="FIRST:LAST", help="1:1000, or 1,5,9; the scenario's own")] = "",
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUES",
            help="a field and its values: LOW:HIGH, LOW:HIGH:STEPS or a,b,c; path.2.slope=12deg:16deg; SI without "
            "a unit; may be repeated",
        ),
    ] = None,
    design: Annotated[
        str, typer.Option(metavar="KIND", help="grid, random, lhs or sobol; grid where everything varied has steps")
    ] = "",
    points: Annotated[
        int | None, typer.Option(min=1, help="points of the design, each with every seed; one for each seed")
    ] = None,
    draw: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="seed of the design")] = 0,
    metric: Annotated[
        list[str] | None,
        typer.Option(metavar="EXPRESSION", help="a number of each run to keep, as in checks: max(slip) - min(slip)"),
    ] = None,
    until: Annotated[str, typer.Option(metavar="FAIL", help="FAIL: end with the first run that fails")] = "",
    jobs: Annotated[int, typer.Option(min=0, help="processes to use; 0: one for each core")] = 0,
    cluster: Cluster = "",
    robot: ThisRobot = "",
    as_json: Annotated[bool, typer.Option("--json", help="the summary as JSON on standard output")] = False,
) -> int:
    """Run a scenario many times, with other seeds and other values of anything in it.

    Examples: terrapin batch slope_limiter --seeds 1:1000 --vary path.2.slope=12deg:16deg --out out/slopes

    terrapin batch slope_limiter --vary path.2.slope=12deg:16deg --vary robot.coulomb=6e-3:24e-3 --until FAIL
    --out out/hunt

    The folder gets runs.parquet (one row a run), summary.json, report.html and failed.sh (a command for each failed
    run). Ctrl-C stops it, and the same command goes on. Exit status: 0 when every run passed, 1 when one failed.
    """
    from terrapin_tools.batch.batch import Order, carry_out

    if robot and cluster:
        raise UserError("--robot: of this machine's processes, expected without --cluster")
    if until not in ("", "FAIL"):
        raise UserError(f"--until: found {until!r}, expected FAIL")
    order = Order(
        scenario, seeds, tuple(vary or ()), design, points, draw, tuple(metric or ()), until_failed=until == "FAIL"
    )
    return carry_out(order, out, jobs, cluster, as_json, robot)
