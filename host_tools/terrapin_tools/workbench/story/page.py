"""One self-contained HTML page of a case: verdict, where it fails, what is missing, the ladder, what to do next."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from jinja2 import Environment, StrictUndefined

from terrapin_hil.physics.effects import Effect
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.story import sentences
from terrapin_tools.workbench.story.effect_picture import as_svg
from terrapin_tools.workbench.story.formulas import from_latex, of_model
from terrapin_tools.workbench.story.notes import to_html
from terrapin_tools.workbench.story.page_frame import PAGE, STYLE
from terrapin_tools.workbench.story.page_script import plots_script, plots_style
from terrapin_tools.workbench.story.plot_data import CARDS, page_data, previews
from terrapin_tools.workbench.story.story import Story

__all__ = ["page_of", "render"]


def page_of(analysis: Analysis, story: Story, history: Sequence[Mapping[str, Any]] = ()) -> str:
    """The page of a case; `history` of its steps."""
    data = page_data(analysis, story, previews(analysis, story))
    return render(story, data, history, analysis.model.effects, analysis.case.notes, of_model(analysis.case.text))


def render(
    story: Story,
    data: Mapping[str, Any],
    history: Sequence[Mapping[str, Any]] = (),
    model: Sequence[Effect] = (),
    notes: str = "",
    formulas: Sequence[tuple[str, str]] = (),
) -> str:
    """The page as text.

    `data`: what its script draws, of plot_data; `history`: of the case's steps; `model`: the effects in it; `notes`:
    Markdown; `formulas`: of the case's own model, as `formulas.of_model` has them.
    """
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    words = {name: getattr(sentences, name) for name in ("amount", "chance", "floor", "in_sd", "number", "stuck")}
    named = sum(card.named for card in story.cards)
    return environment.from_string(PAGE).render(
        words,
        story=story,
        data=data,
        history=history,
        model=model,
        notes=to_html(notes),
        not_looked=sentences.NOT_LOOKED,
        mathml=from_latex,
        formulas=formulas,
        full=CARDS // 2 if story.verdict == "adequate" else max(CARDS, named),
        curve_svg=as_svg(story.found.unknown) if story.found and story.found.unknown else "",
        curves={tuple(effects): i for i, effects in enumerate(data["sets"])},
        json=json.dumps({**data, "by_run": story.by_run}, separators=(",", ":")).replace("<", "\\u003c"),
        style=STYLE + plots_style(),
        script=plots_script(),
    )
