"""Pieces of `terrapin flash` by themselves: what is asked how often, what is sent again, what is told, and bytes."""

from __future__ import annotations

import contextlib
import logging
import struct
import sys
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from kit import KEY, NEXT_KEY, OTHER_KEY, PUBLIC, code, image

from terrapin_hil.links import LinkName
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.nodes import Node
from terrapin_interface.robot import find_robot, identity_of
from terrapin_tools.errors import UserError
from terrapin_tools.flash import build, listing, plan, protect, swd, update, wires
from terrapin_tools.flash.can_wire import CanWire
from terrapin_tools.flash.image import (
    MADE,
    MARK,
    ImageError,
    Version,
    code_slot,
    intact,
    kind_of,
    made_for,
    parse,
    read_start,
    sign,
    sign_again,
)
from terrapin_tools.flash.keys import key_hash
from terrapin_tools.flash.layout import BASE, RECORDS, SLOT_SIZE, SLOTS
from terrapin_tools.flash.stm32 import Stm32, sectors_of
from terrapin_tools.flash.update import Controller, SignedFile
from terrapin_tools.flash.wire import Wire, heard
from tests.python.robot_files import BOARD, set_fields

THERE = Controller("", "", "", "none", Version(1, 2, 3), 5, (key_hash(KEY.public_key())[:2],))


class Clock:
    """Seconds that pass while somebody sleeps or asks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr("terrapin_tools.flash.update.time.monotonic", lambda: self.now)
        monkeypatch.setattr("terrapin_tools.flash.update.time.sleep", self.pass_)

    def pass_(self, seconds: float) -> None:
        self.now += seconds


def asked_of(monkeypatch: pytest.MonkeyPatch, clock: Clock, answers: Iterable[Controller | None]) -> list[float]:
    """Answers to one question after the other, the last one for ever; when each was asked."""
    times: list[float] = []
    listed = list(answers)

    def ask(wire: Any, sender: Any, seconds: float) -> Controller | None:
        times.append(round(clock.now - 100.0, 6))
        found = listed.pop(0) if len(listed) > 1 else listed[0]
        clock.now += seconds if found is None else 0.0
        return found

    monkeypatch.setattr(update, "_ask", ask)
    return times


def test_what_came_of_a_start_is_asked_for_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not in the first, in which the boot loader would stay; then five times a second until it is confirmed."""
    wire: Any = None
    sender: Any = None

    def started(*answers: Controller | None) -> tuple[str, list[float]]:
        clock = Clock(monkeypatch)
        times = asked_of(monkeypatch, clock, answers)
        return update._started(wire, sender, "a", "file"), times

    trial = replace(THERE, running="a", confirmed="b")
    assert started(None, trial, trial, replace(trial, confirmed="a")) == ("confirmed", [1.0, 1.5, 1.7, 1.9])
    state, times = started(trial)
    assert (state, len(times)) == ("on trial", 50)
    state, times = started(None)
    assert (state, len(times)) == ("silent", 20)
    for running, told in (("b", "slot b runs again"), ("", "the boot loader stays")):
        with pytest.raises(UserError, match=f"it did not start well: {told}"):
            started(replace(THERE, running=running))


class Asked:
    """Requests for blocks with their answers, one after the other; `heard`, whether something came before."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *answers: tuple[str, int] | None) -> None:
        self.answers = list(answers)
        self.blocks: list[tuple[int, int, int, bytes]] = []
        self.told: list[tuple[str, int, int]] = []
        self.waits: list[float] = []
        self.late = 2
        self.name = "wire"
        monkeypatch.setattr(update, "_request", self._request)

    def receive(self, wait: float) -> list[Frame]:
        self.waits.append(wait)
        self.late -= 1
        return [(1, b"")] if self.late >= 0 else []

    def _request(self, wire: Any, frames: Sequence[Frame], request: str, seconds: float, beyond: int = -1) -> Any:
        *data, (identifier, last) = frames
        messages = interface().messages
        assert (request, seconds, identifier) == ("block", update.BLOCK_ANSWER, messages["UPDATE_BLOCK"].id)
        assert {one for one, _ in data} == {messages["UPDATE_DATA"].id}
        values = messages["UPDATE_BLOCK"].decode(last)
        sent = b"".join(one for _, one in data)
        assert zlib.crc32(sent[: values["size"]]) == values["checksum"] & 0xFFFF_FFFF
        self.blocks.append((values["index"], values["size"], beyond, sent))
        return self.answers.pop(0) if self.answers else ("ok", 0)

    def send(self, size: int) -> None:
        self.data = bytes(i % 251 for i in range(size))
        wire: Any = self
        update._send_blocks(wire, Sender(), self.data, lambda *told: self.told.append(told))


def test_blocks_are_sent_in_order_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last one, a part, when nothing of the block before is on its way; an old answer is passed over before it."""
    asked = Asked(monkeypatch)
    asked.send(600)
    assert [block[:3] for block in asked.blocks] == [(0, 256, 0), (1, 256, 1), (2, 88, -1)]
    assert b"".join(block[3] for block in asked.blocks) == asked.data
    assert asked.told == [("writing", 256, 600), ("writing", 512, 600), ("writing", 600, 600)]
    assert asked.waits == [update.LATE] * 3
    odd = Asked(monkeypatch)
    odd.send(513)
    assert odd.blocks[-1][:3] == (2, 1, -1)
    assert odd.blocks[-1][3] == odd.data[512:] + b"\xff" * 7


def test_a_block_that_does_not_arrive_is_sent_eight_times(monkeypatch: pytest.MonkeyPatch) -> None:
    first: list[tuple[str, int] | None] = [None, ("again", 0), ("sequence", 0), *[None] * 4]
    second = [("sequence", 1) if one == ("sequence", 0) else one for one in first]
    asked = Asked(monkeypatch, *first, ("ok", 1), *second)
    asked.send(512)
    assert [block[0] for block in asked.blocks] == [0] * 8 + [1] * 8
    for answer, told in ((None, "no answer"), (("again", 0), "it arrives damaged"), (("sequence", 0), "out of order")):
        asked = Asked(monkeypatch, *[answer] * 8)
        with pytest.raises(UserError, match=f"wire: block 0 was sent 8 times: .*{told}") as raised:
            asked.send(512)
        assert raised.value.status == 1
        assert len(asked.blocks) == 8
    for answer, told in ((("flash", 0), "the flash refused"), (("strange", 0), "refused: strange"),
        (("sequence", 7), "another host is updating it")):  # fmt: skip
        asked = Asked(monkeypatch, answer)
        with pytest.raises(UserError, match=told):
            asked.send(512)
        assert len(asked.blocks) == 1


def file(slot: str, version: str = "1.2.3", counter: int = 5, key: Any = KEY, **more: Any) -> SignedFile:
    data = image(slot, version, counter, key=key)
    return SignedFile(f"{slot}.bin", replace(parse(data), **more), data)


