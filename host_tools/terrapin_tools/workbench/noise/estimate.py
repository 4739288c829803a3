"""What the noise of a case is like: its sd, its kind (covariance.py), and rows that stand alone.

The standard deviation is the one that the case gives, else that of repeated settings, else what the smoothest model
that the data support leaves. That model is the fitted one with those shapes in the data's columns that earn their
place. The kind of noise always comes from that smoothest model, by restricted maximum likelihood over the nodes. A row
stands alone when it lies far off what the other rows of its run say about it: a glitch does, an effect is shared by
neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import betainc

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.workbench.bases import RUNNING
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.kinds import NODES, PLAIN, Node
from terrapin_tools.workbench.noise.marginal_likelihood import STATED
from terrapin_tools.workbench.noise.odd import standing_alone
from terrapin_tools.workbench.noise.restricted import likelihood, restricted_likelihood

__all__ = [
    "Noise",
    "estimate_noise",
    "least_noise",
    "repeated_settings",
    "within_scatter",
]

SHAPES_LIMIT = 12  # shapes that the smoothest model may take up; chosen by hand
ENTRY = (
    20.0  # squared score, in noise variances, at which a shape enters: 1e-5 a shape by chance, over hundreds of them
)
# Kinds of noise at which a shape is tried beside the present one: white, and two correlations. Chosen by hand.
TRIED = tuple(i for i in PLAIN if NODES[i].filter in ((0.0, 0.0, 0.0), (1.0, 0.6, 0.0), (1.0, 0.92, 0.0)))
FEW_REPEATS = 30  # degrees of freedom below which the repeats alone give too rough an sd; chosen by hand (13 % of sd)
REPEATS_NEEDED = 4  # degrees of freedom that repeated settings must give; chosen by hand
# Share of a channel's spread below which no noise was measured. Chosen by hand, after cases of computed numbers, whose
# sd of rounding (1e-151 in one) made every formula wrong.
EXACT = 1e-6
FAINT = 1e-9  # posterior below which noise of unlike channels is no more weighed: there are many kinds of it; by hand


@dataclass(frozen=True)
class Noise:
    """Noise of each channel: its sd in the channel's unit, where that comes from, and of what kind it is."""

    sigma: Array  # (channels,), of repeated measurements; where it is not stated, with offsets from run to run
    known: Mask  # (channels,): given in the case
    node: Node
    source: str  # one sentence for people
    freedom: Array  # degrees of freedom behind each sigma; inf when given
    groups: Index | None  # (rows,) repeated settings that gave sigma, None when they did not
    odd: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (rows,) that stand alone
    ratio: Array = field(default_factory=lambda: np.ones(0))  # (channels,): what the smoothest model leaves over sigma
    ratio_freedom: float = np.inf
    weights: Array = field(default_factory=lambda: np.ones(1))  # (nodes,): posterior of each kind of noise
    # (channels,): probability that the stated sd is off, where it was found again for that (stated.py)
    wrong: Array = field(default_factory=lambda: np.zeros(0))
    # (channels,): where that is so, the run (its number) that makes up more than half of what is left; -1: none does
    carried: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def kinds(self) -> list[int]:
        """Kinds of noise that are weighed, places in NODES: those that runs can show, of unlike channels those that are
        not FAINT."""
        return [i for i, weight in enumerate(self.weights) if weight > (0.0 if NODES[i].rest is None else FAINT)]

    @property
    def behind(self) -> float:
        """Degrees of freedom that evidence counts behind the sd."""
        return STATED if self.known.all() else 0.0


def repeated_settings(roles: Mapping[str, Array], rows: int) -> Index:
    """A number for each row; rows with the same number are repeated settings.

    All mapped roles except time, angle and acceleration agree within 1 % of their range.
    """
    settings = [values for name, values in roles.items() if name not in RUNNING]
    if not settings:
        return np.arange(rows)
    stacked = np.column_stack(settings)
    span = np.ptp(stacked, axis=0)
    tolerance = np.where(span > 0, 0.01 * span, np.inf)
    group = np.full(rows, -1, dtype=np.int64)
    order = np.argsort(stacked[:, 0], kind="stable")
    sorted_first = stacked[order, 0]
    count = 0
    for row in range(rows):
        if group[row] >= 0:
            continue
        low, high = np.searchsorted(sorted_first, [stacked[row, 0] - tolerance[0], stacked[row, 0] + tolerance[0]])
        near = order[low : high + 1]
        near = near[group[near] < 0]
        agree = near[(np.abs(stacked[near] - stacked[row]) <= tolerance).all(axis=1)]
        group[agree] = count
        group[row] = count
        count += 1
    return group


