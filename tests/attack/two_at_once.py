"""Two `terrapin add` at one case at the same moment: both are in it, or one is refused in one line."""

from __future__ import annotations

import shutil
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

from tests.attack import Result
from tests.attack.forked import Outcome, together

COUNT, SHORT = 100, 3
ROOT = Path(__file__).resolve().parents[2]
EFFECTS = ("current_offset", "stribeck")


def tried(count: int) -> Iterator[tuple[str, list[Outcome]]]:
    """What is wrong ("" when nothing is), and what the two said, `count` times."""
    with tempfile.TemporaryDirectory() as name:
        for _ in range(count):
            case = Path(name, "case")
            shutil.copytree(ROOT / "cases" / "heated_motor", case)
            before = tomllib.loads((case / "case.toml").read_text(encoding="utf-8"))["model"].get("effects", [])
            said = together([("add", "case", effect) for effect in EFFECTS], Path(name))
            after = tomllib.loads((case / "case.toml").read_text(encoding="utf-8"))["model"].get("effects", [])
            added = {effect for effect, one in zip(EFFECTS, said, strict=True) if one.status == 0}
            wrong = next((found for one in said if (found := one.wrong(seconds=60.0))), "")
            if not wrong and (not added or set(after) != {*before, *added}):
                wrong = f"said {sorted(added)}, has {after}"
            yield wrong, said
            shutil.rmtree(case)


def attack(count: int, seed: int) -> Result:
    """`count` pairs of commands; the draws are the scheduler's."""
    del seed
    total = taken = both = 0
    first = ""
    for wrong, said in tried(count):
        total += 1
        both += all(one.status == 0 for one in said)
        if wrong:
            taken += 1
            first = first or f"; first: {wrong}"
    return Result("two commands at one case", total, taken, f"both in {both} times, else one refused{first}")
