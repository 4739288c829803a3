"""Virtual time: computing takes none, waiting is skipped over. Prints all that candump saw, for two runs to compare."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from kit import Controller, Peer, count, vcan

from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario

SECONDS = 20


def stepping() -> None:
    """The controller by its own clock, an operator's command every 50 ms, a minute's log in seconds."""
    log = Path(os.environ["JOB"]) / "stepping.log"
    with vcan() as bus, Controller("--can", bus) as controller, Peer(bus) as peer:
        dump = None
        if shutil.which("candump"):
            with log.open("w") as file:
                dump = subprocess.Popen(["candump", "-L", bus], stdout=file)
        time.sleep(0.5)
        begin = time.monotonic()
        for i in range(SECONDS * 20):
            peer.command("clear" if i < 20 else "idle" if i < 22 else "run")
            time.sleep(max(0.0, begin + 0.05 * (i + 1) - time.monotonic()))
            peer.listen()
        if dump is not None:
            dump.terminate()
            dump.wait()
        controller.stop()
    text = controller.text
    print(f"ticks {count(text, 'ticks by the clock')} missed {count(text, 'missed')}")
    print(f"late {text.split('late by ')[1].splitlines()[0]}")
    print(f"heard {peer.heard}")
    if dump is not None:
        words = [row.split("#")[1] for row in log.read_text().splitlines() if " 180#" in row]
        ticks = [int(word[6:8] + word[4:6], 16) for word in words]
        late = [b for a, b in pairwise(ticks) if b != (a + 1) % 65536 and b > 100]
        print(f"gaps after the first 100 ms: {len(late)}")
        print(f"candump {hashlib.sha256(log.read_bytes()).hexdigest()} {len(log.read_text().splitlines())} lines")


def lockstep() -> None:
    scenario = replace(load_scenario(find_scenario("steady_sand")), duration=2.0, checks=())
    with vcan() as bus, Controller("--can", bus):
        result = run(scenario, f"socketcan:{bus}")
    print(f"hash {result.output_hash == run(scenario).output_hash} {result.output_hash}")


if __name__ == "__main__":
    {"stepping": stepping, "lockstep": lockstep}[sys.argv[1]]()
