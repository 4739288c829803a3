"""Base models with effects as functions of arrays: parameters in, predicted channels out, many parameter sets at once.

The order in which things act: effects that change a parameter, then the base model, then what is added to channels
(resistance, drag), then gains, then what is added to a measured quantity.

    model = Model.of(case)                    what is fitted, with bounds and start values
    bound = model.bind(case.inputs)           on these rows
    bound.predict(theta)                      (channels, rows)
    bound.predict(many)                       (sets, channels, rows) for parameters (sets, parameters)
    bound.jacobian(theta)                     prediction and its derivatives (channels, rows, parameters)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hil.physics import sphere, wheel
from hil.physics.contact import COLUMNS as SPHERE_COLUMNS
from hil.physics.contact import THETA_MAX
from hil.physics.effects import Effect
from hil.physics.expression import Expression, parse
from host_tools.workbench.bases import CHANNELS
from host_tools.workbench.case import Case

__all__ = ["Bound", "Fitted", "Model"]

Array = npt.NDArray[np.float64]
STEP = 1e-6  # relative step of the difference quotients


@dataclass(frozen=True)
class Fitted:
    """One fitted parameter, in `unit`. `effect` is None for the base model's own; `grid` has further start values."""

    key: str  # "f_o", or "speed_squared.f_s"
    name: str  # as formulas say it
    effect: str | None
    unit: str
    start: float
    lower: float
    upper: float
    whole: bool = False
    grid: tuple[float, ...] = ()


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
        fitted = [Fitted(e.name, e.name, None, e.unit, e.value, e.minimum, e.maximum) for e in case.fit.values()]
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

    def bind(self, inputs: Mapping[str, Array], rows: npt.NDArray[np.bool_] | None = None) -> Bound:
        """The model on rows: `inputs` as Case.inputs gives them, all rows or those of a mask."""
        if self.case.base.dynamic is not None:
            from host_tools.workbench.dynamic import bind  # which builds on this module

            return bind(self, inputs, rows)
        used = set().union(
            *(e.names for e in self.expressions.values()), *(e.names for e in self.case.equations.values())
        )
        used |= {*self.case.base.needs, "speed"} if self.case.base.name != "equation" else set()
        columns = {n: (v if rows is None else v[rows]) for n, v in inputs.items() if n in used}
        count = len(next(iter(inputs.values()))) if rows is None else int(rows.sum())
        return Bound(self, columns, count)


