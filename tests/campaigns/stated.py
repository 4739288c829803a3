"""A stated noise sd that is wrong by up to a factor of 10: estimates against their sds, and whether compare and
discover say one thing.

Each case is a bench of a geared motor whose model is right: dry and viscous friction over a torque constant, heating of
the viscous part in half of them, two channels in a third, offsets from run to run in a third.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.story import terminal
from terrapin_tools.workbench.story.story import Story
from terrapin_tools.workbench.story.told import told

__all__ = ["TRUTH", "both", "disagreements", "draw", "scores"]

TRUTH = {"tc": 0.046, "b": 0.004, "heating_on_b.a": -0.012, "r": 1.3}


def draw(number: int, seed: int, folder: Path) -> Path:
    """A case in `folder`: 12 runs of 12 rows; the sd is stated 0.1 to 10 times as large as it is."""
    random = np.random.default_rng([seed, number, 0x51])
    warm, two, apart = number % 2 == 0, number % 3 == 0, number % 3 == 1
    factor, sd = 10.0 ** random.uniform(-1.0, 1.0), 0.006
    folder.mkdir(parents=True)
    lines = ["run,w,temp,current,volt"]
    for run in range(12):
        w = random.choice([-1.0, 1.0]) * random.uniform(3.0, 60.0) + random.normal(0.0, 1.0, 12)
        temp = random.uniform(20.0, 70.0) + np.linspace(0.0, random.uniform(0.0, 10.0), 12)
        b = TRUTH["b"] * (1.0 + (TRUTH["heating_on_b.a"] * (temp - 25.0) if warm else 0.0))
        current = (TRUTH["tc"] * np.sign(w) + b * w) / 0.357 + sd * random.normal(0.0, 1.0, 12)
        volt = TRUTH["r"] * 0.5 + 0.05 * w + 0.02 * random.normal(0.0, 1.0, 12)
        if apart:
            current += 1.5 * sd * random.normal()
        each = zip(w, temp, current, volt, strict=True)
        lines += [f"r{run:02d}," + ",".join(f"{v:.8g}" for v in row) for row in each]
    (folder / "bench.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "case.toml").write_text(
        f"""[case]
title = "Bench"
[model]
base = "equation"
effects = {'["heating_on_b"]' if warm else "[]"}
[model.equation]
current = "(tc*sign(w) + b*w)/kt"
{'volt = "r*0.5 + 0.05*w"' if two else ""}
[parameters]
kt = "0.357 N m/A"
[fit]
tc = {{ value = 0.04, min = 0, max = 1, unit = "N m" }}
b = {{ value = 0.003, min = 0, max = 0.1, unit = "N m s/rad" }}
{"r = { value = 1.0, min = 0, max = 10 }" if two else ""}
[data]
files = ["bench.csv"]
run = "run"
[data.columns]
w = {{ column = "w", unit = "rad/s", is = "speed" }}
temp = {{ column = "temp", unit = "degC", is = "temperature" }}
current = {{ column = "current", unit = "A", sigma = {sd * factor:.4g} }}
{f'volt = {{ column = "volt", sigma = {0.02 / factor:.4g} }}' if two else ""}
""",
        encoding="utf-8",
    )
    return folder


def both(folder: Path) -> tuple[Story, Story]:
    """What compare and discover say."""
    case = load_case(folder)
    found = discover(case)
    return told(analyse(case)), told(found.analysis, found)


def scores(story: Story) -> Mapping[str, float]:
    """(estimate - truth) / sd of every parameter."""
    return {key: (v.value - TRUTH[key]) / (v.sd or np.nan) for key, v in story.parameters.items()}


def disagreements(one: Story, other: Story) -> list[str]:
    """What of the words and numbers that both commands have is not the same."""

    def shared(story: Story) -> dict[str, Any]:
        text = terminal.tell(story)
        return {
            "chip": "no alarm" if story.chip == "adequate" else story.chip,  # which is more than compare can say
            "verdict": story.verdict,
            "p_value": story.p_value,
            "noise": story.noise,
            "channels": story.channels,
            "parameters": story.parameters,
            "ladder": story.ladder,
            "next": story.next.text,
            "numbers": text[text.index("Parameters:") :],
        }

    mine, theirs = shared(one), shared(other)
    if one.verdict == "missing" and other.verdict != "adequate":  # which only discover can name
        mine = {name: mine[name] for name in ("p_value", "parameters")}
    return [name for name, value in mine.items() if value != theirs[name]]
