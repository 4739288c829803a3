"""Dates and clock times as seconds, true and false as 1 and 0.

    12:00:00,250   3.2.2026 14:05   2026-02-03T12:00:00+01:00   03-Feb-2026 12:00:00   2:05:10 PM

A column of them stays as it is, and `NAME [s]` beside it holds the seconds since its first. A clock without a date that
goes on behind midnight goes on counting. A date that may be the 3rd of April or the 4th of March is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from datetime import date

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Ambiguous, Asked, Column, parted
from terrapin_tools.workbench.files.number_marks import GAPS

__all__ = ["clock_name", "has_times", "is_clock_format", "is_time", "switched", "timed"]

HALF_DAY, DAY = 43200.0, 86400.0
MANY = 10_000  # rows
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?")
SOME = 200  # cells by which a column is taken for times
PAIRS = ({"true", "false"}, {"on", "off"}, {"yes", "no"}, {"wahr", "falsch"}, {"ja", "nein"}, {"vrai", "faux"})
ONES = {"true", "on", "yes", "wahr", "ja", "vrai"}
MONTHS = dict(
    zip(["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"], range(1, 13), strict=True)
)
ZONES = {"z": 0, "utc": 0, "gmt": 0, "wet": 0, "west": 1, "cet": 1, "mez": 1, "cest": 2, "mesz": 2, "eet": 2, "eest": 3}
_MOMENT = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/. ](?:\d{1,2}|[A-Za-z]{3})[-/. ](?:\d{4}|\d\d)))?"
    r"(?:[T ]\s*|,\s*|^|$)"
    r"(?:(?P<clock>\d{1,4}:\d\d(?::\d\d)?(?:[.,]\d{1,9})?)\s*(?P<half>[AaPp]\.?[Mm]\.?)?)?"
    r"\s*(?P<zone>Z|[A-Za-z]{3,4}|(?:UTC|GMT)?[+-]\d\d(?::?\d\d)?)?"
)
# How a clock or a date is written, in place of its unit: hh:mm:ss.mmm, TT.MM.JJJJ hh:mm.
_FORMAT = re.compile(
    r"(?:(?:[dt]{1,2}|m{1,3}|[yj]{2,4})(?:[-/.](?:[dt]{1,2}|m{1,3}|[yj]{2,4})){2})?[t ]?"
    r"(?:(?:h{1,2}:)?m{1,2}:s{1,2}(?:[.,:][a-z0]{1,9})?|h{1,2}:m{1,2})?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class _Moment:
    """A cell: days since 1970, or the three numbers of a date whose order is open; seconds of the day; zone [s]."""

    day: int | None
    open: tuple[int, int, int] | None  # two that may be day and month, the year
    clock: tuple[float, ...]
    zone: float | None


def timed(
    columns: Mapping[str, Column], asked: Asked, texts: Collection[str], place: Callable[[int], str]
) -> tuple[dict[str, Column], list[str]]:
    """The columns with seconds beside times, and what was assumed. Columns in `texts` name runs or groups.

    Ambiguous for a date with a clock that may be read in two ways, and for 12:05, which may be minutes and seconds.
    """
    found = dict(columns)
    notes = []
    moments = {}
    for name, column in columns.items():
        if column.dtype.kind != "U" or name in texts:
            continue
        plain = _iso(column)
        if plain is not None:
            found[_free(name, columns)] = plain
            notes.append(f"{name} as time: [s] since {column[0]}")
            continue
        read = _moments(column)
        if read is None:
            continue
        moments[name] = read
        wrong = next((i for i, each in enumerate(read) if each is None and not _is_gap(str(column[i]))), None)
        if wrong is not None:
            notes.append(f"{name} stays text, as {place(wrong)} has no time in it: {shorten(str(column[wrong]))}")
            del moments[name]
    dates = [name for name, read in moments.items() if all(not m.clock for m in read if m)]
    for name, read in moments.items():
        if name in dates:
            continue
        there = [m for m in read if m is not None]
        zones = {m.zone is None for m in there}
        dated = {m.day is None and m.open is None for m in there}
        if len(zones) > 1 or len(dated) > 1:
            what = "zone" if len(zones) > 1 else "date"
            notes.append(f"{name} stays text, as some of its times have a {what} and some have none")
            continue
        beside = moments[dates[0]] if len(dates) == 1 and dated == {True} else None
        seconds, told = _seconds(name, read, beside, asked, place)
        if np.isnan(seconds).all():
            continue
        first = int(np.flatnonzero(~np.isnan(seconds))[0])
        also = f" and {dates[0]}" if beside else ""
        told.insert(0, f"{name}{also} as time: [s] since {columns[name][first]}")
        found[_free(name, columns)] = seconds - seconds[first]
        notes.append(", ".join(told))
    for name in dates:
        read = moments[name]
        if len(moments) > len(dates) or any(m and m.open for m in read) or len(read) < 3:
            continue  # of a clock beside it, or to name groups by
        days = np.array([np.nan if m is None or m.day is None else DAY * m.day for m in read])
        if (np.diff(days) > 0).all():
            found[_free(name, columns)] = days - days[0]
            notes.append(f"{name} as time: [s] since {columns[name][0]}")
    return found, notes


def is_clock_format(text: str) -> bool:
    """Whether a text says how times are written.

    >>> is_clock_format("hh:mm:ss.mmm"), is_clock_format("TT.MM.JJJJ"), is_clock_format("mm"), is_clock_format("")
    (True, True, False, False)
    >>> is_clock_format(" mm:ss "), is_clock_format("   "), is_clock_format(" t ")
    (True, False, False)
    """
    bare = text.strip()
    return len(bare) > 1 and _FORMAT.fullmatch(bare) is not None


def is_time(cell: str) -> bool:
    """Whether a cell is a date or a clock time."""
    return _moment(cell) is not None


def clock_name(column: str) -> str:
    """What the seconds beside a column of times are called.

    >>> clock_name("Zeit"), clock_name("Zeit [hh:mm:ss.mmm]")
    ('Zeit [s]', 'Zeit [s]')
    """
    bare, unit = parted(column)
    return f"{bare if is_clock_format(unit) else column} [s]"


def _free(column: str, columns: Mapping[str, Column]) -> str:
    """`clock_name`, numbered where the file has such a column itself."""
    name, number = clock_name(column), 1
    while name in columns:
        number += 1
        name = f"{clock_name(column).removesuffix(' [s]')} {number} [s]"
    return name


def has_times(columns: Mapping[str, Column]) -> bool:
    """Whether the first cells of a column look like times, or true and false."""
    return any(c.dtype.kind == "U" and (_looks(c) or _pair(c[:SOME]) is not None) for c in columns.values())


def switched(columns: Mapping[str, Column], texts: Collection[str]) -> tuple[dict[str, Column], list[str]]:
    """The columns with true and false, on and off, yes and no as 1 and 0; and which these are."""
    found, notes = dict(columns), []
    for name, column in columns.items():
        if (
            column.dtype.kind != "U"
            or name in texts
            or _pair(column[:SOME]) is None
            or (words := _pair(column)) is None
        ):
            continue
        one = next((word for word in words if word in ONES), "")
        low = np.char.lower(np.char.strip(column))
        found[name] = np.where(np.isin(low, [*GAPS]), np.nan, (low == one).astype(np.float64))
        notes.append(f"{name}: " + ", ".join(f"{word} is {int(word == one)}" for word in sorted(words)))
    return found, notes


def _pair(column: Column) -> set[str] | None:
    words = {word for word in (str(cell).strip().lower() for cell in set(column.tolist())) if not _is_gap(word)}
    return words if words and any(words <= pair for pair in PAIRS) else None


def _is_gap(cell: str) -> bool:
    return cell.strip().lower() in GAPS


def _looks(column: Column) -> bool:
    some = [cell for cell in map(str, column[:SOME].tolist()) if not _is_gap(cell)]
    return bool(some) and 2 * sum(_moment(cell) is not None for cell in some) > len(some)


def _iso(column: Column) -> npt.NDArray[np.float64] | None:
    """Seconds since the first of many moments as ISO 8601 has them without a zone, in one go; None for others."""
    if len(column) < MANY or _ISO.fullmatch(str(column[0])) is None:
        return None
    try:
        moments = column.astype("datetime64[ns]")
    except ValueError:
        return None
    steps = moments - moments[0]
    return np.where(np.isnat(moments), np.nan, steps.astype(np.int64) * 1e-9)


def _moments(column: Column) -> list[_Moment | None] | None:
    """What each cell says; None for a column that is none of times."""
    return [_moment(cell) for cell in map(str, column.tolist())] if _looks(column) else None


def _moment(cell: str) -> _Moment | None:
    cell = cell.strip()
    match = _MOMENT.fullmatch(cell) if cell[:1].isdigit() else None
    if match is None or not (match["date"] or match["clock"]) or (match["zone"] and not match["clock"]):
        return None
    day, open_ = None, None
    if match["date"]:
        try:
            day, open_ = _date(match["date"])
        except (ValueError, KeyError):
            return None
    zone = None
    if match["zone"]:
        try:
            zone = _zone(match["zone"])
        except (ValueError, KeyError):
            return None
    clock: tuple[float, ...] = ()
    if match["clock"]:
        clock = tuple(float(part.replace(",", ".")) for part in match["clock"].split(":"))
        if any(part >= 60.0 for part in clock[1:]) or (match["date"] and clock[0] > 24.0):
            return None
        if len(clock) == 2 and (match["date"] or match["half"]):
            clock = (*clock, 0.0)
        if match["half"]:
            if not 1.0 <= clock[0] <= 12.0:
                return None
            clock = (clock[0] % 12.0 + 12.0 * (match["half"][0] in "Pp"), *clock[1:])
    return _Moment(day, open_, clock, zone)


def _date(text: str) -> tuple[int | None, tuple[int, int, int] | None]:
    """Days since 1970; or day and month, whose order is open, and the year. ValueError for none."""
    parts = re.split(r"[-/. ]", text)
    if len(parts[0]) == 4:
        year, month, day = map(int, parts)
        return _days(year, month, day), None
    year = int(parts[2]) + (2000 if len(parts[2]) == 2 else 0)
    if not parts[1].isdigit():
        return _days(year, MONTHS[parts[1].lower()], int(parts[0])), None
    first, second = int(parts[0]), int(parts[1])
    if "." in text:  # written so where the day comes first
        return _days(year, second, first), None
    if max(first, second) > 31 or min(first, second) > 12:
        raise ValueError(text)
    return None, (first, second, year)


def _days(year: int, month: int, day: int) -> int:
    return date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()


def _zone(text: str) -> float:
    if text.lower() in ZONES:
        return 3600.0 * ZONES[text.lower()]
    digits = re.fullmatch(r"(?:UTC|GMT)?([+-])(\d\d):?(\d\d)?", text)
    if digits is None:
        raise ValueError(text)
    return (1.0 if digits[1] == "+" else -1.0) * (3600.0 * int(digits[2]) + 60.0 * int(digits[3] or 0))


def _seconds(
    name: str,
    read: list[_Moment | None],
    beside: list[_Moment | None] | None,
    asked: Asked,
    place: Callable[[int], str],
) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Seconds since some moment (rows,), NaN for gaps; and what was assumed."""
    told = []
    dated = beside if beside is not None else read
    days, order = _ordered(name, dated, asked, place)
    told += [order] if order else []
    clocks = [m.clock if m is not None else () for m in read]
    short = next((i for i, clock in enumerate(clocks) if len(clock) == 2), None)
    minutes = False
    if short is not None:
        kinds = {"m:s"} if any(len(c) == 2 and (c[0] > 23.0 or c[1] % 1.0) for c in clocks) else {"h:m", "m:s"}
        if len(kinds) > 1 and not asked.clock:
            text = ":".join(f"{part:02g}" for part in clocks[short])
            raise Ambiguous(f"{place(short)}: column {name}: {text} is hours or minutes", "clock", ("h:m", "m:s"))
        minutes = (asked.clock or next(iter(kinds))) == "m:s"
        told.append("minutes and seconds" if minutes else "hours and minutes")
    seconds = np.full(len(read), np.nan)
    for i, (moment, clock) in enumerate(zip(read, clocks, strict=True)):
        if moment is None:
            continue
        weights = (60.0, 1.0) if len(clock) == 2 and minutes else (3600.0, 60.0, 1.0)
        seconds[i] = sum(w * part for w, part in zip(weights, clock, strict=False)) - (moment.zone or 0.0)
    if days is not None:
        return seconds + DAY * (days - np.nanmin(days)), told
    there = np.flatnonzero(~np.isnan(seconds))
    back = np.diff(seconds[there]) < -HALF_DAY
    if back.any():
        seconds[there] += DAY * np.concatenate([[0], np.cumsum(back)])
        told.append(f"across midnight at {place(int(there[1:][back][0]))}")
    return seconds, told


