"""The STM32F405's very image in QEMU, over USART1: it boots without crystal, ADC, CAN and watchdog, says so, and
answers every tick with the host build's bits. QEMU does 110 to 400 ticks a second, so three scenarios of 2 s."""

from __future__ import annotations

import contextlib
import os
import re
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
import tomllib
import tty
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from terrapin_hil.links import LinkName, open_link
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.qemu_usart import QemuUsart, image, open_qemu_usart
from terrapin_hil.links.slcan import SlcanPort
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_tools.logs.bus import open_bus
from tests.waiting import BOUND, wait_for

BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())["stm32f405"]
BOARDS = ("emulated", "f405-h-bridge")
PLACES = {"alone": (0x0800_0000, 0), "slot-a": (0x0802_0000, 0x200), "slot-b": (0x0804_0000, 0x200)}
KINDS = ("", "production-")
IMAGES = [(board, kind + place) for board in BOARDS for kind in KINDS for place in PLACES]

pytestmark = [
    pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed"),
    pytest.mark.skipif(not image().is_file(), reason="the ARM images are not built (no ARM cross compiler)"),
]


def shortened(name: str) -> Scenario:
    """The first two seconds of a scenario; its checks are another test's."""
    return replace(load_scenario(find_scenario(name)), duration=2.0, checks=())


@pytest.fixture
def port() -> Iterator[SlcanPort]:
    """The emulated board, freshly booted."""
    machine = QemuUsart()
    try:
        with machine.start() as opened:
            opened.timeout = BOUND  # a thousand lines of a flood are answered no faster than a busy machine emulates
            yield opened
    finally:
        machine.stop()


def listen(port: SlcanPort, seconds: float, frames: list[Frame] | None = None) -> list[Frame]:
    """What the board sends by itself, while `frames` go to it once."""
    heard = port.exchange_frames(frames or [])
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        heard += port.exchange(b"F\r")
        time.sleep(0.005)
    return heard


def hear(port: SlcanPort, name: str) -> list[Frame]:
    """What the board sends up to and with a message, on a machine however busy."""
    heard: list[Frame] = []
    end = time.monotonic() + BOUND
    while not values(heard, name):
        assert time.monotonic() < end, f"no {name}"
        heard += listen(port, 0.05)
    return heard


def values(frames: list[Frame], name: str) -> list[dict[str, int]]:
    message = interface().messages[name]
    return [message.decode(data) for identifier, data in frames if identifier == message.id]


def test_boots_tests_itself_and_says_what_is_missing(port: SlcanPort) -> None:
    heard = [*hear(port, "PORT_IDENTITY"), *hear(port, "PORT_IDENTITY")]  # a second
    status = values(heard, "PORT_STATUS")[-1]
    for fault in ("clock_fallback", "adc_silent", "can_absent", "watchdog_absent"):
        assert status[fault] == 1, fault
    for fault in ("can_bus_off", "can_no_acknowledge", "bridge_break", "brown_out", "receive_overflow"):
        assert status[fault] == 0, fault
    assert status["reset_cause"] == 0  # no register tells
    states = interface().enums["state"]
    last = values(heard, "STATUS")[-1]
    faults = {name for name, number in interface().faults.items() if last["faults"] >> number & 1}
    # Without an ADC there is no current: the self test ends in `safe`, for that reason and no hidden other.
    assert last["state"] == states["safe"]
    assert {"current_sensor", "supply_sensor", "temperature_sensor"} <= faults
    assert not faults & {"estop", "parameter", "command_timeout"}
    assert all(not actuate["enable"] and not actuate["duty"] for actuate in values(heard, "ACTUATE"))
    identity = values(heard, "PORT_IDENTITY")[-1]
    assert identity["board"] == interface().enums["board"]["emulated"]
    assert identity["core_clock"] == 168
    assert identity["unique"] == 0  # a read that QEMU refuses, survived
    assert 100 < 4 * identity["stack_used"] <= BUDGET["stack"]
    assert (identity["kind"], identity["trust"]) == (0, 0)
    times = values(heard, "PORT_TIMES")
    assert times
    assert all(not any(row.values()) for row in times)  # no cycle counter here


