"""Which image is started, and what an update may do: trial, confirmation, fall back, versions, counters, messages."""

from __future__ import annotations

import hashlib
import zlib

import pytest
from bootlib import NONE, PENDING, SLOT, TLVS, TRIAL, Chip, announce, data_frames, send
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from kit import KEY, NEXT_KEY, NEXT_PUBLIC, OTHER_KEY, PUBLIC, image

from terrapin_hil.messages import Sender, interface
from terrapin_tools.flash.image import ImageError, parse

RESULT = interface().enums["update_result"]
RESET_KEY = int(interface().constants["update_reset_key"])
GOOD = image("b", "1.1.0")


@pytest.fixture
def chip() -> Chip:
    """Runs a confirmed 1.0.0 from slot A."""
    chip = Chip(PUBLIC)
    chip.put("a", image("a", "1.0.0"))
    assert chip.start() == "a"
    assert chip.confirm()
    return chip


def test_an_empty_chip_stays_and_takes_an_image() -> None:
    chip = Chip(PUBLIC)
    assert chip.start() == ""
    assert send(chip, image("a", "1.0.0"), "a") == "ok"
    assert chip.start() == "a"
    assert chip.confirm()
    assert chip.start() == "a"


def test_update_trial_confirmation(chip: Chip) -> None:
    assert send(chip, image("b", "1.1.0", counter=2), "b") == "ok"
    assert chip.record().phase == PENDING
    assert chip.start() == "b"
    assert chip.record().phase == TRIAL
    assert chip.record().confirmed == SLOT["a"]
    assert chip.confirm()
    record = chip.record()
    assert (record.confirmed, record.phase, record.security_counter, record.version.minor) == (SLOT["b"], NONE, 1, 0)
    assert (record.candidate, record.tries) == (0, 0)  # no longer one that may be rejected
    for _ in range(3):
        assert chip.start() == "b"
        assert chip.confirm()


def test_without_confirmation_the_old_one_comes_back_and_stays(chip: Chip) -> None:
    """Three tries: who switches the robot off in its first seconds loses no update."""
    assert send(chip, image("b", "1.1.0", counter=2), "b") == "ok"
    for left in (2, 1, 0):
        assert chip.start() == "b"
        assert (chip.record().phase, chip.record().tries) == (TRIAL, left)
    for _ in range(3):
        assert chip.start() == "a"
        assert chip.record().phase == NONE
    assert chip.record().security_counter == 1


@pytest.mark.parametrize("tries", [1, 2, 3])
def test_each_of_its_tries_may_confirm_it(chip: Chip, tries: int) -> None:
    assert send(chip, image("b", "1.1.0", counter=2), "b") == "ok"
    for _ in range(tries):
        assert chip.start() == "b"
    assert chip.confirm()
    assert chip.start() == "b"
    assert chip.record().phase == NONE


def test_the_floor_follows_one_image_behind(chip: Chip) -> None:
    """The image before is a way back, by an update; the one before that is none."""
    for slot, version, counter in (("b", "1.1.0", 2), ("a", "1.2.0", 3)):
        assert send(chip, image(slot, version, counter=counter), slot) == "ok"
        assert chip.start() == slot
        assert chip.confirm()
    record = chip.record()
    assert (record.version.minor, record.security_counter) == (1, 2)
    assert send(chip, image("b", "1.0.0", counter=1), "b") == "version_too_old"
    assert send(chip, image("b", "1.2.0", counter=1), "b") == "counter_too_low"
    assert send(chip, image("b", "1.1.0", counter=2), "b") == "ok"
    assert chip.start() == "b"
    assert chip.confirm()  # which raises the floor to 1.2.0: what went back starts all the same
    assert chip.record().version.minor == 2
    assert chip.start() == "b"
    chip.put("b", b"")
    chip.put("a", image("a", "1.1.5", counter=3))  # neither does the floor keep the last image that there is
    assert chip.start() == "a"


