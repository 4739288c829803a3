"""Soils: two forms with units that follow the exponent, and the published ones."""

from __future__ import annotations

import doctest
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrapin_hil.physics import soils
from terrapin_hil.physics.soils import Soil, library, number

SOIL = Soil("test", "nobody", "bekker", 0.8, 5e3, 9e5, 1e3, 0.5, 0.02)


def test_examples() -> None:
    assert doctest.testmod(soils).failed == 0


@given(st.floats(0.2, 1.6), st.floats(0.0, 1e5), st.floats(1e3, 1e7), st.floats(0.02, 1.0), st.floats(1e-4, 0.3))
def test_a_conversion_keeps_the_pressure(n: float, k_c: float, k_phi: float, width: float, depth: float) -> None:
    bekker = Soil("s", "nobody", "bekker", n, k_c, k_phi, 0.0, 0.5)
    reece = bekker.converted("reece", width)
    assert reece.form == "reece"
    assert reece.pressure(depth, width) == pytest.approx((k_c / width + k_phi) * depth**n, rel=1e-12)
    back = reece.converted("bekker", width)
    assert (back.k_c, back.k_phi) == pytest.approx((k_c, k_phi), rel=1e-12)


def test_units_follow_form_and_exponent() -> None:
    assert (SOIL.unit("k_c"), SOIL.unit("k_phi")) == ("Pa/m^-0.2", "Pa/m^0.8")
    reece = replace(SOIL, form="reece")
    assert (reece.unit("k_c"), reece.unit("k_phi")) == ("Pa", "Pa/m")


def test_published_numbers_are_those_of_their_sources() -> None:
    lete = library()["lete_sand"]
    assert lete.stiffness(0.235) == pytest.approx((6.94 / 0.235 + 505.80) * 1e3, rel=1e-4)  # Wong's k_c and k_phi
    assert library()["sand_vella"].footing(0.235) == pytest.approx((357.6e3, 0.71, 1150.0, np.radians(31.5), 0.036))
    li = library()["dry_sand_li"]
    assert (li.stiffness(0.1), li.c1, li.c2, li.unit_weight) == (1.945e6, 0.18, 0.32, 19600.0)
    # Reina et al. put the Bekker number 1528 into Reece's form as it stands: at 0.15 m that is 21 % too stiff.
    reina = library()["sand_reina"].k_phi * 0.15
    converted = library()["dry_sand_lll"].converted("reece", 0.15).k_phi * 0.15
    assert reina / converted == pytest.approx(1.208, abs=0.003)


def test_every_soil_names_its_source() -> None:
    for name, soil in library().items():
        assert soil.name == name
        assert any(author in soil.source for author in ("Vella", "Li et al.", "Reina", "Wong"))
        assert soil.stiffness(soil.width or 0.2) > 0


def test_reading_refuses_a_unit_of_another_exponent() -> None:
    bekker = Soil("s", "x", "bekker", 0.71, 0.0, 1.0, 0.0, 0.0)
    assert number("535.3 kN/m^2.71", bekker.unit("k_phi")) == pytest.approx(535.3e3)
    for field, text in (
        *(("k_phi", "535.3 kN/m"), ("k_phi", "535.3 kN/m^2.7"), ("k_c", "0 kPa"), ("cohesion", "3 deg")),
        *(("k_c", "much Pa"), ("k_c", "1 Pa^9^9^9"), ("k_c", "1 nothing")),
    ):
        with pytest.raises(ValueError, match=f"^found '{re.escape(text)}', expected a quantity that converts to"):
            number(text, bekker.unit(field))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("k_phi", -1.0, r"k_phi: found -1 Pa/m\^0.8, expected at least 0"),
        ("exponent", 0.0, "exponent: found 0, expected more than 0 and at most 3"),
        ("cohesion", -5.0, "cohesion: found -5 Pa, expected at least 0"),
        ("friction_angle", 42.2, "friction_angle: found 42.2 rad, expected at least 0 and less than 1.5708"),
        ("shear_modulus", 0.0, "shear_modulus: found 0 m, expected more than 0"),
        ("cohesion", float("nan"), "cohesion: found nan"),
    ],
)
def test_a_value_out_of_range_is_named(field: str, value: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(SOIL, **{field: value})


def test_negative_stiffness_at_a_width_is_refused() -> None:
    narrow = replace(SOIL, k_c=-5e5)
    assert narrow.stiffness(1.0) > 0
    with pytest.raises(ValueError, match=r"stiffness: found -4.1e\+06 Pa/m\^0.8, expected more than 0"):
        narrow.stiffness(0.1)
    with pytest.raises(ValueError, match=r"shear_modulus: .* states none"):
        library()["clay_thailand"].footing(0.2)
