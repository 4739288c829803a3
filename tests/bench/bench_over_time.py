"""`terrapin discover` on bodies over time at the papers' length, two cores: `python tests/bench/bench_over_time.py`.

    ... [cylinder|car|sphere|FOLDER ...]      these alone, or cases of the user's own
    ... --program PATH cylinder               by another tree's `terrapin`, to compare

A cylinder of 10 runs x 8 s, a car of 6 x 8 s, a sphere of 8 x 10 s, all at 50 Hz, each with a hidden effect that the
simulator's own body has. For each: wall time, its most memory, the longest silence between two lines of progress, and
the answer. Bounds: 60, 90 and 60 s, 1 GB, a line each second.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from terrapin_hil.physics.dynamic import simulate
from terrapin_hil.physics.vehicle import profile_torque

BOUNDS = {"cylinder": 60.0, "car": 90.0, "sphere": 60.0}  # s
MEMORY, SILENCE = 1.0, 1.5  # GB; s: a line each second, and half of one for the machine
WHEELS = {f"omega_{wheel}": ("rad/s", 0.1) for wheel in ("fl", "fr", "rl", "rr")}
SOIL = {"n": 0.71, "cohesion": 1146.8, "shear_modulus": 0.036}
FITTED = {
    "cylinder": "f_o = { value = 0.05, min = 0, max = 0.5 }\ncoulomb = { value = 0.01, min = 0, max = 0.1 }",
    "sphere": "f_o = { value = 0.01, min = 0, max = 0.2 }\nviscous = { value = 0.5, min = 0, max = 2 }",
    "car": "k_s = { value = 4e5, min = 2e5, max = 8e5 }\nfriction_angle = { value = 0.57, min = 0.44, max = 0.7 }",
}


def made(kind: str, folder: Path) -> Path:
    """A case in a folder."""
    random, lines, body, noise = np.random.default_rng(37), list[str](), "", dict[str, tuple[str, float]]()
    for run in range({"cylinder": 10, "car": 6, "sphere": 8}[kind]):
        clock = np.arange(0.0, 10.0 if kind == "sphere" else 8.0, 0.02)
        if kind == "cylinder":
            body, drive = "cmr", ("voltage", "V")
            noise = {"omega": ("rad/s", 0.03), "current": ("A", 0.004), "swing_angle": ("rad", 0.004)}
            known, effects = {"f_o": 0.09}, {"speed_squared": {"f_s": 1.5e-3}}
            values = np.interp(
                clock, [0.0, 0.5, 3.0, 3.5, 6.0, 6.5, 8.0], [0.0, *np.repeat(random.uniform(3, 9, 3), 2)]
            )
        elif kind == "sphere":
            body, drive = "pendulum_sphere", ("joint_rate", "rad/s")
            noise = {"torque": ("N m", 0.01), "rolling_angle": ("rad", 0.003)}
            known, effects = {"f_o": 0.02, "viscous": 0.3}, {"speed_squared": {"f_s": 0.01}}
            top, rise = random.uniform(0.8, 2.6), random.uniform(1.5, 3.5)
            values = np.interp(clock, [0.0, rise, 7.5, 10.0], [0.0, top, top, random.uniform(0.2, 1.0) * top])
        else:
            body, drive, noise = "vehicle", ("drive_torque", "N m"), dict(WHEELS)
            known, effects = {**SOIL, "k_s": 3.6e5, "friction_angle": 0.55}, {"multipass": {"kappa": 0.3}}
            values = (0.85 + 0.05 * run) * profile_torque(run % 3)[::2][: len(clock)]
        channels = simulate(body, known, {"time": clock, drive[0]: values}, effects).channels
        seen = [channels[name] + sd * random.standard_normal(len(clock)) for name, (_, sd) in noise.items()]
        rows = zip(clock, values, *seen, strict=True)
        lines += [",".join([f"r{run}", *(f"{v:.7g}" for v in row)]) for row in rows]
    columns = [("time", "s"), drive, *((name, unit) for name, (unit, _) in noise.items())]
    (folder / "runs.csv").write_text(",".join(["run", *(n for n, _ in columns)]) + "\n" + "\n".join(lines) + "\n")
    text = f'[case]\ntitle = "{kind}"\n[model]\nbase = "{body}"\n'
    text += "[parameters]\n" + "".join(f"{n} = {v}\n" for n, v in SOIL.items()) if kind == "car" else ""
    text += f'[fit]\n{FITTED[kind]}\n[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\n'
    for name, unit in columns:
        sigma = f", sigma = {noise[name][1]}" if name in noise else ""
        text += f'{name} = {{ column = "{name}", unit = "{unit}"{sigma} }}\n'
    (folder / "case.toml").write_text(text)
    return folder


def row(name: str, folder: Path, program: str, longest: float) -> bool:
    """One case: prints its row, and whether it is within its bounds."""
    answer = folder / "answer.json"
    command = [program, "discover", str(folder), "--json", str(answer)]
    begin = time.monotonic()
    run = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "TERRAPIN_PROGRESS": "lines"},
        text=True,
        start_new_session=True,
    )
    assert run.stderr is not None
    end = threading.Timer(longest, run.terminate)
    end.start()
    last, silence = time.monotonic(), 0.0
    for _ in run.stderr:
        now = time.monotonic()
        silence, last = max(silence, now - last), now
    _, status, used = os.wait4(run.pid, 0)
    end.cancel()
    seconds, memory = time.monotonic() - begin, used.ru_maxrss / 1e6
    if status != 0:
        print(f"{name}: no answer, at least {seconds:.0f} s", flush=True)
        return False
    said = json.loads(answer.read_text())
    told = said["rivals"] or said["missing"]
    bound = BOUNDS.get(name, max(BOUNDS.values()))
    met = seconds <= bound and memory <= MEMORY and silence <= SILENCE
    print(
        f"{name}: {seconds:.1f} s (bound {bound:g}), {memory:.2f} GB, silent {silence:.1f} s at most, "
        f"{used.ru_utime + used.ru_stime:.0f} s of processor; {said['verdict']} {told}; {'met' if met else 'NOT met'}",
        flush=True,
    )
    return met


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=list(BOUNDS), help="cylinder, car, sphere, or folders")
    parser.add_argument("--program", default="terrapin", help="command that discovers")
    parser.add_argument("--longest", type=float, default=400.0, help="s after which a command is ended")
    given = parser.parse_args()
    met = True
    for name in given.cases:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            if name in BOUNDS:
                made(name, folder)
            else:
                for file in Path(name).iterdir():
                    (folder / file.name).write_bytes(file.read_bytes())
            met &= row(name, folder, given.program, given.longest)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
