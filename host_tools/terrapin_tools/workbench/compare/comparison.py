"""Compare a case's model with its measurements: fit, noise, adequacy, where it fails, and the ladder of errors.

    analysis = analyse(case, seed=0)
    analysis.fit.theta, analysis.noise.sigma, analysis.adequacy.p_value, analysis.ladder

Discovery builds on the same pieces: `fitted_on` fits any set of effects on any runs with the noise already known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import islice

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.adequacy import Adequacy, Failure, assess, where_it_fails
from terrapin_tools.workbench.compare.input_noise import input_noise, undecided
from terrapin_tools.workbench.compare.thinned import every, step_of, step_of_long
from terrapin_tools.workbench.files.units import LARGEST
from terrapin_tools.workbench.model.constants import suspected
from terrapin_tools.workbench.model.data_columns import (
    Direction,
    Shapes,
    catalogue_directions,
    column_shapes,
    numeric_columns,
)
from terrapin_tools.workbench.model.effect_columns import Shape, acting, shapes_of_each, terms_of, varying_parameters
from terrapin_tools.workbench.model.fitting import Fit, covariance, extend, fit_model
from terrapin_tools.workbench.model.linearised import following
from terrapin_tools.workbench.model.model import Bound, Model
from terrapin_tools.workbench.model.table_faults import Fault
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.estimate import Noise, estimate_noise, least_noise
from terrapin_tools.workbench.noise.mishaps import Mishap, in_most_runs, mishaps, within_runs
from terrapin_tools.workbench.noise.odd import ODD_SHARE, farthest, gathered, odd_limit
from terrapin_tools.workbench.noise.stated import followed
from terrapin_tools.workbench.noise.stuck import clipped_rows, stuck_rows

__all__ = [
    "LEVEL",
    "Analysis",
    "Rung",
    "analyse",
    "covered",
    "error",
    "fitted_on",
    "free_slopes",
    "measured",
    "noise_around",
    "predict",
    "require_numbers",
    "sds",
]

LEVEL = 0.05  # false alarm rate of "something is missing", the usual one; --level changes it
# Starts of a base model with bounded parameters: the case's own, the others inside the bounds. Chosen by hand.
STARTS = 3
MORE_STARTS = 20  # that are drawn where none of these gives numbers, at most; chosen by hand
CLEARLY = 50.0  # times below the level, to raise an alarm on rows closer than a correlation length; chosen by hand
GROUND = "rolling_resistance"  # what a slope adds to, where a base has it
ROUNDS = 3  # looks for rows that stand alone: without the farthest, others may show


@dataclass(frozen=True)
class Rung:
    """One step of the ladder: the model with effects up to and including `added`; errors in noise sd."""

    added: str | None
    train_error: float
    heldout_error: float | None
    fit: Fit


@dataclass(frozen=True)
class Analysis:
    """The answer of compare. Arrays over all rows that are trained on or held out (`rows`), in the case's order."""

    case: Case  # without the rows that stand alone
    model: Model
    level: float
    noise: Noise
    # that is told: a stated sd as it was found, but of a model that lacks something, whose misfit would pass for noise
    told: Noise
    fit: Fit  # on the training runs
    sd: Array  # of the fitted parameters
    adequacy: Adequacy
    where: list[Failure]
    ladder: list[Rung]
    rows: Mask
    prediction: Array  # (channels, rows)
    residual: Array  # measured - predicted (channels, rows)
    shapes: Mapping[str, Sequence[Shape]] = field(repr=False)  # of every effect that could be added
    odd: Mask = field(repr=False)  # (all rows,), that stand alone and are left out
    # (channels, rows, count), in noise sd: what noise in the inputs does to the prediction (input_noise.py)
    nuisance: Array = field(repr=False)
    held: Mask = field(repr=False)  # (all rows,), every row of the held-out runs, looked at or not
    mishaps: Sequence[Mishap] = field(repr=False)  # that may have happened on the rig
    felt: Array | None = field(repr=False)  # see `Runs`
    step: int = 1  # every how many rows of a run are looked at (thinned.py)
    # (all rows,), at which a sensor sticks, left out too
    stuck: Mask = field(repr=False, default_factory=lambda: np.zeros(0, dtype=bool))
    together: bool = False  # the search found what no single effect, column or run of the test shows

    @property
    def missing(self) -> bool:
        return self.together or self.adequacy.p_value < self.level


