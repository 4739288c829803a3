"""`terrapin param`, and the parameter store behind it: over memory, a pty and a CAN bus."""

from __future__ import annotations

import contextlib
import json
import random
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from unittest import mock

import can
import pytest

import terrapin_tools as door
from terrapin_hil.links import open_link
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.slcan import ControllerProcess, SlcanPort
from terrapin_hil.links.wire import SlcanLink
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_tools.errors import UserError
from terrapin_tools.param.files import raw_of, read_file, to_toml
from terrapin_tools.param.session import Session
from tests import command
from tests.command import Done

TERRAPIN = str(Path(sys.executable).parent / "terrapin")
PARAMETERS = interface().parameters
RADIUS = PARAMETERS["radius"]


def terrapin(*arguments: object, status: int = 0) -> Done:
    """What `terrapin param` says."""
    return command.terrapin("param", *arguments, status=status)


@contextmanager
def session(link: str, flash: Path | None = None) -> Iterator[Session]:
    with open_link(link, 1.0, **({"flash": flash} if flash else {})) as opened:
        yield Session(opened)


# ---------------------------------------------------------------- the command


def test_set_get_list_and_reset_with_a_flash_file(tmp_path: Path) -> None:
    flash = tmp_path / "robot.flash"
    done = terrapin("set", "armature_resistance", "120", "mohm", "--flash", flash)
    assert "armature_resistance = 0.12 ohm (was 5)" in done.stdout
    assert "kept in flash as set 1" in done.stdout
    assert terrapin("get", "armature_resistance", "--flash", flash).stdout == "armature_resistance = 0.12 ohm\n"
    answer = json.loads(terrapin("list", "--flash", flash, "--json", "-").stdout)
    assert set(answer["parameters"]) == set(PARAMETERS)
    entry = answer["parameters"]["armature_resistance"]
    assert (entry["raw"], entry["unit"], entry["minimum"], entry["maximum"]) == (120, "ohm", 0.1, 100.0)
    assert entry["protected"]
    assert answer["store"]["origin"] == "stored"
    assert answer["store"]["sequence"] == 1
    shown = terrapin("list", "--flash", flash).stdout.splitlines()
    assert len(shown) == len(PARAMETERS) + 2
    assert any(line.startswith("armature_resistance* ") and "0.12 " in line and "0.1 to 100" in line for line in shown)
    assert "1 changed" in terrapin("reset", "--flash", flash).stdout
    assert terrapin("diff", "--flash", flash).stdout == "no difference from the defaults\n"


def test_files_serve_param_run_and_diff(tmp_path: Path) -> None:
    flash, file = tmp_path / "robot.flash", tmp_path / "robot.toml"
    terrapin("set", "comp_coulomb", "--flash", flash, "--", "-0.5", "mN m")
    terrapin("save", file, "--changed", "--flash", flash)
    assert tomllib.loads(file.read_text())["parameters"] == {"comp_coulomb": -0.0005}
    other = tmp_path / "other.flash"
    assert "comp_coulomb" in terrapin("diff", file, "--flash", other, status=1).stdout
    terrapin("load", file, "--flash", other, "--link", "pty")
    assert "no difference" in terrapin("diff", file, "--flash", other).stdout
    run = [TERRAPIN, "run", "estop", "--parameters", str(file), "--json"]
    assert subprocess.run(run, capture_output=True, timeout=300, check=False).returncode == 0


def test_volatile_values_are_not_kept(tmp_path: Path) -> None:
    flash = tmp_path / "robot.flash"
    assert "--volatile" in terrapin("set", "radius", "0.1", "--volatile", "--flash", flash).stdout
    assert terrapin("get", "radius", "--flash", flash).stdout == "radius = 0.08 m\n"


