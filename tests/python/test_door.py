"""The front door for Python: what a notebook does with it, and that it says what the command line says."""

from __future__ import annotations

import doctest
import importlib
import inspect
import json
import os
import pickle
import re
import subprocess
import sys
import tomllib
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pandas as pd
import pyarrow
import pytest

import terrapin_tools as terrapin
from terrapin_hil import paths
from terrapin_tools import _HOMES
from terrapin_tools.workbench.story import sentences, terminal

ROOT = Path(__file__).resolve().parents[2]
FIT = {"a": (0.01, 0.0, 1.0, "N m"), "b": (1e-4, -1.0, 1.0, "N m s/rad")}
UNITS = {"w": "rpm", "M": "mN m", "temp": "degC"}


def bench(seed: int = 0) -> pd.DataFrame:
    """Six runs of a motor whose torque wanders with the temperature, which the model does not know."""
    draw = np.random.default_rng(seed)
    runs = []
    for run in range(6):
        w, temp = np.linspace(100.0, 900.0, 60), 25.0 + 8.0 * run + 0.02 * np.arange(60)
        torque = 10.0 + 0.02 * w + 0.06 * (temp - 25.0) + draw.normal(0.0, 0.1, 60)
        runs.append(pd.DataFrame({"run": run, "w": w, "M": torque, "temp": temp}))
    return pd.concat(runs, ignore_index=True)


@pytest.fixture(scope="module")
def case() -> terrapin.Case:
    return terrapin.Case.from_table(bench(), run="run", units=UNITS, equation={"M": "a + b*w"}, fit=FIT)


@pytest.fixture(scope="module")
def answer(case: terrapin.Case) -> terrapin.Answer:
    told: list[str] = []
    found = case.discover(progress=told.append)
    assert told
    return found


def command(*words: object) -> dict[str, Any]:
    program = "from terrapin_tools.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, words)], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_a_bench_in_eight_lines_says_what_the_command_line_says(
    case: terrapin.Case, answer: terrapin.Answer, tmp_path: Path
) -> None:
    better = case.add(answer.missing)
    folder = case.save(tmp_path / "my_case")
    same = command("discover", folder, "--json", "-")
    assert json.loads(answer.json()) | {"seconds": 0} == same | {"seconds": 0}
    assert answer.verdict == "missing"
    assert "temp" in answer.missing[0].expression
    added = command("add", folder, *answer.missing, "--json", "-")
    assert better.compare().as_dict()["ladder"] == added["ladder"]
    assert better.ladder().column("heldout_error").to_pylist() == [rung["heldout_error"] for rung in added["ladder"]]
    assert terrapin.Case.load(folder) == better
    figure = better.plot("residual", against="temp")
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure.axes[0].get_xlabel() == "temp [degC]"


def test_a_column_may_say_what_it_is(tmp_path: Path) -> None:
    """As `is` in case.toml: mechanics by their names become candidates."""
    draw = np.random.default_rng(4)
    rate = np.tile(np.linspace(-9.0, 9.0, 60), 6)
    angle = np.cumsum(rate) % 6.0
    torque = 0.5 * rate + 0.8 * np.sign(rate) + draw.normal(0.0, 0.05, 360)
    table = {"run": np.repeat(np.arange(6), 60), "rate": rate, "q": angle, "torque": torque}
    case = terrapin.Case.from_table(
        table,
        run="run",
        units={"v": "rad/s", "q": "rad", "torque": "N m"},
        columns={"v": "rate"},
        roles={"v": "speed", "q": "position"},
        equation={"torque": "b*v"},
        fit={"b": (0.1, -9.0, 9.0, "N m s/rad")},
    )
    assert 'v = {column = "rate", unit = "rad/s", is = "speed"}' in case.text
    assert case.discover(progress=lambda _: None).missing == ("coulomb_friction",)
    assert terrapin.Case.load(case.save(tmp_path / "case")) == case
    assert case.add("coulomb_friction").compare().verdict == "adequate"


@pytest.mark.parametrize("kind", ["pandas", "arrow", "columns", "interchange", "metadata"])
def test_every_table_that_speaks_arrow_is_the_same_case(case: terrapin.Case, kind: str) -> None:
    frame, units = bench(), UNITS
    table: Any = frame
    if kind == "arrow":
        table = pyarrow.Table.from_pandas(frame)
    elif kind == "columns":
        table = {name: frame[name].to_numpy() for name in frame}
    elif kind == "interchange":

        class Old:  # a library that has no Arrow stream yet
            def __dataframe__(self, **more: Any) -> Any:
                return pyarrow.Table.from_pandas(frame).__dataframe__(**more)

        table = Old()
    elif kind == "metadata":
        found = pyarrow.Table.from_pandas(frame)
        fields = [f.with_metadata({"unit": UNITS[f.name]}) if f.name in UNITS else f for f in found.schema]
        table, units = found.cast(pyarrow.schema(fields)), {}
    assert terrapin.Case.from_table(table, run="run", units=units, equation={"M": "a + b*w"}, fit=FIT) == case


