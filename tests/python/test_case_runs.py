"""The circle from runs to a case and back: logged windows become rows, what is found becomes parameters."""

from __future__ import annotations

import csv
import json
import tomllib
from pathlib import Path

import pytest
from casekit import terrapin

from terrapin_hil.messages import interface

SCENARIO = """title = "warming motor"
duration = "12 s"
seed = {seed}
[sensors]
kit = "ideal"
current.noise = 6
[[path]]
terrain = "sand"
[winding]
profile = [["0 s", "25 degC"], ["4 s", "25 degC"], ["12 s", "65 degC"]]
[effect.motor_heating]
a_t = 0.003
[[operator]]
at = "0 s"
request = "run"
setpoint = "{voltage} V"
limiter = false
"""


def _runs(folder: Path, capsys: pytest.CaptureFixture[str], count: int = 6) -> list[Path]:
    found = []
    for seed, voltage in enumerate(range(3, 3 + count), 1):
        scenario = folder / f"v{voltage}.toml"
        scenario.write_text(SCENARIO.format(seed=seed, voltage=voltage))
        status, _, err = terrapin(capsys, "run", scenario, "--out", folder / f"run{voltage}")
        assert status == 0, err
        found.append(folder / f"run{voltage}")
    return found


def test_runs_become_a_case_that_knows_what_the_controller_knew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = _runs(tmp_path, capsys)
    case = tmp_path / "case"
    status, out, err = terrapin(capsys, "case", *runs, "--to", case, "--effect", "speed_squared", "--title", "Warm")
    assert (status, err) == (0, "")
    assert "of 6 runs" in out
    document = tomllib.loads((case / "case.toml").read_text())
    assert document["case"]["title"] == "Warm"
    assert document["model"] == {"base": "rolling_steady", "effects": ["speed_squared"]}
    assert document["parameters"]["load"].endswith(" N")
    assert float(document["parameters"]["radius"].split()[0]) == pytest.approx(0.08)
    span = interface().parameters["window"].default * 1e-3
    with (case / "runs.csv").open() as file:  # a row's temperature is the mean of its window, the last `span` seconds
        rows = [(float(row["time"]), float(row["temperature"])) for row in csv.DictReader(file)]
    warming = [25 + 5 * (time - span / 2 - 4) - celsius for time, celsius in rows if time > 4 + span]
    assert len(warming) > 40
    assert max(map(abs, warming)) < 0.25
    _, out, _ = terrapin(capsys, "add", case, "motor_heating", "--json", "-")
    answer = json.loads(out)
    assert answer["before"]["heldout_error"] > 5 * answer["after"]["heldout_error"]
    assert answer["after"]["train_error"] < 1.3
    assert answer["parameters"]["motor_heating.a_t"]["value"] == pytest.approx(0.003, rel=0.05)
    assert answer["parameters"]["f_o"]["value"] == pytest.approx(0.092, rel=0.02)
    target = tmp_path / "firmware.toml"
    terrapin(capsys, "export", case, "--to", target)
    status, _, err = terrapin(capsys, "run", tmp_path / "v6.toml", "--parameters", target, "--out", tmp_path / "again")
    assert status == 0, err
    run = tomllib.loads((tmp_path / "again" / "run.toml").read_text())
    assert float(run["parameters"]["comp_heating"].split()[0]) == pytest.approx(0.003, rel=0.05)


def test_refusals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = _runs(tmp_path, capsys, 2)
    case = tmp_path / "case"
    (tmp_path / "empty").mkdir()
    for arguments, expected in (
        ([*runs, "--effect", "warp"], "warp"),
        ([*runs, "--effect", "bulldozing"], "bulldozing"),
        ([runs[0]], "at least two"),
        ([runs[0], runs[0]], "twice"),
        ([runs[0], tmp_path / "empty"], "no such file"),
        ([*runs, "--after", "1000"], "no valid steady window"),
    ):
        status, _, err = terrapin(capsys, "case", *arguments, "--to", case)
        assert status == 2
        assert expected in err
        assert not case.exists()
    assert terrapin(capsys, "case", *runs, "--to", case)[0] == 0
    status, _, err = terrapin(capsys, "case", *runs, "--to", case)
    assert status == 2
    assert "exists" in err
