"""The plant's `ground = "contact"`: tables of a wheel's or a sphere's contact, and what follows for steady rolling.

>>> from dataclasses import replace
>>> from terrapin_hil.physics.soils import library
>>> sand = replace(library()["sand_reina"], shear_modulus=0.025)
>>> steady = contact_steady(Robot(), SoftGround(sand), [5.0, 8.0])
>>> [f"{v:.6g}" for v in (steady["slip"][0], steady["torque"][0], steady["omega"][0], steady["omega"][1])]
['0.468666', '0.321692', '2.73422', '9.31757']
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from terrapin_hil.library import ffi, library
from terrapin_hil.physics import contact, grip, soils, sphere
from terrapin_hil.physics.contact import FIELDS, Array, ContactError, Rows, Shape
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import parse
from terrapin_hil.reading import Section, shorten
from terrapin_hil.robot.compiled_effects import ActiveEffect, EffectError, drags
from terrapin_hil.robot.plant import Ground, Robot, SoftGround

__all__ = [
    "GripTable",
    "affected",
    "affects_soil",
    "cannot_roll",
    "check_step",
    "contact_steady",
    "grip_tables",
    "read_soft_ground",
]

SOIL_TARGETS = ("k_s", "cohesion", "recovery")
ACCURACY = 1e-4  # of each value, or of 1 % of its scale: load, load, load R, greatest sinkage
MOST_SLIPS, MOST_LOADS = 2049, 65


@dataclass(frozen=True)
class GripTable:
    """hil_grip_table of a run: `row` is (loads, slips, VALUES, 2), value and derivative by slip, slips from -1 to 1."""

    loads: Array  # (loads,) [N], rising
    row: Array
    bulldozing: tuple[float, float, float, float]  # hil_bulldozing
    error: float  # greatest errors found half-way between nodes, along slip and load, added: a share of ACCURACY

    def native(self) -> Any:
        """hil_grip_table *; this object must outlive it."""
        step = float(self.loads[1] - self.loads[0]) if len(self.loads) > 1 else 1.0
        data = ffi().cast("double *", self.row.ctypes.data)
        return ffi().new("hil_grip_table *", (*self.row.shape[:2], float(self.loads[0]), step, data, self.bulldozing))


def affects_soil(effect: Effect) -> bool:
    """Whether `effect` changes the soil of a whole run: an effect of a contact that needs no motion."""
    names = parse(effect.expression).names - {parameter.name for parameter in effect.parameters}
    contact = any(SoftGround.base_of(shape) in effect.bases for shape in get_args(Shape))
    return contact and effect.target in SOIL_TARGETS and names <= {"pass_", "moisture"}


def affected(
    ground: Ground, effects: tuple[ActiveEffect, ...], pass_number: float, moisture: float
) -> tuple[Ground, tuple[ActiveEffect, ...]]:
    """The ground as the effects on its soil leave it, and the effects that act on the robot as it moves.

    Without contact model all effects are of the second kind. EffectError where an effect would act on Table 1's
    resistance, which a contact model does not have; ContactError where the soil that comes out is none.
    """
    soft = ground.contact
    if soft is None:
        return ground, effects
    rest = []
    for active in effects:
        effect = active.effect
        if effect.target == "f_o":
            raise EffectError(f'{effect.name}: acts on f_o, which ground = "contact" does not have')
        if not (affects_soil(effect) or drags(effect)):
            rest.append(active)
            continue
        if soft.base not in effect.bases:
            raise EffectError(f"{effect.name}: found a {soft.shape}, expected {' or '.join(effect.bases)}")
        if drags(effect):
            if effect.constants and not all(any(bulldozing_of(each, 1.0)[2:]) for each in ground.soils):
                raise EffectError(f"{effect.name}: expected {', '.join(effect.constants)} in [soil]")
            rest.append(active)
            continue
        values = {**active.values, "pass_": pass_number, "moisture": moisture}
        change = float(parse(effect.expression).evaluate(values))
        segments = tuple(
            replace(s, contact=None if s.contact is None else _changed(s.contact, effect, change))
            for s in ground.segments
        )
        soft = _changed(soft, effect, change)
        ground = replace(ground, contact=soft, segments=segments)
    return ground, tuple(rest)


def _changed(soft: SoftGround, effect: Effect, change: float) -> SoftGround:
    """The soil with an effect on it."""
    soil = soft.soil
    if effect.target == "recovery":
        contact.check("recovery", np.array([soft.recovery + change]))
        return replace(soft, recovery=soft.recovery + change)
    if effect.target == "cohesion":
        return replace(soft, soil=replace(soil, cohesion=soil.cohesion + change))
    return replace(soft, soil=replace(soil, k_c=soil.k_c * (1.0 + change), k_phi=soil.k_phi * (1.0 + change)))


def bulldozing_of(ground: SoftGround, radius: float) -> tuple[float, float, float, float]:
    """hil_bulldozing of a soil under a shell of `radius` [m]; strengths 0 where the soil lacks numbers of Eq. 8."""
    soil, width = ground.soil, ground.width if ground.shape == "wheel" else 0.0
    if soil.unit_weight is None or soil.n_c is None or soil.n_gamma is None or soil.friction_angle <= 0.0:
        return radius, width, 0.0, 0.0
    k_l, k_g = sphere.bulldozing_factors(soil.friction_angle, soil.n_c, soil.n_gamma)
    return radius, width, 0.67 * soil.cohesion * float(k_l), soil.unit_weight * float(k_g)


def _fields(ground: SoftGround, radius: float, slip: Rows) -> dict[str, Rows]:
    """hil_contact_point by its names (contact.FIELDS). ValueError where the soil lacks one."""
    footing, soil = ground.soil.footing(ground.width), ground.soil
    peak = (0.5, 0.0)
    if ground.shape == "sphere":
        if soil.c1 is None or soil.c2 is None:
            raise ValueError(
                f"c1, c2: {soil.source} states none for {soil.name}, expected numbers: a sphere needs both"
            )
        peak = soil.c1, soil.c2
    given = (slip, radius, ground.width, *footing, *peak, ground.recovery)
    return dict(zip(FIELDS, given, strict=True))


def _contact(ground: SoftGround, radius: float, load: Rows, slip: Rows) -> contact.Contact:
    """Contacts that carry the loads [N]. ContactError says why where none does."""
    return contact.contact(ground.shape, False, _fields(ground, radius, slip), False, load=load)


def _exact(ground: SoftGround, radius: float, load: Array, slip: Array) -> tuple[Array, Array]:
    """VALUES (points, 4) and their derivatives by the plant's slip. ContactError where no sinkage carries a load."""
    return grip.exact(ground.shape, lambda inner: _fields(ground, radius, inner), radius, load, slip)


