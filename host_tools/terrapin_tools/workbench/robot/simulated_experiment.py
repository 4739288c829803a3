"""The proposed experiment, run in the simulator: what would be measured if one of the rivals were true.

Each setting is one run of the simulated robot under its controller, on ground and with friction as fitted in the case;
its steady windows become rows beside those of the case, in a new case. What the simulated robot really has is said by
whoever asks (`truth`): the simulator cannot know what a real machine has.
"""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from terrapin_hil.messages import interface
from terrapin_hil.robot.compiled_effects import ActiveEffect, EffectError
from terrapin_hil.robot.plant import TERRAINS, Ground, Robot, Segment, Winding
from terrapin_hil.robot.sensors import kit
from terrapin_hil.run.run import DivergedError, run
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_tools.errors import UserError, about
from terrapin_tools.logs.folder import RunFolder
from terrapin_tools.workbench.bases import BASES, ROLES
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.case.changes import inline_tables
from terrapin_tools.workbench.compare.refit import refit
from terrapin_tools.workbench.experiment.rig_settings import SETTABLE, rows_of
from terrapin_tools.workbench.files.writing import whole_folder
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.robot.runs import Run, read_run

__all__ = ["Carried", "carry_out", "write_larger"]

BY_ITSELF = ("slope", "inertia")  # effects that the simulated robot has without being told
FIXED = (
    "radius",
    "drive_radius",
    "torque_constant",
    "coulomb",
    "viscous",
    "gear_efficiency",
)  # of the robot, as the case has them
LIGHTEST = 0.1  # kg, of the drive unit, when a light robot is asked for
SECONDS, AFTER = 12.0, 3.0  # of each run, and what of it is left out
RIPPLE = 10.0  # codes (10 mA) of noise on each sample of the current, as brushes and bridge make it


@dataclass(frozen=True)
class Carried:
    """Runs of the simulator, in the order of the plan's settings."""

    truth: tuple[str, ...]
    settings: Sequence[Mapping[str, float]]
    runs: Sequence[Run]


