"""One telling: every teller says the same chip, sentences and numbers of a verdict, and each is written once."""

from __future__ import annotations

import ast
import html
import json
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from casekit import terrapin

from terrapin_hil.paths import ROOT
from terrapin_tools.web.cases import view as page_view
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.changes import add_effects
from terrapin_tools.workbench.compare.comparison import Analysis, analyse
from terrapin_tools.workbench.compare.noise_findings import NoiseFinding
from terrapin_tools.workbench.discover.decide import Weight
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.discover.misfit import Step
from terrapin_tools.workbench.discover.resampled import Selected
from terrapin_tools.workbench.experiment.proposal import Experiment
from terrapin_tools.workbench.files.json_text import to_json
from terrapin_tools.workbench.fleet.fleet import Result
from terrapin_tools.workbench.fleet.lines import json_line
from terrapin_tools.workbench.story import answer, page, sentences, terminal
from terrapin_tools.workbench.story.explain import explain
from terrapin_tools.workbench.story.plot_data import page_data
from terrapin_tools.workbench.story.sentences import amount
from terrapin_tools.workbench.story.story import Findings, Part, Place, Proposal, Rung, Story, Value
from terrapin_tools.workbench.story.terminal import tell, tell_shortly
from terrapin_tools.workbench.story.told import found_by, told

TOOLS = ROOT / "host_tools" / "terrapin_tools"
CHIPS = {
    "adequate": "adequate",
    "doubtful": "no alarm",
    "missing": "something is missing",
    "ambiguous": "the data cannot tell",
    "partial": "part is known",
    "unexplained": "unexplained",
}


@dataclass(frozen=True)
class Example:
    folder: Path
    analysis: Analysis
    story: Story


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Example]:
    """The heated motor as discover answers it, and with other answers put in the place of that one."""
    made: dict[str, Example] = {}
    for verdict in CHIPS:
        folder = tmp_path_factory.mktemp("cases") / verdict
        shutil.copytree(ROOT / "cases" / "heated_motor", folder, ignore=shutil.ignore_patterns(".terrapin"))
        if verdict in ("adequate", "doubtful"):
            (folder / "case.toml").write_text(add_effects(load_case(folder).text, ["motor_heating"], {}))
        if verdict in ("adequate", "doubtful", "missing"):
            discovery = discover(load_case(folder), bootstrap=20)
            if verdict != "missing":
                sure = {"adequate": 0.9123, "doubtful": 0.3123}[verdict]
                discovery = replace(discovery, answer_probability=sure)
            analysis, found = discovery.analysis, found_by(discovery)
        else:
            first = made["missing"]
            analysis = replace(first.analysis, case=load_case(folder))
            found = _another(first.story.found, verdict)
        assert found.verdict == verdict.replace("doubtful", "adequate")
        story = told(analysis, found)
        answer.keep(folder, story)
        made[verdict] = Example(folder, analysis, story)
    return made


def _another(found: Findings | None, verdict: str) -> Findings:
    assert found is not None
    if verdict == "ambiguous":
        reason = "motor_heating and viscous_friction predict the same here because load stays at 18.6 N in all runs"
        settings = ({"load": 12.3456, "speed": 0.25}, {"load": 31.0, "speed": -0.75})
        plan = Experiment(("load", "speed"), settings, {"temperature": 1e-9}, ("motor_heating", "x"), 2, 0.004, reason)
        rivals = (("motor_heating",), ("viscous_friction", "current_offset"))
        column = ("load", 0.9876)
        return replace(found, verdict=verdict, probability=0.4321, rivals=rivals, plan=plan, column=column)
    if verdict == "partial":
        part = Part(0.97, 1.7, Place("load", 12.3, 14.5, "current", -1.5))
        return replace(found, verdict=verdict, probability=0.6543, part=part)
    return replace(
        found,
        verdict=verdict,
        missing=(),
        probability=0.8765,
        together={},
        ladder=found.ladder[:-1],
        operating=(),
        remarks=("The best set, a+b, leaves more than noise: error 2.17 training, 4.59 held out.",),
    )


