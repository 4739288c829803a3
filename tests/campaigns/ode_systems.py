"""Cases with base `ode`: drawn systems of order 1 to 4, one term of whose equations the model lacks.

    python -m tests.campaigns.ode_systems --cases 100 --families lacking    a term is missing
    python -m tests.campaigns.ode_systems --cases 100 --families complete   the model has it: how often an alarm?
    python -m tests.campaigns.ode_systems --part 1/4                        a quarter of the cases; parts merge

The truth is integrated by SciPy (DOP853), which shares nothing with the program's own integrator. An answer is right
where a set that it names, alone or in a tie (ties.py), is one term that acts on the right derivative and is the same
function there: its values along the true motion lie within 0.99 (cosine) of the true term's. Systems take turns by the
number of the case. A rerun goes on where the last one stopped.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from terrapin_hil.arrays import Array
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from tests.campaigns.drawn import write_table
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import distances, is_tie, rivals, told

__all__ = ["KINDS", "SYSTEMS", "Drawn", "System", "draw", "one", "right", "table"]

KINDS = ("lacking", "complete")
SEEDS = 10_000  # cases of one seed, at most
SAME = 0.99  # cosine of two terms along the motion, from which they are one
TURN = 0.002  # of a state's start range: how sharply the truth's sign() turns


@dataclass(frozen=True)
class System:
    """One kind of system. Values of parameters are drawn within 30 % of those stated."""

    name: str
    derivative: Mapping[str, str]  # without the missing term
    term: tuple[str, str]  # state on whose derivative it acts, formula
    parameters: Mapping[str, float]  # of the model, all fitted
    own: Mapping[str, float]  # of the term
    start: Mapping[str, tuple[float, float]]
    measured: tuple[str, ...]
    inputs: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # range of slow random levels
    duration: float = 10.0
    angles: tuple[str, ...] = ()  # states in rad, of which discovery may take the sine


OSCILLATOR = {"x": "v", "v": "(force - d*v - k*x)/m"}
OSCILLATING = {"d": 0.5, "k": 8.0, "m": 1.3}
AROUND = {"x": (-1.0, 1.0), "v": (-1.0, 1.0)}
MOTOR = {"i": "(volt - R*i - K*w)/L", "w": "(K*i - b*w)/J"}
RUNNING = {"R": 1.2, "K": 0.5, "L": 0.05, "b": 0.02, "J": 0.04}
STILL = {"i": (0.0, 0.0), "w": (-5.0, 5.0)}
SWINGING = {"a": "w", "w": "-g*sin(a) - d*w + u"}
PAIR = {"x": "v", "v": "(force - d*v - k*x - c*(x - y))/m", "y": "u", "u": "(c*(x - y) - e*u)/n"}
COUPLED = {"d": 0.4, "k": 6.0, "m": 1.0, "c": 4.0, "e": 0.3, "n": 0.7}
APART = {"x": (-1.0, 1.0), "v": (-1.0, 1.0), "y": (-1.0, 1.0), "u": (-1.0, 1.0)}
TANKS = {"p": "(q - r*sqrt(max(p, 0)))/A", "h": "(r*sqrt(max(p, 0)) - s*sqrt(max(h, 0)))/B"}
FILLING = {"r": 0.5, "s": 0.4, "A": 1.0, "B": 1.5}
FORCE = {"force": (-6.0, 6.0)}

SYSTEMS = (
    System("duffing", OSCILLATOR, ("v", "-k3*x**3"), OSCILLATING, {"k3": 4.0}, AROUND, ("x",), FORCE),
    System("dry friction", OSCILLATOR, ("v", "-c*sign(v)"), OSCILLATING, {"c": 0.6}, AROUND, ("x",), FORCE),
    System("quadratic drag", OSCILLATOR, ("v", "-c*v*abs(v)"), OSCILLATING, {"c": 0.4}, AROUND, ("x", "v"), FORCE),
    System("pendulum, drag", SWINGING, ("w", "-c*w*abs(w)"), {"g": 9.0, "d": 0.1}, {"c": 0.15},
           {"a": (-1.5, 1.5), "w": (-2.0, 2.0)}, ("a",), {"u": (-4.0, 4.0)}, angles=("a",)),
    System("pendulum, no gravity", {"a": "w", "w": "u - d*w"}, ("w", "-g*sin(a)"), {"d": 0.4}, {"g": 6.0},
           {"a": (-1.0, 1.0), "w": (-2.0, 2.0)}, ("a",), {"u": (-5.0, 5.0)}, angles=("a",)),
    System("van der Pol", {"x": "v", "v": "-k*x - mu*x**2*v"}, ("v", "g*v"), {"k": 4.0, "mu": 1.0}, {"g": 1.0},
           {"x": (-2.0, 2.0), "v": (-2.0, 2.0)}, ("x",)),
    System("motor, dry friction", MOTOR, ("w", "-c*sign(w)"), RUNNING, {"c": 12.0}, STILL, ("i", "w"),
           {"volt": (-12.0, 12.0)}),
    System("motor, fan", MOTOR, ("w", "-c*w*abs(w)"), RUNNING, {"c": 0.15}, STILL, ("w",), {"volt": (-12.0, 12.0)}),
    System("motor on an arm", {"a": "w", **MOTOR}, ("w", "-g*sin(a)"), RUNNING, {"g": 30.0},
           {"a": (-1.0, 1.0), **STILL}, ("a", "i"), {"volt": (-3.0, 3.0)}, angles=("a",)),
    System("two tanks, leak", TANKS, ("p", "-c*p"), FILLING, {"c": 0.08}, {"p": (1.0, 4.0), "h": (1.0, 4.0)},
           ("p", "h"), {"q": (0.2, 1.6)}, 60.0),
    System("cooling by radiation", {"T": "(P - h*T)/C"}, ("T", "-s*T**2"), {"h": 0.8, "C": 5.0}, {"s": 0.002},
           {"T": (0.0, 60.0)}, ("T",), {"P": (0.0, 90.0)}, 60.0),
    System("car, air drag", {"v": "(force - b*v)/m"}, ("v", "-c*v*abs(v)"), {"b": 0.2, "m": 2.0}, {"c": 0.06},
           {"v": (0.0, 5.0)}, ("v",), {"force": (-8.0, 12.0)}, 30.0),
    System("pair of masses, hard spring", PAIR, ("v", "-k3*x**3"), COUPLED, {"k3": 5.0}, APART, ("x", "y"), FORCE),
    System("pair of masses, dry friction", PAIR, ("u", "-f*sign(u)"), COUPLED, {"f": 0.5}, APART, ("x", "y"), FORCE),
    System("hunters and prey", {"x": "a*x - b*x*y", "y": "d*x*y - c*y"}, ("x", "-e*x**2"),
           {"a": 1.2, "b": 0.6, "c": 0.8, "d": 0.4}, {"e": 0.12}, {"x": (1.0, 4.0), "y": (0.5, 2.0)}, ("x", "y"),
           {}, 15.0),
    System("rotor, current squared", {"w": "k*i - b*w"}, ("w", "-s*i*abs(i)"), {"k": 2.0, "b": 0.5}, {"s": 0.15},
           {"w": (-2.0, 2.0)}, ("w",), {"i": (-5.0, 5.0)}),
    System("tank, overflow", {"h": "(q - r*sqrt(max(h, 0)))/A"}, ("h", "-s*max(h - e, 0)"), {"r": 0.04, "A": 0.5},
           {"s": 0.35, "e": 0.3}, {"h": (0.05, 0.5)}, ("h",), {"q": (0.0, 0.09)}, 60.0),
    System("spring in a gap", OSCILLATOR, ("v", "-s*sign(x)*max(abs(x) - e, 0)"), OSCILLATING, {"s": 9.0, "e": 0.5},
           AROUND, ("x",), FORCE),
)  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """A case in a folder, and the truth: the missing term along the motion of all rows."""

    system: System
    noise: float
    folder: Path
    names: Mapping[str, Array]  # states and inputs (rows,)
    term: Array


def draw(seed: int, folder: Path, runs: int = 10, rows: int = 1000, alone: str = "", complete: bool = False) -> Drawn:
    """The case of a seed, written into `folder`. `complete`: the model has the term, and nothing is missing."""
    random = np.random.default_rng([seed, 0x0DE])
    system = next((s for s in SYSTEMS if s.name == alone), SYSTEMS[seed % len(SYSTEMS)])
    noise = float(random.choice([0.01, 0.02, 0.03, 0.05]))
    values = {n: v * random.uniform(0.7, 1.3) for n, v in {**system.parameters, **system.own}.items()}
    term = system.term[1]
    clock = np.linspace(0.0, system.duration, rows)
    formulas = {name: parse(text) for name, text in {**system.derivative, "": term}.items()}
    columns: dict[str, list[Array]] = {name: [] for name in (*system.derivative, *system.inputs)}
    for _ in range(runs):
        knots = np.linspace(0.0, system.duration, 12)
        drive = {n: np.interp(clock, knots, random.uniform(*limits, len(knots))) for n, limits in system.inputs.items()}
        first = [random.uniform(*system.start[name]) for name in system.derivative]
        motion = _motion(system, formulas, values, clock, drive, np.array(first))
        for name, column in {**drive, **dict(zip(system.derivative, motion, strict=True))}.items():
            columns[name].append(column)
    names = {name: np.concatenate(parts) for name, parts in columns.items()}
    measured = {c: names[c] + noise * names[c].std() * random.standard_normal(runs * rows) for c in system.measured}
    table = {"time": np.tile(clock, runs)} | {n: names[n] for n in system.inputs}
    table |= {f"{n}_measured": values for n, values in measured.items()}
    write_table(folder / "runs.csv", [f"r{n:02d}" for n in np.repeat(np.arange(runs), rows)], table)
    (folder / "case.toml").write_text(_case(system, random, complete))
    return Drawn(system, noise, folder, names, formulas[""].evaluate({**names, **values}))


def _motion(
    system: System, formulas: Mapping[str, object], values: Mapping[str, float], clock: Array,
    drive: Mapping[str, Array], first: Array,
) -> Array:  # fmt: skip
    """States (states, rows)."""
    names = list(system.derivative)
    at = names.index(system.term[0])
    span = [max(abs(low), abs(high), 1e-3) for low, high in system.start.values()]
    code = {n: compile(str(f).replace("sign(", "turn("), n or "term", "eval") for n, f in formulas.items()}
    turn = TURN * max(span)
    known = {"turn": lambda z: np.tanh(z / turn), "sqrt": np.sqrt, "sin": np.sin, "abs": abs, "max": max}

    def rates(now: float, state: Array) -> list[float]:
        here = {**known, **values, **dict(zip(names, state, strict=True))}
        here |= {name: float(np.interp(now, clock, column)) for name, column in drive.items()}
        found = [float(eval(code[name], {}, here)) for name in names]
        found[at] += float(eval(code[""], {}, here))
        return found

    step = float(clock[-1]) / 200.0
    solution = solve_ivp(rates, (0.0, clock[-1]), first, "DOP853", clock, rtol=1e-7, atol=1e-9, max_step=step)
    assert solution.success, f"{system.name}: {solution.message}"
    return np.asarray(solution.y)


def _case(system: System, random: np.random.Generator, complete: bool) -> str:
    lines = ["[case]", f'title = "{system.name}"', "[model]", 'base = "ode"', "[model.states]"]
    units = dict.fromkeys(system.angles, ', unit = "rad"')
    lines += [f'{name} = {{ initial = "fit"{units.get(name, "")} }}' for name in system.derivative]
    lines += ["[model.derivative]"]
    state, term = system.term
    for name, formula in system.derivative.items():
        lines.append(f'{name} = "{formula} + {term}"' if complete and name == state else f'{name} = "{formula}"')
    lines += ["[model.measured]", *(f'{name}_measured = "{name}"' for name in system.measured), "[fit]"]
    for name, value in {**system.parameters, **(system.own if complete else {})}.items():
        lines.append(f"{name} = {{ value = {value * random.uniform(0.6, 1.5):.4g}, min = 0, max = {10 * value:g} }}")
    lines += ["[data]", 'files = ["runs.csv"]', 'run = "run"', "[data.columns]"]
    for name in ("time", *system.inputs, *(f"{name}_measured" for name in system.measured)):
        lines.append(f'{name} = {{ column = "{name}", unit = "1" }}')
    return "\n".join(lines) + "\n"


def right(drawn: Drawn, found: Discovery) -> bool:
    """Whether the term is named, alone or among rivals."""
    if found.verdict not in ("missing", "ambiguous"):
        return False
    cards = {card.effect.name: card for card in found.candidates}
    for names in told(found):
        if len(names) != 1 or names[0] not in cards:
            continue
        card = cards[names[0]]
        own = {f.name: float(v) for f, v in zip(card.fit.model.fitted, card.fit.theta, strict=True) if f.effect}
        named = parse(card.effect.expression).evaluate({**drawn.names, **own})
        named = np.broadcast_to(named, drawn.term.shape)
        cosine = abs(float(named @ drawn.term)) / max(np.linalg.norm(named) * np.linalg.norm(drawn.term), 1e-300)
        if card.effect.target == f"derivative.{drawn.system.term[0]}" and cosine >= SAME:
            return True
    return False


def one(kind: str, number: int, seed: int, runs: int = 10, rows: int = 1000) -> Record:
    """Make and answer one case."""
    with tempfile.TemporaryDirectory() as place:
        drawn = draw(SEEDS * seed + number, Path(place) / "case", runs, rows, complete=kind == "complete")
        begin = time.perf_counter()
        case = load_case(drawn.folder)
        found = discover(case)
        seconds = time.perf_counter() - begin
    true = np.array([drawn.names[c] for c in drawn.system.measured])
    apart = distances(found, case.inputs, true, drawn.noise * true.std(axis=1)) if found.rivals else []
    named = right(drawn, found)
    cards = {card.effect.name: f"{card.effect.target}: {card.effect.expression}" for card in found.candidates}
    sd = found.analysis.noise.sigma / [drawn.noise * drawn.names[c].std() for c in drawn.system.measured]
    return {
        "system": drawn.system.name,
        "order": len(drawn.system.derivative),
        "noise": drawn.noise,
        "verdict": found.verdict,
        "probability": found.answer_probability,
        "told": [[cards.get(name, name) for name in names] for names in told(found)],
        "named": named,
        "distances": apart,
        "likeliest": next(iter(cards.values()), ""),
        "right": found.verdict == "adequate" if kind == "complete" else named and is_tie(apart, exact=False),
        "errors": [round(found.ladder[0].train_error, 3), round(found.ladder[-1].train_error, 3)],
        "sd_over_true": np.round(sd, 3).tolist(),
        "seconds": round(seconds, 1),
    }


def table(records: list[Record]) -> str:
    """Rates by kind, over all and by system, the worst first; below them what was said instead."""
    lines = []
    for kind in KINDS:
        mine = [r for r in records if r["family"] == kind]
        if not mine:
            continue
        lines.append(
            f"{kind:32}{'cases':>6}{'right or tied':>24}{'above 0.9 and wrong':>24}{'rivals':>8}{'seconds':>9}"
        )
        systems = {name: [r for r in mine if r["system"] == name] for name in {r["system"] for r in mine}}
        worst = sorted(systems.items(), key=lambda item: (sum(r["right"] for r in item[1]) / len(item[1]), item[0]))
        for name, part in (("all", mine), *worst):
            sure = sum(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in part)
            seconds = np.median([r["seconds"] for r in part])
            rates = rate(sum(r["right"] for r in part), len(part)) + rate(sure, len(part))
            lines.append(f"{name:32}{len(part):6d}{rates}{rivals(part):8.1f}{seconds:9.1f}")
        for r in sorted((r for r in mine if not r["right"]), key=lambda r: r["system"]):
            said = " | ".join(" + ".join(names) for names in r["told"]) or f"- (likeliest {r['likeliest']})"
            lines.append(
                f"  {r['number']:4d} {r['system']}, {r['noise']}: {r['verdict']} {r['probability']:.2f}  {said}"
            )
        lines.append("")
    return "\n".join(lines).rstrip()


def main() -> None:
    parser = parser_of(__doc__, "python -m tests.campaigns.ode_systems", KINDS, cases=len(SYSTEMS))
    parser.add_argument("--runs", type=int, default=10, help="of each case; 10")
    parser.add_argument("--rows", type=int, default=1000, help="of each run; 1000")
    options = parser.parse_args()
    make = lambda kind, number: one(kind, number, options.seed, options.runs, options.rows)  # noqa: E731
    print(table(resumed(options, f"{options.runs}-{options.rows}-{options.seed}-ties", make)))


if __name__ == "__main__":
    main()
