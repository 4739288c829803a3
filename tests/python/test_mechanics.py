"""The mechanics that an equation gets from columns whose role is told: which, their formulas, units, and bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from casekit import one_line, terrapin
from scipy.signal import TransferFunction, lsim

from terrapin_hil.physics.expression import parse
from terrapin_hil.physics.mechanics import ROLES, mechanics
from terrapin_hil.physics.signals import play, played
from terrapin_hil.units import read_unit
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case import columns
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.case.mends import Mend
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.model import Model

Array = npt.NDArray[np.float64]

COLUMNS = {  # name in the case -> column, unit, role
    "v": ("v", "rad/s", "speed"),
    "x": ("x", "rad", "position"),
    "acc": ("acc", "rad/s^2", "acceleration"),
    "temp": ("temp", "degC", "temperature"),
    "i": ("i", "A", "current"),
    "t": ("t", "s", "time"),
    "way": ("way", "1", "direction"),
}
VALUES = {
    "k": 0.7,
    "a": 0.4,
    "v_s": 0.8,
    "v_0": 0.3,
    "b": 0.05,
    "w": 0.5,
    "n": 7.0,
    "phase": 0.3,
    "j": 0.02,
    "c": 0.1,
    "r": 0.2,
    "g": 0.1,
    "tau": 0.03,
}


def table(rows: int = 60, runs: int = 5) -> dict[str, Array]:
    random = np.random.default_rng(3)
    t = np.tile(0.02 * np.arange(rows), runs)
    x = 2.0 * np.sin(2.0 * t + np.repeat(np.arange(runs), rows))
    v = 4.0 * np.cos(2.0 * t + np.repeat(np.arange(runs), rows))
    acc = -8.0 * np.sin(2.0 * t + np.repeat(np.arange(runs), rows))
    return {
        "v": v, "x": x, "acc": acc, "t": t, "way": np.sign(v),
        "temp": random.uniform(20.0, 80.0, len(t)), "i": random.uniform(-3.0, 3.0, len(t)),
        "tau": random.uniform(-2.0, 2.0, len(t)),
    }  # fmt: skip


def write(
    folder: Path,
    told: str,
    *,
    effects: str = "",
    lines: str = 'torque = "kt*i"',
    plus: Array | float = 0.0,
    extra: str = "",
    change: dict[str, Array] | None = None,
) -> Path:
    """A case of a motor's torque; `told` lists the columns whose role is told, `plus` is what the model lacks."""
    columns = {**table(), **(change or {})}
    random = np.random.default_rng(5)
    columns["torque"] = 0.5 * columns["i"] + plus + 0.01 * random.standard_normal(len(columns["i"]))
    if "torque_2" in lines:
        columns["torque_2"] = columns["torque"]
    rows = np.array([columns[name] for name in columns]).T
    text = ["run," + ",".join(columns)]
    text += [f"r{n // 60}," + ",".join(f"{v:.15g}" for v in row) for n, row in enumerate(rows)]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "d.csv").write_text("\n".join(text) + "\n")
    mapped = []
    for name, (column, unit, role) in COLUMNS.items():
        known = f', is = "{role}"' if role in told.split() else ""
        if known or name == "i":
            mapped.append(f'{name} = {{ column = "{column}", unit = "{unit}"{known} }}\n')
    (folder / "case.toml").write_text(
        f'[model]\nbase = "equation"\neffects = [{effects}]\n[model.equation]\n{lines}\n'
        '[fit]\nkt = { value = 0.5, min = 0.0, max = 5.0, unit = "N m/A" }\n'
        f'[data]\nfiles = ["d.csv"]\nrun = "run"\n[data.columns]\n{"".join(mapped)}'
        f'torque = {{ column = "torque", unit = "N m", sigma = 0.01 }}\n{extra}'
    )
    return folder