def measured(model: Model, rows: Mask) -> Array:
    """What was measured of the model's channels (channels, rows)."""
    return np.stack([model.case.channels[c][rows] for c in model.channels])


def predict(fit: Fit, rows: Mask) -> Array:
    """Prediction (channels, rows) of a fitted model on any rows of its case."""
    return fit.model.bind(fit.model.case.inputs, rows).predict(fit.theta)


def error(fit: Fit, rows: Mask, sigma: Array) -> float | None:
    """Rms of measured minus predicted over all channels and the given rows, in noise sd; None without rows.

    `rows` (all rows,) is a mask; `sigma` (channels,) the noise sd in the channels' units.
    """
    if not rows.any():
        return None
    scaled = (measured(fit.model, rows) - predict(fit, rows)) / sigma[:, None]
    return float(np.sqrt(np.mean(scaled * scaled)))


def _base_starts(bound: Bound, seed: int) -> list[Array]:
    """The case's start values, and points inside the bounds (logarithmic where both bounds are positive). Of what is
    integrated over time one more where none of them gives numbers: at some values no wheel is carried. Of all else each
    power of ten from 0.001 to 1000 in the place of zeros, where those give none: a formula may divide by them."""
    model = bound.model
    starts = [model.start]
    if not model.case.base.whole_runs and not _gives_numbers(bound, model.start):
        zero = model.start == 0.0
        others = (np.clip(np.where(zero, 10.0**n, model.start), model.lower, model.upper) for n in range(-3, 4))
        return [one for one in others if _gives_numbers(bound, one)] or starts
    bounded = np.isfinite(model.lower) & np.isfinite(model.upper)
    if model.case.base.convex or not bounded.all() or not bounded.size:
        return starts
    random = np.random.default_rng([seed, 0x57A7])
    positive = (model.lower > 0) & (model.upper > 10.0 * model.lower)
    low, high = np.where(positive, model.lower, 1.0), np.where(positive, model.upper, 1.0)

    def drawn() -> Array:
        share = random.uniform(0.1, 0.9, len(model.start))
        geometric = low * (high / low) ** share
        return np.where(positive, geometric, model.lower + share * (model.upper - model.lower))

    starts += [drawn() for _ in range(STARTS - 1)]
    if model.case.base.whole_runs and not any(_gives_numbers(bound, one) for one in starts):
        further = (drawn() for _ in range(MORE_STARTS))
        starts += islice((one for one in further if _gives_numbers(bound, one)), 1)
    return starts


def _gives_numbers(bound: Bound, theta: Array) -> bool:
    with np.errstate(all="ignore"):
        return bool(np.isfinite(bound.predict(theta)).all())


def fitted_on(
    case: Case,
    effects: Sequence[str],
    rows: Mask,
    sigma: Array,
    seed: int = 0,
    wrong: Sequence[Fault] = (),
    near: Sequence[Fit] = (),
) -> list[Fit]:
    """Fits of the base model and of each larger one, effects added in the given order, each started at its parent.

    Parameters
    ----------
    effects : names of effects of the case's library.
    rows : (all rows,), mask of the rows to fit.
    sigma : (channels,), noise sd in the channels' units.
    seed : of the start values inside the bounds.
    wrong : faults of the table that all fits have.
    near : the same fits, made with another sigma: the first starts there alone.

    Returns
    -------
    One fit more than effects; the first has none.
    """
    model = reduce(Model.having, wrong, Model.of(case, ()))
    values = measured(model, rows)
    bound = model.bind(case.inputs, rows)
    fits = [fit_model(bound, values, sigma, [near[0].theta] if near else _base_starts(bound, seed))]
    for name in effects:
        model = model.having(case.library[name])
        fits.append(extend(fits[-1], name, model.bind(case.inputs, rows), values, sigma))
    return fits


