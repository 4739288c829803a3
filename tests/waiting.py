"""Waiting in tests: for a condition, never for a time. The bound is there so that what hangs ends."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

__all__ = ["BOUND", "wait_for"]

T = TypeVar("T")
BOUND = 300.0  # s: more than any step takes on a machine however busy


def wait_for(condition: Callable[[], T], what: str = "the condition") -> T:
    """What the condition gives as soon as that is true of it. AssertionError after BOUND.

    >>> wait_for(lambda: 3)
    3
    """
    end = time.monotonic() + BOUND
    while not (value := condition()):
        assert time.monotonic() < end, f"waited {BOUND:g} s in vain for {what}"
        time.sleep(0.02)
    return value
