"""The bounds of "the circle, end to end", measured: `python -m tests.campaigns.must_hold` prints a row for each.

A short form of every campaign runs in tests/python/test_must_hold.py.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from terrapin_hil import paths
from terrapin_hil.links.wire import SlcanLink
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.campaigns.scenarios import TABLE_1, level, ordinary_robot

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """One bound. `met` is the comparison of `value` with it."""

    what: str
    value: float
    bound: float
    unit: str
    at_least: bool = False

    @property
    def met(self) -> bool:
        return self.value >= self.bound if self.at_least else self.value <= self.bound

    def __str__(self) -> str:
        sign = ">=" if self.at_least else "<="
        return (
            f"{'met    ' if self.met else 'NOT MET'} {self.what}: {self.value:.4g} {self.unit} ({sign} {self.bound:g})"
        )


WINDOW = 0.3  # s, of the estimator


def ground_errors(result: Result) -> tuple[Array, Array, Array]:
    """(time [s], error of C_t [N m], stated sd [N m]) of every valid GROUND whose window lies on the second terrain.

    The truth is the contact torque on the shell at the tick that closed the frame's window, as its stated age has it.
    The time is that of the frame.
    """
    ground = result.telemetry["GROUND"]
    on_terrain = result.truth["segment"] == 1
    crossing = result.time[np.argmax(on_terrain)] if np.any(on_terrain) else np.inf
    age = next(c["value"] for c in result.interface.json["constants"] if c["name"] == "ground_age") * 1e-3
    closed = ground["time"] - age
    use = (ground["valid"] > 0) & (closed >= crossing + WINDOW)
    ticks = np.round(closed[use] * 1000).astype(int)
    return ground["time"][use], ground["torque"][use] - result.truth["contact_torque"][ticks], ground["torque_sd"][use]


def steady_ideal(voltages: tuple[float, ...]) -> list[Row]:
    """Four terrains after a calibration; a step to each voltage, then one of 1 V and back."""
    errors, sds, waits = [0.0], [0.0], []
    for terrain in TABLE_1:
        for volt in voltages:
            other = volt + 1.0 if volt < 8.0 else volt - 1.0
            steps = [(20.0, volt), (29.0, other), (38.0, volt)]
            time, error, sd = ground_errors(run(level(terrain, steps, 47.0)))
            errors.append(float(np.max(np.abs(error), initial=0.0)))
            sds.append(float(np.max(sd, initial=0.0)))
            for at, _ in steps:
                after = time[(time >= at + WINDOW) & (time < at + 9.0)]
                waits.append(float(after[0]) - at if len(after) else np.inf)
    return [
        Row("C_t at steady state, ideal sensors: greatest error", 1e3 * max(errors), 0.5, "mN m"),
        Row("C_t at steady state, ideal sensors: greatest stated sd", 1e3 * max(sds), 2.0, "mN m"),
        Row("C_t, ideal sensors: longest wait for a valid value after a voltage step", max(waits), 4.5, "s"),
    ]


def steady_real(seeds: int) -> list[Row]:
    """Robots with ordinary parts, after their calibration on the floor; one without a valid value counts as wrong."""
    errors, sds, ratios = [], [], []
    for seed in range(seeds):
        _, error, sd = ground_errors(run(ordinary_robot(seed)))
        errors.append(float(np.max(np.abs(error))) if len(error) else np.inf)
        sds.append(float(np.max(sd, initial=0.0)))
        ratios.append(float(np.max(np.abs(error) / sd)) if len(error) else np.inf)
    what = f"C_t, real sensors, {seeds} seeds"
    return [
        Row(f"{what}: 95th percentile of the greatest error", 1e3 * float(np.quantile(errors, 0.95)), 5.0, "mN m"),
        Row(f"{what}: greatest stated sd", 1e3 * max(sds), 5.0, "mN m"),
        Row(f"{what}: greatest error over stated sd while valid", max(ratios), 4.0, "1"),
    ]


def carriage() -> list[Row]:
    """The axle's speed is imposed, falling from 0.36 to 0.04 m/s in 10 s; 8 V, sand. Times count from the fall on."""
    limited, free = (run(load_scenario(find_scenario(name))) for name in ("carriage_limiter", "carriage_free"))
    fall = limited.time >= limited.scenario.carriage[-2][0]
    slip = limited.truth["slip"][fall]
    late = slip[5000:]
    return [
        Row("limiter on the carriage: greatest slip", float(np.max(slip)), 0.55, "1"),
        Row("limiter on the carriage: farthest from 0.5, from 5 s on", float(np.max(np.abs(late - 0.5))), 0.02, "1"),
        Row(
            "carriage without limiter: greatest slip", float(np.max(free.truth["slip"][fall])), 0.9, "1", at_least=True
        ),
    ]


