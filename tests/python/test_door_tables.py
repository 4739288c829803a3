"""What a laboratory has in its tables: NumPy's numbers, instants, units as people write them, names that are taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import terrapin_tools as terrapin
from terrapin_tools.workbench.files.units import spelling

UNITS = {"w": "rad/s", "M": "N m"}
FIT: dict[str, Any] = {"a": (0.0, -9, 9, "N m"), "b": (1.0, -9, 9, "N m s/rad")}


def table() -> pd.DataFrame:
    random = np.random.default_rng(1)
    w = random.uniform(1.0, 10.0, 120)
    return pd.DataFrame({"run": np.repeat(np.arange(6), 20), "w": w, "M": 1.0 + 0.5 * w + random.normal(0.0, 0.1, 120)})


def bench(frame: Any = None, **given: Any) -> terrapin.Case:
    more = {"run": "run", "units": UNITS, "equation": {"M": "a + b*w"}, "fit": FIT, **given}
    return terrapin.Case.from_table(table() if frame is None else frame, **more)


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int32, np.int64])
def test_numbers_of_numpy_are_numbers(kind: Any) -> None:
    """A constant read with pandas was `np.float64(0.5) N m`, a noise of float32 a traceback."""
    given = [
        {"fit": {"a": FIT["a"]}, "constants": {"b": (number, "N m s/rad")}, "noise": {"M": number},
         "limits": {"w": (number, 9 * number, "rad/s")}}
        for number in (kind(1), 1)
    ]  # fmt: skip
    assert bench(**given[0]).compare().parameters == bench(**given[1]).compare().parameters


def test_an_array_says_start_and_bounds() -> None:
    assert bench(fit={**FIT, "a": np.array([0.0, -9.0, 9.0])}).text == bench(fit={**FIT, "a": (0.0, -9.0, 9.0)}).text


@pytest.mark.parametrize(("written", "read"), [("Nm", "N m"), ("N\u00b7m", "N m"), ("mNm", "mN m")])
def test_units_are_read_as_people_write_them(written: str, read: str) -> None:
    per = (f"{written} s/rad", f"{read} s/rad")
    ways = [
        bench(units={"w": "rad/s", "M": m}, fit={"a": (0.0, -9, 9, m), "b": (1.0, -9, 9, slope)}).text
        for m, slope in ((written, per[0]), (read, per[1]))
    ]
    assert ways[0] == ways[1]


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("Nm/A", "N m/A"),
        ("mNm s/rad", "mN m s/rad"),
        ("A/Nm", "A/(N m)"),
        ("1/Nm", "1/(N m)"),
        ("nm", "nm"),
        ("Nm2", "Nm2"),
    ],
)
def test_a_torque_inside_a_unit_is_two_words(written: str, read: str) -> None:
    assert spelling(written) == read


def swing(time: Any) -> pd.DataFrame:
    """Five runs of x'' = -25 x, with what `time` makes of their seconds."""
    seconds = np.arange(100) * 0.02
    parts = []
    for run in range(5):
        x = np.cos(5.0 * seconds + run) + np.random.default_rng(run).normal(0.0, 0.01, 100)
        parts.append(pd.DataFrame({"run": run, "time": time(pd.Series(seconds)), "x": x}))
    return pd.concat(parts, ignore_index=True)


def moved(frame: pd.DataFrame, **more: Any) -> terrapin.Case:
    return terrapin.Case.from_table(
        frame, run="run", states={"p": ("fit", "m"), "v": ("fit", "m/s")}, derivative={"p": "v", "v": "-k*p"},
        measured={"x": "p"}, fit={"k": (20.0, 1, 100, "1/s^2")}, **{"units": {"x": "m"}, **more},
    )  # fmt: skip


START = pd.Timestamp("2026-03-02 09:00:00.25")


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
@pytest.mark.parametrize("name", ["time", "Zeit"])
def test_instants_are_seconds_as_in_a_file(tmp_path: Path, zone: str | None, name: str) -> None:
    """`role time is not mapped`: there was no way to say that the dates of a frame are the time."""
    frame = swing(lambda s: START.tz_localize(zone) + pd.to_timedelta(s, unit="s")).rename(columns={"time": name})
    case = moved(frame, columns={"time": name})
    plain = moved(swing(lambda s: s), units={"x": "m", "time": "s"})
    assert case.compare().parameters["k"].value == pytest.approx(plain.compare().parameters["k"].value, rel=1e-6)
    assert f"{name} as time: [s] since 2026-03-02" in str(case.compare())
    assert terrapin.Case.load(case.save(tmp_path / "kept")).compare().parameters == case.compare().parameters


def test_the_time_of_an_equation_of_motion_is_found_where_it_is_an_instant() -> None:
    assert moved(swing(lambda s: START + pd.to_timedelta(s, unit="s"))).rows == 500


def test_a_duration_is_a_number_of_seconds() -> None:
    case = moved(swing(lambda s: pd.to_timedelta(s, unit="s")))
    assert case.table()["time"].to_pylist()[:3] == [0.0, 0.02, 0.04]


def test_no_instant_is_a_gap() -> None:
    frame = swing(lambda s: START + pd.to_timedelta(s, unit="s"))
    frame.loc[0, "time"] = pd.NaT
    assert moved(frame).rows == 499


@pytest.mark.parametrize(
    "column",
    [
        pd.date_range("2026-01-01", periods=120, freq="s"),
        pd.date_range("2026-01-01", periods=120, freq="s").strftime("%d.%m.%Y %H:%M:%S"),
        np.where(np.arange(120) % 7 < 3, "on", "off"),
    ],
)
def test_a_case_with_times_or_switches_can_be_saved(tmp_path: Path, column: Any) -> None:
    """`a file of the case has changed since it was read`: its own, which it had just written."""
    case = bench(table().assign(beside=column))
    again = terrapin.Case.load(case.save(tmp_path / "kept"))
    assert again == case
    assert again.compare().parameters == case.compare().parameters


def test_the_run_of_a_case_from_one_file_keeps_its_name(tmp_path: Path) -> None:
    lines = [f"02.03.2026 09:00:{n:02d};{w:.4f};{m:.4f}" for n, (_, w, m) in enumerate(table().to_numpy()[:50])]
    text = "\n".join(["Zeit;w [rad/s];M [Nm]", *lines]).replace(".", ",").replace("02,03,2026", "02.03.2026")
    (tmp_path / "bench_7.csv").write_text(text)
    case = terrapin.Case.from_table(tmp_path / "bench_7.csv", equation={"M": "a + b*w"}, fit=FIT)
    assert case.runs == ("bench_7",)
    assert terrapin.Case.load(case.save(tmp_path / "kept")).runs == ("bench_7",)


def test_dates_may_name_the_runs(tmp_path: Path) -> None:
    days = pd.Timestamp("2026-01-01") + pd.to_timedelta(np.repeat(np.arange(6), 20), unit="D")
    case = bench(table().assign(run=days))
    assert len(case.runs) == 6
    assert terrapin.Case.load(case.save(tmp_path / "kept")) == case


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"noise": {"w": 0.1}}, "noise: found w, expected a channel: one of M"),
        ({"equation": {"Gr\u00f6\u00dfe": "a + b*w"}}, r"expected a name that formulas know.*columns=\{'Groesse': "),
        ({"fit": {**FIT, "zz": 1.0}}, "fit.zz: stands in no formula"),
        ({"fit": {**FIT, "w": (1.0, -9, 9, "rad/s")}}, "fit.w: is a mapped column too"),
        ({"constants": {"w": 2.0}}, "parameters.w: is a mapped column too"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_where_it_was_given(given: dict[str, Any], said: str) -> None:
    frame = table().assign(r=1.0).rename(columns={"r": "Gr\u00f6\u00dfe"})
    with pytest.raises(terrapin.errors.InputError, match=said):
        bench(frame, **given)


def test_an_answer_is_no_effect() -> None:
    case = bench()
    with pytest.raises(terrapin.errors.InputError, match=r"add: found an Answer, whose `missing` it takes, expected"):
        case.add(case.compare())


def test_a_constant_is_what_is_stated_though_a_column_has_its_name() -> None:
    """The column won, unsaid: a slope came out at a hundredth."""
    frame = table().assign(r=100.0)
    formula = {"equation": {"M": "a + b*w*r"}, "constants": {"r": 2.0}}
    case = bench(frame, **formula)
    assert case.compare().parameters["b"].value == pytest.approx(bench(**formula).compare().parameters["b"].value)
    assert "Not looked at, as a constant or a fitted value has the name: r." in str(case.compare())


def laboratory(folder: Path) -> list[Path]:
    """A file for each of six runs: an instrument's own clock, a gap in what is measured."""
    folder.mkdir()
    for name, rows in table().groupby("run"):
        lines = [
            f"02.03.2026 09:0{name}:{n:02d};{row.w:.4f};{'' if n == 3 else format(row.M, '.4f')}"
            for n, row in enumerate(rows.itertuples())
        ]
        text = "\n".join(
            ["Zeit;w [rad/s];M [Nm]", *(line.replace(".", ",").replace("02,03,", "02.03.") for line in lines)]
        )
        (folder / f"day_{name}.csv").write_text(text)
    return sorted(folder.iterdir())


