"""A case from logged runs: one row for each steady window that the controller declared valid.

The controller's WINDOW message holds the means of current, speed and voltage over the window of its last C_t; `fresh`
says that a window which shares no sample with the one before has just ended. Those rows, while the controller runs and
does not limit, are what `rolling_steady` predicts. Winding temperature, slope, speed, angle and acceleration come from
the messages beside, as means over the same window (the angle: in its middle). Where the weight differs from run to run
it is a column, otherwise a constant.

What goes with the angle (an imbalance, cogging) or with the acceleration keeps the robot from ever being steady and is
averaged out of such windows. For it `span` makes rows of the telemetry's 10 ms means instead, steady or not; speed and
acceleration are then the derivatives of a cubic through the shell's angle over twice the span.

The voltage is left out on purpose: with the speed it gives the current by the motor's own circuit, i = (U - K omega)/R,
whatever resists the motion. As a column it would explain every missing effect, and say nothing of any.

Logs of a sphere become a case of `rolling_sphere`, a row for each steady state (steady_states.py).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from terrapin_hil.arrays import Array
from terrapin_hil.messages import Interface, interface
from terrapin_hil.physics import soils
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.reading import parse_toml
from terrapin_hil.robots import selected
from terrapin_hil.telemetry import si_factor
from terrapin_tools.errors import UserError, about
from terrapin_tools.logs import candump
from terrapin_tools.logs.candump import telemetry
from terrapin_tools.workbench.bases import Base, rolling_sphere, rolling_steady
from terrapin_tools.workbench.case.changes import inline_tables
from terrapin_tools.workbench.files.units import quantity
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.robot.steady_states import PITCH_ERROR, on_soft_ground

__all__ = ["SOIL", "Run", "base_of_logs", "read_run", "write_case"]

SOIL = "dry_sand_li"  # under a sphere, where nobody says another

COLUMNS = {
    "time": "s",
    "omega": "rad/s",
    "current": "A",
    "load": "N",
    "speed": "m/s",
    "temperature": "degC",
    "slope": "rad",
    "angle": "rad",
    "acceleration": "rad/s^2",
    "slip": "1",
    "traction": "N",
}
TELEMETRY_PERIOD = 0.01  # s
# parameters of the controller
KNOWN = ("radius", "drive_radius", "torque_constant", "coulomb", "viscous", "weight", "gear_efficiency")


@dataclass(frozen=True)
class Run:
    """Rows of one run, and the model's constants as its controller had them (SI)."""

    name: str
    rows: list[dict[str, float]]
    constants: Mapping[str, float]
    sigma: Mapping[str, float] = field(default_factory=dict)  # sd of a row by channel, where that is known


def base_of_logs() -> Base:
    """The base model of what this process' robot logs."""
    return rolling_sphere.BASE if selected().kind == "sphere" else rolling_steady.BASE


def check_asked(effects: Sequence[str], span: float | None, soil: str) -> None:
    """UserError unless runs of this process' robot have what is asked for, and its base the effects."""
    base = base_of_logs()
    rolls = "slip" in base.needs
    if span is not None and rolls:
        raise UserError("--span: found a sphere, expected a cylinder: a sphere's rows are its steady states")
    if soil and not rolls:
        raise UserError("--soil: found a cylinder, expected a sphere")
    if span is not None and not 0.02 <= span <= 10.0:
        raise UserError(f"--span: found {span:g}, expected 0.02 to 10 s")
    known = [name for name, found in catalogue().items() if base.takes(found)]
    for name in effects:
        if name not in known:
            raise UserError(f"--effect: found {name!r}, expected one of {', '.join(known)}")


def _parameters(folder: Path, description: Interface) -> dict[str, float]:
    """The controller's parameters in the run: its defaults, changed as run.toml says."""
    values = {name: p.default * p.scale for name, p in description.parameters.items()}
    file = folder / "run.toml"
    if not file.is_file():
        return values
    try:
        document = parse_toml(file.read_text(encoding="utf-8-sig"), file)
    except UnicodeDecodeError:
        raise UserError(f"{file}: not TOML: found something that is not UTF-8 text") from None
    said = document.get("run", {})
    robot = said.get("robot", selected().name) if isinstance(said, dict) else selected().name
    if robot != selected().name:
        raise UserError(f"{file}: run.robot: found {robot!r}, expected {selected().name!r}: name it with --robot")
    for table in ("firmware", "parameters"):
        found = document.get(table, {})
        for name, value in found.items() if isinstance(found, dict) else ():
            if name not in values:
                continue
            with about(f"{file}: {table}.{name}"):
                values[name] = quantity(value, description.parameters[name].unit or "1")
    return values


