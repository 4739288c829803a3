"""A story in plain words for a terminal or a pipe, in the order in which one asks.

Is anything missing, where does the model fail, what is missing, what could these runs show, what to do next; then the
numbers of the model.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from terrapin_hil.units import behind
from terrapin_tools.workbench.story.effect_picture import as_text, unnamed
from terrapin_tools.workbench.story.sentences import (
    amount,
    chance,
    change,
    differs,
    floor,
    in_sd,
    interval,
    number,
    spelt,
    stuck,
    taken,
    verdict,
)
from terrapin_tools.workbench.story.story import Card, Next, Rung, Story

__all__ = ["tell", "tell_change", "tell_shortly"]

SHOWN = 6  # candidates
UNLIKELY = 0.005  # probability below which a candidate is shown only when nothing else is
WIDTH = 120


def tell(story: Story) -> str:
    """The answer of compare or discover."""
    runs = f"{story.runs} run{'s' * (story.runs != 1)}, {len(story.held_out)} held out"
    lines = [f"{story.title}: {runs}, model {story.model} [{story.chip}]"]
    lines += [part for remark in story.intake for part in _wrapped(remark, "  ")]
    lines += ["", *_wrapped(story.headline), *([story.alarm] if story.alarm else [])]
    if story.where:
        lines += ["", "Where the model fails, on average over the range:"]
        lines += [f"  {place.variable} {place.sentence}" for place in story.where]
    if story.found and (curve := story.found.unknown):
        lines += [
            "",
            f"What is missing in {curve.channel}{behind(curve.channel_unit)}, no formula known:",
            *as_text(unnamed(curve)),
        ]
    lines += [part for note in story.notes for part in _wrapped(_plain(note), "  ")]
    lines += _candidates(story)
    if story.front:
        rows = [(str(s.terms), s.name, s.training, s.held_out, s.probability) for s in story.front]
        lines += ["", "Short answers first (errors in noise sd, probability to be all that is missing):"]
        lines += _table([("terms", "", "training", "held out", "probability"), *rows])
    if story.chances:
        lines += ["", "What these runs can show:", *_table(story.chances)]
    lines += ["", *_next(story.next)]
    if story.parameters:
        lines += ["", "Parameters:", *_table([(k, _plain(amount(v)), stuck(v)) for k, v in story.parameters.items()])]
    if story.intervals:
        lines += ["", "Profile intervals, 95 %:", *_table([interval(key, one) for key, one in story.intervals.items()])]
    if story.groups:
        lines += ["", "Between groups:", *(f"  {differs(one, story.level)}" for one in story.groups)]
    channels = [
        (name, *(number(v) for v in (c.noise_sd, c.train_rmse, c.heldout_rmse)), "" if c.unit == "1" else c.unit)
        for name, c in story.channels.items()
    ]
    lines += ["", f"Errors ({story.noise_told}):"]
    lines += _table([("channel", "noise sd", "training rms", "held-out rms", ""), *channels])
    ladder = [(_added(story, rung), *_errors(rung)) for rung in story.ladder]
    lines += ["", *_wrapped(f"Errors in noise sd ({floor(story.noise)}):")]
    lines += _table([("added", "training", "held out"), *ladder])
    return "\n".join(lines)


def _added(story: Story, rung: Rung) -> str:
    """What a step adds, an expression by what it says."""
    if not rung.added:
        return "(base model)"
    return rung.added if story.found is None else " + ".join(spelt(story.found, rung.added.split("+")))


def tell_change(done: str, before: Rung, now: Rung, after: Story) -> str:
    """What `terrapin add` and `remove` say: errors before and after, then what compare says now."""
    return f"{done}\n{change(before, now)}\n\n{tell(after)}"


def tell_shortly(story: Story) -> str:
    """A line for one of many cases."""
    errors = " -> ".join(in_sd(rung.heldout_error) for rung in story.ladder)
    return f"[{story.chip}] {verdict(story.found, story.p_value)}; held-out error {errors}"


def _candidates(story: Story) -> list[str]:
    """What is named, with the values of its parameters; then a line a candidate."""
    found = story.found
    if found is None or not story.cards:
        return []
    missing = [card for card in story.cards if card.proposal.effect in found.missing]
    lines = ["", f"{story.heading}:", *(line for card in missing for line in _named(card))]
    shown = [c for c in story.cards if c.proposal.probability >= UNLIKELY or c in missing][:SHOWN] or story.cards[:1]
    rows = [
        (one.effect, chance(one.probability), in_sd(one.noise_ratio), taken(one), card.reason)
        for card in shown
        for one in [card.proposal]
    ]
    lines += _table([("candidate alone", story.measure, "held-out error", "explains", ""), *rows])
    return lines + [_formula(card) for card in shown if card.acts and card not in missing]


def _named(card: Card) -> list[str]:
    head = _formula(card) if card.acts else f"  {card.proposal.effect}: {card.title}"
    return [head, *(f"    {name} = {_plain(amount(v))}{stuck(v, ' ')}" for name, v in card.values.items())]


def _formula(card: Card) -> str:
    """What an expression says: its name tells nothing."""
    return f"  {card.proposal.effect} = {card.proposal.expression}, {card.acts}"


def _next(step: Next) -> list[str]:
    lines = _wrapped(f"Next: {step.text}")
    lines += _table([("", *step.vary), *step.settings]) if step.settings else []
    lines += _wrapped(step.after, "  ") if step.after else []
    return lines + ([f"{step.offer}:  {step.command}"] if step.command else [])


def _errors(rung: Rung) -> tuple[str, str]:
    return in_sd(rung.train_error), in_sd(rung.heldout_error)


def _plain(text: str) -> str:
    """For a terminal that knows ASCII only."""
    return text.replace("±", "+-").replace("µ", "u")


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)


def _table(rows: Iterable[Sequence[str]]) -> list[str]:
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows]
