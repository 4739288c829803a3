"""What the Workbench tab draws: view and preview against the answers of the commands, and what they refuse."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.web.cases.view import draft, preview, view
from terrapin_tools.web.cases.view_api import state_of
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import load_case, parse_case
from terrapin_tools.workbench.case.changes import add_effects
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.files.json_text import finite
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.story import answer
from terrapin_tools.workbench.story.told import told


@pytest.fixture(scope="module")
def heated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The heated motor before discover."""
    folder = tmp_path_factory.mktemp("cases") / "heated_motor"
    shutil.copytree(paths.ROOT / "cases" / "heated_motor", folder, ignore=shutil.ignore_patterns(".terrapin"))
    return folder


@pytest.fixture(scope="module")
def discovered(heated: Path) -> Path:
    """The heated motor with the answer of discover kept."""
    folder = heated.parent / "discovered"
    shutil.copytree(heated, folder)
    found = discover(load_case(folder))
    answer.keep(folder, told(found.analysis, found))
    return folder


def previewed(folder: Path, *effects: str) -> dict[str, Any]:
    shown = view(folder)
    noise = {name: channel["noise_sd"] for name, channel in shown["channels"].items()}
    kept = [row - 1 for row in shown["plot"]["columns"]["row"]["values"]]
    return preview(folder, effects, noise, kept)


def test_view_before_discover_is_what_compare_says(heated: Path) -> None:
    shown = view(heated)
    analysis = analyse(load_case(heated))
    assert (shown["verdict"], shown["discovered"], shown["cards"]) == ("missing", False, [])
    assert shown["next"]["do"] == "discover"
    assert [rung["heldout_error"] for rung in shown["plot"]["ladder"]] == [r.heldout_error for r in analysis.ladder]
    channel = shown["plot"]["channels"][0]
    assert channel["measured"] == pytest.approx(analysis.case.channels["current"], rel=1e-5)
    assert channel["predicted"] == pytest.approx(analysis.prediction[0], rel=1e-5)
    assert shown["where"][0]["variable"] == "temperature"
    assert "noise sd below the model" in shown["where"][0]["text"]
    assert [one["effect"] for one in shown["model"]] == ["speed_squared"]
    assert shown["model"][0]["equation"].startswith("<math>")


def test_view_after_discover_ranks_what_is_missing(discovered: Path) -> None:
    shown = view(str(discovered))
    assert shown["missing"] == ["motor_heating"]
    assert (shown["next"]["do"], shown["next"]["text"]) == ("add", "Put it in, and see the error fall.")
    first, *others = shown["cards"]
    assert (first["effect"], first["named"]) == ("motor_heating", True)
    assert not any(card["named"] for card in others)
    probabilities = [card["probability"] for card in others]
    assert probabilities == sorted(probabilities, reverse=True)
    assert all(card["equation"].startswith("<math>") and card["reason"].endswith(".") for card in shown["cards"])


def test_view_is_json_that_every_browser_reads(discovered: Path) -> None:
    json.dumps(finite(view(discovered)), allow_nan=False)


def test_preview_is_the_model_with_the_effect_added(discovered: Path) -> None:
    found = previewed(discovered, "motor_heating")
    larger = analyse(parse_case(discovered, add_effects(load_case(discovered).text, ["motor_heating"], {})))
    assert found["heldout_error"] == pytest.approx(larger.ladder[-1].heldout_error, rel=1e-6)
    assert found["train_error"] == pytest.approx(larger.ladder[-1].train_error, rel=1e-6)
    assert found["channels"]["current"] == pytest.approx(larger.prediction[0], rel=1e-5)
    assert found["parameters"]["motor_heating.a_t"]["value"] == pytest.approx(0.0022, abs=2e-4)


def test_preview_works_before_discover_and_for_a_part_of_the_rows(heated: Path) -> None:
    whole = previewed(heated, "motor_heating")["channels"]["current"]
    part = preview(heated, ["motor_heating"], {"current": 0.0015}, [3, 5, 70])
    assert part["channels"]["current"] == [whole[3], whole[5], whole[70]]


@pytest.mark.parametrize("effects", [["speed_squared"], ["motor_heating", "motor_heating"], ["no_such_effect"]])
def test_preview_refuses_what_cannot_be_added(heated: Path, effects: list[str]) -> None:
    with pytest.raises(UserError, match=r"effect: found '\w+', expected each once and of "):
        previewed(heated, *effects)


def test_notes_of_a_case_cannot_bring_a_script(heated: Path, tmp_path: Path) -> None:
    folder = tmp_path / "case"
    shutil.copytree(heated, folder)
    (folder / "notes.md").write_text("<script>alert(1)</script> **bold** [x](javascript:alert(1))\n", encoding="utf-8")
    notes = view(folder)["notes"]
    assert "<script" not in notes
    assert "href" not in notes
    assert "<strong>bold</strong>" in notes


def test_draft_is_the_plot_of_the_view(heated: Path) -> None:
    early, late = draft(heated), view(heated)
    assert [early[key] for key in ("title", "effects", "runs", "held_out")] == [
        late[key] for key in ("title", "effects", "runs", "held_out")
    ]
    for one, other in zip(early["plot"]["channels"], late["plot"]["channels"], strict=True):
        assert one["noise_sd"] == other["noise_sd"]
        for name in ("measured", "predicted", "base"):
            assert one[name] == pytest.approx(other[name], rel=1e-5)
    assert early["plot"]["ladder"] == []


def test_many_rows_are_thinned_and_noise_that_is_not_stated_is_none(tmp_path: Path) -> None:
    rows, random = 30_000, np.random.default_rng(1)
    x = np.sort(random.uniform(0.0, 1.0, rows))
    force = 2.0 * x + random.normal(0.0, 0.05, rows)
    force[12_345] = 50.0
    lines = [f"r{i % 5},{a:.5f},{b:.5f}" for i, (a, b) in enumerate(zip(x, force, strict=True))]
    (tmp_path / "m.csv").write_text("run,x,force\n" + "\n".join(lines) + "\n", encoding="utf-8")
    write_whole(
        tmp_path / "case.toml",
        '[model]\nbase = "equation"\neffects = []\n[model.equation]\nforce = "k*x"\n[fit]\nk = { value = 1.0 }\n'
        '[data]\nfiles = ["m.csv"]\nrun = "run"\n[data.columns]\nx = { column = "x" }\nforce = { column = "force" }\n',
    )
    plot = draft(tmp_path)["plot"]
    assert plot["kept"] < rows == plot["rows"]
    (channel,) = plot["channels"]
    assert channel["noise_sd"] is None
    assert max(channel["measured"]) == 50.0  # no outlier hides


def test_state_changes_with_every_file_that_a_view_stands_on(heated: Path, tmp_path: Path) -> None:
    folder = tmp_path / "case"
    shutil.copytree(heated, folder)
    states = [state_of(folder)]
    history.remember(folder, "added", ["x"], {"before": {}, "after": {}})
    states.append(state_of(folder))
    with (folder / "runs.csv").open("a", encoding="utf-8") as file:
        file.write("r12,5,7,40,400\n")
    states.append(state_of(folder))
    write_whole(folder / "case.toml", (folder / "case.toml").read_text(encoding="utf-8") + "\n")
    states.append(state_of(folder))
    assert len(set(states)) == 4
    assert state_of(folder) == states[-1]


def test_a_broken_case_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text('[model]\nbase = "nonsense"\n', encoding="utf-8")
    with pytest.raises(UserError, match=r"model\.base: found 'nonsense', expected one of") as found:
        view(tmp_path)
    assert "\n" not in str(found.value)
