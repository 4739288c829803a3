"""A file in which a library in C is lost, or that ends it, is one line: tried in a copy of the process first."""

from __future__ import annotations

import os
import re
import signal
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from terrapin_tools.bounded import survived
from terrapin_tools.errors import UserError
from terrapin_tools.logs.reading import read_log
from terrapin_tools.workbench.files.trees import hdf5
from tests.python import table_files

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")


def _for_ever() -> None:
    """In C, and deaf: no signal that Python handles reaches it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))
    while True:
        pass


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "x.h5"
    table_files.hdf5(path, table_files.numbers(1))
    return path


def test_what_has_no_end_is_ended(file: Path) -> None:
    with pytest.raises(UserError, match=r"x\.h5: found no end of it in 1 s of the processor"):
        survived(file, _for_ever, 0.1)


def test_what_ends_the_process_is_said(file: Path) -> None:
    with pytest.raises(UserError, match=r"x\.h5: is damaged: its library ends with SIGABRT"):
        survived(file, os.abort)


def test_what_it_raises_and_says_is_left_to_the_reader(file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    def says() -> None:
        os.write(1, b"lost")
        os.write(2, b"lost")
        raise ValueError

    survived(file, says)
    assert capfd.readouterr() == ("", "")


def test_hdf5_is_tried_first(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, units = hdf5.hdf5_tree(file)
    assert np.array_equal(tree["tests"]["V1"]["speed"], table_files.numbers(1)["speed"][:6])
    assert units["tests/V1/speed"] == "rpm"
    monkeypatch.setattr(hdf5, "_tree", lambda path: os.abort())
    with pytest.raises(UserError, match="SIGABRT"):
        hdf5.hdf5_tree(file)


def test_a_schema_that_is_no_text_is_one_line(tmp_path: Path) -> None:
    """SQLite says what it found there, and Python cannot decode what it says."""
    path = tmp_path / "x.db"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE messages (ts REAL)")
        connection.commit()
    data = path.read_bytes()
    assert data.count(b"messagesmessages") == 1
    path.write_bytes(
        data.replace(b"messagesmessages", b"m\xe3ssagesm\xe3ssages").replace(b"CREATE TABLE m", b"CREATE TABLX m")
    )
    with pytest.raises(UserError, match=re.escape(f"{path}: ")) as raised:
        read_log(path)
    assert "\n" not in str(raised.value)
    assert "expected python-can's SQLite" in str(raised.value)
