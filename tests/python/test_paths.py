"""Where the parts stand in a tree, in a build that is named, and in a wheel; and what makes two programs differ."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from terrapin_hil import paths


@pytest.fixture
def wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that has its compiled parts inside, as an installed wheel has."""
    monkeypatch.delenv("TERRAPIN_BUILD", raising=False)
    monkeypatch.setattr(paths, "PACKAGE", tmp_path)
    monkeypatch.setattr(paths, "WHEEL", tmp_path / "_native")
    (tmp_path / "_native").mkdir()
    return tmp_path


def test_a_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TERRAPIN_BUILD", raising=False)
    assert paths.build() == paths.ROOT / "build" / "host"
    assert paths.images() == paths.ROOT / "build" / "cortex-m4"
    assert paths.header() == paths.ROOT / "firmware" / "core" / "terrapin.h"
    assert paths.examples()["heated_motor"] == paths.ROOT / "cases" / "heated_motor"
    assert paths.make("firmware") == "`make firmware`"


def test_a_wheel(wheel: Path) -> None:
    (wheel / "_cases" / "mine").mkdir(parents=True)
    (wheel / "_cases" / "mine" / "case.toml").touch()
    assert paths.build() == wheel / "_native"
    assert paths.header() == wheel / "_native" / "terrapin.h"
    assert paths.examples() == {"mine": wheel / "_cases" / "mine"}
    with pytest.raises(OSError, match="run `make setup` in the sources") as caught:
        paths.need(paths.dbc())
    assert caught.value.filename == str(wheel / "_native" / "generated" / "terrapin.dbc")


def test_a_build_that_is_named_comes_first(wheel: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERRAPIN_BUILD", str(wheel / "sources" / "build" / "host"))
    assert paths.build() == wheel / "sources" / "build" / "host"
    assert paths.images() == wheel / "sources" / "build" / "cortex-m4"
    assert paths.make("firmware") == "`make firmware`"


def test_nothing_that_is_installed_knows_of_a_tree() -> None:
    packages = (paths.PACKAGE, paths.ROOT / "host_tools" / "terrapin_tools")
    sources = [source for package in packages for source in package.rglob("*.py") if source != Path(paths.__file__)]
    assert len(sources) > 200
    assert [str(source) for source in sources if "paths.ROOT" in source.read_text(encoding="utf-8")] == []


@pytest.mark.parametrize(
    "change",
    [
        lambda place: place / "build" / "libterrapin_hil.so",
        lambda place: place / "build" / "libterrapin.so",
        lambda place: place / "build" / "generated" / "interface.json",
        lambda place: place / "source" / "deep" / "one.py",
    ],
)
def test_another_program_has_another_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Path], Path]
) -> None:
    hashed = paths.program_hash.__wrapped__
    (tmp_path / "source" / "deep").mkdir(parents=True)
    (tmp_path / "source" / "deep" / "one.py").write_text("x = 1\n")
    (tmp_path / "build" / "generated").mkdir(parents=True)
    for name in ("libterrapin.so", "libterrapin_hil.so", "generated/interface.json"):
        shutil.copy(paths.build() / name, tmp_path / "build" / name)
    before = hashed(tmp_path / "source")
    assert before == hashed(tmp_path / "source")
    monkeypatch.setenv("TERRAPIN_BUILD", str(tmp_path / "build"))
    assert hashed(tmp_path / "source") == before  # the same bytes at another place
    with change(tmp_path).open("ab") as file:
        file.write(b"\n")
    assert hashed(tmp_path / "source") != before
