"""Scenario files: what robot, on what ground, with what sensors, faults and operator, for how long, and what must hold.

    from terrapin_hil.scenario.scenario import load_scenario
    scenario = load_scenario(Path("terrapin_hil/scenario/scenarios/steady_sand.toml"))

Numbers are SI, strings carry units. `ReadingError` names file, line and field of what is wrong.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from terrapin_hil import paths
from terrapin_hil.effect_files import known_effects
from terrapin_hil.messages import Interface, interface
from terrapin_hil.reading import ReadingError, Section, load, parse_quantity, parse_toml, quantities, shorten
from terrapin_hil.robot.compiled_effects import ActiveEffect, drags, in_plant
from terrapin_hil.robot.plant import TERRAINS, Ground, Robot, Segment, Terrain, Winding
from terrapin_hil.robot.sensors import Sensors, kit, read_sensors, with_effects
from terrapin_hil.robot.soft_ground import (
    affected,
    affects_soil,
    cannot_roll,
    check_step,
    grip_tables,
    read_soft_ground,
)
from terrapin_hil.robots import Robot as Design
from terrapin_hil.robots import cylinder, select, selected
from terrapin_hil.scenario.changes import changed, place_of
from terrapin_hil.scenario.checks import Check, parse_check
from terrapin_hil.scenario.faults import MAX_FAULTS, Fault, Provocation, read_fault, read_provocation
from terrapin_hil.scenario.scaled import scaled
from terrapin_hil.telemetry import signals, words
from terrapin_interface.robot import DEFAULT, ORIGINS, robots

__all__ = [
    "CONTROLS",
    "REQUESTS",
    "Order",
    "Scenario",
    "find_scenario",
    "load_scenario",
    "parameters_of",
    "read_scenario",
    "robot_of",
    "take_scenario",
]

REQUESTS = {"idle": 0, "calibrate": 1, "run": 2, "clear": 3}
CONTROLS = {"voltage": 0, "speed": 1}
LIMITS = {"voltage": ("V", 32.0), "speed": ("m/s", 32.0)}
MAX_SEGMENTS, MAX_ORDERS, MAX_POINTS = 16, 64, 64  # of the C structs
FARTHEST = 1e4  # m along the path: encoders count in 32 bits
LONGEST = 3600.0  # s: a tick of the log takes 232 bytes of memory


@dataclass(frozen=True)
class Order:
    """From `time` on [s] the operator asks for this; setpoint in V or, with speed control, m/s of the shell's rim."""

    time: float
    request: str
    control: str = "voltage"
    setpoint: float = 0.0
    limiter: bool = True


@dataclass(frozen=True)
class Scenario:
    """One run, whole: together with a firmware it determines every bit of the log."""

    name: str
    duration: float
    ground: Ground
    operator: tuple[Order, ...]
    title: str = ""
    seed: int = 1
    design: Design = field(default_factory=selected)  # the file of the robot
    robot: Robot = field(default_factory=lambda: Robot(**selected().plant))  # its constants in this run
    sensors: Sensors = field(default_factory=lambda: kit("ideal"))
    winding: Winding = field(default_factory=Winding)
    supply: float = field(default_factory=lambda: selected().supply)
    supply_resistance: float = 0.0
    start_position: float = 0.0
    moisture: float = 0.0
    pass_number: float = 1.0
    tow: tuple[tuple[float, float], ...] = ()  # load [N] that the axle tows, over time [s]
    carriage: tuple[tuple[float, float], ...] = ()
    steering: tuple[tuple[float, float], ...] = ()  # heading [rad] that the inner device is steered to, over time [s]
    faults: tuple[Fault, ...] = ()
    effects: tuple[ActiveEffect, ...] = ()
    firmware: Mapping[str, float] = field(default_factory=dict)  # controller parameters, in their units
    checks: tuple[Check, ...] = ()
    provokes: Provocation | None = None
    real_time: bool = False
    source: str = ""  # text of the file
    notes: tuple[str, ...] = ()  # what is no error, but would surprise

    @property
    def ticks(self) -> int:
        """Length in ticks of 1 ms."""
        return round(self.duration * 1000)


def find_scenario(name: str) -> Path:
    """A file as it is, or the shipped scenario of that name: scenarios/ROBOT/NAME.toml, else scenarios/NAME.toml, which
    is the cylinder's and is scaled to another robot. ReadingError when neither is.
    """
    path, robot = Path(name), selected().name
    own = {} if robot == DEFAULT else _shipped(robot)
    known = {**_shipped(DEFAULT), **own}
    try:
        if path.is_file():
            return path
    except OSError as error:  # a name that is too long, a folder that may not be searched
        raise ReadingError(f"{shorten(name)}: {error.strerror}") from None
    if name in known:
        return known[name]
    shown = name if len(name) < 200 else shorten(name)
    raise ReadingError(f"{shown}: no such file, and no scenario of that name; shipped: {', '.join(sorted(known))}")


