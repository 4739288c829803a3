"""The report: says what compare says, needs nothing from outside, lets no text of the user become markup."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from casekit import ROLLING, rolling, terrapin

from hil.paths import ROOT
from host_tools.workbench.markdown import to_html


class Page(HTMLParser):
    """Tags with attributes, the text, and the data of a page."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[tuple[str | None, str]] = []
        self.inside: str | None = None
        self.kind: str | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self.inside, self.kind = tag, dict(attrs).get("type")

    def handle_endtag(self, tag: str) -> None:
        if tag == self.inside:
            self.inside = None

    def handle_data(self, data: str) -> None:
        if self.inside == "script":
            self.scripts.append((self.kind, data))
        elif self.inside is None:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    @property
    def data(self) -> dict[str, object]:
        (found,) = [text for kind, text in self.scripts if kind == "application/json"]
        return dict(json.loads(found))


def _report(folder: Path, output: Path, capsys: pytest.CaptureFixture[str]) -> Page:
    status, out, err = terrapin(capsys, "report", folder, "-o", output)
    assert (status, err) == (0, "")
    assert out.strip() == str(output)
    return Page(output.read_text(encoding="utf-8"))


def test_page_of_a_failing_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 31, heating=0.003)
    page = _report(folder, tmp_path / "r.html", capsys)
    _, out, _ = terrapin(capsys, "compare", folder, "--json", "-")
    answer = json.loads(out)
    data = page.data
    assert data["where"] == answer["where"]
    assert data["ladder"] == answer["ladder"]
    assert data["variable"] == "temperature"
    channel = data["channels"][0]  # type: ignore[index]
    measured, predicted = np.array(channel["measured"]), np.array(channel["predicted"])
    np.testing.assert_allclose((measured - predicted) / channel["noise_sd"], channel["residual"], atol=2e-3)
    assert sum(data["held"]) == 24  # type: ignore[arg-type]
    assert "humidity" in data["columns"]  # type: ignore[operator]
    assert "Something is missing from the model" in page.text
    assert "temperature" in page.text


def test_page_needs_nothing_from_outside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = _report(rolling(tmp_path / "case", 32, runs=4, rows=4), tmp_path / "r.html", capsys)
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base")
        assert "src" not in attributes
        assert tag == "a" or "href" not in attributes
    assert any("Plotly" in text or "plotly" in text for _, text in page.scripts)


def test_text_of_the_user_stays_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nasty = "</script><script>alert(1)</script>"
    text = ROLLING.replace('title = "Rolling" ', f"title = '{nasty}'\nnotes = \"n.md\" ")
    folder = rolling(tmp_path / "case", 33, runs=4, rows=4, text=text)
    (folder / "n.md").write_text(f"# Note\n\n{nasty} <img src=x onerror=alert(1)> [x](javascript:alert(1))\n")
    lines = (folder / "runs.csv").read_text().replace("r01", nasty.replace(",", ""))
    (folder / "runs.csv").write_text(lines.replace("humidity", "<b>wet</b>"))
    page = _report(folder, tmp_path / "r.html", capsys)
    assert len([1 for tag, _ in page.tags if tag == "script"]) == 3
    assert not any(tag == "img" for tag, _ in page.tags)
    assert not any("javascript:" in str(attributes) for _, attributes in page.tags)
    assert page.text.count(nasty) >= 2


def test_page_of_the_shipped_table_says_what_is_true(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = _report(ROOT / "cases" / "forced_slip_sand", tmp_path / "r.html", capsys)
    assert "Something is missing" in page.text
    assert "no value of the free soil parameters changes that" in page.text
    assert "An inference, not a proof: the radius" in page.text
    assert "319 mm" in page.text


def test_ranking_of_discover_is_shown_for_the_same_model_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = rolling(tmp_path / "case", 34, runs=5, rows=5)
    answer = {
        "model": {"effects": []},
        "candidates": [{"effect": "motor_heating", "probability": 0.93}],
        "next_experiment": {"reason": "Warm it up."},
    }
    (folder / ".terrapin").mkdir()
    file = folder / ".terrapin" / "discover.json"
    file.write_text(json.dumps(answer))
    page = _report(folder, tmp_path / "r.html", capsys)
    assert "93 %" in page.text
    assert "Warm it up." in page.text
    file.write_text(json.dumps({**answer, "model": {"effects": ["cogging"]}}))
    assert "93 %" not in _report(folder, tmp_path / "r.html", capsys).text


def test_notes_in_markdown() -> None:
    text = (
        "# A\ntext `x<y`\n\n- one\n  more\n- two **b**\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\n[t](https://example.org/x)"
    )
    assert to_html(text) == (
        "<h3>A</h3>\n<p>text <code>x&lt;y</code></p>\n<ul><li>one more</li><li>two <b>b</b></li></ul>\n"
        "<table><thead><tr><th>a</th><th>b</th></tr></thead><tbody><tr><td>1</td><td>2</td></tr></tbody></table>\n"
        '<p><a href="https://example.org/x">t</a></p>'
    )


def test_output_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 35, runs=4, rows=4)
    status, _, err = terrapin(capsys, "report", folder, "-o", tmp_path / "no" / "r.html")
    assert status == 1
    assert err == f"terrapin: {tmp_path / 'no' / 'r.html'}: No such file or directory\n"
