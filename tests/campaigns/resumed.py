"""Campaigns that go on where they stopped: results are lines of JSON, one file a part, and parts merge.

options = parser_of(__doc__, "python -m tests.campaigns.noises", list(FAMILIES), cases=24)
records = resumed(options.parse_args(), "0-14-1", lambda family, number: {...})

Each line says which engine answered. Lines of another engine stay in their files and are not counted: figures of two
programs do not mix. What was counted of the present engine and committed (results/counted) is not made again;

    python -m tests.campaigns.resumed --keep [FOLDER]      puts what stands in FOLDER, out/ else, there
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import json
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from tests.campaigns.statistics import rate_limits

__all__ = [
    "Record",
    "committed",
    "engine",
    "engine_files",
    "everything",
    "keep",
    "parser_of",
    "rate",
    "resumed",
    "sure_and_wrong",
]

Record = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]
COUNTED = Path(__file__).parent / "results" / "counted"
SOURCES = (
    "host_tools/terrapin_tools/workbench/**/*.py",
    "hil/terrapin_hil/physics/**/*.py",
    "hil/terrapin_hil/**/*.c",
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
    parser.set_defaults(campaign=command.rpartition(".")[2])
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
    kept = [record for record in committed(options.campaign) if record["setting"] == setting]
    for record in (*kept, *(one for path in sorted(options.out.glob(f"{setting}-*.jsonl")) for one in _lines(path))):
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
                    begun = {"family": family, "number": number, "setting": setting, "engine": engine()}
                    record = known[family, number] = {**begun, **make(family, number)}
                    file.write(json.dumps(record) + "\n")
                    file.flush()
            print(f"{number + 1} of {options.cases}", file=sys.stderr)
    return [record for (family, _), record in sorted(known.items()) if family in families]


def _lines(path: Path) -> Iterator[Record]:
    """Records of a file, but for a line that a kill cut short, and what others keep there that is no record."""
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            record = json.loads(line)
        except ValueError:
            continue
        if isinstance(record, dict):
            yield record


def committed(campaign: str) -> list[Record]:
    """What was committed of a campaign, all of one engine."""
    path = COUNTED / f"{campaign}.jsonl.gz"
    return [json.loads(line) for line in gzip.decompress(path.read_bytes()).splitlines()] if path.is_file() else []


def everything(campaign: str, out: Path = Path("out")) -> list[Record]:
    """All that is known of a campaign, on every setting, of the present engine: committed, and in `out`."""
    lines = [
        *committed(campaign),
        *(line for path in sorted((out / campaign).glob("*.jsonl")) for line in _lines(path)),
    ]
    mine = {(r["setting"], r["family"], r["number"]): r for r in lines if r.get("engine") == engine()}
    return [mine[key] for key in sorted(mine)]


def keep(folder: Path) -> dict[str, int]:
    """Put the lines of the present engine below a folder beside those that are committed, in their order: the same
    bytes from the same lines. How many there are then, by campaign; lines of other engines are dropped."""
    counts = {}
    for place in sorted({path.parent for path in folder.glob("*/*.jsonl")}):
        records = everything(place.name, folder)
        if records:
            text = "".join(json.dumps(record) + "\n" for record in records)
            COUNTED.mkdir(parents=True, exist_ok=True)
            (COUNTED / f"{place.name}.jsonl.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
            counts[place.name] = len(records)
    return counts


def rate(hits: int, count: int) -> str:
    """A rate with its 95 % limits, as a column of a table."""
    low, high = rate_limits(hits, count)
    return f"{100.0 * hits / count:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})".rjust(24)


def sure_and_wrong(verdict: str, probability: float, right: bool) -> bool:
    """Whether one answer was given above 0.9 and is wrong; that the data cannot tell claims no answer."""
    return not right and verdict != "ambiguous" and probability > 0.9


if __name__ == "__main__":
    if "--keep" not in sys.argv[1:]:
        sys.exit(__doc__)
    for name, count in keep(Path(sys.argv[-1]) if sys.argv[-1] != "--keep" else Path("out")).items():
        print(f"{name}: {count} cases of engine {engine()}")
