"""The notebooks of docs/notebooks run, cell by cell, as a kernel would run them: the last expression is shown."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import matplotlib.figure
import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def run(notebook: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What each cell of code shows."""
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {"__name__": "__main__"}
    shown = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == [], f"{notebook.name}: kept with output"
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, notebook.name, "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names)
            html = getattr(value, "_repr_html_", None)
            shown.append((html() if html else None) or value)
    return shown


def test_there_are_three() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["hil_test", "logged_robot", "own_bench"]


def test_a_bench_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, compared, discovered, ladder, picture, _, written = run(
        ROOT / "docs/notebooks/own_bench.ipynb", tmp_path, monkeypatch
    )
    assert "something is missing" in compared
    assert "temp" in discovered
    assert "heldout_error" in ladder
    assert isinstance(picture, matplotlib.figure.Figure)
    assert all(path.exists() for path in written)


def test_a_logged_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    *_, case, card, picture = run(ROOT / "docs/notebooks/logged_robot.ipynb", tmp_path, monkeypatch)
    assert case.base == "rolling_steady"
    assert "rolling_steady" in card
    assert isinstance(picture, matplotlib.figure.Figure)


def test_a_test_of_the_firmware(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (error, state), futures, (measured, omega) = run(ROOT / "docs/notebooks/hil_test.ipynb", tmp_path, monkeypatch)
    assert abs(error) < 0.02
    assert state == "safe"
    assert futures["stuck"] == ("safe", ["motor_encoder"])
    assert futures["noisy"][0] in ("run", "safe")
    assert measured == pytest.approx(omega, rel=0.05)
