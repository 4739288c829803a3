"""Logs of other tools: what python-can writes comes back whole, and of what gives no frame something is said."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from casekit import terrapin

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, frames, joined
from terrapin_tools.logs.reading import LogReader, is_log
from terrapin_tools.logs.resample import signals_on_grid
from terrapin_tools.workbench.files.tables import read
from terrapin_tools.workbench.intake.look import look
from tests.waiting import wait_for

FRAMES = 2000
FIELDS = (
    "timestamp",
    "arbitration_id",
    "is_extended_id",
    "is_remote_frame",
    "is_error_frame",
    "is_fd",
    "is_rx",
    "data",
)
# Kind -> its resolution [s], and what python-can writes of a frame beside identifier, length and data.
KINDS = {
    ".asc": (0.5e-6, "remote error fd sent"),
    ".blf": (0.5e-6, "remote error fd sent"),
    ".csv": (1e-9, "remote error"),
    ".db": (1e-9, "remote error"),
    ".log": (0.5e-6, "remote error fd sent"),
    ".mf4": (0.5e-6, "remote error fd sent"),
    ".trc": (1.5e-6, "sent"),
}


def some(count: int, carries: str) -> list[can.Message]:
    """Frames of all kinds that a format carries, at 0.1 to 1 ms, from 2023 on."""
    random = np.random.default_rng(38)
    times = 1_700_000_000.25 + np.cumsum(random.integers(100, 1000, count)) * 1e-6
    found = []
    for time in times.tolist():
        kind = str(random.choice(["plain"] * 6 + ["remote", "error", "fd"]))
        kind = kind if kind in carries else "plain"
        extended = bool(random.integers(2))
        size = int(random.choice([12, 16, 64])) if kind == "fd" else int(random.integers(9))
        found.append(
            can.Message(
                timestamp=time,
                arbitration_id=0 if kind == "error" else int(random.integers(1 << (29 if extended else 11))),
                is_extended_id=extended and kind != "error",
                is_remote_frame=kind == "remote",
                is_error_frame=kind == "error",
                is_fd=kind == "fd",
                is_rx="sent" not in carries or kind == "error" or bool(random.integers(2)),
                channel=int(random.integers(2)),
                data=b"" if kind in ("remote", "error") else random.bytes(size),
            )
        )
    return found


def check(path: Path, messages: list[can.Message], resolution: float) -> None:
    """Every frame, in order, equal; times of an .asc count from its first frame on."""
    reader = LogReader(path)
    back = joined(path, list(reader.blocks()))
    assert (len(back), reader.cut, reader.lost) == (len(messages), "", "")
    times = np.array([m.timestamp for m in messages])
    np.testing.assert_allclose(back.times, times - (times[0] if path.suffix == ".asc" else 0), rtol=0, atol=resolution)
    for row, message in enumerate(messages):
        flags = int(back.flags[row])
        error = message.is_error_frame
        assert bool(flags & ERROR) == error
        assert error or back.identifiers[row] == message.arbitration_id
        assert error or bool(flags & EXTENDED) == message.is_extended_id
        assert bool(flags & REMOTE) == message.is_remote_frame
        assert bool(flags & FD) == message.is_fd
        assert error or bool(flags & SENT) == (not message.is_rx)
        assert error or back.payload(row) == bytes(message.data)
    if path.suffix not in (".csv", ".db"):  # these do not say it
        first = reader.buses[back.bus[0]]
        other = [m.channel == messages[0].channel for m in messages]
        assert [reader.buses[number] == first for number in back.bus] == other


@pytest.mark.parametrize("kind", KINDS)
def test_what_python_can_writes_comes_back(tmp_path: Path, kind: str) -> None:
    resolution, carries = KINDS[kind]
    messages = some(FRAMES if kind != ".mf4" else 300, carries)
    with can.Logger(str(tmp_path / f"x{kind}")) as writer:
        for message in messages:
            writer.on_message_received(message)
        if kind == ".db":  # python-can 4.6 leaves out what its thread has not yet written when it is stopped
            wait_for(lambda: writer.num_frames == len(messages))
    before = (tmp_path / f"x{kind}").read_bytes()
    check(tmp_path / f"x{kind}", messages, resolution)
    assert (tmp_path / f"x{kind}").read_bytes() == before


GVRET = """Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
1772460301250001,00000110,false,Rx,0,8,10,27,00,00,E8,03,00,01,
1772460301250420,00000111,false,Rx,1,2,11,27,,,,,,,
1772460301250500,00000111,false,Rx,1,3,11,27,,,,,,,
1772460301251000,1ABCDE01,true,Tx,0,2,AB,CD,,,,,,,
"""
OLDER = "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n1000,0x110,0,0,1,FF,,,,,,,\n2000,0x111,0,0,1,FE"


def test_savvycan(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text(GVRET)
    reader = LogReader(path)
    (log,) = reader.blocks()
    assert log.identifiers.tolist() == [0x110, 0x111, 0x1ABCDE01]
    assert log.flags.tolist() == [0, 0, EXTENDED | SENT]
    assert log.payload(0).hex() == "10270000e8030001"
    np.testing.assert_allclose(log.times, [1772460301.250001, 1772460301.25042, 1772460301.251], rtol=0, atol=5e-7)
    assert reader.lost.startswith("1 row gave no frame, the first in line 4: '1772460301250500,")
    assert [reader.buses[number] for number in log.bus] == ["0", "1", "0"]
    path.write_text(OLDER)
    (log,) = LogReader(path).blocks()
    assert (log.identifiers.tolist(), log.times.tolist()) == ([0x110, 0x111], [0.001, 0.002])
    path.write_text(OLDER[:-1])  # half a byte
    reader = LogReader(path)
    assert [len(block) for block in reader.blocks()] == [1]
    assert reader.cut == "the last line has no end"


CANKING = """Chn Identifier Flg   DLC  D0...1...2...3...4...5...6..D7       Time     Dir
 0    0000014B         1  0A                                1675.570498 T
 0    0CFBFFDB X       8  1B  31  20  EB  B3  FF  D9  FF    1675.600139 R
 1    00000000            ErrorFrame                        1675.700000 R
 0    0000014B         2  0A                                1675.800000 R
