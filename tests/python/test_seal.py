"""A host with the link key, and one without, against the controller's link layer."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.seal import SEALED, LinkKey, Session, open_session
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.reading import ReadingError

KEY = LinkKey(bytes(range(16)), 3)
STARTED = 0x1234_5678


class Sealed(InProcess):
    """A controller with the key."""

    def __init__(self, key: LinkKey = KEY) -> None:
        super().__init__()
        self._key = self._ffi.new("uint32_t[4]", list(struct.unpack("<4I", key.key)))
        self._lib.terrapin_link_seal(self._link, self._key, key.generation, STARTED)

    def later(self, ms: int) -> None:
        seal = self._ffi.addressof(self._link, "seal")
        self._lib.terrapin_seal_at(seal, seal.now_ms + ms)

    def seconds(self) -> float:
        """Its clock, which is the host's, too."""
        return int(self._link.seal.now_ms) / 1000

    def commanded(self, frames: list[Frame]) -> int | None:
        """The request that frames bring, if they are taken."""
        self._inputs.command_fresh = False
        self.later(50)
        self.exchange(frames)
        return int(self._inputs.command.request) if self._inputs.command_fresh else None

    @property
    def unsealed(self) -> int:
        return int(self._link.unsealed)


def test_who_has_the_key_commands_and_writes() -> None:
    link, sender = Sealed(), Sender()
    session = open_session(link, KEY, link.seconds)
    for _ in range(160):  # 8 s, past the 8 bits of the time
        assert link.commanded(session.sealed([sender.frame("COMMAND", {"request": 2, "setpoint": -500})])) == 2
    index = interface().parameters["radius"].index
    write = sender.frame("PARAMETER_WRITE", {"index": index, "value": 81_000})
    [answer] = link.exchange(session.sealed([write]))
    assert interface().messages["PARAMETER_VALUE"].decode(answer[1])["value"] == 81_000
    link.later(50)
    link.exchange(session.sealed(sender.test_mode()))
    assert link._link.test_mode
    assert link.unsealed == 0


def test_who_has_none_stops_it_and_reads() -> None:
    link, sender = Sealed(), Sender()
    for request in (1, 2, 3):
        assert link.commanded([sender.frame("COMMAND", {"request": request})]) is None
    assert link.commanded([sender.frame("COMMAND", {"request": 0})]) == 0
    assert link.exchange([sender.frame("PARAMETER_WRITE", {"index": 0, "value": 81_000})]) == []
    assert len(link.exchange([sender.frame("PARAMETER_READ", {"index": 0})])) == 1
    link.exchange(sender.test_mode())
    assert not link._link.test_mode
    assert link.unsealed >= 4


def test_a_wrong_key_and_an_old_generation() -> None:
    link, sender = Sealed(), Sender()
    with pytest.raises(LinkError, match=r"opens no session for link key \w{8}, generation 2"):
        open_session(link, LinkKey(KEY.key, 2))
    wrong = open_session(link, LinkKey(bytes(16), 3), link.seconds)  # nothing tells before the first tag
    assert link.commanded(wrong.sealed([sender.frame("COMMAND", {"request": 2})])) is None
    with pytest.raises(LinkError, match="no session"):
        open_session(InProcess(), KEY)  # which has no key


def test_files_of_keys(tmp_path: Path) -> None:
    path = tmp_path / "robot.key"
    path.touch(0o600)
    path.write_text(KEY.text())
    assert LinkKey.read(path) == KEY
    assert LinkKey.new() != LinkKey.new()
    for text, expected in (
        ("", "no link key"),
        ('generation = 1\nkey = "zz"', "no link key"),
        ("key = " + "[" * 9_000, "no link key"),
        ('generation = 0\nkey = "' + "00" * 16 + '"', "expected a key of 16 bytes"),
        ('generation = 1\nkey = "00"', "expected a key of 16 bytes"),
    ):
        path.write_text(text)
        with pytest.raises(ReadingError, match=expected):
            LinkKey.read(path)


def test_a_host_asks_with_another_number_each_time() -> None:
    """Its number is half of what makes a session's key fresh (firmware/link/seal.h): the controller has the other."""
    asked: list[int] = []

    class Asked(Sealed):
        def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
            asked.append(interface().messages["SESSION_OPEN"].decode(frame[1])["host"])
            return super().ask(frame, wanted)

    for _ in range(4):
        open_session(Asked(), KEY)
    assert len(set(asked)) == 4


def test_a_controller_that_does_not_answer_is_asked_three_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """A session of somebody else may wait for 0.2 s: two pauses of 0.12 s are longer, and the same number each time."""
    asked: list[bytes] = []
    slept: list[float] = []

    class Deaf(Sealed):
        def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
            asked.append(frame[1])
            return None

    monkeypatch.setattr("terrapin_hil.links.seal.time.sleep", slept.append)
    with pytest.raises(LinkError):
        open_session(Deaf(), KEY)
    assert len(asked) == 3
    assert len(set(asked)) == 1
    assert slept == [0.12, 0.12]


