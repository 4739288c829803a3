"""Driving from the page: armed, heard, silent, stopped; parameters; the simulated robot; moving in a log."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from serving import Server
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from terrapin_hil.messages import interface
from terrapin_hil.nodes import Node
from terrapin_tools.monitor.controls import CYCLE, HALT, HEART, Controls, NotNow, Order
from terrapin_tools.monitor.sources import LogFile
from tests.waiting import BOUND

RUN = {"request": "run", "control": "voltage", "setpoint": 4.0, "limiter": False}
IDLE = {**RUN, "request": "idle"}
COMMAND = interface().messages["COMMAND"]
REQUESTS = {number: name for name, number in interface().enums["request"].items()}


class Page:
    """A page that drives: its websocket, what it was told last, and its heart, which beats while `beat` is set."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.status: dict[str, Any] = {}
        self.events: list[str] = []
        self.beat: dict[str, Any] | None = None
        self.gone = threading.Event()
        self.heart = threading.Thread(target=self._beats, daemon=True)
        self.heart.start()
        self.hello = self._next("hello")
        self.name = self.hello["page"]

    def _beats(self) -> None:
        while not self.gone.wait(0.1):
            if self.beat is not None:
                with suppress(ConnectionClosed):
                    self.socket.send(json.dumps({"beat": self.beat}))

    def _next(self, kind: str) -> dict[str, Any]:
        end = time.monotonic() + BOUND
        while time.monotonic() < end:
            message = self.socket.recv(timeout=BOUND)
            if isinstance(message, str) and (said := json.loads(message))["type"] == kind:
                return dict(said)
        raise AssertionError(kind)

    def value(self, name: str) -> Any:
        names = [signal["name"] for signal in self.hello["signals"]]
        return self.status["values"][names.index(name)]

    def until(self, done: Callable[[], bool]) -> None:
        """Looks until something holds."""
        end = time.monotonic() + BOUND
        while time.monotonic() < end:
            self.status = self._next("status")
            self.events += [event["text"] for event in self.status["events"]]
            if done():
                return
        raise AssertionError((self.status.get("drive"), self.status.get("faults"), self.events[-5:]))


@contextmanager
def page(server: Server) -> Iterator[Page]:
    with connect(f"ws://127.0.0.1:{server.port}/api/live/socket?token={server.token}", max_size=None) as socket:
        opened = Page(socket)
        try:
            yield opened
        finally:
            opened.gone.set()
            opened.heart.join()


def command(server: Server, status: int = 200, **body: Any) -> str:
    answer = server.ask("POST", "/api/live/command", body)
    assert answer.status == status, answer.body
    return answer.detail if status != 200 else str(answer.json["done"])


@pytest.fixture(scope="module", autouse=True)
def left(server: Server) -> Iterator[None]:
    """Nothing is watched in the end."""
    yield
    assert server.ask("DELETE", "/api/live").status == 200


@pytest.fixture
def robot(server: Server) -> Iterator[Server]:
    """A robot that lives and is watched; the same for all, as it takes seconds to start."""
    if server.get("/api/live")["name"] != "simulated robot":
        assert server.ask("POST", "/api/live", {"source": "robot:floor"}).status == 200
    yield server
    for request in ("release", "clear"):
        assert server.ask("POST", "/api/live/command", {"request": request}).status == 200


def faults(page: Page) -> list[str]:
    return [fault["name"] for fault in page.status["faults"]]


def drive(server: Server, who: Page) -> None:
    """Armed, and the wheel turns. On a machine that let its heart wait for too long it is armed again."""
    sent = -1

    def moves() -> bool:
        nonlocal sent
        if who.status["drive"]["driver"] != who.name:
            command(server, request="clear")
            who.beat, sent = IDLE, who.status["drive"]["sent"]
            command(server, request="arm", page=who.name)
        elif who.value("ACTUATE.state") is not None and faults(who) == [] and who.status["drive"]["sent"] > sent:
            who.beat = RUN
        return who.value("ACTUATE.enable") == 1.0 and (who.value("MOTION.shell_speed") or 0.0) > 0.5

    who.until(moves)


def test_a_page_drives_and_halts(robot: Server) -> None:
    """Armed by name, driven by beats, halted by disarming: the bridge is off, and no fault was needed for it."""
    with page(robot) as one, page(robot) as other:
        assert one.hello["kind"] == "robot"
        assert one.hello["drive"]["voltage"] == {"unit": "V", "limit": 12.0}
        assert one.hello["drive"]["speed"] == {"unit": "m/s", "limit": pytest.approx(2.16)}
        drive(robot, one)
        assert one.status["drive"]["driver"] == one.name
        assert abs(one.value("TRUTH.torque")) > 0.0
        assert "another page drives" in command(robot, 409, request="arm", page=other.name)
        assert "does not drive" in command(robot, 409, request="disarm", page=other.name)
        for method, body in (("POST", {"source": "simulator:estop"}), ("DELETE", None)):
            assert "a page drives" in robot.ask(method, "/api/live", body).detail
        command(robot, request="disarm", page=one.name)
        one.until(lambda: one.status["drive"]["driver"] == "")  # what it still asks for counts no more
        one.until(lambda: one.value("ACTUATE.enable") == 0.0)
        assert faults(one) == []
        assert "disarmed" in one.events


