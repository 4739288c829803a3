"""A story as the card of the page, for notebooks, and in a few lines, for terminals: the words are the story's own."""

from __future__ import annotations

from functools import cache
from typing import Any

from terrapin_tools.workbench.story import sentences
from terrapin_tools.workbench.story.story import Story
from terrapin_tools.workbench.story.terminal import tell_shortly

__all__ = ["as_html", "as_lines"]

SHOWN = 4  # candidates
# Colours of the page (workbench/story/page_frame.py); a notebook's own text colour serves light and dark.
CARD = """<div style="border:1px solid #8886;border-radius:6px;padding:8px 12px;max-width:60em;line-height:1.45">
<div><b>{{ story.title }}</b> <span style="opacity:.7">{{ story.runs }} runs, {{ story.held_out|length }} held out ·
{{ story.model }}</span> <span style="color:#fff;background:{{ colour }};border-radius:9px;padding:1px 8px">
{{- story.chip }}</span></div>
<div>{{ story.headline }}</div>
{%- for place in story.where %}<div><b>{{ place.variable }}</b> {{ place.sentence }}</div>{% endfor %}
{%- for note in story.intake + story.notes %}<div style="opacity:.7">{{ note }}</div>{% endfor %}
{%- if cards %}<table><tr><th>{{ story.heading }}</th><th>{{ story.measure }}</th><th>held-out error</th><th></th></tr>
{%- for card in cards %}<tr><td><b>{{ card.proposal.effect }}</b>
{%- for name, value in card.values.items() %} {{ name }} = {{ amount(value) }}{{ stuck(value, " ") }}{% endfor %}</td>
<td>{{ chance(card.proposal.probability) }}</td><td>{{ in_sd(card.proposal.noise_ratio) }}</td>
<td>{{ card.reason }}</td></tr>{% endfor %}</table>{% endif %}
{%- if story.parameters %}<div>{% for name, value in story.parameters.items() %}<code>{{ name }} = {{ amount(value) }}
{{- stuck(value, " ") }}</code> {% endfor %}</div>{% endif %}
<table><tr><th>errors in noise sd</th><th>training</th><th>held out</th></tr>
{%- for rung in story.ladder %}<tr><td>{{ rung.added or "(base model)" }}</td><td>{{ in_sd(rung.train_error) }}</td>
<td>{{ in_sd(rung.heldout_error) }}</td></tr>{% endfor %}</table>
<div><b>Next:</b> {{ story.next.text }}</div></div>"""
COLOURS = {"adequate": "#0d7a70", "missing": "#c73650"}


@cache
def _template() -> Any:
    from jinja2 import Environment, StrictUndefined

    return Environment(autoescape=True, undefined=StrictUndefined).from_string(CARD)


def as_html(story: Story) -> str:
    """The card as HTML, every value escaped."""
    words = {name: getattr(sentences, name) for name in ("amount", "chance", "in_sd", "stuck")}
    named = sum(card.named for card in story.cards)
    cards = story.cards[: max(SHOWN, named)]
    return str(_template().render(words, story=story, cards=cards, colour=COLOURS.get(story.verdict, "#a86500")))


def as_lines(story: Story) -> tuple[str, str, str]:
    """What was asked of which model, the answer, and what to do next: a line each."""
    first = f"{story.title}: {story.runs} runs, {len(story.held_out)} held out, model {story.model}"
    return first, tell_shortly(story), f"Next: {story.next.text}"
