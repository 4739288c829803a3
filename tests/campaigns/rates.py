"""How often is discovery right? The tables of docs/rates.md, from the lines that are committed (results/counted).

    python -m tests.campaigns.rates              print them
    python -m tests.campaigns.rates --write      put them into docs/rates.md, between its two marks

The worst comes first. A figure that is short of its count, or of its bound, says so. The bounds are those that were set
before anything was counted. A test holds the page against the lines.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tests.campaigns import calibration, exhaustive, resumed
from tests.campaigns.resumed import ROOT, Record, committed, sure_and_wrong
from tests.campaigns.statistics import rate_limits
from tests.campaigns.sure import CAMPAIGNS, excused, judged
from tests.campaigns.ties import is_tie, rivals
from tests.campaigns.truth import SAME

__all__ = ["page", "tables"]

PAGE = ROOT / "docs" / "rates.md"
BEGIN, END = "<!-- counted (python -m tests.campaigns.rates --write) -->", "<!-- end of what is counted -->"
NOISES = {
    "white": "white",
    "ar1": "AR(1), 0.4 or 0.8",
    "offsets": "run offsets of 0.3 to 1 sd",
    "drift": "a random walk over the test, rms 0.5 sd",
    "outliers": "1 % of rows off by 6 to 15 sd",
    "tails": "Student's t with 3 degrees of freedom",
    "growing": "sd growing with speed",
    "quantised": "rounded to 3 sd, sd not stated",
    "hum": "a sine of random phase in each run",
    "stated": "sd stated at 0.5 to 2 times",
    "inputs": "the measured speed off by 1 or 3 % of its range",
    "rig": "all rig noises together",
    "unlike": "sd that differs from run to run (none of the twelve that must hold)",
    "channels": "two channels with unlike noise",
}


@dataclass(frozen=True)
class Row:
    """`share` orders the table. `met` judges the figures, `count` of `wanted` cases says whether that is early."""

    what: str
    command: str
    figure: str
    sure: str
    bound: str
    met: bool
    share: float
    count: int
    wanted: int

    def __str__(self) -> str:
        cases = f"{self.count:,}" if self.count >= self.wanted else f"{self.count:,} of {self.wanted:,}"
        asked = f"`python -m tests.campaigns.{self.command}`, {cases}"
        bound = f"{self.bound}: {judged_as(self.met)}" if self.bound else ""
        return f"| {self.what} | {asked} | {self.figure} | {self.sure} | {bound} |"


def judged_as(met: bool) -> str:
    return "met" if met else "**not met**"


def share(records: Sequence[Record], key: str = "right") -> float:
    return sum(bool(r[key]) for r in records) / max(len(records), 1)


def rate(hits: int, count: int) -> str:
    return resumed.rate(hits, count).strip()


def of(records: Sequence[Record], key: str = "right") -> str:
    return rate(sum(bool(r[key]) for r in records), len(records))


def wrong(records: Sequence[Record], key: str = "right") -> list[Record]:
    """Those above 0.9 and wrong."""
    return [r for r in records if sure_and_wrong(r["verdict"], r["probability"], r[key])]


def told_wrong(records: Sequence[Record], key: str = "right") -> str:
    return f"{len(wrong(records, key))} of {len(records):,}"


def probabilities() -> list[Row]:
    """Expected error of all, and of the worst group."""
    every = committed("calibration")
    error = {g: calibration.expected_error([r for r in every if r["family"] == g])[0] for g in calibration.GROUPS}
    worst = max(error, key=lambda group: error[group])
    rows = []
    for what, mine, most, wanted in (
        (f"probabilities, {worst} (the worst of five groups)", [worst], 0.10, 600),
        ("probabilities, all five groups", list(error), 0.04, 3000),
    ):
        records = [r for r in every if r["family"] in mine]
        found, perfect = calibration.expected_error(records)
        given = sum(r["probability"] for r in records) / len(records)
        apart = sum(r["verdict"] != "missing" or r["distance"] >= SAME for r in wrong(records))
        rows.append(
            Row(
                what,
                "calibration --seed 11",
                f"{100 * share(records):.0f} % right for {given:.2f} said; expected error {found:.3f}, "
                f"a perfect program {perfect:.3f}",
                f"{told_wrong(records)}, {apart} if what is the same as the truth on these data is left out",
                f"error {most:g}",
                found <= most,
                share(records),
                len(records),
                wanted,
            )
        )
    return rows


def loud_noises() -> list[Row]:
    """One effect of 2 sd in 30 runs."""
    every = [r for r in committed("noises") if r["setting"] == "2-30-14-covariance"]
    rows = []
    for family in ("rig", "offsets", "stated"):
        mine = [r for r in every if r["family"] == family]
        strict = sum(r["named"] and is_tie(r["independent"]) for r in mine)
        rows.append(
            Row(
                f"one effect of 2 sd, 30 runs, {NOISES[family]}",
                "noises --size 2 --runs 30 --seed 14",
                f"{of(mine)}; alarms {of(mine, 'alarm')}; "
                f"as if each row's noise were its own {rate(strict, len(mine))}",
                told_wrong(mine),
                "80 %, alarms 95 %" if family != "stated" else "",
                share(mine) >= 0.80 and share(mine, "alarm") >= 0.95,
                share(mine),
                len(mine),
                200,
            )
        )
    return rows


def faults() -> list[Row]:
    """Wrong constants and columns, and sound ones."""
    rows = []
    for family, what in (
        ("constant", "a constant is wrong, by 5 to 50 %"),
        ("scale", "a column's scale is wrong"),
        ("sign", "a column's sign is wrong"),
        ("sound", "nothing is, an effect of 2 sd is missing"),
    ):
        mine = [r for r in committed("statements") if r["family"] == family]
        same = sum(map(excused, wrong(mine)))
        sound = family == "sound"
        rows.append(
            Row(
                what,
                "statements --seed 37",
                of(mine) + (f"; a sound case blamed in {of(mine, 'blamed')}" if sound else ""),
                told_wrong(mine)
                + (f", of which the data do not tell {same} from the truth (D2 below 9)" if same else ""),
                "blamed at most 2 %" if sound else "85 %",
                share(mine, "blamed") <= 0.02 if sound else share(mine) >= 0.85,
                share(mine),
                len(mine),
                400 if sound else 200,
            )
        )
    return rows


def formulas() -> list[Row]:
    every = committed("several_columns")
    rows = []
    for what, mine, wanted in (
        ("formulas of two and of three columns, half of them in columns that go together", every, 400),
        (
            "formulas of three columns that go together",
            [r for r in every if r["family"] == "three" and r["together"]],
            100,
        ),
    ):
        bound = "90 %, above 0.9 and wrong at most 2 %" if mine is every else ""
        met = share(mine) >= 0.90 and len(wrong(mine)) <= 0.02 * len(mine)
        given = (what, "several_columns --seed 42", of(mine), told_wrong(mine), bound, met, share(mine))
        rows.append(Row(*given, len(mine), wanted))
    return rows


def distances_known() -> list[Row]:
    """hidden.py: what the model's own parameters take up (D2 below SAME) is not counted."""
    every = committed("hidden")
    rows = []

    def add(what: str, family: str, figure: str, bound: str, met: bool, key: str = "right") -> None:
        whole, mine = family_of(every, family), counted(every, family)
        aside = f", {len(whole) - len(mine)} not counted" if len(whole) > len(mine) else ""
        sure = told_wrong(mine, key)
        rows.append(Row(what + aside, "hidden --seed 41", figure, sure, bound, met, share(mine), len(whole), 200))

    for family, first, alarm in (("single12", 0.85, 0.80), ("single30", 0.95, 0.92)):
        mine = counted(every, family)
        figure = f"the first candidate in {of(mine)}; alarms {of(mine, 'alarm')}"
        met = share(mine) >= first and share(mine, "alarm") >= alarm
        bound = f"{100 * first:.0f} %, alarms {100 * alarm:.0f} %"
        add(f"one effect of 1 sd, {family[-2:]} runs", family, figure, bound, met, "among")
    mine = counted(every, "small")
    loud = [r for r in mine if r["stated"] <= 1.0 / 1.3]
    told = f"{sum(r['loud'] for r in loud)} of {len(loud)} whose sd is 1.3 times as large and more"
    figure = f"{of(mine)}; that the noise is larger is told, once the effect is added, in {told}"
    add("one effect of 2 sd, sd stated 10 to 50 % too small", "small", figure, "85 %", share(mine) >= 0.85)
    mine = counted(every, "twin")
    what = "a pair of which one member has an exact twin, 2 to 50 sd"
    add(what, "twin", f"tied, with the truth {of(mine)}", "93 %", share(mine) >= 0.93)
    mine = counted(every, "apart")
    high = sum(r["right"] and r["probability"] > 0.9 for r in mine)
    figure = f"named alone {of(mine)}; above 0.9 in {rate(high, len(mine))}"
    met = share(mine) >= 0.85 and high >= 0.60 * len(mine)
    add("every other set of the catalogue has D2 of 25 and more", "apart", figure, "85 %, above 0.9 60 %", met)
    return rows


