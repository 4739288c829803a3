"""Where frames come from: a bus, a log at its own pace, the simulator. Each is polled and never blocks."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from host_tools.errors import UserError
from host_tools.logs.frames import Frames, frames

__all__ = ["Bus", "LogFile", "Simulator", "Source"]


class Source(Protocol):
    """`poll` gives what came since the last call; `over`: nothing more will come."""

    name: str
    over: bool

    def poll(self) -> Frames: ...
    def close(self) -> None: ...


class Bus:
    """A bus that python-can knows; a thread listens. UserError (status 1) when it cannot be opened."""

    def __init__(self, link: str, bitrate: int) -> None:
        from host_tools.logs.bus import open_bus

        self.name = link
        self.over = False
        self.lost = 0
        self._bus = open_bus(link, bitrate)
        self._blocks: queue.SimpleQueue[Frames] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._error: UserError | None = None
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        from host_tools.logs.bus import receive

        try:
            while not self._stop.is_set():
                block = receive(self._bus, 0.03)
                if len(block):
                    self._blocks.put(block)
        except UserError as error:
            self._error = error

    def poll(self) -> Frames:
        parts = []
        while not self._blocks.empty():
            parts.append(self._blocks.get())
        if self._error is not None and not parts:
            raise self._error
        from host_tools.logs.frames import joined

        return joined(Path(self.name), parts)

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)
        self._bus.shutdown()


class LogFile:
    """A log at its own pace, `speed` times as fast."""

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        from host_tools.logs.reading import read_log

        self._log, _ = read_log(path)
        self.name = path.name or str(path)
        self.over = len(self._log) == 0
        self._speed = speed
        self._begin = time.monotonic()
        self._done = 0

    def poll(self) -> Frames:
        first = self._log.times[0] if len(self._log) else 0.0
        until = first + (time.monotonic() - self._begin) * self._speed
        end = int(np.searchsorted(self._log.times, until, side="right"))
        block = self._log.pick(np.arange(self._done, end))
        self._done = end
        self.over = end >= len(self._log)
        return block

    def close(self) -> None:
        pass


class Simulator:
    """A scenario in real time with this build's controller; a thread runs it."""

    def __init__(self, scenario: str) -> None:
        from hil.run import run
        from hil.scenario import find_scenario, load_scenario

        chosen = replace(load_scenario(find_scenario(scenario)), real_time=True)
        self.name = f"simulator: {chosen.name}"
        self.over = False
        self._stop = False
        self._error: Exception | None = None
        self._tick = 0
        self._blocks: queue.SimpleQueue[Frames] = queue.SimpleQueue()

        def work() -> None:
            try:
                run(chosen, observers=[self])
            except _StoppedError:
                pass
            except Exception as error:  # told by poll, in the thread that can show it
                self._error = error
            self.over = True

        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()

    def write(self, records: npt.NDArray[Any]) -> None:
        """Rows of the simulator's log (hil.run.Observer)."""
        if self._stop:
            raise _StoppedError
        times, names, payloads = [], [], []
        for tick, record in enumerate(records, self._tick):
            for frame in (*record["host"][: record["host_count"]], *record["answer"][: record["answer_count"]]):
                times.append(tick * 1e-3)
                names.append(int(frame["id"]))
                payloads.append(frame["data"][: frame["length"]].tobytes())
        self._tick += len(records)
        self._blocks.put(frames(Path("simulator"), times, names, payloads, [0] * len(times)))

    def poll(self) -> Frames:
        from host_tools.logs.frames import joined

        if self._error is not None:
            raise UserError(str(self._error), status=1)
        parts = []
        while not self._blocks.empty():
            parts.append(self._blocks.get())
        return joined(Path("simulator"), parts)

    def close(self) -> None:
        self._stop = True
        self._thread.join(timeout=2.0)


class _StoppedError(Exception):
    """The display was closed."""
