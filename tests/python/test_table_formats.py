"""Every format of the intake: the same values and units from each, and one line for what no one should open."""

from __future__ import annotations

import os
import pickle
import re
import shutil
import struct
import subprocess
import sys
import tomllib
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet
import pytest
from casekit import one_line, terrapin
from table_files import ROS, UNITS, WRITERS, csv, mat_73, numbers, ods, runs

from terrapin_tools import bounded
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files import formats, units
from terrapin_tools.workbench.files.format import Asked, Part
from terrapin_tools.workbench.files.formats import csv_text
from terrapin_tools.workbench.files.tables import read
from terrapin_tools.workbench.files.trees.mat5 import mat5_tree
from terrapin_tools.workbench.new_case.from_tables import split_unit
from tests.attack.bombs_of_tables import with_member

ROOT = Path(__file__).resolve().parents[2]
PLAIN = Asked()


@pytest.mark.parametrize("kind", WRITERS)
def test_the_same_values_and_units_from_every_format(tmp_path: Path, kind: str) -> None:
    name, write = WRITERS[kind]
    columns = numbers(len(kind))
    write(tmp_path / name, columns)
    table = read(tmp_path / name)
    names = {}
    for column in table.columns:
        plain, unit = split_unit(column)
        plain = ROS.get(plain, plain.rpartition("Motor ")[2].rpartition("Oil ")[2])
        names[plain] = (column, unit)
    for one, values in columns.items():
        column, unit = names[one]
        if kind.startswith("xlsx"):
            values = np.array([float(f"{value:.16g}") for value in values])  # as openpyxl writes them
        np.testing.assert_array_equal(table.numbers(column), values)
        if not kind.startswith("ros"):
            turned = units.turns(unit, units.in_si(UNITS[one]))
            assert units.convert(1.0, turned, UNITS[one]) == pytest.approx(1.0, rel=1e-15)
    assert [run.rpartition(" ")[2].rpartition("/")[2] for run in table.text(names["run"][0])] == (
        [f"test({run[1:]})" for run in runs()] if kind == "mat structs" else runs()
    )


def refused(path: Path, expected: str, asked: Asked = PLAIN) -> None:
    with pytest.raises(UserError) as error:
        read(path, asked=asked)
    (line,) = str(error.value).splitlines()
    assert line.isprintable()
    assert path.name in line
    assert expected in line, line


