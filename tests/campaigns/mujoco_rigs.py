"""Rigs in MuJoCo: physics that shares no line with the program, one feature of each rig missing from the model.

    python -m tests.campaigns.mujoco_rigs --cases 5                   of each feature
    python -m tests.campaigns.mujoco_rigs --part 1/4                  a quarter of the cases; parts merge

A shaft (or a cart) is driven along slow random motions, and the torque (force) of its drive is recorded with noise,
beside position, speed and acceleration. The user's model of base `equation` lacks one feature of the rig. Noise is
drawn so that 1.5 to 5 noise sd of the feature are left where the model's own parameters follow. Right is the feature,
alone or in a tie with at most three more (ties.py). Results are lines of JSON; a rerun goes on where the last one
stopped. The table puts the worst feature first.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from tests.campaigns.drawn import write_table
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import MOST_TOLD, distances, is_tie, rivals, told

__all__ = ["FEATURES", "Drawn", "Feature", "draw", "one", "right", "table"]

RUNS, SECONDS, STEP, EVERY = 10, 4.0, 0.002, 20  # a row each 40 ms
SEEN = (1.5, 5.0)  # noise sd (rms) of what is missing, beyond the model's own parameters


@dataclass(frozen=True)
class Feature:
    """What a rig has and its model lacks, and what counts as its name: effects, or the shape of a formula."""

    name: str
    model: str  # of the channel, without it
    fit: tuple[str, ...]
    names: tuple[str, ...]
    formula: str = "$^"
    joint: str = "hinge"
    known: tuple[str, ...] = ()  # parameters that are stated, at their true values
    values: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of the rig, drawn in this range


HELD = "j*a + b*v"  # inertia and viscous friction of every rig
DRY = r"^k\*(sign\(v\)|tanh\(v/w\)|sign\(v\)\*sqrt\(abs\(v\)\))$"
FEATURES: Mapping[str, Feature] = {
    one.name: one
    for one in (
        Feature("fluid drag", HELD, ("j", "b"), ("speed_squared",), r"^k\*v\*abs\(v\)$",
                values={"density": (300, 900)}),
        Feature(
            "friction loss", HELD, ("j", "b"), ("coulomb_friction", "smooth_friction", "stiction"), DRY,
            values={"dry": (0.05, 0.2)},
        ),
        Feature("damping", "j*a", ("j",), ("viscous_friction",), r"^k\*v$"),
        Feature("armature", HELD, ("b",), ("inertia", "constant.j"), r"^k\*a$", known=("j",),
                values={"armature": (0.005, 0.02)}),
        Feature("slope", HELD, ("j", "b"), ("offset",), r"^k$", joint="slide", values={"slope": (0.02, 0.15)}),
        Feature("off-centre mass", HELD, ("j", "b"), ("imbalance",), r"^k\*(sin|cos)\(q\)$",
                values={"shift": (0.01, 0.04)}),
        Feature("backlash", HELD, ("j", "b"), ("dead_zone", "backlash"), r"max\(abs\(q\) - w, 0\)",
                values={"gap": (0.2, 0.5), "stiffness": (0.3, 1.5)}),
        Feature("gain", HELD, (), ("table.torque.scale", "gain"), known=("j", "b"), values={"gain": (0.75, 1.3)}),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """A case in a folder, and its truth."""

    feature: Feature
    folder: Path
    values: Mapping[str, float]  # of the rig
    left: float  # rms of what is missing, in noise sd, beyond the model's own parameters
    torque: Array  # of the drive, without noise (rows,)
    noise: float  # its sd


def _rig(feature: Feature, own: Mapping[str, float]) -> str:
    """MJCF of the rig. A shaft is a bar that turns about its middle; a vertical axis has no weight on it."""
    level = feature.name == "off-centre mass"  # a level axis
    gravity = "0 0 -9.81"
    if feature.joint == "slide":
        gravity = f"{-9.81 * np.sin(own['slope']):.9g} 0 {-9.81 * np.cos(own['slope']):.9g}"
    axis = "1 0 0" if feature.joint == "slide" else "0 1 0" if level else "0 0 1"
    tendon = ""
    if "gap" in own:  # a spring that pulls outside of a gap only
        gap = 0.5 * own["gap"]
        tendon = (
            f'<tendon><fixed name="coupling" stiffness="{own["stiffness"]:.9g}" springlength="{-gap:.9g} {gap:.9g}">'
            '<joint joint="q" coef="1"/></fixed></tendon>'
        )
    return f"""<mujoco>
  <option timestep="{STEP}" integrator="implicitfast" gravity="{gravity}" density="{own.get("density", 0.0):.9g}"/>
  <worldbody><body>
    <joint name="q" type="{feature.joint}" axis="{axis}" damping="{own["b"]:.9g}"
      armature="{own.get("armature", 0.0):.9g}" frictionloss="{own.get("dry", 0.0):.9g}"/>
    <geom type="box" size="0.2 0.02 0.05" pos="{own.get("shift", 0.0):.9g} 0 0" mass="{own["mass"]:.9g}"/>
  </body></worldbody>
  {tendon}
  <actuator><motor name="drive" joint="q" gear="{own.get("gain", 1.0):.9g}"/></actuator>
