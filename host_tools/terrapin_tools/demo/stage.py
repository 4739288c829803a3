"""Where the demonstration plays: the folder it writes to, and how it tells people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from terrapin_tools.demo.page import Chapter

__all__ = ["Stage"]


@dataclass(frozen=True)
class Stage:
    """`say` prints a line, `progress` takes the share done of the present step, 0 to 1."""

    out: Path
    say: Callable[[str], None]
    progress: Callable[[float], None]

    def tell(self, chapter: Chapter, line: str) -> None:
        """A sentence for the terminal and the page."""
        chapter.text.append(line)
        self.say(line)