def estimate_noise(
    residual: Array,
    jacobian: Array,
    prediction: Array,
    run: Index,
    given: Sequence[float | None],
    roles: Mapping[str, Array],
    shapes: Sequence[Array],
    least: Array,
    felt: Array | None = None,
) -> Noise:
    """Noise of the residuals of a fitted model: sd of each channel, correlation, and where the sd comes from.

    Parameters
    ----------
    residual : (channels, rows), measured minus predicted, in the channels' units.
    jacobian : (channels, rows, parameters), derivatives of the prediction, in the same units.
    prediction : (channels, rows), in the same units: runs may differ by a factor on it.
    run : (rows,), the run of each row.
    given : for each channel the sd that the case states, in the channel's unit, or None.
    roles : mapped roles (rows,), among which repeated settings are looked for; empty: there are none.
    shapes : for each channel (count, rows), functions of the data's columns, candidates for the smoothest model.
    least : (channels,), see `least_noise`; a smaller sd is that of rounding, and this one is taken as if it were given.
    felt : see `Runs`.
    """
    runs = [
        Runs(run, level=one[None], felt=None if felt is None else felt[c][None]) for c, one in enumerate(prediction)
    ]
    noise = _estimate(residual, jacobian, runs, given, roles, shapes)
    floor = np.array([noise.node.of(channel).floor for channel in range(len(runs))])
    noise = replace(noise, sigma=noise.sigma * np.where(noise.known, 1.0, floor))
    exact = ~noise.known & (noise.sigma < least)
    if not exact.any():
        return noise
    stated = [float(low) if bare else g for low, bare, g in zip(least, exact, given, strict=True)]
    source = f"measurements without noise: an sd of {EXACT:g} of their spread is assumed"
    return replace(_estimate(residual, jacobian, runs, stated, roles, shapes), source=source)


def least_noise(values: Array) -> Array:
    """The smallest noise sd (channels,) that is believed of measurements (channels, rows) without a stated one.

    What was computed, not measured, has no noise but its rounding, and errors in units of that mean nothing.
    """
    low, high = np.quantile(values, [0.05, 0.95], axis=1)
    spread = np.where(high > low, high - low, np.ptp(values, axis=1))
    largest = np.abs(values).max(axis=1)
    return np.asarray(EXACT * np.where(spread > 0.0, spread, np.where(largest > 0.0, largest, 1.0)))


