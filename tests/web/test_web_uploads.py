"""Uploads, what is said about them, and cases made of them."""

from __future__ import annotations

import io
import json
import random
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from serving import Server
from websockets.sync.client import connect

from terrapin_tools.workbench.new_case.from_tables import base_of
from tests.attack.bombs import READERS, frames_log

ROOT = Path(__file__).resolve().parents[2]
HEATED = (ROOT / "cases" / "heated_motor" / "runs.csv").read_bytes()
DBC = b"""VERSION ""
BU_: A
BO_ 291 MOTOR: 8 A
 SG_ shell_speed : 0|16@1- (0.01,0) [0|0] "rad/s" A
 SG_ current : 16|16@1- (1,0) [0|0] "mA" A
"""


def good(server: Server, name: str, content: bytes) -> dict[str, Any]:
    answer = server.upload(name, content)
    assert answer.status == 201, answer.body
    return dict(answer.json)


def order(name: str, *uploads: str, **changes: Any) -> dict[str, Any]:
    """The body that makes heated_motor of its table."""
    return {
        "name": name,
        "base": "rolling_steady",
        "effects": ["speed_squared"],
        "uploads": list(uploads),
        "run": "run",
        "columns": {
            "omega": {"column": "shell_speed", "unit": "rad/s"},
            "temperature": {"column": "winding", "unit": "degC"},
            "current": {"column": "motor_current", "unit": "mA", "sigma": 1.5},
        },
        "parameters": {
            "radius": "80 mm",
            "drive_radius": "18 mm",
            "torque_constant": 0.1,
            "coulomb": "12 mN m",
            "viscous": "1 mN m s/rad",
            "load": "18.639 N",
        },
        "fit": {"f_o": {"value": 0.05, "min": 0.0, "max": 0.5}},
        **changes,
    }


def made(server: Server, body: dict[str, Any]) -> dict[str, Any]:
    """The job that makes a case, when it has ended."""
    answer = server.ask("POST", "/api/cases", body)
    assert answer.status == 202, answer.body
    job = server.wait(answer.json["id"])
    assert job["command"] == answer.json["command"]
    return job


def log(times: list[float]) -> bytes:
    return "".join(f"({t:.6f}) can0 123#{i % 256:02X}0001000000 \n" for i, t in enumerate(times)).encode()


def test_a_table_becomes_a_case_that_answers_as_the_original(server: Server) -> None:
    upload = good(server, "my%20runs%20(1).csv", HEATED)
    assert upload["kind"] == "csv"
    assert upload["rows"] == 72
    assert upload["run_guess"] == "run"
    columns = {column["name"]: column for column in upload["columns"]}
    assert columns["winding"]["role_guess"] == "temperature"
    assert columns["motor_current"]["role_guess"] == "current"
    assert columns["shell_speed"]["preview"][0] == "2.8217"
    assert not columns["run"]["numeric"]
    assert server.get(f"/api/uploads/{upload['id']}/preview") == upload
    job = made(server, order("from_table", upload["id"]))
    assert job["state"] == "done", job["error"]
    assert job["result"] == {"rows": 72, "runs": 12, "warnings": []}
    server.ask("POST", "/api/examples/heated_motor")
    answers = [server.wait(server.start(name, do="compare"))["result"] for name in ("from_table", "heated_motor")]
    for answer in answers:
        assert answer["verdict"] == "missing"
    assert answers[0]["parameters"] == answers[1]["parameters"]
    assert server.ask("POST", "/api/cases", order("from_table", upload["id"])).status == 409
    assert server.ask("DELETE", f"/api/uploads/{upload['id']}").status == 200
    assert server.get("/api/cases/from_table")["rows"] == 72  # the case keeps its own copy


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"columns": {"omega": {"column": "winding_2", "unit": "rad/s"}}}, "column 'winding_2' is not in runs.csv"),
        ({"columns": {"omega": {"column": "shell_speed", "unit": "kg"}}}, "found 'kg'"),
        ({"base": "nonsense"}, "model.base: found 'nonsense'"),
        ({"parameters": {"radius": "-80 mm"}}, "expected more than 0"),
        ({"effects": ["nonsense"]}, "unknown effect nonsense"),
        ({"fit": {"f_o": {"value": 2.0, "max": 1.0}}}, "expected between min"),
        ({"run": "nonsense"}, "data.run"),
    ],
)
def test_a_case_that_would_be_broken_is_not_made(server: Server, changes: dict[str, Any], words: str) -> None:
    upload = good(server, "runs.csv", HEATED)
    before = server.files()
    job = made(server, order("never", upload["id"], **changes))
    assert job["state"] == "failed"
    assert words in job["error"]
    assert ".new-" not in job["error"]
    assert "\n" not in job["error"]
    after = {path: size for path, size in server.files().items() if not path.startswith("jobs")}
    assert after == {path: size for path, size in before.items() if not path.startswith("jobs")}


