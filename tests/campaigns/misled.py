"""What misled discovery once, drawn anew: `python -m tests.campaigns.misled --cases 30`.

    python -m tests.campaigns.misled --families group,bound --part 1/2     half of two families; parts merge

A sled on three surfaces, `pull = mu*load + drag*speed` with white noise, half of the cases with no sigma stated.
group: mu has a value a surface already, and drag differs on one surface, too. bound: a term that is missing drives drag
to its bound at 0. bump: a resonance over 4 % of the speeds, 1 to 2 sd rms. part: two known terms of 8 to 20 sd rms and
a wave of 5 % of them. control: nothing is missing.

Right: every set that is told predicts what the truth does (D2 below 9); bump: not called adequate; part: what is told
reaches what both known terms do, and what is left has its size and place; control: no alarm. `sd`: of the cases that
name something right, those whose noise sd is told within 15 % of the truth.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.story.told import found_by
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import ADMISSIBLE, distances

__all__ = ["FAMILIES", "one"]

FAMILIES = ("group", "bound", "bump", "part", "control")
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
        "verdict": found.verdict,
        "missing": [_text(found, name) for name in found.missing],
        "probability": round(found.answer_probability, 3),
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
        mine = [r for r in records if r["family"] == family]
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
