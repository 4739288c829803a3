"""Logs of the three systems, by motions of our own that share nothing with hil: headings as printed, and as instruments
write them.

.venv/bin/python tests/python/logs_of_papers.py FOLDER    writes the twelve
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

TIMES = np.arange(0.0, 2.5, 0.02)
STEP = 2e-3
Columns = dict[str, np.ndarray]


def _swinging(radius: float, masses: tuple[float, float], inertia: float, arm: float, torque, loss) -> Columns:  # type: ignore[no-untyped-def]
    """A shell that rolls without slip, and a bob on an arm in it: angles of the shell and of the bob's lean forward."""
    shell, bob = masses
    theta, phi, rate, lean = 0.0, 0.0, 0.0, 0.0
    rows = []
    for k in range(round(TIMES[-1] / STEP) + 1):
        t = k * STEP
        drive = torque(t, rate + lean)
        if k % 10 == 0:
            rows.append((theta, phi, rate, lean, drive))
        coupling = bob * radius * arm * np.cos(phi)
        m11, m22 = (shell + bob) * radius**2 + inertia, bob * arm**2 + 1e-3
        q1 = drive - loss(rate) + bob * radius * arm * np.sin(phi) * lean**2
        q2 = drive - bob * 9.81 * arm * np.sin(phi)
        det = m11 * m22 - coupling**2
        rate += STEP * (m22 * q1 - coupling * q2) / det
        lean += STEP * (m11 * q2 - coupling * q1) / det
        theta, phi = theta + STEP * rate, phi + STEP * lean
    return dict(zip(("theta", "phi", "rate", "lean", "torque"), np.array(rows[: len(TIMES)]).T, strict=True))


def cylinder(random: np.random.Generator) -> Columns:
    """Voltage, the drive's rate, its current, and the swing."""
    level, gear = random.uniform(4.0, 8.0), 80.0 / 18.0

    def voltage(t: float) -> float:
        return float(level * min(t / 0.4, 1.0) * (1.0 if t < 1.6 else 0.6))

    def torque(t: float, rate: float) -> float:
        return 0.1 * gear / 5.0 * (voltage(t) - 0.1 * gear * rate) - 0.012 * float(np.tanh(rate / 0.05))

    found = _swinging(0.08, (0.8, 1.1), 2e-3, 0.062, torque, lambda rate: 0.08 * 0.08 * 18.6 * np.tanh(rate / 0.05))
    volts = np.array([voltage(t) for t in TIMES])
    omega = found["rate"] + found["lean"]
    return {"U": volts, "w": omega, "i": (volts - 0.1 * gear * omega) / 5.0, "phi": found["phi"]}


def sphere(random: np.random.Generator) -> Columns:
    """The joint's rate, its torque, how far the sphere rolled, and the swing."""
    speed = random.uniform(2.0, 5.0)

    def torque(t: float, rate: float) -> float:
        return float(np.clip(3.0 * (speed * min(t, 1.0) - rate), -1.5, 1.5)) + 0.3

    found = _swinging(0.22, (6.3, 1.5), 0.14, 0.13, torque, lambda rate: 0.03 * 0.22 * 76.0 * np.tanh(rate / 0.05))
    return {"psi": found["rate"] + found["lean"], "T": found["torque"], "theta": found["theta"], "phi": found["phi"]}


def car(random: np.random.Generator) -> Columns:
    """Torque of a half shaft and the four wheels' rates, of a car on ground that gives way."""
    top = random.uniform(450.0, 700.0)
    speed, wheels = 0.0, np.zeros(2)
    rows = []
    for k in range(round(TIMES[-1] / STEP) + 1):
        torque = top * min(k * STEP / 0.5, 1.0)
        if k % 10 == 0:
            rows.append((torque, *wheels))
        rim = 0.34 * wheels
        slip = (rim - speed) / np.maximum(np.maximum(rim, speed), 0.5)
        force = 4400.0 * 0.45 * np.sign(slip) * (1.0 - np.exp(-np.abs(slip) / 0.12)) - 380.0 * np.tanh(speed / 0.3)
        wheels = np.maximum(wheels + STEP * (np.array([0.9, 1.0]) * torque - 0.34 * force) / 40.0, 0.0)
        speed = max(speed + STEP * 2.0 * force.sum() / 1800.0, 0.0)
    drive, front, rear = np.array(rows[: len(TIMES)]).T
    return {"Td": drive, "FL": front, "FR": front, "RL": rear, "RR": rear}


