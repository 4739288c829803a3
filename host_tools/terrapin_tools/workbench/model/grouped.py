"""A base on rows of several groups, where some parameters have one value a group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.workbench.bases.kinds.base import Act, Base, Fitted, Predictor, Problem
from terrapin_tools.workbench.case.groups import Groups

__all__ = ["Grouped"]


@dataclass(frozen=True)
class _Part:
    """Rows that share all their parameters: the base on them, the places of its parameters, and of its rows."""

    predictor: Predictor
    places: Index
    rows: Index


class Grouped(Predictor):
    """Each combination of groups is a problem of its own. Proposed settings are of the combination with most rows."""

    def __init__(self, base: Base, problem: Problem, groups: Mapping[str, Groups]) -> None:
        super().__init__(problem)
        used = sorted({one.by for one in problem.fitted if one.by})
        stacked = np.column_stack([groups[by].index for by in used])
        sets, which, counts = np.unique(stacked, axis=0, return_inverse=True, return_counts=True)
        which = which.reshape(-1)
        settings = problem.runs is None
        wanted = np.ones(len(which), dtype=bool) if problem.rows is None else problem.rows
        self.parts = []
        for number in [int(np.argmax(counts))] if settings else range(len(sets)):
            own = {by: groups[by].names[sets[number, i]] for i, by in enumerate(used)}
            places = np.flatnonzero([not f.by or own[f.by] == f.group for f in problem.fitted])
            mask: Mask | None = None
            rows = np.arange(problem.count)
            if not settings:
                mask = wanted & (which == number)
                rows = np.flatnonzero(which[wanted] == number)
            if rows.size:
                fitted = tuple(_plain(problem.fitted[i]) for i in places)
                predictor = base.predictor(replace(problem, fitted=fitted, rows=mask))
                self.parts.append(_Part(predictor, places, rows))

    def sets(self, sets: Array) -> Array:
        found = np.empty((len(sets), len(self.problem.channels), self.problem.count))
        for part in self.parts:
            found[:, :, part.rows] = part.predictor.predict(sets[:, part.places])
        return found

    def near(self, sets: Array) -> Array:
        found = np.empty((len(sets), len(self.problem.channels), self.problem.count))
        for part in self.parts:
            found[:, :, part.rows] = part.predictor.near(sets[:, part.places])
        return found

    def jacobian(self, theta: Array) -> tuple[Array, Array]:
        found = np.empty((len(self.problem.channels), self.problem.count))
        slopes = np.zeros((*found.shape, len(theta)))
        for part in self.parts:
            found[:, part.rows], own = part.predictor.jacobian(theta[part.places])
            slopes[:, part.rows[:, None], part.places] = own
        return found, slopes

    def motion(self, theta: Array) -> Mapping[str, Array]:
        found: dict[str, Array] = {}
        for part in self.parts:
            for name, values in part.predictor.motion(theta[part.places]).items():
                found.setdefault(name, np.zeros(self.problem.count))[part.rows] = values
        return found

    def acting(self, theta: Array, target: str) -> Act | None:
        acts = [part.predictor.acting(theta[part.places], target) for part in self.parts]

        def act(features: Array) -> Array:
            found = np.zeros((len(features), len(self.problem.channels), self.problem.count))
            for part, own in zip(self.parts, acts, strict=True):
                assert own is not None
                found[:, :, part.rows] = own(features[:, part.rows])
            return found

        return None if None in acts else act

    def trouble(self, theta: Array) -> str:
        return next((told for p in self.parts if (told := p.predictor.trouble(theta[p.places]))), "")


def _plain(one: Fitted) -> Fitted:
    return replace(one, key=one.name, by="", group="") if one.by else one
