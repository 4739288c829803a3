"""Verdicts, by rule from the numbers.

    reproduced        every number is within half a unit of its last printed digit (or the tolerance named with it), or
                      a statement holds; either from printed inputs only, or at every setting tried of unprinted ones
    not reproducible  a number or statement does not come out: all its inputs are printed and no reading of the paper
                      that was tried comes within the tolerance, or no setting tried of the unprinted inputs does
    assumed           the number depends on inputs that the paper does not print; what is shown holds for ours

Numbers and statements (conclusions drawn from them) are judged apart: a table whose numbers all come out may carry a
conclusion that does not. Each of the two is as good as its worst check: not reproducible, assumed, reproduced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from terrapin_tools.papers.printed import half_unit

__all__ = [
    "ASSUMED",
    "FAILED",
    "ORDER",
    "REPRODUCED",
    "Check",
    "Outcome",
    "digits",
    "near",
    "ranged",
    "states",
    "worst",
]

Outcome = Literal["reproduced", "assumed", "not reproducible"]
REPRODUCED: Outcome = "reproduced"
ASSUMED: Outcome = "assumed"
FAILED: Outcome = "not reproducible"
ORDER: tuple[Outcome, ...] = (FAILED, ASSUMED, REPRODUCED)


@dataclass(frozen=True)
class Check:
    """One comparison with the print. `near` says how near, `why` what it rests on or what stands in the way."""

    what: str
    printed: str
    found: str
    near: str
    outcome: Outcome
    why: str = ""
    statement: bool = False


def _outcome(good: bool, missing: Sequence[str]) -> Outcome:
    if missing:
        return ASSUMED
    return REPRODUCED if good else FAILED


def _because(why: str, missing: Sequence[str]) -> str:
    parts = [why] if why else []
    if missing:
        parts.append(f"not printed: {', '.join(missing)}")
    return "; ".join(parts)


def digits(
    what: str,
    texts: Sequence[str],
    found: Sequence[float],
    why: str = "",
    missing: Sequence[str] = (),
    extra: Sequence[float] | None = None,
    shown: str = ".6g",
) -> Check:
    """Numbers against printed digits; `extra` widens each tolerance by what rounded inputs explain."""
    room = extra or [0.0] * len(texts)
    shares = [
        abs(value - float(text)) / (half_unit(text) + more)
        for text, value, more in zip(texts, found, room, strict=True)
    ]
    most = max(shares)
    good = most <= 1.0 + 1e-9
    apart = max(abs(v - float(t)) / max(abs(float(t)), half_unit(t)) for t, v in zip(texts, found, strict=True))
    words = "to the last digit" if extra is None else "as near as the rounded inputs allow"
    if not good:
        words = f"off by up to {100 * apart:.0f} %" if apart < 10 else f"off by a factor of up to {1 + apart:.0f}"
    return Check(
        what,
        ", ".join(texts),
        ", ".join(format(value, shown) for value in found),
        words,
        _outcome(good, missing),
        _because(why, missing),
    )


def near(
    what: str,
    text: str,
    found: float,
    tolerance: float,
    unit: str = "",
    why: str = "",
    missing: Sequence[str] = (),
    shown: str = ".4g",
) -> Check:
    """One number within a relative tolerance that is stated with it."""
    share = abs(found / float(text) - 1.0)
    return Check(
        what,
        f"{text} {unit}".strip(),
        f"{found:{shown}} {unit}".strip(),
        f"{100 * share:.2g} % apart (tolerance {100 * tolerance:g} %)",
        _outcome(share <= tolerance, missing),
        _because(why, missing),
    )


def ranged(
    what: str, low: float, high: float, lowest: float, highest: float, tried: str, unit: str = "", shown: str = ".3g"
) -> Check:
    """Printed range low..high against what comes out over all settings tried of unprinted inputs."""
    apart = lowest > high or highest < low
    words = "the ranges overlap"
    if apart:
        factor = lowest / high if lowest > high else low / highest
        words = f"never nearer than a factor of {factor:.2f}"
    return Check(
        what,
        f"{low:{shown}} to {high:{shown}} {unit}".strip() if high > low else f"{low:{shown}} {unit}".strip(),
        f"{lowest:{shown}} to {highest:{shown}} {unit}".strip(),
        words,
        FAILED if apart else ASSUMED,
        f"over {tried}",
    )


def states(
    statement: str, holds: bool | np.bool_ | Sequence[bool], found: str, why: str = "", missing: Sequence[str] = ()
) -> Check:
    """A sentence of the paper. A sequence holds one answer for each setting tried of unprinted inputs."""
    if not isinstance(holds, Sequence):
        return Check(
            statement,
            "stated",
            found,
            "holds" if holds else "does not hold",
            _outcome(bool(holds), missing),
            _because(why, missing),
            True,
        )
    count, total = sum(holds), len(holds)
    outcome = REPRODUCED if count == total else FAILED if count == 0 else ASSUMED
    words = f"holds at {count} of {total} settings of what is not printed"
    return Check(statement, "stated", found, words, outcome, _because(why, missing), True)


def unchecked(what: str, text: str, missing: Sequence[str]) -> Check:
    """A number or curve that nothing can be held against, for want of what is not printed."""
    return Check(what, text, "-", "cannot be checked", ASSUMED, _because("", missing))


def worst(checks: Sequence[Check], statements: bool) -> Outcome | None:
    """The verdict on the numbers or on the statements of a part; None where it has none.

    >>> worst([Check("a", "", "", "", REPRODUCED), Check("b", "", "", "", ASSUMED)], statements=False)
    'assumed'
    """
    return min((check.outcome for check in checks if check.statement == statements), key=ORDER.index, default=None)
