"""Pressure against sinkage under plates of several sizes: what law holds for a size that was not measured?

    power            p = k z^n
    bekker           p = (k_c / b + k_phi) z^n
    reece            p = (k_c + k_phi b) (z / b)^n
    exponent_linear  p = p_1 (z / 1 m)^(n_0 + n_1 (b / b_r - 1))
    exponent_log     p = p_1 (z / 1 m)^(n_0 + n_1 ln(b / b_r))

b is the plate's size as the file states it, b_r the geometric mean of the sizes. Where the exponent depends on size so
would the unit of k; with the depth in units of 1 m it is a pressure, at which by this law all plates meet.

Least squares in pressure over all rows. Rows of one test belong together, so uncertainty is taken from leaving out one
test at a time (jackknife), and the error that counts from leaving out one size at a time: root mean square over all
rows, each predicted by a fit to the other sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.errors import UserError, about
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.format import meant, parted
from terrapin_tools.workbench.files.tables import Table, read

__all__ = ["LAWS", "Law", "LawFit", "Plates", "analyse", "column", "fit", "read_plates", "replicate_sd"]


@dataclass(frozen=True)
class Plates:
    """Rows of plate tests: size b [m], depth z [m], pressure [Pa], index of the test."""

    size: Array
    depth: Array
    pressure: Array
    test: Index
    test_names: tuple[str, ...]

    @property
    def sizes(self) -> Array:
        return np.unique(self.size)

    @property
    def reference(self) -> float:
        """b_r [m]"""
        return float(np.exp(np.mean(np.log(self.sizes))))


@dataclass(frozen=True)
class Law:
    """One law. `pressure(q, b, z, b_r)` [Pa]; `start(k, n)` from the power law; `units(q)` of its parameters."""

    name: str
    formula: str
    parameters: tuple[str, ...]
    pressure: Callable[[Array, Array, Array, float], Array]
    start: Callable[[float, float, float], tuple[float, ...]]  # of k [Pa/m^n], n, b_r [m]
    units: Callable[[Array], tuple[str, ...]]


@dataclass(frozen=True)
class LawFit:
    """A law fitted: parameters, their jackknife sd over tests, errors [Pa], and that of each size left out."""

    law: Law
    q: Array
    sd: Array
    error: float  # rms over all rows, fitted to all
    left_out: float  # rms over all rows, each size predicted by the others
    by_size: dict[float, float]  # size [m] -> rms of its rows when it was left out


def _per(power: float) -> str:
    """Pa/m^power.

    >>> _per(1.46), _per(0.0), _per(-0.2)
    ('Pa/m^1.46', 'Pa', 'Pa m^0.2')
    """
    text = f"{abs(power):.6g}"
    return "Pa" if text == "0" else f"Pa/m^{text}" if power > 0 else f"Pa m^{text}"


LAWS: Mapping[str, Law] = {
    law.name: law
    for law in (
        Law(
            "power",
            "p = k z^n",
            ("k", "n"),
            lambda q, b, z, reference: q[0] * z ** q[1],
            lambda k, n, b: (k, n),
            lambda q: (_per(float(q[1])), "1"),
        ),
        Law(
            "bekker",
            "p = (k_c / b + k_phi) z^n",
            ("k_c", "k_phi", "n"),
            lambda q, b, z, reference: (q[0] / b + q[1]) * z ** q[2],
            lambda k, n, b: (0.0, k, n),
            lambda q: (_per(float(q[2]) - 1.0), _per(float(q[2])), "1"),
        ),
        Law(
            "reece",
            "p = (k_c + k_phi b) (z / b)^n",
            ("k_c", "k_phi", "n"),
            lambda q, b, z, reference: (q[0] + q[1] * b) * (z / b) ** q[2],
            lambda k, n, b: (0.0, k * b ** (n - 1.0), n),
            lambda q: ("Pa", "Pa/m", "1"),
        ),
        Law(
            "exponent_linear",
            "p = p_1 (z / 1 m)^(n_0 + n_1 (b / b_r - 1))",
            ("p_1", "n_0", "n_1"),
            lambda q, b, z, reference: q[0] * z ** (q[1] + q[2] * (b / reference - 1.0)),
            lambda k, n, b: (k, n, 0.0),
            lambda q: ("Pa", "1", "1"),
        ),
        Law(
            "exponent_log",
            "p = p_1 (z / 1 m)^(n_0 + n_1 ln(b / b_r))",
            ("p_1", "n_0", "n_1"),
            lambda q, b, z, reference: q[0] * z ** (q[1] + q[2] * np.log(b / reference)),
            lambda k, n, b: (k, n, 0.0),
            lambda q: ("Pa", "1", "1"),
        ),
    )
}


def fit(law: Law, plates: Plates, rows: Mask) -> Array:
    """The law's parameters by least squares over `rows`. UserError where the search does not converge."""
    b, z, p = plates.size[rows], plates.depth[rows], plates.pressure[rows]
    above = p > 0.0
    n, log_k = np.polyfit(np.log(z[above]), np.log(p[above]), 1)
    start = np.array(law.start(float(np.exp(log_k)), float(n), plates.reference))
    # In units of the power law's own numbers every parameter is near 1, whatever the soil.
    scale = np.where(np.abs(start) > 1e-9, np.abs(start), 1.0)
    if law.name in ("bekker", "reece"):
        scale[0] = scale[1] * plates.reference
    unit = float(np.sqrt(np.mean(p**2)))
    found: Any = least_squares(
        lambda u: (law.pressure(u * scale, b, z, plates.reference) - p) / unit,
        start / scale,
        method="lm",
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-12,
        max_nfev=5000,
    )
    if not found.success or not np.isfinite(found.x).all():
        raise UserError(f"{law.name}: the fit did not converge: {found.message}")
    return np.asarray(found.x * scale, dtype=np.float64)


