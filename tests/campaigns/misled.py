"""What misled discovery once, drawn anew: `python -m tests.campaigns.misled --cases 30`.

    python -m tests.campaigns.misled --families group,bound --part 1/2     half of two families; parts merge

A sled on three surfaces, `pull = mu*load + drag*speed` with white noise, half of the cases with no sigma stated.
group: mu has a value a surface already, and drag differs on one surface, too. bound: a term that is missing drives drag
to its bound at 0. bump: a resonance over 4 % of the speeds, 1 to 2 sd rms. part: two known terms of 8 to 20 sd rms and
a wave of 5 % of them. control: nothing is missing. tie: a column that no role maps, `oil`, goes with the speed squared,
and is what matters; where the two are told together, the proposed runs are measured and the case is asked again (others
do not count). friction: steady rolling with dry friction and a term in the speed squared, 1 to 4 sd each.

Right: every set that is told predicts what the truth does (D2 below 9); bump: not called adequate; part: what is told
reaches what both known terms do, and what is left has its size and place; control: no alarm; tie: after the proposed
runs. `sd`: of the cases that name something right, those whose noise sd is told within 15 % of the truth.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.story.told import found_by
from tests.campaigns.discovery_cases import make, without_noise
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import ADMISSIBLE, distances

__all__ = ["FAMILIES", "one"]

FAMILIES = ("group", "bound", "bump", "part", "control", "tie", "friction")
SURFACES, RUNS, ROWS, SD, REST = ("sand", "ice", "turf"), 12, 14, 0.5, 0.05
CASE = """[model]
base = "equation"
[model.equation]
pull = "mu*load + drag*speed"
[fit]
mu = {{ value = 0.3, min = 0.0, max = 2.0{by} }}
drag = {{ value = 1.0, min = 0.0 }}
[groups]
surface = {{ column = "surface" }}
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
load = {{ column = "load", unit = "N" }}
speed = {{ column = "speed", unit = "m/s" }}
pull = {{ column = "pull", unit = "N"{sigma} }}
"""
KNOWN = {"k*load*speed": (1, 1), "k*load**2": (2, 0), "k*speed**2": (0, 2), "k*speed**3": (0, 3)}  # powers
OF_LOAD, OF_SPEED = ("k*load*speed", "k*load**2"), ("k*speed**2", "k*speed**3")


def _scaled(values: Array, rms: float, absorbed: Array) -> Array:
    """With that rms in noise sd beyond what the model's own parameters take up (rows, parameters)."""
    beyond = values - absorbed @ np.linalg.lstsq(absorbed, values, rcond=None)[0]
    return np.asarray(values * rms * SD / np.sqrt(np.mean(beyond * beyond)))


