"""Formulas in two and three columns that a user's equation lacks, half of them in columns that go together.

    python -m tests.campaigns.several_columns --cases 200                     two columns, and three
    python -m tests.campaigns.several_columns --families three --part 1/4     a quarter of the cases; parts merge

The user knows y = p + q*u. The table has five more columns, of which the truth reads two or three; in every second
case these go together (correlation 0.85 to 0.95). Rows of a run scatter about its setting; the noise is white or AR(1),
its sd stated or not. Terms are of 1.5 to 6 noise sd, and each is needed: without it D2 is at least 25. Right is an
answer all of whose sets have D2 below 9 and no more terms than the truth, one of which reads the columns that the truth
reads. A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from tests.campaigns.drawn import noise, write_table
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import ADMISSIBLE, distances, rivals, told

__all__ = ["FORMS", "Drawn", "draw", "one", "table"]

# terms in x, y and z, columns of which each case draws its own
FORMS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "two": (("x*y",), ("x", "y"), ("x**2", "y"), ("x/y",)),
    "three": (("x*y", "z"), ("x", "y", "z"), ("x**2*y", "z"), ("x*y", "y*z")),
}
RANGES = {"a": (1.0, 5.0), "b": (-3.0, 3.0), "c": (20.0, 60.0), "d": (0.2, 0.9), "e": (-10.0, 10.0)}
POSITIVE = ("a", "c", "d")  # by these may be divided
SEEN = 25.0  # D2 from which the best test errs in 1 of 160 cases
DRAWS = 1000  # of a case at most
Random = np.random.Generator


@dataclass(frozen=True)
class Drawn:
    """A table and its truth."""

    run: Index
    columns: Mapping[str, Array]
    terms: tuple[str, ...]  # in the table's columns
    reads: frozenset[str]
    together: bool  # whether those columns go together
    true: Array  # y without noise (rows,)
    measured: Array
    sigma: float
    stated: bool
    hidden: float  # D2 without any of the terms


def _columns(random: Random, runs: int, read: Sequence[str], together: bool) -> tuple[Index, dict[str, Array]]:
    run = np.repeat(np.arange(runs), random.integers(8, 16, runs))
    rho = random.uniform(0.85, 0.95)
    common = random.standard_normal(runs)
    found = {"u": random.uniform(0.0, 10.0, runs)[run] + 0.5 * random.standard_normal(len(run))}
    for name, (low, high) in RANGES.items():
        own = random.standard_normal(runs)
        level = np.sqrt(rho) * common + np.sqrt(1.0 - rho) * own if together and name in read else own
        values = level[run] + 0.2 * random.standard_normal(len(run))
        place = (values - values.min()) / np.ptp(values)
        found[name] = low + (high - low) * place
    return run, {name: np.array([float(f"{v:.7g}") for v in values]) for name, values in found.items()}


def _left(target: Array, base: Array) -> float:
    left = target - base @ np.linalg.lstsq(base, target, rcond=None)[0]
    return float(left @ left)


def draw(family: str, number: int, seed: int) -> Drawn:
    """The case of a family and a number."""
    random = np.random.default_rng([seed, sorted(FORMS).index(family), number])
    form = FORMS[family][(number // 2) % len(FORMS[family])]
    together = number % 2 == 1
    for _ in range(DRAWS):
        runs = int(random.integers(12, 31))
        names = [str(name) for name in random.permutation(list(RANGES))]
        picked = dict(zip("xyz", names, strict=False))
        if "/y" in "".join(form) and picked["y"] not in POSITIVE:
            continue
        terms = tuple(term.translate(str.maketrans(picked)) for term in form)
        reads = frozenset(picked[letter] for letter in "xyz" if letter in "".join(form))
        run, columns = _columns(random, runs, sorted(reads), together)
        shapes = np.column_stack([parse(term).evaluate(columns) for term in terms])
        base = np.column_stack([np.ones(len(run)), columns["u"]])
        shapes = shapes / np.sqrt(np.mean((shapes - shapes.mean(axis=0)) ** 2, axis=0))
        size = random.uniform(1.5, 6.0, len(terms)) * random.choice([-1.0, 1.0], len(terms))
        missing = shapes * size  # [noise sd]
        whole = missing.sum(axis=1)
        without = [np.column_stack([base, np.delete(shapes, i, axis=1)]) for i in range(len(terms))]
        if min(_left(whole, rest) for rest in without) >= SEEN:
            break
    else:
        raise RuntimeError(f"{family} {number}: no case in {DRAWS} draws, in which each term is needed")
    known = base @ np.array([random.uniform(5.0, 20.0), random.uniform(0.5, 2.0)])
    sigma = float(f"{0.02 * np.sqrt(np.mean(known * known)) * random.uniform(0.5, 2.0):.3g}")
    true = known + sigma * whole
    measured = true + sigma * noise(run, float(random.choice([0.0, 0.5])), random)
    stated = bool(random.uniform() < 0.5)
    return Drawn(run, columns, terms, reads, together, true, measured, sigma, stated, _left(whole, base))


def write(drawn: Drawn, folder: Path) -> Path:
    """The case folder, as a user would write it."""
    names = [f"r{run:02d}" for run in drawn.run]
    write_table(folder / "rows.csv", names, {**drawn.columns, "y": drawn.measured})
    sigma = f", sigma = {drawn.sigma:.6g}" if drawn.stated else ""
    mapped = "\n".join(f'{name} = {{ column = "{name}", unit = "1" }}' for name in drawn.columns)
    (folder / "case.toml").write_text(
        '[case]\ntitle = "several columns"\n[model]\nbase = "equation"\n[model.equation]\ny = "p + q*u"\n'
        '[fit]\np = { value = 1.0 }\nq = { value = 1.0 }\n[data]\nfiles = ["rows.csv"]\nrun = "run"\n[data.columns]\n'
        f'{mapped}\ny = {{ column = "y", unit = "1"{sigma} }}\n',
        encoding="utf-8",
    )
    return folder


def _texts(found: Discovery) -> dict[str, str]:
    every = {effect.name: effect.expression for effect in found.ranking.expressions.values()}
    return {**{c.effect.name: c.effect.expression for c in found.candidates}, **every}


def one(family: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    made = draw(family, number, seed)
    with tempfile.TemporaryDirectory() as place:
        case = load_case(write(made, Path(place)))
        found = discover(case, seed=number)
    apart = distances(found, case.inputs, made.true[None], np.array([made.sigma]))
    texts = _texts(found)
    said = [[texts.get(name, name) for name in names] for names in told(found)]
    reads = [set(re.findall(r"\b[a-e]\b", " ".join(names))) for names in said]
    admissible = all(d < ADMISSIBLE for d in apart) and all(len(names) <= len(made.terms) for names in said)
    return {
        "truth": list(made.terms),
        "together": made.together,
        "stated": made.stated,
        "hidden": round(made.hidden, 1),
        "verdict": found.verdict,
        "said": said,
        "probability": found.answer_probability,
        "distances": apart,
        "right": bool(said) and admissible and set(made.reads) in reads,
    }


def table(records: Sequence[Record]) -> str:
    """Rates with 95 % limits by number of columns, and apart for columns that go together."""
    lines = [f"{'columns':18}{'cases':>6}{'right or tied':>24}{'another above 0.9':>24}{'rivals':>8}"]
    kinds = [(f, together) for f in FORMS for together in (False, True)]
    for family, together in kinds:
        mine = [r for r in records if r["family"] == family and r["together"] == together]
        if mine:
            lines.append(_line(f"{family}{', together' if together else ''}", mine))
    return "\n".join([*lines, _line("all", records)])


def _line(title: str, mine: Sequence[Record]) -> str:
    sure = sum(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine)
    rates = "".join(rate(count, len(mine)) for count in (sum(r["right"] for r in mine), sure))
    return f"{title:18}{len(mine):6d}{rates}{rivals(mine):8.1f}"


def main() -> None:
    options = parser_of(__doc__, "python -m tests.campaigns.several_columns", FORMS, cases=20).parse_args()
    print(table(resumed(options, str(options.seed), lambda family, number: one(family, number, options.seed))))


if __name__ == "__main__":
    main()
