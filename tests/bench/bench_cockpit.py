"""From the page to the bus: a setpoint typed on the page to its COMMAND, and the stop button to its STOP_ALL.

python tests/bench/bench_cockpit.py [SETPOINTS] [STOPS]

Between the server and a simulated robot stands a relay of two pseudo-terminals that notes when a frame passes. Beside
the worst of each stands the longest time for which the machine let a process that asked for 1 ms wait meanwhile.
"""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "web"))

from playwright.sync_api import Page, sync_playwright
from serving import START, Server

from terrapin_hil.messages import interface

SETPOINTS, STOPS = 1000, 20
BOUNDS = {"setpoint": (50.0, 100.0), "stop": (30.0, 60.0)}  # ms: median, 99th percentile
SECONDS = 300.0  # after which something hangs
COMMAND, STOP_ALL = (interface().messages[name] for name in ("COMMAND", "STOP_ALL"))
CHROMIUM = shutil.which("chromium")


class Relay(threading.Thread):
    """Hands bytes on between the server's terminal (`name_of`) and the robot's; keeps when each order passed."""

    def __init__(self, robot: str) -> None:
        super().__init__(daemon=True)
        self._ours, theirs = pty.openpty()
        tty.setraw(theirs)
        self.name_of, self._keep = os.ttyname(theirs), theirs
        self._robot = os.open(robot, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._robot)
        self.setpoints: dict[int, float] = {}
        self.stops: list[float] = []
        self._line = b""
        self.gap = 0.0
        self.start()
        threading.Thread(target=self._measure, daemon=True).start()

    def run(self) -> None:
        while True:
            ready, _, _ = select.select([self._ours, self._robot], [], [], 1.0)
            for source, sink in ((self._ours, self._robot), (self._robot, self._ours)):
                if source not in ready:
                    continue
                data, now = os.read(source, 65536), time.time()
                if source == self._ours:
                    self._note(data, now)
                while data:
                    data = data[os.write(sink, data) :]

    def _note(self, data: bytes, now: float) -> None:
        *lines, self._line = (self._line + data).split(b"\r")
        for line in lines:
            if line[:1] != b"t" or len(line) < 5:
                continue
            identifier, size = int(line[1:4], 16), int(line[4:5])
            payload = bytes.fromhex(line[5 : 5 + 2 * size].decode())
            if identifier == STOP_ALL.id:
                self.stops.append(now)
            elif identifier == COMMAND.id:
                self.setpoints.setdefault(COMMAND.decode(payload)["setpoint"], now)

    def _measure(self) -> None:
        before = time.monotonic()
        while True:
            time.sleep(1e-3)
            now = time.monotonic()
            self.gap, before = max(self.gap, now - before - 1e-3), now


def armed(page: Page) -> None:
    """Armed; a machine that kept the page's heart waiting has let go, and it is armed once more."""
    clear = page.get_by_role("button", name="Clear faults")
    end = time.monotonic() + SECONDS
    while not page.locator(".drive-panel .form").is_visible():
        assert time.monotonic() < end, "not armed"
        if page.locator("[data-tile=Faults] .bad").count():
            clear.click()
        with suppress(Exception):
            page.get_by_role("button", name="Arm …").click(timeout=2000)
            page.get_by_role("dialog").get_by_role("button", name="Arm").click(timeout=2000)
        page.wait_for_timeout(300)


SET = """async ([from, count]) => {
  const number = document.querySelector('.drive-panel input[type=number]');
  const form = document.querySelector('.drive-panel .form');
  const control = document.querySelector('.drive-panel select[aria-label="What is set"]');
  if (control.value !== 'voltage') { control.value = 'voltage'; control.dispatchEvent(new Event('change')); }
  const found = [];
  for (let i = 0; i < count && !form.hidden; i++) {
    number.value = String((from + i) / 1000);
    found.push([from + i, performance.timeOrigin + performance.now()]);
    number.dispatchEvent(new Event('change'));
    await new Promise((next) => { setTimeout(next, 60 + 80 * Math.random()); });
  }
  return found;
}"""


def setpoints(page: Page, relay: Relay, count: int) -> list[float]:
    """ms from each of so many setpoints to its frame. One whose page let go meanwhile is asked for again."""
    took: list[float] = []
    number = 1
    while len(took) < count:
        armed(page)
        asked = page.evaluate(SET, [number, min(50, count - len(took))])
        number += 50
        page.wait_for_timeout(300)
        took += [1e3 * relay.setpoints[n] - at for n, at in asked if n in relay.setpoints]
    return took


def stops(page: Page, relay: Relay, count: int) -> list[float]:
    """ms from so many presses of the stop button to the first STOP_ALL."""
    took = []
    for _ in range(count):
        armed(page)
        relay.stops.clear()
        at = page.evaluate(
            """() => { const at = performance.timeOrigin + performance.now();
              document.querySelector('button.stop').click(); return at; }"""
        )
        end = time.monotonic() + SECONDS
        while not relay.stops:
            assert time.monotonic() < end, "no STOP_ALL"
            page.wait_for_timeout(20)
        took.append(1e3 * relay.stops[0] - at)
        page.wait_for_timeout(1200)
        page.get_by_role("button", name="Release the stop").click()
        page.get_by_role("button", name="Stop", exact=True).wait_for()
    return took


def say(what: str, took: Sequence[float], gap: float) -> bool:
    median, late = np.percentile(took, [50, 99])
    met = median <= BOUNDS[what][0] and late <= BOUNDS[what][1]
    print(
        f"{what}, {len(took)} times: median {median:.1f} ms (bound {BOUNDS[what][0]:g}), 99th percentile {late:.1f} ms "
        f"(bound {BOUNDS[what][1]:g}), worst {max(took):.1f} ms; the machine's own longest gap {1e3 * gap:.1f} ms: "
        f"{'met' if met else 'NOT MET'}",
        flush=True,
    )
    return met


def main() -> int:
    if CHROMIUM is None:
        print("not run here: no Chromium")
        return 0
    counts = [int(text) for text in sys.argv[1:3]]
    many, few = (counts + [SETPOINTS, STOPS][len(counts) :])[:2]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        place = Path(folder) / "robot"
        robot = subprocess.Popen(
            [sys.executable, "-c", START, "sim", "--on", f"pty:{place}"], stdout=subprocess.DEVNULL
        )
        server = Server(Path(folder))
        try:
            end = time.monotonic() + SECONDS
            while not place.exists():
                assert time.monotonic() < end, "no robot"
                time.sleep(0.05)
            relay = Relay(str(place))
            assert server.ask("POST", "/api/live", {"source": f"serial:{relay.name_of}"}).status == 200
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
            page = browser.new_page()
            page.goto(f"{server.line}#live")
            page.locator("[data-tile=State]").wait_for()
            relay.gap = 0.0
            good = say("setpoint", setpoints(page, relay, many), relay.gap)
            relay.gap = 0.0
            good &= say("stop", stops(page, relay, few), relay.gap)
            browser.close()
        finally:
            server.stop()
            robot.terminate()
            robot.wait()
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
