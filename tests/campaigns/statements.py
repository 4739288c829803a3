"""A number or a column of the case is wrong: is that named, and is a sound case blamed?

    python -m tests.campaigns.statements --cases 20                  every kind
    python -m tests.campaigns.statements --families sound --cases 100   an effect is missing, everything stated is right
    python -m tests.campaigns.statements --part 1/4                  a quarter of the cases; parts merge

Cases are drawn as in discovery_cases.py. `constant`: a stated number is off by 5 to 50 %. `scale`: a column stands in a
unit that it is not said to have. `sign`: a column lost its sign, or is turned round. `sound`: nothing is wrong, one
effect of 2 noise sd is missing. What the fitted parameters take up whole is no case and is drawn again. Right is the
wrong statement as the answer, or in a tie (ties.py). A rerun goes on where the last one stopped.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.constants import constants, named
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.model.table_faults import at_fault
from tests.campaigns.discovery_cases import ROLLING, make, unreached, without_noise
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import distances, is_tie, rivals, told

__all__ = ["KINDS", "one", "spoilt"]

KINDS = ("constant", "scale", "sign", "sound")
FACTORS = (180.0 / np.pi, 30.0 / np.pi, 1000.0, 9.81)
# Effects that say the same as a wrong constant: more dry friction than stated is dry friction.
SAME = {"constant.coulomb": "coulomb_friction", "constant.viscous": "viscous_friction"}
RUNS = 14
SHOWS = 25.0  # squared misfit of the data without noise [noise sd], summed, from which a fault can be seen at all
Random = np.random.Generator


def spoilt(case: Case, kind: str, random: Random) -> tuple[Case, str]:
    """The case with one wrong statement, and the suspect that would put it right."""
    columns = {**case.roles, **case.channels}
    if kind == "constant":
        name = str(random.choice([effect.name.partition(".")[2] for effect in constants(Model.of(case, ()))]))
        times = 1.0 + float(random.choice([-1.0, 1.0]) * random.uniform(0.05, 0.5))
        return replace(case, parameters={**case.parameters, name: times * case.parameters[name]}), f"constant.{name}"
    read = [name for name in columns if name in (*case.base.needs, *case.base.channels)]
    both = [name for name in read if (columns[name] > 0.0).any() and (columns[name] < 0.0).any()]
    name = str(random.choice(read if kind == "scale" else both or read))
    if kind == "scale":
        factor = float(random.choice(FACTORS)) ** float(random.choice([-1.0, 1.0]))
        return _with(case, name, factor * columns[name], factor), f"table.{name}.scale"
    if random.random() < 0.5:
        return _with(case, name, -columns[name], 1.0), f"table.{name}.scale"
    return _with(case, name, np.abs(columns[name]), 1.0), f"table.{name}.sign"


def _with(case: Case, name: str, values: Any, factor: float) -> Case:
    if name in case.roles:
        return replace(case, roles={**case.roles, name: values})
    sigma = {c: s if c != name or s is None else s * factor for c, s in case.sigma.items()}
    return replace(case, channels={**case.channels, name: values}, sigma=sigma)


def one(base: str, kind: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    random = np.random.default_rng([seed, KINDS.index(kind), number])
    while True:
        hidden: tuple[str, ...] = (str(random.choice(ROLLING)),) if kind == "sound" else ()
        made = make(base, hidden, RUNS, 0.0, 2.0, random)
        if made is None:
            continue
        model, true = without_noise(made)
        clean = replace(made.case, channels=dict(zip(model.channels, true, strict=True)), sigma=dict(made.sigma))
        case, truth = made.case, "".join(hidden)
        if kind == "sound":
            break
        clean = spoilt(clean, kind, deepcopy(random))[0]
        case, truth = spoilt(made.case, kind, random)
        fitted = analyse(case, number)
        if unreached(fitted, np.array([clean.channels[c] for c in model.channels]), fitted.noise.sigma) > SHOWS:
            break
    found = discover(case, seed=number)
    true, sigma = (np.array([known[c] for c in model.channels]) for known in (clean.channels, clean.sigma))
    apart = distances(found, clean.inputs, true, sigma)
    hit = any((name,) in told(found) for name in (truth, SAME.get(truth, truth)))
    faulty = any(named(name) or at_fault(name) for name in found.missing)
    return {
        "truth": truth,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "rivals": [list(r) for r in found.rivals],
        "probability": found.answer_probability,
        "named": hit,
        "distances": apart,
        "right": hit and is_tie(apart),
        "blamed": faulty and kind == "sound",
    }


def table(records: list[Record]) -> str:
    """Rates by kind, the worst first."""
    lines = [
        f"{'kind':10}{'cases':>6}{'named or tied':>24}{'blamed though sound':>24}{'above 0.9 and wrong':>24}"
        f"{'rivals':>8}"
    ]
    of_kind = {kind: [r for r in records if r["family"] == kind] for kind in {r["family"] for r in records}}
    for kind, mine in sorted(of_kind.items(), key=lambda one: (sum(r["right"] for r in one[1]) / len(one[1]), one[0])):
        sure = [sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine]
        hits = [sum(r["right"] for r in mine), sum(r["blamed"] for r in mine), sum(sure)]
        rates = "".join(rate(count, len(mine)) for count in hits)
        lines.append(f"{kind:10}{len(mine):6d}{rates}{rivals(mine):8.1f}")
    return "\n".join(lines)


def main() -> None:
    parser = parser_of(__doc__, "python -m tests.campaigns.statements", KINDS, cases=20)
    parser.add_argument("--base", default="rolling_steady", help="base model of the cases; rolling_steady")
    options = parser.parse_args()
    make = lambda kind, number: one(options.base, kind, number, options.seed)  # noqa: E731
    print(table(resumed(options, f"{options.base}-{options.seed}-ties", make)))


if __name__ == "__main__":
    main()
