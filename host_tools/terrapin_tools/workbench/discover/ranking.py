"""Ranks what could be missing by its posterior: every effect, every pair, three where two do not suffice, expressions.

All single effects and pairs are first judged in a linear model around the present fit. The best are then refitted with
the model's own parameters on the training runs (several starts, bounds and signs respected) and judged anew around that
refit; then what lies next to the best answers is refitted too (closure.py), so that no neighbour is missed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.discover.closure import neighbours
from terrapin_tools.workbench.discover.curves_over_time import curves_over_time
from terrapin_tools.workbench.discover.expression_answers import expression_pairs, expressions, paying
from terrapin_tools.workbench.discover.ranker import WITHIN, Found, Hypothesis, Ranker
from terrapin_tools.workbench.discover.suspect_answers import beside_constants, table_answers
from terrapin_tools.workbench.formulas.expressions import read_by
from terrapin_tools.workbench.formulas.free_curves import Curve
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.priors import MISHAP, SIZE_OF_SET
from terrapin_tools.workbench.model.usual_sizes import MOST_TAX
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence
from terrapin_tools.workbench.noise.mishaps import KINDS

__all__ = ["ONE", "Blamed", "Hypothesis", "Ranking", "rank"]

PAIRS_REFITTED = 12  # pairs at most; chosen by hand, for time
UNSEEN = 1.0  # log weight by which a pair that was not refitted stays behind the best; chosen by hand
FEWEST_RUNS = 4  # from which a mishap of one of them differs from the rest; chosen by hand
ONE = 1e-3  # squared distance of two predictions [noise sd] below which they are one curve
LISTED = 0.5  # share of all that may be wrong, from which a mishap or a curve is named, or a run among odd ones
SHOWN = 10  # likeliest answers whose expressions are also refitted alone, for the table


@dataclass(frozen=True)
class Blamed:
    """What went wrong on the rig, not in the model: `run`, those that stand out; `slope`, those that a slope of the
    ground would explain; `change`, those before and after it; `warming`, how the test begins; `start`, how each run
    begins; `lag`, an instrument that comes late."""

    kind: str
    runs: tuple[str, ...]


@dataclass(frozen=True)
class Ranking:
    """Hypotheses with their posterior probabilities, likeliest first; and what the ranking was made from."""

    hypotheses: tuple[Hypothesis, ...]
    posterior: Array
    singles: Mapping[str, Hypothesis]  # every effect of the catalogue alone
    alone: Mapping[str, Hypothesis]  # every expression of the likeliest answers alone
    expressions: Mapping[str, Effect]  # by the name they were given
    columns: Mapping[str, str]  # of each expression, the column whose shape it is
    shapes: tuple[Shape, ...] = field(repr=False, default=())
    evidence: Evidence | None = field(repr=False, default=None)
    curves: Mapping[str, Curve] = field(repr=False, default_factory=dict)  # of own equations, by column
    found: Found = field(repr=False, default_factory=dict)  # where a search on hardly other rows starts

    def pairs(self) -> list[tuple[Hypothesis, float]]:
        """Each hypothesis with its probability, likeliest first."""
        return [(h, float(p)) for h, p in zip(self.hypotheses, self.posterior, strict=True)]

    def probability(self, *kinds: str) -> float:
        return float(sum(p for h, p in zip(self.hypotheses, self.posterior, strict=True) if h.kind in kinds))

    @property
    def blind(self) -> bool:
        """No effect could be weighed: the model's own parameters take up whatever the columns could show."""
        return all(h.kind in ("nothing", "unknown", *MISHAP) for h in self.hypotheses)

    def mishap(self, names: Sequence[str]) -> Blamed | None:
        """The mishap that is likelier than all else that may be wrong; `names` of the runs in their order."""
        share = {kind: self.probability(kind) for kind in KINDS}
        kind = max(share, key=lambda one: share[one])
        if share[kind] < LISTED * (1.0 - self.probability("nothing")):
            return None
        mine = [(h, p) for h, p in zip(self.hypotheses, self.posterior, strict=True) if h.kind == kind]
        if kind == "change":
            after = mine[0][0].column
            return Blamed(kind, (names[names.index(after) - 1], after))
        return Blamed(kind, tuple(h.column for h, p in mine if h.column and p >= LISTED * share[kind]))

    def column_inclusion(self, column: str) -> float:
        """Probability that some expression in a column, or a curve in it without one, is part of what is missing."""
        return float(
            sum(
                p
                for h, p in zip(self.hypotheses, self.posterior, strict=True)
                if (h.kind in ("expression", "unknown", "part") and h.column == column)
                or any(self.columns.get(name) == column for name in h.effects)
            )
        )


