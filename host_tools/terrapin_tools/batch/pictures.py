"""Small pictures as SVG, in the colours of the report's style: bars with limits, points, a histogram."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from terrapin_hil.arrays import Array, Mask

__all__ = ["histogram", "points", "shares"]

LEFT, BOTTOM, TOP, RIGHT = 54, 34, 8, 10  # px around a picture
BINS = 24
MOST_POINTS = 4000  # drawn; of more, each n-th


def _svg(width: int, height: int, title: str, inside: Sequence[str]) -> str:
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}" '
        f'style="width:100%;max-width:{width}px">{"".join(inside)}</svg>'
    )


def _text(x: float, y: float, words: str, anchor: str = "middle") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="11" fill="var(--soft)">{escape(words)}</text>'
    )


def _line(x1: float, y1: float, x2: float, y2: float, colour: str = "--line") -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="var({colour})"/>'


def shares(
    names: Sequence[str], shares: Sequence[float], limits: Sequence[tuple[float, float]], title: str, axis: str
) -> str:
    """Bars from 0 to 100 % with their limits, a name under each."""
    width, height = 430, 190
    room = (width - LEFT - RIGHT) / max(1, len(names))
    tall = height - BOTTOM - TOP
    inside = []
    for mark in (0.0, 0.5, 1.0):
        y = TOP + tall * (1.0 - mark)
        inside += [_line(LEFT, y, width - RIGHT, y), _text(LEFT - 5, y + 4, f"{100 * mark:.0f} %", "end")]
    each = -(-len(names) // 5)
    for i, (name, share, (low, high)) in enumerate(zip(names, shares, limits, strict=True)):
        x, middle = LEFT + i * room, LEFT + (i + 0.5) * room
        bar = tall * share
        inside += [
            f'<rect x="{x + 0.1 * room:.1f}" y="{TOP + tall - bar:.1f}" width="{0.8 * room:.1f}" '
            f'height="{bar:.1f}" fill="var(--red)" opacity="0.75"/>',
            _line(middle, TOP + tall * (1 - low), middle, TOP + tall * (1 - high), "--ink"),
        ]
        if i % each == 0:
            inside.append(_text(middle, height - 20, name.split(" to ")[0]))
    inside.append(_text(LEFT + 0.5 * (width - LEFT - RIGHT), height - 4, axis))
    return _svg(width, height, title, inside)


def points(x: Array, y: Array, passed: Mask, labels: tuple[str, str], title: str) -> str:
    """A point for each run (runs,): those that failed stand out."""
    width, height = 430, 300
    tall, wide = height - BOTTOM - TOP, width - LEFT - RIGHT
    step = -(-len(x) // MOST_POINTS)
    ends = [(float(v.min()), float(v.max())) for v in (x, y)]
    spans = [high - low if high > low else 1.0 for low, high in ends]
    inside = [_line(LEFT, TOP + tall, width - RIGHT, TOP + tall), _line(LEFT, TOP, LEFT, TOP + tall)]
    for held, colour in ((True, "--teal"), (False, "--red")):
        chosen = np.flatnonzero(passed == held)[::step]
        across = LEFT + wide * (x[chosen] - ends[0][0]) / spans[0]
        down = TOP + tall * (1.0 - (y[chosen] - ends[1][0]) / spans[1])
        dots = (f"M{a:.1f} {b:.1f}h0" for a, b in zip(across, down, strict=True))
        inside.append(
            f'<path d="{"".join(dots)}" stroke="var({colour})" stroke-width="4" stroke-linecap="round" opacity="0.65"/>'
        )
    inside += [
        _text(LEFT, height - 20, f"{ends[0][0]:.4g}", "start"),
        _text(width - RIGHT, height - 20, f"{ends[0][1]:.4g}", "end"),
        _text(LEFT - 4, TOP + tall, f"{ends[1][0]:.3g}", "end"),
        _text(LEFT - 4, TOP + 10, f"{ends[1][1]:.3g}", "end"),
        _text(LEFT + 0.5 * wide, height - 4, labels[0]),
        f'<text transform="translate(12 {TOP + 0.5 * tall:.0f}) rotate(-90)" text-anchor="middle" font-size="11" '
        f'fill="var(--soft)">{escape(labels[1])}</text>',
    ]
    return _svg(width, height, title, inside)


def histogram(values: Array, passed: Mask, title: str) -> str:
    """How the values lie (runs,), those of failed runs on top; what has no value is left out."""
    width, height = 180, 36
    there = np.isfinite(values)
    if not there.any() or values[there].min() == values[there].max():
        return ""
    edges = np.histogram_bin_edges(values[there], BINS)
    good, _ = np.histogram(values[there & passed], edges)
    bad, _ = np.histogram(values[there & ~passed], edges)
    scale, room = (height - 2) / float((good + bad).max()), width / BINS
    inside = []
    for i, (held, failed) in enumerate(zip(good.tolist(), bad.tolist(), strict=True)):
        lower, upper = held * scale, failed * scale
        for colour, bar, foot in (("--teal", lower, 0.0), ("--red", upper, lower)):
            if bar > 0.0:
                inside.append(
                    f'<rect x="{i * room:.1f}" y="{height - foot - bar:.1f}" width="{room - 0.5:.1f}" '
                    f'height="{bar:.1f}" fill="var({colour})"/>'
                )
    return _svg(width, height, title, inside)
