"""Base models of one shape on soft soil: load and slip of a row give entry angle, traction, torque and sinkage."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics import sphere
from terrapin_hil.physics.contact import THETA_MAX
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.bases.kinds.algebraic import Algebraic, Rows, Terms, Values
from terrapin_tools.workbench.bases.kinds.base import PARAMETER_COST, Problem, Quantity, Target

__all__ = ["SOIL", "Contact", "Solved"]

Flat = Callable[[str], Array]

PILED = ("bulldozing_resistance", "rut_resistance")  # what effects may name: R_c [N]; what a metre of rut adds [N/m]
DEPTH, SHALLOW, MOST_SLIP = "rut_depth", 1e-6, 0.95  # an effect's own parameter [m]; its least [m]
DRAG_COST = 0.5  # prior factor of an expression that acts as a drag
WORDS = {
    "traction": ("traction drawbar pull fx thrust dp", "sd std"),
    "torque": ("torque moment mdrive m t", "sd std"),
    "sinkage": ("sinkage depth z", "sd std"),
}
SOIL = {
    "n": Quantity("1", "1"),
    "cohesion": Quantity("Pa", "0 kPa"),
    "friction_angle": Quantity("rad", "35 deg"),
    "shear_modulus": Quantity("m", "15 mm"),
}


@dataclass(frozen=True)
class Solved:
    """What the soil does to a shell that it carries: traction [N], torque [N m], sinkage [m], each (sets, rows)."""

    traction: Array
    torque: Array
    sinkage: Array


@dataclass(frozen=True, kw_only=True)
class Contact(Algebraic):
    """A contact: `law` is the module of its physics, whose functions take slip, then `geometry`, then a soil.

    `soil` makes the law's Soil of columns by name; `inputs` are what the law's derivatives are by, in their order.
    `neutral` are values of what only effects change; `words` of a table's columns speak for this shape.
    """

    channels: Mapping[str, str] = field(default_factory=lambda: {"traction": "N", "torque": "N m", "sinkage": "m"})
    column_words: Mapping[str, tuple[str, str]] = field(default_factory=lambda: WORDS)
    needs: Mapping[str, str] = field(default_factory=lambda: {"slip": "", "load": "20 N"})
    options: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: {"stress": ("full", "linear")})
    forces: Mapping[str, str] = field(default_factory=lambda: {"drag": "N", "axle": "N"})
    provides: tuple[str, ...] = PILED
    of_soil: bool = True
    law: ModuleType
    geometry: tuple[str, ...]
    inputs: Sequence[str]
    soil: Callable[[Flat, Mapping[str, Array]], Any]
    neutral: Mapping[str, float]
    words: frozenset[str] = frozenset()

    def targets(self) -> list[Target]:
        soil = ("k_s", "cohesion", "friction_angle", "shear_modulus", "n", "c1", "c2")
        fits = [(name, PARAMETER_COST) for name in soil if name in self.parameters or name in self.further]
        return [*super().targets(), ("drag", DRAG_COST), *fits]

    def resembles(self, names: Collection[str | None], words: Collection[str]) -> int:
        alike = "slip" in names and not self.channels.keys().isdisjoint(names)
        return 1 + (not self.words.isdisjoint(words)) if alike else 0

    def prepare(self, values: Values) -> None:
        values.update(self.neutral)

    def outputs(self, values: Values, terms: Terms, solved: Solved) -> dict[str, Array]:
        """Channels of what was solved: a drag takes pull and torque (Li, Eq. 10), an axle loss pull alone."""
        drag = terms.sum("drag")
        return {
            "traction": solved.traction - drag - terms.sum("axle"),
            "torque": solved.torque - values["radius"] * drag,
            "sinkage": solved.sinkage,
        }

    def predictor(self, problem: Problem) -> ContactRows:
        return ContactRows(self, problem)


class ContactRows(Rows):
    """A contact on rows. Rows that agree in every input are computed once."""

    base: Contact

    def __init__(self, base: Contact, problem: Problem) -> None:
        super().__init__(base, problem)
        self.linear = problem.options.get("stress") == "linear"
        self.last: Array | None = None  # entry angles: a near start for the next solve
        self.inverse = np.zeros(problem.count, dtype=np.int64)
        if self.columns:
            distinct, inverse = np.unique(np.column_stack(list(self.columns.values())), axis=0, return_inverse=True)
            self.columns = dict(zip(self.columns, distinct.T, strict=True))
            self.inverse = inverse.reshape(-1)
        self.size = len(next(iter(self.columns.values()))) if self.columns else 1
        named = {effect.name: parse(effect.expression).names for effect in problem.effects}
        self.piles = any(not names.isdisjoint(PILED) for names in named.values())
        self.ruts = [name for name, names in named.items() if "rut_resistance" in names]

    def sets(self, sets: Array) -> Array:
        return self.solved(sets)[0][..., self.inverse]

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        """Prediction (channels, rows) and its derivatives (channels, rows, parameters).

        The entry angle is solved once, and how it follows the parameters comes from the implicit function theorem. The
        forces near it come from their exact derivatives, so a Jacobian costs one solve and one evaluation with
        derivatives, however many parameters there are; only what is cheap is differenced.
        """
        sets, step = self.moved(theta)
        entry = self.solved(theta[None, :])[1]
        moved = entry * (1.0 + self.step)
        entries = np.repeat(entry, len(theta) + 2, axis=0)
        entries[-1] = moved[0]
        values, _, vertical = self.solved(np.vstack([sets, theta]), entries)
        with np.errstate(all="ignore"):  # hopeless parameters have no derivatives; a fit turns away from them
            slopes = (values[1:-1] - values[0]) / step[:, None, None]
            along = (values[-1] - values[0]) / (moved[0] - entry[0])
            rise = (vertical[-1] - vertical[0]) / (moved[0] - entry[0])
            follow = (vertical[1:-1] - vertical[0]) / step[:, None]
            carried = (entry[0] < 0.999 * THETA_MAX) & (rise > 0)
            ratio = np.where(carried, follow / np.where(rise > 0, rise, 1.0), 0.0)
            slopes = slopes - along[None] * ratio[:, None, :]
        return values[0][..., self.inverse], np.moveaxis(slopes[..., self.inverse], 0, -1)

    def solved(self, sets: Array, entry: Array | None = None) -> tuple[Array, Array, Array]:
        """Channels (sets, channels, size), entry angles and vertical forces (sets, size), solved or at `entry`."""
        values, terms = self.state(sets)
        law, shape = self.base.law, (len(sets), self.size)

        def flat(name: str) -> Array:
            return np.broadcast_to(np.asarray(values[name], dtype=np.float64), shape).reshape(-1)

        ground = {name: flat(name) for name in ("cohesion", "friction_angle", "shear_modulus", "recovery")}
        soil = self.base.soil(flat, {"exponent": flat("n"), **ground})
        slip, sizes = flat("slip"), {name: flat(name) for name in self.base.geometry}
        geometry = list(sizes.values())
        if entry is None:
            start = None if self.last is None else np.broadcast_to(self.last, shape).reshape(-1)
            theta = law.entry_angle(flat("load"), slip, *geometry, soil, self.linear, start=start)
            forces = np.stack(law.forces(theta, slip, *geometry, soil, self.linear)).reshape(3, *shape)
            self.last = theta.reshape(shape)[:1].copy()
        else:
            theta = entry.reshape(-1)
            given = {"entry": theta, "slip": slip, "width": np.zeros_like(slip), **vars(soil)}
            given |= sizes
            one = {name: value[: self.size] for name, value in given.items()}
            first = type(soil)(**{name: one[name] for name in vars(soil)})
            at = law.slopes(one["entry"], one["slip"], *(one[name] for name in sizes), first, self.linear)
            forces = _near(at, [given[name] for name in self.base.inputs], shape)
        vertical, traction, torque = forces
        if self.piles:
            piled = [flat(name) for name in ("cohesion", "friction_angle", "unit_weight", "n_c", "n_gamma")]
            level = law.bulldozing(theta, *geometry, *piled)
            values["bulldozing_resistance"] = level.reshape(shape)
            for name in self.ruts:
                own = np.maximum(terms.own[name][DEPTH], SHALLOW)  # a depth of 0 has the slope there
                dug = np.broadcast_to(own * _spin(np.asarray(values["slip"])), shape).reshape(-1)
                deep = law.bulldozing(_entry(theta, sizes["radius"], dug), *geometry, *piled)
                terms.own[name]["rut_resistance"] = (deep - level).reshape(shape) / own
        solved = Solved(traction, torque, sphere.sinkage(theta, sizes["radius"]).reshape(shape))
        channels = self.base.outputs(values, terms, solved)
        return self.measured(channels, terms, len(sets)), theta.reshape(shape), vertical


def _entry(theta: Array, radius: Array, dug: Array) -> Array:
    """Entry angle of a shell that lies as much deeper [m], to its axle at most."""
    return np.asarray(np.arccos(np.clip(np.cos(theta) - dug / radius, np.cos(THETA_MAX), 1.0)))


def _spin(slip: Array) -> Array:
    """What slips over what rolls, s/(1 - s), which a rut's depth follows in steady rolling; nothing while braking."""
    held = np.clip(slip, 0.0, MOST_SLIP)
    return np.asarray(held / (1.0 - held))


def _near(at: tuple[Array, Array], inputs: Sequence[Array], shape: tuple[int, int]) -> Array:
    """Forces (3, sets, rows) of sets that differ infinitesimally from the first, from its forces and derivatives.

    `at`: forces (3, rows) and derivatives (3, rows, inputs) of the first set; `inputs`: each (sets * rows,).
    """
    value, by = at
    change = np.stack(inputs).reshape(len(inputs), *shape)
    change = change - change[:, :1]
    with np.errstate(all="ignore"):  # hopeless parameters have no numbers; a fit turns away from them
        return np.asarray(value[:, None] + np.einsum("orc,csr->osr", by, change))
