"""What the seal costs on a Cortex-M4: instructions counted and bounded, and its bytes."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.seal import NO_PARAMETER, LinkKey, Session
from terrapin_hil.messages import Frame, Sender, interface
from tests.target.replay import FRAME, KEY, RESET, TICK, emulate, output_type, raw_values

OBJECTS = paths.ROOT / "build" / "cortex-m4" / "CMakeFiles" / "link_objects.dir" / "firmware" / "link"
PARTS = [OBJECTS / "seal.c.obj", OBJECTS / "chaskey.c.obj"]

pytestmark = [
    pytest.mark.skipif(shutil.which("arm-none-eabi-ld") is None, reason="no ARM cross compiler"),
    pytest.mark.skipif(not PARTS[0].is_file(), reason="the ARM images are not built (no ARM cross compiler)"),
]


def bound(function: str, image: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> int:
    """Instructions that the function can take at most, with what it calls (firmware/cmake/path_report.py)."""
    monkeypatch.syspath_prepend(str(paths.ROOT / "firmware" / "cmake"))
    import path_report

    monkeypatch.setattr(path_report, "LOOPS", {"terrapin_chaskey": (12,)})  # ROUNDS
    monkeypatch.setattr(sys, "argv", ["path_report.py", "--objdump", "arm-none-eabi-objdump", str(image), function])
    assert path_report.main() == 0
    found = re.search(r"(\d+) instructions at most", capsys.readouterr().out)
    assert found is not None
    return int(found[1])


def test_instructions_a_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the tags alone; `test_a_whole_command` counts the rest."""
    parts = tmp_path / "seal.elf"
    link = ["arm-none-eabi-ld", "-e", "terrapin_seal_check", "-o", str(parts), *map(str, PARTS)]
    subprocess.run(link, check=True, capture_output=True)
    assert bound("terrapin_chaskey", parts, monkeypatch, capsys) <= 200
    assert bound("terrapin_seal_check", parts, monkeypatch, capsys) <= 520  # with two sessions to look at
    assert bound("terrapin_seal_open", parts, monkeypatch, capsys) <= 300


def test_bytes_of_code() -> None:
    """Sessions, window, hold, tags. Codec and dispatcher have some 620 more for them."""
    done = subprocess.run(["arm-none-eabi-size", *map(str, PARTS)], check=True, capture_output=True, text=True)
    text = sum(int(line.split()[0]) for line in done.stdout.splitlines()[1:])
    assert 300 < text <= 800


KEYED = LinkKey(bytes(range(16)), 3)
STARTED = 0x1234_5678
NOTHING = (0x7FF, b"")
EMPTY_LOOK = 60  # instructions at most that a tick without a frame takes for its look at the queue


class Keyed(InProcess):
    """The same controller on this machine, to see what is taken."""

    def __init__(self) -> None:
        super().__init__()
        self._key = self._ffi.new("uint32_t[4]", list(struct.unpack("<4I", KEYED.key)))
        self._lib.terrapin_link_seal(self._link, self._key, KEYED.generation, STARTED)

    def taken(self, frame: Frame, tick: int) -> bool:
        """Whether a frame brings a command or an answer."""
        self._link.seal.now_ms, self._inputs.command_fresh = tick, False
        answers = self.exchange([frame])
        return bool(self._inputs.command_fresh) or bool(answers)


def session_open(host: int) -> Frame:
    message = interface().messages["SESSION_OPEN"]
    return message.id, message.encode({"host": host, "generation": KEYED.generation})[0]


def session(host: int, count: int) -> Session:
    return Session.answering(KEYED, host, {"start": STARTED, "count": count})


