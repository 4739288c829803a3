"""A number or a column of the case is wrong: is that named, and is a sound case blamed?

    python -m tests.campaigns.statements --cases 20                  every kind
    python -m tests.campaigns.statements --kinds sound --cases 100   an effect is missing, everything stated is right
    python -m tests.campaigns.statements --part 1/4                  a quarter of the cases; parts merge

Cases are drawn as in discovery_cases.py. `constant`: a stated number is off by 5 to 50 %. `scale`: a column stands in a
unit that it is not said to have. `sign`: a column lost its sign, or is turned round. `sound`: nothing is wrong, one
effect of 2 noise sd is missing. What the fitted parameters take up whole is no case and is drawn again. Right is the
wrong statement as the answer, or among those that it cannot be told from. A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.constants import constants
from terrapin_tools.workbench.model.model import Model
from tests.campaigns.discovery_cases import ROLLING, make
from tests.campaigns.statistics import rate_limits

__all__ = ["one", "spoilt"]

KINDS = ("constant", "scale", "sign", "sound")
FACTORS = (180.0 / np.pi, 30.0 / np.pi, 1000.0, 9.81)
# Effects that say the same as a wrong constant: more dry friction than stated is dry friction.
SAME = {"constant.coulomb": "coulomb_friction", "constant.viscous": "viscous_friction"}
RUNS = 14
SHOWS = 25.0  # squared misfit [noise sd], summed, from which a fault can be seen at all
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


def one(base: str, kind: str, number: int, seed: int) -> dict[str, Any]:
    """Make and answer one case."""
    random = np.random.default_rng([seed, KINDS.index(kind), number])
    while True:
        hidden: tuple[str, ...] = (str(random.choice(ROLLING)),) if kind == "sound" else ()
        made = make(base, hidden, RUNS, 0.0, 2.0, random)
        if made is None:
            continue
        case, truth = (made.case, hidden[0]) if kind == "sound" else spoilt(made.case, kind, random)
        found = discover(case, seed=number)
        rows, sigma = found.analysis.rows, found.analysis.noise.sigma
        misfit = float(((found.analysis.residual / sigma[:, None]) ** 2).sum()) - float(rows.sum()) * len(sigma)
        if kind == "sound" or misfit > SHOWS:
            break
    named = [list(found.missing), *map(list, found.rivals)] if found.missing else []
    faulty = any(name.startswith(("constant.", "table.")) for name in found.missing)
    return {
        "base": base,
        "kind": kind,
        "number": number,
        "truth": truth,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "rivals": [list(r) for r in found.rivals],
        "probability": found.answer_probability,
        "right": [truth] in named or [SAME.get(truth, truth)] in named,
        "blamed": faulty and kind == "sound",
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=20, help="a kind")
    parser.add_argument("--base", default="rolling_steady")
    parser.add_argument("--kinds", default=",".join(KINDS), help=", ".join(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", default="1/1", metavar="K/N")
    parser.add_argument("--out", type=Path, default=Path("build/statements"))
    arguments = parser.parse_args()
    part, parts = (int(text) for text in arguments.part.split("/"))
    arguments.out.mkdir(parents=True, exist_ok=True)
    stem = f"{arguments.base}-{arguments.seed}"
    file = arguments.out / f"{stem}-{part}of{parts}.jsonl"
    known = {(r["kind"], r["number"]) for r in _records(arguments.out, stem)}
    with file.open("a", encoding="utf-8") as lines:
        for kind in arguments.kinds.split(","):
            for number in range(part - 1, arguments.cases, parts):
                if (kind, number) not in known:
                    lines.write(json.dumps(one(arguments.base, kind, number, arguments.seed)) + "\n")
                    lines.flush()
                    print(f"{kind} {number + 1} of {arguments.cases}", file=sys.stderr)
    wanted = set(arguments.kinds.split(","))
    show([r for r in _records(arguments.out, stem) if r["kind"] in wanted])
    return 0


def _records(folder: Path, stem: str) -> list[dict[str, Any]]:
    found = {}
    for file in sorted(folder.glob(f"{stem}-*.jsonl")):
        for line in file.read_text(encoding="utf-8").splitlines():
            record = json.loads(line)
            found[record["kind"], record["number"]] = record
    return [found[key] for key in sorted(found)]


def _rate(hits: int, count: int) -> str:
    low, high = rate_limits(hits, count)
    return f"{100.0 * hits / count:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})".rjust(26)


def show(records: list[dict[str, Any]]) -> None:
    """One line a kind, the worst first."""
    rows = []
    for kind in sorted({r["kind"] for r in records}):
        mine = [r for r in records if r["kind"] == kind]
        right, blamed = sum(r["right"] for r in mine), sum(r["blamed"] for r in mine)
        sure = sum(not r["right"] and r["probability"] > 0.9 and r["verdict"] != "adequate" for r in mine)
        rows.append((right / len(mine), kind, len(mine), [_rate(n, len(mine)) for n in (right, blamed, sure)]))
    print(f"{'kind':10s}{'cases':>6s}{'named or tied':>26s}{'blamed though sound':>26s}{'above 0.9 and wrong':>26s}")
    for _, kind, count, rates in sorted(rows):
        print(f"{kind:10s}{count:6d}" + "".join(rates))


if __name__ == "__main__":
    sys.exit(main())