def test_values_in_a_controller_of_this_command_are_said_to_be_gone(tmp_path: Path) -> None:
    """Without --link and --flash nothing was set that lasts: "until the next reset" would hide it."""
    assert "gone now: inprocess was started for this command; --flash FILE" in terrapin("set", "radius", "0.1").stdout
    assert "gone now" not in terrapin("set", "radius", "0.1", "--flash", tmp_path / "robot.flash").stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("get", "radiu"), "no parameter 'radiu' (perhaps radius"),
        (("set", "radius", "3 km"), "parameter radius: 3000 m is outside 0.01 to 0.5 m"),
        (("set", "radius", "3 kg"), "parameter radius: found '3 kg', expected a number in m"),
        (("set", "radius", "nan"), "parameter radius"),
        (("set", "trim_current", "0.5"), "parameter trim_current: found 0.5, expected a whole number, 0 to 1"),
        (("set", "radius", "1e999"), "parameter radius"),
        (("set", "radius", "9", "--raw"), "parameter radius: raw 9 is outside 10000 to 500000"),
        (("set", "radius", "8.5", "--raw"), "parameter radius: found '8.5', expected an integer"),
        (("list", "--link", "warp:9"), "link 'warp:9': expected one of"),
        (("list", "--link", "serial:/dev/null", "--flash", "x"), "--flash: serial:/dev/null keeps its parameters"),
        (("list", "--timeout", "0"), "--timeout: found 0"),
    ],
)
def test_bad_input_is_one_line(arguments: tuple[str, ...], words: str) -> None:
    done = terrapin(*arguments, status=2)
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def test_a_bad_file_writes_nothing(tmp_path: Path) -> None:
    flash, file = tmp_path / "robot.flash", tmp_path / "bad.toml"
    file.write_text('[parameters]\nweight = "20 N"\nradius = 7.0\n')
    assert f"{file}:3" in terrapin("load", file, "--flash", flash, status=2).stderr
    assert terrapin("diff", "--flash", flash).stdout == "no difference from the defaults\n"
    flash.write_bytes(b"no flash")
    assert "not a file of flash" in terrapin("list", "--flash", flash, status=2).stderr
    assert "not a file of flash" in terrapin("list", "--flash", flash, "--link", "pty", status=2).stderr
    assert flash.read_bytes() == b"no flash"


def test_nobody_answers() -> None:
    done = terrapin("get", "radius", "--link", "can:virtual:nobody", "--timeout", "0.2", status=1)
    assert "does not answer" in done.stderr


def test_every_value_survives_text() -> None:
    """Of each parameter: bounds and default, as TOML and as typed, come back as the same raw value."""
    for parameter in PARAMETERS.values():
        for raw in (parameter.minimum, parameter.default, parameter.maximum):
            text = to_toml(interface(), {parameter.name: raw}, "test")
            number = tomllib.loads(text)["parameters"][parameter.name]
            assert parameter.raw(number) == raw
            assert raw_of(parameter, repr(number)) == raw
            assert raw_of(parameter, str(raw), is_raw=True) == raw


def test_files_are_read_as_run_reads_them(tmp_path: Path) -> None:
    from terrapin_tools.param.files import read_parameters

    file = tmp_path / "x.toml"
    file.write_text('[parameters]\nradius = "90 mm"\nweight = 20\n')
    raw = read_file(file, interface())
    physical = read_parameters(file, interface())
    assert raw == {name: PARAMETERS[name].raw(value) for name, value in physical.items()}
    assert interface().parameter("radius").raw(0.09) == raw["radius"]


# ---------------------------------------------------------------- the store over the link


@pytest.mark.parametrize("link", ["inprocess", "pty"])
def test_save_keeps_over_a_reset(link: str, tmp_path: Path) -> None:
    flash = tmp_path / "robot.flash"
    with session(link, flash) as talk:
        assert talk.store().origin == "blank"
        talk.set(RADIUS, 90000)
        assert talk.store().changed
        kept = talk.save()
        assert (kept.result, kept.origin, kept.sequence, kept.changed) == ("ok", "stored", 1, False)
        talk.set(RADIUS, 95000)  # and this is not kept
    with session(link, flash) as talk:
        assert talk.get(RADIUS) == 90000
        assert talk.found() == {"dropped": 0, "replaced": 0, "missing": 0}
        talk.defaults()
        assert talk.get(RADIUS) == RADIUS.default
        assert talk.store().changed


def test_a_controller_without_store_says_so() -> None:
    with session("pty") as talk:
        talk.set(RADIUS, 90000)
        assert talk.save().result == "no_store"
        assert talk.get(RADIUS) == 90000


def test_a_damaged_file_gives_defaults_and_says_so(tmp_path: Path) -> None:
    flash = tmp_path / "robot.flash"
    flash.write_bytes(random.Random(1).randbytes(32768))
    with session("inprocess", flash) as talk:
        assert talk.store().origin == "damaged"
        assert talk.all() == {name: parameter.default for name, parameter in PARAMETERS.items()}
        assert talk.save().origin == "stored"


def test_the_page_says_how_many_saves_an_erase_has(tmp_path: Path) -> None:
    """Counted: saves until the other page of flash is begun."""
    flash, page, saves = tmp_path / "robot.flash", 16384, 0
    with session("inprocess", flash) as talk:
        while not flash.is_file() or not flash.read_bytes()[page : 2 * page].strip(b"\xff"):
            talk.set(RADIUS, 80000 + saves)
            talk.save()
            saves += 1
            assert saves < 100
    said = (Path(__file__).parents[2] / "docs/parameters.md").read_text()
    assert f"With {len(PARAMETERS)} parameters a page of 16 kB holds {saves - 1} sets" in said
    assert f"once in {saves - 1} saves" in said