def test_a_table_without_pandas(tmp_path: Path) -> None:
    """pandas is no dependency: where there is none, a case is made, asked and shown all the same."""
    program = f"""
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "pandas":
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Without())
import numpy as np, terrapin_tools as terrapin
w = np.tile(np.linspace(1.0, 9.0, 30), 4)
table = {{"run": np.repeat(np.arange(4), 30), "w": w, "M": 1.0 + w + np.random.default_rng(1).normal(0, 0.1, 120)}}
case = terrapin.Case.from_table(table, run="run", units={{"w": "rad/s", "M": "N m"}}, equation={{"M": "a + b*w"}},
                                fit={{"a": (0, -9, 9, "N m"), "b": (0, -9, 9, "N m s/rad")}})
case.save({str(tmp_path / "case")!r})
print(case.compare().verdict, case.residuals().num_rows)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120)
    assert done.stdout.split() == ["adequate", "120"], done.stderr


def test_cases_and_answers_are_values(case: terrapin.Case, answer: terrapin.Answer) -> None:
    before = case.text
    better = case.add(answer.missing)
    assert case.text == before
    assert case.effects == ()
    assert better != case
    assert better.remove(better.effects[0]).effects == ()
    for one in (case, better, answer, answer.missing[0], terrapin.Robot("sphere")):
        again = pickle.loads(pickle.dumps(one))
        assert again == one
        assert hash(again) == hash(one)
    assert pickle.loads(pickle.dumps(better)).compare() == better.compare()


def test_a_worker_gives_the_same_answer(case: terrapin.Case) -> None:
    import joblib

    (found,) = joblib.Parallel(n_jobs=2)([joblib.delayed(terrapin.Case.compare)(case)])
    assert found == case.compare()


def test_nothing_is_written_before_save(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    case = terrapin.Case.from_table(bench(), run="run", units=UNITS, equation={"M": "a + b*w"}, fit=FIT)
    case.compare()
    case.ladder()
    case.plot()
    assert list(tmp_path.iterdir()) == []


def test_prediction_knows_its_sd(case: terrapin.Case, answer: terrapin.Answer) -> None:
    """Of 40 tables the model's value at new rows is off by as many sd as it says: rms 1 within the scatter of 40."""
    new = {"w": np.array([200.0, 500.0, 800.0])}
    truth, off = 10.0 + 0.02 * new["w"], []
    noise = []
    for seed in range(40):
        draw = np.random.default_rng(seed + 100)
        w = np.tile(np.linspace(100.0, 900.0, 20), 5)
        table = {"run": np.repeat(np.arange(5), 20), "w": w, "M": 10.0 + 0.02 * w + draw.normal(0.0, 0.1, 100)}
        units = {"w": "rpm", "M": "mN m"}
        said = terrapin.Case.from_table(
            table, run="run", units=units, equation={"M": "a + b*w"}, fit=FIT, noise={"M": 0.1}
        ).predict(new)
        assert said.schema.field("M_sd").metadata[b"unit"] == b"mN m"
        off.append((said["M"].to_numpy() - truth) / said["M_sd"].to_numpy())
        noise += said["M_noise_sd"].to_pylist()
    same = np.isclose(noise, 0.1, rtol=1e-6)
    assert same.mean() > 0.9  # in a few of 40 tables white noise looks as if runs differed, or as if it grew
    assert np.array(noise)[~same] == pytest.approx(0.1, rel=0.2)
    mean_square = np.mean(np.square(off))
    assert 0.5 < mean_square < 1.7  # 40 tables of 2 parameters: 4 sd of a chi-square of 80, over 80
    with_all = case.add(answer.missing).predict(bench().head(3))
    assert with_all["M"].to_numpy() == pytest.approx(10.0 + 0.02 * bench()["w"].head(3), abs=0.1)


def test_a_prediction_beside_what_was_measured_is_told(case: terrapin.Case, answer: terrapin.Answer) -> None:
    """A torque at 4000 degC came without a word, and with a small sd."""
    with pytest.warns(
        UserWarning, match=r"1 of 2 rows lie outside .*: temp 4000 degC, fitted on 25 to 66.18 degC"
    ) as told:
        case.add(answer.missing).predict({"w": [300.0, 310.0], "temp": [4000.0, 60.0]})
    assert len(told) == 1
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        case.add(answer.missing).predict({"w": [95.0], "temp": [66.5]})  # what the model reads, and hardly beside it
        case.predict({"w": [300.0], "temp": [4000.0]})


