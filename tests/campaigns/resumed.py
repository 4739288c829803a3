"""Campaigns that go on where they stopped: results are lines of JSON, one file a part, and parts merge.

options = parser_of(__doc__, "python -m tests.campaigns.noises", list(FAMILIES), cases=24)
records = resumed(options.parse_args(), "0-14-1", lambda family, number: {...})
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from tests.campaigns.statistics import rate_limits

__all__ = ["Record", "parser_of", "rate", "resumed", "sure_and_wrong"]

Record = dict[str, Any]


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
    for path in sorted(options.out.glob(f"{setting}-*.jsonl")):
        for line in path.read_text(encoding="utf-8").splitlines():
            record = json.loads(line)
            known[record["family"], record["number"]] = record
    with (options.out / f"{setting}-{part}of{parts}.jsonl").open("a", encoding="utf-8") as file:
        for number in range(part - 1, options.cases, parts):
            for family in families:
                if (family, number) not in known:
                    record = known[family, number] = {"family": family, "number": number, **make(family, number)}
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
