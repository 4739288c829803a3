"""Noise that the engine was not told of: how often it alarms, and whether an effect is named all the same.

    python -m tests.campaigns.noises --cases 24 --size 0          nothing is missing
    python -m tests.campaigns.noises --cases 24 --size 2 --runs 30 --families offsets,rig
    python -m tests.campaigns.noises --part 1/4                    a quarter of the cases; parts merge

A case of rolling_steady is drawn as in discovery_cases.py; the noise that stands in it is replaced by that of a family
below. None of them knows the nodes of the engine's noise model. Right is no alarm where nothing is missing, else the
effect, alone or in a tie (ties.py, under the covariance that the noise was drawn with; the last column counts as if
each row's noise were its own). Results are lines of JSON, one file a setting; a rerun goes on where the last one
stopped. The table puts the worst family first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.discover.discovery import discover
from tests.campaigns.discovery_cases import ROLLING, Made, make, without_noise
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import distances, is_tie, rivals, told

__all__ = ["FAMILIES", "disturbed"]

Random = np.random.Generator
Drawn = tuple[Array, Array]  # noise (rows,) in noise sd, and its covariance (rows, rows) with the sizes that were drawn
Noise = Callable[[Index, Array, Random], Drawn]  # of the run and speed (rows,)


def same_run(run: Index) -> Array:
    return np.equal.outer(run, run).astype(float)


def place(run: Index) -> Array:
    """Of each row among those of its run."""
    row = np.concatenate([np.arange(int((run == one).sum())) for one in np.unique(run)])
    return np.asarray(row[np.argsort(np.argsort(run, kind="stable"), kind="stable")], dtype=float)


def white(run: Index, speed: Array, random: Random) -> Drawn:
    return random.standard_normal(len(run)), np.eye(len(run))


def ar1(run: Index, speed: Array, random: Random) -> Drawn:
    rho = float(random.choice([0.4, 0.8]))
    found, row = np.empty(len(run)), place(run)
    for one in np.unique(run):
        drive = random.standard_normal(int((run == one).sum()))
        drive[1:] *= np.sqrt(1.0 - rho * rho)
        found[run == one] = lfilter([1.0], [1.0, -rho], drive)
    return found, same_run(run) * rho ** np.abs(np.subtract.outer(row, row))


def offsets(run: Index, speed: Array, random: Random) -> Drawn:
    size = float(random.uniform(0.3, 1.0))
    noise, alone = white(run, speed, random)
    return noise + size * random.standard_normal(int(run.max()) + 1)[run], alone + size**2 * same_run(run)


def drift(run: Index, speed: Array, random: Random) -> Drawn:
    """A random walk over the whole test, rms 0.5 sd."""
    walk = np.cumsum(random.standard_normal(len(run)))
    walk -= walk.mean()
    noise, alone = white(run, speed, random)
    steps = np.tril(np.ones_like(alone))
    steps -= steps.mean(axis=0)
    along = steps @ steps.T
    return noise + 0.5 * walk / np.sqrt(np.mean(walk * walk)), alone + 0.25 * along / np.mean(np.diag(along))


def outliers(run: Index, speed: Array, random: Random) -> Drawn:
    odd = random.random(len(run)) < 0.01
    noise, alone = white(run, speed, random)
    return noise + odd * random.choice([-1.0, 1.0], len(run)) * random.uniform(6.0, 15.0, len(run)), alone


def tails(run: Index, speed: Array, random: Random) -> Drawn:
    return np.asarray(random.standard_t(3.0, len(run)) / np.sqrt(3.0)), np.eye(len(run))


def growing(run: Index, speed: Array, random: Random) -> Drawn:
    """The sd grows threefold from standstill to the largest speed."""
    scale = 1.0 + 2.0 * np.abs(speed) / np.abs(speed).max()
    mean = np.mean(scale * scale)
    return np.asarray(scale * random.standard_normal(len(run)) / np.sqrt(mean)), np.diag(scale * scale / mean)


def hum(run: Index, speed: Array, random: Random) -> Drawn:
    """A sine of random phase in each run, rms 0.7 sd."""
    row = place(run)
    phase, rate = random.uniform(0.0, 2.0 * np.pi, int(run.max()) + 1)[run], float(random.uniform(0.3, 2.5))
    noise, alone = white(run, speed, random)
    along = 0.5 * same_run(run) * np.cos(rate * np.subtract.outer(row, row))
    return np.asarray(noise + np.sin(rate * row + phase)), alone + along


def unlike(run: Index, speed: Array, random: Random) -> Drawn:
    """The sd differs from run to run."""
    scale = np.exp(0.5 * random.standard_normal(int(run.max()) + 1))[run]
    return np.asarray(scale * random.standard_normal(len(run))), np.diag(scale * scale)


def rig(run: Index, speed: Array, random: Random) -> Drawn:
    """A bit of everything: correlated, offsets of 0.7 sd, 1 % outliers, a fifth larger than stated."""
    noise, alone = white(run, speed, random)
    slow, along = ar1(run, speed, random)
    odd = outliers(run, speed, random)[0] - white(run, speed, random)[0]
    offset = 0.7 * random.standard_normal(int(run.max()) + 1)[run]
    values = 1.2 * (0.8 * noise + 0.6 * slow + offset + np.where(abs(odd) > 4.0, odd, 0.0))
    return np.asarray(values), 1.44 * (0.64 * alone + 0.36 * along + 0.49 * same_run(run))


FAMILIES: dict[str, Noise] = {
    "white": white, "ar1": ar1, "offsets": offsets, "drift": drift, "outliers": outliers, "tails": tails,
    "growing": growing, "hum": hum, "unlike": unlike, "rig": rig, "quantised": white, "stated": white, "inputs": white,
}  # fmt: skip


def disturbed(made: Made, family: str, random: Random) -> Case:
    """The case of `made` with the noise of a family in the place of its own."""
    return with_noise(made, family, random)[0]


def with_noise(made: Made, family: str, random: Random) -> tuple[Case, list[Array]]:
    """The same, and the covariance of that noise (rows, rows) in each channel, in noise sd; tails, outliers, rounding
    and scatter of an input are not in it, so with them data tell less apart than it says."""
    case, (model, predicted) = made.case, without_noise(made)
    speed = case.roles["omega"]
    sigma = np.array([made.sigma[c] for c in model.channels])[:, None]
    noise, covariance = zip(*(FAMILIES[family](case.run, speed, random) for _ in model.channels), strict=True)
    values = predicted + sigma * np.array(noise)
    stated, roles = {c: made.sigma[c] for c in model.channels}, dict(case.roles)
    if family == "quantised":
        values = 3.0 * sigma * np.round(values / (3.0 * sigma))
        stated = dict.fromkeys(stated)  # type: ignore[arg-type]
    elif family == "stated":
        factor = float(np.exp(random.uniform(np.log(0.5), np.log(2.0))))
        stated = {c: s * factor for c, s in stated.items()}
    elif family == "inputs":
        share = float(random.choice([0.01, 0.03]))
        roles["omega"] = speed + share * float(np.ptp(speed)) * random.standard_normal(len(speed))
    changed = replace(case, channels={c: values[i] for i, c in enumerate(model.channels)}, sigma=stated, roles=roles)
    changed.__dict__.pop("inputs", None)  # computed from the roles of before
    return changed, list(covariance)


def one(family: str, number: int, size: float, runs: int, seed: int) -> Record:
    """Make and answer one case."""
    random = np.random.default_rng([seed, sorted(FAMILIES).index(family), number, int(10 * size)])
    made = None
    while made is None:
        hidden = (str(random.choice(ROLLING)),) if size else ()
        made = make("rolling_steady", hidden, runs, 0.0, size or 1.0, random)
    case, covariance = with_noise(made, family, random)
    found = discover(case, seed=number)
    model, true = without_noise(made)
    sigma = np.array([made.sigma[c] for c in model.channels])
    apart = distances(found, made.case.inputs, true, sigma, covariance) if size else []
    strict = distances(found, made.case.inputs, true, sigma) if size else []
    named = set(made.truth) in map(set, told(found))
    return {
        "truth": list(made.truth),
        "alarm": found.analysis.missing,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "rivals": [list(r) for r in found.rivals],
        "probability": found.answer_probability,
        "right": named and is_tie(apart) if size else not found.analysis.missing,
        **({"named": named, "distances": apart, "independent": strict} if size else {}),
        "noise": found.analysis.noise.node.words(),
        "odd": int(found.analysis.odd.sum()),
    }


def table(records: list[Record]) -> str:
    """Rates by family, the worst first; 95 % limits."""
    lines = [
        f"{'family':12}{'cases':>6}{'alarm':>24}{'right or tied':>24}{'above 0.9 and wrong':>24}{'rivals':>8}"
        f"{'if independent':>24}"
    ]
    families = sorted(
        {r["family"] for r in records}, key=lambda f: np.mean([r["right"] for r in records if r["family"] == f])
    )
    for family in families:
        mine = [r for r in records if r["family"] == family]
        sure = [sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine]
        hits = [sum(r["alarm"] for r in mine), sum(r["right"] for r in mine), sum(sure)]
        rates = "".join(rate(count, len(mine)) for count in hits)
        strict = rate(sum(r["named"] and is_tie(r["independent"]) for r in mine if "named" in r), len(mine))
        lines.append(f"{family:12}{len(mine):6d}{rates}{rivals(mine):8.1f}{strict if 'named' in mine[0] else ''}")
    return "\n".join(lines)


def main() -> None:
    parser = parser_of(__doc__, "python -m tests.campaigns.noises", FAMILIES, cases=24)
    parser.add_argument(
        "--size", type=float, default=0.0, help="of the one effect that is missing, in noise sd; 0: none"
    )
    parser.add_argument("--runs", type=int, default=14)
    options = parser.parse_args()
    setting = f"{options.size:g}-{options.runs}-{options.seed}{'-covariance' if options.size else ''}"
    make = lambda family, number: one(family, number, options.size, options.runs, options.seed)  # noqa: E731
    print(table(resumed(options, setting, make)))


if __name__ == "__main__":
    main()
