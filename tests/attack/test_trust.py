"""Attacks on trust, in their short form: nothing is taken, and an attack that has a signature is seen."""

from __future__ import annotations

import pytest

from tests.attack import boot_frames, sealed, stop_all, withheld
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


def test_no_sealed_frame_is_taken_after_its_age() -> None:
    results = list(withheld.attack(300, 1))
    assert [result.taken for result in results] == [0, 0, 0, 0]
    assert all(result.tried >= 30 for result in results)
    assert "0 taken" not in results[1].note  # what comes in time is


def test_the_attack_sees_a_controller_without_a_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """One whose time stands still takes what is old: order alone is no age."""
    stood: dict[int, int] = {}

    def later(self: withheld.Keyed, ms: int) -> None:
        self.ms += ms
        stood[id(self)] = stood.get(id(self), 0) + (ms if ms > 1000 else 0)
        shown = (self.ms - stood[id(self)]) & 0xFFFFFFFF
        self._lib.terrapin_seal_at(self._ffi.addressof(self._link, "seal"), shown)

    monkeypatch.setattr(withheld.Keyed, "later", later)
    assert next(iter(withheld.attack(300, 1))).taken > 0


def test_no_replay_no_guess_and_no_write_is_taken() -> None:
    results = list(sealed.attack(300, 1))
    assert [result.taken for result in results] == [0, 0, 0]
    assert results[2].tried >= 400