def _grid(ground: SoftGround, radius: float, loads: Array, slips: Array) -> Array:
    return grip.grid(ground.shape, lambda inner: _fields(ground, radius, inner), radius, loads, slips)


def _miss(found: Array, exact: Array, scale: Array) -> float:
    """Greatest error relative to the value, or to 1 % of the scale where that is more."""
    return float((np.abs(found - exact) / np.maximum(np.abs(exact), 0.01 * scale)).max())


@lru_cache(maxsize=32)  # of some 100 kB each; a batch may draw a soil a run
def _table(soft: SoftGround, radius: float, weight: float, steepest: float) -> GripTable:
    """Refined until values half-way between nodes are within ACCURACY of the integrals."""
    check_soft_ground(soft, radius, weight, steepest)
    low, high = weight * math.cos(steepest), weight
    deepest = float(_exact(soft, radius, np.array([high]), np.array([1.0]))[0][0, 3])
    scale = np.array([high, high, high * radius, deepest])
    slips, count = 65, 1 if high - low < 1e-12 * high else 3
    while True:
        nodes, loads = np.linspace(-1.0, 1.0, slips), np.linspace(low, high, count)
        row = _grid(soft, radius, loads, nodes)
        middle = _grid(soft, radius, loads[[0, -1]], 0.5 * (nodes[1:] + nodes[:-1]))[..., 0]
        ends = row[[0, -1]]
        step = nodes[1] - nodes[0]
        hermite = 0.5 * (ends[:, 1:, :, 0] + ends[:, :-1, :, 0]) + step / 8 * (ends[:, :-1, :, 1] - ends[:, 1:, :, 1])
        along = _miss(hermite, middle, scale)
        across = 0.0
        if count > 1:
            between = _grid(soft, radius, 0.5 * (loads[1:] + loads[:-1]), nodes[::8])[..., 0]
            across = _miss(0.5 * (row[1:, ::8, :, 0] + row[:-1, ::8, :, 0]), between, scale)
        enough = 0.3 * ACCURACY  # both add up, and elsewhere between the nodes it may be a little more
        if max(along, across) <= enough:
            pushed = bulldozing_of(soft, radius)
            return GripTable(loads, np.ascontiguousarray(row), pushed, (along + across) / ACCURACY)
        if (along > enough and slips >= MOST_SLIPS) or (across > enough and count >= MOST_LOADS):
            raise ContactError(
                f"contact table: found an error of {max(along, across):.2g}, expected at most {ACCURACY:g}"
            )
        slips = 2 * slips - 1 if along > enough else slips
        count = 2 * count - 1 if across > enough else count