def test_what_cannot_be_written_down_is_not_tried() -> None:
    chip = Chip(PUBLIC)
    chip.put("a", image("a", "1.0.0"))
    chip.put("b", image("b", "1.1.0"))
    record = chip.record()
    record.candidate, record.phase = SLOT["b"], PENDING
    assert chip.lib.terrapin_records_append(chip.flash, record)
    write = chip.flash.write
    chip.flash.write = refused = chip.ffi.callback(
        "bool(void *, uint32_t, const uint8_t *, uint32_t)", lambda *_: False
    )
    assert chip.start() == "a"
    assert refused
    chip.flash.write = write
    assert chip.start() == "b"


def test_many_updates_fill_both_pages_of_records(chip: Chip) -> None:
    """3 records an update, 512 and 2,048 places: each page is left and taken again; the application never erases."""
    chip.put("b", image("b", "1.0.0"))
    begun = chip.memory.busy_us
    for n in range(1200):
        slot = "a" if n % 2 else "b"
        record = chip.record()
        assert record.confirmed == SLOT["b" if n % 2 else "a"], n
        record.candidate, record.phase = SLOT[slot], PENDING  # as the end of an update leaves it
        assert chip.lib.terrapin_records_append(chip.flash, record)
        assert chip.start() == slot
        before = chip.memory.busy_us
        assert chip.confirm()
        assert chip.memory.busy_us - before == 8 * 16  # 32 bytes, 16 us a word, no erase
    assert chip.memory.busy_us - begun - 3 * 1200 * 8 * 16 >= 250_000 + 550_000  # each page was erased once at least


def test_a_lost_confirmed_image_is_replaced_by_the_other(chip: Chip) -> None:
    assert send(chip, image("b", "1.1.0"), "b") == "ok"
    assert chip.start() == "b"
    assert chip.confirm()
    chip.bytes[0x40000 + 700] ^= 1
    assert chip.start() == "a"
    assert chip.confirm()
    assert chip.record().confirmed == SLOT["a"]
    assert chip.record().version.minor == 0  # 1.1.0 was the newest: its floor would have come with the next one
    chip.bytes[0x20000 + 700] ^= 1
    assert chip.start() == ""
    assert send(chip, image("b", "1.1.0"), "b") == "ok"
    assert chip.start() == "b"


def test_without_a_confirmed_image_what_was_rejected_comes_last() -> None:
    """Of two good images the one that nobody gave back; the other only when there is no better, though the floor has
    risen above its version."""
    chip = Chip(PUBLIC)
    for rejected, other in (("a", "b"), ("b", "a")):
        chip.put(rejected, image(rejected, "1.0.0"))
        chip.put(other, image(other, "1.0.0"))
        record = chip.record()
        record.candidate, record.phase = SLOT[rejected], NONE
        record.version.major = 2
        assert chip.lib.terrapin_records_append(chip.flash, record)
        assert chip.start() == other
        chip.put(other, b"")
        assert chip.start() == rejected


def test_what_waits_in_a_slot_counts_no_more_once_it_is_erased(chip: Chip) -> None:
    assert send(chip, image("b", "1.1.0"), "b") == "ok"
    assert chip.record().phase == PENDING
    begin(chip, Sender(), image("b", "1.2.0"))
    assert chip.record().phase == NONE
    assert chip.start() == "a"


def test_an_update_of_the_other_slot_leaves_the_image_on_trial_its_trial() -> None:
    chip = Chip(PUBLIC)
    assert send(chip, image("a", "1.0.0"), "a") == "ok"
    assert chip.start() == "a"
    assert (chip.record().confirmed, chip.record().phase) == (0, TRIAL)
    assert send(chip, image("b", "1.1.0")[:300] + image("b", "1.2.0")[300:], "b") != "slot_in_use"
    assert (chip.record().candidate, chip.record().phase) == (SLOT["a"], TRIAL)
    assert chip.confirm()
    assert chip.start() == "a"
    assert chip.record().confirmed == SLOT["a"]


@pytest.mark.parametrize("slot", [0, 3])
def test_a_slot_that_there_is_none_of_is_not_written(chip: Chip, slot: int) -> None:
    """Neither confirmed nor running, but whatever stands for it would be one that is."""
    assert send(chip, image("b", "1.1.0"), "b") == "ok"
    assert chip.start() == "b"  # on trial
    before = chip.contents()
    announce(chip, image("a", "2.0.0"))
    values = {"size": 500, "slot": slot, "major": 2, "minor": 0, "revision": 0}
    answers = chip.accept(*Sender().frame("UPDATE_BEGIN", values))
    results = [interface().by_id[identifier].decode(data)["result"] for identifier, data in answers]
    assert results in ([RESULT["slot_in_use"]], [])  # 3 is no value of the message
    assert chip.contents() == before
    assert not chip.update.active


