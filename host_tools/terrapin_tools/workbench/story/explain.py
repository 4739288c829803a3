"""What was weighed for an answer, what came second, and what would turn it: `terrapin discover --explain`."""

from __future__ import annotations

import math

from terrapin_tools.workbench.discover.decide import ALONE, CREDIBLE, Weight
from terrapin_tools.workbench.discover.misfit import Step
from terrapin_tools.workbench.noise.mishaps import KINDS
from terrapin_tools.workbench.story.sentences import chance, in_sd, number, percent, spelt
from terrapin_tools.workbench.story.story import Findings, Short, Story

__all__ = ["explain", "short_answers"]

SHOWN = 8  # answers
WORDS = {
    "nothing": "only noise",
    "run": "a single run",
    "slope": "a single run on a slope",
    "change": "a change between two runs",
    "warming": "how the test begins",
    "start": "how each run begins",
    "lag": "an instrument that comes late",
    "expression": "one of the other formulas in",
    "rest": "the same with terms that add nothing, all together",
}


def explain(story: Story) -> str:
    """Lines for a terminal."""
    found = story.found
    if found is None:
        return "Nothing was weighed: discover did not look."
    if all(one.kind in ("nothing", "unknown", "rest", *KINDS) for one in found.weighed):
        return "Nothing could be weighed: these columns show no effect that the model's own parameters do not take up."
    lines = ["", "What was weighed (probability, and how much less likely than the first):"]
    own = [one for one in found.weighed if one.kind != "rest"]
    first = own[0].probability
    for one in [*own[:SHOWN], *(one for one in found.weighed if one.kind == "rest")]:
        less = "" if one is own[0] or one.kind == "rest" else f", {_times(first / one.probability)} times less"
        lines.append(f"  {chance(one.probability)}{less}: {_what(found, one)}")
    lines.append(
        f"One answer is told alone from {percent(ALONE)} of what all sets have together, else as many as have "
        f"{percent(CREDIBLE)}. What predicts the same on these rows is one answer, and its probability is the sum."
    )
    if own[1:]:
        odds = first / own[1].probability
        far = number(math.sqrt(2.0 * math.log(max(odds, 1.0))), 2)
        lines.append(
            f"What would turn it: {_what(found, own[1])}, if further rows spoke {_times(odds)} times more for it, as "
            f"one mean that lies {far} sd on its side would."
        )
    lines.append("Short answers first (terms, errors in noise sd, probability to be all that is missing):")
    for short in short_answers(found):
        errors = f"training {short.training}, held out {short.held_out}"
        lines.append(f"  {short.terms}: {short.name}: {errors}, {short.probability}")
    return "\n".join(lines)


def _times(odds: float) -> str:
    return number(odds, 2) if odds < 100.0 else number(float(f"{odds:.2g}"), 9)


def _what(found: Findings, one: Weight) -> str:
    sets = " or ".join(" + ".join(spelt(found, names)) for names in one.sets)
    curve = f"a curve in {one.column} that has no formula"
    if one.kind == "part":
        return f"{sets}, and {curve}"
    return sets or (curve if one.kind == "unknown" else f"{WORDS[one.kind]} {one.column}".rstrip())


def short_answers(found: Findings) -> tuple[Short, ...]:
    """The front of error against number of terms, in words."""

    def error(one: Step) -> float:
        return one.train_error if one.heldout_error is None else one.heldout_error

    return tuple(
        Short(
            terms=len(one.effects),
            name=" + ".join(spelt(found, one.effects)) or "the model as it is",
            training=in_sd(one.train_error),
            held_out=in_sd(one.heldout_error),
            probability=chance(one.probability),
            share=error(one) / error(found.front[0]),
        )
        for one in found.front
    )
