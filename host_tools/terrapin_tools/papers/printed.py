"""The printed numbers (printed.toml): their digits as text, and as numbers."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["half_unit", "numbers", "printed"]


@cache
def printed() -> dict[str, Any]:
    """The whole file."""
    return tomllib.loads((Path(__file__).parent / "printed.toml").read_text(encoding="utf-8"))


def numbers(texts: list[str] | tuple[str, ...]) -> list[float]:
    return [float(text) for text in texts]


def half_unit(text: str) -> float:
    """Half a unit of the last digit.

    >>> half_unit("0.850"), half_unit("535.3"), half_unit("0.28e-3"), half_unit("1150")
    (0.0005, 0.05, 5e-06, 0.5)
    """
    mantissa, _, power = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(f"0.5e{int(power or 0) - decimals}")
