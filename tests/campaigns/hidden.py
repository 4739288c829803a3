"""Effects of the catalogue whose distance to every other answer is known: are they seen, and named?

    python -m tests.campaigns.hidden --cases 200                       every family
    python -m tests.campaigns.hidden --families twin --part 1/4        a quarter of the cases; parts merge

Cases are drawn by drawn.py, whose formulas share no line with the program; D2 is that of truth.py. One case of ten is a
contact rig, the others roll. Families:

single12, single30   one effect of 1 noise sd, 12 or 30 runs; correlation of the noise 0, 0.5, 0.8, 0.9 in turn. Right
                     is the effect as the first candidate, or one with D2 below 4
small                one effect of 2 sd, 14 runs; the noise sd is stated 10 to 50 % too small. Right is the effect,
                     alone or in a tie (ties.py); `noise told`: once it is added, compare says that the noise is larger
twin                 two effects of 2 to 50 sd, one of which has an exact twin in the catalogue; without either of the
                     two D2 is at least 25. Right is a tie with the truth among its sets
apart                one or two effects of 1 to 4 sd; every other set of as many of the catalogue has D2 of at least 25.
                     Right is the truth alone

A case whose D2 without anything missing is below 4 is set aside, and counted. A rerun goes on where the last stopped.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.compare.noise_findings import noise_findings
from terrapin_tools.workbench.discover.discovery import discover
from tests.campaigns.drawn import CATALOGUE, Drawn, draw, write
from tests.campaigns.pools import RHOS, TIES
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import distances, is_tie, rivals, told
from tests.campaigns.truth import SAME, distance

__all__ = ["FAMILIES", "one", "table"]

FAMILIES = ("single12", "single30", "small", "twin", "apart")
SEEN = 25.0  # D2 from which the best test errs in 1 of 160 cases
EXACT = 0.01  # D2 of a set with a twin in the place of a member
DRAWS = 1000  # of a case at most
Random = np.random.Generator


def _twin(number: int, random: Random) -> Drawn:
    contact = number % 10 == 9
    ties = [tie for tie in TIES if tie[0].endswith("contact") == contact]
    base, tied, pair = ties[(number // 10 if contact else number) % len(ties)]
    others = sorted(set(CATALOGUE[base]) - set(pair))
    for _ in range(DRAWS):
        hidden = [str(random.choice(pair)), str(random.choice(others))]
        size, runs = float(np.exp(random.uniform(np.log(2.0), np.log(50.0)))), int(random.integers(14, 31))
        try:
            drawn = draw(base, runs, RHOS[(number // 4) % 2], size, random, hidden, tied=tied)
        except RuntimeError:  # this size is beyond what one of them can be
            continue
        other = next(name for name in pair if name != hidden[0])
        if not set(CATALOGUE[base][other].needs) <= set(drawn.design.mapped):  # no twin where a column lacks
            continue
        if all(_d2(drawn, (name,)) >= SEEN for name in hidden) and _d2(drawn, (other, hidden[1])) < EXACT:
            return drawn
    raise RuntimeError(f"twin {number}: no case in {DRAWS} draws")


def _apart(number: int, random: Random) -> Drawn:
    base, count = _base(number), 1 + number % 2
    for _ in range(DRAWS):
        size, runs = float(random.uniform(1.0, 4.0)), int(random.choice([14, 30]))
        drawn = draw(base, runs, RHOS[(number // 2) % 2], size, random, count)
        if all(_d2(drawn, names) >= SEEN for names in _others(drawn)):
            return drawn
    raise RuntimeError(f"apart {number}: no case in {DRAWS} draws")


def _d2(drawn: Drawn, names: tuple[str, ...]) -> float:
    """NaN, which is neither near nor far, where the formulas of a contact give no number on the way."""
    try:
        return distance(drawn, names)
    except ValueError:
        return float("nan")


def _others(drawn: Drawn) -> list[tuple[str, ...]]:
    """Sets of the catalogue with at most as many effects as are hidden, and not those; nearest kin first."""
    truth, mapped = set(drawn.hidden), set(drawn.design.mapped)
    known = CATALOGUE[drawn.design.base]
    possible = sorted(name for name, one in known.items() if set(one.needs) <= mapped)
    sets = [names for count in range(len(truth) + 1) for names in combinations(possible, count)]
    return sorted((names for names in sets if set(names) != truth), key=lambda names: -len(truth & set(names)))


def _base(number: int) -> str:
    return "sphere_contact" if number % 10 == 9 else "rolling_steady"


def drawn(family: str, number: int, seed: int) -> Drawn:
    """A case of a family."""
    random = np.random.default_rng([seed, FAMILIES.index(family), number])
    if family == "twin":
        return _twin(number, random)
    if family == "apart":
        return _apart(number, random)
    if family == "small":
        return draw(_base(number), 14, 0.0, 2.0, random, 1)
    return draw(_base(number), int(family[-2:]), RHOS[number % 4], 1.0, random, 1)


def one(family: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    made = drawn(family, number, seed)
    written, factor = made, 1.0
    if family == "small":
        factor = float(np.random.default_rng([seed, number]).uniform(0.5, 0.9))
        written = replace(made, known_sigma=True, sigma={c: factor * s for c, s in made.sigma.items()})
    with tempfile.TemporaryDirectory() as place:
        folder = write(written, Path(place))
        case = load_case(folder)
        found = discover(case, seed=number)
        channels = found.analysis.model.channels
        true, sigma = (np.array([values[c] for c in channels]) for values in (made.clean, made.sigma))
        apart = distances(found, case.inputs, true, sigma)
        loud = family == "small" and _larger(folder, found.missing)
    truth = tuple(sorted(made.hidden))
    among = truth in (tuple(sorted(names)) for names in told(found))
    first = found.candidates[0].effect.name if found.candidates else ""
    right = among and is_tie(apart)
    if family.startswith("single"):
        right = first in truth or distance(made, (first,)) < SAME
    elif family == "twin":
        right = right and found.verdict == "ambiguous"
    elif family == "apart":
        right = found.verdict == "missing" and tuple(sorted(found.missing)) == truth
    return {
        "base": made.design.base,
        "truth": list(truth),
        "size": round(made.size, 2),
        "hidden": round(distance(made, ()), 1),
        "stated": round(factor, 3),
        "alarm": found.analysis.missing,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "rivals": [list(names) for names in found.rivals],
        "first": first,
        "probability": found.answer_probability,
        "among": among,
        "distances": apart,
        "right": right,
        "loud": loud,
    }


def _larger(folder: Path, added: Sequence[str]) -> bool:
    """Whether the noise is told to be larger than stated once these effects of the catalogue are added."""
    path = folder / "case.toml"
    text = path.read_text(encoding="utf-8")
    if not set(added) <= set(load_case(folder).library):
        return False
    names = ", ".join(f'"{name}"' for name in added)
    path.write_text(text.replace("effects = []", f"effects = [{names}]", 1), encoding="utf-8")
    return any(one.kind == "larger" for one in noise_findings(analyse(load_case(folder))))


def _denies(record: Record) -> bool:
    """Whether an answer says `unexplained` at 0.5 or more of what the catalogue has."""
    return record["verdict"] == "unexplained" and record["probability"] >= 0.5


def table(records: Sequence[Record]) -> str:
    """Rates by family with 95 % limits; what is set aside counts nowhere else."""
    lines = [
        f"{'family':10}{'cases':>6}{'aside':>6}{'alarm':>24}{'right':>24}{'above 0.9 and right':>24}"
        f"{'above 0.9 and wrong':>24}{'unexplained':>24}{'noise told':>24}{'rivals':>8}"
    ]
    for family in [name for name in FAMILIES if any(r["family"] == name for r in records)]:
        every = [r for r in records if r["family"] == family]
        mine = [r for r in every if r["hidden"] >= SAME]
        right = [r["among"] if family.startswith("single") else r["right"] for r in mine]
        sure = [sure_and_wrong(r["verdict"], r["probability"], good) for r, good in zip(mine, right, strict=True)]
        hits = [
            sum(r["alarm"] for r in mine),
            sum(r["right"] for r in mine),
            sum(
                good and r["verdict"] == "missing" and r["probability"] > 0.9
                for r, good in zip(mine, right, strict=True)
            ),
            sum(sure),
            sum(_denies(r) for r in mine),
            sum(r["loud"] for r in mine),
        ]
        rates = "".join(rate(count, len(mine)) for count in hits) if mine else ""
        lines.append(f"{family:10}{len(every):6d}{len(every) - len(mine):6d}{rates}{rivals(mine):8.1f}")
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.hidden", FAMILIES, cases=20).parse_args()
    print(table(resumed(options, str(options.seed), lambda family, number: one(family, number, options.seed))))


if __name__ == "__main__":
    main()
