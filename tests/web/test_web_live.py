"""The live view's server side: a bus over a pty, a log, the simulator; what is recorded, lost, refused and told."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import websockets
from serving import Server

sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))

from slcan_feeder import Feeder

from terrapin_hil.messages import interface
from terrapin_hil.nodes import Node
from terrapin_tools.logs.frames import frames
from terrapin_tools.logs.reading import read_log
from terrapin_tools.logs.writing import LogWriter
from terrapin_tools.web.live.picture import reduced
from terrapin_tools.web.live.socket import WINDOW, Audience, _Client
from tests.waiting import BOUND, wait_for

HEAD = struct.Struct("<BBHIIIdd")
RATE = 8000


class Watcher:
    """A browser as the socket sees it."""

    def __init__(self) -> None:
        self.frames = self.pictures = self.missed = 0
        self.next: float | None = None
        self.numbers: list[int] = []
        self.points: dict[str, list[tuple[float, float]]] = {}
        self.past: dict[str, list[tuple[float, float]]] = {}
        self.events: list[dict[str, Any]] = []
        self.hello: dict[str, Any] = {}
        self.status: dict[str, Any] = {}

    def take(self, message: str | bytes) -> str:
        """One message; what the browser answers, if anything."""
        if isinstance(message, str):
            said = json.loads(message)
            if said["type"] == "hello":  # another source: what was counted of the one before is past
                self.__init__()  # type: ignore[misc]
                self.hello = said
                return json.dumps({"want": [i for i, s in enumerate(said.get("signals", [])) if s["name"] in WANTED]})
            self.status = said
            self.events += said["events"]
            return ""
        _, kind, columns, number, _, count, first, base = HEAD.unpack_from(message)
        at = HEAD.size
        for _ in range(columns):
            signal, points = struct.unpack_from("<HH", message, at)
            pairs = np.frombuffer(message, "<f4", 2 * points, at + 4).reshape(-1, 2)
            name = self.hello["signals"][signal]["name"]
            into = self.points if kind == 1 else self.past
            into.setdefault(name, []).extend((base + float(t), float(v)) for t, v in pairs)
            at += 4 + 8 * points
        assert at == len(message)
        if kind != 1:
            return ""
        if self.next is not None:
            self.missed += int(first - self.next)
        self.next = first + count
        self.frames += count
        self.numbers.append(number)
        return json.dumps({"seen": number})


WANTED = ("MOTION.slip", "GROUND.torque", "ACTUATE.state")


def watch(
    server: Server, until: Callable[[Watcher], bool], begin: Callable[[], object] = lambda: None, seconds: float = BOUND
) -> Watcher:
    """Listen until a condition holds; `begin` is called once the socket is open."""

    async def listen() -> Watcher:
        found, end = Watcher(), time.monotonic() + seconds
        address = f"ws://127.0.0.1:{server.port}/api/live/socket?token={server.token}"
        async with websockets.connect(address) as socket:
            task = asyncio.get_running_loop().run_in_executor(None, begin)
            while not (task.done() and until(found)):
                if time.monotonic() > end:
                    raise AssertionError((found.frames, found.missed, found.events[-3:], str(found.status)[:500]))
                try:
                    reply = found.take(await asyncio.wait_for(socket.recv(), 1.0))
                except TimeoutError:
                    continue
                if reply:
                    await socket.send(reply)
            await task
        return found

    return asyncio.run(listen())


def post(server: Server, path: str, status: int = 200, **body: Any) -> Any:
    answer = server.ask("POST", f"/api/{path}", body)
    assert answer.status == status, answer.body
    return answer.json


@pytest.fixture(scope="module", autouse=True)
def warm(server: Server) -> None:
    server.warm_live()


@pytest.fixture
def live(server: Server, warm: None) -> Iterator[Server]:
    """A server that watches nothing, before and after."""
    yield server
    assert server.ask("DELETE", "/api/live").status == 200


def kept(frames_: Any) -> list[int]:
    """The numbers that the feeder wrote into its frames."""
    return list(np.ascontiguousarray(frames_.data[:, :4]).view("<u4").ravel())


@pytest.mark.parametrize("kind", [".mf4", ".log"])
def test_full_bus(live: Server, kind: str) -> None:
    """8,000 frames/s over a pty: every frame in the log and in the pictures (60 s of it: tests/bench/bench_live.py)."""
    seconds = 3.0
    with Feeder(RATE, seconds) as feeder:

        def begin() -> None:
            post(live, "live", source=f"serial:{feeder.path}", bitrate=1_000_000)
            answer = post(live, "live/record", do="start", name=f"full{kind}")
            assert f"--link serial:{feeder.path}" in answer["command"]

        found = watch(live, lambda w: w.status.get("total", 0) == RATE * seconds == w.frames, begin)
        assert found.missed == 0
        assert found.status["lost"] == found.status["damaged"] == 0
        assert found.status["load"] == pytest.approx(found.status["rate"] * 111 / 1e6, rel=0.02)
        done = post(live, "live/record", do="stop")
    log, cut = read_log(live.workspace / "logs" / f"full{kind}")
    assert cut == ""
    numbers = kept(log)
    assert len(numbers) == done["frames"]
    assert numbers == list(range(numbers[0], int(RATE * seconds)))  # none lost from the moment it was asked for


def test_pulled_cable(live: Server) -> None:
    """The source vanishes: the page is told in a line, and the log is whole."""
    with Feeder(2000, 1.0) as feeder:
        watch(
            live,
            lambda w: w.status.get("total", 0) == 2000,
            lambda: (
                post(live, "live", source=f"serial:{feeder.path}"),
                post(live, "live/record", do="start", name="pulled.mf4"),
            ),
        )
    found = watch(live, lambda w: w.status.get("state") == "gone")
    assert "the bus went away" in found.status["note"]
    assert found.status["recording"] is None
    log, _ = read_log(live.workspace / "logs" / "pulled.mf4")
    assert len(log) == found.status["last_log"]["frames"] > 0
    assert kept(log)[-1] == 1999


def test_slow_browser_loses_pictures_and_never_the_log(live: Server) -> None:
    """A browser that does not answer gets no more pictures than fit; what it missed shows in the numbers of frames."""

    async def listen(feeder: Feeder) -> int:
        address = f"ws://127.0.0.1:{live.port}/api/live/socket?token={live.token}"
        async with websockets.connect(address) as socket:
            await asyncio.to_thread(post, live, "live", source=f"serial:{feeder.path}")
            await asyncio.to_thread(post, live, "live/record", do="start", name="slow.log")
            pictures, seen, total = 0, 0, 0
            while total < seen + 1000:  # two seconds of which it sees nothing, however slowly pictures are drawn
                message = await asyncio.wait_for(socket.recv(), BOUND)
                if isinstance(message, bytes):
                    pictures += 1
                    assert pictures <= WINDOW
                    seen += HEAD.unpack_from(message)[5]  # and nothing is answered
                else:
                    total = json.loads(message).get("total", 0)
            assert pictures == WINDOW
            return total

    with Feeder(500, BOUND) as feeder:
        total = asyncio.run(listen(feeder))
        post(live, "live/record", do="stop")
    numbers = kept(read_log(live.workspace / "logs" / "slow.log")[0])
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert numbers[-1] >= total - 1


def test_simulator_over_a_pty(live: Server) -> None:
    """The controller's process on a pty: state, the stop button, a mark; all of it in the log."""
    answer = post(live, "live", source="simulator:estop", controller="pty")
    assert answer["command"] == "terrapin monitor estop --controller pty"
    post(live, "live/record", do="start", name="sim.mcap")
    post(live, "live/command", request="mark", text="look here")

    def steps(w: Watcher) -> Any:
        """Between the points of a signal, in ticks of telemetry of 10 ms."""
        return np.diff([t for t, _ in w.past.get("MOTION.slip", []) + w.points.get("MOTION.slip", [])]) / 0.01

    # A picture of the usual 33 ms keeps all of them. A busy machine draws fewer, longer pictures, each with the least
    # and the greatest value of its halves; what counts is that no frame is missed.
    found = watch(live, lambda w: len(w.points.get("MOTION.slip", [])) > 50 and 1 in np.round(steps(w)))
    assert found.hello["stop"] == "simulator"
    assert found.missed == 0
    assert found.numbers == list(range(found.numbers[0], found.numbers[0] + len(found.numbers)))
    assert min(steps(found)) >= 0.0  # in order; the least and the greatest of a half may be one and the same
    assert steps(found) == pytest.approx(np.round(steps(found)), abs=0.01)
    post(live, "live/command", request="idle")
    stopped = watch(live, lambda w: any(f["name"] == "estop" for f in w.status.get("faults", [])))
    assert stopped.status["stop_held"]
    post(live, "live/command", request="release")
    # Events come in order, each with the next status; that of a browser that begins to look may be from just before.
    last = watch(live, lambda w: any(e["text"] == "stop button released" for e in w.events))
    assert not last.status["stop_held"]
    texts = [(e["kind"], e["text"]) for e in last.events]
    assert ("mark", "look here") in texts
    assert ("injected", "stop button held in") in texts
    assert ("state", "state safe") in texts
    post(live, "live/record", do="stop")
    log = (live.workspace / "logs" / "sim.mcap").read_bytes()
    assert b"stop button held in" in log
    assert b"/GROUND" in log


