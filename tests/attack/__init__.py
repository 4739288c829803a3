"""Attacks: what somebody hostile, or a damaged file, tries, with counts.

An attack is a module here with `attack(count, seed) -> Result`; `make attack` (`python -m tests.attack`) finds them by
itself. All of it stays on this machine, and each part has a bound on time and memory. One by itself, with its own text:

python -m tests.attack.boot_frames --count 1000000 --seed 1
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Result", "run"]


@dataclass(frozen=True)
class Result:
    """Of an attack: how much was tried, and how much of it was taken, which must be nothing."""

    name: str
    tried: int
    taken: int
    note: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.tried} tried, {self.taken} taken; {self.note}"


def run(attack: Callable[[int, int], Result], count: int) -> int:
    """The command line of one attack; status 1 when anything was taken."""
    parser = argparse.ArgumentParser(description=attack.__doc__)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    return 1 if attack(options.count, options.seed).taken else 0
