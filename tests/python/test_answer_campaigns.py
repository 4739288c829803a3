"""Campaigns of rounds, of bodies that move and of the user's own equations: a case of each, and their tables."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terrapin_tools.workbench.compare.comparison import analyse, error, fitted_on
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.fitting import fit_model
from terrapin_tools.workbench.model.model import Model
from tests.campaigns import dynamic, later_rounds, noises, ode_systems, pools, statements, sure
from tests.campaigns.discovery_cases import make, without_noise
from tests.campaigns.drawn import write
from tests.campaigns.measured import Outcome
from tests.campaigns.resumed import Record, engine, keep, resumed
from tests.campaigns.ties import ADMISSIBLE, distances, is_tie, rivals


def test_a_car_whose_wheels_dig_in_at_the_start_values_is_fitted_from_others(tmp_path: Path) -> None:
    """At these start values, and at others inside the bounds, no soil carries a wheel at full throttle."""
    case, soft = dynamic.draw("vehicle", 2, 1, tmp_path / "case").case, {"k_s": 1e5, "friction_angle": 0.3}
    case = replace(case, fit={name: replace(one, value=soft[name]) for name, one in case.fit.items()})
    model = Model.of(case)
    with np.errstate(all="ignore"):
        assert not np.isfinite(model.bind(case.inputs).predict(model.start)).all()
    found = analyse(case, seed=2)
    assert np.isfinite(found.prediction).all()
    assert found.missing


@pytest.mark.parametrize("base", dynamic.BODIES)
def test_what_is_hidden_in_a_motion_shows_and_is_what_brings_the_model_to_the_noise(base: str, tmp_path: Path) -> None:
    drawn = dynamic.draw(base, 0, 3, tmp_path / "case")
    case, effect = drawn.case, drawn.effect
    assert case.effects == ()
    assert effect in dynamic.BODIES[base].effects
    sigma = np.array([case.sigma[c] or np.std(case.channels[c]) for c in Model.of(case).channels], dtype=np.float64)
    plain, larger = fitted_on(case, (effect,), case.train, sigma)
    before, after = (error(fit, case.train, sigma) for fit in (plain, larger))
    assert before is not None
    assert after is not None
    assert before > 1.1 * after
    again = dynamic.draw(base, 0, 3, tmp_path / "again").case
    assert all(np.array_equal(case.channels[c], again.channels[c]) for c in case.channels)
    channels = larger.model.channels
    true, scale = (np.array([known[c] for c in channels]) for known in (drawn.true, drawn.sigma))
    every = np.ones(case.rows, dtype=bool)
    without, with_it = (
        fit_model(fit.model.bind(case.inputs, every), true, scale, [fit.theta]).cost for fit in (plain, larger)
    )
    assert with_it < 0.1 < 100.0 < without  # what D2 is counted against, and in what


def test_a_tie_that_the_data_tell_apart_is_wrong() -> None:
    """Radius, gear and torque constant are one error on this rig; the friction that stands beside them is none."""
    found = statements.one("rolling_steady", "constant", 4, 35)
    told = dict(zip([tuple(names) for names in found["rivals"]], found["distances"], strict=True))
    assert found["truth"] == "constant.drive_radius"
    assert all(told[f"constant.{name}",] < 0.1 for name in ("drive_radius", "radius", "torque_constant"))
    assert told["viscous_friction",] > ADMISSIBLE
    assert (found["named"], found["right"]) == (True, False)
    assert statements.table([{"family": "constant", **found}]).splitlines()[1].endswith("     3.0")


def test_offsets_of_runs_hide_what_independent_noise_would_tell() -> None:
    """Drag and viscous friction are 8.7 noise sd apart if each row's noise is its own, 2.1 under that of the rig."""
    found = noises.one("rig", 181, 2.0, 30, 14)
    assert found["rivals"][:2] == [["aerodynamic_drag"], ["viscous_friction"]]  # 0.9 together may take a third
    assert found["distances"][1] < ADMISSIBLE < 50.0 < found["independent"][1]
    assert found["right"]


