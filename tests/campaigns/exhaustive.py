"""Discovery beside exhaustive BIC, on the cases of calibration.py.

    python -m tests.campaigns.exhaustive --cases 30 --seed 3          of each group of noises
    python -m tests.campaigns.exhaustive --part 1/4                   a quarter of the cases; parts merge

BIC refits every set of at most two effects of the same catalogue, on all rows, under noise with a correlation and an
offset a run, whose sizes it fits too; it is told nothing of the truth, and says what the set with the least BIC holds.
A case is right as calibration.py counts it. A wrong claim is an answer that names something and is not right; of
discovery that is `missing`, because only that names one set as the answer. Answers of discovery are those of
calibration.py, which are made where they are not there yet.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular, toeplitz

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.comparison import fitted_on, free_slopes, measured
from terrapin_tools.workbench.model.constants import suspected
from terrapin_tools.workbench.model.fitting import Fit, extend
from tests.campaigns import calibration
from tests.campaigns.resumed import Record, parser_of, rate, resumed
from tests.campaigns.truth import SAME

__all__ = ["chosen", "counts", "one", "paired"]

CORRELATIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9)  # of neighbouring rows of a run
OFFSETS = (0.0, 0.3, 0.6, 1.0, 1.5)  # sd of a run's offset, in that of a row
MOST = 2  # effects of a set


class Whitening:
    """All kinds of noise of the grid, for rows of one channel that belong to runs."""

    def __init__(self, run: Index) -> None:
        self.rows = [np.flatnonzero(run == one) for one in np.unique(run)]
        self.kinds = []
        longest = max(len(rows) for rows in self.rows)
        for rho in CORRELATIONS:
            for offset in OFFSETS:
                whole = np.linalg.cholesky(toeplitz(rho ** np.arange(longest)) + offset**2)
                log = 2.0 * sum(float(np.log(np.diag(whole)[: len(rows)]).sum()) for rows in self.rows)
                self.kinds.append((whole, log))

    def least(self, residual: Array, slopes: Array) -> float:
        """-2 log likelihood but for a constant: of the likeliest kind, size of the noise and step of the parameters."""
        both = np.concatenate([residual[:, None], slopes], axis=1)
        found: list[float] = []
        for whole, log in self.kinds:
            parts = [solve_triangular(whole[: len(r), : len(r)], both[r], lower=True) for r in self.rows]
            white = np.concatenate(parts)
            y, x = white[:, 0], white[:, 1:]
            left = y - x @ np.linalg.lstsq(x, y, rcond=1e-10)[0] if x.shape[1] else y
            found.append(len(y) * float(np.log(float(left @ left) / len(y))) + log)
        return min(found)


def chosen(case: Case) -> tuple[str, ...]:
    """The set of effects with the least BIC, of all with at most two. The case has one channel."""
    rows = case.train | case.test
    sigma = np.ones(1)
    base = fitted_on(case, (), rows, sigma)[0]
    model, values = base.model, measured(base.model, rows)
    names = sorted(effect.name for effect in suspected(model) if effect.name in case.library)
    whitening = Whitening(case.run[rows])

    def larger(fit: Fit, name: str) -> Fit:
        return extend(fit, name, fit.model.having(case.library[name]).bind(case.inputs, rows), values, sigma)

    def criterion(fit: Fit) -> float:
        _, residual, slopes = free_slopes(fit, sigma, rows)
        return whitening.least(residual[0], slopes[0]) + len(fit.theta) * float(np.log(rows.sum()))

    single = {name: larger(base, name) for name in names}
    found: dict[tuple[str, ...], float] = {(): criterion(base)}
    found |= {(name,): criterion(fit) for name, fit in single.items()}
    for first, second in combinations(names, MOST):
        found[first, second] = criterion(larger(single[first], second))
    return min(found, key=lambda effects: found[effects])


def one(group: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    made, case, _ = calibration.drawn(group, number, seed)
    named = chosen(case)
    right = set(named) == set(made.truth) and not made.column
    return {"truth": list(made.truth), "column": made.column, "named": list(named), "right": right}


def _right(bic: Record, own: Record) -> bool:
    """Nothing named counts where too little is hidden, as for discovery; only that campaign counts how much."""
    return bic["right"] or (not bic["named"] and own["hidden"] < SAME)


def paired(ours: Sequence[Record], theirs: Sequence[Record]) -> list[tuple[Record, Record]]:
    """Answers of discovery and of BIC to the same cases."""
    answers = {(r["family"], r["number"]): r for r in ours}
    return [(answers[r["family"], r["number"]], r) for r in theirs]


class Count(NamedTuple):
    right: int
    wrong: int  # claims


def counts(pairs: Sequence[tuple[Record, Record]]) -> tuple[Count, Count]:
    """Of discovery, and of BIC."""
    own = Count(
        sum(own["right"] for own, _ in pairs),
        sum(own["verdict"] == "missing" and not own["right"] for own, _ in pairs),
    )
    right = [_right(bic, own) for own, bic in pairs]
    return own, Count(
        sum(right), sum(bool(bic["named"]) and not good for (_, bic), good in zip(pairs, right, strict=True))
    )


def table(ours: Sequence[Record], theirs: Sequence[Record]) -> str:
    """Who is right how often, and who names something wrong, by group and over all."""
    lines = [f"{'group':14}{'cases':>6}{'right':>24}{'of BIC':>24}{'wrong claims':>14}{'of BIC':>8}"]
    pairs = paired(ours, theirs)
    for group in [*sorted({r["family"] for r in theirs}), "all"]:
        mine = [pair for pair in pairs if group in (pair[1]["family"], "all")]
        own, bic = counts(mine)
        rates = rate(own.right, len(mine)) + rate(bic.right, len(mine))
        lines.append(f"{group:14}{len(mine):6d}{rates}{own.wrong:14d}{bic.wrong:8d}")
    return "\n".join(lines)


def main() -> None:
    parser = parser_of(__doc__, "python -m tests.campaigns.exhaustive", calibration.GROUPS, cases=30)
    options = parser.parse_args()
    theirs = resumed(options, str(options.seed), lambda group, number: one(group, number, options.seed))
    own = {"out": Path(options.out).with_name("calibration"), "campaign": "calibration"}
    beside = Namespace(**{**vars(options), **own})
    ours = resumed(beside, str(options.seed), lambda group, number: calibration.one(group, number, options.seed))
    print(table(ours, theirs))


if __name__ == "__main__":
    main()
