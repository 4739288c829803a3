"""What the data allow at all, worked out from the true design: no answer of the engine goes in here.

- `distance`: squared distance D2, in noise sd and whitened with the true AR(1) correlation over all rows, between what
  is in the data and the nearest that a set of effects can give with all its parameters and the model's own refitted.
  The best possible test then prefers the wrong one of the two in Phi(-sqrt(D2)/2) of the cases.
- Equivalence classes, declared: a set that comes nearer than SAME = 4 (the best test would be wrong in 16 of 100) is
  the same as the truth on these data. So is "nothing", if the model's own parameters take the effect up that far
  (dry friction at a constant load, where f_o is fitted, say). Two effects also fall into one class where one is tied to
  the other on purpose (row "cannot tell").
- `power`: of the exact likelihood ratio test at level 5 % with known noise and known direction; no test does better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.stats import ncx2

from tests.campaigns.drawn import CATALOGUE, Drawn
from tests.campaigns.formulas import predict

__all__ = ["SAME", "SHAPES", "Set", "distance", "oracle_heldout", "power", "refit", "right_columns"]

Array = npt.NDArray[np.float64]
SAME = 4.0
BOUNDS = {  # of effects' parameters, by physics (docs/cases.md)
    "cda": (0.0, np.inf),
    "j": (0.0, np.inf),
    "m_e": (0.0, np.inf),
    "m_c": (0.0, np.inf),
    "scale": (0.0, np.inf),
    "xi1": (0.0, np.inf),
    "xi2": (0.0, 0.95),
    "xi3": (0.5, 6.0),
    "omega_s": (0.05, 100.0),
    "a_t": (-0.01, 0.01),
    "g": (-0.9, 9.0),
    "m": (-2.0, 2.0),
    "kappa": (-3.0, 3.0),
    "lam": (0.0, 0.9),
}
SHAPES = {  # further starts of parameters that give an effect its shape
    "omega_s": (0.7, 2.0, 6.0, 20.0),
    "phase": (-1.6, 0.0, 1.6, 3.1),
    "k": tuple(float(k) for k in range(2, 65)),
    "xi2": (0.1, 0.3, 0.5),
    "xi3": (1.0, 2.0),
}
STEP = {"k_s": 1e3, "k_phi": 1e3, "c_w": 1.0, "k": 0.0}


class Set:
    """A set of effects on a drawn case: parameters as one vector, the model's own first."""

    def __init__(self, drawn: Drawn, effects: Sequence[str], foreign: bool = False) -> None:
        self.drawn, self.effects, self.foreign = drawn, tuple(effects), foreign
        library = CATALOGUE.get(drawn.design.base, {})
        self.base = list(drawn.design.fitted)
        self.own = [(e, key) for e in effects for key in (library[e].size, *(library[e].shape or {}))]
        self.sizes = [len(self.base) + i for i, (e, key) in enumerate(self.own) if key == library[e].size]
        keys = [*self.base, *(key for _, key in self.own), *(["foreign"] if foreign else [])]
        bounds = [drawn.design.fitted[k][2:] if k in self.base else BOUNDS.get(k, (-np.inf, np.inf)) for k in keys]
        self.lower, self.upper = (np.array(side, dtype=float) for side in zip(*bounds, strict=True))
        self.keys = keys
        self.whole = [i for i, key in enumerate(keys) if key == "k"]

    def predict(self, theta: Array) -> Array:
        made = self.drawn.design
        constants = {**made.true_constants(), **dict(zip(self.base, theta, strict=False))}
        effects: dict[str, dict[str, float]] = {e: {} for e in self.effects}
        for (effect, key), value in zip(self.own, theta[len(self.base) :], strict=False):
            effects[effect][key] = float(value)
        pair = None
        if self.foreign and self.drawn.foreign is not None:
            term = self.drawn.foreign[0]
            pair = (replace(term, amount=lambda _, k: term.amount(made.columns, k)), float(theta[-1]))
        found = predict(made.base, constants, made.inputs(), effects, pair)
        return np.stack([found[c] / self.drawn.sigma[c] for c in self.drawn.channels])

    def truth(self) -> Array:
        """True parameters; those of effects that are not in the data at 0, shapes in the middle."""
        values = [entry[0] for entry in self.drawn.design.fitted.values()]
        for effect, key in self.own:
            values.append(self.drawn.hidden.get(effect, {}).get(key, SHAPES.get(key, (0.0,))[0]))
        if self.foreign and self.drawn.foreign is not None:
            values.append(self.drawn.foreign[1])
        return np.clip(np.array(values), self.lower, self.upper)

    def slopes(self, theta: Array, function: Callable[[Array], Array], base: Array) -> Array:
        found = np.zeros((base.size, len(theta)))
        for i, key in enumerate(self.keys):
            if i in self.whole:
                continue
            step = STEP.get(key, 1e-6 * max(1.0, abs(theta[i])))
            step = -step if theta[i] + step > self.upper[i] else step
            moved = theta.copy()
            moved[i] += step
            found[:, i] = (function(moved) - base) / step
        return found


def _whiten(drawn: Drawn, values: Array) -> Array:
    """(channels, rows) -> one vector whose noise is independent with unit variance."""
    same = np.diff(drawn.design.run, prepend=-1) == 0
    white = values.copy()
    white[:, same] = (values[:, same] - drawn.rho * values[:, np.flatnonzero(same) - 1]) / np.sqrt(1 - drawn.rho**2)
    return white.reshape(-1)


