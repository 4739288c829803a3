"""The shape of an effect: its formula over the quantity that it depends on, as numbers, as text and as a picture."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.bases import ROLES, formula_name
from terrapin_tools.workbench.files.writing import write_whole
from terrapin_tools.workbench.formulas.free_curves import Curve

__all__ = ["Shape", "as_svg", "as_text", "draw", "shape_of", "unnamed"]

Array = npt.NDArray[np.float64]

# Ranges of a laboratory robot, over which an effect is shown, and what it is shown at.
RANGES: Mapping[str, tuple[float, float]] = {
    "time": (0.0, 10.0),
    "omega": (-10.0, 10.0),
    "acceleration": (-5.0, 5.0),
    "angle": (0.0, 6.283185307179586),
    "slip": (0.0, 0.9),
    "speed": (-1.0, 1.0),
    "load": (5.0, 50.0),
    "slope": (-0.35, 0.35),
    "temperature": (20.0, 90.0),
    "pass_": (1.0, 10.0),
    "moisture": (0.0, 0.2),
    "voltage": (0.0, 12.0),
}
POSITIVE = (0.02, 0.5)  # of a speed that has to be above 0
USUAL: Mapping[str, float] = {"radius": 0.08, "load": 20.0, "clip": 1.0, "gear": 16.0}
WIDTH, HEIGHT = 61, 11  # of the text
PICTURE, BORDER = (360, 180), 34  # of the curve that has no formula


@dataclass(frozen=True)
class Shape:
    """The formula's value `y` over `x`; what else was held."""

    variable: str
    unit: str  # of x
    x: Array
    y: Array
    held: Mapping[str, float]

    @property
    def axis(self) -> str:
        """The variable with its unit."""
        return f"{self.variable} [{self.unit}]" if self.unit not in ("", "1") else self.variable


def shape_of(effect: Effect) -> Shape:
    """The formula over the first role in it (or what else it depends on); its size is 1, or the bound below that."""
    expression = parse(effect.expression)
    held = {p.name: _typical(p, i == 0) for i, p in enumerate(effect.parameters)}
    free = [name for name in sorted(expression.names) if name not in held]
    order = [name for name in RANGES if name in free and name != "load"]
    others = [name for name in free if name not in RANGES and name not in USUAL and name not in effect.constants]
    needed = [formula_name(role) for group in effect.needs for role in group]
    choice = [n for n in needed if n in free] or order or others or [n for n in free if n == "load"]
    variable = choice[0] if choice else (needed[0] if needed else "omega")
    low, high = RANGES.get(variable, (0.0, 10.0))
    if variable in effect.positive and low <= 0.0:
        low, high = POSITIVE
    for name in free:
        if name != variable:
            held[name] = USUAL.get(name, sum(RANGES.get(name, (1.0, 1.0))) / 2.0)
    x = np.linspace(low, high, 601)
    y = np.broadcast_to(expression.evaluate({**held, variable: x}), x.shape)
    unit = next((unit for role, unit in ROLES.items() if formula_name(role) == variable), "")
    return Shape(variable, unit, x, y, held)


def _typical(parameter: Parameter, size: bool) -> float:
    if size:
        return float(min(1.0, parameter.maximum))
    usual = parameter.start
    if usual == 0.0 and 0.0 not in parameter.grid:
        usual = next((v for v in parameter.grid if v > 0.0), 0.0)
    return float(np.clip(usual, parameter.minimum, parameter.maximum))


