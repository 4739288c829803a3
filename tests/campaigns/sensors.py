"""What one broken sensor makes the robot do: `python -m tests.campaigns.sensors` makes the table of docs/sensors.md.

    python -m tests.campaigns.sensors                    every shipped robot; status 1 where a bound is missed
    python -m tests.campaigns.sensors --robots cylinder
    python -m tests.campaigns.sensors --planted          the same without the firmware's checks: it must fail
    python -m tests.campaigns.sensors --renew            writes the table into docs/sensors.md

Each channel fails in each way, on each ground, while the robot is at work; the same run with a sound sensor is its
measure. A short form runs in tests/python/test_sensor_failures.py.

Motion that nobody asked for [m], with the bridge on: back against the setpoint, beyond what the sound run does; or
ahead of where the sound run is by then, with the slip limiter or without. What a robot rolls on a slope with its bridge
off is told beside it: it is gravity's (docs/safety.md, "Rolling away with the bridge off").
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrapin_hil.firmware import Firmware
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.robot.plant import TERRAINS, Ground, Segment
from terrapin_hil.robot.sensors import ADCS, CHANNELS, DIGITALS, ENCODERS, kit
from terrapin_hil.robots import select, selected
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.faults import Fault
from terrapin_hil.scenario.scenario import Order, Scenario
from tests.campaigns.sensor_reasons import REASONS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "sensors.md"
BEGIN, END = "<!-- begin of the {} -->\n", "<!-- end of the {} -->\n"
ROBOTS = ("cylinder", "roller", "sphere")
WAYS = ("stuck", "zero", "full scale", "drift", "dropout", "sign", "scale 2", "delay", "noise", "intermittent")
SITUATIONS = ("floor", "sand", "slope", "limiter", "extrication")
AFTER, STOP = 6.0, 3.0  # s that the operator drives on after the failure, and waits after its IDLE
NAMED = 0.5  # s
# ten times what the real kit has, raw: codes, counts (of rounding), steps of the resolution
NOISE = {"motor": 3.0, "wheel": 3.0, "swing_angle": 20.0, "swing_rate": 20.0, "pitch": 20.0, "ground_speed": 50.0}
DRIFT = {"motor": 2000.0, "wheel": 2000.0, "swing_angle": 100.0, "swing_rate": 50.0, "pitch": 50.0}  # raw a second
# what stands between a stuck wheel and the motor: taken out one by one, and all at once, the sweep must fail
CHECKS = (
    ("slip.c", "(size > state->rates.jump_counts)", "(size > 0x10000U)"),
    ("extrication.c", "if (!s->borne_out) {", "s->borne_out = true;\n    if (!s->borne_out) {"),
    ("extrication.c", "s->borne_out = !far_enough(state);", ""),
)


@dataclass(frozen=True)
class Outcome:
    """A failure: `unasked` motion with the bridge on, `rolled` with it off [m]; its faults, and when they came [s]."""

    robot: str
    situation: str
    channel: str
    way: str
    unasked: float
    rolled: float
    faults: tuple[str, ...]
    after: float  # inf: none
    ended: str  # the controller's state before the operator's IDLE

    @property
    def named(self) -> bool:
        return self.after <= NAMED


def failures(channel: str, way: str, at: float) -> tuple[Fault, ...]:
    """What `way` is for the channel, from `at` [s] on."""

    def fault(kind: str, value: float = 0.0, end: float = 1e9) -> tuple[Fault, ...]:
        return (Fault(kind, channel, value, at, end),)

    full = 4095.0 if channel in ADCS else 65535.0 if channel in ENCODERS else getattr(kit("real"), channel).largest
    if way == "dropout":  # for a second
        if channel in DIGITALS:
            return fault("absent", end=at + 1.0)
        return fault("forced", 0.0, at + 1.0) if channel in ADCS else fault("lost_counts", 1.0, at + 1.0)
    return {
        "stuck": lambda: fault("stuck"),
        "zero": lambda: fault("forced", 0.0),
        "full scale": lambda: fault("forced", full),
        "drift": lambda: fault("drift", DRIFT.get(channel, 100.0)),
        "sign": lambda: fault("reversed" if channel in ENCODERS else "mirrored"),
        "scale 2": lambda: fault("scaled", 2.0),
        "delay": lambda: fault("delayed", 0.2),
        "noise": lambda: fault("noisy", NOISE.get(channel, 10.0)),
        "intermittent": lambda: fault("intermittent", 0.1),
    }[way]()


def situation(name: str, seed: int = 1) -> Scenario:
    """The robot of this process at work there, without its operator's IDLE; sensors as ordinary parts are."""
    degree = np.pi / 180.0
    floor, sand, firm = TERRAINS["hard_floor"], TERRAINS["sand"], TERRAINS["red_terrain"]
    bob = selected().name == "sphere"  # a step of the voltage throws its bob over
    control, setpoint = ("speed", 0.4) if bob else ("voltage", 8.0)
    far = 1.5 if not bob else 2.5
    ground = {
        "floor": (Segment(floor),),
        "sand": (Segment(sand),),
        "slope": (Segment(firm), Segment(firm, 0.5, 5.0 * degree, 0.3)),
        "limiter": (Segment(sand),),
        "extrication": (Segment(sand), Segment(sand, far, 14.0 * degree, 0.3)),
    }[name]
    if name == "floor" and not bob:
        control, setpoint = "speed", 0.5
    slow = 0.1 if bob else 0.25  # m/s: a carriage holds the axle there, the motor would have the shell turn faster
    carriage = ((0.0, 0.0), (2.0, slow), (60.0, slow)) if name == "limiter" else ()
    return Scenario(
        name=name,
        duration=14.0,
        ground=Ground(ground),
        operator=(Order(0.0, "run", control, setpoint),),
        seed=seed,
        sensors=kit("real"),
        carriage=carriage,
    )