def test_every_nth_row(server: Server) -> None:
    upload = good(server, "runs.csv", HEATED)
    assert made(server, order("thinned", upload["id"], every=3))["result"]["rows"] == 24
    lines = HEATED.decode().splitlines()
    table = pyarrow.parquet.read_table(server.workspace / "cases" / "thinned" / "runs.parquet")
    assert table.column("shell_speed").to_pylist() == [float(line.split(",")[2]) for line in lines[1::3]]


def test_parquet(server: Server) -> None:
    buffer = io.BytesIO()
    table = pyarrow.table({"t [s]": np.arange(5.0), "slip": np.linspace(0, 1, 5), "note": ["a"] * 5})
    pyarrow.parquet.write_table(table, buffer)
    upload = good(server, "plates.parquet", buffer.getvalue())
    assert (upload["kind"], upload["rows"]) == ("parquet", 5)
    guesses = {column["name"]: column["role_guess"] for column in upload["columns"]}
    assert guesses == {"t [s]": "time", "slip": "slip", "note": None}


def test_a_log_with_its_dbc(server: Server) -> None:
    dbc = good(server, "bus.dbc", DBC)
    assert (dbc["kind"], dbc["rows"]) == ("dbc", 1)
    other = good(server, "other.dbc", DBC.replace(b"291", b"292"))
    content = log([0.01 * i for i in range(50)])
    refused = server.upload("run_a.log", content)
    assert refused.status == 422  # the controller's own DBC knows nothing of it
    assert "found no frame that terrapin.dbc knows" in refused.detail
    answer = server.ask("POST", f"/api/uploads?name=run_a.log&dbc={dbc['id']}", content)
    assert answer.status == 201, answer.body
    upload = answer.json
    columns = {column["name"]: column for column in upload["columns"]}
    assert columns["MOTOR.shell_speed"]["unit_guess"] == "rad/s"
    assert columns["MOTOR.current"]["role_guess"] == "current"
    wrong = server.ask("GET", f"/api/uploads/{upload['id']}/preview?dbc={other['id']}")
    assert wrong.status == 422
    assert "found no frame that other.dbc knows" in wrong.detail
    none = server.ask("POST", f"/api/uploads?name=run_c.log&dbc={upload['id']}", content)
    assert none.status == 422
    assert "found an upload that is none, expected a DBC" in none.detail
    again = server.ask("POST", f"/api/uploads?name=run_b.log&dbc={dbc['id']}", log([0.01 * i for i in range(60)])).json
    body = order(
        "from_log",
        upload["id"],
        again["id"],
        run="",
        dbc=dbc["id"],
        effects=[],
        columns={
            "omega": {"column": "MOTOR.shell_speed", "unit": "rad/s"},
            "current": {"column": "MOTOR.current", "unit": "mA"},
        },
    )
    job = made(server, body)
    assert job["state"] == "done", job["error"]
    assert job["result"]["runs"] == 2
    assert sorted(p.name for p in (server.workspace / "cases" / "from_log").iterdir()) == [
        "bus.dbc", "case.toml", "run_a.log", "run_b.log",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "a.csv",
            b"time;w [rad/s]\n0,0;1,5\n0,1;1,6\n0,1;1,7\n",
            "1 time stamp stands twice in a run (first at a.csv:4)",
        ),
        ("a.csv", b"t,w\n0,1\n1,1\n0.5,1\n2,1\n", "the clock steps back 1 times in a run (first at a.csv:4)"),
        (
            "a.csv",
            b"t [s],w\n" + b"".join(b"%d,1\n" % (i + 1000 * (i > 15)) for i in range(30)),
            "the clock jumps 1 times in a run, by 1001 s",
        ),
        ("a.csv", b"t,i\n0,2 mA\n1,3 A\n", "column i: found mixed units in its cells (A, mA)"),
        ("a.csv", b"t,v_km_h,v_m_s\n0,3.6,1\n1,7.2,2\n", "mixed units: v_km_h and v_m_s"),
        ("a.csv", b"t,i\n0,1\n1,\n2,3\n", "an empty cell"),
        ("a.csv", b"t,i\n0,1\n1,2 5\n2,\n3,7\n", "a.csv:3: column i"),
    ],
)
def test_what_is_odd_is_said(server: Server, name: str, content: bytes, words: str) -> None:
    warnings = good(server, name, content)["warnings"]
    assert any(words in line for line in warnings), warnings


