"""What the Workbench tab draws of a case: one JSON object a view, one a preview.

    draft(folder)                                      the fitted model beside the measurements, not yet judged
    view(folder)                                       verdict in words, plots, ranking, ladder, what to do next
    preview(folder, ["bulldozing"], noise, kept)       the curve and the errors with effects that are not added yet

Everything comes from the pieces that the commands and the report use; nothing is computed a second way. They are called
in a process of their own (warm.py), and view_api.py keeps what they answer.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.physics.effects import Effect
from terrapin_tools.errors import UserError
from terrapin_tools.web.cases import all_rows
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.case.changes import OwnEffect, OwnParameter
from terrapin_tools.workbench.compare.comparison import (
    Analysis,
    analyse,
    error,
    fitted_on,
    measured,
    predict,
    require_numbers,
)
from terrapin_tools.workbench.compare.refit import refit
from terrapin_tools.workbench.experiment.rig_settings import SETTABLE
from terrapin_tools.workbench.files.json_text import finite
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.story import answer
from terrapin_tools.workbench.story.effect_picture import as_svg
from terrapin_tools.workbench.story.formulas import from_latex, of_model
from terrapin_tools.workbench.story.notes import to_html
from terrapin_tools.workbench.story.plot_data import MAX_ROWS, Drawn, drawn_data
from terrapin_tools.workbench.story.sentences import amount, chance, noise_line, number, stuck
from terrapin_tools.workbench.story.story import Card, Story
from terrapin_tools.workbench.story.told import told

__all__ = ["draft", "preview", "thumbnail", "view"]

THUMBNAIL = 150  # points


def draft(folder: str | Path, rows_to: str = "") -> dict[str, Any]:
    """The plot of a case as soon as the model is fitted; what takes longer (the noise, the verdict) is `view`'s.

    Of a channel whose noise is not stated `noise_sd` is None. `rows_to`: where all rows go if they are thinned here.
    """
    case = load_case(Path(folder))
    rows = case.train | case.test
    channels = Model.of(case).channels
    given = [case.sigma[name] for name in channels]
    scale = np.std([case.channels[name][case.train] for name in channels], axis=1)
    sigma = np.array([max(s, 1e-300) if g is None else g for s, g in zip(scale, given, strict=True)])
    fits = fitted_on(case, case.effects, case.train, sigma)
    prediction = predict(fits[-1], rows)
    require_numbers(case, fits[-1].model, prediction, fits[-1].theta, rows, "after the fit")
    base = predict(fits[0], rows) if case.effects else None
    drawn = Drawn(case, rows, channels, sigma, prediction, measured(fits[-1].model, rows) - prediction, base)
    plot = drawn_data(drawn, (), (), ())
    for channel in plot["channels"]:
        channel["noise_sd"] = case.sigma[channel["name"]]
    if rows_to:
        all_rows.keep(Path(rows_to), drawn, plot)
    return {
        "title": case.title,
        "base": case.base.name,
        "effects": list(case.effects),
        "runs": len({*case.run[rows].tolist()}),
        "held_out": sorted({case.run_names[i] for i in case.run[case.test]}),
        "plot": plot,
    }


def thumbnail(folder: str | Path) -> dict[str, Any]:
    """A small picture of a case: its first channel, measured and as the model has it, over what `draft` draws it;
    at most THUMBNAIL points, so that it is a picture and no result."""
    plot = draft(folder)["plot"]
    channel, column = plot["channels"][0], plot["columns"][plot["variable"]]
    step = -(-len(channel["measured"]) // THUMBNAIL)
    return {
        "x": {"name": plot["variable"], "unit": column["unit"], "values": column["values"][::step]},
        "y": {"name": channel["name"], "unit": channel["unit"]},
        "measured": channel["measured"][::step],
        "predicted": channel["predicted"][::step],
    }


def view(folder: str | Path, rows_to: str = "") -> dict[str, Any]:
    """Everything that is drawn of a case, in the words of its story. UserError when anything in it is wrong.

    `plot` is as `plot_data.page_data` has it, without curves of candidates, which `preview` gives one by one, and of
    all rows where only some were judged. `rows_to`: where all rows go if they are thinned here.
    """
    folder = Path(folder)
    case = load_case(folder)
    analysis = analyse(case)
    found = answer.recall(folder)
    story = told(analysis, found)
    effects = analysis.model.effects
    parameters = {key: amount(value) for key, value in story.parameters.items()}
    drawn = _drawn(case, analysis, story)
    plot = drawn_data(drawn, story.where, story.ladder, ())
    if drawn.case is not case:  # rows that were put aside are none of `preview`'s either
        place = np.cumsum(case.train | case.test)[drawn.rows]
        plot["columns"]["row"]["values"] = place[np.array(plot["columns"]["row"]["values"]) - 1].tolist()
    shown = {
        "title": story.title,
        "base": story.base,
        "effects": story.effects,
        "runs": story.runs,
        "held_out": story.held_out,
        "verdict": story.verdict,
        "chip": story.chip,
        "headline": story.headline,
        "where": [{"variable": p.variable, "channel": p.channel, "text": p.sentence} for p in story.where],
        "remarks": [*story.intake, *([story.alarm] if story.alarm else []), *story.notes],
        "curve": as_svg(found.unknown) if found and found.unknown else "",
        "discovered": found is not None,
        "missing": found.missing if found else (),
        "rivals": found.rivals if found else (),
        "heading": story.heading,
        "measure": story.measure,
        "by_run": story.by_run,
        "formulas": of_model(case.text),
        "model": [_in_model(effect, parameters, case) for effect in effects],
        "constants": _constants(case),
        "cards": [_card(card) for card in story.cards],
        "next": _next(story, case),
        "parameters": [[key, amount(value), stuck(value)] for key, value in story.parameters.items()],
        "channels": {name: vars(channel) for name, channel in story.channels.items()},
        "errors": {
            name: [*(number(v) for v in (c.noise_sd, c.train_rmse, c.heldout_rmse)), c.unit]
            for name, c in story.channels.items()
        },
        "noise": noise_line(story.noise_told, story.noise),
        "front": [vars(one) for one in story.front],
        "chances": story.chances,
        "history": history.history(folder),
        "notes": to_html(case.notes),
        "targets": _targets(case),
        "catalogue": sorted(name for name in case.library if name not in case.effects),
        "names": sorted({*case.inputs, *case.parameters, *case.fit}),
        "exports": sorted(effect.name for effect in effects if effect.firmware),
        "plot": plot,
    }
    if rows_to:
        all_rows.keep(Path(rows_to), drawn, plot)
    return dict(finite(shown))


def _drawn(case: Case, analysis: Analysis, story: Story) -> Drawn:
    """What is drawn: the rows that were judged, or all of a table of which each so-manieth was, by the same fit."""
    drawn, rows = Drawn.of(analysis, story), case.train | case.test
    if analysis.step == 1 and rows.sum() <= MAX_ROWS:
        return drawn
    fit = analysis.ladder[-1].fit
    prediction = predict(fit, rows)
    base = predict(analysis.ladder[0].fit, rows) if case.effects else None
    residual = measured(fit.model, rows) - prediction
    return replace(drawn, case=case, rows=rows, prediction=prediction, residual=residual, base=base)


def preview(
    folder: str | Path,
    effects: Sequence[str],
    noise: dict[str, float],
    kept: Sequence[int],
    whole: bool = False,
    own: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The model refitted with `effects` added: prediction by channel on the rows `kept`, errors, parameters.

    `noise` is the sd by channel and `kept` the rows, counted from 0, that `view` draws; so nothing of the comparison
    is done again. With `whole` the effects are all that the model has: those of the case and more, or some of them,
    or none. `own` is the formula of the only effect, which the case does not know: expression, target, parameters.
    UserError when an effect is unknown, in the model already, or gives no prediction.
    """
    folder = Path(folder)
    case = load_case(folder)
    found = answer.recall(folder)
    proposed = {one.effect: one.own for one in found.candidates} if found else {}
    if own is not None:
        proposed = {effects[0]: _formula(own)}
    inside = case.effects if whole else ()
    known = [name for name in dict.fromkeys([*inside, *proposed, *case.library]) if whole or name not in case.effects]
    for name in effects:
        if name not in known or list(effects).count(name) > 1:
            raise UserError(f"effect: found {name!r}, expected each once and of {', '.join(known)}")
    channels = Model.of(case).channels
    sigma = np.array([noise[name] for name in channels])
    fit: Fit | None
    if whole and set(effects) < set(inside):
        fit = fitted_on(case, [name for name in inside if name in effects], case.train, sigma)[-1]
    elif not set(inside) <= set(effects):
        raise UserError(f"effect: expected those of the model and more, or some of them: {', '.join(inside)}")
    else:
        fit = refit(case, sigma, proposed, tuple(name for name in effects if name not in inside))
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


