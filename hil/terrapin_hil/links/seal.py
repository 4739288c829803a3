"""The host's side of a sealed controller (firmware/link/seal.h): key, session, tags.

seal_link(link, LinkKey.read(Path("robot.key")))
link.exchange(frames)                                # sealed from now on
"""

from __future__ import annotations

import secrets
import struct
import time
import tomllib
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil.links.link import LinkError, Sealable
from terrapin_hil.messages import Frame, Message, Sender, interface, protect
from terrapin_hil.reading import ReadingError, owner_alone

__all__ = ["WAY_BACK", "LinkKey", "Session", "chaskey", "open_session", "seal_link", "takes_changes"]

_MASK = 0xFFFFFFFF
SEALED = (
    "PARAMETER_WRITE", "STORE_COMMAND", "TEST_MODE", "NODE_REQUEST", "UPDATE_BEGIN", "UPDATE_END", "UPDATE_RESET"
)  # fmt: skip
TAG_EVERY = 0.01  # s: a controller looks at twenty in 0.1 s (firmware/link/seal.h), half of them for late ones
LONGEST = 10_000  # bytes of a key's file that are looked at
ATTEMPTS, PAUSE = 3, 0.12  # s: a session of somebody else may wait for 0.2 s
UNIT = 0.008  # s of a sealed frame's time; a session has 2,048
SILENT, HALF = 0.9, 8.0  # s without a tag, or since it began, after which a session is left for another one
NO_PARAMETER = 0xFFFF  # an index that none has
BY_A_PROBE = "terrapin flash IMAGE.bin --via swd --boot-loader FILE.bin --link-key LINK.key"
WAY_BACK = f"expected its own key (--link-key), or write a new one beside its boot loader: {BY_A_PROBE}"


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
        """ReadingError when there is none in the file, or when others may read it."""
        try:
            with path.open("rb") as file:
                text = file.read(LONGEST)
                owner_alone(path, file)
            table = tomllib.loads(text.decode("utf-8"))
            found = cls(bytes.fromhex(table["key"]), table["generation"])
        except OSError as error:
            raise ReadingError(f"{path}: cannot read the link key: {error.strerror}") from None
        except ReadingError:
            raise
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ReadingError(f"{path}: no link key; `terrapin keys link {path}` makes one") from None
        if len(found.key) != 16 or type(found.generation) is not int or not 0 < found.generation <= _MASK:
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


def clock() -> float:
    """Seconds of a clock that nobody sets, and that goes on while the machine sleeps where there is such a one."""
    boot = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if boot is None else time.clock_gettime(boot)


class Session:
    """A session with a controller: seals frames with the time since it began, as fast as a controller looks at tags.

    `number`: the controller's, (start, count), never twice under one key. `renewed` opens another one where this one
    may have ended (firmware/link/seal.h): `batches` asks for it before it seals. `now`: seconds.
    """

    def __init__(
        self,
        key: bytes,
        number: tuple[int, int],
        renewed: Callable[[], Session | None] | None = None,
        now: Callable[[], float] = clock,
    ) -> None:
        self._now, self._renewed = now, renewed
        self._begin(key, number)
        self._interface = interface()
        self._command: tuple[bytes, Frame] | None = None  # the last one, and what it became
        self._status = self._interface.messages["STATUS"]
        self._without = 1 << self._interface.faults["command_timeout"]
        self._missing = 0  # that fault, as it was last told
        self._next = 0.0  # s of the monotonic clock, when the next tag may go out
        self._tried = self._began - SILENT  # s of the clock, when it last asked for another session

    def _begin(self, key: bytes, number: tuple[int, int]) -> None:
        self.number, self._key, self._place = number, key, number[1] & 1
        self._began = self._now()
        self._time, self._last = 0, self._began  # units; s of the clock at the last tag
        self._told: float | None = None  # s of the clock, when the controller said something
        self._lost = False  # it may have ended the session while this side went on

    @classmethod
    def answering(
        cls,
        key: LinkKey,
        host: int,
        answer: Mapping[str, int],
        renewed: Callable[[], Session | None] | None = None,
        now: Callable[[], float] = clock,
    ) -> Session:
        """After the answer SESSION to a SESSION_OPEN with the number `host`."""
        start, count = (answer[name] & _MASK for name in ("start", "count"))
        sealing = chaskey(key.key, struct.pack("<4I", host, start, count, key.generation))
        return cls(sealing, (start, count), renewed=renewed, now=now)

    def _renew(self) -> None:
        """Another session, where this one is over soon or may be; this one goes on when none is opened."""
        now = self._now()
        over = self._lost or now - self._last >= SILENT or now - self._began >= HALF
        if not over or self._renewed is None or now - self._tried < SILENT:
            return
        self._tried = now
        other = self._renewed()
        if other is not None:
            self._begin(other._key, other.number)
            self._began = self._last = other._began

    def heard(self, frames: Iterable[Frame]) -> None:
        """What the controller said. When it comes again after SILENT, or has begun to miss commands, it may have ended
        the session, though this side went on: another one is asked for before the next tag."""
        now = self._now()
        for identifier, data in frames:
            self._lost |= self._told is not None and now - self._told >= SILENT
            self._told = now
            if identifier == self._status.id and len(data) == self._status.length:
                before, self._missing = self._missing, self._status.decode(data)["faults"] & self._without
                self._lost |= self._missing > before

    def _tag(self, identifier: int, data: bytes) -> int:
        self._last = self._now()
        self._time = max(self._time + 1, int((self._last - self._began) / UNIT))
        block = struct.pack("<2I", identifier, self._time) + data
        return int.from_bytes(chaskey(self._key, block)[:4], "little")

    def _sealed_command(self, message: Message, data: bytes) -> Frame:
        """The same COMMAND once more is the same frame once more: a fault that is played on the host stays one."""
        if self._command is None or self._command[0] != data:
            values, sealed = message.decode(data), self._interface.messages["COMMAND_SEALED"]
            wanted = {key: values[key] for key in ("request", "control", "limiter", "setpoint")}
            wanted["session"] = self._place
            plain, _ = sealed.encode({**wanted, "time": 0, "tag": 0})
            tag = self._tag(sealed.id, plain[:3] + bytes(5))
            frame = sealed.id, sealed.encode({**wanted, "time": self._time & 0xFF, "tag": tag})[0]
            self._command = data, frame
        return self._command[1]

    def _seal_of(self, frame: Frame) -> Frame:
        identifier, data = frame
        tag = self._tag(identifier, data.ljust(8, b"\0"))
        seal = self._interface.messages["SEAL"]
        values = {"session": self._place, "time": self._time & 0xFF, "tag": tag}
        return seal.id, seal.encode(values)[0]

    def _needs_tag(self, frame: Frame) -> bool:
        """Not what anybody may send, and not what is damaged on purpose."""
        identifier, data = frame
        message = self._interface.by_id.get(identifier)
        if message is None or len(data) != message.length:
            return False
        if message.name == "COMMAND":
            return bool(message.decode(data)["request"]) and protect(identifier, data, data[6] & 0xF) == data
        asks = message.name == "NODE_REQUEST" and not message.decode(data)["action"]
        return message.name in SEALED and not asks

    def _one(self, frame: Frame) -> list[Frame]:
        """What goes out for one frame."""
        if not self._needs_tag(frame):
            return [frame]
        message = self._interface.by_id[frame[0]]
        return [self._sealed_command(message, frame[1])] if message.name == "COMMAND" else [frame, self._seal_of(frame)]

    def sealed(self, frames: Iterable[Frame]) -> list[Frame]:
        """The frames as a controller with a key takes them: a COMMAND but IDLE as COMMAND_SEALED, what changes the
        controller with its SEAL behind it, everything else as it is."""
        return [out for frame in frames for out in self._one(frame)]

    def batches(self, frames: Sequence[Frame]) -> Iterator[list[Frame]]:
        """The same in pieces with one tag each at most. It waits before it makes a tag until that will be looked at."""
        piece: list[Frame] = []
        tagged = False
        for frame in frames:
            if self._needs_tag(frame):
                if tagged:
                    yield piece
                    piece = []
                self._wait()
                self._renew()
                tagged = True
            piece += self._one(frame)
        yield piece

    def _wait(self) -> None:
        wait = self._next - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        self._next = time.monotonic() + TAG_EVERY


