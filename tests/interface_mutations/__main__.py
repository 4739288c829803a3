"""Is the interface told once, would a slip be seen? `python -m tests.interface_mutations`; status 1 on a miss.

    python -m tests.interface_mutations                     all mutants (an hour); goes on where it was stopped
    python -m tests.interface_mutations --short             a spread of them in about a minute, as `make test-all` does
    python -m tests.interface_mutations --rows generator    only those of the generator, or of the description
    python -m tests.interface_mutations --match GROUND      those whose name has this
    python -m tests.interface_mutations --show              the figures of what is there already

Results are JSON lines in out/interface_mutations, in a file named by what the description, the generator, telemetry.c
and these tests were.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from terrapin_hil.paths import ROOT
from tests.interface_mutations import description_mutants, generator_mutants

SOURCES = (
    "firmware/terrapin_interface/*.py",
    "firmware/terrapin_interface/controller.toml",
    "firmware/core/telemetry.c",
    "tests/interface_mutations/*.py",
    "tests/interface_mutations/*.txt",
)
ROWS: dict[str, tuple[tuple[Any, ...], Callable[[Any], tuple[bool, str]], str, int]] = {
    "description": (
        description_mutants.MUTANTS, description_mutants.judge,
        "scale, offset, length, start of each telemetry signal: refused by name, or right in every decoder", 200,
    ),
    "generator": (generator_mutants.MUTANTS, generator_mutants.judge, "mutants of generator and codec: caught", 40),
}  # fmt: skip
SHORT = {"description": 12, "generator": 24}  # one in so many; all that a description refuses is quick


def fingerprint() -> str:
    """Eight digits that change with what is mutated and with what judges."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in SOURCES for path in ROOT.glob(pattern)):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def short(row: str) -> list[Any]:
    """A spread of a row's mutants."""
    return list(ROWS[row][0][:: SHORT[row]])


def _stored(path: Path) -> dict[str, tuple[bool, str]]:
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            name, good, told = json.loads(line)
        except ValueError:  # cut short by a kill
            continue
        found[name] = (good, told)
    return found


def main() -> int:
    """Judges what was not judged yet; 1 when a mutant is not as it must be, or when too few were looked at."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.interface_mutations", description="Mutants of the interface."
    )
    parser.add_argument("--rows", default=",".join(ROWS))
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--match", default="")
    parser.add_argument("--show", action="store_true", help="no new ones")
    options = parser.parse_args()
    unknown = set(options.rows.split(",")) - set(ROWS)
    if unknown:
        parser.error(f"--rows: found {', '.join(sorted(unknown))}, expected {' or '.join(ROWS)}")
    path = ROOT / "out" / "interface_mutations" / f"{fingerprint()}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    done = _stored(path)
    missed = 0
    for row in options.rows.split(","):
        mutants, judge, title, least = ROWS[row]
        chosen = [m for m in (short(row) if options.short else mutants) if options.match in m.name]
        results = {}
        for mutant in chosen:
            key = f"{row} {getattr(mutant, 'number', '')} {mutant.name}"
            if not done.get(key, (False,))[0] and not options.show:  # a miss is judged again
                done[key] = judge(mutant)
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([key, *done[key]]) + "\n")
                if not done[key][0]:
                    print(f"  {mutant.name}: {done[key][1]}", flush=True)
            if key in done:
                results[key] = done[key]
        bad = [key for key, (good, _) in results.items() if not good]
        missed += len(bad) + (len(results) < least and not (options.short or options.match))
        kinds = Counter(told.split(":")[0] for _, told in results.values())
        told = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(4))
        print(f"{title}\n  {len(results)} of {len(mutants)} looked at, {len(bad)} missed ({told})")
        if options.show:
            print("".join(f"  {key}: {results[key][1]}\n" for key in bad), end="")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