</mujoco>"""


def _motion(rig: str, random: np.random.Generator) -> dict[str, Array]:
    """Position, speed, acceleration and the drive's command of every EVERY-th step of one run."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(rig)
    data = mujoco.MjData(model)
    amplitude, rate, phase = random.uniform(0.2, 0.9, 3), random.uniform(1.0, 5.0, 3), random.uniform(0.0, 6.28, 3)
    rows: list[tuple[float, float, float, float]] = []
    for step in range(round(SECONDS / STEP)):
        wave = rate * data.time + phase
        wanted, speed = float(amplitude @ np.sin(wave)), float((amplitude * rate) @ np.cos(wave))
        if step == 0:
            data.qpos[0], data.qvel[0] = wanted, speed
        data.ctrl[0] = 5.0 * (wanted - data.qpos[0]) + 0.5 * (speed - data.qvel[0])
        mujoco.mj_forward(model, data)
        if step % EVERY == 0:
            rows.append((float(data.qpos[0]), float(data.qvel[0]), float(data.qacc[0]), float(data.ctrl[0])))
        mujoco.mj_step(model, data)
    columns = np.array(rows).T
    return dict(zip(("q", "v", "a", "torque"), columns, strict=True))


def draw(name: str, number: int, seed: int, folder: Path) -> Drawn:
    """The case of a feature and a number, written into `folder`."""
    import mujoco

    feature = FEATURES[name]
    random = np.random.default_rng([seed, sorted(FEATURES).index(name), number])
    own = {key: float(random.uniform(*limits)) for key, limits in feature.values.items()}
    own |= {"b": float(random.uniform(0.02, 0.08)), "mass": float(random.uniform(0.6, 1.2))}
    rig = _rig(feature, own)
    runs = [_motion(rig, random) for _ in range(RUNS)]
    model = mujoco.MjModel.from_xml_string(rig)
    inertia = float(model.dof_M0[0]) - own.get("armature", 0.0)
    table = {column: np.concatenate([one[column] for one in runs]) for column in runs[0]}
    known = {"j": inertia, "b": own["b"]}
    free = {"j": table["a"], "b": table["v"]}
    lacking = table["torque"] - sum((known[p] * free[p] for p in feature.known), np.zeros(len(table["a"])))
    basis = np.column_stack([free[p] for p in feature.fit]) if feature.fit else np.zeros((len(lacking), 0))
    left = lacking - basis @ np.linalg.lstsq(basis, lacking, rcond=None)[0] if feature.fit else lacking
    rms = float(np.sqrt(np.mean(left * left)))
    size = float(random.uniform(*SEEN))
    noise = rms / size
    torque = table["torque"]
    table["torque"] = torque + noise * random.standard_normal(len(lacking))
    rows = len(runs[0]["q"])
    write_table(folder / "rows.csv", [f"r{n:02d}" for n in np.repeat(np.arange(RUNS), rows)], table, digits=8)
    (folder / "case.toml").write_text(_case(feature, known), encoding="utf-8")
    return Drawn(feature, folder, own, size, torque, noise)


