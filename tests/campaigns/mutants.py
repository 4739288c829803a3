"""Bounds on the firmware's tests: all mutants of each library, as `python -m tests.mutation --whole` judges them.

A day when nothing is known; what stands in tests/mutation/judged.txt and out/mutation is not judged again.
"""

from __future__ import annotations

from tests.campaigns.table import Line
from tests.mutation import __main__ as gate
from tests.mutation.judge import NotReady

__all__ = ["lines"]


def lines() -> list[Line]:
    """One line a library, with its survivors under it."""
    every = gate.everything()
    equivalent, wrong = gate.listed(every)
    path = gate.ROOT / "out" / "mutation" / "judged.jsonl"
    bound = f">= {100 * gate.SHARE:g} %"
    try:
        done = gate.judge(every, equivalent, path, gate.kept(every) | gate.stored(path))
    except NotReady as error:
        return [Line("mutants", "", "", 0, bound, False, (str(error),))]
    found = []
    for name in gate.LIBRARIES:
        verdicts = {k: done[k]["verdict"] for k, m in every.items() if gate.library(m) == name and k in done}
        alive = [every[k] for k, verdict in verdicts.items() if verdict == "survived" and k not in equivalent]
        killed = sum(verdict == "killed" for verdict in verdicts.values())
        share = killed / max(1, killed + len(alive))
        never = [m for m in alive if m.path.as_posix().startswith(gate.NO_SURVIVOR)]
        told = tuple(f"{m.path.as_posix()}:{m.number}: {m.line} | {m.change}" for m in alive)
        met = share >= gate.SHARE and not never and not wrong
        found.append(Line(f"mutants {name}", f"{100 * share:.1f} %", "", killed + len(alive), bound, met, told))
    return found
