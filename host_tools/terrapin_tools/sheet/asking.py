"""Questions at a terminal for what a data sheet says; an empty answer where it says nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from terrapin_tools.errors import UserError
from terrapin_tools.sheet.figures import FIGURES, lacking, read

__all__ = ["asked"]

TRIES = 3  # at one question


def asked(given: Mapping[str, str], ask: Callable[[str], str], told: Callable[[str], None] = print) -> dict[str, str]:
    """`given` with the answers of `ask`, which gets each question whose figure is not given. UserError where a question
    has no good answer after three."""
    found = {name: text for name, text in given.items() if text}
    told("An empty answer where the sheet says nothing, or for what stands in brackets.")
    for name, figure in FIGURES.items():
        if name in found or (figure.needed not in ("", "always") and figure.needed != _kind(found)):
            continue
        choice = f" ({', '.join(figure.words)})" if figure.words else f", like {figure.example}"
        default = f" [{figure.default}]" if figure.default else ""
        for _ in range(TRIES):
            answer = ask(f"{name.replace('_', ' ')}, {figure.meaning}{choice}{default}: ").strip()
            if not answer and not figure.default and name in lacking(found):
                told("this one is needed")
                continue
            try:
                read({name: answer}, alone=True)
            except UserError as error:
                told(str(error))
                continue
            found |= {name: answer} if answer else {}
            break
        else:
            raise UserError(f"{name.replace('_', ' ')}: no answer that can be used after {TRIES} tries")
    return found


def _kind(found: Mapping[str, str]) -> str:
    return found.get("kind", FIGURES["kind"].default)
