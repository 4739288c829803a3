"""Discovery beside its peers, PySINDy and pyoperon, on the same cases. `python -m tests.bench.discovery_peers`.

All three get the same cases of tests/campaigns: nothing missing; one effect at 1 noise sd, 12 and 30 runs; two effects.
What the peers are given, so that the comparison is fair, and in their favour:
- the residual of the model fitted to the training runs, in true noise sd (discovery often has to estimate that);
- PySINDy a library that fits these cases as well as any could: for each effect of the catalogue its derivative with
  respect to the effect's size at the fitted model, for effects with a shape parameter one term for each value of a grid
  (both phases of every harmonic), and all freed of what the model's own parameters take up;
- pyoperon every numeric column and the direction of motion, EVALUATIONS of formulas, on the loudest channel.
Judged as the campaigns judge: PySINDy is right when the effects that it claims are the truth, or as good as it on these
data; pyoperon, which knows no effects, already when its formula reads only columns on which the residual depends.
A claim that is not right is a wrong claim: neither peer says how sure it is. Claims of discovery are answers with the
verdict `missing`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from tests.campaigns.drawn import CATALOGUE, Drawn
from tests.campaigns.pools import make, run
from tests.campaigns.statistics import rate_limits
from tests.campaigns.truth import SAME, SHAPES, Set, distance, refit, right_columns

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = ROOT / "build" / "peers"
LOCK = Path(__file__).with_name("requirements-peers.lock")
WORKER = Path(__file__).with_name("discovery_peers_worker.py")
ONE_THREAD = {**os.environ, **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")}
POOLS = ("nothing", "single12", "single30", "pair30")
EVALUATIONS = 500_000


def set_up() -> Path:
    """The peers' own environment, made once: their packages must not meddle with the project's."""
    python = ENVIRONMENT / "bin" / "python"
    stamp = ENVIRONMENT / "installed"
    wanted = LOCK.read_text(encoding="utf-8")
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != wanted:
        print("installing PySINDy and pyoperon (a minute)", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", "--clear", ENVIRONMENT], check=True)
        options = ["--quiet", "--no-deps", "--require-hashes", "--only-binary", ":all:"]
        subprocess.run([python, "-m", "pip", "install", *options, "-r", LOCK], check=True)
        stamp.write_text(wanted, encoding="utf-8")
    return python


def task(drawn: Drawn, seed: int, evaluations: int) -> dict[str, Any]:
    """What both peers are given. Rows of all channels one after the other for PySINDy, the loudest for pyoperon."""
    none = Set(drawn, ())
    theta, residual = refit(none)
    shape = residual.shape
    base = none.predict(theta)
    slopes = none.slopes(theta, lambda t: none.predict(t).reshape(-1), base.reshape(-1))
    held = drawn.held_out
    training = np.tile(~held, shape[0])
    names, terms = [], []
    for name, change in _terms(drawn, theta, base):
        flat = change.reshape(-1)
        taken = np.linalg.lstsq(slopes[training], flat[training], rcond=1e-10)[0]
        flat = flat - slopes @ taken
        rms = float(np.sqrt(np.mean(flat[training] ** 2)))
        if np.isfinite(rms) and rms > 1e-6:
            names.append(name)
            terms.append((flat / rms).tolist())
    columns = dict(drawn.design.columns)
    if "omega" in columns:
        columns["direction"] = np.sign(columns["omega"])
    loudest = int(np.argmax((residual[:, ~held] ** 2).sum(axis=1)))
    return {
        "sindy": {
            "peer": "pysindy",
            "names": names,
            "terms": terms,
            "residual": residual.reshape(-1).tolist(),
            "run": np.tile(drawn.design.run, shape[0]).tolist(),
            "held": np.tile(held, shape[0]).tolist(),
        },
        "operon": {
            "peer": "pyoperon",
            "column_names": list(columns),
            "columns": [v.tolist() for v in columns.values()],
            "residual": residual[loudest].tolist(),
            "run": drawn.design.run.tolist(),
            "held": held.tolist(),
            "evaluations": evaluations,
            "seed": seed,
        },
    }


def _terms(drawn: Drawn, theta: np.ndarray, base: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:  # type: ignore[type-arg]
    """Each effect's derivative (channels, rows) in noise sd, one for each combination of its shape parameters."""
    made = drawn.design
    for name, hidden in CATALOGUE[made.base].items():
        if not set(hidden.needs) <= set(made.mapped):
            continue
        chosen = Set(drawn, (name,))
        shaped = [i for i in range(len(theta), len(chosen.keys)) if chosen.keys[i] in SHAPES]
        grids = [(0.0, np.pi / 2) if chosen.keys[i] == "phase" else SHAPES[chosen.keys[i]] for i in shaped]
        for values in product(*grids):
            moved = np.concatenate([theta, np.zeros(len(chosen.keys) - len(theta))])
            moved[shaped] = values
            step = 1e-4 * {"c_w": 1e4, "f_0": 10.0}.get(hidden.size, 1.0)
            moved[chosen.sizes[0]] = step
            yield name, (chosen.predict(moved) - base) / step


