"""Is anything missing, and where does the model fail?

The residuals of all runs, freed of everything that the model's own parameters could take up, are scored against three
families of alternatives: what each catalogued effect would add, smooth shapes in every numeric column (mapped or not),
and an offset of any single run; where the noise sd is known also the sum of squares. Each score has a nominal p-value
under AR(1) noise; the families share the level equally, and the smallest counts. Its distribution when nothing is
missing comes from simulation: AR(1) noise of the estimated sd and correlation on the very rows of the case, with sd and
correlation estimated anew from each simulated set. A test that takes rows as independent would raise a false alarm
nearly always at a correlation of 0.9.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from host_tools.workbench.case import Case
from host_tools.workbench.directions import Direction, Shapes
from host_tools.workbench.noise import RHO_GRID, Ar1, Noise, orthonormal, restricted_likelihood, within_scatter

__all__ = ["Adequacy", "Failure", "assess", "where_it_fails"]

Array = npt.NDArray[np.float64]
SETS = 600  # simulated sets of noise
MARGIN = 6.0  # of gain: strong evidence on the scale of the Bayesian information criterion
TINY = 1e-300  # p-values below this are as good as 0, and have no logarithm
TAIL = 0.05  # share of them from which the tail beyond is continued


@dataclass(frozen=True)
class Failure:
    """The residual's dependence on one column, strongest range; sizes in noise sd."""

    variable: str
    low: float
    high: float
    channel: str
    mean_residual: float
    gain: float  # fall of n log(sum of squares), less what as many random columns would give; for ranking only
    with_direction: bool  # the residual was taken in the direction of motion (times sign of omega)


@dataclass(frozen=True)
class Adequacy:
    """p-value of "nothing is missing", and what raised it."""

    p_value: float
    strongest: str  # label of the alternative with the smallest nominal p-value
    gain: Mapping[str, float]  # by alternative: what it would take from n log(sum of squares), penalised for its size


@dataclass(frozen=True)
class _Alternative:
    """A block of columns (channels * rows, count) whose squared scores are summed, in one family."""

    label: str
    family: str
    columns: Array


def _alternatives(
    directions: Sequence[Direction], shapes: Mapping[str, Shapes], run: npt.NDArray[np.int64], sigma: Array
) -> list[_Alternative]:
    channels, rows = len(sigma), len(run)
    found = []
    for direction in directions:
        flat = (direction.change / sigma[:, None]).reshape(-1, 1)
        found.append(_Alternative(f"effect:{direction.effect}", "catalogue", flat))
    for name, shape in shapes.items():
        for channel in range(channels):
            for kind, columns in (("column", shape.together), *(("plain", one[None]) for one in shape.singly)):
                block = np.zeros((channels, rows, len(columns)))
                block[channel] = columns.T
                label = f"{kind if name else 'constant'}:{name}:{channel}"
                found.append(_Alternative(label, "column", block.reshape(channels * rows, -1)))
    if len(np.unique(run)) > 2:
        for one in np.unique(run):
            for channel in range(channels):
                block = np.zeros((channels, rows, 1))
                block[channel, run == one, 0] = 1.0
                found.append(_Alternative(f"run:{one}:{channel}", "run", block.reshape(channels * rows, 1)))
    return found


