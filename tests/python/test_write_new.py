"""Two commands that make the same file at once: one makes it, whole; the other is refused in one line."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.writing import copy_example, write_new

TABLE = "run,speed [rad/s],current [A]\n" + "".join(f"r{n % 4},{n}.0,{0.1 * n:.1f}\n" for n in range(40))


TERRAPIN = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]


def _none(*_: object) -> None:
    raise PermissionError(errno.EPERM, "Operation not permitted")


@pytest.mark.parametrize("links", [True, False])
def test_one_of_many_makes_the_file_and_it_is_whole(
    tmp_path: Path, links: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not links:  # as on a card with FAT
        monkeypatch.setattr(os, "link", _none)
    texts = [f"{number}\n" * 20_000 for number in range(8)]
    barrier, refused = threading.Barrier(len(texts), timeout=10.0), []

    def make(text: str) -> None:
        barrier.wait()
        try:
            write_new(tmp_path / "new.toml", text)
        except FileExistsError as error:
            refused.append(str(error.filename))

    threads = [threading.Thread(target=make, args=(text,)) for text in texts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10.0)
    assert (tmp_path / "new.toml").read_text() in texts
    assert refused == 7 * [str(tmp_path / "new.toml")]
    assert [path.name for path in tmp_path.iterdir()] == ["new.toml"]


@pytest.mark.parametrize(
    ("words", "made"),
    [
        (["case", "table", "runs.csv", "--base", "equation", "--to", "made"], "made/case.toml"),
        (["robot", "new", "made.toml", "--like", "roller"], "made.toml"),
    ],
    ids=["case table", "robot new"],
)
def test_who_comes_second_is_refused(tmp_path: Path, words: list[str], made: str) -> None:
    """The other's file appears after this one has looked: at the moment of writing."""
    (tmp_path / "runs.csv").write_text(TABLE)
    (tmp_path / made).parent.mkdir(exist_ok=True)
    begun = (
        "import os, sys\n"
        "from terrapin_tools.cli import main\n"
        "ours = os.link\n"
        f"def late(*names):\n    open({made!r}, 'x').write('of another')\n    ours(*names)\n"
        "os.link = late\n"
        f"sys.argv = ['terrapin', *{words!r}]\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", begun], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "expected a new" in done.stderr
    assert (tmp_path / made).read_text() == "of another"


def test_an_example_that_finds_no_room_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the list of every file and of the folder that it was begun in."""

    def full(source: str, target: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), source, None, target)

    monkeypatch.setattr(shutil, "copy2", full)
    with pytest.raises(UserError) as said:
        copy_example("heated_motor", tmp_path / "new")
    assert str(said.value) == f"{tmp_path / 'new'}: No space left on device, expected a folder that can be written"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_picture_that_finds_no_room_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(TABLE)
    (tmp_path / "x.png").symlink_to("/dev/full")
    words = ("look", "x.csv", "--plot", "x.png")
    done = subprocess.run([*TERRAPIN, *words], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "terrapin: x.png: No space left on device\n")
