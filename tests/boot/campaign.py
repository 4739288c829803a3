"""Mutated images against the boot loader: forged, truncated, reordered, replayed, downgraded. All must be refused.

    python tests/boot/campaign.py [--cases 10000] [--seed 1]

Each case is sent as an update; then, behind the protocol's back, it is put into the slot and asked for as a start
would. Both must be refused. In every tenth case the records say pending and the chip does start: its confirmed image.
Prints the cases of each kind and the reasons given; status 1 when one was taken. BOOT_LIBRARY names another build's
library (the sanitizers').
"""

from __future__ import annotations

import argparse
import hashlib
import random
import sys
from collections import Counter
from collections.abc import Callable

from bootlib import PENDING, SLOT, TLVS, Chip, send
from kit import KEY, OTHER_KEY, PUBLIC, image

from terrapin_tools.flash.keys import key_hash

ORDER = 2**252 + 27742317777372353535851937790883648493
GOOD = image("b", "1.2.0", counter=3)
OLDER = {
    "version": image("b", "1.0.9", counter=2),
    "counter": image("b", "1.3.0", counter=1),
    "both": image("b", "0.9.0", counter=0),
}
OTHER_SLOT = image("a", "1.2.0", counter=3)
SIBLING = image("b", "1.2.0", counter=3, size=664)  # another good image of the same version


def redigest(data: bytes) -> bytes:
    """The digest made good again; the signature is left."""
    body = data[:-TLVS]
    return body + data[-TLVS:][:8] + hashlib.sha256(body).digest() + data[-TLVS + 40 :]


def resign(data: bytes) -> bytes:
    """Digest and signature made good, the latter with another key under the good key's name."""
    data = redigest(data)
    return data[:-64] + OTHER_KEY.sign(data[-TLVS + 8 : -TLVS + 40])


