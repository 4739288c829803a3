"""The controller's process on a pty: lockstep, python-can, and every way of going away."""

from __future__ import annotations

import os
import random
import select
import signal
import subprocess
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.slcan import ControllerProcess, SlcanPort, slcan_line, slcan_parse
from terrapin_hil.messages import Frame, Sender, interface, protect
from tests.waiting import BOUND

PROGRAM = paths.build() / "terrapin-controller"
ACTUATE = interface().messages["ACTUATE"]


@pytest.fixture
def controller() -> Iterator[ControllerProcess]:
    process = ControllerProcess()
    yield process
    process.stop()


@pytest.fixture
def port(controller: ControllerProcess) -> Iterator[SlcanPort]:
    with SlcanPort.open(controller.start()) as opened:
        yield opened


def sensor_values(tick: int, generator: random.Random) -> tuple[dict[str, int], dict[str, int]]:
    slow = {"slow_code": 2400 if tick % 2 == 0 else 2000, "slow_channel": tick & 1, "pitch": 20, "ground_speed": 150,
            "swing_angle": generator.randint(-40, 40), "swing_rate": generator.randint(-50, 50)}  # fmt: skip
    fast = {"current_code": 2048 + generator.randint(-30, 30), "swing_valid": 1, "ground_speed_valid": tick // 300 % 2,
            "estop": int(tick % 1999 == 1998), "motor_count": tick * 5 & 0xFFFF, "ground_count": tick * 2 & 0xFFFF,
            "tick": tick & 0xFFFF}  # fmt: skip
    return slow, fast


def host_frames(ticks: int, seed: int) -> list[list[Frame]]:
    """What a simulator sends in each tick: SENSORS_SLOW, or COMMAND every 50th, then SENSORS_FAST."""
    generator, sender = random.Random(seed), Sender()
    out = []
    for tick in range(ticks):
        slow, fast = sensor_values(tick, generator)
        command = {"request": 1 if tick < 500 else 2, "limiter": 1, "setpoint": 4000}
        first = sender.frame("COMMAND", command) if tick % 50 == 0 else sender.frame("SENSORS_SLOW", slow)
        out.append([first, sender.frame("SENSORS_FAST", fast)])
    return out


def in_memory(frames: list[list[Frame]]) -> list[list[Frame]]:
    """The same frames through the same C in this process."""
    firmware = Firmware.open()
    ffi, lib = firmware.ffi, firmware.lib
    state, link = firmware.new_state(), ffi.new("terrapin_link *")
    inputs, outputs = ffi.new("terrapin_inputs *"), ffi.new("terrapin_outputs *")
    frame, reply = ffi.new("terrapin_frame *"), ffi.new("terrapin_frame *")
    lib.terrapin_link_init(link, state, inputs)
    answers = []
    for group in [Sender().test_mode(), *frames]:
        answer = []
        for identifier, data in group:
            frame.id, frame.length = identifier, len(data)
            frame.data[0 : len(data)] = data
            if lib.terrapin_accept(link, state, frame, inputs, reply) == lib.TERRAPIN_ACCEPT_STEP:
                lib.terrapin_link_step(state, inputs, outputs)
                answer += [(f.id, bytes(f.data)[: f.length]) for f in outputs.frames[0 : outputs.frame_count]]
        answers.append(answer)
    return answers[1:]


def test_lockstep_gives_the_same_frames_as_memory(port: SlcanPort) -> None:
    frames = host_frames(3000, 1)
    assert port.exchange_frames(Sender().test_mode()) == []
    answers = [port.exchange_frames(group) for group in frames]
    assert answers == in_memory(frames)
    assert [ACTUATE.decode(answer[0][1])["tick"] for answer in answers] == list(range(3000))


def test_a_second_run_is_as_the_first(port: SlcanPort) -> None:
    """Arming resets the controller: nothing of an earlier run, not even an earlier host's counters, stays behind."""
    runs = []
    for _ in range(2):
        port.exchange_frames(Sender().test_mode())
        runs.append([port.exchange_frames(group) for group in host_frames(200, 2)])
    assert runs[0] == runs[1]


