"""What the sphere's plant costs beside the cylinder's: `python tests/bench/bench_sphere.py`.

In process, without controller, 20 s of rolling each, one after the other so that both meet the same machine; the ratio
of CPU times, round by round. The bound is 9.
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path

from bench_sim import SCENARIO

from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
from spheres import LAWS, rolling

BOUND, ROUNDS, VOLTAGE, SLOPE = 9.0, 9, 8.0, 0.05  # V; rad, so that the load is not that of a row of the table


def plant(scenario: Scenario) -> float:
    """Time that the plant alone takes [s], the log's memory already in place."""
    simulation = Simulation(scenario)
    simulation.records.fill(0)
    begin = time.process_time()
    simulation.drive(VOLTAGE, scenario.ticks)
    return time.process_time() - begin


def main() -> int:
    """Prints a line a law of the ground; 1 when one costs more than the bound."""
    cylinder = replace(SCENARIO, operator=(Order(0.0, "idle"),))
    worst = 0.0
    for law in LAWS:
        sphere = replace(rolling(law, cylinder.duration, SLOPE).scenario, sensors=cylinder.sensors)
        pairs = [(plant(cylinder), plant(sphere)) for _ in range(ROUNDS)]
        found = statistics.median(second / first for first, second in pairs)
        print(f"the sphere's plant over the cylinder's, {law}: {found:.2f} (bound {BOUND:g})")
        worst = max(worst, found)
    return 0 if worst <= BOUND else 1


if __name__ == "__main__":
    sys.exit(main())