def test_distance_under_a_covariance() -> None:
    """Twice the sd is a quarter of the distance; what all rows have in common hides what is the same in all rows."""
    made = make("rolling_steady", ("aerodynamic_drag",), 14, 0.0, 3.0, np.random.default_rng(5))
    assert made is not None
    found = discover(made.case, seed=1)
    assert found.missing
    model, true = without_noise(made)
    true[0] += 3.0 * made.sigma[model.channels[0]] * np.cos(made.case.roles["omega"])  # what no told set gives
    sigma = np.array([made.sigma[c] for c in model.channels])
    given = (found, made.case.inputs, true, sigma)
    alone = [np.eye(true.shape[1])] * len(sigma)
    plain = distances(*given)
    assert plain[0] > 10.0
    assert distances(*given, alone) == pytest.approx(plain, abs=0.11)
    assert distances(*given, [4.0 * one for one in alone]) == pytest.approx(np.array(plain) / 4.0, abs=0.11)
    assert distances(*given, [one + 1.0 for one in alone])[0] < plain[0]


@pytest.mark.parametrize("family", noises.FAMILIES)
def test_noise_has_the_covariance_that_is_said(family: str) -> None:
    run, speed, random = np.repeat([0, 1, 2], 4), np.linspace(-2.0, 3.0, 12), np.random.default_rng(3)
    found, said, draws = np.zeros((12, 12)), np.zeros((12, 12)), 4000
    for _ in range(draws):
        values, covariance = noises.FAMILIES[family](run, speed, random)
        found += np.outer(values, values) / draws
        said += covariance / draws
    if family in ("outliers", "rig"):
        np.fill_diagonal(found, np.diag(said))  # outliers are not in it
    assert np.abs(found - said).mean() < 0.05


def test_what_a_tie_is() -> None:
    assert is_tie([400.0])  # one answer: its name says whether it is right
    assert is_tie([0.0, 8.9])
    assert not is_tie([0.0, 9.0])
    assert is_tie([629.0, 637.0], exact=False)  # no set gives the data: beyond the best of them
    assert not is_tie([629.0, 638.1], exact=False)
    assert rivals([{"distances": [0.0, 1.0, 2.0]}, {"distances": [0.0]}, {"distances": []}, {}]) == 1.0


def test_what_is_above_09_and_wrong() -> None:
    """A set that the data do not tell from the truth counts strictly only; names where nothing is missing always do."""
    said: Record = {"family": "rig", "verdict": "missing", "probability": 0.95, "right": False, "missing": ["slope"]}
    far, near = ({**said, "number": n, "truth": ["cogging"], "distances": [d]} for n, d in ((1, 9.0), (2, 8.9)))
    nothing = {**said, "number": 3, "truth": []}
    more = {**near, "missing": ["cogging", "slope"], "distances": [0.0]}
    assert sure.excused(near)
    assert not sure.excused(more)  # what holds the truth and more reaches it always
    unsure = {**said, "number": 4, "truth": ["cogging"], "probability": 0.9}
    shown = sure.table({"noises": [far, near, nothing, unsure], "dynamic": []})
    assert [line.split()[:3] for line in shown.splitlines()[1:3]] == [["noises", "4", "75.0"], ["all", "4", "75.0"]]
    assert shown.splitlines()[1].count("50.0 %") == 1
    assert shown.count("(admissible)") == 1
    small: Record = {**said, "family": "single12", "verdict": "adequate", "among": False, "hidden": 5.0}
    aside: Record = {**small, "hidden": 3.9}
    assert sure.judged("hidden", [small, aside]) == [(small, True)]
    assert sure.excused(small)


def test_rounds_of_a_drawn_case_end_and_the_error_falls() -> None:
    found = later_rounds.one("single30", 0, seed=2)
    assert found["problems"] == []
    assert 2 <= len(found["rounds"]) <= 6
    assert found["added"]
    assert not found["unlike"]
    shown = later_rounds.table([{"family": "single30", "number": 0, **found}])
    assert "single30       1             0     0.0 %" in shown


