"""Cases with a dynamic base: generated, compared, discovered, added to, reported; and what is wrong in them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from terrapin_hil.physics.bodies import bodies
from terrapin_hil.physics.dynamic import NEIGHBOURS, Plan, simulate
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.vehicle import profile_torque
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import error, fitted_on
from terrapin_tools.workbench.model.effect_columns import acting
from terrapin_tools.workbench.model.fitting import _Problem, covariance
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.kinds import NODES
from tests.python.casekit import terrapin

Array = npt.NDArray[np.float64]

CAR = {"k_s": 357.6e3, "n": 0.71, "cohesion": 1146.8, "friction_angle": 0.54983, "shear_modulus": 0.036}
WHEELS = ("fl", "fr", "rl", "rr")

CMR = """[case]
title = "Steps of voltage on sand"
[model]
base = "cmr"
[fit]
f_o = { value = 0.05, min = 0.0, max = 0.5 }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "time", unit = "s" }
voltage = { column = "voltage", unit = "V" }
omega = { column = "omega", unit = "rad/s", sigma = 0.02 }
current = { column = "current", unit = "A", sigma = 0.004 }
"""
SPHERE = """[case]
title = "Pendulum sphere on a slope"
[model]
base = "pendulum_sphere"
[fit]
f_o = { value = 0.01, min = 0.0, max = 0.2 }
viscous = { value = 0.3, min = 0.0, max = 2.0 }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "time", unit = "s" }
joint_rate = { column = "joint_rate", unit = "rad/s" }
slope = { column = "slope", unit = "rad" }
torque = { column = "torque", unit = "N m", sigma = 0.01 }
rolling_angle = { column = "rolling_angle", unit = "rad", sigma = 0.003 }
"""
VEHICLE = """[case]
title = "Car on sand"
[model]
base = "vehicle"
[parameters]
n = 0.71
cohesion = "1146.8 Pa"
shear_modulus = "36 mm"
[fit]
k_s = { value = "400 kN/m^2.71", min = "200 kN/m^2.71", max = "800 kN/m^2.71" }
friction_angle = { value = "33 deg", min = "25 deg", max = "40 deg" }
[data]
files = ["runs.csv"]
run = "run"
train = ["r0", "r1"]
test = ["r2"]
[data.columns]
time = { column = "time", unit = "s" }
drive_torque = { column = "drive_torque", unit = "N m" }
""" + "".join(f'omega_{w} = {{ column = "omega_{w}", unit = "rad/s", sigma = 0.1 }}\n' for w in WHEELS)


def write(folder: Path, text: str, runs: Sequence[Mapping[str, Array]]) -> Path:
    folder.mkdir()
    lines = [",".join(["run", *runs[0]])]
    for number, run in enumerate(runs):
        lines += [",".join([f"r{number}", *(f"{v:.8g}" for v in row)]) for row in zip(*run.values(), strict=True)]
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


def cylinder(folder: Path, effects: dict[str, dict[str, float]], runs: int = 4, text: str = CMR) -> Path:
    random, t, found = np.random.default_rng(3), np.arange(0.0, 1.8, 0.04), []
    for number in range(runs):
        voltage = np.where(t < 0.9, 3.0 + number, 7.0 - 0.7 * number)
        run = simulate("cmr", {"f_o": 0.092}, {"time": t, "voltage": voltage}, effects).channels
        noise = random.normal(size=(2, t.size))
        found.append(
            {
                "time": t,
                "voltage": voltage,
                "omega": run["omega"] + 0.02 * noise[0],
                "current": run["current"] + 0.004 * noise[1],
            }
        )
    return write(folder, text, found)


def sphere(folder: Path, gain: float) -> Path:
    random, t, found = np.random.default_rng(4), np.arange(0.0, 4.0, 0.04), []
    for number in range(4):
        joint = np.clip((0.8 + 0.4 * number) * t, 0.0, 1.2 + 0.4 * number)
        slope = np.full(t.size, 0.01 * (number - 1))
        inputs = {"time": t, "joint_rate": joint, "slope": slope}
        run = simulate("pendulum_sphere", {"f_o": 0.02, "viscous": 0.2}, inputs, {"slope": {"gain": gain}}).channels
        noise = random.normal(size=(2, t.size))
        measured = {"torque": run["torque"] + 0.01 * noise[0], "rolling_angle": run["rolling_angle"] + 0.003 * noise[1]}
        found.append({**inputs, **measured})
    return write(folder, SPHERE, found)


def car(folder: Path, effects: dict[str, dict[str, float]]) -> Path:
    random, found = np.random.default_rng(5), []
    for number in range(3):
        torque = profile_torque(number)[:161:4]
        t = np.arange(torque.size) * 0.04
        run = simulate("vehicle", CAR, {"time": t, "drive_torque": torque}, effects).channels
        wheels = {f"omega_{w}": run[f"omega_{w}"] + random.normal(0.0, 0.1, t.size) for w in WHEELS}
        found.append({"time": t, "drive_torque": torque, **wheels})
    return write(folder, VEHICLE, found)


def compared(capsys: pytest.CaptureFixture[str], folder: Path) -> dict[str, dict[str, dict[str, float]]]:
    status, out, err = terrapin(capsys, "compare", folder, "--json", "-")
    assert status == 0, err
    found: dict[str, dict[str, dict[str, float]]] = json.loads(out)
    return found


def near(entry: Mapping[str, float], truth: float, sds: float = 4.0) -> bool:
    return abs(entry["value"] - truth) <= sds * entry["sd"]


# what a body needs, what drives it, a small change, and how well it is known: a car's contacts are solved to 1e-9
DRIVEN: dict[str, tuple[dict[str, float], str, float, float, float]] = {
    "cmr": ({"f_o": 0.09}, "voltage", 6.0, 1e-7, 1e-5),
    "pendulum_sphere": ({"f_o": 0.02}, "joint_rate", 1.5, 1e-7, 1e-5),
    "vehicle": (CAR, "drive_torque", 500.0, 1e-5, 1e-3),
}


@pytest.mark.parametrize("target", ["resistance", "radius"])
@pytest.mark.parametrize("start", [0.0, 2.0])
@pytest.mark.parametrize("base", DRIVEN)
def test_shapes_change_what_a_column_of_them_does(base: str, start: float, target: str) -> None:
    """What many shapes over time do at once is what each does as an input of its own."""
    known, drive, size, small, share = DRIVEN[base]
    target = {"vehicle": "tyre_stiffness"}.get(base, target) if target == "radius" else target
    time = np.arange(0.0, 1.5, 0.03)
    inputs = {drive: size * np.clip(1.0 - time, 0.3, 1.0)}
    shapes = np.column_stack([np.cos(5.0 * time), time, np.ones(time.size), *np.eye(time.size)])

    def plan(expression: str, more: Sequence[str]) -> tuple[Plan, Array]:
        effect = Effect("e", "", "", "", (base,), (Parameter("k_", "1", 0.0),), (), expression, target)
        found = Plan(bodies()[base], [effect], [*known, drive, *more])
        tables = np.tile(found.values(), (2, 1))
        for name, value in known.items():
            tables[:, found.slots[name]] = value
        tables[1, found.own["e"]["k_"]] = small
        return found, tables

    once, tables = plan("k_", ())
    each, own = plan("k_*shape_", ("shape_",))
    changes = once.shaped(tables, time, inputs, start, shapes)
    assert len(changes) == shapes.shape[1] > NEIGHBOURS
    for change, shape in zip(changes[:9], shapes.T, strict=False):
        here, there = each.near(own, time, {**inputs, "shape_": shape}, start)
        for name, values in change.items():
            expected = there[name] - here[name]
            np.testing.assert_allclose(values, expected, atol=share * np.abs(expected).max() + 1e-15)
    assert max(np.abs(values).max() for values in changes[0].values()) > 1e-11


def test_what_is_added_to_a_channel_shows_there_alone_and_as_it_is(tmp_path: Path) -> None:
    """A fault of the measurement is no force: the motion knows nothing of it, and no row of another's."""
    case = load_case(cylinder(tmp_path / "case", {}))
    model, rows, sigma = Model.of(case), case.train | case.test, np.array([0.02, 0.004])
    added = np.random.default_rng(6).normal(size=(2, rows.sum()))
    for at, channel in enumerate(model.channels):
        change = acting(model, model.start, channel, rows, sigma)(added)
        expected = np.zeros_like(change)
        expected[:, at] = added / sigma[at]
        np.testing.assert_allclose(change, expected, rtol=1e-6, atol=1e-6)


