"""How fast the simulator runs: `python tests/bench/bench_sim.py [--json]`.

In process: default ground, real sensors with noise, the controller, the log in memory; times real time on one core, by
CPU time. Over a pty: lockstep with its process, ticks a second. Medians and best of several rounds: on a machine that
others use the best is what it can do, the median what it did. The bounds are 1,000 times and 3,000 ticks a second.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

from terrapin_hil.links import open_link
from terrapin_hil.links.link import Link
from terrapin_hil.robot.plant import TERRAINS, Ground, Segment
from terrapin_hil.robot.sensors import kit
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

SCENARIO = Scenario(
    name="bench",
    duration=20.0,
    ground=Ground((Segment(TERRAINS["hard_floor"]), Segment(TERRAINS["sand"], 5.0))),
    operator=(Order(0.0, "run", "voltage", 8.0),),
    sensors=kit("real"),
)


def seconds(link: Link, scenario: Scenario, clock: Callable[[], float]) -> float:
    """Time that one run takes [s], the log's memory already in place."""
    simulation = Simulation(scenario)
    simulation.records.fill(0)
    link.start({})
    begin = clock()
    link.advance(simulation, scenario.ticks)
    return clock() - begin


def rounds(name: str, scenario: Scenario, count: int, clock: Callable[[], float]) -> list[float]:
    """Ticks a second of `count` runs over a link."""
    with open_link(name) as link:
        return [scenario.ticks / seconds(link, scenario, clock) for _ in range(count)]


def main() -> int:
    """Prints a table, or JSON; 1 when the best round misses a bound."""
    here = [ticks / 1000 for ticks in rounds("inprocess", SCENARIO, 15, time.process_time)]
    there = rounds("pty", replace(SCENARIO, duration=3.0), 5, time.perf_counter)
    rows = {
        "in process, times real time": (here, 1000.0),
        "pty lockstep, ticks a second": (there, 3000.0),
    }
    if "--json" in sys.argv[1:]:
        table = {k: {"median": statistics.median(v), "best": max(v), "bound": b} for k, (v, b) in rows.items()}
        print(json.dumps(table, indent=2))
    else:
        for what, (values, bound) in rows.items():
            print(f"{what}: median {statistics.median(values):.0f}, best {max(values):.0f} (bound {bound:.0f})")
    return 0 if all(max(values) >= bound for values, bound in rows.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