def test_a_prediction_needs_what_the_model_reads() -> None:
    """An unmapped column of a formula was complained about with a line of case.toml; a time that no term of
    rolling_steady reads was asked for."""
    columns = bench().assign(day=1.0 + (bench()["run"] > 2))
    made = terrapin.Case.from_table(columns, run="run", units=UNITS, equation={"M": "a + b*w"}, fit=FIT)
    made = made.add(terrapin.Effect("of_day", "k*day", k=(0.0, -1.0, 1.0, "N m")))
    new = {"w": [300.0, 400.0]}
    with pytest.raises(terrapin.errors.InputError, match=r"^column day: is missing, expected it: the model needs day$"):
        made.predict(new)
    with pytest.raises(terrapin.errors.InputError, match=r"^column day: has a gap"):
        made.predict({**new, "day": [1.0, np.nan]})
    assert made.predict({**new, "day": [1.0, 2.0]}).num_rows == 2
    steady = terrapin.Case.example("heated_motor")
    table = steady.table()
    bare = table.select([n for n in table.column_names if n in ("omega", "load")])
    wanted = steady.predict(table)["current"].to_numpy()
    np.testing.assert_array_equal(steady.predict(bare)["current"].to_numpy(), wanted)
    with pytest.raises(terrapin.errors.InputError, match="the model needs temperature"):
        steady.add("motor_heating").predict(bare)
    roles = {"w": "speed", "t": "time"}
    timed = bench().assign(t=np.tile(np.arange(60.0), 6))
    late = terrapin.Case.from_table(
        timed, run="run", units={**UNITS, "t": "s"}, equation={"M": "a + b*w"}, fit=FIT, roles=roles
    ).add("sensor_lag")
    with pytest.raises(terrapin.errors.InputError, match="the model needs t"):
        late.predict({"w": np.linspace(300.0, 400.0, 9)})


def test_what_is_given_as_one_is_a_list_of_one_and_no_bound_may_be_infinite() -> None:
    given: dict[str, Any] = {"run": "run", "units": UNITS, "equation": {"M": "a + b*w"}}
    fit = {"a": (np.float32(0.0), -np.inf, np.inf, "N m"), "b": (np.int64(0), None, None, "N m s/rad")}
    made = terrapin.Case.from_table(bench(), fit=fit, train="3", effects="offset", roles={"w": "speed"}, **given)
    assert (made.effects, len(made.held_out)) == (("offset",), 5)
    assert "min" not in tomllib.loads(made.text)["fit"]["a"]
    table = bench().assign(note=["hand on it", *range(359)])  # words and numbers, which nothing reads
    assert terrapin.Case.from_table(table, fit=FIT, **given).rows == 360


def test_a_parameter_has_its_bounds(case: terrapin.Case, answer: terrapin.Answer) -> None:
    """Those that the case states, and those of an effect; open sides have none."""
    found = answer.parameters
    assert [(found[name].min, found[name].max, found[name].unit) for name in "ab"] == [
        (0.0, 1.0, "N m"),
        (-1.0, 1.0, "N m s/rad"),
    ]
    mine = terrapin.Effect("mine", "k*temp", "M", k=(0.0, -2.0, 3.0, "mN m/K"))
    with_mine = case.add(mine).compare()
    assert (with_mine.parameters["mine.k"].min, with_mine.parameters["mine.k"].max) == (-2.0, 3.0)
    assert with_mine.as_dict()["parameters"]["mine.k"]["max"] == 3.0
    open_ended = terrapin.Case.from_table(
        bench(), run="run", units=UNITS, equation={"M": "a + b*w"}, fit={"a": 0.01, "b": 0.0}
    )
    assert {(one.min, one.max) for one in open_ended.compare().parameters.values()} == {(None, None)}


def test_a_picture_on_axes_of_ones_own(case: terrapin.Case) -> None:
    axes = matplotlib.figure.Figure().subplots(1, 3)
    for ax, kind in zip(axes, ("residual", "prediction", "ladder"), strict=True):
        assert case.plot(kind, ax=ax) is ax
        assert ax.lines


def test_a_legend_names_all_that_is_drawn_and_the_model_hides_no_measurement(case: terrapin.Case) -> None:
    """The model agrees with most rows here: points of its own, drawn last, would leave nothing of those."""
    shown = {
        "residual": ["noise, 95 %", "training", "held out"],
        "prediction": ["model", "training", "held out"],
        "ladder": ["training", "held out", "noise sd"],
    }
    for kind, expected in shown.items():
        (axes,) = case.plot(kind).axes
        assert [text.get_text() for text in axes.get_legend().get_texts()] == expected
        assert axes.get_legend().get_window_extent().y0 >= axes.get_window_extent().y1 - 1.0
    model, training, held = case.plot("prediction").axes[0].lines
    assert model.get_markersize() > held.get_markersize() > training.get_markersize()
    assert [line.get_label() for line in (model, training, held)] == shown["prediction"]


