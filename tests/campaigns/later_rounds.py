"""Discover, add, discover again: does it end, does the held-out error ever rise, is anything false added?

    python -m tests.campaigns.later_rounds --cases 50                     of the pool mixed
    python -m tests.campaigns.later_rounds --families removed --part 1/4  a quarter of the cases; parts merge
    python -m tests.campaigns.later_rounds --practice DIR                 cases of somebody else with answers.json

Cases are those of pools.py, whose seed and number make them. The commands `terrapin discover` and `terrapin add` take
turns as in measured.py, at most five rounds, in the folder that a user would have. The error is the root mean square
over every row of the held-out runs, rows that discovery left out included. `false` counts catalogued effects that
were added and that the data do not hold; of effects that are one on the data the likeliest is added, so it is an upper
limit. `not the same` leaves out those whose set is the same as the truth on these data (D2 below 4, truth.py).
A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Collection
from pathlib import Path

from terrapin_tools.workbench.case.case import load_case
from tests.campaigns.drawn import write
from tests.campaigns.measured import Outcome, rounds
from tests.campaigns.pools import make
from tests.campaigns.resumed import Record, parser_of, rate, resumed
from tests.campaigns.truth import SAME, distance

__all__ = ["POOLS", "given", "one", "table"]

POOLS = ("mixed", "single12", "single30", "pair30", "removed")


def one(pool: str, number: int, seed: int) -> Record:
    """Make one case and answer it until nothing is added any more."""
    kind, drawn, _ = make(pool, seed, number)
    with tempfile.TemporaryDirectory() as place:
        write(drawn, Path(place))
        found = _answered(Path(place), f"{pool} {number}", drawn.hidden)
    effects = found.pop("catalogued")
    unlike = bool(found["false"]) and distance(drawn, effects) >= SAME
    return {"kind": kind, "base": drawn.design.base, "truth": sorted(drawn.hidden), **found, "unlike": unlike}


def given(folder: Path) -> list[Record]:
    """Cases of somebody else, copied before they are changed. Of rivals that tie any may be added."""
    records = []
    for name, expected in sorted(json.loads((folder / "answers.json").read_text(encoding="utf-8")).items()):
        true = {*expected["truth"], *(effect for rival in expected.get("rivals", ()) for effect in rival)}
        with tempfile.TemporaryDirectory() as place:
            shutil.copytree(folder / name, Path(place), dirs_exist_ok=True)
            found = _answered(Path(place), name, true)
        records.append({"family": "practice", "number": name, **found, "unlike": bool(found["false"])})
    return records


def _answered(folder: Path, label: str, true: Collection[str]) -> Record:
    """What the rounds came to, of a case in a folder that may be changed."""
    found = Outcome(label)
    try:
        rounds(folder, found, "round")
    except RuntimeError as error:
        found.problems.append(f"crash: {error}"[:300])
    case = load_case(folder)
    catalogued = [name for name in case.effects if not case.library[name].title.startswith("own")]
    return {
        "added": list(case.effects),
        "catalogued": catalogued,
        "false": [name for name in catalogued if name not in true],
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
    parser = parser_of(__doc__, "python -m tests.campaigns.later_rounds", POOLS, cases=50)
    parser.add_argument("--practice", type=Path, metavar="DIR", help="answer the cases there, and no others")
    options = parser.parse_args()
    if options.practice:
        print(table(given(options.practice)))
        return
    print(table(resumed(options, str(options.seed), lambda pool, number: one(pool, number, options.seed))))


if __name__ == "__main__":
    main()
