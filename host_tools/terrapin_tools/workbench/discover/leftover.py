"""Tests whether the named effects leave only noise, and whether an expression beside effects pays on held-out runs.

"Missing" promises that the named set brings the model to the noise floor. `left` tests that for the extended model,
with the statistic of the first question (bayes_factor.py) and the sum of squares. No simulation is needed here: a Bayes
factor of b has a p-value of at most 1/b (Markov's inequality), and only clear cases count.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import fdtrc

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.signals import row_scatter
from terrapin_tools.workbench.compare.bayes_factor import BayesFactor, blocks_of
from terrapin_tools.workbench.compare.comparison import Analysis, error, free_slopes, measured, predict, sds
from terrapin_tools.workbench.formulas.expressions import FOUND
from terrapin_tools.workbench.model.constants import suspected
from terrapin_tools.workbench.model.data_columns import column_shapes, numeric_columns
from terrapin_tools.workbench.model.effect_columns import shapes_of_each, terms_of
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.linearised import bounds, following
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.estimate import repeated_settings
from terrapin_tools.workbench.noise.kinds import Node
from terrapin_tools.workbench.noise.marginal_likelihood import STATED, Evidence
from terrapin_tools.workbench.noise.odd import farthest, gathered, odd_limit, standing_alone

__all__ = [
    "Doubts",
    "Left",
    "absent",
    "allowed",
    "around",
    "doubts",
    "left",
    "noise_left",
    "pays",
    "sd_of",
    "stand_alone",
]

# A set clearly leaves something where the p-value is below the level over CLEARLY and an error is above FLOOR, a misfit
# of half a noise sd. Both chosen by hand.
CLEARLY = 50.0
FLOOR = np.sqrt(1.25)
SAME = 2.0  # squared distance of two predictions [noise sd] that nobody can see
SETTINGS = 6  # that are repeated in several runs, to ask what they have in common; chosen by hand
PULLED = 9.0  # of its variance that a parameter at its bound would gain beyond it: three sd, as usual
RESTLESS = 2.0  # times the scatter from row to row that what is left may be, of white noise: 1; chosen by hand
SURELY = 20.0  # times as likely as none, from which a lag is allowed for; chosen by hand, as usual
PART = 0.1  # of what is left beside a body over time; chosen by hand, as what a term brings beside a curve
NOISE = 2.0  # standard deviations of the mean square above 1 that noise may explain: the usual two sd


@dataclass(frozen=True)
class Left:
    """What an extended model leaves: errors on training and held-out runs, in noise sd, and a p-value.

    `p_value` bounds that of "it leaves only noise". It is 1 where the errors are at the floor and nothing needs a test.
    """

    train_error: float
    heldout_error: float | None
    p_value: float

    def clearly(self, level: float) -> bool:
        return self.p_value < level / CLEARLY


@dataclass(frozen=True)
class Doubts:
    """Why an answer is not sure: parameters that stand at a bound beyond which the data pull them, and channels in
    which so many times the scatter from row to row is left."""

    at_bound: tuple[str, ...] = ()
    restless: Mapping[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.at_bound or self.restless)


def noise_left(analysis: Analysis, fit: Fit) -> tuple[Node, float]:
    """The likeliest kind of noise around an answer, and the sd of a row in it, in noise sd of the analysis: what is
    missing looks like offsets of the runs as long as it is."""
    return around(analysis, fit, analysis.noise.kinds).likeliest()


def around(analysis: Analysis, fit: Fit, nodes: Collection[int] | None) -> Evidence:
    """Evidence of what is missing beside an answer; `nodes`: kinds of noise, places in NODES."""
    sigma, rows = analysis.noise.sigma, analysis.rows
    prediction, residual, slopes = free_slopes(fit, sigma, rows, released=True)
    base = np.concatenate([slopes / sigma[:, None, None], analysis.nuisance], axis=-1)
    runs = Runs(analysis.case.run[rows], len(residual), prediction, analysis.felt, ~analysis.noise.known)
    return Evidence(runs, residual / sigma[:, None], base, analysis.noise.behind, nodes, bounds(fit)[following(fit)])


def sd_of(analysis: Analysis, fit: Fit) -> Array:
    """Sd of each parameter of an answer, in the noise that it leaves: (parameters,)."""
    node, row = noise_left(analysis, fit)
    known = analysis.noise.known | (node.rest is None)  # whose sd is that of a row
    noise = replace(analysis.noise, sigma=row * analysis.noise.sigma, node=node, known=known)
    return sds(fit, analysis.case, analysis.noise.sigma, noise)


def stand_alone(analysis: Analysis, fit: Fit) -> Mask:
    """Rows (all rows,) that lie far off what the others say of them around an answer; none where so many do.

    Parameters
    ----------
    fit : of the model with the answer, on the training runs.
    """
    case, noise, rows = analysis.case, analysis.noise, analysis.rows
    prediction, residual, slopes = free_slopes(fit, noise.sigma, rows)
    felt = [None] * len(prediction) if analysis.felt is None else [one[None] for one in analysis.felt]
    runs = [Runs(case.run[rows], level=one[None], felt=own) for one, own in zip(prediction, felt, strict=True)]
    columns = np.concatenate([slopes / noise.sigma[:, None, None], analysis.nuisance], axis=-1)
    stated = [float(sigma) if known else None for sigma, known in zip(noise.sigma, noise.known, strict=True)]
    odd = standing_alone(runs, list(residual), [orthonormal(one) for one in columns], stated)
    found = np.zeros(case.rows, dtype=bool)
    found[np.flatnonzero(rows)[odd]] = True
    few = (found | analysis.odd).sum() <= odd_limit(case.rows)
    accidents = few and not gathered(found, farthest(residual, rows), case.run, numeric_columns(case), rows)
    return found if accidents else np.zeros_like(found)


def doubts(analysis: Analysis, fit: Fit) -> Doubts:
    """What speaks against a fit, although no better one is known: parameters of the model, or scales of a formula that
    was found, that the data pull beyond their bounds; of equations over time what its rows do not scatter, of a channel
    whose sd is not stated."""
    case = analysis.case
    asked = {None, *(effect.name for effect in fit.model.effects if effect.source == FOUND)}
    own = [f.key for f in fit.model.fitted if f.effect in asked and f.key in fit.at_bound]
    slopes = fit.jacobian.reshape(fit.residual.size, -1)
    free = orthonormal(slopes[:, [f.key not in fit.at_bound for f in fit.model.fitted]])
    residual = fit.residual.reshape(-1)
    variance = float(residual @ residual) / max(residual.size - free.shape[1], 1)
    pulled = []
    for key in own:
        slope = slopes[:, next(i for i, f in enumerate(fit.model.fitted) if f.key == key)]
        slope = slope - free @ (free.T @ slope)
        if float(slope @ residual) ** 2 > PULLED * variance * float(slope @ slope):
            pulled.append(key)
    restless: dict[str, float] = {}
    if case.dynamics is None:
        return Doubts(tuple(pulled))
    for channel, values, known in zip(fit.model.channels, _left_of(analysis, fit), analysis.noise.known, strict=True):
        quiet = row_scatter(case.channels[channel], case.run)
        times = float(np.sqrt(np.mean(values * values))) / max(quiet, 1e-300)
        if quiet > 0.0 and times > RESTLESS and not known:
            restless[channel] = times
    return Doubts(tuple(pulled), restless)


def _left_of(analysis: Analysis, fit: Fit) -> Array:
    """Measured minus predicted (channels, rows), in the channels' units."""
    return measured(fit.model, analysis.rows) - predict(fit, analysis.rows)


