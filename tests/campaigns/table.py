"""From records to the table of bounds: one line a bound, with limits, and under it who carries the figure.

A rate is met when the figure itself meets its bound, except where the bound is one of the upper limit (`wrong`). The
limits say how much of that is luck. Cases that failed count as wrong; figures over fewer than 20 cases are `few`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tests.campaigns.statistics import quantile_limits, rate_limits
from tests.campaigns.truth import SAME

__all__ = ["ROWS", "Line", "show"]

Record = dict[str, Any]
BINS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
FEW = 20
Z90 = 1.645


@dataclass(frozen=True)
class Line:
    """One bound. `count` is 0 where it is not a number of cases."""

    row: str
    figure: str
    limits: str
    count: int
    bound: str
    met: bool
    detail: tuple[str, ...] = ()
    enough: bool = True  # cases to say so at all

    @property
    def verdict(self) -> str:
        return "NOT MET" if not self.met else "few" if 0 < self.count < FEW or not self.enough else "met"


def _rate(
    row: str,
    hits: Sequence[bool],
    at_most: float | None = None,
    at_least: float | None = None,
    detail: Iterable[str] = (),
) -> Line:
    count, hit = len(hits), sum(hits)
    low, high = rate_limits(hit, count)
    share = hit / count if count else float("nan")
    met = count > 0 and (at_most is None or share <= at_most) and (at_least is None or share >= at_least)
    bound = (
        f"<= {100 * at_most:g} %" if at_most is not None else f">= {100 * at_least:g} %" if at_least is not None else ""
    )
    limits = f"{100 * low:.1f} to {100 * high:.1f} %"
    return Line(row, f"{100 * share:.1f} %", limits, count, bound, met, tuple(detail))


def _by(
    records: Sequence[Record], key: Callable[[Record], Any], figures: Mapping[str, Callable[[Record], Any]]
) -> list[str]:
    """One line for each value of `key`: the mean of each figure over the records that have it."""
    lines = []
    for value in sorted({key(r) for r in records}, key=str):
        mine = [r for r in records if key(r) == value]
        parts = []
        for name, of in figures.items():
            values = [of(r) for r in mine if of(r) is not None]
            parts.append(f"{name} {np.mean(values):.3f} ({len(values)})" if values else f"{name} -")
        lines.append(f"{value!s:28} " + "  ".join(parts))
    return lines


def _pool(records: Sequence[Record], *pools: str) -> list[Record]:
    return [r for r in records if r["pool"] in pools]


def _alarm(record: Record) -> bool:
    return record.get("p_value", 1.0) < 0.05


def false_alarms(records: Sequence[Record]) -> list[Line]:
    mine = _pool(records, "nothing")
    hits = [_alarm(r) or "failed" in r for r in mine]
    detail = [
        *_by(mine, lambda r: f"rho {r['rho']}", {"alarm": _alarm}),
        *_by(mine, lambda r: f"runs {8 + (r['runs'] - 8) // 8 * 8} and more", {"alarm": _alarm}),
        *_by(mine, lambda r: r["base"], {"alarm": _alarm}),
        *_by(mine, lambda r: f"sigma {'given' if r['known'] else 'estimated'}", {"alarm": _alarm}),
        *_by(mine, lambda r: "long runs" if r["rows"] > 40 * r["runs"] - 1 else "short runs", {"alarm": _alarm}),
    ]
    return [_rate("false alarms at level 0.05", hits, at_most=0.06, detail=detail)]


def _confident(record: Record) -> bool:
    return record.get("verdict") == "missing" and record["probability"] > 0.9


def wrong(records: Sequence[Record]) -> list[Line]:
    mine = [r for r in _pool(records, "mixed") if r["size"] <= 2.0]
    bad = [r for r in mine if _confident(r) and not r["right"]]
    low, high = rate_limits(len(bad), len(mine))
    share = len(bad) / len(mine) if mine else float("nan")
    unlike = sum(not r["alike"] for r in bad)
    detail = [
        f"confident {sum(map(_confident, mine))}; wrong {len(bad)}; of those not even alike on these data {unlike}",
        *_by(mine, lambda r: r["kind"], {"wrong": lambda r: _confident(r) and not r["right"], "confident": _confident}),
        *_by(mine, lambda r: f"rho {r['rho']}", {"wrong": lambda r: _confident(r) and not r["right"]}),
        *(f"{r['number']}: {r['truth']} answered {r['missing']} at {r['probability']:.3f}" for r in bad[:20]),
    ]
    limits = f"{100 * low:.1f} to {100 * high:.1f} %"
    bound = "upper limit <= 1.5 %"
    return [Line("wrong and confident", f"{100 * share:.2f} %", limits, len(mine), bound, high <= 0.015, tuple(detail))]


def single(records: Sequence[Record]) -> list[Line]:
    lines = []
    for pool, name_bound, alarm_bound in (("single12", 0.85, 0.80), ("single30", 0.95, 0.92)):
        everyone = _pool(records, pool)
        mine = [r for r in everyone if "failed" in r or r["d2_nothing"] >= SAME]
        aside = len(everyone) - len(mine)
        figures: dict[str, Callable[[Record], Any]] = {
            "first": lambda r: r.get("first_alike", False),
            "strictly": lambda r: r.get("first_right", False),
            "alarm": _alarm,
            "oracle alarm": lambda r: r.get("power"),
            "verdict missing and right": lambda r: r.get("verdict") == "missing" and r["alike"],
        }
        detail = [
            f"{aside} of {len(everyone)} set aside: the model's own parameters take the effect up (D2 < {SAME:g})",
            *_by(everyone, lambda r: "all, none set aside", figures),
            *_by(mine, lambda r: "those that count", figures),
            *_by(mine, lambda r: r["base"], figures),
            *_by(mine, lambda r: f"rho {r['rho']}", figures),
            *_by(mine, lambda r: f"sigma {'given' if r['known'] else 'estimated'}", figures),
            *_by(mine, lambda r: r["truth"][0], figures),
        ]
        runs = pool[-2:]
        first = [bool(r.get("first_alike", False)) for r in mine]
        lines.append(_rate(f"one effect at 1 sd, {runs} runs: first", first, at_least=name_bound, detail=detail))
        lines.append(_rate(f"one effect at 1 sd, {runs} runs: alarm", [_alarm(r) for r in mine], at_least=alarm_bound))
    return lines


def pairs(records: Sequence[Record]) -> list[Line]:
    everyone = _pool(records, "pair30")
    mine = [r for r in everyone if "failed" in r or r["d2_single"] >= SAME]
    figures: dict[str, Callable[[Record], Any]] = {
        "both": lambda r: r.get("alike", False),
        "strictly": lambda r: r.get("right", False),
        "one of them": lambda r: bool(set(r.get("missing", ())) & set(r["truth"])),
        "alarm": _alarm,
        "verdict ambiguous": lambda r: r.get("verdict") == "ambiguous",
    }
    detail = [
        f"{len(everyone) - len(mine)} of {len(everyone)} set aside: one effect alone gives the same (D2 < {SAME:g})",
        *_by(everyone, lambda r: "all, none set aside", figures),
        *_by(mine, lambda r: r["base"], figures),
        *_by(mine, lambda r: f"rho {r['rho']}", figures),
        *_by(mine, lambda r: _strength(r.get("d2_single")), figures),
    ]
    return [
        _rate("two effects at 1 sd, 30 runs: both", [figures["both"](r) for r in mine], at_least=0.8, detail=detail)
    ]


def _strength(squared: float | None) -> str:
    if squared is None:
        return "failed"
    edge = next((e for e in (9, 16, 25, 50) if squared < e), None)
    return f"second effect D2 < {edge}" if edge else "second effect D2 >= 50"


def tied(records: Sequence[Record]) -> list[Line]:
    everyone = _pool(records, "tied")
    mine = [r for r in everyone if "failed" in r or r["d2_nothing"] >= SAME]
    said = [r for r in mine if r.get("said")]
    figures: dict[str, Callable[[Record], Any]] = {
        "said": lambda r: bool(r.get("said")),
        "alarm": _alarm,
        "proposed": lambda r: r.get("proposed") if r.get("said") else None,
        "settled": lambda r: bool(r.get("settled")) if r.get("said") else None,
        "rivals": lambda r: len(r["rivals"]) if r.get("said") else None,
        "new runs": lambda r: r.get("new_runs"),
    }
    detail = [
        f"{len(everyone) - len(mine)} of {len(everyone)} set aside: the model's own parameters take the effect up",
        *_by(mine, lambda r: " or ".join(r["truth"]) + " " + r["base"], figures),
        *_by(mine, lambda r: f"rho {r['rho']}", figures),
        *_by(mine, lambda r: f"size {r['size']}", figures),
    ]
    return [
        _rate("cannot tell: said so, right pair", [bool(r.get("said")) for r in mine], at_least=0.9, detail=detail),
        _rate("after the next experiment: one left", [bool(r.get("settled")) for r in said], at_least=0.8),
    ]


def removed(records: Sequence[Record]) -> list[Line]:
    everyone = _pool(records, "removed")
    had = [r for r in everyone if r.get("p_with", r.get("p_value", 1.0)) < 0.05 and r.get("d2_nothing", SAME) >= SAME]
    alarmed = [r for r in everyone if _alarm(r) and r.get("d2_nothing", SAME) >= SAME]
    close: Callable[[Record], bool] = lambda r: r.get("ratio", np.inf) <= 1.10  # noqa: E731
    figures: dict[str, Callable[[Record], Any]] = {
        "alarm": _alarm,
        "variable": lambda r: bool(r.get("right_where")) if _alarm(r) else None,
        "within 1.10": lambda r: close(r) if _alarm(r) else None,
        "unexplained": lambda r: r.get("verdict") == "unexplained" if _alarm(r) else None,
    }
    detail = [
        *_by(everyone, lambda r: r["base"], figures),
        *_by(everyone, lambda r: f"size {r['size']}", figures),
        *_by(everyone, lambda r: f"rho {r['rho']}", figures),
        *_by(everyone, lambda r: r["truth"][0], figures),
    ]
    return [
        _rate("effect not in the catalogue: alarm kept", [_alarm(r) for r in had], at_least=0.9, detail=detail),
        _rate("... right variable first", [bool(r.get("right_where")) for r in alarmed], at_least=0.9),
        _rate("... error within 1.10 of the oracle's", [close(r) for r in alarmed], at_least=0.7),
    ]


def heldout(records: Sequence[Record]) -> list[Line]:
    mine = [r for r in _pool(records, "single12", "single30", "pair30") if "ratio" in r]
    ratios = [r["ratio"] for r in mine]
    if not ratios:
        return [Line("held-out error / true model's", "-", "-", 0, "median <= 1.02, 95 % <= 1.05", False)]
    lines = []
    for name, share, bound in (("median", 0.5, 1.02), ("95th percentile", 0.95, 1.05)):
        value = float(np.quantile(ratios, share))
        low, high = quantile_limits(ratios, share)
        lines.append(
            Line(
                f"held-out error / true model's, {name}",
                f"{value:.3f}",
                f"{low:.3f} to {high:.3f}",
                len(ratios),
                f"<= {bound}",
                value <= bound,
            )
        )
    return lines


def probability(records: Sequence[Record]) -> list[Line]:
    """Strict: the answer is right when it is the truth, not something alike. `unexplained` names nothing: aside."""
    mine = [r for r in _pool(records, "mixed") if r.get("verdict") not in (None, "unexplained")]
    given = np.array([r["probability"] for r in mine])
    right = np.array([_answered_right(r) for r in mine], dtype=float)
    detail, worst, error = [], 0.0, 0.0
    for low, high in pairwise(BINS):
        inside = (given > low) & (given <= high) if low > 0 else (given <= high)
        count = int(inside.sum())
        if not count:
            continue
        gap = float(given[inside].mean() - right[inside].mean())
        error += count * abs(gap)
        if count >= 800:
            worst = max(worst, abs(gap))
        a, b = rate_limits(int(right[inside].sum()), count)
        detail.append(
            f"given {given[inside].mean():.3f}  observed {right[inside].mean():.3f} ({a:.2f} to {b:.2f})  cases {count}"
        )
    total = error / len(mine) if mine else float("nan")
    for verdict in ("adequate", "missing", "ambiguous"):
        chosen = np.array([r["verdict"] == verdict for r in mine], dtype=bool)
        if chosen.any():
            detail.append(
                f"{verdict}: given {given[chosen].mean():.3f}, observed {right[chosen].mean():.3f}, {chosen.sum()}"
            )
    odd = [r for r in _pool(records, "mixed") if r.get("verdict") == "unexplained"]
    if odd:
        share = np.mean([r["kind"] == "foreign" for r in odd])
        mean = np.mean([r["probability"] for r in odd])
        detail.append(f"unexplained: given {mean:.3f}, not in the catalogue {share:.3f}, {len(odd)}")
    big = f"{worst:.3f}" if worst else "no bin has 800"
    return [
        Line("probability: worst bin of 800 or more", big, "", len(mine), "<= 0.05", worst <= 0.05, (), worst > 0.0),
        Line("expected calibration error", f"{total:.3f}", "", len(mine), "<= 0.03", total <= 0.03, tuple(detail)),
    ]


def _answered_right(record: Record) -> bool:
    return record["kind"] == "nothing" if record["verdict"] == "adequate" else bool(record["right"])


def intervals(records: Sequence[Record]) -> list[Line]:
    mine = [r for r in _pool(records, "single12", "single30", "mixed") if r["size"] >= 1.0 and r.get("intervals")]
    each = [(name, abs(value - true) <= Z90 * sd, r) for r in mine for name, value, sd, true in r["intervals"]]
    inside = [hit for _, hit, _ in each]
    detail = []
    for name in sorted({n for n, _, _ in each}):
        hits = [h for n, h, _ in each if n == name]
        detail.append(f"{name:28} {np.mean(hits):.3f} ({len(hits)})")
    for rho in sorted({r["rho"] for _, _, r in each}):
        hits = [h for _, h, r in each if r["rho"] == rho]
        detail.append(f"rho {rho:<24} {np.mean(hits):.3f} ({len(hits)})")
    line = _rate("90 % intervals of parameters cover", inside, at_least=0.88, detail=detail)
    share = float(np.mean(inside)) if inside else float("nan")
    return [Line(line.row, line.figure, line.limits, line.count, "88 to 92 %", 0.88 <= share <= 0.92, line.detail)]


ROWS: Mapping[str, tuple[tuple[str, ...], Callable[[Sequence[Record]], list[Line]]]] = {
    "alarms": (("nothing",), false_alarms),
    "wrong": (("mixed",), wrong),
    "single": (("single12", "single30"), single),
    "pairs": (("pair30",), pairs),
    "tied": (("tied",), tied),
    "removed": (("removed",), removed),
    "heldout": (("single12", "single30", "pair30"), heldout),
    "probability": (("mixed",), probability),
    "intervals": (("single12", "single30", "mixed"), intervals),
}


def show(lines: Sequence[Line], details: bool = True) -> str:
    """The table, and under it the details of each bound that has some."""
    head = ("row", "figure", "95 % limits", "cases", "bound", "")
    cells = [head, *((e.row, e.figure, e.limits, str(e.count or ""), e.bound, e.verdict) for e in lines)]
    widths = [max(len(row[i]) for row in cells) for i in range(6)]
    text = ["  ".join(value.ljust(width) for value, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    if details:
        for line in lines:
            if line.detail:
                text += ["", line.row, *(f"  {entry}" for entry in line.detail)]
    return "\n".join(text)
