"""Hypotheses fitted and weighed one at a time: what the ranking asks of the data."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import factorial

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect
from terrapin_tools.workbench.case.instruments import INSTRUMENTS, ZERO
from terrapin_tools.workbench.compare.comparison import Analysis, free_slopes, measured
from terrapin_tools.workbench.formulas.expressions import FOUND, SCALE_COST, Library, Sketch, as_effect
from terrapin_tools.workbench.model.constants import constants, error_tax
from terrapin_tools.workbench.model.data_columns import candidates, is_phase
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.model.fitting import Fit, extend, fit_model
from terrapin_tools.workbench.model.linearised import bounds, following, linearise
from terrapin_tools.workbench.model.model import Bound, Model
from terrapin_tools.workbench.model.priors import SIZE_OF_SET, of_terms
from terrapin_tools.workbench.model.table_faults import Fault, faults, faults_over_time
from terrapin_tools.workbench.model.usual_sizes import size_tax
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["WITHIN", "Found", "Hypothesis", "Ranker", "by_effect"]

WITHIN = 12.0  # log weight behind the best beyond which nothing is refitted: a posterior of 6e-6; chosen by hand


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects that may be missing, with its log of evidence times prior.

    `kind` is nothing, catalogue, expression, mixed (catalogued effects and an expression), unknown (a curve of a column
    that has no formula), part (a set, and such a curve beside it), or that of a mishap.
    """

    effects: tuple[str, ...]
    kind: str
    log_weight: float
    fit: Fit | None = None
    column: str = ""  # of an expression or a curve; of a mishap: its run
    taxed: float = 0.0  # what the log weight has lost to sizes that are unlikely

    @property
    def parameters(self) -> int:
        """Number of fitted ones."""
        return len(self.fit.theta) if self.fit is not None else 0


# What a set of effects says, expressions as they act, with the value of each fitted parameter.
Found = Mapping[frozenset[str], Mapping[tuple[str, str], float]]


