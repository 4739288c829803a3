"""Signed images in MCUboot's format: made, read, verified. The same bytes as

    imgtool sign -k KEY.pem -v VERSION -s COUNTER -H 0x200 --pad-header -S 0x20000 -F ADDRESS --align 4

Header (0x200 bytes), code, protected TLVs (security counter; where they are needed, kind, unit, revoked key and
replaced robot), TLVs: SHA-256, key hash, Ed25519 signature of the SHA-256. What the boot loader asks of an image is in
firmware/boot/image.h; `parse` asks the same.
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from terrapin_tools.errors import UserError
from terrapin_tools.flash.keys import key_hash
from terrapin_tools.flash.layout import HEADER_SIZE, RAM, SLOT_SIZE, SLOTS, slot_at

__all__ = [
    "Image",
    "ImageError",
    "Version",
    "code_slot",
    "intact",
    "kind_of",
    "parse",
    "read_start",
    "sign",
    "sign_again",
    "verify",
]

MAGIC = 0x96F3B83D
ROM_FIXED = 0x100
PROTECTED, PLAIN = 0x6908, 0x6907
KEY_HASH, SHA256, ED25519, SECURITY_COUNTER = 0x01, 0x10, 0x24, 0x50
KIND, UNIT, MADE_FOR, INTERFACE, REVOKES, REPLACES = 0xA0, 0xA1, 0xA2, 0xA3, 0xA4, 0xA5
KINDS = ("desk", "production")
MARK = b"terrapin-kind\0\0\0"  # stands before the kind in the code (terrapin_image_mark of link/dispatch.h)
_HEADER = struct.Struct("<IIHHIIBBHI4x")
MADE = b"terrapin-made\0\0\0"  # stands before what the code is made for (main.c of the STM32F405)
SIGNED_TLVS = ((SHA256, 32), (KEY_HASH, 32), (ED25519, 64))


class ImageError(ValueError):
    """These bytes are no image that the boot loader would take; the message says what is wrong."""


@dataclass(frozen=True, order=True)
class Version:
    """Of an image: major.minor.revision+build."""

    major: int
    minor: int
    revision: int
    build: int = 0

    @classmethod
    def of(cls, text: str) -> Version:
        """ValueError when the text is no version.

        >>> Version.of("1.2.3")
        Version(major=1, minor=2, revision=3, build=0)
        """
        found = re.fullmatch(r"(\d{1,3})\.(\d{1,3})\.(\d{1,5})(?:\+(\d{1,10}))?", text, re.ASCII)
        numbers = [int(part or 0) for part in found.groups()] if found else [256]
        if any(number > limit for number, limit in zip(numbers, (255, 255, 65535, 2**32 - 1), strict=False)):
            raise ValueError(f"version {text!r}: expected MAJOR.MINOR.REVISION[+BUILD], at most 255.255.65535")
        return cls(*numbers)

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.revision}" + (f"+{self.build}" if self.build else "")


@dataclass(frozen=True)
class Image:
    """What an image says about itself. `signature` is None when it is not signed."""

    version: Version
    slot: str
    security_counter: int
    code_size: int  # bytes
    hashed: bytes
    digest: bytes
    key_hash: bytes | None
    signature: bytes | None
    size: int  # bytes, of all
    kind: str = "desk"
    unit: int | None = None  # the chip that it names
    robot: int = 0  # robot_identity that it is made for,
    board: int = 0  # board,
    interface: int = 0  # and version of the interface; each 0 when it does not say
    replaces: int = 0  # robot_identity whose controller it may become the image of, 0: none
    revokes: bytes = b""  # first four bytes of the hash of a key that counts no more once it is confirmed


def read_start(path: Path) -> bytes:
    """A file of code or an image: what a slot takes of it, and a byte more when there is more. UserError."""
    try:
        with path.open("rb") as file:
            return file.read(SLOT_SIZE + 1)
    except OSError as error:
        raise UserError(f"{path}: cannot read: {error.strerror}") from None


def code_slot(code: bytes) -> str | None:
    """The slot that code is linked for, by its reset vector; None when there is no such vector.

    ImageError when it is an image already (which would be wrapped again, and never run), or not a program's start.
    """
    stack, reset = (int.from_bytes(code[at : at + 4], "little") for at in (0, 4))
    if stack == MAGIC:
        raise ImageError("an image already, expected code: the .bin that the linker made")
    slot = slot_at(reset) if len(code) >= 8 else None
    # A reset vector of Thumb code is odd, and points behind the header, into the code.
    if slot and not (stack in RAM and reset % 2 and HEADER_SIZE <= reset - SLOTS[slot] < HEADER_SIZE + len(code)):
        raise ImageError(f"no program: it would begin at 0x{reset:08x} with its stack at 0x{stack:08x}")
    return slot


def _tlv(kind: int, value: bytes) -> bytes:
    return struct.pack("<HH", kind, len(value)) + value


def kind_of(code: bytes) -> str:
    """desk or production, as the code says; what says nothing is no production image.

    >>> kind_of(MARK + bytes([1, 0, 0, 0]))
    'production'
    """
    at = code.find(MARK)
    return "production" if at >= 0 and code[at + len(MARK) :][:4] == b"\1\0\0\0" else "desk"


def made_for(code: bytes) -> tuple[int, int, int]:
    """Robot, board and version of the interface that code is made for, as it says; zeros when it does not.

    >>> made_for(MADE + struct.pack("<II", 0x1000007, 1))
    (7, 1, 1)
    """
    at = code.find(MADE)
    said = code[at + len(MADE) :][:8]
    if at < 0 or len(said) < 8:
        return 0, 0, 0
    who, interface = struct.unpack("<II", said)
    return who & 0xFFFFFF, who >> 24, interface


def sign(
    code: bytes,
    key: Ed25519PrivateKey,
    version: Version,
    security_counter: int,
    slot: str,
    unit: int | None = None,
    revokes: Ed25519PublicKey | None = None,
    replaces: int = 0,
) -> bytes:
    """The image of `code`, linked for `slot`; `unit`: the chip on which a release boot loader takes it although it is a
    desk image; `revokes`: the key that the boot loader takes no more once the image is confirmed; `replaces`: the
    robot_identity of a robot whose controller takes it and becomes that of the code's robot. ImageError when it does
    not fit, would revoke the key that signs it, or replaces a robot and names none."""
    tlvs = _tlv(SECURITY_COUNTER, struct.pack("<I", security_counter))
    if kind_of(code) == "production":
        tlvs += _tlv(KIND, bytes([KINDS.index("production")]))
    robot, board, interface = made_for(code)
    if robot:
        tlvs += _tlv(MADE_FOR, struct.pack("<I", robot | board << 24)) + _tlv(INTERFACE, struct.pack("<I", interface))
    if unit is not None:
        tlvs += _tlv(UNIT, struct.pack("<I", unit))
    if revokes is not None:
        if key_hash(revokes) == key_hash(key.public_key()):
            raise ImageError("would revoke the key that signs it, expected another one")
        tlvs += _tlv(REVOKES, key_hash(revokes)[:4])
    if replaces:
        if not robot:
            raise ImageError("does not say which robot it is made for, expected that of one which replaces another")
        tlvs += _tlv(REPLACES, struct.pack("<I", replaces))
    protected = struct.pack("<HH", PROTECTED, 4 + len(tlvs)) + tlvs
    header = _HEADER.pack(
        MAGIC, SLOTS[slot], HEADER_SIZE, len(protected), len(code), ROM_FIXED,
        version.major, version.minor, version.revision, version.build,
    )  # fmt: skip
    hashed = header.ljust(HEADER_SIZE, b"\xff") + code + protected
    digest = hashlib.sha256(hashed).digest()
    tlvs = _tlv(SHA256, digest) + _tlv(KEY_HASH, key_hash(key.public_key())) + _tlv(ED25519, key.sign(digest))
    image = hashed + struct.pack("<HH", PLAIN, 4 + len(tlvs)) + tlvs
    if not code or len(image) > SLOT_SIZE:
        raise ImageError(f"{len(code)} bytes of code, expected 1 to {SLOT_SIZE - (len(image) - len(code))}")
    return image


def sign_again(data: bytes, key: Ed25519PrivateKey, revokes: Ed25519PublicKey) -> bytes:
    """The image in `data`, signed with `key` in the place of its own, which it revokes. ImageError when it is none."""
    old = parse(data)
    code = data[HEADER_SIZE : HEADER_SIZE + old.code_size]
    return sign(code, key, old.version, old.security_counter, old.slot, old.unit, revokes, old.replaces)


def _tlvs(data: bytes, offset: int, magic: int, what: str) -> tuple[list[tuple[int, bytes]], int]:
    """The TLVs of the area at `offset` and the offset behind it."""
    if len(data) < offset + 4 or int.from_bytes(data[offset : offset + 2], "little") != magic:
        raise ImageError(f"no {what} behind the code: cut off, or not an image")
    end = offset + int.from_bytes(data[offset + 2 : offset + 4], "little")
    found, place = [], offset + 4
    while place < end <= len(data) and place + 4 <= end:
        kind, length = struct.unpack_from("<HH", data, place)
        found.append((kind, data[place + 4 : place + 4 + length]))
        place += 4 + length
    if place != end:
        raise ImageError(f"the {what} do not end where they say: cut off")
    return found, end


def parse(data: bytes) -> Image:
    """What `data` says about itself: its form is checked, no digest and no signature. ImageError."""
    if len(data) < HEADER_SIZE or int.from_bytes(data[:4], "little") != MAGIC:
        raise ImageError("not an image (no MCUboot header); `terrapin image sign` makes one of code")
    if len(data) > SLOT_SIZE:
        raise ImageError(f"more than the {SLOT_SIZE} bytes of a slot")
    _, address, header_size, protected_size, code_size, flags, *numbers = _HEADER.unpack_from(data)
    if header_size != HEADER_SIZE:
        raise ImageError(f"header of {header_size} bytes, expected {HEADER_SIZE}")
    slot = next((name for name, start in SLOTS.items() if start == address), None)
    if flags != ROM_FIXED or slot is None:
        raise ImageError(f"not fixed to a slot (flags 0x{flags:x}, address 0x{address:08x})")
    code_end = HEADER_SIZE + code_size
    protected, hashed_size = _tlvs(data, code_end, PROTECTED, "protected TLVs")
    counters = [value for kind, value in protected if kind == SECURITY_COUNTER and len(value) == 4]
    if hashed_size != code_end + protected_size or len(counters) != 1:
        raise ImageError("no security counter")
    more = {
        kind: int.from_bytes(value, "little")
        for kind, value in protected
        if kind in (KIND, UNIT, MADE_FOR, INTERFACE, REVOKES, REPLACES)
    }
    tlvs, end = _tlvs(data, hashed_size, PLAIN, "TLVs")
    values = dict(tlvs)
    signed = tuple((kind, len(value)) for kind, value in tlvs) == SIGNED_TLVS
    if SHA256 not in values:
        raise ImageError("no SHA-256")
    if data[end:].strip(b"\xff"):
        raise ImageError(f"{len(data) - end} bytes follow the image")
    return Image(
        version=Version(*numbers),
        slot=slot,
        security_counter=int.from_bytes(counters[0], "little"),
        code_size=code_size,
        hashed=data[:hashed_size],
        digest=values[SHA256],
        key_hash=values[KEY_HASH] if signed else None,
        signature=values[ED25519] if signed else None,
        size=end,
        kind="production" if more.get(KIND) == KINDS.index("production") else "desk",
        unit=more.get(UNIT),
        robot=more.get(MADE_FOR, 0) & 0xFFFFFF,
        board=more.get(MADE_FOR, 0) >> 24,
        interface=more.get(INTERFACE, 0),
        replaces=more.get(REPLACES, 0),
        revokes=more[REVOKES].to_bytes(4, "little") if REVOKES in more else b"",
    )


def intact(image: Image) -> None:
    """ImageError unless the digest fits, which needs no key."""
    if hashlib.sha256(image.hashed).digest() != image.digest:
        raise ImageError("corrupted: its SHA-256 does not fit")


def verify(image: Image, key: Ed25519PublicKey) -> None:
    """ImageError unless digest, key and signature are good."""
    intact(image)
    if image.signature is None or image.key_hash is None:
        raise ImageError("not signed with Ed25519")
    if image.key_hash != key_hash(key):
        raise ImageError(f"signed with another key ({image.key_hash[:4].hex()}, expected {key_hash(key)[:4].hex()})")
    try:
        key.verify(image.signature, image.digest)
    except InvalidSignature:
        raise ImageError("its signature is forged") from None
