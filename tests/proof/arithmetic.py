"""The quotients of firmware/core/integer.c as exact integers, proved by z3 for all arguments.

The steps are those of models.py, which tests/python/test_proof.py holds against the C at many points.
A product of two unknowns is one unknown here, with the bounds that follow from its factors': the proofs are linear, and
take no time.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import z3

from tests.proof.models import HALF, WORD

__all__ = ["planted", "shown"]


def _digit(corrections: int = 2, most_first: int = HALF + 1) -> tuple[list[z3.BoolRef], list[z3.BoolRef]]:
    """After any number of corrections at which the loop ends: the rest is in 0..d-1, so the digit is the quotient's."""
    high, low, rest, following, q, r, product = z3.Ints("high low rest next q r product")
    d = high * HALF + low
    given = [
        high >= HALF // 2, high < HALF, low >= 0, low < HALF, rest >= 0, following >= 0, following < HALF,
        q >= 0, r >= 0, r < high,  # rest = q high + r, as the division gives it
        q <= most_first,  # rest < d, so q high < high 2^16 + low, and low < 2 high
        product >= 0, product <= q * (HALF - 1),  # q low
    ]  # fmt: skip

    def after(k: int) -> tuple[z3.ArithRef, z3.ArithRef, z3.ArithRef]:
        return q - k, r + k * high, product - k * low

    def goes_on(k: int) -> z3.BoolRef:
        _, r_k, product_k = after(k)
        return z3.And(r_k < HALF, product_k > r_k * HALF + following)

    claims = []
    for k in range(corrections + 1):
        _, r_k, product_k = after(k)
        left = r_k * HALF + following - product_k  # = rest 2^16 + next - q_k d
        ends = z3.And(*(goes_on(j) for j in range(k)), z3.Not(goes_on(k)))
        # A factor bounds its product: (q - k) low is at most (q - k)(2^16 - 1).
        bound = product_k <= (q - k) * (HALF - 1)
        claims.append(z3.Implies(z3.And(ends, bound, q >= k), z3.And(left >= 0, left < d)))
    claims.append(z3.Not(z3.And(*(goes_on(k) for k in range(corrections + 1)))))  # it ends by then
    return given, claims


def _first_estimate() -> tuple[list[z3.BoolRef], list[z3.BoolRef]]:
    """q = rest / high is at most 2^16 + 1, as rest < high 2^16 + low and low < 2^16 <= 2 high."""
    high, low, over = z3.Ints("high low over")  # q = 2^16 + over
    product = z3.Int("product")  # over high
    given = [high >= HALF // 2, high < HALF, low >= 0, low < HALF, over >= 2, product >= 2 * high]
    return given, [high * HALF + product >= high * HALF + low]  # then q high is no less than d, which is above rest


def _ratio(
    half_of: Callable[[z3.ArithRef], z3.ArithRef] = lambda d: d / 2,
) -> tuple[list[z3.BoolRef], list[z3.BoolRef]]:
    """q = (|v| + d/2) / d is no farther than half from |v| / d, and halves go up."""
    v, d, left, product = z3.Ints("v d left product")  # |v| + d/2 = product + left, product = q d
    given = [v >= 0, d > 0, left >= 0, left < d, v + half_of(d) == product + left]
    return given, [2 * (product - v) <= d, 2 * (v - product) < d]


def _long_division() -> tuple[list[z3.BoolRef], list[z3.BoolRef]]:
    """The words of a quotient put together: n = (high d + rest) 2^32 + low, and rest 2^32 + low = Q d + R."""
    n, low, d, rest, high_d, q_d, left = z3.Ints("n low d rest high_d q_d left")
    given = [
        d > 0, low >= 0, low < WORD, rest >= 0, rest < d, n == (high_d + rest) * WORD + low,
        rest * WORD + low == q_d + left, left >= 0, left < d,
    ]  # fmt: skip
    whole = high_d * WORD + q_d  # (high 2^32 + Q) d
    return given, [n - whole >= 0, n - whole < d]


def _two_digits() -> tuple[list[z3.BoolRef], list[z3.BoolRef]]:
    """Two digits of 16 bits are one quotient of 32: each leaves what is below d."""
    n, a, b, d, first_d, second_d, rest, left = z3.Ints("n a b d first_d second_d rest left")
    given = [
        d > 0, n >= 0, n < d, rest >= 0, rest < d, left >= 0, left < d,
        n * HALF + a == first_d + rest, rest * HALF + b == second_d + left,
    ]  # fmt: skip
    whole = first_d * HALF + second_d
    return given, [n * WORD + a * HALF + b - whole == left]


PROOFS: dict[str, Callable[[], tuple[list[z3.BoolRef], list[z3.BoolRef]]]] = {
    "integer_ratio rounds to the nearest, halves away from zero": _ratio,
    "digit: its first estimate is at most 2^16 + 1": _first_estimate,
    "digit: at most two corrections, then the exact rest": _digit,
    "quotient: two digits are the quotient": _two_digits,
    "integer_divide, integer_scale: the words put together are the quotient": _long_division,
}
PLANTED = {
    "one correction is enough": lambda: _digit(corrections=1),
    "the first estimate may be 2^16 + 3": lambda: _digit(most_first=HALF + 3),
    "a half that is one too large": lambda: _ratio(lambda d: d / 2 + 1),
}


def _holds(pair: tuple[list[z3.BoolRef], list[z3.BoolRef]]) -> bool:
    given, claims = pair
    possible = z3.Solver()
    possible.set("timeout", 60_000)
    possible.add(*given)
    if possible.check() != z3.sat:  # what assumes the impossible proves anything
        return False
    for claim in claims:
        solver = z3.Solver()
        solver.set("timeout", 60_000)
        solver.add(*given, z3.Not(claim))
        if solver.check() != z3.unsat:
            return False
    return True


def shown() -> bool:
    """Proves all of PROOFS; says which."""
    good = True
    for name, made in PROOFS.items():
        begin = time.monotonic()
        holds = _holds(made())
        good &= holds
        print(f"arithmetic: {'shown' if holds else 'NOT SHOWN'}: {name}, {time.monotonic() - begin:.1f} s", flush=True)
    return good


def planted() -> bool:
    """Whether each of PLANTED, which are false, is found to be so."""
    good = True
    for name, made in PLANTED.items():
        holds = _holds(made())
        good &= not holds
        print(f"arithmetic: {'NOT SEEN' if holds else 'alarm'}: {name}", flush=True)
    return good
