"""The host's side of a sealed controller (firmware/link/seal.h): key, session, tags.

session = open_session(link, LinkKey.read(Path("robot.key")))
link.exchange(session.sealed(frames))
"""

from __future__ import annotations

import secrets
import struct
import tomllib
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil.links.link import Link, LinkError
from terrapin_hil.messages import Frame, Interface, interface
from terrapin_hil.reading import ReadingError

__all__ = ["LinkKey", "Session", "chaskey", "open_session"]

_MASK = 0xFFFFFFFF
SEALED = (
    "PARAMETER_WRITE", "STORE_COMMAND", "TEST_MODE", "NODE_REQUEST", "UPDATE_BEGIN", "UPDATE_END", "UPDATE_RESET"
)  # fmt: skip


def _rotated(value: int, by: int) -> int:
    return (value << by | value >> (32 - by)) & _MASK


def chaskey(key: bytes, block: bytes) -> bytes:
    """Chaskey-12 of one block: key, message and tag have 16 bytes each (Mouha et al., SAC 2014; ISO/IEC 29192-6)."""
    k = struct.unpack("<4I", key)
    carry = 0x87 if k[3] >> 31 else 0
    mask = [(k[0] << 1 & _MASK) ^ carry, *((k[i] << 1 & _MASK) | k[i - 1] >> 31 for i in (1, 2, 3))]
    a, b, c, d = (x ^ y ^ z for x, y, z in zip(k, struct.unpack("<4I", block), mask, strict=True))
    for _ in range(12):
        a = (a + b) & _MASK
        b = _rotated(b, 5) ^ a
        a = _rotated(a, 16)
        c = (c + d) & _MASK
        d = _rotated(d, 8) ^ c
        a = (a + d) & _MASK
        d = _rotated(d, 13) ^ a
        c = (c + b) & _MASK
        b = _rotated(b, 7) ^ c
        c = _rotated(c, 16)
    return struct.pack("<4I", *(x ^ y for x, y in zip((a, b, c, d), mask, strict=True)))


@dataclass(frozen=True)
class LinkKey:
    """16 secret bytes that a controller and its operators share, and how many came before them."""

    key: bytes
    generation: int  # from 1

    @classmethod
    def read(cls, path: Path) -> LinkKey:
        """ReadingError when there is none in the file."""
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))
            found = cls(bytes.fromhex(table["key"]), table["generation"])
        except OSError as error:
            raise ReadingError(f"{path}: cannot read the link key: {error.strerror}") from None
        except (ValueError, KeyError, TypeError):
            raise ReadingError(f"{path}: no link key; `terrapin keys link {path}` makes one") from None
        if len(found.key) != 16 or not isinstance(found.generation, int) or not 0 < found.generation <= _MASK:
            raise ReadingError(f"{path}: expected a key of 16 bytes and its generation from 1")
        return found

    def text(self) -> str:
        """What stands in a file."""
        note = "# The link key of a Terrapin controller: keep it secret."
        return f'{note}\ngeneration = {self.generation}\nkey = "{self.key.hex()}"\n'

    @classmethod
    def new(cls, generation: int = 1) -> LinkKey:
        """A key that nobody had before."""
        return cls(secrets.token_bytes(16), generation)

    def block(self) -> bytes:
        """What stands beside the boot loader (firmware/ports/stm32f405/link_key.h): mark, generation, key, CRC-32."""
        words = struct.pack("<4sI16s", b"LKEY", self.generation, self.key)
        return words + struct.pack("<I", zlib.crc32(words))

    @property
    def fingerprint(self) -> str:
        """8 hexadecimal digits that tell this key from others and nothing about it."""
        return chaskey(self.key, b"fingerprint\0\0\0\0\0")[:4].hex()


class Session:
    """A session with a controller: seals frames, and counts them."""

    def __init__(self, key: bytes, description: Interface | None = None) -> None:
        self._key = key
        self._counter = 0
        self._interface = description or interface()

    @classmethod
    def answering(cls, key: LinkKey, host: int, answer: Mapping[str, int]) -> Session:
        """After the answer SESSION to a SESSION_OPEN with the number `host`."""
        numbers = struct.pack("<4I", host, answer["start"], answer["count"], key.generation)
        return cls(chaskey(key.key, numbers))

    def _tag(self, identifier: int, data: bytes) -> int:
        block = struct.pack("<2I", identifier, self._counter) + data
        return int.from_bytes(chaskey(self._key, block)[:4], "little")

    def sealed(self, frames: Iterable[Frame]) -> list[Frame]:
        """The frames as a controller with a key takes them: a COMMAND but IDLE as COMMAND_SEALED, what changes the
        controller with its SEAL behind it, everything else as it is."""
        messages = self._interface.messages
        out: list[Frame] = []
        for identifier, data in frames:
            message = self._interface.by_id.get(identifier)
            name = message.name if message is not None else ""
            if name == "COMMAND" and message is not None and (values := message.decode(data))["request"]:
                self._counter += 1
                sealed = messages["COMMAND_SEALED"]
                wanted = {key: values[key] for key in ("request", "control", "limiter", "setpoint")}
                plain, _ = sealed.encode({**wanted, "counter": 0, "tag": 0})
                tag = self._tag(sealed.id, plain[:3] + bytes(5))
                out.append((sealed.id, sealed.encode({**wanted, "counter": self._counter & 0xFF, "tag": tag})[0]))
            elif name in SEALED:
                self._counter += 1
                tag = self._tag(identifier, data.ljust(8, b"\0"))
                values = {"message": identifier & 0xFF, "counter": self._counter & 0xFFFF, "tag": tag}
                out += [(identifier, data), (messages["SEAL"].id, messages["SEAL"].encode(values)[0])]
            else:
                out.append((identifier, data))
        return out


def open_session(link: Link, key: LinkKey) -> Session:
    """A session with the controller behind a link. LinkError when it opens none."""
    messages = interface().messages
    number = secrets.randbits(32)
    data, _ = messages["SESSION_OPEN"].encode({"host": number, "generation": key.generation})
    answer = link.ask((messages["SESSION_OPEN"].id, data), lambda frame: frame[0] == messages["SESSION"].id)
    if answer is None:
        raise LinkError(
            f"{link.name}: it opens no session for link key {key.fingerprint}, generation {key.generation}: "
            "the controller has another generation or no key (PORT_LINK tells), or opened one less than 0.2 s ago"
        )
    return Session.answering(key, number, messages["SESSION"].decode(answer[1]))