def test_ticks_by_itself_at_1_khz() -> None:
    """Its own clock: never faster than 1 kHz; slower only as far as this machine lacks time for the emulator. Counted
    from its start, since an emulator that had to wait makes up for it."""
    start = time.monotonic()
    machine = QemuUsart()
    try:
        with machine.start() as port:
            tick = 0
            while tick < 500:
                assert time.monotonic() < start + BOUND
                tick = max((row["tick"] for row in values(listen(port, 0.5), "ACTUATE")), default=0)
                assert tick / (time.monotonic() - start) < 1100
    finally:
        machine.stop()


@pytest.mark.parametrize("name", ["steady_sand", "slope_limiter", "floor_calibration"])
def test_same_bits(name: str) -> None:
    scenario = shortened(name)
    with open_link("qemu-usart") as link:
        emulated = run(scenario, link)
    assert len(emulated.records) == scenario.ticks
    assert emulated.output_hash == run(scenario).output_hash


def test_parameters_reach_the_chip() -> None:
    """Another parameter, another hash, the same on both: the comparison can fail."""
    scenario = replace(shortened("steady_sand"), duration=0.6)
    changed = {"torque_constant": 0.11}
    plain = run(scenario).output_hash
    assert run(scenario, "qemu-usart", parameters=changed).output_hash == run(scenario, parameters=changed).output_hash
    assert run(scenario, parameters=changed).output_hash != plain


def start_for_slot(folder: Path, board: str, place: str) -> Path:
    """The image of a slot, and in front of it what a boot loader does: its vectors where the processor looks."""
    origin, header = PLACES[place.removeprefix("production-")]
    program = folder / "flash.bin"
    text = (image(board, place).with_suffix(".bin")).read_bytes()
    flash = bytearray(b"\xff" * (origin + header - 0x0800_0000))
    flash[:8] = text[:8]
    program.write_bytes(bytes(flash) + text)
    return program


@pytest.mark.parametrize("place", ["slot-a", "slot-b"])
def test_an_image_of_a_slot_runs_from_there(tmp_path: Path, place: str) -> None:
    machine = QemuUsart(start_for_slot(tmp_path, "emulated", place))
    try:
        with machine.start() as port:
            identity = values(hear(port, "PORT_IDENTITY"), "PORT_IDENTITY")[-1]
    finally:
        machine.stop()
    assert identity["slot"] == interface().enums["update_slot"][place[-1]]


def test_a_production_image_has_no_test_mode_and_run_says_what_to_flash() -> None:
    program = image(place="production-alone")
    machine = QemuUsart(program)
    sender = Sender(interface())
    try:
        with machine.start() as port:
            heard = hear(port, "PORT_IDENTITY")
            assert values(heard, "PORT_IDENTITY")[-1]["kind"] == interface().enums["image_kind"]["production"]
            frames = [*sender.test_mode(), sender.frame("SENSORS_SLOW", {}), sender.frame("SENSORS_FAST", {"tick": 1})]
            before = values(listen(port, 0.2), "STATUS")[-1]["tick"]
            after = values(listen(port, 0.5, frames), "STATUS")  # goes on by its own clock
            assert after[-1]["tick"] > before + 100
    finally:
        machine.stop()
    with open_qemu_usart(program) as link, pytest.raises(LinkError, match="a production image, which has no test mode"):
        run(shortened("steady_sand"), link)


def test_both_kinds_have_the_same_core() -> None:
    """One set of the core's objects goes into both; the link layer's test mode is in the desk image alone."""
    folder = image().parent
    inputs = {}
    for kind in KINDS:
        name = image("f405-h-bridge", f"{kind}alone").name
        done = subprocess.run(
            ["ninja", "-C", str(folder), "-t", "query", name], capture_output=True, text=True, check=True
        )
        inputs[kind] = {line.strip() for line in done.stdout.splitlines() if "core_objects.dir" in line}
        symbols = subprocess.run(
            ["arm-none-eabi-nm", str(folder / name)], capture_output=True, text=True, check=True
        ).stdout
        assert ("terrapin_decode_test_mode" in symbols) == (not kind)
        assert ("terrapin_decode_sensors_fast" in symbols) == (not kind)
    assert len(inputs[""]) > 15
    assert inputs[""] == inputs["production-"]