def rank(analysis: Analysis, report: Callable[[str], None] = lambda _: None, before: Ranking | None = None) -> Ranking:
    """Everything that could be missing from a case's model, with its posterior probability, likeliest first.

    Parameters
    ----------
    analysis : the answer of compare.
    report : is told what is being done, one short text a step.
    before : of the same case with a few more rows.
    """
    ranker = Ranker(analysis, report, before.found if before is not None else None)
    report(f"{ranker.catalogue} effects and their pairs around the present fit")
    average = ranker.screen()
    found: list[Hypothesis] = [
        Hypothesis((), "nothing", ranker.evidence.nothing + np.log(SIZE_OF_SET[0]), analysis.fit)
    ]
    singles: dict[str, Hypothesis] = {}
    for one in sorted((n for n in average if len(n) == 1), key=lambda n: -average[n]):
        singles[one[0]] = ranker.weighed(one, average[one])
    found += singles.values()
    report("refits of the best pairs")
    found += _pairs(ranker, singles, average, max(h.log_weight for h in found))
    found += _mishaps(ranker)
    if analysis.missing:
        report("columns that are scaled, late or without their sign")
        wrong = table_answers(ranker)
        singles |= {h.effects[0]: h for h in wrong if len(h.effects) == 1}
        found += [*wrong, *beside_constants(ranker)]
    report("short expressions in every column")
    found += expressions(ranker, [name for name, h in singles.items() if h.taxed >= MOST_TAX])
    if analysis.missing:
        found += expression_pairs(ranker)
        report("what lies next to the best answers")
        found += neighbours(ranker, found)
        singles |= {name: ranker.weighed((name,)) for name in ranker.faults if name not in singles}
    unlike: dict[frozenset[str], Hypothesis] = {}
    for h in sorted(found, key=lambda h: -h.log_weight):
        unlike.setdefault(frozenset(h.effects) if h.effects else frozenset([h.kind, h.column]), h)
    kept = paying(ranker, list(unlike.values()))
    ranked = [_largest_first(h) for h in _merged(ranker, kept)]
    curved, curves = curves_over_time(ranker, ranked)
    ranked = sorted([*ranked, *curved], key=lambda h: -h.log_weight)
    logs = np.array([h.log_weight for h in ranked])
    shown = list(dict.fromkeys(n for h in ranked[:SHOWN] for n in h.effects if n in ranker.sketches))
    lone = [ranker.weighed((name,)) for name in shown]
    renamed, effects, sketches = ranker.renamed([*ranked, *lone])
    return Ranking(
        hypotheses=tuple(renamed[: len(ranked)]),
        posterior=np.exp(logs - logsumexp(logs)),
        singles=singles,
        alone={h.effects[0]: h for h in renamed[len(ranked) :]},
        expressions=effects,
        columns={name: sketch.column for name, sketch in sketches.items()},
        shapes=tuple(ranker.flat),
        evidence=ranker.evidence,
        curves=curves,
        found=ranker.found(),
    )


def _pairs(
    ranker: Ranker, singles: Mapping[str, Hypothesis], average: Mapping[tuple[str, ...], float], best: float
) -> list[Hypothesis]:
    """Pairs of effects: the most promising refitted, others with the weight that they have around the present fit."""
    prior = ranker.log_prior(next((n for n in average if len(n) == 2), ()))
    order = list(singles)
    alone = {name: singles[name].log_weight - ranker.log_prior((name,)) for name in singles}
    found: list[Hypothesis] = []
    refitted = 0
    for names in sorted((n for n in average if len(n) == 2), key=lambda n: -average[n]):
        if average[names] + prior < best - WITHIN:
            break
        ordered = tuple(sorted(names, key=order.index))
        member = max(names, key=lambda n: average[n,])
        gain = average[names] - average[member,]  # a promise far from the present fit may not be kept: it earns a refit
        if gain < 0.0 or refitted == PAIRS_REFITTED:
            # the second adds nothing to the first: its price is known without a refit
            found.append(Hypothesis(ordered, "catalogue", min(alone[member] + gain + prior, best - UNSEEN)))
            continue
        refitted += 1
        found.append(ranker.weighed(ordered, average[names]))
        best = max(best, found[-1].log_weight)
    return found