def read_run(
    folder: Path,
    after: float = 0.0,
    before: float = float("inf"),
    span: float | None = None,
    pitch_error: float = PITCH_ERROR,
) -> Run:
    """Rows of a run's telemetry.log between `after` and `before` [s]: its valid steady windows (of a sphere: its steady
    states), or, with `span` [s], means over that time of a running robot that does not limit. `pitch_error` [rad]: sd
    of the zero of a sphere's pitch sensor. UserError when it has none."""
    log = folder / "telemetry.log"
    if not log.is_file():
        raise UserError(f"{log}: no such file, expected a run's folder (terrapin run --out)")
    description = interface()
    tables = telemetry(candump.read(log), description)
    parameters = _parameters(folder, description)
    running = description.enums["state"]["run"]
    sigma: dict[str, float] = {}
    if span is None:
        width = parameters["window"] * si_factor(description.parameters["window"].unit)
        times = _window_ends(tables, running, after, before)
        columns = _windows(tables, times, width)
    else:
        width = span
        columns, turning = _means(tables, running, after, before, span)
        if len(columns["time"]):
            # What the differentiated angle scatters comes back through the inertia, as if the current did.
            geared = parameters["drive_radius"] / parameters["radius"] / parameters["torque_constant"]
            through = parameters["inertia"] * geared * turning
            sigma = {"current": float(np.hypot(_scatter(tables["ELECTRICAL"], columns["time"], span), through))}
    if len(columns["time"]) == 0:
        kind = "valid steady window" if span is None else f"stretch of {2 * width:g} s"
        hint = "; --span makes rows of motion that is not steady" if span is None else ""
        raise UserError(f"{log}: found no {kind} of a running robot, expected at least one{hint}")
    columns["load"] = np.full(len(columns["time"]), parameters["weight"])
    last = columns["time"][-1:]
    constants = {name: parameters[name] for name in KNOWN}
    if selected().kind == "sphere":
        constants["drive_radius"] = parameters["radius"] / selected().wheel_gear  # the parameter is rounded to 1 um
        valid = _held(tables["MOTION"], "slip_valid", columns["time"]) > 0 if "MOTION" in tables else slice(None)
        windows = {name: values[valid] for name, values in columns.items()}
        with about(str(log)):
            columns, sigma = on_soft_ground(windows, parameters["radius"], width, pitch_error)
    rows = [dict(zip(columns, map(float, values), strict=True)) for values in zip(*columns.values(), strict=True)]
    for name in ("coulomb", "viscous"):  # what the calibration found, or the parameter in use before it
        if "CALIBRATION" in tables:
            constants[name] = float(_held(tables["CALIBRATION"], name, last)[0])
    return Run(folder.resolve().name, rows, constants, sigma)


def _windows(tables: Mapping[str, dict[str, Array]], times: Array, span: float) -> dict[str, Array]:
    """Means over the steady windows that end at `times`."""
    columns = {"time": times}
    if len(times) == 0:
        return columns
    for name in ("omega", "current"):
        columns[name] = _held(tables["WINDOW"], name, times)
    columns.update(_beside(tables, times, span))
    if "ATTITUDE" in tables:
        columns["angle"] = _held(tables["ATTITUDE"], "angle", times - 0.5 * span)
        columns["acceleration"] = _held(tables["ATTITUDE"], "acceleration", times)
    return columns