def as_text(shape: Shape) -> list[str]:
    """A plot in plain characters: the highest and the lowest value at its left, the range below."""
    at = np.linspace(0, len(shape.x) - 1, WIDTH).astype(int)
    y = np.where(np.isfinite(shape.y[at]), shape.y[at], np.nan)
    if np.isnan(y).all():
        return ["(no number anywhere)"]
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    span = high - low if high > low else 1.0
    rows = [[" "] * WIDTH for _ in range(HEIGHT)]
    zero = round((HEIGHT - 1) * (high - 0.0) / span)
    if high > low and 0 <= zero < HEIGHT:
        rows[zero] = ["."] * WIDTH
    for column, value in enumerate(y):
        if not np.isnan(value):
            row = round((HEIGHT - 1) * (high - float(value)) / span) if high > low else HEIGHT // 2
            rows[row][column] = "*"
    labels = [""] * HEIGHT
    labels[0], labels[-1] = (f"{high:.3g}", f"{low:.3g}") if high > low else ("", "")
    if high == low:
        labels[HEIGHT // 2] = f"{high:.3g}"
    lines = [f"{label:>9} |{''.join(row)}".rstrip() for label, row in zip(labels, rows, strict=True)]
    left, right = f"{shape.x[0]:.3g}", f"{shape.x[-1]:.3g}"
    gap = WIDTH - len(left) - len(right)
    return [*lines, " " * 9 + " +" + "-" * WIDTH, " " * 11 + left + shape.axis.center(gap) + right]


def unnamed(curve: Curve) -> Shape:
    """A curve that has no formula, for `as_text`."""
    return Shape(curve.column, curve.unit, np.array(curve.x), np.array(curve.y), {})


def as_svg(curve: Curve) -> str:
    """The same with its band of two sd, to stand in a page."""
    x, y, sd = (np.array(values) for values in (curve.x, curve.y, curve.sd))
    low, high = float((y - 2.0 * sd).min()), float((y + 2.0 * sd).max())
    (width, height), span = PICTURE, high - low or 1.0

    def path(across: Array, up: Array) -> str:
        left = BORDER + (across - x[0]) / (x[-1] - x[0]) * (width - 2 * BORDER)
        top = BORDER / 2 + (high - up) / span * (height - 1.5 * BORDER)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(left, top, strict=True))

    axis = escape(unnamed(curve).axis)
    at = height - 14.0
    words = [(float(BORDER), at, "middle", f"{x[0]:.3g}"), (width - BORDER, at, "middle", f"{x[-1]:.3g}")]
    words += [
        (width / 2, height - 4, "middle", axis),
        (2, 14, "start", f"{high:.2g}"),
        (2, at - 16, "start", f"{low:.2g}"),
    ]
    text = "".join(f'<text x="{a}" y="{b}" text-anchor="{side}">{word}</text>' for a, b, side, word in words)
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="curve over {axis}" fill="currentColor" '
        f'font-size="11">'
        f'<polygon points="{path(np.concatenate([x, x[::-1]]), np.concatenate([y - 2 * sd, (y + 2 * sd)[::-1]]))}" '
        f'opacity="0.2"/><polyline points="{path(x, y)}" fill="none" stroke="currentColor" stroke-width="2"/>{text}'
        "</svg>"
    )


def draw(effect: Effect, shape: Shape, target: Path) -> None:
    """The picture as PNG or SVG, the same bytes every time."""
    kind = target.suffix.lower().removeprefix(".")
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.mathtext import MathTextParser

    formula = f"${effect.equation}$"
    try:
        MathTextParser("agg").parse(formula)
    except ValueError:  # matplotlib knows a part of LaTeX only
        formula = effect.expression
    with rc_context({"svg.hashsalt": "terrapin", "svg.fonttype": "none", "text.parse_math": True}):
        figure = Figure(figsize=(6.0, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.axhline(0.0, color="0.8", linewidth=0.8)
        axes.plot(shape.x, shape.y, color="#0b5")
        axes.set_title(f"{effect.title}\n{formula}", fontsize=11)
        axes.set_xlabel(shape.axis)
        axes.set_ylabel(held_text(shape), fontsize=8)
        axes.margins(x=0.0)
        picture = io.BytesIO()
        figure.savefig(picture, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)
    write_whole(target, picture.getvalue())


def held_text(shape: Shape) -> str:
    """What the shape is shown at: `m_c = 1, k = 2`."""
    return ", ".join(f"{name} = {value:.3g}" for name, value in shape.held.items())
