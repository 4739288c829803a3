"""Derivatives of the bodies' laws are those of the laws: against differences of the functions that they belong to."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
import pytest

from terrapin_hil.physics.bodies import bodies
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.dynamic import Plan
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.soils import library as soils
from terrapin_hil.physics.vehicle import profile_torque

Array = npt.NDArray[np.float64]
STEP = 1e-5  # relative, of central differences: their error is some 1e-10

# hil_robot, then voltage, f_o, f_s and smoothing; beta, alpha, their rates; torques and inertias on both
ROBOT = [
    *(0.08, 0.018, 0.062, 0.3, 0.5, 1.1, 1.92e-3, 2e-4, 1.8e-4, 9.81),
    *(0.1, 5.0, 0.0, 0.012, 1e-3, 0.8, 0.9, 4e-3, 5e-4),
]
AROUND = [5.0, 0.09, 1e-3, 0.05, 0.1, 0.4, 3.0, 3.5, -0.01, 0.02, 1e-4, 2e-4]
# hil_pendulum; ground's torque and inertia; swing, angle, their rates
SPHERE = [0.22, 4.29, 2.0, 1.5, 0.13, 0.138, 0.012, 0.001, 9.81, 0.7, 0.6, 0.05, 0.1, 0.07, 0.05]
MOTION = [0.03, 0.002, 0.3, 0.2, -0.4, 1.5]


def rolling(inputs: Array) -> Array:
    f, lib = ffi(), library()
    at = f.new("hil_rolling_inputs *")
    f.buffer(at)[:] = inputs.tobytes()
    t = lib.hil_rolling_evaluate(f.addressof(at.robot), f.addressof(at.load), f.addressof(at.state))
    gear = at.robot.radius / at.robot.drive_radius
    torque = np.array([at.torque[0] - t.resistance, gear * t.motor - t.internal_friction + at.torque[1]])
    found = np.empty(2)
    lib.hil_rolling_respond(f.addressof(at.robot), f.addressof(at.state), pointer(torque), at.inertia, pointer(found))
    return np.array([*found, t.motor / at.robot.torque_constant])


def rolling_by(inputs: Array) -> Array:
    f = ffi()
    at, by = f.new("hil_rolling_inputs *"), f.new("hil_rolling_inputs[3]")
    f.buffer(at)[:] = inputs.tobytes()
    found = rolling(inputs)[:2].copy()
    library().hil_rolling_gradient(at, pointer(found), by)
    return np.frombuffer(bytes(f.buffer(by))).reshape(3, -1)


JOINT = 0.8  # rad/s^2


def driven(inputs: Array) -> Array:
    f = ffi()
    at, turns, torque = f.new("hil_pendulum_inputs *"), f.new("double *"), f.new("double *")
    f.buffer(at)[:] = inputs.tobytes()
    given = (f.addressof(at.pendulum), f.addressof(at.around), f.addressof(at.state))
    library().hil_pendulum_driven(*given, JOINT, turns, torque)
    return np.array([turns[0], torque[0]])


def driven_by(inputs: Array) -> Array:
    f = ffi()
    at, by = f.new("hil_pendulum_inputs *"), f.new("hil_pendulum_inputs[2]")
    f.buffer(at)[:] = inputs.tobytes()
    library().hil_pendulum_gradient(at, JOINT, by)
    return np.frombuffer(bytes(f.buffer(by))).reshape(2, -1)


LAWS: dict[str, tuple[list[float], Callable[[Array], Array], Callable[[Array], Array]]] = {
    "cylinder": (ROBOT + AROUND, rolling, rolling_by),
    "sphere": (SPHERE + MOTION, driven, driven_by),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", range(8))
def test_gradients_are_what_differences_tend_to(law: str, seed: int) -> None:
    """Around the sizes of the papers' robots, forwards and backwards, driving and driven back."""
    sizes, value, gradient = LAWS[law]
    random = np.random.default_rng(seed)
    inputs = np.array(sizes) * random.uniform(0.7, 1.4, len(sizes))
    motion = slice(len(sizes) - 8, len(sizes) - 4) if law == "cylinder" else slice(len(sizes) - 4, len(sizes))
    inputs[motion] *= random.choice([-1.0, 1.0], 4)
    if law == "cylinder":
        inputs[19] *= random.choice([-1.0, 1.0])  # voltage
    found = gradient(inputs)
    for i, size in enumerate(inputs):
        step = STEP * max(abs(size), 1e-3)
        up, down = inputs.copy(), inputs.copy()
        up[i] += step
        down[i] -= step
        slope = (value(up) - value(down)) / (2.0 * step)
        scale = np.abs(value(inputs)) + np.abs(slope * size)
        assert (np.abs(found[:, i] - slope) * max(abs(size), 1e-3) <= 1e-6 * np.maximum(scale, 1e-6)).all(), (i, seed)


