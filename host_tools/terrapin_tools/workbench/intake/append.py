"""New runs for a case (`terrapin case append`): how well the model as it was predicts them, then the fit with them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from terrapin_hil.arrays import Mask
from terrapin_hil.units import behind
from terrapin_tools.errors import UserError
from terrapin_tools.progress import step
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import Case, load_case, parse_case
from terrapin_tools.workbench.compare.comparison import Analysis, analyse, measured
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.sentences import change, in_sd, number
from terrapin_tools.workbench.story.terminal import tell
from terrapin_tools.workbench.story.told import told

__all__ = ["append"]

SHOWN = 8  # runs whose error is told
BY_CHANCE = 4  # rows of a run that may have the very numbers of another's


def append(folder: Path, file: Path, seed: int = 0) -> tuple[dict[str, Any], str]:
    """Copy a file of new runs into a case and fit the model with them. Returns JSON and words.

    First the model is judged as it was: `predicted` holds its error on the new runs, which no fit of it has seen. Where
    case.toml lists both training and held-out runs, the new ones are shared out as runs are without lists: the 5th,
    10th, ... by name is held out.

    Raises
    ------
    UserError : the file does not fit the case, or has a run that the case has already; nothing is written.
    """
    begin = time.monotonic()
    present = load_case(folder)
    if not file.is_file():
        raise UserError(f"{file}: no such file")
    grown = parse_case(folder, _listing(present.text, str(file.resolve()), []))
    new = np.arange(grown.rows) >= present.rows
    runs = sorted({grown.run_names[i] for i in grown.run[new]})
    known = sorted(set(runs) & set(present.run_names))
    if known:
        raise UserError(f"{file}: run {known[0]!r} is in the case already, expected new names of runs")
    if not runs:
        raise UserError(f"{file}: found no row without a gap, expected at least one")
    _refuse_copies(file, grown, new)
    with step("the model as it was, and the fit with the new runs"):
        before = analyse(present, seed)
        predicted = _predicted(before, grown, new)
        after = analyse(parse_case(folder, _listing(present.text, str(file.resolve()), runs)), seed)
    name = _free_name(folder, file)
    try:
        shutil.copyfile(file, folder / name)
        history.rewrite(folder, present.text, _listing(present.text, name, runs))
    except (OSError, UserError):
        (folder / name).unlink()
        raise
    story = replace(told(after), seconds=time.monotonic() - begin)
    old, fresh = (
        {"train_error": rung.train_error, "heldout_error": rung.heldout_error}
        for rung in (before.ladder[-1], after.ladder[-1])
    )
    said = {**answer(story), "appended": runs, "predicted": predicted, "before": old, "after": fresh}
    history.remember(folder, "appended", runs, said)
    done = f"Appended {len(runs)} run{'s' * (len(runs) > 1)} of {file.name} to {folder / 'case.toml'}."
    refit = change(told(before).ladder[-1], story.ladder[-1])
    return said, "\n".join([done, *_words(predicted, before), refit, "", tell(story)])


def _refuse_copies(file: Path, grown: Case, new: Mask) -> None:
    """UserError for a run that is another's copy: repeats without any scatter would be taken for the noise."""
    channels = np.stack([*grown.channels.values()])
    known: dict[bytes, str] = {}
    for i in dict.fromkeys([*grown.run[~new].tolist(), *grown.run[new].tolist()]):
        values = channels[:, grown.run == i]
        twin = known.setdefault(values.tobytes(), grown.run_names[i])
        if twin != grown.run_names[i] and new[grown.run == i].all() and values.shape[1] > BY_CHANCE:
            raise UserError(f"{file}: run {grown.run_names[i]!r} has the very numbers of {twin!r}, expected new ones")


def _listing(text: str, file: str, runs: Sequence[str]) -> str:
    """case.toml with the file in it, and the runs where both kinds of runs are listed."""
    document = tomlkit.parse(text)
    data: Any = document["data"]
    data["files"].append(file)
    if runs and "train" in data and "test" in data:
        held_out = list(runs[4::5])
        for key, names in (("train", [run for run in runs if run not in held_out]), ("test", held_out)):
            data[key].extend(names)
    return tomlkit.dumps(document)


def _free_name(folder: Path, file: Path) -> str:
    """A name in the folder, taken by an empty file: another command that appends at this moment takes another one."""
    name, count = file.name, 1
    while True:
        try:
            (folder / name).touch(exist_ok=False)
        except FileExistsError:
            count += 1
            name = f"{file.stem}_{count}{file.suffix}"
        else:
            return name


def _predicted(before: Analysis, grown: Case, new: Mask) -> dict[str, Any]:
    """Errors of the old fit on the new rows: in noise sd, by run, and by channel in its unit."""
    model = Model.of(grown)
    off = measured(model, new) - model.bind(grown.inputs, new).predict(before.fit.theta)
    scaled = off / before.noise.sigma[:, None]
    run = grown.run[new]
    return {
        "error": _rms(scaled),
        "heldout_error": before.ladder[-1].heldout_error,
        "runs": {grown.run_names[i]: _rms(scaled[:, run == i]) for i in np.unique(run)},
        "channels": {
            name: {"rmse": _rms(one), "unit": grown.units[name] or "1"}
            for name, one in zip(model.channels, off, strict=True)
        },
    }


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _words(predicted: dict[str, Any], before: Analysis) -> list[str]:
    held = predicted["heldout_error"]
    beside = f"; its own held-out runs: {in_sd(held)}" if held is not None else ""
    channels = ", ".join(
        f"{name} {number(one['rmse'])}{behind(one['unit'])}" for name, one in predicted["channels"].items()
    )
    worst = sorted(predicted["runs"].items(), key=lambda one: -one[1])
    more = f" and {len(worst) - SHOWN} more" if len(worst) > SHOWN else ""
    return [
        f"The model as it was predicted them to {in_sd(predicted['error'])} noise sd (rms: {channels}){beside}.",
        f"  by run: {', '.join(f'{run} {in_sd(error)}' for run, error in worst[:SHOWN])}{more}",
    ]
