"""Memory of `terrapin log record` over many frames, for each kind that survives a crash; an hour of a full bus has 28.8
million, of which COUNT come here as fast as they are taken. kill -9 ends it, and the log is read.

python tests/bench/bench_record.py [FRAMES] [.log .blf .mf4 .mcap]
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from slcan_feeder import Feeder

from host_tools.logs.reading import LogReader
from host_tools.logs.writing import GROWING

COUNT, HOUR, BOUND = 2_000_000, 8000 * 3600, 300.0  # frames, frames, MB
TERRAPIN = str(Path(sys.executable).parent / "terrapin")


def resident(pid: int) -> tuple[float, float]:
    """Memory now and at most [MB]."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    found = {line.split(":")[0]: float(line.split()[1]) / 1024 for line in lines if line.startswith(("VmRSS", "VmHWM"))}
    return found["VmRSS"], found["VmHWM"]


def measure(kind: str, count: int) -> bool:
    with tempfile.TemporaryDirectory() as folder, Feeder(0, count / 1000) as feeder:
        path = Path(folder) / f"x{kind}"
        begin = time.monotonic()
        command = [TERRAPIN, "log", "record", str(path), "--link", f"serial:{feeder.path}"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            memory: list[tuple[float, float]] = []  # size of the file [MB], resident [MB]
            while feeder.waiting():
                time.sleep(0.2)
                if path.exists():
                    memory.append((path.stat().st_size / 1e6, resident(process.pid)[0]))
            seconds = time.monotonic() - begin
            time.sleep(1.0)  # up to the last second
            _, most = resident(process.pid)
            process.send_signal(signal.SIGKILL)
        half = max(memory)[0] / 2
        first = max(mb for size, mb in memory if size < half)
        last = max(mb for size, mb in memory if size >= half)
        growth = (last - first) / (count / 2)  # MB a frame
        hour = most + max(0.0, growth) * (HOUR - count)
        read = sum(len(block) for block in LogReader(path).blocks())
        print(
            f"{kind}: {count} frames in {seconds:.0f} s ({count / seconds:.0f}/s), {path.stat().st_size / 1e6:.0f} MB; "
            f"memory {first:.0f} MB in the first half, {last:.0f} in the second, {most:.0f} at most; "
            f"for an hour {hour:.0f} MB (bound {BOUND:.0f}); after kill -9 {read} frames are read",
            flush=True,
        )
        return read == count and hour <= BOUND


if __name__ == "__main__":
    given = sys.argv[1:]
    frames = int(given[0]) if given and given[0].isdigit() else COUNT
    held = [measure(kind, frames) for kind in GROWING if not set(given) & set(GROWING) or kind in given]
    sys.exit(0 if all(held) else 1)
