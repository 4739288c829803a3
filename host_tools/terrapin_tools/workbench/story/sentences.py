"""Every sentence, chip, next step and number format of a verdict, each written once. Tellers add layout only."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from terrapin_hil.physics.expression import is_name, parse
from terrapin_hil.units import behind
from terrapin_tools.workbench.compare.comparison import LEVEL
from terrapin_tools.workbench.compare.groups import Differing
from terrapin_tools.workbench.compare.intervals import Interval
from terrapin_tools.workbench.compare.noise_findings import NoiseFinding
from terrapin_tools.workbench.compare.together import Together
from terrapin_tools.workbench.discover.certainty import EVEN, Operating
from terrapin_tools.workbench.discover.decide import CREDIBLE
from terrapin_tools.workbench.discover.ranking import Blamed
from terrapin_tools.workbench.discover.resampled import Selected
from terrapin_tools.workbench.experiment.hidden_period import HiddenPeriod
from terrapin_tools.workbench.experiment.proposal import Experiment
from terrapin_tools.workbench.formulas.free_curves import DIRECTION, Curve
from terrapin_tools.workbench.story.story import Findings, Goal, Next, NoiseTold, Part, Place, Proposal, Rung, Value

__all__ = [
    "BY_RUN",
    "HEADINGS",
    "NOT_LOOKED",
    "acts",
    "alarm",
    "alike",
    "amount",
    "carried",
    "chance",
    "chances",
    "change",
    "chip",
    "differs",
    "doubt",
    "floor",
    "goal",
    "headline",
    "in_sd",
    "interval",
    "named_unit",
    "next_step",
    "noise_line",
    "not_apart",
    "number",
    "of_hundred",
    "one_run",
    "only_here",
    "percent",
    "periodic",
    "place",
    "reason",
    "spelt",
    "strange_noise",
    "stuck",
    "taken",
    "thinned",
    "unchecked",
    "unsure",
    "verdict",
]

NEAR_FLOOR = 1.15  # error in noise sd that is as good as the floor on a handful of held-out runs
LITTLE = 0.1  # share of the misfit below which a candidate explains next to nothing
PREFIXED = ("N", "V", "A", "W", "J", "Pa", "m", "s", "Hz", "H", "F", "ohm")  # units that may have a prefix
PREFIXES = {-9: "n", -6: "µ", -3: "m", 3: "k", 6: "M", 9: "G"}
MOST_DIGITS = 9  # behind the point
NAMED_RUNS = 4  # runs that are named as carrying the misfit

CHIPS = {
    "adequate": "adequate",
    "doubtful": "no alarm",
    "missing": "something is missing",
    "ambiguous": "the data cannot tell",
    "partial": "part is known",
    "unexplained": "unexplained",
    "mishap": "look at the runs first",
}
SHOWN_ROWS = 4  # rows that are named at most
HEADINGS = {  # over the candidates, and what the number beside each of them is; "" for every other verdict
    "": ("What is missing", "probability to be part of it"),
    "adequate": ("Too small to tell, if there at all", "probability to be there"),
    "unexplained": ("Nearest, if it is one of these", "probability, if one is it"),
}
SLOW = {  # noise that is alike over many rows
    "run_offsets": "Runs differ by",
    "run_gains": "Runs differ by a factor, of",
    "drift": "Within its runs the data drift by",
    "walk": "Over the whole test the data drift by",
}
BY_RUN = {"": "Which runs carry it", "adequate": "Residual by run"}
FAULTS = ("constant", "table")  # kinds of candidates that are no effects
LIKELIEST = "Add the likeliest"  # before a command
NOT_LOOKED = "Not looked for: terrapin discover does, or terrapin report without --no-discover."


def number(value: float | None, digits: int = 4) -> str:
    """Significant digits, as short as they go; a dash for what is not there."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def in_sd(error: float | None) -> str:
    """An error in noise sd: three digits, as the plots have it."""
    return f"{error:#.3g}" if error is not None and error < 100.0 else number(error and round(error), 9)


def chance(probability: float) -> str:
    return f"{probability:.2f}" if probability >= 0.005 else "below 0.01"


def percent(share: float) -> str:
    return f"{round(100.0 * share)} %"


