"""Logs of every kind: round trips checked by other tools' readers, cut files, decoding against cantools."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import can
import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.logs import decoding
from terrapin_tools.logs.bus import PythonCanBus, enlarge, socket_drops
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames, frames, joined
from terrapin_tools.logs.reading import LogReader, read_log
from terrapin_tools.logs.writing import GROWING, LogWriter

DBC = paths.build() / "generated" / "terrapin.dbc"
KINDS = (".log", ".blf", ".asc", ".mf4", ".mcap", ".parquet")


def some(count: int = 500, begin: float = 1000.0, plain: bool = False) -> Frames:
    random = np.random.default_rng(3)
    times = begin + np.cumsum(random.integers(1, 9, count)) * 1e-4
    rows = []
    for i in range(count):
        kind = 0 if plain else int(random.choice([0, 0, 0, EXTENDED, FD, FD | EXTENDED, SENT]))
        identifier = int(random.integers(0, 1 << (29 if kind & EXTENDED else 11)))
        size = int(random.choice([12, 16, 64] if kind & FD else [0, 1, 7, 8]))
        rows.append((identifier, random.bytes(size), kind))
        del i
    return frames(Path("made"), times, *(list(column) for column in zip(*rows, strict=True)))


def same(a: Frames, b: Frames, tolerance: float = 1.1e-6) -> None:
    assert len(a) == len(b)
    np.testing.assert_allclose(a.times, b.times, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(a.identifiers, b.identifiers)
    np.testing.assert_array_equal(a.lengths, b.lengths)
    np.testing.assert_array_equal(a.flags, b.flags)
    assert [a.payload(i) for i in range(len(a))] == [b.payload(i) for i in range(len(b))]


def write(path: Path, log: Frames, decoder: Decoder | None = None) -> None:
    with LogWriter(path, decoder) as file:
        half = len(log) // 2
        file.write(log.pick(np.arange(half)))
        file.write(log.pick(np.arange(half, len(log))))


@pytest.mark.parametrize("kind", KINDS)
def test_round_trip(tmp_path: Path, kind: str) -> None:
    """What is written comes back; ASC keeps times from its first frame on, to a microsecond."""
    log = some(begin=0.0 if kind == ".asc" else 1_700_000_000.25)
    path = tmp_path / f"x{kind}"
    write(path, log)
    back, cut = read_log(path)
    assert cut == ""
    if kind == ".asc":
        log = Frames(log.path, log.times - log.times[0], log.identifiers, log.lengths, log.data, log.flags)
    same(log, back)


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in (".asc", ".parquet")])
def test_simulated_times(tmp_path: Path, kind: str) -> None:
    """Logs of the simulator begin at 0 s, not in our century."""
    log = some(begin=0.0, plain=True)
    write(tmp_path / f"x{kind}", log)
    same(log, read_log(tmp_path / f"x{kind}")[0])


def test_remote_and_error_frames(tmp_path: Path) -> None:
    log = frames(
        Path("made"), [0.0, 0.1, 0.2], [0x12, 0x4, 0x1ABCDEF], [b"", bytes(8), b"\1"], [REMOTE, ERROR, EXTENDED]
    )
    for kind in (".log", ".mcap", ".parquet"):
        write(tmp_path / f"x{kind}", log)
        back, _ = read_log(tmp_path / f"x{kind}")
        same(log, back)
        assert len(back.data_frames) == 1


@pytest.mark.parametrize("kind", [".log", ".blf", ".asc", ".mf4"])
def test_python_can_reads_it(tmp_path: Path, kind: str) -> None:
    log = some(200, plain=True)
    write(tmp_path / f"x{kind}", log)
    with can.LogReader(tmp_path / f"x{kind}") as reader:
        messages = list(reader)
    assert [m.arbitration_id for m in messages] == log.identifiers.tolist()
    assert [bytes(m.data) for m in messages] == [log.payload(i) for i in range(200)]


def test_asammdf_reads_it(tmp_path: Path) -> None:
    """The bus log's signals come out by asammdf's own extraction with the DBC."""
    from asammdf import MDF

    log = telemetry(50)
    write(tmp_path / "x.mf4", log)
    with MDF(tmp_path / "x.mf4") as file:
        extracted = file.extract_bus_logging({"CAN": [(str(DBC), 0)]})
        torque = extracted.get("torque").samples
    np.testing.assert_allclose(torque, Decoder(DBC).decode(log)["GROUND"].signals["torque"], rtol=1e-12)


def test_mcap_reads_it(tmp_path: Path) -> None:
    """Frames and decoded signals by the library's own reader; chunked and indexed as players want it."""
    from mcap.reader import make_reader

    log = telemetry(50)
    write(tmp_path / "x.mcap", log, Decoder(DBC))
    with (tmp_path / "x.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert {c.topic for c in summary.channels.values()} == {"/can", "/GROUND"}
        assert summary.chunk_indexes
        values = [json.loads(m.data)["torque"] for _, c, m in reader.iter_messages(topics=["/GROUND"])]
    np.testing.assert_allclose(values, Decoder(DBC).decode(log)["GROUND"].signals["torque"])


def telemetry(count: int) -> Frames:
    message = cantools.database.load_file(DBC).get_message_by_name("GROUND")
    random = np.random.default_rng(1)
    payloads = [random.bytes(8) for _ in range(count)]
    return frames(Path("made"), np.arange(count) * 0.01, [message.frame_id] * count, payloads, [0] * count)


@pytest.mark.parametrize("kind", GROWING)
def test_cut_by_kill(tmp_path: Path, kind: str) -> None:
    """A recorder that is killed leaves a log that reads up to its last flush, and reading says that it is cut."""
    path = tmp_path / f"x{kind}"
    script = f"""
import sys, time
sys.path[:0] = [{str(Path(__file__).parent)!r}]
from test_logs import some
from pathlib import Path
from terrapin_tools.logs.writing import LogWriter
import numpy as np
log = some(400, plain=True)
file = LogWriter(Path({str(path)!r}), growing=True)
file.write(log.pick(np.arange(300))); file.flush()
print("flushed", flush=True)
file.write(log.pick(np.arange(300, 400)))
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "flushed\n"
        process.send_signal(signal.SIGKILL)
    log = some(400, plain=True)
    back, cut = read_log(path)
    assert len(back) >= 300
    same(log.pick(np.arange(len(back))), back)
    assert cut or kind != ".mcap"  # the others are whole after each flush


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_cut_anywhere(tmp_path: Path, kind: str, share: float) -> None:
    """A cut file gives the frames before the cut and says so, or one clear error; never others, never a traceback."""
    log = some(3000, plain=True, begin=0.0)
    path = tmp_path / f"x{kind}"
    write(path, log)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    said = ""
    back, cut = log.pick(np.arange(0)), ""
    try:
        back, cut = read_log(path)
    except UserError as error:
        said = str(error)
    assert said.count("\n") == 0
    assert not said or str(path) in said
    assert said or cut or len(back) == 0 or kind == ".asc"  # ASC is text: a cut between lines does not show
    if kind != ".asc":
        same(log.pick(np.arange(len(back))), back)


@pytest.mark.parametrize("kind", KINDS)
def test_junk(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"x{kind}"
    path.write_bytes(bytes(range(256)) * 50)
    with pytest.raises(UserError, match="expected") as caught:
        read_log(path)
    assert re.search(r"Error|Exception|Invalid|magic|mmap|unpack", str(caught.value)) is None  # no words of a library


@pytest.mark.parametrize("kind", GROWING)
def test_growing_is_whole_after_each_flush(tmp_path: Path, kind: str) -> None:
    """A copy of the file at any flush reads up to there, by our reader; CAN FD may begin in the middle."""
    narrow, wide = some(300, plain=True), some(200, begin=2000.0)
    parts = [narrow.pick(np.arange(0, 100)), narrow.pick(np.arange(100, 300)), wide, wide.pick(np.arange(0))]
    written: list[Frames] = []
    with LogWriter(tmp_path / f"x{kind}", growing=True) as file:
        for number, part in enumerate(parts):
            file.write(part)
            file.flush()
            written.append(part)
            copy = tmp_path / f"copy{number}{kind}"
            copy.write_bytes((tmp_path / f"x{kind}").read_bytes())
            same(joined(copy, written), read_log(copy)[0])
    same(joined(Path("x"), written), read_log(tmp_path / f"x{kind}")[0])
    assert {path.name for path in tmp_path.iterdir() if "copy" not in path.name} == {f"x{kind}"}


@pytest.mark.parametrize("kind", GROWING)
def test_growing_and_empty(tmp_path: Path, kind: str) -> None:
    with LogWriter(tmp_path / f"x{kind}", growing=True):
        pass
    assert len(read_log(tmp_path / f"x{kind}")[0]) == 0


def test_asammdf_reads_a_growing_one(tmp_path: Path) -> None:
    """While it is being written: asammdf's own extraction finds the signals."""
    from asammdf import MDF

    log = telemetry(50)
    file = LogWriter(tmp_path / "x.mf4", growing=True)
    file.write(log)
    file.flush()
    with MDF(tmp_path / "x.mf4") as mdf:
        torque = mdf.extract_bus_logging({"CAN": [(str(DBC), 0)]}).get("torque").samples
    np.testing.assert_allclose(torque, Decoder(DBC).decode(log)["GROUND"].signals["torque"], rtol=1e-12)
    file.close()


def test_unknown_kind(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"unknown kind of log '\.xyz'"):
        LogReader(tmp_path / "x.xyz")
    with pytest.raises(UserError, match="No such file"):
        LogReader(tmp_path / "x.log")


@st.composite
def messages(draw: st.DrawFn) -> cantools.database.Message:
    size = draw(st.sampled_from([8, 8, 5, 64]))
    free = set(range(size * 8))
    signals = []
    for number in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from(["int", "int", "int", "f32", "f64"]))
        length = {"int": draw(st.integers(1, 64)), "f32": 32, "f64": 64}[kind]
        big = draw(st.booleans())
        start = draw(st.integers(0, size * 8 - 1))
        bits = set()
        at = start
        for _ in range(length):
            bits.add(at)
            at = (at + 1) if not big else (at - 1 if at % 8 else at + 15)
        if not bits <= free:
            continue
        free -= bits
        signals.append(
            cantools.database.Signal(
                f"s{number}",
                start,
                length,
                byte_order="big_endian" if big else "little_endian",
                is_signed=kind == "int" and draw(st.booleans()),
                conversion=cantools.database.conversion.BaseConversion.factory(
                    scale=draw(st.sampled_from([1, 0.5, 0.001, -2])),
                    offset=draw(st.sampled_from([0, -40])),
                    is_float=kind != "int",
                ),
            )
        )
    return cantools.database.Message(0x123, "M", size, signals, strict=True)