def added(case: Case, name: str, values: dict[str, float]) -> Array:
    """What an effect adds to the channel, with its parameters at these values."""
    model = Model.of(case)
    without = model.bind(case.inputs).predict(model.start)
    larger = model.having(case.library[name])
    theta = np.array([values.get(f.name, f.start) if f.effect else f.start for f in larger.fitted])
    return np.asarray((larger.bind(case.inputs).predict(theta) - without)[0])


def expected(name: str, c: dict[str, Array]) -> Array:
    """The effects once more, in NumPy, as the contract prints them."""
    p, v, x, i = VALUES, c["v"], c["x"], c["i"]
    followed = np.concatenate([play(c["t"][:60], x[n : n + 60], p["w"]) for n in range(0, len(x), 60)])
    stuck = np.abs(v) <= p["v_0"]
    low_pass = TransferFunction([1.0], [p["tau"], 1.0])  # settled where a run begins
    starts = np.repeat(0.5 * i[::60], 60)
    through = [lsim(low_pass, 0.5 * i[n : n + 60] - 0.5 * i[n], c["t"][:60])[1] for n in range(0, len(i), 60)]
    return {
        "coulomb_friction": p["k"] * np.sign(v),
        "stiction": np.where(stuck, 0.0, p["k"] * np.sign(v) * (1 + p["a"] * np.exp(-((v / p["v_s"]) ** 2)))),
        "stribeck": p["k"] * np.exp(-((v / p["v_s"]) ** 2)) * np.sign(v),
        "viscous_friction": p["b"] * v,
        "viscous_asymmetry": p["b"] * np.abs(v),
        "speed_squared": p["k"] * v * np.abs(v),
        "stiffness": p["k"] * x,
        "backlash": p["k"] * followed,
        "cogging": p["k"] * np.sin(p["n"] * x + p["phase"]),
        "imbalance": p["k"] * np.sin(x + p["phase"]),
        "inertia": p["j"] * c["acc"],
        "offset": np.full(len(v), p["c"]),
        "heating": 0.5 * i * p["a"] * (c["temp"] - 25.0),
        "saturation": p["k"] * i * np.abs(i),
        "gain": 0.5 * i * p["g"],
        "sensor_lag": np.concatenate(through) + starts - 0.5 * i,
        "dead_zone": p["k"] * np.sign(x) * np.maximum(np.abs(x) - p["w"], 0.0),
        "smooth_friction": p["k"] * np.tanh(v / p["v_s"]),
        "resistance": p["r"] * i,
        "copper_loss": p["r"] * i**2,
        "speed_loss": p["b"] * np.abs(v),
        "eddy_loss": p["k"] * v**2,
    }[name]


UNITS = {
    "coulomb_friction": {"k": "N m"}, "stiction": {"k": "N m", "a": "1", "v_s": "rad/s", "v_0": "rad/s"},
    "stribeck": {"k": "N m", "v_s": "rad/s"}, "viscous_friction": {"b": "N m s/rad"},
    "viscous_asymmetry": {"b": "N m s/rad"}, "speed_squared": {"k": "N m s^2/rad^2"},
    "stiffness": {"k": "N m/rad"}, "backlash": {"k": "N m/rad", "w": "rad"},
    "cogging": {"k": "N m", "n": "1", "phase": "rad"},
    "imbalance": {"k": "N m", "phase": "rad"},
    "inertia": {"j": "N m s^2/rad"}, "offset": {"c": "N m"}, "heating": {"a": "1/K"}, "saturation": {"k": "N m/A^2"},
    "gain": {"g": "1"}, "sensor_lag": {"tau": "s"},
    "dead_zone": {"k": "N m/rad", "w": "rad"},
    "smooth_friction": {"k": "N m", "v_s": "rad/s"},
}  # fmt: skip


OF_CHANNEL = {  # unit of the channel -> effects that act on nothing else
    "V": {"resistance": {"r": "V/A"}},
    "W": {"copper_loss": {"r": "W/A^2"}, "speed_loss": {"b": "W s/rad"}, "eddy_loss": {"k": "W s^2/rad^2"}},
}