def test_a_folder_of_files_is_a_run_each(tmp_path: Path) -> None:
    files = laboratory(tmp_path / "lab")
    case = bench(tmp_path / "lab", run="", units={})
    assert case == bench([str(one) for one in files], run="", units={})
    assert (case.runs, case.held_out, case.rows) == (tuple(f"day_{n}" for n in range(6)), ("day_4",), 114)
    assert case.compare().parameters["b"].value == pytest.approx(0.5, abs=0.02)
    assert terrapin.Case.load(case.save(tmp_path / "kept")) == case


def test_files_that_were_read_alike_are_told_once(tmp_path: Path) -> None:
    """Twelve files took twelve lines of every answer: each has another first number, and began at another time."""
    laboratory(tmp_path / "lab")
    said = " ".join(str(bench(tmp_path / "lab", run="", units={}).compare()).split())
    assert said.count("separator semicolon") == 1
    assert "Zeit as time: [s] since 02.03.2026 09:00:00" in said
    assert "; 5 more files likewise." in said


def test_a_prediction_reads_files_and_no_gap_of_what_it_does_not_need(tmp_path: Path) -> None:
    laboratory(tmp_path / "lab")
    assert bench(tmp_path / "lab", run="", units={}).predict(tmp_path / "lab").num_rows == 120


def test_files_of_unlike_columns_or_of_one_name_are_refused(tmp_path: Path) -> None:
    first = laboratory(tmp_path / "lab")[0]
    other = laboratory(tmp_path / "again")[0]
    with pytest.raises(terrapin.errors.InputError, match="two files are called day_0"):
        bench([first, other], run="", units={})
    other.write_text(other.read_text().replace("M [Nm]", "M [mNm]"))
    with pytest.raises(
        terrapin.errors.InputError, match=r"found the columns .*M \[mNm\].*, expected those of .*M \[Nm\]"
    ):
        bench([first, other], run="", units={})
    with pytest.raises(terrapin.errors.InputError, match="found a list"):
        bench([table(), table()])


def test_what_is_integrated_says_why_it_wants_the_channels() -> None:
    case = moved(swing(lambda s: s), units={"x": "m", "time": "s"})
    with pytest.raises(
        terrapin.errors.InputError, match="column x: is missing, expected it: a run starts where it fits x"
    ):
        case.predict({"time": [0.0, 0.1, 0.2]})