def test_the_other_board_answers_the_same() -> None:
    """The generic board's image believes to run at 16 MHz here; in lockstep that makes no difference."""
    scenario = replace(shortened("steady_sand"), duration=0.5)
    with open_qemu_usart(image("f405-h-bridge")) as link:
        assert run(scenario, link).output_hash == run(scenario).output_hash


def test_a_flood_on_the_line_is_survived(port: SlcanPort) -> None:
    """Rubbish and foreign frames, as fast as they go in: the ticks go on and a command is still answered."""
    sender = Sender(interface())
    for _ in range(20):
        port.send(b"t3FF80123456789ABCDEF\r" * 50)
    assert values(hear(port, "PORT_STATUS"), "ACTUATE")
    read = sender.frame("PARAMETER_READ", {"index": 0})
    answers = values(port.exchange_frames([read]), "PARAMETER_VALUE")
    assert [answer["value"] for answer in answers] == [interface().parameters["radius"].default]


def wait_until_it_answers(path: str) -> None:
    line = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(line)
    heard = b""

    def answered() -> bool:
        nonlocal heard
        os.write(line, b"V\r")
        heard += os.read(line, 4096) if select.select([line], [], [], 0.1)[0] else b""
        return b"V0101\r" in heard

    wait_for(answered, "the board's version")
    while select.select([line], [], [], 0.3)[0]:  # the answers to what was asked more than once
        os.read(line, 4096)
    os.close(line)


def test_serial_device_works_as_a_board_does(tmp_path: Path) -> None:
    """A terminal of the system in between, as with a USB adapter: lockstep, the monitor's bus, python-can's SLCAN."""
    can = pytest.importorskip("can")
    command = ["qemu-system-arm", "-M", "netduinoplus2", "-nodefaults", "-display", "none", "-monitor", "none"]
    command += ["-chardev", "pty,id=usart1", "-serial", "chardev:usart1", "-kernel", str(image())]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"/dev/\S+", process.stdout.readline())
            assert found is not None
            wait_until_it_answers(found[0])  # what comes before it has booted is lost, as with a board
            scenario = replace(shortened("steady_sand"), duration=0.5)
            with open_link(f"serial:{found[0]}@1000000") as link:
                assert run(scenario, link).output_hash == run(scenario).output_hash
                link.exchange(Sender(interface()).test_mode(False))
            bus = open_bus(LinkName.parse(f"serial:{found[0]}@1000000", "listen"))
            known = interface().by_id
            names: set[str] = set()

            def heard_all() -> bool:
                names.update(known[int(i)].name for i in bus.receive(0.1).identifiers)
                return {"ACTUATE", "STATUS", "PORT_STATUS", "PORT_TIMES"} <= names

            wait_for(heard_all, "what a board says by itself")
            bus.shutdown()
            with can.Bus(interface="slcan", channel=found[0], bitrate=500_000, sleep_after_open=0.0) as bus:
                heard = {message.arbitration_id for _ in range(400) if (message := bus.recv(1.0)) is not None}
            assert {interface().messages[name].id for name in ("ACTUATE", "STATUS", "PORT_STATUS")} <= heard
        finally:
            process.kill()


def sabotaged(folder: Path, symbol: str, code: bytes) -> Path:
    """The image with other instructions at the beginning of a function."""
    names = subprocess.run(["arm-none-eabi-nm", "-S", image()], capture_output=True, text=True, check=True).stdout
    found = re.search(rf"^([0-9a-f]+) ([0-9a-f]+) . {symbol}$", names, re.MULTILINE)
    assert found is not None
    assert int(found[2], 16) >= len(code)
    at = (int(found[1], 16) & ~1) - PLACES["alone"][0]
    program = folder / "sabotaged.bin"
    flash = bytearray(image().with_suffix(".bin").read_bytes())
    flash[at : at + len(code)] = code
    program.write_bytes(bytes(flash))
    return program


