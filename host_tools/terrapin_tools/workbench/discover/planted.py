"""Will it be seen? An effect is hidden in the user's own table, and discover is asked.

The table is what the case's model predicts, plus the effect at the size that is asked for, plus the table's own
residuals with a random sign for each run: noise as it is on this rig, within its runs and between them. What the model
lacks today counts as noise there. Every draw takes signs and a shape of the effect anew.

    planted = plant(case, "speed_squared", "2sd")
    planted.noticed, planted.named, planted.tied
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.physics.effects import Effect
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.comparison import LEVEL, Analysis, analyse, free_slopes, measured
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.files.units import convert_difference, same_kind
from terrapin_tools.workbench.model.data_columns import candidates, is_phase
from terrapin_tools.workbench.model.effect_columns import Shape, loudness, shapes_of
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.covariance import orthonormal

__all__ = ["Planted", "plant", "size_of"]

IN_SD = "sd"
# Times the size parameter of the loudest shape; one that needs more is out of sight of these runs. Chosen by hand.
WIDEST = 30.0


@dataclass(frozen=True)
class Planted:
    """How often a hidden effect was found. Counts of `draws`.

    `size` is that of the effect's first parameter in `unit`, `size_in_sd` the rms of what it adds, in noise sd, in the
    channel where that is largest, and `beyond_in_sd` what is left of that when the model's own parameters follow; each
    is the median over the draws.
    """

    case: str
    effect: str
    size: float
    unit: str
    size_in_sd: float
    beyond_in_sd: float
    draws: int
    noticed: int  # an alarm
    named: int  # the effect alone
    tied: int  # among rivals that these data cannot tell apart
    others: tuple[tuple[str, int], ...]  # what else was said, most frequent first
    fails: bool  # the model fails its own test on the table as it is


def plant(
    case: Case,
    name: str,
    size: str,
    draws: int = 20,
    seed: int = 0,
    level: float = LEVEL,
    report: Callable[[str], None] = lambda _: None,
) -> Planted:
    """Hide an effect in a case's table `draws` times and ask discover each time.

    Parameters
    ----------
    name : an effect that could be added to the case's model.
    size : "0.3" or "0.3 N m" of its first parameter, "2sd" in noise sd (rms, in the channel where that is largest).
    seed : of signs and shapes; the same seed gives the same counts.
    level : false alarm rate of "something is missing".

    Raises
    ------
    UserError : the effect could not be added, changes nothing here, or cannot have that size.
    """
    model = Model.of(case)
    effect = _effect(model, name)
    value, in_sd = size_of(size, effect)
    report("fit of the present model, noise")
    analysis = analyse(case, seed, level)
    shapes = shapes_of(analysis.model, analysis.fit.theta, effect, analysis.rows, analysis.noise.sigma)
    if not shapes:
        why = f"{name} changes nothing in {case.folder}, expected an effect that these runs can show"
        raise UserError(f"--plant: {why}")
    shapes = [shape for shape in shapes if shape.scale <= WIDEST * min(one.scale for one in shapes)]
    slopes = free_slopes(analysis.fit, analysis.noise.sigma, analysis.rows)[2] / analysis.noise.sigma[:, None, None]
    basis = orthonormal(slopes.reshape(analysis.residual.size, -1))
    random = np.random.default_rng([seed, 0x91A7])
    said: Counter[str] = Counter()
    sizes, loud, beyond, noticed = [], [], [], 0
    for number in range(draws):
        report(f"table {number + 1} of {draws}")
        shape = shapes[int(random.integers(len(shapes)))]
        sizes.append(_in_bounds(effect, value * (shape.scale if in_sd else 1.0), value))
        loud.append(abs(sizes[-1]) / shape.scale)
        free = shape.columns - basis @ (basis.T @ shape.columns)
        beyond.append(loud[-1] * loudness(free.reshape(*analysis.residual.shape, -1)))
        table = _table(case, analysis, effect, shape, sizes[-1], random)
        found = discover(table, seed=seed + number, level=level)
        noticed += found.analysis.missing
        said[_said(found, name)] += 1
    return Planted(
        case=case.title,
        effect=name,
        size=float(np.median(sizes)),
        unit=effect.parameters[0].unit or "1",
        size_in_sd=float(np.median(loud)),
        beyond_in_sd=float(np.median(beyond)),
        draws=draws,
        noticed=noticed,
        named=said.pop(name, 0),
        tied=said.pop(f"tied {name}", 0),
        others=tuple(said.most_common()),
        fails=analysis.missing,
    )


def _said(found: Discovery, name: str) -> str:
    """What an answer says of an effect that was hidden: its name alone, that it is tied, or what else."""
    if found.verdict == "missing" and set(found.missing) == {name}:
        return name
    return f"tied {name}" if {name} in [set(one) for one in found.rivals] else _words(found.verdict, found.missing)


def size_of(text: str, effect: Effect) -> tuple[float, bool]:
    """A size as it is given, and whether it is in noise sd; else in the unit of the effect's first parameter."""
    number, _, unit = text.strip().partition(" ")
    in_sd = not unit and number.endswith(IN_SD)
    own = effect.parameters[0].unit or "1"
    expected = f"a number in {own}, with a unit of that kind, or in noise sd as 2sd"
    try:
        value = float(number.removesuffix(IN_SD) if in_sd else number)
        if unit:
            if not same_kind(unit, own):
                raise ValueError(unit)
            value = float(np.sign(value)) * convert_difference(abs(value), unit, own)
    except ValueError:
        raise UserError(f"--plant: found size {text!r}, expected {expected}") from None
    if not np.isfinite(value):
        raise UserError(f"--plant: found size {text!r}, expected {expected}")
    return value, in_sd


