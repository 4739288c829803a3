"""`terrapin flash` over a link to an application with a link key: the real link layer in front of the real update."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import pytest
from kit import KEY, NEXT_KEY, NEXT_PUBLIC, image
from virtual_chip import Node, on_bus

from terrapin_hil.firmware import Firmware
from terrapin_hil.links.seal import LinkKey, clock
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_tools import cli
from terrapin_tools.flash.can_wire import CanWire

LINK_KEY = LinkKey(bytes(range(16)), 2)
UPDATES = range(0xA0, 0xA8)


class KeyedNode(Node):
    """What firmware/ports/stm32f405/port.c does with frames: while an application runs, its link layer holds what needs
    a seal, and hands it to the update when the seal has come. The boot loader has no seal."""

    def __init__(self, channel: str, lose: int, next_key: bytes, key: LinkKey | None = LINK_KEY) -> None:
        self._firmware = Firmware.open()
        ffi = self._firmware.ffi
        self._state, self._inputs = self._firmware.new_state(), ffi.new("terrapin_inputs *")
        self._link, self._reply = ffi.new("terrapin_link *"), ffi.new("terrapin_frame *")
        self._words = ffi.new("uint32_t[4]", list(struct.unpack("<4I", key.key))) if key else ffi.NULL
        self._generation, self._starts = key.generation if key else 0, 0
        super().__init__(channel, lose, next_key)
        self.started()

    def started(self) -> None:
        self._starts += 1
        lib = self._firmware.lib
        lib.terrapin_link_init(self._link, self._state, self._inputs)
        lib.terrapin_link_seal(self._link, self._words, self._generation, self._starts)

    def _application(self, identifier: int, data: bytes) -> list[Frame]:
        chip = self.chip
        frame, replies = chip.ffi.new("terrapin_frame *"), chip.ffi.new("terrapin_frame[2]")
        frame.id, frame.length = identifier, len(data)
        chip.ffi.memmove(frame.data, data, len(data))
        count = chip.lib.terrapin_update_application(chip.update, frame, False, replies)
        return [(r.id, bytes(r.data)[: r.length]) for r in replies[0:count]]

    def answer(self, identifier: int, data: bytes) -> list[Frame]:
        if not self.chip.update.running:
            return self.chip.accept(identifier, data)
        lib, ffi = self._firmware.lib, self._firmware.ffi
        lib.terrapin_seal_at(ffi.addressof(self._link, "seal"), int(clock() * 1000) & 0xFFFFFFFF)
        frame = ffi.new("terrapin_frame *", {"id": identifier, "length": len(data), "data": data})
        if identifier in UPDATES:
            return [] if lib.terrapin_link_holds(self._link, frame) else self._application(identifier, data)
        result = lib.terrapin_accept(self._link, self._state, frame, self._inputs, self._reply)
        taken = self._link.seal.held if result == lib.TERRAPIN_ACCEPT_UPDATE else self._reply
        found = taken.id, bytes(ffi.buffer(taken.data))[: taken.length]
        if result == lib.TERRAPIN_ACCEPT_UPDATE:
            return self._application(*found)
        return [found] if result == lib.TERRAPIN_ACCEPT_REPLY else []


@pytest.fixture(autouse=True)
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in (("START", 0.05), ("CONFIRM", 1.0), ("BLOCK_ANSWER", 0.3), ("ANSWER", 0.3)):
        monkeypatch.setattr(f"terrapin_tools.flash.update.{name}", seconds)


class Open(KeyedNode):
    """An application without a key."""

    def __init__(self, channel: str, lose: int, next_key: bytes) -> None:
        super().__init__(channel, lose, next_key, None)


@pytest.fixture
def keyed(tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A node that runs a confirmed 1.0.0 of slot A, and `flash(FILE, options)` to it."""
    with on_bus(next_key=NEXT_PUBLIC, kind=getattr(request, "param", KeyedNode)) as (node, wire):
        monkeypatch.setattr("terrapin_tools.flash.wires.open_wire", lambda *_: wire)
        monkeypatch.setattr(wire, "close", lambda: None)
        node.chip.put("a", image("a", "1.0.0"))
        assert node.chip.start() == "a"
        assert node.chip.confirm()

        def flash(data: bytes, *options: object) -> SimpleNamespace:
            path = tmp_path / "image.bin"
            path.write_bytes(data)
            out, err = io.StringIO(), io.StringIO()
            words = ["terrapin", "flash", str(path), "--link", "can:virtual:any", *map(str, options)]
            with (
                mock.patch.object(cli.sys, "argv", words),
                redirect_stdout(out),
                redirect_stderr(err),
                pytest.raises(SystemExit) as ended,
            ):
                cli.main()
            return SimpleNamespace(returncode=ended.value.code, stdout=out.getvalue(), stderr=err.getvalue())

        yield SimpleNamespace(node=node, wire=wire, flash=flash)


