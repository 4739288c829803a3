"""The proposed experiment, run in the simulator: new runs at its settings, from the true model, with the same noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tests.campaigns.designs import ROLES, Design
from tests.campaigns.drawn import Drawn, measure

__all__ = ["after_experiment"]


def after_experiment(drawn: Drawn, experiment: Mapping[str, Any], random: np.random.Generator) -> Drawn:
    """The old runs and the new ones. The settings are gone through until the proposed number of runs is reached; roles
    that `hold` names stay there, what follows from a run (angle, time, temperature) is that of some old run. Every
    fourth new run is held out."""
    made = drawn.design
    settings: Sequence[Mapping[str, float]] = experiment["settings"]
    count = max(int(experiment.get("runs", len(settings))), len(settings))
    pieces: list[dict[str, np.ndarray]] = []  # type: ignore[type-arg]
    columns = dict(made.columns)
    constants = dict(made.constants)
    for number in range(count):
        rows = np.flatnonzero(made.run == int(random.integers(made.runs)))
        piece = {name: values[rows].copy() for name, values in columns.items()}
        fixed = {**experiment.get("hold", {}), **settings[number % len(settings)]}
        for role, value in fixed.items():
            if role == "speed" and made.base == "rolling_steady" and role not in experiment["vary"]:
                continue  # the axle follows the shell
            if role not in piece:
                continue
            if role == "omega":
                ratio = piece["speed"] / piece["omega"] if "speed" in piece else None
                if "acceleration" not in experiment["vary"]:  # a run at one speed
                    piece["acceleration"] = 0.05 * random.standard_normal(len(rows))
                piece["omega"] = value * (1.0 + 0.015 * random.standard_normal(len(rows)))
                if ratio is not None and "speed" not in experiment["vary"]:
                    piece["speed"] = piece["omega"] * ratio
            else:
                piece[role] = np.full(len(rows), float(value))
        pieces.append(piece)
    run = np.concatenate([made.run, *(np.full(len(p["time"]), made.runs + i) for i, p in enumerate(pieces))])
    columns = {name: np.concatenate([v, *(p[name] for p in pieces)]) for name, v in columns.items()}
    mapped = list(made.mapped)
    for role in experiment["vary"]:
        if role not in mapped and role in ROLES:
            mapped.append(role)  # what was a constant is now recorded
            constants.pop(role, None)
    design = Design(made.base, run, columns, mapped, constants, made.options, made.fitted, dict(made.notes))
    units = dict(made.notes["units"])  # type: ignore[call-overload]
    design.notes["units"] = {**{role: ("N", 1.0, 0.0) for role in mapped if role == "load"}, **units}
    held = {made.runs + i for i in range(3, count, 4)}
    new = measure(design, drawn, random)
    measured = {c: np.concatenate([drawn.measured[c], new[1][c][len(made.run) :]]) for c in drawn.channels}
    return replace(drawn, design=design, clean=new[0], measured=measured, test=drawn.test | held)