def _merged(ranker: Ranker, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The answers, likeliest first; of those with expressions that are one curve, written in two ways, one is kept.
    Beside different effects of the catalogue they are two answers: an offset is no dry friction."""

    def named(one: Hypothesis) -> frozenset[str]:
        return frozenset(one.effects) - ranker.sketches.keys()

    ranked = sorted(found, key=lambda h: -h.log_weight)
    predicted: dict[int, Array] = {}

    def curve(fit: Fit) -> Array:
        if id(fit) not in predicted:
            predicted[id(fit)] = _predicted(ranker, fit)
        return predicted[id(fit)]

    for place, h in enumerate(ranked[:SHOWN]):
        if h.kind not in ("expression", "mixed") or h.fit is None or h not in ranked:
            continue
        for other in ranked[place + 1 : 2 * SHOWN]:
            if other.kind != h.kind or other.fit is None or named(other) != named(h):
                continue
            if _columns(ranker, h).isdisjoint(_columns(ranker, other)) and _columns(ranker, h):
                continue  # one curve in two columns that go together: two answers
            if float(((curve(h.fit) - curve(other.fit)) ** 2).sum()) < ONE:
                ranked.remove(other)
                h = ranked[place] = replace(h, log_weight=float(np.logaddexp(h.log_weight, other.log_weight)))
    return sorted(ranked, key=lambda h: -h.log_weight)


def _largest_first(one: Hypothesis) -> Hypothesis:
    """Its terms in the order of what they take: the squares that each would leave to noise and all other parameters."""
    if one.fit is None or len(one.effects) < 2:
        return one
    slopes = one.fit.jacobian.reshape(-1, len(one.fit.theta))
    slopes = np.where(np.isfinite(slopes).all(axis=0), slopes, 0.0)  # what has no derivative is not determined
    freedom = np.diag(np.linalg.pinv(slopes.T @ slopes, hermitian=True))
    taken: dict[str, float] = {}
    for size, free, value in zip(one.fit.model.fitted, freedom, one.fit.theta, strict=True):
        if size.effect is not None and size.effect not in taken:  # the first parameter of each is its size
            taken[size.effect] = float(value**2 / free) if free > 0.0 else 0.0
    # without one: a fault of the table, which changes what all others read
    return replace(one, effects=tuple(sorted(one.effects, key=lambda name: -taken.get(name, np.inf))))


def _columns(ranker: Ranker, one: Hypothesis) -> frozenset[str]:
    """Columns of the data that the expressions of an answer read."""
    read = [read_by(ranker.sketches[name], ranker.case.inputs) for name in one.effects if name in ranker.sketches]
    return frozenset().union(*read)


def _predicted(ranker: Ranker, fit: Fit) -> Array:
    return np.asarray(fit.model.bind(ranker.case.inputs, ranker.rows).predict(fit.theta) / ranker.sigma[:, None])


def _mishaps(ranker: Ranker) -> list[Hypothesis]:
    """What may have gone wrong on the rig instead: an odd run, a slope, a change, a beginning, a lag."""
    listed = ranker.analysis.mishaps
    if ranker.runs.runs < FEWEST_RUNS or not listed:
        return []
    logs = ranker.evidence.single(np.concatenate([one.columns for one in listed], axis=1))
    found = []
    for one, own in zip(listed, np.split(logs, np.cumsum([one.columns.shape[1] for one in listed])[:-1]), strict=True):
        among = own.size * sum(other.kind == one.kind for other in listed)
        name = "" if one.run is None else ranker.case.run_names[one.run]
        weight = float(logsumexp(own)) + np.log(MISHAP[one.kind] / among)
        found.append(Hypothesis((), one.kind, weight, None, name))
    return found
