"""Simulate: scenarios and their changes, runs as jobs, what a run did, a case of it, and what is refused."""

from __future__ import annotations

import asyncio
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from serving import Server

from terrapin_hil import paths
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import load_scenario
from terrapin_tools.batch.design import read_varied
from terrapin_tools.batch.one_run import Plan, refuse_ends
from terrapin_tools.errors import UserError
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.workspace import Taken, Workspace
from terrapin_tools.web.simulate import simulate_api
from terrapin_tools.web.simulate.simulate_api import (
    FaultAt,
    Segment,
    Simulate,
    _never_begun,
    changed_scenario,
    runs,
    scenarios,
)
from terrapin_tools.web.simulate.simulate_data import ground_height, run_signals

SCENARIOS = sorted(paths.SCENARIOS.glob("*.toml"))


def start(server: Server, status: int = 202, **body: Any) -> Any:
    answer = server.ask("POST", "/api/simulate", body)
    assert answer.status == status, answer.body
    return answer.json


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_unchanged_is_the_scenario_as_shipped(path: Path, tmp_path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert changed_scenario(text, Simulate(scenario=path.stem)) == text
    changed = changed_scenario(text, Simulate(scenario=path.stem, supply=11.0, duration=1.5, effects={}))
    (tmp_path / path.name).write_text(changed)
    scenario = load_scenario(tmp_path / path.name)
    assert (scenario.supply, scenario.duration, scenario.effects) == (11.0, 1.5, ())


def test_changes_are_in_the_scenario(tmp_path: Path) -> None:
    """Each change arrives at the loaded scenario; what is left out stays."""
    path = paths.SCENARIOS / "slope_limiter.toml"
    body = Simulate(
        scenario="slope_limiter",
        ground=[Segment(), Segment(terrain="dry_peat", slope=0.1)],
        setpoints=[6.5],
        limiter=False,
        effects={"stribeck": {"a_s": 0.01, "omega_s": 3.0}},
        faults=[FaultAt(kind="stuck", channel="motor", begin=2.0, end=3.0), FaultAt(kind="supply", value=9.0)],
    )
    (tmp_path / "x.toml").write_text(changed_scenario(path.read_text(), body))
    before, after = load_scenario(path), load_scenario(tmp_path / "x.toml")
    assert after.ground.segments[0] == before.ground.segments[0]
    assert after.ground.segments[1].slope == 0.1
    assert after.ground.segments[1].terrain.f_o == 0.045
    assert [(o.setpoint, o.limiter) for o in after.operator] == [(6.5, False)]
    assert {e.effect.name: dict(e.values) for e in after.effects} == {"stribeck": {"a_s": 0.01, "omega_s": 3.0}}
    assert [(f.kind, f.channel, f.value, f.begin) for f in after.faults] == [
        ("stuck", "motor", 0.0, 2.0),
        ("supply", "", 9.0, 0.0),
    ]
    assert [check.text for check in after.checks] == [check.text for check in before.checks]


def test_changes_that_fit_nothing(tmp_path: Path) -> None:
    text = (paths.SCENARIOS / "steady_sand.toml").read_text()
    with pytest.raises(UserError, match="expected no soil"):
        changed_scenario(text, Simulate(scenario="steady_sand", soil="sand_reina"))
    with pytest.raises(UserError, match="at most 1"):
        changed_scenario(text, Simulate(scenario="steady_sand", ground=[Segment(), Segment()]))
    with pytest.raises(UserError, match="at most 1"):
        changed_scenario(text, Simulate(scenario="steady_sand", setpoints=[1.0, 2.0]))


def test_description() -> None:
    """Everything that the page offers has finite bounds, and starts inside them."""
    found = scenarios()
    assert [one["name"] for one in found["scenarios"]] == [path.stem for path in SCENARIOS]
    for effect in found["effects"]:
        for parameter in effect["parameters"]:
            assert -1e6 < parameter["low"] <= parameter["start"] <= parameter["high"] < 1e6, (effect, parameter)
    for fault in found["faults"].values():
        assert bool(fault["unit"]) == (fault["high"] is not None)
    for one in found["scenarios"]:
        assert one["fields"][0]["name"] == "supply.voltage"
        assert {f"path.{n}.slope" for n in range(1, len(one["ground"]) + 1)} <= {f["name"] for f in one["fields"]}
        assert ("checks" in one["judged"]) == (one["checks"] > 1)


@pytest.mark.parametrize("name", ["steady_sand", "slope_limiter"])
def test_what_is_offered_to_be_varied_is_taken(name: str) -> None:
    path = paths.SCENARIOS / f"{name}.toml"
    fields = next(one["fields"] for one in scenarios()["scenarios"] if one["name"] == name)
    varied = [read_varied(field["example"]) for field in fields]
    assert [one.name for one in varied] == [field["name"] for field in fields]
    assert len(fields) > 20
    refuse_ends(Plan(str(path), path.read_text(), ()), varied)


def test_run_signals_are_the_truth(server: Server) -> None:
    """A changed run through the server gives what the same scenario gives in this process."""
    body = {"scenario": "slope_limiter", "duration": 3.0, "ground": [{}, {"slope": 0.1}], "seed": 5}
    started = start(server, **body)
    assert "--seed 5" in started["command"]
    job = server.wait(started["id"])
    assert job["state"] == "done", job
    assert any("%" in line for line in job["progress"])
    found = server.get(f"/api/simulate/{started['run']}/signals")
    file = server.workspace / "runs" / started["run"] / "slope_limiter.toml"
    assert str(file) in started["command"] or f"ws/runs/{started['run']}/slope_limiter.toml" in started["command"]
    from dataclasses import replace

    truth = run(replace(load_scenario(file), seed=5, checks=())).truth
    columns = found["columns"]
    for name in ("position", "slip", "swing_angle", "contact_torque", "slope"):
        np.testing.assert_allclose(columns[name], truth[name][::10], rtol=1e-5, atol=1e-9, err_msg=name)
    turned = np.cumsum(truth["omega"]) * 1e-3
    np.testing.assert_allclose(columns["angle"], turned[::10], atol=0.01)
    assert found["run"]["complete"] is True
    assert found["words"]["state"]["4"] == "run"
    assert set(columns["state"]) >= {4.0}
    assert len(found["checks"]) == 8
    assert found["changes"] == ["duration 3 (shipped 25 s)", "path.2.slope 0.1 (shipped 14 deg)", "seed 5 (shipped 1)"]
    assert (found["settings"]["seed"], found["settings"]["ground"][1]["slope"]) == (5, 0.1)
    assert "run from" in found["course"]
    missed = [check["missed"] for check in found["checks"] if not check["passed"]]
    assert "ACTUATE.state == 'stuck' never holds" in missed
    assert any("expected" in one for one in missed)
    lines = server.get("/api/simulate")
    assert [one["seed"] for one in lines if one["name"] == started["run"]] == [5]


def test_cancelled_run_is_cut_short(server: Server) -> None:
    started = start(server, scenario="soft_sand", duration=3600.0, link="pty")
    for _ in range(2000):
        job = server.get(f"/api/jobs/{started['id']}")
        if job["state"] == "running" and server.files().get(f"runs/{started['run']}/telemetry.log", 0) > 10_000:
            break
    assert server.ask("DELETE", f"/api/simulate/{started['run']}").status == 409
    shorter = started["run"][:-1]
    (server.workspace / "runs" / shorter).mkdir()  # its name begins as that of the one that goes on
    assert server.ask("DELETE", f"/api/simulate/{shorter}").status == 200
    assert server.ask("DELETE", f"/api/jobs/{started['id']}").json["state"] == "cancelled"
    line = next(one for one in server.get("/api/simulate") if one["name"] == started["run"])
    assert (line["complete"], line["passed"]) == (False, None)
    found = server.get(f"/api/simulate/{started['run']}/signals")  # what there is of it can be looked at
    assert len(found["columns"]["time"]) > 5
    answer = server.ask("DELETE", f"/api/simulate/{started['run']}")
    assert answer.json == {"name": started["run"]}
    assert not (server.workspace / "runs" / started["run"]).exists()


def test_kept_as_a_case(server: Server) -> None:
    """One run: the scenario is run once more with the next seed, and the case opens in the workbench."""
    started = start(server, scenario="steady_sand")
    assert server.wait(started["id"])["state"] == "done"
    body = {"name": "kept_sand", "title": "Kept", "effects": ["speed_squared"]}
    answer = server.ask("POST", f"/api/simulate/{started['run']}/case", body)
    assert answer.status == 202, answer.body
    assert "--seed 2" in answer.json["command"]
    assert " && terrapin case " in answer.json["command"]
    job = server.wait(answer.json["id"])
    assert job["state"] == "done", job
    case = server.get("/api/cases/kept_sand")
    assert (case["title"], case["effects"], case["rows"] > 10) == ("Kept", ["speed_squared"], True)
    assert len(case["runs"]["train"]) + len(case["runs"]["test"]) == 2
    again = server.ask("POST", f"/api/simulate/{started['run']}/case", body)
    assert (again.status, "exists" in again.detail) == (409, True)


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ({"scenario": "none"}, 404, "found no"),
        ({"scenario": "../steady_sand"}, 422, "scenario"),
        ({"scenario": "steady_sand", "effects": {"nonsense": {}}}, 422, "no effect that the plant can take"),
        ({"scenario": "steady_sand", "effects": {"stribeck": {"a_s": 0.1, "omega_s": -1.0}}}, 422, "omega_s"),
        ({"scenario": "steady_sand", "faults": [{"kind": "stuck", "channel": "nose"}]}, 422, "channel"),
        ({"scenario": "steady_sand", "ground": [{"terrain": "lava"}]}, 422, "terrain"),
        ({"scenario": "steady_sand", "setpoints": [1e9]}, 422, "setpoint"),
        ({"scenario": "steady_sand", "duration": 1e9}, 422, "duration"),
        ({"scenario": "steady_sand", "link": "serial:/dev/ttyS0"}, 422, "link"),
        ({"scenario": "steady_sand", "out": "/tmp"}, 422, "out"),
    ],
)
def test_refused_and_nothing_written(server: Server, body: dict[str, Any], status: int, said: str) -> None:
    before = {name for name in server.files() if name.startswith("runs/")}
    answer = server.ask("POST", "/api/simulate", body)
    assert answer.status == status, answer.body
    assert said in answer.detail
    assert str(server.workspace) not in answer.detail
    assert {name for name in server.files() if name.startswith("runs/")} == before