@pytest.mark.parametrize("how", ["closed", "silent"])
def test_without_the_page_the_controller_stops_itself(robot: Server, how: str) -> None:
    """The page is closed, or asleep: no more commands, and the controller's own time-out puts the bridge off."""
    with page(robot) as looks:
        with page(robot) as one:
            drive(robot, one)
            if how == "silent":
                one.beat = None
                looks.until(lambda: looks.status["drive"]["driver"] == "")
        looks.until(lambda: looks.value("ACTUATE.enable") == 0.0 and "command_timeout" in faults(looks))
        sent = looks.status["drive"]["sent"]
        assert any("no more commands" in text for text in looks.events)
        assert command(robot, request="clear") == "told clear"
        looks.until(lambda: faults(looks) == [])
        assert looks.status["drive"]["sent"] == sent  # nothing was sent for it after it had gone


def test_every_page_stops(robot: Server) -> None:
    """A stop by another page ends the driving; nobody is armed while it is held in; released, it starts nothing."""
    with page(robot) as one, page(robot) as other:
        drive(robot, one)
        command(robot, request="idle")
        other.until(lambda: other.value("ACTUATE.enable") == 0.0 and "stop_all" in faults(other))
        assert other.status["drive"]["driver"] == ""
        assert "held in" in command(robot, 409, request="arm", page=one.name)
        assert "held in" in command(robot, 409, request="clear")
        command(robot, request="release")
        other.until(lambda: "stop_all" not in faults(other))  # the first page goes on beating, unarmed
        assert other.value("ACTUATE.enable") == 0.0


def test_parameters_ground_and_truth(robot: Server) -> None:
    found = robot.get("/api/live/parameters")["parameters"]
    assert [p["name"] for p in found] == list(interface().parameters)
    window = next(p for p in found if p["name"] == "window")
    assert window["value"] == window["default"]
    answer = robot.ask("POST", "/api/live/parameters", {"name": "window", "value": window["value"] + 100.0})
    assert "until the next reset" in answer.json["done"]
    again = {p["name"]: p["value"] for p in robot.get("/api/live/parameters")["parameters"]}
    assert again["window"] == window["value"] + 100.0
    refused = robot.ask("POST", "/api/live/parameters", {"name": "window", "value": 1e9})
    assert refused.status == 422
    assert "outside" in refused.detail
    assert robot.ask("POST", "/api/live/parameters", {"name": "no_such", "value": 1.0}).status == 422
    assert robot.ask("POST", "/api/live/robot", {"change": "ground = sand"}).json["done"] == "ground is sand"
    assert "expected one of" in robot.ask("POST", "/api/live/robot", {"change": "ground = moon"}).detail
    for wrong in ("request = run", "ground = sand\n", "fault = x", "ground=sand"):
        assert robot.ask("POST", "/api/live/robot", {"change": wrong}).status == 422, wrong


def test_what_cannot_be_driven_says_so(server: Server) -> None:
    assert server.ask("POST", "/api/live", {"source": "simulator:steady_sand"}).status == 200
    with page(server) as one:
        assert one.hello["drive"] is None
        assert "cannot be driven" in command(server, 409, request="arm", page=one.name)
        assert "cannot be driven" in command(server, 409, request="clear")
        assert server.ask("GET", "/api/live/parameters").status == 409
        assert server.ask("POST", "/api/live/robot", {"change": "ground = sand"}).status == 409
        assert server.ask("POST", "/api/live/replay", {"speed": 2.0}).status == 409
        one.until(lambda: one.value("TRUTH.torque") is not None)  # the simulator's truth is there all the same
    for body in ({"source": "robot:nowhere"}, {"source": "robot:floor", "node": 1}):
        assert server.ask("POST", "/api/live", body).status == 422
    assert server.ask("DELETE", "/api/live").status == 200
    assert server.ask("POST", "/api/live/command", {"request": "arm", "page": "0" * 16}).status == 404


@pytest.mark.parametrize(
    "beat",
    [
        None, [], {}, {**RUN, "more": 1}, {**RUN, "setpoint": "4"}, {**RUN, "setpoint": True}, {**RUN, "setpoint": 1e9},
        {**RUN, "request": "clear"}, {**RUN, "request": []}, {**RUN, "control": "force"}, {**RUN, "limiter": 1},
    ],
)  # fmt: skip
def test_beats_that_are_none_end_the_socket(server: Server, beat: Any) -> None:
    with connect(f"ws://127.0.0.1:{server.port}/api/live/socket?token={server.token}") as socket:
        socket.send(json.dumps({"beat": beat}))
        with pytest.raises(ConnectionClosed):
            list(socket)  # whatever it was told before