def of_hundred(share: float) -> str:
    """How often in 100 cases."""
    return f"{round(100.0 * share)} of 100" if share >= 0.01 else "fewer than 1 of 100"


def named_unit(name: str, text: str) -> str:
    """A quantity with its unit, as in the head of a table."""
    return name if text in ("", "1") else f"{name}, {text}"


def amount(value: Value) -> str:
    """A value with as many digits as its sd allows, two of the sd's own; what is very small or large by a prefix of its
    unit, or a power of ten.

    >>> amount(Value(0.01206, 0.00012, "N m")), amount(Value(0.0003, 4.4e-6, "s^2/rad^2"))
    ('12.06 ± 0.12 mN m', '(300.0 ± 4.4)e-6 s^2/rad^2')
    """
    sd = value.sd if value.sd and math.isfinite(value.sd) else 0.0
    if value.value is None or not math.isfinite(value.value):
        return f"{number(value.value)}{behind(value.unit)}"
    size, unit = max(abs(value.value), sd), behind(value.unit)
    prefixed = value.unit.split(" ")[0].split("/")[0] in PREFIXED
    plain = not size or (0.1 if prefixed else 1e-3) <= size < 1e4 or not (sd or prefixed)
    power = 0 if plain else 3 * math.floor(math.log10(size) / 3)
    text = _with_sd(value.value / 10.0**power, sd / 10.0**power)
    if prefixed and power in PREFIXES:
        return f"{text} {PREFIXES[power]}{unit.strip()}"
    return f"({text})e{power}{unit}" if power else f"{text}{unit}"


def _with_sd(value: float, sd: float) -> str:
    if not sd:
        return number(value, 5)
    digits = max(0, 1 - math.floor(math.log10(sd)))
    if digits > MOST_DIGITS:  # known better than it is worth printing
        return f"{number(value, 9)} ± {sd:.2g}"
    return f"{round(value, digits) + 0.0:.{digits}f} ± {sd:.{digits}f}"  # no -0


def interval(key: str, one: Interval) -> tuple[str, str, str, str]:
    """A row of the table of intervals: the ends, how unequal the sides are, and what goes with the parameter."""
    low, high = ("open" if end is None else number(end, 5) for end in (one.low, one.high))
    said = {
        "bound": "end is the bound of the fit",
        "open": "side does not close",
        "no numbers": "end is where the model gives no numbers",
    }
    sides = [f"the {side} {said[end]}" for side, end in zip(("lower", "upper"), one.ends, strict=True) if end in said]
    if not sides and one.low is not None and one.high is not None:
        sides = [f"-{number(one.value - one.low, 3)} +{number(one.high - one.value, 3)}"]
    related = f"correlation {one.correlation:+.2f} with {one.partner}" if one.partner else ""
    return key, f"{low} to {high}{behind(one.unit)}", ", ".join(sides), related


def stuck(value: Value, before: str = "") -> str:
    return f"{before}at its bound" if value.at_bound else ""


def change(before: Rung, after: Rung) -> str:
    """The errors before and after something was added or removed."""
    train = f"training {in_sd(before.train_error)} -> {in_sd(after.train_error)}"
    held = f"held out {in_sd(before.heldout_error)} -> {in_sd(after.heldout_error)}"
    return f"Error in noise sd, before -> after: {train}, {held}"


def _joined(effects: Sequence[str]) -> str:
    return " + ".join(effects)


def _either(sets: Sequence[Sequence[str]]) -> str:
    return " or ".join(_joined(one) for one in sets)


def spelt(found: Findings, effects: Sequence[str]) -> list[str]:
    """Effects as a headline has them: an expression by what it says, for its name says nothing."""
    return [found.formulas.get(name, name) for name in effects]


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value >= 1e-12 else "p < 1e-12"


def _test(p: float, level: float) -> str:
    return f"{_p(p)} at a false alarm rate of {level:g}"


def alarm(missing: bool, p: float, level: float) -> str:
    """The test alone: what compare can say."""
    if not missing:
        return f"Nothing is missing that these data could show ({_test(p, level)})."
    alone = ": the test alone does not show it, what is likeliest does" if p >= level else ""
    return f"Something is missing from the model{alone} ({_test(p, level)})."


