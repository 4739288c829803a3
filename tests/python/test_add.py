"""Add, remove, export, effects: what they write, what they print, and that a refusal writes nothing."""

from __future__ import annotations

import fcntl
import json
import os
import tomllib
from pathlib import Path

import pytest
from casekit import ROLLING, rolling, terrapin

from terrapin_hil.messages import interface
from terrapin_hil.physics.effects import catalogue
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.files import writing
from terrapin_tools.workbench.files.writing import write_changed, write_whole
from terrapin_tools.workbench.story import change


def test_add_mends_the_model_and_keeps_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 30, heating=0.003)
    status, out, _ = terrapin(capsys, "add", folder, "motor_heating", "--json", tmp_path / "a.json")
    assert status == 0
    text = (folder / "case.toml").read_text()
    assert text == ROLLING.replace("effects = []     ", 'effects = ["motor_heating"]     ')
    answer = json.loads((tmp_path / "a.json").read_text())
    assert answer["verdict"] == "adequate"
    assert answer["added"] == ["motor_heating"]
    assert answer["before"]["heldout_error"] > 2
    assert answer["after"]["heldout_error"] < 1.25
    assert [rung["added"] for rung in answer["ladder"]] == [None, "motor_heating"]
    assert [answer[side]["heldout_error"] for side in ("before", "after")] == [
        rung["heldout_error"] for rung in answer["ladder"]
    ]  # in one noise sd: what stands below
    found = answer["parameters"]["motor_heating.a_t"]
    assert found["unit"] == "1/K"
    assert found["value"] == pytest.approx(0.003, abs=4 * found["sd"])
    assert "before -> after" in out
    status, _, _ = terrapin(capsys, "remove", folder, "motor_heating")
    assert status == 0
    assert (folder / "case.toml").read_text() == ROLLING


def test_add_several_and_keep_their_order(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 22, heating=0.003)
    _, out, _ = terrapin(capsys, "add", folder, "viscous_friction", "motor_heating", "--json", "-")
    answer = json.loads(out)
    assert answer["model"]["effects"] == ["viscous_friction", "motor_heating"]
    errors = [rung["train_error"] for rung in answer["ladder"]]
    assert errors[0] >= errors[1] >= errors[2]


def test_add_own_expression(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 23, heating=0.003)
    status, _, err = terrapin(
        *(capsys, "add", folder, "warm", "--expression", "-k * (temperature - 25)", "--target", "torque_constant"),
        *("--parameter", "k=0:-0.01:0.01:1/K"),
    )
    assert (status, err) == (0, "")
    document = tomllib.loads((folder / "case.toml").read_text())
    assert document["model"]["effects"] == ["warm"]
    assert document["effect"]["warm"] == {
        "expression": "-k * (temperature - 25)",
        "target": "torque_constant",
        "k": {"value": 0.0, "min": -0.01, "max": 0.01, "unit": "1/K"},
    }
    _, out, _ = terrapin(capsys, "compare", folder, "--json", "-")
    found = json.loads(out)["parameters"]["warm.k"]
    assert found["value"] == pytest.approx(0.003, abs=4 * found["sd"])
    terrapin(capsys, "remove", folder, "warm")
    assert tomllib.loads((folder / "case.toml").read_text())["model"]["effects"] == []
    status, _, _ = terrapin(capsys, "add", folder, "warm")  # its table stayed: the name is enough
    assert status == 0


def test_add_what_discover_proposed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 24, heating=0.003)
    (folder / ".terrapin").mkdir()
    candidate = {
        "effect": "expression_1",
        "kind": "expression",
        "expression": "k * temperature * sign(omega)",
        "target": "resistance",
        "probability": 0.9,
        "heldout_rmse": {"current": 0.1},
        "noise_ratio": 1.0,
        "parameters": {"k": {"value": 1e-4, "sd": 1e-6, "unit": "N m/K"}},
        "explains": 0.9,
    }
    answer = {"candidates": [candidate]}
    (folder / ".terrapin" / "discover.json").write_text(json.dumps(answer))
    status, _, err = terrapin(capsys, "add", folder, "expression_1")
    assert (status, err) == (0, "")
    own = tomllib.loads((folder / "case.toml").read_text())["effect"]["expression_1"]
    assert own["k"] == {"value": 1e-4, "unit": "N m/K"}
    assert own["expression"] == candidate["expression"]
    (folder / ".terrapin" / "discover.json").write_text("{")
    status, _, err = terrapin(capsys, "add", folder, "expression_2")
    assert status == 2
    assert "discover.json" in err


REFUSED = [
    (["warp"], "warp"),
    (["bulldozing"], "sphere_contact"),
    (["slope"], "needs the role slope"),
    (["motor_heating", "motor_heating"], "already"),
    (["x", "y", "--expression", "omega"], "expected one"),
    (["x y", "--expression", "omega"], "x y"),
    (["x", "--expression", "k*omega"], "k is no role"),
    (["x", "--expression", "omega +"], "column"),
    (["x", "--expression", "open('f')"], "unknown function open"),
    (["x", "--expression", "omega", "--target", "warp"], "--target"),
    (["x", "--expression", "omega", "--parameter", "k=1"], "does not occur"),
    (["x", "--expression", "k*omega", "--parameter", "k=1:2"], "--parameter"),
    (["x", "--expression", "k*omega", "--parameter", "k=a"], "--parameter"),
    (["x", "--expression", "k*omega", "--parameter", "k=3:0:1"], "between min"),
    (["x", "--expression", "k*omega", "--parameter", "k=0:0:1:wobble"], "wobble"),
    (["motor_heating", "--target", "current"], "together with --expression"),
    (["motor_heating", "--expression", "omega"], "catalogued"),
]


