"""Is a stated probability a rate? Mixtures under the foreign noise families, in five groups.

    python -m tests.campaigns.calibration --cases 30 --seed 1          of each group
    python -m tests.campaigns.calibration --part 1/4                   a quarter of the cases; parts merge
    python -m tests.campaigns.calibration --fit --seed 1               the map of probability that these cases ask for

A case is of rolling_steady with 14 or 30 runs under a noise of noises.py; a third lacks nothing, a third one effect, a
third a pair of effects or a formula in one column, each of 1 to 3 noise sd. A claim is the first answer: `adequate` is
right where at most 4 (squared, noise sd, beyond the model's own parameters) is missing; `missing` and `ambiguous` where
their first set is what is hidden (of a formula: one in its column); `unexplained` where a formula is hidden. The table
also counts what is above 0.9 and wrong, and of these the sets that are not the same as the truth on these data (D2).
"""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from tests.campaigns.discovery_cases import HIDDEN, ROLLING, Made, make, unreached, without_noise
from tests.campaigns.noises import disturbed
from tests.campaigns.resumed import Record, parser_of, rate, resumed
from tests.campaigns.ties import distances
from tests.campaigns.truth import SAME

__all__ = ["GROUPS", "drawn", "expected_error", "fitted", "one"]

GROUPS = {
    "independent": ("white", "growing", "unlike", "quantised", "stated"),
    "correlated": ("ar1", "hum", "drift"),
    "between runs": ("offsets", "rig"),
    "odd rows": ("outliers", "tails"),
    "inputs": ("inputs",),
}
KINDS = ("nothing", "effect", "pair", "nothing", "effect", "formula")
SIZES = (1.0, 3.0)
BINS = 10
Random = np.random.Generator


def _made(kind: str, random: Random) -> Made:
    count = {"effect": 1, "pair": 2}.get(kind, 0)
    formulas = HIDDEN["rolling_steady"]
    while True:
        hidden = tuple(str(name) for name in random.choice(ROLLING, count, replace=False))
        formula = formulas[int(random.integers(len(formulas)))] if kind == "formula" else None
        runs, size = int(random.choice([14, 30])), float(random.uniform(*SIZES))
        made = make("rolling_steady", hidden, runs, 0.0, size, random, expression=formula)
        if made is not None:
            return made


def _right(made: Made, found: Discovery, left: float) -> bool:
    if found.verdict == "adequate":
        return left < SAME
    if found.verdict == "unexplained":
        return bool(made.column)
    first = set(found.missing)
    if not made.column:
        return first == set(made.truth)
    columns = {found.ranking.columns.get(name) for name in first}
    return len(first) == 1 and columns == {made.column}


def drawn(group: str, number: int, seed: int) -> tuple[Made, Case, str]:
    """One case with its answer, as it is measured, and the family of its noise."""
    random = np.random.default_rng([seed, sorted(GROUPS).index(group), number])
    kind, family = KINDS[number % len(KINDS)], str(random.choice(GROUPS[group]))
    made = _made(kind, random)
    return made, disturbed(made, family, random), family


def one(group: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    kind = KINDS[number % len(KINDS)]
    made, case, family = drawn(group, number, seed)
    found = discover(case, seed=number)
    model, true = without_noise(made)
    sigma = np.array([made.sigma[c] for c in model.channels])
    left = unreached(found.analysis, true, sigma) if made.truth or made.column else 0.0
    away = distances(found, made.case.inputs, true, sigma)[0] if found.missing else left
    return {
        "kind": kind,
        "noise": family,
        "truth": [*made.truth, *([made.column] if made.column else [])],
        "hidden": round(left, 1),
        "distance": round(away, 1),
        "verdict": found.verdict,
        "missing": list(found.missing),
        "probability": found.answer_probability,
        "right": _right(made, found, left),
    }


def expected_error(records: list[Record]) -> tuple[float, float]:
    """Expected calibration error in ten equal bins, and that of a perfect program for these probabilities (mean of
    1,000 draws)."""
    p = np.array([r["probability"] for r in records])
    right = np.array([r["right"] for r in records], dtype=float)
    place = np.minimum((p * BINS).astype(int), BINS - 1)

    def error(outcome: Array) -> float:
        gaps = np.bincount(place, outcome - p, minlength=BINS)
        return float(np.abs(gaps).sum() / len(p))

    random = np.random.default_rng(0)
    perfect = np.mean([error((random.random(len(p)) < p).astype(float)) for _ in range(1000)])
    return error(right), float(perfect)


def fitted(records: list[Record]) -> dict[str, tuple[float, float]]:
    """Slope and shift of the log odds, by verdict, by penalised maximum likelihood (a prior case for and against)."""
    from scipy.optimize import minimize

    found = {}
    for verdict in sorted({r["verdict"] for r in records}):
        mine = [r for r in records if r["verdict"] == verdict]
        p = np.clip([r["probability"] for r in mine], 1e-6, 1.0 - 1e-6)
        odds, right = np.log(p / (1.0 - p)), np.array([r["right"] for r in mine], dtype=float)

        def loss(x: Array, odds: Array = odds, right: Array = right) -> float:
            z = x[0] * odds + x[1]
            near = (x[0] - 1.0) ** 2 + x[1] ** 2  # one prior unit: few cases move the map little
            return float(np.logaddexp(0.0, -z) @ right + np.logaddexp(0.0, z) @ (1.0 - right) + near)

        slope, shift = minimize(loss, [1.0, 0.0]).x
        found[verdict] = (round(float(slope), 2), round(float(shift), 2))
    return found


def table(records: list[Record]) -> str:
    """Expected error by group, the worst first; then stated and found rate by verdict."""
    lines = [f"{'group':14}{'cases':>6}{'stated':>9}{'right':>9}{'error':>9}{'a perfect one':>15}"]
    of_group = {g: [r for r in records if r["family"] == g] for g in {r["family"] for r in records}}
    ordered = sorted(of_group.items(), key=lambda one: -expected_error(one[1])[0])
    of_verdict = {v: [r for r in records if r["verdict"] == v] for v in sorted({r["verdict"] for r in records})}
    for name, mine in [*ordered, ("all", records), *of_verdict.items()]:
        stated, right = (float(np.mean([r[key] for r in mine])) for key in ("probability", "right"))
        error, perfect = expected_error(mine)
        lines.append(f"{name:14}{len(mine):6d}{stated:9.3f}{right:9.3f}{error:9.3f}{perfect:15.3f}")
    sure = [r for r in records if not r["right"] and r["probability"] > 0.9]
    apart = sum(r["verdict"] != "missing" or r["distance"] >= SAME for r in sure)
    limits = [rate(count, len(records)).strip() for count in (len(sure), apart)]
    return "\n".join([*lines, f"above 0.9 and wrong: {limits[0]}; not the same as the truth: {limits[1]}"])


def main() -> None:
    parser = parser_of(__doc__, "python -m tests.campaigns.calibration", GROUPS, cases=30)
    parser.add_argument("--fit", action="store_true", help="also print the map that these cases ask for")
    options = parser.parse_args()
    records = resumed(options, str(options.seed), lambda group, number: one(group, number, options.seed))
    print(table(records))
    if options.fit:
        print(fitted(records))


if __name__ == "__main__":
    main()