def _ordered(
    name: str, read: list[_Moment | None], asked: Asked, place: Callable[[int], str]
) -> tuple[npt.NDArray[np.float64] | None, str]:
    """The day of each row (rows,), None where there are no dates; and how dates were read that leave it open."""
    there = [m for m in read if m is not None]
    if all(m.day is None and m.open is None for m in there):
        return None, ""
    spelt = [m.open for m in there if m.open is not None]
    first = ""
    if spelt:
        can = {"day first": all(m <= 12 for _, m, _ in spelt), "month first": all(d <= 12 for d, _, _ in spelt)}
        fits = [kind for kind, there_ in can.items() if there_]
        if asked.dates:
            fits = [kind for kind in fits if kind == asked.dates]
        if not fits or (len(fits) > 1 and len(set(spelt)) > 1):
            row = next(i for i, m in enumerate(read) if m is not None and m.open is not None)
            a, b, year = spelt[0]
            both = f"{a}/{b}/{year} has the day or the month first"
            raise Ambiguous(f"{place(row)}: column {name}: {both}", "dates", ("day first", "month first"))
        first = fits[0]
    days = np.full(len(read), np.nan)
    for i, moment in enumerate(read):
        if moment is not None and moment.open is not None:
            a, b, year = moment.open
            day, month = (a, b) if first == "day first" else (b, a)
            try:
                days[i] = _days(year, month, day)
            except ValueError:
                raise UserError(f"{place(i)}: column {name}: found {a}/{b}/{year}, expected a date, {first}") from None
        elif moment is not None and moment.day is not None:
            days[i] = moment.day
    return days, f"{first} in dates" if first and len(set(spelt)) > 1 else ""