def bits(rng: random.Random, data: bytes) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        bit = rng.randrange(8 * len(out))
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def header(rng: random.Random, data: bytes) -> bytes:
    """A number in the header or in a TLV's head becomes another: an extreme, or a neighbour."""
    end = len(data)
    at, width = rng.choice(
        [(0, 4), (4, 4), (8, 2), (10, 2), (12, 4), (16, 4), (20, 1), (21, 1), (22, 2), (24, 4), (28, 4)]
        + [(end - TLVS - 12 + k, 2) for k in (0, 2, 4, 6)]
        + [(end - TLVS + k, 2) for k in (0, 2, 4, 6, 40, 42, 76, 78)]
    )
    old, top = int.from_bytes(data[at : at + width], "little"), 256**width - 1
    new = rng.choice([0, 1, top, top // 2, top // 2 + 1, old + 1, old - 1, old ^ 4, old * 2, rng.randint(0, top)]) & top
    new = new if new != old else old ^ 1
    return data[:at] + new.to_bytes(width, "little") + data[at + width :]


def truncated(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(1, len(data))]


def longer(rng: random.Random, data: bytes) -> bytes:
    return data + rng.randbytes(rng.randrange(4, 600))


def reordered(rng: random.Random, data: bytes) -> bytes:
    """Two blocks change places, or the TLVs do."""
    if rng.random() < 0.3:
        head, rest = data[: len(data) - TLVS + 4], data[len(data) - TLVS + 4 :]
        parts = [rest[:36], rest[36:72], rest[72:]]
        rng.shuffle(parts)
        return head + b"".join(parts)
    size = rng.choice((1, 4, 8, 16, 64, 256))
    blocks = [data[at : at + size] for at in range(0, len(data), size)]
    i, j = rng.sample(range(len(blocks)), 2)
    blocks[i], blocks[j] = blocks[j], blocks[i]
    return b"".join(blocks)


def spliced(rng: random.Random, data: bytes) -> bytes:
    """The first part of one good image and the rest of another."""
    other = rng.choice([*OLDER.values(), OTHER_SLOT, SIBLING])
    at = rng.randrange(1, min(len(data), len(other)))
    return data[:at] + other[at:] if rng.random() < 0.5 else other[:at] + data[at:]


def replayed(rng: random.Random, data: bytes) -> bytes:
    """A good old image, or a good one for the other slot; or an old one in the header of the new."""
    old = rng.choice([*OLDER.values(), OTHER_SLOT])
    return old if rng.random() < 0.3 else data[: rng.choice((0x20, 0x200))] + old[0x200:]


def downgraded(rng: random.Random, data: bytes) -> bytes:
    """An old image that says that it is new."""
    old = bytearray(OLDER[rng.choice(list(OLDER))])
    old[20:24] = data[20:24]
    if rng.random() < 0.5:
        counter = len(old) - TLVS - 4
        old[counter : counter + 4] = rng.randrange(3, 1000).to_bytes(4, "little")
    return rng.choice([bytes, redigest, resign])(bytes(old))


def forged(rng: random.Random, data: bytes) -> bytes:
    """Changed code with a good digest, and every way to get a signature for it without the key."""
    changed = bytearray(data)
    changed[rng.randrange(0x200, len(data) - TLVS)] ^= rng.randrange(1, 256)
    out = redigest(bytes(changed))
    digest = out[-TLVS + 8 : -TLVS + 40]
    kind = rng.randrange(8)
    if kind == 0:
        return out  # the old signature
    if kind == 1:
        return resign(bytes(changed))
    if kind == 2:  # honestly signed, with another key under its own name
        return (
            out[:-104] + out[-104:-100] + key_hash(OTHER_KEY.public_key())[:32] + out[-68:-64] + OTHER_KEY.sign(digest)
        )
    if kind == 3:
        return out[:-64] + rng.randbytes(64)
    if kind == 4:
        return out[:-64] + SIBLING[-64:]
    if kind == 5:  # R and S of nothing
        return out[:-64] + rng.choice([bytes(64), b"\x01" + bytes(63), b"\xff" * 64, bytes(32) + out[-32:]])
    s = int.from_bytes(data[-32:], "little") + ORDER * rng.randrange(1, 15)  # the good image, S + k L
    if kind == 6:
        return data[:-32] + s.to_bytes(32, "little")
    return data[: len(data) - TLVS] + data[-TLVS:-68] + rng.randbytes(68)


KINDS: dict[str, Callable[[random.Random, bytes], bytes]] = {
    function.__name__: function
    for function in (bits, header, truncated, longer, reordered, spliced, replayed, downgraded, forged)
}  # fmt: skip


def campaign(cases: int, seed: int = 1) -> tuple[Counter[str], Counter[str], list[str]]:
    """How many cases of each kind, how many refusals of each reason, and the names of those that were taken."""
    chip = Chip(PUBLIC)
    chip.put("a", image("a", "1.1.0", counter=2))
    assert chip.start() == "a"
    assert chip.confirm()
    fresh = chip.contents()
    pending = chip.record()
    pending.candidate, pending.phase = SLOT["b"], PENDING
    kinds: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    taken: list[str] = []
    names = list(KINDS)
    for case in range(cases):
        rng = random.Random(seed * 1_000_003 + case)
        kind = names[case % len(names)]
        mutant = KINDS[kind](rng, GOOD)
        if mutant in (GOOD, SIBLING):  # a swap or a splice of equal bytes: not a mutant
            mutant = bits(rng, GOOD)
            kind = "bits"
        kinds[kind] += 1
        version = (1, 2, 0) if len(mutant) < 24 or rng.random() < 0.8 else None
        result = send(chip, mutant, "b", version, GOOD)  # whose end a stranger has recorded
        reasons[result] += 1
        refused = result != "ok" and not chip.record().phase
        chip.put("b", mutant[:0x20000])
        refused &= chip.check("b") != "ok"
        started = "a"
        if case % 10 == 0 or not refused:
            chip.lib.terrapin_records_append(chip.flash, pending)
            started = chip.start()
            chip.restore(fresh)
            chip.start()
        if not refused or started != "a":
            taken.append(f"{kind} {case}: {result}, started {started!r}")
    return kinds, reasons, taken


def main() -> int:
    parser = argparse.ArgumentParser(description="Mutated images against the boot loader.")
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    assert KEY.public_key().public_bytes_raw() == PUBLIC
    chip = Chip(PUBLIC)
    assert send(chip, GOOD, "b") == "ok", "the image that is mutated must itself be good"
    kinds, reasons, taken = campaign(options.cases, options.seed)
    print(f"{kinds.total()} mutated images: " + ", ".join(f"{count} {kind}" for kind, count in kinds.items()))
    print("refused as: " + ", ".join(f"{count} {reason}" for reason, count in reasons.most_common()))
    print(f"taken or started: {len(taken)}")
    for line in taken:
        print(f"  {line}")
    return 1 if taken else 0


if __name__ == "__main__":
    sys.exit(main())
