"""Bodies that move: an effect is switched on in the simulation of a dynamic base and hidden from the case.

    python -m tests.campaigns.dynamic --cases 20                        of each base
    python -m tests.campaigns.dynamic --families cmr --part 1/4         a quarter of the cases; parts merge

Each case has six runs whose inputs are drawn; its effect takes turns among those of the base, its size is drawn. Noise,
white or AR(1) with 0.5, is drawn so that 1.5 to 5 noise sd (rms, in the loudest channel) of the effect are left where
the model's own parameters follow. The simulation is the program's own: what is asked here is whether the search tells
effects apart that a body carries on through its motion. Right is the effect, alone or in a tie of at most four
(ties.py); a case that is refused is wrong. A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.dynamic import simulate
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import error, fitted_on
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from tests.campaigns.drawn import noise, write_table
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import MOST_TOLD, distances, is_tie, rivals, told

__all__ = ["BODIES", "Body", "draw", "one", "right", "table"]

RUNS = 6
SEEN = (1.5, 5.0)  # noise sd (rms) of the effect beyond the model's own parameters
Random = np.random.Generator
Range = tuple[float, float]


@dataclass(frozen=True)
class Body:
    """A dynamic base: ranges of its fitted parameters and of its effects' parameters, channels with the sd that their
    sensors might have, seconds between rows and rows of a run, and further columns, each one value a run."""

    fitted: Mapping[str, Range]
    effects: Mapping[str, Mapping[str, Range]]
    channels: Mapping[str, tuple[str, float]]
    drive: tuple[str, str]  # the input that drives it, with its unit
    step: float
    rows: int
    settings: Mapping[str, tuple[str, Range]]
    known: Mapping[str, float]  # parameters that the case states


@dataclass(frozen=True)
class Drawn:
    """A case and its truth: the effect that it lacks, what is measured without noise (rows,), and the noise's sd."""

    case: Case
    effect: str
    true: Mapping[str, Array]
    sigma: Mapping[str, float]


WAVE = (0.0, 6.28)
BODIES: Mapping[str, Body] = {
    "cmr": Body(
        {"f_o": (0.05, 0.12)},
        {
            "viscous_friction": {"b": (0.002, 0.008)},
            "speed_squared": {"f_s": (8e-4, 3e-3)},
            "coulomb_friction": {"da": (0.004, 0.012)},
            "inertia": {"j": (0.003, 0.012)},
            "sensor_delay": {"delay": (0.02, 0.06)},
            "slope": {"gain": (1.0, 1.0)},
            "shell_imbalance": {"m_e": (0.006, 0.02), "phase": WAVE},
            "current_offset": {"i_0": (0.02, 0.06)},
            "winding_temperature": {"a_r": (0.003, 0.006)},
            "motor_heating": {"a_t": (0.001, 0.003)},
        },
        {"omega": ("rad/s", 0.02), "current": ("A", 0.004)},
        ("voltage", "V"),
        0.04,
        45,
        {"slope": ("rad", (-0.05, 0.05)), "temperature": ("degC", (20.0, 45.0))},
        {},
    ),
    "pendulum_sphere": Body(
        {"f_o": (0.01, 0.04), "viscous": (0.15, 0.6)},
        {
            "speed_squared": {"f_s": (0.004, 0.02)},
            "coulomb_friction": {"da": (0.05, 0.3)},
            "inertia": {"j": (0.02, 0.1)},
            "sensor_delay": {"delay": (0.02, 0.06)},
            "slope": {"gain": (1.0, 1.0)},
            "shell_imbalance": {"m_e": (0.05, 0.3), "phase": WAVE},
        },
        {"torque": ("N m", 0.01), "rolling_angle": ("rad", 0.003)},
        ("joint_rate", "rad/s"),
        0.04,
        100,
        {"slope": ("rad", (-0.03, 0.03))},
        {},
    ),
    "vehicle": Body(
        {"k_s": (3e5, 5e5), "friction_angle": (0.5, 0.6)},
        {
            "multipass": {"kappa": (0.15, 0.5)},
            "relaxation_length": {"longer": (0.1, 0.6)},
            "tyre_flexibility": {"e": (1e-6, 4e-6)},
            "load_transfer": {"rise": (0.1, 0.5)},
            "viscous_friction": {"b": (1.0, 4.0)},
            "sensor_delay": {"delay": (0.04, 0.12)},
        },
        {f"omega_{wheel}": ("rad/s", 0.1) for wheel in ("fl", "fr", "rl", "rr")},
        ("drive_torque", "N m"),
        0.04,
        45,
        {},
        {"n": 0.71, "cohesion": 1146.8, "shear_modulus": 0.036},
    ),
}