def left(analysis: Analysis, fit: Fit) -> Left:
    """What a fit on the training runs leaves, judged on all rows with its parameters free to follow.

    Parameters
    ----------
    analysis : of the case; its noise sd is kept.
    fit : of the model with the named effects, on the training runs.
    """
    case, rows, sigma = analysis.case, analysis.rows, analysis.noise.sigma
    train, held = error(fit, case.train, sigma), error(fit, case.test, sigma)
    assert train is not None, "a case has training rows"
    if max(train, held or 0.0) <= FLOOR:
        return Left(train, held, 1.0)
    prediction, residual, slopes = free_slopes(fit, sigma, rows)
    scaled = residual / sigma[:, None]
    runs = Runs(case.run[rows], len(scaled), prediction, analysis.felt, ~analysis.noise.known)
    base = np.concatenate([slopes / sigma[:, None, None], analysis.nuisance], axis=-1)
    # a sensor that lags misreads each row a little, and is no reason to doubt what was named
    wrong = [one for one in analysis.mishaps if one.kind != "lag"]
    late = [one.columns for one in analysis.mishaps if one.kind == "lag"]
    if late and _lags(Evidence(runs, scaled, base, analysis.noise.behind), late):
        base = np.concatenate([base, *(columns.reshape(*scaled.shape, -1) for columns in late)], axis=-1)
    p_value = _squares(Evidence(runs, scaled, base, analysis.noise.behind), float(np.min(analysis.noise.freedom)))
    effects = shapes_of_each(fit.model, fit.theta, suspected(fit.model), rows, sigma)
    effects |= {name: list(shapes) for name, shapes in terms_of(fit.model, fit.theta, rows, sigma).items()}
    blocks = blocks_of(effects, column_shapes(case, rows), runs, wrong=wrong)
    factor = float(BayesFactor(runs, base, blocks)(scaled.reshape(-1, 1))[0][0])
    return Left(train, held, float(min(p_value, np.exp(-max(factor, 0.0)), _repeated(analysis, fit, residual))))


