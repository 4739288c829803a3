"""The vocabulary of expressions: shapes in one column, factors beside them, and what they may act on.

Every shape is something an engineer would write down: a power, a root, a magnitude, a saturation, a dead zone, a step,
a decay, a deviation from a reference value. A prior factor says how much more a longer one must explain to be chosen.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from terrapin_tools.workbench.bases import formula_name, free_name
from terrapin_tools.workbench.case.case import Case

__all__ = ["LOWEST", "SHAPE_COST", "Scale", "Term", "factors", "product_text", "shapes", "targets"]

Array = npt.NDArray[np.float64]

SHAPE_COST = 0.35  # prior factor of a shape other than the column itself; chosen by hand
STEPS = 7  # thresholds of a step that are looked at; chosen by hand
LOWEST = 0.3  # of the range, for a threshold of a dead zone: below, it is nearly a straight line; chosen by hand
DECADE = 3.0  # ratio of a column's ends from which its logarithm is not nearly a straight line; chosen by hand
EDGES = 60  # thresholds of a step that its refit starts from; chosen by hand


@dataclass(frozen=True)
class Scale:
    """A parameter inside a shape: where its refit starts, its bounds, its unit, and further starts."""

    start: float
    low: float
    high: float
    unit: str = "1"
    grid: tuple[float, ...] = ()


@dataclass(frozen=True)
class Term:
    """A shape in one column: its formula, its scales by name, and its prior factor."""

    text: str
    scales: Mapping[str, Scale]
    prior: float
    plain: bool = True  # stands beside any factor; a step beside the direction of motion only
    centred: bool = False  # for what a law is multiplied with: its own constant keeps its meaning, and its bounds

    @property
    def starts(self) -> dict[str, float]:
        """Start value of each scale."""
        return {name: scale.start for name, scale in self.scales.items()}


@dataclass(frozen=True)
class Column:
    """What a shape is made of: a column's name in formulas, its values (rows,), its unit, and names that its scales may
    have. `lowest` and `free` as of `shapes`."""

    name: str
    values: Array
    unit: str
    x0: str
    w: str
    tau: str
    lowest: float = LOWEST
    free: bool = False

    @cached_property
    def low(self) -> float:
        return float(self.values.min())

    @cached_property
    def high(self) -> float:
        return float(self.values.max())

    @property
    def span(self) -> float:
        return self.high - self.low

    @property
    def size(self) -> float:
        return max(abs(self.low), abs(self.high))

    @property
    def one_sign(self) -> bool:
        return self.low >= 0.0 or self.high <= 0.0

    @property
    def of_motion(self) -> bool:
        """A state, known without noise: bends close to its ends show."""
        return self.lowest < LOWEST

    @property
    def middle(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def near(self) -> tuple[float, float]:
        """Around 0, where a bend shows."""
        return 0.02 * self.size, 1.2 * self.size

    @property
    def magnitude(self) -> str:
        return self.name if self.low >= 0.0 else f"abs({self.name})"

    @property
    def ends(self) -> tuple[float, float]:
        """Of the magnitude."""
        return (self.low, self.high) if self.low >= 0.0 else (0.0, self.size)

    def term(self, text: str, prior: float, **scales: tuple[float, tuple[float, float]]) -> Term:
        """`scales`: start and bounds of each, in the column's unit."""
        return Term(text, {key: Scale(start, *limits, self.unit) for key, (start, limits) in scales.items()}, prior)


def _powers(c: Column) -> Iterator[Term]:
    yield c.term(c.name, 1.0)
    yield c.term(f"{c.name}**2", SHAPE_COST)
    yield c.term(f"{c.name}**3", SHAPE_COST**1.5)
    yield c.term(f"{c.name}**4", SHAPE_COST**2.5)
    yield c.term(f"{c.magnitude}**1.5", SHAPE_COST**2)


def _of_an_angle(c: Column) -> Iterator[Term]:
    if c.unit == "rad" and c.span > 1.0:
        yield from (c.term(f"{wave}({c.name})", SHAPE_COST) for wave in ("sin", "cos"))


