"""The next experiment: settings at which sets of effects that are the same on the present data come apart.

For two refitted models A and B, a design is worth D, the weighted sum of squares of f_A - f_B that is left over old and
new rows together when B's parameters may follow (Atkinson and Fedorov 1975, linearised). With D known the wrong one
of the two is preferred with probability Phi(-sqrt(D)/2). A design starts as a full grid of levels and loses the run
that it misses least, as long as D stays large enough for every pair of rivals, whichever of the two is true.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from scipy.special import ndtr

from terrapin_hil.arrays import Array
from terrapin_hil.units import behind
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.experiment.rig_settings import held, levels, observed, rows_of, run_length
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["Experiment", "propose"]


ENOUGH = 25.0  # D at which the wrong one is preferred in 1 of 160; the sizes it rests on are estimates themselves
RUNS_LIMIT = 64
PLAIN = 16  # runs up to which a design that varies one role is preferred to one that varies two
CONSTANT = 0.02  # of its size, below which a role has not varied
TOGETHER = 0.8  # correlation from which two roles are said to go together
DISTINCT = 1.0  # D that some design must reach for the rivals to count as two things


@dataclass(frozen=True)
class Experiment:
    """Roles to vary, settings (one run each, canonical units), what to hold, and how sure one is afterwards."""

    vary: tuple[str, ...]
    settings: tuple[Mapping[str, float], ...]
    hold: Mapping[str, float]
    separates: tuple[str, ...]
    runs: int
    error_rate: float  # probability that the wrong one is preferred afterwards
    reason: str


@dataclass(frozen=True)
class _Plan:
    roles: tuple[str, ...]
    settings: tuple[Mapping[str, float], ...]
    worth: float


def propose(
    analysis: Analysis,
    rivals: Sequence[tuple[tuple[str, ...], Fit]],
    node: Node | None = None,
    formulas: Mapping[str, str] | None = None,
) -> Experiment | None:
    """The design with the fewest runs that tells the rivals apart; None when no design tells any two of them apart.

    `node` is the kind of noise that is left when a rival is added; as compare found it when not given. `formulas`: what
    an expression says, for the sentence.

    Two rivals that no setting tells apart (a constant and an exponential that hardly falls) do not stand in the way of
    telling the others apart.
    """
    case, rows = analysis.case, analysis.rows
    read = {name for _, fit in rivals for formula in fit.model.expressions.values() for name in formula.names}
    steps, hold = levels(case, rows, read), held(case, rows, read)
    old = [_rows(fit, analysis, None) for _, fit in rivals]
    grids = []
    for roles in [*combinations(steps, 1), *combinations(steps, 2)]:
        settings = [dict(zip(roles, v, strict=True)) for v in product(*(steps[role] for role in roles))]
        grid = _Grid.of(analysis, [fit for _, fit in rivals], old, roles, settings, hold, node or analysis.noise.node)
        if grid is not None:
            grids.append(grid)
    reach: dict[tuple[int, int], float] = {}
    for grid in grids:
        for pair, value in grid.each(grid.most).items():
            reach[pair] = max(reach.get(pair, 0.0), float(value[-1]))
    pairs = [pair for pair, value in reach.items() if value > DISTINCT]
    if not pairs:
        return None
    alone = [grid.smallest(pairs) for grid in grids if len(grid.roles) == 1]
    plain = [plan for plan in alone if len(plan.settings) <= PLAIN and plan.worth >= ENOUGH]
    # one role does: simpler to run, and to explain
    plans = plain or [*alone, *(grid.smallest(pairs) for grid in grids if len(grid.roles) == 2)]
    good = [plan for plan in plans if plan.worth >= ENOUGH]
    best = min(good, key=lambda p: (len(p.settings), -p.worth)) if good else max(plans, key=lambda p: p.worth)
    rivals = [rival for i, rival in enumerate(rivals) if any(i in pair for pair in pairs)]
    same = {r: best.settings[0][r] for r in best.roles if len({setting[r] for setting in best.settings}) == 1}
    if len(same) < len(best.roles):  # what is the same in all of them is held, not varied
        hold, roles = {**hold, **same}, tuple(role for role in best.roles if role not in same)
        best = _Plan(roles, tuple({r: setting[r] for r in roles} for setting in best.settings), best.worth)
    names = [_name(effects, [r[0] for r in rivals], formulas or {}) for effects, _ in rivals]
    return Experiment(
        vary=best.roles,
        settings=best.settings,
        hold={
            role: value
            for role, value in hold.items()
            if role in steps and role not in best.roles and role != "acceleration"
        },
        separates=tuple(dict.fromkeys(name for effects, _ in rivals for name in effects)),
        runs=len(best.settings),
        error_rate=float(ndtr(-0.5 * np.sqrt(best.worth))),
        reason=(
            f"{_listed(names)} predict the same here because {_why(analysis, best, read)}; "
            f"in the proposed runs they differ by {np.sqrt(best.worth):.1f} noise sd in all."
        ),
    )


def _name(effects: tuple[str, ...], sets: Sequence[tuple[str, ...]], formulas: Mapping[str, str]) -> str:
    """What distinguishes a set from the others."""
    shared = set.intersection(*(set(s) for s in sets))
    return " + ".join(formulas.get(e, e) for e in [e for e in effects if e not in shared] or effects)


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _why(analysis: Analysis, plan: _Plan, read: Collection[str]) -> str:
    """What would have to vary and does not, or what varies only together with something else."""
    case = analysis.case
    seen = observed(case, analysis.rows, read)
    constant, tied, other = [], [], []
    for role in plan.roles:
        values, unit = seen[role], case.units.get(role, case.parameter_units.get(role, ""))
        new = np.array([setting[role] for setting in plan.settings])
        if np.ptp(values) <= CONSTANT * float(np.abs(values).max()):
            shown = f"{float(np.median(values)):.4g}{behind(unit)}"
            constant.append(f"{role} stays at {shown} in all runs")
        elif (values.min() >= 0.0 > new.min()) or (values.max() <= 0.0 < new.max()):
            constant.append(f"{role} has one direction in all runs")
        else:
            partner, how = _partner(role, seen)
            if how >= TOGETHER:
                pair = " and ".join(sorted((role, partner)))
                tied.append(f"{pair} go together in all runs (correlation {how:.2f})")
            else:
                low, high = float(values.min()), float(values.max())
                beyond = max(low - new.min(), new.max() - high) > CONSTANT * (high - low)
                where = "not beyond" if beyond else "too seldom where they differ"
                other.append(f"{role} went from {low:.4g} to {high:.4g}{behind(unit)}, {where}")
    return " and ".join(dict.fromkeys(constant or tied or other))


def _partner(role: str, seen: Mapping[str, Array]) -> tuple[str, float]:
    """The other role that goes with this one most, and the size of their correlation."""
    best = ("", 0.0)
    for other, values in seen.items():
        if other in (role, "time", "angle") or len(values) != len(seen[role]) or np.ptp(values) == 0.0:
            continue
        for one in (values, np.abs(values)):
            if np.ptp(one) > 0.0:
                how = float(np.abs(np.corrcoef(seen[role], one)[0, 1]))
                best = max(best, (other, how), key=lambda entry: entry[1])
    return best


Rows = tuple[Array, Array]  # prediction (channels, rows) and its derivatives, in noise sd
Sums = tuple[Array, Array, Array]  # of slopes x slopes (P, P), slopes x gap (P,) and gap x gap (), with leading axes


def _rows(fit: Fit, analysis: Analysis, inputs: Mapping[str, Array] | None) -> Rows:
    sigma = analysis.noise.sigma
    bound = fit.model.bind(analysis.case.inputs, analysis.rows) if inputs is None else fit.model.bind(inputs)
    prediction, slopes = bound.jacobian(fit.theta)
    return prediction / sigma[:, None], slopes / sigma[:, None, None]


def _sums(true: Rows, other: Rows, runs: int, weight: float) -> Sums:
    """Sums over the rows of each of `runs` equal blocks."""
    gap, slopes = true[0] - other[0], other[1]
    count = gap.shape[1] // runs
    gap = gap.reshape(gap.shape[0], runs, count)
    slopes = slopes.reshape(gap.shape[0], runs, count, -1)
    return (
        weight * np.einsum("crip,criq->rpq", slopes, slopes),
        weight * np.einsum("crip,cri->rp", slopes, gap),
        weight * np.einsum("cri,cri->r", gap, gap),
    )


def _left(sums: Sums) -> Array:
    """The gap's sum of squares beyond the slopes, for each entry of the leading axis."""
    products, scores, total = sums
    scale = np.sqrt(np.maximum(np.diagonal(products, axis1=-2, axis2=-1), 1e-300))
    inner = products / (scale[..., :, None] * scale[..., None, :]) + 1e-9 * np.eye(scale.shape[-1])
    side = scores / scale
    if side.shape[-1] == 0:
        return total
    return np.asarray(total - (side * np.linalg.solve(inner, side[..., None])[..., 0]).sum(axis=-1))


