"""Makes the story of a case, once, from what compare and discover found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import numpy.typing as npt

from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import parse
from terrapin_hil.units import behind
from terrapin_tools.workbench.bases import ROLES
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.case.effects import OWN, without_unit
from terrapin_tools.workbench.compare import comparison
from terrapin_tools.workbench.compare.adequacy import Failure
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.compare.groups import differences
from terrapin_tools.workbench.compare.noise_findings import NoiseFinding, far_above_stated, noise_findings
from terrapin_tools.workbench.compare.together import Together, together
from terrapin_tools.workbench.discover.certainty import EVEN
from terrapin_tools.workbench.discover.discovery import Candidate, Discovery, rung
from terrapin_tools.workbench.experiment.hidden_period import hidden_period
from terrapin_tools.workbench.model import constants
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.table_faults import Fault
from terrapin_tools.workbench.model.usual_sizes import usual_size
from terrapin_tools.workbench.noise.estimate import Noise
from terrapin_tools.workbench.noise.stuck import clipped_rows, full_ends
from terrapin_tools.workbench.story import sentences
from terrapin_tools.workbench.story.explain import short_answers
from terrapin_tools.workbench.story.story import (
    Card,
    Channel,
    Findings,
    Goal,
    NoiseTold,
    Part,
    Place,
    Proposal,
    Rung,
    Story,
    Value,
)

__all__ = ["found_by", "told"]

TOO_LARGE = 5.0  # times what is usual, from which a size is said to speak against an effect
STILL = 0.05  # a role whose span is below this share of its magnitude hardly varies
AS_ZERO = 0.01  # share of a role's largest value below which what to hold is 0


def told(analysis: Analysis, discovery: Discovery | Findings | None = None) -> Story:
    """The story of a comparison, and of what discover found in it, just now or as it was kept."""
    case = analysis.case
    found = found_by(discovery) if isinstance(discovery, Discovery) else discovery
    verdict = found.verdict if found else ("missing" if analysis.missing else "adequate")
    noise = found.noise if found else _noise(analysis, analysis.told, noise_findings(analysis))
    sigma = np.array([noise.sds[channel] for channel in analysis.model.channels])
    p, units = analysis.adequacy.p_value, {**ROLES, **case.parameter_units, **case.units}
    strange = noise.strange
    where = found.where if found else _places(analysis, analysis.where, sigma)
    goals, tied = _goals(analysis, found), tuple(together(analysis))
    heading, measure = sentences.HEADINGS.get(verdict if found else "", sentences.HEADINGS[""])
    return Story(
        folder=case.folder,
        title=case.title,
        base=case.base.name,
        effects=tuple(case.effects),
        runs=len({*case.run[analysis.rows].tolist()}),
        held_out=tuple(sorted({case.run_names[i] for i in case.run[case.test]})),
        verdict=verdict,
        p_value=p,
        level=analysis.level,
        chip=sentences.chip(verdict, found.probability if found else None, strange, bool(found and found.blamed)),
        headline=sentences.headline(found, analysis.missing, p, analysis.level, strange, case.units),
        alarm=sentences.alarm(analysis.missing, p, analysis.level) if found and analysis.missing else "",
        where=tuple(replace(p, sentence=sentences.place(p, case.units.get(p.variable, ""))) for p in where),
        notes=tuple(_notes(analysis, found, noise, sigma, goals, tied)),
        by_run=sentences.BY_RUN.get(verdict, sentences.BY_RUN[""]),
        heading=heading,
        measure=measure,
        cards=tuple(_cards(analysis, found)) if found else (),
        front=short_answers(found) if found and found.front[1:] else (),
        chances=sentences.chances(found.operating, found.selected) if found else (),
        next=sentences.next_step(
            analysis.missing, found, str(case.folder), units, _zeros(analysis, found), bool(strange)
        ),
        ladder=_ladder(analysis, found),
        parameters=_values(analysis.fit, analysis.sd),
        channels=_channels(analysis, sigma),
        noise=noise,
        noise_told=sentences.noise_source(noise),
        found=found,
        groups=tuple(differences(analysis)),
        together=tied,
        intake=(*case.intake, *_ends(case)),
        goals=goals,
        guessed=case.guessed,
        rows_left_out=case.rows_left_out,
    )


def _ends(case: Case) -> list[str]:
    """Channels that stand at an end of their range in more rows than are left out for it (noise/stuck.py)."""
    found = []
    for name, values in case.channels.items():
        for end in full_ends(values) if not clipped_rows(values).any() else ():
            what, count = "least" if end == values.min() else "greatest", int((values == end).sum())
            found.append(
                f"{name} stands at {end:.6g}{behind(case.units[name])}, its {what} number, in {count} of {case.rows} "
                "rows: if its sensor ends there, leave them out before you believe a term."
            )
    return found


def _ladder(analysis: Analysis, found: Findings | None) -> tuple[Rung, ...]:
    return found.ladder if found else _rungs([rung(analysis, r.added, r.fit, analysis.told) for r in analysis.ladder])


def _notes(
    analysis: Analysis,
    found: Findings | None,
    noise: NoiseTold,
    sigma: npt.NDArray[np.float64],
    goals: Sequence[Goal],
    tied: Sequence[Together],
) -> Iterator[str]:
    """What is said beside the verdict, line by line."""
    case = analysis.case
    yield from (sentences.goal(one) for one in goals)
    if len(trained := {*case.run[case.train].tolist()}) == 1 and case.test.any():
        yield sentences.one_run(case.run_names[trained.pop()])
    if analysis.step > 1:
        yield sentences.thinned(analysis.step)
    if analysis.missing and len(case.run_names) > 1 and not (found and found.blamed):
        yield _carried(analysis, sigma)
    if found:
        yield from _doubtful(analysis, found)
    yield from (sentences.noise_told(one, case.units.get(one.channel) or "") for one in noise.findings)
    if (period := hidden_period(analysis)) is not None:
        yield sentences.periodic(period)
    given = {**case.parameter_units, **{n: one.unit for n, one in case.fit.items()}, **case.units}
    for name in case.effects:
        effect = case.library[name]
        if effect.source == OWN and (bare := without_unit(effect, case.base, given)):
            yield sentences.unchecked(name, bare)
    own = {one.key: one.unit for one in analysis.fit.model.fitted if one.unit}
    yield from (sentences.not_apart(one, own) for one in tied)
    if noise.strange and not analysis.missing:
        yield sentences.strange_noise(found.probability if found else None)
    yield from found.remarks if found else ()


def found_by(discovery: Discovery) -> Findings:
    """What discover found, as plain data."""
    analysis, around, fit = discovery.analysis, discovery.around, discovery.ladder[-1].fit
    noise = around or analysis.told
    named: dict[str, dict[str, Value]] = {}
    if discovery.missing:
        for key, value in _values(fit, comparison.sds(fit, analysis.case, analysis.noise.sigma, noise)).items():
            effect, _, name = key.rpartition(".")
            if effect in discovery.missing:
                named.setdefault(effect, {})[name] = value
        for effect in filter(constants.named, named):
            named[effect] = _constant(fit, effect, next(iter(named[effect].values())).sd or 0.0)
    candidates, formulas = tuple(_proposal(one) for one in discovery.candidates), _formulas(discovery)
    remarks: tuple[str, ...] = ()
    if discovery.verdict == "adequate" and discovery.answer_probability < EVEN:
        likeliest = max(discovery.ranking.hypotheses, key=lambda h: h.log_weight)
        if not far_above_stated(analysis):
            remarks = sentences.doubt(likeliest.effects, likeliest.column, discovery.ranking.blind)
    elif own := [c.effect for c in candidates if c.kind == "expression" and c.effect in discovery.missing]:
        remarks = (sentences.only_here([formulas[name] for name in own]),)
    remarks += sentences.alike([[formulas.get(name, name) for name in one] for one in discovery.aliases])
    remarks += _constants_in_sets(discovery, noise)
    remarks += sentences.unsure(discovery.doubts.at_bound, discovery.doubts.restless, formulas)
    return Findings(
        verdict=discovery.verdict,
        missing=discovery.missing,
        probability=discovery.answer_probability,
        candidates=candidates,
        rivals=discovery.rivals,
        plan=discovery.experiment,
        where=_places(analysis, discovery.where, noise.sigma),
        ladder=_rungs(discovery.ladder),
        blamed=discovery.blamed,
        unknown=discovery.unknown,
        operating=discovery.operating,
        selected=discovery.selected,
        together=named,
        remarks=remarks,
        then=_rms(analysis, fit) if discovery.missing else {},
        noise=_noise(analysis, noise, noise_findings(analysis, around), around is not None),
        part=_part(analysis, discovery, noise.sigma),
        front=discovery.front,
        weighed=discovery.weighed,
        formulas=formulas,
        column=_column(discovery),
    )


def _column(discovery: Discovery) -> tuple[str, float] | None:
    """The one column of all formulas that are named, and the probability that what is missing is a function of it."""
    columns = {discovery.ranking.columns.get(name, "") for name in chain(discovery.missing, *discovery.rivals)}
    sure = [c.column_probability for c in discovery.candidates if c.effect.name in discovery.missing]
    if len(columns) > 1 or not sure or sure[0] is None:
        return None
    return columns.pop(), sure[0]


def _formulas(discovery: Discovery) -> dict[str, str]:
    sets = [discovery.missing, *discovery.rivals, *discovery.aliases, *(one.effects for one in discovery.front)]
    sets += [(one.effect.name,) for one in discovery.candidates]
    sets += [names for one in discovery.weighed for names in one.sets]
    known = discovery.ranking.expressions
    named = dict.fromkeys(name for names in sets for name in names if name in known)
    return {name: f"{known[name].expression} in {known[name].target}" for name in named}


def _part(analysis: Analysis, discovery: Discovery, sigma: npt.NDArray[np.float64]) -> Part | None:
    part = discovery.part
    if part is None:
        return None
    (at,) = _places(analysis, [part.at], analysis.noise.sigma)  # it is in the sds that are told already
    return Part(part.takes, part.left, at, part.together)


def _constants_in_sets(discovery: Discovery, noise: Noise) -> tuple[str, ...]:
    """Of the rivals that change a stated constant beside an effect: a card shows the constant alone."""
    found = []
    for hypothesis in discovery.ranking.hypotheses:
        if (
            hypothesis.kind == "part"
            or hypothesis.effects not in discovery.rivals
            or len(hypothesis.effects) < 2
            or hypothesis.fit is None
        ):
            continue
        for effect in filter(constants.named, hypothesis.effects):
            case, name = hypothesis.fit.model.case, constants.named(effect)
            (told,) = _rungs([rung(discovery.analysis, " + ".join(hypothesis.effects), hypothesis.fit, noise)])
            value = constants.value_of(hypothesis.fit, effect)
            unit = case.parameter_units.get(name, "1")
            found.append(sentences.constant_in_set(told, name, value, case.parameters[name], unit))
    return tuple(found)


def _noise(analysis: Analysis, noise: Noise, findings: Sequence[NoiseFinding], again: bool = False) -> NoiseTold:
    """`again`: the noise was estimated around what is named."""
    channels, rho = analysis.model.channels, noise.node.share * noise.node.rho
    sds = dict(zip(channels, noise.sigma.tolist(), strict=True))
    held = analysis.missing and not again and not noise.known.all() and noise.groups is None
    return NoiseTold(sds, noise.source, noise.node.words(channels), rho, tuple(findings), not held)


def _places(analysis: Analysis, where: Sequence[Failure], sigma: npt.NDArray[np.float64]) -> tuple[Place, ...]:
    """Where the model fails, in noise of the sds `sigma`."""
    scale = dict(zip(analysis.model.channels, (analysis.noise.sigma / sigma).tolist(), strict=True))
    return tuple(
        Place(f.variable, f.low, f.high, f.channel, f.mean_residual * scale[f.channel], f.with_direction) for f in where
    )


def _rungs(ladder: Sequence[comparison.Rung]) -> tuple[Rung, ...]:
    return tuple(Rung(rung.added, rung.train_error, rung.heldout_error) for rung in ladder)


def _values(fit: Fit, sd: npt.NDArray[np.float64]) -> dict[str, Value]:
    """Every fitted parameter by its key, with the bounds that case or effect state."""
    return {
        one.key: Value(float(value), float(s), one.unit or "1", *_bounds(one.lower, one.upper), one.key in fit.at_bound)
        for one, value, s in zip(fit.model.fitted, fit.theta, sd, strict=True)
    }


def _bounds(low: float, high: float) -> tuple[float | None, float | None]:
    """None where there is none."""
    return low if np.isfinite(low) else None, high if np.isfinite(high) else None


def _channels(analysis: Analysis, sigmas: npt.NDArray[np.float64]) -> dict[str, Channel]:
    case, held = analysis.case, analysis.case.test[analysis.rows]
    return {
        name: Channel(
            float(sigma),
            float(np.sqrt(np.mean(residual[~held] ** 2))),
            float(np.sqrt(np.mean(residual[held] ** 2))) if held.any() else None,
            case.units[name] or "1",
        )
        for name, sigma, residual in zip(analysis.model.channels, sigmas, analysis.residual, strict=True)
    }


def _goals(analysis: Analysis, found: Findings | None) -> tuple[Goal, ...]:
    """What the case asks for, channel by channel."""
    case, present = analysis.case, _rms(analysis, analysis.fit)
    return tuple(
        Goal(
            name,
            asked,
            present[name],
            found.then.get(name) if found and found.missing else None,
            case.units[name] or "1",
            bool(case.test.any()),
        )
        for name, asked in case.goal.items()
    )


def _rms(analysis: Analysis, fit: Fit) -> dict[str, float]:
    """Rms error by channel, in its unit: of the held-out runs, or of the training runs where there are none."""
    rows = analysis.case.test if analysis.case.test.any() else analysis.case.train
    gap = comparison.measured(fit.model, rows) - comparison.predict(fit, rows)
    return {n: float(v) for n, v in zip(fit.model.channels, np.sqrt(np.mean(gap * gap, axis=1)), strict=True)}


def _proposal(candidate: Candidate) -> Proposal:
    effect, count = candidate.effect, len(candidate.fit.theta) - len(candidate.effect.parameters)
    parameters = {}
    for i, one in enumerate(effect.parameters, count):
        value, sd = float(candidate.fit.theta[i]), float(candidate.sd[i])
        parameters[one.name] = Value(value, sd, one.unit or "1", *_bounds(one.minimum, one.maximum))
    if constants.named(effect.name):
        parameters = _constant(candidate.fit, effect.name, float(candidate.sd[count]))
    mend = effect.mend if isinstance(effect, Fault) else None
    if mend:
        parameters = _mended(mend)
    return Proposal(
        effect.name,
        candidate.kind,
        effect.title if mend else effect.expression,
        effect.target,
        candidate.probability,
        candidate.heldout_rmse,
        candidate.noise_ratio,
        parameters,
        candidate.explains,
        candidate.column_probability,
        mend,
    )


def _mended(mend: Mapping[str, float | str | int]) -> dict[str, Value]:
    """The numbers of a fault of the table; they are chosen from a list, not fitted."""
    known = {"factor": "factor", "delay": "rows"}
    return {known[key]: Value(float(value), 0.0, "1") for key, value in mend.items() if key in known}


def _constant(fit: Fit, effect: str, sd: float) -> dict[str, Value]:
    """What a stated constant would be; `sd` of its relative error."""
    case, name = fit.model.case, constants.named(effect)
    unit = case.parameter_units.get(name, "1")
    return {"value": Value(constants.value_of(fit, effect), abs(case.parameters[name]) * sd, unit)}


def _latex(one: Proposal, effect: Effect | None) -> str:
    """The equation of a candidate; a fault of the table has none."""
    if one.mend:
        return ""
    return parse(one.expression).to_latex() if effect is None or one.kind == "expression" else effect.equation


def _cards(analysis: Analysis, found: Findings) -> list[Card]:
    """What the answer names first, in its order, then the others, likeliest first."""
    case = analysis.case
    named = list(dict.fromkeys(name for effects in (found.missing, *found.rivals) for name in effects))
    cards = []
    for one in sorted(found.candidates, key=lambda c: named.index(c.effect) if c.effect in named else len(named)):
        effect, values = case.library.get(one.effect), found.together.get(one.effect, one.parameters)
        own = one.kind == "expression" or (effect is None and one.mend is None)
        reason = sentences.reason(found, one, _why_not(analysis, found, effect))
        if one.effect not in found.missing and (large := _too_large(analysis, found, one)):
            reason += sentences.too_large(*large)
        cards.append(
            Card(
                proposal=one,
                title=sentences.title(one, effect.title if effect else "", values),
                named=one.effect in named,
                latex=_latex(one, effect),
                acts=sentences.acts(one.target, {**case.base.channels, **case.base.forces}) if own else "",
                source=effect.source if effect else "",
                reason=reason,
                values=values,
            )
        )
    return cards


def _why_not(analysis: Analysis, found: Findings, effect: Effect | None) -> str:
    """What in the data speaks against an effect; empty when nothing simple does."""
    if effect is None:
        return ""
    case = analysis.case
    for group in effect.needs:
        for role in [role for role in group if role in case.roles][:1]:
            values = case.roles[role][analysis.rows]
            if np.ptp(values) <= STILL * max(float(np.abs(values).max()), 1e-300):
                return f": {role} hardly varies in these runs"
    failing = found.where[0].channel if found.where else None
    if effect.target in case.base.channels and failing is not None and failing != effect.target:
        return f": it changes {effect.target}, and it is {failing} that fails"
    return ""


def _too_large(analysis: Analysis, found: Findings, one: Proposal) -> tuple[str, float] | None:
    """The parameter that is its size, and how many times what is usual that is; None where it is not far from it."""
    effect = analysis.case.library.get(one.effect)
    usual = usual_size(effect, analysis.case) if effect is not None else None
    values = found.together.get(one.effect, one.parameters)
    if effect is None or usual is None or one.explains < sentences.LITTLE:
        return None
    times = abs(values[effect.parameters[0].name].value) / usual
    return (effect.parameters[0].name, times) if times > TOO_LARGE else None


def _doubtful(analysis: Analysis, found: Findings) -> list[str]:
    """What is named although its size speaks against it."""
    sizes = {one.effect: _too_large(analysis, found, one) for one in found.candidates if one.effect in found.missing}
    return [sentences.doubtful(effect, *large) for effect, large in sizes.items() if large]


def _carried(analysis: Analysis, sigma: npt.NDArray[np.float64]) -> str:
    """The runs whose misfit beyond noise makes up half of all."""
    run = analysis.case.run[analysis.rows]
    square = ((analysis.residual / sigma[:, None]) ** 2).mean(axis=0)
    runs, place = np.unique(run, return_inverse=True)
    rows, of_run = np.bincount(place), np.bincount(place, square)
    beyond = np.maximum(of_run - rows, 0.0)  # a run within its noise takes nothing off the others' misfit
    order = np.argsort(-beyond, kind="stable")
    before = np.cumsum(beyond[order]) - beyond[order]
    carrying = order[before < 0.5 * beyond.sum()]
    error = np.sqrt(of_run / rows)
    return sentences.carried([(analysis.case.run_names[runs[i]], float(error[i])) for i in carrying], len(runs))


def _zeros(analysis: Analysis, found: Findings | None) -> set[str]:
    """Roles to hold at what is as good as 0 on the scale of their measurements."""
    hold, roles = found.plan.hold if found and found.plan else {}, analysis.case.roles
    return {r for r, value in hold.items() if r in roles and abs(value) < AS_ZERO * float(np.abs(roles[r]).max())}
