"""What could be missing, as columns of a linear model: each effect of the catalogue at each value of its shape.

An effect enters through its size (its first parameter) nearly linearly, with the model's own parameters free. Its other
parameters only shape it: a grid of them is looked at, and a phase becomes a pair of columns (sine and cosine). Columns
are in noise standard deviations and scaled to a root mean square of 1 in the channel where the effect is loudest, so a
coefficient is the effect's size in noise standard deviations, comparable between effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import pi

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.workbench.bases.kinds.base import Act
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.model.data_columns import GRID_LIMIT, beside, is_phase, numeric_columns
from terrapin_tools.workbench.model.model import Model

__all__ = ["Shape", "acting", "loudness", "response", "shapes_of", "shapes_of_each", "terms_of", "varying_parameters"]

DUPLICATE = 0.9995  # correlation above which two shapes of one effect are one


@dataclass(frozen=True)
class Shape:
    """One effect at one value of its shape parameters: what a size of one noise sd (rms) adds.

    `columns` (channels * rows, 1 or 2); `scale`: size parameter = coefficient * scale; `lower`, `upper`: bounds of
    the coefficient (a pair of columns, sine and cosine, has none).
    """

    effect: str
    values: tuple[float, ...]
    columns: Array
    scale: float
    lower: float
    upper: float

    @property
    def one_sided(self) -> bool:
        return self.columns.shape[1] == 1 and (self.lower >= 0.0 or self.upper <= 0.0)


def loudness(change: Array) -> float:
    """Root mean square of a change (channels, rows, ...) in the channel where it is largest."""
    return float(np.sqrt((change * change).mean(axis=1).max()))


def response(model: Model, theta: Array, target: str, rows: Mask, sigma: Array) -> Array:
    """What a unit of an addition to `target` changes in each row's prediction (channels, rows), in noise sd."""
    unit = Effect("probe", "", "", "", (model.case.base.name,), (Parameter("probe_", "1", 0.0),), (), "probe_", target)
    bound = model.having(unit).bind(model.case.inputs, rows)
    slopes = bound.jacobian(np.append(theta, 0.0))[1]
    return np.asarray(slopes[..., -1] / sigma[:, None])


def acting(model: Model, theta: Array, target: str, rows: Mask, sigma: Array) -> Act:
    """What small additions to `target` (count, rows) change (count, channels, rows), in noise sd.

    A base that integrates remembers what acted before, and says itself what comes of it.
    """
    own = model.bind(model.case.inputs, rows).acting(theta, target)
    if own is not None:
        return lambda features: own(features) / sigma[:, None]
    unit_change = response(model, theta, target, rows, sigma)
    return lambda features: unit_change * features[:, None]


def terms_of(model: Model, theta: Array, rows: Mask, sigma: Array) -> dict[str, list[Shape]]:
    """Simple terms in the equations of the user's own: what each would add to a derivative, by name.

    They stand for all that could be missing there when the question is whether anything is; empty for other bases.
    """
    bound = model.bind(model.case.inputs, rows)
    states = bound.motion(theta)
    if not states:
        return {}
    assert model.case.dynamics is not None
    used = set().union(*(formula.names for formula in model.case.dynamics.derivative.values()))
    columns = {name: values[rows] for name, values in model.case.inputs.items() if name in used and name != "time"}
    columns |= states
    features = {"1": np.ones(int(rows.sum()))}
    for name, x in columns.items():
        features |= {name: x, f"{name}*abs({name})": x * np.abs(x), f"{name}**2": x * x}
        features |= {f"{name}**3": x**3, f"sign({name})": np.sign(x)}
    features |= {f"{a}*{b}": columns[a] * columns[b] for a, b in combinations(columns, 2)}
    found = {}
    for target in model.case.base.forces:
        act = acting(model, theta, target, rows, sigma)
        for name, change in zip(features, act(np.array([*features.values()])), strict=True):
            size = loudness(change)
            if np.isfinite(size) and size > 0.0:
                column = (change / size).reshape(-1, 1)
                label = f"{target}: {name}"
                found[label] = [Shape(label, (), column, 1.0 / size, -np.inf, np.inf)]
    return found