def test_unknown_runs(server: Server) -> None:
    for method, path in (("GET", "none/signals"), ("DELETE", "none"), ("POST", "none/case")):
        body = {"name": "x_case"} if method == "POST" else None
        assert server.ask(method, f"/api/simulate/{path}", body).status == 404
    assert server.ask("GET", "/api/simulate/..%2f..%2fetc/signals").status in (404, 422)


def test_half_written_folders(tmp_path: Path) -> None:
    """A run that was killed within a row, one that never began, one that is no run."""
    run_toml = (
        '[run]\nscenario = "x"\ntitle = ""\nseed = 1\nduration = "1 s"\ncomplete = false\n[scenario]\ntext = ""\n'
    )
    for name, truth in (("killed", "time,position,omega,slope\n0,0,0,0\n0.01,0.1,1,0\n0.02,0.2"), ("empty", "time\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.toml").write_text(run_toml)
        (tmp_path / name / "truth.csv").write_text(truth)
    (tmp_path / "other").mkdir()
    assert run_signals(tmp_path / "killed")["columns"]["position"] == [0.0, 0.1]
    with pytest.raises(UserError, match="has not begun"):
        run_signals(tmp_path / "empty")
    with pytest.raises(UserError, match="expected a run's folder"):
        run_signals(tmp_path / "other")
    context: Any = SimpleNamespace(workspace=SimpleNamespace(folder={"runs": tmp_path}.__getitem__))
    assert {one.name for one in runs(context)} == {"killed", "empty"}
    assert tomllib.loads(run_toml)["run"]["complete"] is False


def test_what_never_began_is_swept_and_nothing_else(tmp_path: Path) -> None:
    for name, file in (("soft_sand-1", "soft_sand.toml"), ("soft_sand-2", "run.toml"), ("mine", "soft_sand.toml")):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).write_text("")
    (tmp_path / "x-3").mkdir()
    assert {path.name for path in tmp_path.iterdir() if _never_begun(path)} == {"soft_sand-1", "x-3"}


