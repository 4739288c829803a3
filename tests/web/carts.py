"""A cart on a track: time, force and position of each run, with a drag that grows as the square of the speed."""

from __future__ import annotations

from math import sin
from random import Random

__all__ = ["ORDER", "cart"]

STEP, PARTS = 0.03, 10  # between rows, in s; of which the motion is made

# The body that makes a case of it, without the drag.
ORDER = {
    "base": "ode",
    "run": "run",
    "columns": {
        "time": {"column": "t [s]", "unit": "s"},
        "force": {"column": "force [N]", "unit": "N"},
        "position": {"column": "position [mm]", "unit": "mm", "sigma": 2.0},
    },
    "states": {"x": {"unit": "m"}, "v": {"initial": 0, "unit": "m/s"}},
    "derivative": {"x": "v", "v": "(force - d*v)/m"},
    "measured": {"position": "x"},
    "parameters": {"m": "1.3 kg"},
    "fit": {"d": {"value": 1.0, "min": 0.0, "max": 10.0, "unit": "N s/m"}},
}


def cart(runs: int = 6, rows: int = 100) -> bytes:
    """The table."""
    random = Random(3)
    lines = ["run,t [s],force [N],position [mm]"]
    for run in range(runs):
        x = v = 0.0
        for row in range(rows):
            force = 3.0 + 4.0 * sin((1.5 + 0.4 * run) * row * STEP)
            lines.append(f"r{run},{row * STEP:.2f},{force:.5f},{1e3 * x + random.gauss(0.0, 2.0):.4f}")
            for part in range(PARTS):
                force = 3.0 + 4.0 * sin((1.5 + 0.4 * run) * (row + part / PARTS) * STEP)
                v += STEP / PARTS * (force - 0.4 * v - 1.2 * v * abs(v)) / 1.3
                x += STEP / PARTS * v
    return ("\n".join(lines) + "\n").encode()