def free_slopes(fit: Fit, sigma: Array, rows: Mask, released: bool = False) -> tuple[Array, Array, Array]:
    """Prediction, residual and derivatives of a fit on the given rows.

    A parameter that ended at its bound cannot absorb what the residual asks of it, so its derivative is left out, but
    `released` of those that may follow what is added.

    Returns
    -------
    (channels, rows) : prediction, in the channels' units.
    (channels, rows) : measured minus predicted.
    (channels, rows, free parameters) : derivatives of the prediction.
    """
    prediction, slopes = fit.model.bind(fit.model.case.inputs, rows).jacobian(fit.theta)
    free = following(fit) if released else [f.key not in fit.at_bound for f in fit.model.fitted]
    return prediction, measured(fit.model, rows) - prediction, slopes[..., free]


def covered(fit: Fit, case: Case, sigma: Array, noise: Noise) -> tuple[Array, Array]:
    """`covariance` of a fit that was made with the sds `sigma`, in this noise."""
    # an estimated sd holds what runs have in common, which the kind of noise says once more
    floor = np.array([1.0 if known else noise.node.of(c).floor for c, known in enumerate(noise.known)])
    return covariance(fit, case.run[case.train], noise.node, noise.sigma / sigma / floor)


def sds(fit: Fit, case: Case, sigma: Array, noise: Noise) -> Array:
    """Sd (parameters,) of a fit that was made with the sds `sigma`, in this noise."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covered(fit, case, sigma, noise)[0]), 0.0)))


def analyse(case: Case, seed: int = 0, level: float = LEVEL) -> Analysis:
    """The answer of compare: the case's model fitted on its training runs, and whether and where it fails.

    Parameters
    ----------
    seed : of everything that is drawn; the same seed gives the same answer.
    level : false alarm rate of "something is missing".

    Raises
    ------
    UserError : the model gives no number for a row; file and row are named. Or no more values are trained on than
        parameters are fitted: such a model fits whatever was measured.
    """
    _enough(case)
    stuck = _stuck(case)
    moving = replace(case, train=case.train & ~stuck, test=case.test & ~stuck)
    return replace(_at_steps(moving, seed, level), stuck=stuck)


def _enough(case: Case) -> None:
    model = Model.of(case)
    values = int(case.train.sum()) * len(model.channels)
    if 0 < len(model.fitted) >= values:
        raise UserError(
            f"{case.folder / 'case.toml'}: data: found {values} value{'s' * (values > 1)} to train on for "
            f"{len(model.fitted)} fitted parameters, expected more values than parameters"
        )


def _at_steps(case: Case, seed: int, level: float) -> Analysis:
    """The answer, on as many rows as are worth looking at."""
    long, held = step_of_long(case), case.test
    case = every(case, long) if long > 1 else case
    fitted = _fitted(case, seed)
    step = long * step_of(case, fitted[1].node)
    if step == long:
        return _analysed(case, seed, level, long, fitted, held)
    thin = every(case, step)
    found = _analysed(thin, seed, level, step, _fitted(thin, seed), held)
    if found.missing:
        return found
    # what is seen only between the rows that were taken (a wave in time) has to be seen clearly: there the model of the
    # noise is an approximation
    whole = _analysed(case, seed, level, long, fitted, held)
    return whole if whole.adequacy.p_value < level / CLEARLY else found


def _stuck(case: Case) -> Mask:
    """Rows (all rows,) at which a channel's sensor sticks or clips; none where too little would be left to train on."""
    looked = [case.channels[name] for name in case.base.channels if name in case.channels]
    found = np.any([stuck_rows(values, case.run) | clipped_rows(values) for values in looked], axis=0)
    return found if (case.train & ~found).sum() > 0.5 * case.train.sum() else np.zeros_like(found)


