"""The report in a browser: every choice and card is used, the console stays empty, nothing is wider than a phone."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from casekit import rolling, terrapin

from tests.chromium import CHROMIUM, FLAGS

ALONE = ["--headless", "--enable-logging=stderr", "--virtual-time-budget=6000"]  # without Playwright

USE = """<script>
let used = 0;
const press = (what, times = 1) => {
  for (const button of document.querySelectorAll(what)) for (let n = 0; n < times; n++) { button.click(); used++; }
};
for (const select of document.querySelectorAll('select')) {
  for (const name of [...select.options].map((option) => option.value)) {
    const now = [...document.querySelectorAll('select')].find((one) => [...one.options].some((o) => o.value === name));
    now.value = name;
    now.dispatchEvent(new Event('change'));
    used++;
  }
}
const against = document.querySelector('.axis select');
against.value = against.options[0].value; // "row" has no residual by run
against.dispatchEvent(new Event('change'));
press('button[data-preview]', 2);
press('#theme', 2);
press('#heat th button');
const named = [...document.querySelectorAll('#heat th button')].pop().textContent.replace(' ◇', '');
const picked = document.querySelector('#overlay [role=status]').textContent.replace(named, 'the last');
const canvas = document.querySelector('#overlay canvas'), box = canvas.getBoundingClientRect();
canvas.setPointerCapture = () => {};
const mouse = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type,
  {clientX: box.left + x, clientY: box.top + y, button: 0, pointerId: 1, bubbles: true}));
mouse('pointerdown', 100, 40); mouse('pointermove', 200, 150); mouse('pointerup', 200, 150);
const zoomed = document.querySelector('#overlay .plot').dataset.zoomed;
canvas.dispatchEvent(new MouseEvent('dblclick'));
const ink = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((v) => v > 0);
const ladder = document.querySelectorAll('#ladder rect').length;
const width = document.documentElement.scrollWidth;
console.log(`used ${used} drawn ${ink} zoomed ${zoomed} bars ${ladder} width ${width} of ${innerWidth} `
  + `picked ${picked}`);
</script></body>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_every_control_works_on_a_phone_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 34, runs=8, rows=8, heating=0.003)
    page = tmp_path / "page.html"
    assert terrapin(capsys, "report", folder, "-o", page)[0] == 0
    page.write_text(page.read_text(encoding="utf-8").replace("</body>", USE), encoding="utf-8")
    assert CHROMIUM is not None
    command = [CHROMIUM, *FLAGS, *ALONE, f"--user-data-dir={tmp_path / 'profile'}", "--window-size=500,900"]
    shot = [f"--screenshot={tmp_path / 'page.png'}", page.as_uri()]
    done = subprocess.run([*command, *shot], capture_output=True, text=True, timeout=300, check=False)
    lines = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert len(lines) == 1, lines  # the line above and no error
    found = re.search(r"used (\d+) drawn true zoomed yes bars (\d+) width (\d+) of (\d+) picked (.*)\"", lines[0])
    assert found is not None, lines
    used, bars, width, window = map(int, found.groups()[:4])
    assert used >= 12  # eight runs, the theme twice, and each column
    assert bars >= 2
    assert width <= window
    assert found[5] == "8 rows picked out, of the last"
