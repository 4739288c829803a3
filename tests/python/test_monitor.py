"""The monitor: what it makes of frames, and the display through Textual's pilot and in a real terminal."""

from __future__ import annotations

import asyncio
import os
import pty
import select
import signal
import struct
import sys
import termios
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from fcntl import ioctl
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from textual.widgets import DataTable, Input, Static

from terrapin_hil import paths
from terrapin_hil.messages import interface
from terrapin_hil.nodes import Node
from terrapin_interface.description import load
from terrapin_interface.robot import find_robot, load_robot
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import ERROR, Frames, frames
from terrapin_tools.monitor import sources
from terrapin_tools.monitor.app import MonitorApp
from terrapin_tools.monitor.controls import Controls, reach
from terrapin_tools.monitor.driving import Driving
from terrapin_tools.monitor.live import Live
from terrapin_tools.monitor.plot import braille
from terrapin_tools.monitor.sources import LogFile, Simulator
from tests.waiting import BOUND, wait_for

DBC = paths.build() / "generated" / "terrapin.dbc"
TERRAPIN = str(Path(sys.executable).parent / "terrapin")


def live() -> Live:
    return Live(Decoder(DBC), interface())


def block(*rows: tuple[float, str, dict[str, int]]) -> Frames:
    messages = interface().messages
    payloads = [messages[name].encode(values)[0] for _, name, values in rows]
    return frames(Path("made"), [r[0] for r in rows], [messages[r[1]].id for r in rows], payloads, [0] * len(rows))


def test_a_clock_that_steps_back_begins_anew_and_one_that_jumps_goes_on() -> None:
    bus = live()
    bus.take(block((5.0, "MOTION", {"slip": 100}), (5.1, "MOTION", {"slip": 100})))
    bus.take(block((2.0, "MOTION", {"slip": 200}), (2.1, "MOTION", {"slip": 200})))
    assert (bus.epoch, bus.begin) == (1, 2.0)
    bus.take(block((40.0, "MOTION", {"slip": 300})))
    assert (bus.epoch, bus.begin) == (1, 2.0)
    assert [event.text for event in bus.events if event.kind == "clock"] == [
        "the clock steps back by 3.100 s",
        "no frame for 37.900 s, or the clock jumped ahead",
    ]


def test_values_faults_events() -> None:
    bus = live()
    states = interface().enums["state"]
    bus.take(block((0.0, "STATUS", {"state": states["run"], "faults": 0}), (0.1, "MOTION", {"slip": 312})))
    assert bus.values["MOTION.slip"] == pytest.approx(0.312)
    assert bus.word("state", "STATUS.state") == "run"
    assert not bus.faults
    estop = 1 << interface().faults["estop"]
    bus.take(block((0.2, "STATUS", {"state": states["safe"], "faults": estop})))
    assert [f["name"] for f in bus.faults] == ["estop"]
    assert "emergency stop" in bus.faults[0]["cause"]
    assert [(e.time, e.text) for e in bus.events] == [(0.2, "estop"), (0.2, "state safe")]
    bus.take(block((0.3, "STATUS", {"state": states["safe"], "faults": 0})))
    assert bus.events[-1].text == "estop gone"


def at_node(made: Frames, number: int) -> Frames:
    node = Node(number)
    moved = [node.to_bus((int(i), made.payload(row))) for row, i in enumerate(made.identifiers)]
    return frames(Path("made"), made.times, [m[0] for m in moved], [m[1] for m in moved], [0] * len(made))


def test_a_node_among_others() -> None:
    """The values are those of the chosen node alone; the others are named, and are no unknown frames."""
    made = [at_node(block((0.1 * n, "MOTION", {"slip": 100 * n}), (0.1 * n, "ACTUATE", {})), n) for n in range(8)]
    for number in range(8):
        bus = Live(Decoder(DBC), interface(), node=number)
        for each in made:
            bus.take(each)
        assert bus.values["MOTION.slip"] == pytest.approx(0.1 * number)
        assert bus.others == {n: 2 for n in range(8) if n != number}
        assert not bus.unknown
        assert bus.total == 16
        assert bus.health(0.0).startswith("no error frames; also on it: node ")
        assert not bus.fit


