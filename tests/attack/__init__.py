"""Attacks on what a robot trusts: each module has `attack(count, seed)`, which prints one line and returns a Result.

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
    note: str

    def __str__(self) -> str:
        return f"{self.name}: {self.tried} tried, {self.taken} taken; {self.note}"


def run(attack: Callable[[int, int], Result], count: int) -> int:
    """The command line of one attack; status 1 when anything was taken."""
    parser = argparse.ArgumentParser(description=attack.__doc__)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    return 1 if attack(options.count, options.seed).taken else 0