def _lags(around: Evidence, late: Sequence[Array]) -> bool:
    """Whether a lag of some channel clearly explains what an answer leaves."""
    return bool(around.single(np.concatenate(late, axis=1)).max() - around.nothing > np.log(SURELY))


def _repeated(analysis: Analysis, fit: Fit, residual: Array) -> float:
    """p-value of "rows of equal settings in several runs have nothing in common" (lack of fit): noise that is alike
    from row to row is not alike from run to run, and a shape that no column's polynomial has is."""
    case, rows, node = analysis.case, analysis.rows, analysis.noise.node
    if case.base.whole_runs:
        return 1.0
    run = case.run[rows]
    group = repeated_settings({name: values[rows] for name, values in case.roles.items()}, len(run))
    count = np.bincount(group)
    runs = np.array([len(np.unique(run[group == one])) for one in np.flatnonzero(count > 1)])
    if len(runs) < SETTINGS or runs.min() < 2:
        return 1.0
    found = 1.0
    for channel in residual:
        mean = np.bincount(group, channel) / count
        within = float(((channel - mean[group]) ** 2).sum())
        below = len(run) - len(count)
        above = len(count) - len(fit.theta)
        if above < 1 or below < 1 or within <= 0.0:
            continue
        ratio = float((count * mean * mean).sum()) / above / (within / below)
        found = min(found, float(fdtrc(_independent(above, node), _independent(below, node), ratio)))
    return found


def _squares(evidence: Evidence, behind_sigma: float) -> float:
    """p-value of the whitened sum of squares, averaged over the kinds of noise as likely as these residuals make them.

    `behind_sigma`: degrees of freedom of an estimated noise sd; inf where it is stated, which counts as STATED.
    """
    behind = behind_sigma if np.isfinite(behind_sigma) else STATED
    return float((evidence.posterior * fdtrc(evidence.freedom, behind, evidence.total / evidence.freedom)).sum())


def absent(fit: Fit | None, names: Sequence[str]) -> bool:
    """Whether any of the effects was fitted with size 0, at its bound or without influence. It is then not there."""
    if fit is None:
        return False
    sizes = {f.effect: value for f, value in reversed(list(zip(fit.model.fitted, fit.theta, strict=True)))}
    return any(sizes.get(name) == 0.0 for name in names)  # a fault of the table has no size


def allowed(count: int, node: Node) -> float:
    """Mean square, in noise variances, up to which `count` rows of noise may lie (Bartlett's variance)."""
    return float(1.0 + NOISE * np.sqrt(2.0 / _independent(max(count, 1), node)))


def _independent(count: int, node: Node) -> float:
    """Independent rows whose mean square scatters as much as that of `count` correlated ones."""
    rho = node.share * node.rho
    return count * (1.0 - rho * rho) / (1.0 + rho * rho)


def pays(analysis: Analysis, longer: Fit, shorter: Fit) -> bool:
    """Whether a further expression is worth naming, judged by the held-out error of the two fits.

    The error must fall. Where the shorter answer's training and held-out error are within what noise allows, the fall
    must be significant: a likelihood ratio above 1 over the level on the held-out runs. It counts down to the
    floor only. An error below 1 is luck, or a noise sd that is stated too large; it shows no effect. Where a body over
    time leaves more than that, the fall over all runs must be PART of what is left there: they repeat a motion that no
    term explains, and less may be a piece of it.

    An estimated sd may be too large itself and hold a part of what is missing. There what counts, too, is the ratio of
    the two errors, whatever the sd: it must be significant, and the shorter answer must leave a misfit of half the
    noise sd that the longer one shows. Less is a flaw of a shape (a friction that is not quite dry), which many rows
    show.
    """
    case, sigma, node = analysis.case, analysis.noise.sigma, analysis.noise.node
    after, before = error(longer, case.test, sigma), error(shorter, case.test, sigma)
    if after is None or before is None:
        return True
    if after >= before:
        return False
    train = error(shorter, case.train, sigma)
    assert train is not None, "a case has training rows"
    held = len(sigma) * int(case.test.sum())
    at_floor = train**2 <= allowed(len(sigma) * int(case.train.sum()), node) and before**2 <= allowed(held, node)
    enough = -np.log(analysis.level) / _independent(held, node)
    if not at_floor and case.base.whole_runs and case.dynamics is None:
        now = error(longer, case.train, sigma)
        assert now is not None
        counts = np.array([case.train.sum(), case.test.sum()])
        falls, above = [train**2 - now**2, before**2 - after**2], [train**2 - 1.0, before**2 - 1.0]
        return bool(counts @ falls >= PART * (counts @ above))
    if not at_floor or 0.5 * (before**2 - max(after**2, 1.0)) > enough:
        return True
    ratio = before / max(after, 1e-300)
    return bool(not analysis.noise.known.all() and ratio > FLOOR and np.log(ratio) > enough)
