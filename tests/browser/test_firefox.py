"""Each tab in Firefox: it opens, draws, fits into 390 px, drives the simulated robot, and its console stays empty."""

from __future__ import annotations

from pathlib import Path

import pytest
from firefox import FIREFOX, Firefox
from serving import Server

TABS = {
    "#workbench": "document.querySelector('.hero .thumbnail')",
    "#workbench/heated_motor": "document.querySelector('.lead .chip') && document.querySelector('.ladder[data-rungs]')",
    "#simulate": "document.querySelector('#sim-scenario option')",
    "#live": "document.querySelector('.drive-panel')?.textContent.includes('Nothing goes to the robot')",
}


@pytest.mark.skipif(FIREFOX is None, reason="no Firefox here")
def test_each_tab_in_firefox(server: Server, tmp_path: Path) -> None:
    server.ask("POST", "/api/examples/heated_motor")
    server.warm_live()
    assert server.ask("POST", "/api/live", {"source": "robot:floor"}).status == 200
    with Firefox(tmp_path) as page:
        page.open(server.line)
        for tab, there in TABS.items():
            page.evaluate(f"location.hash = '{tab}'")
            page.until(there)
            for width in (1280, 390):
                page.size(width, 844)
                assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, (tab, width)
        page.until("Number(document.querySelector('.tab-live').dataset.redraws) > 5")
        arm = "[...document.querySelectorAll('.drive-panel button')].find((one) => one.textContent === 'Arm …')"
        page.until(f"!{arm}.disabled")
        page.evaluate(f"{arm}.click()")
        page.evaluate("document.querySelector('.drive-panel dialog button.main').click()")
        page.until("/[1-9] commands sent/.test(document.querySelector('.drive-panel').textContent)")
        page.evaluate("document.querySelector('button.stop').click()")
        page.until("document.querySelector('[data-tile=Faults]').textContent.includes('stop_all')")
        assert page.said == []
    server.ask("POST", "/api/live/command", {"request": "release"})
    server.ask("DELETE", "/api/live")
