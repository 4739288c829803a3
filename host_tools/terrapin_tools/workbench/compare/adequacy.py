"""Is anything missing, and where does the model fail?

The statistic is a Bayes factor (bayes_factor.py): how much likelier the residuals are if the model lacks an effect of
the catalogue, a smooth shape in any numeric column (mapped or not), or something went wrong on the rig (mishaps.py),
than if it lacks nothing. Its distribution when nothing is missing comes from simulation: noise on the very rows of the
case, each set of a kind drawn from what the data say about it. A test that takes rows as independent would raise a
false alarm nearly always at a correlation of 0.9, or where runs differ by an offset.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.bayes_factor import BayesFactor, blocks_of
from terrapin_tools.workbench.model.data_columns import Direction, Shapes
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.estimate import Noise
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import LIKELY, STATED
from terrapin_tools.workbench.noise.mishaps import Mishap

__all__ = ["Adequacy", "Failure", "assess", "failure_on", "where_it_fails"]

SETS = 400  # simulated sets of noise; chosen by hand: a p-value of 0.05 is known to +- 0.011
MARGIN = 6.0  # of gain: strong evidence on the scale of the Bayesian information criterion (Kass & Raftery 1995)
MARGIN_OF_LEVEL = 1.2  # on p: the kind of noise is estimated; without it 42 of 622 sets of AR(1) had p below 0.05
TINY = 1e-300  # p-values below this are as good as 0, and have no logarithm
ENOUGH = 30  # degrees of freedom below which a stated sd is needed to tell noise from effects; chosen by hand
ROUNDING = 1e-2  # noise sd below which a misfit is that of rounding, and has no scale of its own; chosen by hand
STRETCH = 0.7  # of the rows, at most, that a range has of which it is said that the model fails there; chosen by hand
TAIL = 0.05  # share of the sets from which the tail beyond is continued; chosen by hand


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
    log_bayes_factor: float  # of "something" against "nothing"
    gain: Mapping[str, float]  # by alternative: what it would take from n log(sum of squares), penalised for its size


@dataclass(frozen=True)
class _Alternative:
    """A block of columns (channels * rows, count) whose squared scores are summed."""

    label: str
    columns: Array


def _alternatives(
    directions: Sequence[Direction], shapes: Mapping[str, Shapes], rows: int, sigma: Array
) -> list[_Alternative]:
    channels = len(sigma)
    found = []
    for direction in directions:
        flat = (direction.change / sigma[:, None]).reshape(-1, 1)
        found.append(_Alternative(f"effect:{direction.effect}", flat))
    for name, shape in shapes.items():
        for channel in range(channels):
            for kind, columns in (("column", shape.together), *(("plain", one[None]) for one in shape.singly)):
                block = np.zeros((channels, rows, len(columns)))
                block[channel] = columns.T
                label = f"{kind if name else 'constant'}:{name}:{channel}"
                found.append(_Alternative(label, block.reshape(channels * rows, -1)))
    return found


def assess(
    case: Case,
    residual: Array,
    jacobian: Array,
    prediction: Array,
    noise: Noise,
    directions: Sequence[Direction],
    effects: Mapping[str, Sequence[Shape]],
    shapes: Mapping[str, Shapes],
    rows: Mask,
    seed: int = 0,
    varying: Sequence[Array] = (),
    wrong: Sequence[Mishap] = (),
    felt: Array | None = None,
) -> Adequacy:
    """The p-value of "nothing is missing" for the residuals of a fitted model, and what raised it.

    Parameters
    ----------
    residual : (channels, rows), measured minus predicted, in the channels' units.
    jacobian : (channels, rows, parameters), derivatives of the prediction, in the same units.
    prediction : (channels, rows), in the same units.
    noise : sd and kind, from `estimate_noise`.
    directions, effects, shapes : what an effect of the catalogue, at each shape, or a column of the data could change.
    rows : (all rows,), mask of the case's rows that these are.
    seed : the draw of simulated noise depends on it alone.
    varying, wrong : see `blocks_of`.
    felt : see `Runs`.
    """
    run = case.run[rows]
    channels = len(residual)
    runs = Runs(run, channels, prediction, felt, ~noise.known)
    slopes = jacobian / noise.sigma[:, None, None]
    scaled = (residual / noise.sigma[:, None]).reshape(-1, 1)
    blocks = blocks_of(effects, shapes, runs, varying, wrong)
    few = scaled.size - slopes.shape[-1] < ENOUGH
    behind = noise.behind if few or float(np.sqrt(np.mean(scaled**2))) < ROUNDING else 0.0
    every = BayesFactor(runs, slopes, blocks, behind, noise.kinds)
    likely = [np.exp(logs[:, 0] - logsumexp(logs[:, 0])) > LIKELY for logs in every.weigh(scaled)]
    nodes = np.array(noise.kinds)[likely[0] | likely[1]].tolist()
    statistic = BayesFactor(runs, slopes, blocks, behind, nodes)
    observed, posterior = statistic(scaled)
    random = np.random.default_rng([seed, 0x7E57])
    drawn = _simulated(runs, statistic.evidence.nodes, posterior[:, 0], random)
    if behind:
        drawn *= np.sqrt(STATED / random.chisquare(STATED, drawn.shape[1]))
    null, _ = statistic(drawn)
    gain = _gains(runs, slopes, scaled, noise.node, _alternatives(directions, shapes, len(run), noise.sigma))
    p_value = float(np.clip(MARGIN_OF_LEVEL * _p_value(float(observed[0]), null), TINY, 1.0))
    return Adequacy(p_value, float(observed[0]), gain)


def _simulated(runs: Runs, nodes: Sequence[int], posterior: Array, random: np.random.Generator) -> Array:
    """Noise (channels * rows, SETS) of unit sd, the kind of each set drawn from its posterior (nodes,)."""
    # the middle of SETS equal slices of probability: the same spread as random draws, without their scatter
    drawn = np.searchsorted(np.cumsum(posterior), (np.arange(SETS) + 0.5) / SETS)
    drawn = np.minimum(drawn, len(nodes) - 1)
    noise = np.empty((runs.channels * runs.rows, SETS))
    for place in np.unique(drawn):
        mine = drawn == place
        noise[:, mine] = runs.draw(random, int(mine.sum()), NODES[nodes[place]])
    return noise


def _gains(
    runs: Runs, slopes: Array, scaled: Array, node: Node, alternatives: Sequence[_Alternative]
) -> dict[str, float]:
    """By alternative: the fall of n log(sum of squares) in one kind of noise, penalised for its number of columns."""

    def white(values: Array) -> Array:
        return runs.whiten(values.reshape(sample, -1), node)

    sample = slopes.shape[0] * slopes.shape[1]
    basis = orthonormal(white(slopes))
    residual = white(scaled)[:, 0]
    residual = residual - basis @ (basis.T @ residual)
    total = float(residual @ residual)
    width = [alternative.columns.shape[1] for alternative in alternatives]
    everything = white(np.concatenate([a.columns for a in alternatives], axis=1)) if alternatives else np.zeros((0, 0))
    before = np.sqrt((everything * everything).sum(axis=0))
    everything = everything - basis @ (basis.T @ everything) if alternatives else everything
    after = np.sqrt((everything * everything).sum(axis=0))
    gain: dict[str, float] = {}
    begin = 0
    for alternative, count in zip(alternatives, width, strict=True):
        part = slice(begin, begin + count)
        begin += count
        usable = after[part] > 1e-4 * before[part]  # what the model's own parameters can take up is no alternative
        columns = everything[:, part][:, usable]
        block = orthonormal(columns) if columns.shape[1] > 1 else columns / after[part][usable]
        left = max(total - float(((block.T @ residual) ** 2).sum()), TINY)
        value = sample * np.log(max(total, TINY) / left) - block.shape[1] * np.log(sample)
        gain[alternative.label] = max(gain.get(alternative.label, -np.inf), float(value))
    return gain


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
    rows: Mask,
    columns: Mapping[str, Array],
    channels: Sequence[str],
    limit: int = 5,
) -> list[Failure]:
    """The columns on which the residual depends most, strongest first, each with the range in which it stands out.

    Parameters
    ----------
    adequacy : of the same residual; its gains rank the columns.
    scaled : (channels, rows), measured minus predicted, in noise sd.
    rows : (all rows,), mask of the case's rows that these are.
    columns : numeric columns by name (all rows,), mapped or not, in their units.
    channels : names, in the order of `scaled`.
    limit : columns at most.
    """
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
        share = 1.0 if channel in everywhere else STRETCH
        failures.append(
            failure_on(case, name, columns[name][rows], scaled, channel, rows, channels, ranked[name, channel], share)
        )
        if len(failures) == limit:
            break
    return failures


def _by_effect(case: Case, adequacy: Adequacy) -> dict[str, float]:
    """Gain of a role through the effects that need it, less what their number of shapes would find by chance."""
    found: dict[str, float] = {}
    for label, value in adequacy.gain.items():
        effect = case.library.get(label.removeprefix("effect:"))
        if effect is None:  # a column, or a term of an equation of the user's own
            continue
        penalty = 2.0 * sum(np.log(max(1, len(p.grid))) for p in effect.parameters[1:])
        for group in effect.needs:
            role = next((r for r in group if r in case.roles), None)
            if role is not None:
                found[role] = max(found.get(role, -np.inf), value - penalty)
    return found


def failure_on(
    case: Case,
    name: str,
    values: Array,
    scaled: Array,
    channel: int,
    rows: Mask,
    channels: Sequence[str],
    gain: float,
    share: float = STRETCH,
) -> Failure:
    """The stretch of one column in which the sum of the residual stands out most.

    Parameters
    ----------
    values : (rows,), the column, in its unit.
    scaled : (channels, rows), measured minus predicted, in noise sd; `channel` is the one that is looked at.
    rows : (all rows,), mask of the case's rows that these are.
    gain : kept in the answer, for ranking.
    share : of the rows that the stretch may have at most.
    """
    order = np.argsort(values, kind="stable")
    x, plain = values[order], scaled[channel][order]
    omega = case.roles.get("omega")
    series = [(plain, False)]
    if omega is not None and (omega[rows] < 0).any():
        series.append((plain * np.sign(omega[rows][order]), True))
    edges = np.linspace(0, len(x), min(len(x), 40) + 1).astype(int)
    # rows of one value stay together; a converter's codes, or the levels of a plan, may each be hundreds of rows
    edges = np.unique([*np.searchsorted(x, x[edges[:-1]]), len(x)])
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
