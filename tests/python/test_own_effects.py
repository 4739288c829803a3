"""A user's own effects: units that are checked and filled in, files that are read and never run, the same rights."""

from __future__ import annotations

import doctest
import math
from pathlib import Path

import numpy as np
import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_hil.effect_files import known_effects, read_effect_file, read_effect_folder
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.reading import ReadingError
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case import effect_units
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.effect_units import open_units, unit_problem

FOLDER = Path(__file__).parents[2] / "hil/terrapin_hil/physics/effects"
UNITS = {"omega": "rad/s", "load": "N", "radius": "m", "temperature": "degC", "speed": "m/s", "angle": "rad"}

GRASS = '''"""Drag of tall grass."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="own_grass",
    title="Drag of tall grass",
    equation=r"\\\\Delta C = c_g \\\\sqrt{|\\\\omega|}",
    source="a meadow",
    bases=("rolling_steady",),
    parameters=(Parameter("c_g", "N m s^0.5/rad^0.5", 0.0, 0.0, meaning="drag torque at 1 rad/s"),),
    needs=(("omega",),),
    expression="c_g * sqrt(abs(omega)) * sign(omega)",
    where="ground",
    passive=True,
)
'''


@pytest.fixture(autouse=True)
def home(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path_factory.mktemp("config")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder))
    return folder / "terrapin" / "effects"


def write(folder: Path, text: str, name: str = "grass.py") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    return folder / name


def own(folder: Path, table: str) -> Path:
    text = ROLLING.replace("effects = []", 'effects = ["mine"]') + f"\n[effect.mine]\n{table}\n"
    return rolling(folder, 1, text=text)


# -- units ------------------------------------------------------------------------------------------------------------


def test_docstring_examples() -> None:
    assert doctest.testmod(effect_units).failed == 0


@pytest.mark.parametrize(
    ("expression", "wanted", "expected"),
    [
        ("k*omega**3", "N m", {"k": "N m s^3/rad^3"}),
        ("k*exp(-(omega/w)**2)*sign(omega)", "N m", {"k": "N m", "w": "rad/s"}),
        ("a*(1-exp(-speed/v))", "A", {"a": "A", "v": "m/s"}),
        ("c*max(temperature-t0,0)", "1", {"c": "1/K", "t0": "K"}),
        ("a*b*omega", "N m", {"a": "N m s/rad", "b": "1"}),
        ("a + b*omega", "A", {"a": "A", "b": "A s/rad"}),
        ("k*load*radius*abs(omega/w)**p", "N m", {"k": "1", "w": "rad/s", "p": "1"}),
        ("k*(speed > v)", "N", {"k": "N", "v": "m/s"}),
    ],
)
def test_a_parameter_without_unit_carries_what_makes_it_sound(
    expression: str, wanted: str, expected: dict[str, str]
) -> None:
    from terrapin_hil.units import read_unit

    formula = parse(expression)
    found = open_units(formula, UNITS, list(expected), wanted)
    for name, unit in expected.items():
        assert read_unit(found[name]) == read_unit(unit), (name, found[name])
    assert unit_problem(formula, {**UNITS, **found}, wanted) is None


def test_parameters_with_units_arrive_in_si(tmp_path: Path) -> None:
    plain = load_case(own(tmp_path / "plain", 'expression = "k*omega"\nk = { value = 0.002, min = 0, max = 1 }'))
    scaled = own(
        tmp_path / "scaled", 'expression = "k*omega"\nk = { value = 2, min = 0, max = 1e3, unit = "mN m s/rad" }'
    )
    one, other = plain.library["mine"].parameters[0], load_case(scaled).library["mine"].parameters[0]
    assert (one.start, one.minimum, one.maximum) == pytest.approx((other.start, other.minimum, other.maximum))
    assert one.unit == "N*m*s/rad" or one.unit == "m*N*s/rad"


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ('expression = "k*omega**3"\nk = { value = 0, unit = "N m" }', ["comes out in", "expected N m", "k [N m]"]),
        ('expression = "load*0.1"', ["comes out in N, expected N m"]),
        ('expression = "k + omega"\nk = { value = 0, unit = "N m" }', ["+ between"]),
        ('expression = "k*exp(omega)"\nk = { value = 0 }', ["exp of a quantity in rad / s"]),
        ('expression = "k*omega"\ntarget = "current"\nk = { value = 0, unit = "N m" }', ["expected A"]),
        ('expression = "k*omega"\ntarget = "torque_constant"\nk = { value = 0, unit = "V" }', ["expected 1"]),
    ],
)
def test_unsound_units_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, expected: list[str]
) -> None:
    status, out, err = terrapin(capsys, "compare", own(tmp_path, table))
    assert (status, out) == (2, "")
    one_line(err, ["case.toml:30", "effect.mine.expression", *expected])