def test_a_stop_that_is_held_stays(live: Server) -> None:
    """Another browser's Watch or Leave does not let go of a stop button that somebody holds in."""
    post(live, "live", source="simulator:estop")
    watch(live, lambda w: (w.status.get("time") or 0) > 0.5)
    post(live, "live/command", request="idle")
    try:
        for method, body in (("POST", {"source": "simulator:steady_sand"}), ("DELETE", None)):
            answer = live.ask(method, "/api/live", body)
            assert answer.status == 409, answer.body
            assert "stop button of simulator: estop is held in" in answer.detail
        assert live.get("/api/live")["name"] == "simulator: estop"
        watch(live, lambda w: w.status.get("stop_held", False))
    finally:
        post(live, "live/command", request="release")
    assert live.ask("DELETE", "/api/live").status == 200


def test_a_source_that_ends_lets_go_of_the_stop(live: Server) -> None:
    """A bus that is gone cannot be stopped: the page says so, and something else can be watched."""
    with Feeder(100, 1.0) as feeder:
        post(live, "live", source=f"serial:{feeder.path}")
        post(live, "live/command", request="idle")
        assert live.ask("DELETE", "/api/live").status == 409
    found = watch(live, lambda w: w.status.get("state") == "gone")
    assert not found.status["stop_held"]
    assert "the stop button holds nothing: the source has ended" in [e["text"] for e in found.events]
    assert live.ask("POST", "/api/live/command", {"request": "idle"}).status == 409
    assert live.ask("DELETE", "/api/live").status == 200


