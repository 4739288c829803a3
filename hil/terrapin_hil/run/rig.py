"""The rig around a real board: lines of this computer that reset it, hold its boot pin, press its e-stop and watch its
enable line (libgpiod, PyPI `gpiod`).

    reset = "gpiochip0:4,active-low"   # active: the board is held in reset
    boot = "gpiochip0:5"               # active: after a reset it starts its own loader
    estop = "gpiochip0:6"              # active: the emergency stop is pressed
    enable = "gpiochip0:7,pull-down"   # watched; active: the bridge may drive
    reset_time = "20 ms"               # how long reset is held
    start_time = "1 s"                 # from reset to the first answer
    estop_limit = "2 ms"               # from pressing to the enable line off

Every line may be left out; what needs it is then not done. The names are those of terrapin-controller's own options.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrapin_hil.reading import ReadingError, Section, load

if TYPE_CHECKING:
    import gpiod

__all__ = ["LINES", "Line", "Rig", "RigConfig", "RigError", "load_rig", "parse_line"]

LINES = ("reset", "boot", "estop", "enable")
OUTPUTS = ("reset", "boot", "estop")
_OPTIONS = ("active-low", "pull-up", "pull-down")


class RigError(OSError):
    """A line cannot be had, or did not do what was expected of it. One line."""

    def __str__(self) -> str:
        return str(self.args[0])


@contextmanager
def _failing(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RigError(f"{what}: {error.strerror or error}") from None


@dataclass(frozen=True)
class Line:
    """A GPIO line by name. `chip` is empty when the line's name is looked for on all chips."""

    chip: str
    line: str
    active_low: bool = False
    pull: str = ""


def parse_line(text: object) -> Line:
    """A line from its text `[CHIP:]NAME_OR_OFFSET[,active-low][,pull-up|pull-down]`. ValueError says what was expected.

    >>> parse_line("gpiochip0:17,active-low,pull-up")
    Line(chip='gpiochip0', line='17', active_low=True, pull='up')
    >>> parse_line("ESTOP").line
    'ESTOP'
    """
    expected = "[CHIP:]NAME_OR_OFFSET[,active-low][,pull-up|pull-down]"
    if not isinstance(text, str):
        raise ValueError(f"found {text!r}, expected text: {expected}")
    name, *options = text.split(",")
    chip, colon, line = name.rpartition(":")
    if not line or (colon and not chip) or "\0" in text or any(option not in _OPTIONS for option in options):
        raise ValueError(f"found {text!r}, expected {expected}")
    if not chip and line.isdigit():
        raise ValueError(f"found {text!r}: an offset needs its chip, as in gpiochip0:{line}")
    pulls = [option.removeprefix("pull-") for option in options if option.startswith("pull-")]
    if len(pulls) > 1:
        raise ValueError(f"found {text!r}, expected one pull at most")
    return Line(chip, line, "active-low" in options, pulls[0] if pulls else "")


@dataclass(frozen=True)
class RigConfig:
    """A rig's file. Times in seconds."""

    reset: Line | None = None
    boot: Line | None = None
    estop: Line | None = None
    enable: Line | None = None
    reset_time: float = 0.02
    start_time: float = 1.0
    estop_limit: float = 2e-3


def _line(root: Section, key: str) -> Line | None:
    return root.value(key, parse_line) if key in root else None


def load_rig(path: Path) -> RigConfig:
    """The rig that a TOML file describes. ReadingError names file, line, field and what was expected."""
    root = load(path)
    defaults = RigConfig()
    lines = {name: _line(root, name) for name in LINES}
    config = RigConfig(
        **lines,
        reset_time=root.quantity("reset_time", "s", defaults.reset_time, 1e-3, 10.0),
        start_time=root.quantity("start_time", "s", defaults.start_time, 0.0, 60.0),
        estop_limit=root.quantity("estop_limit", "s", defaults.estop_limit, 1e-4, 0.1),
    )
    root.done()
    named = [line for line in lines.values() if line is not None]
    if not named:
        raise ReadingError(f"{path}: found no line, expected at least one of {', '.join(LINES)}")
    if len({(line.chip, line.line) for line in named}) < len(named):
        raise ReadingError(f"{path}: found the same line twice")
    return config


def _chip_path(chip: str) -> str:
    if chip.startswith("/"):
        return chip
    return f"/dev/gpiochip{chip}" if chip.isdigit() else f"/dev/{chip}"