def sealed_frames() -> dict[str, Frame]:
    """What the count is of, in the order in which it comes; "" is a tick without a frame."""
    sender, first, second, third = Sender(), session(7, 1), session(8, 2), session(9, 3)
    setpoints = iter(range(100, 1000))

    def run(of: Session, skip: int = 0) -> Frame:
        """A sealed RUN; its counter is so much on that both sessions' tags are made."""
        for _ in range(skip):
            run(of)
        [frame] = of.sealed([sender.frame("COMMAND", {"request": 2, "setpoint": next(setpoints)})])
        return frame

    found = {"": NOTHING, "open": session_open(7), "first RUN": run(first), "RUN": run(first)}
    found["write, held"], found["seal"] = first.sealed([sender.frame("PARAMETER_WRITE", {"index": NO_PARAMETER})])
    found["open another"] = session_open(8)
    identifier, data = run(second, skip=5)
    found["RUN, wrong tag, two sessions"] = identifier, data[:7] + bytes([data[7] ^ 1])
    found["write, held again"], found["seal, two sessions"] = second.sealed(
        [sender.frame("PARAMETER_WRITE", {"index": NO_PARAMETER})]
    )
    found["open a third"] = session_open(9)
    found["RUN, two sessions"] = run(third, skip=12)
    return found


def open_frames() -> dict[str, Frame]:
    """The same for a controller without a key."""
    sender = Sender()
    return {
        "": NOTHING,
        "RUN": sender.frame("COMMAND", {"request": 2, "setpoint": 100}),
        "write": sender.frame("PARAMETER_WRITE", {"index": NO_PARAMETER}),
    }


NOT_TAKEN = ("", "write, held", "RUN, wrong tag, two sessions", "write, held again")  # at once


def counted(all_frames: dict[str, Frame], generation: int) -> tuple[dict[str, int], int]:
    """Instructions from a frame's arrival to its end, node and queue included, less those of a tick without one; and
    bytes of the seal's state. Of an open controller for generation 0."""
    firmware = Firmware.open()
    values = raw_values(firmware, {})
    records = struct.pack(f"<I{len(values)}i", RESET, *values)
    records += struct.pack("<I16s2I", KEY, KEYED.key, generation, STARTED)
    inputs = firmware.ffi.new("terrapin_inputs *")
    for tick, (name, (identifier, data)) in zip(times(all_frames), all_frames.items(), strict=True):
        inputs.tick = tick
        if name:
            frame = firmware.ffi.new("terrapin_frame *", {"id": identifier, "length": len(data), "data": data})
            records += struct.pack("<I", FRAME) + bytes(firmware.ffi.buffer(frame))
        records += struct.pack("<I", TICK) + bytes(firmware.ffi.buffer(inputs))
    answer = emulate(records)
    result, size = struct.unpack_from("<2I", answer)
    assert result == 0
    at, found, none = 8, dict[str, int](), 0
    for name in all_frames:
        (arrival,) = struct.unpack_from("<I", answer, at) if name else (0,)
        at += 4 if name else 0
        intake, taken = struct.unpack_from("<8x2I", answer, at)
        at += 20 + output_type(firmware).itemsize
        assert arrival or taken == 0, name
        none = none if name else intake
        found[name] = arrival + intake - none
    assert at == len(answer)
    assert 0 < none <= EMPTY_LOOK
    return found, size


def times(names: Iterable[str]) -> list[int]:
    """The ticks in which frames come: 300 apart, a seal 20 behind what it seals."""
    found = [0]
    for name in names:
        found.append(found[-1] + (20 if "held" in name else 300))
    return found[:-1]


@pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="no emulator")
def test_a_whole_command() -> None:
    """From a frame's arrival to the controller's input: node, queue, decoder, tags, what is taken over. A command
    takes at most 600 in all; what the seal adds to an open one stays below 600 also while a second session waits, for
    which two tags are made. A write comes as two frames: the same with one session; with two its 721 are told here."""
    here, given = Keyed(), sealed_frames()
    for tick, (name, frame) in zip(times(given), given.items(), strict=True):
        assert not name or here.taken(frame, tick) == (name not in NOT_TAKEN), name
    found, size = counted(given, KEYED.generation)
    plain, _ = counted(open_frames(), 0)
    write = found["write, held"] + found["seal"]
    write_of_two = found["write, held again"] + found["seal, two sessions"]
    print(f"sealed: {found}; open: {plain}; a write adds {write - plain['write']}, {write_of_two - plain['write']}")
    assert max(found["first RUN"], found["RUN"]) <= 600
    of_two = (found["RUN, two sessions"], found["RUN, wrong tag, two sessions"])
    assert min(of_two) > found["RUN"] + 150  # both tags were made
    assert max(of_two) - plain["RUN"] <= 600
    assert write - plain["write"] <= 600
    assert size <= 128
