"""The car on soft soil: one run of an independent implementation, convergence, balance, derivatives, refusals."""

from __future__ import annotations

import doctest
import time
from dataclasses import replace

import numpy as np
import pytest

from hil.physics import vehicle
from hil.physics.soils import Footing, library
from hil.physics.tyre import ContactError, Tyre
from hil.physics.vehicle import PERIOD, Run, Vehicle, profile_torque, simulate

NOMINAL = library()["lete_sand"].footing(0.235)
FITTED = library()["sand_vella"].footing(0.235)

# t, V, omega front and rear, F_x front and rear, M_y front and rear, sinkage front and rear: profile 0, step 2.5 ms
RUN_FITTED = [
    (0.5, 0.43461174, 4.7544029, 4.4419443, 1022.9383, 953.38712, 592.43444, 534.54214, 0.10237106, 0.097553343),
    (1.0, 1.7793784, 7.2412378, 5.4258128, 1116.3281, 1167.8021, 696.45275, 710.74149, 0.099724175, 0.098715695),
    (2.0, 4.4349962, 15.979424, 16.018586, 1211.4478, 1200.1061, 730.83439, 722.17582, 0.099365637, 0.098467656),
    (3.0, 6.6255208, 22.692079, 22.977347, 989.31165, 949.49591, 670.50923, 616.43221, 0.10160013, 0.096488278),
    (6.0, 13.328926, 36.848413, 37.602887, 170.26049, 173.65261, 411.7808, 320.63063, 0.11086016, 0.090651184),
    (8.0, 17.113513, 54.380103, 55.076119, 936.85975, 876.16945, 649.18628, 593.08537, 0.10280532, 0.09595216),
]
RUN_NOMINAL = [
    (0.5, 0.51300371, 4.6884394, 4.8849352, 1206.8202, 1129.6883, 586.02541, 540.28111, 0.06756226, 0.066592574),
    (3.0, 7.8525766, 28.136687, 28.502522, 1169.0844, 1158.464, 626.92956, 610.28115, 0.066918179, 0.0657499),
    (6.0, 15.944638, 46.816509, 47.25012, 470.42722, 404.98945, 397.4723, 328.72975, 0.071709035, 0.061611453),
    (8.0, 20.618243, 70.186691, 70.529899, 1145.5831, 1101.5973, 617.70626, 590.94646, 0.06751031, 0.065288913),
]


def drive(footing: Footing, substeps: int = 4, **options: bool) -> Run:
    return simulate(Vehicle(), Tyre(), footing, profile_torque(0), substeps=substeps, **options)


def test_examples() -> None:
    assert doctest.testmod(vehicle).failed == 0


@pytest.mark.parametrize(("footing", "rows"), [(FITTED, RUN_FITTED), (NOMINAL, RUN_NOMINAL)], ids=["fitted", "nominal"])
def test_run_meets_the_reference(footing: Footing, rows: list[tuple[float, ...]]) -> None:
    run = drive(footing)
    for t, *expected in rows:
        k = round(t / PERIOD)
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
    from hil.physics.tyre import solve

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