def test_states_and_faults_of_all_nodes() -> None:
    """Beside the chosen node's values, the state of every other, by its own STATUS."""
    states, faults = interface().enums["state"], {f["name"]: f["number"] for f in interface().json["faults"]}
    bus = Live(Decoder(DBC), interface(), node=1)
    bus.take(at_node(block((0.0, "STATUS", {"state": states["run"]})), 1))
    bus.take(at_node(block((0.1, "STATUS", {"state": states["run"]})), 0))
    bus.take(at_node(block((0.2, "MOTION", {"slip": 100})), 4))
    held = (1 << faults["estop"]) | (1 << faults["swing"])
    safe = (0.3, "STATUS", {"state": states["safe"], "faults": held})
    bus.take(at_node(block(safe, (0.4, "STATUS", {"state": states["safe"], "faults": held})), 6))
    assert bus.word("state", "STATUS.state") == "run"
    assert bus.health(0.0) == "no error frames; also on it: node 0 run, node 4, node 6 safe: estop, swing"
    bus.take(at_node(block((0.5, "STATUS", {"state": states["idle"], "faults": 0})), 6))
    assert bus.health(0.0).endswith("node 6 idle")
    assert not bus.faults


def test_each_controller_has_a_row() -> None:
    """State, faults and the few signals of every node, whichever of them is watched; None while one has not come."""
    states, estop = interface().enums["state"], {f["name"]: f["number"] for f in interface().json["faults"]}["estop"]
    made = [
        at_node(block((0.0, "STATUS", {"state": states["run"], "faults": 0}), (0.1, "MOTION", {"slip": 100})), 1),
        at_node(block((0.2, "STATUS", {"state": states["safe"], "faults": 1 << estop})), 4),
        at_node(block((0.3, "GROUND", {"torque": 50_000}), (0.4, "MOTION", {"slip": 250})), 4),
    ]
    for number in (1, 4):
        bus = Live(Decoder(DBC), interface(), node=number)
        for each in made:
            bus.take(each)
        first, second = bus.nodes
        assert (first["node"], first["said"], first["watched"]) == (1, "run", number == 1)
        assert (second["node"], second["said"], second["watched"]) == (4, "safe: estop", number == 4)
        assert first["MOTION.slip"] == pytest.approx(0.1)
        assert second["MOTION.slip"] == pytest.approx(0.25)
        assert second["GROUND.torque"] == pytest.approx(0.05)
        assert first["GROUND.torque"] is None
    assert Live(Decoder(DBC), None).nodes == []


def test_two_controllers_that_are_one_node() -> None:
    bus = Live(Decoder(DBC), interface(), node=2)
    for time_, unique in enumerate((0xAAAA0001, 0xAAAA0001, 0xBBBB0002, 0xAAAA0001, 0xBBBB0002)):
        bus.take(at_node(block((float(time_), "PORT_IDENTITY", {"unique": unique})), 2))
    bus.take(at_node(block((9.0, "PORT_IDENTITY", {"unique": 0xCCCC0003})), 3))
    assert [(e.time, e.text) for e in bus.events] == [(2.0, "2 controllers have node number 2: aaaa0001, bbbb0002")]


