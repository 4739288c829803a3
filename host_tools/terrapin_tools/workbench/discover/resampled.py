"""How often the same answer would come out of other runs: a bootstrap over runs of the choice between answers.

Runs are drawn with replacement, as many as there are; every refitted answer is judged anew on them. Its evidence needs
only sums over runs of products of whitened columns, so these are computed once and a draw is a matter of weights: the
shapes and linearisations stay those of the refits, which is what makes it cheap.

Source: Efron & Tibshirani, An Introduction to the Bootstrap (1993), ch. 8 (resampling the independent units).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.comparison import Analysis, measured
from terrapin_tools.workbench.discover.decide import QUESTION
from terrapin_tools.workbench.discover.ranking import Hypothesis, Ranking
from terrapin_tools.workbench.model.linearised import Linear, linearise
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.kinds import NODES, considered
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES

__all__ = ["Selected", "Sums", "selection"]

ANSWERS = 24  # that take part at most; chosen by hand, for time


@dataclass(frozen=True)
class Selected:
    """An answer (a set of effects; empty: nothing, or an expression or run that has no name) and how often it won."""

    effects: tuple[str, ...]
    kind: str
    frequency: float


def selection(analysis: Analysis, ranking: Ranking, draws: int, seed: int) -> tuple[Selected, ...]:
    """Share of resampled sets of runs in which each answer is the likeliest, most frequent first.

    Parameters
    ----------
    draws : sets of runs, each drawn with replacement, as many runs as there are.
    seed : of the draws.
    """
    run = analysis.case.run[analysis.rows]
    runs = len(np.unique(run))
    random = np.random.default_rng([seed, 0xB007])
    weight = random.multinomial(runs, np.full(runs, 1.0 / runs), size=draws).astype(np.float64)
    once = np.ones((1, runs))
    values = measured(analysis.model, analysis.rows)
    channels = len(analysis.model.channels)
    weighed = ranking.evidence.nodes if ranking.evidence is not None else range(considered(channels))
    nodes = [i for i in weighed if not NODES[i].walk]  # a walk over the test has no meaning among runs drawn anew
    taking_part: list[Hypothesis] = []
    logs: list[Array] = []
    for hypothesis, posterior in zip(ranking.hypotheses, ranking.posterior, strict=True):
        fit = analysis.fit if hypothesis.kind == "nothing" else hypothesis.fit
        if (
            hypothesis.kind == "part"
            or fit is None
            or (posterior < QUESTION and hypothesis.kind != "nothing")
            or len(taking_part) == ANSWERS
        ):
            continue
        try:
            linear = linearise(fit, hypothesis.effects, values, analysis.rows, analysis.noise.sigma)
        except ValueError:
            continue
        widened = replace(linear, base=np.concatenate([linear.base, analysis.nuisance], axis=-1))
        sums = Sums(
            Runs(run, channels, analysis.prediction, analysis.felt, ~analysis.noise.known),
            widened,
            analysis.noise.behind,
            nodes,
        )
        # prior and what the shapes cost stay: only the evidence is drawn anew
        logs.append(hypothesis.log_weight + sums.evidence(weight) - sums.evidence(once))
        taking_part.append(hypothesis)
    best = np.argmax(np.array(logs), axis=0)
    share = np.bincount(best, minlength=len(logs)) / draws
    order = np.argsort(-share, kind="stable")
    return tuple(
        Selected(taking_part[i].effects, taking_part[i].kind, float(share[i])) for i in order if share[i] > 0.0
    )


class Sums:
    """Products of [base, effects, residual], whitened, summed within each run, at each correlation."""

    def __init__(self, runs: Runs, linear: Linear, behind: float, nodes: Sequence[int]) -> None:
        self.behind, self.linear = behind, linear
        channels, rows = linear.residual.shape
        base = orthonormal(linear.base.reshape(channels * rows, -1))
        self.base = base.shape[1]
        # the residual at coefficients 0 instead of at the fit
        at_zero = linear.residual.reshape(-1) + linear.columns @ linear.offset
        stacked = np.column_stack([base, linear.columns, at_zero])
        self.rows = runs.length.reshape(channels, -1).sum(axis=0)
        self.log_prior = np.log([NODES[i].prior for i in nodes])
        products, determinants = [], []
        for i in nodes:
            white = runs.whiten(stacked, NODES[i])
            total = np.array(
                [white[b : b + n].T @ white[b : b + n] for b, n in zip(runs.begin, runs.length, strict=True)]
            )
            products.append(total.reshape(channels, -1, *total.shape[1:]).sum(axis=0))
            determinants.append(runs.log_determinants(NODES[i]).reshape(channels, -1).sum(axis=0))
        self.products, self.determinants = np.array(products), np.array(determinants)

    def evidence(self, weight: Array) -> Array:
        """Log evidence (draws,) with runs counted `weight` (draws, runs) times."""
        p, count = self.base, len(self.linear.offset)
        freedom = weight @ self.rows - p
        found = []
        for products, determinant, log_prior in zip(self.products, self.determinants, self.log_prior, strict=True):
            total = np.tensordot(weight, products, axes=1)
            inner = total[:, :p, :p] + 1e-12 * np.eye(p)  # a draw may hold too few settings for every parameter
            cross = total[:, :p, p:]
            left = total[:, p:, p:] - np.swapaxes(cross, 1, 2) @ np.linalg.solve(inner, cross)
            a, b, square = left[:, :count, :count], left[:, :count, count], np.maximum(left[:, count, count], 1e-300)
            start = log_prior - 0.5 * (weight @ determinant + np.linalg.slogdet(inner)[1])
            for size in SIZES if count else SIZES[:1]:
                shrink = np.eye(count) + size * size * a
                solved = np.linalg.solve(shrink, b[..., None])[..., 0] * size * size if count else b
                squares = np.maximum(square - (b * solved).sum(axis=1), 1e-300)
                fit = -0.5 * (freedom + self.behind) * np.log(squares + self.behind)
                logs = start + fit - 0.5 * np.linalg.slogdet(shrink)[1] - (np.log(len(SIZES)) if count else 0.0)
                if np.any(self.linear.signs):
                    spread = np.diagonal(np.linalg.inv(shrink), axis1=1, axis2=2)
                    inside = log_ndtr(self.linear.signs * solved / (size * np.sqrt(np.maximum(spread, 1e-300))))
                    logs = logs + np.where(self.linear.signs != 0, np.log(2.0) + inside, 0.0).sum(axis=1)
                found.append(logs)
        return np.asarray(logsumexp(np.array(found), axis=0))
