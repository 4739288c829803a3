"""Cases with a known answer: a design, hidden effects of a stated size, noise; written as a user would write them.

The size of an effect is the root mean square, over all rows, of what it changes in the channel where that is largest
in noise sd, before any parameter of the model takes part of it up. Noise is AR(1) within a run, normal, independent
between channels and runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tests.campaigns.designs import CHANNELS, UNITS, Design, design
from tests.campaigns.formulas import EQUATIONS, Foreign, predict

__all__ = ["CATALOGUE", "FOREIGN", "Drawn", "Hidden", "draw", "measure", "noise", "write", "write_table"]

Array = npt.NDArray[np.float64]
Random = np.random.Generator
PI = np.pi


@dataclass(frozen=True)
class Hidden:
    """How the campaigns draw one effect of the catalogue: its size parameter, the others, what it needs."""

    size: str
    signs: tuple[float, ...] = (1.0,)
    limit: float = 1e12  # of the size parameter
    shape: Mapping[str, tuple[float, float]] | None = None  # other parameters: range
    needs: tuple[str, ...] = ()  # roles that must be mapped
    reads: tuple[str, ...] = ()  # roles that it is a function of


CATALOGUE: Mapping[str, Mapping[str, Hidden]] = {
    "rolling_steady": {
        "speed_squared": Hidden("f_s", reads=("omega", "load")),
        "aerodynamic_drag": Hidden("cda", reads=("omega", "speed")),
        "slope": Hidden("gain", needs=("slope",), reads=("slope", "load")),
        "coulomb_friction": Hidden("da", (1.0, 1.0, -1.0), reads=("omega",)),
        "viscous_friction": Hidden("b", (1.0, 1.0, -1.0), reads=("omega",)),
        "stribeck": Hidden("a_s", shape={"omega_s": (1.0, 4.0)}, reads=("omega",)),
        "inertia": Hidden("j", needs=("acceleration",), reads=("acceleration",)),
        "shell_imbalance": Hidden("m_e", shape={"phase": (-PI, PI)}, needs=("angle",), reads=("angle",)),
        "cogging": Hidden("m_c", shape={"k": (2, 40), "phase": (-PI, PI)}, needs=("angle",), reads=("angle",)),
        "motor_heating": Hidden("a_t", limit=0.01, needs=("temperature",), reads=("temperature", "omega", "load")),
        "current_offset": Hidden("i_0", (1.0, -1.0), reads=("omega",)),
    },
    "sphere_contact": {
        "bulldozing": Hidden("scale", reads=("slip", "load")),
        "slip_sinkage": Hidden("xi1", shape={"xi2": (0.2, 0.5), "xi3": (1.2, 2.5)}, reads=("slip", "load")),
        "bearing_friction": Hidden("t_b", reads=("slip", "load")),
        "force_offset": Hidden("f_0", (1.0, -1.0), reads=("slip", "load")),
        "torque_gain": Hidden("g", (1.0, -1.0), 0.9, reads=("slip", "load")),
        "rate_effect": Hidden("m", (1.0, 1.0, -1.0), 2.0, needs=("speed",), reads=("speed",)),
        "multipass": Hidden("kappa", limit=3.0, needs=("pass",), reads=("pass",)),
        "moisture_cohesion": Hidden("c_w", needs=("moisture",), reads=("moisture",)),
        "rut_recovery": Hidden("lam", limit=0.9, reads=("slip", "load")),
    },
}
CATALOGUE = {**CATALOGUE, "wheel_contact": CATALOGUE["sphere_contact"]}

FOREIGN: Mapping[str, tuple[Foreign, ...]] = {
    "rolling_steady": (
        Foreign(
            "k*humidity*sign(omega)", "resistance", "humidity", lambda x, k: k * x["humidity"] * np.sign(x["omega"])
        ),
        Foreign("k*abs(omega)", "resistance", "omega", lambda x, k: k * np.abs(x["omega"])),
        Foreign("k*board_temp*omega", "resistance", "board_temp", lambda x, k: k * x["board_temp"] * x["omega"]),
        Foreign(
            "k*moisture*load*sign(omega)",
            "resistance",
            "moisture",
            lambda x, k: k * x["moisture"] * x["load"] * np.sign(x["omega"]),
        ),
        Foreign("k*exp(-time/3)", "current", "time", lambda x, k: k * np.exp(-x["time"] / 3.0)),
        Foreign(
            "k*sqrt(abs(omega))*sign(omega)",
            "resistance",
            "omega",
            lambda x, k: k * np.sqrt(np.abs(x["omega"])) * np.sign(x["omega"]),
        ),
    ),
    "sphere_contact": (
        Foreign("k*exp(-time/8)", "traction", "time", lambda x, k: k * np.exp(-x["time"] / 8.0)),
        Foreign("k*humidity", "torque", "humidity", lambda x, k: k * (x["humidity"] - 0.0)),
        Foreign("k*load*slip**2", "traction", "slip", lambda x, k: k * x["load"] * x["slip"] ** 2),
        Foreign("k*moisture", "torque", "moisture", lambda x, k: k * x["moisture"]),
        Foreign("k*slip", "traction", "slip", lambda x, k: k * x["slip"]),
    ),
    "equation:pipe": (
        Foreign("k*flow*abs(flow)", "dp", "flow", lambda x, k: k * x["flow"] * np.abs(x["flow"])),
        Foreign("k*oil_temp*flow", "dp", "oil_temp", lambda x, k: k * x["oil_temp"] * x["flow"]),
        Foreign("k*flow**3", "dp", "flow", lambda x, k: k * x["flow"] ** 3),
    ),
    "equation:carriage": (
        Foreign("k*sign(velocity)", "force", "velocity", lambda x, k: k * np.sign(x["velocity"])),
        Foreign(
            "k*velocity*abs(velocity)", "force", "velocity", lambda x, k: k * x["velocity"] * np.abs(x["velocity"])
        ),
        Foreign("k*humidity", "force", "humidity", lambda x, k: k * x["humidity"]),
    ),
    "equation:winding": (
        Foreign("k*oil_temp*current", "voltage", "oil_temp", lambda x, k: k * x["oil_temp"] * x["current"]),
        Foreign("k*sign(current)", "voltage", "current", lambda x, k: k * np.sign(x["current"])),
    ),
}
FOREIGN = {**FOREIGN, "wheel_contact": FOREIGN["sphere_contact"]}


@dataclass(frozen=True)
class Drawn:
    """A case and its answer. Everything in SI."""

    design: Design
    hidden: Mapping[str, Mapping[str, float]]  # effects of the catalogue that the data hold and the model lacks
    foreign: tuple[Foreign, float] | None
    size: float
    rho: float
    sigma: Mapping[str, float]  # true noise sd by channel
    known_sigma: bool
    clean: Mapping[str, Array]  # channels without noise
    measured: Mapping[str, Array]
    test: frozenset[int]  # runs held out

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(self.clean)

    @property
    def held_out(self) -> npt.NDArray[np.bool_]:
        return np.isin(self.design.run, sorted(self.test))

    def reads(self) -> set[str]:
        if self.foreign is not None:
            return {self.foreign[0].column}
        return {r for name in self.hidden for r in CATALOGUE[self.design.base][name].reads if r in self.design.columns}


def noise(run: npt.NDArray[np.int64], rho: float, random: Random) -> Array:
    """Unit variance, correlation rho from row to row, runs independent."""
    white = random.standard_normal(len(run))
    for row in range(1, len(run)):
        if run[row] == run[row - 1]:
            white[row] = rho * white[row - 1] + np.sqrt(1.0 - rho * rho) * white[row]
    return white


def draw(
    base: str,
    runs: int,
    rho: float,
    size: float,
    random: Random,
    effects: Sequence[str] | int = 0,
    foreign: bool = False,
    tied: str = "",
    long: bool = False,
) -> Drawn:
    """A case that hides the named effects (or as many of the catalogue), or one foreign term. A draw in which an effect
    cannot reach its size within its physical limits is repeated."""
    for _ in range(60):
        found = _attempt(base, runs, rho, size, random, effects, foreign, tied, long)
        if found is not None:
            return found
    raise RuntimeError(f"no case of {base} with {effects} at {size} noise sd in 60 draws")


def _attempt(
    base: str,
    runs: int,
    rho: float,
    size: float,
    random: Random,
    effects: Sequence[str] | int,
    foreign: bool,
    tied: str,
    long: bool,
) -> Drawn | None:
    library = CATALOGUE.get(base, {})
    if isinstance(effects, int):
        effects = [str(name) for name in random.choice(sorted(library), effects, replace=False)] if effects else []
    needs = {role for name in effects for role in library[name].needs}
    made = design(base, runs, random, needs, tied, long)
    _as_written(made, random)
    term = None
    if foreign:
        choices = FOREIGN[base]
        term = choices[int(random.integers(len(choices)))]
    constants = made.true_constants()
    plain = predict(base, constants, made.inputs(), {}, None)
    if not all(np.isfinite(v).all() for v in plain.values()):
        return None
    share = {"sinkage": 0.02, "traction": 0.012, "torque": 0.012}
    sigma = {}
    for channel, values in plain.items():
        typical = share.get(channel, 0.01) * random.uniform(0.5, 2.0)
        sigma[channel] = float(f"{typical * np.sqrt(np.mean(values**2)):.3g}")
    hidden: dict[str, dict[str, float]] = {}
    for name in effects:
        own = {}
        for key, (low, high) in (library[name].shape or {}).items():
            own[key] = float(round(random.uniform(low, high))) if key == "k" else float(random.uniform(low, high))
        sign = float(random.choice(library[name].signs))
        key = library[name].size
        amount = _sized(
            made,
            plain,
            sigma,
            size,
            library[name].limit,
            lambda a: ({name: {key: sign * a, **own}}, None),  # noqa: B023
        )
        if amount is None:
            return None
        hidden[name] = {library[name].size: sign * amount, **own}
    pair = None
    if term is not None:
        amount = _sized(made, plain, sigma, size, 1e12, lambda a: ({}, (term, a)))
        if amount is None:
            return None
        pair = (term, amount)
    clean = _predict(made, hidden, pair)
    if not all(np.isfinite(v).all() for v in clean.values()):
        return None
    known = bool(random.uniform() < 0.75)
    measured = {c: clean[c] + sigma[c] * noise(made.run, rho, random) for c in clean}
    test = frozenset(int(r) for r in random.choice(made.runs, max(1, round(0.25 * made.runs)), replace=False))
    return Drawn(made, hidden, pair, size, rho, sigma, known, clean, measured, test)


def _predict(
    made: Design, hidden: Mapping[str, Mapping[str, float]], foreign: tuple[Foreign, float] | None
) -> dict[str, Array]:
    """Effects of the catalogue read mapped roles; a foreign term may read any column."""
    inputs = made.inputs()
    if foreign is None:
        return predict(made.base, made.true_constants(), inputs, hidden, None)
    term = foreign[0]
    wrapped = replace(term, amount=lambda _, k: term.amount(made.columns, k))
    return predict(made.base, made.true_constants(), inputs, hidden, (wrapped, foreign[1]))


def _sized(
    made: Design, plain: Mapping[str, Array], sigma: Mapping[str, float], size: float, limit: float, of
) -> float | None:  # type: ignore[no-untyped-def]
    """The amount at which the change's rms is `size` noise sd in the loudest channel; None beyond `limit`."""

    def rms(amount: float) -> float:
        changed = _predict(made, *of(amount))
        worst = [float(np.sqrt(np.mean(((changed[c] - plain[c]) / sigma[c]) ** 2))) for c in plain]
        return max(worst) if np.isfinite(worst).all() else np.inf

    amount = min(1e-4, limit)
    for _ in range(60):  # the change is nearly proportional to the amount
        found = rms(amount)
        if abs(found / size - 1.0) < 1e-3:
            return amount
        if found < size and amount >= limit:
            return None
        factor = size / found if np.isfinite(found) and found > 0.0 else 0.1 if found > size else 100.0
        amount = min(amount * float(np.clip(factor, 0.05, 100.0)), limit)
    return None