def _shipped(robot: str) -> dict[str, Path]:
    folder = paths.SCENARIOS if robot == DEFAULT else paths.SCENARIOS / robot
    return {path.stem: path for path in folder.glob("*.toml")}


def robot_of(path: Path) -> str:
    """The robot that a scenario's file says it is for: `file` in its table [robot]; empty where it says none, or is no
    scenario that can be read, which reading it then tells."""
    try:
        table = load(path).section("robot")
        named = table.text("file", "")
    except ReadingError:
        return ""
    return named


def take_scenario(name: str, robot: str = "") -> Path:
    """`find_scenario` for a command: unless it was given a `robot`, the one that the scenario is for becomes that of
    this process. Its file is looked for by its path, beside the scenario, in the folder above and here.

    A shipped scenario that only one other robot has is found by its name alone.
    """
    if not robot and not os.path.isfile(name) and name not in _shipped(selected().name) | _shipped(DEFAULT):
        others = [other for other in robots() if name in _shipped(other)]
        if len(others) == 1:
            select(others[0])
    path = find_scenario(name)
    if not robot and (named := robot_of(path)) and Path(named).name.removesuffix(".toml") != selected().name:
        here = path.resolve().parent
        select(named, (here, here.parent, Path()))
    return path


def _terrain(section: Section) -> Terrain:
    """`terrain` names a kind of ground; f_o, f_s, mu, s_k and softness beside it change it."""
    base = TERRAINS[section.choice("terrain", TERRAINS)]
    changed = {
        name: section.quantity(name, unit, None, low, high)
        for name, unit, low, high in (
            ("f_o", "1", 0.0, 1.0),
            ("f_s", "s^2/rad^2", 0.0, 1.0),
            ("mu", "1", 1e-6, 5.0),
            ("s_k", "1", 1e-3, 10.0),
            ("softness", "1", 0.0, 1.0),
        )
        if name in section
    }
    return replace(base, **changed)


def _ground(root: Section) -> Ground:
    segments: list[Segment] = []
    soft = root.choice("ground", ["default", "contact"], "default") == "contact"
    soil = read_soft_ground(root.section("soil")) if soft else None
    for section in root.sections("path"):
        first = not segments
        start = section.quantity("from", "m", 0.0 if first else None)
        firm = soft and "terrain" in section
        if firm and "soil" in section:
            raise section.error("soil", "a segment has a terrain or a soil, expected one of the two")
        if not first and start <= segments[-1].start:
            raise section.error("from", f"found {start:g} m, expected more than {segments[-1].start:g} m")
        slope = section.quantity("slope", "rad", 0.0, -1.2, 1.2)
        transition = section.quantity("transition", "m", 0.05, 1e-6, 1e3)
        own = None
        if soil is not None and "soil" in section:
            own = read_soft_ground(section.section("soil"))
            if own.shape != soil.shape:
                raise section.error("soil", f"found shape {own.shape}, expected {soil.shape} as in [soil]")
        terrain = Terrain() if soft and not firm else _terrain(section)
        segments.append(Segment(terrain, start, slope, transition, own, firm))
        section.done()
    if not 1 <= len(segments) <= MAX_SEGMENTS:
        raise root.error("path", f"found {len(segments)} tables [[path]], expected 1 to {MAX_SEGMENTS}")
    for here, following in pairwise(segments):
        if here.start + here.transition > following.start and here is not segments[0]:
            raise root.error("path", f"the transition that begins at {here.start:g} m reaches into the next segment")
    rut = root.section("rut")
    if soft and all(segment.firm for segment in segments):
        raise root.error("ground", "found a terrain in each segment, expected one without: it has the soil")
    if soft:
        return Ground(tuple(segments), contact=soil, slip_depth=quantities(rut, _SlipRut).slip_depth)
    return Ground(tuple(segments), **asdict(quantities(rut, _Rut)))


@dataclass(frozen=True)
class _Rut:
    dig_length: float = field(default=0.30, metadata={"unit": "m", "low": 1e-6})
    leave_length: float = field(default=0.10, metadata={"unit": "m", "low": 1e-6})
    rut_friction: float = field(default=1.0, metadata={"unit": "1", "low": 0.0, "high": 10.0})
    dig_slip: float = field(default=0.5, metadata={"unit": "1", "low": 0.0, "high": 1.0})


@dataclass(frozen=True)
class _SlipRut:
    slip_depth: float = field(default=0.0, metadata={"unit": "m", "low": 0.0, "high": 1.0})


