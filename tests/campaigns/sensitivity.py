"""What halving and doubling each number of the decision does: `make sensitivity`.

    python -m tests.campaigns.sensitivity --cases 1 --out out/sensitivity.jsonl     goes on where it was stopped
    python -m tests.campaigns.sensitivity --out FILE --write                        the table of docs/thresholds.md

The cases are those of `paired`, one of each family and those of a folder with answers; search and evidence are kept, so
only what decides is made again. A case changes where its verdict or names do, or its probability by more than CHANGED.
Whole numbers stay whole and 1 at least; of several numbers all are halved, or doubled.
"""

from __future__ import annotations

import argparse
import ast
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from tests.campaigns import paired
from tests.campaigns.resumed import ROOT, Record

__all__ = ["Threshold", "scaled", "table", "thresholds"]

CHANGED = 0.05  # of a probability: less nobody acts upon
WORKBENCH = "terrapin_tools.workbench"
MODULES = {  # after search and evidence, with their rooms
    **dict.fromkeys(("decide", "unexplained", "misfit", "leftover", "discovery", "certainty"), "discover"),
    "free_curves": "formulas",
}
PAGE = ROOT / "docs" / "thresholds.md"
BEGIN, END = "<!-- thresholds (make sensitivity) -->", "<!-- end of thresholds -->"


@dataclass(frozen=True)
class Threshold:
    """A number, or several, at the top of a module; `means`: its comment."""

    module: str
    name: str
    value: Any
    means: str


def thresholds(module: str) -> Iterator[Threshold]:
    """Those of a module of the decision."""
    loaded = import_module(f"{WORKBENCH}.{MODULES[module]}.{module}")
    lines = Path(str(loaded.__file__)).read_text().splitlines()
    means = ""
    for node in ast.parse("\n".join(lines)).body:
        if not isinstance(node, ast.Assign) or not _numbers(node.value):
            continue
        above, place = "", node.lineno - 2
        while lines[place].startswith("#"):
            above, place = f"{lines[place].lstrip('# ')} {above}", place - 1
        # one that stands below another has its comment
        means = lines[node.lineno - 1].partition("#")[2].strip() or above.strip() or means
        for target in node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets:
            if isinstance(target, ast.Name) and target.id.isupper():
                value = getattr(loaded, target.id)
                if scaled(value, 2.0) is not None:
                    yield Threshold(module, target.id, value, means)


def _numbers(node: ast.expr) -> bool:
    return any(isinstance(one, ast.Constant) and type(one.value) in (int, float) for one in ast.walk(node))


def scaled(value: Any, factor: float) -> Any:
    """A number, or several, times a factor; None for what has no number. Of a share above a half what it lacks of 1 is
    divided by the factor.

    >>> scaled(3, 0.5), scaled(0.2, 2.0), scaled((1, 4.0), 0.5), scaled({"a": 2.0, "b": "c"}, 2.0), scaled("omega", 2.0)
    (1, 0.4, (1, 2.0), {'a': 4.0, 'b': 'c'}, None)
    >>> scaled(0.75, 2.0), scaled(0.75, 0.5)
    (0.875, 0.5)
    """
    if isinstance(value, (bool, str)):
        return None
    if isinstance(value, int):
        return max(1, int(value * factor))
    if isinstance(value, float):
        return 1.0 - (1.0 - value) / factor if 0.5 < value < 1.0 else value * factor
    if isinstance(value, dict):
        each = {key: scaled(one, factor) for key, one in value.items()}
        return None if all(one is None for one in each.values()) else {k: v or value[k] for k, v in each.items()}
    if isinstance(value, tuple):
        found = [scaled(one, factor) for one in value]
        return (
            None
            if all(one is None for one in found)
            else tuple(old if new is None else new for old, new in zip(value, found, strict=True))
        )
    return None


