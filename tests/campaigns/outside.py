"""Truths that no vocabulary holds: is the right column told, and never a made-up formula that is called sure?

    python -m tests.campaigns.outside --cases 10              of each formula
    python -m tests.campaigns.outside --part 1/4              a quarter of the cases; parts merge

Cases of rolling_steady are drawn as in discovery_cases.py, with 12 to 30 runs and white noise; one of FORMULAS, of
1.5 to 6 noise sd, is hidden. None is a shape of the engine's, or near one over the column's range. Right is
`unexplained` with the formula's column told, as that of a curve without a formula or as the first place. An answer
all of whose sets predict what the truth does (D2 below 9) is right as well. A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import numpy as np

from terrapin_tools.workbench.discover.discovery import discover
from tests.campaigns.discovery_cases import make, without_noise
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import ADMISSIBLE, distances

__all__ = ["FORMULAS", "one"]

FORMULAS = {  # target, formula, its column
    "fast in time": ("resistance", "k*sin(2*time)", "time"),
    "speed by time": ("resistance", "k*omega*sin(time/2)", "time"),
    "humidity": ("current", "k*sin(humidity/4)", "humidity"),
    "humidity by direction": ("resistance", "k*cos(humidity/3)*sign(omega)", "humidity"),
    "board": ("current", "k*sin(3*board_temp)", "board_temp"),
    "speed by board": ("resistance", "k*omega*cos(2*board_temp)", "board_temp"),
}
RUNS, SIZES = (12, 31), (1.5, 6.0)


def one(family: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    random = np.random.default_rng([seed, sorted(FORMULAS).index(family), number])
    runs, size = int(random.integers(*RUNS)), float(random.uniform(*SIZES))
    made = None
    while made is None:  # its column may not be mapped
        made = make("rolling_steady", (), runs, 0.0, size, random, expression=FORMULAS[family])
    found = discover(made.case, seed=number)
    model, true = without_noise(made)
    apart = distances(found, made.case.inputs, true, np.array([made.sigma[c] for c in model.channels]))
    curve = getattr(found, "unknown", None)
    told = curve.column if curve is not None else found.where[0].variable if found.where else ""
    same = bool(apart) and all(d < ADMISSIBLE for d in apart)
    return {
        "column": made.column,
        "told": told,
        "curve": curve is not None,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "probability": round(found.answer_probability, 3),
        "distances": apart,
        "right": (found.verdict == "unexplained" and told == made.column) or same,
    }


def table(records: list[Record]) -> str:
    """Rates by formula with 95 % limits."""
    lines = [f"{'formula':24}{'cases':>6}{'right':>24}{'a formula above 0.9':>24}"]
    for family in [*FORMULAS, "all"]:
        mine = [r for r in records if family in (r["family"], "all")]
        if mine:
            sure = sum(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine)
            lines.append(
                f"{family:24}{len(mine):6d}{rate(sum(r['right'] for r in mine), len(mine))}{rate(sure, len(mine))}"
            )
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.outside", FORMULAS, cases=10).parse_args()
    print(table(resumed(options, str(options.seed), lambda family, number: one(family, number, options.seed))))


if __name__ == "__main__":
    main()