def measure(made: Design, like: Drawn, random: Random) -> tuple[dict[str, Array], dict[str, Array]]:
    """Clean and measured channels of another design with the effects and the noise of a drawn case."""
    clean = _predict(made, like.hidden, like.foreign)
    return clean, {c: clean[c] + like.sigma[c] * noise(made.run, like.rho, random) for c in clean}


def _digits(values: Array) -> Array:
    """As a file of seven digits holds them."""
    return np.array([float(f"{v:.7g}") for v in values])


def _as_written(made: Design, random: Random) -> None:
    """Chooses each column's unit, and rounds columns to what the file will hold: roles are exact by contract."""
    units = {}
    for name in (*made.mapped, *CHANNELS.get(made.base, ())):
        if made.base.startswith("equation"):
            continue
        choices = UNITS.get(name, (("1", 1.0, 0.0),))
        units[name] = choices[int(random.integers(len(choices)))]
    made.notes["units"] = units
    for name, values in made.columns.items():
        _, factor, offset = units.get(name, ("", 1.0, 0.0))
        made.columns[name] = _digits((values - offset) / factor) * factor + offset
    made.constants = {name: float(f"{value:.7g}") for name, value in made.constants.items()}


NAMES = {  # what a workshop's log calls them
    "omega": "w_shell",
    "acceleration": "alpha",
    "angle": "enc_pos",
    "load": "payload_force",
    "speed": "v_axle",
    "slope": "incl",
    "temperature": "winding_temp",
    "time": "clock",
    "current": "i_motor",
    "traction": "F_x",
    "torque": "T_shaft",
    "sinkage": "depth",
    "slip": "slip_set",
    "pass": "n_pass",
    "moisture": "wc",
    "voltage": "u_mot",
}
TEXT = {
    "radius": ("mm", 1e-3),
    "drive_radius": ("mm", 1e-3),
    "coulomb": ("mN m", 1e-3),
    "cohesion": ("kPa", 1e3),
    "unit_weight": ("kN/m^3", 1e3),
    "width": ("mm", 1e-3),
}