def grip_tables(ground: Ground, robot: Robot) -> list[GripTable | None]:
    """The table of each segment, None where it is firm; equal soils share one. Loads are those of all slopes.

    ContactError for soils and loads without equilibrium, or where ACCURACY is not reached.
    """
    steepest = max(abs(segment.slope) for segment in ground.segments)
    soils = [None if segment.firm else segment.contact or ground.contact for segment in ground.segments]
    return [None if soft is None else _table(soft, robot.radius, robot.weight, steepest) for soft in soils]


def cannot_roll(ground: Ground, robot: Robot, effects: tuple[ActiveEffect, ...]) -> str:
    """A line that says so where gravity holds less torque than rolling on takes, level, on a soil of the path; else "".

    `effects` are those of the run (those on the soil in the ground already).
    """
    arm = robot.arm * robot.body_mass + (robot.radius - robot.drive_radius) * robot.drive_mass
    holds = arm * robot.gravity
    for soft in dict.fromkeys(ground.soils):
        row = _table(soft, robot.radius, robot.weight, 0.0).row[-1, :, :, 0]  # (slips, VALUES)
        slips = np.linspace(-1.0, 1.0, len(row))
        driving = (slips >= 0.0) & (slips < 1.0)
        slip, (thrust, compaction, lever, sinkage) = slips[driving], row[driving].T
        depth = np.minimum(sinkage + ground.slip_depth * slip / (1.0 - slip), robot.radius)
        sand = ffi().new("hil_bulldozing *", bulldozing_of(soft, robot.radius))
        pushed = np.array([library().hil_bulldozing_resistance(sand, z) for z in depth])
        known: dict[str, Rows] = {"slip": slip, "load": robot.weight, "bulldozing_resistance": pushed}
        resistance = compaction.copy()
        for active in effects:
            if drags(active.effect):
                values: dict[str, Rows] = {**active.effect.options, **active.values, **known}
                resistance += parse(active.effect.expression).evaluate(values)
        pull, torque = thrust - resistance, lever + robot.radius * thrust
        pulls = np.flatnonzero(pull >= 0.0)
        needed = math.inf
        if pulls.size:
            last = slice(max(int(pulls[0]) - 1, 0), int(pulls[0]) + 1)  # the zero lies between these
            needed = float(np.interp(0.0, pull[last], torque[last]))
        if needed > holds:
            takes = f"rolling on takes {needed:.3g} N m" if pulls.size else "no slip gives pull enough to roll on"
            return f"gravity holds {holds:.3g} N m, and on {soft.soil.name} {takes}: the robot cannot roll on there"
    return ""


