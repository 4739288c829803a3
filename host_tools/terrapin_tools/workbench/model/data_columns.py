"""Directions in which a residual could lie: what each effect of the catalogue would add, and shapes in any column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product
from math import pi

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases.kinds.base import Fitted
from terrapin_tools.workbench.case.case import Case, require_effect
from terrapin_tools.workbench.model.model import Model

__all__ = [
    "Direction",
    "Shapes",
    "beside",
    "candidates",
    "catalogue_directions",
    "column_shapes",
    "is_phase",
    "numeric_columns",
]

GRID_LIMIT = 300  # combinations of an effect's grid that are looked at
DEGREE = 3  # of the polynomials in a column
AT_ONCE = 10  # effects that are looked at beside one motion; more would slow each of its steps


@dataclass(frozen=True)
class Direction:
    """Change of the prediction (channels, rows), in the channels' units, by a small amount of an effect."""

    effect: str
    change: Array


def is_phase(one: Parameter | Fitted) -> bool:
    """Whether a parameter is an angle at which a wave starts (the catalogue bounds those by two turns)."""
    bounds = (one.minimum, one.maximum) if isinstance(one, Parameter) else (one.lower, one.upper)
    return one.unit == "rad" and bounds == (-2 * pi, 2 * pi)


def candidates(model: Model) -> list[Effect]:
    """Effects that could be added to the model: needed roles mapped, constants known, values allowed."""
    case = model.case
    taken = {effect.name for effect in model.effects}
    found = []
    for name in case.library:
        if name in taken:
            continue
        try:
            found.append(require_effect(case, name, lambda message, *path: UserError(message)))
        except UserError:
            continue  # the reason is for those who add it by name; here it is just no candidate
    return found


def beside(model: Model, theta: Array, asked: Sequence[tuple[Effect, Array]], rows: Mask) -> list[Array]:
    """Predictions (sets, channels, rows) of a model with each of some effects alone, at sets that hardly differ.

    Parameters
    ----------
    theta : the model's own parameters.
    asked : effects, each with its parameters (sets, parameters); in the first of its sets it has size 0.

    A body over time is integrated once for several effects, of which all but one are absent.
    """
    base, inputs = model.case.base, model.case.inputs
    at_once = AT_ONCE if base.whole_runs and not base.own_dynamics else 1
    found: list[Array] = []
    for begin in range(0, len(asked), at_once):
        some = asked[begin : begin + at_once]
        absent = np.concatenate([theta, *(own[0] for _, own in some)])
        sets, place = [absent[None]], len(theta)
        for _, own in some:
            part = np.repeat(absent[None], len(own) - 1, axis=0)
            part[:, place : place + own.shape[1]] = own[1:]
            sets.append(part)
            place += own.shape[1]
        joint = reduce(Model.having, (effect for effect, _ in some), model)
        try:
            values = joint.bind(inputs, rows).near(np.concatenate(sets))
        except ValueError:  # more values than a body's table has room for
            if len(some) == 1:
                raise
            values = np.array([np.nan])
        if len(some) > 1 and not np.isfinite(values).all():  # or one of them spoils all
            found += [beside(model, theta, [one], rows)[0] for one in some]
            continue
        parts = np.split(values[1:], np.cumsum([len(own) - 1 for _, own in some])[:-1])
        found += [np.concatenate([values[:1], part]) for part in parts]
    return found


def catalogue_directions(model: Model, theta: Array, rows: Mask) -> list[Direction]:
    """One direction for each candidate effect and each value of its shape (nearly equal ones once)."""
    asked: list[tuple[Effect, Array]] = []
    changes: list[tuple[Effect, Array]] = []
    for effect in candidates(model):
        fresh = effect.parameters
        if not fresh:
            continue
        # half a turn of a phase is the other sign
        shaped = [(-0.5 * pi, 0.0) if is_phase(p) else p.grid or (p.start,) for p in fresh[1:]]
        axes = [(0.0,), *shaped]
        grid = list(product(*axes))[:GRID_LIMIT]
        step = 1e-3 if not np.isfinite(fresh[0].maximum) else min(1e-3, 1e-3 * abs(fresh[0].maximum))
        own = np.array([(0.0, *grid[0][1:]), *grid])
        own[1:, 0] = step
        if fresh[0].start == 0.0:
            asked.append((effect, own))
            continue
        own[1:, 0] = step = 1e-3 * abs(fresh[0].start)  # an expression of the user's own: its first is maybe no size
        bound = model.having(effect).bind(model.case.inputs, rows)
        sets = np.hstack([np.repeat(theta[None], len(grid), axis=0), own[1:]])
        changes.append((effect, (bound.predict(sets) - model.bind(model.case.inputs, rows).predict(theta)) / step))
    for (effect, own), values in zip(asked, beside(model, theta, asked, rows), strict=True):
        changes.append((effect, (values[1:] - values[0]) / own[1, 0]))
    directions = []
    order = {effect.name: place for place, effect in enumerate(candidates(model))}
    for effect, change in sorted(changes, key=lambda one: order[one[0].name]):
        flat = change.reshape(len(change), -1)
        norm = np.sqrt((flat * flat).sum(axis=1))
        usable = np.flatnonzero(np.isfinite(norm) & (norm > 0.0))
        unit = flat[usable] / norm[usable, None]
        alike = np.abs(unit @ unit.T) > 0.9999
        for i, index in enumerate(usable):
            if not alike[i, :i].any():
                directions.append(Direction(effect.name, change[index] / norm[index]))
    return directions


def numeric_columns(case: Case) -> dict[str, Array]:
    """Every numeric column that is not a channel: roles by their name, unmapped columns by theirs."""
    return {**case.roles, **case.extra}


@dataclass(frozen=True)
class Shapes:
    """Functions of one column, each (count, rows): polynomials taken together, and plain monomials taken singly."""

    together: Array
    singly: Array


def column_shapes(case: Case, rows: Mask) -> dict[str, Shapes]:
    """Shapes of unit rms for each column that varies; under "" what needs no column: a constant, the sign of motion.

    Polynomials show any smooth dependence; monomials through zero are what short formulas are made of. Where the motion
    reverses, both also stand times its sign.
    """
    omega = case.roles.get("omega")
    direction = None if omega is None else np.sign(omega[rows])
    if direction is not None and len(np.unique(direction)) < 2:
        direction = None
    count = int(rows.sum())
    shapes = {"": Shapes(np.zeros((0, count)), _unit([np.ones(count)], direction))}
    for name, values in numeric_columns(case).items():
        x = values[rows]
        low, high = float(x.min()), float(x.max())
        if high - low <= 1e-12 * max(abs(low), abs(high), 1e-300):
            continue
        u = (2.0 * x - low - high) / (high - low)
        degree = min(DEGREE, len(np.unique(x)) - 1)
        smooth = _unit(
            [np.polynomial.legendre.Legendre.basis(k)(u) for k in range(1, degree + 1)],
            None if name == "omega" else direction,
        )
        if low < 0.0 < high:
            smooth = np.vstack([smooth, _unit([np.sign(x), np.abs(x)], None)])
        shapes[name] = Shapes(smooth, _unit([x, x * x], direction))
    return shapes


def _unit(columns: list[Array], direction: Array | None) -> Array:
    stacked = np.array(columns if direction is None else [*columns, *(c * direction for c in columns)])
    return np.asarray(stacked / np.maximum(np.sqrt((stacked**2).mean(axis=1, keepdims=True)), 1e-300))