def _effect(model: Model, name: str) -> Effect:
    known = {effect.name: effect for effect in candidates(model)}
    if name in known:
        return known[name]
    if name in model.case.effects:
        raise UserError(f"--plant: {name} is in the model already, expected one of {', '.join(known)}")
    raise UserError(f"--plant: found {name}, expected an effect that could be added: one of {', '.join(known)}")


def _in_bounds(effect: Effect, size: float, value: float) -> float:
    """A size in sd takes the sign that the effect can have; one that lies outside of its bounds is refused."""
    first = effect.parameters[0]
    if first.maximum <= 0.0 < value and size > first.maximum:
        size = -size
    if not first.minimum <= size <= first.maximum:
        low, high = (f"{bound:g}" for bound in (first.minimum, first.maximum))
        raise UserError(
            f"--plant: found {effect.name}.{first.name} = {size:.4g}, expected {low} to {high} {first.unit}"
        )
    return size


def _table(
    case: Case, analysis: Analysis, effect: Effect, shape: Shape, size: float, random: np.random.Generator
) -> Case:
    """The case with a table that holds the effect."""
    rows, theta = case.train | case.test, analysis.fit.theta
    values = list(shape.values)
    for place, parameter in enumerate(effect.parameters[1:]):
        if is_phase(parameter):
            values[place] = float(random.uniform(-np.pi, np.pi))
    larger = Model.of(case).having(effect).bind(case.inputs, rows)
    with_it = larger.predict(np.concatenate([theta, [size], values]))
    model = Model.of(case)
    predicted = model.bind(case.inputs, rows).predict(theta)
    # a fit takes a share of the noise away
    share = np.sqrt(predicted.shape[1] / max(predicted.shape[1] - len(theta) / len(predicted), 1.0))
    signs = random.choice([-1.0, 1.0], len(case.run_names))[case.run[rows]]
    hidden = with_it + share * signs * (measured(model, rows) - predicted)
    channels = {name: np.array(values_) for name, values_ in case.channels.items()}
    for channel, own in zip(model.channels, hidden, strict=True):
        channels[channel][rows] = own
    return replace(case, channels=channels)


def _words(verdict: str, missing: tuple[str, ...]) -> str:
    if verdict in ("adequate", "unexplained"):
        return verdict
    own = ["a formula" if name.startswith("expression_") else name for name in missing]
    return " + ".join(sorted(own)) + (" and more" if verdict == "partial" else "")
