"""One run of a batch, wherever it is worked on: a scenario with a seed and values, and what came of it.

A run depends on the plan and its row alone, so its answer is the same byte for byte in any process of the same program.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from terrapin_hil.reading import Section, parse_toml
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.changes import changed
from terrapin_hil.scenario.checks import CheckError, parse_number
from terrapin_hil.scenario.scenario import Scenario, read_scenario
from terrapin_hil.telemetry import words
from terrapin_tools.batch.design import Row, Varied
from terrapin_tools.batch.journal import Journal
from terrapin_tools.contact_error import contact_error
from terrapin_tools.errors import UserError, about

__all__ = ["CONTACT_ERROR", "METRICS", "Answer", "Plan", "refuse_ends", "scenario_of", "work"]

METRICS = ("last(position)", "max(abs(slip))", "max(abs(current))", "max(winding_temperature)")
CONTACT_ERROR = "contact_error"  # rms error of C_t [N m], as `terrapin run --parameters` states it


@dataclass(frozen=True)
class Plan:
    """What all runs of a batch share: the scenario's file, and numbers of a run to keep, in the language of checks."""

    file: str
    source: str
    metrics: tuple[str, ...] = METRICS


@dataclass(frozen=True)
class Answer:
    """What came of a run; `error`: why there is none. NaN in `numbers` is what had no value."""

    number: int
    passed: bool
    error: str = ""
    checks: Mapping[str, bool] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    output: str = ""  # SHA-256 over every frame that the controller sent


@lru_cache(maxsize=4)
def _tables(plan: Plan) -> dict[str, Any]:
    return parse_toml(plan.source, Path(plan.file))


@lru_cache(maxsize=4)
def _scenario(plan: Plan, values: tuple[tuple[str, Any], ...]) -> Scenario:
    tables = changed(_tables(plan), dict(values))
    return read_scenario(Section(tables, Path(plan.file).name, plan.source), Path(plan.file).stem)


def scenario_of(plan: Plan, row: Row) -> Scenario:
    """The scenario as the row has it. UserError for values that it refuses."""
    return replace(_scenario(plan, row.values), seed=row.seed, real_time=False)


def refuse_ends(plan: Plan, varied: Iterable[Varied]) -> None:
    """UserError unless the scenario is right as it stands, has every metric, and takes each end of what is varied."""
    scenario = _scenario(plan, ())
    for one in varied:
        for value in one.ends:
            with about(f"--vary {one.name}", UserError):
                _scenario(plan, ((one.name, value),))
    for text in plan.metrics:
        with about(f"--metric {text!r}", CheckError):
            short = run(replace(scenario, duration=2e-3, checks=(), provokes=None))
            parse_number(text).number(short.time, short.signals, words(short.interface))


def work(plan: Plan, rows: Iterable[Row], folder: Path | None = None) -> list[Answer]:
    """The answers to some rows. Whatever is wrong with one is in its `error`.

    With a folder, each answer is in this process's journal there before the next run begins; UserError when it cannot
    be written.
    """
    from threadpoolctl import threadpool_limits

    answers = []
    with threadpool_limits(limits=1):
        for row in rows:
            answers.append(_answer(plan, row))
            if folder is not None:
                Journal.mine(folder).write(vars(answers[-1]))
    return answers


def _answer(plan: Plan, row: Row) -> Answer:
    try:
        return _held(plan, row, run(scenario_of(plan, row)))
    except (UserError, ValueError) as error:  # values that do not go together, a robot that runs away
        return Answer(row.number, False, str(error))
    except MemoryError:
        return Answer(row.number, False, "out of memory")


def _held(plan: Plan, row: Row, result: Result) -> Answer:
    time, signals, enums = result.time, result.signals, words(result.interface)
    numbers = {text: parse_number(text).number(time, signals, enums) for text in plan.metrics}
    error = contact_error(result)
    numbers[CONTACT_ERROR] = math.nan if error is None else error.rms
    for outcome in result.outcomes:
        numbers |= outcome.numbers
    checks = {outcome.text: outcome.passed for outcome in result.outcomes}
    return Answer(row.number, result.passed, "", checks, numbers, result.output_hash)