def _minimise(chosen: Set, function: Callable[[Array], Array], start: Array) -> tuple[Array, float]:
    free = [i for i in range(len(start)) if i not in chosen.whole]

    def full(part: Array) -> Array:
        theta = start.copy()
        theta[free] = part
        return theta

    def slopes(part: Array) -> Array:
        theta = full(part)
        return chosen.slopes(theta, function, function(theta))[:, free]

    margin = 1e-9 * np.maximum(1.0, np.abs(start[free]))
    low, high = chosen.lower[free], chosen.upper[free]
    inside = np.clip(start[free], low + margin, high - margin)
    scale = np.maximum(np.abs(slopes(inside)).max(axis=0, initial=0.0), 1e-12)
    found = least_squares(
        lambda part: function(full(part)),
        inside,
        slopes,
        bounds=(low, high),
        x_scale=1.0 / scale,
        ftol=1e-6,
        xtol=1e-8,
        max_nfev=12,
    )
    return full(found.x), float(2.0 * found.cost)


def distance(drawn: Drawn, effects: Sequence[str]) -> float:
    """D2 between what is in the data, free of noise, and the nearest prediction of this set (may be empty)."""
    library = CATALOGUE.get(drawn.design.base, {})
    if not set(effects) <= set(library):
        return np.inf
    chosen = Set(drawn, effects)
    target = np.stack([drawn.clean[c] / drawn.sigma[c] for c in drawn.channels])

    def gap(theta: Array) -> Array:
        return _whiten(drawn, chosen.predict(theta) - target)

    best = np.inf
    for start in _starts(chosen, gap):
        best = min(best, _minimise(chosen, gap, start)[1])
        if best < 0.01 * SAME:
            break
    return best


def _starts(chosen: Set, gap: Callable[[Array], Array], kept: int = 3) -> list[Array]:
    """Shape parameters from their grids, sizes from a linear fit; the best of them."""
    truth = chosen.truth()
    shaped = [i for i in range(len(chosen.base), len(truth)) if chosen.keys[i] in SHAPES]
    grids = [SHAPES[chosen.keys[i]] for i in shaped]
    tried = []
    for values in list(product(*grids))[:300] if shaped else [()]:
        theta = truth.copy()
        theta[shaped] = values
        theta[chosen.sizes] = 0.0
        theta = np.clip(theta, chosen.lower, chosen.upper)
        base = gap(theta)
        columns = chosen.slopes(theta, gap, base)
        used = [i for i in range(len(theta)) if i not in shaped]
        step = np.linalg.lstsq(columns[:, used], -base, rcond=1e-10)[0]
        left = base + columns[:, used] @ step
        moved = theta.copy()
        moved[used] += step
        tried.append((float(left @ left), np.clip(moved, chosen.lower, chosen.upper)))
    tried.sort(key=lambda entry: entry[0])
    return [theta for _, theta in tried[:kept]]


def power(squared: float, level: float = 0.05) -> float:
    """Of the two-sided likelihood ratio test with one degree of freedom and noncentrality D2."""
    critical = float(ncx2.ppf(1.0 - level, 1, 1e-12))
    return float(ncx2.sf(critical, 1, max(squared, 1e-12)))


def oracle_heldout(drawn: Drawn, noise_sd: Mapping[str, float]) -> float:
    """Held-out error of the true model refitted on the training runs, in units of `noise_sd`."""
    _, left = refit(Set(drawn, tuple(drawn.hidden), drawn.foreign is not None))
    left = left[:, drawn.held_out]
    scale = np.array([drawn.sigma[c] / noise_sd[c] for c in drawn.channels])[:, None]
    return float(np.sqrt(np.mean((left * scale) ** 2)))


def refit(chosen: Set) -> tuple[Array, Array]:
    """Parameters of a set fitted to the measured training runs, and the residual of every row in true noise sd."""
    drawn = chosen.drawn
    values = np.stack([drawn.measured[c] / drawn.sigma[c] for c in drawn.channels])
    training = ~drawn.held_out
    theta, _ = _minimise(chosen, lambda t: (chosen.predict(t) - values)[:, training].reshape(-1), chosen.truth())
    return theta, values - chosen.predict(theta)


def right_columns(drawn: Drawn) -> set[str]:
    """Columns of the file on which what is missing depends, by role or by the name in the file.

    Those that the effect reads; those that are the same function of the row (rank correlation at least 0.99, sign
    aside); those that alone give what the model's own parameters leave of the effect (binned means, R2 at least 0.9).
    """
    made = drawn.design
    named = set(drawn.reads())
    none = Set(drawn, ())
    target = np.stack([drawn.clean[c] / drawn.sigma[c] for c in drawn.channels])
    theta, _ = _minimise(none, lambda t: (none.predict(t) - target).reshape(-1), none.truth())
    left = target - none.predict(theta)
    left = left[int(np.argmax((left**2).sum(1)))]
    right = set()
    for name, values in made.columns.items():
        alike = any(_rank(np.abs(values), np.abs(made.columns[n])) > 0.99 for n in named if n in made.columns)
        if name in named or alike or _explained(left, values) > 0.9:
            right.add(name if name in made.mapped else f"{name}_log")
            right.add(name)
    return right


def _rank(first: Array, second: Array) -> float:
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return 0.0
    a, b = (np.argsort(np.argsort(v, kind="stable"), kind="stable") for v in (first, second))
    return abs(float(np.corrcoef(a, b)[0, 1]))


def _explained(left: Array, values: Array) -> float:
    """Share of the variance of `left` between bins of `values` (8 of equal count)."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, 9)[1:-1]))
    bins = np.searchsorted(edges, values, side="right")
    mean = sum((left[bins == b].sum() ** 2 / max(1, (bins == b).sum())) for b in np.unique(bins))
    total = float((left**2).sum())
    return float(mean) / total if total > 0 else 0.0