class Ranker:
    def __init__(self, analysis: Analysis, report: Callable[[str], None], before: Found | None = None) -> None:
        """`before`: fits over time of the same case, but for a few of its rows: the same sets start there."""
        self.analysis, self.report, self.before = analysis, report, before or {}
        self.case, self.model, self.rows = analysis.case, analysis.model, analysis.rows
        self.sigma = analysis.noise.sigma
        self.behind = analysis.noise.behind
        whole = ~analysis.noise.known
        self.runs = Runs(self.case.run[self.rows], len(self.model.channels), analysis.prediction, analysis.felt, whole)
        self.values = measured(self.model, self.rows)
        self.train = measured(self.model, self.case.train)
        self.effects: dict[str, Effect] = {effect.name: effect for effect in candidates(self.model)}
        # a zero point or a delay is a matter of instruments, as likely as a constant that is off
        instruments = (e for e in self.effects.values() if e.name.startswith(ZERO) or e.transform in INSTRUMENTS)
        self.suspects = {effect.name: effect for effect in instruments}
        self.catalogue = len(self.effects) - len(self.suspects)
        self.suspects |= {effect.name: effect for effect in constants(self.model)}
        self.effects |= self.suspects
        self.faults: dict[str, Fault] = {}  # the likeliest of each name, once they were looked at
        self.possible = self._possible()
        self.shapes = analysis.shapes
        self.flat = [shape for shapes in self.shapes.values() for shape in shapes]
        self.columns = self.columns_without(())
        self.listed = Library((), np.zeros((self.values.size, 0)), np.zeros(0))
        self.promised = np.zeros(0)  # log evidence and prior of each that is listed, around the present fit
        self.sketches: dict[str, Sketch] = {}  # by the name that each got as an effect
        self.together: dict[tuple[str, ...], list[tuple[str, Array]]] = {}  # start values of a pair's parameters
        self.razor: dict[frozenset[str], float] = {}  # log evidence lost by the choice of shapes
        self.fits: dict[frozenset[str], Fit] = {frozenset(): analysis.fit}
        slopes = free_slopes(analysis.fit, self.sigma, self.rows, released=True)[2]
        self.base = self._widened(slopes / self.sigma[:, None, None])
        residual = analysis.residual / self.sigma[:, None]
        # what an answer may explain: the squares beyond those of noise, which may be few by chance
        self.misfit = max(float((residual * residual).sum()) - residual.size, float(np.sqrt(2.0 * residual.size)))
        self.nodes = Evidence(self.runs, residual, self.base, self.behind, analysis.noise.kinds).among(self.columns)
        at = bounds(analysis.fit)[following(analysis.fit)]
        self.evidence = Evidence(self.runs, residual, self.base, self.behind, self.nodes, at)

    def _possible(self) -> list[Fault]:
        if not self.case.base.whole_runs or not self.analysis.missing:
            return faults(self.case)

        def misfit(fault: Fault | None) -> float:
            return self.of_one_run(self.model if fault is None else self.model.having(fault), self.model.start)

        return faults_over_time(self.case, misfit)

    def of_one_run(self, model: Model, start: Array) -> float:
        """Misfit of a model on the longest run, which tells a unit in a fair time: of the user's own equations after a
        fit; of a body, whose fit takes long, at its start."""
        train = self.case.train
        one = train & (self.case.run == np.bincount(self.case.run[train]).argmax())
        bound, values = model.bind(self.case.inputs, one), measured(self.model, one)
        if self.case.dynamics is None:
            gap = (values - bound.predict(start)) / self.sigma[:, None]
            cost = float((gap * gap).sum())
        else:
            cost = fit_model(bound, values, self.sigma, [start]).cost
        return cost if np.isfinite(cost) else np.inf

    def _widened(self, slopes: Array) -> Array:
        return np.concatenate([slopes, self.analysis.nuisance], axis=-1)

    def columns_without(self, effects: Collection[str]) -> Array:
        """The shapes of the catalogue but these effects', (channels * rows, columns)."""
        kept = [shape.columns for shape in self.flat if shape.effect not in effects]
        return np.concatenate([np.zeros((self.values.size, 0)), *kept], axis=1)

    # -- linear, around the present fit ------------------------------------------------------------------------------

    def screen(self) -> dict[tuple[str, ...], float]:
        """Log evidence of every single and pair of effects, averaged over their shapes."""
        width = [shape.columns.shape[1] for shape in self.flat]
        edges = np.concatenate([[0], np.cumsum(width)]).astype(int)
        if not self.flat:
            return {}
        gram = self.evidence.gram(self.columns)
        index: dict[str, list[int]] = {}
        for i, shape in enumerate(self.flat):
            index.setdefault(shape.effect, []).append(i)
        jobs: dict[tuple[int, ...], list[tuple[tuple[str, ...], tuple[int, ...]]]] = {}
        for count in (1, 2):
            for names in combinations(index, count):
                if count > 1 and not self.together_possible(names):
                    continue
                if count > 1 and any(name in self.suspects for name in names):
                    continue  # beside others, a suspect is looked at next to the best answers
                for picked in product(*(index[name] for name in names)):
                    jobs.setdefault(tuple(width[i] for i in picked), []).append((names, picked))
        found: dict[tuple[str, ...], list[float]] = {}
        highest: dict[tuple[str, ...], float] = {}
        at = int(np.argmax(self.evidence.posterior))
        for widths, entries in sorted(jobs.items()):
            size = sum(widths)
            picks = np.array([[c for i in p for c in range(edges[i], edges[i + 1])] for _, p in entries])
            signs = np.array([[_sign(self.flat[i]) for i in p for _ in range(width[i])] for _, p in entries], float)
            if widths == (1, 1):
                logs = self.evidence.pairs(gram, picks[:, 0], picks[:, 1], signs)
            else:
                logs = self.evidence.blocks(gram, picks, signs)
            for (names, picked), columns, value in zip(entries, picks, logs, strict=True):
                found.setdefault(names, []).append(float(value))
                if len(names) > 1 and value > highest.get(names, -np.inf):
                    highest[names] = float(value)
                    products = gram.products[at][np.ix_(columns, columns)] + 1e-6 * np.eye(size)
                    solved = np.linalg.solve(products, gram.scores[at][columns])
                    self.together[names] = [
                        self._start(self.flat[i], solved[(columns >= edges[i]) & (columns < edges[i + 1])])
                        for i in picked
                    ]
        average = {names: float(logsumexp(logs) - np.log(len(logs))) for names, logs in found.items()}
        self.razor = {frozenset(names): average[names] - max(logs) for names, logs in found.items()}
        return average

    def _start(self, shape: Shape, coefficients: Array) -> tuple[str, Array]:
        """The effect's parameters at a shape and these coefficients of its columns."""
        values = list(shape.values)
        size = float(np.clip(coefficients[0], shape.lower, shape.upper))
        if len(coefficients) == 2:  # sine and cosine
            size = float(np.hypot(*coefficients))
            wave = next(i for i, p in enumerate(self.effects[shape.effect].parameters[1:]) if is_phase(p))
            values[wave] = float(np.arctan2(coefficients[1], coefficients[0]))
        return shape.effect, np.array([size * shape.scale, *values])

    # -- refits ------------------------------------------------------------------------------------------------------

    def expression(self, sketch: Sketch) -> str:
        """The name of a sketch as an effect; the same sketch always has the same. Over time, where a refit takes long,
        so has the same formula: starts of its scale are tried in the refit."""
        for name, known in self.sketches.items():
            one = self.case.base.whole_runs and (known.target, known.text) == (sketch.target, sketch.text)
            if known is sketch or one:
                return name
        number = 1
        while (name := f"expression_{number}") in self.effects or name in self.case.library:
            number += 1
        self.sketches[name], self.effects[name] = sketch, as_effect(sketch, self.case, name)
        return name

    def fit(self, names: tuple[str, ...]) -> Fit:
        """The present model with more effects, fitted on the training runs, warm-started at its parent."""
        key = frozenset(names)
        if key not in self.fits:
            names = tuple(sorted(names, key=lambda name: name not in self.faults))  # around them all else is fitted
            parent = self.fit(names[:-1])
            effect = self.effects[names[-1]]
            bound = parent.model.having(effect).bind(self.case.inputs, self.case.train)
            present = [e.name for e in parent.model.effects if e.name in key]
            linear = dict(self.together.get(names) or self.together.get(names[::-1]) or ())
            own = [linear[name] for name in (*present, names[-1])] if linear else []
            starts = [np.concatenate([self.analysis.fit.theta, *own])] if linear else []
            if effect.name in self.faults:
                starts = [parent.model.start]
            elif self.case.dynamics is not None and not {f.key for f in self.model.fitted}.isdisjoint(parent.at_bound):
                starts.append(self._as_stated(parent, bound.model.start))
            # where each step is a simulation of all runs, what cannot come near is not followed to its end
            aim = min(fit.cost for fit in self.fits.values()) if self.case.base.whole_runs else np.inf
            again = self._again(bound, parent, aim)
            self.fits[key] = again or extend(parent, effect.name, bound, self.train, self.sigma, starts, aim)
        return self.fits[key]

    def _again(self, bound: Bound, parent: Fit, aim: float) -> Fit | None:
        """The fit from where the same set ended before, unless that is none any more."""
        values = self.before.get(frozenset(map(_says, bound.model.effects)))
        if values is None:
            return None
        start = np.array([values[key] for key in _keys(bound.model)])
        fit = fit_model(bound, self.train, self.sigma, [start], aim)
        return fit if fit.cost <= parent.cost else None

    def found(self) -> Found:
        """The fits, for a search on hardly other rows; none where a fit takes no time, or may end elsewhere."""
        if not self.case.base.whole_runs or self.case.base.own_dynamics:
            return {}
        fits = [fit for names, fit in self.fits.items() if names]
        return {
            frozenset(map(_says, fit.model.effects)): dict(zip(_keys(fit.model), fit.theta.tolist(), strict=True))
            for fit in fits
        }

    def _as_stated(self, parent: Fit, start: Array) -> Array:
        """Start values of equations of the user's own beside one more term: a parameter that a lacking term drove to
        its bound may not come back from there."""
        own = len(self.model.fitted)
        return np.concatenate([self.model.start, parent.theta[own:], start[len(parent.theta) :]])

    def around(self, fit: Fit, names: Collection[str]) -> float | None:
        """Log evidence of a refitted set, its shapes as fitted; None when a size is 0 and nothing can be told."""
        try:
            linear = linearise(
                fit,
                [e.name for e in fit.model.effects if e.name in names],
                self.values,
                self.rows,
                self.sigma,
            )
        except ValueError:
            return None
        base = self._widened(linear.base)
        evidence = Evidence(self.runs, linear.residual, base, self.behind, self.nodes, linear.bounds)
        if not linear.columns.shape[1]:
            return evidence.nothing - linear.lost
        picks = np.arange(linear.columns.shape[1])[None, :]
        logs = evidence.blocks(evidence.gram(linear.columns), picks, linear.signs[None, :], linear.offset)
        return float(logs[0]) - linear.lost if np.isfinite(logs[0]) else None

    def together_possible(self, names: Sequence[str]) -> bool:
        """Whether no two of the effects are one law in two forms (dry friction, smooth or with stiction)."""
        laws = [(law, self.effects[name].target) for name in names for law in self.effects[name].laws]
        return len(laws) == len(set(laws))

    @property
    def kinds(self) -> list[str]:
        """Of terms beside formulas, those that this case has."""
        count = {"catalogue": self.catalogue, "constant": len(self.suspects), "fault": len(self.possible)}
        return [kind for kind, number in count.items() if number]

    def log_prior(self, names: Collection[str]) -> float:
        """Of a set of effects and expressions."""
        share = of_terms(self.kinds)
        each = [
            share["formula"] * self.sketches[name].prior
            if name in self.sketches
            else share["constant"] / len(self.suspects)
            if name in self.suspects
            else share["fault"] / len(self.possible)
            if name in self.faults
            else share["catalogue"] / self.catalogue
            for name in names
        ]
        count = min(len(each), len(SIZE_OF_SET) - 1)
        return float(np.log(SIZE_OF_SET[count]) + np.log(factorial(len(each))) + np.log(each).sum())

    def lost(self, names: Collection[str]) -> float:
        """Log evidence that the choice of shapes costs: the average over them against the one that is fitted."""
        listed = frozenset(name for name in names if name not in self.sketches)
        own = self.razor.get(listed)
        razor = sum(self.razor.get(frozenset([name]), 0.0) for name in listed) if own is None else own
        return razor - SCALE_COST * sum(len(self.sketches[name].scales) for name in names if name in self.sketches)

    def weighed(self, names: tuple[str, ...], otherwise: float = -np.inf) -> Hypothesis:
        """A set, refitted; its log weight is that of the evidence `otherwise` where the refit leaves nothing of it."""
        fit = self.fit(names)
        value = self.around(fit, names)
        total = otherwise if value is None else value + self.lost(names) - error_tax(fit, names)
        total -= sum(self.faults[name].cost for name in names if name in self.faults)
        taxed = size_tax(fit, names)
        own = [name in self.sketches for name in names]
        kind = "expression" if all(own) else "mixed" if any(own) else "catalogue"
        column = next((self.sketches[name].column for name in names if name in self.sketches), "")
        return Hypothesis(names, kind, total + self.log_prior(names) - taxed, fit, column, taxed)

    def sound(self, fit: Fit, names: Collection[str]) -> bool:
        """Whether the effects have a size and no absurd influence on any row: else nothing can be built on the fit."""
        try:
            linearise(fit, list(names), self.values, self.rows, self.sigma)
        except ValueError:
            return False
        return True

    def beyond(self, fit: Fit, without: Collection[str] = ()) -> Evidence:
        """Evidence around a fit with all of its parameters free: what could still be added to it, or stand in the place
        of the effects `without`, whose contributions the residual then holds."""
        bound = fit.model.bind(self.case.inputs, self.rows)
        prediction, slopes = bound.jacobian(fit.theta)
        free = np.array([f.effect not in without for f in fit.model.fitted], dtype=bool)
        # beside another effect, a parameter of the user's own equations may leave the bound that this one drove it to
        free &= following(fit) | bool(without and self.case.dynamics is not None)
        if without:
            at = [next(i for i, f in enumerate(fit.model.fitted) if f.effect == name) for name in without]
            absent = fit.theta.copy()
            absent[at] = np.clip(0.0, fit.model.lower[at], fit.model.upper[at])
            if self.case.dynamics is not None:  # without it the motion is another one, along which no term is right
                prediction = prediction - slopes[..., at] @ (fit.theta[at] - absent[at])
            else:
                prediction = bound.predict(absent)
        residual = (self.values - prediction) / self.sigma[:, None]
        scaled = self._widened(slopes[..., free] / self.sigma[:, None, None])
        return Evidence(self.runs, residual, scaled, self.behind, self.nodes, bounds(fit)[free])

    def renamed(
        self, hypotheses: Sequence[Hypothesis]
    ) -> tuple[list[Hypothesis], dict[str, Effect], dict[str, Sketch]]:
        """The hypotheses with expressions numbered in their order, these effects by name, and what they come from."""
        order = list(dict.fromkeys(name for h in hypotheses for name in h.effects if name in self.sketches))
        free = (n for n in (f"expression_{i}" for i in range(1, 10_000)) if n not in self.case.library)
        names = dict(zip(order, free, strict=False))
        effects = {new: replace(self.effects[old], name=new) for old, new in names.items()}
        found = [
            replace(
                h,
                effects=tuple(names.get(name, name) for name in h.effects),
                fit=None if h.fit is None else _renamed(h.fit, names, effects),
            )
            for h in hypotheses
        ]
        return found, effects, {new: self.sketches[old] for old, new in names.items()}