@dataclass(frozen=True)
class _Grid:
    """A full grid of settings of some roles, and what a run at each of them adds to each pair of rivals."""

    roles: tuple[str, ...]
    settings: Sequence[Mapping[str, float]]
    old: Mapping[tuple[int, int], Sequence[Sums]]  # both ways round
    new: Mapping[tuple[int, int], Sequence[Sums]]

    @classmethod
    def of(
        cls,
        analysis: Analysis,
        fits: Sequence[Fit],
        old: Sequence[Rows],
        roles: tuple[str, ...],
        settings: Sequence[Mapping[str, float]],
        hold: Mapping[str, float],
        node: Node,
    ) -> _Grid | None:
        case = analysis.case
        count = run_length(case, analysis.rows)
        thin = node.thin(count)  # rows count for less where they are correlated, or runs have offsets
        inputs = rows_of(case, analysis.rows, settings, hold, count)
        with np.errstate(all="ignore"):
            new = [_rows(fit, analysis, inputs) for fit in fits]
        if not all(np.isfinite(part).all() for rows in new for part in rows):
            return None
        weight, runs = max(thin, 1.0 / count), len(settings)
        pairs = list(combinations(range(len(fits)), 2))
        return cls(
            roles,
            settings,
            {(a, b): [_sums(old[i], old[j], 1, thin) for i, j in ((a, b), (b, a))] for a, b in pairs},
            {(a, b): [_sums(new[i], new[j], runs, weight) for i, j in ((a, b), (b, a))] for a, b in pairs},
        )

    @property
    def most(self) -> Array:
        """Designs (designs, settings) of one run, two, ... at every setting."""
        copies = max(1, RUNS_LIMIT // len(self.settings))
        return np.arange(1, copies + 1, dtype=np.float64)[:, None] * np.ones(len(self.settings))

    def each(self, times: Array) -> dict[tuple[int, int], Array]:
        """D of every pair, whichever of the two is true, for numbers of runs a setting (designs, settings)."""
        found = {}
        for pair in self.old:
            both = []
            for before, fresh in zip(self.old[pair], self.new[pair], strict=True):
                total = [b[0] + np.tensordot(times, f, axes=1) for b, f in zip(before, fresh, strict=True)]
                both.append(_left((total[0], total[1], total[2])))
            found[pair] = np.minimum(*both)
        return found

    def smallest(self, pairs: Sequence[tuple[int, int]]) -> _Plan:
        """The fewest runs that tell these pairs apart; where none do, all that the limit allows."""

        def worth(designs: Array) -> Array:
            each = self.each(designs)
            return np.asarray(np.min([each[pair] for pair in pairs], axis=0))

        trial = self.most
        values = worth(trial)
        enough = np.flatnonzero(values >= ENOUGH)
        times = trial[enough[0]] if len(enough) else trial[-1]
        value = float(values[enough[0]] if len(enough) else values[-1])
        while len(enough) and times.sum() > 2:
            fewer = np.array([times - np.eye(len(times))[i] for i in np.flatnonzero(times > 0)])
            values = worth(fewer)
            best = int(np.argmax(values))
            if values[best] < ENOUGH:
                break
            times, value = fewer[best], float(values[best])
        runs = [dict(self.settings[i]) for i in range(len(self.settings)) for _ in range(int(times[i]))]
        return _Plan(self.roles, tuple(runs), value)
