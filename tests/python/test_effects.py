"""The catalogue: complete, consistent in its units, and each effect does to the model what its formula says."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from terrapin_hil.paths import ROOT
from terrapin_hil.physics import sphere
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.units import units
from terrapin_tools.workbench.bases import BASES, CHANNELS, ROLES, formula_name
from terrapin_tools.workbench.case.case import Case, parse_case
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.robot.firmware_parameters import export_parameters, torque_cost

SHIPPED = {
    *("speed_squared", "aerodynamic_drag", "slope", "coulomb_friction", "viscous_friction", "stribeck", "inertia"),
    *("shell_imbalance", "cogging", "motor_heating", "current_offset"),
    *("bulldozing", "slip_sinkage", "bearing_friction", "force_offset", "torque_gain", "rate_effect", "multipass"),
    *("moisture_cohesion", "rut_recovery"),
    *("load_transfer", "relaxation_length", "tyre_flexibility", "torque_ripple", "winding_temperature"),
    *("sensor_delay", "encoder_misalignment", "backlash", "gear_efficiency", "gear_behind_friction"),
    *("bulldozing_at_axle", "slip_sinkage_at_axle", "rut", "rut_at_axle", "swing_friction", "split_ground"),
    "input_delay",
}
STEADY = ("rolling_steady", "sphere_contact", "wheel_contact")  # models whose rows do not depend on each other
# effect -> the first of these models that it can be added to
ON = {name: base for name, effect in catalogue().items() for base in reversed(STEADY) if base in effect.bases}
R, DRIVE, K_T, A, B, F_O = 0.08, 0.018, 0.1, 0.012, 1e-3, 0.09
TABLE = {
    "omega": [3.0, -6.0, 8.0, 1.0],
    "load": [18.0, 25.0, 30.0, 20.0],
    "slope": [0.1, -0.05, 0.02, 0.0],
    "temperature": [25.0, 60.0, 40.0, 30.0],
    "angle": [0.3, 2.0, 5.0, 9.0],
    "acceleration": [0.5, -0.2, 0.0, 1.0],
    "slip": [0.2, 0.4, 0.6, 0.9],
    "speed": [0.05, 0.1, 0.2, 0.3],
    "pass": [1.0, 2.0, 3.0, 5.0],
    "moisture": [0.0, 0.05, 0.1, 0.15],
}


def _case(folder: Path, base: str, roles: list[str], effects: list[str], extra: str = "", known: str = "") -> Case:
    channels = BASES[base].channels
    names = [*roles, *channels]
    rows = [",".join(["run", *names])]
    rows += [",".join([f"r{i}", *(str(TABLE[r][i]) for r in roles), *("1" for _ in channels)]) for i in range(4)]
    (folder / "runs.csv").write_text("\n".join(rows) + "\n")
    columns = "".join(f'{n} = {{ column = "{n}", unit = "{ROLES.get(n) or CHANNELS[n]}" }}\n' for n in names)
    parameters = {
        "rolling_steady": (
            f"radius = {R}\ndrive_radius = {DRIVE}\ntorque_constant = {K_T}\ncoulomb = {A}\nviscous = {B}\n"
        ),
        "sphere_contact": (
            "radius = 0.22\nn = 0.97\ncohesion = 400\nfriction_angle = 0.7\nshear_modulus = 0.018\nc1 = 0.18\n"
            "c2 = 0.32\nunit_weight = 19600\nn_c = 20\nn_gamma = 6\n"
        ),
        "rolling_sphere": (
            "radius = 0.22\ndrive_radius = 0.01\ntorque_constant = 0.04\ncoulomb = 0.6\nviscous = 0.05\nn = 0.97\n"
            "cohesion = 0\nfriction_angle = 0.7\nshear_modulus = 0.018\nunit_weight = 19600\nn_c = 20\nn_gamma = 6\n"
            "c1 = 0.18\nc2 = 0.32\n"
        ),
        "wheel_contact": (
            "radius = 0.08\nwidth = 0.15\nk_phi = 1528e3\nn = 1.1\ncohesion = 700\nfriction_angle = 0.5\n"
            "shear_modulus = 0.025\nunit_weight = 16000\nn_c = 20\nn_gamma = 6\n"
        ),
    }[base]
    fit = {
        "rolling_steady": f"f_o = {{ value = {F_O} }}",
        "sphere_contact": "k_s = { value = 1.2e6 }",
        "rolling_sphere": "k_s = { value = 1.2e6 }",
        "wheel_contact": "k_c = { value = 24e3 }",
    }[base]
    text = (
        f'[case]\ntitle = "t"\n[model]\nbase = "{base}"\neffects = {effects!r}\n[parameters]\n{parameters}{known}'
        f'[fit]\n{fit}\n[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\n{columns}{extra}'
    )
    return parse_case(folder, text)


def _predict(case: Case, values: dict[str, float]) -> npt.NDArray[np.float64]:
    model = Model.of(case)
    theta = np.array([values.get(f.key, f.start) for f in model.fitted], dtype=np.float64)
    return model.bind(case.inputs).predict(theta)


ROLES_ROLLING = ["omega", "load", "slope", "temperature", "angle", "acceleration"]
SOIL = ("unit_weight", "n_c", "n_gamma")  # constants of effects that _case states
ROLES_CONTACT = ["slip", "load", "speed", "pass", "moisture"]


def _torque_change(folder: Path, name: str, values: dict[str, float]) -> npt.NDArray[np.float64]:
    base = _predict(_case(folder, "rolling_steady", ROLES_ROLLING, []), {})
    found = _predict(
        _case(folder, "rolling_steady", ROLES_ROLLING, [name]), {f"{name}.{k}": v for k, v in values.items()}
    )
    return np.asarray((found - base)[0] * R * K_T / DRIVE)


def _alone(folder: Path, name: str, effects: list[str]) -> Case:
    """A case of the model that an effect is tested on, with every role and constant that the effect needs."""
    effect, base = catalogue()[name], ON[name]
    roles = ROLES_ROLLING if base == "rolling_steady" else ROLES_CONTACT
    roles = [*roles, *(group[0] for group in effect.needs if not set(group) & set(roles))]
    known = "".join(f"{constant} = 1.0\n" for constant in effect.constants if constant not in SOIL)
    return _case(folder, base, roles, effects, known=known)


def test_catalogue_has_every_shipped_effect() -> None:
    assert set(catalogue()) >= SHIPPED


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda e: e.name)
def test_entry_is_sound(effect: object) -> None:
    from terrapin_hil.physics.effects import Effect

    assert isinstance(effect, Effect)
    assert effect.title
    assert effect.equation
    assert effect.source
    assert effect.bases
    assert set(effect.bases) <= set(BASES)
    used = parse(effect.expression).names
    for p in effect.parameters:
        assert p.minimum <= p.start <= p.maximum
        assert all(p.minimum <= v <= p.maximum for v in p.grid)
        assert p.name in used
        assert p.meaning
    assert effect.parameters[0].start == 0.0, "the first parameter is the size: 0 is absent"
    for group in effect.needs:
        assert all(role in ROLES for role in group)


# what is never less than nothing: losses, gaps, depths, delays, amplitudes beside a phase
ONE_SIDED = {
    *("aerodynamic_drag", "backlash", "bulldozing", "bulldozing_at_axle", "cogging", "encoder_misalignment"),
    *("gear_behind_friction", "gear_efficiency", "inertia", "rut", "rut_at_axle", "rut_recovery", "sensor_delay"),
    *("shell_imbalance", "slip_sinkage", "slip_sinkage_at_axle", "swing_friction", "torque_ripple"),
    *("tyre_flexibility", "winding_temperature"),
}


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_an_effect_goes_either_way_unless_it_cannot(name: str) -> None:
    """A bound at 0 hides what goes the other way: a car whose load shifts less than its model says, too."""
    size = catalogue()[name].parameters[0]
    assert (size.minimum < 0.0) == (name not in ONE_SIDED)
    assert size.maximum > 0.0


# numbers in formulas that carry a unit of their own
CARRIES = {"aerodynamic_drag": ("1.225", "air_density", "kg/m^3"), "rate_effect": ("0.1", "reference", "m/s")}
WANTED = {"resistance": "N m", "drag": "N", "axle": "N", "encoder": "rad/s", **CHANNELS}


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda e: e.name)
def test_units_agree(effect: object) -> None:
    from terrapin_hil.physics.effects import Effect

    assert isinstance(effect, Effect)
    known = {formula_name(role): unit for role, unit in ROLES.items()}
    for base in effect.bases:
        known.update({k: v.replace("^n", "") for k, v in BASES[base].units.items()})
    known.update({p.name: p.unit for p in effect.parameters})
    known.update({**effect.constants, **dict.fromkeys(effect.options, "1")})
    known.update({"bulldozing_resistance": "N", "rut_resistance": "N/m"})
    known |= {"gear": "1", "radius": "m", "side": "1"} if set(effect.bases) & {"cmr", "vehicle"} else {}
    text = effect.expression
    if effect.name in CARRIES:
        literal, name, unit = CARRIES[effect.name]
        text, known[name] = text.replace(literal, name), unit
    found = parse(text).unit(known)
    wanted = WANTED.get(effect.target, "1")
    if effect.stage == "gain":
        wanted = "1"
    if effect.additive:
        wanted = {"recovery": "1", "k_s": "Pa", **BASES[effect.bases[0]].units}[effect.target]
    wanted = {"delay": "s", "inputs": "s", "play": "rad", "angle": "rad"}.get(effect.transform, wanted)
    registry = units()
    assert found.dimensionality == registry.parse_units("dimensionless" if wanted == "1" else wanted).dimensionality


@pytest.mark.parametrize("name", sorted(ON))
def test_absent_at_size_zero(tmp_path: Path, name: str) -> None:
    without = _predict(_alone(tmp_path, name, []), {})
    with_it = _predict(_alone(tmp_path, name, [name]), {})
    np.testing.assert_allclose(with_it, without, rtol=1e-12)


def _column(name: str) -> npt.NDArray[np.float64]:
    return np.array(TABLE[name])


W, V = _column("omega"), np.sign(_column("omega"))
# The formulas of effects once more, in NumPy: name -> values of its parameters, the resisting torque [N m] (rows,).
EXPECTED = {
    "speed_squared": ({"f_s": 3e-4}, 3e-4 * W**2 * R * _column("load") * V),
    "aerodynamic_drag": ({"cda": 0.3}, 0.5 * 1.225 * 0.3 * (R * W) * np.abs(R * W) * R),
    "slope": ({"gain": 0.9}, 0.9 * _column("load") * np.sin(_column("slope")) * R),
    "coulomb_friction": ({"da": 0.01}, 0.01 * V),
    "viscous_friction": ({"b": 0.002}, 0.002 * W),
    "stribeck": ({"a_s": 0.02, "omega_s": 3.0}, 0.02 * np.exp(-((W / 3.0) ** 2)) * V),
    "inertia": ({"j": 0.02}, 0.02 * _column("acceleration")),
    "shell_imbalance": ({"m_e": 0.01, "phase": 0.4}, 0.01 * np.sin(_column("angle") + 0.4)),
    "cogging": ({"m_c": 0.01, "k": 7.0, "phase": -0.4}, 0.01 * np.sin(7 * _column("angle") - 0.4)),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_resisting_torque(tmp_path: Path, name: str) -> None:
    values, expected = EXPECTED[name]
    np.testing.assert_allclose(_torque_change(tmp_path, name, values), expected, rtol=1e-9, atol=1e-15)


def test_drag_takes_the_measured_speed_where_it_is_mapped(tmp_path: Path) -> None:
    roles = [*ROLES_ROLLING, "speed"]
    change = _predict(_case(tmp_path, "rolling_steady", roles, ["aerodynamic_drag"]), {"aerodynamic_drag.cda": 0.3})
    change = change - _predict(_case(tmp_path, "rolling_steady", roles, []), {})
    expected = 0.5 * 1.225 * 0.3 * _column("speed") ** 2 * R * DRIVE / (R * K_T)
    np.testing.assert_allclose(change[0], expected, rtol=1e-9)


def test_heating_and_offset(tmp_path: Path) -> None:
    base = _predict(_case(tmp_path, "rolling_steady", ROLES_ROLLING, []), {})[0]
    both = _case(tmp_path, "rolling_steady", ROLES_ROLLING, ["current_offset", "motor_heating"])
    got = _predict(both, {"motor_heating.a_t": 0.003, "current_offset.i_0": 0.02})[0]
    np.testing.assert_allclose(got, base / (1 - 0.003 * (_column("temperature") - 25)) + 0.02, rtol=1e-12)
    expected = (F_O * R * _column("load") * V + A * V + B * W) * DRIVE / (R * K_T)
    np.testing.assert_allclose(base, expected, rtol=1e-12)


def _soil(**changes: object) -> sphere.Soil:
    values = {"stiffness": 1.2e6, "exponent": 0.97, "cohesion": 400.0, "friction_angle": 0.7, "shear_modulus": 0.018}
    return sphere.Soil(**{**values, **changes})  # type: ignore[arg-type]


def _sphere(soil: sphere.Soil) -> npt.NDArray[np.float64]:
    theta = sphere.entry_angle(_column("load"), _column("slip"), 0.22, soil)
    _, traction, torque = sphere.forces(theta, _column("slip"), 0.22, soil)
    return np.array([traction, torque, sphere.sinkage(theta, 0.22)])


PARAMETER_EFFECTS = {
    "rate_effect": ({"m": 0.2}, {"stiffness": 1.2e6 * (_column("speed") / 0.1) ** 0.2}),
    "multipass": ({"kappa": 0.3}, {"stiffness": 1.2e6 * _column("pass") ** 0.3}),
    "moisture_cohesion": ({"c_w": 5000.0}, {"cohesion": 400.0 + 5000.0 * _column("moisture")}),
    "rut_recovery": ({"lam": 0.3}, {"recovery": 0.3}),
}


@pytest.mark.parametrize("name", PARAMETER_EFFECTS)
def test_effects_on_the_soil(tmp_path: Path, name: str) -> None:
    values, changes = PARAMETER_EFFECTS[name]
    got = _predict(
        _case(tmp_path, "sphere_contact", ROLES_CONTACT, [name]), {f"{name}.{key}": v for key, v in values.items()}
    )
    np.testing.assert_allclose(got, _sphere(_soil(**changes)), rtol=1e-9)


def test_resistances_reduce_pull_and_torque_alike(tmp_path: Path) -> None:
    base = _sphere(_soil())
    theta = sphere.entry_angle(_column("load"), _column("slip"), 0.22, _soil())
    slip, load = _column("slip"), _column("load")
    r_c = sphere.bulldozing(theta, 0.22, 400.0, 0.7, 19600.0, 20.0, 6.0)
    clipped = 2.0 * load * np.maximum(slip - 0.45, 0.0) ** 2
    symmetric = 2.0 * load * np.abs(slip - 0.45) ** 2
    chosen = {"slip_sinkage.xi1": 2.0, "slip_sinkage.xi2": 0.45, "slip_sinkage.xi3": 2.0}
    for names, values, known, drag in (
        (["bulldozing"], {"bulldozing.scale": 1.1}, "", 1.1 * r_c),
        (["slip_sinkage"], chosen, "", clipped),
        (["slip_sinkage"], chosen, "clip = false\n", symmetric),
        (["slip_sinkage"], chosen, 'clip = "false"\n', symmetric),
        (["bulldozing", "slip_sinkage"], {**chosen, "bulldozing.scale": 1.0}, "", r_c + clipped),
    ):
        got = _predict(_case(tmp_path, "sphere_contact", ROLES_CONTACT, names, known=known), values)
        np.testing.assert_allclose(got[0], base[0] - drag, rtol=1e-9)
        np.testing.assert_allclose(got[1], base[1] - 0.22 * drag, rtol=1e-9)
        np.testing.assert_allclose(got[2], base[2], rtol=1e-9)


def test_losses_of_the_axle_reduce_the_pull_alone(tmp_path: Path) -> None:
    """The simulator's form of the same two laws; beside the printed one both act. A rut deepens what bulldozes."""
    theta = sphere.entry_angle(_column("load"), _column("slip"), 0.22, _soil())
    slip, load, base = _column("slip"), _column("load"), _sphere(_soil())
    r_c = sphere.bulldozing(theta, 0.22, 400.0, 0.7, 19600.0, 20.0, 6.0)
    r_f = 2.0 * load * np.maximum(slip - 0.45, 0.0) ** 2
    deep = np.arccos(1.0 - (sphere.sinkage(theta, 0.22) + 7e-3 * slip / (1.0 - slip)) / 0.22)
    dug = sphere.bulldozing(deep, 0.22, 400.0, 0.7, 19600.0, 20.0, 6.0)
    sizes = {f"slip_sinkage_at_axle.{name}": value for name, value in {"xi1": 2.0, "xi2": 0.45, "xi3": 2.0}.items()}
    for names, values, axle, drag in (
        (["bulldozing_at_axle"], {"bulldozing_at_axle.scale": 1.1}, 1.1 * r_c, 0.0),
        (["slip_sinkage_at_axle"], sizes, r_f, 0.0),
        (["rut_at_axle"], {"rut_at_axle.rut_depth": 7e-3}, dug - r_c, 0.0),
        (["bulldozing", "rut"], {"bulldozing.scale": 1.0, "rut.rut_depth": 7e-3}, 0.0, dug),
        (["bulldozing_at_axle", "rut"], {"bulldozing_at_axle.scale": 1.0, "rut.rut_depth": 7e-3}, r_c, dug - r_c),
        (["bulldozing", "slip_sinkage_at_axle"], {**sizes, "bulldozing.scale": 0.5}, r_f, 0.5 * r_c),
    ):
        got = _predict(_case(tmp_path, "sphere_contact", ROLES_CONTACT, names), values)
        np.testing.assert_allclose(got[0], base[0] - axle - drag, rtol=1e-9)
        np.testing.assert_allclose(got[1], base[1] - 0.22 * drag, rtol=1e-9)
        np.testing.assert_allclose(got[2], base[2], rtol=1e-9)