def _analysed(case: Case, seed: int, level: float, step: int, fitted: _Fitted, held: Mask) -> Analysis:
    """The answer for the rows of a case as it is, fitted as `_fitted` says."""
    case, odd, (fits, noise, nuisance, known) = _without_odd(case, seed, fitted)
    rows, sigma, model = case.train | case.test, noise.sigma, fits[-1].model
    prediction, residual, slopes = free_slopes(fits[-1], sigma, rows)
    directions = _directions(model, fits[-1].theta, rows, sigma) if known is None else known
    shapes = column_shapes(case, rows)
    effects = shapes_of_each(model, fits[-1].theta, suspected(model), rows, sigma)
    widened = np.concatenate([slopes, nuisance], axis=-1)
    may_vary = slopes
    if case.base.gains():  # the formulas as a whole
        may_vary = np.concatenate([slopes, np.eye(len(sigma))[:, None, :] * prediction[..., None]], axis=-1)
    varying = varying_parameters(case, may_vary / sigma[:, None, None], rows)
    alternatives = {**effects, **terms_of(model, fits[-1].theta, rows, sigma)}
    wrong = [
        one
        for one in _mishaps(model, fits[-1].theta, prediction, rows, sigma)
        if one.kind != "lag" or _lags(case.run[rows], residual / sigma[:, None], slopes / sigma[:, None, None], one)
    ]
    felt = _felt(model, fits[-1].theta, prediction, rows, sigma)
    adequacy = assess(
        case, residual, widened, prediction, noise, directions, alternatives, shapes, rows, seed, varying, wrong, felt
    )
    missing = adequacy.p_value < level
    scaled = residual / sigma[:, None]
    where = where_it_fails(case, adequacy, scaled, rows, numeric_columns(case), model.channels) if missing else []
    told = noise if missing else noise_around(case, fits[-1], noise)
    return Analysis(
        case=case,
        model=model,
        level=level,
        noise=noise,
        told=told,
        fit=fits[-1],
        sd=_sd(fits[-1], case, noise, told, missing),
        adequacy=adequacy,
        where=where,
        ladder=_ladder(case, fits, sigma),
        rows=rows,
        prediction=prediction,
        residual=residual,
        shapes=effects,
        odd=odd,
        nuisance=nuisance / sigma[:, None, None],
        held=held,
        mishaps=wrong,
        felt=felt,
        step=step,
    )


def _sd(fit: Fit, case: Case, noise: Noise, told: Noise, missing: bool) -> Array:
    """Of the parameters. Where something is missing the misfit outweighs the noise, and only its scatter over runs says
    how uncertain they are."""
    sd = sds(fit, case, noise.sigma, told)
    if missing:
        robust = covariance(fit, case.run[case.train], noise.node)[1]
        sd = np.maximum(sd, np.sqrt(np.maximum(np.diag(robust), 0.0)))
    return sd


def _without_odd(case: Case, seed: int, fitted: _Fitted) -> tuple[Case, Mask, _Fitted]:
    """A case without the rows that stand alone, which those are, and its fits; as it is where they lie together."""
    odd, now, found = np.zeros(case.rows, dtype=bool), case, fitted
    columns, looked_at = numeric_columns(case), case.train | case.test
    for _ in range(ROUNDS):
        fits, noise, _, _ = found
        if not noise.odd.any() or odd.sum() + noise.odd.sum() > odd_limit(len(odd)):
            break
        odd[np.flatnonzero(now.train | now.test)[noise.odd]] = True
        apart = farthest(free_slopes(fits[-1], noise.sigma, looked_at)[1], looked_at)
        if gathered(odd, apart, case.run, columns, looked_at):
            return case, np.zeros_like(odd), fitted
        now = replace(now, train=now.train & ~odd, test=now.test & ~odd)
        found = _fitted(now, seed)
    return now, odd, found


def _ladder(case: Case, fits: Sequence[Fit], sigma: Array) -> list[Rung]:
    """The base, and each effect that was added, with their errors."""
    ladder = []
    for name, fit in zip((None, *case.effects), fits, strict=True):
        train_error = error(fit, case.train, sigma)
        assert train_error is not None, "a case has training rows"
        ladder.append(Rung(name, train_error, error(fit, case.test, sigma), fit))
    return ladder


