"""The report: says what compare says, needs nothing from outside, lets no text of the user become markup."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from casekit import ROLLING, rolling, terrapin

from terrapin_hil.paths import ROOT
from terrapin_hil.physics.effects import catalogue
from terrapin_tools.workbench.noise import odd
from terrapin_tools.workbench.story import plot_data
from terrapin_tools.workbench.story.formulas import from_expression, from_latex
from terrapin_tools.workbench.story.notes import to_html


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


def _report(folder: Path, output: Path, capsys: pytest.CaptureFixture[str], *options: str) -> Page:
    status, out, err = terrapin(capsys, "report", folder, "-o", output, *(options or ["--no-discover"]))
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
    error = np.sqrt(np.mean((measured - predicted) ** 2)) / channel["noise_sd"]
    rungs = answer["ladder"][-1]
    assert min(rungs["train_error"], rungs["heldout_error"]) < error < max(rungs["train_error"], rungs["heldout_error"])
    held = data["held"]
    assert sum(held[run] for run in data["run"]) == 24  # type: ignore[index, attr-defined]
    assert "humidity" in data["columns"]  # type: ignore[operator]
    assert "Something is missing from the model" in page.text
    assert "temperature" in page.text


def test_page_needs_nothing_from_outside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = _report(rolling(tmp_path / "case", 32, runs=4, rows=4), tmp_path / "r.html", capsys)
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base")
        assert "src" not in attributes
        assert tag == "a" or "href" not in attributes
    assert (tmp_path / "r.html").stat().st_size < 200_000


def test_text_of_the_user_stays_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nasty = "</script><!--<script>alert(1)</script>"  # the comment: a reader would look for two ends
    text = ROLLING.replace('title = "Rolling" ', f"title = '{nasty}'\nnotes = \"n.md\" ")
    folder = rolling(tmp_path / "case", 33, runs=4, rows=4, text=text)
    (folder / "n.md").write_text(f"# Note\n\n{nasty} <img src=x onerror=alert(1)> [x](javascript:alert(1))\n")
    lines = (folder / "runs.csv").read_text().replace("r01", nasty.replace(",", ""))
    (folder / "runs.csv").write_text(lines.replace("humidity", "<b>wet</b>"))
    page = _report(folder, tmp_path / "r.html", capsys)
    assert len([1 for tag, _ in page.tags if tag == "script"]) == 2
    assert not any(tag == "img" for tag, _ in page.tags)
    assert not any("javascript:" in str(attributes) for _, attributes in page.tags)
    assert page.text.count(nasty) >= 2


def test_page_of_the_shipped_table_says_what_is_true(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(ROOT / "cases" / "forced_slip_sand", tmp_path / "case", ignore=shutil.ignore_patterns(".*"))
    page = _report(tmp_path / "case", tmp_path / "r.html", capsys)
    assert "Something is missing" in page.text
    assert "no value of the free soil parameters changes that" in page.text
    assert "An inference, not a proof: the radius" in page.text
    assert "319 mm" in page.text


def test_page_says_what_discover_found_of_the_very_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 34, heating=0.003)
    page = _report(folder, tmp_path / "r.html", capsys, "--discover")
    answer = json.loads((folder / ".terrapin" / "discover.json").read_text())
    assert answer["missing"] == ["motor_heating"]
    assert f"With probability {answer['answer_probability']:.2f} the model lacks motor_heating and" in page.text
    assert f"terrapin add {folder} motor_heating" in page.text
    data = page.data
    assert data["ladder"] == answer["ladder"]
    shown = data["previews"]
    assert isinstance(shown, list)
    assert shown[0] == "motor_heating"
    channel = data["channels"][0]  # type: ignore[index]
    gap = (np.array(channel["measured"]) - channel["previews"][0]) / channel["noise_sd"]
    held = [data["held"][run] for run in data["run"]]  # type: ignore[index, attr-defined]
    assert np.sqrt(np.mean(gap[held] ** 2)) == pytest.approx(answer["ladder"][-1]["heldout_error"], rel=0.01)
    assert any(tag == "math" for tag, _ in page.tags)
    buttons = [attributes for tag, attributes in page.tags if tag == "button" and "data-preview" in attributes]
    assert {attributes["data-preview"] for attributes in buttons} == {str(i) for i in range(len(shown))}
    assert all(attributes["aria-pressed"] in ("true", "false") for attributes in buttons)

    kept = (folder / ".terrapin" / "discover.json").read_text().replace("motor_heating", "winding_heating")
    (folder / ".terrapin" / "discover.json").write_text(kept)  # the same state: it is shown, not found again
    assert "winding_heating" in _report(folder, tmp_path / "r.html", capsys).text
    rows = (folder / "runs.csv").read_text()
    (folder / "runs.csv").write_text(rows + "\n")
    assert "winding_heating" not in _report(folder, tmp_path / "r.html", capsys).text
    (folder / "runs.csv").write_text(rows)
    (folder / "case.toml").write_text((folder / "case.toml").read_text() + "# changed\n")
    assert "winding_heating" not in _report(folder, tmp_path / "r.html", capsys).text


def test_history_of_what_was_added_and_removed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 36, runs=6, rows=8, heating=0.003)
    assert terrapin(capsys, "add", folder, "motor_heating")[0] == 0
    assert terrapin(capsys, "remove", folder, "motor_heating")[0] == 0
    text = _report(folder, tmp_path / "r.html", capsys).text
    assert "History: 2 steps" in text
    assert re.search(r"added motor_heating : held out [\d.]+ → [\d.]+ removed motor_heating", text)
    history = folder / ".terrapin" / "history.jsonl"
    whole = history.read_bytes()
    damaged = b'{"action": "added", "effects": ["x"], "before": {}, "after": {}}\n[]\n\xff\n{"action": 1}\n'
    history.write_bytes(whole + damaged)
    status, _, err = terrapin(capsys, "report", folder, "--output", tmp_path / "d.html")
    assert (status, err) == (0, f"terrapin: {history}: 4 of 6 lines are damaged and left out\n")
    assert "History: 2 steps" in (tmp_path / "d.html").read_text()
    assert terrapin(capsys, "add", folder, "motor_heating")[0] == 0
    assert history.read_bytes().startswith(whole + damaged)  # nothing of it is lost


def test_one_step_that_holds_nothing_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It said "1 steps" and "held out : held out 1.02", and called errors in mA errors in noise sd."""
    folder = rolling(tmp_path / "case", 36, runs=6, rows=8)
    assert terrapin(capsys, "case", "hold", folder)[0] == 0
    text = _report(folder, tmp_path / "r.html", capsys).text
    assert "History: 1 step held out nothing : held out" in text
    assert "Errors without a unit are in noise sd: 1.0 is the noise floor." in text