def judge(peer: str, drawn: Drawn, answer: dict[str, Any]) -> dict[str, Any]:
    claim = list(answer["claim"])
    truth = sorted(drawn.hidden)
    record: dict[str, Any] = {"claims": bool(claim), "cpu": answer["cpu"], "failed": "failed" in answer}
    if not truth:
        return {**record, "right": not claim, "wrong": bool(claim), "first": None}
    if peer == "pysindy":
        right = sorted(claim) == truth or (0 < len(claim) <= len(truth) and distance(drawn, claim) < SAME)
        first = answer.get("first", "")
        named = first in truth or (bool(first) and len(truth) == 1 and distance(drawn, (first,)) < SAME)
        return {**record, "right": right, "wrong": bool(claim) and not right, "first": named}
    columns = right_columns(drawn) | {"direction"}
    right = bool(set(claim) - {"direction"}) and set(claim) <= columns
    return {**record, "right": right, "wrong": bool(claim) and not right, "first": None}


def judge_own(record: dict[str, Any]) -> dict[str, Any]:
    claims = record.get("verdict") == "missing"
    if record["kind"] == "nothing":
        alarm = record.get("p_value", 0.0) < 0.05
        return {
            "claims": alarm,
            "right": not alarm,
            "wrong": alarm,
            "first": None,
            "cpu": record["seconds"],
            "failed": "failed" in record,
        }
    right = claims and record["alike"]
    first = record.get("first_alike")
    cpu = record.get("answered", record["seconds"])
    return {
        "claims": claims,
        "right": right,
        "wrong": claims and not right,
        "first": first,
        "cpu": cpu,
        "failed": "failed" in record,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=40, help="of each pool")
    parser.add_argument("--pools", default=",".join(POOLS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, help="pyoperon's, each case")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "peers")
    arguments = parser.parse_args()
    python = set_up()
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / f"peers-{arguments.seed}-{arguments.evaluations}.jsonl"
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    have = {(r["pool"], r["number"]) for r in done}
    with subprocess.Popen(
        [python, WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ONE_THREAD
    ) as worker:
        assert worker.stdin is not None
        assert worker.stdout is not None
        for number in range(arguments.cases):
            for pool in arguments.pools.split(","):
                if (pool, number) in have:
                    continue
                drawn = make(pool, arguments.seed, number)[1]
                if drawn.design.base.startswith("equation"):
                    continue  # no catalogue to make a library of
                record: dict[str, Any] = {
                    "pool": pool,
                    "number": number,
                    "terrapin": judge_own(run(pool, arguments.seed, number)),
                }
                for asked in task(drawn, number, arguments.evaluations).values():
                    worker.stdin.write(json.dumps(asked) + "\n")
                    worker.stdin.flush()
                    record[asked["peer"]] = judge(asked["peer"], drawn, json.loads(worker.stdout.readline()))
                with file.open("a", encoding="utf-8") as opened:
                    opened.write(json.dumps(record) + "\n")
                done.append(record)
        worker.stdin.close()
    print(table([r for r in done if r["pool"] in arguments.pools.split(",") and r["number"] < arguments.cases]))
    return 0


def table(records: list[dict[str, Any]]) -> str:
    lines = [
        f"{'cases':12}{'method':12}{'cases':>6}  {'right':24}{'wrong claims':24}{'first':>7}{'cpu s':>8}{'failed':>8}"
    ]
    for pool in dict.fromkeys(r["pool"] for r in records):
        mine = [r for r in records if r["pool"] == pool]
        for peer in ("terrapin", "pysindy", "pyoperon"):
            entries = [r[peer] for r in mine]
            cells = []
            for key in ("right", "wrong"):
                hits = sum(bool(e[key]) for e in entries)
                low, high = rate_limits(hits, len(entries))
                cells.append(f"{hits / len(entries):.2f} ({low:.2f} to {high:.2f})")
            first = [bool(e["first"]) for e in entries if e["first"] is not None]
            named = f"{np.mean(first):.2f}" if first else "-"
            cpu = float(np.median([e["cpu"] for e in entries]))
            failed = sum(e["failed"] for e in entries)
            lines.append(
                f"{pool:12}{peer:12}{len(entries):6}  {cells[0]:24}{cells[1]:24}{named:>7}{cpu:8.1f}{failed:8}"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