def _driven(name: str, clock: Array, random: Random) -> Array:
    """The driving input of one run (rows,)."""
    span = clock[-1]
    if name == "voltage":  # two steps, either way round
        first, second = random.uniform(2.5, 9.0, 2)
        steps = np.where(clock < random.uniform(0.3, 0.7) * span, first, second)
        return np.asarray(steps * random.choice([-1.0, 1.0]))
    if name == "joint_rate":  # up, held, and down again
        top, rise = random.uniform(0.8, 2.6), random.uniform(0.2, 0.4)
        shape = np.interp(clock / span, [0.0, rise, 0.75, 1.0], [0.0, 1.0, 1.0, random.uniform(0.2, 1.0)])
        return np.asarray(top * shape * random.choice([-1.0, 1.0]))
    knots = np.linspace(0.0, span, 5)
    return np.asarray(np.interp(clock, knots, [0.0, *random.uniform(200.0, 1500.0, 4)]))


def draw(base: str, number: int, seed: int, folder: Path) -> Drawn:
    """A case in a folder, and its truth."""
    body, random = BODIES[base], np.random.default_rng([seed, list(BODIES).index(base), number])
    effect = list(body.effects)[number % len(body.effects)]
    clock = body.step * np.arange(body.rows, dtype=np.float64)
    while True:
        theta = {name: float(random.uniform(*limits)) for name, limits in body.fitted.items()}
        own = {name: float(random.uniform(*limits)) for name, limits in body.effects[effect].items()}
        columns: dict[str, list[Array]] = {}
        for _ in range(RUNS):
            inputs = {"time": clock, body.drive[0]: _driven(body.drive[0], clock, random)}
            for name, (_, limits) in body.settings.items():
                inputs[name] = np.full(body.rows, random.uniform(*limits))
            moved = simulate(base, {**theta, **body.known}, inputs, {effect: own}).channels
            for name, values in {**inputs, **{c: moved[c] for c in body.channels}}.items():
                columns.setdefault(name, []).append(np.asarray(values))
        table = {name: np.concatenate(parts) for name, parts in columns.items()}
        if not all(np.isfinite(values).all() for values in table.values()):
            continue
        rough = {c: sd for c, (_, sd) in body.channels.items()}
        left = _left(_written(folder, base, table, theta, rough))
        if left > 1e-3:  # else the model's own parameters take up everything
            break
    times = left / random.uniform(*SEEN)
    sigma = {c: times * sd for c, sd in rough.items()}
    rho = float(random.choice([0.0, 0.5]))
    true = {c: table[c] for c in sigma}
    for c, sd in sigma.items():
        table[c] = table[c] + sd * noise(np.repeat(np.arange(RUNS), body.rows), rho, random)
    case = _written(folder, base, table, theta, sigma if random.random() < 0.5 else {})
    return Drawn(case, effect, true, sigma)


def _left(case: Case) -> float:
    """What the model's own parameters leave of the effect, rms in the sd of `case`, where it is loudest."""
    names = [c for c in case.base.channels if c in case.channels]
    sigma = np.array([case.sigma[c] for c in names], dtype=np.float64)
    every = replace(case, train=np.ones(case.rows, dtype=bool))
    fit = fitted_on(every, (), every.train, sigma)[-1]
    each = [error(fit, every.train, np.where(np.arange(len(names)) == i, sigma, 1e12)) for i in range(len(names))]
    return float(max(one or 0.0 for one in each) * np.sqrt(len(names)))


