"""Above 0.9 and wrong, over all families together: what the campaigns have counted of the present engine.

    python -m tests.campaigns.sure                  what is committed, and what stands in out/
    python -m tests.campaigns.sure --out FOLDER

Strictly, an answer above 0.9 is wrong where its campaign does not call it right. Of these are left: `missing` whose set
the data tell from the truth (D2 of ADMISSIBLE and more), that has more members than the truth (one that holds it and
more always reaches it), or where nothing is missing; `unexplained`; and `adequate`, but for effects that were drawn at
1 noise sd: the model's own parameters leave less of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tests.campaigns.resumed import Record, everything, rate, sure_and_wrong
from tests.campaigns.ties import ADMISSIBLE
from tests.campaigns.truth import SAME

__all__ = ["excused", "judged", "table"]

CAMPAIGNS = (
    *("noises", "two_channels", "calibration", "statements", "hidden", "several_columns", "mujoco_rigs"),
    *("ode_systems", "dynamic"),
)


def judged(campaign: str, records: Sequence[Record]) -> list[tuple[Record, bool]]:
    """The records that count, and whether each is above 0.9 and wrong."""
    counted = [r for r in records if campaign != "hidden" or r["hidden"] >= SAME]
    of_one = "among" if campaign == "hidden" else "right"  # an effect alone counts there by its place in a list
    right = [r[of_one if r["family"].startswith("single") else "right"] for r in counted]
    return [(r, sure_and_wrong(r["verdict"], r["probability"], good)) for r, good in zip(counted, right, strict=True)]


def excused(record: Record) -> bool:
    """Whether the data do not tell what is said from the truth, or less than 1 sd is missing."""
    if record["verdict"] == "missing" and record.get("truth"):
        truth = record["truth"]
        members = 1 if isinstance(truth, str) else len(truth)
        said = record["missing"] if "missing" in record else (record.get("said") or record["told"])[0]
        distance = record["distance"] if "distance" in record else record["distances"][0]
        return len(said) <= members and bool(distance < ADMISSIBLE)
    return record["verdict"] == "adequate" and record["family"].startswith("single")


def table(of_campaign: dict[str, list[Record]]) -> str:
    """Rates by campaign, the worst first, then all together; below them each such answer."""
    lines = [f"{'campaign':16}{'cases':>6}{'above 0.9 and wrong':>24}{'and not admissible':>24}"]
    rows, told = [], []
    for name, records in of_campaign.items():
        every = judged(name, records)
        wrong = [r for r, sure in every if sure]
        left = [r for r in wrong if not excused(r)]
        rows.append((name, len(every), len(wrong), len(left)))
        for r in wrong:
            what = " + ".join(r["missing"]) if "missing" in r else " | ".join(" + ".join(s) for s in r.get("said", []))
            hidden = r.get("truth", r.get("system", ""))
            told.append(
                f"  {name} {r['family']} {r['number']}: {hidden}: {r['verdict']} {r['probability']:.2f}: {what}"
                + (" (admissible)" if excused(r) else "")
            )
    rows.sort(key=lambda row: -row[3] / max(row[1], 1))
    rows.append(("all", *(sum(row[i] for row in rows) for i in (1, 2, 3))))
    lines += [
        f"{name:16}{cases:6d}{rate(wrong, cases)}{rate(left, cases)}" for name, cases, wrong, left in rows if cases
    ]
    return "\n".join([*lines, *told])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns.sure", description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER")
    options = parser.parse_args()
    print(table({name: everything(name, options.out) for name in CAMPAIGNS}))


if __name__ == "__main__":
    main()