def _of_one_sign(c: Column) -> Iterator[Term]:
    if not c.one_sign:
        return
    yield Term(f"({c.name} {'-' if c.low >= 0.0 else '+'} {abs(c.middle):.3g})", {}, 1.0, centred=True)
    if c.low > 0.0 and c.high > DECADE * c.low and (c.free or c.unit in ("", "1")):
        yield Term(f"log({c.name}/{c.middle:.3g})", {}, SHAPE_COST, centred=True)
    yield c.term(f"sqrt({c.magnitude})", SHAPE_COST)
    if c.low >= 0.0:  # a deviation from a reference, which may lie outside what was measured
        for share in (0.0, 0.25, 0.5, 0.75):
            reference = {c.x0: (c.low + share * c.span, (c.low - c.size, c.high + c.size))}
            yield c.term(f"({c.name} - {c.x0})", 0.3 * SHAPE_COST, **reference)


def _of_both_signs(c: Column) -> Iterator[Term]:
    if c.one_sign:
        return
    yield c.term(f"abs({c.name})", SHAPE_COST)
    yield c.term(f"{c.name}*abs({c.name})", SHAPE_COST)
    yield c.term(f"sign({c.name})", SHAPE_COST)
    yield c.term(f"abs({c.name})**3", SHAPE_COST**2)
    yield c.term(f"sqrt(abs({c.name}))", SHAPE_COST**1.5)
    yield c.term(f"sign({c.name})*sqrt(abs({c.name}))", SHAPE_COST**1.5)


def _dead_zones(c: Column) -> Iterator[Term]:
    floor, top = c.ends
    dead = (floor + c.lowest * (top - floor), floor + 0.85 * (top - floor))  # outside, a threshold is a straight line
    for share in ((0.25,) if c.of_motion else ()) + (0.45, 0.7):
        edge = {c.w: (floor + share * (top - floor), dead)}
        yield c.term(f"max({c.magnitude} - {c.w}, 0)", SHAPE_COST**3, **edge)
        if not c.one_sign:
            yield c.term(f"sign({c.name})*max({c.magnitude} - {c.w}, 0)", SHAPE_COST**3, **edge)


def _stops(c: Column) -> Iterator[Term]:
    """A contact or a slack rope at one end of a motion; in a table, an offset and friction together look like one."""
    if c.one_sign or not c.of_motion:
        return
    for side, low, high in (("", c.low, c.high), ("-", -c.high, -c.low)):
        for share in (0.4, 0.7):
            edge = {c.w: (low + share * c.span, (low + 0.15 * c.span, high - 0.15 * c.span))}
            yield c.term(f"max({side}{c.name} - {c.w}, 0)", SHAPE_COST**3, **edge)


def _saturations(c: Column) -> Iterator[Term]:
    floor, top = c.ends
    if floor < 0.5 * top:  # else it is out of sight
        for share in (0.1, 0.3):
            start = (share * c.size, c.near)
            yield c.term(f"tanh({c.name}/{c.w})", 0.5 * SHAPE_COST**1.5, **{c.w: start})
            yield c.term(f"{c.name}/({c.magnitude} + {c.x0})", 0.5 * SHAPE_COST**1.5, **{c.x0: start})


def _logarithm_and_inverses(c: Column) -> Iterator[Term]:
    if c.low <= 0.0:
        return
    if c.unit in ("", "1"):
        yield c.term(f"log({c.name})", SHAPE_COST)
    else:
        yield c.term(f"log({c.name}/{c.x0})", SHAPE_COST, **{c.x0: (c.middle, (c.low, c.high))})
    if c.low > 0.02 * c.high:
        yield c.term(f"1/{c.name}", SHAPE_COST)
        yield c.term(f"1/{c.name}**2", SHAPE_COST**1.5)


def _decays(c: Column) -> Iterator[Term]:
    if c.low >= 0.0 and c.span > 0.0:
        for share in (0.06, 0.15, 0.4, 1.0):
            yield c.term(f"exp(-{c.name}/{c.tau})", 0.25 * SHAPE_COST, **{c.tau: (share * c.high, c.near)})
    else:
        for share in (0.15, 0.5):
            start = {c.tau: (share * c.size, c.near)}
            yield c.term(f"exp(-abs({c.name})/{c.tau})", 0.5 * SHAPE_COST**1.5, **start)


