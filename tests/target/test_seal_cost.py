"""What the seal costs on a Cortex-M4: instructions counted and bounded, and its bytes."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.seal import NO_PARAMETER, LinkKey, Session, chaskey
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

    monkeypatch.setattr(path_report, "LOOPS", {"terrapin_chaskey": (4, 12)})  # words, ROUNDS
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
    link = ["arm-none-eabi-ld", "-e", "terrapin_seal_taken", "-o", str(parts), *map(str, PARTS)]
    subprocess.run(link, check=True, capture_output=True)
    assert bound("terrapin_chaskey", parts, monkeypatch, capsys) <= 250
    assert bound("terrapin_seal_taken", parts, monkeypatch, capsys) <= 350  # one tag, whatever waits
    assert bound("terrapin_seal_open", parts, monkeypatch, capsys) <= 600  # two: the challenge, and the key


# What makes dispatcher and commands those of a controller that knows of no seal.
WITHOUT = {
    "dispatch.c": (
        ("    case TERRAPIN_ID_COMMAND_SEALED:\n", ""),
        (
            "    case TERRAPIN_ID_SESSION_OPEN:\n"
            "        if (terrapin_seal_open(&link->seal, frame, reply)) {\n"
            "            result = TERRAPIN_ACCEPT_REPLY;\n"
            "        } else {\n"
            "            link->out_of_place++;\n"
            "        }\n"
            "        break;\n",
            "",
        ),
        ("const bool of_seal = ", "const bool of_seal = false && "),
        ("} else if (terrapin_link_holds(link, frame)) {", "} else if (false) {"),
        ("bool terrapin_link_holds(", "static __attribute__((unused)) bool holds("),
        ("void terrapin_link_seal(", "static __attribute__((unused)) void seals("),
    ),
    "command.c": (
        ("const bool sealed = ", "const bool sealed = false && "),
        ("} else if (!sealed && (link->seal.key != NULL)) {", "} else if (false) {"),
    ),
}


def text_bytes(objects: Iterable[Path]) -> int:
    """Code and constants of all of them."""
    done = subprocess.run(["arm-none-eabi-size", *map(str, objects)], check=True, capture_output=True, text=True)
    return sum(int(line.split()[0]) for line in done.stdout.splitlines()[1:])


def test_bytes_of_code(tmp_path: Path) -> None:
    """Sessions, window, hold and tags, and what dispatcher and commands have for them: what there is less without."""
    commands = json.loads((OBJECTS.parents[3] / "compile_commands.json").read_text())
    with_it, without = text_bytes(PARTS), 0
    for name, changes in WITHOUT.items():
        [entry] = [e for e in commands if e["output"].endswith(f"link_objects.dir/firmware/link/{name}.obj")]
        source = Path(entry["file"]).read_text()
        for old, new in changes:
            assert source.count(old) == 1, f"{name} no longer has {old!r}: take the seal out in another way"
            source = source.replace(old, new)
        (tmp_path / name).write_text(source)
        words = shlex.split(entry["command"])
        words[words.index("-o") + 1] = str(tmp_path / f"{name}.obj")
        words[-1:] = [str(tmp_path / name), "-Wno-error", "-w"]
        subprocess.run(words, cwd=entry["directory"], check=True)
        with_it += text_bytes([OBJECTS / f"{name}.obj"])
        without += text_bytes([tmp_path / f"{name}.obj"])
    print(f"{with_it - without} bytes of code")
    assert 400 < with_it - without <= 800


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
        self._lib.terrapin_seal_at(self._ffi.addressof(self._link, "seal"), tick)
        self._inputs.command_fresh = False
        answers = self.exchange([frame])
        return bool(self._inputs.command_fresh) or bool(answers)


def session_open(host: int) -> Frame:
    message = interface().messages["SESSION_OPEN"]
    return message.id, message.encode({"host": host, "generation": KEYED.generation})[0]


def session(host: int, count: int, now: Callable[[], float]) -> Session:
    challenge = chaskey(KEYED.key, struct.pack("<4I", STARTED, count // 2, 0, 0))
    return Session.answering(KEYED, host, {"start": int.from_bytes(challenge[:4], "little"), "count": count}, now=now)


def sealed_frames() -> dict[str, Frame]:
    """What the count is of, in the order in which it comes; "" is a tick without a frame. Each has its tick's time."""
    sender, names = Sender(), ("", "open", "first RUN", "RUN", "write, held", "seal", "open another",
                               "RUN, wrong tag, two sessions", "write, held again", "seal, two sessions",
                               "open a third", "RUN, two sessions")  # fmt: skip
    at, now = dict(zip(names, times(names), strict=True)), 0.0
    setpoints = iter(range(100, 1000))

    def opened(host: int, count: int, name: str) -> Session:  # twice a count, and the place
        return session(host, count, lambda: now or at[name] / 1000)

    first, second, third = opened(7, 2, "open"), opened(8, 5, "open another"), opened(9, 6, "open a third")

    def run(of: Session, name: str) -> Frame:
        nonlocal now
        now = at[name] / 1000
        [frame] = of.sealed([sender.frame("COMMAND", {"request": 2, "setpoint": next(setpoints)})])
        return frame

    def write(of: Session, name: str) -> list[Frame]:
        nonlocal now
        now = at[name] / 1000
        return of.sealed([sender.frame("PARAMETER_WRITE", {"index": NO_PARAMETER})])

    found = {"": NOTHING, "open": session_open(7), "first RUN": run(first, "first RUN"), "RUN": run(first, "RUN")}
    found["write, held"], found["seal"] = write(first, "write, held")
    found["open another"] = session_open(8)
    identifier, data = run(second, "RUN, wrong tag, two sessions")
    found["RUN, wrong tag, two sessions"] = identifier, data[:7] + bytes([data[7] ^ 1])
    found["write, held again"], found["seal, two sessions"] = write(second, "write, held again")
    found["open a third"] = session_open(9)
    found["RUN, two sessions"] = run(third, "RUN, two sessions")
    assert tuple(found) == names
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
    """From a frame's arrival to the controller's input: node, queue, decoder, tag, what is taken over. A command takes
    at most 600 in all, and what the seal adds to a write, which comes as two frames, is at most 600, too: one tag is
    made, also while a second session waits."""
    here, given = Keyed(), sealed_frames()
    for tick, (name, frame) in zip(times(given), given.items(), strict=True):
        assert not name or here.taken(frame, tick) == (name not in NOT_TAKEN), name
    found, size = counted(given, KEYED.generation)
    plain, _ = counted(open_frames(), 0)
    write = found["write, held"] + found["seal"]
    write_of_two = found["write, held again"] + found["seal, two sessions"]
    print(f"sealed: {found}; open: {plain}; a write adds {write - plain['write']}, {write_of_two - plain['write']}")
    runs = [found[name] for name in ("first RUN", "RUN", "RUN, wrong tag, two sessions", "RUN, two sessions")]
    assert max(runs) <= 600
    assert max(write, write_of_two) - plain["write"] <= 600
    assert size <= 128
