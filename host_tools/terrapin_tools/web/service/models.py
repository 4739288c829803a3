"""What goes in and out of the API, as models: bounds of requests, the shape of answers, and their description."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, JsonValue, StringConstraints

from terrapin_tools.web.service.workspace import NAME

__all__ = [
    "CLOSED",
    "WHOLE",
    "Base",
    "CaseDetail",
    "CaseSummary",
    "DrawRequest",
    "Effect",
    "EffectName",
    "Example",
    "ExpressionAnswer",
    "ExpressionRequest",
    "JobStarted",
    "JobView",
    "Name",
    "Named",
    "Parameter",
    "Problem",
    "Request",
    "RowsQuery",
    "Status",
    "problems",
]  # fmt: skip

CLOSED: dict[str, JsonValue] = {"additionalProperties": False}  # of a dictionary whose keys have a pattern: no others
Name = Annotated[str, StringConstraints(pattern=NAME, max_length=64)]
EffectName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$", max_length=64)]
# JSON has no whole numbers of their own, and its schema calls 500.0 one: a strict model alone would refuse it.
WHOLE = BeforeValidator(lambda x: int(x) if isinstance(x, float) and x.is_integer() else x)
Line = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=200)]
Formula = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]+$", min_length=1, max_length=2000)]


class Request(BaseModel):
    """The body of a request: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Problem(BaseModel):
    """What was expected, found, and where, in one line."""

    detail: str


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The answers to refused requests, for the description."""
    always = (400, 401, 403, 408, 413, 421, 422, 503)
    return {status: {"model": Problem} for status in sorted({*always, *statuses})}


class Status(BaseModel):
    """The server."""

    version: str
    workspace: str
    cases: int
    jobs_running: int
    link: str = Field(description="what `terrapin web --link` named, or empty")
    nodes: int = Field(description="node numbers that controllers on a bus may have, from 0 on")


class Named(BaseModel):
    """The name of a case."""

    name: str


class Example(BaseModel):
    """A case that ships with the project."""

    name: str
    title: str
    about: str = Field(description="one sentence on what it shows")


class CaseSummary(BaseModel):
    """A line of the list of cases. A case that is broken says so in `error`."""

    name: str
    title: str
    base: str
    effects: list[str]
    runs: int
    rows: int
    channels: list[str]
    verdict: str | None = Field(description="of the last answer about the case as it stands")
    chip: str = Field(description="the verdict in a few words")
    changed: float = Field(description="s since 1970")
    error: str | None


class Value(BaseModel):
    value: float
    unit: str


class Column(BaseModel):
    column: str
    unit: str
    channel: bool


class Runs(BaseModel):
    train: list[str]
    test: list[str]


class CaseDetail(BaseModel):
    """A case in full, without its rows. `answer` is that of discover, else of compare (docs/cases.md)."""

    name: str
    title: str
    base: str
    effects: list[str]
    parameters: dict[str, Value]
    columns: dict[str, Column]
    extra: list[str] = Field(description="numeric columns that are not mapped")
    rows: int
    runs: Runs
    limits: dict[str, tuple[float, float]]
    toml: str
    answer: dict[str, Any] | None
    ladder: list[dict[str, Any]]
    history: list[dict[str, Any]]


class EffectParameter(BaseModel):
    name: str
    unit: str
    start: float
    meaning: str


class Effect(BaseModel):
    """A physical effect of the catalogue, or one's own."""

    name: str
    title: str
    sentence: str
    equation: str = Field(description="LaTeX")
    mathml: str
    expression: str
    target: str
    source: str
    bases: list[str]
    needs: list[list[str]] = Field(description="of each group one role must be there")
    parameters: list[EffectParameter]
    simulator: bool
    controller: bool
    own: bool


class BaseChannel(BaseModel):
    name: str
    unit: str


class BaseRole(BaseModel):
    name: str
    unit: str
    needed: bool


class BaseParameter(BaseModel):
    name: str
    unit: str
    placeholder: str | None
    default: float | None


class Base(BaseModel):
    """A base model, for the mapper."""

    name: str
    channels: list[BaseChannel]
    roles: list[BaseRole]
    parameters: list[BaseParameter]
    options: dict[str, list[str]]
    fit: str | None = Field(description="a line for [fit] of case.toml to start from")
    own_names: bool = Field(description="names and units are the user's own")
    own_dynamics: bool = Field(description="so are its differential equations")
    left_out: list[str] = Field(description="roles that a new case does not map")


class Parameter(Request):
    """A parameter that is fitted: start value and bounds, of an expression of one's own or of a base model."""

    value: FiniteFloat
    min: FiniteFloat | None = None
    max: FiniteFloat | None = None
    unit: Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f=:]*$", max_length=100)] = ""


class ExpressionRequest(Request):
    """An expression to be checked against a case. `target` empty: the base model's usual one."""

    case: Name
    expression: Formula
    target: Line = ""
    parameters: dict[EffectName, Parameter] = Field(default={}, max_length=20, json_schema_extra=CLOSED)


class DrawRequest(Request):
    """An effect of one's own that is drawn before it is added."""

    effect: EffectName
    expression: Formula
    target: Line = ""
    parameters: dict[EffectName, Parameter] = Field(default={}, max_length=20, json_schema_extra=CLOSED)


class RowsQuery(BaseModel):
    """A box of a plot: from left to right of `variable` (times `times`), from bottom to top of `channel`, or of its
    residual in noise sd. `draft`: of the plot before the verdict."""

    model_config = ConfigDict(extra="forbid")
    variable: Annotated[Line, Field(min_length=1)]
    times: Line = ""
    channel: Line
    residual: bool = False
    left: FiniteFloat
    right: FiniteFloat
    bottom: FiniteFloat
    top: FiniteFloat
    draft: bool = False


class ExpressionAnswer(BaseModel):
    """Whether the units are sound; `unit` is that of the first parameter."""

    ok: bool
    unit: str | None
    message: str
    mathml: str | None
    target: str
    names: list[str]
    unknown: list[str] = Field(description="names without a meaning, which could become parameters")


class JobStarted(BaseModel):
    """A job has been queued."""

    id: str
    command: str


class JobView(BaseModel):
    """A job. `result` is the JSON of the command."""

    id: str
    do: str
    case: str | None
    command: str = Field(description="the command line that does the same")
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    progress: list[str]
    result: Any
    error: str | None
    created: float
    seconds: float