def _state(result: Result) -> npt.NDArray[np.float64]:
    return np.nan_to_num(result.held("ACTUATE", "state"))


def _onset(name: str, sound: Result) -> float:
    """When the sensor fails [s]: in steady motion; while the limiter acts; or a moment after backing out began."""
    states = sound.interface.enums["state"]
    wanted = {"limiter": "limiting", "extrication": "extricate"}.get(name)
    if wanted is None:
        return 5.0
    seen = np.flatnonzero((_state(sound) == states[wanted]) & (sound.time > 3.0))
    if len(seen) == 0:
        raise SystemExit(f"{selected().name}, {name}: the sound run never comes to {wanted}")
    return float(sound.time[seen[0]]) + 0.2


@dataclass(frozen=True)
class Measure:
    """Sound runs of a situation, until the failure and beyond."""

    scenario: Scenario
    onset: float
    sound: Result
    free: Result  # without the slip limiter


def _start(scenario: Scenario, firmware: Firmware | None) -> Result:
    return run(scenario, InProcess(firmware) if firmware else "inprocess")


@cache
def measure(name: str, channel: str = "", seed: int = 1, firmware: Firmware | None = None) -> Measure:
    """`channel`: ground_speed, which no shipped robot has, is there when it is to fail."""
    scenario = situation(name, seed)
    if channel == "ground_speed":
        seen = replace(scenario.sensors.ground_speed, present=True)
        scenario = replace(scenario, sensors=replace(scenario.sensors, ground_speed=seen))
    onset = _onset(name, _start(scenario, firmware))
    order = scenario.operator[0]
    idle = Order(round(onset + AFTER, 3), "idle")
    scenario = replace(scenario, duration=round(onset + AFTER + STOP, 3), operator=(order, idle))
    free = replace(scenario, operator=(replace(order, limiter=False), idle))
    return Measure(scenario, onset, _start(scenario, firmware), _start(free, firmware))


def _way(result: Result) -> npt.NDArray[np.float64]:
    """Of the axle, or where a carriage has that, of the shell's rim [m]."""
    if result.scenario.carriage:
        return np.asarray(np.cumsum(result.truth["omega"]) * 1e-3 * selected().plant["radius"])
    return result.truth["position"]


