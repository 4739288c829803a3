"""Discovery on real measurements of others: is what is known to be missing named, and how large is the held-out error?

    python -m tests.campaigns.measured --data FOLDER                     every set
    python -m tests.campaigns.measured --data FOLDER --set thrust-7v4,plates

Each set becomes cases as a user would write them (measured_sets.py). Then `terrapin discover` and `terrapin add` take
turns until nothing is added any more, at most ROUNDS times. Of rivals the likeliest is added, as a user would who
cannot measure more; of what is not explained, what is surely part of it. The held-out error is that of all held-out
rows, rows that discovery left out included. Answers and cases are kept in the folder of --out; the data are never
copied into the project.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import tomllib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import analyse, measured, predict
from tests.campaigns.commands import terrapin
from tests.campaigns.measured_sets import SETS, Fold, Row, Set, Wanted

__all__ = ["Outcome", "answers", "main", "outcome", "table"]

ROUNDS = 5
HOW = ("", "formula", "tied", "name")  # not at all, as a formula of that shape, among rivals by name, by name alone


@dataclass
class Outcome:
    """What came of one set: of each thing wanted how it was named (one of HOW), errors and remarks."""

    name: str
    named: dict[str, str] = field(default_factory=dict)
    error: float = float("nan")
    bound: float = float("inf")
    unit: str = ""
    rounds: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)  # a crash, an error that rose, a term added after ROUNDS

    @property
    def met(self) -> bool:
        named = all(how in ("tied", "name") for how in self.named.values())
        return named and self.error <= self.bound and not self.problems


def write(folder: Path, fold: Fold, rows: Sequence[Row]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.toml").write_text(fold.toml, encoding="utf-8")
    with (folder / "rows.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def rounds(folder: Path, found: Outcome, label: str) -> dict[str, Any]:
    """discover, add, discover again until nothing is added; the last answer."""
    answer: dict[str, Any] = {}
    errors: list[float] = []
    for number in range(ROUNDS + 1):
        answer = json.loads(terrapin("discover", folder, "--json", "-"))
        (folder / f"answer_{number + 1}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")
        errors.append(_heldout(load_case(folder)))
        if len(errors) > 1 and errors[-1] > errors[-2] * (1.0 + 1e-9):
            found.problems.append(f"{label}: the held-out error rose from {errors[-2]:.4g} to {errors[-1]:.4g}")
        texts = {c["effect"]: c["expression"] for c in answer["candidates"] if c["kind"] == "expression"}
        said = " + ".join(texts.get(name) or name for name in answer["missing"] or answer["part"]) or "-"
        found.rounds.append(
            f"{label} {number + 1}: {answer['verdict']} {answer['answer_probability']:.2f}  {said}"
            f"  [{errors[-1]:.4g} {found.unit}]"
        )
        added = answer["missing"] or answer["part"]
        if not added:
            break
        if number == ROUNDS:
            found.problems.append(f"{label}: something is still added after {ROUNDS} rounds")
            break
        terrapin("add", folder, *added)
    return answer


def _heldout(case: Case) -> float:
    gap = _gaps(case)[case.test]
    return float(np.sqrt(np.mean(gap * gap)))


def _gaps(case: Case) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Measured minus predicted of the first channel (rows,) in the unit of the file, fitted on the training runs.

    An answer may say that the channel is scaled; then its numbers in the case are no longer those of the file.
    """
    fit = analyse(case).fit
    every = np.ones(case.rows, dtype=bool)
    entry = tomllib.loads(case.text)["data"]["columns"][fit.model.channels[0]]
    gap = (measured(fit.model, every) - predict(fit, every))[0]
    return np.asarray(gap / abs(float(entry.get("factor", 1.0))))


def how_named(case: Case, wanted: Wanted, rivals: Collection[str] = ()) -> str:
    """One of HOW. What has no name is named by its formula.

    `rivals`: every effect that was told to do as well on these data as what was added.
    """
    if set(case.effects) & set(wanted.effects):
        return "name"
    if set(rivals) & set(wanted.effects):
        return "tied"
    texts = [case.library[name] for name in case.effects]
    channel = next(iter(case.channels))
    shown = [t.expression if t.target == channel else f"{t.target}: {t.expression}" for t in texts]
    found = any(re.search(wanted.formula, text) for text in shown)
    return ("formula" if wanted.effects else "name") if found else ""


