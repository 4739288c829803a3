"""The JSON of the contract (docs/cases.md, schema terrapin.case/1) from an analysis."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from host_tools.workbench.analysis import Analysis

__all__ = ["SCHEMA", "compare_answer", "finite", "parameter_answer", "to_json"]

SCHEMA = "terrapin.case/1"


def parameter_answer(analysis: Analysis) -> dict[str, dict[str, Any]]:
    """Every fitted parameter by its key: value, sd, unit."""
    return {
        fitted.key: {"value": float(value), "sd": float(sd), "unit": fitted.unit or "1"}
        for fitted, value, sd in zip(analysis.model.fitted, analysis.fit.theta, analysis.sd, strict=True)
    }


def compare_answer(analysis: Analysis, seconds: float) -> dict[str, Any]:
    """What `terrapin compare` answers."""
    case, noise = analysis.case, analysis.noise
    held = case.test[analysis.rows]
    channels = {}
    for i, name in enumerate(analysis.model.channels):
        residual = analysis.residual[i]
        channels[name] = {
            "noise_sd": float(noise.sigma[i]),
            "train_rmse": float(np.sqrt(np.mean(residual[~held] ** 2))),
            "heldout_rmse": float(np.sqrt(np.mean(residual[held] ** 2))) if held.any() else None,
            "unit": case.units[name] or "1",
        }
    return {
        "schema": SCHEMA,
        "case": case.title,
        "model": {"base": case.base.name, "effects": list(case.effects)},
        "parameters": parameter_answer(analysis),
        "channels": channels,
        "adequacy": {"p_value": analysis.adequacy.p_value, "false_alarm_rate": analysis.level},
        "where": [
            {
                "variable": failure.variable,
                "range": [failure.low, failure.high],
                "channel": failure.channel,
                "mean_residual_in_sd": failure.mean_residual,
            }
            for failure in analysis.where
        ],
        "verdict": "missing" if analysis.missing else "adequate",
        "ladder": [
            {"added": rung.added, "train_error": rung.train_error, "heldout_error": rung.heldout_error}
            for rung in analysis.ladder
        ],
        "noise": {"rho": noise.rho, "source": noise.source},
        "at_bound": list(analysis.fit.at_bound),
        "seconds": seconds,
    }


def to_json(answer: dict[str, Any]) -> str:
    """One line feed at the end, two spaces of indent; a number that is not finite becomes null."""
    return json.dumps(finite(answer), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The value with null for every number in it that is not finite, which JSON does not know."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
