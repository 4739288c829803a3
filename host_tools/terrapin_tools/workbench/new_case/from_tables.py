"""A case from a user's own tables: roles and units guessed from the names of the columns, to be corrected by hand.

    w_shell [rad/s]  ->  omega in rad/s         i_motor_mA  ->  current in mA         fz (N)  ->  load in N

A guess is by whole words of the name and by the unit; what has a unit of another kind is never taken. Everything that
was guessed stands in case.toml with a comment, and everything that was not as well.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from terrapin_hil.physics.expression import is_name
from terrapin_tools.errors import UserError, about
from terrapin_tools.workbench.bases import BASES, CHANNELS, ROLES, Base
from terrapin_tools.workbench.bases.kinds.names import free_name, in_letters
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.format import Asked, meant
from terrapin_tools.workbench.files.split_runs import TIMES
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.times import clock_name
from terrapin_tools.workbench.files.writing import write_new
from terrapin_tools.workbench.new_case.offers import offers, suiting
from terrapin_tools.workbench.new_case.offers import told as told_offers
from terrapin_tools.workbench.new_case.reading import (
    Ask,
    assumptions,
    first_gap,
    guess_groups,
    read_all,
    refuse,
    told_gaps,
    told_others,
    told_repeats,
    with_runs,
)

FEW_RUNS = 2  # of which none is held out: one run alone does not tell what differs between runs

__all__ = [
    "Guess", "base_of", "clock_of", "distinct_names", "guess_base", "guess_columns", "guess_run", "split_unit",
    "write_table_case",
]  # fmt: skip

SUFFIXES = {  # endings of names that are units, longest first where one ends another
    "rad_per_s": "rad/s", "rad_s2": "rad/s^2", "rad_s": "rad/s", "radps": "rad/s", "rpm": "rpm", "deg_s": "deg/s",
    "m_s2": "m/s^2", "mm_s": "mm/s", "cm_s": "cm/s", "m_s": "m/s", "mps": "m/s", "km_h": "km/h", "kmh": "km/h",
    "mn_m": "mN m", "mnm": "mN m", "n_m": "N m", "nm": "N m", "kpa": "kPa", "pa": "Pa", "ma": "mA", "a": "A",
    "mv": "mV", "v": "V", "kn": "kN", "mn": "mN", "n": "N", "mm": "mm", "cm": "cm", "m": "m", "ms": "ms", "s": "s",
    "mrad": "mrad", "rad": "rad", "degc": "degC", "celsius": "degC", "degf": "degF", "deg": "deg", "pct": "percent",
    "percent": "percent", "kg": "kg", "ohm": "ohm", "mbar": "mbar", "bar": "bar", "mpa": "MPa", "l_min": "L/min",
    "hz": "Hz", "kw": "kW", "kj": "kJ", "us": "us",
}  # fmt: skip
# endings that are a unit as they are written only, and words beside which they are; "": beside any
LETTERS = {
    "C": ("degC", "temp temperature t room ambient oil water coil lab winding case air board motor bath"),
    "K": ("K", ""),
    "W": ("W", "q qc qh p power heat loss losses pin pout"),
    "h": ("h", "time clock t since"),
}
WORDS = {  # role or channel -> words of a name that stand for it, and words beside which they do not
    "time": ("time t clock timestamp stamp seconds", ""),  # and TIMES
    "omega": ("omega w rpm wheel shell rim speed rate velocity", "motor ground joint fl fr rl rr"),
    "acceleration": ("acceleration acc accel alpha", ""),
    "angle": ("angle theta rotation turn", "slip friction swing steer pitch roll rolling yaw"),
    "slip": ("slip s", "angle side"),
    "speed": ("speed velocity vel v travel ground axle forward", "rim motor fan wind"),
    "load": ("load weight w fz normal vertical z", ""),
    "slope": ("slope incline inclination grade pitch", ""),
    "temperature": ("temperature temp tw winding", "room board ambient oil gearbox air"),
    "pass": ("pass passes", ""),
    "moisture": ("moisture water", ""),
    "voltage": ("voltage volt volts u", "board supply"),
    "joint_rate": ("joint psi hinge commanded", ""),
    "drive_torque": ("drive halfshaft shaft td torque", ""),
    **{name: words for base in BASES.values() for name, words in base.column_words.items()},
}
OTHERWISE = {  # what a channel of that kind is beside other columns: a car's wheels, a sphere's joint
    "torque": "drive_torque", "angle": "rolling_angle",
}  # fmt: skip
PLAIN = Asked()
CLOCK = 1000  # score of the seconds beside a column of times: above that of any name
NAMED = 3  # columns with text between numbers whose first text is told
RUN_WORDS = ("run", "test", "trial", "experiment", "series", "id", "versuch", "lauf", "messung", "essai")


@dataclass(frozen=True)
class Guess:
    """One column: the unit read from its name ("" for none) and the role or channel it may be (None for neither)."""

    column: str
    unit: str
    name: str | None


def split_unit(column: str) -> tuple[str, str]:
    """Name and unit (pint's spelling, "" when none is given).

    >>> split_unit("w_shell [rad/s]"), split_unit("i_motor_mA"), split_unit("slip"), split_unit("fz (N)")
    (('w_shell', 'rad/s'), ('i_motor', 'mA'), ('slip', ''), ('fz', 'N'))
    >>> split_unit("coil_temp_C"), split_unit("phase_C"), split_unit("dT_K"), split_unit("time_of_day_h")
    (('coil_temp', 'degC'), ('phase_C', ''), ('dT', 'K'), ('time_of_day', 'h'))
    >>> split_unit("Zeit in Sekunden"), split_unit("Kraft [Newton]"), split_unit("speed, metres per second")
    (('Zeit', 's'), ('Kraft', 'N'), ('speed', 'm/s'))
    """
    bracket = re.fullmatch(r"\s*(.+?)\s*[\[(]\s*([^\])]*)\s*[\])]\s*", column)
    if bracket:
        unit = units.spelling(bracket[2])
        try:
            units.check(unit)
        except ValueError:
            return column, ""
        return bracket[1], unit
    if (said := units.behind_words(column))[1]:
        return said
    for letter, (unit, beside) in LETTERS.items():
        name = column.removesuffix(f"_{letter}")
        if name != column and name and (not beside or {*beside.split()} & {*_words(name)}):
            return name, unit
    low = column.lower()
    for ending, unit in SUFFIXES.items():
        if low.endswith("_" + ending) and len(low) > len(ending) + 1:
            return column[: -len(ending) - 1], unit
    return column, ""


def _words(name: str) -> list[str]:
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    words = [word for word in re.split(r"[^a-z]+", parted.lower()) if word]
    return ["time" if word in TIMES else word for word in words]


def _score(name: str, unit: str, target: str) -> int:
    """0 for no match; higher for a unit that fits and for words that stand early in the list."""
    canonical = {**ROLES, **CHANNELS}[target]
    if unit and not units.same_kind(unit, canonical):
        return 0
    if not unit and target == "omega" and "omega" not in _words(name) and "rpm" not in _words(name):
        return 0  # a speed without a unit may be either
    yes, no = (entry.split() for entry in WORDS[target])
    words = _words(name)
    if any(word in no for word in words):
        return 0
    hits = [len(yes) - yes.index(word) for word in words if word in yes]
    return 10 * len(hits) + max(hits) + (100 if unit else 0) if hits else 0


def guess_columns(names: Sequence[str], texts: Collection[str] = ()) -> list[Guess]:
    """What each numeric column may be; each role and channel is given to the column that fits it best. The seconds
    beside one of the columns of text are a time, whatever they are called."""
    parts = {column: split_unit(column) for column in names}
    clocks = {clock_name(text) for text in texts}
    scored = sorted(
        (
            (CLOCK if target == "time" and column in clocks else _score(*parts[column], target), column, target)
            for column in names
            for target in WORDS
        ),
        key=lambda entry: -entry[0],
    )
    given: dict[str, str] = {}
    for score, column, target in scored:
        if score > 0 and column not in given and target not in given.values():
            given[column] = target
    for name, other in OTHERWISE.items():
        instead = {column: other if target == name else target for column, target in given.items()}
        if other not in given.values() and _likeness(instead) > _likeness(given):
            given = instead
    return [Guess(c, parts[c][1], given.get(c)) for c in names]


def _likeness(given: Mapping[str, str]) -> int:
    return max(base.resembles({*given.values()}, ()) for base in BASES.values())


def write_table_case(
    folder: Path,
    files: Sequence[Path],
    title: str,
    columns: Mapping[str, str] | None = None,
    told: Mapping[str, str] | None = None,
    ask: Ask = refuse,
    asked: Asked = PLAIN,
    show: Callable[[str], object] = print,
    chosen: str = "",
    robot: Mapping[str, float] | None = None,
) -> str:
    """Write case.toml into the (new) folder, naming the tables where they lie; returns what was guessed, in words.

    Parameters
    ----------
    columns, told : column and unit of a role or channel, as far as they are known.
    ask : is asked what the names leave open, a unit or one of several columns.
    asked : how the files are to be read. show : is given what was assumed of them, before anything is written.
    chosen : the base model; else that of those which suit the columns that a brief fit finds best.
    robot : constants [SI] of a robot's file, by the names of parameters: stated, neither guessed nor fitted.

    Raises
    ------
    UserError : the folder holds a case, a file cannot be read, no number column is found, or something is left open.
    """
    taken = UserError(f"{folder / 'case.toml'}: exists, expected a new folder for the case")
    if (folder / "case.toml").exists():
        raise taken
    found = replace(_gathered(files, asked, ask, columns or {}, told or {}, chosen), robot=robot or {})
    tables, guesses = found.tables, found.guesses
    base, offered = _chosen(found, files, title, chosen)
    if robot and robot.keys().isdisjoint(base.parameters):
        raise UserError(f"--robot: none of a robot's constants is one of {base.name}, expected no robot beside it")
    document = _document(folder, files, title, base, found)
    assumed = assumptions(tables)
    if assumed:
        show(assumed)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        write_new(folder / "case.toml", document)
    except FileExistsError:
        raise taken from None
    lines = [
        *offered,
        f"{folder / 'case.toml'}: {base.name}, {found.runs} runs; guessed from the columns' names, to be corrected:",
    ]
    used = _mapped(guesses, base)
    for guess, name in zip(used, _names(used, base), strict=True):
        unit = guess.unit or _unit(name, base)
        note = "" if guess.unit else "  (unit assumed)"
        lines.append(f"  {guess.column} = {name}, {unit}{note}")
    rest = [guess.column for guess in guesses if guess not in used]
    if rest:
        lines.append(f"Not mapped (discover looks at them all the same): {', '.join(rest)}")
    lines += [f"Groups of runs by {name}: {', '.join(values)}" for name, values in found.groups.items()]
    text = [name for name in found.text if name not in found.groups]
    words = [name for name in text if not any(_has_numbers(table, name) for table in tables)]
    if words:
        lines.append(f"Not numbers: {', '.join(words)}")
    mixed = [name for name in text if name not in words]
    lines += [f"Left out: {found.wrong[name]}" for name in mixed[:NAMED]]
    if len(mixed) > NAMED:
        lines.append(f"Left out, too, for text between numbers: {', '.join(mixed[NAMED:])}")
    gaps = {g.column: sum(_gaps(t, g.column) for t in tables) for g in used}
    if any(gaps.values()):
        named = ", ".join(f"{name} {count}" for name, count in gaps.items() if count)
        lines.append(f"Rows with a gap in a mapped column will be left out: {named}.")
        lines[-1] += f" The first is {first_gap(tables, list(gaps))}."
    lines += [
        *_shared_names(tables, found.run, text),
        *told_gaps(tables, found.asked, found.run),
        *told_repeats(tables),
        *found.others,
    ]
    if found.run is None:
        lines.append("No column names the run: each file is one.")
    if few := found.too_few():
        both = "The one run is" if len(few) == 1 else "Both runs are"
        lines.append(f"{both} trained on, for none can be spared: hold further runs out to try what is found.")
    lines.append("Lines marked CHECK hold what no table can tell.")
    return "\n".join(lines)


@dataclass(frozen=True)
class _Gathered:
    """Tables as they were read, the column that names the run, and what the names say. `wrong`: why a column is no
    number, "" where it is one."""

    tables: list[Table]
    asked: Asked
    run: str | None
    runs: int
    others: list[str]
    wrong: dict[str, str]
    guesses: list[Guess]
    text: list[str]
    groups: dict[str, list[str]]
    robot: Mapping[str, float] = field(default_factory=dict)

    def too_few(self) -> list[str]:
        """The runs' names, where there are so few that a model of what differs between them needs each."""
        if self.runs > FEW_RUNS:
            return []
        run = self.run
        return sorted({n for t in self.tables for n in ([t.path.stem] if run is None else t.text(run))})


def base_of(file: Path, asked: Asked = PLAIN) -> tuple[Base, list[str]]:
    """The base model that `write_table_case` would take for a table, and what it would say of it and of others.

    UserError as there.
    """
    return _chosen(_gathered([file], asked, refuse, {}, {}, ""), [file.resolve()], "", "")


def _gathered(
    files: Sequence[Path], asked: Asked, ask: Ask, columns: Mapping[str, str], told: Mapping[str, str], chosen: str
) -> _Gathered:
    tables, asked = read_all(files, asked, ask)
    common = [name for name in tables[0].columns if all(name in table.columns for table in tables)]
    if not common:
        raise UserError(f"{files[0]}: has no column in common with the others, expected tables of one kind")
    run, runs = _run_column(tables, common, asked)
    tables, asked = with_runs(tables, run, asked)
    common = [name for name in tables[0].columns if all(name in table.columns for table in tables)]
    run, runs = _run_column(tables, common, asked)
    others = told_others(tables, common)
    if not any(table.rows for table in tables):
        raise UserError(f"{files[0]}: found no row below the column names, expected at least one")
    wrong = {name: _no_number(tables, name) for name in common if name != run}
    numeric = [name for name, why in wrong.items() if not why]
    if not numeric:
        why = next(iter(wrong.values()), f"only {run}, which names the run")
        hint = next((f"; {note}" for note in tables[0].notes if "--read" in note), "")  # of _above_names
        raise UserError(f"{files[0]}: found no column of numbers ({why}), expected at least one{hint}")
    texts = [name for name, why in wrong.items() if why]
    guesses = _settled(_pinned(guess_columns(numeric, texts), columns), columns, told, ask, chosen)
    text = [name for name in wrong if name not in numeric and not _is_time(name, common)]
    groups = guess_groups(tables, run, text)
    return _Gathered(tables, asked, run, runs, others, wrong, guesses, text, groups)


def _pinned(guesses: Sequence[Guess], columns: Mapping[str, str]) -> list[Guess]:
    """The guesses, with the columns that are known."""
    name_of: dict[str, str] = {}
    for name, column in columns.items():
        if name not in WORDS:
            raise UserError(f"--column: found {name!r}, expected one of {', '.join(WORDS)}")
        found = meant(column, [guess.column for guess in guesses])
        if found is None:
            expected = ", ".join(guess.column for guess in guesses)
            raise UserError(f"--column: found {column!r}, expected one of {expected}")
        name_of[found] = name
    return [replace(g, name=name_of.get(g.column, None if g.name in columns else g.name)) for g in guesses]


def _chosen(read: _Gathered, files: Sequence[Path], title: str, wanted: str) -> tuple[Base, list[str]]:
    """The base model, and what is said of it and of others that suit the columns."""
    likely = _wanted(read.guesses, wanted)
    suit = suiting([guess.name for guess in read.guesses])
    if likely not in suit:
        return likely, []

    def document(base: Base, place: Path) -> str:
        return _document(place, files, title, base, read)

    found = offers(suit, document, sum(table.rows for table in read.tables))
    best = likely if wanted or found[0].why else found[0].base
    return best, told_offers(found, best)


def _wanted(guesses: Sequence[Guess], wanted: str) -> Base:
    if not wanted:
        return guess_base(guesses)
    if wanted not in BASES or BASES[wanted].own_dynamics:
        expected = ", ".join(name for name, base in BASES.items() if not base.own_dynamics)
        why = ", whose equations are yours to write in case.toml (docs/ode.md);" if wanted in BASES else ","
        raise UserError(f"--base: found {wanted!r}{why} expected one of {expected}")
    base, names = BASES[wanted], {guess.name for guess in guesses}
    lacking = [role for role, placeholder in base.needs.items() if not placeholder and role not in names]
    if not base.own_names and (lacking or base.channels.keys().isdisjoint(names)):
        inputs = ", ".join(role for role, placeholder in base.needs.items() if not placeholder)
        found = ", ".join(str(guess.name) for guess in guesses if guess.name) or "none"
        channels = " or ".join(base.channels)
        raise UserError(f"--base {wanted}: found columns for {found}, expected {inputs} and {channels}: say --column")
    return base


def _settled(
    guesses: Sequence[Guess], columns: Mapping[str, str], told: Mapping[str, str], ask: Ask, wanted: str = ""
) -> list[Guess]:
    """The guesses without a doubt: of columns that fit as well as another, and of units that no name tells."""
    base = _wanted(guesses, wanted)
    if base.own_names:
        if told:
            raise UserError(f"--unit: found {next(iter(told))}, expected --base too: no base model has these columns")
        return list(guesses)
    found = list(guesses)
    for guess in _mapped(guesses, base):
        name = str(guess.name)
        score = _score(*split_unit(guess.column), name)
        rivals = [g.column for g in guesses if g.name is None and _score(*split_unit(g.column), name) == score]
        if rivals and name not in columns:
            choices = [guess.column, *rivals]
            chosen = ask(f"Which column is the {name}?", choices, f"--column {name}=COLUMN")
            found = _pinned(found, {name: chosen})
    for guess in _mapped(found, base):
        name = str(guess.name)
        canonical, unit = _unit(name, base), told.get(name, guess.unit)
        if not unit and canonical != "1":
            unit = ask(f"What is the unit of {guess.column} ({name})?", [canonical], f"--unit {name}=UNIT")
        if unit:
            with about(f"--unit: {name}"):
                units.convert(1.0, unit, canonical)
        found[[g.column for g in found].index(guess.column)] = replace(guess, unit=unit)
    unknown = next((name for name in told if name not in [guess.name for guess in found]), None)
    if unknown is not None:
        expected = ", ".join(str(guess.name) for guess in _mapped(found, base))
        raise UserError(f"--unit: found {unknown}, expected one of {expected}")
    return found


def _shared_names(tables: Sequence[Table], run: str | None, text: Sequence[str]) -> list[str]:
    """A warning for each column of words that differs within a run: two runs may have the same name.

    Numbers with gaps and time stamps differ from row to row: they say nothing about the run.
    """
    if run is None:
        return []
    found = []
    for name in text:
        pairs = {(r, word) for table in tables for r, word in zip(table.text(run), table.text(name), strict=True)}
        words = all(re.search(r"[^\W\d]", word) for _, word in pairs)
        if words and len({r for r, _ in pairs}) < len(pairs) <= sum(table.rows for table in tables) // 2:
            found.append(
                f"{name} differs within a {run}: are several runs named alike? Then join both into one column."
            )
    return found


def _no_number(tables: Sequence[Table], name: str) -> str:
    """Where a column has no number, and what stands there; empty where all cells are numbers."""
    try:
        if all(np.isnan(table.numbers(name, gaps=True)).all() for table in tables):
            return f"{tables[0].place(0)}: column {name}: found gaps only, expected a number"
    except UserError as error:
        return str(error)
    return ""


def _gaps(table: Table, name: str) -> int:
    return int(np.isnan(table.numbers(name, gaps=True)).sum())


def _has_numbers(table: Table, name: str) -> bool:
    return any(re.fullmatch(r"[-+]?\d+\.?\d*(e[-+]?\d+)?", cell, re.IGNORECASE) for cell in table.text(name))


def _is_time(name: str, names: Sequence[str]) -> bool:
    """Whether a column of text stands as seconds beside itself."""
    return clock_name(name) in names


def guess_run(names: Sequence[str]) -> str | None:
    """The column that by its name tells the runs apart."""
    return next((name for word in RUN_WORDS for name in names if word in _words(name)), None)


def _run_column(tables: Sequence[Table], common: Sequence[str], asked: Asked) -> tuple[str | None, int]:
    """The column that names the run and the number of runs; without one each file is a run."""
    kind, _, told = asked.runs.partition(":")
    if kind == "column":
        column = meant(told, common)
        if column is None:
            raise UserError(f"runs: found column {told!r}, expected one of {', '.join(common)}")
        return column, len({value for table in tables for value in table.text(column)})
    for word in RUN_WORDS:
        for name in common:
            if word in _words(name):
                distinct = {value for table in tables for value in table.text(name)}
                if 1 < len(distinct) <= max(2, sum(table.rows for table in tables)):
                    return name, len(distinct)
    return None, len(tables)


def guess_base(guesses: Sequence[Guess]) -> Base:
    """The base model whose roles and channels the columns seem to be; that of the user's own names for none of them."""
    names = {guess.name for guess in guesses}
    words = {word for guess in guesses for word in _words(guess.column)}
    likeness = {name: base.resembles(names, words) for name, base in BASES.items()}
    best = max(likeness, key=lambda name: (likeness[name], BASES[name].own_names))
    return BASES[best]


def _mapped(guesses: Sequence[Guess], base: Base) -> list[Guess]:
    allowed = {*ROLES, *base.channels} - base.left_out.keys()
    return [guess for guess in guesses if base.own_names or guess.name in allowed]


def _unit(name: str, base: Base) -> str:
    """The unit that a role or channel has where a column's name tells none."""
    return "1" if base.own_names else {**ROLES, **base.channels}[name]


def _name(column: str) -> str:
    plain = in_letters(split_unit(column)[0]).lower()
    return plain if is_name(plain) else f"c_{plain}"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


HEAD = """# Guessed by `terrapin case` from the names of the columns. Correct what is wrong; docs/cases.md says
# what can stand here. Then: terrapin compare, terrapin discover.

[case]
title = {title}
{guessed}
[model]
base = {base}
effects = []
"""


def _document(folder: Path, files: Sequence[Path], title: str, base: Base, read: _Gathered) -> str:
    mapped = _mapped(read.guesses, base)
    own = (
        _equation(mapped, base)
        if base.own_names
        else _constants(base, {str(guess.name) for guess in mapped}, read.robot)
    )
    made_up = [name for name in _made_up(own) if name.removeprefix("parameters.") not in read.robot]
    if base.own_names:
        made_up = [f"model.equation.{_names(mapped, base)[_predicted(mapped)]}"]
    told = f"guessed = [{', '.join(map(_quoted, made_up))}]  # take out what you have confirmed\n" if made_up else ""
    lines = [HEAD.format(title=_quoted(title), base=_quoted(base.name), guessed=told), *own]
    near = [os.path.relpath(file.resolve(), folder.resolve()) for file in files]
    lines += ["", "[data]", f"files = [{', '.join(_quoted(name) for name in near)}]"]
    lines.append(
        f"run = {_quoted(read.run)}" if read.run is not None else "# run = ...  # no column names it: each file is one"
    )
    if few := read.too_few():
        lines.append(f"train = [{', '.join(map(_quoted, few))}]  # too few to hold one out")
    if said := read.asked.said():
        lines += ["", "[data.read]", *(f"{key} = {_quoted(value)}" for key, value in said.items())]
    if groups := read.groups:
        own_names = distinct_names(groups)
        lines += ["", "[groups]  # of runs; a parameter with by = NAME has a value for each"]
        lines += [f"{n} = {{ column = {_quoted(c)} }}  # {', '.join(groups[c])}" for c, n in own_names.items()]
    lines += ["", "[data.columns]  # give channels sigma = ... where the noise of one row is known"]
    for guess, name in zip(mapped, _names(mapped, base), strict=True):
        unit = guess.unit or _unit(name, base)
        note = "  # CHECK the unit: assumed" if not guess.unit else ""
        lines.append(f"{name} = {{ column = {_quoted(guess.column)}, unit = {_quoted(unit)} }}{note}")
    for guess in read.guesses:
        if guess not in mapped:
            why = base.left_out.get(guess.name or "")
            lines.append(f"# {guess.column}: {f'left out: {why}' if why else 'not mapped'}")
    return "\n".join(lines) + "\n"


def _names(mapped: Sequence[Guess], base: Base) -> list[str]:
    """What each column is called in case.toml, none twice."""
    if not base.own_names:
        return [str(guess.name) for guess in mapped]
    return list(distinct_names([guess.column for guess in mapped], clock_of(mapped)).values())


def clock_of(guesses: Iterable[Guess]) -> str:
    """The column that is the time, "" where none is."""
    return next((guess.column for guess in guesses if guess.name == "time"), "")


def distinct_names(columns: Sequence[str] | Mapping[str, object], clock: str = "") -> dict[str, str]:
    """Column -> a name that case.toml can use, none twice; that of the clock is `time`, which is no setting.

    >>> distinct_names(["\u00d6ltemperatur [\u00b0C]", "5 V rail", "T_K", "T [degC]"])
    {'\u00d6ltemperatur [\u00b0C]': 'oeltemperatur', '5 V rail': 'c_5_v_rail', 'T_K': 't', 'T [degC]': 't_'}
    """
    found: dict[str, str] = {}
    taken = {"time"} if clock else set[str]()
    for column in columns:
        found[column] = "time" if column == clock else free_name(_name(column), taken)
        taken.add(found[column])
    return found


def _says_time(guess: Guess) -> bool:
    """Also of a second clock, which has another role or none, since the first one is `time`."""
    time, own = (_score(*split_unit(guess.column), name) for name in ("time", guess.name or "time"))
    return guess.name == "time" or 0 < time >= own


def _predicted(mapped: Sequence[Guess]) -> int:
    """The last column that is no time. UserError where every column is one."""
    found = [i for i, guess in enumerate(mapped) if not _says_time(guess)]
    if not found:
        times = ", ".join(guess.column for guess in mapped)
        raise UserError(f"found times only ({times}), expected a column that is predicted; terrapin case map takes any")
    return found[-1]


def _equation(mapped: Sequence[Guess], base: Base) -> list[str]:
    """A straight line through the last column over the first, none of them a time: a start to write the right one
    over."""
    names, last = _names(mapped, base), _predicted(mapped)
    channel, inputs = names[last], [*names[:last], *names[last + 1 :]]
    likely = [name for guess, name in zip(mapped, names, strict=True) if name != channel and not _says_time(guess)]
    likely = likely or inputs
    formula = f"offset + gradient*{likely[0]}" if inputs else "offset"
    lines = ["# CHECK: which column is predicted, and by what", "[model.equation]", f"{channel} = {_quoted(formula)}"]
    lines += ["", "[fit]", "offset = { value = 0.0 }"]
    return [*lines, "gradient = { value = 1.0 }"] if inputs else lines


def _made_up(lines: Sequence[str]) -> list[str]:
    """Where the placeholders of [parameters] stand, which come before [fit]."""
    parameters = list(takewhile(lambda line: line != "[fit]", lines))[1:]
    return [f"parameters.{line.partition(' =')[0]}" for line in parameters if line and not line.startswith("#")]


def _constants(base: Base, roles: set[str], robot: Mapping[str, float]) -> list[str]:
    """The robot's constants, placeholders for what else no table can tell, and what is fitted."""
    stated = {
        name: f"{robot[name]:.10g} {q.unit}".removesuffix(" 1") for name, q in base.parameters.items() if name in robot
    }
    fitted = {name: entry for name, entry in base.first_fit.items() if name not in stated}
    known = {name: q.placeholder for name, q in base.parameters.items() if name not in {*fitted, *stated}}
    known.update({role: text for role, text in base.needs.items() if role not in roles})
    lines = ["[parameters]  # CHECK every line: placeholders, no table can tell them"]
    if stated:
        lines = ["[parameters]  # of the robot, as its file says"]
        lines += [f"{name} = {_quoted(text) if ' ' in text else text}" for name, text in stated.items()]
        lines += ["# CHECK: placeholders, no table can tell them"] if any(known.values()) else []
    lines += [f"{name} = {_quoted(text) if ' ' in text else text}" for name, text in known.items() if text]
    needed = [name for name, text in known.items() if not text]
    lines += [f"# {name}: no column was found for it, and the model needs it" for name in needed]
    return [*lines, "", "[fit]", *(f"{name} = {entry}" for name, entry in fitted.items())]
