"""Short expressions for an effect that no catalogue has: one shape in one column, times at most one further column.

Every expression is `k * (shape of a column) * (modulator)` on one target. k carries whatever unit makes it sound, so no
expression mixes units, and shapes that need a scale (exp, tanh) get a parameter with the column's unit. The library is
listed in full and judged by its evidence; longer expressions start with a smaller prior probability, so the answer is
as short as the measurements allow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hil.physics.effects import Effect, Parameter
from hil.physics.expression import Expression, parse
from host_tools.workbench.bases import ROLES, formula_name
from host_tools.workbench.candidates import response
from host_tools.workbench.case import Case
from host_tools.workbench.models import Model
from host_tools.workbench.noise import orthonormal

__all__ = ["SCALE_COST", "Library", "Sketch", "as_effect", "library"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

COLUMNS = 24  # columns of the data that are looked at, roles first
LIMIT = 4000  # expressions
DUPLICATE = 0.985  # correlation, beyond what the model can take up, above which an expression is another one
SHAPE_COST = 0.35  # prior factor of a shape other than the column itself
PRODUCT_COST = 0.35  # prior factor of a further column
UNMAPPED_COST = 0.5  # prior factor of a column that the case does not map
SCALE_COST = 1.5  # log evidence taken off a refit for each scale that it could choose
TARGET_COST = {"resistance": 1.0, "channel": 0.7, "drag": 0.5, "parameter": 0.25}


@dataclass(frozen=True)
class Sketch:
    """One expression: `k * shape * modulator` on `target`; `scales` are start values of its shape parameters."""

    text: str
    target: str
    column: str  # the column whose shape it is, as the file or the role has it
    scales: Mapping[str, float]
    units: Mapping[str, str]
    limits: tuple[float, float]  # of the scales
    prior: float


@dataclass(frozen=True)
class Library:
    """Sketches with their columns (channels * rows, count), scaled to rms 1 in noise sd, priors summing to 1."""

    sketches: tuple[Sketch, ...]
    columns: Array
    scales: Array  # k = coefficient * scale


def _shapes(name: str, values: Array, unit: str) -> list[tuple[str, dict[str, float], float]]:
    """(text, start values of scales, prior factor) of shapes in a column."""
    low, high = float(values.min()), float(values.max())
    span = high - low
    one_sign = low >= 0.0 or high <= 0.0
    found: list[tuple[str, dict[str, float], float]] = [(name, {}, 1.0)]
    if unit == "rad" and span > 1.0:
        found += [(f"sin({name})", {}, SHAPE_COST), (f"cos({name})", {}, SHAPE_COST)]
    found.append((f"{name}**2", {}, SHAPE_COST))
    found.append((f"{name}**3", {}, SHAPE_COST**1.5))
    found.append((f"abs({name})**1.5", {}, SHAPE_COST**2))
    size = f"abs({name})" if not one_sign else name
    floor, top = (0.0, max(-low, high)) if not one_sign else (low, high)
    for share in (0.45, 0.7):  # nothing below a threshold
        found.append((f"max({size} - w, 0)", {"w": floor + share * (top - floor)}, SHAPE_COST**3))
    if not one_sign:
        found.append((f"abs({name})", {}, SHAPE_COST))
        found.append((f"{name}*abs({name})", {}, SHAPE_COST))
        found.append((f"sign({name})", {}, SHAPE_COST))
        found.append((f"abs({name})**3", {}, SHAPE_COST**2))
        found.append((f"sqrt(abs({name}))", {}, SHAPE_COST**1.5))
        found.append((f"sign({name})*sqrt(abs({name}))", {}, SHAPE_COST**1.5))
        for share in (0.1, 0.3):
            found.append((f"tanh({name}/w)", {"w": share * max(-low, high)}, 0.5 * SHAPE_COST**1.5))
    else:
        found.append((f"sqrt(abs({name}))", {}, SHAPE_COST))
    if low > 0.0:
        found.append((f"log({name})", {}, SHAPE_COST))
        if low > 0.02 * high:
            found.append((f"1/{name}", {}, SHAPE_COST))
    if low >= 0.0 and span > 0.0:
        for share in (0.06, 0.15, 0.4, 1.0):
            found.append((f"exp(-{name}/tau)", {"tau": share * high}, 0.25 * SHAPE_COST))
    else:
        for share in (0.15, 0.5):
            found.append((f"exp(-abs({name})/tau)", {"tau": share * max(-low, high)}, 0.5 * SHAPE_COST**1.5))
    return found


def _limits(text: str, values: Array) -> tuple[float, float]:
    """Between which the scale of a shape lies: a threshold inside the column's range, others up to its size."""
    low, high = float(values.min()), float(values.max())
    if text.startswith("max("):  # lower, a threshold is a straight line: two effects of the catalogue in disguise
        if low < 0.0 < high:
            low, high = 0.0, max(-low, high)
        return low + 0.3 * (high - low), low + 0.85 * (high - low)
    size = max(abs(low), abs(high))
    return 0.02 * size, 1.2 * size


