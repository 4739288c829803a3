"""A new effect, terrain, link, sub-command, tab: each is added to a scratch copy as its page says: at most 2 files."""

import os
import re
import shutil
from pathlib import Path

import pytest
from pages import ROOT, Block, apply, blocks
from scratch import copy_tree, in_copy

from tests.chromium import CHROMIUM, FLAGS

MOST = 2  # files that an addition may take


def added(page: str, part: str, folder: Path) -> Path:
    """A copy of the tree with everything put in that the section of a page shows as a file or as a change of one."""
    text = (ROOT / page).read_text()
    start = text.index(part)
    end = re.search(r"^#+ ", text[start + len(part) :], re.MULTILINE)
    lines = text[:start].count("\n"), text[: start + len(part) + end.start() if end else None].count("\n") + 1
    copy = copy_tree(folder / "terrapin")
    touched = set()
    for block in blocks(page, text):
        if not lines[0] < block.line <= lines[1]:
            continue
        if block.language == "diff":
            apply(copy, block)
            touched |= set(re.findall(r"^\+\+\+ b/(.*)$", block.text, re.MULTILINE))
        elif "file" in block.marks:
            put(copy, block)
            touched.add(block.marks["file"])
    assert 1 <= len(touched) <= MOST, f"{page}, {part}: {sorted(touched)}"
    return copy


def put(copy: Path, block: Block) -> None:
    assert not (copy / block.marks["file"]).exists(), f"{block}: {block.marks['file']} is there already"
    (copy / block.marks["file"]).write_text(block.text)


def test_effect(tmp_path: Path) -> None:
    """docs/effects.md runs the tests of effects in its own scratch copy; here the program finds the effect."""
    copy = added("docs/effects.md", "## An effect for everyone", tmp_path)
    listed = in_copy(copy, "terrapin", "effects").stdout
    assert "grass" in listed
    scenario = '\nduration = "2 s"\nchecks = ["max(abs(speed)) > 0.01"]\n[[path]]\nterrain = "sand"\n'
    scenario += (
        '[[operator]]\nat = "0 s"\nrequest = "run"\nsetpoint = "8 V"\n[effect.grass]\nc_g = "1 mN m s^0.5/rad^0.5"\n'
    )
    (copy / "meadow.toml").write_text(scenario)
    in_copy(copy, "terrapin", "run", "meadow.toml")


def test_terrain(tmp_path: Path) -> None:
    """The simulator rolls on it and the controller names it, in a build of the copy."""
    copy = added("docs/simulator.md", "### A new terrain", tmp_path)
    in_copy(copy, "cmake", "--preset", "host")
    in_copy(copy, "cmake", "--build", "--preset", "host", "--target", "terrapin", "terrapin_hil")
    scenario = 'duration = "12 s"\nchecks = ["all(GROUND.terrain[8:] == \'snow\')"]\n[[path]]\nterrain = "snow"\n'
    scenario += '[[operator]]\nat = "0 s"\nrequest = "run"\nsetpoint = "8 V"\n'
    (copy / "winter.toml").write_text(scenario)
    in_copy(copy, "terrapin", "run", "winter.toml", build=copy / "build/host")
    for shipped in ("steady_sand", "floor_calibration"):  # the others keep their place in the table
        in_copy(copy, "terrapin", "run", shipped, build=copy / "build/host")
    tests = ("tests/python/test_plant.py", "-k", "snow or sand", "-q")
    assert " passed" in in_copy(copy, "python", "-m", "pytest", *tests, build=copy / "build/host").stdout


def test_link(tmp_path: Path) -> None:
    """A program that is named is driven as the shipped one is: the same bytes."""
    copy = added("docs/links.md", "## A new link", tmp_path)
    assert "program:PATH" in in_copy(copy, "terrapin", "run", "--help").stdout
    built = Path(os.environ.get("TERRAPIN_BUILD", ROOT / "build" / "host"))
    program = shutil.copy(built / "terrapin-controller", tmp_path / "own-controller")
    said = [in_copy(copy, "terrapin", "run", "steady_sand", "--link", name) for name in (f"program:{program}", "pty")]
    hashes = [re.findall(r"output sha256 (\w{64})", one.stdout) for one in said]
    assert hashes[0] == hashes[1]
    assert len(hashes[0]) == 1


def test_sub_command(tmp_path: Path) -> None:
    command = added("CONTRIBUTING.md", "**A sub-command**", tmp_path)
    assert re.search(r"hello\s+Greet a robot\.", in_copy(command, "terrapin", "--help").stdout)
    assert in_copy(command, "terrapin", "hello", "Li").stdout == "Hello, Li.\n"
    assert "terrapin hello Reina" in in_copy(command, "terrapin", "hello", "--help").stdout


def test_tab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page that the copy serves has it and fills it, and nothing is said on its console."""
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "web"))
    from serving import Server

    copy = added("docs/web.md", "## A new tab", tmp_path)
    packages = [str(copy / name) for name in ("hil", "host_tools", "firmware")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(packages))
    monkeypatch.setenv("TERRAPIN_BUILD", os.environ.get("TERRAPIN_BUILD", str(ROOT / "build" / "host")))
    server = Server(tmp_path)
    try:
        with (
            playwright.sync_playwright() as running,
            running.chromium.launch(executable_path=CHROMIUM, args=FLAGS) as browser,
        ):
            page = browser.new_page()
            said: list[str] = []
            page.on("console", lambda message: said.append(message.text))
            page.goto(server.line)
            page.get_by_role("link", name="Models").click()
            page.get_by_text("rolling_steady", exact=True).wait_for(timeout=300_000)
            assert said == []
    finally:
        server.stop()