def _operator(root: Section) -> tuple[Order, ...]:
    orders: list[Order] = []
    for section in root.sections("operator"):
        time = section.quantity("at", "s", None, 0.0)
        if orders and time <= orders[-1].time:
            raise section.error("at", f"found {time:g} s, expected more than {orders[-1].time:g} s")
        request = section.choice("request", REQUESTS)
        control = section.choice("control", CONTROLS, "voltage")
        unit, limit = LIMITS[control]
        setpoint = section.quantity("setpoint", unit, 0.0, -limit, limit)
        orders.append(Order(time, request, control, setpoint, section.flag("limiter", True)))
        section.done()
    if not 1 <= len(orders) <= MAX_ORDERS:
        raise root.error("operator", f"found {len(orders)} tables [[operator]], expected 1 to {MAX_ORDERS}")
    return tuple(orders)


def _profile(section: Section, key: str, unit: str, low: float, high: float) -> tuple[tuple[float, float], ...]:
    points = section.points(key, unit, low, high) if key in section else ()
    if len(points) > MAX_POINTS:
        raise section.error(key, f"found {len(points)} points, expected at most {MAX_POINTS}")
    return points


def _effects(root: Section) -> tuple[ActiveEffect, ...]:
    section = root.section("effect")
    soft = "ground" in root and root.raw("ground") == "contact"
    known = {
        name: effect
        for name, effect in known_effects().items()
        if in_plant(effect) or (soft and (affects_soil(effect) or drags(effect)))
    }
    active = []
    for name in section:
        if name not in known:
            raise section.error(name, f"no effect that the plant can take; known: {', '.join(known)}")
        table = section.section(name)
        values = {
            parameter.name: table.quantity(
                parameter.name,
                parameter.unit,
                parameter.start if number else None,  # the first parameter is the effect's size
                parameter.minimum,
                parameter.maximum,
            )
            for number, parameter in enumerate(known[name].parameters)
        }
        table.done()
        active.append(ActiveEffect(known[name], values))
    return tuple(active)


def _checks(root: Section, description: Interface) -> tuple[Check, ...]:
    from terrapin_hil.robot.truth import TRUTH  # it needs Scenario

    names, enums = [*TRUTH, *signals(description)], words(description)
    texts = root.raw("checks") if "checks" in root else []
    if not isinstance(texts, list) or any(not isinstance(text, str) for text in texts):
        raise root.error("checks", f"found {texts!r}, expected a list of texts")
    checks = []
    for text in texts:
        try:
            checks.append(parse_check(text))
            checks[-1].require(names, enums)
        except ValueError as error:
            raise root.error("checks", f"{text!r}: {error}") from None
    return tuple(checks)


def parameters_of(section: Section, description: Interface) -> dict[str, float]:
    """Parameters of the controller, in their units; a number, or text with its own unit. ReadingError as always."""
    values = {}
    for name in section:
        try:
            parameter = description.parameter(name)
            values[name] = parse_quantity(section.raw(name), parameter.unit)
            parameter.raw(values[name])
        except ValueError as error:
            raise section.error(name, str(error)) from None
    return values


def _robot(root: Section) -> Robot:
    """The table [robot]: constants in place of those of the robot's file. `file` says for which robot a scenario is."""
    section, design = root.section("robot"), selected()
    named = Path(section.text("file", design.name)).name.removesuffix(".toml")
    if named != design.name:
        raise section.error(
            "file", f"found {named}, expected {design.name}, the robot of this process; --robot={named}"
        )
    section.flag("told", False)
    return quantities(section, Robot, Robot(**design.plant))


def _told(
    root: Section, robot: Robot, given: Mapping[str, float], description: Interface
) -> tuple[dict[str, float], str]:
    """What the controller is to know of changed constants of the robot, and a line about what it does not know."""
    design, section = selected(), root.section("robot")
    there = replace(design, plant={name: getattr(robot, name) for name in design.plant})
    changed = {}
    for name in ORIGINS:
        parameter = description.parameters[name]
        if name not in given and abs(there.quantity(name) - design.quantity(name)) > parameter.scale / 2:
            changed[name] = there.quantity(name)
    if not changed:
        return {}, ""
    if section.flag("told", False):
        for name, value in changed.items():
            try:
                description.parameter(name).raw(value)
            except ValueError as error:
                raise section.error("told", str(error)) from None
        return changed, ""
    kept = ", ".join(
        f"{name} = {design.quantity(name):.6g} (the robot has {value:.6g})" for name, value in changed.items()
    )
    return {}, f"[robot] is not told to the controller, which keeps {kept}; told = true tells it"


