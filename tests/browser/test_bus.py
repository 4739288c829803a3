"""A controller on a bus, from the page: flashed, and with a link key driven."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect
from serving import START, Server

from terrapin_hil.links.seal import LinkKey
from terrapin_hil.links.slcan import ControllerProcess

sys.path.insert(0, str(Path(__file__).parents[1] / "boot"))

from test_flash import signed


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[str]:
    """The link of a simulated robot with a boot loader, in a process of its own."""
    command = [sys.executable, "-c", START, "sim", "--on", "pty", "--flash", str(tmp_path / "flash.bin")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        found = None
        while found is None and (line := process.stdout.readline()):
            found = re.search(r"serial:/dev/pts/\d+", line)
        assert found is not None
        yield found[0]
        process.terminate()
        process.communicate()


def watch(page: Page, link: str) -> None:
    page.get_by_role("link", name="Live").click()
    page.locator("#live-source").select_option("typed")
    page.locator("#live-typed").fill(link)
    page.get_by_role("button", name="Watch", exact=True).click()
    expect(page.locator(".live-bar .chip")).to_have_text("live")


def test_flashed_from_the_page(page: Page, server: Server, robot: str, tmp_path: Path) -> None:
    """A file that is no image is told; a signed one is written, started and confirmed, and the bus is watched again."""
    server.warm_live()
    watch(page, robot)
    (tmp_path / "none.bin").write_bytes(bytes(5000))
    files, panel = page.get_by_label("Signed images, one a slot"), page.locator(".flash-panel")
    for path in (tmp_path / "none.bin", signed(tmp_path, "a", "1.2.0")):
        files.set_input_files(path)
        page.get_by_role("button", name="Flash …").click()
        expect(page.get_by_role("dialog")).to_contain_text(path.name)
        page.get_by_role("dialog").get_by_role("button", name="Flash").click()
        expect(page.locator("#command")).to_have_text(re.compile(rf"terrapin flash \S*{path.name} --link {robot}"))
        words = "none.bin: not an image" if path.name == "none.bin" else "slot a: started and confirmed"
        expect(panel).to_contain_text(words)
        expect(page.locator(".live-bar .chip")).to_have_text("live")
    assert [one["id"] for one in Axe().run(page).response["violations"]] == []
    page.get_by_role("button", name="Leave").click()


def test_a_keyed_controller_is_driven(tmp_path: Path, browser: Browser) -> None:
    """What the page sends is sealed: the controller takes a parameter, and commands of a page that is armed go out."""
    key = tmp_path / "robot.key"
    key.touch(0o600)
    key.write_text(LinkKey.new().text(), encoding="utf-8")
    process = ControllerProcess(None, ("--link-key", str(key)))
    link = f"serial:{process.start()}"
    server = Server(tmp_path, "--link", link, "--link-key", str(key))
    try:
        with closing(browser.new_context()) as context:
            page = context.new_page()
            page.goto(f"{server.line}#live")
            page.get_by_role("button", name="Watch", exact=True).click()
            page.get_by_role("button", name="Read all").click()
            page.get_by_label("slip_limit", exact=True).fill("0.25")
            page.keyboard.press("Enter")
            expect(page.get_by_text("not at their default: slip_limit")).to_be_visible()
            for _ in range(20):  # a busy machine keeps the page's heart waiting
                page.get_by_role("button", name="Arm …").click()
                page.get_by_role("dialog").get_by_role("button", name="Arm").click()
                with suppress(AssertionError):
                    expect(page.locator(".drive-panel")).to_contain_text(re.compile(r"[1-9]\d commands"), timeout=5000)
                    break
    finally:
        server.stop()
        process.stop()