def verdict(found: Findings | None, p: float) -> str:
    """The answer in a few words, without a verb."""
    if found is None:
        return _p(p)
    sets = [spelt(found, one) for one in found.rivals or [found.missing]]
    return f"{_either(sets)} (probability {chance(found.probability)})".lstrip()


def chip(verdict: str, probability: float | None, strange: Collection[str], mishap: bool = False) -> str:
    """The verdict in a word or two. No alarm, which is all that compare can say, is not yet an adequate model:
    something else may be likelier, or the noise `strange`. `mishap`: the runs are blamed, and not the model."""
    if mishap and verdict == "unexplained":
        return CHIPS["mishap"]
    doubtful = verdict == "adequate" and (bool(strange) or probability is None or probability < EVEN)
    return CHIPS["doubtful" if doubtful else verdict]


def headline(
    found: Findings | None,
    lacking: bool,
    p: float,
    level: float,
    strange: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
) -> str:
    """The verdict in one sentence, with its probability where discover says it; `strange` are channels of which far
    more than the stated noise is left; `units` are those of the columns."""
    if strange and not lacking:
        what = f"No alarm ({_test(p, level)}), but what is left in {_joined(strange)} is far more than the stated noise"
        return f"{what}."
    if found is None:
        return alarm(lacking, p, level)
    sure, missing = chance(found.probability), _joined(spelt(found, found.missing))
    if found.verdict == "adequate":
        if found.probability < EVEN:
            return f"No alarm ({_test(p, level)}), but that nothing is missing has only probability {sure}."
        return f"The model is adequate: with probability {sure} nothing is missing ({_test(p, level)})."
    return _missing(found, sure, missing, units or {}) + _or_nothing(found)


def _missing(found: Findings, sure: str, missing: str, units: Mapping[str, str]) -> str:
    if found.verdict == "ambiguous":
        sets, be = _either([spelt(found, one) for one in found.rivals]), "may be" if _or_nothing(found) else "is"
        cannot = f"Something {be} missing, and these data cannot tell what: {sets}. Likeliest: {missing} ({sure})."
        return cannot + _function(found)
    if found.verdict == "unexplained":
        return _unexplained(found, sure)
    if found.verdict == "partial" and found.part:
        return _partial(found, found.part, missing, units)
    return _lacking(found, sure, missing) + _function(found)


def _function(found: Findings) -> str:
    """What is surer than any formula: the column that what is missing depends on."""
    if found.column is None or found.probability >= CREDIBLE:
        return ""
    column, probability = found.column
    return f" That it depends on {column}, whatever the formula, has probability {chance(probability)}."


def _or_nothing(found: Findings) -> str:
    """What the alarm alone does not say: that it may be a false one."""
    nothing = found.front[0].probability if found.front else 0.0
    return _nothing(nothing) if nothing >= LEVEL else ""


def _nothing(probability: float) -> str:
    return f" That nothing is missing has probability {chance(probability)}."


def _unexplained(found: Findings, sure: str) -> str:
    if found.blamed:
        return _mishap(found.blamed, found.probability)
    if found.unknown:
        return _curve(found.unknown, found.probability)
    on = f" It depends on {found.where[0].variable} most." if found.where else ""
    return f"With probability {sure} no catalogued effect and no short expression explains what is missing.{on}"


def _lacking(found: Findings, sure: str, missing: str) -> str:
    before, after = [rung.heldout_error for rung in (found.ladder[0], *found.ladder)[-2:]]
    faults = [one for one in found.candidates if one.effect in found.missing and one.kind in FAULTS]
    fall = ""
    if before is not None and after is not None:
        how = "put right," if faults else "with it"
        goes = "the held-out error falls from" if after < before else "the held-out error goes from"
        fall = f": {how} {goes} {in_sd(before)} to {in_sd(after)} noise sd"
    if not faults:
        return f"With probability {sure} the model lacks {missing} and nothing else{fall}."
    what = "; ".join(title(one, "", found.together.get(one.effect, one.parameters)) for one in faults)
    lacks = _joined(spelt(found, [name for name in found.missing if name not in {one.effect for one in faults}]))
    beside = f"the model lacks {lacks} and the case" if lacks else "nothing is missing, but the case"
    return f"With probability {sure} {beside} has a fault ({what}){fall}."


