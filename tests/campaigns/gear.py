"""C_t of the sphere whose gear passes on 0.8 of the torque, known within 2 %: `python -m tests.campaigns.gear [SEEDS]`.

Steady states and parts as in sphere.py; each gear passes on 0.8 (1 + 0.02 N(0, 1)) either way, and the controller
takes 0.8 for it, with the sd of both torque constant and gear. Last comes what an uncompensated controller makes of it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from terrapin_hil.robots import select
from terrapin_hil.scenario.scenario import Scenario
from tests.campaigns.sphere import contact_torque, ordinary_sphere

EFFICIENCY, KNOWN_WITHIN = 0.8, 0.02
COMPENSATED = {
    "gear_efficiency": EFFICIENCY,
    "driven_efficiency": EFFICIENCY,
    "sd_torque_constant": math.hypot(0.004, KNOWN_WITHIN),
}
UNCOMPENSATED = {"gear_efficiency": 1.0, "driven_efficiency": 1.0}


def lossy(seed: int, state: dict[str, str], firmware: Mapping[str, float] = COMPENSATED) -> Scenario:
    """A state of the sphere with such a gear."""
    scenario = ordinary_sphere(seed, state)
    draw = np.random.default_rng([2026, seed])
    efficiency = EFFICIENCY * (1.0 + KNOWN_WITHIN * draw.standard_normal())
    robot = replace(scenario.robot, gear_efficiency=efficiency, driven_ratio=1.0)
    return replace(scenario, robot=robot, firmware={**scenario.firmware, **firmware})


def main() -> int:
    """Prints the bounds; 1 when one is not met."""
    select("sphere")
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    met = True
    for calibrate in (False, True):
        rows, guarded = contact_torque(seeds, calibrate, lossy)
        held = [row for row in rows if "95th" not in row.what and "sd of" not in row.what]  # those are of a known gear
        print(*held, *guarded, sep="\n", flush=True)
        met &= all(row.met for row in held)
    rows, _ = contact_torque(min(seeds, 20), False, lambda seed, state: lossy(seed, state, UNCOMPENSATED))
    print("not compensated:", rows[1], sep="\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