def _formula(own: dict[str, Any]) -> OwnEffect:
    parameters = {
        name: OwnParameter(entry["value"], entry.get("min"), entry.get("max"), entry.get("unit") or "1")
        for name, entry in own["parameters"].items()
    }
    return OwnEffect(own["expression"], own["target"] or None, parameters)


def _constants(case: Case) -> list[dict[str, Any]]:
    """What [parameters] states, as it is written there, what that is in SI, and whether somebody has confirmed it."""
    written = tomllib.loads(case.text).get("parameters", {})
    return [
        {
            "name": name,
            "text": str(written[name]),
            "si": f"{value:.6g} {case.parameter_units.get(name, '')}".strip().removesuffix(" 1"),
            "guessed": f"parameters.{name}" in case.guessed,
        }
        for name, value in case.parameters.items()
        if isinstance(written.get(name), str | int | float)
    ]


def _own(case: Case, name: str) -> dict[str, Any] | None:
    """The formula of an effect of the user's own, to be mended; None of one of the catalogue."""
    table = tomllib.loads(case.text).get("effect", {}).get(name)
    if table is None:
        return None
    parameters = {key: entry for key, entry in table.items() if isinstance(entry, dict)}
    return {"expression": table.get("expression", ""), "target": table.get("target", ""), "parameters": parameters}


