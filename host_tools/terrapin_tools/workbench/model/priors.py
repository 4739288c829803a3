"""What may be wrong with a model, and how probable each is before any row is read: one table for the test of compare
and for the ranking of discover.

What is said here is shared evenly by what there is of a kind: effects, columns, runs. How probable a size, a shape or a
kind of noise is stands with it (usual_sizes.py, constants.py, formulas/vocabulary.py, noise/kinds.py).

The numbers are judgements about rigs, not fits: the campaign `calibration` counts whether the probabilities that come
of them are right as often as they say (docs/rates.md).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

__all__ = ["CURVE", "MISHAP", "SIZE_OF_SET", "alternatives", "of_terms"]

# Number of terms that are missing, from none on; with one missing, a second is a third as likely, a third a quarter of
# that. More than four count as four.
SIZE_OF_SET = (0.2, 0.54, 0.19, 0.045, 0.005)
# What a term is. Six in ten stand in the catalogue, for it has what textbooks have; most others are formulas: in a
# column, or `varying`, a parameter that goes with a column; a constant that is not what is stated; least of all a
# column of the table that is scaled, late or without its sign, for who maps it sees its numbers.
TERM: Mapping[str, float] = {"catalogue": 0.62, "column": 0.22, "varying": 0.06, "constant": 0.07, "fault": 0.03}
# What goes wrong on a rig instead, each about as likely as a formula in one of ten columns; an odd run and a change of
# the set-up twice.
MISHAP: Mapping[str, float] = {
    "run": 0.02, "slope": 0.01, "change": 0.02, "warming": 0.01, "start": 0.01, "lag": 0.01,
}  # fmt: skip
CURVE = 0.05  # a function of a column that neither the catalogue nor the formulas have


def of_terms(present: Collection[str]) -> dict[str, float]:
    """Share of each kind of term where a case has these kinds: catalogue, constant, fault. Formulas can always be made,
    and take what is left.

    >>> round(of_terms(["constant"])["formula"], 2), round(of_terms(["catalogue", "constant", "fault"])["formula"], 2)
    (0.93, 0.28)
    """
    found = {kind: TERM[kind] for kind in ("catalogue", "constant", "fault") if kind in present}
    return {**found, "formula": 1.0 - sum(found.values())}


def alternatives() -> dict[str, float]:
    """What the test holds against "nothing", given that something is missing; a constant and a fault of the table look
    like an effect or a column to it."""
    terms = sum(SIZE_OF_SET[1:])
    found = {kind: terms * TERM[kind] for kind in ("catalogue", "column", "varying")} | dict(MISHAP)
    found["column"] += CURVE
    total = sum(found.values())
    return {kind: share / total for kind, share in found.items()}