def test_the_card(case: terrapin.Case, answer: terrapin.Answer) -> None:
    from rich.console import Console

    html = answer._repr_html_()
    assert answer.headline in html
    assert answer.missing[0] in html
    assert len(repr(answer).splitlines()) == 3
    console = Console(record=True, width=200)
    console.print(answer)
    assert repr(answer).splitlines()[1] in console.export_text()
    assert str(answer).startswith(repr(answer).splitlines()[0])
    title = "<script>alert(1)</script>"
    hostile = terrapin.Case.from_table(bench(), run="run", units=UNITS, equation={"M": "a + b*w"}, fit=FIT, title=title)
    assert "<script" not in hostile.compare()._repr_html_()


def test_nothing_takes_away_only_all_of_the_misfit(answer: terrapin.Answer) -> None:
    """Of one that is not named the share speaks for itself, be it 40 % or 100 %."""
    story = answer._story
    one = replace(story.cards[0].proposal, effect="other", explains=0.998, noise_ratio=1.6)
    said = sentences.reason(story.found, one, "")
    assert said == "Takes away 100 % of the misfit and leaves 1.60 noise sd on held-out runs."
    near = [sentences.reason(story.found, replace(one, noise_ratio=error), "") for error in (1.1, 1.2)]
    assert near[0].startswith("Fits nearly as well (1.10 noise sd on held-out runs)")
    assert near[1] == "Takes away 100 % of the misfit and leaves 1.20 noise sd on held-out runs."
    assert "has probability 0.97" in sentences.strange_noise(0.97)


@pytest.mark.parametrize(("explains", "told"), [(-1.0, "0 %"), (-0.3, "0 %"), (0.04, "4 %"), (0.62, "62 %")])
def test_the_list_of_candidates_and_the_reason_tell_one_share(
    answer: terrapin.Answer, explains: float, told: str
) -> None:
    """Of what makes the held-out error larger the list said -100 %, and the sentence beside it 0 %."""
    story = answer._story
    one = replace(story.cards[0].proposal, effect="other", probability=0.4, explains=explains, noise_ratio=4.2)
    card = replace(story.cards[0], proposal=one, reason=sentences.reason(story.found, one, ""))
    lines = terminal.tell(replace(story, cards=(*story.cards, card))).splitlines()
    (line,) = (line for line in lines if line.split()[:1] == ["other"] and "=" not in line)
    assert f"Takes away {told} of the misfit" in line
    assert re.findall(r"-?\d+ %", line) == [told, told]


def test_what_comes_next_is_a_call(case: terrapin.Case, answer: terrapin.Answer, tmp_path: Path) -> None:
    """A case of a table stands in no folder that a command could be given."""
    for said, call in ((str(case.compare()), "case.discover()"), (str(answer), "case.add(answer.missing)")):
        assert f"it:  {call}\n" in said
        assert "terrapin " not in said
    page = case.report(tmp_path / "page.html").read_text()
    assert "<code>case.add(answer.missing)</code>" in page
    assert "terrapin add" not in page


def test_the_report_is_that_of_the_command_line(tmp_path: Path) -> None:
    case = terrapin.Case.load(paths.examples()["heated_motor"])
    folder = case.save(tmp_path / "case")
    case.report(tmp_path / "door.html", discover=False)
    command("report", folder, "-o", tmp_path / "command.html", "--no-discover", "--json", "-")
    one, other = ((tmp_path / name).read_text() for name in ("door.html", "command.html"))
    assert one.replace(str(paths.examples()["heated_motor"]), "CASE") == other.replace(str(folder), "CASE")


def test_logged_runs_become_a_case(tmp_path: Path) -> None:
    for number in (1, 2):
        with terrapin.Session("steady_sand", seed=number, log=tmp_path / f"run_{number}") as s:
            s.step(12.0)
    logs = [terrapin.Log(tmp_path / f"run_{number}") for number in (1, 2)]
    case = terrapin.Case.from_log(*logs, effects=["speed_squared"], after=2.0)
    assert case.base == "rolling_steady"
    folder = case.save(tmp_path / "case")
    assert terrapin.Case.load(folder) == case
    assert pickle.loads(pickle.dumps(logs[0])) == logs[0]
    assert terrapin.Case.from_log(*logs, effects=["speed_squared"], after=2.0, robot="cylinder") == case
    column = logs[0]["GROUND.torque"]
    assert column.schema.field("GROUND.torque").metadata[b"unit"] == b"N m"
    grid = logs[0].table("100 ms")
    assert grid.num_rows > 100
    assert grid.schema.field("GROUND.torque").metadata[b"unit"] == b"N m"


