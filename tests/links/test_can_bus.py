"""A simulated robot as an interface of python-can: for python-can's own classes, its viewer, and cantools' monitor."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from contextlib import closing
from pathlib import Path

import can
import cantools
import pytest

from terrapin_hil import paths
from terrapin_hil.messages import Sender, interface
from terrapin_hil.run.can_bus import TerrapinBus
from tests.entry_points import environment
from tests.waiting import BOUND, wait_for

CANTOOLS = [sys.executable, "-m", "cantools", "monitor"]


def listen(bus: can.BusABC, seconds: float) -> list[can.Message]:
    found, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        if (message := bus.recv(0.1)) is not None:
            found.append(message)
    return found


def test_it_says_what_a_robot_says_and_answers() -> None:
    database = cantools.database.load_file(paths.dbc())
    known = interface()
    with TerrapinBus("steady_sand", seed=3) as bus:
        heard = listen(bus, 1.0)
        assert len(heard) > 500
        names = {database.get_message_by_frame_id(m.arbitration_id).name for m in heard}
        assert {"STATUS", "GROUND", "ELECTRICAL"} <= names
        index = known.parameter("radius").index
        identifier, data = Sender().frame("PARAMETER_READ", {"index": index})
        bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        wanted = known.messages["PARAMETER_VALUE"].id

        def answered() -> bool:
            return any(m.arbitration_id == wanted for m in listen(bus, 0.2))

        wait_for(answered)
        bus.set_filters([{"can_id": known.messages["STATUS"].id, "can_mask": 0x7FF}])
        listen(bus, 0.3)  # what waited already
        assert {m.arbitration_id for m in listen(bus, 0.5)} == {known.messages["STATUS"].id}
    with pytest.raises(can.CanError):
        bus.send(can.Message(arbitration_id=1, is_extended_id=False))


def test_python_can_finds_it_by_its_name(tmp_path: Path) -> None:
    """In a process of its own, by the entry point; its notifier writes a log that its reader reads."""
    program = f"""
import can, sys, time
before = set(sys.modules)
with can.Bus(interface="terrapin", channel="steady_sand") as bus:
    notifier = can.Notifier(bus, [can.Logger({str(tmp_path / "x.blf")!r})])
    time.sleep(1.0)
    notifier.stop()
print(sum(1 for _ in can.LogReader({str(tmp_path / "x.blf")!r})), "terrapin" in can.VALID_INTERFACES)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment(tmp_path), capture_output=True, text=True, timeout=120
    )
    count, known = done.stdout.split()
    assert int(count) > 500, done.stderr
    assert known == "True"


@pytest.mark.parametrize("tool", ["viewer", "cantools"])
def test_tools_of_others_show_it(tmp_path: Path, tool: str) -> None:
    """On a terminal of their own: python-can's viewer and cantools' monitor, each until it shows the robot's status."""
    words = {
        "viewer": [sys.executable, "-m", "can.viewer", "-i", "terrapin", "-c", "steady_sand"],
        "cantools": [*CANTOOLS, "-i", "terrapin", "-c", "steady_sand", str(paths.dbc())],
    }[tool]
    expected = {"viewer": f"0x{interface().messages['STATUS'].id:03X}", "cantools": "ELECTRICAL"}[tool]
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 160, 0, 0))
    with closing(os.fdopen(master, "rb", buffering=0)) as screen:
        process = subprocess.Popen(
            words,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=environment(tmp_path, TERM="xterm", LINES="50", COLUMNS="160"),
        )
        os.close(slave)
        seen, end = "", time.monotonic() + BOUND
        try:
            while expected not in seen and time.monotonic() < end and process.poll() is None:
                if select.select([screen], [], [], 0.2)[0]:
                    with contextlib.suppress(OSError):  # the other end has closed
                        seen += screen.read(65536).decode(errors="replace")
        finally:
            process.terminate()
            process.wait(BOUND)
    assert expected in seen, seen[-2000:]


def test_a_command_takes_the_operators_place() -> None:
    with TerrapinBus("steady_sand") as bus:
        sender = Sender()
        requests = interface().enums["request"]

        def idle() -> bool:
            identifier, data = sender.frame("COMMAND", {"request": requests["idle"]})
            bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            time.sleep(0.05)
            return str(bus.living.state()["state"]) == "idle"

        wait_for(lambda: bus.living.state()["state"] == "run")
        wait_for(idle)


def test_who_does_not_read_loses_the_oldest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_hil.run.can_bus.WAITING", 100)
    with TerrapinBus("steady_sand") as bus:
        wait_for(lambda: bus.lost > 50)
        assert len(bus._ends.said) <= 100


def test_one_line_and_a_clean_end() -> None:
    for words, options, expected in (
        ("no_such", {}, "no_such"),
        ("steady_sand", {"robot": "elephant"}, "elephant"),
        ("steady_sand", {"colour": 1}, "found option colour, expected one of seed, robot, node"),
    ):
        with pytest.raises(can.CanInitializationError) as caught:
            TerrapinBus(words, **options)
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)
    with TerrapinBus("steady_sand") as first:
        with pytest.raises(can.CanInitializationError, match="lives on channel steady_sand"):
            TerrapinBus("steady_sand")
        assert first.recv(5.0) is not None
        with pytest.raises(can.CanOperationError, match="expected a classic data frame"):
            first.send(can.Message(arbitration_id=0x12345, is_extended_id=True))
    first.shutdown()
    with TerrapinBus("steady_sand") as again:  # the channel is free
        assert again.recv(5.0) is not None