def _fallen(way: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """How far behind its foremost point it has been, at most until then [m]."""
    return np.maximum.accumulate(np.maximum.accumulate(way) - way)


def fail(name: str, channel: str, way: str, seed: int = 1, firmware: Firmware | None = None) -> Outcome:
    """One channel fails in one way."""
    base = measure(name, channel if channel == "ground_speed" else "", seed, firmware)
    result = _start(replace(base.scenario, faults=failures(channel, way, base.onset)), firmware)
    begin = round(base.onset * 1000)
    truth, sound, free = (_way(r)[begin:] for r in (result, base.sound, base.free))
    on = np.nan_to_num(result.held("ACTUATE", "enable"))[begin:] > 0
    driven = truth[0] + np.concatenate([[0.0], np.cumsum(np.diff(truth) * on[:-1])])
    allowed = np.maximum(_fallen(sound), _fallen(free))
    back = float(np.max(_fallen(driven) - allowed, initial=0.0))
    ahead = float(np.max(driven - np.maximum.accumulate(np.maximum(sound, free)), initial=0.0))
    off = truth[0] + np.concatenate([[0.0], np.cumsum(np.diff(truth) * ~on[:-1])])
    rolled = float(np.max(_fallen(off) - allowed, initial=0.0))
    bits = [np.nan_to_num(r.held("STATUS", "faults")).astype(np.int64)[begin:] for r in (result, base.sound)]
    new = bits[0] & ~bits[1]
    when = np.flatnonzero(new)
    every = int(np.bitwise_or.reduce(new))
    names = tuple(f["name"] for f in result.interface.json["faults"] if every >> f["number"] & 1)
    states = {number: word for word, number in result.interface.enums["state"].items()}
    ended = states[int(_state(result)[begin + round(AFTER * 1000) - 1])]
    after = float(when[0]) * 1e-3 if len(when) else np.inf
    return Outcome(selected().name, name, channel, way, max(back, ahead), rolled, names, after, ended)


def bound() -> float:
    """One turn of the shell [m]."""
    return float(2.0 * np.pi * selected().plant["radius"])


def sweep(firmware: Firmware | None = None) -> Iterator[Outcome]:
    """Every failure, of the robot of this process."""
    for name in SITUATIONS:
        for channel in CHANNELS:
            for way in WAYS:
                yield fail(name, channel, way, firmware=firmware)


def planted(folder: Path, checks: tuple[tuple[str, str, str], ...] = CHECKS) -> Firmware:
    """The cylinder's controller without `checks`, built in `folder`."""
    core = folder / "core"
    shutil.copytree(ROOT / "firmware" / "core", core)
    for file, there, instead in checks:
        text = (core / file).read_text(encoding="utf-8")
        if text.count(there) != 1:
            raise SystemExit(f"{file}: the check {there!r} is no longer there")
        (core / file).write_text(text.replace(there, instead), encoding="utf-8")
    host = ROOT / "build" / "host"
    shutil.copytree(host / "generated", folder / "generated")
    rooms = [ROOT / "firmware" / room for room in ("link", "store", "ports/host")]
    entries = json.loads(subprocess.run(
        ["ninja", "-C", str(host), "-t", "compdb-targets", "libterrapin.so"], capture_output=True, text=True, check=True
    ).stdout)  # fmt: skip
    sources = [
        re.sub(r".*/firmware/core/", f"{core}/", entry["file"]) for entry in entries if entry["file"].endswith(".c")
    ]
    subprocess.run(
        ["cc", "-O2", "-std=c11", "-shared", "-fPIC", "-DTERRAPIN_SHARED", f"-I{core}", *(f"-I{r}" for r in rooms),
         f"-I{host / 'generated'}", "-o", str(folder / "libterrapin.so"), *sources], check=True,
    )  # fmt: skip
    return Firmware.open(folder)


def table(outcomes: list[Outcome]) -> str:
    """Markdown: for each robot, channel and way the worst of all situations."""
    return "\n".join(_rows(outcomes)) + "\n"


def _rows(outcomes: list[Outcome]) -> Iterator[str]:
    yield "| channel | way | " + " | ".join(f"{robot}: unasked [m], named" for robot in ROBOTS) + " | faults |"
    yield "|---" * (3 + len(ROBOTS)) + "|"
    for channel in CHANNELS:
        for way in WAYS:
            these = [o for o in outcomes if (o.channel, o.way) == (channel, way)]
            cells = []
            for robot in ROBOTS:
                own = [o for o in these if o.robot == robot]
                cells.append(
                    f"{max(o.unasked for o in own):.2f}, {sum(o.named for o in own)} of {len(own)}" if own else ""
                )
            names = sorted({name for o in these for name in o.faults})
            yield f"| {channel} | {way} | " + " | ".join(cells) + f" | {', '.join(names)} |"


def unnamed(outcomes: list[Outcome]) -> str:
    """Markdown: how many failures are named in time, and each channel and way that is not so in every run, with its
    reason. SystemExit where one has none, or has one and is named."""
    cells: dict[tuple[str, str], list[Outcome]] = {}
    for one in outcomes:
        cells.setdefault((one.channel, one.way), []).append(one)
    late = {cell: own for cell, own in cells.items() if not all(o.named for o in own)}
    wrong = sorted(late.keys() ^ (REASONS.keys() & cells.keys()))
    if wrong:
        raise SystemExit(f"{', '.join(wrong[0])}: {'no reason is' if wrong[0] in late else 'a reason is'} given")
    named, seen = sum(o.named for o in outcomes), sum(bool(o.faults) for o in outcomes)
    lines = [
        f"Within {NAMED} s {named} of {len(outcomes)} failures are named ({named / len(outcomes):.0%}), {seen} at "
        f"some time. Of {len(cells)} channels and ways {len(cells) - len(late)} are named in time in every run; "
        f"the other {len(late)}:",
        "",
        "| channel | way | named in time | later | why not sooner |",
        "|---|---|---|---|---|",
    ]
    for (channel, way), own in late.items():
        named, after = sum(o.named for o in own), sum(NAMED < o.after < np.inf for o in own)
        lines.append(f"| {channel} | {way} | {named} of {len(own)} | {after} | {REASONS[channel, way]} |")
    return "\n".join(lines) + "\n"


def renew(outcomes: list[Outcome]) -> None:
    """Write what the page has of the sweep."""
    text = PAGE.read_text(encoding="utf-8")
    for name, part in (("list", unnamed(outcomes)), ("table", table(outcomes))):
        head, tail = text.split(BEGIN.format(name))[0], text.split(END.format(name))[1]
        text = head + BEGIN.format(name) + "\n" + part + "\n" + END.format(name) + tail
    PAGE.write_text(text, encoding="utf-8")


def _of(robot: str, plant: bool) -> list[Outcome]:
    """In a process of its own: one process knows one robot."""
    command = [sys.executable, "-m", "tests.campaigns.sensors", "--one", robot, *(["--planted"] if plant else [])]
    text = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, env=dict(os.environ)).stdout
    return [Outcome(**{**entry, "faults": tuple(entry["faults"])}) for entry in json.loads(text)]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="What one broken sensor makes the robot do.")
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--planted", action="store_true", help="without the firmware's checks (cylinder)")
    parser.add_argument("--renew", action="store_true", help="write docs/sensors.md")
    parser.add_argument("--far", action="store_true", help="name every failure with more than 0.1 m")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        select(options.one)
        with tempfile.TemporaryDirectory() as folder:
            found = list(sweep(planted(Path(folder)) if options.planted else None))
        print(json.dumps([asdict(outcome) for outcome in found]))
        return 0
    robots = ["cylinder"] if options.planted else options.robots.split(",")
    outcomes = [outcome for robot in robots for outcome in _of(robot, options.planted)]
    missed = 0
    for robot in robots:
        select(robot)
        own = [o for o in outcomes if o.robot == robot]
        worst = max(own, key=lambda o: o.unasked)
        over = [o for o in own if o.unasked > bound()]
        missed += len(over)
        named = sum(o.named for o in own)
        print(
            f"{'met    ' if not over else 'NOT MET'} {robot}: {len(own)} failures, "
            f"unasked at most {worst.unasked:.2f} m ({worst.channel} {worst.way}, {worst.situation}; "
            f"bound {bound():.2f} m), beyond 0.1 m {sum(o.unasked > 0.1 for o in own)}, "
            f"named within {NAMED} s {named}, rolled off at most "
            f"{max(o.rolled for o in own):.2f} m"
        )
        for o in [o for o in own if o.unasked > 0.1] if options.far else over:
            print(f"        {o.situation}, {o.channel} {o.way}: {o.unasked:.2f} m, {', '.join(o.faults) or 'no fault'}")
    if options.renew:
        renew(outcomes)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