def test_ground_height_is_the_slope_integrated() -> None:
    x = np.linspace(0, 3, 301)
    shape = ground_height(x, np.where(x > 1, 0.2, 0.0))
    steep = np.gradient(shape["height"], shape["x"])
    assert np.interp(2.5, shape["x"], steep) == pytest.approx(np.tan(0.2), rel=1e-3)
    assert np.interp(0.5, shape["x"], shape["height"]) == pytest.approx(0.0, abs=1e-3)


def test_a_case_that_is_refused_leaves_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The held-out run's folder goes again when no more jobs are taken, and counts among the runs."""
    folder = tmp_path / "runs" / "x-1"
    folder.mkdir(parents=True)
    (folder / "run.toml").write_text('[run]\nscenario = "estop"\nseed = 1\nlink = "inprocess"\n')

    def full(*_: Any, **__: Any) -> Any:
        raise Taken("jobs: found 100 waiting, expected to wait for some of them")

    context: Any = SimpleNamespace(workspace=Workspace(tmp_path), jobs=SimpleNamespace(add=full), events=Events())
    keep = simulate_api.KeepCase(name="kept")
    with pytest.raises(Taken, match="jobs: "):
        asyncio.run(simulate_api.case(context, "x-1", keep))
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["x-1"]
    monkeypatch.setattr(simulate_api, "MOST_RUNS", 1)
    with pytest.raises(Taken, match="runs: found 1"):
        asyncio.run(simulate_api.case(context, "x-1", keep))
