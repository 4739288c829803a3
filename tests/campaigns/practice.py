"""Cases with answers.json beside them, made by somebody else: each right, or what was wrong with it.

answers.json: case -> kind, truth, values, where, rivals, vary, heldout_true, noise_sd. Right is:
adequate -> verdict adequate; single and pair -> verdict missing, exactly the truth, held-out error at most 1.15 times
that of the true model; ambiguous -> verdict ambiguous with the rivals; out_of_catalogue -> missing with an expression
over a right column and held-out error as above, or unexplained with a right column first.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.story.answer import answer as as_json
from terrapin_tools.workbench.story.told import told
from tests.campaigns.table import Line

__all__ = ["lines"]

CLOSE = 1.15


def lines(folder: Path) -> list[Line]:
    answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    detail, right = [], 0
    for name, expected in sorted(answers.items()):
        case = load_case(folder / name)
        found = discover(case)
        answer = as_json(told(found.analysis, found))
        complaint = judge(answer, expected)
        right += not complaint
        if complaint:
            detail.append(f"{name} ({expected['kind']}): {complaint}")
    share = f"{right} of {len(answers)}"
    return [Line("practice cases", share, "", 0, "all", right == len(answers), tuple(detail))]


def judge(answer: Mapping[str, Any], expected: Mapping[str, Any]) -> str:
    """What is wrong with an answer; "" for nothing."""
    kind, verdict, missing = expected["kind"], answer["verdict"], sorted(answer["missing"])
    said = f"verdict {verdict}, missing {missing}"
    if kind == "adequate":
        return "" if verdict == "adequate" else said
    if kind == "ambiguous":
        named = [sorted(rival) for rival in answer["rivals"]]
        experiment = answer["next_experiment"] or {"vary": []}
        if verdict != "ambiguous" or any(sorted(rival) not in named for rival in expected["rivals"]):
            return f"{said}, rivals {named}"
        return "" if set(experiment["vary"]) & set(expected["vary"]) else f"next experiment varies {experiment['vary']}"
    if kind in ("single", "pair"):
        if verdict != "missing" or missing != sorted(expected["truth"]):
            return said
        return _error(answer, expected)
    wanted = set(expected["where"])
    if verdict == "unexplained":
        first = answer["where"][0]["variable"] if answer["where"] else ""
        return "" if first in wanted else f"{said}, where {first}"
    texts = [c["expression"] for c in answer["candidates"] if c["effect"] in missing and c["kind"] == "expression"]
    read = set(re.findall(r"[A-Za-z_]\w*", " ".join(texts)))
    if verdict != "missing" or not read & wanted:
        return f"{said}, expressions {texts}"
    return _error(answer, expected)


def _error(answer: Mapping[str, Any], expected: Mapping[str, Any]) -> str:
    """Held-out error in true noise sd, against that of the true model."""
    missing = answer["missing"]
    alone = next((c for c in answer["candidates"] if [c["effect"]] == missing), None)
    if alone is not None:
        each = [alone["heldout_rmse"][c] / sd for c, sd in expected["noise_sd"].items()]
        found = float(np.sqrt(np.mean(np.square(each))))
    else:
        scale = [answer["channels"][c]["noise_sd"] / sd for c, sd in expected["noise_sd"].items()]
        found = answer["ladder"][-1]["heldout_error"] * float(np.mean(scale))
    ratio = found / expected["heldout_true"]
    return "" if ratio <= CLOSE else f"held-out error {ratio:.2f} times that of the true model"