def slope() -> list[Row]:
    """A free slope of 14 degrees, 8 V, sand."""
    limited, free = (run(load_scenario(find_scenario(name))) for name in ("slope_limiter", "slope_free"))
    states = limited.interface.enums["state"]
    reports = limited.interface.enums["report"]
    status = limited.telemetry["STATUS"]
    ending = free.time >= free.time[-1] - 2.0
    return [
        Row("slope with limiter: speed at the end", float(np.max(np.abs(limited.truth["speed"][-500:]))), 1e-3, "m/s"),
        Row(
            "slope with limiter: reported as extricated",
            float(np.any(status["report"] == reports["extricated"])),
            1.0,
            "1",
            at_least=True,
        ),
        Row(
            "slope with limiter: idle and ready at the end",
            float(status["ready"][-1] == 1 and status["state"][-1] == states["idle"]),
            1.0,
            "1",
            at_least=True,
        ),
        Row(
            "slope with limiter: slope under the shell at the end", float(abs(limited.truth["slope"][-1])), 1e-3, "rad"
        ),
        Row("slope without limiter: greatest slip", float(np.max(free.truth["slip"])), 0.9, "1", at_least=True),
        Row(
            "slope without limiter: stuck, greatest speed in the last 2 s",
            float(np.max(np.abs(free.truth["speed"][ending]))),
            0.01,
            "m/s",
        ),
    ]


def build(presets: tuple[str, ...]) -> tuple[str, ...]:
    """Builds what is not yet built of them."""
    subprocess.run([paths.ROOT / "tests" / "tools" / "build.sh", *presets], check=True)
    return presets


def determinism(seeds: int, presets: tuple[str, ...] = ()) -> list[Row]:
    """Seeds whose output hashes differ between a run in this process, a repeat, and ptys to controllers of the host
    build and of other `presets` (which must be built: tests/tools/build.sh PRESET)."""
    different = 0
    for seed in range(seeds):
        scenario = replace(ordinary_robot(seed), duration=3.0)
        hashes = {run(scenario, link).output_hash for link in ("inprocess", "inprocess", "pty")}
        for preset in presets:
            with SlcanLink.of_process(paths.ROOT / "build" / preset / "terrapin-controller") as other:
                hashes.add(run(scenario, other).output_hash)
        different += len(hashes) != 1
    where = ", ".join(("in process", "a repeat", "pty", *(f"{preset} on a pty" for preset in presets)))
    return [Row(f"seeds of {seeds} whose hashes differ between {where}", different, 0, "1")]


def differing(preset: str, seconds: float | None = None) -> list[str]:
    """Shipped scenarios (their first `seconds`) in which some tick's answer of another build is not the host's."""
    found = []
    program = paths.ROOT / "build" / preset / "terrapin-controller"
    for path in sorted(paths.SCENARIOS.glob("*.toml")):
        scenario = replace(load_scenario(path), checks=(), provokes=None)
        scenario = replace(scenario, duration=min(scenario.duration, seconds or scenario.duration))
        with SlcanLink.of_process(program) as other:
            if run(scenario, other).output_hash != run(scenario).output_hash:
                found.append(path.stem)
    return found


def builds(presets: tuple[str, ...]) -> list[Row]:
    """Whole scenarios on other builds of the controller; tests/target/test_step.py has the Cortex-M4."""
    return [
        Row(f"scenarios in which the build {one} answers another tick", len(differing(one)), 0, "1") for one in presets
    ]


CAMPAIGNS: dict[str, Callable[[], list[Row]]] = {
    "steady_ideal": lambda: steady_ideal((2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)),
    "steady_real": lambda: steady_real(200),
    "carriage": carriage,
    "slope": slope,
    "determinism": lambda: determinism(20, build(("coverage", "m32"))),
    "builds": lambda: builds(build(("coverage", "m32", "asan"))),
}


def main() -> int:
    parser = argparse.ArgumentParser(
        description="The bounds of the circle, measured; exit status 1 when one is not met.",
        epilog="Example: python -m tests.campaigns.must_hold slope builds",
    )
    parser.add_argument("campaign", nargs="*", metavar="CAMPAIGN", help=f"of {', '.join(CAMPAIGNS)}; all by default")
    chosen = parser.parse_args().campaign or list(CAMPAIGNS)
    if unknown := [name for name in chosen if name not in CAMPAIGNS]:
        parser.error(f"{unknown[0]}: no campaign; there are {', '.join(CAMPAIGNS)}")
    failed = 0
    for name in chosen:
        for row in CAMPAIGNS[name]():
            print(row, flush=True)
            failed += not row.met
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