def test_a_log_is_complained_about_in_the_words_of_a_program(tmp_path: Path) -> None:
    """What is missing is an argument that `from_log` has, not an option of a command."""
    for number in (1, 2):
        with terrapin.Session("steady_sand", seed=number, log=tmp_path / f"run_{number}") as s:
            s.step(0.2)
    logs = [tmp_path / "run_1", tmp_path / "run_2"]
    (tmp_path / "empty").mkdir()
    file = logs[1] / "run.toml"
    for given, other, expected in (
        ((tmp_path / "empty", *logs), {}, r"expected a run's folder \(Session\(\.\.\., log=FOLDER\)\)"),
        (logs, {}, "expected at least one; span= makes rows"),
        (logs, {"robot": "ship"}, "ship"),
        (logs, {"soil": "dry_sand_li"}, "^soil: found a cylinder"),
        (logs, {"span": -1.0}, "^span: found -1, expected 0.02 to 10 s"),
        (logs, {"effects": ["draag"]}, "^effects: found 'draag', expected one of .*drag"),
        (logs, {}, r"found 'sphere', expected 'cylinder': name it with robot="),
    ):
        if "sphere" in expected:
            file.write_text(file.read_text().replace('robot = "cylinder"', 'robot = "sphere"'))
            logs.reverse()
        with pytest.raises(terrapin.errors.InputError, match=expected) as caught:
            terrapin.Case.from_log(*given, **other)
        assert not re.search(r"(^|\s)--|terrapin ", str(caught.value))


def test_a_program_is_told_of_arguments_and_a_command_line_of_options(tmp_path: Path) -> None:
    from terrapin_hil.links.link import LinkError
    from terrapin_tools.errors import UserError, for_programs

    def refused(error: Exception) -> str:
        @for_programs
        def called(link_key: str = "", soil: str = "") -> None:
            raise error

        with pytest.raises((terrapin.errors.InputError, LinkError)) as caught:
            called()
        return str(caught.value)

    assert refused(UserError("--soil: found 'mud', expected sand")) == "soil: found 'mud', expected sand"
    assert refused(UserError("found no key, expected one (--link-key)")) == "found no key, expected one (link_key=)"
    assert refused(UserError("found mud; --soil=sand")) == "found mud; soil='sand'"
    assert refused(UserError("--read: found a --soil")) == "--read: found a soil="  # it has no word for the first
    assert refused(LinkError("pty: another's; --robot says whose")) == "pty: another's; Robot(NAME).use() says whose"
    file = tmp_path / "a.csv"
    assert str(tmp_path / "x--soil") in refused(UserError(f"{tmp_path / 'x--soil'}: no such file"))
    file.write_text("run;w;M\n1;1,000;2,000\n1;2,000;3,000\n")
    with pytest.raises(terrapin.errors.InputError, match=r"as it is meant \(pandas\.read_csv\), and give the table"):
        terrapin.Case.from_table(file, units=UNITS, equation={"M": "a + b*w"}, fit=FIT)
    with pytest.raises(terrapin.errors.InputError, match=r"expected a case's folder; Case\.from_table makes one"):
        terrapin.Case.load(file)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"units": {"w": "rpm"}}, "column M: found no unit, expected one"),
    ({"units": {**UNITS, "speed": "rpm"}}, "units: found speed, expected one of"),
    ({"units": {**UNITS, "w": "rmp"}}, "rmp"),
    ({"run": "test"}, "run: found 'test', expected one of run, w, M, temp"),
    ({"equation": {"torque": "a + b*w"}}, "equation: torque is no column"),
    ({"equation": {"M": "a + b*speed"}}, "speed has none"),
    ({"roles": {"w": "spin"}}, "roles: w: found 'spin', expected one of speed,"),
    ({"roles": {"M": "torque"}}, "roles: found M, expected an input of the model: one of w, temp"),
    ({"roles": {"v": "speed"}}, "roles: found v, expected an input"),
    ({"roles": {"w": "position"}}, "found 'rpm' for a position, expected"),
    ({"roles": {"w": "speed"}, "base": "rolling_steady", "equation": {}}, 'roles: expected only with base "equation"'),
    ({"effects": ["coulomb_friction"]}, "told to be the speed or direction (roles= of Case.from_table)"),
    ({"fit": {"a": (0.0, 1.0), "b": 1.0}}, "fit: a: found (0.0, 1.0), expected START"),
    ({"fit": {"a": "much", "b": 1.0}}, "fit: a: found 'much', expected START"),
    ({"base": "rolling"}, "base: found 'rolling', expected one of"),
    ({"table": 3}, "table: found a int, expected a DataFrame"),
    ({"table": bench().assign(M=["off", *bench()["M"][1:]])}, "table: row 1: column M: found text 'off', expected"),
    ({"table": {"w": 1.0, "M": [1.0]}}, "table: column w: found 1.0, expected an array: [1.0]"),
    ({"equation": "M = a + b*w"}, "equation: found 'M = a + b*w', expected a mapping: equation={NAME: ...}"),
    ({"fit": ["a", "b"]}, "fit: found ['a', 'b'], expected a mapping"),
    ({"noise": 0.1}, "noise: found 0.1, expected a mapping"),
    ({"roles": "speed"}, "roles: found 'speed', expected a mapping"),
    ({"units": {"w": 3}}, "units: w: found 3, expected texts"),
    ({"table": pd.DataFrame(np.ones((3, 2)), columns=["w", "w"])}, "table: "),
    ({"table": pyarrow.Table.from_arrays([[1.0], [2.0]], names=["w", "w"])}, "column 'w' stands twice, expected once"),
    ({"table": {"w": [], "M": []}}, "table: found 0 rows"),
    ({"table": {"w": [1.0, 2.0], "M": [1.0]}}, "table: "),
]


