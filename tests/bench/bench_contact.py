"""Microseconds a point of the compiled contact of the sphere, beside plain NumPy. python tests/bench/bench_contact.py

10,000 points, slip 0 to 1, radius 0.1 to 0.3 m, load 1 to 300 N on the dry sand of Li et al., on one core, by CPU time;
median and best of several rounds: on a machine that others use the best is what it can do, the median what it did.
Bounds: 10 us a point for the integrals at given entry angle, 100 us for the equilibrium.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil.physics import sphere
from tests.bench import contact_numpy

POINTS, PLAIN_POINTS, ROUNDS = 10_000, 500, 7
SAND = sphere.Soil(1.945e6, 0.97, 0.0, float(np.radians(42.2)), 0.01778)


def microseconds(work: Callable[[], object], points: int, rounds: int) -> tuple[float, float]:
    """Median and best CPU time a point."""
    spent = []
    for _ in range(rounds):
        begin = time.process_time()
        work()
        spent.append((time.process_time() - begin) / points * 1e6)
    return statistics.median(spent), min(spent)


def main() -> int:
    """Prints a line for each kind of work; 1 when the best round misses a bound."""
    rng = np.random.default_rng(1)
    slip, radius, load = rng.uniform(0, 1, POINTS), rng.uniform(0.1, 0.3, POINTS), 10 ** rng.uniform(0, 2.5, POINTS)
    few = slice(0, PLAIN_POINTS)
    met = True
    for linear, name in ((False, "full stresses"), (True, "linear stresses")):
        theta = sphere.entry_angle(load, slip, radius, SAND, linear)
        works: list[tuple[str, float, Callable[[], object], Callable[[], object] | None]] = [
            (
                "integrals",
                10.0,
                lambda t=theta, f=linear: sphere.forces(t, slip, radius, SAND, f),
                lambda t=theta, f=linear: contact_numpy.forces(t[few], slip[few], radius[few], SAND, f),
            ),
            (
                "equilibrium",
                100.0,
                lambda f=linear: sphere.entry_angle(load, slip, radius, SAND, f),
                lambda f=linear: contact_numpy.entry_angle(load[few], slip[few], radius[few], SAND, f),
            ),
            (
                "integrals and 12 derivatives",
                float("inf"),
                lambda t=theta, f=linear: sphere.slopes(t, slip, radius, SAND, f),
                None,
            ),
        ]
        for what, bound, compiled, plain in works:
            took, best = microseconds(compiled, POINTS, ROUNDS)
            line = f"{name}, {what}: median {took:.2f} us a point, best {best:.2f}"
            if plain is not None:
                slow, _ = microseconds(plain, PLAIN_POINTS, ROUNDS)
                line += f" (bound {bound:.0f}), NumPy {slow:.0f} us, {slow / took:.0f} times as long"
            print(line)
            met &= best <= bound
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
