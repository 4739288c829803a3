"""Plots of a case by mouse and key: zoom, rows picked out in both plots, and what is saved."""

from __future__ import annotations

import csv
import re
import shutil
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, Route, expect
from serving import Server


def drag(
    page: Page,
    canvas: Locator,
    begin: tuple[float, float],
    end: tuple[float, float],
    by: tuple[tuple[float, float], ...] = (),
) -> None:
    """From and to shares of a canvas, by way of others."""
    box = canvas.bounding_box()
    assert box is not None
    places = [(box["x"] + u * box["width"], box["y"] + v * box["height"]) for u, v in (begin, *by, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    for place in places[1:]:
        page.mouse.move(*place, steps=3)
    page.mouse.up()


def saved(page: Page, name: str, to: Path) -> Path:
    with page.expect_download() as download:
        page.get_by_role("button", name=name).click()
    assert Path(download.value.suggested_filename).suffix == to.suffix
    download.value.save_as(to)
    return to


def test_zoom_select_and_save(page: Page, tmp_path: Path) -> None:
    page.get_by_role("link", name="Workbench").click()
    page.get_by_role("button", name="Open the example heated_motor").click()
    expect(page.locator(".lead .chip")).to_be_visible()
    plots = page.locator(".plots .plot:not(.ladder)")
    overlay, picked = plots.first, page.locator(".plots [role=status]")
    canvas = overlay.locator("canvas")

    drag(page, canvas, (0.3, 0.2), (0.6, 0.8))
    expect(overlay).to_have_attribute("data-zoomed", "yes")
    canvas.dblclick()
    expect(overlay).to_have_attribute("data-zoomed", "")
    canvas.press("+")
    expect(overlay).to_have_attribute("data-zoomed", "yes")
    canvas.press("0")
    expect(overlay).to_have_attribute("data-zoomed", "")

    page.keyboard.down("Shift")
    drag(page, canvas, (0.1, 0.02), (0.5, 0.85))
    page.keyboard.up("Shift")
    expect(picked).to_contain_text("rows picked out, of r")
    count = int((picked.text_content() or "").split()[0])
    rows = list(csv.reader(saved(page, "Residual: save its rows as CSV", tmp_path / "rows.csv").open()))
    assert len(rows) == 1 + count  # those that are picked out, also in the other plot
    assert rows[0][0] == "run"
    assert float(rows[1][4]) == pytest.approx((float(rows[1][2]) - float(rows[1][3])) / 1.5e-3, rel=1e-3)
    lasso = page.get_by_role("button", name="Model and measurement: dragging picks the rows within a line out")
    lasso.click()
    drag(page, canvas, (0.1, 0.02), (0.5, 0.85), by=((0.5, 0.02),))  # a triangle: half of the box
    expect(picked).not_to_contain_text(f"{count} rows")
    some = int((picked.text_content() or "").split()[0])
    assert 0 < some < count
    lasso.click()

    picture = saved(page, "Model and measurement: save as SVG", tmp_path / "plot.svg")
    words = [text.text for text in ElementTree.parse(picture).iter("{http://www.w3.org/2000/svg}text")]
    assert "current, A" in words
    assert "temperature, degC" in words
    assert {"measured", "measured, held out", "the model fails"} <= set(words)  # what its marks mean
    assert any(str(word).endswith("model, 95 % band") for word in words)
    sharp = saved(page, "Model and measurement: save as PNG", tmp_path / "plot.png").read_bytes()
    assert sharp[:4] == b"\x89PNG"
    assert struct.unpack(">2I", sharp[16:24]) == (1920, 1260)  # sharp on paper, however wide the window

    canvas.press("Escape")
    expect(picked).to_have_text("")
    page.get_by_role("rowheader", name="r03").get_by_role("button").click()
    expect(picked).to_have_text("6 rows picked out, of r03")


def test_a_zoom_is_refined_from_the_server(page: Page, server: Server, browser: Browser) -> None:
    """Of 60,000 rows some are drawn; a part that is zoomed into gets its own; a server that refuses leaves the thinned
    ones; an older question is given up."""
    folder = server.workspace / "cases" / "many"
    shutil.copytree(Path(__file__).parents[2] / "cases" / "heated_motor", folder)
    head, *lines = (folder / "runs.csv").read_text().splitlines()
    rows, current = [line.split(",") for line in lines], head.split(",").index("motor_current")
    made = [list(rows[i * len(rows) // 60_000]) for i in range(60_000)]  # each run keeps its rows together
    for row, noise in zip(made, np.random.default_rng(1).normal(0.0, 1.5, 60_000), strict=True):
        row[current] = f"{float(row[current]) + noise:.4f}"
    (folder / "runs.csv").write_text("\n".join([head, *map(",".join, made)]) + "\n")
    late: list[Route] = []
    page.route("**/api/cases", lambda route: late.append(route))  # the other cases are known only after the zoom
    page.goto(f"{server.line}#workbench/many")
    expect(page.locator(".lead .chip")).to_be_visible()
    overlay, said = page.locator(".plots .plot:not(.ladder)").first, page.locator(".plots [role=status]")
    canvas = overlay.locator("canvas")
    expect(said).to_contain_text("of 60,000 rows are drawn")

    asked: list[str] = []
    page.on("request", lambda one: asked.append(one.url) if "/rows?" in one.url else None)
    drag(page, canvas, (0.3, 0.1), (0.45, 0.9))
    expect(overlay).to_have_attribute("data-refined", re.compile(r"\d+"))
    expect(said).to_contain_text("rows in this part are drawn")
    for one in late:
        one.continue_()
    page.unroute("**/api/cases")
    expect(page.get_by_label("Compare with", exact=True).locator("option").first).to_be_attached()
    page.wait_for_timeout(200)  # longer than a zoom waits before it asks
    assert len(late) >= 1
    assert len(asked) == 1
    page.keyboard.down("Shift")
    drag(page, canvas, (0.1, 0.02), (0.9, 0.9))
    page.keyboard.up("Shift")
    expect(said).to_contain_text("rows picked out, of r")
    canvas.dblclick()
    expect(said).to_contain_text("of 60,000 rows are drawn")
    canvas.press("Escape")

    canvas.evaluate("""(one) => {
        for (let i = 0; i < 4; i++) one.dispatchEvent(new KeyboardEvent('keydown', { key: '+', bubbles: true }));
    }""")  # at once, on a machine however busy: one question after the last step, not one a step
    expect(overlay).to_have_attribute("data-refined", re.compile(r"\d+"))
    assert len(asked) == 2

    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    other = context.new_page()  # whose console may tell of the refusal
    other.route("**/rows?*", lambda route: route.fulfill(status=422, json={"detail": "not today"}))
    other.goto(f"{server.line}#workbench/many")
    expect(other.locator(".lead .chip")).to_be_visible()
    drag(other, other.locator(".plots canvas").first, (0.3, 0.1), (0.45, 0.9))
    expect(other.locator(".plots [role=status]")).to_contain_text("Only the thinned rows are drawn: not today")
    context.close()


CURVES = """async (cases) => {
    const { curve } = await import('/static/plots/painting.js');
    return cases.map(([x, y, noise, run, runs]) => curve(x, y, noise, run, runs));
}"""


def test_a_prediction_is_a_curve_in_whatever_unit(page: Page) -> None:
    """A smooth one over all runs, one within each, or none: scatter of several sd, of a channel in A as in uA."""
    every, x = list(range(20)), [0.1 * i for i in range(20)]
    one, two = [0] * 20, [i % 2 for i in every]
    for unit in (1e-6, 1.0, 1e6):
        smooth, bent, scatter = ([unit * f(i) for i in every] for f in (lambda i: i, lambda i: i * i, lambda i: i % 2))
        apart = [value + 100.0 * unit * run for value, run in zip(smooth, two, strict=True)]
        lines = ((smooth, one), (bent, one), (scatter, one), (apart, two))
        found = page.evaluate(CURVES, [(x, y, 0.01 * unit, runs, max(runs) + 1) for y, runs in lines])
        assert found == [[every], [every], None, [every[::2], every[1::2]]]


THUMBNAIL = """async ([x, measured, predicted]) => {
    const { thumbnail } = await import('/static/plots/thumbnail.js');
    const picture = { x: { name: 'x', values: x }, y: { name: 'y' }, measured, predicted };
    const dots = [...thumbnail(picture, 100, 50).querySelectorAll('circle')];
    return dots.map((dot) => [dot.getAttribute('class'), dot.cx.baseVal.value, dot.cy.baseVal.value]);
}"""


def test_a_thumbnail_has_what_is_large_above_and_to_the_right(page: Page) -> None:
    dots = page.evaluate(THUMBNAIL, [[2.0, 0.0, 1.0], [10.0, 30.0, 20.0], [10.0, 20.0, 30.0]])
    places = {kind: [dot[1:] for dot in dots if dot[0] == kind] for kind in ("measured", "predicted")}
    assert places == {"measured": [[96, 46], [4, 4], [50, 25]], "predicted": [[96, 46], [4, 25], [50, 4]]}


def test_legend_and_logarithmic_axes(page: Page, server: Server, tmp_path: Path) -> None:
    """A key of the legend hides its line and shows it again; on a logarithmic axis the marks are powers of ten."""
    server.ask("POST", "/api/examples/heated_motor")
    page.goto(f"{server.line}#workbench/heated_motor")
    expect(page.locator(".lead .chip")).to_be_visible()
    model = page.locator(".key.model")
    full = saved(page, "Model and measurement: save as SVG", tmp_path / "full.svg").read_text()
    model.focus()
    page.keyboard.press("Enter")
    expect(model).to_have_attribute("aria-pressed", "false")
    expect(model).to_be_focused()
    less = saved(page, "Model and measurement: save as SVG", tmp_path / "less.svg").read_text()
    assert len(less) < len(full)
    model.click()
    expect(model).to_have_attribute("aria-pressed", "true")
    assert saved(page, "Model and measurement: save as SVG", tmp_path / "again.svg").read_text() == full

    rows = saved(page, "Model and measurement: save its rows as CSV", tmp_path / "rows.csv").read_text()
    assert rows.startswith('run,"temperature, degC","measured current, A","model current, A"')

    page.locator(".axis select").first.select_option("row")
    page.get_by_role("button", name="Model and measurement: x axis logarithmic").click()
    words = ElementTree.parse(saved(page, "Model and measurement: save as SVG", tmp_path / "log.svg"))
    marks = [text.text for text in words.iter("{http://www.w3.org/2000/svg}text")]
    assert {"1", "2", "5", "10", "20", "50"} <= set(marks)
    canvas = page.locator(".plots canvas").first
    drag(page, canvas, (0.3, 0.1), (0.7, 0.8))
    expect(page.locator(".plots .plot").first).to_have_attribute("data-zoomed", "yes")
    canvas.dblclick()
    button = page.get_by_role("button", name="Model and measurement: y axis logarithmic")
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")


def test_keys_and_wheel_go_through_a_plot(page: Page, server: Server, tmp_path: Path) -> None:
    """To its rows and back, nearer, further and aside; the same numbers as a table."""
    server.ask("POST", "/api/examples/heated_motor")
    page.goto(f"{server.line}#workbench/heated_motor")
    expect(page.locator(".lead .chip")).to_be_visible()
    overlay, tip = page.locator(".plots .plot").first, page.locator(".plots .plot .tip").first
    canvas = overlay.locator("canvas")

    def marks() -> list[float]:
        """On the x axis, where there is one of temperature."""
        picture = ElementTree.parse(saved(page, "Model and measurement: save as SVG", tmp_path / "plot.svg"))
        texts = [
            one for one in picture.iter("{http://www.w3.org/2000/svg}text") if re.fullmatch(r"[\d.]+", one.text or "")
        ]
        low = max(float(one.get("y", 0)) for one in texts)
        return [float(one.text or "") for one in texts if float(one.get("y", 0)) == low]

    seen = []
    for key in ("Home", "ArrowRight", "End", "ArrowLeft"):
        canvas.press(key)
        expect(tip).to_be_visible()
        seen.append(tip.text_content())
    assert len(set(seen)) == 4
    expect(overlay.locator("[aria-live]")).to_have_text(seen[-1] or "")
    canvas.press("Home")
    expect(tip).to_have_text(seen[0] or "")
    canvas.press("Escape")
    expect(tip).to_be_hidden()

    whole = marks()
    for _ in range(4):
        canvas.press("Shift+ArrowRight")
    moved = marks()
    assert moved[0] > whole[0]
    assert moved[-1] > whole[-1]
    canvas.press("0")
    assert marks() == whole
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.wheel(0, -100)  # the page's own
    expect(overlay).to_have_attribute("data-zoomed", "")
    page.keyboard.down("Control")
    for _ in range(5):
        page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    expect(overlay).to_have_attribute("data-zoomed", "yes")
    assert whole[0] < marks()[0] < marks()[-1] < whole[-1]
    page.get_by_role("button", name="Model and measurement: show all, pick none out").click()
    assert marks() == whole

    page.get_by_role("button", name="Table").click()
    table = page.get_by_role("region", name="Residual, table")
    rows = saved(page, "Residual: save its rows as CSV", tmp_path / "rows.csv").read_text().splitlines()
    expect(table.locator("tbody tr")).to_have_count(len(rows) - 1)
    expect(table.locator("th").first).to_have_text("run")
    page.get_by_role("button", name="Table").click()
    expect(table).to_have_count(0)


def test_another_case_over_and_beside(page: Page, server: Server) -> None:
    """Two cases on the same axes, side by side, and why one of another kind cannot lie over it; a model not added."""
    for name in ("warm", "cool"):
        shutil.copytree(Path(__file__).parents[2] / "cases" / "heated_motor", server.workspace / "cases" / name)
    server.ask("POST", "/api/examples/forced_slip_sand")
    page.goto(f"{server.line}#workbench/warm")
    expect(page.locator(".lead .chip")).to_be_visible()
    choice, way, beside = (
        page.get_by_label("Compare with", exact=True),
        page.get_by_label("How to show both"),
        page.locator(".beside"),
    )
    choice.select_option("case:cool")
    expect(page.locator("button.key.other")).to_have_text("cool")
    expect(page.locator(".compare-with tbody tr")).to_have_count(2)
    expect(page.locator(".compare-with tbody tr").last).to_contain_text("cool")
    expect(beside).to_be_hidden()
    way.select_option("apart")
    expect(beside.locator("h2")).to_have_text("cool")
    expect(beside.locator("canvas").first).to_be_visible()
    choice.select_option("case:forced_slip_sand")
    expect(page.locator(".compare-with .warn")).to_contain_text("It measures no current")
    choice.select_option("model:speed_squared+motor_heating")  # nobody has looked for what is missing yet
    expect(page.locator(".compare-with tbody tr").last).to_contain_text("motor_heating")
    choice.select_option("")
    expect(beside).to_be_hidden()
    expect(page.locator(".compare-with table")).to_have_count(0)
