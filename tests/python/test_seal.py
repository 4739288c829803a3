"""A host with the link key, and one without, against the controller's link layer."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError, Sealing
from terrapin_hil.links.seal import SEALED, LinkKey, Session, chaskey, clock, open_session, seal_link, takes_changes
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


class Clock:
    """Seconds that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def _fields(frame: Frame) -> dict[str, int]:
    message = interface().by_id[frame[0]]
    return {"id": message.id} | message.decode(frame[1])


def _tag(identifier: int, time: int, data: bytes) -> int:
    return int.from_bytes(chaskey(KEY.key, struct.pack("<2I", identifier, time) + data)[:4], "little")


def test_a_seal_is_of_the_frame_and_the_time_in_units_of_8_ms() -> None:
    """Of a COMMAND what it commands, in the place of its checksum and counter; of others all, padded to eight bytes."""
    clock = Clock()
    session = Session(KEY.key, (9, 7), now=clock)
    messages = interface().messages
    assert session.number == (9, 7)
    for later, time in ((0.0, 1), (0.0, 2), (0.08, 10), (0.08, 11), (3.0, 375), (0.0, 376)):
        clock.now = max(clock.now, later)
        [write, seal] = session.sealed([(messages["TEST_MODE"].id, b"\1" * messages["TEST_MODE"].length)])
        padded = write[1].ljust(8, b"\0")
        assert _fields(seal) == {"id": messages["SEAL"].id, "session": 1, "time": time & 0xFF,
            "tag": _fields(seal)["tag"]}  # fmt: skip
        assert _fields(seal)["tag"] & 0xFFFF_FFFF == _tag(write[0], time, padded)
    other = Session(KEY.key, (9, 6), now=clock)
    command = Sender().frame("COMMAND", {"request": 2, "control": 1, "setpoint": -500})
    [sealed] = other.sealed([command])
    found, given = _fields(sealed), _fields(command)
    assert [found[name] for name in ("request", "control", "limiter", "setpoint")] == [
        given[name] for name in ("request", "control", "limiter", "setpoint")
    ]
    assert (found["id"], found["session"], found["time"]) == (messages["COMMAND_SEALED"].id, 0, 1)
    assert found["tag"] & 0xFFFF_FFFF == _tag(sealed[0], 1, sealed[1][:3] + bytes(5))
    clock.now += 2.0
    assert other.sealed([command]) == [sealed]
    assert _fields(other.sealed([Sender().frame("COMMAND", {"request": 3})])[0])["time"] == 250


def test_what_anybody_may_send_and_what_is_damaged_has_no_seal() -> None:
    session, sender = Session(KEY.key, (0, 0)), Sender()
    messages = interface().messages
    command = sender.frame("COMMAND", {"request": 2, "setpoint": 5})
    node = messages["NODE_REQUEST"]
    free = [
        sender.frame("COMMAND", {"request": 0}), (command[0], command[1][:-1]), (0x7FF, b"\1" * 8),
        (command[0], command[1][:2] + bytes([command[1][2] ^ 1]) + command[1][3:]), (node.id, bytes(node.length)),
        (node.id, b"\1" * (node.length - 1)), sender.frame("PARAMETER_READ", {"index": 0}),
        sender.frame("UPDATE_QUERY", {}),
    ]  # fmt: skip
    for frame in free:
        assert session.sealed([frame]) == [frame]
    assert session.sealed(free) == free
    assert len(session.sealed([(node.id, b"\1" * node.length)])) == 2
    assert session.sealed([command]) != [command]


def _renewing() -> tuple[Clock, Session, list[Session | None]]:
    """A session that is asked for another one: what it is given, None when there is none."""
    clock = Clock()
    given: list[Session | None] = []
    session = Session(KEY.key, (1, 1), lambda: given.pop(0), clock)
    return clock, session, given


def test_a_session_is_left_when_it_was_silent_or_half_over() -> None:
    """After 0.9 s without a tag, or 8 s; and asked for again 0.9 s later where none was opened."""
    command = [Sender().frame("COMMAND", {"request": 2, "setpoint": value}) for value in range(200)]
    clock, session, given = _renewing()
    clock.now += 0.89
    session._renew()
    clock.now = 0.9
    other = Session(bytes(16), (2, 4), now=clock)
    given.append(other)
    session._renew()
    assert (session.number, session._key, session._place, given) == ((2, 4), bytes(16), 0, [])
    assert session.sealed(command[:1]) == Session(bytes(16), (2, 4), now=clock).sealed(command[:1])
    for tick in range(79):  # tags every 0.1 s from now on: at 7.9 s it is not over
        clock.now = 1.0 + 0.1 * tick
        session._renew()
        session.sealed([command[tick + 1]])
    clock.now = 0.9 + 8.0
    given.append(None)
    session._renew()
    assert (session.number, given) == ((2, 4), [])
    clock.now += 0.89
    session._renew()  # too early to ask again
    clock.now += 0.02
    begun, clock.now = clock.now, clock.now + 0.25  # the controller's answer took its time
    given.append(Session(KEY.key, (3, 1), now=lambda: begun))
    session._renew()
    assert (session.number, session._began, session._last, given) == ((3, 1), begun, begun, [])
    alone = Session(KEY.key, (1, 1), None, clock)
    clock.now += 100.0
    alone._renew()
    assert alone.number == (1, 1)


