"""Two decisions on the same rankings, paired: `python -m tests.campaigns.paired --cases 15 --out now`.

    python -m tests.campaigns.paired --cache DIR --out old.jsonl           with one program
    python -m tests.campaigns.paired --cache DIR --out new.jsonl           with another; what was weighed is read again
    python -m tests.campaigns.paired --out new.jsonl --against old.jsonl   the table of both

Search and evidence take nearly all the time, so what they give is kept in the cache (pickled; a change of theirs asks
for a new folder) and only the decision is made again. The cases, and what counts as right, are those of the campaigns.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
from scipy.stats import binomtest

from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.discover.decide import with_curves
from terrapin_tools.workbench.discover.discovery import LEVEL, Discovery, decided, weighed
from terrapin_tools.workbench.story.answer import answer as as_json
from terrapin_tools.workbench.story.told import told
from tests.campaigns import calibration, practice
from tests.campaigns.resumed import Record, sure_and_wrong

__all__ = ["FAMILIES", "NotKept", "cases", "compared", "keep_weighed", "one"]

# The families of each campaign that take part; fixed before any answer was seen. `--cases` of each.
FAMILIES: Mapping[str, tuple[str, ...]] = {
    "calibration": ("independent", "correlated", "between runs", "odd rows", "inputs"),
    "hidden": ("single12", "single30", "small", "twin", "apart"),
    "statements": ("constant", "scale", "sign", "sound"),
    "several_columns": ("two", "three"),
    "mujoco_rigs": ("friction loss", "backlash", "off-centre mass", "gain"),
    "outside": ("fast in time", "speed by time", "humidity", "humidity by direction", "board", "speed by board"),
    "pools": ("mixed", "tied", "pair30", "removed"),
    "nothing": ("white", "ar1", "offsets", "drift", "outliers", "growing"),
    "dynamic": ("cmr",),
}


def keep_weighed(folder: Path) -> None:
    """What each campaign weighs is kept in a folder from now on, and read again from there."""
    cached = Cached(folder)
    for name in {*FAMILIES, "noises", "practice"} - {"nothing"}:
        import_module(f"tests.campaigns.{name}").discover = cached  # type: ignore[attr-defined]


class NotKept(Exception):
    """What was weighed cannot be kept; the case takes no part."""


class Cached:
    """`discover`, with what was weighed kept in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def __call__(self, case: Case, seed: int = 0, level: float = LEVEL) -> Discovery:
        digest = hashlib.sha256(repr((seed, level, case.sigma, sorted(case.library), case.effects)).encode())
        for name, values in sorted({**case.channels, **case.roles, **case.extra}.items()):
            digest.update(name.encode() + np.ascontiguousarray(values).tobytes())
        path = self.folder / f"{digest.hexdigest()[:24]}.pickle"
        if path.is_file():  # of a file that this program has written
            found = cloudpickle.loads(path.read_bytes())
        else:
            found = weighed(case, seed, level)
            try:
                path.write_bytes(cloudpickle.dumps(found))
            except TypeError:  # a contact's soil is a structure of the library in C
                raise NotKept from None
        found = replace(found, ranking=with_curves(found.analysis, found.ranking))
        found = replace(found, whole=(found.whole[0], with_curves(*found.whole)))
        return decided(found, seed, level)


def one(campaign: str, family: str, number: int, seed: int) -> Record:
    """A case of a campaign, answered, with whether it is right."""
    module = import_module(f"tests.campaigns.{ {'nothing': 'noises'}.get(campaign, campaign) }")
    if campaign == "pools":
        record = module.run(family, seed, number)
        right = record.get("said") if family == "tied" else record.get("alike")
        if record.get("kind") in ("foreign", "removed"):
            right = record["right"] or (record["verdict"] == "unexplained" and record["right_where"])
        return {**record, "right": bool(right)}
    if campaign == "nothing":
        return dict(module.one(family, number, 0.0, 30, seed))
    if campaign == "statements":
        return dict(module.one("rolling_steady", family, number, seed))
    record = module.one(family, number, seed)
    if campaign == "hidden" and family.startswith("single"):
        record["right"] = record["among"]
    return dict(record)


def cases(folder: Path, count: int) -> Iterator[tuple[str, str, int, Callable[[int], Record]]]:
    for number in range(count):
        for campaign, families in FAMILIES.items():
            for family in families:
                yield campaign, family, number, partial(one, campaign, family, number)
    if folder.is_dir():
        answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
        for number, (name, expected) in enumerate(sorted(answers.items())):
            yield "practice", expected["kind"], number, partial(_practised, folder / name, expected)