@settings(max_examples=150, deadline=None)
@given(messages(), st.randoms(use_true_random=False))
def test_decoding_like_cantools(message: cantools.database.Message, random: object) -> None:
    """Any layout, any data: the numbers of cantools, message by message."""
    if not message.signals:
        return
    payloads = [bytes(random.randrange(256) for _ in range(message.length)) for _ in range(5)]  # type: ignore[attr-defined]
    decoder = Decoder.__new__(Decoder)
    decoder.messages = {(0x123, False): message}
    log = frames(Path("made"), np.zeros(5), [0x123] * 5, payloads, [0] * 5)
    found = decoder.decode(log)["M"].signals
    for row, payload in enumerate(payloads):
        expected = message.decode(payload, decode_choices=False)
        for name, value in expected.items():
            np.testing.assert_allclose(found[name][row], float(value), rtol=1e-14, err_msg=name)


def test_one_bit_is_a_flag_unless_its_values_have_words(tmp_path: Path) -> None:
    """Nor is one that is signed, scaled or wider; words of a float stand for none of its values."""
    dbc = tmp_path / "x.dbc"
    dbc.write_text(
        'VERSION ""\nBU_: A\nBO_ 100 M: 8 A\n SG_ bare : 0|1@1+ (1,0) [0|1] "" A\n'
        ' SG_ worded : 1|1@1+ (1,0) [0|1] "" A\n SG_ signed : 2|1@1- (1,0) [0|0] "" A\n'
        ' SG_ scaled : 3|1@1+ (2,0) [0|0] "" A\n SG_ wide : 8|2@1+ (1,0) [0|3] "" A\n'
        ' SG_ real : 32|32@1- (1,0) [0|0] "" A\nVAL_ 100 worded 0 "off" 1 "on" ;\nVAL_ 100 real 0 "off" 1 "on" ;\n'
        "SIG_VALTYPE_ 100 real : 1;\n"
    )
    with pytest.raises(UserError, match=r"y\.dbc: no such file$"):
        Decoder(tmp_path / "y.dbc")
    described = {signal.name: signal for signal in Decoder(dbc).described("M")}
    assert [name for name, signal in described.items() if signal.flag] == ["bare"]
    assert {name: dict(signal.words) for name, signal in described.items() if signal.words} == {
        "worded": {0: "off", 1: "on"}
    }