def family_of(records: Sequence[Record], family: str) -> list[Record]:
    return [r for r in records if r["family"] == family]


def counted(records: Sequence[Record], family: str) -> list[Record]:
    return [r for r in family_of(records, family) if r["hidden"] >= SAME]


def rigs() -> list[Row]:
    mine = committed("mujoco_rigs")
    worst = min({r["family"] for r in mine}, key=lambda one: (share(family_of(mine, one)), one))
    figure = f"{of(mine)}; the worst, {worst}, {of(family_of(mine, worst))}"
    met = share(mine) >= 0.85 and len(wrong(mine)) <= 0.02 * len(mine)
    given = ("rigs in MuJoCo, eight features", "mujoco_rigs --seed 10 --cases 50", figure, told_wrong(mine))
    return [Row(*given, "85 %, above 0.9 and wrong at most 2 %", met, share(mine), len(mine), 400)]


def motions() -> list[Row]:
    mine = committed("dynamic")
    by = sorted({r["family"] for r in mine}, key=lambda base: (share(family_of(mine, base)), base))
    parts = "; ".join(f"{base} {of(family_of(mine, base))}" for base in by)
    met = all(share(family_of(mine, base)) >= 0.80 for base in by)
    given = ("an effect hidden in a motion", "dynamic --seed 2 --cases 100", parts, told_wrong(mine))
    return [Row(*given, "80 % each", met, share(mine), len(mine), 300)]


