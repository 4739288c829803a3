"""How soon the controller answers a fault that a scenario provokes, held against what controller.toml promises.

Of a latched fault the answer is the bridge off and the state safe in ACTUATE, which comes every tick; of the others the
flag. Flags are seen in STATUS, which comes every 10 ticks: that much later is still in time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.messages import Interface
from terrapin_hil.scenario.checks import Outcome
from terrapin_hil.scenario.faults import Provocation

__all__ = ["reaction"]

STATUS_TICKS = 10


def _first(holds: Mask, begin: int) -> int | None:
    after = np.flatnonzero(holds[begin:])
    return begin + int(after[0]) if len(after) else None


def reaction(provoked: Provocation, description: Interface, held: Callable[[str, str], Array]) -> list[Outcome]:
    """Checks of how the controller answers the fault `provoked`, each with what was found.

    `held(message, signal)` gives one value a tick (ticks,), the last one held.
    """
    fault: dict[str, Any] = next(f for f in description.json["faults"] if f["name"] == provoked.fault)
    name, within, cause = fault["name"], fault["within_ms"], round(provoked.at * 1000)
    mask = np.nan_to_num(held("STATUS", "faults")).astype(np.int64) >> fault["number"] & 1 != 0
    enable, state = held("ACTUATE", "enable"), held("ACTUATE", "state")
    if cause >= len(mask):
        return [
            Outcome(f"{name}: its cause comes at {provoked.at:g} s", False, f"the run ends at {len(mask) / 1000:g} s")
        ]
    outcomes = [
        Outcome(
            f"{name}: not before its cause at {provoked.at:g} s", not mask[:cause].any(), f"{mask[:cause].sum()} ticks"
        )
    ]
    seen = _first(mask, cause)
    limit = within + STATUS_TICKS
    found = "never" if seen is None else f"{seen - cause + 1} ms"
    outcomes.append(
        Outcome(f"{name}: flag within {within} + {STATUS_TICKS} ms", seen is not None and seen - cause < limit, found)
    )
    if fault["latched"]:
        if cause > 0:
            outcomes.append(
                Outcome(f"{name}: bridge on before it", bool(enable[cause - 1] == 1), f"{enable[cause - 1]:g}")
            )
        safe = (enable == 0) & (state == description.enums["state"]["safe"])
        off = _first(safe, cause)
        found = "never" if off is None else f"{off - cause + 1} ms"
        outcomes.append(
            Outcome(f"{name}: bridge off within {within} ms", off is not None and off - cause < within, found)
        )
    return outcomes
