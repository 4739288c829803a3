"""A base model with effects on one case: what is fitted, and predictions on rows.

model = Model.of(case)                    what is fitted, with bounds and start values
bound = model.bind(case.inputs)           on these rows
bound.predict(theta)                      (channels, rows)
bound.predict(many)                       (sets, channels, rows) for parameters (sets, parameters)
bound.jacobian(theta)                     prediction and its derivatives (channels, rows, parameters)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import Expression, parse
from terrapin_tools.workbench.bases.kinds.base import Act, Fitted, Predictor, Problem, Runs
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.model.grouped import Grouped
from terrapin_tools.workbench.model.table_faults import Fault, held, read, recorded

__all__ = ["Bound", "Model"]

Jacobian = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Model:
    """A base model with a set of effects on one case. Cheap to make; `bind` puts it on rows."""

    case: Case
    effects: tuple[Effect, ...]
    fitted: tuple[Fitted, ...]

    @classmethod
    def of(cls, case: Case, effects: Iterable[str] | None = None) -> Model:
        """The case's model with its own effects, or with those named."""
        chosen = tuple(case.library[name] for name in (case.effects if effects is None else effects))
        fitted = []
        for one in case.fit.values():
            plain = Fitted(one.name, one.name, None, one.unit, one.value, one.minimum, one.maximum)
            by = case.by.get(one.name, "")
            groups = case.groups[by].names if by else ()
            fitted += [replace(plain, key=f"{one.name}[{g}]", by=by, group=g) for g in groups] or [plain]
        for effect in chosen:
            fitted += _fitted(effect)
        return cls(case, chosen, tuple(fitted))

    def having(self, effect: Effect) -> Model:
        """This model with one more effect."""
        return replace(self, effects=(*self.effects, effect), fitted=(*self.fitted, *_fitted(effect)))

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that are both predicted and measured, in the base model's order."""
        return tuple(c for c in self.case.base.channels if c in self.case.channels)

    @cached_property
    def start(self) -> Array:
        return np.array([f.start for f in self.fitted], dtype=np.float64)

    @cached_property
    def lower(self) -> Array:
        return np.array([f.lower for f in self.fitted], dtype=np.float64)

    @cached_property
    def upper(self) -> Array:
        return np.array([f.upper for f in self.fitted], dtype=np.float64)

    @cached_property
    def expressions(self) -> dict[str, Expression]:
        return {effect.name: parse(effect.expression) for effect in self.effects}

    def bind(self, inputs: Mapping[str, Array], rows: Mask | None = None) -> Bound:
        """The model on rows: `inputs` as Case.inputs gives them, all rows or those of a mask.

        Inputs of another length than the case's are proposed settings. UserError when the base cannot predict the rows.
        """
        case, runs = self.case, None
        wrong = [effect for effect in self.effects if isinstance(effect, Fault)]
        own = case.channels if case.base.whole_runs else ()  # from which runs start
        if wrong:
            inputs = read(wrong, inputs, case)
        if rows is not None or len(next(iter(inputs.values()))) == case.rows:
            started = {one.column: one.factor * case.channels[one.column] for one in wrong if one.column in own}
            runs = Runs(case.run, case.run_names, case.place, {**case.roles, **case.channels, **started})
        problem = Problem(
            channels=self.channels,
            effects=tuple(effect for effect in self.effects if not isinstance(effect, Fault)),
            fitted=self.fitted,
            constants=case.parameters,
            options=case.options,
            inputs=inputs,
            rows=rows,
            runs=runs,
            formulas=case.equations,
            scales=case.scales,
            dynamics=held(case.dynamics, wrong),
        )
        apart = any(one.by for one in self.fitted)
        predictor = Grouped(case.base, problem, case.groups) if apart else case.base.predictor(problem)
        shown = recorded(wrong, self.channels, case, rows) if runs is not None else None
        if shown is not None:
            predict, near, jacobian = _shown(predictor, shown)
        else:
            predict, near, jacobian = predictor.predict, predictor.near, predictor.jacobian
        return Bound(self, predict, near, jacobian, predictor.motion, predictor.acting, predictor.trouble)


@dataclass(frozen=True)
class Bound:
    """A model on rows.

    `predict`: channels (channels, rows) for parameters (parameters,); (sets, channels, rows) for (sets, parameters).
    `near`: the same, where the sets hardly differ from the first, to first order.
    `jacobian`: the prediction and its derivatives (channels, rows, parameters).
    `motion`, `acting`, `trouble`: as a base's Predictor has them.
    """

    model: Model
    predict: Callable[[Array], Array]
    near: Callable[[Array], Array]
    jacobian: Jacobian
    motion: Callable[[Array], Mapping[str, Array]]
    acting: Callable[[Array, str], Act | None]
    trouble: Callable[[Array], str]


def _fitted(effect: Effect) -> list[Fitted]:
    return [
        Fitted(f"{effect.name}.{p.name}", p.name, effect.name, p.unit, p.start, p.minimum, p.maximum, p.whole, p.grid)
        for p in effect.parameters
    ]


def _shown(
    predictor: Predictor, shown: Callable[[Array], Array]
) -> tuple[Callable[[Array], Array], Callable[[Array], Array], Jacobian]:
    """Predictions and derivatives as a table with faults has them."""

    def jacobian(theta: Array) -> tuple[Array, Array]:
        prediction, slopes = predictor.jacobian(theta)
        return shown(prediction), np.moveaxis(shown(np.moveaxis(slopes, -1, 0)), 0, -1)

    return lambda theta: shown(predictor.predict(theta)), lambda sets: shown(predictor.near(sets)), jacobian
