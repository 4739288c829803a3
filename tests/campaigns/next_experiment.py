"""Cases that cannot tell two effects apart, and what is left of the rivals after the proposed experiment was run.

`python tests/campaigns/next_experiment.py --cases 10` prints for each pair how often discover says that the data cannot
tell, with the right pair, and how often one candidate, the true one, is left after the proposed runs. Those runs are
simulated from the true model with the same noise, and appended to the case.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

sys.path.insert(0, str(Path(__file__).resolve().parent))

from discovery_cases import Made, _measure, make

from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.experiment.rig_settings import rows_of
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["PAIRS", "after_proposed", "confounded", "with_runs"]

Array = npt.NDArray[np.float64]

# the two effects, and why the data cannot tell them apart
PAIRS: Mapping[str, tuple[str, tuple[str, str]]] = {
    "load": ("rolling_steady", ("speed_squared", "aerodynamic_drag")),  # load and slip constant
    "pass": ("sphere_contact", ("rate_effect", "multipass")),  # speed follows the number of the pass
    "slope": ("rolling_steady", ("slope", "current_offset")),  # one slope, one load
    "direction": ("rolling_steady", ("coulomb_friction", "current_offset")),  # one direction
    "ramp": ("rolling_steady", ("inertia", "viscous_friction")),  # acceleration in proportion to speed
}


def confounded(kind: str, runs: int, rho: float, size: float, random: np.random.Generator) -> Made | None:
    """A case of the kind; None when the draw lacks a column that it needs."""
    base, pair = PAIRS[kind]
    hidden = str(random.choice(pair))
    if kind in ("load", "pass"):
        return make(base, (hidden,), runs, rho, size, random, confound=kind)
    drawn = make(base, (), runs, rho, 1.0, random, confound="direction" if kind == "direction" else "")
    if drawn is None:
        return None
    case = drawn.case
    roles = dict(case.roles)
    if kind == "slope":
        if "slope" not in roles:
            return None
        roles["slope"] = np.full(case.rows, float(random.uniform(0.03, 0.1)))
        roles["load"] = np.full(case.rows, float(random.uniform(18, 30)))
    elif kind == "ramp":
        if "acceleration" not in roles:
            return None
        roles["acceleration"] = 0.3 * roles["omega"]
    limits = dict(case.limits)
    if kind == "direction":  # no rig is sent the other way round unless it is said to go there
        fastest = float(roles["omega"].max())
        limits["omega"] = (-fastest, fastest)
    extra = {name: values for name, values in case.extra.items() if name != "speed"}
    return _measure(replace(case, roles=roles, extra=extra, limits=limits), (hidden,), None, random, rho, size, True)


def with_runs(
    made: Made, settings: list[Mapping[str, float]], hold: Mapping[str, float], random: np.random.Generator
) -> Made:
    """The case with one more run for each setting, from the true model and with its noise; every fourth is held out."""
    case = made.case
    rows = np.ones(case.rows, dtype=bool)
    lengths = np.bincount(case.run)
    count = int(np.median(lengths))
    fixed = {**{name: float(np.median(values)) for name, values in case.roles.items()}, **hold}
    inputs = rows_of(case, rows, settings, fixed, count)
    varied = {name for setting in settings for name in setting}
    fresh = {name for name in varied if name not in case.roles and name in case.parameters}
    old = {**case.roles, **{name: np.full(case.rows, case.parameters[name]) for name in fresh}}
    roles = {
        name: np.concatenate([values, inputs["pass_" if name == "pass" else name]]) for name, values in old.items()
    }
    new = len(settings) * count
    pick = random.integers(case.rows, size=new)  # what is not set: as in some old row
    extra = {name: np.concatenate([values, values[pick]]) for name, values in case.extra.items()}
    run = np.concatenate([case.run, len(case.run_names) + np.repeat(np.arange(len(settings)), count)])
    held = np.repeat(np.arange(len(settings)) % 4 == 3, count)
    longer = replace(
        case,
        roles=roles,
        extra=extra,
        units={**case.units, **{name: "N" for name in fresh if name == "load"}},
        channels={name: np.concatenate([values, np.zeros(new)]) for name, values in case.channels.items()},
        run=run,
        run_names=(*case.run_names, *(f"z{i:03d}" for i in range(len(settings)))),
        train=np.concatenate([case.train, ~held]),
        test=np.concatenate([case.test, held]),
    )
    model = Model.of(longer, made.truth)
    theta = np.array([made.theta[fitted.key] for fitted in model.fitted])
    predicted = model.bind(longer.inputs).predict(theta)[:, case.rows :]
    runs = Runs(run[case.rows :])
    channels = dict(longer.channels)
    for i, name in enumerate(model.channels):
        noise = runs.draw(random, 1, Node(1.0, made.rho, 0.0, 0.0, 1.0))[:, 0]
        channels[name] = np.concatenate([case.channels[name], predicted[i] + made.sigma[name] * noise])
    return replace(made, case=replace(longer, channels=channels))


def after_proposed(made: Made, found: Discovery, random: np.random.Generator) -> Discovery:
    """Discover again, with the runs that `found` proposed simulated from the true model and appended to the case."""
    plan = found.experiment
    assert plan is not None, "no experiment was proposed"
    return discover(with_runs(made, list(plan.settings), plan.hold, random).case)


def one(kind: str, number: int, seed: int) -> dict[str, object] | None:
    """Draw, answer, measure what was proposed, answer again."""
    random = np.random.default_rng([seed, sorted(PAIRS).index(kind), number])
    runs, rho, size = (
        int(random.integers(12, 31)),
        float(random.choice([0.0, 0.0, 0.8])),
        float(random.choice([2.0, 4.0])),
    )
    made = next((m for _ in range(30) if (m := confounded(kind, runs, rho, size, random)) is not None), None)
    if made is None:
        return None
    found = discover(made.case, seed=number)
    pair = {frozenset([name]) for name in PAIRS[kind][1]}
    said = found.verdict == "ambiguous" and pair <= {frozenset(r) for r in found.rivals}
    result: dict[str, object] = {
        "kind": kind,
        "number": number,
        "truth": made.truth,
        "size": size,
        "rho": rho,
        "runs": runs,
        "verdict": found.verdict,
        "rivals": [list(r) for r in found.rivals],
        "missing": found.missing,
        "said": said,
    }
    if found.experiment is not None:
        plan = found.experiment
        later = after_proposed(made, found, random)
        result.update(
            vary=plan.vary,
            new_runs=plan.runs,
            reason=plan.reason,
            later=later.verdict,
            later_missing=later.missing,
            later_rivals=[list(r) for r in later.rivals],
            left=later.verdict == "missing" and set(later.missing) == set(made.truth),
        )
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10, help="of each pair")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pairs", default=",".join(PAIRS))
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    everything = []
    for kind in arguments.pairs.split(","):
        results = []
        for number in range(arguments.first, arguments.first + arguments.cases):
            result = one(kind, number, arguments.seed)
            if result is not None:
                results.append(result)
                print(" ", {k: v for k, v in result.items() if k != "kind"}, file=sys.stderr, flush=True)
        everything += results
        print(_line(kind, results), flush=True)
    print(_line("all", everything))


def _line(kind: str, results: list[dict[str, object]]) -> str:
    said = [r for r in results if r["said"]]
    proposed = [r for r in said if "left" in r]
    left = sum(bool(r["left"]) for r in proposed)
    return (
        f"{kind:10} cases {len(results)}, said with the right pair {len(said)}, "
        f"proposed {len(proposed)}, one left {left}"
    )


if __name__ == "__main__":
    main()
