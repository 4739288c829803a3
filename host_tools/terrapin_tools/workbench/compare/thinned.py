"""Rows that follow each other faster than the misfit changes: of a long recording every n-th row is taken.

A model of white and AR(1) noise is an approximation. In a recording of thousands of rows a run it would decide by what
happens from row to row, where a derived acceleration or a filter has more to say than the physics: on a geared pendulum
at 100 rows a second, products of three columns were 200 nats ahead of dry friction, which lowers the error ten times as
much. Rows about a correlation length apart say what is to be said, and each of them counts.

Of a table of more than ENOUGH rows so many are taken, evenly: with them an effect of a tenth of a noise sd already has
a squared distance of 50 from nothing, and time and memory no longer grow with the table.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, log

import numpy as np

from terrapin_hil.arrays import Index
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["every", "step_of", "step_of_long"]

ALIKE = 0.3  # correlation of neighbours down to which rows are left out; chosen by hand
LEFT = 60  # rows a run that stay, in the mean; chosen by hand
ENOUGH = 5_000  # rows that are looked at; chosen by hand, for time


def step_of(case: Case, node: Node) -> int:
    """Every how many rows are looked at; 1: each. Models that are integrated over time see all rows.

    >>> from types import SimpleNamespace as Case
    >>> rows, base = np.ones(6000, dtype=bool), Case(whole_runs=False)
    >>> case = Case(train=rows, test=~rows, run=np.repeat(np.arange(6), 1000), base=base)
    >>> step_of(case, Node(1.0, 0.8, 0.0, 0.0, 1.0)), step_of(case, Node(0.0, 0.0, 0.0, 0.0, 1.0))
    (6, 1)
    >>> step_of(case, Node(0.5, 0.6, 0.0, 0.0, 1.0))  # alike by 0.3 after one row, to the last digit
    1
    """
    rows = case.train | case.test
    length = int(rows.sum()) / len(np.unique(case.run[rows]))
    if case.base.whole_runs or length < 2 * LEFT or node.share <= ALIKE or node.rho <= 0.0:
        return 1
    wanted = ceil(log(ALIKE / node.share) / log(node.rho) - 1e-9)
    return int(max(1, min(wanted, length // LEFT)))


def step_of_long(case: Case) -> int:
    """Every how many rows of a long table are looked at, before anything is known of its noise."""
    return 1 if case.base.whole_runs else max(1, int((case.train | case.test).sum()) // ENOUGH)


def every(case: Case, step: int) -> Case:
    """The case with every `step`-th row of each run to train on and to hold out."""
    kept = _place(case.run) % step == 0
    return replace(case, train=case.train & kept, test=case.test & kept)


def _place(run: Index) -> Index:
    """Place of each row within its run."""
    order = np.argsort(run, kind="stable")
    first = np.flatnonzero(np.diff(run[order], prepend=-1))
    place = np.empty(len(run), dtype=np.int64)
    place[order] = np.arange(len(run)) - np.repeat(first, np.diff(np.append(first, len(run))))
    return place