def test_the_catalogue_is_that_of_the_contract() -> None:
    assert mechanics().keys() == UNITS.keys() | {name for effects in OF_CHANNEL.values() for name in effects}
    for effect in mechanics().values():
        assert all((effect.title, effect.equation, effect.source))
        size = effect.parameters[0]
        assert size.start == 0.0
        assert (size.minimum < 0.0) == (effect.name not in ("cogging", "imbalance", "sensor_lag"))  # others may help
        assert all(p.meaning and p.minimum <= p.start <= p.maximum for p in effect.parameters)
        assert {role for group in effect.needs for role in group} <= {*ROLES, "angle"}


@pytest.mark.parametrize("name", sorted(UNITS))
def test_formula_and_units(tmp_path: Path, name: str) -> None:
    case = load_case(write(tmp_path, "speed position acceleration temperature current time"))
    assert added(case, name, VALUES) == pytest.approx(expected(name, table()), rel=1e-6, abs=1e-8)
    assert added(case, name, {**VALUES, case.library[name].parameters[0].name: 0.0}) == pytest.approx(0.0, abs=1e-12)
    for parameter in case.library[name].parameters:
        wanted = read_unit(UNITS[name][parameter.name])
        assert read_unit(parameter.unit) == wanted, parameter.name
        assert parameter.minimum <= parameter.start <= parameter.maximum
        assert all(parameter.minimum <= value <= parameter.maximum for value in parameter.grid)


@pytest.mark.parametrize("unit", sorted(OF_CHANNEL))
def test_a_voltage_and_a_power_have_effects_of_their_own(tmp_path: Path, unit: str) -> None:
    text = (write(tmp_path, "speed temperature current") / "case.toml").read_text().replace('"N m', f'"{unit}')
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path)
    for name, parameters in OF_CHANNEL[unit].items():
        assert added(case, name, VALUES) == pytest.approx(expected(name, table()), rel=1e-6, abs=1e-8)
        for parameter in case.library[name].parameters:
            assert read_unit(parameter.unit) == read_unit(parameters[parameter.name])
    others = {name for other, effects in OF_CHANNEL.items() if other != unit for name in effects}
    assert not others & case.library.keys()
    assert ("coulomb_friction" in case.library) == (unit != "W")  # a force is no part of a power
    assert {"offset", "heating"} <= case.library.keys()


@pytest.mark.parametrize(
    ("told", "brought"),
    [
        ("position", {"stiffness", "backlash", "cogging", "imbalance", "dead_zone"}),
        ("temperature", {"heating"}),
        ("acceleration", {"inertia"}),
        ("direction", {"coulomb_friction"}),
        ("time", {"sensor_lag"}),
        ("speed time", {"coulomb_friction", "stiction", "stribeck", "viscous_friction", "viscous_asymmetry",
                        "speed_squared", "smooth_friction", "inertia", "sensor_lag"}),
    ],
)  # fmt: skip
def test_an_effect_comes_with_its_role(tmp_path: Path, told: str, brought: set[str]) -> None:
    case = load_case(write(tmp_path, told))
    assert case.library.keys() == brought | {"offset", "gain", "saturation"}  # the current is told by its unit


def test_a_case_that_tells_no_role_has_no_mechanics(tmp_path: Path) -> None:
    case = load_case(write(tmp_path, "", extra='v = { column = "v", unit = "rad/s" }\n'))
    assert not case.library
    assert not case.told


def test_units_tell_the_rest_where_only_one_column_has_them(tmp_path: Path) -> None:
    both = 'v = { column = "v", unit = "rpm" }\ntau = { column = "tau", unit = "mN m" }\n'
    case = load_case(write(tmp_path / "one", "position", extra=both))
    assert case.told == {"position": "x", "speed": "v", "current": "i", "torque": "tau"}
    more = both + 'u = { column = "acc", unit = "m/s" }\n'
    assert "speed" not in load_case(write(tmp_path / "two", "position", extra=more)).told


