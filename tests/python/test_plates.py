"""Pressure-sinkage laws from plates of several sizes: known soils come back, sizes left out, files, picture."""

from __future__ import annotations

import doctest
import json
from pathlib import Path

import numpy as np
import pytest

from terrapin_tools import cli
from terrapin_tools.soil import plates as module
from terrapin_tools.soil.plates import LAWS, Plates, analyse, fit, replicate_sd

SIZES = (0.05, 0.08, 0.12, 0.2)


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["terrapin", "soil", "plates", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def made(name: str, q: tuple[float, ...], noise: float = 0.0, tests: int = 3, seed: int = 0) -> Plates:
    """Tests of each size; `noise` [Pa] is one offset in slope a test and white noise a row."""
    z = np.linspace(0.001, 0.03, 25)
    size = np.repeat(SIZES, tests * z.size)
    depth = np.tile(z, len(SIZES) * tests)
    index = np.repeat(np.arange(len(SIZES) * tests), z.size)
    draw = np.random.default_rng(seed)
    bare = Plates(size, depth, np.zeros(size.size), index, tuple(map(str, range(index.max() + 1))))
    pressure = LAWS[name].pressure(np.array(q), size, depth, bare.reference)
    slope = draw.normal(0.0, noise, index.max() + 1)[index] * depth / 0.03
    return Plates(size, depth, pressure + slope + draw.normal(0.0, 0.5 * noise, size.size), index, bare.test_names)


TRUTHS = {
    "power": (1.5e6, 1.1),
    "bekker": (20e3, 8e5, 0.9),
    "reece": (20e3, 5e5, 1.2),
    "exponent_linear": (9e6, 1.45, -0.3),
    "exponent_log": (9e6, 1.45, -0.3),
}


@pytest.mark.parametrize("name", list(TRUTHS))
def test_the_true_law_comes_back(name: str) -> None:
    plates = made(name, TRUTHS[name])
    q = fit(LAWS[name], plates, np.ones(plates.size.size, dtype=bool))
    assert q == pytest.approx(TRUTHS[name], rel=1e-5)


@pytest.mark.parametrize("name", ["bekker", "exponent_log"])
def test_the_true_law_predicts_a_size_it_has_not_seen(name: str) -> None:
    plates = made(name, TRUTHS[name], noise=800.0)
    fits = {f.law.name: f for f in analyse(plates)}
    spread = replicate_sd(plates)
    assert spread is not None
    assert spread == pytest.approx(600.0, rel=0.4)
    assert fits[name].left_out < 2.0 * spread
    assert fits["power"].left_out > 3.0 * spread
    true = np.array(TRUTHS[name])
    assert (np.abs(fits[name].q - true) < 5.0 * fits[name].sd).all()
    for f in fits.values():  # what is left out is predicted no better than what is fitted
        assert f.left_out >= f.error
        rows = sum(f.by_size[s] ** 2 for s in SIZES) / len(SIZES)
        assert f.left_out == pytest.approx(np.sqrt(rows), rel=1e-12)  # equal rows a size


def test_both_forms_agree_at_one_size_and_units_follow_n() -> None:
    bekker, reece = LAWS["bekker"], LAWS["reece"]
    z = np.array([0.01, 0.02])
    b = np.full(2, 0.1)
    n = 0.8
    as_bekker = bekker.pressure(np.array([3e3, 4e5, n]), b, z, 0.1)
    factor = 0.1 ** (n - 1.0)
    assert reece.pressure(np.array([3e3 * factor, 4e5 * factor, n]), b, z, 0.1) == pytest.approx(as_bekker * 0.1**0.0)
    assert bekker.units(np.array([0.0, 0.0, 0.8])) == ("Pa m^0.2", "Pa/m^0.8", "1")
    assert LAWS["power"].units(np.array([0.0, 1.25])) == ("Pa/m^1.25", "1")
    assert doctest.testmod(module).failed == 0


HEADER = "test,plate_mm,z_m,p_kPa"


def write(plates: Plates, file: Path) -> Path:
    rows = zip(plates.test, plates.size, plates.depth, plates.pressure, strict=True)
    lines = [
        f"{t},{1e3 * b:.6g},{z!r},{1e-3 * p!r}"
        for t, b, z, p in ((t, float(b), float(z), float(p)) for t, b, z, p in rows)
    ]
    file.write_text("\n".join([HEADER, *lines]) + "\n")
    return file


def test_the_command_and_its_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(made("exponent_linear", TRUTHS["exponent_linear"], noise=500.0), tmp_path / "p.csv")
    pictures = []
    for name in ("a.svg", "b.svg"):
        assert command(monkeypatch, str(file), "--plot", str(tmp_path / name), "--json", str(tmp_path / "j.json")) == 0
        pictures.append((tmp_path / name).read_bytes())
    assert pictures[0] == pictures[1]
    assert len(pictures[0]) > 10_000
    answer = json.loads((tmp_path / "j.json").read_text())
    assert answer["best"] == "exponent_linear"
    assert [law["law"] for law in answer["laws"]] == list(TRUTHS)
    last = answer["laws"][3]
    assert last["parameters"]["n_0"]["unit"] == "1"
    assert [e["n"] for e in last["exponent_by_size"]] == sorted(
        (e["n"] for e in last["exponent_by_size"]), reverse=True
    )
    n = answer["laws"][1]["parameters"]["n"]["value"]
    assert answer["laws"][1]["parameters"]["k_phi"]["unit"] == f"Pa/m^{n:.6g}"
    assert "exponent_linear" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "arguments", "message"),
    [
        (
            "plate_mm",
            "width",
            (),
            "p.csv: column 'plate_mm' (--size) is missing, expected one of test, width, z_m, p_kPa",
        ),
        ("", "", ("--size", "plate_mm"), "--size: found 'plate_mm', expected COLUMN [UNIT]"),
        (
            "plate_mm",
            "D [mm]",
            ("--size", "D [cm]"),
            "column 'D [cm]' (--size) is missing, expected one of test, D [mm]",
        ),
        ("", "", ("--depth", "z_m [kg]"), "--depth: 'kg' does not convert to 'm'"),
        ("", "", ("--plot", "x.pdf"), "--plot: found 'x.pdf', expected a name that ends in .png or .svg"),
        ("0,50,0.001,", "0,50,-0.001,", (), "p.csv:2: depth: found -0.001 m, expected more than 0"),
        ("0,50,0.001,", "0,0,0.001,", (), "p.csv:2: size: found 0 m, expected more than 0"),
        ("0,50,0.001,", "0,50,nan,", (), "p.csv:2: column z_m: found NaN"),
    ],
)
def test_what_is_wrong_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    file = write(made("power", TRUTHS["power"]), tmp_path / "p.csv")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1) if old else text)
    assert command(monkeypatch, str(file), *arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert not captured.out


@pytest.mark.parametrize("heading", ["D [mm]", "D (mm)"])
@pytest.mark.parametrize("said", ["D [mm]", "D", "D (mm)"])
def test_a_column_is_named_by_its_heading_or_its_bare_name(tmp_path: Path, heading: str, said: str) -> None:
    true = made("bekker", TRUTHS["bekker"])
    file = write(true, tmp_path / "p.csv")
    file.write_text(file.read_text().replace("test,plate_mm", f"lap [-],{heading}", 1))
    read = module.read_plates(file, said, "z_m [m]", "p_kPa [kPa]", "lap")
    assert read.size == pytest.approx(true.size)
    assert read.pressure == pytest.approx(true.pressure)


@pytest.mark.parametrize("tests", [2, 3, 7])
def test_repeats_are_told_as_their_sd_and_not_less(tests: int) -> None:
    """Offsets alone: the sd over n of them divides by n - 1."""
    z = np.linspace(0.001, 0.03, 25)
    offsets = np.random.default_rng(tests).normal(0.0, 800.0, tests)
    index = np.repeat(np.arange(tests + 1), z.size)
    size, depth = np.where(index < tests, 0.05, 0.08), np.tile(z, tests + 1)
    plates = Plates(size, depth, 1e5 * depth + np.append(offsets, 0.0)[index], index, tuple(map(str, range(tests + 1))))
    assert replicate_sd(plates) == pytest.approx(float(np.std(offsets, ddof=1)), rel=1e-9)


def test_two_sizes_are_too_few(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plates = made("power", TRUTHS["power"])
    few = plates.size < 0.1
    some = Plates(plates.size[few], plates.depth[few], plates.pressure[few], plates.test[few], plates.test_names)
    assert command(monkeypatch, str(write(some, tmp_path / "p.csv"))) == 2
    assert "found 2 plate sizes, expected at least 3" in capsys.readouterr().err
