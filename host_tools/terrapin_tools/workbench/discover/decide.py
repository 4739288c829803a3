"""The verdict, from the posterior alone: answers that predict the same are one class, and its mass is the probability.

Two sets are one where each reaches what the other predicts. So supersets that add nothing, special cases, formulas that
imitate an effect and exact twins need no rule. Nothing, each mishap of the test and a curve without a formula are
classes of their own; so is a set beside such a curve, which is part of what is missing. What has most mass leads; where
that is a set without most of the mass, the fewest classes that have it do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.comparison import Analysis, error, noise_around
from terrapin_tools.workbench.compare.noise_findings import far_above_stated
from terrapin_tools.workbench.discover.certainty import calibrated
from terrapin_tools.workbench.discover.curves_over_time import curved
from terrapin_tools.workbench.discover.leftover import SAME, absent, left, noise_left
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import ONE, Blamed, Ranking
from terrapin_tools.workbench.discover.unexplained import curves
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.priors import SIZE_OF_SET
from terrapin_tools.workbench.model.usual_sizes import MOST_TAX
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.mishaps import KINDS
from terrapin_tools.workbench.noise.stated import FAR

__all__ = [
    "CREDIBLE",
    "Class",
    "Decision",
    "Weight",
    "aliases",
    "classes",
    "decide",
    "inclusion",
    "weights",
    "with_curves",
]

BEHIND = 0.1  # of the likeliest member's probability that another name of its class has at least
BESIDE = 0.2  # of it that a formula has at least, to be told beside an effect whose size is very unusual
ALONE = 0.7  # of the mass of all sets from which one class is told alone
CREDIBLE = 0.9  # of it that is told together where none has so much
MOST = 4  # names that are told
TENTH = 0.1  # share of the misfit that a further effect must bring beside a curve that is left
HALF = 0.5  # of the held-out error that a known set leaves at most, to be told where a curve is likelier
SMALL = 1e-2  # of the likeliest set's probability, below which a set joins no other, for time
QUESTION = 1e-6  # probability below which something is out of the question, and not listed
# Of "nothing (else) is missing" at most where far more than the stated noise is left, or where noise is found to grow
# with the reading, as a misfit that is a share of it looks.
STRANGE, GROWING = 0.3, 0.8


@dataclass(frozen=True)
class Class:
    """Sets that predict the same, likeliest first, with their probabilities; `parts`: those beside a curve. There may
    be none but these, for what stands beside a curve may show only with it."""

    members: tuple[tuple[Hypothesis, float], ...]
    parts: tuple[tuple[Hypothesis, float], ...] = ()

    @property
    def mass(self) -> float:
        return float(sum(p for _, p in self.members))

    @property
    def partly(self) -> float:
        """Probability that such a set is missing, and a curve without a formula as well."""
        return float(sum(p for _, p in self.parts))

    @property
    def names(self) -> list[tuple[Hypothesis, float]]:
        """What it may be called, likeliest first, with shares of its mass: none with a term more than another member,
        for it changes nothing; of the others those that say no more than the likeliest and are not far less likely, but
        for a size that is unusual; formulas only where no catalogued set is among them, or none of a usual size."""
        own = self.members or self.parts
        sets = [set(h.effects) for h, _ in own]
        short = [one for one in own if not any(other < set(one[0].effects) for other in sets)]
        first, best = short[0]
        least = [BEHIND * best * np.exp(-max(h.taxed - first.taxed, 0.0)) for h, _ in short]
        likely = [m for m, p in zip(short, least, strict=True) if m[1] >= p and m[0].parameters <= first.parameters]
        odd = all(h.taxed >= MOST_TAX for h, _ in likely if h.kind == "catalogue")
        called = [m for m in likely if m[0].kind == "catalogue" or (odd and m[1] >= BESIDE * best)] or likely
        total = sum(p for _, p in called)
        return [(h, self.mass * (p / total if total else 1.0 / len(called))) for h, p in called]


@dataclass(frozen=True)
class Decision:
    """What is told: the likeliest set first, and its probability; `classes` are all, most mass first. `column`: that of
    a curve without a formula that is missing, too; `blamed`: what went wrong on the rig instead."""

    verdict: str
    probability: float
    told: tuple[Hypothesis, ...] = ()
    column: str = ""
    blamed: Blamed | None = None
    classes: tuple[Class, ...] = ()


@dataclass(frozen=True)
class Weight:
    """Something that was weighed: `kind` set, part (a set, and a curve beside it), unknown (a curve), expression (any
    other formula in a column), nothing, that of a mishap, or rest (sets of which a term is fitted as 0 or adds so
    little that they were not refitted; the last one); `sets`: its names; `column`: of the curve, or the run; `alike`:
    single terms that predict the same, and are not what it is called. The probability is the posterior."""

    kind: str
    sets: tuple[tuple[str, ...], ...]
    column: str
    probability: float
    alike: tuple[str, ...] = ()


class _Apart:
    """Distances between predictions, in the noise that the likeliest set leaves."""

    def __init__(self, analysis: Analysis, ranking: Ranking, top: Hypothesis) -> None:
        assert top.fit is not None
        self.analysis, self.evidence = analysis, ranking.evidence
        self.node, self.row = noise_left(analysis, top.fit)
        self.known: dict[int, tuple[Array, Array]] = {}

    def __call__(self, first: Hypothesis, other: Hypothesis) -> float:
        """How far the first's predictions lie from what the other's parameters reach, squared, in noise sd."""
        if self.evidence is None:
            return np.inf
        wanted, (reached, slopes) = self._of(first)[0], self._of(other)
        return self.evidence.distance(wanted - reached, slopes, self.node) / self.row**2

    def _of(self, one: Hypothesis) -> tuple[Array, Array]:
        assert one.fit is not None
        if id(one) not in self.known:
            sigma = self.analysis.noise.sigma
            reached, slopes = one.fit.model.bind(self.analysis.case.inputs, self.analysis.rows).jacobian(one.fit.theta)
            self.known[id(one)] = reached / sigma[:, None], slopes / sigma[:, None, None]
        return self.known[id(one)]

    def alike(self, first: Hypothesis, other: Hypothesis) -> bool:
        """Whether each reaches what the other predicts."""
        return self(first, other) < SAME and self(other, first) < SAME


def classes(analysis: Analysis, ranking: Ranking) -> list[Class]:
    """Classes of the sets that were refitted, most mass first."""
    looked_at = {h.effects for h, p in ranking.pairs() if p > QUESTION}  # alone, or beside a curve
    pairs = [(h, p) for h, p in ranking.pairs() if h.effects and h.effects in looked_at]
    sets = [(h, p) for h, p in pairs if h.fit is not None and not absent(h.fit, h.effects)]
    whole = [one for one in sets if one[0].kind != "part"]
    found = list[list[tuple[Hypothesis, float]]]()
    apart = _Apart(analysis, ranking, whole[0][0]) if whole else None
    for one, p in whole:
        assert apart is not None
        likely, own = p >= SMALL * whole[0][1], set(one.effects)
        near = [members for members in found if likely or own < set(members[0][0].effects)]
        same = next((members for members in near if apart.alike(members[0][0], one)), None)
        if same is None:
            found.append(same := [])
        same.append((one, p))
    beside = [one for one in sets if one[0].kind == "part"]
    each = [({h.effects for h, _ in members}, members) for members in found]
    known = {effects for own, _ in each for effects in own}
    each += [({effects}, []) for effects in dict.fromkeys(h.effects for h, _ in beside) if effects not in known]
    return sorted(
        (Class(tuple(members), tuple(one for one in beside if one[0].effects in own)) for own, members in each),
        key=lambda c: -c.mass,
    )


def with_curves(analysis: Analysis, ranking: Ranking) -> Ranking:
    """The ranking with curves that have no formula, alone and beside the likeliest sets; in the place of those that it
    has already. Those of equations over time are weighed in the search, along the motion of its answers."""
    if analysis.case.base.whole_runs:
        return ranking
    without = tuple(h for h in ranking.hypotheses if h.kind not in ("unknown", "part"))
    found = [*without, *curves(analysis, replace(ranking, hypotheses=without))]
    logs = np.array([h.log_weight for h in found])
    order = np.argsort(-logs, kind="stable")
    posterior = np.exp(logs - logsumexp(logs))
    return replace(ranking, hypotheses=tuple(found[i] for i in order), posterior=posterior[order])


def decide(analysis: Analysis, ranking: Ranking, level: float) -> Decision:
    """What the posterior says."""
    nothing = ranking.probability("nothing")
    if not analysis.missing:
        probability = calibrated(nothing * (SIZE_OF_SET[0] if ranking.blind else 1.0), "nothing")
        if far_above_stated(analysis):
            probability = min(probability, STRANGE)
        if analysis.noise.node.grow and analysis.noise.groups is None and not analysis.noise.known.all():
            probability = min(probability, GROWING)
        return Decision("adequate", probability)
    every = classes(analysis, ranking)
    sets, part, unknown = sum(c.mass for c in every), sum(c.partly for c in every), ranking.probability("unknown")
    mishap = ranking.probability(*KINDS)
    most = max(sets, part, unknown, mishap)
    if most == mishap:
        blamed = ranking.mishap(analysis.case.run_names)
        probability = ranking.probability(blamed.kind) if blamed else mishap
        verdict = "mishap" if blamed else "unexplained"
        return Decision("unexplained", calibrated(probability, verdict), blamed=blamed, classes=tuple(every))
    if most == unknown:
        column = next((h.column for h in ranking.hypotheses if h.kind == "unknown"), "")
        probability, known = calibrated(unknown, "unexplained"), _halving(analysis, ranking)
        if known is not None:
            return Decision("partial", probability, (known,), column, classes=tuple(every))
        return Decision("unexplained", probability, column=column, classes=tuple(every))
    if most == part:
        first = max(every, key=lambda c: c.partly)
        (top, _), *_ = first.parts
        worth = _worth(analysis, ranking, top)
        return Decision("partial", calibrated(first.partly, "partial"), (worth,), top.column, classes=tuple(every))
    told = tuple(_told(ranking, every, sets))
    assert told[0][0].fit is not None
    leaves, far = left(analysis, told[0][0].fit), False
    if leaves.clearly(level):
        found = _as_found(analysis, told[0][0].fit)
        leaves, far = left(found, told[0][0].fit), bool(found.noise.ratio.max() > FAR)
    if leaves.clearly(level) or far:  # what is left is no curve of one column, and no noise that a user may state so
        probability = calibrated(1.0 - leaves.p_value, "unexplained") if leaves.clearly(level) else 1.0 - STRANGE
        return Decision("partial", probability, (told[0][0],), classes=tuple(every))
    verdict = "ambiguous" if len(told) > 1 else "missing"
    return Decision(verdict, calibrated(told[0][1], verdict), tuple(h for h, _ in told), classes=tuple(every))


def _as_found(analysis: Analysis, answer: Fit) -> Analysis:
    """In the noise that is found around an answer, where a stated sd surely is off: noise that was stated too small is
    no part of what is missing."""
    noise = noise_around(analysis.case, answer, analysis.noise, again=True)
    return replace(analysis, noise=noise) if noise.wrong.any() else analysis


def _worth(analysis: Analysis, ranking: Ranking, top: Hypothesis) -> Hypothesis:
    """The catalogued set with the fewest parameters that takes as much of the misfit but for TENTH: a part of a
    catalogued one, any in the place of formulas. Beside a curve that is left, a further effect that brings less, or a
    formula in the place of a law, may be a piece of that curve. A formula that nothing known comes near to stays;
    so does what was fitted with the curve."""
    if top.fit is not None and curved(top.fit):
        return top
    formulas = any(name in ranking.expressions for name in top.effects)
    before = error(analysis.fit, analysis.rows, analysis.noise.sigma) or 1.0

    def takes(one: Hypothesis) -> float:
        after = error(one.fit, analysis.rows, analysis.noise.sigma) if one.fit is not None else None
        return -np.inf if after is None else 1.0 - after**2 / before**2

    least = takes(top) - TENTH
    known = [h for h in ranking.hypotheses if h.kind == "catalogue" and h.parameters < top.parameters]
    within = [h for h in known if formulas or set(h.effects) < set(top.effects)]
    good = [h for h in within if h.effects and takes(h) >= least and not absent(h.fit, h.effects)]
    return min(good, key=lambda h: (h.parameters, -h.log_weight), default=top)


def _halving(analysis: Analysis, ranking: Ranking) -> Hypothesis | None:
    """The catalogued set with the fewest parameters that halves the held-out error, where a curve is likelier that may
    hold it: what is known is told as far as it goes. None without one."""
    case, sigma = analysis.case, analysis.noise.sigma
    rows = case.test if case.test.any() else case.train
    most = HALF * (error(analysis.fit, rows, sigma) or 0.0)
    known = [h for h in ranking.hypotheses if h.kind == "catalogue" and h.effects and not absent(h.fit, h.effects)]
    good = [h for h in known if h.fit is not None and (error(h.fit, rows, sigma) or np.inf) <= most]
    return min(good, key=lambda h: (h.parameters, -h.log_weight), default=None)


def _told(ranking: Ranking, every: Sequence[Class], mass: float) -> Iterator[tuple[Hypothesis, float]]:
    """The names of the leading class, where it has most of the mass, else of the fewest classes that have it together;
    what is told already, and more, is no rival."""
    texts, reached, told = ranking.expressions, 0.0, list[frozenset[str]]()
    for place, one in enumerate(every):
        for hypothesis, share in one.names:
            own = frozenset(texts[n].expression if n in texts else n for n in hypothesis.effects)
            if len(told) < MOST and not any(other <= own for other in told):
                told.append(own)
                yield hypothesis, share
        reached += one.mass
        if reached >= (CREDIBLE if place else ALONE) * mass:
            return


def aliases(analysis: Analysis, ranking: Ranking, said: Decision) -> tuple[tuple[str, ...], ...]:
    """Sets that are not told and are the first one told to the last digit, with as many parameters, likeliest first:
    only their prior speaks against them, no data do."""
    if not said.told:
        return ()
    (top, *_), told = said.told, {h.effects for h in said.told}
    assert top.fit is not None
    cost, apart = top.fit.cost, _Apart(analysis, ranking, top)
    other = [
        h
        for h, p in ranking.pairs()
        if p > QUESTION
        and h.kind != "part"
        and h.parameters == top.parameters
        and h.effects not in told
        and h.fit is not None
        and abs(h.fit.cost - cost) < ONE
    ]
    return tuple(h.effects for h in other if max(apart(top, h), apart(h, top)) < ONE)


def inclusion(ranking: Ranking, every: Sequence[Class], term: str) -> float:
    """Posterior probability that a term is part of what is missing. What predicts the same goes by the names of its
    class, as the answer is told; sets of no class, as those that were not refitted, by their own."""
    ours = {id(h) for one in every for h, _ in (*one.members, *one.parts)}
    own = sum(p for h, p in ranking.pairs() if term in h.effects and id(h) not in ours)
    called = sum((c.mass + c.partly) * _share(c, term) for c in every)
    return float(own + called)


def _share(one: Class, term: str) -> float:
    """Of the names of a class those with a term."""
    every = [(share if one.mass else 1.0, h) for h, share in one.names]
    return sum(share for share, h in every if term in h.effects) / sum(share for share, _ in every)


def _unnamed(one: Class) -> tuple[str, ...]:
    named = {h.effects for h, _ in one.names}
    return tuple(h.effects[0] for h, _ in one.members if len(h.effects) == 1 and h.effects not in named)


def weights(ranking: Ranking, every: Sequence[Class]) -> tuple[Weight, ...]:
    """All that was weighed and is not out of the question, likeliest first; what predicts the same is one."""
    found = [Weight("set", tuple(h.effects for h, _ in c.names), "", c.mass, _unnamed(c)) for c in every]
    found += [
        Weight("part", (one.parts[0][0].effects,), one.parts[0][0].column, one.partly) for one in every if one.parts
    ]
    found += [Weight(h.kind, (), h.column, p) for h, p in ranking.pairs() if not h.effects]
    rest = 1.0 - sum(one.probability for one in found)
    found = sorted((one for one in found if one.probability > QUESTION), key=lambda one: -one.probability)
    return (*found, *([Weight("rest", (), "", rest)] if rest > QUESTION else []))
