"""Two channels with unlike noise, of which nothing is missing: how often an alarm is raised.

    python -m tests.campaigns.two_channels --cases 400
    python -m tests.campaigns.two_channels --part 1/4                    a quarter of the cases; parts merge

A motor on a brake in 14 runs, each at a speed and a current of its own; torque and voltage are equations of the user's
own, with superfluous columns beside them. Each channel has another one of the noises of noises.py; in every second case
its sd is not stated. A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.discover.discovery import discover
from tests.campaigns.drawn import write_table
from tests.campaigns.noises import FAMILIES, table
from tests.campaigns.resumed import Record, parser_of, resumed

__all__ = ["drawn", "one"]

KINDS = ("white", "ar1", "offsets", "hum", "growing", "tails")
RUNS = 14
CASE = """[case]
title = "motor on a brake"
[model]
base = "equation"
[model.equation]
torque = "k*i - c*w - d"
voltage = "resistance*i + k_e*w"
[fit]
k = { value = 0.1 }
c = { value = 1e-4 }
d = { value = 0.01 }
resistance = { value = 0.3 }
k_e = { value = 0.1 }
[data]
files = ["rows.csv"]
run = "run"
[data.columns]
w = { column = "w", unit = "rad/s" }
i = { column = "i", unit = "A" }
"""


def drawn(number: int, seed: int) -> tuple[Case, list[str]]:
    """A case and the noises of its channels, torque first."""
    random = np.random.default_rng([seed, number])
    run = np.repeat(np.arange(RUNS), random.integers(10, 31, RUNS))
    rows = len(run)
    speeds = random.permutation(np.linspace(20.0, random.uniform(150.0, 300.0), RUNS))
    columns = {
        "w": speeds[run] * (1.0 + 0.015 * random.standard_normal(rows)),
        "i": random.uniform(0.5, 6.0, RUNS)[run] + 0.1 * random.standard_normal(rows),
        "case_temperature": random.uniform(25.0, 60.0, RUNS)[run] + 0.2 * random.standard_normal(rows),
        "humidity": random.uniform(30.0, 70.0, RUNS)[run] + 0.3 * random.standard_normal(rows),
    }
    w, i = columns["w"], columns["i"]
    true = {"torque": 0.09 * i - 1.2e-4 * w - 0.02, "voltage": 0.35 * i + 0.091 * w}
    kinds = [str(kind) for kind in random.choice(KINDS, len(true), replace=False)]
    text = CASE
    for (name, values), unit, kind in zip(true.items(), ("N m", "V"), kinds, strict=True):
        sigma = float(f"{0.01 * random.uniform(0.5, 2.0) * np.sqrt(np.mean(values**2)):.3g}")
        columns[name] = values + sigma * FAMILIES[kind](run, w, random)[0]
        stated = f", sigma = {sigma}" if number % 2 == 0 else ""
        text += f'{name} = {{ column = "{name}", unit = "{unit}"{stated} }}\n'
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        write_table(place / "rows.csv", [f"r{one:02d}" for one in run], columns)
        (place / "case.toml").write_text(text, encoding="utf-8")
        return load_case(place), kinds


def one(family: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    case, kinds = drawn(number, seed)
    found = discover(case, seed=number)
    return {
        "kinds": kinds,
        "alarm": found.analysis.missing,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "rivals": [list(r) for r in found.rivals],
        "probability": found.answer_probability,
        "right": not found.analysis.missing,
        "noise": found.analysis.noise.node.words(found.analysis.model.channels),
    }


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.two_channels", ("channels",), cases=24).parse_args()
    print(table(resumed(options, str(options.seed), lambda family, number: one(family, number, options.seed))))


if __name__ == "__main__":
    main()