def _targets(case: Case) -> list[tuple[str, float]]:
    """Targets and their prior factors."""
    name = case.base.name
    found = [(c, TARGET_COST["channel"]) for c in case.base.channels if c in case.channels]
    if name == "rolling_steady":
        found = [("resistance", TARGET_COST["resistance"]), *found, ("torque_constant", TARGET_COST["parameter"])]
    elif name != "equation":
        found += [("drag", TARGET_COST["drag"])]
        found += [(p, TARGET_COST["parameter"]) for p in ("k_s", "cohesion", "friction_angle", "shear_modulus")]
    return found


def _modulators(case: Case, target: str, main: str, values: Mapping[str, Array]) -> list[tuple[str, float]]:
    """Factors that may stand beside a shape, with their prior factors."""
    found: list[tuple[str, float]] = [("", 1.0)]
    if case.base.name == "rolling_steady":
        omega = values.get("omega")
        reverses = omega is not None and omega.min() < 0.0 < omega.max()
        resists = target == "resistance"
        if reverses and target != "torque_constant":
            found.append(("sign(omega)", 1.0 if resists else PRODUCT_COST))
        if resists and "load" in values:
            found.append(("load*sign(omega)" if reverses else "load", PRODUCT_COST))
        if resists:
            found.append(("omega", PRODUCT_COST))
        return [f for f in found if f[0] != main]
    for name in values:
        role = name if case.base.name == "equation" else {"pass_": "pass"}.get(name, name)
        if name == main or role not in case.roles or role == "time":
            continue
        found.append((name, PRODUCT_COST))
        if case.base.name == "equation" and values[name].min() < 0.0 < values[name].max():
            found.append((f"sign({name})", PRODUCT_COST))
    return found


def library(model: Model, theta: Array, rows: Mask, sigma: Array, known: Array, base: Array) -> Library:
    """Every sketch of a case that differs from what the model (`base`) and the catalogue (`known`) can already say.

    `known` (channels * rows, K) are columns of the catalogue; `base` (channels * rows, P) those of the model itself.
    """
    case = model.case
    inputs = {name: values[rows] for name, values in case.inputs.items()}
    roles = {formula_name(role) for role in case.roles}
    ordered = sorted(inputs, key=lambda name: (name not in roles, list(inputs).index(name)))
    usable = [n for n in ordered if np.ptp(inputs[n]) > 1e-9 * max(1e-300, float(np.abs(inputs[n]).max()))][:COLUMNS]
    values = {name: inputs[name] for name in usable}
    basis = orthonormal(base)
    catalogue = known - basis @ (basis.T @ known)
    norms = np.sqrt((catalogue * catalogue).sum(axis=0))
    catalogue = catalogue[:, norms > 0] / norms[norms > 0]
    sketches: list[Sketch] = []
    columns: list[Array] = []
    scales: list[float] = []
    for target, target_prior in _targets(case):
        if (target in case.base.parameters and not case.parameters.get(target, 1.0)) or len(sketches) > LIMIT:
            continue
        unit_change = response(model, theta, target, rows, sigma)
        for name in usable:
            unit = case.units.get(name) or ROLES.get({"pass_": "pass"}.get(name, name), "1")
            for text, start, shape_prior in _shapes(name, values[name], unit):
                feature = parse(text).evaluate({**values, **start})
                for factor, factor_prior in _modulators(case, target, name, values):
                    whole = feature * parse(factor).evaluate(values) if factor else feature
                    change = unit_change * whole
                    size = float(np.sqrt((change * change).mean(axis=1).max()))
                    if not np.isfinite(size) or size == 0.0:
                        continue
                    sketches.append(
                        Sketch(
                            "*".join(["k", _bracketed(text), *([factor] if factor else [])]),
                            target,
                            {"pass_": "pass"}.get(name, name),
                            start,
                            dict.fromkeys(start, unit),
                            _limits(text, values[name]),
                            target_prior * shape_prior * factor_prior * (1.0 if name in roles else UNMAPPED_COST),
                        )
                    )
                    columns.append((change / size).reshape(-1))
                    scales.append(1.0 / size)
    if not sketches:
        return Library((), np.zeros((base.shape[0], 0)), np.zeros(0))
    stacked = np.array(columns).T
    keep = _distinct(stacked, basis, catalogue, np.array([s.prior for s in sketches]))
    chosen = [sketches[i] for i in keep]
    total = sum(s.prior for s in chosen)
    final = tuple(replace(s, prior=s.prior / total) for s in chosen)
    return Library(final, stacked[:, keep], np.array(scales)[keep])


