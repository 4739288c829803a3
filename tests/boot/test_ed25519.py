"""Ed25519 of the boot loader: RFC 8032's vectors, and the same answers as the package `cryptography`."""

from __future__ import annotations

import hashlib

import pytest
from bootlib import library
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from hypothesis import given, settings
from hypothesis import strategies as st

P = 2**255 - 19
ORDER = 2**252 + 27742317777372353535851937790883648493

# RFC 8032, 7.1: tests 1, 2, 3, SHA(abc): public key, message, signature.
VECTORS = [
    ("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a", "",
     "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b"),
    ("3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c", "72",
     "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00"),
    ("fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025", "af82",
     "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a"),
    ("ec172b93ad5e563bf4932c70e1245034c35467ef2efd4d64ebf819683467e2bf",
     "ddaf35a193617abacc417349ae20413112e6fa4e89a97ea20a9eeee64b55d39a2192992a274fc1a836ba3c23a3feebbd454d4423643ce80e2a9ac94fa54ca49f",
     "dc2a4459e7369633a52b1bf277839a00201009a3efbf3ecb69bea2186c26b58909351fc9ac90b3ecfdfbc7c66431e0303dca179c138ac17ad9bef1177331a704"),
]  # fmt: skip

# The eight points of small order, y canonical, both signs of x where there are two; and encodings not canonical.
SMALL_ORDER = [
    "0100000000000000000000000000000000000000000000000000000000000000",
    "ecffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff7f",
    "0000000000000000000000000000000000000000000000000000000000000000",
    "0000000000000000000000000000000000000000000000000000000000000080",
    "c7176a703d4dd84fba3c0b760d10670f2a2053fa2c39ccc64ec7fd7792ac037a",
    "c7176a703d4dd84fba3c0b760d10670f2a2053fa2c39ccc64ec7fd7792ac03fa",
    "26e8958fc2b227b045c3f489f2ef98f0d5dfac05d3c63339b13802886d53fc05",
    "26e8958fc2b227b045c3f489f2ef98f0d5dfac05d3c63339b13802886d53fc85",
]
NOT_CANONICAL = [(P + offset | sign << 255).to_bytes(32, "little").hex() for offset in range(19) for sign in (0, 1)] + [
    "0100000000000000000000000000000000000000000000000000000000000080",
    (P - 1 | 1 << 255).to_bytes(32, "little").hex(),
]


def ours(key: bytes, signature: bytes, message: bytes) -> bool:
    _, lib = library()
    return bool(lib.terrapin_ed25519_verify(key, signature, message, len(message)))


def theirs(key: bytes, signature: bytes, message: bytes) -> bool:
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, message)
    except InvalidSignature:
        return False
    return True


@pytest.mark.parametrize(("key", "message", "signature"), VECTORS)
def test_rfc8032(key: str, message: str, signature: str) -> None:
    good = bytes.fromhex(signature)
    assert ours(bytes.fromhex(key), good, bytes.fromhex(message))
    assert not ours(bytes.fromhex(key), good, bytes.fromhex(message) + b"x")
    for bit in range(0, 512, 7):
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        assert not ours(bytes.fromhex(key), bytes(bad), bytes.fromhex(message)), bit


@settings(max_examples=300, derandomize=True, deadline=None, database=None)
@given(seed=st.binary(min_size=32, max_size=32), message=st.binary(max_size=300), data=st.data())
def test_same_answer_as_cryptography(seed: bytes, message: bytes, data: st.DataObject) -> None:
    """Good signatures, and every one of key, R, S and message changed by bits, bytes or multiples of the order."""
    private = Ed25519PrivateKey.from_private_bytes(seed)
    key, signature = private.public_key().public_bytes_raw(), private.sign(message)
    assert ours(key, signature, message)
    kind = data.draw(st.sampled_from(["bit of key", "bit of signature", "S + k L", "R", "S", "message"]))
    if kind == "bit of key":
        bit = data.draw(st.integers(0, 255))
        key = (int.from_bytes(key, "little") ^ 1 << bit).to_bytes(32, "little")
    elif kind == "bit of signature":
        bit = data.draw(st.integers(0, 511))
        signature = (int.from_bytes(signature, "little") ^ 1 << bit).to_bytes(64, "little")
    elif kind == "S + k L":
        s = int.from_bytes(signature[32:], "little") + ORDER * data.draw(st.integers(1, 14))
        signature = signature[:32] + s.to_bytes(32, "little")
    elif kind == "R":
        signature = data.draw(st.binary(min_size=32, max_size=32)) + signature[32:]
    elif kind == "S":
        signature = signature[:32] + data.draw(st.binary(min_size=32, max_size=32))
    else:
        message += b"\0"
    assert ours(key, signature, message) == theirs(key, signature, message)


def test_non_canonical_s_is_refused() -> None:
    private = Ed25519PrivateKey.from_private_bytes(bytes(32))
    key, signature = private.public_key().public_bytes_raw(), private.sign(b"m")
    s = int.from_bytes(signature[32:], "little")
    for k in range(1, 16):
        if s + k * ORDER < 2**256:
            assert not ours(key, signature[:32] + (s + k * ORDER).to_bytes(32, "little"), b"m"), k


@pytest.mark.parametrize("encoding", SMALL_ORDER + NOT_CANONICAL)
def test_bad_public_keys_are_refused(encoding: str) -> None:
    """Under a key of small order R = S B holds for one message in eight at least: so many messages would find it."""
    key = bytes.fromhex(encoding)
    for s in (0, 1):
        base = bytes([1, *bytes(31)]) if s == 0 else (4 * pow(5, P - 2, P) % P).to_bytes(32, "little")
        for message in range(24):
            signature = base + s.to_bytes(32, "little")
            assert not ours(key, signature, bytes([message])), message


def test_the_small_keys_would_be_accepted_without_that_rule() -> None:
    """The test above can fail: OpenSSL accepts such a signature under at least half of these keys."""
    accepted = [
        key
        for key in SMALL_ORDER
        if any(theirs(bytes.fromhex(key), bytes([1, *bytes(63)]), bytes([m])) for m in range(64))
    ]
    assert len(accepted) >= len(SMALL_ORDER) // 2


def test_small_order_r_is_compared_like_any_other() -> None:
    private = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
    key, signature = private.public_key().public_bytes_raw(), private.sign(b"m")
    for r in SMALL_ORDER + NOT_CANONICAL:
        assert not ours(key, bytes.fromhex(r) + signature[32:], b"m")


def test_points_that_are_not_on_the_curve() -> None:
    """Half of all y have no x: the decoder says so, like the other implementation, for 200 of them."""
    private = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
    signature = private.sign(b"m")
    for n in range(200):
        key = hashlib.sha256(n.to_bytes(2, "little")).digest()
        assert ours(key, signature, b"m") == theirs(key, signature, b"m")


def test_sha2() -> None:
    ffi, lib = library()
    for length in [*range(260), 1000]:
        text = hashlib.shake_128(b"text").digest(length)
        for kind, name in ((0, "sha256"), (1, "sha512")):
            hash_ = ffi.new("terrapin_sha2 *")
            digest = ffi.new("uint8_t[65]", b"\xa5" * 65)
            lib.terrapin_sha2_begin(hash_, kind)
            lib.terrapin_sha2_take(hash_, text[: length // 3], length // 3)
            lib.terrapin_sha2_take(hash_, text[length // 3 :], length - length // 3)
            lib.terrapin_sha2_end(hash_, digest)
            assert bytes(digest) == hashlib.new(name, text).digest().ljust(65, b"\xa5")  # and nothing behind it