def test_a_crash_is_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(later_rounds, "rounds", fails)
    found = later_rounds.one("mixed", 0, seed=2)
    assert found["crashed"]
    assert "crash: boom" in later_rounds.table([{"family": "mixed", "number": 0, **found}])


def test_a_campaign_goes_on_after_a_kill_and_counts_one_engine_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.campaigns.resumed.COUNTED", tmp_path / "counted")
    out = tmp_path / "out" / "made_up"
    out.mkdir(parents=True)
    options = Namespace(campaign="made_up", part="1/1", families="a,b", cases=2, out=out)
    file = out / "s-1of1.jsonl"
    mine = {"family": "a", "number": 0, "setting": "s", "engine": engine(), "said": "kept"}
    file.write_text(f'{json.dumps(mine)}\n{json.dumps({**mine, "number": 1, "engine": "0ther"})}\n{{"family": "b", "nu')
    found = resumed(options, "s", lambda family, number: {"said": f"{family}{number}"})
    assert [record["said"] for record in found] == ["kept", "a1", "b0", "b1"]
    assert "1 lines of another engine" in capsys.readouterr().err
    assert resumed(options, "s", lambda *_: pytest.fail("made again")) == found
    assert len(file.read_text().splitlines()) == 6
    (tmp_path / "out" / "another").mkdir()
    (tmp_path / "out" / "another" / "x.jsonl").write_text('["no", "record"]\n')
    assert keep(tmp_path / "out") == {"made_up": 4}
    file.unlink()
    assert resumed(options, "s", lambda *_: pytest.fail("made again")) == found
    assert len(resumed(options, "other", lambda *_: {})) == 4
    assert keep(tmp_path / "out") == {"made_up": 8}


def answered(number: int, right: bool, probability: float) -> Record:
    return {
        "family": "lacking",
        "number": number,
        "system": "duffing" if right else "car, air drag",
        "noise": 0.01,
        "verdict": "missing",
        "probability": probability,
        "told": [["derivative.v: k*x**3"]],
        "likeliest": "derivative.v: k*x**3",
        "right": right,
        "seconds": 3.0,
    }


def test_the_table_of_equations_puts_the_worst_system_first() -> None:
    lines = ode_systems.table([answered(0, True, 0.95), answered(1, False, 0.95), answered(2, True, 0.95)]).split("\n")
    assert lines[1].split()[:4] == ["all", "3", "66.7", "%"]
    assert [line.split()[0] for line in lines[2:4]] == ["car,", "duffing"]
    assert "100.0 %" in lines[2].partition("0.0 %")[2]  # above 0.9 and wrong
    assert lines[4].strip() == "1 car, air drag, 0.01: missing 0.95  derivative.v: k*x**3"


def test_of_cases_of_somebody_else_what_is_added_falsely_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Either of two rivals may be added; what is neither is false. The case itself is not changed."""
    write(pools.make("single12", 2, 0)[1], tmp_path / "case-1")
    before = (tmp_path / "case-1" / "case.toml").read_bytes()
    said = {"case-1": {"kind": "ambiguous", "truth": ["inertia"], "rivals": [["inertia"], ["slope"]]}}
    (tmp_path / "answers.json").write_text(json.dumps(said), encoding="utf-8")
    for added, false in (("slope", []), ("cogging", ["cogging"])):

        def adds(folder: Path, found: Outcome, label: str, added: str = added) -> None:
            text = (folder / "case.toml").read_text(encoding="utf-8")
            (folder / "case.toml").write_text(text.replace("effects = []", f'effects = ["{added}"]'), encoding="utf-8")
            found.problems.append(f"{label}: the held-out error rose from 1 to 2")

        monkeypatch.setattr(later_rounds, "rounds", adds)
        (found,) = later_rounds.given(tmp_path)
        assert (found["added"], found["false"], found["rose"]) == ([added], false, True)
    assert (tmp_path / "case-1" / "case.toml").read_bytes() == before
