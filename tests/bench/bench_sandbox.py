"""Lockstep over real SocketCAN (vcan, two frames each way a tick), in the kernel of tests/sandbox when there is one."""

from __future__ import annotations

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parents[1] / "sandbox"
sys.path.insert(0, str(HERE))

from sandbox import kernel, run_inside  # noqa: E402  # beside the tests that use it


def main() -> int:
    if kernel()[0] is None:
        print(f"not run here: SocketCAN lockstep ({kernel()[1]})")
        return 0
    command = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "-c", "/dev/null"]
    done = run_inside([*command, "--rootdir", str(HERE / "inside"), f"{HERE}/inside/bus.py::test_lockstep_speed"])
    print("\n".join(re.findall("^.*ticks/s.*$", done.output, re.MULTILINE)) or done.output)
    return done.status


if __name__ == "__main__":
    sys.exit(main())
