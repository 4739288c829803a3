"""What lies next to the best answers: each of them with one member exchanged, added or taken away, refitted.

Around the fit of the present model, a set of large effects may look worse than it is by any amount. Around an answer,
its neighbours are seen as they are: what takes the place of a member is asked with the member's contribution given back
to the residual and all other parameters free, so an effect that does the same on these data cannot be missed, however
large it is. What comes near the best is refitted, and has neighbours of its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.discover.expression_answers import pairs_beside, paying
from terrapin_tools.workbench.discover.leftover import SAME, absent
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker, by_effect
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["neighbours"]

CLOSE = 3.0  # log weight behind the best within which an answer's own neighbours are looked at; chosen by hand
CENTRES = 6  # answers whose neighbours are looked at, or as many more that lead in turn; chosen by hand, for time
ANYWAY = (3, 2)  # effects and formulas that are refitted in the place of a member, whatever is promised; by hand
PROMISED = (6, 4)  # of those within NEAR of the best; chosen by hand
NEAR = 8.0  # log evidence behind the best that a promise may lie and be refitted; chosen by hand
BESIDE = 6  # members of answers beside which pairs of formulas are looked for; chosen by hand, for time
PAIRS = 2  # of them that are refitted; chosen by hand, for time
BENDS = re.compile(r"tanh\(\w+/\w+\)|exp\(-(?:\w+|abs\(\w+\))/\w+\)|\b(\w+)/\((?:\1|abs\(\1\)) \+ \w+\)")
REFERENCE = re.compile(r"\((\w+) - x0_*\)")
MOST = (4, 3)  # terms of an answer, and expressions among them: a person shall read it


def neighbours(ranker: Ranker, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Answers next to the best of those found, refitted; without those found already."""
    known = {frozenset(h.effects): h for h in found if h.fit is not None}
    new: list[Hypothesis] = []
    looked_at: set[frozenset[str]] = set()
    beside: set[str] = set()
    curves: list[Array] = []  # predicted by the answers looked at, of a body over time
    twins_of: set[frozenset[str]] = set()
    while len(looked_at) < 2 * CENTRES:
        standing = _standing(ranker, list(known.values()))
        best = max(h.log_weight for h in standing)
        waiting = [
            h
            for h in standing
            if h.effects
            and frozenset(h.effects) not in looked_at | twins_of
            and (h.log_weight > best - CLOSE or _hides(ranker, h))
            and not absent(h.fit, h.effects)
        ]
        if not waiting:
            break
        centre = max(waiting, key=lambda h: (_hides(ranker, h), h.log_weight))
        if len(looked_at) >= CENTRES and centre.log_weight < best and not _hides(ranker, centre):
            break  # what lies next to the best is looked at in any case
        if _is_body(ranker):
            assert centre.fit is not None
            here = centre.fit.model.bind(ranker.case.inputs, ranker.rows).predict(centre.fit.theta)
            if any((((here - one) / ranker.sigma[:, None]) ** 2).sum() < SAME for one in curves):
                twins_of.add(frozenset(centre.effects))  # what lies next to it lies next to the other one
                continue
            curves.append(here)
        looked_at.add(frozenset(centre.effects))
        kept = (
            [n for n in centre.effects if n not in beside][: BESIDE - len(beside)]
            if _of_formulas(ranker, centre)
            else []
        )
        beside.update(kept)
        pairs = [(one, *pair) for one in kept for pair in pairs_beside(ranker, one, PAIRS)]
        for names in [*_next_to(ranker, centre), *pairs]:
            key = frozenset(names)
            if (
                key
                and key not in known
                and ranker.together_possible(names)
                and sum(n in ranker.sketches for n in names) <= MOST[1]
            ):
                known[key] = ranker.weighed(names)
                new.append(known[key])
    return new


def _hides(ranker: Ranker, one: Hypothesis) -> bool:
    """Whether it is a column of the user's own equations in another unit: what is missing beside it may be large, and
    shows only then."""
    faults = [ranker.faults[name] for name in one.effects if name in ranker.faults]
    return ranker.case.dynamics is not None and len(one.effects) == 1 and any(f.factor != 1.0 for f in faults)


def _is_body(ranker: Ranker) -> bool:
    return ranker.case.base.whole_runs and ranker.case.dynamics is None


def _standing(ranker: Ranker, known: list[Hypothesis]) -> list[Hypothesis]:
    """Those that others are built upon. Of a body over time, where each refit takes long, what the held-out runs would
    not let stand has no neighbours: a motion that no model has in every detail earns term after term."""
    if not _is_body(ranker):
        return known
    least = max(h.log_weight for h in known if len(h.effects) < 2) - CLOSE
    return paying(ranker, [h for h in known if h.log_weight > least or len(h.effects) < 2])


