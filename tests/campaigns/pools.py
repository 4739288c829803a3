"""Pools of cases, and one case of each made, answered and held against its answer. A record depends on
(seed, pool, number) and on the program only. Fixed before any result was looked at:

pool      cases  drawn
nothing    2000  nothing missing; rho of NULL_RHOS, 8 to 30 runs, all bases and equations; `compare`'s test alone
single12    600  one effect of the catalogue at 1 noise sd, 12 runs; rho of RHOS; half of them rolling, the rest sphere
                 and wheel
single30    600  the same with 30 runs
pair30      400  two effects at 1 noise sd each, 30 runs
mixed      2000  as a user's cases may come: nothing missing 15 %, one effect 45 %, two 10 %, tied 10 %, a term that no
                 catalogue has 20 %; 8 to 30 runs; sizes of SIZES, one in five 4 noise sd
tied        300  two effects that are one on these data, 2 or 4 noise sd, 12 to 30 runs; then the proposed experiment
removed     300  12 to 30 runs, 1, 2 or 4 noise sd; the true effect taken out of the catalogue (a quarter: equations)
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.told import told
from tests.campaigns.drawn import Drawn, draw, write
from tests.campaigns.followup import after_experiment
from tests.campaigns.truth import SAME, distance, oracle_heldout, power, right_columns

__all__ = ["POOLS", "run"]

Record = dict[str, Any]
POOLS: Mapping[str, int] = {
    "nothing": 2000,
    "single12": 600,
    "single30": 600,
    "pair30": 400,
    "mixed": 2000,
    "tied": 300,
    "removed": 300,
}
ORDER = ("nothing", "single12", "single30", "pair30", "mixed", "tied", "removed")  # part of each case's seed
RHOS = (0.0, 0.5, 0.8, 0.9)
NULL_RHOS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98)
SIZES = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0)
BASES = ("rolling_steady", "sphere_contact", "rolling_steady", "wheel_contact")
OPEN_BASES = (
    *("rolling_steady", "equation:pipe", "sphere_contact"),
    *("equation:carriage", "rolling_steady", "wheel_contact", "equation:winding"),
)
TIES = (  # base, confounding, the two
    ("rolling_steady", "speed", ("speed_squared", "aerodynamic_drag")),
    ("sphere_contact", "pass", ("rate_effect", "multipass")),
    ("rolling_steady", "direction", ("coulomb_friction", "current_offset")),
    ("wheel_contact", "pass", ("rate_effect", "multipass")),
    ("rolling_steady", "slope", ("slope", "current_offset")),
    ("rolling_steady", "ramp", ("inertia", "viscous_friction")),
)
KINDS = ("nothing",) * 3 + ("single",) * 9 + ("pair",) * 2 + ("tied",) * 2 + ("foreign",) * 4


def make(pool: str, seed: int, number: int) -> tuple[str, Drawn, np.random.Generator]:
    """The kind of case, the case, and the random numbers left over."""
    random = np.random.default_rng([seed, ORDER.index(pool), number])
    rho = RHOS[number % 4]
    base = BASES[(number // 4) % 4]
    if pool == "nothing":
        rho = NULL_RHOS[number % 8]
        base = OPEN_BASES[(number // 8) % 7]
        return pool, draw(base, int(random.integers(8, 31)), rho, 0.0, random, long=_long(base, random)), random
    if pool in ("single12", "single30", "pair30"):
        count = 2 if pool == "pair30" else 1
        drawn = draw(base, int(pool[-2:]), rho, 1.0, random, count, long=_long(base, random))
        return ("pair" if count == 2 else "single"), drawn, random
    if pool == "mixed":
        kind = KINDS[int(random.integers(len(KINDS)))]
        size = 4.0 if random.uniform() < 0.2 else float(random.choice(SIZES))
        runs = int(random.integers(8, 31))
    elif pool == "tied":
        kind, size, runs = "tied", (2.0, 4.0)[(number // 24) % 2], int(random.integers(12, 31))
        rho = RHOS[(number // 6) % 4]
    else:
        kind, size, runs = "removed", (1.0, 2.0, 4.0)[(number // 4) % 3], int(random.integers(12, 31))
    if kind == "tied":
        base, tied, pair = TIES[int(random.integers(len(TIES)))] if pool == "mixed" else TIES[number % 6]
        hidden = [str(random.choice(pair))]
        return kind, draw(base, runs, rho, size, random, hidden, tied=tied, long=_long(base, random)), random
    if kind == "removed":
        equation = number % 4 == 3
        base = f"equation:{('pipe', 'carriage', 'winding')[(number // 4) % 3]}" if equation else base
        rho = RHOS[(number // 3) % 4]
        return kind, draw(base, runs, rho, size, random, 0 if equation else 1, equation), random
    if kind == "foreign":
        base = OPEN_BASES[(number // 4) % 7]
    count = {"nothing": 0, "single": 1, "pair": 2, "foreign": 0}[kind]
    long = _long(base, random)
    return kind, draw(base, runs, rho, size, random, count, kind == "foreign", long=long), random


def _long(base: str, random: np.random.Generator) -> bool:
    return bool(random.uniform() < (0.125 if base.endswith("contact") else 0.0625))


def run(pool: str, seed: int, number: int) -> Record:
    """One case. What the engine could not answer is a record with `failed`, and counts as wrong everywhere."""
    kind, drawn, random = make(pool, seed, number)
    record: Record = {
        "pool": pool,
        "seed": seed,
        "number": number,
        "kind": kind,
        "base": drawn.design.base,
        "runs": drawn.design.runs,
        "rows": len(drawn.design.run),
        "rho": drawn.rho,
        "size": drawn.size,
        "known": drawn.known_sigma,
        "truth": sorted(drawn.hidden) or ([drawn.foreign[0].text] if drawn.foreign else []),
    }
    with tempfile.TemporaryDirectory() as folder:
        write(drawn, Path(folder))
        begin = time.process_time()
        try:
            case = load_case(Path(folder))
            if pool == "nothing":
                record["p_value"] = analyse(case, seed=number).adequacy.p_value
            else:
                _judge(record, kind, drawn, case, random, Path(folder))
        except ImportError:
            raise  # the program is not whole
        except Exception as error:  # an engine that falls over is a result, not the end of the campaign
            record["failed"] = f"{type(error).__name__}: {error}"[:300]
        record["seconds"] = round(time.process_time() - begin, 3)
    return record


def _answer(case: Case, seed: int) -> Record:
    found = discover(case, seed=seed)
    return answer(told(found.analysis, found))


def _judge(record: Record, kind: str, drawn: Drawn, case: Case, random: np.random.Generator, folder: Path) -> None:
    if kind == "removed" and drawn.hidden:
        record["p_with"] = analyse(case, seed=record["number"]).adequacy.p_value
        case = replace(case, library={n: e for n, e in case.library.items() if n not in drawn.hidden})
    begin = time.process_time()
    answer = _answer(case, record["number"])
    record["answered"] = round(time.process_time() - begin, 3)
    missing = list(answer["missing"])
    candidates = answer["candidates"]
    record.update(
        verdict=answer["verdict"],
        missing=missing,
        rivals=answer["rivals"],
        probability=answer["answer_probability"],
        p_value=answer["adequacy"]["p_value"],
        first=candidates[0]["effect"] if candidates else "",
        where=answer["where"][0]["variable"] if answer["where"] else "",
        candidates=[[c["effect"], c["probability"]] for c in candidates],
    )
    truth = sorted(drawn.hidden)
    if kind == "nothing":
        record["right"] = answer["verdict"] == "adequate"
        record["alike"] = record["right"]
        return
    record["d2_nothing"] = distance(drawn, ())
    record["power"] = power(record["d2_nothing"])
    if kind == "pair":
        record["d2_single"] = min(distance(drawn, (name,)) for name in truth)
    expressions = {c["effect"]: c["expression"] for c in candidates if c["kind"] == "expression"}
    if kind in ("foreign", "removed"):
        columns = right_columns(drawn)
        record["columns"] = sorted(columns)
        read = set(re.findall(r"[A-Za-z_]\w*", " ".join(expressions.get(name, "") for name in missing)))
        own = bool(missing) and set(missing) <= set(expressions)  # a wave may need two: its sine and its cosine
        record["right"] = (
            answer["verdict"] == "missing" and own and bool(read & {*columns, *(f"{c}_" for c in columns)})
        )
        record["right_where"] = record["where"] in columns
        record["expressions"] = [expressions.get(name, "") for name in missing]
    else:
        record["right"] = bool(missing) and sorted(missing) == truth
    record["alike"] = record["right"] or (
        bool(missing) and len(missing) <= max(1, len(truth)) and distance(drawn, missing) < SAME
    )
    if kind == "single":
        first = record["first"]
        record["first_right"] = first in truth
        record["first_alike"] = first in truth or (first not in expressions and distance(drawn, (first,)) < SAME)
        record["intervals"] = _intervals(drawn, candidates)
    if missing:
        noise_sd = {c: answer["channels"][c]["noise_sd"] for c in drawn.channels}
        record["ratio"] = answer["ladder"][-1]["heldout_error"] / oracle_heldout(drawn, noise_sd)
    if record["pool"] == "tied":
        _settle(record, drawn, answer, random, folder)


def _intervals(drawn: Drawn, candidates: list[Record]) -> list[list[Any]]:
    """[parameter, value, sd, true value] of the true effect, added alone; whole numbers have no interval."""
    ((effect, true),) = drawn.hidden.items()
    found = []
    for candidate in candidates:
        if candidate["effect"] == effect:
            for name, entry in candidate["parameters"].items():
                if name == "k":
                    continue
                target = true[name]
                if name == "phase":
                    target += 2 * np.pi * round((entry["value"] - target) / (2 * np.pi))
                found.append([f"{effect}.{name}", entry["value"], entry["sd"], target])
    return found


def _settle(record: Record, drawn: Drawn, answer: Record, random: np.random.Generator, folder: Path) -> None:
    """Tied effects: were both named as rivals, and does the proposed experiment leave the true one?"""
    pair = TIES[record["number"] % 6][2]
    record["said"] = answer["verdict"] == "ambiguous" and all([name] in answer["rivals"] for name in pair)
    experiment = answer["next_experiment"]
    record["proposed"] = experiment is not None
    if not record["said"] or experiment is None:
        return
    record["vary"], record["new_runs"] = experiment["vary"], experiment.get("runs", len(experiment["settings"]))
    longer = after_experiment(drawn, experiment, random)
    after = _answer(load_case(write(longer, folder / "after")), record["number"])
    record["after"] = {"verdict": after["verdict"], "missing": after["missing"], "rivals": after["rivals"]}
    record["settled"] = after["verdict"] == "missing" and sorted(after["missing"]) == record["truth"]