def _steps(c: Column) -> Iterator[Term]:
    yield from _steps_in(c.name, c.values, c.w, c.unit)
    if not c.one_sign:
        yield from _steps_in(f"abs({c.name})", np.abs(c.values), c.w, c.unit)


# Each is an entry: what it gives for a column. A further one needs nothing else.
SHAPES: tuple[Callable[[Column], Iterator[Term]], ...] = (
    _powers, _of_an_angle, _of_one_sign, _of_both_signs, _dead_zones, _stops, _saturations, _logarithm_and_inverses,
    _decays, _steps,
)  # fmt: skip


def shapes(
    name: str, values: Array, unit: str, taken: Collection[str] = (), lowest: float = LOWEST, free: bool = False
) -> list[Term]:
    """Terms in a column with these values (rows,) and unit ("1" for none or where it is not known).

    `lowest`: share of the column's range below which no threshold of a dead zone lies. `free`: formulas take the
    column's numbers as they are, without its unit.

    Scales have names that are not `taken`. Every term is sound in its units: what exp, tanh or log see has none.
    """
    x0, w, tau = (free_name(n, {*taken, name}) for n in ("x0", "w", "tau"))
    column = Column(name, values, unit, x0, w, tau, lowest, free)
    if set(np.unique(values)) == {0.0, 1.0}:  # in one group or not: every other shape is the same
        return [column.term(name, 1.0)]
    return [term for each in SHAPES for term in each(column)]


def _steps_in(name: str, values: Array, w: str, unit: str) -> list[Term]:
    """A jump where the column passes a value that lies between two that occur."""
    known = np.unique(values)
    if len(known) < 3:
        return []
    between = 0.5 * (known[1:] + known[:-1])
    inside = between[(between > np.quantile(values, 0.05)) & (between < np.quantile(values, 0.95))]
    if not len(inside):
        return []
    grid = tuple(sorted({float(f"{v:.6g}") for v in inside[np.linspace(0, len(inside) - 1, EDGES).astype(int)]}))
    edges = sorted({grid[i] for i in np.linspace(0, len(grid) - 1, STEPS).astype(int)})
    low, high, prior = float(known[0]), float(known[-1]), SHAPE_COST**2 / len(edges)
    return [Term(f"({name} > {w})", {w: Scale(edge, low, high, unit, grid)}, prior, plain=False) for edge in edges]


def factors(case: Case, target: str, main: str, values: Mapping[str, Array]) -> list[tuple[str, float, bool]]:
    """What may stand beside a shape of column `main` on a target: formula, prior factor, whether also beside a step."""
    return case.base.factors(target, main, values, {formula_name(role) for role in case.roles})


def targets(case: Case) -> list[tuple[str, float]]:
    """What an expression may act on, with prior factors: of the channels, those that are measured."""
    unmeasured = case.base.channels.keys() - case.channels.keys()
    return [(target, prior) for target, prior in case.base.targets() if target not in unmeasured]


def product_text(size: str, shape: str, factor: str) -> str:
    """`size * shape * factor` as one would write it.

    >>> product_text("k", "omega", "sign(omega)"), product_text("k", "sign(x)", "sign(x)"), product_text("k", "", "")
    ('k*abs(omega)', 'k', 'k')
    >>> product_text("k", "load", "load*sign(omega)")
    'k*load**2*sign(omega)'
    """
    shape = f"({shape})" if shape.startswith("1/") else shape
    text = "*".join(part for part in (size, shape, factor) if part)
    text = re.sub(r"\*sign\((\w+)\)(.*)\*sign\(\1\)$", r"\2", text)
    text = re.sub(r"\*(\w+)\*sign\(\1\)(?!\*\*)", r"*abs(\1)", text)
    return re.sub(r"\*([A-Za-z]\w*)\*\1(?!\w|\*\*)", r"*\1**2", text)
