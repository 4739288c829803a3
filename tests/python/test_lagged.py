"""Products under correlated noise from four sums are those of whitened columns; contact derivatives are exact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.ar1 import RHO_GRID, Ar1
from terrapin_tools.workbench.noise.lagged_sums import Lagged


def test_four_sums_give_the_products_of_whitened_columns() -> None:
    random = np.random.default_rng(1)
    run = random.permutation(np.repeat([0, 1, 2, 3], [7, 1, 12, 5]))
    ar1 = Ar1(run)
    x, y = random.standard_normal((50, 3)), random.standard_normal((50, 2))  # two channels
    a, b = Lagged(ar1, 2, x), Lagged(ar1, 2, y)
    products, squares, part = a.with_each(b), a.squares(), a.part(1, 2).with_each(b)
    for rho in RHO_GRID:
        white = [np.concatenate([ar1.whiten(v.reshape(2, 25, -1)[c], rho) for c in range(2)]) for v in (x, y)]
        expected = white[0].T @ white[1]
        np.testing.assert_allclose(products.at(rho), expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(part.at(rho), expected[1:], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(squares.at(rho), (white[0] ** 2).sum(axis=0), rtol=1e-9)


def test_noise_of_all_runs_at_once_is_that_row_by_row() -> None:
    random = np.random.default_rng(2)
    ar1 = Ar1(np.repeat([0, 1, 2], [4, 1, 9]))
    white = random.standard_normal((14, 2))
    found, expected = ar1.colour(white, 0.7), white.copy()
    for row in range(14):
        if row not in (0, 4, 5):
            expected[row] = 0.7 * expected[row - 1] + np.sqrt(1.0 - 0.49) * white[row]
    np.testing.assert_allclose(found, expected)


CONTACT = """
[case]
title = "contact"
[model]
base = "{base}"
effects = ["slip_sinkage", "rut_recovery", "bulldozing", "torque_gain"]
[parameters]
radius = 0.2
width = 0.1
k_c = 2e4
n = 0.9
cohesion = 300.0
shear_modulus = 0.015
c1 = 0.18
c2 = 0.32
unit_weight = 1.6e4
n_c = 20.0
n_gamma = 6.0
[fit]
{stiffness} = {{ value = 1e6, min = 1e4, max = 1e8 }}
friction_angle = {{ value = 0.6, min = 0.2, max = 0.9 }}
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
slip = {{ column = "slip", unit = "1" }}
load = {{ column = "load", unit = "N" }}
traction = {{ column = "t", unit = "N", sigma = 1.0 }}
torque = {{ column = "m", unit = "N m", sigma = 1.0 }}
"""


@pytest.mark.parametrize(("base", "stiffness"), [("sphere_contact", "k_s"), ("wheel_contact", "k_phi")])
def test_jacobian_of_contact_models(tmp_path: Path, base: str, stiffness: str) -> None:
    """Against central differences of the prediction, each of which solves the equilibrium anew."""
    text = CONTACT.format(base=base, stiffness=stiffness)
    unused = ("width", "k_c") if base == "sphere_contact" else ("c1", "c2")
    text = "\n".join(line for line in text.splitlines() if line.split(" = ")[0] not in unused)
    (tmp_path / "case.toml").write_text(text)
    rows = [f"r{i},{0.05 + 0.07 * i},{60 + 9 * (i % 4)},1,1" for i in range(10)]
    (tmp_path / "runs.csv").write_text("\n".join(["run,slip,load,t,m", *rows]) + "\n")
    case = load_case(tmp_path)
    model = Model.of(case)
    bound = model.bind(case.inputs)
    theta = np.array([{"scale": 0.8, "gain": 0.05}.get(f.name, f.start or 0.2) for f in model.fitted])
    prediction, slopes = bound.jacobian(theta)
    np.testing.assert_allclose(prediction, bound.predict(theta), rtol=1e-9)
    for i in range(len(theta)):
        step = 1e-5 * max(abs(theta[i]), 0.1)
        up, down = theta.copy(), theta.copy()
        up[i], down[i] = theta[i] + step, theta[i] - step
        expected = (bound.predict(up) - bound.predict(down)) / (2.0 * step)
        scale = np.abs(expected).max(axis=1, keepdims=True) + 1e-12
        np.testing.assert_allclose(slopes[..., i] / scale, expected / scale, atol=2e-5)