def key_file(folder: Path, key: LinkKey) -> Path:
    path = folder / "link.key"
    path.touch(0o600)
    path.write_text(key.text())
    return path


def test_with_its_key_an_update_is_taken(keyed: Any, tmp_path: Path) -> None:
    key = key_file(tmp_path, LINK_KEY)
    done = keyed.flash(image("b", "1.1.0", size=3000), "--link-key", key)
    assert (done.returncode, done.stdout) == (0, "slot b: started and confirmed\n"), done.stderr
    assert keyed.node.resets == 2  # into the boot loader, into the image
    assert keyed.wire.session is None  # the boot loader's frames were not sealed
    done = keyed.flash(image("a", "1.2.0", key=NEXT_KEY, revokes=KEY), "--link-key", key)  # another session, by a reset
    assert "slot a: started and confirmed; key " in done.stdout, done.stderr
    assert "counts no more" in done.stdout
    assert keyed.node.chip.record().revoked == 1


def test_without_its_key_nothing_is_reset(keyed: Any) -> None:
    before = keyed.node.chip.contents()
    done = keyed.flash(image("b", "1.1.0"))
    assert done.returncode == 1
    assert "takes no reset without its link key; expected --link-key LINK.key" in done.stderr
    assert done.stderr.count("\n") == 1
    assert (keyed.node.resets, keyed.node.chip.contents()) == (0, before)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (LinkKey(bytes(16), 2), "wrong link key"),
        (LinkKey(LINK_KEY.key, 1), "opens no session for link key"),
    ],
    ids=["another", "an older generation"],
)
def test_a_wrong_key_is_told_with_the_way_back(keyed: Any, tmp_path: Path, wrong: LinkKey, said: str) -> None:
    done = keyed.flash(image("b", "1.1.0"), "--link-key", key_file(tmp_path, wrong))
    assert done.returncode in (1, 2)
    assert said in done.stderr
    assert "--boot-loader FILE.bin --link-key LINK.key" in done.stderr
    assert done.stderr.count("\n") == 1
    assert keyed.node.resets == 0


@pytest.mark.parametrize("keyed", [Open], indirect=True)
def test_a_controller_without_a_key_says_so(keyed: Any, tmp_path: Path) -> None:
    done = keyed.flash(image("b", "1.1.0"), "--link-key", key_file(tmp_path, LINK_KEY))
    assert "the controller has no link key and takes commands of anybody" in done.stderr
    assert keyed.node.resets == 0
    assert keyed.flash(image("b", "1.1.0")).stdout == "slot b: started and confirmed\n"


def test_a_recorded_reset_is_taken_once(keyed: Any, tmp_path: Path) -> None:
    """Whoever recorded a whole update cannot reset the controller with it, before or after its next start."""
    recorded: list[Frame] = []
    send = CanWire.send_plain

    def recording(wire: CanWire, frames: list[Frame]) -> None:
        recorded.extend(frames)
        send(wire, frames)

    with mock.patch.object(CanWire, "send_plain", recording):
        done = keyed.flash(image("b", "1.1.0"), "--link-key", key_file(tmp_path, LINK_KEY))
    assert done.returncode == 0, done.stderr
    assert interface().messages["SEAL"].id in {identifier for identifier, _ in recorded}
    resets = keyed.node.resets
    assert keyed.node.chip.running == 2
    unsealed = [frame for frame in recorded if frame[0] != 0xA2]  # the blocks are for the boot loader
    for frame in unsealed:
        keyed.node.answer(*frame)
        assert not keyed.node.chip.update.reset
    key = int(interface().constants["update_reset_key"])
    keyed.node.answer(*Sender().frame("UPDATE_RESET", {"key": key}))
    assert not keyed.node.chip.update.reset
    assert keyed.node.resets == resets
