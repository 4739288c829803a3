"""Frames to the boot loader without a signature: every request of an update, in every state that it can be in.

What counts as taken: an erase, a write into flash, an update that begins or ends, an image that is to be started, a
reset. In an update that a signature opened, blocks of a stranger land in the slot that it erased, which is no secret
without a key on the bus: they are counted apart, and the image that they spoil must not start.
"""

from __future__ import annotations

import random
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from terrapin_hil.messages import Frame, Sender, interface, protect
from tests.attack import Result, run
from tests.boot.bootlib import PENDING, SLOT, TLVS, TRIAL, Chip, announce, data_frames
from tests.boot.kit import KEY, NEXT_KEY, NEXT_PUBLIC, OTHER_KEY, PUBLIC, image

__all__ = ["STATES", "attack"]

OLD, NEW, FOREIGN = image("a", "1.0.0"), image("b", "1.1.0"), image("b", "1.2.0", key=OTHER_KEY)
RESET_KEY = int(interface().constants["update_reset_key"])
BEGIN = {"size": len(NEW) // 4, "slot": SLOT["b"], "major": 1, "minor": 1, "revision": 0}
BLOCK, END = interface().messages["UPDATE_BLOCK"].id, interface().messages["UPDATE_END"].id
REQUESTS = [m for m in interface().messages.values() if m.authority]  # those of the block `updates`
TURNS = 250  # frames until a state is made anew


def _blank() -> Chip:
    return Chip(PUBLIC)


def _confirmed(key: bytes = b"") -> Chip:
    chip = Chip(PUBLIC, key)
    chip.put("a", OLD)
    chip.start()
    chip.confirm()
    chip.lib.terrapin_update_init(chip.update, chip.boot, 0)  # the boot loader serves
    chip.running = 0
    return chip


def _recorded(phase: int) -> Chip:
    """An image in slot B waits for its first start, or was started on trial."""
    chip = _confirmed()
    chip.put("b", NEW)
    record = chip.record()
    record.candidate, record.phase, record.tries = SLOT["b"], phase, 2
    chip.lib.terrapin_records_append(chip.flash, record)
    return chip


def _revoked() -> Chip:
    chip = _confirmed(NEXT_PUBLIC)
    chip.put("a", image("a", "1.0.0", key=NEXT_KEY, revokes=KEY))
    chip.start()
    chip.lib.terrapin_update_init(chip.update, chip.boot, 0)
    return chip


def _full() -> Chip:
    """The page of the records is full: any append would erase the other one."""
    chip = _confirmed()
    for _ in range(0x4000 // 32 - 1):
        chip.lib.terrapin_records_append(chip.flash, chip.record())
    return chip


def _begun(blocks: int) -> Chip:
    """A signed BEGIN, and so many blocks after it."""
    chip, sender = _confirmed(), Sender()
    announce(chip, NEW)
    chip.accept(*sender.frame("UPDATE_BEGIN", BEGIN))
    for index in range(blocks):
        block = NEW[256 * index : 256 * index + 256]
        for frame in data_frames(block):
            chip.accept(*frame)
        chip.accept(*sender.frame("UPDATE_BLOCK", {"index": index, "size": len(block), "checksum": zlib.crc32(block)}))
    return chip


def _refused() -> Chip:
    """An update that ended with an image of a stranger's key."""
    chip, sender = _begun(0), Sender()
    for index in range(-(-len(NEW) // 256)):
        block = image("b", "1.1.0", key=OTHER_KEY)[256 * index : 256 * index + 256]
        for frame in data_frames(block):
            chip.accept(*frame)
        chip.accept(*sender.frame("UPDATE_BLOCK", {"index": index, "size": len(block), "checksum": zlib.crc32(block)}))
    chip.accept(*sender.frame("UPDATE_END", {"checksum": chip.update.checksum}))
    return chip


def _moving() -> Chip:
    chip = _confirmed()
    chip.motor_on = True
    return chip


STATES: dict[str, Callable[[], Chip]] = {
    "blank": _blank,
    "confirmed": _confirmed,
    "pending": lambda: _recorded(PENDING),
    "on trial": lambda: _recorded(TRIAL),
    "key revoked": _revoked,
    "records full": _full,
    "motor on": _moving,
    "begun": lambda: _begun(0),
    "half written": lambda: _begun(2),
    "all written": lambda: _begun(-(-len(NEW) // 256)),
    "refused": _refused,
}
OPEN = ("begun", "half written", "all written")


class _Stranger:
    """Frames whose CRC and counter are right, and that no key stands behind."""

    def __init__(self, rng: random.Random) -> None:
        self.rng, self.counter = rng, 0

    def frames(self, chip: Chip) -> Iterator[Frame]:
        """One request, now and then behind a block, or the end of an image that is not signed."""
        rng = self.rng
        message = rng.choice(REQUESTS)
        if message.name == "UPDATE_BEGIN" and rng.random() < 0.3:
            yield from data_frames(self._tail())
        if message.name == "UPDATE_BLOCK" and rng.random() < 0.3:
            at = int(chip.update.written)
            block = NEW[at : at + 256] if rng.random() < 0.7 else rng.randbytes(256)
            chip.update.filled = 0  # so that none of a stranger's is in its way
            yield from data_frames(block)
        length = message.length if rng.random() < 0.95 else rng.randrange(9)
        data = self._fields(message.name, chip) if rng.random() < 0.7 else rng.randbytes(8)
        if message.e2e:
            self.counter += 1
            data = protect(message.id, data.ljust(8, b"\0"), self.counter)
        yield message.id, data[:length]

    def _fields(self, name: str, chip: Chip) -> bytes:
        """What an honest host would send, or nearly so; UPDATE_ROBOT as it wrote before it was taken away."""
        rng = self.rng
        filled = bytes(chip.ffi.buffer(chip.update.block, min(chip.update.filled, 256)))
        values: dict[str, dict[str, int]] = {
            "UPDATE_BEGIN": BEGIN | {"major": rng.choice((1, 1, 2))} | ({"slot": rng.randrange(4)}),
            "UPDATE_BLOCK": {"index": chip.update.written // 256, "size": len(filled), "checksum": zlib.crc32(filled)},
            "UPDATE_END": {"checksum": rng.choice((int(chip.update.checksum), rng.getrandbits(32)))},
            "UPDATE_QUERY": {"protocol": 2},
            "UPDATE_RESET": {"key": RESET_KEY, "stay": rng.randrange(2)},
        }
        if name == "UPDATE_ROBOT":
            return (rng.getrandbits(24) | 1 << 24).to_bytes(8, "little")
        if name == "UPDATE_DATA":
            return rng.randbytes(8)
        data, _ = interface().messages[name].encode(values[name])
        return bytes(data)

    def _tail(self) -> bytes:
        """The end of an image as nobody with a key made it."""
        good, rng = bytearray(NEW[-TLVS:]), self.rng
        kind = rng.randrange(4)
        if kind == 0:
            return FOREIGN[-TLVS:]
        if kind == 1:
            return bytes(good[:4]) + rng.randbytes(TLVS - 4)
        good[rng.randrange(len(good))] ^= 1 << rng.randrange(8)
        return bytes(good[: rng.choice((TLVS, TLVS - 8))]) if kind == 2 else bytes(good)


@dataclass(frozen=True)
class _Standing:
    """What a frame may not change; `operations` are writes and erases of the flash."""

    operations: int
    active: bool
    reset: bool
    erases: int
    written: int
    verified: bool

    @classmethod
    def of(cls, chip: Chip) -> _Standing:
        u = chip.update
        verified = bool(u.ended and u.end_result == 0)
        return cls(chip.memory.operations, bool(u.active), bool(u.reset), int(u.erases), int(u.written), verified)


def _judged(name: str, frame: Frame, before: _Standing, after: _Standing) -> str:
    """nothing, landed (in the slot that a signature opened), signed (END of what has a good signature) or taken."""
    if after == before:
        return "nothing"
    within = name in OPEN and before.active and (after.reset, after.erases) == (before.reset, before.erases)
    if within and frame[0] == BLOCK:
        return "landed"
    if within and frame[0] == END and not after.active:
        signed = name == "all written" and after.verified
        return "signed" if signed else "landed" if after.operations == before.operations else "taken"
    return "taken"


def _siege(name: str, chip: Chip, stranger: _Stranger, seen: Counter[str]) -> None:
    """TURNS requests to one state, and a start after them."""
    contents, before = chip.contents(), _Standing.of(chip)
    for _ in range(TURNS):
        for frame in stranger.frames(chip):
            chip.accept(*frame)
            seen["tried"] += 1
            after = _Standing.of(chip)
            verdict = _judged(name, frame, before, after)
            seen[verdict] += 1
            seen["erases"] += after.erases - before.erases
            before = after
        chip.update.now_ms += 50
        if before.verified:
            break
    changed = name not in OPEN and chip.contents() != contents
    wanted = "b" if before.verified else {"blank": "", "pending": "b", "on trial": "b"}.get(name, "a")
    seen["taken"] += changed + (chip.start() != wanted)


def attack(count: int, seed: int) -> Result:
    """Frames without a signature to a boot loader: nothing is erased, written, begun, ended or reset."""
    seen, stranger = Counter[str](), _Stranger(random.Random(seed))
    made = {name: make() for name, make in STATES.items()}
    kept = {name: (chip.contents(), bytes(chip.ffi.buffer(chip.update)[:])) for name, chip in made.items()}
    while seen["tried"] < count:
        for name, chip in made.items():
            chip.restore(kept[name][0])
            chip.ffi.buffer(chip.update)[:] = kept[name][1]
            chip.running = 0
            _siege(name, chip, stranger, seen)
    result = Result(
        "boot loader, frames without a signature", seen["tried"], seen["taken"],
        f"{len(STATES)} states, {seen['erases']} erases; {seen['landed']} blocks and ends in an update that a "
        f"signature opened, {seen['signed']} ends of a signed image",
    )  # fmt: skip
    print(result)
    return result


if __name__ == "__main__":
    raise SystemExit(run(attack, 1_000_000))