def varying_parameters(case: Case, slopes: Array, rows: Mask) -> list[Array]:
    """What it changes that a parameter of the model, or a whole formula, goes with a column of the data, up or down.

    Parameters
    ----------
    slopes : (channels, rows, count), derivatives of the prediction, in noise sd.
    rows : (all rows,), mask of the case's rows that these are.

    Returns
    -------
    For each pair that changes anything (channels * rows, 1), its root mean square 1 where it is loudest.
    """
    found = []
    for values in numeric_columns(case).values():
        along = values[rows] - values[rows].mean()
        for change in np.moveaxis(slopes * along[:, None], -1, 0):
            size = loudness(change)
            if np.isfinite(size) and size > 0.0:
                found.append((change / size).reshape(-1, 1))
    return found


def shapes_of(model: Model, theta: Array, effect: Effect, rows: Mask, sigma: Array) -> list[Shape]:
    """Every shape of an effect beside a fitted model; nearly equal shapes are given once."""
    return shapes_of_each(model, theta, [effect], rows, sigma)[effect.name]


def shapes_of_each(
    model: Model, theta: Array, effects: Sequence[Effect], rows: Mask, sigma: Array
) -> dict[str, list[Shape]]:
    """The same of several effects, by name."""
    looks = [look for effect in effects if (look := _look(effect)) is not None]
    absent = [look for look in looks if look.own[0, 0] == 0.0]
    asked = [(look.effect, look.own) for look in absent]
    values = {look.effect.name: value for look, value in zip(absent, beside(model, theta, asked, rows), strict=True)}
    found: dict[str, list[Shape]] = {effect.name: [] for effect in effects}
    for look in looks:
        name, own = look.effect.name, look.own
        if name not in values:
            bound = model.having(look.effect).bind(model.case.inputs, rows)
            values[name] = bound.near(np.hstack([np.repeat(theta[None], len(own), axis=0), own]))
        step = own[1, 0] - own[0, 0]
        found[name] = _shapes(look, (values[name][1:] - values[name][0]) / step / sigma[:, None])
    return found


@dataclass(frozen=True)
class _Look:
    """How an effect is looked at: combinations of its shape's values, its parameters (1 + combinations, parameters),
    the first of them where it is absent, and which value, if any, is the phase of a wave."""

    effect: Effect
    grid: list[tuple[float, ...]]
    own: Array
    waves: int | None


def _look(effect: Effect) -> _Look | None:
    """None for an effect without parameters, or one whose shapes only a refit can judge."""
    fresh = effect.parameters
    if not fresh:
        return None
    axes: list[tuple[float, ...]] = []
    for parameter in fresh[1:]:
        axes.append((0.0, 0.5 * pi) if is_phase(parameter) else parameter.grid or (parameter.start,))
    waves = next((i for i, p in enumerate(fresh[1:]) if is_phase(p)), None)
    grid = list(product(*axes))
    if waves is None:
        grid = grid[:GRID_LIMIT]
    origin = 0.0 if fresh[0].minimum <= 0.0 <= fresh[0].maximum else fresh[0].start
    width = fresh[0].maximum - fresh[0].minimum
    step = 1e-4 * (min(1.0, width) if np.isfinite(width) else 1.0)
    if origin + step > fresh[0].maximum:
        step = -step
    if origin != 0.0 and len(grid) > 1:
        return None  # an expression of the user's own that has shapes but cannot be absent
    own = np.array([(origin, *grid[0]), *((origin + step, *values) for values in grid)])
    return _Look(effect, grid, own, waves)


def _shapes(look: _Look, changes: Array) -> list[Shape]:
    """Of what a unit of an effect changes (combinations, channels, rows), in noise sd."""
    first, origin, waves = look.effect.parameters[0], look.own[0, 0], look.waves
    found: list[Shape] = []
    units: list[Array] = []
    taken: set[int] = set()
    for index, values in enumerate(look.grid):
        if index in taken:
            continue
        block = changes[index][..., None]
        if waves is not None:
            quarter = look.grid.index((*values[:waves], 0.5 * pi, *values[waves + 1 :]))
            taken.add(quarter)
            block = np.stack([changes[index], changes[quarter]], axis=-1)
        size = loudness(block)
        if not np.isfinite(size) or size == 0.0:
            continue
        columns = (block / size).reshape(-1, block.shape[-1])
        flat = columns.reshape(-1) / np.sqrt((columns * columns).sum())
        if any(abs(float(flat @ other)) > DUPLICATE for other in units):
            continue
        units.append(flat)
        low, high = sorted(((first.minimum - origin) * size, (first.maximum - origin) * size))
        found.append(Shape(look.effect.name, values, columns, 1.0 / size, float(low), float(high)))
    return found