def test_a_session_may_be_lost_when_the_controller_was_not_heard() -> None:
    """For 0.9 s, or when it begins to miss commands: another one is asked for at once, though this one speaks."""
    status = interface().messages["STATUS"]
    missing = 1 << interface().faults["command_timeout"]

    def heard(*events: tuple[float, int]) -> bool:
        clock, session, given = _renewing()
        begin = clock.now
        for later, faults in events:
            clock.now = begin + later
            session.heard([(status.id, status.encode({"faults": faults})[0])])
        session._tag(0, bytes(8))  # it speaks
        given.append(None)
        session._tried = -100.0
        session._renew()
        return not given

    other = 1 << next(bit for name, bit in interface().faults.items() if name != "command_timeout")
    assert not heard((1.0, 0), (1.89, 0))
    assert heard((0.0, 0), (0.9, 0))
    assert heard((1.0, 0), (1.91, 0))
    assert heard((1.0, 0), (1.91, 0), (1.92, 0))
    assert heard((1.0, 0), (1.1, missing))
    assert heard((1.0, 0), (1.1, missing), (1.2, missing))
    assert not heard((1.0, other), (1.1, other))
    clock, session, given = _renewing()
    session.heard([(status.id, status.encode({"faults": missing})[0])])
    session._tried = -100.0
    given.append(Session(KEY.key, (2, 2), now=clock))
    session._renew()
    session.heard([(status.id, status.encode({"faults": missing})[0])])
    assert not session._lost  # it misses them still: nothing new


def test_a_session_that_is_lost_at_once_is_left_at_once() -> None:
    status = interface().messages["STATUS"]
    clock, session, given = _renewing()
    session.heard([(status.id, status.encode({"faults": 1 << interface().faults["command_timeout"]})[0])])
    given.append(Session(KEY.key, (2, 2), now=clock))
    session._renew()
    assert session.number == (2, 2)


def test_tags_are_ten_ms_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    times, slept = [100.0], list[float]()

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        times[0] += seconds

    monkeypatch.setattr("terrapin_hil.links.seal.time.monotonic", lambda: times[0])
    monkeypatch.setattr("terrapin_hil.links.seal.time.sleep", sleep)
    session = Session(KEY.key, (0, 0), now=Clock())
    for later in (0.0, 0.004, 0.2, 0.0):
        times[0] += later
        session._wait()
    assert slept == pytest.approx([0.006, 0.01])


def test_the_clock_goes_on_while_the_machine_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_hil.links.seal.time.CLOCK_BOOTTIME", 7, raising=False)
    monkeypatch.setattr("terrapin_hil.links.seal.time.clock_gettime", lambda which: 1.5 if which == 7 else 0.0)
    assert clock() == 1.5
    monkeypatch.delattr("terrapin_hil.links.seal.time.CLOCK_BOOTTIME")
    monkeypatch.setattr("terrapin_hil.links.seal.time.monotonic", lambda: 2.5)
    assert clock() == 2.5


class Asked:
    """A link that answers by name what is listed, one after the other; what it was asked."""

    name = "link"
    session: Sealing | None = None

    def __init__(self, **answers: list[Frame | None]) -> None:
        self.answers, self.asked = answers, list[str]()
        self.sent: list[Frame] = []

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        name = interface().by_id[frame[0]].name
        self.asked.append(name)
        self.sent.append(frame)
        listed = self.answers.get(name, [])
        found = listed.pop(0) if listed else None
        return found if found is not None and wanted(found) else None


def _said(name: str, **values: int) -> Frame:
    return interface().messages[name].id, interface().messages[name].encode(values)[0]


TAKEN = _said("PARAMETER_VALUE", index=0xFFFF)
OPENED = _said("SESSION", start=0x8000_0001, count=3)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terrapin_hil.links.seal.time.sleep", lambda seconds: None)


