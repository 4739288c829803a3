"""Ranks what could be missing by its posterior: every effect, every pair, three where two do not suffice, expressions.

All single effects and pairs are first judged in a linear model around the present fit. The best are then refitted with
the model's own parameters on the training runs (several starts, bounds and signs respected) and judged anew around that
refit. Because every pair is judged, the best pair is found even where neither of the two is the best single effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from terrapin_hil.physics.effects import Effect
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.discover.expression_answers import beside_effects, expressions
from terrapin_tools.workbench.discover.hypothesis import Hypothesis
from terrapin_tools.workbench.discover.ranker import Ranker
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["PRIOR", "Hypothesis", "Ranking", "rank"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Prior of each kind of answer. Chosen by hand; the campaigns (row "probability") measure what comes of it.
PRIOR = {"nothing": 0.2, "one": 0.36, "two": 0.18, "three": 0.01, "expression": 0.21, "mixed": 0.03, "run": 0.02}
PAIRS_REFITTED = 12  # pairs at most; chosen by hand, for time
PAIRS_LOOKED_AT = 40  # likeliest pairs from which these are taken; chosen by hand, for time
WORTH_A_REFIT = 0.0  # log evidence that a second effect must add to be refitted: any
PAIRS_FROM = 3  # best single effects that a second one is tried on once more; chosen by hand
UNSEEN = 1.0  # log weight by which a pair that was not refitted stays behind the best; chosen by hand
TRIPLES_FROM = 2  # best pairs that a third effect is tried on; chosen by hand, for time
WITHIN = 12.0  # log evidence behind the best beyond which no set is refitted: a posterior of 6e-6; chosen by hand


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


def rank(analysis: Analysis, report: Callable[[str], None] = lambda _: None) -> Ranking:
    """Everything that could be missing from a case's model, with its posterior probability, likeliest first.

    Parameters
    ----------
    analysis : the answer of compare.
    report : is told what is being done, one short text a step.
    """
    ranker = Ranker(analysis, report)
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


def _gains(ranker: Ranker, fit: Fit, present: Sequence[str]) -> dict[str, float]:
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


def _onward(ranker: Ranker, singles: Mapping[str, Hypothesis], best: float) -> dict[tuple[str, ...], float]:
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


def _triples(ranker: Ranker, pairs: Sequence[Hypothesis], log_prior: Mapping[int, float]) -> list[Hypothesis]:
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


def _runs(ranker: Ranker) -> list[Hypothesis]:
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
