"""What a run did, for drawing it: rows of the truth, what the controller said, and the shape of the ground."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil import paths
from terrapin_hil.arrays import Array
from terrapin_hil.reading import Section, parse_quantity
from terrapin_hil.scenario.scenario import read_scenario
from terrapin_tools.errors import UserError
from terrapin_tools.web.simulate.told import changes_of, course, described, judged

__all__ = ["ground_height", "run_signals"]


MOST = 3000  # rows: a picture every 10 ms for half a minute
SAID = {  # column -> signal of the telemetry
    "state": ("ACTUATE", "state"),
    "limiting": ("ACTUATE", "limiting"),
    "estimate": ("GROUND", "torque"),
    "estimate_sd": ("GROUND", "torque_sd"),
    "estimate_valid": ("GROUND", "valid"),
    "terrain": ("GROUND", "terrain"),
}
LARGEST_LOG = 150 << 20  # bytes of a log beyond which what the controller said is left out
SHOWN = (
    *("time", "position", "speed", "omega", "swing_angle", "slip", "contact_torque", "current", "voltage"),
    *("slope", "sinkage", "rut", "winding_temperature"),
)


def run_signals(folder: str | Path) -> dict[str, Any]:
    """Columns as lists, SI; `angle` is the shell's [rad]. UserError when the folder holds no run, or an empty one."""
    from terrapin_hil.messages import interface

    folder = Path(folder)
    try:
        text = (folder / "truth.csv").read_text(encoding="ascii")
        run = tomllib.loads((folder / "run.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"{folder.name}: {error}, expected a run's folder") from None
    head, _, rows = text.partition("\n")
    rows = rows[: rows.rfind("\n") + 1]  # a run that was killed may end within a row
    if not rows:
        raise UserError(f"{folder.name}: the run has not begun, expected some rows")
    table = np.loadtxt(rows.splitlines(), delimiter=",", ndmin=2)
    truth = dict(zip(head.split(","), table.T, strict=True))
    step = -(-len(table) // MOST)
    angle = np.concatenate(
        [[0.0], np.cumsum(0.5 * (truth["omega"][1:] + truth["omega"][:-1]) * np.diff(truth["time"]))]
    )
    columns = {name: truth[name][::step] for name in SHOWN if name in truth}
    columns["angle"] = angle[::step]
    description = interface()
    scenario = tomllib.loads(run["scenario"]["text"])
    said = _said(folder, columns["time"])
    columns.update(said)
    words = {name: {value: word for word, value in description.enums[name].items()} for name in ("state", "terrain")}
    return {
        "name": folder.name,
        "run": {key: value for key, value in run["run"].items() if key != "output_sha256"},
        "checks": run.get("checks", []),
        "judged": judged(len(run.get("checks", []))),
        "course": course(columns["time"], said["state"], words["state"]) if "state" in said else "",
        **_settings(run, scenario),
        "radius": parse_quantity(scenario.get("robot", {}).get("radius", 0.08), "m"),
        "words": words,
        "ground": ground_height(truth["position"], truth["slope"]),
        "segments": _segments(scenario),
        "faults": [_plain(fault) for fault in scenario.get("fault", [])],
        "columns": {name: _short(values) for name, values in columns.items()},
    }


def _settings(run: dict[str, Any], tables: dict[str, Any]) -> dict[str, Any]:
    """`settings`: the form as the run has it, None where no such scenario is shipped; `changes`: what differs from the
    one that is, in words."""
    name, seed = str(run["run"]["scenario"]), run["run"]["seed"]
    shipped = paths.SCENARIOS / f"{name}.toml"
    try:
        scenario = read_scenario(Section(tables, f"{name}.toml", run["scenario"]["text"]), name)
        before = tomllib.loads(shipped.read_text(encoding="utf-8"))
    except (OSError, UserError):
        return {"settings": None, "changes": []}
    changes = changes_of(tables, before)
    if seed != before.get("seed", 1):
        changes.append(f"seed {seed} (shipped {before.get('seed', 1)})")
    return {"settings": {**described(scenario, name), "seed": seed}, "changes": changes}


def _said(folder: Path, times: Array) -> dict[str, Array]:
    """What the controller said, held on the grid of times; NaN before it said anything."""
    from terrapin_hil.messages import interface
    from terrapin_tools.logs.candump import read, telemetry

    log = folder / "telemetry.log"
    if not log.is_file() or log.stat().st_size > LARGEST_LOG:
        return {}
    tables = telemetry(read(log), interface())
    found = {}
    for name, (message, signal) in SAID.items():
        if message not in tables:
            continue
        index = np.searchsorted(tables[message]["time"], times + 1e-9, side="right") - 1
        found[name] = np.where(index >= 0, tables[message][signal][np.maximum(index, 0)], np.nan)
    return found


def ground_height(position: Array, slope: Array, points: int = 400) -> dict[str, list[float]]:
    """Height [m] over the way [m] from the slope [rad] that was felt there, level where nobody was.

    >>> shape = ground_height(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.0, 0.1]))
    >>> shape["x"][0] < 0.0, shape["height"][-1] > 0.1
    (True, True)
    """
    order = np.argsort(position)
    x, angle = position[order], slope[order]
    grid = np.linspace(float(x[0]) - 1.0, float(x[-1]) + 1.0, points)
    steep = np.tan(np.interp(grid, x, angle))
    height = np.concatenate([[0.0], np.cumsum(0.5 * (steep[1:] + steep[:-1]) * np.diff(grid))])
    return {"x": _short(grid), "height": _short(height - np.interp(float(position[0]), grid, height))}


def _segments(scenario: dict[str, Any]) -> list[dict[str, Any]]:
    """Where which ground begins."""
    soil = scenario.get("soil", {}).get("name") or "soil"
    return [
        {"from": parse_quantity(segment.get("from", 0.0), "m"), "terrain": segment.get("terrain") or soil}
        for segment in scenario.get("path", [])
    ]


def _plain(fault: dict[str, Any]) -> dict[str, Any]:
    words = f"{fault.get('kind', '')} {fault.get('channel', '')}".strip()
    end = parse_quantity(fault["to"], "s") if "to" in fault else None
    return {"text": words, "begin": parse_quantity(fault.get("from", 0.0), "s"), "end": end}


def _short(values: Any) -> list[float]:
    """Six digits are more than a picture shows; null for what is not there."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in np.asarray(values).tolist()]  # type: ignore[misc]