def _means(
    tables: Mapping[str, dict[str, Array]], running: int, after: float, before: float, span: float
) -> tuple[dict[str, Array], float]:
    """Means over consecutive stretches of `span`, wherever the robot runs and does not limit for twice that; and the sd
    of their acceleration [rad/s^2], by the scatter of the angle around its local cubic."""
    needed = ("STATUS", "GROUND", "ELECTRICAL", "ATTITUDE")
    if any(message not in tables for message in needed):
        return {"time": np.empty(0)}, 0.0
    clock = tables["ATTITUDE"]["time"]
    count = max(2, round(span / TELEMETRY_PERIOD))
    free = _held(tables["STATUS"], "state", clock) == running
    free &= _held(tables["GROUND"], "limiting", clock) == 0
    free &= _held(tables["ELECTRICAL"], "current_limiting", clock) == 0
    free &= (clock >= after) & (clock < before)
    middle = np.arange(count, len(clock) - count, count)
    around = middle[:, None] + np.arange(-count, count + 1)
    middle = middle[free[around].all(axis=1) & (np.ptp(clock[around], axis=1) < 2.5 * count * TELEMETRY_PERIOD)]
    lag = np.arange(-count, count + 1) * TELEMETRY_PERIOD
    powers = np.vander(lag, 4, increasing=True)
    cubic = np.linalg.pinv(powers)
    turned = np.unwrap(tables["ATTITUDE"]["angle"])
    local = turned[middle[:, None] + np.arange(-count, count + 1)]
    fitted = (local - turned[middle, None]) @ cubic.T
    ends = clock[middle] + 0.5 * span
    columns = {"time": clock[middle], "omega": fitted[:, 1]}
    columns["current"] = _mean(tables["ELECTRICAL"], "current", ends, span)
    columns.update(_beside(tables, ends, span))
    columns["angle"] = np.mod(turned[middle] + fitted[:, 0], 2.0 * np.pi)
    columns["acceleration"] = 2.0 * fitted[:, 2]
    left = local - turned[middle, None] - fitted @ powers.T
    scatter = float(np.sqrt((left * left).sum() / max(1, left.size - 4 * len(left))))
    return columns, 2.0 * scatter * float(np.linalg.norm(cubic[2]))


def _scatter(table: Mapping[str, Array], middle: Array, span: float) -> float:
    """Sd of the mean current of a row [A], from its samples' scatter around a parabola: noise without the motion."""
    count = max(5, round(span / TELEMETRY_PERIOD))
    last = np.clip(np.searchsorted(table["time"], middle + 0.5 * span, side="right"), count, None)
    samples = table["current"][last[:, None] + np.arange(-count, 0)]
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 3))[0]
    left = samples - samples @ basis @ basis.T
    return float(np.sqrt(np.mean(left * left) * count / (count - 3) / count))


def _beside(tables: Mapping[str, dict[str, Array]], ends: Array, span: float) -> dict[str, Array]:
    """Speed, temperature and slope, where they are known, as means over the `span` up to each end."""
    columns = {}
    if "MOTION" in tables:
        columns["speed"] = _mean(tables["MOTION"], "ground_speed", ends, span)
    if "ELECTRICAL" in tables:
        columns["temperature"] = _mean(tables["ELECTRICAL"], "temperature", ends, span)
    if "ATTITUDE" in tables and np.all(_held(tables["ATTITUDE"], "pitch_valid", ends) > 0):
        columns["slope"] = _mean(tables["ATTITUDE"], "pitch", ends, span)
    return columns


def _window_ends(tables: Mapping[str, dict[str, Array]], running: int, after: float, before: float) -> Array:
    """Times of the WINDOW frames that end a disjoint valid window of a running robot."""
    if "WINDOW" not in tables or "STATUS" not in tables:
        return np.empty(0)
    window = tables["WINDOW"]
    use = (window["fresh"] > 0) & (window["valid"] > 0) & (window["time"] >= after) & (window["time"] < before)
    use &= window["time"] >= tables["STATUS"]["time"][0]
    # Long windows are worked out every few frames only; the frames between say the same window again.
    ends = np.flatnonzero(use)
    times = window["time"][ends[np.diff(window["index"][ends], prepend=-1) != 0]]
    return np.asarray(times[_held(tables["STATUS"], "state", times) == running])


def _held(table: Mapping[str, Array], signal: str, times: Array) -> Array:
    """The signal's last value at each time, its first before there is one."""
    index = np.searchsorted(table["time"], times, side="right") - 1
    return np.asarray(table[signal][np.maximum(index, 0)])


def _mean(table: Mapping[str, Array], signal: str, times: Array, span: float) -> Array:
    """The signal's mean over the `span` [s] up to each time: what belongs to a window's mean current and speed."""
    sums = np.concatenate(([0.0], np.cumsum(table[signal])))
    last = np.maximum(np.searchsorted(table["time"], times, side="right"), 1)
    first = np.minimum(np.searchsorted(table["time"], times - span, side="right"), last - 1)
    return np.asarray((sums[last] - sums[first]) / (last - first))


