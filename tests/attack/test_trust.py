"""Attacks on trust, in their short form: nothing is taken, and an attack that has a signature is seen."""

from __future__ import annotations

import pytest

from tests.attack import boot_frames, stop_all
from tests.boot.bootlib import TLVS


def test_frames_without_a_signature_change_no_boot_loader(capsys: pytest.CaptureFixture[str]) -> None:
    result = boot_frames.attack(60_000, 1)
    assert result.taken == 0
    assert result.tried >= 60_000
    assert "0 erases" in result.note
    assert capsys.readouterr().out == f"{result}\n"


def test_the_attack_sees_what_a_signature_may(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the end of a signed image, as somebody recorded it, BEGIN erases: that must show."""
    monkeypatch.setattr(boot_frames._Stranger, "_tail", lambda _: boot_frames.NEW[-TLVS:])
    result = boot_frames.attack(60_000, 1)
    assert result.taken > 0
    assert "0 erases" not in result.note


def test_stop_all_holds_in_every_state_until_a_clear() -> None:
    result = stop_all.attack(4_000, 1)
    assert result.taken == 0
    assert "9 of 9 states" in result.note
    assert "bridge on 0 ms, lifted 0 times; a clear ends it: yes" in result.note


def test_the_attack_sees_a_stop_that_is_lifted(monkeypatch: pytest.MonkeyPatch) -> None:
    """With clear among what a stranger says to an open controller, it ends."""
    monkeypatch.setattr(stop_all, "_MOST", stop_all.CLEAR)
    assert stop_all.attack(4_000, 1).taken > 0
