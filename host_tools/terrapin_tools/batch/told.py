"""A batch in words and as commands: what `terrapin batch` prints, and how a failed run is repeated alone."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from typing import Any

from terrapin_hil.robots import robot_words
from terrapin_tools.batch.design import Row
from terrapin_tools.batch.one_run import Answer
from terrapin_tools.batch.summary import QUANTILES, Summary

__all__ = ["repeat_command", "repeat_script", "value_text", "words"]

MOST_SHOWN = 5


def value_text(value: Any) -> str:
    """A value as `--set` and `--vary` read it.

    >>> value_text(True), value_text(0.1), value_text("4.0 V")
    ('true', '0.1', '4.0 V')
    """
    return str(value).lower() if isinstance(value, bool) else value if isinstance(value, str) else repr(value)


def repeat_command(scenario: str, row: Row) -> str:
    """The command line that does this run again, for a shell."""
    sets = [word for name, value in row.values for word in ("--set", f"{name}={value_text(value)}")]
    return shlex.join(["terrapin", "run", scenario, "--seed", str(row.seed), *sets, *robot_words()])


def repeat_script(scenario: str, failed: Iterable[tuple[Row, Answer]]) -> str:
    """A line for each failed run, with a comment that says what failed."""
    lines = []
    for row, answer in failed:
        why = answer.error or "; ".join(text for text, held in answer.checks.items() if not held)
        lines += [f"# run {row.number}: {' '.join(why.split())}", repeat_command(scenario, row)]
    return "\n".join(lines) + "\n" if lines else ""


def words(summary: Summary, head: str, commands: list[str], folder: str) -> str:
    """The summary as lines of text."""
    low, high = summary.limits
    lines = [
        head,
        f"  {summary.runs} runs, {summary.failed} failed: {100 * summary.failed / summary.runs:.3g} % "
        f"(95 % limits {100 * low:.3g} to {100 * high:.3g} %)",
    ]
    if summary.errors:
        none, (reason, count) = summary.errors == summary.runs, next(iter(summary.reasons.items()))
        lines.append(f"  {'none' if none else summary.errors} of them could {'' if none else 'not '}be run to the end")
        lines.append(f"  ended  {count:6d} x  {' '.join(reason.split())}")
    lines += [f"  failed {count:6d} x  {text}" for text, count in summary.checks.items() if count]
    named = {text: f"{text} [{summary.units[text]}]" if text in summary.units else text for text in summary.quantiles}
    width = max(map(len, named.values()), default=0)
    if width:
        lines.append("  " + " " * width + "".join(f"{100 * q:>10.0f} %" for q in QUANTILES))
    for text, values in summary.quantiles.items():
        shown = "".join("           -" if v is None else f"{v:12.4g}" for v in values)
        lines.append(f"  {named[text]:{width}}{shown}")
    lines += [f"  no value in {summary.missing[text]} runs: {text}: {why}" for text, why in summary.why_missing.items()]
    if summary.classes and summary.failed == summary.runs:
        lines.append("  all failed: nothing that was varied decides it")
    elif summary.failed and summary.classes and all(len(one) in (1, summary.runs) for one in summary.classes.values()):
        lines.append("  too few runs to say what decides whether it fails")
    elif summary.failed and summary.decides["failed"]:
        lines.append("  what decides whether it fails (share of the variance that the input alone explains):")
        lines += [f"    {share:5.2f}  {name}" for name, share in summary.decides["failed"].items()]
    if commands:
        lines.append("  repeat a failed run:")
        lines += [f"    {command}" for command in commands[:MOST_SHOWN]]
        if len(commands) > MOST_SHOWN:
            lines.append(f"    ... all {len(commands)} in {folder}/failed.sh")
    lines.append(f"  table, summary and report in {folder}")
    return "\n".join(lines)