def _estimate(
    residual: Array,
    jacobian: Array,
    runs: Sequence[Runs],
    given: Sequence[float | None],
    roles: Mapping[str, Array],
    shapes: Sequence[Array],
) -> Noise:
    channels, rows, _ = jacobian.shape
    bases = [orthonormal(jacobian[c]) for c in range(channels)]
    pools = [np.ascontiguousarray(shape.T) for shape in shapes]
    limit = min(SHAPES_LIMIT, max(0, (rows - bases[0].shape[1]) // 4))
    taken = 0
    white: dict[tuple[int, int], tuple[Array, Array]] = {}
    while True:
        criterion, squares = restricted_likelihood(runs, list(residual), bases, given)
        best = int(np.argmin(criterion))
        free = np.array([rows - basis.shape[1] for basis in bases], dtype=np.float64)
        estimated = np.sqrt(squares[best] / np.maximum(free, 1.0))
        sigma = np.array([e if g is None else g for e, g in zip(estimated, given, strict=True)])
        if taken >= limit:
            break
        gain, channel, index = _strongest(runs, residual, bases, pools, given, squares, best, white)
        if gain < ENTRY:
            break
        bases[channel] = orthonormal(np.column_stack([bases[channel], pools[channel][:, index]]))
        taken += 1
    node = NODES[best]
    known = np.array([g is not None for g in given], dtype=bool)
    odd = standing_alone(runs, list(residual), bases, given)
    found = Noise(sigma, known, node, "noise sd as given", np.where(known, np.inf, free), None, odd)
    weights = np.where(np.isfinite(criterion), np.exp(np.maximum(0.5 * (criterion.min() - criterion), -600.0)), 0.0)
    found = replace(found, ratio=estimated / sigma, ratio_freedom=float(free.min()), weights=weights / weights.sum())
    if known.all():
        return found
    source = f"no repeated settings: noise sd from the smoothest model ({taken} shapes beside the model's own)"
    return _with_repeats(replace(found, source=source), residual, runs, repeated_settings(roles, rows), free)


def _with_repeats(found: Noise, residual: Array, runs: Sequence[Runs], group: Index, free: Array) -> Noise:
    """With the sd of repeated settings, where there are enough: together with that of the smoothest model, which has
    `free` degrees of freedom (channels,), where they are few and agree."""
    sigma, known, node = found.sigma, found.known, found.node
    repeats = len(group) - (int(group.max()) + 1)
    if repeats < REPEATS_NEEDED:
        return found
    repeated = np.array(
        [
            within_scatter(rows, values, group, node.of(c))
            for c, (rows, values) in enumerate(zip(runs, residual, strict=True))
        ]
    )
    freedom = float(repeats)
    agree = [_agree(sigma[c], free[c], repeated[c], freedom) for c in range(len(sigma))]
    if freedom < FEW_REPEATS and all(agree):
        pooled = np.sqrt((free * sigma**2 + freedom * repeated**2) / (free + freedom))
        source = f"noise sd from {repeats} repeats of settings and, agreeing with them, the smoothest model"
        behind = np.where(known, np.inf, free + freedom)
        return replace(found, sigma=np.where(known, sigma, pooled), source=source, freedom=behind)
    source = f"noise sd from repeated settings ({repeats} repeats)"
    behind = np.where(known, np.inf, freedom)
    return replace(found, sigma=np.where(known, sigma, repeated), source=source, freedom=behind, groups=group)


def _alike(node: Node, lag: Index) -> Array:
    """Covariance of rows of one run that are `lag` rows apart, of what is a row's own."""
    own = np.where(lag == 0, 1.0 - node.share, 0.0)
    return np.asarray(own + node.share * node.rho**lag if node.share else own)


def _agree(smooth: float, smooth_freedom: float, repeated: float, freedom: float) -> bool:
    """Whether what the smoothest model leaves is no larger than the repeats' scatter, at 1 % (F test)."""
    ratio = (smooth / repeated) ** 2
    return bool(_f_tail(ratio, smooth_freedom, freedom) > 0.01)


def _f_tail(ratio: float, above: float, below: float) -> float:
    return float(betainc(below / 2.0, above / 2.0, below / (below + above * ratio)))


def _strongest(
    runs: Sequence[Runs],
    residual: Array,
    bases: Sequence[Array],
    pools: Sequence[Array],
    sigma: Sequence[float | None],
    squares: Array,
    best: int,
    white: dict[tuple[int, int], tuple[Array, Array]],
) -> tuple[float, int, int]:
    """Largest gain of -2 log likelihood by one shape more, the kind of noise being free to change; channel and index.

    A misfit that drifts looks like strong correlation, under which its own shape would hardly count: so the shape is
    also tried at weaker ones. `white` keeps pools once whitened, and their squared lengths, for the next call.
    """
    own = np.array(
        [[float(likelihood(q, runs[0].rows, sd)) for q, sd in zip(row, sigma, strict=True)] for row in squares]
    )
    known = np.array(
        [
            sum(one.log_determinant(node.of(c)) for c, one in enumerate(runs)) - 2.0 * np.log(node.prior)
            for node in NODES[: len(squares)]
        ]
    )
    whole = own.sum(axis=1) + known
    present = float(whole.min())
    found = (0.0, 0, 0)
    for trial in sorted({best, *TRIED}):
        for channel, (rows, pool) in enumerate(zip(runs, pools, strict=True)):
            if pool.shape[1] == 0:
                continue
            node = NODES[trial].of(channel)
            if (trial, channel) not in white:
                columns = rows.whiten(pool, node)
                white[trial, channel] = columns, (columns * columns).sum(axis=0)
            (columns, before), left = white[trial, channel], rows.whiten(residual[channel][:, None], node)[:, 0]
            norm = before
            if bases[channel].shape[1]:
                q = np.linalg.qr(rows.whiten(bases[channel], node))[0]
                left = left - q @ (q.T @ left)
                norm = before - ((q.T @ columns) ** 2).sum(axis=0)
            usable = norm > 1e-8 * before
            taken = np.where(usable, (columns.T @ left) ** 2 / np.where(usable, norm, 1.0), 0.0)
            index = int(np.argmax(taken))
            rest = np.asarray(max(float(left @ left) - float(taken[index]), 1e-300))
            new = whole[trial] - own[trial, channel] + float(likelihood(rest, rows.rows, sigma[channel]))
            found = max(found, (present - float(new), channel, index), key=lambda entry: entry[0])
    return found


def within_scatter(runs: Runs, values: Array, group: Index, node: Node) -> float:
    """Noise sd from the scatter of values (rows,) within groups of repeated settings.

    Rows of one run are alike where the noise is correlated, and runs differ by their offsets and gains: the scatter
    within a group is compared with what this kind of noise would give for s = 1.
    """
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    sizes = np.diff(np.append(starts, len(order)))
    sums = np.add.reduceat(values[order], starts)
    scatter = float(values @ values - (sums * sums / sizes).sum())
    share = 0.0
    back = np.argsort(runs.order)
    waves = node.walk * runs.waves[back] if node.walk else np.zeros((runs.rows, 0))
    sd = runs.sd(node.grow)[back]
    for begin, size in zip(starts[sizes > 1], sizes[sizes > 1], strict=True):
        rows = order[begin : begin + size]
        same = runs.run[rows][:, None] == runs.run[rows][None, :]
        lag = np.abs(runs.position[rows][:, None] - runs.position[rows][None, :])
        slow = np.column_stack(
            [np.full(size, node.offset), node.drift * runs.line[rows], node.gain * runs.level[0][rows]]
        )
        alike = same * (np.outer(sd[rows], sd[rows]) * _alike(node, lag) + slow @ slow.T)
        alike = alike + waves[rows] @ waves[rows].T
        share += float(np.trace(alike)) - float(alike.sum()) / size
    return float(np.sqrt(max(scatter, 1e-300) / max(share, 1e-12)))
