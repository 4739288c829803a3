"""A gateway that has all sealed traffic, and withholds, reorders or repeats it: nothing is taken after its stated age.

Host (terrapin_hil.links.seal) and controller (firmware/link/seal.c) are the real ones, on a clock that is counted here.
An honest gateway that loses 5 % and takes up to 200 ms each way is there too: of what it brings nothing may be refused.
"""

from __future__ import annotations

import random
import struct
from collections import deque
from collections.abc import Callable, Iterator
from unittest import mock

from terrapin_hil.links import seal
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.seal import LinkKey, Session, open_session
from terrapin_hil.messages import Frame, Sender, interface
from tests.attack import Result, run

__all__ = ["Keyed", "attack"]

COUNT, SHORT = 10_000, 600
AGE = 1000  # ms that a sealed frame may be old (firmware/link/seal.h)
DAY = 86_400_000
DELAY, LOST = 200, 0.05  # of the honest gateway: ms each way, share
ANSWER = 450  # ms that a host waits for an answer behind it
STARTS = (0, 1, 0xFFFF_F000, 0x7FFF_FFFF)  # ms: clocks wrap


class Keyed(InProcess):
    """A controller with the key, whose clock is set here."""

    def __init__(self, key: LinkKey, start: int, begin: int = 0) -> None:
        super().__init__()
        self.ms = begin  # without an end; the controller's clock has its low 32 bits
        self._words = self._ffi.new("uint32_t[4]", list(struct.unpack("<4I", key.key)))
        self._lib.terrapin_link_seal(self._link, self._words, key.generation, start)
        self.later(0)

    def seconds(self) -> float:
        return self.ms / 1000

    def later(self, ms: int) -> None:
        """Some time, told as a port does: at least once in 49 days."""
        self.ms += ms
        self._lib.terrapin_seal_at(self._ffi.addressof(self._link, "seal"), self.ms & 0xFFFFFFFF)

    def taken(self, frames: list[Frame]) -> bool:
        """Whether any of them is taken: a command, or a write that is answered."""
        self._inputs.command_fresh = False
        answers = [answer for frame in frames for answer in self._take(self._native(frame))]
        return bool(self._inputs.command_fresh) or bool(answers)


Sent = tuple[int, list[Frame]]  # ms when it was sealed; a COMMAND_SEALED, or what is written and its SEAL


class _Host:
    """An operator who drives and writes, behind a link of which every frame is known."""

    def __init__(self, link: Keyed, key: LinkKey, rng: random.Random) -> None:
        self.link, self.rng, self.sender = link, rng, Sender()
        self.session: Session = open_session(link, key, link.seconds)

    def sends(self) -> Sent:
        if self.rng.random() < 0.7:
            frame = self.sender.frame("COMMAND", {"request": 2, "setpoint": self.rng.randint(-2000, 2000)})
        else:
            frame = self.sender.frame("PARAMETER_WRITE", {"index": seal.NO_PARAMETER, "value": 1})
        return self.link.ms, self.session.sealed([frame])


def _withheld(count: int, rng: random.Random) -> Result:
    """A session runs; from some frame on the gateway keeps all, and lets them go 1 s to a day later, some of them more
    than once, in any order. It may ask for sessions meanwhile."""
    tried = taken = oldest = 0
    while tried < count:
        key = LinkKey(rng.randbytes(16), rng.randint(1, 9))
        link = Keyed(key, rng.getrandbits(32), rng.choice(STARTS))
        host = _Host(link, key, rng)
        for _ in range(rng.randint(1, 40)):
            link.later(50)
            link.taken(host.sends()[1])
        kept = []
        for _ in range(rng.randint(1, 12)):
            link.later(50)
            kept.append(host.sends())
        link.later(round(1001 * (DAY / 1001) ** rng.random()))
        order = rng.choice(("as they came", "backwards", "at random"))
        again = kept + rng.choices(kept, k=3) if order == "at random" else kept[:: -1 if order == "backwards" else 1]
        if rng.random() < 0.3:
            link.taken([_open(key, rng.getrandbits(32))])
        for at, frames in again:
            link.later(rng.choice((0, 5, 10)))
            tried += 1
            if link.taken(frames) and link.ms - at > AGE:
                taken, oldest = taken + 1, max(oldest, link.ms - at)
    return Result("sealed frames withheld for 1 s to a day", tried, taken, f"oldest {oldest} ms" if taken else "")


def _open(key: LinkKey, host: int) -> Frame:
    message = interface().messages["SESSION_OPEN"]
    return message.id, message.encode({"host": host, "generation": key.generation})[0]