def test_many_rows_are_thinned_and_the_worst_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plot_data, "MAX_ROWS", 40)
    monkeypatch.setattr(odd, "ODD_MOST", 0)  # else the worst row stands alone, and is left out
    folder = rolling(tmp_path / "case", 37, runs=10, rows=30)
    lines = (folder / "runs.csv").read_text().splitlines()
    cells = lines[177].split(",")
    cells[lines[0].split(",").index("i")] = "9999"
    lines[177] = ",".join(cells)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    page = _report(folder, tmp_path / "r.html", capsys)
    data = page.data
    assert data["rows"] == 300
    assert data["kept"] == len(data["run"]) == 40  # type: ignore[arg-type]
    assert "40 of 300 rows are drawn" in page.text
    assert max(data["channels"][0]["measured"]) == pytest.approx(9.999)  # type: ignore[index]


def test_equations_are_typeset() -> None:
    assert from_latex(r"\Delta C = \tfrac12\,b\,\omega^2") == (
        '<math><mrow><mi>Δ</mi><mi>C</mi><mo>=</mo><mstyle displaystyle="false" scriptlevel="0"><mfrac><mn>1</mn>'
        '<mn>2</mn></mfrac></mstyle><mspace width="0.167em"></mspace><mi>b</mi><mspace width="0.167em"></mspace>'
        "<msup><mi>ω</mi><mn>2</mn></msup></mrow></math>"
    )
    assert from_latex(r"P \to P - R_f,\; T \to T").count("<math>") == 2
    assert from_expression("max(humidity, 2)").count("<math>") == 1
    assert "<mtext>humidity</mtext>" in from_expression("max(humidity, 2)")
    for effect in catalogue().values():
        for text in (from_latex(effect.equation), from_expression(effect.expression) if effect.expression else ""):
            for equation in re.findall(r"<math>.*?</math>", text):
                ElementTree.fromstring(equation)  # well formed
            assert "\\" not in text
            assert "mathrm" not in text


@pytest.mark.parametrize(
    "text",
    [
        r"\text{<script>alert(1)</script>}",
        "<img src=x onerror=alert(1)>",
        r"\href{javascript:alert(1)}{x}",
        r"\style{background:url(x)}{y}",
        r"\class{card}{y}",
        "&lt;script&gt; & x",
        r"\frac{<b>",
        "{",
        "",
        "x_",
    ],
)
def test_equations_of_the_user_bring_no_markup(text: str) -> None:
    found = from_latex(text)
    root = ElementTree.fromstring(found)  # what is no LaTeX stands as text
    for element in root.iter():
        assert re.fullmatch(r"math|m[a-z]+", element.tag)
        assert not {"href", "style", "class", "id", "src"} & element.attrib.keys()


def test_notes_in_markdown() -> None:
    text = (
        "# A\ntext `x<y`\n\n- one\n  more\n- two **b**\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\n[t](https://example.org/x)"
    )
    assert re.sub(r">\n+<", "><", to_html(text)) == (
        "<h3>A</h3><p>text <code>x&lt;y</code></p><ul><li>one\nmore</li><li>two <strong>b</strong></li></ul>"
        "<table><thead><tr><th>a</th><th>b</th></tr></thead><tbody><tr><td>1</td><td>2</td></tr></tbody></table>"
        '<p><a href="https://example.org/x">t</a></p>'
    )
    assert "<h6>deep</h6>" in to_html("##### deep")


def test_notes_bring_no_script_and_fetch_nothing() -> None:
    text = "<script>alert(1)</script> <b onclick=x>b</b>\n\n![p](https://example.org/p.png)\n\n"
    links = [
        "javascript:alert(1)",
        "JavaScript:alert(1)",
        "data:text/html,x",
        "file:///etc/passwd",
        "/api/stop",
        "//x.org",
    ]
    page = Page(to_html(text + "\n\n".join(f"[l]({link}) <{link}>" for link in links)))
    assert {tag for tag, _ in page.tags} <= {"p", "a"}
    assert {attributes["href"] for _, attributes in page.tags if attributes} == {"https://example.org/p.png"}


def test_output_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path / "case", 35, runs=4, rows=4)
    status, _, err = terrapin(capsys, "report", folder, "-o", tmp_path / "no" / "r.html")
    assert status == 1
    assert err == f"terrapin: {tmp_path / 'no' / 'r.html'}: No such file or directory\n"