def test_a_start_that_sends_a_body_off_is_brought_back(tmp_path: Path) -> None:
    case = load_case(cylinder(tmp_path / "case", {}))
    model = Model.of(case, ["viscous_friction"])
    measured = np.stack([case.channels[name][case.train] for name in model.channels])
    problem = _Problem(model.bind(case.inputs, case.train), measured, np.array([0.02, 0.004]), np.inf)
    absent = problem.residual(np.array([0.092, 0.0]))
    cost = float(absent @ absent)
    found, came = problem.nearer(np.array([0.092, 0.4]), 1, cost)
    residual = problem.residual(found)
    assert 0.0 < found[1] <= 0.1
    assert came == (residual @ residual <= 2.0 * cost)
    assert found[1] == 0.4 / 2**6 or came
    near = np.array([0.092, 1e-6])
    assert problem.nearer(near, 1, cost)[0] is near


def test_a_complete_model_of_the_cylinder_is_adequate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = compared(capsys, cylinder(tmp_path / "case", {}))
    assert answer["verdict"] == "adequate"
    assert near(answer["parameters"]["f_o"], 0.092)
    assert answer["parameters"]["f_o"]["sd"] < 1e-3
    assert 0.9 < answer["channels"]["omega"]["heldout_rmse"] / 0.02 < 1.1