def _bracketed(text: str) -> str:
    return text if not text.startswith("1/") else f"({text})"


def _distinct(columns: Array, basis: Array, catalogue: Array, prior: Array) -> list[int]:
    """Indices of columns that neither the model nor the catalogue nor a likelier sketch already has."""
    free = columns - basis @ (basis.T @ columns)
    before = np.sqrt((columns * columns).sum(axis=0))
    after = np.sqrt((free * free).sum(axis=0))
    visible = after > 1e-3 * before
    free = free / np.where(visible, after, 1.0)
    if catalogue.shape[1]:
        visible &= np.abs(catalogue.T @ free).max(axis=0) < DUPLICATE
    kept: list[int] = []
    matrix = np.zeros((columns.shape[0], len(prior)))
    for index in np.argsort(-prior, kind="stable"):
        if not visible[index]:
            continue
        count = len(kept)
        if count and np.abs(matrix[:, :count].T @ free[:, index]).max() > 0.9999:
            continue
        matrix[:, count] = free[:, index]
        kept.append(int(index))
    return kept


def as_effect(sketch: Sketch, case: Case, name: str) -> Effect:
    """A sketch as an effect that a model can take: k free from 0, scales positive with further starts around them."""
    expression: Expression = parse(sketch.text)
    parameters = [Parameter("k", _unit(sketch, case), 0.0, meaning="size")]
    for key, value in sketch.scales.items():
        parameters.append(_scale_parameter(key, sketch, value))
    return Effect(
        name=name,
        title="expression found in the data",
        equation=expression.to_latex(),
        source="the measurements themselves: valid inside their range only",
        bases=(case.base.name,),
        parameters=tuple(parameters),
        needs=(),
        expression=sketch.text,
        target=sketch.target,
    )


def _scale_parameter(name: str, sketch: Sketch, start: float) -> Parameter:
    """A scale or threshold stays where the data can see it: outside, every shape is a straight line."""
    low, high = sketch.limits
    grid = tuple(v for v in (start / 2.0, start, start * 2.0) if low <= v <= high)
    return Parameter(name, sketch.units[name], start, low, high, "scale of the shape", grid=grid)


def _unit(sketch: Sketch, case: Case) -> str:
    """The unit of k that makes the expression sound on its target; "1" where a column's unit is not known."""
    from hil.physics.expression import units as registry

    known = {formula_name(role): unit for role, unit in ROLES.items()} if case.base.name != "equation" else {}
    known.update({formula_name(name): unit for name, unit in case.units.items()})
    known.update(sketch.units)
    known["k"] = "1"
    acts_on = {"resistance": "N m", "drag": "N"}.get(sketch.target, case.units.get(sketch.target, "1"))
    shape = parse(sketch.text)
    if not shape.names <= set(known):
        return "1"
    try:
        given = shape.unit(known)
        unit = registry().Unit(acts_on.replace("^", "**") if acts_on != "1" else "dimensionless") / given
    except (ValueError, KeyError):
        return "1"
    return f"{unit:~}" or "1"
