"""Attacks on trust, in their short form: nothing is taken, and an attack that has a signature is seen."""

from __future__ import annotations

import pytest

from tests.attack import boot_frames


def test_frames_without_a_signature_change_no_boot_loader(capsys: pytest.CaptureFixture[str]) -> None:
    result = boot_frames.attack(60_000, 1)
    assert result.taken == 0
    assert result.tried >= 60_000
    assert "0 erases" in result.note
    assert capsys.readouterr().out == f"{result}\n"


def test_the_attack_sees_what_a_signature_may(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the end of a signed image, as somebody recorded it, BEGIN erases: that must show."""
    monkeypatch.setattr(boot_frames._Stranger, "_tail", lambda _: boot_frames.NEW[-boot_frames.TLVS :])
    result = boot_frames.attack(60_000, 1)
    assert result.taken > 0
    assert "0 erases" not in result.note
