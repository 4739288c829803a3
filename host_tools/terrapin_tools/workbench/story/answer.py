"""The JSON of the contract (docs/cases.md, schema terrapin.case/3) from a story, and a kept answer read back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.compare.noise_findings import NoiseFinding
from terrapin_tools.workbench.compare.together import Together
from terrapin_tools.workbench.discover.certainty import Operating
from terrapin_tools.workbench.discover.decide import Weight
from terrapin_tools.workbench.discover.misfit import Step
from terrapin_tools.workbench.discover.ranking import Blamed
from terrapin_tools.workbench.discover.resampled import Selected
from terrapin_tools.workbench.experiment.proposal import Experiment
from terrapin_tools.workbench.files.json_text import finite
from terrapin_tools.workbench.formulas.free_curves import Curve
from terrapin_tools.workbench.story.story import Findings, Goal, NoiseTold, Part, Place, Proposal, Rung, Story, Value

__all__ = ["SCHEMA", "answer", "keep", "places", "proposal", "read", "recall"]

SCHEMA = "terrapin.case/3"


def answer(story: Story) -> dict[str, Any]:
    """What `terrapin compare` and `terrapin discover` write with --json."""
    missing, runs = ({}, {}) if story.found is None else (_of_discover(story.found), _of_runs(story.found))
    groups = {
        one.parameter: {
            "by": one.by,
            "unit": one.unit,
            "values": {group: {"value": value, "sd": one.sds[group]} for group, value in one.values.items()},
            "p_value": one.p_value,
        }
        for one in story.groups
    }
    intake = {"rows_left_out": story.rows_left_out, "guessed": story.guessed, "remarks": story.intake}
    parts = {
        "schema": SCHEMA,
        "case": story.title,
        "model": {"base": story.base, "effects": story.effects},
        "parameters": _values(story.parameters),
        "channels": {name: vars(channel) for name, channel in story.channels.items()},
        "adequacy": {"p_value": story.p_value, "false_alarm_rate": story.level},
        "where": places(story.where),
        "verdict": story.verdict,
        **missing,
        "ladder": [vars(rung) for rung in story.ladder],
        "noise": {
            "model": story.noise.model,
            "rho": story.noise.rho,
            "source": story.noise.source,
            "findings": [vars(one) for one in story.noise.findings],
            "floor": story.noise.floor,
        },
        **({"goal": {one.channel: _goal(one) for one in story.goals}} if story.goals else {}),
        **({"groups": groups} if groups else {}),
        **({"intake": intake} if story.intake else {}),
        **({"not_apart": [_tied(one) for one in story.together]} if story.together else {}),
        **({"intervals": {key: vars(one) for key, one in story.intervals.items()}} if story.intervals else {}),
        "at_bound": [key for key, value in story.parameters.items() if value.at_bound],
        **runs,
        "seconds": story.seconds,
    }
    return dict(finite(parts))


def _of_discover(found: Findings) -> dict[str, Any]:
    return {
        "missing": found.missing,
        "answer_probability": found.probability,
        "candidates": [{**vars(c), "parameters": _values(c.parameters)} for c in found.candidates],
        "rivals": found.rivals,
        "part": found.missing if found.part else (),
        "rest": found.part and _rest(found.part),
        "formulas": found.formulas,
        "column": found.column and dict(zip(("name", "probability"), found.column, strict=True)),
        "front": [vars(one) for one in found.front],
        "weighed": [vars(one) for one in found.weighed],
        "next_experiment": found.plan and vars(found.plan),
    }


def _of_runs(found: Findings) -> dict[str, Any]:
    return {
        "odd_runs": found.blamed.runs if found.blamed and found.blamed.kind in ("run", "slope") else (),
        "mishap": found.blamed and vars(found.blamed),
        "unknown": found.unknown and vars(found.unknown),
        "operating": [vars(one) for one in found.operating],
        "selected": [vars(one) for one in found.selected],
    }


def _rest(one: Part) -> dict[str, Any]:
    beside = {"together": True} if one.together else {}
    return {"takes": one.takes, "left": one.left, "where": places([one.at])[0], **beside}


def _tied(one: Together) -> dict[str, Any]:
    return {"parameters": one.parameters, "determined": [vars(known) for known in one.determined]}


def _values(values: Mapping[str, Value]) -> dict[str, dict[str, Any]]:
    """Value, sd and unit by name, and the bounds that there are."""
    bounds = {name: {k: b for k, b in (("min", v.min), ("max", v.max)) if b is not None} for name, v in values.items()}
    return {name: {"value": v.value, "sd": v.sd, "unit": v.unit, **bounds[name]} for name, v in values.items()}


def places(where: Sequence[Place]) -> list[dict[str, Any]]:
    return [
        {"variable": p.variable, "range": [p.low, p.high], "channel": p.channel, "mean_residual_in_sd": p.mean}
        for p in where
    ]


def keep(folder: Path, story: Story) -> None:
    """Keep an answer of discover in the case, with what its words need beyond the contract."""
    found = story.found
    assert found is not None, "only discover's answer is kept"
    together = {effect: {name: vars(v) for name, v in values.items()} for effect, values in found.together.items()}
    along = [place.along_motion for place in found.where]
    history.keep(
        folder,
        {**answer(story), "along": along, "together": finite(together), "remarks": found.remarks, "then": found.then},
    )


def recall(folder: Path, level: float | None = None) -> Findings | None:
    """What discover found last, if it is about the case as it stands now (and of that level); None when it cannot be
    read."""
    kept = history.recall(folder)
    try:
        if kept is None or (level is not None and kept["adequacy"]["false_alarm_rate"] != level):
            return None
        return read(kept)
    except (KeyError, TypeError, ValueError):
        return None


def read(kept: Mapping[str, Any]) -> Findings:
    """A kept answer of discover. KeyError, TypeError or ValueError when it is none."""
    plan: dict[str, Any] | None = kept["next_experiment"]
    along = kept.get("along", [False] * len(kept["where"]))
    return Findings(
        verdict=kept["verdict"],
        missing=tuple(kept["missing"]),
        probability=float(kept["answer_probability"]),
        candidates=tuple(proposal(one) for one in kept["candidates"]),
        rivals=tuple(tuple(effects) for effects in kept["rivals"]),
        plan=Experiment(**plan) if plan else None,
        where=tuple(_place(p, way) for p, way in zip(kept["where"], along, strict=True)),
        ladder=tuple(Rung(**rung) for rung in kept["ladder"]),
        blamed=_blamed(kept),
        unknown=_curve(kept.get("unknown")),
        operating=tuple(Operating(**one) for one in kept["operating"]),
        selected=tuple(Selected(tuple(s["effects"]), s["kind"], s["frequency"]) for s in kept["selected"]),
        together={e: {n: Value(**v) for n, v in values.items()} for e, values in kept.get("together", {}).items()},
        remarks=tuple(kept.get("remarks", ())),
        then={name: float(error) for name, error in kept.get("then", {}).items()},
        noise=_noise(kept),
        formulas=dict(kept["formulas"]),
        column=(kept["column"]["name"], float(kept["column"]["probability"])) if kept.get("column") else None,
        part=_kept_part(kept["rest"]),
        weighed=tuple(
            Weight(
                w["kind"],
                tuple(tuple(names) for names in w["sets"]),
                w["column"],
                w["probability"],
                tuple(w.get("alike", ())),
            )
            for w in kept["weighed"]
        ),
        front=tuple(Step(**{**one, "effects": tuple(one["effects"])}) for one in kept["front"]),
    )


def _place(kept: Mapping[str, Any], along: bool = False) -> Place:
    low, high = kept["range"]
    return Place(kept["variable"], low, high, kept["channel"], kept["mean_residual_in_sd"], along)


def _kept_part(kept: Mapping[str, Any] | None) -> Part | None:
    return Part(kept["takes"], kept["left"], _place(kept["where"]), kept.get("together", False)) if kept else None


def _noise(kept: Mapping[str, Any]) -> NoiseTold:
    """The noise of a kept answer. KeyError or TypeError when it is none."""
    told = kept["noise"]
    findings = [
        NoiseFinding(**{**one, "rows": tuple(one["rows"]), "runs": tuple(one["runs"])}) for one in told["findings"]
    ]
    sds = {name: float(channel["noise_sd"]) for name, channel in kept["channels"].items()}
    return NoiseTold(sds, told["source"], told["model"], told["rho"], tuple(findings), told["floor"])


def _blamed(kept: Mapping[str, Any]) -> Blamed | None:
    """Answers that were kept before there were other mishaps name the odd runs alone."""
    mishap = kept.get("mishap") or ({"kind": "run", "runs": kept["odd_runs"]} if kept["odd_runs"] else None)
    return Blamed(mishap["kind"], tuple(mishap["runs"])) if mishap else None


def _curve(kept: Mapping[str, Any] | None) -> Curve | None:
    return Curve(**{**kept, **{name: tuple(kept[name]) for name in ("x", "y", "sd")}}) if kept else None


def _goal(one: Goal) -> dict[str, Any]:
    numbers = {"wanted": one.wanted, "reached": one.reached, "then": one.then, "unit": one.unit}
    return {**numbers, "held_out": one.held_out, "met": one.met, "then_met": one.then_met}


def proposal(entry: Mapping[str, Any]) -> Proposal:
    """A candidate of a kept answer. KeyError or TypeError when it is none."""
    one = Proposal(**entry)
    return replace(one, parameters={name: Value(**value) for name, value in entry["parameters"].items()})
