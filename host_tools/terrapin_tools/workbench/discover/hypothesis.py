"""One answer among those that compete: a set of effects, an expression, a mishap of the test, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

from terrapin_tools.workbench.model.fitting import Fit

__all__ = ["UNSEEN", "Blamed", "Hypothesis"]

# Squared distance of two predictions [noise sd], beyond what parameters take up, that nobody can see; chosen by hand.
UNSEEN = 2.0


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects that may be missing, with its log of evidence times prior.

    `kind` is nothing, catalogue, expression, mixed (catalogued effects and an expression), or that of a mishap.
    """

    effects: tuple[str, ...]
    kind: str
    log_weight: float
    fit: Fit | None = None
    column: str = ""  # of an expression; of a mishap: its run
    taxed: float = 0.0  # what the log weight has lost to sizes that are unlikely


@dataclass(frozen=True)
class Blamed:
    """What went wrong on the rig, not in the model: `run`, those that stand out; `change`, those before and after it;
    `warming`, how the test begins; `start`, how each run begins; `lag`, an instrument that comes late."""

    kind: str
    runs: tuple[str, ...]