def _find(line: Line) -> tuple[str, int]:
    """Path of its chip, and its offset. RigError when there is none."""
    import gpiod

    paths = [_chip_path(line.chip)] if line.chip else sorted(map(str, Path("/dev").glob("gpiochip*")))
    for path in paths:
        try:
            with gpiod.Chip(path) as chip:
                return path, chip.line_offset_from_id(int(line.line) if line.line.isdigit() else line.line)
        except OSError as error:
            if line.chip and not re.search("line", str(error), re.IGNORECASE):
                raise RigError(f"chip {line.chip}: {error.strerror or error}") from None
        except ValueError:
            continue
    raise RigError(f"no such line: {line.chip + ':' if line.chip else ''}{line.line}")


class Rig(AbstractContextManager["Rig"]):
    """The lines of a rig, requested; given back, with nothing pressed, on leaving. RigError when one cannot be had."""

    def __init__(self, config: RigConfig) -> None:
        self.config = config
        self._requests: dict[str, tuple[gpiod.LineRequest, int]] = {}
        try:
            for name in LINES:
                line = getattr(config, name)
                if line is not None:
                    self._requests[name] = self._request(name, line)
        except ModuleNotFoundError:
            raise RigError("a rig needs the Python package gpiod: pip install 'terrapin-robot[rig]'") from None
        except BaseException:
            self.close()
            raise

    @staticmethod
    def _request(name: str, line: Line) -> tuple[gpiod.LineRequest, int]:
        import gpiod
        from gpiod.line import Bias, Direction, Edge, Value

        path, offset = _find(line)
        settings: dict[str, Any] = {"active_low": line.active_low}
        if line.pull:
            settings["bias"] = Bias.PULL_UP if line.pull == "up" else Bias.PULL_DOWN
        if name in OUTPUTS:
            settings |= {"direction": Direction.OUTPUT, "output_value": Value.INACTIVE}
        else:
            settings |= {"direction": Direction.INPUT, "edge_detection": Edge.BOTH}
        with _failing(f"{name}: line {line.line} cannot be had"):
            request = gpiod.request_lines(
                path, consumer=f"terrapin {name}", config={offset: gpiod.LineSettings(**settings)}
            )
        return request, offset

    def has(self, *names: str) -> bool:
        """All of these lines are named."""
        return all(name in self._requests for name in names)

    def set(self, name: str, active: bool) -> None:
        """Drives a line."""
        from gpiod.line import Value

        request, offset = self._requests[name]
        with _failing(name):
            request.set_value(offset, Value.ACTIVE if active else Value.INACTIVE)

    def enabled(self) -> bool:
        """The bridge may drive."""
        from gpiod.line import Value

        request, offset = self._requests["enable"]
        with _failing("enable"):
            return bool(request.get_value(offset) == Value.ACTIVE)

    def enable_edges(self, wait: float = 0.0) -> list[tuple[int, bool]]:
        """Edges of the enable line so far: (time in ns of the monotonic clock, active). Waits for the first."""
        request, _ = self._requests["enable"]
        edges: list[tuple[int, bool]] = []
        with _failing("enable"):
            while request.wait_edge_events(wait if not edges else 0.0):
                for event in request.read_edge_events():
                    rising = event.event_type is event.Type.RISING_EDGE
                    edges.append((event.timestamp_ns, rising))
        return edges

    def reset(self, loader: bool = False) -> None:
        """Resets the board, into its own loader with `loader` (for flashing); waits for its start."""
        if loader and not self.has("boot"):
            raise RigError("the rig's file names no line `boot`")
        if not self.has("reset"):
            raise RigError("the rig's file names no line `reset`")
        with self._held("boot") if loader else nullcontext():
            with self._held("reset"):
                time.sleep(self.config.reset_time)
            time.sleep(self.config.start_time)

    @contextmanager
    def _held(self, name: str) -> Iterator[None]:
        self.set(name, True)
        try:
            yield
        finally:
            self.set(name, False)

    def press_estop(self, wait: float = 0.1) -> float:
        """Presses the e-stop (it stays pressed) while the bridge is enabled; seconds until the enable line was off.

        From just before the line is driven to the kernel's time of the edge: never less than the controller took.
        RigError when nothing happens within `wait`, well below the time after which a missing COMMAND puts it off.
        """
        self.enable_edges()
        if not self.enabled():
            raise RigError("the enable line is off already: there is nothing to measure")
        begin = time.monotonic_ns()
        self.set("estop", True)
        end = time.monotonic() + wait
        while (left := end - time.monotonic()) > 0:
            for at, active in self.enable_edges(left):
                if not active:
                    return (at - begin) * 1e-9
        raise RigError(f"the enable line is still on {wait:g} s after the e-stop was pressed")

    def close(self) -> None:
        """Releases everything. Closing twice is allowed."""
        with ExitStack() as stack:  # an error of one line does not keep the others
            for name, (request, _) in self._requests.items():
                stack.callback(request.release)
                if name in OUTPUTS:
                    stack.callback(self.set, name, False)
        self._requests = {}

    def __exit__(self, *error: object) -> None:
        self.close()