def analyse(plates: Plates) -> list[LawFit]:
    """Every law fitted, in the order of LAWS."""
    return [_analyse(law, plates) for law in LAWS.values()]


def _analyse(law: Law, plates: Plates) -> LawFit:
    everything = np.ones(plates.size.size, dtype=bool)
    q = fit(law, plates, everything)
    tests = np.unique(plates.test)
    without = np.array([fit(law, plates, plates.test != test) for test in tests])
    count = len(tests)
    sd = np.sqrt((count - 1) / count * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    residual = law.pressure(q, plates.size, plates.depth, plates.reference) - plates.pressure
    predicted = np.empty(plates.size.size)
    by_size = {}
    for size in plates.sizes:
        out = plates.size == size
        other = fit(law, plates, ~out)
        predicted[out] = law.pressure(other, plates.size[out], plates.depth[out], plates.reference)
        by_size[float(size)] = float(np.sqrt(np.mean((predicted[out] - plates.pressure[out]) ** 2)))
    return LawFit(
        law=law,
        q=q,
        sd=sd,
        error=float(np.sqrt(np.mean(residual**2))),
        left_out=float(np.sqrt(np.mean((predicted - plates.pressure) ** 2))),
        by_size=by_size,
    )


def replicate_sd(plates: Plates) -> float | None:
    """Scatter [Pa] between tests of one size at equal depth: what no law can undercut; None without repeats."""
    squares, degrees = 0.0, 0
    for size in plates.sizes:
        tests = np.unique(plates.test[plates.size == size])
        if len(tests) < 2:
            continue
        curves = [(plates.depth[plates.test == t], plates.pressure[plates.test == t]) for t in tests]
        low, high = max(z.min() for z, _ in curves), min(z.max() for z, _ in curves)
        if high <= low:
            continue
        at = np.linspace(low, high, 20)
        grid = np.array([np.interp(at, np.sort(z), p[np.argsort(z)]) for z, p in curves])
        squares += float(((grid - grid.mean(axis=0)) ** 2).sum())
        degrees += at.size * (len(tests) - 1)
    return float(np.sqrt(squares / degrees)) if degrees else None


def column(text: str, option: str, unit: str, table: Table) -> tuple[str, str]:
    """The column and its unit, of "NAME [UNIT]" or of a heading that has one; it converts to `unit`. UserError
    otherwise."""
    found = meant(text, table.columns)
    given = parted(text)[1] or parted(found or "")[1]
    if not given:
        raise UserError(f"{option}: found {text!r}, expected COLUMN [UNIT]")
    given = units.spelling(given)
    with about(option):
        units.convert(1.0, given, unit)
    return _present(table, text, option), given


def read_plates(file: Path, size: str, depth: str, pressure: str, test: str) -> Plates:
    """Rows of a file; columns as "NAME [UNIT]" or as headings, `test` a name. UserError names what is wrong."""
    table = read(file)
    values = {}
    for option, text, unit in (("--size", size, "m"), ("--depth", depth, "m"), ("--pressure", pressure, "Pa")):
        found, given = column(text, option, unit, table)
        values[option] = units.convert(table.numbers(found), given, unit)
    names = table.text(_present(table, test, "--test"))
    b, z, p = values["--size"], values["--depth"], values["--pressure"]
    for option, numbers in (("--size", b), ("--depth", z)):
        wrong = np.flatnonzero(numbers <= 0.0)
        if wrong.size:
            what = option.removeprefix("--")
            raise UserError(
                f"{table.place(int(wrong[0]))}: {what}: found {numbers[wrong[0]]:g} m, expected more than 0"
            )
    sizes = np.unique(b)
    if len(sizes) < 3:
        raise UserError(f"{file.name}: found {len(sizes)} plate sizes, expected at least 3: one is left out in turn")
    whole = tuple(dict.fromkeys(f"{s:g} m, {n}" for s, n in zip(b, names, strict=True)))
    index = {name: i for i, name in enumerate(whole)}
    tests = np.array([index[f"{s:g} m, {n}"] for s, n in zip(b, names, strict=True)], dtype=np.int64)
    for s in sizes:
        if (p[b == s] > 0.0).sum() < 3:
            raise UserError(f"{file.name}: size {s:g} m: found fewer than 3 rows with pressure, expected at least 3")
    return Plates(b, z, p, tests, whole)


def _present(table: Table, said: str, option: str) -> str:
    found = meant(said, table.columns)
    if found is None:
        bare = parted(said)[0]
        name = said if meant(bare, table.columns) else bare  # there is one in another unit
        raise UserError(
            f"{table.path.name}: column {name!r} ({option}) is missing, expected one of {', '.join(table.columns)}"
        )
    return found
