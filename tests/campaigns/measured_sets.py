"""The real measurements that discovery is judged by, as the cases that a user would make of them.

The data are not part of the project (they have licences of their own): FOLDER is a copy of them with its README, which
states sources, splits, traps, and hand fits. Nothing here was chosen by what discovery answers on the held-out parts.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import cos, radians, sin
from pathlib import Path
from typing import Any

__all__ = ["SETS", "Fold", "Set", "Wanted"]

Row = dict[str, Any]


@dataclass(frozen=True)
class Fold:
    """One case of a set: its table, and case.toml without the line of files."""

    rows: list[Row]
    toml: str


@dataclass(frozen=True)
class Wanted:
    """What must be named: effects that do, and the shape of formulas that mean the same (a regular expression)."""

    meaning: str
    effects: tuple[str, ...] = ()
    formula: str = "$^"


@dataclass(frozen=True)
class Set:
    """A row of the table: cases, what is to be named, and the held-out error (rms) that they may have together.

    `error_of` gives the weight with which a row's error counts (1, or what takes it to `unit`), or None for a row that
    is not asked about.
    """

    name: str
    folds: Callable[[Path], list[Fold]]
    wanted: tuple[Wanted, ...]
    bound: float
    unit: str
    error_of: Callable[[Row], float | None] = field(default=lambda row: 1.0)
    # the range of a column that `where` must point at; its rows are then left out, as a reader would
    points_at: tuple[str, float, float] | None = None
    groups: tuple[str, ...] = ()  # of the parameter that must differ, in the order of the channel's plain means


def _read(path: Path) -> list[Row]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _case(title: str, model: str, fits: str, columns: str, data: str = "", more: str = "") -> str:
    return f"""[case]
title = "{title}"

[model]
base = "equation"
effects = []

[model.equation]
{model}

[fit]
{fits}
{more}
[data]
files = ["rows.csv"]
run = "run"
{data}
[data.columns]
{columns}
"""


def _odrive_current(folder: Path) -> list[Fold]:
    mapped = ("run", "torque [N mm]", "speed [rad/s]", "motor_temperature [degC]", "current_q [A]")
    rows = [{name: row[name] for name in mapped} for row in _read(folder / "odrive_dyno" / "dyno.csv")]
    columns = """torque = { column = "torque [N mm]", unit = "N mm", is = "torque" }
omega = { column = "speed [rad/s]", unit = "rad/s", is = "speed" }
temperature = { column = "motor_temperature [degC]", unit = "degC", is = "temperature" }
current = { column = "current_q [A]", unit = "A" }"""
    fit = 'kt = { value = 0.03, unit = "N m/A" }'
    return [Fold(rows, _case("odrive, motor current", 'current = "torque/kt"', fit, columns))]


def _odrive_power(folder: Path) -> list[Fold]:
    mapped = (
        "run", "torque [N mm]", "speed [rad/s]", "motor_temperature [degC]", "bus_voltage [V]", "bus_current [A]",
    )  # fmt: skip
    rows = []
    for row in _read(folder / "odrive_dyno" / "dyno.csv"):
        power = float(row["bus_voltage [V]"]) * float(row["bus_current [A]"])
        rows.append({**{name: row[name] for name in mapped[:4]}, "power [W]": f"{power:.6g}"})
    columns = """torque = { column = "torque [N mm]", unit = "N mm", is = "torque" }
omega = { column = "speed [rad/s]", unit = "rad/s", is = "speed" }
temperature = { column = "motor_temperature [degC]", unit = "degC", is = "temperature" }
power = { column = "power [W]", unit = "W" }"""
    return [Fold(rows, _case("odrive, power", 'power = "k*torque*omega"', 'k = { value = 1.0, unit = "1" }', columns))]


def _stand(file: str, without: tuple[str, ...] = ()) -> Callable[[Path], list[Fold]]:
    def folds(folder: Path) -> list[Fold]:
        mapped = ("run", "time [s]", "thrust [gf]", "voltage [V]", "current [A]", "speed [rpm]")
        table = _read(folder / "thrust_stand" / file)
        rows = [{name: row[name] for name in mapped} for row in table if row["run"] not in without]
        columns = """current = { column = "current [A]", unit = "A", is = "current" }
