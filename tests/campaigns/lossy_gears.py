"""Gears that lose torque, hidden from the case: `python -m tests.campaigns.lossy_gears [--cases N] [--tables FOLDER]`.

A cylinder over time is integrated here, from its own Lagrangian: a shell that rolls, a pendulum in it, a motor on a
voltage; its gear passes on a share eta of 0.7 to 0.95 of the motor's torque (1/eta when driven back). With a folder of
tables of other systems that somebody else's code made (rs_none: a sphere that rolls steadily; veh_multipass: a car),
the current or torque of these is what a motor before such a gear would have shown. Right is gear_efficiency, or
constant.torque_constant, told alone or among those that are tied; of the sphere, whose friction stands before the gear,
gear_behind_friction. Wrong is any other effect above 0.9.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import discover

ETA = (0.7, 0.95)
RIGHT = {"gear_efficiency", "gear_behind_friction", "constant.torque_constant"}
SURE = 0.9
RADIUS, ARM, GRAVITY, SHELL, BOB, SHELL_INERTIA, BOB_INERTIA = 0.08, 0.05, 9.81, 0.3, 1.6, 1.92e-3, 4e-4
WHEEL, CONSTANT, OHMS = 0.018, 0.11, 5.0  # radius of the drive [m], torque constant [N m/A]
COULOMB, VISCOUS, SMOOTH = 0.012, 1e-3, 0.05
STEP, ROWS, RUNS = 2e-3, 150, 5  # s, and rows of a run at 50 Hz

CYLINDER = f"""[case]
title = "Cylinder with a gear that loses torque"
[model]
base = "cmr"
[parameters]
arm = {ARM}
shell_mass = {SHELL}
body_mass = {BOB}
drive_mass = 1e-9
body_inertia = {BOB_INERTIA}
drive_inertia = 1e-12
torque_constant = {CONSTANT}
[fit]
f_o = {{ value = 0.05, min = 0.0, max = 0.5 }}
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = {{ column = "t", unit = "s" }}
voltage = {{ column = "U", unit = "V" }}
omega = {{ column = "w", unit = "rad/s", sigma = 0.03 }}
current = {{ column = "i", unit = "A", sigma = 0.004 }}
swing_angle = {{ column = "phi", unit = "rad", sigma = 0.004 }}
"""


def _rates(state: Array, volts: float, f_o: float, eta: float) -> Array:
    """Of the shell's angle, the pendulum's lean forward, and their rates."""
    _, lean, rate, lean_rate = state
    gear, mass, drive = RADIUS / WHEEL, SHELL + BOB, rate + lean_rate
    motor = gear * CONSTANT * (volts - CONSTANT * gear * drive) / OHMS
    way = np.tanh(drive / SMOOTH)
    ahead, back = (eta * motor, motor / eta) if motor > 0.0 else (motor / eta, eta * motor)  # turning on, turning back
    joint = 0.5 * (ahead + back) + 0.5 * (ahead - back) * way - COULOMB * way - VISCOUS * drive
    coupling = BOB * RADIUS * ARM
    inertia = np.array(
        [
            [mass * RADIUS**2 + SHELL_INERTIA, coupling * np.cos(lean)],
            [coupling * np.cos(lean), BOB * ARM**2 + BOB_INERTIA],
        ]
    )
    torque = np.array(
        [
            joint - f_o * RADIUS * mass * GRAVITY * np.tanh(rate / SMOOTH) + coupling * np.sin(lean) * lean_rate**2,
            joint - BOB * GRAVITY * ARM * np.sin(lean),
        ]
    )
    return np.concatenate([state[2:], np.linalg.solve(inertia, torque)])


def cylinder(folder: Path, eta: float, random: np.random.Generator) -> None:
    """A case of the cylinder."""
    f_o, lines = random.uniform(0.06, 0.11), ["run,t,U,w,i,phi"]
    clock = 0.02 * np.arange(ROWS)
    for run in range(RUNS):
        knots = np.concatenate([[0.0], random.uniform(3.0, 9.0, 4) * random.choice([-1.0, 1.0])])
        volts = np.interp(clock, [0.0, 0.4, 1.2, 1.4, clock[-1]], knots)
        state = np.zeros(4)
        for k, t in enumerate(clock):
            drive = state[2] + state[3]
            current = (volts[k] - CONSTANT * RADIUS / WHEEL * drive) / OHMS
            seen = np.array([drive, current, state[1]]) + np.array([0.03, 0.004, 0.004]) * random.standard_normal(3)
            lines.append(f"r{run},{t:.2f},{volts[k]:.6g}," + ",".join(f"{v:.6g}" for v in seen))
            for part in range(10 if k + 1 < ROWS else 0):
                u = [np.interp(t + STEP * (part + share), clock, volts) for share in (0.0, 0.5, 1.0)]
                one = _rates(state, u[0], f_o, eta)
                two = _rates(state + 0.5 * STEP * one, u[1], f_o, eta)
                three = _rates(state + 0.5 * STEP * two, u[1], f_o, eta)
                four = _rates(state + STEP * three, u[2], f_o, eta)
                state = state + STEP / 6.0 * (one + 2.0 * two + 2.0 * three + four)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(CYLINDER)


def sphere(folder: Path, table: Path, eta: float) -> None:
    """rs_none behind a gear: the motor gives 1/eta of what the joint takes; friction is before it, as stated."""
    text = (table / "case.toml").read_text()
    rows = list(csv.reader((table / "runs.csv").open(newline="")))
    omega, amperes = rows[0].index("omega [rad/s]"), rows[0].index("current [A]")
    through, coulomb, viscous = 0.22 / 3.33333e-3 * 36.9e-3, 0.6, 0.05
    for row in rows[1:]:
        w = float(row[omega])
        friction = coulomb * np.sign(w) + viscous * w
        joint = through * float(row[amperes]) - friction
        power = 1.0 / eta if joint * w > 0.0 else eta
        row[amperes] = f"{(joint * power + friction) / through:.7g}"
    _write(folder, rows, text.replace('unit="A",sigma=0.003', f'unit="A",sigma={0.003 / eta:.6f}'))


def car(folder: Path, table: Path, eta: float) -> None:
    """veh_multipass, which its model knows, behind a gear."""
    rows = list(csv.reader((table / "runs.csv").open(newline="")))
    for row in rows[1:]:
        row[2] = f"{float(row[2]) / eta:.7g}"
    text = (table / "case.toml").read_text().replace('base="vehicle"', 'base="vehicle"\neffects=["multipass"]')
    _write(folder, rows, text)


def _write(folder: Path, rows: list[list[str]], text: str) -> None:
    with (folder / "runs.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    (folder / "case.toml").write_text(text)


def judged(folder: Path) -> tuple[bool, list[str], str]:
    """Whether the answer is right, effects above SURE that are not in the truth, and the answer."""
    found = discover(load_case(folder))
    told = found.rivals or ((found.missing,) if found.missing else ())
    named = any(len(one) == 1 and one[0] in RIGHT for one in told)
    wrong = [
        c.effect.name
        for c in found.candidates
        if c.probability > SURE and c.effect.name not in RIGHT and not re.match(r"expression_\d+$", c.effect.name)
    ]
    if found.answer_probability > SURE and found.verdict == "missing":
        wrong += [n for n in found.missing if n not in RIGHT and n not in wrong]
    return named, wrong, f"{found.verdict} {told} {found.answer_probability:.3f}"


def main() -> int:
    """Prints each case and the sums; 1 when the bounds are not met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20, help="in all")
    parser.add_argument("--first", type=int, default=0, help="number of the first, to go on")
    parser.add_argument("--tables", type=Path, help="folder with rs_none and veh_multipass")
    parser.add_argument("--systems", default="cylinder,sphere,car", help="that take turns")
    given = parser.parse_args()
    systems = [s for s in given.systems.split(",") if given.tables is not None or s == "cylinder"]
    right = wrong = 0
    for number in range(given.first, given.first + given.cases):
        random = np.random.default_rng([37, number])
        system, eta = systems[number % len(systems)], random.uniform(*ETA)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            if system == "cylinder":
                cylinder(folder, eta, random)
            else:
                make, table = (sphere, "rs_none") if system == "sphere" else (car, "veh_multipass")
                make(folder, given.tables / table, eta)
            begun = time.monotonic()
            named, sure, text = judged(folder)
        right, wrong = right + named, wrong + bool(sure)
        what = "right" if named else "not named"
        print(f"{number} {system} eta {eta:.3f}: {what}; {text}; {sure} {time.monotonic() - begun:.0f} s", flush=True)
    print(f"named or tied: {right} of {given.cases} (18 of 20 expected); wrong above {SURE}: {wrong} (none expected)")
    return 0 if right >= 0.9 * given.cases and wrong == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