def test_parameters_over_the_wire(port: SlcanPort) -> None:
    sender = Sender()
    value_message = interface().messages["PARAMETER_VALUE"]
    for parameter in interface().parameters.values():
        write = sender.frame("PARAMETER_WRITE", {"index": parameter.index, "value": parameter.maximum})
        written = port.exchange_frames([write])
        assert value_message.decode(written[0][1])["value"] == parameter.maximum
        assert protect(*written[0], written[0][1][6] & 0x0F) == written[0][1]
        answer = port.exchange_frames([sender.frame("PARAMETER_READ", {"index": parameter.index})])
        found = value_message.decode(answer[-1][1])
        assert (found["index"], found["value"], found["status"]) == (parameter.index, parameter.maximum, 0)
    beyond = port.exchange_frames([sender.frame("PARAMETER_READ", {"index": 65535})])
    assert value_message.decode(beyond[0][1])["status"] == 1


def test_any_cut_of_the_stream_gives_the_same_answers(port: SlcanPort) -> None:
    """The text of 40 ticks in random pieces, single bytes among them."""
    frames = host_frames(40, 3)
    port.exchange_frames(Sender().test_mode())
    text = b"".join(slcan_line(frame) for group in frames for frame in group)
    generator = random.Random(5)
    while text:
        cut = generator.choice([1, 2, 7, 300, 900])
        port.send(text[:cut])
        text = text[cut:]
    answers = port.exchange(b"")
    assert len(answers) > 40
    assert answers == [frame for answer in in_memory(frames) for frame in answer]


def test_opening_clears_what_an_earlier_host_left(controller: ControllerProcess) -> None:
    path = controller.start()
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(fd, b"O\rt1238")  # half a frame, and a channel left open
        with SlcanPort.open(path) as port:
            assert port.exchange_frames([(0x7FF, b"")]) == []
    finally:
        os.close(fd)


def test_without_test_mode_no_tick(port: SlcanPort) -> None:
    """Sensors from the bus are taken only after arming; the first frame here is a COMMAND, which is always taken."""
    assert port.exchange_frames(host_frames(1, 1)[0]) == []


def test_python_can(controller: ControllerProcess) -> None:
    path = controller.start()
    frames = host_frames(100, 4)
    with can.Bus(interface="slcan", channel=path, bitrate=500000, sleep_after_open=0) as bus:
        assert bus.get_version(BOUND) == (1, 1)
        assert bus.get_serial_number(BOUND) == "TRPN"
        for identifier, data in Sender().test_mode():
            bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        answers: list[Frame] = []
        for group in frames:
            for identifier, data in group:
                bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            while True:
                message = bus.recv(BOUND)
                assert message is not None
                answers.append((message.arbitration_id, bytes(message.data)))
                if message.arbitration_id == ACTUATE.id:
                    break
        expected = [frame for answer in in_memory(frames) for frame in answer]
        while len(answers) < len(expected) and (message := bus.recv(BOUND)) is not None:
            answers.append((message.arbitration_id, bytes(message.data)))
        assert bus.recv(0.05) is None
    assert answers == expected


def test_process_outlives_its_peers(controller: ControllerProcess) -> None:
    """Each is served as the first was, though the one before it went in the middle of a line."""
    path = controller.start()
    for _ in range(3):
        with SlcanPort.open(path) as port:
            assert port.exchange_frames([Sender().frame("PARAMETER_READ", {"index": 0})]) != []
            os.write(port._to, b"t123")
    assert controller.process is not None
    assert controller.process.poll() is None
    assert controller.stop() == 0