def test_saturation_by_the_torque(tmp_path: Path) -> None:
    tau = 'tau = { column = "tau", unit = "N m" }\nuw = { column = "i", unit = "A" }\n'
    case = load_case(write(tmp_path, "speed", extra=tau))  # two columns in A: neither is the current
    assert case.library["saturation"].expression == "k*tau*abs(tau)"


def test_inertia_by_the_derivative_of_the_speed(tmp_path: Path) -> None:
    case = load_case(write(tmp_path, "speed time"))
    slope = np.concatenate([np.gradient(table()["v"][n : n + 60], 0.02) for n in range(0, 300, 60)])
    assert added(case, "inertia", {"j": 0.02}) == pytest.approx(0.02 * slope, rel=1e-6, abs=1e-7)
    rows = case.run == 2  # some runs alone
    model = Model.of(case).having(case.library["inertia"])
    theta = np.append(Model.of(case).start, 0.02)
    whole, part = (model.bind(case.inputs, r).predict(theta) for r in (None, rows))
    assert part == pytest.approx(whole[:, rows])
    assert read_unit(case.library["inertia"].parameters[0].unit) == read_unit("N m s^2/rad")


def test_a_low_pass_of_the_sensor_is_named_and_starts_anew_in_each_run(tmp_path: Path) -> None:
    c = table()
    case = load_case(write(tmp_path, "speed time", plus=expected("sensor_lag", c)))
    found = discover(case)
    assert (found.verdict, found.missing) == ("missing", ("sensor_lag",))
    assert found.ladder[-1].fit.theta[-1] == pytest.approx(0.03, abs=0.001)  # s
    model = Model.of(case).having(case.library["sensor_lag"])
    theta = np.append(Model.of(case).start, 0.03)
    whole, part = (model.bind(case.inputs, rows).predict(theta) for rows in (None, case.run == 2))
    assert part == pytest.approx(whole[:, case.run == 2])


def test_a_direction_gives_the_speed_its_sign(tmp_path: Path) -> None:
    c = table()
    case = load_case(write(tmp_path, "speed time direction", change={"v": np.abs(c["v"])}))
    for name in ("coulomb_friction", "viscous_friction", "speed_squared", "stribeck", "viscous_asymmetry"):
        assert added(case, name, VALUES) == pytest.approx(expected(name, c), rel=1e-6, abs=1e-8), name
    alone = load_case(write(tmp_path, "direction"))
    assert added(alone, "coulomb_friction", VALUES) == pytest.approx(expected("coulomb_friction", c))


def test_asymmetry_needs_both_directions(tmp_path: Path) -> None:
    case = load_case(write(tmp_path, "speed", change={"v": np.abs(table()["v"])}))
    assert "viscous_asymmetry" not in case.library
    assert "viscous_friction" in case.library


@pytest.mark.parametrize(("unit", "degrees"), [("K", lambda c: c + 273.15), ("degF", lambda c: 1.8 * c + 32.0)])
def test_heating_counts_from_25_degrees_in_any_unit(tmp_path: Path, unit: str, degrees: object) -> None:
    assert callable(degrees)
    told = f'temp = {{ column = "temp", unit = "{unit}", is = "temperature" }}\n'
    case = load_case(write(tmp_path, "", extra=told, change={"temp": degrees(table()["temp"])}))
    assert added(case, "heating", VALUES) == pytest.approx(expected("heating", table()), rel=1e-6)