def _felt(model: Model, theta: Array, prediction: Array, rows: Mask, sigma: Array) -> Array | None:
    """What is left of what runs may have of their own (channels, rows, OWN): starts that are fitted follow it. None for
    models without such starts."""
    if model.case.dynamics is None:
        return None
    shifts = Runs(model.case.run[rows], len(sigma), prediction).shifts
    found = np.empty_like(shifts)
    for number, channel in enumerate(model.channels):
        act = acting(model, theta, channel, rows, sigma)
        for column, shift in enumerate(shifts[number].T):
            found[number, :, column] = act(sigma[number] * shift[None])[0, number]
    return found


def _mishaps(model: Model, theta: Array, prediction: Array, rows: Mask, sigma: Array) -> list[Mishap]:
    """What may have gone wrong on the rig, as the channels would show it."""
    acts = [acting(model, theta, channel, rows, sigma) for channel in model.channels]
    runs = Runs(model.case.run[rows], len(sigma), prediction)

    def act(channel: int, change: Array) -> Array:
        return np.asarray(acts[channel](sigma[channel] * change[None])[0])

    slopes = None
    if GROUND in model.case.base.forces and "slope" not in model.case.roles:
        rolls = acting(model, theta, GROUND, rows, sigma)
        slopes = rolls(np.asarray(1.0 * (np.unique(runs.run)[:, None] == runs.run)))
    return mishaps(runs, act, model.case.base.whole_runs, slopes)


def _lags(run: Index, residual: Array, slopes: Array, lag: Mishap) -> bool:
    """Whether a lag, fitted beside the parameters, takes something off in most runs: all in noise sd."""
    late = lag.columns.reshape(*residual.shape, -1)
    taken = [within_runs(run, np.moveaxis(one, -1, 0)).reshape(-1, residual.size) for one in (slopes, late)]
    gap = within_runs(run, residual).ravel()

    def left(columns: Array) -> Array:
        return np.asarray(gap - np.linalg.lstsq(columns.T, gap, rcond=None)[0] @ columns).reshape(residual.shape)

    return in_most_runs(run, left(taken[0]), left(np.concatenate(taken)))


# Fits of the ladder, the noise, the columns of noisy inputs (channels, rows, count) in the channels' units, and the
# directions around the last fit where they are known.
_Fitted = tuple[list[Fit], Noise, Array, list[Direction] | None]


def _fitted(case: Case, seed: int) -> _Fitted:
    """The case's model fitted, and the noise around it."""
    rows = case.train | case.test
    model = Model.of(case)
    bound = model.bind(case.inputs, rows)
    if not any(_gives_numbers(bound, start) for start in _base_starts(bound, seed)):
        with np.errstate(all="ignore"):
            first = bound.predict(model.start)
        require_numbers(case, model, first, model.start, rows, "at the start values")
    given = [case.sigma[c] for c in model.channels]
    stated = all(g is not None for g in given)
    values = measured(model, case.train)
    least = least_noise(measured(model, rows))
    rough = np.maximum(0.05 * np.sqrt(np.mean(values * values, axis=1)), least)
    sigma = np.array([r if g is None else g for r, g in zip(rough, given, strict=True)])
    fits: list[Fit] = []
    for _ in range(1 if stated else 2):
        fits = fitted_on(case, case.effects, case.train, sigma, seed, near=fits if case.base.whole_runs else ())
        noise, nuisance, directions = _noise_of(case, fits[-1], sigma, given, least)
        sigma = noise.sigma
    if stated:
        return fits, noise, nuisance, None if case.base.own_dynamics else directions
    fits = fitted_on(case, case.effects, case.train, sigma, seed, near=fits if case.base.whole_runs else ())
    return fits, noise, nuisance, None