def write_case(folder: Path, runs: Sequence[Run], title: str, effects: Sequence[str], soil: str = "") -> str:
    """Write runs.csv and case.toml of a new case; returns a sentence about it. UserError when the folder is in use.

    `soil`: under a sphere, one of the library's; none: SOIL, as a guess.
    """
    if (folder / "case.toml").exists():
        raise UserError(f"{folder / 'case.toml'}: exists, expected a new folder for the case")
    names = [run.name for run in runs]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"run {name!r} is given twice, expected folders of different names")
    if len(runs) < 2:
        raise UserError("found one run, expected at least two: one of them is held out")
    common = [column for column in COLUMNS if all(column in row for run in runs for row in run.rows)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", *common])
    for run in runs:
        for row in run.rows:
            writer.writerow([run.name, *(f"{row[column]:.9g}" for column in common)])
    varying = {c for c in common if len({row[c] for run in runs for row in run.rows}) > 1 or c == "omega"}
    mapped = [c for c in common if c in varying or c in base_of_logs().channels]
    document = _document(runs, title, effects, mapped, soil)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "runs.csv", text.getvalue())
    write_whole(folder / "case.toml", document)
    rows = sum(len(run.rows) for run in runs)
    return f"{folder}: {rows} rows of {len(runs)} runs"


def _soil(name: str) -> dict[str, Any]:
    """Numbers of a soil under a sphere, as a case says them. UserError where it does not do."""
    known = {key: soil for key, soil in soils.library().items() if soil.c1 is not None and soil.shear_modulus}
    if name not in known:
        raise UserError(f"--soil: found {name!r}, expected one of {', '.join(known)}")
    soil = known[name]
    names = ("cohesion", "friction_angle", "shear_modulus", "unit_weight", "c1", "c2", "n_c", "n_gamma")
    stated = {"n": soil.exponent} | {key: getattr(soil, key) for key in names if getattr(soil, key) is not None}
    units = {key: soil.unit(key) for key in stated}
    said = {key: v if units[key] == "1" else f"{v:.9g} {units[key]}" for key, v in stated.items()}
    return {"k_s": f"{soil.k_phi:.9g} {soil.unit('k_phi')}", **said}


def _document(runs: Sequence[Run], title: str, effects: Sequence[str], columns: Sequence[str], soil: str) -> str:
    base = base_of_logs()
    document = tomlkit.document()
    document.add(tomlkit.comment("made by `terrapin case` from logged runs"))
    document["case"] = {"title": title}
    document["model"] = {"base": base.name, "effects": list(effects)}
    means = {name: sum(run.constants[name] for run in runs) / len(runs) for name in base.units if name in KNOWN}
    known = {name: base.units[name] for name, mean in means.items() if mean != base.parameters[name].default}
    parameters = {name: f"{means[name]:.9g} {unit}" for name, unit in known.items()}
    if "load" not in columns:
        parameters["load"] = f"{runs[0].constants['weight']:.9g} N"
    fit = {name: tomlkit.value(entry).unwrap() for name, entry in base.first_fit.items()}
    if "slip" in base.needs:
        of_soil = _soil(soil or SOIL)
        for name in fit:
            fit[name]["value"] = of_soil.pop(name)
        parameters |= of_soil
        if not soil:
            document["case"]["guessed"] = [f"parameters.{name}" for name in of_soil]
    document["parameters"] = parameters
    document["fit"] = inline_tables(fit)
    columns = [c for c in columns if not ("slip" in base.needs and c == "slope")]  # it is what gives the pull
    mapped: dict[str, dict[str, Any]] = {column: {"column": column, "unit": COLUMNS[column]} for column in columns}
    for channel in runs[0].sigma:
        pooled = np.sqrt(np.mean([run.sigma[channel] ** 2 for run in runs]))
        mapped[channel]["sigma"] = float(f"{pooled:.3g}")
    data = tomlkit.table()
    data.update({"files": ["runs.csv"], "run": "run", "columns": inline_tables(mapped)})
    if "slip" in base.needs:
        data["ignore"] = ["slope"]
    document["data"] = data
    return tomlkit.dumps(document)
