"""A link that breaks, a controller that falls silent or sends nonsense, a run that is stopped, a disk that fills up.

Each ends in one line on standard error, the right exit status, a log that is whole up to that moment, and no
controller left behind.
"""

from __future__ import annotations

import contextlib
import os
import resource
import select
import signal
import subprocess
import sys
import threading
import tomllib
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import LinkName
from terrapin_hil.links.pythoncan import opened
from terrapin_hil.links.slcan import ControllerProcess
from terrapin_hil.messages import interface
from terrapin_hil.scenario.scenario import find_scenario
from terrapin_tools.cli import main
from terrapin_tools.errors import UserError
from terrapin_tools.flash.wires import open_serial
from terrapin_tools.logs import candump
from terrapin_tools.logs.slcan import SlcanBus
from tests.waiting import BOUND, wait_for

TERRAPIN = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]
ACTUATE = b"t%03X" % interface().messages["ACTUATE"].id


@pytest.fixture
def long(tmp_path: Path) -> Path:
    """A scenario that is still running when something goes wrong."""
    file = tmp_path / "long.toml"
    file.write_text(find_scenario("steady_sand").read_text().replace('duration = "10 s"', 'duration = "3000 s"'))
    return file


def whole(folder: Path) -> int:
    """Ticks in a log that broke off: every one complete and in order; run.toml says that the run did not end."""
    frames = candump.read(folder / "telemetry.log")
    description = interface()
    sent = frames.times[frames.identifiers == description.messages["SENSORS_FAST"].id]
    answered = frames.times[frames.identifiers == description.messages["ACTUATE"].id]
    assert np.array_equal(np.round(sent * 1000), np.arange(len(sent)))
    assert np.array_equal(sent, answered)
    assert tomllib.loads((folder / "run.toml").read_text())["run"]["complete"] is False
    return len(sent)


# ------------------------------------------------------------------ what a wire can do


class Wire:
    """A pty between the host and a real controller. After `after` answers it does `harm` to each further line of an
    answer: the line that goes on to the host, or None to close the wire."""

    def __init__(self, harm: Callable[[bytes], bytes | None], after: int = 2500) -> None:
        self.harm, self.left = harm, after
        self.controller = ControllerProcess()
        self.far = os.open(self.controller.start(), os.O_RDWR | os.O_NOCTTY)
        self.near, device = os.openpty()
        tty.setraw(self.far)
        tty.setraw(device)
        os.set_blocking(self.near, False)
        self.device, self.path = device, os.ttyname(device)
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.carry)
        self.thread.start()

    def carry(self) -> None:
        pending = b""
        while not self.over.is_set():
            ready, _, _ = select.select([self.near, self.far], [], [], 0.05)
            if self.near in ready:
                os.write(self.far, os.read(self.near, 4096))
            if self.far in ready:
                *lines, pending = (pending + os.read(self.far, 4096)).split(b"\r")
                for line in lines:
                    text: bytes | None = line + b"\r"
                    self.left -= line[:4] == ACTUATE
                    if self.left < 0:
                        text = self.harm(line + b"\r")
                    if text is None:
                        os.close(self.device)
                        os.close(self.near)
                        self.device = self.near = -1
                        return
                    while text and not self.over.is_set():
                        select.select([], [self.near], [], 0.05)
                        with contextlib.suppress(BlockingIOError):
                            text = text[os.write(self.near, text) :]

    def close(self) -> None:
        self.over.set()
        self.thread.join()
        for descriptor in (self.near, self.device, self.far):
            if descriptor >= 0:
                os.close(descriptor)
        self.controller.stop()


@pytest.fixture
def wire() -> Iterator[Callable[[Callable[[bytes], bytes | None]], Wire]]:
    made: list[Wire] = []

    def make(harm: Callable[[bytes], bytes | None]) -> Wire:
        made.append(Wire(harm))
        return made[-1]

    yield make
    for one in made:
        one.close()


def flip(line: bytes) -> bytes:
    """One bit of the first byte of data of an ACTUATE."""
    return line[:5] + (b"%X" % (int(line[5:6], 16) ^ 1)) + line[6:] if line[:4] == ACTUATE else line


def stale() -> Callable[[bytes], bytes]:
    kept: list[bytes] = []

    def harm(line: bytes) -> bytes:
        if line[:4] == ACTUATE:
            kept.append(line)
            return kept[0]
        return line

    return harm


