"""What we write, in the tools that others use: cantools on the command line, can-utils, a real terminal."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pyarrow.parquet
import pytest

from terrapin_hil import paths
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.logs.candump import lines
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import Frames
from terrapin_tools.logs.reading import read_log
from terrapin_tools.logs.writing import LogWriter
from tests.own_bus import own_multicast
from tests.waiting import BOUND, wait_for

DBC = paths.build() / "generated" / "terrapin.dbc"
TERRAPIN = str(Path(sys.executable).parent / "terrapin")
CANTOOLS = [sys.executable, "-m", "cantools"]
TICKS = 300


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What simulator and controller say to each other in 0.3 s."""
    from dataclasses import replace

    scenario = replace(load_scenario(find_scenario("steady_sand")), duration=TICKS / 1000, checks=())
    seen: list[str] = []

    class Keep:
        def write(self, records: np.ndarray) -> None:  # type: ignore[type-arg]
            seen.append(lines(records, 0))

    run(scenario, observers=[Keep()])
    path = tmp_path_factory.mktemp("log") / "x.log"
    path.write_text("".join(seen))
    return path


@pytest.fixture(scope="module")
def frames(log: Path) -> Frames:
    return read_log(log)[0]


def decoded(text: str, message: str, signal: str) -> list[float]:
    """Values of a signal in the output of `cantools decode --single-line`."""
    return [float(v) for v in re.findall(rf":: {message}\(.*?\b{signal}: (-?[\d.e-]+)", text)]


def test_cantools_decode(log: Path, frames: Frames) -> None:
    """Every line is decoded, and the numbers are ours."""
    command = [*CANTOOLS, "decode", "--single-line", "--no-decode-choices", str(DBC)]
    text = subprocess.run(command, input=log.read_text(), capture_output=True, text=True, check=True).stdout
    rows = [line for line in text.splitlines() if "::" in line]
    assert len(rows) == len(frames) > 1000
    assert not [row for row in rows if "Unknown frame id" in row or "Failed" in row]
    own = Decoder(DBC).decode(frames)
    for message, name in (("GROUND", "torque"), ("MOTION", "shell_speed"), ("ACTUATE", "duty"), ("STATUS", "tick")):
        np.testing.assert_allclose(decoded(text, message, name), own[message].signals[name], rtol=1e-12)


def test_cantools_monitor(frames: Frames) -> None:
    """In a terminal of 80 x 24 it shows our messages by name. Only those it has room for are sent: which others come
    before it draws first, and push these off the screen, is a matter of how busy the machine is."""
    fitting = [identifier for identifier, _ in Decoder(DBC, ("GROUND", "MOTION")).messages]
    frames = frames.pick(np.isin(frames.identifiers, fitting))
    group, port = own_multicast()
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ.update(TERM="xterm", LINES="24", COLUMNS="80")
        os.execv(
            sys.executable,
            [*CANTOOLS, "monitor", "-i", "udp_multicast", "-c", group, "--bus-kwargs", f"port={port}", "--", str(DBC)],
        )
    shown, end, row = b"", time.monotonic() + BOUND, 0
    try:
        with can.Bus(interface="udp_multicast", channel=group, port=port) as bus:
            while time.monotonic() < end and not (b"GROUND" in shown and b"torque" in shown):
                for _ in range(20):
                    identifier, data = int(frames.identifiers[row]), frames.payload(row)
                    bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
                    row = (row + 1) % len(frames)
                if select.select([terminal], [], [], 0.05)[0]:
                    try:
                        shown += os.read(terminal, 65536)
                    except OSError:  # it has ended
                        break
        assert b"GROUND" in shown, shown[-500:]
        assert b"torque" in shown
    finally:
        os.close(terminal)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


@pytest.fixture
def virtual_bus() -> Iterator[str]:
    """A virtual CAN interface of the kernel."""
    for tool in ("candump", "canplayer", "ip"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} not found: can-utils iproute2")
    name = f"vcan{os.getpid() % 10000}"
    made = subprocess.run(
        ["ip", "link", "add", "dev", name, "type", "vcan"], capture_output=True, text=True, check=False
    )
    if made.returncode != 0:
        pytest.skip(f"no virtual CAN here: {made.stderr.strip() or 'ip link add'}")
    subprocess.run(["ip", "link", "set", name, "up"], check=True)
    yield name
    subprocess.run(["ip", "link", "del", name], check=True)


def test_candump_piped_to_cantools(virtual_bus: str, log: Path, frames: Frames) -> None:
    """candump on a bus | cantools decode."""
    pipe = f"candump -L -n {len(frames)} {virtual_bus} | {' '.join(CANTOOLS)} decode --single-line {DBC}"
    with subprocess.Popen(["sh", "-c", pipe], stdout=subprocess.PIPE, text=True) as process:
        listeners = Path("/proc/net/can/rcvlist_all")
        wait_for(lambda: re.search(rf"^\s*{virtual_bus}\s", listeners.read_text(), re.MULTILINE), "candump to listen")
        subprocess.run(["canplayer", "-I", str(log), f"{virtual_bus}=can0"], check=True)
        text, _ = process.communicate(timeout=300)
    assert text.count("::") == len(frames)
    assert "Unknown frame id" not in text


def test_log2asc_reads_our_text(log: Path, frames: Frames, tmp_path: Path) -> None:
    """can-utils reads our candump text, and we read what it makes of it."""
    if shutil.which("log2asc") is None:
        pytest.skip("log2asc not found: can-utils")
    asc = subprocess.run(["log2asc", "-I", str(log), "can0"], capture_output=True, check=True).stdout
    (tmp_path / "x.asc").write_bytes(asc)
    back, _ = read_log(tmp_path / "x.asc")
    assert back.identifiers.tolist() == frames.identifiers.tolist()
    assert [back.payload(i) for i in range(len(back))] == [frames.payload(i) for i in range(len(frames))]


def test_pyarrow_reads_parquet(frames: Frames, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.parquet") as file:
        file.write(frames)
    table = pyarrow.parquet.read_table(tmp_path / "x.parquet")
    assert table["id"].to_pylist() == frames.identifiers.tolist()
    assert table["data"].to_pylist() == [frames.payload(i) for i in range(len(frames))]
    np.testing.assert_array_equal(table["time"].to_numpy(), frames.times)


@pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux not found")
def test_monitor_in_tmux(log: Path, tmp_path: Path) -> None:
    """A real terminal of 80 x 24: everything that matters is on its screen, and q ends it."""
    socket = str(tmp_path / "tmux")

    def tmux(*arguments: str) -> str:
        command = ["tmux", "-S", socket, "-f", "/dev/null", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    def showing(*words: str) -> str:
        screen = tmux("capture-pane", "-p")
        return screen if all(word in screen for word in words) else ""

    # a shell around it, so that the last line can still be read
    tmux(
        "new-session", "-d", "-x", "80", "-y", "24", "sh", "-c", f"{TERRAPIN} monitor {log}; echo status $?; sleep 600"
    )
    try:
        screen = wait_for(lambda: showing("MOTION.slip", " over", "Quit"), "the monitor")
        rows = screen.splitlines()
        assert len(rows) <= 24
        assert max(map(len, rows)) <= 80
        for word in ("x.log", "state", "faults", "none", "slip", "C_t", "terrain", "current", "MOTION.slip", "Quit"):
            assert word in screen, (word, screen)
        tmux("send-keys", "q")
        screen = wait_for(lambda: showing("status"), "its end")
        assert "status 0" in screen
        assert re.search(r"\d+ frames seen, 0 lost", screen)
    finally:
        tmux("kill-server")