def test_a_gear_takes_its_share_by_who_drives(tmp_path: Path) -> None:
    """Rows whose load drives, by a torque of the user's own that pushes, need less of the motor, not more."""
    push = '\n[effect.mine]\nexpression = "-k * sign(omega)"\nk = { value = 0.3, unit = "N m" }\n'
    for names, extra in (([], ""), (["mine"], push)):
        base = _predict(_case(tmp_path, "rolling_steady", ROLES_ROLLING, names, extra), {})[0]
        case = _case(tmp_path, "rolling_steady", ROLES_ROLLING, [*names, "gear_efficiency"], extra)
        got = _predict(case, {"gear_efficiency.loss": 0.2})[0]
        np.testing.assert_allclose(got, np.where(base * W > 0.0, base / 0.8, base * 0.8), rtol=1e-9)
        known = _case(tmp_path, "rolling_steady", ROLES_ROLLING, names, extra, known="gear_efficiency = 0.8\n")
        np.testing.assert_allclose(got, _predict(known, {})[0], rtol=1e-9)
    assert (base * W < 0.0).any()


def test_a_gear_behind_the_friction_loses_nothing_of_it(tmp_path: Path) -> None:
    roles = ["omega", *ROLES_CONTACT]
    plain, friction = (
        _predict(_case(tmp_path, "rolling_sphere", roles, [], known=known), {})[0]
        for known in ("", "joint_efficiency = 1e12\n")
    )
    np.testing.assert_allclose(friction, (0.6 * np.sign(W) + 0.05 * W) / (0.22 / 0.01 * 0.04), rtol=1e-9)
    case = _case(tmp_path, "rolling_sphere", roles, ["gear_behind_friction"])
    got = _predict(case, {"gear_behind_friction.loss": 0.2})[0]
    assert ((plain - friction) * W > 0.0).all()
    np.testing.assert_allclose(got, (plain - friction) / 0.8 + friction, rtol=1e-9)


