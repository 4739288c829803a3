"""Discover what a case's model lacks: verdict, set, probability, rivals, next experiment.

discovery = discover(case, seed=0)
discovery.verdict, discovery.missing, discovery.answer_probability
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.case.changes import OwnEffect, extended
from terrapin_tools.workbench.compare.adequacy import Failure, failure_on
from terrapin_tools.workbench.compare.comparison import (
    LEVEL,
    Analysis,
    Rung,
    analyse,
    error,
    measured,
    noise_around,
    predict,
    sds,
)
from terrapin_tools.workbench.discover.certainty import Operating, calibrated, operating_characteristic
from terrapin_tools.workbench.discover.curves_over_time import curved
from terrapin_tools.workbench.discover.decide import (
    Class,
    Decision,
    Weight,
    aliases,
    classes,
    decide,
    inclusion,
    weights,
    with_curves,
)
from terrapin_tools.workbench.discover.leftover import Doubts, around, doubts, noise_left, sd_of, stand_alone
from terrapin_tools.workbench.discover.misfit import Part, Step, front, importance, part_of
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Blamed, Ranking, rank
from terrapin_tools.workbench.discover.resampled import Selected, selection
from terrapin_tools.workbench.discover.unexplained import curve
from terrapin_tools.workbench.experiment.proposal import Experiment, propose
from terrapin_tools.workbench.formulas.free_curves import Curve
from terrapin_tools.workbench.model.constants import named
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.model.fitting import Fit, extend
from terrapin_tools.workbench.model.table_faults import Fault, at_fault
from terrapin_tools.workbench.noise.estimate import Noise

__all__ = ["Candidate", "Discovery", "discover", "rung"]

# Probability of "nothing" below which something is missing although the test, which looks at one thing at a time,
# raises no alarm. Of 382 cases in which nothing is missing and the test is silent none went below 0.23, of 20 narrow
# bumps three that it does not see did.
TOGETHER = 0.1
# Of an answer at most in whose fit a parameter is pulled beyond its bound, or which leaves far more than the scatter
# from row to row: both are what a wrong term beside a bent model looks like. Chosen by hand.
DOUBTED = 0.8
LOOKS = 2  # for rows that stand alone beside the likeliest answer
LAST = 10_000  # place of a column that compare does not list


@dataclass(frozen=True)
class Candidate:
    """One effect alone: its probability to be part of what is missing, and what adding it alone does.

    Of an expression, `probability` is that of the formula as it is written, `column_probability` that of any expression
    in its column, or of a curve in it.
    """

    effect: Effect
    kind: str
    probability: float
    column_probability: float | None
    heldout_rmse: dict[str, float | None]
    noise_ratio: float | None
    explains: float
    fit: Fit
    sd: Array


@dataclass(frozen=True)
class Discovery:
    """The answer of discover."""

    analysis: Analysis
    ranking: Ranking
    verdict: str
    missing: tuple[str, ...]
    answer_probability: float
    candidates: tuple[Candidate, ...]
    rivals: tuple[tuple[str, ...], ...]
    aliases: tuple[tuple[str, ...], ...]  # sets that do the same as what is missing, whatever is measured
    experiment: Experiment | None
    where: tuple[Failure, ...]
    ladder: tuple[Rung, ...]
    best: Rung | None  # the likeliest set, named or not
    part: Part | None  # of verdict partial: what is named takes so much of the misfit, and leaves so much where
    front: tuple[Step, ...]  # the likeliest set of no, one, two ... terms
    weighed: tuple[Weight, ...]
    blamed: Blamed | None
    unknown: Curve | None  # likelier than all else that may be missing: a function of a column, no formula known
    operating: tuple[Operating, ...]
    around: Noise | None  # the noise, estimated again around what is named
    doubts: Doubts  # that keep the answer from being sure
    selected: tuple[Selected, ...]  # by a bootstrap over runs, when one was asked for


def discover(
    case: Case,
    seed: int = 0,
    level: float = LEVEL,
    report: Callable[[str], None] = lambda _: None,
    bootstrap: int = 0,
) -> Discovery:
    """The answer of discover: what the model of a case lacks, how sure that is, and what to measure next.

    Parameters
    ----------
    seed : of everything that is drawn; the same seed gives the same answer.
    level : false alarm rate of "something is missing".
    report : is told what is being done, one short text a step.
    bootstrap : resampled sets of runs in which the choice between the answers is made anew; 0: none.

    Raises
    ------
    UserError : the model gives no number for a row; file and row are named.
    """
    return decided(weighed(case, seed, level, report), seed, level, report, bootstrap)


@dataclass(frozen=True)
class Weighed:
    """What the search gives: the analysis and the ranking; `whole`, those of all rows, where rows were left out that
    stand alone beside the likeliest answer."""

    analysis: Analysis
    ranking: Ranking
    whole: tuple[Analysis, Ranking]


def weighed(case: Case, seed: int, level: float, report: Callable[[str], None] = lambda _: None) -> Weighed:
    """Everything that may be missing, with its posterior; no decision yet."""
    report("fit of the present model, noise, adequacy")
    analysis = analyse(case, seed, level)
    ranking = with_curves(analysis, rank(analysis, report))
    first = analysis, ranking
    for _ in range(LOOKS):
        whole = (h for h in ranking.hypotheses if h.effects and h.fit is not None and h.kind != "part")
        likeliest = next(whole, None)  # a curve beside a set is no part of its fit
        if not analysis.missing or likeliest is None or likeliest.fit is None:
            break
        alone = stand_alone(analysis, likeliest.fit)
        if not alone.any():
            break
        report("again, without the rows that stand alone beside the likeliest answer")
        case = replace(case, train=case.train & ~alone, test=case.test & ~alone)
        again = analyse(case, seed, level)
        analysis = replace(again, odd=again.odd | analysis.odd | alone)
        ranking = with_curves(analysis, rank(analysis, report, ranking))
    if not analysis.missing and ranking.probability("nothing") < TOGETHER:
        analysis = replace(analysis, together=True, told=analysis.noise)
        ranking = with_curves(analysis, rank(analysis, report, ranking))
    return Weighed(analysis, ranking, first)


def decided(
    found: Weighed, seed: int, level: float, report: Callable[[str], None] = lambda _: None, bootstrap: int = 0
) -> Discovery:
    """What is said of what was weighed."""
    report("does it bring the model to the noise floor?")
    analysis, ranking, said = _said(found, level)
    said = _ahead(found.whole[0].case, ranking, said, seed, level)
    top, verdict, rivals = next(iter(said.told), None), said.verdict, said.told
    missing = top.effects if top is not None else ()
    doubted = doubts(analysis, top.fit if top is not None and top.fit is not None else analysis.fit)
    probability = min(said.probability, DOUBTED) if doubted else said.probability
    report("what to measure next")
    experiment = _telling_apart(analysis, ranking, rivals) if verdict == "ambiguous" else None
    named = top if missing else None
    answer = None if named is None else named.fit
    again = None if answer is None else noise_around(analysis.case, answer, analysis.noise, again=True)
    noise = again or analysis.told
    ranking = _with_each_alone(analysis, ranking, [h.effects for h in said.told])
    sure = dict.fromkeys(missing, probability) if verdict == "partial" else {}
    sets = said.classes or classes(analysis, ranking)
    candidates = _candidates(analysis, ranking, noise, answer, sets, sure)
    return Discovery(
        analysis=analysis,
        ranking=ranking,
        verdict=verdict,
        missing=missing,
        answer_probability=probability,
        candidates=candidates,
        rivals=tuple(h.effects for h in rivals) if verdict == "ambiguous" else (),
        aliases=aliases(analysis, ranking, said),
        experiment=experiment,
        where=_where(analysis, ranking, top, "" if missing else said.column),
        ladder=_ladder(analysis, named, noise),
        best=_ladder(analysis, top, noise)[-1] if top is not None and top.fit is not None else None,
        part=_part(analysis, said, answer, noise),
        front=front(analysis, ranking, noise.sigma, _called(sets), _whole(sets, said, probability)),
        weighed=weights(ranking, sets),
        blamed=said.blamed,
        unknown=_curve(analysis, ranking, said, answer),
        operating=_operating(ranking, named, rivals, analysis, seed),
        around=again,
        doubts=doubted,
        selected=selection(analysis, ranking, bootstrap, seed) if bootstrap else (),
    )


def _said(found: Weighed, level: float) -> tuple[Analysis, Ranking, Decision]:
    """The decision, and what it is of: all rows where rows were left out beside an answer that is none, for they may be
    what is not understood."""
    said = decide(found.analysis, found.ranking, level)
    if said.verdict in ("unexplained", "partial") and not said.blamed and found.analysis is not found.whole[0]:
        other = decide(*found.whole, level)
        if other.verdict in ("unexplained", "partial"):
            return *found.whole, other
    return found.analysis, found.ranking, said


def _ahead(case: Case, ranking: Ranking, said: Decision, seed: int, level: float) -> Decision:
    """What compare would say with the answer in the model, heard before nothing else is said to be missing: while
    something was missing, what else is wrong may have passed for a kind of noise.

    A p-value p counts for as much as it can, a Bayes factor of -e p log p (Sellke, Bayarri and Berger, 2001).
    """
    if said.verdict != "missing":
        return said
    try:
        p_value = analyse(_having(case, ranking, said.told[0]), seed, level).adequacy.p_value
    except UserError:  # so few rows that the answer takes as many parameters, which no comparison judges
        return said
    factor = -math.e * p_value * math.log(p_value) if p_value < 1.0 / math.e else 1.0
    enough = said.probability * factor / (said.probability * factor + 1.0 - said.probability)
    if enough >= level:
        return replace(said, probability=enough)
    return replace(said, verdict="partial", probability=min(said.probability, calibrated(1.0 - enough, "partial")))


def _having(case: Case, ranking: Ranking, answer: Hypothesis) -> Case:
    """The case with an answer in its model, as `add` makes it."""
    assert answer.fit is not None
    mends = {e.name: OwnEffect("", None, {}, e.mend) for e in answer.fit.model.effects if isinstance(e, Fault)}
    changes = [name for name in answer.effects if name in mends or named(name)]
    if changes:
        case = case.changed(extended(case.text, case.stated, changes, mends))
    added = [name for name in answer.effects if name not in changes]
    return replace(case, library={**case.library, **ranking.expressions}, effects=(*case.effects, *added))


def _telling_apart(analysis: Analysis, ranking: Ranking, rivals: Sequence[Hypothesis]) -> Experiment | None:
    """The runs that tell rivals apart."""
    fits = [(h.effects, h.fit) for h in rivals if h.fit is not None]
    formulas = {name: one.expression for name, one in ranking.expressions.items()}
    return propose(analysis, fits, noise_left(analysis, fits[0][1])[0], formulas)


def _whole(every: Sequence[Class], said: Decision, probability: float) -> dict[tuple[str, ...], float]:
    """Of each set that its class is called by: its probability to be all that is missing, as the verdict tells it."""
    found = {h.effects: calibrated(share, "missing") for one in every for h, share in one.names}
    if said.verdict in ("missing", "ambiguous"):
        found[said.told[0].effects] = probability
    return found


def _called(every: Sequence[Class]) -> dict[tuple[str, ...], Hypothesis]:
    """Of each set what its class is called by, with as many terms."""
    found: dict[tuple[str, ...], Hypothesis] = {}
    for one in every:
        for name, _ in reversed(one.names):
            found |= {h.effects: name for h, _ in one.members if len(h.effects) == len(name.effects)}
    return found


def _with_each_alone(analysis: Analysis, ranking: Ranking, told: Sequence[tuple[str, ...]]) -> Ranking:
    """The ranking with every formula that is told fitted alone, too: it has a card, and can be added by its name."""
    case, sigma = analysis.case, analysis.noise.sigma
    alone = dict(ranking.alone)
    for name in dict.fromkeys(name for names in told for name in names):
        if name in ranking.expressions and name not in alone:
            bound = analysis.model.having(ranking.expressions[name]).bind(case.inputs, case.train)
            fit = extend(analysis.fit, name, bound, measured(analysis.model, case.train), sigma)
            alone[name] = Hypothesis((name,), "expression", -np.inf, fit, ranking.columns[name])
    return replace(ranking, alone=alone)


def _part(analysis: Analysis, said: Decision, answer: Fit | None, noise: Noise) -> Part | None:
    if said.verdict != "partial" or answer is None:
        return None
    return part_of(analysis, answer, said.column, noise.sigma)


def _curve(analysis: Analysis, ranking: Ranking, said: Decision, answer: Fit | None) -> Curve | None:
    """The curve that has no formula, around what is named."""
    if said.column in ranking.curves:
        return ranking.curves[said.column]
    if not said.column or ranking.evidence is None:
        return None
    evidence = ranking.evidence if answer is None else around(analysis, answer, ranking.evidence.nodes)
    return curve(analysis, evidence, said.column)


def _where(analysis: Analysis, ranking: Ranking, top: Hypothesis | None, column: str = "") -> tuple[Failure, ...]:
    """What compare says; first comes `column`, or that on which the likeliest answers depend most, if there is one."""
    where = analysis.where
    shares = importance(analysis, ranking) if top is not None and where else {}
    listed = [f.variable for f in where]
    if where and column in (*listed, *numeric_columns(analysis.case)):  # which a state of own equations is not
        shares |= {column: np.inf}
    ordered = sorted(shares, key=lambda name: (-round(shares[name], 3), listed.index(name) if name in listed else LAST))
    if not ordered or ordered[0] == listed[0]:
        return tuple(where)
    first = ordered[0]
    rest = [f for f in where if f.variable != first]
    found = next((f for f in where if f.variable == first), None)
    if found is None:
        channel = analysis.model.channels.index(where[0].channel)
        values = numeric_columns(analysis.case)[first][analysis.rows]
        scaled = analysis.residual / analysis.noise.sigma[:, None]
        found = failure_on(
            analysis.case, first, values, scaled, channel, analysis.rows, analysis.model.channels, where[0].gain
        )
    return (found, *rest)


def _ladder(analysis: Analysis, top: Hypothesis | None, noise: Noise) -> tuple[Rung, ...]:
    rungs = [rung(analysis, one.added, one.fit, noise) for one in analysis.ladder]
    if top is None or top.fit is None:
        return tuple(rungs)
    beside = [f"a curve in {top.column}"] if curved(top.fit) else []
    return (*rungs, rung(analysis, "+".join([*top.effects, *beside]), top.fit, noise))


def rung(analysis: Analysis, name: str | None, fit: Fit, noise: Noise) -> Rung:
    """A step of the ladder: an answer with its errors."""
    sigma = noise.sigma
    train = error(fit, analysis.case.train, sigma)
    assert train is not None
    return Rung(name, train, error(fit, analysis.case.test, sigma), fit)


def _candidates(
    analysis: Analysis,
    ranking: Ranking,
    noise: Noise,
    answer: Fit | None,
    sets: Sequence[Class],
    sure: Mapping[str, float],
) -> tuple[Candidate, ...]:
    """`sure`: probability of what is named as part, which may stand in the place of formulas."""
    found = []
    for name, hypothesis in {**ranking.singles, **ranking.alone}.items():
        column = ranking.columns.get(name)
        each = [inclusion(ranking, sets, name), *([] if column is None else [ranking.column_inclusion(column)])]
        likely = [calibrated(p) if p > 1e-9 else 0.0 for p in each]
        likely[0] = max(likely[0], sure.get(name, 0.0))
        fit = hypothesis.fit
        assert fit is not None
        own = sds(fit, analysis.case, analysis.noise.sigma, noise) if fit is answer else sd_of(analysis, fit)
        found.append(_candidate(analysis, hypothesis, noise, own, likely[0], likely[1] if column is not None else None))
    order = {h.effects: i for i, h in enumerate(ranking.hypotheses)}
    lead = next((h.effects for h in ranking.hypotheses if h.effects), ())
    found.sort(key=lambda c: (-c.probability, c.effect.name not in lead, order.get((c.effect.name,), len(order))))
    return tuple(found)


def _candidate(
    analysis: Analysis, hypothesis: Hypothesis, noise: Noise, sd: Array, probability: float, column: float | None
) -> Candidate:
    fit = hypothesis.fit
    assert fit is not None
    case, sigma = analysis.case, noise.sigma
    effect = fit.model.effects[-1]
    rows = case.test if case.test.any() else case.train
    gap = measured(fit.model, rows) - predict(fit, rows)
    each = np.sqrt(np.mean(gap * gap, axis=1))
    held = error(fit, case.test, sigma)
    after = error(fit, rows, sigma)
    before = error(analysis.fit, rows, sigma)
    assert after is not None
    assert before is not None
    above = before * before - 1.0
    explains = (before * before - after * after) / above if above > 1e-9 else 0.0
    if not np.isfinite(after):  # it diverges on runs that it was not fitted to
        explains, held = -1.0, None
    return Candidate(
        effect=effect,
        kind=_kind(effect, hypothesis),
        probability=probability,
        column_probability=column,
        heldout_rmse={
            c: float(v) if case.test.any() and np.isfinite(v) else None
            for c, v in zip(fit.model.channels, each, strict=True)
        },
        noise_ratio=held,
        explains=float(np.clip(explains, -1.0, 1.0)),
        fit=fit,
        sd=sd,
    )


def _kind(effect: Effect, hypothesis: Hypothesis) -> str:
    return "constant" if named(effect.name) else "table" if at_fault(effect.name) else hypothesis.kind


def _operating(
    ranking: Ranking, top: Hypothesis | None, rivals: Sequence[Hypothesis], analysis: Analysis, seed: int
) -> tuple[Operating, ...]:
    """For the likeliest effect: its estimated size, and 1 noise sd."""
    if top is None or top.kind != "catalogue" or top.fit is None or any(at_fault(name) for name in top.effects):
        return ()
    name = top.effects[0]
    classes = {h.effects[0]: name for h in rivals if len(h.effects) == 1}
    size = _size(analysis, top.fit, name)
    found = [operating_characteristic(ranking, name, s, analysis.noise.node, classes, seed) for s in (size, 1.0)]
    return tuple(o for o in found if o is not None)


def _size(analysis: Analysis, fit: Fit, name: str) -> float:
    """Root mean square of an effect's contribution in noise sd, in its loudest channel."""
    bound = fit.model.bind(analysis.case.inputs, analysis.rows)
    absent = fit.theta.copy()
    at = next(i for i, f in enumerate(fit.model.fitted) if f.effect == name)
    absent[at] = np.clip(0.0, fit.model.lower[at], fit.model.upper[at])
    change = (bound.predict(fit.theta) - bound.predict(absent)) / analysis.noise.sigma[:, None]
    return float(np.sqrt((change * change).mean(axis=1).max()))
