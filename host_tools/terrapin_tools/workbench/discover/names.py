"""Names of answers: what predicts the same is one answer; a catalogued name goes before formulas that imitate it.

Two sets are one where each reaches what the other predicts: supersets that add nothing, special cases, formulas that
imitate an effect, exact twins. What is told of that (`--explain`) is the posterior; the verdict has further rules.

On a real rig a small rest is nearly always left: a resistance that warms, a friction that is not quite dry. A sum of
formulas takes up effect and rest together, is likelier than the effect alone, and tells a reader nothing. Where a set
of catalogued effects with no more parameters gives the same curve but for a small share of what was found, and predicts
the held-out runs as well, the shortest such set is the answer; the rest is left to the next round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.zero_points import ZERO
from terrapin_tools.workbench.compare.comparison import Analysis, error, predict
from terrapin_tools.workbench.discover.leftover import absent, noise_left
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.model.constants import named
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.table_faults import at_fault

__all__ = ["Class", "Step", "Weight", "classes", "front", "plain_names", "weights"]

SAME = 2.0  # squared distance of two predictions [noise sd] that nobody can see
BEHIND = 0.1  # of the likeliest member's probability that another name of its class has at least: odds of ten
SMALL = 1e-2  # of the likeliest set's probability, below which a set joins no other, for time
QUESTION = 1e-6  # probability below which something is out of the question, and not listed
REST = 0.01  # share of the sum of squares of what was found that may differ; chosen by hand
WORSE = 1.03  # held-out error over that of the formulas, at most; chosen by hand
AS_LIKELY = 1.6  # log weight behind the likeliest of them within which another plain name is a rival; chosen by hand


@dataclass(frozen=True)
class Class:
    """Sets that predict the same, likeliest first, with their probabilities."""

    members: tuple[tuple[Hypothesis, float], ...]

    @property
    def mass(self) -> float:
        return float(sum(p for _, p in self.members))

    @property
    def names(self) -> list[tuple[Hypothesis, float]]:
        """What it may be called, likeliest first, with shares of its mass: none with a term more than another member,
        for it changes nothing; of the others those that say no more than the likeliest and are not far less likely, but
        for a size that is unusual; formulas only where no catalogued set is among them."""
        sets = [set(h.effects) for h, _ in self.members]
        short = [one for one in self.members if not any(other < set(one[0].effects) for other in sets)]
        first, best = short[0]
        least = [BEHIND * best * np.exp(-max(h.taxed - first.taxed, 0.0)) for h, _ in short]
        likely = [m for m, p in zip(short, least, strict=True) if m[1] >= p and m[0].parameters <= first.parameters]
        called = [m for m in likely if m[0].kind == "catalogue"] or likely
        share = self.mass / sum(p for _, p in called)
        return [(h, p * share) for h, p in called]


@dataclass(frozen=True)
class Weight:
    """Something that was weighed: `kind` set, unknown (a curve), nothing, that of a mishap, or rest (sets of which a
    term is fitted as 0 or adds so little that they were not refitted; the last one); `sets`: its names; `column`: of
    the curve, or the run. The probability is the posterior."""

    kind: str
    sets: tuple[tuple[str, ...], ...]
    column: str
    probability: float


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
    pairs = [(h, p) for h, p in ranking.pairs() if h.effects and p > QUESTION]
    sets = [(h, p) for h, p in pairs if h.fit is not None and not absent(h.fit, h.effects)]
    if not sets:
        return []
    apart, found = _Apart(analysis, ranking, sets[0][0]), list[list[tuple[Hypothesis, float]]]()
    for one, p in sets:
        near = found if p >= SMALL * sets[0][1] else []
        same = next((members for members in near if apart.alike(members[0][0], one)), None)
        if same is None:
            found.append(same := [])
        same.append((one, p))
    return sorted((Class(tuple(members)) for members in found), key=lambda c: -c.mass)


def weights(analysis: Analysis, ranking: Ranking) -> tuple[Weight, ...]:
    """All that was weighed and is not out of the question, likeliest first; what predicts the same is one."""
    found = [Weight("set", tuple(h.effects for h, _ in one.names), "", one.mass) for one in classes(analysis, ranking)]
    found += [Weight(h.kind, (), h.column, p) for h, p in ranking.pairs() if not h.effects]
    rest = 1.0 - sum(one.probability for one in found)
    found = sorted((one for one in found if one.probability > QUESTION), key=lambda one: -one.probability)
    return (*found, *([Weight("rest", (), "", rest)] if rest > QUESTION else []))


@dataclass(frozen=True)
class Step:
    """The likeliest set of so many terms: its probability to be all that is missing, and its errors in noise sd."""

    effects: tuple[str, ...]
    probability: float
    train_error: float
    heldout_error: float | None


def front(analysis: Analysis, ranking: Ranking, sigma: Array) -> tuple[Step, ...]:
    """No term, one, two ...: the likeliest set of each number, as long as more terms predict the held-out runs better,
    or the training runs where none is held out."""
    case, found = analysis.case, list[Step]()
    nothing = ranking.probability("nothing")
    steps: dict[int, tuple[tuple[str, ...], float, Fit]] = {0: ((), nothing, analysis.fit)}
    for one, p in ranking.pairs():
        if one.effects and one.fit is not None and not absent(one.fit, one.effects):
            steps.setdefault(len(one.effects), (one.effects, p, one.fit))
    for _, (effects, p, fit) in sorted(steps.items()):
        train, held = error(fit, case.train, sigma), error(fit, case.test, sigma)
        assert train is not None
        step = Step(effects, p, train, held)
        if found and _error(step) >= _error(found[-1]):
            break
        found.append(step)
    return tuple(found)


def _error(step: Step) -> float:
    return step.train_error if step.heldout_error is None else step.heldout_error


def plain_names(analysis: Analysis, ranking: Ranking, top: Hypothesis) -> tuple[list[Hypothesis], float]:
    """Sets of catalogued effects that do what an answer with formulas does, likeliest first, and the probability of the
    first: its share of that of all answers that are this curve.

    The shortest such set; several if they are about as likely; none if there is none, or no formula in the answer.
    """
    if top.kind == "catalogue" or top.fit is None:
        return [], 0.0
    found = _curve(analysis, top.fit) - _curve(analysis, analysis.fit)
    allowed = REST * float((found * found).sum())
    alike = [one for one in _plain(ranking) if _instead(analysis, one.fit, top.fit, allowed)]
    shortest = min((len(one.effects) for one in alike), default=0)
    alike = [one for one in alike if len(one.effects) == shortest]
    alike = [one for one in alike if one.log_weight > alike[0].log_weight - AS_LIKELY]
    if not alike:
        return [], 0.0
    same = [
        float(p)
        for h, p in zip(ranking.hypotheses, ranking.posterior, strict=True)
        if h.effects and h.fit is not None and _gap(analysis, h.fit, alike[0].fit) <= allowed
    ]
    return alike, sum(same) / sum(float(np.exp(one.log_weight - alike[0].log_weight)) for one in alike)


def _plain(ranking: Ranking) -> list[Hypothesis]:
    """Refitted sets of catalogued effects, likeliest first; what may be wrong in the case is no effect."""
    return [
        one
        for one in ranking.hypotheses
        if one.kind == "catalogue"
        and one.effects
        and not any(named(name) or at_fault(name) or name.startswith(ZERO) for name in one.effects)
        and not absent(one.fit, one.effects)
    ]


def _instead(analysis: Analysis, fit: Fit | None, top: Fit, allowed: float) -> bool:
    if fit is None or len(fit.theta) > len(top.theta) or _gap(analysis, fit, top) > allowed:
        return False
    held, after = (error(one, analysis.case.test, analysis.noise.sigma) for one in (top, fit))
    return held is None or after is None or max(after, 1.0) <= WORSE * max(held, 1.0)


def _curve(analysis: Analysis, fit: Fit) -> Array:
    return np.asarray(predict(fit, analysis.rows) / analysis.noise.sigma[:, None])


def _gap(analysis: Analysis, first: Fit, other: Fit | None) -> float:
    if other is None:
        return np.inf
    gap = _curve(analysis, first) - _curve(analysis, other)
    return float((gap * gap).sum())