Logging stopped.
"""
MEMORATOR = """                              Kvaser Memorator Log
                              ====================

Settings:
   Format of data field: DEC
   Format of id field:   HEX
   Timestamp Offset:     0.000000           s
   CAN channel:          1 2

        Time Chan   Identifier Flags        DLC  Data                           Counter
====================================================================================
    0.100000  1         7E8    Rx            8    3  89   2 255   0   0   0   0             12
    0.200000  2     CFBFFDBx   Tx   FB       9    1   2   3   4   5   6   7   8   9  10  11  12             13
    0.300000  1         123    Rx     R      4  RTR                                14
    0.400000  1  ErrorFrame    Rx                 ERROR FRAME                      15
    0.500000  Trigger (type=0x1, active=0x01, pre-trigger=0, post-trigger=0)
"""
KVASER_CSV = """CSV CAN data
Converted from Kvaser Memorator at;2026-03-02 14:05:01
Format of data field;HEX
Format of id field;DEC
Timestamp Offset;0,000000;seconds
Logging started at;2026-03-02 14:00:00
Time;Channel;id;Flags;DLC;Data0;Data1;Data2;Data3;Data4;Data5;Data6;Data7;Counter;AbsTime
0,10000;1;272;2;3;10;27;ff;;;;;;1;2026-03-02 14:00:00
0,20000;2;448519681;4;0;;;;;;;;;2;2026-03-02 14:00:00
0,30000;1;;34;;;;;;;;;;3;2026-03-02 14:00:00
0,40000;1;291;3;4;;;;;;;;;4;2026-03-02 14:00:00
"""


def test_kvaser(tmp_path: Path) -> None:
    def told(name: str, text: str) -> tuple[LogReader, list[tuple[float, int, int, str, str]]]:
        (tmp_path / name).write_text(text)
        reader = LogReader(tmp_path / name)
        (log,) = reader.blocks()
        columns = (log.times.tolist(), log.identifiers.tolist(), log.flags.tolist(), log.bus.tolist())
        rows = enumerate(zip(*columns, strict=True))
        return reader, [(t, i, f, log.payload(row).hex(), reader.buses[b]) for row, (t, i, f, b) in rows]

    reader, found = told("x.txt", CANKING)
    assert found == [
        (1675.570498, 0x14B, SENT, "0a", "0"),
        (1675.600139, 0xCFBFFDB, EXTENDED, "1b3120ebb3ffd9ff", "0"),
        (1675.7, 0, ERROR, "", "1"),
    ]
    assert reader.lost.startswith("1 row gave no frame, the first in line 5: ")
    reader, found = told("y.txt", MEMORATOR)
    assert found == [
        (0.1, 0x7E8, 0, "035902ff00000000", "1"),
        (0.2, 0xCFBFFDB, EXTENDED | FD | SENT, "0102030405060708090a0b0c", "2"),
        (0.3, 0x123, REMOTE, "", "1"),
        (0.4, 0, ERROR, "", "1"),
    ]
    assert "Trigger" in reader.lost
    reader, found = told("z.csv", KVASER_CSV)
    assert found == [
        (0.1, 272, 0, "1027ff", "1"),
        (0.2, 448519681, EXTENDED, "", "2"),
        (0.3, 0, ERROR, "", "1"),
        (0.4, 291, REMOTE, "", "1"),
    ]
    assert reader.lost == ""
    with pytest.raises(UserError, match="expected identifiers: export without J1939"):
        told("w.csv", KVASER_CSV.replace(";id;", ";PGN;"))


def test_times_between_frames_are_summed(tmp_path: Path) -> None:
    """candump -td; the same stamps that rise are those of -tz. A step back now and then is a mishap of a clock."""
    path = tmp_path / "x.log"

    def times(stamps: list[float], form: str = "(%010.6f) can0 110#01\n") -> tuple[list[float], list[str]]:
        path.write_text("".join(form % stamp for stamp in stamps))
        reader = LogReader(path)
        return joined(path, list(reader.blocks())).times.round(6).tolist(), reader.assumed

    summed = ["times are those between frames (candump -td): summed"]
    assert times([0.0, 0.01, 0.01001, 0.00999]) == ([0.0, 0.01, 0.02001, 0.03], summed)
    assert times([0.0, 0.01, 0.01], " (%010.6f)  can0  110   [1]  01\n") == ([0.0, 0.01, 0.02], summed)
    assert times([0.0, 0.01, 0.02, 0.03]) == ([0.0, 0.01, 0.02, 0.03], [])
    rising = [i * 0.01 for i in range(30)]
    rising[20], rising[21] = rising[21], rising[20]
    assert times(rising) == ([round(t, 6) for t in rising], [])


def test_a_log_without_times_is_no_measurement(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.log"
    path.write_text(
        "  can0  110   [1]  01\n\n  can0  20000088   [8]  00 00 00 02 00 00 00 00   ERRORFRAME\n\tbus-error\n"
    )
    answer = json.loads(terrapin(capsys, "log", "info", path, "--json", "-")[1])
    assert answer["frames"] == 2
    assert answer["assumed"] == ["found no time stamps (candump without -t): all times are 0"]
    with pytest.raises(UserError, match=r"x\.log: found no time stamps, expected a log with them"):
        signals_on_grid(path, _decoder(tmp_path), 0.01)


ASC = """date Mon Mar 2 02:05:01.250 pm 2026
base hex  timestamps {stamps}
Begin TriggerBlock Mon Mar 2 02:05:01.250 pm 2026
   0.000000 Start of measurement
   0.100000 1  110             Rx   d 2 10 27
   0.200000 1  Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
   0.200000 1  111             Rx   d 2 1Z 27
   0.200000 1  112             Rx   d 3 10 27
   0.300000 1  113             Rx   d 2 10 27