def test_cogging_of_degrees_and_of_a_length(tmp_path: Path) -> None:
    told = 'x = { column = "x", unit = "deg", is = "position" }\n'
    case = load_case(write(tmp_path / "deg", "", extra=told, change={"x": np.degrees(table()["x"])}))
    assert added(case, "cogging", VALUES) == pytest.approx(expected("cogging", table()), rel=1e-5, abs=1e-6)
    assert case.library["cogging"].parameters[1].minimum == 2.0
    assert added(case, "imbalance", VALUES) == pytest.approx(expected("imbalance", table()), rel=1e-5, abs=1e-6)
    case = load_case(write(tmp_path / "m", "", extra=told.replace("deg", "mm")))
    assert "imbalance" not in case.library
    number = case.library["cogging"].parameters[1]
    assert not number.whole
    assert number.unit == "rad/mm"
    assert number.grid[:2] == pytest.approx((2 * np.pi / 4.0, 4 * np.pi / 4.0), rel=1e-2)


def test_once_a_turn_is_an_imbalance_and_no_cogging(tmp_path: Path) -> None:
    for name, waves in (("imbalance", 1.0), ("cogging", 3.0)):
        plus = 0.2 * np.sin(waves * table()["x"] + 0.4)
        found = discover(load_case(write(tmp_path / name, "position", plus=plus)))
        assert (found.verdict, found.missing) == ("missing", (name,))


def test_several_channels_and_parameters_are_named(tmp_path: Path) -> None:
    lines = 'torque = "kt*i + r0"\ntorque_2 = "kt*i"'
    folder = write(
        tmp_path, "speed temperature", lines=lines, extra='torque_2 = { column = "torque_2", unit = "N m" }\n'
    )
    text = (folder / "case.toml").read_text().replace("[data]\n", 'r0 = { value = 0.0, unit = "N m" }\n[data]\n', 1)
    (folder / "case.toml").write_text(text)
    case = load_case(folder)
    assert {"coulomb_friction_on_torque", "coulomb_friction_on_torque_2", "heating_on_kt", "heating_on_r0"} <= (
        case.library.keys()
    )
    assert case.library["coulomb_friction_on_torque_2"].target == "torque_2"
    assert "coulomb_friction" not in case.library


def test_what_is_measured_tells_no_role_by_its_unit() -> None:
    """Of what the equations predict, an effect would explain the measurement by itself."""

    def column(name: str, unit: str, channel: bool = False, role: str = "") -> columns.Mapped:
        return columns.Mapped(name, name, unit, unit, 0.1, channel, role, Mend())

    speed, measured, input_ = column("v", "rad/s", role="speed"), column("a", "K", channel=True), column("b", "K")
    assert columns._told([speed, measured, input_]) == {"speed": "v", "temperature": "b"}
    assert columns._told([speed, measured]) == {"speed": "v"}
    assert columns._told([column("w", "rad/s"), speed]) == {"speed": "v"}
    assert columns._told([column("w", "rad/s"), input_]) == {}  # nobody told any


def test_a_force_keeps_the_spelling_of_the_channels_unit(tmp_path: Path) -> None:
    assert load_case(write(tmp_path, "speed")).library["coulomb_friction"].parameters[0].unit == "N m"


def test_a_column_may_be_called_as_a_parameter(tmp_path: Path) -> None:
    told = 'k = { column = "v", unit = "rad/s", is = "speed" }\n'
    effect = load_case(write(tmp_path, "", extra=told)).library["coulomb_friction"]
    assert effect.expression == "k_*sign(k)"
    assert parse(effect.expression).names == {"k", "k_"}


def test_many_rows_follow_as_one_by_one() -> None:
    random = np.random.default_rng(8)
    x = np.cumsum(random.standard_normal(700))
    first = np.zeros(700, dtype=bool)
    first[[0, 5, 6, 400]] = True
    for i, gap in enumerate(gaps := np.array([0.0, 0.3, 2.0, 50.0])):
        parts = np.split(x, np.flatnonzero(first)[1:])
        whole = np.concatenate([play(np.arange(len(part)), part, gap) for part in parts])
        assert played(x, gaps, first)[i] == pytest.approx(whole)


