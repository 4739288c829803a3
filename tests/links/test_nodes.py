"""Several controllers on one bus: identifiers, two that answer to one number, robots that share a bus in lockstep and
in time."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.links import LinkName, LinkNameError, open_link
from terrapin_hil.links.bus_model import BusModel, frame_bits
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError
from terrapin_hil.messages import Frame, Sender, interface, protect
from terrapin_hil.nodes import Node, node_count
from terrapin_hil.run.boot_loader import BootLoader
from terrapin_hil.run.changes_live import change
from terrapin_hil.run.living import Living
from terrapin_hil.run.ports import PtyPort
from terrapin_hil.run.run import run
from terrapin_hil.run.together import run_together
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_hil.simulation import Simulation
from terrapin_tools.cli import main
from terrapin_tools.errors import UserError
from terrapin_tools.logs.candump import line
from terrapin_tools.monitor.controls import CLEARS, Controls
from terrapin_tools.monitor.sources import Bus
from terrapin_tools.param.nodes import clear, controllers, require_one, store_node
from terrapin_tools.param.session import Session
from tests.living import at_work

MESSAGES = interface().messages
NODES = range(node_count())


def scenario(name: str, seconds: float) -> Scenario:
    return replace(load_scenario(find_scenario(name)), duration=seconds, checks=(), provokes=None)


def planned(node: int, base: int) -> int:
    """Where a message of node 0 stands at another, by the plan's words."""
    if 0x080 <= base < 0x090 and node:
        return 0x010 * node + (base & 0xF)
    if 0x0A0 <= base < 0x0A8 and node:
        return 0x140 + 8 * (node - 1) + (base & 7)
    if 0x100 <= base < 0x108:
        return base + 8 * node
    return base + 0x40 * node if base >= 0x180 else base


def test_there_are_at_least_eight_and_none_shares_an_identifier() -> None:
    assert len(NODES) >= 8
    taken = [planned(n, m.id) for n in NODES for m in MESSAGES.values() if m.id >= 0x010]
    assert len(set(taken)) == len(taken)
    assert max(taken) < 0x800
    for node in map(Node, NODES):
        for m in MESSAGES.values():
            assert node.to_bus((m.id, bytes(m.length)))[0] == planned(node.number, m.id), m.name


def test_room_is_kept_for_sealed_commands() -> None:
    """0x086 to 0x088 and 0x196 of node 0 pass the filters of every node, and have places of their own."""
    blocks = {b["name"]: b for b in interface().json["blocks"]}
    requests, answers = blocks["requests"], blocks["answers"]
    assert all(requests["first"] <= i < requests["first"] + requests["size"] for i in (0x086, 0x087, 0x088))
    assert answers["first"] <= 0x196 < answers["first"] + answers["size"]


def test_every_command_comes_before_all_telemetry() -> None:
    commands = [Node(n).to_bus((MESSAGES["COMMAND"].id, bytes(8)))[0] for n in NODES]
    telemetry = [i for n in NODES for i in Node(n).answers]
    assert MESSAGES["STOP_ALL"].id < min(commands)
    assert max(commands) < min(telemetry)


def test_frames_come_back_and_damage_stays() -> None:
    """The CRC on the bus is over the identifier on the bus: as the firmware has it (test_link_node_blackbox.c)."""
    draw = random.Random(1)
    for number in NODES:
        node, other = Node(number), Node((number + 1) % len(NODES))
        for message in MESSAGES.values():
            data = draw.randbytes(message.length)
            if message.e2e:
                data = protect(message.id, data, 5)
            on_bus = node.to_bus((message.id, data))
            assert node.from_bus(on_bus) == (message.id, data)
            if message.id >= 0x010:
                assert other.from_bus(on_bus) is None
            if message.e2e:
                assert on_bus[1] == protect(on_bus[0], data, 5)
                damaged = on_bus[0], bytes([on_bus[1][0] ^ 1]) + on_bus[1][1:]
                back = node.from_bus(damaged)
                assert back is not None
                assert back[1] != protect(message.id, back[1], 5)


@pytest.mark.parametrize(
    "text", ["pty?node=8", "pty?node=-1", "pty?node=x", "socketcan:can0?node=", "pty?node=1&node=2"]
)
def test_numbers_that_no_node_has(text: str) -> None:
    with pytest.raises(LinkNameError, match=r"node|each once"):
        LinkName.parse(text)


