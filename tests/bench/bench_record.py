"""Memory of `terrapin log record` over an hour of the controller's own telemetry, for each kind of log that survives a
crash. A bus in its process gives the frames as fast as they are written, half a second of them at a time as a real one
does; kill -9 ends it in the act, and the log is read.

python tests/bench/bench_record.py [SECONDS of telemetry] [.log .blf .mf4 .mcap]
"""

from __future__ import annotations

import mmap
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from terrapin_hil import paths
from terrapin_hil.messages import interface
from terrapin_tools.logs.frames import Frames
from terrapin_tools.logs.reading import LogReader
from terrapin_tools.logs.writing import GROWING

HOUR = 3600.0  # s
LENGTHS = {".mcap": 900.0}  # s: with the signals it takes ten times as long to write as the others
BOUND = 300.0  # MB
BLOCK = 0.5  # s: `log record` writes what came so often
SETTLED = 60.0  # s of telemetry after which everything is imported and every buffer was used


def telemetry() -> tuple[list[int], float]:
    """Identifiers of what the controller sends in a cycle, each as often as it comes in a second; frames a second."""
    sent = [m for m in interface().messages.values() if m.sender == "controller" and m.cycle_ms]
    names = [m.id for m in sent for _ in range(1000 // m.cycle_ms)]
    return names, float(len(names))


class Telemetry:
    """A bus that always has the next half second (logs.bus.ListenedBus). Its count of frames outlives it."""

    channel_info, damaged, lost = "telemetry", 0, 0

    def __init__(self, count: mmap.mmap) -> None:
        names, self._rate = telemetry()
        self._names = np.array(names)[np.random.default_rng(1).permutation(len(names))]
        self._begin, self._given, self._count = time.time(), 0, count

    def receive(self, seconds: float) -> Frames:
        number = np.arange(self._given, self._given + round(self._rate * BLOCK))
        data = np.zeros((len(number), 8), dtype=np.uint8)
        data[:, :4] = number.astype("<u4").view(np.uint8).reshape(-1, 4)
        self._given += len(number)
        self._count[:8] = self._given.to_bytes(8, "little")
        names, zeros = self._names[number % len(self._names)], np.zeros(len(number), dtype=np.uint8)
        return Frames(Path("bus"), self._begin + number / self._rate, names, np.full(len(number), 8), data, zeros)

    def shutdown(self) -> None:
        """Nothing to let go of."""


def recorder(count: Path, log: str, dbc: str) -> None:
    """The command, with that bus."""
    from terrapin_tools import cli
    from terrapin_tools.logs import bus

    with count.open("r+b") as file, mmap.mmap(file.fileno(), 8) as shared:
        bus.open_bus = lambda *_: Telemetry(shared)
        sys.argv = ["terrapin", "log", "record", log, "--link", "can:telemetry:0", "--dbc", dbc]
        cli.main()


def resident(pid: int) -> tuple[float, float]:
    """Memory now and at most [MB]."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    found = {line.split(":")[0]: float(line.split()[1]) / 1024 for line in lines if line.startswith(("VmRSS", "VmHWM"))}
    return found["VmRSS"], found["VmHWM"]


def measure(kind: str, seconds: float) -> bool:
    rate = telemetry()[1]
    with tempfile.TemporaryDirectory() as folder:
        path, count = Path(folder) / f"x{kind}", Path(folder) / "count"
        count.write_bytes(bytes(8))
        dbc = str(paths.build() / "generated" / "terrapin.dbc")
        settled, begin = 0.0, time.monotonic()
        command = [sys.executable, __file__, "recorder", str(count), str(path), dbc]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            while (given := int.from_bytes(count.read_bytes(), "little")) < seconds * rate:
                assert process.poll() is None, "the recorder has ended"
                if not settled and given >= min(SETTLED, seconds / 2) * rate:
                    settled = resident(process.pid)[0]
                time.sleep(0.02)
            last, most = resident(process.pid)
            process.send_signal(signal.SIGKILL)
        took = time.monotonic() - begin
        given = int.from_bytes(count.read_bytes(), "little")
        print(
            f"{kind}: {given / rate:.0f} s of telemetry, {given} frames ({rate:.0f}/s) written in {took:.0f} s, "
            f"{path.stat().st_size / 1e6:.0f} MB; memory {settled:.0f} MB after {min(SETTLED, seconds / 2):.0f} s, "
            f"{last:.0f} MB in the end, {most:.0f} MB at most (bound {BOUND:.0f}); ",
            end="",
            flush=True,
        )
        reader, read, whole = LogReader(path), 0, True
        for block in reader.blocks():
            numbers = np.ascontiguousarray(block.data[:, :4]).view("<u4").ravel()
            whole &= bool(np.array_equal(numbers, np.arange(read, read + len(block))))
            read += len(block)
        lost = (given - read) / rate
        print(
            f"after kill -9 {read} frames are read, {'each in its place' if whole else 'NOT IN ORDER'}, the last "
            f"{lost:.2f} s missing (bound 1); load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
            flush=True,
        )
        return whole and most <= BOUND and lost <= 1.0


if __name__ == "__main__":
    given = sys.argv[1:]
    if given and given[0] == "recorder":
        recorder(Path(given[1]), given[2], given[3])
        sys.exit()
    length = float(given[0]) if given and given[0].isdigit() else 0.0
    wanted = [kind for kind in GROWING if not set(given) & set(GROWING) or kind in given]
    held = [measure(kind, length or LENGTHS.get(kind, HOUR)) for kind in wanted]
    sys.exit(0 if all(held) else 1)
