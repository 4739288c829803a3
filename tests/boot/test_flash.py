"""`terrapin flash`, `image` and `keys`, end to end: the boot loader's process on a pty, a CAN bus, ST's boot loader."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import shlex
import shutil
import stat
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import pytest
from an3155 import Emulator
from bootlib import Chip, image_file, send
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from kit import KEY, NEXT_KEY, NEXT_PUBLIC, OTHER_KEY, PUBLIC, code, image
from virtual_chip import QUERY, beside, on_bus

from terrapin_hil import paths
from terrapin_hil.links import LinkName
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.seal import LinkKey
from terrapin_hil.messages import Frame, interface
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_hil.simulation import Simulation, output_hash
from terrapin_tools import cli
from terrapin_tools.commands.flash import flash
from terrapin_tools.errors import UserError
from terrapin_tools.flash import protect, swd
from terrapin_tools.flash.can_wire import CanWire
from terrapin_tools.flash.image import Version, parse, sign
from terrapin_tools.flash.keys import development_key, private_key
from terrapin_tools.flash.layout import BASE, SLOTS
from terrapin_tools.flash.plan import plan, read
from terrapin_tools.flash.protect import refuse_bench_key
from terrapin_tools.flash.update import Outcome, SignedFile, query, update
from terrapin_tools.flash.wires import SerialWire

PROGRAM = paths.build() / "terrapin-bootloader"


@pytest.fixture(autouse=True)
def brief(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The emulated boot loader starts at once, and what confirms itself has done so by then. What a slip writes under a
    name of its own does not lie in the sources."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("terrapin_tools.flash.update.START", 0.05)
    monkeypatch.setattr("terrapin_tools.flash.update.CONFIRM", 1.0)


def quiet(what: str, done: int, total: int) -> None:
    pass


def terrapin(*arguments: object) -> SimpleNamespace:
    """The command line in this process, which has imported everything already: status, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["terrapin", *map(str, arguments)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        cli.main()
    return SimpleNamespace(returncode=ended.value.code, stdout=out.getvalue(), stderr=err.getvalue())


def signed(folder: Path, slot: str, version: str, counter: int = 1) -> Path:
    path = folder / f"{version}-{slot}.bin"
    key = private_key(development_key())
    path.write_bytes(sign(code(slot, 3000, version), key, Version.of(version), counter, slot))
    return path


def file(slot: str, version: str, counter: int = 1, size: int = 3000) -> SignedFile:
    data = image(slot, version, counter, size)
    return SignedFile(f"{version}-{slot}", parse(data), data)


@contextlib.contextmanager
def board(folder: Path, *options: str) -> Iterator[str]:
    """The boot loader's process over folder/flash.bin; its port. What it said is in folder/log."""
    port = folder / "port"
    with (folder / "log").open("a") as log:
        process = subprocess.Popen([PROGRAM, *options, folder / "flash.bin", port], stdout=subprocess.PIPE, stderr=log)
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline().decode().strip() == str(port)
        try:
            yield str(port)
        finally:
            process.terminate()
            assert process.wait(300) == 0


def said(folder: Path) -> list[str]:
    return [line.partition(": ")[2] for line in (folder / "log").read_text().splitlines()]


@pytest.mark.parametrize("more", [-1, 1])
def test_a_flash_of_another_size_is_refused(tmp_path: Path, more: int) -> None:
    with board(tmp_path):
        pass
    flash = tmp_path / "flash.bin"
    size = flash.stat().st_size
    os.truncate(flash, size + more)
    taken = tmp_path  # no link can stand there, so that nothing is served in any case
    done = subprocess.run([PROGRAM, flash, taken], capture_output=True, text=True, check=False)
    assert done.stderr == f"terrapin-bootloader: {flash}: {size + more} bytes, expected {size}\n"
    assert (done.returncode, done.stdout) == (1, "")


def test_serial_end_to_end(tmp_path: Path) -> None:
    """An empty chip takes 1.0.0, then 1.1.0 while that runs; old, forged and other images are refused with a reason."""
    first, second = signed(tmp_path, "a", "1.0.0", counter=2), signed(tmp_path, "b", "1.1.0", counter=3)
    with board(tmp_path) as port:
        done = terrapin("flash", first, "--via", "serial", "--port", port)
        assert (done.returncode, done.stdout) == (0, "slot a: started and confirmed\n"), done.stderr
        done = terrapin("flash", first, second, "--via", "serial", "--port", port)
        assert (done.returncode, done.stdout) == (0, "slot b: started and confirmed\n"), done.stderr
        for bad, reason in [
            (signed(tmp_path, "a", "0.9.9", counter=2), "version too old: 0.9.9, expected 1.0.0 or newer"),
            (signed(tmp_path, "a", "1.2.0", counter=1), "security counter 1, expected 2 or more"),
            (signed(tmp_path, "b", "1.2.0"), "expected the image for slot a"),
        ]:
            done = terrapin("flash", bad, "--via", "serial", "--port", port)
            assert done.returncode == 2
            assert reason in done.stderr
    assert said(tmp_path) == [
        "stays",
        "started slot A, version 1.0.0+0, confirmed",
        "stays",
        "started slot B, version 1.1.0+0, confirmed",
    ]
    with board(tmp_path):  # power off and on
        pass
    assert said(tmp_path)[-1] == "started slot B, version 1.1.0+0, confirmed"


def test_an_image_that_does_not_confirm_itself(tmp_path: Path) -> None:
    with board(tmp_path) as port:
        assert terrapin("flash", signed(tmp_path, "a", "1.0.0"), "--via", "serial", "--port", port).returncode == 0
    with board(tmp_path, "--unhealthy") as port:
        done = terrapin("flash", signed(tmp_path, "b", "1.1.0"), "--via", "serial", "--port", port)
        assert done.returncode == 0
        assert "not confirmed yet" in done.stdout
    for _ in range(2):  # its other tries
        with board(tmp_path, "--unhealthy"):
            pass
        assert said(tmp_path)[-1].startswith("started slot B, version 1.1.0+0")
    with board(tmp_path):
        pass
    assert said(tmp_path)[-1] == "started slot A, version 1.0.0+0, confirmed"


def test_the_motor_is_on(tmp_path: Path) -> None:
    with board(tmp_path) as port:
        assert terrapin("flash", signed(tmp_path, "a", "1.0.0"), "--via", "serial", "--port", port).returncode == 0
    before = (tmp_path / "flash.bin").read_bytes()
    with board(tmp_path, "--motor-on") as port:
        done = terrapin("flash", signed(tmp_path, "b", "1.1.0"), "--via", "serial", "--port", port)
    assert done.returncode == 2
    assert "the motor is on; stop it first" in done.stderr
    assert (tmp_path / "flash.bin").read_bytes() == before


def test_can_end_to_end() -> None:
    with on_bus() as (node, wire):
        assert update(wire, [file("a", "1.0.0")], quiet) == Outcome("a", "confirmed")
        assert update(wire, [file("a", "1.1.0"), file("b", "1.1.0")], quiet) == Outcome("b", "confirmed")
        assert node.resets == 3  # one of them into the boot loader
        found = query(wire)
        assert (found.running, found.confirmed, found.version) == ("b", "b", Version(1, 0, 0))
        assert found.keys == (parse(image("a", "1.0.0")).key_hash[:2],)  # type: ignore[index]
        data = image("a", "2.0.0", key=OTHER_KEY)
        with pytest.raises(UserError, match="signed with key"):
            update(wire, [SignedFile("x", parse(data), data)], quiet)


def pem(path: Path, key: Ed25519PrivateKey) -> Path:
    path.touch(0o600)
    path.write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return path


@pytest.mark.parametrize("lost", [False, True], ids=["answered", "the reset's answer is lost"])
def test_a_key_is_revoked_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: bool) -> None:
    """`keys revoke` makes the image, `flash` brings it and says so, and what the old key signed is refused from then
    on, with the way back."""
    old, new = pem(tmp_path / "old.pem", KEY), pem(tmp_path / "new.pem", NEXT_KEY)
    for slot, version in (("a", "1.0.0"), ("b", "1.1.0"), ("a", "1.2.0")):
        (tmp_path / f"{version}.bin").write_bytes(image(slot, version, size=3000))
    done = terrapin("keys", "revoke", old, tmp_path / "1.1.0.bin", "--key", new, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "revokes key" in done.stdout
    revoking = tmp_path / "out" / "1.1.0.bin"
    name = parse(image("a", "1.0.0")).key_hash[:4].hex()  # type: ignore[index]
    assert f"revokes           key {name}" in terrapin("image", "info", revoking).stdout
    assert terrapin("image", "verify", revoking, "--key", new).returncode == 0
    with on_bus(next_key=NEXT_PUBLIC) as (node, wire):
        monkeypatch.setattr("terrapin_tools.flash.wires.open_wire", lambda *_: wire)
        monkeypatch.setattr(wire, "close", lambda: None)

        def flashed(path: Path) -> SimpleNamespace:
            return terrapin("flash", path, "--link", "can:virtual:any")

        assert flashed(tmp_path / "1.0.0.bin").stdout == "slot a: started and confirmed\n"
        resets = node.resets
        node.lose_answer = [0xA5] if lost else []
        done = flashed(revoking)
        assert done.stdout == f"slot b: started and confirmed; key {name} counts no more\n", done.stderr
        assert node.resets == resets + 3  # into the boot loader, the trial, the start that revokes
        before = node.chip.contents()
        done = flashed(tmp_path / "1.2.0.bin")
        assert done.returncode == 2
        assert f"signed with key {name}, which is revoked; `terrapin image sign --key` with the one" in done.stderr
        assert done.stderr.count("\n") == 1
        assert node.chip.contents() == before
        third = pem(tmp_path / "third.pem", OTHER_KEY)
        done = terrapin("keys", "revoke", new, tmp_path / "1.2.0.bin", "--key", third, "--out", tmp_path / "out-2")
        assert done.returncode == 0
        done = flashed(tmp_path / "out-2" / "1.2.0.bin")
        assert "the boot loader knows" in done.stderr
        assert node.chip.contents() == before


def test_the_key_of_the_bench_or_where_it_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "development.pem"
    monkeypatch.setattr("terrapin_hil.paths.development_key", lambda: path)
    with pytest.raises(UserError, match=f"no development key in {path}"):
        development_key()
    pem(path, KEY)
    assert development_key() == path


def test_keys_revoke_refuses_what_is_wrong(tmp_path: Path) -> None:
    old, new = pem(tmp_path / "old.pem", KEY), pem(tmp_path / "new.pem", NEXT_KEY)
    good, bad = tmp_path / "good.bin", tmp_path / "bad.bin"
    good.write_bytes(image("a", "1.0.0"))
    bad.write_bytes(image("a", "1.0.0")[:-1])
    for arguments, expected in [
        ((old, good, "--key", old), "would revoke the key that signs it"),
        ((old, bad, "--key", new), f"{bad}: the TLVs do not end where they say: cut off"),
        ((old, tmp_path / "none.bin", "--key", new), "cannot read"),
        ((good, good, "--key", new), "expected an Ed25519 key in PEM"),
        ((old, good, "--key", tmp_path / "none.pem"), "No such file or directory; `terrapin keys new` makes one\n"),
        ((old, good, "--key", tmp_path), f"{tmp_path}: cannot read the key: Is a directory\n"),
    ]:
        done = terrapin("keys", "revoke", *arguments, "--out", tmp_path / "out")
        assert done.returncode == 2
        assert expected in done.stderr
        assert done.stderr.count("\n") == 1
        assert not (tmp_path / "out").exists()
    assert terrapin("keys", "revoke", old, good, "--key", new, "--out", tmp_path / "out").returncode == 0
    done = terrapin("keys", "revoke", old, good, "--key", new, "--out", tmp_path / "out")
    assert (done.returncode, "exists already" in done.stderr) == (2, True)


def test_a_bus_that_loses_frames() -> None:
    """Each 61st frame is lost: blocks are sent again, and the image is whole."""
    with on_bus(lose=61) as (node, wire):
        assert update(wire, [file("a", "1.0.0", size=1500)], quiet).slot == "a"
        assert node.count > 61 * 3


REQUESTS = [interface().messages[f"UPDATE_{name}"].id for name in ("BEGIN", "END", "RESET")]


@pytest.mark.parametrize("what", ["lose_once", "lose_answer"])
def test_a_request_or_its_answer_is_lost(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """BEGIN, END and RESET, each once: sent again, and done once."""
    for name in ("ERASE", "VERIFY", "BLOCK_ANSWER"):
        monkeypatch.setattr(f"terrapin_tools.flash.update.{name}", 1.0)
    with on_bus() as (node, wire):
        assert update(wire, [file("a", "1.0.0")], quiet) == Outcome("a", "confirmed")
        setattr(node, what, [*REQUESTS, REQUESTS[2]])  # a reset into the boot loader, and one out of it
        assert update(wire, [file("b", "1.1.0")], quiet) == Outcome("b", "confirmed")
        assert getattr(node, what) == []
        assert node.resets == 3  # no more than those that were wanted


def test_a_frame_of_what_stands_before_begin_is_lost() -> None:
    """The end of the image did not come whole: it is sent again with BEGIN, which was not accepted."""
    with on_bus() as (node, wire):
        node.lose_once = [interface().messages["UPDATE_DATA"].id]
        assert update(wire, [file("a", "1.0.0")], quiet) == Outcome("a", "confirmed")
        assert node.lose_once == []


def test_requests_that_nobody_answers_end_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_tools.flash.update.ERASE", 0.05)
    with on_bus() as (node, wire):
        node.mute = {REQUESTS[0]}
        with pytest.raises(UserError, match=r"the controller stopped answering \(begin\)"):
            update(wire, [file("a", "1.0.0")], quiet)


def test_late_answers() -> None:
    """Each answer comes twice, as when a request is sent again while its answer is on its way: the second one is not
    taken for the next block's."""
    with on_bus(lose=61) as (node, wire):
        node.answers = 2
        assert update(wire, [file("a", "1.0.0", size=1500)], quiet).slot == "a"


def written(chip: Chip) -> bytes:
    """All of its flash."""
    return bytes(chip.ffi.buffer(chip.bytes))


@pytest.mark.parametrize("running", [False, True])
def test_two_controllers_with_one_number_are_told_before_anything_is_written(running: bool) -> None:
    """Both in their boot loader, or one in an application; and the same bus with one of them is good."""
    with on_bus() as (node, wire):
        if running:
            assert update(wire, [file("a", "1.0.0")], quiet) == Outcome("a", "confirmed")
        before = written(node.chip)
        with beside(node) as other:
            blank = written(other.chip)
            with pytest.raises(UserError, match="found 2 controllers with this node number, expected one; "):
                update(wire, [file("a", "1.1.0"), file("b", "1.1.0")], quiet)
            assert (written(node.chip), written(other.chip)) == (before, blank)
            assert node.resets + other.resets == int(running)
        assert update(wire, [file("a", "1.1.0"), file("b", "1.1.0")], quiet).state == "confirmed"


def test_a_frame_that_the_bus_repeats_is_no_second_controller() -> None:
    with on_bus() as (node, wire):
        answer, counted = node.answer, [0]

        def twice_once(identifier: int, data: bytes) -> list[Frame]:
            replies = answer(identifier, data)
            counted[0] += identifier == QUERY
            return replies * 2 if identifier == QUERY and counted[0] == 2 else replies

        node.answer = twice_once  # type: ignore[method-assign]
        assert update(wire, [file("a", "1.0.0")], quiet) == Outcome("a", "confirmed")
        assert counted[0] > 2


def test_an_application_whose_motor_is_on_answers_no_query() -> None:
    """As the F405's does: it has no time to read the records then. It still says why."""
    with on_bus() as (node, wire):
        node.mute = {0x0A4}
        node.chip.motor_on = True
        with pytest.raises(UserError, match="the motor is on; stop it first"):
            query(wire, 0.3)


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_tools.flash.update.ANSWER", 0.1)
    wire = CanWire(LinkName("can", "virtual", "nobody"))
    with contextlib.closing(wire), pytest.raises(UserError, match="no controller answers"):
        query(wire, 0.1)


def test_bad_input(tmp_path: Path) -> None:
    good = signed(tmp_path, "a", "1.0.0")
    raw = tmp_path / "raw.bin"
    raw.write_bytes(code("a", 900))
    unsigned = tmp_path / "unsigned.bin"
    data = bytearray(good.read_bytes()[:-104])
    data[-38:-36] = (40).to_bytes(2, "little")
    unsigned.write_bytes(bytes(data))
    cut = tmp_path / "cut.bin"
    cut.write_bytes(good.read_bytes()[:-9])
    flipped = tmp_path / "flipped.bin"
    data = bytearray(good.read_bytes())
    data[1000] ^= 1
    flipped.write_bytes(bytes(data))
    padded = tmp_path / "padded.bin"
    padded.write_bytes(good.read_bytes().ljust(0x20001, b"\xff"))
    for arguments, reason in [
        ([flipped, "--via", "serial", "--port", "x"], "corrupted"),
        ([padded, "--via", "serial", "--port", "x"], "more than the 131072 bytes of a slot"),
        (["/dev/zero", "--via", "serial", "--port", "x"], "not an image"),
        ([good, "--via", "can", "--baud", "9600"], "--baud: --via can has none"),
        ([good, "--via", "serial", "--port", "x", "--bitrate", "125000"], "--bitrate: --via serial has none"),
        ([good, "--via", "can", "--bitrate", "125000"], "socketcan's is set outside"),
        ([good, "--via", "can", "--port", "can:socketcan:can0", "--bitrate", "125000"], "socketcan's is set outside"),
        ([good], "--via: found ''"),
        ([good, "--via", "jtag"], "expected one of swd, stm32, can, serial"),
        (["--via", "serial"], "no IMAGE"),
        ([tmp_path / "none.bin", "--via", "serial", "--port", "x"], "No such file"),
        ([raw, "--via", "serial", "--port", "x"], "not an image (no MCUboot header)"),
        ([unsigned, "--via", "serial", "--port", "x"], "not signed"),
        ([cut, "--via", "serial", "--port", "x"], "cut off"),
        ([good, good, "--via", "serial", "--port", "x"], "expected one image a slot"),
        ([good, "--via", "can", "--port", "can0"], "expected one of socketcan:CHANNEL"),
        ([good, "--via", "can", "--boot-loader", raw], "cannot be written via can"),
        ([good, "--via", "stm32", "--port", "x", "--boot-loader", raw], "no boot loader"),
    ]:
        done = terrapin("flash", *arguments)
        assert done.returncode == 2, arguments
        assert reason in done.stderr, (arguments, done.stderr)
        assert len(done.stderr.splitlines()) == 1
        assert done.stdout == ""
    for arguments, reason in [
        ([good, "--via", "serial", "--port", tmp_path / "no-port"], "cannot open the serial port"),
        ([good, "--via", "can", "--port", "socketcan:no-such-bus"], "cannot open the link"),
        ([good, "--via", "can", "--port", "can:nonsense:1"], "cannot open the link"),
        ([good, "--via", "swd", "--port", "no-such-probe"], "no debug probe no-such-probe"),
    ]:
        done = terrapin("flash", *arguments)
        assert done.returncode == 1, arguments
        assert reason in done.stderr, (arguments, done.stderr)
        assert len(done.stderr.splitlines()) == 1


def test_list() -> None:
    done = terrapin("flash", "--list")
    assert done.returncode == 0, done.stderr
    assert re.search(r"debug probes.*serial ports.*CAN interfaces", done.stdout, re.DOTALL)
    assert done.stderr == ""


# ---- the chip's own boot loader


def boot_file(folder: Path) -> Path:
    path = folder / "boot.bin"
    key = private_key(development_key()).public_key().public_bytes_raw()
    vectors = code("a", 8)[:4] + (BASE + 0x199).to_bytes(4, "little")
    path.write_bytes((vectors + bytes(2001) + key).ljust(5000, b"\0"))
    return path


def test_stm32_end_to_end(tmp_path: Path) -> None:
    emulator = Emulator()
    loader, good = boot_file(tmp_path), signed(tmp_path, "a", "1.0.0")
    with emulator as port:
        done = terrapin("flash", good, "--via", "stm32", "--port", port, "--boot-loader", loader)
    assert (done.returncode, done.stdout) == (0, "boot loader, slot a: written and read back, started\n"), done.stderr
    flash = bytes(emulator.flash)
    assert flash[:5000] == loader.read_bytes()
    assert flash[0x20000:].startswith(good.read_bytes() + b"\xff" * 64)
    assert flash[0x4000:0xC000] == b"\x5a" * 0x8000  # the parameters are left alone
    assert set(flash[0xC000:0x20000]) == {0xFF}  # the records and the other slot are not
    assert set(flash[0x40000:0x60000]) == {0xFF}
    assert emulator.started == 0


def test_stm32_what_goes_wrong(tmp_path: Path) -> None:
    good, loader = signed(tmp_path, "a", "1.0.0"), boot_file(tmp_path)
    for emulator, status, reason in [
        (Emulator(identifier=0x419), 2, "wrong chip: identifier 0x419, expected 0x413 (STM32F405)"),
        (Emulator(protected=True), 1, "protected?"),
        (Emulator(damage=0x08020300), 1, "does not read back"),
    ]:
        with emulator as port:
            done = terrapin("flash", good, "--via", "stm32", "--port", port, "--boot-loader", loader)
        assert (done.returncode, reason in done.stderr) == (status, True), done.stderr
    silent, other = os.openpty()
    try:
        done = terrapin("flash", good, "--via", "stm32", "--port", os.ttyname(other))
    finally:
        os.close(silent)
        os.close(other)
    assert done.returncode == 1
    assert "BOOT0 high" in done.stderr


def test_stm32_writes_nothing_that_would_not_start(tmp_path: Path) -> None:
    """Nobody verifies what is written past the boot loader: its key is looked for in it, in the file or on the chip."""
    good, loader, empty = signed(tmp_path, "a", "1.0.0"), boot_file(tmp_path), tmp_path / "empty.bin"
    foreign, forged = tmp_path / "foreign.bin", tmp_path / "forged.bin"
    foreign.write_bytes(image("a", "1.0.0", key=OTHER_KEY))
    forged.write_bytes(good.read_bytes()[:-1] + bytes([good.read_bytes()[-1] ^ 1]))
    empty.write_bytes(loader.read_bytes()[:8].ljust(5000, b"\0"))
    for arguments, there, reason in [
        ([foreign, "--boot-loader", loader], b"", "which is not in " + str(loader)),
        ([good, "--boot-loader", empty], b"", "which is not in " + str(empty)),
        ([forged, "--boot-loader", loader], b"", "its signature is forged"),
        ([good], b"\xff" * 5000, "the chip has no boot loader"),
        ([good], empty.read_bytes(), "which is not in the chip's boot loader"),
        ([forged], loader.read_bytes(), "its signature is forged"),
    ]:
        emulator = Emulator()
        emulator.flash[: len(there)] = there
        before = bytes(emulator.flash)
        with emulator as port:
            done = terrapin("flash", *arguments, "--via", "stm32", "--port", port)
        assert (done.returncode, reason in done.stderr) == (2, True), (reason, done.stderr)
        assert len(done.stderr.splitlines()) == 1
        assert bytes(emulator.flash) == before
    emulator = Emulator()
    emulator.flash[:5000] = loader.read_bytes()
    with emulator as port:
        done = terrapin("flash", good, "--via", "stm32", "--port", port)
    assert (done.returncode, done.stdout) == (0, "slot a: written and read back, started\n"), done.stderr
    assert emulator.flash[0x20000:].startswith(good.read_bytes() + b"\xff" * 64)


@pytest.mark.skipif(shutil.which("stm32flash") is None, reason="stm32flash is not installed")
def test_stm32flash_agrees_with_the_emulator(tmp_path: Path) -> None:
    """ST's protocol as another program speaks it, against the same emulator."""
    data = tmp_path / "data.bin"
    data.write_bytes(code("a", 4096))
    emulator = Emulator()
    with emulator as port:
        words = ["stm32flash", "-m", "8n1", "-w", str(data), "-v", "-S", "0x08020000", port]
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert bytes(emulator.flash[0x20000:0x21000]) == data.read_bytes()


# ---- a debug probe: pyOCD with a chip of ours behind it


class OptionBytes:
    """The flash controller's registers of them: locked, and changed by the right keys and a start alone."""

    def __init__(self, options: int = 0x0FFF_AAED) -> None:
        self.options, self.shadow = options, options
        self.keys: list[int] = []
        self.busy = 0
        self.stuck = self.endless = self.closed = False

    def read32(self, address: int) -> int:
        if address == 0x4002_3C0C:
            self.busy -= self.busy > 0 and not self.endless
            return (self.busy > 0) << 16
        assert address == 0x4002_3C14
        return self.shadow

    def write32(self, address: int, value: int) -> None:
        if address == 0x4002_3C08:
            self.keys.append(value)
            if self.keys[-2:] == [0x0819_2A3B, 0x4C5D_6E7F] and not self.closed:
                self.shadow &= ~1
            return
        assert address == 0x4002_3C14
        assert not self.busy  # RM0090, 3.6.2: not while the last change is written
        if self.shadow & 1:
            return
        self.shadow = value
        if value & 2:
            self.options, self.busy = self.options if self.stuck else value & ~3, 3
            self.shadow = self.options


class Target:
    """What of pyOCD's target is used, over a flash in memory."""

    def __init__(self, identifier: int) -> None:
        self.identifier = identifier
        self.flash = bytearray(b"\x5a" * 0x10_0000)
        self.resets = 0
        self.options = OptionBytes()

    def read32(self, address: int) -> int:
        if address == 0xE004_2000:
            return 0x1000_0000 | self.identifier
        return self.options.read32(address)

    def write32(self, address: int, value: int) -> None:
        self.options.write32(address, value)

    def read_memory_block8(self, address: int, size: int) -> list[int]:
        return list(self.flash[address - BASE : address - BASE + size])

    def reset(self) -> None:
        self.resets += 1


@pytest.fixture
def probe(monkeypatch: pytest.MonkeyPatch) -> Target:
    pytest.importorskip("pyocd", reason="pyOCD is not installed")
    import pyocd.core.session
    import pyocd.flash.eraser
    import pyocd.flash.loader
    from pyocd.core import helpers

    target = Target(0x413)
    session = SimpleNamespace(open=lambda: None, close=lambda: None, target=target)

    class Eraser:
        Mode = pyocd.flash.eraser.FlashEraser.Mode

        def __init__(self, session: Any, mode: Any) -> None:
            assert mode == self.Mode.SECTOR

        def erase(self, ranges: list[tuple[int, int]]) -> None:
            for start, end in ranges:
                target.flash[start - BASE : end - BASE] = b"\xff" * (end - start)

    class Loader:
        def __init__(self, session: Any, progress: Any, chip_erase: str) -> None:
            self.progress = progress

        def add_data(self, address: int, data: bytes) -> None:
            self.address, self.data = address, data

        def commit(self) -> None:
            at = self.address - BASE
            assert set(target.flash[at : at + len(self.data)]) == {0xFF}
            target.flash[at : at + len(self.data)] = self.data
            self.progress(1.0)

    found = [SimpleNamespace(unique_id="P1", description="probe")]
    monkeypatch.setattr(helpers.ConnectHelper, "get_all_connected_probes", staticmethod(lambda **_: found))
    monkeypatch.setattr(pyocd.core.session, "Session", lambda *_, **__: session)
    monkeypatch.setattr(pyocd.flash.eraser, "FlashEraser", Eraser)
    monkeypatch.setattr(pyocd.flash.loader, "FlashLoader", Loader)
    target.found = found  # type: ignore[attr-defined]
    return target


def by_probe(files: list[SignedFile], loader: bytes | None = None) -> None:
    from terrapin_tools.flash.plan import perform

    programmer = swd.Swd()
    with contextlib.closing(programmer):
        perform(programmer, plan(files, loader), quiet)


def test_swd(probe: Target) -> None:
    good = file("b", "1.0.0")
    by_probe([good], b"loader")
    assert bytes(probe.flash[0x40000:]).startswith(good.data)
    assert probe.flash[:6] == b"loader"
    assert set(probe.flash[0xC000:0x40000]) == {0xFF}
    assert probe.resets == 1
    assert swd.probes() == [("P1", "probe")]
    programmer = swd.Swd()
    with contextlib.closing(programmer):
        assert read(programmer, BASE, 5000, quiet) == bytes(probe.flash[:5000])


def test_swd_what_goes_wrong(probe: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    good = file("b", "1.0.0")
    probe.identifier = 0x419
    with pytest.raises(UserError, match="wrong chip: identifier 0x419"):
        by_probe([good])
    probe.identifier = 0x413
    monkeypatch.setattr(probe, "read_memory_block8", lambda address, size: [0] * size)
    with pytest.raises(UserError, match="does not read back"):
        by_probe([good])
    found: list[Any] = probe.found  # type: ignore[attr-defined]
    found.append(SimpleNamespace(unique_id="P2", description="another"))
    with pytest.raises(UserError, match="several debug probes: P1, P2"):
        by_probe([good])
    found.clear()
    with pytest.raises(UserError, match="no debug probe"):
        by_probe([good])


# ---- keys and images


def test_keys_new(tmp_path: Path) -> None:
    path = tmp_path / "robot.pem"
    done = terrapin("keys", "new", path)
    assert done.returncode == 0, done.stderr
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    before = path.read_bytes()
    assert before.startswith(b"-----BEGIN PRIVATE KEY-----")
    done = terrapin("keys", "new", path)
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert path.read_bytes() == before
    assert before.decode().splitlines()[1] not in done.stdout + done.stderr


def test_the_public_half_of_a_key(tmp_path: Path) -> None:
    key, half = pem(tmp_path / "key.pem", KEY), tmp_path / "key.pub.pem"
    done = terrapin("keys", "public", key, half)
    name = parse(image("a", "1.0.0")).key_hash[:4].hex()  # type: ignore[index]
    assert (done.returncode, done.stdout) == (0, f"{half}: public half {name}, no secret\n")
    assert b"PRIVATE" not in half.read_bytes()
    assert terrapin("keys", "show", half).stdout == f"{half}: signs images, public half {name}\n"
    done = terrapin("keys", "public", key, half)
    assert (done.returncode, "exists already" in done.stderr) == (2, True)
    assert terrapin("keys", "public", tmp_path / "none.pem", tmp_path / "x").returncode == 2
    assert not (tmp_path / "x").exists()


def test_a_key_that_cannot_be_written_leaves_no_file(tmp_path: Path) -> None:
    """Otherwise the next try is told that there is a key, which is never replaced."""
    path = tmp_path / "robot.pem"
    full = OSError(errno.ENOSPC, "No space left on device")
    with mock.patch.object(os, "fchmod", side_effect=full):
        done = terrapin("keys", "new", path)
    assert (done.returncode, "No space left" in done.stderr) == (2, True)
    assert not path.exists()
    assert terrapin("keys", "new", path).returncode == 0


def test_an_image_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    body, out = tmp_path / "code.bin", tmp_path / "image.bin"
    body.write_bytes(code("a", 1000))
    assert terrapin("image", "sign", body, out, "--version", "1.0.0").returncode == 0
    before = out.read_bytes()
    with mock.patch.object(os, "fsync", side_effect=OSError(errno.ENOSPC, "No space left on device")):
        done = terrapin("image", "sign", body, out, "--version", "1.0.1")
    assert (done.returncode, "No space left" in done.stderr) == (2, True)
    assert out.read_bytes() == before
    assert sorted(tmp_path.iterdir()) == [body, out]


def test_image_sign_verify_info(tmp_path: Path) -> None:
    body, out, key = tmp_path / "code.bin", tmp_path / "image.bin", tmp_path / "key.pem"
    body.write_bytes(code("b", 1001))
    assert terrapin("keys", "new", key).returncode == 0
    done = terrapin("image", "sign", body, out, "--version", "1.2.3+4", "--key", key, "--counter", "7")
    assert done.returncode == 0, done.stderr
    assert "slot b, desk, version 1.2.3+4, security counter 7" in done.stdout
    assert terrapin("image", "verify", out, "--key", key).returncode == 0
    checked = subprocess.run(
        [str(Path(sys.executable).with_name("imgtool")), "verify", "-k", str(key), str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stderr
    done = terrapin("image", "info", out)
    assert "version           1.2.3+4" in done.stdout
    assert "signature         Ed25519" in done.stdout
    other = tmp_path / "other.pem"
    assert terrapin("keys", "new", other).returncode == 0
    done = terrapin("image", "verify", out, "--key", other)
    assert (done.returncode, "signed with another key" in done.stderr) == (2, True)
    out.write_bytes(out.read_bytes()[:-1] + b"\x7f")
    done = terrapin("image", "verify", out, "--key", key)
    assert (done.returncode, "forged" in done.stderr) == (2, True)


def test_image_bad_input(tmp_path: Path) -> None:
    body, out = tmp_path / "code.bin", tmp_path / "image.bin"
    body.write_bytes(code("a", 1000))
    alone = tmp_path / "alone.bin"
    alone.write_bytes(bytes(4) + (BASE + 0x101).to_bytes(4, "little") + bytes(100))
    large = tmp_path / "large.bin"
    large.write_bytes(code("a", 0x20000))
    larger = tmp_path / "larger.bin"
    larger.write_bytes(code("a", 0x20004))
    already = signed(tmp_path, "a", "1.0.0")
    arm = tmp_path / "arm.bin"  # not Thumb code
    arm.write_bytes(code("a", 8)[:4] + (SLOTS["a"] + 0x240).to_bytes(4, "little") + bytes(100))
    beyond = tmp_path / "beyond.bin"  # cut off before its reset vector
    beyond.write_bytes(code("a", 0x40))
    for arguments, reason in [
        ([already, out, "--version", "1.0.1"], "an image already"),
        ([arm, out, "--version", "1.0.0"], "no program: it would begin at 0x08020240 with its stack at 0x20020000"),
        ([beyond, out, "--version", "1.0.0"], "no program"),
        ([larger, out, "--version", "1.0.0"], "more than the 131072 bytes"),
        (["/dev/zero", out, "--version", "1.0.0"], "reset vector is in no slot"),
        ([body, out, "--version", "\uff11.0.0"], "expected MAJOR.MINOR.REVISION"),
        ([body, out, "--version", "1.0.0", "--key", "/dev/zero"], "expected an Ed25519 key"),
        ([body, out, "--version", "1.2"], "expected MAJOR.MINOR.REVISION"),
        ([body, out, "--version", "256.0.0"], "at most 255.255.65535"),
        ([body, out, "--version", "1.0.0", "--counter", "-1"], "expected 0 to"),
        ([body, out, "--version", "1.0.0", "--key", tmp_path / "no.pem"], "terrapin keys new"),
        ([body, out, "--version", "1.0.0", "--key", body], "expected an Ed25519 key"),
        ([alone, out, "--version", "1.0.0"], "reset vector is in no slot"),
        ([large, out, "--version", "1.0.0"], "bytes of code, expected"),
    ]:
        done = terrapin("image", "sign", *arguments)
        assert (done.returncode, reason in done.stderr) == (2, True), (arguments, done.stderr)
        assert not out.exists()
    assert terrapin("image", "info", body).returncode == 2


def test_a_serial_port_that_goes_away(tmp_path: Path) -> None:
    with board(tmp_path) as port:
        wire = SerialWire(os.path.realpath(port))
        assert query(wire).running == ""
    with contextlib.closing(wire), pytest.raises(UserError, match=r"no controller answers|disappeared"):
        query(wire, 0.3)


def test_the_slots_of_host_and_loader_are_the_same() -> None:
    text = (paths.ROOT / "firmware" / "boot" / "layout.h").read_text()
    found = {name: int(value, 16) for name, value in re.findall(r"#define TERRAPIN_LAYOUT_(\w+) +(0x\w+?)U", text)}
    assert found["BASE"] == BASE
    assert {"a": BASE + found["SLOT_A"], "b": BASE + found["SLOT_B"]} == SLOTS
    assert KEY.public_key().public_bytes_raw() == PUBLIC


def test_one_node_is_updated_while_the_other_drives(tmp_path: Path) -> None:
    """Node 3 takes an image; node 0 hears every frame of it, drives in lockstep all the while, and takes none: what it
    sends is what it sends alone. The controller's answers come from node 3's identifiers."""
    scenario = replace(load_scenario(find_scenario("steady_sand")), duration=3.0, checks=(), provokes=None)
    alone = run(scenario).output_hash
    simulation, driver = Simulation(scenario), InProcess(node=0)
    driver.start({})
    heard: list[int] = []

    class Shared(SerialWire):
        """The wire to node 3, whose frames node 0 hears too; it drives 25 ticks on for each of them."""

        def _drive(self, frames: Sequence[Frame]) -> None:
            assert driver.hear(frames) == []
            heard.extend(identifier for identifier, _ in frames)
            for _ in range(min(25, len(simulation.records) - simulation.done)):
                simulation.answer(driver.hear(simulation.sense()))

        def send(self, frames: Sequence[Frame]) -> None:
            self._drive([self._node.to_bus(frame) for frame in frames])
            super().send(frames)

        def receive(self, wait: float) -> list[Frame]:
            found = super().receive(wait)
            self._drive([self._node.to_bus(frame) for frame in found])
            return found

    with board(tmp_path, "--node", "3") as port:
        silent = SerialWire(port)
        with pytest.raises(UserError, match="no controller answers"):
            query(silent, 0.3)  # that is node 0
        silent.close()
        wire = Shared(port, node=3)
        assert update(wire, [SignedFile("x", parse(data := signed(tmp_path, "a", "1.0.0").read_bytes()), data)], quiet)
        wire.close()
        done = terrapin("flash", signed(tmp_path, "b", "1.1.0"), "--link", f"serial:{port}", "--node", 3)
        assert (done.returncode, done.stdout) == (0, "slot b: started and confirmed\n"), done.stderr
    while simulation.done < len(simulation.records):
        simulation.answer(driver.hear(simulation.sense()))
    assert output_hash(simulation.records) == alone
    assert all(0x150 <= identifier < 0x158 or 0x260 <= identifier < 0x268 for identifier in heard)
    assert len(heard) > 3000 // 8
    with board(tmp_path) as port:  # the number is in the records, which updates have been added to
        wire = SerialWire(port, node=3)
        assert query(wire).confirmed == "b"
        wire.close()


def test_what_swd_writes_has_a_node_number() -> None:
    """The record is the boot loader's own: it reads the number, starts what was written, and adds to it."""
    chip = Chip(PUBLIC)
    for address, data in plan([file("a", "1.0.0")], None, node=5).write:
        chip.ffi.buffer(chip.bytes)[address - BASE : address - BASE + len(data)] = data
    assert chip.record().node == 5
    assert chip.start() == "a"
    assert chip.confirm()
    assert (chip.record().node, chip.record().confirmed) == (5, 1)
    assert plan([file("a", "1.0.0")], None).write == plan([file("a", "1.0.0")], None, node=5).write[:-1]


def test_what_a_programmer_writes_keeps_a_revocation(probe: Target, tmp_path: Path) -> None:
    """The records go with the images; that a key is revoked stays, and the boot loader holds to it."""
    chip = Chip(PUBLIC, NEXT_PUBLIC)
    chip.put("a", image("a", "1.0.0"))
    assert chip.start() == "a"
    assert chip.confirm()
    for _ in range(40):  # the newest of many records, behind the first read
        assert chip.lib.terrapin_records_append(chip.flash, chip.record())
    data = image("b", "1.1.0", key=NEXT_KEY, revokes=KEY)
    assert send(chip, data, "b") == "ok"
    assert chip.start() == "b"
    assert chip.confirm()
    assert chip.start() == "b"
    loader = struct.pack("<II", 0x2002_0000, BASE + 9) + bytes(100) + PUBLIC + NEXT_PUBLIC
    probe.flash[:0x6_0000] = chip.contents()
    probe.flash[: len(loader)] = loader
    stolen, good = image_file(tmp_path, "old.bin", image("a", "2.0.0")), image_file(tmp_path, "new.bin", data)
    for path, starts in ((stolen, ""), (good, "b")):
        done = terrapin("flash", path, "--via", "swd")
        assert done.returncode == 0, done.stderr
        assert done.stdout.endswith("started; its first key stays revoked: an image of it does not start\n")
        chip.restore(bytes(probe.flash[:0x6_0000]))
        assert chip.start() == starts
        assert chip.record().revoked == 1


def test_swd_with_a_number_that_no_node_has(tmp_path: Path) -> None:
    done = terrapin("flash", signed(tmp_path, "a", "1.0.0"), "--via", "swd", "--node", "9")
    assert done.returncode == 2
    assert "expected a node number from 0 to 7" in done.stderr


def test_link_keys(tmp_path: Path) -> None:
    """Made, shown by a fingerprint, renewed; never replaced, and nothing of the key is printed."""
    first, second = tmp_path / "robot.key", tmp_path / "robot-2.key"
    done = terrapin("keys", "link", first)
    assert done.returncode == 0, done.stderr
    assert first.stat().st_mode & 0o777 == 0o600
    key = LinkKey.read(first)
    assert key.generation == 1
    assert key.fingerprint in done.stdout
    assert key.key.hex() not in done.stdout
    assert terrapin("keys", "show", first).stdout == f"{first}: link key {key.fingerprint}, generation 1\n"
    done = terrapin("keys", "renew", first, second)
    assert done.returncode == 0, done.stderr
    assert LinkKey.read(second).generation == 2
    assert LinkKey.read(second).key != key.key
    empty = tmp_path / "empty.key"
    empty.touch(0o600)
    for arguments, expected in (
        (("link", first), "exists already"),
        (("show", tmp_path / "none.key"), "cannot read the key"),
        (("show", empty), "no link key"),
        (("renew", tmp_path / "none.key", tmp_path / "third.key"), "cannot read the link key"),
    ):
        done = terrapin("keys", *arguments)
        assert done.returncode == 2
        assert expected in done.stderr
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620])
def test_a_key_that_others_may_read_is_refused_with_the_mend(tmp_path: Path, mode: int) -> None:
    """A private key and a link key alike, by every command that reads one; the mend that is told mends. A public key
    is nobody's secret."""
    private, public, link = pem(tmp_path / "robot.pem", KEY), tmp_path / "robot.pub.pem", tmp_path / "robot.key"
    assert terrapin("keys", "public", private, public).returncode == 0
    assert terrapin("keys", "link", link).returncode == 0
    reads = {
        private: [("show", private), ("public", private, tmp_path / "again.pem")],
        link: [("show", link), ("renew", link, tmp_path / "next.key")],
    }
    for path, commands in reads.items():
        path.chmod(mode)
        for arguments in commands:
            done = terrapin("keys", *arguments)
            assert done.returncode == 2
            (line,) = done.stderr.splitlines()
            assert line.endswith(f"(mode {mode:04o}): chmod 600 {path}")
        subprocess.run(shlex.split(line.rpartition(": ")[2]), check=True)
        for arguments in commands:
            assert terrapin("keys", *arguments).returncode == 0
    public.chmod(0o644)
    assert terrapin("keys", "show", public).returncode == 0


def test_a_link_key_stands_beside_the_boot_loader() -> None:
    from terrapin_tools.flash.plan import LINK_KEY, LINK_KEY_SIZE, with_link_key

    block = LinkKey(bytes(range(16)), 7).block()
    assert len(block) == LINK_KEY_SIZE
    assert zlib.crc32(block[:-4]) == int.from_bytes(block[-4:], "little")
    loader = with_link_key(b"\1" * 16_200, block)
    assert loader[LINK_KEY:] == block
    assert loader[16_200:LINK_KEY].strip(b"\xff") == b""
    assert with_link_key(b"\1" * 16_200, b"\xff" * LINK_KEY_SIZE) == b"\1" * 16_200  # there was none


def test_protect(probe: Target, tmp_path: Path) -> None:
    """Sector 0 against writing, read protection of level 1, brown-out at 2.4 V: after asking, and once."""
    public = tmp_path / "robot.pub.pem"
    spki = serialization.PublicFormat.SubjectPublicKeyInfo
    public.write_bytes(KEY.public_key().public_bytes(serialization.Encoding.PEM, spki))
    wanted = 0x0FFE_BBE4  # of 0x0FFFAAED: what was not asked for stays

    def said(*more: str) -> str:
        with contextlib.redirect_stdout(io.StringIO()) as out:
            flash(via="swd", protect=True, key=public, yes="--yes" in more)
        return out.getvalue()

    with pytest.raises(UserError, match="does not know the key"):
        said("--yes")
    probe.flash[0x100:0x120] = PUBLIC
    with pytest.raises(UserError, match="going back erases the whole chip"):
        said()
    assert probe.options.options == 0x0FFF_AAED
    assert "protected; takes effect" in said("--yes")
    assert probe.options.options == wanted
    assert probe.options.shadow & 1  # locked again
    assert "was protected already" in said("--yes")
    probe.options = OptionBytes(0x0FFF_CCED)
    with pytest.raises(UserError, match="level 2, for ever"):
        said("--yes")
    with pytest.raises(UserError, match="--protect: expected --key"):
        flash(via="swd", protect=True)
    with pytest.raises(UserError, match="--protect: expected with --via swd"):
        flash(via="can", protect=True, key=public)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("closed", "the option bytes stay locked until its next reset"),
        ("endless", "the option bytes are not written after 0.05 s"),
        ("stuck", "0x0ffebbe4 was written, 0x0fffaaec stands"),
    ],
)
def test_a_chip_that_does_not_take_its_protection(monkeypatch: pytest.MonkeyPatch, fault: str, told: str) -> None:
    """Nobody is to believe a robot closed that is not."""
    chip = Target(0x413)
    chip.name = "probe"
    setattr(chip.options, fault, True)
    monkeypatch.setattr(protect, "BUSY_LIMIT", 0.05)
    with pytest.raises(UserError, match=f"^probe: .*{told}"):
        protect.protect(chip)


def test_protect_refuses_the_key_of_the_bench() -> None:
    with pytest.raises(UserError, match="the key of the bench"):
        refuse_bench_key("chip", PUBLIC, KEY.public_key(), KEY.public_key())
    with pytest.raises(UserError, match="starts images of the bench, too"):
        refuse_bench_key("chip", PUBLIC + NEXT_PUBLIC, KEY.public_key(), NEXT_KEY.public_key())
    refuse_bench_key("chip", PUBLIC + NEXT_PUBLIC, NEXT_KEY.public_key(), OTHER_KEY.public_key())
