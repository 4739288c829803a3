"""What the Workbench tab draws of a case: one JSON object a view, one a preview.

    draft(folder)                                      the fitted model beside the measurements, not yet judged
    view(folder)                                       verdict in words, plots, ranking, ladder, what to do next
    preview(folder, ["bulldozing"], noise, kept)       the curve and the errors with effects that are not added yet

Everything comes from the pieces that the commands and the report use; nothing is computed a second way. They are called
in a process of their own (warm.py), and view_api.py keeps what they answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from host_tools.errors import UserError

__all__ = ["draft", "preview", "view"]

CHIPS = {  # verdict -> the few words beside the title
    "adequate": "adequate",
    "missing": "something is missing",
    "ambiguous": "the data cannot tell",
    "unexplained": "unexplained",
}


def draft(folder: str | Path) -> dict[str, Any]:
    """The plot of a case as soon as the model is fitted; what takes longer (the noise, the verdict) is `view`'s.

    Of a channel whose noise is not stated `noise_sd` is None.
    """
    import numpy as np

    from host_tools.workbench.analysis import fitted_on, measured, predict
    from host_tools.workbench.case import load_case
    from host_tools.workbench.models import Model
    from host_tools.workbench.report_data import Drawn, drawn_data

    case = load_case(Path(folder))
    rows = case.train | case.test
    channels = Model.of(case).channels
    given = [case.sigma[name] for name in channels]
    scale = np.std([case.channels[name][case.train] for name in channels], axis=1)
    sigma = np.array([max(s, 1e-300) if g is None else g for s, g in zip(scale, given, strict=True)])
    fits = fitted_on(case, case.effects, case.train, sigma)
    prediction = predict(fits[-1], rows)
    base = predict(fits[0], rows) if case.effects else None
    drawn = Drawn(case, rows, channels, sigma, prediction, measured(fits[-1].model, rows) - prediction, base)
    plot = drawn_data(drawn, {"where": [], "ladder": []}, [])
    for channel in plot["channels"]:
        channel["noise_sd"] = case.sigma[channel["name"]]
    return {
        "title": case.title,
        "base": case.base.name,
        "effects": list(case.effects),
        "runs": len({*case.run[rows].tolist()}),
        "held_out": sorted({case.run_names[i] for i in case.run[case.test]}),
        "plot": plot,
    }


def view(folder: str | Path) -> dict[str, Any]:
    """Everything that is drawn of a case. UserError when anything in it is wrong.

    `plot` is `report_data.page_data` without curves of candidates, which `preview` gives one by one.
    """
    from host_tools.workbench import memory
    from host_tools.workbench.analysis import analyse
    from host_tools.workbench.answer import compare_answer
    from host_tools.workbench.case import load_case
    from host_tools.workbench.markdown import to_html
    from host_tools.workbench.reasons import headline
    from host_tools.workbench.report_data import page_data

    folder = Path(folder)
    case = load_case(folder)
    analysis = analyse(case)
    discovered = memory.recall(folder)
    answer = discovered if discovered is not None else compare_answer(analysis, 0.0)
    held = sorted({case.run_names[i] for i in case.run[case.test]})
    return {
        "title": case.title,
        "base": case.base.name,
        "effects": list(case.effects),
        "runs": len({*case.run[analysis.rows].tolist()}),
        "held_out": held,
        "verdict": answer["verdict"],
        "chip": CHIPS[answer["verdict"]],
        "headline": headline(analysis, discovered),
        "where": _where(analysis, answer),
        "discovered": discovered is not None,
        "missing": answer.get("missing", []),
        "rivals": answer.get("rivals", []),
        "model": [_in_model(analysis, effect) for effect in analysis.model.effects],
        "cards": _cards(analysis, discovered),
        "next": _next(analysis, discovered),
        "parameters": [
            {"key": key, **entry, "at_bound": key in analysis.fit.at_bound}
            for key, entry in compare_answer(analysis, 0.0)["parameters"].items()
        ],
        "channels": answer["channels"],
        "noise": f"{analysis.noise.source[:1].upper()}{analysis.noise.source[1:]}",
        "correlation": analysis.noise.rho,
        "operating": answer.get("operating", []),
        "history": memory.history(folder),
        "notes": to_html(case.notes) if case.notes else "",
        "targets": _targets(analysis),
        "names": sorted({*case.inputs, *case.parameters, *case.fit}),
        "exports": sorted(effect.name for effect in analysis.model.effects if effect.firmware),
        "plot": page_data(analysis, answer, []),
    }


def preview(folder: str | Path, effects: Sequence[str], noise: dict[str, float], kept: Sequence[int]) -> dict[str, Any]:
    """The model refitted with `effects` added: prediction by channel on the rows `kept`, errors, parameters.

    `noise` is the sd by channel and `kept` the rows, counted from 0, that `view` draws; so nothing of the comparison
    is done again. UserError when an effect is unknown, in the model already, or gives no prediction.
    """
    import numpy as np

    from host_tools.workbench import memory
    from host_tools.workbench.analysis import error, predict
    from host_tools.workbench.case import load_case
    from host_tools.workbench.models import Model
    from host_tools.workbench.report_data import refit

    folder = Path(folder)
    case = load_case(folder)
    answer = memory.recall(folder) or {"candidates": []}
    proposed = [candidate["effect"] for candidate in answer["candidates"]]
    known = [name for name in dict.fromkeys([*proposed, *case.library]) if name not in case.effects]
    for name in effects:
        if name not in known or list(effects).count(name) > 1:
            raise UserError(f"effect: found {name!r}, expected each once and of {', '.join(known)}")
    channels = Model.of(case).channels
    sigma = np.array([noise[name] for name in channels])
    fit = refit(case, sigma, answer, tuple(effects))
    if fit is None:
        raise UserError(f"{' + '.join(effects)}: gives no prediction on these data")
    prediction = predict(fit, case.train | case.test)[:, list(kept)]
    return {
        "effects": list(effects),
        "channels": {name: [float(f"{v:.6g}") for v in prediction[i]] for i, name in enumerate(channels)},
        "train_error": error(fit, case.train, sigma),
        "heldout_error": error(fit, case.test, sigma),
        "parameters": {
            fitted.key: {"value": float(value), "unit": fitted.unit or "1"}
            for fitted, value in zip(fit.model.fitted, fit.theta, strict=True)
        },
    }


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _where(analysis: Any, answer: dict[str, Any]) -> list[dict[str, str]]:
    """Where the model fails, one sentence a place, and runs that stand out by themselves."""
    from host_tools.workbench.show import number

    along = {(failure.variable, failure.channel) for failure in analysis.where if failure.with_direction}
    found = []
    for failure in answer["where"][:4]:
        low, high = (number(value) for value in failure["range"])
        span = low if low == high else f"{low} to {high}"
        mean = failure["mean_residual_in_sd"]
        way = ", along the motion" if (failure["variable"], failure["channel"]) in along else ""
        found.append(
            {
                "variable": failure["variable"],
                "channel": failure["channel"],
                "text": f"{span}{_unit(analysis.case.units.get(failure['variable'], ''))}: {failure['channel']} "
                f"measured {abs(mean):.1f} noise sd {'above' if mean > 0 else 'below'} the model{way}",
            }
        )
    for run in answer.get("odd_runs", []):
        found.append(
            {
                "variable": f"run {run}",
                "channel": "",
                "text": "stands out by itself: look at that run before looking for physics",
            }
        )
    return found


def _equation(candidate: dict[str, Any], effect: Any) -> str:
    """MathML: what the catalogue prints; of an expression the formula."""
    from host_tools.workbench.mathml import from_expression, from_latex

    if effect is not None and candidate.get("kind") != "expression":
        return from_latex(effect.equation)
    return from_expression(candidate["expression"])


def _in_model(analysis: Any, effect: Any) -> dict[str, Any]:
    from host_tools.workbench.mathml import from_latex

    return {
        "effect": effect.name,
        "title": effect.title,
        "equation": from_latex(effect.equation),
        "source": effect.source,
        "parameters": {
            fitted.name: {"value": float(value), "sd": float(sd), "unit": fitted.unit or "1"}
            for fitted, value, sd in zip(analysis.model.fitted, analysis.fit.theta, analysis.sd, strict=True)
            if fitted.effect == effect.name
        },
    }


def _cards(analysis: Any, answer: dict[str, Any] | None) -> list[dict[str, Any]]:
    """The ranking: what the answer names first, then the others, likeliest first. Empty before discover."""
    from host_tools.workbench.reasons import reason

    if answer is None:
        return []
    library = analysis.case.library
    named = list(dict.fromkeys(name for effects in (answer["missing"], *answer["rivals"]) for name in effects))
    first = sorted((c for c in answer["candidates"] if c["effect"] in named), key=lambda c: named.index(c["effect"]))
    cards = []
    for candidate in [*first, *(c for c in answer["candidates"] if c not in first)]:
        effect = library.get(candidate["effect"])
        title = effect.title if effect is not None and effect.title else "Expression found in the residuals"
        cards.append(
            {
                "effect": candidate["effect"],
                "title": title,
                "named": candidate in first,
                "kind": candidate["kind"],
                "probability": candidate["probability"],
                "noise_ratio": candidate["noise_ratio"],
                "explains": candidate["explains"],
                "equation": _equation(candidate, effect),
                "expression": candidate["expression"],
                "target": candidate.get("target"),
                "reason": reason(analysis, answer, candidate, effect),
                "parameters": candidate["parameters"],
                "source": "" if effect is None else effect.source,
            }
        )
    return cards


def _next(analysis: Any, answer: dict[str, Any] | None) -> dict[str, Any]:
    """What to do next: `do` is discover, add, experiment or nothing; `text` says it in words."""
    from host_tools.workbench.bases import ROLES
    from host_tools.workbench.settings import SETTABLE

    if answer is None:
        if analysis.missing:
            return {"do": "discover", "text": "Let discover rank what could be missing, and say how sure it is."}
        return {"do": "nothing", "text": "Nothing to add: what is left looks like noise."}
    if answer["verdict"] == "missing":
        return {"do": "add", "effects": answer["missing"], "text": "Put it in, and see the error fall."}
    if answer["verdict"] == "adequate":
        text = "Nothing to add. New runs outside these ranges would test more than more runs inside them."
        return {"do": "nothing", "text": text}
    plan = answer.get("next_experiment")
    if plan is not None:
        units = {**ROLES, **analysis.case.units}
        simulator = analysis.case.base.name == "rolling_steady" and set(plan["vary"]) <= set(SETTABLE)
        return {
            "do": "experiment",
            "text": plan["reason"],
            "runs": plan["runs"],
            "vary": [{"role": role, "unit": units.get(role, "1")} for role in plan["vary"]],
            "settings": [[setting[role] for role in plan["vary"]] for setting in plan["settings"]],
            "hold": [{"role": r, "value": v, "unit": units.get(r, "1")} for r, v in plan["hold"].items()],
            "separates": plan["separates"],
            "error_rate": plan["error_rate"],
            "simulator": simulator,
        }
    if answer["verdict"] == "ambiguous":
        text = "No experiment within the limits of these runs would tell the rivals apart: treat them as one effect."
    else:
        text = (
            "Look at the runs that carry it, and measure what may go with it: a column that is not there cannot be "
            "named. An effect of your own can be tried below."
        )
    return {"do": "nothing", "text": text}


def _targets(analysis: Any) -> dict[str, Any]:
    from host_tools.workbench.user_effects import default_target, targets

    return {"all": list(dict.fromkeys(targets(analysis.case.base))), "default": default_target(analysis.case.base)}