def test_the_file_that_the_controller_would_take_is_chosen() -> None:
    a, b = file("a"), file("b")
    assert update._choose([a, b], THERE) is a
    assert update._choose([a, b], replace(THERE, confirmed="a")) is b
    assert update._choose([b, a], replace(THERE, confirmed="b")) is a
    with pytest.raises(UserError, match="slot a, which is confirmed and stays; expected the image for slot b"):
        update._choose([a], replace(THERE, confirmed="a"))
    with pytest.raises(UserError, match="slot b, which is confirmed and stays; expected the image for slot a"):
        update._choose([b], replace(THERE, confirmed="b"))
    own, other = (key_hash(key.public_key()) for key in (KEY, OTHER_KEY))
    for wrong, there, told in (
        (file("a", signature=None), THERE, "not signed"), (file("a", key_hash=None), THERE, "not signed"),
        (file("a", key=OTHER_KEY), THERE, f"key {other[:4].hex()}, the boot loader knows {own[:2].hex()}..."),
        (file("a", key=OTHER_KEY), replace(THERE, revoked=other[:2]), "which is revoked; .* counts"),
        (file("a", counter=4), THERE, "security counter 4, expected 5 or more"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=told):
            update._choose([wrong], there)
    assert update._choose([file("a", key=OTHER_KEY)], replace(THERE, keys=(own[:2], other[:2]))).name == "a.bin"
    for version, taken in (("1.2.3", True), ("1.2.2", False), ("1.1.9", False), ("0.9.9", False), ("1.3.0", True),
        ("2.0.0", True), ("1.2.3+1", True)):  # fmt: skip
        if taken:
            assert update._choose([file("a", version)], THERE)
        else:
            with pytest.raises(UserError, match=f"version too old: {version}, expected 1.2.3 or newer"):
                update._choose([file("a", version)], THERE)


class Bus:
    """A wire that answers each message by its name; what was sent, and what is still to be heard."""

    def __init__(self, **answers: Sequence[Any]) -> None:
        self.name, self.session = "wire", None
        self.answers = {name: list(each) for name, each in answers.items()}
        self.sent: list[str] = []
        self.waiting: list[list[Frame]] = []
        self.woken = 0

    def wake(self) -> None:
        self.woken += 1

    def send(self, frames: Sequence[Frame]) -> None:
        name = interface().by_id[frames[-1][0]].name
        self.sent.append(name)
        if self.answers.get(name):
            self.waiting.append(self.answers[name].pop(0))

    def receive(self, wait: float) -> list[Frame]:
        return self.waiting.pop(0) if self.waiting else []


def said(name: str, **values: int) -> Frame:
    message = interface().messages[name]
    return message.id, message.encode(values)[0]


def status(request: str, result: str, expected: int = 0) -> Frame:
    enums = interface().enums
    values = {"request": enums["update_request"][request], "result": enums["update_result"][result], "next": expected}
    return said("UPDATE_STATUS", **values)


INFO = {"protocol": 2, "running": 1, "confirmed": 2, "candidate": 1, "phase": 0, "major": 1, "minor": 2, "revision": 3}


def test_a_controller_is_read_from_its_two_answers() -> None:
    floor = said("UPDATE_FLOOR", security_counter=7, key=0x0201, next_key=0x0403)

    def asked(*frames: Frame) -> Controller | None:
        bus: Any = Bus(UPDATE_QUERY=[list(frames)])
        return update._ask(bus, Sender(), 0.01)

    found = asked(said("UPDATE_INFO", **INFO), floor)
    assert found is not None
    assert (found.running, found.confirmed, found.candidate) == ("a", "b", "a")
    assert (found.version, found.security_counter, found.protocol) == (Version(1, 2, 3), 7, 2)
    assert (found.keys, found.revoked) == ((b"\1\2", b"\3\4"), b"")
    for revoked, keys, gone in ((1, (b"\3\4",), b"\1\2"), (2, (b"\1\2",), b"\3\4")):
        found = asked(said("UPDATE_INFO", **INFO, revoked=revoked), floor)
        assert found is not None
        assert (found.keys, found.revoked) == (keys, gone)
    same = asked(said("UPDATE_INFO", **INFO), said("UPDATE_FLOOR", key=0x0201, next_key=0x0201))
    assert same is not None
    assert same.keys == (b"\1\2",)
    number, data = said("UPDATE_INFO", **INFO)
    assert asked(floor) is None  # what it says of itself comes first
    assert asked((number, data[:-1]), floor) is None
    assert asked((number, data), (floor[0], floor[1][:-1])) is None
    old = asked(said("UPDATE_INFO", **{**INFO, "protocol": 1}), floor)
    assert old is not None
    assert old.protocol == 1
    for protocol in (0, 3):
        with pytest.raises(UserError, match=f"speaks update protocol {protocol}, expected 1 to 2"):
            asked(said("UPDATE_INFO", **{**INFO, "protocol": protocol}), floor)


def test_an_answer_to_an_earlier_request_is_passed_over() -> None:
    def asked(*frames: Frame, beyond: int = -1) -> tuple[str, int] | None:
        bus: Any = Bus(UPDATE_BLOCK=[list(frames)])
        return update._request(bus, [Sender().frame("UPDATE_BLOCK", {})], "block", 0.01, beyond)

    assert asked(status("block", "ok", 3)) == ("ok", 3)
    assert asked(status("block", "ok", 3), beyond=2) == ("ok", 3)
    assert asked(status("block", "ok", 3), beyond=3) is None
    assert asked(status("block", "ok", 3), status("block", "ok", 4), beyond=3) == ("ok", 4)
    assert asked(status("block", "sequence", 3), beyond=3) == ("sequence", 3)
    assert asked(status("begin", "ok", 3)) is None
    number, data = status("block", "ok", 3)
    assert asked((number, data[:-1])) is None
    assert asked((number + 1, data)) is None
    assert asked() is None


def test_a_request_is_put_three_times_and_what_is_refused_is_told() -> None:
    def demanded(*answers: list[Frame]) -> Any:
        bus: Any = Bus(UPDATE_BEGIN=answers)
        update._demand(bus, Sender(), "begin", {}, 0.01, "file")
        return bus

    for silent in (0, 1, 2):
        bus = demanded(*[[]] * silent, [status("begin", "ok")])
        assert (len(bus.sent), bus.woken) == (silent + 1, silent)
    assert len(demanded([status("begin", "again")], [status("begin", "ok")]).sent) == 2
    with pytest.raises(UserError, match=r"stopped answering \(begin\)") as raised:
        demanded([], [], [])
    assert raised.value.status == 1
    with pytest.raises(UserError, match="file: refused: the image does not fit the slot"):
        demanded([status("begin", "too_large")])


def test_two_of_three_queries_say_whether_a_controller_is_alone() -> None:
    one = said("UPDATE_INFO", **INFO)

    def alone(*counts: int) -> int:
        bus: Any = Bus(UPDATE_QUERY=[[one, status("block", "ok")] * count for count in counts])
        bus.waiting = [[one, one]]  # to the query before
        update._require_alone(bus, Sender())
        return len(bus.sent)

    assert [alone(*counts) for counts in ((1, 1), (1, 2, 1), (2, 1, 1), (0, 0), (2, 0, 0))] == [2, 3, 3, 2, 3]
    for counts in ((2, 2), (1, 2, 3), (3, 1, 2)):
        with pytest.raises(UserError, match=f"found {max(counts)} controllers"):
            alone(*counts)


def test_a_reset_that_is_not_answered_is_asked_for_before_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another reset of an image on trial would end its trial."""
    there: list[Controller | None] = []
    takes = True

    def reset(answers: list[list[Frame]], *found: Controller | None) -> int:
        there[:] = found
        bus: Any = Bus(UPDATE_RESET=answers)
        update._reset(bus, Sender(), {}, "file", lambda one: one.running == "a")
        return len(bus.sent)

    monkeypatch.setattr(update, "_ask", lambda *_: there.pop(0))
    monkeypatch.setattr(update, "takes_changes", lambda wire: takes)
    good, running, stays = [status("reset", "ok")], replace(THERE, running="a"), THERE
    assert reset([good]) == 1
    assert reset([[]], running) == 1
    assert reset([[], [], good], None, stays) == 3
    with pytest.raises(UserError, match=r"stopped answering \(reset\)"):
        reset([[], [], []], None, None, stays)
    takes = False
    with pytest.raises(UserError, match="takes no reset without its link key"):
        reset([[], [], []], None, None, None)


def test_a_key_that_an_image_revokes_is_gone_after_another_start(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    resets: list[dict[str, int]] = []
    monkeypatch.setattr(update, "_reset_application", lambda wire, sender, values, *_: resets.append(values))
    gone = replace(THERE, revoked=b"\1\2")

    def revoked(revokes: bytes, *found: Controller | None) -> tuple[bool, int]:
        resets.clear()
        asked_of(monkeypatch, clock, found)
        of: Any = SimpleNamespace(name="file", image=SimpleNamespace(revokes=revokes))
        none: Any = None
        return update._revoked(none, none, of, None), len(resets)

    assert revoked(b"") == (False, 0)
    assert revoked(b"\1\2\3\4", gone) == (True, 0)
    assert revoked(b"\1\2\3\4", THERE, gone) == (True, 1)
    assert revoked(b"\1\2\3\4", THERE) == (False, 1)
    assert revoked(b"\1\2\3\4", None) == (False, 0)


def test_the_boot_loader_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    monkeypatch.setattr(update, "_reset_application", lambda *_: None)
    wire: Any = SimpleNamespace(name="wire")
    running = replace(THERE, running="a")
    asked_of(monkeypatch, clock, [running, THERE])
    assert update._enter_loader(wire, wire, "file", None) is THERE
    asked_of(monkeypatch, clock, [None])
    with pytest.raises(UserError, match="did not come back in its boot loader"):
        update._enter_loader(wire, wire, "file", None)


@pytest.mark.parametrize(
    ("text", "version"),
    [("1.2.3", (1, 2, 3, 0)), ("0.0.0+7", (0, 0, 0, 7)), ("255.255.65535", (255, 255, 65535, 0)), ("256.0.0", None),
     ("0.256.0", None), ("0.0.65536", None), ("0.0.0+4294967295", (0, 0, 0, 2**32 - 1)), ("0.0.0+4294967296", None),
     ("1.2", None), ("1.2.3.4", None), ("1.2.-3", None), ("", None), ("1.2.\u0663", None)],
)  # fmt: skip
def test_a_version_is_three_numbers_and_perhaps_a_build(text: str, version: tuple[int, ...] | None) -> None:
    if version is None:
        with pytest.raises(ValueError, match=r"at most 255\.255\.65535"):
            Version.of(text)
    else:
        assert Version.of(text) == Version(*version)
        assert str(Version.of(text)) == text


def test_code_says_its_kind_and_what_it_is_made_for() -> None:
    """Wherever its mark stands; what is cut off says nothing."""
    assert [kind_of(code_) for code_ in (MARK + b"\1\0\0\0", b"x" + MARK + b"\1\0\0\0z", MARK + b"\0\0\0\0",
        MARK + b"\1\0\0", MARK + b"\1\0\0\1", b"")] == ["production"] * 2 + ["desk"] * 4  # fmt: skip
    words = struct.pack("<II", 0x5 << 24 | 0xABCDEF, 9)
    assert made_for(MADE + words) == made_for(b"xyz" + MADE + words + b"more") == (0xABCDEF, 5, 9)
    assert made_for(MADE + words[:-1]) == made_for(words) == made_for(b"") == (0, 0, 0)


def test_an_image_says_what_it_was_signed_with() -> None:
    body = code("b", 100) + MADE + struct.pack("<II", 0x2 << 24 | 7, 3)
    data = sign(body, KEY, Version(1, 2, 3, 4), 6, "b", 0xABCD, NEXT_KEY.public_key(), 0x123456)
    found = parse(data)
    assert (found.robot, found.board, found.interface, found.unit, found.replaces) == (7, 2, 3, 0xABCD, 0x123456)
    assert (found.kind, found.code_size, found.size) == ("desk", len(body), len(data))
    assert found.revokes == key_hash(NEXT_KEY.public_key())[:4]
    plain = parse(image("a", "1.0.0"))
    assert (plain.robot, plain.board, plain.interface, plain.unit, plain.replaces, plain.revokes) == (
        0, 0, 0, None, 0, b""
    )  # fmt: skip
    again = parse(sign_again(data, OTHER_KEY, KEY.public_key()))
    assert replace(again, revokes=found.revokes, hashed=b"", digest=b"", key_hash=b"", signature=b"") == replace(
        found, hashed=b"", digest=b"", key_hash=b"", signature=b""
    )
    assert again.revokes == key_hash(KEY.public_key())[:4]
    assert again.key_hash == key_hash(OTHER_KEY.public_key())
    production = parse(sign(MARK + b"\1\0\0\0", KEY, Version(1, 0, 0), 1, "a"))
    assert production.kind == "production"
    with pytest.raises(ImageError, match="would revoke the key that signs it"):
        sign(body, KEY, Version(1, 0, 0), 1, "b", revokes=KEY.public_key())
    with pytest.raises(ImageError, match="does not say which robot it is made for"):
        sign(b"code", KEY, Version(1, 0, 0), 1, "b", replaces=1)
    with pytest.raises(ImageError, match="0 bytes of code, expected 1 to"):
        sign(b"", KEY, Version(1, 0, 0), 1, "b")


def test_code_is_linked_for_a_slot_or_refused() -> None:
    def vectors(stack: int, reset: int, size: int = 64) -> str | None:
        return code_slot(struct.pack("<II", stack, reset).ljust(size, b"\0"))

    a, top = SLOTS["a"] + 0x200, 0x2002_0000
    assert vectors(top, a + 1) == vectors(top, a + 63) == vectors(0x2000_0000, a + 9) == "a"
    assert vectors(top, SLOTS["b"] + 0x201) == "b"
    for stack, reset in ((top, a), (top, a - 1), (top, a + 65), (top + 1, a + 1), (0x1FFF_FFFF, a + 1)):
        with pytest.raises(ImageError, match=f"it would begin at 0x{reset:08x} with its stack at 0x{stack:08x}"):
            vectors(stack, reset)
    assert vectors(top, BASE + 1) is None
    assert vectors(top, SLOTS["b"] + SLOT_SIZE + 1) is None
    assert code_slot(struct.pack("<II", top, a + 1)[:7]) is None
    with pytest.raises(ImageError, match="an image already"):
        code_slot(image("a", "1.0.0"))


@pytest.mark.parametrize(
    ("offset", "data", "told"),
    [(0, b"\0", "no MCUboot header"), (8, b"\0\1", "header of 256 bytes, expected 512"), (4, b"\4", "not fixed to a"),
     (16, b"\0\0", "not fixed to a slot"), (10, b"\x0d", "no security counter"), (600 + 0x200, b"\x07", "no protected"),
     (602 + 0x200, b"\x0d", "do not end"), (604 + 0x200, b"\x51", "no security counter"),
     (612 + 0x200, b"\0", "no TLVs"), (616 + 0x200, b"\x11", "no SHA-256")],
)  # fmt: skip
def test_what_is_wrong_with_an_image_is_told(offset: int, data: bytes, told: str) -> None:
    good = image("a", "1.0.0", size=600)
    with pytest.raises(ImageError, match=told):
        parse(good[:offset] + data + good[offset + len(data) :])


def test_an_image_ends_where_it_says() -> None:
    good = image("a", "1.0.0")
    for end in (b"", b"\xff", b"\xff" * 900):
        found = parse(good + end)
        assert found.size == len(good)
        intact(found)
    with pytest.raises(ImageError, match="3 bytes follow the image"):
        parse(good + b"\xff\0\xff")
    assert parse(good.ljust(SLOT_SIZE, b"\xff")).size == len(good)
    with pytest.raises(ImageError, match="more than the 131072 bytes of a slot"):
        parse(good.ljust(SLOT_SIZE + 1, b"\xff"))
    for size in range(len(good)):
        with pytest.raises(ImageError):
            parse(good[:size])
    foreign = bytearray(good)
    foreign[-64 - 4 - 32 - 4] = 2  # of another kind: the hash of the key
    assert parse(bytes(foreign)).signature is None
    assert parse(bytes(foreign)).key_hash is None


def test_a_slots_bytes_are_read_and_one_more(tmp_path: Path) -> None:
    path = tmp_path / "code.bin"
    for size, read in (
        (10, 10),
        (SLOT_SIZE, SLOT_SIZE),
        (SLOT_SIZE + 1, SLOT_SIZE + 1),
        (SLOT_SIZE + 9, SLOT_SIZE + 1),
    ):
        path.write_bytes(bytes(size))
        assert len(read_start(path)) == read
    with pytest.raises(UserError, match="cannot read: Is a directory"):
        read_start(tmp_path)


def test_a_boot_loader_begins_with_vectors_into_itself(tmp_path: Path) -> None:
    path = tmp_path / "boot.bin"

    def loader(stack: int, reset: int, size: int) -> bytes:
        path.write_bytes(struct.pack("<II", stack, reset).ljust(size, b"\1")[:size])
        return plan.boot_loader(path)

    assert len(loader(0x2002_0000, BASE, 100)) == 100
    assert len(loader(0x2000_0000, BASE + 0x3FBF, 0x3FC0)) == 0x3FC0
    low = 0x2000_0000
    for stack, reset, size in ((0x2002_0001, BASE + 9, 100), (low, BASE - 1, 100), (low, BASE + 100, 100),
        (low, BASE, 0x3FC1), (low, BASE, 7)):  # fmt: skip
        with pytest.raises(UserError, match="no boot loader: expected at most 16320 bytes"):
            loader(stack, reset, size)
    assert plan.begins(struct.pack("<II", 0x2000_0000, BASE + 1))
    path.unlink()
    with pytest.raises(UserError, match="cannot read: No such file or directory; run `make firmware`"):
        plan.boot_loader(path)


class Flash:
    """A flash in memory, read by pieces."""

    name, chunk = "probe", 512

    def __init__(self, wrong: int = -1) -> None:
        self.bytes = bytearray(b"\xff" * 0x10_0000)
        self.done: list[Any] = []
        self.wrong = wrong

    def read(self, address: int, size: int) -> bytes:
        self.done.append(("read", address, size))
        return bytes(self.bytes[address - BASE : address - BASE + size])

    def erase(self, regions: Sequence[tuple[int, int]], told: Any) -> None:
        self.done.append(("erase", *regions))

    def write(self, address: int, data: bytes, told: Any) -> None:
        self.bytes[address - BASE : address - BASE + len(data)] = data
        if self.wrong >= 0:
            self.bytes[self.wrong - BASE] ^= 1

    def start(self) -> None:
        self.done.append("start")


def quiet(what: str, done: int, total: int) -> None:
    pass


def test_what_is_written_is_read_back_and_then_started() -> None:
    told: list[tuple[str, int, int]] = []
    flash = Flash()
    plan.perform(flash, plan.Plan(((BASE, 16),), ((BASE + 16, b"x" * 700),)), lambda *one: told.append(one))
    assert flash.done == [("erase", (BASE, 16)), ("read", BASE + 16, 512), ("read", BASE + 528, 188), "start"]
    assert told == [("verifying", 512, 700), ("verifying", 700, 700)]
    bad = Flash(wrong=BASE + 0x321)
    with pytest.raises(UserError, match="what was written at 0x08000321 does not read back") as raised:
        plan.perform(bad, plan.Plan((), ((BASE + 16, b"x" * 900),)), quiet)
    assert raised.value.status == 1
    assert "start" not in bad.done


def record(sequence: int, place: int, node: int = 0) -> bytes:
    words = struct.pack("<IIIIQI", plan.RECORD_MAGIC, sequence, 0, 0, 0, node | place << 4 | 0xABCDEF << 8)
    return words + struct.pack("<I", zlib.crc32(words))


def test_the_newest_record_says_which_key_is_revoked() -> None:
    flash = Flash()
    first, second = (address - BASE for address, _ in RECORDS)
    assert plan.revoked_place(flash, quiet) == 0
    assert len(flash.done) == 4  # the first kB of both sectors: behind what is erased nothing stands
    flash.bytes[first : first + 96] = record(1, 2) + record(3, 1, node=15) + record(2, 2)
    assert plan.revoked_place(flash, quiet) == 1
    flash.bytes[second : second + 32] = record(9, 2)
    assert plan.revoked_place(flash, quiet) == 2
    flash.bytes[second + 31] ^= 1  # a checksum that does not fit
    assert plan.revoked_place(flash, quiet) == 1
    flash.bytes[first : first + 2048] = b"".join(record(i, 0) for i in range(10, 73)) + record(99, 2)
    assert plan.revoked_place(flash, quiet) == 2
    assert plan.first_record(5, 0xABCDEF, 2) == record(1, 2, node=5)
    words = struct.pack("<II", 1, 100) + record(100, 2)[8:28]
    flash.bytes[first : first + 32] = words + struct.pack("<I", zlib.crc32(words))  # of something else
    flash.bytes[first + 32 : first + 0x4000] = b"\xff" * 0x3FE0
    assert plan.revoked_place(flash, quiet) == 0


def test_what_is_planned_is_whole_sectors_and_the_image_alone() -> None:
    good = file("b")
    found = plan.plan([replace(good, data=good.data + b"more")], None)
    assert found.write == ((SLOTS["b"], good.data),)
    assert found.erase == ((BASE + 0xC000, 0x4000), (BASE + 0x1_0000, 0x1_0000), (SLOTS["a"], SLOT_SIZE),
        (SLOTS["b"], SLOT_SIZE))  # fmt: skip
    whole = plan.plan([good], b"loader")
    assert whole.erase == ((BASE, 0x4000), *found.erase)
    assert whole.write == ((BASE, b"loader"), *found.write)
    for given in ({"node": 3}, {"revoked": 1}):
        added = plan.plan([good], None, **given).write[-1]
        assert added == (BASE + 0xC000, plan.first_record(given.get("node", 0), 0, given.get("revoked", 0)))
    robot = plan.plan([file("b", robot=7)], None).write[-1]
    assert robot == (BASE + 0xC000, plan.first_record(0, 7))


def test_no_image_is_written_that_would_not_start() -> None:
    plan.check_starts(b"\0" * 99 + PUBLIC, "boot.bin", [file("a")])
    own = key_hash(OTHER_KEY.public_key())[:4].hex()
    with pytest.raises(UserError, match=rf"a\.bin: signed with key {own}, which is not in boot\.bin"):
        plan.check_starts(PUBLIC, "boot.bin", [file("a", key=OTHER_KEY)])
    with pytest.raises(UserError, match=r"b\.bin: its signature is forged"):
        plan.check_starts(PUBLIC, "boot.bin", [file("a"), file("b", signature=bytes(64))])


class Session:
    """Of pyOCD: what was opened and closed."""

    def __init__(self, identity: int | None, closes: bool = True) -> None:
        self.done: list[str] = []
        self.target = SimpleNamespace(read32=lambda address: identity)
        self.fails, self.closes = identity is None, closes

    def open(self) -> None:
        self.done.append("open")
        if self.fails:
            raise RuntimeError("no power")

    def close(self) -> None:
        self.done.append("close")
        if not self.closes:
            raise RuntimeError("unplugged")


def opened(session: Session) -> swd.Swd:
    probe = swd.Swd.__new__(swd.Swd)
    probe._open(session, "P1")
    return probe


@pytest.mark.parametrize("closes", [True, False])
def test_a_probe_that_is_of_no_use_is_given_back(closes: bool) -> None:
    """Whoever plugs it into the right robot then can open it."""
    for identity, told, status_ in ((None, "P1: no chip answers behind the probe: no power", 1),
        (0x1000_0419, "P1: wrong chip: identifier 0x419, expected 0x413", 2)):  # fmt: skip
        session = Session(identity, closes)
        with pytest.raises(UserError, match=told) as raised:
            opened(session)
        assert session.done == ["open", "close"]
        assert raised.value.status == status_
    session = Session(0x2000_0413, closes)
    opened(session).close()
    assert session.done == ["open", "close"]


def test_what_a_probe_fails_at_is_one_line() -> None:
    def fails(*_: object) -> None:
        raise RuntimeError("no acknowledgement")

    target = SimpleNamespace(read32=fails, write32=fails, read_memory_block8=fails, reset=fails)
    probe = swd.Swd.__new__(swd.Swd)
    probe.name, probe._session = "P1", SimpleNamespace(target=target)
    tries: dict[str, Callable[[], object]] = {
        "read": lambda: probe.read(BASE, 4), "read 0x00000010": lambda: probe.read32(16),
        "write 0x00000010": lambda: probe.write32(16, 1), "reset the chip": probe.start,
    }  # fmt: skip
    for what, call in tries.items():
        with pytest.raises(UserError, match=f"^P1: cannot {what}: no acknowledgement$") as raised:
            call()
        assert raised.value.status == 1


def test_drivers_that_are_not_installed_are_not_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """A serial port that could be an SLCAN is listed as a serial port."""
    found = [{"interface": "socketcan", "channel": "can0"}, {"interface": "slcan", "channel": "/dev/tty1"},
        {"interface": "pcan", "channel": "PCAN_USBBUS1", "device_name": "PCAN-USB"}]  # fmt: skip
    noise = logging.getLogger("can.interfaces")

    def detect(kinds: Sequence[str]) -> list[dict[str, str]]:
        assert not noise.isEnabledFor(logging.ERROR)
        assert "socketcan" in kinds
        return found

    before = logging.getLogger("can").level
    logging.getLogger("can").setLevel(logging.NOTSET)
    monkeypatch.setitem(sys.modules, "can", SimpleNamespace(detect_available_configs=detect))
    try:
        assert listing._can_interfaces() == [("socketcan:can0", "socketcan"), ("can:pcan:PCAN_USBBUS1", "PCAN-USB")]
    finally:
        logging.getLogger("can").setLevel(before)


def test_serial_ports_are_those_with_hardware(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        def __init__(self, device: str, hwid: str) -> None:
            self.device, self.description, self.hwid = device, f"is {device}", hwid

        def __lt__(self, other: Port) -> bool:
            return self.device < other.device

    ports = [Port("b", "USB"), Port("c", "n/a"), Port("a", "USB")]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
    monkeypatch.setattr(listing, "_can_interfaces", list)
    assert listing.serial_ports() == [("a", "is a"), ("b", "is b")]
    monkeypatch.setattr(swd, "probes", list)
    lines = listing.listing().splitlines()
    assert lines == [
        "debug probes (--via swd):", "  none plugged in", "serial ports (--link serial:..., --via stm32):",
        "  a  is a", "  b  is b", "CAN interfaces (--link):", "  none",
    ]  # fmt: skip

    def refused() -> list[tuple[str, str]]:
        raise UserError("pyOCD is not installed")

    monkeypatch.setattr(swd, "probes", refused)
    assert listing.listing().splitlines()[1] == "  pyOCD is not installed"


class Port:
    """A serial port that gives what is listed, and keeps what was written."""

    def __init__(self, *given: bytes) -> None:
        self.given, self.written = bytearray(b"".join(given)), b""
        self.reads: list[int] = []
        self.broken: OSError | None = None
        self.reset = 0

    @property
    def in_waiting(self) -> int:
        return len(self.given)

    def read(self, count: int) -> bytes:
        if self.broken:
            raise self.broken
        self.reads.append(count)
        taken = bytes(self.given[:count])
        del self.given[:count]
        return taken

    def write(self, data: bytes) -> None:
        if self.broken:
            raise self.broken
        self.written += data

    def reset_input_buffer(self) -> None:
        self.reset += 1

    def close(self) -> None:
        self.written += b"closed"


def test_sectors_are_those_that_a_region_touches() -> None:
    assert sectors_of(BASE, 1) == sectors_of(BASE, 0x4000) == [0]
    assert sectors_of(BASE, 0x4001) == sectors_of(BASE + 0x3FFF, 2) == [0, 1]
    assert sectors_of(BASE + 0x4000, 0x4000) == [1]
    assert sectors_of(BASE + 0x1_0000, 0x1_0000) == [4]
    assert sectors_of(BASE + 0x2_0000, 0x2_0000) == [5]
    assert sectors_of(BASE, 0x10_0000) == list(range(12))
    assert sectors_of(BASE + 0x10_0000, 1) == sectors_of(BASE - 1, 1) == []


def stm32(monkeypatch: pytest.MonkeyPatch, *given: bytes) -> tuple[Stm32, Port]:
    port = Port(*given)
    monkeypatch.setattr("terrapin_tools.flash.stm32.open_serial", lambda *_, **__: port)
    return Stm32("port"), port


ACK, NACK = b"\x79", b"\x1f"


def test_the_chips_boot_loader_is_written_in_pieces_with_their_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    chip, port = stm32(monkeypatch, ACK * 6)
    told: list[tuple[str, int, int]] = []
    chip.write(BASE, b"\x11" * 259, lambda *one: told.append(one))
    second = bytes([3]) + b"\x11" * 3 + b"\xff"
    expected = bytes([0x31, 0xCE, 8, 0, 0, 0, 8]) + b"\xff" + b"\x11" * 256 + b"\xff"
    expected += bytes([0x31, 0xCE, 8, 0, 1, 0, 9]) + second + bytes([3 ^ 0x11 ^ 0xFF])
    assert port.written == expected
    assert told == [("writing", 256, 260), ("writing", 260, 260)]
    chip.close()
    assert port.written == expected + b"closed"
    chip, port = stm32(monkeypatch, ACK * 4)
    told.clear()
    chip.erase([(BASE, 0x8000)], lambda *one: told.append(one))
    assert port.written == b"".join(bytes([0x44, 0xBB, 0, 0, 0, n, n]) for n in (0, 1))
    assert told == [("erasing", 0, 2), ("erasing", 1, 2)]
    chip, port = stm32(monkeypatch, ACK * 3, b"data")
    assert chip.read(BASE + 4, 4) == b"data"
    assert port.written == bytes([0x11, 0xEE, 8, 0, 0, 4, 12, 3, 0xFC])
    chip, port = stm32(monkeypatch, ACK * 2)
    chip.start()
    assert port.written == bytes([0x21, 0xDE, 8, 0, 0, 0, 8])


def test_the_chips_boot_loader_is_found_or_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_tools.flash.stm32.ANSWER", 0.01)
    for first in (ACK, NACK):  # not acknowledged: it was in step before
        chip, port = stm32(monkeypatch, first, ACK, b"\1\x04\x13", ACK)
        chip.connect()
        assert (port.written, port.reset) == (b"\x7f\x02\xfd", 1)
    chip, port = stm32(monkeypatch, b"\x00\x55", ACK, ACK, b"\1\x04\x13", ACK)
    chip.connect()
    assert port.written == b"\x7f\x7f\x7f\x02\xfd"
    for given, told, status_ in (
        ([b"\0" * 3], "no STM32 boot loader answers", 1), ([ACK, ACK, b"\1\x04\x19", ACK], "wrong chip: .*0x419", 2),
        ([ACK, NACK], "refuses to say its identifier", 1), ([ACK, b"\x55"], "acknowledgement of to .*found 0x55", 1),
    ):  # fmt: skip
        chip, port = stm32(monkeypatch, *given)
        with pytest.raises(UserError, match=told) as raised:
            chip.connect()
        assert raised.value.status == status_
    chip, port = stm32(monkeypatch)
    with pytest.raises(UserError, match="the chip stopped answering"):
        chip._read(1, 0.01)
    port.broken = OSError(5, "Input/output error")
    for call in (lambda: chip._read(1, 0.5), lambda: chip._write(b"x")):
        with pytest.raises(UserError, match=r"the serial port disappeared \(Input/output error\)"):
            call()


def test_frames_of_a_serial_wire_are_cut_at_their_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever a read ends; what is no SLCAN, and what is not for the update, is passed over."""
    port = Port()
    monkeypatch.setattr(wires, "open_serial", lambda *_, **__: port)
    wire = wires.SerialWire("port")
    assert port.written == b"\rO\r"
    port.given = bytearray(b"z\r\at1A21AA\rt1A")
    assert wire.receive(0.2) == [(0x1A2, b"\xaa")]
    port.given = bytearray(b"31BB\rt7FF0\rt1A3xx\r")
    assert wire.receive(0.2) == [(0x1A3, b"\xbb")]
    assert wire.receive(0.0) == []
    port.given = bytearray(b"x" * 900)
    assert wire.receive(0.01) == []
    assert len(wire._rest) == 64
    port.written = b""
    wire.send([(0x0A4, b"\2"), (0x0A5, b"")])
    assert port.written == b"t0A4102\rt0A50\r"
    port.broken = OSError(5, "Input/output error")
    for call in (lambda: wire.receive(0.2), wire.wake):
        with pytest.raises(UserError, match=r"port: the serial port disappeared \(Input/output error\)"):
            call()
    with contextlib.closing(wire):
        pass
    assert port.written.endswith(b"closed")


def built(monkeypatch: pytest.MonkeyPatch, sources: Path, makes: Sequence[str], robot: str = "roller",
    board: str = "") -> tuple[list[str], list[tuple[str, ...]]]:  # fmt: skip
    """Names of the images that are copied, where the second program makes files; and what was run."""
    ran: list[tuple[str, ...]] = []

    def run(where: Path, log: Path, *words: str) -> None:
        assert where == sources
        ran.append(words)
        if "--build" in words:
            for name in makes:
                Path(words[2], name).write_bytes(name.encode())

    monkeypatch.setattr(build, "_run", run)
    monkeypatch.setattr("terrapin_hil.paths.sources", lambda: sources)
    monkeypatch.setattr("terrapin_tools.flash.build.shutil.which", lambda program, path: program)
    found = build.build_images(robot, board, sources / "out")
    assert all(path.read_bytes() == path.name.encode() for path in found)
    return [path.relative_to(sources / "out").name for path in found], ran


def test_the_images_of_a_robot_are_built_and_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder of the robot's, of the board's too where that is another one than its own."""
    makes = ["terrapin-f405-h-bridge-slot-a.bin", "terrapin-boot-f405-h-bridge.bin", "terrapin-other-slot-a.bin",
        "terrapin-f405-h-bridge-slot-a.elf"]  # fmt: skip
    names, ran = built(monkeypatch, tmp_path, makes)
    assert names == ["terrapin-boot-f405-h-bridge.bin", "terrapin-f405-h-bridge-slot-a.bin"]
    place = str(tmp_path / "build" / "robots" / "roller" / "cortex-m4")
    (configured, made) = ran
    assert configured[:5] == ("cmake", "--preset", "cortex-m4", "-B", place)
    assert f"-DTERRAPIN_ROBOT={find_robot('roller').resolve()}" in configured
    assert made == ("cmake", "--build", place, "--target", "images-f405_h_bridge")
    other = set_fields(tmp_path / "carrier.toml", BOARD, {"number": 101})
    names, ran = built(monkeypatch, tmp_path, ["terrapin-carrier-slot-a.bin"], board=str(other))
    assert names == ["terrapin-carrier-slot-a.bin"]
    assert ran[1][2] == str(tmp_path / "build" / "robots" / "roller-carrier" / "cortex-m4")


def test_what_a_build_needs_and_where_it_failed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_hil.paths.sources", lambda: tmp_path)
    monkeypatch.setattr("terrapin_tools.flash.build.shutil.which", lambda program, path: None)
    with pytest.raises(UserError, match="cmake, ninja, arm-none-eabi-gcc not found on PATH"):
        build.build_images("roller", "", tmp_path)
    log = tmp_path / "log"
    for text, told in (("one\n  Error: two  \nthree\n", "Error: two"), ("one\n three \n\n", "three"), ("", "it says")):
        with pytest.raises(UserError, match=f" failed: {told}.*; all that it says: {log}") as raised:
            build._run(tmp_path, log, sys.executable, "-c", f"print({text!r}, end=''); raise SystemExit(3)")
        assert raised.value.status == 1
        assert log.read_text() == text
    log.unlink()
    build._run(tmp_path, log, sys.executable, "-c", "import os; assert os.getcwd() == " + repr(str(tmp_path)))
    assert not log.exists()
    monkeypatch.setattr(build, "LONGEST", 0.1)
    with pytest.raises(UserError, match=r"not done after 0\.1 s") as raised:
        build._run(tmp_path, log, sys.executable, "-c", "import time; time.sleep(60)")
    assert raised.value.status == 1


def test_a_board_stands_in_the_robots_file_or_is_refused(tmp_path: Path) -> None:
    board = set_fields(tmp_path / "carrier.toml", BOARD, {"number": 101})
    robot, path = build.choose("roller", str(board), tmp_path / "copy")
    assert (robot.board.name, path) == ("carrier", tmp_path / "copy" / "roller.toml")
    before, after = find_robot("roller").read_text().splitlines(), path.read_text().splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert [b for _, b in changed] == [f'board = "{board}"']
    for name in ("", "f405_h_bridge"):
        assert build.choose("roller", name, tmp_path / "none")[1] == find_robot("roller").resolve()
    assert not (tmp_path / "none").exists()
    with pytest.raises(UserError, match="found no such file"):
        build.choose("nosuch", "", tmp_path)


def test_what_a_probe_does_is_told_in_sectors_and_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []

    class Eraser:
        Mode = SimpleNamespace(SECTOR="sector")

        def __init__(self, session: Any, mode: str) -> None:
            assert (session, mode) == ("session", "sector")

        def erase(self, ranges: list[tuple[int, int]]) -> None:
            done.append(ranges)

    class Loader:
        def __init__(self, session: Any, progress: Callable[[float], None], chip_erase: str) -> None:
            assert (session, chip_erase) == ("session", "sector")
            self.progress = progress

        def add_data(self, address: int, data: bytes) -> None:
            done.append((address, data))

        def commit(self) -> None:
            for share in (0.0, 0.25, 1.0):
                self.progress(share)

    monkeypatch.setitem(sys.modules, "pyocd.flash.eraser", SimpleNamespace(FlashEraser=Eraser))
    monkeypatch.setitem(sys.modules, "pyocd.flash.loader", SimpleNamespace(FlashLoader=Loader))
    probe = swd.Swd.__new__(swd.Swd)
    probe.name, probe._session = "P1", "session"
    told: list[tuple[str, int, int]] = []
    probe.erase([(BASE, 0x4000), (BASE + 0x2_0000, 0x2_0000)], lambda *one: told.append(one))
    assert done == [[(BASE, BASE + 0x4000)], [(BASE + 0x2_0000, BASE + 0x4_0000)]]
    assert told == [("erasing", 0, 2), ("erasing", 1, 2)]
    done.clear()
    told.clear()
    probe.write(BASE, b"x" * 1000, lambda *one: told.append(one))
    assert done == [(BASE, b"x" * 1000)]
    assert told == [("writing", 0, 1000), ("writing", 250, 1000), ("writing", 1000, 1000)]


class Updating:
    """`update` with what it asks replaced; what was done, in order."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, controller: Controller, there: Any = None,
        state: str = "confirmed") -> None:  # fmt: skip
        self.done: list[Any] = []
        patches: dict[str, Any] = {
            "query": lambda wire: controller, "_require_alone": self._noted("alone"),
            "_enter_loader": self._noted("enters", replace(controller, running="")), "_made_for": lambda *_: there,
            "_require_fit": self._noted("fits"), "_demand": self._noted("demands"),
            "_send_blocks": self._noted("sends"), "_reset": self._noted("resets"),
            "_started": self._noted("started", state), "_revoked": lambda *_: True,
        }  # fmt: skip
        for name, does in patches.items():
            monkeypatch.setattr(update, name, does)

    def _noted(self, name: str, result: Any = None) -> Any:
        def call(wire: Any, sender: Any, *given: Any) -> Any:
            self.done.append((name, *given))
            return result

        return call

    def __call__(self, *files: SignedFile, **more: Any) -> tuple[update.Outcome, list[tuple[str, int, int]]]:
        told: list[tuple[str, int, int]] = []
        wire: Any = None
        return update.update(wire, files, lambda *one: told.append(one), **more), told


