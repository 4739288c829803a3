"""The plant's `ground = "contact"`: tables of the wheel's contact for one run, and what follows for steady rolling.

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
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.library import ffi
from terrapin_hil.physics import contact, soils, wheel
from terrapin_hil.physics.contact import FIELDS, Array, ContactError
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import parse
from terrapin_hil.reading import Section, shorten
from terrapin_hil.robot.compiled_effects import ActiveEffect, EffectError
from terrapin_hil.robot.plant import Ground, Robot, SoftGround

__all__ = ["GripTable", "affected", "affects_soil", "check_step", "contact_steady", "grip_table", "read_soft_ground"]

SOIL_TARGETS = ("k_s", "cohesion", "recovery")
VALUES = ("thrust", "compaction", "lever", "sinkage")
ACCURACY = 1e-4  # of each value, or of 1 % of its scale: load, load, load R, greatest sinkage
MOST_SLIPS, MOST_LOADS = 2049, 65


@dataclass(frozen=True)
class GripTable:
    """hil_grip_table of a run: `row` is (loads, slips, VALUES, 2), value and derivative by slip, slips from -1 to 1."""

    loads: Array  # (loads,) [N], rising
    row: Array
    error: float  # greatest errors found half-way between nodes, along slip and load, added: a share of ACCURACY

    def native(self) -> Any:
        """hil_grip_table *; this object must outlive it."""
        step = float(self.loads[1] - self.loads[0]) if len(self.loads) > 1 else 1.0
        data = ffi().cast("double *", self.row.ctypes.data)
        return ffi().new("hil_grip_table *", (*self.row.shape[:2], float(self.loads[0]), step, data))


def affects_soil(effect: Effect) -> bool:
    """Whether `effect` changes the soil of a whole run: an effect of the wheel's contact that needs no motion."""
    names = parse(effect.expression).names - {parameter.name for parameter in effect.parameters}
    return SoftGround.base in effect.bases and effect.target in SOIL_TARGETS and names <= {"pass_", "moisture"}


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
        if not affects_soil(effect):
            rest.append(active)
            continue
        values = {**active.values, "pass_": pass_number, "moisture": moisture}
        change = float(parse(effect.expression).evaluate(values))
        if effect.target == "recovery":
            contact.check("recovery", np.array([soft.recovery + change]))
            soft = replace(soft, recovery=soft.recovery + change)
        elif effect.target == "cohesion":
            soft = replace(soft, soil=replace(soft.soil, cohesion=soft.soil.cohesion + change))
        else:
            soil = soft.soil
            soft = replace(soft, soil=replace(soil, k_c=soil.k_c * (1.0 + change), k_phi=soil.k_phi * (1.0 + change)))
    return replace(ground, contact=soft), tuple(rest)


def _soil(ground: SoftGround) -> wheel.Soil:
    return replace(wheel.soil_of(ground.soil, ground.width), recovery=ground.recovery)


def _exact(ground: SoftGround, radius: float, load: Array, slip: Array) -> tuple[Array, Array]:
    """VALUES (points, 4) and their derivatives by the plant's slip. ContactError where no sinkage carries a load."""
    soil = _soil(ground)
    share = np.maximum(1.0 + np.minimum(slip, 0.0), 1e-9)  # slip and R omega / v - 1 agree when driving only
    inner = np.where(slip < 0.0, np.minimum(slip, 0.0) / share, slip)
    stiffness = (soil.k_c + soil.k_phi * ground.width) * ground.width ** -float(soil.exponent)
    given = (inner, radius, ground.width, stiffness, soil.exponent, soil.cohesion, soil.friction_angle)
    fields = dict(zip(FIELDS, (*given, soil.shear_modulus, 0.5, 0.0, ground.recovery), strict=True))
    packed = contact.points(fields, len(load))
    entry, value, slopes, status = contact.equilibrium("wheel", False, packed, load, None, derivatives=True)
    assert slopes is not None
    if status.any():
        at = int(np.flatnonzero(status)[0])
        wheel.solve(load[at], float(np.clip(slip[at], -1.0, 1.0)), radius, ground.width, soil)  # says why
        raise ContactError(f"load: found {load[at]:.6g} N at slip {slip[at]:.3g}: no sinkage carries it")
    bare = packed.copy()
    bare[:, FIELDS.index("cohesion")] = bare[:, FIELDS.index("friction_angle")] = 0.0
    pressed, by_pressed = contact.evaluate("wheel", False, bare, entry, derivatives=True)
    assert by_pressed is not None
    inward = np.where(slip < 0.0, 1.0 / share**2, 1.0)
    follow = -slopes[:, 0, 1] / slopes[:, 0, 0]  # of the entry angle, the load held
    total = (slopes[:, :, 1] + slopes[:, :, 0] * follow[:, None]) * inward[:, None]
    compaction, compaction_by = -pressed[:, 1], -by_pressed[:, 1, 0] * follow * inward
    thrust, thrust_by = value[:, 1] + compaction, total[:, 1] + compaction_by
    depth, depth_by = 2.0 * radius * np.sin(0.5 * entry) ** 2, radius * np.sin(entry) * follow * inward
    values = np.stack([thrust, compaction, value[:, 2] - radius * thrust, depth], axis=1)
    by = np.stack([thrust_by, compaction_by, total[:, 2] - radius * thrust_by, depth_by], axis=1)
    return values, by


