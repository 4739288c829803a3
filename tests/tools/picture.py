"""Draws docs/result.svg from a run of the scenario floor_to_sand: C_t as the firmware states it, and the truth.

    python tests/tools/picture.py

Run by hand when the controller's behaviour has changed visibly; the picture is the README's.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from steps import ROOT

from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario

WIDTH, HEIGHT = 760, 330
LEFT, RIGHT, TOP, BOTTOM = 60, 20, 40, 48
TORQUE = 240.0  # mN m at the top
Array = npt.NDArray[np.float64]


def x(time: Array | float, end: float) -> Array:
    return np.asarray(LEFT + (WIDTH - LEFT - RIGHT) * np.asarray(time) / end)


def y(torque: Array | float) -> Array:
    return np.asarray(
        HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * np.clip(np.asarray(torque) * 1e3 / TORQUE, -0.02, 1.0)
    )


def points(xs: Array, ys: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(xs, ys, strict=True))


def axes(end: float) -> list[str]:
    parts = []
    for torque in range(0, int(TORQUE) + 1, 40):
        level = float(y(torque / 1e3))
        parts.append(f'<line class="g" x1="{LEFT}" y1="{level:.1f}" x2="{WIDTH - RIGHT}" y2="{level:.1f}"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{level + 4:.1f}" text-anchor="end">{torque}</text>')
    for second in range(0, int(end) + 1, 4):
        place = float(x(float(second), end))
        parts.append(f'<text x="{place:.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{second}</text>')
    parts.append(f'<text x="{(WIDTH + LEFT) / 2:.0f}" y="{HEIGHT - 10}" text-anchor="middle">time, s</text>')
    parts.append(f'<text x="{LEFT - 46}" y="{TOP - 18}">contact torque C_t, mN m</text>')
    return parts


def draw(result: Result) -> str:
    end = float(result.time[-1])
    every = slice(0, None, 50)
    truth = points(x(result.time[every], end), y(result.truth["contact_torque"][every]))
    ground = result.telemetry["GROUND"]
    use = ground["valid"] > 0
    time, torque, sd = (ground[name][use][::4] for name in ("time", "torque", "torque_sd"))
    places, low, high = x(time, end), y(torque - 2 * sd), y(torque + 2 * sd)
    bars = "".join(f"M{a:.1f},{b:.1f}V{c:.1f}" for a, b, c in zip(places, low, high, strict=True))
    dots = "".join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2"/>' for a, b in zip(places, y(torque), strict=True))
    sand = float(x(float(result.time[np.argmax(result.truth["segment"] == 1)]), end))
    calibration = result.telemetry["CALIBRATION"]
    done = float(x(float(calibration["time"][np.argmax(calibration["calibrated"] > 0)]), end))
    body = [
        f'<rect class="sand" x="{sand:.1f}" y="{TOP}" width="{WIDTH - RIGHT - sand:.1f}" '
        f'height="{HEIGHT - TOP - BOTTOM}"/>',
        *axes(end),
        f'<polyline class="truth" points="{truth}"/>',
        f'<path class="sd" d="{bars}"/>',
        f'<g class="value">{dots}</g>',
        f'<line class="mark" x1="{done:.1f}" y1="{TOP}" x2="{done:.1f}" y2="{HEIGHT - BOTTOM}"/>',
        f'<text x="{done - 6:.1f}" y="{TOP + 14}" text-anchor="end">hard floor: calibrates C_o</text>',
        f'<text x="{sand + 8:.1f}" y="{TOP + 14}">dry sand</text>',
        f'<g transform="translate({LEFT + 250},{TOP - 22})"><line class="truth" x1="0" y1="0" x2="24" y2="0"/>'
        '<text x="30" y="4">truth (simulated)</text><circle class="value" cx="170" cy="0" r="3"/>'
        '<text x="180" y="4">stated by the firmware, with 2 sd</text></g>',
    ]
    style = (
        "text { fill: #222; } .g { stroke: #ddd; } .sand { fill: #f7eccf; } .truth { fill: none; stroke: #888; } "
        ".sd { stroke: #c0392b; } .value { fill: #c0392b; } .mark { stroke: #555; stroke-dasharray: 4 3; }"
    )
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
            'font-family="sans-serif" font-size="12">',
            "<title>Contact torque on a hard floor and on dry sand: truth, and what the firmware states</title>",
            f"<style>{style}</style>",
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
            *body,
            "</svg>\n",
        ]
    )


if __name__ == "__main__":
    (ROOT / "docs" / "result.svg").write_text(draw(run(load_scenario(find_scenario("floor_to_sand")))))