def test_a_zero_that_is_not_that_of_si_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = 'expression = "k*(temperature - t0)*omega"\nk = { value = 0 }\nt0 = { value = 30, unit = "degF" }'
    _, _, err = terrapin(capsys, "compare", own(tmp_path, table))
    one_line(err, ["case.toml:32", "effect.mine.t0.unit", "degF", "degC"])


# -- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", sorted(FOLDER.glob("[!_]*.py")), ids=lambda file: file.stem)
def test_the_whole_catalogue_reads_the_same_without_being_run(file: Path) -> None:
    effect = read_effect_file(file)
    assert effect == catalogue()[effect.name]


@pytest.mark.parametrize("place", ["config", "case", "named"])
def test_an_effect_of_a_file_has_the_rights_of_a_catalogued_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], home: Path, place: str
) -> None:
    """Listed, explained, ranked and added."""
    text = ROLLING.replace("effects = []", 'effects = []\neffects_folder = "mine"') if place == "named" else ROLLING
    folder = rolling(tmp_path / "case", 3, text=text)
    write({"config": home, "case": folder / "effects", "named": folder / "mine"}[place], GRASS)
    case = load_case(folder)
    assert case.missing_role(case.library["own_grass"]) is None
    status, out, err = terrapin(capsys, "add", folder, "own_grass")
    assert status == 0, err
    assert "Added own_grass" in out
    assert "own_grass.c_g" in out
    assert load_case(folder).effects == ("own_grass",)
    if place == "config":
        assert "own_grass" in known_effects()
        _, out, _ = terrapin(capsys, "effects")
        assert "Drag of tall grass" in out
        _, out, _ = terrapin(capsys, "effects", "own_grass")
        assert "a meadow" in out


def test_a_hidden_effect_of_a_file_is_discovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], home: Path
) -> None:
    """Data with c_g = 0.02 N m (s/rad)^0.5 in them, a parabola's square root that no catalogued effect is."""
    folder = rolling(tmp_path, 5, runs=12, rows=10)
    lines = (folder / "runs.csv").read_text().splitlines()
    changed = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",")
        omega = float(cells[1]) * math.pi / 30
        torque = 0.06 * math.sqrt(abs(omega)) * np.sign(omega)
        cells[4] = f"{float(cells[4]) + 1000 * torque * 0.018 / (0.08 * 0.1):.8g}"
        changed.append(",".join(cells))
    (folder / "runs.csv").write_text("\n".join(changed) + "\n")
    write(home, GRASS)
    import json

    status, out, err = terrapin(capsys, "discover", folder, "--json", "-")
    assert status == 0, err
    answer = json.loads(out)
    named = {name for names in [answer["missing"], *answer["rivals"]] for name in names}
    assert "own_grass" in named
    (found,) = [c for c in answer["candidates"] if c["effect"] == "own_grass"]
    assert found["parameters"]["c_g"]["value"] == pytest.approx(0.06, rel=0.1)


def test_the_simulator_takes_an_effect_of_a_file(home: Path) -> None:
    from terrapin_hil.library import ffi, library
    from terrapin_hil.physics.program import ROLES
    from terrapin_hil.robot.compiled_effects import ActiveEffect, compile_effects

    write(home, GRASS)
    effects = compile_effects([ActiveEffect(known_effects()["own_grass"], {"c_g": 0.01})], {})
    values, sums = ffi().new("double[]", library().HIL_ROLES), ffi().new("double[]", library().HIL_EFFECT_TARGETS)
    values[ROLES["omega"]] = -4.0
    library().hil_effects_sum(ffi().new("hil_effects *", effects.native), 1, values, sums)
    assert sums[0] == 0.01 * math.sqrt(4.0)  # the level of a friction on the ground
    assert not any(list(sums)[1:])  # and of nothing else