def _written(
    folder: Path, base: str, table: Mapping[str, Array], theta: Mapping[str, float], sigma: Mapping[str, float]
) -> Case:
    body = BODIES[base]
    write_table(folder / "runs.csv", [f"r{r}" for r in np.repeat(np.arange(RUNS), body.rows)], table, digits=8)
    units = {"time": "s", body.drive[0]: body.drive[1], **{n: u for n, (u, _) in body.settings.items()}}
    lines = ["[case]", f'title = "{base}"', "[model]", f'base = "{base}"', "[parameters]"]
    lines += [f"{name} = {value!r}" for name, value in body.known.items()] + ["[fit]"]
    for name in theta:
        low, high = body.fitted[name]
        lines.append(f"{name} = {{ value = {0.5 * (low + high):g}, min = {0.2 * low:g}, max = {3.0 * high:g} }}")
    lines += ["[data]", 'files = ["runs.csv"]', 'run = "run"', "[data.columns]"]
    lines += [f'{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in units.items()]
    for name, (unit, _) in body.channels.items():
        stated = f", sigma = {sigma[name]:.6g}" if name in sigma else ""
        lines.append(f'{name} = {{ column = "{name}", unit = "{unit}"{stated} }}')
    (folder / "case.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_case(folder)


def right(found: Discovery, effect: str) -> bool:
    return len(told(found)) <= MOST_TOLD and (effect,) in told(found)


def one(base: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    with tempfile.TemporaryDirectory() as place:
        drawn = draw(base, number, seed, Path(place) / "case")
        case, effect = drawn.case, drawn.effect
        begin = time.perf_counter()
        try:
            found = discover(case, seed=number)
        except UserError as error:
            answer = {"truth": effect, "verdict": "refused", "probability": 0.0, "told": [], "right": False}
            return {**answer, "why": str(error), "errors": [], "seconds": round(time.perf_counter() - begin, 1)}
        seconds = time.perf_counter() - begin
    texts = {name: f"{e.target}: {e.expression}" for name, e in found.ranking.expressions.items()}
    channels = found.analysis.fit.model.channels
    true, sigma = (np.array([known[c] for c in channels]) for known in (drawn.true, drawn.sigma))
    apart = distances(found, case.inputs, true, sigma)
    named = right(found, effect)
    return {
        "truth": effect,
        "verdict": found.verdict,
        "probability": found.answer_probability,
        "told": [[texts.get(name, name) for name in names] for names in told(found)],
        "named": named,
        "distances": apart,
        "right": named and is_tie(apart),
        "errors": [round(found.ladder[0].train_error, 3), round(found.ladder[-1].train_error, 3)],
        "seconds": round(seconds, 1),
    }


def table(records: list[Record]) -> str:
    """Rates by base, the worst first; below them what was said instead."""
    lines = [f"{'base':18}{'cases':>6}{'named or tied':>24}{'above 0.9 and wrong':>24}{'rivals':>8}{'seconds':>9}"]
    of_base = {base: [r for r in records if r["family"] == base] for base in {r["family"] for r in records}}
    for base, mine in sorted(of_base.items(), key=lambda one: (sum(r["right"] for r in one[1]) / len(one[1]), one[0])):
        sure = sum(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine)
        rates = rate(sum(r["right"] for r in mine), len(mine)) + rate(sure, len(mine))
        lines.append(f"{base:18}{len(mine):6d}{rates}{rivals(mine):8.1f}{np.median([r['seconds'] for r in mine]):9.1f}")
    for r in records:
        if not r["right"]:
            said = " | ".join(" + ".join(names) for names in r["told"]) or r.get("why", "-")
            lines.append(f"  {r['family']} {r['number']}, {r['truth']}: {r['verdict']} {r['probability']:.2f}  {said}")
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.dynamic", list(BODIES), cases=20).parse_args()
    print(table(resumed(options, f"{options.seed}-ties", lambda base, number: one(base, number, options.seed))))


if __name__ == "__main__":
    main()
