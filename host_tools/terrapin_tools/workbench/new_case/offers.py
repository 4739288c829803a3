"""Base models that a table's columns suit, each fitted briefly, the best first."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Mask
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES, Base
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.model.fitting import fit_model
from terrapin_tools.workbench.model.model import Model

__all__ = ["Offer", "offers", "suiting", "told"]

ROWS = 1500  # that are fitted, runs whole: for time; half and twice of it put the same base first on 12 of 12 logs
MOST_ROWS = 200_000  # of a table: what is larger is not read once more for every base
FLOOR = 1e-3  # of an error


@dataclass(frozen=True)
class Offer:
    """`left`: what a brief fit leaves of each channel's scatter around its mean; empty where `why` says why there is
    none. `worth`: what the fits explain of all channels together; the greatest comes first."""

    base: Base
    left: dict[str, float]
    worth: float
    why: str = ""


def suiting(names: Collection[str | None]) -> list[Base]:
    """Bases whose inputs and at least one channel are among the names; most alike first."""
    found = [base for base in BASES.values() if not base.own_names and base.suits(names)]
    return sorted(found, key=lambda base: -base.resembles(names, ()))


def offers(bases: Sequence[Base], document: Callable[[Base, Path], str], rows: int) -> list[Offer]:
    """Each base after a brief fit, the best first: the one that explains most of the most channels.

    `document` writes case.toml of a base for a folder; `rows` are those of the tables.
    """
    if rows > MOST_ROWS:
        return [Offer(base, {}, 0.0, f"{rows} rows are too many for a brief fit") for base in bases]
    with tempfile.TemporaryDirectory(prefix="terrapin_") as scratch:
        found = []
        for base in bases:
            folder = Path(scratch) / base.name
            folder.mkdir()
            (folder / "case.toml").write_text(document(base, folder), encoding="utf-8")
            try:
                found.append(_fitted(base, load_case(folder)))
            except UserError as error:
                why = str(error).removeprefix(f"{folder / 'case.toml'}: ").replace(str(folder), base.name)
                found.append(Offer(base, {}, 0.0, why))
    place = {offer.base.name: i for i, offer in enumerate(found)}
    return sorted(found, key=lambda offer: (bool(offer.why), -offer.worth, place[offer.base.name]))


def told(found: Sequence[Offer], chosen: Base) -> list[str]:
    """What was offered, a line each."""
    lines = []
    for offer in found:
        mark = "*" if offer.base is chosen else " "
        left = [f"{one:.2g} of {name}" for name, one in offer.left.items()]
        words = offer.why or f"leaves {', '.join(left).replace(' of ', ' of the scatter of ', 1)}"
        lines.append(f"{mark} {offer.base.name}: {words}")
    if len(found) == 1:
        return [f"The one base model whose inputs these columns have:{lines[0][1:]}"]
    return ["Base models that these columns suit, each fitted briefly (--base takes another):", *lines]


def _fitted(base: Base, case: Case) -> Offer:
    model = Model.of(case)
    rows = _few(case)
    values = np.stack([case.channels[name][rows] for name in model.channels])
    spread = values.std(axis=1)
    scatter = np.where(spread > 0.0, spread, 1.0)
    with np.errstate(all="ignore"):
        fit = fit_model(model.bind(case.inputs, rows), values, scatter, [model.start])
    each = np.sqrt((fit.residual**2).mean(axis=1))
    if not np.isfinite(each).all():
        return Offer(base, {}, 0.0, "gives no numbers on these rows with the placeholders")
    worth = -float(np.log(np.clip(each, FLOOR, 1.0)).sum())
    return Offer(base, dict(zip(model.channels, each.tolist(), strict=True)), worth)


def _few(case: Case) -> Mask:
    """Rows of the first training runs, whole where the base integrates over them."""
    taken = np.zeros(case.rows, dtype=bool)
    for run in np.unique(case.run[case.train]):
        mine = case.train & (case.run == run)
        if taken.any() and taken.sum() + mine.sum() > ROWS:
            break
        taken |= mine
    if not case.base.whole_runs and taken.sum() > ROWS:
        chosen = np.flatnonzero(taken)[:: -(-int(taken.sum()) // ROWS)]
        taken = np.zeros(case.rows, dtype=bool)
        taken[chosen] = True
    return taken