@pytest.mark.skipif(shutil.which("curl") is None, reason="no curl here")
def test_every_action_has_its_command_line(live: Server) -> None:
    """The lines that the page shows do the same when they are typed in."""

    def type_in(line: str) -> Any:
        environment = {**os.environ, "TERRAPIN_TOKEN": live.token}
        done = subprocess.run(["sh", "-c", line], env=environment, capture_output=True, timeout=300, check=True)
        return json.loads(done.stdout)

    post(live, "live", source="simulator:estop")
    watch(live, lambda w: bool(w.frames))
    mark = post(live, "live/command", request="mark", text='it\'s "here"')["command"]
    assert live.token not in mark
    assert type_in(mark)["done"] == 'marked: it\'s "here"'
    start = post(live, "live/record", do="start", name="typed.log")["command"]
    assert live.ask("POST", "/api/live/record", {"do": "stop"}).status == 200
    (live.workspace / "logs" / "typed.log").unlink()
    assert type_in(start)["name"] == "typed.log"
    end = post(live, "live/record", do="stop")["command"]
    assert type_in(end)["name"] == "typed.log"  # again: what was recorded last
    stop = post(live, "live/command", request="idle")["command"]
    release = post(live, "live/command", request="release")["command"]
    for line, held in ((stop, True), (release, False)):
        type_in(line)
        watch(live, lambda w, held=held: w.status.get("stop_held") is held)  # an older status may come first
    # the events may come after the first status
    seen = watch(live, lambda w: sum(e["kind"] == "mark" for e in w.events) == 2)
    marks = [e["text"] for e in seen.events if e["kind"] == "mark"]
    assert marks == ['it\'s "here"'] * 2
    leave = live.ask("DELETE", "/api/live").json["command"]
    post(live, "live", source="simulator:estop")
    type_in(leave)
    assert live.get("/api/live")["name"] is None


