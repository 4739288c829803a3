"""A case as a value: measurements and a model, asked and changed from a program."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from terrapin_tools.door.answer import Answer, in_a_program
from terrapin_tools.door.effect import Effect
from terrapin_tools.errors import UserError, for_programs

if TYPE_CHECKING:
    from terrapin_tools.door.log import Log
    from terrapin_tools.workbench.case.case import Case as Inner
    from terrapin_tools.workbench.compare.comparison import Analysis
    from terrapin_tools.workbench.story.story import Story

__all__ = ["Case"]

LEVEL = 0.05


@final
class Case:
    """Measurements and the model that is to explain them: a value. What changes it gives a new one, and nothing is
    written but by `save` and `report`.

    >>> import numpy as np
    >>> w = np.tile(np.linspace(1.0, 9.0, 40), 6)
    >>> torque = 2.0 + 0.5 * w + np.random.default_rng(1).normal(0.0, 0.1, 240)
    >>> table = {"run": np.repeat(np.arange(6), 40), "w": w, "M": torque}
    >>> fit = {"a": (0.0, -9.0, 9.0, "N m"), "b": (1.0, -9.0, 9.0, "N m s/rad")}
    >>> units = {"w": "rad/s", "M": "N m"}
    >>> case = Case.from_table(table, run="run", units=units, equation={"M": "a + b*w"}, fit=fit)
    >>> case.channels, case.runs, case.rows
    (('M',), ('0', '1', '2', '3', '4', '5'), 240)
    """

    __slots__ = ("_case", "_known")

    def __init__(self, case: Inner) -> None:
        self._case = case
        self._known: dict[
            tuple[str, int, float, bool], tuple[Analysis, Story]
        ] = {}  # what was asked; no part of the value

    # -- where cases come from -----------------------------------------------------------------------------------------

    @classmethod
    @for_programs
    def load(cls, folder: str | Path) -> Case:
        """The case in a folder (docs/cases.md). InputError when anything in it is wrong.

        >>> Case.load(paths.examples()["heated_motor"]).base
        'rolling_steady'
        """
        from terrapin_tools.workbench.case.case import load_case

        return cls(load_case(Path(folder)))

    @classmethod
    @for_programs
    def example(cls, name: str) -> Case:
        """A case that ships with Terrapin. InputError names those that there are.

        >>> Case.example("heated_motor").effects
        ('speed_squared',)
        """
        from terrapin_hil import paths

        known = paths.examples()
        if name not in known:
            raise UserError(f"example: found {name!r}, expected one of {', '.join(known)}")
        return cls.load(known[name])

    @classmethod
    @for_programs
    def from_table(
        cls,
        table: object,
        *,
        run: str = "",
        units: Mapping[str, str] | None = None,
        equation: Mapping[str, str] | None = None,
        fit: Mapping[str, Any] | None = None,
        constants: Mapping[str, Any] | None = None,
        columns: Mapping[str, str] | None = None,
        roles: Mapping[str, str] | None = None,
        noise: Mapping[str, float] | None = None,
        base: str = "equation",
        effects: Sequence[str] = (),
        limits: Mapping[str, Any] | None = None,
        train: Iterable[object] = (),
        test: Iterable[object] = (),
        title: str = "table",
        groups: Mapping[str, str] | None = None,
        states: Mapping[str, Any] | None = None,
        derivative: Mapping[str, str] | None = None,
        measured: Mapping[str, str] | None = None,
        held: bool = False,
    ) -> Case:
        """A case of a table in memory.

        Parameters
        ----------
        table : whatever speaks Arrow (pandas, polars, pyarrow), a mapping of columns to arrays, or the name of a file
            with a table (docs/cases.md), of a folder of such, or a list of files: each is a run, if `run` names none.
        run : column that names the run of each row; "": all rows are one run.
        units : unit by column, where neither the column's metadata (`unit`) nor its name ("w [rpm]") tells it. A column
            whose unit is told is taken, whether the equation names it or not; answers say which are in no formula.
            Here and below a column is named by its heading as it is written, or by its bare name: `D [mm]` or `D`.
        equation : channel -> formula, of base "equation".
        fit : fitted name -> START, (START, MIN, MAX) or (START, MIN, MAX, UNIT); a bound is None where there is none.
        constants : known name -> number in SI, (NUMBER, UNIT) or "80 mm".
        columns : name in the model -> column, where they differ.
        roles : name in the model -> what it is, of base "equation": speed, position, acceleration, temperature,
            current, torque, time or direction. With one, effects of mechanics become candidates (docs/effects.md).
        noise : channel -> sd of a row, in the column's unit, where it is known.
        base : the base model (docs/bases.md).
        effects : effects that the model has already.
        limits : what the rig can set: input -> (MIN, MAX) or (MIN, MAX, UNIT).
        train, test : names of runs; none: every fifth run is held out.
        groups : fitted name -> column of the groups for each of which it has a value (docs/cases.md, Groups).
        states, derivative, measured : differential equations of your own (docs/ode.md), of base "ode": state -> START
            or (START, UNIT), with START "fit", a number or a column; state -> formula of its derivative; channel ->
            formula. A column `time` is needed, or one that `columns` calls so.
        held : the inputs keep their values until the next row; else they are linear between rows.

        Raises
        ------
        errors.InputError : one line with column or argument, what was found and what was expected.
        """
        from terrapin_tools.door.making import Motion, case_of

        return cls(
            case_of(
                table, base=base, run=run, columns=columns or {}, roles=roles or {}, units=units or {},
                noise=noise or {}, equation=equation or {}, constants=constants or {}, fit=fit or {}, effects=effects,
                limits=limits or {}, train=train, test=test, title=title, groups=groups or {},
                motion=Motion(states or {}, derivative or {}, measured or {}, held),
            )
        )  # fmt: skip

    @classmethod
    @for_programs
    def from_log(
        cls,
        *logs: Log | str | Path,
        effects: Sequence[str] = (),
        after: float = 0.0,
        before: float = 1e18,
        span: float | None = None,
        soil: str = "",
        title: str = "Logged runs",
        robot: str = "",
    ) -> Case:
        """A case of logged runs of a robot: a row for each steady window that its controller called valid.

        Parameters
        ----------
        logs : folders that `terrapin run --out` or `Session(log=...)` wrote, two at least; one of them is held out.
        effects : that the model has already.
        after, before : windows between these times count [s].
        span : rows of this length [s], steady or not, in place of the windows.
        soil : under a sphere, a name of the library.
        robot : whose runs they are, a shipped one or a file; it becomes that of this process.

        Raises
        ------
        errors.InputError : a folder has no log, the log no such row, or it is another robot's.
        """
        from terrapin_tools.door.making import case_of_runs

        return cls(case_of_runs(logs, list(effects), after, before, span, soil, title, robot))

    # -- what it is ----------------------------------------------------------------------------------------------------

    @property
    def title(self) -> str:
        """Of the case."""
        return self._case.title

    @property
    def base(self) -> str:
        """Name of the base model."""
        return self._case.base.name

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects in the model, in the order in which they were added."""
        return self._case.effects

    @property
    def channels(self) -> tuple[str, ...]:
        """What is measured and predicted."""
        return tuple(name for name in self._case.base.channels if name in self._case.channels)

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs."""
        return self._case.run_names

    @property
    def held_out(self) -> tuple[str, ...]:
        """Names of the runs that no fit sees."""
        case = self._case
        return tuple(sorted({case.run_names[i] for i in case.run[case.test]}))

    @property
    def rows(self) -> int:
        """Count of the rows, of all runs."""
        return self._case.rows

    @property
    def text(self) -> str:
        """Of case.toml (docs/cases.md)."""
        return self._case.text

    def table(self) -> Any:
        """The measurements as a pyarrow.Table, in the units that the columns' metadata name."""
        from terrapin_tools.workbench.files.arrow_tables import labelled

        case = self._case
        columns: dict[str, Any] = {"run": [case.run_names[i] for i in case.run]}
        columns |= {**case.roles, **case.channels}
        columns |= {name: values for name, values in case.extra.items() if name not in columns}
        return labelled(columns, case.units)

    # -- questions -----------------------------------------------------------------------------------------------------

    @for_programs
    def compare(
        self,
        *,
        seed: int = 0,
        level: float = LEVEL,
        intervals: bool = False,
        progress: Callable[[str], None] | None = None,
    ) -> Answer:
        """Is the model good enough for the measurements, and where does it fail? As `terrapin compare`.

        `seed` of what is drawn; `level`: false alarm rate of "something is missing". `intervals`: with
        `Answer.intervals`, whose `progress` is told or shown as that of `discover`.
        """
        return Answer(self._asked("compare", seed, level, progress=progress, intervals=intervals)[1])

    @for_programs
    def discover(
        self, *, seed: int = 0, level: float = LEVEL, bootstrap: int = 0, progress: Callable[[str], None] | None = None
    ) -> Answer:
        """What does the model lack, how sure is that, and what to do next? As `terrapin discover`.

        `bootstrap`: ask again of so many resampled sets of runs. `progress` gets what is done now; without it a
        terminal and a notebook show it by themselves.
        """
        return Answer(self._asked("discover", seed, level, bootstrap, progress)[1])

    @for_programs
    def ladder(self, *, seed: int = 0) -> Any:
        """Errors in noise sd of the base model and with each effect: a pyarrow.Table of `added`, `train_error` and
        `heldout_error`.

        >>> Case.example("heated_motor").ladder().column("added").to_pylist()
        [None, 'speed_squared']
        """
        from terrapin_tools.workbench.files.arrow_tables import labelled

        rungs = self._asked("compare", seed, LEVEL)[1].ladder
        return labelled(
            {key: [getattr(r, key) for r in rungs] for key in ("added", "train_error", "heldout_error")}, {}
        )

    @for_programs
    def residuals(self, *, seed: int = 0) -> Any:
        """A pyarrow.Table with a row for each that is trained on or held out: `row` of the case (from 0), `run`,
        `held_out`, and of each channel NAME, NAME_predicted, NAME_residual (measured - predicted) and NAME_sd of the
        noise, in the units that the metadata name."""
        from terrapin_tools.workbench.files.arrow_tables import labelled

        found = self._asked("compare", seed, LEVEL)[0]
        case, rows = found.case, found.rows
        columns: dict[str, Any] = {
            "row": rows.nonzero()[0],
            "run": [case.run_names[i] for i in case.run[rows]],
            "held_out": case.test[rows],
        }
        units: dict[str, str] = {}
        for i, name in enumerate(found.model.channels):
            parts = {
                name: found.prediction[i] + found.residual[i],
                f"{name}_predicted": found.prediction[i],
                f"{name}_residual": found.residual[i],
                f"{name}_sd": [float(found.told.sigma[i])] * int(rows.sum()),
            }
            columns |= parts
            units |= dict.fromkeys(parts, case.units[name])
        return labelled(columns, units)

    @for_programs
    def predict(self, table: object, *, seed: int = 0) -> Any:
        """What the fitted model says about new rows.

        Parameters
        ----------
        table : as for `from_table`, with the columns of the case, by the names that they have there (`D [mm]`, or `D`)
            or in the model, in the units of the case where metadata or heading do not tell others; channels may be
            absent, but where the base integrates over time, for there each stretch starts where it fits them.

        Returns
        -------
        A pyarrow.Table, a row for each: of each channel NAME, NAME_sd (from the sds of the parameters) and
        NAME_noise_sd (of one measurement beside it, in a run of its own).

        Raises
        ------
        errors.InputError : a column is missing, has a gap or a unit of another kind, or a row has no prediction.

        Warns
        -----
        UserWarning : a row lies outside the rows that the model was fitted on; no sd tells what that costs.

        >>> case = Case.example("heated_motor")
        >>> case.predict(case.table().slice(0, 3)).column_names
        ['current', 'current_sd', 'current_noise_sd']
        """
        from terrapin_tools.door.making import table_of
        from terrapin_tools.door.predicting import predicted

        return predicted(self._asked("compare", seed, LEVEL)[0], *table_of(table))

    @for_programs
    def plot(
        self, kind: str = "residual", *, against: str = "", channel: str = "", ax: Any = None, seed: int = 0
    ) -> Any:
        """`residual`, `prediction` or `ladder`, as a Matplotlib Figure, or drawn on `ax`, which is then returned.

        `against`: a column; without it the one in which the model fails most. `channel`: the first without it.

        >>> case = Case.example("heated_motor")
        >>> case.plot(against="temperature").axes[0].get_xlabel()
        'temperature [degC]'
        """
        from terrapin_tools.door.pictures import drawn

        return drawn(*self._asked("compare", seed, LEVEL), kind, against, channel, ax)

    # -- changes -------------------------------------------------------------------------------------------------------

    @for_programs
    def add(self, *effects: str | Iterable[str]) -> Case:
        """A case whose model has these effects too: names of the catalogue, `Effect`s, or `Answer.missing`.

        >>> case = Case.example("heated_motor")
        >>> case.add("motor_heating").effects, case.effects
        (('speed_squared', 'motor_heating'), ('speed_squared',))
        """
        from terrapin_tools.workbench.story.change import with_effects

        listed = ([given] if isinstance(given, str) or not isinstance(given, Iterable) else given for given in effects)
        names = [one for given in listed for one in given]
        for one in names:
            if not isinstance(one, str):
                found = "an Answer, whose `missing` it takes" if isinstance(one, Answer) else repr(one)
                raise UserError(f"add: found {found}, expected the name of an effect, or an Effect")
        if not names:
            raise UserError("add: found no effect, expected one at least")
        own = {str(one): one.own for one in names if isinstance(one, Effect) and one.own is not None}
        return self._with(with_effects(self._case, [str(one) for one in names], own))

    @for_programs
    def remove(self, effect: str) -> Case:
        """A case whose model has this effect no more. InputError when it is not in it.

        >>> Case.example("heated_motor").remove("speed_squared").effects
        ()
        """
        from terrapin_tools.workbench.story.change import without_effect

        return self._with(without_effect(self._case, effect))

    # -- what is written -----------------------------------------------------------------------------------------------

    @for_programs
    def save(self, folder: str | Path) -> Path:
        """Writes a case folder, which `terrapin compare FOLDER` answers with the same numbers. InputError when `folder`
        exists, or a file of the case has changed since it was read."""
        from terrapin_tools.door.saving import write_folder
        from terrapin_tools.workbench.files.writing import whole_folder

        with whole_folder(Path(folder)) as scratch:
            write_folder(self._case, scratch)
        return Path(folder)

    @for_programs
    def report(self, file: str | Path, *, seed: int = 0, level: float = LEVEL, discover: bool = True) -> Path:
        """Writes the page of `terrapin report`, one HTML file that works offline. `discover`: look for what is
        missing."""
        from terrapin_tools.workbench.files.writing import write_whole
        from terrapin_tools.workbench.story.page import page_of

        analysis, story = self._asked("discover" if discover else "compare", seed, level)
        in_memory = self._case.folder == Path()
        write_whole(Path(file), page_of(analysis, in_a_program(story) if in_memory else story))
        return Path(file)

    # -- as a value ----------------------------------------------------------------------------------------------------

    def __eq__(self, other: object) -> bool:
        from terrapin_tools.door.saving import same_rows

        if not isinstance(other, Case):
            return NotImplemented
        return self.text == other.text and same_rows(self._case, other._case)

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> Any:
        return Case, (self._case,)

    def __repr__(self) -> str:
        model = " + ".join((self.base, *self.effects))
        said = f"{len(self.runs)} runs, {len(self.held_out)} held out, {self.rows} rows"
        return f"Case({self.title!r}: {model} for {', '.join(self.channels)}; {said})"

    def _with(self, text: str) -> Case:
        return Case(self._case.changed(text))

    def _asked(
        self,
        command: str,
        seed: int,
        level: float,
        bootstrap: int = 0,
        progress: Callable[[str], None] | None = None,
        intervals: bool = False,
    ) -> tuple[Analysis, Story]:
        from terrapin_tools.workbench.fleet.fleet import Question, examine

        for name, count in (("seed", seed), ("bootstrap", bootstrap)):
            if not isinstance(count, Integral) or count < 0:
                raise UserError(f"{name}: found {count!r}, expected a whole number from 0 up")
        if not isinstance(level, Real) or not 0.0 < level < 1.0:
            raise UserError(f"level: found {level!r}, expected a number between 0 and 1")
        seed, level, bootstrap = int(seed), float(level), int(bootstrap)
        key = (command, seed, level, intervals)
        if bootstrap or key not in self._known:
            with _shown(progress if command == "discover" or intervals else lambda _: None) as report:
                found = examine(Question(command, seed, level, bootstrap, intervals), self._case, report)
            if bootstrap:
                return found
            self._known[key] = found
            if len(self._known) > MOST_KNOWN:
                self._known.pop(next(iter(self._known)))
        return self._known[key]


MOST_KNOWN = 4  # answers that a case remembers


@contextmanager
def _shown(progress: Callable[[str], None] | None) -> Iterator[Callable[[str], None]]:
    """Who is told what is done now: `progress`, the notebook's cell, or the terminal."""
    import sys

    from terrapin_tools.progress import steps

    if progress is not None:
        yield progress
    elif "ipykernel" in sys.modules and not sys.stderr.isatty():
        yield lambda text: print(f"\r{text[:78]:78}", end="", flush=True)
        print(f"\r{'':78}\r", end="", flush=True)
    else:
        with steps() as report:
            yield report