def forced(random: np.random.Generator) -> Columns:
    """A sphere that is pulled at a slip (drawbar pull and torque rise with slip and load)."""
    slip = np.linspace(0.1, 0.7, 24)
    load = random.uniform(120.0, 180.0) + 10.0 * (np.arange(24) % 3)
    shear = 1.0 - np.exp(-slip / 0.2)
    return {"s": slip, "W": load, "DP": load * (0.45 * shear - 0.05), "T": load * 0.155 * 0.6 * shear}


def rolling(random: np.random.Generator) -> Columns:
    """A sphere that rolls steadily: rate, slip, load, current, drawbar pull."""
    rate = random.uniform(3.0, 6.0) + np.zeros(24)
    slip = np.linspace(0.05, 0.3, 24)
    load = np.full(24, 108.0)
    pull = load * (0.5 * (1.0 - np.exp(-slip / 0.15)) - 0.06)
    return {"w": rate, "s": slip, "Fz": load, "i": (0.22 * (pull + 6.0) + 0.65) / 66.0 / 0.0369, "DP": pull}


LOGS = (  # base, its motion, and the headings: unit factors stand in the heading's unit
    ("cmr", cylinder, {"U": "U [V]", "w": "omega [rad/s]", "i": "i [A]", "phi": "phi [rad]"}),
    ("cmr", cylinder, {"U": "voltage_V", "w": "drive_speed_rpm", "i": "motor_current_mA", "phi": "body_swing_deg"}),
    ("cmr", cylinder, {"U": "Motor voltage (V)", "w": "w_drive (rad/s)", "i": "Current (A)", "phi": "Swing (deg)"}),
    ("pendulum_sphere", sphere, {"psi": "psi' [rad/s]", "T": "T [N m]", "theta": "theta [rad]", "phi": "phi [rad]"}),
    ("pendulum_sphere", sphere, {"psi": "joint_rate_deg_s", "T": "torque_Nm", "theta": "roll_deg", "phi": "swing_deg"}),
    ("pendulum_sphere", sphere, {"psi": "Joint speed (rpm)", "T": "Joint torque (mN m)", "phi": "Swing (rad)"}),
    ("vehicle", car, {"Td": "T_d [N m]", **{n: f"omega_{n} [rad/s]" for n in ("FL", "FR", "RL", "RR")}}),
    ("vehicle", car, {"Td": "half_shaft_torque_Nm", **{n: f"wheel_{n}_rpm" for n in ("FL", "FR", "RL", "RR")}}),
    ("vehicle", car, {"Td": "Drive torque (N m)", "FL": "Front left (rpm)", "RL": "Rear left (rpm)"}),
    ("sphere_contact", forced, {"W": "W (N)", "s": "s", "DP": "DP (N)", "T": "T (N m)"}),
    ("sphere_contact", forced, {"W": "F_z [N]", "s": "slip", "DP": "drawbar_pull_N", "T": "torque_mNm"}),
    ("rolling_sphere", rolling, {"w": "omega [rad/s]", "s": "s", "Fz": "F_z [N]", "i": "I [A]", "DP": "DP [N]"}),
)
FACTORS = {"rpm": 30.0 / np.pi, "deg": 180.0 / np.pi, "deg_s": 180.0 / np.pi, "mA": 1e3, "mN m": 1e3, "mNm": 1e3}


def write(folder: Path, number: int, seed: int = 37) -> tuple[Path, str]:
    """The log of that number as a table, and the base that it is of."""
    base, motion, headings = LOGS[number]
    random = np.random.default_rng([seed, number])
    lines: list[str] = []
    for run in range(3):
        made = motion(random)
        timed = len(next(iter(made.values()))) == len(TIMES)
        columns = {"t [s]": TIMES} if timed else {}
        for key, heading in headings.items():
            scaled = made[key] * _factor(heading)
            columns[heading] = scaled + 0.003 * np.abs(scaled).max() * random.standard_normal(len(scaled))
        if not lines:
            lines.append(",".join(["run", *columns]))
        lines += [",".join([f"r{run}", *(f"{x:.6g}" for x in row)]) for row in zip(*columns.values(), strict=True)]
    path = folder / f"log_{number}.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path, base


def _factor(heading: str) -> float:
    unit = heading.partition("(")[2].rstrip(")") or heading.partition("[")[2].rstrip("]")
    ending = next((u for u in sorted(FACTORS, key=len, reverse=True) if heading.endswith("_" + u)), "")
    return float(FACTORS.get(unit or ending, 1.0))


def main(arguments: Sequence[str]) -> None:
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(len(LOGS)):
        print(*write(folder, number))


if __name__ == "__main__":
    main(sys.argv[1:])