def test_an_update_is_announced_sent_ended_and_started(monkeypatch: pytest.MonkeyPatch) -> None:
    """What lies behind the image in its file is not sent, and its last word is filled up."""
    data = image("a", "2.3.4", 5, 601)
    assert len(data) % 4 == 1
    whole = data + b"\xff" * 3
    good = SignedFile("a.bin", parse(data), data + b"\xff" * 64)
    updating = Updating(monkeypatch, THERE)
    outcome, told = updating(good)
    assert outcome == update.Outcome("a", "confirmed", True)
    size = len(whole)
    assert told == [("erasing", 0, size), ("verifying", size, size), ("starting", size, size)]
    assert [name for name, *_ in updating.done] == ["alone", "demands", "sends", "demands", "resets", "started"]
    _, begin, sends, end, resets, started = updating.done
    slot = interface().enums["update_slot"]["a"]
    assert begin[1:5] == ("begin", {"size": size // 4, "slot": slot, "major": 2, "minor": 3, "revision": 4},
        update.ERASE, "a.bin")  # fmt: skip
    assert b"".join(one for _, one in begin[5][1:]) == data[-144:]
    assert sends[1] == whole
    assert end[1:] == ("end", {"checksum": zlib.crc32(whole)}, update.VERIFY, "a.bin")
    assert [resets[3](replace(THERE, running=one)) for one in ("a", "")] == [True, False]
    assert started[1:] == ("a", "a.bin")
    trial, _ = Updating(monkeypatch, THERE, state="on trial")(good)
    assert trial == update.Outcome("a", "on trial", False)


def test_an_application_makes_way_and_a_boot_loader_says_whose_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    running = Updating(monkeypatch, replace(THERE, running="b", confirmed="b"))
    outcome, _ = running(file("a"), key="key")
    assert outcome.slot == "a"
    assert running.done[1][:3] == ("enters", "a.bin", "key")
    asked: list[Any] = []
    monkeypatch.setattr(update, "_require_fit", lambda *given: asked.append(given))
    for there in (None, update.MadeFor(7, 2, 1)):
        of = Updating(monkeypatch, replace(THERE, protocol=1), there)
        monkeypatch.setattr(update, "_require_fit", lambda *given: asked.append(given))
        of(file("a"), change_robot=True)
    [(chosen, there, change, protocol)] = asked  # an older one knows nothing of robots
    assert (chosen.name, there, change, protocol) == ("a.bin", update.MadeFor(7, 2, 1), True, 1)


def test_a_boot_loader_is_asked_three_times_whose_it_is() -> None:
    def asked(*answers: list[Frame]) -> tuple[Any, int]:
        bus: Any = Bus(UPDATE_ROBOT=answers)
        return update._made_for(bus, Sender()), len(bus.sent)

    number, data = said("UPDATE_IDENTITY", robot=0x123456, board=3, interface=2)
    found = update.MadeFor(0x123456, 3, 2)
    assert asked([(number, data)]) == (found, 1)
    assert asked([], [(number, data[:-1])], [(number + 1, data), (number, data)]) == (found, 3)
    assert asked([], [], []) == (None, 3)


def test_a_link_is_unsealed_after_a_reset(monkeypatch: pytest.MonkeyPatch) -> None:
    wire: Any = SimpleNamespace(session=None)
    sealed: list[Any] = []

    def seal(wire: Any, key: Any) -> None:
        sealed.append(key)
        wire.session = "session"

    def reset(wire: Any, *given: Any) -> None:
        sealed.append(wire.session)
        if fails:
            raise UserError("refused")

    monkeypatch.setattr(update, "seal_link", seal)
    monkeypatch.setattr(update, "_reset", reset)
    key: Any = "key"
    for fails in (False, True):
        sealed.clear()
        with contextlib.nullcontext() if not fails else pytest.raises(UserError):
            update._reset_application(wire, Sender(), {}, "file", lambda found: True, key)
        assert (sealed, wire.session) == (["key", "session"], None)
    fails = False
    sealed.clear()
    update._reset_application(wire, Sender(), {}, "file", lambda found: True, None)
    assert sealed == [None]


def test_a_controller_that_does_not_answer_says_why_where_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    answers: list[Controller | None] = [THERE, None, None, None]
    monkeypatch.setattr(update, "_ask", lambda wire, sender, seconds: answers.pop(0))
    bus: Any = Bus()
    assert update.query(bus) is THERE
    with pytest.raises(UserError, match="wire: no controller answers") as raised:
        update.query(Bus())  # type: ignore[arg-type]
    assert raised.value.status == 1
    for result, told in (("motor_on", "wire: the motor is on"), ("sequence", "wire: no controller answers")):
        with pytest.raises(UserError, match=told):
            update.query(Bus(UPDATE_BLOCK=[[status("block", result)]]))  # type: ignore[arg-type]


RIGHT = update.MadeFor(identity_of("cylinder"), 3, 2)


@pytest.mark.parametrize(
    ("made", "there", "told"),
    [
        ({"robot": RIGHT.robot, "board": 3, "interface": 2}, RIGHT, ""),
        ({"robot": RIGHT.robot, "board": 0, "interface": 0}, RIGHT, ""),  # it does not say
        ({"robot": 7, "board": 3, "interface": 2}, update.MadeFor(0, 0, 2), ""),  # nor does the controller
        ({"robot": RIGHT.robot, "board": 1, "interface": 2}, RIGHT, "made for board .*, expected "),
        ({"robot": RIGHT.robot, "board": 3, "interface": 1}, RIGHT, "interface version 1, expected 2"),
        ({"robot": RIGHT.robot, "board": 3, "interface": 1}, update.MadeFor(RIGHT.robot, 3, 0), "interface version 1"),
        (
            {"robot": 7, "board": 3, "interface": 2},
            RIGHT,
            "made for robot 0x000007, the controller is that of cylinder",
        ),
        ({"robot": 0, "board": 3, "interface": 2}, RIGHT, "made for no robot that it names"),
    ],
)
def test_an_image_fits_what_the_boot_loader_says(made: dict[str, int], there: update.MadeFor, told: str) -> None:
    with pytest.raises(UserError, match=rf"^a\.bin: .*{told}") if told else contextlib.nullcontext():
        update._require_fit(file("a", **made), there, False, 2)  # type: ignore[arg-type]


def test_an_image_takes_another_robots_place_where_both_say_so() -> None:
    other = file("a", robot=7, replaces=RIGHT.robot)
    update._require_robot(other, RIGHT.robot, True, 2)
    for image_, change, protocol, told in ((other, False, 2, "--change-robot makes it another's"),
        (other, True, 1, "its boot loader is too old for another robot's image"),
        (file("a", robot=7, replaces=8), True, 2, "`terrapin image sign --replaces cylinder`"),
        (file("a", robot=7), True, 2, "`terrapin image sign --replaces cylinder`")):  # fmt: skip
        with pytest.raises(UserError, match=told):
            update._require_robot(image_, RIGHT.robot, change, protocol)
    with pytest.raises(UserError, match="--replaces 0x000009`"):
        update._require_robot(other, 9, True, 2)


class Registers:
    """Option bytes, unlocked by the keys; what was written, in order."""

    name = "chip"

    def __init__(self, options: int) -> None:
        self.options, self.busy = options, 3
        self.written: list[tuple[int, int]] = []

    def read32(self, address: int) -> int:
        if address == protect.SR:
            self.busy -= 1
            return 1 << 16 if self.busy > 0 else 0
        return self.options

    def write32(self, address: int, value: int) -> None:
        self.written.append((address, value))
        if address == protect.OPTCR:
            self.options = value
        elif value == 0x4C5D_6E7F:
            self.options &= ~1


def test_option_bytes_are_written_in_the_manuals_order() -> None:
    """Unlocked by two keys; the value, then the start; locked again. What is set already is not written again."""
    chip = Registers(0x0FFF_AAED)
    assert protect.protect(chip)
    wanted = 0x0FFE_BBE4
    assert chip.written == [(0x4002_3C08, 0x0819_2A3B), (0x4002_3C08, 0x4C5D_6E7F), (0x4002_3C14, wanted),
        (0x4002_3C14, wanted | 2), (0x4002_3C14, wanted | 1)]  # fmt: skip
    assert chip.busy == 0
    again = Registers(wanted | 1)
    assert not protect.protect(again)
    assert again.written == []
    for options in (0x0FFF_FFFF, 0, wanted):
        found = protect.protected(options)
        assert found & 0x1_FF0F == 0xBB04  # neither locked nor started; the sector, reading and the voltage
        assert found & 0x0FFE_00F0 == options & 0x0FFE_00F0  # all else stays


def test_a_key_of_the_bench_opens_no_release() -> None:
    bench = NEXT_KEY.public_key()
    with pytest.raises(UserError, match="the key of the bench"):
        protect.refuse_bench_key("chip", PUBLIC, bench, bench)
    protect.refuse_bench_key("chip", b"\0" + PUBLIC, KEY.public_key(), None)
    protect.refuse_bench_key("chip", b"\0" + PUBLIC, KEY.public_key(), bench)
    named = key_hash(OTHER_KEY.public_key())[:4].hex()
    with pytest.raises(UserError, match=f"chip: its boot loader does not know the key {named}; nothing is protected"):
        protect.refuse_bench_key("chip", PUBLIC, OTHER_KEY.public_key(), bench)


def test_a_robot_whose_board_is_in_no_line_of_its_own_is_told(tmp_path: Path) -> None:
    board = set_fields(tmp_path / "carrier.toml", BOARD, {"number": 101})
    text = find_robot("roller").read_text()
    line = next(one for one in text.splitlines() if one.partition("=")[0].strip() == "board")
    mine = tmp_path / "mine.toml"
    mine.write_text(text.replace(line, f'"board"{line.partition("board")[2]}', 1))
    with pytest.raises(UserError, match=r"mine\.toml: --board .*: expected a line `board = \.\.\.` in its file"):
        build.choose(str(mine), str(board), tmp_path / "copy")


def test_a_link_is_opened_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """SLCAN at the rate of its name, or a million; a bus at its rate."""
    monkeypatch.setattr(wires, "SerialWire", lambda *given: given)
    monkeypatch.setattr("terrapin_tools.flash.can_wire.CanWire", lambda *given: given)
    serial = LinkName("serial", "", "/dev/tty1", node=3)
    found: Any = wires.open_wire(serial)
    assert found == ("/dev/tty1", 1_000_000, 3)
    found = wires.open_wire(replace(serial, baud=9600))
    assert found == ("/dev/tty1", 9600, 3)
    bus = LinkName("can", "virtual", "x")
    found = wires.open_wire(bus, 250_000)
    assert found == (bus, 250_000)


def test_a_serial_port_is_nobody_elses(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def serial(port: str, baud: int, **more: Any) -> str:
        asked.append((port, baud, more))
        if errors:
            raise errors.pop()
        return "port"

    errors: list[Exception] = []
    monkeypatch.setitem(sys.modules, "serial", SimpleNamespace(Serial=serial))
    assert wires.open_serial("p", 9600, timeout=1) == "port"
    assert asked == [("p", 9600, {"write_timeout": 5, "exclusive": True, "timeout": 1})]
    for error, told in (
        (OSError(13, "Permission denied"), "Permission denied"),
        (ValueError("no such rate"), "no such"),
    ):
        errors.append(error)
        with pytest.raises(UserError, match=f"p: cannot open the serial port: {told}") as raised:
            wires.open_serial("p", 9600)
        assert raised.value.status == 1


class Counted(Wire):
    """A wire that brings what is listed, and counts what is sent."""

    name = "wire"

    def __init__(self, *heard: list[Frame]) -> None:
        self.sent: list[list[Frame]] = []
        self.heard = list(heard)

    def send_plain(self, frames: Sequence[Frame]) -> None:
        self.sent.append(list(frames))

    def receive(self, wait: float) -> list[Frame]:
        assert 0.0 <= wait <= 0.5
        return self.heard.pop(0) if self.heard else []

    def wake(self) -> None: ...
    def close(self) -> None: ...


def test_a_wire_seals_and_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [(1, b"a"), (2, b"b")]
    wire = Counted([(5, b""), (6, b"x")], [(6, b"y")])
    wire.send(frames)
    session: Any = SimpleNamespace(batches=lambda frames: ([one, (9, b"seal")] for one in frames))
    wire.session = session
    wire.send(frames)
    assert wire.sent == [frames, [(1, b"a"), (9, b"seal")], [(2, b"b"), (9, b"seal")]]
    wire.session = None
    wire.sent.clear()
    assert wire.ask((3, b"c"), lambda frame: frame[0] == 6) == (6, b"x")
    assert wire.sent == [[(3, b"c")]]
    monkeypatch.setattr("terrapin_tools.flash.wire.ASK", 0.01)
    assert wire.ask((3, b"c"), lambda frame: frame[1] == b"z") is None
    messages = interface().messages
    assert heard() == {*range(0x1A0, 0x1A8), messages["SESSION"].id, messages["PARAMETER_VALUE"].id}


def test_a_bus_hears_what_an_update_needs_at_its_node(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    class Opened:
        def __init__(self, *given: Any, **more: Any) -> None:
            made.append((given, more))

    monkeypatch.setattr("terrapin_tools.flash.can_wire.PythonCan", Opened)
    link = LinkName("can", "virtual", "x", node=2)
    wire = CanWire(link, 125_000)
    [((name, seconds, wanted, rate), more)] = made
    assert (name, seconds, wanted, rate, wire.name) == (link, 2.0, heard(), 125_000, str(link))
    places = [Node(2).to_bus((one, b""))[0] for one in sorted(heard())]
    assert more["can_filters"] == [{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in places]
