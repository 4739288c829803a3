"""A full 1 Mbit/s bus, 8,000 frames/s, over a pty: nothing lost in terminal, log and page; cores, redraws a second. The
simulator over a pty into the page for as long. `steady`: 2,000 frames/s, with the robot and eight strips drawn, and the
memory that server and page hold after the first piece and at the end (ten minutes: 600 steady).

python tests/bench/bench_live.py [SECONDS] [monitor] [page] [simulator] [steady]
"""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import shutil
import struct
import sys
import tempfile
import termios
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, Playwright
from slcan_feeder import Feeder

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "web"))

from serving import Server  # beside the tests that use it

from terrapin_hil.messages import interface
from terrapin_tools.logs.reading import read_log

RATE, SECONDS = 8000, 60.0
CORES, REDRAWS = 1.0, 25.0
STEADY, STEADY_REDRAWS = 2000, 29.0  # frames/s; the page asks for 30 redraws a second
GROWTH = 0.05  # of the memory, from the first piece to the end
STRIPS = (
    "MOTION.slip", "GROUND.torque", "ELECTRICAL.current", "ELECTRICAL.voltage", "MOTION.shell_speed",
    "MOTION.ground_speed", "ATTITUDE.swing_angle", "WINDOW.current",
)  # fmt: skip
PIECE = 10.0  # s over which redraws are counted too, so that a page that stands still for a while shows
FLAGS = ["--no-sandbox", "--disable-gpu"]  # as tests/browser: drawn by the processor
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
    if not sent:
        print(f"monitor: ended with status {status} before all was sent; its last words: {shown[-200:]!r}")
        return False
    cores = (usage.ru_utime + usage.ru_stime) / (sent["seconds"] + 1.0)  # its start included
    print(
        f"monitor: {sent['sent']:.0f} frames sent in {sent['seconds']:.1f} s (late by {sent['latest'] * 1e3:.0f} ms at "
        f"most), {seen} seen, {lost} lost, {cores:.2f} cores (bound {CORES:g}), {usage.ru_maxrss / 1024:.0f} MB"
    )
    return os.waitstatus_to_exitcode(status) == 0 and seen == sent["sent"] and lost == 0 and cores <= CORES


@contextmanager
def running(server: Server) -> Iterator[Server]:
    try:
        yield server
    finally:
        server.stop()


def processor_seconds(root: int) -> dict[str, float]:
    """Processor time [s] of a process and all below it, by role: Chromium tells its own (renderer, gpu-process ...)."""
    parents: dict[int, int] = {}
    used: dict[int, float] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it ended meanwhile
            continue
        parents[int(folder.name)] = int(fields[1])
        used[int(folder.name)] = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")  # with children that ended
    found: dict[str, float] = {}
    for process, seconds in used.items():
        above = process
        while above not in (root, 0):
            above = parents.get(above, 0)
        if above == root:
            with suppress(OSError):
                words = Path(f"/proc/{process}/cmdline").read_bytes().replace(b" ", b"\0").split(b"\0")
                kinds = [w[7:].decode() for w in words if w.startswith(b"--type=")]
                role = kinds[0] if kinds else Path(words[0].decode()).name
                found[role] = found.get(role, 0.0) + seconds
    return found


def held(server: int) -> tuple[float, float]:
    """MB that the server with what it started holds, and the browser, shared pages counted once (Pss)."""
    import psutil

    found = [0, 0]
    ours = {server, *(one.pid for one in psutil.Process(server).children(recursive=True))}
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            if process.pid in ours or "chrom" in process.name():
                found[process.pid not in ours] += process.memory_full_info().pss
    return found[0] / 1e6, found[1] / 1e6


def live_tab(playwright: Playwright, server: Server, strips: Sequence[str] = ()) -> Page:
    browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
    tab = browser.new_page(viewport={"width": 1280, "height": 800})
    if strips:
        tab.add_init_script(f"localStorage.setItem('terrapin-live-signals', {json.dumps(json.dumps(strips))})")
    tab.goto(f"{server.line}#live")
    tab.wait_for_selector("#live-source")
    tab.wait_for_timeout(2000)  # what the page loads is no part of this
    return tab


def counts(tab: Page) -> dict[str, float]:
    """What the page counts itself."""
    found = tab.eval_on_selector(".tab-live", "e => ({...e.dataset})")
    return {name: float(value) for name, value in found.items() if name != "state"}


def simulator(seconds: float) -> bool:
    """The Live tab fed by the simulator, its controller on a pty: shipped scenarios until they make so many seconds."""
    from playwright.sync_api import sync_playwright

    fast, ticks, rounds, good = interface().messages["SENSORS_FAST"].id, 0, 0, True
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Server(Path(folder))) as server,
        sync_playwright() as playwright,
    ):
        tab = live_tab(playwright, server)
        while ticks < 1000 * seconds:
            rounds += 1
            source = {"source": "simulator:floor_to_sand", "controller": "pty"}
            assert server.ask("POST", "/api/live", source).status == 200
            assert server.ask("POST", "/api/live/record", {"do": "start", "name": f"{rounds}.mf4"}).status == 200
            tab.wait_for_selector(".tab-live[data-state=live]")
            tab.wait_for_selector(".tab-live[data-state=over]", timeout=120_000)
            seen = counts(tab)
            log, _ = read_log(server.workspace / "logs" / f"{rounds}.mf4")
            made = (
                np.round(log.times[log.identifiers == fast] * 1e3).astype(int) % 1_000_000
            )  # a log's own start is apart
            whole = bool(np.all(np.diff(made) == 1))  # each tick once, in order
            good &= whole and seen["frames"] == seen["total"] and seen["missed"] == seen["lost"] == 0
            ticks += len(made)
            print(
                f"simulator over a pty: {seen['total']:.0f} frames, {seen['frames']:.0f} in pictures, "
                f"{seen['missed']:.0f} missed, {seen['lost']:.0f} lost; {len(log)} in the log since it was asked for, "
                f"{len(made)} ticks {'without a gap' if whole else 'WITH GAPS'}",
                flush=True,
            )
    return good