def _noise_of(
    case: Case, fit: Fit, sigma: Array, given: Sequence[float | None], least: Array
) -> tuple[Noise, Array, list[Direction]]:
    """The noise around a fit that was made with the sds `sigma`, the columns of noisy inputs, and the directions."""
    rows = case.train | case.test
    prediction, residual, slopes = free_slopes(fit, sigma, rows)
    require_numbers(case, fit.model, prediction, fit.theta, rows, "after the fit")
    # a dynamic model's motion depends on what went before: equal inputs are no repeated settings
    roles = {} if case.base.whole_runs else {name: v[rows] for name, v in case.roles.items()}
    directions = _directions(fit.model, fit.theta, rows, sigma)
    pools = _pools(fit.model, directions, column_shapes(case, rows), rows)
    felt = _felt(fit.model, fit.theta, prediction, rows, sigma)
    noise = estimate_noise(residual, slopes, prediction, case.run[rows], given, roles, pools, least, felt)
    nuisance = input_noise(fit, rows, residual, slopes, noise.sigma, noise.node, ~noise.known)
    if nuisance.shape[-1]:
        widened = np.concatenate([slopes, nuisance], axis=-1)
        noise = estimate_noise(residual, widened, prediction, case.run[rows], given, roles, pools, least, felt)
        noise = replace(noise, odd=noise.odd | undecided(nuisance, noise.sigma, ODD_SHARE))
    return noise, nuisance, directions


def noise_around(case: Case, fit: Fit, known: Noise, again: bool = False) -> Noise:
    """The noise around a fit that was made with that noise `known`, as it is told: stated sds that surely are off are
    found. With `again` all is estimated again: around an answer, what is missing no longer passes for noise."""
    given = [case.sigma[c] for c in fit.model.channels]
    least = least_noise(measured(fit.model, case.train | case.test))

    def estimated(given: Sequence[float | None]) -> Noise:
        return _noise_of(case, fit, known.sigma, given, least)[0]

    found = followed(estimated(given) if again else known, given, estimated)
    return replace(found, carried=_one_run(case, fit)) if found.wrong.any() else found


def _one_run(case: Case, fit: Fit) -> Index:
    """(channels,): the run that makes up more than half of all that a fit leaves in squares; -1: none does."""
    rows = case.train | case.test
    runs, place = np.unique(case.run[rows], return_inverse=True)
    left = np.array([np.bincount(place, one) for one in (measured(fit.model, rows) - predict(fit, rows)) ** 2])
    alone = (left.max(axis=1) > 0.5 * left.sum(axis=1)) & (len(runs) > 2)
    return np.asarray(np.where(alone, runs[left.argmax(axis=1)], -1))


def require_numbers(case: Case, model: Model, prediction: Array, theta: Array, rows: Mask, when: str) -> None:
    """UserError that names the first row at which the model gives no number (log of a negative one, 1/0, overflow)."""
    trouble = "" if np.isfinite(prediction).all() else model.bind(case.inputs, rows).trouble(theta)
    if trouble:
        raise UserError(f"{case.folder / 'case.toml'}: {trouble} ({when})")
    bad = np.argwhere(~(np.abs(prediction.T) <= LARGEST))
    if bad.size:
        row, channel = (int(index) for index in bad[0])
        place, value = case.place(int(np.flatnonzero(rows)[row])), prediction[channel, row]
        raise UserError(f"{place}: the model gives {value:g} for {model.channels[channel]} {when}, expected a number")


def _directions(model: Model, theta: Array, rows: Mask, sigma: Array) -> list[Direction]:
    """Of the catalogue, and of terms in equations of the user's own."""
    terms = (one for shapes in terms_of(model, theta, rows, sigma).values() for one in shapes)
    own = [Direction(one.effect, one.columns.reshape(len(sigma), -1) * sigma[:, None]) for one in terms]
    return [*catalogue_directions(model, theta, rows), *own]


def _pools(model: Model, directions: Sequence[Direction], shapes: dict[str, Shapes], rows: Mask) -> list[Array]:
    """Shapes for the smoothest model a channel: those of the columns and those of the catalogue."""
    pools = []
    columns = [one for shape in shapes.values() for one in (*shape.together, *shape.singly)]
    for channel in range(len(model.channels)):
        effects = [d.change[channel] for d in directions if np.any(d.change[channel])]
        pools.append(np.array([*columns, *effects]) if columns or effects else np.zeros((0, int(rows.sum()))))
    return pools