def test_one_controller_a_file(tmp_path: Path) -> None:
    flash = tmp_path / "robot.flash"
    with session("inprocess", flash), pytest.raises(LinkError, match="another controller"), session("inprocess", flash):
        pass


def test_kill_in_the_middle_of_saves(tmp_path: Path) -> None:
    """SIGKILL at random moments of a host that only saves: the next start finds a whole set."""
    flash, generator = tmp_path / "robot.flash", random.Random(7)
    names = [PARAMETERS[name] for name in ("radius", "weight", "torque_constant", "encoder_tolerance")]

    def write(talk: Session, step: int) -> None:
        for parameter in names:
            talk.set(parameter, parameter.default + step)
        talk.save()

    last = 0
    for _ in range(8):
        process = ControllerProcess(arguments=["--flash", str(flash)])
        path = process.start()
        assert process.process is not None
        killer = threading.Timer(0.02 + 0.1 * generator.random(), process.process.send_signal, [signal.SIGKILL])
        with SlcanPort.open(path) as port:
            killer.start()
            talk = Session(SlcanLink("pty", port))
            with contextlib.suppress(LinkError):
                while True:
                    write(talk, last + 1)
                    last += 1
        killer.join()
        process.stop()
        with session("inprocess", flash) as talk:
            steps = {talk.get(parameter) - parameter.default for parameter in names}
            assert steps in ({last}, {last + 1})
            last = steps.pop()
            assert talk.store().origin in (("stored",) if last else ("blank", "damaged"))  # damaged: half a first set


class Robot:
    """A controller on a pty in test mode, ticked by hand."""

    def __init__(self, port: SlcanPort) -> None:
        self.port, self.sender, self.tick = port, Sender(), 0
        self.actuate = interface().messages["ACTUATE"]

    def arm(self) -> None:
        self.port.exchange_frames(self.sender.test_mode(False))
        self.port.exchange_frames(self.sender.test_mode())

    def run(self, ticks: int, request: str = "run", extra: list[tuple[int, bytes]] | None = None) -> dict[str, int]:
        """The last ACTUATE; every tick must have one."""
        number = interface().enums["request"][request]
        last: dict[str, int] = {}
        for _ in range(ticks):
            slow = {"slow_code": 3000 if self.tick % 2 == 0 else 1500, "slow_channel": self.tick & 1}
            frames = list(extra or [])
            if self.tick % 50 == 0:
                frames.append(self.sender.frame("COMMAND", {"request": number, "setpoint": 0}))
            frames.append(self.sender.frame("SENSORS_SLOW", slow))
            frames.append(self.sender.frame("SENSORS_FAST", {"current_code": 2048, "tick": self.tick & 0xFFFF}))
            answers = [data for identifier, data in self.port.exchange_frames(frames) if identifier == self.actuate.id]
            assert len(answers) == 1
            last = self.actuate.decode(answers[0])
            assert last["tick"] == self.tick & 0xFFFF
            self.tick += 1
        return last


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[tuple[Robot, Session]]:
    process = ControllerProcess(arguments=["--flash", str(tmp_path / "robot.flash")])
    with process as path, SlcanPort.open(path) as port:
        yield Robot(port), Session(SlcanLink("pty", port))


def test_locked_while_the_bridge_is_on(robot: tuple[Robot, Session]) -> None:
    body, talk = robot
    body.arm()
    assert body.run(400)["enable"] == 1
    with pytest.raises(UserError, match="locked while the bridge is on"):
        talk.set(RADIUS, 90000)
    with pytest.raises(UserError, match="locked while the bridge is on"):
        talk.save()
    with pytest.raises(UserError, match="locked while the bridge is on"):
        talk.defaults()
    open_one = next(p for p in PARAMETERS.values() if not p.protects)
    talk.set(open_one, open_one.minimum)  # what endangers nothing may change
    assert body.run(1)["enable"] == 1
    assert body.run(6000, "idle")["enable"] == 0
    talk.set(RADIUS, 90000)
    assert talk.save().result == "ok"


def test_a_file_is_written_whole_or_not_at_all(robot: tuple[Robot, Session]) -> None:
    """A free parameter comes before a locked one: it gets back what it was."""
    body, talk = robot
    free = next(p for p in PARAMETERS.values() if not p.protects)
    body.arm()
    assert body.run(400)["enable"] == 1
    other = free.maximum if free.default != free.maximum else free.minimum
    with pytest.raises(UserError, match="locked while the bridge is on"):
        talk.set_all({free.name: other, "radius": 90000})
    assert talk.get(free) == free.default
    talk.set_all({free.name: other})
    assert talk.get(free) == other