@dataclass
class Bound:
    """A model on rows. Rows that agree in every input are computed once."""

    model: Model
    columns: Mapping[str, Array]
    count: int
    _entry: Array | None = field(default=None, repr=False)  # last entry angles: a near start for the next solve

    def __post_init__(self) -> None:
        self.contact = self.model.case.base.name in ("sphere_contact", "wheel_contact")
        self.linear = self.model.case.options.get("stress") == "linear"
        self.needs_bulldozing = any("bulldozing_resistance" in e.names for e in self.model.expressions.values())
        self.unique: Mapping[str, Array] = self.columns
        self.inverse: npt.NDArray[np.int64] | None = None
        if self.contact and self.columns:
            stacked = np.column_stack(list(self.columns.values()))
            distinct, inverse = np.unique(stacked, axis=0, return_inverse=True)
            self.unique = {name: distinct[:, i] for i, name in enumerate(self.columns)}
            self.inverse = inverse.reshape(-1)
        elif self.contact:
            self.inverse = np.zeros(self.count, dtype=np.int64)
        self.constants: dict[str, Array | float] = {**self.model.case.parameters}
        self.size = (len(next(iter(self.unique.values()))) if self.unique else 1) if self.contact else self.count
        self._scale = np.array([_scale(f) for f in self.model.fitted])

    def predict(self, theta: Array) -> Array:
        """Channels (channels, rows) for parameters (parameters,); (sets, channels, rows) for (sets, parameters)."""
        sets = np.atleast_2d(theta)
        prediction = self._expand(self._evaluate(sets)[0])
        return prediction[0] if theta.ndim == 1 else prediction

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        """Prediction (channels, rows) and its derivatives (channels, rows, parameters) by difference quotients.

        On contact models the entry angle is solved once, and how it follows the parameters comes from the implicit
        function theorem. The forces near it come from their exact derivatives, so a Jacobian costs one solve and one
        evaluation with derivatives, however many parameters there are; only what is cheap is differenced.
        """
        count = len(theta)
        step = STEP * np.maximum(np.abs(theta), self._scale)
        step = np.where(theta + step > self.model.upper, -step, step)
        sets = np.repeat(theta[None, :], count + 1, axis=0)
        sets[np.arange(1, count + 1), np.arange(count)] += step
        step = sets[np.arange(1, count + 1), np.arange(count)] - theta
        if not self.contact:
            values = self._evaluate(sets)[0]
            slopes = (values[1:] - values[0]) / step[:, None, None]
            return values[0], np.moveaxis(slopes, 0, -1)
        _, entry, _ = self._evaluate(theta[None, :])
        assert entry is not None
        moved = entry * (1.0 + STEP)
        sets = np.vstack([theta[None, :], sets[1:], theta[None, :]])
        entries = np.repeat(entry, count + 2, axis=0)
        entries[-1] = moved[0]
        values, _, vertical = self._evaluate(sets, entries)
        assert vertical is not None
        with np.errstate(all="ignore"):  # hopeless parameters have no derivatives; a fit turns away from them
            slopes = (values[1:-1] - values[0]) / step[:, None, None]
            along = (values[-1] - values[0]) / (moved[0] - entry[0])
            rise = (vertical[-1] - vertical[0]) / (moved[0] - entry[0])
            follow = (vertical[1:-1] - vertical[0]) / step[:, None]
            carried = (entry[0] < 0.999 * THETA_MAX) & (rise > 0)
            ratio = np.where(carried, follow / np.where(rise > 0, rise, 1.0), 0.0)
            slopes = slopes - along[None] * ratio[:, None, :]
        return self._expand(values[:1])[0], np.moveaxis(self._expand(slopes), 0, -1)

    def _equations(self, values: Mapping[str, Array | float]) -> dict[str, Array]:
        case = self.model.case
        scaled = {name: value * case.scales.get(name, 1.0) for name, value in values.items()}
        return {c: case.equations[c].evaluate(scaled) / case.scales.get(c, 1.0) for c in self.model.channels}

    def _expand(self, values: Array) -> Array:
        return values if self.inverse is None else values[..., self.inverse]

    def _evaluate(self, sets: Array, entry: Array | None = None) -> tuple[Array, Array | None, Array | None]:
        """Channels (sets, channels, size); for contact models also entry angles and vertical forces (sets, size)."""
        shape = (len(sets), self.size)
        values: dict[str, Array | float] = dict(self.constants)
        values.update(self.unique)
        for i, fitted in enumerate(self.model.fitted):
            if fitted.effect is None:
                values[fitted.name] = sets[:, i : i + 1]
        local = self._local(sets)
        name = self.model.case.base.name
        if name == "wheel_contact":
            values["k_s"] = 1.0  # a factor on k_c and k_phi alike
        if self.contact:
            values["recovery"] = 0.0
        if name == "rolling_steady" and "speed" not in values:
            values["speed"] = np.asarray(values["radius"] * values["omega"])
        if name != "equation":
            self._change_parameters(values, local)
        vertical = None
        if name == "rolling_steady":
            channels = {"current": _rolling(values, self._sum(values, local, "resistance"))}
        elif name == "equation":
            channels = self._equations(values)
        else:
            entry, vertical, channels = self._contact(values, shape, entry)
            if self.needs_bulldozing:
                values["bulldozing_resistance"] = self._bulldozing(values, shape, entry)
            drag = self._sum(values, local, "drag")
            radius = values["radius"]
            channels["traction"] = channels["traction"] - drag
            channels["torque"] = channels["torque"] - radius * drag
        for stage in ("channel", "gain", "measured"):
            for effect in self.model.effects:
                if effect.target in channels and effect.stage == stage:
                    change = self._value(effect, values, local)
                    present = channels[effect.target]
                    channels[effect.target] = present * (1.0 + change) if stage == "gain" else present + change
        stacked = np.stack([np.broadcast_to(channels[c], shape) for c in self.model.channels], axis=1)
        return stacked, entry, vertical

    def _local(self, sets: Array) -> dict[str, dict[str, Array | float]]:
        """The effects' own parameters, by effect: their names hide equal names of the model."""
        local: dict[str, dict[str, Array | float]] = {
            effect.name: dict(effect.options) for effect in self.model.effects
        }
        for name, own in local.items():
            for option in own:
                if option in self.constants and option in dict(self.model.case.library[name].options):
                    own[option] = self.constants[option]
        for i, fitted in enumerate(self.model.fitted):
            if fitted.effect is not None:
                local[fitted.effect][fitted.name] = sets[:, i : i + 1]
        return local

    def _value(
        self, effect: Effect, values: Mapping[str, Array | float], local: Mapping[str, Mapping[str, Array | float]]
    ) -> Array:
        return self.model.expressions[effect.name].evaluate({**values, **local[effect.name]})

    def _sum(
        self, values: Mapping[str, Array | float], local: Mapping[str, Mapping[str, Array | float]], target: str
    ) -> Array:
        total = np.zeros(1)
        for effect in self.model.effects:
            if effect.target == target:
                total = total + self._value(effect, values, local)
        return total

    def _change_parameters(
        self, values: dict[str, Array | float], local: Mapping[str, Mapping[str, Array | float]]
    ) -> None:
        for effect in self.model.effects:
            target = effect.target
            if target in CHANNELS or target in ("resistance", "drag"):
                continue
            change = self._value(effect, values, local)
            values[target] = values[target] + change if effect.additive else values[target] * (1.0 + change)

    def _contact(
        self, values: Mapping[str, Array | float], shape: tuple[int, int], entry: Array | None
    ) -> tuple[Array, Array, dict[str, Array]]:
        def flat(name: str) -> Array:
            return np.broadcast_to(np.asarray(values[name], dtype=np.float64), shape).reshape(-1)

        common = {
            "exponent": flat("n"),
            "cohesion": flat("cohesion"),
            "friction_angle": flat("friction_angle"),
            "shear_modulus": flat("shear_modulus"),
            "recovery": flat("recovery"),
        }
        load, slip, radius = flat("load"), flat("slip"), flat("radius")
        start = None
        if entry is None and self._entry is not None:
            start = np.broadcast_to(self._entry, shape).reshape(-1)
        fixed = None if entry is None else entry.reshape(-1)
        if self.model.case.base.name == "sphere_contact":
            soil = sphere.Soil(flat("k_s"), c1=flat("c1"), c2=flat("c2"), **common)
            if fixed is None:
                theta = sphere.entry_angle(load, slip, radius, soil, self.linear, start=start)
                forces = np.stack(sphere.forces(theta, slip, radius, soil, self.linear))
            else:
                theta = fixed
                given = {"entry": theta, "slip": slip, "radius": radius, "width": np.zeros_like(slip), **vars(soil)}
                one = {name: value[: shape[1]] for name, value in given.items()}
                firm = sphere.Soil(**{name: one[name] for name in vars(soil)})
                at = sphere.slopes(one["entry"], one["slip"], one["radius"], firm, self.linear)
                forces = _near(at, [given[name] for name in SPHERE_COLUMNS], shape)
        else:
            width = flat("width")
            ground = wheel.Soil(flat("k_c") * flat("k_s"), flat("k_phi") * flat("k_s"), **common)
            if fixed is None:
                theta = wheel.entry_angle(load, slip, radius, width, ground, self.linear, start=start)
                forces = np.stack(wheel.forces(theta, slip, radius, width, ground, self.linear))
            else:
                theta = fixed
                given = {"entry": theta, "slip": slip, "radius": radius, "width": width, **vars(ground)}
                one = {name: value[: shape[1]] for name, value in given.items()}
                soft = wheel.Soil(**{name: one[name] for name in vars(ground)})
                at = wheel.slopes(one["entry"], one["slip"], one["radius"], one["width"], soft, self.linear)
                forces = _near(at, [given[name] for name in wheel.COLUMNS], shape)
        vertical, traction, torque = forces
        found = theta.reshape(shape)
        if entry is None:
            self._entry = found[:1].copy()
        channels = {
            "traction": traction.reshape(shape),
            "torque": torque.reshape(shape),
            "sinkage": sphere.sinkage(theta, radius).reshape(shape),
        }
        return found, vertical.reshape(shape), channels

    def _bulldozing(self, values: Mapping[str, Array | float], shape: tuple[int, int], entry: Array) -> Array:
        soil = (values["cohesion"], values["friction_angle"])
        known = (values["unit_weight"], values["n_c"], values["n_gamma"])
        arrays = [np.broadcast_to(np.asarray(v, float), shape).reshape(-1) for v in (values["radius"], *soil, *known)]
        if self.model.case.base.name == "sphere_contact":
            resistance = sphere.bulldozing(entry.reshape(-1), *arrays)
        else:
            width = np.broadcast_to(np.asarray(values["width"], float), shape).reshape(-1)
            resistance = wheel.bulldozing(entry.reshape(-1), arrays[0], width, *arrays[1:])
        return resistance.reshape(shape)


