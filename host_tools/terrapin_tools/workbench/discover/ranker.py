"""Hypotheses fitted and weighed one at a time: what the ranking asks of the data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations, product

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from terrapin_hil.physics.effects import Effect
from terrapin_tools.workbench.compare.comparison import Analysis, measured
from terrapin_tools.workbench.discover.expressions import Library
from terrapin_tools.workbench.model.data_columns import candidates
from terrapin_tools.workbench.model.effect_columns import Shape, is_phase
from terrapin_tools.workbench.model.fitting import Fit, extend
from terrapin_tools.workbench.model.linearised import linearise
from terrapin_tools.workbench.noise.ar1 import Ar1
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["Ranker"]

Array = npt.NDArray[np.float64]


class Ranker:
    def __init__(self, analysis: Analysis, report: Callable[[str], None]) -> None:
        self.analysis, self.report = analysis, report
        self.case, self.model, self.rows = analysis.case, analysis.model, analysis.rows
        self.sigma = analysis.noise.sigma
        self.known = bool(analysis.noise.known.all())
        self.ar1 = Ar1(self.case.run[self.rows])
        self.values = measured(self.model, self.rows)
        self.train = measured(self.model, self.case.train)
        self.effects: dict[str, Effect] = {effect.name: effect for effect in candidates(self.model)}
        self.shapes = analysis.shapes
        self.flat = [shape for shapes in self.shapes.values() for shape in shapes]
        self.listed: Library | None = None
        self.together: dict[tuple[str, ...], list[tuple[str, Array]]] = {}  # start values of a pair's parameters
        self.fits: dict[tuple[str, ...], Fit] = {(): analysis.fit}
        slopes = self.model.bind(self.case.inputs, self.rows).jacobian(analysis.fit.theta)[1]
        self.base = slopes / self.sigma[:, None, None]
        self.evidence = Evidence(self.ar1, analysis.residual / self.sigma[:, None], self.base, self.known)

    # -- linear, around the present fit ------------------------------------------------------------------------------

    def screen(self) -> tuple[dict[tuple[str, ...], float], dict[tuple[str, ...], float]]:
        """Log evidence of every single and pair, averaged over shapes; and what the average lies below the best."""
        width = [shape.columns.shape[1] for shape in self.flat]
        edges = np.concatenate([[0], np.cumsum(width)]).astype(int)
        if not self.flat:
            return {}, {}
        gram = self.evidence.gram(np.concatenate([s.columns for s in self.flat], axis=1))
        index: dict[str, list[int]] = {}
        for i, shape in enumerate(self.flat):
            index.setdefault(shape.effect, []).append(i)
        jobs: dict[int, list[tuple[tuple[str, ...], tuple[int, ...]]]] = {}
        for count in (1, 2):
            for names in combinations(index, count):
                for picked in product(*(index[name] for name in names)):
                    jobs.setdefault(sum(width[i] for i in picked), []).append((names, picked))
        found: dict[tuple[str, ...], list[float]] = {}
        highest: dict[tuple[str, ...], float] = {}
        at = int(np.argmin(np.abs(self.evidence.rho - self.analysis.noise.rho)))
        for size, entries in sorted(jobs.items()):
            picks = np.array([[c for i in p for c in range(edges[i], edges[i + 1])] for _, p in entries]).reshape(
                -1, size
            )
            signs = np.array([[_sign(self.flat[i]) for i in p for _ in range(width[i])] for _, p in entries], float)
            logs = self.evidence.blocks(gram, picks, signs.reshape(-1, size))
            for (names, picked), columns, value in zip(entries, picks, logs, strict=True):
                found.setdefault(names, []).append(float(value))
                if len(names) > 1 and value > highest.get(names, -np.inf):
                    highest[names] = float(value)
                    products = gram.products[at][np.ix_(columns, columns)] + 1e-6 * np.eye(size)
                    solved = np.linalg.solve(products, gram.scores[at][columns])
                    self.together[names] = [
                        self._start(self.flat[i], solved[(columns >= edges[i]) & (columns < edges[i + 1])])
                        for i in picked
                    ]
        average = {names: float(logsumexp(logs) - np.log(len(logs))) for names, logs in found.items()}
        razor = {names: average[names] - max(logs) for names, logs in found.items()}
        return average, razor

    def _start(self, shape: Shape, coefficients: Array) -> tuple[str, Array]:
        """The effect's parameters at a shape and these coefficients of its columns."""
        values = list(shape.values)
        size = float(np.clip(coefficients[0], shape.lower, shape.upper))
        if len(coefficients) == 2:  # sine and cosine
            size = float(np.hypot(*coefficients))
            wave = next(i for i, p in enumerate(self.effects[shape.effect].parameters[1:]) if is_phase(p))
            values[wave] = float(np.arctan2(coefficients[1], coefficients[0]))
        return shape.effect, np.array([size * shape.scale, *values])

    # -- refits ------------------------------------------------------------------------------------------------------

    def fit(self, names: tuple[str, ...], effects: Mapping[str, Effect] | None = None) -> Fit:
        """The present model with more effects, fitted on the training runs, warm-started at its parent."""
        if names not in self.fits:
            parent = self.fit(names[:-1], effects)
            effect = {**self.effects, **(effects or {})}[names[-1]]
            bound = parent.model.having(effect).bind(self.case.inputs, self.case.train)
            linear = dict(self.together.get(names) or self.together.get(names[::-1]) or ())
            starts = [np.concatenate([self.analysis.fit.theta, *(linear[name] for name in names)])] if linear else []
            self.fits[names] = extend(parent, effect.name, bound, self.train, self.sigma, starts)
        return self.fits[names]

    def around(self, fit: Fit, names: Sequence[str]) -> float | None:
        """Log evidence of a refitted set, its shapes as fitted; None when a size is 0 and nothing can be told."""
        try:
            linear = linearise(fit, names, self.values, self.rows, self.sigma)
        except ValueError:
            return None
        evidence = Evidence(self.ar1, linear.residual, linear.base, self.known)
        if not linear.columns.shape[1]:
            return evidence.nothing - linear.lost
        picks = np.arange(linear.columns.shape[1])[None, :]
        logs = evidence.blocks(evidence.gram(linear.columns), picks, linear.signs[None, :], linear.offset)
        return float(logs[0]) - linear.lost

    def sound(self, fit: Fit, names: Sequence[str]) -> bool:
        """Whether the effects have a size and no absurd influence on any row: else nothing can be built on the fit."""
        try:
            linearise(fit, names, self.values, self.rows, self.sigma)
        except ValueError:
            return False
        return True

    def refitted(self, names: tuple[str, ...], razor: float, linear: float) -> tuple[float, Fit]:
        fit = self.fit(names)
        found = self.around(fit, names)
        return (linear if found is None or not np.isfinite(found) else found + razor), fit

    def beyond(self, fit: Fit) -> tuple[Evidence, Array]:
        """Evidence around a fit with all of its parameters free: what could still be added to it."""
        prediction, slopes = fit.model.bind(self.case.inputs, self.rows).jacobian(fit.theta)
        residual = (self.values - prediction) / self.sigma[:, None]
        scaled = slopes / self.sigma[:, None, None]
        return Evidence(self.ar1, residual, scaled, self.known), scaled.reshape(residual.size, -1)


def _sign(shape: Shape) -> float:
    if not shape.one_sided:
        return 0.0
    return 1.0 if shape.lower >= 0.0 else -1.0
