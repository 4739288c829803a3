"""Base models that predict each row by itself.

The order in which things act: effects that change a parameter, then the base model, then what is added to channels
(resistance, drag), then gains, then what is added to a measured quantity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.bases.kinds.base import Base, Predictor, Problem

__all__ = ["Algebraic", "Rows", "Terms", "Values"]

Values = dict[str, Array | float]


@dataclass  # made at every evaluation: a frozen one takes longer
class Terms:
    """The effects of a model. Their own parameters hide equal names of `values`, which may still change."""

    effects: Sequence[Effect]
    values: Values
    own: Mapping[str, Values]

    def of(self, effect: Effect) -> Array:
        return parse(effect.expression).evaluate({**self.values, **self.own[effect.name]})

    def sum(self, target: str) -> Array:
        """What the effects on `target` come to together."""
        return sum((self.of(effect) for effect in self.effects if effect.target == target), np.zeros(1))


@dataclass(frozen=True, kw_only=True)
class Algebraic(Base):
    """A base model that is one function of a row."""

    def reads(self) -> set[str]:
        """Names of inputs that it may use."""
        return {*self.needs, "speed"}

    def prepare(self, values: Values) -> None:
        """Adds what effects may use or change beside parameters and inputs."""

    def evaluate(self, values: Values, effects: Terms) -> dict[str, Array]:
        """Channels, each (sets, rows) or what broadcasts to it, from parameters and inputs by name."""
        raise NotImplementedError

    def predictor(self, problem: Problem) -> Predictor:
        return Rows(self, problem)


class Rows(Predictor):
    """An algebraic base model on rows."""

    def __init__(self, base: Algebraic, problem: Problem) -> None:
        super().__init__(problem)
        self.base, self.size = base, problem.count
        used = base.reads().union(*(parse(effect.expression).names for effect in problem.effects))
        taken = slice(None) if problem.rows is None else problem.rows
        self.columns = {name: values[taken] for name, values in problem.inputs.items() if name in used}
        self.options = {
            effect.name: {name: problem.constants.get(name, value) for name, value in effect.options.items()}
            for effect in problem.effects
        }

    def sets(self, sets: Array) -> Array:
        values, terms = self.state(sets)
        return self.measured(self.base.evaluate(values, terms), terms, len(sets))

    def state(self, sets: Array) -> tuple[Values, Terms]:
        """Everything that formulas may name, after the effects that change parameters."""
        values: Values = {**self.problem.constants, **self.columns}
        own: dict[str, Values] = {name: {**options} for name, options in self.options.items()}
        for fitted, column in zip(self.problem.fitted, sets.T, strict=True):
            (values if fitted.effect is None else own[fitted.effect])[fitted.name] = column[:, None]
        self.base.prepare(values)
        terms = Terms(self.problem.effects, values, own)
        for effect in self.problem.effects:
            target = effect.target
            if target not in self.base.channels and target not in self.base.forces:
                change = terms.of(effect)
                values[target] = values[target] + change if effect.additive else values[target] * (1.0 + change)
        return values, terms

    def measured(self, channels: dict[str, Array], terms: Terms, count: int) -> Array:
        """Channels (count, channels, rows) after what adds to them, multiplies them, and errs in measuring them."""
        for stage in ("channel", "gain", "measured"):
            for effect in self.problem.effects:
                if effect.target in channels and effect.stage == stage:
                    change, present = terms.of(effect), channels[effect.target]
                    channels[effect.target] = present * (1.0 + change) if stage == "gain" else present + change
        return np.stack([np.broadcast_to(channels[c], (count, self.size)) for c in self.problem.channels], axis=1)