class Planted:
    """What a pickle would run."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (pytest.fail, ("a pickle was opened",))


def test_a_pickle_is_never_opened(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.array([Planted(), 1], dtype=object))
    np.save(tmp_path / "b.npy", np.array([Planted()], dtype=object))
    (tmp_path / "c.npz").write_bytes(pickle.dumps(Planted()))
    (tmp_path / "d.mat").write_bytes(pickle.dumps(Planted()))
    refused(tmp_path / "a.npz", "never opened")
    refused(tmp_path / "b.npy", "never opened")
    refused(tmp_path / "c.npz", "never opened")
    refused(tmp_path / "d.mat", "expected a MATLAB file")


@pytest.mark.parametrize(("rows", "columns", "words"), [(0x7FFFFFFF, 2, "is cut off or damaged"), (5, 2, "is cut off")])
def test_a_text_of_more_rows_than_letters_is_damaged(tmp_path: Path, rows: int, columns: int, words: str) -> None:
    """However many rows a flipped bit makes of it, none is made."""
    import scipy.io

    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"x": np.arange(3.0), "names": np.array(["ab", "cd"])})
    shape = struct.pack("<ii", 2, 2)
    content = path.read_bytes()
    assert content.count(shape) == 1
    assert mat5_tree(path)["names"] == ["ab", "cd"]
    path.write_bytes(content.replace(shape, struct.pack("<ii", rows, columns)))
    refused(path, words)
    path.write_bytes(content.replace(shape, struct.pack("<ii", rows, 0)))
    assert mat5_tree(path)["names"] == "acbd"  # as its letters stand


def test_an_object_of_matlab_is_refused(tmp_path: Path) -> None:
    import h5py
    import scipy.io
    from scipy.io.matlab import MatlabObject

    inner = MatlabObject(np.zeros(1, dtype=[("a", object)]), classname="timetable")
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.arange(3.0), "t": inner})
    refused(tmp_path / "a.mat", "holds an object")
    mat_73(tmp_path / "b.mat", numbers(1))
    with h5py.File(tmp_path / "b.mat", "r+") as file:
        file["speed"].attrs["MATLAB_class"] = np.bytes_(b"timetable")
    refused(tmp_path / "b.mat", "'speed' holds an object")


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound is made small here; what counts is that each reader stops at it."""
    monkeypatch.setattr(bounded, "CELLS", 300 // 8)
    monkeypatch.setattr(bounded, "TABLE_TIMES", 0)
    for kind in (
        "csv.gz",
        "zip",
        "xlsx",
        "ods",
        "mat 5",
        "mat 7",
        "mat 7.3",
        "hdf5",
        "npz",
        "tdms",
        "feather",
    ):
        name, write = WRITERS[kind]
        folder = tmp_path / kind
        folder.mkdir()
        write(folder / name, numbers(2))
        refused(folder / name, "0 MiB")


WIDE = {
    "x.csv": pyarrow.csv.write_csv,
    "x.feather": pyarrow.feather.write_feather,
    "x.parquet": pyarrow.parquet.write_table,
}


@pytest.mark.parametrize("name", WIDE)
def test_more_columns_than_anybody_measures_are_refused(tmp_path: Path, name: str) -> None:
    wide = pyarrow.table({f"c{i}": [1.0] for i in range(bounded.COLUMNS + 1)})
    for table, words in ((wide.drop(["c0"]), ""), (wide, "x.*: holds 4097 columns, expected at most 4096")):
        WIDE[name](table, tmp_path / name)
        if words:
            with pytest.raises(UserError, match=words):
                read(tmp_path / name)
        else:
            assert len(read(tmp_path / name).columns) == bounded.COLUMNS


def test_two_cells_in_opposite_corners_do_not_fill_the_memory(tmp_path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    book.active["A1"], book.active["XFD1048576"] = "x", 1.0
    book.save(tmp_path / "a.xlsx")
    refused(tmp_path / "a.xlsx", "more than 20000000 cells")


@pytest.mark.parametrize(
    ("kind", "member", "at", "piece"),
    [
        ("xlsx", "xl/worksheets/sheet1.xml", b"</sheetData>", b"<row><c><v>1</v></c></row>"),
        ("ods", "content.xml", b"</table:table>", b"<table:table-row><table:table-cell/></table:table-row>"),
    ],
)
def test_a_sheet_of_more_cells_than_a_file_of_its_size_holds(
    tmp_path: Path, kind: str, member: str, at: bytes, piece: bytes
) -> None:
    """Some kB that unpack to a few MB, of half a million rows that each cost a list."""
    path = tmp_path / f"a.{kind}"
    WRITERS[kind][1](path, numbers(1))
    with_member(path, member, at, piece, 12)
    assert path.stat().st_size < 100_000
    refused(path, "rows and cells, expected fewer in a file of its size")
    ods(tmp_path / "b.ods", numbers(3))
    with zipfile.ZipFile(tmp_path / "b.ods") as old, zipfile.ZipFile(tmp_path / "c.ods", "w") as new:
        for info in old.infolist():
            text = (
                old.read(info)
                .decode()
                .replace("<table:table-row><", '<table:table-row table:number-rows-repeated="900000"><')
            )
            new.writestr(info, text.encode())
    refused(tmp_path / "c.ods", "more than 20000000 cells")


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    import h5py
    import openpyxl

    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = np.arange(4.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["y"] = np.arange(4.0)
        file["x"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "x")
    assert list(read(tmp_path / "a.h5").columns) == ["y"]
    with h5py.File(tmp_path / "b.h5", "w") as file:
        layout = h5py.VirtualLayout((4,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "x", (4,))
        file.create_virtual_dataset("x", layout)
    refused(tmp_path / "b.h5", "another file")
    book = openpyxl.Workbook()
    for row in (["x", "y"], [1.0, "='[other.xlsx]Sheet1'!A1"], [2.0, "=1+1"]):
        book.active.append(row)
    book.save(tmp_path / "c.xlsx")
    table = read(tmp_path / "c.xlsx")
    assert table.numbers("x").tolist() == [1.0, 2.0]
    assert np.isnan(table.numbers("y", gaps=True)).all()  # nothing has computed them


def test_rows_above_the_names_of_a_sheet_are_counted(tmp_path: Path) -> None:
    book = pytest.importorskip("openpyxl").Workbook()
    for row in (["Wheel in sand, bin 2"], ["slip", "pull"], ["%", "N"], [5, 1.5], [10, 2.5]):
        book.active.append(row)
    book.save(tmp_path / "one.xlsx")
    book.active.insert_rows(2)
    book.active["A2"] = "operator KL"
    book.save(tmp_path / "two.xlsx")
    assert "1 row above the names" in read(tmp_path / "one.xlsx").notes
    assert "2 rows above the names" in read(tmp_path / "two.xlsx").notes


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    csv(tmp_path / "a.csv", numbers(4))
    before = csv_text.FORMAT.read

    def grows(path: Path, asked: Asked, texts: object) -> list[Part]:
        found = before(path, asked, ())
        with path.open("a") as file:
            file.write("V9,1,2,3\n")
        return found

    monkeypatch.setitem(formats.FORMATS, "a CSV file", replace(csv_text.FORMAT, read=grows))  # type: ignore[arg-type]
    refused(tmp_path / "a.csv", "changed while it was read")


def test_texts_of_a_damaged_feather_file_are_not_followed_out_of_memory(tmp_path: Path) -> None:
    """Where a text ends is a number in the file; pyarrow looks at it only when asked to, else the process may die."""
    path = tmp_path / "x.feather"
    texts = pyarrow.table({"run": ["abcdefgh"] * 24, "speed": np.arange(24.0)})
    pyarrow.feather.write_feather(texts, path, compression="uncompressed")
    ends = np.arange(0, 25 * 8, 8, dtype=np.int32)
    whole = path.read_bytes()
    assert whole.count(ends.tobytes()) == 1
    ends[10] = 2**30
    path.write_bytes(whole.replace(np.arange(0, 25 * 8, 8, dtype=np.int32).tobytes(), ends.tobytes()))
    refused(path, "out of bounds")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_broken_file_is_one_line(tmp_path: Path, kind: str) -> None:
    """Cut and flipped: read, or refused in one line; never a traceback of a library's."""
    name, write = WRITERS[kind]
    write(tmp_path / name, numbers(5))
    file = tmp_path / name if (tmp_path / name).is_file() else next((tmp_path / name).glob("*.db3"))
    whole = file.read_bytes()
    random = np.random.default_rng([38, 5, len(kind)])
    said: list[str] = []
    for turn in range(8):
        content = bytearray(whole[: int(random.integers(1, len(whole)))] if turn % 2 else whole)
        for place in random.integers(0, len(content), 0 if turn % 2 else 20):
            content[int(place)] ^= int(random.integers(1, 256))
        file.write_bytes(content)
        try:
            read(tmp_path / name)
        except UserError as error:
            said.append(str(error))
    assert all(len(line.splitlines()) == 1 for line in said)


@pytest.mark.parametrize(
    ("kind", "extra"),
    [("xlsx", "spreadsheets"), ("hdf5", "hdf5"), ("mat 7.3", "hdf5"), ("tdms", "tdms"), ("ros 1", "ros")],
)
def test_a_reader_that_is_not_installed_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, extra: str
) -> None:
    name, write = WRITERS[kind]
    write(tmp_path / name, numbers(6))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    refused(tmp_path / name, f"pip install 'terrapin-robot[{extra}]'")


def test_a_sheet_and_a_range_are_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    for row in (["x", "y"], [1.0, 2.0], [3.0, 4.0], [], ["z", "y"], [5.0, 6.0], [7.0, 8.0]):
        book.active.append(row)
    other = book.create_sheet("More")
    for row in (["u", "v"], [9.0, 10.0]):
        other.append(row)
    book.save(tmp_path / "a.xlsx")
    refused(tmp_path / "a.xlsx", "A1:B3 and A5:B7; say which it is with --read range=A1:B3 or range=A5:B7")
    low = Asked.of({"sheet": "Sheet", "range": "A5:B7"}, "")
    table = read(tmp_path / "a.xlsx", asked=low)
    assert table.numbers("z").tolist() == [5.0, 7.0]
    assert table.place(1) == "a.xlsx:7"
    assert read(tmp_path / "a.xlsx", asked=Asked(part="More")).numbers("v").tolist() == [10.0]
    refused(tmp_path / "a.xlsx", "expected one of Sheet, More", Asked(part="None"))
    status, _, err = terrapin(capsys, "case", "table", tmp_path / "a.xlsx", "--to", tmp_path / "case")
    assert status == 2
    one_line(err, ["--read range=A1:B3"])
    words = ["--read", "sheet=Sheet", "--read", "range=A5:B7"]
    assert terrapin(capsys, "case", "table", tmp_path / "a.xlsx", *words, "--to", tmp_path / "case")[0] == 0
    assert tomllib.loads((tmp_path / "case" / "case.toml").read_text())["data"]["read"] == {
        "part": "Sheet",
        "range": "A5:B7",
    }
    status, _, err = terrapin(capsys, "case", "table", tmp_path / "a.xlsx", "--read", "shet=1", "--to", tmp_path / "b")
    assert status == 2
    one_line(err, ["--read: found 'shet'", "expected one of part, range"])


def test_files_of_a_folder_are_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "day").mkdir()
    for i in range(5):
        csv(tmp_path / "day" / f"r{i}.csv", numbers(i))
    (tmp_path / "day" / "notes.doc").write_text("no table")
    status, _, _ = terrapin(capsys, "case", "table", tmp_path / "day", "--to", tmp_path / "case")
    assert status == 0
    assert len(tomllib.loads((tmp_path / "case" / "case.toml").read_text())["data"]["files"]) == 5


def test_a_new_format_is_one_file(tmp_path: Path) -> None:
    """The page's example in a scratch copy of the tools: a case, a message and the page's upload know it."""
    copy = tmp_path / "host_tools"
    shutil.copytree(Path(formats.__file__).parents[4], copy, ignore=shutil.ignore_patterns("__pycache__", "static"))
    text = (ROOT / "docs" / "cases.md").read_text()
    (block,) = re.findall(r"<!-- file: (host_tools/\S+/formats/\S+) -->\n```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / block[0]).write_text(block[1])
    (tmp_path / "a.lgr").write_text("speed force\nrpm N\n1 2\n3 4\n5 7\n")
    program = (
        "import pathlib, sys\n"
        "from terrapin_tools.cli import main\n"
        "from terrapin_tools.web.service.uploads import SUFFIXES\n"
        "from terrapin_tools.web.cases.preview import look\n"
        f"assert {str(copy)!r} in sys.modules['terrapin_tools'].__file__\n"
        "assert '.lgr' in SUFFIXES\n"
        "assert [c['unit_guess'] for c in look('a.lgr', '')['columns']] == ['rpm', 'N']\n"
        "sys.argv = ['terrapin', 'case', 'a.lgr', '--to', 'case']\n"
        "main()\n"
    )
    places = os.pathsep.join([str(copy), str(ROOT / "hil"), str(ROOT / "firmware")])

    def run() -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "PYTHONPATH": places}
        words = [sys.executable, "-c", program]
        return subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False
        )

    done = run()
    assert done.returncode == 0, done.stderr
    assert "force [N] = force, N" in done.stdout
    (tmp_path / "a.lgr").write_text("speed force\nrpm N\n1 2\n1 x\n")
    program = program.replace("'a.lgr', '--to', 'case'", "'b.lgr', '--to', 'other'")
    (tmp_path / "a.lgr").rename(tmp_path / "b.lgr")
    program = "\n".join(line for line in program.splitlines() if "look(" not in line)
    done = run()
    assert done.returncode == 2
    assert "b.lgr: could not convert string to float" in done.stderr
    assert "expected a file of a logger" in done.stderr
