"""Every effect that the simulator can carry, found again in its own logs and taken back to the controller.

    python -m tests.campaigns.simulator_logs [EFFECT...]

For each effect: ten short runs that make it visible, a case made of their logs by `terrapin case`, `discover`, `add`,
`export`, and a further run with the exported parameters. The runs differ in what the effect needs to be told from the
others: voltage, direction, weight, slope, temperature; what goes with the angle is shown by slow rolling on the floor,
in rows of 0.2 s (`--span`), where the swing of the inner body stays out of it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from terrapin_hil.messages import interface
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.robot.compiled_effects import ActiveEffect
from terrapin_hil.robot.plant import TERRAINS, Ground, Robot, Segment, Winding
from terrapin_hil.robot.sensors import kit
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_tools.contact_error import contact_error
from terrapin_tools.logs.folder import RunFolder
from terrapin_tools.workbench.case.case import load_case, parse_case
from terrapin_tools.workbench.case.changes import add_effects
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.robot.firmware_parameters import export_parameters
from terrapin_tools.workbench.robot.runs import read_run, write_case

__all__ = ["DESIGNS", "Design", "Outcome", "look"]

RIPPLE = 15.0  # codes (15 mA) of noise on each sample of the current: brushes and bridge
VOLTS = (3.0, 8.0, 4.0, 7.0, 2.5, 6.0, 5.0, 3.5, 7.5, 4.5)
LOADS = (1.0, 1.5, 0.8, 1.3, 1.0, 1.8, 0.7, 1.2, 1.6, 0.9)  # times the drive's mass
CELSIUS = (25.0, 30.0, 36.0, 42.0, 48.0, 54.0, 60.0, 65.0, 28.0, 50.0)
SLOPES = (0.0, 0.02, -0.02, 0.03, -0.03, 0.01, -0.01, 0.025, -0.025, 0.03)  # whole mrad: the sensor's resolution
SHARES = (1 / 3, 8 / 9, 0.0, 5 / 9, 1.0, 2 / 9, 2 / 3, 1 / 9, 7 / 9, 4 / 9)
AFTER = 3.0  # s that are left out at the start


@dataclass(frozen=True)
class Design:
    """How runs number 0 to 9 are made, and what the model has already."""

    scenario: Callable[[int], Scenario]
    values: Mapping[str, float]  # true parameters
    known: tuple[str, ...] = ("speed_squared",)
    span: float | None = None
    tolerance: float = 0.05  # relative, of the effect's size as found
    trial: int = 5  # number of the run that is repeated with the exported parameters


@dataclass(frozen=True)
class Outcome:
    """What came out for one effect. Errors in noise sd, held out; C_t errors in N m, None where not compensated."""

    effect: str
    verdict: str
    missing: tuple[str, ...]
    rivals: tuple[tuple[str, ...], ...]
    before: float
    after: float
    size: float
    contact: tuple[float, float] | None
    seconds: float

    @property
    def named(self) -> bool:
        """The effect alone, or as one of rivals that the data cannot tell apart.

        Rows of 0.2 s are means in which a wave of the angle loses some percent at the faster runs: that something is
        left beside what goes with the angle is true, and may be said."""
        known = ("missing", "partial") if DESIGNS[self.effect].span is not None else ("missing",)
        sure = self.verdict in known and self.missing == (self.effect,)
        return sure or (self.verdict == "ambiguous" and (self.effect,) in self.rivals)


def _active(name: str, values: Mapping[str, float]) -> tuple[ActiveEffect, ...]:
    return (ActiveEffect(catalogue()[name], dict(values)),)


def _scenario(
    number: int,
    volts: Sequence[float],
    effects: tuple[ActiveEffect, ...] = (),
    *,
    hold: float = 9.0,
    load: float = 1.0,
    slope: float = 0.0,
    celsius: float = 25.0,
    offset: float = 0.0,
    floor: bool = False,
) -> Scenario:
    """One run on sand (or the hard floor): each voltage is held for `hold` seconds."""
    robot = Robot()
    robot = replace(robot, drive_mass=robot.drive_mass * load)
    parts = kit("ideal")
    return Scenario(
        name=f"run_{number:02d}",
        duration=hold * len(volts),
        seed=number + 1,
        robot=robot,
        ground=Ground((Segment(TERRAINS["hard_floor" if floor else "sand"], slope=slope),)),
        operator=tuple(Order(i * hold, "run", "voltage", v, limiter=False) for i, v in enumerate(volts)),
        sensors=replace(parts, current=replace(parts.current, noise=RIPPLE, offset=offset)),
        winding=Winding(profile=((0.0, celsius), (1.0, celsius))),
        effects=effects,
        firmware={"weight": robot.weight, "trim_current": 0.0, "sd_current_noise": RIPPLE * 1e-3},
    )


def _both_ways(i: int) -> tuple[float, float]:
    return (VOLTS[i], -VOLTS[-i - 1])


def _forward(i: int) -> tuple[float, float]:
    return (VOLTS[i], VOLTS[-i - 1])


def _friction(name: str, values: Mapping[str, float], volts: Callable[[int], Sequence[float]]) -> Design:
    return Design(lambda i: _scenario(i, volts(i), _active(name, values), load=LOADS[i]), values)


def _ramp(i: int) -> Scenario:
    """The voltage rises (or falls) by 2 V over 12 s, in 60 steps that are too small to set the body swinging."""
    scenario = _scenario(i, [VOLTS[i]], hold=12.0)
    share = [k / 59.0 if i % 2 else 1.0 - k / 59.0 for k in range(60)]
    orders = tuple(
        Order(0.2 * k, "run", "voltage", round(VOLTS[i] + 2.0 * s, 3), limiter=False) for k, s in enumerate(share)
    )
    return replace(scenario, operator=orders)


def _inertia() -> float:
    """J = R^2 sum(m) + I_c + I_r (R/r)^2 of the simulated robot; the swinging mass adds to it."""
    r = Robot()
    mass = r.shell_mass + r.body_mass + r.drive_mass
    return r.radius**2 * mass + r.shell_inertia + r.drive_inertia * (r.radius / r.drive_radius) ** 2


SPEED = {"f_s": TERRAINS["sand"].f_s}
DRAG, DRY, VISCOUS = {"cda": 0.15}, {"da": 0.008}, {"b": 0.0012}
STRIBECK, HEATING = {"a_s": 0.015, "omega_s": 1.5}, {"a_t": 0.002}
IMBALANCE, COGGING = {"m_e": 0.008, "phase": 0.7}, {"m_c": 0.008, "k": 3.0, "phase": 0.7}

DESIGNS: Mapping[str, Design] = {
    "speed_squared": Design(lambda i: _scenario(i, _forward(i), load=LOADS[i]), SPEED, known=()),
    "aerodynamic_drag": _friction("aerodynamic_drag", DRAG, _forward),
    "coulomb_friction": _friction("coulomb_friction", DRY, _both_ways),
    "viscous_friction": _friction("viscous_friction", VISCOUS, _forward),
    "stribeck": replace(
        _friction("stribeck", STRIBECK, lambda i: (0.8 * VOLTS[i], 1.6 + 0.15 * i)),
        trial=0,  # 1.6 V: slow
    ),
    "motor_heating": Design(
        lambda i: _scenario(i, _forward(i), _active("motor_heating", HEATING), celsius=CELSIUS[i]), HEATING
    ),
    "current_offset": Design(lambda i: _scenario(i, _both_ways(i), load=LOADS[i], offset=12.0), {"i_0": 0.012}),
    "slope": Design(lambda i: _scenario(i, [max(v, 5.0) for v in _forward(i)], slope=SLOPES[i]), {"gain": 1.0}),
    "inertia": Design(_ramp, {"j": _inertia()}, span=0.3, tolerance=0.15),
    "shell_imbalance": Design(
        lambda i: _scenario(i, [0.7 + 1.3 * SHARES[i]], _active("shell_imbalance", IMBALANCE), hold=8.0, floor=True),
        IMBALANCE,
        known=("inertia",),
        span=0.2,
    ),
    "cogging": Design(
        lambda i: _scenario(i, [0.55 + 0.4 * SHARES[i]], _active("cogging", COGGING), hold=8.0, floor=True),
        COGGING,
        known=("inertia",),
        span=0.2,
    ),
}


def _logged(scenario: Scenario, folder: Path) -> None:
    log = RunFolder(folder, scenario, "inprocess", {}, interface())
    try:
        log.finish(run(scenario, "inprocess", observers=[log]))
    finally:
        log.close()


def look(name: str, out: Path) -> Outcome:
    """Runs, case, discover, add, export and the run after it, in the folder `out`."""
    design = DESIGNS[name]
    folders = []
    for number in range(10):
        scenario = design.scenario(number)
        folders.append(out / scenario.name)
        _logged(scenario, folders[-1])
    runs = [read_run(folder, AFTER, span=design.span) for folder in folders]
    write_case(out / "case", runs, f"Logs of the simulator with {name}", design.known)
    case = load_case(out / "case")
    begin = time.monotonic()
    found = discover(case)
    seconds = time.monotonic() - begin
    larger = analyse(parse_case(case.folder, add_effects(case.text, [name], {})))
    before, after = found.analysis.ladder[-1].heldout_error, larger.ladder[-1].heldout_error
    assert before is not None
    assert after is not None
    fitted = {f.key: float(v) for f, v in zip(larger.model.fitted, larger.fit.theta, strict=True)}
    first = next(iter(design.values))
    contact = None
    if catalogue()[name].firmware:
        values = {entry.name: entry.held for entry in export_parameters(larger)[0]}
        trial = replace(design.scenario(design.trial), seed=99)
        errors = [contact_error(run(trial, "inprocess", parameters=p)) for p in ({}, values)]
        assert all(e is not None for e in errors)
        contact = tuple(e.rms for e in errors if e is not None)
    return Outcome(
        effect=name,
        verdict=found.verdict,
        missing=found.missing,
        rivals=found.rivals,
        before=before,
        after=after,
        size=fitted[f"{name}.{first}"] / design.values[first],
        contact=contact,  # type: ignore[arg-type]
        seconds=seconds,
    )


def line(o: Outcome) -> str:
    """One row of the table."""
    said = " + ".join(o.missing) if o.verdict != "ambiguous" else " or ".join(" + ".join(r) for r in o.rivals)
    contact = "not compensated" if o.contact is None else f"{1e3 * o.contact[0]:.2f} -> {1e3 * o.contact[1]:.2f} mN m"
    return (
        f"{'ok  ' if o.named else 'FAIL'} {o.effect:<18} {o.verdict:<11} {said:<34} {o.before:8.2f} -> {o.after:5.2f}"
        f"  size {o.size:5.3f}  C_t {contact:<24} {o.seconds:5.1f} s"
    )


def main(names: Sequence[str]) -> int:
    """Print the table; 1 when an effect is not named."""
    print(
        "     effect             verdict     named                              held-out error, noise sd; size / truth"
    )
    failed = 0
    for name in names or DESIGNS:
        with tempfile.TemporaryDirectory() as folder:
            outcome = look(name, Path(folder))
        failed += not outcome.named
        print(line(outcome), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