def _ahead(count: int, rng: random.Random) -> Result:
    """The gateway answers for the controller, with what SESSION may say next, and replays what the host then seals when
    the controller has such a session: all that it knows is what was said before."""
    message, taken = interface().messages["SESSION"], 0
    for _ in range(count):
        key = LinkKey(rng.randbytes(16), 1)
        link = Keyed(key, rng.getrandbits(32))
        told = []
        for _ in range(rng.randint(1, 3)):
            (answer,) = link._take(link._native(_open(key, 1)))
            told.append(message.decode(answer[1]))
            link.later(2500)
        guess = {"start": rng.choice(told)["start"], "count": told[-1]["count"] + rng.choice((2, 3))}
        early = Session.answering(key, 7, guess, now=link.seconds)
        frames = early.sealed([Sender().frame("COMMAND", {"request": 2})])
        link.later(rng.randint(2000, DAY))
        link._take(link._native(_open(key, 7)))
        link.later(10)
        taken += link.taken(frames)
    return Result("sessions that a gateway answers in advance", count, taken)


def _gateway(count: int, rng: random.Random) -> Result:
    """Each frame comes up to 3 s late, or never, or more than once."""
    key = LinkKey(rng.randbytes(16), 1)
    link = Keyed(key, rng.getrandbits(32))
    host, tried, taken, used, oldest = _Host(link, key, rng), 0, 0, set[int](), 0
    waiting: list[tuple[int, int, Sent]] = []
    number = 0
    while tried < count:
        link.later(10)
        if number % 5 == 0 and rng.random() < 0.99:
            host.session._renew()  # its SESSION_OPEN passes at once
            sent = host.sends()
            for _ in range(rng.choice((1, 1, 1, 2, 5))):
                waiting.append((link.ms + round(rng.triangular(0, 3000, 0)), number, sent))
        number += 1
        for due in sorted(w for w in waiting if w[0] <= link.ms):
            waiting.remove(due)
            tried += 1
            if link.taken(due[2][1]):
                age = link.ms - due[2][0]
                oldest = max(oldest, age)
                taken += age > AGE or due[1] in used
                used.add(due[1])
    return Result(
        "gateway that buffers, reorders, duplicates", tried, taken,
        f"{len(used)} taken, each once and at most {oldest} ms old",
    )  # fmt: skip


class _Lossy(Keyed):
    """Behind a gateway that loses and delays, and keeps the order; what the host asks for takes that time, too."""

    def __init__(self, key: LinkKey, rng: random.Random) -> None:
        super().__init__(key, rng.getrandbits(32))
        self.rng, self.there, self.refused, self.came = rng, deque[tuple[int, list[Frame]]](), 0, 0

    def put(self, frames: list[Frame]) -> None:
        if self.rng.random() >= LOST:
            last = self.there[-1][0] if self.there else 0
            self.there.append((max(last, self.ms + self.rng.randint(0, DELAY)), frames))

    def goes_on(self, until: int) -> list[Frame]:
        """Up to that ms; what is answered."""
        answers: list[Frame] = []
        while self.ms < until:
            self.later(1)
            while self.there and self.there[0][0] <= self.ms:
                frames = self.there.popleft()[1]
                if frames[0][0] == interface().messages["SESSION_OPEN"].id:
                    answers += self._take(self._native(frames[0]))
                else:
                    self.came += 1
                    self.refused += not self.taken(frames)
        return answers

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        end = self.ms + ANSWER
        self.put([frame])
        while self.ms < end:
            answers = [answer for answer in self.goes_on(self.ms + 1) if wanted(answer)]
            if answers:
                if self.rng.random() < LOST:
                    break
                self.goes_on(self.ms + self.rng.randint(0, DELAY))
                return answers[0]
        self.goes_on(end)
        return None


def _honest(count: int, rng: random.Random) -> Result:
    """A host at 20 Hz behind the lossy gateway: of what comes, what is refused."""
    key = LinkKey(rng.randbytes(16), 1)
    link = _Lossy(key, rng)
    host, sessions = _Host(link, key, rng), set()
    while link.came < count:
        link.goes_on(link.ms + 50)
        host.session._renew()
        sessions.add(host.session.number)
        link.put(host.sends()[1])
    return Result(
        f"valid frames refused behind {LOST:.0%} loss and up to {DELAY} ms each way", link.came, link.refused,
        f"{len(sessions)} sessions",
    )  # fmt: skip


def attack(count: int, seed: int) -> Iterator[Result]:
    """Each of the four `count` times."""
    with mock.patch.multiple(seal, PAUSE=0.0, TAG_EVERY=0.0):  # time is counted here
        for part in (_withheld, _gateway, _honest):
            yield part(count, random.Random(f"{seed} {part.__name__}"))
        yield _ahead(max(count // 10, 1), random.Random(f"{seed} ahead"))


def _each(count: int, seed: int) -> Result:
    results = list(attack(count, seed))
    print(*results, sep="\n")
    return Result("withheld", sum(r.tried for r in results), sum(r.taken for r in results))


if __name__ == "__main__":
    raise SystemExit(run(_each, COUNT))