def test_the_number_beside_a_name() -> None:
    name = LinkName.parse("can:pcan:x?bitrate=250000&node=3")
    assert (name.node, name.options) == (3, {"bitrate": "250000"})
    assert LinkName.parse(str(name)) == name
    assert name.at_node(None) is name
    assert name.at_node(3) == name
    with pytest.raises(LinkNameError, match="found node 3 in its name and 4"):
        name.at_node(4)
    assert str(LinkName.parse("pty").at_node(2)) == "pty?node=2"


@pytest.mark.parametrize("number", [1, 7])
def test_a_run_is_the_same_at_any_node(number: int) -> None:
    wanted = scenario("babbling_idiot", 1.0)
    assert run(wanted, f"pty?node={number}").output_hash == run(wanted).output_hash


# ---- several on one bus


class TwoOnABus:
    """Links of two controllers whose answers both come: what a host on their bus hears."""

    name = "both"

    def __init__(self, *links: InProcess) -> None:
        self.links = links

    def talk(self, frames: Sequence[Frame], wait: float) -> list[Frame]:
        return [answer for link in self.links for answer in link.hear(frames)]


def with_unique(node: int, unique: int) -> InProcess:
    link = InProcess(node=node)
    link._identity.unique = unique
    return link


def test_two_with_one_number_are_noticed() -> None:
    both = TwoOnABus(with_unique(0, 0xAAAA0001), with_unique(0, 0xBBBB0002))
    with pytest.raises(LinkError, match=r"found 2 controllers with node number 0 \(aaaa0001, bbbb0002\), expected one"):
        require_one(both, 0)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="choose with --unique: aaaa0001, bbbb0002"):
        store_node(both, 1, None)  # type: ignore[arg-type]
    one = TwoOnABus(with_unique(0, 0xAAAA0001), with_unique(1, 0xBBBB0002))
    require_one(one, 0)  # type: ignore[arg-type]


def test_one_of_two_gets_another_number(tmp_path: Path) -> None:
    stays = with_unique(0, 0xAAAA0001)
    with InProcess(flash=tmp_path / "flash") as goes:
        goes._identity.unique = 0xBBBB0002
        both = TwoOnABus(stays, goes)
        answer = store_node(both, 4, 0xBBBB0002)  # type: ignore[arg-type]
        assert (answer.node, answer.stored, answer.result) == (0, 4, "ok")
        with pytest.raises(UserError, match="no place to keep"):
            store_node(both, 4, 0xAAAA0001)  # type: ignore[arg-type]
    program = paths.build() / "terrapin-controller"
    arguments = [str(program), "--flash", str(tmp_path / "flash"), "--pty"]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        path = process.stdout.readline().strip()
        with open_link(f"serial:{path}?node=4") as link:
            [found] = controllers(link)
            assert (found.node, found.stored) == (4, 4)
            assert Session(link).get(interface().parameter("radius")) == interface().parameter("radius").default
        process.terminate()


def test_stop_all_stops_every_node_within_a_tick() -> None:
    """Both drive; then one frame without a counter, and COMMANDs to run that go on coming: the bridge is off from that
    tick on."""
    robots = {n: (Simulation(scenario("steady_sand", 6.0)), InProcess(node=n)) for n in (0, 5)}
    for _, link in robots.values():
        link.start({})
    duties: dict[int, list[tuple[int, bool]]] = {n: [] for n in robots}
    for tick in range(6000):
        for number, (simulation, link) in robots.items():
            node = Node(number)
            stop = [(MESSAGES["STOP_ALL"].id, b"\0")] if tick == 3000 else []
            said = link.hear([*stop, *map(node.to_bus, simulation.sense())])
            own = [frame for f in said if (frame := node.from_bus(f)) is not None]
            simulation.answer(own)
            values = MESSAGES["ACTUATE"].decode(own[0][1])
            duties[number].append((values["duty"], bool(values["enable"])))
    for tape in duties.values():
        assert all(duty > 0 for duty, _ in tape[2000:3000])
        assert all(duty == 0 for duty, _ in tape[3000:])
        assert not any(on for _, on in tape[3000:])


