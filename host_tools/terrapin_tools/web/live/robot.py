"""A simulated robot that the server lets live for its pages: `terrapin sim` on a pseudo-terminal, in a process that
ends with what watches it, and its truth beside what the controller says."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path

from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.run.control import ask
from terrapin_tools.errors import UserError
from terrapin_tools.monitor.sources import Bus

__all__ = ["CHANGES", "SimulatedRobot"]

CHANGES = ("ground", "slope", "supply", "tow")  # of `terrapin sim --do` that a page may ask for
STARTS = 120.0  # s that the process may take, on a busy machine
TRUTH_EVERY = 0.05  # s
# It ends with the server, also where that is killed (PR_SET_PDEATHSIG).
PROGRAM = (
    "import ctypes, signal, sys; ctypes.CDLL(None).prctl(1, signal.SIGTERM); "
    "from terrapin_tools.cli import main; sys.argv[0] = 'terrapin'; main()"
)


class SimulatedRobot(Bus):
    """Lives until it is closed. `words`: what `terrapin sim` is told. UserError, status 1, when it does not start."""

    def __init__(self, words: list[str]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="terrapin-web-")
        place = Path(self._folder.name) / secrets.token_hex(6)
        self.bus = f"pty:{place}"
        self._process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "sim", *words, "--on", self.bus],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        try:
            self._wait(place)
            super().__init__(LinkName("serial", channel=str(place)), BIT_RATE)
        except BaseException:
            self._end()
            raise
        self.name = "simulated robot"
        self._points: deque[tuple[float, dict[str, float]]] = deque(maxlen=1000)
        self._closing = threading.Event()
        self._watching = threading.Thread(target=self._watch, name="truth", daemon=True)
        self._watching.start()

    def _wait(self, place: Path) -> None:
        end = time.monotonic() + STARTS
        while time.monotonic() < end:
            if self._process.poll() is not None:
                assert self._process.stderr is not None
                words = self._process.stderr.read().decode("utf-8", "replace").strip().splitlines()
                raise UserError(f"simulated robot: {words[-1] if words else 'it ended at once'}", status=1)
            if place.exists():
                with suppress(UserError):  # it does not answer yet
                    ask("status", self.bus)
                    return
            time.sleep(0.05)
        raise UserError(f"simulated robot: it does not live after {STARTS:g} s", status=1)

    def _watch(self) -> None:
        while not self._closing.wait(TRUTH_EVERY):
            with suppress(UserError):  # it has ended: the bus says so
                before = time.time()
                state = ask("status", self.bus)
                self._points.append(((before + time.time()) / 2, state["truth"]))

    def truth(self) -> list[tuple[float, dict[str, float]]]:
        """What the robot truly did since the last call: time [s] as its frames have it, and the truth's columns, SI."""
        return [self._points.popleft() for _ in range(len(self._points))]

    def change(self, text: str) -> str:
        """Carries out a change as `terrapin sim --do` does, and says what was done. UserError when it is none."""
        return str(ask(text, self.bus)["done"])

    def close(self) -> None:
        self._closing.set()
        self._watching.join(timeout=6.0)
        super().close()
        self._end()

    def _end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(timeout=5.0)
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._folder.cleanup()