def own_equations() -> list[Row]:
    mine = family_of(committed("ode_systems"), "lacking")
    given = ("equations of the user's own, a term is missing", "ode_systems --rows 250 --families lacking --seed 4")
    return [Row(*given, of(mine), told_wrong(mine), "85 %", share(mine) >= 0.85, share(mine), len(mine), 100)]


def rounds() -> list[Row]:
    mine = committed("later_rounds")
    crashed, endless, rose = (sum(r[key] for r in mine) for key in ("crashed", "endless", "rose"))
    false = sum(bool(r["false"]) for r in mine)
    figure = (
        f"{crashed} crashes, {endless} beyond five rounds; the held-out error rose in {rate(rose, len(mine))}; "
        f"an effect that is not in the data was added in {rate(false, len(mine))}, of another set than what is the "
        f"same as the truth in {of(mine, 'unlike')}"
    )
    met = crashed == endless == rose == false == 0
    given = ("rounds of `discover` and `add`", "later_rounds --seed 52 --cases 30", figure, "", "none of these", met)
    return [Row(*given, 1.0 - false / len(mine), len(mine), 150)]


ROWS: tuple[Callable[[], list[Row]], ...] = (
    *(probabilities, loud_noises, faults, formulas, distances_known, rigs, motions, own_equations, rounds),
)


