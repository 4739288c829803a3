"""Everything that the three papers show, into a folder: figures as SVG, numbers as JSON, one page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from terrapin_tools.papers import li_forced, li_rolling, reina, reina_soil, vella
from terrapin_tools.papers.figures import save
from terrapin_tools.papers.page import page
from terrapin_tools.papers.part import Part
from terrapin_tools.papers.verdict import worst
from terrapin_tools.workbench.files.json_text import to_json
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["build", "collect", "verdicts"]


def _order(part: Part) -> tuple[int, int]:
    """Figures before tables, by number, within a paper."""
    kind, number = part.title.split(" ")
    return (0 if kind == "Fig." else 1, int(number))


def collect(progress: Callable[[str], None] = lambda _: None) -> list[Part]:
    """All parts, paper by paper."""
    found = []
    for name, sources in (
        ("Reina et al. 2006", (reina.parts, reina_soil.parts)),
        ("Li et al. 2024", (li_rolling.parts, li_forced.parts)),
        ("Vella et al. 2024", (vella.parts,)),
    ):
        progress(name)
        found += sorted((part for source in sources for part in source()), key=_order)
    return found


def verdicts(parts: list[Part]) -> dict[str, Any]:
    """The checks for programs."""
    return {
        "schema": "terrapin.papers/1",
        "parts": [
            {
                "paper": part.paper,
                "part": part.title,
                "numbers": worst(part.checks, statements=False),
                "statements": worst(part.checks, statements=True),
                "checks": [asdict(check) for check in part.checks],
            }
            for part in parts
        ],
    }


def build(folder: Path, progress: Callable[[str], None] = lambda _: None) -> tuple[Path, list[Part]]:
    """Write figures, papers.json and papers.html into the folder; the same bytes every time."""
    parts = collect(progress)
    folder.mkdir(parents=True, exist_ok=True)
    progress("figures")
    files = {figure.name: save(figure, folder) for part in parts for figure in part.figures}
    write_whole(folder / "papers.json", to_json(verdicts(parts)))
    target = folder / "papers.html"
    write_whole(target, page(parts, files))
    return target, parts
