"""The band that a prediction tells for one measurement holds runs that it never saw, whatever noise they have."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import terrapin_tools as terrapin

SEEDS = 4
KINDS: dict[str, dict[str, float]] = {
    "white": {},
    "offsets from run to run": {"offset": 0.3},
    "a factor from run to run": {"gain": 0.05},
    "growing with the reading": {"grow": 1.0},
}


def belt(seed: int, runs: int = 12, offset: float = 0.0, gain: float = 0.0, grow: float = 0.0) -> dict[str, Any]:
    """A conveyor's torque, 0.15 N m of noise a row (at 8 N m, where it grows)."""
    random, rows, parts = np.random.default_rng(seed), 40, []
    for run in range(runs):
        speed, mass = random.uniform(0.2, 2.0, rows), random.uniform(10.0, 120.0, rows)
        torque = 1.5 + 0.04 * mass + 4.0 * speed
        noise = 0.15 * random.normal(size=rows) * (torque / 8.0 if grow else 1.0)
        measured = torque * (1.0 + random.normal(0.0, gain)) + noise + random.normal(0.0, offset)
        parts.append((np.full(rows, run), speed, mass, measured))
    return dict(zip(("run", "v [m/s]", "mass [kg]", "M [N m]"), np.concatenate(parts, axis=1), strict=True))


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_the_band_holds_new_runs(kind: str, stated: bool) -> None:
    """Of 95 % it held 70 where the stated sd was of a row and runs differ, 81 of the large readings where it grows."""
    apart, read = [], []
    for seed in range(SEEDS):
        case = terrapin.Case.from_table(
            belt(seed, **KINDS[kind]), run="run", noise={"M": 0.15} if stated else {},
            equation={"M": "a + c*mass + b*v"},
            fit={"a": (1, -9, 9, "N m"), "b": (1, -50, 50, "N m s/m"), "c": (0.05, 0, 1, "N m/kg")},
        )  # fmt: skip
        new = belt(100 + seed, 20, **KINDS[kind])
        said = case.predict(new)
        sd = np.hypot(said["M_sd"].to_numpy(), said["M_noise_sd"].to_numpy())
        apart.append(np.abs(new["M [N m]"] - said["M"].to_numpy()) / sd)
        read.append(said["M"].to_numpy())
    inside, reading = np.concatenate(apart) < 1.96, np.concatenate(read)
    for part in (reading > 0.0, reading < 5.0, reading > 10.0):
        assert 0.90 < inside[part].mean() < 0.99