def load_scenario(path: Path, values: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario of a file, with `values` by name (changes.py) in the place of its own; its `source` has them too.

    A shipped one that is the default robot's is scaled to the robot of this process (scaled.py).

    ReadingError: one line that names file, line, field and what was expected.
    """
    root, note, asked = load(path), "", values
    if path.parent == paths.SCENARIOS and selected().name != DEFAULT:
        try:
            fitted, note = scaled(parse_toml(root.source, path), cylinder(), selected())
        except ValueError as error:
            raise ReadingError(f"{path.stem}: {error}") from None
        values = {**fitted, **(values or {})}
    if values:
        text = _changed_text(root.source, values)
        root = Section(parse_toml(text, path), str(path), text)
    scenario = read_scenario(root, path.stem)
    notes = [note] if note else []
    if asked and "title" not in asked and any(letter.isdigit() for letter in scenario.title):
        notes.append(f"set: {', '.join(f'{name} = {value}' for name, value in asked.items())}; the title is as it was")
    return replace(scenario, notes=(*notes, *scenario.notes))


def _changed_text(text: str, values: Mapping[str, Any]) -> str:
    """The file's text with the values, its comments and order kept."""
    import tomlkit

    document: Any = tomlkit.parse(text)
    for name in [name for name, value in values.items() if value is None]:
        document.remove(name)
    values = {name: value for name, value in values.items() if value is not None}
    changed(document.unwrap(), values)  # says what is wrong with a name
    for name, value in values.items():
        *way, last = place_of(name)
        table = document
        for here in way:
            if isinstance(here, str) and here not in table:
                table[here] = tomlkit.table()
            table = table[here]
        table[last] = value
    return tomlkit.dumps(document)


def read_scenario(root: Section, name: str) -> Scenario:
    """The scenario `name` that the tables of a file describe. ReadingError as `load_scenario`."""
    description = interface()
    winding = root.section("winding")
    profile = _profile(winding, "profile", "degC", -50.0, 300.0)
    heating = replace(quantities(winding, Winding, Winding()), profile=profile)
    supply = root.section("supply")
    robot = _robot(root)
    firmware = parameters_of(root.section("firmware"), description)
    told, note = _told(root, robot, firmware, description)
    scenario = Scenario(
        name=name,
        title=root.text("title", ""),
        duration=root.quantity("duration", "s", None, 0.001, LONGEST),
        seed=root.whole("seed", 1, 0, 2**63 - 1),
        robot=robot,
        ground=_ground(root),
        sensors=read_sensors(root.section("sensors")),
        winding=heating,
        supply=supply.quantity("voltage", "V", selected().supply, 0.0, 60.0),
        supply_resistance=supply.quantity("resistance", "ohm", 0.0, 0.0, 100.0),
        start_position=root.quantity("start_position", "m", 0.0, -FARTHEST, FARTHEST),
        moisture=root.quantity("moisture", "1", 0.0, 0.0, 1.0),
        pass_number=root.quantity("pass", "1", 1.0, 1.0),
        tow=_profile(root, "tow", "N", 0.0, 1e6),
        carriage=_profile(root, "carriage", "m/s", -32.0, 32.0),
        steering=_profile(root, "steering", "rad", -1000.0, 1000.0),
        operator=_operator(root),
        faults=tuple(read_fault(section) for section in root.sections("fault")),
        effects=_effects(root),
        firmware={**told, **firmware},
        checks=_checks(root, description),
        provokes=read_provocation(root, description.faults),
        real_time=root.flag("real_time", False),
        source=root.source,
        notes=(note,) if note else (),
    )
    supply.done()
    try:
        gear = scenario.robot.radius / scenario.robot.drive_radius
        scenario = replace(scenario, sensors=with_effects(scenario.sensors, scenario.effects, gear))
    except ValueError as error:
        raise root.error("effect", str(error)) from None
    if scenario.ground.contact is not None:
        try:
            ground, acting = affected(scenario.ground, scenario.effects, scenario.pass_number, scenario.moisture)
            robot = scenario.robot
            grip_tables(ground, robot)
            if line := cannot_roll(ground, robot, acting):
                scenario = replace(scenario, notes=(*scenario.notes, line))
            free = scenario.supply * robot.drive_radius / max(robot.torque_constant, 1e-12)  # rim without load
            for soft in ground.soils:
                check_step(soft, robot, 1e-3, free)
        except ValueError as error:
            raise root.error("soil", str(error)) from None
    if len(scenario.faults) > MAX_FAULTS:
        raise root.error("fault", f"found {len(scenario.faults)} tables [[fault]], expected at most {MAX_FAULTS}")
    root.done()
    return replace(scenario, notes=(*scenario.notes, *_too_late(scenario)))


def _too_late(scenario: Scenario) -> list[str]:
    """A line for each order and fault that a run as long as the scenario does not live to see."""
    orders = ((f"operator[{i}] ({one.request})", one.time) for i, one in enumerate(scenario.operator, 1))
    faults = ((f"fault[{i}] ({one.kind})", one.begin) for i, one in enumerate(scenario.faults, 1))
    return [
        f"{name} begins at {at:g} s: the run ends before, at {scenario.duration:g} s"
        for name, at in (*orders, *faults)
        if at >= scenario.duration
    ]