@pytest.mark.parametrize(
    ("cause", "code"),
    [
        pytest.param("stack_overflow", "ffb5 fff7fdff", id="recursion"),  # itself: push {r0-r7, lr}; bl itself
        # 64 bytes are left: movs r0, #1; lsls r0, #29; adds r0, #64; mov sp, r0; push {r0-r7, lr}. That needs 36, the
        # frame of the fault 32: all but the guard's.
        pytest.param("stack_overflow", "0120 4007 4030 8546 ffb5", id="room for the frame"),
        pytest.param("processor_fault", "00de", id="fault"),  # udf #0
    ],
)
def test_a_fault_resets_and_is_told_at_the_next_start(tmp_path: Path, cause: str, code: str) -> None:
    """stack_used is first called half a second after the start: that start ends, the next one says why."""
    program = sabotaged(tmp_path, "stack_used", bytes.fromhex(code))
    causes = interface().enums["reset_cause"]
    message = interface().messages["PORT_STATUS"]
    ours, theirs = socket.socketpair()
    command = ["qemu-system-arm", "-M", "netduinoplus2", "-nodefaults", "-display", "none", "-monitor", "none"]
    command += ["-chardev", f"socket,id=usart1,fd={theirs.fileno()}", "-serial", "chardev:usart1"]
    with ours, theirs, subprocess.Popen([*command, "-kernel", str(program)], pass_fds=(theirs.fileno(),)) as process:
        try:
            seen, text, end = [], b"", time.monotonic() + BOUND
            ours.settimeout(0.02)
            while set(seen) <= {causes["unknown"]} and time.monotonic() < end:
                with contextlib.suppress(TimeoutError):  # neither side need be quick
                    ours.send(b"O\r")  # a new start has its line closed
                with contextlib.suppress(TimeoutError):
                    text += ours.recv(65536)
                lines = re.findall(rb"t1918([0-9A-F]{16})\r", text)
                seen = [message.decode(bytes.fromhex(line.decode()))["reset_cause"] for line in lines]
            assert seen[0] == causes["unknown"]
            assert seen[-1] == causes[cause]
        finally:
            process.kill()


@pytest.mark.parametrize(("board", "place"), IMAGES)
def test_images_keep_their_budget_and_place(board: str, place: str) -> None:
    origin, header = PLACES[place.removeprefix("production-")]
    elf = image(board, place)
    done = subprocess.run(["arm-none-eabi-size", "-A", elf], capture_output=True, text=True, check=True)
    rows = re.findall(r"^(\.\S+) +(\d+) +(\d+)", done.stdout, re.MULTILINE)
    sections = {name: (int(size), int(at)) for name, size, at in rows}
    text = sum(sections.get(name, (0, 0))[0] for name in (".text", ".ARM.exidx", ".data"))
    ram = sum(sections.get(name, (0, 0))[0] for name in (".stack", ".data", ".bss"))
    assert 15_000 < text <= BUDGET["text"]
    assert 8_000 < ram <= BUDGET["ram"]
    assert sections[".text"][1] == origin + header
    stack, reset = struct.unpack_from("<II", elf.with_suffix(".bin").read_bytes())  # it begins behind the header
    assert 0x2000_0000 < stack <= 0x2000_0000 + 16 * 1024
    assert stack % 8 == 0
    assert origin + header < reset < origin + header + text
    assert reset & 1  # Thumb


def test_killed_emulator_is_one_error() -> None:
    link = open_qemu_usart()
    with link:
        link.start({})
        assert link.machine.pid is not None
        os.kill(link.machine.pid, signal.SIGKILL)
        os.waitid(os.P_PID, link.machine.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(LinkError, match="qemu-usart: the link disappeared"):
            link.exchange([(0x100, bytes(8))])


@pytest.mark.skipif(shutil.which("setpriv") is None, reason="setpriv is not installed")
def test_a_killed_run_leaves_no_emulator() -> None:
    """The image steps for ever by its own clock: nobody else would end it."""
    code = "from terrapin_hil.links.qemu_usart import *; m = QemuUsart(); m.start(); print(m.pid, flush=True); input()"
    run = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    emulator = int(run.stdout.readline())
    with os.fdopen(os.pidfd_open(emulator), "rb") as handle:
        run.kill()
        run.communicate()
        gone = select.select([handle], [], [], 10.0)[0]
        if not gone:
            os.kill(emulator, signal.SIGKILL)
    assert gone, "the emulator ran on"


def test_qemu_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(LinkError, match="qemu-usart: qemu-system-arm is not installed"):
        QemuUsart().start()


def test_no_image_no_start(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="make firmware"):
        QemuUsart(tmp_path / "absent.elf")
    (tmp_path / "bad.elf").write_bytes(b"no image")
    with pytest.raises(LinkError, match="does not answer"):
        QemuUsart(tmp_path / "bad.elf").start()