def test_a_browser_that_asks_and_does_not_read_costs_one_answer() -> None:
    """Signals ticked again and again: the past of what is wanted waits once, however often it was asked for."""
    asked: list[tuple[Any, Callable[[bytes], object]]] = []
    session: Any = SimpleNamespace(
        names=["a", "b", "c"],
        hello=lambda: {"type": "hello"},
        so_far=lambda: {"events": []},
        past=lambda wanted, give: asked.append((wanted, give)),
    )

    async def browse() -> None:
        audience, client = Audience(), _Client()
        audience.change(session)
        audience._begin(client)
        for number in range(300):
            audience._do(client, {"want": [number % 3]})
        assert [wanted for wanted, _ in asked] == [{0}]
        asked[0][1](b"past of a")
        await asyncio.sleep(0)  # it comes by way of the loop
        assert list(client.packets) == [b"past of a"]
        for number in range(300):
            audience._do(client, {"want": [number % 3]})
        assert len(asked) == len(client.packets) == 1

    asyncio.run(browse())


def test_a_browser_that_comes_in_between_is_told_each_event_once() -> None:
    """A status that was on its way holds events that the browser was given already."""
    session: Any = SimpleNamespace(
        names=[], hello=lambda: {"type": "hello"}, so_far=lambda: {"events": [{"number": 1}, {"number": 2}]}
    )
    audience, client = Audience(), _Client()
    audience.change(session)
    audience._clients.add(client)
    audience._begin(client)
    audience.show(session, None, {"events": [{"number": 2}, {"number": 3}]})
    assert [event["number"] for event in client.events] == [1, 2, 3]


def test_injected_faults_are_events(live: Server) -> None:
    found = watch(
        live,
        lambda w: any("over" in e["text"] for e in w.events),
        lambda: post(live, "live", source="simulator:estop"),
    )
    kinds = [(e["kind"], e["text"], e["time"]) for e in found.events]
    assert ("injected", "estop_pressed injected", 4.0) in kinds
    assert ("injected", "estop_pressed over", 5.0) in kinds
    assert [e["number"] for e in found.events] == list(range(1, len(found.events) + 1))


def a_log(path: Path, times: Any, identifier: int = 0x183) -> Path:
    times = np.asarray(times)
    with LogWriter(path) as log:
        log.write(frames(path, times, [identifier] * len(times), [bytes(8)] * len(times), [0] * len(times)))
    return path


def test_clock_jumps(live: Server) -> None:
    """A log whose clock steps back and jumps ahead: both are told, every frame is shown, plots begin anew."""
    parts = [100 + np.arange(50) * 0.01, 20 + np.arange(50) * 0.01, 5000 + np.arange(50) * 0.01]
    a_log(live.workspace / "logs" / "jumps.log", np.concatenate(parts))
    found = watch(
        live, lambda w: w.status.get("state") == "over", lambda: post(live, "live", source="log:jumps.log", speed=5.0)
    )
    texts = [e["text"] for e in found.events if e["kind"] == "clock"]
    assert texts == ["the clock steps back by 80.490 s", "no frame for 4979.510 s, or the clock jumped ahead"]
    assert found.status["total"] == found.frames == 150
    assert found.status["epoch"] == 1
    assert found.status["begin"] == 20.0


def test_cut_log_says_so(live: Server) -> None:
    path = a_log(live.workspace / "logs" / "cut.log", np.arange(100) * 0.001)
    path.write_bytes(path.read_bytes()[:-5])
    found = watch(live, lambda w: w.status.get("state") == "over", lambda: post(live, "live", source="log:cut.log"))
    assert found.status["note"].startswith("read up to where it was cut off")
    assert found.status["total"] == 99


def test_dbc_that_does_not_fit(live: Server) -> None:
    """A DBC that knows none of the frames, or other lengths, is told; frames are counted all the same."""
    logs = live.workspace / "logs"
    (logs / "other.dbc").write_text('VERSION ""\nBU_: A\nBO_ 5 M: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] "V" A\n')
    a_log(logs / "plain.log", np.arange(200) * 0.001)
    body = {"source": "log:plain.log", "dbc": "other.dbc"}
    found = watch(live, lambda w: w.status.get("total") == 200, lambda: post(live, "live", **body))
    assert found.status["fit"].startswith("the DBC knows 0 of 200 frames (unknown: 183)")
    with LogWriter(logs / "short.log") as log:
        log.write(frames(Path("x"), np.arange(60) * 0.001, [0x183] * 60, [bytes(4)] * 60, [0] * 60))
    found = watch(live, lambda w: w.status.get("total") == 60, lambda: post(live, "live", source="log:short.log"))
    assert found.status["fit"].startswith("60 frames of MOTION have fewer than the 8 bytes")


