"""Answers with a fault of the table or a wrong constant, alone and with the effect that suits it best.

A fault is no small change, so nothing is linear in it: the model is refitted on the changed table. An angle in degrees
shows in no model that does not read the angle, and a wrong radius may hide an effect that takes the other way, so the
likeliest effect beside each is looked at, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.compare.comparison import measured, predict
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker, by_effect
from terrapin_tools.workbench.model.effect_columns import Shape, shapes_of
from terrapin_tools.workbench.model.fitting import Fit, extend
from terrapin_tools.workbench.model.table_faults import UNUSUAL, Fault
from terrapin_tools.workbench.noise.mishaps import in_most_runs

__all__ = ["beside_constants", "table_answers"]

MECHANICS = ("equation",)  # bases of effects whose speeds and sizes follow a column's own range: no scale shows in them
BESIDE = 6  # constants with an effect that are weighed; chosen by hand, for time
ALIKE = 3.0  # log evidence by which a factor must lead another to be told from it: odds of 20; chosen by hand
REFITTED = 4  # faults, alone and with an effect, that are weighed as answers; chosen by hand, for time


@dataclass(frozen=True)
class _Looked:
    """A fault around its own refit: log evidence alone, and with the effect that suits it best."""

    fault: Fault
    alone: float
    beside: float
    effect: str

    @property
    def best(self) -> float:
        return max(self.alone, self.beside)


def table_answers(ranker: Ranker) -> list[Hypothesis]:
    """The likeliest faults alone, and each with its likeliest effect, refitted."""
    looked: dict[str, list[_Looked]] = {}
    for fault in ranker.possible:
        one = _look(ranker, fault)
        if one is not None:
            looked.setdefault(fault.name, []).append(one)
    likeliest = {name: _likeliest(each) for name, each in looked.items()}
    ranker.faults = {name: one.fault for name, one in likeliest.items()}
    ranker.effects |= ranker.faults
    ranked = sorted(likeliest.values(), key=lambda one: -one.alone)
    found = [ranker.weighed((one.fault.name,)) for one in ranked[:REFITTED]]
    ranked = sorted(likeliest.values(), key=lambda one: -one.beside)
    return found + [ranker.weighed((one.fault.name, one.effect)) for one in ranked[:REFITTED] if one.effect]


def _likeliest(looked: Sequence[_Looked]) -> _Looked:
    """Of the factors of a column the likeliest; its title names those that the data cannot tell from it."""
    first, *others = sorted(looked, key=lambda one: -one.best)
    column = first.fault.column
    near = [one.fault for one in others if one.best > first.best - ALIKE]
    # a speed is not given in kilograms of force: such a factor is told only where no better one is
    alike = [one.title.removeprefix(f"{column} ") for one in near if one.cost < UNUSUAL or first.fault.cost >= UNUSUAL]
    title = " or ".join([first.fault.title, *alike])
    return replace(first, fault=replace(first.fault, title=title))


def beside_constants(ranker: Ranker) -> list[Hypothesis]:
    """Each stated constant that may be wrong, with the effect that suits it best, refitted; the likeliest of them."""
    promised: list[tuple[float, tuple[str, str]]] = []
    for name in ranker.suspects:
        fit = ranker.fit((name,))
        if ranker.sound(fit, (name,)):
            logs = by_effect(ranker.beyond(fit), [s for s in ranker.flat if s.effect not in ranker.suspects])
            promised += [(value, (name, effect)) for effect, value in logs.items()]
    promised.sort(key=lambda one: -one[0])
    return [ranker.weighed(names) for _, names in promised[:BESIDE]]


def _look(ranker: Ranker, fault: Fault) -> _Looked | None:
    """The fault around its own refit; None where the model gives no number then, or nothing reads the column."""
    faulty, present = ranker.model.having(fault), ranker.analysis.fit
    bound = faulty.bind(ranker.case.inputs, ranker.rows)
    if np.array_equal(bound.predict(present.theta), predict(present, ranker.rows)):
        fit, beyond = replace(present, bound=bound), ranker.evidence  # only effects may read it
        shapes = _shapes(ranker, fault, fit, others=False)
    else:
        train = faulty.bind(ranker.case.inputs, ranker.case.train)
        fit = extend(present, fault.name, train, ranker.train, ranker.sigma, [ranker.model.start])
        if not np.isfinite(predict(fit, ranker.rows)).all() or (fault.late and not _in_most_runs(ranker, present, fit)):
            return None
        beyond = ranker.beyond(fit)
        if not np.isfinite(beyond.total).all() or not np.isfinite(beyond.nothing):  # no longer a fit at all
            return None
        shapes = _shapes(ranker, fault, fit, others=True)
    averages, alone = by_effect(beyond, shapes), beyond.nothing - fault.cost
    if not averages:
        return None if beyond is ranker.evidence else _Looked(fault, alone, -np.inf, "")
    name = max(averages, key=lambda n: averages[n])
    return _Looked(fault, alone, averages[name] - fault.cost, name)


def _in_most_runs(ranker: Ranker, before: Fit, after: Fit) -> bool:
    gaps = [measured(ranker.model, ranker.rows) - predict(fit, ranker.rows) for fit in (before, after)]
    return in_most_runs(ranker.case.run[ranker.rows], *(gap / ranker.sigma[:, None] for gap in gaps))


def _shapes(ranker: Ranker, fault: Fault, fit: Fit, others: bool) -> list[Shape]:
    """Columns of the catalogue; of effects that read the column at fault, those on the changed table. `others`:
    also of effects that do not."""
    name = formula_name(fault.column)
    found: list[Shape] = []
    for effect, shapes in ranker.shapes.items():
        whole = ranker.effects[effect]
        reads = name in parse(whole.expression).names
        if reads and fault.factor != 1.0 and whole.bases == MECHANICS:
            continue
        if fault.column not in ranker.model.channels and reads:
            found += shapes_of(fit.model, fit.theta, whole, ranker.rows, ranker.sigma)
        elif others:
            found += shapes
    return found