class FakeBus:
    """Takes what is sent."""

    name = "fake"
    tap = None

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []

    def send(self, identifier: int, data: bytes) -> None:
        self.frames.append((identifier, data))


def test_the_heart_by_the_clock() -> None:
    """By a clock of the test's own: COMMAND each CYCLE while the page is heard, the last within HEART of its last beat,
    which is below the half second that is promised; then none, whatever comes after."""
    assert HEART + CYCLE < 0.5
    bus = FakeBus()
    controls = Controls(bus, interface(), Node(0))  # type: ignore[arg-type]
    controls.close()  # its thread: here the test says what time it is
    controls.arm("a")
    controls._heard = now = 100.0
    controls.beat("a", Order("run", "voltage", 4.0, False))
    controls._heard = controls._due = now
    sent = []
    while now < 102.0:
        sent += [now - 100.0 for frame in controls._next(now) if frame[0] == COMMAND.id]
        now += 0.001
    assert len(sent) == pytest.approx(HEART / CYCLE, abs=1.5)
    assert HEART - CYCLE < sent[-1] <= HEART
    controls.beat("a", Order("run"))
    assert controls._next(now) == []
    assert controls.driver == ""
    with pytest.raises(NotNow):
        controls.disarm("a")


def test_a_halt_ends_by_itself() -> None:
    """Disarmed, IDLE goes out until the bridge is off, at most for HALT and only while the page is heard."""
    bus, bridge = FakeBus(), SimpleNamespace(on=True)
    controls = Controls(bus, interface(), Node(0), bridge_on=lambda: bridge.on)  # type: ignore[arg-type]
    controls.close()
    controls.arm("a")
    controls.beat("a", Order("run", "speed", 0.3, True))
    controls.disarm("a")
    now = controls._left
    requests: set[str] = set()
    while controls.driver and now < controls._left + 2 * HALT:
        controls._heard = now
        requests |= {
            REQUESTS[COMMAND.decode(data)["request"]] for name, data in controls._next(now) if name == COMMAND.id
        }
        now += 0.01
    assert requests == {"idle"}
    assert now - controls._left == pytest.approx(HALT, abs=0.05)


def replayed(tmp_path: Path) -> LogFile:
    lines = [f"({i / 100:.6f}) can0 100#{i:04X}000000000000" for i in range(1000)]
    (tmp_path / "ten.log").write_text("\n".join(lines) + "\n")
    return LogFile(tmp_path / "ten.log", 1000.0)


def taken(log: LogFile, count: int) -> list[int]:
    found: list[int] = []
    end = time.monotonic() + BOUND
    while len(found) < count and time.monotonic() < end:
        block = log.poll()
        found += [int.from_bytes(block.payload(row)[:2], "big") for row in range(len(block))]
    return found


def test_a_log_seeks_and_loops(tmp_path: Path) -> None:
    """All of it once; from the middle on; and anew at its end. Its length is known when it was read."""
    log = replayed(tmp_path)
    assert taken(log, 1000) == list(range(1000))
    log.poll()
    assert log.over
    log.seek(5.0)
    assert not log.over
    assert taken(log, 500) == list(range(500, 1000))
    log.measure()
    assert log.length == pytest.approx(9.99)
    log.set_loop(True)
    assert taken(log, 1500)[:1500] == [*range(1000), *range(500)]
    assert not log.over
    log.set_speed(1e-3)
    assert log.position <= 9.99
    log.close()


def test_a_replay_over_the_server(server: Server) -> None:
    lines = [f"({i / 100:.6f}) can0 100#{i:04X}000000000000" for i in range(2000)]
    (server.workspace / "logs" / "twenty.log").write_text("\n".join(lines) + "\n")
    assert server.ask("POST", "/api/live", {"source": "log:twenty.log"}).status == 200
    with page(server) as one:
        assert one.hello["kind"] == "log"
        one.until(lambda: one.status["replay"]["length"] is not None)
        assert server.ask("POST", "/api/live/replay", {"position": 15.0, "speed": 1e-3}).status == 200
        one.until(lambda: 15.0 <= one.status["replay"]["position"] < 16.0)
        assert not any("clock" in text for text in one.events)  # moved on purpose
        assert server.ask("POST", "/api/live/replay", {"loop": True, "speed": 1000.0}).status == 200
        one.until(lambda: one.status["replay"]["loop"] and one.status["total"] > 3000)
        assert one.status["state"] == "live"
        for wrong in ({"position": -1.0}, {"speed": 0.0}, {"loop": 1}, {"where": 1.0}):
            assert server.ask("POST", "/api/live/replay", wrong).status == 422
    assert server.ask("DELETE", "/api/live").status == 200
