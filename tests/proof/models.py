"""The quotients of firmware/core/integer.c in Python's exact integers: what arithmetic.py proves things of."""

from __future__ import annotations

__all__ = ["HALF", "MOST", "WORD", "digit", "divide", "ratio", "scale"]

HALF, WORD = 1 << 16, 1 << 32
MOST = (1 << 30) - 1  # INTEGER_MOST


def digit(rest: int, following: int, d: int, most: int = 2) -> tuple[int, int]:
    """One digit of Knuth's algorithm D as integer.c has it: digit and rest. `most` corrections."""
    q, r = divmod(rest, d >> 16)
    for _ in range(most):
        if r < HALF and q * (d % HALF) > r * HALF + following:
            q, r = q - 1, r + (d >> 16)
    return q, rest * HALF + following - q * d


def ratio(value: int, divisor: int) -> int:
    """integer_ratio: to the nearest, halves away from zero."""
    size = (abs(value) + divisor // 2) // divisor
    return -size if value < 0 else size


def divide(numerator: int, denominator: int) -> int:
    """integer_divide where the denominator is below 2^30: to the nearest, halves away from zero."""
    return ratio(numerator, denominator)


def scale(value: int, factor: int, divisor: int) -> int:
    """integer_scale: value factor / divisor as ratio does it, held within MOST."""
    return max(-MOST, min(MOST, ratio(value * factor, divisor)))