def _words(text: str) -> str:
    """Text as one line, in ASCII where a terminal has it so."""
    return re.sub(r"\s+", " ", text.replace("±", "+-"))


def _plain(page_text: str) -> str:
    body = re.sub(r"<(script|style).*?</\1>", " ", page_text, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", "", re.sub(r"</(li|p|td|th|span|b|h2|button)>", " ", body)))


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        value = [part for entry in value.items() for part in entry]
    if isinstance(value, list | tuple):
        for one in value:
            yield from _texts(one)
    elif isinstance(value, str):
        yield value


def _carried(count: int) -> str:
    return sentences.carried([(f"r{i}", 3.0) for i in range(count)], 12)


def _left_out(count: int) -> str:
    rows = tuple(f"runs.csv:{i + 2}" for i in range(count))
    return sentences.noise_told(NoiseFinding("rows", "", float(count), 1.0, rows), "")


def _changed(error: float) -> str:
    return sentences.constant_in_set(Rung("constant.R", 1.0, error), "R", 1.3, 1.2, "ohm")


@pytest.mark.parametrize(
    ("say", "before", "beyond", "said"),
    [
        (sentences.chance, 0.006, 0.004, "below 0.01"),
        (_carried, 4, 5, "r3 (3.00 noise sd) and 1 more"),
        (_left_out, 4, 5, "runs.csv:5 and 1 more"),
        (_changed, 1.1, 1.2, "and more than noise is left"),
        (lambda sd: amount(Value(1.0, sd, "")).partition("e-")[0], 2e-8, 2e-9, "1 ± 2"),
    ],
    ids=["chance", "runs", "rows", "constant", "digits"],
)
def test_a_sentence_is_another_beyond_its_bound(say: Callable[[Any], str], before: Any, beyond: Any, said: str) -> None:
    assert say(beyond).rstrip(".").endswith(said)
    assert not say(before).rstrip(".").endswith(said)


def test_what_explains_less_than_a_tenth_is_told_with_what_speaks_against_it(examples: dict[str, Example]) -> None:
    story = examples["missing"].story
    assert story.found is not None
    other = replace(story.cards[0].proposal, effect="other", noise_ratio=2.0)
    little, some = (sentences.reason(story.found, replace(other, explains=share), ": why") for share in (0.09, 0.11))
    assert little == "Takes away 9 % of the misfit: why."
    assert some == "Takes away 11 % of the misfit and leaves 2.00 noise sd on held-out runs."


def by_terminal(example: Example) -> str:
    return tell(example.story)


def by_report(example: Example) -> str:
    return _plain(page.render(example.story, page_data(example.analysis, example.story, ())))


def by_page(example: Example) -> str:
    shown = page_view.view(example.folder)
    shown.pop("plot")
    return "\n".join(_texts(shown))


TELLERS = {"terminal": by_terminal, "report": by_report, "page": by_page}


def check(chip: str, example: Example, said: str) -> None:
    """A teller says what is in the story, formatted here a second time."""
    story, found, said = example.story, example.story.found, _words(said)
    assert found is not None
    assert re.search(rf"(^|[\[ ]){chip}($|[\] ])", said)
    assert not any(f"[{other}]" in said for other in CHIPS.values() if other != chip)
    expected = [story.headline, story.alarm, *story.notes, story.heading, story.measure, story.next.text]
    expected += [place.sentence for place in story.where]
    expected += [f"{place.variable} " for place in story.where]
    expected += [f"probability {found.probability:.2f}"] if story.verdict != "ambiguous" else []
    expected += [f"{abs(place.mean):.1f} noise sd" for place in story.where]
    for card in story.cards[:3]:
        one = card.proposal
        shown = f"{one.probability:.2f}" if one.probability >= 0.005 else "below 0.01"
        assert re.search(rf"{one.effect}\s.*?{re.escape(shown)}", said), (one.effect, shown)
        expected += [card.reason]
        if one.effect in found.missing:
            expected += [f"{name} = {amount(value).replace('±', '+-')}" for name, value in card.values.items()]
    for key, value in story.parameters.items():
        expected += [key, amount(value).replace("±", "+-")]
    for name, channel in story.channels.items():
        expected += [f"{name} {channel.noise_sd:.4g} {channel.train_rmse:.4g} {channel.heldout_rmse:.4g}"]
    if found.missing and found.verdict == "missing":
        before, after = (f"{rung.heldout_error:#.3g}" for rung in story.ladder[-2:])
        expected += [f"from {before} to {after} noise sd", f"leaves {after} noise sd on held-out runs"]
    if "Errors in noise sd" in said:  # report and page draw the ladder
        rungs = ((rung.added or "(base model)", rung.train_error, rung.heldout_error) for rung in story.ladder)
        expected += [f"{added} {train:#.3g} {held:#.3g}" for added, train, held in rungs]
    assert len(story.front) == (len(found.front) if len(found.front) > 1 else 0)
    if "Short answers first" in said:  # the page draws them
        for short, step in zip(story.front, found.front, strict=True):
            errors = f"{step.train_error:#.3g} {step.heldout_error:#.3g}"
            expected += [f"{len(step.effects)} {short.name} {errors} {short.probability}"]
    expected += [part for row in story.chances for part in row]
    expected += [f"named first in {round(100 * o.named)} of 100" for o in found.operating]
    if found.plan is not None:
        expected += [f"{setting[role]:.4g}" for setting in found.plan.settings for role in found.plan.vary]
        expected += [
            "load, N",
            "Hold temperature 0 degC. Afterwards the wrong one would be preferred in fewer than 1 of 100",
        ]
    for text in expected:
        assert _words(text) in said, text


@pytest.mark.parametrize("teller", TELLERS)
@pytest.mark.parametrize("verdict", CHIPS)
def test_every_teller_says_the_same(examples: dict[str, Example], verdict: str, teller: str) -> None:
    check(CHIPS[verdict], examples[verdict], TELLERS[teller](examples[verdict]))


def test_where_most_is_left_has_its_unit(examples: dict[str, Example]) -> None:
    example = examples["partial"]
    assert example.story.found is not None
    part = Part(0.97, 1.7, Place("temperature", 42.3, 44.5, "current", -1.5))
    headline = told(example.analysis, replace(example.story.found, part=part)).headline
    assert "largest at temperature 42.3 to 44.5 degC." in headline


def test_a_constant_beside_an_effect_has_one_value_everywhere(examples: dict[str, Example]) -> None:
    """That of both together: the headline had the one that the constant has alone."""
    example = examples["missing"]
    assert example.story.found is not None
    alone = Proposal(
        "constant.radius", "constant", "relative_error", "radius", 0.9, {}, 1.5, {"value": Value(0.1, 0.01, "m")}, 0.3
    )
    found = replace(
        example.story.found,
        missing=(*example.story.found.missing, alone.effect),
        candidates=(*(one for one in example.story.found.candidates if one.effect != alone.effect), alone),
        together={**example.story.found.together, alone.effect: {"value": Value(0.08, 0.001, "m")}},
    )
    story = told(example.analysis, found)
    assert "(radius would be 0.08 m)" in story.headline
    (card,) = [one for one in story.cards if one.proposal.effect == alone.effect]
    assert (card.title, card.values["value"].value) == ("radius would be 0.08 m", 0.08)


@pytest.mark.parametrize("verdict", ["missing", "ambiguous", "unexplained"])
def test_an_alarm_that_may_be_a_false_one_says_so(examples: dict[str, Example], verdict: str) -> None:
    """One null case in twenty raises it; the posterior often knew, and only a table said so."""
    example = examples[verdict]
    found = example.story.found
    assert found is not None
    told_now = {}
    for nothing in (0.04, 0.22):
        front = (Step((), nothing, 1.2, 1.1), *found.front[1:])
        told_now[nothing] = told(example.analysis, replace(found, front=front)).headline
    assert "nothing is missing" not in told_now[0.04]
    assert told_now[0.22].endswith(" That nothing is missing has probability 0.22.")
    assert ("Something may be missing" in told_now[0.22]) == (verdict == "ambiguous")


@pytest.mark.parametrize("verdict", ["missing", "ambiguous"])
def test_what_is_surer_than_a_formula_is_said(examples: dict[str, Example], verdict: str) -> None:
    """ "k*log(speed/1.6) and nothing else", 0.34, hid that it surely depends on the speed."""
    example = examples[verdict]
    found = example.story.found
    assert found is not None
    said = {}
    for probability in (0.34, 0.89, 0.9):
        unsure = replace(found, probability=probability, column=("speed", 0.97))
        said[probability] = told(example.analysis, unsure).headline
    for probability in (0.34, 0.89):
        assert said[probability].endswith(" That it depends on speed, whatever the formula, has probability 0.97.")
    assert "whatever the formula" not in said[0.9]
    assert "whatever the formula" not in told(example.analysis, replace(found, probability=0.34, column=None)).headline


def test_an_error_that_does_not_fall_is_not_said_to(examples: dict[str, Example]) -> None:
    example = examples["missing"]
    assert example.story.found is not None
    assert "the held-out error falls from" in example.story.headline
    rungs = example.story.found.ladder
    worse = replace(example.story.found, ladder=(rungs[0], replace(rungs[-1], heldout_error=rungs[0].heldout_error)))
    assert "the held-out error goes from" in told(example.analysis, worse).headline


def test_another_name_of_the_answer_says_whose_it_is(examples: dict[str, Example]) -> None:
    example = examples["missing"]
    found = example.story.found
    assert found is not None
    (name,) = found.missing
    other = next(one.effect for one in found.candidates if one.effect != name)
    weighed = (Weight("set", ((name,),), "", 0.99, (other,)), *found.weighed[1:])
    story = told(example.analysis, replace(found, weighed=weighed))
    (card,) = [one for one in story.cards if one.proposal.effect == other]
    assert card.reason.startswith(f"Predicts the same as {name} on these rows, and goes by that name.")
    assert story.found is not None
    kept = answer.read(json.loads(to_json(answer.answer(story))))
    assert kept.weighed[0].alike == (other,)


@pytest.mark.parametrize("verdict", CHIPS)
def test_lines_and_json_say_the_same(examples: dict[str, Example], verdict: str) -> None:
    example = examples[verdict]
    story, found = example.story, example.story.found
    assert found is not None
    line = tell_shortly(story)
    assert line.startswith(f"[{CHIPS[verdict]}] ")
    assert f"(probability {found.probability:.2f})" in line
    errors = [f"{rung.heldout_error:#.3g}" for rung in story.ladder]
    assert line.endswith("; held-out error " + " -> ".join(errors))
    assert all(error in _words(tell(story)) for error in errors)
    said = answer.answer(story)
    assert (said["verdict"], said["answer_probability"]) == (found.verdict, found.probability)
    assert [c["probability"] for c in said["candidates"]] == [c.probability for c in found.candidates]
    assert [rung["heldout_error"] for rung in said["ladder"]] == [rung.heldout_error for rung in story.ladder]
    of_fleet = json.loads(json_line(Result(example.folder, story, "")))
    assert of_fleet.pop("folder") == example.folder.name
    assert of_fleet == said


def test_what_was_weighed_is_explained(examples: dict[str, Example]) -> None:
    """The likeliest first, with the odds of the second; the best set of each number of terms; of none, a line."""
    story = examples["missing"].story
    found = story.found
    assert found is not None
    chances = [one.probability for one in found.weighed if one.kind != "rest"]
    assert chances == sorted(chances, reverse=True)
    assert sum(one.probability for one in found.weighed) == pytest.approx(1.0, abs=1e-4)
    assert found.missing in found.weighed[0].sets
    assert [len(step.effects) for step in found.front] == list(range(len(found.front)))
    assert found.front[1].effects == found.missing
    assert found.front[1].probability == found.probability  # an answer is one thing told once
    errors = [step.heldout_error or 0.0 for step in found.front]
    assert errors == sorted(errors, reverse=True)
    said = _words(explain(story))
    first, second = found.weighed[:2]
    assert f"{first.probability:.2f}: {' + '.join(found.missing)}" in said
    odds = float(f"{first.probability / second.probability:.2g}")
    assert f", {odds:g} times less: " in said
    assert "What would turn it: " in said
    alone = tuple(one for one in found.weighed if not one.sets)  # no effect changes what the model cannot
    none = replace(story, found=replace(found, candidates=(), weighed=alone))
    assert explain(none).startswith("Nothing could be weighed: ")
    assert len(explain(none).splitlines()) == 1


def test_explain_is_of_one_case_and_a_text(examples: dict[str, Example], capsys: pytest.CaptureFixture[str]) -> None:
    folder = examples["missing"].folder
    alone = "--explain: found beside --plant or --json -, expected the answer as text"
    for options in (("--json", "-"), ("--plant", "motor_heating=1sd")):
        status, out, said = terrapin(capsys, "discover", folder, "--explain", *options)
        assert (status, out) == (2, "")
        assert alone in said
    status, out, said = terrapin(capsys, "discover", folder.parent, "--explain")
    assert (status, out) == (2, "")
    assert f"--explain: {folder.parent} is a folder of cases, expected one case" in said.replace("\n", " ")


@pytest.mark.parametrize("verdict", CHIPS)
def test_a_kept_answer_is_the_same_story(examples: dict[str, Example], verdict: str) -> None:
    example = examples[verdict]
    again = told(example.analysis, answer.recall(example.folder))
    assert to_json(answer.answer(again)) == to_json(answer.answer(example.story))
    for mine, kept in zip(
        (again.headline, again.where, again.notes, again.chances, again.next),
        (s := example.story) and (s.headline, s.where, s.notes, s.chances, s.next),
        strict=True,
    ):
        assert mine == kept
    assert [(c.reason, c.values) for c in again.cards] == [(c.reason, c.values) for c in example.story.cards]


def test_a_broken_kept_answer_is_as_good_as_none(examples: dict[str, Example], tmp_path: Path) -> None:
    folder = tmp_path / "case"
    shutil.copytree(examples["missing"].folder, folder)
    assert answer.recall(folder) is not None
    assert answer.recall(folder, 0.05) is not None
    assert answer.recall(folder, 0.01) is None
    file = folder / ".terrapin" / "discover.json"
    kept = json.loads(file.read_text())
    for key, value in (("where", [{}]), ("ladder", 3), ("candidates", [{"effect": "x"}]), ("answer_probability", "?")):
        file.write_text(json.dumps({**kept, key: value}))
        assert answer.recall(folder) is None


PLANTED: list[tuple[str, Any, str, Callable[..., str]]] = [
    ("terminal", terminal, "chance", lambda p: f"{p + 0.01:.2f}"),
    ("terminal", terminal, "amount", lambda value: f"{value.value:.4g}"),
    ("terminal", terminal, "in_sd", lambda value: f"{value:.2f}"),
    ("terminal", terminal, "number", lambda value, digits=4: f"{value:.2f}" if value else "-"),
    ("report", page.sentences, "chance", lambda p: f"{100 * p:.0f} %"),
    ("report", page.sentences, "number", lambda value, digits=4: f"{value:.2f}"),
    ("page", page_view, "_card", lambda card: {"effect": card.proposal.effect, "chance": "0.50"}),
]


@pytest.mark.parametrize(("teller", "module", "name", "wrong"), PLANTED)
def test_a_teller_with_a_number_of_its_own_is_caught(
    examples: dict[str, Example],
    monkeypatch: pytest.MonkeyPatch,
    teller: str,
    module: Any,
    name: str,
    wrong: Callable[..., str],
) -> None:
    monkeypatch.setattr(module, name, wrong)
    with pytest.raises(AssertionError):
        check(CHIPS["missing"], examples["missing"], TELLERS[teller](examples["missing"]))


def test_compare_says_the_same_everywhere(examples: dict[str, Example], tmp_path: Path) -> None:
    """Before discover: the test's sentence, the same chip, and the next step."""
    folder = tmp_path / "case"
    shutil.copytree(ROOT / "cases" / "heated_motor", folder, ignore=shutil.ignore_patterns(".terrapin"))
    analysis = analyse(load_case(folder))
    example = Example(folder, analysis, told(analysis))
    assert example.story.found is None
    for teller in TELLERS.values():
        said = _words(teller(example))
        for text in ("something is missing", example.story.headline, example.story.next.text, *example.story.notes):
            assert _words(text) in said


# ---------------------------------------------------------------- written once


def _constants(path: Path) -> list[str]:
    """Texts in a module, docstrings apart; of an f-string each part."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documents = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents
    ]


def _phrases(text: str) -> list[str]:
    """The part of a text that would be known again: two words and more, without what stands around it."""
    bare = re.sub(r"\s+", " ", text).strip(" .:,;()")
    known = len(bare.split()) > 1 and len(bare) > 16 and not re.fullmatch(r"terrapin \w+", bare)  # a command's name
    return [bare.lower()] if known else []


def twice(sources: dict[str, str], own: list[str]) -> list[str]:
    """Phrases of `own` that stand in a source as well."""
    return [f"{where}: {phrase}" for where, text in sources.items() for phrase in own if phrase in text]


def _sources() -> dict[str, str]:
    """Texts of every other module, and whole scripts, in small letters."""
    found = {}
    for path in sorted(TOOLS.rglob("*.py")):
        if path.name != "sentences.py":
            found[path.relative_to(TOOLS).as_posix()] = re.sub(r"\s+", " ", "\n".join(_constants(path))).lower()
    for path in sorted((TOOLS / "web" / "static").rglob("*.js")):
        found[path.relative_to(TOOLS).as_posix()] = re.sub(r"\s+", " ", path.read_text(encoding="utf-8")).lower()
    return found


def test_every_sentence_is_written_once() -> None:
    constants = [phrase for text in _constants(TOOLS / "workbench/story/sentences.py") for phrase in _phrases(text)]
    counted = Counter(constants)
    assert len(counted) > 50
    assert {"something is missing", "the data cannot tell", "put it in, and see the error fall"} <= counted.keys()
    assert [phrase for phrase, count in counted.items() if count > 1] == []
    assert twice(_sources(), list(counted)) == []


def test_a_share_of_runs_drawn_anew_counts_no_hundred() -> None:
    """Of twenty draws it was "25 of 100"."""
    assert sentences.chances((), (Selected(("slope",), "catalogue", 0.25),)) == (
        ("slope, runs drawn anew", "likeliest in 25 %"),
    )


def test_a_sentence_written_twice_is_found() -> None:
    own = ["the data cannot tell"]
    assert twice({"web/static/x.js": "const words = { ambiguous: 'the data cannot tell' };"}, own)


def test_scripts_have_no_words_for_verdicts() -> None:
    for path in sorted((TOOLS / "web" / "static").rglob("*.js")):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"[{,]\s*['\"]?(adequate|missing|ambiguous|unexplained)['\"]?\s*:\s*['\"`]", text), (
            path.name
        )
        assert not re.search(r"verdict\s*[=!]==?", text), path.name