T = np.arange(0.0, 3.0, 0.01)
SAND = soils()["sand_vella"].footing(0.235)
RUNS: dict[str, tuple[Mapping[str, float], dict[str, Array]]] = {  # values, and what drives it
    "cmr": (
        {"f_o": 0.05, "gear_efficiency": 0.8, "driven_ratio": 0.9, "motor_coulomb": 4e-3, "motor_viscous": 5e-4},
        {"voltage": 5.0 + 3.0 * np.sin(2.0 * T)},
    ),
    "pendulum_sphere": (
        {"f_o": 0.05, "rolling_slip": 0.1, "incline": 0.05, "shell_share": 0.6},
        {"joint_rate": np.clip(T, 0.0, 1.5)},
    ),
    "vehicle": (
        {
            "k_s": SAND.stiffness,
            "n": SAND.exponent,
            "cohesion": SAND.cohesion,
            "friction_angle": SAND.friction_angle,
            "shear_modulus": SAND.shear_modulus,
        },
        {"drive_torque": profile_torque(0)[: len(T)]},
    ),
}


APART = 1e-3  # relative, of runs of their own: steps of an error of 1e-7 leave 1e-4 of the difference
TOLERANCE = 0.02  # of its rms: where a wheel or a shell begins to roll, it bends with how far these are apart


@pytest.mark.parametrize("base", RUNS)
@pytest.mark.parametrize("name", ["", "inertia", "torque_ripple", "speed_squared", "multipass", "rate_effect"])
def test_each_parameter_moves_a_run_as_runs_of_their_own_say(base: str, name: str) -> None:
    """Every parameter of the body, and of an effect that the motion itself changes, to first order."""
    if name and base not in catalogue()[name].bases:
        return
    given, inputs = RUNS[base]
    effects = [catalogue()[name]] if name else []
    plan = Plan(bodies()[base], effects)
    values = plan.values()
    for key, value in given.items():
        values[plan.slots[key]] = value
    moved = [plan.slots[key] for key in bodies()[base].parameters if values[plan.slots[key]] not in (0.0, 1.0)]
    for effect in effects:
        for parameter in effect.parameters:
            slot = plan.own[effect.name][parameter.name]
            values[slot] = parameter.grid[0] if parameter.grid else 0.05
            moved.append(slot)
    if name:
        moved = moved[-6:]  # the rest was looked at without it
    tables = np.tile(values, (1 + len(moved), 1))
    tables[range(1, len(tables)), moved] *= 1.0 + 1e-6
    first, *others = plan.near(tables, T, inputs)
    for other, slot in zip(others, moved, strict=True):
        ends = []
        for side in (1.0, -1.0):
            table = values.copy()
            table[slot] *= 1.0 + APART * side
            ends.append(plan.channels(table, T, inputs))
        slope, central = (
            np.array([change[name] / np.abs(first[name]).max() for name in first])
            for change in (
                {name: (other[name] - first[name]) / 1e-6 for name in first},
                {name: (ends[0][name] - ends[1][name]) / (2.0 * APART) for name in first},
            )
        )
        error, size = (float(np.sqrt(np.mean(one * one))) for one in (slope - central, central))
        assert error <= TOLERANCE * max(size, 1e-6), (slot, error / size)