def test_order_additions_gains_offsets(tmp_path: Path) -> None:
    base = _sphere(_soil())
    names = ["torque_gain", "force_offset", "bearing_friction"]  # the order in the file does not matter
    values = {"torque_gain.g": 0.1, "force_offset.f_0": 3.0, "bearing_friction.t_b": 0.5}
    got = _predict(_case(tmp_path, "sphere_contact", ROLES_CONTACT, names), values)
    np.testing.assert_allclose(got, [base[0] + 3.0, (base[1] + 0.5) * 1.1, base[2]], rtol=1e-9)


def test_stiffness_effects_on_the_wheel_multiply_both(tmp_path: Path) -> None:
    from terrapin_hil.physics import wheel

    got = _predict(_case(tmp_path, "wheel_contact", ROLES_CONTACT, ["multipass"]), {"multipass.kappa": 0.4})
    factor = _column("pass") ** 0.4
    soil = wheel.Soil(24e3 * factor, 1528e3 * factor, 1.1, 700.0, 0.5, 0.025)
    theta = wheel.entry_angle(_column("load"), _column("slip"), 0.08, 0.15, soil)
    _, traction, torque = wheel.forces(theta, _column("slip"), 0.08, 0.15, soil)
    np.testing.assert_allclose(got, [traction, torque, wheel.sinkage(theta, 0.08)], rtol=1e-9)
    got = _predict(_case(tmp_path, "wheel_contact", ROLES_CONTACT, ["bulldozing"]), {"bulldozing.scale": 1.0})
    plain = wheel.Soil(24e3, 1528e3, 1.1, 700.0, 0.5, 0.025)
    theta = wheel.entry_angle(_column("load"), _column("slip"), 0.08, 0.15, plain)
    z = wheel.sinkage(theta, 0.08)
    k_l, k_g = sphere.bulldozing_factors(0.5, 20.0, 6.0)
    drag = 0.15 * (0.67 * 700.0 * z * k_l + 0.5 * z**2 * 16000.0 * k_g)
    _, traction, torque = wheel.forces(theta, _column("slip"), 0.08, 0.15, plain)
    np.testing.assert_allclose(got[:2], [traction - drag, torque - 0.08 * drag], rtol=1e-9)