def _practised(folder: Path, expected: Mapping[str, Any], seed: int) -> Record:
    found = practice.discover(load_case(folder))
    said = as_json(told(found.analysis, found))
    complaint = practice.judge(said, expected)
    names = {"verdict": said["verdict"], "missing": said["missing"], "rivals": said["rivals"]}
    return {**names, "probability": said["answer_probability"], "right": not complaint, "complaint": complaint}


def compared(old: Sequence[Record], new: Sequence[Record]) -> str:
    """Rates of both by family, and the p-value of McNemar's test."""
    before = {_key(r): r for r in old}
    pairs = [(before[_key(r)], r) for r in new if _key(r) in before]
    groups = list(dict.fromkeys(r["campaign"] for _, r in pairs))
    heads, widths = ("right", "better", "worse", "p", "above 0.9, wrong", "error"), (12, 8, 7, 7, 18, 14)
    lines = [f"{'campaign':18}{'cases':>6}" + "".join(f"{h:>{w}}" for h, w in zip(heads, widths, strict=True))]
    for group in [*groups, "all"]:
        mine = [(a, b) for a, b in pairs if group in (b["campaign"], "all")]
        better = sum(b["right"] and not a["right"] for a, b in mine)
        worse = sum(a["right"] and not b["right"] for a, b in mine)
        p = binomtest(better, better + worse).pvalue if better + worse else 1.0
        right, sure, off = (
            " / ".join(each) for each in zip(*(_counts([r[i] for r in mine]) for i in (0, 1)), strict=True)
        )
        lines.append(f"{group:18}{len(mine):6d}{right:>12}{better:8d}{worse:7d}{p:7.2f}{sure:>18}{off:>14}")
    for a, b in pairs:
        if a["right"] != b["right"] or (_sure(b) and not _sure(a)):
            lines.append(
                f"  {'better' if b['right'] and not a['right'] else 'WORSE'}{' SURE' if _sure(b) else ''} "
                f"{b['campaign']} {b['group']} {b['number']}: {b.get('truth', b.get('column', ''))}: "
                f"{_said(a)}  ->  {_said(b)}"
            )
    return "\n".join(lines)


def _key(record: Record) -> tuple[str, str, int]:
    return record["campaign"], record["group"], record["number"]


def _read(path: Path) -> list[Record]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _counts(records: Sequence[Record]) -> tuple[str, str, str]:
    sets = [r for r in records if r["verdict"] != "unexplained" and "probability" in r]
    error = calibration.expected_error(sets)[0] if sets else 0.0
    return str(sum(r["right"] for r in records)), str(sum(map(_sure, records))), f"{error:.3f}"


def _sure(record: Record) -> bool:
    return sure_and_wrong(record["verdict"], record["probability"], record["right"])


def _said(record: Record) -> str:
    names = record.get("rivals") or [record.get("missing", [])]
    return f"{record['verdict']} {record['probability']:.2f} {' | '.join('+'.join(n) for n in names)}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns.paired", description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cache", type=Path, default=Path("out/paired"), metavar="FOLDER")
    parser.add_argument("--practice", type=Path, default=Path("practice"), metavar="FOLDER")
    parser.add_argument("--part", default="1/1", metavar="K/N")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--against", type=Path, metavar="FILE")
    parser.add_argument("--only", type=Path, metavar="FILE", help="cases that stand in this file of records only")
    parser.add_argument("--campaigns", default="", help="of these only")
    options = parser.parse_args()
    if options.against:
        print(compared(_read(options.against), _read(options.out)))
        return
    part, parts = map(int, options.part.split("/"))
    keep_weighed(options.cache)
    known = {_key(r) for r in _read(options.out)} if options.out.is_file() else set()
    only = {_key(r) for r in _read(options.only)} if options.only else None
    with options.out.open("a", encoding="utf-8") as file:
        for place, (campaign, family, number, make) in enumerate(cases(options.practice, options.cases)):
            if place % parts != part - 1 or (options.campaigns and campaign not in options.campaigns.split(",")):
                continue
            if only is not None and (campaign, family, number) not in only:
                continue
            begin = time.process_time()
            if (campaign, family, number) in known:
                continue
            try:
                record = {**make(options.seed), "campaign": campaign, "group": family, "number": number}
            except NotKept:
                continue
            record["seconds"] = round(time.process_time() - begin, 2)
            file.write(json.dumps(record, default=float) + "\n")
            file.flush()


if __name__ == "__main__":
    sys.exit(main())