HOSTILE = {
    "import": ("import os\n" + GRASS, [":1:", "import os", "read, not run"]),
    "from os": ("from os import system\n" + GRASS, [":1:", "read, not run"]),
    "a call": (GRASS + "\nprint('hello')\n", ["print", "read, not run"]),
    "a call inside": (GRASS.replace('"a meadow"', '__import__("os").system("touch hit")'), ["__import__"]),
    "open": (GRASS.replace('"a meadow"', 'open("hit", "w")'), ["open"]),
    "an attribute": (GRASS.replace('"a meadow"', "pi.__class__"), ["pi.__class__"]),
    "a comprehension": (GRASS.replace('("rolling_steady",)', "tuple(b for b in [])"), ["for b in"]),
    "a lambda": (GRASS.replace('"a meadow"', "(lambda: 1)()"), ["lambda"]),
    "an f-string": (GRASS.replace('"a meadow"', 'f"{open}"'), ["f'{open}'"]),
    "a function": ("def f():\n    pass\n" + GRASS, [":1:", "def f"]),
    "a decorator": ("@print\nclass A:\n    pass\n" + GRASS, ["read, not run"]),
    "a power": (GRASS.replace("0.0, 0.0,", "9**9**9, 0.0,"), ["9 ** 9 ** 9"]),
    "a long text": (GRASS.replace('"a meadow"', '"a" * 10**9'), ["expected a number"]),
    "not Python": ("EFFECT = Effect(\n", [":1:", "not Python"]),
    "no effect": ('"""Nothing."""\n', ["EFFECT is missing"]),
    "unknown field": (GRASS.replace("source=", "sauce="), [":11:", "no field sauce"]),
    "missing field": (GRASS.replace('    title="Drag of tall grass",\n', ""), ["Effect", "'title'"]),
    "text for a tuple": (GRASS.replace('("rolling_steady",)', '"rolling_steady"'), [":12:", "bases", "tuple"]),
    "number for text": (GRASS.replace('"a meadow"', "5"), [":11:", "source", "text"]),
    "a bad unit": (GRASS.replace("N m s^0.5/rad^0.5", "furlongs per moon"), ["parameter c_g", "not a unit"]),
    "a bad expression": (GRASS.replace("sqrt(abs(omega))", "eval(omega)"), ["expression", "eval"]),
    "unused": (GRASS.replace("c_g * ", "0.1 * "), ["c_g", "does not occur"]),
    "start": (GRASS.replace("0.0, 0.0,", "1.0, 0.0,"), ["start 1", "size"]),
    "outside": (GRASS.replace("0.0, 0.0,", "0.0, 1.0,"), ["outside 1"]),
    "a division by zero": (GRASS.replace("0.0, 0.0,", "0.0, 1/0,"), ["division by zero"]),
    "a taken name": (GRASS.replace('"own_grass"', '"cogging"'), ["cogging", "in use"]),
    "where": (GRASS.replace('"ground"', '"sky"'), ["where", "robot or ground"]),
    "a name": (GRASS.replace('"own_grass"', '"my grass"'), ["name", "letters"]),
    "deep": ("EFFECT = " + "(" * 90 + "1" + ",)" * 90 + "\n", ["no Effect"]),
    "deeper": ("EFFECT = " + "-" * 40_000 + "1\n", ["grass.py"]),
    "wrong units": (GRASS.replace("N m s^0.5/rad^0.5", "N"), ["grass", "comes out in", "expected N m"]),
    "no such base": (GRASS.replace("rolling_steady", "flying"), ["own_grass", "flying", "rolling_steady"]),
    "no such role": (GRASS.replace('(("omega",),)', '(("mood",),)'), ["own_grass", "mood"]),
    "no such target": (GRASS.replace('where="ground"', 'target="weather"'), ["own_grass", "weather", "resistance"]),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_one_line_and_runs_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    text, expected = HOSTILE[name]
    folder = rolling(tmp_path / "case", 1, runs=3, rows=2)
    write(folder / "effects", text)
    monkeypatch.chdir(tmp_path)
    status, out, err = terrapin(capsys, "compare", folder)
    assert (status, out) == (2, "")
    one_line(err, expected)
    assert not (tmp_path / "hit").exists()


@pytest.mark.parametrize("text", ["-" * 900 + "k", "k" + "+k" * 400, "abs(" * 170 + "k" + ")" * 170])
def test_a_formula_too_deep_to_follow_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    status, _, err = terrapin(capsys, "compare", own(tmp_path, f'expression = "{text}"\nk = {{ value = 0 }}'))
    assert status == 2
    one_line(err, ["case.toml:30", "effect.mine.expression", "too deeply nested"])


def test_the_simulator_switches_it_on(tmp_path: Path, home: Path) -> None:
    from terrapin_hil.scenario.scenario import load_scenario

    write(home, GRASS)
    file = tmp_path / "s.toml"
    path = '[[path]]\nterrain = "sand"\n[[operator]]\nat = "0 s"\nrequest = "run"\nsetpoint = "8 V"\n'
    file.write_text('duration = "2 s"\n' + path + '[effect.own_grass]\nc_g = "10 mN m s^0.5/rad^0.5"\n')
    (active,) = load_scenario(file).effects
    assert active.effect.name == "own_grass"
    assert active.values["c_g"] == pytest.approx(0.01)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ReadingError, match=r"a\.py: not"):
        read_effect_folder(tmp_path, {})
    (tmp_path / "a.py").write_bytes(b"#" * 200_000)
    with pytest.raises(ReadingError, match="at most"):
        read_effect_folder(tmp_path, {})
    (tmp_path / "a.py").unlink()
    (tmp_path / "a.py").mkdir()
    with pytest.raises(ReadingError, match=r"a\.py"):
        read_effect_folder(tmp_path, {})


def test_a_target_that_the_base_does_not_have_is_told_with_where_it_stands(tmp_path: Path) -> None:
    """An effect without `target` acts on a resistance, which few base models have: nothing said which key to write."""
    folder = rolling(tmp_path, 1)
    write(folder / "effects", GRASS.replace('where="ground"', 'target="drag", where="ground"'))
    wrong = (
        r"own_grass: target: found 'drag', which rolling_steady does not have; expected one of .*resistance.*target="
    )
    with pytest.raises(UserError, match=wrong):
        load_case(folder)