def write_table(path: Path, run: Sequence[str], columns: Mapping[str, Array], digits: int = 9) -> None:
    """A table of rows that belong to runs, as a logger writes it: columns (rows,) with so many significant digits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [
        ",".join([name, *(f"{value:.{digits}g}" for value in row)])
        for name, row in zip(run, zip(*columns.values(), strict=True), strict=True)
    ]
    path.write_text("\n".join([",".join(["run", *columns]), *rows]) + "\n", encoding="utf-8")


def write(drawn: Drawn, folder: Path, extra: str = "") -> Path:
    """The case folder; `extra` is appended to case.toml."""
    made = drawn.design
    equation = made.base.startswith("equation")
    prefix = "r" if made.base == "rolling_steady" else "p"
    names = [f"{prefix}{i + 1:02d}" for i in range(made.runs)]
    lines = ["[case]", 'title = "campaign"', "", "[model]", f'base = "{made.base.partition(":")[0]}"', "effects = []"]
    if equation:
        lines += ["[model.equation]", *(f'{c} = "{f}"' for c, f in EQUATIONS[made.base].formulas.items())]
    lines += ["", "[parameters]"]
    lines += [f'{name} = "{value}"' for name, value in made.options.items()]
    for name, value in made.constants.items():
        unit, factor = TEXT.get(name, ("", 1.0))
        lines.append(f'{name} = "{value / factor!r} {unit}"' if unit else f"{name} = {value!r}")
    lines += ["", "[fit]"]
    for name, (_, start, low, high) in made.fitted.items():
        lines.append(f"{name} = {{ value = {start!r}, min = {low!r}, max = {high!r} }}")
    train = [names[i] for i in range(made.runs) if i not in drawn.test]
    test = [names[i] for i in range(made.runs) if i in drawn.test]
    lines += ["", "[data]", 'files = ["runs.csv"]', 'run = "run"']
    lines += [f"train = {train}".replace("'", '"'), f"test = {test}".replace("'", '"'), "", "[data.columns]"]
    units: Mapping[str, tuple[str, float, float]] = made.notes["units"]  # type: ignore[assignment]
    table: dict[str, list[str]] = {"run": [names[i] for i in made.run]}
    own = EQUATIONS[made.base].units if equation else {}
    for name in (*made.mapped, *drawn.channels):
        unit, factor, offset = units.get(name, (own.get(name, "1"), 1.0, 0.0))
        column = name if equation else NAMES[name]
        values = drawn.measured[name] if name in drawn.measured else made.columns[name]
        table[column] = [f"{v:.9g}" for v in (values - offset) / factor]
        sigma = ""
        if name in drawn.sigma and drawn.known_sigma:
            sigma = f", sigma = {drawn.sigma[name] / factor:.6g}"
        lines.append(f'{name} = {{ column = "{column}", unit = "{unit}"{sigma} }}')
    for name, values in made.columns.items():
        if name not in made.mapped:
            table[f"{name}_log" if name in NAMES else name] = [f"{v:.7g}" for v in values]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.toml").write_text("\n".join([*lines, extra]) + "\n", encoding="utf-8")
    rows = [",".join(table)] + [",".join(row) for row in zip(*table.values(), strict=True)]
    (folder / "runs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder
