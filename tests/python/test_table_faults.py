"""Columns that the table has wrong: named, put right by `add`, and never in the place of an effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import terrapin_tools as terrapin
from terrapin_hil.arrays import Array
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.case.changes import extended
from terrapin_tools.workbench.compare.refit import refit
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.discover.suspect_answers import _likeliest, _Looked
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.model.table_faults import faults
from terrapin_tools.workbench.story.story import Proposal
from terrapin_tools.workbench.story.told import told
from tests.campaigns.resumed import sure_and_wrong
from tests.campaigns.statements import KINDS, one

RUNS, ROWS, SIGMA = 14, 12, 0.004
DEGREE = np.pi / 180.0
CASE = """
[case]
title = "A wheel on a rig"
[model]
base = "rolling_steady"
[parameters]
radius = 0.08
drive_radius = 0.018
torque_constant = 0.1
load = 20.0
coulomb = 0.012
viscous = 0.004
[fit]
f_o = { value = 0.05, min = 0.0, max = 0.5 }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
omega = { column = "omega", unit = "rad/s" }   # of the shell
current = { column = "current", unit = "A", sigma = %g }
"""
Table = dict[str, Array]


def measured(seed: int) -> Table:
    """Speeds in both directions that swing within a run, and the current that belongs to them."""
    random = np.random.default_rng(seed)
    run = np.repeat(np.arange(RUNS), ROWS)
    way = np.where(np.arange(RUNS) % 2, -1.0, 1.0)[run]
    omega = way * (random.uniform(3.0, 10.0, RUNS)[run] + 1.5 * np.sin(0.9 * np.tile(np.arange(ROWS), RUNS) + run))
    torque = (0.06 * 0.08 * 20.0 + 0.012) * np.sign(omega) + 0.004 * omega
    current = torque * 0.018 / (0.08 * 0.1) + SIGMA * random.standard_normal(len(run))
    return {"run": run.astype(float), "omega": omega, "current": current}


def written(folder: Path, table: Table, sigma: float = SIGMA) -> Path:
    folder.mkdir()
    rows = [f"r{int(run):02d},{omega:.17g},{current:.17g}" for run, omega, current in zip(*table.values(), strict=True)]
    (folder / "runs.csv").write_text("\n".join(["run,omega,current", *rows]) + "\n")
    (folder / "case.toml").write_text(CASE % sigma)
    return folder


def late(table: Table, column: str) -> Table:
    """A column whose values come one row late; what stood before a run is not known, so its first value stays."""
    values = table[column].copy()
    same = table["run"][1:] == table["run"][:-1]
    values[1:][same] = table[column][:-1][same]
    return {**table, column: values}


def proposal(found: Discovery, name: str) -> Proposal:
    return next(card.proposal for card in told(found.analysis, found).cards if card.proposal.effect == name)


WRONG: Mapping[str, tuple[Any, float, str, dict[str, Any]]] = {
    "deg/s for rad/s": (lambda t: {**t, "omega": t["omega"] / DEGREE}, 1.0, "omega.scale", {"factor": DEGREE}),
    "1/min": (lambda t: {**t, "omega": t["omega"] / (6 * DEGREE)}, 1.0, "omega.scale", {"factor": 6 * DEGREE}),
    "mA for A": (lambda t: {**t, "current": t["current"] * 1e3}, 1e3, "current.scale", {"factor": 1e-3}),
    "unsigned speed": (lambda t: {**t, "omega": abs(t["omega"])}, 1.0, "omega.sign", {"sign_of": "current"}),
    "unsigned current": (lambda t: {**t, "current": abs(t["current"])}, 1.0, "current.sign", {"sign_of": "omega"}),
    "late speed": (lambda t: late(t, "omega"), 1.0, "omega.delay", {"delay": 1}),
    "late current": (lambda t: late(t, "current"), 1.0, "current.delay", {"delay": 1}),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_named_and_put_right(tmp_path: Path, what: str) -> None:
    """Named first, by what puts it right; with that in case.toml the model is adequate."""
    change, times, name, mend = WRONG[what]
    folder = written(tmp_path / "case", change(measured(3)), SIGMA * times)
    found = discover(load_case(folder))
    named = [found.missing, *found.rivals]
    assert (f"table.{name}",) in named, (found.verdict, named)
    one = proposal(found, f"table.{name}")
    assert one.kind == "table"
    assert one.mend == pytest.approx(mend) if "factor" in mend else one.mend == mend
    case = load_case(folder)
    text = extended(case.text, case.stated, [one.effect], {one.effect: one.own})
    assert "# of the shell" in text
    (folder / "case.toml").write_text(text)
    right = load_case(folder)
    assert any("as case.toml asks" in line for line in right.intake)
    again = discover(right)
    assert again.verdict == "adequate"


def test_factors_that_the_noise_hides_from_each_other_are_told_together(tmp_path: Path) -> None:
    """So loud that a speed in degrees and one in thousandths leave as little of what goes with the speed."""
    table = measured(3)
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(table["current"]))
    loud = {**table, "omega": table["omega"] / DEGREE, "current": table["current"] + noise}
    found = discover(load_case(written(tmp_path / "case", loud, 0.05)))
    named = {**found.ranking.expressions, **{one.effect.name: one.effect for one in found.candidates}}
    title = named["table.omega.scale"].title
    assert title == "omega is in degrees or is in thousandths"


@pytest.mark.parametrize(
    ("about", "watts"),
    [("is in metric horsepower (factor 735.5)", 735.49875), ("is in horsepower (factor 745.7)", 745.69987)],
)
def test_a_power_in_horsepower_is_told(about: str, watts: float) -> None:
    """A torque that is the power over the speed; the table says W of the power, which is in one of both horsepowers."""
    random = np.random.default_rng(3)
    run, speed = np.repeat(np.arange(12), 12), random.uniform(20.0, 120.0, 144)
    torque = random.uniform(3.0, 30.0, 144)
    shown = torque + 0.4 + 0.05 * random.standard_normal(144)
    case = terrapin.Case.from_table(
        {"run": run, "w": speed, "P": torque * speed / watts, "M": shown},
        run="run",
        units={"w": "rad/s", "P": "W", "M": "N m"},
        equation={"M": "P/w + c"},
        fit={"c": (0.1, -50.0, 50.0, "N m")},
    )
    answer = case.discover()
    assert list(answer.missing) == ["table.P.scale"]
    assert f"P {about}" in answer.headline


def test_a_speed_is_not_said_to_be_a_force(tmp_path: Path) -> None:
    """Where the noise hides the factor of kilograms of force from that of turns a minute, only the latter is told."""
    case = load_case(written(tmp_path / "case", measured(3)))
    scales = [one for one in faults(case) if one.name == "table.omega.scale"]
    turns = next(one for one in scales if "turns a minute" in one.title)
    force = next(one for one in scales if one.factor == pytest.approx(9.80665))
    assert force.title == "omega is wrong by a factor of 9.807"
    told_first = _likeliest([_Looked(force, -4.0, -np.inf, ""), _Looked(turns, -3.0, -np.inf, "")])
    assert told_first.fault.title == turns.title
    alone = _likeliest([_Looked(force, -4.0, -np.inf, "")])
    assert alone.fault.title == force.title


def test_a_sound_table_is_not_blamed(tmp_path: Path) -> None:
    """An effect that is missing keeps its name, and no fault is as likely."""
    for seed in range(3):
        table = measured(seed)
        hot = 0.02 * np.sin(0.3 * table["run"]) + 0.03 * np.sign(table["omega"]) * table["omega"] ** 2 / 30.0
        found = discover(load_case(written(tmp_path / f"case{seed}", {**table, "current": table["current"] + hot})))
        assert found.analysis.missing
        assert not any(name.startswith("table.") for answer in (found.missing, *found.rivals) for name in answer)


def test_what_the_record_shows(tmp_path: Path) -> None:
    """The prediction for a table with a fault is that of the sound table, written down wrongly."""
    case = load_case(written(tmp_path / "case", measured(1)))
    theta = np.array([0.06])
    sound = Model.of(case).bind(case.inputs).predict(theta)[0]
    by_name = {(f.name, f.sign_of, round(f.factor, 4)): f for f in faults(case)}

    def shown(of: Case, *key: Any) -> tuple[Array, Array]:
        bound = Model.of(of).having(by_name[key]).bind(of.inputs)
        prediction, slopes = bound.jacobian(theta)
        step = bound.predict(theta + 1e-6)
        np.testing.assert_allclose(slopes[0, :, 0], ((step - prediction) / 1e-6)[0], rtol=1e-5, atol=1e-6)
        return prediction[0], bound.predict(np.array([theta, theta]))[1, 0]

    for found in shown(case, "table.current.scale", "", 0.001):
        np.testing.assert_allclose(found, 1000.0 * sound)
    wrong = replace(case, roles={"omega": case.roles["omega"] * 180.0 / np.pi})
    for found in shown(wrong, "table.omega.scale", "", 0.0175):
        np.testing.assert_allclose(found, sound)
    for found in shown(case, "table.current.delay", "", 1.0):
        np.testing.assert_allclose(found[1:ROWS], sound[: ROWS - 1])
        np.testing.assert_allclose(found[ROWS], sound[ROWS])  # the first row of the next run


def test_a_column_is_read_as_case_toml_asks(tmp_path: Path) -> None:
    table = measured(2)
    folder = written(tmp_path / "case", table)
    text = (folder / "case.toml").read_text()

    def read(entry: str) -> Case:
        (folder / "case.toml").write_text(text.replace('unit = "rad/s"', f'unit = "rad/s", {entry}'))
        return load_case(folder)

    np.testing.assert_allclose(read("factor = -2.0").roles["omega"], -2.0 * table["omega"])
    np.testing.assert_allclose(
        read('sign_of = "current"').roles["omega"], abs(table["omega"]) * np.sign(table["current"])
    )
    moved = read("delay = 2")
    assert moved.rows == RUNS * (ROWS - 2)
    assert moved.rows_left_out == 2 * RUNS
    np.testing.assert_allclose(moved.roles["omega"][: ROWS - 2], table["omega"][2:ROWS])
    np.testing.assert_allclose(moved.channels["current"][: ROWS - 2], table["current"][: ROWS - 2])
    every = read('factor = -2.0, sign_of = "current", delay = 2')
    signed = abs(table["omega"][2:ROWS]) * np.sign(table["current"][: ROWS - 2])
    np.testing.assert_allclose(every.roles["omega"][: ROWS - 2], -2.0 * signed)
    for entry, expected in {
        "factor = 0": "found 0, expected a factor other than 0",
        'sign_of = "load"': "found 'load', expected one of current",
        "delay = 1.5": "found 1.5, expected a whole number of rows, 0 to 1000",
        "delay = 12": "every row has a gap",
    }.items():
        with pytest.raises(UserError, match=expected):
            read(entry)


def test_refits_beside_a_fault_and_a_name_without_an_answer(tmp_path: Path) -> None:
    table = measured(3)
    case = load_case(written(tmp_path / "case", {**table, "omega": table["omega"] * 30.0 / np.pi}))
    one = proposal(discover(case), "table.omega.scale")
    beside = (one.effect, "viscous_friction")
    fit = refit(case, np.array([SIGMA]), {one.effect: one.own}, beside)
    assert fit is not None
    assert tuple(effect.name for effect in fit.model.effects) == beside
    assert (
        refit(case, np.array([SIGMA]), {one.effect: one.own}, (one.effect, "motor_heating")) is None
    )  # no temperature
    fit = refit(case, np.array([SIGMA]), {one.effect: one.own}, (one.effect,))
    assert fit is not None
    assert float(np.sqrt(np.mean(fit.residual**2))) < 1.2
    with pytest.raises(UserError, match="expected what terrapin discover named last"):
        extended(case.text, case.stated, ["table.omega.scale"], {})


@pytest.mark.parametrize("kind", KINDS)
def test_campaign_of_wrong_statements(kind: str) -> None:
    """Five of a kind: most are named, none of the sound ones is blamed, none is sure and wrong."""
    records = [one("rolling_steady", kind, number, 3) for number in range(5)]
    assert not any(record["blamed"] for record in records)
    assert not any(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in records), records
    assert sum(record["right"] for record in records) >= 3, records


def test_a_scale_is_told_beside_the_effect_that_does_the_same() -> None:
    """A speed in another unit changes viscous friction only, here: both are told, and neither is sure."""
    record = one("rolling_steady", "scale", 41, 35)
    assert record["rivals"] == [["viscous_friction"], ["table.omega.scale"]], record
    assert record["right"]
    assert max(record["distances"]) < 1.0


def test_dry_friction_is_told_beside_a_stribeck_effect_so_wide_that_it_is_that() -> None:
    record = one("rolling_steady", "constant", 42, 35)
    assert record["truth"] == "constant.coulomb"
    assert record["rivals"] == [["stribeck"], ["coulomb_friction"]], record
    assert record["right"]