def _partial(found: Findings, part: Part, missing: str, units: Mapping[str, str]) -> str:
    """What is named, how much of the misfit that is, and what is left where."""
    if found.unknown and part.together:
        lacks = _curve(found.unknown, found.probability, f"the model lacks {missing}, and")
        return f"{lacks} Together they take {percent(part.takes)} of the misfit and leave {in_sd(part.left)} noise sd."
    if found.unknown:
        more = _curve(found.unknown, found.probability, "beside it the model")
    else:
        more = f"With probability {chance(found.probability)} more is missing, which no formula here takes away."
    many = len(found.missing)
    terms = f"{number(many)} terms take" if many > 1 else "it takes"
    if not found.unknown and part.left <= NEAR_FLOOR and found.noise.strange:
        larger = [one for one in found.noise.findings if one.kind == "larger" and one.channel in found.noise.strange]
        stated = _joined([f"{number(one.value, 3)} times the stated noise of {one.channel}" for one in larger])
        return (
            f"Mostly {missing}: {terms} {percent(part.takes)} of the misfit. What is left depends on nothing that was "
            f"looked at, but is {stated}: that sd is wrong, or something is missing that shows in all rows alike. That "
            f"nothing else is missing has probability {chance(1.0 - found.probability)}."
        )
    at = f"{part.at.variable} {span(part.at.low, part.at.high)}{behind(units.get(part.at.variable, ''))}"
    return (
        f"Mostly {missing}: {terms} {percent(part.takes)} of the misfit; {in_sd(part.left)} noise sd are left in all, "
        f"largest at {at}. {more}"
    )


def span(low: float, high: float) -> str:
    return number(low) if number(low) == number(high) else f"{number(low)} to {number(high)}"


def place(failure: Place, unit_text: str) -> str:
    """What stands behind the variable's name."""
    side = "above" if failure.mean > 0 else "below"
    way = ", along the motion" if failure.along_motion else ""
    within = f"{span(failure.low, failure.high)}{behind(unit_text)}"
    return f"{within}: {failure.channel} measured {abs(failure.mean):.1f} noise sd {side} the model{way}"


def _mishap(blamed: Blamed, probability: float) -> str:
    what, sure = "What fails is" if probability >= EVEN else "What fails may be", chance(probability)
    if blamed.kind == "change":
        before, after = blamed.runs
        return (
            f"{what} a change between runs {before} and {after}, not the model (probability {sure}). From then "
            "on a channel is off by the same amount or factor: find out what was done to the rig or to the instrument "
            "before looking for physics."
        )
    if blamed.kind == "warming":
        return (
            f"{what} how the test begins, not the model (probability {sure}). Something warms up or settles over its "
            "first runs: leave them out before looking for physics."
        )
    if blamed.kind == "start":
        return (
            f"{what} how the runs begin, not the model (probability {sure}). Something settles there: wait "
            "longer before recording, or leave the first rows of each run out, before looking for physics."
        )
    if blamed.kind == "lag":
        return (
            f"{what} an instrument that comes late, not the model (probability {sure}): each row still shows a part of "
            "the one before. Hold each setting longer, or give the model that lag, before looking for physics."
        )
    one = len(blamed.runs) == 1
    if blamed.kind == "slope":
        return (
            f"{what} the ground under a single run, not the model (probability {sure}). {'Run' if one else 'Runs'} "
            f"{', '.join(blamed.runs)} {'goes' if one else 'go'} as on a slope: measure it, and map it as the role "
            "slope, before looking for physics."
        )
    which, stand = ("Run", "stands out by itself") if one else ("Runs", "stand out by themselves")
    return (
        f"{what} a single run, not the model (probability {sure}). {which} {', '.join(blamed.runs)} {stand}: "
        f"look at {'it' if one else 'them'} before looking for physics."
    )


def _curve(one: Curve, probability: float, what: str = "the model") -> str:
    by = {"": "", DIRECTION: ", times the direction of motion"}.get(one.by, f", times {one.by}")
    known = "is known for it" if is_name(one.column) else "was tried in it, as its heading is no name for one"
    return (
        f"With probability {chance(probability)} {what} lacks something that depends on {one.column}{by}, and no "
        f"formula {known}: in {one.channel} it makes {number(one.rms, 2)}{behind(one.channel_unit)} rms, "
        f"{in_sd(one.in_sd)} noise sd."
    )


