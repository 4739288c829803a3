"""A full 1 Mbit/s bus, 8,000 frames/s, over a pty: nothing lost in terminal, log and page; cores, redraws a second.

python tests/bench/bench_live.py [SECONDS] [monitor] [page]
"""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import struct
import subprocess
import sys
import tempfile
import termios
import time
import urllib.request
from pathlib import Path
from typing import Any

from slcan_feeder import Feeder

from host_tools.logs.reading import read_log

RATE, SECONDS = 8000, 60.0
CORES, REDRAWS = 1.0, 25.0
TERRAPIN = str(Path(sys.executable).parent / "terrapin")


def monitor(seconds: float) -> bool:
    """`terrapin monitor` on 80 x 24: its share of a core, and the frames that it saw."""
    with Feeder(RATE, seconds) as feeder:
        pid, terminal = pty.fork()
        if pid == 0:
            os.environ["TERM"] = "xterm-256color"
            link = f"serial:{feeder.path}"
            os.execv(TERRAPIN, [TERRAPIN, "monitor", "--link", link, "--bitrate", "1000000"])
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        shown, quitting, done = b"", False, time.monotonic() + seconds + 60
        end: float | None = None
        sent: dict[str, float] = {}
        while time.monotonic() < done:
            if select.select([terminal], [], [], 0.2)[0]:
                try:
                    piece = os.read(terminal, 65536)
                except OSError:
                    break
                shown = (shown + piece)[-4000:]
            if end is None and select.select([feeder.output], [], [], 0)[0]:
                sent = feeder.sent()
                end = time.monotonic() + 1.0
            if end is not None and time.monotonic() > end and not quitting:
                os.write(terminal, b"q")
                quitting = True
        _, status, usage = os.wait4(pid, 0)
    found = re.findall(rb"(\d+) frames seen, (\d+) lost", shown)
    seen, lost = map(int, found[-1]) if found else (0, -1)
    cores = (usage.ru_utime + usage.ru_stime) / (sent["seconds"] + 1.0)  # its start included
    print(
        f"monitor: {sent['sent']:.0f} frames sent in {sent['seconds']:.1f} s (late by {sent['latest'] * 1e3:.0f} ms at "
        f"most), {seen} seen, {lost} lost, {cores:.2f} cores (bound {CORES:g}), {usage.ru_maxrss / 1024:.0f} MB"
    )
    return os.waitstatus_to_exitcode(status) == 0 and seen == sent["sent"] and lost == 0 and cores <= CORES


def call(address: str, path: str, body: dict[str, Any] | None = None) -> Any:
    base, _, token = address.partition("?token=")
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    data = json.dumps(body).encode() if body is not None else None
    with urllib.request.urlopen(urllib.request.Request(f"{base}api/{path}", data, headers)) as answer:
        return json.loads(answer.read())


def page(seconds: float) -> bool:
    """The Live tab in Chromium: frames in its pictures, in the log, redraws a second."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder:
        command = [TERRAPIN, "web", "--no-open", "--workspace", folder]
        with (
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server,
            sync_playwright() as playwright,
            Feeder(RATE, seconds) as feeder,
        ):
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
            tab = browser.new_page(viewport={"width": 1280, "height": 800})
            tab.goto(f"{address}#live")
            tab.wait_for_selector(".tab-live .stop")
            tab.wait_for_timeout(1500)
            call(address, "live", {"source": f"serial:{feeder.path}", "bitrate": 1_000_000})
            call(address, "live/record", {"do": "start", "name": "full.mf4"})
            tab.wait_for_timeout(1000)
            state = "e => ({...e.dataset})"
            before, begin = tab.eval_on_selector(".tab-live", state), time.monotonic()
            tab.wait_for_timeout((seconds - 3) * 1000)
            after, took = tab.eval_on_selector(".tab-live", state), time.monotonic() - begin
            sent = feeder.sent()
            tab.wait_for_timeout(1500)
            last = tab.eval_on_selector(".tab-live", state)
            call(address, "live/record", {"do": "stop"})
            browser.close()
            server.terminate()
        log, cut = read_log(Path(folder) / "logs" / "full.mf4")
    redraws = (int(after["redraws"]) - int(before["redraws"])) / took
    print(
        f"page: {sent['sent']:.0f} frames sent in {sent['seconds']:.1f} s, {last['frames']} in pictures, "
        f"{last['missed']} missed, {len(log)} in the log{f' ({cut})' if cut else ''}, {last['lost']} lost, "
        f"{redraws:.1f} redraws/s (bound {REDRAWS:g})"
    )
    counts = {int(last["frames"]), len(log), round(sent["sent"])}
    return len(counts) == 1 and last["missed"] == "0" and redraws >= REDRAWS


if __name__ == "__main__":
    given = sys.argv[1:]
    length = float(given[0]) if given and given[0].replace(".", "").isdigit() else SECONDS
    wanted = [f for f in (monitor, page) if not set(given) & {"monitor", "page"} or f.__name__ in given]
    held = [f(length) for f in wanted]  # each of them, whatever the first says
    sys.exit(0 if all(held) else 1)