HARM: dict[str, tuple[Callable[[bytes], bytes | None], str]] = {
    "closed": (lambda line: None, "the link disappeared"),
    "silent": (lambda line: b"", "no answer within 2 s"),
    "a bit flipped": (flip, "bad CRC"),
    "an answer lost": (lambda line: b"" if line[:4] == ACTUATE else line, "without ACTUATE"),
    "an old answer": (stale(), "for another tick"),
    "half a line": (lambda line: line[: len(line) // 2] + b"\r", "no SLCAN"),
    "noise": (lambda line: b"\x01\x02\x03\x0a\x7f\x80\xff\xfe\r", "no SLCAN"),
    "an endless line": (lambda line: b"x" * 100_000, "no SLCAN"),
    "a line refused": (lambda line: b"\a", "refused a line"),
}


@pytest.mark.parametrize("name", HARM)
def test_a_bad_wire(
    tmp_path: Path,
    long: Path,
    wire: Callable[[Callable[[bytes], bytes | None]], Wire],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    name: str,
) -> None:
    harm, expected = HARM[name]
    line = wire(harm)
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["terrapin", "run", str(long), "--link", f"serial:{line.path}", "--out", str(out)])
    with pytest.raises(SystemExit) as left:
        main()
    written, error = capfd.readouterr()
    assert left.value.code == 1
    assert written == ""
    assert error.startswith("terrapin: ")
    assert error.count("\n") == 1
    assert expected in error
    assert line.path in error or "tick 2" in error
    assert 2000 < whole(out) <= 2501


# ------------------------------------------------------------------ a run that is stopped


class Started:
    """`terrapin run` as a process in a session of its own, writing its log."""

    def __init__(self, scenario: Path, out: Path, *more: str, limit: int | None = None) -> None:
        def prepare() -> None:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored in a shell's background jobs
            if limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        self.out = out
        self.process = subprocess.Popen(
            [*TERRAPIN, "run", str(scenario), "--out", str(out), *more],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=paths.ROOT,
            start_new_session=True,
            preexec_fn=prepare,
        )

    def running(self, size: int = 100_000) -> Started:
        log = self.out / "telemetry.log"
        self.until(lambda: log.is_file() and log.stat().st_size > size)
        return self

    def until(self, true: Callable[[], bool]) -> None:
        wait_for(true)

    def controllers(self) -> list[int]:
        """Processes that this one started."""
        found = []
        for entry in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = entry.read_text().rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                continue
            if int(fields[1]) == self.process.pid:
                found.append(int(entry.parent.name))
        return found

    def ended(self) -> tuple[int, str]:
        out, error = self.process.communicate(timeout=BOUND)
        assert out == ""
        return self.process.returncode, error


@pytest.fixture
def start() -> Iterator[Callable[..., Started]]:
    made: list[Started] = []

    def make(*arguments: object, **more: int) -> Started:
        made.append(Started(*arguments, **more))  # type: ignore[arg-type]
        return made[-1]

    yield make
    for one in made:
        if one.process.poll() is None:
            one.process.kill()
        one.process.communicate()


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.parametrize(
    ("number", "status", "words"),
    [
        (signal.SIGINT, 130, "interrupted"),
        (signal.SIGTERM, 143, "stopped by SIGTERM"),
    ],
)
def test_a_signal_to_the_whole_group(
    tmp_path: Path, long: Path, start: Callable[..., Started], number: signal.Signals, status: int, words: str
) -> None:
    """As a terminal sends it: the controller must not take it for its own and break the link first."""
    run = start(long, tmp_path / "out", "--link", "pty").running()
    controllers = run.controllers()
    assert len(controllers) == 1
    os.killpg(run.process.pid, number)
    returned, error = run.ended()
    assert returned == status
    assert error.startswith(f"terrapin: {words}")
    assert error.count("\n") == 1
    assert whole(run.out) > 500
    run.until(lambda: not alive(controllers[0]))


def test_a_run_that_is_killed_leaves_its_log_and_no_controller(
    tmp_path: Path, long: Path, start: Callable[..., Started]
) -> None:
    run = start(long, tmp_path / "out", "--link", "pty").running()
    controllers = run.controllers()
    run.process.kill()
    assert run.ended() == (-signal.SIGKILL, "")
    assert whole(run.out) >= 500
    run.until(lambda: not alive(controllers[0]))


def test_a_controller_that_is_killed(tmp_path: Path, long: Path, start: Callable[..., Started]) -> None:
    run = start(long, tmp_path / "out", "--link", "pty").running()
    os.kill(run.controllers()[0], signal.SIGKILL)
    status, error = run.ended()
    assert status == 1
    assert error.endswith(": the link disappeared\n")
    assert error.count("\n") == 1
    assert whole(run.out) > 500


def test_a_controller_that_hangs(tmp_path: Path, long: Path, start: Callable[..., Started]) -> None:
    run = start(long, tmp_path / "out", "--link", "pty").running()
    controller = run.controllers()[0]
    os.kill(controller, signal.SIGSTOP)
    status, error = run.ended()
    assert status == 1
    assert error.endswith(": no answer within 2 s\n")
    assert error.count("\n") == 1
    assert whole(run.out) > 500
    assert not alive(controller)


# ------------------------------------------------------------------ where the log goes


@pytest.mark.parametrize("link", ["inprocess", "pty"])
def test_a_file_that_may_not_grow(tmp_path: Path, long: Path, start: Callable[..., Started], link: str) -> None:
    """What a full disk does, too: the write fails in the middle of a line."""
    run = start(long, tmp_path / "out", "--link", link, limit=200_010)
    status, error = run.ended()
    assert status == 1
    assert error == f"terrapin: {run.out}: cannot write the log: File too large\n"
    log = run.out / "telemetry.log"
    assert log.stat().st_size == 200_010
    assert not log.read_bytes().endswith(b"\n")
    frames = candump.read(log)
    assert frames.times[-1] > 0.5
    assert tomllib.loads((run.out / "run.toml").read_text())["run"]["complete"] is False


def test_a_folder_in_use(
    tmp_path: Path,
    long: Path,
    start: Callable[..., Started],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """A second run into the same folder is refused and does no harm; when the first has ended it is taken over."""
    first = start(long, tmp_path / "out", "--link", "pty").running()
    monkeypatch.setattr(sys, "argv", ["terrapin", "run", "steady_sand", "--out", str(first.out)])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 1
    assert capfd.readouterr().err == f"terrapin: {first.out}: another run is writing its log here\n"
    first.process.send_signal(signal.SIGTERM)
    first.ended()
    assert whole(first.out) > 500
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 0
    frames = candump.read(first.out / "telemetry.log")
    assert frames.times[0] == 0.0
    assert np.all(np.diff(frames.times) >= 0)
    assert frames.times[-1] == pytest.approx(9.999)


@pytest.mark.parametrize(
    ("device", "words"),
    [
        ("/dev/nothing", "no such device; `terrapin flash --list` shows what is there"),
        ("/dev/null", "not a terminal"),
        (__file__, "not a terminal"),
        ("/tmp", "Is a directory"),
        ("/dev/no\nthing", "no such device; `terrapin flash --list` shows what is there"),
        ("/dev/null/x", "Not a directory"),
    ],
)
def test_a_wrong_device(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], device: str, words: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["terrapin", "run", "steady_sand", "--link", f"serial:{device}"])
    with pytest.raises(SystemExit) as left:
        main()
    out, error = capfd.readouterr()
    assert (left.value.code, out) == (1, "")
    shown = device.replace("\n", "\\n")
    assert error == f"terrapin: {shown}: cannot open the link: {words}\n"


@pytest.mark.parametrize("link", ["can:slcan:/dev/nothing", "can:serial:/dev/nothing"])
def test_a_device_that_is_not_there_is_said_alike_by_each_driver(link: str) -> None:
    """pyserial and python-can put their words and numbers around those of the system."""
    expected = f"{link}: cannot open the link: no such device; `terrapin flash --list` shows what is there"
    with pytest.raises(LinkError) as caught:
        opened(LinkName.parse(link))
    assert str(caught.value) == expected
    with pytest.raises(UserError, match=r"^serial:/dev/nothing: cannot open the link: no such device; "):
        SlcanBus(LinkName.parse("serial:/dev/nothing"))
    with pytest.raises(UserError, match=r"^/dev/nothing: cannot open the serial port: no such device; "):
        open_serial("/dev/nothing", 9600)


def test_a_device_with_nobody_behind_it(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    near, device = os.openpty()
    path = os.ttyname(device)
    try:
        monkeypatch.setattr(sys, "argv", ["terrapin", "run", "steady_sand", "--link", f"serial:{path}"])
        with pytest.raises(SystemExit) as left:
            main()
    finally:
        os.close(near)
        os.close(device)
    assert left.value.code == 1
    assert capfd.readouterr().err == f"terrapin: {path}: no answer within 2 s\n"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open and write everything")
def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    device, folder = tmp_path / "device", tmp_path / "folder"
    device.touch(0)
    folder.mkdir(0o500)
    for more in (["--link", f"serial:{device}"], ["--out", str(folder)]):
        monkeypatch.setattr(sys, "argv", ["terrapin", "run", "steady_sand", *more])
        with pytest.raises(SystemExit) as left:
            main()
        assert left.value.code == 1
        error = capfd.readouterr().err
        assert "Permission denied" in error
        assert error.count("\n") == 1