def test_a_column_with_gaps_is_mapped_without_those_rows(server: Server) -> None:
    """One empty cell made text of the column, which then could not be mapped; `terrapin look` called it numbers."""
    rows = [*HEATED.decode().splitlines()]
    names = rows[0].split(",")
    speed, winding = names.index("shell_speed"), names.index("winding")
    for line, column, text in ((5, speed, ""), (9, speed, "n/a"), (20, winding, "NaN")):
        cells = rows[line].split(",")
        cells[column] = text
        rows[line] = ",".join(cells)
    rows[30] = "," * (len(names) - 1)
    rows = [f"{row},{'' if i else 'empty'}" for i, row in enumerate(rows)]
    upload = good(server, "gaps.csv", "\n".join(rows).encode())
    columns = {column["name"]: column for column in upload["columns"]}
    assert columns["shell_speed"]["numeric"]
    assert columns["shell_speed"]["min"] > 0.0
    assert not columns["empty"]["numeric"]
    told = "column shell_speed: found an empty cell or no number in 3 of 72 rows (first at gaps.csv:6)"
    assert any(told in line for line in upload["warnings"]), upload["warnings"]
    job = made(server, order("gaps", upload["id"]))
    assert job["state"] == "done", job["error"]
    assert server.get("/api/cases/gaps")["rows"] == 68


def test_decimal_commas_and_a_byte_order_mark_are_read(server: Server) -> None:
    upload = good(server, "a.csv", b"\xef\xbb\xbft [s];w_shell [rad/s]\r\n0,5;1,5\r\n0,6;1,7\r\n")
    assert upload["warnings"] == []
    shell = upload["columns"][1]
    assert (shell["name"], shell["role_guess"], shell["max"]) == ("w_shell [rad/s]", "omega", 1.7)


def test_a_heading_is_told_as_a_name_in_letters(server: Server) -> None:
    """The page made ltemperatur of it, the command line oeltemperatur."""
    text = "t [s];Öltemperatur [°C];Débit (l/min);ω_Welle;5 V rail\n0;20;1;2;3\n1;21;1;2;3\n"
    upload = good(server, "a.csv", text.encode())
    names = [column["name_guess"] for column in upload["columns"]]
    assert names == ["time", "oeltemperatur", "debit", "omega_welle", "c_5_v_rail"]