class _Scores:
    """Scores of many residual vectors against the alternatives, at one correlation."""

    def __init__(self, ar1: Ar1, jacobian: Array, alternatives: Sequence[_Alternative], rho: float) -> None:
        self.ar1, self.rho = ar1, rho
        self.channels, self.rows = jacobian.shape[:2]
        self.basis = orthonormal(self.white(jacobian.reshape(self.channels * self.rows, -1)))
        blocks, self.sizes = [], []
        for alternative in alternatives:
            columns = self.white(alternative.columns)
            before = np.sqrt((columns * columns).sum(axis=0))
            columns = columns - self.basis @ (self.basis.T @ columns)
            after = np.sqrt((columns * columns).sum(axis=0))
            usable = after > 1e-4 * before  # what the model's own parameters can take up is no alternative
            block = orthonormal(columns[:, usable]) if usable.sum() > 1 else columns[:, usable] / after[usable]
            blocks.append(block)
            self.sizes.append(block.shape[1])
        self.matrix = np.concatenate(blocks, axis=1) if blocks else np.zeros((self.channels * self.rows, 0))

    def white(self, values: Array) -> Array:
        """Whiten (channels * rows, count) a channel at a time."""
        split = values.reshape(self.channels, self.rows, -1)
        return np.concatenate([self.ar1.whiten(split[c], self.rho) for c in range(self.channels)])

    def __call__(self, residuals: Array) -> tuple[Array, Array]:
        """Squared scores (alternatives, sets) and sums of squares (sets,) of residuals (channels * rows, sets)."""
        white = self.white(residuals)
        inside = self.basis.T @ white
        total = (white * white).sum(axis=0) - (inside * inside).sum(axis=0)
        squares = (self.matrix.T @ white) ** 2
        edges = np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(int)
        summed = np.add.reduceat(np.vstack([squares, np.zeros((1, white.shape[1]))]), edges, axis=0)
        summed[np.array(self.sizes) == 0] = 0.0
        return summed, total


def _log_p(
    scores: Array, total: Array, sizes: Sequence[int], freedom: int, known: bool, spread: float
) -> tuple[Array, Array]:
    """Nominal log p of every alternative (alternatives, sets) and of the sum of squares (sets,)."""
    from scipy.special import betainc, gammaincc

    result = np.zeros_like(scores)
    for size in set(sizes):
        if size == 0:
            continue
        pick = np.array(sizes) == size
        if known:
            tail = gammaincc(size / 2.0, scores[pick] / 2.0)
        else:  # an F distribution: the sd itself was estimated
            tail = betainc(spread / 2.0, size / 2.0, spread / (spread + scores[pick]))
        result[pick] = np.log(np.maximum(tail, TINY))
    omnibus = np.log(np.maximum(gammaincc(freedom / 2.0, total / 2.0), TINY)) if known else np.zeros_like(total)
    return result, omnibus


def _combine(log_p: Array, omnibus: Array, families: Sequence[str], known: bool) -> Array:
    """-log of the smallest p-value, each family counted as one test of equal weight (sets,)."""
    statistics = []
    names = np.array(families)
    for family in dict.fromkeys(families):
        block = log_p[names == family]
        statistics.append(-(block.min(axis=0) + np.log(_effective(block.shape[0]))))
    if known:
        statistics.append(-omnibus)
    return np.asarray(np.max(statistics, axis=0))


def _effective(count: int) -> float:
    """Independent tests that `count` overlapping ones amount to, roughly; the simulation makes the level exact."""
    return float(max(1.0, count**0.75))


def assess(
    case: Case,
    residual: Array,
    jacobian: Array,
    noise: Noise,
    directions: Sequence[Direction],
    shapes: Mapping[str, Shapes],
    rows: npt.NDArray[np.bool_],
    seed: int = 0,
) -> Adequacy:
    """Test the residuals (channels, rows), in the channels' units, of a model with derivatives (channels, rows, p).

    `rows` is the mask of the case's rows that these are; the draw of simulated noise depends on `seed` alone.
    """
    run = case.run[rows]
    sigma = noise.sigma
    channels, count = residual.shape
    ar1 = Ar1(run)
    scaled = residual / sigma[:, None]
    slopes = jacobian / sigma[:, None, None]
    alternatives = _alternatives(directions, shapes, run, sigma)
    families = [a.family for a in alternatives]
    known = bool(noise.known.all())
    cache: dict[float, _Scores] = {}

    def scores_at(rho: float) -> _Scores:
        if rho not in cache:
            cache[rho] = _Scores(ar1, slopes, alternatives, rho)
        return cache[rho]

    freedom = channels * count - slopes.shape[2]
    spread = float(np.min(noise.freedom))
    here = scores_at(noise.rho)
    observed, total = here(scaled.reshape(-1, 1))
    log_p, omnibus = _log_p(observed, total, here.sizes, freedom, known, spread)
    statistic = float(_combine(log_p, omnibus, families, known)[0]) if alternatives else float(-omnibus[0])
    null = _null(ar1, slopes, noise, families, scores_at, freedom, spread, known, seed)
    gain: dict[str, float] = {}
    sample, rest = channels * count, np.maximum(total[0] - observed[:, 0], TINY)
    gains = sample * np.log(total[0] / rest) - np.array(here.sizes) * np.log(sample)
    for alternative, value in zip(alternatives, gains, strict=True):
        gain[alternative.label] = max(gain.get(alternative.label, -np.inf), float(value))
    strongest = max(gain, key=lambda label: gain[label]) if gain else "sum of squares"
    return Adequacy(max(_p_value(statistic, null), TINY), strongest, gain)


