"""The user's own formulas: a line of [model.equation] for each channel, over columns and constants of any name."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import Expression
from terrapin_hil.physics.signals import derivative, lagged, played
from terrapin_tools.workbench.bases.kinds.algebraic import Algebraic, Rows, Terms, Values
from terrapin_tools.workbench.bases.kinds.base import (
    ALONE,
    GAIN,
    PARAMETER_COST,
    PRODUCT_COST,
    Base,
    Factor,
    Problem,
    Target,
)


@dataclass(frozen=True, kw_only=True)
class Equation(Algebraic):
    """Channels by the formulas of a case, which works on numbers as they stand in the file, or in SI with `scales`."""

    formulas: Mapping[str, Expression] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)

    def with_formulas(self, formulas: Mapping[str, Expression], fitted: Collection[str]) -> Base:
        known = replace(self, formulas=formulas)
        return replace(known, further=(*(name for name in fitted if name in known.reads()), *known.gains().values()))

    def gains(self) -> dict[str, str]:
        return {channel: GAIN + channel for channel in self.formulas}

    def targets(self) -> list[Target]:
        """The channels; their formulas as a whole, and fitted parameters in them, which may go with a column."""
        return [*super().targets(), *((name, PARAMETER_COST * PRODUCT_COST) for name in self.further)]

    def reads(self) -> set[str]:
        return {name for formula in self.formulas.values() for name in formula.names}

    def factors(self, target: str, main: str, values: Mapping[str, Array], roles: Collection[str]) -> list[Factor]:
        if target in self.gains().values():
            return [(*ALONE[:2], False)] if main else []
        if target in self.further:  # a column that the formulas read is for another formula, not for a parameter
            return [(*ALONE[:2], False)] if main and main not in self.reads() else []
        found: list[Factor] = []
        for name, prior, _ in super().factors(target, main, values, roles):
            found.append((name, prior, True))
            if name and values[name].min() < 0.0 < values[name].max():
                found += [(f"sign({name})", PRODUCT_COST, True), (f"{name}*abs({name})", PRODUCT_COST**2, False)]
        return found

    def prepare(self, values: Values) -> None:
        values.update(dict.fromkeys(self.gains().values(), 1.0))

    def evaluate(self, values: Values, effects: Terms) -> dict[str, Array]:
        gains = self.gains()
        scaled = {name: value * self.scales.get(name, 1.0) for name, value in values.items()}
        return {c: f.evaluate(scaled) / self.scales.get(c, 1.0) * values[gains[c]] for c, f in self.formulas.items()}

    def predictor(self, problem: Problem) -> Rows:
        return Remembering(replace(self, formulas=problem.formulas, scales=problem.scales), problem)


class Remembering(Rows):
    """Rows of which an effect may see those before: `played` and `rate` of physics/mechanics, and a low-pass."""

    def __init__(self, base: Equation, problem: Problem) -> None:
        super().__init__(base, problem)
        self.moving = [effect for effect in problem.effects if effect.transform in ("play", "rate")]
        self.lags = [effect for effect in problem.effects if effect.transform == "lag"]
        if not (self.moving or self.lags):
            return
        count = len(next(iter(problem.inputs.values())))
        run = problem.runs.index if problem.runs else np.arange(count)
        self.mine = slice(None) if problem.rows is None else problem.rows  # of the case's rows those that are wanted
        self.order, self.first = _by_run(run)
        self.sorted, self.begins = _by_run(run[self.mine])
        self.back = np.argsort(self.order)[self.mine]
        self.rates = {effect.name: self._rate(effect) for effect in self.moving if effect.transform == "rate"}

    def state(self, sets: Array) -> tuple[Values, Terms]:
        values, terms = super().state(sets)
        for effect in self.moving:
            own = terms.own[effect.name]
            if effect.transform == "rate":
                own["rate"] = self.rates[effect.name]
                continue
            (position,) = effect.needs[0]
            gap = np.asarray(own[effect.parameters[1].name])[:, 0]
            gaps, place = np.unique(gap, return_inverse=True)  # most of many sets have the same
            followed = played(self.problem.inputs[position][self.order], gaps, self.first)
            own["played"] = followed[:, self.back][place]
        return values, terms

    def measured(self, channels: dict[str, Array], terms: Terms, count: int) -> Array:
        found = super().measured(channels, terms, count)
        for effect in self.lags:
            at = self.problem.channels.index(effect.target)
            ((name,),) = effect.needs
            time = self.problem.inputs[name][self.mine]
            constant = np.broadcast_to(np.asarray(terms.of(effect)), (count, 1))[:, 0]
            signal = found[:, at, self.sorted]
            found[:, at, self.sorted] = lagged(time[self.sorted], signal, constant, self.begins)
        return found

    def _rate(self, effect: Effect) -> Array:
        (speed,), (time,) = effect.needs[:2]
        v, t = (self.problem.inputs[name][self.order] for name in (speed, time))
        runs = np.split(np.arange(len(v)), np.flatnonzero(self.first)[1:])
        return np.concatenate([derivative(t[rows], v[rows]) for rows in runs])[self.back]


def _by_run(run: Index) -> tuple[Index, Mask]:
    """The order in which the rows of a run stand together, and the first rows of the runs in it."""
    order = np.argsort(run, kind="stable")
    return order, np.diff(run[order], prepend=-1) != 0


BASE = Equation(name="equation", own_names=True, follows=())
