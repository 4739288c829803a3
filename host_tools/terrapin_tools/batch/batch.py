"""A batch from its order to its folder: runs.parquet, summary.json, report.html, failed.sh."""

from __future__ import annotations

import json
import os
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from terrapin_hil.scenario.scenario import load_scenario, take_scenario
from terrapin_tools.batch.design import Varied, design, read_seeds, read_varied
from terrapin_tools.batch.filling import fill
from terrapin_tools.batch.journal import claimed, read_journals
from terrapin_tools.batch.one_run import METRICS, Plan, refuse_ends
from terrapin_tools.batch.shown import Shown
from terrapin_tools.batch.summary import Summary, summarise
from terrapin_tools.batch.table import table_of, to_parquet
from terrapin_tools.batch.told import repeat_command, repeat_script, words
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.json_text import finite
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.fleet.pool import fingerprint

__all__ = ["Order", "carry_out"]

HUNT = 100_000  # seeds of `--until FAIL` where none are given


@dataclass(frozen=True)
class Order:
    """What was asked for, as it was written."""

    scenario: str
    seeds: str = ""
    vary: tuple[str, ...] = ()
    design: str = ""
    points: int | None = None
    draw: int = 0
    metrics: tuple[str, ...] = ()
    until_failed: bool = False


def _description(order: Order, seeds: str, source: str) -> dict[str, Any]:
    """What must be the same for a batch to go on."""
    return {
        "scenario": Path(order.scenario).stem,
        "source": source,
        "seeds": seeds,
        "vary": list(order.vary),
        "design": order.design,
        "points": order.points,
        "draw": order.draw,
        "metrics": list(order.metrics),
        "until": "FAIL" if order.until_failed else "",
        "program": fingerprint(),
    }


def carry_out(
    order: Order, folder: Path, jobs: int = 0, cluster: str = "", as_json: bool = False, robot: str = ""
) -> int:
    """Do what is missing of the batch and write what came of it; the exit status. UserError says what is wrong.

    `robot`: what the command names; the scenario's own otherwise.
    """
    path = take_scenario(order.scenario, robot)
    scenario = load_scenario(path)
    own = f"1:{HUNT}" if order.until_failed and order.points is None else str(scenario.seed)
    seeds = order.seeds or own
    varied = [read_varied(text) for text in order.vary]
    plan = Plan(str(path), scenario.source, (*METRICS, *(m for m in order.metrics if m not in METRICS)))
    refuse_ends(plan, varied)
    rows = list(design(read_seeds(seeds), varied, order.design, order.points, order.draw))
    with claimed(folder, _description(order, seeds, scenario.source)):
        shown, complete = Shown(folder, rows, varied), False
        try:
            answers = fill(
                plan, rows, folder, scenario.duration, jobs=jobs or len(os.sched_getaffinity(0)), cluster=cluster,
                until_failed=order.until_failed, seen=shown.seen, say=shown.say,
            )  # fmt: skip
            complete = True
        except KeyboardInterrupt:
            done = len(read_journals(folder))
            raise UserError(
                f"interrupted: {done} of {len(rows)} runs are in {folder}; the same command goes on", status=130
            ) from None
        finally:
            shown.end(complete)
        table = table_of(rows, answers, varied)
        same = all(one.name != "duration" for one in varied)
        summary = summarise(table, scenario.duration if same else None)
        failed = [(rows[answer.number], answer) for answer in answers if not answer.passed]
        commands = [repeat_command(order.scenario, row) for row, _ in failed]
        try:
            write_whole(folder / "runs.parquet", to_parquet(table))
            write_whole(folder / "summary.json", json.dumps(finite(summary.as_json()), indent=1) + "\n")
            write_whole(folder / "failed.sh", repeat_script(order.scenario, failed))
            write_whole(folder / "report.html", _report(order, varied, table, summary, commands))
        except OSError as error:
            raise UserError(
                f"{folder}: cannot write: {error.strerror or error}; what was finished stays", status=1
            ) from None
    if as_json:
        print(json.dumps(finite({**summary.as_json(), "commands": commands, "out": str(folder)}), indent=1))
    else:
        head = f"{scenario.name}: {scenario.title}" if scenario.title else scenario.name
        notes = "".join(f"\n  note  {note}" for note in scenario.notes if same)  # of the file as it stands
        print(words(summary, head + notes, commands, str(folder)))
    return 1 if summary.failed else 0


def _report(order: Order, varied: list[Varied], table: Any, summary: Summary, commands: list[str]) -> str:
    from terrapin_tools.batch.report import render

    options = [
        ("--seeds", order.seeds),
        *(("--vary", text) for text in order.vary),
        ("--design", order.design),
        ("--points", "" if order.points is None else str(order.points)),
        ("--draw", str(order.draw or "")),
        *(("--metric", text) for text in order.metrics),
        ("--until", "FAIL" if order.until_failed else ""),
    ]
    words = [word for name, value in options if value for word in (name, value)]
    return render(shlex.join(["terrapin", "batch", order.scenario, *words]), table, summary, commands)
