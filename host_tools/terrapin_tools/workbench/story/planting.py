"""How often a hidden effect would be found, for people and as JSON (schema terrapin.plant/1)."""

from __future__ import annotations

from typing import Any

from scipy.special import betaincinv

from terrapin_hil.units import behind
from terrapin_tools.workbench.discover.planted import Planted
from terrapin_tools.workbench.story.sentences import number, percent

__all__ = ["answer", "limits", "tell"]

SCHEMA = "terrapin.plant/1"


def limits(hits: int, count: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % limits of a rate.

    >>> print("{:.3f} {:.3f}".format(*limits(0, 20)))
    0.000 0.168
    """
    low = float(betaincinv(hits, count - hits + 1, 0.025)) if hits else 0.0
    high = float(betaincinv(hits + 1, count - hits, 0.975)) if hits < count else 1.0
    return low, high


def answer(planted: Planted) -> dict[str, Any]:
    """What `terrapin discover --plant` writes with --json."""
    rates = {}
    for what in ("noticed", "named", "tied"):
        hits = getattr(planted, what)
        low, high = limits(hits, planted.draws)
        rates[what] = {"count": hits, "rate": hits / planted.draws, "low": low, "high": high}
    return {
        "schema": SCHEMA,
        "case": planted.case,
        "effect": planted.effect,
        "size": {
            "value": planted.size,
            "unit": planted.unit,
            "in_sd": planted.size_in_sd,
            "beyond_in_sd": planted.beyond_in_sd,
        },
        "draws": planted.draws,
        **rates,
        "others": [{"answer": said, "count": count} for said, count in planted.others],
        "model_fails": planted.fails,
    }


def tell(planted: Planted) -> str:
    """The same in words."""
    size = (
        f"{number(planted.size, 3)}{behind(planted.unit)}, {number(planted.size_in_sd, 2)} noise sd, "
        f"{number(round(planted.beyond_in_sd, 3), 2)} where the model's own parameters follow"
    )
    tables = "table" if planted.draws == 1 else "tables"
    lines = [f"{planted.effect} ({size}) hidden in {planted.draws} {tables} like yours:"]
    for what, words in (("noticed", "noticed"), ("named", "named alone"), ("tied", "named among rivals")):
        hits = getattr(planted, what)
        low, high = (percent(limit) for limit in limits(hits, planted.draws))
        lines.append(f"  {words} in {hits} of {planted.draws} (95 % limits {low} to {high})")
    lines += [f"  in {count} the answer is: {said}" for said, count in planted.others]
    if planted.fails:
        lines.append("The model fails on your table as it is; what it lacks counts as noise here.")
    return "\n".join(lines)
