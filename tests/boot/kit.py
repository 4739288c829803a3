"""Keys and images of the boot loader's tests: the same in every run."""

from __future__ import annotations

import hashlib
import struct

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from terrapin_tools.flash.image import Version, sign
from terrapin_tools.flash.layout import SLOTS

KEY = Ed25519PrivateKey.from_private_bytes(hashlib.sha256(b"key of the tests").digest())
PUBLIC = KEY.public_key().public_bytes_raw()
OTHER_KEY = Ed25519PrivateKey.from_private_bytes(hashlib.sha256(b"another key").digest())
NEXT_KEY = Ed25519PrivateKey.from_private_bytes(hashlib.sha256(b"the key after it").digest())
NEXT_PUBLIC = NEXT_KEY.public_key().public_bytes_raw()


def code(slot: str, size: int, seed: str = "") -> bytes:
    """Vectors that point into the slot, then bytes that depend on `seed`."""
    vectors = struct.pack("<II", 0x2002_0000, SLOTS[slot] + 0x200 + 0x41)
    noise = hashlib.shake_256(f"{slot} {seed}".encode()).digest(size - len(vectors))
    return vectors + noise


def image(
    slot: str,
    version: str,
    counter: int = 1,
    size: int = 600,
    key: Ed25519PrivateKey = KEY,
    revokes: Ed25519PrivateKey | None = None,
) -> bytes:
    revoked = revokes.public_key() if revokes else None
    return sign(code(slot, size, version), key, Version.of(version), counter, slot, revokes=revoked)
