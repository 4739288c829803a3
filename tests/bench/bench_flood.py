"""`terrapin web` under floods: 2,000 websockets, 600 half-open requests and 200 slow bodies for a minute.

bench_flood.py [SECONDS]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "web"))

from floods import HELD_SECONDS, flood  # beside the tests that use it
from serving import Server

P95, SOCKETS, MEMORY = 0.2, 64, 16 << 20  # bounds: s, websockets, bytes


def main() -> int:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder))
        try:
            found = flood(server, seconds)
        finally:
            server.stop()
    print(f"{len(found.seconds)} requests of another browser, {found.opened} websockets opened")
    passed = not found.refused
    print(f"requests refused: {len(found.refused)} (bound 0)")
    for what, value, bound, unit in (
        ("another browser's request, p95", found.p95(), P95, "s"),
        ("websockets open at a time", float(found.most_sockets), float(SOCKETS), ""),
        ("longest half-open request", found.longest_half_open, HELD_SECONDS, "s"),
        ("memory above that before", float(found.memory), float(MEMORY), "bytes"),
    ):
        passed &= value <= bound
        print(f"{what}: {value:.3g} {unit} (bound {bound:g}: {'met' if value <= bound else 'NOT MET'})")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
