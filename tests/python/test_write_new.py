"""Two commands that make the same file at once: one makes it, whole; the other is refused in one line."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from terrapin_tools.workbench.files.writing import write_new

TABLE = "run,speed [rad/s],current [A]\n" + "".join(f"r{n % 4},{n}.0,{0.1 * n:.1f}\n" for n in range(40))


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