def test_uploaded_log_and_dbc(live: Server, tmp_path: Path) -> None:
    log = live.upload("drive.log", a_log(tmp_path / "drive.log", np.arange(100) * 0.001).read_bytes()).json["id"]
    assert {"source": f"upload:{log}", "title": "drive.log (uploaded)", "kind": "log"} in live.get("/api/links")
    found = watch(live, lambda w: w.status.get("total") == 100, lambda: post(live, "live", source=f"upload:{log}"))
    assert found.hello["name"] == "drive.log"


def test_a_node_of_several_and_all_of_them(live: Server) -> None:
    """A log of two controllers: the values are those of the node that is chosen, the rows those of both."""
    message, slips = interface().messages["MOTION"], {0: 100, 3: 250}
    rows = [Node(node).to_bus((message.id, message.encode({"slip": slip})[0])) for node, slip in slips.items()]
    lines = [f"({i * 0.001:.6f}) can0 {rows[i % 2][0]:03X}#{rows[i % 2][1].hex()}" for i in range(100)]
    (live.workspace / "logs" / "two.log").write_text("\n".join(lines) + "\n")
    for body, node in (({}, 0), ({"node": 0}, 0), ({"node": 3}, 3)):
        ask = partial(post, live, "live", source="log:two.log", **body)
        found = watch(live, lambda w: w.status.get("total") == 100, ask)
        assert found.hello["watch"].get("node") == body.get("node")
        assert found.hello["command"].endswith(f"--node {node}") == bool(body)
        names = [signal["name"] for signal in found.hello["signals"]]
        assert found.status["values"][names.index("MOTION.slip")] == pytest.approx(slips[node] * 1e-3)
        shown = [(row["node"], row["watched"], row["MOTION.slip"]) for row in found.status["nodes"]]
        assert shown == [(n, n == node, pytest.approx(slip * 1e-3)) for n, slip in slips.items()]


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ({"source": "log:none.log"}, 404, "found no 'none.log'"),
        ({"source": "log:../jobs"}, 404, "found no"),
        ({"source": "upload:000000000000"}, 404, "found none of id"),
        ({"source": "serial:/etc/passwd"}, 422, "expected a serial port"),
        ({"source": "serial:/dev/../etc/passwd"}, 422, "expected a serial port"),
        ({"source": "serial:/dev/shm"}, 422, "is no serial port"),
        ({"source": "serial:/dev/null"}, 500, "cannot open the link"),
        ({"source": "serial:/dev/none"}, 422, "No such file"),
        ({"source": "socketcan:none9"}, 500, "cannot open the link"),
        ({"source": "can:nonsense:x"}, 422, "no interface"),
        ({"source": "can:virtual:x?receive_own_messages=true"}, 422, "found options"),
        ({"source": "can:virtual"}, 422, "can:INTERFACE:CHANNEL"),
        ({"source": "simulator:../x"}, 422, "expected a scenario's name"),
        ({"source": "simulator:none"}, 422, "no scenario of that name"),
        ({"source": "file:///etc/passwd"}, 422, "source"),
        ({"source": "simulator:estop", "speed": 0.0}, 422, "speed"),
        ({"source": "simulator:estop", "dbc": "none.dbc"}, 404, "found no"),
        ({"source": "simulator:estop", "more": 1}, 422, "more"),
        ({"source": "simulator:estop", "node": 1}, 422, "a scenario has one controller"),
        ({"source": "can:virtual:x", "node": 8}, 422, "less than 8"),
    ],
)
def test_refused(live: Server, body: dict[str, Any], status: int, said: str) -> None:
    answer = live.ask("POST", "/api/live", body)
    assert answer.status == status, answer.body
    assert said in answer.detail


def test_no_log(live: Server) -> None:
    """A file that is no log, put into the folder by hand."""
    (live.workspace / "logs" / "junk.mf4").write_bytes(bytes(range(256)) * 40)
    answer = live.ask("POST", "/api/live", {"source": "log:junk.mf4"})
    assert (answer.status, "expected an MF4 bus log" in answer.detail) == (422, True)
    (live.workspace / "logs" / "half.log").write_text("(0.0) can0 123#00\nnonsense\n")
    found = live.ask("POST", "/api/live", {"source": "log:half.log"})
    assert (found.status, "half.log:2" in found.detail) == (422, True)


