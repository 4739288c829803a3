"""What is changed in case.toml, as text, and what is told of columns that were read: piece by piece."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case import changes, columns, intake
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.changes import OwnEffect, OwnParameter
from terrapin_tools.workbench.case.mends import Mend, earlier, mended, read_mend, told_mends
from terrapin_tools.workbench.files.toml_tables import Tables

CASE = """# what the user wrote
[case]
title = "wheel"
guessed = ["parameters.radius", "parameters.mass"]
[model]
base = "rolling_steady"
effects = ["drag"]  # keep
[parameters]
radius = "80 mm"
mass = 3.0
[data]
files = ["runs.csv"]
[data.columns]
omega = { column = "speed", unit = "rad/s", factor = 0.5 }
load = { column = "load", unit = "N" }
"""


def test_a_constant_is_set_and_no_longer_guessed() -> None:
    found = changes.set_constant(CASE, "radius", "81 mm")
    assert found == CASE.replace('"80 mm"', '"81 mm"').replace('"parameters.radius", ', "")
    assert changes.set_constant(CASE, "mass", "4") == CASE.replace("mass = 3.0", "mass = 4.0").replace(
        ', "parameters.mass"', ""
    )
    plain = CASE.replace('guessed = ["parameters.radius", "parameters.mass"]\n', "")
    assert changes.set_constant(plain, "mass", "4") == plain.replace("3.0", "4.0")
    with pytest.raises(UserError, match=r"found 'width', expected a constant of \[parameters\]: radius, mass"):
        changes.set_constant(CASE, "width", "1")
    with pytest.raises(UserError, match=r"expected a constant of \[parameters\]: none"):
        changes.set_constant('[case]\ntitle = "x"\n', "mass", "1")
    with pytest.raises(UserError, match=r"expected a constant of \[parameters\]: none"):
        changes.set_constant('parameters = ["mass"]\n[case]\ntitle = "x"\n', "mass", "1")


def test_runs_are_held_out_by_name() -> None:
    runs = ["a", "b", "c"]
    assert 'test = ["b"]' in changes.hold_out(CASE, ["b"], runs)
    assert "train" not in changes.hold_out(CASE, ["b"], runs)
    listed = CASE.replace('files = ["runs.csv"]', 'files = ["runs.csv"]\ntrain = ["a"]\ntest = ["c"]')
    found = changes.hold_out(listed, ["b"], runs)
    assert 'train = ["a", "c"]' in found
    assert 'test = ["b"]' in found
    with pytest.raises(UserError, match="run 'd' is not in the data, expected one of a, b, c"):
        changes.hold_out(CASE, ["b", "d"], runs)


def test_a_wrong_constant_is_freed_within_reason() -> None:
    """From a fifth to five times; with its unit where it has one, beside what is fitted already."""
    stated = {"mass": (3.0, ""), "radius": (-0.08, "m")}
    found = changes.extended(CASE, stated, ["constant.mass"], {})
    assert "mass = 3.0\n" not in found
    assert "[fit]\nmass = {value = 3.0, min = 0.6, max = 15.0}" in found
    found = changes.extended(CASE + "[fit]\nk = { value = 1.0 }\n", stated, ["constant.radius"], {})
    assert 'radius = {value = -0.08, min = -0.4, max = -0.016, unit = "m"}' in found
    assert "k = { value = 1.0 }" in found
    assert found.count("[fit]") == 1
    with pytest.raises(
        UserError, match=r"found constant\.width, expected a constant of \[parameters\]: one of mass, radius"
    ):
        changes.extended(CASE, stated, ["constant.width"], {})


def test_a_column_at_fault_is_mended_as_discover_says() -> None:
    """A factor that stands there is multiplied."""
    mend = OwnEffect("", None, mend={"factor": 3.0, "delay": 2})
    found = changes.extended(CASE, {}, ["table.omega.scale"], {"table.omega.scale": mend})
    assert 'omega = { column = "speed", unit = "rad/s", factor = 1.5, delay = 2 }'.replace(" ", "") in found.replace(
        " ", ""
    )
    assert 'effects = ["drag"]  # keep' in found
    found = changes.extended(CASE, {}, ["table.load.scale"], {"table.load.scale": mend})
    assert "factor=3.0,delay=2" in found.replace(" ", "")
    for own in ({}, {"table.load.scale": OwnEffect("", None)}):
        with pytest.raises(UserError, match="expected what terrapin discover named last"):
            changes.extended(CASE, {}, ["table.load.scale"], own)


def test_effects_are_added_beside_mends_and_constants() -> None:
    mend = OwnEffect("", None, mend={"delay": 2})
    own = {"table.load.delay": mend, "mine": OwnEffect("k*x", None, {"k": OwnParameter(1.0, 0.0, None, "N")})}
    names = ["table.load.delay", "constant.mass", "gear", "mine"]
    found = changes.extended(CASE, {"mass": (3.0, "")}, names, own)
    assert 'effects = ["drag", "gear", "mine"]  # keep' in found
    assert '[effect.mine]\nexpression = "k*x"\nk = {value = 1.0, min = 0.0, unit = "N"}\n' in found
    assert "target" not in found
    assert "[effect.table" not in found
    bare = CASE.replace('effects = ["drag"]  # keep\n', "")
    assert 'effects = ["gear"]' in changes.add_effects(bare, ["gear"], {})
    two = changes.add_effects(found, ["other"], {"other": OwnEffect("k", "y", {"k": OwnParameter(2.0, None, 9.0)})})
    assert '[effect.other]\nexpression = "k"\ntarget = "y"\nk = {value = 2.0, max = 9.0}\n' in two
    assert "[effect.mine]" in two
    assert changes.remove_effect(two, "mine").count("mine") == 1  # its table stays
    without = changes.without_own(two, "mine")
    assert "mine" not in without
    assert "[effect.other]" in without
    unused = changes.without_own(changes.remove_effect(two, "mine"), "mine")
    assert unused == without
    with pytest.raises(UserError, match="found 'mine', expected an effect of your own: other"):
        changes.without_own(without, "mine")
    with pytest.raises(UserError, match="expected an effect of your own: none"):
        changes.without_own(CASE, "mine")


def test_entries_stand_in_a_line_each_without_what_is_empty() -> None:
    table = changes.inline_tables(
        {"a": {"column": "x", "unit": "", "sigma": None, "factor": 0.0}, "b": {"column": "y"}}
    )
    assert table.as_string() == 'a = {column = "x", factor = 0.0}\nb = {column = "y"}\n'


@pytest.mark.parametrize(
    ("text", "found"),
    [("k=1", OwnParameter(1.0)), (" k = 1:: ", OwnParameter(1.0)), ("k=1:0:", OwnParameter(1.0, 0.0)),
     ("k=1::5:m", OwnParameter(1.0, None, 5.0, "m")), ("k=1:0:5: N m ", OwnParameter(1.0, 0.0, 5.0, "N m"))],
)  # fmt: skip
def test_a_parameter_has_a_start_bounds_and_a_unit(text: str, found: OwnParameter) -> None:
    assert changes.parse_parameter(text) == ("k", found)


def test_a_current_is_a_magnitude_where_it_has_one_sign_and_the_motion_both() -> None:
    """Each way in a fiftieth of the rows at least; the columns are found by what they are told to be."""
    both = np.where(np.arange(100) < 2, -1.0, 1.0)
    few = both.copy()
    few[0] = 0.0

    def told(omega: Any, current: Any, roles: dict[str, str] | None = None) -> list[str]:
        return intake.unsigned({"omega": omega, "current": current}, roles or {})

    assert told(both, np.ones(100)) == [
        "current has one sign only although omega takes both: it seems to be a magnitude that lost its sign."
    ]
    assert told(-both, -np.ones(100)) != []
    for sign in (1.0, -1.0):  # where it stands there is none
        assert told(both, sign * (both > 0.0)) != []
    assert told(few, np.ones(100)) == told(-few, np.ones(100)) == told(both, both) == told(both, -both) == []
    values = {"v": both, "i": np.ones(100)}
    assert intake.unsigned(values, {"speed": "v", "current": "i"})[0].startswith("i has one sign only although v")
    assert intake.unsigned(values, {"direction": "v", "current": "i"})[0].startswith("i has one sign only although v")
    assert intake.unsigned(values, {"speed": "v"}) == intake.unsigned(values, {"current": "i"}) == []


def test_gaps_are_counted_by_column_and_the_first_is_named() -> None:
    nan = np.nan
    given = {"a": np.array([1.0, nan, nan]), "b": np.array([1.0, nan, 2.0]), "c": np.ones(3)}
    found = intake.gaps(given, np.array([True, False, False]), ["d", "e"], lambda row: f"runs.csv:{row + 2}")
    assert found == [
        "2 of 3 rows left out: no number in a mapped column (a 2, b 1). The first is runs.csv:3.",
        "Not looked at, for gaps: d, e.",
    ]
    assert intake.gaps({"c": np.ones(3)}, np.ones(3, dtype=bool), [], str) == []


def test_what_was_assumed_is_told_once_for_files_alike(tmp_path: Path) -> None:
    def table(name: str, *notes: str, first: str = "a,b\n") -> Any:
        (tmp_path / name).write_text(first)
        return SimpleNamespace(path=tmp_path / name, notes=notes)

    given = [table("a.csv", "read as UTF-16", "comma"), table("b.csv"), table("c.csv", "read as UTF-16", "comma"),
        table("d.csv", first="# assumed: merged\na,b\n"), table("e.txt", first="# assumed: merged\n")]  # fmt: skip
    assert intake.assumed(given) == ["a.csv and 1 more: read as UTF-16; comma.", "d.csv: merged."]
    assert intake.assumed(given[1:2]) == []


def test_a_late_column_is_taken_earlier_within_its_run() -> None:
    run = np.array([0, 0, 0, 1, 1])
    values = np.arange(5.0)
    np.testing.assert_array_equal(earlier(values, run, 1), [1.0, 2.0, np.nan, 4.0, np.nan])
    np.testing.assert_array_equal(earlier(values, run, 2), [2.0, np.nan, np.nan, np.nan, np.nan])
    in_turn = np.array([0, 1, 0, 1, 0])  # rigs that are read together
    np.testing.assert_array_equal(earlier(values, in_turn, 1), [2.0, 3.0, 4.0, np.nan, np.nan])
    for delay in (4, 5, 9):
        assert np.isnan(earlier(values, run, delay)).all()
    np.testing.assert_array_equal(
        earlier(values, np.zeros(5, dtype=np.int64), 4), [4.0, np.nan, np.nan, np.nan, np.nan]
    )


def test_a_sign_is_given_before_a_factor() -> None:
    values = {"i": np.array([1.0, -2.0, 3.0]), "w": np.array([-1.0, 5.0, 0.0]), "f": np.ones(3)}

    def complain(text: str, *path: str) -> UserError:
        return UserError(f"{'.'.join(path)}: {text}")

    tables: Any = SimpleNamespace(complain=complain)
    found = mended(tables, values, {"i": Mend(-2.0, "w"), "f": Mend(), "w": Mend(10.0)})
    assert found["i"].tolist() == [2.0, -4.0, 0.0]
    assert found["w"].tolist() == [-10.0, 50.0, 0.0]
    assert found["f"] is values["f"]
    for other in ("i", "gone"):
        with pytest.raises(UserError, match=rf"data\.columns\.i\.sign_of: found '{other}', expected one of w, f"):
            mended(tables, values, {"i": Mend(1.0, other)})
    assert told_mends({"i": Mend(0.5, "w", 2), "w": Mend(delay=1), "f": Mend()}) == [
        "i is multiplied by 0.5 and given the sign of w and taken 2 rows later, as case.toml asks.",
        "w is taken 1 row later, as case.toml asks.",
    ]


def test_runs_stand_in_the_order_of_their_numbers() -> None:
    assert sorted(["r10", "r2", "r1b", "r1a", "q3"], key=columns._in_order) == ["q3", "r1a", "r1b", "r2", "r10"]


def _split(names: list[str], held: list[str], **listed: list[str]) -> tuple[list[str], list[str]]:
    def complain(text: str, *path: str) -> UserError:
        return UserError(f"{'.'.join(path)}: {text}")

    tables: Any = SimpleNamespace(
        get=lambda _, key: listed.get(key), texts=lambda _, key: listed[key], complain=complain
    )
    return columns.split_runs(tables, names, held)


def test_runs_are_trained_on_or_held_out_as_the_case_says() -> None:
    names = ["a", "b", "c"]
    assert _split(names, ["b"]) == (["a", "c"], ["b"])
    assert _split(names, ["b"], test=["c"]) == (["a", "b"], ["c"])
    assert _split(names, ["b"], train=["c"]) == (["c"], ["a", "b"])
    assert _split(names, ["b"], train=["c"], test=["a"]) == (["c"], ["a"])
    assert _split(names, [], test=[]) == (names, [])
    for listed, told in (
        ({"train": ["d"]}, r"data\.train: run 'd' is not in the data, expected one of a, b, c"),
        ({"test": ["a", "d"]}, r"data\.test: run 'd' is not"), ({"train": []}, r"data\.train: found an empty list"),
        ({"train": ["a", "b"], "test": ["c", "b", "a"]}, r"data\.test: run 'a' is in train and in test"),
        ({"test": names}, r"data\.train: found an empty list, expected at least one run"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=told):
            _split(names, [], **listed)
    assert _split(["a"], []) == (["a"], [])


def test_columns_that_are_not_mapped_are_numbers_have_gaps_or_are_text() -> None:
    class Table:
        def __init__(self, **given: Any) -> None:
            self.columns = {name: np.array(values, dtype=object) for name, values in given.items()}

        def numbers(self, name: str, gaps: bool) -> Any:
            try:
                return np.array([np.nan if cell == "" else float(cell) for cell in self.columns[name]])
            except ValueError:
                raise UserError(name) from None

    first = Table(x=["1", "2"], q=["3", "4"], gap=["", "4"], none=["", ""], text=["a", "b"], one=["1", "2"])
    second = Table(x=["1"], q=["5"], gap=["6"], none=[""], text=["b"])
    given: Any = [first, second]
    extra, sparse, text = columns._extra(given, {"x"})
    assert {name: values.tolist() for name, values in extra.items()} == {"q": [3.0, 4.0, 5.0]}
    assert (sparse, text) == (["gap"], {"text": 2})

    def complain(what: str, *path: str) -> UserError:
        return UserError(f"{'.'.join(path)}: {what}")

    for names, told in (
        (["q"], ""),
        (["x"], "column 'x' is mapped"),
        (["z"], "'z' is not in the files, expected one of q, gap"),
    ):
        tables: Any = SimpleNamespace(texts=lambda *path, default, names=names: names, complain=complain)
        if told:
            with pytest.raises(UserError, match=told):
                columns._ignored(tables, given, {"x"})
        else:
            assert columns._ignored(tables, given, {"x"}) == {"q"}


@pytest.mark.parametrize(
    ("entry", "found"),
    [("", Mend()), ("factor = -2.5", Mend(-2.5)), ('sign_of = "w"', Mend(1.0, "w")), ("delay = 1000", Mend(delay=1000)),
     ("factor = 0", "found 0, expected a factor other than 0"), ("delay = true", "found True, expected a whole number"),
     ("delay = 1001", "0 to 1000"), ("delay = -1", "found -1"), ("delay = 1.0", "found 1.0"), ('delay = "2"', "'2'")],
)  # fmt: skip
def test_a_mend_is_a_factor_a_sign_and_whole_rows(entry: str, found: Mend | str) -> None:
    def complain(text: str, *path: str) -> UserError:
        return UserError(f"{'.'.join(path)}: {text}")

    tables = Tables(tomllib.loads(f"[data.columns.x]\n{entry}\n"), complain)
    path = ("data", "columns", "x")
    if isinstance(found, str):
        with pytest.raises(UserError, match=rf"data\.columns\.x\..*{found}"):
            read_mend(tables, path)
    else:
        assert read_mend(tables, path) == found


COLUMNS = 'x = { column = "x", unit = "mm" }\ny = { column = "y", unit = "N", sigma = 0.5 }\n'


def _case(folder: Path, rows: str = "", columns: str = COLUMNS, data: str = "", files: str = '"runs.csv"') -> Path:
    """A case of y = a*x; `rows` of run, x, y and whatever else."""
    (folder / "case.toml").write_text(
        f'[model]\nbase = "equation"\n[model.equation]\ny = "a*x"\n[fit]\na = {{ value = 1.0, unit = "N/mm" }}\n'
        f"[data]\nfiles = [{files}]\n{data}[data.columns]\n{columns}"
    )
    if rows:
        (folder / "runs.csv").write_text(rows)
    return folder


def _rows(names: str, more: str = "") -> str:
    """Two rows a run, x counted from 1."""
    lines = [f"{name},{2 * i + k},{10 * i + k}{more}" for i, name in enumerate(names.split()) for k in (1, 2)]
    return "\n".join(["run,x,y" + (",note" if more else ""), *lines]) + "\n"


def test_rows_are_read_with_their_runs_and_places(tmp_path: Path) -> None:
    """Runs in the order of their numbers; of the others every fifth by name is held out, of fewer the last."""
    many = " ".join(f"r{i}" for i in (10, 2, 1, 3, 4, 5, 6, 7, 8, 9, 11))
    case = load_case(_case(tmp_path, _rows(many), data='run = "run"\n'))
    assert case.run_names == tuple(f"r{i}" for i in range(1, 12))
    assert case.run[:6].tolist() == [9, 9, 1, 1, 0, 0]
    held = [case.run_names[i] for i in np.unique(case.run[case.test])]
    assert held == ["r3", "r8"]  # of r1, r10, r11, r2, r3, r4 ...
    assert (case.train == ~case.test).all()
    assert case.channels["y"][:3].tolist() == [1.0, 2.0, 11.0]
    assert case.place(2) == "runs.csv:4"
    few = load_case(_case(tmp_path, _rows("b a c d"), data='run = "run"\n'))
    assert [few.run_names[i] for i in np.unique(few.run[few.test])] == ["d"]
    assert (few.sigma, few.units["y"]) == ({"y": 0.5}, "N")
    five = load_case(_case(tmp_path, _rows("b a c d e"), data='run = "run"\n'))
    assert [five.run_names[i] for i in np.unique(five.run[five.test])] == ["e"]


def test_a_delay_moves_a_column_within_its_runs_and_gaps_leave_rows_out(tmp_path: Path) -> None:
    rows = "run,x,y,q\na,1,1,5\na,2,,5\na,3,3,6\nb,4,4,7\nb,5,5,8\n"
    late = COLUMNS.replace('unit = "mm"', 'unit = "mm", delay = 1')
    case = load_case(_case(tmp_path, rows, late, 'run = "run"\n'))
    assert case.inputs["x"].tolist() == [2.0, 5.0]  # rows 1 and 4: of 2 there is no y, after 3 and 5 nothing comes
    assert case.channels["y"].tolist() == [1.0, 4.0]
    assert (case.place(1), case.rows) == ("runs.csv:5", 2)
    assert case.extra["q"].tolist() == [5.0, 7.0]
    told = "\n".join(case.remarks)
    assert "3 of 5 rows left out: no number in a mapped column (x 2, y 1). The first is runs.csv:3." in told
    assert "x is taken 1 row later" in told
    with pytest.raises(UserError, match=r"runs\.csv:2: column y: every row has a gap"):
        load_case(_case(tmp_path, "run,x,y\na,1,\nb,2,\n", data='run = "run"\n'))


def test_text_that_tells_every_row_or_none_apart_is_no_group(tmp_path: Path) -> None:
    def told(*notes: str) -> bool:
        rows = "run,x,y,note\n" + "".join(f"r{i // 2},{i},{i},{note}\n" for i, note in enumerate(notes))
        return any("for text: note" in one for one in load_case(_case(tmp_path, rows, data='run = "run"\n')).remarks)

    assert told("sand", "sand", "loam", "loam", "sand", "sand")
    assert not told("sand", "sand", "sand", "sand", "sand", "sand")
    assert not told("one", "one", "two", "two", "three", "three")


def test_files_are_runs_where_no_column_says_so(tmp_path: Path) -> None:
    for name in ("r2", "r10"):
        (tmp_path / f"{name}.csv").write_text("x,y\n1,1\n2,2\n")
    case = load_case(_case(tmp_path, files='"r10.csv", "r2.csv"'))
    assert case.run_names == ("r2", "r10")
    assert case.run.tolist() == [1, 1, 0, 0]
    assert case.place(2) == "r2.csv:2"
    with pytest.raises(UserError, match=r"data\.files: found 'r2\.csv' under two names"):
        load_case(_case(tmp_path, files='"r2.csv", "./r10.csv", "./r2.csv"'))
    (tmp_path / "r2.csv").write_text("x,y,note\n")
    (tmp_path / "r10.csv").write_text("x,y\n")
    with pytest.raises(UserError, match=r"data\.files: r10\.csv has no rows"):
        load_case(_case(tmp_path, files='"r10.csv", "r2.csv"'))
    with pytest.raises(UserError, match="column run: found nothing, expected a run's name"):
        load_case(_case(tmp_path, "run,x,y\na,1,1\n,2,2\n", data='run = "run"\n'))


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        (COLUMNS.replace("x = {", '"a b" = {'), "a name that formulas cannot use"),
        (COLUMNS.replace("y = {", "z = {").replace(", sigma = 0.5", ""), "y is missing, expected the column"),
        (COLUMNS.replace("y = {", "z = {"), "y is missing, expected the column"),
        (COLUMNS.replace('"mm"', '"mm", sigma = 1'), "unknown name"),
        (COLUMNS.replace("0.5", "0.0"), r"data\.columns\.y\.sigma.*expected more than 0"),
        (COLUMNS + 'z = { column = "x", unit = "m" }\n', r"column 'x' is mapped as x in mm too"),
        (COLUMNS.replace('"mm"', '"wobbles"'), "wobbles"),
        (
            COLUMNS + 'z = { column = "y", unit = "N" }\n',
            r"'y' is y, which is predicted: as input z it would explain itself",
        ),
    ],
)
def test_an_entry_of_the_columns_that_is_wrong_is_told(tmp_path: Path, columns: str, told: str) -> None:
    with pytest.raises(UserError, match=told):
        load_case(_case(tmp_path, _rows("a b"), columns, 'run = "run"\n'))


def test_a_formula_that_reads_what_is_predicted_too_says_so(tmp_path: Path) -> None:
    """It used to say that y is no column, beside the column y."""
    folder = _case(tmp_path, _rows("a b", ",1"), COLUMNS + 'z = { column = "note", unit = "N" }\n', 'run = "run"\n')
    text = (folder / "case.toml").read_text()
    (folder / "case.toml").write_text(text.replace('y = "a*x"', 'y = "a*x"\nz = "2*y"'))
    with pytest.raises(UserError, match="y is predicted too, and formulas read inputs"):
        load_case(folder)


def test_one_column_may_be_read_twice_in_one_unit(tmp_path: Path) -> None:
    case = load_case(_case(tmp_path, _rows("a b"), COLUMNS + 'z = { column = "x", unit = "mm" }\n', 'run = "run"\n'))
    assert case.inputs["z"].tolist() == case.inputs["x"].tolist()
    mended_ = load_case(_case(tmp_path, _rows("a b"), COLUMNS.replace("0.5", "0.5, factor = -2"), 'run = "run"\n'))
    assert mended_.sigma == {"y": 1.0}
    assert mended_.channels["y"].tolist() == [-2.0, -4.0, -22.0, -24.0]