End TriggerBlock
"""


def test_rows_of_an_asc_that_give_no_frame_are_counted(tmp_path: Path) -> None:
    """A damaged row costs its own frame: python-can 4.6 ends there, or gives fewer bytes than the row states."""
    path = tmp_path / "x.asc"
    path.write_text(ASC.format(stamps="absolute"))
    reader = LogReader(path)
    log = joined(path, list(reader.blocks()))
    assert (log.identifiers.tolist(), log.times.tolist()) == ([0x110, 0x113], [0.1, 0.3])
    assert reader.lost.startswith("3 rows gave no frame, the first in line 6: '0.200000 1  Statistic")
    path.write_text(ASC.format(stamps="relative"))
    reader = LogReader(path)
    assert joined(path, list(reader.blocks())).times.round(9).tolist() == [0.1, 1.0]
    assert reader.assumed == ["times are those between rows (timestamps relative): summed"]
    path.write_text(ASC.format(stamps="relative").partition("End")[0] + "   0.4 1  113  Rx   d 2 1")
    notes = [reader.lost, "the last line has no end", *reader.assumed]
    assert look(path, _decoder(tmp_path).path)["notes"] == notes


def test_trc_of_all_versions(tmp_path: Path) -> None:
    bodies = {
        "": " 1)  10  0110  2  10 27\n 2)  20  0111  2  10 28\n",
        "1.1": " 1)  10.4  Rx  0110  2  10 27\n 2)  20.4  Rx  0111  2  10 28\n",
        "1.2": " 1)  10.4 1  Rx  0110  2  10 27\n 2)  20.4 1  Rx  0111  2  10 28\n",
        "1.3": " 1)  10.4 1  Rx  0110 -  2  10 27\n 2)  20.4 1  Rx  0111 -  2  10 28\n",
        "2.0": " 1  10.4 DT  0110 Rx 2  10 27\n 2  20.4 DT  0111 Rx 2  10 28\n",
        "2.1": " 1  10.4 DT 1 0110 Rx - 2  10 27\n 2  20.4 DT 1 0111 Rx - 2  10 28\n",
    }
    names = {"2.0": "N,O,T,I,d,l,D", "2.1": "N,O,T,B,I,d,R,L,D"}
    for version, body in bodies.items():
        head = f";$FILEVERSION={version}\n;$STARTTIME=46083.5\n" if version else ";   Start time: x\n"
        head += f";$COLUMNS={names[version]}\n" if version in names else ""
        (tmp_path / "x.trc").write_text(head + body)
        reader = LogReader(tmp_path / "x.trc")
        (log,) = reader.blocks()
        assert (reader.lost, log.identifiers.tolist(), log.payload(1).hex()) == ("", [0x110, 0x111], "1028"), version
        assert log.times[1] - log.times[0] == pytest.approx(0.01, abs=1e-6)


def test_a_table_is_no_log(tmp_path: Path) -> None:
    for name, text in (("a.csv", "Time Stamp,ID\n1,2\n"), ("b.txt", "hello\n"), ("c.db", "hello\n")):
        (tmp_path / name).write_text(text)
        assert not is_log(tmp_path / name)
        with pytest.raises(UserError, match="expected a log of"):
            LogReader(tmp_path / name)
    (tmp_path / "d.csv").write_text(GVRET)
    assert is_log(tmp_path / "d.csv")


def test_a_new_kind_is_one_file(tmp_path: Path) -> None:
    """The page's example in a scratch copy of the tools: info, convert, look, a case and the upload know it."""
    root = Path(__file__).resolve().parents[2]
    copy = tmp_path / "host_tools"
    shutil.copytree(root / "host_tools", copy, ignore=shutil.ignore_patterns("__pycache__", "static"))
    text = (root / "docs" / "logs.md").read_text()
    (block,) = re.findall(r"<!-- file: (host_tools/\S+/logs/formats/\S+) -->\n```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / block[0]).write_text(block[1])
    (tmp_path / "x.dbc").write_text(
        'VERSION ""\nBU_: A\nBO_ 272 M: 8 A\n SG_ a : 0|16@1+ (0.5,0) [0|65] "N" A\n SG_ b : 16|8@1+ (1,0) [0|9] "A" A'
    )
    (tmp_path / "x.frames").write_text("".join(f"{0.02 * i} 110 {3 * i:02X} 00 {i:02X}\n" for i in range(40)) + "no\n")
    program = f"""
import sys
from terrapin_tools.cli import main
from terrapin_tools.web.service.uploads import SUFFIXES
assert {str(copy)!r} in sys.modules["terrapin_tools"].__file__
assert ".frames" in SUFFIXES
for words in (
    "log info x.frames --dbc x.dbc", "log convert x.frames y.log", "look x.frames --dbc x.dbc",
    "case map x.frames --to made --base equation --dbc x.dbc --period 20~ms --column f=M.a --unit f=N --column i=M.b "
    "--unit i=A --equation f=k*i --fit k=1:0:9:N/A --train x",
):
    sys.argv = ["terrapin", *(word.replace("~", " ") for word in words.split())]
    try:
        main()
    except SystemExit as end:
        assert not end.code, words
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(copy), str(root / "hil"), str(root / "firmware")])}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "1 row gave no frame, the first in line 41: 'no'" in " ".join(done.stdout.split())
    assert len((tmp_path / "y.log").read_text().splitlines()) == 40
    assert "40 frames of 1 messages" in done.stdout
    assert (tmp_path / "made" / "case.toml").is_file()


def _decoder(folder: Path) -> Decoder:
    text = 'VERSION ""\nBU_: A\nBO_ 272 M: 8 A\n SG_ a : 0|16@1+ (0.001,0) [0|65] "N" A\n'
    (folder / "x.dbc").write_text(text)
    return Decoder(folder / "x.dbc")


def test_two_buses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A message of one bus keeps its name; one of two says on which, and the log of a table asks for one of them."""
    path = tmp_path / "x.log"
    path.write_text("".join(f"({t / 10:.1f}) can{t % 2} 110#{t:02X}00\n" for t in range(6)))
    columns = signals_on_grid(path, _decoder(tmp_path), 0.1)
    assert columns["can0:M.a"].tolist()[-1] == 0.004
    assert columns["can1:M.a"].tolist()[-1] == 0.005
    with pytest.raises(UserError, match=r"column M\.a: found it on the buses can0 and can1, .* can0:M\.a"):
        read(path, tmp_path / "x.dbc", 0.1, ["M.a"])
    assert read(path, tmp_path / "x.dbc", 0.1, ["can1:M.a"]).columns["can1:M.a"][0] == 0.001
    text = terrapin(capsys, "log", "info", path)[1]
    assert "buses: can0, can1" in text
    terrapin(capsys, "log", "convert", path, tmp_path / "back.blf")
    assert LogReader(tmp_path / "back.blf").lost == ""
    assert joined(path, list(LogReader(tmp_path / "back.blf").blocks())).bus.tolist() == [0, 1] * 3


EXTENDED_MUX = """VERSION ""
BU_: A
BO_ 272 M: 8 A
 SG_ s M : 0|4@1+ (1,0) [0|15] "" A
 SG_ a m0 : 8|8@1+ (1,0) [0|255] "" A
 SG_ t m1M : 8|8@1+ (1,0) [0|255] "" A
 SG_ b m0 : 16|8@1+ (1,0) [0|255] "" A
 SG_ c m3 : 16|8@1+ (1,0) [0|255] "" A
SG_MUL_VAL_ 272 a s 0-0;
SG_MUL_VAL_ 272 t s 1-1;
SG_MUL_VAL_ 272 b t 0-2;
SG_MUL_VAL_ 272 c t 3-9;
"""


def test_extended_multiplexing_like_cantools(tmp_path: Path) -> None:
    """A selector that is selected itself, with ranges: where it is absent, what it selects is absent too."""
    (tmp_path / "x.dbc").write_text(EXTENDED_MUX)
    payloads = [bytes([s, t, v, 0, 0, 0, 0, 0]) for s in (0, 1) for t in (0, 2, 3, 9) for v in (7, 8)]
    log = frames(Path("x"), np.arange(len(payloads)), [272] * len(payloads), payloads, [0] * len(payloads))
    found = Decoder(tmp_path / "x.dbc").decode(log)["M"].signals
    message = cantools.database.load_file(tmp_path / "x.dbc").get_message_by_name("M")
    for row, payload in enumerate(payloads):
        expected = message.decode(payload)
        assert {name: v[row] for name, v in found.items() if not np.isnan(v[row])} == expected


@pytest.mark.parametrize("kind", ["kcd", "sym", "dbc", "arxml"])
def test_descriptions_of_every_kind(tmp_path: Path, kind: str) -> None:
    """The same message of a description that cantools writes itself (ARXML it only reads) decodes alike."""
    source = paths.build() / "generated" / "terrapin.dbc"
    database = cantools.database.load_file(source)
    path = tmp_path / f"x.{kind}"
    if kind == "arxml":
        path.write_text("<AUTOSAR/>")
        with pytest.raises(UserError, match=r"x\.arxml: .*expected a DBC file \(or ARXML, KCD, SYM\)"):
            Decoder(path)
        return
    cantools.database.dump_file(database, path)
    message = database.get_message_by_name("GROUND")
    log = frames(Path("x"), [0.0], [message.frame_id], [bytes(range(8))], [0])
    found, expected = (Decoder(file).decode(log)["GROUND"].signals for file in (path, source))
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-12)


