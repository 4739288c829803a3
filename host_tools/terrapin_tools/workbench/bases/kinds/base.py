"""What a base model is: a plain object that the workbench asks. It never sees a case or a model, only a `Problem`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import Expression

__all__ = [
    "CHANNEL_COST",
    "GAIN",
    "PRODUCT_COST",
    "Act",
    "Base",
    "Dynamics",
    "Fitted",
    "Predictor",
    "Problem",
    "Quantity",
    "Runs",
    "State",
    "Target",
]

Act = Callable[[Array], Array]

Factor = tuple[str, float, bool]
Target = tuple[str, float]

CHANNEL_COST, PARAMETER_COST = 0.7, 0.25  # prior factors of what an expression acts on
GAIN = "gain_of_"  # before the name of a channel or a state: what its formula is multiplied with
PRODUCT_COST = 0.35  # prior factor of a further column
ALONE: Factor = ("", 1.0, True)  # no further column


@dataclass(frozen=True)
class Quantity:
    """A parameter of a base model. `placeholder` stands in a new case, for the user to replace."""

    unit: str  # SI
    placeholder: str = ""  # as case.toml says it
    default: float | None = None  # None: a case states or fits it


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
    by: str = ""  # the grouping of which each group has a value of its own
    group: str = ""  # that of this value

    @property
    def scale(self) -> float:
        """A size against which a step in this parameter is small, where its value is 0."""
        if self.start:
            return abs(self.start)
        width = self.upper - self.lower
        return min(1.0, float(width)) if np.isfinite(width) else 1.0


@dataclass(frozen=True)
class Runs:
    """Which run each row belongs to (rows,), the runs' names, where a row stands, and what was measured."""

    index: Index
    names: tuple[str, ...]
    place: Callable[[int], str]
    measured: Mapping[str, Array]


@dataclass(frozen=True)
class State:
    """A state of the user's own. `initial`: its value at a run's first row, the name of a column that has it there, or
    None where each run's own is fitted."""

    unit: str  # SI, "" for none
    initial: float | str | None


@dataclass(frozen=True)
class Dynamics:
    """Differential equations of the user's own. `held`: inputs keep their value until the next row; `stated_held`: so
    says the case, and no fault of the table. `starts` keeps what was found of fitted starts, by equations with
    parameters and by rows, for whoever solves the same again; `effort` the steps a second that the first solution took.
    """

    states: Mapping[str, State]
    derivative: Mapping[str, Expression]
    held: bool
    stated_held: bool
    starts: dict[tuple[int, bytes], dict[int, Array]] = field(default_factory=dict, compare=False, repr=False)
    effort: list[float] = field(default_factory=list, compare=False, repr=False)


@dataclass(frozen=True)
class Problem:
    """What is to be predicted. `inputs` holds every row, by the names that formulas use; `rows` masks those wanted.

    Without `runs` each row is a proposed setting, a run of its own that starts from rest.
    """

    channels: tuple[str, ...]
    effects: tuple[Effect, ...]
    fitted: tuple[Fitted, ...]
    constants: Mapping[str, float]
    options: Mapping[str, str]
    inputs: Mapping[str, Array]
    rows: Mask | None
    runs: Runs | None
    formulas: Mapping[str, Expression]  # of the user's own, by channel
    scales: Mapping[str, float]  # what takes each name's number to SI, where all units of the formulas are given
    dynamics: Dynamics | None = None

    @property
    def count(self) -> int:
        return len(next(iter(self.inputs.values()))) if self.rows is None else int(self.rows.sum())


class Predictor:
    """A base model on rows: predictions, and their derivatives, here by differences to what is near."""

    def __init__(self, problem: Problem, step: float = 1e-6) -> None:
        """`step` is relative to a parameter's value."""
        self.problem, self.step = problem, step
        self.scale = np.array([f.scale for f in problem.fitted])
        self.upper = np.array([f.upper for f in problem.fitted], dtype=np.float64)

    def sets(self, sets: Array) -> Array:
        """Channels (sets, channels, rows) for parameters (sets, parameters)."""
        raise NotImplementedError

    def predict(self, theta: Array) -> Array:
        """Channels (channels, rows) for parameters (parameters,); (sets, channels, rows) for (sets, parameters)."""
        found = self.sets(np.atleast_2d(theta))
        return found[0] if theta.ndim == 1 else found

    def near(self, sets: Array) -> Array:
        """Channels (sets, channels, rows) of parameters (sets, parameters) that hardly differ from the first: where
        that is cheaper, what they change only to first order."""
        return self.sets(sets)

    def moved(self, theta: Array) -> tuple[Array, Array]:
        """`theta` and, for each parameter, theta with a step in it (1 + parameters, parameters); the steps taken."""
        step = self.step * np.maximum(np.abs(theta), self.scale)
        sets = np.vstack([theta, theta + np.diag(np.where(theta + step > self.upper, -step, step))])
        return sets, np.diagonal(sets[1:]) - theta

    def motion(self, theta: Array) -> Mapping[str, Array]:
        """What the model computes beside its channels (rows,), by the names that formulas say."""
        return {}

    def acting(self, theta: Array, target: str) -> Act | None:
        """What takes small additions to `target` (count, rows) to changes of the prediction (count, channels, rows).

        None where the base has no way of its own to tell.
        """
        return None

    def trouble(self, theta: Array) -> str:
        """Why there is no prediction, in words, where the base knows better than that there is none; else ""."""
        return ""

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        """Prediction (channels, rows) and its derivatives (channels, rows, parameters)."""
        sets, step = self.moved(theta)
        values = self.near(sets)
        with np.errstate(invalid="ignore"):  # there are places without numbers, which whoever asks looks for
            slopes = (values[1:] - values[0]) / step[:, None, None]
        return values[0], np.moveaxis(slopes, 0, -1)


