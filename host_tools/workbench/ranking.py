"""What is missing: every effect, every pair, three where two do not suffice, and short expressions, by posterior.

Singles and pairs are first looked at in full as a linear model around the present fit; the best are then refitted with
the model's own parameters on the training runs (several starts, bounds and signs respected) and judged anew around that
refit. All pairs are looked at, so the best pair is found also where neither of the two is the best single effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations, product

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from hil.physics.effects import Effect
from host_tools.workbench.analysis import Analysis, measured
from host_tools.workbench.candidates import Shape, is_phase
from host_tools.workbench.directions import candidates
from host_tools.workbench.evidence import Evidence
from host_tools.workbench.expressions import Library
from host_tools.workbench.fit import Fit, extend
from host_tools.workbench.hypothesis import Hypothesis
from host_tools.workbench.linear import linearise
from host_tools.workbench.noise import Ar1
from host_tools.workbench.unknown import beside_effects, expressions

__all__ = ["PRIOR", "Hypothesis", "Ranking", "rank"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

PRIOR = {"nothing": 0.2, "one": 0.36, "two": 0.18, "three": 0.01, "expression": 0.21, "mixed": 0.03, "run": 0.02}
PAIRS_REFITTED = 12
PAIRS_LOOKED_AT = 40
WORTH_A_REFIT = 0.0  # log evidence that a second effect must add to the first for a refit of the two
PAIRS_FROM = 3  # best single effects that a second one is tried on once more
UNSEEN = 1.0  # log weight by which a pair that was not refitted stays behind the best
TRIPLES_FROM = 2  # best pairs that a third effect is tried on
WITHIN = 12.0  # log evidence behind the best at which a set is no longer worth a refit


@dataclass(frozen=True)
class Ranking:
    """Hypotheses with their posterior probabilities, likeliest first; and what the ranking was made from."""

    hypotheses: tuple[Hypothesis, ...]
    posterior: Array
    singles: Mapping[str, Hypothesis]
    expressions: Mapping[str, Effect]  # by the name they were given
    column_weight: Mapping[str, float]  # log weight of the best expression in each column, for "where"
    shapes: tuple[Shape, ...] = field(repr=False, default=())
    evidence: Evidence | None = field(repr=False, default=None)

    def probability(self, *kinds: str) -> float:
        return float(sum(p for h, p in zip(self.hypotheses, self.posterior, strict=True) if h.kind in kinds))

    @property
    def blind(self) -> bool:
        """No effect could be weighed: the model's own parameters take up whatever the columns could show."""
        return all(h.kind in ("nothing", "run") for h in self.hypotheses)

    def inclusion(self, effect: str) -> float:
        """Probability that an effect is part of what is missing."""
        return float(sum(p for h, p in zip(self.hypotheses, self.posterior, strict=True) if effect in h.effects))


class _Ranker:
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