def _grid(ground: SoftGround, radius: float, loads: Array, slips: Array) -> Array:
    load, slip = (a.ravel() for a in np.meshgrid(loads, slips, indexing="ij"))
    values, by = _exact(ground, radius, load, slip)
    # A locked shell shears without end: its slope is that of one that hardly turns
    by[slip <= -1.0] = _exact(ground, radius, load, np.maximum(slip, -0.999))[1][slip <= -1.0]
    return np.stack([values, by], axis=-1).reshape(len(loads), len(slips), len(VALUES), 2)


def _miss(found: Array, exact: Array, scale: Array) -> float:
    """Greatest error relative to the value, or to 1 % of the scale where that is more."""
    return float((np.abs(found - exact) / np.maximum(np.abs(exact), 0.01 * scale)).max())


@lru_cache(maxsize=32)  # of some 100 kB each; a batch may draw a soil a run
def grip_table(ground: Ground, robot: Robot) -> GripTable:
    """The table for a robot on the path: loads of its slopes, refined until values half-way between nodes are within
    ACCURACY of the integrals. ContactError for soils and loads without equilibrium, or where that is not reached.
    """
    soft = ground.contact
    assert soft is not None
    steepest = max(abs(segment.slope) for segment in ground.segments)
    check_soft_ground(soft, robot, steepest)
    low, high = robot.weight * math.cos(steepest), robot.weight
    deepest = float(_exact(soft, robot.radius, np.array([high]), np.array([1.0]))[0][0, 3])
    scale = np.array([high, high, high * robot.radius, deepest])
    slips, count = 65, 1 if high - low < 1e-12 * high else 3
    while True:
        nodes, loads = np.linspace(-1.0, 1.0, slips), np.linspace(low, high, count)
        row = _grid(soft, robot.radius, loads, nodes)
        middle = _grid(soft, robot.radius, loads[[0, -1]], 0.5 * (nodes[1:] + nodes[:-1]))[..., 0]
        ends = row[[0, -1]]
        step = nodes[1] - nodes[0]
        hermite = 0.5 * (ends[:, 1:, :, 0] + ends[:, :-1, :, 0]) + step / 8 * (ends[:, :-1, :, 1] - ends[:, 1:, :, 1])
        along = _miss(hermite, middle, scale)
        across = 0.0
        if count > 1:
            between = _grid(soft, robot.radius, 0.5 * (loads[1:] + loads[:-1]), nodes[::8])[..., 0]
            across = _miss(0.5 * (row[1:, ::8, :, 0] + row[:-1, ::8, :, 0]), between, scale)
        enough = 0.3 * ACCURACY  # both add up, and elsewhere between the nodes it may be a little more
        if max(along, across) <= enough:
            return GripTable(loads, np.ascontiguousarray(row), (along + across) / ACCURACY)
        if (along > enough and slips >= MOST_SLIPS) or (across > enough and count >= MOST_LOADS):
            raise ContactError(
                f"contact table: found an error of {max(along, across):.2g}, expected at most {ACCURACY:g}"
            )
        slips = 2 * slips - 1 if along > enough else slips
        count = 2 * count - 1 if across > enough else count


def read_soft_ground(section: Section) -> SoftGround:
    """[soil]: `name` of the library, or `form`, `exponent` and values; values beside a name change it. ReadingError."""
    library = soils.library()
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
                try:
                    return soils.number(field, value, base.unit(field))
                except ValueError as error:
                    raise ValueError(str(error).removeprefix(f"{field}: ")) from None
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"found {shorten(value)}, expected a number or a text with unit {base.unit(field)}")
            return float(value)

        return section.value(field, convert)

    fields = ("k_c", "k_phi", "cohesion", "friction_angle", "shear_modulus")
    values: dict[str, Any] = {field: read(field) for field in fields if field in section or field in needed}
    section.done()
    try:
        ground = SoftGround(replace(base, **values), width)
        wheel.soil_of(ground.soil, width)
    except ValueError as error:
        raise section.error(None, str(error)) from None
    return ground


def check_soft_ground(ground: SoftGround, robot: Robot, steepest: float = 0.0) -> None:
    """ContactError or ValueError where the soil, at any slip and on any slope up to `steepest`, cannot carry it."""
    soil = _soil(ground)
    loads = robot.weight * np.cos([0.0, 0.0, 0.0, steepest])
    wheel.solve(loads, np.array([-1.0, 0.0, 1.0, 1.0]), robot.radius, ground.width, soil)


def check_step(ground: SoftGround, robot: Robot, step: float, speed: float) -> None:
    """ContactError where the rim, at `speed` [m/s], passes over a quarter of the contact's length in `step` [s]."""
    entry = wheel.entry_angle(robot.weight, 0.0, robot.radius, ground.width, _soil(ground))
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
    soil = _soil(ground)

    def pull(slip: float) -> float:
        return float(wheel.solve(robot.weight, slip, robot.radius, ground.width, soil).traction[0])

    if not pull(0.0) < 0.0 < pull(1.0):
        raise ContactError(f"drawbar pull: found {pull(1.0):.4g} N at slip 1, expected more than 0 N to move at all")
    slip = float(brentq(pull, 0.0, 1.0, xtol=1e-13, rtol=1e-14))
    c = wheel.solve(robot.weight, slip, robot.radius, ground.width, soil)
    gear = robot.radius / robot.drive_radius
    drive = gear * robot.torque_constant / robot.armature_resistance
    line = drive * gear * robot.torque_constant + robot.viscous
    omega = np.maximum((drive * volts - robot.coulomb - c.torque[0]) / line, 0.0)
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
