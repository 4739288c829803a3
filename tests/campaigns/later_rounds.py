"""Discover, add, discover again: does it end, does the held-out error ever rise, is anything false added?

    python -m tests.campaigns.later_rounds --cases 50                     of the pool mixed
    python -m tests.campaigns.later_rounds --families removed --part 1/4  a quarter of the cases; parts merge

Cases are those of pools.py, whose seed and number make them. The commands `terrapin discover` and `terrapin add` take
turns as in measured.py, at most five rounds, in the folder that a user would have. The error is the root mean square
over every row of the held-out runs, rows that discovery left out included. `false` counts catalogued effects that
were added and that the data do not hold; of effects that are one on the data the likeliest is added, so it is an upper
limit. `not the same` leaves out those whose set is the same as the truth on these data (D2 below 4, truth.py).
A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from terrapin_tools.workbench.case.case import load_case
from tests.campaigns.drawn import write
from tests.campaigns.measured import Outcome, rounds
from tests.campaigns.pools import make
from tests.campaigns.resumed import Record, parser_of, rate, resumed
from tests.campaigns.truth import SAME, distance

__all__ = ["POOLS", "one", "table"]

POOLS = ("mixed", "single12", "single30", "pair30", "removed")


def one(pool: str, number: int, seed: int) -> Record:
    """Make one case and answer it until nothing is added any more."""
    kind, drawn, _ = make(pool, seed, number)
    found = Outcome(f"{pool} {number}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write(drawn, folder)
        try:
            rounds(folder, found, "round")
        except RuntimeError as error:
            found.problems.append(f"crash: {error}"[:300])
        case = load_case(folder)
        catalogued = [name for name in case.effects if not case.library[name].title.startswith("own")]
    false = [name for name in catalogued if name not in drawn.hidden]
    return {
        "kind": kind,
        "base": drawn.design.base,
        "truth": sorted(drawn.hidden),
        "added": list(case.effects),
        "false": false,
        "unlike": bool(false) and distance(drawn, catalogued) >= SAME,
        "rounds": found.rounds,
        "crashed": any(text.startswith("crash") for text in found.problems),
        "rose": any("rose" in text for text in found.problems),
        "endless": any("still added" in text for text in found.problems),
        "problems": found.problems,
    }


def table(records: list[Record]) -> str:
    """Rates by pool; below them what went wrong."""
    what = {"crashed": "a crash", "rose": "the error rose", "endless": "more than five rounds", "false": "false added"}
    what["unlike"] = "not the same"
    lines = [f"{'pool':10}{'cases':>6}{'later rounds':>14}" + "".join(f"{title:>24}" for title in what.values())]
    for pool in dict.fromkeys(r["family"] for r in records):
        mine = [r for r in records if r["family"] == pool]
        later = sum(len(r["rounds"]) > 2 for r in mine)
        counts = [sum(bool(r[key]) for r in mine) for key in what]
        lines.append(f"{pool:10}{len(mine):6d}{later:14d}" + "".join(rate(count, len(mine)) for count in counts))
    for r in records:
        lines += [f"  {r['family']} {r['number']}: {text}" for text in r["problems"]]
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.later_rounds", POOLS, cases=50).parse_args()
    print(table(resumed(options, str(options.seed), lambda pool, number: one(pool, number, options.seed))))


if __name__ == "__main__":
    main()