def rank(analysis: Analysis, report: Callable[[str], None] = lambda _: None) -> Ranking:
    """Rank everything that could be missing from a case's model."""
    ranker = _Ranker(analysis, report)
    count = max(1, len(ranker.effects))
    log_prior = {
        1: np.log(PRIOR["one"] / count),
        2: np.log(PRIOR["two"] / max(1, count * (count - 1) // 2)),
        3: np.log(PRIOR["three"] / max(1, count * (count - 1) * (count - 2) // 6)),
    }
    report(f"{len(ranker.effects)} effects and their pairs around the present fit")
    average, razor = ranker.screen()
    found: list[Hypothesis] = [Hypothesis((), "nothing", ranker.evidence.nothing + np.log(PRIOR["nothing"]))]
    singles: dict[str, Hypothesis] = {}
    order: list[str] = []
    for one in sorted((n for n in average if len(n) == 1), key=lambda n: -average[n]):
        value, fit = ranker.refitted(one, razor[one], average[one])
        singles[one[0]] = Hypothesis(one, "catalogue", value + log_prior[1], fit)
        order.append(one[0])
    found += singles.values()
    best = max(h.log_weight for h in found)
    onward = _onward(ranker, singles, best)
    promise: dict[tuple[str, ...], float] = {names: value for names, value in average.items() if len(names) == 2}
    for names, gain in onward.items():
        promise[names] = max(promise[names], singles[_first(names, singles)].log_weight - log_prior[1] + gain)
    by_average = sorted(promise, key=lambda n: -average[n])
    by_promise = sorted(promise, key=lambda n: -promise[n])
    pairs = list(dict.fromkeys(chain.from_iterable(zip(by_average, by_promise, strict=True))))
    report("refits of the best pairs")
    refitted_pairs: list[Hypothesis] = []
    for names in pairs[:PAIRS_LOOKED_AT]:
        if promise[names] + log_prior[2] < best - WITHIN:
            continue
        ordered = tuple(sorted(names, key=order.index))
        member = max(names, key=lambda n: average[n,])
        gain = average[names] - average[member,]  # a promise far from the present fit may not be kept: it earns a refit
        if max(gain, onward.get(names, gain)) < WORTH_A_REFIT or len(refitted_pairs) == PAIRS_REFITTED:
            # the second adds nothing to the first: its price is known without a refit
            alone = singles[member].log_weight - log_prior[1]
            weight = min(alone + gain + log_prior[2], best - UNSEEN)
            found.append(Hypothesis(ordered, "catalogue", weight))
            continue
        value, fit = ranker.refitted(ordered, razor[names], average[names])
        refitted_pairs.append(Hypothesis(ordered, "catalogue", value + log_prior[2], fit))
        best = max(best, refitted_pairs[-1].log_weight)
    found += refitted_pairs
    found += _triples(ranker, refitted_pairs, log_prior)
    found += _runs(ranker)
    report("short expressions in every column")
    alone, effects, column_weight = expressions(ranker, PRIOR["expression"], max(h.log_weight for h in found))
    found += alone
    found += beside_effects(ranker, PRIOR["mixed"], found, effects)
    found.sort(key=lambda h: -h.log_weight)
    logs = np.array([h.log_weight for h in found])
    return Ranking(
        tuple(found),
        np.exp(logs - logsumexp(logs)),
        singles,
        effects,
        column_weight,
        tuple(ranker.flat),
        ranker.evidence,
    )


def _gains(ranker: _Ranker, fit: Fit, present: Sequence[str]) -> dict[str, float]:
    """Log evidence that each further effect would add to a fit whose parameters, shapes included, follow."""
    gains: dict[str, float] = {}
    if not ranker.sound(fit, present):  # its evidence is not that of this fit, and gains over it mean nothing
        return gains
    beyond, _ = ranker.beyond(fit)
    for name, shapes in ranker.shapes.items():
        singles = [s.columns for s in shapes if s.columns.shape[1] == 1]
        if name in present or not singles:
            continue
        logs = beyond.single(np.concatenate(singles, axis=1))
        gains[name] = float(logsumexp(logs) - np.log(len(logs)) - beyond.nothing)
    return gains


def _first(names: Sequence[str], singles: Mapping[str, Hypothesis]) -> str:
    return max(names, key=lambda name: singles[name].log_weight)


def _onward(ranker: _Ranker, singles: Mapping[str, Hypothesis], best: float) -> dict[tuple[str, ...], float]:
    """Log evidence that a second effect adds to the best refitted ones, by pair.

    Around the present fit a shape is known on a grid only, and where the noise is small no point of it fits: a pair
    would lose to one whose second effect merely mends that.
    """
    order = list(ranker.shapes)
    found: dict[tuple[str, ...], float] = {}
    leading = sorted(singles.values(), key=lambda h: -h.log_weight)[:PAIRS_FROM]
    for single in leading:
        if single.fit is None or single.log_weight < best - WITHIN:
            continue
        for name, gain in _gains(ranker, single.fit, single.effects).items():
            names = tuple(sorted((single.effects[0], name), key=order.index))
            if _first(names, singles) == single.effects[0]:
                found[names] = gain
    return found


def _triples(ranker: _Ranker, pairs: Sequence[Hypothesis], log_prior: Mapping[int, float]) -> list[Hypothesis]:
    found: dict[frozenset[str], Hypothesis] = {}
    for pair in sorted(pairs, key=lambda h: -h.log_weight)[:TRIPLES_FROM]:
        assert pair.fit is not None
        gains = _gains(ranker, pair.fit, pair.effects)
        if not gains:
            continue
        third = max(gains, key=lambda n: gains[n])
        key = frozenset((*pair.effects, third))
        weight = pair.log_weight - log_prior[2] + gains[third] + log_prior[3]
        if key not in found and gains[third] > 0.0:
            fit = ranker.fit((*pair.effects, third))
            found[key] = Hypothesis((*pair.effects, third), "catalogue", weight, fit)
    return list(found.values())


def _runs(ranker: _Ranker) -> list[Hypothesis]:
    """One run that stands out by itself: an offset of one channel in that run alone."""
    run = ranker.case.run[ranker.rows]
    runs = np.unique(run)
    channels = len(ranker.model.channels)
    if len(runs) < 4:
        return []
    columns = np.zeros((channels, len(run), len(runs) * channels))
    for i, one in enumerate(runs):
        for channel in range(channels):
            columns[channel, run == one, i * channels + channel] = 1.0
    logs = ranker.evidence.single(columns.reshape(channels * len(run), -1))
    prior = np.log(PRIOR["run"] / len(logs))
    return [
        Hypothesis(
            (),
            "run",
            float(logsumexp(logs[i * channels : (i + 1) * channels])) + prior,
            None,
            ranker.case.run_names[one],
        )
        for i, one in enumerate(runs)
    ]
