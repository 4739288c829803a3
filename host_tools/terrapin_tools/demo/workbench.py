"""The chapters that hold a model against measurements. Each step is what the command of the same name does."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from terrapin_hil import paths
from terrapin_hil.arrays import Array
from terrapin_hil.messages import interface
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_tools.demo import figures
from terrapin_tools.demo.page import Chapter
from terrapin_tools.demo.stage import Stage
from terrapin_tools.logs.folder import RunFolder
from terrapin_tools.papers.part import Table
from terrapin_tools.param.files import read_parameters
from terrapin_tools.workbench.case.case import load_case, parse_case
from terrapin_tools.workbench.case.changes import add_effects
from terrapin_tools.workbench.compare.comparison import Analysis, analyse
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.robot.firmware_parameters import export_parameters, parameters_toml
from terrapin_tools.workbench.robot.runs import read_run, write_case
from terrapin_tools.workbench.story import sentences
from terrapin_tools.workbench.story.story import Story
from terrapin_tools.workbench.story.terminal import tell_shortly
from terrapin_tools.workbench.story.told import told

__all__ = ["forced_slip", "heated", "logged_run"]

FORCED_SLIP_STEPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("Theory 1", ()),
    ("Theory 2: with bulldozing and slip sinkage, both free", ("bulldozing", "slip_sinkage")),
)
FORCED_SLIP_TEXT = (
    "Li et al. pulled a sphere over sand at five imposed slips and printed tractive force and torque. With the printed "
    "radius no reading of the model explains the torque: both resistances lower it, and it is too low already. At slip "
    "0.49 the measured torque lies above what Coulomb friction can carry under the printed load and friction angle, "
    "whatever the stresses.",
    "A radius near 0.32 m as the only free number would reconcile both channels. That is an inference: five rows at "
    "one load cannot prove it. The case's notes.md has the figures.",
)
HEATED_RUNS = (
    (5.0, 25.0),
    (8.0, 30.0),
    (3.0, 36.0),
    (6.0, 42.0),
    (4.0, 48.0),
    (7.0, 54.0),
    (3.5, 60.0),
    (6.5, 65.0),
)  # V, degC


def logged_run(
    scenario: Scenario,
    link: str,
    folder: Path,
    progress: Callable[[float], None],
    parameters: dict[str, float] | None = None,
) -> Result:
    """A run that leaves its folder (log, truth, run.toml), as `terrapin run --out` does."""
    values = parameters or {}
    with closing(RunFolder(folder, scenario, link, values, interface())) as log:
        result = run(scenario, link, parameters=values, observers=[log], progress=progress)
        log.finish(result)
    return result


def _share(prediction: Array, measured: Array) -> str:
    """Mean absolute error over the measured value."""
    return f"{100.0 * float(np.mean(np.abs(prediction - measured) / measured)):.1f} %"


def forced_slip(stage: Stage, chapter: Chapter) -> None:
    """Table 4 of Li et al. against the sphere on sand: what each step mends, and what none does."""
    source = paths.examples()["forced_slip_sand"]
    base = load_case(source)
    rows, curves = [], []
    for number, (label, effects) in enumerate(FORCED_SLIP_STEPS, 1):
        case = parse_case(source, add_effects(base.text, effects, {})) if effects else base
        analysis = analyse(case)
        channels = {name: i for i, name in enumerate(analysis.model.channels)}
        order = np.argsort(case.roles["slip"][analysis.rows])
        slip = case.roles["slip"][analysis.rows][order]
        predicted = {name: analysis.prediction[i][order] for name, i in channels.items()}
        measured = {name: case.channels[name][analysis.rows][order] for name in ("traction", "torque")}
        curves.append((label, slip, predicted))
        story = told(analysis)
        errors = (_share(predicted[name], measured[name]) for name in ("traction", "torque"))
        rows.append((label, *errors, sentences.in_sd(story.ladder[-1].train_error), story.chip))
        stage.say(f"  {label}: {', '.join(rows[-1][1:3])} off in traction and torque; {story.chip}")
        stage.progress(number / len(FORCED_SLIP_STEPS))
    head = ("model, soil stiffness refitted", "traction off by", "torque off by", "rms error, noise sd", "verdict")
    chapter.tables.append(Table("W = 150 N, R = 0.22 m, actual slip 1 - r/R", head, tuple(rows)))
    for line in FORCED_SLIP_TEXT:
        stage.tell(chapter, line)
    picture = figures.forced_slip(slip, measured, curves, stage.out / "forced_slip.png")
    chapter.pictures.append(
        (picture, "Measured traction and torque against slip, and the model with its soil refitted")
    )
    chapter.commands += [
        "terrapin compare cases/forced_slip_sand",
        "terrapin report cases/forced_slip_sand -o report.html",
    ]


def _compare(stage: Stage, chapter: Chapter, case: Path, label: str) -> tuple[Analysis, Story]:
    analysis = analyse(load_case(case))
    story = told(analysis)
    stage.tell(chapter, f"{label}: {tell_shortly(story)}.")
    return analysis, story


def heated(stage: Stage, chapter: Chapter) -> None:
    """A series over which the winding heats; compare, add, export, and a run with the parameters written back."""
    out = stage.out
    scenario = load_scenario(find_scenario("heated_winding"))
    folders: list[Path] = []

    def progress(share: float) -> None:
        stage.progress((len(folders) - 1 + share) / len(HEATED_RUNS))

    for number, (volt, celsius) in enumerate(HEATED_RUNS, 1):
        orders = tuple(
            replace(order, setpoint=volt) if order.request == "run" else order for order in scenario.operator
        )
        winding = replace(scenario.winding, profile=((0.0, celsius), (1.0, celsius)))
        variant = replace(scenario, seed=number, duration=10.0, operator=orders, winding=winding, checks=(), source="")
        folders.append(out / "runs" / f"heated_{number}")
        logged_run(variant, "inprocess", folders[-1], progress)
    stage.tell(
        chapter,
        "Eight runs on sand, one after the other; from the first to the last the winding warms from 25 to 65 °C, which "
        "weakens the simulated robot's magnets. The model knows nothing of it.",
    )
    case = out / "heated"
    shutil.rmtree(case, ignore_errors=True)
    runs = [read_run(folder, 5.0) for folder in folders]
    title = "Winding that heats by 40 K over eight runs, sand"
    stage.say("  " + write_case(case, runs, title, ["speed_squared"]))
    before, told_before = _compare(stage, chapter, case, "Model as it stands")
    for place in told_before.where[:1]:
        stage.tell(chapter, f"It fails with {place.variable} {place.sentence}.")
    write_whole(case / "case.toml", add_effects(load_case(case).text, ["motor_heating"], {}))
    after, told_after = _compare(stage, chapter, case, "With motor_heating added")
    names = [fitted.name for fitted in after.model.fitted]
    where = next(i for i, fitted in enumerate(after.model.fitted) if fitted.effect == "motor_heating")
    true = next(active.values["a_t"] for active in scenario.effects if active.effect.name == "motor_heating")
    stage.tell(
        chapter,
        f"{names[where]} = ({1e3 * after.fit.theta[where]:.4f} ± {1e3 * after.sd[where]:.4f}) 1e-3/K; "
        f"the simulated robot has {1e3 * true:.4f} 1e-3/K.",
    )
    # One noise sd for both rows: that of the model which lacks nothing. While heating is missing it is found larger.
    ladder = ((told_after.ladder[-2], "before"), (told_after.ladder[-1], "after motor_heating"))
    sds = [1e3 * float(analysis.noise.sigma[0]) for analysis in (before, after)]
    stage.tell(
        chapter,
        f"Errors count in the sd of the noise, which each answer finds: {sds[0]:.3g} mA while the heating is missing, "
        f"{sds[1]:.3g} mA now. So the same model stands at {sentences.in_sd(told_before.ladder[-1].heldout_error)} "
        f"above and at {sentences.in_sd(told_after.ladder[-2].heldout_error)} here.",
    )
    rows = tuple(
        (label, sentences.in_sd(rung.train_error), sentences.in_sd(rung.heldout_error)) for rung, label in ladder
    )
    chapter.tables.append(
        Table(
            f"Error in noise sd ({sentences.floor(told_after.noise)})",
            ("model", "training runs", "held-out runs"),
            rows,
        )
    )

    exported, refused = export_parameters(after)
    write_whole(out / "firmware.toml", parameters_toml(after, exported, refused))
    for entry in exported:
        stage.tell(
            chapter,
            f"Sent to the controller: {entry.name} = {entry.held:.6g} {entry.unit} (rounding {entry.rounding:+.1g}).",
        )
    trial = replace(scenario, seed=99)
    plain = run(trial, "inprocess", progress=stage.progress)
    written = run(
        trial, "inprocess", parameters=read_parameters(out / "firmware.toml", interface()), progress=stage.progress
    )
    errors = [_rms(plain), _rms(written)]
    stage.tell(
        chapter,
        "Back on the robot, which now heats by 40 K within one run: rms error of the controller's C_t "
        f"{errors[0]:.2f} mN m before, {errors[1]:.2f} mN m with the parameters written back.",
    )
    sigma = before.noise.sigma[:, None]
    picture = figures.heated(
        before.case.roles["temperature"][before.rows],
        (before.residual / sigma)[0],
        (after.residual / sigma)[0],
        (("before", plain), ("with the parameters", written)),
        out / "heated.png",
    )
    chapter.pictures.append(
        (picture, "What the model lacks against the winding's temperature, and the controller's error of C_t")
    )
    chapter.commands += [
        "terrapin case runs out/runs/heated_* --to my_case --effect speed_squared --after 5",
        "terrapin compare my_case",
        "terrapin add my_case motor_heating",
        "terrapin export my_case --to firmware.toml",
        "terrapin run heated_winding --parameters firmware.toml",
    ]
    chapter.links.append((out / "firmware.toml", "firmware.toml"))


def _rms(result: Result) -> float:
    """Rms error of the valid values of C_t [mN m]."""
    error = figures.contact_errors(result)[1]
    return 1e3 * float(np.sqrt(np.mean(error * error)))