def put(one: Threshold, value: Any) -> None:
    """Every module that has the threshold under its name has the value."""
    here = import_module(f"{WORKBENCH}.{MODULES[one.module]}.{one.module}")
    old = getattr(here, one.name)
    for name, module in list(sys.modules.items()):
        if name.startswith("terrapin_tools") and getattr(module, one.name, None) is old:
            setattr(module, one.name, value)


def answers(options: argparse.Namespace) -> dict[str, Record]:
    """Of all cases."""
    found = {}
    for campaign, family, number, make in paired.cases(options.practice, options.cases):
        if options.campaigns and campaign not in options.campaigns.split(","):
            continue
        try:
            record = make(options.seed)
        except paired.NotKept:
            continue
        names = sorted("+".join(sorted(one)) for one in record.get("rivals") or [record.get("missing", [])])
        answer = {"said": [record["verdict"], *names], "probability": record["probability"], "right": record["right"]}
        found[f"{campaign} {family} {number}"] = answer
    return found


def compared(before: dict[str, Record], after: dict[str, Record]) -> Record:
    pairs = [(before[key], after[key]) for key in before if key in after]
    changed = [b["said"] != a["said"] or abs(b["probability"] - a["probability"]) > CHANGED for b, a in pairs]
    return {
        "cases": len(pairs),
        "changed": sum(changed),
        "better": sum(a["right"] and not b["right"] for b, a in pairs),
        "worse": sum(b["right"] and not a["right"] for b, a in pairs),
    }


def table(records: Sequence[Record], listed: Sequence[Threshold]) -> str:
    """In Markdown, those that change most first."""
    known = {(r["module"], r["name"], r["factor"]): r for r in records}
    rows = []
    for one in listed:
        halved, doubled = (known.get((one.module, one.name, factor)) for factor in (0.5, 2.0))
        if halved is not None and doubled is not None:
            shown = one.value if not isinstance(one.value, dict) else "a table"
            cells = " | ".join(
                f"{r['changed']} of {r['cases']}"
                + (f" (+{r['better']} -{r['worse']})" if r["better"] + r["worse"] else "")
                for r in (halved, doubled)
            )
            rows.append(
                (
                    halved["changed"] + doubled["changed"],
                    f"| `{one.module}.{one.name}` | {shown} | {one.means} | {cells} |",
                )
            )
    rows.sort(key=lambda row: -row[0])
    heads = "| number | value | what it is | halved | doubled |\n|---|---|---|---|---|"
    return "\n".join([heads, *(row for _, row in rows)])


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaigns.sensitivity", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--cases", type=int, default=1, help="of each family")
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--cache", type=Path, default=Path("out/sensitivity"), metavar="FOLDER")
    parser.add_argument("--practice", type=Path, default=Path("practice"), metavar="FOLDER")
    parser.add_argument("--out", type=Path, default=Path("out/sensitivity.jsonl"), metavar="FILE")
    parser.add_argument("--campaigns", default="", help="of these only")
    parser.add_argument("--write", action="store_true", help="put the table into docs/thresholds.md")
    options = parser.parse_args()
    listed = [one for module in MODULES for one in thresholds(module)]
    records = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.is_file() else []
    if options.write:
        before, _, rest = PAGE.read_text().partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n{table(records, listed)}\n{END}{rest.partition(END)[2]}")
        return 0
    paired.keep_weighed(options.cache)
    known = {(r["module"], r["name"], r["factor"]) for r in records}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    print("as it is", file=sys.stderr)
    as_it_is = answers(options)
    for one in listed:
        for factor in (0.5, 2.0):
            if (one.module, one.name, factor) in known:
                continue
            put(one, scaled(one.value, factor))
            record = {"module": one.module, "name": one.name, "factor": factor, **compared(as_it_is, answers(options))}
            put(one, one.value)
            print(f"{one.module}.{one.name} x {factor:g}: {record['changed']} of {record['cases']}", file=sys.stderr)
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
    print(table([json.loads(line) for line in options.out.read_text().splitlines()], listed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
