"""A stated noise sd that is wrong by up to a factor of 10: estimates against their sds, and whether compare and
discover say one thing.

Each case is a bench of a geared motor whose model is right: dry and viscous friction over a torque constant, heating of
the viscous part in half of them, two channels in a third, offsets from run to run in a third.

`python -m tests.campaigns.stated 60 [SEED]` prints the rms of (estimate - truth) / sd, beside it that of the estimator
that knows the covariance of the noise: how far off these draws lie, whatever estimates from them.
"""

from __future__ import annotations

import csv
import sys
import tempfile
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

__all__ = ["TRUTH", "best", "both", "disagreements", "draw", "main", "scores"]

SD, APART, VOLT = 0.006, 1.5, 0.02  # of the current [A], of its offsets in that, of the voltage [V]
HELD = ("r04", "r09")
TRUTH = {"tc": 0.046, "b": 0.004, "heating_on_b.a": -0.012, "r": 1.3}


def draw(number: int, seed: int, folder: Path) -> Path:
    """A case in `folder`: 12 runs of 12 rows; the sd is stated 0.1 to 10 times as large as it is."""
    random = np.random.default_rng([seed, number, 0x51])
    warm, two, apart = number % 2 == 0, number % 3 == 0, number % 3 == 1
    factor, sd = 10.0 ** random.uniform(-1.0, 1.0), SD
    folder.mkdir(parents=True)
    lines = ["run,w,temp,current,volt"]
    for run in range(12):
        w = random.choice([-1.0, 1.0]) * random.uniform(3.0, 60.0) + random.normal(0.0, 1.0, 12)
        temp = random.uniform(20.0, 70.0) + np.linspace(0.0, random.uniform(0.0, 10.0), 12)
        b = TRUTH["b"] * (1.0 + (TRUTH["heating_on_b.a"] * (temp - 25.0) if warm else 0.0))
        current = (TRUTH["tc"] * np.sign(w) + b * w) / 0.357 + sd * random.normal(0.0, 1.0, 12)
        volt = TRUTH["r"] * 0.5 + 0.05 * w + VOLT * random.normal(0.0, 1.0, 12)
        if apart:
            current += APART * sd * random.normal()
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
{f'volt = {{ column = "volt", sigma = {VOLT / factor:.4g} }}' if two else ""}
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


def best(number: int, folder: Path) -> Mapping[str, float]:
    """`scores` of generalised least squares with the covariance that the case was drawn with."""
    with (folder / "bench.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["run"] not in HELD]
    w, temp, current, volt = (np.array([float(row[name]) for row in rows]) for name in ("w", "temp", "current", "volt"))
    run = np.array([row["run"] for row in rows])
    warm, two, apart = number % 2 == 0, number % 3 == 0, number % 3 == 1
    kt, change = 0.357, temp - 25.0
    factor = 1.0 + TRUTH["heating_on_b.a"] * change * warm
    left = current - (TRUTH["tc"] * np.sign(w) + TRUTH["b"] * factor * w) / kt
    slopes = {"tc": np.sign(w) / kt, "b": factor * w / kt}
    if warm:
        slopes["heating_on_b.a"] = TRUTH["b"] * change * w / kt
    columns = np.stack(list(slopes.values()), 1)
    covariance = SD**2 * (np.eye(len(rows)) + (apart * APART**2) * (run[:, None] == run[None, :]))
    weighted = np.linalg.solve(covariance, columns).T
    of = np.linalg.inv(weighted @ columns)
    found = dict(zip(slopes, (of @ (weighted @ left)) / np.sqrt(np.diag(of)), strict=True))
    if two:
        found["r"] = float((volt - 0.05 * w - 0.5 * TRUTH["r"]).mean() / (VOLT / np.sqrt(len(rows))))
    return found


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


def main(count: int = 60, seed: int = 1) -> int:
    """Prints a line for each disagreement, and the sums."""
    far: list[tuple[float, float]] = []
    apart = 0
    with tempfile.TemporaryDirectory() as name:
        for number in range(count):
            folder = draw(number, seed, Path(name, str(number)))
            one, other = both(folder)
            if differs := disagreements(one, other):
                apart += 1
                print(f"{number}: compare and discover differ in {', '.join(differs)}", flush=True)
            sound = best(number, folder)
            far += [(z, sound[key]) for key, z in scores(one).items() if key in sound and np.isfinite(z)]
    mine, theirs = np.sqrt(np.mean(np.square(far), axis=0))
    print(f"{count} cases (seed {seed}), {len(far)} estimates: rms of (estimate - truth) / sd {mine:.3f}")
    print(f"with the covariance known {theirs:.3f}; compare and discover differ in {apart}")
    return int(apart > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