def read_soft_ground(section: Section) -> SoftGround:
    """[soil]: `name` of the library, or `form`, `exponent` and values; values beside a name change it. ReadingError."""
    library = soils.library()
    shape: Shape = "sphere" if section.choice("shape", ("wheel", "sphere"), "wheel") == "sphere" else "wheel"
    width = section.quantity("width", "m", 0.15, 1e-4, 10.0)
    if "name" in section:
        base = library[section.choice("name", library)]
        needed: tuple[str, ...] = ()
    else:
        form = section.choice("form", ("bekker", "reece"))
        exponent = section.quantity("exponent", "1", None, 1e-3, 3.0)
        base = soils.Soil("values", "the scenario", "reece", exponent, 0.0, 1.0, 0.0, 0.0)
        base = replace(base, form="bekker" if form == "bekker" else "reece")
        needed = ("k_c", "k_phi", "cohesion", "friction_angle", "shear_modulus")

    def read(field: str) -> float:
        def convert(value: Any) -> float:
            if isinstance(value, str):
                return soils.number(value, base.unit(field))
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"found {shorten(value)}, expected a number or a text with unit {base.unit(field)}")
            return float(value)

        return section.value(field, convert)

    fields = ("k_c", "k_phi", "cohesion", "friction_angle", "shear_modulus", "unit_weight")
    values: dict[str, Any] = {field: read(field) for field in fields if field in section or field in needed}
    for name, low, high in (("c1", -1.0, 2.0), ("c2", -2.0, 2.0), ("n_c", 0.0, 1e3), ("n_gamma", 0.0, 1e3)):
        if name in section:
            values[name] = section.quantity(name, "1", None, low, high)
    section.done()
    try:
        ground = SoftGround(replace(base, **values), width, shape=shape)
        _fields(ground, 1.0, 0.0)
    except ValueError as error:
        raise section.error(None, str(error)) from None
    return ground


def check_soft_ground(ground: SoftGround, radius: float, weight: float, steepest: float) -> None:
    """ContactError or ValueError where the soil, at any slip and any slope up to `steepest`, cannot carry a robot."""
    loads = weight * np.cos([0.0, 0.0, 0.0, steepest])
    _contact(ground, radius, loads, np.array([-1.0, 0.0, 1.0, 1.0]))


def check_step(ground: SoftGround, robot: Robot, step: float, speed: float) -> None:
    """ContactError where the rim, at `speed` [m/s], passes over a quarter of the contact's length in `step` [s]."""
    entry = _contact(ground, robot.radius, robot.weight, 0.0).entry
    longest = 0.25 * robot.radius * math.sin(float(entry[0])) / max(abs(speed), 1e-9)
    if not 0.0 < step <= longest:
        raise ContactError(
            f"step: found {step:g} s, expected more than 0 s and at most {longest:.3g} s at {speed:.3g} m/s of the rim"
        )


def contact_steady(robot: Robot, ground: SoftGround, voltage: npt.ArrayLike) -> dict[str, Array]:
    """Steady rolling on the level, with slip from the contact model, against motor voltage (Reina et al., Fig. 7).

    Drawbar pull is zero at one slip, whatever the speed; its torque and the motor's line give omega.

    Parameters
    ----------
    voltage : V, (voltages,).

    Returns
    -------
    Arrays (voltages,) of slip, omega [rad/s], speed [m/s], torque [N m], sinkage [m], current [A]. Below the starting
    voltage omega and speed are 0, and the current is what the winding takes at rest.

    Raises
    ------
    ContactError : the soil gives no such slip.
    """
    from scipy.optimize import brentq  # takes half a second, which a run does not need

    volts = np.atleast_1d(np.asarray(voltage, dtype=np.float64))

    def pull(slip: float) -> float:
        return float(_contact(ground, robot.radius, robot.weight, slip).traction[0])

    if not pull(0.0) < 0.0 < pull(1.0):
        raise ContactError(f"drawbar pull: found {pull(1.0):.4g} N at slip 1, expected more than 0 N to move at all")
    slip = float(brentq(pull, 0.0, 1.0, xtol=1e-13, rtol=1e-14))
    c = _contact(ground, robot.radius, robot.weight, slip)
    gear = robot.radius / robot.drive_radius
    drive = gear * robot.torque_constant / robot.armature_resistance
    eta = robot.gear_efficiency
    line = eta * (drive * gear * robot.torque_constant + robot.motor_viscous) + robot.viscous
    omega = np.maximum((eta * (drive * volts - robot.motor_coulomb) - robot.coulomb - c.torque[0]) / line, 0.0)
    current = (volts - robot.torque_constant * gear * omega) / robot.armature_resistance
    ones = np.ones_like(volts)
    return {
        "voltage": volts,
        "slip": slip * ones,
        "omega": omega,
        "speed": robot.radius * omega * (1.0 - slip),
        "torque": c.torque[0] * ones,
        "sinkage": c.sinkage[0] * ones,
        "current": current,
    }