def test_a_file_keeps_its_name_in_letters(server: Server) -> None:
    """The page offered lbad as the name of the case. A Mac sends an umlaut as its letter and two dots."""
    names = ("\u00d6lbad 80 C.csv", "O\u0308lbad_2-a.csv", "\u03c9--1.csv", "\u6cb9.csv")
    found = [good(server, quote(name), b"t,w\n0,1\n1,2\n")["name"] for name in names]
    assert found == ["Oelbad_80_C.csv", "Oelbad_2-a.csv", "omega--1.csv", "file.csv"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"time,w\n0,1,5\n", "(a decimal comma?)"),
        ("a.csv", b"", "found no bytes"),
        ("a.csv", b"\n\n", "expected a line of column names"),
        ("a.csv", b"a,b\n", "no rows"),
        ("a.csv", b"t,w\n0,1\n\x81,1\n", "is not UTF-8 text"),
        ("a.csv", b"t,w\n" + b"0,1\n" * 400_000 + b"0,1,5\n", "expected a CSV file"),
        ("a.csv", b"t,w\n" + b"0,1\n" * 400_000 + b"\x81,1\n", "expected a CSV file"),
        ("a.parquet", b"PAR1 no more", "expected a Parquet file"),
        ("a.log", b"hello\n", "expected candump text"),
        ("a.blf", b"hello", "expected a BLF bus log"),
        ("a.asc", b"\xff\xfehello", "expected a"),
        ("a.mf4", b"hello", "expected an MF4 bus log"),
        ("a.mcap", b"hello", "expected an MCAP file"),
        ("a.dbc", b"hello", "expected a DBC file"),
        ("a.log", b"\x00" * 5000, "expected a bus log"),
    ],
)
def test_what_is_no_measurement_is_refused_in_one_line(server: Server, name: str, content: bytes, words: str) -> None:
    before = server.files()
    answer = server.upload(name, content)
    assert answer.status == 422, answer.body
    assert words in answer.detail
    assert str(server.folder) not in answer.detail
    assert "uploads/" not in answer.detail
    assert server.files() == before


def test_clock_of_a_log(server: Server) -> None:
    dbc = good(server, "bus.dbc", DBC)["id"]
    times = [0.01 * i for i in range(50)]
    odd = [*times, 40.0, *(40.0 + t for t in times)]
    answer = server.ask("POST", f"/api/uploads?name=a.log&dbc={dbc}", log(odd) + b"(99.0) can0 12")
    assert answer.status == 201, answer.body
    said = " ".join(answer.json["warnings"])
    assert "clock: MOTOR is silent for 39.5 s" in said
    assert "read up to where it was cut off" in said


def test_tables_of_different_units_are_not_joined(server: Server) -> None:
    one = good(server, "one.csv", b"w [rad/s],i [A]\n1,2\n2,3\n")["id"]
    two = good(server, "two.csv", b"w [rpm],i [A]\n1,2\n2,3\n")["id"]
    columns = {"omega": {"column": "w [rad/s]", "unit": "rad/s"}, "current": {"column": "i [A]", "unit": "A"}}
    job = made(server, order("mixed", one, two, columns=columns, run=""))
    assert job["state"] == "failed"
    assert "two.csv: column w [rpm]: found rpm, expected rad/s as in one.csv: mixed units" in job["error"]


def test_progress_of_a_large_upload_is_told(server: Server) -> None:
    content = b"t,w [rad/s]\n" + b"".join(b"%d,1.5\n" % i for i in range(600_000))
    with connect(f"ws://127.0.0.1:{server.port}/api/events?token={server.token}") as line:
        upload = good(server, "large.csv", content)
        events = []
        while not events or events[-1].get("state") != "done":
            events.append(json.loads(line.recv(timeout=300)))
    assert upload["rows"] == 600_000
    assert upload["columns"][0]["max"] == 599_999
    mine = [event for event in events if event.get("upload") == upload["id"]]
    assert mine[0]["state"] == "receiving"
    assert mine[0]["of"] == len(content)


def test_what_a_file_holds_is_what_the_command_says(server: Server) -> None:
    table = "time [s],torque [N m]\n" + "".join(f"{i * 0.1:.1f},{(i * 7) % 13 / 4}\n" for i in range(50))
    upload = good(server, "a.csv", table.encode())
    lines = server.get(f"/api/uploads/{upload['id']}/look")["lines"]
    assert lines[0] == "a.csv: 50 rows, 2 columns"
    assert any("steps of 0.25" in line for line in lines)
    assert any("every 0.1 s, 10 Hz" in line for line in lines)


