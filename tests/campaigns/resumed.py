"""Campaigns that go on where they stopped: results are lines of JSON, one file a part, and parts merge.

options = parser_of(__doc__, "python -m tests.campaigns.noises", list(FAMILIES), cases=24)
records = resumed(options.parse_args(), "0-14-1", lambda family, number: {...})

Each line says which engine answered. Lines of another engine stay in their files and are not counted: figures of two
programs do not mix.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Collection, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from tests.campaigns.statistics import rate_limits

__all__ = ["Record", "engine", "engine_files", "parser_of", "rate", "resumed", "sure_and_wrong"]

Record = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]
SOURCES = (
    "host_tools/terrapin_tools/workbench/**/*.py",
    "hil/terrapin_hil/physics/*.py",
    "hil/terrapin_hil/physics/effects/*.py",
)


def engine_files() -> list[Path]:
    """The files that decide what is answered."""
    return [path for pattern in SOURCES for path in sorted(ROOT.glob(pattern))]


@cache
def engine() -> str:
    """Eight digits that change with the engine."""
    digest = hashlib.sha256()
    for path in engine_files():
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def parser_of(about: str, command: str, families: Collection[str], cases: int) -> argparse.ArgumentParser:
    """The options that such a campaign has: --cases, --families, --seed, --part K/N, --out."""
    parser = argparse.ArgumentParser(prog=command, description=about.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=cases, help=f"of each family; {cases} where not given")
    parser.add_argument("--families", default=",".join(families), help=f"of {', '.join(families)}; all where not given")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", default="1/1", metavar="K/N", help="every N-th case, from the K-th on")
    parser.add_argument("--out", type=Path, default=Path("out") / command.rpartition(".")[2], metavar="DIR")
    return parser


def resumed(options: argparse.Namespace, setting: str, make: Callable[[str, int], Record]) -> list[Record]:
    """What is known of the families that were asked for, after this part's cases were made that no part has made yet.

    `setting` names what else the results depend on; `make` gets family and number.
    """
    part, parts = map(int, options.part.split("/"))
    families: Sequence[str] = options.families.split(",")
    options.out.mkdir(parents=True, exist_ok=True)
    known: dict[tuple[str, int], Record] = {}
    others = 0
    for path in sorted(options.out.glob(f"{setting}-*.jsonl")):
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                record = json.loads(line)
            except ValueError:  # a kill cut it short
                continue
            if record.get("engine") == engine():
                known[record["family"], record["number"]] = record
            else:
                others += 1
    if others:
        print(f"{options.out}: {others} lines of another engine than {engine()} are not counted", file=sys.stderr)
    mine = options.out / f"{setting}-{part}of{parts}.jsonl"
    cut = mine.is_file() and mine.stat().st_size > 0 and not mine.read_bytes().endswith(b"\n")
    with mine.open("a", encoding="utf-8") as file:
        file.write("\n" if cut else "")
        for number in range(part - 1, options.cases, parts):
            for family in families:
                if (family, number) not in known:
                    begun = {"family": family, "number": number, "engine": engine()}
                    record = known[family, number] = {**begun, **make(family, number)}
                    file.write(json.dumps(record) + "\n")
                    file.flush()
            print(f"{number + 1} of {options.cases}", file=sys.stderr)
    return [record for (family, _), record in sorted(known.items()) if family in families]


def rate(hits: int, count: int) -> str:
    """A rate with its 95 % limits, as a column of a table."""
    low, high = rate_limits(hits, count)
    return f"{100.0 * hits / count:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})".rjust(24)


def sure_and_wrong(verdict: str, probability: float, right: bool) -> bool:
    """Whether one answer was given above 0.9 and is wrong; that the data cannot tell claims no answer."""
    return not right and verdict != "ambiguous" and probability > 0.9
