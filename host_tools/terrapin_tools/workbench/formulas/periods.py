"""A wave along an angle or a position, whose period nobody told: teeth, poles, a belt's splice.

A shape's scale is looked at from a few starts, and a wave is seen from none of them but its own. So the period of the
largest wave in what the model leaves is looked for first (Lomb and Scargle), and pays for all that it was chosen from.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases import free_name
from terrapin_tools.workbench.formulas.vocabulary import SHAPE_COST, Scale, Term

__all__ = ["waves"]

TURNS, LENGTHS = ("rad", "deg", "degree", "turn", "rev"), ("m", "mm", "cm", "um", "in")  # what may have a period
FEWEST = 2.0  # waves over the range of a column: less is a bend, which other shapes are
OF_ROWS = 0.25  # waves a distinct value of the column at most, so that each has four
ROWS = 4000  # that the period is looked for on, evenly through the table, for time
MOST = 1000.0  # waves over the range at most, for time
STEPS = 4  # frequencies looked at between two that are independent


def waves(name: str, values: Array, unit: str, left: Array, taken: Collection[str] = ()) -> list[Term]:
    """The largest wave along a column: none for a column that is no angle and no position, or has too few values.

    Parameters
    ----------
    values : (rows,), of the column in `unit`.
    left : (channels, rows), what the model leaves, in noise sd.
    taken : names that its parameters must not have.
    """
    known, span = np.unique(values), float(np.ptp(values))
    most = min(OF_ROWS * len(known), MOST)
    if unit not in (*TURNS, *LENGTHS) or most <= FEWEST:
        return []
    from scipy.signal import lombscargle  # takes a second, which what has no such column need not wait

    some = slice(None, None, -(-values.size // ROWS))
    place, rest = values[some] - values.min(), left[:, some]
    rate = 2.0 * np.pi / span * np.arange(FEWEST, most, 1.0 / STEPS)  # rad per unit of the column
    power = sum(lombscargle(place, one - one.mean(), rate, floating_mean=True) for one in rest)
    best = float(rate[int(np.argmax(power))])
    channel = rest[int(np.argmax([lombscargle(place, one - one.mean(), [best], floating_mean=True) for one in rest]))]
    columns = np.column_stack([np.sin(best * values[some]), np.cos(best * values[some]), np.ones(place.size)])
    sine, cosine, _ = np.linalg.lstsq(columns, channel, rcond=None)[0]
    start = float(np.arctan(cosine / sine)) if sine else 0.5 * np.pi
    n, p, phase = (free_name(one, {*taken, name}) for one in ("n", "p", "phase"))
    wide = 2.0 * np.pi / span  # between two independent rates
    shift = Scale(start, start - 0.5 * np.pi, start + 0.5 * np.pi, "rad", (start,))
    if unit == "rad":
        scales = {n: Scale(best, best - wide, best + wide, "1", (best,)), phase: shift}
        text = f"sin({n}*{name} + {phase})"
    else:
        period = 2.0 * np.pi / best
        low, high = 2.0 * np.pi / (best + wide), 2.0 * np.pi / (best - wide)
        scales = {p: Scale(period, low, high, unit, (period,)), phase: shift}
        text = f"sin(6.2832*{name}/{p} + {phase})"
    return [Term(text, scales, SHAPE_COST / (most - FEWEST + 1.0))]