def test_a_stop_outlives_its_process_and_ends_with_a_clear(tmp_path: Path) -> None:
    """With a file of flash: the next process is stopped too, is not armed, and says so; a clear is for good."""
    stop = (MESSAGES["STOP_ALL"].id, b"\0")

    def armed(cleared: bool, stopped: bool) -> bool:
        with open_link("pty", flash=tmp_path / "flash.bin") as link:
            if stopped:
                link.exchange([stop])
            if cleared:
                clear(link)
            key = int(interface().constants["test_mode_key"])
            link.exchange([Sender().frame("TEST_MODE", {"key": key})])
            answers = link.exchange([Sender().frame("SENSORS_FAST", {"tick": 1})])
            return any(identifier == MESSAGES["ACTUATE"].id for identifier, _ in answers)

    assert armed(cleared=False, stopped=False)
    assert not armed(cleared=False, stopped=True)
    assert not armed(cleared=False, stopped=False)
    assert armed(cleared=True, stopped=False)
    assert armed(cleared=False, stopped=False)


def test_the_pages_stop_is_stop_all_and_its_release_a_clear() -> None:
    """To a controller at node 5 that drives: stopped while the button is held in, and ready once it was let go."""
    simulation, robot, node = Simulation(scenario("steady_sand", 3.0)), InProcess(node=5), Node(5)
    robot.start({})

    def tick() -> None:
        said = robot.hear([*map(node.to_bus, simulation.sense())])
        simulation.answer([frame for f in said if (frame := node.from_bus(f)) is not None])

    for _ in range(1000):
        tick()
    bus = object.__new__(Bus)
    bus.name = "a bus"
    controls = Controls(bus, interface(), node)
    controls.close()  # its thread; what is due is asked for here

    def due(times: int) -> list[Frame]:
        found = list[Frame]()
        for _ in range(times):
            controls._due = 0.0
            found += map(node.to_bus, controls._next(0.0))
        return found

    controls.hold_stop(True)
    sent = due(1)
    assert sent == [(0x000, b"\0")]
    robot.hear(sent)
    tick()  # what comes in that of a stop does not end it
    assert robot._lib.terrapin_latched(robot._state) == 1 << interface().faults["stop_all"]
    controls.hold_stop(False)
    sent = due(2 * CLEARS)
    assert len(sent) == CLEARS
    robot.hear(sent)
    tick()
    assert robot._lib.terrapin_latched(robot._state) == 0


def test_lockstep_a_minute_same_hashes_as_alone() -> None:
    scenarios = {0: scenario("steady_sand", 60.0), 1: scenario("slope_limiter", 60.0)}
    alone = {n: run(s).output_hash for n, s in scenarios.items()}
    together, report = run_together(scenarios)
    assert report is None
    assert {n: result.output_hash for n, result in together.items()} == alone


def test_nobody_takes_another_ones_frame() -> None:
    """What the other node's host and controller say changes nothing in this one but the count of other traffic."""
    frames = [Sender().frame(m.name, {}) for m in MESSAGES.values()]
    for mine in NODES:
        link = InProcess(node=mine)
        for other in set(NODES) - {mine}:
            for frame in map(Node(other).to_bus, frames):
                if frame[0] >= 0x010:
                    assert link.hear([frame]) == []
        assert sum(link.dropped.values()) == link.dropped["unknown"]
        assert not link._link.test_mode
        assert not link._inputs.command_fresh


def test_a_bus_in_time_brings_every_command() -> None:
    """Two nodes with their whole telemetry at 500 kbit/s: bounds of the issue, 5 ms and none lost."""
    scenarios = {0: scenario("steady_sand", 60.0), 1: scenario("slope_limiter", 60.0)}
    results, report = run_together(scenarios, 500_000)
    assert report is not None
    assert len(results) == 2
    assert 0.7 < report.load <= 1.0
    for node in report.nodes.values():
        assert node.commands == node.commands_taken == 1200
        assert 0.0 < node.command_late <= 0.005
        assert node.telemetry > 2 * 55_000
    for number, result in results.items():
        assert not (result.held("ACTUATE", "state") == interface().enums["state"]["safe"]).any(), number


