"""Cases with a hidden effect and its answer, from the formulas of the contract (docs/cases.md). Used by the campaigns.

Rows are steady rolling (runs of 10 to 30 rows, one load and speed a run, both directions) or a contact rig (runs of
three repeats at one setting). Sizes are the effect's root mean square in noise sd, in the channel where it is loudest.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.workbench.bases import CHANNELS, ROLES
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import Analysis, predict
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["CONTACT", "ROLLING", "Made", "confounded", "make", "unreached", "without_noise"]

Array = npt.NDArray[np.float64]

ROLLING = (
    *("speed_squared", "aerodynamic_drag", "slope", "coulomb_friction", "viscous_friction", "stribeck"),
    *("inertia", "shell_imbalance", "cogging", "motor_heating", "current_offset"),
)
CONTACT = (
    *("bulldozing", "slip_sinkage", "bearing_friction", "force_offset", "torque_gain"),
    *("rate_effect", "multipass", "moisture_cohesion", "rut_recovery"),
)
HIDDEN = {  # (target, expression, column): no effect of the catalogue
    "rolling_steady": (
        ("resistance", "k*humidity*sign(omega)", "humidity"),
        ("resistance", "k*abs(omega)", "omega"),
        ("resistance", "k*omega**3", "omega"),
        ("resistance", "k*sqrt(abs(omega))*sign(omega)", "omega"),
        ("resistance", "k*moisture*load*sign(omega)", "moisture"),
        ("resistance", "k*board_temp*omega", "board_temp"),
        ("current", "k*exp(-time/3)", "time"),
        ("resistance", "k*(temperature-25)*sign(omega)", "temperature"),
    ),
    "sphere_contact": (
        ("traction", "k*exp(-time/8)", "time"),
        ("torque", "k*humidity", "humidity"),
        ("traction", "k*load*slip**2", "slip"),
        ("torque", "k*room_temp", "room_temp"),
        ("traction", "k*slip", "slip"),
    ),
}


@dataclass(frozen=True)
class Made:
    """A case and its answer. `size` in noise sd."""

    case: Case
    truth: tuple[str, ...]
    column: str  # of a hidden expression, else ""
    sigma: Mapping[str, float]
    rho: float
    size: float
    theta: Mapping[str, float]  # true parameters by key
    library: Mapping[str, Effect]


def _rolling(random: np.random.Generator, runs: int, confound: str) -> tuple[dict[str, Array], str, list[str]]:
    columns: dict[str, list[Array]] = {}
    loads = random.uniform(15, 35) * np.array([1.0, 1.7, 2.4])
    tilted = random.uniform() < 0.5
    speeds = random.permutation(np.linspace(1.0, random.uniform(8, 12), runs))
    for run in range(runs):
        rows = int(random.integers(10, 31))
        direction = 1.0 if confound == "direction" else random.choice([-1.0, 1.0])
        time = np.cumsum(random.uniform(0.25, 0.6, rows))
        omega = direction * speeds[run] * (1 + 0.015 * random.standard_normal(rows))
        put = {
            "run": np.full(rows, run),
            "time": time,
            "omega": omega,
            "acceleration": 0.2 * random.standard_normal(rows),
            "angle": np.cumsum(omega * np.diff(time, prepend=0.0)),
            "slope": (random.normal(0, 0.05) if tilted else 0.0) + 1e-4 * random.standard_normal(rows),
            "temperature": random.uniform(22, 46) + random.uniform(0.0, 0.4) * time,
            "load": np.full(rows, random.choice(loads)),
            "moisture": random.uniform(0.005, 0.14) + 0.001 * random.standard_normal(rows),
            "humidity": random.uniform(30, 70) + 0.3 * random.standard_normal(rows),
            "board_temp": 31 + random.uniform(0, 6) + 0.1 * random.standard_normal(rows),
            "battery_voltage": 12.5 - 0.07 * run + 0.012 * random.standard_normal(rows),
        }
        slip = random.uniform(0.0, 0.25)
        put["speed"] = omega * 0.08 * (1.0 - slip)
        for name, values in put.items():
            columns.setdefault(name, []).append(np.asarray(values, dtype=float))
    data = {name: np.concatenate(values) for name, values in columns.items()}
    known = {
        "radius": random.uniform(0.065, 0.095),
        "drive_radius": random.uniform(0.015, 0.023),
        "torque_constant": random.uniform(0.08, 0.13),
        "coulomb": random.uniform(0.008, 0.016),
        "viscous": random.uniform(0.9e-3, 1.3e-3),
    }
    data["speed"] *= known["radius"] / 0.08
    mapped = ["time", "omega", "acceleration", "angle", "slope", "temperature", "load", "moisture", "speed"]
    dropped = ["time", "acceleration", "angle", "slope", "temperature", "moisture", "speed"]
    mapped = [m for m in mapped if m not in dropped or random.uniform() < 0.75]
    if confound == "load":  # speed squared and the drag of the air are the same where load and slip stay constant
        mapped = [m for m in mapped if m not in ("load", "speed")]
        known["load"] = random.uniform(18, 30)
        data["load"][:] = known["load"]
    text = "[parameters]\n" + "".join(f"{k} = {v:.6g}\n" for k, v in known.items())
    text += "[fit]\nf_o = { value = 0.05, min = 0.0, max = 0.5 }\n"
    return data, text, mapped


def _contact(
    random: np.random.Generator, runs: int, confound: str, stress: str
) -> tuple[dict[str, Array], str, list[str]]:
    loads = random.uniform(100, 200) * np.array([1.0, 1.5, 2.2])
    slips = random.permutation(np.linspace(0.1, 0.85, runs))
    wet = random.permutation(np.linspace(0.01, 0.13, runs))
    columns: dict[str, list[Array]] = {}
    for run in range(runs):
        number = float(random.integers(1, 5)) if confound != "pass" else float(1 + run % 8)
        speed = random.choice([0.02, 0.05, 0.1, 0.2, 0.3]) if confound != "pass" else 0.06 * number**0.86
        put = {
            "run": run,
            "slip": round(slips[run], 3),
            "load": round(random.choice(loads), 1),
            "speed": speed,
            "pass": number,
            "moisture": round(wet[run], 3),
            "time": np.sort(random.uniform(1, 50, 3)),
            "humidity": 45 + 4 * random.standard_normal(3),
            "room_temp": 21 + 0.2 * random.standard_normal(3),
            "rig_voltage": 24 + 0.1 * random.standard_normal(3),
        }
        for name, values in put.items():
            columns.setdefault(name, []).append(np.broadcast_to(np.asarray(values, dtype=float), (3,)))
    data = {name: np.concatenate(values) for name, values in columns.items()}
    known = {
        "radius": random.uniform(0.15, 0.24),
        "n": random.uniform(0.95, 1.1),
        "cohesion": random.uniform(300, 1200),
        "c1": random.uniform(0.16, 0.21),
        "c2": random.uniform(0.28, 0.34),
        "unit_weight": random.uniform(15e3, 20e3),
        "n_c": 20.0,
        "n_gamma": 6.0,
        "shear_modulus": random.uniform(0.012, 0.022),
    }
    mapped = ["slip", "load", "speed", "pass", "moisture", "time"]
    mapped = [m for m in mapped if m in ("slip", "load") or random.uniform() < 0.75]
    if confound == "pass":
        mapped = ["slip", "load", "speed", "pass", "moisture", "time"]
    text = f'[parameters]\nstress = "{stress}"\n' + "".join(f"{k} = {v:.6g}\n" for k, v in known.items())
    text += "[fit]\nk_s = { value = 800000.0, min = 20000.0, max = 20000000.0 }\n"
    text += "friction_angle = { value = 0.6, min = 0.35, max = 0.9 }\n"
    return data, text, mapped


UNITS = {
    **ROLES,
    **CHANNELS,
}
TRUTH = {  # parameters other than an effect's size: how they are drawn
    "stribeck": {"omega_s": (1.0, 4.0)},
    "slip_sinkage": {"xi2": (0.2, 0.5), "xi3": (1.2, 2.5)},
    "shell_imbalance": {"phase": (-pi, pi)},
    "cogging": {"k": (2, 40), "phase": (-pi, pi)},
}
NEGATIVE = ("coulomb_friction", "viscous_friction", "current_offset", "force_offset", "torque_gain", "bearing_friction")


def make(
    base: str,
    hidden: tuple[str, ...],
    runs: int,
    rho: float,
    size: float,
    random: np.random.Generator,
    known_sigma: bool = True,
    confound: str = "",
    expression: tuple[str, str, str] | None = None,
) -> Made | None:
    """One case; None when the columns that the effects need are not mapped, or the effect has no influence."""
    rolling = base == "rolling_steady"
    stress = "linear" if random.uniform() < 0.7 else "full"
    data, text, mapped = _rolling(random, runs, confound) if rolling else _contact(random, runs, confound, stress)
    channels = ["current"] if rolling else ["traction", "torque", "sinkage"]
    count = len(data["run"])
    for channel in channels:
        data[channel] = np.zeros(count)
    held = sorted(random.choice(runs, max(1, round(0.25 * runs)), replace=False))
    names = [f"r{i:02d}" for i in range(runs)]
    text = f'[case]\ntitle = "campaign"\n[model]\nbase = "{base}"\neffects = []\n' + text
    text += f'[data]\nfiles = ["runs.csv"]\nrun = "run"\ntest = {[names[i] for i in held]}\n'.replace("'", '"')
    text += "[data.columns]\n"
    for name in (*mapped, *channels):
        text += f'{name} = {{ column = "{name}", unit = "{UNITS[name]}" }}\n'
    unmapped = {n for n in data if n in UNITS and n not in (*mapped, *channels)}
    columns = [n for n in data if n not in unmapped]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "case.toml").write_text(text, encoding="utf-8")
        rows = [",".join(columns)]
        for i in range(count):
            rows.append(",".join(names[int(data[n][i])] if n == "run" else f"{data[n][i]:.6g}" for n in columns))
        (path / "runs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        case = load_case(path)
    return _measure(case, hidden, expression, random, rho, size, known_sigma)


def _measure(
    case: Case,
    hidden: tuple[str, ...],
    expression: tuple[str, str, str] | None,
    random: np.random.Generator,
    rho: float,
    size: float,
    known_sigma: bool,
) -> Made | None:
    library = dict(case.library)
    if expression is not None:
        target, text, _ = expression
        library["hidden"] = Effect("hidden", "", "", "", (), (Parameter("k", "1", 0.0),), (), text, target)
    names = (*hidden, "hidden") if expression is not None else hidden
    model = Model.of(case, ())
    for name in names:
        if name not in library or case.missing_role(library[name]) is not None:
            return None
        model = model.having(library[name])
    from terrapin_hil.physics.expression import parse

    if expression is not None and not parse(expression[1]).names - {"k"} <= set(case.inputs):
        return None
    theta = model.start.copy()
    for i, fitted in enumerate(model.fitted):
        if fitted.effect is None:
            drawn = {"f_o": (0.04, 0.12), "k_s": (4e5, 1.2e6), "friction_angle": (0.58, 0.7)}[fitted.name]
            theta[i] = random.uniform(*drawn)
        elif fitted.name in TRUTH.get(fitted.effect, {}):
            theta[i] = random.uniform(*TRUTH[fitted.effect][fitted.name])
            if fitted.whole:
                theta[i] = round(theta[i])
    bound = model.bind(case.inputs)
    first = {name: next(i for i, f in enumerate(model.fitted) if f.effect == name) for name in names}
    absent = theta.copy()
    for at in first.values():
        absent[at] = 0.0
    plain = bound.predict(absent)
    share = {"sinkage": 0.02, "traction": 0.012, "torque": 0.012, "current": 0.01}
    sigma = {
        c: share[c] * random.uniform(0.6, 1.6) * float(np.sqrt(np.mean(plain[i] ** 2)))
        for i, c in enumerate(model.channels)
    }
    scale = np.array([sigma[c] for c in model.channels])[:, None]
    for name, at in first.items():
        theta[at] = _sized(bound, absent, at, size, scale, random, name)
        if not np.isfinite(theta[at]):
            return None
    predicted = bound.predict(theta)
    if not np.isfinite(predicted).all():
        return None
    runs = Runs(case.run, len(model.channels))
    noise = runs.draw(random, 1, Node(1.0, rho, 0.0, 0.0, 1.0)).reshape(len(model.channels), case.rows)
    values = predicted + scale * noise
    final = replace(
        case,
        channels={c: values[i] for i, c in enumerate(model.channels)},
        sigma={c: (float(f"{sigma[c]:.3g}") if known_sigma else None) for c in model.channels},
    )
    return Made(
        final,
        hidden,
        expression[2] if expression is not None else "",
        sigma,
        rho,
        size,
        {f.key: float(v) for f, v in zip(model.fitted, theta, strict=True)},
        library,
    )


def without_noise(made: Made) -> tuple[Model, Array]:
    """The model with what is hidden in it, a formula of no catalogue too, and what it predicts: (channels, rows)."""
    model = Model.of(made.case, made.truth)
    if made.column:
        model = model.having(made.library["hidden"])
    theta = np.array([made.theta[fitted.key] for fitted in model.fitted])
    return model, model.bind(made.case.inputs).predict(theta)


def unreached(analysis: Analysis, true: Array, sigma: Array) -> float:
    """What the present model, as it is fitted, leaves of a case without noise: squared, in noise sd, summed.

    true : (channels, rows of the case). sigma : (channels,), of the noise.
    """
    gap = true[:, analysis.rows] - predict(analysis.fit, analysis.rows)
    return float(((gap / sigma[:, None]) ** 2).sum())


def _sized(bound, absent: Array, at: int, size: float, scale: Array, random: np.random.Generator, name: str) -> float:  # type: ignore[no-untyped-def]
    """The effect's size parameter at which its rms is `size`; NaN when no size within the bounds reaches it."""
    model = bound.model
    sign = -1.0 if name in NEGATIVE and random.uniform() < 0.3 and model.lower[at] < 0 else 1.0
    plain = bound.predict(absent)
    low, high = 0.0, 1e-9
    limit = min(abs(model.upper[at] if sign > 0 else model.lower[at]), 1e9)

    def rms(value: float) -> float:
        moved = absent.copy()
        moved[at] = sign * value
        change = (bound.predict(moved) - plain) / scale
        return float(np.sqrt((change * change).mean(axis=1).max())) if np.isfinite(change).all() else np.inf

    while rms(high) < size:
        low, high = high, high * 4.0
        if low >= limit:
            return float("nan")
    high = min(high, limit)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rms(middle) < size else (low, middle)
    return sign * high if rms(high) > 0.9 * size else float("nan")


def confounded(
    random: np.random.Generator, runs: int, rho: float, size: float
) -> tuple[Made | None, set[frozenset[str]]]:
    """A case that cannot tell two effects apart, and the two."""
    if random.uniform() < 0.5:
        hidden = str(random.choice(["speed_squared", "aerodynamic_drag"]))
        pair = {frozenset(["speed_squared"]), frozenset(["aerodynamic_drag"])}
        return make("rolling_steady", (hidden,), runs, rho, size, random, confound="load"), pair
    hidden = str(random.choice(["rate_effect", "multipass"]))
    pair = {frozenset(["rate_effect"]), frozenset(["multipass"])}
    return make("sphere_contact", (hidden,), max(runs, 16), rho, size, random, confound="pass"), pair