def outcome(one: Set, data: Path, out: Path) -> Outcome:
    """Run one set."""
    found = Outcome(one.name, bound=one.bound, unit=one.unit)
    squares: list[float] = []
    folds = one.folds(data)
    for number, fold in enumerate(folds):
        folder = out / one.name if len(folds) == 1 else out / f"{one.name}-{number + 1}"
        label = "round" if len(folds) == 1 else f"part {number + 1} round"
        rows = fold.rows
        write(folder, fold, rows)
        try:
            answer = rounds(folder, found, label)
            if one.points_at is not None:
                column, low, high = one.points_at
                pointed = _pointed(answer, one.points_at) or _pointed(answers(folder)[0], one.points_at)
                found.named["the rows pointed at"] = "name" if pointed else ""
                if pointed:  # the reader leaves these rows out and asks again
                    name = next(c for c in rows[0] if c.startswith(f"{column} "))
                    rows = [row for row in rows if not low <= float(row[name]) <= high]
                    folder = folder.with_name(f"{folder.name}-without")
                    write(folder, fold, rows)
                    answer = rounds(folder, found, "without them round")
        except RuntimeError as error:
            found.problems.append(f"{label}: {error}")
            continue
        case = load_case(folder)
        # a channel that is told to come late loses rows
        lines = [int(case.place(i).rpartition(":")[2]) for i in range(case.rows)]
        weights = np.array([np.nan if (w := one.error_of(rows[line - 2])) is None else w for line in lines])
        gap = (_gaps(case) * weights)[case.test]
        squares += [float(v) ** 2 for v in gap if np.isfinite(v)]
        for wanted in one.wanted:
            how = how_named(case, wanted, _rivals(folder))
            found.named[wanted.meaning] = min(how, found.named.get(wanted.meaning, how), key=HOW.index)
        if one.groups:
            values = answer["groups"]["i0"]
            order = sorted(values["values"], key=lambda name: values["values"][name]["value"])
            right = tuple(order) == one.groups and values["p_value"] < 0.05
            found.named["groups in order"] = "name" if right else ""
            found.rounds.append(f"i0: {' < '.join(order)}, p = {values['p_value']:.2g} that they are one")
    found.error = float(np.sqrt(np.mean(squares))) if squares else float("nan")
    return found


def _rivals(folder: Path) -> set[str]:
    """Effects among the rivals that the rounds told."""
    return {name for answer in answers(folder) for names in answer["rivals"] for name in names}


def answers(folder: Path) -> list[dict[str, Any]]:
    """Those of the rounds, in their order."""
    paths = (folder / f"answer_{number + 1}.json" for number in range(ROUNDS + 1))
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.exists()]


def _pointed(answer: dict[str, Any], at: tuple[str, float, float]) -> bool:
    """Whether `where` has a range of the column within those limits."""
    column, low, high = at
    return any(
        place["variable"] == column and low <= place["range"][0] and place["range"][1] <= high
        for place in answer["where"]
    )


def table(found: Sequence[Outcome]) -> str:
    """Sets with what was named, error, bound; below them the rounds and what went wrong."""
    lines = [f"{'set':16}{'held out':>12}{'bound':>10}      {'met':5}named"]
    for one in found:
        named = ", ".join(f"{what} ({how or 'not'})" for what, how in one.named.items())
        bound = "-" if one.bound == float("inf") else f"{one.bound:.4g}"
        lines.append(f"{one.name:16}{one.error:12.4g}{bound:>10} {one.unit:5}{'yes' if one.met else 'NO':5}{named}")
    for one in found:
        lines += ["", one.name, *(f"  {text}" for text in one.rounds), *(f"  PROBLEM {text}" for text in one.problems)]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns.measured", description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER", help="with the tables and their README")
    parser.add_argument("--set", default=",".join(SETS), metavar="NAME", help=f"one or more of {', '.join(SETS)}")
    parser.add_argument("--out", type=Path, default=Path("out") / "measured", metavar="DIR", help="for cases, answers")
    arguments = parser.parse_args()
    names = arguments.set.split(",")
    for name in names:
        if name not in SETS:
            parser.error(f"--set: found {name!r}, expected one of {', '.join(SETS)}")
    if not arguments.data.is_dir():
        parser.error(f"--data: found {arguments.data}, expected the folder of the measurements")
    found = []
    for name in names:
        found.append(outcome(SETS[name], arguments.data, arguments.out))
        print(table(found[-1:]), flush=True)
    print("\n" + table(found))
    raise SystemExit(0 if all(one.met for one in found) else 1)


if __name__ == "__main__":
    main()
