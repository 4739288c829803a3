"""Which slip limit is best: the sphere of 150 N under the real firmware, on rigs and rolling freely into a load.

On the rig (scenario slip_rig) a carriage moves the axle and nothing limits the torque but the slip limiter, so that
the pull is what the ground gives at the slip that the limiter holds. Rolling freely (scenario overload) gravity or the
guard of the swing may end the run before the limiter does anything. Neither ground nor rut knows 0.5; the paper's law
of slip sinkage begins at a slip of 0.45, the rut at none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.figure_style import PANELS, picture

__all__ = [
    *("CASES", "LAWS", "LIMITS", "ROBOT", "Free", "Pull", "Study"),
    *("as_json", "best", "describe", "free_run", "plot", "pull", "shares", "study"),
]

ROBOT = "sphere"  # whose scenarios these are
LIMITS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
PAPER = 0.5

# Law of what slipping costs -> values of the scenario: none (Eqs. 1 to 6), the paper's, the rut of a depth a slip.
LAWS: Mapping[str, Mapping[str, Any]] = {
    "none": {"effect.bulldozing.scale": 0, "effect.slip_sinkage.xi1": 0},
    "paper": {"effect.bulldozing.scale": 1, "effect.slip_sinkage.xi1": 2},
    **{
        f"rut {depth} mm": {
            "effect.bulldozing.scale": 1,
            "effect.slip_sinkage.xi1": 0,
            "rut.slip_depth": f"{depth} mm",
        }
        for depth in (3, 7, 20)
    },
}
CASES: Mapping[str, Mapping[str, Any]] = {
    "printed sand": {},
    "bob of 1.5 kg": {"robot.body_mass": "1.5 kg"},
    "weak sand": {"soil.friction_angle": "30 deg", "soil.shear_modulus": "25 mm"},
    "soft sand": {"soil.k_phi": "0.5 MPa/m^0.97"},
    "slope of 6 deg": {"path.1.slope": "6 deg"},
}
LOADS: Mapping[str, str] = {"paper": "17.8 N", "rut 3 mm": "16.7 N"}  # to tow on weak sand
SETTLED = 20.0  # s of the rig's run that count, the last
STOPPED = 3e-3  # m/s


@dataclass(frozen=True)
class Pull:
    """What a limit gives on the rig, mean values of its last SETTLED seconds, SI."""

    case: str
    law: str
    limit: float
    slip: float
    farthest: float  # of the slip from the limit
    pull: float  # net of the ground's resistance and of the weight's share on a slope [N]
    climbs: float  # greatest slope on which that pull holds the weight [rad]
    dug: float  # by slipping [m]
    sinkage: float  # with it [m]
    energy: float  # at the shell, a metre of way [J/m]
    drawn: float  # from the battery [J/m]
    efficiency: float  # work of the pull over that of the shell


@dataclass(frozen=True)
class Free:
    """A free run into a load: from its taking to a stop."""

    law: str
    limit: float
    way: float  # [m]
    energy: float  # drawn from the battery [J]
    dug: float  # [m]
    swing: float  # greatest [rad]
    ended: str  # by: limiter, gravity, guard, or "rolls on"


@dataclass(frozen=True)
class Study:
    pulls: tuple[Pull, ...]
    free: tuple[Free, ...]


def pull(case: str, law: str, limit: float) -> Pull:
    """One run on the rig. UserError as of a scenario."""
    values = {**CASES[case], **LAWS[law], "firmware.slip_limit": limit}
    result = run(load_scenario(find_scenario("slip_rig"), values))
    truth, robot = result.truth, result.scenario.robot
    late = result.time >= result.scenario.duration - SETTLED
    mean = {name: float(truth[name][late].mean()) for name in ("slip", "traction", "dug", "sinkage", "slope", "speed")}
    net = mean["traction"] - robot.weight * math.sin(mean["slope"])
    shell = float((truth["contact_torque"] * truth["omega"])[late].mean())
    drawn = float((truth["voltage"] * truth["current"])[late].mean())
    return Pull(
        case=case,
        law=law,
        limit=limit,
        slip=mean["slip"],
        farthest=float(np.abs(truth["slip"][late] - limit).max()),
        pull=net,
        climbs=math.asin(max(-1.0, min(1.0, net / robot.weight))),
        dug=mean["dug"],
        sinkage=mean["sinkage"] + mean["dug"],
        energy=shell / mean["speed"],
        drawn=drawn / mean["speed"],
        efficiency=net * mean["speed"] / shell,
    )


def free_run(law: str, limit: float) -> Free:
    """One run into a load on weak sand. UserError as of a scenario."""
    values = {**LAWS[law], "firmware.slip_limit": limit, "tow.2.2": LOADS[law]}
    result = run(load_scenario(find_scenario("overload"), values))
    truth, time = result.truth, result.time
    begin = int(np.searchsorted(time, result.scenario.tow[0][0]))
    slow = np.flatnonzero(truth["speed"][begin:] < STOPPED)
    end = begin + int(slow[0]) if slow.size else len(time) - 1
    part = slice(begin, end + 1)
    return Free(
        law=law,
        limit=limit,
        way=float(truth["position"][end] - truth["position"][begin]),
        energy=1e-3 * float((truth["voltage"] * truth["current"])[part].sum()),
        dug=float(truth["dug"][part].max()),
        swing=float(np.abs(truth["swing_angle"]).max()),
        ended=_ended(result, begin, end) if slow.size else "rolls on",
    )


def _ended(result: Result, begin: int, end: int) -> str:
    """What kept the robot from pulling on: the guard, gravity (the bob at its most), or the limiter."""
    if result.held("ACTUATE", "enable")[end] == 0:
        return "guard"
    limiting = result.held("ACTUATE", "limiting")[begin:end]
    return "limiter" if limiting.any() else "gravity"


def study(
    limits: Sequence[float] = LIMITS,
    cases: Sequence[str] = tuple(CASES),
    told: Callable[[int, int], None] = lambda done, of: None,
) -> Study:
    """Every limit with every law in every case on the rig, and the free runs. `told(done, of)` follows it."""
    rig = [(case, law, limit) for case in cases for law in LAWS for limit in limits]
    loose = [(law, limit) for law in LOADS for limit in limits]
    pulls, free = [], []
    for done, setting in enumerate(rig):
        told(done, len(rig) + len(loose))
        pulls.append(pull(*setting))
    for done, (law, limit) in enumerate(loose):
        told(len(rig) + done, len(rig) + len(loose))
        free.append(free_run(law, limit))
    return Study(tuple(pulls), tuple(free))


def shares(found: Study) -> dict[tuple[str, str], dict[float, float]]:
    """(case, law) -> limit -> pull over the best of the limits tried; no pairs in which nothing pulls."""
    table: dict[tuple[str, str], dict[float, float]] = {}
    for p in found.pulls:
        table.setdefault((p.case, p.law), {})[p.limit] = p.pull
    return {
        pair: {limit: value / max(row.values()) for limit, value in row.items()}
        for pair, row in table.items()
        if max(row.values()) > 0.0
    }


def best(found: Study, pair: tuple[str, str]) -> dict[str, float]:
    """The limit that pulls most, digs least, costs least energy a metre, and pulls most efficiently. A row that does
    not pull at a limit has no answer there."""
    rows = [p for p in found.pulls if (p.case, p.law) == pair and p.pull > 0.0]
    return {
        "pull": max(rows, key=lambda p: p.pull).limit,
        "dug": min(rows, key=lambda p: (p.sinkage, p.limit)).limit,
        "energy": min(rows, key=lambda p: p.energy).limit,
        "efficiency": max(rows, key=lambda p: p.efficiency).limit,
    }


def as_json(found: Study) -> dict[str, Any]:
    """The runs, shares of the best pull, and the best limits."""
    table = shares(found)
    return {
        "pulls": [asdict(p) for p in found.pulls],
        "free": [asdict(f) for f in found.free],
        "rows": [
            {
                "case": pair[0],
                "law": pair[1],
                "shares": {f"{k:g}": v for k, v in row.items()},
                "best": best(found, pair),
            }
            for pair, row in table.items()
        ],
    }


def describe(found: Study) -> str:
    """Tables for people: shares of the best pull, energy and depth, and the free runs."""
    limits = sorted({p.limit for p in found.pulls})
    table = shares(found)
    head = "".join(f"{limit:7g}" for limit in limits)
    lines = ["Pull at a limit over the best (0: none); best limit for pull, depth, energy a metre, efficiency"]
    lines.append(f"  {'case':<15}{'law':<10}{head}")
    for pair, row in table.items():
        chosen = best(found, pair)
        cells = "".join(f"{max(row[limit], 0.0):7.2f}" for limit in limits)
        words = " ".join(f"{chosen[name]:5g}" for name in ("pull", "dug", "energy", "efficiency"))
        lines.append(f"  {pair[0]:<15}{pair[1]:<10}{cells}   {words}")
    all_rows = np.array([[max(row[limit], 0.0) for limit in limits] for row in table.values()])
    lines.append(f"  {'worst of these':<25}{''.join(f'{v:7.2f}' for v in all_rows.min(axis=0))}")
    lines.append(f"  {'mean of these':<25}{''.join(f'{v:7.2f}' for v in all_rows.mean(axis=0))}")
    lines += ["", "Printed sand, the paper's law and the rut of 7 mm", f"  {'':<25}{head}"]
    for name, unit, law, scale in (
        ("pull", "N", "paper", 1.0),
        ("energy", "J/m", "paper", 1.0),
        ("drawn", "J/m", "paper", 1.0),
        ("dug", "mm", "rut 7 mm", 1e3),
    ):
        some = {p.limit: getattr(p, name) for p in found.pulls if p.law == law and p.case == "printed sand"}
        if some:
            lines.append(f"  {f'{name} [{unit}], {law}':<25}{''.join(f'{scale * some[k]:7.1f}' for k in limits)}")
    lines += ["", "Rolling freely into a load on weak sand: way to a stop [m], energy [J], dug [mm], what ended it"]
    for f in found.free:
        lines.append(
            f"  {f.law:<10}limit {f.limit:<5g}{f.way:8.3f}{f.energy:8.1f}{1e3 * f.dug:7.2f}  {f.ended}, "
            f"bob at most {math.degrees(f.swing):.0f} deg"
        )
    return "\n".join(lines)


def plot(found: Study, file: Path) -> None:
    """Shares of the best pull against the limit, a panel a case, a curve a law; .svg or .png."""
    table = shares(found)
    cases = list(dict.fromkeys(case for case, _ in table))
    with picture(file, (3.0 * len(cases), 3.2), PANELS) as figure:
        panels = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
        for panel, case in zip(panels, cases, strict=True):
            for (of, law), row in table.items():
                if of == case:
                    panel.plot(list(row), [max(value, 0.0) for value in row.values()], marker="o", ms=3, label=law)
            panel.axvline(PAPER, color="#6b7280", lw=0.8, ls="--")
            panel.set(title=case, xlabel="slip limit", ylim=(0.0, 1.05))
        panels[0].set_ylabel("pull over the best")
        panels[0].legend()