@pytest.mark.usefixtures("patient")
def test_a_session_has_the_key_of_both_numbers() -> None:
    link = Asked(SESSION_OPEN=[OPENED])
    session = open_session(link, KEY, Clock())
    [frame] = link.sent
    asked = _fields(frame)
    assert asked["generation"] == 3
    words = struct.pack("<4I", asked["host"] & 0xFFFF_FFFF, 0x8000_0001, 3, 3)
    assert (session.number, session._key) == ((0x8000_0001, 3), chaskey(KEY.key, words))
    answered = Session.answering(KEY, 0xFFFF_FFFF, {"start": -1, "count": -2})
    assert answered.number == (0xFFFF_FFFF, 0xFFFF_FFFE)
    link = Asked(SESSION_OPEN=[TAKEN, OPENED])  # another answer is none
    assert open_session(link, KEY).number == (0x8000_0001, 3)
    link = Asked(SESSION_OPEN=[OPENED])
    with pytest.raises(LinkError, match="link: the controller opens no session"):
        open_session(Asked(), KEY)
    renewed = open_session(link, KEY)._renewed
    assert renewed is not None
    assert renewed() is None
    link.answers["SESSION_OPEN"] = [_said("SESSION", start=5, count=4)]
    again = renewed()
    assert again is not None
    assert again.number == (5, 4)


@pytest.mark.usefixtures("patient")
def test_a_link_is_sealed_once_and_tried() -> None:
    link = Asked(SESSION_OPEN=[OPENED], PARAMETER_WRITE=[TAKEN])
    session = seal_link(link, KEY)
    assert link.session is session
    assert session.number == (0x8000_0001, 3)
    assert link.asked == ["SESSION_OPEN", "PARAMETER_WRITE"]
    wrong = Asked(SESSION_OPEN=[OPENED])
    with pytest.raises(LinkError, match=f"wrong link key {KEY.fingerprint}: the controller has another"):
        seal_link(wrong, KEY)
    assert wrong.session is None
    none = Asked(PARAMETER_WRITE=[TAKEN])
    with pytest.raises(LinkError, match="has no link key and takes commands of anybody"):
        seal_link(none, KEY)
    assert none.session is None
    late = Asked(SESSION_OPEN=[None] * 3 + [OPENED], PARAMETER_WRITE=[None] * 3 + [TAKEN])
    assert seal_link(late, KEY) is late.session  # it takes no changes: it was only slow
    with pytest.raises(LinkError, match="opens no session for link key"):
        seal_link(Asked(), KEY)


@pytest.mark.usefixtures("patient")
def test_a_controller_takes_changes_when_it_answers_for_no_parameter() -> None:
    number, data = TAKEN
    for answer, taken in ((TAKEN, True), (_said("PARAMETER_VALUE", index=0), False), ((number + 1, data), False),
        ((number, data[:-1]), False), (_said("PARAMETER_VALUE", index=0x7FFF), False)):  # fmt: skip
        link = Asked(PARAMETER_WRITE=[answer])
        assert takes_changes(link) == taken
        assert _fields(link.sent[0])["index"] & 0xFFFF == 0xFFFF
    assert takes_changes(Asked(PARAMETER_WRITE=[None, None, TAKEN]))


def test_a_link_keys_file_says_a_key_and_a_whole_number(tmp_path: Path) -> None:
    path = tmp_path / "robot.key"
    path.touch(0o600)

    def read(generation: str, key: str = "00" * 16) -> LinkKey:
        path.write_text(f'generation = {generation}\nkey = "{key}"\n')
        return LinkKey.read(path)

    assert read("1") == LinkKey(bytes(16), 1)
    assert read("4294967295").generation == 2**32 - 1
    for generation in ("0", "-1", "4294967296", "1.5", "true", '"1"'):
        with pytest.raises(ReadingError, match=f"^{path}: expected a key of 16 bytes and its generation from 1"):
            read(generation)
    for key in ("00" * 15, "00" * 17):
        with pytest.raises(ReadingError, match="expected a key of 16 bytes"):
            read("1", key)
    path.write_text("generation = 1\nkey = 5\n")
    with pytest.raises(ReadingError, match="no link key"):
        LinkKey.read(path)
    path.write_text(KEY.text() + "#" * 20_000)
    assert LinkKey.read(path) == KEY
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ReadingError, match="no link key"):
        LinkKey.read(path)
    with pytest.raises(ReadingError, match="cannot read the link key: Is a directory"):
        LinkKey.read(tmp_path)
    path.write_text(KEY.text())
    path.chmod(0o640)
    with pytest.raises(ReadingError, match="mode 0640"):
        LinkKey.read(path)


def test_a_new_key_is_the_first_one_and_has_a_name_of_its_own() -> None:
    """8 digits, the same each time, of which nothing of the key is read."""
    one, other = LinkKey.new(), LinkKey.new(7)
    assert (len(one.key), one.generation, other.generation) == (16, 1, 7)
    assert re.fullmatch("[0-9a-f]{8}", one.fingerprint)
    assert one.fingerprint == LinkKey(one.key, 2).fingerprint != other.fingerprint
    assert one.fingerprint == chaskey(one.key, b"fingerprint".ljust(16, b"\0"))[:4].hex()
    assert LinkKey(bytes(range(16)), 3).block() == struct.pack("<4sI16sI", b"LKEY", 3, bytes(range(16)),
        zlib.crc32(b"LKEY\3\0\0\0" + bytes(range(16))))  # fmt: skip