def _null(
    ar1: Ar1,
    slopes: Array,
    noise: Noise,
    families: Sequence[str],
    scores_at: Callable[[float], _Scores],
    freedom: int,
    spread: float,
    known: bool,
    seed: int,
) -> Array:
    """The statistic's values on simulated noise, with sd and correlation estimated from each set."""
    channels, count, _ = slopes.shape
    random = np.random.default_rng([seed, 0x7E57])
    drawn = [ar1.colour(random.standard_normal((count, SETS)), noise.rho) for _ in range(channels)]
    bases = [orthonormal(slopes[c]) for c in range(channels)]
    given = [1.0 if is_known else None for is_known in noise.known]
    criterion, _ = restricted_likelihood(ar1, drawn, bases, given)
    chosen = np.argmin(criterion, axis=0)
    result = np.empty(SETS)
    for index in np.unique(chosen):
        sets = chosen == index
        rho = RHO_GRID[int(index)]
        block = np.stack([d[:, sets] for d in drawn])
        for channel in range(channels):
            if noise.known[channel]:
                continue
            block[channel] /= _spread(ar1, block[channel], bases[channel], noise.groups, rho)
        scores = scores_at(rho)
        values, total = scores(block.reshape(channels * count, -1))
        log_p, omnibus = _log_p(values, total, scores.sizes, freedom, known, spread)
        result[sets] = _combine(log_p, omnibus, families, known) if families else -omnibus
    return result


def _spread(ar1: Ar1, values: Array, basis: Array, groups: npt.NDArray[np.int64] | None, rho: float) -> Array:
    """The noise sd that each simulated set (rows, sets) would be said to have."""
    if groups is not None:
        return within_scatter(ar1, values, groups, rho)
    white = ar1.whiten(values, rho)
    left = (white * white).sum(axis=0)
    if basis.shape[1]:
        q = np.linalg.qr(ar1.whiten(basis, rho))[0]
        left = left - ((q.T @ white) ** 2).sum(axis=0)
    return np.asarray(np.sqrt(np.maximum(left, 1e-300) / max(len(values) - basis.shape[1], 1)))


def _p_value(statistic: float, null: Array) -> float:
    """Share of simulated statistics at least as large; beyond the last of them the tail falls off exponentially."""
    beyond = int((null >= statistic).sum())
    if beyond >= TAIL * len(null) / 2:
        return (1 + beyond) / (1 + len(null))
    edge = float(np.quantile(null, 1.0 - TAIL))
    mean_excess = float(np.mean(null[null > edge] - edge))
    return float(min(TAIL, TAIL * np.exp(-(statistic - edge) / max(mean_excess, 1e-12))))


