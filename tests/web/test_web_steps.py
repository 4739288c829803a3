"""Back and forward: after any change by a command case.toml is the one of before, byte for byte."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case import history
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.changes import hold_out, set_constant, without_own
from terrapin_tools.workbench.files.writing import copy_example
from terrapin_tools.workbench.story.change import carry_out, with_effects, without_effect


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """An example with a BOM and line ends of another system, which a change must not lose."""
    folder = tmp_path / "case"
    copy_example("heated_motor", folder)
    text = (folder / "case.toml").read_bytes().replace(b"\n", b"\r\n")
    (folder / "case.toml").write_bytes(b"\xef\xbb\xbf" + text)
    return folder


def raw(folder: Path) -> bytes:
    return (folder / "case.toml").read_bytes()


def test_every_kind_of_change_and_back(case: Path) -> None:
    """Added, held out, set, removed; then all the way back and forward again."""
    stages = [raw(case)]
    found = load_case(case)
    constant = next(iter(found.parameters))
    effect = next(name for name in found.library if found.missing_role(found.library[name]) is None)
    changes = [
        ("held out", lambda c: hold_out(c.text, c.run_names[:1], c.run_names)),
        ("added", lambda c: with_effects(c, [effect], {})),
        ("removed", lambda c: without_effect(c, effect)),
        ("set", lambda c: set_constant(c.text, constant, f"{found.parameters[constant] * 1.01:.9g}")),
    ]
    pasts = [history.history(case)]
    for action, made in changes:
        present = load_case(case)
        carry_out(present, made(present), action, [action], 0)
        stages.append(raw(case))
        pasts.append(history.history(case))
    assert len(set(stages)) == len(stages) - 1  # without what was added and removed again it is what it was
    assert history.steps(case) == {"undo": 4, "redo": 0}
    for place in (3, 2, 1, 0):
        history.step(case, "undo")
        assert raw(case) == stages[place]
        assert history.history(case) == pasts[place]
    with pytest.raises(UserError, match="nothing to undo"):
        history.step(case, "undo")
    for place in (1, 2, 3, 4):
        history.step(case, "redo")
        assert raw(case) == stages[place]
        assert history.history(case) == pasts[place]
    with pytest.raises(UserError, match="nothing to redo"):
        history.step(case, "redo")


def test_a_new_change_ends_the_way_forward(case: Path) -> None:
    first = raw(case)
    for number in (1, 2):
        text = load_case(case).text
        history.rewrite(case, text, text + f"# {number}\r\n")
    history.step(case, "undo")
    text = load_case(case).text
    history.rewrite(case, text, text + "# 3\r\n")
    assert history.steps(case) == {"undo": 2, "redo": 0}
    history.step(case, "undo")
    history.step(case, "undo")
    assert raw(case) == first


def test_a_change_that_is_refused_takes_no_step_away(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a full disk the way forward was gone, though nothing was changed."""
    monkeypatch.setattr(history, "VERSIONS_LIMIT", 2)
    for number in (1, 2, 3):
        text = load_case(case).text
        history.rewrite(case, text, text + f"# {number}\r\n")
    history.step(case, "undo")
    before, text = history.steps(case), load_case(case).text
    with pytest.raises(UserError, match="changed since it was read"):
        history.rewrite(case, text + "# of somebody else\r\n", text + "# 4\r\n")
    assert history.steps(case) == before == {"undo": 1, "redo": 1}


@pytest.mark.parametrize("damaged", [b"", b"[model\n", b"\xff\xfe[\0"], ids=["empty", "no TOML", "no text"])
def test_a_case_that_an_editor_damaged_can_be_stepped_back(case: Path, damaged: bytes) -> None:
    from terrapin_tools.commands.case import redo, undo

    text = load_case(case).text
    history.rewrite(case, text, text + "# 1\r\n")
    (case / "case.toml").write_bytes(damaged)
    undo(case)
    assert load_case(case).text == text
    redo(case)  # what the editor left is not lost either
    assert raw(case) == damaged


def test_a_change_of_what_an_editor_damaged_meanwhile_is_refused(case: Path) -> None:
    text = load_case(case).text
    (case / "case.toml").write_bytes(b"\xff\xfe[\0")
    with pytest.raises(UserError, match="changed since it was read"):
        history.rewrite(case, text, text + "# 1\r\n")
    assert raw(case) == b"\xff\xfe[\0"


def test_a_step_that_finds_no_room_costs_no_older_one(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "VERSIONS_LIMIT", 2)
    for number in (1, 2):
        text = load_case(case).text
        history.rewrite(case, text, text + f"# {number}\r\n")

    def full(path: Path, text: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(history, "write_whole", full)
    text = load_case(case).text
    history.rewrite(case, text, text + "# 3\r\n")
    assert history.steps(case) == {"undo": 2, "redo": 0}


def test_what_was_cancelled_is_no_step(case: Path) -> None:
    """A job that was cancelled after the version was kept: case.toml is the same, and there is nothing to undo."""
    first = raw(case)
    history._push(case, "undo", first)
    assert history.steps(case)["undo"] == 0
    with pytest.raises(UserError, match="nothing to undo"):
        history.step(case, "undo")
    assert raw(case) == first


def test_versions_have_a_bound(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "VERSIONS_LIMIT", 3)
    for number in range(6):
        text = load_case(case).text
        history.rewrite(case, text, text + f"# {number}\r\n")
    assert history.steps(case)["undo"] == 3
    assert len(list((case / ".terrapin" / "versions").iterdir())) == 6


def test_commands_say_what_is_wrong(case: Path) -> None:
    from terrapin_tools.commands.case import hold, redo, set_, undo

    before = raw(case)
    for command, words in ((undo, ()), (redo, ())):
        with pytest.raises(UserError, match="nothing to"):
            command(case, *words)
    with pytest.raises(UserError, match="run 'moon' is not in the data"):
        hold(case, ["moon"])
    with pytest.raises(UserError, match="run to train on"):
        hold(case, list(load_case(case).run_names))
    with pytest.raises(UserError, match="expected a constant of"):
        set_(case, "moon=1")
    with pytest.raises(UserError, match="expected NAME=VALUE"):
        set_(case, "moon")
    assert raw(case) == before
    assert history.steps(case) == {"undo": 0, "redo": 0}


def test_an_own_effect_gives_way_to_its_mended_self(case: Path) -> None:
    from terrapin_tools.commands.add import add

    add(case, ["drag"], expression="k * omega", parameter=["k=0:-1:1:N m s/rad"])
    with pytest.raises(UserError, match="in the model already"):
        add(case, ["drag"], expression="k * omega**2", parameter=["k=0:-1:1:N m s^2/rad^2"])
    add(case, ["drag"], expression="k * omega**2", parameter=["k=0:-1:1:N m s^2/rad^2"], replace=True)
    present = load_case(case)
    assert present.effects.count("drag") == 1
    assert "omega**2" in present.text
    with pytest.raises(UserError, match="expected an effect of your own"):
        without_own(present.text, "moon")
    history.step(case, "undo")
    assert '"k * omega"' in load_case(case).text
