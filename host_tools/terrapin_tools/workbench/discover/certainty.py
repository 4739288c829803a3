"""How sure: posterior probabilities as rates of being right, and what these very data could have shown.

The posterior is a rate only as far as the prior and the noise model are right. The map below changes the log odds only;
`python -m tests.campaigns.calibration --fit` prints what one fitted to its cases would be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.noise.covariance import orthonormal
from terrapin_tools.workbench.noise.kinds import Node
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES

__all__ = ["EVEN", "Operating", "calibrated", "operating_characteristic"]

# Log odds of being right = slope * log odds of the posterior + shift, with one slope below even odds and one above, by
# verdict, and for an effect to be part of it. What is told, alone or among others, and an effect that is part of it
# have one map, fitted to 300 cases of tests/campaigns/calibration.py (seed 10): no constant and no column is wrong
# there, for which the prior allows. "nothing" is fitted to 240 cases (seeds 1 to 3; a third of them lacks nothing, the
# effects are of 1 to 3 sd).
ANSWER = (1.0, 1.4, 0.3)
MAP = {
    "effect": ANSWER,
    "missing": ANSWER,
    "ambiguous": ANSWER,
    "partial": ANSWER,
    "mishap": (1.0, 1.0, 0.0),
    "unexplained": (1.0, 1.0, 0.0),
    "nothing": (1.36, 1.36, 1.73),
}
CEILING = 0.995  # probability at most; the campaigns are too few to check a larger one
# Of "nothing known explains it" at most: a known truth in noise of another kind than those that are weighed, or beyond
# what is searched, looks like that, too. Chosen by hand.
OUTSIDE = 0.8
EVEN = 0.5  # probability of "nothing" below which no text calls the model adequate: something is then likelier
DRAWS = 200  # simulated cases; chosen by hand: a rate of 0.5 is known to +- 0.035


@dataclass(frozen=True)
class Operating:
    """With these runs, an effect of `size` (rms, noise sd) is named first in `named` of all cases."""

    effect: str
    size: float
    named: float


def calibrated(probability: float, what: str = "effect") -> float:
    """A posterior probability as a rate of being right.

    Parameters
    ----------
    probability : posterior, 0 to 1.
    what : a key of MAP: the verdict that it belongs to, "nothing" for that of an adequate model, "mishap" for what
        went wrong on the rig, or "effect" for one effect to be part of what is missing.
    """
    below, above, shift = MAP[what]
    p = min(max(probability, 1e-12), 1.0 - 1e-12)
    odds = float(np.log(p / (1.0 - p)))
    odds = (above if odds > 0.0 else below) * odds + shift
    return float(min(1.0 / (1.0 + np.exp(-odds)), OUTSIDE if what == "unexplained" else CEILING))


def operating_characteristic(
    ranking: Ranking, effect: str, size: float, node: Node, rivals: Mapping[str, str], seed: int
) -> Operating | None:
    """How often an effect of this size would be named first among single effects, with these very runs.

    Noise and the effect at its likeliest shape are simulated on the case's own rows and ranked by the same evidence.

    Parameters
    ----------
    size : rms over all rows, in noise sd.
    node : the kind of noise.
    rivals : effect -> its equivalence class, in which any member counts.

    Returns
    -------
    None where the effect has no shape that these data could show.
    """
    evidence, shapes = ranking.evidence, ranking.shapes
    mine = [i for i, s in enumerate(shapes) if s.effect == effect]
    if evidence is None or not mine or size <= 0.0:
        return None
    width = [s.columns.shape[1] for s in shapes]
    white = evidence.whitened(np.concatenate([s.columns for s in shapes] + [evidence.residual[:, None]], axis=1), node)
    *columns, residual = np.split(white, np.cumsum(width), axis=1)
    chosen = max(mine, key=lambda i: _fit(columns[i], residual[:, 0]))
    random = np.random.default_rng([seed, 0x0C])
    drawn = random.standard_normal((len(evidence.residual), DRAWS))
    basis = orthonormal(evidence.runs.whiten(evidence.flat, node))
    noise = drawn - basis @ (basis.T @ drawn)
    scale = size * (1.0 if shapes[chosen].columns.shape[1] == 1 else np.sqrt(2.0))
    sign = -1.0 if shapes[chosen].upper <= 0.0 else 1.0
    draws = noise + sign * scale * columns[chosen][:, :1]
    logs: dict[str, list[Array]] = {}
    for shape, block in zip(shapes, columns, strict=True):
        logs.setdefault(shape.effect, []).append(_log_odds(block, draws))
    names = list(logs)
    table = np.array([logsumexp(np.array(logs[n]), axis=0) - np.log(len(logs[n])) for n in names])
    first = np.array([rivals.get(names[i], names[i]) for i in np.argmax(table, axis=0)])
    return Operating(effect, size, float(np.mean(first == rivals.get(effect, effect))))


def _fit(columns: Array, residual: Array) -> float:
    q = np.linalg.qr(columns)[0]
    return float(((q.T @ residual) ** 2).sum())


def _log_odds(columns: Array, draws: Array) -> Array:
    """Log evidence of a block against nothing, for each draw."""
    products, scores = columns.T @ columns, columns.T @ draws
    logs = []
    for width in SIZES:
        inner = np.eye(len(products)) + width * width * products
        gain = (scores * np.linalg.solve(inner, scores)).sum(axis=0) * width * width
        logs.append(0.5 * gain - 0.5 * np.linalg.slogdet(inner)[1])
    return np.asarray(logsumexp(np.array(logs), axis=0) - np.log(len(SIZES)))