def one(family: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    special = {"tie": _tie, "friction": _friction}.get(family)
    return special(number, seed) if special is not None else _sled(family, number, seed)


def _tie(number: int, seed: int) -> Record:
    random = np.random.default_rng([seed, FAMILIES.index("tie"), number])
    names, k = ("load", "speed", "oil"), random.uniform(1.0, 2.5)
    run = np.repeat(np.arange(RUNS), ROWS)
    speed = np.repeat(random.uniform(0.3, 3.0, RUNS), ROWS) * random.uniform(0.97, 1.03, run.size)
    table = np.column_stack([random.uniform(20, 60, run.size), speed, 20.0 + 4.0 * speed**2])
    table[:, 2] += 0.1 * random.standard_normal(run.size)

    def asked(run: Index, table: Array) -> tuple[Discovery, Array]:
        load, speed, oil = table.T
        clean = 0.4 * load + 2.0 * speed + k * SD * (oil - 20.0) / 12.0
        pull = clean + SD * random.standard_normal(run.size)
        with tempfile.TemporaryDirectory() as place:
            rows = (
                f"r{r:02d},{','.join(f'{v:.9g}' for v in row)},{p:.9g},a"
                for r, row, p in zip(run, table, pull, strict=True)
            )
            (Path(place) / "runs.csv").write_text("\n".join([f"run,{','.join(names)},pull,surface", *rows]) + "\n")
            (Path(place) / "case.toml").write_text(CASE.format(by="", sigma=f", sigma = {SD}"))
            return discover(load_case(Path(place)), seed=number), clean

    found, clean = asked(run, table)
    experiment = found.experiment if found.verdict == "ambiguous" else None
    vary: tuple[str, ...] = ()
    if experiment is not None:
        vary, pieces = experiment.vary, []
        for setting in experiment.settings:
            piece = table[run == random.integers(RUNS)].copy()
            for name, value in {**experiment.hold, **setting}.items():
                if name in names:
                    piece[:, names.index(name)] = value
            pieces.append(piece)
        run = np.concatenate([run, *(np.full(len(p), RUNS + i) for i, p in enumerate(pieces))])
        table = np.concatenate([table, *pieces])
        found, clean = asked(run, table)
    apart = distances(found, found.analysis.case.inputs, clean[None], np.array([SD]))
    right = bool(apart) and all(d < ADMISSIBLE for d in apart) and found.verdict == "missing"
    return {
        **_said(found),
        "tied": experiment is not None,
        "vary": vary,
        "distances": apart,
        "right": right,
        "sd": None,
    }


def _friction(number: int, seed: int) -> Record:
    random, made = np.random.default_rng([seed, FAMILIES.index("friction"), number]), None
    while made is None:
        runs, size = int(random.integers(12, 31)), float(random.uniform(1.0, 4.0))
        made = make("rolling_steady", ("coulomb_friction", "speed_squared"), runs, 0.0, size, random)
    found = discover(made.case, seed=number)
    model, true = without_noise(made)
    apart = distances(found, made.case.inputs, true, np.array([made.sigma[c] for c in model.channels]))
    right = bool(apart) and all(d < ADMISSIBLE for d in apart)
    return {**_said(found), "distances": apart, "right": right, "sd": None}


def _said(found: Discovery) -> Record:
    missing = [_text(found, name) for name in found.missing]
    return {"verdict": found.verdict, "missing": missing, "probability": round(found.answer_probability, 3)}


def _sled(family: str, number: int, seed: int) -> Record:
    random = np.random.default_rng([seed, FAMILIES.index(family), number])
    stated = number % 2 == 0
    run = np.repeat(np.arange(RUNS), ROWS)
    surface = run % len(SURFACES)
    load, speed = random.uniform(20, 60, run.size), random.uniform(0.2, 3.0, run.size)
    mu = np.array([0.6, 0.2, 0.4]) if family == "group" else np.full(3, 0.4)
    drag, own = np.full(3, 2.0), np.column_stack([load, speed])
    truth: list[str] = []
    more = known = np.zeros(run.size)
    if family == "group":
        drag[random.integers(3)] *= random.uniform(1.5, 3.0)
    elif family == "bound":
        power = float(random.choice([1.5, 2.0, 3.0]))
        more = -(2.0 + random.uniform(0.5, 2.0)) * speed**power / np.mean(speed**power) * np.mean(speed)
    elif family == "bump":
        centre = random.uniform(0.6, 2.6)
        more = _scaled(np.exp(-(((speed - centre) / (0.02 * 2.8)) ** 2)), random.uniform(1.0, 2.0), own)
    elif family == "part":
        truth = [str(random.choice(OF_LOAD)), str(random.choice(OF_SPEED))]
        sizes = random.uniform(8.0, 20.0, 2)
        for text, size in zip(truth, sizes, strict=True):
            of_load, of_speed = KNOWN[text]
            more = more + _scaled(load**of_load * speed**of_speed, size, own)
        known = mu[surface] * load + drag[surface] * speed + more
        more = more + _scaled(np.sin(random.uniform(5.0, 8.0) * speed), REST * float(np.hypot(*sizes)), own)
    clean = mu[surface] * load + drag[surface] * speed + more
    pull = clean + SD * random.standard_normal(run.size)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        rows = (
            f"r{r:02d},{a:.9g},{v:.9g},{p:.9g},{SURFACES[s]}"
            for r, a, v, p, s in zip(run, load, speed, pull, surface, strict=True)
        )
        (folder / "runs.csv").write_text("\n".join(["run,load,speed,pull,surface", *rows]) + "\n")
        by = ', by = "surface"' if family == "group" else ""
        (folder / "case.toml").write_text(CASE.format(by=by, sigma=f", sigma = {SD}" if stated else ""))
        found = discover(load_case(folder), seed=number)
    apart = distances(found, found.analysis.case.inputs, clean[None], np.array([SD]))
    same = bool(apart) and all(d < ADMISSIBLE for d in apart)
    right = {
        "bump": found.verdict != "adequate",
        "part": family == "part" and _parts(found, known),
        "control": found.verdict == "adequate",
    }.get(family, same)
    return {
        "stated": stated,
        "truth": truth,
        **_said(found),
        "distances": apart,
        "right": bool(right),
        "sd": found_by(found).noise.sds["pull"] / SD if same and not stated else None,
    }


def _text(found: Discovery, name: str) -> str:
    expression = found.ranking.expressions.get(name)
    return name if expression is None else expression.expression


def _parts(found: Discovery, known: Array) -> bool:
    """Whether what is told reaches the two known terms (rows,), however they are written, with the place of what is
    left: that of the wave, in speed."""
    told = found_by(found).part
    if told is None or told.at.variable != "speed":
        return False
    fit = found.ladder[-1].fit
    reached, slopes = fit.model.bind(found.analysis.case.inputs).jacobian(fit.theta)
    gap, basis = (known - reached[0]) / SD, np.linalg.qr(slopes[0] / SD)[0]
    return float(np.sum((gap - basis @ (basis.T @ gap)) ** 2)) < ADMISSIBLE


def table(records: list[Record]) -> str:
    """Rates by family with 95 % limits."""
    lines = [f"{'family':12}{'cases':>6}{'right':>24}{'above 0.9 and wrong':>24}{'noise sd within 15 %':>24}"]
    for family in FAMILIES:
        mine = [r for r in records if r["family"] == family and r.get("tied", True)]
        if mine:
            sure = sum(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine)
            sds = [r["sd"] for r in mine if r["sd"] is not None]
            near = rate(sum(abs(sd - 1.0) <= 0.15 for sd in sds), len(sds)) if sds else f"{'-':>24}"
            right = rate(sum(r["right"] for r in mine), len(mine))
            lines.append(f"{family:12}{len(mine):6d}{right}{rate(sure, len(mine))}{near}")
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.misled", FAMILIES, cases=30).parse_args()
    print(table(resumed(options, str(options.seed), lambda family, number: one(family, number, options.seed))))


if __name__ == "__main__":
    main()