def test_what_a_log_assumed_is_told_by_the_case(tmp_path: Path) -> None:
    (tmp_path / "x.log").write_text(
        "(000.000000) can0 110#0100\n(000.010000) can0 110#0200\n(000.005000) can0 110#0300\n"
    )
    _decoder(tmp_path)
    found = read(tmp_path / "x.log", tmp_path / "x.dbc", 0.005, ["M.a"])
    assert found.notes == ("times are those between frames (candump -td): summed",)
    assert found.columns["M.a"].tolist() == [0.001, 0.001, 0.002, 0.003]


def test_a_damaged_mf4_prints_no_traceback(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """asammdf's own log does; what is wrong stands in the answer, or is one line."""
    with can.Logger(str(tmp_path / "x.mf4")) as writer:
        for message in some(60, "sent"):
            writer.on_message_received(message)
    whole = (tmp_path / "x.mf4").read_bytes()
    capfd.readouterr()
    for place in range(100, len(whole), len(whole) // 25):
        (tmp_path / "y.mf4").write_bytes(whole[:place] + bytes([whole[place] ^ 0x5A]) + whole[place + 1 :])
        reader = LogReader(tmp_path / "y.mf4")
        with contextlib.suppress(UserError):
            read_back = sum(len(block) for block in reader.blocks())
            assert read_back == 60 or reader.cut or reader.lost, place
    (tmp_path / "y.mf4").write_bytes(whole[: len(whole) * 7 // 10])
    with pytest.raises(UserError, match="expected a whole MF4 bus log"):
        list(LogReader(tmp_path / "y.mf4").blocks())
    assert capfd.readouterr().err == ""
