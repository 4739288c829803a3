"""Errors of instruments as effects of a case: zero points of columns, channels that come late.

A zero point adds a constant to what the formulas of an `equation` read, as a depth that is counted from 5 mm below the
surface. A column in which the formulas are linear needs none: there a zero point is an offset of the channel.

Where equations of the user's own have several channels, each may be late against the others: its logger has a clock of
its own, or its filter takes time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.expression import Expression
from terrapin_hil.physics.signals import row_steps
from terrapin_tools.workbench.bases import free_name

__all__ = ["INSTRUMENTS", "ZERO", "channel_delays", "zero_points"]

ZERO = "zero_of_"  # before the name of the column
LATE = "delay_of_"  # before the name of the channel
INSTRUMENTS = ("inputs", "late")  # transforms of effects that are a matter of clocks
LATEST = 4  # rows by which a channel may be late, for beyond the ends of a stretch its course is a guess
USUAL = 0.03  # of the column's range, that such an error has as a rule; chosen by hand
MOST = 0.5  # of the column's range, of such an error; chosen by hand
STEP = 0.01  # of the range, by which a column is moved to see whether the formulas are linear in it
LINEAR = 1e-6  # of the change, by which it may differ from row to row where they are; rounding is far below


def zero_points(
    formulas: Mapping[str, Expression], columns: Mapping[str, Array], units: Mapping[str, str]
) -> dict[str, Effect]:
    """Effects by name.

    Parameters
    ----------
    formulas : by channel.
    columns : what they may read, by its name in formulas, (rows,) each.
    units : of the columns; "1" where none is stated.
    """
    read = {name for formula in formulas.values() for name in formula.names}
    names = sorted(read - columns.keys())
    # any numbers do for the constants: whether a formula is linear in a column does not hang on them
    values: dict[str, Array | float] = {**columns, **{name: 1.1 + 0.07 * i for i, name in enumerate(names)}}
    found = {}
    for name in sorted(read & columns.keys()):
        span = float(np.ptp(columns[name]))
        moved = {**values, name: columns[name] + STEP * span}
        with np.errstate(all="ignore"):
            changes = [f.evaluate(moved) - f.evaluate(values) for f in formulas.values() if name in f.names]
        if span == 0.0 or all(_constant(change) for change in changes):
            continue
        size, meaning = free_name("d", values), f"to be added to {name}"
        found[ZERO + name] = Effect(
            name=ZERO + name,
            title=f"Zero point of {name}",
            equation=rf"\mathrm{{{name}}} \to \mathrm{{{name}}} + d".replace("_", r"\_"),
            source="Zero error of the column's sensor, or a scale that begins elsewhere",
            bases=("equation",),
            parameters=(Parameter(size, units[name], 0.0, -MOST * span, MOST * span, meaning),),
            needs=((name,),),
            expression=size,
            target=name,
            usual=f"{USUAL * span:.6g}",
            additive=True,
            plant=False,
        )
    return found


def channel_delays(channels: Sequence[str], time: Array, run: Index) -> dict[str, Effect]:
    """Effects by name, one for each channel where there are several: one alone is late as the inputs are early.

    Parameters
    ----------
    time : (rows,), s, rising within each run.
    run : (rows,), numbers.
    """
    steps = row_steps(time, run)
    if len(channels) < 2 or not (steps > 0.0).any():  # a time that stands still is refused elsewhere
        return {}
    most = LATEST * float(np.median(steps[steps > 0.0]))
    meaning = "time by which it comes after the others; below 0, before them"
    return {
        LATE + name: Effect(
            name=LATE + name,
            title=f"Delay of {name}",
            equation=rf"\mathrm{{{name}}}(t) \to \mathrm{{{name}}}(t - \tau)".replace("_", r"\_"),
            source="Another logger's clock, or the time that a filter takes",
            bases=("ode",),
            parameters=(Parameter("delay", "s", 0.0, -most, most, meaning),),
            needs=(),
            target=name,
            transform="late",
            expression="delay",
            plant=False,
        )
        for name in channels
    }


def _constant(change: Array) -> bool:
    return bool(np.ptp(change) <= LINEAR * np.abs(change).max())
