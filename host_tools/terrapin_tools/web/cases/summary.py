"""What the page's lists and heads show of cases and effects. Runs in the warm worker: reading cases takes imports.

Every function takes and gives plain JSON values.
"""

from __future__ import annotations

import json
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.files.json_text import to_json
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.noise.stated import FAR
from terrapin_tools.workbench.story.sentences import chip

__all__ = ["bases", "check_expression", "detail", "effects", "keep", "summaries"]

LAST = "last.json"  # in the case's .terrapin: the last answer that the server got, and the state that it is about


def keep(folder: str, answer: dict[str, Any]) -> None:
    """Keep an answer of compare, add or remove for the page, with the state of the case."""
    place = Path(folder) / history.FOLDER
    place.mkdir(exist_ok=True)
    write_whole(place / LAST, to_json({"state": history.case_state(Path(folder)), "answer": answer}))


def _last(folder: Path) -> dict[str, Any] | None:
    """The last answer about the case as it stands: of discover if there is one, else of compare, add or remove."""
    answer = history.recall(folder)
    if answer is not None:
        return answer
    try:
        kept = json.loads((folder / history.FOLDER / LAST).read_text(encoding="utf-8"))
        if isinstance(kept, dict) and kept.get("state") == history.case_state(folder):
            answer = kept["answer"]
            return answer if isinstance(answer, dict) and "verdict" in answer else None
    except (OSError, ValueError, KeyError):
        pass
    return None


def summaries(folders: list[str]) -> list[dict[str, Any]]:
    """One line of the list of cases each; a broken case says in `error` what is wrong with it."""
    return [_summary(Path(folder)) for folder in folders]


def _summary(folder: Path) -> dict[str, Any]:
    empty: dict[str, Any] = {"title": folder.name, "base": "", "effects": [], "runs": 0, "rows": 0, "channels": []}
    try:
        case = load_case(folder)
    except UserError as error:
        return {**empty, "verdict": None, "chip": "", "error": _plain(error)}
    answer = _last(folder)
    findings = answer.get("noise", {}).get("findings", ()) if answer else ()
    mishap = bool(answer and (answer.get("mishap") or answer.get("odd_runs")))
    strange = [one["channel"] for one in findings if one["kind"] == "larger" and one["value"] > FAR]
    return {
        "title": case.title,
        "base": case.base.name,
        "effects": list(case.effects),
        "runs": len(case.run_names),
        "rows": case.rows,
        "channels": list(case.channels),
        "verdict": None if answer is None else answer["verdict"],
        "chip": "" if answer is None else chip(answer["verdict"], answer.get("answer_probability"), strange, mishap),
        "error": None,
    }


def detail(folder: str) -> dict[str, Any]:
    """A case in full, without its rows. UserError when it is broken."""
    case = load_case(Path(folder))
    answer = _last(case.folder)
    sets = {
        name: {case.run_names[i] for i in case.run[rows]} for name, rows in (("train", case.train), ("test", case.test))
    }
    return {
        "title": case.title,
        "base": case.base.name,
        "effects": list(case.effects),
        "parameters": {k: {"value": v, "unit": case.parameter_units.get(k, "1")} for k, v in case.parameters.items()},
        "columns": {
            name: {"column": column, "unit": case.units.get(name) or "1", "channel": name in case.channels}
            for name, column in case.column_of.items()
        },
        "extra": sorted(case.extra),
        "rows": case.rows,
        "runs": {name: sorted(runs) for name, runs in sets.items()},
        "limits": {role: list(limits) for role, limits in case.limits.items()},
        "toml": case.text,
        "answer": answer,
        "ladder": [] if answer is None else answer["ladder"],
        "history": history.history(case.folder),
    }


def effects(base: str, folder: str) -> list[dict[str, Any]]:
    """The catalogue, the user's own effects and (with a folder) the case's, for the page; "" for all bases."""
    from terrapin_hil.effect_files import known_effects
    from terrapin_hil.physics.effects import catalogue
    from terrapin_hil.physics.mechanics import mechanics
    from terrapin_tools.workbench.bases import BASES
    from terrapin_tools.workbench.story.formulas import from_expression, from_latex

    known = known_effects()
    if folder:
        known.update(load_case(Path(folder)).library)
    found = []
    for effect in known.values():
        if base and not (base in BASES and BASES[base].takes(effect)):
            continue
        try:
            equation = from_latex(effect.equation)
        except ValueError:
            equation = from_expression(effect.expression)
        found.append(
            {
                "name": effect.name,
                "title": effect.title,
                "sentence": _sentence(effect),
                "equation": effect.equation,
                "mathml": equation,
                "expression": effect.expression,
                "target": effect.target,
                "source": effect.source,
                "bases": list(effect.bases),
                "needs": [list(group) for group in effect.needs],
                "parameters": [
                    {"name": p.name, "unit": p.unit or "1", "start": p.start, "meaning": p.meaning}
                    for p in effect.parameters
                ],
                "simulator": effect.plant,
                "controller": bool(effect.firmware),
                "own": effect.name not in catalogue() and effect.name.partition("_on_")[0] not in mechanics(),
            }
        )
    return found