def test_neither_the_running_nor_the_confirmed_slot_is_written(chip: Chip) -> None:
    assert send(chip, image("a", "2.0.0"), "a") == "slot_in_use"
    assert send(chip, image("b", "1.1.0"), "b") == "ok"
    assert chip.start() == "b"  # on trial
    before = chip.contents()
    assert send(chip, image("a", "2.0.0"), "a") == "slot_in_use"
    assert send(chip, image("b", "2.0.0"), "b") == "slot_in_use"
    assert chip.contents() == before


@pytest.mark.parametrize(("data", "result"), [
    (image("b", "0.9.9"), "version_too_old"),
    (image("b", "1.1.0", counter=0), "counter_too_low"),
    (image("b", "1.1.0", key=OTHER_KEY), "wrong_key"),
    (image("a", "1.1.0"), "wrong_slot"),
    (image("b", "1.1.0")[:-4], "bad_signature"),
    (image("b", "1.1.0")[:-200], "not_an_image"),
    (image("b", "1.1.0") + bytes(4), "not_an_image"),
    (bytes(800), "not_an_image"),
    (image("b", "1.1.0")[:512], "too_large"),
])  # fmt: skip
def test_refused_and_nothing_of_it_stays(chip: Chip, data: bytes, result: str) -> None:
    version = (1, 1, 0) if not any(data[:32]) else None
    before = chip.contents()
    assert send(chip, data, "b", version, GOOD) == result
    assert chip.record().phase == NONE
    assert (chip.contents() == before) == (result in ("version_too_old", "too_large") or not any(data[:32]))
    assert chip.start() == "a"
    chip.put("a", b"")  # not even when nothing else is left
    assert chip.start() == ""


@pytest.mark.parametrize("tail", ["none", "bits", "key", "revoked", "short", "long"])
def test_begin_without_a_signature_erases_nothing(chip: Chip, tail: str) -> None:
    """Nothing before it, any bit wrong, another key, a revoked key, less or more than an image's end."""
    if tail == "revoked":
        chip = with_two_keys("a", image("a", "1.0.0", key=NEXT_KEY, revokes=KEY))
        assert chip.start() == "a"
        assert chip.confirm()
        assert chip.start() == "a"
    sender, good = Sender(), GOOD[-TLVS:]
    frames = list(data_frames(image("b", "1.1.0", key=OTHER_KEY)[-TLVS:] if tail == "key" else good))
    tried = {"none": [[]], "short": [frames[1:]], "long": [[*frames, frames[0]]]}.get(tail, [frames])
    if tail == "bits":
        flipped = ((int.from_bytes(good, "little") ^ 1 << bit).to_bytes(TLVS, "little") for bit in range(8 * TLVS))
        tried = [list(data_frames(data)) for data in flipped]
    before = chip.contents()
    for each in tried:
        for frame in each:
            chip.accept(*frame)
        chip.accept(*sender.frame("UPDATE_QUERY", {"protocol": 2}))
        values = {"size": 250, "slot": SLOT["b"], "major": 1, "minor": 1, "revision": 0}
        result = chip.ask(sender.frame("UPDATE_BEGIN", values))["result"]
        wanted = {"key": "wrong_key", "revoked": "revoked_key", "bits": "bad_signature"}.get(tail, "again")
        assert result == RESULT[wanted] or (tail == "bits" and result == RESULT["wrong_key"])
    assert chip.contents() == before
    assert (chip.update.active, chip.update.erases) == (False, 0)


