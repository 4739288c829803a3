"""Short expressions for an effect that no catalogue has: one shape in one column, times a factor beside it.

Every expression is `k * shape * factor` on one target (vocabulary.py). k carries whatever unit makes it
sound, so no expression mixes units, and shapes that need a scale (exp, tanh, a threshold) get a parameter with the
column's unit. The library is listed in full and judged by its evidence; longer expressions start with a smaller prior
probability, so the answer is as short as the measurements allow. expression_answers.py makes sums of expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.expression import Expression, parse
from terrapin_tools.workbench.bases import ROLES, formula_name, free_name
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.formulas.periods import waves
from terrapin_tools.workbench.formulas.vocabulary import LOWEST, Scale, Term, factors, product_text, shapes, targets
from terrapin_tools.workbench.model.effect_columns import DUPLICATE, acting
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.covariance import orthonormal
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["FOUND", "SCALE_COST", "Library", "Sketch", "as_effect", "library", "read_by", "readable"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]
Factor = tuple[str, float, bool]  # formula, prior factor, whether it stands beside a step, too

# Squared distance of two predictions [noise sd], beyond what parameters take up, that nobody can see; chosen by hand.
UNSEEN = 2.0
COLUMNS = 24  # columns of the data that are looked at, roles first; chosen by hand, for time
LIMIT = 6000  # expressions; chosen by hand, for time and memory
WEIGHED = 300  # of them in every kind of noise; chosen by hand, for time
SAME = 0.9999  # correlation, beyond what the model can absorb, above which two expressions are one; chosen by hand
# Of a shape or factor: sd over mean below which the column that it depends on hardly varies. By hand.
HARDLY = 0.15
TOGETHER = 2  # columns that do the same of which an expression is kept beside that of the likeliest; by hand
BLOCK = 256  # expressions that are compared at once
AT_ONCE = 48  # columns that a body over time carries along at once
PROJECTIONS = 64  # in which two columns of correlation SAME have
NEAR = 0.999  # less than this with a probability below 1e-12
# The same as LOWEST where a state's motion is known without noise, and a bend close to its end shows; chosen by hand.
LOWEST_OF_STATES = 0.1
UNMAPPED_COST = 0.5  # prior factor of a column that the case does not map; chosen by hand
IDLE_COST = 0.05  # of one that hardly varies, too: a room's temperature stands for a constant; chosen by hand
FOUND = "the measurements themselves: valid inside their range only"  # source of an expression
SCALE_COST = 1.5  # log evidence taken off a refit for each scale that it could choose; chosen by hand


@dataclass(frozen=True)
class Sketch:
    """One expression: `k * shape * modulator` on `target`; `scales` are the parameters of its shape."""

    text: str
    target: str
    column: str  # the column whose shape it is, as the file or the role has it
    scales: Mapping[str, Scale]
    prior: float
    size: str = "k"  # the name of its size


@dataclass(frozen=True)
class Library:
    """Sketches with their columns (channels * rows, count), scaled to rms 1 in noise sd, priors summing to 1."""

    sketches: tuple[Sketch, ...]
    columns: Array
    scales: Array  # k = coefficient * scale

    def promise(self, evidence: Evidence) -> Array:
        """Log evidence of each sketch with its prior (count,).

        Of a long list all are weighed in two kinds of noise, and those that lead there in every kind: each correlation
        is a filter over all columns.
        """
        prior = np.log([sketch.prior for sketch in self.sketches])
        if len(self.sketches) <= WEIGHED:
            return np.asarray(evidence.single(self.columns) + prior)
        found = evidence.of_few().single(self.columns) + prior
        leading = np.argsort(-found, kind="stable")[:WEIGHED]
        found[leading] = evidence.single(self.columns[:, leading]) + prior[leading]
        return np.asarray(found)


def library(
    model: Model,
    theta: Array,
    rows: Mask,
    sigma: Array,
    known: Array,
    base: Array,
    misfit: float = np.inf,
    zeros: Array | None = None,
    left: Array | None = None,
) -> Library:
    """Every sketch of a case that differs from what the model and the catalogue can already say.

    Parameters
    ----------
    theta : (parameters,), the fitted values of the model.
    rows : (all rows,), mask of the case's rows.
    sigma : (channels,), noise sd in the channels' units.
    known : (channels * rows, K), columns of the catalogue, in noise sd.
    base : (channels * rows, P), derivatives of the model's prediction, in noise sd.
    misfit : sum of squares, in noise sd, that an expression may explain. Of a sketch that would be as good without a
        column that hardly varies only the shorter one is listed.
    zeros : (channels * rows, Z), the same of columns whose zero point may be wrong: what a plain constant does, too,
        which is listed all the same.
    left : (channels, rows), what the model leaves, in noise sd, in which waves are looked for; None: they are not.
    """
    case = model.case
    values, own, lowest = readable(model, theta, rows)
    units = {name: case.units.get(name) or _role_unit(name) for name in values}
    free = case.base.own_names and case.dynamics is None
    terms = {name: shapes(name, v, units[name], case.inputs, lowest, free) for name, v in values.items()}
    if left is not None and case.dynamics is None:
        for name, v in values.items():
            terms[name] += waves(name, v, units[name], left, case.inputs)
    drawn = _Drawn(case, int(rows.sum()), values, {**terms, "": [Term("", {}, 1.0)]}, own)
    for target, prior in targets(case):
        if (target not in case.base.parameters or case.parameters.get(target, 1.0)) and len(drawn.sketches) <= LIMIT:
            drawn.add(target, prior, acting(model, theta, target, rows, sigma))
    none = known[:, :0]
    return drawn.kept(orthonormal(base), known, none if zeros is None else zeros, misfit)


def readable(model: Model, theta: Array, rows: Mask) -> tuple[dict[str, Array], set[str], float]:
    """Columns that formulas may read, roles first; the names that the model knows; and the lowest threshold."""
    case = model.case
    inputs = {name: values[rows] for name, values in case.inputs.items()}
    own, lowest = {formula_name(role) for role in case.roles}, LOWEST
    if case.dynamics is not None:  # its own states, and what drives them; no clock
        states = model.bind(case.inputs, rows).motion(theta)
        inputs = {**states, **{name: values for name, values in inputs.items() if name not in ("time", *states)}}
        own |= states.keys()
        lowest = LOWEST_OF_STATES
    ordered = sorted(inputs, key=lambda name: (name not in own, list(inputs).index(name)))
    usable = [n for n in ordered if np.ptp(inputs[n]) > 1e-9 * max(1e-300, float(np.abs(inputs[n]).max()))][:COLUMNS]
    return {name: inputs[name] for name in usable}, own, lowest


Place = tuple[str, str, int, str]  # of a sketch: its target, column, the number of its shape, and its factor


class _Drawn:
    """Every sketch of a case with its column, and what it would be without a column that hardly varies."""

    def __init__(
        self, case: Case, rows: int, values: Mapping[str, Array], terms: Mapping[str, Sequence[Term]], own: set[str]
    ) -> None:
        """`own`: names of the columns that the model knows."""
        self.case, self.values, self.terms, self.own = case, values, terms, own
        self.features = {
            (name, i): parse(term.text).evaluate({**values, **term.starts}) if name else np.ones(rows)
            for name, listed in terms.items()
            for i, term in enumerate(listed)
        }
        self.size = free_name("k", {*case.inputs, *(case.fit if case.base.own_names else ())})
        self.simply = {*case.fit, *(case.base.further if case.base.own_names else ())}
        self.sketches: list[Sketch] = []
        self.columns: list[Array] = []
        self.scales: list[float] = []
        self.places: dict[Place, int] = {}
        self.shorter: dict[int, list[Place]] = {}  # by the number of a sketch

    def add(self, target: str, prior: float, act: Callable[[Array], Array]) -> None:
        """The sketches on one target; `act`: of shapes (count, rows), what they do there in noise sd."""
        products = list(self._products(target))
        for begin in range(0, len(products), AT_ONCE):
            some = products[begin : begin + AT_ONCE]
            changes = act(np.array([self.features[name, i] * numbers for name, i, _, numbers in some]))
            for (name, i, (factor, cost, _), numbers), change in zip(some, changes, strict=True):
                size = float(np.sqrt((change * change).mean(axis=1).max()))
                if not np.isfinite(size) or size == 0.0:
                    continue
                self.places[target, name, i, factor] = len(self.sketches)
                if name and _hardly(self.features[name, i]):
                    self.shorter[len(self.sketches)] = [(target, "", 0, factor), (target, factor, 0, "")]
                elif factor and _hardly(numbers):
                    self.shorter[len(self.sketches)] = [(target, name, i, "")]
                term = self.terms[name][i]
                text, column = product_text(self.size, term.text, factor), {"pass_": "pass"}.get(name, name)
                share = prior * term.prior * cost * self._of_column(name)
                self.sketches.append(Sketch(text, target, column, term.scales, share, self.size))
                self.columns.append((change / size).reshape(-1))
                self.scales.append(1.0 / size)

    def _products(self, target: str) -> Iterator[tuple[str, int, Factor, Array | float]]:
        """Column, number of the shape, factor beside it and its numbers; how a formula, or a parameter in it, goes with
        a column is simple or unknown."""
        for name, listed in self.terms.items():
            beside = [
                (one, parse(one[0]).evaluate(self.values) if one[0] else 1.0)
                for one in factors(self.case, target, name, self.values)
            ]
            about = target in self.simply and any(term.centred for term in listed)
            for i, term in enumerate(listed):
                if term.centred != (about and (term.centred or term.text == name)):
                    continue
                if not (term.scales and target in self.simply):
                    yield from ((name, i, one, numbers) for one, numbers in beside if term.plain or one[2])

    def _of_column(self, name: str) -> float:
        """Prior factor of a column."""
        if name in self.own or not name:
            return 1.0
        return IDLE_COST if _hardly(self.values[name]) else UNMAPPED_COST

    def kept(self, basis: Array, known: Array, zeros: Array, misfit: float) -> Library:
        """Those that differ from the basis, from `known` and `zeros` (columns as in `library`), and from each other."""
        if not self.sketches:
            return Library((), known[:, :0], np.zeros(0))
        stacked = np.array(self.columns).T
        shorter = self.shorter.items()
        instead = {i: self.places[key] for i, keys in shorter for key in keys[::-1] if key in self.places}
        idle = _unseen(stacked, basis, instead, misfit)
        reads = [read_by(s, self.values) for s in self.sketches]
        taken = _like_any(stacked, basis, _beyond(known, basis))
        taken |= _like_any(stacked, basis, _beyond(zeros, basis)) & np.array([bool(read) for read in reads])
        distinct = _distinct(stacked, basis, taken, np.array([s.prior for s in self.sketches]), reads)
        keep = [i for i in distinct if i not in idle]
        total = sum(self.sketches[i].prior for i in keep)
        final = tuple(replace(self.sketches[i], prior=self.sketches[i].prior / total) for i in keep)
        return Library(final, stacked[:, keep], np.array(self.scales)[keep])


def _role_unit(name: str) -> str:
    return ROLES.get({"pass_": "pass"}.get(name, name), "1")


def _hardly(values: Array | float) -> bool:
    """Whether a shape is nearly a constant on these rows."""
    return float(np.std(values)) < HARDLY * abs(float(np.mean(values)))


def _unseen(columns: Array, basis: Array, instead: Mapping[int, int], misfit: float) -> set[int]:
    """Of the columns, those that differ from another one by less than anybody could see, if they explained `misfit`."""
    found: set[int] = set()
    for one, other in instead.items():
        pair = columns[:, [one, other]]
        pair = pair - basis @ (basis.T @ pair)
        (own, cross), (_, square) = pair.T @ pair
        if misfit * (own * square - cross * cross) < UNSEEN * own * square:
            found.add(one)
    return found


def read_by(sketch: Sketch, columns: Collection[str]) -> frozenset[str]:
    """Columns of the data that a sketch reads."""
    return parse(sketch.text).names & frozenset(columns)


def _beyond(columns: Array, basis: Array) -> Array:
    """What columns (channels * rows, count) have beside the basis, of length 1; without those that have nothing."""
    found = columns - basis @ (basis.T @ columns)
    norms = np.sqrt((found * found).sum(axis=0))
    return np.asarray(found[:, norms > 0] / norms[norms > 0])


def _like_any(columns: Array, basis: Array, known: Array) -> Mask:
    """Which columns (channels * rows, count) do what one of `known` (channels * rows, K), of length 1, does."""
    if not known.shape[1]:
        return np.zeros(columns.shape[1], dtype=bool)
    rows, inside = columns.T, (basis.T @ columns).T
    length = np.sqrt(np.maximum(np.einsum("ij,ij->i", rows, rows) - np.einsum("ij,ij->i", inside, inside), 0.0))
    return np.asarray(np.abs(rows @ known - inside @ (basis.T @ known)).max(axis=1) >= DUPLICATE * length)


def _distinct(columns: Array, basis: Array, taken: Mask, prior: Array, reads: Sequence[frozenset[str]]) -> list[int]:
    """Indices of columns that neither the model nor the catalogue (`taken`) nor a likelier sketch already has.

    `reads`: of each the columns of the data in it. Where two that have none in common go together, both are kept:
    nobody can tell them apart, and an answer that names one of them has to say so.
    """
    # products of what is left beside the basis are those of the columns less those inside it: no copy of a long table
    rows, inside = columns.T, (basis.T @ columns).T
    before = np.einsum("ij,ij->i", rows, rows)
    after = before - np.einsum("ij,ij->i", inside, inside)
    visible = after > 1e-6 * before
    length = np.sqrt(np.where(visible, after, 1.0))
    visible &= ~taken

    def alike(one: Index, other: Index) -> Mask:
        found = rows[one] @ rows[other].T - inside[one] @ inside[other].T
        return np.asarray(np.abs(found) > SAME * np.outer(length[one], length[other]))

    order = np.argsort(-prior, kind="stable")
    order = order[visible[order]]
    kept: list[int] = []
    # columns alike are alike in a few random projections too: only pairs that are there are compared in full
    random = np.random.default_rng(PROJECTIONS).standard_normal((PROJECTIONS, columns.shape[0]))
    projections = (random @ columns - (random @ basis) @ inside.T) / length
    projections /= np.maximum(np.sqrt((projections * projections).sum(axis=0)), 1e-300)
    for begin in range(0, len(order), BLOCK):
        block = order[begin : begin + BLOCK]
        near = np.abs(projections[:, kept].T @ projections[:, block]) > NEAR
        own = alike(block, block)
        earlier = np.array(kept, dtype=np.int64)
        chosen: list[int] = []
        for place in range(len(block)):
            mine = reads[block[place]]
            likely = earlier[near[:, place]]
            same = likely[alike(likely, block[place : place + 1])[:, 0]].tolist() if likely.size else []
            same += [int(block[other]) for other in chosen if own[place, other]]
            if len(same) <= TOGETHER and all(mine and reads[one] and mine.isdisjoint(reads[one]) for one in same):
                chosen.append(place)
        kept += block[chosen].tolist()
    return kept


def as_effect(sketch: Sketch, case: Case, name: str) -> Effect:
    """A sketch as an effect that a model can take: k free from 0, scales positive with further starts around them."""
    expression: Expression = parse(sketch.text)
    parameters = [Parameter(sketch.size, _unit(sketch, case), 0.0, meaning="size")]
    parameters += [_scale_parameter(*one) for one in sketch.scales.items()]
    return Effect(
        name=name,
        title="expression found in the data",
        equation=expression.to_latex(),
        source=FOUND,
        bases=(case.base.name,),
        parameters=tuple(parameters),
        needs=(),
        expression=sketch.text,
        target=sketch.target,
    )


def _scale_parameter(name: str, scale: Scale) -> Parameter:
    """A scale or threshold stays where the data can see it: outside, every shape is a straight line."""
    starts = (*(scale.grid or (scale.start / 2.0, scale.start * 2.0)), scale.start)
    grid = tuple(v for v in dict.fromkeys(starts) if scale.low <= v <= scale.high)
    return Parameter(name, scale.unit, scale.start, scale.low, scale.high, "scale of the shape", grid=grid)


def _unit(sketch: Sketch, case: Case) -> str:
    """The unit of k that makes the expression sound on its target; "1" where a column's unit is not known."""
    from terrapin_hil.units import units as registry

    known = {formula_name(role): unit for role, unit in ROLES.items()} if not case.base.own_names else {}
    known.update({formula_name(name): unit for name, unit in case.units.items()})
    known.update({name: scale.unit for name, scale in sketch.scales.items()})
    known[sketch.size] = "1"
    acts_on = {"resistance": "N m", "drag": "N", "axle": "N"}.get(sketch.target, case.units.get(sketch.target, "1"))
    shape = parse(sketch.text)
    if not shape.names <= set(known):
        return "1"
    try:
        given = shape.unit(known)
        unit = registry().Unit(acts_on.replace("^", "**") if acts_on != "1" else "dimensionless") / given
    except (ValueError, KeyError):
        return "1"
    return f"{unit:~C}".replace("**", "^") or "1"