def _asked(link: Sealable, make: Callable[[], Frame], wanted: Callable[[Frame], bool]) -> Frame | None:
    """The answer to a question that may have to be put more than once."""
    for attempt in range(ATTEMPTS):
        if attempt:
            time.sleep(PAUSE)
        found = link.ask(make(), wanted)
        if found is not None:
            return found
    return None


def _session(link: Sealable, key: LinkKey, now: Callable[[], float]) -> Session | None:
    messages = interface().messages
    number = secrets.randbits(32)  # the same each time: an answer may be that to the question before
    data, _ = messages["SESSION_OPEN"].encode({"host": number, "generation": key.generation})
    answer = _asked(link, lambda: (messages["SESSION_OPEN"].id, data), lambda frame: frame[0] == messages["SESSION"].id)
    if answer is None:
        return None
    told = messages["SESSION"].decode(answer[1])
    return Session.answering(key, number, told, lambda: _session(link, key, now), now)


def open_session(link: Sealable, key: LinkKey, now: Callable[[], float] = clock) -> Session:
    """A session with the controller behind a link; whether the key is right shows with its first tag. `now`: seconds,
    of a clock that runs as the controller's does. LinkError when it opens none."""
    session = _session(link, key, now)
    if session is None:
        raise LinkError(
            f"{link.name}: the controller opens no session for link key {key.fingerprint}, generation "
            f"{key.generation}: found none or another generation there (PORT_LINK tells), or no random numbers on a "
            f"chip without its crystal; {WAY_BACK}"
        )
    return session


def takes_changes(link: Sealable) -> bool:
    """Whether the controller takes what changes it, as the link sends it now: asked by a write to a parameter that does
    not exist."""
    value, sender = interface().messages["PARAMETER_VALUE"], Sender()

    def wanted(frame: Frame) -> bool:
        return (
            frame[0] == value.id
            and len(frame[1]) == value.length
            and value.decode(frame[1])["index"] & 0xFFFF == NO_PARAMETER
        )

    return _asked(link, lambda: sender.frame("PARAMETER_WRITE", {"index": NO_PARAMETER}), wanted) is not None


def seal_link(link: Sealable, key: LinkKey) -> Session:
    """From now on what the link sends is sealed with this key. LinkError, one line with the way back, when the
    controller has none or another."""
    session = _session(link, key, clock)
    if session is None and takes_changes(link):
        raise LinkError(
            f"{link.name}: the controller has no link key and takes commands of anybody, expected one with key "
            f"{key.fingerprint}; leave the key out, or write it beside the boot loader: {BY_A_PROBE}"
        )
    link.session = session or open_session(link, key)
    if not takes_changes(link):
        link.session = None
        raise LinkError(f"{link.name}: wrong link key {key.fingerprint}: the controller has another; {WAY_BACK}")
    assert isinstance(link.session, Session)
    return link.session
