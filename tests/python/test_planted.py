"""`terrapin discover --plant`: a hidden effect is found as often as it is there to be found; bad input in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from casekit import one_line, shaft, terrapin

from terrapin_hil.physics.mechanics import mechanics
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.planted import plant, size_of


def test_what_is_large_is_named_and_what_is_nothing_is_not(tmp_path: Path) -> None:
    case = load_case(shaft(tmp_path / "case", 11))
    large = plant(case, "coulomb_friction", "5sd", draws=4)
    assert (large.noticed, large.named) == (4, 4)
    assert large.size == pytest.approx(0.05, rel=0.02)
    assert large.size_in_sd == pytest.approx(5.0, rel=0.02)
    assert 1.0 < large.beyond_in_sd < 4.5  # friction that grows with the speed takes up a part
    assert not large.fails
    none = plant(case, "coulomb_friction", "0", draws=4)
    assert none.noticed <= 1
    assert (none.named, none.size, none.size_in_sd) == (0, 0.0, 0.0)
    assert plant(case, "coulomb_friction", "0.05", draws=4).named == 4
    taken = plant(case, "viscous_friction", "5sd", draws=2)
    assert taken.beyond_in_sd == pytest.approx(0.0, abs=1e-6)
    assert taken.named == 0


def test_the_answer_in_words_and_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = shaft(tmp_path / "case", 11)
    words = ("discover", case, "--plant", "coulomb_friction=50 mN m", "--repeats", "2")
    status, out, _ = terrapin(capsys, *words)
    assert status == 0
    assert "hidden in 2 tables like yours:" in out
    assert "noticed in 2 of 2 (95 % limits 16 % to 100 %)" in out
    status, out, _ = terrapin(capsys, *words, "--json", "-")
    answer = json.loads(out)
    assert answer["schema"] == "terrapin.plant/1"
    assert answer["size"]["value"] == pytest.approx(0.05)
    assert answer["size"]["unit"] == "N m"
    assert answer["named"] == {"count": 2, "rate": 1.0, "low": pytest.approx(0.158, abs=1e-3), "high": 1.0}
    assert not (case / ".terrapin").exists()  # it is no answer about the case itself


def test_sizes() -> None:
    effect = mechanics()["backlash"]
    assert size_of("2sd", effect) == (2.0, True)
    assert size_of("-0.5", effect) == (-0.5, False)
    for text in ("", "sd", "1 sd", "nan", "infsd", "2 m", "two"):
        with pytest.raises(UserError, match="--plant: found size"):
            size_of(text, effect)


BAD = {
    "no size": (["--plant", "stribeck"], ["--plant: found 'stribeck', expected EFFECT=SIZE"]),
    "unknown": (["--plant", "drag=1"], ["--plant: found drag, expected an effect that could be added: one of"]),
    "unit": (["--plant", "stribeck=2 kg"], ["--plant: found size '2 kg', expected a number in N m"]),
    "many": (["--plant", "stribeck=1", "--repeats", "20000"], ["--repeats: found 20000, expected 1 to 10000"]),
    "alone": (["--repeats", "3"], ["--repeats: expected together with --plant"]),
    "both": (["--plant", "stribeck=1", "--bootstrap", "3"], ["--plant: found beside --bootstrap"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    words, told = BAD[name]
    status, _, err = terrapin(capsys, "discover", shaft(tmp_path / "case", 11), *words)
    assert status == 2
    one_line(err, told)


def test_what_is_in_the_model_is_not_planted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = shaft(tmp_path / "case", 11)
    text = (folder / "case.toml").read_text()
    (folder / "case.toml").write_text(text.replace('"equation"\n', '"equation"\neffects = ["stribeck"]\n', 1))
    status, _, err = terrapin(capsys, "discover", folder, "--plant", "stribeck=1")
    assert status == 2
    one_line(err, ["--plant: stribeck is in the model already, expected one of"])
    status, _, err = terrapin(capsys, "discover", tmp_path, "--plant", "stribeck=1")
    assert status == 2
