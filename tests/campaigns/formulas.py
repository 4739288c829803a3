"""The contract's formulas once more, written for the campaigns alone: plain numpy, nothing of the engine.

A wrong formula in the engine would go unseen if the engine made the data that it is tested on. `predict` gives what a
perfect sensor would read; tests/python/test_campaigns.py holds the engine's models against it for every effect.
Sources: docs/cases.md; Li et al. 2024 Eqs. (1) to (10); Reina et al. 2006 Eqs. (2), (9) to (15) as corrected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Columns = Mapping[str, Array]
Effects = Mapping[str, Mapping[str, float]]  # effect -> its parameters

SKIDS = 0.2  # below this slip the rim's discs may skid: the shear stress then has a kink, and nodes help little


@dataclass(frozen=True)
class Foreign:
    """A hidden term that no catalogue has: `amount(columns, k)` is added to `target`."""

    text: str
    target: str  # "resistance", or a channel
    column: str  # what it depends on first of all
    amount: Callable[[Columns, float], Array]


def predict(
    base: str, constants: Mapping[str, float], columns: Columns, effects: Effects, foreign: tuple[Foreign, float] | None
) -> dict[str, Array]:
    """Channels (rows,) in SI. `constants` are all parameters of the base model and the known ones of its effects."""
    if base == "rolling_steady":
        return {"current": _rolling(constants, columns, effects, foreign)}
    if base in ("sphere_contact", "wheel_contact"):
        return _contact(base, constants, columns, effects, foreign)
    channels = EQUATIONS[base].channels(constants, columns)
    if foreign is not None:
        channels[foreign[0].target] = channels[foreign[0].target] + foreign[0].amount(columns, foreign[1])
    return channels


def _rolling(
    constants: Mapping[str, float], columns: Columns, effects: Effects, foreign: tuple[Foreign, float] | None
) -> Array:
    """(R/r) K_t i = f_o R W sgn(omega) + A sgn(omega) + B omega + dC, solved for i."""
    omega = columns["omega"]
    direction = np.sign(omega)
    radius, torque_constant = constants["radius"], constants["torque_constant"]
    load = columns["load"] if "load" in columns else np.full(len(omega), constants["load"])
    speed = columns.get("speed", radius * omega)
    torque = (constants["f_o"] * radius * load + constants["coulomb"]) * direction + constants["viscous"] * omega
    offset = 0.0
    factor = np.ones(len(omega))
    for name, p in effects.items():
        if name == "speed_squared":
            torque = torque + p["f_s"] * omega * omega * radius * load * direction
        elif name == "aerodynamic_drag":
            torque = torque + 0.6125 * p["cda"] * speed * np.abs(speed) * radius
        elif name == "slope":
            torque = torque + p["gain"] * load * np.sin(columns["slope"]) * radius
        elif name == "coulomb_friction":
            torque = torque + p["da"] * direction
        elif name == "viscous_friction":
            torque = torque + p["b"] * omega
        elif name == "stribeck":
            torque = torque + p["a_s"] * np.exp(-((omega / p["omega_s"]) ** 2)) * direction
        elif name == "inertia":
            torque = torque + p["j"] * columns["acceleration"]
        elif name == "shell_imbalance":
            torque = torque + p["m_e"] * np.sin(columns["angle"] + p["phase"])
        elif name == "cogging":
            torque = torque + p["m_c"] * np.sin(p["k"] * columns["angle"] + p["phase"])
        elif name == "motor_heating":
            factor = factor * (1.0 - p["a_t"] * (columns["temperature"] - 25.0))
        elif name == "current_offset":
            offset += p["i_0"]
        else:
            raise KeyError(name)
    if foreign is not None and foreign[0].target == "resistance":
        torque = torque + foreign[0].amount(columns, foreign[1])
    current = torque * constants["drive_radius"] / (radius * torque_constant * factor) + offset
    if foreign is not None and foreign[0].target == "current":
        current = current + foreign[0].amount(columns, foreign[1])
    return np.asarray(current)


def _contact(
    base: str, constants: Mapping[str, float], columns: Columns, effects: Effects, foreign: tuple[Foreign, float] | None
) -> dict[str, Array]:
    """Traction, torque, sinkage. Rows of one setting are worked out once."""
    wanted = ("slip", "load", "speed", "pass", "moisture")
    stacked = np.column_stack([columns[name] for name in wanted if name in columns])
    settings, back = np.unique(stacked, axis=0, return_inverse=True)
    one = dict(zip([name for name in wanted if name in columns], settings.T, strict=True))
    channels = _settled(base, constants, one, effects)
    channels = {name: values[back.reshape(-1)] for name, values in channels.items()}
    if foreign is not None:
        channels[foreign[0].target] = channels[foreign[0].target] + foreign[0].amount(columns, foreign[1])
    if "force_offset" in effects:
        channels["traction"] = channels["traction"] + effects["force_offset"]["f_0"]
    if "torque_gain" in effects:
        channels["torque"] = channels["torque"] * (1.0 + effects["torque_gain"]["g"])
    return channels


def _settled(base: str, constants: Mapping[str, float], columns: Columns, effects: Effects) -> dict[str, Array]:
    """The wheel or sphere in balance with its load, without what acts on whole channels."""
    slip, load = columns["slip"], columns["load"]
    radius = constants["radius"]
    stiffer = np.ones(len(slip))
    if "rate_effect" in effects:
        stiffer = stiffer * (columns["speed"] / 0.1) ** effects["rate_effect"]["m"]
    if "multipass" in effects:
        stiffer = stiffer * columns["pass"] ** effects["multipass"]["kappa"]
    cohesion = np.full(len(slip), constants["cohesion"])
    if "moisture_cohesion" in effects:
        cohesion = cohesion + effects["moisture_cohesion"]["c_w"] * columns["moisture"]
    lam = effects["rut_recovery"]["lam"] if "rut_recovery" in effects else 0.0
    follows = effects.get("n_follows_slip", {"share": 0.0})["share"]  # in no catalogue: n (1 + share s)
    exponent = constants["n"] * (1.0 + follows * slip)

    skids = slip < SKIDS

    def carried(entry: Array) -> tuple[Array, Array, Array]:
        found = np.zeros((3, len(slip)))
        for rows, grid in ((skids, FINE), (~skids, COARSE)):
            if rows.any():
                rest = (slip[rows], stiffer[rows], cohesion[rows], exponent[rows], lam, grid)
                found[:, rows] = _integrals(base, constants, entry[rows], *rest)
        return found[0], found[1], found[2]

    entry = _entry(lambda angle: carried(angle)[0], load)
    _, traction, torque = carried(entry)
    pushed = _bulldozing(base, constants, entry, cohesion) if "unit_weight" in constants else np.zeros(len(slip))
    for name, p in effects.items():
        law, _, at_axle = name.partition("_at_")
        if law == "bulldozing":
            push = p["scale"] * pushed
        elif law == "slip_sinkage":
            push = p["xi1"] * load * np.maximum(slip - p["xi2"], 0.0) ** p["xi3"]
        elif law == "rut":  # what its depth adds to what is pushed at the sinkage
            deep = np.arccos(np.cos(entry) - p["rut_depth"] * slip / (1.0 - slip) / radius)
            push = _bulldozing(base, constants, deep, cohesion) - pushed
        else:
            continue
        traction, torque = traction - push, torque - (0.0 if at_axle else radius) * push
    if "bearing_friction" in effects:
        torque = torque + effects["bearing_friction"]["t_b"]
    return {"traction": traction, "torque": torque, "sinkage": radius * (1.0 - np.cos(entry))}


def _legendre(count: int) -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 + 0.5 * x, 0.5 * w


Grid = tuple[tuple[Array, Array], tuple[Array, Array]]  # across the half width, and along each zone of stress
COARSE: Grid = (_legendre(12), _legendre(20))  # 1e-6 of the forces
FINE: Grid = (_legendre(32), _legendre(48))


def _integrals(
    base: str,
    c: Mapping[str, float],
    entry: Array,
    slip: Array,
    stiffer: Array,
    cohesion: Array,
    exponent: Array,
    lam: float,
    grid: Grid,
) -> tuple[Array, Array, Array]:
    """Vertical force, traction, torque: integrals of the stresses over discs and angle, shapes (rows, discs, angle)."""
    (across, across_weight), (along, along_weight) = grid
    big, power = c["radius"], exponent[:, None]
    if base == "sphere_contact":
        rim = big * np.sin(entry)[:, None]
        x = rim * np.sin(0.5 * np.pi * across)  # x = rim sin(u) takes the root at the rim out of the integrand
        thickness = 2.0 * rim * 0.5 * np.pi * np.cos(0.5 * np.pi * across) * across_weight
        r = np.sqrt(big * big - x * x)
        first = np.arccos(np.clip(big * np.cos(entry)[:, None] / r, -1.0, 1.0))
        disc_slip = (r - big * (1.0 - slip)[:, None]) / r
        peak = (c["c1"] + c["c2"] * disc_slip) * first
        pressure = c["k_s"] * stiffer[:, None] * r**power
    else:
        r, first = np.full((len(entry), 1), big), entry[:, None]
        thickness = np.full((len(entry), 1), c["width"])
        disc_slip, peak = slip[:, None], 0.5 * first
        pressure = stiffer[:, None] * (c["k_c"] + c["k_phi"] * c["width"]) * (big / c["width"]) ** power
    last = -lam * first
    linear = c.get("stress_linear", 0.0) > 0.0
    total = [np.zeros(len(entry)) for _ in range(3)]

    def height(angle: Array) -> Array:
        return np.maximum(np.cos(angle) - np.cos(first[..., None]), 0.0)

    def shear(angle: Array, sigma: Array) -> Array:
        one, rolled = first[..., None], 1.0 - disc_slip[..., None]
        j = r[..., None] * ((one - angle) - rolled * (np.sin(one) - np.sin(angle)))
        strength = cohesion[:, None, None] + sigma * np.tan(c["friction_angle"])
        return np.sign(j) * strength * (1.0 - np.exp(-np.abs(j) / c["shear_modulus"]))

    at_peak = peak[..., None]
    sigma_peak = pressure[..., None] * height(at_peak) ** power[..., None]
    tau_peak = shear(at_peak, sigma_peak)
    for begin, end, front in ((peak, first, True), (last, peak, False)):
        length = (end - begin)[..., None]
        # nodes crowd towards the zone's outer end, where sigma leaves 0 like a power
        angle = end[..., None] - length * along**2 if front else begin[..., None] + length * along**2
        share = (end[..., None] - angle) / length if front else (angle - begin[..., None]) / length
        if linear:
            sigma, tau = sigma_peak * share, tau_peak * share
        else:
            mapped = angle
            if not front:
                mapped = first[..., None] - (angle - begin[..., None]) * ((first - peak) / (peak - last))[..., None]
            sigma = pressure[..., None] * height(mapped) ** power[..., None]
            tau = shear(angle, sigma)
        area = thickness[..., None] * r[..., None] * length * (2.0 * along * along_weight)
        total[0] += ((sigma * np.cos(angle) + tau * np.sin(angle)) * area).sum((1, 2))
        total[1] += ((tau * np.cos(angle) - sigma * np.sin(angle)) * area).sum((1, 2))
        total[2] += (tau * r[..., None] * area).sum((1, 2))
    return total[0], total[1], total[2]


def _entry(vertical: Callable[[Array], Array], load: Array) -> Array:
    """Entry angle at which the ground carries the load: secant steps on logarithms (the force is nearly a power)."""
    old = np.full(len(load), 0.3)
    miss_old = np.log(vertical(old) / load)
    new = np.clip(old * np.exp(-miss_old / 4.0), 0.01, 1.5)
    for _ in range(40):
        miss = np.log(vertical(new) / load)
        if np.all(np.abs(miss) < 1e-10):
            return new
        moved = np.log(new / old)
        slope = np.where(np.abs(moved) > 1e-14, (miss - miss_old) / np.where(moved == 0.0, 1.0, moved), 4.0)
        slope = np.where((slope > 0.5) & (slope < 20.0), slope, 4.0)
        old, miss_old = new, miss
        new = np.clip(new * np.exp(-miss / slope), 0.01, 1.5)
    return np.full(len(load), np.nan)  # buried past its axle: the draw is thrown away


def _bulldozing(base: str, c: Mapping[str, float], entry: Array, cohesion: Array) -> Array:
    tangent = 2.0 / 3.0 * np.tan(c["friction_angle"])
    square = 1.0 / (1.0 + tangent**2)
    k_l, k_g = (c["n_c"] - tangent) * square, (2.0 * c["n_gamma"] / tangent + 1.0) * square
    radius = c["radius"]
    if base == "wheel_contact":
        z = radius * (1.0 - np.cos(entry))
        return np.asarray(c["width"] * (0.67 * cohesion * z * k_l + 0.5 * z * z * c["unit_weight"] * k_g))
    across, across_weight = FINE[0]
    rim = radius * np.sin(entry)[:, None]
    x = rim * np.sin(0.5 * np.pi * across)
    thickness = 2.0 * rim * 0.5 * np.pi * np.cos(0.5 * np.pi * across) * across_weight
    z = np.sqrt(radius**2 - x * x) - radius * np.cos(entry)[:, None]
    line = 0.67 * cohesion[:, None] * z * k_l + 0.5 * z * z * c["unit_weight"] * k_g
    return np.asarray((line * thickness).sum(1))


@dataclass(frozen=True)
class Equation:
    """A base model of the user's own: formulas as case.toml has them, and the same in numpy."""

    formulas: Mapping[str, str]
    channels: Callable[[Mapping[str, float], Columns], dict[str, Array]]
    units: Mapping[str, str]


EQUATIONS: Mapping[str, Equation] = {
    "equation:pipe": Equation(
        {"dp": "rl*flow"},
        lambda p, x: {"dp": p["rl"] * x["flow"]},
        {"flow": "1", "dp": "Pa"},
    ),
    "equation:carriage": Equation(
        {"force": "m*acceleration + fv*velocity"},
        lambda p, x: {"force": p["m"] * x["acceleration"] + p["fv"] * x["velocity"]},
        {"acceleration": "m/s^2", "velocity": "m/s", "force": "N"},
    ),
    "equation:winding": Equation(
        {"voltage": "r_a*current + k_e*speed"},
        lambda p, x: {"voltage": p["r_a"] * x["current"] + p["k_e"] * x["speed"]},
        {"current": "A", "speed": "rad/s", "voltage": "V"},
    ),
}