@pytest.mark.parametrize(
    ("plus", "name"),
    [
        (lambda c: 0.05 * np.sign(c["v"]), "coulomb_friction"),
        (lambda c: 0.02 * c["i"] * np.abs(c["i"]), "saturation"),
        (lambda c: 0.5 * c["i"] * 0.004 * (c["temp"] - 25.0), "heating"),
    ],
)
def test_discover_names_it_and_add_fits_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], plus: object, name: str
) -> None:
    assert callable(plus)
    case = write(tmp_path / "case", "speed temperature", plus=plus(table()))
    status, out, _ = terrapin(capsys, "discover", case, "--json", "-")
    assert status == 0
    answer = json.loads(out)
    named = {one for effects in [answer["missing"], *answer["rivals"]] for one in effects}
    assert name in named
    status, out, _ = terrapin(capsys, "add", case, name, "--json", "-")
    after = json.loads(out)["after"]
    assert after["heldout_error"] < 1.2
    assert terrapin(capsys, "report", case, "-o", tmp_path / "page.html", "--no-discover")[0] == 0
    assert f"{name}.{mechanics()[name].parameters[0].name}" in (tmp_path / "page.html").read_text()


BAD = {
    "unknown": ('is = "speed"', 'is = "sped"', ["data.columns.v.is: found 'sped'", "expected one of speed, position"]),
    "twice": ("acceleration", "speed", ["data.columns.acc.is: v is told to be the speed too", "expected one column"]),
    "dimension": ("rad/s\", is", "N\", is", ["data.columns.v.unit: found 'N' for a speed, expected m/s or rad/s"]),
    "plain": ("rad/s\", is", "Hz\", is", ["found 'Hz' for a speed"]),
    "text": ('is = "speed"', "is = 3", ["data.columns.v.is: found 3, expected text"]),
    "channel": ("sigma = 0.01", 'is = "torque"', ["data.columns.torque.is: unknown name"]),
    "no role": ("effects = []", 'effects = ["backlash"]', ["model.effects: backlash needs a column", "position"]),
    "own name": (
        "[data]", '[effect.stiction]\nexpression = "i"\n[data]', ["effect.stiction: is the name of a catalogued effect"]
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str) -> None:
    old, new, words = BAD[case]
    folder = write(tmp_path / "case", "speed acceleration")
    text = (folder / "case.toml").read_text()
    assert old in text
    place = text.rindex(old) if case == "twice" else text.index(old)
    (folder / "case.toml").write_text(text[:place] + new + text[place + len(old) :])
    status, _, err = terrapin(capsys, "compare", folder)
    assert status == 2
    one_line(err, ["case.toml:", *words])


def test_time_rises_within_a_run(tmp_path: Path) -> None:
    late = table()["t"].copy()
    late[7] = late[6]
    with pytest.raises(UserError, match=r"d\.csv:9: column t: found 0\.12 after 0\.12, expected a time that rises"):
        load_case(write(tmp_path, "speed time", change={"t": late}))


def test_no_role_under_another_base(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from casekit import ROLLING, rolling

    rolling(tmp_path, 1, text=ROLLING.replace('unit = "rpm" }', 'unit = "rpm", is = "speed" }'))
    status, _, err = terrapin(capsys, "compare", tmp_path)
    assert status == 2
    one_line(err, ["data.columns.omega.is: unknown name"])


def test_effects_lists_and_explains_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = terrapin(capsys, "effects")
    assert status == 0
    listed = out[out.index("On equation, ") :]
    assert all(f"  {name} " in listed for name in mechanics())
    for name in mechanics():
        status, out, _ = terrapin(capsys, "effects", name)
        assert status == 0
        assert mechanics()[name].expression in out
        assert mechanics()[name].parameters[0].meaning in out
    status, out, _ = terrapin(capsys, "effects", "backlash", "--case", write(tmp_path, "position"))
    assert "needs       x" in out
    assert "parameter   w [rad]" in out