def test_nothing_to_record_or_stop(live: Server) -> None:
    live.ask("DELETE", "/api/live")
    assert live.ask("POST", "/api/live/record", {"do": "start", "name": "x.log"}).status == 404
    assert live.ask("POST", "/api/live/command", {"request": "idle"}).status == 404
    a_log(live.workspace / "logs" / "still.log", np.arange(5000) * 0.01)
    post(live, "live", source="log:still.log")
    assert "nothing to stop" in live.ask("POST", "/api/live/command", {"request": "idle"}).detail
    assert live.ask("POST", "/api/live/record", {"do": "stop"}).status == 409
    for name in ("x.txt", "x.parquet", "../x.log", "/etc/x.log", ""):
        assert live.ask("POST", "/api/live/record", {"do": "start", "name": name}).status == 422, name
    post(live, "live/record", do="start", name="once.log")
    assert live.ask("POST", "/api/live/record", {"do": "start", "name": "twice.log"}).status == 409
    post(live, "live/record", do="stop")
    assert live.ask("POST", "/api/live/record", {"do": "start", "name": "once.log"}).status == 409


@pytest.mark.parametrize(
    ("images", "status", "said"),
    [
        ([], 422, "images"),
        ([("a.bin", "AAAA")] * 3, 422, "images"),
        ([("../a.bin", "AAAA")], 422, "name"),
        ([("a.elf", "AAAA")], 422, "name"),
        ([("a.bin", "AAAA" * 60_001)], 422, "data"),
        ([("a.bin", "not base64")], 422, "data"),
        ([("a.bin", "AAAAA")], 422, "a.bin: "),
    ],
)
def test_images_that_are_none(live: Server, images: list[tuple[str, str]], status: int, said: str) -> None:
    """Nothing is put into the workspace, nor onto the bus, whatever a page sends in the place of images."""
    post(live, "live", source="can:virtual:flash")
    answer = live.ask("POST", "/api/live/flash", {"images": [{"name": n, "data": d} for n, d in images]})
    assert (answer.status, said in answer.detail) == (status, True), answer.body
    assert not list(live.workspace.glob("images/*"))
    assert live.get("/api/live")["name"] is not None


def test_nothing_to_flash(live: Server) -> None:
    body = {"images": [{"name": "a.bin", "data": "AAAA"}]}
    live.ask("DELETE", "/api/live")
    assert live.ask("POST", "/api/live/flash", body).status == 404
    for source in ("simulator:estop", "log:still.log"):
        a_log(live.workspace / "logs" / "still.log", np.arange(5000) * 0.01)
        post(live, "live", source=source)
        answer = live.ask("POST", "/api/live/flash", body)
        assert (answer.status, "no boot loader" in answer.detail) == (409, True)
    assert not list(live.workspace.glob("images/*"))


@pytest.mark.parametrize(
    "message", ["no json", "[]", '{"want": "x"}', '{"want": [-1]}', '{"seen": 1.5}', '{"x": 1}', "[" * 4000, b"\0\1"]
)
def test_malformed_messages_end_the_socket(live: Server, message: str | bytes) -> None:
    async def send() -> int:
        address = f"ws://127.0.0.1:{live.port}/api/live/socket?token={live.token}"
        async with websockets.connect(address) as socket:
            await socket.recv()
            await socket.send(message)
            await asyncio.wait_for(socket.wait_closed(), BOUND)
            return int(socket.close_code or 0)

    assert asyncio.run(send()) == 1008
    assert live.get("/api/live")["name"] is None


def test_killed_server_leaves_a_log(own_server: Server) -> None:
    """kill -9 of the server: what has come into the log by itself, nobody having asked for it, is still there."""
    with Feeder(2000, 3.0, held=True) as feeder:
        post(own_server, "live", source=f"serial:{feeder.path}")
        post(own_server, "live/record", do="start", name="x.mf4")
        feeder.go()
        found = watch(own_server, lambda w: w.status.get("total", 0) >= 4000)
        heard = found.status["total"]
        log = own_server.workspace / "logs" / "x.mf4"
        wait_for(lambda: heard - 1 in kept(read_log(log)[0]), "the log to hold what was heard")
        own_server.kill()
    numbers = kept(read_log(log)[0])
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert numbers[-1] >= heard - 1


def test_reduced_keeps_the_extremes() -> None:
    random = np.random.default_rng(2)
    for count in (0, 1, 3, 4, 5, 17, 300):
        times, values = np.arange(count) * 1e-3, random.normal(size=count)
        t, v = reduced(times, values)
        assert len(t) <= 4
        assert list(t) == sorted(t)
        if count:
            assert (v.min(), v.max()) == (values.min(), values.max())
    t, v = reduced(np.arange(6.0), np.array([np.nan] * 6))
    assert len(t) == len(v) == 0