def _fitted(effect: Effect) -> list[Fitted]:
    return [
        Fitted(f"{effect.name}.{p.name}", p.name, effect.name, p.unit, p.start, p.minimum, p.maximum, p.whole, p.grid)
        for p in effect.parameters
    ]


def _near(at: tuple[Array, Array], inputs: Sequence[Array], shape: tuple[int, int]) -> Array:
    """Forces (3, sets * rows) of sets that differ infinitesimally from the first, from its forces and derivatives.

    `at`: forces (3, rows) and derivatives (3, rows, inputs) of the first set; `inputs`: each (sets * rows,).
    """
    value, by = at
    change = np.stack(inputs).reshape(len(inputs), *shape)
    change = change - change[:, :1]
    with np.errstate(all="ignore"):  # hopeless parameters have no numbers; a fit turns away from them
        found = value[:, None] + np.einsum("orc,csr->osr", by, change)
    return np.asarray(found.reshape(3, -1))


def _scale(fitted: Fitted) -> float:
    """A size against which a step in this parameter is small, where its value is 0."""
    if fitted.start:
        return abs(fitted.start)
    width = fitted.upper - fitted.lower
    return min(1.0, float(width)) if np.isfinite(width) else 1.0


def _rolling(values: Mapping[str, Array | float], resistance: Array) -> Array:
    """Motor current [A], Reina et al. 2006, Eq. (12): (R/r) K_t i = C_r + A sgn(omega) + B omega + dC."""
    v = {name: np.asarray(value) for name, value in values.items()}
    direction = np.sign(v["omega"])
    rolling = v["f_o"] * v["radius"] * v["load"] * direction
    torque = rolling + v["coulomb"] * direction + v["viscous"] * v["omega"] + resistance
    return np.asarray(torque * v["drive_radius"] / (v["radius"] * v["torque_constant"]))
