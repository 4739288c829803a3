"""What a fair user might have measured: settings of the runs, columns, units, constants. No effect and no noise yet.

Fixed before any result was looked at:
- rolling_steady: runs of 10 to 30 rows (0.25 to 0.6 s apart), one case in 16 400 rows (0.05 s apart); speeds
  spread over 1 to 8..12 rad/s with 1.5 % scatter, in two cases of five a ramp within the run; both directions in seven
  of ten cases; one to three loads, in one case of seven a constant one that stands in [parameters].
- sphere_contact, wheel_contact: a run is one setting, measured three times; in one case of eight 40 times.
- equation: three models of a user's own, runs like those of rolling_steady.
- Each role that is not needed is mapped in three cases of four; the rest of the columns is there but not mapped.
- A quarter of the runs is held out. Files use units of the workshop (mA, rpm, deg, kN, mm, degF) as often as SI.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

__all__ = ["CHANNELS", "ROLES", "UNITS", "Design", "design"]

Array = npt.NDArray[np.float64]
Random = np.random.Generator

ROLES = (
    *("time", "omega", "acceleration", "angle", "slip", "speed", "load", "slope"),
    *("temperature", "pass", "moisture", "voltage"),
)
CHANNELS = {
    "rolling_steady": ("current",),
    "sphere_contact": ("traction", "torque", "sinkage"),
    "wheel_contact": ("traction", "torque", "sinkage"),
}
UNITS: Mapping[str, tuple[tuple[str, float, float], ...]] = {  # unit, SI = file * factor + offset
    "omega": (("rad/s", 1.0, 0.0), ("rpm", np.pi / 30.0, 0.0), ("deg/s", np.pi / 180.0, 0.0)),
    "angle": (("rad", 1.0, 0.0), ("deg", np.pi / 180.0, 0.0)),
    "slope": (("rad", 1.0, 0.0), ("deg", np.pi / 180.0, 0.0)),
    "load": (("N", 1.0, 0.0), ("kN", 1e3, 0.0)),
    "speed": (("m/s", 1.0, 0.0), ("mm/s", 1e-3, 0.0), ("km/h", 1.0 / 3.6, 0.0)),
    "temperature": (("degC", 1.0, 0.0), ("degF", 5.0 / 9.0, -160.0 / 9.0), ("kelvin", 1.0, -273.15)),
    "time": (("s", 1.0, 0.0), ("ms", 1e-3, 0.0)),
    "acceleration": (("rad/s^2", 1.0, 0.0),),
    "voltage": (("V", 1.0, 0.0),),
    "current": (("A", 1.0, 0.0), ("mA", 1e-3, 0.0)),
    "traction": (("N", 1.0, 0.0), ("kN", 1e3, 0.0)),
    "torque": (("N m", 1.0, 0.0), ("mN m", 1e-3, 0.0)),
    "sinkage": (("m", 1.0, 0.0), ("mm", 1e-3, 0.0)),
}


@dataclass
class Design:
    """Columns in SI (mapped roles by role, the others by their own names), constants, what is fitted."""

    base: str
    run: npt.NDArray[np.int64]
    columns: dict[str, Array]
    mapped: list[str]  # roles
    constants: dict[str, float]  # known, in [parameters]
    options: dict[str, str]
    fitted: dict[str, tuple[float, float, float, float]]  # name -> true value, start, min, max
    notes: dict[str, object] = field(default_factory=dict)

    @property
    def runs(self) -> int:
        return int(self.run.max()) + 1

    def true_constants(self) -> dict[str, float]:
        found = {**self.constants, **{name: entry[0] for name, entry in self.fitted.items()}}
        if self.options.get("stress") == "linear":
            found["stress_linear"] = 1.0
        return found

    def inputs(self) -> dict[str, Array]:
        """What effects of the catalogue may use: mapped roles only."""
        return {name: self.columns[name] for name in self.mapped}


def design(base: str, runs: int, random: Random, needs: set[str], tied: str = "", long: bool = False) -> Design:
    """A design whose `needs` (roles) are mapped and vary; `tied` names a confounding (see below)."""
    made = {"rolling_steady": _rolling, "sphere_contact": _contact, "wheel_contact": _contact}.get(base, _equation)
    return made(base, runs, random, needs, tied, long)


def _rows(runs: int, random: Random, long: bool) -> tuple[npt.NDArray[np.int64], float]:
    counts = np.full(runs, 400) if long else random.integers(10, 31, runs)
    return np.repeat(np.arange(runs), counts), 0.05 if long else random.uniform(0.25, 0.6)


def _each(run: npt.NDArray[np.int64], values: Array) -> Array:
    return np.asarray(np.asarray(values, dtype=float)[run])


def _since(run: npt.NDArray[np.int64], step: Array) -> Array:
    """Cumulative sum within each run."""
    total = np.cumsum(step)
    before = np.concatenate([[0.0], total])[np.flatnonzero(np.diff(run, prepend=-1))]
    return np.asarray(total - before[run])


def _rolling(base: str, runs: int, random: Random, needs: set[str], tied: str, long: bool) -> Design:
    """tied: "speed" (constant load, no slip mapped: quadratic drags are one), "direction" (one direction only), "slope"
    (one slope, one load), "ramp" (acceleration in proportion to speed)."""
    run, pace = _rows(runs, random, long)
    count = len(run)
    time = _since(run, pace * random.uniform(0.8, 1.2, count))
    speeds = random.permutation(np.linspace(1.0, random.uniform(8, 12), runs))
    both = random.uniform() < 0.7
    both = tied == "slope" or (both and tied != "direction")
    sign = random.permutation(np.where(np.arange(runs) % 2 == 0, 1.0, -1.0)) if both else np.ones(runs)
    ramps = random.uniform() < 0.4
    duration = np.array([time[run == i][-1] for i in range(runs)])
    slope_in_time = speeds * random.uniform(-0.3, 0.3, runs) / duration if ramps else np.zeros(runs)
    magnitude = (_each(run, speeds) + _each(run, slope_in_time) * time) * (1 + 0.015 * random.standard_normal(count))
    omega = _each(run, sign) * magnitude
    acceleration = _each(run, sign * slope_in_time) + 0.2 * random.standard_normal(count)
    levels = random.uniform(15, 35) * np.array([1.0, 1.7, 2.4])
    load = _each(run, random.choice(levels[: random.integers(1, 4)], runs))
    if tied == "ramp":
        acceleration = random.uniform(0.02, 0.08) * omega
    if tied == "slope":
        load = np.full(count, load[0])
    tilted = "slope" in needs or random.uniform() < 0.5
    radius = random.uniform(0.065, 0.095)
    columns = {
        "time": time,
        "omega": omega,
        "acceleration": acceleration,
        "angle": _since(run, omega * np.diff(time, prepend=0.0) * (np.diff(run, prepend=-1) == 0)),
        "slope": _each(run, random.normal(0, 0.05, runs) * tilted) + 1e-4 * random.standard_normal(count),
        "temperature": _each(run, random.uniform(22, 46, runs))
        + _each(run, random.uniform(0, 6, runs) / duration) * time,
        "load": load,
        "speed": omega * radius * (1.0 - _each(run, random.uniform(0, 0.25, runs))),
        "moisture": _each(run, random.uniform(0.005, 0.14, runs)) + 1e-3 * random.standard_normal(count),
        "voltage": np.round(0.4 + 0.8 * _each(run, speeds), 1),
        "humidity": _each(run, random.uniform(30, 70, runs)) + 0.3 * random.standard_normal(count),
        "board_temp": 31 + _each(run, random.uniform(0, 6, runs)) + 0.1 * random.standard_normal(count),
        "battery_voltage": 12.5 - 0.07 * run + 0.012 * random.standard_normal(count),
        "gyro_z": 0.02 * random.standard_normal(count),
    }
    if tied == "slope":
        columns["slope"] = np.full(count, random.uniform(0.03, 0.1))
    constants = {
        "radius": radius,
        "drive_radius": random.uniform(0.015, 0.023),
        "torque_constant": random.uniform(0.08, 0.13),
        "coulomb": random.uniform(0.008, 0.016),
        "viscous": random.uniform(0.9e-3, 1.3e-3),
    }
    optional = ("time", "acceleration", "angle", "slope", "temperature", "moisture", "speed", "voltage")
    mapped = ["omega", *(r for r in optional if r in needs or random.uniform() < 0.75)]
    constant_load = tied == "speed" or (not tied and "load" not in needs and random.uniform() < 1.0 / 7.0)
    if tied == "direction" and np.ptp(load) == 0.0:
        columns["load"] = _each(run, random.choice(levels, runs))
    if tied == "speed":
        mapped = [m for m in mapped if m not in ("speed", "voltage")]
        for name in ("speed", "voltage"):
            columns.pop(name)
    if constant_load:
        constants["load"] = float(f"{load[0]:.4g}")
        columns["load"] = np.full(count, constants["load"])
    else:
        mapped.append("load")
    fitted = {"f_o": (random.uniform(0.03, 0.12), 0.05, 0.0, 0.5)}
    return Design(base, run, columns, mapped, constants, {}, fitted, {"constant_load": constant_load, "long": long})


def _contact(base: str, runs: int, random: Random, needs: set[str], tied: str, long: bool) -> Design:
    """tied: "pass" (speed is a power of the number of the pass)."""
    run = np.repeat(np.arange(runs), 40 if long else 3)
    count = len(run)
    sphere = base == "sphere_contact"
    radius = random.uniform(0.15, 0.24)
    width = random.uniform(0.10, 0.20)
    loads = random.uniform(100, 200) * np.array([1.0, 1.5, 2.2])
    number = random.integers(1, 5, runs).astype(float)
    speed = random.choice([0.02, 0.05, 0.1, 0.2, 0.3], runs)
    if tied == "pass":
        number = 1.0 + random.permutation(np.arange(runs) % 8)
        speed = random.uniform(0.04, 0.08) * number ** random.uniform(0.7, 1.0)
    columns = {
        "slip": _each(run, np.round(random.permutation(np.linspace(0.1, 0.85, runs)), 3)),
        "load": _each(run, np.round(random.choice(loads, runs), 1)),
        "speed": _each(run, speed),
        "pass": _each(run, number),
        "moisture": _each(run, np.round(random.permutation(np.linspace(0.01, 0.13, runs)), 3)),
        "time": _since(run, random.uniform(1, 17, count)),
        "humidity": 45 + 4 * random.standard_normal(count),
        "room_temp": 21 + 0.2 * random.standard_normal(count),
        "bed_height": 149 + _each(run, random.standard_normal(runs)),
        "rig_voltage": 24 + 0.1 * random.standard_normal(count),
    }
    constants = {
        "radius": radius,
        "n": random.uniform(0.95, 1.1),
        "cohesion": random.uniform(300, 1200),
        "unit_weight": random.uniform(15e3, 20e3),
        "n_c": 20.0,
        "n_gamma": 6.0,
        "shear_modulus": random.uniform(0.012, 0.022),
    }
    friction = (random.uniform(0.58, 0.70), 0.6, 0.35, 0.9)
    if sphere:
        constants.update(c1=random.uniform(0.16, 0.21), c2=random.uniform(0.28, 0.34))
        stiffness = random.uniform(4e5, 1.2e6)
        fitted = {"k_s": (stiffness, stiffness * random.uniform(0.6, 1.6), 2e4, 2e7), "friction_angle": friction}
    else:
        constants.update(width=width, k_c=random.uniform(1e4, 4e4))
        stiffness = random.uniform(6e5, 2e6)
        fitted = {"k_phi": (stiffness, stiffness * random.uniform(0.6, 1.6), 2e4, 2e7), "friction_angle": friction}
    options = {"stress": str(random.choice(["linear", "full"]))} if sphere else {}
    mapped = ["slip", "load"]
    for role in ("speed", "pass", "moisture", "time"):
        if role in needs or (tied and role in ("speed", "pass")) or random.uniform() < 0.75:
            mapped.append(role)
    return Design(base, run, columns, mapped, constants, options, fitted, {"constant_load": False, "long": long})


def _equation(base: str, runs: int, random: Random, needs: set[str], tied: str, long: bool) -> Design:
    run, pace = _rows(runs, random, long)
    count = len(run)
    time = _since(run, pace * random.uniform(0.8, 1.2, count))
    level = random.permutation(np.linspace(-1.0, 1.0, runs))
    swing = _each(run, level) + 0.1 * random.standard_normal(count)
    columns = {
        "time": time,
        "oil_temp": 38 + _each(run, random.uniform(0, 12, runs)) + 0.1 * random.standard_normal(count),
        "level": 0.88 + 0.02 * random.standard_normal(count),
        "humidity": _each(run, random.uniform(30, 70, runs)) + 0.3 * random.standard_normal(count),
    }
    name = base.partition(":")[2]
    if name == "pipe":
        columns["flow"] = 8.0 * swing
        fitted = {"rl": (random.uniform(1.2e4, 2e4), 1.5e4, 0.0, 3.3e5)}
        mapped = ["flow"]
    elif name == "carriage":
        columns["velocity"] = 2.0 * swing
        columns["acceleration"] = _each(run, random.normal(0, 0.5, runs)) + random.standard_normal(count)
        fitted = {"m": (random.uniform(1.5, 3.0), 2.0, 0.0, 50.0), "fv": (random.uniform(2.0, 5.0), 3.0, 0.0, 50.0)}
        mapped = ["velocity", "acceleration"]
    else:
        columns["current"] = 3.0 * swing
        columns["speed"] = _each(run, 40.0 * random.permutation(level)) + 2.0 * random.standard_normal(count)
        fitted = {"r_a": (random.uniform(0.8, 2.0), 1.0, 0.0, 20.0), "k_e": (random.uniform(0.05, 0.12), 0.1, 0.0, 2.0)}
        mapped = ["current", "speed"]
    return Design(base, run, columns, mapped, {}, {}, fitted, {"constant_load": False, "long": long})