@pytest.mark.parametrize("name", SEALED)
def test_what_changes_a_controller_has_a_seal_behind_it(name: str) -> None:
    message = interface().messages[name]
    frame = message.id, bytes([1]) * message.length  # action and its like are not 0, which would only ask
    sent = Session(bytes(16), (0, 0)).sealed([frame])
    assert [identifier for identifier, _ in sent] == [message.id, interface().messages["SEAL"].id]


def test_the_host_seals_what_the_firmware_holds_back() -> None:
    """The list stands in C too (firmware/link/dispatch.c, needs_seal): every message the controller takes, tried."""
    session = Session(bytes(16), (0, 0))
    for message in interface().messages.values():
        link = Sealed()
        frame = message.id, bytes([1]) * message.length
        link.exchange([frame])
        assert bool(link._link.seal.holding) == (len(session.sealed([frame])) > 1), message.name


def test_the_same_command_once_more_is_the_same_frame() -> None:
    session, sender = Session(bytes(16), (0, 0)), Sender()
    first, second = (sender.frame("COMMAND", {"request": 2}) for _ in range(2))
    [sealed] = session.sealed([first])
    assert session.sealed([first]) == [sealed]
    assert session.sealed([second]) != [sealed]


def test_a_session_is_renewed_by_itself() -> None:
    """While it speaks, after it was silent, and after an hour; nothing is refused."""
    link, sender = Sealed(), Sender()
    link.session = session = open_session(link, KEY, link.seconds)
    numbers = set()
    for gap in [50] * 400 + [850, 950, 1900, 5000, 3_600_000] + [50] * 100:
        link.later(gap)
        link._inputs.command_fresh = False
        link.exchange([sender.frame("COMMAND", {"request": 2, "setpoint": 5})])
        assert link._inputs.command_fresh
        numbers.add(session.number)
        session._next = 0.0  # time is the controller's here
    assert link.unsealed == 0
    assert len(numbers) >= 6


@pytest.mark.parametrize("ways", ["both ways", "to the controller"])
def test_an_interrupted_stream_is_taken_again_within_a_second(ways: str) -> None:
    """The host goes on while nothing arrives for 3 s, and asks for another session when it can know of that."""
    link, sender = Sealed(), Sender()
    session = open_session(link, KEY, link.seconds)
    opened, status, refused = session._renewed, interface().messages["STATUS"], 0
    assert opened is not None
    session._renewed = lambda: opened() if there else None  # SESSION_OPEN is lost, too
    for tick in range(200):
        there = not 40 <= tick < 100
        link.later(50)
        session._next = 0.0
        [sent] = session.batches([sender.frame("COMMAND", {"request": 2, "setpoint": 5})])
        link._inputs.command_fresh = False
        if there:
            link.exchange(sent)
            refused += not link._inputs.command_fresh
        if there or ways == "to the controller":
            without = 1 << interface().faults["command_timeout"]
            faults = without if 44 <= tick < 120 else 0
            session.heard([(status.id, status.encode({"faults": faults})[0])])
    assert refused <= 20
    assert session._began > 5.0  # of the time after it


def test_only_the_status_tells_of_missed_commands() -> None:
    status = interface().messages["STATUS"]
    faults = status.encode({"faults": 1 << interface().faults["command_timeout"]})[0]
    session = Session(bytes(16), (0, 0))
    session.heard([(status.id + 1, faults), (status.id, faults[:-1])])
    assert not session._lost
    session.heard([(status.id, faults)])
    assert session._lost


def test_a_session_that_cannot_be_renewed_goes_on() -> None:
    link, sender = Sealed(), Sender()
    asked = 0

    def renewed() -> None:
        nonlocal asked
        asked += 1

    link.session = session = open_session(link, KEY, link.seconds)
    session._renewed = renewed
    for _ in range(200):  # 10 s, of which it asks in the last two
        assert link.commanded(list(session.sealed([sender.frame("COMMAND", {"request": 2})]))) == 2
        session._next = 0.0
        session._renew()
    assert 2 <= asked <= 4


def test_each_piece_has_one_tag_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames between tags go with the one before; before each tag it waits, and may begin another session."""
    said: list[str] = []
    monkeypatch.setattr(Session, "_needs_tag", lambda self, frame: frame > 0)
    monkeypatch.setattr(Session, "_one", lambda self, frame: said.append(f"seals {frame}") or [frame, -frame])
    monkeypatch.setattr(Session, "_wait", lambda self: said.append("waits"))
    monkeypatch.setattr(Session, "_renew", lambda self: said.append("renews"))
    session = Session.__new__(Session)

    def pieces(*frames: int) -> list[list[int]]:
        said.clear()
        return list(session.batches(frames))  # type: ignore[arg-type]

    assert pieces(1, 2, 3) == [[1, -1], [2, -2], [3, -3]]
    assert said == ["waits", "renews", "seals 1", "waits", "renews", "seals 2", "waits", "renews", "seals 3"]
    assert pieces(-1, 2, -3, -4, 5, -6) == [[-1, 1, 2, -2, -3, 3, -4, 4], [5, -5, -6, 6]]
    assert pieces(-1, -2) == [[-1, 1, -2, 2]]
    assert said == ["seals -1", "seals -2"]
    assert pieces() == [[]]
