"""Which runs a batch has: seeds, and the values of what is varied.

    varied = [read_varied("path.1.slope=0deg:14deg"), read_varied("path.1.terrain=sand,dry_peat")]
    rows = design(read_seeds("1:1000"), varied, "sobol")
    rows[0].seed, rows[0].values

Everything is drawn here, once, from the design's own seed, so a run does not depend on who works on it.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.scenario.changes import place_of, read_value
from terrapin_tools.errors import UserError

__all__ = ["DESIGNS", "MOST_RUNS", "Row", "Varied", "design", "read_seeds", "read_varied"]

MOST_RUNS = 1_000_000
MOST_STEPS = 100_000
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_SEEDS = re.compile(r"\d{1,19}(?::\d{1,19})?")


@dataclass(frozen=True)
class Varied:
    """One field of the scenario and the values it takes: `levels`, or anything from `low` to `high` in `unit`."""

    name: str
    levels: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 0.0
    unit: str = ""

    @property
    def ends(self) -> tuple[Any, ...]:
        """Every value that must be one the field takes: of a range both ends."""
        return self.levels or (self.with_unit(self.low), self.with_unit(self.high))

    def with_unit(self, number: float) -> float | str:
        """As it stands in a scenario's file."""
        return f"{number!r} {self.unit}" if self.unit else number

    def at(self, share: float) -> Any:
        """The value at a share of the range, 0 to 1; of levels each has an equal part.

        >>> Varied("robot.coulomb", low=0.0, high=20.0, unit="mN m").at(0.25)
        '5.0 mN m'
        """
        if self.levels:
            return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]
        return self.with_unit(self.low + share * (self.high - self.low))


@dataclass(frozen=True)
class Row:
    """One run: its number in the batch, from 0; its seed; the values by name that it has in place of the scenario's."""

    number: int
    seed: int
    values: tuple[tuple[str, Any], ...] = ()


def read_seeds(text: str) -> Sequence[int]:
    """`1:1000` (both ends), `7`, or several of them after commas. UserError says what was expected.

    >>> list(read_seeds("3:5,9"))
    [3, 4, 5, 9]
    """
    parts: list[range] = []
    for part in text.split(","):
        if not _SEEDS.fullmatch(part):
            raise UserError(f"--seeds: found {text[:80]!r}, expected whole numbers such as 1:1000 or 1,5,9")
        first, _, last = part.partition(":")
        parts.append(range(int(first), int(last or first) + 1))
        if not parts[-1] or parts[-1][-1] >= 2**63:
            raise UserError(f"--seeds: found {part}, expected the lower one first, and less than 2^63")
    if sum(map(len, parts)) > MOST_RUNS:
        raise UserError(f"--seeds: found {sum(map(len, parts))} seeds, expected at most {MOST_RUNS}")
    if len(parts) == 1:
        return parts[0]
    seeds = list(itertools.chain(*parts))
    if len(set(seeds)) < len(seeds):
        raise UserError(f"--seeds: found a seed twice in {text[:80]!r}")
    return seeds


def read_varied(text: str) -> Varied:
    """NAME=LOW:HIGH, NAME=LOW:HIGH:STEPS or NAME=VALUE,VALUE,... UserError says what was expected.

    >>> read_varied("path.1.slope=0deg:14deg:3").levels
    ('0.0 deg', '7.0 deg', '14.0 deg')
    """
    name, equals, spec = text.partition("=")
    name = name.strip()
    if not equals or not spec.strip():
        raise UserError(f"--vary: found {text[:80]!r}, expected NAME=LOW:HIGH or NAME=VALUE,VALUE,...")
    place_of(name)
    if name == "seed":
        raise UserError("--vary seed: expected --seeds")
    if ":" not in spec:
        levels = tuple(_level(word.strip()) for word in spec.split(","))
        if len({repr(level) for level in levels}) < len(levels) or "" in levels:
            raise UserError(f"--vary {name}: found {spec[:80]!r}, expected different values between the commas")
        return Varied(name, levels)
    low, high, *rest = spec.split(":")
    (bottom, unit), (top, other) = _quantity(name, low), _quantity(name, high)
    if unit and other and unit != other:
        raise UserError(f"--vary {name}: found the units {unit} and {other}, expected the same at both ends")
    if not bottom < top:
        raise UserError(f"--vary {name}: found {spec[:80]}, expected the lower end first")
    found = Varied(name, (), bottom, top, unit or other)
    if not rest:
        return found
    if len(rest) > 1 or not rest[0].strip().isdigit() or not 2 <= int(rest[0]) <= MOST_STEPS:
        raise UserError(f"--vary {name}: found {spec[:80]}, expected LOW:HIGH:STEPS with 2 to {MOST_STEPS} steps")
    steps = np.linspace(bottom, top, int(rest[0])).tolist()
    return Varied(name, tuple(found.with_unit(step) for step in steps))


