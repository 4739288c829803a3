"""`terrapin image build` and `--robot`: images of a robot, on a board, that say what they are made for."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_hil.errors import UserError
from terrapin_interface.robot import find_robot, identity_of
from terrapin_tools.flash import build
from terrapin_tools.flash.image import parse
from tests.python.robot_files import BOARD, set_fields

ROOT = Path(__file__).resolve().parents[2]


def terrapin(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    run = [str(Path(sys.executable).with_name("terrapin")), *map(str, words)]
    return subprocess.run(
        run, cwd=ROOT, env={**os.environ, **environment}, capture_output=True, text=True, check=False, timeout=1200
    )


@pytest.fixture
def board(tmp_path: Path) -> Path:
    return set_fields(tmp_path / "carrier.toml", BOARD, {"number": 101})


@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="no cross compiler here")
def test_images_of_a_robot_on_another_board(tmp_path: Path, board: Path) -> None:
    done = terrapin("image", "build", "--robot", "sphere", "--board", board, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (tmp_path / "out").iterdir()}
    kinds = [f"{kind}{place}" for kind in ("", "production-") for place in ("alone", "slot-a", "slot-b")]
    assert names == {"terrapin-boot-carrier.bin", *(f"terrapin-carrier-{kind}.bin" for kind in kinds)}
    signed = tmp_path / "a.bin"
    code = tmp_path / "out" / "terrapin-carrier-slot-a.bin"
    assert terrapin("image", "sign", code, signed, "--version", "1.0.0").returncode == 0
    image = parse(signed.read_bytes())
    assert (image.robot, image.board) == (identity_of("sphere"), 101)
    flash = ("flash", signed, "--via", "stm32", "--port", tmp_path / "none", "--robot")
    other = terrapin(*flash, "cylinder")
    assert (other.returncode, "made for sphere, expected cylinder" in other.stderr) == (2, True)
    shipped = terrapin(*flash, "sphere")
    assert (shipped.returncode, "made for board number 101, expected 3" in shipped.stderr) == (2, True)


def test_without_a_compiler_one_line_says_so(tmp_path: Path) -> None:
    done = terrapin("image", "build", "--out", tmp_path, PATH=str(tmp_path))
    assert done.returncode == 2
    assert "arm-none-eabi-gcc not found on PATH" in done.stderr  # CMake and Ninja may be of this Python's environment
    assert done.stderr.count("\n") == 1


def test_without_the_sources_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build.paths, "ROOT", tmp_path)
    with pytest.raises(UserError, match="a wheel has no sources of the firmware"):
        build.build_images("cylinder", "", tmp_path)


def test_what_is_wrong_is_said_before_anything_is_built(tmp_path: Path, board: Path) -> None:
    set_fields(board, board, {"analog.shunt": "100 mohm"})
    robot = set_fields(tmp_path / "mine.toml", find_robot("cylinder"), {"sensors.current.code": None})
    for words, expected in (
        (("--board", "nosuch"), "found 'nosuch', expected a file beside this one, or one of"),
        (("--robot", robot, "--board", board), "analog.shunt of board carrier"),
        (("--robot", "nosuch"), "'nosuch': found no such file"),
    ):
        done = terrapin("image", "build", "--out", tmp_path / "out", *words)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert expected in done.stderr, done.stderr
    assert not (tmp_path / "out").exists()


def test_a_boards_name_takes_the_place_of_the_robots(tmp_path: Path, board: Path) -> None:
    robot, path = build.choose("roller", str(board), tmp_path / "copy")
    assert (robot.name, robot.board.name, robot.identity) == ("roller", "carrier", identity_of("roller"))
    assert path.parent == tmp_path / "copy"
    assert build.choose("roller", "f405_h_bridge", tmp_path)[1] == find_robot("roller").resolve()


@pytest.fixture(scope="module")
def sphere() -> None:
    """Its controller is built."""
    subprocess.run(["tests/tools/build.sh", "robot=sphere", "host"], cwd=ROOT, check=True, timeout=1200)


@pytest.mark.usefixtures("sphere")
def test_parameters_and_logs_are_the_robots() -> None:
    """By one option: values, and the steps in which they travel."""
    found = [terrapin("param", "get", "armature_resistance", *words) for words in ((), ("--robot", "sphere"))]
    assert [done.stdout for done in found] == ["armature_resistance = 5 ohm\n", "armature_resistance = 0.608 ohm\n"]


@pytest.mark.usefixtures("sphere")
def test_the_dbc_of_a_robot(tmp_path: Path) -> None:
    for name in ("cylinder", "sphere"):
        assert terrapin("log", "dbc", tmp_path / f"{name}.dbc", "--robot", name).returncode == 0
    texts = [(tmp_path / f"{name}.dbc").read_text(encoding="cp1252") for name in ("cylinder", "sphere")]
    assert texts[0] != texts[1]