speed = { column = "speed [rpm]", unit = "rpm" }
thrust = { column = "thrust [gf]", unit = "gf" }
voltage = { column = "voltage [V]", unit = "V" }"""
        fit = 'v0 = { value = 10.0, unit = "V" }'
        return [Fold(rows, _case("thrust stand", 'voltage = "v0"', fit, columns, 'ignore = ["time [s]"]'))]

    return folds


TRAIN = ["t143339", "t143524", "t143601", "t143747", "t154220"]  # of the double pendulum
TEST = ["t143704", "t154548"]


def _joint(number: int) -> Callable[[Path], list[Fold]]:
    other = 3 - number

    def folds(folder: Path) -> list[Fold]:
        kept = ("angle", "rate", "acceleration")
        units = {"angle": "rad", "rate": "rad/s", "acceleration": "rad/s^2"}
        listed = [f"{name}{joint} [{units[name]}]" for name in kept for joint in (1, 2)]
        table = _read(folder / "double_pendulum" / "double_pendulum.csv")
        mapped = ("run", "time [s]", *listed, f"torque{number} [N m]")
        rows = [{name: row[name] for name in mapped} for row in table if row["run"] in (*TRAIN, *TEST)]
        is_of = {"angle": "position", "rate": "speed", "acceleration": "acceleration"}
        letters = {1: "a", 2: "b"}
        columns = [
            f'{letter}{letters[joint]} = {{ column = "{name}{joint} [{units[name]}]", unit = "{units[name]}"'
            + (f', is = "{is_of[name]}"' if joint == number else "")
            + " }"
            for name, letter in (("angle", "q"), ("rate", "v"), ("acceleration", "a"))
            for joint in (number, other)
        ]
        columns.append(f'torque = {{ column = "torque{number} [N m]", unit = "N m" }}')
        if number == 2:
            model = "inertia*(aa+ab) + mr*(0.2*(aa*cos(qb) + va**2*sin(qb)) + 9.81*sin(qa+qb)) + b*vb"
            fits = ("inertia", "mr", "b")
        else:
            model = (
                "ia*aa + mra*9.81*sin(qa) + mrb*(0.2*((2*aa+ab)*cos(qb) - (2*va*vb+vb**2)*sin(qb))"
                " + 9.81*sin(qa+qb)) + ib*(aa+ab) + b*va"
            )
            fits = ("ia", "mra", "mrb", "ib", "b")
        fit = "\n".join(f"{name} = {{ value = 0.1 }}" for name in fits)
        title = f"double pendulum, joint {number}"
        data = f'train = {TRAIN}\ntest = {TEST}\nignore = ["time [s]"]'
        return [Fold(rows, _case(title, f'torque = "{model}"', fit, "\n".join(columns), data))]

    return folds


def _side_force(folder: Path) -> list[Fold]:
    rows: list[Row] = []
    seen: dict[tuple[str, str], int] = {}
    for row in _read(folder / "cmu_wheel_smooth.csv"):
        angle, slip = row["slip_angle_deg"], f"{float(row['slip']):.1f}"
        number = seen[angle, slip] = seen.get((angle, slip), 0) + 1
        beta, travel = radians(float(angle)), float(row["travel_speed_mm_s"])
        rows.append(
            {
                "run": f"a{float(angle):02.0f}_{number}",
                "beta": f"{beta:.6g}",
                "vx": f"{travel * cos(beta) - float(row['rim_speed_mm_s']):.6g}",
                "vy": f"{travel * sin(beta):.6g}",
                "load": row["load_N"],
                "sinkage": row["sinkage_mm"],
                "side": row["side_N"],
            }
        )
    columns = """beta = { column = "beta", unit = "rad" }