@pytest.mark.parametrize(("change", "expected"), WRONG, ids=[text[:30] for _, text in WRONG])
def test_what_is_wrong_is_one_line(change: dict[str, Any], expected: str) -> None:
    given: dict[str, Any] = {"table": bench(), "run": "run", "units": UNITS, "equation": {"M": "a + b*w"}, "fit": FIT}
    given |= change
    with pytest.raises(ValueError, match=r"\S") as caught:
        terrapin.Case.from_table(given.pop("table"), **given)
    assert isinstance(caught.value, terrapin.errors.InputError)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("heading", ["\u00d6ltemperatur", "\u00d6ltemperatur [degC]"])
def test_a_heading_of_any_alphabet_becomes_a_name_of_the_model(heading: str) -> None:
    """With its unit told by `units`, be the heading bare or one that has it."""
    table = bench().rename(columns={"temp": heading})
    units = {"w": "rpm", "M": "mN m", "\u00d6ltemperatur": "degC"}
    made = terrapin.Case.from_table(table, run="run", units=units, equation={"M": "a + b*w"}, fit=FIT)
    found = tomllib.loads(made.text)["data"]["columns"]
    assert found["Oeltemperatur"]["column"] == heading
    assert made.discover().missing


def test_a_column_with_a_unit_in_its_heading_is_taken_and_what_is_left_is_said() -> None:
    """`temp [degC]` that the equation does not name was no candidate, and no word said so."""
    table = bench().rename(columns={"w": "w [rpm]", "M": "M [mN m]", "temp": "temp [degC]", "run": "lap [-]"})
    rows = len(table)
    table["t in minutes"] = np.arange(rows) / 60.0
    table["oil temp"] = table["D [mm]"] = table["D [cm]"] = np.random.default_rng(1).normal(size=rows)
    table["gap [N]"] = np.where(np.arange(rows) % 2, 1.0, np.nan)
    table["a [N m]"] = 1.0
    table["day [-]"] = "monday"
    made = terrapin.Case.from_table(table, run="lap", equation={"M": "a + b*w"}, fit=FIT)
    found = tomllib.loads(made.text)["data"]["columns"]
    assert {name: entry["unit"] for name, entry in found.items()} == {
        "M": "mN m", "w": "rpm", "temp": "degC", "t": "min",
    }  # fmt: skip
    said = made.compare().as_dict()["intake"]["remarks"]
    assert said[0] == (
        "table: in no formula, as no name or no unit tells what they are: D [cm], D [mm], a [N m], oil temp "
        "(columns={'D': 'D [cm]'}, units={'D': UNIT} takes one)."
    )
    assert "Not looked at, for gaps: gap [N]." in said
    taken = {"columns": {"oil": "oil temp"}, "units": {"oil": "degC"}}
    again = terrapin.Case.from_table(table, run="lap", equation={"M": "a + b*w"}, fit=FIT, **taken)
    assert "oil temp" not in again.compare().as_dict()["intake"]["remarks"][0]
    assert again == pickle.loads(pickle.dumps(again)) != made


def test_other_complaints(case: terrapin.Case, tmp_path: Path) -> None:
    wrong = terrapin.errors.InputError
    for asked, expected in (
        (lambda: case.add("no_such"), "unknown effect no_such"),
        (lambda: case.add(terrapin.Effect("mine", "k*nothing", k=1.0)), "expression: nothing is no role"),
        (lambda: case.remove("drag"), "drag is not in the model"),
        (lambda: case.predict({"temp": [1.0]}), "column w: is missing, expected it"),
        (lambda: case.predict({"w": [1.0, np.nan]}), "no number in a mapped column"),
        (lambda: case.plot("pie"), "plot: found 'pie', expected one of residual, prediction, ladder"),
        (lambda: case.plot(against="colour"), "against: found 'colour', expected one of"),
        (lambda: case.plot(channel="x"), "channel: found 'x', expected one of M"),
        (lambda: case.compare(level=2.0), "level: found 2.0, expected a number between 0 and 1"),
        (lambda: case.compare(level="0.05"), "level: found '0.05', expected a number"),  # type: ignore[arg-type]
        (lambda: case.discover(seed=1.5), "seed: found 1.5, expected a whole number"),  # type: ignore[arg-type]
        (lambda: case.discover(bootstrap=-1), "bootstrap: found -1, expected a whole number"),
        (lambda: case.add(None), "add: found None, expected the name of an effect"),  # type: ignore[arg-type]
        (lambda: terrapin.Case.load(tmp_path / "no"), "no such file, expected a case folder"),
        (lambda: terrapin.Case.from_table(bench(), fit={"a": 1.0}), "equation: found none, expected a formula"),
        (lambda: terrapin.Case.example("no"), "example: found 'no', expected one of"),
        (lambda: terrapin.Log(tmp_path / "x.log"), "expected a readable log"),
        (lambda: terrapin.Log(paths.dbc()), "unknown kind of log"),
        (lambda: terrapin.Robot("elephant"), "elephant"),
        (lambda: terrapin.Link("telepathy"), "telepathy"),
        (lambda: terrapin.Effect("no name", "k", k=1.0), "expected a name of letters"),
    ):
        with pytest.raises(wrong, match=r"\S") as caught:
            asked()
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)
    case.save(tmp_path / "there")
    with pytest.raises(wrong, match="exists, expected a new folder"):
        case.save(tmp_path / "there")


