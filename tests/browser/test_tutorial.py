"""The way of docs/tutorial.md through the page, and its pictures: taken anew under build/pictures and held loosely
against those of docs/pictures (fonts differ from machine to machine). TERRAPIN_PICTURES=renew writes the latter.
"""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from playwright.sync_api import Page, expect
from serving import Server

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "docs" / "pictures"
TAKEN = ROOT / "build" / "pictures"
LOOSE = 10.0  # of 255: mean difference of two pictures made small; another layout or theme differs by 20 and more


def small(image: Path | BytesIO) -> npt.NDArray[np.float64]:
    """The picture in grey, 64 x 40."""
    with Image.open(image) as picture:
        assert picture.size == (1280, 800)
        return np.asarray(picture.convert("L").resize((64, 40), Image.Resampling.BOX), dtype=np.float64)


def picture(page: Page, name: str) -> None:
    """Take a picture, and hold it against the one that the tutorial shows."""
    TAKEN.mkdir(parents=True, exist_ok=True)
    path = TAKEN / f"{name}.png"
    page.mouse.move(0, 0)
    image = BytesIO(page.screenshot(animations="disabled", caret="hide"))
    path.write_bytes(image.getvalue())  # to look at: another run in this tree may write there, too
    if os.environ.get("TERRAPIN_PICTURES") == "renew":
        KEPT.mkdir(parents=True, exist_ok=True)
        with Image.open(image) as taken:  # a palette is enough for a page, and a third of the bytes
            taken.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(KEPT / f"{name}.png", optimize=True)
    difference = float(np.abs(small(image) - small(KEPT / f"{name}.png")).mean())
    assert difference < LOOSE, f"{path} differs by {difference:.1f} of 255 from docs/pictures/{name}.png"


def test_the_pictures_are_told_apart() -> None:
    first, third = small(KEPT / "failing.png"), small(KEPT / "simulate.png")
    assert float(np.abs(first - third).mean()) > LOOSE
    assert float(np.abs(first - (255.0 - first)).mean()) > LOOSE  # light and dark


@pytest.fixture
def case(page: Page) -> Page:
    """The example of the tutorial, freshly opened."""
    page.emulate_media(color_scheme="light", reduced_motion="reduce")
    page.get_by_role("link", name="Workbench").click()
    page.get_by_role("button", name="Open the example heated_motor").click()
    expect(page.locator(".lead .chip.missing")).to_be_visible()  # the list of cases has such chips too
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "2")
    return page


def test_from_the_first_look_to_the_controller(case: Page, server: Server) -> None:
    page = case
    picture(page, "failing")
    page.get_by_role("button", name="Discover").first.click()
    card = page.locator(".card[data-effects=motor_heating]")
    expect(card).to_be_visible()
    expect(page.locator(".ladder .ghost")).to_have_count(2)
    picture(page, "ranking")
    card.get_by_role("button", name="Add motor_heating").click()
    expect(page.locator(".lead .chip.adequate")).to_be_visible()
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "3")
    picture(page, "floor")
    page.get_by_role("button", name="Export parameters").click()
    expect(page.get_by_role("link", name="Save the parameters")).to_be_visible()
    page.get_by_role("region", name="Send to controller").scroll_into_view_if_needed()
    picture(page, "controller")
    result = server.get("/api/cases/heated_motor")
    assert result["effects"] == ["speed_squared", "motor_heating"]
    page.get_by_role("button", name="Report").first.click()
    expect(page.get_by_role("link", name="open it")).to_be_visible()
    page.get_by_role("button", name="Remove motor_heating").click()
    expect(page.locator(".lead .chip.missing")).to_be_visible()


def test_the_robot_rolls(page: Page) -> None:
    page.emulate_media(color_scheme="light", reduced_motion="reduce")
    page.get_by_role("link", name="Simulate").click()
    page.locator("#sim-scenario").select_option("heated_winding")
    page.get_by_role("button", name="Run", exact=True).click()
    moment = page.get_by_label("Moment")
    expect(moment).to_be_enabled()
    moment.fill("6")
    picture(page, "simulate")