OWN = """
[effect.mine]
expression = "k * omega**3"
k = { value = 1e-4, unit = "N m s^3/rad^3" }
"""


def test_own_expressions(tmp_path: Path) -> None:
    base = _predict(_case(tmp_path, "rolling_steady", ROLES_ROLLING, []), {})[0]
    got = _predict(_case(tmp_path, "rolling_steady", ROLES_ROLLING, ["mine"], OWN), {})[0]
    np.testing.assert_allclose(got, base + 1e-4 * W**3 * DRIVE / (R * K_T), rtol=1e-9)
    unitless = OWN.replace(', unit = "N m s^3/rad^3"', "")
    on_channel = unitless.replace('"k * omega**3"', '"k * load"\ntarget = "current"')
    got = _predict(_case(tmp_path, "rolling_steady", ROLES_ROLLING, ["mine"], on_channel), {})[0]
    np.testing.assert_allclose(got, base + 1e-4 * _column("load"), rtol=1e-9)
    on_parameter = unitless.replace('"k * omega**3"', '"k * temperature"\ntarget = "torque_constant"')
    got = _predict(_case(tmp_path, "rolling_steady", ROLES_ROLLING, ["mine"], on_parameter), {})[0]
    np.testing.assert_allclose(got, base / (1 + 1e-4 * _column("temperature")), rtol=1e-9)


