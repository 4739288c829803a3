"""What happened to the measurements on their way in, in sentences: rows left out, units read as turns, a lost sign."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.expression import Expression
from terrapin_tools.workbench.case.mends import Mend
from terrapin_tools.workbench.files.format import meant, parted
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.units import convert, in_si, spelling, turns

__all__ = [
    "BOTH_WAYS", "MARK", "Mapped", "again", "assumed", "beyond", "converted", "copied", "differences", "echoes", "gaps",
    "guesses", "headings", "ungrouped", "unsigned",
]  # fmt: skip

_EXAMPLE = re.compile(r" \('.*?'\)| since .*")  # what differs between files that were read in the same way
MARK = "# assumed: "  # of a first line that says what was assumed when the table was made; every answer repeats it
LONGEST = 1 << 12  # bytes of that line
ROUNDED = 1.05  # values are given with two digits
TELLING = 8  # different rows in one order, from which on they agree by no chance; fewer may be an instrument's steps
ECHO = 1e-4  # of a channel's scatter: what a line of another column leaves that was computed from it, and rounded
BOTH_WAYS = 0.02  # share of the rows in each direction, from which a motion reverses


@dataclass(frozen=True)
class Mapped:
    """One entry of [data.columns]."""

    name: str
    column: str
    unit: str
    canonical: str
    sigma: float | None  # in the canonical unit
    channel: bool
    role: str = ""  # that an input of the user's own names is told to have
    mend: Mend = field(default_factory=Mend)


def assumed(tables: Sequence[Table]) -> list[str]:
    """What was assumed about files, a sentence for each kind of file."""
    kinds: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for table in tables:
        notes = (*table.notes, *_stated(table))
        alike = kinds.setdefault(tuple(_EXAMPLE.sub("", note) for note in notes), {})
        alike.setdefault("; ".join(notes), []).append(table.path.name)
    found = []
    for kind in kinds.values():
        (told, (first, *same)), *others = kind.items()
        also = f" and {len(same)} more" if same else ""
        like = sum(len(each) for _, each in others)
        found += [f"{first}{also}: {told}{f'; {like} more files likewise' if like else ''}."] if told else []
    return found


def _stated(table: Table) -> list[str]:
    """What the first line of a CSV says that it assumes, as `terrapin case merge` writes it."""
    if table.path.suffix.lower() != ".csv":
        return []
    with table.path.open("rb") as file:
        line = file.readline(LONGEST).decode("utf-8", "replace").strip()
    return [line.removeprefix(MARK)] if line.startswith(MARK) else []


def gaps(
    columns: Mapping[str, Array],
    whole: Mask,
    sparse: Sequence[str],
    place: Callable[[int], str],
    lost: Collection[str] = (),
) -> list[str]:
    """Rows without a number in a mapped column (`columns`, by the file's names), and unmapped columns with gaps.

    `place` says where a row stands; `lost` are the runs of which no row is left.
    """
    found = []
    missing = {name: int(np.isnan(values).sum()) for name, values in columns.items()}
    if not whole.all():
        where = ", ".join(f"{name} {count}" for name, count in missing.items() if count)
        count = int((~whole).sum())
        found.append(f"{count} of {len(whole)} rows left out: no number in a mapped column ({where}).")
        found[-1] += f" The first is {place(int(np.argmin(whole)))}."
        found[-1] += f" No row is left of {', '.join(sorted(lost))}." if lost else ""
    if sparse:
        found.append(f"Not looked at, for gaps: {', '.join(sparse)}.")
    return found


def ungrouped(columns: Sequence[str]) -> list[str]:
    """Columns of text that could tell surfaces, robots or days apart, if [groups] named them."""
    if not columns:
        return []
    return [f"Not looked at, for text: {', '.join(columns)} (what differs between groups of runs is for [groups])."]


def converted(mapped: Sequence[Mapped]) -> list[str]:
    """Units that only say how often a time, read as turns."""
    return [
        f"{e.name}: {e.unit} is read as turns, so 1000 of them are {convert(1000.0, e.unit, e.canonical):.5g} "
        f"{e.canonical} (write rad/min or rad/s for the other)."
        for e in mapped
        if turns(e.unit, e.canonical) != e.unit
    ]


def headings(mapped: Sequence[Mapped], tables: Sequence[Table]) -> list[str]:
    """Units in the files' headings that are not those of case.toml, nor the same by another name. Formulas that work on
    numbers as they stand have no units to go by."""
    if all(e.unit == "1" for e in mapped):
        return []
    found = []
    for e in mapped:
        heading = next((one for table in tables if (one := meant(e.column, table.columns))), "")
        said = parted(heading)[1]
        own = spelling(said) if said else e.unit
        with suppress(ValueError):  # what no unit is, or of another kind: `acc [g]` may be taken for gravity's
            if e.unit == "1" and convert(1000.0, own, in_si(own)) != 1000.0:
                found.append(f"{e.name}: read without a unit, and the column's heading says {own}.")
            elif not np.isclose(convert(1000.0, own, e.canonical), convert(1000.0, e.unit, e.canonical), rtol=1e-6):
                found.append(f"{e.name}: read as {e.unit}, and the column's heading says {own}.")
    return found


def differences(formulas: Sequence[Expression], units: Mapping[str, str], on_scale: Collection[str]) -> list[str]:
    """What stands in kelvin beside a temperature in degC: no unit tells whether it is a temperature, too."""
    found = {}
    for formula in formulas:
        for name in sorted(formula.names - formula.divisors):
            if (others := sorted(formula.names & {*on_scale})) and units.get(name) in ("K", "kelvin"):
                found[name] = (
                    f"{name} is in K and {others[0]}, in the same formula, in degC: {name} counts as a difference "
                    f"there. If it is a temperature, state it in degC, or {others[0]} in K."
                )
    return [*found.values()]


def unsigned(values: Mapping[str, Array], told: Mapping[str, str]) -> list[str]:
    """A current that is never negative although the motion goes both ways."""
    speed = next((name for name in (told.get("speed"), told.get("direction"), "omega") if name in values), None)
    current = next((name for name in (told.get("current"), "current") if name in values), None)
    if speed is None or current is None:
        return []
    forward, backward = (values[speed] > 0.0).mean(), (values[speed] < 0.0).mean()
    if min(forward, backward) < BOTH_WAYS or not ((values[current] >= 0.0).all() or (values[current] <= 0.0).all()):
        return []
    return [f"{current} has one sign only although {speed} takes both: it seems to be a magnitude that lost its sign."]


def copied(columns: Sequence[Array], run: Index, names: Sequence[str]) -> list[str]:
    """Runs with the same numbers as another one in every row and mapped column, or with the same rows twice over: a
    measurement that was pasted in twice. Its repeats have no scatter, so that it passes for one without noise."""
    cells = np.column_stack(columns)
    order = np.argsort(run, kind="stable")
    first: dict[bytes, str] = {}
    found = []
    for rows in np.split(order, np.flatnonzero(np.diff(run[order])) + 1):
        name, content = names[run[rows[0]]], cells[rows].tobytes()
        half = content[: len(content) // 2]
        twice = len(rows) % 2 == 0 and content == 2 * half
        other = first.setdefault(content, name)
        if (twice or other != name) and len(np.unique(cells[rows], axis=0)) >= TELLING:
            same = f"its first {len(rows) // 2} rows twice" if twice else f"those of run {other}, row by row"
            found.append(f"The numbers of run {name} are {same}")
    if not found:
        return []
    others = "1 more run holds" if len(found) == 2 else f"{len(found) - 1} more runs hold"
    more = f", and {others} copies" if found[1:] else ""
    why = "their scatter is none, so the noise and every sd come out far too small, and a held-out copy tests nothing"
    return [f"{found[0]}{more}: leave copies of a measurement out; {why}."]


def again(run: Index, names: Sequence[str], place: Callable[[int], str]) -> list[str]:
    """Runs that come back after another one, as where each of two files begins with run 1: they are one run. Of a table
    whose rows are in another order than its runs nothing is said."""
    begins = np.flatnonzero(np.diff(run, prepend=-1))
    if len(begins) > 2 * len(names):
        return []
    back = [name for i, name in enumerate(names) if (run[begins] == i).sum() > 1]
    if not back:
        return []
    first, then = (place(int(row)) for row in begins[run[begins] == names.index(back[0])][:2])
    more = f", and so do {len(back) - 1} more" if back[2:] else ", and so does 1 more" if back[1:] else ""
    what = "If these are several measurements, call them otherwise."
    return [f"Run {back[0]} begins at {first} and again at {then}{more}: it is one run here. {what}"]


def echoes(channels: Mapping[str, Array], beside: Mapping[str, Array]) -> list[str]:
    """Columns that the model does not read and that are a channel over again, times a number and with an offset."""
    found = []
    for channel, measured in channels.items():
        scatter = measured - measured.mean()
        size = float(np.linalg.norm(scatter))
        for name, column in beside.items():
            own = column - column.mean()
            length = float(np.linalg.norm(own))
            if len(scatter) < TELLING or not (0.0 < size < np.inf and 0.0 < length < np.inf):
                continue
            own = own / length
            if np.linalg.norm(scatter - (own @ scatter) * own) < ECHO * size:
                found.append(
                    f"{name} is {channel} over again, times a number: what is computed from the answer explains it and "
                    f"causes nothing. Leave {name} out ([data] ignore) before you believe a term with it."
                )
    return found


def beyond(parameters: Mapping[str, float]) -> list[str]:
    """Moments of inertia that no mass inside the shell can have, in sentences: what is not stated of a robot is
    another one's, and a light robot has masses of its own beside them."""
    found = []
    for part in ("shell", "frame", "bob", "body"):
        names = f"{part}_inertia", f"{part}_mass", "radius"
        if not parameters.keys() >= {*names}:
            continue
        inertia, mass, radius = (parameters[name] for name in names)
        if inertia > ROUNDED * mass * radius**2:
            found.append(
                f"{names[0]} is {inertia:.3g} kg m^2, and {mass:.3g} kg within the radius of {radius:.3g} m has "
                f"{mass * radius**2:.3g} at most: state it, for what is not stated is another robot's."
            )
    return found


def guesses(paths: Sequence[str]) -> list[str]:
    """What `terrapin case` made up and nobody confirmed."""
    if not paths:
        return []
    return [f"Guessed and not confirmed: {', '.join(paths)} (right? then take it out of case.guessed in case.toml)."]
