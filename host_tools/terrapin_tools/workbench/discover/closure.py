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
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.discover.expression_answers import along, pairs_beside, paying
from terrapin_tools.workbench.discover.leftover import SAME, absent
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker, by_effect
from terrapin_tools.workbench.formulas.expressions import Sketch
from terrapin_tools.workbench.model.table_faults import scalable, usual_scales
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
        hides = _hides(ranker, standing)
        waiting = [
            h
            for h in standing
            if h.effects
            and frozenset(h.effects) not in looked_at | twins_of
            and (h.log_weight > best - CLOSE or h is hides)
            and not absent(h.fit, h.effects)
        ]
        if not waiting:
            break
        centre = max(waiting, key=lambda h: (h is hides, h.log_weight))
        if len(looked_at) >= CENTRES and centre.log_weight < best and centre is not hides:
            break  # what lies next to the best is looked at in any case
        if _is_body(ranker):
            assert centre.fit is not None
            here = centre.fit.model.bind(ranker.case.inputs, ranker.rows).predict(centre.fit.theta)
            if any((((here - one) / ranker.sigma[:, None]) ** 2).sum() < SAME for one in curves):
                twins_of.add(frozenset(centre.effects))  # what lies next to it lies next to the other one
                continue
            curves.append(here)
        looked_at.add(frozenset(centre.effects))
        if ranker.case.base.whole_runs:  # where each refit takes a while
            ranker.report(f"what lies next to the best answers: {len(looked_at)}, after {len(new)} refits")
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


def _hides(ranker: Ranker, standing: Sequence[Hypothesis]) -> Hypothesis | None:
    """The likeliest answer with a column of the user's own equations in another unit: what is missing beside it may be
    large, and shows only then."""
    if ranker.case.dynamics is None:
        return None
    scaled = {name for name, fault in ranker.faults.items() if fault.factor != 1.0}
    return max((h for h in standing if scaled.intersection(h.effects)), key=lambda h: h.log_weight, default=None)


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
        beyond = ranker.beyond(ranker.fit(rest)) if wrong else ranker.beyond(centre.fit, [member])
        promised = centre.log_weight - ranker.log_prior(centre.effects)
        found += [(*rest, n) for n in _likely(ranker, beyond, centre, ANYWAY, promised)]
        found += [(*rest, n) for n in _bent_alike(ranker, member) if n not in centre.effects]
        found += [(*rest, *names) for names in _unfolded(ranker, centre, member)]
        found += [(*rest, fault) for fault in [*_over_time(ranker, centre), *_in_another_unit(ranker, centre, member)]]
    if len(centre.effects) < MOST[0]:
        beyond = ranker.beyond(centre.fit)
        found += [(*centre.effects, n) for n in _likely(ranker, beyond, centre, (1, 1), beyond.nothing)]
        found += [(*centre.effects, fault) for fault in _over_time(ranker, centre)]
    return found


def _over_time(ranker: Ranker, centre: Hypothesis) -> list[str]:
    """Faults of the table that may stand beside a term of the user's own equations: nothing is linear in them."""
    return [name for name in ranker.faults if ranker.case.dynamics is not None and name not in centre.effects]


def _in_another_unit(ranker: Ranker, centre: Hypothesis, member: str) -> list[str]:
    """What k*force beside other terms may be: the column in another unit, which no fit without those terms shows."""
    own = ranker.sketches.get(member)
    if ranker.case.dynamics is None or own is None or own.text != f"k_*{own.column}" or not ranker.possible:
        return []
    column = next((name for name in scalable(ranker.case) if formula_name(name) == own.column), None)
    if column is None:
        return []
    assert centre.fit is not None
    model = ranker.fit(tuple(n for n in centre.effects if n != member)).model
    values = {f.key: value for f, value in zip(centre.fit.model.fitted, centre.fit.theta, strict=True)}
    start = np.array([values[f.key] for f in model.fitted])
    usual = usual_scales(ranker.case, column)
    left = [ranker.of_one_run(model.having(fault), start) for fault in usual]
    likeliest = usual[int(np.argmin(left))]
    near = ranker.of_one_run(centre.fit.model, centre.fit.theta) + 2.0 * NEAR
    if likeliest.name in ranker.faults or min(left) > near:  # no factor does what k*force does beside other terms
        return []
    ranker.faults[likeliest.name] = ranker.effects[likeliest.name] = likeliest
    return [likeliest.name]


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
    constant = _likely(ranker, ranker.beyond(fit), centre, (1, 0), np.inf)
    return [(name, one) for one in constant]


def _likely(ranker: Ranker, beyond: Evidence, centre: Hypothesis, anyway: tuple[int, int], best: float) -> list[str]:
    """Effects and formulas that explain most of what `beyond` sees beside a centre, names in their order."""
    assert centre.fit is not None
    present = centre.effects
    scores = {n: v for n, v in by_effect(beyond, ranker.flat).items() if n not in present}
    for shape in ranker.flat:
        if shape.columns.shape[1] > 1 and shape.effect not in present:  # a wave
            picks = np.arange(shape.columns.shape[1])[None, :]
            value = float(beyond.blocks(beyond.gram(shape.columns), picks, np.zeros(picks.shape))[0])
            scores[shape.effect] = max(scores.get(shape.effect, -np.inf), value)
    effects = sorted(scores, key=lambda n: -scores[n])
    top = max([best, *scores.values()])
    chosen = [n for i, n in enumerate(effects[: PROMISED[0]]) if i < anyway[0] or scores[n] > top - NEAR]
    listed = ranker.listed if ranker.case.dynamics is None else along(ranker, centre.fit, beyond)
    if not listed.sketches:
        return chosen
    order: dict[object, tuple[float, Sketch]] = {}
    logs = listed.promise(beyond)
    for i in np.argsort(-logs, kind="stable"):
        sketch = listed.sketches[i]
        # over time one refit is all that a formula gets: its likeliest scale stands for the others
        alike = (sketch.target, sketch.text) if ranker.case.base.whole_runs else i
        order.setdefault(alike, (float(logs[i]), sketch))
        if len(order) == PROMISED[1]:
            break
    top = max(best, *(value for value, _ in order.values()))
    likely = [s for i, (value, s) in enumerate(order.values()) if i < anyway[1] or value > top - NEAR]
    return chosen + [n for n in map(ranker.expression, likely) if n not in present]