def where_it_fails(
    case: Case,
    adequacy: Adequacy,
    scaled: Array,
    rows: npt.NDArray[np.bool_],
    columns: Mapping[str, Array],
    channels: Sequence[str],
    limit: int = 5,
) -> list[Failure]:
    """Columns on which the residual (channels, rows), in noise sd, depends most, strongest first, with the range."""
    ranked: dict[tuple[str, int], float] = {}
    constant = max((v for label, v in adequacy.gain.items() if label.startswith("constant:")), default=0.0)
    for label, value in adequacy.gain.items():
        kind, _, rest = label.partition(":")
        column, _, index = rest.rpartition(":")
        # a column that hardly varies is nearly a constant: as a plain factor it must do better than one
        if kind == "column" or (kind == "plain" and value > max(constant, 0.0) + MARGIN):
            key = (column, int(index))
            ranked[key] = max(ranked.get(key, -np.inf), value)
    for name, value in _by_effect(case, adequacy).items():
        if name in columns:  # a wave in the angle is no polynomial, but it is a dependence on the angle
            key = max((k for k in ranked if k[0] == name), key=lambda k: ranked[k], default=(name, 0))
            ranked[key] = max(ranked.get(key, -np.inf), value)
    everywhere: set[int] = set()
    for number in range(len(channels)):
        offset = adequacy.gain.get(f"constant::{number}", 0.0)
        mine = [key for key in ranked if key[1] == number]
        if mine and offset > 0.0:
            strongest = max(mine, key=lambda key: (key[0] in case.roles, ranked[key]))
            if offset > ranked[strongest]:  # off by a constant: the range is all there is
                ranked[strongest] = offset
                everywhere.add(number)
    failures: list[Failure] = []
    for name, channel in sorted(ranked, key=lambda key: -ranked[key]):
        if any(f.variable == name and f.channel == channels[channel] for f in failures):
            continue
        if failures and ranked[name, channel] <= 0.0:
            break
        share = 1.0 if channel in everywhere else 0.7
        failures.append(
            _range(case, name, columns[name][rows], scaled, channel, rows, channels, ranked[name, channel], share)
        )
        if len(failures) == limit:
            break
    return failures


def _by_effect(case: Case, adequacy: Adequacy) -> dict[str, float]:
    """Gain of a role through the effects that need it, less what their number of shapes would find by chance."""
    found: dict[str, float] = {}
    for label, value in adequacy.gain.items():
        kind, _, name = label.partition(":")
        if kind != "effect":
            continue
        effect = case.library[name]
        penalty = 2.0 * sum(np.log(max(1, len(p.grid))) for p in effect.parameters[1:])
        for group in effect.needs:
            role = next((r for r in group if r in case.roles), None)
            if role is not None:
                found[role] = max(found.get(role, -np.inf), value - penalty)
    return found


def _range(
    case: Case,
    name: str,
    values: Array,
    scaled: Array,
    channel: int,
    rows: npt.NDArray[np.bool_],
    channels: Sequence[str],
    gain: float,
    share: float,
) -> Failure:
    """The stretch of the column, at most `share` of the rows, in which the residual's sum stands out most."""
    order = np.argsort(values, kind="stable")
    x, plain = values[order], scaled[channel][order]
    omega = case.roles.get("omega")
    series = [(plain, False)]
    if omega is not None and (omega[rows] < 0).any():
        series.append((plain * np.sign(omega[rows][order]), True))
    edges = np.unique(np.linspace(0, len(x), min(len(x), 40) + 1).astype(int))
    edges = np.array([e for e in edges if e in (0, len(x)) or x[e] > x[e - 1]])
    best = (-1.0, 0, len(x), False)
    smallest = max(3, len(x) // 20)
    for one, directed in series:
        sums = np.concatenate([[0.0], np.cumsum(one)])
        for i, begin in enumerate(edges[:-1]):
            for end in edges[i + 1 :]:
                size = end - begin
                if size < smallest or size > share * len(x):
                    continue
                strength = abs(sums[end] - sums[begin]) / np.sqrt(size)
                if strength > best[0] * (1.0 + 1e-9):
                    best = (float(strength), int(begin), int(end), directed)
    _, begin, end, directed = best
    chosen = series[-1][0] if directed else plain
    mean = float(chosen[begin:end].mean())
    return Failure(name, float(x[begin]), float(x[end - 1]), channels[channel], mean, gain, directed)
