"""C_t of the sphere of 150 N wherever it rolls steadily: `python -m tests.campaigns.sphere [SEEDS]` prints the bounds.

Without seeds (0) it prints only the estimator's own error on slopes: parts without an error of their own.

Steady states are those of tests/python/data/sphere_robot.csv up to a load of 10 N; each seed is one of them, in turn,
with parts that err as ordinary ones do, once with the friction of sphere.toml taken as it is, and once with that which
the robot found on a hard floor before. The voltage rises in 20 s, and counts from 40 s on.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from terrapin_hil.physics.effects import catalogue
from terrapin_hil.robot.compiled_effects import ActiveEffect
from terrapin_hil.robot.plant import TERRAINS, Ground, Segment
from terrapin_hil.robot.sensors import kit
from terrapin_hil.robots import select
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Order, Scenario, find_scenario, load_scenario
from tests.campaigns.must_hold import Row
from tests.campaigns.scenarios import ordinary_current

STATES = Path(__file__).parents[1] / "python" / "data" / "sphere_robot.csv"
RAMP, STEPS, SETTLED, DURATION = 20.0, 50, 40.0, 60.0  # s; orders; s; s
PERIOD = 1440  # ticks, of the swing: windows that share no sample


def states() -> list[dict[str, str]]:
    """Rows of the reference with a load up to 10 N."""
    with STATES.open(encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["kind"] == "steady" and float(row["tow_N"]) <= 10.0]


def ordinary_sphere(seed: int, state: dict[str, str]) -> Scenario:
    """The sphere in a steady state; errors drawn as in scenarios.ordinary_robot, friction as sphere.toml has it."""
    draw = np.random.default_rng([2024, seed])
    base, parts = load_scenario(find_scenario("level")), kit("real")
    current = ordinary_current(parts.current, draw)
    robot = replace(
        base.robot,
        coulomb=base.robot.coulomb + 0.060 * draw.standard_normal(),
        viscous=base.robot.viscous + 0.010 * draw.standard_normal(),
        torque_constant=base.robot.torque_constant * (1.0 + 0.004 * draw.standard_normal()),
    )
    law, voltage, tow = state["law"], float(state["voltage_V"]), float(state["tow_N"])
    pushed = ActiveEffect(catalogue()["bulldozing"], {"scale": 1.0})
    slipping = ActiveEffect(catalogue()["slip_sinkage"], {"xi1": 2.0, "xi2": 0.45, "xi3": 2.0})
    effects = {"T1": (), "T2": (pushed, slipping), "C": (pushed,)}[law]
    slope = math.radians(float(state["slope_deg"]))
    segments = tuple(replace(segment, slope=slope) for segment in base.ground.segments)
    ground = replace(base.ground, segments=segments, slip_depth=7e-3 if law == "C" else 0.0)
    return replace(
        base,
        name=f"ordinary_sphere_{seed}",
        duration=DURATION,
        seed=seed,
        robot=robot,
        ground=ground,
        effects=effects,
        sensors=replace(parts, current=current),
        operator=tuple(
            Order(0.5 + k * RAMP / STEPS, "run", "voltage", voltage * (k + 1) / STEPS, limiter=False)
            for k in range(STEPS)
        ),
        tow=((0.0, tow),) if tow else (),
        checks=(),
    )


def calibrated(scenario: Scenario) -> Scenario:
    """The same with the friction that the robot's calibration found on a hard floor of f_o = 0.01 (sd 0.0005)."""
    draw = np.random.default_rng([2025, scenario.seed])
    floor = replace(TERRAINS["hard_floor"], f_o=0.010 + 0.0005 * draw.standard_normal())
    order = (Order(0.5, "calibrate"),)
    level = replace(scenario, duration=90.0, ground=Ground((Segment(floor),)), effects=(), tow=(), operator=order)
    result = run(level)
    found = {name: float(result.held("CALIBRATION", name)[-1]) for name in ("coulomb", "viscous", "calibrated")}
    return replace(scenario, firmware={**scenario.firmware, **found})


