"""What the papers' systems may lack, hidden by code of our own: is it named? `python -m tests.campaigns.papers_in_time`

    python -m tests.campaigns.papers_in_time --families axle,printed --cases 10    forced slip: which variant it is
    python -m tests.campaigns.papers_in_time --families EIGHT --cases 3

Tables come from own_bodies.py and formulas.py, which share nothing with hil; sizes are the papers'. `axle` and
`printed` hide bulldozing, slip sinkage or both in that variant under a sphere that is forced to a slip, of 2 noise sd
and more (rms, in the loudest channel); right is that set, alone or tied. The other eight hide what their names say:
right is the effect (a rut with what it deepens), and where the catalogue has none the odd run (slope of one run) or
the column of a formula (an exponent that follows slip). A winding whose temperature is not measured, every third, is
right as a wrong resistance. `beyond` counts cases with an effect above 0.9 that is not in the truth.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from tests.campaigns.drawn import write_table
from tests.campaigns.formulas import predict
from tests.campaigns.own_bodies import Car, Cylinder, car, cylinder
from tests.campaigns.resumed import Record, parser_of, rate, resumed, sure_and_wrong
from tests.campaigns.ties import told

__all__ = ["FAMILIES", "Hidden", "make", "one"]

Array = npt.NDArray[np.float64]
Random = np.random.Generator
Table = dict[str, Array]
FORCED = ("axle", "printed")
EIGHT = ("swing", "n_slip", "winding", "rut", "multipass", "slope", "split", "hub")
FAMILIES = (*FORCED, *EIGHT)
SMALLEST = 2.0  # noise sd
SURE = 0.9


@dataclass(frozen=True)
class Hidden:
    """A case to be written: `truth` is the set that is right; `formula`, target ("": any) and column of one that is;
    `run`, the odd one. `size` is told for the record."""

    base: str
    known: Mapping[str, float]
    fit: Mapping[str, tuple[float, float, float]]
    inputs: Mapping[str, str]  # unit of each
    channels: Mapping[str, tuple[str, float]]  # unit and sd of each
    run: Sequence[str]
    table: Table
    truth: tuple[str, ...] = ()
    formula: tuple[str, str] = ("", "")
    odd: str = ""
    size: Mapping[str, float] = field(default_factory=dict)


SAND = {"n": 0.97, "cohesion": 0.0, "c1": 0.18, "c2": 0.32, "unit_weight": 19600.0, "n_c": 20.0, "n_gamma": 6.0}
SOIL = {"k_s": (1.5e6, 2e4, 2e7), "friction_angle": (0.663, 0.262, 0.873), "shear_modulus": (0.015, 0.002, 0.09)}
RIG = {"traction": ("N", 0.5), "torque": ("N m", 0.12)}


def _sphere(random: Random, effects: Mapping[str, Mapping[str, float]], passes: bool = False) -> Hidden:
    """Forced slip at five loads, three times each."""
    known = {"radius": 0.22, **SAND}
    own = {"k_s": random.uniform(1.5e6, 2.4e6), "friction_angle": np.radians(random.uniform(38.0, 44.0))}
    own["shear_modulus"] = random.uniform(0.014, 0.022)
    loads = np.repeat(np.tile([80.0, 115.0, 150.0, 185.0, 220.0], 3), 9)
    columns = {"slip": np.tile(np.linspace(0.15, 0.75, 9), 15), "load": loads}
    if passes:
        columns["pass"] = np.repeat([1.0, 2.0, 3.0], 45)
    constants = {**known, **own}
    found = predict("sphere_contact", constants, columns, effects, None)
    plain = predict("sphere_contact", constants, columns, {}, None)
    moved = max(float(np.sqrt(((found[c] - plain[c]) ** 2).mean())) / sd for c, (_, sd) in RIG.items())
    if moved < SMALLEST:
        return _sphere(
            random, {name: {k: 1.5 * v if k in GROWS else v for k, v in p.items()} for name, p in effects.items()}
        )
    table = {**columns, **{c: found[c] + sd * random.standard_normal(loads.size) for c, (_, sd) in RIG.items()}}
    size = {f"{name}.{k}": round(v, 5) for name, p in effects.items() for k, v in p.items()}
    return Hidden(
        *("sphere_contact", known, SOIL, dict.fromkeys(columns, "1") | {"load": "N"}, RIG),
        [f"f{r}" for r in np.repeat(np.arange(15), 9)],
        table,
        tuple(effects),
        size={**size, "sd": round(moved, 1)},
    )


GROWS = ("scale", "xi1", "rut_depth", "kappa")


def _forced(variant: str) -> Callable[[int, Random], Hidden]:
    def draw(number: int, random: Random) -> Hidden:
        effects: dict[str, Mapping[str, float]] = {}
        at = "_at_axle" if variant == "axle" else ""
        if number % 3 != 1:
            effects[f"bulldozing{at}"] = {"scale": random.uniform(0.6, 1.2)}
        if number % 3 != 0:
            effects[f"slip_sinkage{at}"] = {"xi1": random.uniform(0.5, 2.0), "xi2": 0.45, "xi3": 2.0}
        return _sphere(random, effects)

    return draw


def _rut(number: int, random: Random) -> Hidden:
    at = "_at_axle" if number % 2 == 0 else ""
    depth = random.uniform(3e-3, 9e-3)
    return _sphere(random, {f"bulldozing{at}": {"scale": 1.0}, f"rut{at}": {"rut_depth": depth}})


def _n_follows(number: int, random: Random) -> Hidden:
    """A rigid wheel whose exponent falls with slip."""
    known = {"radius": 0.08, "width": 0.15, "k_c": 24e3, "cohesion": 700.0, "n": 1.1}
    own = {"k_phi": random.uniform(1.2e6, 1.9e6), "friction_angle": np.radians(random.uniform(29.0, 35.0))}
    own["shear_modulus"] = random.uniform(0.018, 0.03)
    columns = {"slip": np.tile(np.linspace(0.05, 0.7, 8), 18), "load": np.repeat(np.tile([15.0, 20.0, 25.0], 6), 8)}
    share = -random.uniform(0.15, 0.35)
    found = predict("wheel_contact", {**known, **own}, columns, {"n_follows_slip": {"share": share}}, None)
    channels = {"traction": ("N", 0.15), "torque": ("N m", 0.008), "sinkage": ("m", 1e-4)}
    table = {**columns, **{c: found[c] + sd * random.standard_normal(144) for c, (_, sd) in channels.items()}}
    fit = {"k_phi": (1.2e6, 2e4, 2e7), "friction_angle": (0.576, 0.262, 0.785), "shear_modulus": (0.02, 0.002, 0.09)}
    runs = [f"e{r}" for r in np.repeat(np.arange(18), 8)]
    given = ("wheel_contact", known, fit, {"slip": "1", "load": "N"}, channels, runs, table)
    return Hidden(*given, formula=("n", "slip"), size={"share": round(share, 3)})


def _cylinder(random: Random, body: Cylinder, warm: bool = False, **more: object) -> Hidden:
    """Six runs of 4 s at 25 Hz, of steps and ramps of the voltage."""
    time_ = np.arange(0.0, 4.0, 0.04)
    volts = np.array(
        [np.interp(time_, [0.0, 0.3, 1.8, 2.1, 4.0], [0.0, *random.uniform(3.0, 9.0, 2).repeat(2)]) for _ in range(6)]
    )
    volts *= np.array([[1.0], [1.0], [-1.0], [1.0], [-1.0], [1.0]])
    found = cylinder(body, time_, volts)
    channels = {"omega": ("rad/s", 0.03), "current": ("A", 0.004), "swing_angle": ("rad", 0.004)}
    made = {"omega": found["omega"], "current": found["current"], "swing_angle": found["swing"]}
    table = {"time": np.tile(time_, 6), "voltage": volts.reshape(-1)}
    inputs = {"time": "s", "voltage": "V"}
    if warm:
        table["temperature"], inputs["temperature"] = found["winding"].reshape(-1), "degC"
    for name, (_, sd) in channels.items():
        table[name] = made[name].reshape(-1) + sd * random.standard_normal(made[name].size)
    fit = {"f_o": (0.05, 0.0, 0.5), "coulomb": (0.010, 0.0, 0.1), "viscous": (1e-3, 0.0, 0.02)}
    runs = [f"r{r}" for r in np.repeat(np.arange(6), time_.size)]
    return Hidden("cmr", {"radius": 0.08}, fit, inputs, channels, runs, table, **more)  # type: ignore[arg-type]


def _ground(random: Random) -> dict[str, float]:
    return {"f_o": random.uniform(0.05, 0.09), "coulomb": random.uniform(0.008, 0.02), "viscous": 1e-3}


def _swing(number: int, random: Random) -> Hidden:
    k = random.uniform(0.04, 0.12)
    body = Cylinder(**_ground(random), swing_friction=k)
    return _cylinder(random, body, truth=("swing_friction",), size={"k": round(k, 4)})


def _winding(number: int, random: Random) -> Hidden:
    warm = number % 3 != 2
    body = Cylinder(**_ground(random), copper=0.0039, thermal=(random.uniform(20.0, 40.0), 2.0))
    truth = "winding_temperature" if warm else "constant.armature_resistance"
    return _cylinder(random, body, warm=warm, truth=(truth,), size={"K/W": round(body.thermal[0], 1)})


def _slope(number: int, random: Random) -> Hidden:
    odd, tilt = int(random.integers(6)), random.uniform(0.02, 0.05)
    slopes = np.where(np.arange(6) == odd, tilt, 0.0)
    return _cylinder(random, Cylinder(**_ground(random), slope=slopes), odd=f"r{odd}", size={"slope": round(tilt, 4)})


def _car(random: Random, body: Car, **more: object) -> Hidden:
    """Four runs of 4 s at 25 Hz, of torques that rise, pause and rise again."""
    time_ = np.arange(0.0, 4.0, 0.04)
    runs = []
    for _ in range(4):
        top, low, again = random.uniform(560.0, 720.0), random.uniform(250.0, 400.0), random.uniform(500.0, 680.0)
        at = random.uniform(1.4, 2.2)
        runs.append(np.interp(time_, [0, 0.1, 0.8, at, at + 0.2, at + 0.5, 4], [0, 0, top, top, low, again, again]))
    torque = np.array(runs)
    found = car(body, time_, torque)
    channels = dict.fromkeys(found, ("rad/s", 0.1))
    table = {"time": np.tile(time_, 4), "drive_torque": torque.reshape(-1)}
    table |= {c: v.reshape(-1) + 0.1 * random.standard_normal(v.size) for c, v in found.items()}
    known = {"n": 0.71, "cohesion": 1150.0}
    fit = {"k_s": (5e5, 1e5, 2e6), "friction_angle": (0.55, 0.419, 0.663), "shear_modulus": (0.036, 0.02, 0.05)}
    names = [f"r{r}" for r in np.repeat(np.arange(4), time_.size)]
    inputs = {"time": "s", "drive_torque": "N m"}
    return Hidden("vehicle", known, fit, inputs, channels, names, table, **more)  # type: ignore[arg-type]


def _sand(random: Random) -> dict[str, float]:
    soil = {"k_s": random.uniform(4e5, 6e5), "n": 0.71, "cohesion": 1150.0}
    return soil | {"angle": np.radians(random.uniform(30.0, 33.0)), "shear": random.uniform(0.032, 0.04)}


def _multipass(number: int, random: Random) -> Hidden:
    """Every second of a sphere that rolls in its rut again, told by a column; else of a car's rear wheels."""
    kappa = random.uniform(0.2, 0.4)
    if number % 2 == 0:
        return _car(random, Car(_sand(random), rear=2.0**kappa), truth=("multipass",), size={"kappa": round(kappa, 3)})
    return _sphere(random, {"multipass": {"kappa": kappa}}, passes=True)