def _of_formulas(ranker: Ranker, centre: Hypothesis) -> bool:
    """Whether formulas explain an answer, in a model whose columns stay as they are where a term is added."""
    return ranker.case.dynamics is None and any(name in ranker.sketches for name in centre.effects)


def _next_to(ranker: Ranker, centre: Hypothesis) -> list[tuple[str, ...]]:
    found: list[tuple[str, ...]] = []
    assert centre.fit is not None
    if not ranker.sound(centre.fit, centre.effects):
        return found
    if len(centre.effects) > 1:
        found += [tuple(n for n in centre.effects if n != member) for member in centre.effects]
    for member in centre.effects:
        rest = tuple(n for n in centre.effects if n != member)
        wrong = member in ranker.faults
        beyond = ranker.beyond(ranker.fit(rest)) if wrong else ranker.beyond(centre.fit, member)
        promised = centre.log_weight - ranker.log_prior(centre.effects)
        found += [(*rest, n) for n in _likely(ranker, beyond, centre.effects, ANYWAY, promised)]
        found += [(*rest, n) for n in _bent_alike(ranker, member) if n not in centre.effects]
        found += [(*rest, *names) for names in _unfolded(ranker, centre, member)]
        found += [(*rest, fault) for fault in _over_time(ranker, centre)]
    if len(centre.effects) < MOST[0]:
        beyond = ranker.beyond(centre.fit)
        found += [(*centre.effects, n) for n in _likely(ranker, beyond, centre.effects, (1, 1), beyond.nothing)]
        found += [(*centre.effects, fault) for fault in _over_time(ranker, centre)]
    return found


def _over_time(ranker: Ranker, centre: Hypothesis) -> list[str]:
    """Faults of the table that may stand beside a term of the user's own equations: nothing is linear in them."""
    return [name for name in ranker.faults if ranker.case.dynamics is not None and name not in centre.effects]


def _bent_alike(ranker: Ranker, member: str) -> list[str]:
    """Formulas that bend the same column towards a limit in another way: tanh(x/w), x/(x + x0), exp(-x/tau). Which one
    it is shows when each has its own scale, not at the scales that are looked at."""
    own = ranker.sketches.get(member)
    if own is None or not own.scales or BENDS.search(own.text) is None:
        return []
    shape = BENDS.sub("", own.text)
    others = {
        BENDS.search(s.text).group(): s  # type: ignore[union-attr]  # of those that match
        for s in ranker.listed.sketches
        if s.target == own.target and s.column == own.column and s.text != own.text and BENDS.sub("", s.text) == shape
    }
    return [ranker.expression(sketch) for sketch in others.values()]


def _unfolded(ranker: Ranker, centre: Hypothesis, member: str) -> list[tuple[str, ...]]:
    """k*(x - x0) as k*x and the effect that does most of what a constant does."""
    own = ranker.sketches.get(member)
    plain = REFERENCE.sub(r"\1", own.text) if own is not None else ""
    if own is None or plain == own.text or ranker.case.base.whole_runs:
        return []
    line = next((s for s in ranker.listed.sketches if (s.target, s.text) == (own.target, plain)), None)
    if line is None:
        return []
    name = ranker.expression(line)
    fit = ranker.fit((*(n for n in centre.effects if n != member), name))
    constant = _likely(ranker, ranker.beyond(fit), centre.effects, (1, 0), np.inf)
    return [(name, one) for one in constant]


def _likely(
    ranker: Ranker, beyond: Evidence, present: Sequence[str], anyway: tuple[int, int], best: float
) -> list[str]:
    """Effects and formulas that explain most of what `beyond` sees, names in their order."""
    scores = {n: v for n, v in by_effect(beyond, ranker.flat).items() if n not in present}
    for shape in ranker.flat:
        if shape.columns.shape[1] > 1 and shape.effect not in present:  # a wave
            picks = np.arange(shape.columns.shape[1])[None, :]
            value = float(beyond.blocks(beyond.gram(shape.columns), picks, np.zeros(picks.shape))[0])
            scores[shape.effect] = max(scores.get(shape.effect, -np.inf), value)
    effects = sorted(scores, key=lambda n: -scores[n])
    top = max([best, *scores.values()])
    chosen = [n for i, n in enumerate(effects[: PROMISED[0]]) if i < anyway[0] or scores[n] > top - NEAR]
    if not ranker.listed.sketches:
        return chosen
    logs = ranker.listed.promise(beyond)
    order = np.argsort(-logs, kind="stable")[: PROMISED[1]]
    top = max([best, float(logs[order[0]])])
    likely = [int(i) for place, i in enumerate(order) if place < anyway[1] or logs[i] > top - NEAR]
    named = [ranker.expression(ranker.listed.sketches[i]) for i in likely]
    return chosen + [n for n in named if n not in present]
