"""What the Simulate tab says of a scenario and of a run: fields that a batch can vary, what its checks are worth, how a
run differs from the scenario as shipped, and what its controller did."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from terrapin_hil.arrays import Array
from terrapin_hil.reading import QUANTITY
from terrapin_hil.robot.plant import TERRAINS, Robot
from terrapin_hil.scenario.scenario import Scenario

__all__ = ["changes_of", "course", "described", "judged", "leaves", "varied_fields"]

_NOT_VARIED = re.compile(r"checks|title|seed|ground|real_time|provokes\b|fault\.|.*\.at$|.*\.request$|.*\.file$")
SPREAD = 0.1  # of a field's value to either side, in the range that is offered
LEVEL = "0 deg:2 deg"  # offered where a slope is 0


def leaves(tables: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Each field of a file by its name as `--vary` and `--set` take it, and its value.

    >>> dict(leaves({"duration": "10 s", "path": [{"slope": 0.1}], "tow": [["0 s", 1]]}))
    {'duration': '10 s', 'path.1.slope': 0.1, 'tow': [['0 s', 1]]}
    """
    for key, value in tables.items():
        here = f"{name}.{key}" if name else key
        if isinstance(value, dict):
            yield from leaves(value, here)
        elif isinstance(value, list) and value and all(isinstance(one, dict) for one in value):
            for number, one in enumerate(value, 1):
                yield from leaves(one, f"{here}.{number}")
        else:
            yield here, value


def described(scenario: Scenario, name: str) -> dict[str, Any]:
    """What the page changes of a scenario, which fields a batch can vary, and what makes its runs fail."""
    tables = tomllib.loads(scenario.source)
    return {
        "name": name,
        "title": scenario.title,
        "duration": scenario.duration,
        "seed": scenario.seed,
        "supply": scenario.supply,
        "soil": tables.get("soil", {}).get("name") if scenario.ground.contact is not None else None,
        "contact": scenario.ground.contact is not None,
        "ground": [
            {"from": segment.start, "slope": segment.slope, "terrain": raw.get("terrain")}
            for segment, raw in zip(scenario.ground.segments, tables["path"], strict=True)
        ],
        "orders": [
            {"at": o.time, "request": o.request, "control": o.control, "setpoint": o.setpoint, "limiter": o.limiter}
            for o in scenario.operator
        ],
        "effects": {active.effect.name: dict(active.values) for active in scenario.effects},
        "faults": [
            {
                "kind": f.kind,
                "channel": f.channel,
                "value": f.value,
                "begin": f.begin,
                "end": f.end if f.end < 1e8 else None,
            }
            for f in scenario.faults
        ],
        "checks": len(scenario.checks),
        "judged": judged(len(scenario.checks)),
        "fields": varied_fields(scenario, tables, list(TERRAINS)),
    }


def varied_fields(scenario: Scenario, tables: Mapping[str, Any], terrains: Sequence[str]) -> list[dict[str, str]]:
    """Fields of a scenario that a batch can vary, each with its value now and a line of `--vary` around it: the supply,
    those in its file, slopes, and the robot's constants. Any other field may be varied as well."""
    own = dict(leaves(tables))
    known = {"supply.voltage": f"{scenario.supply:.6g} V"} | own
    slopes = [f"path.{number}.slope" for number in range(1, len(scenario.ground.segments) + 1)]
    known |= {name: "0 deg" for name in slopes if name not in own}
    highest = {}
    for one in fields(Robot):
        name = f"robot.{one.name}"
        highest[name] = one.metadata.get("high", math.inf)
        known.setdefault(name, f"{getattr(scenario.robot, one.name):.6g} {one.metadata['unit']}".removesuffix(" 1"))
    found = []
    for name, value in known.items():
        values = "" if _NOT_VARIED.match(name) else _around(name, value, terrains, highest.get(name, math.inf))
        if values:
            found.append({"name": name, "value": _shown(value), "example": f"{name}={values}"})
    return found


def _around(name: str, value: Any, terrains: Sequence[str], highest: float) -> str:
    """Values to begin with, as `--vary` reads them; "" where there are none."""
    if isinstance(value, bool):
        return "true,false"
    if value in terrains:
        return f"{value},{next(one for one in terrains if one != value)}"
    match = QUANTITY.fullmatch(str(value)) if isinstance(value, int | float | str) else None
    if match is None:
        return ""
    number, unit = float(match[1]), match[2]
    if number == 0.0:
        return LEVEL if name.endswith(".slope") else ""
    low, high = sorted((number * (1 - SPREAD), number * (1 + SPREAD)))
    return f"{low:.4g} {unit}".strip() + f":{min(high, highest):.4g} {unit}".rstrip()


def _shown(value: Any) -> str:
    """A value as a file has it, in few digits.

    >>> _shown("10.550594670698047 deg"), _shown(True), _shown(0.1)
    ('10.55 deg', 'true', '0.1')
    """
    match = QUANTITY.fullmatch(str(value)) if not isinstance(value, bool) else None
    if match is None:
        return str(value).lower() if isinstance(value, bool) else str(value)
    return f"{float(match[1]):.4g} {match[2]}".strip()


def judged(checks: int) -> str:
    """What makes a run of a scenario fail."""
    if not checks:
        return "This scenario has no checks: a run fails only where it cannot be run to its end."
    one = "its check does not hold. It was" if checks == 1 else f"one of its {checks} checks does not hold. They were"
    return f"A run fails where {one} written for the scenario as shipped: what is changed or varied may well break it."


def changes_of(tables: Mapping[str, Any], shipped: Mapping[str, Any]) -> list[str]:
    """Each field in which a scenario differs from the one as shipped, with both values.

    >>> changes_of({"path": [{"slope": "10.5505 deg"}]}, {"path": [{"slope": "2 deg"}]})
    ['path.1.slope 10.55 deg (shipped 2 deg)']
    """
    new, old = dict(leaves(tables)), dict(leaves(shipped))
    found = [
        f"{name} {_shown(value)} ({f'shipped {_shown(old[name])}' if name in old else 'shipped: not set'})"
        for name, value in new.items()
        if old.get(name) != value
    ]
    return found + [f"without {name}" for name in old if name not in new]


def course(time: Array, states: Array, words: Mapping[int, str], most: int = 8) -> str:
    """What the controller's state was from when on, in words, once it has begun.

    >>> import numpy as np
    >>> course(np.array([0.0, 0.5, 6.2]), np.array([3.0, 4.0, 5.0]), {3: "idle", 4: "run", 5: "stuck"})
    'The controller: idle from 0 s, run from 0.5 s, stuck from 6.2 s.'
    """
    said: list[str] = []
    before = ""
    for second, state in zip(time.tolist(), states.tolist(), strict=True):
        word = words.get(int(state), "") if state == state else ""  # NaN: it has said nothing yet
        if word not in ("", "boot", "self_test", before):
            said.append(f"{word.replace('_', ' ')} from {second:.3g} s")
            before = word
    left = len(said) - most
    shown = said if left <= 0 else [*said[: most - 1], f"and {left} changes more, at last {said[-1]}"]
    return f"The controller: {', '.join(shown)}." if said else ""
