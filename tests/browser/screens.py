"""Pictures of every tab, light and dark, at 390, 1440 and 3840 px, to look at: screens.py [FOLDER [WIDTH ...]]

They go to build/screens where no folder is named. Each is the whole page. What scrolls sideways is told, and the exit
status is then 1.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "web"))

from playwright.sync_api import Page, sync_playwright
from serving import Server

ROOT = Path(__file__).resolve().parents[2]
SIZES = {390: 844, 1440: 900, 3840: 2160}
SECONDS = 100  # after which something hangs
WIDER = """document.documentElement.scrollWidth <= innerWidth ? '' : [...document.querySelectorAll('main *, header *')]
  .filter((e) => e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('.scroll'))
  .slice(0, 6).map((e) => `${e.tagName}.${e.className}`).join(' ')"""
TABLE = "run,w_shell [rad/s],i_motor_mA\n" + "".join(f"r{i // 8},{2 + i % 7},{100 + i % 11}\n" for i in range(80))


def first_screen(page: Page) -> None:
    while page.locator(".thumbnail-place").count() > page.locator(".thumbnail-place .thumbnail").count():
        page.wait_for_timeout(100)
    page.locator(".hero .thumbnail").wait_for()


def mapping(page: Page) -> None:
    page.locator("#files").set_input_files([{"name": "mine.csv", "mimeType": "text/csv", "buffer": TABLE.encode()}])  # type: ignore[list-item]
    page.get_by_text("What the file holds").click()
    page.get_by_text("columns", exact=False).first.wait_for()


def case(page: Page) -> None:
    page.locator(".lead .chip").wait_for()
    page.locator(".ladder[data-rungs]").wait_for()


def compared(page: Page) -> None:
    case(page)
    page.get_by_label("Compare with", exact=True).select_option(index=1)
    page.get_by_label("How to show both").select_option("apart")
    page.locator(".key.other").first.wait_for()


def simulated(page: Page) -> None:
    page.get_by_label("Moment").fill("6")
    page.locator(".batch-failed").first.wait_for()


def live(page: Page) -> None:
    page.locator("[data-tile=State]").wait_for()
    page.wait_for_timeout(1500)  # strips fill


def prepare(page: Page, server: Server) -> None:
    """A case that was discovered, a run, a batch, and a robot that stands on the floor."""
    server.ask("POST", "/api/examples/heated_motor")
    server.wait(server.start("heated_motor", do="discover"))
    run = server.ask("POST", "/api/simulate", {"scenario": "heated_winding"}).json
    server.wait(run["id"])
    batch = {"scenario": "slope_limiter", "seeds": "1:20", "vary": ["path.2.slope=2deg:16deg"]}
    server.wait(server.ask("POST", "/api/batches", batch).json["id"])
    server.warm_live()
    page.goto(f"{server.line}#live")
    page.locator("#live-source").select_option("robot:floor")
    page.get_by_role("button", name="Watch", exact=True).click()
    page.locator("#context").get_by_text("simulated robot").wait_for()


PLACES: list[tuple[str, str, Callable[[Page], None]]] = [
    ("first", "#workbench", first_screen),
    ("case", "#workbench/heated_motor", case),
    ("compared", "#workbench/heated_motor", compared),
    ("simulate", "#simulate/heated_winding-1", simulated),
    ("live", "#live", live),
    ("mapping", "#workbench", mapping),
]


def main() -> int:
    chromium = shutil.which("chromium")
    sizes = [int(text) for text in sys.argv[2:]] or list(SIZES)
    if chromium is None:
        print("not run here: no Chromium")
        return 0
    to = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "screens"
    to.mkdir(parents=True, exist_ok=True)
    wide = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        server = Server(Path(folder))
        try:
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
            prepare(browser.new_page(), server)
            for width in sizes:
                for theme in ("light", "dark"):
                    for name, place, ready in PLACES:
                        context = browser.new_context(
                            viewport={"width": width, "height": SIZES[width]},
                            color_scheme=theme,
                            reduced_motion="reduce",
                        )
                        page = context.new_page()
                        page.set_default_timeout(1000 * SECONDS)
                        page.goto(server.line + place)
                        ready(page)
                        page.wait_for_timeout(300)
                        path = to / f"{name}-{width}-{theme}.png"
                        page.evaluate(
                            "document.querySelector('.strip').style.position = 'static'"
                        )  # else in the middle
                        page.screenshot(path=str(path), full_page=True)
                        if name == "mapping":  # the next one begins with no file
                            page.get_by_role("button", name="Discard").click()
                            page.get_by_text("What the file holds").wait_for(state="detached")
                        if culprit := page.evaluate(WIDER):
                            wide.append(f"{path.name} ({culprit})")
                        context.close()
            browser.close()
        finally:
            server.stop()
    print(f"{len(PLACES) * 2 * len(sizes)} pictures in {to}; wider than the window: {', '.join(wide) or 'none'}")
    return 1 if wide else 0


if __name__ == "__main__":
    sys.exit(main())