def test_a_full_bus_costs_telemetry_and_no_command() -> None:
    """Three nodes want more than there is: what waits gives way, commands do not."""
    _, report = run_together({n: scenario("steady_sand", 5.0) for n in (0, 3, 7)}, 500_000)
    assert report is not None
    assert report.load > 0.99
    assert all(n.commands == n.commands_taken == 100 and n.command_late <= 0.005 for n in report.nodes.values())
    assert report.nodes[0].telemetry == report.nodes[0].telemetry_arrived
    assert report.nodes[7].telemetry_arrived < 0.9 * report.nodes[7].telemetry


# ---- the model of the bus


def bits_by_hand(identifier: int, data: bytes) -> int:
    """The frame as a text of bits, stuffed one by one; the CRC by long division."""
    text = f"0{identifier:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    rest = int(text + "0" * 15, 2)
    for at in range(len(text) + 14, 14, -1):
        if rest >> at & 1:
            rest ^= 0xC599 << (at - 15)
    text += f"{rest:015b}"
    stuffed = ""
    for bit in text:
        stuffed += bit
        if len(stuffed) >= 5 and stuffed[-5:] == bit * 5:
            # A run that began before the last stuffing bit counts from there: that bit is in `stuffed` itself.
            stuffed += "0" if bit == "1" else "1"
    return len(stuffed) + 13


def test_bits_of_a_frame() -> None:
    draw = random.Random(2)
    for _ in range(3000):
        identifier = draw.randrange(0x800)
        data = bytes(draw.choice((0, 255, draw.randrange(256))) for _ in range(draw.randrange(9)))
        assert frame_bits(identifier, data) == bits_by_hand(identifier, data)
        longest = 47 + 8 * len(data) + (34 + 8 * len(data) - 1) // 4
        assert 47 + 8 * len(data) <= frame_bits(identifier, data) <= longest


def test_arbitration() -> None:
    bus = BusModel(500_000)
    bus.send("a", (0x300, bytes(8)), 0.0)
    bus.send("b", (0x200, bytes(8)), 0.00001)  # comes too late to win
    bus.send("c", (0x100, bytes(8)), 0.00001)
    bus.send("c", (0x0FF, bytes(8)), 0.01)
    arrived = bus.run(0.02)
    assert [name for _, name, _ in arrived] == ["a", "c", "b", "c"]
    first = frame_bits(0x300, bytes(8)) / 500_000
    assert arrived[0][0] == pytest.approx(first)
    assert arrived[1][0] > first
    assert arrived[3][0] == pytest.approx(0.01 + frame_bits(0x0FF, bytes(8)) / 500_000)
    assert bus.busy == pytest.approx(sum(frame_bits(f[0], f[1]) for _, _, f in arrived) / 500_000)


def test_a_newer_frame_takes_the_place_of_one_that_waits() -> None:
    bus = BusModel(500_000)
    bus.send("a", (0x300, b"1"), 0.0, replace=True)
    assert bus.run(0.00001) == []  # it is under way
    bus.send("a", (0x300, b"2"), 0.00002, replace=True)
    bus.send("a", (0x300, b"3"), 0.00003, replace=True)
    assert [frame for _, _, frame in bus.run(1.0)] == [(0x300, b"1"), (0x300, b"3")]
    assert bus.stations["a"].replaced == 1


def test_two_stations_with_one_identifier_are_refused() -> None:
    bus = BusModel(500_000)
    bus.send("node 0", (0x180, b"1"), 0.0)
    bus.send("node 0 too", (0x180, b"2"), 0.0)
    with pytest.raises(LinkError, match="node 0 and node 0 too both send 0x180: two nodes with one number"):
        bus.run(1.0)


# ---- the command line


def terrapin(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["terrapin", *arguments])
    with pytest.raises(SystemExit) as left:
        main()
    return int(left.value.code or 0)


