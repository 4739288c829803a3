"""A blind set: what is hidden in each case is sealed by a hash before discovery runs on any of them.

    python -m tests.campaigns.blind seal --cases 60 --answers out/blind.json     prints the seal; commit it first
    python -m tests.campaigns.blind run --answers out/blind.json                 runs, and publishes what failed

The cases are mixed: nothing, one effect or a pair under a noise drawn among the foreign families (noises.py), a wrong
constant, scale or sign (statements.py), and rigs in MuJoCo (mujoco_rigs.py). Their seed is drawn by the operating
system and stands in the answers alone. `run` refuses answers whose SHA-256 is not among the seals of results/blind.txt.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import secrets
import sys
import tempfile
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.model.fitting import fit_model
from terrapin_tools.workbench.model.model import Model
from tests.campaigns import mujoco_rigs
from tests.campaigns.discovery_cases import CONTACT, ROLLING, Made, make, without_noise
from tests.campaigns.noises import FAMILIES, disturbed
from tests.campaigns.resumed import rate, sure_and_wrong
from tests.campaigns.statements import SAME, spoilt
from tests.campaigns.ties import MOST_TOLD, told
from tests.campaigns.truth import SAME as NOT_VISIBLE

__all__ = ["KINDS", "answers", "judged", "seal_of"]

SEALS = Path(__file__).parent / "results" / "blind.txt"
KINDS = ("nothing", "effect", "contact", "pair", "constant", "scale", "sign", "mujoco")
SIZES = (1.5, 4.0)  # noise sd, rms, of each effect
Random = np.random.Generator


def _drawn(kind: str, random: Random) -> tuple[Made, str]:
    """A case of a kind, its statements still sound, and the family of its noise."""
    base, pool = ("sphere_contact", CONTACT) if kind == "contact" else ("rolling_steady", ROLLING)
    count = {"effect": 1, "contact": 1, "pair": 2}.get(kind, 0)
    runs, family = int(random.choice([14, 30])), str(random.choice(sorted(FAMILIES)))
    while True:
        hidden = tuple(str(name) for name in random.choice(pool, count, replace=False))
        size = float(random.uniform(*SIZES))
        made = make(base, hidden, runs, 0.0, size, random)
        if made is not None:
            return made, family if base == "rolling_steady" else "as stated"


def _case(kind: str, number: int, seed: int, place: Path) -> tuple[Case, dict[str, Any], float]:
    """A case, its answer, and D2 of a fault (truth.py), inf of all else; the same for the same arguments."""
    random = np.random.default_rng([seed, number])
    if kind == "mujoco":
        name = str(random.choice(sorted(mujoco_rigs.FEATURES)))
        drawn = mujoco_rigs.draw(name, number, seed, place / str(number))
        return load_case(drawn.folder), {"truth": [name]}, np.inf
    made, family = _drawn(kind, random)
    case = made.case if family == "as stated" else disturbed(made, family, random)
    truth, visible = list(made.truth), np.inf
    if kind in ("constant", "scale", "sign"):
        visible = _left(made, kind, deepcopy(random))
        case, fault = spoilt(case, kind, random)
        truth = [fault]
    return case, {"truth": truth, "noise": family}, visible


def _left(made: Made, kind: str, random: Random) -> float:
    """What the model's own parameters leave of a fault, squared, in noise sd: as if each row's noise were its own."""
    model, true = without_noise(made)
    sound = replace(made.case, channels=dict(zip(model.channels, true, strict=True)), sigma=dict(made.sigma))
    case = spoilt(sound, kind, random)[0]
    case.__dict__.pop("inputs", None)  # computed from the roles of before
    model = Model.of(case)
    values, sigma = (np.array([of[c] for c in model.channels]) for of in (case.channels, case.sigma))
    return fit_model(model.bind(case.inputs), values, sigma, [model.start]).cost


def answers(cases: int, seed: int) -> dict[str, Any]:
    """What is hidden, case by case: the kinds in turn."""
    with tempfile.TemporaryDirectory() as place:
        listed = []
        for number in range(cases):
            kind = KINDS[number % len(KINDS)]
            listed.append({"kind": kind, **_case(kind, number, seed, Path(place))[1]})
    return {"seed": seed, "cases": listed}


def seal_of(text: str) -> str:
    """SHA-256 of the answers as they stand in the file."""
    return hashlib.sha256(text.encode()).hexdigest()


def judged(kind: str, truth: Sequence[str], found: Discovery) -> bool:
    """Whether the truth is named, or among at most three rivals; of nothing, whether no alarm was raised."""
    sets = [set(names) for names in told(found)]
    if kind == "nothing":
        return not found.analysis.missing
    if kind == "mujoco":
        return mujoco_rigs.right(mujoco_rigs.FEATURES[truth[0]], found)
    wanted = {SAME.get(name, name) for name in truth}
    few = len(sets) <= MOST_TOLD
    return few and (set(truth) in sets or wanted in sets)


def run(sealed: dict[str, Any]) -> list[dict[str, Any]]:
    """Discovery on every case of the set."""
    records = []
    with tempfile.TemporaryDirectory() as place:
        for number, answer in enumerate(sealed["cases"]):
            case, again, visible = _case(answer["kind"], number, sealed["seed"], Path(place))
            if {"kind": answer["kind"], **again} != answer:
                raise SystemExit(f"case {number} is not the one that was sealed: the campaigns' code has changed")
            found = discover(case, seed=number)
            good = judged(answer["kind"], answer["truth"], found)
            records.append(
                {
                    "number": number,
                    **answer,
                    "verdict": found.verdict,
                    "said": [list(s) for s in found.rivals or (found.missing,) if s],
                    "probability": round(found.answer_probability, 3),
                    "right": good,
                    "wrong and sure": sure_and_wrong(found.verdict, found.answer_probability, good),
                    "visible": round(visible, 1) if np.isfinite(visible) else None,
                }
            )
            print(f"{number + 1} of {len(sealed['cases'])}", file=sys.stderr)
    return records


def table(records: list[dict[str, Any]]) -> str:
    """Rates by kind, the worst first; without faults that the model's own parameters take up; each failure."""
    lines = [f"{'kind':10}{'cases':>6}{'right or tied':>24}{'above 0.9 and wrong':>24}"]
    of_kind = {kind: [r for r in records if r["kind"] == kind] for kind in {r["kind"] for r in records}}
    listed = sorted(of_kind.items(), key=lambda one: (sum(r["right"] for r in one[1]) / len(one[1]), one[0]))
    shown = [r for r in records if r["visible"] is None or r["visible"] >= NOT_VISIBLE]
    for kind, mine in [*listed, ("all", records), ("visible", shown)]:
        hits = [sum(r["right"] for r in mine), sum(r["wrong and sure"] for r in mine)]
        lines.append(f"{kind:10}{len(mine):6d}" + "".join(rate(count, len(mine)) for count in hits))
    for r in records:
        if not r["right"]:
            said = " | ".join(" + ".join(names) for names in r["said"]) or "-"
            hidden = " + ".join(r["truth"]) or "nothing"
            visible = "" if r["visible"] is None else f", D2 {r['visible']}"
            noise = f"{r.get('noise', '')}{visible}"
            lines.append(f"  {r['number']}: {hidden} ({noise}): {r['verdict']} {r['probability']}: {said}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns.blind", description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=("seal", "run"))
    parser.add_argument("--answers", type=Path, required=True, metavar="FILE")
    parser.add_argument("--cases", type=int, default=60, help="to seal; 60")
    parser.add_argument("--out", type=Path, metavar="FILE", help="result lines of `run`")
    options = parser.parse_args()
    if options.what == "seal":
        text = json.dumps(answers(options.cases, secrets.randbits(48)), indent=1)
        options.answers.parent.mkdir(parents=True, exist_ok=True)
        options.answers.write_text(text, encoding="utf-8")
        print(f"{seal_of(text)}  {options.cases} cases: put this line into {SEALS.name} and commit it before `run`")
        return
    text = options.answers.read_text(encoding="utf-8")
    if seal_of(text) not in SEALS.read_text(encoding="utf-8"):
        raise SystemExit(f"{options.answers}: its seal does not stand in {SEALS}")
    records = run(json.loads(text))
    if options.out is not None:
        options.out.write_text("".join(json.dumps(r) + "\n" for r in records), encoding="utf-8")
    print(table(records))


if __name__ == "__main__":
    main()