@pytest.mark.parametrize("name", sorted(ON))
def test_jacobian_is_the_derivative(tmp_path: Path, name: str) -> None:
    """Difference quotients through the implicit function theorem against central differences of whole predictions."""
    case = _alone(tmp_path, name, [name])
    model = Model.of(case)
    sizes = {"xi1": 1.0, "c_w": 2000.0, "lam": 0.3, "a_t": 0.002, "scale": 0.8}
    theta = np.array([sizes.get(f.name, f.start or 0.05) for f in model.fitted])
    bound = model.bind(case.inputs)
    _, slopes = bound.jacobian(theta)
    for i, value in enumerate(theta):
        step = 1e-4 * abs(value)
        up, down = theta.copy(), theta.copy()
        up[i] += step
        down[i] -= step
        central = (bound.predict(up) - bound.predict(down)) / (2 * step)
        scale = np.abs(central).max() + 1e-300
        np.testing.assert_allclose(slopes[..., i], central, atol=3e-5 * scale)


def test_firmware_formulas_name_real_parameters() -> None:
    import tomllib

    controller = tomllib.loads((ROOT / "firmware/terrapin_interface/controller.toml").read_text())["parameter"]
    for effect in catalogue().values():
        for name, formula in effect.firmware.items():
            assert name in controller
            own = {p.name: p.unit for p in effect.parameters}
            known = {**own, **BASES["rolling_steady"].units, "load": "N"}
            formula, known = formula.replace("9.81", "gravity"), {**known, "gravity": "m/s^2"}
            unit = controller[name]["unit"]
            wanted = units().parse_units("dimensionless" if unit == "1" else unit)
            assert parse(formula).unit(known).dimensionality == wanted.dimensionality
    assert math.isclose(catalogue()["cogging"].parameters[1].maximum, 64.0)


