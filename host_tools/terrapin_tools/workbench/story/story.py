"""The verdict on a case as one object: numbers unrounded, and the sentences that every teller shows.

`told` makes it (told.py) of what compare and discover found; terminal, JSON, report, page and fleet only render it. It
is plain data, so it goes to another process as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from terrapin_tools.workbench.case.changes import OwnEffect, OwnParameter
from terrapin_tools.workbench.compare.groups import Differing
from terrapin_tools.workbench.compare.intervals import Interval
from terrapin_tools.workbench.compare.noise_findings import NoiseFinding
from terrapin_tools.workbench.compare.together import Together
from terrapin_tools.workbench.discover.certainty import Operating
from terrapin_tools.workbench.discover.decide import Weight
from terrapin_tools.workbench.discover.misfit import Step
from terrapin_tools.workbench.discover.ranking import Blamed
from terrapin_tools.workbench.discover.resampled import Selected
from terrapin_tools.workbench.experiment.proposal import Experiment
from terrapin_tools.workbench.formulas.free_curves import Curve
from terrapin_tools.workbench.noise.stated import FAR

__all__ = [
    "Card",
    "Channel",
    "Findings",
    "Goal",
    "Next",
    "NoiseTold",
    "Part",
    "Place",
    "Proposal",
    "Rung",
    "Short",
    "Story",
    "Value",
]


@dataclass(frozen=True)
class Value:
    """A fitted parameter in `unit`; `sd` is None where the fit gives none, a bound where there is none."""

    value: float
    sd: float | None
    unit: str
    min: float | None = None
    max: float | None = None
    at_bound: bool = False


@dataclass(frozen=True)
class Channel:
    """Noise and rms errors of one channel, in its unit."""

    noise_sd: float
    train_rmse: float
    heldout_rmse: float | None
    unit: str


@dataclass(frozen=True)
class NoiseTold:
    """The noise that every sd, band and error of the answer is in: `sds` by channel, in its unit."""

    sds: Mapping[str, float]
    source: str
    model: str  # of what kind it is
    rho: float  # correlation from row to row within a run
    findings: tuple[NoiseFinding, ...]
    floor: bool  # no model can do better; else the sd was estimated while something is missing, and holds a part of it

    @property
    def strange(self) -> tuple[str, ...]:
        """Channels in which far more than the stated noise is left."""
        return tuple(one.channel for one in self.findings if one.kind == "larger" and one.value > FAR)


@dataclass(frozen=True)
class Goal:
    """The error of a channel that is good enough, and those that there are; rms, in `unit`.

    `reached` is that of the model, `then` that of the model with what is missing in it (None where nothing is named);
    both of the held-out runs, or where there are none of the training runs.
    """

    channel: str
    wanted: float
    reached: float
    then: float | None
    unit: str
    held_out: bool

    @property
    def met(self) -> bool:
        return self.reached <= self.wanted

    @property
    def then_met(self) -> bool | None:
        return None if self.then is None else self.then <= self.wanted


@dataclass(frozen=True)
class Rung:
    """Errors in noise sd of the model with effects up to and including `added`."""

    added: str | None
    train_error: float
    heldout_error: float | None


@dataclass(frozen=True)
class Place:
    """A range of a column in which the model fails: mean of measured - predicted there, in noise sd."""

    variable: str
    low: float
    high: float
    channel: str
    mean: float
    along_motion: bool = False  # taken in the direction of motion
    sentence: str = ""  # what stands behind the variable's name


@dataclass(frozen=True)
class Part:
    """What is named takes the share `takes` of the misfit; `left` (rms, noise sd) stays, most of it at a place. With
    the curve beside it, where they are `together`."""

    takes: float
    left: float
    at: Place
    together: bool = False


@dataclass(frozen=True)
class Proposal:
    """One effect alone: the probability that it is part of what is missing, and what adding it alone does."""

    effect: str
    kind: str  # catalogue, expression, constant or table
    expression: str
    target: str
    probability: float
    heldout_rmse: Mapping[str, float | None]  # by channel, in its unit
    noise_ratio: float | None  # error on held-out runs, in noise sd
    parameters: Mapping[str, Value]
    explains: float  # share of the misfit
    column_probability: float | None = None  # of an expression: that some expression or curve in its column is
    mend: Mapping[str, float | str | int] | None = None  # of a fault of the table: what puts the column right

    @property
    def own(self) -> OwnEffect:
        """An expression as an effect that case.toml can hold."""
        parameters = {n: OwnParameter(p.value, p.min, p.max, p.unit) for n, p in self.parameters.items()}
        return OwnEffect(self.expression, self.target, {} if self.mend else parameters, self.mend or {})


@dataclass(frozen=True)
class Findings:
    """What discover adds to what compare says: what its JSON keeps, and two things that only the kept answer has."""

    verdict: str  # adequate, missing, ambiguous, partial or unexplained
    missing: tuple[str, ...]
    probability: float  # that exactly this is missing (adequate: that nothing is)
    candidates: tuple[Proposal, ...]  # likeliest first
    rivals: tuple[tuple[str, ...], ...]
    plan: Experiment | None
    where: tuple[Place, ...]
    ladder: tuple[Rung, ...]
    blamed: Blamed | None
    unknown: Curve | None
    operating: tuple[Operating, ...]
    selected: tuple[Selected, ...]
    together: Mapping[str, Mapping[str, Value]]  # values of what is missing, all fitted together, by effect
    remarks: tuple[str, ...]  # sentences that need more than is kept
    then: Mapping[str, float]  # rms error with what is missing, by channel: held-out runs, else the training runs
    noise: NoiseTold  # around what is named
    part: Part | None = None  # of verdict partial
    front: tuple[Step, ...] = ()  # the likeliest set of no, one, two ... terms
    weighed: tuple[Weight, ...] = ()  # all that was, likeliest first
    formulas: Mapping[str, str] = field(default_factory=dict)  # what each expression says that is named anywhere here
    column: tuple[str, float] | None = None  # of all formulas that are named; that what is missing is a function of it


@dataclass(frozen=True)
class Card:
    """A candidate with everything that is shown of it."""

    proposal: Proposal
    title: str
    named: bool  # part of the answer, or of a rival
    latex: str
    acts: str  # what an expression acts on
    source: str
    reason: str
    values: Mapping[str, Value]  # of a named effect as fitted with the others that are named


@dataclass(frozen=True)
class Short:
    """The likeliest answer of so many terms, in words; `share` of the error without any that is left."""

    terms: int
    name: str
    training: str  # noise sd
    held_out: str
    probability: str  # that it is all that is missing
    share: float


@dataclass(frozen=True)
class Next:
    """What to do next: discover, add, experiment or nothing; `settings`: how many runs, and what each of `vary` is."""

    do: str
    text: str
    vary: tuple[str, ...] = ()  # with unit
    settings: tuple[tuple[str, ...], ...] = ()
    after: str = ""
    offer: str = ""  # before a command that can be typed
    command: str = ""


@dataclass(frozen=True)
class Story:
    """The answer on one case, of compare or (with `found`) of discover."""

    folder: Path
    title: str
    base: str
    effects: tuple[str, ...]
    runs: int
    held_out: tuple[str, ...]
    verdict: str
    p_value: float
    level: float
    chip: str
    headline: str
    alarm: str  # what the test says, where the headline does not
    where: tuple[Place, ...]
    notes: tuple[str, ...]  # sentences beside `where`: runs that carry the misfit, doubts
    by_run: str  # over the residuals of each run
    heading: str  # over the candidates
    measure: str  # what the number beside a candidate is
    cards: tuple[Card, ...]  # what the answer names first, then likeliest first
    front: tuple[Short, ...]  # with no, one, two ... terms; empty where a term predicts nothing better
    chances: tuple[tuple[str, str], ...]  # what these runs can show: of what, and how often
    next: Next
    ladder: tuple[Rung, ...]
    parameters: Mapping[str, Value]
    channels: Mapping[str, Channel]
    noise: NoiseTold
    noise_told: str  # its source and kind in words
    found: Findings | None
    groups: tuple[Differing, ...] = ()  # parameters with one value a group
    together: tuple[Together, ...] = ()  # parameters that the data do not tell apart
    intervals: Mapping[str, Interval] = field(default_factory=dict)  # of the parameters, where they were asked for
    intake: tuple[str, ...] = ()  # what happened to the measurements on their way in
    goals: tuple[Goal, ...] = ()  # what the user asked for
    guessed: tuple[str, ...] = ()  # what nobody has confirmed
    rows_left_out: int = 0
    seconds: float = 0.0  # that the answer took

    @property
    def model(self) -> str:
        """The base model and the effects in it."""
        return " + ".join((self.base, *self.effects))