def test_a_log_of_two_is_taken_for_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """What a recording of the bus holds of node 3, as the log of a controller alone: the same frames."""
    alone = tmp_path / "alone.log"
    frames = [(0.001 * i, Sender().frame(m.name, {})) for i, m in enumerate(MESSAGES.values())]
    alone.write_text("".join(f"{line(t, *frame)}\n" for t, frame in frames))
    both = tmp_path / "both.log"
    with both.open("w") as file:
        for t, frame in frames:
            for number in (0, 3):
                if frame[0] >= 0x010 or number == 3:
                    file.write(f"{line(t, *Node(number).to_bus(frame))}\n")
    assert terrapin(monkeypatch, "log", "convert", str(both), str(tmp_path / "three.log"), "--node", "3") == 0
    taken = [words.split()[1:] for words in (tmp_path / "three.log").read_text().splitlines()]
    wanted = [words.split()[1:] for words in alone.read_text().splitlines()]
    assert taken == wanted
    capsys.readouterr()
    assert terrapin(monkeypatch, "log", "info", str(both), "--node", "3", "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["frames"] == len(MESSAGES)
    assert terrapin(monkeypatch, "log", "info", str(both), "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 2 * len(MESSAGES) - 1


def test_the_dbc_of_a_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import cantools

    assert terrapin(monkeypatch, "log", "dbc", str(tmp_path / "three.dbc"), "--node", "3") == 0
    database = cantools.database.load_file(tmp_path / "three.dbc")
    own = cantools.database.load_file(paths.dbc())
    for message in own.messages:  # type: ignore[union-attr]
        moved = database.get_message_by_name(message.name)  # type: ignore[union-attr]
        assert moved.frame_id == planned(3, message.frame_id)
        assert (moved.comment, moved.cycle_time) == (message.comment, message.cycle_time)
        assert [(s.name, s.start, s.choices, s.comment) for s in moved.signals] == [
            (s.name, s.start, s.choices, s.comment) for s in message.signals
        ]


def test_run_with_another(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = ("run", "command_timeout", "--with", "command_timeout", "--node", "2", "--out", str(tmp_path), "--json")
    assert terrapin(monkeypatch, *arguments) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [node["node"] for node in answer["nodes"]] == [2, 3]
    assert answer["bus"] is None
    assert len({node["output_sha256"] for node in answer["nodes"]}) == 1
    assert (tmp_path / "node-2" / "telemetry.log").is_file()
    assert (tmp_path / "node-3" / "run.toml").is_file()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "steady_sand", "--with", "steady_sand", "--link", "pty"), "share a bus in this process"),
        (("run", "steady_sand", "--with", "steady_sand", "--node", "7"), "2 robots from node 7 on"),
        (("run", "babbling_idiot", "--with", "steady_sand"), "babbling_idiot: its faults of the bus"),
        (("run", "steady_sand", "--node", "8"), "expected a node number from 0 to 7"),
        (("log", "info", "x.log", "--node", "8"), "x.log"),
        (("monitor", "steady_sand", "--node", "1"), "--node: a scenario has one controller"),
        (("web", "--node", "1"), "--node: of a bus, expected --link"),
        (("node", "set", "8"), "node set: found '8', expected a node number from 0 to 7"),
        (("node", "set", "1"), "no place to keep a node number"),
        (("node", "set", "1", "--unique", "xyz"), "--unique: found 'xyz'"),
        (("param", "get", "radius", "--link", "pty?node=1", "--node", "2"), "found node 1 in its name and 2"),
    ],
)
def test_bad_input(
    arguments: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert terrapin(monkeypatch, *arguments) in (1, 2)
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_where_none_answers_a_boot_loader_may_wait(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With an empty flash it answers an update alone: `node list` ended with status 0, and `node clear` was content."""
    robot = Living(scenario("steady_sand", 1.0), [port := PtyPort()], loader=BootLoader(), told=lambda _: None)
    assert "boot loader stays" in change(robot, "reset = now")
    waits = "; a boot loader that waits for an image (empty flash) answers `terrapin flash` alone\n"
    with at_work(robot):
        link = ("--link", port.attach)
        for words, status, said in (
            (("node", "list"), 1, f"{port.attach}: no controller answers"),
            (("node", "set", "3"), 1, "no controller answers"),
            (("node", "clear"), 1, "no controller answers"),
            (("param", "get", "radius"), 1, "does not answer to PARAMETER_READ"),
            (("run", "steady_sand"), 1, "does not say what it was built for; expected this project's firmware"),
        ):
            assert terrapin(monkeypatch, *words, *link) == status
            out, err = capsys.readouterr()
            assert f"{said}{waits}" in out + err
            assert (out + err).count("\n") == 1
    assert terrapin(monkeypatch, "node", "list", "--link", "can:virtual:nobody", "--json", "-") == 1
    assert json.loads(capsys.readouterr().out)["controllers"] == []
    assert terrapin(monkeypatch, "node", "list") == 0  # in this process there is always one
