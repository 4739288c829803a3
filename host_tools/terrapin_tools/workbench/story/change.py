"""A change of a case's model, for `terrapin add` and `remove`: fitted before and after, written, remembered, told."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from terrapin_tools.progress import step
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import Case, parse_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.files.writing import write_changed
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.terminal import tell_change
from terrapin_tools.workbench.story.told import told

__all__ = ["carry_out"]


def carry_out(present: Case, text: str, action: str, effects: list[str], seed: int) -> tuple[dict[str, Any], str]:
    """Give the case the new text of its case.toml. `action`: "added" or "removed". Returns JSON and words.

    UserError when the text is no sound case, or case.toml changed since `present` was read; nothing is written then.
    """
    begin = time.monotonic()
    changed = parse_case(present.folder, text)
    with step("fit"):
        before, after = (told(analyse(case, seed)) for case in (present, changed))
    write_changed(present.folder / "case.toml", present.text, text)
    after = replace(after, seconds=time.monotonic() - begin)
    old, new = (
        {"train_error": rung.train_error, "heldout_error": rung.heldout_error}
        for rung in (before.ladder[-1], after.ladder[-1])
    )
    said = {**answer(after), action: effects, "before": old, "after": new}
    history.remember(present.folder, action, effects, said)
    where = f"{'to' if action == 'added' else 'from'} {present.folder / 'case.toml'}"
    return said, tell_change(f"{action.capitalize()} {', '.join(effects)} {where}.", before, after)