def alarms() -> list[str]:
    """Nothing is missing: a row a noise, the worst first, and their sum."""
    every = [r for r in committed("noises") if r["setting"] == "0-14-13"] + committed("two_channels")
    by = sorted({r["family"] for r in every}, key=lambda one: (-share(family_of(every, one), "alarm"), one))
    lines = [
        "| noise, nothing missing, 14 runs | alarms at 5 % | above 0.9 and wrong | alarms at most 8 % |",
        "|---|---|---|---|",
    ]
    for family in by:
        mine = family_of(every, family)
        cases = f"{len(mine)} cases" if len(mine) >= 400 else f"{len(mine)} of 400 cases"
        met = judged_as(share(mine, "alarm") <= 0.08)
        lines.append(f"| {NOISES[family]}, {cases} | {of(mine, 'alarm')} | {len(wrong(mine))} | {met} |")
    false = len(wrong(every))
    falsely, met = rate(false, len(every)), judged_as(false <= 0.01 * len(every))
    return [*lines, f"| all, {len(every):,} | {of(every, 'alarm')} | {falsely} | at most 1 % above 0.9: {met} |"]


def together() -> str:
    """Above 0.9 and wrong, over all campaigns; and `unexplained` where the catalogue has the truth."""
    every = {name: judged(name, committed(name)) for name in CAMPAIGNS}
    sure = [r for answers in every.values() for r, bad in answers if bad]
    cases = sum(map(len, every.values()))
    left = rate(sum(not excused(r) for r in sure), cases)
    low_enough = judged_as(rate_limits(len(sure), cases)[1] <= 0.015)
    known = [r for r, _ in every["hidden"]]
    denied = sum(r["verdict"] == "unexplained" and r["probability"] >= 0.5 for r in known)
    seldom = judged_as(denied <= 0.03 * len(known))
    most = max(CAMPAIGNS, key=lambda name: rivals(committed(name)))
    beside = rivals(committed(most))
    return (
        f"Over all of these together (`python -m tests.campaigns.sure`, {cases:,} cases) {rate(len(sure), cases)} are "
        f"above 0.9 and wrong, {left} if sets that the data do not tell from the truth are left out (upper limit at "
        f"most 1.5 %: {low_enough}). Where one effect or a pair of the catalogue is the truth, `unexplained` at 0.5 or "
        f"more was said in {rate(denied, len(known))} of {len(known):,} cases (at most 3 %: {seldom}). "
        f"Beside its first set an answer tells {beside:.1f} more in the mean of the campaign with the most of them, "
        f"`{most}` (at most 3: {judged_as(beside <= 3.0)})."
    )


def beside_bic() -> str:
    pairs = exhaustive.paired(committed("calibration"), committed("exhaustive"))
    ours, bic = exhaustive.counts(pairs)
    cases = f"{len(pairs)}" if len(pairs) >= 600 else f"{len(pairs)} of 600"
    rates = [rate(one.right, len(pairs)) for one in (ours, bic)]
    met = judged_as(ours.right >= bic.right and 3 * ours.wrong <= bic.wrong)
    return (
        f"**Beside exhaustive BIC** (`python -m tests.campaigns.exhaustive --seed 11 --cases 120`, {cases} cases of "
        "`calibration`): every set of at most two effects of the same catalogue refitted on all rows, under AR(1) "
        "noise and run offsets whose sizes are fitted, too. "
        f"Discovery is right in {rates[0]}, BIC in {rates[1]}; wrong claims are "
        f"{ours.wrong} and {bic.wrong} (as many right, at most a third of the wrong claims: {met})."
    )


def tables() -> str:
    """What the page says, from what is committed."""
    lines = [
        "| what | command, cases | right, named or tied | above 0.9 and wrong | bound |",
        "|---|---|---|---|---|",
        *map(str, sorted((row for make in ROWS for row in make()), key=lambda row: row.share)),
        "",
        *alarms(),
        "",
        together(),
        *(["", beside_bic()] if committed("exhaustive") else []),
    ]
    return "\n".join(lines)


def page(text: str) -> str:
    """The page with the tables between its marks. Raises ValueError without them."""
    if len(re.findall(f"{re.escape(BEGIN)}.*?{re.escape(END)}", text, re.DOTALL)) != 1:
        raise ValueError(f"expected one {BEGIN} with its {END}")
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n{tables()}\n{END}{rest.partition(END)[2]}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns.rates", description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="put them into docs/rates.md")
    if parser.parse_args().write:
        PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        sys.stdout.write(tables() + "\n")


if __name__ == "__main__":
    main()
