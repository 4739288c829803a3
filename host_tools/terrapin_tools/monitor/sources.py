"""Where frames come from: a bus, a log at its own pace, the simulator. Each is polled and never blocks."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from terrapin_hil.links import LinkName, open_link
from terrapin_hil.links.identity import question, require_fit
from terrapin_hil.links.link import Link
from terrapin_hil.links.names import INPROCESS
from terrapin_hil.messages import interface
from terrapin_hil.scenario.faults import FOREVER, Fault
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import Frames, frames, joined

if TYPE_CHECKING:
    from terrapin_hil.messages import Frame
    from terrapin_hil.simulation import Simulation

__all__ = ["Bus", "LogFile", "Simulator", "Source"]

WAITING = 2_000_000  # frames that a source may be ahead of who polls (70 MB); more are counted as lost
ASKED = 0.5  # s for a controller to say what it was built for
SILENCE = 10.0  # s of a log without a frame that are not waited for
PASSED = 20  # blocks of a log that one poll passes over on its way to where it is to go on
TRUTH_EVERY = 20  # ticks between points of the simulator's truth


class Source(Protocol):
    """`poll` gives what came since the last call; `over`: nothing more will come, `note`: and why, if that matters."""

    name: str
    over: bool = False
    note: str = ""

    @property
    def lost(self) -> int: ...
    def poll(self) -> Frames: ...
    def close(self) -> None: ...


class _Waiting:
    """Blocks that wait to be polled: WAITING frames at most, more are counted as lost. `error` ended the source."""

    def __init__(self) -> None:
        self.lost = 0
        self.error: Exception | None = None
        self._frames = 0
        self._lock = threading.Lock()
        self._blocks: list[Frames] = []

    def put(self, block: Frames) -> None:
        with self._lock:
            if self._frames + len(block) > WAITING:
                self.lost += len(block)
                return
            self._frames += len(block)
            self._blocks.append(block)

    def poll(self, path: Path) -> Frames:
        """All that waits. The error comes after it, as UserError."""
        error = self.error  # looked at first: what came before it is given before it
        with self._lock:
            blocks, self._blocks, self._frames = self._blocks, [], 0
        if error is not None and not blocks:
            raise error if isinstance(error, UserError) else UserError(str(error), status=1)
        return joined(path, blocks)


class Bus(Source):
    """A bus by its name; a thread listens. LinkError or UserError (status 1) when it cannot be opened."""

    def __init__(self, link: LinkName, bitrate: int) -> None:
        from terrapin_tools.logs.bus import open_bus

        self.name = str(link)
        self._bus = open_bus(link, bitrate)
        self._sending = threading.Lock()
        self.tap: Callable[[Frames], None] | None = None  # is given every block as it comes, in the thread that listens
        self._waiting = _Waiting()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        try:
            while not self._stop.is_set():
                block = self._bus.receive(0.03)
                if len(block):
                    self._waiting.put(block)
                    if self.tap is not None:
                        self.tap(block)
        except UserError as error:
            self._waiting.error = error

    def poll(self) -> Frames:
        return self._waiting.poll(Path(self.name))

    @property
    def lost(self) -> int:
        """Frames that nobody polled in time, or that the system had no place for."""
        return self._waiting.lost + self._bus.lost

    @property
    def damaged(self) -> int:
        """Lines that were no SLCAN."""
        return self._bus.damaged

    def require_fitting(self, wait: float = ASKED) -> None:
        """LinkError when a controller says that it is another robot's, or speaks another interface. None may be there
        yet, or be too old to say: what is silent is not refused."""
        wanted = interface().messages["IDENTITY"].id
        self.send(*question())
        end = time.monotonic() + wait
        while time.monotonic() < end:
            for row in np.flatnonzero((block := self.poll()).identifiers == wanted):
                require_fit(self.name, block.payload(int(row)))
                return
            time.sleep(0.01)

    def send(self, identifier: int, data: bytes) -> None:
        """One frame to the bus, from any thread. UserError (status 1) when it cannot be sent."""
        with self._sending:
            self._bus.send(identifier, data)

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)
        self._bus.shutdown()


class LogFile(Source):
    """A log at its own pace, `speed` times as fast, in the order of the file, read as it goes. Where its clock steps
    back, or nothing comes for long, it goes on at once. UserError when the file is no log."""

    lost = 0

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        self._path = path
        self.name = path.name or str(path)
        self.speed, self._loop = speed, False
        self.length: float | None = None  # s, once `measure` has read all of it
        self.turns = 0  # how often it began: where it does so anew, its clock steps back
        self._closed = False
        self._start(0.0)

    def _start(self, position: float) -> None:
        """Reads from the beginning, and shows what comes from `position` [s] on."""
        from terrapin_tools.logs.reading import LogReader

        self._reader = LogReader(self._path)
        self._blocks = self._reader.blocks()
        self._skip = self._from = position
        self._begin = time.monotonic()
        self.turns += 1
        self._block = frames(self._path, [], [], [], [])
        self._due: npt.NDArray[np.float64] = np.zeros(0)  # s from the log's start at which each frame is shown
        self._latest, self._elapsed = 0.0, 0.0
        self._done = 0
        self.over = False
        self._next(first=True)

    def _next(self, first: bool = False) -> None:
        block = next(self._blocks, None)
        while block is not None and not len(block):
            block = next(self._blocks, None)
        if block is None:
            if self.loop and not first:
                self._start(0.0)
                return
            self.over = True
            if self._reader.cut:
                self.note = f"read up to where it was cut off: {self._reader.cut}"
            return
        steps = _steps(block, block.times[0] if first else self._latest)
        self._block, self._done = block, 0
        self._due = self._elapsed + np.cumsum(steps)
        self._latest, self._elapsed = float(block.times[-1]), float(self._due[-1])

    @property
    def position(self) -> float:
        """Where it is [s], without the gaps that are not waited for."""
        now = self._from + (time.monotonic() - self._begin) * self.speed
        return min(now, self._elapsed if self.over else np.inf, self.length or np.inf)

    def seek(self, position: float) -> None:
        """Goes on from there [s]; from its end where that is earlier."""
        self._blocks = iter(())
        self._start(max(0.0, position))

    @property
    def loop(self) -> bool:
        """Whether it begins anew at its end."""
        return self._loop

    def set_loop(self, on: bool) -> None:
        """Begin anew at the end, at once where that is reached already; or do so no more."""
        self._loop = on
        if on and self.over:
            self._start(0.0)

    def set_speed(self, speed: float) -> None:
        """Goes on at another pace, from where it is."""
        self._from, self._begin, self.speed = self.position, time.monotonic(), speed

    def measure(self) -> None:
        """Reads all of it once to know its length: takes as long as reading does."""
        from terrapin_tools.logs.reading import LogReader

        length, latest = 0.0, None
        for block in LogReader(self._path).blocks():
            if self._closed:
                return
            if len(block):
                length += float(_steps(block, block.times[0] if latest is None else latest).sum())
                latest = float(block.times[-1])
        self.length = length

    def poll(self) -> Frames:
        for _ in range(PASSED):
            if self.over or len(self._due) == 0 or self._due[-1] >= self._skip:
                break
            self._next()
            self._begin = time.monotonic()  # it is not there yet
        until = self._from + (time.monotonic() - self._begin) * self.speed
        begin = max(self._done, int(np.searchsorted(self._due, self._skip)) if self._skip else 0)
        end = max(begin, int(np.searchsorted(self._due, until, side="right")))
        block = self._block.pick(np.arange(begin, end))
        self._done = end
        if end >= len(self._block) and not self.over:
            self._next()
        return block

    def close(self) -> None:
        self._closed = True
        self._blocks = iter(())  # closes the file


def _steps(block: Frames, latest: float) -> npt.NDArray[np.float64]:
    """How long each frame is waited for [s]."""
    steps = np.diff(block.times, prepend=latest)
    steps[(steps < 0) | (steps > SILENCE)] = 0.0
    return steps


class Simulator(Source):
    """A scenario in real time with this build's controller, in this process or over a link; a thread runs it."""

    def __init__(self, scenario: str, link: LinkName = INPROCESS) -> None:
        from terrapin_hil.robot.truth import TRUTH
        from terrapin_hil.run.run import run
        from terrapin_hil.scenario.scenario import find_scenario, load_scenario

        self._names = TRUTH
        self.scenario = replace(load_scenario(find_scenario(scenario)), real_time=True)
        self._link = _Tapped(open_link(link))
        self.name = f"simulator: {self.scenario.name}" + (f" over {link}" if link != INPROCESS else "")
        self._stop = False
        self._tick = 0
        self._truth: deque[tuple[float, dict[str, float]]] = deque(maxlen=1000)
        self._waiting = _Waiting()

        def work() -> None:
            try:
                with self._link:
                    run(self.scenario, self._link, observers=[self])
            except _StoppedError:
                pass
            except Exception as error:  # told by poll, in the thread that can show it
                self._waiting.error = error
            self.over = True

        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()

    def truth(self) -> list[tuple[float, dict[str, float]]]:
        """What the robot truly did since the last call: time [s] and the columns of its log's truth, SI."""
        return [self._truth.popleft() for _ in range(len(self._truth))]

    def press_stop(self, pressed: bool) -> None:
        """Open the emergency stop's circuit from the next tick on, or close it."""
        self._link.pressed = pressed

    def write(self, records: npt.NDArray[Any]) -> None:
        """Rows of the simulator's log (terrapin_hil.run.run.Observer)."""
        if self._stop:
            raise _StoppedError
        times, names, payloads = [], [], []
        for tick, record in enumerate(records, self._tick):
            for frame in (*record["host"][: record["host_count"]], *record["answer"][: record["answer_count"]]):
                times.append(tick * 1e-3)
                names.append(int(frame["id"]))
                payloads.append(frame["data"][: frame["length"]].tobytes())
            if tick % TRUTH_EVERY == 0:
                self._truth.append((tick * 1e-3, dict(zip(self._names, record["truth"].tolist(), strict=True))))
        self._tick += len(records)
        self._waiting.put(frames(Path("simulator"), times, names, payloads, [0] * len(times)))

    def poll(self) -> Frames:
        return self._waiting.poll(Path("simulator"))

    @property
    def lost(self) -> int:
        """Frames that nobody polled in time."""
        return self._waiting.lost

    def close(self) -> None:
        self._stop = True
        self._thread.join(timeout=2.0)


class _Tapped(Link):
    """A link at which somebody may press the emergency stop while it runs."""

    def __init__(self, link: Link) -> None:
        self.name = link.name
        self.pressed = False
        self._link = link
        self._slot: int | None = None
        self._was = False

    def start(self, parameters: Mapping[str, float]) -> None:
        self._link.start(parameters)

    def advance(self, simulation: Simulation, ticks: int) -> None:
        if self.pressed != self._was:
            self._was = self.pressed
            now = simulation.done * 1e-3
            fault = Fault("estop_pressed", begin=now, end=FOREVER if self.pressed else now)
            self._slot = simulation.set_fault(fault, self._slot)
        self._link.advance(simulation, ticks)

    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        return self._link.exchange(frames)

    def close(self) -> None:
        self._link.close()


class _StoppedError(Exception):
    """The display was closed."""
