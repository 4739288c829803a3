"""Plots of a case by mouse and key: zoom, rows picked out in both plots, and what is saved."""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect


def drag(page: Page, canvas: Locator, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """From and to shares of a canvas."""
    box = canvas.bounding_box()
    assert box is not None
    places = [(box["x"] + u * box["width"], box["y"] + v * box["height"]) for u, v in (begin, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=3)
    page.mouse.up()


def saved(page: Page, name: str, to: Path) -> Path:
    with page.expect_download() as download:
        page.get_by_role("button", name=name).click()
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

    picture = saved(page, "Model and measurement: save as SVG", tmp_path / "plot.svg")
    words = [text.text for text in ElementTree.parse(picture).iter("{http://www.w3.org/2000/svg}text")]
    assert "current, A" in words
    assert "temperature, degC" in words
    assert saved(page, "Model and measurement: save as PNG", tmp_path / "plot.png").read_bytes()[:4] == b"\x89PNG"

    canvas.press("Escape")
    expect(picked).to_have_text("")
    page.get_by_role("rowheader", name="r03").get_by_role("button").click()
    expect(picked).to_have_text("6 rows picked out, of r03")