def test_a_wrong_constant_of_a_body_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque constant of 0.11 N m/A that the case takes for 0.12: friction and formulas would imitate it."""
    random, t, found = np.random.default_rng(8), np.arange(0.0, 1.8, 0.04), []
    for number in range(6):
        inputs = {"time": t, "voltage": np.where(t < 0.9, 3.0 + number, 7.0 - 0.7 * number)}
        run = simulate("cmr", {"f_o": 0.092, "torque_constant": 0.11}, inputs).channels
        noise = random.normal(size=(2, t.size))
        measured = {"omega": run["omega"] + 0.02 * noise[0], "current": run["current"] + 0.004 * noise[1]}
        found.append({**inputs, **measured})
    friction = "coulomb = { value = 0.01, min = 0.0, max = 0.1 }"
    text = CMR.replace("[fit]", f"[parameters]\ntorque_constant = 0.12\n[fit]\n{friction}")
    status, _, err = terrapin(capsys, "discover", write(tmp_path / "case", text, found), "--json", tmp_path / "a.json")
    assert status == 0, err
    answer = json.loads((tmp_path / "a.json").read_text())
    assert (answer["verdict"], answer["missing"]) == ("missing", ["constant.torque_constant"])
    assert answer["answer_probability"] > 0.9


def test_one_run_on_a_slope_is_told_as_that_runs_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Ground of 2 degrees under the third of six runs, which the table does not have."""
    random, t, found = np.random.default_rng(6), np.arange(0.0, 1.8, 0.04), []
    for number in range(6):
        inputs = {"time": t, "voltage": np.where(t < 0.9, 3.0 + number, 7.0 - 0.7 * number)}
        tilted = {**inputs, "slope": np.full(t.size, 0.035 * (number == 2))}
        run = simulate("cmr", {"f_o": 0.092}, tilted, {"slope": {"gain": 1.0}}).channels
        noise = random.normal(size=(2, t.size))
        measured = {"omega": run["omega"] + 0.02 * noise[0], "current": run["current"] + 0.004 * noise[1]}
        found.append({**inputs, **measured})
    status, out, err = terrapin(capsys, "discover", write(tmp_path / "case", CMR, found), "--json", tmp_path / "a.json")
    assert status == 0, err
    answer = json.loads((tmp_path / "a.json").read_text())
    assert (answer["verdict"], answer["odd_runs"]) == ("unexplained", ["r2"])
    assert answer["mishap"]["kind"] == "slope"
    assert "Run r2 goes as on a slope" in " ".join(out.split())


