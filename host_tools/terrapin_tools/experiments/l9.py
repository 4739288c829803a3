"""Three factors at three levels in nine runs: the orthogonal array L9(3^4), range analysis and analysis of variance.

The array's four columns are a, b, a + b and a + 2 b (mod 3). Three hold factors; the fourth is empty, and its two
degrees of freedom are all there is to estimate the error from when no run is repeated. Source: Taguchi; used by Li et
al. 2024, Tables 2 and 3, whose numbers this reproduces.

>>> analysis = analyse(LI_2024)
>>> [f"{f.f_ratio:.3f}" for f in analysis.factors], [f"{f.p_value:.5f}" for f in analysis.factors]
(['506.835', '243.687', '0.850'], ['0.00197', '0.00409', '0.54040'])
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from terrapin_tools.errors import UserError, about
from terrapin_tools.workbench.files.tables import read

__all__ = [
    *("ARRAY", "LI_2024", "Analysis", "Design", "FactorAnalysis"),
    *("analyse", "describe", "plan", "plan_text", "read_design"),
]

# Levels 0 to 2 of the four columns in the nine runs; any two columns hold every pair of levels once.
ARRAY: tuple[tuple[int, int, int, int], ...] = tuple(
    (a, b, (a + b) % 3, (a + 2 * b) % 3) for a, b in product(range(3), repeat=2)
)


@dataclass(frozen=True)
class Design:
    """Factors with their units, the settings of nine runs, and what was measured."""

    factors: tuple[str, ...]  # three, with units
    settings: tuple[tuple[float, ...], ...]  # (9, 3)
    response: tuple[float, ...]  # (9,)
    response_name: str
    levels: tuple[tuple[float, ...], ...] = ()  # of each factor, in the order in which they are numbered; rising if ()
    left_out: tuple[int, ...] = ()  # runs, from 0, whose response is none: something else ended them


@dataclass(frozen=True)
class FactorAnalysis:
    """One factor: sums and means of the response at each level, and its variance.

    Where runs are left out, sums are of the others and means are adjusted for the levels of the other factors; nan
    where what is left does not determine them.
    """

    name: str
    levels: tuple[float, float, float]
    sums: tuple[float, float, float]  # K1 to K3
    means: tuple[float, float, float]
    range_of_means: float  # what Li et al. print as R
    sum_of_squares: float
    degrees: int
    f_ratio: float
    p_value: float
    best_level: float  # with the largest mean


@dataclass(frozen=True)
class Analysis:
    response_name: str
    factors: tuple[FactorAnalysis, ...]  # in the order of the design
    order: tuple[str, ...]  # by range, the strongest first
    error_squares: float
    error_degrees: int
    total_squares: float
    critical_f: float  # at `level`
    level: float
    pooled: tuple[tuple[str, float, float], ...]  # (factor, F, p) with the factors below F = 1 taken as error
    pooled_degrees: int
    pooled_critical_f: float
    conclusions: tuple[str, ...]


def plan(levels: Sequence[Sequence[float]]) -> list[tuple[float, ...]]:
    """Settings of the nine runs for three factors of three levels each. ValueError names what is wrong.

    >>> plan([(7.7, 8.0, 8.3), (0.3, 0.4, 0.5), (1.0, 1.125, 1.25)])[3]
    (8.0, 0.3, 1.125)
    """
    if len(levels) != 3:
        raise ValueError(f"levels: found {len(levels)} factors, expected 3")
    for number, choices in enumerate(levels, 1):
        if len(choices) != 3 or len(set(choices)) != 3:
            raise ValueError(f"levels: found {list(choices)} for factor {number}, expected 3 different levels")
    return [tuple(levels[factor][row[factor]] for factor in range(3)) for row in ARRAY]


def analyse(design: Design, level: float = 0.05) -> Analysis:
    """Range analysis and analysis of variance. ValueError where the design is not an L9 or a value is not finite."""
    response = np.array(design.response, dtype=np.float64)
    settings = np.array(design.settings, dtype=np.float64)
    _check(design, settings, response)
    kept = np.array([run not in design.left_out for run in range(9)])
    response, settings = response[kept], settings[kept]
    total = float(((response - response.mean()) ** 2).sum()) if response.size else 0.0
    levels = [
        tuple(design.levels[column]) if design.levels else tuple(sorted({run[column] for run in design.settings}))
        for column in range(3)
    ]
    blocks = [
        np.array([[float(run[column] == level) for level in choices] for run in settings]).reshape(-1, 3)
        for column, choices in enumerate(levels)
    ]
    error, rank, effects = _additive(blocks, response)
    degrees = response.size - rank
    if degrees > 0 and error <= 1e-12 * total:
        raise ValueError(
            f"response: found an error of {error:g}, expected one to compare with: these are no measurements"
        )
    factors = []
    for column, name in enumerate(design.factors):
        others = blocks[:column] + blocks[column + 1 :]
        without, rank_without, _ = _additive(others, response)
        squares, freedom = max(without - error, 0.0), rank - rank_without
        means = effects[column] if freedom == 2 else np.full(3, np.nan)
        ratio = (squares / freedom) / (error / degrees) if degrees > 0 and freedom == 2 else math.nan
        factors.append(
            FactorAnalysis(
                name=name,
                levels=(levels[column][0], levels[column][1], levels[column][2]),
                sums=_three(blocks[column].T @ response),
                means=_three(means),
                range_of_means=float(means.max() - means.min()),
                sum_of_squares=squares,
                degrees=freedom,
                f_ratio=ratio,
                p_value=float(f_distribution.sf(ratio, 2, degrees)) if degrees > 0 else math.nan,
                best_level=levels[column][int(np.argmax(means))] if freedom == 2 else math.nan,
            )
        )
    weak = [f for f in factors if f.f_ratio < 1.0]
    strong = [f for f in factors if f.f_ratio >= 1.0]
    pooled_degrees = degrees + 2 * len(weak)
    pooled_error = (error + sum(f.sum_of_squares for f in weak)) / pooled_degrees if pooled_degrees > 0 else math.nan
    pooled = tuple(
        (
            f.name,
            f.sum_of_squares / 2.0 / pooled_error,
            float(f_distribution.sf(f.sum_of_squares / 2.0 / pooled_error, 2, pooled_degrees)),
        )
        for f in strong
    )
    critical = float(f_distribution.isf(level, 2, degrees)) if degrees > 0 else math.nan
    return Analysis(
        response_name=design.response_name,
        factors=tuple(factors),
        order=tuple(
            f.name for f in sorted(factors, key=lambda f: -f.range_of_means) if not math.isnan(f.range_of_means)
        ),
        error_squares=error,
        error_degrees=degrees,
        total_squares=total,
        critical_f=critical,
        level=level,
        pooled=pooled,
        pooled_degrees=pooled_degrees,
        pooled_critical_f=float(f_distribution.isf(level, 2, pooled_degrees)) if pooled_degrees > 0 else math.nan,
        conclusions=tuple(_conclude(factors, error, degrees, critical, level, design.left_out)),
    )


def _three(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _additive(blocks: list[np.ndarray], response: np.ndarray) -> tuple[float, int, list[np.ndarray]]:
    """Least squares of a mean and a step for each level: residual squares, rank, and each factor's means at its levels
    with the other factors at the middle of theirs, which in a whole array are the means of the runs."""
    matrix = np.hstack([np.ones((response.size, 1)), *blocks])
    fitted, _, rank, _ = np.linalg.lstsq(matrix, response, rcond=None)
    effects = np.split(fitted[1:], len(blocks))
    mean = float(fitted[0] + sum(effect.mean() for effect in effects))
    means = [mean + effect - effect.mean() for effect in effects]
    return float(((response - matrix @ fitted) ** 2).sum()), int(rank), means


def _check(design: Design, settings: np.ndarray, response: np.ndarray) -> None:
    if len(design.factors) != 3:
        raise ValueError(f"factors: found {len(design.factors)}, expected 3")
    if settings.shape != (9, 3):
        raise ValueError(f"settings: found {settings.shape[0]} runs, expected 9 of 3 factors each")
    if response.shape != (9,):
        raise ValueError(f"response: found {response.size} values, expected 9")
    if not np.isfinite(response).all() or not np.isfinite(settings).all():
        raise ValueError("runs: found a value that is not finite, expected numbers")
    for one in range(3):
        found = set(settings[:, one].tolist())
        if len(found) != 3:
            raise ValueError(f"{design.factors[one]}: found {len(found)} levels, expected 3")
        if design.levels and set(design.levels[one]) != found:
            raise ValueError(f"{design.factors[one]}: found levels {sorted(found)}, expected {design.levels[one]}")
        for other in range(one):
            if len(set(zip(settings[:, one], settings[:, other], strict=True))) != 9:
                raise ValueError(
                    f"{design.factors[other]} and {design.factors[one]}: found a pair of levels twice, "
                    "expected every pair once: the design is not orthogonal"
                )


def _conclude(
    factors: Sequence[FactorAnalysis],
    error: float,
    degrees: int,
    critical: float,
    level: float,
    left_out: Sequence[int],
) -> list[str]:
    """What these degrees of freedom support, in sentences."""
    said = []
    if left_out:
        said.append(f"Left out: run {', '.join(str(run + 1) for run in sorted(left_out))}, ended by something else.")
    if degrees <= 0:
        return [*said, f"{9 - len(left_out)} runs leave no degree of freedom for the error: there is no F."]
    for factor in factors:
        if math.isnan(factor.f_ratio):
            said.append(f"{factor.name}: the runs that are left do not determine its effect.")
            continue
        if factor.p_value < level:
            said.append(f"{factor.name}: F = {factor.f_ratio:.3f} exceeds {critical:.1f}; it has an effect.")
        else:
            said.append(
                f"{factor.name}: F = {factor.f_ratio:.3f} is below {critical:.1f}; no effect is shown, "
                f"and no level of it, {factor.best_level:g} neither, can be called the best."
            )
    # The sd that chi squared allows: two degrees of freedom leave it open by an order of magnitude.
    sd = float(np.sqrt(error / degrees))
    low, high = (float(np.sqrt(error / chi2.ppf(q, degrees))) for q in (1.0 - level / 2.0, level / 2.0))
    return [
        *said,
        f"The error has {degrees} degree{'s' if degrees > 1 else ''} of freedom, all from the empty column: "
        f"its sd is {sd:.3g}, but the "
        f"{100 * (1 - level):g} % interval goes from {low:.2g} to {high:.2g}. An effect must reach F = {critical:.1f} "
        "to be seen, so only large ones are.",
        "No run was repeated: what stands as error is measuring error and the interactions of the factors together; "
        "they cannot be told apart, and an interaction also hides inside the factors' own columns.",
    ]


def plan_text(factors: Sequence[str]) -> str:
    """The plan as CSV, of three NAME=LEVEL,LEVEL,LEVEL. UserError says which is wrong."""
    names, levels = [], []
    for text in factors:
        name, equals, values = text.rpartition("=")
        try:
            numbers = [float(value) for value in values.split(",")]
        except ValueError:
            numbers = []
        if not equals or not name.strip() or not numbers or "," in name or not all(map(math.isfinite, numbers)):
            raise UserError(f"--factor: found {text!r}, expected NAME=LEVEL,LEVEL,LEVEL")
        names.append(name.strip())
        levels.append(numbers)
    with about("--factor"):
        runs = plan(levels)
    rows = [",".join(f"{value:g}" for value in run) for run in runs]
    return "\n".join([",".join([*names, "response"]), *(f"{row}," for row in rows)])


def read_design(file: Path) -> Design:
    """A table of nine rows: three factors, and last the response. UserError where it is none."""
    table = read(file)
    names = list(table.columns)
    if len(names) != 4:
        raise UserError(f"{file.name}: found {len(names)} columns, expected three factors and the response")
    columns = [table.numbers(name).tolist() for name in names]
    return Design(
        factors=tuple(names[:3]),
        settings=tuple(zip(*columns[:3], strict=True)),
        response=tuple(columns[3]),
        response_name=names[3],
    )


def describe(analysis: Analysis) -> str:
    """The analysis for people."""
    width = max(len(factor.name) for factor in analysis.factors)
    lines = [f"{analysis.response_name}, range analysis (K: sums at the levels, R: range of their means)"]
    for factor in analysis.factors:
        levels = "  ".join(f"{value:g}: {total:.3f}" for value, total in zip(factor.levels, factor.sums, strict=True))
        lines.append(f"  {factor.name.ljust(width)}  K  {levels}   R {factor.range_of_means:.2f}")
    lines += [
        f"  strongest first: {', '.join(analysis.order)}",
        "",
        "Analysis of variance",
        f"  {'source'.ljust(width)}  {'squares':>8}  df  {'F':>8}  p",
    ]
    for factor in analysis.factors:
        mark = " *" if factor.p_value < analysis.level else ""
        lines.append(
            f"  {factor.name.ljust(width)}  {factor.sum_of_squares:8.4f}  {factor.degrees:2d}  "
            f"{factor.f_ratio:8.3f}  {factor.p_value:.3g}{mark}"
        )
    lines += [
        f"  {'error'.ljust(width)}  {analysis.error_squares:8.4f}  {analysis.error_degrees:2d}",
        f"  critical F at {analysis.level:g}: {analysis.critical_f:.2f}",
    ]
    if analysis.pooled and analysis.pooled_degrees > analysis.error_degrees:
        lines.append(f"  with factors below F = 1 taken as error ({analysis.pooled_degrees} degrees of freedom):")
        lines += [f"    {name}: F = {ratio:.0f}, p = {p:.2g}" for name, ratio, p in analysis.pooled]
    lines += ["", "What this allows one to conclude", *(f"  {text}" for text in analysis.conclusions)]
    return "\n".join(lines)


LI_2024 = Design(
    factors=("mass [kg]", "joint angular acceleration [rad/s^2]", "maximum joint angular velocity [rad/s]"),
    settings=(
        (8.3, 0.3, 1.0),
        (8.3, 0.4, 1.25),
        (8.3, 0.5, 1.125),
        (8.0, 0.3, 1.25),
        (8.0, 0.4, 1.125),
        (8.0, 0.5, 1.0),
        (7.7, 0.3, 1.125),
        (7.7, 0.4, 1.0),
        (7.7, 0.5, 1.25),
    ),
    response=(1.375, 1.658, 1.811, 1.671, 1.870, 2.05, 1.989, 2.22, 2.387),
    response_name="rolling distance [m]",
    levels=((8.3, 8.0, 7.7), (0.3, 0.4, 0.5), (1.0, 1.125, 1.25)),
)
