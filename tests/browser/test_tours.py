"""Every tab at 390 px and by keyboard alone: nothing scrolls sideways, axe finds nothing, every control is reached."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect
from serving import Server

MOST = 400  # presses of Tab: more than any tab has controls


def first(page: Page) -> None:
    expect(page.locator(".case-list button").first).to_be_visible()


def case(page: Page) -> None:
    expect(page.locator(".lead .chip")).to_be_visible()
    expect(page.locator(".ladder[data-rungs]")).to_be_visible()


def simulate(page: Page) -> None:
    expect(page.locator("#sim-scenario option").first).to_be_attached()


def live(page: Page) -> None:
    expect(page.locator("#live-source option").first).to_be_attached()


PLACES = [("#workbench", first), ("#workbench/heated_motor", case), ("#simulate", simulate), ("#live", live)]


@pytest.mark.parametrize(("place", "ready"), PLACES, ids=["first", "case", "simulate", "live"])
def test_tour(page: Page, server: Server, place: str, ready: Callable[[Page], None]) -> None:
    server.ask("POST", "/api/examples/heated_motor")
    if ready is case:  # with all its panels
        server.wait(server.start("heated_motor", do="discover"))
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(server.line + place)
    page.reload()
    ready(page)
    for theme in ("dark", "light"):
        page.emulate_media(color_scheme=theme, reduced_motion="reduce")  # type: ignore[arg-type]
        found = Axe().run(page).response["violations"]
        assert [f"{v['id']}: {v['nodes'][0]['target']}: {v['help']}" for v in found] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.evaluate(
        """() => { window.reached = new Set(); document.activeElement?.blur();
            addEventListener('focusin', (event) => window.reached.add(event.target)); }"""
    )
    missed: list[str] = []
    for _ in range(MOST):
        page.keyboard.press("Tab")
        missed = page.evaluate(
            """() => [...document.querySelectorAll('button, a[href], select, input, textarea, summary, [tabindex="0"]')]
                .filter((one) => !one.disabled && one.tabIndex >= 0 && one.checkVisibility())
                .filter((one) => !window.reached.has(one))
                .map((one) => one.outerHTML.slice(0, 120))"""
        )
        if not missed:
            break
    assert missed == []