def test_a_missing_effect_of_the_cylinder_is_found_added_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = cylinder(tmp_path / "case", {"viscous_friction": {"b": 0.006}}, 3)
    status, out, err = terrapin(capsys, "discover", folder, "--json", "-")
    assert status == 0, err
    answer = json.loads(out)
    assert "viscous_friction" in answer["missing"] or any("viscous_friction" in r for r in answer["rivals"])
    assert answer["verdict"] in ("missing", "ambiguous")
    status, _, err = terrapin(capsys, "add", folder, "viscous_friction")
    assert status == 0, err
    after = compared(capsys, folder)
    assert after["verdict"] == "adequate"
    assert near(after["parameters"]["viscous_friction.b"], 0.006)
    page = tmp_path / "page.html"
    status, _, err = terrapin(capsys, "report", folder, "-o", page)
    assert status == 0, err
    assert "Steps of voltage on sand" in page.read_text()


def fitted(folder: Path, effects: Sequence[str]) -> tuple[dict[str, tuple[float, float]], float]:
    """Values and standard deviations by the training runs, and the error on all rows in noise sd."""
    case = load_case(folder)
    sigma = np.array([case.sigma[c] for c in Model.of(case).channels], dtype=np.float64)
    fit = fitted_on(case, effects, case.train, sigma)[-1]
    sd = np.sqrt(np.diag(covariance(fit, case.run[case.train], NODES[0])[0]))
    keys = [f.key for f in fit.model.fitted]
    found = {key: (float(v), float(s)) for key, v, s in zip(keys, fit.theta, sd, strict=True)}
    reached = error(fit, case.train | case.test, sigma)
    assert reached is not None
    return found, reached


def agrees(entry: tuple[float, float], truth: float, sds: float = 4.0) -> bool:
    return abs(entry[0] - truth) <= sds * entry[1]


def test_the_sphere_knows_the_slope_it_stands_on(tmp_path: Path) -> None:
    folder = sphere(tmp_path / "case", 1.0)
    assert fitted(folder, [])[1] > 3.0
    found, reached = fitted(folder, ["slope"])
    assert 0.9 < reached < 1.1
    assert agrees(found["slope.gain"], 1.0)
    assert agrees(found["viscous"], 0.2)
    assert agrees(found["f_o"], 0.02)


@pytest.mark.parametrize(("name", "size", "value"), [("sensor_delay", "delay", 0.03), ("inertia", "j", 0.01)])
def test_what_was_switched_on_in_the_simulation_is_what_is_fitted(
    tmp_path: Path, name: str, size: str, value: float
) -> None:
    folder = cylinder(tmp_path / "case", {name: {size: value}}, 3)
    assert fitted(folder, [])[1] > 5.0
    found, reached = fitted(folder, [name])
    assert 0.9 < reached < 1.1
    assert agrees(found[f"{name}.{size}"], value)


def test_the_car_recovers_its_soil_and_its_ruts(tmp_path: Path) -> None:
    found, reached = fitted(car(tmp_path / "case", {"multipass": {"kappa": 0.3}}), ["multipass"])
    assert 0.9 < reached < 1.1
    assert agrees(found["multipass.kappa"], 0.3)
    assert agrees(found["k_s"], CAR["k_s"])
    assert agrees(found["friction_angle"], CAR["friction_angle"])