@dataclass(frozen=True, kw_only=True)
class Base:
    """A base model. What is not said has the meaning that most bases have.

    `effects` names effects of the catalogue that act on this base although their files do not name it.
    """

    name: str
    channels: Mapping[str, str] = field(default_factory=dict)  # what it predicts, with units
    parameters: Mapping[str, Quantity] = field(default_factory=dict)
    needs: Mapping[str, str] = field(default_factory=dict)  # roles (or constants), with placeholders of constants
    first_fit: Mapping[str, str] = field(default_factory=dict)  # what a new case fits, as [fit] says it
    column_words: Mapping[str, tuple[str, str]] = field(default_factory=dict)  # of channels: see from_tables.WORDS
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # the first is the default
    provides: tuple[str, ...] = ()  # roles and names that the model itself gives to effects
    forces: Mapping[str, str] = field(default_factory=dict)  # what effects add to beside channels, with units
    further: tuple[str, ...] = ()  # what effects act on that is neither channel, force nor parameter
    effects: tuple[str, ...] = ()
    follows: tuple[str, ...] = ("time", "angle", "temperature", "voltage")  # from a run, rather than chosen for it
    left_out: Mapping[str, str] = field(default_factory=dict)  # roles that a new case does not map, and why
    own_names: bool = False  # names and units are the user's own
    own_dynamics: bool = False  # so are its states and their derivatives
    whole_runs: bool = False  # integrates over a run: what happened before counts
    convex: bool = False  # one start finds the one minimum
    on_robot: bool = False  # the simulator can be the robot
    of_soil: bool = False  # computes the soil under wheel or shell, which the controller does not
    reader: str = ""  # the command that reads such a case, where `compare` does not

    @property
    def units(self) -> dict[str, str]:
        """Units of the parameters."""
        return {name: quantity.unit for name, quantity in self.parameters.items()}

    def takes(self, effect: Effect) -> bool:
        return self.name in effect.bases or effect.name in self.effects

    def with_formulas(self, formulas: Mapping[str, Expression], fitted: Collection[str]) -> Base:
        """This base with what a case says of it: a formula for each channel, and the names that it fits."""
        return self

    def gains(self) -> dict[str, str]:
        """By channel, what its whole formula is multiplied with, where an effect may let that go with a column."""
        return {}

    def acts_on(self) -> tuple[str, ...]:
        """Every name that the user's own expression may act on."""
        return (*self.channels, *self.forces, *self.further, *self.parameters)

    def targets(self) -> list[Target]:
        """What discovery lets an expression act on, with prior factors; one that names no target acts on the first."""
        return [(channel, CHANNEL_COST) for channel in self.channels]

    def factors(self, target: str, main: str, values: Mapping[str, Array], roles: Collection[str]) -> list[Factor]:
        """What may stand beside a shape of column `main`: formula, prior factor, whether also beside a step.

        `values` are the numeric columns by the names that formulas use, `roles` those of them that are mapped.
        """
        others = [name for name in values if name in roles and name not in (main, "time")]
        return [ALONE, *((name, PRODUCT_COST, False) for name in others)]

    def suits(self, names: Collection[str | None]) -> bool:
        """Whether a table with these roles and channels has what it needs and something that it predicts."""
        needed = {role for role, placeholder in self.needs.items() if not placeholder}
        return bool(needed) and needed <= {*names} and not self.channels.keys().isdisjoint(names)

    def resembles(self, names: Collection[str | None], words: Collection[str]) -> int:
        """How much a table looks like this base, 0 for not at all: its guessed roles, the words of its columns."""
        return 0

    def predictor(self, problem: Problem) -> Predictor:
        """The model on rows, with effects. UserError when the rows are none that it can predict."""
        raise NotImplementedError
