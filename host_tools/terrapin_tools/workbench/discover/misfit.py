"""On which column the missing part depends, what of the misfit a named set takes, and what it leaves where.

The column is read off the likeliest answers, not off the residual: an answer's own contribution is free of noise. The
column without which most of it is gone is the one that matters. A factor that hardly varies changes nothing when it is
held at its median, so `k*log(humidity)*sign(current)` depends on the current. A direction counts less than a size, so
`k*humidity*sign(omega)` depends on a humidity that does vary. An effect that reads no column (a constant torque, a
gain) depends on what the model's own parameters leave of it. The likeliest answers count by their probability.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.compare.adequacy import Failure, failure_on
from terrapin_tools.workbench.compare.comparison import Analysis, error, measured, predict
from terrapin_tools.workbench.discover.curves_over_time import curved
from terrapin_tools.workbench.discover.leftover import absent
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.table_faults import Fault

__all__ = ["Part", "Step", "explained", "front", "importance", "part_of"]

Array = npt.NDArray[np.float64]

ANSWERS = 8  # likeliest ones that are looked at; chosen by hand
BINS = 8  # of equal count; chosen by hand
DIRECTION = 0.1  # weight of a column's sign beside its size; chosen by hand


def importance(analysis: Analysis, ranking: Ranking) -> dict[str, float]:
    """Share of what is missing that depends on each column, 0 to 1; empty for dynamic models.

    Columns as `numeric_columns` names them. The shares of two columns add up to more than 1 where it takes both.
    """
    if analysis.case.base.whole_runs:
        return {}
    answers = [
        (h, p)
        for h, p in zip(ranking.hypotheses, ranking.posterior, strict=True)
        if h.fit is not None and h.effects and h.kind != "part"
    ][:ANSWERS]
    total = sum(p for _, p in answers)
    if total <= 0.0:
        return {}  # each is ruled out
    found: dict[str, float] = {}
    for answer, probability in answers:
        for name, share in _shares(analysis, answer).items():
            found[name] = found.get(name, 0.0) + float(share * probability / total)
    return found


def _shares(analysis: Analysis, answer: Hypothesis) -> dict[str, float]:
    fit = answer.fit
    assert fit is not None
    wrong = [effect.column for effect in fit.model.effects if isinstance(effect, Fault)]
    if wrong:
        return {name: 1.0 for name in wrong if name in numeric_columns(analysis.case)}
    case, rows, sigma = analysis.case, analysis.rows, analysis.noise.sigma
    own = {effect.name: effect for effect in fit.model.effects if effect.name in answer.effects}
    sizes = {f"{name}.{effect.parameters[0].name}" for name, effect in own.items()}
    without = np.array([0.0 if f.key in sizes else value for f, value in zip(fit.model.fitted, fit.theta, strict=True)])

    def contribution(inputs: Mapping[str, Array]) -> Array:
        bound = fit.model.bind(inputs, rows)
        return ((bound.predict(fit.theta) - bound.predict(without)) / sigma[:, None]).reshape(-1)

    slopes = analysis.fit.model.bind(case.inputs, rows).jacobian(analysis.fit.theta)[1] / sigma[:, None, None]
    basis = np.linalg.qr(slopes.reshape(len(sigma) * int(rows.sum()), -1))[0]

    def visible(change: Array) -> Array:
        return np.asarray(change - basis @ (basis.T @ change))

    full = visible(contribution(case.inputs))
    power = float(full @ full)
    if not np.isfinite(power) or power <= 0.0:
        return {}
    columns = numeric_columns(case)
    read = set().union(*(fit.model.expressions[name].names for name in own))
    named = {name: formula_name(name) if name in case.roles else name for name in columns}
    reads = [name for name in columns if named[name] in read]
    if not reads:
        loudest = full.reshape(len(sigma), -1)[int(np.argmax((full.reshape(len(sigma), -1) ** 2).sum(axis=1)))]
        return {name: explained(loudest, values[rows]) for name, values in columns.items()}
    shares = {}
    for name in reads:
        key, values = named[name], case.inputs[named[name]]
        middle, size = np.median(values[rows]), np.median(np.abs(values[rows]))
        shares[name] = 0.0
        for held, weight in ((np.full_like(values, middle), DIRECTION), (np.sign(values) * size, 1.0 - DIRECTION)):
            with np.errstate(all="ignore"):
                lost = full - visible(contribution({**case.inputs, key: held}))
            share = float(lost @ lost) / power
            shares[name] += weight * (min(1.0, share) if np.isfinite(share) else 1.0)
    return shares


def explained(change: Array, values: Array) -> float:
    """Share of the variance of `change` (rows,) between bins of `values` (rows,), less what chance alone gives."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)[1:-1]))
    bins = np.searchsorted(edges, values, side="right")
    count = np.bincount(bins, minlength=len(edges) + 1)
    sums = np.bincount(bins, weights=change, minlength=len(edges) + 1)
    used = count > 0
    whole = float(((change - change.mean()) ** 2).sum())
    if whole <= 0.0 or used.sum() < 2:
        return 0.0
    within = whole - float((sums[used] ** 2 / count[used]).sum() - change.sum() ** 2 / len(change))
    free = max(1, len(change) - int(used.sum()))
    return max(0.0, 1.0 - within / free * (len(change) - 1) / whole)