def contact_torque(
    seeds: int, calibrate: bool, drawn: Callable[[int, dict[str, str]], Scenario] = ordinary_sphere
) -> tuple[list[Row], list[str]]:
    """The bounds, and the steady states in which the guard ended the run."""
    errors: list[float] = []
    ratios: list[float] = []
    valid: list[float] = []
    guarded: list[str] = []
    rows = states()
    for seed in range(seeds):
        state = rows[seed % len(rows)]
        scenario = drawn(seed, state)
        result = run(calibrated(scenario) if calibrate else scenario)
        if result.held("ACTUATE", "enable")[-1] == 0:
            guarded.append(f"{state['law']}, {state['voltage_V']} V, {state['slope_deg']} deg, {state['tow_N']} N")
            continue
        late = slice(round(1000 * SETTLED), None)
        good = result.held("GROUND", "valid")[late] == 1
        valid.append(float(good.mean()))
        error = (result.held("GROUND", "torque") - result.truth["contact_torque"])[late][::PERIOD][good[::PERIOD]]
        errors += error.tolist()
        ratios += (error / result.held("GROUND", "torque_sd")[late][::PERIOD][good[::PERIOD]]).tolist()
    z = np.array(ratios)
    how = "calibrated" if calibrate else "not calibrated"
    what = f"sphere of 150 N, {how}, {seeds} seeds, {len(guarded)} of them stopped by the guard"
    return [
        Row(f"{what}: C_t error, 95th percentile", float(np.percentile(np.abs(errors), 95)), 0.15, "N m"),
        Row(f"{what}: bias", abs(float(np.mean(errors))), 0.45, "N m"),  # 1.5 % of full scale
        Row(f"{what}: sd of the error", float(np.std(errors)), 0.15, "N m"),
        Row(f"{what}: mean of (error / stated sd)^2, at most", float((z * z).mean()), 2.0, "1"),
        Row(f"{what}: mean of (error / stated sd)^2, at least", float((z * z).mean()), 0.25, "1", at_least=True),
        Row(f"{what}: beyond 3 stated sd", float((np.abs(z) > 3.0).mean()), 0.01, "1"),
        Row(f"{what}: valid share of the steady time", float(np.mean(valid)), 0.90, "1", at_least=True),
    ], guarded


def own_error(slope: int) -> str:
    """Error of C_t on a slope [deg] with a robot as its file says and ideal sensors, windows from 2 s of rolling on.

    While the voltage rises the bob still swings, with another period than the window where the ground is not level.
    """
    errors: list[float] = []
    settled: list[float] = []
    rows = [state for state in states() if float(state["slope_deg"]) == slope]
    stopped = 0
    for seed, state in enumerate(rows):
        drawn = ordinary_sphere(seed, state)
        result = run(replace(drawn, robot=load_scenario(find_scenario("level")).robot, sensors=kit("ideal")))
        if result.held("ACTUATE", "enable")[-1] == 0:
            stopped += 1
            continue
        sums = np.concatenate(([0.0], np.cumsum(result.truth["contact_torque"])))
        ends = np.arange(2 * PERIOD, len(sums), PERIOD)
        good = result.held("GROUND", "valid")[ends - 1] == 1
        error = result.held("GROUND", "torque")[ends - 1] - (sums[ends] - sums[ends - PERIOD]) / PERIOD
        errors += error[good].tolist()
        settled += error[good & (ends > 1000 * SETTLED)].tolist()
    mean, largest, steady = (1e3 * float(value) for value in (np.mean(errors), np.abs(errors).max(), np.mean(settled)))
    return (
        f"C_t on {slope:+d} degrees, {len(rows) - stopped} states, exact parts: bias {steady:+.1f} mN m steady, "
        f"{mean:+.1f} mN m over all valid windows, at most {largest:.1f} mN m"
    )


def main() -> int:
    """Prints the bounds; 1 when one is not met by the calibrated robot."""
    select("sphere")
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for slope in (-5, 0, 6):
        print(own_error(slope), flush=True)
    if not seeds:
        return 0
    for calibrate in (False, True):
        rows, guarded = contact_torque(seeds, calibrate)
        for row in rows:
            print(row, flush=True)
    for state in sorted(set(guarded)):
        print(f"the guard stops: {state}")
    return 0 if all(row.met for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