def test_multiplexed_and_short(tmp_path: Path) -> None:
    """Signals that a frame does not carry are NaN."""
    dbc = tmp_path / "x.dbc"
    dbc.write_text(
        'VERSION ""\nBU_: A\nBO_ 100 M: 8 A\n SG_ mode M : 0|8@1+ (1,0) [0|255] "" A\n'
        ' SG_ a m0 : 8|16@1- (0.1,0) [0|0] "V" A\n SG_ b m1 : 8|8@1+ (1,0) [0|0] "" A\n'
    )
    log = frames(Path("made"), np.zeros(3), [100] * 3, [b"\0\xff\xff", b"\1\7\0", b"\0\1"], [0] * 3)
    found = Decoder(dbc).decode(log)["M"].signals
    np.testing.assert_allclose(found["a"], [-0.1, np.nan, np.nan])
    np.testing.assert_allclose(found["b"], [np.nan, 7.0, np.nan])


def test_decoding_tells_units_and_takes_a_signal_whose_selector_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dbc = tmp_path / "x.dbc"
    dbc.write_text(
        'VERSION ""\nBU_: A\nBO_ 100 M: 8 A\n SG_ a : 8|16@1- (0.1,0) [0|0] "V" A\n SG_ b : 0|8@1+ (1,0) [0|0] "" A\n'
    )
    assert sorted(Decoder(dbc).units("M")) == [("a", "V"), ("b", "")]
    plain = {"start": 0, "length": 8, "byte_order": "little_endian", "is_float": False, "is_signed": False}
    lost = SimpleNamespace(name="a", multiplexer_signal="gone", multiplexer_ids=[1], scale=2.0, offset=1.0, **plain)
    data, lengths = np.array([[3], [4]], dtype=np.uint8), np.array([1, 0])
    ((name, values),) = decoding._signals(SimpleNamespace(signals=[lost]), data, lengths)
    assert name == "a"
    np.testing.assert_array_equal(values, [7.0, np.nan])
    lost.start = 8  # beyond all frames
    ((_, values),) = decoding._signals(SimpleNamespace(signals=[lost]), data, lengths)
    assert np.isnan(values).all()
    monkeypatch.setattr(decoding, "_load", lambda path: object())  # of diagnostics
    with pytest.raises(UserError, match=r"x\.dbc: describes no CAN messages"):
        Decoder(dbc)