@dataclass(frozen=True)
class Part:
    """What is named takes the share `takes` of the misfit, and leaves `left` (rms over all rows, noise sd), most of it
    `at` a range of a column; both with the curve that is left, where it is in the fit."""

    takes: float
    left: float
    at: Failure
    together: bool


@dataclass(frozen=True)
class Step:
    """The likeliest set of so many terms: its probability to be all that is missing, and its errors in noise sd."""

    effects: tuple[str, ...]
    probability: float
    train_error: float
    heldout_error: float | None


def part_of(analysis: Analysis, fit: Fit, column: str, sigma: Array) -> Part:
    """What a fit with the named set takes and leaves; `sigma` of the noise as it is told."""
    before, after = ((_left(analysis, one) / sigma[:, None]) ** 2 for one in (analysis.fit, fit))
    above = float(before.mean()) - 1.0
    takes = (float(before.mean()) - float(after.mean())) / above if above > 0.0 else 0.0
    channel = int(np.argmax(after.mean(axis=1)))
    scaled = _left(analysis, fit) / sigma[:, None]
    columns = {name: values[analysis.rows] for name, values in numeric_columns(analysis.case).items()}
    # a state of own equations is no column
    most = column if column in columns else max(columns, key=lambda name: explained(scaled[channel], columns[name]))
    at = failure_on(analysis.case, most, columns[most], scaled, channel, analysis.rows, analysis.model.channels, 0.0)
    return Part(float(np.clip(takes, 0.0, 1.0)), float(np.sqrt(after.mean())), at, curved(fit))


def _left(analysis: Analysis, fit: Fit) -> Array:
    return measured(fit.model, analysis.rows) - predict(fit, analysis.rows)


def front(
    analysis: Analysis,
    ranking: Ranking,
    sigma: Array,
    called: Mapping[tuple[str, ...], Hypothesis],
    said: Mapping[tuple[str, ...], float],
) -> tuple[Step, ...]:
    """No term, one, two ...: the likeliest set of each number, as long as more terms predict the held-out runs better,
    or the training runs where none is held out.

    Parameters
    ----------
    called : of a set that one of as many terms, by whose name it is told.
    said : probability of a set to be all that is missing, as it is told elsewhere.
    """
    case, found = analysis.case, list[Step]()
    nothing = ranking.probability("nothing")
    steps: dict[int, tuple[tuple[str, ...], float, Fit]] = {0: ((), nothing, analysis.fit)}
    for likely, p in ranking.pairs():
        one = called.get(likely.effects, likely)
        if one.effects and likely.kind != "part" and one.fit is not None and not absent(one.fit, one.effects):
            steps.setdefault(len(one.effects), (one.effects, p, one.fit))
    for _, (effects, p, fit) in sorted(steps.items()):
        train, held = error(fit, case.train, sigma), error(fit, case.test, sigma)
        assert train is not None
        step = Step(effects, said.get(effects, p), train, held)
        if found and _error(step) >= _error(found[-1]):
            break
        found.append(step)
    return tuple(found)


def _error(step: Step) -> float:
    return step.train_error if step.heldout_error is None else step.heldout_error
