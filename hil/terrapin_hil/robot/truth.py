"""The names of the simulated robot's true state, in the order of its records."""

from __future__ import annotations

from terrapin_hil.library import ffi

__all__ = ["TRUTH"]


def _truth_names() -> tuple[str, ...]:
    elements: dict[int, str] = ffi().typeof("enum hil_truth").elements
    return tuple(elements[i].removeprefix("HIL_TRUTH_").lower() for i in range(len(elements) - 1))


TRUTH = _truth_names()