def test_process_ends_with_whoever_started_it() -> None:
    """Nobody reads its output, and its peer is gone."""
    process = subprocess.Popen([PROGRAM, "--pty"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    port = SlcanPort.open(process.stdout.readline().strip())
    process.stdout.close()
    assert port.exchange_frames([Sender().frame("PARAMETER_READ", {"index": 0})]) != []
    port.close()
    assert process.wait(300) == 0
    assert process.stderr is not None
    assert "peer gone" in process.stderr.read()
    process.stderr.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.parametrize("opened", [False, True])
def test_process_ends_on_a_signal(number: signal.Signals, opened: bool) -> None:
    process = subprocess.Popen([PROGRAM, "--pty"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    path = process.stdout.readline().strip()
    port = SlcanPort.open(path) if opened else None
    process.send_signal(number)
    _, error = process.communicate(timeout=300)
    assert process.returncode == 0
    assert error.startswith("terrapin-controller: stopped by a signal after 0 ticks, outputs off")
    if port is not None:
        port.close()


def test_link_that_disappears(controller: ControllerProcess, port: SlcanPort) -> None:
    sender = Sender()
    port.exchange_frames(sender.test_mode())
    port.exchange_frames(host_frames(1, 1)[0])
    assert controller.process is not None
    controller.process.kill()
    controller.process.wait()
    with pytest.raises(LinkError) as caught:
        port.exchange_frames([sender.frame("PARAMETER_READ", {"index": 0})])
    assert str(caught.value) == f"{port.path}: the link disappeared"


def test_firmware_that_stops_answering(controller: ControllerProcess) -> None:
    with SlcanPort.open(controller.start()) as port:
        port.timeout = 0.2
        assert controller.process is not None
        controller.process.send_signal(signal.SIGSTOP)
        try:
            with pytest.raises(LinkError) as caught:
                port.exchange_frames([Sender().frame("PARAMETER_READ", {"index": 0})])
            assert str(caught.value) == f"{port.path}: no answer within 0.2 s"
            with pytest.raises(LinkError, match="no answer within"):
                port.exchange(b"")
            with pytest.raises(LinkError, match=r"takes no data for 0\.2 s"):
                port.send(b"t1230\r" * 100_000)
        finally:
            controller.process.send_signal(signal.SIGCONT)


def test_peer_that_does_not_read_blocks_nobody_for_ever(controller: ControllerProcess) -> None:
    """The process waits for room with bounded buffers, and still hears a signal while it waits."""
    fd = os.open(controller.start(), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        end = time.monotonic() + BOUND
        stuck_since = None
        while stuck_since is None or time.monotonic() - stuck_since < 0.2:
            assert time.monotonic() < end
            try:
                os.write(fd, b"V\r" * 500)
                stuck_since = None
            except BlockingIOError:
                stuck_since = stuck_since or time.monotonic()
                time.sleep(0.01)
        assert controller.stop() == 0
    finally:
        os.close(fd)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [(b"\a", "refused a line"), (b"hello\r", "no SLCAN: b'hello'"), (b"t12\r", "no SLCAN frame: b't12'"),
     (b"x" * 70_000, "no SLCAN")],
)  # fmt: skip
def test_nonsense_from_the_other_side(answer: bytes, expected: str) -> None:
    master, slave = os.openpty()

    def speak() -> None:
        rest = answer
        while rest:
            rest = rest[os.write(master, rest) :]

    speaker = threading.Thread(target=speak, daemon=True)
    try:
        with SlcanPort(os.ttyname(slave), BOUND) as port:
            speaker.start()
            with pytest.raises(LinkError) as caught:
                port.exchange(b"F\r")
            assert expected in str(caught.value)
            termios.tcflush(slave, termios.TCIFLUSH)  # frees a speaker that waits for room
            speaker.join(5)
    finally:
        os.close(master)
        os.close(slave)


def test_after_a_refused_line_the_next_is_answered() -> None:
    """Also where what came with the refusal answers another line."""
    master, slave = os.openpty()
    try:
        with SlcanPort(os.ttyname(slave), 0.5) as port:
            for lines, answers in ((b"t12\r", b"\a"), (b"t12\rF\r", b"\aF00\r")):
                os.write(master, answers)
                with pytest.raises(LinkError, match="refused a line"):
                    port.exchange(lines)
                os.write(master, b"t1001ab\rF00\r")
                assert port.exchange(b"F\r") == [(0x100, b"\xab")]
    finally:
        os.close(master)
        os.close(slave)


def test_once_the_end_has_passed_nothing_is_waited_for() -> None:
    """It may pass while lines are taken, and poll takes less than 0 as for ever."""
    master, slave = os.openpty()
    late = threading.Timer(20.0, os.write, (master, b"z"))  # what would end that
    try:
        with SlcanPort(os.ttyname(slave), BOUND) as port:
            late.start()
            with pytest.raises(LinkError, match="no answer within"):
                port._receive(time.monotonic() - 1.0)
    finally:
        late.cancel()
        late.join()
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize("node", ["", "x", "3x", "-1", "8"])
def test_a_node_number_that_is_none_is_refused(tmp_path: Path, node: str) -> None:
    taken = tmp_path  # no link can stand there, so that nothing is served in any case
    command = [str(PROGRAM), "--node", node, "--pty", str(taken)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    expected = f"terrapin-controller: --node: found '{node}', expected a number from 0 to 7\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", expected)


def test_paths_that_are_no_link(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"cannot open the link: no such device; `terrapin flash --list` shows"):
        SlcanPort.open(tmp_path / "nothing")
    (tmp_path / "file").touch()
    before = os.listdir("/proc/self/fd")
    with pytest.raises(LinkError, match=r"cannot open the link: not a terminal"):
        SlcanPort.open(tmp_path / "file")
    assert os.listdir("/proc/self/fd") == before  # none is left open
    with pytest.raises(LinkError, match=r"cannot start the controller"):
        ControllerProcess(tmp_path / "nothing").start()
    with pytest.raises(LinkError, match=r"did not start"):
        ControllerProcess(Path("/bin/false")).start()


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, timeout=300)


def test_command_line(tmp_path: Path) -> None:
    assert run("--help").returncode == 0
    assert "--pty [LINK]" in run("--help").stdout
    for arguments in ([], ["--pty", "a", "b"], ["a", "b"], ["--nonsense"]):
        assert run(*arguments).returncode == 2
    missing = run(str(tmp_path / "nothing"))
    assert (missing.returncode, missing.stderr.count("\n")) == (1, 1)
    assert "cannot open" in missing.stderr
    (tmp_path / "file").touch()
    occupied = run("--pty", str(tmp_path / "file"))
    assert (occupied.returncode, occupied.stderr.count("\n")) == (1, 1)
    assert "File exists" in occupied.stderr


def test_pty_under_a_name(tmp_path: Path) -> None:
    """The name is a link, made anew over one that an earlier run left behind, and gone at the end."""
    name = tmp_path / "terrapin"
    name.symlink_to("/dev/pts/nonexistent")
    process = subprocess.Popen(
        [PROGRAM, "--pty", str(name)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == f"{name}\n"
    for _ in range(2):
        with SlcanPort.open(name) as port:
            assert port.exchange_frames([Sender().frame("PARAMETER_READ", {"index": 0})]) != []
    process.terminate()
    assert process.wait(300) == 0
    process.stdout.close()
    assert not name.is_symlink()


def test_on_a_tty() -> None:
    """Given a device, the process serves it, and ends when it hangs up."""
    master, slave = os.openpty()
    process = subprocess.Popen([PROGRAM, os.ttyname(slave)], stderr=subprocess.PIPE, text=True)
    try:
        read = interface().messages["PARAMETER_READ"]
        request = slcan_line((read.id, read.encode({"index": 0})[0]))
        received = b""
        end = time.monotonic() + BOUND
        os.set_blocking(master, False)
        while b"t" not in received or not received.endswith(b"\r\r"):
            assert time.monotonic() < end
            if select.select([master], [], [], 0.1)[0]:
                received += os.read(master, 4096)
            elif b"V0101" not in received:
                os.write(master, b"V\r")  # until its side is raw and listening
            elif b"t" not in received:
                os.write(master, b"O\r" + request)
        frame = slcan_parse(received[received.rindex(b"t") :].rstrip(b"\r"))
        assert frame[0] == interface().messages["PARAMETER_VALUE"].id
    finally:
        os.close(slave)
        os.close(master)
    _, error = process.communicate(timeout=300)
    assert process.returncode == 0
    assert "peer gone" in error
