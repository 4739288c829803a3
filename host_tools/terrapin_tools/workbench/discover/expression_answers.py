"""What no catalogue has: short expressions alone, in pairs, and beside an effect of the catalogue.

They compete with all other answers. Every pair of the likeliest expressions, and of one with an effect, is judged in
closed form around the present fit, so that a sum is found even where neither of its terms looks like much alone. Longer
sums come from what lies next to the best answers, and from pairs beside their terms (closure.py). An answer has a few
terms, so that a person can read it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.instruments import ZERO
from terrapin_tools.workbench.compare.comparison import error
from terrapin_tools.workbench.discover.leftover import absent, doubts, pays
from terrapin_tools.workbench.discover.ranker import WITHIN, Hypothesis, Ranker
from terrapin_tools.workbench.formulas.expressions import Library, Sketch, library
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.priors import SIZE_OF_SET, of_terms
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["along", "expression_pairs", "expressions", "pairs_beside", "paying"]

REFITTED = 6  # expressions; chosen by hand, for time
OF_ONE_COLUMN = 2  # of them at most: shapes of one column look alike, and another column must get its chance
INSTEAD = 4  # likeliest terms around the best refit; chosen by hand, for time
POOL = 220  # expressions of which all pairs are judged; chosen by hand, for time
OF_EACH_COLUMN = 8  # of them at least, in the order of their evidence; chosen by hand
PAIRS_REFITTED = (6, 4)  # pairs of expressions, and of one with an effect; chosen by hand, for time


def expressions(ranker: Ranker, absurd: Collection[str] = ()) -> list[Hypothesis]:
    """Expressions around the present fit; where something is missing the best are refitted, the others weigh as a
    group. `absurd`: effects of a size that none of them has, whose curve may be that of something else."""
    flat = ranker.base.reshape(ranker.values.size, -1)
    zeros = {name for name in ranker.effects if name.startswith(ZERO)}
    ranker.listed = listed = library(
        ranker.model,
        ranker.analysis.fit.theta,
        ranker.rows,
        ranker.sigma,
        ranker.columns_without({*absurd, *zeros}),
        flat,
        ranker.misfit,
        ranker.columns_without(ranker.effects.keys() - zeros),
        None if ranker.case.base.whole_runs else ranker.analysis.residual / ranker.sigma[:, None],
    )
    if not listed.sketches:
        return []
    share = np.log(SIZE_OF_SET[1] * of_terms(ranker.kinds)["formula"])
    ranker.promised = listed.promise(ranker.evidence)
    weight = ranker.promised + share
    found: list[Hypothesis] = []
    grouped: dict[str, list[float]] = {}
    tried: dict[str, int] = {}
    texts: set[tuple[str, str]] = set()
    for index in np.argsort(-weight, kind="stable"):
        chosen = listed.sketches[index]
        room = len(found) < REFITTED and tried.get(chosen.column, 0) < OF_ONE_COLUMN
        if ranker.case.base.whole_runs:  # one start of a shape is enough where each refit takes a while
            room &= (chosen.target, chosen.text) not in texts
        if room and ranker.analysis.missing:
            texts.add((chosen.target, chosen.text))
            tried[chosen.column] = tried.get(chosen.column, 0) + 1
            name = ranker.expression(chosen)
            found.append(ranker.weighed((name,), float(weight[index]) - ranker.log_prior((name,))))
        else:
            grouped.setdefault(chosen.column, []).append(float(weight[index]))
    if ranker.analysis.missing and doubts(ranker.analysis, ranker.analysis.fit):
        found += [ranker.weighed((ranker.expression(one),)) for one in _as_stated(ranker, texts)]
    if ranker.case.dynamics is not None and (sound := [h for h in found if h.fit and ranker.sound(h.fit, h.effects)]):
        best = max(sound, key=lambda h: h.log_weight)  # of those that run off on no run
        found += [ranker.weighed((ranker.expression(one),)) for one in _instead(ranker, best, texts)]
    found += [Hypothesis((), "expression", float(logsumexp(v)), None, column) for column, v in grouped.items()]
    return found


def _instead(ranker: Ranker, best: Hypothesis, tried: set[tuple[str, str]]) -> list[Sketch]:
    """Sketches that could stand for the best refitted one, judged around the motion that it gives.

    A lacking term bends the motion of equations of the user's own. Around the best refit the motion is nearly right,
    and with it the terms along it; around the present fit it is not.
    """
    assert best.fit is not None
    return _along(ranker, best.fit, ranker.beyond(best.fit, best.effects[:1]), tried)


def _as_stated(ranker: Ranker, tried: set[tuple[str, str]]) -> list[Sketch]:
    """Sketches judged around the values that the user gives the parameters of equations of the user's own.

    A fit that lacks a term may drive a parameter to where the equations are no motor any more (no inertia, no constant
    of torque): along such a motion no term is right, and none is near.
    """
    fit = replace(ranker.analysis.fit, theta=ranker.model.start, at_bound=())
    if not np.isfinite(fit.model.bind(ranker.case.inputs, ranker.rows).predict(fit.theta)).all():
        return []
    return _along(ranker, fit, ranker.beyond(fit), tried)


def along(ranker: Ranker, fit: Fit, beyond: Evidence) -> Library:
    """The sketches that differ along the motion of a fit."""
    none = np.zeros((ranker.values.size, 0))
    return library(fit.model, fit.theta, ranker.rows, ranker.sigma, none, beyond.flat, ranker.misfit)


def _along(ranker: Ranker, fit: Fit, beyond: Evidence, tried: set[tuple[str, str]]) -> list[Sketch]:
    """The likeliest sketches along the motion of a fit, which are tried from now on."""
    listed = along(ranker, fit, beyond)
    logs = listed.promise(beyond)
    chosen: dict[tuple[str, str], Sketch] = {}
    for index in np.argsort(-logs, kind="stable")[:INSTEAD]:
        sketch = listed.sketches[index]
        if (sketch.target, sketch.text) not in tried:
            chosen.setdefault((sketch.target, sketch.text), sketch)
    tried.update(chosen)
    return list(chosen.values())


def expression_pairs(ranker: Ranker) -> list[Hypothesis]:
    """The best pairs of two expressions, and of an expression with an effect, refitted."""
    listed = ranker.listed
    if not listed.sketches:
        return []
    pool = _pool(ranker, ranker.promised)
    shapes = [i for i, s in enumerate(ranker.flat) if s.columns.shape[1] == 1]
    every = [listed.columns[:, pool], *(ranker.flat[i].columns for i in shapes)]
    gram = ranker.evidence.gram(np.concatenate(every, axis=1))
    prior = np.log([listed.sketches[i].prior for i in pool])
    count = len(pool)
    first, second = np.triu_indices(count, 1)
    both = ranker.evidence.pairs(gram, first, second) + prior[first] + prior[second]
    names: list[tuple[str, ...]] = []
    for i in np.argsort(-both, kind="stable"):
        pair = (_named(ranker, pool[first[i]]), _named(ranker, pool[second[i]]))
        if pair[0] != pair[1] and pair not in names:
            names.append(pair)
        if len(names) == PAIRS_REFITTED[0]:
            break
    if shapes:
        one, effect = (a.reshape(-1) for a in np.meshgrid(np.arange(count), np.arange(len(shapes)), indexing="ij"))
        mixed = ranker.evidence.pairs(gram, one, count + effect) + prior[one]
        taken: set[str] = set()
        for i in np.argsort(-mixed, kind="stable"):
            name = ranker.flat[shapes[effect[i]]].effect
            if name not in taken:  # each effect beside the expression that suits it best
                taken.add(name)
                names.append((name, _named(ranker, pool[one[i]])))
            if len(taken) == PAIRS_REFITTED[1]:
                break
    return [ranker.weighed(pair) for pair in names]


def pairs_beside(ranker: Ranker, name: str, most: int) -> list[tuple[str, str]]:
    """The likeliest pairs of expressions beside one term, of all around the model that has it."""
    fit = ranker.fit((name,))
    if not ranker.sound(fit, (name,)):
        return []
    beyond = ranker.beyond(fit)
    pool = _pool(ranker, ranker.listed.promise(beyond))
    first, second = np.triu_indices(len(pool), 1)
    prior = np.log([ranker.listed.sketches[i].prior for i in pool])
    both = beyond.pairs(beyond.gram(ranker.listed.columns[:, pool]), first, second) + prior[first] + prior[second]
    best = np.argsort(-both, kind="stable")[:most]
    pairs = [(_named(ranker, pool[first[i]]), _named(ranker, pool[second[i]])) for i in best]
    return [pair for pair in pairs if name not in pair]


def _pool(ranker: Ranker, logs: Array) -> list[int]:
    """The likeliest expressions, of every column some."""
    order = np.argsort(-logs, kind="stable").tolist()
    columns: dict[str, list[int]] = {}
    for i in order:
        columns.setdefault(ranker.listed.sketches[i].column, []).append(i)
    chosen = [i for members in columns.values() for i in members[:OF_EACH_COLUMN]]
    return list(dict.fromkeys([*chosen, *order]))[: max(POOL, len(chosen))]


def _named(ranker: Ranker, index: int) -> str:
    return ranker.expression(ranker.listed.sketches[index])


def paying(ranker: Ranker, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The answers without those of several terms of which one does not pay on the held-out runs: an expression, and any
    effect of a body over time, of whose motion no model has every detail, or where the noise sd is an estimate. That is
    too large where what is missing differs between equal settings (a friction that turns round), and then the smallest
    flaw of an effect's shape would earn it company. There it must also pay beside the shorter set of effects that
    predicts the held-out runs best, whatever that is made of. So must a formula of a body with a scale or reference of
    its own, beside the one effect without: k*(x - x0) is a loss and a constant."""
    known = {frozenset(h.effects): h.fit for h in found if h.fit is not None}
    kept: list[Hypothesis] = []
    body = ranker.case.base.whole_runs and ranker.case.dynamics is None
    every = body or not ranker.analysis.noise.known.all()
    best = _best_heldout(ranker, found) if every else []
    for h in sorted(found, key=lambda h: -h.log_weight):
        own = [name for name in h.effects if name in ranker.sketches or every]
        if len(h.effects) > 1 and own and h.fit is not None:
            if absent(h.fit, h.effects):
                continue
            shorter = [tuple(n for n in h.effects if n != name) for name in own]
            near = not kept or h.log_weight > kept[0].log_weight - WITHIN
            asked = [known[frozenset(n)] for n in shorter if frozenset(n) in known]
            asked += best[: len(h.effects) - 1][-1:] if every else []
            more = (n for n in shorter if frozenset(n) not in known and near)
            if not all(pays(ranker.analysis, h.fit, fit) for fit in chain(asked, map(ranker.fit, more))):
                continue
        elif body and own and h.fit is not None and h.effects[0] in ranker.sketches:
            known_law = [fit for fit in best[:1] if len(fit.theta) < len(h.fit.theta)]
            if not all(pays(ranker.analysis, h.fit, fit) for fit in known_law):
                continue
        kept.append(h)
    return kept


def _best_heldout(ranker: Ranker, found: Sequence[Hypothesis]) -> list[Fit]:
    """Of the sets of at most one, two ... effects those that predict the held-out runs best; none without such runs."""
    case, sigma = ranker.case, ranker.analysis.noise.sigma
    sets = [h for h in found if h.kind == "catalogue" and h.fit is not None and not absent(h.fit, h.effects)]
    errors = {id(h): value for h in sets if h.fit and (value := error(h.fit, case.test, sigma)) is not None}
    chosen: list[Fit] = []
    for count in range(1, max((len(h.effects) for h in sets), default=0) + 1):
        upto = [h for h in sets if len(h.effects) <= count and id(h) in errors]
        if upto:
            fit = min(upto, key=lambda h: errors[id(h)]).fit
            assert fit is not None
            chosen.append(fit)
    return chosen