def _level(word: str) -> Any:
    """One of a list: a number with a unit is written as those of a range are."""
    match = _QUANTITY.fullmatch(word)
    return f"{float(match[1])!r} {match[2]}" if match and match[2] else read_value(word)


def _quantity(name: str, text: str) -> tuple[float, str]:
    match = _QUANTITY.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise UserError(f"--vary {name}: found {text[:80]!r}, expected a number, which may have a unit")
    return float(match[1]), match[2]


DESIGNS = ("grid", "random", "lhs", "sobol")


def _shares(kind: str, count: int, width: int, seed: int) -> Array:
    """Points (count, width) of a design that is no grid, each coordinate from 0 to 1."""
    random = np.random.default_rng(seed)
    if kind == "random":
        return random.random((count, width))
    from scipy.stats import qmc

    if kind == "lhs":
        return np.asarray(qmc.LatinHypercube(width, rng=random).random(count))
    sampler = qmc.Sobol(width, scramble=True, rng=random)
    return np.asarray(sampler.random_base2(max(0, math.ceil(math.log2(count))))[:count])


def design(
    seeds: Sequence[int], varied: Sequence[Varied], kind: str = "", points: int | None = None, draw: int = 0
) -> Iterable[Row]:
    """The runs in order.

    `kind`: of DESIGNS; "" is a grid where everything varied has levels, else "sobol". A grid has every combination
    with every seed. The others have `points` points, each with every seed; without `points` one point for each seed.
    `draw`: seed of the design. UserError where they do not fit.
    """
    if len({one.name for one in varied}) < len(varied):
        raise UserError("--vary: found a name twice")
    kind = kind or ("grid" if all(one.levels for one in varied) else "sobol")
    if kind not in DESIGNS:
        raise UserError(f"--design: found {kind!r}, expected one of {', '.join(DESIGNS)}")
    if kind == "grid" or not varied:
        if points is not None:
            raise UserError("--points: a grid has its own, expected --design random, lhs or sobol and a --vary")
        if ranges := [one.name for one in varied if not one.levels]:
            raise UserError(f"--vary {ranges[0]}: a grid needs steps, expected LOW:HIGH:STEPS or a list of values")
        _bounded(math.prod(len(one.levels) for one in varied) * len(seeds))
        return _grid(seeds, varied)
    _bounded(len(seeds) * (points or 1))
    count = len(seeds) if points is None else points
    return _sampled(seeds, varied, _shares(kind, count, len(varied), draw), points is None)


def _bounded(count: int) -> None:
    if count > MOST_RUNS:
        raise UserError(f"batch: found {count} runs, expected at most {MOST_RUNS}")


def _grid(seeds: Sequence[int], varied: Sequence[Varied]) -> Iterable[Row]:
    names = [one.name for one in varied]
    numbers = itertools.count()
    for levels in itertools.product(*(one.levels for one in varied)):
        values = tuple(zip(names, levels, strict=True))
        for seed in seeds:
            yield Row(next(numbers), seed, values)


def _sampled(seeds: Sequence[int], varied: Sequence[Varied], shares: Array, paired: bool) -> Iterable[Row]:
    numbers = itertools.count()
    for i, point in enumerate(shares.tolist()):
        values = tuple((one.name, one.at(share)) for one, share in zip(varied, point, strict=True))
        for seed in seeds[i : i + 1] if paired else seeds:
            yield Row(next(numbers), seed, values)