class OnceGone:
    """A bus that says once that it is gone, before frames that still wait, as a SocketCAN interface does."""

    channel_info = "socketcan channel 'can0'"

    def __init__(self) -> None:
        first, second = (can.Message(arbitration_id=0x180 + i, is_extended_id=False) for i in range(2))
        self.answers: list[can.Message | Exception] = [first, can.CanOperationError("No such device"), second]

    def recv(self, timeout: float) -> can.Message | None:
        answer = self.answers.pop(0) if self.answers else None
        if isinstance(answer, Exception):
            raise answer
        return answer


def test_a_bus_that_went_away_is_told_after_its_last_frames() -> None:
    bus = PythonCanBus(OnceGone())  # type: ignore[arg-type]
    assert list(bus.receive(1.0).identifiers) == [0x180, 0x181]
    for _ in range(2):
        with pytest.raises(UserError, match=r"can0': the bus went away \(No such device"):
            bus.receive(0.01)


def test_what_a_socket_has_no_place_for_is_counted() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to,
    ):
        here.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        here.bind(("127.0.0.1", 0))
        here.setblocking(False)
        assert socket_drops(here) == 0
        for _ in range(500):
            to.sendto(bytes(16), here.getsockname())
        heard = 0
        with contextlib.suppress(BlockingIOError):
            while here.recv(64):
                heard += 1
        assert 0 < heard < 500
        assert socket_drops(here) == 500 - heard
        enlarge(here)
        for _ in range(500):
            to.sendto(bytes(16), here.getsockname())
        assert socket_drops(here) == 500 - heard


def test_a_log_that_grows_while_it_is_read_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """asammdf takes the file's length first and a block's later: what came in between looked like a broken file."""
    path, reader, looks = tmp_path / "x.mf4", can.LogReader, []
    writer = LogWriter(path, growing=True)
    writer.write(some(5, plain=True))
    writer.flush()

    def growing(file: Path) -> can.LogReader:
        looks.append(path.stat().st_size)
        if len(looks) == 1:
            writer.write(some(5, plain=True))
            writer.flush()
            raise ValueError("Incomplete block")
        return reader(file)

    monkeypatch.setattr(can, "LogReader", growing)
    assert len(read_log(path)[0]) == 10
    assert len(looks) == 2
    writer.close()

    def broken(file: Path) -> can.LogReader:
        raise ValueError("Incomplete block")

    monkeypatch.setattr(can, "LogReader", broken)
    with pytest.raises(UserError, match="gives no frame; expected a whole MF4 bus log"):
        read_log(path)


def test_half_floats_like_cantools() -> None:
    """The generator above has no floats of 16 bits: their layout is Intel, their numbers are IEEE 754's."""
    conversion = cantools.database.conversion.BaseConversion.factory(scale=0.5, offset=-1, is_float=True)
    signal = cantools.database.Signal("half", 8, 16, byte_order="little_endian", conversion=conversion)
    message = cantools.database.Message(0x123, "M", 4, [signal], strict=True)
    decoder = Decoder.__new__(Decoder)
    decoder.messages = {(0x123, False): message}
    payloads = [bytes([9]) + np.float16(value).tobytes() + b"\7" for value in (1.5, -2.25, 65504.0, 6e-8)]
    found = decoder.decode(frames(Path("made"), np.zeros(4), [0x123] * 4, payloads, [0] * 4))["M"].signals["half"]
    expected = [float(message.decode(payload)["half"]) for payload in payloads]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_an_extended_identifier_is_another_message(tmp_path: Path) -> None:
    """100 and 100x are two messages; remote and error frames are none, whatever their bytes."""
    dbc = tmp_path / "x.dbc"
    signal = ' SG_ a : 0|8@1+ (1,0) [0|255] "" A\n'
    dbc.write_text(f'VERSION ""\nBU_: A\nBO_ 100 P: 8 A\n{signal}BO_ {100 | 1 << 31} X: 8 A\n{signal}')
    flags = [0, EXTENDED, REMOTE, ERROR, EXTENDED | REMOTE]
    log = frames(Path("made"), np.arange(5.0), [100] * 5, [bytes([i]) for i in range(5)], flags)
    found = Decoder(dbc).decode(log)
    assert {name: decoded.signals["a"].tolist() for name, decoded in found.items()} == {"P": [0.0], "X": [1.0]}
    assert [*Decoder(dbc, ["X"]).decode(log)] == ["X"]


SCREEN = """
  can0  110   [8]  10 27 00 00 E8 03 00 01
  can0  20000088   [8]  00 00 00 02 00 00 00 00   ERRORFRAME
  can0  TX - -  111   [2]  11 27   '.\'\'
  can0  1F0   [0]  remote request

  can0  01ABCDE2  [12]  00 11 22 33 44 55 66 77 88 99 AA BB
"""


def test_what_candump_prints_on_a_screen(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_text(SCREEN)
    log, cut = read_log(path)
    assert cut == ""
    assert log.identifiers.tolist() == [0x110, 0x88, 0x111, 0x1F0, 0x1ABCDE2]
    assert log.flags.tolist() == [0, ERROR, SENT, REMOTE, EXTENDED | FD]
    assert [log.payload(i).hex() for i in range(5)][0::2] == ["10270000e8030001", "1127", "00112233445566778899aabb"]
    assert log.times.tolist() == [0.0] * 5


@pytest.mark.parametrize(
    ("stamps", "times"),
    [
        (["2026-03-02 14:05:01.250001", "2026-03-02 14:05:01.350420"], [1772460301.250001, 1772460301.350420]),
        (["000.000000", "1.5"], [0.0, 1.5]),
    ],
)
def test_stamps_on_a_screen(tmp_path: Path, stamps: list[str], times: list[float]) -> None:
    (tmp_path / "x.log").write_text("".join(f" ({stamp})  can1  2A0   [2]  01 02\n" for stamp in stamps))
    np.testing.assert_allclose(read_log(tmp_path / "x.log")[0].times, times, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "row", ["  can0  110   [3]  10 27", " (yesterday)  can0  110   [1]  10", "  can0  110  8 bytes"]
)
def test_a_damaged_line_of_a_screen_is_named(tmp_path: Path, row: str) -> None:
    (tmp_path / "x.log").write_text(f"  can0  110   [1]  10\n{row}\n")
    with pytest.raises(UserError, match=r"x\.log:2: found"):
        read_log(tmp_path / "x.log")


def test_busmasters_first_frame_is_read(tmp_path: Path) -> None:
    """python-can 4.6 takes it for the begin of a trigger block, and it is gone."""
    rows = [f"50701.25{i}100 1 11{i} Rx d 2 1{i} 27" for i in range(3)]
    head = "date Mon Mar 2 02:05:01 pm 2026\nbase hex  no internal events logged\n// version 7.1.0\n"
    (tmp_path / "x.asc").write_text(head + "\n".join(rows) + "\n")
    log, _ = read_log(tmp_path / "x.asc")
    assert log.identifiers.tolist() == [0x110, 0x111, 0x112]


def test_a_log_of_pcan_says_what_is_no_frame(tmp_path: Path) -> None:
    head = ";$FILEVERSION=1.1\n;$STARTTIME=46083.5868200231\n;\n"
    rows = ["     1)        10.4  Rx         0110  2  10 27", "     2)        20.4  Error      0008  4  00 00 00 00"]
    rows += ["     3)        30.4  Rx         0111  2  11 27"]
    (tmp_path / "x.trc").write_text(head + "\n".join(rows) + "\n")
    reader = LogReader(tmp_path / "x.trc")
    assert [name for block in reader.blocks() for name in block.identifiers.tolist()] == [0x110, 0x111]
    assert reader.cut == ""
    assert reader.lost.startswith("1 row gave no frame, the first in line 5: ")