def steady(seconds: float) -> bool:
    """The Live tab in daily use: the robot and eight strips."""
    return page(seconds, STEADY, STRIPS, STEADY_REDRAWS)


def page(seconds: float, rate: int = RATE, strips: Sequence[str] = (), bound: float = REDRAWS) -> bool:
    """The Live tab in Chromium: frames in its pictures, in the log, redraws a second, cores and memory of server and
    browser."""
    from playwright.sync_api import TimeoutError, sync_playwright

    with (
        tempfile.TemporaryDirectory() as folder,
        running(Server(Path(folder))) as server,
        sync_playwright() as playwright,
        Feeder(rate, seconds) as feeder,
    ):
        tab = live_tab(playwright, server, strips)
        if strips:
            tab.set_viewport_size({"width": 1280, "height": 1000})  # the robot is on the screen

        def state() -> dict[str, float]:
            return counts(tab)

        def processors() -> dict[str, float]:
            browsers = processor_seconds(os.getpid())
            parts = {name: browsers.get(name, 0.0) for name in ("renderer", "gpu-process", "chromium")}
            return {"server": sum(processor_seconds(server.process.pid).values()), **parts}

        source = {"source": f"serial:{feeder.path}", "bitrate": 1_000_000}
        assert server.ask("POST", "/api/live", source).status == 200
        assert server.ask("POST", "/api/live/record", {"do": "start", "name": "full.mf4"}).status == 200
        tab.wait_for_selector(".tab-live[data-total]")
        before, used, begin = state(), processors(), time.monotonic()
        slowest, memory = 1e9, [(0.0, 0.0)]
        while feeder.waiting():  # the page counts its own redraws; each piece of ten seconds is looked at too
            first, since = state(), time.monotonic()
            while feeder.waiting() and time.monotonic() < since + PIECE:
                time.sleep(0.2)
            took = time.monotonic() - since
            if took > 0.5 * PIECE or slowest == 1e9:
                slowest = min(slowest, (state()["redraws"] - first["redraws"]) / took)
            now_held = held(server.process.pid)
            memory = [memory[0] if any(memory[0]) else now_held, now_held]
        after, now, took = state(), processors(), time.monotonic() - begin
        sent = feeder.sent()
        with suppress(TimeoutError):  # the counts below say what is missing
            tab.wait_for_selector(f".tab-live[data-total='{sent['sent']:.0f}']", timeout=10_000)
        last = state()
        lanes = tab.locator(".signal-table input:checked").count()
        assert server.ask("POST", "/api/live/record", {"do": "stop"}).status == 200
        log, cut = read_log(server.workspace / "logs" / "full.mf4")
    redraws = (after["redraws"] - before["redraws"]) / took
    cores = ", ".join(f"{name} {(now[name] - used[name]) / took:.2f}" for name in now)
    print(
        f"page: {sent['sent']:.0f} frames sent in {sent['seconds']:.1f} s (late by {sent['latest'] * 1e3:.0f} ms at "
        f"most), {last['frames']:.0f} in pictures, {last['missed']:.0f} missed, {len(log)} in the log"
        f"{f' ({cut})' if cut else ''}, {last['lost']:.0f} lost; {redraws:.1f} redraws/s in all (bound {bound:g}), "
        f"{slowest:.1f} in the slowest {PIECE:.0f} s, {lanes} strips; memory of server and browser "
        f"{memory[0][0]:.0f} + {memory[0][1]:.0f} MB after the first piece, {memory[1][0]:.0f} + {memory[1][1]:.0f} "
        f"MB at the end; cores: {cores}, sender {sent['cores']:.2f}; "
        f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )
    numbers = np.ascontiguousarray(log.data[:, :4]).view("<u4").ravel()
    whole = bool(np.array_equal(numbers, np.arange(round(sent["sent"]))))  # each frame once, in order
    flat = sum(memory[1]) <= (1.0 + GROWTH) * sum(memory[0])
    return whole and flat and last["frames"] == sent["sent"] and last["missed"] == 0 and redraws >= bound


if __name__ == "__main__":
    given = sys.argv[1:]
    length = float(given[0]) if given and given[0].replace(".", "").isdigit() else SECONDS
    every = (monitor, page, simulator, steady)
    wanted = [f for f in every if not set(given) & {f.__name__ for f in every} or f.__name__ in given]
    good = [f(length) for f in wanted]  # each of them, whatever the first says
    sys.exit(0 if all(good) else 1)