def test_every_change_in_a_block_is_an_event() -> None:
    bus = live()
    rows = [(0.01 * i, "ACTUATE", {"limiting": i // 2 % 2}) for i in range(9)]
    bus.take(block(*rows))
    assert [round(e.time, 3) for e in bus.events] == [0.02, 0.04, 0.06, 0.08]


def test_rate_load_and_health() -> None:
    bus = live()
    times = np.arange(8000) / 8000
    log = frames(Path("made"), times, [0x180] * 8000, [bytes(8)] * 8000, [0] * 8000)
    for part in np.array_split(np.arange(8000), 30):
        bus.take(log.pick(part))
    assert bus.rate == pytest.approx(8000, rel=0.05)
    assert bus.load == pytest.approx(8000 * 111 / 500_000, rel=0.05)
    assert bus.health(0.1) == "no error frames"
    assert "acknowledge" in bus.health(5.0)
    bus.take(frames(Path("made"), [1.1], [0x020], [bytes(8)], [ERROR]))
    assert "nobody acknowledges" in bus.health(0.0)
    assert bus.total == 8001


def test_what_is_kept_is_bounded() -> None:
    """A node that babbles in identifiers of its own, on a bus whose clock stands still, for as long as it likes."""
    bus = Live(None, None)
    one = frames(Path("x"), [5.0], [0x100], [bytes(8)], [0])
    for _ in range(3000):
        bus.take(one)
    assert bus.total == 3000
    assert len(bus._recent) <= 1000
    bus = live()
    count = 10_000
    bus.take(frames(Path("x"), [5.0] * count, list(range(count)), [bytes(8)] * count, [1] * count))
    assert len(bus.unknown) == 4096
    assert bus.fit.startswith("the DBC knows 0 of 10000 frames")


def test_a_simulator_that_nobody_polls_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal that is stopped (Ctrl-S) polls nothing: what is too much is dropped and counted."""
    monkeypatch.setattr(sources, "WAITING", 2000)
    source = Simulator("steady_sand")
    try:
        wait_for(lambda: source.lost > 0)
        assert 0 < len(source.poll()) <= 2000
    finally:
        source.close()


def test_unknown_frames_are_counted() -> None:
    bus = live()
    bus.take(frames(Path("made"), [0.0, 0.1], [0x7AB, 0x7AB], [b"", b"\1"], [0, 0]))
    assert bus.unknown == {(0x7AB, False): 2}


def test_braille_keeps_spikes() -> None:
    times, values = np.linspace(0, 10, 5000), np.zeros(5000)
    values[2500] = 7.0
    lines, low, high = braille(times, values, 40, 5, 20.0)
    assert (low, high) == (0.0, 7.0)
    assert all(len(line) == 40 for line in lines)
    assert any(c != "\u2800" for c in lines[0])  # one of 5,000 points reaches the top
    lines, low, high = braille([], [], 10, 2, 1.0)
    assert lines == [" " * 10] * 2
    assert np.isnan(low)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "x.log"
    rows = []
    states = interface().enums["state"]
    for i in range(200):
        rows.append((0.01 * i, "STATUS", {"state": states["run"], "ready": 1}))
        rows.append((0.01 * i, "MOTION", {"slip": i, "slip_valid": 1}))
        rows.append((0.01 * i, "GROUND", {"torque": 150_000, "torque_sd": 400, "valid": 1, "terrain": 1}))
    from terrapin_tools.logs.writing import LogWriter

    with LogWriter(path) as file:
        file.write(block(*rows))
    return path


def text(app: MonitorApp, name: str) -> str:
    return str(app.query_one(f"#{name}", Static).render())


@pytest.mark.parametrize("size", [(80, 24), (140, 50)])
def test_display(log: Path, size: tuple[int, int]) -> None:
    """All that matters is on the screen; filter, plot, pause and mark do what they say."""

    async def use() -> None:
        app = MonitorApp(live(), LogFile(log, speed=1000.0), 0.5)
        app.live.plot("GROUND.terrain", True)
        async with app.run_test(size=size) as pilot:

            async def until(holds: Callable[[], bool]) -> None:
                end = time.monotonic() + BOUND
                while not holds():
                    assert time.monotonic() < end
                    await pilot.pause(0.05)

            await until(lambda: app.source.over and app.live.total == 600)
            app.draw()
            assert "run" in text(app, "controller")
            assert "none" in text(app, "controller")
            assert "x.log" in text(app, "head")
            assert "MOTION.slip  0 to 0.199" in text(app, "plot")
            assert "GROUND.terrain  sand to sand" in app._plot(80, 30).plain
            table = app.query_one("#signals", DataTable)
            everything = table.row_count
            assert app._table.get_cell("GROUND.terrain", "value") == "sand"  # by its name
            assert len(app._table.get_cell("MOTION.slip", "trend")) > 0
            await pilot.press("slash", *"torque")
            await until(lambda: app.query_one("#filter", Input).value == "torque")
            await until(lambda: {str(key.value) for key in table.rows} == {"GROUND.torque", "GROUND.torque_sd"})
            await pilot.press("backspace", *"e[")  # no regular expression: the last good one stays
            await until(lambda: app.query_one("#filter", Input).value == "torque[")
            assert 0 < table.row_count < everything
            await pilot.press("enter", "p")
            await pilot.press("m")
            await until(lambda: app.live.events[-1].text == "mark 1")
            await pilot.press("space")
            await until(lambda: app.paused)
            await pilot.press("q" if size[0] == 80 else "ctrl+c")  # either ends it, and so the commands of who drives
            await until(lambda: not app.is_running)
        assert app.failed is None

    with ThreadPoolExecutor(1) as fresh:  # of other tests' event loops
        fresh.submit(asyncio.run, use()).result()


class FakeBus:
    """Takes what is sent."""

    name, tap = "fake", None

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []

    def send(self, identifier: int, data: bytes) -> None:
        self.frames.append((identifier, data))


@pytest.mark.parametrize("name", ["cylinder", "roller", "sphere"])
def test_a_setpoint_reaches_as_far_as_the_robot_takes_it(name: str) -> None:
    """The page ended at 12 V for a robot of 24 V as well."""
    robot = load_robot(find_robot(name))
    parameters = {one.name: one for one in load(robot=robot).parameters}
    found = reach(SimpleNamespace(parameter=parameters.__getitem__))  # type: ignore[arg-type]
    assert found["voltage"] == pytest.approx(1.2 * robot.limits["voltage"]) == pytest.approx(robot.supply)
    assert found["speed"] == pytest.approx(robot.free_speed * robot.plant["drive_radius"], rel=1e-3)


def test_keys_that_drive() -> None:
    """Nothing moves before `a` was pressed twice; then run, setpoint, stop; a stop ends it and is let go by space."""
    controls = Controls(FakeBus(), interface(), Node(0))  # type: ignore[arg-type]
    controls.close()  # its thread: nothing is sent here
    driving = Driving(controls)
    for key in ("r", "+"):
        driving.press(key)
        assert driving.said == "not armed: a arms"
    driving.press("a")
    assert not driving.armed
    assert "once more" in driving.said
    driving.press("a")
    assert driving.armed
    for key in ("+", "+", "-", "r", "l"):
        driving.press(key)
    assert controls.answer() | {"sent": 0} == {
        "driver": "terminal", "leaving": False, "sent": 0, "ended": "",
        "request": "run", "control": "speed", "setpoint": 0.05, "limiter": False,
    }  # fmt: skip
    assert driving.said.startswith("ARMED run 0.05 m/s, limiter off")
    controls._secured = True  # nobody answers here
    driving.press("c")
    assert driving.said.startswith("ARMED idle 0.05 m/s")  # a clear starts nothing: what ran is asked for anew
    assert controls.answer()["request"] == "idle"
    driving.press("r")
    driving.press("v")
    assert driving.order.setpoint == 0.0  # of another kind: no volt becomes a metre a second
    driving.stop()
    assert not driving.armed
    assert driving.said.startswith("STOPPED")
    for key in ("a", "a"):
        driving.press(key)
    assert "held in" in driving.said
    driving.stop()
    assert not controls.stop_held
    assert not driving.armed


def test_simulator_source() -> None:
    """The simulator's frames come as they are made, in order, with nothing lost; closing ends the run."""
    source = Simulator("steady_sand")
    try:
        times: list[float] = []
        end = time.monotonic() + BOUND
        while time.monotonic() < end and len(times) < 400:
            times += source.poll().times.tolist()
            time.sleep(0.02)
    finally:
        source.close()
    assert len(times) >= 400
    assert times == sorted(times)
    assert np.unique(times) == pytest.approx(np.arange(len(np.unique(times))) * 1e-3)


def test_in_a_terminal(log: Path) -> None:
    """As a process in a terminal of 80 x 24: it draws, and q ends it with status 0."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ["TERM"] = "xterm-256color"
        os.execv(TERRAPIN, [TERRAPIN, "monitor", str(log), "--speed", "100"])
    ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    shown, end, quitting = b"", time.monotonic() + BOUND, False
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                piece = os.read(terminal, 65536)
            except OSError:  # the process has ended
                break
            if not piece:
                break
            shown += piece
        if b"MOTION.slip" in shown and not quitting:
            os.write(terminal, b"q")
            quitting = True
    else:
        os.kill(pid, signal.SIGKILL)  # told below
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    assert quitting, shown[-500:]
    assert os.waitstatus_to_exitcode(status) == 0
    assert b"Traceback" not in shown
