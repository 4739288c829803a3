"""Sealed traffic replayed, made up, and of who has the key: no replay is taken, no tag is guessed, no write weakens."""

from __future__ import annotations

import random
from collections.abc import Iterator
from unittest import mock

from terrapin_hil.links import seal
from terrapin_hil.links.seal import LinkKey, open_session
from terrapin_hil.messages import Frame, Sender, interface
from tests.attack import Result, run
from tests.attack.withheld import Keyed

__all__ = ["attack"]

COUNT, SHORT = 120_000, 4_000  # replays; four times as many made up
RECORDED = 40


def _recorded(link: Keyed, key: LinkKey, sender: Sender, rng: random.Random) -> list[list[Frame]]:
    """What a session brought, all of it taken."""
    session, frames = open_session(link, key, link.seconds), []
    for _ in range(RECORDED):
        link.later(10)
        frame = sender.frame("COMMAND", {"request": 2, "setpoint": rng.randint(-2000, 2000)})
        if rng.random() < 0.2:
            frame = sender.frame("PARAMETER_WRITE", {"index": seal.NO_PARAMETER, "value": 1})
        frames.append(session.sealed([frame]))
        if not link.taken(frames[-1]):
            raise AssertionError("a valid frame was refused")
    return frames


def _replays(count: int, rng: random.Random) -> Result:
    """Within the session, after it, in another one, after a reset, on a controller with another key."""
    tried = taken = 0
    while tried < count:
        key = LinkKey(rng.randbytes(16), 1)
        link = Keyed(key, rng.getrandbits(32))
        sender = Sender()  # its counters go on in the next session: the same one twice would be a repetition
        recorded = _recorded(link, key, sender, rng)
        place = rng.randrange(5)
        if place == 1:
            link.later(rng.randint(2000, 600_000))
        elif place == 2:
            link.later(300)
            _recorded(link, key, sender, rng)
        elif place == 3:
            link = Keyed(key, rng.getrandbits(32), link.ms)
            link.exchange([_open(key, rng)])
        elif place == 4:
            link = Keyed(LinkKey(rng.randbytes(16), 1), rng.getrandbits(32), link.ms)
            link.exchange([_open(key, rng)])
        for _ in range(40):
            link.later(rng.choice((5, 10)))
            tried += 1
            taken += link.taken(rng.choice(recorded))
    return Result("sealed replays", tried, taken)


def _open(key: LinkKey, rng: random.Random) -> Frame:
    message = interface().messages["SESSION_OPEN"]
    return message.id, message.encode({"host": rng.getrandbits(32), "generation": key.generation})[0]


def _made_up(count: int, rng: random.Random) -> Result:
    """Random COMMAND_SEALED and SEAL behind a write, while a session runs; 5 ms apart, so that tags are looked at."""
    key, sender = LinkKey(rng.randbytes(16), 1), Sender()
    link = Keyed(key, rng.getrandbits(32))
    command, of_write = (interface().messages[name].id for name in ("COMMAND_SEALED", "SEAL"))
    taken = 0
    for number in range(count):
        link.later(5)
        if number % 100 == 0:  # the operator goes on
            if number % 1000 == 0:
                session = open_session(link, key, link.seconds)
            run_frame = sender.frame("COMMAND", {"request": 2})
            if not link.taken(session.sealed([run_frame])):
                raise AssertionError("a valid frame was refused")
            link.later(10)
        data = rng.randbytes(8)
        if number % 2:
            taken += link.taken([(command, bytes([data[0] & 0x80 | rng.randint(1, 3)]) + data[1:])])
        else:
            write = sender.frame("PARAMETER_WRITE", {"index": seal.NO_PARAMETER, "value": number})
            taken += link.taken([write, (of_write, data)])
    return Result("sealed frames made up", count, taken)


def _weakening(rng: random.Random) -> Result:
    """Who has the key writes every parameter past both ends of its range, which the board's ceilings narrow."""
    key, sender, tried, taken, first = LinkKey(rng.randbytes(16), 1), Sender(), 0, 0, ""
    for parameter in interface().parameters.values():
        link = Keyed(key, rng.getrandbits(32))
        session = open_session(link, key, link.seconds)
        for value in {
            parameter.minimum - 1, parameter.maximum + 1, 2 * parameter.maximum + 1, 2 * parameter.minimum - 1,
            -(2**31), 2**31 - 1,
        }:  # fmt: skip
            if parameter.minimum <= value <= parameter.maximum or not -(2**31) <= value < 2**31:
                continue
            link.later(10)
            frame = sender.frame("PARAMETER_WRITE", {"index": parameter.index, "value": value})
            answers = link.exchange(session.sealed([frame]))
            said = interface().messages["PARAMETER_VALUE"].decode(answers[-1][1])
            tried += 1
            if said["status"] == 0 or not parameter.minimum <= said["value"] <= parameter.maximum:
                taken, first = taken + 1, first or f"{parameter.name} became {said['value']}"
    return Result("sealed writes that weaken a protection", tried, taken, first)


def attack(count: int, seed: int) -> Iterator[Result]:
    """`count` replays, four times as many frames that are made up, every parameter's ends."""
    with mock.patch.multiple(seal, PAUSE=0.0, TAG_EVERY=0.0):  # time is counted here
        yield _replays(count, random.Random(f"{seed} replays"))
        yield _made_up(4 * count, random.Random(f"{seed} made up"))
        yield _weakening(random.Random(f"{seed} writes"))


def _each(count: int, seed: int) -> Result:
    results = list(attack(count, seed))
    print(*results, sep="\n")
    return Result("sealed", sum(r.tried for r in results), sum(r.taken for r in results))


if __name__ == "__main__":
    raise SystemExit(run(_each, COUNT))