def test_a_name_that_is_none_is_answered_by_those_there_are(case: terrapin.Case, tmp_path: Path) -> None:
    """Each was a bare KeyError. It still is one, as of every mapping."""
    with terrapin.Session("steady_sand", log=tmp_path / "run") as s:
        s.step(0.2)
        truth, sent = s.truth, s.signals
    answer = case.compare(intervals=True)
    effect = terrapin.Effect("mine", "k*w", k=(0, -1, 1, "N m s/rad"))
    with terrapin.Link("inprocess") as link:
        parameters = link.parameters
        assert link.write("window", "0.5 s").read("window") == 500.0
        with pytest.raises(ValueError, match="parameter window: found '5 kg', expected a number in ms"):
            link.write("window", "5 kg")
    for found, name, expected in (
        (truth, "contact_torqe", "truth: found no contact_torqe, is `contact_torque` meant? it has alpha_rate, "),
        (sent, "GROUND.x", "GROUND has GROUND.f_r, GROUND.limiting, "),
        (terrapin.Log(tmp_path / "run").signals, "x", "found no x, it has MESSAGE.signal of ACTUATE, "),
        (answer.parameters, "c", "parameters: found no c, it has a, b"),
        (answer.intervals, "c", "intervals: found no c, it has a, b"),
        (case.compare().intervals, "a", "intervals: found no a, it is empty"),
        (effect.parameters, "q", "parameters: found no q, it has k"),
        (terrapin.Robot().constants, "radus", "constants: found no radus, is `radius` meant? it has "),
        (parameters, "windw", "parameters: found no windw, is `window` meant? it has "),
    ):
        with pytest.raises(terrapin.errors.InputError) as caught:
            found[name]
        assert expected in str(caught.value)
        assert isinstance(caught.value, KeyError)
        assert found.get(name) is None
        assert found == dict(found) == pickle.loads(pickle.dumps(found))
    with pytest.raises(terrapin.errors.InputError, match="found no q, it has k"):
        effect.unit("q")


def test_a_file_that_changed_since_is_not_saved_as_if_it_had_not(tmp_path: Path) -> None:
    folder = terrapin.Case.example("heated_motor").save(tmp_path / "case")
    case = terrapin.Case.load(folder)
    file = folder / "runs.csv"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[:-1]))
    with pytest.raises(terrapin.errors.InputError, match="has changed since it was read"):
        case.save(tmp_path / "copy")
    assert not (tmp_path / "copy").exists()


def test_import_loads_nothing() -> None:
    """0.3 s and 40 MB are the bounds; modules are what a busy machine cannot blur."""
    program = r"""
import importlib, re, sys, time, warnings
before, began = set(sys.modules), time.perf_counter()
import terrapin_tools
took, held = time.perf_counter() - began, re.search(r"VmRSS:\s+(\d+)", open("/proc/self/status").read())
print(took, int(held[1]) / 1024, *sorted(set(sys.modules) - before))
"""
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert float(found[1]) < 40.0
    assert set(found[2:]) - sys.stdlib_module_names == {"terrapin_tools"}


def test_eight_public_names_and_each_is_documented_with_an_example_that_runs(tmp_path: Path) -> None:
    assert sorted(terrapin.__all__) == sorted([*_HOMES, "errors"])
    assert len(terrapin.__all__) <= 8
    names = {name: getattr(terrapin, name) for name in _HOMES} | {"paths": paths}
    names["errors"] = terrapin.errors
    here = Path.cwd()
    os.chdir(tmp_path)
    try:
        for name, home in _HOMES.items():
            found = getattr(terrapin, name)
            members = [member for key, member in vars(found).items() if not key.startswith("_") and callable(member)]
            members += [m for key, m in vars(found).items() if not key.startswith("_") and isinstance(m, property)]
            assert all(inspect.getdoc(member) for member in members), name
            finder, runner = doctest.DocTestFinder(recurse=True), doctest.DocTestRunner(verbose=False)
            module = importlib.import_module(home)
            tests = [t for t in finder.find(found, name, module=module, extraglobs=names) if t.examples]
            assert tests, name
            for test in tests:
                assert runner.run(test).failed == 0, test.name
        errors = importlib.import_module("terrapin_tools.errors")
        assert doctest.testmod(errors).failed == 0
    finally:
        os.chdir(here)


