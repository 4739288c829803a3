"""Bounds on the commands themselves: how long they take, and that the same seed gives the same bytes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from tests.campaigns.drawn import CATALOGUE, draw, write
from tests.campaigns.pools import make
from tests.campaigns.table import Line

__all__ = ["LINES"]

ROUNDS = 3
# The user's own effects beside the catalogue's, twenty in all: target, formula, unit of k
ROLLING = (
    ("resistance", "k*omega**3", "N m s^3/rad^3"),
    ("resistance", "k*omega**4*sign(omega)", "N m s^4/rad^4"),
    ("resistance", "k*sqrt(abs(omega))*sign(omega)", "N m s^0.5/rad^0.5"),
    ("resistance", "k*load*omega", "m s/rad"),
    ("resistance", "k*load**2*sign(omega)", "m/N"),
    ("resistance", "k*slope*abs(omega)", "N m s/rad^2"),
    ("resistance", "k*moisture*load*sign(omega)", "m"),
    ("resistance", "k*moisture*omega", "N m s/rad"),
    ("resistance", "k*acceleration*abs(omega)", "N m s^3/rad^2"),
)


def terrapin(*arguments: object, **environment: str) -> str:
    """Standard output of the command in a process of its own."""
    command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"terrapin {' '.join(map(str, arguments))}: {done.stderr.strip()}")
    return done.stdout


CONTACT = (
    ("traction", "k*load*slip", "1"),
    ("traction", "k*load*slip**2", "1"),
    ("traction", "k*load", "1"),
    ("traction", "k*load*moisture", "1"),
    ("traction", "k*speed", "N s/m"),
    ("traction", "k*speed*load", "s/m"),
    ("torque", "k*load*slip", "m"),
    ("torque", "k*load*slip**2", "m"),
    ("torque", "k*load*moisture", "m"),
    ("torque", "k*speed", "N s"),
    ("torque", "k*speed**2", "N s^2/m"),
)
Own = Sequence[tuple[str, str, str]]


def twenty(folder: Path, seed: int, base: str, hidden: str, own: Own) -> Path:
    """30 runs with a hidden effect and a library of 20, all of which can be candidates."""
    needs = {role for one in CATALOGUE[base].values() for role in one.needs} | {"moisture"}
    for attempt in range(200):
        drawn = draw(base, 30, 0.5, 1.0, np.random.default_rng([seed, 99, attempt]), [hidden])
        if needs <= set(drawn.design.mapped) and not drawn.design.notes["constant_load"]:
            break
    text = "".join(
        f'[effect.own_{i}]\ntarget = "{target}"\nexpression = "{formula}"\n'
        f'k = {{ value = 0.0, min = -9.0, max = 9.0, unit = "{unit}" }}\n'
        for i, (target, formula, unit) in enumerate(own)
    )
    return write(drawn, folder, text)


def timed(seed: int) -> list[Line]:
    """Best wall time of up to three, start of the program included: other work on the machine is not the program's."""
    return [
        *_timed(seed, "rolling_steady", "speed_squared", ROLLING, 15.0),
        *_timed(seed, "sphere_contact", "slip_sinkage", CONTACT, 60.0),
    ]


def _timed(seed: int, base: str, hidden: str, own: Own, longest: float) -> list[Line]:
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        case = twenty(Path(folder) / "case", seed, base, hidden, own)
        for name, command, bound in (("first answer", "compare", 5.0), ("everything", "discover", longest)):
            took, used = [], []
            for _ in range(ROUNDS):
                begin, before = time.perf_counter(), os.times()
                output = terrapin(command, case, "--json", "-", "--jobs", min(2, os.cpu_count() or 1))
                took.append(time.perf_counter() - begin)
                after = os.times()
                used.append(sum(after[2:4]) - sum(before[2:4]))
                if took[-1] <= bound:
                    break
            effects = len(CATALOGUE[base]) + len(own)
            limits = f"processor {min(used):.1f} s"
            row = f"{base}, 30 runs, {effects} effects: {name} ({command})"
            lines.append(Line(row, f"{min(took):.1f} s", limits, 0, f"<= {bound:g} s", min(took) <= bound))
    listed = {entry["effect"] for entry in json.loads(output)["candidates"]}
    missing = {f"own_{i}" for i in range(len(own))} - listed
    if missing:
        raise RuntimeError(
            f"{', '.join(sorted(missing))}: not among the candidates, so the time is not that of 20 effects"
        )
    return lines


def same(seed: int) -> list[Line]:
    """Each command twice: other hash seed, other --jobs."""
    equal = []
    for number, pool in enumerate(("single12", "pair30", "tied", "removed", "mixed", "mixed")):
        with tempfile.TemporaryDirectory() as folder:
            case = write(make(pool, seed, number)[1], Path(folder) / "case")
            texts = []
            for jobs, hashed in ((1, "1"), (2, "2")):
                text = terrapin("discover", case, "--json", "-", "--seed", 3, "--jobs", jobs, PYTHONHASHSEED=hashed)
                texts.append("\n".join(line for line in text.splitlines() if '"seconds"' not in line))
            equal.append(texts[0] == texts[1])
    share = f"{sum(equal)} of {len(equal)}"
    return [Line("same seed, same bytes", share, "", 0, "all", all(equal))]


LINES: Mapping[str, Callable[[int], list[Line]]] = {"time": timed, "same": same}