def _sentence(effect: Any) -> str:
    """One sentence: what it is, what it acts on, what it depends on."""
    acts = {
        "resistance": "adds to the resisting torque",
        "drag": "resists the motion",
        "axle": "resists at the axle",
    }.get(effect.target, f"acts on {effect.target}")
    needs = ", ".join(" or ".join(group) for group in effect.needs)
    title = effect.title[:1].upper() + effect.title[1:]
    return f"{title}: {acts}" + (f", depends on {needs}." if needs else ".")


def bases() -> list[dict[str, Any]]:
    """What the mapper needs of each base model: channels, roles, constants with units and placeholders."""
    from terrapin_tools.workbench.bases import BASES, ROLES

    return [
        {
            "name": base.name,
            "channels": [{"name": name, "unit": unit} for name, unit in base.channels.items()],
            "roles": [{"name": name, "unit": unit, "needed": name in base.needs} for name, unit in ROLES.items()],
            "parameters": [
                {"name": name, "unit": q.unit, "placeholder": q.placeholder or None, "default": q.default}
                for name, q in base.parameters.items()
            ],
            "options": {name: list(values) for name, values in base.options.items()},
            "own_names": base.own_names,
            "own_dynamics": base.own_dynamics,
            "left_out": list(base.left_out),
            "fit": next((f"{name} = {entry}" for name, entry in base.first_fit.items()), None),
        }
        for base in BASES.values()
    ]


SLIP = 0.85  # of difflib's ratio: omga for omega has 0.89, omega_s of somebody's own 0.83


def check_expression(
    folder: str, expression: str, target: str, parameters: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    """Whether an effect of one's own is sound: what `terrapin add --expression` would say, without adding it."""
    from terrapin_hil.physics.expression import parse
    from terrapin_tools.workbench.bases import formula_name
    from terrapin_tools.workbench.case.changes import OwnEffect, OwnParameter, add_effects
    from terrapin_tools.workbench.story.formulas import from_expression

    case = load_case(Path(folder))
    target = target or case.base.targets()[0][0]

    def answer(ok: bool, message: str, **more: Any) -> dict[str, Any]:
        empty: dict[str, Any] = {"unit": None, "mathml": None, "target": target, "names": [], "unknown": []}
        return {"ok": ok, "message": message, **empty, **more}

    try:
        parsed = parse(expression)
    except ValueError as error:
        return answer(False, str(error))
    mathml = from_expression(expression)
    if target not in case.base.acts_on():
        return answer(
            False, f"target: found {target!r}, expected one of {', '.join(case.base.acts_on())}", mathml=mathml
        )
    known = {*case.inputs, *case.parameters, *case.fit, "speed"}
    known |= {formula_name(name) for name in case.base.provides}
    unknown = sorted(parsed.names - known - parameters.keys())
    if unknown:
        message = (
            f"{unknown[0]} is no role, column or parameter: give it a start value, or use {', '.join(sorted(known))}"
        )
        return answer(False, message, mathml=mathml, names=sorted(parsed.names), unknown=unknown)
    unused = sorted(parameters.keys() - parsed.names)
    if unused:
        message = f"{unused[0]} does not occur in the expression"
        return answer(False, message, mathml=mathml, names=sorted(parsed.names))  # so that the page lets go of it
    own = {
        name: OwnParameter(entry["value"], entry.get("min"), entry.get("max"), entry.get("unit") or "1")
        for name, entry in parameters.items()
    }
    name = "own_expression"
    while name in case.library:
        name += "_"
    try:
        larger = case.changed(add_effects(case.text, [name], {name: OwnEffect(expression, target, own)}))
    except UserError as error:
        return answer(False, _plain(error), mathml=mathml, names=sorted(parsed.names))
    units = {p.name: p.unit or "1" for p in larger.library[name].parameters}
    first = next(iter(units), None)
    message = "sound: " + ", ".join(f"{key} in {unit}" for key, unit in units.items()) if units else "sound"
    if shared := sorted(parsed.names & set(case.fit)):
        which = f"{', '.join(shared)} {'is' if len(shared) == 1 else 'are'} the model's own, one value in both"
        message += f"; {which}: another name is a parameter of its own"
    for key in units:
        if meant := get_close_matches(key, known, 1, SLIP):
            message += f"; {key} is a parameter of its own: or is {meant[0]} meant?"
    return answer(True, message, unit=units.get(first or ""), mathml=mathml, names=sorted(parsed.names))


def _plain(error: UserError) -> str:
    """The complaint without the path before the file's name, which the page need not show."""
    text = str(error)
    head, mark, rest = text.partition("case.toml")
    return mark + rest if mark and "/" in head and " " not in head.strip("/") else text
