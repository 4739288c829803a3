"""Scenarios that the campaigns vary: made here rather than in files, since every seed has its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from terrapin_hil.physics.effects import catalogue
from terrapin_hil.robot.compiled_effects import ActiveEffect
from terrapin_hil.robot.plant import TERRAINS, Ground, Robot, Segment, Winding
from terrapin_hil.robot.sensors import Adc, kit
from terrapin_hil.scenario.scenario import Order, Scenario

TABLE_1 = ("sand", "dry_peat", "red_terrain", "agricultural")
FLOOR_LENGTH = 11.0  # m: the calibration must end on the floor
CALIBRATION = 14.0  # s until the operator drives on


def level(terrain: str, steps: list[tuple[float, float]], duration: float) -> Scenario:
    """Ideal sensors; calibrates on the floor, rolls onto the terrain at 6 V; `steps` are (time [s], voltage [V])."""
    orders = (Order(0.0, "calibrate"), Order(CALIBRATION, "run", "voltage", 6.0, limiter=False))
    orders += tuple(Order(time, "run", "voltage", volt, limiter=False) for time, volt in steps)
    return Scenario(
        name=f"level_{terrain}",
        duration=duration,
        ground=Ground((Segment(TERRAINS["hard_floor"]), Segment(TERRAINS[terrain], FLOOR_LENGTH))),
        operator=orders,
        sensors=kit("ideal"),
    )


def ordinary_current(sensor: Adc, draw: np.random.Generator) -> Adc:
    """A current measurement as an ordinary part errs: offset 2 LSB, INL a bow or an S, gain 0.5 % (sd each)."""
    return replace(
        sensor,
        offset=2.0 * draw.standard_normal(),
        inl=draw.choice([-1.0, 1.0]),
        inl_cycles=draw.choice([0.5, 1.0]),
        gain_error=0.005 * draw.standard_normal(),
    )


def ordinary_robot(seed: int) -> Scenario:
    """Calibrates on the floor, then rolls onto one of the four terrains; its parts err as ordinary parts do.

    Each error is drawn from a normal distribution whose sd is the size that the sensor budget states: current offset
    2 LSB, INL 1 LSB (a bow or an S, either sign), gain 0.5 %, A 10 %, B 20 %. K_t falls with the winding's temperature;
    that differs from 25 degC so that K_t changes by 2 % (sd) and is read with an error of 2 K (sd).
    """
    draw = np.random.default_rng([20061, seed])
    nominal, parts = Robot(), kit("real")
    coefficient = 0.001  # 1/K
    temperature = 25.0 + 20.0 * draw.standard_normal()
    current = ordinary_current(parts.current, draw)
    reading = replace(parts.temperature, offset=2.0 * draw.standard_normal() / parts.temperature.lsb, gain_error=0.0)
    robot = replace(
        nominal,
        coulomb=nominal.coulomb * (1.0 + 0.10 * draw.standard_normal()),
        viscous=nominal.viscous * (1.0 + 0.20 * draw.standard_normal()),
    )
    floor = replace(TERRAINS["hard_floor"], f_o=0.010 + 0.0005 * draw.standard_normal())
    terrain = TABLE_1[seed % 4]
    first, second = draw.uniform(3.0, 8.0, 2)
    return Scenario(
        name=f"ordinary_{seed}",
        duration=CALIBRATION + 16.0,
        seed=seed,
        robot=robot,
        ground=Ground((Segment(floor), Segment(TERRAINS[terrain], FLOOR_LENGTH))),
        operator=(
            Order(0.0, "calibrate"),
            Order(CALIBRATION, "run", "voltage", first, limiter=False),
            Order(CALIBRATION + 10.0, "run", "voltage", second, limiter=False),
        ),
        sensors=replace(parts, current=current, temperature=reading),
        winding=Winding(profile=((0.0, temperature), (1.0, temperature))),
        effects=(ActiveEffect(catalogue()["motor_heating"], {"a_t": coefficient}),),
        firmware={"comp_heating": coefficient},
    )
