"""`terrapin web` as its user waits for it: the first page, the first plot of 10,000 rows, the ladder after an Add.

bench_web.py [DIR]   also adds the first candidate of each case in DIR. In Chromium; each figure is a median.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "web"))

from playwright.sync_api import Page, sync_playwright
from serving import Server  # beside the tests that use it

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium")
FIRST_PAGE, BYTES, FIRST_PLOT, LADDER = 1.0, 1.5e6, 2.0, 3.0  # bounds: s, bytes, s, s


def large(folder: Path) -> None:
    """heated_motor with 10,000 rows: its rows again, with other noise."""
    shutil.copytree(ROOT / "cases" / "heated_motor", folder)
    lines = (folder / "runs.csv").read_text().splitlines()
    head, rows = lines[0], [line.split(",") for line in lines[1:]]
    current, random = head.split(",").index("motor_current"), np.random.default_rng(1)
    made = []
    for i in range(10_000):
        row = list(rows[i * len(rows) // 10_000])
        row[current] = f"{float(row[current]) + 1.5 * random.standard_normal():.3f}"
        made.append(",".join(row))
    (folder / "runs.csv").write_text("\n".join([head, *made]) + "\n")


def timed(act: Callable[[], object]) -> float:
    begin = time.perf_counter()
    act()
    return time.perf_counter() - begin


def first_page(page: Page, server: Server) -> tuple[float, int]:
    """Seconds to the list of cases on the screen, and the bytes that came."""
    seconds = timed(lambda: (page.goto(server.line), page.locator("[aria-label^='Open the example']").first.wait_for()))
    kinds = "[...performance.getEntriesByType('navigation'), ...performance.getEntriesByType('resource')]"
    return seconds, int(page.evaluate(f"{kinds}.reduce((sum, one) => sum + one.transferSize, 0)"))


def ladder(server: Server, name: str) -> float:
    """Seconds from asking for the likeliest effect to the answer with the new ladder."""
    found = server.wait(server.start(name, do="discover"))["result"]
    effects = found.get("missing") or [found["candidates"][0]["effect"]]
    return timed(lambda: server.wait(server.start(name, do="add", effects=effects)))


def main() -> int:
    if CHROMIUM is None:
        print("not run here: no Chromium")
        return 0
    passed = True

    def say(what: str, value: float, bound: float, unit: str) -> None:
        nonlocal passed
        passed &= value <= bound
        print(f"{what}: {value:.3g} {unit} (bound {bound:g}: {'met' if value <= bound else 'NOT MET'})", flush=True)

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        large(Path(folder) / "ws" / "cases" / "large")
        others = sorted(p.parent.name for p in Path(sys.argv[1]).glob("*/case.toml")) if len(sys.argv) > 1 else []
        for name in others:
            shutil.copytree(Path(sys.argv[1]) / name, Path(folder) / "ws" / "cases" / name)
        server = Server(Path(folder))
        try:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
            pages = [first_page(browser.new_context().new_page(), server) for _ in range(5)]
            say("first page, the list shown", statistics.median(s for s, _ in pages), FIRST_PAGE, "s")
            say("first page, the slowest of 5", max(s for s, _ in pages), FIRST_PAGE, "s")
            say("first page, transferred", max(b for _, b in pages), BYTES, "bytes")
            page = browser.new_context().new_page()
            page.goto(server.line)
            page.locator("a[href='#workbench/large']").first.wait_for()

            def plot() -> None:
                page.locator("a[href='#workbench/large']").first.click()
                page.locator(".plots canvas, .plots svg").first.wait_for()

            say("10,000 rows, compare to the first plot", timed(plot), FIRST_PLOT, "s")
            page.locator(".lead .chip").wait_for(timeout=300_000)  # ms: the verdict, long after the plot
            server.ask("POST", "/api/examples/heated_motor")
            took = [ladder(server, name) for name in ("heated_motor", *others)]
            say("add to ladder, the slowest case", max(took), LADDER, "s")
            browser.close()
        finally:
            server.stop()
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