def carry_out(
    case: Case,
    answer: Mapping[str, Any],
    truth: Sequence[str] = (),
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Carried:
    """Run the experiment that `answer` (of discover) proposes. `truth`: one of its rivals; empty: the likeliest.

    UserError when nothing is proposed, or the simulator cannot have such a robot, ground or effect.
    """
    plan = answer.get("next_experiment")
    if plan is None:
        raise UserError(f"{case.folder}: the last answer of discover proposes no experiment, expected one that does")
    if not case.base.on_robot:
        expected = " or ".join(base.name for base in BASES.values() if base.on_robot)
        raise UserError(f"{case.folder}: base {case.base.name}, expected {expected}: the simulator has a robot")
    rivals = [tuple(effects) for effects in answer["rivals"]]
    chosen = tuple(truth) or tuple(answer["missing"])
    if chosen not in rivals:
        expected = " or ".join(" ".join(effects) for effects in rivals)
        raise UserError(f"--truth: found {' '.join(chosen)}, expected one of the rivals: {expected}")
    roles = [role for role in plan["vary"] if role not in SETTABLE]
    if roles:
        raise UserError(f"{case.folder}: the plan varies {roles[0]}, the simulator can set {', '.join(SETTABLE)}")
    sigma = np.array([answer["channels"][name]["noise_sd"] for name in Model.of(case).channels])
    fit = refit(case, sigma, dict(answer), chosen)
    if fit is None:
        raise UserError(f"{case.folder}: the model with {' '.join(chosen)} gives no prediction")
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number, setting in enumerate(plan["settings"]):
            if progress is not None:
                progress(number, len(plan["settings"]))
            scenario = _scenario(case, fit, {**plan["hold"], **setting}, f"sim_{number + 1:02d}", seed + number)
            found.append(_run(scenario, Path(folder) / scenario.name))
    return Carried(chosen, plan["settings"], found)


def _scenario(case: Case, fit: Fit, setting: Mapping[str, float], name: str, seed: int) -> Scenario:
    rows = case.train | case.test
    theta = dict(zip((fitted.key for fitted in fit.model.fitted), map(float, fit.theta), strict=True))
    known = {**case.parameters, **theta}
    robot = replace(Robot(), **{name: known[name] for name in FIXED})
    load = setting.get("load", known.get("load", float(np.median(case.roles["load"])) if "load" in case.roles else 0.0))
    drive = load / robot.gravity - robot.shell_mass - robot.body_mass
    if drive < LIGHTEST:
        raise UserError(f"{case.folder}: a load of {load:.4g} N, expected more: the simulated shell alone weighs more")
    robot = replace(robot, drive_mass=drive)
    omega = setting.get("omega", float(np.median(np.abs(case.roles["omega"][rows]))))
    inputs = rows_of(case, rows, [{**setting, "omega": omega}], setting, 1)
    current = float(fit.model.bind(inputs).predict(fit.theta)[fit.model.channels.index("current")][0])
    volts = robot.armature_resistance * current + robot.torque_constant * robot.radius / robot.drive_radius * omega
    sensors = kit("ideal")
    active, offset = [], 0.0
    for effect in fit.model.effects:
        values = {p.name: theta[f"{effect.name}.{p.name}"] for p in effect.parameters}
        if effect.name == "current_offset":
            offset = 1e3 * values["i_0"]  # codes of 1 mA
        elif effect.plant and effect.name != "speed_squared":
            active.append(ActiveEffect(effect, {**effect.options, **values}))
        elif effect.name not in (*BY_ITSELF, "speed_squared"):
            raise UserError(f"{effect.name}: the simulated robot cannot have it")
    ground = replace(TERRAINS["sand"], f_o=known["f_o"], f_s=theta.get("speed_squared.f_s", 0.0))
    celsius = setting.get("temperature", Winding().start)
    return Scenario(
        name=name,
        duration=SECONDS,
        seed=seed,
        robot=robot,
        ground=Ground((Segment(ground, slope=round(setting.get("slope", 0.0), 3)),)),  # the sensor counts whole mrad
        operator=(Order(0.0, "run", "voltage", round(volts, 3), limiter=False),),
        sensors=replace(sensors, current=replace(sensors.current, noise=RIPPLE, offset=offset)),
        winding=Winding(profile=((0.0, celsius), (1.0, celsius))),
        effects=tuple(active),
        firmware={"weight": robot.weight, "trim_current": 0.0, "sd_current_noise": RIPPLE * 1e-3},
    )


def _run(scenario: Scenario, folder: Path) -> Run:
    cannot = about(scenario.name, (EffectError, DivergedError))
    with cannot, closing(RunFolder(folder, scenario, "inprocess", {}, interface())) as log:
        log.finish(run(scenario, "inprocess", observers=[log]))
    return read_run(folder, AFTER)


def write_larger(case: Case, carried: Carried, to: Path) -> int:
    """A new case of the rows of `case` and of the simulator's runs; returns the number of new rows.

    All in one table in canonical units; columns that the simulator does not measure are left out. UserError when `to`
    exists, or the model needs a column that the simulator has not.
    """
    if to.exists():
        raise UserError(f"{to}: exists, expected a new folder for the case")
    rows = [row for one in carried.runs for row in one.rows]
    new = {
        name for name in ("load", *carried.settings[0]) if name not in case.roles and len({r[name] for r in rows}) > 1
    }
    columns = [name for name in (*case.roles, *case.channels) if all(name in row for row in rows)]
    lost = [name for name in case.roles if name not in columns and name in case.base.needs]
    if lost:
        raise UserError(f"{case.folder}: the simulator has no {lost[0]}, which the model needs")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", *columns, *sorted(new)])
    old = {**case.roles, **case.channels}
    fixed = [f"{case.parameters.get(name, 0.0):.9g}" for name in sorted(new)]
    for i in np.flatnonzero(case.train | case.test):
        writer.writerow([case.run_names[case.run[i]], *(f"{old[name][i]:.9g}" for name in columns), *fixed])
    for one in carried.runs:
        for row in one.rows:
            writer.writerow([one.name, *(f"{row[name]:.9g}" for name in (*columns, *sorted(new)))])
    document = _document(case, carried, columns, sorted(new))
    with whole_folder(to) as scratch:
        (scratch / "runs.csv").write_text(text.getvalue(), encoding="utf-8")
        (scratch / "case.toml").write_text(document, encoding="utf-8")
    return len(rows)


def _document(case: Case, carried: Carried, columns: Sequence[str], new: Sequence[str]) -> str:
    """The case's own text with the new table, and with the simulator's runs among those that are trained on."""
    document: Any = tomlkit.parse(case.text)
    heading = document.setdefault("case", tomlkit.table())
    heading["title"] = f"{case.title}, and {len(carried.runs)} simulated runs"
    heading["comment"] = f"runs sim_*: simulated with {' + '.join(carried.truth)}, not measured"
    heading.pop("notes", None)
    for name in new:
        document.get("parameters", {}).pop(name, None)
    data = document["data"]
    for name in ("dbc", "period"):
        data.pop(name, None)
    data["files"], data["run"] = ["runs.csv"], "run"
    if "train" in data:
        data["train"].extend(one.name for i, one in enumerate(carried.runs) if i % 4 != 3)
    if "test" in data:
        data["test"].extend(one.name for i, one in enumerate(carried.runs) if i % 4 == 3 or "train" not in data)
    names = (*columns, *new)
    noise = {name: float(f"{value:.9g}") for name, value in case.sigma.items() if value is not None}
    units = {name: case.units.get(name) or ROLES.get(name, "1") for name in names}
    data["columns"] = inline_tables(
        {name: {"column": name, "unit": units[name], "sigma": noise.get(name)} for name in names}
    )
    return tomlkit.dumps(document)
