"""The car on soft soil: one run of an independent implementation, convergence, balance, derivatives, refusals."""

from __future__ import annotations

import csv
import doctest
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.physics import vehicle
from terrapin_hil.physics.soils import Footing, library
from terrapin_hil.physics.tyre import ContactError, Tyre
from terrapin_hil.physics.vehicle import PERIOD, Run, Vehicle, profile_torque, simulate

NOMINAL = library()["lete_sand"].footing(0.235)
FITTED = library()["sand_vella"].footing(0.235)

# An independent implementation's run: torque profile 0, steps of 2.5 ms, two soils; SI.
REFERENCE = Path(__file__).parent / "data" / "vehicle_run.csv"


def drive(footing: Footing, substeps: int = 4, **options: bool) -> Run:
    return simulate(Vehicle(), Tyre(), footing, profile_torque(0), substeps=substeps, **options)


def test_examples() -> None:
    assert doctest.testmod(vehicle).failed == 0


@pytest.mark.parametrize(("soil", "footing"), [("fitted", FITTED), ("nominal", NOMINAL)])
def test_run_meets_the_reference(soil: str, footing: Footing) -> None:
    run = drive(footing)
    rows = [row for row in csv.DictReader(REFERENCE.read_text().splitlines()) if row["soil"] == soil]
    assert len(rows) == 17
    for row in rows:
        time, *expected = (float(value) for name, value in row.items() if name != "soil")
        k = round(time / PERIOD)
        found = [run.speed[k], *run.omega[k], *run.force[k], *run.torque[k], *run.sinkage[k]]
        assert found == pytest.approx(expected, rel=1e-6)


def test_step_errors_are_as_stated() -> None:
    fine = drive(FITTED, 32)
    error = np.abs(drive(FITTED).omega - fine.omega).max(axis=1)
    assert 0.25 < error[:100].max() < 0.32
    assert error[100:].max() < 0.07
    assert error[200:].max() < 0.021
    half = np.abs(drive(FITTED, 8).omega - fine.omega).max(axis=1)
    assert 1.6 < error[:100].max() / half[:100].max() < 2.6  # first order, by the clamps at standstill


def test_momentum_is_what_the_forces_give() -> None:
    run, car = drive(FITTED, 16), Vehicle()
    push = 2 * run.force.sum(axis=1) - car.drag * run.speed**2
    gained = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * PERIOD)]) / car.mass
    assert np.abs(gained - run.speed).max() < 2e-3


def test_wheel_loads_sum_to_the_weight() -> None:
    # With the print's Eq. 3 the loads sum to 2 m g, and at rest a wheel would sink as under twice the load.
    from terrapin_hil.physics.tyre import solve

    car = replace(Vehicle(), height=0.0)
    run = simulate(car, Tyre(), FITTED, np.zeros(3), period=1e-6)
    load = car.mass * car.gravity / 2 * np.array([car.rear_distance, car.front_distance]) / 2.57
    assert 2 * load.sum() == pytest.approx(1797 * 9.81)
    assert run.sinkage[-1] == pytest.approx(solve(Tyre(), FITTED, load, 0.0).sinkage, rel=1e-3)


def test_derivatives_are_those_of_the_run() -> None:
    run = drive(FITTED, sensitivities=True)
    assert run.omega_by_soil is not None
    for column, name in enumerate(Footing._fields):
        h = 1e-5 * FITTED[column]
        up, down = (drive(FITTED._replace(**{name: FITTED[column] + s * h})).omega for s in (1, -1))
        difference = (up - down) / (2 * h)
        scale = np.abs(difference).max()
        assert np.abs(run.omega_by_soil[:, :, column] - difference).max() < 3e-6 * scale
    assert (run.omega == drive(FITTED).omega).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: drive(FITTED, 1), r"step: found 0.01 s, expected at most 0.0092\d* s \(front wheel at 0 s"),
        (
            lambda: simulate(replace(Vehicle(), mass=80e3), Tyre(), FITTED, profile_torque(0)),
            r"load: found \d+ N, more than tyre or soil carries at any sinkage \(front wheel at 0 s",
        ),
        (lambda: simulate(Vehicle(), Tyre(), FITTED, [1.0]), "torque: found shape"),
        (lambda: simulate(Vehicle(), Tyre(), FITTED, [1.0, np.nan]), "torque: found nan at sample 1"),
        (
            lambda: simulate(Vehicle(), Tyre(), FITTED, [1.0, 2.0], period=0.0),
            "period: found 0 s, expected more than 0",
        ),
        (lambda: simulate(Vehicle(), Tyre(), FITTED._replace(stiffness=0.0), [1.0, 2.0]), "soil stiffness: found 0"),
        (lambda: Vehicle(mass=-1.0), "vehicle mass: found -1, expected more than 0"),
    ],
)
def test_a_value_out_of_range_is_named(call: object, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        call()


def test_braking_to_a_stop_and_starting_again() -> None:
    # A torque that jumps makes the wheels swing through standstill, where the braking slip has its limit.
    torque = np.repeat([0.0, 700.0, -400.0, 600.0], [10, 290, 100, 401])
    run = simulate(Vehicle(), Tyre(), FITTED, torque, sensitivities=True)
    assert run.omega_by_soil is not None
    assert np.isfinite(run.omega_by_soil).all()
    assert (run.speed >= 0).all()
    assert (run.omega >= 0).all()
    assert run.speed[300] > 5
    assert run.speed[400] < 0.5 * run.speed[300]
    assert run.speed[800] > run.speed[400] + 5


def test_a_fast_car_needs_shorter_steps() -> None:
    with pytest.raises(ContactError, match=r"step: found 0.009 s, expected at most 0.008\d* s \(.* wheel at \d"):
        simulate(Vehicle(), Tyre(), FITTED, np.full(1200, 900.0), period=0.009, substeps=1)


def test_an_eight_second_run_takes_60_ms() -> None:
    torque = profile_torque(0)
    spent = []
    for _ in range(8):
        begin = time.thread_time()  # of this thread alone: others may use the machine
        simulate(Vehicle(), Tyre(), FITTED, torque)
        spent.append(time.thread_time() - begin)
    assert min(spent) < 0.060
