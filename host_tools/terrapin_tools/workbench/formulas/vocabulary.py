"""The vocabulary of expressions: shapes in one column, factors beside them, and what they may act on.

Every shape is something an engineer would write down: a power, a root, a magnitude, a saturation, a dead zone, a step,
a decay, a deviation from a reference value. A prior factor says how much more a longer one must explain to be chosen.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

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


def shapes(
    name: str, values: Array, unit: str, taken: Collection[str] = (), lowest: float = LOWEST, free: bool = False
) -> list[Term]:
    """Terms in a column with these values (rows,) and unit ("1" for none or where it is not known).

    `lowest`: share of the column's range below which no threshold of a dead zone lies. `free`: formulas take the
    column's numbers as they are, without its unit.

    Scales have names that are not `taken`. Every term is sound in its units: what exp, tanh or log see has none.
    """
    x0, w, tau = (free_name(n, {*taken, name}) for n in ("x0", "w", "tau"))
    low, high = float(values.min()), float(values.max())
    size, span = max(abs(low), abs(high)), high - low
    one_sign = low >= 0.0 or high <= 0.0
    near = (0.02 * size, 1.2 * size)  # of 0, where a bend shows

    def term(text: str, prior: float, **scales: tuple[float, tuple[float, float]]) -> Term:
        return Term(text, {key: Scale(start, *limits, unit) for key, (start, limits) in scales.items()}, prior)

    if set(np.unique(values)) == {0.0, 1.0}:  # in one group or not: every other shape is the same
        return [term(name, 1.0)]
    magnitude = name if low >= 0.0 else f"abs({name})"
    floor, top = (low, high) if one_sign and low >= 0.0 else (0.0, size)
    found = [
        term(name, 1.0),
        term(f"{name}**2", SHAPE_COST),
        term(f"{name}**3", SHAPE_COST**1.5),
        term(f"{name}**4", SHAPE_COST**2.5),
        term(f"{magnitude}**1.5", SHAPE_COST**2),
    ]
    if unit == "rad" and span > 1.0:
        found += [term(f"{wave}({name})", SHAPE_COST) for wave in ("sin", "cos")]
    if one_sign:
        middle = f"{'-' if low >= 0.0 else '+'} {abs(0.5 * (low + high)):.3g}"
        found.append(Term(f"({name} {middle})", {}, 1.0, centred=True))
        if low > 0.0 and high > DECADE * low and (free or unit in ("", "1")):
            found.append(Term(f"log({name}/{0.5 * (low + high):.3g})", {}, SHAPE_COST, centred=True))
        found.append(term(f"sqrt({magnitude})", SHAPE_COST))
        if low >= 0.0:  # a deviation from a reference, which may lie outside what was measured
            for share in (0.0, 0.25, 0.5, 0.75):
                reference = {x0: (low + share * span, (low - size, high + size))}
                found.append(term(f"({name} - {x0})", 0.3 * SHAPE_COST, **reference))
    else:
        found += [
            term(f"abs({name})", SHAPE_COST),
            term(f"{name}*abs({name})", SHAPE_COST),
            term(f"sign({name})", SHAPE_COST),
            term(f"abs({name})**3", SHAPE_COST**2),
            term(f"sqrt(abs({name}))", SHAPE_COST**1.5),
            term(f"sign({name})*sqrt(abs({name}))", SHAPE_COST**1.5),
        ]
    dead = (floor + lowest * (top - floor), floor + 0.85 * (top - floor))  # outside, a threshold is a straight line
    for share in ((0.25,) if lowest < 0.25 else ()) + (0.45, 0.7):
        edge = {w: (floor + share * (top - floor), dead)}
        found.append(term(f"max({magnitude} - {w}, 0)", SHAPE_COST**3, **edge))
        if not one_sign:
            found.append(term(f"sign({name})*max({magnitude} - {w}, 0)", SHAPE_COST**3, **edge))
    if floor < 0.5 * top:  # else a saturation is out of sight
        for share in (0.1, 0.3):
            prior = 0.5 * SHAPE_COST**1.5
            found.append(term(f"tanh({name}/{w})", prior, **{w: (share * size, near)}))
            found.append(term(f"{name}/({magnitude} + {x0})", prior, **{x0: (share * size, near)}))
    if low > 0.0:
        if unit in ("", "1"):
            found.append(term(f"log({name})", SHAPE_COST))
        else:
            found.append(term(f"log({name}/{x0})", SHAPE_COST, **{x0: (0.5 * (low + high), (low, high))}))
        if low > 0.02 * high:
            found += [term(f"1/{name}", SHAPE_COST), term(f"1/{name}**2", SHAPE_COST**1.5)]
    if low >= 0.0 and span > 0.0:
        for share in (0.06, 0.15, 0.4, 1.0):
            found.append(term(f"exp(-{name}/{tau})", 0.25 * SHAPE_COST, **{tau: (share * high, near)}))
    else:
        for share in (0.15, 0.5):
            found.append(term(f"exp(-abs({name})/{tau})", 0.5 * SHAPE_COST**1.5, **{tau: (share * size, near)}))
    found += _steps(name, values, w, unit)
    if not one_sign:
        found += _steps(f"abs({name})", np.abs(values), w, unit)
    return found


def _steps(name: str, values: Array, w: str, unit: str) -> list[Term]:
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
