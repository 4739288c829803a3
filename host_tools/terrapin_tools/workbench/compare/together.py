"""Parameters that the data cannot tell apart, and the combinations of them that the data do determine.

Where the columns of the derivatives are (nearly) dependent, parameters can change together and the prediction stays.
Which combination stays is read off that way: a product of powers, a sum, or, where it is neither, what holds near the
fit. The way is followed some distance, with the other parameters refitted, so that the form of the combination shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.compare.comparison import Analysis, covered

__all__ = ["Determined", "Together", "together"]

APART = 30.0  # times the sd that a parameter would have alone, from which it is not told from others; chosen by hand
LOOSE = 0.5  # share of its value that its sd then is at least; chosen by hand
PART = 0.05  # of a direction of length 1 that a parameter has at least, to belong to it; chosen by hand
WAY = 0.1  # share of its value by which a parameter is moved, to see what stays; chosen by hand
STAYS = 1e-3  # of that, which what stays may change
FOLLOWED = 3  # refits on that way
ROUND = 0.02  # that an exponent may be off a multiple of a half; chosen by hand


@dataclass(frozen=True)
class Determined:
    """A combination of parameters. `near`: it holds near the fit only."""

    formula: str
    value: float
    sd: float
    near: bool


@dataclass(frozen=True)
class Together:
    """Parameters that cannot be told apart, and what is determined of them."""

    parameters: tuple[str, ...]
    determined: tuple[Determined, ...]


def together(analysis: Analysis) -> list[Together]:
    """Groups of parameters of the fit that the training runs do not tell apart, largest first."""
    fit = analysis.fit
    if not len(fit.theta):
        return []
    flat = fit.jacobian.reshape(-1, len(fit.theta))
    size = np.sqrt((flat * flat).sum(axis=0))
    used = np.flatnonzero(np.isfinite(size) & (size > 0.0) & [not one.whole for one in fit.model.fitted])
    if len(used) < 2:
        return []
    alone = 1.0 / size[used]  # sd of each, were the others known
    _, values, rows = np.linalg.svd(flat[:, used] * alone, full_matrices=False)
    lost = rows[values < 1.0 / APART].T
    sd = alone * np.sqrt((lost**2 / np.maximum(values[values < 1.0 / APART], 1e-12) ** 2).sum(axis=1))
    lost = lost[:, np.abs(lost).max(axis=0, initial=0.0) > 0.0]
    if not lost.shape[1] or (sd > LOOSE * np.abs(fit.theta[used])).sum() < 2:
        return []
    seen = rows[values >= 1.0 / APART].T
    matrix = _covariance(analysis, used, alone, seen)
    found = [_group(analysis, used, alone, lost, members, matrix) for members in _groups(lost)]
    return sorted(found, key=lambda one: -len(one.parameters))


def _covariance(analysis: Analysis, used: Index, alone: Array, seen: Array) -> Array:
    """Of the parameters `used`, without the directions that nothing determines."""
    fit = replace(analysis.fit, jacobian=analysis.fit.jacobian[..., used] * alone @ seen)
    plain, robust = covered(fit, analysis.case, analysis.noise.sigma, analysis.told)
    turn = alone[:, None] * seen
    inside = plain if not analysis.missing or np.trace(plain) > np.trace(robust) else robust
    return np.asarray(turn @ inside @ turn.T)


def _groups(lost: Array) -> list[list[int]]:
    """Places of parameters that have a direction in common."""
    tied = np.abs(lost @ lost.T) > PART**2
    left = [int(i) for i in np.flatnonzero(np.sqrt((lost**2).sum(axis=1)) > PART)]
    groups = []
    while left:
        group, fresh = [left[0]], [left[0]]
        while fresh:
            fresh = [i for i in left if i not in group and tied[i, fresh].any()]
            group += fresh
        left = [i for i in left if i not in group]
        groups.append(sorted(group))
    return [group for group in groups if len(group) > 1]


def _group(
    analysis: Analysis, used: Index, alone: Array, lost: Array, members: Sequence[int], matrix: Array
) -> Together:
    names = [analysis.fit.model.fitted[used[i]].key for i in members]
    value = analysis.fit.theta[used[list(members)]]
    count = int(np.linalg.matrix_rank(lost[members], tol=PART))
    ways = lost[members] @ np.linalg.svd(lost[members])[2][:count].T  # each parameter in its sd alone
    relative = np.abs(ways).max(axis=1) * alone[members] / np.maximum(np.abs(value), 1e-300)
    steady = relative <= 2.0 * np.sort(relative)[count - 1]  # a parameter near 0 is no measure of the others
    order = qr((ways * np.where(steady, 1.0, 1e-6)[:, None]).T, pivoting=True)[2]
    pivots, others = np.sort(order[:count]), np.sort(order[count:])
    ways = ways * alone[members][:, None]
    slopes = ways[others] @ np.linalg.inv(ways[pivots])  # of the others with the pivots
    places = used[list(members)]
    moved = [_moved(analysis, places, pivot, others, slopes[:, k]) for k, pivot in enumerate(pivots)]
    found = []
    for other, slope in zip(others, slopes, strict=True):
        formula, amount, own, near = _combination(names, value, moved, int(other), pivots, slope)
        gradient = np.zeros(len(used))
        gradient[list(members)] = own
        found.append(Determined(formula, amount, float(np.sqrt(np.maximum(gradient @ matrix @ gradient, 0.0))), near))
    return Together(tuple(names), tuple(found))


def _moved(analysis: Analysis, places: Index, pivot: int, others: Index, slopes: Array) -> Array:
    """The members' values where the pivot is moved and the others follow until the prediction is as before."""
    fit, sigma = analysis.fit, analysis.noise.sigma[:, None]
    theta, free = fit.theta.copy(), places[others]
    step = WAY * (abs(theta[places[pivot]]) or 1.0)
    theta[places[pivot]] += step
    theta[free] += step * slopes
    wanted = fit.bound.predict(fit.theta)
    for _ in range(FOLLOWED if len(free) else 0):
        prediction, derivatives = fit.bound.jacobian(theta)
        gap = ((wanted - prediction) / sigma).reshape(-1)
        columns = (derivatives[..., free] / sigma[..., None]).reshape(len(gap), -1)
        if not (np.isfinite(gap).all() and np.isfinite(columns).all()):
            break
        theta[free] += np.linalg.lstsq(columns, gap, rcond=None)[0]
    return theta[places]


