"""What the noise is like, in findings: these are told beside the answer, and are no missing effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc

from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.noise.covariance import NODES
from terrapin_tools.workbench.noise.marginal_likelihood import STATED

__all__ = ["NoiseFinding", "far_above_stated", "noise_findings"]

SURE = 0.9  # probability from which a stated sd is said to be off; chosen by hand
LIKELY = 0.8  # from which offsets and drifts are said to be there; chosen by hand
FAR = 3.0  # factor on the stated sd that no user is wrong by; chosen by hand
OFF = 1.1  # factor on the stated sd from which it is worth a word: a user knows it to 15 or 20 %


@dataclass(frozen=True)
class NoiseFinding:
    """`value`: of larger and smaller, the factor on the stated sd; of run_offsets, drift and walk, their sd in the
    channel's unit; of run_gains, the sd of a factor from run to run; of rows and stuck, how many.
    `rows` are places ("runs.csv:17")."""

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


def noise_findings(analysis: Analysis) -> list[NoiseFinding]:
    """What differs from independent noise of the stated sd, judged on what the smoothest model leaves.

    Where something is missing only the rows are told: its misfit would be taken for offsets, or for a larger sd.
    """
    noise, case = analysis.noise, analysis.case
    found: list[NoiseFinding] = []
    each = zip(analysis.model.channels, noise.known, noise.sigma, noise.ratio, analysis.prediction, strict=True)
    for place, (channel, known, sigma, ratio, predicted) in enumerate(each) if not analysis.missing else ():
        nodes = [node.of(place) for node in NODES[: len(noise.weights)]]
        if known:
            freedom = STATED + noise.ratio_freedom
            square = STATED + noise.ratio_freedom * ratio * ratio  # over chi-square(freedom): the true over the stated
            for kind, probability in (
                ("larger", float(chdtr(freedom, square / OFF**2))),
                ("smaller", float(chdtrc(freedom, square * OFF**2))),
            ):
                if probability > SURE:
                    found.append(NoiseFinding(kind, channel, float(np.sqrt(square / freedom)), probability))
        for kind, size in (
            ("run_offsets", "offset"),
            ("run_gains", "gain"),
            ("drift", "drift"),
            ("walk", "walk"),
        ):
            sizes = np.array([getattr(node, size) for node in nodes])
            probability = float(noise.weights[sizes > 0.0].sum())
            if probability > LIKELY:
                row = sigma if known else sigma / noise.node.of(place).floor
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