@pytest.mark.parametrize(("arguments", "expected"), REFUSED, ids=range(len(REFUSED)))
def test_refusals_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    folder = rolling(tmp_path, 25, runs=4, rows=4)
    status, out, err = terrapin(capsys, "add", folder, *arguments)
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1
    assert expected in err
    assert (folder / "case.toml").read_text() == ROLLING
    assert sorted(path.name for path in folder.iterdir()) == ["case.toml", "runs.csv"]


def test_remove_what_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 26, runs=4, rows=4)
    status, _, err = terrapin(capsys, "remove", folder, "motor_heating")
    assert status == 2
    assert "not in the model" in err


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "f.toml"
    file.write_text("old")
    file.chmod(0o640)
    write_whole(file, "new")
    assert file.read_text() == "new"
    assert file.stat().st_mode & 0o777 == 0o640
    with pytest.raises(UnicodeEncodeError):
        write_whole(file, "\ud800")
    assert file.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["f.toml"]


def test_what_is_no_file_is_written_to_and_stays(tmp_path: Path) -> None:
    pipe, link, file = tmp_path / "pipe", tmp_path / "link", tmp_path / "file"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, "through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert pipe.is_fifo()
    file.write_text("old")
    link.symlink_to(file)
    write_whole(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path, "x")


def test_export_rounds_to_what_the_controller_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 27, heating=0.003)
    terrapin(capsys, "add", folder, "motor_heating", "speed_squared")
    target = tmp_path / "firmware.toml"
    status, out, _ = terrapin(capsys, "export", folder, "--to", target, "--json", tmp_path / "e.json")
    assert status == 0
    values = tomllib.loads(target.read_text())["parameters"]
    assert list(values) == ["comp_heating"]
    answer = json.loads((tmp_path / "e.json").read_text())
    held = answer["parameters"]["comp_heating"]
    parameter = interface().parameter("comp_heating")
    assert held["raw"] == round(held["fit"] / parameter.scale)
    assert values["comp_heating"] == pytest.approx(held["raw"] * parameter.scale, rel=1e-9)
    assert abs(held["value"] - held["fit"]) <= parameter.scale / 2
    assert answer["not_compensated"] == ["speed_squared"]
    assert 0 <= answer["rounding_torque"] < 20e-6
    assert "uN m" in out


def test_export_without_anything_to_export(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 28, runs=4, rows=4)
    status, _, err = terrapin(capsys, "export", folder, "--to", tmp_path / "f.toml")
    assert status == 2
    assert "effects in the model: none" in err
    assert not (tmp_path / "f.toml").exists()


def test_export_says_why_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 29, runs=6, rows=8)
    terrapin(capsys, "add", folder, "speed_squared", "aerodynamic_drag")
    status, _, err = terrapin(capsys, "export", folder, "--to", tmp_path / "f.toml")
    assert status == 2
    assert err.count("it is part of C_t") == 2
    terrapin(capsys, "add", folder, "mine", "--expression", "k*omega*abs(omega)*load", "--parameter", "k=0")
    terrapin(capsys, "add", folder, "viscous_friction")
    status, out, _ = terrapin(capsys, "export", folder, "--to", tmp_path / "f.toml")
    assert status == 0
    assert "mine: not compensated: a formula of your own" in out
    text = (tmp_path / "f.toml").read_text()
    assert list(tomllib.loads(text)["parameters"]) == ["comp_viscous"]
    assert "# Not compensated: aerodynamic_drag: acts on the shell from outside" in text


def test_effects_are_listed_and_explained(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = terrapin(capsys, "effects")
    for name in catalogue():
        assert name in out
    for name, effect in catalogue().items():
        _, out, _ = terrapin(capsys, "effects", name)
        assert effect.source in out
        assert all(p.name in out for p in effect.parameters)
    status, _, err = terrapin(capsys, "effects", "warp")
    assert status == 2
    assert "'warp'" in err


def test_a_change_that_came_between_is_not_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two `add` at once: the later one to write finds another case.toml than it read, and says so in one line."""
    folder = rolling(tmp_path, 30, heating=0.003)
    present = load_case(folder)
    texts = [
        present.text.replace("effects = []", f'effects = ["{name}"]') for name in ("motor_heating", "coulomb_friction")
    ]
    write_changed(folder / "case.toml", present.text, texts[0])
    with pytest.raises(UserError, match="changed since it was read"):
        write_changed(folder / "case.toml", present.text, texts[1])
    assert (folder / "case.toml").read_text() == texts[0]
    monkeypatch.setattr(writing, "LOCK_SECONDS", 0.05)
    handle = os.open(folder, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)  # of a command that hangs
    with pytest.raises(UserError, match="another command is writing"):
        write_changed(folder / "case.toml", texts[0], texts[1])
    os.close(handle)
    write_changed(folder / "case.toml", texts[0], texts[1])
    assert (folder / "case.toml").read_text() == texts[1]


def test_an_effect_that_is_added_meanwhile_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = rolling(tmp_path, 30, heating=0.003)
    meanwhile = ROLLING.replace("effects = []     ", 'effects = ["motor_heating"]     ')

    def slow(*arguments: object) -> object:
        (folder / "case.toml").write_text(meanwhile)
        return analyse(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(change, "analyse", slow)
    status, out, err = terrapin(capsys, "add", folder, "viscous_friction")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "changed since it was read, nothing was written" in err
    assert (folder / "case.toml").read_text() == meanwhile


def test_escapes_of_a_title_stay_out_of_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 30)
    path = folder / "case.toml"
    path.write_text(path.read_text().replace('title = "Rolling"', 'title = "Rolling\\u001b[2J\\u0007"'))
    status, out, err = terrapin(capsys, "compare", folder)
    assert status == 0, err
    assert "\x1b" not in out + err
    assert "\x07" not in out + err