def _case(feature: Feature, known: Mapping[str, float]) -> str:
    way, force = ("m", "N") if feature.joint == "slide" else ("rad", "N m")
    units = {"j": f"{force} s^2/{way}", "b": f"{force} s/{way}"}
    stated = "".join(f"{p} = {known[p]:.6g}\n" for p in feature.known)
    fitted = "".join(f'{p} = {{ value = 0.03, unit = "{units[p]}" }}\n' for p in feature.fit)
    return f"""[case]
title = "{feature.name}"
[model]
base = "equation"
[model.equation]
torque = "{feature.model}"
[parameters]
{stated}[fit]
{fitted}[data]
files = ["rows.csv"]
run = "run"
[data.columns]
q = {{ column = "q", unit = "{way}", is = "position" }}
v = {{ column = "v", unit = "{way}/s", is = "speed" }}
a = {{ column = "a", unit = "{way}/s^2", is = "acceleration" }}
torque = {{ column = "torque", unit = "{force}" }}
"""


def right(feature: Feature, found: Discovery) -> bool:
    """Whether the feature is named, alone or as one of few rivals."""
    sets = told(found)
    return len(sets) <= MOST_TOLD and any(_is_it(feature, found, one) for one in sets)


def _is_it(feature: Feature, found: Discovery, names: tuple[str, ...]) -> bool:
    if len(names) != 1:
        return False
    texts = {c.effect.name: c.effect.expression for c in found.candidates if c.effect.target == "torque"}
    return names[0] in feature.names or re.search(feature.formula, texts.get(names[0], "")) is not None


def one(name: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    with tempfile.TemporaryDirectory() as place:
        drawn = draw(name, number, seed, Path(place) / "case")
        case = load_case(drawn.folder)
        found = discover(case, seed=number)
    apart = distances(found, case.inputs, drawn.torque[None], np.array([drawn.noise]))
    texts = {c.effect.name: c.effect.expression for c in found.candidates if c.kind == "expression"}
    named = right(drawn.feature, found)
    good = named and is_tie(apart, exact=False)
    return {
        "left": round(drawn.left, 2),
        "named": named,
        "distances": apart,
        "right": good,
        "verdict": found.verdict,
        "said": [[texts.get(n, n) for n in names] for names in found.rivals or [found.missing]],
        "probability": round(found.answer_probability, 3),
        "wrong and sure": sure_and_wrong(found.verdict, found.answer_probability, good),
        "errors": [None if r.heldout_error is None else round(r.heldout_error, 3) for r in found.ladder],
        "first": next((texts.get(c.effect.name, c.effect.name) for c in found.candidates), ""),
    }


def table(records: list[Record]) -> str:
    """Rates by feature with 95 % limits, the worst first, and what was said where it was not right."""
    lines = [f"{'feature':16}{'cases':>6}{'right or tied':>24}{'above 0.9 and wrong':>24}{'rivals':>8}"]
    mean = {n: np.mean([r["right"] for r in records if r["family"] == n]) for n in {r["family"] for r in records}}
    names = sorted(mean, key=lambda n: (mean[n], n))
    for name in [*names, "all"]:
        mine = [r for r in records if name in (r["family"], "all")]
        hits = [sum(r["right"] for r in mine), sum(r["wrong and sure"] for r in mine)]
        rates = "".join(rate(count, len(mine)) for count in hits)
        lines.append(f"{name:16}{len(mine):6d}{rates}{rivals(mine):8.1f}")
        if name != "all":
            for r in mine:
                if not r["right"]:
                    said = " | ".join(" + ".join(names) or "-" for names in r["said"])
                    lines.append(f"    {r['number']}: {r['left']} sd, {r['verdict']} {r['probability']:.2f}: {said}")
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.mujoco_rigs", FEATURES, cases=5).parse_args()
    print(table(resumed(options, f"{options.seed}-ties", lambda name, number: one(name, number, options.seed))))


if __name__ == "__main__":
    main()
