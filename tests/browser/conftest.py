"""A browser and a server for the tests through the page. Without Chromium they skip, with the reason."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "web"))

from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright
from serving import Server

from tests.chromium import CHROMIUM, FLAGS

SECONDS = 300  # after which something hangs, on a machine however busy
expect.set_options(timeout=1000 * SECONDS)


@pytest.fixture(scope="module")  # else a report that another file's test wrote stands on the page
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server on a fresh workspace, shared by a file's tests."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    running = Server(tmp_path_factory.mktemp("browser"))
    yield running
    running.stop()


@pytest.fixture(scope="module")  # Playwright's event loop runs as long: asyncio.run of other tests would refuse
def browser() -> Iterator[Browser]:
    """Chromium, without a window."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


# On every canvas of the page a path that goes on after it was drawn, and so is drawn again, is told on the console.
PATHS = """{
    const pen = CanvasRenderingContext2D.prototype, drawn = new WeakSet();
    const before = (names, look) => {
        for (const name of names.split(' ')) {
            const own = pen[name];
            pen[name] = function (...given) { look(this, given[0]); return own.apply(this, given); };
        }
    };
    before('beginPath', (one) => drawn.delete(one));
    before('fill stroke clip', (one, path) => path instanceof Path2D || drawn.add(one));
    before('moveTo lineTo arc arcTo rect roundRect ellipse quadraticCurveTo bezierCurveTo',
        (one) => { if (drawn.has(one)) console.error('a path is drawn again with the next: beginPath is missing'); });
}"""


@pytest.fixture
def page(browser: Browser, server: Server) -> Iterator[Page]:
    """The page at 1280 x 800, open with its token. At the end its console must be empty."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    opened = context.new_page()
    opened.set_default_timeout(1000 * SECONDS)
    opened.add_init_script(PATHS)
    said: list[str] = []

    def told(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            said.append(f"{message.type}: {message.text} ({message.location.get('url')})")

    opened.on("console", told)
    opened.on("pageerror", lambda error: said.append(f"error: {error}"))
    opened.goto(server.line)
    yield opened
    keep = os.environ.get("TERRAPIN_SCREENSHOTS")  # a folder for pictures to look at
    if keep:
        Path(keep).mkdir(parents=True, exist_ok=True)
        opened.screenshot(path=str(Path(keep) / "last.png"))
    context.close()
    assert said == []