def carried(errors: Sequence[tuple[str, float]], runs: int) -> str:
    """The runs whose misfit makes up half of all, with their errors in noise sd, worst first."""
    if not errors:
        return "No run is further off than its noise: the misfit is in how the rows follow each other."
    if len(errors) > 1 and runs <= 2 * len(errors):  # so many hold half of what is spread evenly
        return f"The misfit is spread over the runs: {errors[0][0]} is worst, with {in_sd(errors[0][1])} noise sd."
    names = ", ".join(f"{name} ({in_sd(error)} noise sd)" for name, error in errors[:NAMED_RUNS])
    more = f" and {len(errors) - NAMED_RUNS} more" if len(errors) > NAMED_RUNS else ""
    return f"Half of the misfit is in {len(errors)} of {runs} runs: {names}{more}."


def doubt(likeliest: Sequence[str], column: str, blind: bool) -> tuple[str, ...]:
    """Why a model that raises no alarm need not be right, and what to do about it."""
    if blind:
        return (
            "These runs could not show it either: the model's own parameters take up whatever these columns say.",
            "Measure at more settings, or fit fewer parameters.",
        )
    what = _joined(likeliest) or f"something that depends on {column or 'no one column'}"
    return (
        f"The model passes the test, but that does not make it right. Likeliest, but not shown: {what}.",
        "Give each channel's sigma, map the columns that may matter, or measure more runs.",
    )