def test_an_own_expression_acts_inside_the_integrator(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = '[effect.my_drag]\nexpression = "k * omega * abs(omega)"\n'
    own += 'target = "rolling_resistance"\nk = { value = 0, unit = "N m s^2" }\n[data]\n'
    folder = cylinder(tmp_path / "case", {"speed_squared": {"f_s": 2e-3}}, 3, CMR.replace("[data]\n", own))
    found, reached = fitted(folder, ["my_drag"])
    assert 0.9 < reached < 1.1
    assert agrees(found["my_drag.k"], 2e-3 * 0.08 * 18.639)
    status, _, err = terrapin(capsys, "add", folder, "mine", "--expression", "j * warp", "--parameter", "j=0:-1:1:N m")
    assert status == 2
    assert "warp is no role, column or parameter" in err
    assert "omega" in err


def test_derivatives_are_those_of_the_prediction(tmp_path: Path) -> None:
    for folder in (cylinder(tmp_path / "a", {}, 2), sphere(tmp_path / "b", 1.0), car(tmp_path / "c", {})):
        case = load_case(folder)
        bound = Model.of(case).bind(case.inputs)
        theta = Model.of(case).start
        prediction, slopes = bound.jacobian(theta)
        np.testing.assert_array_equal(prediction, bound.predict(theta))
        for i, value in enumerate(theta):
            step = 1e-3 * value
            up, down = theta.copy(), theta.copy()
            up[i], down[i] = value + step, value - step
            central = (bound.predict(up) - bound.predict(down)) / (2.0 * step)
            size = np.abs(central).max()
            assert np.abs(slopes[..., i] - central).max() < 0.01 * size


def test_rows_of_a_run_are_put_in_order_of_time_and_a_part_of_them_is_the_same(tmp_path: Path) -> None:
    folder = cylinder(tmp_path / "case", {}, 3)
    case = load_case(folder)
    model = Model.of(case)
    whole = model.bind(case.inputs).predict(model.start)
    np.testing.assert_array_equal(model.bind(case.inputs, case.train).predict(model.start), whole[:, case.train])
    lines = (folder / "runs.csv").read_text().splitlines()
    (folder / "runs.csv").write_text("\n".join([lines[0], *reversed(lines[1:])]) + "\n")
    turned = load_case(folder)
    np.testing.assert_allclose(Model.of(turned).bind(turned.inputs).predict(model.start), whole[:, ::-1], rtol=1e-9)


def _loaded(folder: Path) -> Case:
    case = load_case(folder)
    Model.of(case).bind(case.inputs)
    return case


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("f_o = {", "g_o = {", r"fit.g_o: unknown name"),
        ('voltage = { column = "voltage", unit = "V" }\n', "", r"role voltage is not mapped"),
        ('unit = "V"', 'unit = "A"', r"'A', which does not convert to 'V'"),
        ('base = "cmr"', 'base = "cmr"\neffects = ["load_transfer"]', r"load_transfer acts on vehicle, found base cmr"),
        ('base = "cmr"', 'base = "cmr"\neffects = ["slope"]', r"slope needs the role slope"),
        ('column = "time"', 'column = "voltage"', r"column 'voltage' is mapped as time"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in CMR
    folder = cylinder(tmp_path / "case", {}, 2, CMR.replace(old, new))
    with pytest.raises(UserError, match=message):
        _loaded(folder)


def test_times_of_a_run_differ(tmp_path: Path) -> None:
    folder = cylinder(tmp_path / "case", {}, 2)
    lines = (folder / "runs.csv").read_text().splitlines()
    (folder / "runs.csv").write_text("\n".join([*lines[:4], *lines[3:]]) + "\n")
    with pytest.raises(UserError, match=r"runs.csv:\d+: time: found .* s twice in run r0, expected it once"):
        _loaded(folder)


def test_a_car_takes_uneven_steps(tmp_path: Path) -> None:
    folder = car(tmp_path / "case", {})
    lines = (folder / "runs.csv").read_text().splitlines()
    whole = _loaded(folder)
    del lines[7]
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    fewer = _loaded(folder)
    every, some = (Model.of(case).bind(case.inputs).predict(Model.of(case).start) for case in (whole, fewer))
    # the torque is linear between samples: a row less changes it between its neighbours, and little afterwards
    assert np.allclose(np.delete(every, 6, axis=1)[:, :5], some[:, :5])
    assert np.abs(np.delete(every, 6, axis=1) - some).max() < 0.05 * np.abs(some).max()
