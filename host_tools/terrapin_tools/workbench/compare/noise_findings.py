"""What the noise is like, in findings: these are told beside the answer, and are no missing effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.noise.estimate import Noise
from terrapin_tools.workbench.noise.kinds import NODES
from terrapin_tools.workbench.noise.stated import FAR

__all__ = ["NoiseFinding", "far_above_stated", "noise_findings"]

LIKELY = 0.8  # from which offsets and drifts are said to be there; chosen by hand


@dataclass(frozen=True)
class NoiseFinding:
    """`value`: of larger and smaller, the factor on the stated sd; of run_offsets, drift and walk, their sd in the
    channel's unit; of run_gains, the sd of a factor from run to run; of rows and stuck, how many.
    `rows` are places ("runs.csv:17"); `runs` have them, or make up more than half of what is larger."""

    kind: str  # larger, smaller, run_offsets, run_gains, drift (within runs), walk (over the test), rows or stuck
    channel: str  # "" for rows, which are left out in every channel
    value: float
    probability: float
    rows: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()


def far_above_stated(analysis: Analysis) -> tuple[str, ...]:
    """Channels of which even the smoothest model leaves more than FAR times the stated noise sd."""
    each = zip(analysis.model.channels, analysis.noise.known, analysis.noise.ratio, strict=True)
    return tuple(channel for channel, known, ratio in each if known and ratio > FAR)


def noise_findings(analysis: Analysis, noise: Noise | None = None) -> list[NoiseFinding]:
    """What differs from independent noise of the stated sd, judged on what the smoothest model leaves.

    `noise` is that around an answer that was named. Without it, where something is missing, only the rows are told: its
    misfit would be taken for offsets, or for a larger sd.
    """
    case, judged = analysis.case, noise is not None or not analysis.missing
    noise = noise or analysis.told
    found: list[NoiseFinding] = []
    for place, (channel, predicted) in enumerate(
        zip(analysis.model.channels, analysis.prediction, strict=True) if judged else ()
    ):
        nodes = [node.of(place) for node in NODES[: len(noise.weights)]]
        if noise.wrong.any() and noise.wrong[place]:
            ratio = float(noise.ratio[place])
            one = tuple(case.run_names[i] for i in noise.carried[place : place + 1] if i >= 0 and ratio > 1.0)
            kind = "larger" if ratio > 1.0 else "smaller"
            found.append(NoiseFinding(kind, channel, ratio, float(noise.wrong[place]), runs=one))
        for kind, size in (
            ("run_offsets", "offset"),
            ("run_gains", "gain"),
            ("drift", "drift"),
            ("walk", "walk"),
        ):
            sizes = np.array([getattr(node, size) for node in nodes])
            probability = float(noise.weights[sizes > 0.0].sum())
            if probability > LIKELY:
                row = noise.sigma[place] / (1.0 if noise.known[place] else noise.node.of(place).floor)
                value = float(noise.weights @ sizes / probability * row)
                if kind == "run_gains":
                    value /= float(np.sqrt(np.mean(predicted * predicted)))
                found.append(NoiseFinding(kind, channel, value, probability))
    for kind, mask in (("rows", analysis.odd), ("stuck", analysis.stuck)):
        if mask.any():
            rows = np.flatnonzero(mask)
            runs = tuple(dict.fromkeys(case.run_names[case.run[row]] for row in rows))
            found.append(NoiseFinding(kind, "", float(len(rows)), 1.0, tuple(case.place(int(r)) for r in rows), runs))
    return found
