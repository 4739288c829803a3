"""Would `make test` see a slip anywhere in the Python? `python -m tests.mutation.anywhere --count 15`.

Slips as those of `tests.mutation.python`, drawn from all modules of the packages, as likely as they have slips. Each is
run with the test files that `make test CHANGED=1` would run for its module (tests/tools/reach.py), those that
import it first, without what is left to `make test-all`. A test that fails without the slip counts for nothing: it ends
the run. Survivors are printed; status 1 when fewer than 9 of 10 are seen.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys

from terrapin_hil.paths import ROOT
from tests.mutation.python import judge, passes, slips
from tests.mutation.warm import prepare

sys.path.insert(0, str(ROOT / "tests" / "tools"))
from reach import Imports, reached
from rooms import modules

SEEN = 0.9


def near(path: str, imports: Imports) -> tuple[str, ...]:
    """The test files that a change of a module reaches, those first that stand on little else."""
    found = reached([path], imports, {}).tests
    module = next(name for name, place in imports.paths.items() if place == ROOT / path)
    return tuple(
        sorted(
            found,
            key=lambda t: (module not in imports.direct(imports.tests[t]), len(imports.below(imports.tests[t])), t),
        )
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation.anywhere", description="Slips in any module.")
    parser.add_argument("--count", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    paths = sorted(place.relative_to(ROOT).as_posix() for place in modules(ROOT).values())
    every = [slip for path in paths for slip in slips(path, (ROOT / path).read_text(encoding="utf-8"))]
    every.sort(key=lambda slip: hashlib.sha256(f"{options.seed} {slip.name} {slip.begin}".encode()).digest())
    os.environ["PYTEST_ADDOPTS"] = "-p tests.tools.tiers --tier test"
    prepare()
    imports, seen = Imports(ROOT), 0
    for slip in every[: options.count]:
        files = near(slip.path, imports)
        verdict, by = judge(slip, [[slip.path], *([file] for file in files)], {})
        if verdict == "killed" and not passes(by.partition(": ")[0]):
            print(f"{by}: failed without a slip, expected to pass first", file=sys.stderr)
            return 2
        seen += verdict == "killed"
        print(f"  {verdict}: {slip.name}" + (f" by {by}" if by else f" ({len(files)} test files)"), flush=True)
    print(f"{seen} of {options.count} slips in {len(every)} places of {len(paths)} modules seen (at least {SEEN:.0%})")
    return 0 if seen >= SEEN * options.count else 1


if __name__ == "__main__":
    sys.exit(main())
