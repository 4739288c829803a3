"""docs/safety.md, made of hazards.toml and of the faults in controller.toml, and looked through for gaps.

safety.py             gaps, and whether the page is as it would be made now; status 1 on a finding
safety.py --renew     write the page
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

from steps import ROOT

HAZARDS = Path(__file__).with_name("hazards.toml")
DESCRIPTION = ROOT / "firmware" / "terrapin_interface" / "controller.toml"
HELD = ROOT / "tests" / "attack" / "held.toml"
PAGE = ROOT / "docs" / "safety.md"
SCENARIOS = ROOT / "hil" / "terrapin_hil" / "scenario" / "scenarios"
HEAD = """# What keeps the robot from doing harm

Made by `tests/tools/safety.py --renew` from [hazards.toml](../tests/tools/hazards.toml) and from the faults of
`controller.toml`; `make test` looks whether it is still so, whether each place and each test is there, and whether each
fault is some hazard's. A cell of the last column without a test says what is left to people.
"""
ATTACKS = """
## What was tried

`make attack` tries to move, brick or break what must not be, and counts; `make test-all` does a part of each. The
counts that were kept last (`make attack ARGS=--keep`, then `safety.py --renew`):

| attack | tried | taken |
|---|---|---|"""


def table(path: Path) -> dict[str, Any]:
    """A TOML file."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def gaps(hazards: list[dict[str, Any]], faults: dict[str, Any], root: Path = ROOT) -> list[str]:
    """What is missing: a place, a test, a fault that no hazard names, a barrier that nothing shows."""
    found = []
    named = {name for hazard in hazards for barrier in hazard.get("barrier", []) for name in barrier.get("faults", [])}
    found += [f"fault {name}: no hazard names it" for name in faults if name not in named]
    for hazard in hazards:
        barriers = hazard.get("barrier", [])
        if not any(barrier.get("tests") for barrier in barriers):
            found.append(f"{hazard['name']}: found no barrier that a test shows, expected one")
        for barrier in barriers:
            told = f"{hazard['name']}: {barrier.get('what') or ', '.join(barrier.get('faults', []))}"
            found += [f"{told}: no fault {name}" for name in barrier.get("faults", []) if name not in faults]
            if not barrier.get("faults") and not barrier.get("where"):
                found.append(f"{told}: found neither faults nor a place")
            if not barrier.get("tests") and not barrier.get("open"):
                found.append(f"{told}: found neither a test nor what is left to people")
            if "where" in barrier:
                file, _, words = barrier["where"].partition(": ")
                if not (root / file).is_file() or words not in (root / file).read_text(encoding="utf-8"):
                    found.append(f"{told}: {file} has no {words!r}")
            for test in barrier.get("tests", []):
                file, _, name = test.partition("::")
                if not (root / file).is_file() or f"{name}(" not in (root / file).read_text(encoding="utf-8"):
                    found.append(f"{told}: no test {test}")
    return found


def page(hazards: list[dict[str, Any]], faults: dict[str, Any]) -> str:
    """The page's text."""
    parts = [HEAD]
    for hazard in hazards:
        parts.append(f"\n## {hazard['name']}\n\n{hazard['harm'][0].upper()}{hazard['harm'][1:]}.\n")
        parts.append("| what prevents it | where | shown by |\n|---|---|---|")
        for barrier in hazard.get("barrier", []):
            shown = ", ".join(f"`{test.split('::')[1]}`" for test in barrier.get("tests", [])) or barrier["open"]
            if "what" in barrier:
                file = barrier["where"].partition(": ")[0]
                parts.append(f"| {barrier['what']} | [{Path(file).name}](../{file}) | {shown} |")
            for name in barrier.get("faults", []):
                fault = faults[name]
                latched = "stays until `clear`" if fault["latched"] else "goes with its cause"
                what = f"{fault['cause']}: {fault['reaction']}, within {fault['within_ms']} ms; {latched}"
                scenarios = ", ".join(
                    f"[{one}](../{SCENARIOS.relative_to(ROOT)}/{one}.toml)" for one in fault["scenarios"]
                )
                parts.append(f"| {what} | fault `{name}` | {shown}; scenarios {scenarios} |")
        parts.append("")
    return "\n".join(parts) + attacks()


def attacks() -> str:
    """What `make attack` tried last, as a table."""
    rows = [f"| {name} | {counts['tried']:,} | {counts['taken']} |" for name, counts in sorted(table(HELD).items())]
    return "\n".join([ATTACKS, *rows, ""])


def main() -> int:
    parser = argparse.ArgumentParser(description="docs/safety.md: gaps, and whether it is as it would be made.")
    parser.add_argument("--renew", action="store_true", help="write the page")
    options = parser.parse_args()
    hazards, faults = table(HAZARDS)["hazard"], table(DESCRIPTION)["fault"]
    found = gaps(hazards, faults)
    if options.renew and not found:
        PAGE.write_text(page(hazards, faults), encoding="utf-8")
    elif not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != page(hazards, faults):
        found.append("docs/safety.md: not as it would be made now: tests/tools/safety.py --renew")
    for line in found:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
