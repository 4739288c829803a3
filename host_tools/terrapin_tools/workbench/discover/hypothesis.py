"""One answer among those that compete: a set of effects, an expression, an odd run, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

from terrapin_tools.workbench.model.fitting import Fit

__all__ = ["UNSEEN", "Hypothesis"]

# Squared distance of two predictions [noise sd], beyond what parameters take up, that nobody can see; chosen by hand.
UNSEEN = 2.0


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects that may be missing, with its log of evidence times prior.

    `kind` is nothing, catalogue, expression, mixed (catalogued effects and an expression) or run.
    """

    effects: tuple[str, ...]
    kind: str
    log_weight: float
    fit: Fit | None = None
    column: str = ""  # of an expression; of a run: its name
    taxed: float = 0.0  # what the log weight has lost to sizes that are unlikely
