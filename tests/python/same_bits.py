"""What the controller answers in each shipped scenario, as a hash: a change of one bit of one frame is a decision.

    python tests/python/same_bits.py            which scenarios answer other bits than data/same_bits.toml has; status 1
    python tests/python/same_bits.py --renew    keep what they answer now; the commit says why it changed

Most numbers of the core can be wrong by a little and every check of every scenario still holds. Here they cannot.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.links.link import Link
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import load_scenario

__all__ = ["KEPT", "answer", "differing", "kept"]

KEPT = Path(__file__).with_name("data") / "same_bits.toml"
DIGITS = 16


def answer(path: Path, link: Link | str = "inprocess") -> str:
    """The first digits of the hash of everything that the controller sends in a scenario."""
    return run(load_scenario(path), link).output_hash[:DIGITS]


def kept() -> dict[str, str]:
    """The hashes that are kept, by the scenario's name."""
    return {str(name): str(value) for name, value in tomllib.loads(KEPT.read_text(encoding="utf-8"))["bits"].items()}


def differing() -> dict[str, str]:
    """The scenarios that answer other bits than are kept, or of which none are, with what they answer; "" for a name
    that is kept and no scenario's."""
    before = kept()
    now = {path.stem: answer(path) for path in sorted(paths.SCENARIOS.glob("*.toml"))}
    found = {name: bits for name, bits in now.items() if before.get(name) != bits}
    return found | {name: "" for name in before if name not in now}


def main() -> int:
    if sys.argv[1:] == ["--renew"]:
        lines = [f'{path.stem} = "{answer(path)}"' for path in sorted(paths.SCENARIOS.glob("*.toml"))]
        head = "# What the controller answers in each shipped scenario; renewed by tests/python/same_bits.py --renew."
        KEPT.write_text("\n".join([head, "[bits]", *lines, ""]), encoding="utf-8")
        return 0
    found = differing()
    for name, bits in found.items():
        print(f"{name}: answers {bits or 'nothing'}, expected {kept().get(name, 'nothing yet')}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
