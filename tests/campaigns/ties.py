"""Ties: do the data really not tell apart what an answer leaves open?

A tie is right only if each set that it tells gives what is in the data, all parameters refitted, but for a D2 below
ADMISSIBLE (docs/campaigns.md): else the program shrugged where it could have told. Noise counts as independent from row
to row, which is the stricter count for what changes slowly. Where no set gives the data exactly (a rig of another
simulator), D2 is beyond the best of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.discover.discovery import Discovery
from terrapin_tools.workbench.model.fitting import fit_model
from tests.campaigns.resumed import Record

__all__ = ["ADMISSIBLE", "MOST_TOLD", "distances", "is_tie", "rivals", "told"]

ADMISSIBLE = 9.0  # squared, in noise sd
MOST_TOLD = 4  # sets of an answer that still is one, where a campaign bounds them


def told(found: Discovery) -> tuple[tuple[str, ...], ...]:
    """The sets of an answer: all of a tie, the one that is missing, or none."""
    return found.rivals or ((found.missing,) if found.missing else ())


def distances(found: Discovery, inputs: Mapping[str, Array], true: Array, sigma: Array) -> list[float]:
    """D2 of each told set.

    inputs : as Case.inputs gives them, without noise. true : (channels, rows of the case), what is measured, without
    noise. sigma : (channels,), of the noise.
    """
    fits = {h.effects: h.fit for h in found.ranking.hypotheses if h.fit is not None}
    every = np.ones(true.shape[1], dtype=bool)
    starts = [(fits[names].model.bind(inputs, every), fits[names].theta) for names in told(found)]
    return [round(fit_model(bound, true, sigma, [theta]).cost, 1) for bound, theta in starts]


def is_tie(distances: Sequence[float], exact: bool = True) -> bool:
    """Whether the data do not tell apart sets of these D2; one set alone is no tie that could be wrong. `exact`: one of
    the sets that may be told gives the data."""
    least = 0.0 if exact else min(distances, default=0.0)
    return len(distances) < 2 or all(one - least < ADMISSIBLE for one in distances)


def rivals(records: Sequence[Record]) -> float:
    """Sets that are told beside the first, in the mean of the records with an answer that names something."""
    counts = [len(r["distances"]) - 1 for r in records if r.get("distances")]
    return sum(counts) / max(len(counts), 1)