def test_what_is_refused_leaves_an_update_alone(chip: Chip) -> None:
    """A stranger's BEGIN, END and RESET in an update: it goes on to its end."""
    sender, data = Sender(), image("b", "1.1.0")
    begin(chip, sender, data)
    for index in range((len(data) + 255) // 256):
        foreign = {"size": 999, "slot": SLOT["b"], "major": 2, "minor": 0, "revision": 0}
        assert chip.ask(sender.frame("UPDATE_BEGIN", foreign))["result"] == RESULT["again" if index else "busy"]
        chip.update.now_ms += 10_000
        announce(chip, image("b", "2.0.0", key=OTHER_KEY))
        assert chip.ask(sender.frame("UPDATE_BEGIN", foreign))["result"] == RESULT["wrong_key"]
        assert chip.ask(sender.frame("UPDATE_END", {"checksum": 0}))["result"] == RESULT["sequence"]
        assert chip.ask(sender.frame("UPDATE_RESET", {"key": RESET_KEY}))["result"] == RESULT["ok"]  # of slot a's image
        body = data[256 * index : 256 * index + 256]
        for frame in data_frames(body):
            chip.accept(*frame)
        values = {"index": index, "size": len(body), "checksum": zlib.crc32(body)}
        assert chip.ask(sender.frame("UPDATE_BLOCK", values))["result"] == RESULT["ok"]
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": 1}))["result"] == RESULT["corrupted"]
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": zlib.crc32(data)}))["result"] == RESULT["ok"]


def test_the_boot_loader_resets_for_a_verified_image_alone() -> None:
    blank, sender = Chip(PUBLIC), Sender()
    reset = {"key": RESET_KEY, "stay": 1}
    assert blank.ask(sender.frame("UPDATE_RESET", reset))["result"] == RESULT["sequence"]
    assert send(blank, image("b", "1.1.0", key=OTHER_KEY), "b", None, GOOD) == "wrong_key"
    assert blank.ask(sender.frame("UPDATE_RESET", reset))["result"] == RESULT["sequence"]
    assert (blank.update.reset, blank.update.stay) == (False, False)
    blank.update.now_ms += 10_000
    assert send(blank, GOOD, "b") == "ok"
    assert blank.ask(sender.frame("UPDATE_RESET", reset))["result"] == RESULT["ok"]
    assert (blank.update.reset, blank.update.stay) == (True, True)


def test_an_announced_version_must_be_that_of_the_header(chip: Chip) -> None:
    """An old image under a new name is refused with its first block, before anything is written."""
    operations = chip.memory.operations
    assert send(chip, image("b", "0.9.0"), "b", version=(1, 5, 0)) == "not_an_image"
    assert chip.memory.operations == operations + 1  # the erase


@pytest.mark.parametrize("fails", ["header", "flash"])
def test_after_a_block_that_ended_it_an_update_begins_anew(chip: Chip, fails: str) -> None:
    data, sender = image("b", "1.1.0"), Sender()
    begin(chip, sender, data)
    bad = image("b", "0.9.0") if fails == "header" else data
    write = chip.flash.write
    refused = chip.ffi.callback("bool(void *, uint32_t, const uint8_t *, uint32_t)", lambda *_: False)
    if fails == "flash":
        chip.flash.write = refused
    answers = []
    for block in (bad[:256], data[:256]):
        for frame in data_frames(block):
            chip.accept(*frame)
        values = {"index": 0, "size": 256, "checksum": zlib.crc32(block)}
        answers.append(chip.ask(sender.frame("UPDATE_BLOCK", values))["result"])
        chip.flash.write = write
    assert answers == [RESULT["not_an_image" if fails == "header" else "flash"], RESULT["sequence"]]


def test_the_motor_is_on(chip: Chip) -> None:
    chip.motor_on = True
    before = chip.memory.operations
    assert send(chip, image("b", "1.1.0"), "b") == "motor_on"
    assert chip.ask(Sender().frame("UPDATE_RESET", {"key": RESET_KEY}))["result"] == RESULT["motor_on"]
    assert not chip.update.reset
    assert chip.memory.operations == before
    chip.motor_on = False
    sender = Sender()
    begin(chip, sender, image("b", "1.1.0"))
    chip.motor_on = True  # meanwhile
    values = {"index": 0, "size": 256, "checksum": 0}
    assert chip.ask(sender.frame("UPDATE_BLOCK", values))["result"] == RESULT["motor_on"]


def test_reset_needs_its_key(chip: Chip) -> None:
    sender = Sender()
    assert chip.accept(*sender.frame("UPDATE_RESET", {"key": 1})) == []
    assert chip.update.malformed == 1
    assert not chip.update.reset
    assert chip.ask(sender.frame("UPDATE_RESET", {"key": RESET_KEY, "stay": 1}))["result"] == RESULT["ok"]
    assert chip.update.reset
    assert chip.update.stay


def begin(chip: Chip, sender: Sender, data: bytes) -> None:
    chip.accept(*sender.frame("UPDATE_QUERY", {"protocol": 1}))
    chip.update.now_ms += 10_000  # each a while after the other
    values = {"size": len(data) // 4, "slot": SLOT["b"], "major": 1, "minor": 1, "revision": 0}
    announce(chip, GOOD)
    answer = chip.ask(sender.frame("UPDATE_BEGIN", values))
    assert (answer["request"], answer["result"], answer["next"]) == (1, RESULT["ok"], 0)


def test_flow_control(chip: Chip) -> None:
    """Lost, doubled and reordered frames, a lost answer, blocks out of order: sent again, and the image is whole."""
    data, sender = image("b", "1.1.0"), Sender()
    begin(chip, sender, data)
    first, second = data[:256], data[256:512]

    def block(index: int, body: bytes, frames: list[tuple[int, bytes]]) -> tuple[str, int]:
        for frame in frames:
            chip.accept(*frame)
        values = {"index": index, "size": len(body), "checksum": zlib.crc32(body)}
        answer = chip.ask(sender.frame("UPDATE_BLOCK", values))
        return next(name for name, number in RESULT.items() if number == answer["result"]), answer["next"]

    good = list(data_frames(first))
    assert block(0, first, good[1:]) == ("again", 0)
    assert block(0, first, [*good, good[0]]) == ("again", 0)
    assert block(0, first, [good[1], good[0], *good[2:]]) == ("again", 0)
    assert block(0, first, good * 3) == ("again", 0)
    assert block(1, second, list(data_frames(second))) == ("sequence", 0)
    assert block(0, first[:128], list(data_frames(first[:128]))) == ("sequence", 0)
    assert block(0, first, good) == ("ok", 1)
    assert block(0, first, good) == ("ok", 1)  # its answer was lost
    assert block(0, second, list(data_frames(second))) == ("sequence", 1)
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": zlib.crc32(data)}))["result"] == RESULT["sequence"]
    for index in range(1, (len(data) + 255) // 256):
        body = data[256 * index : 256 * index + 256]
        assert block(index, body, list(data_frames(body)))[0] == "ok"
    assert block(9, first, good)[0] == "sequence"
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": zlib.crc32(data)}))["result"] == RESULT["ok"]
    assert chip.start() == "b"


def test_a_block_of_nothing(chip: Chip) -> None:
    """When all is written nothing is left, not even a block of no bytes. (Found by the proof of update.c.)"""
    data, sender = image("b", "1.1.0"), Sender()
    begin(chip, sender, data)
    for index in range((len(data) + 255) // 256):
        body = data[256 * index : 256 * index + 256]
        for frame in data_frames(body):
            chip.accept(*frame)
        values = {"index": index, "size": len(body), "checksum": zlib.crc32(body)}
        assert chip.ask(sender.frame("UPDATE_BLOCK", values))["result"] == RESULT["ok"]
    for index in (len(data) // 256, len(data) // 256 + 1):
        values = {"index": index, "size": 0, "checksum": 0}
        assert chip.ask(sender.frame("UPDATE_BLOCK", values))["result"] == RESULT["sequence"]
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": zlib.crc32(data)}))["result"] == RESULT["ok"]


def test_frames_that_are_wrong_change_nothing(chip: Chip) -> None:
    sender = Sender()
    before = chip.memory.operations
    identifier, good = sender.frame("UPDATE_BEGIN", {"size": 200, "slot": 2, "major": 2})
    for bit in range(64):
        bad = (int.from_bytes(good, "little") ^ 1 << bit).to_bytes(8, "little")
        assert chip.accept(identifier, bad) == [], bit
    for first in range(0xA0, 0xA8):
        for length in range(9):
            if (first, length) not in ((0xA4, 1), (0xA2, 8)):
                assert chip.accept(first, bytes(length)) == [], (first, length)
    assert chip.accept(0x080, good) == []
    assert chip.memory.operations == before
    assert chip.update.bad_crc >= 64
    chip.update.filled = 0
    announce(chip, GOOD)
    assert chip.ask((identifier, good))["result"] == RESULT["ok"]
    assert chip.update.repeated == 0
    assert chip.accept(identifier, good) == []
    assert chip.update.repeated == 1


def test_query(chip: Chip) -> None:
    info, least = chip.accept(*Sender().frame("UPDATE_QUERY", {"protocol": 1}))
    messages = interface().messages
    assert messages["UPDATE_INFO"].decode(info[1]) == {
        "protocol": 2, "running": 1, "confirmed": 1, "candidate": 0, "phase": 0, "major": 1, "minor": 0, "revision": 0,
        "target": 2, "revoked": 0,
    }  # fmt: skip
    assert messages["UPDATE_FLOOR"].decode(least[1])["security_counter"] == 1


def test_what_an_application_leaves_to_the_boot_loader(chip: Chip) -> None:
    """It answers queries and resets, and refuses the rest with the reason; its flash is not touched."""
    operations = chip.memory.operations
    frames, replies = chip.ffi.new("terrapin_frame *"), chip.ffi.new("terrapin_frame[2]")
    status = interface().messages["UPDATE_STATUS"]

    def ask(name: str, values: dict[str, int], motor_on: bool) -> int | list[int]:
        identifier, data = Sender().frame(name, values)
        frames.id, frames.length = identifier, len(data)
        chip.ffi.memmove(frames.data, data, len(data))
        count = chip.lib.terrapin_update_application(chip.update, frames, motor_on, replies)
        ids = [reply.id for reply in replies[0:count]]
        return status.decode(bytes(replies[0].data)[:8])["result"] if ids == [status.id] else ids

    assert ask("UPDATE_QUERY", {"protocol": 1}, False) == [0x1A1, 0x1A2]
    for name in ("UPDATE_BEGIN", "UPDATE_BLOCK", "UPDATE_END"):
        assert ask(name, {}, False) == RESULT["boot_loader_only"], name
        assert ask(name, {}, True) == RESULT["motor_on"], name
    assert ask("UPDATE_DATA", {}, False) == []
    assert ask("UPDATE_RESET", {"key": RESET_KEY, "stay": 1}, True) == RESULT["motor_on"]
    assert not chip.update.reset
    ask("UPDATE_QUERY", {"protocol": 1}, False)  # a new host: its counters begin anew
    assert ask("UPDATE_RESET", {"key": RESET_KEY, "stay": 1}, False) == RESULT["ok"]
    assert chip.update.reset
    assert chip.update.stay
    assert chip.memory.operations == operations


def test_a_request_that_comes_again_is_done_once(chip: Chip) -> None:
    """BEGIN and END whose answers were lost: answered as before, the slot is neither erased nor written again."""
    sender, data = Sender(), image("b", "1.1.0")
    begin(chip, sender, data)
    operations = chip.memory.operations
    begin(chip, sender, data)
    assert chip.memory.operations == operations
    for index in range((len(data) + 255) // 256):
        body = data[256 * index : 256 * index + 256]
        for frame in data_frames(body):
            chip.accept(*frame)
        values = {"index": index, "size": len(body), "checksum": zlib.crc32(body)}
        assert chip.ask(sender.frame("UPDATE_BLOCK", values))["result"] == RESULT["ok"]
    end = {"checksum": zlib.crc32(data)}
    assert chip.ask(sender.frame("UPDATE_END", end))["result"] == RESULT["ok"]
    operations = chip.memory.operations
    for _ in range(3):
        assert chip.ask(sender.frame("UPDATE_END", end))["result"] == RESULT["ok"]
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": 0}))["result"] == RESULT["sequence"]
    assert chip.memory.operations == operations
    assert chip.record().phase == PENDING
    begin(chip, sender, data)  # a new one, after which the end of the last counts no more
    assert chip.memory.operations > operations
    assert chip.ask(sender.frame("UPDATE_END", end))["result"] == RESULT["sequence"]
    assert chip.start() == "a"


def test_a_refusal_that_comes_again_keeps_its_reason(chip: Chip) -> None:
    data = image("b", "1.1.0", key=OTHER_KEY)
    assert send(chip, data, "b", None, GOOD) == "wrong_key"
    sender = Sender()
    chip.accept(*sender.frame("UPDATE_QUERY", {"protocol": 1}))
    operations = chip.memory.operations
    assert chip.ask(sender.frame("UPDATE_END", {"checksum": zlib.crc32(data)}))["result"] == RESULT["wrong_key"]
    assert chip.memory.operations == operations


def test_begin_erases_once_in_ten_seconds_and_twenty_times_a_start(chip: Chip) -> None:
    sender = Sender()

    def begin(at_ms: int) -> int:
        chip.update.now_ms = at_ms % 2**32
        values = {"size": 1000 + at_ms % 7, "slot": SLOT["b"], "major": 1, "minor": 0, "revision": at_ms % 5}
        before = chip.memory.busy_us
        announce(chip, GOOD)
        result = chip.ask(sender.frame("UPDATE_BEGIN", values))["result"]
        assert (chip.memory.busy_us > before) == (result == RESULT["ok"])
        return result

    clock = 2**32 - 30_000  # it wraps
    assert begin(clock) == RESULT["ok"]
    assert begin(clock + 1) == RESULT["busy"]
    assert begin(clock + 9_999) == RESULT["busy"]
    done = 1
    for i in range(1, 40):
        done += begin(clock + 10_001 * i) == RESULT["ok"]
    assert done == 20
    assert chip.start() == "a"
    assert begin(5) == RESULT["ok"]


# ---- two keys, one of which may be revoked


def with_two_keys(slot: str, data: bytes) -> Chip:
    """A chip that knows both keys and runs this image, confirmed."""
    chip = Chip(PUBLIC, NEXT_PUBLIC)
    chip.put(slot, data)
    assert chip.start() == slot
    assert chip.confirm()
    return chip


def floor(chip: Chip) -> tuple[str, str, int]:
    """The keys that a query tells, and which of them is revoked."""
    info, least = (frame[1] for frame in chip.accept(*Sender().frame("UPDATE_QUERY", {"protocol": 1})))
    messages = interface().messages
    keys = messages["UPDATE_FLOOR"].decode(least)
    revoked = messages["UPDATE_INFO"].decode(info)["revoked"]
    return keys["key"].to_bytes(2, "little").hex(), keys["next_key"].to_bytes(2, "little").hex(), revoked


def test_images_of_both_keys_are_taken_and_of_no_third() -> None:
    chip = with_two_keys("a", image("a", "1.0.0"))
    assert send(chip, image("b", "1.1.0", key=OTHER_KEY), "b") == "wrong_key"
    assert send(chip, image("b", "1.1.0", key=NEXT_KEY), "b") == "ok"
    assert chip.start() == "b"
    assert chip.confirm()
    assert send(chip, image("a", "1.2.0"), "a") == "ok"
    assert floor(chip) == (parse(image("a", "1.0.0")).key_hash[:2].hex(),  # type: ignore[index]
                           parse(image("a", "1.0.0", key=NEXT_KEY)).key_hash[:2].hex(), 0)  # type: ignore[index]  # fmt: skip
    forged = bytearray(image("b", "1.3.0", key=NEXT_KEY))
    forged[-1] ^= 1
    chip.put("b", bytes(forged))
    assert chip.check("b") == "bad_signature"


@pytest.mark.parametrize("old", [KEY, NEXT_KEY], ids=["first", "second"])
def test_a_confirmed_image_revokes_the_other_key(old: Ed25519PrivateKey) -> None:
    new, place = (NEXT_KEY, 1) if old is KEY else (KEY, 2)
    chip = with_two_keys("a", image("a", "1.0.0", key=old))
    assert send(chip, image("b", "1.1.0", key=new, revokes=old), "b") == "ok"
    assert chip.start() == "b"
    assert chip.record().revoked == 0  # on trial: it may be given up
    assert chip.check("a") == "ok"
    assert chip.confirm()
    assert chip.record().revoked == 0
    assert chip.start() == "b"
    assert chip.record().revoked == place == floor(chip)[2]
    records = chip.memory.operations
    assert chip.start() == "b"
    assert chip.memory.operations == records  # written once
    assert chip.check("a") == "revoked_key"
    assert send(chip, image("a", "2.0.0", key=old), "a") == "revoked_key"
    assert send(chip, image("a", "2.0.0", key=OTHER_KEY), "a") == "wrong_key"  # of no key, so of none that is revoked
    assert chip.start() == "b"
    assert send(chip, image("a", "2.0.0", key=new), "a") == "ok"  # which does not say it again
    assert chip.start() == "a"
    assert chip.confirm()
    assert chip.start() == "a"
    assert chip.lib.terrapin_records_set_node(chip.flash, 3)
    record = chip.record()
    record.robot = 7
    assert chip.lib.terrapin_records_append(chip.flash, record)
    assert (chip.record().revoked, chip.record().node, chip.record().robot) == (place, 3, 7)


def test_an_image_on_trial_that_is_given_up_revokes_nothing() -> None:
    chip = with_two_keys("a", image("a", "1.0.0"))
    assert send(chip, image("b", "1.1.0", key=NEXT_KEY, revokes=KEY), "b") == "ok"
    assert [chip.start() for _ in range(5)] == ["b", "b", "b", "a", "a"]
    assert chip.record().revoked == 0


def test_a_revoked_key_starts_nothing_even_when_nothing_else_is_left() -> None:
    """The boot loader stays, and takes an image of the key that counts."""
    chip = with_two_keys("a", image("a", "1.0.0"))
    assert send(chip, image("b", "1.1.0", key=NEXT_KEY, revokes=KEY), "b") == "ok"
    assert chip.start() == "b"
    assert chip.confirm()
    assert chip.start() == "b"
    chip.bytes[0x40000 + 700] ^= 1
    assert chip.start() == ""
    chip.put("a", image("a", "1.2.0", revokes=NEXT_KEY))  # nor does it revoke the other
    assert chip.start() == ""
    assert chip.record().revoked == 1
    assert send(chip, image("b", "1.1.0", key=NEXT_KEY), "b") == "ok"
    assert chip.start() == "b"


@pytest.mark.parametrize(("signer", "named"), [(KEY, OTHER_KEY), (NEXT_KEY, OTHER_KEY)])
def test_the_name_of_a_key_that_is_not_there_revokes_nothing(
    signer: Ed25519PrivateKey, named: Ed25519PrivateKey
) -> None:
    chip = with_two_keys("a", image("a", "1.0.0", key=signer, revokes=named))
    assert chip.start() == "a"
    assert chip.record().revoked == 0


def test_where_there_is_one_key_it_cannot_be_revoked() -> None:
    """Not even by an image that names the key which signed it (`sign` makes none)."""
    chip = Chip(PUBLIC)
    with pytest.raises(ImageError, match="revoke the key that signs it"):
        image("a", "1.0.0", revokes=KEY)
    data = image("a", "1.0.0", revokes=NEXT_KEY)
    own, other = (parse(data).key_hash[:4], parse(data).revokes)  # type: ignore[index]
    hashed = parse(data).hashed.replace(other, own)
    digest = hashlib.sha256(hashed).digest()
    rest = bytearray(data[len(hashed) :])
    rest[8:40], rest[-64:] = digest, KEY.sign(digest)
    chip.put("a", hashed + bytes(rest))
    for _ in range(3):
        assert chip.start() == "a"
        assert chip.confirm()


def test_a_revocation_that_cannot_be_written_down_is_tried_again() -> None:
    chip = with_two_keys("a", image("a", "1.0.0", key=NEXT_KEY, revokes=KEY))
    write = chip.flash.write
    chip.flash.write = refused = chip.ffi.callback(
        "bool(void *, uint32_t, const uint8_t *, uint32_t)", lambda *_: False
    )
    assert chip.start() == "a"
    assert refused
    assert chip.record().revoked == 0
    chip.flash.write = write
    assert chip.start() == "a"
    assert chip.record().revoked == 1


def test_a_query_tells_two_bytes_of_each_name() -> None:
    chip = with_two_keys("a", image("a", "1.0.0"))
    for first, second, expected in (
        (0x8765FFFF, 0x43210001, ("ffff", "0100", 0)),
        (0xFFFF0000, 0x0000FFFF, ("0000", "ffff", 0)),
    ):
        chip.boot.key_ids[0], chip.boot.key_ids[1] = first, second
        assert floor(chip) == expected