def _says(effect: Effect) -> str:
    """An effect by its name, an expression that was found by what it does: names are given anew in each search."""
    return f"{effect.target}: {effect.expression}" if effect.source == FOUND else effect.name


def _keys(model: Model) -> list[tuple[str, str]]:
    """What each fitted parameter belongs to, as `_says` has it, and its name."""
    says = {e.name: _says(e) for e in model.effects}
    return [("", f.key) if f.effect is None else (says[f.effect], f.name) for f in model.fitted]


def by_effect(beyond: Evidence, shapes: Sequence[Shape]) -> dict[str, float]:
    """Log evidence of each effect that has single columns, averaged over them."""
    single = [s for s in shapes if s.columns.shape[1] == 1 and np.isfinite(s.columns).all()]
    if not single:
        return {}
    logs = beyond.single(np.concatenate([s.columns for s in single], axis=1))
    found: dict[str, list[float]] = {}
    for shape, value in zip(single, logs, strict=True):
        found.setdefault(shape.effect, []).append(float(value))
    averages = {name: float(logsumexp(v) - np.log(len(v))) for name, v in found.items()}
    return {name: value for name, value in averages.items() if np.isfinite(value)}


def _renamed(fit: Fit, names: Mapping[str, str], effects: Mapping[str, Effect]) -> Fit:
    def key(text: str) -> str:
        effect, dot, rest = text.partition(".")
        return names.get(effect, effect) + dot + rest

    model = fit.model
    fitted = tuple(
        f if f.effect is None else replace(f, key=key(f.key), effect=names.get(f.effect, f.effect))
        for f in model.fitted
    )
    own = tuple(effects.get(names.get(e.name, ""), e) for e in model.effects)
    renamed = replace(fit.bound, model=replace(model, effects=own, fitted=fitted))
    return replace(fit, bound=renamed, at_bound=tuple(key(name) for name in fit.at_bound))


def _sign(shape: Shape) -> float:
    if not shape.one_sided:
        return 0.0
    return 1.0 if shape.lower >= 0.0 else -1.0
