"""The report in a browser: every choice and card is used, the console stays empty, nothing is wider than a phone."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from casekit import rolling, terrapin

CHROMIUM = next((found for name in ("chromium", "google-chrome") if (found := shutil.which(name))), None)
FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
    "--virtual-time-budget=6000",
]  # fmt: skip
USE = """<script>
let used = 0;
for (const id of ['variable', 'channel']) {
  const select = document.getElementById(id);
  for (const option of select ? select.options : []) {
    select.value = option.value;
    select.dispatchEvent(new Event('change'));
    used++;
  }
}
for (const button of document.querySelectorAll('button')) { button.click(); used++; }
document.getElementById('heat').emit('plotly_click', {points: [{pointIndex: [0, 0]}]});
const marks = document.querySelectorAll('#overlay .scatterlayer .trace').length;
const width = document.documentElement.scrollWidth;
console.log('used ' + used + ' drawn ' + marks + ' width ' + width + ' of ' + innerWidth);
</script></body>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_every_control_works_on_a_phone_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 34, runs=8, rows=8, heating=0.003)
    page = tmp_path / "page.html"
    assert terrapin(capsys, "report", folder, "-o", page)[0] == 0
    page.write_text(page.read_text(encoding="utf-8").replace("</body>", USE), encoding="utf-8")
    assert CHROMIUM is not None
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--window-size=500,900"]
    shot = [f"--screenshot={tmp_path / 'page.png'}", page.as_uri()]
    done = subprocess.run([*command, *shot], capture_output=True, text=True, timeout=300, check=False)
    lines = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert len(lines) == 1, lines  # the line above and no error
    found = re.search(r"used (\d+) drawn (\d+) width (\d+) of (\d+)", lines[0])
    assert found is not None, lines
    used, drawn, width, window = map(int, found.groups())
    assert used >= 6
    assert drawn >= 3
    assert width <= window
