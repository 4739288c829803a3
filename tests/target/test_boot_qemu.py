"""The boot loader's ARM image on QEMU: it starts, answers over USART1, and starts an image that is signed, only that.

QEMU has no flash that can be written, so nothing is updated here; what stands in the slot was put there by its loader.
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.links.qemu import MACHINE
from terrapin_hil.links.slcan import slcan_line, slcan_parse
from terrapin_hil.messages import Sender, interface
from terrapin_tools.flash.image import Version, sign
from terrapin_tools.flash.keys import development_key, new_key, private_key
from terrapin_tools.flash.layout import SLOT_SIZE, SLOTS
from tests.waiting import BOUND

LOADER = paths.ROOT / "build" / "cortex-m4" / "terrapin-boot-emulated.elf"
APPLICATION = paths.ROOT / "build" / "cortex-m4" / "terrapin-emulated-slot-a.bin"
RESET_KEY = int(interface().constants["update_reset_key"])
STAYS = 6.0  # s without an application until the boot loader is asked whether it stays

pytestmark = [
    pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed"),
    pytest.mark.skipif(not LOADER.is_file(), reason="no ARM image (make firmware)"),
]


@contextlib.contextmanager
def machine(slot: Path | None = None) -> Iterator[socket.socket]:
    """QEMU with the boot loader in sector 0 and a file's bytes in slot A; its USART1."""
    ours, theirs = socket.socketpair()
    command = ["qemu-system-arm", "-M", MACHINE, "-nodefaults", "-display", "none", "-monitor", "none"]
    command += ["-chardev", f"socket,id=usart1,fd={theirs.fileno()}", "-serial", "chardev:usart1"]
    command += ["-kernel", str(LOADER)]
    if slot is not None:
        command += ["-device", f"loader,file={slot},addr=0x{SLOTS['a']:08x},force-raw=on"]
    with ours, theirs, subprocess.Popen(command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL) as process:
        try:
            yield ours
        finally:
            process.kill()


def frames(line: socket.socket, end: float) -> Iterator[tuple[int, bytes]]:
    """Frames as they come, until the time is over."""
    text = b""
    while time.monotonic() < end:
        if select.select([line], [], [], 0.02)[0]:
            text += line.recv(4096)
        *lines, text = text.replace(b"\a", b"\r").split(b"\r")
        for part in lines:
            if part.startswith(b"t"):
                yield slcan_parse(part)
        yield 0, b""


def query(line: socket.socket, end: float) -> dict[str, int]:
    """Ask until the boot loader answers; its UPDATE_INFO."""
    message = interface().messages["UPDATE_INFO"]
    asked = 0.0
    for identifier, data in frames(line, end):
        if identifier == message.id:
            return message.decode(data)
        if time.monotonic() - asked > 0.03:
            asked = time.monotonic()
            with contextlib.suppress(OSError):
                line.send(b"\rO\r" + slcan_line(Sender().frame("UPDATE_QUERY", {"protocol": 2})))
    pytest.fail("no answer")


def slot_file(folder: Path, key: Path, damaged: bool = False) -> Path:
    """The application for slot A, signed, and erased flash behind it."""
    data = bytearray(sign(APPLICATION.read_bytes(), private_key(key), Version(1, 0, 0), 1, "a"))
    if damaged:
        data[0x300] ^= 1
    path = folder / "slot.bin"
    path.write_bytes(bytes(data).ljust(SLOT_SIZE, b"\xff"))
    return path


def test_it_starts_and_answers() -> None:
    with machine() as line:
        info = query(line, time.monotonic() + BOUND)
    assert (info["protocol"], info["running"], info["confirmed"], info["target"]) == (2, 0, 0, 1)


def test_a_host_that_asks_at_once_keeps_it_from_starting(tmp_path: Path) -> None:
    with machine(slot_file(tmp_path, development_key())) as line:
        assert query(line, time.monotonic() + BOUND)["running"] == 0


def started(line: socket.socket, patience: float) -> bool:
    """Whether the application in slot A speaks; after `patience` seconds a boot loader that stays is asked for."""
    identity = interface().messages["PORT_IDENTITY"]
    begin = time.monotonic()
    asked = 0.0
    for identifier, data in frames(line, begin + BOUND):
        if identifier == identity.id:
            return identity.decode(data)["slot"] == interface().enums["update_slot"]["a"]
        now = time.monotonic()
        if now - asked > 0.5:
            asked = now
            with contextlib.suppress(OSError):
                line.send(b"\rO\r")
        if now - begin > patience:
            return query(line, begin + BOUND)["running"] != 0
    return False


def test_a_signed_image_is_started(tmp_path: Path) -> None:
    with machine(slot_file(tmp_path, development_key())) as line:
        assert started(line, BOUND)


def test_the_application_resets_into_the_boot_loader(tmp_path: Path) -> None:
    """What `terrapin flash` does first: the application says what runs, and comes back as a boot loader that stays."""
    with machine(slot_file(tmp_path, development_key())) as line:
        assert started(line, BOUND)
        assert query(line, time.monotonic() + BOUND)["running"] == interface().enums["update_slot"]["a"]
        line.send(slcan_line(Sender().frame("UPDATE_RESET", {"key": RESET_KEY, "stay": 1})))
        end = time.monotonic() + BOUND
        while query(line, end)["running"] != 0:
            assert time.monotonic() < end


@pytest.mark.parametrize("why", ["another key", "a bit is another"])
def test_no_other_is_started(why: str, tmp_path: Path) -> None:
    key = development_key()
    if why == "another key":
        key = tmp_path / "key.pem"
        new_key(key)
    with machine(slot_file(tmp_path, key, damaged=why != "another key")) as line:
        assert not started(line, STAYS)


def test_its_size() -> None:
    size = os.path.getsize(LOADER.with_suffix(".bin"))
    print(f"boot loader: {size} bytes of 16320")
    assert size <= 16320  # the link key stands behind it