def test_the_reference_is_made_of_the_docstrings() -> None:
    done = subprocess.run([sys.executable, ROOT / "tests/tools/python_reference.py"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_programs_that_use_it_are_typed(tmp_path: Path) -> None:
    program = tmp_path / "own.py"
    program.write_text(
        """import terrapin_tools as terrapin

case: terrapin.Case = terrapin.Case.example("heated_motor")
answer: terrapin.Answer = case.discover()
better = case.add(answer.missing)
drag = terrapin.Effect("drag", "k * omega**2", k=(0.0, -1.0, 1.0, "N m s^2/rad^2"))
chance: float | None = answer.probability


def run(name: str) -> float:
    with terrapin.Session(name, seed=3) as s:
        s.until(lambda s: s.time > 0.1, timeout=1.0).inject("stuck", "motor")
        return s["GROUND.torque"] - s.truth["contact_torque"]


terrapin.Case.example(3)
try:
    run("steady_sand")
except terrapin.errors.InputError as error:
    print(error)
"""
    )
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file", "/dev/null", str(program)],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "MYPYPATH": os.pathsep.join(str(ROOT / p) for p in ("hil", "host_tools", "firmware"))},
    )  # fmt: skip
    (only,) = [line for line in done.stdout.splitlines() if line.startswith("own.py") and ": error" in line]
    assert only.startswith("own.py:16: error: Argument 1"), done.stdout


def test_equations_over_time_and_groups_are_those_of_a_file(tmp_path: Path) -> None:
    """A spring by the classical method of Runge and Kutta, and a brake on two surfaces."""
    step, state, rows = 0.02, np.array([0.2, 0.0]), list[tuple[float, float, float]]()
    for number in range(600):
        force = float(np.sin(0.026 * number))
        rows.append((step * number, force, 1000.0 * state[0]))

        def rate(y: np.ndarray, force: float = force) -> np.ndarray:
            return np.array([y[1], (force - 0.5 * y[1] - 8.0 * y[0]) / 1.3])

        slopes = [rate(state)]
        for share in (0.5, 0.5, 1.0):
            slopes.append(rate(state + share * step * slopes[-1]))
        state = state + step / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
    time, force, x = np.array(rows).T
    run, noise = np.arange(600) // 150, np.random.default_rng(1).standard_normal(600)
    given: dict[str, Any] = {
        "run": "run", "units": {"x": "mm", "force": "N", "t": "s"}, "columns": {"time": "t", "position": "x"},
        "states": {"x": ("fit", "m"), "v": ("fit", "m/s")}, "derivative": {"x": "v", "v": "(force - d*v - k*x)/m"},
        "measured": {"position": "x"}, "constants": {"m": "1300 g"}, "noise": {"position": 0.5}, "held": True,
        "fit": {"d": (0.3, 0, 5, "N s/m"), "k": (6.0, 0, 50, "N/m")},
    }  # fmt: skip
    spring = terrapin.Case.from_table({"run": run, "t": time, "force": force, "x": x + 0.5 * noise}, **given)
    saved = terrapin.Case.load(spring.save(tmp_path / "spring"))
    assert saved.compare().parameters == spring.compare().parameters
    assert 'inputs = "held"' in (tmp_path / "spring" / "case.toml").read_text()
    assert abs(spring.compare().parameters["k"].value - 8.0) < 0.1
    surface = np.array(["sand", "ice"])[run % 2]
    pull = np.where(run % 2, 0.1, 0.4) * (load := np.random.default_rng(2).uniform(10.0, 50.0, 600)) + 0.1 * noise
    brake = {"run": run, "load [N]": load, "pull [N]": pull, "surface": surface}
    more: dict[str, Any] = {"run": "run", "equation": {"pull": "mu*load"}, "fit": {"mu": (0.3, 0, 2, "1")}}
    found = terrapin.Case.from_table(brake, **more, groups={"mu": "surface"}).compare()
    assert found.parameters["mu[ice]"].value == pytest.approx(0.1, abs=0.01)
    for wrong, said in (
        ({"groups": {"nu": "surface"}}, "groups: found nu, expected a fitted parameter: one of mu"),
        ({"groups": {"mu": "floor"}}, "groups: mu: found 'floor', expected one of run, load"),
        ({"states": {"x": [1, 2, 3]}}, "states: x: found"),
    ):
        with pytest.raises(terrapin.errors.InputError, match=re.escape(said)):
            terrapin.Case.from_table(brake, **more, **wrong)
    with pytest.raises(terrapin.errors.InputError, match="measured: position is no column of the table"):
        terrapin.Case.from_table({"run": run, "t": time}, **{**given, "columns": {"time": "t"}, "units": {"t": "s"}})