def test_models_that_a_table_suits_are_fitted_briefly(server: Server, tmp_path: Path) -> None:
    """As the command line says it: of a wheel's rows the names alone would take the sphere."""
    table = (ROOT / "cases/wheel_on_soil/runs.csv").read_bytes()
    upload = good(server, "wheel.csv", table)
    assert upload["base_guess"] == "sphere_contact"
    found = server.get(f"/api/uploads/{upload['id']}/bases")
    assert found["base"] == "wheel_contact"
    (tmp_path / "wheel.csv").write_bytes(table)
    base, lines = base_of(tmp_path / "wheel.csv")
    assert (base.name, lines) == (found["base"], found["lines"])
    assert lines[1].startswith("* wheel_contact: leaves 0.")
    assert lines[2].startswith("  sphere_contact: leaves ")
    own = good(server, "own.csv", b"run,dose,yield\n" + b"".join(b"%d,%d,%d\n" % (i % 3, i, 2 * i) for i in range(9)))
    assert server.get(f"/api/uploads/{own['id']}/bases") == {"base": "equation", "lines": []}
    rows = "".join(f"{k};1,{k:03d}\n" for k in range(101, 140))
    doubt = server.ask("POST", "/api/uploads?name=doubt.csv&read=decimal=comma", f"omega;current\n{rows}".encode()).json
    assert server.get(f"/api/uploads/{doubt['id']}/bases") == {"base": "", "lines": []}


@pytest.mark.parametrize("reader", ["MCAP", "BLF", "MF4", "Parquet of frames", "Parquet of a table"])
def test_bombs_are_refused(server: Server, tmp_path: Path, reader: str) -> None:
    """Never 500, and nothing is kept; whatever is small enough is looked at as any other."""
    file, make, _ = READERS[reader]
    for seed in range(3):
        make(tmp_path / file, random.Random(seed))
        answer = server.upload(file, (tmp_path / file).read_bytes())
        assert answer.status == 201 or 400 <= answer.status < 500, (seed, answer.body)
        if answer.status != 201:
            assert "\n" not in answer.detail
    assert server.process.poll() is None


def test_damaged_zstd_is_one_line(server: Server, tmp_path: Path) -> None:
    path = frames_log(tmp_path / "x.mcap", 400)
    data = bytearray(path.read_bytes())
    at = data.index(b"\x28\xb5\x2f\xfd")  # a frame of zstd
    data[at + 8 : at + 40] = bytes(32)
    answer = server.upload("x.mcap", bytes(data))
    assert answer.status == 422, answer.body
    assert "x.mcap" in answer.detail
    assert "\n" not in answer.detail


def test_a_table_is_read_as_somebody_says(server: Server) -> None:
    """What may be read in two ways is refused with both; said, it is taken, and looked at the same way again."""
    rows = "".join(f"{k};1,{k:03d}\n" for k in range(101, 140))
    content = f"omega;current\n{rows}".encode()
    refused = server.ask("POST", "/api/uploads?name=doubt.csv", content)
    assert refused.status == 422
    assert "say which it is with --read decimal=" in refused.detail
    taken = server.ask("POST", "/api/uploads?name=doubt.csv&read=decimal=comma", content)
    assert taken.status == 201, taken.body
    upload = taken.json
    column = {one["name"]: one for one in upload["columns"]}["current"]
    assert (column["min"], column["max"]) == (1.101, 1.139)
    other = server.get(f"/api/uploads/{upload['id']}/preview?read=decimal=point")
    assert {one["name"]: one for one in other["columns"]}["current"]["max"] == 1139
    lines = "\n".join(server.get(f"/api/uploads/{upload['id']}/look?read=decimal=comma")["lines"])
    assert "1.101" in lines
    for wrong in ("decimal=dot", "colour=red", "decimal=comma&read=decimal=point"):
        assert server.ask("GET", f"/api/uploads/{upload['id']}/preview?read={wrong}").status == 422, wrong