def _split(number: int, random: Random) -> Hidden:
    left = random.uniform(0.8, 0.93)
    return _car(random, Car(_sand(random), left=left), truth=("split_ground",), size={"left": round(left, 3)})


def _hub(number: int, random: Random) -> Hidden:
    torque = random.uniform(15.0, 50.0)
    return _car(random, Car(_sand(random), hub=torque), truth=("coulomb_friction",), size={"N m": round(torque, 1)})


DRAW: Mapping[str, Callable[[int, Random], Hidden]] = {
    **{variant: _forced(variant) for variant in FORCED},
    "swing": _swing,
    "n_slip": _n_follows,
    "winding": _winding,
    "rut": _rut,
    "multipass": _multipass,
    "slope": _slope,
    "split": _split,
    "hub": _hub,
}


def make(family: str, number: int, seed: int) -> Hidden:
    return DRAW[family](number, np.random.default_rng([seed, FAMILIES.index(family), number]))


def write(hidden: Hidden, folder: Path) -> Path:
    """The case's folder."""
    write_table(folder / "runs.csv", hidden.run, hidden.table, digits=7)
    lines = ["[case]", 'title = "hidden"', "[model]", f'base = "{hidden.base}"', "[parameters]"]
    lines += [f"{name} = {float(value)!r}" for name, value in hidden.known.items()] + ["[fit]"]
    lines += [f"{n} = {{ value = {v!r}, min = {low!r}, max = {high!r} }}" for n, (v, low, high) in hidden.fit.items()]
    lines += ["[data]", 'files = ["runs.csv"]', 'run = "run"', "[data.columns]"]
    lines += [f'{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in hidden.inputs.items()]
    lines += [f'{n} = {{ column = "{n}", unit = "{u}", sigma = {sd!r} }}' for n, (u, sd) in hidden.channels.items()]
    (folder / "case.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def _right(found: Discovery, hidden: Hidden) -> bool:
    """Whether the truth is what is told, or among it."""
    if hidden.odd:
        return found.blamed is not None and hidden.odd in found.blamed.runs
    if hidden.truth:
        return any(set(names) == set(hidden.truth) for names in told(found))
    return any(_is_formula(found, name, hidden.formula[1]) for names in told(found) for name in names)


def _is_formula(found: Discovery, name: str, column: str) -> bool:
    return found.ranking.columns.get(name) == column


def one(family: str, number: int, seed: int) -> Record:
    """Make and answer one case."""
    hidden = make(family, number, seed)
    with tempfile.TemporaryDirectory() as place:
        case = load_case(write(hidden, Path(place) / "case"))
        begin = time.process_time()
        try:
            found = discover(case, seed=number)
        except UserError as error:
            return {
                "verdict": "refused",
                "probability": 0.0,
                "told": [],
                "right": False,
                "beyond": [],
                "why": str(error),
            }
    texts = {name: f"{e.target}: {e.expression}" for name, e in found.ranking.expressions.items()}
    beyond = [
        texts.get(c.effect.name, c.effect.name)
        for c in found.candidates
        if c.probability > SURE
        and c.effect.name not in hidden.truth
        and not _is_formula(found, c.effect.name, hidden.formula[1])
    ]
    return {
        "size": dict(hidden.size),
        "truth": [*hidden.truth, *filter(None, (*hidden.formula, hidden.odd))],
        "verdict": found.verdict,
        "probability": round(found.answer_probability, 3),
        "told": [[texts.get(name, name) for name in names] for names in told(found)],
        "blamed": None if found.blamed is None else [found.blamed.kind, *found.blamed.runs],
        "right": _right(found, hidden),
        "beyond": beyond,
        "errors": [round(found.ladder[0].train_error, 2), round(found.ladder[-1].train_error, 2)],
        "seconds": round(time.process_time() - begin, 1),
    }


def _line(name: str, mine: Sequence[Record]) -> str:
    sure = sum(sure_and_wrong(r["verdict"], r["probability"], r["right"]) for r in mine)
    beyond = sum(bool(r["beyond"]) for r in mine)
    rates = rate(sum(r["right"] for r in mine), len(mine)) + rate(sure, len(mine))
    return f"{name:12}{len(mine):6d}{rates}{beyond:8d}{np.median([r.get('seconds', 0.0) for r in mine]):9.0f}"


def table(records: Sequence[Record]) -> str:
    """Rates of each family, of forced slip and of the eight together; below them what was said instead."""
    lines = [f"{'hidden':12}{'cases':>6}{'named or tied':>24}{'above 0.9 and wrong':>24}{'beyond':>8}{'CPU s':>9}"]
    for name in FAMILIES:
        if mine := [r for r in records if r["family"] == name]:
            lines.append(_line(name, mine))
    for name, families in (("forced slip", FORCED), ("the eight", EIGHT)):
        if mine := [r for r in records if r["family"] in families]:
            lines.append(_line(name, mine))
    for r in records:
        if not r["right"] or r["beyond"]:
            said = " | ".join(" + ".join(names) for names in r["told"]) or r.get("why") or str(r.get("blamed"))
            lines.append(
                f"  {r['family']} {r['number']} {r.get('size')}: {r['verdict']} {r['probability']:.2f}  {said}"
            )
    return "\n".join(lines)


def main() -> None:
    options = parser_of(__doc__ or "", "python -m tests.campaigns.papers_in_time", FAMILIES, cases=3).parse_args()
    options.families = options.families.replace("EIGHT", ",".join(EIGHT))
    print(table(resumed(options, str(options.seed), lambda family, number: one(family, number, options.seed))))


if __name__ == "__main__":
    main()
