"""How often discovery is right: campaigns of cases with known answers. `python tests/campaigns/discovery_campaign.py`.

Prints for each kind of case the rates that docs/rates.md quotes, the reliability of the probabilities, and what map
of log odds would make them exact. Each case depends on the seed and its own number only.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from discovery_cases import CONTACT, HIDDEN, ROLLING, confounded, make

from terrapin_tools.workbench.compare.comparison import error, fitted_on
from terrapin_tools.workbench.discover.discovery import discover

KINDS = ("adequate", "single", "pair", "ambiguous", "hidden")


def one(job: tuple[str, int, dict]) -> dict | None:  # type: ignore[type-arg]
    """Make and answer one case."""
    kind, number, options = job
    random = np.random.default_rng([options["seed"], KINDS.index(kind), number])
    runs = int(options["runs"] or random.integers(8, 31))
    rho = float(options["rho"] if options["rho"] is not None else random.choice([0.0, 0.0, 0.5, 0.8, 0.95]))
    size = float(options["size"] or random.choice([0.5, 1.0, 2.0, 4.0]))
    base = options["base"] or ("rolling_steady" if random.uniform() < 0.7 else "sphere_contact")
    known = bool(random.uniform() < 0.75)
    if base == "sphere_contact":
        runs = max(runs, 12)
    rivals: set[frozenset[str]] = set()
    names = ROLLING if base == "rolling_steady" else CONTACT
    if kind == "ambiguous":
        made, rivals = confounded(random, runs, rho, max(size, 1.0))
    elif kind == "hidden":
        choice = HIDDEN[base][int(random.integers(len(HIDDEN[base])))]
        made = make(base, (), runs, rho, max(size, 1.0), random, known, expression=choice)
    else:
        count = {"adequate": 0, "single": 1, "pair": 2}[kind]
        hidden = tuple(str(n) for n in random.choice(names, count, replace=False))
        made = make(base, hidden, runs, rho, size, random, known)
    if made is None:
        return None
    begin = time.process_time()
    found = discover(made.case, seed=number)
    seconds = time.process_time() - begin
    truth = set(made.truth)
    listed = [frozenset(r) for r in found.rivals]
    named = set(found.missing)
    expressions = [c for c in found.candidates if c.effect.name in named and c.kind == "expression"]
    result = {
        "kind": kind,
        "number": number,
        "base": made.case.base.name,
        "runs": runs,
        "rho": rho,
        "size": made.size,
        "known": known,
        "truth": sorted(truth),
        "column": made.column,
        "verdict": found.verdict,
        "missing": sorted(named),
        "rivals": [sorted(r) for r in listed],
        "probability": found.answer_probability,
        "seconds": seconds,
        "p_value": found.analysis.adequacy.p_value,
        "first": found.candidates[0].effect.name if found.candidates else "",
        "where": found.where[0].variable if found.where else "",
        "candidates": [(c.effect.name, c.probability) for c in found.candidates],
        "expression": [c.effect.expression for c in expressions],
    }
    if kind == "hidden":
        column = next((h.column for h in found.ranking.hypotheses if h.effects == tuple(found.missing)), "")
        result["right"] = (found.verdict == "missing" and column == made.column) or (
            found.verdict == "unexplained" and result["where"] == made.column
        )
        result["named_right"] = found.verdict == "missing" and column == made.column
    elif kind == "ambiguous":
        result["right"] = found.verdict == "ambiguous" and rivals <= set(listed)
        result["named_right"] = named == truth
    elif kind == "adequate":
        result["right"] = found.verdict == "adequate"
        result["named_right"] = result["right"]
    else:
        result["right"] = found.verdict == "missing" and named == truth
        result["named_right"] = named == truth
    if found.verdict == "missing" and kind in ("single", "pair"):
        sigma = np.array([made.sigma[c] for c in found.analysis.model.channels])
        oracle = error(fitted_on(made.case, sorted(truth), made.case.train, sigma)[-1], made.case.test, sigma)
        after = error(found.ladder[-1].fit, made.case.test, sigma)
        result["ratio"] = None if not oracle or after is None else after / oracle
    return result


def table(results: list[dict]) -> str:  # type: ignore[type-arg]
    """Rates by kind, runs and size."""
    heads = ("kind", "base", "size", "n", "right", "alarm", "first", "conf.wrong", "ratio95", "s")
    lines = ["{:10}{:15}{:>6}{:>5}{:>7}{:>7}{:>7}{:>11}{:>9}{:>6}".format(*heads)]
    keys = sorted({(r["kind"], r["base"], r["size"] if r["kind"] != "adequate" else 0.0) for r in results})
    for kind, base, size in keys:
        mine = [
            r for r in results if (r["kind"], r["base"]) == (kind, base) and (kind == "adequate" or r["size"] == size)
        ]
        right = np.mean([r["right"] for r in mine])
        alarm = np.mean([r["verdict"] != "adequate" for r in mine])
        first = np.mean([r["first"] in r["truth"] for r in mine])
        wrong = np.mean([r["verdict"] == "missing" and r["probability"] > 0.9 and not r["named_right"] for r in mine])
        ratios = [r["ratio"] for r in mine if r.get("ratio")]
        tail = np.quantile(ratios, 0.95) if ratios else float("nan")
        seconds = np.mean([r["seconds"] for r in mine])
        lines.append(
            f"{kind:10}{base:15}{size:6.1f}{len(mine):5d}{right:7.2f}{alarm:7.2f}{first:7.2f}"
            f"{wrong:11.3f}{tail:9.3f}{seconds:6.1f}"
        )
    return "\n".join(lines)


def reliability(results: list[dict]) -> str:  # type: ignore[type-arg]
    """Answer probabilities against the rate at which the answer was right."""
    p = np.array([r["probability"] for r in results if r["verdict"] != "unexplained"])
    right = np.array([r["named_right"] for r in results if r["verdict"] != "unexplained"], dtype=float)
    lines = ["answer probability: given, observed, cases"]
    edges = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0])
    total = 0.0
    for low, high in pairwise(edges):
        inside = (p > low) & (p <= high)
        if inside.any():
            lines.append(f"  {p[inside].mean():.3f}  {right[inside].mean():.3f}  {inside.sum()}")
            total += inside.sum() * abs(p[inside].mean() - right[inside].mean())
    lines.append(f"expected calibration error {total / max(1, len(p)):.3f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=40, help="of each kind")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int)
    parser.add_argument("--rho", type=float)
    parser.add_argument("--size", type=float)
    parser.add_argument("--base", choices=["rolling_steady", "sphere_contact"])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, help="append results, one line a case")
    arguments = parser.parse_args()
    options = {key: getattr(arguments, key) for key in ("seed", "runs", "rho", "size", "base")}
    jobs = [(kind, number, options) for number in range(arguments.cases) for kind in arguments.kinds.split(",")]
    results = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for result in pool.map(one, jobs):
            if result is not None:
                results.append(result)
                if arguments.json:  # as they come: a campaign that is cut short still says something
                    with arguments.json.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(result) + "\n")
    print(table(results))
    print(reliability(results))


if __name__ == "__main__":
    main()