# effect of the controller -> its parameter and a value that rounding moves, and what is the same as a value it holds
HELD: dict[str, tuple[str, float, Callable[[float], float]]] = {
    "motor_heating": ("a_t", 0.00312345678, lambda held: held),
    "gear_efficiency": ("loss", 0.0712345678, lambda held: 1.0 - held),
    "inertia": ("j", 0.0212345678, lambda held: held + sum(TABLE["load"]) / 4 / 9.81 * R**2),
}


@pytest.mark.parametrize("name", HELD)
def test_rounding_costs_what_the_value_that_is_held_predicts(tmp_path: Path, name: str) -> None:
    """It was a multiple of that where the controller's parameter is not the effect's own: for a gear, 0.08 of it."""
    key, value, back = HELD[name]
    case = _case(tmp_path, "rolling_steady", ROLES_ROLLING, [name], known="gear_efficiency = 1.0\n")
    model = Model.of(case)
    theta = np.array([{f"{name}.{key}": value}.get(f.key, f.start) for f in model.fitted], dtype=np.float64)
    fit = SimpleNamespace(theta=theta, model=model)
    analysis: Any = SimpleNamespace(case=case, model=model, fit=fit, rows=np.ones(4, dtype=bool))
    exported, _ = export_parameters(analysis)
    (entry,) = exported
    assert 0.0 < abs(entry.rounding) <= entry.scale / 2
    change = _predict(case, {f"{name}.{key}": back(entry.held)}) - _predict(case, {f"{name}.{key}": value})
    wanted = np.abs(change[0]).max() * K_T * R / DRIVE
    assert torque_cost(analysis, exported) == pytest.approx(wanted, rel=1e-3)