def unsure(
    at_bound: Sequence[str], restless: Mapping[str, float], formulas: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Why an answer is not sure: parameters `at_bound` that the data pull beyond, those of `formulas` by the effect's
    name; `restless` has the channels with how many times the scatter from row to row they keep."""
    found, known = [], formulas or {}
    for key in at_bound:
        effect, _, name = key.rpartition(".")
        if effect in known:
            found.append(
                f"{name} of {known[effect]} stands at the end of what was looked at and would go beyond: it is this "
                "law only nearly, or another one."
            )
        else:
            found.append(
                f"{key} stands at its bound and would go beyond: widen it in [fit] if it may, else the equations lack "
                "more."
            )
    found += [
        f"{name}: what is left is {number(times, 2)} times what its rows scatter from one to the next. Either its "
        "noise is slow, or more is missing."
        for name, times in restless.items()
    ]
    return tuple(found)


def constant_in_set(rung: Rung, name: str, value: float, stated: float, unit: str) -> str:
    """A set among rivals that changes a stated constant: what it would be, what the set leaves, what speaks against."""
    off = abs(value / stated - 1.0)
    against = [f"{percent(off)} from what is stated"]
    errors = [rung.train_error, *([] if rung.heldout_error is None else [rung.heldout_error])]
    if max(errors) > NEAR_FLOOR:
        against.append("more than noise is left")
    leaves = f"errors {in_sd(rung.train_error)} training, {in_sd(rung.heldout_error)} held out"
    return (
        f"With {rung.added} {name} would be {number(value, 3)}{behind(unit)} ({leaves}). "
        f"Against it: {' and '.join(against)}."
    )


def only_here(effects: Sequence[str]) -> str:
    return f"{_joined(effects)}: in no catalogue. It holds inside the range of these measurements, not beyond."


def alike(sets: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """What is another name of the answer."""
    return (f"On these rows it does exactly what {_either(sets)} does.",) if sets else ()


def periodic(found: HiddenPeriod) -> str:
    """What to measure where a wave is left along a way that no column holds."""
    what = "an angle" if found.per == "turn" else "a position"
    return (
        f"What is left of {found.channel} is periodic along the integral of {found.speed}: {number(found.rate, 3)} "
        f"waves a {found.per} (noise looks so with a chance of {found.chance:.1g}): measure {what}, and map it."
    )


def acts(target: str, channels: Collection[str]) -> str:
    """What an expression does to the model."""
    if target in ("resistance", "drag", "axle"):
        return f"added to the resisting {'torque' if target == 'resistance' else 'force'}"
    return f"added to {target}" if target in channels else f"{target} is multiplied by 1 + it"


def taken(one: Proposal) -> str:
    """The share of the misfit that a candidate takes away. One that makes it larger on runs that it was not fitted to
    takes nothing; how large it leaves it says the error on these."""
    return percent(max(one.explains, 0.0))


def reason(found: Findings, one: Proposal, why_not: str) -> str:
    """Why a candidate is likely, or why it is not: what it explains, what the data hold against it."""
    share = f"{taken(one)} of the misfit"
    left = "" if one.noise_ratio is None else f" and leaves {in_sd(one.noise_ratio)} noise sd on held-out runs"
    mine = [set(rival) for rival in found.rivals if one.effect in rival]
    if mine and len(found.rivals) > 1:
        others = _either([spelt(found, sorted(set(rival) - mine[0])) for rival in found.rivals if set(rival) - mine[0]])
        if rest := spelt(found, sorted(mine[0] - {one.effect})):
            return f"With {_joined(rest)} it does as well as {others} on these data; alone it takes away {share}{left}."
        return f"Does as well as {others} on these data: it takes away {share}{left}."
    if found.verdict == "adequate":
        return f"{HEADINGS['adequate'][0]}."
    if one.effect in found.missing:
        if len(found.missing) > 1:
            return f"Alone it takes away {share}{left}; the others take away the rest."
        return f"Takes away {share}{left}."
    if any(one.effect in other.alike for other in found.weighed if found.missing in other.sets):
        return f"Predicts the same as {_joined(spelt(found, found.missing))} on these rows, and goes by that name."
    if one.explains < LITTLE:
        return f"Takes away {share}{why_not}."
    if one.noise_ratio is not None and one.noise_ratio < NEAR_FLOOR:
        near = in_sd(one.noise_ratio)
        return f"Fits nearly as well ({near} noise sd on held-out runs), but the runs together speak against it."
    return f"Takes away {share}{left}."


def goal(one: Goal) -> str:
    """Whether the error is what the user asked for, now and with what is missing."""
    unit = behind(one.unit)
    of = "held-out runs" if one.held_out else "training runs, for none is held out"
    asked = f"{number(one.wanted, 3)}{unit} asked for"
    now = f"Error of {one.channel}: {number(one.reached, 3)}{unit} ({of}), {asked}"
    if one.then is None:
        return f"{now}: {'good enough' if one.met else 'not good enough'}."
    then = f"with what is missing {number(one.then, 3)}{unit}"
    if one.met:
        return f"{now}: good enough as it is; {then}."
    return f"{now}: not good enough; {then}, {'which is' if one.then_met else 'which is not enough either'}."


def one_run(name: str) -> str:
    """That what differs between runs cannot be told."""
    return (
        f"Only {name} is trained on: nobody can tell from one run what differs between runs, nor how noisy they are. "
        'If the others may be trained on, list them too, as train = ["...", "..."] under [data].'
    )


def thinned(step: int) -> str:
    """Every how many rows were looked at."""
    return f"One row of {step} is looked at, as neighbours are alike or the table is long; errors are of those."


def too_large(parameter: str, times: float) -> str:
    """What speaks against an effect of such a size."""
    return f" Its {parameter} is {number(times, 2)} times what is usual for such a robot, which speaks against it."


def doubtful(effect: str, parameter: str, times: float) -> str:
    """What speaks against an effect that is named."""
    usual = f"The {parameter} of {effect} is {number(times, 2)} times what is usual for such a robot"
    return f"{usual}, which speaks for something else that has the same shape."


def strange_noise(probability: float | None) -> str:
    """Why a model that passed is not called adequate although nothing else is likelier; what discover adds to it."""
    sure = "" if probability is None else _nothing(probability)
    look = "a sensor that sticks or has lost its sign looks so, and a sd that is stated wrong"
    return f"It depends on nothing that was looked at. Look at the residual: {look}.{sure}"


def noise_source(noise: NoiseTold) -> str:
    """Where the noise sd comes from, and of what kind the noise is."""
    return f"{noise.source}; {noise.model}" + (
        f", correlation from row to row {number(noise.rho)}" if noise.rho else ""
    )


def floor(noise: NoiseTold) -> str:
    """What an error of 1.0 is."""
    if noise.floor:
        return "1.0 is the noise floor"
    return "the noise sd was estimated while something is missing, and holds a part of it: 1.0 is no floor"


def noise_line(told: str, noise: NoiseTold) -> str:
    """`told`, where the noise sd comes from, and what an error of 1.0 is: two sentences, without the last point."""
    last = floor(noise)
    return f"{told[:1].upper()}{told[1:]}. " + (
        f"In noise sd {last}" if noise.floor else f"{last[:1].upper()}{last[1:]}"
    )


def noise_told(one: NoiseFinding, unit: str) -> str:
    """What the noise is like, in a sentence."""
    value = f"{number(one.value, 3)}{behind(unit)}"
    if one.kind in ("larger", "smaller"):
        times = f"{number(one.value, 3)} times what is stated"
        unless = f", unless run {one.runs[0]} is to blame, which makes up more than half of it" if one.runs else ""
        return f"The noise of {one.channel} is {times} (probability {chance(one.probability)}){unless}."
    if one.kind in ("rows", "stuck"):
        more = len(one.rows) - SHOWN_ROWS
        few = ", ".join(one.rows[:SHOWN_ROWS]) + (f" and {more} more" if more > 0 else "")
        stand = "row stands" if len(one.rows) == 1 else "rows stand"
        left = "is" if len(one.rows) == 1 else "are"
        if one.kind == "stuck":
            sticks = "repeat a value exactly, as a sensor that sticks or clips does, and are left out"
            return f"{len(one.rows)} rows {sticks}: {few}."
        return f"{len(one.rows)} {stand} apart from the others of the run and {left} left out: {few}."
    if one.kind == "run_gains":
        value = f"{number(100.0 * one.value, 2)} %"
    what = f"{SLOW[one.kind]} {value} in {one.channel} more than the model explains"
    return f"{what} (probability {chance(one.probability)})."


def not_apart(one: Together, units: Mapping[str, str]) -> str:
    """What of some parameters is determined; `units` are those of the parameters. A sum is in the unit of its first
    term, which has no factor."""
    known = [
        f"{d.formula} = {amount(Value(d.value, d.sd, _combined(d.formula, units)))}"
        f"{', near these values' if d.near else ''}"
        for d in one.determined
    ]
    names = f"{', '.join(one.parameters[:-1])} and {one.parameters[-1]}"
    return f"These data do not tell {names} apart; of them they determine {'; '.join(known) or 'nothing'}."


def _combined(formula: str, units: Mapping[str, str]) -> str:
    """The unit of a combination of parameters, "1" where it is not known.

    >>> _combined("b + 46.98*f", {"b": "N s/m", "f": "1"}), _combined("c/a^2", {"a": "s", "c": "V"})
    ('N s/m', 'V/s^2')
    """
    first = formula.split(" ")[0]
    if first in units:
        return units[first]
    try:
        found = f"{parse(first.replace('^', '**')).unit(units):~}"
    except (KeyError, ValueError):
        return "1"
    return found.replace(" ** ", "^").replace(" * ", " ").replace(" / ", "/") or "1"


def unchecked(effect: str, bare: Sequence[str]) -> str:
    """Why the units of an own effect are taken as they stand."""
    has = "has" if len(bare) == 1 else "have"
    return f"The units of {effect} are not checked: {', '.join(bare)} {has} none."


def title(one: Proposal, known: str, values: Mapping[str, Value]) -> str:
    """What a candidate is, in a few words; `known`: as the catalogue has it; `values`: as it is told, alone or with the
    others that are named."""
    if one.kind == "constant" and "value" in values:
        value = values["value"]
        return f"{one.effect.partition('.')[2]} would be {number(value.value)}{behind(value.unit)}"
    if one.kind == "table":
        mend = f" (factor {number(one.parameters['factor'].value)})" if "factor" in one.parameters else ""
        return f"{one.expression}{mend}"
    return known or "Expression found in the residuals"


def chances(operating: Sequence[Operating], selected: Sequence[Selected]) -> tuple[tuple[str, str], ...]:
    """How often such an effect would be named first with these runs, and how often each answer wins on runs drawn
    anew."""
    rows = {f"{o.effect} of {number(o.size, 3)} noise sd": f"named first in {of_hundred(o.named)}" for o in operating}
    rows |= {
        f"{_joined(s.effects) or s.kind}, runs drawn anew": f"likeliest in {percent(s.frequency)}" for s in selected
    }
    return tuple(rows.items())


def next_step(
    missing: bool,
    found: Findings | None,
    folder: str,
    units: Mapping[str, str],
    zeros: Collection[str],
    strange: bool = False,
) -> Next:
    """What to do next, in words, and the command that does it; `zeros`: what to hold at 0."""
    if strange and not missing:
        return Next("nothing", "See first where so much noise comes from, or state the sd that was found.")
    if found is None and missing:
        text = "Let discover rank what could be missing, and say how sure it is."
        return Next("discover", text, offer="Look for it", command=f"terrapin discover {folder}")
    if found is None or found.verdict == "adequate":
        text = "Nothing to add. New runs outside these ranges would test more than more runs inside them."
        return Next("nothing", text)
    add = f"terrapin add {folder} {' '.join(found.missing)}"
    if found.verdict == "missing":
        return Next("add", "Put it in, and see the error fall.", offer="Add it", command=add)
    if found.verdict == "partial":
        text = "Put in what is part of it, and look again at what is left."
        return Next("add", text, offer="Add it" if len(found.missing) == 1 else "Add them", command=add)
    if found.verdict == "unexplained":
        return Next("nothing", _measured_next(found))
    if found.plan is not None:
        return _experiment(found.plan, units, zeros, add)
    text = "No experiment within these limits and speeds tells the rivals apart: widen [limits], or take them as one."
    return Next("nothing", text, offer=LIKELIEST, command=add)


def _measured_next(found: Findings) -> str:
    """Where nothing can be put in."""
    if found.blamed and found.blamed.kind == "run":
        runs = f"{'run' if len(found.blamed.runs) == 1 else 'runs'} {', '.join(found.blamed.runs)}"
        return f"Repeat {runs}, or leave {runs} out of the table, and look again."
    if found.unknown and not is_name(found.unknown.column):
        return (
            f"Map {found.unknown.column} under a name of letters a to z, digits and _, and look again: formulas are "
            "then tried in it."
        )
    if found.unknown:
        return (
            f"Measure between the settings of {found.unknown.column} that you have, and look at the curve: it says "
            "what a formula must do. Then try it as an effect of your own."
        )
    if found.probability < EVEN:
        errors = [found.ladder[0].train_error, found.ladder[0].heldout_error or 0.0]
        within = "The model is within its noise all the same. " if max(errors) < 1.0 else ""
        return f"{within}Measure more runs over the same range, and look again."
    return (
        "Look at the runs that carry it, and measure what may go with it: a column that is not there cannot be named. "
        "An effect of your own can be tried, too."
    )


def _experiment(plan: Experiment, units: Mapping[str, str], zeros: Collection[str], add: str) -> Next:
    at = {role: 0.0 if role in zeros else value for role, value in plan.hold.items()}
    hold = ", ".join(f"{role} {number(value)}{behind(units.get(role, ''))}" for role, value in at.items())
    after = f"Afterwards the wrong one would be preferred in {of_hundred(plan.error_rate)} cases."
    rows = Counter(tuple(number(setting[role]) for role in plan.vary) for setting in plan.settings)
    return Next(
        "experiment",
        f"{plan.runs} runs that vary {' and '.join(plan.vary)} tell {' and '.join(plan.separates)} apart. "
        f"{plan.reason}",
        vary=tuple(named_unit(role, units.get(role, "")) for role in plan.vary),
        settings=tuple((f"{count} x", *row) for row, count in rows.items()),
        after=f"Hold {hold}. {after}" if hold else after,
        offer=LIKELIEST,
        command=add,
    )


def differs(one: Differing, level: float) -> str:
    """Whether a parameter differs between groups: its groups from the lowest value to the highest."""
    ordered = " < ".join(sorted(one.values, key=lambda group: one.values[group]))
    if one.p_value < level:
        return f"{one.parameter} differs by {one.by} ({_p(one.p_value)}): {ordered}"
    return f"{one.parameter} may be the same for every {one.by} ({_p(one.p_value)})"