def _in_model(effect: Effect, parameters: Mapping[str, str], case: Case) -> dict[str, Any]:
    own = f"{effect.name}."
    return {
        "effect": effect.name,
        "own": _own(case, effect.name),
        "equation": from_latex(effect.equation),
        "values": [f"{key[len(own) :]} = {text}" for key, text in parameters.items() if key.startswith(own)],
    }


def _card(card: Card) -> dict[str, Any]:
    one = card.proposal
    return {
        "effect": one.effect,
        "title": card.title,
        "named": card.named,
        "probability": one.probability,
        "chance": chance(one.probability),
        "equation": from_latex(card.latex),
        "acts": card.acts,
        "reason": card.reason,
        "values": [f"{name} = {amount(value)}{stuck(value, ' ')}" for name, value in card.values.items()],
    }


def _next(story: Story, case: Case) -> dict[str, Any]:
    """What to do next: `do` is discover, add, experiment or nothing; `text` says it in words."""
    plan = story.found.plan if story.found else None
    step = {key: value for key, value in vars(story.next).items() if key not in ("offer", "command")}
    simulator = plan is not None and case.base.on_robot and set(plan.vary) <= set(SETTABLE)
    return {**step, "simulator": simulator}


def _targets(case: Case) -> dict[str, Any]:
    base = case.base
    return {"all": list(dict.fromkeys(base.acts_on())), "default": base.targets()[0][0]}