def _combination(
    names: Sequence[str], value: Array, moved: Sequence[Array], other: int, pivots: Index, slopes: Array
) -> tuple[str, float, Array, bool]:
    """Formula, value and gradient of what stays of one parameter and the pivots, and whether it does near by only."""
    shares = np.zeros(len(value))
    shares[other] = 1.0
    if (value[[other, *pivots]] != 0.0).all():
        exact = slopes * value[pivots] / value[other]
        powers = np.round(2.0 * exact) / 2.0
        shares[pivots] = -powers
        with np.errstate(all="ignore"):
            amount = float(np.prod(value**shares))
            change = [abs(float(np.prod(one**shares) / np.float64(amount)) - 1.0) for one in moved]
        if np.abs(powers - exact).max() < ROUND and np.max(change) < STAYS:
            with np.errstate(all="ignore"):  # one that is no part of it may be 0
                gradient = np.where(shares != 0.0, amount * shares / value, 0.0)
            return _product(names, shares), amount, gradient, False
    whole = np.round(slopes)
    shares[pivots] = -np.where(np.abs(whole - slopes) < STAYS, whole, slopes)
    off = [abs(float(shares @ (one - value))) > 10.0 * STAYS * abs(one[other] - value[other]) for one in moved]
    return _sum(names, shares), float(shares @ value), shares, any(off)


def _product(names: Sequence[str], powers: Array) -> str:
    """
    >>> _product("abc", np.array([1.0, -1.0, 2.0])), _product("ab", np.array([-0.5, 1.0]))
    ('a*c^2/b', 'b/a^0.5')
    """
    each = [(n if abs(p) == 1.0 else f"{n}^{abs(p):g}", p) for n, p in zip(names, powers, strict=True)]
    above, below = ["*".join(name for name, power in each if sign * power > 0.0) for sign in (1.0, -1.0)]
    return above + (f"/({below})" if "*" in below else f"/{below}" if below else "")


def _sum(names: Sequence[str], shares: Array) -> str:
    """
    >>> _sum("abc", np.array([-2.5, 1.0, 1.0])), _sum("ab", np.array([1.0, -1.0]))
    ('b + c - 2.5*a', 'a - b')
    """
    text = ""
    for place in sorted(np.flatnonzero(shares).tolist(), key=lambda i: (shares[i] != 1.0, i)):
        size = "" if abs(shares[place]) == 1.0 else f"{abs(shares[place]):.4g}*"
        text += f" {'+' if shares[place] > 0 else '-'} {size}{names[place]}"
    return text.removeprefix(" + ")