def test_a_controller_that_goes_away_leaves_word_of_what_was_written() -> None:
    port = InProcess()
    talk, answer, asked = Session(port), port.ask, []

    def ask(frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        asked.append(frame)
        return answer(frame, wanted) if len(asked) <= 4 else None

    with (
        mock.patch.object(port, "ask", ask),
        pytest.raises(LinkError, match=r"does not answer to PARAMETER_READ; 2 of 3 parameters were written, and not"),
    ):
        talk.set_all({"radius": 90000, "weight": 19000, "inertia": 17000})


def test_the_reason_why_a_controller_does_not_start_is_said(tmp_path: Path) -> None:
    done = terrapin("list", "--link", "pty", "--flash", tmp_path / "none" / "flash", status=1)
    assert done.stderr.endswith(f"cannot use {tmp_path}/none/flash: No such file or directory\n")
    assert len(done.stderr.splitlines()) == 1


def test_test_mode_is_a_function_of_its_frames(robot: tuple[Robot, Session]) -> None:
    """Armed, the stored values do not count; left, they are back."""
    body, talk = robot
    talk.set(RADIUS, 90000)
    talk.save()
    body.arm()
    assert talk.get(RADIUS) == RADIUS.default
    body.port.exchange_frames(body.sender.test_mode(False))
    assert talk.get(RADIUS) == 90000


def test_a_flood_of_writes_and_saves_does_not_starve_the_step(robot: tuple[Robot, Session]) -> None:
    """Eight frames a tick, all that 1 Mbit/s carries: writes and saves among them, and every tick is answered."""
    body, talk = robot
    body.arm()
    body.run(300, "idle")
    sender = Sender()
    sequence = talk.store().sequence
    for step in range(400):
        writes = [sender.frame("PARAMETER_WRITE", {"index": RADIUS.index, "value": 80000 + step + i}) for i in range(7)]
        flood = [*writes, sender.frame("STORE_COMMAND", {"action": interface().enums["store_action"]["save"]})]
        body.run(1, "idle", flood)
    assert talk.store().sequence > sequence + 3  # saves went on under it
    assert talk.get(RADIUS) == 80000 + 399 + 6


# ---------------------------------------------------------------- over CAN


@contextmanager
def controller_on_can(channel: str, flash: Path) -> Iterator[None]:
    """The firmware at a virtual bus."""
    host, stop = InProcess(flash=flash), threading.Event()
    bus = can.Bus(interface="virtual", channel=channel)

    def serve() -> None:
        noise = 0
        while not stop.is_set():
            message = bus.recv(0.02)
            if message is not None:
                noise += 1
                bus.send(can.Message(arbitration_id=0x7DF, data=bytes([noise & 0xFF]), is_extended_id=False))
                answer = host.ask((message.arbitration_id, bytes(message.data)), lambda _: True)
                if answer is not None:
                    bus.send(can.Message(arbitration_id=answer[0], data=answer[1], is_extended_id=False))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        bus.shutdown()
        host.close()


def test_over_a_can_bus(tmp_path: Path) -> None:
    flash = tmp_path / "robot.flash"
    with controller_on_can("param", flash), session("can:virtual:param") as talk:
        talk.set(RADIUS, 91000)
        assert talk.save().sequence == 1
        assert talk.all()["radius"] == 91000
    with session("inprocess", flash) as talk:
        assert talk.get(RADIUS) == 91000


def test_another_robots_controller_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has other defaults and ranges: a list calls its own values changed, and good ones are out of range."""
    monkeypatch.setattr("terrapin_hil.links.identity.interface", lambda: other)
    with controller_on_can("another", tmp_path / "robot.flash"):
        other = replace(interface(), constants={**interface().constants, "robot_identity": 1.0})
        for words in (["list"], ["get", "radius"], ["set", "radius", "5", "km"], ["reset"]):
            assert "--robot says whose" in terrapin(*words, "--link", "can:virtual:another", status=1).stderr
        with pytest.raises(LinkError, match="says whose"):
            door.Link("can:virtual:another")
        other = interface()
        assert terrapin("get", "radius", "--link", "can:virtual:another").stdout == "radius = 0.08 m\n"
        with door.Link("can:virtual:another") as link:
            assert link.read("radius") == 0.08


def test_an_earlier_host_left_its_counter(tmp_path: Path) -> None:
    """Each call of the command begins with the same counter: the controller drops that as a repetition."""
    with controller_on_can("counter", tmp_path / "robot.flash"):
        for value in (91000, 92000, 93000):
            with open_link("can:virtual:counter", 0.2) as port:
                Session(port).set(RADIUS, value)
        with open_link("can:virtual:counter", 0.2) as port:
            assert Session(port).get(RADIUS) == 93000