vx = { column = "vx", unit = "mm/s" }
vy = { column = "vy", unit = "mm/s" }
load = { column = "load", unit = "N" }
sinkage = { column = "sinkage", unit = "mm" }
side = { column = "side", unit = "N", sigma = 0.75 }"""
    model, fit = 'side = "mu*load*vy/sqrt(vx**2 + vy**2)"', "mu = { value = 0.5, min = 0.0, max = 3.0 }"
    found = []
    for angle in sorted({row["run"].partition("_")[0] for row in rows}):
        held = sorted({row["run"] for row in rows if row["run"].startswith(angle)})
        found.append(Fold(rows, _case(f"side force without {angle}", model, fit, columns, f"test = {held}")))
    return found


def _plates(folder: Path) -> list[Fold]:
    rows = [
        {
            "run": f"p{float(row['plate_mm']):03.0f}_{float(row['test']):.0f}",
            "plate": row["plate_mm"],
            "z": f"{1000.0 * float(row['z_m']):.6g}",
            "p": row["p_kPa"],
        }
        for row in _read(folder / "cmu_plates.csv")
    ]
    columns = """z = { column = "z", unit = "mm" }
plate = { column = "plate", unit = "mm" }
p = { column = "p", unit = "kPa", sigma = 0.8 }"""
    fits = "k = { value = 1.0, min = 0.0, max = 1e4 }\nn = { value = 1.0, min = 0.1, max = 3.0 }"
    found = []
    for size in sorted({row["run"].partition("_")[0] for row in rows}):
        held = sorted({row["run"] for row in rows if row["run"].startswith(size)})
        found.append(Fold(rows, _case(f"plates without {size}", 'p = "k*z**n"', fits, columns, f"test = {held}")))
    return found


def _husky(folder: Path) -> list[Fold]:
    rows = [
        {
            "run": f"{row['terrain']}_{row['run']}",
            "terrain": row["terrain"],
            "time": row["time"],
            "speed": f"{0.5 * (float(row['velL']) + float(row['velR'])):.6g}",
            "current": f"{float(row['curL']) + float(row['curR']):.6g}",
        }
        for row in _read(folder / "vulpi_husky.csv")
    ]
    columns = """t = { column = "time", unit = "s", is = "time" }
v = { column = "speed", unit = "m/s", is = "speed" }
current = { column = "current", unit = "A" }"""
    fits = 'i0 = { value = 6.0, unit = "A", by = "surface" }'
    more = '\n[groups]\nsurface = { column = "terrain" }\n'
    return [Fold(rows, _case("husky", 'current = "i0"', fits, columns, more=more))]


LIMIT = 10.8  # A, above which the supply limits the current (README)
DRY = Wanted(
    "dry friction",
    ("coulomb_friction", "smooth_friction", "stiction", "stribeck"),
    r"^k\*(sign\(v[ab]\)|tanh\(v[ab]/w\))$",
)
RESISTANCE = Wanted("resistance", ("resistance",), r"^k\*current$")

SETS: Mapping[str, Set] = {
    one.name: one
    for one in (
        Set(
            "odrive-current",
            _odrive_current,
            (
                Wanted("dry friction", ("coulomb_friction", "stiction"), r"^(c|k)(\*sign\(omega\))?$"),
                Wanted("saturation", ("saturation",), r"^k\*torque(\*\*2|\*abs\(torque\))$"),
            ),
            0.45,
            "A",
        ),
        Set(
            "odrive-power",
            _odrive_power,
            (
                Wanted("copper loss", ("copper_loss",), r"^k\*torque\*\*2$"),
                Wanted("loss with speed", ("speed_loss", "viscous_friction"), r"^k\*(abs\()?omega"),
            ),
            4.6,
            "W",
        ),
        Set("thrust-7v4", _stand("stand_7v4.csv"), (RESISTANCE,), 0.029, "V"),
        Set(
            "thrust-11v1",
            _stand("stand_11v1.csv", ("l3_11",)),
            (RESISTANCE,),
            0.025,
            "V",
            lambda row: 1.0 if float(row["current [A]"]) <= LIMIT else None,
            ("current", LIMIT, 12.0),
        ),
        Set("pendulum-2", _joint(2), (DRY,), 0.207, "N m"),
        Set("pendulum-1", _joint(1), (DRY,), 0.231, "N m"),
        Set("side-force", _side_force, (Wanted("sinkage", formula="sinkage"),), 5.3, "N"),
        Set("plates", _plates, (Wanted("exponent by size", formula="^n: .*plate"),), 2.0, "kPa"),
        Set("husky", _husky, (), float("inf"), "A", groups=("dirt_road", "concrete", "unploughed", "ploughed")),
    )
}
