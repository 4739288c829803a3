"""A change of a case's model, for `terrapin add` and `remove`: fitted before and after, written, remembered, told."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from terrapin_hil.physics.expression import parse
from terrapin_tools.errors import UserError, about
from terrapin_tools.progress import step
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.case.changes import OwnEffect, extended, remove_effect
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.story import Rung, Story
from terrapin_tools.workbench.story.terminal import tell_change
from terrapin_tools.workbench.story.told import told

__all__ = ["carry_out", "with_effects", "without_effect"]


def with_effects(
    case: Case,
    effects: Sequence[str],
    own: Mapping[str, OwnEffect],
    expression: str = "expression",
    parameter: str = "parameters",
    target: str = "target",
) -> str:
    """case.toml with effects added, those of the user's `own` among them.

    UserError for one that is there, and for a formula that does not fit; it then names who said it (`expression`,
    `parameter`, `target`), not a line of a file that is not written.
    """
    for name in effects:
        if name in case.effects or effects.count(name) > 1:
            raise UserError(f"{case.folder / 'case.toml'}: model.effects: {name} is in the model already")
    for effect in (one for one in own.values() if not one.mend):
        with about(expression):
            names = parse(effect.expression).names
        known = {*case.inputs, *case.parameters, *case.fit, *effect.parameters, "speed"}
        known |= {formula_name(name) for name in case.base.provides}
        unknown = sorted(names - known)
        if unknown:
            expected = ", ".join(sorted(known))
            raise UserError(f"{expression}: {unknown[0]} is no role, column or parameter, expected one of {expected}")
        unused = sorted(set(effect.parameters) - names)
        if unused:
            raise UserError(f"{parameter}: {unused[0]} does not occur in the expression {effect.expression}")
        if effect.target is not None and effect.target not in case.base.acts_on():
            raise UserError(f"{target}: found {effect.target!r}, expected one of {', '.join(case.base.acts_on())}")
    return extended(case.text, case.stated, effects, own)


def without_effect(case: Case, effect: str) -> str:
    """case.toml without an effect of the model. UserError when it is not in it."""
    if effect not in case.effects:
        found = ", ".join(case.effects) or "none"
        raise UserError(
            f"{case.folder / 'case.toml'}: model.effects: {effect} is not in the model, expected one of {found}"
        )
    return remove_effect(case.text, effect)


def carry_out(present: Case, text: str, action: str, effects: list[str], seed: int) -> tuple[dict[str, Any], str]:
    """Give the case the new text of its case.toml. `action`: added, removed, "held out" or set. Returns JSON and words.

    UserError when the text is no sound case, or case.toml changed since `present` was read; nothing is written then.
    """
    begin = time.monotonic()
    changed = present.changed(text)
    with step("fit"):
        before, after = (told(analyse(case, seed)) for case in (present, changed))
    history.rewrite(present.folder, present.text, text)
    after = replace(after, seconds=time.monotonic() - begin)
    rungs = _sides(before, after, effects if action == "added" else [])
    old, new = ({"train_error": rung.train_error, "heldout_error": rung.heldout_error} for rung in rungs)
    said = {**answer(after), action: effects, "before": old, "after": new}
    history.remember(present.folder, action, effects, said)
    where = f"{ {'added': 'to', 'removed': 'from'}.get(action, 'in') } {present.folder / 'case.toml'}"
    return said, tell_change(f"{action.capitalize()} {', '.join(effects)} {where}.", *rungs, after)


def _sides(before: Story, after: Story, added: list[str]) -> tuple[Rung, Rung]:
    """The errors before and after; of what was `added` in one noise sd: that of the ladder that has them both."""
    last = after.ladder[-1 - len(added) :]
    if added and [rung.added for rung in last[1:]] == added:
        return last[0], last[-1]
    return before.ladder[-1], after.ladder[-1]
