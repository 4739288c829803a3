"""Every number of the reference tables of sphere, wheel and tyre on soil, which an independent implementation computed.

Their quadrature converged to 1e-9 (sphere), 1e-8 (wheel: 40 nodes a zone) and 7e-6 (tyre, met to 1e-6 by the same
rule). The sphere's rows at slip 0 and 0.1 have kinks inside, which the tables' rule met to 3e-7.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.physics import soils, sphere, tyre, wheel
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.expression import parse

DATA = Path(__file__).parent / "data"
RTOL = 1e-6
PHI = np.radians(42.2)
LI = sphere.Soil(1.945e6, 0.97, 0.0, PHI, 0.01778)  # Li et al. 2024, Table 1


def table(name: str) -> dict[str, np.ndarray]:
    with (DATA / name).open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {k: np.array([r[k] for r in rows]) for k in rows[0]}


def numbers(columns: dict[str, np.ndarray], *names: str) -> list[np.ndarray]:
    return [columns[name].astype(float) for name in names]


@pytest.mark.parametrize("stress", ["full", "linear"])
def test_sphere(stress: str) -> None:
    columns = table("contact_sphere.csv")
    chosen = columns["stress"] == stress
    assert chosen.sum() == {"full": 71, "linear": 16}[stress]
    columns = {k: v[chosen] for k, v in columns.items()}
    radius, load, slip = numbers(columns, "radius", "load", "slip")
    c = sphere.solve(load, slip, radius, LI, stress == "linear")
    assert np.abs(c.vertical / load - 1.0).max() < 1e-9
    r_c = sphere.bulldozing(c.entry, radius, 0.0, PHI, 19600.0, 20.0, 6.0)
    found = {"entry": c.entry, "sinkage": c.sinkage, "traction": c.traction, "torque": c.torque, "bulldozing": r_c}
    slip_resistance = parse(catalogue()["slip_sinkage"].expression)  # Eq. 9
    for clip, tail in ((1.0, ""), (0.0, "_printed")):
        r_f = slip_resistance.evaluate({"load": load, "slip": slip, "xi1": 2.0, "xi2": 0.45, "xi3": 2.0, "clip": clip})
        found["slip_sinkage" + tail] = r_f
        found["corrected_traction" + tail] = c.traction - (r_c + r_f)  # Eq. 10
        found["corrected_torque" + tail] = c.torque - radius * (r_c + r_f)
    assert set(found) == set(columns) - {"stress", "radius", "load", "slip"}
    for name, value in found.items():
        np.testing.assert_allclose(value, columns[name].astype(float), rtol=RTOL, atol=1e-9, err_msg=name)
    for tail in ("", "_printed"):  # Eq. 10 leaves T/R - DP as it is
        difference = found["corrected_torque" + tail] / radius - found["corrected_traction" + tail]
        np.testing.assert_allclose(difference, c.torque / radius - c.traction, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("stress", ["full", "linear"])
def test_wheel(stress: str) -> None:
    columns = table("contact_wheel.csv")
    chosen = columns["stress"] == stress
    assert chosen.sum() == 38
    columns = {k: v[chosen] for k, v in columns.items()}
    degrees, slip, depth, load, traction, torque = numbers(
        columns, "entry_deg", "slip", "sinkage_mm", "load", "traction", "torque"
    )
    modulus = np.where(columns["kind"] == "pull_zero_10mm", 0.010, 0.025)
    soil = wheel.Soil(24e3, 1528e3, 1.1, 700.0, np.radians(30), modulus)
    for c in (
        wheel.at(np.radians(degrees), slip, 0.08, 0.15, soil, stress == "linear"),
        wheel.solve(load, slip, 0.08, 0.15, soil, stress == "linear"),
    ):
        np.testing.assert_allclose(np.degrees(c.entry), degrees, rtol=RTOL)
        np.testing.assert_allclose(c.sinkage * 1e3, depth, rtol=RTOL)
        np.testing.assert_allclose(c.vertical, load, rtol=RTOL)
        np.testing.assert_allclose(c.torque, torque, rtol=RTOL)
        # where the pull is zero, and near it, entry and slip are known to 1e-10 only: of the load
        np.testing.assert_allclose(c.traction, traction, rtol=RTOL, atol=2e-9 * 18.639)


@pytest.mark.parametrize("soil", ["lete_sand", "sand_vella"])
def test_tyre(soil: str) -> None:
    columns = table("contact_tyre.csv")
    chosen = columns["soil"] == soil
    assert chosen.sum() == 30
    columns = {k: v[chosen] for k, v in columns.items()}
    deflecting, slip, depth, force, load, torque, circle, degrees, effective = numbers(
        columns, *(name for name in columns if name not in ("kind", "soil"))
    )
    footing = soils.library()[soil].footing(0.235)
    balance = columns["kind"] == "balance"
    assert balance.sum() == 21
    for rows, c in (
        (balance, tyre.solve(tyre.Tyre(), footing, deflecting[balance], slip[balance])),
        (~balance, tyre.evaluate(tyre.Tyre(), footing, deflecting[~balance], slip[~balance], depth[~balance])),
    ):
        pairs = {
            "sinkage": (c.sinkage, depth),
            "force": (c.force, force),
            "load": (c.load, load),
            "torque": (c.torque, torque),
            "circle": (c.circle_radius, circle),
            "entry": (np.degrees(c.entry_angle), degrees),
            "effective": (c.effective_radius, effective),
        }
        for name, (found, expected) in pairs.items():
            np.testing.assert_allclose(found, expected[rows], rtol=RTOL, err_msg=name)
