"""`terrapin web` as its user waits for it: the first page, an example's plot and verdict, the first plot of 10,000
rows, the mouse over 100,000, a zoom into 1,000,000, the ladder after an Add; a table of a million rows made into a case
and cancelled.

bench_web.py [DIR]   also adds the first candidate of each case in DIR. In Chromium; each figure is a median.
bench_web.py million | page | zoom   one part alone
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "web"))

from playwright.sync_api import Page, sync_playwright
from serving import Server  # beside the tests that use it

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium")
FIRST_PAGE, BYTES, FIRST_PLOT, LADDER = 1.0, 1.5e6, 2.0, 3.0  # bounds: s, bytes, s, s
ZOOM = 300.0  # ms
PAINT, EXAMPLE, VERDICT, PLOT_BYTES, HOVER = 0.6, 1.0, 2.0, 300e3, 8.0  # s, s, s, bytes, ms
MILLION_PLOT, MILLION_VERDICT, CANCEL, MEMORY = 15.0, 90.0, 2.0, 2.0  # s, s, s, GB
SECONDS = 1200.0  # after which something hangs


def large(folder: Path, count: int = 10_000) -> None:
    """heated_motor with so many rows: its rows again, with other noise."""
    shutil.copytree(ROOT / "cases" / "heated_motor", folder)
    lines = (folder / "runs.csv").read_text().splitlines()
    head, rows = lines[0], [line.split(",") for line in lines[1:]]
    current, random = head.split(",").index("motor_current"), np.random.default_rng(1)
    made = []
    for i in range(count):
        row = list(rows[i * len(rows) // count])
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


DRAWN = "document.querySelector('.plots canvas')?.width > 300"
BYTES_SO_FAR = (
    "[...performance.getEntriesByType('navigation'), ...performance.getEntriesByType('resource')]"
    ".reduce((sum, one) => sum + one.transferSize, 0)"
)
MOUSE = """() => {
  const canvas = document.querySelector('.plots canvas'), box = canvas.getBoundingClientRect(), took = [];
  for (let i = 0; i < 101; i++) {
    const begin = performance.now();
    const x = box.left + box.width * (0.1 + 0.8 * ((i * 37) % 101) / 101);
    const y = box.top + box.height * (0.1 + 0.8 * ((i * 61) % 101) / 101);
    canvas.dispatchEvent(new PointerEvent('pointermove', { bubbles: true, clientX: x, clientY: y }));
    took.push(performance.now() - begin);
  }
  return took.sort((a, b) => a - b);
}"""


def drawn(page: Page) -> None:
    """Until the plot is drawn."""
    end = time.perf_counter() + SECONDS
    while not page.evaluate(DRAWN):
        assert time.perf_counter() < end, "no plot"
        time.sleep(0.01)


def example(page: Page, server: Server) -> tuple[float, float, float, int]:
    """Seconds to the first paint, from a click on an example to its plot and to its verdict; bytes before the plot."""
    server.ask("DELETE", "/api/cases/heated_motor")
    page.goto(server.line)
    button = page.get_by_role("button", name="Open the example heated_motor")
    button.wait_for()
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN") / 1e3
    begin = time.perf_counter()
    button.click()
    drawn(page)
    plot, size = time.perf_counter() - begin, int(page.evaluate(BYTES_SO_FAR))
    page.locator(".lead .chip").wait_for(timeout=300_000)  # ms
    return paint, plot, time.perf_counter() - begin, size


def tree_memory(pid: int) -> float:
    """GB that the server and what it started hold now, shared pages counted once (Pss)."""
    import psutil

    found = 0
    for process in [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]:
        with suppress(psutil.Error):
            found += process.memory_full_info().pss
    return found / 1e9


def million(say: Callable[[str, float, float, str], None]) -> None:
    """A CSV file of a million rows through the API, as the page does it; then once more, cancelled."""
    random = np.random.default_rng(2)
    count = 1_000_000
    omega = 2.0 + random.integers(0, 700, count) / 100
    current = 1e3 * (0.092 * 0.08 * 18.639 + 0.012 + 1e-3 * omega) * 18 / 80 / 0.1 + random.normal(0, 1.5, count)
    with tempfile.TemporaryDirectory() as folder:
        rows = "".join(f"r{i // 20_000},{w:.2f},{c:.3f}\n" for i, (w, c) in enumerate(zip(omega, current, strict=True)))
        body = {
            "name": "million", "base": "rolling_steady", "run": "run",
            "columns": {"omega": {"column": "w", "unit": "rad/s"}, "current": {"column": "i", "unit": "mA"}},
            "parameters": {"radius": "80 mm", "drive_radius": "18 mm", "torque_constant": "0.1 N m/A",
                           "coulomb": "12 mN m", "viscous": "1 mN m s/rad", "load": "18.639 N"},
            "fit": {"f_o": {"value": 0.05, "min": 0.0, "max": 0.5}},
        }  # fmt: skip
        server = Server(Path(folder))
        most, over = [0.0], threading.Event()

        def watch() -> None:
            while not over.wait(0.5):
                most[0] = max(most[0], tree_memory(server.process.pid))

        watching = threading.Thread(target=watch)
        watching.start()
        try:
            begin = time.perf_counter()
            upload = server.upload("million.csv", f"run,w,i\n{rows}".encode()).json
            body["uploads"] = [upload["id"]]
            job = server.ask("POST", "/api/cases", body).json["id"]
            assert server.wait(job)["state"] == "done"
            server.get("/api/cases/million/view?draft=true")
            say("a million rows, file to plot", time.perf_counter() - begin, MILLION_PLOT, "s")
            begin = time.perf_counter()
            job = server.start("million", do="compare")
            lines, told = 0, 0.0
            while (state := server.get(f"/api/jobs/{job}"))["state"] in ("queued", "running"):
                if len(state["progress"]) != lines:
                    lines, told = len(state["progress"]), time.perf_counter()
                time.sleep(0.2)
                if time.perf_counter() - begin > SECONDS:
                    break
            assert state["state"] == "done"
            say("a million rows, verdict", time.perf_counter() - begin, MILLION_VERDICT, "s")
            print(
                f"  {lines} lines of progress, the last {time.perf_counter() - told:.1f} s before the end", flush=True
            )
            job = server.start("million", do="discover")
            time.sleep(2.0)
            begin = time.perf_counter()
            server.ask("DELETE", f"/api/jobs/{job}")
            server.wait(job)
            say("cancel", time.perf_counter() - begin, CANCEL, "s")
        finally:
            over.set()
            watching.join()
            server.stop()
        say("a million rows, most that server and workers held", most[0], MEMORY, "GB")


ZOOMED = """async (part) => {
  const canvas = document.querySelector('.plots canvas'), host = canvas.parentElement;
  const box = canvas.getBoundingClientRect();
  delete host.dataset.refined;
  const at = (type, u) => canvas.dispatchEvent(new PointerEvent(type, { bubbles: true, pointerId: 1, button: 0,
    clientX: box.left + u * box.width, clientY: box.top + (type === 'pointerdown' ? 0.1 : 0.8) * box.height }));
  canvas.setPointerCapture = () => {};
  canvas.dispatchEvent(new MouseEvent('dblclick', { bubbles: true }));
  await new Promise((next) => setTimeout(next, 1000));
  at('pointerdown', part);
  at('pointermove', part + 0.1);
  const begin = performance.now();
  at('pointerup', part + 0.1);
  while (!host.dataset.refined) await new Promise(requestAnimationFrame);
  return performance.now() - begin;
}"""


def zoom(page: Page, server: Server, say: Callable[[str, float, float, str], None]) -> None:
    """From letting the mouse go to the rows of the part on the screen, at a million rows."""
    large(server.workspace / "cases" / "million", 1_000_000)
    page.goto(f"{server.line}#workbench/million")
    drawn(page)
    page.locator(".lead .chip").wait_for(timeout=300_000)  # ms
    page.wait_for_timeout(2000)
    took = [float(page.evaluate(ZOOMED, part)) for part in (0.2, 0.3, 0.4, 0.5, 0.6)]
    print(f"  {page.locator('.plots [role=status]').inner_text()}", flush=True)
    say("a zoom into 1,000,000 rows refined, median of 5", statistics.median(took), ZOOM, "ms")
    say("a zoom into 1,000,000 rows refined, the slowest", max(took), ZOOM, "ms")


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

    if sys.argv[1:] not in (["page"], ["zoom"]):
        million(say)
    if sys.argv[1:] == ["million"]:
        return 0 if passed else 1
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        large(Path(folder) / "ws" / "cases" / "large")
        large(Path(folder) / "ws" / "cases" / "wide", 100_000)
        others = (
            sorted(p.parent.name for p in Path(sys.argv[1]).glob("*/case.toml"))
            if sys.argv[1:] not in ([], ["page"], ["zoom"])
            else []
        )
        for name in others:
            shutil.copytree(Path(sys.argv[1]) / name, Path(folder) / "ws" / "cases" / name)
        server = Server(Path(folder))
        try:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
            if sys.argv[1:] != ["page"]:
                zoom(browser.new_context().new_page(), server, say)
            if sys.argv[1:] == ["zoom"]:
                browser.close()
                return 0 if passed else 1
            pages = [first_page(browser.new_context().new_page(), server) for _ in range(5)]
            say("first page, the list shown", statistics.median(s for s, _ in pages), FIRST_PAGE, "s")
            say("first page, the slowest of 5", max(s for s, _ in pages), FIRST_PAGE, "s")
            say("first page, transferred", max(b for _, b in pages), BYTES, "bytes")
            times = [example(browser.new_context().new_page(), server) for _ in range(3)]
            say("first paint", statistics.median(one[0] for one in times), PAINT, "s")
            say("an example to its plot", statistics.median(one[1] for one in times), EXAMPLE, "s")
            say("an example to its verdict", statistics.median(one[2] for one in times), VERDICT, "s")
            say("bytes before the first plot", max(one[3] for one in times), PLOT_BYTES, "bytes")
            page = browser.new_context().new_page()
            page.goto(f"{server.line}#workbench/wide")
            drawn(page)
            page.locator(".lead .chip").wait_for(timeout=300_000)  # ms
            page.wait_for_timeout(1000)
            took = page.evaluate(MOUSE)
            say("the mouse over 100,000 rows, median", took[50], HOVER, "ms")
            say("the mouse over 100,000 rows, 99th percentile", took[99], HOVER, "ms")
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
