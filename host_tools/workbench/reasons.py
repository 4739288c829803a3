"""One sentence for the verdict and one for each candidate: why it is likely, or why not."""

from __future__ import annotations

from typing import Any

import numpy as np

from hil.physics.effects import Effect
from host_tools.workbench.analysis import Analysis
from host_tools.workbench.confidence import EVEN
from host_tools.workbench.show import verdict_line

__all__ = ["headline", "reason"]

NEAR_FLOOR = 1.15  # error in noise sd that is as good as the floor on a handful of held-out runs
LITTLE = 0.1  # share of the misfit below which a candidate explains next to nothing
STILL = 0.05  # a role whose span is below this share of its magnitude hardly varies


def _sd(error: float) -> str:
    return f"{error:.2f}" if error < 10 else f"{error:.3g}"


def _per_cent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.005 else "nothing"


def headline(analysis: Analysis, answer: dict[str, Any] | None) -> str:
    """The verdict in one sentence, with its probability where discover gave one."""
    if answer is None:
        return verdict_line(analysis)
    sure = float(answer["answer_probability"])
    ladder, missing = answer["ladder"], " + ".join(answer["missing"])
    if answer["verdict"] == "adequate":
        test = f"p = {answer['adequacy']['p_value']:.2g} at a false alarm rate of {analysis.level:g}"
        if sure < EVEN:
            return f"No alarm ({test}), but that nothing is missing has a probability of {max(sure, 0.01):.2f} only."
        return f"The model is adequate: with probability {sure:.2f} nothing is missing ({test})."
    if answer["verdict"] == "ambiguous":
        sets = " or ".join(" + ".join(effects) for effects in answer["rivals"])
        return f"Something is missing, and these data cannot tell what: {sets}. Likeliest: {missing} ({sure:.2f})."
    if answer["verdict"] == "unexplained":
        on = f" It depends on {answer['where'][0]['variable']}." if answer["where"] else ""
        return f"Something is missing that no catalogued effect and no short expression explains.{on}"
    error = ""
    if len(ladder) > 1 and ladder[-2]["heldout_error"] is not None and ladder[-1]["heldout_error"] is not None:
        error = (
            f": with it the held-out error falls from {_sd(ladder[-2]['heldout_error'])} to "
            f"{_sd(ladder[-1]['heldout_error'])} noise sd"
        )
    return f"With probability {sure:.2f} the model lacks {missing}{error}."


def reason(analysis: Analysis, answer: dict[str, Any], candidate: dict[str, Any], effect: Effect | None) -> str:
    """Why a candidate is likely, or why it is not: what it explains, what the data hold against it."""
    name, share, ratio = candidate["effect"], float(candidate["explains"]), candidate["noise_ratio"]
    left = "" if ratio is None else f" and leaves {_sd(ratio)} noise sd on held-out runs"
    rivals = [set(effects) for effects in answer["rivals"]]
    mine = [effects for effects in rivals if name in effects]
    if mine and len(rivals) > 1:
        others = " or ".join(" + ".join(sorted(other - mine[0])) for other in rivals if other - mine[0])
        return f"Does as well as {others} on these data: it takes away {_per_cent(share)} of the misfit{left}."
    if answer["verdict"] == "adequate":
        return "Too small to tell, if there at all."
    if name in answer["missing"]:
        if len(answer["missing"]) > 1:
            return f"Alone it takes away {_per_cent(share)} of the misfit{left}; the others take away the rest."
        return f"Takes away {_per_cent(share)} of the misfit{left} (floor 1.0)."
    if share < LITTLE:
        return f"Takes away next to nothing of the misfit{_why_not(analysis, answer, effect)}."
    if ratio is not None and ratio < NEAR_FLOOR:
        return f"Fits nearly as well ({_sd(ratio)} noise sd on held-out runs), but the runs together speak against it."
    return f"Takes away only {_per_cent(share)} of the misfit{left}."


def _why_not(analysis: Analysis, answer: dict[str, Any], effect: Effect | None) -> str:
    """What in the data says so; empty when nothing simple does."""
    if effect is None:
        return ""
    case = analysis.case
    for group in effect.needs:
        mapped = [role for role in group if role in case.roles]
        for role in mapped[:1]:
            values = case.roles[role][analysis.rows]
            if np.ptp(values) <= STILL * max(float(np.abs(values).max()), 1e-300):
                return f": {role} hardly varies in these runs"
    channels = case.base.channels
    failing = answer["where"][0]["channel"] if answer["where"] else None
    if effect.target in channels and failing is not None and failing != effect.target:
        return f": it changes {effect.target}, and it is {failing} that fails"
    return ""
